//! Stations and the server are killed at random while stations learn parts; afterwards all agree on one order of the parts.
//!
//! `cargo test --test fleet kills` kills a few times; `ISOMARK_KILLS=300 ISOMARK_SEED=7 cargo test --test fleet kills --
//! --nocapture` as often as given, and prints the counts.

use std::collections::BTreeMap;

use fs_err as fs;

use crate::fits::{current, hash};
use crate::proxy::Proxy;
use crate::server::waits_for;
use crate::station::{Station, trough};
use crate::tables::server_with_tables;

const SKUS: [&str; 2] = ["trough", "Gutter"];
const STATIONS: usize = 3;

/// SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014).
pub struct Random(pub u64);

impl Random {
    pub fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % limit as u64) as usize
    }
}

pub fn number(variable: &str, usual: u64) -> u64 {
    std::env::var(variable).ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

/// Checks the order that the database has, without gaps and by the time of learning, and that all stations end with its last
/// part. It does not record which parts each station saw in between.
#[test]
fn killed_stations_and_servers_agree_on_one_order_of_parts() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let (kills, seed) = (number("ISOMARK_KILLS", 12), number("ISOMARK_SEED", 1));
    println!("seed {seed}");
    let mut random = Random(seed);
    let proxies: Vec<Proxy> = (0..STATIONS).map(|_| Proxy::to(server.port)).collect();
    let mut stations: Vec<Station> = (0..STATIONS)
        .map(|index| {
            let name = format!("laser{index}");
            server.login(&name, "station");
            Station::of(&name, &proxies[index].url(&name))
        })
        .collect();
    // The depth of each dropped part is unique, so its hash names the drop.
    let mut drops: BTreeMap<String, (usize, usize)> = BTreeMap::new();
    let mut last_drop = BTreeMap::new();
    let mut counts = [0; 4];
    for kill in 0..kills {
        for _ in 0..=random.below(4) {
            let (station, sku) = (random.below(STATIONS), random.below(SKUS.len()));
            let name = format!("{}.obj", SKUS[sku]);
            // A part that is not filed yet would be replaced unseen.
            stations[station].waits_for("the last part", |station| !station.path("hot").join(&name).exists());
            let part = trough(1.0 + drops.len() as f64 * 1e-3);
            stations[station].drop_in(&name, &part);
            drops.insert(hash(&part), (station, sku));
            last_drop.insert((station, sku), hash(&part));
        }
        let victim = random.below(STATIONS);
        let what = random.below(4);
        counts[what] += 1;
        match what {
            0 | 1 => {
                // Between any two steps: after a random number of looks at the files of the station.
                for _ in 0..random.below(40) {
                    let _ = fs::read_dir(stations[victim].path("state"));
                    std::thread::yield_now();
                }
                stations[victim].kill();
                stations[victim].start();
            }
            2 => {
                server.cut();
                server.run();
            }
            _ => proxies[victim].cut(),
        }
        if kill % 2 == 1 {
            proxies.iter().for_each(Proxy::pass);
        }
    }
    proxies.iter().for_each(Proxy::pass);
    for station in &stations {
        station.waits_for("an empty hot folder", |station| {
            fs::read_dir(station.path("hot")).unwrap().next().is_none()
        });
        let outbox = || {
            let files = fs::read_dir(station.path("state/fleet/outbox")).into_iter().flatten();
            files.map(|file| file.unwrap().file_name()).collect::<Vec<_>>()
        };
        waits_for("an empty outbox", || outbox().is_empty(), || format!("{:?}, {}", outbox(), station.log()));
    }
    for sku in SKUS {
        let key = sku.to_lowercase();
        let versions = server.sql(
            "isomark",
            &format!("SELECT blake3 FROM isomark.part_version WHERE sku = '{key}' ORDER BY version"),
        );
        let versions: Vec<&str> = versions.lines().collect();
        let numbers = format!(
            "SELECT count(*) = coalesce(max(version), 0) FROM isomark.part_version WHERE sku = '{key}'"
        );
        assert_eq!(server.sql("isomark", &numbers), "t", "{sku}: a version is missing");
        for version in &versions {
            let (_, dropped) = drops[*version];
            assert_eq!(SKUS[dropped], sku, "a part of another SKU");
        }
        // Learned in the order of the versions, by the clock of the server.
        let order = format!(
            "SELECT count(*) FROM isomark.part_version a, isomark.part_version b WHERE a.sku = '{key}' AND b.sku = a.sku \
             AND a.version < b.version AND a.learned > b.learned"
        );
        assert_eq!(server.sql("isomark", &order), "0", "{sku}");
        let Some(last) = versions.last() else { continue };
        for station in &stations {
            waits_for(sku, || current(station, &key) == *last, || station.log());
        }
        // Each part was announced: it has a version, or its station gave way to a later one.
        for ((station, dropped), part) in &last_drop {
            if SKUS[*dropped] == sku && !versions.contains(&part.as_str()) {
                let gave_way = stations[*station].logged(&format!("is not the part of {sku} any more"));
                assert!(gave_way > 0, "{part}: {}", stations[*station].log());
            }
        }
    }
    let [one, two, servers, cuts] = counts;
    println!("{} parts, {} stations and {servers} servers killed, {cuts} cuts", drops.len(), one + two);
}
