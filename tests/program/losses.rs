//! Visible ink that isomark cannot mark: the drawing is refused with a list, or delivered with a warning.

use serde_json::Value;

use crate::desk::{Desk, Output, drawing, notices};
use crate::station::{Station, files};

/// A flat plate of 100 x 100 mm.
const PLATE: &str = "v -50 -50 5\nv 50 -50 5\nv 50 50 5\nv -50 50 5\nf 1 2 3 4\n";
const AS_DRAWN: &str = "--part-unit mm --part-up z";

/// A square of 10 mm on the layer MARK and these entities; OFF is off, NOPLOT not plotted, COLD frozen.
fn dxf(entities: &str) -> String {
    let layer = |name: &str, flags: u8, color: i8, plotted: u8| {
        format!("0\nLAYER\n2\n{name}\n70\n{flags}\n62\n{color}\n6\nCONTINUOUS\n290\n{plotted}\n")
    };
    let layers =
        [layer("MARK", 0, 7, 1), layer("OFF", 0, -7, 1), layer("NOPLOT", 0, 7, 0), layer("COLD", 1, 7, 1)];
    let square = "0\nLWPOLYLINE\n5\n50\n8\nMARK\n90\n4\n70\n1\n10\n0\n20\n0\n10\n10\n20\n0\n10\n10\n20\n10\n10\n0\n20\n10\n";
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nTABLES\n0\nTABLE\n2\n\
         LAYER\n70\n4\n{}0\nENDTAB\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n{square}{entities}0\nENDSEC\n0\nEOF\n",
        layers.concat()
    )
}

/// A text with a letter that is in no available font.
fn text(layer: &str) -> String {
    format!("0\nTEXT\n5\n7E\n8\n{layer}\n10\n0\n20\n0\n40\n3\n1\nLOT \\U+682A 7\n")
}

#[test]
fn a_drawing_from_the_corner_of_a_page_names_the_place_where_it_fits() {
    let desk = desk("");
    let far = String::from_utf8(desk.read("logo.dxf")).unwrap();
    let far = far.replace("\n10\n10\n20\n", "\n10\n110\n20\n").replace("\n10\n0\n20\n", "\n10\n100\n20\n");
    desk.write("logo.dxf", far);
    let refused = correct(&desk, "");
    refused.refused(
        1,
        &[
            "--place 0,0",
            "place_mm = [0, 0]",
            "seem to be those of a page. If it belongs elsewhere, move it or check `facing`.",
        ],
    );
    assert_eq!(correct(&desk, "--place 0,0").code, 0);
    // A place that was given is not doubted, and a drawing larger than the part fits nowhere.
    let placed = correct(&desk, "--place 300,0");
    assert!(placed.code == 1 && !placed.err.contains("--place 0,0"), "{}", placed.err);
    let large = desk.text("logo.dxf").replace("\n110\n", "\n400\n");
    desk.write("logo.dxf", large);
    let large = correct(&desk, "");
    assert!(large.code == 1 && !large.err.contains("--place 0,0"), "{}", large.err);
}

