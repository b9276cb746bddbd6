//! An independent reader judges what isomark writes: ezdxf must load it strictly, find nothing to repair, and see the
//! same drawing.

#![allow(clippy::unwrap_used, reason = "helpers of tests may panic")]

use std::process::{Command, Stdio};

use isomark::formats::pattern::{DxfProfile, write};
use isomark::geometry::marking::{MarkingDrawing, MarkingPath, MarkingShape};
use isomark::geometry::pattern::{Color, Layer};
use isomark::geometry::space::FieldPoint;

const JUDGE: &str = r#"
import sys, io, json, tempfile, os
import ezdxf
from ezdxf import bbox
from ezdxf.lldxf.encoding import decode_dxf_unicode as text
path = sys.argv[1]
doc = ezdxf.readfile(path)
auditor = doc.audit()
box = bbox.extents(doc.modelspace(), fast=False)
def points(e):
    if e.dxftype() == 'POINT': return [list(e.dxf.location)[:2]]
    if e.dxftype() == 'LWPOLYLINE': return [[x, y] for x, y in e.get_points('xy')]
    return [list(v.dxf.location)[:2] for v in e.vertices]
print(json.dumps({
    'version': doc.dxfversion, 'units': doc.header.get('$INSUNITS', -1),
    'measurement': doc.header.get('$MEASUREMENT', -1),
    'errors': [e.message for e in auditor.errors], 'fixes': [e.message for e in auditor.fixes],
    'box': [box.extmin.x, box.extmin.y, box.extmax.x, box.extmax.y] if box.has_data else [],
    'header_box': list(doc.header['$EXTMIN'])[:2] + list(doc.header['$EXTMAX'])[:2],
    'layers': {text(l.dxf.name): [l.dxf.color, l.dxf.true_color if l.dxf.hasattr('true_color') else None] for l in doc.layers},
    'entities': [{'type': e.dxftype(), 'layer': text(e.dxf.layer), 'color': e.dxf.color,
        'true_color': e.dxf.true_color if e.dxf.hasattr('true_color') else None,
        'closed': bool(getattr(e, 'is_closed', getattr(e, 'closed', False))), 'points': points(e)}
        for e in doc.modelspace()],
}))
"#;

/// What ezdxf says about the file, or nothing when there is no ezdxf here.
fn judged(dxf: &[u8]) -> Option<serde_json::Value> {
    let has_ezdxf = Command::new("python3")
        .args(["-c", "import ezdxf"])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success());
    if !has_ezdxf {
        assert!(std::env::var("CI").is_err(), "python3 with ezdxf is required in CI");
        eprintln!("SKIPPED: python3 with ezdxf is not installed, the written files were not judged");
        return None;
    }
    let mut file = tempfile::Builder::new().suffix(".dxf").tempfile().unwrap();
    std::io::Write::write_all(&mut file, dxf).unwrap();
    let output = Command::new("python3").arg("-c").arg(JUDGE).arg(file.path()).output().unwrap();
    assert!(output.status.success(), "ezdxf refuses: {}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

fn points(coordinates: &[[f64; 2]]) -> Vec<FieldPoint> {
    coordinates.iter().map(|[x, y]| FieldPoint::new(*x, *y)).collect()
}

fn sample() -> MarkingDrawing {
    let layer = |name: &str, color| Layer { name: name.into(), color };
    let path = |layer, color, shape| MarkingPath { layer, color, shape };
    MarkingDrawing {
        layers: vec![
            layer("MARK", Color::Aci(1)),
            layer("Größe 日本|x", Color::Rgb { aci: 30, rgb: [255, 128, 0] }),
            layer("0", Color::Aci(7)),
        ],
        paths: vec![
            path(0, Color::ByLayer, MarkingShape::Closed(points(&[[0.0, 0.0], [30.0, 0.0], [30.0, -12.5]]))),
            path(
                1,
                Color::Rgb { aci: 5, rgb: [1, 2, 253] },
                MarkingShape::Open(points(&[[1.0, 1.0], [2.0, 1.25]])),
            ),
            path(2, Color::Aci(3), MarkingShape::Dot(FieldPoint::new(-4.0, 7.0 / 3.0))),
        ],
        comments: vec!["isomark 0.1.0".into(), "Ø 66 mm, a long line ".repeat(20)],
    }
}

fn assert_clean(told: &serde_json::Value) {
    assert_eq!(told["errors"], serde_json::json!([]));
    assert_eq!(told["fixes"], serde_json::json!([]));
}

#[test]
fn r2000_is_clean_and_says_the_same() {
    let Some(told) = judged(&write(&sample(), DxfProfile::R2000)) else { return };
    assert_clean(&told);
    assert_eq!(
        (&told["version"], &told["units"], &told["measurement"]),
        (&"AC1015".into(), &4.into(), &1.into())
    );
    assert_eq!(told["box"], serde_json::json!([-4.0, -12.5, 30.0, 2.333333]));
    assert_eq!(told["header_box"], told["box"]);
    assert_eq!(told["layers"]["MARK"], serde_json::json!([1, null]));
    assert_eq!(told["layers"]["Größe 日本_x"], serde_json::json!([30, 0xFF8000]));
    let expected = serde_json::json!([
        {"type": "LWPOLYLINE", "layer": "MARK", "color": 256, "true_color": null, "closed": true,
         "points": [[0.0, 0.0], [30.0, 0.0], [30.0, -12.5]]},
        {"type": "LWPOLYLINE", "layer": "Größe 日本_x", "color": 5, "true_color": 0x0102FD, "closed": false,
         "points": [[1.0, 1.0], [2.0, 1.25]]},
        {"type": "POINT", "layer": "0", "color": 3, "true_color": null, "closed": false, "points": [[-4.0, 2.333333]]},
    ]);
    assert_eq!(told["entities"], expected);
}

#[test]
fn r12_is_clean_and_says_the_same_without_true_colours() {
    let Some(told) = judged(&write(&sample(), DxfProfile::R12)) else { return };
    assert_clean(&told);
    assert_eq!(told["version"], "AC1009");
    assert_eq!(told["box"], serde_json::json!([-4.0, -12.5, 30.0, 2.333333]));
    assert_eq!(told["layers"]["Gr__e____x"], serde_json::json!([30, null]));
    let kinds: Vec<_> = told["entities"].as_array().unwrap().iter().map(|entity| &entity["type"]).collect();
    assert_eq!(kinds, ["POLYLINE", "POLYLINE", "POINT"]);
    assert_eq!(told["entities"][0]["closed"], true);
    assert_eq!(told["entities"][1]["color"], 5);
    assert_eq!(told["entities"][1]["points"], serde_json::json!([[1.0, 1.0], [2.0, 1.25]]));
}

#[test]
fn an_empty_drawing_is_clean_too() {
    for profile in [DxfProfile::R2000, DxfProfile::R12] {
        let Some(told) = judged(&write(&MarkingDrawing::default(), profile)) else { return };
        assert_clean(&told);
        assert_eq!(told["entities"], serde_json::json!([]));
    }
}

#[test]
fn the_same_drawing_gives_the_same_bytes() {
    for profile in [DxfProfile::R2000, DxfProfile::R12] {
        assert_eq!(write(&sample(), profile), write(&sample(), profile));
    }
}
