//! Station files, and the errors for mistakes in them.

use std::path::Path;
use std::time::Duration;

use super::*;
use crate::formats::mesh::LengthUnit;
use crate::formats::pattern::RasterOptions;
use crate::geometry::optics::Lens;
use crate::geometry::space::{FieldPoint, FlatPoint, ViewPoint};
use nalgebra::Point3;

const NEEDED: &str = r#"
[station]
name = "L1"
[folders]
hot = "drop/hot"
import = "../import"
[field]
width_mm = 100
height_mm = 80.5
"#;

fn parse(text: &str) -> Result<Station, ConfigError> {
    Station::parse(Path::new("line/station.toml"), text)
}

fn with(more: &str) -> Result<Station, ConfigError> {
    parse(&format!("{NEEDED}{more}"))
}

#[test]
fn a_short_file_is_enough_and_paths_start_at_it() {
    let station = parse(NEEDED).unwrap();
    assert_eq!(station.folders.hot, Path::new("line/drop/hot"));
    assert_eq!(station.folders.import, Path::new("import"));
    assert_eq!(station.folders.rejected, Path::new("line/rejected"));
    assert_eq!(station.settings.field.unwrap().height, 80.5);
    assert_eq!(station.watch, Watch::default());
    assert_eq!(with("[watch]\nbackend = \"poll\"").unwrap().watch.rescan, Duration::from_secs(1));
}

#[test]
fn files_have_degrees_and_settings_have_radians() {
    let more = "[fixture]\nz_mm = -2\nrotation_deg = 90\n[optics]\nkind = \"perspective\"\nlens_distance_x_mm = 300\n\
                lens_distance_y_mm = 285\naxis_mm = [3, -2]\nincidence_warn_deg = 45\n[placement]\nanchor = [1, 2.5]\nplace_mm = [0, 3]\n\
                rotate_deg = 180\n[part]\nfacing = [0, -2, 0]\nunit = \"inch\"";
    let settings = with(more).unwrap().settings;
    assert_eq!(settings.fixture.rotation, std::f64::consts::FRAC_PI_2);
    assert_eq!(settings.optics.lens, Lens::Perspective { x: 300.0, y: 285.0 });
    assert_eq!(settings.scan_head().axis, FieldPoint::new(3.0, -2.0));
    assert_eq!(settings.optics.incidence.warn, 45f64.to_radians());
    assert_eq!(settings.placement.anchor, Anchor::At(FlatPoint::new(1.0, 2.5)));
    assert_eq!(settings.placement.place, Some(ViewPoint::new(0.0, 3.0)));
    assert_eq!(settings.part.facing, parse_facing("-y").unwrap());
    assert_eq!(settings.part.unit, Some(LengthUnit::Inch));
}

#[test]
fn a_sku_overrides_key_by_key() {
    let station = with("[correction]\ntolerance_mm = 0.02\nmethod = \"isometric\"").unwrap();
    let file = Path::new("skus/a.toml");
    let settings = station.settings.overridden_by(file, "[correction]\nmethod = \"none\"").unwrap();
    assert_eq!((settings.correction.method, settings.correction.tolerance), (Method::None, 0.02));
    let station = with("[pattern]\nwidth_mm = 39\nheight_mm = 13\nthreshold_percent = 30").unwrap();
    let settings = station.settings.overridden_by(file, "[pattern]\nheight_mm = 5\ninvert = true").unwrap();
    let picture = RasterOptions { width: None, height: Some(5.0), threshold: 0.3, inverted: true };
    assert_eq!(settings.pattern.picture, picture, "one side for a SKU keeps the picture's shape");
    let error = station.settings.overridden_by(file, "[folders]\nhot = \"x\"").unwrap_err();
    assert!(matches!(error, ConfigError::UnknownKey { .. }), "{error}");
    assert!(error.to_string().contains("The table `[folders]` belongs in the station's file."), "{error}");
}

#[test]
fn the_tables_of_the_station_and_of_skus_are_all_tables() {
    let mut known: Vec<&str> =
        overrides::JOB_TABLES.iter().chain(overrides::STATION_TABLES).copied().collect();
    let mut all = station::keys_of(None);
    known.sort_unstable();
    all.sort_unstable();
    assert_eq!(known, all);
}

#[test]
fn a_table_of_a_sku_beside_a_drawing_is_refused_with_its_file() {
    let station = with("").unwrap();
    let beside = Path::new("hot/can@logo.toml");
    let error = station.settings.with_sidecar(beside, "[part]\nfacing = \"+x\"").unwrap_err().to_string();
    assert!(error.contains("The table `[part]` belongs in `skus/can.toml`. Move the table there"), "{error}");
}

