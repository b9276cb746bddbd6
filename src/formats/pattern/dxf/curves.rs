//! The curves of entities in space, before blocks and units: lines, arcs, bulges, ellipses.
//!
//! The extrusion direction gives the plane of an entity's OCS. Every curve becomes segments in the space of the block
//! that contains it, and is projected from above only when it is placed.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::budget::{Budget, Exceeded};
use crate::geometry::pattern::{Segment, Shape};
use crate::geometry::space::FlatPoint;

/// Number of steps of the budget for each point of a flattened contour.
pub(super) const STEPS_OF_POINT: usize = 8;

/// A smooth piece of a curve in space, like [`Segment`] in the plane.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum SpaceSegment {
    Line { from: Vector3<f64>, to: Vector3<f64> },
    Arc { center: Vector3<f64>, u: Vector3<f64>, v: Vector3<f64>, start: f64, sweep: f64 },
    Bezier { points: [Vector3<f64>; 4], weights: [f64; 4] },
}

/// A curve of one entity.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Curve {
    pub(super) segments: Vec<SpaceSegment>,
    pub(super) closed: bool,
}

impl Curve {
    /// A curve of the drawing plane, at height 0.
    pub(super) fn of(shape: &Shape) -> Self {
        let lifted = |point: FlatPoint| Vector3::new(point.x, point.y, 0.0);
        let segments = shape.segments().iter().map(|segment| match segment {
            Segment::Line { from, to } => SpaceSegment::Line { from: lifted(*from), to: lifted(*to) },
            Segment::Arc { center, u, v, start, sweep } => SpaceSegment::Arc {
                center: lifted(*center),
                u: u.push(0.0),
                v: v.push(0.0),
                start: *start,
                sweep: *sweep,
            },
            Segment::Bezier { points, weights } => {
                SpaceSegment::Bezier { points: points.map(lifted), weights: *weights }
            }
        });
        Self { segments: segments.collect(), closed: shape.is_closed() }
    }

    /// The curve, transformed by the placement.
    pub(super) fn placed(mut self, placement: &Placement) -> Self {
        self.segments.iter_mut().for_each(|segment| *segment = segment.placed(placement));
        self
    }
}

/// An affine map of space that places a block's content or the plane of an entity's OCS.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Placement {
    pub(super) linear: Matrix3<f64>,
    pub(super) offset: Vector3<f64>,
}

impl Placement {
    pub(super) fn scaling(factor: f64) -> Self {
        Self { linear: Matrix3::identity() * factor, offset: Vector3::zeros() }
    }

    /// The axes of the OCS for an extrusion direction (arbitrary axis algorithm, DXF Reference, "Object Coordinate
    /// Systems"). A direction of length zero is treated as +Z.
    pub(super) fn of_extrusion(extrusion: Vector3<f64>) -> Self {
        let length = extrusion.norm();
        let z = if length > 1e-12 && length.is_finite() { extrusion / length } else { Vector3::z() };
        let near_z = z.x.abs() < 1.0 / 64.0 && z.y.abs() < 1.0 / 64.0;
        let hint = if near_z { Vector3::y() } else { Vector3::z() };
        let x = hint.cross(&z).normalize();
        let y = z.cross(&x);
        Self { linear: Matrix3::from_columns(&[x, y, z]), offset: Vector3::zeros() }
    }

    /// The largest factor by which lengths in the x-y plane grow along an axis.
    pub(super) fn largest_scale(&self) -> f64 {
        self.linear.column(0).norm().max(self.linear.column(1).norm())
    }

    pub(super) fn point(&self, point: Vector3<f64>) -> Vector3<f64> {
        self.linear * point + self.offset
    }

    pub(super) fn vector(&self, vector: Vector3<f64>) -> Vector3<f64> {
        self.linear * vector
    }

    /// The map that applies `inner` first, then this one.
    pub(super) fn after(&self, inner: &Self) -> Self {
        Self { linear: self.linear * inner.linear, offset: self.point(inner.offset) }
    }
}

impl SpaceSegment {
    /// The segment, transformed by the placement.
    pub(super) fn placed(&self, placement: &Placement) -> Self {
        match self {
            Self::Line { from, to } => Self::Line { from: placement.point(*from), to: placement.point(*to) },
            Self::Arc { center, u, v, start, sweep } => Self::Arc {
                center: placement.point(*center),
                u: placement.vector(*u),
                v: placement.vector(*v),
                start: *start,
                sweep: *sweep,
            },
            Self::Bezier { points, weights } => {
                Self::Bezier { points: points.map(|point| placement.point(point)), weights: *weights }
            }
        }
    }

    /// The segment as seen from above.
    pub(super) fn seen_from_above(&self) -> Segment {
        self.projected(|vector| vector.xy())
    }

