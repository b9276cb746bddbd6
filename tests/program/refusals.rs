//! Invalid input: the exit code, and a message with file, place, number and remedy.

use crate::desk::{Desk, Output, drawing, number, numbers, part};

const MOUSE: &str = "mouse/fc020-gui.glb";

fn correct(desk: &Desk, part: &str, pattern: &str, options: &str) -> Output {
    let arguments =
        ["correct", part, pattern, "--out", "out.dxf"].into_iter().chain(options.split_whitespace());
    let output = desk.isomark(&arguments.collect::<Vec<_>>());
    assert!(!desk.path("out.dxf").exists(), "nothing may be written when the job is refused");
    output
}

/// A plate of 100 x 100 mm with a square hole of 40 mm in the middle.
fn plate_with_hole() -> String {
    let mut text = String::new();
    for y in [-50, -20, 20, 50] {
        for x in [-50, -20, 20, 50] {
            text += &format!("v {x} {y} 5\n");
        }
    }
    for (row, column) in (0..9).map(|cell| (cell / 3, cell % 3)).filter(|cell| *cell != (1, 1)) {
        let first = row * 4 + column + 1;
        text += &format!("f {} {} {} {}\n", first, first + 1, first + 5, first + 4);
    }
    text
}

#[test]
fn damaged_parts() {
    let desk = Desk::new();
    let glb = std::fs::read(part("can/fc020-gui.glb")).unwrap();
    desk.write("cut.glb", &glb[..5000]);
    correct(&desk, "cut.glb", &drawing("abc"), "").refused(
        1,
        &[
            "cut.glb, byte 5000",
            "has 5000 of 14484 bytes",
            "number:     bytes present 5000\n",
            "what to do: Wait until the export",
        ],
    );

    let obj = std::fs::read_to_string(part("mouse/fc020-coarse-mesh.obj")).unwrap();
    let (line, _) = obj.lines().enumerate().filter(|(_, line)| line.starts_with("v ")).nth(5).unwrap();
    let broken: Vec<&str> =
        obj.lines().enumerate().map(|(at, text)| if at == line { "v NaN 1 2" } else { text }).collect();
    desk.write("nan.obj", broken.join("\n"));
    correct(&desk, "nan.obj", &drawing("abc"), "")
        .refused(1, &[&format!("nan.obj, line {}", line + 1), "(NaN, 1, 2)", "what to do: Repair the mesh"]);

    desk.write("words.glb", "this is not a mesh at all");
    correct(&desk, "words.glb", &drawing("abc"), "")
        .refused(1, &["not a file in GLB format", "words.glb", "what to do: Export"]);

    correct(&desk, &part("assembly/fc020-gui-arch-part.obj"), &drawing("abc"), "")
        .refused(1, &["no triangle", "fc020-gui-arch-part.obj", "what to do: Select the bodies", "FreeCAD"]);

    std::fs::copy(part("assembly/fc020-gui.gltf"), desk.path("alone.gltf")).unwrap();
    let missing =
        ["alone.gltf", "buffer \"fc020-gui.bin\" cannot be read", "what to do: Put \"fc020-gui.bin\" beside"];
    correct(&desk, "alone.gltf", &drawing("abc"), "").refused(1, &missing);
    desk.isomark(&["inspect", "alone.gltf"]).refused(1, &missing);
    let outside = desk.text("alone.gltf").replace("fc020-gui.bin", "../fc020-gui.bin");
    desk.write("outside.gltf", outside);
    let refused = ["outside.gltf", "../fc020-gui.bin", "what to do: Put the .bin into the part's folder"];
    correct(&desk, "outside.gltf", &drawing("abc"), "").refused(1, &refused);
    desk.isomark(&["inspect", "outside.gltf"]).refused(1, &refused);
}

#[test]
fn drawings_with_nothing_to_mark() {
    let desk = Desk::new();
    desk.write("empty.dxf", "");
    correct(&desk, &part(MOUSE), "empty.dxf", "")
        .refused(1, &["The file is empty.", "where:      empty.dxf", "what to do: Export or copy it again."]);
    desk.write("logo.dxf", "%PDF-1.7\n%\u{e9}\nstream\n");
    correct(&desk, &part(MOUSE), "logo.dxf", "")
        .refused(1, &["PDF", "where:      logo.dxf", "what to do: Export the drawing as DXF"]);
    desk.write("logo.png", "hello\nworld\n");
    correct(&desk, &part(MOUSE), "logo.png", "").refused(
        1,
        &[
            "This is not a PNG picture: it seems to be a text file.",
            "what to do: Save the picture as PNG again.",
        ],
    );
    correct(&desk, &part(MOUSE), &drawing("ink12-text-r14"), "")
        .refused(1, &["no entities", "ink12-text-r14.dxf", "Path > Object to Path"]);
    let whole = std::fs::read(drawing("abc")).unwrap();
    desk.write("cut.dxf", &whole[..whole.len() / 2]);
    correct(&desk, &part(MOUSE), "cut.dxf", "").refused(1, &["cut.dxf", "line ", "what to do: "]);
    correct(&desk, &part(MOUSE), &drawing("abc"), "--ink-layers MARK,CUT")
        .refused(1, &["ink layers MARK, CUT", "abc.dxf", "OUTLINE"]);
}