/// The text after [`NEEDED`] (whose last line is 9), the error, and its place.
const MISTAKES: &[(&str, &str, u64, u64)] = &[
    ("[watch]\nsetle_ms = 1", "There is no key `setle_ms` here. Did you mean `settle_ms`?", 11, 1),
    (
        "[part]\ntolerance_mm = 1",
        "There is no key `tolerance_mm` here. Move `tolerance_mm` into [correction].",
        11,
        1,
    ),
    ("[correction]\nkind = \"perspective\"", "Move `kind` into [optics] or [delivery].", 11, 1),
    ("[pattern]\nwidth_mm = 0", "`pattern.width_mm` cannot be 0 mm. Give a number from 0.01", 11, 12),
    (
        "[optics]\naxis_mm = [0, 0]",
        "The axis of a telecentric lens has no effect. Set `kind = \"perspective\"`, or remove `axis_mm`.",
        11,
        11,
    ),
    (
        "[optics]\nkind = \"perspective\"\nlens_distance_x_mm = 300\n\
         lens_distance_y_mm = 285\naxis_mm = [1000, 0]",
        "The lens axis (1000, 0) mm is far outside the field, which is from (-50, -40.25) to (50, 40.25) mm",
        14,
        11,
    ),
    (
        "[content]\nserial = 9223372036854775807",
        "`content.serial` cannot be more than 9007199254740991. Give a number from 0 to 9007199254740991.",
        11,
        10,
    ),
    ("[optic]\nkind = 1", "There is no table `[optic]` here. Did you mean `[optics]`?", 10, 2),
    (
        "[correction]\nmethod = \"isometrc\"",
        "`isometrc` is not one of the choices. Did you mean `isometric`?",
        11,
        10,
    ),
    (
        "[correction]\nlength_weight = 50",
        "`correction.length_weight` cannot be 50 times. Give a number from 0.1",
        11,
        17,
    ),
    (
        "[correction]\ntolerance_mm = 5",
        "`correction.tolerance_mm` cannot be 5 mm. Give a number from 0.0001",
        11,
        16,
    ),
    ("[correction]\ntolerance_mm = nan", "cannot be NaN mm", 11, 16),
    (
        "[correction]\ntolerance_mm = \"0.5\"",
        "`tolerance_mm` needs a number, not text. Write `tolerance_mm = 0.5` without quotes.",
        11,
        16,
    ),
    ("[correction]\ntolerance_mm = \"much\"", "expected a number", 11, 16),
    (
        "[output]\ncomments = 'false'",
        "`comments` needs true or false, not text. Write `comments = false` without quotes.",
        11,
        12,
    ),
    ("[part]\n  facing = \"up\"", "names no side", 11, 12),
    ("[part]\nfacing = [0, 0, 0]", "names no side", 11, 10),
    ("[part]\nfacing = 3", "expected a name in quotes or a list", 11, 10),
    ("[placement]\nanchor = \"centre\"", "Did you mean `center`?", 11, 10),
    ("[placement]\nplace_mm = [0, 1e9]", "cannot be 1000000000 mm", 11, 12),
    ("[pattern]\nink_layers = []", "nothing would be marked", 11, 14),
    ("[optics]\nlens_distance_x_mm = 300", "has no lens distance", 11, 22),
    ("[optics]\nkind = \"perspective\"\nlens_distance_x_mm = 300", "`lens_distance_y_mm` is missing", 11, 8),
    ("[optics]\nincidence_warn_deg = 5", "are not in rising order", 11, 22),
    ("[output]\ndxf = \"R2004\"", "Did you mean `R2000`?", 11, 7),
    ("[watch]\nrescan_s = 0", "cannot be 0 s", 11, 12),
    ("[output]\ncomments = \"\\i\"", "forward slashes", 11, 14),
    ("[delivery]\nverify = -1", "`delivery.verify` cannot be -1 vertices. Give a number from 1", 11, 10),
    ("[delivery]\nverify = \"yes\"", "Give true, false, or the most vertices", 11, 10),
    ("[delivery]\nverify = 1.5", "neither true nor false nor a number of vertices", 11, 10),
    (
        "[retention]\nreports_days = 0",
        "`retention.reports_days` cannot be 0 days. Give a number from",
        11,
        16,
    ),
    ("[retention]\narchive_days = \"never\"", "or false to keep everything", 11, 16),
    ("[retention]\nrejected_days = true", "neither a number of days nor false", 11, 17),
    ("[retention]\nmax_gb = -1", "cannot be -1 GB", 11, 10),
    ("[part]\ndiameter_mm = 73", "has its sizes from the file", 11, 15),
    ("[part]\nshape = \"cylinder\"\nlength_mm = 9", "`diameter_mm` is missing", 11, 9),
    ("[part]\nshape = \"cone\"\ndiameter_mm = 9\nend_diameter_mm = 9\nlength_mm = 9", "must differ", 11, 9),
    (
        "[part]\nshape = \"cylinder\"\ndiameter_mm = 9\nlength_mm = 9\naxis = \"z\"",
        "names no direction",
        14,
        8,
    ),
    ("[part]\nshape = \"cylinder\"\ndiameter_mm = 9\nlength_mm = 9\nup = \"z\"", "no file is read", 14, 6),
    ("[correction]\nmapping_domain_intervals = 7", "needs an even number", 11, 28),
    ("[correction]\nmapping_domain_grid = 1", "cannot be 1", 11, 23),
    ("[correction]\nmapping_domain_as_printed = [\"simpson\"]", "not one of the choices", 11, 30),
];

#[test]
fn drawings_are_read_back_as_the_settings_state() {
    let applies = |text: &str| {
        let verify = with(&format!("[delivery]\n{text}")).unwrap().delivery.verify;
        [1, 35_000, 35_001, 10_000_000].map(|vertices| verify.applies_to(vertices))
    };
    assert_eq!(applies(""), [true, true, false, false]);
    assert_eq!(applies("verify = true"), [true; 4]);
    assert_eq!(applies("verify = false"), [false; 4]);
    assert_eq!(applies("verify = 0"), [false; 4]);
    assert_eq!(applies("verify = 1"), [true, false, false, false]);
}

#[test]
fn only_reports_and_rejected_drops_are_removed_by_default() {
    let days = |days: u64| Some(Duration::from_secs(days * 86_400));
    let given = |text: &str| {
        let Retention { reports, archive, rejected, largest } =
            with(&format!("[retention]\n{text}")).unwrap().retention;
        (reports, archive, rejected, largest)
    };
    assert_eq!(given(""), (days(365), None, days(365), None));
    let all = "reports_days = 30\narchive_days = 730.0\nrejected_days = false\nmax_gb = 1.5";
    assert_eq!(given(all), (days(30), days(730), None, Some(1_500_000_000)));
}

#[test]
fn a_sku_changes_one_size_of_a_primitive_or_uses_a_mesh_again() {
    let station = with(
        "[part]\nshape = \"cone\"\ndiameter_mm = 60\nend_diameter_mm = 85\nlength_mm = 120\naxis = \"x\"",
    )
    .unwrap();
    let sku = |text| station.settings.overridden_by(Path::new("skus/a.toml"), text);
    let primitive = sku("[part]\nend_diameter_mm = 80").unwrap().part.primitive.unwrap();
    assert_eq!((primitive.sizes(), primitive.axis().x), ([60.0, 80.0, 120.0], 1.0));
    assert_eq!(sku("[part]\nshape = \"mesh\"\nfacing = \"-y\"").unwrap().part.primitive, None);
    let error = sku("[part]\nshape = \"cylinder\"").unwrap_err();
    assert!(
        error.to_string().contains("`diameter_mm` is missing"),
        "a cone's sizes are not those of a cylinder: {error}"
    );
}

#[test]
fn mistakes_are_reported_with_place_and_remedy() {
    for (more, words, line, column) in MISTAKES {
        let error = with(more).expect_err(more);
        let reason = error.reason();
        assert!(error.to_string().contains(words), "{more}: {error}");
        assert_eq!((reason.place.line, reason.place.column), (Some(*line), Some(*column)), "{more}: {error}");
        assert_eq!(reason.place.file.as_deref(), Some("line/station.toml"));
        assert!(!reason.remedy.is_empty());
    }
}

