//! `isomark correct` on real exports.

use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::pattern::{Path, Pattern};
use isomark::geometry::space::FlatPoint;
use serde_json::Value;

use crate::desk::{Desk, assert_near, drawing, notices, number, numbers, part};
use crate::ezdxf::{assert_clean, judged};

const CAN: &str = "--facing -y --place 0,60";
const MANDARIN: &str = "--facing +x --place 0,0";
const VESSEL: &str = "--facing -y --place 100,60";

/// Part, drawing, options, chosen method, and the largest remaining length error relative to the length of all lines.
const JOBS: [(&str, &str, &str, &str, f64); 17] = [
    ("mouse/fc020-gui.glb", "abc", "", "isometric", 4e-4),
    ("mouse/bl42-from-glb.glb", "fc020-sketch-cpp-r14", "--place 0,8", "isometric", 5e-3),
    ("mouse/build123d.glb", "ez-logo-inch", "", "isometric", 3e-3),
    ("mouse/fc020-coarse-mesh.obj", "ez-layers-colors", "--place 0,0", "isometric", 5e-3),
    ("can/fc020-gui.glb", "abc", CAN, "cylinder", 1e-5),
    ("can/occ8-coarse.glb", "ez-logo-mm", CAN, "cylinder", 1e-5),
    ("can/bl52-from-obj.glb", "fc020-text-legacy", "--facing -y --place 0,60 --rotate 90", "cylinder", 2e-4),
    ("can/bl34-from-glb.obj", "ez-guilloche", CAN, "cylinder", 2e-4),
    ("can/fc020-coarse-mesh.obj", "grid", CAN, "cylinder", 2e-4),
    ("mandarin/fc020-coarse.glb", "abc", MANDARIN, "isometric", 5e-3),
    ("mandarin/fc020-coarse-mesh.obj", "square", MANDARIN, "isometric", 2e-2),
    ("assembly/fc020-gui-badge.glb", "ez-qr-hatch", "--place 0,0", "cylinder", 1e-5),
    ("assembly/fc020-gui.gltf", "ez-qr-hatch", "--place 0,0", "cylinder", 1e-4),
    ("assembly/fc020-gui-mesh.obj", "ez-qr-hatch", "--place 0,0", "cylinder", 2e-4),
    ("vessel/bl34-native.gltf", "ez-logo-mm", VESSEL, "isometric", 2e-3),
    (
        "vessel/bl52-native-apply.glb",
        "fc020-draft-cpp-r14",
        "--facing -y --place 100,60 --method isometric",
        "isometric",
        5e-3,
    ),
    ("vessel/bl52-native-zup-mm.obj", "ez-hatch-islands", VESSEL, "isometric", 2e-3),
];

fn pattern(bytes: &[u8]) -> Pattern {
    read(bytes, &PatternOptions::default()).unwrap().pattern
}

/// Each path as its layer, whether it is closed, and its vertices.
fn outline(pattern: &Pattern) -> Vec<(&str, bool, usize)> {
    let of = |path: &Path| {
        let name = pattern.layers[path.layer].name.as_str();
        (name, path.shape.is_closed(), path.shape.segments().len())
    };
    pattern.paths.iter().map(of).collect()
}

fn vertices(pattern: &Pattern) -> Vec<FlatPoint> {
    let starts =
        |path: &Path| path.shape.segments().iter().map(|segment| segment.point(0.0)).collect::<Vec<_>>();
    pattern.paths.iter().flat_map(starts).collect()
}

