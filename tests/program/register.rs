//! Where the part stands: a simulated pilot beam finds points of a part, and the program finds the fixture.

use isomark::formats::pattern::{PatternOptions, read};
use nalgebra::{Point2, Point3, Rotation3, Vector2, Vector3};
use serde_json::Value;

use crate::desk::{Desk, assert_near, notices, number};

const DISTANCES: [f64; 2] = [300.0, 285.0];
/// The middle of a field of 200 × 160 mm with its zero at a corner.
const AXIS: [f64; 2] = [100.0, 80.0];
const POSE: [f64; 4] = [108.0, 71.0, 4.0, 23.0];

/// A box of 80 × 50 × 20 mm on z = 0, with its origin in the middle of its floor.
const CORNERS: [[f64; 3]; 4] =
    [[-40.0, -25.0, 20.0], [40.0, -25.0, 20.0], [40.0, 25.0, 20.0], [-40.0, 25.0, 0.0]];

fn box_obj() -> String {
    let mut text = String::new();
    for z in [0, 20] {
        text += &format!("v -40 -25 {z}\nv 40 -25 {z}\nv 40 25 {z}\nv -40 25 {z}\n");
    }
    text + "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"
}

/// The field coordinates that hit a point of the part, by similar triangles.
fn aim(at: [f64; 3]) -> Point2<f64> {
    let [x, y, z, turn] = POSE;
    let spin = Rotation3::from_axis_angle(&Vector3::z_axis(), turn.to_radians());
    let at = spin * Point3::from(at) + Vector3::new(x, y, z);
    let along =
        |axis: usize| AXIS[axis] + (at[axis] - AXIS[axis]) * DISTANCES[axis] / (DISTANCES[axis] - at.z);
    Point2::new(along(0), along(1))
}

fn desk() -> Desk {
    let desk = Desk::new();
    let [x, y] = DISTANCES;
    desk.write(
        "station.toml",
        format!(
            "# Line 1.\n[station]\nname = \"Laser 7\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 200\n\
             height_mm = 160\norigin = \"corner\"\n[optics]\nkind = \"perspective\"\nlens_distance_x_mm = {x}\n\
             lens_distance_y_mm = {y}\n[part]\nunit = \"mm\"\nup = \"z\"\n"
        ),
    );
    desk.write("box.obj", box_obj());
    desk
}

fn pair([x, y, z]: [f64; 3], noise: [f64; 2]) -> String {
    let hit = aim([x, y, z]) + Vector2::from(noise);
    format!("{x},{y},{z}={:.3},{:.3}", hit.x, hit.y)
}

/// Errors of the observations with a standard deviation of about 0.05 mm.
const NOISE: [[f64; 2]; 4] = [[0.05, -0.06], [-0.03, 0.04], [-0.05, -0.04], [0.06, 0.03]];

fn arguments<'a>(options: &[&'a str], pairs: &'a [String]) -> Vec<&'a str> {
    let pairs = pairs.iter().flat_map(|pair| ["--pair", pair.as_str()]);
    ["register", "station.toml"].into_iter().chain(options.iter().copied()).chain(pairs).collect()
}

fn result(desk: &Desk, options: &[&str], pairs: &[String]) -> Value {
    let output = desk.isomark(&arguments(&[options, &["--json"]].concat(), pairs));
    assert_eq!(output.code, 0, "{}", output.err);
    serde_json::from_str(&output.out).unwrap()
}

fn assert_pose(found: &Value, within: f64) {
    let value = |key: &str| number(found, &format!("/{key}/value"));
    assert_near(&[value("x_mm"), value("y_mm"), value("rotation_deg")], &[POSE[0], POSE[1], POSE[3]], within);
}