/// A place is only named if all lines of the drawing can be marked there, and if it is another one. The hole is between the points
/// of a coarse grid over the drawing.
#[test]
fn no_place_is_named_at_which_the_drawing_crosses_a_hole() {
    let desk = Desk::new();
    let places = (0..10_000).map(|at| (0.6 * f64::from(at % 100) - 29.7, 0.6 * f64::from(at / 100) - 29.7));
    let plate = places.filter(|(x, y)| (x - 2.5).hypot(y - 2.5) > 2.9);
    desk.write("plate.xyz", plate.map(|(x, y)| format!("{x:.2} {y:.2} 0.00\n")).collect::<String>());
    let line = |[a, b]: [f64; 2], [c, d]: [f64; 2]| {
        format!("0\nLINE\n8\n0\n10\n{a}\n20\n{b}\n30\n0\n11\n{c}\n21\n{d}\n31\n0\n")
    };
    // A frame of 40 mm about a place on the diagonal, and a line across it.
    let correct = |middle: f64, across: f64| {
        let [low, high, across] = [-20.0, 20.0, across].map(|at| at + middle);
        let lines = [
            line([low, low], [low, high]),
            line([low, high], [high, high]),
            line([high, high], [high, low]),
            line([high, low], [low, low]),
            line([low, across], [high, across]),
        ];
        let lines = lines.concat();
        desk.write("logo.dxf", format!("0\nSECTION\n2\nENTITIES\n{lines}0\nENDSEC\n0\nEOF\n"));
        let words = "correct plate.xyz logo.dxf --out out.dxf --part-unit mm --part-up z --pattern-unit mm";
        desk.isomark(&words.split(' ').collect::<Vec<_>>())
    };
    for middle in [0.0, 100.0] {
        let refused = correct(middle, 2.5);
        refused.refused(1, &["off-surface"]);
        assert!(!refused.err.contains("--place 0,0"), "{}", refused.err);
    }
    correct(100.0, 7.5).refused(1, &["off-surface", "--place 0,0", "fits there"]);
    assert_eq!(correct(0.0, 7.5).code, 0);
}

fn desk(entities: &str) -> Desk {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    desk.write("logo.dxf", dxf(entities));
    desk
}

fn correct(desk: &Desk, options: &str) -> Output {
    let words = format!("correct plate.obj logo.dxf --out out.dxf {AS_DRAWN} {options}");
    desk.isomark(&words.split_whitespace().collect::<Vec<_>>())
}

#[test]
fn a_drawing_of_letters_in_no_font_names_them_and_what_to_do() {
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    let text = text("MARK");
    desk.write("logo.dxf", format!("0\nSECTION\n2\nENTITIES\n{text}0\nENDSEC\n0\nEOF\n"));
    correct(&desk, "").refused(
        1,
        &[
            "it contains only 1 TEXT, whose letter 株 is in no available font.",
            "what to do: Convert the text to outlines in the drawing program.",
        ],
    );
}

#[test]
fn lost_ink_refuses_the_drawing_with_a_list_and_the_remedy() {
    let desk = desk(&(text("MARK") + "0\n3DFACE\n5\n95\n8\nMARK\n10\n0\n20\n0\n"));
    let output = correct(&desk, "");
    output.refused(
        1,
        &[
            "2 visible entities cannot be marked",
            "TEXT 7E on layer MARK: its letter 株 is in no available font",
            "3DFACE 95 on layer MARK: it is a surface",
            "where:      logo.dxf, TEXT 7E, layer MARK",
            "number:     entities not marked 2",
            "hide their layer",
            "`losses = \"warn\"` under [pattern] (`--losses warn`)",
        ],
    );
    assert!(!desk.path("out.dxf").exists());
    let reason: Value = serde_json::from_str(&correct(&desk, "--json").out).unwrap();
    assert_eq!((&reason["code"], &reason["place"]["layer"]), (&"ink-lost".into(), &"MARK".into()));

    // The loss is in the report, too.
    let report = desk.correct("plate.obj", "logo.dxf", &format!("{AS_DRAWN} --losses warn"));
    assert!(notices(&report).contains(&"not-taken"));
    let lost = report["pattern"]["facts"]["not_taken"].as_array().unwrap();
    assert!(lost.len() == 2 && lost.iter().all(|skipped| skipped["is_ink"] == true), "{lost:?}");
    assert_eq!(report["output"]["paths"], 1);

    correct(&desk, "--losses perhaps").refused(2, &["`perhaps`", "--losses", "`refuse`", "`warn`"]);
}