#[test]
fn missing_keys_are_named() {
    let error = parse(&NEEDED.replace("import = \"../import\"\n", "")).unwrap_err();
    assert!(matches!(&error, ConfigError::Missing { key, .. } if key == "import"), "{error}");
    let error = parse("").unwrap_err();
    assert!(matches!(&error, ConfigError::Missing { key, .. } if key == "station"), "{error}");
    let error = parse(&NEEDED.replace("\"L1\"", "\" \"")).unwrap_err();
    assert!(error.to_string().contains("no readable name"), "{error}");
}

#[cfg(unix)]
#[test]
fn a_link_to_the_hot_folder_is_the_hot_folder() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("station.toml");
    fs_err::create_dir_all(folder.path().join("drop/hot")).unwrap();
    fs_err::os::unix::fs::symlink("drop", folder.path().join("link")).unwrap();
    let of = |import: &str| {
        let import = format!("import = \"{import}\"");
        fs_err::write(&file, NEEDED.replace("import = \"../import\"", &import)).unwrap();
        Station::load(&file).map_err(|error| error.to_string())
    };
    for import in ["link/hot", "link/hot/to come"] {
        let told = of(import).unwrap_err();
        assert!(told.contains(" or is the same."), "{told}");
    }
    assert!(of("link/import").is_ok());
}

#[test]
fn folders_keep_out_of_each_other() {
    for (folders, words) in [
        ("import = \"drop/hot\"", "is the same"),
        ("import = \"drop/hot/../hot/./x\"", "`import` is in the folder `hot`"),
        ("import = \"i\"\nreports = \"i/reports\"", "`reports` is in the folder `import`"),
        ("import = \"i\"\narchive = \".\"", "`archive` contains the folder `hot`"),
        ("import = \"i\"\nreports = \"a\"\narchive = \"a\"", "are the same"),
    ] {
        let error = parse(&NEEDED.replace("import = \"../import\"", folders)).expect_err(folders);
        assert!(error.to_string().contains(words), "{folders}: {error}");
    }
}

#[test]
fn a_broken_edit_keeps_the_previous_settings_and_is_reported_once() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("station.toml");
    let sku: Sku = "Can-500".parse().unwrap();
    fs_err::write(&file, NEEDED).unwrap();
    fs_err::create_dir(folder.path().join("skus")).unwrap();
    let sku_file = folder.path().join("skus/can-500.toml");
    fs_err::write(&sku_file, "[placement]\nrotate_deg = 90").unwrap();

    let mut live = LiveSettings::open(&file).unwrap().at_once();
    assert!(live.job(&sku).unwrap().placement.rotate > 1.5);

    fs_err::write(&file, NEEDED.replace("width_mm", "widht_mm")).unwrap();
    fs_err::write(&sku_file, "[placement]\nrotate_deg = ").unwrap();
    for expected in [2, 0] {
        live.refresh();
        assert_eq!(live.station().name, "L1");
        assert!(live.job(&sku).unwrap().placement.rotate > 1.5);
        let events = live.take_events();
        assert!(
            events.iter().all(|event| matches!(event, SettingsEvent::Broken { old_stay: true, .. })),
            "{events:?}"
        );
        assert_eq!(events.len(), expected);
    }

    fs_err::write(&file, NEEDED).unwrap();
    fs_err::write(&sku_file, "[placement]\nrotate_deg = 90").unwrap();
    live.refresh();
    live.refresh_skus();
    assert!(matches!(live.take_events()[..], [SettingsEvent::Mended(_), SettingsEvent::Mended(_)]));

    fs_err::write(&file, NEEDED.replace("L1", "L2")).unwrap();
    live.refresh();
    assert_eq!(live.station().name, "L2");
    assert!(matches!(live.take_events()[..], [SettingsEvent::StationChanged { .. }]));
}

#[test]
fn a_sku_file_that_was_never_valid_has_no_previous_settings() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("station.toml");
    fs_err::write(&file, NEEDED).unwrap();
    fs_err::create_dir(folder.path().join("skus")).unwrap();
    let mut live = LiveSettings::open(&file).unwrap().at_once();
    live.refresh_skus();
    fs_err::write(folder.path().join("skus/can.toml"), "[placement]\nrotate_deg = ").unwrap();
    live.refresh_skus();
    assert!(matches!(live.take_events()[..], [SettingsEvent::Broken { old_stay: false, .. }]));
    assert_eq!(live.complaints().count(), 1);
    fs_err::remove_file(folder.path().join("skus/can.toml")).unwrap();
    live.refresh_skus();
    assert_eq!(live.complaints().count(), 0);
    assert!(
        matches!(&live.take_events()[..], [SettingsEvent::BrokenRemoved { sku, .. }] if sku.as_str() == "can")
    );
}

#[test]
fn a_broken_file_that_is_replaced_by_a_valid_one_is_valid_again() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("station.toml");
    fs_err::write(&file, NEEDED).unwrap();
    fs_err::create_dir(folder.path().join("skus")).unwrap();
    let sku_file = folder.path().join("skus/can.toml");
    let mut live = LiveSettings::open(&file).unwrap().at_once();
    live.refresh_skus();
    fs_err::write(&sku_file, "[placement]\nrotate_deg = ").unwrap();
    live.refresh_skus();
    live.take_events();
    fs_err::write(&sku_file, "[placement]\nrotate_deg = 90").unwrap();
    live.refresh_skus();
    assert!(matches!(live.take_events()[..], [SettingsEvent::Mended(_), SettingsEvent::SkuChanged { .. }]));
}

