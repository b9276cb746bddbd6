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
    fleet(&desk, &["status", &url]).refused(3, &["permission denied", "GRANT isomark_station"]);
    fleet(&desk, &["init", &url]).refused(3, &["permission denied"]);
    server.sql("isomark", "ALTER ROLE nobody PASSWORD 'another'");
    fleet(&desk, &["status", &url]).refused(3, &["password authentication failed", "pg_hba.conf"]);
    let nowhere = format!("postgresql://owner@127.0.0.1:{}/isomark", crate::server::free_port());
    fleet(&desk, &["status", &nowhere]).refused(3, &["cannot be reached"]);
    desk.isomark(&["fleet", "status", "postgresql://owner:secret@localhost/isomark"])
        .refused(2, &["contains a password"]);
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
