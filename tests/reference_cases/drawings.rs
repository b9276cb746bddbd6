//! The drawings of the reference cases, centred on the origin.

use std::f64::consts::TAU;

use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::pattern::{Affine, Color, Layer, Path, Pattern, Segment, Shape, Source};
use isomark::geometry::space::FlatPoint;
use nalgebra::Vector2;

/// "A B C", 39 × 13 mm.
pub(crate) fn letters() -> Pattern {
    let bytes = include_bytes!("../../examples/patterns/letters.dxf");
    let pattern = read(bytes, &PatternOptions::default()).unwrap().pattern;
    pattern.transformed(&Affine::rigid(pattern.extents().center().into(), 0.0, FlatPoint::new(0.0, 0.0)))
}

/// A grid of lines 1.3 mm apart, `width` × `height` mm.
pub(crate) fn grid(width: f64, height: f64) -> Pattern {
    let (right, top) = (width / 2.0, height / 2.0);
    let at = |low: f64, step: usize| low + 1.3 * step as f64;
    let columns = (0..=(width / 1.3).round() as usize).map(|step| at(-right, step));
    let rows = (0..=(height / 1.3).round() as usize).map(|step| at(-top, step));
    let upright = columns.map(|x| Shape::Open(vec![line([x, -top], [x, top])]));
    let level = rows.map(|y| Shape::Open(vec![line([-right, y], [right, y])]));
    drawing(upright.chain(level))
}

/// Lines across a square of `side` mm that divide it into so many parts each way.
pub(crate) fn net(side: f64, parts: u32) -> Pattern {
    let half = side / 2.0;
    let at = move |step: u32| side * f64::from(step) / f64::from(parts) - half;
    let upright = (0..=parts).map(move |step| Shape::Open(vec![line([at(step), -half], [at(step), half])]));
    let level = (0..=parts).map(move |step| Shape::Open(vec![line([-half, at(step)], [half, at(step)])]));
    drawing(upright.chain(level))
}

/// A filled square with sides of 30 mm.
pub(crate) fn square() -> Pattern {
    let corners = [[-15.0, -15.0], [15.0, -15.0], [15.0, 15.0], [-15.0, 15.0]];
    let sides = (0..4).map(|side| line(corners[side], corners[(side + 1) % 4]));
    filled(drawing([Shape::Closed(sides.collect())]))
}

/// A filled drawing as outlines.
pub(crate) fn outline(mut drawing: Pattern) -> Pattern {
    drawing.paths.iter_mut().for_each(|path| path.region = None);
    drawing
}

fn filled(mut drawing: Pattern) -> Pattern {
    drawing.paths.iter_mut().for_each(|path| path.region = Some(0));
    drawing
}

/// A filled disc of 30 mm across.
pub(crate) fn disc() -> Pattern {
    filled(drawing([Shape::Closed(vec![round(15.0, 0.0, TAU)])]))
}

/// An open ring: an arc of `radius` mm with a gap of `gap` rad on the right.
pub(crate) fn open_ring(radius: f64, gap: f64) -> Pattern {
    drawing([Shape::Open(vec![round(radius, gap / 2.0, TAU - gap)])])
}

/// Open rings about the origin with these radii, mm, the gap of each turned by `turn` rad from that of the one before.
pub(crate) fn open_rings(radii: impl IntoIterator<Item = f64>, gap: f64, turn: f64) -> Pattern {
    let ring = |(index, radius)| Shape::Open(vec![round(radius, turn * f64::from(index), TAU - gap)]);
    drawing((0u32..).zip(radii).map(ring))
}

/// Closed rings about the origin.
pub(crate) fn rings(radii: impl IntoIterator<Item = f64>) -> Pattern {
    drawing(radii.into_iter().map(|radius| Shape::Closed(vec![round(radius, 0.0, TAU)])))
}

/// A filled ring from one radius to another, mm.
pub(crate) fn filled_ring(inner: f64, outer: f64) -> Pattern {
    filled(rings([inner, outer]))
}

fn round(radius: f64, start: f64, sweep: f64) -> Segment {
    let (u, v) = (Vector2::new(radius, 0.0), Vector2::new(0.0, radius));
    Segment::Arc { center: FlatPoint::new(0.0, 0.0), u, v, start, sweep }
}

fn line(from: [f64; 2], to: [f64; 2]) -> Segment {
    Segment::Line { from: FlatPoint::new(from[0], from[1]), to: FlatPoint::new(to[0], to[1]) }
}

fn drawing(shapes: impl IntoIterator<Item = Shape>) -> Pattern {
    let path =
        |shape| Path { layer: 0, color: Color::ByLayer, shape, region: None, source: Source::default() };
    let layers = vec![Layer { name: "MARK".into(), color: Color::Aci(7) }];
    Pattern { layers, paths: shapes.into_iter().map(path).collect() }
}
