//! The preview of a job: the part, the drawing before and after the correction, and the stretch of every line.

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

pub(super) fn preview(
    title: String,
    (placed, ink): (&Pattern, &Ink),
    map: &LengthTrueMap,
    surface: &FittedSurface,
    settings: &JobSettings,
    (before, after): (Option<&Distortion>, &Distortion),
    residual_under_ink: f64,
) -> Preview {
    let piece = PIECE.max(after.length / MAX_PIECES);
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
    // If a part of the drawing is outside the part, there are no results for the whole, but a range for the rest.
    let plain = |at: FlatPoint| ViewPoint::from(at.coords());
    let before_range = match before {
        Some(before) => Some(before.stretch_range),
        None => quality::stretch_range(ink, plain, |at| surface.sampled_height(at)),
    };
    Preview {
        title,
        part_outline: relief(surface, settings.correction.tolerance),
        before: lines(&plain),
        after: lines(&|at| map.point(at)),
        before_range,
        after_range: Some(after.stretch_range),
        field,
        summary,
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
        let height = surface.sampled_height(seen).unwrap_or(f64::NAN);
        nalgebra::Point3::new(seen.x, seen.y, height)
    };
    let path = |shape: &Shape| {
        if let Shape::Dot(point) = shape {
            return PreviewPath { points: vec![map(*point).coords().into()], ..PreviewPath::default() };
        }
        let stations = stations(shape, piece);
        let lifted: Vec<_> = stations.iter().map(|flat| lift(*flat)).collect();
        let mut points: Vec<[f64; 2]> = lifted.iter().map(|point| [point.x, point.y]).collect();
        let both = stations.windows(2).zip(lifted.windows(2));
        let stretch: Vec<f64> =
            both.map(|(flat, on)| (on[1] - on[0]).norm() / flat[0].distance(flat[1]) - 1.0).collect();
        if stretch.is_empty() {
            return PreviewPath { points, ..PreviewPath::default() };
        }
        let closed = shape.is_closed();
        points.pop();
        if let Some(end) = shape.segments().last().map(Segment::end).filter(|_| !closed) {
            points.push(map(end).coords().into());
        }
        PreviewPath { points, closed, stretch }
    };
    placed.paths.iter().map(|placed| path(&placed.shape)).collect()
}
