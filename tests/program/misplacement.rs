//! What a misplaced part does to the mark, and the frame drawing that shows where the mark will be.

use isomark::formats::pattern::{PatternOptions, read};
use serde_json::Value;

use crate::desk::{Desk, assert_near, notices, number};

/// A line of 30 mm across the crest of a cylinder with a radius of 30 mm: half a radian to each side.
const ACROSS: &str =
    "0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n0\n10\n-15\n20\n0\n11\n15\n21\n0\n0\nENDSEC\n0\nEOF\n";

fn effect(report: &Value, movement: &str, value: &str) -> f64 {
    let all = report.pointer("/sensitivity/misplaced").and_then(Value::as_array).unwrap();
    let one = all.iter().find(|one| one["movement"] == movement).unwrap();
    one[value].as_f64().unwrap()
}

/// Corrects the line for the cylinder, with its axis along the field's y.
fn on_cylinder(desk: &Desk, options: &str) -> Value {
    desk.write("line.dxf", ACROSS);
    let mut arguments = vec!["correct", "--cylinder", "60,50", "line.dxf", "-o", "out.dxf", "--json"];
    arguments.extend(options.split_whitespace());
    let output = desk.isomark(&arguments);
    serde_json::from_str(&output.out).unwrap_or_else(|error| panic!("{error}: {}{}", output.out, output.err))
}

#[test]
fn a_shifted_cylinder_stretches_the_line_as_its_formula_does() {
    let desk = Desk::new();
    let report = on_cylinder(&desk, "");
    // Under parallel beams, a shift by δ moves the mark at the angle φ by δ / cos φ along the arc.
    let at_end = 1.0 / 0.5f64.cos();
    assert_near(&[effect(&report, "x", "moved_mm")], &[0.1 * at_end], 2e-4);
    assert_near(&[effect(&report, "x", "length_mm")], &[0.2 * (at_end - 1.0)], 3e-4);
    assert_near(&[effect(&report, "y", "moved_mm"), effect(&report, "y", "length_mm")], &[0.1, 0.0], 1e-9);
    assert_near(&[effect(&report, "z", "moved_mm"), effect(&report, "z", "length_mm")], &[0.0, 0.0], 1e-9);
    // A turn about the crest line by θ moves it by θ·R·(1 − cos φ) / cos φ, to the same side at both ends.
    let turn = 0.1f64.to_radians();
    let moved = turn * 30.0 * (1.0 - 0.5f64.cos()) * at_end;
    assert_near(&[effect(&report, "tilt-y", "moved_mm")], &[moved], 1e-4);
    assert_near(&[effect(&report, "tilt-y", "length_mm")], &[2.0 * moved], 2e-4);
    let sideways = turn * 30.0 * 0.5f64.sin();
    assert_near(&[effect(&report, "rotation", "moved_mm")], &[sideways], 1e-4);
    assert_eq!(report.pointer("/sensitivity/expected"), None);
}

#[test]
fn height_stretches_the_mark_through_a_perspective_lens() {
    let desk = Desk::new();
    desk.write("plate.obj", "v -40 -30 10\nv 40 -30 10\nv 40 30 10\nv -40 30 10\nf 1 2 3 4\n");
    desk.write("line.dxf", ACROSS.replace("-15", "-20").replace("\n15\n", "\n20\n"));
    let lens = "--set optics.kind=perspective --set optics.lens_distance_x_mm=300 --set optics.lens_distance_y_mm=300";
    let options = format!("{lens} --part-unit mm --part-up z");
    let report = desk.correct("plate.obj", "line.dxf", &options);
    // The beam to x leans by x / (L − z).
    let moved = 0.1 * 20.0 / 290.0;
    assert_near(&[effect(&report, "z", "moved_mm")], &[moved], 1e-6);
    assert_near(&[effect(&report, "z", "length_mm")], &[2.0 * moved], 1e-6);
    assert_near(&[effect(&report, "x", "moved_mm"), effect(&report, "x", "length_mm")], &[0.1, 0.0], 1e-9);
}

#[test]
fn the_error_to_expect_follows_from_the_uncertainty_of_the_fixture() {
    let desk = Desk::new();
    let report = on_cylinder(&desk, "--set fixture.uncertainty_mm=0.2");
    let at_end = 1.0 / 0.5f64.cos();
    let expected = |name: &str| number(&report, &format!("/sensitivity/expected/{name}"));
    assert_near(&[expected("length_mm")], &[0.4 * (at_end - 1.0)], 6e-4);
    // Sideways along both axes; height has no effect.
    assert_near(&[expected("moved_mm")], &[0.2 * at_end.hypot(1.0)], 5e-4);
    let said = desk.isomark(&[
        "correct",
        "--cylinder",
        "60,50",
        "line.dxf",
        "-o",
        "out.dxf",
        "--set",
        "fixture.uncertainty_mm=0.2",
    ]);
    assert!(
        said.err.contains(
            "a part 0.1 mm to the side: at most 0.028 mm more length error, and the mark moves by 0.11 mm;"
        ),
        "{}",
        said.err
    );
    assert!(said.err.contains("from the uncertainty of the fixture"), "{}", said.err);
}

