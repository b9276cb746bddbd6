//! Operating a station: setup, checks, status, retries and the service manager; and drawings that were delivered
//! before.

#[cfg(unix)]
use std::process::Command;
use std::time::{Duration, SystemTime};

use fs_err as fs;
use serde_json::Value;

use crate::desk::{Desk, drawing};
use crate::station::{Station, files};

/// A shallow trough as OBJ.
const PART: &str =
    "v -20 -20 1\nv 0 -20 0\nv 20 -20 1\nv -20 20 1\nv 0 20 0\nv 20 20 1\nf 1 2 5 4\nf 2 3 6 5\n";
/// A placement far beside the part.
const OFF: &str = "[placement]\nplace_mm = [0, 500]\n";

fn status(station: &Station) -> Value {
    let output = station.desk.isomark(&["status", "station.toml", "--json"]);
    assert_eq!(output.code, 0, "{}", output.err);
    serde_json::from_str(&output.out).unwrap()
}

/// A station that knows the trough, with one drawing delivered.
fn delivered() -> Station {
    let station = Station::new();
    station.desk.write("hot/trough.obj", PART);
    station.copy_into(&drawing("square"), "trough.dxf");
    assert!(station.once().out.starts_with("1 delivered, 1 part fitted"));
    station
}

fn append(station: &Station, text: &str) {
    let settings = station.desk.text("station.toml");
    station.desk.write("station.toml", settings + text);
}

#[test]
fn an_uncertain_delivery_is_shown_and_repeated_on_request() {
    for by_name in [true, false] {
        let station = delivered();
        if !station.interrupt_delivery("trough") {
            return;
        }
        let output = station.once();
        assert_eq!(output.code, 3, "{output:?}");
        assert!(output.out.starts_with("0 delivered") && output.out.contains("1 uncertain"), "{output:?}");
        assert!(
            output.err.contains("WARN") && output.err.contains("may not have been delivered"),
            "{}",
            output.err
        );
        assert!(output.err.contains("isomark retry station.toml trough.dxf"), "{}", output.err);
        assert!(station.import().is_empty());
        let output = station.desk.isomark(&["status", "station.toml"]);
        assert!(
            output.out.contains("uncertain (may or may not be delivered): 1\n  trough.dxf, "),
            "{}",
            output.out
        );
        assert_eq!(status(&station)["uncertain"]["first"][0]["drop"], "trough.dxf");
        let output = station.desk.isomark(&["retry", "station.toml"]);
        assert!(output.code == 0 && output.err.contains("--uncertain"), "{output:?}");
        let asked = if by_name { "trough.dxf" } else { "--uncertain" };
        assert_eq!(station.desk.isomark(&["retry", "station.toml", asked]).code, 0);
        station.once();
        assert_eq!(station.import(), ["trough.dxf"]);
        assert_eq!(status(&station)["uncertain"]["count"], 0);
    }
}

#[test]
fn a_station_is_set_up_checked_and_works() {
    let desk = Desk::new();
    let output = desk.isomark(&["init", "line 1"]);
    let check = format!("isomark{} check", std::env::consts::EXE_SUFFIX);
    assert!(output.code == 0 && output.out.contains(&check), "{output:?}");
    let sample = desk.path("line 1").join("skus").join("can-500.toml");
    let sample = sample.strip_prefix(desk.root()).unwrap().display().to_string();
    assert!(output.out.contains(&format!("written  {sample}\n")), "{output:?}");
    // The printed command can be typed as it is.
    #[cfg(unix)]
    {
        let check =
            output.out.lines().find(|line| line.starts_with("  ") && line.contains(" check ")).unwrap();
        let typed = std::process::Command::new("sh").args(["-c", check]).current_dir(desk.root()).output();
        assert!(typed.as_ref().is_ok_and(|typed| typed.status.success()), "{check}: {typed:?}");
    }
    let output = desk.isomark(&["check", "line 1/station.toml"]);
    assert!(output.code == 0 && output.out.contains("1 SKU file are valid"), "{output:?}");
    // Nobody imports from the folder that `init` made, unless somebody chose it.
    assert!(output.out.contains("`import` is the station's own folder: set it"), "{output:?}");
    desk.write("line 1/hot/trough.obj", PART);
    fs::copy(drawing("square"), desk.path("line 1/hot/trough.dxf")).unwrap();
    // An OBJ has no end mark, so the file must be old enough.
    let part = fs::OpenOptions::new().write(true).open(desk.path("line 1/hot/trough.obj")).unwrap();
    part.file().set_modified(SystemTime::now() - Duration::from_secs(3600)).unwrap();
    drop(part);
    let output = desk.isomark(&["watch", "line 1/station.toml", "--once"]);
    assert!(output.code == 0 && output.out.starts_with("1 delivered"), "{output:?}");
    // Edited files are kept.
    let edited = desk.text("line 1/station.toml").replace("Laser 1", "Laser 7");
    desk.write("line 1/station.toml", &edited);
    let output = desk.isomark(&["init", "line 1"]);
    assert!(output.code == 0 && output.out.starts_with("kept"), "{output:?}");
    assert_eq!(desk.text("line 1/station.toml"), edited);
}

