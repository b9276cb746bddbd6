//! Fits and current parts that stations share.

use fs_err as fs;

use crate::server::{SECRET, Server, waits_for};
use crate::station::{Station, line, trough};
use crate::tables::{fleet, server_with_tables};

/// The hash of a part, as everything names it.
pub fn hash(part: &str) -> String {
    blake3::hash(part.as_bytes()).to_hex().to_string()
}

/// The hash of the part that a station has as the current one of its SKU.
pub fn current(station: &Station, sku: &str) -> String {
    let folder = fs::read_dir(station.path("cache")).into_iter().flatten().next();
    let Some(Ok(folder)) = folder else { return String::new() };
    let text = fs::read_to_string(folder.path().join(sku).join("current.toml")).unwrap_or_default();
    let table: toml::Table = text.parse().unwrap_or_default();
    table.get("blake3").and_then(|hash| hash.as_str()).unwrap_or_default().to_owned()
}

/// A server with two running stations.
fn two_stations() -> Option<(Server, crate::desk::Desk, [Station; 2])> {
    let (server, desk) = server_with_tables()?;
    let stations = ["laser1", "laser2"].map(|name| {
        server.login(name, "station");
        let station = Station::of(name, &server.url(name));
        station.waits_for_fleet(1);
        station
    });
    Some((server, desk, stations))
}

#[test]
fn a_part_that_one_station_learned_is_known_to_all() {
    let Some((server, desk, [one, two])) = two_stations() else { return };
    // The drawing is there before its part.
    two.drop_in("trough.dxf", &line(9.0));
    two.waits_for("the waiting drawing", |two| two.status()["waiting"]["count"] == 1);
    one.drop_in("trough.obj", &trough(1.0));
    one.drop_in("trough.dxf", &line(9.0));
    one.waits_for_file("import/trough.dxf");
    two.waits_for_file("import/trough.dxf");
    let drawing = |station: &Station| fs::read(station.path("import/trough.dxf")).unwrap();
    assert_eq!(drawing(&one), drawing(&two));
    assert_eq!(two.logged("is now the part of"), 0, "only the fit arrived, not the part: {}", two.log());
    // The same part dropped at the other station is not fitted again.
    two.drop_in("trough.obj", &trough(1.0));
    two.waits_for("the known part", |two| two.logged("already known") == 1);
    assert_eq!(server.sql("isomark", "SELECT count(*) FROM isomark.fit"), "1");
    // A new part makes the drawings of both outdated.
    one.drop_in("trough.obj", &trough(1.2));
    for station in [&one, &two] {
        station.waits_for("the outdated drawing", |station| station.status()["outdated"]["count"] == 1);
    }
    assert_eq!(
        server.sql("isomark", "SELECT max(version) FROM isomark.part_version WHERE sku = 'trough'"),
        "2"
    );
    let words = || fleet(&desk, &["status", &server.url("owner")]).out;
    waits_for("two fits", || words().contains("2 fits"), words);
}

#[test]
fn a_dropped_part_uses_the_fit_of_another_station() {
    let Some((server, _desk, [one, two])) = two_stations() else { return };
    one.drop_in("trough.obj", &trough(1.0));
    one.waits_for("the part", |one| one.logged("is now the part of SKU `trough`") == 1);
    waits_for("the fit", || server.sql("isomark", "SELECT count(*) FROM isomark.fit") == "1", || one.log());
    two.drop_in("trough.obj", &trough(1.0));
    two.waits_for("the part", |two| two.logged("already known") == 1);
}

