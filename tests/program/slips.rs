//! Slips of people at a station: file names, paths and encodings that look right.

use fs_err as fs;

use crate::desk::drawing;
use crate::station::Station;

const CYLINDER: &str = "[part]\nshape = \"cylinder\"\ndiameter_mm = 60\nlength_mm = 180\n";

fn with_cylinder() -> Station {
    let station = Station::new();
    station.desk.write("skus/cyl.toml", CYLINDER);
    station
}

#[test]
fn a_drawing_waits_for_settings_with_a_wrong_ending() {
    for wrong in ["toml.txt", "TML"] {
        let station = with_cylinder();
        station.copy_into(&drawing("square"), "cyl@l.dxf");
        station.desk.write(&format!("hot/cyl@l.{wrong}"), "[placement]\nrotate_deg = 90\n");
        let output = station.once();
        assert!(station.import().is_empty() && output.out.starts_with("0 delivered"), "{output:?}");
        let misnamed = format!("cyl@l.{wrong}");
        assert!(
            output.err.contains(&misnamed) && output.err.contains("Rename it to cyl@l.toml"),
            "{output:?}"
        );
        fs::rename(station.path("hot").join(misnamed), station.path("hot/cyl@l.toml")).unwrap();
        let output = station.once();
        assert!(output.out.starts_with("1 delivered"), "{output:?}");
        assert!(station.path("archive/cyl/cyl@l.toml").exists());
    }
    // In the folder of the SKU, and a list.
    let station = with_cylinder();
    station.copy_into(&drawing("square"), "cyl@p.dxf");
    station.desk.write("hot/cyl@p.csv.txt", "name\nA\n");
    station.desk.write("hot/cyl/q.toml.txt", "");
    fs::copy(drawing("square"), station.path("hot/cyl/q.dxf")).unwrap();
    station.copy_into(&drawing("square"), "cyl@others.dxf");
    let output = station.once();
    assert_eq!(station.import(), ["cyl@others.dxf"], "{output:?}");
    assert!(output.err.contains("must be cyl@p.csv") && output.err.contains("must be q.toml"), "{output:?}");
}

#[test]
fn settings_of_a_sku_with_a_wrong_ending_are_named() {
    let station = Station::new();
    station.desk.write("skus/cyl.toml.txt", CYLINDER);
    station.copy_into(&drawing("square"), "cyl.dxf");
    let check = || station.desk.isomark(&["check", "station.toml"]);
    check().refused(2, &["cyl.toml.txt is not read", "Rename it to cyl.toml"]);
    let output = station.once();
    assert!(station.import().is_empty() && output.err.contains("Rename it to cyl.toml"), "{output:?}");
    // A copy beside the file is only mentioned.
    station.desk.write("skus/cyl.toml", CYLINDER);
    let output = check();
    assert!(output.code == 0 && output.out.contains("cyl.toml.txt is not read"), "{output:?}");
    let output = station.once();
    assert!(output.out.starts_with("1 delivered"), "{output:?}");
}

#[test]
fn paths_that_name_another_folder_than_they_seem_to_are_refused() {
    let station = Station::new();
    let text = station.desk.text("station.toml");
    for (path, words) in [
        ("\"out\\new\"", ["a line break", "single quotes"]),
        ("\"C:\\temp\\new\"", ["a tab", "single quotes"]),
        ("'%TEMP%\\reports'", ["%TEMP%", "whole path"]),
        ("\"~/reports\"", ["~", "whole path"]),
        ("\"$HOME/reports\"", ["$HOME", "whole path"]),
        ("\"${HOME}/reports\"", ["${HOME}", "whole path"]),
    ] {
        station
            .desk
            .write("station.toml", text.replace("[folders]\n", &format!("[folders]\nreports = {path}\n")));
        station.desk.isomark(&["check", "station.toml"]).refused(2, &words);
    }
    for path in ["100 %", "50% off/100% on", "data$", "a~b", "~b"] {
        station
            .desk
            .write("station.toml", text.replace("[folders]\n", &format!("[folders]\nreports = '{path}'\n")));
        let output = station.desk.isomark(&["check", "station.toml"]);
        assert_eq!(output.code, 0, "{path}: {output:?}");
    }
}

#[test]
fn settings_in_another_encoding_are_named() {
    let station = Station::new();
    let text = station.desk.text("station.toml").replace("test", "Laser für Dosen");
    let utf_16: Vec<u8> =
        "\u{feff}".encode_utf16().chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    let ansi: Vec<u8> = text.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
    for (bytes, encoding) in [(utf_16, "UTF-16"), (ansi, "ANSI")] {
        station.desk.write("station.toml", bytes);
        station.desk.isomark(&["check", "station.toml"]).refused(2, &[encoding, "Save it as UTF-8"]);
    }
}

#[test]
fn a_folder_that_cannot_be_made_and_a_hot_folder_in_use_are_found_before_the_start() {
    let mut station = Station::new();
    let text = station.desk.text("station.toml");
    let long = "x".repeat(300);
    station
        .desk
        .write("long.toml", text.replace("[folders]\n", &format!("[folders]\nreports = 'new/{long}'\n")));
    let output = station.desk.isomark(&["check", "long.toml"]);
    assert!(output.code != 0 && output.err.contains("cannot be made"), "{output:?}");
    assert!(!station.path("new").exists(), "it is removed again");
    station.start();
    station.waits_for_file("state/status.json");
    station.desk.write("second.toml", text.replace("[folders]\n", "[folders]\nstate = 'second'\n"));
    let output = station.desk.isomark(&["check", "second.toml"]);
    assert!(output.code != 0 && output.err.contains("Another station uses the hot folder"), "{output:?}");
    // The station itself may run.
    assert_eq!(station.desk.isomark(&["check", "station.toml"]).code, 0);
}

#[test]
fn the_station_may_follow_the_option_for_outdated_drawings() {
    let station = Station::new();
    station.once();
    let output = station.desk.isomark(&["retry", "--outdated", "station.toml"]);
    assert!(output.code == 0 && output.out.contains("outdated drawings will be corrected"), "{output:?}");
    station.desk.isomark(&["retry", "--outdated", "can"]).refused(2, &["names no station"]);
    assert_eq!(station.desk.isomark(&["retry", "station.toml", "--outdated", "can"]).code, 0);
}

#[cfg(unix)]
#[test]
fn rejected_drops_are_not_counted_through_links() {
    let station = Station::new();
    station.once();
    let elsewhere = tempfile::tempdir().unwrap();
    fs::write(elsewhere.path().join("a.dxf.reason.json"), "{}").unwrap();
    std::os::unix::fs::symlink(elsewhere.path(), station.path("rejected/link")).unwrap();
    let status = station.desk.isomark(&["status", "station.toml", "--json"]);
    let status: serde_json::Value = serde_json::from_str(&status.out).unwrap();
    assert_eq!(status["in_rejected"], 0);
}
