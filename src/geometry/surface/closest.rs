//! The nearest point of a surface to a point in space: point projection and, for a point on the surface, point
//! inversion.

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

use super::nurbs::NurbsSurface;
use crate::geometry::space::ViewPoint;

/// Maximum number of Newton steps; a good start needs four to six.
const MAX_STEPS: usize = 60;
/// A step shorter than this, mm, ends the search.
const SHORTEST_STEP: f64 = 1e-11;

/// The nearest point of a surface to a point in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPoint {
    /// Its parameters: its place in the view.
    pub at: ViewPoint,
    /// The point itself, mm.
    pub point: Point3<f64>,
    /// Its distance from the point in space, mm.
    pub distance: f64,
}

impl NurbsSurface {
    /// The point of the surface, within its domain, that is nearest to a point in space (mm, view frame).
    ///
    /// Newton's method with step halving starts from the point's projection along z and from the nearest control point;
    /// the nearer result is returned. On the border of the domain only steps along it are allowed (Piegl & Tiller, The
    /// NURBS Book, 1997, section 6.1, eqs. 6.3 to 6.8). For a point on the surface this is point inversion.
    ///
    /// `None` if the point is not finite. If several points are equally near, as for a point on the axis of a cylinder,
    /// one of them is returned.
    ///
    /// ```
    /// use isomark_geometry::facing_part::FacingPart;
    /// use isomark_geometry::shapes;
    /// use isomark_geometry::space::View;
    /// use isomark_geometry::surface::fit::{FitOptions, FittedSurface};
    /// use nalgebra::Point3;
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// // A ball of radius 30 mm about the origin: the nearest point is on the line to its centre.
    /// let ball = shapes::graph(25.0, 0.75, shapes::sphere);
    /// let surface = FittedSurface::of_part(&FacingPart::new(&ball, &View::top()), &FitOptions::default())?;
    /// let closest = surface.nurbs.closest(Point3::new(30.0, 0.0, 40.0)).ok_or("not finite")?;
    /// assert!((closest.distance - 20.0).abs() < 1e-3);
    /// assert!((closest.at.x - 18.0).abs() < 1e-3 && closest.at.y.abs() < 1e-3);
    /// # Ok(())
    /// # }
    /// ```
    pub fn closest(&self, to: Point3<f64>) -> Option<ClosestPoint> {
        if !to.coords.iter().all(|coordinate| coordinate.is_finite()) {
            return None;
        }
        let net = self.control_net();
        let nearest = net.iter().min_by(|a, b| (*a - to).norm_squared().total_cmp(&(*b - to).norm_squared()));
        let starts = [Some(to.xy()), nearest.map(|point| point.xy())];
        let ends = starts.into_iter().flatten().map(|start| self.descend(to, start.coords));
        ends.min_by(|a, b| a.distance.total_cmp(&b.distance))
    }

    fn descend(&self, to: Point3<f64>, start: Vector2<f64>) -> ClosestPoint {
        let domain = self.domain();
        let within = |place: Vector2<f64>| place.sup(&domain.min).inf(&domain.max);
        let mut place = within(start);
        let mut found = self.candidate(to, place);
        for _ in 0..MAX_STEPS {
            let jet = self.jet(found.at);
            let away = found.point - to;
            let slope = away.xy() + jet.gradient * away.z;
            let metric = jet.first_fundamental_form();
            let full = metric + jet.hessian * away.z;
            // Where the distance is not convex, the metric alone gives a descent direction.
            let curvature = if full.cholesky().is_some() { full } else { metric };
            let step = step_within(curvature, slope, |axis| {
                let (low, high) = (place[axis] <= domain.min[axis], place[axis] >= domain.max[axis]);
                (low && slope[axis] > 0.0) || (high && slope[axis] < 0.0)
            });
            let mut share = 1.0;
            let better = loop {
                let next = within(place + step * share);
                let candidate = self.candidate(to, next);
                // Near the end, a step changes the distance by less than its rounding error.
                if candidate.distance <= found.distance * (1.0 + f64::EPSILON) {
                    break Some((next, candidate));
                }
                share /= 2.0;
                if (step * share).norm() < SHORTEST_STEP {
                    break None;
                }
            };
            let Some((next, candidate)) = better else { break };
            let moved = (next - place).norm();
            (place, found) = (next, candidate);
            if moved < SHORTEST_STEP {
                break;
            }
        }
        found
    }

