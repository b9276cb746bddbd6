//! Marks beside drilled holes, bosses and pockets: the true surface is that of the part without them, given by a formula.

use std::f64::consts::TAU;
use std::fmt::Write as _;

use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::space::FlatPoint;

use crate::desk::{Desk, assert_near, number, part};

/// The rod of `drilled`, mm: its axis is the x axis.
const RADIUS: f64 = 25.0;

/// An LWPOLYLINE through these points.
fn polyline(points: &[[f64; 2]]) -> String {
    let mut text = format!("0\nLWPOLYLINE\n8\n0\n90\n{}\n70\n0\n", points.len());
    for [x, y] in points {
        let _ = writeln!(text, "10\n{x}\n20\n{y}");
    }
    text
}

fn dxf(records: &str) -> String {
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n{records}0\nENDSEC\n0\nEOF\n"
    )
}

/// The vertices of each path of `out.dxf`, unrolled from the rod.
fn unrolled(desk: &Desk) -> Vec<Vec<[f64; 2]>> {
    let marked = read(&desk.read("out.dxf"), &PatternOptions::default()).unwrap().pattern;
    let place = |at: FlatPoint| [at.x, RADIUS * (at.y / RADIUS).asin()];
    marked.paths.iter().map(|path| path.shape.flattened(1.0).into_iter().map(place).collect()).collect()
}

fn length(points: &[[f64; 2]]) -> f64 {
    points.windows(2).map(|ends| (ends[0][0] - ends[1][0]).hypot(ends[0][1] - ends[1][1])).sum()
}

/// Two lines round the rod, 10 mm on either side of the hole.
fn lines() -> String {
    dxf(&[30.0, 50.0].map(|x| polyline(&[[x, -12.0], [x, 12.0]])).concat())
}

/// A ring of 8 mm round the hole.
fn ring() -> String {
    dxf("0\nCIRCLE\n8\n0\n10\n40\n20\n0\n40\n8\n")
}

fn assert_lines_are_true(desk: &Desk, within: f64) {
    let marked = unrolled(desk);
    assert_eq!(marked.len(), 2);
    for (line, x) in marked.iter().zip([30.0, 50.0]) {
        assert_near(&[line[0], line[line.len() - 1]].concat(), &[x, -12.0, x, 12.0], within);
        assert!((length(line) - 24.0).abs() < within, "{line:?}");
    }
}

fn assert_ring_is_true(desk: &Desk, within: f64) {
    let marked = unrolled(desk);
    let mut ring = marked[0].clone();
    ring.push(ring[0]);
    // The vertices are outside of the circle by up to 0.75 times the chord tolerance, so that the chords are as long.
    let off = ring.iter().map(|[x, y]| (x - 40.0).hypot(*y) - 8.0);
    assert!(
        off.clone().all(|off| (-within..0.0075 + within).contains(&off)),
        "{:?}",
        off.collect::<Vec<_>>()
    );
    assert!((length(&ring) - 8.0 * TAU).abs() < 2.0 * within, "{}", length(&ring));
}

#[test]
fn beside_a_hole_or_a_boss_a_rod_is_unrolled_as_without_it() {
    let desk = Desk::new();
    desk.write("lines.dxf", lines());
    desk.write("ring.dxf", ring());
    for name in ["hole", "tube", "boss"] {
        let rod = part(&format!("drilled/{name}.step"));
        for options in ["", "--method cylinder"] {
            let report = desk.correct(&rod, "lines.dxf", options);
            assert_eq!(report["map"]["method"], "cylinder", "{name}");
            assert_near(&[number(&report, "/map/radius_mm")], &[RADIUS], 1e-6);
            assert_lines_are_true(&desk, 1e-3);
            let report = desk.correct(&rod, "ring.dxf", options);
            assert_eq!(report["map"]["method"], "cylinder", "{name}");
            assert_ring_is_true(&desk, 1e-3);
        }
        desk.correct(&rod, "ring.dxf", "--method isometric");
        assert_ring_is_true(&desk, 2e-3);
    }
}

#[test]
fn ink_across_a_hole_or_close_to_it_is_refused_with_its_place() {
    let desk = Desk::new();
    for (line, at) in [([[30.0, 0.5], [50.0, 0.5]], 38.0), ([[41.9, -9.0], [41.9, 9.0]], 41.9)] {
        desk.write("line.dxf", dxf(&polyline(&line)));
        let run = desk.isomark(&["correct", &part("drilled/hole.step"), "line.dxf", "--out", "out.dxf"]);
        run.refused(1, &["off-surface", "a hole"]);
        let place = run.err.split("at (").nth(1).unwrap();
        let x: f64 = place.split(',').next().unwrap().parse().unwrap();
        assert!((x - at).abs() < 1.5, "{}", run.err);
    }
    // On the floor of the hole, which is flat.
    desk.write("dot.dxf", dxf(&polyline(&[[39.5, 0.0], [40.5, 0.0]])));
    let report = desk.correct(&part("drilled/hole.step"), "dot.dxf", "");
    assert!(number(&report, "/quality/after/length_error_mm") < 1e-4);
}

#[test]
fn a_drilled_ball_keeps_the_lengths_that_it_has_without_the_hole() {
    let desk = Desk::new();
    let cross = [[[-20.0, 12.0], [-20.0, -12.0]], [[20.0, 12.0], [20.0, -12.0]]].map(|line| polyline(&line));
    desk.write("lines.dxf", dxf(&cross.concat()));
    desk.correct(&part("drilled/ball.step"), "lines.dxf", "--place 0,0");
    let marked = read(&desk.read("out.dxf"), &PatternOptions::default()).unwrap().pattern;
    for path in &marked.paths {
        let at =
            |at: &FlatPoint| nalgebra::Point3::new(at.x, at.y, (1600.0 - at.x * at.x - at.y * at.y).sqrt());
        let fine = path
            .shape
            .segments()
            .iter()
            .flat_map(|side| (0..=50).map(move |step| side.point(f64::from(step) / 50.0)));
        let points: Vec<_> = fine.map(|flat| at(&flat)).collect();
        let length: f64 = points.windows(2).map(|ends| nalgebra::distance(&ends[0], &ends[1])).sum();
        assert!((length - 24.0).abs() < 2e-3, "{length} mm");
    }
}