/// Editors and copies empty a file before they write it, and half a file may be valid settings.
#[test]
fn settings_that_may_still_be_written_are_not_used_yet() {
    let folder = tempfile::tempdir().unwrap();
    let [file, sku_file] = ["station.toml", "skus/can.toml"].map(|name| folder.path().join(name));
    let sku: Sku = "can".parse().unwrap();
    let write = |file: &Path, text: &str, age: u64| {
        fs_err::write(file, text).unwrap();
        let file = fs_err::OpenOptions::new().write(true).open(file).unwrap();
        file.file().set_modified(std::time::SystemTime::now() - Duration::from_secs(age)).unwrap();
    };
    fs_err::create_dir(folder.path().join("skus")).unwrap();
    write(&file, &NEEDED.replace("[field]", "[watch]\nsettle_ms = 5000\n[field]"), 60);
    write(&sku_file, "[placement]\nrotate_deg = 90", 60);
    let mut live = LiveSettings::open(&file).unwrap();
    let is_saved = |live: &mut LiveSettings| matches!(live.job(&sku), Err(ConfigError::BeingSaved { .. }));
    let turn = |live: &mut LiveSettings| live.job(&sku).unwrap().placement.rotate.to_degrees().round();
    assert_eq!(turn(&mut live), 90.0);
    for (text, age, expected) in [
        ("[placement]\nrotate_deg = 4", 1, None),
        ("[placement]\nrotate_deg = 45", 1, None),
        ("[placement]\nrotate_deg = 45", 6, Some(45.0)),
        ("", 6, None),
        ("[placement]\nrotate_deg = 30", 6, Some(30.0)),
        ("", 11, Some(0.0)),
    ] {
        write(&sku_file, text, age);
        match expected {
            None => assert!(is_saved(&mut live), "{text} {age}"),
            Some(expected) => assert_eq!(turn(&mut live), expected, "{text} {age}"),
        }
    }
    assert_eq!(live.take_events().len(), 3);

    // Meanwhile the station's own file holds up all jobs.
    write(&file, &NEEDED.replace("L1", "L2"), 1);
    live.refresh();
    assert!(live.station().name == "L1" && is_saved(&mut live));
    write(&file, &NEEDED.replace("L1", "L2"), 6);
    live.refresh();
    assert!(live.station().name == "L2" && !is_saved(&mut live));
}

/// A station that is started a moment after its files were made checks them when they have settled.
#[test]
fn a_sku_file_that_was_there_at_the_start_did_not_change() {
    let folder = tempfile::tempdir().unwrap();
    let [file, sku_file, late] =
        ["station.toml", "skus/can.toml", "skus/mug.toml"].map(|name| folder.path().join(name));
    let age = |file: &Path, age: u64| {
        let file = fs_err::OpenOptions::new().write(true).open(file).unwrap();
        file.file().set_modified(std::time::SystemTime::now() - Duration::from_secs(age)).unwrap();
    };
    fs_err::create_dir(folder.path().join("skus")).unwrap();
    fs_err::write(&file, NEEDED.replace("[field]", "[watch]\nsettle_ms = 5000\n[field]")).unwrap();
    fs_err::write(&sku_file, "[placement]\nrotate_deg = 90").unwrap();
    let mut live = LiveSettings::open(&file).unwrap();
    live.refresh_skus();
    age(&sku_file, 6);
    live.refresh_skus();
    let turn = live.job(&"can".parse().unwrap()).unwrap().placement.rotate.to_degrees();
    assert_eq!((turn.round(), live.take_events().len()), (90.0, 0));
    // A file that is made later is news, and so is one that was removed and is back.
    fs_err::write(&late, "[placement]\nrotate_deg = 90").unwrap();
    age(&late, 6);
    live.refresh_skus();
    assert!(matches!(&live.take_events()[..], [SettingsEvent::SkuChanged { old, .. }] if old.is_empty()));
    fs_err::remove_file(&sku_file).unwrap();
    (0..2).for_each(|_| live.refresh_skus());
    fs_err::write(&sku_file, "[placement]\nrotate_deg = 90").unwrap();
    age(&sku_file, 6);
    live.refresh_skus();
    assert!(
        matches!(&live.take_events()[..], [SettingsEvent::SkuChanged { .. }, SettingsEvent::SkuChanged { old, .. }] if old.is_empty())
    );
}

/// An editor that saves, a checkout or a share that drops for a moment must not turn a SKU's settings into the
/// station's.
#[test]
fn sku_settings_that_vanish_for_a_moment_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("station.toml");
    let sku: Sku = "can".parse().unwrap();
    let [skus, away] = ["skus", "away"].map(|name| folder.path().join(name));
    fs_err::write(&file, NEEDED).unwrap();
    fs_err::create_dir(&skus).unwrap();
    fs_err::write(skus.join("can.toml"), "[placement]\nrotate_deg = 90").unwrap();
    let mut live = LiveSettings::open(&file).unwrap().at_once();
    let is_turned = |live: &mut LiveSettings| live.job(&sku).unwrap().placement.rotate > 1.5;
    assert!(is_turned(&mut live));

    fs_err::rename(&skus, &away).unwrap();
    for expected in [1, 0] {
        live.refresh_skus();
        assert!(is_turned(&mut live));
        assert_eq!(live.take_events().len(), expected, "the missing folder is reported once");
    }
    let reason = LiveSettings::open(&file).unwrap().job(&sku).unwrap_err().reason();
    assert_eq!(
        reason.what, "The folder of the SKU files does not exist.",
        "a job waits when no previous settings are known"
    );
    assert!(reason.remedy.contains("drawings of a SKU whose file was not read before wait"), "{reason}");
    fs_err::rename(&away, &skus).unwrap();
    live.refresh_skus();
    assert!(matches!(live.take_events()[..], [SettingsEvent::Mended(_)]));

    fs_err::remove_file(skus.join("can.toml")).unwrap();
    live.refresh_skus();
    assert!(is_turned(&mut live));
    live.refresh_skus();
    assert!(!is_turned(&mut live), "two listings in a row did not find it");
    assert!(matches!(live.take_events()[..], [SettingsEvent::SkuChanged { .. }]));
}

