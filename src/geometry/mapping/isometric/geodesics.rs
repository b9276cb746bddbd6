//! Geodesic parallel coordinates: the start of the search for the length-true map.

use nalgebra::Vector2;

use super::super::tangent::tangent_frame;
use crate::geometry::space::{FlatPoint, ViewPoint};
use crate::geometry::surface::knots::UniformKnots;
use crate::geometry::surface::nurbs::NurbsSurface;

/// Longest step along a geodesic, mm: shorter than the bends of products.
const LONGEST_STEP: f64 = 2.0;
/// Maximum number of steps from one control point to the next.
const MAX_STEPS: f64 = 100.0;

/// Largest ratio of a step in the view to its length. A path is never longer in the view than on the part, so a step
/// beyond this has left the surface.
const MAX_STEP_RATIO: f64 = 1.001;

/// A point of the view, with the view's x and y components of a unit tangent vector of the surface.
#[derive(Debug, Clone, Copy)]
struct Heading {
    at: Vector2<f64>,
    ahead: Vector2<f64>,
}

/// Control points, row by row, of the map in geodesic parallel coordinates: it maps the drawing's longer axis through
/// the anchor to a geodesic of the surface, and the lines across the axis to perpendicular geodesics, all with their
/// true lengths. On a developable surface the map is exact (do Carmo, Differential Geometry of Curves and Surfaces,
/// 1976, section 4-6, exercise 6: E = 1, F = 0).
pub(super) fn parallel_coordinates(
    surface: &NurbsSurface,
    anchor: FlatPoint,
    knots_s: &UniformKnots,
    knots_t: &UniformKnots,
) -> Vec<Vector2<f64>> {
    let directions = tangent_frame(&surface.jet(ViewPoint::from(anchor.coords())).gradient);
    let (columns, rows) = (knots_s.control_points(), knots_t.control_points());
    let mut points = vec![Vector2::zeros(); columns * rows];
    if columns >= rows {
        let start = Heading { at: anchor.coords(), ahead: directions.column(0).into_owned() };
        for (column, foot) in walk(surface, start, knots_s, anchor.x).into_iter().enumerate() {
            for (row, place) in walk(surface, foot.to_the_left(surface), knots_t, anchor.y).iter().enumerate()
            {
                points[row * columns + column] = place.at;
            }
        }
    } else {
        let start = Heading { at: anchor.coords(), ahead: directions.column(1).into_owned() };
        for (row, foot) in walk(surface, start, knots_t, anchor.y).into_iter().enumerate() {
            let to_the_right = Heading { ahead: -foot.to_the_left(surface).ahead, ..foot };
            for (column, place) in walk(surface, to_the_right, knots_s, anchor.x).iter().enumerate() {
                points[row * columns + column] = place.at;
            }
        }
    }
    quasi_interpolate(&mut points, (columns, 1), (rows, columns));
    quasi_interpolate(&mut points, (rows, columns), (columns, 1));
    points
}

impl Heading {
    /// Turned by a right angle on the surface, counter-clockwise in the view.
    fn to_the_left(self, surface: &NurbsSurface) -> Self {
        let gradient = surface.jet(self.at.into()).gradient;
        let metric = self.ahead + gradient * gradient.dot(&self.ahead);
        let lift = (1.0 + gradient.norm_squared()).sqrt();
        Self { ahead: Vector2::new(-metric.y, metric.x) / lift, ..self }
    }

    fn moved(&self, rate: &Self, length: f64) -> Self {
        Self { at: self.at + rate.at * length, ahead: self.ahead + rate.ahead * length }
    }

    /// Its derivative along the geodesic: on a graph the Christoffel symbols are f_k f_ij / (1 + |∇f|²).
    fn rate(&self, surface: &NurbsSurface) -> Self {
        let jet = surface.jet(self.at.into());
        let bend = (jet.hessian * self.ahead).dot(&self.ahead) / (1.0 + jet.gradient.norm_squared());
        Self { at: self.ahead, ahead: -jet.gradient * bend }
    }

    /// The heading after `length` mm along its geodesic (Runge–Kutta method of order 4). Where the surface bends too
    /// sharply for a step, as beyond the rim of a part, the step is straight.
    fn advanced(self, surface: &NurbsSurface, length: f64) -> Self {
        let first = self.rate(surface);
        let second = self.moved(&first, length / 2.0).rate(surface);
        let third = self.moved(&second, length / 2.0).rate(surface);
        let fourth = self.moved(&third, length).rate(surface);
        let ends = self.moved(&first, length / 6.0).moved(&fourth, length / 6.0);
        let mut next = ends.moved(&second, length / 3.0).moved(&third, length / 3.0);
        if !((next.at - self.at).norm() <= length.abs() * MAX_STEP_RATIO) {
            next = Self { at: self.at + self.ahead * length, ..self };
        }
        let climb = surface.jet(next.at.into()).gradient.dot(&next.ahead);
        Self { ahead: next.ahead / next.ahead.norm().hypot(climb), ..next }
    }
}

/// The headings at the Greville abscissae along the geodesic that passes through `start` at the parameter `from`.
fn walk(surface: &NurbsSurface, start: Heading, knots: &UniformKnots, from: f64) -> Vec<Heading> {
    let mut places = vec![start; knots.control_points()];
    let ahead = (0..places.len()).find(|&index| knots.greville(index) >= from).unwrap_or(places.len());
    let mut go = |indices: &mut dyn Iterator<Item = usize>| {
        let (mut place, mut here) = (start, from);
        for index in indices {
            let length = knots.greville(index) - here;
            let steps = (length.abs() / LONGEST_STEP).ceil().clamp(1.0, MAX_STEPS);
            (0..steps as usize).for_each(|_| place = place.advanced(surface, length / steps));
            here = knots.greville(index);
            places[index] = place;
        }
    };
    go(&mut (ahead..knots.control_points()));
    go(&mut (0..ahead).rev());
    places
}

/// Replaces values at the Greville abscissae along one axis by control points whose spline approximates them to fourth
/// order (de Boor, A Practical Guide to Splines, 2001, chapter XII: the quasi-interpolant c = f − f″h²/6).
fn quasi_interpolate(
    points: &mut [Vector2<f64>],
    (count, stride): (usize, usize),
    (lines, apart): (usize, usize),
) {
    for line in 0..lines {
        let mut before = points[line * apart];
        for index in 1..count - 1 {
            let at = line * apart + index * stride;
            let bend = before - points[at] * 2.0 + points[at + stride];
            before = points[at];
            points[at] -= bend / 6.0;
        }
    }
}