/// With `--json`, mistakes in the command line are reported as JSON, too.
#[test]
fn invalid_options_are_reported_as_json_if_requested() {
    let desk = Desk::new();
    for arguments in [
        &["correct", "a.glb", "b.dxf", "--json"][..],
        &["correct", "--json", "a.glb", "b.dxf", "--out", "c.dxf", "--nonsense"],
        &["correct", "a.glb", "b.dxf", "--out", "c.dxf", "--rotate", "much", "--json"],
        &["evaluate", "--json", "a.glb", "b.dxf", "--method", "magic"],
        &["inspect", "--json"],
        &["diff", "--json", "a.dxf"],
        &["status", "--json"],
        &["status", "--json", "none.toml"],
    ] {
        let output = desk.isomark(arguments);
        assert_eq!(output.code, 2, "{arguments:?}: {output:?}");
        let reason: serde_json::Value = serde_json::from_str(&output.out).unwrap_or_default();
        assert_eq!(reason["schema"], "isomark.reason/1", "{arguments:?}: {output:?}");
        assert!(reason["what"].as_str().is_some_and(|what| !what.is_empty()), "{arguments:?}: {output:?}");
        assert!(!output.err.is_empty());
    }
    let plain = desk.isomark(&["inspect"]);
    assert_eq!((plain.code, plain.out.as_str()), (2, ""));
    assert_eq!(desk.isomark(&["inspect", "--json", "--help"]).code, 0);
}

/// A drawing much larger than the part may have stray lines, or the unit of the part is wrong.
#[test]
fn a_wrong_unit_of_the_part_is_reported() {
    let desk = Desk::new();
    // Its numbers are metres: as inches it is 39 times too small, as millimetres a thousand times.
    for unit in ["inch", "cm", "mm"] {
        correct(&desk, &part(MOUSE), &drawing("abc"), &format!("--part-unit {unit}"))
            .refused(1, &[&format!("read as {unit} because the settings say so"), "`--part-unit`"]);
    }
    // The numbers are metres, but are read as mm because STL has no unit.
    let in_metres = "solid x\nfacet normal 0 0 1\nouter loop\nvertex -3 -3 0\nvertex 3 -3 0\nvertex 3 3 0\nendloop\nendfacet\n\
                     facet normal 0 0 1\nouter loop\nvertex -3 -3 0\nvertex 3 3 0\nvertex -3 3 0\nendloop\nendfacet\nendsolid x\n";
    desk.write("plate.stl", in_metres);
    correct(&desk, "plate.stl", &drawing("abc"), "")
        .refused(1, &["Check the unit of the part", "read as mm because STL"]);
}

#[test]
fn drawings_that_are_not_on_the_part() {
    let desk = Desk::new();
    correct(&desk, &part(MOUSE), &drawing("abc"), "--place 300,0").refused(
        1,
        &[
            "beyond the part",
            "x 280.5 to 319.5",
            "abc.dxf, at (300.000, 0.000) mm",
            "100 % (limit 0 %)",
            "what to do: Move",
        ],
    );
    let beside = correct(&desk, &part(MOUSE), &drawing("abc"), "--place 20,0");
    beside.refused(
        1,
        &["part spans x -", "ink without surface 2", "what to do: Move the drawing (`place_mm`, `--place`)"],
    );
    // The extents are those of the part, to a sample: of 110 mm there are 144.
    let facts = desk.isomark(&["inspect", &part(MOUSE), "--json"]).out;
    let facts: serde_json::Value = serde_json::from_str(&facts).unwrap();
    let (_, spans) = beside.err.split_once("part spans ").unwrap();
    let (spans, _) = spans.split_once(" mm").unwrap();
    for (axis, span) in ["x ", " y "].into_iter().zip(spans.split(" and")) {
        let (low, high) = span.trim_start_matches(axis).split_once(" to ").unwrap();
        let width = high.parse::<f64>().unwrap() - low.parse::<f64>().unwrap();
        let size = facts["size_mm"][usize::from(axis == " y ")].as_f64().unwrap();
        assert!((size - width).abs() < 0.77, "{spans}: {width} of {size}");
    }
    // A can of 66 mm round its axis, whose nodes are not symmetric.
    for can in ["can/fc020-gui.glb", "can/part.step"] {
        correct(&desk, &part(can), &drawing("abc"), "--facing -y --place 60,60")
            .refused(1, &["part spans x -33.0 to 33.0 "]);
    }
    // A box, also when it is turned on the table.
    let corners = (0..8).map(|corner| {
        let end = |bit: u32, length: f64| if corner >> bit & 1 == 1 { length } else { -length };
        format!("v {} {} {}\n", end(0, 25.0), end(1, 20.0), end(2, 5.0))
    });
    let faces = "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
    desk.write("box.obj", corners.collect::<String>() + faces);
    for (roll, spans) in [
        (0, "part spans x -25.0 to 25.0 and y -20.0 to 20.0 mm"),
        (90, "part spans x -20.0 to 20.0 and y -25.0 to 25.0 mm"),
        (180, "part spans x -25.0 to 25.0 and y -20.0 to 20.0 mm"),
        (270, "part spans x -20.0 to 20.0 and y -25.0 to 25.0 mm"),
    ] {
        let options = format!("--part-unit mm --part-up z --place 24,0 --set part.roll_deg={roll}");
        correct(&desk, "box.obj", &drawing("abc"), &options).refused(1, &[spans]);
    }
    // The drawing is on the steep side of the can.
    correct(&desk, &part("can/fc020-gui.glb"), &drawing("abc"), "--place 33,0").refused(
        1,
        &[
            "no surface to mark",
            "too steep to be measured (over 75 deg)",
            // Near the rim, whose radius is 33 mm.
            "abc.dxf, at (32.",
            "`facing`",
        ],
    );
    // A plate with a hole under the drawing.
    desk.write("plate.obj", plate_with_hole());
    correct(&desk, "plate.obj", &drawing("circle"), "--part-unit mm --part-up z --place 0,0")
        .refused(1, &["a hole", "circle.dxf, at (", "ink without surface", "what to do: Move"]);

    correct(&desk, &part("can/fc020-gui.glb"), &drawing("abc"), "--facing -y --place 18,60").refused(
        1,
        &[
            "66.9 deg",
            "abc.dxf, at (30.3",
            "incidence angle 66.9",
            "(limit 60.0000 deg)",
            "what to do: Make the drawing narrower",
        ],
    );
    // A stray line a hundred metres away.
    correct(&desk, &part(MOUSE), &drawing("ez-defects"), "")
        .refused(1, &["the drawing x 0.0 to 100000.0", "what to do: Delete stray lines", "isomark inspect"]);
}

