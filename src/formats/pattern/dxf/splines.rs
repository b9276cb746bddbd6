//! Splines as cubic Bézier pieces: exact for degree 1 to 3, rational or not, and within a tolerance for higher degrees.
//!
//! The pieces follow from the polar form: the control points of a piece over [a, b] are the polar values at
//! (a, …, a, b, …, b), each computed by de Boor's algorithm with changing parameters (L. Ramshaw, "Blossoms are polar
//! forms", Computer Aided Geometric Design 6, 1989). The curve is defined only from knot p to knot n, which matters if
//! the knots are not clamped.

use nalgebra::{Vector3, Vector4};

use super::budget::{Budget, Exceeded};
use super::curves::{Curve, SpaceSegment, through};

/// Largest degree; drawing programs usually have 3 and at most 11.
const MAX_DEGREE: usize = 11;
/// Number of steps of the budget for checking an approximation.
const STEPS_OF_APPROXIMATION: usize = 64;

/// Ends are treated as the same point if their distance is at most this share of the curve's largest coordinate.
const ROUNDING: f64 = 1e-12;
/// The same for splines that are marked as closed, whose knots may be rounded.
const CLOSED: f64 = 1e-6;

/// A spline by control points; `weights` is empty or as long as `points`.
pub(super) struct ControlSpline<'s> {
    pub(super) degree: usize,
    pub(super) knots: &'s [f64],
    pub(super) points: &'s [Vector3<f64>],
    pub(super) weights: &'s [f64],
    /// Whether the file marks it as closed.
    pub(super) closed: bool,
}

/// The spline as a curve; pieces of degree above 3 are approximated within `tolerance`.
///
/// # Errors
/// A sentence about what is wrong with its knots, weights or degree.
pub(super) fn by_control_points(
    spline: &ControlSpline<'_>,
    tolerance: f64,
    budget: &mut Budget,
) -> Result<Curve, String> {
    let degree = spline.degree;
    if !(1..=MAX_DEGREE).contains(&degree) {
        return Err(format!("its degree {degree} is not between 1 and {MAX_DEGREE}"));
    }
    let mut points: Vec<Vector4<f64>> = Vec::with_capacity(spline.points.len());
    let weights = spline.weights.iter().copied().chain(std::iter::repeat(1.0));
    for (point, weight) in spline.points.iter().zip(weights) {
        if !(weight > 0.0 && weight.is_finite()) {
            return Err(format!("its weight {weight} is not positive"));
        }
        points.push((point * weight).push(weight));
    }
    // Some programs omit the repeated control points of a closed spline.
    if spline.closed && spline.knots.len() == points.len() + 2 * degree + 1 && points.len() >= degree {
        points.extend_from_within(..degree);
    }
    let knots = spline.knots;
    if points.len() <= degree || knots.len() != points.len() + degree + 1 {
        let (count, needed) = (knots.len(), points.len() + degree + 1);
        let points = points.len();
        return Err(format!(
            "its knot vector is invalid: it has {count} knots for {points} control points, but needs {needed}"
        ));
    }
    if knots.windows(2).any(|pair| pair[0] > pair[1]) {
        return Err("its knot vector is invalid: the knots are not in ascending order".into());
    }
    let mut segments = Vec::new();
    for span in degree..points.len() {
        if knots[span] < knots[span + 1] {
            let piece = bezier_piece(&points, knots, degree, span);
            into_cubics(&piece, tolerance, &mut segments, budget)?;
        }
    }
    if segments.is_empty() {
        return Err("its knot vector is invalid: it has no length".into());
    }
    Ok(curve(segments, if spline.closed { CLOSED } else { ROUNDING }))
}

