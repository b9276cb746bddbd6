//! SVG drawings: compared with closed forms, with the pixels of resvg at 1219 per inch and with Inkscape's own DXF export.
//! `tests/data/patterns/svg/make.py` measured the pixels.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic")]

use std::collections::BTreeMap;
use std::f64::consts::PI;

use fs_err as fs;
use isomark::formats::pattern::{
    DrawingUnit, PatternFacts, PatternOptions, PatternReadError, PatternReading, RasterOptions, Strokes,
    is_complete, read,
};
use isomark::geometry::pattern::{Color, Path, Segment, Shape};
use isomark::geometry::space::FlatPoint;
use isomark::reason::Severity;
use serde_json::Value;

mod schemas;

const HEAD: &str = "<svg xmlns=\"http://www.w3.org/2000/svg\" xmlns:xlink=\"http://www.w3.org/1999/xlink\" \
                    xmlns:inkscape=\"http://www.inkscape.org/namespaces/inkscape\" ";
const MOUSE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/parts/mouse.glb");

fn data(name: &str) -> Vec<u8> {
    fs::read(format!("{}/tests/data/patterns/svg/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

/// A drawing on a page of 60 x 40 mm with units of 1 mm.
fn page(content: &str) -> String {
    format!("{HEAD}width=\"60mm\" height=\"40mm\" viewBox=\"0 0 60 40\">{content}</svg>")
}

fn try_read(text: &str) -> Result<PatternReading, PatternReadError> {
    read(text.as_bytes(), &PatternOptions::default())
}

#[track_caller]
fn drawn(content: &str) -> PatternReading {
    try_read(&page(content)).unwrap()
}

fn codes(facts: &PatternFacts) -> Vec<&str> {
    facts.notices.iter().map(|notice| notice.code.as_str()).collect()
}

fn extents(reading: &PatternReading) -> [f64; 4] {
    reading.facts.extents
}

#[track_caller]
fn near(found: [f64; 4], expected: [f64; 4]) {
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}, not {expected:?}");
}

/// Area and centroid of everything that regions cover, by rows of 1/4800 inch.
fn covered(paths: &[Path]) -> [f64; 3] {
    const PIXEL: f64 = 25.4 / 4800.0;
    let mut regions: BTreeMap<u32, Vec<Vec<FlatPoint>>> = BTreeMap::new();
    for path in paths.iter().filter(|path| path.region.is_some()) {
        regions.entry(path.region.unwrap()).or_default().push(path.shape.flattened(1e-3));
    }
    let mut moments = [0.0; 3];
    for row in 0..8400 {
        let y = (f64::from(row) + 0.5) * PIXEL - 1.0;
        let mut spans: Vec<[f64; 2]> = Vec::new();
        for region in regions.values() {
            let mut crossings: Vec<f64> = region
                .iter()
                .flat_map(|contour| contour.iter().zip(contour.iter().cycle().skip(1)))
                .filter(|(a, b)| (a.y > y) != (b.y > y))
                .map(|(a, b)| a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x))
                .collect();
            crossings.sort_by(f64::total_cmp);
            spans.extend(crossings.chunks_exact(2).map(|pair| [pair[0], pair[1]]));
        }
        spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut reached = f64::NEG_INFINITY;
        for [from, to] in spans {
            let from = from.max(reached);
            if to > from {
                let area = (to - from) * PIXEL;
                moments[0] += area;
                moments[1] += area * (from + to) / 2.0;
                moments[2] += area * y;
                reached = to;
            }
        }
    }
    [moments[0], moments[1] / moments[0], moments[2] / moments[0]]
}

#[test]
fn areas_are_those_of_the_pixels_that_resvg_draws() {
    let table = String::from_utf8(data("pixels.tsv")).unwrap();
    let mut judged = 0;
    for line in table.lines().filter(|line| !line.starts_with('#')) {
        let fields: Vec<&str> = line.split('\t').collect();
        let expected: Vec<f64> = fields[1..].iter().map(|field| field.parse().unwrap()).collect();
        let options = PatternOptions::default().with_strokes(Strokes::Band);
        let reading = read(&data(&format!("{}.svg", fields[0])), &options).unwrap();
        assert!(reading.facts.skipped.iter().all(|skipped| !skipped.is_ink), "{line}");
        let found = covered(&reading.pattern.paths);
        println!("{}: {found:.4?}, pixels {expected:.4?}", fields[0]);
        let off = (found[0] / expected[0] - 1.0).abs();
        assert!(off < 5e-4, "{}: {found:?}, pixels {expected:?}", fields[0]);
        // Half a pixel.
        let moved = (found[1] - expected[1]).hypot(found[2] - expected[2]);
        assert!(moved < 0.01, "{}: {found:?}, pixels {expected:?}", fields[0]);
        judged += 1;
    }
    assert_eq!(judged, 32);
}

#[test]
fn paths_are_where_inkscape_exports_them() {
    let points = |bytes: &[u8]| {
        let reading = read(bytes, &PatternOptions::default()).unwrap();
        reading.pattern.paths.iter().flat_map(|path| path.shape.flattened(1e-3)).collect::<Vec<_>>()
    };
    let (own, exported) = (points(&data("inkscape.svg")), points(&data("inkscape.dxf")));
    let segments = |points: &[FlatPoint], at: FlatPoint| {
        points.iter().map(|point| point.distance(at)).fold(f64::INFINITY, f64::min)
    };
    // The corners of the export are corners here; between them both flatten differently.
    for at in &exported {
        assert!(segments(&own, *at) < 0.1, "{at:?}");
    }
    let layers = |bytes: &[u8]| -> Vec<String> {
        let reading = read(bytes, &PatternOptions::default()).unwrap();
        reading.pattern.layers.into_iter().map(|layer| layer.name).collect()
    };
    assert_eq!(layers(&data("inkscape.svg")), ["MARK", "FRAME"]);
    let size = |bytes: &[u8]| read(bytes, &PatternOptions::default()).unwrap().facts.extents;
    let (own, exported) = (size(&data("inkscape.svg")), size(&data("inkscape.dxf")));
    assert!(own.iter().zip(exported).all(|(a, b)| (a - b).abs() < 1e-3), "{own:?} {exported:?}");
}

#[test]
fn circles_and_arcs_stay_exact() {
    let circle = drawn("<circle cx='30' cy='10' r='7' fill='none' stroke='black'/>");
    let [Path { shape: Shape::Closed(segments), region: None, .. }] = circle.pattern.paths.as_slice() else {
        panic!("{:?}", circle.pattern.paths);
    };
    assert!(matches!(segments.as_slice(), [Segment::Arc { .. }]));
    let center = FlatPoint::new(30.0, 30.0);
    assert!(
        (0..=100)
            .all(|step| (segments[0].point(f64::from(step) / 100.0).distance(center) - 7.0).abs() < 1e-12)
    );
    // A quarter of a circle of radius 10 about (20, 20) in the file.
    let arc = drawn("<path fill='none' stroke='red' d='M10 20A10 10 0 0 1 20 10'/>");
    let segments = arc.pattern.paths[0].shape.segments();
    let center = FlatPoint::new(20.0, 20.0);
    assert!(
        (0..=10)
            .all(|step| (segments[0].point(f64::from(step) / 10.0).distance(center) - 10.0).abs() < 1e-12)
    );
    near(extents(&arc), [10.0, 20.0, 20.0, 30.0]);
    assert_eq!(arc.pattern.paths[0].color, Color::Rgb { aci: 1, rgb: [255, 0, 0] });
    // Radii that are too small are enlarged: half a circle of radius 5.
    let half = drawn("<path fill='none' stroke='red' d='M10 20A1 1 0 0 1 20 20'/>");
    near(extents(&half), [10.0, 20.0, 20.0, 25.0]);
}

#[test]
fn round_corners_are_quarters_of_ellipses() {
    let reading = drawn("<rect x='5' y='6' width='40' height='20' rx='8' ry='4'/>");
    near(extents(&reading), [5.0, 14.0, 45.0, 34.0]);
    let [area, ..] = covered(&reading.pattern.paths);
    assert!((area - (800.0 - (4.0 - PI) * 32.0)).abs() < 0.15, "{area}");
    assert_eq!(reading.pattern.paths[0].shape.segments().len(), 8);
}

#[test]
fn transforms_copies_and_nested_drawings_are_placed() {
    for (content, expected) in [
        ("<g transform='translate(10 5) scale(2)'><path d='M1 1h3v4h-3z'/></g>", [12.0, 25.0, 18.0, 33.0]),
        ("<path transform='rotate(90 10 10)' d='M10 10h5v2h-5z'/>", [8.0, 25.0, 10.0, 30.0]),
        ("<defs><path id='a' d='M0 0h3v4h-3z'/></defs><use href='#a' x='5' y='6'/>", [5.0, 30.0, 8.0, 34.0]),
        (
            "<symbol id='s' viewBox='0 0 2 4'><path d='M0 0h2v4h-2z'/></symbol>\
          <use xlink:href='#s' x='10' y='10' width='8' height='8'/>",
            [12.0, 22.0, 16.0, 30.0],
        ),
        (
            "<svg x='10' y='10' width='20' height='10' viewBox='0 0 4 2'><path d='M1 0h2v1h-2z'/></svg>",
            [15.0, 25.0, 25.0, 30.0],
        ),
        // SVG 2, section 5.5: a symbol has a position, and its `transform` applies in every copy.
        (
            "<symbol id='s' x='2' y='3' width='20' height='20'><path d='M0 0h3v4h-3z'/></symbol><use href='#s' x='3' y='3'/>",
            [5.0, 30.0, 8.0, 34.0],
        ),
        (
            "<symbol id='s' transform='translate(10 5) scale(2)'><path d='M1 1h3v4h-3z'/></symbol><use href='#s'/>",
            [12.0, 25.0, 18.0, 33.0],
        ),
        ("<path style='transform: rotate(0) translate(3px, 0)' d='M1 1h5v5z'/>", [4.0, 34.0, 9.0, 39.0]),
        ("<rect x='10%' y='10%' width='50%' height='50%'/>", [6.0, 16.0, 36.0, 36.0]),
        // A quarter turn around (30, 10); the middle of the page is (30, 20).
        (
            "<path transform='rotate(90)' transform-origin='30 10' d='M30 10h5v2h-5z'/>",
            [28.0, 25.0, 30.0, 30.0],
        ),
        (
            "<g style='transform: rotate(90deg); transform-origin: center'><path d='M30 20h5v2h-5z'/></g>",
            [28.0, 15.0, 30.0, 20.0],
        ),
        (
            "<path transform='scale(2)' transform-origin='bottom right' d='M50 30h5v5h-5z'/>",
            [40.0, 10.0, 50.0, 20.0],
        ),
        ("<path transform='translate(3 4)' transform-origin='30 10' d='M1 1h5v5z'/>", [4.0, 30.0, 9.0, 35.0]),
        ("<rect style='x: 5px; width: 10px' x='1' y='6' height='4'/>", [5.0, 30.0, 15.0, 34.0]),
        ("<style>circle { r: 3px }</style><circle cx='20' cy='10' r='1'/>", [17.0, 27.0, 23.0, 33.0]),
        (
            "<rect x='0.5cm' y='5' width='1in' height='10'/>",
            [5.0 * 96.0 / 25.4, 25.0, 5.0 * 96.0 / 25.4 + 96.0, 35.0],
        ),
    ] {
        near(extents(&drawn(content)), expected);
    }
}

#[test]
fn nested_drawings_are_cut_at_their_edges() {
    let inside = "<rect x='-5' y='-5' width='100' height='9'/>";
    for (overflow, expected) in
        [("", [10.0, 26.0, 30.0, 30.0]), ("overflow='visible'", [5.0, 26.0, 105.0, 35.0])]
    {
        for content in [
            format!("<svg x='10' y='10' width='20' height='10' {overflow}>{inside}</svg>"),
            format!(
                "<symbol id='s' {overflow}>{inside}</symbol><use href='#s' x='10' y='10' width='20' height='10'/>"
            ),
        ] {
            let reading = drawn(&content);
            near(extents(&reading), expected);
            assert_eq!(codes(&reading.facts).contains(&"svg-clipped"), overflow.is_empty(), "{content}");
        }
    }
    // Turned by 45 degrees, the edges of a square reach over half a diagonal.
    let turned = drawn(
        "<g transform='translate(30 5) rotate(45)'><svg width='10' height='10'><rect width='30' height='30'/></svg></g>",
    );
    let half = 50.0_f64.sqrt();
    let found = extents(&turned);
    let expected = [30.0 - half, 35.0 - 2.0 * half, 30.0 + half, 35.0];
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
}

/// A clip path is in the units of what it cuts. Here, these are the units of the `viewBox`: half as large as those of the page, from (10,
/// 10). Chromium draws the same.
#[test]
fn clip_paths_of_nested_drawings_and_symbols_are_in_their_units() {
    let clip = "<clipPath id='c'><rect x='2' y='1' width='4' height='6'/></clipPath>";
    let at = "width='20' height='10' viewBox='0 0 40 20'";
    let inside = "clip-path='url(#c)'><rect width='30' height='18'/>";
    for content in [
        format!("<svg x='10' y='10' {at} {inside}</svg>"),
        format!("<svg x='10' y='10' {at} overflow='visible' {inside}</svg>"),
        format!(
            "<symbol id='s' viewBox='0 0 40 20' {inside}</symbol><use href='#s' x='10' y='10' width='20' height='10'/>"
        ),
        format!("<defs><svg id='s' {at} {inside}</svg></defs><use href='#s' x='10' y='10'/>"),
        format!("<g transform='translate(10 10) scale(0.5)'><g {inside}</g></g>"),
    ] {
        let reading = drawn(&format!("{clip}{content}"));
        near(extents(&reading), [11.0, 26.5, 13.0, 29.5]);
    }
}

/// The position of a copy is part of its transform, inside which its clip path is: SVG 2, section 5.6. Chromium draws the same, resvg
/// all but the symbol.
#[test]
fn the_clip_path_of_a_copy_moves_with_its_position() {
    let clip = "<clipPath id='c'><rect width='10' height='8'/></clipPath>";
    for (copied, way, expected) in [
        ("<rect id='r' width='20' height='20'/>", "", [10.0, 27.0, 20.0, 35.0]),
        ("<rect id='r' width='20' height='20'/>", "transform='scale(2)'", [20.0, 14.0, 40.0, 30.0]),
        ("<g id='r'><rect width='20' height='20'/></g>", "", [10.0, 27.0, 20.0, 35.0]),
        (
            "<symbol id='r' viewBox='0 0 5 5'><rect width='20' height='20'/></symbol>",
            "width='20' height='20'",
            [10.0, 27.0, 20.0, 35.0],
        ),
        (
            "<svg id='r' x='2' viewBox='0 0 5 5' width='20' height='20'><rect width='20' height='20'/></svg>",
            "",
            [12.0, 27.0, 20.0, 35.0],
        ),
    ] {
        let content =
            format!("{clip}<defs>{copied}</defs><use href='#r' x='10' y='5' clip-path='url(#c)' {way}/>");
        let reading = drawn(&content);
        near(extents(&reading), expected);
        assert!(reading.facts.skipped.is_empty(), "{content}");
    }
}

/// SVG 2, section 16.1.6; Chromium and resvg draw the same.
#[test]
fn of_two_links_the_one_without_xlink_applies() {
    let shapes = "<rect id='a' width='20' height='20'/><rect id='b' x='3' y='3' width='4' height='5'/>";
    for links in ["xlink:href='#a' href='#b'", "href='#b' xlink:href='#a'", "xlink:href='#b'"] {
        let copied = drawn(&format!("<defs>{shapes}</defs><use {links}/>"));
        near(extents(&copied), [3.0, 32.0, 7.0, 37.0]);
        let cut = drawn(&format!(
            "<defs>{shapes}</defs><clipPath id='c'><use {links}/></clipPath>\
             <rect width='60' height='40' clip-path='url(#c)'/>"
        ));
        near(extents(&cut), [3.0, 32.0, 7.0, 37.0]);
    }
}

/// Chromium shows the second rectangle.
#[test]
fn attributes_of_editors_are_not_those_of_svg() {
    let editor = "xmlns:e='http://example.com/editor'";
    let drawing = drawn(&format!(
        "<rect {editor} e:x='9' x='3' e:width='50' y='3' width='4' height='5' e:height='1' e:fill='none' e:display='none'/>"
    ));
    near(extents(&drawing), [3.0, 32.0, 7.0, 37.0]);
}

#[test]
fn definitions_inherit_from_their_own_place() {
    let star = "<path d='M100 15l50 160l-130 -100l160 0l-130 100z' transform='scale(0.2)'/>";
    let area = |rule: &str, at_mark: &str| {
        let content = format!(
            "<g clip-rule='{rule}'><clipPath id='c'>{star}</clipPath></g>\
             <g clip-rule='{at_mark}'><rect width='60' height='40' clip-path='url(#c)'/></g>"
        );
        covered(&drawn(&content).pattern.paths)[0]
    };
    assert_eq!(area("evenodd", "nonzero"), area("evenodd", "evenodd"));
    assert_eq!(area("nonzero", "evenodd"), area("nonzero", "nonzero"));
    assert!(area("evenodd", "nonzero") < 0.8 * area("nonzero", "evenodd"));
    // The colour of a copy is that of its `use`; elsewhere there is none.
    let mark = "<path d='M1 1h5v5h-5z' fill='context-fill'/>";
    let copied =
        drawn(&format!("<defs><g id='m'>{mark}</g></defs>{mark}<use href='#m' x='10' fill='#123456'/>"));
    assert_eq!(copied.pattern.paths.len(), 1);
    assert!(matches!(copied.pattern.paths[0].color, Color::Rgb { rgb: [0x12, 0x34, 0x56], .. }));
}

#[test]
fn the_size_of_the_page_gives_the_scale() {
    let rect = "<rect x='10' y='20' width='30' height='40'/></svg>";
    let pixel = 25.4 / 96.0;
    for (page, expected, unit) in [
        ("width='100mm' height='100mm' viewBox='0 0 100 100'", [10.0, 40.0, 40.0, 80.0], "mm"),
        ("width='10cm' height='10cm' viewBox='0 0 1000 1000'", [1.0, 94.0, 4.0, 98.0], "cm"),
        ("width='1in' height='1in' viewBox='0 0 100 100'", [2.54, 10.16, 10.16, 20.32], "in"),
        ("width='72pt' height='72pt' viewBox='0 0 100 100'", [2.54, 10.16, 10.16, 20.32], "pt"),
        ("width='100' height='100'", [10.0 * pixel, 40.0 * pixel, 40.0 * pixel, 80.0 * pixel], "px"),
        ("viewBox='0 0 100 100'", [10.0 * pixel, 40.0 * pixel, 40.0 * pixel, 80.0 * pixel], "px"),
        (
            "width='100%' height='100%' viewBox='0 0 100 100'",
            [10.0 * pixel, 40.0 * pixel, 40.0 * pixel, 80.0 * pixel],
            "px",
        ),
        // Half the page stays empty on the left, because the drawing keeps its shape.
        (
            "width='200mm' height='100mm' viewBox='0 0 100 100' preserveAspectRatio='xMaxYMid'",
            [110.0, 40.0, 140.0, 80.0],
            "mm",
        ),
        (
            "width='200mm' height='100mm' viewBox='0 0 100 100' preserveAspectRatio='none'",
            [20.0, 40.0, 80.0, 80.0],
            "mm",
        ),
        ("width='100mm' height='100mm' viewBox='-10 -20 100 100'", [20.0, 20.0, 50.0, 60.0], "mm"),
    ] {
        let reading = try_read(&format!("{HEAD}{page}>{rect}")).unwrap();
        near(extents(&reading), expected);
        assert_eq!(reading.facts.unit.to_string(), unit, "{page}");
    }
    // Units of CSS, in any case, a blank that can mean nothing else, and styles, which win over attributes.
    for (page, factor, unit) in [
        ("width='160Q' height='80Q'", 1.0, "mm"),
        ("width='40MM' height='20Mm'", 1.0, "mm"),
        ("width=' 40 mm ' height='20 mm'", 1.0, "mm"),
        ("width='40mm' style='width: 80MM'", 2.0, "mm"),
        ("style='width:8cm;height:4cm'", 2.0, "cm"),
        ("width='4cm' height='2cm' style='width:100%;height:auto'", 1.0, "cm"),
        ("style='font-size:10mm;width:4em'", 1.0, "px"),
        ("style='font-size:5mm' width='8rem'", 1.0, "px"),
        ("style='--w:80mm;width:var(--w)'", 2.0, "mm"),
        ("style='width:var(--w, 80mm)'", 2.0, "mm"),
        ("class='a' width='4mm'", 2.0, "mm"),
        ("class='b' style='width:8mm'", 0.5, "mm"),
        ("width='40mm' style='max-width:100%;max-height:900px'", 1.0, "mm"),
    ] {
        let sheet = "<style>svg.a{width:80mm} .b{width:20mm!important} @media print{svg{width:1mm}}</style>";
        let reading = try_read(&format!(
            "{HEAD}{page} viewBox='0 0 40 20'>{sheet}<rect x='5' y='5' width='30' height='10'/></svg>"
        ))
        .unwrap();
        near(extents(&reading), [5.0, 5.0, 35.0, 15.0].map(|side| side * factor));
        assert_eq!(reading.facts.unit.to_string(), unit, "{page}");
        assert!(
            reading.facts.unit_why.contains(&format!("{:.3} x", 40.0 * factor)),
            "{}",
            reading.facts.unit_why
        );
    }
    let unsized_page = try_read(&format!("{HEAD}viewBox='0 0 100 100'>{rect}")).unwrap();
    assert!(unsized_page.facts.unit_why.contains("states no size, so its units are pixels of 1/96 inch"));
    for page in ["viewBox='0 0 100 100'", "viewBox='0 0 100 100' width='100%' height='100%'", ""] {
        let reading = try_read(&format!("{HEAD}{page}>{rect}")).unwrap();
        let notice = reading.facts.notices.iter().find(|notice| notice.code == "unit-assumed");
        assert!(notice.is_some_and(|notice| notice.message.contains("pixels of 1/96 inch")), "{page}");
    }
    for page in ["width='100' height='100'", "width='40mm' viewBox='0 0 100 100'"] {
        let reading = try_read(&format!("{HEAD}{page}>{rect}")).unwrap();
        assert!(!codes(&reading.facts).contains(&"unit-assumed"), "{page}");
    }
    let sized = PatternOptions::default().with_picture(RasterOptions::default().with_width(50.0));
    let reading = read(format!("{HEAD}viewBox='0 0 100 100'>{rect}").as_bytes(), &sized).unwrap();
    assert!(!codes(&reading.facts).contains(&"unit-assumed"));
    let reading = read(format!("{HEAD}width='100' height='100'>{rect}").as_bytes(), &sized).unwrap();
    near(extents(&reading), [5.0, 20.0, 20.0, 40.0]);
    assert!(reading.facts.unit_why.contains("the settings give its size"), "{}", reading.facts.unit_why);
}

#[test]
fn a_page_whose_size_cannot_be_read_is_refused() {
    for (page, text) in [
        ("width='40 furlong'", "40 furlong"),
        ("width='40,5mm'", "40,5mm"),
        ("height='2x'", "2x"),
        ("width='calc(4cm)'", "calc(4cm)"),
        ("width='50vw'", "50vw"),
        ("width='0'", "is not a size: 0"),
        ("width='-4mm'", "-4mm"),
        ("width='40mm' style='width:40'", "has no unit, and CSS ignores it in a style: 40"),
        ("width='40mm' style='height:min(2cm, 3cm)'", "min(2cm, 3cm)"),
        ("width='40mm' style='max-width:20mm'", "20mm"),
        ("width='40mm' style='min-height:30mm'", "30mm"),
        ("width='40mm' class='a'", "svg:what"),
        ("width='40mm' viewBox='0 0 40'", "0 0 40"),
        ("width='40mm' viewBox='0 0 40 -20'", "0 0 40 -20"),
    ] {
        let view = if page.contains("viewBox") { "" } else { "viewBox='0 0 40 20'" };
        let sheet = if page.contains("class") { "<style>svg:what{width:2mm}</style>" } else { "" };
        let whole = format!("\n{HEAD}{page} {view}>{sheet}<rect width='30' height='10'/></svg>");
        let reason = try_read(&whole).unwrap_err().reason();
        assert!(reason.code == "svg-size" && reason.to_string().contains(text), "{page}: {reason}");
        assert!(reason.to_string().contains("line 2"), "{reason}");
        // A unit in the settings replaces the size.
        if !page.contains("viewBox") {
            let mut by_unit = PatternOptions::default();
            by_unit.unit = Some(DrawingUnit::Millimetre);
            near(extents(&read(whole.as_bytes(), &by_unit).unwrap()), [0.0, 10.0, 30.0, 20.0]);
        }
    }
}

#[test]
fn lengths_have_the_units_of_css_or_are_refused() {
    let pixel = 96.0 / 25.4;
    for (content, expected) in [
        ("<rect x='40Q' y='4' width='2' height='3'/>", [10.0 * pixel, 33.0, 10.0 * pixel + 2.0, 36.0]),
        ("<rect x='1EM' y='4' width='2' height='3' font-size='5'/>", [5.0, 33.0, 7.0, 36.0]),
        ("<g font-size='7'><rect x='1rem' y='4' width='2' height='3'/></g>", [16.0, 33.0, 18.0, 36.0]),
        ("<style>:root{font-size:5px}</style><circle cx='2rem' cy='10' r='.4rem'/>", [8.0, 28.0, 12.0, 32.0]),
        (
            "<path id='a' d='M0 0h3v4h-3z' display='none'/><rect width='9' height='2' rx='auto'/>",
            [0.0, 38.0, 9.0, 40.0],
        ),
        ("<defs><path id='a' d='M0 0h3v4h-3z'/></defs><use href='#a' x='1rem'/>", [16.0, 36.0, 19.0, 40.0]),
        (
            "<svg x='1rem' width='1e1' height='10'><rect width='50' height='5'/></svg>",
            [16.0, 35.0, 26.0, 40.0],
        ),
    ] {
        near(extents(&drawn(content)), expected);
    }
    let mark = "<path id='m' d='M0 0h3v4h-3z'/>";
    for (content, name, text) in [
        ("<rect id='x' x='5furlong' width='2' height='3'/>", "x", "5furlong"),
        ("<rect id='x' x='10,5' width='2' height='3'/>", "x", "10,5"),
        ("<rect id='x' x='4 mm' width='2' height='3'/>", "x", "4 mm"),
        ("<rect id='x' width='calc(1px + 2px)' height='3'/>", "width", "calc(1px + 2px)"),
        ("<rect id='x' style='width:calc(1px + 2px)' height='3'/>", "width", "calc(1px + 2px)"),
        ("<rect id='x' style='width:3' height='3'/>", "width", "3"),
        ("<rect id='x' width='2' height='3' rx='1vw'/>", "rx", "1vw"),
        ("<circle id='x' cx='5furlong' r='3'/>", "cx", "5furlong"),
        ("<circle id='x' r='3ch'/>", "r", "3ch"),
        ("<ellipse id='x' rx='3' ry='1lh'/>", "ry", "1lh"),
        ("<line id='x' x2='3x' stroke='red'/>", "x2", "3x"),
        ("<use id='x' href='#m' y='2vh'/>", "y", "2vh"),
        ("<svg id='x' width='2vmin'><rect width='2' height='3'/></svg>", "width", "2vmin"),
        ("<svg id='x' viewBox='0 0 3'><rect width='2' height='3'/></svg>", "viewBox", "0 0 3"),
        (
            "<symbol id='s'><path d='M0 0h3v4h-3z'/></symbol><use id='x' href='#s' width='2vw'/>",
            "width",
            "2vw",
        ),
        ("<text id='x' x='1 2 3z'>abc</text>", "x", "3z"),
        ("<text id='x' dy='1lh'>abc</text>", "dy", "1lh"),
        ("<text id='x' font-size='5vw'>abc</text>", "font-size", "5vw"),
        ("<path id='x' d='M0 0h9' stroke='red' stroke-width='calc(1px)'/>", "stroke-width", "calc(1px)"),
        ("<path id='x' d='M0 0h9' stroke='red' stroke-dasharray='1 2x'/>", "stroke-dasharray", "1 2x"),
        ("<path id='x' d='M0 0h9' stroke='red' stroke-dasharray='1 2' pathLength='0'/>", "pathLength", "0"),
        ("<path id='x' style='d: path(\"M0 0h9v9z\")'/>", "d", "path("),
        ("<polyline id='x' points='1 2 3 4 oops 5'/>", "points", ""),
        ("<polygon id='x' points='1,5 2,5 3'/>", "points", ""),
        ("<path id='x' d='M0 0h9v9 X'/>", "path data", ""),
        ("<path id='x' d='M0 0h9v9h5v'/>", "path data", ""),
    ] {
        let reading = drawn(&format!("{mark}{content}"));
        let listed: Vec<_> = reading.facts.skipped.iter().filter(|skipped| skipped.is_ink).collect();
        assert_eq!(listed.len(), 1, "{content}: {:?}", reading.facts.skipped);
        let why = &listed[0].why;
        assert_eq!(listed[0].handle.as_deref(), Some("x"), "{content}");
        assert!(why.contains(name) && why.contains(text), "{content}: {why}");
        assert_eq!(reading.pattern.paths.len(), 1, "{content}");
    }
}

#[test]
fn a_drawing_of_which_nothing_can_be_read_names_the_element() {
    let hidden = "<rect width='2' height='3' fill='none'/>";
    let reason = try_read(&page(&format!("{hidden}\n<rect x='5furlong' width='2' height='3'/>")))
        .unwrap_err()
        .reason();
    assert_eq!(reason.code, "pattern-nothing-to-mark");
    let (ink, other) = reason.remedy.rsplit_once(";").unwrap();
    assert!(ink.contains("its `x` of `5furlong`") && ink.contains("(rect in line 2)"), "{}", reason.remedy);
    assert!(other.contains("neither fill nor stroke (rect in line 1)"), "{}", reason.remedy);
}

#[test]
fn style_sheets_are_those_of_css() {
    // Two rectangles; the sheet hides the second one or does not.
    let shown = |sheet: &str| {
        let content = format!(
            "{sheet}<g id='g' class='layer one'><rect id='a' width='5' height='5'/>\
             <rect id='guide1' class='k' x='20' width='5' height='5'/></g>"
        );
        let reading = drawn(&content);
        assert!(
            reading.facts.skipped.iter().all(|skipped| !skipped.is_ink),
            "{sheet}: {:?}",
            reading.facts.skipped
        );
        reading
            .pattern
            .paths
            .iter()
            .map(|path| path.source.handle.clone().unwrap())
            .collect::<Vec<_>>()
            .concat()
    };
    for sheet in [
        "[id^=guide]{display:none}",
        "[id$='1']{fill:none}",
        "[id*=uid]{opacity:0}",
        "rect:not(#a){visibility:hidden}",
        "rect:nth-child(2){DISPLAY:NONE}",
        "#a ~ rect{Fill:NONE}",
        "g > :is(.k, .l){fill:none}",
        "g:has(#a) > rect + rect{fill:none}",
        "@media screen{.k{fill:none}}",
        "@media not print{.k{fill:none}}",
        "@layer x{.k{fill:none}}",
        ":root{--ink:none} .k{fill:var(--ink)}",
        ".k{fill:var(--other, none)}",
        ".k{--a:none} #g{--a:red} rect{fill:var(--a)}",
        "g{--a:none} #a{--a:red} rect{fill:var(--a)}",
        "rect{fill:none} #a{fill:initial}",
        "g{fill:none} #a{fill:red} .k{fill:inherit}",
        "g{fill:none} #a{fill:red} .k{fill:red} .k{fill:unset}",
        "g{fill:none} #a{fill:red} .k{fill:var(--nothing)}",
        ".k{fill:none!important} #guide1{fill:red}",
        "@layer x{.k{fill:none!important}} .k{fill:red!important}",
        "/* .k{fill:red} */.k/**/.k{fill:none}",
        ".k{fill:none;fill:nonsense}",
        ".k{cursor:pointer;display:none}",
        ".\\6b {fill:none}",
        ".k{fill:rgb(0 0 0 / 0)}",
        ".k{fill:RGBA(1, 2, 3, 0%)}",
        ".k{fill:hsl(120deg 50% 50% / 0%)}",
    ] {
        assert_eq!(shown(&format!("<style>{sheet}</style>")), "a", "{sheet}");
    }
    assert_eq!(shown("<style media='screen' type='TEXT/CSS'>.k{fill:none}</style>"), "a");
    for sheet in [
        "@media print{.k{display:none}}",
        "@media (prefers-color-scheme: dark){.k{fill:none}}",
        "@layer x{#guide1{fill:none}} rect{fill:red}",
        "@layer x, y; @layer y{rect{fill:red}} @layer x{#guide1{fill:none}}",
        ".k{fill:none} .k{fill:initial}",
        ".k:hover{display:none}",
        ".k::before{display:none}",
        ".k:nth-child(odd){fill:none}",
        "@keyframes a{from{fill:none}} @font-face{font-family:x} @page{margin:0}",
        ".K, #G > rect{fill:none}",
        ":where(#guide1){fill:none} rect{fill:red}",
        // What cannot be read, but changes nothing.
        "rect:what{cursor:pointer;color-rendering:auto;font-family:x}",
        "circle:what, text:what{fill:none}",
        "@supports (fill:none){circle{fill:none}}",
        "rect:what{fill:none} rect{fill:red!important}",
        "rect{stroke-width:calc(1px + 2px)}",
        "g:what{color:red}",
        ".k{fill:undefined;stroke-dasharray:null;stroke-linecap:null}",
        ".k{mix-blend-mode:multiply;animation:a 2s;transition:all 1s;-inkscape-stroke:none}",
    ] {
        assert_eq!(shown(&format!("<style>{sheet}</style>")), "aguide1", "{sheet}");
    }
    assert_eq!(shown("<style media='print'>.k{fill:none}</style>"), "aguide1");
    assert_eq!(shown("<style type='text/less'>.k{fill:none}</style>"), "aguide1");
}

#[test]
fn rules_that_cannot_be_evaluated_are_named() {
    for (sheet, named) in [
        ("rect:what{fill:none}", "rect:what"),
        ("rect:what{transform:none}", "rect:what"),
        ("rect:what{width:3px}", "rect:what"),
        ("rect,,g{fill:none}", "rect,,g"),
        ("@supports (fill:none){rect{fill:none}}", "supports (fill:none)"),
        ("@media (min-width:9px){rect{visibility:hidden}}", "media (min-width:9px)"),
        ("g{rect{fill:none}}", "`rect`"),
        ("rect:what{--c:none} rect{fill:var(--c)}", "var(--c)"),
        ("rect{--c:var(--d);--d:var(--c);fill:var(--c)}", "var(--c)"),
        ("rect{fill:color-mix(in srgb, red, blue)}", "color-mix"),
        ("rect{stroke:red;stroke-width:calc(1px)}", "stroke-width"),
        ("g{opacity:calc(0)}", "calc(0)"),
        ("rect{all:unset}", "all"),
        ("rect{stroke:CanvasText}", "CanvasText"),
        ("rect{fill:revert-layer}", "revert-layer"),
        ("g{zoom:2}", "zoom"),
    ] {
        let content = format!(
            "<style>{sheet}</style><path style='fill:red' d='M0 0h3v4h-3z'/><g><rect id='x' width='5' height='5'/></g>"
        );
        let reading = drawn(&content);
        let listed: Vec<_> = reading.facts.skipped.iter().filter(|skipped| skipped.is_ink).collect();
        assert!(listed.len() == 1 && listed[0].why.contains(named), "{sheet}: {:?}", reading.facts.skipped);
        assert_eq!(reading.pattern.paths.len(), 1, "{sheet}");
    }
    let imported = drawn("<style>@import url(a.css);</style><rect width='5' height='5'/>");
    let notice = imported.facts.notices.iter().find(|notice| notice.code == "svg-style").unwrap();
    assert!(notice.message.contains("url(a.css)"), "{}", notice.message);
}

/// Unicode Standard Annex #15: `A` and U+0308 are the same text as `Ä`.
#[test]
fn accents_behind_letters_give_the_same_outlines_as_composed_letters() {
    let outlines = |words: &str| {
        let text = format!("{HEAD}width='40mm' height='20mm'><text x='5' y='15'>{words}</text></svg>");
        format!(
            "{:?}",
            try_read(&text).unwrap().pattern.paths.iter().map(|path| &path.shape).collect::<Vec<_>>()
        )
    };
    assert_eq!(outlines("KA\u{308}SE c\u{327}a"), outlines("K\u{c4}SE \u{e7}a"));
}

#[test]
fn programs_with_other_pixels_get_a_warning_with_the_other_size() {
    let rect = "<rect width='36' height='36'/></svg>";
    let comment =
        "<!-- Generator: Adobe Illustrator 24.0.1, SVG Export Plug-In . SVG Version: 6.00 Build 0)  -->";
    let of_illustrator = try_read(&format!("{comment}{HEAD}viewBox='0 0 72 72'>{rect}")).unwrap();
    let of_inkscape =
        try_read(&format!("{HEAD}inkscape:version='0.48.4 r9939' width='90' height='90'>{rect}")).unwrap();
    // Without its comment, Illustrator is known by what it alone writes.
    let signs = [
        "style='enable-background:new 0 0 72 72;'",
        "enable-background='new 0 0 72 72'",
        "x='0px' y='0px'",
        "xmlns:i='http://ns.adobe.com/AdobeIllustrator/10.0/'",
    ];
    let by_signs = signs.map(|sign| try_read(&format!("{HEAD}{sign} viewBox='0 0 72 72'>{rect}")).unwrap());
    for reading in [of_illustrator, of_inkscape].into_iter().chain(by_signs) {
        let notice = reading.facts.notices.iter().find(|notice| notice.code == "svg-pixels").unwrap();
        assert!(notice.message.contains("25.400 x 25.400 mm"), "{}", notice.message);
    }
    for page in [
        "inkscape:version='1.2.2 (x)' width='90' height='90'",
        "inkscape:version='0.48 r1' width='9mm' height='9mm'",
    ] {
        assert!(
            !codes(&try_read(&format!("{HEAD}{page}>{rect}")).unwrap().facts).contains(&"svg-pixels"),
            "{page}"
        );
    }
}

#[test]
fn strokes_are_centre_lines_or_bands() {
    let content = "<path id='thick' d='M10 10H30' stroke='black' stroke-width='2'/>\
                   <path d='M10 20H30' stroke='black' stroke-width='0.1'/>";
    let center = drawn(content);
    assert!(center.pattern.paths.iter().all(|path| path.region.is_none()));
    near(extents(&center), [10.0, 20.0, 30.0, 30.0]);
    let notice = center.facts.notices.iter().find(|notice| notice.code == "svg-strokes").unwrap();
    assert!(notice.message.contains("2.000 mm (path thick)"), "{}", notice.message);
    let options = PatternOptions::default().with_strokes(Strokes::Band);
    let band = read(page(content).as_bytes(), &options).unwrap();
    let [area, ..] = covered(&band.pattern.paths);
    assert!((area - (40.0 + 2.0)).abs() < 0.05, "{area}");
    assert!(!codes(&band.facts).contains(&"svg-strokes"));
}

/// The area that strokes cover, mm².
#[track_caller]
fn band_area(content: &str) -> f64 {
    let options = PatternOptions::default().with_strokes(Strokes::Band);
    covered(&read(page(content).as_bytes(), &options).unwrap().pattern.paths)[0]
}

/// Where the rounded end of a contour is not exactly its beginning, the corner between them is that of the contour. The area of a band
/// with mitred corners is its length times its width if all corners are of straight lines; see the closed form below.
#[test]
fn the_last_corner_of_a_contour_is_like_the_others() {
    for turn in 0..24 {
        // The segment of a disc of radius 10 over 120 degrees: an arc and its chord, which meet at 60 degrees.
        let at = |angle: f64| {
            let angle = angle + f64::from(turn) * 0.27 + 0.1;
            [30.0 + 10.0 * angle.cos(), 20.0 + 10.0 * angle.sin()]
        };
        let ([ax, ay], [bx, by]) = (at(0.0), at(2.0 * PI / 3.0));
        let band = |d: String, join: &str| {
            band_area(&format!("<path d='{d}' fill='none' stroke='black' stroke-width='2' {join}/>"))
        };
        let (ends_with_arc, begins_with_arc) = (
            format!("M{bx} {by}L{ax} {ay}A10 10 0 0 1 {bx} {by}z"),
            format!("M{ax} {ay}A10 10 0 0 1 {bx} {by}z"),
        );
        // Outside, the band is that within 1 mm of the convex shape: 1 mm along its outline and discs at its corners. The corners of a
        // mitre are kites with an angle of 120 degrees between the radii, those of a bevel triangles.
        let (arc, chord) = (2.0 * PI / 3.0 * 10.0, 10.0 * 3.0_f64.sqrt());
        let along = arc * 10.5 / 10.0 + chord;
        let corners = |one: f64| along + 2.0 * one;
        let outer = [corners((PI / 3.0).tan()), corners((2.0 * PI / 3.0).sin() / 2.0), corners(PI / 3.0)];
        // Inside, it is what is left of the segment of a disc of radius 9 beyond a chord that is 6 mm from the middle.
        let half = (6.0_f64 / 9.0).acos();
        let segment = |radius: f64, half: f64| radius * radius * (half - half.sin() * half.cos());
        let inner = segment(10.0, PI / 3.0) - segment(9.0, half);
        for (join, outer) in ["", "stroke-linejoin='bevel'", "stroke-linejoin='round'"].into_iter().zip(outer)
        {
            for d in [&ends_with_arc, &begins_with_arc] {
                let found = band(d.clone(), join);
                assert!(
                    (found - outer - inner).abs() < 0.02,
                    "{turn} {join} {d}: {found}, not {}",
                    outer + inner
                );
            }
        }
    }
}

/// Areas by hand; Chromium and resvg draw the same.
#[test]
fn bands_are_whole_at_legs_shorter_than_the_stroke_is_wide() {
    let band = |d: &str, style: &str| {
        // Turned, so that rows of pixels are accurate.
        let turned = "transform='rotate(7 30 20)'";
        band_area(&format!("<path d='{d}' fill='none' stroke='black' stroke-width='8' {turned} {style}/>"))
    };
    // 30 x 8 along the first leg, 4 x 2 of the second one beside it, and half of a square of 4 at the corner.
    for (join, corner) in [("bevel", 8.0), ("miter", 16.0), ("round", 4.0 * PI)] {
        let found = band("M10 20H40V22", &format!("stroke-linejoin='{join}'"));
        assert!((found - 240.0 - 8.0 - corner).abs() < 0.02, "{join}: {found}");
    }
    // Back on itself: only the longer leg, with half a disc at the turn.
    let found = band("M10 20H40H30", "stroke-linejoin='round'");
    assert!((found - 240.0 - 8.0 * PI).abs() < 0.02, "{found}");
    // A ring of 24 short lines around a disc smaller than the stroke is wide: nothing of it is left out. Its outline is 1 mm and the 4 mm of
    // half the stroke from the middle.
    let corners: Vec<String> = (0..24)
        .map(|corner| {
            let angle = PI / 12.0 * f64::from(corner);
            format!("{} {}", 30.0 + angle.cos(), 20.0 + angle.sin())
        })
        .collect();
    let perimeter = 24.0 * 2.0 * (PI / 24.0).sin();
    let polygon = 12.0 * (PI / 12.0).sin();
    let found = band(&format!("M{}z", corners.join(" ")), "stroke-linejoin='round'");
    let expected = polygon + perimeter * 4.0 + PI * 16.0;
    assert!((found - expected).abs() < 0.03, "{found}, not {expected}");
}

/// The width of such a stroke and its dashes are those of the page, whatever the transform; Chromium draws the same.
#[test]
fn strokes_that_do_not_scale_are_those_of_the_page() {
    const PIXEL: f64 = 25.4 / 96.0;
    let fixed = "fill='none' stroke='black' stroke-width='4' vector-effect='non-scaling-stroke'";
    // Along a convex curve, a band covers its length times its width.
    let slant = 40.0_f64.to_radians().tan();
    let ellipse = |step: u32| {
        let (sin, cos) = (f64::from(step) / 5e3 * PI).sin_cos();
        [10.0 * cos + slant * 5.0 * sin, 5.0 * sin]
    };
    let length: f64 = (0..10_000)
        .map(|step| {
            let ([a, b], [c, d]) = (ellipse(step), ellipse(step + 1));
            (a - c).hypot(b - d)
        })
        .sum();
    for circle in ["<circle cx='15' cy='40' r='10'", "<path d='M5 40A10 10 0 1 1 25 40A10 10 0 1 1 5 40z'"] {
        let found = band_area(&format!("<g transform='skewX(40) scale(1 0.5)'>{circle} {fixed}/></g>"));
        let expected = length * 4.0 * PIXEL;
        assert!((found - expected).abs() < 0.01, "{circle}: {found}, not {expected}");
    }
    // Dashes and gaps of 20 pixels along 40 mm.
    let content = format!("<g transform='scale(4 1)'><path d='M2 20H12' {fixed} stroke-dasharray='20'/></g>");
    for strokes in [Strokes::Center, Strokes::Band] {
        let reading =
            read(page(&content).as_bytes(), &PatternOptions::default().with_strokes(strokes)).unwrap();
        let mut spans: Vec<[f64; 2]> = reading
            .pattern
            .paths
            .iter()
            .map(|path| path.shape.extents())
            .map(|extents| [extents.min.x, extents.max.x])
            .collect();
        spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let dash = 20.0 * PIXEL;
        assert_eq!(spans.len(), 4, "{strokes:?}: {spans:?}");
        for (index, span) in spans.iter().enumerate() {
            let from = 8.0 + 2.0 * dash * index as f64;
            assert!((span[0] - from).abs() < 1e-3, "{strokes:?}: {spans:?}");
            assert!((span[1] - (from + dash).min(48.0)).abs() < 1e-3, "{strokes:?}: {spans:?}");
        }
    }
    // One dash that is as long as the contour has no ends.
    let found = band_area(
        "<path d='M15 10l9 12 -12 9 -9 -12z' fill='none' stroke='black' stroke-width='2' stroke-dasharray='100 5'/>",
    );
    assert!((found - (17.0_f64.powi(2) - 13.0_f64.powi(2))).abs() < 0.02, "{found}");
}

#[test]
fn dashes_are_cut_from_the_line() {
    let reading = drawn("<path fill='none' stroke='black' stroke-dasharray='4 2' d='M5 10H55'/>");
    let lengths: Vec<f64> = reading
        .pattern
        .paths
        .iter()
        .map(|path| path.shape.segments()[0].start().distance(path.shape.segments()[0].end()))
        .collect();
    assert_eq!(lengths.len(), 9);
    // Eight whole dashes and the beginning of the ninth.
    assert!((lengths.iter().sum::<f64>() - 34.0).abs() < 1e-3, "{lengths:?}");
    assert!(lengths.iter().all(|length| *length < 4.0 + 1e-3), "{lengths:?}");
}

#[test]
fn dashes_are_shares_of_a_stated_length() {
    // A path of 40 mm that states a length of 10: dashes and gaps of 4 mm, from one of 2 mm on.
    for shape in [
        "path d='M10 20h40'",
        "path d='M10 20h40' transform='translate(1 0)'",
        "line x1='10' x2='50' y1='9' y2='9'",
    ] {
        let content = format!(
            "<{shape} pathLength='10' stroke='black' stroke-width='1' stroke-dasharray='1 1' stroke-dashoffset='.5'/>"
        );
        for strokes in [Strokes::Center, Strokes::Band] {
            let options = PatternOptions::default().with_strokes(strokes);
            let reading = read(page(&content).as_bytes(), &options).unwrap();
            let mut widths: Vec<f64> = reading
                .pattern
                .paths
                .iter()
                .map(|path| {
                    let ends: Vec<f64> = path.shape.flattened(1e-3).iter().map(|point| point.x).collect();
                    ends.iter().fold(f64::MIN, |a, b| a.max(*b))
                        - ends.iter().fold(f64::MAX, |a, b| a.min(*b))
                })
                .collect();
            widths.sort_by(f64::total_cmp);
            let expected = [2.0, 2.0, 4.0, 4.0, 4.0, 4.0];
            assert!(
                widths.len() == 6 && widths.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3),
                "{shape} {strokes:?}: {widths:?}"
            );
        }
    }
    // A circle of radius 5 in 8 parts: 4 dashes.
    let circle = drawn(
        "<circle cx='9' cy='9' r='5' pathLength='8' fill='none' stroke='red' stroke-dasharray='1' stroke-width='.1'/>",
    );
    let lengths = circle.pattern.paths.iter().map(|path| {
        let points = path.shape.flattened(1e-5);
        points.windows(2).map(|pair| pair[0].distance(pair[1])).sum::<f64>()
    });
    let lengths: Vec<f64> = lengths.collect();
    assert!(
        lengths.len() == 4 && lengths.iter().all(|one| (one - PI * 10.0 / 8.0).abs() < 1e-2),
        "{lengths:?}"
    );
}