/// The plate with a block of 40 x 40 x 3 mm instead of the hole.
fn plate_with_block() -> String {
    let mut text = plate_with_hole();
    for [x, y] in [[-20, -20], [20, -20], [20, 20], [-20, 20]] {
        text += &format!("v {x} {y} 8\n");
    }
    let foot = [6, 7, 11, 10];
    text += "f 17 18 19 20\n";
    for (side, next) in (0..4).map(|side| (side, (side + 1) % 4)) {
        text += &format!("f {} {} {} {}\n", foot[side], foot[next], 17 + next, 17 + side);
    }
    text
}

/// A ring of radius 35 mm about (x, 0), as a line or as a filled area.
fn ring(x: f64, is_filled: bool) -> String {
    let entity = match is_filled {
        false => format!("0\nCIRCLE\n8\n0\n10\n{x}\n20\n0\n40\n35\n"),
        true => format!(
            "0\nHATCH\n8\n0\n10\n0\n20\n0\n30\n0\n2\nSOLID\n70\n1\n71\n0\n91\n1\n92\n1\n93\n1\n72\n2\n10\n{x}\n20\n0\n\
             40\n35\n50\n0\n51\n360\n73\n1\n97\n0\n75\n0\n76\n1\n98\n0\n"
        ),
    };
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n\
         {entity}0\nENDSEC\n0\nEOF\n"
    )
}

/// On a plate, the true ring is the ring as it is drawn.
#[test]
fn an_outline_round_a_hole_or_a_boss_is_only_its_line() {
    let desk = Desk::new();
    desk.write("hole.obj", plate_with_hole());
    desk.write("block.obj", plate_with_block());
    desk.write("ring.dxf", ring(0.0, false));
    desk.write("hatch.dxf", ring(0.0, true));
    desk.write("beside.dxf", ring(30.0, false));
    let z_up = "--part-unit mm --part-up z";
    for part in ["hole.obj", "block.obj"] {
        for filled in [("hatch.dxf", ""), ("ring.dxf", "--fill 0.5"), ("beside.dxf", "")] {
            let options = format!("{z_up} {}", filled.1);
            correct(&desk, part, filled.0, &options).refused(1, &["ink without surface"]);
        }
    }
    for (part, aim) in [("hole.obj", "balanced"), ("hole.obj", "lengths"), ("block.obj", "balanced")] {
        let report = desk.correct(part, "ring.dxf", &format!("{z_up} --aim {aim}"));
        let extents = numbers(&report, "/output/extents_mm");
        let expected = [-35.0, -35.0, 35.0, 35.0];
        assert!(
            extents.iter().zip(expected).all(|(side, true_side)| (side - true_side).abs() < 0.02),
            "{part}: {extents:?}"
        );
        let error = number(&report, "/quality/after/length_error_mm");
        assert!(error < 1e-3 * 70.0 * std::f64::consts::PI, "{part}: {error}");
        let codes: Vec<&str> = report["notices"]
            .as_array()
            .unwrap()
            .iter()
            .filter_map(|notice| notice["code"].as_str())
            .collect();
        assert!(codes.contains(&"outline-only"), "{part}: {codes:?}");
    }
}

#[test]
fn a_drawing_wider_than_the_field() {
    let desk = Desk::new();
    desk.write(
        "station.toml",
        "[station]\nname = \"a\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 20\nheight_mm = 20\n",
    );
    correct(&desk, &part(MOUSE), &drawing("abc"), "--station station.toml").refused(
        1,
        &[
            "the field x -10.0 to 10.0",
            "abc.dxf",
            "overhang 9.",
            "mm (limit 0 mm)",
            "what to do: Make the drawing smaller, to at most 5",
            "and the field has 20.0 x 20.0 mm",
        ],
    );
}

#[test]
fn a_drawing_beside_the_field_and_the_fixture_that_moves_it_there() {
    let desk = Desk::new();
    let stand = |fixture: &str| {
        let text = "[station]\nname = \"a\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 50\n\
                    height_mm = 20\norigin = \"corner\"\n[fixture]\nrotation_deg = 10\n";
        desk.write("station.toml", format!("{text}{fixture}"));
    };
    stand("x_mm = 3\n");
    let refused = correct(&desk, &part(MOUSE), &drawing("abc"), "--station station.toml");
    refused.refused(1, &["what to do: Move the drawing", "under [fixture] the drawing is in the middle"]);
    let offset = |axis: &str| {
        let after = refused.err.split(&format!("`{axis}_mm = ")).nth(1).unwrap();
        after.split('`').next().unwrap().parse::<f64>().unwrap()
    };
    stand(&format!("x_mm = {}\ny_mm = {}\n", offset("x"), offset("y")));
    let report = desk.correct(&part(MOUSE), &drawing("abc"), "--station station.toml");
    let [left, bottom, right, top] = numbers(&report, "/output/extents_mm")[..] else { panic!("{report}") };
    assert!((left + right - 50.0).abs() < 0.2 && (bottom + top - 20.0).abs() < 0.2, "{report}");
}

