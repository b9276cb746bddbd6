//! The preview of a job: the part, the drawing before and after the correction, and the stretch of every line.

use std::sync::Arc;

use nalgebra::{Matrix2, Point3, Vector2};

use super::fill::Filled;
use super::{Distortion, FittedSurface, JobSettings, LengthTrueMap, Pattern, Projection};
use crate::geometry::height_field::Node;
use crate::geometry::ink::{Ink, stations};
use crate::geometry::mapping::quality;
use crate::geometry::mapping::tangent::tangent_frame;
use crate::geometry::pattern::{Path, Segment, Shape};
use crate::geometry::space::{FlatPoint, ViewPoint};
use crate::preview::{HeightPicture, Preview, PreviewPath, TilesPicture};

/// Lines are shown in pieces of this length, mm, unless there would be more than [`MAX_PIECES`].
const PIECE: f64 = 0.5;
/// Lines are shown in at most this many pieces; the pieces become longer instead.
const MAX_PIECES: f64 = 40_000.0;

/// The length of the pieces in which lines of this length are shown, mm.
pub(super) fn piece(length: f64) -> f64 {
    PIECE.max(length / MAX_PIECES)
}

/// What a preview shows besides part and lines.
pub(super) struct Shown {
    /// The part behind the lines.
    pub(super) part_outline: Arc<HeightPicture>,
    /// Largest distance between the part and the surface under the ink, mm.
    pub(super) residual_under_ink: f64,
    /// The drawing's anchor, about which the mark is unrolled.
    pub(super) anchor: FlatPoint,
    /// Width and height of the part in the view, mm.
    pub(super) part_size: Option<[f64; 2]>,
    /// Lowest and highest height of the ink in the laser's frame, mm.
    pub(super) heights: [f64; 2],
    /// The tiles of a mark round the part.
    pub(super) tiles: Option<TilesPicture>,
}

pub(super) fn preview(
    title: String,
    (placed, ink): (&Pattern, &Ink),
    projection: &Projection<'_>,
    settings: &JobSettings,
    (before, after): (Option<&Distortion>, &Distortion),
    Shown { part_outline, residual_under_ink, anchor, part_size, heights, tiles }: Shown,
) -> Preview {
    let Projection { map, surface, .. } = *projection;
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
    let [lowest, highest] = heights;
    summary.push((
        "best focus".to_owned(),
        format!(
            "z = {:.2} mm; the ink spans {:.2} mm of height",
            (lowest + highest) / 2.0 + 0.0,
            highest - lowest
        ),
    ));
    let residual = &surface.residual;
    summary.push((
        "surface residual".to_owned(),
        format!(
            "{residual_under_ink:.4} mm under the ink; {:.4} mm rms, {:.3} mm at most, at ({:.1}, {:.1})",
            residual.rms, residual.max, residual.at.x, residual.at.y
        ),
    ));
    let plain = |at: FlatPoint| uncorrected(projection, at);
    let marked = lines(&|at| map.point(at));
    Preview {
        title,
        part_outline,
        before: lines(&plain),
        unrolled: unrolled(placed, (map, surface), piece, anchor, after.max_stretch, &marked),
        after: marked,
        part_size,
        before_range: before_range(before, ink, projection),
        after_range: Some(after.stretch_range),
        field,
        summary,
        tiles,
    }
}

/// Adds the lines of the fill after the correction, and their spacing.
pub(super) fn add_fill(
    preview: &mut Preview,
    filled: &Filled,
    (map, surface): (&LengthTrueMap, &FittedSurface),
    anchor: FlatPoint,
    after: &Distortion,
) {
    let piece = PIECE;
    let marked = paths(&filled.shown, piece, &|at| map.point(at), surface);
    preview.unrolled.extend(unrolled(
        &filled.shown,
        (map, surface),
        piece,
        anchor,
        after.max_stretch,
        &marked,
    ));
    preview.after.extend(marked);
    let mut text = filled.report.spacing_text();
    if filled.every > 1 {
        text += &format!("; one line in {} is shown", filled.every);
    }
    preview.summary.push(("fill".to_owned(), text));
}

/// Maps with at most this stretch unroll the part: the mark on it is the drawing, to within this.
const UNROLLS: f64 = 0.05;

