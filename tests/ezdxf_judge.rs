//! Independent readers check the drawings that isomark writes: ezdxf must load them without errors or repairs and find
//! the same content, and so must the dxf crate.

#![allow(clippy::unwrap_used, reason = "helpers of tests may panic")]

use isomark::formats::pattern::{DxfProfile, read_back, write};
use isomark::geometry::marking::{MarkingDrawing, MarkingPath, MarkingShape};
use isomark::geometry::pattern::{Color, Layer};
use isomark::geometry::space::FieldPoint;

use ezdxf::{assert_clean, judged};

mod ezdxf;

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

#[test]
fn r2000_is_valid_and_has_the_same_content() {
    let Some(report) = judged(&write(&sample(), DxfProfile::R2000)) else { return };
    assert_clean(&report);
    assert_eq!(
        (&report["version"], &report["units"], &report["measurement"]),
        (&"AC1015".into(), &4.into(), &1.into())
    );
    assert_eq!(report["box"], serde_json::json!([-4.0, -12.5, 30.0, 2.333333]));
    assert_eq!(report["header_box"], report["box"]);
    assert_eq!(report["layers"]["MARK"], serde_json::json!([1, null]));
    assert_eq!(report["layers"]["Größe 日本_x"], serde_json::json!([30, 0xFF8000]));
    let expected = serde_json::json!([
        {"type": "LWPOLYLINE", "layer": "MARK", "color": 256, "true_color": null, "closed": true,
         "points": [[0.0, 0.0], [30.0, 0.0], [30.0, -12.5]]},
        {"type": "LWPOLYLINE", "layer": "Größe 日本_x", "color": 5, "true_color": 0x0102FD, "closed": false,
         "points": [[1.0, 1.0], [2.0, 1.25]]},
        {"type": "POINT", "layer": "0", "color": 3, "true_color": null, "closed": false, "points": [[-4.0, 2.333333]]},
    ]);
    assert_eq!(report["entities"], expected);
}

#[test]
fn r12_is_valid_and_has_the_same_content_without_true_colours() {
    let Some(report) = judged(&write(&sample(), DxfProfile::R12)) else { return };
    assert_clean(&report);
    assert_eq!(report["version"], "AC1009");
    assert_eq!(report["box"], serde_json::json!([-4.0, -12.5, 30.0, 2.333333]));
    assert_eq!(report["layers"]["Gr__e____x"], serde_json::json!([30, null]));
    let kinds: Vec<_> = report["entities"].as_array().unwrap().iter().map(|entity| &entity["type"]).collect();
    assert_eq!(kinds, ["POLYLINE", "POLYLINE", "POINT"]);
    assert_eq!(report["entities"][0]["closed"], true);
    assert_eq!(report["entities"][1]["color"], 5);
    assert_eq!(report["entities"][1]["points"], serde_json::json!([[1.0, 1.0], [2.0, 1.25]]));
}

#[test]
fn r12_lines_are_valid_and_close_contours() {
    let Some(report) = judged(&write(&sample(), DxfProfile::R12Lines)) else { return };
    assert_clean(&report);
    assert_eq!((&report["version"], &report["header_box"]), (&"AC1009".into(), &report["box"]));
    let pieces: Vec<_> = report["entities"]
        .as_array()
        .unwrap()
        .iter()
        .map(|e| (e["type"].clone(), e["points"].clone()))
        .collect();
    let line = |from: [f64; 2], to: [f64; 2]| ("LINE".into(), serde_json::json!([from, to]));
    let expected = [
        line([0.0, 0.0], [30.0, 0.0]),
        line([30.0, 0.0], [30.0, -12.5]),
        line([30.0, -12.5], [0.0, 0.0]),
        line([1.0, 1.0], [2.0, 1.25]),
        ("POINT".into(), serde_json::json!([[-4.0, 2.333333]])),
    ];
    assert_eq!(pieces, expected);
}

#[test]
fn the_dxf_crate_reads_the_same_content() {
    for profile in [DxfProfile::R2000, DxfProfile::R12, DxfProfile::R12Lines] {
        assert_eq!(read_back(&write(&sample(), profile), &sample(), profile), Ok(()), "{profile:?}");
    }
}

#[test]
fn an_empty_drawing_is_valid_too() {
    for profile in [DxfProfile::R2000, DxfProfile::R12, DxfProfile::R12Lines] {
        let Some(report) = judged(&write(&MarkingDrawing::default(), profile)) else { return };
        assert_clean(&report);
        assert_eq!(report["entities"], serde_json::json!([]));
    }
}

#[test]
fn the_same_drawing_gives_the_same_bytes() {
    for profile in [DxfProfile::R2000, DxfProfile::R12, DxfProfile::R12Lines] {
        assert_eq!(write(&sample(), profile), write(&sample(), profile));
    }
}
