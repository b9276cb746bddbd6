//! Checks along the beam and of the lines that it marks: shadow, spot, lines that are marked twice.

use crate::desk::{Desk, notices, number};

fn drawing(lines: &[[f64; 4]]) -> String {
    let line =
        |[x1, y1, x2, y2]: &[f64; 4]| format!("0\nLINE\n8\n0\n10\n{x1}\n20\n{y1}\n11\n{x2}\n21\n{y2}\n");
    let lines: String = lines.iter().map(line).collect();
    format!("0\nSECTION\n2\nENTITIES\n{lines}0\nENDSEC\n0\nEOF\n")
}

/// A plate of 160 x 60 mm with a bar across it, 20 mm high, from x = 10 to x = 40.
fn plate_with_bar() -> String {
    let mut text = String::new();
    let mut vertices = 0;
    let mut quad = |corners: [[f64; 3]; 4]| {
        for [x, y, z] in corners {
            text += &format!("v {x} {y} {z}\n");
        }
        text += &format!("f {} {} {} {}\n", vertices + 1, vertices + 2, vertices + 3, vertices + 4);
        vertices += 4;
    };
    let mut floor = |from: f64, to: f64, z: f64| {
        quad([[from, -30.0, z], [to, -30.0, z], [to, 30.0, z], [from, 30.0, z]]);
    };
    floor(-80.0, 10.0, 0.0);
    floor(10.0, 40.0, 20.0);
    floor(40.0, 80.0, 0.0);
    quad([[10.0, -30.0, 0.0], [10.0, -30.0, 20.0], [10.0, 30.0, 20.0], [10.0, 30.0, 0.0]]);
    quad([[40.0, -30.0, 20.0], [40.0, -30.0, 0.0], [40.0, 30.0, 0.0], [40.0, 30.0, 20.0]]);
    text
}

const LENS: &str = "--part-unit mm --part-up z --set optics.kind=perspective --set optics.lens_distance_x_mm=100 \
                    --set optics.lens_distance_y_mm=100";

#[test]
fn ink_behind_a_step_is_refused_through_a_lens_and_not_under_parallel_beams() {
    let desk = Desk::new();
    desk.write("bar.obj", plate_with_bar());
    // The beam to x = 48 mm from a lens 100 mm above x = 0 passes x = 40 mm at 16.7 mm, below the top of the bar.
    desk.write("behind.dxf", drawing(&[[48.0, -3.0, 48.0, 3.0], [60.0, -3.0, 60.0, 3.0]]));
    let correct = |options: &str| {
        let mut arguments = vec!["correct", "bar.obj", "behind.dxf", "-o", "out.dxf", "--json"];
        arguments.extend(options.split_whitespace());
        desk.isomark(&arguments)
    };
    let hidden = correct(LENS);
    hidden.refused(1, &["in the shadow of another part of the body", "shadow_mm"]);
    let reason: serde_json::Value = serde_json::from_str(&hidden.out).unwrap();
    assert_eq!(reason["code"], "ink-hidden");
    let rises = number(&reason, "/number/value");
    assert!((2.0..=3.4).contains(&rises), "the bar rises 3.33 mm above the beam, not {rises}");
    assert_eq!(correct("--part-unit mm --part-up z").code, 0);
    assert_eq!(correct(&format!("{LENS} --set optics.axis_mm=60,0")).code, 0);
    assert_eq!(correct(&format!("{LENS} --set optics.shadow_mm=5")).code, 0);
}

#[test]
fn lines_on_lines_and_lines_closer_than_the_spot_are_reported() {
    let desk = Desk::new();
    desk.write("plate.obj", "v -40 -30 0\nv 40 -30 0\nv 40 30 0\nv -40 30 0\nf 1 2 3 4\n");
    let codes = |name: &str, lines: &[[f64; 4]], options: &str| {
        desk.write(name, drawing(lines));
        let report = desk.correct("plate.obj", name, &format!("--part-unit mm --part-up z {options}"));
        notices(&report).iter().map(|code| code.to_string()).collect::<Vec<_>>()
    };
    let side = [0.0, 0.0, 10.0, 0.0];
    let has = |codes: &[String], code: &str| codes.iter().any(|found| found == code);
    assert!(has(&codes("twice.dxf", &[side, [12.0, 0.0, 3.0, 0.0]], ""), "marked-twice"));
    assert!(!has(
        &codes("twice.dxf", &[side, [12.0, 0.0, 3.0, 0.0]], "--set pattern.overlap_mm=8"),
        "marked-twice"
    ));
    assert!(!has(&codes("corner.dxf", &[side, [10.0, 0.0, 10.0, 5.0]], ""), "marked-twice"));
    let near = [side, [0.0, 0.04, 10.0, 0.04]];
    assert!(!has(&codes("near.dxf", &near, ""), "finer-than-spot"));
    assert!(has(&codes("near.dxf", &near, "--set optics.spot_mm=0.05"), "finer-than-spot"));
    assert!(!has(&codes("near.dxf", &near, "--set optics.spot_mm=0.03"), "finer-than-spot"));
}