/// A cubic spline through points with continuous second derivative, parametrised by chord length. The ends have the
/// given directions, or no curvature if no direction is given. Drawing programs draw splines of fit points in this way.
///
/// # Errors
/// When there are fewer than two different points, or the budget is exceeded.
pub(super) fn through_fit_points(
    points: &[Vector3<f64>],
    closed: bool,
    directions: [Option<Vector3<f64>>; 2],
    budget: &mut Budget,
) -> Result<Curve, String> {
    budget.hold(points.len())?;
    let mut points: Vec<Vector3<f64>> = points.to_vec();
    points.dedup();
    if closed && points.len() > 2 && points.first() != points.last() {
        points.extend(points.first().copied());
    }
    if points.len() < 2 {
        return Err("it has fewer than two different fit points".into());
    }
    if points.len() == 2 && directions == [None, None] {
        return Ok(through(&points, false));
    }
    let lengths: Vec<f64> = points.windows(2).map(|pair| (pair[1] - pair[0]).norm()).collect();
    let slopes: Vec<Vector3<f64>> =
        points.windows(2).zip(&lengths).map(|(pair, length)| (pair[1] - pair[0]) / *length).collect();
    let derivatives = if closed && points.first() == points.last() {
        closed_derivatives(&lengths, &slopes)
    } else {
        open_derivatives(&lengths, &slopes, directions.map(|d| d.and_then(|d| d.try_normalize(1e-12))))
    };
    let pieces = points.windows(2).zip(derivatives.windows(2)).zip(&lengths);
    let segments = pieces.map(|((ends, slopes), length)| SpaceSegment::Bezier {
        points: [
            ends[0],
            ends[0] + slopes[0] * (length / 3.0),
            ends[1] - slopes[1] * (length / 3.0),
            ends[1],
        ],
        weights: [1.0; 4],
    });
    Ok(curve(segments.collect(), ROUNDING))
}

/// The curve, closed if its ends are closer than the share `rounding` of its largest coordinate; wider gaps are left to
/// the joining tolerance.
fn curve(mut segments: Vec<SpaceSegment>, rounding: f64) -> Curve {
    let reach = segments.iter().map(SpaceSegment::reach).fold(0.0, f64::max);
    let start = segments.first().map(SpaceSegment::start);
    if let (
        Some(start),
        Some(SpaceSegment::Bezier { points: [.., end], .. } | SpaceSegment::Line { to: end, .. }),
    ) = (start, segments.last_mut())
        && (*end - start).norm() <= rounding * reach
    {
        *end = start;
        return Curve { segments, closed: true };
    }
    Curve { segments, closed: false }
}

/// First derivatives at the points of an open cubic spline (de Boor, A Practical Guide to Splines, ch. IV), from the
/// tridiagonal system for equal second derivatives on both sides of every inner point.
fn open_derivatives(
    lengths: &[f64],
    slopes: &[Vector3<f64>],
    ends: [Option<Vector3<f64>>; 2],
) -> Vec<Vector3<f64>> {
    let last = lengths.len();
    let mut rows: Vec<(f64, f64, f64, Vector3<f64>)> = Vec::with_capacity(last + 1);
    rows.push(match ends[0] {
        Some(direction) => (0.0, 1.0, 0.0, direction),
        None => (0.0, 2.0, 1.0, slopes[0] * 3.0),
    });
    for index in 1..last {
        let (before, after) = (lengths[index - 1], lengths[index]);
        let right = slopes[index - 1] * (3.0 * after) + slopes[index] * (3.0 * before);
        rows.push((after, 2.0 * (before + after), before, right));
    }
    rows.push(match ends[1] {
        Some(direction) => (0.0, 1.0, 0.0, direction),
        None => (1.0, 2.0, 0.0, slopes[last - 1] * 3.0),
    });
    tridiagonal(&rows)
}

