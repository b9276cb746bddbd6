//! Faces named `mark` bound where ink may be.

use std::fmt::Write;

use serde_json::Value;

use crate::desk::{Desk, assert_near, notices, number, numbers};
use crate::frame::line;
use crate::glb::Glb;

const RADIUS: f64 = 33.0;
/// Heights of the label on the can, and half its angle.
const LABEL: [f64; 2] = [40.0, 70.0];
const HALF_ANGLE: f64 = 0.6;

/// A can of which a label at the front is named `mark`: by its material, or by its node.
fn labelled_can(by_material: bool) -> Vec<u8> {
    let turn = std::f64::consts::TAU;
    let (name, material) = if by_material { ("label", Some("mark")) } else { ("mark", None) };
    let can = Glb::default()
        .can_from_to("bottom", Some("steel"), RADIUS, [0.0, LABEL[0]], [0.0, turn])
        .can_from_to(name, material, RADIUS, LABEL, [-HALF_ANGLE, HALF_ANGLE])
        .can_from_to("back", None, RADIUS, LABEL, [HALF_ANGLE, turn - HALF_ANGLE])
        .can_from_to("top", None, RADIUS, [LABEL[1], 110.0], [0.0, turn]);
    can.bytes()
}

fn run(desk: &Desk, part: &str, options: &str) -> (i32, Value) {
    let arguments = ["correct", part, "line.dxf", "--out", "out.dxf", "--json", "--facing=-y"];
    let arguments: Vec<&str> = arguments.into_iter().chain(options.split_whitespace()).collect();
    let output = desk.isomark(&arguments);
    (output.code, serde_json::from_str(&output.out).unwrap())
}

/// The ends of the line of 30 mm are at ±15 mm along the arc from its place.
#[test]
fn ink_outside_the_faces_is_rejected_with_its_place() {
    let desk = Desk::new();
    desk.write("line.dxf", line());
    // The border is at this arc length from the front.
    let border = RADIUS * HALF_ANGLE;
    let place = |arc: f64| RADIUS * (arc / RADIUS).sin();
    for (name, by_material) in [("material.glb", true), ("node.glb", false)] {
        desk.write(name, labelled_can(by_material));
        for (arc, height) in [(0.0, 55.0), (border - 15.0 - 0.2, 55.0), (0.0, 40.2), (0.0, 69.8)] {
            let (code, report) = run(&desk, name, &format!("--place {},{height}", place(arc)));
            assert_eq!(code, 0, "{arc} {height}: {report:#}");
            assert!(!notices(&report).contains(&"outside-mark"));
        }
        for (arc, height, at, depth) in [
            (border - 15.0 + 0.3, 55.0, [place(border + 0.3), 55.0], 0.3 * HALF_ANGLE.cos()),
            (0.0, 39.8, [0.0, 39.8], 0.2),
            (0.0, 70.3, [0.0, 70.3], 0.3),
        ] {
            let placing = format!("--place {},{height}", place(arc));
            let (code, reason) = run(&desk, name, &placing);
            assert_eq!((code, &reason["code"]), (1, &"outside-mark".into()), "{arc} {height}: {reason:#}");
            let found = numbers(&reason, "/place/coordinate");
            assert_near(&found[1..], &at[1..], 0.01);
            let is_at_end = at[0] != 0.0;
            assert!(!is_at_end || (found[0] - at[0]).abs() < 0.05, "{found:?}");
            let words = reason["what"].as_str().unwrap();
            let by: f64 = words.split("up to ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
            assert_near(&[by], &[depth], 0.06);
            assert!(reason["remedy"].as_str().unwrap().contains("outside_mark"));
            let (code, report) = run(&desk, name, &format!("{placing} --set placement.outside_mark=warn"));
            assert_eq!(code, 0);
            assert!(notices(&report).contains(&"outside-mark"));
        }
    }
    // Kept with the surface, for drawings without the part.
    let sku = ["correct", "line.dxf", "--sku", "node", "--facing=-y", "--place", "0,30", "--out", "out.dxf"];
    desk.isomark(&sku).refused(1, &["100.0 % of the ink is outside", "by more than"]);
}

#[test]
fn groups_and_materials_of_obj_bound_ink_too() {
    let desk = Desk::new();
    desk.write("line.dxf", line());
    // A plate of 100 x 60 mm in squares; those with |x| < 20 and |y| < 10 are named.
    for (begin, end) in [("g mark", "g rest"), ("usemtl mark", "usemtl steel"), ("o mark", "o MARK")] {
        let mut text = String::from("# mm\n");
        for row in 0..=12 {
            for column in 0..=20 {
                let (x, y) = (f64::from(column) * 5.0 - 50.0, f64::from(row) * 5.0 - 30.0);
                let _ = writeln!(text, "v {x} {y} {}", -x * x / 400.0);
            }
        }
        for row in 0..12 {
            for column in 0..20 {
                let first = row * 21 + column + 1;
                let is_mark = (6..14).contains(&column) && (4..8).contains(&row);
                let name = if is_mark { begin } else { end };
                let _ = writeln!(text, "{name}\nf {first} {} {} {}", first + 1, first + 22, first + 21);
            }
        }
        desk.write("plate.obj", text);
        let options = "--facing +z --part-unit mm --part-up z";
        let correct = |place: &str| {
            let arguments = ["correct", "plate.obj", "line.dxf", "--out", "out.dxf", "--json"];
            let options = format!("{options} --place {place}");
            let output = desk.isomark(&arguments.into_iter().chain(options.split(' ')).collect::<Vec<_>>());
            (output.code, serde_json::from_str::<Value>(&output.out).unwrap()["code"].clone())
        };
        assert_eq!(correct("0,0").0, 0, "{begin}");
        assert_eq!(correct("0,9.8").0, 0, "{begin}");
        assert_eq!(correct("0,10.2"), (1, "outside-mark".into()), "{begin}");
        assert_eq!(correct("8,0"), (1, "outside-mark".into()), "{begin}");
        let arguments = ["inspect", "plate.obj", "--part-unit", "mm", "--part-up", "z", "--json"];
        let facts: Value = serde_json::from_str(&desk.isomark(&arguments).out).unwrap();
        assert!((number(&facts, "/mark_area_mm2") - 800.0).abs() < 10.0);
    }
    assert!(desk.isomark(&["inspect", "plate.obj"]).out.contains("faces named `mark`"));
}
