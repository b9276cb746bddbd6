use proptest::prelude::*;

use super::*;
use crate::geometry::pattern::Layer;

const PROFILES: [DxfProfile; 3] = [DxfProfile::R2000, DxfProfile::R12, DxfProfile::R12Lines];

fn points(coordinates: &[[f64; 2]]) -> Vec<FieldPoint> {
    coordinates.iter().map(|[x, y]| FieldPoint::new(*x, *y)).collect()
}

/// A contour, a line, a dot and a contour of two points, on layers whose names are kept or changed.
fn sample() -> MarkingDrawing {
    let layer = |name: &str, color| Layer { name: name.into(), color };
    let path = |layer, color, shape| MarkingPath { layer, color, shape };
    MarkingDrawing {
        layers: vec![
            layer("MARK", Color::Aci(1)),
            layer("Größe 日本|x", Color::Rgb { aci: 30, rgb: [255, 128, 0] }),
            layer("0", Color::ByLayer),
            layer("größe 日本:x", Color::Aci(0)),
        ],
        paths: vec![
            path(0, Color::ByLayer, MarkingShape::Closed(points(&[[0.0, 0.0], [30.0, 0.0], [30.0, -12.5]]))),
            path(0, Color::Aci(2), MarkingShape::Open(Vec::new())),
            path(
                1,
                Color::Rgb { aci: 5, rgb: [1, 2, 253] },
                MarkingShape::Open(points(&[[1.0, 1.0], [2.0, 1.25], [3.5, 4.0 / 3.0]])),
            ),
            path(2, Color::Aci(3), MarkingShape::Dot(FieldPoint::new(-4.0, 7.0 / 3.0))),
            path(3, Color::Aci(0), MarkingShape::Closed(points(&[[1e-9, -1e-9], [1234.5, 1e6]]))),
            path(9, Color::Rgb { aci: 7, rgb: [0, 0, 0] }, MarkingShape::Closed(points(&[[5.0, 5.0]]))),
        ],
        comments: vec![
            "isomark 0.1.0".into(),
            "Ø 66 mm, \\U+00F6 a long line ".repeat(20),
            "  0\nEOF".into(),
        ],
    }
}

fn text(profile: DxfProfile) -> String {
    String::from_utf8(write(&sample(), profile)).unwrap()
}

/// The error for the sample's file after a text was replaced, at its first occurrence in the entities or else before
/// them.
fn after(profile: DxfProfile, old: &str, new: &str) -> ReadbackError {
    let text = text(profile);
    let (head, entities) = text.split_at(text.find("ENTITIES").unwrap());
    let altered = match entities.contains(old) {
        true => head.to_owned() + &entities.replacen(old, new, 1),
        false => head.replacen(old, new, 1) + entities,
    };
    assert_ne!(altered, text, "{old:?}");
    read_back(altered.as_bytes(), &sample(), profile).unwrap_err()
}

fn place(path: usize, layer: &str, vertex: Option<usize>) -> PathPlace {
    PathPlace { path, layer: layer.into(), vertex }
}

#[test]
fn written_drawings_are_read_back() {
    let long = "é".repeat(300);
    let names = [
        "",
        " ",
        "a b ",
        "\u{1f600}",
        "\u{1f601}",
        "A\\U+00F6B",
        "^M",
        &long,
        "*x",
        "\u{ffff}\u{7f}\t",
        "ß",
        "ẞ",
        "0",
    ];
    let named = MarkingDrawing {
        layers: names.iter().map(|name| Layer { name: (*name).into(), color: Color::Aci(9) }).collect(),
        paths: (0..names.len())
            .map(|layer| MarkingPath {
                layer,
                color: Color::ByLayer,
                shape: MarkingShape::Open(points(&[[0.0, 0.0], [layer as f64, 1.0]])),
            })
            .collect(),
        comments: Vec::new(),
    };
    for profile in PROFILES {
        for drawing in [sample(), named.clone(), MarkingDrawing::default()] {
            assert_eq!(read_back(&write(&drawing, profile), &drawing, profile), Ok(()), "{profile:?}");
        }
    }
}

#[test]
fn layers_with_unwritable_names_stay_different() {
    let layers: Vec<Layer> =
        ["\u{1f600}", "\u{1f601}"].map(|name| Layer { name: name.into(), color: Color::Aci(1) }).into();
    assert_eq!(plain_layer_names(&layers, DxfProfile::R2000), ["_", "__2"]);
}