/// Through a lens 150 mm above the field, a part at 40 mm moves the drawing by 1.4 mm for each mm.
#[test]
fn the_proposed_fixture_is_exact_through_a_lens() {
    let desk = Desk::new();
    let stand = |fixture: &str| {
        let text = "[station]\nname = \"a\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 80\n\
                    height_mm = 80\norigin = \"corner\"\n[optics]\nkind = \"perspective\"\nlens_distance_x_mm = 150\n\
                    lens_distance_y_mm = 140\nincidence_refuse_deg = 89\n[fixture]\nz_mm = 10\nrotation_deg = 10\n";
        desk.write("station.toml", format!("{text}{fixture}"));
    };
    stand("x_mm = 3\n");
    let refused = correct(&desk, &part(MOUSE), &drawing("abc"), "--station station.toml");
    refused.refused(1, &["under [fixture] the drawing is in the middle of the field"]);
    let offset = |axis: &str| {
        let after = refused.err.split(&format!("`{axis}_mm = ")).nth(1).unwrap();
        after.split('`').next().unwrap().parse::<f64>().unwrap()
    };
    stand(&format!("x_mm = {}\ny_mm = {}\n", offset("x"), offset("y")));
    let report = desk.correct(&part(MOUSE), &drawing("abc"), "--station station.toml");
    let [left, bottom, right, top] = numbers(&report, "/output/extents_mm")[..] else { panic!("{report}") };
    assert!((left + right - 80.0).abs() < 0.2 && (bottom + top - 80.0).abs() < 0.2, "{report}");
}

/// At 20 mm the lens is below the mouse, at 36 mm the beam is too flat to reach its sides.
#[test]
fn a_part_that_reaches_the_lens() {
    let desk = Desk::new();
    for (distance, words) in [
        (
            20,
            &[
                "as high as the lens",
                "height of the ink",
                "(limit 20 mm)",
                "what to do: Check the fixture's `z_mm`",
            ][..],
        ),
        (37, &["deg to its normal", "incidence angle", "what to do: Check the lens distances"][..]),
    ] {
        desk.write(
            "station.toml",
            format!(
                "[station]\nname = \"a\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 110\n\
                 height_mm = 110\n[optics]\nkind = \"perspective\"\nlens_distance_x_mm = {distance}\n\
                 lens_distance_y_mm = {distance}\n"
            ),
        );
        let output = correct(&desk, &part(MOUSE), &drawing("abc"), "--place 0,8 --station station.toml");
        output.refused(1, words);
        assert!(!output.err.contains("inf"), "{output:?}");
    }
}

#[test]
fn a_drawing_in_pixels_is_refused_with_its_unit_first() {
    let desk = Desk::new();
    let (mouse, logo) = (part(MOUSE), drawing("ink12-logo_px-r14"));
    let unit = "what to do: Check the drawing's unit: Inkscape wrote none, and the numbers are probably pixels. Set \
                `unit_if_unitless = \"px\"` under [pattern] (`--pattern-unit px`). ";
    correct(&desk, &mouse, &logo, "").refused(1, &["The drawing extends beyond the part.", unit]);
    // With a unit that is given, nothing is in doubt.
    let given = correct(&desk, &mouse, &logo, "--pattern-unit mm");
    assert!(given.code == 1 && !given.err.contains("Inkscape wrote none"), "{given:?}");
}

#[test]
fn options_of_pictures_are_refused_for_a_dxf() {
    let desk = Desk::new();
    let (mouse, abc) = (part(MOUSE), drawing("abc"));
    desk.write("skus/mouse.toml", "[pattern]\nwidth_mm = 30\ninvert = true\n");
    desk.write(
        "station.toml",
        "[station]\nname = \"a\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\nskus = \"skus\"\n[field]\n\
         width_mm = 110\nheight_mm = 110\n[pattern]\nthreshold_percent = 40\n",
    );
    let scaled = "Remove it, or scale the drawing in the drawing program.";
    for (options, what, remedy) in [
        ("--width 20", "`--width` has no effect: abc.dxf is a DXF, which is never scaled.", scaled),
        ("--height 20", "`--height` has no effect: abc.dxf is a DXF, which is never scaled.", scaled),
        (
            "--threshold 40",
            "`--threshold` has no effect: abc.dxf is a DXF, which has no pixels.",
            "Remove it.",
        ),
        ("--invert", "`--invert` has no effect: abc.dxf is a DXF, which has no pixels.", "Remove it."),
        ("--set pattern.width_mm=20", "`--set pattern.width_mm=20` has no effect: abc.dxf is a DXF", scaled),
        ("--set pattern.invert=true", "`--set pattern.invert=true` has no effect", "Remove it."),
    ] {
        let options: Vec<&str> = options.split(' ').collect();
        for command in
            [&["correct", &mouse, &abc, "-o", "out.dxf"][..], &["evaluate", &mouse, &abc], &["inspect", &abc]]
        {
            let output = desk.isomark(&[command, options.as_slice()].concat());
            output.refused(2, &[what, &format!("what to do: {remedy}")]);
        }
        assert!(!desk.path("out.dxf").exists());
    }
    // Settings in files are for all drawings.
    desk.correct(&mouse, &abc, "--place 0,8 --station station.toml --sku mouse");
}