/// The first picture of the README and the results under it are those of its command.
#[test]
fn the_picture_of_the_readme_is_up_to_date() {
    let file =
        |name: &str| std::fs::read_to_string(format!("{}/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap();
    let (readme, picture) = (file("README.md"), file("examples/mouse.svg"));
    let caption = readme.split("](examples/mouse.svg)").nth(1).unwrap();
    let caption = caption.split("\n\n").nth(1).unwrap().split_whitespace().collect::<Vec<_>>().join(" ");
    let command = caption.split('`').nth(1).unwrap();
    let mut words = command.split_whitespace().skip(1);
    assert_eq!(words.next(), Some("correct"), "{command}");
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let inputs =
        [words.next().unwrap(), words.next().unwrap()].map(|name| root.join(name).display().to_string());
    let placing: Vec<&str> = words.by_ref().take(2).collect();
    assert_eq!(words.collect::<Vec<_>>(), ["--out", "bent.dxf", "--preview", "mouse.svg"], "{command}");
    let desk = Desk::new();
    let options = format!("{} --preview mouse.svg", placing.join(" "));
    let report = desk.correct_to("bent.dxf", &[&inputs[0], &inputs[1]], &options);
    let printed = |key: &str, scale: f64, digits: usize| {
        let value = |side: &str| scale * number(&report, &format!("/quality/{side}/{key}"));
        [value("before"), value("after")].map(|value| format!("{value:.digits$}"))
    };
    let (length, stretch) = (printed("length_error_mm", 1.0, 3), printed("largest_stretch", 100.0, 2));
    for words in
        [format!("{} mm to {} mm", length[0], length[1]), format!("{} % to {} %", stretch[0], stretch[1])]
    {
        assert!(caption.contains(&words), "{words} is missing in: {caption}");
    }
    for words in
        [format!("{} mm → {} mm", length[0], length[1]), format!("{} % → {} %", stretch[0], stretch[1])]
    {
        assert!(picture.contains(&words), "{words} is missing in examples/mouse.svg");
    }
}

/// A closed curve from an exporter may end with a piece of 1e-14 mm, whose stretch is only rounding.
#[test]
fn the_preview_shows_the_largest_stretch_of_the_report() {
    let example = |name: &str| format!("{}/examples/{name}", env!("CARGO_MANIFEST_DIR"));
    for name in ["guilloche", "letters"] {
        let desk = Desk::new();
        let inputs = [&*example("parts/mouse.glb"), &*example(&format!("patterns/{name}.dxf"))];
        let report = desk.correct_to("out.dxf", &inputs, "--place 0,8 --preview preview.svg");
        let picture = desk.text("preview.svg");
        for (panel, quality) in [("Before", "before"), ("After", "after")] {
            let range = picture.split(&format!(">{panel}<")).nth(1).unwrap();
            let range = range.split("length change on the part: ").nth(1).unwrap().split('<').next().unwrap();
            let percent =
                |text: &str| -> f64 { text.trim_end_matches(" %").replace('−', "-").parse().unwrap() };
            let largest = range.split(" to ").map(|end| percent(end).abs()).fold(0.0, f64::max);
            let reported = 100.0 * number(&report, &format!("/quality/{quality}/largest_stretch"));
            // The preview shows only one or two digits.
            let rounding = if reported < 0.1 { 0.006 } else { 0.06 };
            assert!((largest - reported).abs() < rounding, "{name} {panel}: {range}, {reported} %");
        }
        assert!(!picture.contains("stretch beyond ±2 %"), "{name}");
    }
}

#[test]
fn sample_parts_of_several_exporters_are_corrected() {
    for (part_name, pattern_name, options, method, remains) in JOBS {
        let desk = Desk::new();
        let case = format!("{part_name} {pattern_name} {options}");
        let options = format!("{options} --report report.json --preview preview.svg");
        let report = desk.correct(&part(part_name), &drawing(pattern_name), &options);
        assert_eq!(serde_json::from_slice::<Value>(&desk.read("report.json")).unwrap(), report);

        assert_eq!(report["map"]["method"], method, "{case}");
        let unknown = |name: &str| {
            report.pointer(&format!("/quality/after/uncertain/{name}")).and_then(Value::as_f64).unwrap_or(0.0)
        };
        // What the map leaves; chords and what the facets leave uncertain add to it.
        let added = number(&report, "/output/shortening_mm") + unknown("length_error_mm");
        let left = number(&report, "/quality/after/length_error_mm") - added;
        let relative = left / number(&report, "/quality/after/length_mm");
        assert!(relative < remains, "{case}: {relative}");
        assert!(relative * 3.0 < number(&report, "/quality/before/length_error_relative"), "{case}");
        let share = unknown("length_error_mm") / number(&report, "/quality/after/length_mm");
        for (after, limit, uncertain) in [
            ("rms_stretch", 0.03, share),
            ("largest_stretch", 0.1, unknown("stretch")),
            ("largest_angle_error_deg", 20.0, unknown("angle_error_deg")),
        ] {
            let value = number(&report, &format!("/quality/after/{after}")) - uncertain;
            assert!((0.0..limit).contains(&value), "{case}: {after} {value}");
        }
        assert!(number(&report, "/part/residual/under_ink_mm") < 0.05, "{case}");

        let dxf = desk.read("out.dxf");
        assert_eq!(report["output"]["blake3"], blake3::hash(&dxf).to_hex().to_string());
        assert_eq!(report["output"]["read_back"], true, "{case}");
        let (before, after) = (pattern(&std::fs::read(drawing(pattern_name)).unwrap()), pattern(&dxf));
        let kinds = |pattern: &Pattern| -> Vec<(String, bool)> {
            outline(pattern).into_iter().map(|(layer, closed, _)| (layer.to_owned(), closed)).collect()
        };
        assert_eq!(kinds(&after), kinds(&before), "{case}");
        assert_eq!(number(&report, "/output/paths"), before.paths.len() as f64);
        let extents = after.extents();
        let found = [extents.min.x, extents.min.y, extents.max.x, extents.max.y];
        assert_near(&found, &numbers(&report, "/output/extents_mm"), 1e-6);

        let picture = desk.text("preview.svg");
        assert!(picture.contains("<svg ") && picture.trim_end().ends_with("</svg>"), "{case}");
        assert!(!picture.contains("NaN") && !picture.contains("inf"), "{case}");
    }
}

#[test]
fn a_summary_for_people_goes_only_to_standard_error() {
    let desk = Desk::new();
    let arguments =
        ["correct", &part("mouse/fc020-gui.glb"), &drawing("abc"), "--sku", "mouse", "-o", "bent.dxf"];
    let output = desk.isomark(&arguments);
    assert_eq!((output.code, output.out.as_str()), (0, ""));
    for word in [
        "mouse: abc.dxf (39.0 x 13.0 mm, 6 paths)",
        "`isometric`",
        "60.0 x 110.0 x 38.0 mm",
        "182.0 mm of lines",
    ] {
        assert!(output.err.contains(word), "{word}: {}", output.err);
    }
    // The job, then a line each for lengths, areas, angles, distances, the surface, the focus, a misplaced part and the lens, which no
    // settings state.
    assert_eq!(output.err.trim_end().lines().count(), 9, "{}", output.err);
    assert!(
        output.err.lines().any(|line| line.starts_with("  note: the settings state no lens")),
        "{}",
        output.err
    );
}

#[test]
fn a_can_is_unrolled_exactly() {
    let desk = Desk::new();
    for name in ["can/fc020-gui.glb", "can/fc020-fine-mesh.obj", "can/build123d.glb"] {
        let report = desk.correct(&part(name), &drawing("abc"), &format!("{CAN} --vertices keep"));
        assert_near(&[number(&report, "/map/radius_mm")], &[33.0], 0.01);
        assert_near(
            &numbers(&report, "/map/axis").iter().map(|x| x.abs()).collect::<Vec<_>>(),
            &[0.0, 1.0, 0.0],
            1e-4,
        );
        assert!(number(&report, "/quality/after/length_error_mm") < 0.002);
        // Length and area of the drawing, as in the thesis.
        assert_near(&[number(&report, "/quality/after/length_mm")], &[181.96], 0.01);
        assert_near(&[number(&report, "/quality/after/area_mm2")], &[126.64], 0.1);
        // The largest angle of the beam is the half width of the drawing over the radius.
        assert_near(&[number(&report, "/exposure/incidence_deg")], &[(19.5f64 / 33.0).to_degrees()], 0.05);

        let (drawn, bent) =
            (pattern(&std::fs::read(drawing("abc")).unwrap()), pattern(&desk.read("out.dxf")));
        assert_eq!(outline(&bent), outline(&drawn));
        let center = drawn.extents().center();
        for (from, to) in vertices(&drawn).into_iter().zip(vertices(&bent)) {
            let expected = [33.0 * ((from.x - center.x) / 33.0).sin(), from.y - center.y + 60.0];
            assert_near(&[to.x, to.y], &expected, 0.002);
        }
    }
}

#[test]
fn the_isometric_map_finds_the_cylinder_too() {
    let report = Desk::new().correct(
        &part("can/fc020-gui.glb"),
        &drawing("abc"),
        &format!("{CAN} --method isometric"),
    );
    assert_eq!(report["map"]["method"], "isometric");
    assert!(number(&report, "/quality/after/length_error_mm") < 0.02);
}

#[test]
fn a_finer_tolerance_gives_more_points() {
    let desk = Desk::new();
    // Rotated, the sides become helices on the can.
    let count = |options: &str| {
        let report = desk.correct(
            &part("can/fc020-gui.glb"),
            &drawing("square"),
            &format!("{CAN} --rotate 30 {options}"),
        );
        assert_eq!(
            report["output"]["vertices"],
            pattern(&desk.read("out.dxf")).paths[0].shape.segments().len()
        );
        number(&report, "/output/vertices")
    };
    let (keep, coarse, fine) =
        (count("--vertices keep"), count("--tolerance 0.1"), count("--tolerance 0.0005"));
    assert!(keep <= coarse && coarse < fine, "{keep} {coarse} {fine}");
}

#[test]
fn anchor_place_and_rotation_are_rigid() {
    let desk = Desk::new();
    let extents = |options: &str| {
        // With this tolerance no chord is shorter than what it replaces.
        let options = format!("--method none --tolerance 0.001 {options}");
        let report = desk.correct(&part("mouse/fc020-gui.glb"), &drawing("abc"), &options);
        assert_eq!(report["map"]["method"], "none");
        assert_eq!(report["quality"]["before"], report["quality"]["after"]);
        numbers(&report, "/output/extents_mm")
    };
    let drawn = pattern(&std::fs::read(drawing("abc")).unwrap()).extents();
    let drawn = [drawn.min.x, drawn.min.y, drawn.max.x, drawn.max.y];
    let moved = |x: f64, y: f64| [drawn[0] + x, drawn[1] + y, drawn[2] + x, drawn[3] + y];
    assert_near(&extents(""), &drawn, 1e-5);
    assert_near(&extents("--place 1,2"), &[-18.5, -4.5, 20.5, 8.5], 1e-5);
    assert_near(&extents("--anchor origin --place 1,2"), &moved(1.0, 2.0), 1e-5);
    assert_near(&extents("--anchor 10,5 --place 12,4"), &moved(2.0, -1.0), 1e-5);
    assert_near(&extents("--rotate 90 --place 0,0"), &[-6.5, -19.5, 6.5, 19.5], 1e-5);
    assert_near(
        &extents("--rotate -90 --anchor 0,0 --place 0,3"),
        &[drawn[1], 3.0 - drawn[2], drawn[3], 3.0 - drawn[0]],
        1e-5,
    );
}

#[test]
fn methods_and_weightings_have_the_described_effect() {
    let desk = Desk::new();
    let job = |options: &str| {
        desk.correct(&part("mandarin/fc020-coarse.glb"), &drawing("abc"), &format!("{MANDARIN} {options}"))
    };
    let error = |report: &Value| number(report, "/quality/after/length_error_mm");
    let (ink, uniform, none) = (job(""), job("--weighting uniform"), job("--method none"));
    assert_eq!((&ink["map"]["weighting"], &uniform["map"]["weighting"]), (&"ink".into(), &"uniform".into()));
    // What is not known of this coarse part is in all of them.
    let known = |report: &Value| error(report) - number(report, "/quality/after/uncertain/length_error_mm");
    assert!(error(&ink) < error(&uniform) && known(&uniform) * 3.0 < known(&none));
    let angle = |report: &Value| number(report, "/quality/after/largest_angle_error_deg");
    let (long, right, free) = (job("--length-weight 4"), job("--angle-weight 4"), job("--angle-weight 0.25"));
    assert_eq!([&long["map"]["length_weight"], &long["map"]["angle_weight"]], [4.0, 1.0]);
    assert!(error(&long) < error(&ink) && error(&ink) < error(&right));
    assert!(angle(&right) < angle(&free));
    assert!(!notices(&right).contains(&"weights-unused"));
    assert!(notices(&job("--weighting uniform --angle-weight 4")).contains(&"weights-unused"));
    let forced = desk.correct(&part("mouse/fc020-gui.glb"), &drawing("abc"), "--method cylinder");
    assert!(notices(&forced).contains(&"no-true-figure"));
}

#[test]
fn without_a_correction_lengths_are_reported_only_where_they_are_wrong() {
    let desk = Desk::new();
    desk.write("ball.obj", ball());
    desk.write("line.dxf", entities("0\nLINE\n8\n0\n10\n-15\n20\n0\n11\n15\n21\n0\n"));
    desk.write("ring.dxf", entities("0\nCIRCLE\n8\n0\n10\n0\n20\n0\n40\n20\n"));
    let options = "--part-unit mm --part-up z --facing +z --place 0,0 --method none --tolerance 0.0005";
    let report = |drawing: &str| {
        let [part, drawing] =
            ["ball.obj", drawing].map(|name| desk.path(name).to_string_lossy().into_owned());
        desk.correct(&part, &drawing, options)
    };
    assert!(notices(&report("line.dxf")).contains(&"not-length-true"));
    // Round the top of a ball, a ring has its length, which `auto` would not keep as well.
    let ring = report("ring.dxf");
    assert!(!notices(&ring).contains(&"not-length-true"), "{ring:#}");
}

#[test]
fn unit_and_axis_can_be_set() {
    let desk = Desk::new();
    let can = part("can/fc020-fine-mesh.obj");
    let size = |options: &str| numbers(&desk.correct(&can, &drawing("abc"), options), "/part/facts/size_mm");
    let given = size(CAN);
    assert_near(&given, &[66.0, 66.0, 115.0], 0.05);
    let times = |factor: f64| given.iter().map(|side| side * factor).collect::<Vec<_>>();
    assert_near(&size(&format!("{CAN} --part-unit mm")), &given, 1e-9);
    assert_near(&size("--facing -y --place 0,600 --part-unit cm"), &times(10.0), 1e-6);
    assert_near(&size("--facing -y --place 0,1500 --part-unit inch"), &times(25.4), 1e-6);
    // With Y up the can is on its side, and the laser sees its side from above.
    assert_near(&size("--place 0,-60 --part-up y"), &[given[0], given[2], given[1]], 1e-9);
    // A drawing without a unit in centimetres: ten times as large as in mm.
    let options = "--facing -y --place 0,600 --part-unit cm --pattern-unit";
    let width = |unit: &str| {
        let report = desk.correct(&can, &drawing("ez-logo-unitless"), &format!("{options} {unit}"));
        number(&report, "/pattern/facts/size_mm/0")
    };
    assert_near(&[width("mm"), width("cm")], &[28.0, 280.0], 1e-6);
}

#[test]
fn layers_without_ink_are_written_but_not_measured() {
    let desk = Desk::new();
    let job =
        |options: &str| desk.correct(&part("mouse/fc020-gui.glb"), &drawing("ez-layers-colors"), options);
    let (all, some) = (job("--place 0,0"), job("--place 0,0 --ink-layers CUT"));
    assert_eq!(some["pattern"]["ink_layers"], serde_json::json!(["CUT"]));
    let length = |report: &Value| number(report, "/quality/after/length_mm");
    assert!(length(&some) > 0.0 && length(&some) < length(&all));
    assert_eq!(some["output"]["paths"], all["output"]["paths"]);
    let mistyped = job("--place 0,0 --ink-layers cut,CTU");
    assert_eq!(length(&mistyped), length(&some));
    assert!(!notices(&some).contains(&"ink-layer-missing"));
    let notices = mistyped["notices"].to_string();
    assert!(notices.contains("the drawing has no ink layer CTU; its layers are "), "{notices}");
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let inputs = [part("mandarin/fc020-coarse.glb"), drawing("abc")];
    let run = || {
        let desk = Desk::new();
        let report = desk.correct(&inputs[0], &inputs[1], &format!("{MANDARIN} --sku m --preview out.svg"));
        // The second run takes the surface from the cache.
        desk.correct_to("again.dxf", &[&inputs[0], &inputs[1]], &format!("{MANDARIN} --sku m"));
        assert_eq!(desk.read("out.dxf"), desk.read("again.dxf"));
        (desk.read("out.dxf"), desk.read("out.svg"), report["quality"].clone())
    };
    assert!(run() == run());
}

#[test]
fn a_replaced_drawing_is_compared_with_the_new_one() {
    let desk = Desk::new();
    let (part, drawing) = (part("can/fc020-gui.glb"), drawing("abc"));
    assert_eq!(desk.correct(&part, &drawing, CAN).get("changes"), None);
    assert_eq!(desk.correct(&part, &drawing, CAN).get("changes"), None, "nothing changed");
    let report = desk.correct(&part, &drawing, "--facing -y --place 0,62.5");
    assert_eq!(report["changes"]["lines"], serde_json::json!(["all 6 paths moved by 2.50 mm up"]));
    let output =
        desk.isomark(&["correct", &part, &drawing, "--facing", "-y", "--place", "0,60", "-o", "out.dxf"]);
    let changes = "\n  compared with the previous out.dxf, which was replaced:\n    all 6 paths moved by 2.50 mm down\n";
    assert!(output.err.contains(changes), "{}", output.err);
    // A drawing of another pattern or SKU, or of another program, is only replaced.
    let other = fs_err::read(crate::desk::drawing("circle")).unwrap();
    desk.write("out.dxf", &other);
    assert_eq!(desk.correct(&part, &drawing, CAN).get("changes"), None);
    desk.write("abc-2.dxf", fs_err::read(&drawing).unwrap());
    assert_eq!(desk.correct(&part, "abc-2.dxf", "--facing -y --place 0,62.5").get("changes"), None);
    assert_eq!(desk.correct(&part, "abc-2.dxf", "--facing -y --place 0,60 --sku b").get("changes"), None);
    // Without comments nobody can tell.
    let report = desk.correct(&part, &drawing, "--facing -y --place 0,62.5 --set output.comments=false");
    assert_eq!(report["changes"]["lines"], serde_json::json!(["all 6 paths moved by 2.50 mm up"]));
}

#[test]
fn a_stations_settings_apply_unless_an_option_overrides_them() {
    let desk = Desk::new();
    desk.write(
        "station.toml",
        "[station]\nname = \"a\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 110\nheight_mm = 110\n\
         origin = \"corner\"\n[output]\ndxf = \"R12\"\n",
    );
    desk.write(
        "skus/can.toml",
        "[part]\nfacing = \"-y\"\n[placement]\nplace_mm = [0, 60]\n[fixture]\nx_mm = 55\n",
    );
    let options = "--sku can --station station.toml --vertices keep";
    let report = desk.correct(&part("can/fc020-gui.glb"), &drawing("abc"), options);
    assert_eq!(report["output"]["dxf"], "R12");
    let wide = 33.0 * (19.5f64 / 33.0).sin();
    assert_near(&numbers(&report, "/output/extents_mm"), &[55.0 - wide, 53.5, 55.0 + wide, 66.5], 0.002);
    assert!(desk.path("cache/v39/can").is_dir(), "the station's cache is used");
    let turned = desk.correct(&part("can/fc020-gui.glb"), &drawing("abc"), &format!("{options} --rotate 90"));
    let wide = 33.0 * (6.5f64 / 33.0).sin();
    assert_near(&numbers(&turned, "/output/extents_mm"), &[55.0 - wide, 40.5, 55.0 + wide, 79.5], 0.002);
}

#[test]
fn ezdxf_finds_nothing_to_repair_in_any_version() {
    let desk = Desk::new();
    for (version, entity) in [("R2000", "LWPOLYLINE"), ("R12", "POLYLINE"), ("R12-lines", "LINE")] {
        desk.write(
            "station.toml",
            format!(
                "[station]\nname = \"a\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 300\n\
                 height_mm = 300\n[output]\ndxf = \"{version}\"\n"
            ),
        );
        for (part_name, pattern_name, options) in [
            ("mouse/fc020-gui.glb", "ez-layers-colors", "--place 0,0"),
            ("can/fc020-gui.glb", "fc020-text-cpp-r14", "--facing -y --place 0,60 --rotate 90"),
            ("assembly/fc020-gui-badge.glb", "ez-qr-hatch", "--place 0,0"),
        ] {
            let options = format!("--station station.toml {options}");
            let report = desk.correct(&part(part_name), &drawing(pattern_name), &options);
            let Some(judgement) = judged(&desk.read("out.dxf")) else { return };
            assert_clean(&judgement);
            assert_near(&numbers(&judgement, "/box"), &numbers(&report, "/output/extents_mm"), 2e-6);
            assert_near(&numbers(&judgement, "/header_box"), &numbers(&judgement, "/box"), 1e-9);
            let entities = judgement["entities"].as_array().unwrap();
            if version != "R12-lines" {
                assert_eq!(report["output"]["paths"], entities.len());
                let points: usize =
                    entities.iter().map(|entity| entity["points"].as_array().unwrap().len()).sum();
                assert_eq!(report["output"]["vertices"], points);
            }
            assert!(entities.iter().all(|e| e["type"] == entity || e["type"] == "POINT"), "{version}");
            if version == "R2000" {
                assert_eq!((&judgement["units"], &judgement["measurement"]), (&4.into(), &1.into()));
            }
        }
    }
}

#[test]
fn a_ridge_under_the_ink_causes_a_warning_with_its_place() {
    let desk = Desk::new();
    // Two flat sides that meet at 20° along the line x = 2 mm.
    desk.write(
        "roof.obj",
        "v -23 -30 -4.408\nv 2 -30 0\nv 27 -30 -4.408\nv -23 30 -4.408\nv 2 30 0\nv 27 30 -4.408\n\
         f 1 2 5 4\nf 2 3 6 5\n",
    );
    desk.write(
        "line.dxf",
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n0\n\
         10\n-15\n20\n1\n11\n15\n21\n1\n0\nENDSEC\n0\nEOF\n",
    );
    let options = "--part-unit mm --part-up z --place 0,1";
    let report = desk.correct(
        &desk.path("roof.obj").to_string_lossy(),
        &desk.path("line.dxf").to_string_lossy(),
        options,
    );
    let loose = report["notices"].as_array().unwrap().iter().find(|notice| notice["code"] == "surface-loose");
    let text = loose.unwrap()["message"].as_str().unwrap();
    assert!(text.contains("near (2.") || text.contains("near (1."), "{text}");
}

#[test]
fn coarse_facets_are_named_where_most_of_a_stretch_is_uncertain() {
    let letters = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/patterns/letters.dxf");
    let place = "--facing +x --place 0,0";
    let report = Desk::new().correct(&part("mandarin/fc020-coarse.glb"), letters, place);
    let message = |code: &str| {
        let mut notices = report["notices"].as_array().unwrap().iter();
        let notice = notices.find(|notice| notice["code"] == code);
        notice.unwrap_or_else(|| panic!("no {code}"))["message"].as_str().unwrap().to_owned()
    };
    for (code, cause) in
        [("stretch-remains", "the facets of the mesh"), ("facets-coarse", "facets are coarse")]
    {
        let text = message(code);
        assert!(text.contains(cause) && text.contains("as STEP"), "{text}");
        assert!(!text.contains("curved in both directions"), "{text}");
    }
    assert!(message("stretch-remains").contains("may be wrong by up to"));
}

/// The top of a ball of 30 mm as OBJ, 54 mm across.
fn ball() -> String {
    let ball = isomark::geometry::shapes::graph(27.0, 1.0, isomark::geometry::shapes::sphere);
    let vertices = ball.positions().iter().map(|at| format!("v {} {} {}\n", at.x, at.y, at.z));
    let facets = ball.triangles().iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    vertices.chain(facets).collect()
}

fn entities(records: &str) -> String {
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n{records}0\nENDSEC\n0\nEOF\n"
    )
}

#[test]
fn lines_that_the_correction_makes_less_true_and_distances_that_change_are_reported() {
    let desk = Desk::new();
    desk.write("ball.obj", ball());
    desk.write("ring.dxf", entities("0\nCIRCLE\n8\n0\n10\n0\n20\n0\n40\n20\n"));
    let dots = |step: f64| {
        let dot = |index: i32| {
            let [x, y] = [index % 7 - 3, index / 7 - 3].map(|place| f64::from(place) * step);
            format!("0\nPOINT\n8\n0\n10\n{x}\n20\n{y}\n")
        };
        entities(&(0..49).map(dot).collect::<String>())
    };
    desk.write("dots.dxf", dots(5.0));
    desk.write("near.dxf", dots(1.0));
    let corrected = |drawing: &str, options: &str| {
        let options = format!("--part-unit mm --part-up z --facing +z --place 0,0 {options}");
        let [part, drawing] =
            ["ball.obj", drawing].map(|name| desk.path(name).to_string_lossy().into_owned());
        let report = desk.correct(&part, &drawing, &options);
        let codes: Vec<String> = report["notices"]
            .as_array()
            .unwrap()
            .iter()
            .map(|n| n["code"].as_str().unwrap().into())
            .collect();
        (report, codes)
    };
    let has = |codes: &[String], code: &str| codes.iter().any(|found| found == code);
    // Round the top of a ball, the ring is true as it is drawn. As an area, it is too large.
    let (report, codes) = corrected("ring.dxf", "");
    let length_error = |report: &Value| report["quality"]["after"]["length_error_mm"].as_f64().unwrap();
    assert!(has(&codes, "lengths-traded") && length_error(&report) > 1.0, "{codes:?}");
    let (report, codes) = corrected("ring.dxf", "--aim lengths");
    assert!(!has(&codes, "lengths-traded") && length_error(&report) < 0.1, "{codes:?}");
    // With a fill, it is an area whatever the aim is.
    let (report, codes) = corrected("ring.dxf", "--aim lengths --fill 0.2");
    assert!(has(&codes, "lengths-traded") && length_error(&report) > 1.0, "{codes:?}");

    // On a layer that is not filled, it stays a line.
    let square =
        "0\nLWPOLYLINE\n8\nLOGO\n90\n4\n70\n1\n10\n-2\n20\n-2\n10\n2\n20\n-2\n10\n2\n20\n2\n10\n-2\n20\n2\n";
    desk.write("layers.dxf", entities(&format!("0\nCIRCLE\n8\nCUT\n10\n0\n20\n0\n40\n20\n{square}")));
    let (report, codes) = corrected("layers.dxf", "--aim lengths --fill 0.2 --set fill.layers=[\"LOGO\"]");
    assert!(!has(&codes, "lengths-traded") && length_error(&report) < 0.15, "{codes:?}");

    // Rings that shapes would make less true keep their lengths alone.
    let rings = (1..=8).map(|ring| format!("0\nCIRCLE\n8\n0\n10\n0\n20\n0\n40\n{}\n", 2 * ring));
    desk.write("rings.dxf", entities(&rings.collect::<String>()));
    let (report, codes) = corrected("rings.dxf", "--aim lengths");
    let before = number(&report, "/quality/before/length_error_mm");
    assert!(length_error(&report) <= before, "{} for {before} mm", length_error(&report));
    assert!(has(&codes, "lengths-alone") || has(&codes, "marked-as-drawn"), "{codes:?}");
    assert!(!has(&codes, "lengths-traded"), "{codes:?}");
    let (_, codes) = corrected("rings.dxf", "");
    assert!(!has(&codes, "lengths-alone") && !has(&codes, "marked-as-drawn"), "{codes:?}");

    let frame =
        "0\nLWPOLYLINE\n8\n0\n90\n4\n70\n1\n10\n-9\n20\n-5\n10\n9\n20\n-5\n10\n9\n20\n5\n10\n-9\n20\n5\n";
    let hatch = "0\nSOLID\n8\n0\n10\n-2\n20\n-2\n11\n2\n21\n-2\n12\n-2\n22\n2\n13\n2\n23\n2\n";
    desk.write("frame.dxf", entities(&format!("{frame}{hatch}")));
    let (report, codes) = corrected("frame.dxf", "--fill 0.1");
    let area = report["fill"]["area_mm2"].as_f64().unwrap();
    assert!(has(&codes, "fill-in-outline") && (area - 164.0).abs() < 1.5, "{area} mm²: {codes:?}");

    let change = |report: &Value| report["quality"]["distances"]["largest_change"].as_f64().unwrap().abs();
    let (report, codes) = corrected("dots.dxf", "");
    assert!(has(&codes, "distance-changes") && change(&report) > 0.05, "{codes:?}");
    let (report, codes) = corrected("near.dxf", "");
    assert!(!has(&codes, "distance-changes") && change(&report) < 0.01, "{codes:?}");
}

/// A plate of 300 mm with a rod of 12 mm along it, in facets of 4 degrees.
fn plate_with_rod() -> String {
    let arc = (0..=45).map(|at| -6.0 * (f64::from(at) * std::f64::consts::PI / 45.0).cos());
    let columns: Vec<f64> = [-150.0].into_iter().chain(arc).chain([150.0]).collect();
    let points = columns.iter().flat_map(|x| [-150.0, 150.0].map(|y| (x, y)));
    let mut obj: String =
        points.map(|(x, y)| format!("v {x} {y} {}\n", (36.0 - x * x).max(0.0).sqrt())).collect();
    for column in 0..columns.len() - 1 {
        let corner = 2 * column + 1;
        obj += &format!("f {} {} {} {}\n", corner, corner + 2, corner + 3, corner + 1);
    }
    obj
}

#[test]
fn a_thin_rod_on_a_wide_plate_is_marked_as_a_cylinder() {
    let desk = Desk::new();
    desk.write("rod.obj", plate_with_rod());
    let width = 6.0;
    let square = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{width}mm\" viewBox=\"0 0 {width} {width}\">\
         <path d=\"M0 0H{width}V{width}H0Z\" fill=\"none\" stroke=\"black\"/></svg>"
    );
    desk.write("square.svg", square);
    let options = "--part-unit mm --part-up z --facing +z --place 0,20 --vertices keep";
    let [report, again] = [0, 1].map(|_| {
        let report = desk.correct("rod.obj", "square.svg", options);
        (report["map"].clone(), report["quality"].clone(), report["output"]["blake3"].clone())
    });
    assert_eq!(report, again, "the kept surface is the fitted one");
    let (map, quality, _) = report;
    assert_eq!(map["method"], "cylinder");
    assert!((map["radius_mm"].as_f64().unwrap() - 6.0).abs() < 1e-3, "{map}");
    assert!(quality["after"]["length_error_mm"].as_f64().unwrap() < 0.01, "{quality}");
    // Half of the chord on the cylinder: 3 mm along an arc of 6 mm.
    let across = numbers(&desk.correct("rod.obj", "square.svg", options), "/output/extents_mm");
    let half = 6.0 * 0.5f64.sin();
    assert_near(&across, &[-half, 17.0, half, 23.0], 0.002);
}