#[test]
fn strokes_without_length_show_their_ends() {
    let dots = |cap: &str, content: &str, strokes: Strokes| {
        let content =
            format!("<g fill='none' stroke='black' stroke-width='2' stroke-linecap='{cap}'>{content}</g>");
        let text = page(&format!("<path d='M1 1h1v1z'/>{content}"));
        read(text.as_bytes(), &PatternOptions::default().with_strokes(strokes)).unwrap()
    };
    let triangle = 0.5;
    for (content, count) in
        [("<path d='M10 10z'/>", 1.0), ("<path stroke-dasharray='0 8' d='M10 10h17'/>", 3.0)]
    {
        for (cap, area) in [("round", PI), ("square", 4.0), ("butt", 0.0)] {
            let [found, ..] = covered(&dots(cap, content, Strokes::Band).pattern.paths);
            assert!((found - triangle - count * area).abs() < 0.02, "{cap} {content}: {found}");
            let reading = dots(cap, content, Strokes::Center);
            let points = reading.pattern.paths.iter().filter(|path| matches!(path.shape, Shape::Dot(_)));
            assert_eq!(points.count() as f64, if cap == "butt" { 0.0 } else { count }, "{cap} {content}");
        }
    }
}

#[test]
fn layers_colours_and_hidden_parts_are_kept() {
    let layer = |name: &str, style: &str, content: &str| {
        format!("<g inkscape:groupmode='layer' inkscape:label='{name}' style='{style}'>{content}</g>")
    };
    let content = [
        layer("MARK", "", "<path d='M1 1h5v5z' fill='#123456'/>"),
        layer("Aids", "display:none", "<path d='M1 1h5v5z'/>"),
        "<path d='M20 1h5v5z' style='fill:blue;visibility:hidden'/><path d='M30 1h5v5z'/>".into(),
    ]
    .concat();
    let reading = drawn(&content);
    let names: Vec<&str> = reading.pattern.layers.iter().map(|layer| layer.name.as_str()).collect();
    assert_eq!(names, ["MARK", "0"]);
    assert!(matches!(reading.pattern.paths[0].color, Color::Rgb { rgb: [0x12, 0x34, 0x56], .. }));
    assert_eq!(reading.pattern.paths[1].color, Color::Rgb { aci: 7, rgb: [0; 3] });
    assert_eq!(reading.facts.layers["Aids"].hidden.as_deref(), Some("hidden"));
    assert_eq!(reading.facts.skipped.len(), 2);
    assert!(reading.facts.skipped.iter().all(|skipped| skipped.is_loss && !skipped.is_ink));
}

