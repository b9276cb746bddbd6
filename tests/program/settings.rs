//! Settings on the command line: `--set`, and the options that are short forms of it.

use std::collections::BTreeSet;

use serde_json::Value;

use crate::desk::{Desk, Output, drawing, number, numbers, part};

/// Options of older versions, which still work.
const HIDDEN: &[&str] = &["--length-weight", "--angle-weight"];

const MOUSE: &str = "mouse/fc020-gui.glb";

const STATION: &str = "[station]\nname = \"L1\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 110\nheight_mm = 110\n";

/// Each option that is the short form of a setting, with a value that is refused and the limits of the setting.
const SHORT_FORMS: &[(&str, &str, &str, &[&str])] = &[
    ("--fill", "fill.spacing_mm", "20", &["0.005", "10"]),
    ("--tolerance", "correction.tolerance_mm", "10", &["0.0001", "1"]),
    ("--length-weight", "correction.length_weight", "0.01", &["0.1", "10"]),
    ("--angle-weight", "correction.angle_weight", "50", &["0.1", "10"]),
    ("--mapping-domain-grid", "correction.mapping_domain_grid", "1", &["2", "200"]),
    ("--mapping-domain-intervals", "correction.mapping_domain_intervals", "1002", &["2", "1000"]),
    ("--width", "pattern.width_mm", "0", &["0.01", "10000"]),
    ("--height", "pattern.height_mm", "20000", &["0.01", "10000"]),
    ("--threshold", "pattern.threshold_percent", "100", &["1", "99"]),
    ("--joining", "pattern.joining_mm", "2", &["0", "1"]),
    ("--hairline", "pattern.hairline_mm", "2", &["0", "1"]),
    ("--low-pass", "part.low_pass_mm", "0", &["0.1", "1000"]),
    ("--bridge", "part.bridge_mm", "101", &["0", "100"]),
    ("--roll", "part.roll_deg", "-400", &["-360", "360"]),
    ("--rotate", "placement.rotate_deg", "400", &["-360", "360"]),
    ("--place", "placement.place_mm", "[0, 1e6]", &[]),
    ("--anchor", "placement.anchor", "[-1e6, 0]", &[]),
    ("--method", "correction.method", "magic", &[]),
    ("--weighting", "correction.weighting", "heavy", &[]),
    ("--aim", "correction.aim", "far", &[]),
    ("--align", "placement.align", "crest", &[]),
    ("--vertices", "correction.vertices", "none", &[]),
    ("--floater-weights", "correction.floater_weights", "even", &[]),
    ("--part-unit", "part.unit", "furlong", &[]),
    ("--part-up", "part.up", "x", &[]),
    ("--normals", "part.normals", "smooth", &[]),
    ("--smoothing", "part.smoothing", "much", &[]),
    ("--losses", "pattern.losses", "ignore", &[]),
    ("--strokes", "pattern.strokes", "outline", &[]),
    ("--space", "pattern.space", "attic", &[]),
    ("--facing", "part.facing", "up", &[]),
    ("--frame", "part.frame", "0,0,0", &[]),
    ("--axis", "part.axis", "z", &[]),
    ("--overlap", "rotary.overlap_mm", "11", &["0", "10"]),
    ("--max-tile", "rotary.max_tile_deg", "0", &["1", "178"]),
    ("--tiles-as", "rotary.as", "pens", &[]),
    ("--ink-layers", "pattern.ink_layers", "", &[]),
    ("--mapping-domain-as-printed", "correction.mapping_domain_as_printed", "all", &[]),
    ("--pattern-unit", "pattern.unit_if_unitless", "furlong", &[]),
];

/// Options that are no setting, and switches and sizes, which the tests below take one by one.
const OTHERS: &[&str] = &[
    "--sku",
    "--station",
    "--cache",
    "--out",
    "--report",
    "--preview",
    "--on-part",
    "--report-html",
    "--frame-drawing",
    "--json",
    "--set",
    "--help",
    "--strict",
    "--invert",
    "--xyz",
    "--step-files",
    "--rotary",
    "--reverse",
    "--cylinder",
    "--cone",
    "--content",
    "--date",
    "--list",
    "--out-dir",
];