    fn candidate(&self, to: Point3<f64>, place: Vector2<f64>) -> ClosestPoint {
        let at = ViewPoint::from(place);
        let point = Point3::new(place.x, place.y, self.height(at));
        let away: Vector3<f64> = point - to;
        ClosestPoint { at, point, distance: away.norm() }
    }
}

/// The Newton step, without the coordinates that are held at the border.
fn step_within(
    curvature: Matrix2<f64>,
    slope: Vector2<f64>,
    is_held: impl Fn(usize) -> bool,
) -> Vector2<f64> {
    match (is_held(0), is_held(1)) {
        (false, false) => curvature.cholesky().map_or(-slope, |cholesky| -cholesky.solve(&slope)),
        (true, false) => Vector2::new(0.0, -slope.y / curvature.m22),
        (false, true) => Vector2::new(-slope.x / curvature.m11, 0.0),
        (true, true) => Vector2::zeros(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::surface::knots::UniformKnots;

    /// A quadratic surface over (−10, 10)², which the cubic spline reproduces exactly.
    fn bowl() -> NurbsSurface {
        let knots = UniformKnots::new(-10.0, 0.5, 40);
        let square = |greville: f64| greville * greville - 0.25 / 3.0;
        let count = knots.control_points();
        let heights = (0..count * count).map(|index| {
            let (x, y) = (knots.greville(index % count), knots.greville(index / count));
            0.05 * square(x) - 0.03 * square(y) + 0.2 * x
        });
        NurbsSurface::new(knots, knots, heights.collect()).unwrap()
    }

    #[test]
    fn points_on_the_surface_are_inverted() {
        let surface = bowl();
        for (x, y) in [(0.0, 0.0), (3.3, -7.1), (-10.0, 10.0), (9.999, 0.1), (-0.5, 9.0)] {
            let point = Point3::new(x, y, surface.height(ViewPoint::new(x, y)));
            let closest = surface.closest(point).unwrap();
            assert!(closest.distance < 1e-10, "{x}, {y}: {closest:?}");
            assert!(closest.at.distance(ViewPoint::new(x, y)) < 1e-9, "{x}, {y}: {closest:?}");
        }
    }

    #[test]
    fn a_point_on_a_normal_is_projected_to_its_foot() {
        let surface = bowl();
        for (x, y, out) in [(2.0, 1.0, 3.0), (-6.0, 4.0, -2.0), (7.0, -8.0, 4.0)] {
            let foot = ViewPoint::new(x, y);
            let jet = surface.jet(foot);
            let normal = Vector3::new(-jet.gradient.x, -jet.gradient.y, 1.0).normalize();
            let closest = surface.closest(Point3::new(x, y, jet.height) + normal * out).unwrap();
            assert!((closest.distance - out.abs()).abs() < 1e-10, "{closest:?}");
            assert!(closest.at.distance(foot) < 1e-8, "{closest:?}");
        }
    }

    #[test]
    fn no_sampled_point_is_nearer() {
        let surface = bowl();
        for (x, y, z) in [(14.0, 3.0, 2.0), (-12.0, -13.0, -20.0), (0.0, 0.0, 60.0), (5.0, 30.0, -1e3)] {
            let to = Point3::new(x, y, z);
            let closest = surface.closest(to).unwrap();
            assert!(surface.domain().contains(closest.at.coords()));
            for index in 0..=200 * 200 {
                let place = |number: usize| f64::from(number as u32) / 10.0 - 10.0;
                let at = ViewPoint::new(place(index % 201), place(index / 201));
                let sampled = (Point3::new(at.x, at.y, surface.height(at)) - to).norm();
                assert!(closest.distance <= sampled + 1e-9, "{to}: {closest:?}, but {sampled} at {at:?}");
            }
        }
    }

    #[test]
    fn a_point_that_is_not_finite_has_no_nearest_point() {
        assert_eq!(bowl().closest(Point3::new(f64::NAN, 0.0, 0.0)), None);
        assert_eq!(bowl().closest(Point3::new(0.0, f64::INFINITY, 0.0)), None);
    }
}