/// Kind, layer, colour, points and closure of each entity, as the second reader finds them.
#[test]
fn the_second_reader_finds_the_entities_of_the_sample() {
    let contour = vec![[0.0, 0.0], [30.0, 0.0], [30.0, -12.5]];
    let line = vec![[1.0, 1.0], [2.0, 1.25], [3.5, 1.333333]];
    let long = vec![[0.0, 0.0], [1234.5, 1e6]];
    let drawn = |kind: &'static str, names: [&str; 2], rgb: &str| {
        [
            (kind, "MARK".to_owned(), "of the layer".to_owned(), contour.clone(), true),
            (kind, names[0].to_owned(), format!("5{rgb}"), line.clone(), false),
            ("POINT", "0".to_owned(), "3".to_owned(), vec![[-4.0, 2.333333]], false),
            (kind, names[1].to_owned(), "7".to_owned(), long.clone(), true),
            ("POINT", "0".to_owned(), "7".to_owned(), vec![[5.0, 5.0]], false),
        ]
    };
    let seen = |profile| {
        let read = second_reading(&write(&sample(), profile)).unwrap();
        let entities = read.entities().map(|entity| {
            let Found { kind, color, closed, points } = Found::of(entity);
            (kind, entity.common.layer.clone(), color, points, closed)
        });
        entities.collect::<Vec<_>>()
    };
    let names = ["Größe 日本_x", "größe 日本_x_2"];
    assert_eq!(seen(DxfProfile::R2000), drawn("LWPOLYLINE", names, " #0102fd"));
    assert_eq!(seen(DxfProfile::R12), drawn("POLYLINE", ["Gr__e____x", "gr__e____x_2"], ""));
    let lines = seen(DxfProfile::R12Lines);
    let pieces: Vec<_> = lines.iter().map(|(kind, _, _, points, _)| (*kind, points.clone())).collect();
    let piece = |from: [f64; 2], to: [f64; 2]| ("LINE", vec![from, to]);
    assert_eq!(
        pieces,
        [
            piece(contour[0], contour[1]),
            piece(contour[1], contour[2]),
            piece(contour[2], contour[0]),
            piece(line[0], line[1]),
            piece(line[1], line[2]),
            ("POINT", vec![[-4.0, 2.333333]]),
            piece(long[0], long[1]),
            piece(long[1], long[0]),
            ("POINT", vec![[5.0, 5.0]]),
        ]
    );
}

#[test]
fn each_single_change_of_the_file_is_found_with_its_place() {
    use PathDifference::{Closed, Color, Layer, Vertex};
    let differs = |path, difference| ReadbackError::Path { path, difference };
    let name = "Größe 日本_x";
    for (profile, old, new, expected) in [
        // A digit, the sign, the last decimal.
        (
            DxfProfile::R2000,
            " 20\r\n-12.5\r\n",
            " 20\r\n-13.5\r\n",
            differs(place(1, "MARK", Some(3)), Vertex { meant: [30.0, -12.5], found: [30.0, -13.5] }),
        ),
        (
            DxfProfile::R12,
            "VERTEX\r\n  8\r\nMARK\r\n 10\r\n30.0\r\n 20\r\n-12.5",
            "VERTEX\r\n  8\r\nMARK\r\n 10\r\n30.0\r\n 20\r\n12.5",
            differs(place(1, "MARK", Some(3)), Vertex { meant: [30.0, -12.5], found: [30.0, 12.5] }),
        ),
        (
            DxfProfile::R12Lines,
            " 11\r\n0.0\r\n 21\r\n0.0\r\n",
            " 11\r\n0.1\r\n 21\r\n0.0\r\n",
            differs(place(1, "MARK", Some(1)), Vertex { meant: [0.0, 0.0], found: [0.1, 0.0] }),
        ),
        (
            DxfProfile::R2000,
            " 20\r\n1.333333\r\n",
            " 20\r\n1.333334\r\n",
            differs(place(3, name, Some(3)), Vertex { meant: [3.5, 4.0 / 3.0], found: [3.5, 1.333334] }),
        ),
        (
            DxfProfile::R2000,
            "AcDbPoint\r\n 10\r\n-4.0",
            "AcDbPoint\r\n 10\r\n-4.5",
            differs(place(4, "0", Some(1)), Vertex { meant: [-4.0, 7.0 / 3.0], found: [-4.5, 2.333333] }),
        ),
        // A layer, a colour, a true colour, the closed flag, the unit.
        (
            DxfProfile::R2000,
            "AcDbEntity\r\n  8\r\nMARK",
            "AcDbEntity\r\n  8\r\nMARX",
            differs(place(1, "MARK", None), Layer { meant: "MARK".into(), found: "MARX".into() }),
        ),
        (
            DxfProfile::R12,
            "POINT\r\n  8\r\n0\r\n 62\r\n3",
            "POINT\r\n  8\r\n0\r\n 62\r\n2",
            differs(place(4, "0", None), Color { meant: "3".into(), found: "2".into() }),
        ),
        (
            DxfProfile::R2000,
            "420\r\n66301\r\n",
            "420\r\n66300\r\n",
            differs(place(3, name, None), Color { meant: "5 #0102fd".into(), found: "5 #0102fc".into() }),
        ),
        (
            DxfProfile::R2000,
            " 90\r\n3\r\n 70\r\n1\r\n",
            " 90\r\n3\r\n 70\r\n0\r\n",
            differs(place(1, "MARK", None), Closed { meant: true }),
        ),
        (
            DxfProfile::R12,
            " 66\r\n1\r\n 70\r\n0\r\n",
            " 66\r\n1\r\n 70\r\n1\r\n",
            differs(place(3, "Gr__e____x", None), Closed { meant: false }),
        ),
        (
            DxfProfile::R2000,
            "$INSUNITS\r\n 70\r\n4",
            "$INSUNITS\r\n 70\r\n1",
            ReadbackError::Unit { found: "Inches".into() },
        ),
    ] {
        assert_eq!(after(profile, old, new), expected, "{old:?}");
    }
}