#[test]
fn what_is_not_marked_is_reported_with_what_the_drawing_shows_first() {
    let reading =
        drawn("<path d='M1 1h5v5z'/><path visibility='hidden' d='M1 1h5v5z'/><image width='5' height='5'/>");
    let notice = reading.facts.notices.iter().find(|notice| notice.code == "not-taken").unwrap();
    let start = "2 entities are not marked; the drawing shows 1 of them (image on layer 0: ";
    assert!(notice.message.starts_with(start), "{}", notice.message);
}

#[test]
fn ink_that_cannot_be_marked_is_listed() {
    let mark = "<path d='M1 1h5v5z'/>";
    for (lost, kind) in [
        ("<image id='x' href='a.png' width='5' height='5'/>", "image"),
        ("<foreignObject id='x' width='5' height='5'/>", "foreignObject"),
        ("<mask id='m'/><g id='x' mask='url(#m)'><path d='M1 1h5v5z'/></g>", "g"),
        ("<path id='x' filter='url(#f)' d='M1 1h5v5z'/>", "path"),
        ("<text id='x'>\u{682a}</text>", "text"),
        ("<path id='x' style='mask: linear-gradient(red, blue)' d='M1 1h5v5z'/>", "path"),
        ("<text id='x'><textPath href='#p'>abc</textPath></text>", "text"),
        ("<use id='x' href='other.svg#a'/>", "use"),
        ("<path id='x' d='M1 1 L 5 oops'/>", "path"),
        ("<path id='x' transform='turn(3)' d='M1 1h5v5z'/>", "path"),
        (
            "<clipPath id='c' clipPathUnits='objectBoundingBox'><rect width='1' height='1'/></clipPath>\
          <path id='x' clip-path='url(#c)' d='M1 1h5v5z'/>",
            "path",
        ),
        ("<marker id='m'/><path id='x' fill='none' stroke='red' marker-end='url(#m)' d='M1 1h5'/>", "path"),
        ("<path id='x' style='rotate: 30deg' d='M1 1h5v5z'/>", "path"),
        ("<path id='x' style='clip-path: circle(2px)' d='M1 1h5v5z'/>", "path"),
        ("<path id='x' transform='rotate(9)' style='transform-box: fill-box' d='M1 1h5v5z'/>", "path"),
        ("<text id='x' style='font-variant: small-caps'>abc</text>", "text"),
        ("<text id='x' direction='rtl'>abc</text>", "text"),
        ("<text id='x'>ab<tspan opacity='0'>c</tspan></text>", "text"),
        (
            "<mask id='m'/><symbol id='x' mask='url(#m)'><path d='M1 1h5v5z'/></symbol><use href='#x'/>",
            "symbol",
        ),
        // Browsers ignore a length or an angle without a unit in a style, and one with a unit in an attribute.
        ("<path id='x' style='transform: translate(3,4)' d='M1 1h5v5z'/>", "path"),
        ("<path id='x' style='transform: rotate(30)' d='M1 1h5v5z'/>", "path"),
        ("<path id='x' style='transform: scale(2 1)' d='M1 1h5v5z'/>", "path"),
        ("<path id='x' transform='translate(3px,4px)' d='M1 1h5v5z'/>", "path"),
        ("<path id='x' transform='rotate(30deg)' d='M1 1h5v5z'/>", "path"),
    ] {
        let reading = drawn(&format!("{mark}{lost}"));
        let listed: Vec<_> = reading.facts.skipped.iter().filter(|skipped| skipped.is_ink).collect();
        assert_eq!(listed.len(), 1, "{lost}: {:?}", reading.facts.skipped);
        assert_eq!((listed[0].entity.as_str(), listed[0].handle.as_deref()), (kind, Some("x")), "{lost}");
    }
}

