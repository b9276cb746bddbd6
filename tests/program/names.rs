//! Names with characters that control a terminal: output for people escapes them, output for machines is exact.

use serde_json::Value;

use crate::desk::{Desk, drawing};
use crate::station::Station;

/// A flat plate of 100 x 100 mm.
const PLATE: &str = "v -50 -50 5\nv 50 -50 5\nv 50 50 5\nv -50 50 5\nf 1 2 3 4\n";
const PLATE_OPTIONS: [&str; 4] = ["--part-unit", "mm", "--part-up", "z"];

/// Characters that reverse the text direction or are invisible; every file system allows them.
const TURNED: &str = "lo\u{202e}go\u{200b}\u{2066}\u{feff}\u{61c}\u{2029}";
/// Characters that only some file systems allow, too: a forged line, a colour, a C1 control.
#[cfg(unix)]
const HOSTILE: &str = "lo\u{202e}go\nFORGED\r\u{1b}[31m\u{7}\u{7f}\u{9b}31m";
#[cfg(not(unix))]
const HOSTILE: &str = TURNED;

/// Fails if the text contains a character that controls a terminal, or a line that a name forged.
#[track_caller]
fn assert_harmless(text: &str) {
    let harmful = |letter: &char| {
        letter.is_control() && *letter != '\n'
            || "\u{61c}\u{200b}\u{200e}\u{200f}\u{2028}\u{2029}\u{2066}\u{feff}".contains(*letter)
            || ('\u{202a}'..='\u{202e}').contains(letter)
    };
    assert!(!text.contains(|letter| harmful(&letter)), "{text:?}");
    assert!(!text.lines().any(|line| line.trim_start().starts_with("FORGED")), "{text}");
}

/// A drawing with this layer name, in DXF notation: a line on the layer, and an insert that cannot be marked.
fn dxf(layer: &str) -> String {
    let line = format!("0\nLINE\n5\n2\\U+001BF\n8\n{layer}\n10\n0\n20\n0\n11\n10\n21\n0\n");
    let insert =
        format!("0\nINSERT\n5\n7\\U+202E\n8\n{layer}\n2\nblock\\U+000AFORGED\\U+009B\n10\n0\n20\n0\n");
    format!("0\nSECTION\n2\nENTITIES\n{line}{insert}0\nENDSEC\n0\nEOF\n")
}

const LAYER: &str = "A\\U+000AFORGED\\U+001B[2J\\U+202E\\U+0085\\U+200F";

#[test]
fn layer_block_and_handle_names_are_escaped_for_people() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    desk.write("a.dxf", dxf(LAYER));
    desk.write("b.dxf", dxf("B"));
    let run = |arguments: &[&str]| {
        let output = desk.isomark(arguments);
        assert_harmless(&output.out);
        assert_harmless(&output.err);
        output
    };
    let job = |verb, more: &[&str]| run(&[&[verb, "plate.obj", "a.dxf"], &PLATE_OPTIONS[..], more].concat());
    let output = run(&["inspect", "a.dxf"]);
    assert!(
        output.code == 0 && output.out.contains("A\\nFORGED\\u{1b}[2J\\u{202e}\\u{85}\\u{200f}"),
        "{output:?}"
    );
    assert!(output.out.contains("block\\nFORGED\\u{9b}") && output.out.contains("7\\u{202e}"), "{output:?}");
    job("correct", &["-o", "x.dxf"]).refused(1, &["on layer A\\nFORGED\\u{1b}[2J"]);
    job("evaluate", &["--method", "none"]).refused(1, &["on layer A\\nFORGED"]);
    let output = job("correct", &["-o", "x.dxf", "--losses", "warn", "--preview", "x.svg"]);
    assert!(output.code == 0 && output.err.contains("A\\nFORGED"), "{output:?}");
    assert_harmless(&desk.text("x.svg"));
    assert!(run(&["diff", "a.dxf", "b.dxf"]).out.contains("A\\nFORGED"));
    job("correct", &["-o", "x.dxf", "--ink-layers", "\u{202e}no\nFORGED"])
        .refused(1, &["\\u{202e}no\\nFORGED"]);

    // Machines get the exact names.
    let facts: Value = serde_json::from_str(&desk.isomark(&["inspect", "a.dxf", "--json"]).out).unwrap();
    assert_eq!(facts["not_taken"][0]["layer"], "A\nFORGED\u{1b}[2J\u{202e}\u{85}\u{200f}");
    assert_eq!(facts["not_taken"][0]["handle"], "7\u{202e}");
    let reason = desk
        .isomark(&[&["correct", "plate.obj", "a.dxf", "-o", "x.dxf", "--json"], &PLATE_OPTIONS[..]].concat());
    let reason: Value = serde_json::from_str(&reason.out).unwrap();
    assert_eq!(reason["place"]["layer"], "A\nFORGED\u{1b}[2J\u{202e}\u{85}\u{200f}");
}

