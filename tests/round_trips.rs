//! Drawings are corrected for a plane, where nothing has to be bent, and ezdxf measures original and result: lengths,
//! areas and extents by layer and colour.
//!
//! `tests/ezdxf/original.py` resolves and measures drawings with ezdxf alone. Some drawings are excluded: those that
//! ezdxf rejects or reads incorrectly, that extend beyond any part, whose texts it would set in another font, or
//! whose wide lines it measures along their centre. `tests/patterns.rs` has their sizes.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use isomark::config::{JobSettings, Method, Sku};
use isomark::formats::mesh::PartFile;
use isomark::pipeline::{PatternInput, Pipeline};
use serde::Deserialize;

mod ezdxf;

/// A plane of 600 x 600 mm.
const PLANE: &str = "v -300 -300 0\nv 300 -300 0\nv 300 300 0\nv -300 300 0\nf 1 2 3\nf 1 3 4\n";
/// Chord tolerance of the results, mm.
const TOLERANCE: f64 = 1e-3;

const SAMPLES: [&str; 24] = [
    "abc",
    "circle",
    "ez-guilloche",
    "ez-hatch-islands",
    "ez-layers-colors",
    "ez-layers-colors-binary",
    "ez-logo-inch",
    "ez-logo-mm",
    "ez-logo-unitless",
    "ez-qr-hatch",
    "fc020-draft-cpp-r14",
    "fc020-draft-cpp-r14-poly",
    "fc020-sketch-cpp-r14",
    "fc020-sketch-cpp-r14-poly",
    "fc020-sketch-legacy",
    "fc020-text-cpp-r12",
    "fc020-text-cpp-r14",
    "fc020-text-legacy",
    "fc020-text-legacy-lw",
    "fc020-tilted-cpp-r14",
    "grid",
    "ink12-logo-r14",
    "ink12-logo_px-r14",
    "square",
];

/// The measurements of everything drawn on a layer in a colour, mm.
#[derive(Debug, Clone, Deserialize)]
struct Drawn {
    length: f64,
    area: f64,
    #[serde(rename = "box")]
    extents: [f64; 4],
}

type Measured = BTreeMap<String, Drawn>;

fn measured(files: &[PathBuf]) -> Vec<Option<Measured>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let script = root.join("tests/ezdxf/original.py");
    let output = Command::new("python3").arg(script).arg(root.join("fonts")).args(files).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let lines = String::from_utf8(output.stdout).unwrap();
    lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// The corrected drawings, written into `folder`.
fn corrected(files: &[PathBuf], folder: &Path) -> Vec<PathBuf> {
    let mut settings = JobSettings::default();
    settings.correction.method = Method::None;
    settings.correction.tolerance = TOLERANCE;
    let sku: Sku = "plane".parse().unwrap();
    let pipeline = Pipeline::new(None);
    let learned = pipeline.learn(&sku, &PartFile::alone("plane.obj", PLANE), &settings.part).unwrap();
    let correct = |file: &PathBuf| {
        let bytes = std::fs::read(file).unwrap();
        let name = file.file_name().unwrap().to_str().unwrap();
        let input = PatternInput { name, bytes: &bytes, previous: None };
        let result = pipeline.correct(&sku, &learned, input, &settings, false);
        let out = folder.join(format!("out-{name}"));
        std::fs::write(&out, result.unwrap_or_else(|error| panic!("{name}: {error}")).dxf).unwrap();
        out
    };
    files.iter().map(correct).collect()
}

/// Compares original and result in mm; the unit of the original is `unit` mm. `leeway` gives additional tolerances
/// for lengths (a share) and extents (mm).
fn compare(
    name: &str,
    unit: f64,
    original: &Measured,
    result: &Measured,
    leeway: impl Fn(&str) -> (f64, f64),
) {
    let keys = |measured: &Measured| measured.keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(original), keys(result), "{name}: layers and colours");
    for (key, expected) in original {
        let found = &result[key];
        let (share, shift) = leeway(key);
        let close = |found: f64, expected: f64, slack: f64| (found - expected).abs() <= slack;
        // Chords within the tolerance are shorter than their arcs by less than 0.1 % and change areas by less than the
        // tolerance times the length; joined ends may move by the joining tolerance.
        let length = expected.length * unit;
        assert!(
            close(found.length, length, 0.02 + (1e-3 + share) * length),
            "{name}, {key}: length {} is not {length}",
            found.length
        );
        let area = expected.area * unit * unit;
        assert!(
            close(found.area, area, 0.01 + TOLERANCE * length + 2.0 * share * area),
            "{name}, {key}: area {} is not {area}",
            found.area
        );
        for (found, expected) in found.extents.iter().zip(expected.extents) {
            let expected = expected * unit;
            assert!(close(*found, expected, 5e-3 + shift), "{name}, {key}: {found} is not {expected}");
        }
    }
}

/// Sets all areas to 0, for drawings in which ezdxf has separate pieces and isomark a contour.
fn without_areas(measured: Measured) -> Measured {
    measured.into_iter().map(|(key, drawn)| (key, Drawn { area: 0.0, ..drawn })).collect()
}

#[test]
fn real_drawings_are_unchanged_on_a_plane() {
    if !ezdxf::is_available() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/patterns");
    let originals: Vec<PathBuf> = SAMPLES.iter().map(|name| data.join(format!("{name}.dxf"))).collect();
    let results = corrected(&originals, folder.path());
    for ((name, original), result) in SAMPLES.iter().zip(measured(&originals)).zip(measured(&results)) {
        let Some(original) = original else { panic!("ezdxf rejects {name}") };
        let unit = if *name == "ez-logo-inch" { 25.4 } else { 1.0 };
        // ezdxf does not join loose pieces into contours.
        compare(name, unit, &without_areas(original), &without_areas(result.unwrap()), |_| (0.0, 0.0));
    }
}

#[test]
fn every_kind_of_entity_is_unchanged_on_a_plane() {
    if !ezdxf::is_available() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/ezdxf/samples.py");
    let created = Command::new("python3").arg(script).arg(folder.path()).output().unwrap();
    assert!(created.status.success(), "{}", String::from_utf8_lossy(&created.stderr));
    let mut originals: Vec<PathBuf> =
        std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
    originals.sort();
    assert!(originals.len() >= 6);
    let results = corrected(&originals, folder.path());
    for ((file, original), result) in originals.iter().zip(measured(&originals)).zip(measured(&results)) {
        let name = file.file_stem().unwrap().to_str().unwrap();
        let (mut original, mut result) = (original.unwrap(), result.unwrap());
        if name.starts_with("blocks") {
            // ezdxf explodes bulges in blocks that are scaled non-uniformly.
            (original, result) = (without_areas(original), without_areas(result));
        }
        // ezdxf aligns texts by the ink of their letters, isomark by their advance widths. The difference is the space
        // beside the first and the last letter, at most 0.15 of the height of 3 mm.
        compare(name, 1.0, &original, &result, |key| match key.split(' ').next() {
            Some("FIT" | "ALIGNED") => (0.04, 0.6),
            Some("CENTER" | "RIGHT" | "MIDDLE" | "MIDDLE_CENTER" | "TOP_RIGHT" | "BOTTOM_LEFT")
                if name == "text" || name.starts_with("attributes") =>
            {
                (0.0, 0.45)
            }
            _ => (0.0, 0.0),
        });
    }
}