#[test]
fn white_gradients_and_clips_are_reported() {
    for (content, code) in [
        ("<path d='M1 1h5v5z' fill='white'/>", "svg-white"),
        ("<linearGradient id='g'/><path d='M1 1h5v5z' fill='url(#g)'/>", "svg-shades"),
        ("<path d='M1 1h5v5z' fill-opacity='0.5'/>", "svg-transparent"),
        (
            "<clipPath id='c'><circle cx='5' cy='5' r='2'/></clipPath><path clip-path='url(#c)' d='M1 1h9v9h-9z'/>",
            "svg-clipped",
        ),
    ] {
        assert!(codes(&drawn(content).facts).contains(&code), "{content}");
    }
    let whole = drawn(
        "<clipPath id='c'><rect width='60' height='40'/></clipPath><circle clip-path='url(#c)' cx='9' cy='9' r='4'/>",
    );
    assert!(!codes(&whole.facts).contains(&"svg-clipped"));
    assert!(matches!(whole.pattern.paths[0].shape.segments(), [Segment::Arc { .. }]));
}

/// SVG 2, section 13.2: a reference to a paint server that does not exist is `none`, or the colour behind it.
#[test]
fn gradients_that_the_file_does_not_contain_paint_nothing() {
    let mark = "<path d='M20 10h10v10h-10z'/>";
    for (paint, expected) in [
        ("fill='url(#lost)'", false),
        ("fill='url(#lost) none'", false),
        ("style='fill:url(\"#lost\")'", false),
        ("fill='url(#clip)'", false),
        ("fill='none' stroke='url(#lost)'", false),
        ("fill='url(#lost) #00f'", true),
        ("fill='url(#lost) currentColor'", true),
        ("fill='url(#lost)' stroke='black' stroke-width='0.3'", true),
        ("fill='url(#found)'", true),
        ("fill='none' stroke='url(#found)'", true),
        ("fill='url(#solid)'", true),
    ] {
        let definitions = "<clipPath id='clip'><path d='M0 0h1v1z'/></clipPath>\
            <linearGradient id='found'><stop stop-color='red'/></linearGradient>\
            <solidcolor id='solid' solid-color='red'/>";
        let reading = drawn(&format!("{definitions}{mark}<path id='x' d='M1 1h5v5z' {paint}/>"));
        let is_drawn = reading.pattern.paths.iter().any(|path| path.source.handle.as_deref() == Some("x"));
        assert_eq!(is_drawn, expected, "{paint}");
        assert_eq!(
            codes(&reading.facts).contains(&"svg-shades"),
            paint.contains("found") || paint.contains("solid"),
            "{paint}"
        );
        assert!(reading.facts.skipped.iter().all(|skipped| !skipped.is_ink), "{paint}");
    }
}

