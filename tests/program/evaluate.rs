//! `isomark evaluate`, and primitives in place of parts.

use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::pattern::{Pattern, Segment};
use serde_json::Value;

use crate::desk::{Desk, Output, assert_near, drawing, notices, number, numbers, part};

fn evaluated(desk: &Desk, inputs: &[&str], options: &str) -> Value {
    let arguments = [&["evaluate", "--json"], inputs].concat();
    let output = desk.isomark(&arguments.into_iter().chain(options.split_whitespace()).collect::<Vec<_>>());
    assert_eq!(output.code, 0, "{}", output.err);
    let evaluation: Value = serde_json::from_str(&output.out).unwrap();
    assert_eq!(evaluation["schema"], "isomark.evaluate/1");
    evaluation
}

/// The row of a method and its variant.
#[track_caller]
fn row<'a>(evaluation: &'a Value, method: &str, variant: &str) -> &'a Value {
    let rows = evaluation["rows"].as_array().unwrap();
    let found = rows.iter().find(|row| row["method"] == method && row["variant"] == variant);
    found.unwrap_or_else(|| panic!("no {method}, {variant} in {evaluation:#}"))
}

/// Points of a cylinder with a radius of 33 mm along y, at random, with noise across it. The lengths of the marked lines are those of
/// arcs and straight lines.
#[test]
fn a_noisy_scan_of_a_cylinder_is_unrolled_exactly() {
    let desk = Desk::new();
    let mut state = 11u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut text = String::new();
    for _ in 0..20_000 {
        let (angle, along) = (2.6 * random() - 1.3, 80.0 * random() - 40.0);
        // A sum of twelve has the variance 1.
        let radius = 33.0 + 0.05 * ((0..12).map(|_| random()).sum::<f64>() - 6.0);
        text += &format!("{:.4} {along:.4} {:.4}\n", radius * angle.sin(), radius * angle.cos() - 33.0);
    }
    desk.write("can.xyz", text);
    let abc = drawing("abc");
    let options = "--part-unit mm --part-up z --facing +z --place 0,0 --vertices keep";
    let report = desk.correct("can.xyz", &abc, options);
    assert_eq!(report["map"]["method"], "cylinder", "{report:#}");
    let notices = report["notices"].as_array().unwrap();
    let is_stated = |notice: &Value| {
        let message = notice["message"].as_str().unwrap();
        message.contains("a cylinder with a radius of 33.00") && message.contains("uncertain by 0.00")
    };
    assert!(notices.iter().any(is_stated), "{notices:#?}");
    let total = |pattern: &Pattern, at: &dyn Fn(f64) -> f64| -> f64 {
        let sides = pattern.paths.iter().flat_map(|path| path.shape.segments().to_vec());
        let fine = sides.flat_map(|side| {
            (0..50).map(move |step| [step, step + 1].map(|step| side.point(f64::from(step) / 50.0)))
        });
        fine.map(|[a, b]| (at(b.x) - at(a.x)).hypot(b.y - a.y)).sum()
    };
    let marked = read(&desk.read("out.dxf"), &PatternOptions::default()).unwrap().pattern;
    let drawn = read(&std::fs::read(&abc).unwrap(), &PatternOptions::default()).unwrap().pattern;
    let round = |x: f64| 33.0 * (x / 33.0).asin();
    let error = (total(&marked, &round) - total(&drawn, &|x| x)).abs();
    let reported = number(&report, "/quality/after/length_error_mm");
    assert!(error < 0.03 && error < reported && reported < 0.6, "{error} of {reported} mm");
    let placed = "--part-unit mm --part-up z --facing +z --place 0,0";
    let evaluation = evaluated(&desk, &["can.xyz", &abc], placed);
    let length =
        |method: &str, variant: &str| number(row(&evaluation, method, variant), "/quality/length_error_mm");
    assert!(length("cylinder", "") <= length("isometric", "aim lengths") + 1e-3, "{evaluation:#}");
    let words = ["correct", "can.xyz", &abc, "-o", "c.dxf", "--method", "cylinder"];
    let output = desk.isomark(&words.into_iter().chain(options.split(' ')).collect::<Vec<_>>());
    assert!(output.code == 0 && !output.err.contains("may keep lengths better"), "{}", output.err);
}

