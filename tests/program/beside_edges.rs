//! Marks close to a sharp edge of the part: the true surface is that of the face that they are on, given by a formula.

use std::f64::consts::TAU;
use std::fmt::Write as _;

use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::space::FlatPoint;

use crate::desk::{Desk, notices, number};

/// The radius of the rod and of the ball, mm.
const ROUND: f64 = 40.0;

/// An OBJ of these corners and polygons, which count from 0.
fn obj(corners: &[[f64; 3]], polygons: &[Vec<usize>]) -> String {
    let mut text = String::new();
    for [x, y, z] in corners {
        let _ = writeln!(text, "v {x:.6} {y:.6} {z:.6}");
    }
    for polygon in polygons {
        let corners: Vec<String> = polygon.iter().map(|corner| (corner + 1).to_string()).collect();
        let _ = writeln!(text, "f {}", corners.join(" "));
    }
    text
}

/// A body with this outline along y and z, counter-clockwise, from x = −`half` to `half`.
fn extruded(outline: &[[f64; 2]], half: f64) -> String {
    let count = outline.len();
    let corners: Vec<_> =
        [-half, half].into_iter().flat_map(|x| outline.iter().map(move |[y, z]| [x, *y, *z])).collect();
    let sides = (0..count).map(|at| {
        let next = (at + 1) % count;
        vec![at, next, count + next, count + at]
    });
    let ends = [(0..count).rev().collect(), (count..2 * count).collect()];
    obj(&corners, &sides.chain(ends).collect::<Vec<_>>())
}

/// Where the top of a roof ends, mm: between the nodes at which it is sampled.
const RIDGE: f64 = 0.13;

/// A block with a flat top at z = 30 up to the ridge, which falls by this angle beyond, deg.
fn roof(half: f64, falls: f64) -> String {
    let low = 30.0 - (half - RIDGE) * falls.to_radians().tan();
    extruded(&[[-half, low - 10.0], [half, low - 10.0], [half, low], [RIDGE, 30.0], [-half, 30.0]], half)
}

/// A rod about the x axis with a flat side whose normal leans by 40 degrees to +y; it begins at an edge 10 degrees from the top,
/// where the surface turns by 30 degrees.
fn rod_with_flat() -> String {
    let outline: Vec<_> = (0..=150)
        .map(|step| (70.0 + 2.0 * f64::from(step)).to_radians())
        .map(|angle| [ROUND * angle.sin(), ROUND * angle.cos()])
        .rev()
        .collect();
    extruded(&outline, 60.0)
}

/// Where the flat side of the rod begins.
fn edge_of_flat() -> f64 {
    ROUND * 10f64.to_radians().sin()
}

/// A ball whose top is cut off by a plane, at an edge 35 degrees from its axis.
fn cut_ball() -> String {
    let sectors = 180;
    let rings = (0..=60).map(|ring| (35.0 + 2.0 * f64::from(ring)).to_radians());
    let corners: Vec<_> = rings
        .flat_map(|polar| {
            (0..sectors).map(move |sector| {
                let around = TAU * f64::from(sector) / f64::from(sectors);
                [ROUND * polar.sin() * around.cos(), ROUND * polar.sin() * around.sin(), ROUND * polar.cos()]
            })
        })
        .collect();
    let count = sectors as usize;
    let sides = (0..60 * count).map(|at| {
        let next = at / count * count + (at + 1) % count;
        vec![at, at + count, next + count, next]
    });
    let ends = [(0..count).collect(), (60 * count..61 * count).rev().collect()];
    obj(&corners, &sides.chain(ends).collect::<Vec<_>>())
}

/// A closed rectangle with this lower left and upper right corner.
fn rectangle([[left, low], [right, high]]: [[f64; 2]; 2]) -> String {
    let mut text = String::from(
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n0\nLWPOLYLINE\n8\n0\n90\n4\n70\n1\n",
    );
    for [x, y] in [[left, low], [right, low], [right, high], [left, high]] {
        let _ = writeln!(text, "10\n{x}\n20\n{y}");
    }
    text + "0\nENDSEC\n0\nEOF\n"
}

