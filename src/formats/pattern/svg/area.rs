//! Areas as polygons: the nonzero rule, clipping, and the dashes of lines.

use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::float::clip::FloatClip;
use i_overlay::float::simplify::SimplifyShape;
use i_overlay::float::single::SingleFloatOverlay;
use i_overlay::string::clip::ClipRule;
use kurbo::{BezPath, PathEl};

use super::super::budget::{Budget, Exceeded};
use crate::geometry::pattern::{Segment, Shape};
use crate::geometry::space::{Extents, FlatPoint};

/// Largest distance between a curve and the polygon that replaces it, mm: far below the accuracy of a laser.
pub(super) const TOLERANCE: f64 = 5e-4;
/// Largest coordinate, mm: ten kilometres.
pub(super) const MAX_COORDINATE: f64 = 1e7;
/// Length of a dash that is as good as none, for strokes 1 wide: it gives the ends of the dash a direction.
pub(super) const LEAST_DASH: f64 = 1e-4;
/// Two areas with the same outline differ at most by a band of this width, mm, which is rounding.
const ROUNDING: f64 = 1e-5;
/// Two points of a path are the same if they are nearer than this share of the tolerance of its curves.
pub(super) const ROUNDING_SHARE: f64 = 1e-3;
/// Largest number of pairs of edges that may cross; each crossing makes more edges.
const MAX_CROSSINGS: usize = 1_000_000;
/// Number of steps of the budget for each corner of a polygon.
pub(super) const STEPS_OF_CORNER: usize = 16;

/// Why areas cannot be united or cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Unworkable {
    /// They need too much work.
    Exceeded,
    /// They reach this far from the origin, mm.
    OutOfRange(f64),
}

impl From<Exceeded> for Unworkable {
    fn from(Exceeded: Exceeded) -> Self {
        Self::Exceeded
    }
}

/// Contours of polygons, mm. Those that [`united`] makes do not cross; holes have the opposite orientation.
pub(super) type Polygons = Vec<Vec<[f64; 2]>>;

/// The polygons of closed shapes.
pub(super) fn flattened(shapes: &[Shape], budget: &mut Budget) -> Result<Polygons, Unworkable> {
    let mut polygons = Vec::with_capacity(shapes.len());
    for shape in shapes {
        let count: usize = shape.segments().iter().map(|segment| segment.steps(TOLERANCE)).sum();
        budget.work(count.saturating_mul(STEPS_OF_CORNER))?;
        polygons.push(shape.flattened(TOLERANCE).iter().map(|point| [point.x, point.y]).collect());
    }
    Ok(polygons)
}

/// The area that the polygons cover by the rule.
pub(super) fn united(
    polygons: &Polygons,
    rule: FillRule,
    budget: &mut Budget,
) -> Result<Polygons, Unworkable> {
    check(polygons, budget)?;
    Ok(polygons.simplify_shape(rule).into_iter().flatten().collect())
}

/// The part of one area inside another; both must be united.
pub(super) fn intersection(
    area: &Polygons,
    clip: &Polygons,
    budget: &mut Budget,
) -> Result<Polygons, Unworkable> {
    let both: Polygons = area.iter().chain(clip).cloned().collect();
    check(&both, budget)?;
    Ok(area.overlay(clip, OverlayRule::Intersect, FillRule::NonZero).into_iter().flatten().collect())
}

/// The parts of lines inside an area.
pub(super) fn clipped(
    lines: &Polygons,
    clip: &Polygons,
    budget: &mut Budget,
) -> Result<Polygons, Unworkable> {
    let both: Polygons = lines.iter().chain(clip).cloned().collect();
    check(&both, budget)?;
    let rule = ClipRule { invert: false, boundary_included: true };
    Ok(lines.clip_by(clip, FillRule::NonZero, rule))
}

/// The enclosed area of united polygons, mm².
pub(super) fn area(polygons: &Polygons) -> f64 {
    let of = |contour: &Vec<[f64; 2]>| {
        let ends = contour.iter().zip(contour.iter().cycle().skip(1));
        ends.map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f64>() / 2.0
    };
    polygons.iter().map(of).sum::<f64>().abs()
}

/// The length of polygons, or of lines if they are open, mm.
pub(super) fn length(polygons: &Polygons, closed: bool) -> f64 {
    let of = |contour: &Vec<[f64; 2]>| {
        let following = contour.iter().skip(1).chain(contour.first().filter(|_| closed));
        contour.iter().zip(following).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).sum::<f64>()
    };
    polygons.iter().map(of).sum()
}

