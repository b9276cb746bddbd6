//! Every sample in `watch-config/` is valid, and the annotated station shows the defaults.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may fail loudly, its helpers too")]

use std::path::{Path, PathBuf};

use isomark::config::{DeliverySettings, JobSettings, Sku, Station, Watch};

fn samples(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let entries = fs_err::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let samples: Vec<_> = entries.filter(|path| path.extension().is_some_and(|end| end == "toml")).collect();
    assert!(!samples.is_empty());
    samples
}

#[test]
fn every_sample_loads() {
    for file in samples("watch-config") {
        Station::load(&file).unwrap_or_else(|error| panic!("{error}"));
    }
    for file in samples("watch-config/skus") {
        let stem = file.file_stem().unwrap().to_str().unwrap();
        stem.parse::<Sku>().unwrap();
        let text = fs_err::read_to_string(&file).unwrap();
        let settings = JobSettings::default().overridden_by(&file, &text);
        assert_ne!(settings.unwrap_or_else(|error| panic!("{error}")), JobSettings::default());
    }
}

#[test]
fn the_annotated_station_shows_the_defaults() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("watch-config/station.toml");
    let station = Station::load(&file).unwrap();
    let mut expected = JobSettings::default();
    expected.field = station.settings.field;
    assert_eq!(station.settings, expected);
    assert_eq!(station.watch, Watch::default());
    assert_eq!(station.delivery, DeliverySettings::default());
    assert_eq!(station.folders.skus, file.with_file_name("skus"));
}

/// Choosing another value for one key must not leave another key at a value that is no default any more.
#[test]
fn the_annotated_station_with_polling_shows_its_defaults() {
    let text =
        fs_err::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("watch-config/station.toml"))
            .unwrap();
    let polling = text.replace("backend = \"auto\" ", "backend = \"poll\" ");
    assert_ne!(text, polling);
    let folder = tempfile::tempdir().unwrap();
    let [annotated, bare] = ["annotated.toml", "bare.toml"].map(|name| folder.path().join(name));
    fs_err::write(&annotated, polling).unwrap();
    let least = "[station]\nname = \"x\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 110\nheight_mm = 110\n";
    fs_err::write(&bare, format!("{least}[watch]\nbackend = \"poll\"\n")).unwrap();
    assert_eq!(Station::load(&annotated).unwrap().watch, Station::load(&bare).unwrap().watch);
}