/// All are values that a hostile or broken program could write.
#[test]
fn wrong_fits_are_reported_and_made_here() {
    let Some((server, desk, [one, two])) = two_stations() else { return };
    let skus = ["hash", "body", "other", "large"];
    for (index, sku) in skus.iter().enumerate() {
        one.drop_in(&format!("{sku}.obj"), &trough(1.0 + index as f64 * 0.1));
    }
    let count = || server.sql("isomark", "SELECT count(*) FROM isomark.fit") == "4";
    waits_for("the fits", count, || one.log());
    server.sql("isomark", "ALTER TABLE isomark.fit DROP CONSTRAINT fit_body_check");
    for change in [
        "UPDATE isomark.fit SET body_blake3 = decode(repeat('00', 32), 'hex') WHERE sku = 'hash'",
        "UPDATE isomark.fit SET body = '\\x00' WHERE sku = 'body'",
        "UPDATE isomark.fit SET body = f.body, body_blake3 = f.body_blake3 FROM isomark.fit f \
         WHERE fit.sku = 'other' AND f.sku = 'large'",
        "UPDATE isomark.fit SET body = decode(repeat('00', 70000000), 'hex') WHERE sku = 'large'",
    ] {
        server.sql("isomark", change);
    }
    let content = hash_of_bytes(&[0]);
    server.sql(
        "isomark",
        &format!("UPDATE isomark.fit SET body_blake3 = decode('{content}', 'hex') WHERE sku = 'body'"),
    );
    for (index, (sku, what)) in [
        ("hash", "its content does not match its hash"),
        ("body", "the file is truncated"),
        ("other", "it is the surface of another part"),
        ("large", "it is larger than"),
    ]
    .into_iter()
    .enumerate()
    {
        two.drop_in(&format!("{sku}.obj"), &trough(1.0 + index as f64 * 0.1));
        two.drop_in(&format!("{sku}.dxf"), &line(9.0));
        two.waits_for_file(&format!("import/{sku}.dxf"));
        two.waits_for(what, |two| two.logged(what) >= 1);
    }
    assert_eq!(two.logged("already known"), 0, "{}", two.log());
    // The office removes one; then it is shared again.
    let key = server.sql("isomark", "SELECT key FROM isomark.fit WHERE sku = 'hash'");
    server.login("office", "office");
    let pruned = fleet(&desk, &["prune", &server.url("office"), "--fit", &key]);
    assert!(pruned.code == 0 && pruned.err.contains("1 fit removed; 3 fits"), "{pruned:?}");
}

/// The office removes the surface of a current part, which a station needs that never had it.
#[test]
fn a_removed_surface_of_a_current_part_comes_back_from_a_station_that_has_it() {
    let Some((server, desk)) = server_with_tables() else { return };
    let station = |name: &str| {
        server.login(name, "station");
        let station = Station::of(name, &server.url(name));
        station.waits_for_fleet(1);
        station
    };
    let url = server.url("owner");
    let fits = || server.sql("isomark", "SELECT count(*) FROM isomark.fit");
    let prune = || {
        let key = server.sql("isomark", "SELECT key FROM isomark.fit");
        let pruned = fleet(&desk, &["prune", &url, "--fit", &key]);
        assert!(pruned.code == 0 && pruned.err.contains("1 fit removed; 0 fits"), "{pruned:?}");
    };
    let mut one = station("laser1");
    one.drop_in("trough.obj", &trough(1.0));
    waits_for("the fit", || fits() == "1", || one.log());
    prune();
    // Another station asks for it.
    let two = station("laser2");
    two.drop_in("trough.dxf", &line(9.0));
    two.waits_for_file("import/trough.dxf");
    assert_eq!(two.logged("is now the part of"), 0, "{}", two.log());
    // The part is dropped again.
    prune();
    one.drop_in("trough.obj", &trough(1.0));
    waits_for("the fit again", || fits() == "1", || one.log());
    // Stations that have it start again; until then, the reason states what is missing.
    drop(two);
    one.kill();
    prune();
    let three = station("laser3");
    three.drop_in("trough.dxf", &line(9.0));
    three.waits_for("the reason", |three| {
        let waiting = three.status()["waiting"].to_string();
        waiting.contains("waits-for-part") && waiting.contains("its surface has not arrived here")
    });
    one.start();
    three.waits_for_file("import/trough.dxf");
    assert_eq!(fits(), "1");
    assert_eq!(three.logged("is now the part of"), 0, "{}", three.log());
}