    /// Its lowest and highest z: exact, except for rational Bézier curves, see [`Segment::extents`].
    pub(super) fn heights(&self) -> [f64; 2] {
        let extents = self.projected(|vector| Vector2::new(vector.z, 0.0)).extents();
        [extents.min.x, extents.max.x]
    }

    /// The image in a plane under a linear map.
    fn projected(&self, linear: impl Fn(&Vector3<f64>) -> Vector2<f64>) -> Segment {
        let flat = |point: &Vector3<f64>| FlatPoint::from(linear(point));
        match self {
            Self::Line { from, to } => Segment::Line { from: flat(from), to: flat(to) },
            Self::Arc { center, u, v, start, sweep } => Segment::Arc {
                center: flat(center),
                u: linear(u),
                v: linear(v),
                start: *start,
                sweep: *sweep,
            },
            Self::Bezier { points, weights } => {
                Segment::Bezier { points: points.each_ref().map(flat), weights: *weights }
            }
        }
    }

    /// The largest coordinate of the points that define the segment; not finite if one of them is not.
    pub(super) fn reach(&self) -> f64 {
        let largest = |points: &[Vector3<f64>]| {
            let all = points.iter().flat_map(|point| point.iter());
            all.fold(
                0.0,
                |reach: f64, value| if value.is_nan() { f64::INFINITY } else { reach.max(value.abs()) },
            )
        };
        match self {
            Self::Line { from, to } => largest(&[*from, *to]),
            // Points on the arc, because the centre of a nearly straight arc may be far away.
            Self::Arc { .. } => largest(&[self.start(), self.middle(), self.end()]),
            Self::Bezier { points, weights } => {
                let sound = weights.iter().all(|weight| weight.is_finite() && *weight > 0.0);
                if sound { largest(points) } else { f64::INFINITY }
            }
        }
    }

    /// The point at half the parameter.
    pub(super) fn middle(&self) -> Vector3<f64> {
        match self {
            Self::Line { from, to } => (from + to) / 2.0,
            Self::Arc { center, u, v, start, sweep } => {
                let (sin, cos) = (start + sweep / 2.0).sin_cos();
                center + u * cos + v * sin
            }
            Self::Bezier { points: [a, b, c, d], weights } => {
                let [wa, wb, wc, wd] = [weights[0], 3.0 * weights[1], 3.0 * weights[2], weights[3]];
                (a * wa + b * wb + c * wc + d * wd) / (wa + wb + wc + wd)
            }
        }
    }

    pub(super) fn start(&self) -> Vector3<f64> {
        match self {
            Self::Line { from, .. } => *from,
            Self::Arc { center, u, v, start, .. } => center + u * start.cos() + v * start.sin(),
            Self::Bezier { points, .. } => points[0],
        }
    }

    pub(super) fn end(&self) -> Vector3<f64> {
        match self {
            Self::Line { to, .. } => *to,
            Self::Arc { center, u, v, start, sweep } => {
                center + u * (start + sweep).cos() + v * (start + sweep).sin()
            }
            Self::Bezier { points, .. } => points[3],
        }
    }

    pub(super) fn reversed(self) -> Self {
        match self {
            Self::Line { from, to } => Self::Line { from: to, to: from },
            Self::Arc { center, u, v, start, sweep } => {
                Self::Arc { center, u, v, start: start + sweep, sweep: -sweep }
            }
            Self::Bezier { points: [a, b, c, d], weights: [wa, wb, wc, wd] } => {
                Self::Bezier { points: [d, c, b, a], weights: [wd, wc, wb, wa] }
            }
        }
    }
}

/// A vertex of a polyline in its OCS, with the bulge of the segment that starts there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BulgeVertex {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) bulge: f64,
}

/// A polyline with bulges, at a height above the plane.
pub(super) fn bulged(vertices: &[BulgeVertex], closed: bool, plane: &Placement, height: f64) -> Curve {
    let following = vertices.iter().skip(1).chain(vertices.first().filter(|_| closed));
    let mut segments = Vec::with_capacity(vertices.len());
    for (index, (from, to)) in vertices.iter().zip(following).enumerate() {
        // A closed polyline that repeats its first vertex needs no closing line.
        let is_back = index + 1 == vertices.len();
        if is_back && index > 0 && (from.x, from.y) == (to.x, to.y) {
            continue;
        }
        segments.push(bulge_segment(from, to, height).placed(plane));
    }
    Curve { segments, closed }
}

