//! `isomark explain`, and the reasons that point to it.

use serde_json::Value;

use crate::desk::Desk;

#[test]
fn a_code_is_explained_with_what_to_do() {
    let desk = Desk::new();
    let said = desk.isomark(&["explain", "mesh-truncated"]);
    assert_eq!((said.code, said.err.as_str()), (0, ""));
    assert!(said.out.starts_with("mesh-truncated (reason)\n\n"), "{}", said.out);
    assert!(said.out.contains("\nWhat to do: "), "{}", said.out);
    assert!(said.out.lines().all(|line| line.len() <= 80), "{}", said.out);

    let json: Value =
        serde_json::from_str(&desk.isomark(&["explain", "Mesh-Truncated", "--json"]).out).unwrap();
    assert_eq!(json["codes"].as_array().unwrap().len(), 1);
    assert_eq!(
        (&json["codes"][0]["code"], &json["codes"][0]["kind"]),
        (&"mesh-truncated".into(), &"reason".into())
    );
}

#[test]
fn all_codes_are_listed_by_kind() {
    let desk = Desk::new();
    let list = desk.isomark(&["explain"]).out;
    let places: Vec<usize> =
        ["Reasons: ", "  too-steep ", "Notices: ", "  steep ", "Reasons or notices", "  ink-lost "]
            .map(|words| list.find(words).unwrap_or_else(|| panic!("{words} is missing in\n{list}")))
            .into();
    assert!(places.is_sorted(), "{places:?}");
    assert!(list.lines().all(|line| line.len() <= 80), "{list}");
    let json: Value = serde_json::from_str(&desk.isomark(&["explain", "--json"]).out).unwrap();
    let codes = json["codes"].as_array().unwrap();
    assert!(codes.iter().all(|code| list.contains(&format!("  {} ", code["code"].as_str().unwrap()))));
}

#[test]
fn an_unknown_code_names_the_nearest() {
    let desk = Desk::new();
    desk.isomark(&["explain", "mesh-trunkated"])
        .refused(2, &["`mesh-trunkated`", "Did you mean `mesh-truncated`"]);
    let far = desk.isomark(&["explain", "zzzzzzzz", "--json"]);
    far.refused(2, &["`isomark explain` lists all codes"]);
    assert!(!far.err.contains("Did you mean"), "{}", far.err);
    let reason: Value = serde_json::from_str(&far.out).unwrap();
    assert_eq!((&reason["schema"], &reason["code"]), (&"isomark.reason/1".into(), &"usage".into()));
}

/// The last line of a refusal is a command that explains it, unless there is nothing to add.
#[test]
fn a_refusal_names_the_command_that_explains_it() {
    let desk = Desk::new();
    desk.write("cut.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2");
    let refused = desk.isomark(&["inspect", "cut.obj"]);
    let command = refused.err.lines().last().unwrap().trim_start();
    let words: Vec<&str> = command
        .strip_prefix("more:       isomark ")
        .unwrap_or_else(|| panic!("{refused:?}"))
        .split(' ')
        .collect();
    assert!(desk.isomark(&words).out.starts_with("mesh-"), "{words:?}");

    for plain in [&["inspect", "gone.obj"][..], &["explain", "zzzzzzzz"]] {
        let said = desk.isomark(plain);
        assert!(said.code > 1 && !said.err.contains("more:"), "{said:?}");
    }
}