/// First derivatives at the points of a closed cubic spline, the first again at the end (Sherman–Morrison on the cyclic
/// tridiagonal system; Press et al., Numerical Recipes, 2.7).
fn closed_derivatives(lengths: &[f64], slopes: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let count = lengths.len();
    if count < 3 {
        return open_derivatives(lengths, slopes, [None, None]);
    }
    let row = |index: usize| {
        let previous = (index + count - 1) % count;
        let (before, after) = (lengths[previous], lengths[index]);
        let right = slopes[previous] * (3.0 * after) + slopes[index] * (3.0 * before);
        (after, 2.0 * (before + after), before, right)
    };
    let mut rows: Vec<_> = (0..count).map(row).collect();
    let (corner_right, corner_left) = (rows[0].0, rows[count - 1].2);
    let gamma = -rows[0].1;
    rows[0].1 -= gamma;
    rows[count - 1].1 -= corner_right * corner_left / gamma;
    let base = tridiagonal(&rows);
    let unit = Vector3::new(1.0, 0.0, 0.0);
    for (index, row) in rows.iter_mut().enumerate() {
        row.3 = if index == 0 {
            unit * gamma
        } else if index == count - 1 {
            unit * corner_left
        } else {
            Vector3::zeros()
        };
    }
    let update = tridiagonal(&rows);
    let weight = corner_right / gamma;
    let factor = (base[0] + base[count - 1] * weight) / (1.0 + update[0].x + update[count - 1].x * weight);
    let mut derivatives: Vec<_> =
        base.iter().zip(&update).map(|(base, update)| base - factor * update.x).collect();
    derivatives.push(derivatives[0]);
    derivatives
}

/// Solves a diagonally dominant system with rows of (below, diagonal, above, right side).
fn tridiagonal(rows: &[(f64, f64, f64, Vector3<f64>)]) -> Vec<Vector3<f64>> {
    let mut above = Vec::with_capacity(rows.len());
    let mut right: Vec<Vector3<f64>> = Vec::with_capacity(rows.len());
    for (index, (below, diagonal, over, side)) in rows.iter().enumerate() {
        let (pivot, side) = if index == 0 {
            (*diagonal, *side)
        } else {
            (diagonal - below * above[index - 1], side - right[index - 1] * *below)
        };
        above.push(over / pivot);
        right.push(side / pivot);
    }
    for index in (0..rows.len().saturating_sub(1)).rev() {
        right[index] = right[index] - right[index + 1] * above[index];
    }
    right
}

/// The homogeneous Bézier points of the span from knot `span` to the next.
fn bezier_piece(points: &[Vector4<f64>], knots: &[f64], degree: usize, span: usize) -> Vec<Vector4<f64>> {
    let (from, to) = (knots[span], knots[span + 1]);
    (0..=degree)
        .map(|index| {
            let mut level: Vec<Vector4<f64>> = points[span - degree..=span].to_vec();
            for step in 1..=degree {
                // The last `index` of the `degree` arguments are `to`, the others `from`.
                let argument = if step > degree - index { to } else { from };
                for position in (step..=degree).rev() {
                    let knot = span - degree + position;
                    let (low, high) = (knots[knot], knots[knot + degree + 1 - step]);
                    let share = (argument - low) / (high - low);
                    level[position] = level[position - 1] * (1.0 - share) + level[position] * share;
                }
            }
            level[degree]
        })
        .collect()
}

/// Adds the cubic pieces for a homogeneous Bézier curve of any degree.
fn into_cubics(
    piece: &[Vector4<f64>],
    tolerance: f64,
    segments: &mut Vec<SpaceSegment>,
    budget: &mut Budget,
) -> Result<(), Exceeded> {
    let segment = match piece {
        [a, b] => SpaceSegment::Line { from: on_ground(a), to: on_ground(b) },
        [a, b, c] => cubic([*a, a / 3.0 + b * (2.0 / 3.0), b * (2.0 / 3.0) + c / 3.0, *c]),
        [a, b, c, d] => cubic([*a, *b, *c, *d]),
        _ => return approximate(piece, 0.0, 1.0, tolerance, 0, segments, budget),
    };
    budget.hold(1)?;
    segments.push(segment);
    Ok(())
}

fn on_ground(point: &Vector4<f64>) -> Vector3<f64> {
    point.xyz() / point.w
}