/// Corrects a rectangle for a part and asserts that its length on the true surface is right, and that the report says so; `height`
/// is the surface of the face that the rectangle is on. Returns the reported error, mm.
fn assert_true(desk: &Desk, part: &str, corners: [[f64; 2]; 2], height: impl Fn(f64, f64) -> f64) -> f64 {
    desk.write("ink.dxf", rectangle(corners));
    let middle = [0, 1].map(|axis| f64::midpoint(corners[0][axis], corners[1][axis]));
    let options = format!("--part-unit mm --part-up z --facing +z --place {},{}", middle[0], middle[1]);
    let report = desk.correct(part, "ink.dxf", &options);
    let marked = read(&desk.read("out.dxf"), &PatternOptions::default()).unwrap().pattern;
    let on_part = |at: FlatPoint| nalgebra::Point3::new(at.x, at.y, height(at.x, at.y));
    let sides = marked.paths[0].shape.segments();
    let fine = sides.iter().flat_map(|side| (0..=50).map(|step| side.point(f64::from(step) / 50.0)));
    let points: Vec<_> = fine.map(on_part).collect();
    let length: f64 = points.windows(2).map(|ends| nalgebra::distance(&ends[0], &ends[1])).sum();
    let drawn = 2.0 * (0..2).map(|axis| corners[1][axis] - corners[0][axis]).sum::<f64>();
    let reported = number(&report, "/quality/after/length_error_mm");
    assert!(
        (length - drawn).abs() < 2e-3 && reported < 3e-3,
        "{corners:?}: {length} for {drawn} mm, {reported} reported, {:?}",
        notices(&report)
    );
    for wrong in ["surface-loose", "stretch-remains"] {
        assert!(!notices(&report).contains(&wrong), "{corners:?}: {wrong}");
    }
    reported
}

#[test]
fn a_flat_side_is_flat_up_to_a_sharp_edge() {
    let desk = Desk::new();
    for (half, falls) in
        [(25.0, 45.0), (25.0, 57.0), (25.0, 8.0), (100.0, 30.0), (100.0, 45.0), (200.0, 45.0)]
    {
        desk.write("roof.obj", roof(half, falls));
        for beside in [0.3, 0.6, 1.2, 2.5].map(|beside| beside * f64::max(half / 50.0, 1.0)) {
            let top = [[-6.0, RIDGE - beside - 4.0], [6.0, RIDGE - beside]];
            assert_true(&desk, "roof.obj", top, |_, _| 30.0);
            let side = [[-6.0, RIDGE + beside], [6.0, RIDGE + beside + 4.0]];
            assert_true(&desk, "roof.obj", side, |_, y| 30.0 - (y - RIDGE) * falls.to_radians().tan());
        }
    }
}

#[test]
fn beside_a_flat_a_rod_is_round_and_the_flat_is_flat() {
    let desk = Desk::new();
    desk.write("rod.obj", rod_with_flat());
    let edge = edge_of_flat();
    let tilt = 40f64.to_radians();
    for beside in [0.4, 0.8, 1.6] {
        let round = [[-6.0, edge - beside - 5.0], [6.0, edge - beside]];
        assert_true(&desk, "rod.obj", round, |_, y| (ROUND * ROUND - y * y).sqrt());
        let flat = [[-6.0, edge + beside], [6.0, edge + beside + 4.0]];
        let height = |y: f64| (ROUND * 30f64.to_radians().cos() - y * tilt.sin()) / tilt.cos();
        assert_true(&desk, "rod.obj", flat, |_, y| height(y));
    }
}

