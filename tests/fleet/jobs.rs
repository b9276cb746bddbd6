//! Jobs for other lines: rules, `isomark send`, groups, hostile rows, rights, and jobs of stations that died.

use std::collections::BTreeMap;
use std::path::PathBuf;

use fs_err as fs;
use serde_json::Value;

use crate::desk::{Desk, Output};
use crate::proxy::Proxy;
use crate::server::{SECRET, Server, waits_for};
use crate::station::{Station, in_fleet, line, trough};
use crate::tables::{fleet, server_with_tables};

/// A station that is not started, with more under [fleet] and behind it.
pub fn station(server: &Server, name: &str, more: &str) -> Station {
    server.login(name, "station");
    Station::new(name, &(in_fleet(&server.url(name)) + more))
}

pub fn started(mut station: Station) -> Station {
    station.start();
    station.waits_for_fleet(1);
    station
}

const TO_CUPS: &str = "[route]\nrules = [{ name = \"*@*\", line = \"cups\" }]\n";
const IN_CUPS: &str = "lines = [\"cups\"]\n";

/// The result of a statement, after it is this.
#[track_caller]
pub fn waits_for_rows(server: &Server, statement: &str, expected: &str, station: &Station) {
    let found = || server.sql("isomark", statement);
    waits_for(statement, || found() == expected, || format!("{}\n{}", found(), station.log()));
}

/// The files of a folder of a station.
pub fn files(station: &Station, folder: &str) -> Vec<String> {
    let all = fs::read_dir(station.path(folder)).into_iter().flatten();
    let mut all: Vec<String> =
        all.map(|file| file.unwrap().file_name().to_string_lossy().into_owned()).collect();
    all.sort();
    all
}

fn send(desk: &Desk, arguments: &[&str]) -> Output {
    desk.write("password.txt", format!("{SECRET}\n"));
    desk.isomark(&[&["send"], arguments, &["--password-file", "password.txt"]].concat())
}

fn retry(desk: &Desk, arguments: &[&str]) -> Output {
    desk.write("password.txt", format!("{SECRET}\n"));
    desk.isomark(&[&["retry"], arguments, &["--password-file", "password.txt"]].concat())
}

fn jobs(server: &Server, desk: &Desk) -> Value {
    let output = fleet(desk, &["status", &server.url("owner"), "--json"]);
    assert_eq!(output.code, 0, "{}", output.err);
    serde_json::from_str::<Value>(&output.out).unwrap()["jobs"].take()
}

#[test]
fn a_drawing_for_another_line_is_delivered_there_with_its_settings() {
    let Some((server, desk)) = server_with_tables() else { return };
    let rules = "[route]\nrules = [{ sku = \"TR*\", name = \"*@a*\", line = \"laser 2\" }, { sku = \"*\", line = \"laser1\" }]\n";
    let one = started(station(&server, "laser1", rules));
    server.login("laser2", "station");
    let two = started(Station::new("laser 2", &in_fleet(&server.url("laser2"))));
    one.drop_in("trough.obj", &trough(1.0));
    one.waits_for("the part", |one| one.logged("is now the part of") == 1);
    let settings = "[placement]\nanchor = \"center\"\n";
    one.drop_in("trough@a.toml", settings);
    one.drop_in("trough@a.dxf", &line(9.0));
    one.drop_in("trough@b.dxf", &line(8.0));
    two.waits_for_file("import/trough@a.dxf");
    one.waits_for_file("import/trough@b.dxf");
    let ended = "SELECT state, outcome, station, attempt, sender, login FROM isomark.job";
    waits_for_rows(&server, ended, "ended|delivered|laser 2|1|laser1|laser1", &two);
    assert_eq!(server.sql("isomark", "SELECT count(*) FROM isomark.job_inputs"), "0");
    assert_eq!(
        (files(&one, "import"), files(&two, "import")),
        (vec!["trough@b.dxf".into()], vec!["trough@a.dxf".into()])
    );
    for station in [&one, &two] {
        let filed = fs::read_to_string(station.path("archive/trough/trough@a.toml")).unwrap();
        assert_eq!(filed, settings);
        station.waits_for("an empty hot folder", |station| files(station, "hot").is_empty());
    }
    one.waits_for("its state", |one| {
        one.status()["finished"].as_array().is_some_and(|all| {
            all.iter().any(|of_it| of_it["drop"] == "trough@a.dxf" && of_it["result"] == "handed-over")
        })
    });
    let all = jobs(&server, &desk);
    assert_eq!((all["waiting"].as_i64(), all["taken"].as_i64()), (Some(0), Some(0)));
    let of_it = &all["listed"][0];
    assert_eq!((&of_it["name"], &of_it["outcome"]), (&"trough@a.dxf".into(), &"delivered".into()), "{all}");
    let words = fleet(&desk, &["status", &server.url("owner")]).out;
    assert!(
        words.contains("trough@a.dxf: laser1 to laser 2") && words.contains("delivered at laser 2"),
        "{words}"
    );
}