/// An open LWPOLYLINE through these points.
fn polyline(points: impl IntoIterator<Item = [f64; 2]>) -> String {
    let points: Vec<String> = points.into_iter().map(|[x, y]| format!("10\n{x}\n20\n{y}\n")).collect();
    format!("0\nLWPOLYLINE\n8\n0\n90\n{}\n70\n0\n{}", points.len(), points.concat())
}

#[test]
fn an_arc_round_a_cone_that_is_marked_as_one_line_has_its_length() {
    let desk = Desk::new();
    // From D50 to D90 over 60 mm: at the middle, with a radius of 35 mm, the apex is s = 35 / sin(a) away, with tan(a) = 1/3.
    let sine = (1.0f64 / 3.0).atan().sin();
    let middle = 35.0 / sine;
    let radius = middle - 15.0;
    let steps = 180;
    let point = |step: i32| {
        let (sin, cos) = ((f64::from(step) / f64::from(steps) - 0.5) * sine).sin_cos();
        [radius * sin, radius * cos - middle]
    };
    desk.write("arc.dxf", entities(&polyline((0..=steps).map(point))));
    let arguments = "--cone 50,90,60 arc.dxf --anchor origin --out out.dxf --json";
    let report = |more: &str| -> Value {
        let arguments = format!("correct {arguments} {more}");
        let output = desk.isomark(&arguments.split_whitespace().collect::<Vec<_>>());
        serde_json::from_str(&output.out).unwrap_or_else(|error| panic!("{error}: {}", output.err))
    };
    let straight = report("");
    // A circle about the axis is a straight line as the laser sees it from beside the cone.
    let marked = vertices(&pattern(&desk.read("out.dxf")));
    assert_eq!(marked.len(), 1, "one line: {marked:?}");
    assert!(number(&straight, "/quality/after/length_error_mm") < 1e-3, "{}", straight["quality"]);
    assert!(number(&straight, "/quality/after/largest_stretch") < 1e-4, "{}", straight["quality"]);
    let round = report("--rotary=12");
    assert!(number(&round, "/quality/after/length_error_mm") < 2e-3, "{}", round["quality"]);
}