/// The segment between two vertices: a line, or the arc whose included angle is four times the arc tangent of the
/// bulge.
pub(super) fn bulge_segment(from: &BulgeVertex, to: &BulgeVertex, height: f64) -> SpaceSegment {
    let (start, end) = (Vector3::new(from.x, from.y, height), Vector3::new(to.x, to.y, height));
    let chord = end - start;
    let bulge = from.bulge;
    // With a smaller bulge the arc is within 5e-9 of its length from the chord; rounding at its far centre would be
    // worse.
    if bulge.abs() < 1e-8 || chord.norm() == 0.0 || !bulge.is_finite() {
        return SpaceSegment::Line { from: start, to: end };
    }
    let left = Vector3::new(-chord.y, chord.x, 0.0);
    let center = start + chord / 2.0 + left * ((1.0 - bulge * bulge) / (4.0 * bulge));
    let out = start - center;
    let radius = out.norm();
    SpaceSegment::Arc {
        center,
        u: Vector3::x() * radius,
        v: Vector3::y() * radius,
        start: out.y.atan2(out.x),
        sweep: 4.0 * bulge.atan(),
    }
}

/// A sweep within this angle of a full turn is a full turn, rad. Exporters round angles to five or six digits, which
/// leaves a gap of 0.001 mm on a radius of 100 mm.
const FULL_TURN: f64 = 1e-5;
/// Angles this close are equal except for rounding in f64, rad.
const EQUAL: f64 = 1e-9;

/// The angle from start to end counter-clockwise, rad, more than 0 and at most a full turn. One or several turns within
/// [`FULL_TURN`] are exactly a full turn, and so are equal angles. An end just after the start, directly or across the
/// end of a turn (359.9999 to 0), gives a short arc, which is drawn if its radius is large.
pub(super) fn sweep_between(start: f64, end: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    let difference = end - start;
    let sweep = difference.rem_euclid(turn);
    let is_just_beyond_a_turn = sweep < FULL_TURN && difference > FULL_TURN;
    if is_just_beyond_a_turn || sweep < EQUAL || turn - sweep < FULL_TURN { turn } else { sweep }
}

/// A circular arc in an OCS, with angles in rad; the full circle is a contour.
pub(super) fn arc(center: Vector3<f64>, radius: f64, start: f64, sweep: f64, plane: &Placement) -> Curve {
    let segment = SpaceSegment::Arc {
        center,
        u: Vector3::x() * radius.abs(),
        v: Vector3::y() * radius.abs(),
        start,
        sweep,
    };
    Curve { segments: vec![segment.placed(plane)], closed: is_full_turn(sweep) }
}

/// Like [`sweep_between`], for a curve that must return to its start: a sweep below [`FULL_TURN`] is also a full turn.
pub(super) fn closing_sweep_between(start: f64, end: f64) -> f64 {
    let sweep = sweep_between(start, end);
    if sweep < FULL_TURN { std::f64::consts::TAU } else { sweep }
}

/// Whether a sweep from [`sweep_between`], or its negative, is a full turn.
pub(super) fn is_full_turn(sweep: f64) -> bool {
    sweep.abs() >= std::f64::consts::TAU
}

/// The radius and the sweep of an arc, circle or ellipse that has a radius but draws nothing: it is at most as long as
/// `rounding`, or its sweep is below [`FULL_TURN`] and it is at most a hundred times as long. A longer sliver is kept,
/// because it is part of a contour or has a large radius.
pub(super) fn vanishing(segments: &[SpaceSegment], rounding: f64) -> Option<(f64, f64)> {
    let [SpaceSegment::Arc { u, v, sweep, .. }] = segments else { return None };
    let (radius, turn) = (u.norm().max(v.norm()), sweep.abs());
    let longest = if turn < FULL_TURN { 100.0 * rounding } else { rounding };
    (radius > 0.0 && radius * turn <= longest).then_some((radius, turn))
}

/// A contour or an open polyline through points.
pub(super) fn through(points: &[Vector3<f64>], closed: bool) -> Curve {
    let following = points.iter().skip(1).chain(points.first().filter(|_| closed));
    let pairs = points.iter().zip(following).enumerate();
    let last = points.len();
    let segments = pairs
        .filter(|(index, (from, to))| index + 1 < last || from != to)
        .map(|(_, (from, to))| SpaceSegment::Line { from: *from, to: *to });
    Curve { segments: segments.collect(), closed }
}

/// Points along closed contours, projected from above, with chords within `tolerance` of them.
pub(super) fn flattened(
    contours: &[Curve],
    tolerance: f64,
    budget: &mut Budget,
) -> Result<Vec<Vec<FlatPoint>>, Exceeded> {
    let flat = |contour: &Curve| {
        let segments: Vec<_> = contour.segments.iter().map(SpaceSegment::seen_from_above).collect();
        let steps = segments.iter().map(|segment| segment.steps(tolerance)).sum::<usize>();
        budget.work(steps.saturating_mul(STEPS_OF_POINT))?;
        Ok(Shape::Closed(segments).flattened(tolerance))
    };
    contours.iter().map(flat).collect()
}