#[test]
fn file_names_are_escaped_for_people() {
    for name in [TURNED, HOSTILE] {
        let desk = Desk::new();
        let (part, pattern) = (format!("{name}.obj"), format!("{name}.dxf"));
        desk.write(&part, PLATE);
        desk.write(&pattern, fs_err::read(drawing("square")).unwrap());
        let spelled = "lo\\u{202e}go";
        let run = |code: i32, arguments: &[&str]| {
            let output = desk.isomark(arguments);
            assert_eq!(output.code, code, "{arguments:?}: {output:?}");
            assert_harmless(&output.out);
            assert_harmless(&output.err);
            assert!(
                output.out.contains(spelled) || output.err.contains(spelled),
                "{arguments:?}: {output:?}"
            );
        };
        let job = |verb: &str, more: &[&str]| {
            let named = [verb, part.as_str(), pattern.as_str(), "--sku", "plate", "--cache", "kept"];
            run(0, &[&named[..], &PLATE_OPTIONS, more].concat());
        };
        job("correct", &["-o", "out.dxf", "--preview", "x.svg"]);
        assert_harmless(&desk.text("x.svg"));
        // Comments in the drawing stay comments, in ASCII.
        let dxf = desk.text("out.dxf");
        assert!(dxf.is_ascii());
        for pair in dxf.lines().collect::<Vec<_>>().chunks(2) {
            assert!(pair[0].trim().parse::<u16>().is_ok(), "{pair:?}");
        }
        job("evaluate", &["--method", "none"]);
        run(0, &["inspect", &part, "--part-unit", "mm", "--part-up", "z"]);
        run(0, &["inspect", &pattern]);
        run(0, &["cache", "list", "--cache", "kept"]);
        run(3, &["inspect", &format!("{name}-gone.dxf")]);
        run(1, &["diff", &pattern, &part]);
        run(2, &["correct", &part, &pattern, "-o", &pattern]);
        run(2, &["correct", &part, &pattern, "-o", "x.dxf", "--facing", name]);
        run(2, &["correct", &part, &pattern, &pattern, "-o", "x.dxf"]);
        run(2, &["check", &format!("{name}.toml")]);
        // The first name is an unknown SKU, the second one is not valid as a SKU.
        let code = if name == TURNED { 1 } else { 2 };
        run(code, &["correct", &pattern, "--sku", name, "-o", "x.dxf"]);
        run(0, &["init", name]);
        let output = desk.isomark(&["check", &format!("{name}/station.toml")]);
        assert_harmless(&output.out);
    }
}

#[test]
fn a_station_escapes_the_names_of_drops() {
    let station = Station::new();
    let (part, drop) = (format!("hot/{TURNED}.obj"), format!("hot/x@{HOSTILE}.dxf"));
    station.desk.write("hot/x.obj", PLATE);
    station.desk.write(&part, "v 0 0 0\n");
    station.desk.write(&drop, "no drawing");
    station.desk.write("hot/nobody\u{202e}.dxf", fs_err::read(drawing("square")).unwrap());
    let harmless = |arguments: &[&str]| {
        let output = station.desk.isomark(arguments);
        assert_harmless(&output.out);
        assert_harmless(&output.err);
        output
    };
    // In the log and in the summary.
    let output = harmless(&["watch", "station.toml", "--once"]);
    assert!(output.err.contains("lo\\u{202e}go") && output.out.contains("nobody\\u{202e}"), "{output:?}");
    let output = harmless(&["status", "station.toml"]);
    assert!(output.out.contains("lo\\u{202e}go") && output.out.contains("nobody\\u{202e}"), "{output:?}");
    let reasons = crate::station::files(&station.path("rejected"));
    let reasons: Vec<&String> = reasons.iter().filter(|name| name.ends_with(".reason.txt")).collect();
    assert_eq!(reasons.len(), 2, "{reasons:?}");
    for name in reasons {
        let reason = station.desk.text(&format!("rejected/{name}"));
        assert!(reason.contains("lo\\u{202e}go"), "{reason:?}");
        assert_harmless(&reason);
    }
    // Drops are given by their escaped name, or all at once.
    let shown = format!("{}.obj", isomark::printable::on_one_line(TURNED));
    let output = harmless(&["retry", "station.toml", &shown]);
    assert!(output.code == 0 && output.out.contains("lo\\u{202e}go"), "{output:?}");
    let output = harmless(&["retry", "station.toml", "--rejected"]);
    assert!(output.code == 0 && output.out.contains("lo\\u{202e}go"), "{output:?}");
    assert!(station.path(&part).exists() && station.path(&drop).exists());
    harmless(&["retry", "station.toml", HOSTILE]).refused(3, &["lo\\u{202e}go"]);
    let status: Value =
        serde_json::from_str(&station.desk.isomark(&["status", "station.toml", "--json"]).out).unwrap();
    let drops: Vec<&str> =
        status["rejections"].as_array().unwrap().iter().map(|one| one["drop"].as_str().unwrap()).collect();
    assert!(drops.contains(&format!("{TURNED}.obj").as_str()), "{drops:?}");
}