#[test]
fn every_method_is_measured_on_the_mouse_or_has_a_reason_why_not() {
    let desk = Desk::new();
    let evaluation = evaluated(&desk, &[&part("mouse/fc020-gui.glb"), &drawing("abc")], "--place 0,8");
    let length =
        |method: &str, variant: &str| number(row(&evaluation, method, variant), "/quality/length_error_mm");
    assert_near(
        &[number(&evaluation, "/length_mm"), number(&evaluation, "/area_mm2")],
        &[181.96, 126.6],
        0.1,
    );
    // The order of the reference: `isometric` has the smallest error, a tenth of that of the thesis, whose error is
    // smaller than that of its own state of the art.
    let (ink, uniform, thesis) = (
        length("isometric", "aim balanced"),
        length("isometric", "uniform"),
        length("mapping-domain", "corrected"),
    );
    assert!(length("isometric", "aim lengths") < ink);
    assert!(ink < uniform && uniform < thesis && 10.0 * ink < thesis, "{ink} {uniform} {thesis}");
    assert!(thesis < length("mapping-domain", "Simpson as printed"));
    assert!(length("mapping-domain", "Simpson as printed") < length("mapping-domain", "all as printed"));
    assert!(length("floater", "mean-value") < length("floater", "uniform"));
    assert!(length("none", "") > uniform);
    for method in ["cylinder", "cone"] {
        let row = row(&evaluation, method, "");
        let words = row.get("reason").map_or(&row["note"], |reason| &reason["what"]);
        assert!(words.as_str().is_some_and(|words| words.contains(method)), "{row:#}");
    }
    // No row goes below the floor, which is that of the map for each figure alone or lower.
    for (figure, only) in [
        ("length_error_mm", "only lengths"),
        ("area_error_mm2", "only areas"),
        ("largest_angle_error_deg", "only angles"),
    ] {
        let floor = number(&evaluation, &format!("/floor/{figure}"));
        let rows = evaluation["rows"].as_array().unwrap();
        let of = |row: &Value| row["quality"][figure].as_f64();
        assert!(rows.iter().filter_map(of).all(|value| value >= floor), "{figure}: {evaluation:#}");
        let (alone, balanced) =
            (row(&evaluation, "isometric", only), row(&evaluation, "isometric", "aim balanced"));
        assert!(of(alone) < of(balanced), "{figure}: {evaluation:#}");
        assert_eq!(alone["map"]["aim"], only);
    }
    // The same values as in the report of the job, which divides curves by the same tolerance.
    let options = "--place 0,8 --method floater";
    let report = desk.correct(&part("mouse/fc020-gui.glb"), &drawing("abc"), options);
    let quality = &row(&evaluation, "floater", "uniform")["quality"];
    assert_eq!(&report["quality"]["after"], quality);
    assert_eq!(&report["map"], &row(&evaluation, "floater", "uniform")["map"]);
    assert!(notices(&report).contains(&"not-length-true"), "{report:#}");
}

#[test]
fn the_table_has_a_line_for_each_method_and_aligned_columns() {
    let desk = Desk::new();
    let arguments =
        ["evaluate", &part("can/fc020-gui.glb"), &drawing("abc"), "--facing", "-y", "--place", "0,60"];
    let Output { code, out, err } = desk.isomark(&arguments);
    assert_eq!((code, err.as_str()), (0, ""));
    let mut lines = out.lines();
    let first = lines.next().unwrap();
    assert!(
        first.starts_with("abc.dxf (39.0 x 13.0 mm, 182.0 mm of lines, 126.6 mm2) on fc020-gui.glb"),
        "{out}"
    );
    assert_eq!(lines.next(), Some(""));
    let head = lines.next().unwrap();
    for column in ["method", "e_l mm", "e_a mm2", "e_l %", "stretch %", "angle deg", "time ms"] {
        assert!(head.contains(column), "{out}");
    }
    let rows: Vec<&str> = lines.by_ref().take_while(|line| !line.is_empty()).collect();
    assert_eq!(rows.len(), 17, "{out}");
    assert!(
        rows[16].starts_with("floor") && lines.next().is_some_and(|line| line.starts_with("`floor`")),
        "{out}"
    );
    // Numbers end under the last letter of their heading.
    let end = head.find("e_l mm").unwrap() + "e_l mm".len();
    for row in rows.iter().filter(|row| !row.contains("The part cannot")) {
        let figure: f64 = row[..end].rsplit(' ').next().unwrap().parse().unwrap();
        assert!(figure >= 0.0, "{out}");
    }
    let cylinder = rows.iter().find(|row| row.starts_with("cylinder")).unwrap();
    assert!(cylinder.contains("0.000"), "{out}");
}

/// The path of a drawing in mm with these entities.
fn written(desk: &Desk, name: &str, entities: &str) -> String {
    let section = |name: &str, content: &str| format!("0\nSECTION\n2\n{name}\n{content}0\nENDSEC\n");
    let header = section("HEADER", "9\n$INSUNITS\n70\n4\n");
    desk.write(name, format!("{header}{}0\nEOF\n", section("ENTITIES", entities)));
    desk.path(name).to_string_lossy().into_owned()
}

