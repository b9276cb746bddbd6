//! Settings of SKUs that the office releases to the stations.

use fs_err as fs;
use serde_json::Value;

use crate::desk::{Desk, Output};
use crate::fits::hash;
use crate::proxy::Proxy;
use crate::server::{SECRET, Server, waits_for};
use crate::station::{Station, in_fleet, line, trough};
use crate::tables::{fleet, server_with_tables};

/// Settings that turn the drawing.
pub fn turned(degrees: u32) -> String {
    format!("# The turn of the can.\n[placement]\nrotate_deg = {degrees}\n")
}

/// A server with an office, and its URL there.
fn with_office() -> Option<(Server, Desk, String)> {
    let (server, desk) = server_with_tables()?;
    server.login("office", "office");
    let url = server.url("office");
    Some((server, desk, url))
}

/// Releases settings, with further options.
#[track_caller]
pub fn release(desk: &Desk, url: &str, sku: &str, settings: &str, options: &[&str]) -> Output {
    desk.write("given.toml", settings);
    let output = fleet(desk, &[&["release", sku, "given.toml", url], options].concat());
    assert_eq!(output.code, 0, "{output:?}");
    output
}

/// The file with the settings of a SKU at a station.
pub fn file(station: &Station, name: &str) -> String {
    fs::read_to_string(station.path("skus").join(name)).unwrap_or_default()
}

/// The settings of a released file, without its two comment lines.
fn settings(station: &Station, name: &str) -> String {
    file(station, name).splitn(3, '\n').nth(2).unwrap_or_default().to_owned()
}

/// What a delivered drawing draws.
fn entities(station: &Station, name: &str) -> String {
    let drawing = fs::read_to_string(station.path("import").join(name)).unwrap();
    drawing.split("ENTITIES").nth(1).unwrap().to_owned()
}

fn station(server: &Server, name: &str) -> Station {
    server.login(name, "station");
    let station = Station::of(name, &server.url(name));
    station.waits_for_fleet(1);
    station
}

/// What the station does with the settings of a SKU, as the fleet knows it.
fn known(server: &Server, desk: &Desk, station: &str) -> Value {
    let output = fleet(desk, &["status", &server.url("owner"), "--json"]);
    assert_eq!(output.code, 0, "{output:?}");
    let status: Value = serde_json::from_str(&output.out).unwrap();
    let all = status["settings"].as_array().unwrap();
    all.iter().find(|each| each["station"] == station).cloned().unwrap_or_default()
}

#[track_caller]
fn is_known(server: &Server, desk: &Desk, station: &str, state: &str, version: u64) {
    let seen = || known(server, desk, station)["skus"][0].clone();
    let is_it = || seen()["state"] == state && seen()["version"] == version;
    waits_for(&format!("{state} {version} at {station}"), is_it, || seen().to_string());
}

