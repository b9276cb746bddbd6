//! Pictures as drawings: outlines compared with closed forms, with a drawing that another program converted to a
//! picture, and with one figure in many file variants. `tests/data/pictures/make.py` made the files.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic")]

use std::f64::consts::PI;

use fs_err as fs;
use isomark::formats::pattern::{
    PatternFacts, PatternOptions, PatternReadError, RasterOptions, is_complete, read,
};
use isomark::geometry::pattern::{Pattern, Shape};
use isomark::geometry::space::{Extents, FlatPoint};
use nalgebra::Vector2;
use serde_json::Value;

mod schemas;

fn file(name: &str) -> Vec<u8> {
    fs::read(format!("{}/tests/data/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn picture(name: &str) -> Vec<u8> {
    file(&format!("pictures/{name}"))
}

fn options(picture: RasterOptions) -> PatternOptions {
    PatternOptions::default().with_picture(picture)
}

fn try_read(bytes: &[u8], picture: RasterOptions) -> Result<(Pattern, PatternFacts), PatternReadError> {
    read(bytes, &options(picture)).map(|reading| (reading.pattern, reading.facts))
}

fn codes(facts: &PatternFacts) -> Vec<&str> {
    facts.notices.iter().map(|notice| notice.code.as_str()).collect()
}

/// The corners of each outline, mm.
fn outlines(pattern: &Pattern) -> Vec<Vec<FlatPoint>> {
    let corners = |shape: &Shape| {
        assert!(shape.is_closed());
        shape.segments().iter().map(|segment| segment.start()).collect()
    };
    pattern.paths.iter().map(|path| corners(&path.shape)).collect()
}

fn sides(outline: &[FlatPoint]) -> impl Iterator<Item = (FlatPoint, FlatPoint)> {
    outline.iter().copied().zip(outline.iter().copied().cycle().skip(1))
}

/// Signed: positive counter-clockwise, y up.
fn area(outline: &[FlatPoint]) -> f64 {
    sides(outline).map(|(a, b)| a.coords().perp(&b.coords())).sum::<f64>() / 2.0
}

fn perimeter(outline: &[FlatPoint]) -> f64 {
    sides(outline).map(|(a, b)| a.distance(b)).sum()
}

/// A grey picture as BMP, with pixels of 0.1 mm whose darkness is `coverage`.
fn bmp(width: usize, height: usize, coverage: impl Fn(usize, usize) -> f64) -> Vec<u8> {
    let row = width.next_multiple_of(4);
    let pixels_at = 54 + 1024;
    let mut bytes = b"BM".to_vec();
    let word = |bytes: &mut Vec<u8>, value: usize| bytes.extend((value as u32).to_le_bytes());
    let _ = [pixels_at + row * height, 0, pixels_at, 40, width, height].map(|value| word(&mut bytes, value));
    bytes.extend([1, 0, 8, 0]);
    let _ = [0, row * height, 10_000, 10_000, 0, 0].map(|value| word(&mut bytes, value));
    (0..=255u8).for_each(|grey| bytes.extend([grey, grey, grey, 0]));
    // BMP starts with the bottom row.
    for y in (0..height).rev() {
        for x in 0..row {
            let covered = if x < width { coverage(x, y) } else { 0.0 };
            bytes.push((255.0 * (1.0 - covered)).round() as u8);
        }
    }
    bytes
}

/// The share of each pixel inside a shape, from 24 x 24 samples; in pixels, y down.
fn smooth(inside: impl Fn(f64, f64) -> bool) -> impl Fn(usize, usize) -> f64 {
    move |x, y| {
        let at = |pixel: usize, step: usize| pixel as f64 + (step as f64 + 0.5) / 24.0;
        let hits = (0..24 * 24).filter(|step| inside(at(x, step % 24), at(y, step / 24)));
        hits.count() as f64 / 576.0
    }
}

/// Only dark and light pixels.
fn hard(inside: impl Fn(f64, f64) -> bool) -> impl Fn(usize, usize) -> f64 {
    move |x, y| f64::from(inside(x as f64 + 0.5, y as f64 + 0.5))
}

/// A point of a picture of `size` pixels of 0.1 mm, in the coordinates of the drawing.
fn drawn(at: [f64; 2], size: [usize; 2]) -> FlatPoint {
    FlatPoint::new((at[0] - size[0] as f64 / 2.0) / 10.0, (size[1] as f64 / 2.0 - at[1]) / 10.0)
}

#[test]
fn a_circle_is_exact_to_a_twentieth_of_a_pixel() {
    for (radius, center) in [(100.3, [130.37, 129.81]), (12.7, [131.0, 130.5]), (4.2, [129.8, 130.1])] {
        let bytes = bmp(261, 260, smooth(|x, y| (x - center[0]).hypot(y - center[1]) < radius));
        let (pattern, facts) = try_read(&bytes, RasterOptions::default()).unwrap();
        let [outline] = &outlines(&pattern)[..] else { panic!("{radius}: {facts:?}") };
        let (middle, radius_mm) = (drawn(center, [261, 260]), radius / 10.0);
        let off = |at: FlatPoint| (at.distance(middle) - radius_mm).abs() * 10.0;
        let corners = outline.iter().map(|corner| off(*corner)).fold(0.0, f64::max);
        let chords = sides(outline).map(|(a, b)| off(a.lerp(b, 0.5))).fold(0.0, f64::max);
        let allowed = if radius > 50.0 { 0.05 } else { 0.12 };
        assert!(corners < allowed && chords < allowed, "{radius}: {corners} {chords} pixels");
        let relative = area(outline) / (PI * radius_mm * radius_mm) - 1.0;
        // This is always a twentieth of a pixel in radius.
        let allowed = if radius > 50.0 { 3e-4 } else { 0.1 / radius };
        assert!(relative.abs() < allowed, "{radius}: {relative}");
        assert!(outline.len() < 120, "{radius}: {} corners", outline.len());
    }
}

#[test]
fn holes_are_kept_and_corners_stay_sharp() {
    // A rotated plate that is not aligned with the pixels, with a round and a square hole.
    let (sin, cos) = 0.2f64.sin_cos();
    let local = |x: f64, y: f64| {
        let (x, y) = (x - 150.3, y - 120.6);
        [x * cos + y * sin, y * cos - x * sin]
    };
    let plate = |x: f64, y: f64| {
        let [s, t] = local(x, y);
        s.abs() < 110.4
            && t.abs() < 70.25
            && (s + 50.0).hypot(t) > 30.2
            && ((s - 55.0).abs() > 25.1 || t.abs() > 20.7)
    };
    let (pattern, facts) = try_read(&bmp(300, 240, smooth(plate)), RasterOptions::default()).unwrap();
    let outlines = outlines(&pattern);
    let areas: Vec<f64> = outlines.iter().map(|outline| area(outline) * 100.0).collect();
    let expected = [4.0 * 110.4 * 70.25, -4.0 * 25.1 * 20.7, -PI * 30.2 * 30.2];
    for expected in expected {
        let near = areas.iter().filter(|area| (*area / expected - 1.0).abs() < 1e-3);
        assert_eq!(near.count(), 1, "{areas:?} without {expected}");
    }
    let ink: f64 = areas.iter().sum();
    assert!((ink / expected.iter().sum::<f64>() - 1.0).abs() < 1e-3);
    let corner = |s: f64, t: f64| [150.3 + s * cos - t * sin, 120.6 + s * sin + t * cos];
    for (s, t) in
        [(110.4, 70.25), (-110.4, 70.25), (110.4, -70.25), (55.0 - 25.1, 20.7), (55.0 + 25.1, -20.7)]
    {
        let expected = drawn(corner(s, t), [300, 240]);
        let all = outlines.iter().flatten();
        let nearest = all.map(|corner| corner.distance(expected) * 10.0).fold(f64::INFINITY, f64::min);
        assert!(nearest < 0.1, "corner ({s}, {t}) is off by {nearest} pixels");
    }
    assert!(outlines.iter().all(|outline| outline.len() < 60));
    assert!(outlines.iter().any(|outline| outline.len() == 4));
    // Everything is one region, including its holes.
    assert!(pattern.paths.iter().all(|path| path.region == pattern.paths[0].region && path.layer == 0));
    assert_eq!((facts.layers["PICTURE"].paths, codes(&facts)), (3, Vec::new()));
}

#[test]
fn a_pale_drawing_is_as_wide_as_a_black_one() {
    // Edges at 20.3 and 80.8 pixels; the ink has 60 % of black, so the level of 50 % is close to the ink at the edges.
    let pale = |x: usize, y: usize| 0.6 * smooth(|x, y| x > 20.3 && x < 80.8 && y > 10.0 && y < 40.0)(x, y);
    let (pattern, _) = try_read(&bmp(100, 50, pale), RasterOptions::default()).unwrap();
    let extents = pattern.extents();
    let found = [extents.min.x, extents.max.x];
    assert!((found[0] + 2.97).abs() < 0.002 && (found[1] - 3.08).abs() < 0.002, "{found:?}");
}

#[test]
fn outlines_of_hard_edges_have_no_steps() {
    let circle = hard(|x, y| (x - 130.4).hypot(y - 129.7) < 100.0);
    let (pattern, facts) = try_read(&bmp(260, 260, circle), RasterOptions::default()).unwrap();
    let [outline] = &outlines(&pattern)[..] else { panic!() };
    let middle = drawn([130.4, 129.7], [260, 260]);
    let worst = outline.iter().map(|at| (at.distance(middle) * 10.0 - 100.0).abs()).fold(0.0, f64::max);
    assert!(worst < 0.7 && outline.len() < 60, "{worst} pixels, {} corners", outline.len());
    assert!((area(outline) * 100.0 / (PI * 1e4) - 1.0).abs() < 2e-3);
    assert!(
        (perimeter(outline) * 10.0 / (200.0 * PI) - 1.0).abs() < 5e-3,
        "with steps it is a quarter longer"
    );
    assert!(codes(&facts).contains(&"picture-hard-edges"));

    // A slanting hairline of single pixels stays one line.
    let line = hard(|x, y| (y - 20.0 - 0.41 * x).abs() < 0.5 && x > 10.0 && x < 190.0);
    let (pattern, _) = try_read(&bmp(200, 120, line), RasterOptions::default()).unwrap();
    let [outline] = &outlines(&pattern)[..] else { panic!("{} pieces", pattern.paths.len()) };
    let length = 180.0 * 1f64.hypot(0.41);
    assert!((perimeter(outline) * 10.0 / (2.0 * length) - 1.0).abs() < 0.02, "{}", perimeter(outline));
    assert!((area(outline) * 100.0 / 180.0 - 1.0).abs() < 0.1, "{}", area(outline));
}

#[test]
fn modules_of_a_code_are_squares() {
    let is_dark = |x: usize, y: usize| (x * 7 + y * 5 + x * y).is_multiple_of(3);
    for (module, side) in [(1, 10.0), (4, 0.2), (4, 10.0)] {
        let code = |x: usize, y: usize| f64::from(is_dark(x / module, y / module));
        let size = RasterOptions::default().with_width(side);
        let (pattern, _) = try_read(&bmp(21 * module, 21 * module, code), size).unwrap();
        let (pixel, modules) = (side / (21 * module) as f64, 21 * 21);
        let dark = (0..modules).filter(|index| is_dark(index % 21, index / 21)).count();
        let found: f64 = outlines(&pattern).iter().map(|outline| area(outline)).sum();
        let expected = dark as f64 * (side / 21.0).powi(2);
        assert!((found / expected - 1.0).abs() < 1e-9, "{module} pixels: {found} for {expected}");
        for corner in outlines(&pattern).iter().flatten() {
            for along in [corner.x, corner.y] {
                let pixels = (along + side / 2.0) / pixel / module as f64;
                assert!((pixels - pixels.round()).abs() < 1e-9, "{corner:?}");
            }
        }
    }
}

#[test]
fn letters_drawn_by_another_program_are_the_letters_of_the_drawing() {
    let drawing = read(&file("patterns/abc.dxf"), &PatternOptions::default()).unwrap().pattern;
    let (pattern, facts) = try_read(&picture("letters.png"), RasterOptions::default()).unwrap();
    let (true_outlines, found) = (outlines(&drawing), outlines(&pattern));
    assert_eq!(found.len(), true_outlines.len());
    let sum = |all: &[Vec<FlatPoint>], of: fn(&[FlatPoint]) -> f64| {
        all.iter().map(|outline| of(outline).abs()).sum::<f64>()
    };
    for of in [area, perimeter] {
        let relative = sum(&found, of) / sum(&true_outlines, of) - 1.0;
        assert!(relative.abs() < 1e-3, "{relative}");
    }
    // By ezdxf, the outlines are 181.96 mm long and enclose 127.34 mm². All corners are within 0.3 pixels except one:
    // the waist of the B ends in a needle thinner than a pixel.
    assert!((sum(&found, perimeter) - 181.96).abs() < 0.2);
    assert!((found.iter().map(|outline| area(outline)).sum::<f64>() - 127.335).abs() < 0.05);
    let distance = |at: FlatPoint, outlines: &[Vec<FlatPoint>]| {
        let all = outlines.iter().flat_map(|outline| sides(outline));
        all.map(|(a, b)| {
            let along = (at - a).dot(&(b - a)) / (b - a).norm_squared();
            at.distance(a.lerp(b, along.clamp(0.0, 1.0)))
        })
        .fold(f64::INFINITY, f64::min)
    };
    let misses = |from: &[Vec<FlatPoint>], to: &[Vec<FlatPoint>]| {
        let mut misses: Vec<f64> = from.iter().flatten().map(|at| distance(*at, to) * 24.0).collect();
        misses.sort_by(f64::total_cmp);
        misses
    };
    let (of_found, of_true) = (misses(&found, &true_outlines), misses(&true_outlines, &found));
    assert!(of_found.last() < Some(&0.3), "{of_found:?}");
    assert!(of_true[of_true.len() - 2] < 0.3 && of_true[of_true.len() - 1] < 4.0, "{of_true:?}");
    let corners: usize = found.iter().map(Vec::len).sum();
    assert!(corners < 250, "{corners} corners");
    let facts = facts.picture.unwrap();
    assert_eq!((facts.pixels, facts.contours, facts.vertices), ([960, 336], 6, corners));
    assert!((facts.size[0] - 40.0).abs() < 1e-3 && (facts.size[1] - 14.0).abs() < 1e-3, "{facts:?}");
}

/// The figure of `make.py`, an F with a foot: its corners in pixels, y down.
const FIGURE: [&[[f64; 2]]; 2] = [
    &[
        [2.0, 2.0],
        [2.0, 16.0],
        [6.0, 16.0],
        [6.0, 10.0],
        [14.0, 10.0],
        [14.0, 8.0],
        [6.0, 8.0],
        [6.0, 4.0],
        [20.0, 4.0],
        [20.0, 2.0],
    ],
    &[[18.0, 14.0], [18.0, 16.0], [22.0, 16.0], [22.0, 14.0]],
];

/// Whether the drawing is the figure on 24 x 18 pixels of this size, mm, upright and not mirrored.
#[track_caller]
fn assert_is_figure(name: &str, pattern: &Pattern, pixel: f64) {
    let found = outlines(pattern);
    assert_eq!(found.len(), 2, "{name}");
    for (found, expected) in found.iter().zip(FIGURE) {
        assert_eq!(found.len(), expected.len(), "{name}: {found:?}");
        let expected: Vec<FlatPoint> =
            expected.iter().map(|[x, y]| FlatPoint::new((x - 12.0) * pixel, (9.0 - y) * pixel)).collect();
        let start = found.iter().position(|at| at.distance(expected[0]) < 1e-4).unwrap_or(0);
        for (index, expected) in expected.iter().enumerate() {
            let at = found[(start + index) % found.len()];
            assert!(at.distance(*expected) < 1e-4, "{name}: {at:?} for {expected:?}");
        }
    }
}

#[test]
fn all_variants_of_a_picture_file_give_the_same_drawing() {
    let dots = 25.4 / 300.0;
    for name in [
        "grey.png",
        "grey-1.png",
        "grey-4.png",
        "grey-16.png",
        "grey-alpha.png",
        "grey-alpha-16.png",
        "rgb-16.png",
        "rgba.png",
        "interlaced.png",
        "palette-2.png",
        "palette-transparent.png",
        "transparent-grey.png",
        "exif-turned.png",
        "exif-mirrored.png",
        "grey.bmp",
        "one-bit.bmp",
        "rgb.bmp",
        "palette.bmp",
    ] {
        let (pattern, facts) = try_read(&picture(name), RasterOptions::default())
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_is_figure(name, &pattern, dots);
        assert_eq!(codes(&facts).contains(&"picture-turned"), name.starts_with("exif"), "{name}");
        assert!(facts.unit_why.contains("300.0 pixels per inch"), "{name}: {}", facts.unit_why);
    }
    // Pixels twice as high as wide, without a resolution: one side is enough to get both.
    let wide = RasterOptions::default().with_width(24.0);
    let (pattern, facts) = try_read(&picture("pixels-not-square.png"), wide).unwrap();
    assert_is_figure("pixels-not-square.png", &pattern, 1.0);
    assert!(!codes(&facts).contains(&"picture-stretched"));
}

#[test]
fn the_size_comes_from_the_settings_or_the_file_and_is_never_guessed() {
    let size = |width, height| {
        let mut options = RasterOptions::default();
        (options.width, options.height) = (width, height);
        options
    };
    for name in ["no-size.png", "no-size.bmp"] {
        let error = try_read(&picture(name), size(None, None)).unwrap_err();
        assert_eq!(error, PatternReadError::PictureWithoutSize { pixels: [24, 18] });
        let reason = error.reason();
        assert_eq!(reason.code, "picture-size");
        assert!(reason.what.contains("24 x 18 pixels") && reason.remedy.contains("width_mm"), "{reason}");
        assert_is_figure(name, &try_read(&picture(name), size(Some(12.0), None)).unwrap().0, 0.5);
        assert_is_figure(name, &try_read(&picture(name), size(None, Some(4.5))).unwrap().0, 0.25);
    }
    // The settings take precedence over the file, and two sides can stretch the picture.
    let (pattern, facts) = try_read(&picture("grey.png"), size(Some(12.0), Some(18.0))).unwrap();
    let extents = pattern.extents();
    assert!((extents.size() - Vector2::new(10.0, 14.0)).norm() < 1e-9, "{extents:?}");
    assert!(codes(&facts).contains(&"picture-stretched"));
    let screen = bmp(30, 30, hard(|x, y| x > 5.0 && y > 5.0 && x < 20.0 && y < 20.0));
    let mut at_96_dpi = screen.clone();
    at_96_dpi[38..46].copy_from_slice(&[0xc4, 0x0e, 0, 0, 0xc4, 0x0e, 0, 0]);
    assert!(codes(&try_read(&at_96_dpi, size(None, None)).unwrap().1).contains(&"picture-resolution"));
    assert!(!codes(&try_read(&screen, size(None, None)).unwrap().1).contains(&"picture-resolution"));
}

#[test]
fn pictures_without_an_outline_are_refused_with_a_remedy() {
    let mut inverted = RasterOptions::default();
    inverted.inverted = true;
    // A higher threshold marks lighter pixels.
    for (name, words, change) in [
        ("all-white.png", "lighter than the threshold of 50 %", "raise `threshold_percent`"),
        ("all-black.png", "no outline", "lower `threshold_percent`"),
    ] {
        let error = try_read(&picture(name), RasterOptions::default()).unwrap_err();
        let reason = error.reason();
        assert!(reason.code == "pattern-nothing-to-mark" && reason.what.contains(words), "{name}: {reason}");
        assert!(reason.remedy.contains(change), "{name}: {reason}");
    }
    let white = picture("white-on-transparent.png");
    let reason = try_read(&white, RasterOptions::default()).unwrap_err().reason();
    assert!(reason.remedy.contains("--invert"), "{reason}");
    assert_is_figure("white, inverted", &try_read(&white, inverted).unwrap().0, 25.4 / 300.0);

    // Black on white, inverted: the background is marked, but not the figure.
    let (pattern, facts) = try_read(&picture("grey.png"), inverted).unwrap();
    let pixel = 25.4 / 300.0;
    let areas: Vec<f64> = outlines(&pattern).iter().map(|outline| area(outline) / pixel / pixel).collect();
    assert_eq!(areas.iter().map(|area| area.round()).collect::<Vec<_>>(), [24.0 * 18.0, -100.0, -8.0]);
    assert!(facts.picture.unwrap().inverted);
}

#[test]
fn shades_and_specks_are_reported() {
    let (_, facts) = try_read(&picture("shades.png"), RasterOptions::default()).unwrap();
    assert!(codes(&facts).contains(&"picture-shades"), "{:?}", facts.notices);
    let dust = bmp(120, 120, |x, y| f64::from(x % 4 == 1 && y % 4 == 1));
    let (_, facts) = try_read(&dust, RasterOptions::default()).unwrap();
    assert!(codes(&facts).contains(&"picture-specks"), "{:?}", facts.notices);
}

#[test]
fn noise_and_decompression_bombs_are_refused() {
    match try_read(&picture("bomb.png"), RasterOptions::default()) {
        Err(PatternReadError::PictureTooLarge { pixels: [60_000, 60_000], .. }) => {}
        other => panic!("{other:?}"),
    }
    // 2.9 million pixels, a random third of them dark.
    let mut state = 1u64;
    let noise: Vec<bool> = (0..1700 * 1700)
        .map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33).is_multiple_of(3)
        })
        .collect();
    let error = try_read(&bmp(1700, 1700, |x, y| f64::from(noise[y * 1700 + x])), RasterOptions::default());
    assert!(matches!(error, Err(PatternReadError::TooMany { .. })), "{:?}", error.map(|(_, facts)| facts));
}