/// The marked polyline of a circle is shorter than the circle, also where nothing corrects it.
#[test]
fn the_chords_of_curves_are_part_of_all_errors() {
    let desk = Desk::new();
    // A can of 400 mm is nearly flat under a small circle, but not so flat that nothing is bent.
    let circle = written(&desk, "circle.dxf", "0\nCIRCLE\n8\n0\n10\n0\n20\n0\n40\n10\n");
    let can = "--cylinder 400,200 --axis x";
    let length_error =
        |report: &Value, side: &str| number(report, &format!("/quality/{side}/length_error_mm"));
    let report = |tolerance: &str| {
        let options = format!("{can} --method none --tolerance {tolerance}");
        desk.correct_to("out.dxf", &[&circle], &options)
    };
    let (fine, coarse) = (report("0.0001"), report("0.1"));
    let drawn = pattern(&std::fs::read(&circle).unwrap());
    let perimeter: f64 = drawn.paths.iter().flat_map(|path| path.shape.segments()).map(length).sum();
    let marked = pattern(&desk.read("out.dxf"));
    // With points on the circle, an arc with this height over its chord is longer than it by a third of the height for each radian.
    let lost = 0.1 * std::f64::consts::TAU / 3.0;
    let gained = |side: &str| length_error(&coarse, side) - length_error(&fine, side);
    let before = gained("before");
    assert!(before > 0.25 * lost && before < 1.01 * lost, "{before} mm for {lost} mm");
    // What is written has the length of the circle.
    let polygon: f64 = marked.paths.iter().flat_map(|path| path.shape.segments()).map(length).sum();
    assert!((polygon - perimeter).abs() < 0.01 * lost && gained("after") < 0.01 * lost, "{polygon}");
    let evaluation = evaluated(&desk, &[&circle], can);
    let corrected = desk.correct_to("out.dxf", &[&circle], &format!("{can} --method cylinder"));
    assert!(number(&corrected, "/output/shortening_mm") < 1e-4, "{corrected:#}");
    assert_eq!(row(&evaluation, "none", "")["quality"], corrected["quality"]["before"]);
    assert_eq!(row(&evaluation, "cylinder", "")["quality"], corrected["quality"]["after"]);
}

/// Without a correction, a drawing of straight lines is marked as it is drawn, however coarsely curves are divided.
#[test]
fn the_chords_of_a_drawing_of_lines_are_the_drawn_ones() {
    let desk = Desk::new();
    let corners = (0..180).map(|corner| f64::from(corner) * std::f64::consts::TAU / 180.0);
    let corners: String =
        corners.map(|angle| format!("10\n{}\n20\n{}\n", 6.0 * angle.cos(), 6.0 * angle.sin())).collect();
    let ring = format!("0\nLWPOLYLINE\n8\n0\n90\n180\n70\n1\n{corners}");
    let ring = written(&desk, "ring.dxf", &ring);
    let figures = |tolerance: &str| {
        let options = format!("--cylinder 400,200 --method none --tolerance {tolerance}");
        let report = desk.correct_to("out.dxf", &[&ring], &options);
        ["before", "after"].map(|side| number(&report, &format!("/quality/{side}/length_error_mm")))
    };
    let (fine, coarse) = (figures("0.0001"), figures("0.02"));
    assert!((fine[0] - coarse[0]).abs() < 1e-6, "{fine:?} {coarse:?}");
    for [before, after] in [fine, coarse] {
        assert!((before - after).abs() < 1e-4, "{before} {after}");
    }
}

fn pattern(bytes: &[u8]) -> Pattern {
    read(bytes, &PatternOptions::default()).unwrap().pattern
}

fn length(segment: &Segment) -> f64 {
    let point = |step: u32| segment.point(f64::from(step) / 4096.0);
    (0..4096).map(|step| point(step).distance(point(step + 1))).sum()
}