fn hash_of_bytes(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

#[test]
fn rows_that_no_station_writes_lead_out_of_no_folder_and_stop_nothing() {
    let Some((server, _desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    for constraint in ["name", "file", "blake3"] {
        for table in ["current_part", "part_version"] {
            let name = format!("part_version_{constraint}_check");
            server.sql("isomark", &format!("ALTER TABLE isomark.{table} DROP CONSTRAINT {name}"));
        }
    }
    let good = hash("x");
    for (sku, name, file, hash) in [
        ("a", "../../a", "a.obj", &*good),
        ("b", "/etc/passwd", "a.obj", &good),
        ("c", "c", "../../a.obj", &good),
        ("d", "d", "/tmp/a.obj", &good),
        ("e", "e", "a.obj", "../../../a"),
        ("f", "f", "a\nb.obj", &good),
        ("g", "CON", "a.obj", &good),
        ("ok", "ok", "ok.obj", &good),
    ] {
        server.sql(
            "isomark",
            &format!("INSERT INTO isomark.current_part VALUES ('{sku}', 1, '{name}', '{file}', '{hash}', false, 's', 's', now())"),
        );
    }
    server.sql("isomark", "DROP INDEX isomark.current_part_blake3");
    server.sql(
        "isomark",
        "INSERT INTO isomark.current_part SELECT 'h', 1, repeat('h', 9000000), repeat('x', 9000000), repeat('y', 9000000), false, \
         's', 's', now()",
    );
    let station = Station::of("laser1", &server.url("laser1"));
    station.waits_for_fleet(1);
    assert_eq!(current(&station, "ok"), good);
    let folder = fs::read_dir(station.path("cache")).unwrap().next().unwrap().unwrap().path();
    let names: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names, ["ok"]);
    server.sql("isomark", "SELECT pg_notify('isomark', repeat('x', 7000)), pg_notify('isomark', 'part ../..'), pg_notify('isomark', '')");
    station.drop_in("trough.obj", &trough(1.0));
    station.drop_in("trough.dxf", &line(9.0));
    station.waits_for_file("import/trough.dxf");
    waits_for(
        "the fit",
        || server.sql("isomark", "SELECT count(*) FROM isomark.fit") == "1",
        || station.log(),
    );
}

/// Both end with the part that the database has as the current one, and its versions have no gap.
#[test]
fn stations_that_learn_parts_at_the_same_time_agree() {
    let Some((server, _desk, stations)) = two_stations() else { return };
    const ROUNDS: usize = 6;
    for round in 0..ROUNDS {
        for (index, station) in stations.iter().enumerate() {
            station.drop_in("trough.obj", &trough(1.0 + round as f64 * 0.1 + index as f64 * 0.01));
        }
        for station in &stations {
            station
                .waits_for("the part", |station| station.logged("is now the part of SKU `trough`") > round);
        }
    }
    let agreed = || server.sql("isomark", "SELECT blake3 FROM isomark.current_part WHERE sku = 'trough'");
    for station in &stations {
        station.waits_for("an empty outbox", |station| {
            fs::read_dir(station.path("state/fleet/outbox")).unwrap().next().is_none()
        });
        station.waits_for("one current part", |station| current(station, "trough") == agreed());
    }
    let gaps =
        "SELECT count(*) = max(version) AND min(version) = 1 FROM isomark.part_version WHERE sku = 'trough'";
    assert_eq!(server.sql("isomark", gaps), "t");
    let last = "SELECT c.blake3 = v.blake3 AND c.version = v.version FROM isomark.current_part c, isomark.part_version v \
                WHERE v.sku = c.sku ORDER BY v.version DESC LIMIT 1";
    assert_eq!(server.sql("isomark", last), "t");
}

#[test]
fn roles_have_only_their_rights_on_fits_and_parts() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let roles = ["station", "worker", "office", "viewer"];
    for role in roles {
        server.login(&format!("the_{role}"), role);
    }
    let [a, b] = ["a", "b"].map(|letter| letter.repeat(64));
    let insert = format!(
        "INSERT INTO isomark.fit (key, sku, part, body, body_blake3, station) SELECT substr(md5(random()::text), 1, 32), \
         's', '{a}', 'x', decode('{b}', 'hex'), 's'"
    );
    let learned = format!("SELECT * FROM isomark.learned('s', 's', 's.obj', '{a}', false, 's', 1)");
    let rights: &[(&str, &[&str])] = &[
        (&insert, &["station", "worker"]),
        ("SELECT body FROM isomark.fit", &["station", "worker"]),
        ("SELECT key, bytes FROM isomark.fit", &roles),
        ("UPDATE isomark.fit SET used = now()", &["station", "worker"]),
        ("UPDATE isomark.fit SET body = 'y'", &[]),
        ("UPDATE isomark.fit SET body_blake3 = body_blake3", &[]),
        (&learned, &["station", "office"]),
        ("SELECT * FROM isomark.current_part", &roles),
        ("SELECT * FROM isomark.part_version", &roles),
        ("UPDATE isomark.current_part SET version = 9", &[]),
        ("INSERT INTO isomark.part_version SELECT * FROM isomark.part_version", &[]),
        ("DELETE FROM isomark.part_version", &[]),
        ("DELETE FROM isomark.fit", &["office"]),
    ];
    for (statement, may) in rights {
        for role in roles {
            let output = server.sql_as(&format!("the_{role}"), SECRET, "isomark", statement);
            let wrong = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.success(), may.contains(&role), "{role}: {statement}: {wrong}");
        }
    }
}