/// Names that differ only in case are one file on some systems; in how accents are composed, they are two on all common ones.
#[test]
fn two_files_for_one_sku_are_a_mistake_and_keep_the_previous_settings() {
    for (name, twin) in [("can.toml", "Can.toml"), ("k\u{e4}.toml", "ka\u{308}.toml")] {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("station.toml");
        let sku: Sku = Path::new(name).file_stem().unwrap().to_str().unwrap().parse().unwrap();
        fs_err::write(&file, NEEDED).unwrap();
        let skus = folder.path().join("skus");
        fs_err::create_dir(&skus).unwrap();
        fs_err::write(skus.join(name), "[placement]\nrotate_deg = 90").unwrap();
        fs_err::write(skus.join(twin), "[placement]\nrotate_deg = 10").unwrap();
        if fs_err::read_dir(&skus).unwrap().count() == 1 {
            continue;
        }
        // Nothing was used before: a command refuses, and a job waits.
        let mut live = LiveSettings::open(&file).unwrap().at_once();
        let reason = live.job(&sku).unwrap_err().reason();
        assert_eq!(
            (reason.code.as_str(), reason.remedy.as_str()),
            ("settings-twice", "Keep one of the two files.")
        );
        live.refresh_skus();
        assert!(matches!(live.take_events()[..], [SettingsEvent::Broken { old_stay: false, .. }]));
        assert_eq!(live.complaints().count(), 1);
        fs_err::remove_file(skus.join(twin)).unwrap();
        live.refresh_skus();
        assert!(matches!(live.take_events()[..], [SettingsEvent::Mended(_)]));
        let turn = |live: &mut LiveSettings| live.job(&sku).unwrap().placement.rotate.to_degrees().round();
        assert_eq!((live.complaints().count(), turn(&mut live)), (0, 90.0));

        fs_err::write(skus.join(twin), "[placement]\nrotate_deg = 10").unwrap();
        for expected in [1, 0] {
            live.refresh_skus();
            assert_eq!(turn(&mut live), 90.0);
            let events = live.take_events();
            assert!(events.iter().all(|event| matches!(event, SettingsEvent::Broken { old_stay: true, .. })));
            assert_eq!((live.complaints().count(), events.len()), (1, expected));
        }
        fs_err::remove_file(skus.join(name)).unwrap();
        live.refresh_skus();
        assert_eq!((live.complaints().count(), turn(&mut live)), (0, 10.0));
        let events = live.take_events();
        assert!(
            matches!(events[..], [SettingsEvent::Mended(_), SettingsEvent::SkuChanged { .. }]),
            "{events:?}"
        );
    }
}

#[test]
fn the_folders_of_a_broken_station_file_are_known() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("station.toml");
    fs_err::write(&file, NEEDED).unwrap();
    let whole = Station::load(&file).unwrap().folders;
    let of = |text: &str| {
        fs_err::write(&file, text).unwrap();
        assert!(Station::load(&file).is_err(), "{text}");
        FolderPaths::of_broken(&file, &Overrides::default())
    };
    assert_eq!(of(&NEEDED.replace("width_mm", "widht_mm")), Some(whole.clone()));
    assert_eq!(of(&format!("{NEEDED}\n[watch]\nsettle_ms = \n")), Some(whole));
    assert_eq!(of("[folders\n"), None);
    assert_eq!(of(&NEEDED.replace("import = \"../import\"\n", "")), None);
}

#[test]
fn a_sku_file_that_was_never_valid_is_an_error_for_its_jobs_only() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("station.toml");
    fs_err::write(&file, NEEDED).unwrap();
    fs_err::create_dir(folder.path().join("skus")).unwrap();
    fs_err::write(folder.path().join("skus/bad.toml"), "[part]\nfacng = 1").unwrap();
    let mut live = LiveSettings::open(&file).unwrap().at_once();
    assert!(live.job(&"bad".parse().unwrap()).unwrap_err().to_string().contains("`facing`"));
    assert!(live.job(&"good".parse().unwrap()).is_ok());
}

/// They would depend on the drive and the folder in which each command is started.
#[cfg(windows)]
#[test]
fn paths_are_absolute_or_relative_to_their_file() {
    for path in ["C:laser", "\\laser", "/laser"] {
        for (key, text) in [
            ("hot", NEEDED.replace("\"drop/hot\"", &format!("'{path}'"))),
            ("archive", NEEDED.replace("[field]", &format!("archive = '{path}'\n[field]"))),
            ("file", format!("{NEEDED}[log]\nfile = '{path}'\n")),
        ] {
            let error = parse(&text).unwrap_err();
            let line = text.lines().position(|line| line.starts_with(key)).unwrap() as u64 + 1;
            assert_eq!(error.reason().place.line, Some(line), "{error}");
            assert!(error.to_string().contains("depends on where the program is started"), "{error}");
        }
    }
    for path in ["C:\\laser", "\\\\server\\share\\laser"] {
        let station = parse(&NEEDED.replace("\"drop/hot\"", &format!("'{path}'"))).unwrap();
        assert_eq!(station.folders.hot, Path::new(path));
    }
}

/// Names and values of settings, as people type them.
type Typed = &'static [(&'static str, &'static str)];

const CODES: &str = "[{ layer = 'DM', kind = 'data-matrix', content = '{serial:06}', quiet_zone = 2 }]";
const SHIFTS: &str = "[{ name = 'early', from = '06:00' }, { name = 'late', from = '14:00' }]";