#[test]
fn four_noisy_pairs_give_the_pose_and_write_it_with_comments_kept() {
    let desk = desk();
    let pairs: Vec<String> = CORNERS.iter().zip(NOISE).map(|(corner, noise)| pair(*corner, noise)).collect();
    let found = result(&desk, &["--z", "4", "--write"], &pairs);
    assert_pose(&found, 0.1);
    assert!(
        number(&found, "/x_mm/deviation") < 0.1 && number(&found, "/rotation_deg/deviation") < 0.15,
        "{found:#}"
    );
    assert!(found["z_mm"].get("deviation").is_none() && notices(&found).is_empty());
    let station = desk.text("station.toml");
    assert!(station.starts_with("# Line 1.\n") && station.contains("[fixture]\nx_mm = 10"), "{station}");
    // Without its height, the lens shows it, less exactly.
    let free = result(&desk, &[], &pairs);
    assert_pose(&free, 0.1);
    let (z, deviation) = (number(&free, "/z_mm/value"), number(&free, "/z_mm/deviation"));
    assert!((z - POSE[2]).abs() < 3.0 * deviation && deviation < 1.0, "{free:#}");
    // One value that is 1.2 mm wrong leaves too large a scatter to pass without a word.
    let mut wrong = pairs.clone();
    wrong[1] = pair(CORNERS[1], [NOISE[1][0] + 1.2, NOISE[1][1]]);
    let found = result(&desk, &["--z", "4"], &wrong);
    assert!(notices(&found).contains(&"measurement-contradicts"), "{found:#}");
    // A part with the pose that was found is marked where it was drawn.
    let text = desk.isomark(&arguments(&["--z", "4"], &pairs)).out;
    assert!(text.contains("rotation          23.") && text.contains("pair 4"), "{text}");
}

#[test]
fn points_of_the_view_take_their_height_from_the_part_and_tables_are_read() {
    let desk = desk();
    let inside = [[-39.0, -24.0], [39.0, -24.0], [39.0, 24.0], [-30.0, 20.0]];
    let rows = inside.map(|[x, y]| {
        let hit = aim([x, y, 20.0]);
        format!("{x};{y};;{:.4};{:.4}\n", hit.x, hit.y).replace('.', ",")
    });
    desk.write("pairs.csv", format!("x_mm;y_mm;z_mm;field_x_mm;field_y_mm\n{}", rows.concat()));
    let found = result(&desk, &["--part", "box.obj", "--pairs", "pairs.csv", "--z", "4"], &[]);
    assert_pose(&found, 1e-3);
    // For a SKU, its own file is written.
    desk.write("skus/other.toml", "");
    result(&desk, &["--part", "box.obj", "--pairs", "pairs.csv", "--z", "4", "--sku", "box", "--write"], &[]);
    assert!(
        desk.text("skus/box.toml").starts_with("[fixture]\nx_mm = 108.0\n"),
        "{}",
        desk.text("skus/box.toml")
    );
    assert!(!desk.text("station.toml").contains("fixture"));
    let beside = ["--part", "box.obj", "--pair", "90,0=1,1"];
    desk.isomark(&arguments(&beside, &[])).refused(1, &["is beside the part"]);
}

#[test]
fn two_edges_give_the_pose() {
    let desk = desk();
    let edge = |[from, to]: [[f64; 3]; 2], shares: [f64; 2]| {
        let at = |share: f64| {
            let hit = aim([0, 1, 2].map(|axis| from[axis] + (to[axis] - from[axis]) * share));
            format!("{:.4},{:.4}", hit.x, hit.y)
        };
        let point = |at: [f64; 3]| at.map(|value| value.to_string()).join(",");
        format!("{} {}={} {}", point(from), point(to), at(shares[0]), at(shares[1]))
    };
    let [a, b, c, _] = CORNERS;
    let edges = [edge([a, b], [0.1, 0.9]), edge([b, c], [0.2, 0.7])];
    let near = ["--z", "4", "--edge", &edges[0], "--edge", &edges[1]];
    let found = result(&desk, &near, &[]);
    // Turned by 180 deg, the part would touch the same lines, but beyond its edges.
    assert_pose(&found, 2e-3);
    let parallel = ["--z", "4", "--edge", &edges[0], "--edge", &edges[0]];
    desk.isomark(&arguments(&parallel, &[]))
        .refused(1, &["nearly parallel", "number:     angle", "limit 10"]);
}

