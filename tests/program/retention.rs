//! What a station keeps, and for how long.

use std::time::{Duration, Instant};

use fs_err as fs;
use serde_json::Value;

use crate::desk::{drawing, part};
use crate::station::{Station, files};

/// Less than a second: what one run files is old in a later one.
const MOMENT: &str = "0.00001";

/// A station that knows two SKUs, delivered three drawings and rejected one.
fn with_a_past() -> Station {
    let station = Station::new();
    station.desk.write("skus/plate.toml", "[placement]\nplace_mm = [0, 0]\n");
    station.copy_into(&part("mouse/fc020-coarse-mesh.obj"), "mouse.obj");
    let [text, buffer] = ["gltf", "bin"].map(|kind| part(&format!("assembly/fc020-gui.{kind}")));
    station.copy_into(&text, "plate.gltf");
    station.copy_into(&buffer, "fc020-gui.bin");
    station.copy_into(&drawing("abc"), "mouse@first.dxf");
    station.copy_into(&drawing("abc"), "mouse@second.dxf");
    station.desk.write("hot/mouse@second.toml", "[placement]\nplace_mm = [1, 1]\n");
    station.copy_into(&drawing("ez-qr-hatch"), "plate.dxf");
    station.desk.write("hot/mouse@bad.dxf", "no drawing");
    let said = station.once();
    assert!(said.out.starts_with("3 delivered, 2 parts learned, 1 rejected"), "{said:?}");
    station
}

fn add(station: &Station, settings: &str) {
    let text = station.desk.text("station.toml");
    station.desk.write("station.toml", format!("{text}{settings}"));
}

/// Runs the station until a condition holds.
fn runs_until(station: &Station, what: &str, condition: impl Fn(&Station) -> bool) {
    let started = Instant::now();
    while !condition(station) {
        let said = station.once();
        let tree = files(station.desk.root());
        assert!(started.elapsed() < Duration::from_secs(60), "{what}: {tree:#?}\n{said:?}");
    }
}

fn kept(station: &Station) -> Value {
    let said = station.desk.isomark(&["status", "station.toml", "--json"]);
    serde_json::from_str::<Value>(&said.out).unwrap()["kept"].clone()
}

#[test]
fn nothing_goes_before_its_time_and_status_names_it() {
    let station = with_a_past();
    let before = files(station.desk.root());
    station.once();
    assert_eq!(files(station.desk.root()), before);
    let kept = kept(&station);
    assert_eq!((&kept["reports_days"], &kept["rejected_days"]), (&365.0.into(), &365.0.into()));
    assert!(kept["archive_days"].is_null() && kept["max_bytes"].is_null(), "{kept}");
    let size = |folder: &str| -> u64 {
        let names = files(&station.path(folder));
        names.iter().map(|name| fs::metadata(station.path(folder).join(name)).unwrap().len()).sum()
    };
    assert_eq!(kept["bytes"], size("archive") + size("rejected") + size("reports"));
    let said = station.desk.isomark(&["status", "station.toml"]);
    assert!(
        said.out.contains("originals for ever, rejected drops for 365 days, reports for 365 days"),
        "{said:?}"
    );
}