/// Every setting with a value that is not the usual one, as people type it, and what else it needs.
const SETTINGS: &[(&str, &str, Typed)] = &[
    ("content.bad_rows", "skip", &[]),
    ("content.codes", CODES, &[]),
    ("content.csv", "{ LOT = 'A7' }", &[]),
    ("content.date", "2026-11-23", &[]),
    ("content.serial", "17", &[]),
    ("content.shift", "late", &[]),
    ("content.shifts", SHIFTS, &[]),
    ("correction.aim", "areas", &[]),
    ("correction.angle_weight", "2", &[]),
    ("correction.floater_weights", "mean-value", &[]),
    ("correction.length_weight", "0.5", &[]),
    ("correction.mapping_domain_as_printed", "simpson-weights,knot-vectors", &[]),
    ("correction.mapping_domain_grid", "10", &[]),
    ("correction.mapping_domain_intervals", "20", &[]),
    ("correction.max_residual_mm", "0.2", &[]),
    ("correction.method", "cone", &[]),
    ("correction.tolerance_mm", "0.02", &[]),
    ("correction.vertices", "keep", &[]),
    ("correction.weighting", "uniform", &[]),
    ("delivery.address", "laser-pc:11350", &[]),
    ("delivery.answer_s", "5", &[]),
    ("delivery.kind", "beamserver", &[]),
    ("delivery.outdated", "correct", &[]),
    ("delivery.repeat", "never", &[]),
    ("delivery.server_folder", r"Z:\import", &[]),
    ("delivery.verify", "true", &[]),
    ("field.height_mm", "70", &[]),
    ("field.origin", "corner", &[]),
    ("field.width_mm", "70", &[]),
    ("fill.angle_deg", "45", &[("fill.spacing_mm", "0.1")]),
    ("fill.border_mm", "0.1", &[]),
    ("fill.layers", "LOGO", &[]),
    ("fill.second_angle_deg", "90", &[]),
    ("fill.spacing_mm", "0.1", &[]),
    ("fixture.rotation_deg", "90", &[]),
    ("fixture.uncertainty_deg", "0.1", &[]),
    ("fixture.uncertainty_mm", "0.2", &[]),
    ("fixture.uncertainty_z_mm", "0.3", &[]),
    ("fixture.x_mm", "-3", &[]),
    ("fixture.y_mm", "+3", &[]),
    ("fixture.z_mm", ".5", &[]),
    ("fleet.certificate", "plant-ca.pem", FLEET),
    ("fleet.lines", "cups,mugs", FLEET),
    ("fleet.local_settings", "allow", FLEET),
    ("fleet.name", "laser 2", FLEET),
    ("fleet.password_file", "secret.txt", FLEET),
    ("fleet.password_variable", "SECRET", FLEET),
    ("fleet.url", "postgresql://laser2@db.shop.local/isomark", &[]),
    ("fleet.workers", "true", FLEET),
    ("focus.overlap_mm", "0.2", &[]),
    ("focus.step_mm", "2", &[]),
    ("focus.steps", "layers", &[("focus.step_mm", "2")]),
    ("folders.archive", "done", &[]),
    ("folders.cache", "surfaces", &[]),
    ("folders.hot", "drops", &[]),
    ("folders.import", "to laser", &[]),
    ("folders.rejected", "bad", &[]),
    ("folders.reports", "2026", &[]),
    ("folders.skus", "products", &[]),
    ("folders.state", "memory", &[]),
    ("log.file", "station.log", &[]),
    ("log.keep", "2", &[("log.file", "station.log")]),
    ("log.max_mb", "2", &[("log.file", "station.log")]),
    ("optics.axis_mm", "3,-2", PERSPECTIVE),
    ("optics.focus_depth_mm", "4", &[]),
    ("optics.incidence_note_deg", "10", &[]),
    ("optics.incidence_refuse_deg", "70", &[]),
    ("optics.incidence_warn_deg", "40", &[]),
    (
        "optics.kind",
        "perspective",
        &[("optics.lens_distance_x_mm", "300"), ("optics.lens_distance_y_mm", "300")],
    ),
    (
        "optics.lens_distance_x_mm",
        "250",
        &[("optics.kind", "perspective"), ("optics.lens_distance_y_mm", "300")],
    ),
    (
        "optics.lens_distance_y_mm",
        "250",
        &[("optics.kind", "perspective"), ("optics.lens_distance_x_mm", "300")],
    ),
    ("optics.shadow_mm", "0.5", &[]),
    ("optics.spot_mm", "0.04", &[]),
    ("optics.table", "../tests/data/lens.csv", &[]),
    ("output.comments", "false", &[]),
    ("output.dxf", "R12", &[]),
    ("page.address", "127.0.0.1:4781", &[]),
    ("page.names", "laser1.shop.local,10.0.0.7:8080", OPEN_PAGE),
    (
        "page.other_computers",
        "true",
        &[("page.address", "127.0.0.1:4781"), ("page.password_file", "secret.txt")],
    ),
    ("page.password_file", "secret.txt", &[("page.address", "localhost:4781")]),
    ("page.password_variable", "SECRET", &[("page.address", "localhost:4781")]),
    ("part.axis", "x", CYLINDER),
    ("part.bridge_mm", "1", &[]),
    ("part.converter", "freecad", &[]),
    ("part.diameter_mm", "73", &[("part.shape", "cylinder"), ("part.length_mm", "180")]),
    (
        "part.end_diameter_mm",
        "80",
        &[("part.shape", "cone"), ("part.length_mm", "180"), ("part.diameter_mm", "73")],
    ),
    ("part.facing", "-y", &[]),
    ("part.frame", "0,-36.5,60 0,-1,0 1,0,0", &[]),
    ("part.length_mm", "180", &[("part.shape", "cylinder"), ("part.diameter_mm", "73")]),
    ("part.low_pass_mm", "5", &[]),
    ("part.normals", "facets", &[]),
    ("part.roll_deg", "-90", &[]),
    ("part.shape", "cylinder", &[("part.length_mm", "180"), ("part.diameter_mm", "73")]),
    ("part.smoothing", "none", &[]),
    ("part.unit", "inch", &[]),
    ("part.up", "y", &[]),
    ("pattern.hairline_mm", "0.1", &[]),
    ("pattern.height_mm", "13", &[]),
    ("pattern.ink_layers", "MARK", &[]),
    ("pattern.invert", "true", &[]),
    ("pattern.joining_mm", "0", &[]),
    ("pattern.losses", "warn", &[]),
    ("pattern.overlap_mm", "2", &[]),
    ("pattern.space", "paper:Sheet A", &[]),
    ("pattern.strict", "true", &[]),
    ("pattern.strokes", "band", &[]),
    ("pattern.threshold_percent", "30", &[]),
    ("pattern.unit_if_unitless", "px", &[]),
    ("pattern.width_mm", "39", &[]),
    ("placement.align", "axis", &[]),
    ("placement.anchor", "origin", &[]),
    ("placement.outside_mark", "warn", &[]),
    ("placement.place_mm", "[0, 60]", &[]),
    ("placement.rotate_deg", "90", &[]),
    ("retention.archive_days", "730", &[]),
    ("retention.max_gb", "50", &[]),
    ("retention.rejected_days", "false", &[]),
    ("retention.reports_days", "30", &[]),
    ("rotary.as", "files", &[]),
    ("rotary.max_tile_deg", "40", &[]),
    ("rotary.overlap_mm", "0.3", &[]),
    ("rotary.reverse", "true", &[]),
    ("rotary.tiles", "auto", &[]),
    ("route.rules", "[{ sku = 'mug-*', line = 'laser1' }]", FLEET),
    ("serial.last", "99", &[]),
    ("serial.start", "5", &[]),
    ("serial.step", "2", &[]),
    ("station.name", "2", &[]),
    ("watch.backend", "native", &[]),
    ("watch.incomplete_s", "60", &[]),
    ("watch.jobs", "3", &[]),
    ("watch.open_ended_s", "30", &[]),
    ("watch.rescan_s", "1", &[]),
    ("watch.settle_ms", "100", &[]),
];

const FLEET: Typed = &[("fleet.url", "postgresql://laser2@db.shop.local/isomark")];
const OPEN_PAGE: Typed = &[
    ("page.address", "0.0.0.0:4781"),
    ("page.other_computers", "true"),
    ("page.password_file", "secret.txt"),
];
const PERSPECTIVE: Typed = &[
    ("optics.kind", "perspective"),
    ("optics.lens_distance_x_mm", "300"),
    ("optics.lens_distance_y_mm", "300"),
];
const CYLINDER: Typed = &[("part.shape", "cylinder"), ("part.diameter_mm", "73"), ("part.length_mm", "180")];