/// The mark on the part, unrolled about the anchor: the lines `after` the correction with the same stretch.
fn unrolled(
    placed: &Pattern,
    (map, surface): (&LengthTrueMap, &FittedSurface),
    piece: f64,
    anchor: FlatPoint,
    max_stretch: f64,
    after: &[PreviewPath],
) -> Vec<PreviewPath> {
    let develop = Development::about(ViewPoint::from(anchor.coords()), surface);
    let place = |flat: FlatPoint| match max_stretch <= UNROLLS {
        true => flat.coords(),
        false => develop.point(map.point(flat), surface) + anchor.coords(),
    };
    let path = |(path, after): (&Path, &PreviewPath)| {
        let flat = lifted(&path.shape, piece, &|flat| Point3::from(place(flat).push(0.0)));
        let points = flat.points.iter().map(|[x, y, _]| [*x, *y]).collect();
        PreviewPath { points, ..after.clone() }
    };
    placed.paths.iter().zip(after).map(path).collect()
}

/// A surface laid flat about a point: every point keeps its distance along the section of the surface towards it, and the
/// direction in which this section leaves.
struct Development {
    middle: ViewPoint,
    /// From the tangent plane at the middle to the view, and back.
    to_plane: Matrix2<f64>,
}

impl Development {
    /// Number of chords of a section.
    const CHORDS: usize = 32;

    fn about(middle: ViewPoint, surface: &FittedSurface) -> Self {
        let frame = tangent_frame(&surface.jet(middle).gradient);
        Self { middle, to_plane: frame.try_inverse().unwrap_or_else(Matrix2::identity) }
    }

    /// The place of a point of the view, from the middle, mm.
    fn point(&self, at: ViewPoint, surface: &FittedSurface) -> Vector2<f64> {
        let step = at - self.middle;
        let on_section = |chord: usize| {
            let at = self.middle.lerp(at, chord as f64 / Self::CHORDS as f64);
            Point3::new(at.x, at.y, surface.nurbs.height(at))
        };
        let length: f64 =
            (0..Self::CHORDS).map(|chord| (on_section(chord + 1) - on_section(chord)).norm()).sum();
        (self.to_plane * step).try_normalize(0.0).unwrap_or_else(Vector2::zeros) * length
    }
}

/// Smallest and largest stretch without a correction. If a part of the drawing is outside the part, there are no results for
/// the whole, but a range for the rest.
pub(super) fn before_range(
    before: Option<&Distortion>,
    ink: &Ink,
    projection: &Projection<'_>,
) -> Option<[f64; 2]> {
    let plain = |at: FlatPoint| uncorrected(projection, at);
    match before {
        Some(before) => Some(before.stretch_range),
        None => quality::stretch_range(ink, plain, |at| projection.surface.sampled_height(at)),
    }
}

/// Where a point of the drawing lands without a correction; as it is seen where the beam is not known to meet the part.
pub(super) fn uncorrected(projection: &Projection<'_>, at: FlatPoint) -> ViewPoint {
    projection.uncorrected(at).unwrap_or_else(|| at.coords().into())
}

/// The part's heights, and the residuals of the fit above `limit` mm. These are at edges, which no smooth
/// surface follows.
pub(super) fn relief(surface: &FittedSurface, limit: f64) -> HeightPicture {
    let field = &surface.field;
    let (columns, rows) = field.size();
    let height = |node: &Node| match node {
        Node::Empty => None,
        Node::Wall(height) | Node::Surface(height) => Some(*height),
    };
    let all = HeightPicture {
        origin: field.origin().into(),
        step: field.step(),
        columns,
        rows,
        heights: field.nodes().iter().map(height).collect(),
        residuals: surface.finest_differences(),
        residual_limit: limit,
    };
    all.thinned().into_owned()
}

fn on_part(at: ViewPoint, surface: &FittedSurface) -> Point3<f64> {
    Point3::new(at.x, at.y, surface.sampled_height(at).unwrap_or(f64::NAN))
}

fn paths(
    placed: &Pattern,
    piece: f64,
    map: &dyn Fn(FlatPoint) -> ViewPoint,
    surface: &FittedSurface,
) -> Vec<PreviewPath> {
    let lift = |flat: FlatPoint| on_part(map(flat), surface);
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