/// An option is refused if the typed options and the files leave nothing for it to change.
#[test]
fn options_of_what_is_switched_off_are_refused() {
    let desk = Desk::new();
    let abc = drawing("abc");
    let station = "[station]\nname = \"a\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 110\n\
                   height_mm = 110\n[focus]\nstep_mm = 1\n[fill]\nborder_mm = 0.1\n[rotary]\noverlap_mm = 1\n";
    desk.write("station.toml", station);
    let correct = |options: &str| {
        let words = format!(
            "correct {abc} --cylinder 120,120 --place 0,0 --out out.dxf --station station.toml {options}"
        );
        desk.isomark(&words.split_whitespace().collect::<Vec<_>>())
    };
    let tiles = ["the mark is not divided into tiles", "what to do: Remove it, or add `--rotary`."];
    let steps =
        ["not divided into steps of focus", "what to do: Remove it, or add `--set focus.steps=layers`."];
    let fill = ["nothing is filled", "what to do: Remove it, or add `--fill`"];
    let list = ["it is for the drawings of a list", "what to do: Remove it, or name the list with `--list`"];
    for (typed, option, words) in [
        ("--overlap 2", "--overlap", tiles),
        ("--max-tile 20", "--max-tile", tiles),
        ("--reverse", "--reverse", tiles),
        ("--tiles-as files", "--tiles-as", tiles),
        ("--rotary=off --tiles-as files", "--tiles-as", tiles),
        ("--set rotary.overlap_mm=2", "--set rotary.overlap_mm=2", tiles),
        ("--step-files", "--step-files", steps),
        ("--set focus.step_mm=2", "--set focus.step_mm=2", steps),
        ("--set fill.angle_deg=30", "--set fill.angle_deg=30", fill),
        ("--out-dir results", "--out-dir", list),
    ] {
        let output = correct(typed);
        output.refused(2, &[&format!("`{option}` has no effect: ")]);
        output.refused(2, &words);
        assert!(!desk.path("out.dxf").exists(), "{typed}");
    }
    // Settings in files are for all drawings, and what is switched on makes use of the options.
    for typed in [
        "",
        "--rotary --overlap 2",
        "--fill 1 --set fill.angle_deg=30",
        "--set focus.steps=layers --step-files",
    ] {
        correct(typed).refused(0, &[]);
    }
    desk.write("station.toml", format!("{station}tiles = \"auto\"\n"));
    correct("--reverse").refused(0, &[]);
}

#[test]
fn options_for_parts_and_for_drawings_are_not_mixed_up() {
    let desk = Desk::new();
    let (mouse, abc) = (part(MOUSE), drawing("abc"));
    let (for_drawings, for_parts) =
        ("is a part, and it is for drawings", "is a drawing, and it is for parts");
    for (file, typed, words) in [
        (&mouse, "--width 20", for_drawings),
        (&mouse, "--pattern-unit mm", for_drawings),
        (&mouse, "--strokes band", for_drawings),
        (&mouse, "--threshold 40", for_drawings),
        (&mouse, "--space paper", for_drawings),
        (&mouse, "--set pattern.strict=true", for_drawings),
        (&abc, "--facing=-y", for_parts),
        (&abc, "--normals file", for_parts),
        (&abc, "--bridge 3", for_parts),
        (&abc, "--smoothing none", for_parts),
    ] {
        let words_typed: Vec<&str> = typed.split(' ').collect();
        let output = desk.isomark(&[&["inspect", file][..], &words_typed].concat());
        let option = if typed.starts_with("--set") { typed } else { typed.split([' ', '=']).next().unwrap() };
        output.refused(2, &[&format!("`{option}` has no effect: "), words, "what to do: Remove it."]);
    }
}

#[test]
fn only_a_drawing_is_replaced() {
    let desk = Desk::new();
    let job =
        |out: &str| desk.isomark(&["correct", &part(MOUSE), &drawing("abc"), "--place", "0,8", "-o", out]);
    for name in ["part.3mf", "part.STP", "scan.xyz", "list.txt", "photo.jpg", "mouse.svg", "notes"] {
        let content = "Call the customer.\n";
        desk.write(name, content);
        let what = match name.contains('.') {
            true => format!("`--out` writes a DXF drawing, and {name} has another extension"),
            false => format!("`--out` names {name}, which is not a DXF"),
        };
        job(name).refused(2, &[&what, "what to do: Give "]);
        assert_eq!(desk.text(name), content);
    }
    desk.write("empty.dxf", "");
    desk.write("binary.dxf", b"AutoCAD Binary DXF\r\n\x1a\0");
    for name in ["empty.dxf", "binary.dxf", "new.dxf", "new.dxf"] {
        job(name).refused(0, &[]);
    }
}