#[test]
fn every_mistake_in_the_settings_is_named_before_it_counts() {
    let station = Station::new();
    let check = || station.desk.isomark(&["check", "station.toml"]);
    assert_eq!(check().code, 0);
    station.desk.write("skus/cup.toml", "[fixture]\nz_mm = 1\nheight = 3\n");
    let output = check();
    assert!(output.code == 2 && output.err.contains("line 3") && output.err.contains("height"), "{output:?}");
    assert!(output.err.contains("cup.toml"), "{output:?}");
    fs::remove_file(station.path("skus/cup.toml")).unwrap();
    // Windows does not allow such a file name.
    if cfg!(unix) {
        station.desk.write("skus/con.toml", "");
        let output = check();
        assert!(output.code == 2 && output.err.contains("reserved by Windows"), "{output:?}");
        fs::remove_file(station.path("skus/con.toml")).unwrap();
    }
    fs::remove_dir(station.path("import")).unwrap();
    check().refused(2, &["The import folder ", "does not exist", "connect its share"]);
    station.desk.write("import", "no folder");
    check().refused(2, &["The import folder ", " is a file.", "Name the folder that"]);
    fs::remove_file(station.path("import")).unwrap();
    fs::create_dir(station.path("import")).unwrap();
    // This also fails for an administrator, who can write everywhere.
    station.desk.write("archive", "a file in the way");
    let output = check();
    assert!(output.out.is_empty(), "{output:?}");
    output.refused(3, &["The archive folder ", "cannot be written", "what to do: Give the user"]);
}

/// The station has no older settings to use.
#[test]
fn drawings_wait_for_valid_settings_and_the_mistake_is_reported() {
    let mut station = delivered();
    station.desk.write("skus/trough.toml", "[placement]\nplace_mm = [1, 0]\nrotate = 3\n");
    station.start();
    station.copy_into(&drawing("square"), "trough@2.dxf");
    let words = ["trough@2.dxf waits: ", "trough.toml", "line 3", "column 1", "`rotate_deg`"];
    let is_complaint = |text: &str| words.iter().all(|words| text.contains(words));
    station.waits_for("a complaint", |station| {
        station.log().lines().any(is_complaint)
            && status(station)["waiting"]["first"][0]["reason"]["code"] == "settings-unknown-key"
    });
    station.desk.write("skus/trough.toml", "[placement]\nplace_mm = [1, 0]\nrotate_deg = 3\n");
    station.waits_for_file("import/trough@2.dxf");
}

