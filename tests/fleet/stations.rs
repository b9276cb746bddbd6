//! Stations of a fleet: alive and stopped, with the database there and away.

use serde_json::Value;

use crate::desk::Desk;
use crate::server::{Server, waits_for};
use crate::station::{Station, in_fleet, line, trough};
use crate::tables::{fleet, server_with_tables};

/// The stations of the fleet, from `isomark fleet status`.
pub fn stations(server: &Server, desk: &Desk) -> Value {
    let output = fleet(desk, &["status", &server.url("owner"), "--json"]);
    assert_eq!(output.code, 0, "{}", output.err);
    let mut status: Value = serde_json::from_str(&output.out).unwrap();
    status["stations"].take()
}

#[cfg(unix)]
#[test]
fn a_station_is_seen_with_its_figures_until_it_stops() {
    let Some((server, desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    let mut station = Station::of("laser 1", &server.url("laser1"));
    station.waits_for_fleet(1);
    station.drop_in("trough.obj", &trough(1.0));
    station.drop_in("trough.dxf", &line(9.0));
    station.drop_in("unreadable.step", "ISO-10303-21;\n");
    station.waits_for_file("import/trough.dxf");
    let is_seen = |state: &str| {
        let all = stations(&server, &desk);
        let seen = &all[0];
        all.as_array().unwrap().len() == 1
            && seen["name"] == "laser 1"
            && seen["state"] == state
            && seen["delivered"] == 1
            && seen["learned"] == 1
    };
    waits_for("its figures", || is_seen("alive"), || stations(&server, &desk).to_string());
    assert_eq!(station.troubles(), "[]");
    station.stop();
    assert!(is_seen("stopped"), "{}", stations(&server, &desk));
    let words = fleet(&desk, &["status", &server.url("owner")]).out;
    assert!(words.contains("laser 1: stopped; 1 delivered, 1 fitted"), "{words}");
}

#[test]
fn a_station_works_alone_while_the_database_is_away_and_reports_it_once() {
    let Some((server, desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    let station = Station::of("laser1", &server.url("laser1"));
    station.waits_for_fleet(1);
    server.cut();
    station
        .waits_for("the trouble in the status", |station| station.troubles().contains("cannot be reached"));
    station.drop_in("trough.obj", &trough(1.0));
    station.drop_in("trough.dxf", &line(9.0));
    station.waits_for_file("import/trough.dxf");
    assert_eq!(station.logged("The station works without the fleet"), 1, "{}", station.log());
    server.run();
    station.waits_for_fleet(2);
    station.waits_for("no trouble", |station| station.troubles() == "[]");
    waits_for(
        "its figures",
        || stations(&server, &desk)[0]["delivered"] == 1,
        || stations(&server, &desk).to_string(),
    );
}

#[test]
fn a_station_without_rights_password_or_tables_works_alone_and_recovers() {
    let Some(server) = Server::start() else { return };
    let desk = Desk::new();
    let station = Station::new("laser1", &in_fleet(&server.url("laser1")));
    station.desk.write("password.txt", "another\n");
    let mut station = station;
    station.start();
    station.waits_for("the wrong password", |station| station.troubles().contains("refuses the connection"));
    fleet(&desk, &["init", &server.url("owner")]);
    server.sql("isomark", &format!("CREATE ROLE laser1 LOGIN PASSWORD '{}'", crate::server::SECRET));
    station.desk.write("password.txt", crate::server::SECRET);
    station.waits_for("the missing rights", |station| station.troubles().contains("does not permit"));
    station.drop_in("trough.obj", &trough(1.0));
    station.drop_in("trough.dxf", &line(9.0));
    station.waits_for_file("import/trough.dxf");
    server.sql("isomark", "GRANT isomark_station TO laser1");
    station.waits_for_fleet(1);
    // A newer program upgraded the tables.
    server.sql(
        "isomark",
        "INSERT INTO isomark.migration (number, name, blake3, program) SELECT max(number) + 1, 'later', 'x', 'isomark 9' \
         FROM isomark.migration",
    );
    server.cut();
    server.run();
    station.waits_for("the newer tables", |station| station.troubles().contains("knows versions up to"));
    station.drop_in("trough@2.dxf", &line(8.0));
    station.waits_for_file("import/trough@2.dxf");
}

/// A second program on the same folders ends at the lock; until then it touches neither the outbox nor the fleet.
#[test]
fn a_second_program_of_the_same_station_does_not_take_part() {
    let Some((server, desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    let station = Station::of("laser1", &server.url("laser1"));
    station.waits_for_fleet(1);
    let process = || server.sql("isomark", "SELECT process FROM isomark.station");
    let before = process();
    station.desk.isomark(&["watch", "station.toml"]).refused(3, &["laser1"]);
    assert_eq!(process(), before);
    assert_eq!(stations(&server, &desk)[0]["state"], "alive");
}

#[test]
fn two_stations_of_one_name_notice_each_other() {
    let Some((server, _desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    let one = Station::of("laser1", &server.url("laser1"));
    let two = Station::of("laser1", &server.url("laser1"));
    for station in [&one, &two] {
        station.waits_for("the other one", |station| station.troubles().contains("Another running station"));
    }
}