#[test]
fn the_white_ground_of_a_page_is_not_marked() {
    let mark = "<path d='M20 10h10v10h-10z'/>";
    let disc = "<clipPath id='c'><circle cx='30' cy='20' r='9'/></clipPath>";
    for ground in [
        "<rect width='100%' height='100%' fill='white'/>",
        "<rect width='60' height='40' fill='#fff'/>",
        "<path d='M0 0H60V40H0Z' style='fill:#ffffff;stroke:none'/>",
        "<rect x='-5' y='-5' width='70' height='50' fill='#fefefe'/>",
        "<g transform='scale(2)'><rect width='30' height='20' fill='white'/></g>",
        "<path d='M0 0H30H60V40H0' fill='white'/>",
        "<clipPath id='c'><rect x='-1' width='80' height='40'/></clipPath><g clip-path='url(#c)'>\
         <rect width='60' height='40' fill='white'/></g>",
        "<svg><rect width='60' height='40' fill='white'/></svg>",
    ] {
        let reading = drawn(&format!("{ground}{mark}"));
        near(extents(&reading), [20.0, 20.0, 30.0, 30.0]);
        let codes = codes(&reading.facts);
        assert!(codes.contains(&"svg-ground") && !codes.contains(&"svg-white"), "{ground}: {codes:?}");
        assert!(!reading.facts.notices.iter().any(|notice| notice.severity == Severity::Warning), "{ground}");
    }
    // Not white, above something, not over the whole page, not a rectangle, cut to another shape, or to a part of the page.
    for shape in [
        format!("<rect width='60' height='40' fill='#eee'/>{mark}"),
        format!("{mark}<rect width='60' height='40' fill='white'/>"),
        format!("<rect width='60' height='30' fill='white'/>{mark}"),
        format!("<path d='M0 0H60V40L30 20 0 40Z' fill='white'/>{mark}"),
        format!("<ellipse cx='30' cy='20' rx='60' ry='60' fill='white'/>{mark}"),
        format!("<path d='M0 0L60 40V0L0 40Z' fill='white'/>{mark}"),
        format!("<path d='M0 0H60H30V40H0V0H30V40H0Z' fill='white'/>{mark}"),
        format!("{disc}<rect width='60' height='40' fill='white' clip-path='url(#c)'/>{mark}"),
        format!("{disc}<g clip-path='url(#c)'><rect width='60' height='40' fill='white'/></g>{mark}"),
        format!("<svg width='30' height='30'><rect width='60' height='40' fill='white'/></svg>{mark}"),
    ] {
        let reading = drawn(&shape);
        assert_eq!(reading.pattern.paths.len(), 2, "{shape}");
        assert!(!codes(&reading.facts).contains(&"svg-ground"), "{shape}");
    }
    // Its stroke is a frame, and strictly, everything is marked.
    let framed = drawn(&format!("<rect width='60' height='40' fill='white' stroke='black'/>{mark}"));
    near(extents(&framed), [0.0, 0.0, 60.0, 40.0]);
    assert_eq!(framed.pattern.paths.iter().filter(|path| path.region.is_some()).count(), 1);
    let text = page(&format!("<rect width='60' height='40' fill='white'/>{mark}"));
    let strict = read(text.as_bytes(), &PatternOptions::default().strictly(true)).unwrap();
    assert_eq!(strict.pattern.paths.len(), 2);
    // The viewBox in the middle of a wider page.
    let text = page(&format!("<rect width='40' height='40' fill='white'/>{mark}"))
        .replace("viewBox=\"0 0 60 40\"", "viewBox=\"0 0 40 40\"");
    assert!(codes(&try_read(&text).unwrap().facts).contains(&"svg-ground"));
}