fn correct(desk: &Desk, options: &[&str]) -> Output {
    let (mouse, abc) = (part(MOUSE), drawing("abc"));
    let inputs = if options.iter().any(|option| option.contains("cylinder")) {
        vec![&abc]
    } else {
        vec![&mouse, &abc]
    };
    let inputs = inputs.into_iter().map(String::as_str);
    let arguments: Vec<&str> = ["correct"]
        .into_iter()
        .chain(inputs)
        .chain(["-o", "out.dxf", "--json"])
        .chain(options.iter().copied())
        .collect();
    desk.isomark(&arguments)
}

/// Code, words, number and remedy of a refusal.
fn refusal(output: &Output) -> [Value; 4] {
    assert_eq!(output.code, 2, "{output:?}");
    let reason: Value = serde_json::from_str(&output.out).unwrap();
    ["code", "what", "number", "remedy"].map(|key| reason[key].clone())
}

#[test]
fn an_option_and_its_setting_have_one_range() {
    let desk = Desk::new();
    let help = desk.isomark(&["correct", "--help"]).out;
    for (option, setting, value, limits) in SHORT_FORMS {
        let cylinder: &[&str] = if *option == "--axis" { &["--cylinder=73,180"] } else { &[] };
        let typed = value.trim_matches(['[', ']']);
        let by_option = correct(&desk, &[cylinder, &[option, typed]].concat());
        let list = option.contains("layers") || option.contains("as-printed");
        let by_set = if list {
            format!("{setting}=['{value}']").replace("['']", "[]")
        } else {
            format!("{setting}={value}")
        };
        let by_set = correct(&desk, &[cylinder, &["--set", &by_set]].concat());
        let (table, key) = setting.split_once('.').unwrap();
        let quoted = match value.parse::<f64>() {
            _ if list => format!("['{value}']").replace("['']", "[]"),
            Err(_) if !value.starts_with('[') => format!("'{value}'"),
            _ => value.to_string(),
        };
        desk.write("station.toml", format!("{STATION}[{table}]\n{key} = {quoted}\n"));
        if *option == "--axis" {
            desk.write(
                "station.toml",
                format!(
                    "{STATION}[part]\nshape = 'cylinder'\ndiameter_mm = 73\nlength_mm = 180\naxis = 'z'\n"
                ),
            );
        }
        let by_file = desk.isomark(&[
            "correct",
            "--json",
            "--station",
            "station.toml",
            &part(MOUSE),
            &drawing("abc"),
            "-o",
            "out.dxf",
        ]);
        if *option == "--ink-layers" {
            // An empty name is a layer's that no drawing has.
            assert_eq!(refusal(&by_set), refusal(&by_file));
            continue;
        }
        if *option == "--pattern-unit" {
            for output in [&by_option, &by_set, &by_file] {
                assert!(refusal(output)[1].as_str().unwrap().contains("furlong"), "{output:?}");
            }
        } else {
            assert_eq!(refusal(&by_option), refusal(&by_set), "{option}");
            // In a file, text has quotes and lists have brackets.
            let typed = |value: &Value| match value.as_str() {
                Some(text) => text.replace(['"', '[', ']'], "").replace(", ", ","),
                None => String::new(),
            };
            let [by_option, by_file] =
                [&by_option, &by_file].map(|output| refusal(output).map(|value| typed(&value)));
            assert_eq!(by_option, by_file, "{option}");
        }
        by_option.refused(2, &[&format!("where:      {option} {typed}")]);
        by_set.refused(2, &[&format!("where:      --set {setting}=")]);
        by_file.refused(2, &["where:      station.toml, line "]);
        let what = refusal(&by_option);
        let says = help.split("--").find(|text| format!("--{text}").starts_with(&format!("{option} ")));
        assert_eq!(says.is_none(), HIDDEN.contains(option), "{option}");
        for limit in *limits {
            assert!(what[3].as_str().unwrap().contains(limit), "{option}: {what:?}");
            assert!(
                says.is_none_or(|says| says.contains(limit)),
                "--help of {option} names {limit}: {says:?}"
            );
        }
        assert!(!desk.path("out.dxf").exists());
    }
    // No option is forgotten above.
    let known: BTreeSet<&str> =
        SHORT_FORMS.iter().map(|(option, ..)| *option).chain(OTHERS.iter().copied()).collect();
    let options: BTreeSet<&str> = help
        .lines()
        .filter_map(|line| line.trim_start().strip_prefix("-o, ").or(Some(line.trim_start())))
        .filter_map(|line| line.strip_prefix("-h, ").or(Some(line)))
        .filter(|line| line.starts_with("--"))
        .map(|line| line.split([' ', '[', '=']).next().unwrap())
        .chain(HIDDEN.iter().copied())
        .collect();
    assert_eq!(options, known);
}

