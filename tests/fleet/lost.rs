//! Databases that were lost and made again, empty or from a dump, and stations that bring what they learned before.

use fs_err as fs;

use crate::fits::{current, hash};
use crate::jobs::waits_for_rows;
use crate::server::{Server, waits_for};
use crate::station::{Station, in_fleet, line, trough};
use crate::tables::{fleet, server_with_tables};

fn running(server: &Server, name: &str) -> Station {
    server.login(name, "station");
    let station = Station::of(name, &server.url(name));
    station.waits_for_fleet(1);
    station
}

fn parts(server: &Server) -> String {
    server.sql("isomark", "SELECT sku, version, blake3 FROM isomark.current_part ORDER BY sku")
}

/// Drawings of a station that knows the part by the fleet only.
fn marks(station: &Station, name: &str) {
    station.drop_in(name, &line(9.0));
    station.waits_for_file(&format!("import/{name}"));
}

#[test]
fn an_empty_database_gets_parts_and_fits_from_the_stations() {
    let Some((server, desk)) = server_with_tables() else { return };
    let [one, two] = ["laser1", "laser2"].map(|name| running(&server, name));
    one.drop_in("trough.obj", &trough(1.0));
    one.drop_in("gutter.obj", &trough(1.4));
    two.waits_for("both parts", |two| {
        current(two, "trough") == hash(&trough(1.0)) && current(two, "gutter") == hash(&trough(1.4))
    });
    server.lose(None);
    one.waits_for("the trouble", |one| one.troubles().contains("tables of version 0"));
    assert_eq!(fleet(&desk, &["init", &server.url("owner")]).code, 0);
    let all = format!("gutter|1|{}\ntrough|1|{}", hash(&trough(1.4)), hash(&trough(1.0)));
    waits_for("both parts", || parts(&server) == all, || format!("{}\n{}", parts(&server), one.log()));
    waits_for_rows(&server, "SELECT count(*) FROM isomark.fit", "2", &one);
    // A station that is new gets both from the database.
    let three = running(&server, "laser3");
    marks(&three, "trough@a.dxf");
    marks(&three, "gutter@a.dxf");
    // What the stations know has not become another part.
    for station in [&one, &two] {
        assert_eq!(station.logged("has a new part in the fleet"), 0, "{}", station.log());
    }
}

/// The dump knows an earlier part. None of the stations may go back to it.
#[test]
fn a_database_from_a_dump_gets_the_parts_that_were_learned_since() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let [one, two] = ["laser1", "laser2"].map(|name| running(&server, name));
    one.drop_in("trough.obj", &trough(1.0));
    one.drop_in("gutter.obj", &trough(1.4));
    two.waits_for("both parts", |two| {
        current(two, "trough") == hash(&trough(1.0)) && current(two, "gutter") == hash(&trough(1.4))
    });
    waits_for_rows(&server, "SELECT count(*) FROM isomark.fit", "2", &one);
    let dump = server.dump();
    one.drop_in("trough.obj", &trough(1.2));
    two.waits_for("the new part", |two| current(two, "trough") == hash(&trough(1.2)));
    server.lose(Some(&dump));
    let all = format!("gutter|1|{}\ntrough|2|{}", hash(&trough(1.4)), hash(&trough(1.2)));
    waits_for("the new part", || parts(&server) == all, || format!("{}\n{}", parts(&server), one.log()));
    // Its surface comes, too.
    waits_for_rows(&server, "SELECT count(*) FROM isomark.fit", "3", &one);
    for station in [&one, &two] {
        station.waits_for("the fleet", |station| station.logged("is available again") >= 1);
        assert_eq!(current(station, "trough"), hash(&trough(1.2)));
    }
    assert_eq!(one.logged("has a new part in the fleet"), 0, "{}", one.log());
    assert_eq!(two.logged("has a new part in the fleet"), 1, "{}", two.log());
}

/// After the dump was restored, a station that was cut off all the time comes last: what was learned since stays.
#[test]
fn the_part_that_was_learned_last_stays_also_after_a_dump() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let [one, mut two] = ["laser1", "laser2"].map(|name| running(&server, name));
    one.drop_in("trough.obj", &trough(1.0));
    two.waits_for("the part", |two| current(two, "trough") == hash(&trough(1.0)));
    let dump = server.dump();
    one.drop_in("trough.obj", &trough(1.2));
    two.waits_for("the new part", |two| current(two, "trough") == hash(&trough(1.2)));
    // Both know version 2; the database knows version 1, and gets another version 2 while the second station is ended.
    two.kill();
    drop(one);
    server.lose(Some(&dump));
    let three = running(&server, "laser3");
    three.drop_in("trough.obj", &trough(1.4));
    waits_for_rows(&server, "SELECT version FROM isomark.current_part", "2", &three);
    two.start();
    two.waits_for("the last part", |two| current(two, "trough") == hash(&trough(1.4)));
    assert_eq!(parts(&server), format!("trough|2|{}", hash(&trough(1.4))));
}

