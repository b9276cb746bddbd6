//! The preview of a job: the part, the drawing before and after the correction, and the stretch of every line.

use nalgebra::Point3;

use super::{Distortion, FittedSurface, JobSettings, LengthTrueMap, Pattern};
use crate::geometry::height_field::Node;
use crate::geometry::ink::{Ink, stations};
use crate::geometry::mapping::quality;
use crate::geometry::pattern::{Segment, Shape};
use crate::geometry::space::{FlatPoint, ViewPoint};
use crate::preview::{HeightPicture, Preview, PreviewPath};

/// Lines are shown in pieces of this length, mm, or longer ones if there would be more than [`MAX_PIECES`].
const PIECE: f64 = 0.5;
const MAX_PIECES: f64 = 40_000.0;

/// The length of the pieces in which lines of this length are shown, mm.
pub(super) fn piece(length: f64) -> f64 {
    PIECE.max(length / MAX_PIECES)
}

pub(super) fn preview(
    title: String,
    (placed, ink): (&Pattern, &Ink),
    map: &LengthTrueMap,
    surface: &FittedSurface,
    settings: &JobSettings,
    (before, after): (Option<&Distortion>, &Distortion),
    residual_under_ink: f64,
) -> Preview {
    let piece = piece(after.length);
    let lines = |map: &dyn Fn(FlatPoint) -> ViewPoint| paths(placed, piece, map, surface);
    // The field is given in the laser's frame, and the preview shows the view. Without a rotation, the two differ
    // only by a shift.
    let fixture = &settings.fixture;
    let field = settings.field.filter(|_| fixture.rotation == 0.0).map(|field| {
        let mut area = field.extents();
        area.min -= nalgebra::Vector2::new(fixture.x, fixture.y);
        area.max -= nalgebra::Vector2::new(fixture.x, fixture.y);
        area
    });
    let row = |label: &str, value: &dyn Fn(&Distortion) -> String| {
        let old = before.map_or("not on the part".to_owned(), value);
        (label.to_owned(), format!("{old} → {}", value(after)))
    };
    let mut summary = vec![row("length error", &|d| format!("{:.3} mm", d.length_error))];
    if after.area > 0.0 {
        summary.push(row("area error", &|d| format!("{:.3} mm²", d.area_error)));
    }
    summary.push(row("largest stretch", &|d| format!("{:.2} %", d.max_stretch * 100.0)));
    summary.push(row("largest angle error", &|d| format!("{:.2}°", d.max_angle_error.to_degrees())));
    let residual = &surface.residual;
    summary.push((
        "surface residual".to_owned(),
        format!(
            "{residual_under_ink:.4} mm under the ink; {:.4} mm rms, {:.3} mm at most, at ({:.1}, {:.1})",
            residual.rms, residual.max, residual.at.x, residual.at.y
        ),
    ));
    let plain = |at: FlatPoint| ViewPoint::from(at.coords());
    Preview {
        title,
        part_outline: relief(surface, settings.correction.tolerance),
        before: lines(&plain),
        after: lines(&|at| map.point(at)),
        before_range: before_range(before, ink, surface),
        after_range: Some(after.stretch_range),
        field,
        summary,
    }
}

/// Smallest and largest stretch without a correction. If a part of the drawing is outside the part, there are no results for
/// the whole, but a range for the rest.
pub(super) fn before_range(
    before: Option<&Distortion>,
    ink: &Ink,
    surface: &FittedSurface,
) -> Option<[f64; 2]> {
    let plain = |at: FlatPoint| ViewPoint::from(at.coords());
    match before {
        Some(before) => Some(before.stretch_range),
        None => quality::stretch_range(ink, plain, |at| surface.sampled_height(at)),
    }
}

/// The part's heights, and the residuals of the fit, of which those above `limit` mm are shown: at edges, which no
/// smooth surface follows.
fn relief(surface: &FittedSurface, limit: f64) -> HeightPicture {
    let field = &surface.field;
    let (columns, rows) = field.size();
    let height = |node: &Node| match node {
        Node::Empty => None,
        Node::Wall(height) | Node::Surface(height) => Some(*height),
    };
    HeightPicture {
        origin: field.origin().into(),
        step: field.step(),
        columns,
        rows,
        heights: field.nodes().iter().map(height).collect(),
        residuals: surface.differences().to_vec(),
        residual_limit: limit,
    }
}

fn paths(
    placed: &Pattern,
    piece: f64,
    map: &dyn Fn(FlatPoint) -> ViewPoint,
    surface: &FittedSurface,
) -> Vec<PreviewPath> {
    let lift = |flat: FlatPoint| {
        let seen = map(flat);
        Point3::new(seen.x, seen.y, surface.sampled_height(seen).unwrap_or(f64::NAN))
    };
    let seen = |path: PreviewPath<3>| PreviewPath {
        points: path.points.iter().map(|[x, y, _]| [*x, *y]).collect(),
        closed: path.closed,
        stretch: path.stretch,
    };
    placed.paths.iter().map(|placed| seen(lifted(&placed.shape, piece, &lift))).collect()
}

/// A shape on the part, in pieces of at most `piece` mm with their stretch; `lift` gives the image of a point of the drawing.
pub(super) fn lifted(shape: &Shape, piece: f64, lift: &dyn Fn(FlatPoint) -> Point3<f64>) -> PreviewPath<3> {
    if let Shape::Dot(point) = shape {
        return PreviewPath { points: vec![lift(*point).coords.into()], ..PreviewPath::default() };
    }
    let stations = stations(shape, piece);
    let images: Vec<_> = stations.iter().map(|flat| lift(*flat)).collect();
    let mut points: Vec<[f64; 3]> = images.iter().map(|point| point.coords.into()).collect();
    let both = stations.windows(2).zip(images.windows(2));
    let stretch: Vec<f64> =
        both.map(|(flat, on)| (on[1] - on[0]).norm() / flat[0].distance(flat[1]) - 1.0).collect();
    if stretch.is_empty() {
        return PreviewPath { points, ..PreviewPath::default() };
    }
    let closed = shape.is_closed();
    points.pop();
    if let Some(end) = shape.segments().last().map(Segment::end).filter(|_| !closed) {
        points.push(lift(end).coords.into());
    }
    PreviewPath { points, closed, stretch }
}