#[test]
fn released_settings_reach_every_station_with_version_author_and_diff() {
    let Some((server, desk, url)) = with_office() else { return };
    let [one, two] = ["laser1", "laser2"].map(|name| station(&server, name));
    for station in [&one, &two] {
        station.drop_in("can.obj", &trough(1.0));
        station.drop_in("can.dxf", &line(9.0));
        station.waits_for_file("import/can.dxf");
    }
    let output = release(&desk, &url, "can", &turned(90), &["--author", "Anna [x]"]);
    assert!(output.err.contains("can: released version 1 for all stations"), "{output:?}");
    assert!(output.out.contains("  + rotate_deg = 90"), "{output:?}");
    for station in [&one, &two] {
        station.waits_for("the file", |station| settings(station, "can.toml") == turned(90));
        let head: Vec<String> = file(station, "can.toml").lines().take(2).map(str::to_owned).collect();
        assert!(head[0].starts_with("# isomark-release 1 "), "{head:?}");
        let about = "# version 1 of can for all stations, released by Anna [x] (office) at 20";
        assert!(head[1].starts_with(about), "{head:?}");
        station.waits_for("the diff", |station| {
            station.logged("received settings: version 1 of can for all stations, released by Anna") == 1
                && station.logged("+ rotate_deg = 90") > 0
        });
        // As after any change of settings: the drawing that was corrected with the older ones is outdated.
        station.waits_for("the outdated drawing", |station| station.status()["outdated"]["count"] == 1);
        assert_eq!(station.troubles(), "[]");
    }
    // A new drawing uses the settings: the line runs upwards now.
    one.drop_in("can@new.dxf", &line(9.0));
    one.waits_for_file("import/can@new.dxf");
    assert_ne!(entities(&one, "can@new.dxf"), entities(&one, "can.dxf"));
    // The same again is no version.
    let output = release(&desk, &url, "CAN", &turned(90), &[]);
    assert!(output.err.contains("version 1 for all stations has these settings already"), "{output:?}");
    let output = release(&desk, &url, "can", &turned(45), &[]);
    assert!(output.err.contains("version 2") && output.out.contains("  - rotate_deg = 90"), "{output:?}");
    for station in [&one, &two] {
        station.waits_for("the second file", |station| settings(station, "can.toml") == turned(45));
        station.waits_for("the diff", |station| station.logged("- rotate_deg = 90; + rotate_deg = 45") > 0);
    }
    for name in ["laser1", "laser2"] {
        is_known(&server, &desk, name, "current", 2);
    }
    let words = fleet(&desk, &["status", &url]).out;
    assert_eq!(words.matches("settings: 1 of 1 as released").count(), 2, "{words}");
    let history = fleet(&desk, &["release", "can", "--history", &url, "--json"]);
    let history: Value = serde_json::from_str(&history.out).unwrap();
    let versions = history["versions"].as_array().unwrap();
    assert_eq!(versions.len(), 2);
    assert_eq!(versions[0]["blake3"], hash(&turned(45)));
    assert_eq!(versions[0]["stations"], serde_json::json!(["laser1", "laser2"]));
    assert_eq!((&versions[0]["current"], &versions[1]["current"]), (&true.into(), &false.into()));
    assert_eq!((&versions[1]["author"], &versions[1]["login"]), (&"Anna [x]".into(), &"office".into()));
    let words = fleet(&desk, &["release", "can", "--history", &url]).out;
    assert!(words.contains("current; used by laser1, laser2"), "{words}");
}

#[test]
fn settings_for_one_station_are_used_in_place_of_those_for_all_until_they_are_removed() {
    let Some((server, desk, url)) = with_office() else { return };
    let [one, two] = ["laser1", "laser 2"].map(|name| {
        let login = name.replace(' ', "");
        server.login(&login, "station");
        let station = Station::of(name, &server.url(&login));
        station.waits_for_fleet(1);
        station
    });
    let have = |first: &str, second: &str| {
        for (station, wanted) in [(&one, first), (&two, second)] {
            station.waits_for(wanted, |station| settings(station, "can.toml") == wanted);
        }
    };
    desk.write("given.toml", turned(30));
    fleet(&desk, &["release", "can", "given.toml", &url, "--station", "lasre 2"])
        .refused(2, &["lasre 2", "Did you mean \"laser 2\"?"]);
    release(&desk, &url, "can", &turned(30), &["--station", "laser 2"]);
    have("", &turned(30));
    release(&desk, &url, "can", &turned(60), &[]);
    have(&turned(60), &turned(30));
    let remove = |options: &[&str], words: &str| {
        let output = fleet(&desk, &[&["release", "can", "--remove", &url], options].concat());
        assert!(output.code == 0 && output.err.contains(words), "{output:?}");
    };
    let own = ["--station", "laser 2"];
    remove(&own, "can: removed the settings for the station laser 2, as version 3");
    have(&turned(60), &turned(60));
    remove(&own, "nothing to remove");
    release(&desk, &url, "can", &turned(15), &own);
    have(&turned(60), &turned(15));
    remove(&[], "can: removed the settings for all stations, as version 5");
    have("", &turned(15));
    assert!(!one.path("skus/can.toml").exists());
    remove(&own, "version 6");
    have("", "");
    let words = || fleet(&desk, &["status", &url]).out;
    waits_for("no settings", || !words().contains("settings:"), words);
}