/// The place of the origin and the height are unknown; the settings have the height 0, and the box is at 4.
#[test]
fn a_height_that_is_neither_given_nor_shown_is_a_warning_and_is_not_written() {
    let desk = desk();
    let settings = desk.text("station.toml");
    let edge = |from: [f64; 3], to: [f64; 3]| {
        let at = |share: f64| {
            let hit = aim([0, 1, 2].map(|axis| from[axis] + (to[axis] - from[axis]) * share));
            format!("{:.3},{:.3}", hit.x, hit.y)
        };
        let point = |at: [f64; 3]| at.map(|value| value.to_string()).join(",");
        format!("{} {}={} {} {}", point(from), point(to), at(0.05), at(0.5), at(0.9))
    };
    let [a, b, c, _] = CORNERS;
    let edges = [edge(a, b), edge(b, c)];
    let two = ["--edge", &edges[0], "--edge", &edges[1]];
    // Three points 4 mm apart.
    let close: Vec<String> =
        [[-2.0, -2.0, 20.0], [2.0, -2.0, 20.0], [0.0, 2.0, 20.0]].map(|at| pair(at, [0.0; 2])).to_vec();
    for (options, pairs) in [(&two[..], &[][..]), (&[][..], &close[..])] {
        let found = result(&desk, options, pairs);
        assert_eq!(notices(&found), ["height-assumed"], "{found:#}");
        for (key, truth) in [("x_mm", POSE[0]), ("y_mm", POSE[1]), ("z_mm", POSE[2])] {
            let [value, deviation] =
                ["value", "deviation"].map(|part| number(&found, &format!("/{key}/{part}")));
            assert!((value - truth).abs() < 2.0 * deviation, "{key}: {found:#}");
        }
        let text = desk.isomark(&arguments(options, pairs)).out;
        assert!(text.contains(", assumed\n") && !text.contains("as given"), "{text}");
        let write = [options, &["--write"]].concat();
        desk.isomark(&arguments(&write, pairs))
            .refused(1, &["pose-not-determined", "height of the part must be known", "--z"]);
        assert_eq!(desk.text("station.toml"), settings);
        // The remedy works.
        let given = [options, &["--z", "4", "--json"]].concat();
        let output = desk.isomark(&arguments(&given, pairs));
        let found: Value = serde_json::from_str(&output.out).unwrap();
        assert!(notices(&found).is_empty(), "{found:#}");
        assert_pose(&found, 0.05);
    }
    // A third edge opposite to the first shows the height.
    let opposite = edge([40.0, 25.0, 20.0], [-40.0, 25.0, 20.0]);
    let three = [&two[..], &["--edge", &opposite]].concat();
    let found = result(&desk, &three, &[]);
    assert!(notices(&found).is_empty(), "{found:#}");
    assert_pose(&found, 0.1);
}

#[test]
fn pairs_that_do_not_fix_the_part_are_refused_with_number_and_remedy() {
    let desk = desk();
    let exact = |corner: [f64; 3]| pair(corner, [0.0; 2]);
    let line = [exact([-40.0, -25.0, 20.0]), exact([0.0, -25.0, 20.0]), exact([40.0, -25.0, 20.0])];
    desk.isomark(&arguments(&[], &line))
        .refused(1, &["within 0.00 mm of one line", "limit 4 mm", "triangle"]);
    desk.isomark(&arguments(&[], &line[..2])).refused(1, &["here are 2 points, and 3 are needed"]);
    let mut pairs = CORNERS.map(exact);
    let too_high = ["--z", "280"];
    desk.isomark(&arguments(&too_high, &pairs))
        .refused(1, &["art reaches up to 300.0 mm, and the lens is at 285.0 mm"]);
    let swapped = pairs.clone().map(|pair| {
        let (point, hit) = pair.split_once('=').unwrap();
        let (x, y) = hit.split_once(',').unwrap();
        format!("{point}={y},{x}")
    });
    desk.isomark(&arguments(&[], &swapped))
        .refused(1, &["mirror image", "x and y seem swapped", "measurements-swapped"]);
    // One mistyped value is named.
    let wrong = aim(CORNERS[2]) + Vector2::new(5.0, 0.0);
    pairs[2] = format!("40,25,20={:.3},{:.3}", wrong.x, wrong.y);
    let found = result(&desk, &["--z", "4"], &pairs);
    assert_eq!(notices(&found), ["measurement-contradicts"]);
    assert!(found["notices"][0]["message"].as_str().unwrap().starts_with("pair 3 with"), "{found:#}");
    assert_pose(&found, 0.05);
    desk.isomark(&["register", "station.toml"]).refused(2, &["No pairs are given"]);
    desk.isomark(&["register", "station.toml", "--pair", "1,2"]).refused(2, &["cannot be read as points"]);
    desk.isomark(&["register", "station.toml", "--pair", "1,2=3,4"])
        .refused(2, &["X,Y,Z in the part's own axes"]);
}

