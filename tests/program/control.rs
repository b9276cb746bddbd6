//! What surrounds a station: it is set up, checked, asked, told to try again, run by a service manager; and what it does
//! with drawings that were delivered before.

#[cfg(unix)]
use std::process::Command;
use std::time::{Duration, SystemTime};

use fs_err as fs;
use serde_json::Value;

use crate::desk::{Desk, drawing};
use crate::station::{Station, files};

/// A shallow trough.
const PART: &str =
    "v -20 -20 1\nv 0 -20 0\nv 20 -20 1\nv -20 20 1\nv 0 20 0\nv 20 20 1\nf 1 2 5 4\nf 2 3 6 5\n";
/// Far off the part.
const OFF: &str = "[placement]\nplace_mm = [0, 500]\n";

fn status(station: &Station) -> Value {
    let said = station.desk.isomark(&["status", "station.toml", "--json"]);
    assert_eq!(said.code, 0, "{}", said.err);
    serde_json::from_str(&said.out).unwrap()
}

/// A station that knows the trough, with one drawing delivered.
fn delivered() -> Station {
    let station = Station::new();
    station.desk.write("hot/trough.obj", PART);
    station.copy_into(&drawing("square"), "trough.dxf");
    assert!(station.once().out.starts_with("1 delivered, 1 part learned"));
    station
}

fn append(station: &Station, text: &str) {
    let settings = station.desk.text("station.toml");
    station.desk.write("station.toml", settings + text);
}