#[test]
fn a_ground_above_something_that_is_not_read_is_a_warning() {
    let ground = "<rect width='60' height='40' fill='white'/>";
    let mask =
        "<mask id='m'><rect width='9' height='9' fill='white'/></mask><path d='M1 1h5v5z' mask='url(#m)'/>";
    let hidden = "<path d='M1 1h5v5z' display='none'/>";
    for (below, is_warning) in
        [("", false), (hidden, false), (ground, true), ("<image width='9' height='9'/>", true), (mask, true)]
    {
        let reading = drawn(&format!("{below}{ground}<path d='M20 10h10v10h-10z'/>"));
        near(extents(&reading), [20.0, 20.0, 30.0, 30.0]);
        let notice = reading.facts.notices.iter().find(|notice| notice.code == "svg-ground").unwrap();
        assert_eq!(notice.severity == Severity::Warning, is_warning, "{below}");
        assert!(!notice.message.contains("--strict"));
    }
}

#[test]
fn texts_are_aligned_and_named() {
    // Capitals of DejaVu Sans are 1493/2048 em high.
    let reading =
        drawn("<text x='30' y='20' font-size='10' text-anchor='middle' font-family='Arial'>H</text>");
    let [left, bottom, right, top] = extents(&reading);
    assert!((bottom - 20.0).abs() < 1e-9 && (top - bottom - 10.0 * 1493.0 / 2048.0).abs() < 1e-6);
    assert!(((left + right) / 2.0 - 30.0).abs() < 0.01, "{left} {right}");
    assert!(codes(&reading.facts).contains(&"font-replaced"));
}