#[test]
fn a_flat_that_cuts_a_ball_is_flat_up_to_its_round_edge() {
    let desk = Desk::new();
    desk.write("ball.obj", cut_ball());
    let edge = ROUND * 35f64.to_radians().sin();
    for (angle, beside) in [(0.0, 0.4), (0.5, 0.4), (0.8, 0.4), (0.5, 0.8), (0.8, 1.6)] {
        let (sin, cos) = f64::sin_cos(angle);
        let corner = [(edge - beside) * cos, (edge - beside) * sin];
        // A thin rectangle whose right side is straight ends before the round edge with its upper corner.
        let top = [[corner[0] - 4.0, corner[1] - 0.1], [corner[0] - 0.02, corner[1]]];
        assert_true(&desk, "ball.obj", top, |_, _| ROUND * 35f64.to_radians().cos());
        let out = [(edge + beside) * cos, (edge + beside) * sin];
        let round = [out, [out[0] + 0.8, out[1] + 0.8]];
        assert_true(&desk, "ball.obj", round, |x, y| (ROUND * ROUND - x * x - y * y).sqrt());
    }
}

/// As drawn, the rectangle begins beside the edge; as marked, it is shorter and begins farther from it.
#[test]
fn the_map_shows_on_which_face_a_drawing_is() {
    let desk = Desk::new();
    desk.write("roof.obj", roof(50.0, 45.0));
    let side = [[-6.0, RIDGE + 0.05], [6.0, RIDGE + 4.0]];
    assert_true(&desk, "roof.obj", side, |_, y| 30.0 - (y - RIDGE));
}

/// As drawn, a third of the ink is beyond the edge, which the marked one is 0.9 mm away from. Nothing of the other face bends the surface
/// there.
#[test]
fn a_drawing_that_reaches_far_over_an_edge_as_drawn_is_true_where_it_is_marked() {
    let desk = Desk::new();
    for half in [50.0, 100.0] {
        desk.write("roof.obj", roof(half, 45.0));
        let side = [[-20.0, RIDGE - 5.0], [20.0, RIDGE + 35.0]];
        let reported = assert_true(&desk, "roof.obj", side, |_, y| 30.0 - (y - RIDGE));
        assert!(reported < 1e-4, "{half}: {reported}");
    }
}

/// On both faces, or so close to the edge that a narrow face may be there, the mark is not that of one face.
#[test]
fn ink_across_an_edge_or_on_it_is_reported_with_the_edge() {
    let desk = Desk::new();
    desk.write("roof.obj", roof(50.0, 45.0));
    for ink in [[[-6.0, -4.0], [6.0, 2.0]], [[-6.0, -4.0], [6.0, RIDGE - 0.05]]] {
        desk.write("ink.dxf", rectangle(ink));
        let middle = f64::midpoint(ink[0][1], ink[1][1]);
        let place = format!("0,{middle}");
        let options = ["--part-unit", "mm", "--part-up", "z", "--facing", "+z", "--place", &place];
        let inputs = ["correct", "roof.obj", "ink.dxf", "--out", "out.dxf"];
        let run = desk.isomark(&[&inputs[..], &options[..]].concat());
        run.refused(1, &["surface-not-met", "an edge or a ridge of 45 deg"]);
    }
}

/// A line across a groove with sides of 45 degrees is longer there by 41 %, wherever the nodes are.
#[test]
fn the_sides_of_a_narrow_groove_are_in_the_report() {
    let desk = Desk::new();
    desk.write("ink.dxf", rectangle([[-6.0, -4.0], [6.0, 4.0]]));
    for (width, half) in [(0.5, 25.0), (0.8, 25.0), (1.6, 60.0)] {
        let depth = width / 2.0;
        let outline = [
            [-half, 0.0],
            [half, 0.0],
            [half, 30.0],
            [RIDGE + depth, 30.0],
            [RIDGE, 30.0 - depth],
            [RIDGE - depth, 30.0],
            [-half, 30.0],
        ];
        desk.write("groove.obj", extruded(&outline, half));
        let options =
            "--part-unit mm --part-up z --facing +z --place 0,0 --set correction.max_residual_mm=10";
        let report = desk.correct("groove.obj", "ink.dxf", options);
        let stretch = number(&report, "/quality/after/largest_stretch");
        assert!(stretch > f64::sqrt(2.0) - 1.0, "{width}: {stretch}");
        assert!(notices(&report).contains(&"stretch-remains"), "{width}: {:?}", notices(&report));
    }
}