#[test]
fn a_rejected_job_ends_with_its_reason_and_a_list_is_divided_at_its_line() {
    let Some((server, desk)) = server_with_tables() else { return };
    let two = started(station(&server, "laser2", ""));
    two.drop_in("trough.obj", &trough(1.0));
    two.waits_for("the part", |two| two.logged("is now the part of") == 1);
    desk.write("trough@wrong.dxf", line(500.0));
    let output = send(&desk, &[&server.url("owner"), "--to", "laser2", "trough@wrong.dxf"]);
    assert_eq!(output.code, 0, "{}", output.err);
    let reasons =
        "SELECT outcome, reason <> '' AND reason NOT LIKE 'See %' FROM isomark.job WHERE state = 'ended'";
    waits_for_rows(&server, reasons, "rejected|t", &two);
    desk.write("trough@list.dxf", line(9.0));
    desk.write("trough@list.csv", "NAME\nAnna\nBert\n");
    send(&desk, &[&server.url("owner"), "--to", "laser2", "trough@list.dxf"]);
    two.waits_for_file("import/trough@list-000001.dxf");
    two.waits_for_file("import/trough@list-000002.dxf");
    waits_for_rows(&server, "SELECT outcome FROM isomark.job WHERE name LIKE '%list%'", "listed", &two);
}

/// Each station counts its own serial numbers, so two of a group would give the same ones.
#[test]
fn a_list_goes_to_one_station_and_never_to_a_group() {
    let Some((server, desk)) = server_with_tables() else { return };
    let takers = ["laser2", "laser3"].map(|name| started(station(&server, name, IN_CUPS)));
    takers[0].drop_in("trough.obj", &trough(1.0));
    for name in ["s1", "s2"] {
        desk.write(&format!("trough@{name}.dxf"), line(9.0));
        desk.write(&format!("trough@{name}.csv"), "NAME\nAnna\nBert\n");
    }
    desk.write("trough@plain.dxf", line(8.0));
    let url = server.url("owner");
    send(&desk, &[&url, "--to", "cups", "trough@plain.dxf", "trough@s1.dxf", "trough@s2.dxf"])
        .refused(2, &["\"cups\"", "is a group of stations", "to one station"]);
    let count = "SELECT count(*) FROM isomark.job";
    assert_eq!(server.sql("isomark", count), "0");
    // A rule of a station is no way round it.
    let one = started(station(&server, "laser1", TO_CUPS));
    fs::write(one.path("hot/trough@s3.csv"), "NAME\nAnna\n").unwrap();
    one.drop_in("trough@s3.dxf", &line(9.0));
    one.waits_for_file("rejected/trough@s3.dxf");
    let reason = fs::read_to_string(one.path("rejected/trough@s3.dxf.reason.json")).unwrap();
    assert!(reason.contains("list-for-group"), "{reason}");
    assert_eq!(server.sql("isomark", count), "0");
    // Nobody knows yet that this line is a group.
    let output = send(&desk, &[&url, "--to", "mugs", "trough@s1.dxf"]);
    assert_eq!(output.code, 0, "{}", output.err);
    let four = started(station(&server, "laser4", "lines = [\"mugs\"]\n"));
    let ended = "SELECT outcome, reason LIKE '%group of stations%' FROM isomark.job WHERE line = 'mugs'";
    waits_for_rows(&server, ended, "rejected|t", &four);
    // A waiting list is not given to a group, either.
    send(&desk, &[&url, "--to", "laser9", "trough@s2.dxf"]);
    let id = server.sql("isomark", "SELECT id FROM isomark.job WHERE line = 'laser9'");
    retry(&desk, &[&url, "--take-over", &id[..8], "--to", "cups"]).refused(2, &["is a group of stations"]);
    let output = retry(&desk, &[&url, "--take-over", &id[..8], "--to", "laser2"]);
    assert_eq!(output.code, 0, "{}", output.err);
    let both = ["trough@s2-000001.dxf", "trough@s2-000002.dxf"];
    for name in both {
        takers[0].waits_for_file(&format!("import/{name}"));
    }
    assert_eq!(files(&takers[0], "import"), both);
    for station in [&takers[1], &one, &four] {
        assert_eq!(files(station, "import"), Vec::<String>::new());
    }
}