#[test]
fn wrong_usage() {
    let desk = Desk::new();
    let (mouse, abc) = (part(MOUSE), drawing("abc"));
    for (options, words) in [
        (
            "--place nonsense",
            ["two numbers, such as 12.5,-3", "where:      --place nonsense", "what to do: "],
        ),
        ("--place 1,2,3", ["two numbers", "where:      --place 1,2,3", " 12.5,-3"]),
        ("--facing up", ["`up`", "where:      --facing up", " -y (front)"]),
        ("--facing 0,0,0", ["`0,0,0`", "--facing", "direction"]),
        ("--method magic", ["`magic`", "--method", "`isometric`"]),
        ("--weighting heavy", ["`heavy`", "--weighting", "`uniform`"]),
        ("--aim far", ["`far`", "--aim", "`shapes`"]),
        ("--part-unit furlong", ["furlong", "--part-unit", "mm"]),
        (
            "--tolerance 0",
            ["cannot be 0 mm", "where:      --tolerance 0", "what to do: Give a number from 0.0001 to 1 mm"],
        ),
        ("--tolerance nan", ["cannot be NaN mm", "what to do: Give", "0.0001 to 1 mm"]),
        ("--length-weight 50", ["cannot be 50 times", "--length-weight", "from 0.1 to 10"]),
        ("--angle-weight nan", ["cannot be NaN times", "--angle-weight", "from 0.1 to 10"]),
        ("--rotate inf", ["cannot be inf deg", "what to do: Give", "from -360 to 360 deg"]),
        ("--sku a/b", ["`a/b`", "'/'", "what to do: Rename it"]),
        ("--unheard-of", ["--unheard-of", "Usage", "--help"]),
    ] {
        correct(&desk, &mouse, &abc, options).refused(2, &words);
    }
    desk.isomark(&["correct", &mouse, &abc]).refused(2, &["--out", "<PART> <DRAWING>"]);
    desk.isomark(&["correct", &mouse, "-o", "x.dxf"])
        .refused(2, &["a part but no drawing", "what to do: Name the drawing"]);
    desk.isomark(&["correct", &abc, "-o", "x.dxf"]).refused(2, &["neither a part nor a SKU", "`--sku`"]);
    desk.isomark(&["paint"]).refused(2, &["paint"]);
    desk.isomark(&["--version"]).refused(0, &[]);
}

#[test]
fn results_never_replace_input_files() {
    let desk = Desk::new();
    for (name, source) in [("mouse.glb", part(MOUSE)), ("abc.dxf", drawing("abc"))] {
        desk.write(name, fs_err::read(source).unwrap());
    }
    let job = |results: &[&str]| desk.isomark(&[&["correct", "mouse.glb", "abc.dxf"], results].concat());
    job(&["-o", "abc.dxf"])
        .refused(2, &["`--out` names abc.dxf, which is also read", "what to do: Give `--out`"]);
    job(&["-o", "./mouse.glb"]).refused(2, &["which is also read"]);
    job(&["-o", "x.dxf", "--preview", "abc.dxf"]).refused(2, &["`--preview`", "which is also read"]);
    job(&["-o", "x.dxf", "--preview", "mouse.png"])
        .refused(2, &["SVG", "mouse.png", "what to do: Give the file the extension .svg"]);
    job(&["-o", "x.svg"])
        .refused(2, &["`--out` writes a DXF", "x.svg", "what to do: Give the file the extension .dxf"]);
    job(&["-o", "x.dxf", "--xyz", "l.xyz"])
        .refused(2, &["l.xyz", "what to do: Give the file the extension .csv or .dxf"]);
    job(&["-o", "x.dxf", "--on-part", "./mouse.glb"]).refused(2, &["`--on-part`", "which is also read"]);
    job(&["-o", "x.dxf", "--on-part", "mouse.gltf"])
        .refused(2, &["binary glTF", "mouse.gltf", "what to do: Give the file the extension .glb"]);
    job(&["-o", "x.dxf", "--report-html", "abc.dxf"]).refused(2, &["`--report-html`", "which is also read"]);
    job(&["-o", "x.dxf", "--report-html", "mouse.pdf"])
        .refused(2, &["HTML", "mouse.pdf", "what to do: Give the file the extension .html"]);
    job(&["-o", "x.dxf", "--preview", "x.svg", "--on-part", "x.svg"])
        .refused(2, &["`--preview` and `--on-part` name the same file"]);
    job(&["-o", "x.dxf", "--report", "x.dxf"]).refused(2, &["`--out` and `--report` name the same file"]);
    desk.isomark(&["inspect", "mouse.glb", "--surface", "mouse.glb"]).refused(2, &["which is also read"]);
    assert_eq!(desk.read("mouse.glb"), fs_err::read(part(MOUSE)).unwrap());
    assert_eq!(desk.read("abc.dxf"), fs_err::read(drawing("abc")).unwrap());
}

#[test]
fn options_for_part_files_are_refused_for_a_primitive() {
    let desk = Desk::new();
    for option in ["--part-unit=inch", "--part-up=y", "--smoothing=none", "--low-pass=5"] {
        desk.isomark(&["correct", "--cylinder", "73,180", &drawing("abc"), "-o", "x.dxf", option]).refused(
            2,
            &["no file is read", &format!("where:      {}", option.replace('=', " ")), "what to do: "],
        );
    }
}

#[test]
fn an_evaluation_without_any_map_is_refused() {
    let desk = Desk::new();
    let far = ["evaluate", &part(MOUSE), &drawing("abc"), "--place", "200,0"].map(String::from);
    desk.isomark(&far).refused(1, &["beyond the part", "what to do"]);
}

#[test]
fn files_of_other_kinds() {
    let desk = Desk::new();
    desk.write("part.iges", "S 1");
    correct(&desk, "part.iges", &drawing("abc"), "").refused(
        1,
        &[
            "part.iges",
            "does not read",
            "what to do: Export the part or scan as .step, .glb, .gltf, .obj, .stl, .ply",
            "FreeCAD",
        ],
    );
    desk.write("logo.pdf", "%PDF-1.7\n");
    correct(&desk, &part(MOUSE), "logo.pdf", "")
        .refused(1, &["logo.pdf", "not a DXF", "what to do: Export the drawing as DXF"]);
    desk.write("empty.svg", "<svg xmlns=\"http://www.w3.org/2000/svg\"/>");
    correct(&desk, &part(MOUSE), "empty.svg", "").refused(1, &["empty.svg", "nothing to mark"]);
    let unknown = desk.isomark(&["correct", &drawing("abc"), "--sku", "never-seen", "-o", "out.dxf"]);
    unknown.refused(1, &["never-seen", "what to do: Name the part"]);
}

