//! Outlines that repeat the boundary of a fill: drawings often have both, so that the edge of the fill is marked as a line.

use crate::geometry::pattern::{Path, Shape};
use crate::geometry::space::{Extents, FlatPoint};

/// An outline repeats the boundary of a fill if it is at most this far from it, mm. Programs write the two
/// with different curves and rounding, and some draw the fill slightly smaller. [`COINCIDENT_SHARE`] must
/// hold, too.
const COINCIDENT: f64 = 0.1;
/// An outline repeats the boundary of a fill if it is at most this share of its size away from it.
/// [`COINCIDENT`] must hold, too.
const COINCIDENT_SHARE: f64 = 0.01;
/// Number of points of a contour that are compared with another one.
const COMPARED: usize = 256;

/// For each of `outlines`, whether it draws the same as one of the `boundaries` of fills, whatever their curves, starts and
/// directions are.
pub(super) fn repeat_boundaries(outlines: &[&Path], boundaries: &[&Path]) -> Vec<bool> {
    let mut boxes: Vec<(Extents, usize)> =
        boundaries.iter().enumerate().map(|(index, path)| (path.shape.extents(), index)).collect();
    boxes.sort_by(|a, b| a.0.min.x.total_cmp(&b.0.min.x));
    let repeats = |outline: &&Path| {
        let own = outline.shape.extents();
        let near = COINCIDENT.min(COINCIDENT_SHARE * own.size().norm());
        let from = boxes.partition_point(|(other, _)| other.min.x < own.min.x - near);
        let beside = boxes[from..].iter().take_while(|(other, _)| other.min.x <= own.min.x + near);
        let mut alike = beside.filter(|(other, _)| {
            (own.min - other.min).amax() <= near && (own.max - other.max).amax() <= near
        });
        alike.any(|(_, index)| is_the_same(&outline.shape, &boundaries[*index].shape, near))
    };
    outlines.iter().map(repeats).collect()
}

/// Whether two contours are nowhere farther apart than `near` mm, at [`COMPARED`] points of each.
fn is_the_same(one: &Shape, other: &Shape, near: f64) -> bool {
    let [one, other] = [one, other].map(|shape| shape.flattened(near / 4.0));
    let is_near = |points: &[FlatPoint], contour: &[FlatPoint]| {
        let every = points.len().div_ceil(COMPARED).max(1);
        points.iter().step_by(every).all(|point| distance(*point, contour) <= near)
    };
    is_near(&one, &other) && is_near(&other, &one)
}

/// Distance of a point from a closed polyline, mm.
fn distance(point: FlatPoint, contour: &[FlatPoint]) -> f64 {
    let sides = contour.iter().zip(contour.iter().cycle().skip(1));
    let to_side = |(from, to): (&FlatPoint, &FlatPoint)| {
        let along = *to - *from;
        let share = (point - *from).dot(&along) / along.norm_squared();
        let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
        point.distance(from.lerp(*to, share))
    };
    sides.map(to_side).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use nalgebra::Vector2;

    use super::*;
    use crate::geometry::pattern::{Color, Segment, Source};

    fn path(segments: Vec<Segment>) -> Path {
        let shape = Shape::Closed(segments);
        Path { layer: 0, color: Color::ByLayer, shape, region: None, source: Source::default() }
    }

    fn arc(radius: f64, start: f64, sweep: f64) -> Segment {
        let (u, v) = (Vector2::new(radius, 0.0), Vector2::new(0.0, radius));
        Segment::Arc { center: FlatPoint::new(1.0, 2.0), u, v, start, sweep }
    }

    /// A circle of 5 mm as a polygon, from another start and in the other direction.
    fn polygon(sides: usize) -> Path {
        let corner = |index: usize| arc(5.0, 1.0, -TAU).point(index as f64 / sides as f64);
        path((0..sides).map(|side| Segment::Line { from: corner(side), to: corner(side + 1) }).collect())
    }

    #[test]
    fn a_contour_is_the_same_with_other_curves_starts_and_directions() {
        let circle = path(vec![arc(5.0, 0.0, TAU)]);
        let halves = path(vec![arc(5.0, 2.0, TAU / 2.0), arc(5.0, 2.0 + TAU / 2.0, TAU / 2.0)]);
        let (fine, coarse, larger) = (polygon(400), polygon(10), path(vec![arc(5.12, 0.0, TAU)]));
        let outlines = [&halves, &fine, &coarse, &larger];
        assert_eq!(repeat_boundaries(&outlines, &[&larger, &circle]), [true, true, false, true]);
        assert_eq!(repeat_boundaries(&outlines, &[]), [false; 4]);
    }
}