/// The corners of the paths on a layer of a drawing in the field.
fn layer(desk: &Desk, file: &str, name: &str) -> Vec<Vec<[f64; 2]>> {
    let pattern = read(&desk.read(file), &PatternOptions::default()).unwrap().pattern;
    let on_layer = pattern.paths.iter().filter(|path| pattern.layers[path.layer].name == name);
    on_layer
        .map(|path| path.shape.segments().iter().map(|segment| segment.start().coords().into()).collect())
        .collect()
}

#[test]
fn the_frame_drawing_is_the_box_and_the_outline_on_the_part() {
    let desk = Desk::new();
    // A triangle 30 mm wide and 10 mm high.
    let line = |x: [f64; 2], y: [f64; 2]| {
        format!("0\nLINE\n8\n0\n10\n{}\n20\n{}\n11\n{}\n21\n{}\n", x[0], y[0], x[1], y[1])
    };
    let lines = line([-15.0, 15.0], [-5.0, -5.0])
        + &line([15.0, 0.0], [-5.0, 5.0])
        + &line([0.0, -15.0], [5.0, -5.0]);
    desk.write("triangle.dxf", format!("0\nSECTION\n2\nENTITIES\n{lines}0\nENDSEC\n0\nEOF\n"));
    let done = desk.isomark(&[
        "correct",
        "--cylinder",
        "60,50",
        "triangle.dxf",
        "-o",
        "out.dxf",
        "--frame-drawing",
        "frame.dxf",
    ]);
    assert_eq!(done.code, 0, "{}", done.err);
    let half = 30.0 * 0.5f64.sin();
    let [frame] = &layer(&desk, "frame.dxf", "isomark-box")[..] else { panic!("one box") };
    let corner =
        |x: f64, y: f64| frame.iter().map(|at| (at[0] - x).hypot(at[1] - y)).fold(f64::INFINITY, f64::min);
    for [x, y] in [[-half, -5.0], [half, -5.0], [half, 5.0], [-half, 5.0]] {
        assert!(corner(x, y) < 1e-4, "{frame:?}");
    }
    let [outline] = &layer(&desk, "frame.dxf", "isomark-outline")[..] else { panic!("one outline") };
    // The sides of the triangle bend as the drawing does: x = R·sin(s / R).
    for [x, y] in outline {
        let along = 30.0 * (x / 30.0).asin();
        let on_side = (y + 5.0).abs().min((along.abs() - 15.0 * (5.0 - y) / 10.0).abs());
        assert!(on_side < 0.02, "({x}, {y})");
    }
}

#[test]
fn a_frame_beside_the_part_is_left_out_there() {
    let desk = Desk::new();
    // A flat disc with a radius of 20 mm; the corners of the box of a cross are beside it.
    let rim: Vec<[f64; 2]> =
        (0..64).map(|step| (f64::from(step) * std::f64::consts::TAU / 64.0).sin_cos().into()).collect();
    let mut disc = "v 0 0 0\n".to_owned();
    for [sin, cos] in &rim {
        disc += &format!("v {} {} 0\n", 20.0 * cos, 20.0 * sin);
    }
    for step in 0..64 {
        disc += &format!("f 1 {} {}\n", step + 2, (step + 1) % 64 + 2);
    }
    desk.write("disc.obj", disc);
    let cross =
        "0\nLINE\n8\n0\n10\n-18\n20\n0\n11\n18\n21\n0\n0\nLINE\n8\n0\n10\n0\n20\n-18\n11\n0\n21\n18\n";
    desk.write("cross.dxf", format!("0\nSECTION\n2\nENTITIES\n{cross}0\nENDSEC\n0\nEOF\n"));
    let report =
        desk.correct("disc.obj", "cross.dxf", "--part-unit mm --part-up z --frame-drawing frame.dxf");
    assert!(notices(&report).iter().all(|code| *code != "marked-twice"));
    let stretches = layer(&desk, "frame.dxf", "isomark-box");
    assert_eq!(stretches.len(), 4, "{stretches:?}");
    for [x, y] in stretches.into_iter().flatten() {
        assert!(x.hypot(y) < 20.0 && (x.abs().max(y.abs()) - 18.0).abs() < 1e-6, "({x}, {y})");
    }
}
