//! Figures of a large fleet on this machine; they are printed, and nothing is compared with them.
//!
//! `cargo test --release --test fleet load -- --ignored --nocapture`; `ISOMARK_STATIONS=20` and `ISOMARK_SKUS=2000` for less.

use std::time::{Duration, Instant};

use fs_err as fs;

use crate::fits::hash;
use crate::kills::number;
use crate::server::Server;
use crate::settings::turned;
use crate::station::Station;
use crate::tables::server_with_tables;

/// The time limit for one step.
const LIMIT: Duration = Duration::from_secs(1800);

/// Releases settings of these SKUs, as fast as the server does it.
fn release(server: &Server, skus: std::ops::Range<u64>, prefix: &str) -> f64 {
    let started = Instant::now();
    let all: Vec<u64> = skus.collect();
    for some in all.chunks(400) {
        let rows: Vec<String> = some
            .iter()
            .map(|sku| {
                let text = turned((sku % 360) as u32);
                format!("('{prefix}-{sku}', '{text}', '{}')", hash(&text))
            })
            .collect();
        server.sql(
            "isomark",
            &format!(
                "SELECT count(*) FROM (VALUES {}) AS v (sku, body, hash), \
                 LATERAL isomark.release(v.sku, v.sku, '', convert_to(v.body, 'UTF8'), v.hash, NULL)",
                rows.join(",")
            ),
        );
    }
    started.elapsed().as_secs_f64()
}

fn until(what: &str, mut condition: impl FnMut() -> bool) -> f64 {
    let started = Instant::now();
    while !condition() {
        assert!(started.elapsed() < LIMIT, "{what}");
        std::thread::sleep(Duration::from_millis(100));
    }
    started.elapsed().as_secs_f64()
}

#[test]
#[ignore = "takes minutes, and only prints figures"]
fn figures_of_a_large_fleet() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let (count, skus) = (number("ISOMARK_STATIONS", 50), number("ISOMARK_SKUS", 10_000));
    let mut stations: Vec<Station> = (0..count)
        .map(|index| {
            let name = format!("laser{index}");
            server.login(&name, "station");
            let station = Station::new(&name, &crate::station::in_fleet(&server.url(&name)));
            // As it is by default: one listing in 5 s.
            let file = station.path("station.toml");
            let text = fs::read_to_string(&file).unwrap().replace("rescan_s = 1\n", "");
            fs::write(&file, text).unwrap();
            station
        })
        .collect();
    let started = Instant::now();
    stations.iter_mut().for_each(Station::start);
    let there = "SELECT count(*) FROM isomark.station WHERE runs";
    until("the stations", || server.sql("isomark", there) == count.to_string());
    println!("{count} stations connected after {:.1} s", started.elapsed().as_secs_f64());
    let sum = |what: &str| {
        server.sql("isomark", &format!("SELECT {what} FROM pg_stat_database WHERE datname = 'isomark'"))
    };
    let transactions = || sum("xact_commit + xact_rollback").parse::<f64>().unwrap();
    std::thread::sleep(Duration::from_secs(15));
    let before = transactions();
    std::thread::sleep(Duration::from_secs(30));
    println!(
        "idle: {:.3} transactions per station and second",
        (transactions() - before) / 30.0 / count as f64
    );
    // One release after the other, each of them for all stations.
    const ROUNDS: u64 = 40;
    for round in 0..ROUNDS {
        release(&server, round..round + 1, "one");
        until("its reports", || {
            let reports = format!("SELECT count(*) FROM isomark.station_release WHERE sku = 'one-{round}'");
            server.sql("isomark", &reports) == count.to_string()
        });
    }
    let spread = "SELECT string_agg(round((1000 * p)::numeric, 0)::text, ' ') FROM unnest((SELECT percentile_cont(ARRAY[0.5, 0.99, 1]) \
                  WITHIN GROUP (ORDER BY extract(epoch FROM h.at - r.at)::float8) FROM isomark.station_release AS h \
                  JOIN isomark.release AS r ON r.sku = h.sku AND r.version = h.version)) AS p";
    println!(
        "release to file and report at {count} stations, {ROUNDS} releases: p50, p99, max = {} ms",
        server.sql("isomark", spread)
    );
    stations.truncate(1);
    let seconds = release(&server, 0..skus, "many");
    println!("{skus} releases in {seconds:.1} s: {:.0} in a second", skus as f64 / seconds);
    let received = format!(
        "SELECT count(*) >= {skus} FROM isomark.station_release WHERE station = 'laser0' AND sku LIKE 'many-%'"
    );
    let seconds = until("all settings", || server.sql("isomark", &received) == "t");
    println!("one station had all {skus} files after {seconds:.1} s more");
    let files = fs::read_dir(stations[0].path("skus")).unwrap().count() as u64;
    assert_eq!(files, skus + ROUNDS);
    stations[0].kill();
    release(&server, 0..1, "last");
    let started = Instant::now();
    stations[0].start();
    stations[0].waits_for("the last one", |station| station.path("skus/last-0.toml").exists());
    println!(
        "after a restart, it had compared {skus} files and received one after {:.1} s",
        started.elapsed().as_secs_f64()
    );
    println!("database: {}", sum("pg_size_pretty(pg_database_size(datname))"));
    for table in ["release", "current_release", "station_release"] {
        let size = format!(
            "SELECT round(pg_total_relation_size('isomark.{table}') / greatest(count(*), 1)) FROM isomark.{table}"
        );
        println!("isomark.{table}: {} bytes for each row, with its indexes", server.sql("isomark", &size));
    }
    let words = Instant::now();
    let status = crate::tables::fleet(&stations[0].desk, &["status", &server.url("owner")]);
    assert_eq!(status.code, 0, "{status:?}");
    println!("isomark fleet status: {:.2} s", words.elapsed().as_secs_f64());
}