#[test]
fn the_outline_on_a_plate_is_that_of_the_part_through_the_lens() {
    let desk = desk();
    let [x, y, z, turn] = POSE;
    let station = desk.text("station.toml");
    desk.write(
        "station.toml",
        format!("{station}[fixture]\nx_mm = {x}\ny_mm = {y}\nz_mm = {z}\nrotation_deg = {turn}\n"),
    );
    let output = desk.isomark(&["register", "station.toml", "--part", "box.obj", "--jig", "jig.dxf"]);
    assert_eq!(output.code, 0, "{}", output.err);
    assert!(output.out.contains("4.00 mm above the calibrated plane"), "{}", output.out);
    let pattern = read(&desk.read("jig.dxf"), &PatternOptions::default().strictly(true)).unwrap().pattern;
    let [outline] = &pattern.paths[..] else { panic!("{pattern:?}") };
    let points: Vec<_> =
        outline.shape.segments().iter().map(|segment| Point2::from(segment.start().coords())).collect();
    for corner in [[-40.0, -25.0, 0.0], [40.0, -25.0, 0.0], [40.0, 25.0, 0.0], [-40.0, 25.0, 0.0]] {
        let expected = aim(corner);
        let miss = points.iter().map(|point| (point - expected).norm()).fold(f64::INFINITY, f64::min);
        assert!(miss < 1e-3, "{miss} mm at {corner:?}");
    }
    // A part beside the field has no outline in it.
    let beside =
        ["register", "station.toml", "--part", "box.obj", "--jig", "jig.dxf", "--set", "fixture.x_mm=190"];
    desk.isomark(&beside).refused(1, &["outline of the part is not inside the field", "overhang"]);
    desk.isomark(&["register", "station.toml", "--jig", "jig.dxf"]).refused(2, &["--part"]);
}

/// The same box on a wedge: its pose is not one of x, y, z and a rotation.
#[test]
fn a_tilted_part_is_named_as_the_likely_cause() {
    let desk = desk();
    let points =
        [CORNERS[0], CORNERS[1], CORNERS[2], [-40.0, 25.0, 20.0], [0.0, -25.0, 0.0], [40.0, 0.0, 2.0]];
    for degrees in [1.0f64, 2.0] {
        let tilt = Rotation3::from_axis_angle(&Vector3::x_axis(), degrees.to_radians());
        let pairs = points.map(|point| {
            let hit = aim((tilt * Point3::from(point)).into());
            format!("{},{},{}={:.3},{:.3}", point[0], point[1], point[2], hit.x, hit.y)
        });
        let found = result(&desk, &["--z", "4", "--reading", "0.03"], &pairs);
        assert_eq!(notices(&found), ["measurement-contradicts"], "{found:#}");
        let message = found["notices"][0]["message"].as_str().unwrap();
        assert!(message.contains(&format!("probably tilted by {degrees:.1} deg")), "{message}");
    }
    desk.write("pairs.csv", "X;Y;Z;U;V\n1;2;3;4;5\n");
    desk.isomark(&["register", "station.toml", "--pairs", "pairs.csv"]).refused(
        1,
        &["Name the columns x_mm, y_mm, z_mm, field_x_mm and field_y_mm", "The table has x, y, z, u, v"],
    );
}
