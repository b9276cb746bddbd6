//! Marking frames: the node `isomark` of a glTF part, `frame` in the settings, `--frame`.

use isomark::formats::pattern::{PatternOptions, read};
use serde_json::{Value, json};

use crate::desk::{Desk, assert_near, notices, numbers};
use crate::glb::{Frame, Glb, around};
use crate::station::Station;

const RADIUS: f64 = 33.0;
const HEIGHT: f64 = 110.0;
/// Half the length of the marked line.
const HALF: f64 = 15.0;

/// A line along x whose middle is the drawing's origin.
pub fn line() -> String {
    let codes = ["0", "SECTION", "2", "HEADER", "9", "$INSUNITS", "70", "4", "0", "ENDSEC"];
    let entities =
        ["0", "SECTION", "2", "ENTITIES", "0", "LINE", "8", "MARK", "10", "-15", "20", "0", "11", "15", "21"];
    let end = ["0", "0", "ENDSEC", "0", "EOF", ""];
    codes.iter().chain(&entities).chain(&end).map(|code| code.to_string()).collect::<Vec<_>>().join("\n")
}

fn can() -> Glb {
    Glb::default().can(RADIUS, HEIGHT)
}

/// The codes of the notices about frames.
fn about_frames(report: &Value) -> Vec<&str> {
    notices(report).into_iter().filter(|code| code.starts_with("frame-")).collect()
}

/// The ends of the first path of a corrected drawing, mm.
pub fn ends(dxf: &[u8]) -> [[f64; 2]; 2] {
    let pattern = read(dxf, &PatternOptions::default()).unwrap().pattern;
    let segments = pattern.paths[0].shape.segments();
    let (first, last) = (segments.first().unwrap().point(0.0), segments.last().unwrap().point(1.0));
    [[first.x, first.y], [last.x, last.y]]
}

/// Where the ends of the line are in the view of a frame on the can: the line is a helix, so an arc of the can times a
/// length along its axis.
fn true_ends(frame: &Frame, angle: f64, height: f64, turn: f64) -> [[f64; 2]; 2] {
    [-HALF, HALF].map(|s| {
        let there = angle + s * turn.cos() / RADIUS;
        frame.view([RADIUS * there.sin(), -RADIUS * there.cos(), height + s * turn.sin()])
    })
}

#[track_caller]
fn assert_ends(found: [[f64; 2]; 2], expected: [[f64; 2]; 2]) {
    assert_near(found.as_flattened(), expected.as_flattened(), 0.02);
}

const PLACES: [(f64, f64, f64); 5] =
    [(0.0, 60.0, 0.0), (0.7, 40.0, 0.0), (2.5, 55.0, 0.5), (-1.2, 70.0, -1.4), (0.0, 50.0, 3.0)];

#[test]
fn a_node_in_the_part_gives_view_and_place() {
    for (angle, height, turn) in PLACES {
        let desk = Desk::new();
        let frame = Frame::on_can(RADIUS, angle, height, turn);
        desk.write("can.glb", can().frame(&frame).bytes());
        desk.write("line.dxf", line());
        let report = desk.correct("can.glb", "line.dxf", "");
        assert_ends(ends(&desk.read("out.dxf")), true_ends(&frame, angle, height, turn));
        let placement = "/placement/frame";
        assert_eq!(report.pointer(placement).unwrap()["source"], "part");
        for facts in [placement, "/part/facts/frame"] {
            assert_near(&numbers(&report, &format!("{facts}/origin_mm")), &frame.origin, 1e-4);
            assert_near(&numbers(&report, &format!("{facts}/z")), &frame.z, 1e-6);
            assert_near(&numbers(&report, &format!("{facts}/x")), &frame.x, 1e-6);
        }
        assert_near(&numbers(&report, "/placement/facing"), &frame.z, 1e-6);
        assert_near(&numbers(&report, "/placement/place_mm"), &frame.view(frame.origin), 1e-4);
        // The same frame on the command line, for a part without the node.
        desk.write("plain.glb", can().bytes());
        let given =
            ["correct", "plain.glb", "line.dxf", "--out", "given.dxf", "--json", "--frame", &frame.option()];
        let output = desk.isomark(&given);
        assert_eq!(output.code, 0, "{}", output.err);
        let report: Value = serde_json::from_str(&output.out).unwrap();
        assert_eq!(report["placement"]["frame"]["source"], "settings");
        assert_ends(ends(&desk.read("given.dxf")), true_ends(&frame, angle, height, turn));
    }
}