/// The sides of the ink by the pixels of Chromium, 32 in a mm, with DejaVu Sans of 6 mm.
#[test]
fn spaced_texts_are_aligned_as_in_a_browser() {
    for (content, left, right) in [
        ("letter-spacing='3'>LOGO", 30.594, 55.875),
        ("letter-spacing='3' text-anchor='middle'>LOGO", 15.969, 41.281),
        ("letter-spacing='3' text-anchor='end'>LOGO", 1.375, 26.656),
        ("letter-spacing='3' text-anchor='end'>LOGO ", 1.375, 26.656),
        ("letter-spacing='-1' text-anchor='end'>LOGO", 17.375, 30.656),
        ("text-anchor='end'>LOG<tspan letter-spacing='3'>O</tspan>", 10.375, 26.656),
        ("text-anchor='end' letter-spacing='3'>LOG<tspan letter-spacing='0'>O</tspan>", 4.375, 29.656),
        ("text-anchor='end' word-spacing='3'>LO GO ", 8.469, 29.656),
        ("text-anchor='end' word-spacing='3'>LO&#160;GO", 8.469, 29.656),
        ("text-anchor='end' word-spacing='3' xml:space='preserve'>LO GO ", 3.562, 24.75),
        // A blank is a part of the text before a new position, but not at the end.
        ("text-anchor='end'>LO<tspan x='21' y='30'>GO</tspan>", 11.969, 29.656),
        ("text-anchor='end'>LO <tspan x='22' y='30'>GO</tspan>", 12.969, 27.75),
    ] {
        let text = format!("<text x='30' y='20' font-family='DejaVu Sans' font-size='6' {content}</text>");
        let [from, _, to, _] = extents(&drawn(&text));
        assert!((from - left).abs() < 0.04 && (to - right).abs() < 0.04, "{content}: {from} to {to}");
    }
}

/// The heights of a baseline of 10 mm by the pixels of Chromium, 32 in a mm.
#[test]
fn baselines_are_where_a_browser_draws_them() {
    for (name, expected) in [
        ("alphabetic", 0.0),
        ("middle", -2.75),
        ("central", -3.469),
        ("mathematical", -4.656),
        ("hanging", -7.438),
        ("text-before-edge", -9.281),
        ("text-after-edge", 2.344),
        ("ideographic", 2.344),
    ] {
        let text = format!("<text x='5' y='20' font-size='10' dominant-baseline='{name}'>H</text>");
        let height = extents(&drawn(&text))[1] - 20.0;
        assert!((height - expected).abs() < 0.035, "{name}: {height}");
    }
}

/// Widths in units of DejaVu Sans, 2048 in an em, by the tables of the font; Chromium draws the same.
#[test]
fn letters_are_kerned_and_joined_as_the_font_states() {
    // From the left side of the text to the right side of its last letter: that of `.` is 221 units before its end.
    let right = |content: &str| {
        let text = format!("<text y='20' font-family='DejaVu Sans' font-size='4.096' {content}</text>");
        (extents(&drawn(&text))[2] * 500.0).round()
    };
    let [kerned, plain] = [14972.0 - 221.0, 16020.0 - 221.0];
    assert_eq!(right("x='0'>AVATAR To We."), kerned);
    assert_eq!(right("x='0' style='font-kerning: none'>AVATAR To We."), plain);
    // No attribute of SVG.
    assert_eq!(right("x='0' font-kerning='none'>AVATAR To We."), kerned);
    assert_eq!(right("x='0' style='font-feature-settings: \"kern\" 0'>AVATAR To We."), plain);
    assert_eq!(
        right("x='0' style='font-kerning: none'><tspan style='font-kerning: auto'>AVATAR To We.</tspan>"),
        kerned
    );
    // 12 gaps of 50 units.
    assert_eq!(right("x='0' letter-spacing='0.1'>AVATAR To We."), kerned + 600.0);
    assert_eq!(right("x='0'>AVATAR<tspan fill='red'> To We.</tspan>"), kerned);
    assert_eq!(right("x='30' text-anchor='end'>AVATAR To We."), 15000.0 - 221.0);
    // `fl` is one glyph, unless letters are spaced or placed one by one.
    let glyphs = |content: &str| {
        let text = format!("<text x='5' y='20' font-family='DejaVu Sans' font-size='10' {content}</text>");
        let reading = drawn(&text);
        let regions: std::collections::BTreeSet<_> =
            reading.pattern.paths.iter().map(|path| path.region).collect();
        regions.len()
    };
    for (content, expected) in [
        (">flow", 3),
        ("letter-spacing='1'>flow", 4),
        ("dx='0 1'>flow", 4),
        ("style='font-variant-ligatures: none'>flow", 4),
        ("style='font-variant: no-common-ligatures'>flow", 4),
        ("text-rendering='optimizeSpeed'>flow", 4),
        (">f<tspan fill='red'>l</tspan>ow", 4),
    ] {
        assert_eq!(glyphs(content), expected, "{content}");
    }
}

#[test]
fn narrow_and_wide_fonts_are_reported() {
    for (style, asked) in [
        ("font-family='DejaVu Sans' font-stretch='condensed'", "DejaVu Sans condensed"),
        ("style='font: italic ultra-expanded 10px DejaVu Sans'", "DejaVu Sans italic ultra-expanded"),
        ("font-family='DejaVu Sans' font-stretch='100%'", ""),
        ("font-stretch='condensed' style='font: 10px DejaVu Sans'", ""),
    ] {
        let reading = drawn(&format!("<g {style}><text x='5' y='20'>H</text></g>"));
        let replaced = reading.facts.notices.iter().find(|notice| notice.code == "font-replaced");
        let message = replaced.map_or("", |notice| notice.message.as_str());
        match asked {
            "" => assert_eq!(message, "", "{style}"),
            asked => {
                assert!(
                    message.starts_with(&format!("the font {asked} is not available")),
                    "{style}: {message}"
                )
            }
        }
    }
}

/// Programs show nothing beyond the page, and nothing is cut off here.
#[test]
fn what_is_beyond_the_page_is_reported() {
    let find = |text: &str| {
        let reading = try_read(text).unwrap();
        let notice = reading.facts.notices.into_iter().find(|notice| notice.code == "svg-off-page");
        notice.map(|notice| notice.message)
    };
    let own = "<rect x='5' y='5' width='20' height='10'/>";
    // The page is 60 x 40 mm.
    let content =
        format!("{own}<rect x='70' y='10' width='10' height='20'/><path id='over' d='M50 20h15v3z'/>");
    let message = find(&page(&content)).unwrap();
    for part in [
        "2 shapes or lines reach beyond the page of 60.000 x 40.000 mm by up to 20.000 mm (1 of them as a whole; first: rect in line 1)",
        "from x 50.000 to 80.000 mm and from y 10.000 to 30.000 mm",
    ] {
        assert!(message.contains(part), "{message}");
    }
    let reading = drawn(&content);
    near(extents(&reading), [5.0, 10.0, 80.0, 35.0]);
    for on_page in [
        own.to_owned(),
        "<rect width='60' height='40' fill='none' stroke='black' stroke-width='2'/>".into(),
        "<rect width='60.05' height='40'/>".into(),
        // Nested drawings cut what is beyond their edges.
        "<svg x='5' y='5' width='10' height='10'><rect width='90' height='90'/></svg>".into(),
    ] {
        assert_eq!(find(&page(&on_page)), None, "{on_page}");
    }
    // A drawing without a size has no page.
    assert_eq!(find(&format!("{HEAD}><rect width='9000' height='9000'/></svg>")), None);
    assert!(
        find(&format!("{HEAD} width='9mm' height='9mm'><rect width='9000' height='9000'/></svg>")).is_some()
    );
}

#[test]
fn words_are_raised_spaced_and_underlined() {
    // Sizes in mm; DejaVu Sans has 2048 units in an em, and an H of 1493 on the line.
    let text = |inside: &str| drawn(&format!("<text x='5' y='20' font-size='10'>{inside}</text>"));
    let heights = |inside: &str| {
        let [_, bottom, _, top] = extents(&text(inside));
        [bottom - 20.0, top - 20.0]
    };
    let capital = 10.0 * 1493.0 / 2048.0;
    let at = |found: [f64; 2], expected: [f64; 2]| {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}, not {expected:?}");
    };
    at(heights("<tspan baseline-shift='2'>H</tspan>"), [2.0, capital + 2.0]);
    at(heights("<tspan style='baseline-shift: -25%'>H</tspan>"), [-2.5, capital - 2.5]);
    // Half the height of the own font, from the ascender of 1901 units to the descender of 483: in Chromium 5.81 mm here.
    let half = 10.0 * (1901.0 + 483.0) / 2048.0 / 2.0;
    at(
        heights("<tspan baseline-shift='super'>H<tspan baseline-shift='2'>H</tspan></tspan>"),
        [half, half + 2.0 + capital],
    );
    at(heights("<tspan baseline-shift='sub'>H</tspan>"), [-half, capital - half]);
    at(heights("<a baseline-shift='sub'>H</a>"), [-half, capital - half]);
    // In Chromium, a superscript of 5 in a text of 10 is 2.91 mm higher, and a subscript lower.
    at(
        heights("<tspan baseline-shift='super' font-size='5'>H</tspan>"),
        [half / 2.0, (half + capital) / 2.0],
    );
    at(heights("<tspan baseline-shift='sub' font-size='5'>H</tspan>"), [-half / 2.0, (capital - half) / 2.0]);
    let whole = drawn(
        "<g baseline-shift='sub'><text x='5' y='20' font-size='10' baseline-shift='super'>H</text></g>",
    );
    assert!((extents(&whole)[1] - 20.0 - half).abs() < 1e-6);
    let right = |inside: &str| extents(&text(inside))[2];
    let blank = "<tspan word-spacing='3'>H H H</tspan>";
    assert!((right(blank) - right("H H H") - 6.0).abs() < 1e-6);
    assert_eq!(extents(&text("<tspan style='text-transform: uppercase'>h</tspan>")), extents(&text("H")));
    let unbroken = "<tspan word-spacing='3'>H&#160;H H</tspan>";
    assert!((right(unbroken) - right("H H H") - 6.0).abs() < 1e-6);
    // A line along both words and the blank between them, as the pixels of Chromium show it (32 in a mm).
    let plain = text("H H");
    for (kind, bottom, top) in
        [("underline", -1.5, -0.5), ("overline", 9.281, 10.281), ("line-through", 2.594, 3.594)]
    {
        let lined = text(&format!("<tspan text-decoration='{kind}'>H H</tspan>"));
        assert_eq!(lined.pattern.paths.len(), plain.pattern.paths.len() + 1);
        let line = &lined.pattern.paths.last().unwrap().shape;
        let ends = line.flattened(1e-3);
        let (low, high) = ends.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), end| {
            (low.min(end.y - 20.0), high.max(end.y - 20.0))
        });
        assert!((low - bottom).abs() < 0.016 && (high - top).abs() < 0.016, "{kind}: {low} {high}");
    }
    // Letters inside a span have the baseline of the text.
    let middle = |inside: &str| {
        extents(&drawn(&format!(
            "<text x='5' y='20' font-size='10' dominant-baseline='middle'>{inside}</text>"
        )))
    };
    assert_eq!(middle("<tspan>H</tspan>"), middle("H"));
    assert_ne!(middle("H"), extents(&text("H")));
}