#[test]
fn a_station_is_asked_from_another_terminal() {
    let mut station = Station::new();
    let ask = |station: &Station| station.desk.isomark(&["status", "station.toml"]);
    ask(&station).refused(2, &["was never started"]);
    station.start();
    station.copy_into(&drawing("square"), "cup.dxf");
    station.desk.write("hot/cup@x.pdf", "%PDF");
    station.waits_for("a status", |station| {
        let output = ask(station);
        output.code == 0
            && output.out.contains("waiting: 1\n  cup.dxf: The drawing waits for a part")
            && output.out.contains("cup@x.pdf: isomark does not read .pdf files")
    });
    let id = station.running.as_ref().unwrap().id();
    assert!(ask(&station).out.starts_with(&format!("test: running, process {id}")));
    let now = status(&station);
    assert_eq!((&now["schema"], &now["running"]), (&"isomark.status/1".into(), &true.into()));
    assert_eq!((&now["state"], &now["in_rejected"]), (&"running".into(), &1.into()));
    assert_eq!(now["troubles"], serde_json::json!([]));
    fs::remove_dir(station.path("import")).unwrap();
    let troubles = status(&station)["troubles"].to_string();
    assert!(troubles.contains("The import folder ") && troubles.contains("does not exist"), "{troubles}");
    station.waits_for("a warning", |station| station.log().contains("does not exist"));
    fs::create_dir(station.path("import")).unwrap();
    station.waits_for("the folder", |station| {
        station
            .log()
            .lines()
            .any(|line| line.contains("the import folder ") && line.contains(" is available again"))
    });
    assert_eq!((&now["waiting"]["count"], &now["done"]["rejected"]), (&1.into(), &1.into()));
    assert_eq!(now["waiting"]["first"][0]["reason"]["code"], "waits-for-part");
    assert_eq!(now["rejections"][0]["reason"]["code"], "unknown-kind");
    station.kill();
    assert!(ask(&station).out.contains("not running; it ended unexpectedly after 20"));
    let now = status(&station);
    assert_eq!((&now["running"], &now["state"]), (&false.into(), &"ended-silently".into()));
    station.once();
    let output = ask(&station).out;
    assert!(output.contains("not running; stopped at 20"), "{output}");
    // Including drops that were rejected before.
    let done = ": 0 delivered, 0 rejected, 0 parts fitted; in the last hour 0 delivered, 1 rejected\n";
    assert!(output.contains(done) && output.contains("1 rejected drop is in "), "{output}");
    assert_eq!(status(&station)["state"], "stopped");
}

#[test]
fn a_drawing_for_an_unknown_product_names_similar_ones() {
    let station = delivered();
    station.desk.write("skus/Thorough.toml", "[part]\n");
    station.copy_into(&drawing("square"), "throug@2.dxf");
    station.copy_into(&drawing("square"), "saddle.dxf");
    station.once();
    let waiting = status(&station)["waiting"].to_string();
    assert!(
        waiting.contains("If the drawing is for another product, begin its name with thorough@ or trough@."),
        "{waiting}"
    );
    let saddle = status(&station)["waiting"]["first"]
        .as_array()
        .unwrap()
        .iter()
        .find(|drop| drop["drop"] == "saddle.dxf")
        .unwrap()
        .clone();
    // Names that are not similar are listed, not suggested as the beginning of its name.
    let saddle = saddle.to_string();
    assert!(!saddle.contains("begin its name"), "{saddle}");
    assert!(
        saddle.contains("in the form SKU@name.dxf") && saddle.contains("Known SKUs: can, trough, thorough."),
        "{saddle}"
    );
}

#[test]
fn a_drawing_names_what_its_part_waits_for() {
    let station = Station::new();
    station.desk.write("skus/trough.toml", "[part]\nfacign = \"+z\"\n");
    station.desk.write("hot/trough.obj", PART);
    station.copy_into(&drawing("square"), "trough.dxf");
    let output = station.once();
    let both = "The drawing waits until the part of SKU `trough` is complete and fitted. The part trough.obj waits, too: there is no \
                key `facign` here.";
    assert!(output.out.contains(&format!("trough.dxf: {both}")), "{output:?}");
    assert!(output.err.contains(both), "{output:?}");
    let status = status(&station).to_string();
    assert!(status.contains(both), "{status}");
}