#[test]
fn evaluate_and_inspect_report_lost_ink() {
    let desk = desk(&text("MARK"));
    let words = format!("evaluate plate.obj logo.dxf --method none {AS_DRAWN}");
    let words: Vec<&str> = words.split_whitespace().collect();
    desk.isomark(&words).refused(1, &["1 visible entity cannot be marked", "TEXT 7E"]);
    assert_eq!(desk.isomark(&[&words[..], &["--losses", "warn"]].concat()).code, 0);

    let inspect = |options: &[&str]| desk.isomark(&[&["inspect", "logo.dxf"], options].concat());
    let output = inspect(&[]);
    assert_eq!(output.code, 0);
    for words in [
        "LOST       TEXT 7E on layer MARK",
        "visible ink is lost",
        "`correct` and `watch` reject the drawing",
    ] {
        assert!(output.out.contains(words), "{words}: {}", output.out);
    }
    let facts: Value = serde_json::from_str(&inspect(&["--json"]).out).unwrap();
    assert!(notices(&facts).contains(&"ink-lost"));
    let output = inspect(&["--losses", "warn"]);
    assert!(output.out.contains("LOST       TEXT 7E") && !output.out.contains("reject"), "{}", output.out);
}

#[test]
fn hidden_entities_and_other_layers_do_not_refuse_a_drawing() {
    for layer in ["OFF", "NOPLOT", "COLD"] {
        let desk = desk(&text(layer));
        let report = desk.correct("plate.obj", "logo.dxf", AS_DRAWN);
        let skipped = &report["pattern"]["facts"]["not_taken"][0];
        assert_eq!((&skipped["layer"], &skipped["is_ink"]), (&layer.into(), &false.into()), "{skipped}");
    }
    let desk = desk(&text("NOTES"));
    correct(&desk, "").refused(1, &["TEXT 7E on layer NOTES"]);
    let report = desk.correct("plate.obj", "logo.dxf", &format!("{AS_DRAWN} --ink-layers mark"));
    assert!(notices(&report).contains(&"not-taken"));
    // On an ink layer the lost ink is the reason, not that the layer is empty.
    correct(&desk, "--ink-layers notes").refused(1, &["TEXT 7E on layer NOTES", "cannot be marked"]);
}

#[test]
fn vanishing_arcs_are_refused_and_full_turns_are_circles() {
    let arc = |end: &str| format!("0\nARC\n5\nA7\n8\nMARK\n10\n5\n20\n5\n40\n2\n50\n90\n51\n{end}\n");
    correct(&desk(&arc("90.000001")), "").refused(1, &["ARC A7 on layer MARK", "radius of 2.0000000 mm"]);
    let desk = desk(&arc("450.000001"));
    let report = desk.correct("plate.obj", "logo.dxf", &format!("{AS_DRAWN} --strict"));
    assert_eq!((&report["pattern"]["contours"], &report["output"]["paths"]), (&2.into(), &2.into()));
    let Some(judgement) = crate::ezdxf::judged(&desk.read("out.dxf")) else { return };
    let circle = &judgement["entities"][1];
    assert_eq!(circle["closed"], true);
    let points = circle["points"].as_array().unwrap();
    let angles = points.iter().map(|point| {
        let [x, y] = [0, 1].map(|axis| point[axis].as_f64().unwrap() - 5.0);
        assert!((x.hypot(y) - 2.0).abs() < 0.011, "{point}");
        y.atan2(x)
    });
    let mut angles: Vec<f64> = angles.collect();
    angles.sort_by(f64::total_cmp);
    let first = angles[0] + std::f64::consts::TAU;
    let gaps = angles.iter().zip(angles.iter().skip(1).chain([&first])).map(|(from, to)| to - from);
    assert!(gaps.fold(0.0, f64::max) < 0.5, "gap in the circle: {angles:?}");
}