/// Nothing can be marked twice then, so nobody needs to force it.
#[test]
fn a_job_in_the_queue_of_a_mistyped_line_is_given_to_another_one() {
    let Some((server, desk)) = server_with_tables() else { return };
    let two = started(station(&server, "laser2", ""));
    two.drop_in("trough.obj", &trough(1.0));
    two.waits_for("the part", |two| two.logged("is now the part of") == 1);
    desk.write("trough@a.dxf", line(9.0));
    let url = server.url("owner");
    send(&desk, &[&url, "--to", "LASER2", "trough@a.dxf"]);
    let id = server.sql("isomark", "SELECT id FROM isomark.job");
    for digits in [8, 12, 64] {
        retry(&desk, &[&url, "--take-over", &id[..digits]])
            .refused(2, &["waits in its queue already", "--to LINE"]);
    }
    retry(&desk, &[&url, "--take-over", "laser2"]).refused(2, &["is called laser2"]);
    retry(&desk, &[&url, "--take-over", &id[..8], "--to", " "]).refused(2, &["--to", "Give a name"]);
    let output = retry(&desk, &[&url, "--take-over", &id[..8], "--to", "laser22"]);
    assert!(output.code == 0 && output.err.contains("takes jobs for laser22 yet"), "{output:?}");
    let output = retry(&desk, &[&url, "--take-over", &id[..8], "--to", "laser2"]);
    assert!(output.code == 0 && output.out.contains("no station had taken it"), "{output:?}");
    two.waits_for_file("import/trough@a.dxf");
    waits_for_rows(&server, "SELECT outcome, station, attempt FROM isomark.job", "delivered|laser2|1", &two);
}

#[test]
fn a_line_without_a_name_and_a_file_that_does_not_exist_are_refused_before_anything_is_sent() {
    let Some((server, desk)) = server_with_tables() else { return };
    desk.write("can@a.dxf", line(9.0));
    let url = server.url("owner");
    let long = "x".repeat(101);
    for wrong in ["", "  ", "cups\n", "a\tb", &long] {
        send(&desk, &[&url, "--to", wrong, "can@a.dxf"])
            .refused(2, &["--to", "Give a name on one line, with at most 100 characters"]);
    }
    send(&desk, &[&url, "--to", "cups", "can@a.dxf", "nofile.dxf"])
        .refused(3, &["There is no file nofile.dxf."]);
    assert_eq!(server.sql("isomark", "SELECT count(*) FROM isomark.job"), "0");
}

