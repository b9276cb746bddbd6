//! Any bytes as a part in 3MF or PLY are read or rejected with a reason, and all sizes are finite.

#![no_main]

use isomark::formats::mesh::{MeshFormat, MeshOptions, read};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    for format in [MeshFormat::ThreeMf, MeshFormat::Ply] {
        match read(bytes, format, &MeshOptions::default(), &std::collections::BTreeMap::new()) {
            Ok(reading) => assert!(reading.facts.size.iter().all(|side| side.is_finite())),
            Err(error) => assert!(!error.reason().remedy.is_empty()),
        }
    }
});