#[test]
fn strict_reading_includes_the_area_of_contours_with_a_repeated_point() {
    let square = std::fs::read_to_string(drawing("square")).unwrap();
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    // The same square, open, with its first point again at its end.
    let again = "0\nLWPOLYLINE\n5\n50\n8\nMARK\n90\n5\n70\n0\n10\n0\n20\n0\n10\n10\n20\n0\n10\n10\n20\n10\n10\n0\n20\n10\n10\n0\n20\n0.000000000000001\n";
    let head = dxf("");
    let (before, after) = head.split_once("0\nLWPOLYLINE").unwrap();
    let after = &after[after.find("0\nENDSEC").unwrap()..];
    desk.write("again.dxf", format!("{before}{again}{after}"));
    desk.write("square.dxf", square);
    let strict = desk.correct("plate.obj", "again.dxf", &format!("{AS_DRAWN} --strict"));
    let repaired = desk.correct("plate.obj", "again.dxf", AS_DRAWN);
    assert_eq!(strict["quality"]["after"]["area_mm2"], repaired["quality"]["after"]["area_mm2"]);
    let area = strict["quality"]["after"]["area_mm2"].as_f64().unwrap();
    assert!((area - 100.0).abs() < 1e-6, "{area}");
    assert_eq!(strict["pattern"]["contours"], 1);
    assert!(!notices(&strict).contains(&"nearly-closed"));
}

#[test]
fn a_station_refuses_lost_ink_unless_sku_or_drawing_settings_allow_it() {
    let station = Station::new();
    let settings = station.desk.text("station.toml");
    station.desk.write("station.toml", settings + "[part]\nunit = \"mm\"\nup = \"z\"\n");
    station.desk.write("skus/loose.toml", "[pattern]\nlosses = \"warn\"\n");
    for sku in ["plate", "loose"] {
        station.desk.write(&format!("hot/{sku}.obj"), PLATE);
        station.desk.write(&format!("hot/{sku}@logo.dxf"), dxf(&text("MARK")));
    }
    station.desk.write("hot/plate@date.toml", "[pattern]\nlosses = \"warn\"\n");
    station.desk.write("hot/plate@date.dxf", dxf(&text("MARK")));
    station.desk.write("hot/loose@seal.toml", "[pattern]\nlosses = \"refuse\"\n");
    station.desk.write("hot/loose@seal.dxf", dxf(&text("MARK")));
    let output = station.once();
    assert!(output.out.starts_with("2 delivered, 2 parts fitted, 2 rejected"), "{output:?}");
    assert_eq!(station.import(), ["loose@logo.dxf", "plate@date.dxf"]);
    let rejected = files(&station.path("rejected"));
    for name in ["plate@logo.dxf", "loose@seal.dxf"] {
        assert!(rejected.contains(&name.to_owned()), "{rejected:?}");
        let reason = station.desk.text(&format!("rejected/{name}.reason.txt"));
        assert!(reason.contains("TEXT 7E on layer MARK") && reason.contains("losses = \"warn\""), "{reason}");
    }
    station.desk.write("skus/loose.toml", "[pattern]\nlosses = \"accept\"\n");
    station.desk.isomark(&["check", "station.toml"]).refused(2, &["loose.toml", "accept"]);
}

#[test]
fn lost_ink_is_recognised_in_drawings_by_ezdxf() {
    if !crate::ezdxf::is_available() {
        return;
    }
    let desk = Desk::new();
    desk.write("plate.obj", PLATE);
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/ezdxf/losses.py");
    let made = std::process::Command::new("python3").arg(script).arg(desk.root()).output().unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let drawings: Vec<String> =
        files(desk.root()).into_iter().filter(|name| name.ends_with(".dxf")).collect();
    assert!(drawings.len() >= 20, "{drawings:?}");
    for name in drawings {
        let words = format!("correct plate.obj {name} --out {name}.out {AS_DRAWN} --json");
        let output = desk.isomark(&words.split_whitespace().collect::<Vec<_>>());
        let answer: Value = serde_json::from_str(&output.out).unwrap();
        if name.starts_with("ink-") {
            assert_eq!((output.code, &answer["code"]), (1, &"ink-lost".into()), "{name}: {output:?}");
            assert!(output.err.contains("1 visible entity"), "{name}: {output:?}");
        } else {
            assert_eq!(output.code, 0, "{name}: {output:?}");
            assert_eq!(answer["pattern"]["facts"]["not_taken"].as_array().unwrap().len(), 1, "{name}");
        }
    }
}