#[test]
fn a_drop_for_another_line_waits_while_the_database_is_away_and_reports_it_once() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let mut one = started(station(&server, "laser1", TO_CUPS));
    let mut two = started(station(&server, "laser2", IN_CUPS));
    two.drop_in("trough.obj", &trough(1.0));
    two.waits_for("the part", |two| two.logged("is now the part of") == 1);
    server.cut();
    for station in [&one, &two] {
        station.waits_for("the trouble", |station| station.troubles().contains("cannot be reached"));
    }
    one.drop_in("trough@a.dxf", &line(9.0));
    one.waits_for("the reason", |one| one.status()["waiting"].to_string().contains("\"line-away\""));
    assert_eq!(one.logged("trough@a.dxf waits"), 1, "{}", one.log());
    // Both are killed while it waits.
    one.kill();
    two.kill();
    one.start();
    two.start();
    one.waits_for("the reason again", |one| one.logged("trough@a.dxf waits") == 2);
    one.drop_in("trough@b.dxf", &line(8.0));
    server.run();
    two.waits_for_file("import/trough@a.dxf");
    two.waits_for_file("import/trough@b.dxf");
    one.waits_for("an empty hot folder", |one| files(one, "hot").is_empty());
    waits_for_rows(&server, "SELECT count(*) FROM isomark.job WHERE outcome = 'delivered'", "2", &two);
    assert_eq!(files(&one, "import"), Vec::<String>::new());
}

#[test]
fn a_group_shares_a_queue_and_each_job_is_done_once() {
    let Some((server, desk)) = server_with_tables() else { return };
    let takers = ["laser2", "laser3"].map(|name| started(station(&server, name, IN_CUPS)));
    takers[0].drop_in("trough.obj", &trough(1.0));
    let names: Vec<String> = (0..40).map(|index| format!("trough@{index:02}.dxf")).collect();
    for (index, name) in names.iter().enumerate() {
        desk.write(name, line(5.0 + index as f64 * 0.1));
    }
    let url = server.url("owner");
    let arguments: Vec<&str> =
        [url.as_str(), "--to", "cups"].into_iter().chain(names.iter().map(String::as_str)).collect();
    let output = send(&desk, &arguments);
    assert_eq!(output.code, 0, "{}", output.err);
    waits_for_rows(
        &server,
        "SELECT count(*) FROM isomark.job WHERE outcome = 'delivered' AND attempt = 1",
        "40",
        &takers[0],
    );
    let mut delivered = BTreeMap::<String, usize>::new();
    for taker in &takers {
        assert_eq!(taker.logged("delivered again"), 0);
        files(taker, "import").into_iter().for_each(|name| *delivered.entry(name).or_default() += 1);
    }
    assert_eq!(delivered, names.into_iter().map(|name| (name, 1)).collect());
    let counts = takers.each_ref().map(|taker| files(taker, "import").len());
    assert!(counts.iter().all(|count| *count > 0), "both work: {counts:?}");
}

/// Rows that no isomark writes, made by the owner of the database.
#[test]
fn hostile_rows_are_refused_with_a_reason_and_stop_nothing() {
    let Some((server, desk)) = server_with_tables() else { return };
    let two = started(station(&server, "laser2", ""));
    two.drop_in("trough.obj", &trough(1.0));
    two.waits_for("the part", |two| two.logged("is now the part of") == 1);
    server.sql(
        "isomark",
        "ALTER TABLE isomark.job_inputs DROP CONSTRAINT job_inputs_drawing_check; \
         ALTER TABLE isomark.job DROP CONSTRAINT job_id_check, DROP CONSTRAINT job_name_check",
    );
    // In one transaction, so that a job is never there without its inputs.
    let row = |id: &str, name: &str, hash: &str, drawing: &str| {
        server.sql(
            "isomark",
            &format!(
                "BEGIN; INSERT INTO isomark.job (id, line, name, sender, bytes, inputs_blake3) VALUES \
                 ('{id}', 'laser2', E'{name}', E'some\\none', 0, '{hash}'); {drawing}; COMMIT"
            ),
        );
    };
    let with = |id: &str, bytes: &str| {
        format!("INSERT INTO isomark.job_inputs VALUES ('{id}', {bytes}, NULL, NULL)")
    };
    let wrong = "ab".repeat(32);
    let hostile: Vec<(String, &str)> = [
        "../../trough@a.dxf",
        "/tmp/trough@a.dxf",
        "..",
        "trough/../../a.dxf",
        "C:\\\\trough.dxf",
        "con.dxf",
        "trough.obj",
        "station.toml",
        ".isomark-x.part",
        "trough@good.dxf",
    ]
    .into_iter()
    .enumerate()
    .map(|(index, name)| (format!("{index:064x}"), name))
    .collect();
    for (id, name) in &hostile {
        row(id, name, &wrong, &with(id, "'\\x00'"));
    }
    row(&"c".repeat(64), "trough@none.dxf", &wrong, "SELECT 1");
    row(
        &"d".repeat(64),
        "trough@large.dxf",
        &wrong,
        &with(&"d".repeat(64), "convert_to(repeat('x', 70000000), 'UTF8')"),
    );
    row("../../../id", "trough@id.dxf", &wrong, &with("../../../id", "'\\x00'"));
    let ended =
        "SELECT count(*) FROM isomark.job WHERE outcome = 'rejected' AND reason <> '' AND station = 'laser2'";
    waits_for_rows(&server, ended, &(hostile.len() + 3).to_string(), &two);
    desk.write("trough@good.dxf", line(9.0));
    send(&desk, &[&server.url("owner"), "--to", "laser2", "trough@good.dxf"]);
    two.waits_for_file("import/trough@good.dxf");
    assert_eq!(files(&two, "import"), ["trough@good.dxf"]);
    two.waits_for("an empty hot folder", |two| files(two, "hot").is_empty());
    assert!(!PathBuf::from("/tmp/trough@a.dxf").exists());
    assert!(
        two.log().contains("does not match its hash") && two.log().contains("larger than"),
        "{}",
        two.log()
    );
}