fn cubic(points: [Vector4<f64>; 4]) -> SpaceSegment {
    let weights = points.map(|point| point.w);
    // Equal weights are a polynomial curve, which is simpler to process with weights of 1.
    let weights = if weights.iter().all(|weight| *weight == weights[0]) { [1.0; 4] } else { weights };
    SpaceSegment::Bezier { points: points.map(|point| on_ground(&point)), weights }
}

/// Adds cubics with the ends and end derivatives of the curve, bisected until they are within the tolerance at seven
/// inner parameters (at most 2^10 pieces).
fn approximate(
    piece: &[Vector4<f64>],
    from: f64,
    to: f64,
    tolerance: f64,
    depth: u32,
    segments: &mut Vec<SpaceSegment>,
    budget: &mut Budget,
) -> Result<(), Exceeded> {
    budget.work(STEPS_OF_APPROXIMATION)?;
    let (start, start_slope) = point_and_derivative(piece, from);
    let (end, end_slope) = point_and_derivative(piece, to);
    let third = (to - from) / 3.0;
    let points = [start, start + start_slope * third, end - end_slope * third, end];
    let at = |t: f64| {
        let s = 1.0 - t;
        points[0] * (s * s * s)
            + points[1] * (3.0 * s * s * t)
            + points[2] * (3.0 * s * t * t)
            + points[3] * (t * t * t)
    };
    let error = (1..8)
        .map(|step| f64::from(step) / 8.0)
        .map(|t| (at(t) - point_and_derivative(piece, from + (to - from) * t).0).norm())
        .fold(0.0, f64::max);
    // Half the tolerance, because the largest error may be between the parameters.
    if error <= tolerance / 2.0 || depth == 10 {
        budget.hold(1)?;
        segments.push(SpaceSegment::Bezier { points, weights: [1.0; 4] });
        return Ok(());
    }
    let middle = (from + to) / 2.0;
    approximate(piece, from, middle, tolerance, depth + 1, segments, budget)?;
    approximate(piece, middle, to, tolerance, depth + 1, segments, budget)
}

/// A point of a homogeneous Bézier curve and its derivative, by de Casteljau's algorithm.
fn point_and_derivative(piece: &[Vector4<f64>], t: f64) -> (Vector3<f64>, Vector3<f64>) {
    let mut level = piece.to_vec();
    let degree = piece.len() - 1;
    while level.len() > 2 {
        for index in 0..level.len() - 1 {
            level[index] = level[index] * (1.0 - t) + level[index + 1] * t;
        }
        level.pop();
    }
    let point = level[0] * (1.0 - t) + level[1] * t;
    let slope = (level[1] - level[0]) * degree as f64;
    let ground = on_ground(&point);
    (ground, (slope.xyz() - ground * slope.w) / point.w)
}

#[cfg(test)]
mod tests {
    use super::super::curves::Placement;
    use super::*;
    use crate::geometry::pattern::Shape;

    fn flattened(curve: &Curve) -> Vec<crate::geometry::space::FlatPoint> {
        let scaled =
            curve.segments.iter().map(|segment| segment.placed(&Placement::scaling(1.0)).seen_from_above());
        Shape::Open(scaled.collect()).flattened(1e-4)
    }

    fn point(x: f64, y: f64) -> Vector3<f64> {
        Vector3::new(x, y, 0.0)
    }

    #[test]
    fn a_rational_quadratic_circle_is_a_circle() {
        let w = 0.5f64.sqrt();
        let points = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
            .map(|(x, y)| point(f64::from(x), f64::from(y)) * 5.0);
        let spline = ControlSpline {
            degree: 2,
            knots: &[0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 4.0],
            points: &points,
            weights: &[1.0, w, 1.0, w, 1.0, w, 1.0, w, 1.0],
            closed: true,
        };
        let curve = by_control_points(&spline, 1e-4, &mut Budget::default()).unwrap();
        assert!(curve.closed && curve.segments.len() == 4);
        assert!(flattened(&curve).iter().all(|point| (point.coords().norm() - 5.0).abs() < 1e-9));
    }