#[test]
fn inspect_shows_the_frame() {
    let desk = Desk::new();
    let frame = Frame::on_can(RADIUS, 0.0, 60.0, 0.0);
    desk.write("can.glb", can().frame(&frame).bytes());
    let text = desk.isomark(&["inspect", "can.glb"]).out;
    assert!(
        text.contains("frame      origin (0.00, -33.00, 60.00) mm, z to the laser (0.000, -1.000, 0.000)"),
        "{text}"
    );
    let facts: Value = serde_json::from_str(&desk.isomark(&["inspect", "can.glb", "--json"]).out).unwrap();
    assert_near(&numbers(&facts, "/frame/origin_mm"), &frame.origin, 1e-4);
    desk.write("plain.glb", can().bytes());
    assert!(!desk.isomark(&["inspect", "plain.glb"]).out.contains("frame"));
    // Both see the side that the frame names.
    desk.isomark(&["inspect", "can.glb", "--surface", "framed.step"]);
    desk.isomark(&["inspect", "plain.glb", "--facing=-y", "--surface", "front.step"]);
    let heights = |name: &str| desk.text(name).matches("CARTESIAN_POINT").count();
    assert_eq!(heights("framed.step"), heights("front.step"));
}

#[test]
fn the_place_is_measured_from_the_frame() {
    let desk = Desk::new();
    let (angle, height) = (0.4, 50.0);
    let frame = Frame::on_can(RADIUS, angle, height, 0.0);
    desk.write("can.glb", can().frame(&frame).bytes());
    desk.write("line.dxf", line());
    let report = desk.correct("can.glb", "line.dxf", "--place 0,12");
    let higher = Frame::on_can(RADIUS, angle, height + 12.0, 0.0);
    assert_ends(ends(&desk.read("out.dxf")), true_ends(&higher, angle, height + 12.0, 0.0));
    assert_near(&numbers(&report, "/placement/place_mm"), &[0.0, height + 12.0], 1e-4);
    // The anchor is what is placed: here the right end of the line.
    desk.correct("can.glb", "line.dxf", "--anchor 15,0");
    let left = Frame::on_can(RADIUS, angle, height, 0.0);
    let expected = [-2.0 * HALF, 0.0].map(|s| {
        let there = angle + s / RADIUS;
        left.view([RADIUS * there.sin(), -RADIUS * there.cos(), height])
    });
    assert_ends(ends(&desk.read("out.dxf")), expected);
}

#[test]
fn what_a_person_gives_for_the_part_replaces_the_node() {
    let desk = Desk::new();
    let node = Frame::on_can(RADIUS, 0.9, 40.0, 0.0);
    desk.write("can.glb", can().frame(&node).bytes());
    desk.write("line.dxf", line());
    let front = [-HALF, HALF].map(|s| [RADIUS * (s / RADIUS).sin(), 70.0]);
    let report = desk.correct("can.glb", "line.dxf", "--facing -y --place 0,70");
    assert_ends(ends(&desk.read("out.dxf")), front);
    assert_eq!(about_frames(&report), ["frame-chosen"]);
    assert!(report["placement"].get("frame").is_none());
    let chosen = report["notices"].as_array().unwrap().iter().find(|notice| notice["code"] == "frame-chosen");
    assert!(chosen.unwrap()["message"].as_str().unwrap().contains("not used"));
    // The kept surface of one view is not that of the other.
    let report = desk.correct("can.glb", "line.dxf", "");
    assert_ends(ends(&desk.read("out.dxf")), true_ends(&node, 0.9, 40.0, 0.0));
    assert_eq!(report["part"]["surface_from_cache"], false);
    for (options, x) in [("", 0.9), ("--facing -y --place 0,70", 0.0)] {
        let inputs = ["line.dxf", "--sku", "can"];
        let report = desk.correct_to("kept.dxf", &inputs, options);
        assert_eq!(report["part"]["surface_from_cache"], true, "{options}");
        let expected = if x == 0.0 { front } else { true_ends(&node, 0.9, 40.0, 0.0) };
        assert_ends(ends(&desk.read("kept.dxf")), expected);
    }
    let given = Frame::on_can(RADIUS, -0.5, 30.0, 0.0);
    let arguments =
        ["correct", "can.glb", "line.dxf", "--out", "given.dxf", "--json", "--frame", &given.option()];
    let output = desk.isomark(&arguments);
    let report: Value = serde_json::from_str(&output.out).unwrap();
    assert_eq!(about_frames(&report), ["frame-chosen"]);
    assert_ends(ends(&desk.read("given.dxf")), true_ends(&given, -0.5, 30.0, 0.0));
}