#[test]
fn sizes_of_a_cylinder_have_one_range() {
    let desk = Desk::new();
    let shape =
        ["--set", "part.shape=cylinder", "--set", "part.length_mm=180", "--set", "part.diameter_mm=0"];
    let [option, set] = [correct(&desk, &["--cylinder", "0,180"]), correct(&desk, &shape)];
    assert_eq!(refusal(&option), refusal(&set));
    option.refused(2, &["where:      --cylinder 0,180", "from 0.1 to 10000 mm"]);
    // Sizes alone are a part, however they are given.
    let shape =
        ["--set", "part.shape=cylinder", "--set", "part.length_mm=180", "--set", "part.diameter_mm=73"];
    let report: Value = serde_json::from_str(&correct(&desk, &shape).out).unwrap();
    assert_eq!((&report["sku"], number(&report, "/map/radius_mm")), (&"cylinder".into(), 36.5));
}

#[test]
fn an_option_and_the_setting_it_stands_for_give_the_same_drawing() {
    let desk = Desk::new();
    let by = |options: &str| {
        let report = desk.correct(&part(MOUSE), &drawing("abc"), options);
        (desk.read("out.dxf"), report["placement"].clone())
    };
    let options =
        by("--place 0,8 --rotate 90 --tolerance .02 --method isometric --ink-layers OUTLINE,MARK --strict");
    assert_eq!(numbers(&options.1, "/place_mm"), [0.0, 8.0]);
    let settings = "--set placement.place_mm=0,8 --set placement.rotate_deg=90 --set correction.tolerance_mm=0.02 --set \
                    correction.method=isometric --set pattern.ink_layers=OUTLINE,MARK --set pattern.strict=true";
    assert_eq!(by(settings), options);
    assert_ne!(by("").0, options.0);
}

#[test]
fn the_command_line_overrides_the_station_and_its_skus() {
    let desk = Desk::new();
    desk.write("station.toml", format!("{STATION}[placement]\nplace_mm = [0, 8]\n"));
    desk.write("skus/fc020-gui.toml", "[placement]\nrotate_deg = 45\n");
    let job = |options: &str| {
        desk.correct(&part(MOUSE), &drawing("abc"), &format!("--station station.toml {options}"))
    };
    let report = job("");
    assert_eq!(
        (number(&report, "/placement/rotate_deg").round(), numbers(&report, "/placement/place_mm")),
        (45.0, vec![0.0, 8.0])
    );
    let report = job("--set placement.rotate_deg=90 --set output.dxf=R12");
    assert_eq!(
        (number(&report, "/placement/rotate_deg").round(), numbers(&report, "/placement/place_mm")),
        (90.0, vec![0.0, 8.0])
    );
    assert_eq!(report["output"]["dxf"], "R12");
    // The field is the station's, with one side from the command line.
    let output = correct(&desk, &["--station", "station.toml", "--set", "field.width_mm=20"]);
    output.refused(1, &["the field x -10.0 to 10.0"]);
    // Without a station it needs both sides.
    correct(&desk, &["--set", "field.width_mm=20"])
        .refused(2, &["`height_mm` is missing", "where:      --set field.width_mm=20"]);
}