#[test]
fn without_a_correction_a_perspective_lens_marks_what_is_nearer_to_it_smaller() {
    let desk = Desk::new();
    let lens = |distance: f64| {
        format!(
            "--set optics.kind=\"perspective\" --set optics.lens_distance_x_mm={distance} \
             --set optics.lens_distance_y_mm={distance} --set fixture.z_mm=20"
        )
    };
    let marked = |part: &str, drawing: &str, options: &str| -> Value {
        let arguments = format!("correct {part} {drawing} --anchor origin --out out.dxf --json {options}");
        let output = desk.isomark(&arguments.split_whitespace().collect::<Vec<_>>());
        serde_json::from_str(&output.out).unwrap_or_else(|error| panic!("{error}: {}", output.err))
    };
    desk.write("along.dxf", entities(&polyline([[-30.0, 0.0], [30.0, 0.0]])));
    let of = |report: &Value, which: &str| number(report, &format!("/quality/{which}/length_error_mm"));
    for distance in [150.0, 400.0] {
        let report = marked("--cylinder 80,120 --axis x", "along.dxf", &lens(distance));
        // The beams meet at the lens, so that at 20 mm the line is shorter in the ratio of the distances from the lens.
        assert_near(&[of(&report, "before")], &[60.0 * 20.0 / distance], 1e-3);
        assert!(of(&report, "after") < 1e-3);
    }
    let parallel = marked("--cylinder 80,120 --axis x", "along.dxf", "--set fixture.z_mm=20");
    assert!(of(&parallel, "before") < 1e-3);
    // Across the cylinder, a beam from the lens at (0, 150) to (x, 0) is at z where it meets the circle of 40 mm about (0, -20).
    desk.write("across.dxf", entities(&polyline([[-20.0, 0.0], [20.0, 0.0]])));
    let report = marked("--cylinder 80,120", "across.dxf", &lens(150.0));
    let arc = |x: f64| {
        let (mut low, mut high) = (-20.0f64, 20.0f64);
        for _ in 0..60 {
            let z = f64::midpoint(low, high);
            let beside = x * (150.0 - z) / 150.0;
            if beside.hypot(z + 20.0) > 40.0 { high = z } else { low = z }
        }
        40.0 * (x * (150.0 - low) / 150.0 / 40.0).asin()
    };
    let pieces = (-80..80).map(|piece| f64::from(piece) * 0.25);
    let error: f64 = pieces.map(|x| (arc(x + 0.25) - arc(x) - 0.25).abs()).sum();
    assert_near(&[of(&report, "before")], &[error], 0.01);
}
