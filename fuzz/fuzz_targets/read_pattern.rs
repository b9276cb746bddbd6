//! Any bytes as a drawing are read or rejected with a reason, and all coordinates are finite.

#![no_main]

use isomark::formats::pattern::{PatternOptions, is_complete, read};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let _ = is_complete(bytes);
    for strict in [false, true] {
        match read(bytes, &PatternOptions::default().strictly(strict)) {
            Ok(reading) => {
                assert!(!reading.pattern.paths.is_empty());
                assert!(reading.facts.extents.iter().all(|edge| edge.is_finite()));
                for path in &reading.pattern.paths {
                    assert!(path.layer < reading.pattern.layers.len());
                    let points = path.shape.flattened(0.01);
                    assert!(points.iter().all(|point| point.x.is_finite() && point.y.is_finite()));
                }
            }
            Err(error) => assert!(!error.reason().remedy.is_empty()),
        }
    }
});