#[test]
fn what_is_sent_twice_is_one_job_and_only_some_roles_send() {
    let Some((server, desk)) = server_with_tables() else { return };
    for role in ["station", "worker", "office", "viewer"] {
        server.login(&format!("the_{role}"), role);
    }
    desk.write("can@a.dxf", line(9.0));
    desk.write("can@a.toml", "[placement]\nanchor = \"center\"\n");
    let office = server.url("the_office");
    let output = send(&desk, &[&office, "--to", "nobody", "can@a.dxf", "--json"]);
    assert!(
        output.code == 0 && output.err.contains("no station of the fleet takes jobs for nobody"),
        "{output:?}"
    );
    let sent: Value = serde_json::from_str(&output.out).unwrap();
    assert_eq!((&sent["jobs"][0]["is_new"], &sent["is_served"]), (&true.into(), &false.into()));
    let again = send(&desk, &[&office, "--to", "nobody", "can@a.dxf", "--json"]);
    let again: Value = serde_json::from_str(&again.out).unwrap();
    assert_eq!(
        (&again["jobs"][0]["is_new"], &again["jobs"][0]["id"]),
        (&false.into(), &sent["jobs"][0]["id"])
    );
    let kept =
        "SELECT count(*), min(sender), min(octet_length(settings)) FROM isomark.job, isomark.job_inputs";
    assert_eq!(server.sql("isomark", kept), "1|the_office|30");
    send(&desk, &[&office, "--to", "nobody", "can@a.dxf", "--again"]);
    desk.write("can@a.toml", "");
    send(&desk, &[&office, "--to", "nobody", "can@a.dxf"]);
    assert_eq!(server.sql("isomark", "SELECT count(*) FROM isomark.job"), "3");
    assert_eq!(
        jobs(&server, &desk)["listed"][0]["reason"],
        "No station of the fleet takes jobs for this line."
    );
    for role in ["the_viewer", "the_worker"] {
        send(&desk, &[&server.url(role), "--to", "nobody", "can@a.dxf"]).refused(3, &["permission denied"]);
    }
    desk.write("can.glb", "");
    send(&desk, &[&office, "--to", "nobody", "can.glb"]).refused(1, &["Only drawings"]);
    let nowhere = format!("postgresql://owner@127.0.0.1:{}/isomark", crate::server::free_port());
    send(&desk, &[&nowhere, "--to", "nobody", "can@a.dxf"]).refused(3, &["cannot be reached"]);
}

