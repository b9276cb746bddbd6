//! The database is away, slow or refuses: stations go on, keep what they have to send, and send it in order afterwards.

use std::time::Duration;

use fs_err as fs;

use crate::fits::{current, hash};
use crate::proxy::Proxy;
use crate::server::{Server, waits_for};
use crate::station::{Station, line, trough};
use crate::tables::server_with_tables;

/// The names of the files in the outbox.
fn outbox(station: &Station) -> usize {
    fs::read_dir(station.path("state/fleet/outbox")).into_iter().flatten().count()
}

/// Drops a part and a drawing, which are delivered.
#[track_caller]
fn works(station: &Station, sku: &str, depth: f64) {
    station.drop_in(&format!("{sku}.obj"), &trough(depth));
    station.drop_in(&format!("{sku}.dxf"), &line(9.0));
    station.waits_for_file(&format!("import/{sku}.dxf"));
}

fn learned_in_order(server: &Server) -> String {
    server.sql("isomark", "SELECT string_agg(sku, ' ' ORDER BY at, sku) FROM isomark.part_version")
}

#[test]
fn what_was_learned_while_the_network_was_cut_is_sent_in_order_also_after_a_kill() {
    let Some((server, _desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    let proxy = Proxy::to(server.port);
    let mut station = Station::of("laser1", &proxy.url("laser1"));
    station.waits_for_fleet(1);
    proxy.cut();
    station.waits_for("the trouble", |station| station.troubles().contains("cannot be reached"));
    for (index, sku) in ["c", "a", "b"].into_iter().enumerate() {
        works(&station, sku, 1.0 + index as f64 * 0.1);
    }
    assert_eq!(outbox(&station), 6);
    station.kill();
    station.start();
    station.waits_for("the trouble again", |station| station.logged("The station works without") == 2);
    works(&station, "d", 1.4);
    assert_eq!(outbox(&station), 8);
    proxy.pass();
    station.waits_for("an empty outbox", |station| outbox(station) == 0);
    assert_eq!(learned_in_order(&server), "c a b d");
    assert_eq!(server.sql("isomark", "SELECT count(*) FROM isomark.fit"), "4");
}

/// Nothing answers, and nothing is closed: as a stopped server, or a firewall that drops packets.
#[test]
fn a_server_that_hangs_holds_up_nothing() {
    let Some((server, _desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    let proxy = Proxy::to(server.port);
    let station = Station::of("laser1", &proxy.url("laser1"));
    station.waits_for_fleet(1);
    proxy.hold();
    for (index, sku) in ["a", "b", "c"].into_iter().enumerate() {
        works(&station, sku, 1.0 + index as f64 * 0.1);
    }
    station.waits_for("the trouble", |station| station.troubles().contains("cannot be reached"));
    works(&station, "d", 1.4);
    proxy.pass();
    station.waits_for("an empty outbox", |station| outbox(station) == 0);
    assert_eq!(learned_in_order(&server), "a b c d");
}

#[test]
fn revoked_rights_and_a_database_that_only_reads_are_waited_for() {
    let Some((server, _desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    let station = Station::of("laser1", &server.url("laser1"));
    station.waits_for_fleet(1);
    server.sql("isomark", "REVOKE isomark_station FROM laser1");
    works(&station, "a", 1.0);
    station.waits_for("the rights", |station| station.troubles().contains("does not permit"));
    server.sql("isomark", "GRANT isomark_station TO laser1");
    station.waits_for("an empty outbox", |station| outbox(station) == 0);
    // As when its disk is full or it became a copy.
    server.sql("isomark", "ALTER DATABASE isomark SET default_transaction_read_only = on");
    let end = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE usename = 'laser1'";
    server.sql("isomark", end);
    works(&station, "b", 1.1);
    station.waits_for("the trouble", |station| station.troubles().contains("read-only"));
    server.sql("postgres", "ALTER DATABASE isomark SET default_transaction_read_only = off");
    station.waits_for("an empty outbox", |station| outbox(station) == 0);
    assert_eq!(learned_in_order(&server), "a b");
}

/// A station was cut off while it learned a part. Whichever part was learned last, anywhere, is the current one everywhere.
#[test]
fn the_part_that_was_learned_last_stays_also_if_its_rival_is_announced_later() {
    let Some((server, _desk)) = server_with_tables() else { return };
    for name in ["laser1", "laser2"] {
        server.login(name, "station");
    }
    let proxy = Proxy::to(server.port);
    let cut_off = Station::of("laser1", &proxy.url("laser1"));
    let other = Station::of("laser2", &server.url("laser2"));
    cut_off.waits_for_fleet(1);
    other.waits_for_fleet(1);
    let learns = |station: &Station, depth: f64, times: usize| {
        station.drop_in("trough.obj", &trough(depth));
        station.waits_for("the part", |station| station.logged("is now the part of SKU `trough`") == times);
    };
    let agreed = || server.sql("isomark", "SELECT blake3 FROM isomark.current_part WHERE sku = 'trough'");
    let everywhere = |depth: f64| {
        let part = hash(&trough(depth));
        waits_for("the part in the fleet", || agreed() == part, || cut_off.log());
        for station in [&cut_off, &other] {
            station.waits_for("the part here", |station| current(station, "trough") == part);
        }
    };
    proxy.cut();
    cut_off.waits_for("the trouble", |station| station.troubles().contains("cannot be reached"));
    learns(&cut_off, 1.0, 1);
    learns(&other, 1.1, 1);
    waits_for("the part", || agreed() == hash(&trough(1.1)), || other.log());
    proxy.pass();
    cut_off
        .waits_for("the news", |station| station.logged("is not the part of trough any more: laser2") == 1);
    everywhere(1.1);
    proxy.cut();
    cut_off.waits_for("the trouble", |station| station.troubles().contains("cannot be reached"));
    learns(&other, 1.2, 2);
    waits_for("the part", || agreed() == hash(&trough(1.2)), || other.log());
    learns(&cut_off, 1.3, 2);
    proxy.pass();
    everywhere(1.3);
}

/// Each answer takes 0.8 s, three times as long as one that is waited for: the station is in the fleet, and no drop waits for it. The
/// server's log shows that it was not asked.
#[test]
fn drops_do_not_wait_for_a_slow_database() {
    let Some((server, _desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    server.login("laser2", "station");
    let other = Station::of("laser2", &server.url("laser2"));
    for (index, sku) in ["a", "b", "c", "d"].into_iter().enumerate() {
        other.drop_in(&format!("{sku}.obj"), &trough(1.0 + index as f64 * 0.1));
    }
    let fits = || server.sql("isomark", "SELECT count(*) FROM isomark.fit");
    waits_for("the fits", || fits() == "4", || other.log());
    drop(other);
    server.cut();
    server.set("log_statement = 'all'\n");
    server.run();
    let proxy = Proxy::to(server.port);
    proxy.delay(Duration::from_millis(800));
    let station = Station::of("laser1", &proxy.url("laser1"));
    // The connection takes some 10 s; each of its steps has the whole time limit.
    let logins =
        || server.sql("isomark", "SELECT count(*) > 0 FROM pg_stat_activity WHERE usename = 'laser1'");
    waits_for("the login", || logins() == "t", || station.log());
    let beats = || server.sql("isomark", "SELECT count(*) FROM isomark.station WHERE name = 'laser1'");
    waits_for("a sign of life", || beats() == "1", || station.log());
    station.waits_for_fleet(1);
    for (index, sku) in ["a", "b", "c"].into_iter().enumerate() {
        works(&station, sku, 1.0 + index as f64 * 0.1);
    }
    let asked = || fs::read_to_string(server.path("log")).unwrap().contains("FROM isomark.fit WHERE key");
    assert!(!asked(), "{}", station.log());
    assert_eq!(station.logged("already known"), 0, "each part was fitted here: {}", station.log());
    // What the station learned is announced all the same, and once the network is fast again, fits are fetched.
    station.waits_for("an empty outbox", |station| outbox(station) == 0);
    assert_eq!(station.troubles(), "[]");
    proxy.delay(Duration::ZERO);
    let beat = || server.sql("isomark", "SELECT beat FROM isomark.station WHERE name = 'laser1'");
    // The first one may have been under way.
    for _ in 0..2 {
        let before = beat();
        waits_for("a sign of life", || beat() != before, || station.log());
    }
    station.drop_in("d.obj", &trough(1.3));
    station.waits_for("the fetched fit", |station| station.logged("already known") == 1);
}

#[test]
fn a_password_is_changed_while_the_station_runs() {
    let Some((server, _desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    let station = Station::of("laser1", &server.url("laser1"));
    station.waits_for_fleet(1);
    let end = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE usename = 'laser1'";
    server.sql("isomark", "ALTER ROLE laser1 PASSWORD 'Another-8-Zebra'");
    // The connection that is open stays.
    works(&station, "a", 1.0);
    station.waits_for("an empty outbox", |station| outbox(station) == 0);
    server.sql("isomark", end);
    station.waits_for("the old password", |station| station.troubles().contains("refuses the connection"));
    works(&station, "b", 1.1);
    station.desk.write("password.txt", "Another-8-Zebra\n");
    station.waits_for("an empty outbox", |station| outbox(station) == 0);
    station.waits_for("no trouble", |station| station.troubles() == "[]");
    assert_eq!(learned_in_order(&server), "a b");
    assert_eq!(station.logged("refuses the connection"), 1, "once: {}", station.log());
    assert_eq!(station.logged("Another-8-Zebra"), 0);
}

/// As a server answers whose disk is full: PostgreSQL, appendix A, 53100. It still answers questions.
#[test]
fn a_full_database_is_waited_for() {
    let Some((server, _desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    let station = Station::of("laser1", &server.url("laser1"));
    station.waits_for_fleet(1);
    server.sql(
        "isomark",
        "CREATE FUNCTION public.full() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN \
         RAISE EXCEPTION 'could not extend file: No space left on device' USING ERRCODE = '53100'; END $$; \
         CREATE TRIGGER is_full BEFORE INSERT ON isomark.part_version EXECUTE FUNCTION public.full(); \
         CREATE TRIGGER is_full BEFORE INSERT ON isomark.fit EXECUTE FUNCTION public.full()",
    );
    works(&station, "a", 1.0);
    station.waits_for("the trouble", |station| station.troubles().contains("No space left on device"));
    works(&station, "b", 1.1);
    assert_eq!(outbox(&station), 4);
    server
        .sql("isomark", "DROP TRIGGER is_full ON isomark.part_version; DROP TRIGGER is_full ON isomark.fit");
    station.waits_for("an empty outbox", |station| outbox(station) == 0);
    assert_eq!(learned_in_order(&server), "a b");
}