#[test]
fn broken_settings_are_refused_at_release_with_their_place() {
    let Some((server, desk, url)) = with_office() else { return };
    let refused = |text: &str, words: &[&str]| {
        desk.write("can.toml", text);
        fleet(&desk, &["release", "can", "can.toml", &url]).refused(2, words);
    };
    refused(
        "[placement]\nrotate_dge = 90\n",
        &["can.toml", "line 2", "rotate_dge", "Did you mean `rotate_deg`?", "^"],
    );
    refused("[placement]\nrotate_deg = \"x\"\n", &["can.toml", "line 2", "^"]);
    refused("[field]\nwidth_mm = 100\n", &["field"]);
    refused("[placement\n", &["line 1"]);
    refused(&format!("# {}", "x".repeat(1 << 20)), &["too large", "1048576"]);
    refused(&"\n".repeat(5001), &["too large", "5000"]);
    desk.write("can.toml", [0xff, 0xfe, b'x']);
    fleet(&desk, &["release", "can", "can.toml", &url]).refused(2, &["can.toml", "UTF-8"]);
    fleet(&desk, &["release", "can", "absent.toml", &url]).refused(2, &["absent.toml"]);
    desk.write("can.toml", turned(90));
    fleet(&desk, &["release", "../can", "can.toml", &url]).refused(2, &["SKU name"]);
    fleet(&desk, &["release", "can", &url]).refused(2, &["settings file or the address"]);
    fleet(&desk, &["release", "can", "can.toml", &url, "--remove"]).refused(2, &["--remove"]);
    fleet(&desk, &["release", "can", "can.toml", &url, "--author", "a\nb"]).refused(2, &["--author"]);
    assert_eq!(server.sql("isomark", "SELECT count(*) FROM isomark.release"), "0");
    // Settings that are wrong only together with those of a station, whose login may not release.
    server.login("laser1", "station");
    let of_station = format!("[serial]\nlast = 100\n{}", in_fleet(&server.url("laser1")));
    let station = Station::new("laser1", &of_station);
    desk.write("can.toml", "[serial]\nstart = 200\n");
    let settings = station.path("station.toml").display().to_string();
    for place in [&[settings.as_str()][..], &[&url, "--with", &settings]] {
        fleet(&desk, &[&["release", "can", "can.toml"], place].concat())
            .refused(2, &["can.toml", "line 2", "100"]);
    }
    desk.write("well.toml", "[serial]\nstart = 50\n");
    fleet(&desk, &["release", "cup", "well.toml", &settings])
        .refused(3, &["permission denied", "GRANT isomark_office"]);
    assert_eq!(fleet(&desk, &["release", "cup", "well.toml", &url, "--with", &settings]).code, 0);
    server.sql("isomark", "DELETE FROM isomark.current_release; DELETE FROM isomark.release");
    assert_eq!(fleet(&desk, &["release", "can", "can.toml", &url]).code, 0);
    assert_eq!(server.sql("isomark", "SELECT count(*) FROM isomark.release"), "1");
}

/// What is released while a station is cut off or killed is received afterwards, also the removal.
#[test]
fn a_station_that_was_away_receives_what_it_missed() {
    let Some((server, desk, url)) = with_office() else { return };
    server.login("laser1", "station");
    let proxy = Proxy::to(server.port);
    release(&desk, &url, "before", &turned(1), &[]);
    let mut station = Station::of("laser1", &proxy.url("laser1"));
    station.waits_for("the first settings", |station| settings(station, "before.toml") == turned(1));
    proxy.cut();
    station.waits_for("the trouble", |station| station.troubles().contains("cannot be reached"));
    for (sku, degrees) in [("a", 2), ("Bee", 3), ("a", 4)] {
        release(&desk, &url, sku, &turned(degrees), &[]);
    }
    fleet(&desk, &["release", "before", "--remove", &url]);
    proxy.pass();
    station.waits_for("what it missed", |station| {
        settings(station, "a.toml") == turned(4)
            && settings(station, "Bee.toml") == turned(3)
            && !station.path("skus/before.toml").exists()
    });
    station.kill();
    release(&desk, &url, "a", &turned(5), &[]);
    station.start();
    station.waits_for("what it missed", |station| settings(station, "a.toml") == turned(5));
    assert_eq!(station.logged("received settings: version 1 of a "), 0, "only the newest: {}", station.log());
    // Without its state folder it compares the files themselves.
    station.kill();
    fs::remove_dir_all(station.path("state/fleet")).unwrap();
    release(&desk, &url, "a", &turned(6), &[]);
    station.start();
    station.waits_for("the newest", |station| settings(station, "a.toml") == turned(6));
    assert!(!station.path("skus/a.toml.local").exists(), "what was released earlier is no local change");
    assert_eq!(station.troubles(), "[]");
}