#[test]
fn inserted_removed_and_cut_off_text_is_found_with_its_line() {
    /// The path and vertex of the line, and the intended and the found text.
    fn line(error: ReadbackError) -> (Option<(usize, Option<usize>)>, String, String) {
        let ReadbackError::Line { path, meant, found, .. } = error else { unreachable!("{error}") };
        (path.map(|place| (place.path, place.vertex)), meant, found)
    }
    let expect = |path, meant: &str, found: &str| (path, meant.to_owned(), found.to_owned());
    let points = |profile| {
        let text = text(profile);
        let entity = |(start, _)| {
            let end = text[start + 3..].find("  0\r\n").unwrap() + start + 3;
            text[start..end].to_owned()
        };
        text.match_indices("  0\r\nPOINT").map(entity).collect::<Vec<_>>()
    };
    // A vertex removed, and one added.
    let less = after(DxfProfile::R2000, " 10\r\n30.0\r\n 20\r\n-12.5\r\n  0", "  0");
    assert_eq!(line(less), expect(Some((1, Some(3))), "\"10\"", "\"0\""));
    let less = after(
        DxfProfile::R12,
        "  0\r\nVERTEX\r\n  8\r\nMARK\r\n 10\r\n30.0\r\n 20\r\n-12.5\r\n 30\r\n0.0\r\n",
        "",
    );
    assert_eq!(line(less), expect(Some((1, Some(3))), "\"VERTEX\"", "\"SEQEND\""));
    let more = after(DxfProfile::R2000, " 10\r\n2.0\r\n", " 10\r\n2.0\r\n 20\r\n1.0\r\n 10\r\n2.0\r\n");
    assert!(matches!(line(more), (Some((3, _)), ..)));
    // Only the number of vertices changed.
    assert_eq!(
        line(after(DxfProfile::R2000, " 90\r\n3", " 90\r\n2")),
        expect(Some((1, None)), "\"3\"", "\"2\"")
    );
    // A path removed in the middle or at the end, and one added.
    for profile in PROFILES {
        let [point, last] = &points(profile)[..] else { unreachable!() };
        assert!(matches!(line(after(profile, point, "")), (Some((4, _)), ..)), "{profile:?}");
        let more = after(profile, point, &point.repeat(2));
        assert!(matches!(line(more), (Some((4 | 5, _)), ..)), "{profile:?}");
        assert_eq!(line(after(profile, last, "")), expect(Some((6, None)), "\"POINT\"", "\"ENDSEC\""));
        let more = line(after(profile, last, &last.repeat(2)));
        assert_eq!(more, expect(Some((6, more.0.unwrap().1)), "\"ENDSEC\"", "\"POINT\""), "{profile:?}");
        // Another kind of entity.
        assert_eq!(
            line(after(profile, "POINT\r\n", "TEXT\r\n")),
            expect(Some((4, None)), "\"POINT\"", "\"TEXT\"")
        );
        // The header of the file, a comment, the end.
        let head = after(profile, "$EXTMAX\r\n 10\r\n1234.5", "$EXTMAX\r\n 10\r\n1234.6");
        assert_eq!(line(head), expect(None, "\"1234.5\"", "\"1234.6\""));
        assert!(matches!(line(after(profile, "isomark 0.1.0", "isomark 0.1.1")), (None, ..)));
        let cut = line(read_back(&write(&sample(), profile)[..900], &sample(), profile).unwrap_err());
        assert_eq!(cut.0, None, "{profile:?}");
        assert_eq!(
            line(after(profile, "EOF\r\n", "EOF\r\n\r\n")),
            expect(None, "the end of the file", "\"\"")
        );
        assert_eq!(line(read_back(b"", &sample(), profile).unwrap_err()).2, "the end of the file");
    }
    // Invalid and very long numbers.
    for wrong in ["NaN", "inf", "1e3", "", "1,5", &"9".repeat(400)] {
        let error = after(DxfProfile::R2000, " 20\r\n-12.5\r\n  0", &format!(" 20\r\n{wrong}\r\n  0"));
        assert_eq!(line(error).0, Some((1, Some(3))), "{wrong}");
    }
    // The same values, written differently.
    for (old, new) in [("2.0\r\n", "2.00\r\n"), ("2.0\r\n", "2.0000001\r\n"), (" 62\r\n5", " 62\r\n05")] {
        assert_eq!(line(after(DxfProfile::R2000, old, new)).0.unwrap().0, 3, "{new}");
    }
}