/// A roll alone turns the part about the laser's axis, whichever side faces the laser.
#[test]
fn a_roll_alone_does_not_silence_the_warning_about_the_side() {
    let desk = Desk::new();
    desk.write("line.dxf", line());
    let with_lid = || {
        can().grid("lid", None, [4, 48], |u, v| {
            let [x, y, z] = around(std::f64::consts::TAU * v).map(|share| share * RADIUS * (1.0 - u));
            ([x, y, z + HEIGHT], [0.0, 0.0, 1.0])
        })
    };
    desk.write("can.glb", with_lid().bytes());
    desk.write("framed.glb", with_lid().frame(&Frame::on_can(RADIUS, 0.9, 40.0, 0.0)).bytes());
    let warnings = |part: &str, options: &str| {
        let report = desk.correct(part, "line.dxf", &format!("--place 0,0 {options}"));
        let notices = report["notices"].as_array().unwrap().clone();
        let warnings = notices.into_iter().filter(|notice| notice["severity"] == "warning");
        warnings.map(|notice| notice["code"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    let has = |warnings: Vec<String>, code: &str| warnings.iter().any(|warning| warning == code);
    for roll in ["--roll 10", "--set part.roll_deg=0"] {
        assert!(has(warnings("can.glb", roll), "flat-side"), "{roll}");
        assert!(has(warnings("framed.glb", roll), "frame-chosen"), "{roll}");
        let named = format!("{roll} --facing +z");
        assert!(!has(warnings("can.glb", &named), "flat-side"), "{roll}");
        assert!(!has(warnings("framed.glb", &named), "frame-chosen"), "{roll}");
    }
}

#[test]
fn a_station_marks_where_the_part_s_frame_is() {
    let station = Station::new();
    let settings = station.desk.text("station.toml")
        + "[part]\nfacing = \"+z\"\nroll_deg = 0\n[placement]\nplace_mm = [0, 5]\nanchor = \"origin\"\n";
    station.desk.write("station.toml", settings);
    let (angle, height, turn) = (1.9, 45.0, 0.3);
    let frame = Frame::on_can(RADIUS, angle, height, turn);
    station.desk.write("hot/tin.glb", can().frame(&frame).bytes());
    station.desk.write("hot/tin.dxf", line());
    let once = station.once();
    assert_eq!(once.code, 0, "{}", once.err);
    assert_ends(ends(&station.desk.read("import/tin.dxf")), true_ends(&frame, angle, height, turn));
    // The frame is kept with the surface: another drawing needs no part.
    station.desk.write("hot/tin@again.dxf", line());
    assert_eq!(station.once().code, 0);
    assert_ends(ends(&station.desk.read("import/tin@again.dxf")), true_ends(&frame, angle, height, turn));
    let report: Value =
        serde_json::from_slice(&station.desk.read("reports/tin/tin@again.dxf.report.json")).unwrap();
    assert_eq!(report["part"]["surface_from_cache"], true);
    assert_eq!(report["placement"]["frame"]["source"], "part");
    // What the file of the SKU gives replaces it, and the earlier drawings are then outdated.
    station.desk.write("skus/tin.toml", "[part]\nfacing = \"-y\"\n[placement]\nplace_mm = [0, 40]\n");
    station.desk.write("hot/tin@front.dxf", line());
    assert_eq!(station.once().code, 0);
    let front = [-HALF, HALF].map(|s| [RADIUS * (s / RADIUS).sin(), 40.0]);
    assert_ends(ends(&station.desk.read("import/tin@front.dxf")), front);
    let status = station.desk.isomark(&["status", "station.toml", "--json"]);
    let status: Value = serde_json::from_str(&status.out).unwrap();
    assert_eq!(status["outdated"]["count"], 2, "{status:#}");
    // A frame in the file of the SKU does, too.
    let other = Frame::on_can(RADIUS, -0.8, 30.0, 0.0);
    let Frame { origin, z, x } = other;
    let text = format!("[part]\nframe = {{ origin = {origin:?}, z = {z:?}, x = {x:?} }}\n");
    station.desk.write("skus/tin.toml", text);
    station.desk.write("hot/tin@side.dxf", line());
    assert_eq!(station.once().code, 0);
    let report: Value =
        serde_json::from_slice(&station.desk.read("reports/tin/tin@side.dxf.report.json")).unwrap();
    assert_eq!(report["placement"]["frame"]["source"], "settings");
    // The station's place belongs to no frame of the file; with a frame of the settings it is measured from there.
    let higher = true_ends(&other, -0.8, 35.0, 0.0);
    assert_ends(ends(&station.desk.read("import/tin@side.dxf")), higher);
}

#[test]
fn frames_that_cannot_be_used_are_refused_with_a_remedy() {
    let desk = Desk::new();
    desk.write("line.dxf", line());
    desk.write("flat.glb", can().node(json!({"name": "isomark", "scale": [1.0, 0.0, 1.0]})).bytes());
    desk.isomark(&["correct", "flat.glb", "line.dxf", "--out", "out.dxf"])
        .refused(1, &["frame-without-axes", "node \"isomark\"", "scale of 1"]);
    desk.write("can.glb", can().bytes());
    for (frame, words) in [
        ("0,0 0,0,1 1,0,0", "does not give a marking frame"),
        ("0,0,0", "does not give a marking frame"),
        ("0,0,0 0,0,1 0,0,2", "two different directions"),
        ("0,0,0 0,0,0", "two different directions"),
        ("0,0,1e9 0,0,1", "cannot be 1000000000 mm"),
    ] {
        let arguments = ["correct", "can.glb", "line.dxf", "--out", "out.dxf", "--frame", frame];
        desk.isomark(&arguments).refused(2, &[words, "what to do"]);
    }
    let both =
        ["correct", "can.glb", "line.dxf", "--out", "out.dxf", "--frame", "0,0,0 0,0,1", "--facing", "-y"];
    desk.isomark(&both).refused(2, &["--facing"]);
    // A frame that looks into the part shows the laser the other side.
    let mut inward = Frame::on_can(RADIUS, 0.0, 60.0, 0.0);
    (inward.z, inward.x) = ([0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]);
    desk.write("inward.glb", can().frame(&inward).bytes());
    let inward_file = ["correct", "inward.glb", "line.dxf", "--out", "out.dxf"];
    desk.isomark(&inward_file).refused(1, &["frame-into-part", "65.99 mm of the part", "half a turn"]);
    let given = inward.option();
    // The surface on its other side may be kept.
    for kept in [false, true] {
        if kept {
            desk.correct("can.glb", "line.dxf", "--facing +y --place 0,60");
        }
        desk.isomark(&["correct", "can.glb", "line.dxf", "--out", "out.dxf", "--frame", &given])
            .refused(1, &["frame-into-part"]);
        let again = ["correct", "line.dxf", "--sku", "can", "--out", "out.dxf", "--frame", &given];
        if kept {
            desk.isomark(&again).refused(1, &["frame-into-part"]);
        }
    }
    // Two of them, and none: the root of a picture of a mark.
    let (first, second) = (Frame::on_can(RADIUS, 0.0, 60.0, 0.0), Frame::on_can(RADIUS, 1.0, 60.0, 0.0));
    desk.write("two.glb", can().frame(&first).frame(&second).bytes());
    let report = desk.correct("two.glb", "line.dxf", "");
    assert_eq!(about_frames(&report), ["frame-ambiguous"]);
    assert_near(&numbers(&report, "/placement/frame/z"), &first.z, 1e-6);
    desk.correct("two.glb", "line.dxf", "--report-html page.html");
    let page = desk.text("page.html");
    assert!(
        page.contains("Marking frame")
            && page.contains("from the part&#39;s file: origin (0.000, -33.000, 60.000)")
    );
    desk.correct("can.glb", "line.dxf", "--facing -y --place 0,60 --on-part picture.glb");
    assert!(!desk.isomark(&["inspect", "picture.glb"]).out.contains("frame"));
    // A negative scale turns some of the axes round.
    let mirrored = json!({"name": "isomark", "translation": [0.0, 60.0, 33.0], "scale": [-1.0, 1.0, 1.0]});
    desk.write("mirrored.glb", can().node(mirrored).bytes());
    desk.isomark(&["correct", "mirrored.glb", "line.dxf", "--out", "out.dxf"])
        .refused(1, &["frame-mirrored", "negative scale", "parents"]);
}

#[test]
fn a_frame_away_from_the_surface_is_used_and_mentioned() {
    let desk = Desk::new();
    desk.write("line.dxf", line());
    let on_surface = Frame::on_can(RADIUS, 0.4, 60.0, 0.2);
    // On the axis of the can, where modelling programs put an empty at first, and far in front of the part.
    for (distance, codes) in
        [(-RADIUS, vec!["frame-inside"]), (50.0, vec!["frame-above"]), (5.0, vec![]), (-0.5, vec![])]
    {
        let origin: Vec<f64> =
            (0..3).map(|axis| on_surface.origin[axis] + distance * on_surface.z[axis]).collect();
        let frame = Frame { origin: origin.try_into().unwrap(), ..on_surface };
        desk.write("can.glb", can().frame(&frame).bytes());
        let report = desk.correct("can.glb", "line.dxf", "");
        assert_eq!(about_frames(&report), codes, "{distance} mm");
        assert_ends(ends(&desk.read("out.dxf")), true_ends(&on_surface, 0.4, 60.0, 0.2));
    }
}

#[test]
fn names_that_differ_little_are_used_for_a_frame_and_mentioned_for_faces() {
    let desk = Desk::new();
    desk.write("line.dxf", line());
    let (frame, other) = (Frame::on_can(RADIUS, 0.4, 60.0, 0.2), Frame::on_can(RADIUS, -1.0, 60.0, 0.0));
    for name in ["isomark.001", "Isomark", " ISOMARK.012 "] {
        desk.write("can.glb", can().named_frame(name, &frame).bytes());
        let report = desk.correct("can.glb", "line.dxf", "");
        assert_near(&numbers(&report, "/placement/frame/z"), &frame.z, 1e-6);
        // A node with exactly the documented name is preferred.
        desk.write("both.glb", can().named_frame(name, &other).frame(&frame).bytes());
        let report = desk.correct("both.glb", "line.dxf", "");
        assert_near(&numbers(&report, "/placement/frame/z"), &frame.z, 1e-6);
        assert!(about_frames(&report).is_empty(), "{report:#}");
    }
    for name in ["isomark.01", "isomark 2", "isomark.x01", "isomarks"] {
        desk.write("can.glb", can().named_frame(name, &frame).bytes());
        let report = desk.correct("can.glb", "line.dxf", "--facing -y --place 0,60");
        assert!(report.pointer("/placement/frame").is_none_or(Value::is_null), "{name}");
    }
    let named =
        |name: &str| format!("usemtl {name}\nv -20 -20 0\nv 20 -20 0\nv 20 20 0\nv -20 20 0\nf 1 2 3 4\n");
    for (name, is_mentioned) in
        [("MARK", true), ("mark.001", true), ("Mark", true), ("marker", false), ("mark", false)]
    {
        desk.write("plate.obj", named(name));
        let report = desk.correct("plate.obj", "line.dxf", "");
        assert_eq!(notices(&report).contains(&"mark-misnamed"), is_mentioned, "{name}");
    }
}