fn given<'a>(settings: impl IntoIterator<Item = &'a (&'a str, &'a str)>) -> Result<Overrides, ConfigError> {
    let mut overrides = Overrides::default();
    for (name, value) in settings {
        overrides.add(&format!("--set {name}={value}"), name, value)?;
    }
    Ok(overrides)
}

fn with_given(text: &str, settings: &[(&str, &str)]) -> Result<Station, ConfigError> {
    Station::parse_with(Path::new("line/station.toml"), text, &given(settings)?)
}

#[test]
fn every_setting_of_the_files_can_be_given_on_the_command_line() {
    let names: Vec<&str> = SETTINGS.iter().map(|(name, ..)| *name).collect();
    assert_eq!(names, setting_names(), "the table above names every setting");
    // The annotated station is written by hand, and shows every setting, some of them commented out.
    let mut annotated = Vec::new();
    let mut table = "";
    for line in include_str!("../../watch-config/station.toml").lines() {
        let line = line.trim_start_matches("# ");
        let key = line.split_once(" = ").map(|(key, _)| key).filter(|key| !key.contains([' ', '.']));
        if let Some((name, "")) = line.strip_prefix('[').and_then(|line| line.split_once(']')) {
            table = name;
        } else if let Some(key) = key {
            annotated.push(format!("{table}.{key}"));
        }
    }
    annotated.sort();
    assert_eq!(annotated, setting_names(), "watch-config/station.toml shows every setting");
    // Given on the command line a setting changes the station as it does in the file, and over the file.
    for (name, value, needs) in SETTINGS {
        let usual = with_given(NEEDED, needs).ok();
        let changed = with_given(NEEDED, &[&[(*name, *value)], *needs].concat());
        let changed = changed.unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_ne!(Some(&changed), usual.as_ref(), "{name} changes nothing");
        let tables = toml::to_string(&changed_file(&[&[(*name, *value)], *needs].concat())).unwrap();
        assert_eq!(parse(&tables).unwrap(), changed, "{name}");
        let over = with_given(&tables, &[&[(*name, *value)], *needs].concat()).unwrap();
        assert_eq!(over, changed, "{name}");
    }
}

/// The short station with settings written into it, with quotes and brackets as a file needs them.
fn changed_file(settings: &[(&str, &str)]) -> toml::Table {
    let mut file: toml::Table = NEEDED.parse().unwrap();
    for (name, value) in settings {
        let (table, key) = name.split_once('.').unwrap();
        let table = file.entry(table).or_insert(toml::Table::new().into()).as_table_mut().unwrap();
        let list = |items: Vec<toml::Value>| toml::Value::Array(items);
        let text = |text: &str| toml::Value::String(text.into());
        let value = match (*name, *value) {
            ("correction.mapping_domain_as_printed" | "page.names" | "fleet.lines", items) => {
                list(items.split(',').map(text).collect())
            }
            ("content.codes" | "content.shifts" | "content.csv" | "route.rules", value) => {
                value.parse().unwrap()
            }
            ("pattern.ink_layers" | "fill.layers", item) => list(vec![text(item)]),
            ("placement.place_mm", _) => list(vec![0.into(), 60.into()]),
            ("optics.axis_mm", _) => list(vec![3.into(), (-2).into()]),
            ("station.name" | "folders.reports", name) => text(name),
            ("content.date", date) => text(date),
            (_, "true" | "false") => (*value == "true").into(),
            (_, value) => value.parse().map_or_else(|_| text(value), toml::Value::Integer),
        };
        let value = match (*name, value.as_str()) {
            ("fixture.y_mm", _) => 3.into(),
            (_, Some(number))
                if number.parse::<f64>().is_ok() && *name != "station.name" && *name != "folders.reports" =>
            {
                number.parse::<f64>().unwrap().into()
            }
            _ => value,
        };
        table.insert(key.into(), value);
    }
    file
}

#[test]
fn a_setting_of_the_command_line_is_refused_as_in_a_file_with_the_option_as_its_place() {
    for (name, value, words) in [
        (
            "correction.tolerance_mm",
            "20",
            "`correction.tolerance_mm` cannot be 20 mm. Give a number from 0.0001 to 1 mm.",
        ),
        ("correction.tolerance_mm", "much", "expected a number"),
        ("correction.tolerance_mm", "'0.1'", "expected a number"),
        (
            "correction.tolernace_mm",
            "1",
            "no setting `correction.tolernace_mm`. Did you mean `correction.tolerance_mm`?",
        ),
        ("corection.tolerance_mm", "1", "Did you mean `correction.tolerance_mm`?"),
        ("tolerance_mm", "1", "Give table.key=value. Did you mean `correction.tolerance_mm`?"),
        ("tolerance", "1", "Give table.key=value. Did you mean `correction.tolerance_mm`?"),
        ("correction.tol", "1", "Did you mean `correction.tolerance_mm`?"),
        ("wacht.on", "1", "no setting `wacht.on`. Use one of: `station`, `folders`"),
        ("part.unit", "inches", "Did you mean `inch`?"),
        ("part.unit", "5", "`5` is not one of the choices. Use one of: `mm`"),
        ("part.facing", "up", "`up` names no side of the part"),
        ("pattern.strict", "yes", "expected true or false"),
        ("placement.place_mm", "nonsense", "expected two numbers, such as 12.5,-3"),
        ("placement.place_mm", "1,2,3", "two numbers"),
        ("placement.anchor", "1e9,0", "`placement.anchor` cannot be 1000000000 mm"),
        ("pattern.ink_layers", "[MARK", "cannot be understood"),
        (
            "optics.kind",
            "perspective",
            "`lens_distance_x_mm` is missing. Also give `lens_distance_x_mm` of the same table.",
        ),
        ("optics.axis_mm", "[0, 0]", "telecentric lens has no effect"),
        ("folders.reports", "drop/hot", "`hot` and `reports` are the same"),
        ("station.name", "", "no readable name"),
    ] {
        let error = with_given(NEEDED, &[(name, value)]).expect_err(name);
        assert!(error.to_string().contains(words), "{name}={value}: {error}");
        let place = error.reason().place;
        assert_eq!(place.to_string(), format!("--set {name}={value}"), "{error}");
    }
    let twice = [("part.unit", "mm"), ("part.unit", "cm")];
    let error = with_given(NEEDED, &twice).unwrap_err().to_string();
    assert!(error.contains("`part.unit` is given twice, also by `--set part.unit=mm`"), "{error}");
    // A mistake in the file has its place in the file, whatever is given besides.
    let file = format!("{NEEDED}[correction]\ntolerance_mm = 5\nangle_weight = 50\n");
    let error = with_given(&file, &[("correction.tolerance_mm", "0.5")]).unwrap_err();
    assert_eq!((error.reason().place.line, error.reason().place.column), (Some(12), Some(16)), "{error}");
}