#[test]
fn a_local_change_is_kept_beside_and_replaced() {
    let Some((server, desk, url)) = with_office() else { return };
    server.login("laser1", "station");
    let proxy = Proxy::to(server.port);
    let mut station = Station::new("laser1", &in_fleet(&proxy.url("laser1")));
    // A file that the station had before the first release is a local change, too; one with the same settings is none.
    station.desk.write("skus/can.toml", "# by hand\n[placement]\nrotate_deg = 10\n");
    station.desk.write("skus/same.toml", turned(90));
    station.start();
    station.waits_for_fleet(1);
    release(&desk, &url, "can", &turned(90), &[]);
    release(&desk, &url, "same", &turned(90), &[]);
    station.waits_for("the release", |station| settings(station, "can.toml") == turned(90));
    station.waits_for("the other one", |station| settings(station, "same.toml") == turned(90));
    assert!(!station.path("skus/same.toml.local").exists());
    assert_eq!(file(&station, "can.toml.local"), "# by hand\n[placement]\nrotate_deg = 10\n");
    station.waits_for("the notice", |station| station.troubles().contains("it is kept as can.toml.local"));
    is_known(&server, &desk, "laser1", "current", 1);
    // Somebody has looked after it.
    fs::remove_file(station.path("skus/can.toml.local")).unwrap();
    station.waits_for("no notice", |station| station.troubles() == "[]");
    // A change of the released file is never used, also while the database is away, and nothing of it is lost.
    station.drop_in("can.obj", &trough(1.0));
    station.drop_in("can.dxf", &line(9.0));
    station.waits_for_file("import/can.dxf");
    let change = |station: &Station, degrees: u32| {
        station.desk.write("skus/can.toml", turned(degrees));
    };
    change(&station, 20);
    station.waits_for("the release again", |station| settings(station, "can.toml") == turned(90));
    assert_eq!(file(&station, "can.toml.local"), turned(20));
    proxy.cut();
    station.waits_for("the trouble", |station| station.troubles().contains("cannot be reached"));
    change(&station, 40);
    station.waits_for("the release again", |station| settings(station, "can.toml") == turned(90));
    assert_eq!(file(&station, "can.toml.local-2"), turned(40));
    // The same change again is kept once.
    change(&station, 20);
    station.waits_for("the release again", |station| settings(station, "can.toml") == turned(90));
    assert!(!station.path("skus/can.toml.local-3").exists());
    // While it does not run, and with the file removed.
    station.kill();
    change(&station, 50);
    station.start();
    station.waits_for("the release again", |station| settings(station, "can.toml") == turned(90));
    assert_eq!(file(&station, "can.toml.local-3"), turned(50));
    station.kill();
    fs::remove_file(station.path("skus/can.toml")).unwrap();
    station.start();
    station.drop_in("can@2.dxf", &line(9.0));
    station.waits_for_file("import/can@2.dxf");
    assert_eq!(settings(&station, "can.toml"), turned(90));
    assert_eq!(
        entities(&station, "can@2.dxf"),
        entities(&station, "can.dxf"),
        "the release was used for both"
    );
    for degrees in [20, 40, 50] {
        let used = format!("using the changed settings of SKU `can`: placement.rotate_deg = {degrees}");
        assert_eq!(station.logged(&used), 0, "{}", station.log());
    }
    assert_eq!(station.status()["outdated"]["count"], 0);
    // Half a file, as an editor writes it, is kept when it is complete: nothing is lost.
    proxy.pass();
    station.waits_for("the fleet", |station| !station.troubles().contains("cannot be reached"));
    // A removed release takes the file with it, and a change of it is kept.
    station.kill();
    change(&station, 60);
    fleet(&desk, &["release", "can", "--remove", &url]);
    station.start();
    station.waits_for("no file", |station| !station.path("skus/can.toml").exists());
    assert_eq!(file(&station, "can.toml.local-4"), turned(60));
}