#[test]
fn a_typo_in_the_settings() {
    let desk = Desk::new();
    desk.write("station.toml", "[station]\nname = \"a\"\n[folders]\nhot = \"hot\"\nimprot = \"import\"\n");
    let words = ["`improt`", "station.toml, line 5, column 1", "what to do: Did you mean `import`?"];
    desk.isomark(&["watch", "station.toml", "--once"]).refused(2, &words);
    desk.isomark(&["cache", "list", "--station", "station.toml"]).refused(2, &words);
    correct(&desk, &part(MOUSE), &drawing("abc"), "--station station.toml").refused(2, &words);
    // Exit code 2 keeps a service manager from restarting a service with a mistyped name.
    desk.isomark(&["watch", "nowhere.toml"]).refused(2, &["nowhere.toml", "what to do: "]);
    // The line with carets under the place, without colour where no terminal is.
    let carets = "  |\n5 | improt = \"import\"\n  | ^^^^^^\n";
    for command in [&["watch", "station.toml"][..], &["check", "station.toml"]] {
        let said = desk.isomark(command);
        assert!(said.err.ends_with(carets), "{said:?}");
    }
    desk.write("latin.toml", b"[station]\nname = \"B\xfcro\"\n");
    desk.isomark(&["watch", "latin.toml"]).refused(2, &["latin.toml", "UTF-8"]);
    desk.isomark(&["watch", "."]).refused(2, &["station.toml", "what to do: Name the file"]);
}

#[test]
fn missing_files_and_folders() {
    let desk = Desk::new();
    correct(&desk, "gone.glb", &drawing("abc"), "")
        .refused(3, &["There is no file gone.glb.", "where:      gone.glb", "what to do: Check"]);
    correct(&desk, &part(MOUSE), "gone.dxf", "").refused(3, &["There is no file gone.dxf."]);
    desk.isomark(&["inspect", "gone.glb"]).refused(3, &["gone.glb", "what to do: "]);
    let out = |path: &str| desk.isomark(&["correct", &part(MOUSE), &drawing("abc"), "-o", path]);
    out("no/folder/out.dxf").refused(3, &["There is no folder no/folder", "what to do: Make the folder"]);
    desk.write("results/old.dxf", "");
    out("results").refused(3, &["results is a folder; a file is needed", "what to do: Name a file"]);
}