#[test]
fn rejected_drops_are_tried_again() {
    let station = Station::new();
    station.desk.write("skus/trough.toml", OFF);
    station.desk.write("hot/trough.obj", PART);
    station.copy_into(&drawing("square"), "trough.dxf");
    station.copy_into(&drawing("abc"), "trough@2.dxf");
    assert!(station.once().out.starts_with("0 delivered, 1 part fitted, 2 rejected"));
    fs::remove_file(station.path("skus/trough.toml")).unwrap();
    let retry = |arguments: &[&str]| station.desk.isomark(&[&["retry", "station.toml"], arguments].concat());
    retry(&["cup.dxf"]).refused(3, &["There is no rejected drop cup.dxf in"]);
    retry(&["trough@2"]).refused(
        3,
        &["There is no rejected drop trough@2 in", "Did you mean `trough@2.dxf`? Give the whole"],
    );
    assert_eq!(retry(&["--uncertain"]).out, "no delivery is uncertain\n");
    let text = station.desk.text("rejected/trough.dxf.reason.txt");
    let command = format!("isomark retry {} trough.dxf", station.path("station.toml").display());
    assert!(text.ends_with(&format!("correct them and run `{command}`.\n")), "{text}");
    // One that waits is tried, too, though not alone.
    station.copy_into(&drawing("square"), "cup@1.dxf");
    let output = retry(&["cup@1.dxf"]);
    assert!(
        output.code == 0 && output.out.starts_with("cup@1.dxf waits; everything that waits will be"),
        "{output:?}"
    );
    fs::remove_file(station.path("hot/cup@1.dxf")).unwrap();
    let output = retry(&["trough.dxf"]);
    assert!(output.code == 0 && output.out == "trough.dxf is back in the hot folder\n", "{output:?}");
    assert!(station.once().out.starts_with("1 delivered"));
    // What was put right is no longer listed.
    let still_rejected = status(&station)["rejections"]
        .as_array()
        .unwrap()
        .iter()
        .map(|entry| entry["drop"].clone())
        .collect::<Vec<_>>();
    assert_eq!(still_rejected, ["trough@2.dxf"]);
    assert_eq!(retry(&["--rejected"]).out, "trough@2.dxf is back in the hot folder\n");
    assert!(files(&station.path("rejected")).is_empty());
    station.once();
    assert_eq!(station.import(), ["trough.dxf", "trough@2.dxf"]);
}

#[test]
fn requests_to_a_stopped_station_are_processed_when_it_starts() {
    let station = delivered();
    append(&station, "[placement]\nrotate_deg = 5\n");
    assert_eq!(station.desk.isomark(&["retry", "station.toml", "--outdated"]).code, 0);
    let before = fs::read(station.path("import/trough.dxf")).unwrap();
    assert!(station.once().out.starts_with("1 delivered"));
    assert!(fs::read(station.path("import/trough.dxf")).unwrap() != before);
}

/// Clocks can be set back, by people and over the network; the journal keeps the real order.
#[test]
fn the_last_result_is_found_even_if_clocks_are_wrong() {
    let station = delivered();
    let hours_on = |name: &str| {
        let file = fs::OpenOptions::new().write(true).open(station.path(name)).unwrap();
        file.file().set_modified(SystemTime::now() + Duration::from_secs(7200)).unwrap();
    };
    let retry = || station.desk.isomark(&["retry", "station.toml", "--rejected"]);
    assert_eq!((retry().code, retry().out), (0, "no drop is rejected\n".into()));
    station.desk.write("hot/trough.dxf", "%PDF");
    assert!(station.once().out.contains("1 rejected"));
    // Rejected last, although the report of the delivered drawing is newer.
    hours_on("reports/trough/trough.dxf.report.json");
    assert_eq!(retry().out, "trough.dxf is back in the hot folder\n");
    assert!(station.once().out.contains("1 rejected"));
    // Delivered last, although the file with the reason is newer.
    station.copy_into(&drawing("abc"), "trough.dxf");
    assert!(station.once().out.starts_with("1 delivered"));
    hours_on("rejected/trough.dxf.reason.json");
    retry().refused(3, &["trough.dxf is not moved back", "a newer drop of that name"]);
    // The journal may have forgotten what was rejected.
    fs::remove_file(station.path("state/journal.log")).unwrap();
    assert_eq!(retry().out, "trough.dxf is back in the hot folder\n");
}