#[test]
fn settings_of_the_command_line_hold_while_the_files_change() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("station.toml");
    fs_err::create_dir(folder.path().join("skus")).unwrap();
    fs_err::write(&file, NEEDED).unwrap();
    let overrides = given(&[("placement.rotate_deg", "90")]).unwrap();
    let mut live = LiveSettings::open_with(&file, overrides).unwrap().at_once();
    let turn = |live: &mut LiveSettings, sku: &str| {
        live.job(&sku.parse().unwrap()).unwrap().placement.rotate.to_degrees().round()
    };
    fs_err::write(&file, NEEDED.replace("L1", "L2") + "[placement]\nrotate_deg = 10\n").unwrap();
    live.refresh();
    assert_eq!((live.station().name.clone(), turn(&mut live, "can")), ("L2".into(), 90.0));
    // They stand for the station's file, which a SKU's file overrides.
    fs_err::write(folder.path().join("skus/can.toml"), "[placement]\nrotate_deg = 45").unwrap();
    assert_eq!((turn(&mut live, "can"), turn(&mut live, "mug")), (45.0, 90.0));
}

/// A lens table of 3 x 3 crosses at two heights, with one line changed by `edit`.
fn lens_table(edit: impl Fn(&mut Vec<[String; 5]>)) -> String {
    let places = (0..18)
        .map(|n| (f64::from(n % 3 - 1) * 40.0, f64::from(n / 3 % 3 - 1) * 40.0, f64::from(n / 9) * 30.0));
    let row = |(x, y, z): (f64, f64, f64)| {
        [x, y, z, x * (1.0 - z / 300.0), y * (1.0 - z / 285.0)].map(|value| value.to_string())
    };
    let mut rows: Vec<[String; 5]> = places.map(row).collect();
    edit(&mut rows);
    let lines: Vec<String> = rows.iter().map(|row| row.join(",")).collect();
    format!("x_mm,y_mm,z_mm,seen_x_mm,seen_y_mm\n{}\n", lines.join("\n"))
}

#[test]
fn a_lens_table_is_checked_for_gaps_signs_and_swapped_axes() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("station.toml");
    fs_err::write(&file, format!("{NEEDED}[optics]\ntable = \"lens.csv\"\n")).unwrap();
    let load = |table: &str| {
        fs_err::write(folder.path().join("lens.csv"), table).unwrap();
        Station::load(&file)
    };
    let sound = load(&lens_table(|_| ())).unwrap();
    let Lens::Measured(lens) = sound.settings.optics.lens else { panic!("{sound:?}") };
    let aim = lens.aim(Point3::new(27.0, -18.0, 30.0)).unwrap();
    assert!((aim.x - 27.0 / 0.9).abs() < 1e-9 && (aim.y + 18.0 / (1.0 - 30.0 / 285.0)).abs() < 1e-9);
    // A gap leaves out one cross.
    load(&lens_table(|rows| rows[4][3].clear())).unwrap();
    let flip = |row: &mut [String; 5]| row[4] = format!("{}", -row[4].parse::<f64>().unwrap());
    type Edit<'a> = &'a dyn Fn(&mut Vec<[String; 5]>);
    let cases: [(Edit, &[&str]); 8] = [
        (
            &|rows| rows.iter_mut().for_each(|row| row.swap(3, 4)),
            &["x and y seem swapped", "Exchange the columns"],
        ),
        (&|rows| rows.iter_mut().for_each(flip), &["the sign of y seems wrong"]),
        (
            &|rows| rows[12][3] = "5.0".into(),
            &["line 14", "seen_x_mm is +41.00 mm", "Measure this cross again"],
        ),
        (
            &|rows| rows[5..].iter_mut().for_each(|row| row[3].clear()),
            &["has 5 complete rows, and 8 are needed", "13 rows have empty"],
        ),
        (&|rows| rows.truncate(9), &["all rows have the height 0 mm", "another height"]),
        (&|rows| rows.retain(|row| row[1] == "40"), &["complete rows"]),
        (&|rows| rows[3][0] = "12,5".into(), &["line 5"]),
        (&|rows| rows[3][2].clear(), &["line 5", "is empty"]),
    ];
    for (edit, words) in cases {
        let reason = load(&lens_table(edit)).unwrap_err().reason();
        for word in words {
            assert!(reason.to_string().contains(word), "`{word}` is missing in:\n{reason}");
        }
    }
    fs_err::remove_file(folder.path().join("lens.csv")).unwrap();
    assert!(Station::load(&file).unwrap_err().reason().what.contains("lens.csv: it cannot be read"));
    fs_err::write(&file, format!("{NEEDED}[optics]\nkind = \"telecentric\"\ntable = \"lens.csv\"\n"))
        .unwrap();
    assert!(Station::load(&file).unwrap_err().reason().remedy.contains("or remove `table`"));
}

#[test]
fn a_changed_lens_table_takes_effect_and_a_broken_one_keeps_the_previous_lens() {
    let folder = tempfile::tempdir().unwrap();
    let [file, table] = ["station.toml", "lens.csv"].map(|name| folder.path().join(name));
    fs_err::write(&file, format!("{NEEDED}[optics]\ntable = \"lens.csv\"\n")).unwrap();
    fs_err::write(&table, lens_table(|_| ())).unwrap();
    let mut live = LiveSettings::open(&file).unwrap().at_once();
    let first = live.station().settings.optics.lens;
    live.refresh();
    assert!(live.take_events().is_empty());
    fs_err::write(&table, lens_table(|rows| rows[0][4] = "-40.1".into())).unwrap();
    live.refresh();
    assert!(matches!(live.take_events()[..], [SettingsEvent::StationChanged { .. }]));
    let second = live.station().settings.optics.lens;
    assert_ne!(second, first);
    fs_err::write(&table, "x_mm").unwrap();
    live.refresh();
    assert!(matches!(live.take_events()[..], [SettingsEvent::Broken { old_stay: true, .. }]));
    assert_eq!(live.station().settings.optics.lens, second);
}