/// What each role may do, in SQL. A station acts under its own name only.
#[test]
fn each_role_has_only_the_rights_on_jobs_that_it_needs() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let roles = ["station", "worker", "office", "viewer"];
    for role in roles {
        server.login(&format!("the_{role}"), role);
    }
    let beat = "SELECT isomark.beat('a', 'p', 'isomark', true, 0, 0, 0, 0, 0, 0, NULL)";
    assert!(server.sql_as("the_station", SECRET, "isomark", beat).status.success());
    let id = "a".repeat(64);
    let offer = format!("SELECT isomark.offer_job('{id}', 'a', 'x.dxf', NULL, '{id}', '', NULL, NULL)");
    let rights: &[(&str, &[&str])] = &[
        (&offer, &["station", "office"]),
        ("SELECT * FROM isomark.job, isomark.line", &roles),
        ("SELECT * FROM isomark.job_inputs", &[]),
        ("SELECT isomark.serve_lines('a', '{a}')", &["station"]),
        ("SELECT * FROM isomark.next_job('a', '{}')", &["station"]),
        ("SELECT isomark.take_job('x', 'a', 1)", &["station"]),
        ("SELECT isomark.end_job('x', 'a', 1, 'delivered', NULL)", &["station"]),
        ("SELECT * FROM isomark.take_over('x', NULL, false)", &["station", "office"]),
        ("INSERT INTO isomark.line VALUES ('x', 'a')", &[]),
        ("UPDATE isomark.job SET state = 'waiting'", &[]),
        ("DELETE FROM isomark.job WHERE false", &["office"]),
    ];
    for (statement, may) in rights {
        for role in roles {
            let output = server.sql_as(&format!("the_{role}"), SECRET, "isomark", statement);
            let wrong = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.success(), may.contains(&role), "{role}: {statement}: {wrong}");
        }
    }
    server.login("another", "station");
    for statement in [
        "SELECT isomark.serve_lines('a', '{b}')",
        "SELECT * FROM isomark.next_job('a', '{}')",
        "SELECT isomark.take_job('x', 'a', 1)",
        "SELECT isomark.end_job('x', 'a', 1, 'delivered', NULL)",
        "SELECT isomark.offer_job('b', 'a', 'x.dxf', 'a', 'b', '', NULL, NULL)",
    ] {
        let output = server.sql_as("another", SECRET, "isomark", statement);
        assert!(
            String::from_utf8_lossy(&output.stderr).contains("does not belong"),
            "{statement}: {output:?}"
        );
    }
}

