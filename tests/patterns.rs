//! Drawings from real programs, read at their true size.
//!
//! Widths, heights and lengths of [`DRAWINGS`] were measured with ezdxf 1.4.5 on the flattened, decomposed and visible
//! entities of each file (chords within 1e-8), not with isomark; those of `fc020-draft-legacy-lw`, which ezdxf refuses,
//! were calculated by hand from its eight shapes. They do not include texts, because ezdxf uses another font;
//! `tests/round_trips.rs` compares texts in the same font.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic")]

use isomark::formats::Pace;
use isomark::formats::pattern::{
    DrawingUnit, PatternOptions, PatternReadError, PatternReading, Spot, is_complete, read,
};
use isomark::geometry::pattern::{Color, Path, Shape};
use isomark::geometry::space::{Extents, FlatPoint};
use isomark::reason::Severity;

/// Name, width, height and total length in mm, number of paths, contours and skipped entities.
const DRAWINGS: [(&str, f64, f64, f64, usize, usize, usize); 32] = [
    ("abc", 39.0, 13.0, 181.963, 6, 6, 0),
    ("circle", 30.0, 30.0, 94.247, 1, 1, 0),
    // 443.630 by ezdxf, which swaps the axes of an insert rotated by 90 degrees inside one scaled by (-1, 2).
    // Calculated by hand, its outline is 16.472 mm long, not 13.472.
    ("ez-blocks-nested", 74.0, 36.0, 446.630, 38, 19, 0),
    // The two ticks of the dimension are 0.2475 mm long at 45 degrees and 0.02625 mm wide: marked once, along their centres.
    ("ez-dimension-mpolygon", 100.0875, 14.6304, 174.203, 10, 4, 3),
    // Without the two copies of a line of 10 mm and the line without length.
    ("ez-defects", 100_000.0, 20.0, 100_117.6, 7, 4, 2),
    ("ez-guilloche", 31.3106, 31.2088, 3537.438, 24, 24, 0),
    ("ez-hatch-islands", 28.0, 25.0, 222.864, 17, 3, 0),
    ("ez-layers-colors", 34.0, 20.0, 146.417, 4, 3, 5),
    ("ez-layers-colors-binary", 34.0, 20.0, 146.417, 4, 3, 5),
    ("ez-logo-inch", 28.0, 28.0, 209.216, 4, 2, 0),
    ("ez-logo-mm", 28.0, 28.0, 209.216, 4, 2, 0),
    ("ez-logo-unitless", 28.0, 28.0, 209.216, 4, 2, 0),
    ("ez-ocs-mirrored", 29.9244, 10.0, 100.084, 5, 2, 0),
    ("ez-qr-hatch", 14.5, 14.5, 647.000, 223, 223, 0),
    ("ez-r12-mixed", 35.0, 22.0, 169.570, 6, 3, 0),
    // A line of 15 mm with a width of 0.8 mm is a band with a perimeter of 31.6 mm.
    ("ez-r2000-bulges", 41.25, 40.0, 294.551, 5, 4, 0),
    // The closed spline is evaluated only from knot 3 to knot 7, where it is defined.
    ("ez-r2010-splines-ellipses", 60.0, 50.1962, 189.778, 7, 3, 0),
    ("fc020-draft-cpp-r14", 62.0, 23.7089, 261.216, 9, 6, 0),
    ("fc020-draft-cpp-r14-poly", 62.0, 23.7070, 257.388, 9, 6, 0),
    ("fc020-draft-legacy-lw", 78.0, 19.9152, f64::NAN, 8, 4, 2),
    ("fc020-sketch-cpp-r14", 46.0, 16.0, 177.300, 4, 3, 0),
    ("fc020-sketch-cpp-r14-poly", 46.0, 16.0, 173.968, 4, 3, 0),
    ("fc020-sketch-legacy", 46.0, 16.0, 174.397, 4, 3, 0),
    ("fc020-text-cpp-r12", 57.7701, 3.9731, 294.535, 25, 25, 0),
    ("fc020-text-cpp-r14", 57.7701, 3.9731, 297.543, 25, 25, 0),
    ("fc020-text-legacy", 57.7701, 3.9732, 294.535, 25, 25, 0),
    ("fc020-text-legacy-lw", 57.7701, 3.9732, 294.535, 25, 25, 0),
    ("fc020-tilted-cpp-r14", 20.0, 10.0, 51.416, 1, 1, 0),
    ("grid", 39.0, 13.0, 832.000, 39, 1, 0),
    ("ink12-logo-r14", 58.0, 28.0, 399.628, 7, 6, 3),
    ("ink12-logo_px-r14", 219.2124, 105.8267, 1510.403, 7, 6, 3),
    ("square", 30.0, 30.0, 120.000, 1, 1, 0),
];

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(format!("{}/tests/data/patterns/{name}.dxf", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn reading(name: &str) -> PatternReading {
    read(&bytes(name), &PatternOptions::default()).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn refusal(dxf: &[u8]) -> PatternReadError {
    let error = read(dxf, &PatternOptions::default()).unwrap_err();
    let reason = error.reason();
    assert!(reason.code.starts_with("pattern-") && !reason.remedy.is_empty(), "{reason}");
    error
}

fn length(path: &Path) -> f64 {
    let points = path.shape.flattened(1e-5);
    let back = points.first().filter(|_| path.shape.is_closed());
    points.iter().zip(points.iter().skip(1).chain(back)).map(|(a, b)| a.distance(*b)).sum()
}

fn area(points: &[FlatPoint]) -> f64 {
    let ends = points.iter().zip(points.iter().cycle().skip(1));
    ends.map(|(a, b)| a.x * b.y - b.x * a.y).sum::<f64>() / 2.0
}

fn has_notice(reading: &PatternReading, code: &str, severity: Severity) -> bool {
    reading.facts.notices.iter().any(|notice| notice.code == code && notice.severity == severity)
}

#[test]
fn every_sample_is_read_at_its_true_size() {
    for (name, width, height, total, paths, contours, skipped) in DRAWINGS {
        let read = reading(name);
        let curves: Vec<&Path> = read
            .pattern
            .paths
            .iter()
            .filter(|path| !matches!(path.source.entity.as_str(), "TEXT" | "MTEXT"))
            .collect();
        let segments = curves.iter().flat_map(|path| path.shape.segments()).map(|segment| segment.extents());
        let dots = curves.iter().filter_map(|path| match path.shape {
            Shape::Dot(point) => Some(point.coords()),
            _ => None,
        });
        let extents = Extents::of(segments.flat_map(|extents| [extents.min, extents.max]).chain(dots));
        let (found_width, found_height) = (extents.size().x, extents.size().y);
        if curves.len() == read.pattern.paths.len() {
            assert_eq!(read.facts.size, [found_width, found_height], "{name}");
        }
        assert!((found_width - width).abs() < 2e-4, "{name}: width {found_width}");
        assert!((found_height - height).abs() < 2e-4, "{name}: height {found_height}");
        let found: f64 = curves.iter().map(|path| length(path)).sum();
        assert!(total.is_nan() || (found - total).abs() < 2e-3, "{name}: length {found} is not {total}");
        assert_eq!(curves.len(), paths, "{name}: paths");
        let closed = curves.iter().filter(|path| path.shape.is_closed()).count();
        assert_eq!(closed, contours, "{name}: contours");
        assert_eq!(read.facts.skipped.len(), skipped, "{name}: skipped {:?}", read.facts.skipped);
    }
}

#[test]
fn paths_are_connected_and_contours_end_at_their_start() {
    for (name, ..) in DRAWINGS {
        for path in &reading(name).pattern.paths {
            let segments = path.shape.segments();
            let pairs = segments.windows(2).map(|pair| (&pair[0], &pair[1]));
            let back = segments.last().zip(segments.first()).filter(|_| path.shape.is_closed());
            for (before, after) in pairs.chain(back) {
                let gap = before.end().distance(after.start());
                assert!(gap < 1e-6, "{name}: {:?} has a gap of {gap} mm", path.source);
            }
        }
    }
}

#[test]
fn samples_are_complete_and_their_beginnings_are_not() {
    for (name, ..) in DRAWINGS {
        let whole = bytes(name);
        assert!(is_complete(&whole), "{name}");
        for cut in [1, 2, 3, 5, whole.len() / 2, whole.len() - 1] {
            let part = &whole[..whole.len() - cut];
            // Only the last line break may be missing.
            let only_line_end = whole.ends_with(b"\n") && cut == 1;
            assert_eq!(is_complete(part), only_line_end, "{name} without {cut} bytes");
            assert_eq!(
                read(part, &PatternOptions::default()).is_ok(),
                only_line_end,
                "{name} without {cut} bytes"
            );
        }
    }
}

#[test]
fn letters_have_the_area_of_their_ink() {
    // From the vertices in ezdxf: three outlines minus the holes of A and B. (Counting pixels gives 126.64.)
    let read = reading("abc");
    let mut areas: Vec<f64> =
        read.pattern.paths.iter().map(|path| area(&path.shape.flattened(1e-4)).abs()).collect();
    areas.sort_by(f64::total_cmp);
    let (holes, outlines) = areas.split_at(3);
    let ink = outlines.iter().sum::<f64>() - holes.iter().sum::<f64>();
    assert!((ink - 127.3351).abs() < 1e-3, "{ink}");
}

#[test]
fn units_come_from_the_header_or_else_from_the_settings() {
    let inch = reading("ez-logo-inch").facts;
    assert_eq!((inch.unit, inch.unit_why.as_str()), (DrawingUnit::Inch, "$INSUNITS 1"));
    let unitless = reading("ez-logo-unitless");
    assert_eq!(unitless.facts.unit, DrawingUnit::Millimetre);
    assert!(has_notice(&unitless, "unit-assumed", Severity::Note));
    assert!(!has_notice(&unitless, "unit-pixels", Severity::Warning));

    let guessed = reading("ink12-logo_px-r14");
    let notice = guessed.facts.notices.iter().find(|notice| notice.code == "unit-pixels").unwrap();
    assert!(notice.message.contains("58.000 x 28.000") && notice.message.contains("25.4/96"));
    let mut options = PatternOptions::default();
    options.unit_if_unitless = "px".parse().ok();
    let in_pixels = read(&bytes("ink12-logo_px-r14"), &options).unwrap();
    assert!((in_pixels.facts.size[0] - 58.0).abs() < 0.001 && (in_pixels.facts.size[1] - 28.0).abs() < 0.001);
    assert!(!has_notice(&in_pixels, "unit-pixels", Severity::Warning));
    // The setting applies only to drawings without a unit.
    assert_eq!(read(&bytes("ez-logo-inch"), &options).unwrap().facts.unit, DrawingUnit::Inch);
}

#[test]
fn producers_and_versions_are_reported() {
    for (name, version, producer) in [
        ("fc020-text-cpp-r14", "R14 (AC1014)", Some("FreeCAD v0.20")),
        ("ink12-logo-r14", "R14 (AC1014)", Some("Inkscape (recognised by its header)")),
        ("ez-r12-mixed", "R12 (AC1009)", Some("ezdxf")),
        ("ez-layers-colors-binary", "R2018 (AC1032)", Some("ezdxf")),
        ("fc020-sketch-legacy", "R12 (AC1009)", None),
    ] {
        let facts = reading(name).facts;
        assert_eq!((facts.version.as_str(), facts.producer.as_deref()), (version, producer), "{name}");
    }
}

#[test]
fn text_and_binary_files_give_the_same_colours_and_hidden_entities() {
    let text = reading("ez-layers-colors");
    let binary = reading("ez-layers-colors-binary");
    assert_eq!(text.pattern, binary.pattern);
    assert_eq!(text.facts.entities, binary.facts.entities);
    let layers: Vec<_> = text.pattern.layers.iter().map(|layer| (layer.name.as_str(), layer.color)).collect();
    assert_eq!(layers, [("MARK", Color::Aci(1)), ("CUT", Color::Aci(5))]);
    let colors: Vec<_> = text.pattern.paths.iter().map(|path| path.color).collect();
    assert!(colors.iter().any(|color| matches!(color, Color::Rgb { .. })), "{colors:?}");
    let why: Vec<_> =
        text.facts.skipped.iter().map(|skipped| (skipped.layer.as_str(), skipped.why.as_ref())).collect();
    let expected = [
        ("CONSTRUCTION", "its layer is not plotted"),
        ("OFF", "its layer is off"),
        ("FROZEN", "its layer is frozen"),
        ("MARK", "it is invisible"),
        ("0", "it is in paper space, not in model space"),
    ];
    assert_eq!(why, expected);
    assert_eq!(text.facts.layers["FROZEN"].hidden.as_deref(), Some("frozen"));
    assert_eq!(text.facts.layers["MARK"].paths, 3);
    assert!(matches!(text.pattern.paths.last().unwrap().shape, Shape::Dot(_)));
}

#[test]
fn loose_pieces_become_contours_in_drawing_order() {
    let read = reading("fc020-text-cpp-r14");
    assert_eq!(read.facts.entities["LINE"]["ShapeString"], 113);
    assert_eq!(read.facts.entities["SPLINE"]["ShapeString"], 172);
    assert!(read.facts.repairs[0].notice.message.starts_with("285 loose pieces were joined to 25 contours"));
    let apart = PatternOptions::default().with_joining_tolerance(0.0);
    assert_eq!(reading_with("fc020-text-cpp-r14", &apart).pattern.paths.len(), 285);
}

fn reading_with(name: &str, options: &PatternOptions) -> PatternReading {
    read(&bytes(name), options).unwrap()
}

#[test]
fn defects_are_repaired_and_every_place_is_listed() {
    let read = reading("ez-defects");
    for code in ["size-unusual", "not-taken", "nearly-closed"] {
        assert!(has_notice(&read, code, Severity::Warning), "{code}");
    }
    let [copies, empty] = read.facts.repairs.as_slice() else { panic!("{:?}", read.facts.repairs) };
    assert_eq!((copies.notice.code.as_str(), copies.places.len()), ("copies-removed", 2));
    assert_eq!((empty.notice.code.as_str(), empty.places.len()), ("empty-pieces-removed", 2));
    let places: Vec<_> = copies.places.iter().chain(&empty.places).collect();
    let handles: Vec<_> = places.iter().filter_map(|place| place.handle.as_deref()).collect();
    assert_eq!(handles, ["8C", "8D", "8A", "94"]);
    assert_eq!(
        (places[3].entity.as_str(), places[3].pieces, places[3].at_mm),
        ("LWPOLYLINE", 2, [70.0, 5.0])
    );
    // Polylines of a single vertex, as Inkscape writes them, are not a loss.
    assert!(has_notice(&reading("ink12-logo-r14"), "not-taken", Severity::Note));
    let skipped: Vec<_> = read.facts.skipped.iter().map(|skipped| skipped.entity.as_str()).collect();
    assert_eq!(skipped, ["LWPOLYLINE", "3DFACE"]);
}

#[test]
fn strict_reading_changes_nothing_and_warns() {
    let strict = PatternOptions::default().strictly(true);
    let read = reading_with("ez-defects", &strict);
    for code in ["drawn-twice", "without-length", "nearly-closed"] {
        assert!(has_notice(&read, code, Severity::Warning), "{code}");
    }
    assert!(read.facts.repairs.is_empty());
    assert_eq!(read.pattern.paths.len(), reading("ez-defects").pattern.paths.len() + 3);
    let text = reading_with("fc020-text-cpp-r14", &strict);
    assert_eq!((text.pattern.paths.len(), text.facts.repairs.len()), (285, 0));
    let old = reading_with("fc020-draft-legacy-lw", &strict);
    assert!(has_notice(&old, "extra-point", Severity::Warning));
    let repaired = reading("fc020-draft-legacy-lw").facts.repairs;
    let places = repaired.iter().find(|repair| repair.notice.code == "extra-point-removed").unwrap();
    assert!(places.places.iter().all(|place| place.entity == "LWPOLYLINE"), "{places:?}");
}

#[test]
fn each_fill_is_one_region() {
    let read = reading("ez-hatch-islands");
    let regions: Vec<_> = read.pattern.paths.iter().map(|path| path.region).collect();
    // The second hatch has a pattern: it becomes lines, not a region.
    assert!(regions.len() == 17 && regions[..3] == [Some(1); 3] && regions[3..].iter().all(Option::is_none));
    let qr = reading("ez-qr-hatch").pattern;
    assert!(qr.paths.iter().enumerate().all(|(index, path)| path.region == Some(index as u32 + 1)));
    let solid = reading("ez-r12-mixed").pattern;
    assert_eq!(solid.paths.iter().filter(|path| path.region.is_some()).count(), 1);
}

#[test]
fn drawings_with_nothing_to_mark_are_refused_with_the_likely_cause() {
    let PatternReadError::NothingToMark { found, remedy } = refusal(&bytes("ink12-text-r14")) else {
        panic!()
    };
    assert!(found.contains("no entities") && remedy.contains("Object to Path"), "{found} {remedy}");
    let face = drawing("0\n3DFACE\n8\n0\n10\n0\n20\n0\n", "");
    let PatternReadError::NothingToMark { found, remedy } = refusal(face.as_bytes()) else { panic!() };
    assert!(found.contains("1 3DFACE") && remedy.contains("outline"), "{found} {remedy}");
}

/// Unicode Standard Annex #15: `A` and U+0308 are the same text as `Ä`.
#[test]
fn accents_behind_letters_give_the_same_outlines_as_composed_letters() {
    for kind in ["TEXT", "MTEXT"] {
        let outlines = |words: &str| {
            let text = format!(
                "0\nSECTION\n2\nENTITIES\n0\n{kind}\n8\n0\n10\n0\n20\n0\n40\n3\n1\n{words}\n0\nENDSEC\n0\nEOF\n"
            );
            let reading = read(text.as_bytes(), &PatternOptions::default()).unwrap();
            format!("{:?}", reading.pattern.paths.iter().map(|path| &path.shape).collect::<Vec<_>>())
        };
        let composed = outlines("K\\U+00C4SE \\U+00E7a");
        assert!(composed.len() > 100);
        assert_eq!(outlines("KA\\U+0308SE c\\U+0327a"), composed, "{kind}");
    }
}

#[test]
fn texts_are_drawn_and_replaced_fonts_are_reported() {
    let read = reading("ez-r2018-text");
    // No available font has Japanese letters; the whole text is skipped, because the rest of it would be misleading.
    let [text] = read.facts.skipped.as_slice() else { panic!("{:?}", read.facts.skipped) };
    assert!(text.entity == "TEXT" && text.why.contains('株') && text.why.contains("outlines"), "{text:?}");
    assert!(has_notice(&read, "texts-drawn", Severity::Note));
    let replaced: Vec<_> = read
        .facts
        .notices
        .iter()
        .filter(|notice| notice.code == "font-replaced")
        .map(|n| &n.message)
        .collect();
    assert_eq!(replaced.len(), 2, "{replaced:?}");
    assert!(replaced[0].contains("DejaVu Sans Bold") && replaced[1].contains("font txt"), "{replaced:?}");
    // `BEST BEFORE 31.03.2027`: 20 letters that are not blanks, each a separate region.
    let regions: std::collections::BTreeSet<_> =
        read.pattern.paths.iter().filter_map(|path| path.region).collect();
    // `Made in` above is in the same font: 6 letters, with the dot of the i as part of its letter.
    assert_eq!(regions.len(), 20 + 6 + "Europe".len());
}

/// A drawing of R2000 with the given entities, blocks and header variables.
fn drawing(entities: &str, blocks: &str) -> String {
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n\
         0\nSECTION\n2\nBLOCKS\n{blocks}0\nENDSEC\n0\nSECTION\n2\nENTITIES\n{entities}0\nENDSEC\n0\nEOF\n"
    )
}

fn line(coordinates: [&str; 4]) -> String {
    let [x0, y0, x1, y1] = coordinates;
    format!("0\nLINE\n5\n2F\n8\nMARK\n10\n{x0}\n20\n{y0}\n30\n0\n11\n{x1}\n21\n{y1}\n31\n0\n")
}

fn insert(block: &str, groups: &str) -> String {
    format!("0\nINSERT\n8\n0\n2\n{block}\n10\n0\n20\n0\n{groups}")
}

fn block(name: &str, entities: &str) -> String {
    format!("0\nBLOCK\n8\n0\n2\n{name}\n70\n0\n10\n0\n20\n0\n{entities}0\nENDBLK\n")
}

#[test]
fn unreadable_numbers_are_refused_with_their_line() {
    for number in ["abc", "1,5", "NaN", "1e999", "inf", ""] {
        let file = drawing(&line(["1", number, "2", "3"]), "");
        let PatternReadError::UnreadableNumber { spot, group, text, entity } = refusal(file.as_bytes())
        else {
            panic!("{number}")
        };
        let Spot::Line(at) = spot else { panic!() };
        assert_eq!((file.lines().nth(at as usize - 1), group, text.as_str()), (Some(number), 20, number));
        assert_eq!((entity.to_string().as_str(), entity.layer.as_str()), ("LINE 2F", "MARK"));
    }
    // A number that is not needed may be invalid.
    let readable = line(["0", "0", "1", "1"]) + "48\nabc\n";
    assert!(read(drawing(&readable, "").as_bytes(), &PatternOptions::default()).is_ok());
}

#[test]
fn drawings_with_endless_or_too_many_blocks_are_refused() {
    let unit = line(["0", "0", "1", "1"]);
    let itself = drawing(&insert("A", ""), &(block("A", &insert("B", "")) + &block("B", &insert("a", ""))));
    assert!(
        matches!(refusal(itself.as_bytes()), PatternReadError::RecursiveBlock { block, .. } if block == "A")
    );

    let array = drawing(&insert("A", "70\n32000\n71\n32000\n44\n2\n45\n2\n"), &block("A", &unit));
    assert!(matches!(refusal(array.as_bytes()), PatternReadError::TooMany { what: "copies of a block", .. }));

    // Each block contains the next one ten times: 10^12 lines.
    let tenfold =
        |index: u32| block(&format!("B{index}"), &insert(&format!("B{}", index + 1), "").repeat(10));
    let blocks: String = (0..12).map(tenfold).chain([block("B12", &unit)]).collect();
    let laughs = drawing(&insert("B0", ""), &blocks);
    assert!(matches!(refusal(laughs.as_bytes()), PatternReadError::TooMany { what: "entities", .. }));

    let deep: String =
        (0..100).map(|i| block(&format!("D{i}"), &insert(&format!("D{}", i + 1), ""))).collect();
    let error = refusal(drawing(&insert("D0", ""), &deep).as_bytes());
    assert!(matches!(error, PatternReadError::TooMany { what: "levels of nested blocks", .. }), "{error}");

    let far = drawing(&line(["0", "0", "1e20", "0"]), "");
    assert!(matches!(refusal(far.as_bytes()), PatternReadError::OutOfRange { .. }));
}

/// Valid drawings of a few bytes that unfold to a lot of work in different ways.
#[test]
fn drawings_that_take_long_are_refused_at_a_quick_pace() {
    let unit = line(["0", "0", "1", "1"]);
    let copies = |columns: usize, rows: usize, entities: &str| {
        drawing(&insert("A", &format!("70\n{columns}\n71\n{rows}\n44\n2\n45\n2\n")), &block("A", entities))
    };
    let nothing = "0\nATTDEF\n8\n0\n";
    let text = format!("0\nTEXT\n8\n0\n40\n1\n1\n{}\n", "&&%%c@".repeat(1000));
    let heavy = [
        copies(300, 300, &unit),
        copies(300, 300, nothing),
        copies(1, 400, &unit.repeat(60)),
        drawing(&hatch(&family(0.1, &[0.0, -0.12]), 1), ""),
        drawing(&text, ""),
    ];
    let mut quick = PatternOptions::default();
    quick.pace = Pace::Quick;
    for heavy in heavy {
        assert_eq!(read(heavy.as_bytes(), &quick), Err(PatternReadError::TakesLong), "{heavy:.300}");
        assert_ne!(read(heavy.as_bytes(), &PatternOptions::default()), Err(PatternReadError::TakesLong));
    }
    let light = copies(100, 100, &unit);
    assert_eq!(read(light.as_bytes(), &quick), read(light.as_bytes(), &PatternOptions::default()));
    // A drawing that is too large at any pace is refused as such.
    let array = copies(32_000, 32_000, &unit);
    assert!(matches!(read(array.as_bytes(), &quick), Err(PatternReadError::TooMany { .. })));
}

#[test]
fn too_many_copies_are_refused_with_the_limit() {
    let unit = line(["0", "0", "1", "1"]);
    for (entities, columns, limit, what) in
        [("", 1001, 1_000_000, "copies of a block"), (&*unit, 1000, 1_000_000, "entities")]
    {
        let copies = insert("A", &format!("70\n{columns}\n71\n1000\n44\n2\n45\n2\n"));
        let error = refusal(drawing(&copies, &block("A", entities)).as_bytes());
        // A thousand times a thousand lines and the insert are one more than the limit.
        assert_eq!(error.to_string(), format!("the drawing has more than {limit} {what}"));
    }
}

#[test]
fn large_drawings_are_refused_before_they_fill_the_memory() {
    let points = drawing(&"0\nPOINT\n".repeat(2_000_001), "");
    assert!(matches!(refusal(points.as_bytes()), PatternReadError::TooMany { what: "entities", .. }));
    // A letter takes four bytes and has dozens of segments.
    let text = format!("0\nTEXT\n8\n0\n40\n1\n1\n{}\n", "&&%%c@".repeat(1000));
    let texts = drawing(&text.repeat(100), "");
    assert!(matches!(refusal(texts.as_bytes()), PatternReadError::TooMany { what: "segments and dots", .. }));
    let novel = drawing(&(text.replace('@', &"@".repeat(60)) + &line(["0", "0", "1", "1"])), "");
    let skipped = read(novel.as_bytes(), &PatternOptions::default()).unwrap().facts.skipped;
    assert!(skipped.len() == 1 && skipped[0].why.contains("50000 letters"), "{skipped:?}");
}

fn whole(entities: &str, blocks: &str) -> PatternReading {
    read(drawing(entities, blocks).as_bytes(), &PatternOptions::default()).unwrap()
}

fn skipped(reading: &PatternReading) -> Vec<(&str, &str)> {
    reading.facts.skipped.iter().map(|skipped| (skipped.entity.as_str(), skipped.why.as_ref())).collect()
}

#[test]
fn attributes_have_the_layer_colour_and_visibility_of_their_insert() {
    let content = block("B", &line(["0", "0", "1", "1"]));
    let attribute = "0\nATTRIB\n8\n0\n62\n0\n10\n5\n20\n5\n40\n3\n1\nX\n2\nTAG\n70\n0\n0\nSEQEND\n";
    let with = |layer: &str| {
        let insert = insert("B", "62\n1\n66\n1\n").replace("INSERT\n8\n0", &format!("INSERT\n8\n{layer}"));
        whole(&(insert + attribute + &line(["0", "9", "1", "9"])), &content)
    };
    let shown = with("A");
    let letters: Vec<_> = shown.pattern.paths.iter().filter(|path| path.source.entity == "ATTRIB").collect();
    assert!(!letters.is_empty());
    for path in letters {
        assert_eq!((shown.pattern.layers[path.layer].name.as_str(), path.color), ("A", Color::Aci(1)));
    }
    let layers =
        "0\nSECTION\n2\nTABLES\n0\nTABLE\n2\nLAYER\n0\nLAYER\n2\nICE\n70\n1\n62\n7\n0\nENDTAB\n0\nENDSEC\n";
    let insert = insert("B", "66\n1\n").replace("INSERT\n8\n0", "INSERT\n8\nICE");
    let entities = insert + attribute + &line(["0", "9", "1", "9"]);
    let file = drawing(&entities, &content)
        .replace("0\nSECTION\n2\nBLOCKS", &format!("{layers}0\nSECTION\n2\nBLOCKS"));
    let frozen = read(file.as_bytes(), &PatternOptions::default()).unwrap();
    assert_eq!(frozen.pattern.paths.len(), 1);
    let expected = [("INSERT", "its layer is frozen"), ("ATTRIB", "the block that it belongs to is hidden")];
    assert_eq!(skipped(&frozen), expected);
}

#[test]
fn every_layout_in_paper_space_is_listed_as_skipped() {
    let sheets = block("*Paper_Space0", &(line(["0", "0", "1", "1"]) + "0\nVIEWPORT\n8\n0\n"));
    let reading = whole(&line(["0", "0", "1", "1"]), &sheets);
    assert_eq!(reading.pattern.paths.len(), 1);
    let why = "it is in paper space, not in model space";
    assert_eq!(skipped(&reading), [("LINE", why), ("VIEWPORT", why)]);
}

#[test]
fn an_entity_of_type_section_hides_nothing() {
    let entities = line(["0", "0", "1", "1"]) + "0\nSECTION\n5\nFF\n8\n0\n" + &line(["5", "0", "6", "1"]);
    let reading = whole(&entities, "");
    assert_eq!(reading.pattern.paths.len(), 2);
    assert_eq!(skipped(&reading)[0].0, "SECTION");
}

#[test]
fn a_hatch_with_a_reversed_first_edge_and_an_extrusion_is_one_square() {
    let edge = |x0, y0, x1, y1| format!("72\n1\n10\n{x0}\n20\n{y0}\n11\n{x1}\n21\n{y1}\n");
    let edges = edge(30, 0, 20, 0) + &edge(30, 0, 30, 10) + &edge(30, 10, 20, 10) + &edge(20, 10, 20, 0);
    let hatch = format!(
        "0\nHATCH\n8\n0\n10\n0\n20\n0\n30\n0\n230\n-1\n2\nSOLID\n70\n1\n91\n1\n92\n1\n93\n4\n{edges}97\n0\n75\n0\n"
    );
    let reading = whole(&hatch, "");
    assert_eq!(reading.facts.extents, [-30.0, 0.0, -20.0, 10.0]);
    assert!((length(&reading.pattern.paths[0]) - 40.0).abs() < 1e-9);
}

#[test]
fn lines_that_look_different_in_the_drawing_program_are_reported() {
    let wide = "0\nLWPOLYLINE\n8\n0\n90\n2\n70\n0\n43\n0.3\n10\n0\n20\n5\n10\n9\n20\n5\n";
    let dashed = line(["0", "0", "9", "0"]).replace("8\nMARK", "8\nMARK\n6\nDASHED");
    let file = drawing(&(wide.to_owned() + &dashed), "").replace("0\nEOF\n", "")
        + "0\nSECTION\n2\nOBJECTS\n0\nSPATIAL_FILTER\n5\n99\n0\nENDSEC\n0\nEOF\n";
    let reading = read(file.as_bytes(), &PatternOptions::default()).unwrap();
    assert!(has_notice(&reading, "wide-lines", Severity::Note));
    assert!(has_notice(&reading, "dashed-whole", Severity::Warning));
    assert!(has_notice(&reading, "clipped-whole", Severity::Warning));
    let plain = whole(&line(["0", "0", "9", "0"]).replace("8\nMARK", "8\nMARK\n6\nByLayer"), "");
    assert!(plain.facts.notices.is_empty(), "{:?}", plain.facts.notices);
}

#[test]
fn a_spline_marked_as_closed_is_a_contour_even_beside_other_ends() {
    // A uniform cubic around four points, with repeated points; where it is defined, its ends agree except for
    // rounding.
    let points: String = [(0.0, 0.1), (7.3, 0.0), (7.1, 3.3), (0.2, 3.1), (0.0, 0.1), (7.3, 0.0), (7.1, 3.3)]
        .iter()
        .map(|(x, y)| format!("10\n{x}\n20\n{y}\n30\n0\n"))
        .collect();
    let knots: String = (0..11).map(|knot| format!("40\n{}\n", 0.1 * f64::from(knot))).collect();
    let spline = format!("0\nSPLINE\n8\n0\n70\n11\n71\n3\n72\n11\n73\n7\n74\n0\n{knots}{points}");
    let strict = PatternOptions::default().strictly(true);
    let reading = read(drawing(&spline, "").as_bytes(), &strict).unwrap();
    assert!(reading.pattern.paths[0].shape.is_closed());
    // A line that starts at its seam does not matter.
    let seam = reading.pattern.paths[0].shape.segments()[0].start();
    let both = spline + &line([&seam.x.to_string(), &seam.y.to_string(), "20", "20"]);
    let closed = whole(&both, "").pattern.paths.iter().filter(|path| path.shape.is_closed()).count();
    assert_eq!(closed, 1);
}

/// A hatch of a square with a side of 100 mm, with families of pattern lines.
fn hatch(pattern: &str, families: usize) -> String {
    let square = "91\n1\n92\n3\n72\n0\n73\n1\n93\n4\n10\n0\n20\n0\n10\n100\n20\n0\n10\n100\n20\n100\n10\n0\n20\n100\n97\n0\n";
    format!(
        "0\nHATCH\n5\n4A\n8\nFILL\n2\nX\n70\n0\n{square}75\n0\n78\n{families}\n{}",
        pattern.repeat(families)
    )
}

/// A family of parallel lines with repeated dashes.
fn family(spacing: f64, dashes: &[f64]) -> String {
    let dashes: Vec<String> = dashes.iter().map(|dash| format!("49\n{dash}\n")).collect();
    format!("53\n0\n43\n0\n44\n0\n45\n0\n46\n{spacing}\n79\n{}\n{}", dashes.len(), dashes.concat())
}

#[test]
fn too_dense_hatches_are_skipped_and_too_many_of_them_are_refused() {
    let line = line(["0", "0", "1", "1"]);
    let gaps = hatch(&family(0.0002, &[-0.0002]), 1);
    let reading = read(drawing(&(gaps.clone() + &line), "").as_bytes(), &PatternOptions::default()).unwrap();
    let [skipped] = reading.facts.skipped.as_slice() else { panic!("{:?}", reading.facts.skipped) };
    assert_eq!((skipped.entity.as_str(), skipped.handle.as_deref()), ("HATCH", Some("4A")));
    assert!(skipped.why.contains("too dense"), "{skipped:?}");
    // Twenty families of 100,000 lines of gaps only, in ten hatches.
    let wide = hatch(&family(0.001, &[-1000.0, -1000.0]), 20);
    let error = refusal(drawing(&wide.repeat(10), "").as_bytes());
    let PatternReadError::TooMany { what, entity: Some(entity), .. } = error else { panic!("{error}") };
    assert!(what.starts_with("steps") && entity.to_string() == "HATCH 4A" && entity.layer == "FILL");
}

#[test]
fn dots_are_limited_like_segments() {
    let dots = hatch(&family(0.1, &[0.0, -0.12]), 1);
    let error = refusal(drawing(&dots.repeat(4), "").as_bytes());
    assert!(
        matches!(error, PatternReadError::TooMany { what: "segments and dots", entity: Some(_), .. }),
        "{error}"
    );
    // In a block they are refused before the second copy is created.
    let array = drawing(&insert("B", "70\n3\n44\n200\n71\n2\n45\n200\n"), &block("B", &dots));
    assert!(matches!(refusal(array.as_bytes()), PatternReadError::TooMany { what: "segments and dots", .. }));
}

#[test]
fn curves_of_many_pieces_are_refused_before_they_are_created() {
    let vertices: String =
        (0..13_000).map(|index| format!("10\n{}\n20\n0\n40\n1\n41\n2\n42\n99\n", index % 2)).collect();
    let tapered = drawing(&format!("0\nLWPOLYLINE\n5\n7\n8\n0\n90\n13000\n70\n0\n{vertices}"), "");
    let error = refusal(tapered.as_bytes());
    let PatternReadError::TooMany { what: "segments and dots", entity: Some(entity), .. } = error else {
        panic!("{error}")
    };
    assert_eq!(entity.to_string(), "LWPOLYLINE 7");

    // A spline of degree 4 so large that every span needs 1024 pieces, repeated as an edge of a fill.
    let knots: String =
        [0; 5].into_iter().chain(1..896).chain([896; 5]).map(|knot| format!("40\n{knot}\n")).collect();
    let points: String = (0..900u64)
        .map(|i| format!("10\n{}\n20\n{}\n", i % 7 * 999_999_999_999, i * i % 11 * 999_999_999_999))
        .collect();
    let edge = format!("72\n4\n94\n4\n73\n0\n74\n0\n95\n905\n96\n900\n{knots}{points}");
    let fill =
        format!("0\nHATCH\n8\n0\n2\nSOLID\n70\n1\n91\n1\n92\n1\n93\n4\n{}97\n0\n75\n0\n", edge.repeat(4));
    let reading = read(
        drawing(&(fill.clone() + &line(["0", "0", "1", "1"])), "").as_bytes(),
        &PatternOptions::default(),
    );
    let skipped = reading.unwrap().facts.skipped;
    assert!(skipped.len() == 1 && skipped[0].why.contains("steps"), "{skipped:?}");
    let error = refusal(drawing(&fill.repeat(5), "").as_bytes());
    assert!(matches!(error, PatternReadError::TooMany { entity: Some(_), .. }), "{error}");
}

#[test]
fn places_of_repairs_are_counted_and_the_first_thousand_listed() {
    let drawn = line(["0", "0", "1", "1"]).repeat(3001);
    let read = read(drawing(&drawn, "").as_bytes(), &PatternOptions::default()).unwrap();
    let [copies] = read.facts.repairs.as_slice() else { panic!("{:?}", read.facts.repairs) };
    assert_eq!((copies.count, copies.places.len()), (3000, 1000));
    assert!(copies.notice.message.starts_with("3000 paths"), "{}", copies.notice.message);
}

#[test]
fn long_formats_of_a_text_are_not_copied_for_each_of_its_lines() {
    let name = "A".repeat(20_000);
    let entity = format!(
        "0\nMTEXT\n8\n0\n10\n0\n20\n0\n40\n1\n71\n1\n1\n\\pt{}5;\\f{name};{}a\n",
        "1,".repeat(2000),
        "\\P{".repeat(5000)
    );
    let read = read(drawing(&entity, "").as_bytes(), &PatternOptions::default()).unwrap();
    let replaced = read.facts.notices.iter().find(|notice| notice.code == "font-replaced").unwrap();
    assert!(
        replaced.message.contains(&"A".repeat(100)) && replaced.message.len() < 500,
        "{}",
        replaced.message
    );
}

#[test]
fn invalid_data_that_is_not_needed_does_not_matter() {
    // The dxf crate refuses a whole file for each of these.
    let groups = line(["0", "0", "1", "1"]) + "5000\nx\n-7\ny\n62\n300\n";
    assert!(read(drawing(&groups, "").as_bytes(), &PatternOptions::default()).is_ok());
    let tables = "0\nSECTION\n2\nTABLES\n0\nTABLE\n2\nDIMSTYLE\n70\n1\n0\nDIMSTYLE\n2\nSTANDARD\n5\n_Dot\n70\n0\n\
                  0\nENDTAB\n0\nENDSEC\n";
    let file = tables.to_owned() + &drawing(&line(["0", "0", "1", "1"]), "");
    let read = read(file.as_bytes(), &PatternOptions::default()).unwrap();
    assert_eq!(read.pattern.paths[0].source.handle.as_deref(), Some("2F"));
}

#[test]
fn names_are_read_in_the_encoding_of_the_file() {
    let entity = |layer: &[u8]| {
        let file = drawing(&line(["0", "0", "1", "1"]), "").replace("AC1015", "VERSION").into_bytes();
        let at = file.windows(4).position(|window| window == b"MARK").unwrap();
        [&file[..at], layer, &file[at + 4..]].concat()
    };
    let with = |version: &str, page: &str, layer: &[u8]| {
        let page = format!("{version}\n9\n$DWGCODEPAGE\n3\n{page}");
        let file = entity(layer);
        let at = file.windows(7).position(|window| window == b"VERSION").unwrap();
        let file = [&file[..at], page.as_bytes(), &file[at + 7..]].concat();
        read(&file, &PatternOptions::default()).unwrap().pattern.layers[0].name.clone()
    };
    assert_eq!(with("AC1015", "ANSI_1252", b"Gr\xf6\xdfe"), "Größe");
    assert_eq!(with("AC1009", "dos850", b"Gr\x94\xe1e"), "Größe");
    assert_eq!(with("AC1015", "ANSI_1251", b"\xd1\xeb\xee\xe9"), "Слой");
    assert_eq!(with("AC1015", "ANSI_932", b"\x83\x8c\x83C\x83\x84\x81[".as_slice()), "レイヤー");
    assert_eq!(with("AC1032", "ANSI_1252", "Größe".as_bytes()), "Größe");
    assert_eq!(with("AC1009", "ANSI_1252", b"Gr\\U+00F6\\U+00DFe"), "Größe");
}

/// An ARC around the origin, with its angles in degrees as text.
fn arc(radius: &str, start: &str, end: &str, more: &str) -> String {
    format!("0\nARC\n5\nA1\n8\nMARK\n10\n0\n20\n0\n30\n0\n40\n{radius}\n50\n{start}\n51\n{end}\n{more}")
}

/// An ELLIPSE of 10 x 5 mm around the origin, with its parameters as text.
fn ellipse(start: &str, end: &str, more: &str) -> String {
    format!(
        "0\nELLIPSE\n5\nE1\n8\nMARK\n10\n0\n20\n0\n30\n0\n11\n10\n21\n0\n31\n0\n40\n0.5\n41\n{start}\n42\n{end}\n{more}"
    )
}

/// A fill with a single round edge, with its angles in degrees as text.
fn round_fill(shape: &str, start: &str, end: &str, counter_clockwise: u8) -> String {
    let edge = format!("{shape}50\n{start}\n51\n{end}\n73\n{counter_clockwise}\n");
    format!("0\nHATCH\n5\nF1\n8\nMARK\n2\nSOLID\n70\n1\n91\n1\n92\n1\n93\n1\n{edge}97\n0\n75\n0\n")
}

#[test]
fn rounded_full_turns_are_full_turns() {
    let circle = "72\n2\n10\n0\n20\n0\n40\n10\n";
    let oval = "72\n3\n10\n0\n20\n0\n11\n10\n21\n0\n40\n0.5\n";
    let turns = [
        ("0", "360"),
        ("90", "450.000001"),
        ("0", "360.0003"),
        ("180", "539.9998"),
        ("0", "359.9999"),
        ("30", "29.9999"),
        ("0", "-0.0001"),
        ("-90", "270.00001"),
        ("360", "0"),
    ];
    let parameters = [
        ("0", "6.28318531"),
        ("3.141592654", "9.42477797"),
        ("0", "6.283185"),
        ("1.5707963", "7.8539816"),
        ("0", "6.28319"),
        ("-3.14159", "3.14159"),
    ];
    let mut drawn: Vec<(String, [f64; 2])> = Vec::new();
    for (start, end) in turns {
        drawn.push((arc("10", start, end, ""), [10.0, 10.0]));
        for counter_clockwise in [0, 1] {
            drawn.push((round_fill(circle, start, end, counter_clockwise), [10.0, 10.0]));
            drawn.push((round_fill(oval, start, end, counter_clockwise), [10.0, 5.0]));
        }
        drawn.push((arc("10", start, end, "210\n0\n220\n0\n230\n-1\n"), [10.0, 10.0]));
    }
    for (start, end) in parameters {
        drawn.push((ellipse(start, end, ""), [10.0, 5.0]));
        drawn.push((ellipse(start, end, "210\n0\n220\n0\n230\n-1\n"), [10.0, 5.0]));
    }
    for (entity, [width, height]) in drawn {
        for strict in [false, true] {
            let options = PatternOptions::default().strictly(strict);
            // Directly, and mirrored and rotated inside a block.
            let alone = drawing(&entity, "");
            let mirrored = drawing(&insert("B", "41\n-1\n42\n1\n50\n180\n"), &block("B", &entity));
            for file in [alone, mirrored] {
                let read =
                    read(file.as_bytes(), &options).unwrap_or_else(|error| panic!("{error}\n{entity}"));
                let [path] = read.pattern.paths.as_slice() else { panic!("{entity}") };
                assert!(path.shape.is_closed(), "{entity}");
                let points = path.shape.flattened(1e-5);
                let found = area(&points).abs();
                let whole = std::f64::consts::PI * width * height;
                assert!((found - whole).abs() < 1e-3, "{found} is not {whole}: {entity}");
                assert!(read.facts.skipped.is_empty() && read.facts.repairs.is_empty(), "{:?}", read.facts);
            }
        }
    }
}

#[test]
fn short_arcs_stay_short() {
    // A degree, an angle just above rounding, and a tiny angle on a large radius.
    for (radius, start, end, length) in [
        ("10", "0", "1", 10f64.to_radians()),
        ("10", "359.5", "360.5", 10f64.to_radians()),
        ("10", "0", "0.001", 10.0 * 0.001f64.to_radians()),
        ("100000", "90", "90.0004", 1e5 * 0.0004f64.to_radians()),
        ("10", "0.001", "0", 10.0 * 359.999f64.to_radians()),
    ] {
        let options = PatternOptions::default().strictly(true);
        let file = drawing(&arc(radius, start, end, ""), "");
        let read = read(file.as_bytes(), &options).unwrap();
        let [path] = read.pattern.paths.as_slice() else { panic!("{:?}", read.pattern.paths) };
        let found = self::length(path);
        assert!(!path.shape.is_closed() && (found - length).abs() < 1e-4 * length, "{found} is not {length}");
    }
}

/// The types of the entities that are lost ink.
fn lost(reading: &PatternReading) -> Vec<&str> {
    let lost = reading.facts.lost_ink(|_| true).0;
    assert!(lost.iter().all(|skipped| skipped.is_loss && skipped.is_ink), "{lost:?}");
    lost.iter().map(|skipped| skipped.entity.as_str()).collect()
}

#[test]
fn round_entities_with_a_radius_that_draw_nothing_are_lost_ink() {
    let besides = line(["0", "0", "1", "1"]);
    let circle = "0\nCIRCLE\n5\nC1\n8\nMARK\n10\n0\n20\n0\n40\n0.0000001\n".to_owned();
    // It is unknown whether such an arc was a rounded full turn or the rest of a trimmed curve.
    for (entity, kind) in [
        (arc("10", "90", "90.000001", ""), "ARC"),
        (arc("10", "0", "0.0001", ""), "ARC"),
        (arc("0.0000001", "0", "180", ""), "ARC"),
        (ellipse("0", "0.000001", ""), "ELLIPSE"),
        (circle.clone(), "CIRCLE"),
    ] {
        let reading = whole(&(entity.clone() + &besides), "");
        assert_eq!(lost(&reading), [kind], "{entity}");
        let why = reading.facts.skipped[0].why.as_ref();
        assert!(why.contains("draws nothing, with a radius of ") && why.contains("draw it again"), "{why}");
        assert_eq!(reading.pattern.paths.len(), 1);
    }
    // Scaled down by its block.
    let small = whole(
        &(insert("B", "41\n1e-8\n42\n1e-8\n43\n1e-8\n") + &besides),
        &block("B", &arc("10", "0", "180", "")),
    );
    assert_eq!(lost(&small), ["ARC"]);
    // Without a radius it draws nothing in any program.
    let none = whole(&(circle.replace("0.0000001", "0") + &besides), "");
    assert_eq!((lost(&none), none.facts.skipped[0].is_loss), (vec![], false));
}

#[test]
fn lost_ink_is_distinguished_from_other_skipped_entities() {
    let besides = line(["0", "0", "1", "1"]);
    let simple = |kind: &str| format!("0\n{kind}\n5\n77\n8\nMARK\n10\n0\n20\n0\n11\n1\n21\n1\n");
    let text = |words: &str| format!("0\nTEXT\n5\n77\n8\nMARK\n10\n0\n20\n0\n40\n3\n1\n{words}\n");
    let spline =
        |knots: &str| format!("0\nSPLINE\n5\n77\n8\nMARK\n70\n0\n71\n3\n{knots}10\n0\n20\n0\n10\n9\n20\n0\n");
    let fit = |x: u8| format!("0\nSPLINE\n5\n77\n8\nMARK\n70\n0\n71\n3\n11\n0\n21\n0\n11\n{x}\n21\n0\n");
    let in_space = "0\nPOLYLINE\n5\n77\n8\nMARK\n70\n64\n0\nSEQEND\n".to_owned();
    let frame = "0\nPOLYLINE\n5\n77\n8\nMARK\n70\n4\n0\nVERTEX\n8\nMARK\n10\n0\n20\n0\n70\n16\n\
                 0\nVERTEX\n8\nMARK\n10\n9\n20\n0\n70\n16\n0\nSEQEND\n"
        .to_owned();
    let mut ink: Vec<String> = [
        "3DFACE",
        "3DSOLID",
        "BODY",
        "REGION",
        "MESH",
        "LEADER",
        "MULTILEADER",
        "MLINE",
        "ACAD_TABLE",
        "IMAGE",
        "OLE2FRAME",
        "WIPEOUT",
        "PDFUNDERLAY",
        "TOLERANCE",
        "SHAPE",
        "RTEXT",
        "DIMENSION",
        "ACAD_PROXY_ENTITY",
        "NEVER_HEARD_OF",
    ]
    .iter()
    .map(|kind| simple(kind))
    .collect();
    ink.extend([text("株"), text("good 株"), spline("40\n0\n40\n1\n"), in_space, frame]);
    ink.push(text("株").replace("0\nTEXT", "0\nMTEXT"));
    ink.push(insert("NOT THERE", ""));
    for entity in &ink {
        let reading = whole(&(entity.clone() + &besides), "");
        assert_eq!(lost(&reading).len(), 1, "{entity}: {:?}", reading.facts.skipped);
        assert!(has_notice(&reading, "not-taken", Severity::Warning), "{entity}");
    }
    // Listed, but not lost ink: entities that draw nothing, construction lines, and hidden or not plotted entities.
    let single = "0\nLWPOLYLINE\n5\n77\n8\nMARK\n90\n1\n70\n0\n10\n1\n20\n1\n".to_owned();
    let template = "0\nATTDEF\n5\n77\n8\nMARK\n10\n0\n20\n0\n40\n3\n1\nX\n2\nTAG\n70\n0\n".to_owned();
    let mut none: Vec<String> =
        ["RAY", "XLINE", "VIEWPORT", "LIGHT", "SEQEND"].iter().map(|kind| simple(kind)).collect();
    none.extend([single, template, text(""), text("   "), text("\\U+200B\\U+FEFF"), fit(0)]);
    none.push(simple("3DFACE").replace("MARK\n", "MARK\n60\n1\n"));
    none.push(simple("3DFACE").replace("MARK\n", "MARK\n67\n1\n"));
    none.push(simple("3DFACE").replace("MARK", "Defpoints"));
    for entity in &none {
        let reading = whole(&(entity.clone() + &besides), "");
        assert!(lost(&reading).is_empty(), "{entity}: {:?}", reading.facts.skipped);
        assert_eq!(reading.facts.skipped.len(), 1, "{entity}");
    }
    // Invisible characters beside letters do not matter.
    assert!(whole(&(text("A\\U+200B\\U+2003B\\U+202E") + &besides), "").facts.skipped.is_empty());
    assert!(whole(&fit(9), "").facts.skipped.is_empty());
}

#[test]
fn lost_ink_is_listed_with_its_final_layer() {
    let face = |layer: &str| format!("0\n3DFACE\n5\n77\n8\n{layer}\n10\n0\n20\n0\n");
    let on = |layer: &str| insert("B", "").replace("INSERT\n8\n0", &format!("INSERT\n8\n{layer}"));
    let content = block("B", &(face("0") + &face("OWN")));
    let reading = whole(&(on("MARK") + &on("MARK") + &on("NOTES") + &line(["0", "0", "1", "1"])), &content);
    let layers: Vec<&str> =
        reading.facts.lost_ink(|_| true).0.iter().map(|skipped| skipped.layer.as_str()).collect();
    assert_eq!(layers, ["MARK", "OWN", "NOTES"]);
    assert_eq!(reading.facts.lost_ink(|layer| layer == "NOTES").0.len(), 1);
    assert_eq!(reading.facts.lost_ink(|layer| layer == "0").0.len(), 0);
}

#[test]
fn a_long_list_of_lost_ink_is_shortened() {
    let face = |number: usize| format!("0\n3DFACE\n5\n{number:X}\n8\nL{}\n10\n0\n20\n0\n", number % 50);
    let many: String = (0..5000).map(face).collect();
    let reading = whole(&(many + &line(["0", "0", "1", "1"])), "");
    let lost = reading.facts.lost_ink(|_| true);
    let text = lost.to_string();
    assert_eq!(lost.0.len(), 5000);
    assert!(text.starts_with("3DFACE 0, 32, 64 and 97 more on layer L0: it is a surface"), "{text}");
    assert!(text.ends_with("and 4400 more") && text.len() < 1000, "{text}");
}

/// A polyline around a square of 10 mm that returns to its first point, except for a gap, without the closed flag.
fn square_with_gap(gap: &str) -> String {
    let corners = [("0", "0"), ("10", "0"), ("10", "10"), ("0", "10"), ("0", gap)];
    let points: String = corners.iter().map(|(x, y)| format!("10\n{x}\n20\n{y}\n")).collect();
    format!("0\nLWPOLYLINE\n5\n5A\n8\nMARK\n90\n5\n70\n0\n{points}")
}

#[test]
fn a_gap_within_rounding_does_not_open_a_contour() {
    use isomark::geometry::ink::Ink;
    let inked = |reading: &PatternReading| Ink::sample(&reading.pattern, |_| true, 0.25, 0.1).area();
    for options in
        [PatternOptions::default().strictly(true), PatternOptions::default().with_joining_tolerance(0.0)]
    {
        for gap in ["0", "1e-15", "-1e-15", "0.0000009"] {
            let read = read(drawing(&square_with_gap(gap), "").as_bytes(), &options).unwrap();
            assert!(read.facts.notices.iter().all(|notice| notice.code != "nearly-closed"), "{gap}");
            // The sampled area may be off by a row of squares.
            assert!((inked(&read) - 100.0).abs() < 1.01, "{gap}: {}", inked(&read));
            // The drawing is unchanged.
            assert!(matches!(&read.pattern.paths[0].shape, Shape::Open(sides) if sides.len() == 4), "{gap}");
        }
        let open = read(drawing(&square_with_gap("0.001"), "").as_bytes(), &options).unwrap();
        assert!(has_notice(&open, "nearly-closed", Severity::Warning) && inked(&open) == 0.0);
    }
}