/// Whether two areas differ by no more than rounding along their outlines.
pub(super) fn same_area(one: &Polygons, other: &Polygons) -> bool {
    (area(one) - area(other)).abs() <= ROUNDING * length(one, true).max(length(other, true))
}

/// Whether an area is a rectangle along the axes, within `tolerance`, that covers `shown` but for a share of its longer side.
pub(super) fn is_rectangle_over(polygons: &Polygons, shown: &Extents, tolerance: f64, share: f64) -> bool {
    let [contour] = &polygons[..] else { return false };
    let own = extents(polygons);
    // An outline that nowhere leaves the border of its bounds runs round them a whole number of times.
    let is_on_border = |(a, b): (&[f64; 2], &[f64; 2])| {
        (0..2).any(|axis| {
            let is_at = |side: f64| [a, b].iter().all(|end| (end[axis] - side).abs() <= tolerance);
            is_at(own.min[axis]) || is_at(own.max[axis])
        })
    };
    let rounds = area(polygons) / (own.size().x * own.size().y);
    let near = own.grown(shown.size().max() * share);
    contour.iter().zip(contour.iter().cycle().skip(1)).all(is_on_border)
        && (rounds - 1.0).abs() < 0.5
        && near.contains(shown.min)
        && near.contains(shown.max)
}

pub(super) fn extents(polygons: &Polygons) -> Extents {
    Extents::of(polygons.iter().flatten().map(|[x, y]| FlatPoint::new(*x, *y).coords()))
}

/// Polygons as shapes; those with fewer corners than an outline or line needs are left out.
pub(super) fn shapes(polygons: Polygons, closed: bool) -> Vec<Shape> {
    let point = |[x, y]: [f64; 2]| FlatPoint::new(x, y);
    let with_corners = polygons.into_iter().filter(|contour| contour.len() > if closed { 2 } else { 1 });
    let shape = |contour: Vec<[f64; 2]>| {
        let following = contour.iter().skip(1).chain(contour.first().filter(|_| closed));
        let line = |(from, to): (&[f64; 2], &[f64; 2])| Segment::Line { from: point(*from), to: point(*to) };
        let segments = contour.iter().zip(following).map(line).collect();
        if closed { Shape::Closed(segments) } else { Shape::Open(segments) }
    };
    with_corners.map(shape).collect()
}

/// Refuses polygons that reach too far, whose coordinates lose their accuracy or overflow, and those whose edges may cross too
/// often: every crossing needs memory.
fn check(polygons: &Polygons, budget: &mut Budget) -> Result<(), Unworkable> {
    let reach = polygons.iter().flatten().flatten().map(|value| value.abs());
    // The larger one of a number and one that is none is the number.
    let reach = reach.fold(0.0, |most: f64, one| if one.is_finite() { most.max(one) } else { f64::INFINITY });
    if reach > MAX_COORDINATE {
        return Err(Unworkable::OutOfRange(reach));
    }
    let mut edges: Vec<[f64; 4]> = Vec::new();
    for contour in polygons {
        for (a, b) in contour.iter().zip(contour.iter().cycle().skip(1)) {
            edges.push([a[0].min(b[0]), a[0].max(b[0]), a[1].min(b[1]), a[1].max(b[1])]);
        }
    }
    budget.work(edges.len().saturating_mul(STEPS_OF_CORNER))?;
    edges.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut crossings = 0;
    for (index, edge) in edges.iter().enumerate() {
        let later = edges[index + 1..].iter().take_while(|later| later[0] <= edge[1]);
        let (mut looked, mut crossed) = (0, 0);
        for other in later {
            looked += 1;
            crossed += usize::from(other[2] <= edge[3] && edge[2] <= other[3]);
        }
        budget.work(looked)?;
        crossings += crossed;
        if crossings > MAX_CROSSINGS {
            return Err(Unworkable::Exceeded);
        }
    }
    Ok(())
}