#[test]
fn a_local_change_is_used_where_the_station_allows_it() {
    let Some((server, desk, url)) = with_office() else { return };
    server.login("laser1", "station");
    let settings_of_station = format!("{}local_settings = \"allow\"\n", in_fleet(&server.url("laser1")));
    let mut station = Station::new("laser1", &settings_of_station);
    station.desk.write("skus/can.toml", turned(10));
    station.start();
    station.waits_for_fleet(1);
    release(&desk, &url, "can", &turned(90), &[]);
    let notice = "can.toml of this station is used in place of version 1 that the office released for can";
    station.waits_for("the notice", |station| station.troubles().contains(notice));
    assert_eq!(file(&station, "can.toml"), turned(10));
    assert_eq!(station.logged(notice), 1, "{}", station.log());
    is_known(&server, &desk, "laser1", "local", 1);
    let words = fleet(&desk, &["status", &url]).out;
    assert!(
        words.contains("settings: 0 of 1 as released; can: a local change is used in place of version 1"),
        "{words}"
    );
    // Without its file, the release is used.
    fs::remove_file(station.path("skus/can.toml")).unwrap();
    station.waits_for("the release", |station| settings(station, "can.toml") == turned(90));
    station.waits_for("no notice", |station| station.troubles() == "[]");
    is_known(&server, &desk, "laser1", "current", 1);
    station.desk.write("skus/can.toml", turned(20));
    is_known(&server, &desk, "laser1", "local", 1);
    release(&desk, &url, "can", &turned(45), &[]);
    is_known(&server, &desk, "laser1", "local", 2);
    assert_eq!(file(&station, "can.toml"), turned(20));
    // Also after a restart, and the removed release leaves it alone.
    station.kill();
    station.start();
    station.waits_for("the notice again", |station| station.troubles().contains("in place of version 2"));
    fleet(&desk, &["release", "can", "--remove", &url]);
    station.waits_for("no notice", |station| station.troubles() == "[]");
    assert_eq!(file(&station, "can.toml"), turned(20));
    assert_eq!(fs::read_dir(station.path("skus")).unwrap().count(), 1);
}

/// All are rows that a hostile or broken program could write.
#[test]
fn hostile_rows_are_refused_and_reported() {
    let Some((server, desk, url)) = with_office() else { return };
    for (table, name) in
        [("release", "body"), ("release", "blake3"), ("release", "author"), ("release", "station")]
    {
        server.sql("isomark", &format!("ALTER TABLE isomark.{table} DROP CONSTRAINT {table}_{name}_check"));
    }
    server.sql("isomark", "ALTER TABLE isomark.release DROP CONSTRAINT release_check");
    let good = turned(90);
    let mut expected = Vec::new();
    let mut row = |sku: &str, name: &str, body: &str, hash: &str, author: &str, what: &'static str| {
        server.sql(
            "isomark",
            &format!(
                "INSERT INTO isomark.release VALUES ('{sku}', 1, '{name}', '', {body}, '{hash}', {author}, 'x', now()); \
                 INSERT INTO isomark.current_release VALUES ('{sku}', '', 1, '{hash}')"
            ),
        );
        expected.push((sku.to_owned(), what));
    };
    let text = |text: &str| format!("convert_to('{text}', 'UTF8')");
    let hash_of = |text: &str| hash(text);
    row("up", "../up", &text(&good), &hash_of(&good), "NULL", "holds '/'");
    row("../up", "../up", &text(&good), &hash_of(&good), "NULL", "holds '/'");
    row("root", "/etc/x", &text(&good), &hash_of(&good), "NULL", "holds '/'");
    row("con", "CON", &text(&good), &hash_of(&good), "NULL", "reserved by Windows");
    row("other", "another", &text(&good), &hash_of(&good), "NULL", "its row is of another SKU");
    row("wrong", "wrong", &text(&good), &hash_of("x"), "NULL", "its content does not match its hash");
    row("empty", "empty", "NULL", &hash_of("x"), "NULL", "");
    row("binary", "binary", "'\\xfffe00'", &hash_of_bytes(&[0xff, 0xfe, 0]), "NULL", "it is not UTF-8 text");
    row("toml", "toml", &text("[x"), &hash_of("[x"), "NULL", "toml.toml, line 1");
    row(
        "future",
        "future",
        &text("[placement]\nnew_key = 1\n"),
        &hash_of("[placement]\nnew_key = 1\n"),
        "NULL",
        "new_key",
    );
    let many = "\n".repeat(400_000);
    row(
        "many",
        "many",
        "convert_to(repeat(E'\\n', 400000), 'UTF8')",
        &hash_of(&many),
        "NULL",
        "more than 5000 lines",
    );
    let large = "200 * 1024 * 1024";
    row(
        "large",
        "large",
        &format!("convert_to(repeat('#', {large}), 'UTF8')"),
        &hash_of("x"),
        "NULL",
        "larger than 1048576 bytes",
    );
    server.sql(
        "isomark",
        "ALTER TABLE isomark.current_release DROP CONSTRAINT current_release_sku_version_fkey",
    );
    // A name never becomes a setting, or leaves its line.
    let name = "E'x\\n[correction]\\nmethod = \"none\"\\n\\u001b[31m'";
    server.sql(
        "isomark",
        &format!(
            "INSERT INTO isomark.release VALUES ('good', 9223372036854775807, 'Good', '', {}, '{}', {name}, 'x', now()); \
             INSERT INTO isomark.current_release VALUES ('good', '', 9223372036854775807, '{}')",
            text(&good),
            hash(&good),
            hash(&good)
        ),
    );
    let station = station(&server, "laser1");
    station.waits_for("the good one", |station| settings(station, "Good.toml") == good);
    let second = file(&station, "Good.toml").lines().nth(1).unwrap().to_owned();
    assert!(second.contains("x\\n[correction]\\nmethod") && !second.contains('\u{1b}'), "{second}");
    for (sku, what) in expected.iter().filter(|(_, what)| !what.is_empty()) {
        let words = || {
            station
                .log()
                .lines()
                .any(|line| line.contains(&format!("settings of {sku} ")) && line.contains(what))
        };
        waits_for(what, words, || station.log());
    }
    let mut names: Vec<_> =
        fs::read_dir(station.path("skus")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["Good.toml"]);
    assert!(!station.path("up.toml").exists() && !station.path("state/fleet/up.toml").exists());
    station.waits_for("the notices", |station| station.troubles().contains("is not used"));
    let note = "SELECT state || ' ' || note FROM isomark.station_release WHERE sku = 'future'";
    waits_for("its report", || server.sql("isomark", note).contains("refused"), || station.log());
    assert!(server.sql("isomark", note).contains("new_key"));
    // Announcements of anybody.
    server.sql(
        "isomark",
        "SELECT pg_notify('isomark', 'settings ' || repeat('x', 7000)), pg_notify('isomark', 'settings ../..'), \
         pg_notify('isomark', 'settings '), pg_notify('isomark', 'settings')",
    );
    release(&desk, &url, "after", &turned(5), &[]);
    station.waits_for("the next one", |station| settings(station, "after.toml") == turned(5));
    station.drop_in("trough.obj", &trough(1.0));
    station.drop_in("trough.dxf", &line(9.0));
    station.waits_for_file("import/trough.dxf");
}