#[cfg(unix)]
#[test]
fn folders_without_write_permission() {
    use std::os::unix::fs::PermissionsExt;
    let desk = Desk::new();
    desk.write("locked/old.dxf", "");
    let locked = desk.path("locked");
    std::fs::set_permissions(&locked, std::fs::Permissions::from_mode(0o555)).unwrap();
    if std::fs::write(locked.join("probe"), "").is_ok() {
        eprintln!("SKIPPED: root can write everywhere");
        return;
    }
    let output = desk.isomark(&["correct", &part(MOUSE), &drawing("abc"), "-o", "locked/out.dxf"]);
    output.refused(3, &["locked/out.dxf", "may not be written", "what to do: Give yourself the right"]);
    let output =
        desk.isomark(&["correct", &part(MOUSE), &drawing("abc"), "-o", "out.dxf", "--cache", "locked/cache"]);
    output.refused(3, &["cache", "what to do: "]);
    std::fs::set_permissions(&locked, std::fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn a_refusal_as_json() {
    let desk = Desk::new();
    let output = correct(&desk, &part(MOUSE), &drawing("abc"), "--place 300,0 --json");
    let reason: serde_json::Value = serde_json::from_str(&output.out).unwrap();
    assert_eq!(
        (output.code, &reason["schema"], &reason["code"]),
        (1, &"isomark.reason/1".into(), &"off-surface".into())
    );
    assert_eq!(reason["place"]["file"], "abc.dxf");
    assert_eq!(reason["place"]["coordinate"], serde_json::json!([300.0, 0.0]));
    assert_eq!((&reason["number"]["value"], &reason["number"]["unit"]), (&100.0.into(), &"%".into()));
    assert!(reason["remedy"].as_str().unwrap().ends_with('.'));
}

/// Random points of a rounded block and of its steep sides, with noise of a standard deviation, mm.
fn block(noise: f64) -> String {
    let mut state = 5u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / f64::from(1u32 << 24)
    };
    let half = [30.0f64, 55.0, 38.0];
    let mut text = String::new();
    for _ in 0..35_000 {
        // A sum of twelve has the variance 1.
        let mut normal = || (0..12).map(|_| random()).sum::<f64>() - 6.0;
        let mut direction = [normal(), normal(), normal()];
        direction[2] = direction[2].abs();
        let norm: f64 = (0..3).map(|axis| (direction[axis] / half[axis]).powi(4)).sum();
        let at = direction.map(|share| share * norm.powf(-0.25) + noise * normal());
        text += &format!("{:.3} {:.3} {:.3}\n", at[0], at[1], at[2]);
    }
    text
}

/// Nothing is marked of which a tenth of the length is uncertain.
#[test]
fn a_surface_that_is_not_known_is_not_marked() {
    let desk = Desk::new();
    desk.write("block.xyz", block(0.3));
    for bridge in ["0", "3"] {
        let drawing = drawing("abc");
        let options = ["--place", "0,8", "--bridge", bridge, "--smoothing", "none", "-o", "out.dxf"];
        let output = desk.isomark(&[&["correct", "block.xyz", &drawing][..], &options].concat());
        assert_eq!(output.code, 1, "{}", output.err);
        assert!(
            output.err.contains("off-surface") || output.err.contains("surface-unknown"),
            "{}",
            output.err
        );
    }
}

/// Most points of this scan are on the steep sides, and the rest is denser in the middle.
#[test]
fn a_scan_with_steep_sides_is_marked() {
    let desk = Desk::new();
    desk.write("block.xyz", block(0.02));
    for bridge in [&[][..], &["--bridge", "3"]] {
        let drawing = drawing("abc");
        let options = ["--place", "0,8", "-o", "out.dxf"];
        let output = desk.isomark(&[&["correct", "block.xyz", &drawing][..], &options, bridge].concat());
        assert_eq!(output.code, 0, "{}", output.err);
        let error = output.err.split("length error").nth(1).unwrap().split("-> ").nth(1).unwrap();
        let error: f64 = error.split(' ').next().unwrap().parse().unwrap();
        // The letters are 182 mm long.
        assert!(error < 0.5 && !output.err.contains("dropped"), "{}", output.err);
    }
}

/// Points about 2 mm apart on a tube with a radius of 12 mm, without any noise.
#[test]
fn a_scan_with_few_points_is_said_to_be_sparse() {
    let desk = Desk::new();
    let mut state = 7u64;
    let mut along = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        40.0 * ((state >> 11) as f64 / (1u64 << 53) as f64) - 20.0
    };
    let mut text = String::new();
    for _ in 0..300 {
        let (x, y) = (along(), along());
        let across = x.hypot(y - 40.0) - 40.0;
        text += &format!("{x:.5} {y:.5} {:.5}\n", (144.0 - across * across).max(0.0).sqrt());
    }
    desk.write("tube.xyz", text);
    let lines = r#"<path d="M0 0H16M0 4H16M0 8H16M0 0V8M8 0V8M16 0V8" fill="none" stroke="black"/>"#;
    let size = r#"width="16mm" height="8mm" viewBox="0 0 16 8""#;
    desk.write("lines.svg", format!(r#"<svg xmlns="http://www.w3.org/2000/svg" {size}>{lines}</svg>"#));
    let output = desk.isomark(&["correct", "tube.xyz", "lines.svg", "--place", "0,0", "-o", "out.dxf"]);
    assert!(output.err.contains("points of the scan are sparse"), "{}", output.err);
}

/// In the empty mount point of a share, the settings of each SKU seem to be removed.
#[test]
#[cfg(target_os = "linux")]
fn a_station_whose_share_is_not_mounted() {
    let desk = Desk::new();
    desk.write("station.toml", "[station]\nname = \"a\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\ncache = \"cache\"\n[field]\nwidth_mm = 100\nheight_mm = 100\n");
    let seen_on_a_share = |purpose: &str| {
        let folder = std::fs::canonicalize(desk.root()).unwrap().join(purpose);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::create_dir_all(desk.path("state")).unwrap();
        let seen = serde_json::json!({ purpose: { "folder": folder, "mount": folder } });
        desk.write("state/shares.json", seen.to_string());
    };
    let commands: [(&str, &[&str]); 4] = [
        ("skus", &["correct", "--station", "station.toml", "--sku", "can", "abc.dxf", "--out", "out.dxf"]),
        ("skus", &["check", "station.toml"]),
        ("cache", &["correct", "--station", "station.toml", "--sku", "can", "abc.dxf", "--out", "out.dxf"]),
        ("cache", &["cache", "--station", "station.toml", "list"]),
    ];
    std::fs::copy(drawing("abc"), desk.path("abc.dxf")).unwrap();
    for (purpose, command) in commands {
        seen_on_a_share(purpose);
        let refused = desk.isomark(command);
        refused.refused(
            3,
            &[&format!("The {purpose} folder"), "not mounted", "what to do: Mount it", "shares.json"],
        );
    }
    // A command needs the folders that it uses, and no other.
    seen_on_a_share("skus");
    let listed = desk.isomark(&["cache", "--station", "station.toml", "list"]);
    assert_eq!(listed.code, 0, "{}", listed.err);
    seen_on_a_share("cache");
    std::fs::create_dir(desk.path("mine")).unwrap();
    let listed = desk.isomark(&["cache", "--station", "station.toml", "--cache", "mine", "list"]);
    assert_eq!(listed.code, 0, "{}", listed.err);
}

/// The points of one half of a plate are ten times as far apart as those of the other, so that they are taken for strays.
#[test]
fn a_drawing_over_dropped_points_of_a_scan_is_refused_with_their_number() {
    let desk = Desk::new();
    let half = |first: f64, columns: u32, rows: u32, apart: f64| -> String {
        let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        let line = |(column, row)| {
            format!("{:.2} {:.2} 0\n", first + f64::from(column) * apart, f64::from(row) * apart - 20.0)
        };
        places.map(line).collect()
    };
    desk.write("plate.xyz", half(0.0, 151, 201, 0.2) + &half(-30.0, 15, 21, 2.0));
    let options = "--part-unit mm --part-up z --facing +z --place 0,0 -o out.dxf";
    let abc = drawing("abc");
    let words = ["correct", "plate.xyz", &abc].into_iter().chain(options.split(' '));
    let output = desk.isomark(&words.collect::<Vec<_>>());
    output.refused(1, &["off-surface", "of 30666 points of the scan were dropped", "scan it again"]);
}