#[test]
fn a_job_of_a_dead_station_stays_until_a_person_takes_it_over_and_a_stale_end_changes_nothing() {
    let Some((server, desk)) = server_with_tables() else { return };
    let proxy = Proxy::to(server.port);
    server.login("laser2", "station");
    let mut two = started(Station::new("laser2", &(in_fleet(&proxy.url("laser2")) + IN_CUPS)));
    for name in ["trough@a.dxf", "trough@b.dxf"] {
        desk.write(name, line(9.0));
        send(&desk, &[&server.url("owner"), "--to", "cups", name]);
    }
    // It waits there for a part, which laser2 does not get.
    let taken =
        "SELECT count(*) FROM isomark.job WHERE state = 'taken' AND station = 'laser2' AND attempt = 1";
    waits_for_rows(&server, taken, "2", &two);
    two.waits_for("both drops", |two| files(two, "hot").len() == 2 && two.logged("arrived as job") == 2);
    proxy.cut();
    two.kill();
    let mut three = station(&server, "laser3", IN_CUPS);
    three.start();
    three.waits_for_fleet(1);
    three.drop_in("trough.obj", &trough(1.0));
    three.waits_for("the part", |three| three.logged("is now the part of") == 1);
    let url = server.url("owner");
    retry(&desk, &[&url, "--take-over", "laser2"])
        .refused(3, &["stays with laser2, which is alive", "--force"][1..]);
    assert_eq!(server.sql("isomark", taken), "2");
    retry(&desk, &[&url, "--take-over", "laser9"]).refused(2, &["laser9"]);
    let id = server.sql("isomark", "SELECT id FROM isomark.job WHERE name = 'trough@a.dxf'");
    let output = retry(&desk, &[&url, "--take-over", &id[..12], "--force"]);
    assert!(output.code == 0 && output.out.contains("laser2 may have marked it before"), "{output:?}");
    three.waits_for_file("import/trough@a.dxf");
    let ends = "SELECT name, outcome, station, attempt FROM isomark.job WHERE state = 'ended' ORDER BY name";
    waits_for_rows(&server, ends, "trough@a.dxf|delivered|laser3|2", &three);
    // laser2 works alone, with its own drops. The other job waits: a person may take it over, and does.
    two.start();
    two.waits_for("the trouble", |two| two.logged("The station works without the fleet") >= 1);
    two.drop_in("trough.obj", &trough(1.0));
    two.drop_in("trough@own.dxf", &line(9.0));
    two.waits_for_file("import/trough@own.dxf");
    two.waits_for("the reason", |two| two.logged("trough@b.dxf waits: The fleet has not confirmed") == 1);
    let output = retry(&desk, &[&url, "--take-over", "laser2", "--force"]);
    assert_eq!(output.code, 0, "{}", output.err);
    three.waits_for_file("import/trough@b.dxf");
    waits_for_rows(
        &server,
        "SELECT count(*) FROM isomark.job WHERE station = 'laser3' AND attempt = 2",
        "2",
        &three,
    );
    assert_eq!(files(&two, "import"), ["trough@own.dxf"]);
    proxy.pass();
    for name in ["trough@a.dxf", "trough@b.dxf"] {
        two.waits_for_file(&format!("rejected/{name}"));
    }
    two.waits_for("the reasons", |two| two.logged("put this job back into its line's queue") == 2);
    assert_eq!(files(&two, "import"), ["trough@own.dxf"]);
    waits_for_rows(&server, ends, "trough@a.dxf|delivered|laser3|2\ntrough@b.dxf|delivered|laser3|2", &two);
    for attempt in 1..=3 {
        let stale = format!("SELECT isomark.end_job('{id}', 'laser2', {attempt}, 'rejected', 'late')");
        let output = server.sql_as("laser2", SECRET, "isomark", &stale);
        assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "f", "{output:?}");
    }
}

/// The station asks before it goes on with what it took before it died.
#[test]
fn a_station_that_comes_back_does_not_do_what_was_taken_over() {
    let Some((server, desk)) = server_with_tables() else { return };
    let mut two = started(station(&server, "laser2", IN_CUPS));
    desk.write("trough@a.dxf", line(9.0));
    let url = server.url("owner");
    send(&desk, &[&url, "--to", "cups", "trough@a.dxf"]);
    two.waits_for("the drop", |two| files(two, "hot") == ["trough@a.dxf"]);
    two.kill();
    let output = retry(&desk, &[&url, "--take-over", "laser2", "--force"]);
    assert_eq!(output.code, 0, "{}", output.err);
    let three = started(station(&server, "laser3", IN_CUPS));
    three.waits_for("the drop", |three| files(three, "hot") == ["trough@a.dxf"]);
    three.drop_in("trough.obj", &trough(1.0));
    three.waits_for_file("import/trough@a.dxf");
    // The part is known to it now, too.
    two.start();
    two.waits_for_file("rejected/trough@a.dxf");
    two.waits_for("the reason", |two| two.logged("put this job back into its line's queue") == 1);
    assert_eq!(files(&two, "import"), Vec::<String>::new());
    let ended = "SELECT outcome, station, attempt FROM isomark.job";
    waits_for_rows(&server, ended, "delivered|laser3|2", &two);
    // Nothing leads to a second mark without being asked for.
    two.waits_for("the end in the log", |two| two.logged("was not marked here") == 1);
    assert_eq!(two.logged("marked twice"), 0, "{}", two.log());
    let text = fs::read_to_string(two.path("rejected/trough@a.dxf.reason.txt")).unwrap();
    assert!(!text.contains("try again") && !text.contains("drop it again"), "{text}");
    for all in [&["trough@a.dxf"][..], &["--rejected"]] {
        two.desk
            .isomark(&[&["retry", "station.toml"], all].concat())
            .refused(3, &["another station", "--force"]);
        assert!(two.path("rejected/trough@a.dxf").exists() && files(&two, "hot").is_empty());
    }
    two.desk.isomark(&["retry", "station.toml", "--force"]).refused(2, &["--force"]);
    let output = two.desk.isomark(&["retry", "station.toml", "trough@a.dxf", "--force"]);
    assert_eq!(output.code, 0, "{}", output.err);
    two.waits_for_file("import/trough@a.dxf");
}