/// Errors of the writer: the file is complete and valid, but contains another drawing.
#[test]
fn a_file_of_another_drawing_is_refused_at_the_first_different_path() {
    let differs = |change: &dyn Fn(&mut MarkingDrawing), profile| {
        let mut other = sample();
        change(&mut other);
        let read = second_reading(&write(&sample(), profile)).unwrap();
        let names = plain_layer_names(&other.layers, profile);
        match same_content(&read, &other, profile, &names).unwrap_err() {
            ReadbackError::Path { path, difference } => (path.path, path.vertex, difference.to_string()),
            error => (0, None, error.to_string()),
        }
    };
    let at = |path, vertex, words: &str| (path, vertex, words.to_owned());
    for profile in PROFILES {
        let differs = |change: &dyn Fn(&mut MarkingDrawing)| differs(change, profile);
        let r2000 = profile == DxfProfile::R2000;
        let moved = |drawing: &mut MarkingDrawing| {
            drawing.paths[2].shape = MarkingShape::Open(points(&[[1.0, 1.0], [2.0, 1.25], [3.5, 1.333334]]));
        };
        assert_eq!(
            differs(&moved),
            at(3, Some(3), "is at (3.5, 1.333333) mm instead of (3.5, 1.333334) mm"),
            "{profile:?}"
        );
        assert_eq!(
            differs(&|drawing| drawing.paths[3].color = Color::Aci(4)),
            at(4, None, "has the colour 3 instead of 4")
        );
        assert_eq!(
            differs(&|drawing| drawing.paths[3].layer = 0),
            at(4, None, "is on layer \"0\" instead of \"MARK\"")
        );
        let black = |drawing: &mut MarkingDrawing| {
            drawing.paths[2].color = Color::Rgb { aci: 5, rgb: [1, 2, 254] };
        };
        if r2000 {
            assert_eq!(differs(&black), at(3, None, "has the colour 5 #0102fd instead of 5 #0102fe"));
        }
        let open = |drawing: &mut MarkingDrawing| {
            drawing.paths[0].shape = MarkingShape::Open(drawing.paths[0].shape.points().to_vec());
        };
        match profile {
            DxfProfile::R12Lines => assert_eq!(differs(&open).0, 3),
            _ => assert_eq!(differs(&open), at(1, None, "is closed instead of open")),
        }
        assert_eq!(differs(&|drawing| drawing.paths.truncate(5)), at(6, None, "is not in the drawing"));
        assert_eq!(
            differs(&|drawing| drawing.paths.push(drawing.paths[0].clone())),
            at(7, None, "is missing")
        );
        assert_eq!(differs(&|drawing| drawing.paths.swap(2, 3)).0, 3);
        let shorter = |drawing: &mut MarkingDrawing| {
            drawing.paths[2].shape = MarkingShape::Open(points(&[[1.0, 1.0], [2.0, 1.25]]));
        };
        match profile {
            DxfProfile::R12Lines => assert_eq!(differs(&shorter).0, 4),
            _ => assert_eq!(differs(&shorter), at(3, None, "has 3 vertices instead of 2")),
        }
        let recolored = |drawing: &mut MarkingDrawing| drawing.layers[0].color = Color::Aci(4);
        let words = "layer 1 of the file is \"MARK\" in colour 1 instead of \"MARK\" in colour 4";
        assert_eq!(differs(&recolored), at(0, None, words));
    }
    let read = second_reading(
        text(DxfProfile::R2000).replacen("$INSUNITS\r\n 70\r\n4", "$INSUNITS\r\n 70\r\n6", 1).as_bytes(),
    );
    let error = same_content(&read.unwrap(), &sample(), DxfProfile::R2000, &[]).unwrap_err();
    assert_eq!(error, ReadbackError::Unit { found: "Meters".into() });
}

