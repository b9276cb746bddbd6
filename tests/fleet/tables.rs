//! `isomark fleet init`, `check` and `status`, and the rights of each role.

use std::process::{Command, Stdio};

use serde_json::Value;

use crate::desk::{Desk, Output};
use crate::server::{SECRET, Server};

/// Runs `isomark fleet` as the owner.
pub fn fleet(desk: &Desk, arguments: &[&str]) -> Output {
    desk.write("password.txt", format!("{SECRET}\n"));
    let output = desk.isomark(&[&["fleet"], arguments, &["--password-file", "password.txt"]].concat());
    assert!(!output.out.contains(SECRET) && !output.err.contains(SECRET), "{output:?}");
    output
}

/// A server with the tables of a fleet.
pub fn server_with_tables() -> Option<(Server, Desk)> {
    let (server, desk) = (Server::start()?, Desk::new());
    let made = fleet(&desk, &["init", &server.url("owner")]);
    assert_eq!(made.code, 0, "{}", made.err);
    Some((server, desk))
}

#[test]
fn the_tables_are_made_once_also_from_many_computers_at_once() {
    let Some(server) = Server::start() else { return };
    let (desk, url) = (Desk::new(), server.url("owner"));
    fleet(&desk, &["status", &url]).refused(3, &["tables of version 0", "isomark fleet init"]);
    let all: Vec<_> = (0..8)
        .map(|_| {
            Command::new(env!("CARGO_BIN_EXE_isomark"))
                .args(["fleet", "init", &url])
                .env("ISOMARK_FLEET_PASSWORD", SECRET)
                .stdout(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap()
        })
        .collect();
    let mut made = 0;
    for child in all {
        let output = child.wait_with_output().unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{text}");
        made += usize::from(text.contains("made the tables"));
    }
    assert_eq!(made, 1);
    let migrations = "SELECT count(*) = max(number) AND count(*) > 0 FROM isomark.migration";
    assert_eq!(server.sql("isomark", migrations), "t");
    let again = fleet(&desk, &["init", &url]);
    assert!(again.code == 0 && again.err.contains("already"), "{again:?}");
    let check = fleet(&desk, &["check", &url]);
    assert!(check.code == 0 && !check.out.contains("wrong"), "{check:?}");
    let status = fleet(&desk, &["status", &url, "--json"]);
    let status: Value = serde_json::from_str(&status.out).unwrap();
    assert_eq!(status["stations"], serde_json::json!([]));
}

#[test]
fn newer_and_foreign_tables_are_left_alone() {
    let Some((server, desk)) = server_with_tables() else { return };
    let url = server.url("owner");
    server.sql(
        "isomark",
        "INSERT INTO isomark.migration (number, name, blake3, program) SELECT max(number) + 1, 'later', 'x', 'isomark 9' \
         FROM isomark.migration",
    );
    for command in ["init", "status", "check"] {
        fleet(&desk, &[command, &url]).refused(3, &["knows versions up to", "Update isomark"]);
    }
    server.sql("isomark", "DELETE FROM isomark.migration WHERE name = 'later'");
    server.sql("isomark", "UPDATE isomark.migration SET blake3 = 'x' WHERE number = 1");
    fleet(&desk, &["init", &url]).refused(3, &["another migration 1"]);
}

#[test]
fn a_login_is_refused_or_without_rights_with_the_reason() {
    let Some((server, desk)) = server_with_tables() else { return };
    server.sql("isomark", &format!("CREATE ROLE nobody LOGIN PASSWORD '{SECRET}'"));
    let url = server.url("nobody");
    desk.write("given.toml", "");
    desk.write("can.dxf", crate::station::line(9.0));
    let needs = |arguments: &[&str], words: &[&str]| {
        desk.isomark(&[arguments, &["--password-file", "password.txt"]].concat())
            .refused(3, &[&["does not permit this"], words].concat());
    };
    needs(&["fleet", "status", &url], &["GRANT isomark_viewer", "isomark_station"]);
    needs(&["fleet", "check", &url], &["GRANT isomark_viewer"]);
    needs(&["fleet", "release", "can", "given.toml", &url], &["GRANT isomark_office"]);
    needs(&["fleet", "prune", &url, "--unused-days", "1"], &["GRANT isomark_office"]);
    needs(&["send", &url, "--to", "cups", "can.dxf"], &["GRANT isomark_office", "isomark_station"]);
    needs(&["fleet", "init", &url], &["owner of the database", "CREATEROLE"]);
    // Each cause has its own remedy, and none switches encryption off.
    let refused = |url: &str, options: &[&str], words: &[&str]| {
        let output = desk.isomark(&[&["fleet", "status", url], options].concat());
        output.refused(3, &[&["refuses the connection"], words].concat());
        assert!(!output.err.contains("sslmode=disable"), "{output:?}");
    };
    let with_password = ["--password-file", "password.txt"];
    refused(&url, &[], &["password missing", "--password-file", "ISOMARK_FLEET_PASSWORD"]);
    refused(&format!("{url}s"), &with_password, &["does not exist", "name of the database"]);
    server.sql("isomark", "ALTER ROLE nobody PASSWORD 'another'");
    refused(&url, &with_password, &["password authentication failed", "the password in the file"]);
    let nowhere = format!("postgresql://owner@127.0.0.1:{}/isomark", crate::server::free_port());
    fleet(&desk, &["status", &nowhere]).refused(3, &["cannot be reached"]);
    desk.isomark(&["fleet", "status", "postgresql://owner:secret@localhost/isomark"])
        .refused(2, &["contains a password"]);
}

/// What the fleet would refuse when the station starts.
#[test]
fn a_check_with_the_settings_of_a_station_requires_that_the_login_may_be_this_station() {
    let Some((server, desk)) = server_with_tables() else { return };
    for (login, role) in [("laser1", "station"), ("laser2", "station"), ("anna", "office"), ("eve", "viewer")]
    {
        server.login(login, role);
    }
    server.sql("isomark", &format!("CREATE ROLE nobody LOGIN PASSWORD '{SECRET}'"));
    let beat = "SELECT isomark.beat('line 1', 'p', 'isomark', true, 0, 0, 0, 0, 0, 0, NULL)";
    assert!(server.sql_as("laser1", SECRET, "isomark", beat).status.success());
    let check = |login: &str| {
        let station = crate::station::Station::new("line 1", &crate::station::in_fleet(&server.url(login)));
        let output = station.desk.isomark(&["fleet", "check", "station.toml"]);
        assert_eq!(fleet(&desk, &["check", &server.url(login)]).code == 0, login != "nobody");
        output
    };
    let output = check("laser1");
    assert!(output.code == 0 && !output.out.contains("wrong"), "{output:?}");
    for (login, words) in [
        (
            "laser2",
            "wrong  the station name \"line 1\" belongs to the login laser1. Give the station another `name`",
        ),
        ("anna", "wrong  anna has the rights of isomark_office, not those of isomark_station. As the owner"),
        ("eve", "GRANT isomark_station TO"),
    ] {
        let output = check(login);
        assert!(output.code == 3 && output.out.contains(words), "{login}: {output:?}");
    }
    check("nobody").refused(3, &["GRANT isomark_station TO"]);
}

/// What each role may do, in SQL. All roles may read the version of the tables and the stations.
#[test]
fn each_role_has_only_the_rights_that_it_needs() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let roles = ["station", "worker", "office", "viewer"];
    for role in roles {
        server.login(&format!("the_{role}"), role);
    }
    let beat = "SELECT isomark.beat(session_user::text, 'p', 'isomark', true, 0, 0, 0, 0, 0, 0, NULL)";
    let rights: &[(&str, &[&str])] = &[
        ("SELECT * FROM isomark.station", &roles),
        ("SELECT * FROM isomark.migration", &roles),
        (beat, &["station", "worker"]),
        ("INSERT INTO isomark.migration (number, name, blake3, program) VALUES (99, '', '', '')", &[]),
        ("UPDATE isomark.station SET name = 'x'", &[]),
        ("DELETE FROM isomark.station", &[]),
        ("DROP TABLE isomark.station", &[]),
        ("CREATE TABLE isomark.mine (a int)", &[]),
        ("CREATE ROLE mine", &[]),
        ("COPY isomark.station TO PROGRAM 'true'", &[]),
    ];
    for (statement, may) in rights {
        for role in roles {
            let output = server.sql_as(&format!("the_{role}"), SECRET, "isomark", statement);
            let wrong = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.success(), may.contains(&role), "{role}: {statement}: {wrong}");
        }
    }
    // A name belongs to the login that first used it.
    server.login("another", "station");
    let output =
        server.sql_as("another", SECRET, "isomark", &beat.replace("session_user::text", "'the_station'"));
    assert!(String::from_utf8_lossy(&output.stderr).contains("belongs to the login"), "{output:?}");
    let login = "SELECT login FROM isomark.station WHERE name = 'the_station'";
    assert_eq!(server.sql("isomark", login), "the_station");
}