/// The shapes as a path of lines and curves; arcs become curves within `tolerance`. Lines without a length are left out: they would
/// have no direction.
pub(super) fn curves(shapes: &[Shape], tolerance: f64) -> BezPath {
    let at = |point: FlatPoint| kurbo::Point::new(point.x, point.y);
    let least = tolerance * ROUNDING_SHARE;
    let mut path = BezPath::new();
    for shape in shapes {
        let Some(first) = shape.segments().first() else {
            if let Shape::Dot(point) = shape {
                path.move_to(at(*point));
                path.line_to(at(*point));
            }
            continue;
        };
        let begin = at(first.start());
        let mut pen = begin;
        let mut elements: Vec<PathEl> = Vec::new();
        for segment in shape.segments() {
            let to = at(segment.end());
            match segment {
                Segment::Line { .. } if pen.distance(to) <= least => continue,
                Segment::Line { .. } => elements.push(PathEl::LineTo(to)),
                Segment::Bezier { points: [_, b, c, _], .. } => {
                    elements.push(PathEl::CurveTo(at(*b), at(*c), to));
                }
                Segment::Arc { .. } => elements.extend(curves_of_arc(segment, tolerance)),
            }
            end_at(&mut elements, to);
            pen = to;
        }
        if shape.is_closed() && pen.distance(begin) <= least {
            end_at(&mut elements, begin);
        }
        if elements.is_empty() {
            elements.push(PathEl::LineTo(pen));
        }
        path.move_to(begin);
        path.extend(elements);
        if shape.is_closed() {
            path.close_path();
        }
    }
    path
}

/// The curves of an arc; none of other segments.
fn curves_of_arc(segment: &Segment, tolerance: f64) -> Vec<PathEl> {
    let Segment::Arc { center, u, v, start, sweep } = segment else { return Vec::new() };
    // The arc of the unit circle, whose axes any map may turn, stretch and slant.
    let unit = kurbo::Arc {
        center: kurbo::Point::ZERO,
        radii: kurbo::Vec2::new(1.0, 1.0),
        start_angle: *start,
        sweep_angle: *sweep,
        x_rotation: 0.0,
    };
    let map = kurbo::Affine::new([u.x, u.y, v.x, v.y, center.x, center.y]);
    unit.append_iter(tolerance / u.norm().max(v.norm())).map(|element| map * element).collect()
}

/// Moves the end of a path to where it is without rounding.
fn end_at(elements: &mut [PathEl], to: kurbo::Point) {
    if let Some(PathEl::LineTo(end) | PathEl::CurveTo(_, _, end)) = elements.last_mut() {
        *end = to;
    }
}

/// The pieces of dashed lines; those not longer than `least` are dots.
pub(super) fn dashes(
    shapes: &[Shape],
    pattern: &[f64],
    offset: f64,
    least: f64,
    tolerance: f64,
) -> Vec<Shape> {
    let point = |point: kurbo::Point| FlatPoint::new(point.x, point.y);
    let mut pieces: Vec<(Vec<Segment>, bool)> = Vec::new();
    let mut at = FlatPoint::new(0.0, 0.0);
    for element in kurbo::dash(curves(shapes, tolerance).elements().iter().copied(), offset, pattern) {
        let segment = match element {
            PathEl::MoveTo(to) => {
                at = point(to);
                pieces.push((Vec::new(), false));
                continue;
            }
            PathEl::LineTo(to) => Segment::Line { from: at, to: point(to) },
            PathEl::QuadTo(control, to) => {
                let (control, to) = (point(control), point(to));
                let third = |end: FlatPoint| ((end.coords() + control.coords() * 2.0) / 3.0).into();
                Segment::Bezier { points: [at, third(at), third(to), to], weights: [1.0; 4] }
            }
            PathEl::CurveTo(b, c, to) => {
                Segment::Bezier { points: [at, point(b), point(c), point(to)], weights: [1.0; 4] }
            }
            // One dash is as long as the whole contour; its last segment may follow.
            PathEl::ClosePath => {
                if let Some((_, is_closed)) = pieces.last_mut() {
                    *is_closed = true;
                }
                continue;
            }
        };
        at = segment.end();
        if let Some((piece, _)) = pieces.last_mut() {
            piece.push(segment);
        }
    }
    let shape = |(piece, is_closed): (Vec<Segment>, bool)| match piece[..] {
        [Segment::Line { from, to }] if from.distance(to) <= least => Shape::Dot(from + (to - from) / 2.0),
        _ if is_closed => Shape::Closed(piece),
        _ => Shape::Open(piece),
    };
    pieces.into_iter().filter(|(piece, _)| !piece.is_empty()).map(shape).collect()
}

/// The length of the shapes, in their units.
pub(super) fn path_length(shapes: &[Shape], tolerance: f64) -> f64 {
    curves(shapes, tolerance)
        .segments()
        .map(|segment| kurbo::ParamCurveArclen::arclen(&segment, tolerance))
        .sum()
}