#[test]
fn old_files_go_and_what_is_needed_stays() {
    let station = with_a_past();
    let old =
        ["reports_days", "archive_days", "rejected_days"].map(|key| format!("{key} = {MOMENT}\n")).concat();
    add(&station, &format!("[retention]\n{old}"));
    // What is old is left alone where isomark did not put it.
    let foreign = ["reports/note.txt", "reports/mouse/note.txt", "archive/note.txt", "archive/foreign/a.dxf"];
    let beside = ["archive/mouse/mouse@foreign.dxf", "archive/mouse/mouse.step", "archive/plate/old.glb"];
    for foreign in foreign.into_iter().chain(beside) {
        station.desk.write(foreign, "mine");
    }
    let originals =
        ["mouse/current-part.txt", "mouse/mouse.obj", "mouse/mouse.step", "mouse/mouse@foreign.dxf"];
    let parts = ["plate/current-part.txt", "plate/fc020-gui.bin", "plate/old.glb", "plate/plate.gltf"];
    let left = [&["foreign/a.dxf"], &originals[..], &["note.txt"], &parts[..]].concat();
    runs_until(&station, "old files go", |station| {
        let [archive, reports, rejected] =
            ["archive", "reports", "rejected"].map(|folder| files(&station.path(folder)));
        archive == left && reports == ["mouse/note.txt", "note.txt"] && rejected.is_empty()
    });
    assert_eq!(station.import().len(), 3, "what was delivered is not isomark's any more");

    // Parts are fitted again from the archive, and nothing is delivered twice.
    fs::remove_dir_all(station.path("cache")).unwrap();
    station.copy_into(&drawing("abc"), "mouse@third.dxf");
    station.copy_into(&drawing("ez-qr-hatch"), "plate.dxf");
    let said = station.once();
    assert!(said.out.starts_with("2 delivered, 0 parts learned"), "{said:?}");
    assert!(said.err.contains("plate.dxf was already delivered and lies in import unchanged"), "{said:?}");
    assert!(said.err.contains("the surface of plate is restored from the archive"), "{said:?}");
    // New settings outdate the drawings, and those without originals are nobody's trouble.
    add(&station, "[delivery]\noutdated = \"correct\"\n[correction]\ntolerance_mm = 0.02\n");
    let said = station.once();
    assert!(!said.err.contains("cannot be corrected again"), "{said:?}");
    let again = station.desk.isomark(&["retry", "station.toml", "--outdated"]);
    assert_eq!(again.code, 0, "{again:?}");
}

#[test]
fn a_rejected_part_for_which_patterns_wait_stays() {
    let station = with_a_past();
    station.desk.write("hot/mouse.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
    station.once();
    let rejected = files(&station.path("rejected"));
    assert!(rejected.contains(&"mouse.obj".into()), "{rejected:?}");
    add(&station, &format!("[retention]\nrejected_days = {MOMENT}\n"));
    let held = ["mouse.obj", "mouse.obj.reason.json", "mouse.obj.reason.txt"];
    runs_until(&station, "the other one goes", |station| files(&station.path("rejected")) == held);
    station.copy_into(&drawing("abc"), "mouse@third.dxf");
    let said = station.once();
    assert!(said.out.contains("1 waiting"), "{said:?}");
}

#[test]
fn the_oldest_go_when_the_folders_are_too_large() {
    let station = with_a_past();
    add(&station, "[retention]\nmax_gb = 0.000001\n");
    let said = station.once();
    assert!(
        files(&station.path("reports")).is_empty() && files(&station.path("rejected")).is_empty(),
        "{said:?}"
    );
    // Originals are kept for ever, so the limit cannot be held.
    let archive = files(&station.path("archive"));
    assert!(
        archive.contains(&"mouse/mouse@first.dxf".into())
            && archive.contains(&"mouse/mouse@second.toml".into())
    );
    assert!(said.err.contains("more than `max_gb`"), "{said:?}");
    let status = station.desk.isomark(&["status", "station.toml"]);
    assert!(status.out.contains("trouble: ") && status.out.contains("max_gb"), "{status:?}");
    assert_eq!(kept(&station)["too_much"], true);
    let text = station.desk.text("station.toml").replace("0.000001", "0.000001\narchive_days = 300");
    station.desk.write("station.toml", text);
    let said = station.once();
    let archive = files(&station.path("archive"));
    assert!(
        !archive.iter().any(|name| name.contains("first") || name.contains("second")),
        "{archive:?}\n{said:?}"
    );
    assert!(archive.contains(&"mouse/mouse.obj".into()) && archive.contains(&"plate/fc020-gui.bin".into()));
}