#[test]
fn outdated_drawings_are_marked_and_corrected_again_when_asked() {
    let mut station = delivered();
    let first = station.desk.read("import/trough.dxf");
    station.start();
    // The station reads the settings after it takes the lock, and notices edits only after that.
    let has_listed = |station: &Station| station.desk.text("state/status.json").contains("\"running\": true");
    station.waits_for("a first listing", has_listed);
    station.desk.write("skus/trough.toml", "[placement]\nplace_mm = [3, 0]\n");
    station.waits_for("a mark", |station| status(station)["outdated"]["first"][0]["name"] == "trough.dxf");
    assert!(
        station.log().contains("using the changed settings of SKU `trough`: placement.place_mm = [3, 0]"),
        "{}",
        station.log()
    );
    assert_eq!(station.desk.read("import/trough.dxf"), first);
    let retry = |sku: &str| station.desk.isomark(&["retry", "station.toml", "--outdated", sku]);
    let output = retry("cup");
    assert!(
        output.code == 0 && output.out.starts_with("no delivered drawing of cup is known to be outdated;"),
        "{output:?}"
    );
    let output = retry("trough");
    assert!(output.code == 0 && output.err.is_empty(), "{output:?}");
    station.waits_for("another result", |station| station.desk.read("import/trough.dxf") != first);
    station.waits_for("no mark", |station| status(station)["outdated"]["count"] == 0);
    // The result is in the folder before the log names it.
    station.waits_for("a line", |station| station.log().contains("trough.dxf replaced the result of 20"));
    // A new part outdates it, too, and the settings can let the station correct it automatically.
    let second = station.desk.read("import/trough.dxf");
    append(&station, "[delivery]\noutdated = \"correct\"\n");
    station.desk.write("elsewhere/trough.obj", PART.replace("20 1", "20 2"));
    fs::rename(station.path("elsewhere/trough.obj"), station.path("hot/trough.obj")).unwrap();
    station.waits_for("a third result", |station| station.desk.read("import/trough.dxf") != second);
    assert_eq!(files(&station.path("archive/trough")).iter().filter(|name| name.ends_with("dxf")).count(), 1);
}

const PLACED: &str = "[placement]\nplace_mm = [3, 0]\n";

/// Settings that were edited before the start and cannot be used yet replace the delivered drawing later in that run.
fn settings_take_effect_after_a_start(settle_ms: &str, at_start: &str, repair: impl Fn(&Station)) {
    let mut station = delivered();
    let first = station.desk.read("import/trough.dxf");
    let settings = station.desk.text("station.toml").replace("settle_ms = 100", settle_ms);
    station.desk.write("station.toml", settings + "[delivery]\noutdated = \"correct\"\n");
    station.desk.write("skus/trough.toml", at_start);
    station.start();
    repair(&station);
    station.waits_for("another result", |station| station.desk.read("import/trough.dxf") != first);
    station.waits_for("no mark", |station| status(station)["outdated"]["count"] == 0);
}

#[test]
fn settings_that_are_being_saved_at_the_start_outdate_drawings() {
    settings_take_effect_after_a_start("settle_ms = 1500", PLACED, |_| {});
}

#[test]
fn settings_that_are_wrong_at_the_start_outdate_drawings_when_they_are_corrected() {
    settings_take_effect_after_a_start("settle_ms = 100", "[placement\n", |station| {
        let is_reported = |station: &Station| station.desk.text("state/status.json").contains("trough.toml");
        station.waits_for("the problem", is_reported);
        station.desk.write("skus/trough.toml", PLACED);
    });
}

/// Writes the journal in the form of version 0.1, in which the basis of a drawing, its part and settings, is a plain
/// hash.
fn make_journal_older(station: &Station) {
    let older = |line: &str| {
        let (_, json) = line.split_once(' ').unwrap();
        let mut record: Value = serde_json::from_str(json).unwrap();
        if let Some(basis) = record.get_mut("basis") {
            *basis = "00112233445566778899aabbccddeeff".into();
        }
        let json = record.to_string();
        format!("{} {json}\n", &blake3::hash(json.as_bytes()).to_hex()[..8])
    };
    let journal: String = station.desk.text("state/journal.log").lines().map(older).collect();
    station.desk.write("state/journal.log", journal);
}

const TAKEN: &str = "treating 1 delivered drawing as up to date";

