//! A sender, the stations of a group and the server are killed at random while drawings go from one to the others; afterwards each drawing
//! was delivered exactly once, at exactly one station.
//!
//! `ISOMARK_KILLS=300 ISOMARK_SEED=7 cargo test --test fleet job_kills -- --nocapture` kills as often as given, and prints the
//! counts. Several processes may do so at once, each with its own server and stations:
//!
//! ```text
//! for seed in 1 2 3 4 5 6 7 8; do
//!     ISOMARK_KILLS=250 ISOMARK_SEED=$seed cargo test --test fleet job_kills -- --nocapture > kills-$seed.txt 2>&1 &
//! done; wait
//! ```

use std::collections::BTreeMap;

use fs_err as fs;

use crate::jobs::files;
use crate::kills::{Random, number};
use crate::proxy::Proxy;
use crate::server::waits_for;
use crate::station::{Station, in_fleet, line, trough};
use crate::tables::server_with_tables;

const TAKERS: usize = 2;

/// Takes what is in the import folders, as an importer does, and counts each name.
fn collect(stations: &[Station], delivered: &mut BTreeMap<String, Vec<usize>>) {
    for (index, station) in stations.iter().enumerate() {
        for name in files(station, "import") {
            if name.starts_with('.') {
                continue;
            }
            fs::remove_file(station.path("import").join(&name)).unwrap();
            delivered.entry(name).or_default().push(index);
        }
    }
}

#[test]
fn killed_stations_and_servers_deliver_each_job_exactly_once() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let (kills, seed) = (number("ISOMARK_KILLS", 12), number("ISOMARK_SEED", 1));
    println!("seed {seed}");
    let mut random = Random(seed);
    let proxies: Vec<Proxy> = (0..=TAKERS).map(|_| Proxy::to(server.port)).collect();
    let mut stations: Vec<Station> = (0..=TAKERS)
        .map(|index| {
            let name = format!("laser{index}");
            server.login(&name, "station");
            let more = match index {
                0 => "[route]\nrules = [{ name = \"*@*\", line = \"cups\" }]\n",
                _ => "lines = [\"cups\"]\n",
            };
            let mut station = Station::new(&name, &(in_fleet(&proxies[index].url(&name)) + more));
            station.start();
            station.waits_for_fleet(1);
            station
        })
        .collect();
    stations[1].drop_in("trough.obj", &trough(1.0));
    for station in &stations {
        station.waits_for("the part", |station| station.path("cache").exists());
    }
    let (mut dropped, mut delivered) = (0, BTreeMap::new());
    let mut counts = [0; 3];
    for kill in 0..kills {
        for _ in 0..=random.below(3) {
            stations[0].drop_in(&format!("trough@{dropped}.dxf"), &line(5.0 + f64::from(dropped) * 1e-3));
            dropped += 1;
        }
        // Between any two steps: after a random number of looks at files.
        for _ in 0..random.below(120) {
            let _ = fs::read_dir(stations[0].path("state"));
            std::thread::yield_now();
        }
        let (what, victim) = (random.below(8), random.below(TAKERS + 1));
        match what {
            0..=4 => {
                counts[0] += 1;
                stations[victim].kill();
                collect(&stations, &mut delivered);
                stations[victim].start();
            }
            5 | 6 => {
                counts[1] += 1;
                server.cut();
                collect(&stations, &mut delivered);
                server.run();
            }
            _ => {
                counts[2] += 1;
                proxies[victim].cut();
            }
        }
        if kill % 2 == 1 {
            proxies.iter().for_each(Proxy::pass);
        }
        collect(&stations, &mut delivered);
    }
    proxies.iter().for_each(Proxy::pass);
    let all = |stations: &[Station]| {
        let logs: Vec<String> = stations.iter().map(Station::log).collect();
        let rows = server.sql(
            "isomark",
            "SELECT name, state, outcome, station, attempt FROM isomark.job WHERE outcome IS NULL",
        );
        let hot: Vec<_> = stations.iter().map(|station| files(station, "hot")).collect();
        format!("{rows}\n{hot:?}\n{}", logs.join("\n----\n"))
    };
    let ended = "SELECT count(*) FROM isomark.job WHERE state = 'ended'";
    // After many kills many jobs are left: each wait is for the next one that ends.
    let mut count = String::new();
    while count != dropped.to_string() {
        let before = count.clone();
        let has_more = || {
            count = server.sql("isomark", ended);
            count != before
        };
        waits_for("the next job", has_more, || all(&stations));
    }
    collect(&stations, &mut delivered);
    let wrong: Vec<_> = (0..dropped)
        .map(|index| format!("trough@{index}.dxf"))
        .filter_map(|name| {
            let at = delivered.get(&name).cloned().unwrap_or_default();
            (at.len() != 1 || at[0] == 0).then_some((name, at))
        })
        .collect();
    assert!(wrong.is_empty(), "delivered at these stations: {wrong:?}\n{}", all(&stations));
    let outcomes = server.sql(
        "isomark",
        "SELECT outcome, max(attempt), count(*) FROM isomark.job GROUP BY outcome ORDER BY 1",
    );
    // What a crash left behind is removed at the next start.
    stations.iter_mut().for_each(|station| {
        station.kill();
        station.start();
    });
    for station in &stations {
        waits_for("an empty hot folder", || files(station, "hot").is_empty(), || all(&stations));
    }
    let [killed, servers, cuts] = counts;
    println!(
        "{dropped} jobs, {killed} stations and {servers} servers killed, {cuts} cuts; ended: {outcomes}"
    );
}