fn hash_of_bytes(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// Settings that are valid alone and wrong together with those of a station.
#[test]
fn a_release_that_a_station_cannot_use_keeps_the_one_before_and_is_tried_again() {
    let Some((server, desk, url)) = with_office() else { return };
    server.login("laser1", "station");
    let in_fleet = in_fleet(&server.url("laser1"));
    let mut station = Station::new("laser1", &format!("[serial]\nlast = 100\n{in_fleet}"));
    station.start();
    station.waits_for_fleet(1);
    release(&desk, &url, "can", &turned(90), &[]);
    station.waits_for("the first", |station| settings(station, "can.toml") == turned(90));
    let serial = "[serial]\nstart = 200\n";
    release(&desk, &url, "can", serial, &[]);
    let notice = "Version 2 of the settings of can that the office released is not used";
    station.waits_for("the notice", |station| station.troubles().contains(notice));
    is_known(&server, &desk, "laser1", "refused", 2);
    let words = fleet(&desk, &["status", &url]).out;
    assert!(words.contains("can: version 2 cannot be used: can.toml, line 2"), "{words}");
    assert_eq!(settings(&station, "can.toml"), turned(90));
    assert_eq!(station.logged(notice), 1);
    // With other settings of the station it is valid.
    station.set("laser1", &in_fleet);
    station.waits_for("the second", |station| settings(station, "can.toml") == serial);
    station.waits_for("no notice", |station| station.troubles() == "[]");
    is_known(&server, &desk, "laser1", "current", 2);
}

#[test]
fn only_the_office_and_the_owner_release() {
    let Some((server, desk)) = server_with_tables() else { return };
    let roles = ["station", "worker", "office", "viewer"];
    for role in roles {
        server.login(&format!("the_{role}"), role);
    }
    desk.write("can.toml", turned(1));
    for (index, login) in
        ["the_station", "the_worker", "the_viewer", "the_office", "owner"].into_iter().enumerate()
    {
        desk.write("can.toml", turned(index as u32));
        let output = fleet(&desk, &["release", "can", "can.toml", &server.url(login)]);
        match login {
            "the_office" | "owner" => assert_eq!(output.code, 0, "{output:?}"),
            _ => output.refused(3, &["permission denied"]),
        }
    }
    server.sql("isomark", "SELECT isomark.beat('the_station', 'p', 'isomark', true, 0, 0, 0, 0, 0, 0, NULL)");
    server.sql("isomark", "UPDATE isomark.station SET login = 'the_station'");
    let release = "SELECT * FROM isomark.release('x', 'x', '', 'y', repeat('a', 64), NULL)";
    let received = "SELECT isomark.received('the_station', '{can}', '{1}', '{used}', '{NULL}')";
    let rights: &[(&str, &[&str])] = &[
        (release, &["office"]),
        (received, &["station"]),
        ("SELECT sku, version, login FROM isomark.release", &roles),
        ("SELECT body FROM isomark.release", &["station", "office"]),
        ("SELECT * FROM isomark.current_release", &roles),
        ("SELECT * FROM isomark.station_release", &roles),
        ("INSERT INTO isomark.release SELECT * FROM isomark.release", &[]),
        ("UPDATE isomark.current_release SET version = 1", &[]),
        ("DELETE FROM isomark.release", &[]),
        ("UPDATE isomark.station_release SET state = 'used'", &[]),
        ("INSERT INTO isomark.station_release SELECT * FROM isomark.station_release", &[]),
    ];
    for (statement, may) in rights {
        for role in roles {
            let output = server.sql_as(&format!("the_{role}"), SECRET, "isomark", statement);
            let wrong = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.success(), may.contains(&role), "{role}: {statement}: {wrong}");
        }
    }
    // A station reports only for itself, and only what was released.
    server.login("another", "station");
    let output = server.sql_as("another", SECRET, "isomark", received);
    assert!(String::from_utf8_lossy(&output.stderr).contains("belongs to another login"), "{output:?}");
    let invented = received.replace("{can}", "{invented}");
    assert!(server.sql_as("the_station", SECRET, "isomark", &invented).status.success());
    assert_eq!(server.sql("isomark", "SELECT string_agg(sku, ' ') FROM isomark.station_release"), "can");
}

