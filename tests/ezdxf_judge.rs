//! Independent readers judge what isomark writes: ezdxf must load it strictly, find nothing to repair, and see the same
//! drawing, and so must the dxf crate.

#![allow(clippy::unwrap_used, reason = "helpers of tests may panic")]

use dxf::entities::EntityType;
use isomark::formats::pattern::{DxfProfile, write};
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
fn r12_lines_are_clean_and_go_all_the_way_round() {
    let Some(told) = judged(&write(&sample(), DxfProfile::R12Lines)) else { return };
    assert_clean(&told);
    assert_eq!((&told["version"], &told["header_box"]), (&"AC1009".into(), &told["box"]));
    let pieces: Vec<_> = told["entities"]
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

/// Kind, layer, colour index, points and closure of an entity, as the dxf crate reads them.
type Seen = (&'static str, String, Option<u8>, Vec<[f64; 2]>, bool);

fn seen_by_dxf(file: &[u8]) -> Vec<Seen> {
    let drawing = dxf::Drawing::load(&mut std::io::Cursor::new(file)).unwrap();
    let seen = drawing.entities().map(|entity| {
        let (kind, points, closed) = match &entity.specific {
            EntityType::LwPolyline(line) => {
                ("LWPOLYLINE", line.vertices.iter().map(|v| [v.x, v.y]).collect(), line.flags & 1 == 1)
            }
            EntityType::Polyline(line) => (
                "POLYLINE",
                line.vertices().map(|v| [v.location.x, v.location.y]).collect(),
                line.flags & 1 == 1,
            ),
            EntityType::Line(line) => ("LINE", vec![[line.p1.x, line.p1.y], [line.p2.x, line.p2.y]], false),
            EntityType::ModelPoint(point) => ("POINT", vec![[point.location.x, point.location.y]], false),
            _ => ("something else", Vec::new(), false),
        };
        (kind, entity.common.layer.clone(), entity.common.color.index(), points, closed)
    });
    seen.collect()
}

#[test]
fn the_dxf_crate_reads_the_same() {
    let contour = vec![[0.0, 0.0], [30.0, 0.0], [30.0, -12.5]];
    let line = vec![[1.0, 1.0], [2.0, 1.25]];
    let dot = ("POINT", "0".to_owned(), Some(3), vec![[-4.0, 2.333333]], false);
    let drawn = |kind, layer: &str| {
        let of = |layer: &str, color, points: &Vec<[f64; 2]>, closed| {
            (kind, layer.to_owned(), color, points.clone(), closed)
        };
        vec![of("MARK", None, &contour, true), of(layer, Some(5), &line, false), dot.clone()]
    };
    let r2000 = seen_by_dxf(&write(&sample(), DxfProfile::R2000));
    assert_eq!(r2000, drawn("LWPOLYLINE", "Größe 日本_x"));
    let r12 = seen_by_dxf(&write(&sample(), DxfProfile::R12));
    assert_eq!(r12, drawn("POLYLINE", "Gr__e____x"));
    let lines = seen_by_dxf(&write(&sample(), DxfProfile::R12Lines));
    assert_eq!(lines.len(), 5);
    assert_eq!(lines[2].3, [[30.0, -12.5], [0.0, 0.0]]);
}

#[test]
fn an_empty_drawing_is_clean_too() {
    for profile in [DxfProfile::R2000, DxfProfile::R12, DxfProfile::R12Lines] {
        let Some(told) = judged(&write(&MarkingDrawing::default(), profile)) else { return };
        assert_clean(&told);
        assert_eq!(told["entities"], serde_json::json!([]));
    }
}

#[test]
fn the_same_drawing_gives_the_same_bytes() {
    for profile in [DxfProfile::R2000, DxfProfile::R12, DxfProfile::R12Lines] {
        assert_eq!(write(&sample(), profile), write(&sample(), profile));
    }
}