/// A rod in facets of 1 degree and 1 mm, with a round post through its side as a body of its own.
fn rod_with_post() -> String {
    let mut obj = String::from("o rod\n");
    for column in 0..=80 {
        for step in -80..=80 {
            let (sin, cos) = f64::from(step).to_radians().sin_cos();
            let _ = writeln!(obj, "v {column} {} {}", RADIUS * sin, RADIUS * cos);
        }
    }
    for column in 0..80 {
        for step in 0..160 {
            let corner = column * 161 + step + 1;
            let _ = writeln!(obj, "f {corner} {} {} {}", corner + 161, corner + 162, corner + 1);
        }
    }
    let first = 81 * 161 + 1;
    obj += "o post\n";
    for height in [15.0, 30.0] {
        for step in 0..60 {
            let (sin, cos) = (f64::from(step) * 6.0).to_radians().sin_cos();
            let _ = writeln!(obj, "v {} {} {height}", 40.0 + 3.0 * cos, 3.0 * sin);
        }
    }
    for step in 0..60 {
        let next = (step + 1) % 60;
        let [low, low_next, high, high_next] = [step, next, step + 60, next + 60].map(|at| at + first);
        let _ = writeln!(obj, "f {low} {low_next} {high_next} {high}");
    }
    let top: Vec<String> = (0..60).map(|step| (first + 60 + step).to_string()).collect();
    let _ = writeln!(obj, "f {}", top.join(" "));
    obj
}

#[test]
fn beside_a_post_a_mesh_of_a_rod_is_unrolled_as_without_it() {
    let desk = Desk::new();
    desk.write("rod.obj", rod_with_post());
    desk.write("lines.dxf", lines());
    desk.write("ring.dxf", ring());
    let options = "--part-unit mm --part-up z --facing +z";
    desk.correct("rod.obj", "lines.dxf", options);
    assert_lines_are_true(&desk, 0.01);
    desk.correct("rod.obj", "ring.dxf", options);
    assert_ring_is_true(&desk, 0.01);
}

/// A plate 3 mm thick, in mm, with a rectangle of 40 by 12 mm round (`shift`, 0) on its top that is higher or lower.
fn stepped_plate([length, width]: [f64; 2], height: f64, shift: f64) -> String {
    let rectangle = |[x, y]: [f64; 2], from: f64, z: f64| {
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
            .map(|[a, b]| [from + a * x / 2.0, b * y / 2.0, z])
    };
    let (outer, inner) = ([length, width], [40.0, 12.0]);
    let rings = [
        rectangle(outer, 0.0, 0.0),
        rectangle(outer, 0.0, 3.0),
        rectangle(inner, shift, 3.0),
        rectangle(inner, shift, 3.0 + height),
    ];
    let mut obj = String::from("o plate\n");
    for [x, y, z] in rings.as_flattened() {
        let _ = writeln!(obj, "v {x} {y} {z}");
    }
    let quad = |corners: [u32; 4]| {
        let [a, b, c, d] = corners;
        format!("f {a} {b} {c}\nf {a} {c} {d}\n")
    };
    obj += &quad([4, 3, 2, 1]);
    obj += &quad([13, 14, 15, 16]);
    for ring in 0..3 {
        for side in 0..4 {
            let [here, next] = [side, (side + 1) % 4].map(|corner| 4 * ring + corner + 1);
            obj += &quad([here, next, next + 4, here + 4]);
        }
    }
    obj
}

/// A flat face is marked as drawn, however near the walls are.
#[test]
fn on_a_boss_and_in_a_recess_a_flat_face_is_true_up_to_its_walls() {
    let desk = Desk::new();
    for (size, heights) in [([80.0, 30.0], [0.3, 1.0, 2.0, -0.8]), ([300.0, 100.0], [0.5, 1.0, 5.0, -1.5])] {
        for (height, shift) in heights.into_iter().zip([0.0, 0.13, 0.29, 0.07]) {
            desk.write("plate.obj", stepped_plate(size, height, shift));
            for gap in [0.4, 1.0, 2.0] {
                let [x, y] = [20.0 - gap, 6.0 - gap];
                let ladder: Vec<String> = (0..10)
                    .map(|rung| shift - x + 2.0 * x * f64::from(rung) / 9.0)
                    .map(|at| polyline(&[[at, -y], [at, y]]))
                    .chain([-y, y].map(|y| polyline(&[[shift - x, y], [shift + x, y]])))
                    .collect();
                desk.write("ladder.dxf", dxf(&ladder.concat()));
                let report =
                    desk.correct("plate.obj", "ladder.dxf", "--part-unit mm --part-up z --align view");
                let error = number(&report, "/quality/after/length_error_mm");
                assert!(error < 0.002, "{size:?} {height} {shift} {gap}: {error} mm");
                let marked = read(&desk.read("out.dxf"), &PatternOptions::default()).unwrap().pattern;
                for point in marked.paths.iter().flat_map(|path| path.shape.flattened(1.0)) {
                    let off = [(point.x - shift).abs() - x, point.y.abs() - y];
                    assert!(off.iter().all(|off| *off < 0.002), "{size:?} {height} {gap}: {point:?}");
                }
            }
        }
    }
}