    #[test]
    fn a_spline_without_clamped_knots_begins_at_its_first_span() {
        // The uniform cubic B-spline over 1, 4, 1: its ends are weighted means of three control points.
        let points = [point(0.0, 0.0), point(6.0, 6.0), point(12.0, 0.0), point(18.0, 6.0)];
        let knots = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        let spline = ControlSpline { degree: 3, knots: &knots, points: &points, weights: &[], closed: false };
        let curve = by_control_points(&spline, 1e-4, &mut Budget::default()).unwrap();
        assert_eq!(curve.segments.len(), 1);
        assert!((curve.segments[0].start() - point(6.0, 4.0)).norm() < 1e-12);
        assert!((curve.segments[0].end() - point(12.0, 2.0)).norm() < 1e-12);
    }

    #[test]
    fn a_quintic_is_approximated_within_the_tolerance() {
        // y = x^5 over [0, 2] as one Bézier curve: all control values except the last are 0.
        let points: Vec<_> =
            (0..6).map(|i| point(f64::from(i) * 0.4, if i == 5 { 32.0 } else { 0.0 })).collect();
        let knots = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0];
        let spline = ControlSpline { degree: 5, knots: &knots, points: &points, weights: &[], closed: false };
        let curve = by_control_points(&spline, 1e-4, &mut Budget::default()).unwrap();
        // The distance to the curve is at most the vertical distance; flattening adds 1e-4.
        let steep = |x: f64| (1.0 + 25.0 * x.powi(8)).sqrt();
        assert!(flattened(&curve).iter().all(|p| (p.y - p.x.powi(5)).abs() / steep(p.x) < 2e-4));
    }

    #[test]
    fn splines_pass_through_fit_points_and_closed_ones_have_a_smooth_seam() {
        let points = [point(0.0, 0.0), point(10.0, 5.0), point(20.0, 0.0), point(8.0, -9.0)];
        let open = through_fit_points(&points, false, [Some(point(0.0, 1.0)), None], &mut Budget::default())
            .unwrap();
        assert_eq!(open.segments.len(), 3);
        let SpaceSegment::Bezier { points: first, .. } = &open.segments[0] else { panic!() };
        assert!((first[1].x - first[0].x).abs() < 1e-12 && first[1].y > first[0].y);
        let closed = through_fit_points(&points, true, [None, None], &mut Budget::default()).unwrap();
        let (SpaceSegment::Bezier { points: first, .. }, SpaceSegment::Bezier { points: last, .. }) =
            (&closed.segments[0], &closed.segments[3])
        else {
            panic!()
        };
        assert!(closed.closed);
        let lengths = [(points[1] - points[0]).norm(), (points[0] - points[3]).norm()];
        let slopes = [(first[1] - first[0]) / lengths[0], (last[3] - last[2]) / lengths[1]];
        assert!((slopes[0] - slopes[1]).norm() < 1e-12);
        let second = [
            (first[0] - first[1] * 2.0 + first[2]) / lengths[0].powi(2),
            (last[1] - last[2] * 2.0 + last[3]) / lengths[1].powi(2),
        ];
        assert!((second[0] - second[1]).norm() < 1e-12);
    }

    #[test]
    fn invalid_splines_are_refused_with_the_reason() {
        let points = [point(0.0, 0.0), point(1.0, 0.0), point(2.0, 1.0)];
        let faulty = |degree, knots: &[f64], weights: &[f64]| {
            by_control_points(
                &ControlSpline { degree, knots, points: &points, weights, closed: false },
                1e-4,
                &mut Budget::default(),
            )
            .unwrap_err()
        };
        assert!(faulty(0, &[], &[]).contains("degree"));
        assert!(faulty(2, &[0.0; 5], &[]).contains("5 knots"));
        assert!(faulty(2, &[0.0; 6], &[]).contains("no length"));
        assert!(faulty(2, &[0.0, 0.0, 0.0, 1.0, 0.5, 1.0], &[]).contains("ascending"));
        assert!(faulty(2, &[0.0, 0.0, 0.0, 1.0, 1.0, 1.0], &[1.0, 0.0, 1.0]).contains("weight"));
    }
}