#[test]
fn drawings_of_an_older_version_are_outdated_only_by_later_changes() {
    let mut station = delivered();
    let first = station.desk.read("import/trough.dxf");
    append(&station, "[delivery]\noutdated = \"correct\"\n");
    make_journal_older(&station);
    station.start();
    station.waits_for("a word", |station| station.log().contains(TAKEN));
    // After this, the journal has the current form.
    station.waits_for("a look", |station| station.desk.text("state/journal.log").contains("\"basis\":\"v2:"));
    assert_eq!(status(&station)["outdated"]["count"], 0);
    station.kill();
    station.start();
    station.waits_for("a start", |station| station.log().matches("takes drops from").count() == 2);
    station.desk.write("skus/trough.toml", "[placement]\nplace_mm = [3, 0]\n");
    station.waits_for("another result", |station| station.desk.read("import/trough.dxf") != first);
    station.waits_for("a line", |station| station.log().contains("trough.dxf replaced the result of"));
    station.waits_for("no mark", |station| status(station)["outdated"]["count"] == 0);
    let log = station.log();
    assert_eq!(log.matches("as up to date").count(), 1, "{log}");
    assert_eq!(log.matches("trough.dxf replaced the result of").count(), 1, "{log}");
}

/// The part arrived while the station was updated.
#[test]
fn a_new_part_outdates_drawings_of_an_older_version() {
    let station = delivered();
    let first = station.desk.read("import/trough.dxf");
    append(&station, "[delivery]\noutdated = \"correct\"\n");
    make_journal_older(&station);
    let output = station.once();
    assert!(output.out.starts_with("0 delivered") && output.err.contains(TAKEN), "{output:?}");
    make_journal_older(&station);
    station.desk.write("hot/trough.obj", PART.replace("20 1", "20 2"));
    let output = station.once();
    assert!(output.out.starts_with("1 delivered, 1 part fitted"), "{output:?}");
    assert_ne!(station.desk.read("import/trough.dxf"), first);
    let output = station.once();
    assert!(output.out.starts_with("0 delivered") && !output.err.contains("as up to date"), "{output:?}");
}

/// The cache can be deleted at any time; the parts are in the archive.
#[test]
fn a_lost_cache_outdates_nothing() {
    let station = delivered();
    let first = station.desk.read("import/trough.dxf");
    append(&station, "[delivery]\noutdated = \"correct\"\n");
    fs::remove_dir_all(station.path("cache")).unwrap();
    fs::remove_file(station.path("import/trough.dxf")).unwrap();
    let output = station.once();
    assert!(output.out.starts_with("0 delivered"), "{output:?}");
    assert!(!output.err.contains("outdated"), "{output:?}");
    // The surface is fitted again for the check, and the first drawing is still up to date.
    assert!(output.err.contains("restored the surface of trough"), "{output:?}");
    station.copy_into(&drawing("square"), "trough@2.dxf");
    let output = station.once();
    assert!(output.out.starts_with("1 delivered"), "{output:?}");
    assert_eq!(station.import(), ["trough@2.dxf"]);
    station.copy_into(&drawing("square"), "trough.dxf");
    assert!(station.once().out.starts_with("1 delivered"));
    assert_eq!(station.desk.read("import/trough.dxf"), first);
    // Changes in the meantime are found without another drawing.
    fs::remove_dir_all(station.path("cache")).unwrap();
    station.desk.write("skus/trough.toml", PLACED);
    let output = station.once();
    assert!(output.out.starts_with("2 delivered"), "{output:?}");
    assert_ne!(station.desk.read("import/trough.dxf"), first);
}

#[test]
fn a_lost_cache_and_a_lost_part_are_a_problem_that_ends_with_the_part() {
    let mut station = delivered();
    fs::remove_dir_all(station.path("cache")).unwrap();
    fs::remove_file(station.path("archive/trough/trough.obj")).unwrap();
    station.desk.write("skus/trough.toml", PLACED);
    let output = station.once();
    assert!(
        output.err.contains("cannot check whether delivered drawings of trough are outdated"),
        "{output:?}"
    );
    assert_eq!(output.err.matches("cannot check").count(), 1, "{output:?}");
    let is_told = |station: &Station| status(station)["troubles"].to_string().contains("Drop the part again");
    station.start();
    station.waits_for("the problem", is_told);
    station.desk.write("elsewhere/trough.obj", PART);
    fs::rename(station.path("elsewhere/trough.obj"), station.path("hot/trough.obj")).unwrap();
    station.waits_for("a mark", |station| status(station)["outdated"]["count"] == 1);
    station.waits_for("no problem", |station| !is_told(station));
}