#[test]
fn old_fits_and_too_many_fits_are_removed() {
    let Some((server, desk)) = server_with_tables() else { return };
    let url = server.url("owner");
    let [old, current] = ["a", "b"].map(|letter| letter.repeat(64));
    server.sql(
        "isomark",
        &format!(
            "INSERT INTO isomark.fit (key, sku, part, body, body_blake3, station, used) \
             SELECT lpad(to_hex(n), 32, '0'), 's', CASE WHEN n % 2 = 0 THEN '{old}' ELSE '{current}' END, \
             decode(repeat('00', 1000), 'hex'), decode('{old}', 'hex'), 's', now() - n * interval '1 day' \
             FROM generate_series(1, 1000) AS n"
        ),
    );
    server.sql("isomark", &format!("SELECT isomark.learned('s', 's', 's.obj', '{current}', false, 's', 1)"));
    let prune = |arguments: &[&str], words: &str| {
        let output = fleet(&desk, &[&["prune", &url], arguments].concat());
        assert!(output.code == 0 && output.err.contains(words), "{output:?}");
    };
    // The even ones from 500 on; the odd ones are of the current part.
    prune(&["--unused-days", "499.5"], "251 fits removed; 749 fits, 0.7 MB left");
    prune(&["--max-gb", "0.0006"], "149 fits removed; 600 fits, 0.6 MB left");
    let newest =
        format!("SELECT max(now() - used) < interval '201 days' FROM isomark.fit WHERE part = '{old}'");
    assert_eq!(server.sql("isomark", &newest), "t");
    // Those of the current part stay.
    prune(&["--max-gb", "0.0001"], "100 fits removed; 500 fits, 0.5 MB left");
    prune(&["--max-gb", "0.0001"], "are of current parts, which stay");
    for unknown in ["xyz", &"0".repeat(32)] {
        fleet(&desk, &["prune", &url, "--fit", unknown]).refused(2, &["no fit with the key", unknown]);
    }
    fleet(&desk, &["prune", &url]).refused(2, &["--unused-days"]);
}
