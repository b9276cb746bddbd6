//! Several stations that share a cache of fitted surfaces, and very many drops at once.

use std::io::Write;
use std::time::{Duration, Instant};

use fs_err as fs;

use super::{SETTINGS, Station, drawing, line};

const SKUS: usize = 12;

fn part(sku: usize) -> String {
    let depth = 1.0 + sku as f64 * 0.1;
    format!(
        "v -20 -20 {depth}\nv 0 -20 0\nv 20 -20 {depth}\nv -20 20 {depth}\nv 0 20 0\nv 20 20 {depth}\nf 1 2 5 4\nf 2 3 6 5\n"
    )
}

fn pattern() -> String {
    drawing(&line([-15.0, 0.0], [15.0, 4.0]))
}

/// Both stations fit the same parts at the same time and keep them under the same names. A part that was dropped at
/// only one of them is known to the other, too.
#[test]
fn stations_share_a_cache() {
    let mut stations = [Station::new(), Station::new()];
    let cache = stations[0].path("cache");
    for station in &mut stations {
        let folder = format!("[folders]\ncache = '{}'\n", cache.display());
        let settings = SETTINGS
            .replace("[folders]\n", &folder)
            .replace("settle_ms = 20000", "settle_ms = 100\nopen_ended_s = 1");
        fs::write(station.path("station.toml"), settings).unwrap();
        let mut command = station.command(&["watch", "station.toml"]);
        station.start(&mut command);
    }
    for sku in 0..SKUS {
        for station in &stations {
            station.rename_into(&format!("trough{sku}.obj"), part(sku).as_bytes());
            station.rename_into(&format!("trough{sku}.dxf"), pattern().as_bytes());
        }
    }
    stations[0].rename_into("only.obj", part(0).as_bytes());
    stations[1].rename_into("only.dxf", pattern().as_bytes());
    let alone = Station::new();
    fs::write(alone.path("hot/only.obj"), part(0)).unwrap();
    fs::write(alone.path("hot/only.dxf"), pattern()).unwrap();
    for sku in 0..SKUS {
        fs::write(alone.path(&format!("hot/trough{sku}.obj")), part(sku)).unwrap();
        fs::write(alone.path(&format!("hot/trough{sku}.dxf")), pattern()).unwrap();
    }
    alone.once();
    let expected = |name: &str| fs::read(alone.path("import").join(name)).unwrap();
    for station in &mut stations {
        for sku in 0..SKUS {
            let name = format!("trough{sku}.dxf");
            station.waits_for(&name, |station| station.path("import").join(&name).exists());
            assert!(fs::read(station.path("import").join(&name)).unwrap() == expected(&name), "{name}");
        }
    }
    let other = &mut stations[1];
    other.waits_for("only.dxf", |station| station.path("import/only.dxf").exists());
    assert!(fs::read(other.path("import/only.dxf")).unwrap() == expected("only.dxf"));
    assert_eq!(fs::read_dir(other.path("rejected")).unwrap().count(), 0);
    let verified = other.command(&["cache", "verify", "--station", "station.toml"]).status().unwrap();
    assert!(verified.success());
}

/// The part that was dropped last at any station is the part of the SKU at all stations. A station with other settings
/// for the part has only the older part in its archive, and must not fit that one again.
#[test]
fn no_station_returns_to_an_older_part_of_a_shared_sku() {
    let stations = [Station::new(), Station::new()];
    let cache = stations[0].path("cache");
    for (station, more) in stations.iter().zip(["", "[part]\nroll_deg = 90\n"]) {
        let folder = format!("[folders]\ncache = '{}'\n", cache.display());
        let settings = SETTINGS.replace("[folders]\n", &folder) + more;
        fs::write(station.path("station.toml"), settings).unwrap();
        fs::write(station.path("hot/trough.obj"), part(1)).unwrap();
        assert!(station.once().contains("1 part fitted"));
    }
    let [one, other] = &stations;
    fs::write(one.path("hot/trough.obj"), part(9)).unwrap();
    assert!(one.once().contains("1 part fitted"));
    fs::write(other.path("hot/trough@b.dxf"), pattern()).unwrap();
    assert!(other.once().contains("0 delivered, 0 parts fitted, 0 rejected, 1 waiting"));
    fs::write(one.path("hot/trough@a.dxf"), pattern()).unwrap();
    assert!(one.once().starts_with("1 delivered"));
    let alone = Station::new();
    fs::write(alone.path("hot/trough.obj"), part(9)).unwrap();
    fs::write(alone.path("hot/trough@a.dxf"), pattern()).unwrap();
    alone.once();
    let drawing = |station: &Station| fs::read(station.path("import/trough@a.dxf")).unwrap();
    assert!(drawing(one) == drawing(&alone));
    fs::write(other.path("hot/trough.obj"), part(9)).unwrap();
    assert!(other.once().starts_with("1 delivered, 1 part fitted"));
}

#[test]
#[ignore = "takes minutes: `cargo test --release --test station_hardships -- --ignored` prints the speed"]
fn ten_thousand_drops_at_once() {
    const DROPS: usize = 10_000;
    let mut station = Station::new();
    fs::write(station.path("station.toml"), SETTINGS.replace("rescan_s = 0.2\n", "")).unwrap();
    let mut command = station.command(&["watch", "station.toml"]);
    station.start(&mut command);
    for sku in 0..SKUS {
        station.rename_into(&format!("trough{sku}.obj"), part(sku).as_bytes());
    }
    fs::create_dir(station.path("outside")).unwrap();
    let name = |number: usize| format!("trough{}@{number}.dxf", number % SKUS);
    for number in 0..DROPS {
        fs::write(station.path("outside").join(name(number)), pattern()).unwrap();
    }
    let started = Instant::now();
    for number in 0..DROPS {
        fs::rename(station.path("outside").join(name(number)), station.path("hot").join(name(number)))
            .unwrap();
    }
    let count = |folder: &str| fs::read_dir(station.path(folder)).unwrap().count();
    while count("hot") > 0 {
        assert!(started.elapsed() < Duration::from_secs(3600), "{} are left", count("hot"));
        std::thread::sleep(Duration::from_millis(200));
    }
    let seconds = started.elapsed().as_secs_f64();
    assert_eq!((count("import"), count("rejected")), (DROPS, 0));
    let archived: usize = (0..SKUS).map(|sku| count(&format!("archive/trough{sku}"))).sum();
    assert_eq!(archived, DROPS + 2 * SKUS, "with a part and its note for each SKU");
    let result = format!("{DROPS} drops in {seconds:.1} s: {:.0} per second\n", DROPS as f64 / seconds);
    std::io::stderr().write_all(result.as_bytes()).unwrap();
}
