//! `isomark inspect` and `isomark diff`.

use serde_json::Value;

use crate::desk::{Desk, assert_near, drawing, numbers, part};

fn inspect(file: &str, options: &[&str]) -> String {
    let output = Desk::new().isomark(&[&["inspect", file], options].concat());
    assert_eq!((output.code, output.err.as_str()), (0, ""), "{file}");
    output.out
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

#[test]
fn a_part_in_an_unsupported_format_is_refused_as_a_part() {
    let desk = Desk::new();
    for name in ["can.igs", "can.IGES", "can.amf", "can.FCStd", "can.brep"] {
        let bytes: &[u8] = if name.ends_with("amf") { b"PK\x03\x04abc" } else { b"CAD\n" };
        desk.write(name, bytes);
        let words = [
            "cannot be read as a part: isomark does not read this format",
            name,
            ".step, .glb, .gltf, .obj, .stl",
        ];
        desk.isomark(&["inspect", name]).refused(1, &words);
        desk.isomark(&["correct", name, &drawing("abc"), "--out", "out.dxf"]).refused(1, &words);
    }
    // A drawing is recognised by its bytes.
    desk.write("abc.iges", std::fs::read(drawing("abc")).unwrap());
    assert!(desk.isomark(&["inspect", "abc.iges"]).out.contains(": drawing"));
}

#[test]
fn a_scan_in_an_unsupported_format_is_refused_with_formats_of_points() {
    let desk = Desk::new();
    for (name, format, bytes) in [
        ("can.pcd", "Point Cloud Library", &b"# .PCD v0.7\nVERSION 0.7\n"[..]),
        ("can.E57", "ASTM E57", b"ASTM-E57\0"),
        ("can.laz", "LAS", b"LASF"),
    ] {
        desk.write(name, bytes);
        let words = ["cannot be read as a scan: isomark does not read this format", format, ".ply, .xyz"];
        desk.isomark(&["inspect", name]).refused(1, &words);
        desk.isomark(&["correct", name, &drawing("abc"), "--out", "out.dxf"]).refused(1, &words);
    }
}

/// A plate in the coordinates of a map.
#[test]
fn a_scan_far_from_the_origin_is_refused_because_of_its_offset() {
    let desk = Desk::new();
    let places = (0..900).map(|at| (500_000 + at % 30, 4_000_000 + at / 30));
    desk.write("map.xyz", places.map(|(x, y)| format!("{x}.25 {y}.5 200.0\n")).collect::<String>());
    let words = ["All 900 points", "too far from the origin", "4000000", "Subtract the offset"];
    desk.isomark(&["inspect", "map.xyz", "--part-unit", "mm"]).refused(1, &words);
}

#[test]
fn the_fitted_surface_is_written_for_cad() {
    let desk = Desk::new();
    let can = part("can/fc020-gui.glb");
    let output = desk.isomark(&["inspect", &can, "--facing=-y", "--surface", "front.step"]);
    assert_eq!(output.code, 0, "{}", output.err);
    assert!(output.out.contains("spans, within 0.0"), "{}", output.out);
    let step = desk.text("front.step");
    assert!(step.starts_with("ISO-10303-21;") && step.ends_with("END-ISO-10303-21;\n"));
    desk.isomark(&["inspect", &can, "--facing=-y", "--surface", "again.step"]);
    assert_eq!(step, desk.text("again.step"), "the same part gives the same bytes");
    // Read as a part in mm with z up, the surface is where the front of the can is.
    desk.isomark(&["inspect", &can, "--facing=-y", "--surface", "front.obj"]);
    let options = ["inspect", "front.obj", "--part-unit", "mm", "--part-up", "z", "--json"];
    let front = json(&desk.isomark(&options).out);
    let whole = json(&desk.isomark(&["inspect", &can, "--json"]).out);
    let height = |part: &Value| [part["size_mm"][2].as_f64().unwrap()];
    assert_near(&height(&front), &height(&whole), 2.0);

    desk.isomark(&["inspect", &can, "--surface", "front.iges"]).refused(
        2,
        &[
            "front.iges",
            "is not that of a format of surfaces",
            "what to do: Give the file the extension .step or .obj",
        ],
    );
    desk.isomark(&["inspect", &can, "--surface", "no/front.step"]).refused(3, &["no folder", "what to do"]);
    assert_eq!(desk.isomark(&["inspect", &drawing("abc"), "--surface", "x.step"]).code, 2);
}

#[test]
fn a_part_is_described_with_size_unit_and_axis() {
    let text = inspect(&part("can/fc020-gui.glb"), &[]);
    for words in [
        "fc020-gui.glb: part",
        "x 115.00 mm",
        "unit       m, because",
        "up         y, because",
        "Open CASCADE",
        "follow the surface",
    ] {
        assert!(text.contains(words), "{words}:\n{text}");
    }
    // A part in mm, exported by a program that works in metres: the unit is a guess, with a warning.
    let text = inspect(&part("can/bl52-from-obj.glb"), &[]);
    for words in
        ["66.00 x 65.52 x 115.00 mm", "unit       mm, because", "WARNING", "`--part-unit`", "Blender"]
    {
        assert!(text.contains(words), "{words}:\n{text}");
    }
    let facts = json(&inspect(&part("can/bl52-from-obj.glb"), &["--json"]));
    assert_eq!(facts["schema"], "isomark.part/1");
    assert_near(&numbers(&facts, "/size_mm"), &[66.0, 65.52, 115.0], 0.01);
}

#[test]
fn an_implausible_size_causes_a_warning() {
    let can = part("can/fc020-fine-mesh.obj");
    let text = inspect(&can, &["--part-unit", "inch"]);
    assert!(text.contains("x 2921.00 mm") && text.contains("WARNING"), "{text}");
    Desk::new()
        .isomark(&["inspect", &can, "--part-unit", "m"])
        .refused(1, &["fc020-fine-mesh.obj", "109000 mm (limit 100000 mm)", "`--part-unit`"]);

    let text = inspect(&drawing("ez-defects"), &[]);
    for words in [
        "100000.00 x 20.00 mm",
        "unusual size",
        "2 paths were drawn twice in the same place, and the copies were removed (first: LINE 8C)",
        "1 outline is open",
        "LOST       3DFACE 95 on layer 0",
    ] {
        assert!(text.contains(words), "{words}:\n{text}");
    }
}

#[test]
fn a_drawing_is_described_with_entities_by_layer() {
    let text = inspect(&drawing("ez-layers-colors"), &[]);
    for words in [
        "34.00 x 20.00 mm",
        "$INSUNITS 4",
        "to mark    4 paths, 3 of them closed\n             1 on CUT, 3 on MARK\n",
        "contains   CIRCLE: 1 on CUT, 1 on FROZEN, 2 on MARK, 1 on OFF\n             LINE: 1 on 0, 1 on CONSTRUCTION\n",
        "skipped    CIRCLE 93 on layer FROZEN: its layer is frozen",
        "skipped    CIRCLE 95 on layer MARK: it is invisible",
        "layer FROZEN is frozen",
        "paper space",
    ] {
        assert!(text.contains(words), "{words}:\n{text}");
    }
    let facts = json(&inspect(&drawing("ez-logo-inch"), &["--json"]));
    assert_eq!(facts["schema"], "isomark.pattern/1");
    assert_near(&numbers(&facts, "/size_mm"), &[28.0, 28.0], 1e-6);
    let facts = json(&inspect(&drawing("ink12-logo_px-r14"), &["--json", "--pattern-unit", "px"]));
    assert_near(&numbers(&facts, "/size_mm"), &[58.0, 28.0], 0.01);
}

#[test]
fn diff_lists_the_changes_between_two_drawings() {
    let desk = Desk::new();
    let diff = |old: &str, new: &str, options: &[&str]| {
        let output = desk.isomark(&[&["diff", old, new], options].concat());
        assert_eq!((output.code, output.err.as_str()), (0, ""));
        output.out
    };
    let (mm, inch) = (drawing("ez-logo-mm"), drawing("ez-logo-inch"));
    assert_eq!(diff(&mm, &inch, &[]), "no difference: 4 paths unchanged\n");
    desk.correct_to("a.dxf", &[&part("can/fc020-gui.glb"), &mm], "--facing -y --place 0,60");
    desk.correct_to("b.dxf", &[&part("can/fc020-gui.glb"), &mm], "--facing -y --place 0,61");
    assert_eq!(diff("a.dxf", "b.dxf", &[]), "all 4 paths moved by 1.00 mm up\n");
    assert_eq!(diff("a.dxf", "b.dxf", &["--tolerance", "2"]), "no difference: 4 paths unchanged\n");
    let difference = json(&diff("a.dxf", "b.dxf", &["--json"]));
    assert_eq!(difference["schema"], "isomark.diff/1");
    assert_eq!((&difference["old_paths"], &difference["unchanged"]), (&4.into(), &0.into()));
    let entries = difference["entries"].as_array().unwrap();
    assert!(entries.len() == 4 && entries.iter().all(|entry| entry["change"] == "moved"), "{difference:#}");
    assert!(diff(&mm, &drawing("square"), &[]).contains("3 paths removed"));
    assert!(diff(&drawing("square"), &mm, &[]).contains("added"));

    desk.isomark(&["diff", "a.dxf", "gone.dxf"]).refused(3, &["gone.dxf", "what to do: "]);
    desk.write("empty.dxf", "");
    desk.isomark(&["diff", "a.dxf", "empty.dxf"]).refused(1, &["where:      empty.dxf"]);
    desk.isomark(&["diff", "a.dxf", "b.dxf", "--tolerance", "-1"]).refused(2, &["--tolerance"]);
}