/// Nobody took it over while the database was away.
#[test]
fn a_station_that_comes_back_goes_on_when_the_fleet_confirms_its_jobs() {
    let Some((server, desk)) = server_with_tables() else { return };
    let mut two = started(station(&server, "laser2", IN_CUPS));
    desk.write("trough@a.dxf", line(9.0));
    send(&desk, &[&server.url("owner"), "--to", "cups", "trough@a.dxf"]);
    two.waits_for("the drop", |two| files(two, "hot") == ["trough@a.dxf"]);
    two.kill();
    server.cut();
    two.start();
    two.drop_in("trough.obj", &trough(1.0));
    two.waits_for("the reason", |two| two.logged("The fleet has not confirmed") == 1);
    let is_shown = |two: &Station| two.status()["waiting"].to_string().contains("job-being-checked");
    two.waits_for("the reason in the status", is_shown);
    server.run();
    two.waits_for_file("import/trough@a.dxf");
    waits_for_rows(&server, "SELECT outcome, attempt FROM isomark.job", "delivered|1", &two);
}

/// Somebody has the name of a job in the hot folder of its line.
#[test]
fn a_job_whose_name_is_taken_waits_in_the_queue_and_delays_no_other() {
    let Some((server, desk)) = server_with_tables() else { return };
    let two = started(station(&server, "laser2", ""));
    // Its own drop of that name waits for a part.
    two.drop_in("gutter@a.dxf", &line(7.0));
    two.waits_for("the own drop", |two| two.status()["waiting"]["count"] == 1);
    two.drop_in("trough.obj", &trough(1.0));
    desk.write("gutter@a.dxf", line(9.0));
    desk.write("trough@b.dxf", line(8.0));
    let url = server.url("owner");
    send(&desk, &[&url, "--to", "laser2", "gutter@a.dxf", "trough@b.dxf"]);
    two.waits_for_file("import/trough@b.dxf");
    let waiting = "SELECT name FROM isomark.job WHERE state = 'waiting'";
    assert_eq!(server.sql("isomark", waiting), "gutter@a.dxf");
    assert_eq!(fs::read_to_string(two.path("hot/gutter@a.dxf")).unwrap(), line(7.0));
    fs::remove_file(two.path("hot/gutter@a.dxf")).unwrap();
    two.waits_for("the job", |two| {
        fs::read_to_string(two.path("hot/gutter@a.dxf")).is_ok_and(|text| text == line(9.0))
    });
    // A person removes it: that is how it ends.
    fs::remove_file(two.path("hot/gutter@a.dxf")).unwrap();
    waits_for_rows(&server, "SELECT outcome FROM isomark.job WHERE name = 'gutter@a.dxf'", "removed", &two);
}

/// Prints the time from "sent" to "taken" by the clock of the server.
#[test]
#[ignore = "a measurement: cargo test --test fleet latency -- --ignored --nocapture"]
fn latency_from_sent_to_taken() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let one = started(station(&server, "laser1", TO_CUPS));
    let two = started(station(&server, "laser2", IN_CUPS));
    two.drop_in("trough.obj", &trough(1.0));
    two.waits_for("the part", |two| two.logged("is now the part of") == 1);
    for index in 0..100 {
        one.drop_in(&format!("trough@{index}.dxf"), &line(5.0 + f64::from(index) * 0.01));
        two.waits_for_file(&format!("import/trough@{index}.dxf"));
    }
    let statement = "SELECT percentile_cont(ARRAY[0.5, 0.99, 1]) WITHIN GROUP (ORDER BY \
                     extract(epoch FROM taken - at) * 1000), count(*) FROM isomark.job";
    println!("ms from sent to taken, p50, p99, max, jobs: {}", server.sql("isomark", statement));
}
