//! Properties of all drawings: a written drawing is read back unchanged, and no input makes the reader panic.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic")]

use isomark::formats::pattern::{DxfProfile, PatternOptions, is_complete, read, write};
use isomark::geometry::marking::{MarkingDrawing, MarkingPath, MarkingShape};
use isomark::geometry::pattern::{Color, Layer, Shape};
use isomark::geometry::space::FieldPoint;
use proptest::prelude::*;

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(format!("{}/tests/data/patterns/{name}.dxf", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn color() -> impl Strategy<Value = Color> {
    prop_oneof![
        Just(Color::ByLayer),
        (1..=255u8).prop_map(Color::Aci),
        (1..=255u8, any::<[u8; 3]>()).prop_map(|(aci, rgb)| Color::Rgb { aci, rgb }),
    ]
}

fn points(least: usize) -> impl Strategy<Value = Vec<FieldPoint>> {
    let point = (-500.0..500.0f64, -500.0..500.0f64).prop_map(|(x, y)| FieldPoint::new(x, y));
    proptest::collection::vec(point, least..20)
}

fn shape() -> impl Strategy<Value = MarkingShape> {
    prop_oneof![
        points(1).prop_map(|points| MarkingShape::Dot(points[0])),
        points(2).prop_map(MarkingShape::Open),
        points(3).prop_map(MarkingShape::Closed),
    ]
}

fn drawing() -> impl Strategy<Value = MarkingDrawing> {
    let layers =
        proptest::collection::btree_map("[A-Za-zäöüß日本 _-]{1,12}[a-z]", color(), 1..4).prop_map(|layers| {
            let mut seen = std::collections::BTreeSet::new();
            layers
                .into_iter()
                .map(|(name, color)| (name.trim().to_owned(), color))
                .filter(|(name, _)| seen.insert(name.to_uppercase()))
                .map(|(name, color)| Layer {
                    name,
                    color: if color == Color::ByLayer { Color::Aci(7) } else { color },
                })
                .collect::<Vec<_>>()
        });
    let paths = proptest::collection::vec((any::<proptest::sample::Index>(), color(), shape()), 1..8);
    (layers, paths, "[ -~äΩ]{0,300}").prop_map(|(layers, paths, comment)| MarkingDrawing {
        paths: paths
            .into_iter()
            .map(|(layer, color, shape)| MarkingPath { layer: layer.index(layers.len()), color, shape })
            .collect(),
        layers,
        comments: vec![comment],
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn written_drawings_are_read_back(drawing in drawing()) {
        // A repair would join paths that meet by chance.
        let options = PatternOptions::default().strictly(true);
        for profile in [DxfProfile::R2000, DxfProfile::R12] {
            let file = write(&drawing, profile);
            prop_assert!(is_complete(&file));
            prop_assert!(std::str::from_utf8(&file).is_ok_and(str::is_ascii));
            let reading = read(&file, &options).unwrap();
            prop_assert!(reading.facts.skipped.is_empty());
            prop_assert_eq!(reading.pattern.paths.len(), drawing.paths.len());
            for (found, meant) in reading.pattern.paths.iter().zip(&drawing.paths) {
                let vertices = found.shape.flattened(1e-3);
                prop_assert_eq!(vertices.len(), meant.shape.points().len());
                let off = vertices.iter().zip(meant.shape.points()).map(|(a, b)| (a.x - b.x).hypot(a.y - b.y));
                prop_assert!(off.fold(0.0, f64::max) < 1e-6);
                let same_kind = matches!(
                    (&found.shape, &meant.shape),
                    (Shape::Dot(_), MarkingShape::Dot(_))
                        | (Shape::Open(_), MarkingShape::Open(_))
                        | (Shape::Closed(_), MarkingShape::Closed(_))
                );
                prop_assert!(same_kind);
                if profile == DxfProfile::R2000 {
                    prop_assert_eq!(found.color, meant.color);
                    let (layer, expected) = (&reading.pattern.layers[found.layer], &drawing.layers[meant.layer]);
                    prop_assert_eq!(layer, expected);
                }
            }
        }
    }

    #[test]
    fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        for head in [&b""[..], b"0\nSECTION\n", b"AutoCAD Binary DXF\r\n\x1a\0\0\0SECTION\0"] {
            let _ = read(&[head, &bytes].concat(), &PatternOptions::default());
        }
    }

    #[test]
    fn any_groups_of_entities_are_read_or_refused(
        groups in proptest::collection::vec((
            prop_oneof![Just(0), Just(1), 8..80i32, Just(92), Just(93), Just(95), Just(96), Just(97), Just(210), Just(230)],
            prop_oneof![
                Just("0".to_owned()), Just("1".to_owned()), Just("-1".to_owned()), Just("1e300".to_owned()),
                "[\\\\{};%^a-zA-Z0-9/ .,]{0,20}", (-9..9i32).prop_map(|n| n.to_string()), (-1e3..1e3f64).prop_map(|n| n.to_string()),
            ],
        ), 1..60),
        kind in proptest::sample::select(vec![
            "LINE", "LWPOLYLINE", "POLYLINE", "VERTEX", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "POINT", "SOLID", "TRACE",
            "HATCH", "MPOLYGON", "INSERT", "DIMENSION", "TEXT", "MTEXT", "ATTRIB", "ATTDEF", "HELIX",
        ]),
    ) {
        let body: String = groups.iter().map(|(code, value)| {
            format!("{code}\n{}\n", if *code == 0 { kind } else { value })
        }).collect();
        let file = format!(
            "0\nSECTION\n2\nBLOCKS\n0\nBLOCK\n2\n1\n0\n{kind}\n{body}0\nENDBLK\n0\nENDSEC\n\
             0\nSECTION\n2\nENTITIES\n0\n{kind}\n{body}0\nINSERT\n2\n1\n0\nENDSEC\n0\nEOF\n"
        );
        if let Ok(reading) = read(file.as_bytes(), &PatternOptions::default()) {
            prop_assert!(reading.facts.size.iter().all(|size| size.is_finite()));
            let points = reading.pattern.paths.iter().flat_map(|path| path.shape.segments());
            prop_assert!(points.flat_map(|s| [s.start(), s.end()]).all(|point| point.is_finite()));
        }
    }
}

/// A small random generator with a fixed seed (Marsaglia's xorshift), so that every run has the same files.
struct Dice(u64);

impl Dice {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % limit as u64) as usize
    }
}

#[test]
fn damaged_samples_are_read_or_refused() {
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    for name in ["fc020-draft-legacy-lw", "fc020-sketch-legacy", "ez-layers-colors-binary", "ink12-logo-r14"]
    {
        let whole = bytes(name);
        for _ in 0..150 {
            let mut file = whole.clone();
            for _ in 0..=dice.below(4) {
                // The entities are in the last part of a file.
                let tail = dice.below(file.len().min(12_000));
                let at = file.len() - 1 - tail;
                match dice.below(4) {
                    0 => file[at] = dice.below(256) as u8,
                    1 => file[at] = b"0123456789-.e\n"[dice.below(14)],
                    2 => drop(file.drain(at..(at + 1 + dice.below(40)).min(file.len()))),
                    _ => {
                        let piece = file[at..(at + 1 + dice.below(200)).min(file.len())].to_vec();
                        file.splice(at..at, piece);
                    }
                }
            }
            if let Err(error) = read(&file, &PatternOptions::default()) {
                assert!(!error.reason().what.is_empty());
            }
        }
    }
}
