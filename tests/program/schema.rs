//! The schemas of the documents: as the program prints them, and what they refuse.

use serde_json::{Value, json};

use crate::desk::{Desk, drawing, part};
use crate::schemas::mistake;

#[test]
fn every_schema_is_listed_and_printed() {
    let desk = Desk::new();
    let list = desk.isomark(&["schema"]).out;
    let names: Vec<&str> = list.lines().map(|line| line.split_whitespace().next().unwrap()).collect();
    assert!(names.contains(&"report") && names.contains(&"status"), "{list}");
    for name in names {
        let schema: Value = serde_json::from_str(&desk.isomark(&["schema", name]).out).unwrap();
        let document = schema["title"].as_str().unwrap();
        assert!(list.contains(document), "{document}");
        assert_eq!(desk.isomark(&["schema", document]).out, desk.isomark(&["schema", name]).out);
    }
    desk.isomark(&["schema", "reports"]).refused(2, &["`reports`", "Did you mean `report`"]);
}

/// Fields may be added; those of today are there and hold what they are said to hold.
#[test]
fn a_schema_takes_new_fields_and_misses_old_ones() {
    let report = Desk::new().correct(&part("can/fc020-gui.glb"), &drawing("abc"), "");
    let changed = |pointer: &str, change: &dyn Fn(&mut Value)| {
        let mut changed = report.clone();
        change(changed.pointer_mut(pointer).unwrap());
        mistake(&changed)
    };
    assert_eq!(mistake(&report), None);
    for object in ["", "/part", "/part/residual", "/map", "/quality/after", "/notices/0"] {
        let added = changed(object, &|value| value["added_later"] = json!({ "a": [1] }));
        assert_eq!(added, None, "{object}");
    }
    for (object, field) in [
        ("", "schema"),
        ("", "quality"),
        ("/part", "blake3"),
        ("/part/facts", "size_mm"),
        ("/part/facts", "not_taken"),
        ("/map", "method"),
        ("/quality/after", "largest_stretch"),
        ("/notices/0", "code"),
    ] {
        let missing = changed(object, &|value| drop(value.as_object_mut().unwrap().remove(field).unwrap()));
        assert!(missing.is_some(), "{object}/{field} may be missing");
    }
    for (place, wrong) in [
        ("/part/span_mm", json!("wide")),
        ("/quality/after/length_error_mm", Value::Null),
        ("/notices/0/severity", json!("grave")),
        ("/output/extents_mm", json!([1.0, 2.0])),
        ("/schema", json!("isomark.report/2")),
        ("/map/method", json!("magic")),
    ] {
        assert!(changed(place, &|value| *value = wrong.clone()).is_some(), "{place} may be {wrong}");
    }
}

/// JSON has no word for NaN and infinity, and a document with `null` in place of a number cannot be read again.
#[test]
fn numbers_that_are_not_finite_are_left_out_of_documents() {
    let desk = Desk::new();
    desk.write(
        "far.dxf",
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n6\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n0\n10\n0\n20\n0\n\
         11\n1e307\n21\n0\n0\nENDSEC\n0\nEOF\n",
    );
    desk.write(
        "station.toml",
        "[station]\nname = \"test\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 100\nheight_mm = 100\n\
         [correction]\ntolerance_mm = nan\n",
    );
    let mouse = part("can/fc020-gui.glb");
    let settings =
        ["correct", &mouse, &drawing("abc"), "--out", "out.dxf", "--station", "station.toml", "--json"];
    for (arguments, code) in [
        (&["inspect", "far.dxf", "--json"][..], "pattern-out-of-range"),
        (&settings[..], "settings-out-of-range"),
    ] {
        let reason: Value = serde_json::from_str(&desk.isomark(arguments).out).unwrap();
        assert_eq!((&reason["code"], &reason["number"]), (&code.into(), &Value::Null));
    }
}
