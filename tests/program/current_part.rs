//! Which part a station marks on when its cache, its archive and other versions of isomark do not agree.

use std::path::Path;

use fs_err as fs;
use serde_json::Value;

use crate::desk::drawing;
use crate::station::Station;

/// A trough of 100 mm that is as deep as this, mm.
fn trough(depth: f64) -> String {
    let rows = [-50, 50].map(|y| format!("v -50 {y} {depth}\nv 0 {y} 0\nv 50 {y} {depth}\n"));
    format!("{}f 1 2 5 4\nf 2 3 6 5\n", rows.concat())
}

fn drop_part(station: &Station, name: &str, depth: f64) {
    station.desk.write(&format!("hot/{name}"), trough(depth));
    let output = station.once();
    assert!(output.out.contains("1 part fitted"), "{output:?}");
}

/// The part that a new drawing is marked on; `None` if the drawing waits.
fn marked_on(station: &Station, name: &str) -> Option<String> {
    station.copy_into(&drawing("abc"), &format!("p@{name}.dxf"));
    let output = station.once();
    let report = fs::read(station.path(&format!("reports/p/p@{name}.dxf.report.json"))).ok()?;
    assert!(!output.out.starts_with("0 delivered"), "{output:?}");
    let report: Value = serde_json::from_slice(&report).unwrap();
    Some(report["part"]["file"].as_str().unwrap().to_owned())
}

fn copy_all(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let place = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy_all(&entry.path(), &place);
        } else {
            fs::copy(entry.path(), place).unwrap();
        }
    }
}

/// What an older version leaves when a part is dropped: it knows nothing of the records of this one.
fn older_version_learns(station: &Station, name: &str, depth: f64, tells_cache: bool) {
    let part = trough(depth);
    if tells_cache {
        let hash = blake3::hash(part.as_bytes()).to_hex();
        station.desk.write("cache/v7/p/current.toml", format!("file = \"{name}\"\nblake3 = \"{hash}\"\n"));
    }
    station.desk.write(&format!("archive/p/(2)/{name}"), part);
    station.desk.write("archive/p/current-part.txt", format!("(2)/{name}\n"));
}

#[test]
fn an_older_copy_of_the_cache_does_not_bring_back_an_older_part() {
    let station = Station::new();
    drop_part(&station, "p@a.obj", 5.0);
    assert_eq!(marked_on(&station, "1").unwrap(), "p@a.obj");
    copy_all(&station.path("cache"), &station.path("backup"));
    drop_part(&station, "p@b.obj", 9.0);
    assert_eq!(marked_on(&station, "2").unwrap(), "p@b.obj");
    fs::remove_dir_all(station.path("cache")).unwrap();
    copy_all(&station.path("backup"), &station.path("cache"));
    // Neither is a drawing outdated that was marked on the newer part.
    let retry = station.desk.isomark(&["retry", "station.toml", "--outdated", "p"]);
    let output = station.once();
    assert!(
        output.err.contains("restored the surface of p from the archive: p@b.obj"),
        "{retry:?} {output:?}"
    );
    let report: Value = serde_json::from_slice(&station.desk.read("reports/p/p@2.dxf.report.json")).unwrap();
    assert_eq!(report["part"]["file"], "p@b.obj");
    let report: Value = serde_json::from_slice(&station.desk.read("reports/p/p@1.dxf.report.json")).unwrap();
    assert_eq!(report["part"]["file"], "p@b.obj", "it was outdated");
    assert_eq!(marked_on(&station, "3").unwrap(), "p@b.obj");
    // Without any cache, too; and a part that is dropped again is the current one.
    fs::remove_dir_all(station.path("cache")).unwrap();
    assert_eq!(marked_on(&station, "4").unwrap(), "p@b.obj");
    drop_part(&station, "p@a.obj", 5.0);
    assert_eq!(marked_on(&station, "5").unwrap(), "p@a.obj");
}

#[test]
fn a_part_that_an_older_version_learned_since_is_the_current_one() {
    for tells_cache in [true, false] {
        let station = Station::new();
        drop_part(&station, "p@a.obj", 5.0);
        assert_eq!(marked_on(&station, "1").unwrap(), "p@a.obj");
        older_version_learns(&station, "p@b.obj", 9.0, tells_cache);
        assert_eq!(marked_on(&station, "2").unwrap(), "p@b.obj", "{tells_cache}");
        // That version is told of the next part.
        drop_part(&station, "p@c.obj", 7.0);
        assert_eq!(marked_on(&station, "3").unwrap(), "p@c.obj");
        if tells_cache {
            assert!(station.desk.text("cache/v7/p/current.toml").contains("p@c.obj"));
        }
    }
}

#[test]
fn a_part_of_an_older_version_at_another_station_is_not_replaced_by_an_older_one() {
    let station = Station::new();
    drop_part(&station, "p@a.obj", 5.0);
    station.desk.write("cache/v7/p/current.toml", "file = \"theirs.obj\"\nblake3 = \"00\"\n");
    assert_eq!(marked_on(&station, "1"), None);
    let status = station.desk.isomark(&["status", "station.toml"]);
    assert!(status.out.contains("another station has fitted a newer part"), "{status:?}");
    drop_part(&station, "p@b.obj", 9.0);
    assert_eq!(marked_on(&station, "2").unwrap(), "p@b.obj");
}

#[test]
fn stations_that_share_a_cache_agree_also_after_it_is_lost() {
    let [one, other] = [(); 2].map(|()| Station::new());
    let folder = one.path("cache");
    for station in [&one, &other] {
        let text = station.desk.text("station.toml");
        let text = text.replace("[folders]\n", &format!("[folders]\ncache = '{}'\n", folder.display()));
        station.desk.write("station.toml", text);
    }
    drop_part(&one, "p@a.obj", 5.0);
    drop_part(&other, "p@b.obj", 9.0);
    for station in [&one, &other] {
        assert_eq!(marked_on(station, "1").unwrap(), "p@b.obj");
    }
    fs::remove_dir_all(&folder).unwrap();
    // The first station has only the older part.
    assert_eq!(marked_on(&one, "2"), None);
    let status = one.desk.isomark(&["status", "station.toml"]);
    assert!(
        status.out.contains("p@b.obj") && status.out.contains("was not dropped at this station"),
        "{status:?}"
    );
    assert_eq!(marked_on(&other, "2").unwrap(), "p@b.obj");
    assert_eq!(marked_on(&one, "3"), Some("p@b.obj".into()));
}

/// The cache of a station before its upgrade has no records; that it was used before shows in them from then on.
#[test]
fn a_station_is_upgraded_beside_one_that_is_not() {
    let station = Station::new();
    drop_part(&station, "p@a.obj", 5.0);
    fs::remove_dir_all(station.path("cache/parts")).unwrap();
    fs::remove_dir_all(station.path("state/parts")).unwrap();
    assert_eq!(marked_on(&station, "1").unwrap(), "p@a.obj");
    assert!(station.path("cache/parts/p.toml").exists() && station.path("state/parts/p.note").exists());
    // The other station knows only this file.
    station.desk.write("cache/v35/p/current.toml", "file = \"theirs.obj\"\nblake3 = \"00\"\n");
    assert_eq!(marked_on(&station, "2"), None);
    drop_part(&station, "p@a.obj", 5.0);
    assert_eq!(marked_on(&station, "3").unwrap(), "p@a.obj");
}