#[test]
fn a_station_that_joins_brings_the_parts_that_it_learned_before() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let [one, two] = ["laser1", "laser2"];
    server.login(one, "station");
    let mut one = Station::new(one, "");
    one.start();
    for (sku, depth) in [("trough", 1.0), ("gutter", 1.4)] {
        one.drop_in(&format!("{sku}.obj"), &trough(depth));
        one.waits_for("the part", |one| one.logged(&format!("is now the part of SKU `{sku}`")) == 1);
    }
    one.kill();
    one.set("laser1", &in_fleet(&server.url("laser1")));
    one.start();
    one.waits_for("the announcement", |one| one.logged("does not (2): gutter, trough") == 1);
    let two = running(&server, two);
    marks(&two, "trough@a.dxf");
    marks(&two, "gutter@a.dxf");
    // It is announced once.
    one.kill();
    one.start();
    one.waits_for("the fleet", |one| one.logged("the fleet at ") == 2);
    assert_eq!(one.logged("announcing"), 1, "{}", one.log());
    assert_eq!(server.sql("isomark", "SELECT count(*) FROM isomark.part_version"), "2");
}

#[test]
fn ended_jobs_and_stations_that_are_gone_are_removed() {
    let Some((server, desk)) = server_with_tables() else { return };
    let url = server.url("owner");
    let prune = |arguments: &[&str]| fleet(&desk, &[&["prune", &url], arguments].concat());
    let mut one = running(&server, "laser1");
    server.sql(
        "isomark",
        "INSERT INTO isomark.job (id, line, name, sender, bytes, inputs_blake3, state, station, outcome, ended, attempt, taken) \
         SELECT lpad(to_hex(n), 64, '0'), 'cups', 'a.dxf', 's', 1, repeat('0', 64), 'ended', 'laser1', 'delivered', \
         now() - n * interval '1 day', 1, now() FROM generate_series(1, 12000) AS n",
    );
    server.sql(
        "isomark",
        "INSERT INTO isomark.job (id, line, name, sender, bytes, inputs_blake3, state, station, attempt, taken) \
         VALUES (repeat('a', 64), 'cups', 'b.dxf', 's', 1, repeat('0', 64), 'taken', 'laser1', 1, now() - interval '9000 days')",
    );
    let output = prune(&["--ended-days", "100.5"]);
    assert!(output.code == 0 && output.err.contains("11900 jobs removed"), "{output:?}");
    let left = "SELECT state, count(*) FROM isomark.job GROUP BY state ORDER BY 1";
    assert_eq!(server.sql("isomark", left), "ended|100\ntaken|1");
    prune(&["--station", "laser2"]).refused(2, &["No station", "laser1"]);
    prune(&["--station", "laser1"]).refused(3, &["have not ended: 1.", "--take-over"]);
    one.kill();
    server.sql("isomark", "UPDATE isomark.job SET state = 'waiting', station = NULL WHERE state = 'taken'");
    server.sql("isomark", "UPDATE isomark.station SET beat = now()");
    prune(&["--station", "laser1"]).refused(3, &["sign of life"]);
    server.sql("isomark", "UPDATE isomark.station SET beat = now() - interval '46 s'");
    let output = prune(&["--station", "laser1"]);
    assert!(output.code == 0 && output.err.contains("laser1 removed"), "{output:?}");
    assert_eq!(server.sql("isomark", "SELECT count(*) FROM isomark.station"), "0");
    // Another login can use the name now.
    server.login("newlogin", "station");
    one.set("laser1", &in_fleet(&server.url("newlogin")));
    one.start();
    one.waits_for_fleet(2);
    assert_eq!(server.sql("isomark", "SELECT login FROM isomark.station"), "newlogin");
    // Only the office removes stations.
    let forget = "SELECT isomark.forget_station('laser1')";
    for (role, may) in [("station", false), ("worker", false), ("viewer", false), ("office", true)] {
        server.login(&format!("the_{role}"), role);
        let output = server.sql_as(&format!("the_{role}"), crate::server::SECRET, "isomark", forget);
        assert_eq!(output.status.success(), may, "{role}: {output:?}");
    }
    let _ = fs::remove_file(desk.path("password.txt"));
}