/// The station ended when the journal had said that the drawing is about to be delivered.
#[test]
fn a_drawing_that_may_not_have_been_delivered_is_shown_and_delivered_when_asked() {
    for by_name in [true, false] {
        let station = delivered();
        let journal = station.desk.text("state/journal.log");
        let said = journal.rfind("\"did\":\"delivering\"").unwrap();
        let end = said + journal[said..].find('\n').unwrap() + 1;
        station.desk.write("state/journal.log", &journal[..end]);
        fs::rename(station.path("archive/trough/trough.dxf"), station.path("hot/trough.dxf")).unwrap();
        fs::remove_file(station.path("import/trough.dxf")).unwrap();
        let said = station.once();
        assert_eq!(said.code, 3, "{said:?}");
        assert!(said.out.starts_with("0 delivered") && said.out.contains("1 uncertain"), "{said:?}");
        assert!(
            said.err.contains("WARN") && said.err.contains("may not have been delivered"),
            "{}",
            said.err
        );
        assert!(said.err.contains("isomark retry station.toml trough.dxf"), "{}", said.err);
        assert!(station.import().is_empty());
        let said = station.desk.isomark(&["status", "station.toml"]);
        assert!(said.out.contains("uncertain whether delivered: 1\n  trough.dxf, "), "{}", said.out);
        assert_eq!(status(&station)["uncertain"]["first"][0]["drop"], "trough.dxf");
        let said = station.desk.isomark(&["retry", "station.toml"]);
        assert!(said.code == 0 && said.err.contains("--uncertain"), "{said:?}");
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
    let said = desk.isomark(&["init", "line 1"]);
    assert!(said.code == 0 && said.out.contains("isomark check"), "{said:?}");
    // What is printed can be typed.
    #[cfg(unix)]
    {
        let check = said.out.lines().find(|line| line.starts_with("  ") && line.contains(" check ")).unwrap();
        let typed = std::process::Command::new("sh").args(["-c", check]).current_dir(desk.root()).output();
        assert!(typed.as_ref().is_ok_and(|typed| typed.status.success()), "{check}: {typed:?}");
    }
    let said = desk.isomark(&["check", "line 1/station.toml"]);
    assert!(said.code == 0 && said.out.contains("1 SKU file are right"), "{said:?}");
    desk.write("line 1/hot/trough.obj", PART);
    fs::copy(drawing("square"), desk.path("line 1/hot/trough.dxf")).unwrap();
    // It lay there for a while: an OBJ has no end mark.
    let part = fs::OpenOptions::new().write(true).open(desk.path("line 1/hot/trough.obj")).unwrap();
    part.file().set_modified(SystemTime::now() - Duration::from_secs(3600)).unwrap();
    drop(part);
    let said = desk.isomark(&["watch", "line 1/station.toml", "--once"]);
    assert!(said.code == 0 && said.out.starts_with("1 delivered"), "{said:?}");
    // What was edited stays as it is.
    let edited = desk.text("line 1/station.toml").replace("Laser 1", "Laser 7");
    desk.write("line 1/station.toml", &edited);
    let said = desk.isomark(&["init", "line 1"]);
    assert!(said.code == 0 && said.out.starts_with("stays"), "{said:?}");
    assert_eq!(desk.text("line 1/station.toml"), edited);
}

#[test]
fn every_mistake_in_the_settings_is_named_before_it_counts() {
    let station = Station::new();
    let check = || station.desk.isomark(&["check", "station.toml"]);
    assert_eq!(check().code, 0);
    station.desk.write("skus/cup.toml", "[fixture]\nz_mm = 1\nheight = 3\n");
    let said = check();
    assert!(said.code == 2 && said.err.contains("line 3") && said.err.contains("height"), "{said:?}");
    assert!(said.err.contains("cup.toml"), "{said:?}");
    fs::remove_file(station.path("skus/cup.toml")).unwrap();
    // Windows itself lets nobody make such a file.
    if cfg!(unix) {
        station.desk.write("skus/con.toml", "");
        let said = check();
        assert!(said.code == 2 && said.err.contains("reserved by Windows"), "{said:?}");
        fs::remove_file(station.path("skus/con.toml")).unwrap();
    }
    fs::remove_dir(station.path("import")).unwrap();
    check().refused(2, &["The import folder ", "does not exist", "connect its share"]);
    station.desk.write("import", "no folder");
    check().refused(2, &["The import folder ", " is a file.", "Name the folder that"]);
    fs::remove_file(station.path("import")).unwrap();
    fs::create_dir(station.path("import")).unwrap();
    // Also as an administrator, who may write everywhere.
    station.desk.write("archive", "a file in the way");
    let said = check();
    assert!(said.out.is_empty(), "{said:?}");
    said.refused(3, &["The archive folder ", "cannot be written", "remedy: Let the user"]);
}

/// There are no older settings to go on with.
#[test]
fn drawings_wait_for_settings_that_can_be_read_and_say_where_they_cannot() {
    let mut station = delivered();
    station.desk.write("skus/trough.toml", "[placement]\nplace_mm = [1, 0]\nrotate = 3\n");
    station.start();
    station.copy_into(&drawing("square"), "trough@2.dxf");
    let words = ["trough@2.dxf waits: ", "trough.toml", "line 3", "column 1", "`rotate_deg`"];
    let told = |text: &str| words.iter().all(|words| text.contains(words));
    station.waits_for("a complaint", |station| {
        station.log().lines().any(told)
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
        let said = ask(station);
        said.code == 0
            && said.out.contains("waiting: 1\n  cup.dxf: The pattern waits for a part")
            && said.out.contains("cup@x.pdf: A .pdf file is neither")
    });
    let id = station.running.as_ref().unwrap().id();
    assert!(ask(&station).out.starts_with(&format!("test: runs, process {id}")));
    let now = status(&station);
    assert_eq!((&now["schema"], &now["running"]), (&"isomark.status/1".into(), &true.into()));
    assert_eq!((&now["state"], &now["in_rejected"]), (&"running".into(), &1.into()));
    assert_eq!(now["troubles"], serde_json::json!([]));
    fs::remove_dir(station.path("import")).unwrap();
    let troubles = status(&station)["troubles"].to_string();
    assert!(troubles.contains("The import folder ") && troubles.contains("does not exist"), "{troubles}");
    fs::create_dir(station.path("import")).unwrap();
    assert_eq!((&now["waiting"]["count"], &now["done"]["rejected"]), (&1.into(), &1.into()));
    assert_eq!(now["waiting"]["first"][0]["reason"]["code"], "waits-for-part");
    assert_eq!(now["rejections"][0]["reason"]["code"], "unknown-kind");
    station.kill();
    assert!(ask(&station).out.contains("does not run; it ended without a word after 20"));
    let now = status(&station);
    assert_eq!((&now["running"], &now["state"]), (&false.into(), &"ended-silently".into()));
    station.once();
    let said = ask(&station).out;
    assert!(said.contains("does not run; it was stopped at 20"), "{said}");
    // Whenever they were rejected.
    assert!(said.contains(" 0 rejected (0), ") && said.contains("1 rejected drop lies in "), "{said}");
    assert_eq!(status(&station)["state"], "stopped");
}

#[test]
fn what_was_rejected_is_tried_again() {
    let station = Station::new();
    station.desk.write("skus/trough.toml", OFF);
    station.desk.write("hot/trough.obj", PART);
    station.copy_into(&drawing("square"), "trough.dxf");
    station.copy_into(&drawing("abc"), "trough@2.dxf");
    assert!(station.once().out.starts_with("0 delivered, 1 part learned, 2 rejected"));
    fs::remove_file(station.path("skus/trough.toml")).unwrap();
    let retry = |arguments: &[&str]| station.desk.isomark(&[&["retry", "station.toml"], arguments].concat());
    retry(&["cup.dxf"]).refused(3, &["No drop cup.dxf lies in"]);
    let said = retry(&["trough.dxf"]);
    assert!(said.code == 0 && said.out == "trough.dxf is back in the hot folder\n", "{said:?}");
    assert!(station.once().out.starts_with("1 delivered"));
    assert_eq!(retry(&["--rejected"]).out, "trough@2.dxf is back in the hot folder\n");
    assert!(files(&station.path("rejected")).is_empty());
    station.once();
    assert_eq!(station.import(), ["trough.dxf", "trough@2.dxf"]);
}

#[test]
fn what_is_asked_of_a_station_that_does_not_run_is_done_when_it_starts() {
    let station = delivered();
    append(&station, "[placement]\nrotate_deg = 5\n");
    assert_eq!(station.desk.isomark(&["retry", "station.toml", "--outdated"]).code, 0);
    let before = fs::read(station.path("import/trough.dxf")).unwrap();
    assert!(station.once().out.starts_with("1 delivered"));
    assert!(fs::read(station.path("import/trough.dxf")).unwrap() != before);
}

/// Clocks are set back, by people and by the net; the journal has its own order.
#[test]
fn what_was_done_last_stays_whatever_the_clock_says() {
    let station = delivered();
    let hours_on = |name: &str| {
        let file = fs::OpenOptions::new().write(true).open(station.path(name)).unwrap();
        file.file().set_modified(SystemTime::now() + Duration::from_secs(7200)).unwrap();
    };
    let retry = || station.desk.isomark(&["retry", "station.toml", "--rejected"]);
    station.desk.write("hot/trough.dxf", "%PDF");
    assert!(station.once().out.contains("1 rejected"));
    // Rejected last, though the report of the delivered one is newer.
    hours_on("reports/trough/trough.dxf.report.json");
    assert_eq!(retry().out, "trough.dxf is back in the hot folder\n");
    assert!(station.once().out.contains("1 rejected"));
    // Delivered last, though the reason is newer.
    station.copy_into(&drawing("abc"), "trough.dxf");
    assert!(station.once().out.starts_with("1 delivered"));
    hours_on("rejected/trough.dxf.reason.json");
    retry().refused(3, &["trough.dxf is not put back", "a newer one of that name"]);
    // The journal may have forgotten what was rejected.
    fs::remove_file(station.path("state/journal.log")).unwrap();
    assert_eq!(retry().out, "trough.dxf is back in the hot folder\n");
}

#[test]
fn outdated_drawings_are_marked_and_corrected_again_when_asked() {
    let mut station = delivered();
    let first = station.desk.read("import/trough.dxf");
    station.start();
    // The lock is taken before the settings are looked at, and an edit is noticed only after that.
    let has_listed = |station: &Station| station.desk.text("state/status.json").contains("\"running\": true");
    station.waits_for("a first listing", has_listed);
    station.desk.write("skus/trough.toml", "[placement]\nplace_mm = [3, 0]\n");
    station.waits_for("a mark", |station| status(station)["outdated"]["first"][0]["name"] == "trough.dxf");
    assert!(station.log().contains("+ place_mm = [3, 0]"), "{}", station.log());
    assert_eq!(station.desk.read("import/trough.dxf"), first);
    let retry = |sku: &str| station.desk.isomark(&["retry", "station.toml", "--outdated", sku]);
    retry("cup").refused(0, &["warning: the station knows no outdated drawing of cup yet"]);
    let said = retry("trough");
    assert!(said.code == 0 && said.err.is_empty(), "{said:?}");
    station.waits_for("another result", |station| station.desk.read("import/trough.dxf") != first);
    station.waits_for("no mark", |station| status(station)["outdated"]["count"] == 0);
    assert!(station.log().contains("trough.dxf replaces in import the result of 20"), "{}", station.log());
    // A new part outdates it, too, and a station may be set up to act on that by itself.
    let second = station.desk.read("import/trough.dxf");
    append(&station, "[delivery]\noutdated = \"correct\"\n");
    station.desk.write("elsewhere/trough.obj", PART.replace("20 1", "20 2"));
    fs::rename(station.path("elsewhere/trough.obj"), station.path("hot/trough.obj")).unwrap();
    station.waits_for("a third result", |station| station.desk.read("import/trough.dxf") != second);
    assert_eq!(files(&station.path("archive/trough")).iter().filter(|name| name.ends_with("dxf")).count(), 1);
}

/// Writes the journal as version 0.1 did before part and settings were written out: what a drawing was made of is a bare
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

const TAKEN: &str = "taking 1 delivered drawing as up to date";

#[test]
fn drawings_of_an_older_version_are_outdated_by_what_changes_from_now_on() {
    let mut station = delivered();
    let first = station.desk.read("import/trough.dxf");
    append(&station, "[delivery]\noutdated = \"correct\"\n");
    make_journal_older(&station);
    station.start();
    station.waits_for("a word", |station| station.log().contains(TAKEN));
    // The journal has the present form of it then.
    station.waits_for("a look", |station| station.desk.text("state/journal.log").contains("\"basis\":\"v2:"));
    assert_eq!(status(&station)["outdated"]["count"], 0);
    station.kill();
    station.start();
    station.waits_for("a start", |station| station.log().matches("takes drops from").count() == 2);
    station.desk.write("skus/trough.toml", "[placement]\nplace_mm = [3, 0]\n");
    station.waits_for("another result", |station| station.desk.read("import/trough.dxf") != first);
    station.waits_for("no mark", |station| status(station)["outdated"]["count"] == 0);
    let log = station.log();
    assert_eq!(log.matches("as up to date").count(), 1, "{log}");
    assert_eq!(log.matches("trough.dxf replaces in import").count(), 1, "{log}");
}

/// The part lay there while the station was updated.
#[test]
fn a_new_part_outdates_drawings_of_an_older_version() {
    let station = delivered();
    let first = station.desk.read("import/trough.dxf");
    append(&station, "[delivery]\noutdated = \"correct\"\n");
    make_journal_older(&station);
    let said = station.once();
    assert!(said.out.starts_with("0 delivered") && said.err.contains(TAKEN), "{said:?}");
    make_journal_older(&station);
    station.desk.write("hot/trough.obj", PART.replace("20 1", "20 2"));
    let said = station.once();
    assert!(said.out.starts_with("1 delivered, 1 part learned"), "{said:?}");
    assert_ne!(station.desk.read("import/trough.dxf"), first);
    let said = station.once();
    assert!(said.out.starts_with("0 delivered") && !said.err.contains("as up to date"), "{said:?}");
}

/// Kept surfaces may be cleared away at any time; the parts are in the archive.
#[test]
fn a_lost_cache_outdates_nothing() {
    let station = delivered();
    let first = station.desk.read("import/trough.dxf");
    append(&station, "[delivery]\noutdated = \"correct\"\n");
    fs::remove_dir_all(station.path("cache")).unwrap();
    fs::remove_file(station.path("import/trough.dxf")).unwrap();
    let said = station.once();
    assert!(said.out.starts_with("0 delivered"), "{said:?}");
    assert!(!said.err.contains("outdated"), "{said:?}");
    // The next drawing has the surface fitted again, and the first one is up to date still.
    station.copy_into(&drawing("square"), "trough@2.dxf");
    let said = station.once();
    assert!(
        said.out.starts_with("1 delivered") && said.err.contains("restored from the archive"),
        "{said:?}"
    );
    assert_eq!(station.import(), ["trough@2.dxf"]);
    station.copy_into(&drawing("square"), "trough.dxf");
    assert!(station.once().out.starts_with("1 delivered"));
    assert_eq!(station.desk.read("import/trough.dxf"), first);
    // What changed meanwhile is found as soon as the part is known again.
    fs::remove_dir_all(station.path("cache")).unwrap();
    station.desk.write("skus/trough.toml", "[placement]\nplace_mm = [3, 0]\n");
    let said = station.once();
    assert!(said.out.starts_with("0 delivered"), "{said:?}");
    station.copy_into(&drawing("square"), "trough@3.dxf");
    let said = station.once();
    assert!(said.out.starts_with("3 delivered"), "{said:?}");
    assert_ne!(station.desk.read("import/trough.dxf"), first);
}

#[test]
fn a_drawing_dropped_again_is_delivered_again_as_the_settings_say() {
    for (repeat, after_it_is_gone, while_it_lies_there) in [
        ("never", "0 delivered", "already delivered at 20"),
        ("if-gone", "1 delivered", "was already delivered and lies in import unchanged"),
        ("always", "1 delivered", "was already delivered and is delivered again"),
    ] {
        let station = delivered();
        append(&station, &format!("[delivery]\nrepeat = \"{repeat}\"\n"));
        station.copy_into(&drawing("square"), "trough.dxf");
        let said = station.once();
        assert!(said.err.contains(while_it_lies_there), "{repeat}: {}", said.err);
        fs::remove_file(station.path("import/trough.dxf")).unwrap();
        station.copy_into(&drawing("square"), "trough.dxf");
        let said = station.once();
        assert!(said.out.starts_with(after_it_is_gone), "{repeat}: {}", said.out);
        assert_eq!(files(&station.path("hot")), [""; 0]);
    }
}

#[test]
fn settings_beside_a_drawing_hold_for_it_alone() {
    let station = delivered();
    let plain = station.desk.read("import/trough.dxf");
    let sidecar = "[placement]\nplace_mm = [1, 2]\nrotate_deg = 10\n[correction]\nmethod = \"none\"\n";
    station.desk.write("hot/trough@a.toml", sidecar);
    for name in ["trough@a.dxf", "trough@b.dxf"] {
        station.copy_into(&drawing("square"), name);
    }
    station.desk.write("hot/trough@c.toml", "[placement]\nplace = 3\n");
    station.copy_into(&drawing("square"), "trough@c.dxf");
    let said = station.once();
    assert!(
        said.out.starts_with("2 delivered, 0 parts learned, 1 rejected, 0 waiting, 0 inc"),
        "{}",
        said.out
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
    assert!(station.path("rejected/trough@c.toml").exists());
}

/// Marked on the shape of yesterday, every piece would be waste.
#[test]
fn a_rejected_part_holds_its_drawings_back() {
    let station = delivered();
    station.desk.write("hot/trough.obj", "v 0 0 0\nv 1 0 0\nf 1 2 9\n");
    station.copy_into(&drawing("square"), "trough@2.dxf");
    let said = station.once();
    assert!(said.out.contains("0 delivered, 0 parts learned, 1 rejected, 1 waiting"), "{}", said.out);
    assert!(said.out.contains("its older shape is not used"), "{}", said.out);
    fs::remove_file(station.path("rejected/trough.obj")).unwrap();
    assert!(station.once().out.starts_with("1 delivered"));
}

#[test]
fn a_log_file_is_written_beside_what_is_said() {
    let station = Station::new();
    append(&station, "[log]\nfile = \"log/station.log\"\n");
    station.desk.write("hot/x.pdf", "%PDF");
    let said = station.once();
    let logged = station.desk.text("log/station.log");
    assert!(logged.contains("WARN") && logged.contains("x.pdf rejected"), "{logged}");
    assert!(said.err.contains("x.pdf rejected") && !logged.contains('\u{1b}'));
}

#[test]
fn a_log_file_begun_or_changed_while_the_station_runs_is_told_to_count_later() {
    let station = Station::running();
    station.waits_for_file("state/status.json");
    append(&station, "[log]\nfile = \"log/station.log\"\n");
    station
        .waits_for("a word of it", |station| station.log().contains("`[log]` counts from the next start on"));
    assert!(!station.path("log").exists());
}

/// The other end of `sd_notify(3)`.
#[cfg(target_os = "linux")]
#[test]
fn a_service_manager_hears_that_the_station_is_ready_alive_and_stopping() {
    use std::os::unix::net::UnixDatagram;
    let mut station = Station::new();
    let socket = UnixDatagram::bind(station.path("ear")).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let hears = |words: &str| {
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
    command.env("NOTIFY_SOCKET", station.path("ear")).env("WATCHDOG_USEC", "1000000");
    let child = command.stderr(std::process::Stdio::null()).spawn().unwrap();
    let id = child.id().to_string();
    station.running = Some(child);
    for words in ["READY=1", "WATCHDOG=1", "WATCHDOG=1"] {
        hears(words);
    }
    assert!(Command::new("kill").args(["-s", "TERM", &id]).status().unwrap().success());
    hears("STOPPING=1");
}