#[test]
fn a_setting_is_given_once_and_where_it_has_an_effect() {
    let desk = Desk::new();
    correct(&desk, &["--tolerance", "0.02", "--set", "correction.tolerance_mm=0.05"]).refused(
        2,
        &[
            "`correction.tolerance_mm` is given twice",
            "`--tolerance 0.02`",
            "where:      --set correction.tolerance_mm=0.05",
            "what to do: Remove one",
        ],
    );
    for (setting, why) in [
        ("watch.settle_ms=5", "only `isomark watch` uses it"),
        ("folders.cache=x", "`--cache`"),
        ("station.name=x", "only a station has a name"),
        ("delivery.kind=beamserver", "only `isomark watch` uses it"),
        ("tolerance_mm=0.02", "Did you mean `correction.tolerance_mm`?"),
        ("corection.tolerance_mm=0.02", "Did you mean `correction.tolerance_mm`?"),
        ("correction.tolerance_mm", "as in correction.tolerance_mm=0.02"),
        ("=1", "as in correction.tolerance_mm=0.02"),
    ] {
        correct(&desk, &["--set", setting]).refused(2, &[why, "--set"]);
    }
    let evaluate =
        |setting: &str| desk.isomark(&["evaluate", &part(MOUSE), &drawing("abc"), "--set", setting]);
    for (setting, why) in [
        ("correction.method=cone", "`--method`"),
        ("correction.weighting=ink", "compares all choices"),
        ("correction.aim=areas", "compares all choices"),
        ("output.dxf=R12", "writes no drawing"),
        ("fixture.x_mm=3", "without field and lens"),
        ("log.keep=3", "only `isomark watch` uses it"),
    ] {
        evaluate(setting).refused(2, &["has no effect here", why, "what to do: Remove it"]);
    }
    let inspect = |setting: &str| desk.isomark(&["inspect", &part(MOUSE), "--set", setting]);
    inspect("placement.rotate_deg=3").refused(2, &["uses `part` and `pattern`"]);
    inspect("part.shape=cone").refused(2, &["reads a file"]);
    let output = inspect("part.unit=cm");
    assert!(output.code == 0 && output.out.contains("cm"), "{output:?}");
}

#[test]
fn a_station_is_checked_with_the_settings_of_the_command_line() {
    let desk = Desk::new();
    desk.write("station.toml", STATION);
    desk.write("elsewhere/x", "");
    let check = |settings: &[&str]| {
        let set = settings.iter().flat_map(|setting| ["--set", setting]);
        desk.isomark(&["check", "station.toml"].into_iter().chain(set).collect::<Vec<_>>())
    };
    check(&[]).refused(2, &["import folder import does not exist"]);
    let output = check(&["folders.import=elsewhere", "station.name=Line 2"]);
    assert!(
        output.code == 0 && output.out.starts_with("Line 2: ") && output.out.contains("elsewhere"),
        "{output:?}"
    );
    // A station delivers tiles as layers.
    desk.write("skus/can.toml", "[rotary]\nas = \"files\"\n");
    let output = check(&["folders.import=elsewhere"]);
    assert!(output.code == 0 && output.out.matches("[tiles-as-unused]").count() == 1, "{output:?}");
    assert!(output.out.contains("can.toml has no effect in a station"), "{output:?}");
    let output = check(&["folders.import=elsewhere", "rotary.as=files"]);
    assert!(output.out.contains("[rotary] in station.toml has no effect"), "{output:?}");
    assert_eq!(output.out.matches("[tiles-as-unused]").count(), 1, "{output:?}");
    desk.write("skus/can.toml", "[rotary]\nas = \"layers\"\n");
    check(&["watch.jobs=1"]).refused(
        2,
        &["`watch.jobs` cannot be 1 jobs", "where:      --set watch.jobs=1", "from 2 to 64 jobs"],
    );
    let page = [
        "folders.import=elsewhere",
        "page.address=0.0.0.0:4780",
        "page.other_computers=true",
        "page.password_file=pw",
    ];
    check(&page).refused(3, &["password file", "cannot be read", "8 characters"]);
    desk.write("pw", "abc\n");
    check(&page).refused(3, &["password file", "is too short", "8 characters"]);
    desk.write("pw", "abcdefgh\n");
    let open = check(&page);
    assert!(
        open.code == 0 && open.out.contains("http://localhost:4780/ on this computer, and at port 4780"),
        "{open:?}"
    );
    let named = check(&[&page[..], &["page.names=laser1"]].concat());
    assert!(named.out.contains("  page        http://laser1:4780/\n"), "{named:?}");
    check(&["folders.import=hot"]).refused(2, &["where:      --set folders.import=hot"]);
    let output = desk.isomark(&["watch", "station.toml", "--once", "--set", "folders.import=elsewhere"]);
    assert_eq!(output.code, 0, "{output:?}");
    desk.isomark(&["watch", "station.toml", "--once", "--set", "watch.settle=1"])
        .refused(2, &["Did you mean `watch.settle_ms`?"]);
}