#[test]
fn bad_files_are_refused_with_a_place_and_a_remedy() {
    let deep = |levels: usize| {
        page(&format!("{}<path d='M1 1h5v5z'/>{}", "<g>".repeat(levels), "</g>".repeat(levels)))
    };
    let copies: String = (1..40)
        .map(|level| format!("<g id='a{level}'><use href='#a{0}'/><use href='#a{0}'/></g>", level - 1))
        .collect();
    let bomb = format!(
        "<!DOCTYPE svg [<!ENTITY a \"xx\"><!ENTITY b \"&a;&a;&a;&a;\">]>{}",
        page("<text>&b;</text>")
    );
    let uses = "&a;".repeat(100_000);
    let long = format!(
        "<!DOCTYPE svg [<!ENTITY a \"{}\">]>{}",
        "x".repeat(100_000),
        page(&format!("<text>{uses}</text>"))
    );
    for (text, code) in [
        (page("<path d='M1 1h5v5z'/></g>"), "svg-damaged"),
        (bomb, "svg-damaged"),
        (long, "pattern-too-many"),
        (deep(200), "pattern-too-many"),
        (deep(100_000), "pattern-too-many"),
        (
            page(&format!("<defs><path id='a0' d='M1 1h5v5z'/>{copies}</defs><use href='#a39'/>")),
            "pattern-too-many",
        ),
        (page("<path d='M1 1L1e308 1e308L-1e308 5z'/>"), "pattern-out-of-range"),
        (
            page("<g transform='scale(1e300)'><g transform='scale(1e300)'><path d='M1 1h5v5z'/></g></g>"),
            "pattern-out-of-range",
        ),
        (page("<circle cx='1' cy='1' r='1e308'/>"), "pattern-out-of-range"),
        (page("<svg width='20' height='1e308'><path d='M1 1h5v5z'/></svg>"), "pattern-out-of-range"),
        (page("<svg x='-1e300' viewBox='0 0 1e-300 1'><path d='M1 1h5v5z'/></svg>"), "pattern-out-of-range"),
        (
            page(
                "<clipPath id='c'><path d='M1 1H1e300V5z'/></clipPath><path clip-path='url(#c)' d='M1 1h5v5z'/>",
            ),
            "pattern-out-of-range",
        ),
        (page(""), "pattern-nothing-to-mark"),
        (page("<g id='a'><use href='#a'/></g>"), "pattern-nothing-to-mark"),
    ] {
        let reason = try_read(&text).unwrap_err().reason();
        assert_eq!(reason.code, code, "{} {:.200}", reason, text);
        assert!(!reason.remedy.is_empty());
    }
    let bands = PatternOptions::default().with_strokes(Strokes::Band);
    for width in ["1e300", "1e9"] {
        let wide = page(&format!("<path fill='none' stroke='red' stroke-width='{width}' d='M0 0L9 0L0 5'/>"));
        let reason = read(wide.as_bytes(), &bands).unwrap_err().reason();
        assert!(
            reason.code == "pattern-out-of-range" && reason.to_string().contains("path in line 1"),
            "{reason}"
        );
    }
    // Deep, but allowed.
    assert_eq!(try_read(&deep(90)).unwrap().pattern.paths.len(), 1);
    let damaged = try_read(&page("\n\n<path d='M1 1h5v5z'></g>")).unwrap_err().reason();
    assert!(damaged.to_string().contains("line 3"), "{damaged}");
    let zipped = read(b"\x1f\x8b\x08\0abc", &PatternOptions::default()).unwrap_err().to_string();
    assert!(zipped.contains(".svgz"), "{zipped}");
}

#[test]
fn every_cut_of_a_file_is_recognised() {
    let whole = data("inkscape.svg");
    assert!(is_complete(&whole));
    for end in (0..whole.len() - 7).step_by(37) {
        let part = &whole[..end];
        assert!(!is_complete(part), "cut at {end}");
        if end > 10 {
            let error = read(part, &PatternOptions::default()).unwrap_err();
            assert!(error.is_cut_short(), "cut at {end}: {error}");
        }
    }
}

#[test]
fn encodings_with_a_mark_or_a_name_are_read() {
    let text = page("<g inkscape:groupmode='layer' inkscape:label='Schr\u{e4}g'><path d='M1 1h5v5z'/></g>");
    let utf16: Vec<u8> =
        std::iter::once(0xfeff).chain(text.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    let latin: Vec<u8> =
        format!("<?xml version='1.0' encoding='ISO-8859-1'?>{text}").chars().map(|c| c as u8).collect();
    for bytes in [text.clone().into_bytes(), utf16, latin] {
        let reading = read(&bytes, &PatternOptions::default()).unwrap();
        assert_eq!(reading.pattern.layers[0].name, "Schr\u{e4}g");
        assert!(is_complete(&bytes));
    }
}

fn isomark(folder: &std::path::Path, arguments: &[&str]) -> (i32, String, String) {
    let output = assert_cmd::Command::new(env!("CARGO_BIN_EXE_isomark"))
        .args(arguments)
        .current_dir(folder)
        .env("XDG_CACHE_HOME", folder.join("cache"))
        .env("LOCALAPPDATA", folder.join("cache"))
        .env("LOCALAPPDATA", folder.join("cache"))
        .env_remove("RUST_LOG")
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    (output.status.code().unwrap(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_job_marks_an_svg_drawing_and_refuses_options_without_effect() {
    let folder = tempfile::tempdir().unwrap();
    let logo =
        format!("{HEAD}width='12mm' height='8mm' viewBox='0 0 12 8'><circle cx='6' cy='4' r='3'/></svg>");
    fs::write(folder.path().join("logo.svg"), logo).unwrap();
    let (code, out, err) = isomark(folder.path(), &["correct", MOUSE, "logo.svg", "-o", "out.dxf", "--json"]);
    assert_eq!(code, 0, "{err}");
    let report: Value = serde_json::from_str(&out).unwrap();
    assert!((report["pattern"]["facts"]["size_mm"][0].as_f64().unwrap() - 6.0).abs() < 1e-9, "{out}");
    let size = read(&fs::read(folder.path().join("out.dxf")).unwrap(), &PatternOptions::default())
        .unwrap()
        .facts
        .size;
    assert!(size[0] > 5.5 && size[0] < 6.01, "{size:?}");
    let (code, _, err) = isomark(folder.path(), &["inspect", "logo.svg", "--threshold", "40"]);
    assert!(code == 2 && err.contains("is an SVG, which has no pixels"), "{err}");
    let (code, out, err) =
        isomark(folder.path(), &["inspect", "logo.svg", "--width", "24", "--strokes", "band", "--json"]);
    assert!(code == 0, "{err}");
    let facts: Value = serde_json::from_str(&out).unwrap();
    assert!((facts["size_mm"][0].as_f64().unwrap() - 12.0).abs() < 1e-9, "{out}");
}

#[test]
fn svg_drawings_in_the_hot_folder_become_dxf_drawings() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for name in ["hot/mouse", "import"] {
        fs::create_dir_all(path(name)).unwrap();
    }
    let station = "[station]\nname = \"test\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\n\
                   width_mm = 100\nheight_mm = 100\n[watch]\nsettle_ms = 0\nopen_ended_s = 0\n";
    fs::write(path("station.toml"), station).unwrap();
    fs::copy(MOUSE, path("hot/mouse.glb")).unwrap();
    let logo =
        format!("{HEAD}width='12mm' height='8mm' viewBox='0 0 12 8'><circle cx='6' cy='4' r='3'/></svg>");
    fs::write(path("hot/mouse@logo.svg"), &logo).unwrap();
    fs::write(path("hot/mouse/ring.SVG"), &logo).unwrap();
    fs::write(path("hot/mouse@half.svg"), &logo[..logo.len() / 2]).unwrap();
    fs::write(path("hot/mouse@packed.svgz"), b"\x1f\x8b\x08\0").unwrap();
    let (code, _, err) = isomark(folder.path(), &["watch", "station.toml", "--once"]);
    assert!(code == 0 || code == 1, "{err}");
    for name in ["mouse@logo", "mouse@ring"] {
        let dxf =
            fs::read(path(&format!("import/{name}.dxf"))).unwrap_or_else(|error| panic!("{error}\n{err}"));
        assert!(read(&dxf, &PatternOptions::default()).is_ok());
    }
    assert_eq!(fs::read_dir(path("import")).unwrap().count(), 2);
    assert!(path("archive/mouse/mouse@logo.svg").exists());
    assert!(path("hot/mouse@half.svg").exists(), "it may still be written");
    let reason = fs::read_to_string(path("rejected/mouse@packed.svgz.reason.txt")).unwrap();
    assert!(reason.contains("plain SVG"), "{reason}");
    schemas::check_below(folder.path());
}
