//! Which files a station keeps, and for how long.

use std::time::{Duration, Instant};

use fs_err as fs;
use serde_json::Value;

use crate::desk::{drawing, part};
use crate::station::{Station, files};

/// Less than a second in days, so that the files of one run are old in a later run.
const MOMENT: &str = "0.00001";

/// A station with two SKUs, three delivered drawings and a rejected one.
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
    let output = station.once();
    assert!(output.out.starts_with("3 delivered, 2 parts fitted, 1 rejected"), "{output:?}");
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
        let output = station.once();
        let tree = files(station.desk.root());
        assert!(started.elapsed() < Duration::from_secs(60), "{what}: {tree:#?}\n{output:?}");
    }
}

fn kept(station: &Station) -> Value {
    let output = station.desk.isomark(&["status", "station.toml", "--json"]);
    serde_json::from_str::<Value>(&output.out).unwrap()["kept"].clone()
}

#[test]
fn files_are_kept_for_their_time_and_status_shows_it() {
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
    let output = station.desk.isomark(&["status", "station.toml"]);
    assert!(
        output.out.contains("originals without limit, rejected drops for 365 days, reports for 365 days"),
        "{output:?}"
    );
}

#[test]
fn old_files_are_removed_and_needed_ones_are_kept() {
    let station = with_a_past();
    let old =
        ["reports_days", "archive_days", "rejected_days"].map(|key| format!("{key} = {MOMENT}\n")).concat();
    add(&station, &format!("[retention]\n{old}"));
    // Old files that isomark did not create are kept.
    let foreign = ["reports/note.txt", "reports/mouse/note.txt", "archive/note.txt", "archive/foreign/a.dxf"];
    let beside = ["archive/mouse/mouse@foreign.dxf", "archive/mouse/mouse.step", "archive/plate/old.glb"];
    for foreign in foreign.into_iter().chain(beside) {
        station.desk.write(foreign, "mine");
    }
    let originals =
        ["mouse/current-part.txt", "mouse/mouse.obj", "mouse/mouse.step", "mouse/mouse@foreign.dxf"];
    let parts = ["plate/current-part.txt", "plate/fc020-gui.bin", "plate/old.glb", "plate/plate.gltf"];
    let left = [&["foreign/a.dxf"], &originals[..], &["note.txt"], &parts[..]].concat();
    runs_until(&station, "old files are removed", |station| {
        let [archive, reports, rejected] =
            ["archive", "reports", "rejected"].map(|folder| files(&station.path(folder)));
        archive == left && reports == ["mouse/note.txt", "note.txt"] && rejected.is_empty()
    });
    assert_eq!(station.import().len(), 3, "delivered drawings must not be removed");

    // Parts are fitted again from the archive, and nothing is delivered twice.
    fs::remove_dir_all(station.path("cache")).unwrap();
    station.copy_into(&drawing("abc"), "mouse@third.dxf");
    station.copy_into(&drawing("ez-qr-hatch"), "plate.dxf");
    let output = station.once();
    assert!(
        output.out.starts_with("1 delivered, 0 parts fitted") && output.out.contains("\n1 already delivered"),
        "{output:?}"
    );
    assert!(output.err.contains("plate.dxf was already delivered and is unchanged in import"), "{output:?}");
    assert!(output.err.contains("restored the surface of plate from the archive"), "{output:?}");
    // New settings outdate the drawings; those without originals cause no error.
    add(&station, "[delivery]\noutdated = \"correct\"\n[correction]\ntolerance_mm = 0.02\n");
    let output = station.once();
    assert!(!output.err.contains("cannot be corrected again"), "{output:?}");
    let again = station.desk.isomark(&["retry", "station.toml", "--outdated"]);
    assert_eq!(again.code, 0, "{again:?}");
}

#[test]
fn a_rejected_part_is_kept_while_drawings_wait_for_it() {
    let station = with_a_past();
    station.desk.write("hot/mouse.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
    station.once();
    let rejected = files(&station.path("rejected"));
    assert!(rejected.contains(&"mouse.obj".into()), "{rejected:?}");
    add(&station, &format!("[retention]\nrejected_days = {MOMENT}\n"));
    let held = ["mouse.obj", "mouse.obj.reason.json", "mouse.obj.reason.txt"];
    runs_until(&station, "the other one is removed", |station| files(&station.path("rejected")) == held);
    station.copy_into(&drawing("abc"), "mouse@third.dxf");
    let output = station.once();
    assert!(output.out.contains("1 waiting"), "{output:?}");
}

#[test]
fn the_oldest_files_are_removed_when_the_folders_are_too_large() {
    let station = with_a_past();
    add(&station, "[retention]\nmax_gb = 0.000001\n");
    let output = station.once();
    assert!(
        files(&station.path("reports")).is_empty() && files(&station.path("rejected")).is_empty(),
        "{output:?}"
    );
    // Originals are kept forever, so the limit cannot be met.
    let archive = files(&station.path("archive"));
    assert!(
        archive.contains(&"mouse/mouse@first.dxf".into())
            && archive.contains(&"mouse/mouse@second.toml".into())
    );
    assert!(output.err.contains("more than `max_gb`"), "{output:?}");
    let status = station.desk.isomark(&["status", "station.toml"]);
    assert!(status.out.contains("problem: ") && status.out.contains("max_gb"), "{status:?}");
    assert_eq!(kept(&station)["too_much"], true);
    let text = station.desk.text("station.toml").replace("0.000001", "0.000001\narchive_days = 300");
    station.desk.write("station.toml", text);
    let output = station.once();
    let archive = files(&station.path("archive"));
    assert!(
        !archive.iter().any(|name| name.contains("first") || name.contains("second")),
        "{archive:?}\n{output:?}"
    );
    assert!(archive.contains(&"mouse/mouse.obj".into()) && archive.contains(&"plate/fc020-gui.bin".into()));
}