#[test]
fn the_reason_names_the_place_the_distance_and_the_remedy() {
    let reason = after(DxfProfile::R2000, " 20\r\n-12.5\r\n", " 20\r\n-13.0\r\n").reason();
    assert_eq!(reason.code, "readback-differs");
    assert!(
        reason.what.contains(
            "vertex 3 of path 1 on layer \"MARK\" of the file is at (30, -13) mm instead of (30, -12.5) mm"
        ),
        "{}",
        reason.what
    );
    assert_eq!(reason.place.item.as_deref(), Some("path 1, vertex 3"));
    assert_eq!(reason.place.layer.as_deref(), Some("MARK"));
    assert_eq!(reason.number.unwrap().value, 0.5);
    let cut = read_back(&write(&sample(), DxfProfile::R12)[..1000], &sample(), DxfProfile::R12).unwrap_err();
    assert!(cut.reason().place.line.is_some_and(|line| line > 10), "{cut}");
}

proptest! {
    /// Bytes that are changed, removed or cut off anywhere are found, without panics or endless loops.
    #[test]
    fn any_change_of_any_byte_is_found(
        profile in 0..3usize,
        changes in prop::collection::vec((any::<prop::sample::Index>(), 0..4u8, any::<u8>()), 1..4),
    ) {
        let profile = PROFILES[profile];
        let whole = write(&sample(), profile);
        let mut file = whole.clone();
        for (at, change, byte) in changes {
            let at = at.index(file.len().max(1));
            match change {
                _ if at >= file.len() => {}
                0 => file[at] = byte,
                1 => file[at] = b"0123456789.-\r\n"[usize::from(byte) % 14],
                2 => drop(file.remove(at)),
                _ => file.truncate(at),
            }
        }
        prop_assert_eq!(read_back(&file, &sample(), profile).is_ok(), file == whole);
    }

    /// The second reader agrees with the writer about any drawing.
    #[test]
    fn any_drawing_is_read_back(
        names in prop::collection::vec(".{0,40}", 0..4),
        paths in prop::collection::vec(
            (0..5usize, 0..3u8, any::<u8>(), any::<[u8; 3]>(), prop::collection::vec(any::<[f64; 2]>(), 0..5), any::<bool>()),
            0..6,
        ),
        comment in ".{0,300}",
    ) {
        let layers = names.into_iter().map(|name| Layer { name, color: Color::Aci(4) }).collect();
        let paths = paths.into_iter().map(|(layer, kind, aci, rgb, coordinates, closed)| {
            let coordinates: Vec<[f64; 2]> =
                coordinates.into_iter().map(|pair| pair.map(|value| if value.is_finite() { value } else { 0.5 })).collect();
            let color = match kind {
                0 => Color::ByLayer,
                1 => Color::Aci(aci),
                _ => Color::Rgb { aci, rgb },
            };
            let points = points(&coordinates);
            MarkingPath { layer, color, shape: if closed { MarkingShape::Closed(points) } else { MarkingShape::Open(points) } }
        }).collect();
        let drawing = MarkingDrawing { layers, paths, comments: vec![comment] };
        for profile in PROFILES {
            prop_assert_eq!(read_back(&write(&drawing, profile), &drawing, profile), Ok(()));
        }
    }
}