/// What was delivered before the start is part of the last hour, but is not counted a second time.
#[test]
fn counts_are_of_what_was_delivered() {
    let counts = |station: &Station| {
        let status = status(station);
        let done = |key: &str| status["done"][key].as_u64().unwrap();
        assert_eq!(status["finished"][0]["drop"], "trough.dxf");
        let last = status["finished"][0]["result"].as_str().unwrap().to_owned();
        (done("delivered"), done("delivered_last_hour"), done("rejected_last_hour"), last)
    };
    let station = delivered();
    assert_eq!(counts(&station), (1, 1, 0, "delivered".into()));
    station.desk.write("hot/trough@2.dxf", "%PDF");
    station.once();
    assert_eq!(counts(&station), (0, 1, 1, "delivered".into()));
    let output = station.desk.isomark(&["status", "station.toml"]);
    assert!(
        output.out.contains(
            ": 0 delivered, 1 rejected, 0 parts fitted; in the last hour 1 delivered, 1 rejected\n"
        ),
        "{output:?}"
    );
    // Unchanged in the import folder.
    station.copy_into(&drawing("square"), "trough.dxf");
    assert!(station.once().out.contains("\n1 already delivered and unchanged in import\n"));
    assert_eq!(counts(&station), (0, 1, 1, "repeated".into()));
    // Delivered by a run that was interrupted before it filed the original.
    let station = delivered();
    let journal = station.desk.text("state/journal.log");
    let end = journal.find("\"did\":\"filing\",\"drop\":\"trough.dxf\"").unwrap();
    let end = journal[..end].rfind('\n').unwrap() + 1;
    station.desk.write("state/journal.log", &journal[..end]);
    fs::rename(station.path("archive/trough/trough.dxf"), station.path("hot/trough.dxf")).unwrap();
    let output = station.once();
    assert!(output.err.contains("was delivered before the station was interrupted"), "{output:?}");
    assert!(
        output.out.starts_with("0 delivered")
            && output.out.contains("\n1 delivered before, not delivered again\n"),
        "{output:?}"
    );
    assert_eq!(counts(&station), (0, 1, 0, "repeated".into()));
}

#[test]
fn the_settings_decide_whether_a_repeated_drop_is_delivered_again() {
    for (repeat, after_removal, while_in_import) in [
        ("never", "0 delivered", "already delivered at 20"),
        ("if-gone", "1 delivered", "was already delivered and is unchanged in import"),
        ("always", "1 delivered", "was already delivered and is written to import again"),
    ] {
        let station = delivered();
        append(&station, &format!("[delivery]\nrepeat = \"{repeat}\"\n"));
        station.copy_into(&drawing("square"), "trough.dxf");
        let output = station.once();
        assert!(output.err.contains(while_in_import), "{repeat}: {}", output.err);
        let is_unchanged = output.out.contains("\n1 already delivered and unchanged in import\n");
        assert_eq!(is_unchanged, repeat == "if-gone", "{repeat}: {}", output.out);
        assert_eq!(output.out.starts_with("1 delivered"), repeat == "always", "{repeat}: {}", output.out);
        fs::remove_file(station.path("import/trough.dxf")).unwrap();
        station.copy_into(&drawing("square"), "trough.dxf");
        let output = station.once();
        assert!(output.out.starts_with(after_removal), "{repeat}: {}", output.out);
        assert_eq!(files(&station.path("hot")), [""; 0]);
    }
}