/// Adds a line to `target` unless the last segment ends there, up to rounding.
pub(super) fn bridge(
    segments: &mut Vec<SpaceSegment>,
    target: Vector3<f64>,
    budget: &mut Budget,
) -> Result<(), Exceeded> {
    let is_gap = |from: &Vector3<f64>| (target - from).norm() > 1e-9 * (1.0 + target.norm());
    if let Some(from) = segments.last().map(SpaceSegment::end).filter(is_gap) {
        budget.hold(1)?;
        segments.push(SpaceSegment::Line { from, to: target });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_arc_of_a_bulge_has_the_given_ends_and_sagitta(
            (x, y, bulge) in (-1e3..1e3f64, -1e3..1e3f64, prop_oneof![-50.0..50.0f64, -1e-3..1e-3f64])
        ) {
            let from = BulgeVertex { x: 3.0, y: -2.0, bulge };
            let to = BulgeVertex { x, y, bulge: 0.0 };
            let chord = Vector3::new(x - 3.0, y + 2.0, 0.0);
            prop_assume!(chord.norm() > 1e-3);
            let segment = bulge_segment(&from, &to, 0.0);
            // The rounding error due to the far centre at the smallest bulge that is an arc.
            let rounding = 5e-8 * chord.norm() + 1e-9;
            prop_assert!((segment.start() - Vector3::new(3.0, -2.0, 0.0)).norm() < rounding);
            prop_assert!((segment.end() - Vector3::new(x, y, 0.0)).norm() < rounding);
            // The sagitta is half the chord times the bulge (definition of the bulge), to the right of the chord.
            let right = Vector3::new(chord.y, -chord.x, 0.0) / 2.0;
            let expected = Vector3::new(3.0, -2.0, 0.0) + chord / 2.0 + right * bulge;
            prop_assert!((segment.middle() - expected).norm() < rounding + 1e-6 * bulge.abs() * chord.norm());
        }

        #[test]
        fn the_axes_of_an_extrusion_are_a_right_handed_frame(x in -1.0..1.0f64, y in -1.0..1.0f64, z in -1.0..1.0f64) {
            prop_assume!(Vector3::new(x, y, z).norm() > 1e-3);
            let axes = Placement::of_extrusion(Vector3::new(x, y, z)).linear;
            prop_assert!((axes.determinant() - 1.0).abs() < 1e-9);
            prop_assert!((axes.column(2) - Vector3::new(x, y, z).normalize()).norm() < 1e-9);
        }
    }

    #[test]
    fn a_mirrored_entity_has_its_x_negated() {
        let mirrored = Placement::of_extrusion(-Vector3::z());
        assert_eq!(mirrored.point(Vector3::new(2.0, 3.0, 0.0)), Vector3::new(-2.0, 3.0, 0.0));
    }

    #[test]
    fn sweeps_are_counter_clockwise_and_equal_angles_are_a_full_turn() {
        use std::f64::consts::{FRAC_PI_2, PI, TAU};
        assert!((sweep_between(-FRAC_PI_2, FRAC_PI_2) - PI).abs() < 1e-12);
        assert!((sweep_between(FRAC_PI_2, 0.0) - 1.5 * PI).abs() < 1e-12);
        assert_eq!(sweep_between(0.0, TAU), TAU);
        assert_eq!(sweep_between(1.0, 1.0), TAU);
    }

    #[test]
    fn a_rounded_turn_is_a_full_turn_and_a_short_arc_is_not() {
        use std::f64::consts::{FRAC_PI_2, PI, TAU};
        for start in [0.0, FRAC_PI_2, PI, -PI, 100.0] {
            for rounding in [-9e-6, -1e-12, 0.0, 1e-12, 2.9e-9, 9e-6] {
                for turns in [1.0, 2.0] {
                    let end = start + turns * TAU + rounding;
                    assert_eq!(sweep_between(start, end), TAU, "{start} {rounding}");
                }
                assert_eq!(closing_sweep_between(start, start + rounding), TAU);
            }
            for rounding in [-9e-6, -1e-12, 0.0, 1e-12] {
                assert_eq!(sweep_between(start, start - TAU + rounding), TAU, "{start} {rounding}");
            }
            assert!((sweep_between(start, start - TAU + 9e-6) - 9e-6).abs() < 1e-12);
            assert_eq!(sweep_between(start, start - 9e-6), TAU);
            assert!((sweep_between(start, start + 9e-6) - 9e-6).abs() < 1e-12);
            assert!((sweep_between(start, start + 2e-5) - 2e-5).abs() < 1e-12);
            assert!((sweep_between(start, start - 2e-5) - TAU + 2e-5).abs() < 1e-12);
        }
    }
}
