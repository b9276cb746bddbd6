//! Any text as an SVG drawing is read or rejected with a reason, with strokes as lines and as bands.

#![no_main]

use isomark::formats::pattern::{PatternOptions, Strokes, is_complete, read};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    // Every input begins as SVG does, so that the other readers are not tried.
    let bytes = [b"<svg", bytes].concat();
    let _ = is_complete(&bytes);
    for strokes in [Strokes::Center, Strokes::Band] {
        match read(&bytes, &PatternOptions::default().with_strokes(strokes)) {
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