#[test]
fn settings_beside_a_drawing_apply_only_to_it() {
    let station = delivered();
    let plain = station.desk.read("import/trough.dxf");
    let sidecar = "[placement]\nplace_mm = [1, 2]\nrotate_deg = 10\n[correction]\nmethod = \"none\"\n";
    station.desk.write("hot/trough@a.toml", sidecar);
    for name in ["trough@a.dxf", "trough@b.dxf"] {
        station.copy_into(&drawing("square"), name);
    }
    station.desk.write("hot/trough@c.toml", "[placement]\nplace = 3\n");
    station.copy_into(&drawing("square"), "trough@c.dxf");
    let output = station.once();
    assert!(
        output.out.starts_with("2 delivered, 0 parts fitted, 1 rejected, 0 waiting, 0 inc"),
        "{}",
        output.out
    );
    let vertices = |bytes: &[u8]| String::from_utf8_lossy(bytes).split_once("ENTITIES").unwrap().1.to_owned();
    assert_eq!(vertices(&station.desk.read("import/trough@b.dxf")), vertices(&plain));
    // The same settings for the whole SKU give the same drawing.
    let other = Station::new();
    other.desk.write("skus/trough.toml", sidecar);
    other.desk.write("hot/trough.obj", PART);
    other.copy_into(&drawing("square"), "trough@a.dxf");
    other.once();
    assert!(station.desk.read("import/trough@a.dxf") == other.desk.read("import/trough@a.dxf"));
    assert!(station.path("archive/trough/trough@a.toml").exists());
    let reason = station.desk.text("rejected/trough@c.dxf.reason.txt");
    assert!(reason.contains("line 2") && reason.contains("`place`"), "{reason}");
    assert!(reason.contains("Its settings, trough@c.toml, are beside this file.\n"), "{reason}");
    assert!(station.path("rejected/trough@c.toml").exists());
}

/// Drawings corrected for the older part would be wrong on the new one.
#[test]
fn drawings_of_a_rejected_part_wait() {
    let station = delivered();
    station.desk.write("hot/trough.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n");
    station.copy_into(&drawing("square"), "trough@2.dxf");
    let output = station.once();
    assert!(output.out.contains("0 delivered, 0 parts fitted, 1 rejected, 1 waiting"), "{}", output.out);
    assert!(output.out.contains("the older part is not used"), "{}", output.out);
    fs::remove_file(station.path("rejected/trough.obj")).unwrap();
    assert!(station.once().out.starts_with("1 delivered"));
}

#[test]
fn a_log_file_is_written_in_addition_to_standard_error() {
    let station = Station::new();
    append(&station, "[log]\nfile = \"log/station.log\"\n");
    station.desk.write("hot/x.pdf", "%PDF");
    let output = station.once();
    let logged = station.desk.text("log/station.log");
    assert!(logged.contains("WARN") && logged.contains("x.pdf rejected"), "{logged}");
    assert!(output.err.contains("x.pdf rejected") && !logged.contains('\u{1b}'));
}

#[test]
fn a_changed_log_file_takes_effect_after_a_restart() {
    let station = Station::running();
    station.waits_for_file("state/status.json");
    append(&station, "[log]\nfile = \"log/station.log\"\n");
    station.waits_for("a warning", |station| station.log().contains("`log` takes effect after a restart"));
    assert!(!station.path("log").exists());
}

/// The other end of `sd_notify(3)`.
#[cfg(target_os = "linux")]
#[test]
fn a_service_manager_is_notified_of_ready_alive_and_stopping() {
    use std::os::unix::net::UnixDatagram;
    let mut station = Station::new();
    let socket = UnixDatagram::bind(station.path("notify")).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let receives = |words: &str| {
        let mut buffer = [0; 200];
        loop {
            let length = socket.recv(&mut buffer).unwrap_or_else(|error| panic!("{words}: {error}"));
            if String::from_utf8_lossy(&buffer[..length]).lines().any(|line| line == words) {
                return;
            }
        }
    };
    let mut command = Command::new(env!("CARGO_BIN_EXE_isomark"));
    command.args(["watch", "station.toml"]).current_dir(station.desk.root());
    command.env("NOTIFY_SOCKET", station.path("notify")).env("WATCHDOG_USEC", "1000000");
    let child = command.stderr(std::process::Stdio::null()).spawn().unwrap();
    let id = child.id().to_string();
    station.running = Some(child);
    for words in ["READY=1", "WATCHDOG=1", "WATCHDOG=1"] {
        receives(words);
    }
    assert!(Command::new("kill").args(["-s", "TERM", &id]).status().unwrap().success());
    receives("STOPPING=1");
}