#[test]
fn cut_off_files_are_recognised() {
    for name in ["letters.png", "interlaced.png", "grey.bmp", "one-bit.bmp"] {
        let whole = picture(name);
        assert!(is_complete(&whole), "{name}");
        for end in (2..whole.len()).step_by(1 + whole.len() / 300) {
            let part = &whole[..end];
            assert!(!is_complete(part), "{name} cut at {end}");
            let error = try_read(part, RasterOptions::default()).unwrap_err();
            assert!(error.is_cut_short(), "{name} cut at {end}: {error}");
        }
    }
}

#[test]
fn damaged_files_are_read_or_refused_without_a_panic() {
    for name in
        ["grey.png", "interlaced.png", "palette-transparent.png", "exif-turned.png", "rgb.bmp", "grey.bmp"]
    {
        let whole = picture(name);
        for at in 0..whole.len().min(400) {
            for value in [0, 1, 0x7f, 0xff, whole[at] ^ 0x10] {
                let mut bytes = whole.clone();
                bytes[at] = value;
                if let Err(error) = try_read(&bytes, RasterOptions::default()) {
                    assert!(!error.reason().remedy.is_empty(), "{name} with {value} at {at}");
                }
            }
        }
    }
    let mut apple = picture("grey.png");
    apple.splice(8..8, [0, 0, 0, 4, b'C', b'g', b'B', b'I', 0x50, 0, 0x20, 6, 0x2b, 0xd5, 0xb3, 0x7f]);
    let error = try_read(&apple, RasterOptions::default()).unwrap_err();
    assert!(error.to_string().contains("Apple"), "{error}");
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

const MOUSE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/parts/mouse.glb");
const LETTERS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/pictures/letters.png");

#[test]
fn a_picture_is_corrected_like_the_drawing_it_was_made_from() {
    let folder = tempfile::tempdir().unwrap();
    let correct = |drawing: &str, options: &[&str]| -> (Value, Pattern) {
        let arguments =
            [&["correct", MOUSE, drawing, "--out", "out.dxf", "--json", "--place", "0,8"], options].concat();
        let (code, out, err) = isomark(folder.path(), &arguments);
        assert_eq!(code, 0, "{err}");
        let bytes = fs::read(folder.path().join("out.dxf")).unwrap();
        (schemas::document(&out), read(&bytes, &PatternOptions::default()).unwrap().pattern)
    };
    let drawing = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/patterns/abc.dxf");
    let (of_picture, picture) = correct(LETTERS, &[]);
    let (of_drawing, pattern) = correct(drawing, &[]);
    let size = |pattern: &Pattern| -> Extents { pattern.extents() };
    let gap = (size(&picture).min - size(&pattern).min)
        .amax()
        .max((size(&picture).max - size(&pattern).max).amax());
    assert!(gap < 0.02, "{gap} mm");
    let after = |report: &Value| report["quality"]["after"]["area_mm2"].as_f64().unwrap();
    assert!((after(&of_picture) / after(&of_drawing) - 1.0).abs() < 0.01);
    assert!(of_picture["quality"]["after"]["length_error_relative"].as_f64().unwrap() < 1e-3);
    assert_eq!(of_picture["pattern"]["facts"]["picture"]["pixels"], serde_json::json!([960, 336]));
    assert!(of_drawing["pattern"]["facts"].get("picture").is_none());
    assert_eq!(picture.layers[0].name, "PICTURE");

    // Half as wide, with an option.
    let (report, _) = correct(LETTERS, &["--width", "20"]);
    assert!((report["pattern"]["facts"]["size_mm"][0].as_f64().unwrap() - 19.5).abs() < 0.01, "{report:#}");
    let (code, _, err) =
        isomark(folder.path(), &["correct", MOUSE, LETTERS, "--out", "out.dxf", "--width", "0"]);
    assert!(code == 2 && err.contains("from 0.01 to 10000 mm"), "{err}");
    let (code, out, _) = isomark(folder.path(), &["inspect", LETTERS]);
    assert!(code == 0 && out.contains("960 x 336 pixels on 40.00 x 14.00 mm"), "{out}");
    fs::write(folder.path().join("logo.jpg"), b"\xff\xd8\xff\xe0 and so on").unwrap();
    let (code, _, err) = isomark(folder.path(), &["inspect", "logo.jpg"]);
    assert!(code == 1 && err.contains("JPEG") && err.contains("PNG"), "{err}");
}

#[test]
fn pictures_in_the_hot_folder_become_dxf_drawings() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for name in ["hot/mouse", "import", "skus"] {
        fs::create_dir_all(path(name)).unwrap();
    }
    let station = "[station]\nname = \"test\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\n\
                   width_mm = 100\nheight_mm = 100\n[watch]\nsettle_ms = 0\nopen_ended_s = 0\n";
    fs::write(path("station.toml"), station).unwrap();
    fs::write(path("skus/mouse.toml"), "[pattern]\nwidth_mm = 12\nthreshold_percent = 40\n").unwrap();
    fs::copy(MOUSE, path("hot/mouse.glb")).unwrap();
    fs::copy(LETTERS, path("hot/mouse@letters.png")).unwrap();
    fs::write(path("hot/mouse/figure.BMP"), picture("no-size.bmp")).unwrap();
    fs::write(path("hot/mouse@white.png"), picture("all-white.png")).unwrap();
    let whole = picture("grey.png");
    fs::write(path("hot/mouse@half.png"), &whole[..whole.len() / 2]).unwrap();
    let (code, _, err) = isomark(folder.path(), &["watch", "station.toml", "--once"]);
    assert!(code == 0 || code == 1, "{err}");

    for (name, width) in [("mouse@letters", 11.7), ("mouse@figure", 10.0)] {
        let dxf =
            fs::read(path(&format!("import/{name}.dxf"))).unwrap_or_else(|error| panic!("{error}\n{err}"));
        let size = read(&dxf, &PatternOptions::default()).unwrap().pattern.extents().size();
        // The mouse is slightly inclined under the letters.
        assert!(size.x < width + 0.01 && size.x > 0.95 * width, "{name}: {size}");
    }
    assert_eq!(fs::read_dir(path("import")).unwrap().count(), 2);
    let archived = fs::read(path("archive/mouse/mouse@letters.png")).unwrap();
    assert_eq!(archived, picture("letters.png"));
    assert!(path("archive/mouse/mouse@figure.BMP").exists());
    assert!(path("reports/mouse/mouse@letters.png.report.json").exists());
    let reason = fs::read_to_string(path("rejected/mouse@white.png.reason.txt")).unwrap();
    assert!(reason.contains("threshold of 40 %"), "{reason}");
    assert!(path("hot/mouse@half.png").exists(), "it may still be written");
    schemas::check_below(folder.path());
}