/// Releases of several offices at the same time have one order without a gap, and the stations end with the newest.
#[test]
fn releases_at_the_same_time_have_one_order() {
    let Some((server, desk, _)) = with_office() else { return };
    let station = station(&server, "laser1");
    let url = server.url("office");
    std::thread::scope(|scope| {
        for office in 0..4 {
            let url = &url;
            scope.spawn(move || {
                let desk = Desk::new();
                for round in 0..3 {
                    release(&desk, url, "can", &turned(10 * round + office), &[]);
                }
            });
        }
    });
    let order =
        "SELECT count(*) = 12 AND max(version) = 12 AND count(DISTINCT version) = 12 FROM isomark.release";
    assert_eq!(server.sql("isomark", order), "t");
    let newest = "SELECT convert_from(body, 'UTF8') FROM isomark.release ORDER BY version DESC LIMIT 1";
    let newest = server.sql("isomark", newest) + "\n";
    station.waits_for("the newest", |station| settings(station, "can.toml") == newest);
    is_known(&server, &desk, "laser1", "current", 12);
}

/// Between any two steps: the file is the newest release in the end, and nothing is taken for a local change.
#[test]
fn a_station_that_is_killed_while_it_receives_settings_has_the_newest() {
    let Some((server, desk, url)) = with_office() else { return };
    let mut station = station(&server, "laser1");
    let skus = ["a", "b", "c"];
    for round in 0..8 {
        for sku in skus {
            release(&desk, &url, sku, &turned(round), &[]);
        }
        for _ in 0..round * 7 {
            let _ = fs::read_dir(station.path("skus"));
            std::thread::yield_now();
        }
        station.kill();
        station.start();
    }
    for sku in skus {
        station.waits_for(sku, |station| settings(station, &format!("{sku}.toml")) == turned(7));
    }
    let mut names: Vec<_> =
        fs::read_dir(station.path("skus")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.retain(|name| !name.to_string_lossy().starts_with(".isomark-"));
    names.sort();
    assert_eq!(names, ["a.toml", "b.toml", "c.toml"]);
    assert_eq!(station.logged("local change"), 0, "{}", station.log());
}