#[test]
fn methods_can_be_chosen_and_unknown_ones_are_refused() {
    let desk = Desk::new();
    let inputs = [part("mouse/fc020-gui.glb"), drawing("abc")];
    let inputs = [inputs[0].as_str(), inputs[1].as_str()];
    let options = "--method mapping-domain,none --mapping-domain-grid 10 --mapping-domain-intervals 20";
    let evaluation = evaluated(&desk, &inputs, options);
    assert_eq!(evaluation["rows"].as_array().unwrap().len(), 4);
    // Without `isometric`, no floor is looked for.
    assert_eq!(evaluation.get("floor"), None);
    let map = &row(&evaluation, "mapping-domain", "all as printed")["map"];
    assert_eq!((map["grid"].as_u64(), map["intervals"].as_u64()), (Some(10), Some(20)));
    assert_eq!(map["as_printed"].as_array().unwrap().len(), 3);
    desk.isomark(&["evaluate", inputs[0], inputs[1], "--method", "floatr"])
        .refused(2, &["did you mean `floater`"]);
    desk.isomark(&["evaluate", inputs[0], inputs[1], "--mapping-domain-intervals", "7"])
        .refused(2, &["even"]);
}

#[test]
fn a_cylinder_as_a_primitive_needs_no_part() {
    let desk = Desk::new();
    let report = desk.correct_to("out.dxf", &[&drawing("abc")], "--cylinder 73,180 --axis x --rotate 90");
    assert_eq!((&report["map"]["method"], &report["sku"]), (&"cylinder".into(), &"cylinder".into()));
    assert_eq!(number(&report, "/map/radius_mm"), 36.5);
    assert_eq!(number(&report, "/map/residual_mm"), 0.0);
    assert!(number(&report, "/quality/after/length_error_mm") < 1e-3, "{report:#}");
    assert!(number(&report, "/quality/before/length_error_mm") > 1.0);
    // Rotated by 90°, 39 mm of letters are around the axis: ±19.5 mm of arc reach y = 36.5·sin(19.5/36.5).
    let [_, bottom, _, top]: [f64; 4] = numbers(&report, "/output/extents_mm").try_into().unwrap();
    let reach = 36.5 * (19.5f64 / 36.5).sin();
    assert_near(&[bottom, top], &[-reach, reach], 1e-3);
    assert_eq!(report["part"]["file"], "cylinder 73 x 180 mm");
    assert!(report["part"]["facts"].get("format").is_none());
    desk.isomark(&["correct", &drawing("abc"), "--cylinder", "73,30", "--axis", "x", "-o", "no.dxf"])
        .refused(1, &["beyond the part"]);
    desk.isomark(&["correct", &drawing("abc"), "--axis", "x", "--sku", "a", "-o", "no.dxf"])
        .refused(2, &["where:      --axis x", "`shape = \"cylinder\"`"]);
    desk.isomark(&["correct", &drawing("abc"), "--cylinder", "73", "-o", "no.dxf"]).refused(2, &["73,180"]);
}

#[test]
fn a_cone_as_a_primitive_unrolls_exactly_with_any_axis() {
    let desk = Desk::new();
    for axis in ["y", "-y", "x", "0.3,1,-0.1"] {
        let report =
            desk.correct_to("out.dxf", &[&drawing("abc")], &format!("--cone 60,85,120 --axis {axis}"));
        assert_eq!(report["map"]["method"], "cone");
        let half_angle = (12.5f64 / 120.0).atan().to_degrees();
        assert_near(&[number(&report, "/map/half_angle_deg")], &[half_angle], 1e-9);
        assert!(number(&report, "/quality/after/length_error_mm") < 1e-3, "{axis}: {report:#}");
    }
}

#[test]
fn a_sku_with_a_primitive_needs_no_part_and_refuses_one() {
    let desk = Desk::new();
    let station = "[station]\nname = \"Tumblers\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 110\nheight_mm = 110\n";
    desk.write("station.toml", station);
    desk.write(
        "skus/tumbler.toml",
        "[part]\nshape = \"cylinder\"\ndiameter_mm = 73\nlength_mm = 180\naxis = \"x\"\n",
    );
    std::fs::create_dir_all(desk.path("import")).unwrap();
    let letters = std::fs::read(drawing("abc")).unwrap();
    desk.write("hot/tumbler@first.dxf", &letters);
    let output = desk.isomark(&["watch", "station.toml", "--once"]);
    assert_eq!(output.code, 0, "{}", output.err);
    assert!(desk.path("import/tumbler@first.dxf").is_file(), "{}", output.err);

    desk.write("hot/tumbler.glb", std::fs::read(part("can/fc020-gui.glb")).unwrap());
    desk.write("hot/tumbler@second.dxf", &letters);
    let output = desk.isomark(&["watch", "station.toml", "--once"]);
    assert_eq!(output.code, 1, "a part is rejected: {}", output.err);
    assert!(desk.path("import/tumbler@second.dxf").is_file(), "{}", output.err);
    let reason = desk.text("rejected/tumbler.glb.reason.txt");
    assert!(reason.contains("cylinder 73 x 180 mm") && reason.contains("shape = \"mesh\""), "{reason}");
}
