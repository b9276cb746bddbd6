//! Any bytes as a part in STEP are read or rejected with a reason, and all sizes are finite.

#![no_main]

use isomark::formats::mesh::{MeshFormat, MeshOptions, read};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    match read(bytes, MeshFormat::Step, &MeshOptions::default(), &std::collections::BTreeMap::new()) {
        Ok(reading) => assert!(reading.facts.size.iter().all(|side| side.is_finite())),
        Err(error) => assert!(!error.reason().remedy.is_empty()),
    }
});
