//! A cylinder or a cone that the vertices of facets show.

use nalgebra::{Matrix2, Matrix3, Point3, Unit, Vector2, Vector3};

use crate::geometry::cone::Cone;
use crate::geometry::cylinder::Cylinder;
use crate::geometry::shape_fit::{self, cross_directions, principal_directions};

/// The normals of facets on a cylinder leave the plane across its axis by at most this share of their turn in
/// that plane.
const LEAVES: f64 = 0.1;
/// The normals of facets on a cone leave the plane of their circle by at most this share of the distance
/// between the circle and a straight line.
const OF_BEND: f64 = 0.3;
/// More than the rounding error of a product of eigenvalues, as a share of the product of their sums.
const ROUNDING: f64 = 1e-13;
/// Facets that turn by less than this, rad, show no axis.
const LEAST_TURN: f64 = 0.01;
/// Points are compared with the cylinder after each of this many first steps of a fit. Most strips of other
/// surfaces are dropped after one step.
const FIRST_STEPS: usize = 3;
/// After a first step of a fit, the distance of points on a cylinder from it is at most their tolerance plus
/// this many times the error that the step neglects.
const NEGLECTED: f64 = 10.0;

/// The plane of a facet.
pub(super) struct Plane {
    pub(super) normal: Vector3<f64>,
    pub(super) at: Point3<f64>,
}

/// A round surface of straight lines.
#[derive(Debug, Clone, Copy)]
pub(super) enum Round {
    Cylinder(Cylinder),
    Cone(Cone),
}

/// The facets of a mesh that are on a shallow cylinder.
#[derive(Debug, Clone)]
pub(super) struct Camber {
    pub(super) cylinder: Round,
    /// In ascending order.
    pub(super) triangles: Vec<usize>,
    /// Another cylinder that its vertices may be on as well.
    pub(super) rival: Option<Round>,
}

impl Camber {
    /// Whether two facing sides are between two of its facets.
    pub(super) fn has(&self, facing: [u32; 2]) -> bool {
        facing.iter().all(|side| self.triangles.binary_search(&(*side as usize / 3)).is_ok())
    }
}

impl Round {
    /// The cylinder that has all points on it, within `near`, mm, and facets with these planes.
    pub(super) fn cylinder(
        planes: &[Plane],
        points: impl FnOnce() -> Vec<Point3<f64>>,
        near: f64,
    ) -> Option<Self> {
        let sum: Matrix3<f64> = planes.iter().map(|Plane { normal, .. }| normal * normal.transpose()).sum();
        let spread = sum / planes.len() as f64;
        let first = planes.first()?.normal;
        // The second largest eigenvalue is not larger than what any direction leaves of the trace.
        if 1.0 - first.dot(&(spread * first)) < LEAST_TURN * LEAST_TURN {
            return None;
        }
        let ([off, turn, _], axis) = principal(spread, LEAVES)?;
        if turn < LEAST_TURN || off > LEAVES * turn {
            return None;
        }
        let points = points();
        let is_within = |cylinder: &Cylinder, limit: f64| {
            points.iter().all(|point| cylinder.distance(point).abs() <= limit)
        };
        let mut close = circle_about(axis, &points)?;
        for _ in 0..FIRST_STEPS {
            let next = fitted_cylinder(1, &points, close);
            if !is_within(&next, near + NEGLECTED * neglected(&points, &close, &next)) {
                return None;
            }
            close = next;
        }
        let found = fitted_cylinder(shape_fit::MAX_STEPS, &points, close);
        is_within(&found, near).then_some(Self::Cylinder(found))
    }

    /// The cylinder on which the points are, within `near`, mm, and whose axis runs about in a direction.
    pub(super) fn cylinder_about(
        axis: Unit<Vector3<f64>>,
        points: &[Point3<f64>],
        near: f64,
    ) -> Option<Self> {
        let found = fitted_cylinder(shape_fit::MAX_STEPS, points, circle_about(axis, points)?);
        points.iter().all(|point| found.distance(point).abs() <= near).then_some(Self::Cylinder(found))
    }

    /// The cone from which a fit to facets with these planes may begin. Its axis is that of the circle on
    /// which the normals of a cone are, and its apex is the point in which the tangent planes meet.
    pub(super) fn start_of_cone(planes: &[Plane]) -> Option<Cone> {
        let count = planes.len() as f64;
        let mean = planes.iter().map(|plane| plane.normal).sum::<Vector3<f64>>() / count;
        let spread = planes.iter().map(|plane| plane.normal - mean).map(|off| off * off.transpose());
        let ([thin, bend, turn], axis) = principal(spread.sum::<Matrix3<f64>>() / count, OF_BEND)?;
        if turn < LEAST_TURN || thin > OF_BEND * bend {
            return None;
        }
        let first = planes.first()?.at;
        let planes = planes.iter().map(|plane| (plane.at, plane.normal));
        Cone::from_tangent_planes(axis, &mean, planes, &first)
    }

    /// The cone on which the points are, within `near`, mm, found from `start`; at its apex, or beyond it, where it has normals.
    pub(super) fn cone(start: Cone, points: &[Point3<f64>], near: f64) -> Option<Self> {
        let found = fitted_cone(points, start, near);
        let is_on = |point: &Point3<f64>| {
            let (along, radial) = found.split(point);
            (point - found.apex).norm() <= near
                || along > 0.0 && radial.norm() > near && found.distance(point).abs() <= near
        };
        let is_round = found.half_angle > 0.0 && found.half_angle < std::f64::consts::FRAC_PI_2;
        (is_round && points.iter().all(is_on)).then_some(Self::Cone(found))
    }

    /// The nearest to the points, which may be off by `near`, mm, from this one on.
    pub(super) fn fitted(&self, points: &[Point3<f64>], near: f64) -> Self {
        match self {
            Self::Cylinder(start) => Self::Cylinder(fitted_cylinder(shape_fit::MAX_STEPS, points, *start)),
            Self::Cone(start) => Self::Cone(fitted_cone(points, *start, near)),
        }
    }

    pub(super) fn axis(&self) -> Unit<Vector3<f64>> {
        match self {
            Self::Cylinder(cylinder) => cylinder.axis,
            Self::Cone(cone) => cone.axis,
        }
    }

    /// Signed distance of a point, mm; positive outside.
    pub(super) fn distance(&self, at: &Point3<f64>) -> f64 {
        match self {
            Self::Cylinder(cylinder) => cylinder.distance(at),
            Self::Cone(cone) => cone.distance(at),
        }
    }

    /// Whether a point is at the apex of a cone, within `near`, mm.
    pub(super) fn is_at_apex(&self, at: &Point3<f64>, near: f64) -> bool {
        match self {
            Self::Cylinder(_) => false,
            Self::Cone(cone) => (at - cone.apex).norm() <= near,
        }
    }

    /// How far a point is from the axis, mm. At the apex, a cone has no normal.
    pub(super) fn distance_from_axis(&self, at: &Point3<f64>) -> f64 {
        match self {
            Self::Cylinder(cylinder) => cylinder.split(at).1.norm(),
            Self::Cone(cone) => cone.split(at).1.norm(),
        }
    }

    /// The unit normal away from the axis at a point that is not on it.
    pub(super) fn outward(&self, at: &Point3<f64>) -> Vector3<f64> {
        match self {
            Self::Cylinder(cylinder) => cylinder.outward(at),
            Self::Cone(cone) => cone.outward(at),
        }
    }

    /// The unit direction of the straight line beside a point.
    pub(super) fn ruling(&self, at: &Point3<f64>) -> Vector3<f64> {
        match self {
            Self::Cylinder(cylinder) => *cylinder.axis,
            Self::Cone(cone) => (at - cone.apex).try_normalize(0.0).unwrap_or(*cone.axis),
        }
    }

    /// How far its points would be from any cylinder or cone, root mean square, mm, if its lines were arcs of
    /// a curvature, rad/mm. The arcs are those of a barrel, or all of them bend one way, as along a ring; the
    /// one that the points show less is used. A bend is measured along the normals.
    pub(super) fn shown_bend(&self, points: &[Point3<f64>], curvature: f64) -> f64 {
        let count = points.len().max(1) as f64;
        let middle = points.iter().map(|point| self.along(point)).sum::<f64>() / count;
        let from_middle = |point: &Point3<f64>| self.along(point) - middle;
        let (first, second) = cross_directions(&self.axis());
        let normal = |point: &Point3<f64>| {
            let outward = self.outward(point);
            Vector2::new(outward.dot(&first), outward.dot(&second))
        };
        let bends = |point: &Point3<f64>| {
            let sag = curvature * from_middle(point).powi(2) / 2.0;
            let normal = normal(point);
            [sag, sag * normal.x, sag * normal.y]
        };
        let left = match self {
            Self::Cylinder(cylinder) => {
                // A cylinder becomes a cone by moving each point by as many mm as it is along.
                let distance_of = cylinder.distances_and_derivatives();
                let derivatives = |point: &Point3<f64>| {
                    let [x, y, turn, other_turn, radius] = distance_of(point).1;
                    [x, y, turn, other_turn, radius, from_middle(point)]
                };
                shape_fit::left_after_fit(points, derivatives, bends)
            }
            Self::Cone(cone) => {
                let distance_of = cone.distances_and_derivatives();
                shape_fit::left_after_fit(points, |point| distance_of(point).1, bends)
            }
        };
        // For a bend in one direction, the root mean square of the movement of the points matters.
        let moved = points.iter().map(normal).map(|normal| normal * normal.transpose());
        let moved = moved.sum::<Matrix2<f64>>() / count;
        let one_way = left.fixed_view::<2, 2>(1, 1).into_owned();
        let least = moved.cholesky().map_or(0.0, |factor| {
            let half = factor.l().try_inverse().unwrap_or_else(Matrix2::zeros);
            (half * one_way * half.transpose()).symmetric_eigenvalues().min()
        });
        least.min(left[(0, 0)]).max(0.0).sqrt()
    }

    /// How far along its line a point is, mm.
    pub(super) fn along(&self, at: &Point3<f64>) -> f64 {
        match self {
            Self::Cylinder(cylinder) => at.coords.dot(&cylinder.axis),
            Self::Cone(cone) => {
                let (along, radial) = cone.split(at);
                along * cone.half_angle.cos() + radial.norm() * cone.half_angle.sin()
            }
        }
    }
}

/// The roots of the eigenvalues of a matrix in ascending order, and the direction of the first. `None` if the
/// invariants of the matrix show that the first is more than this share of the second.
///
/// For eigenvalues a = r·b ≤ b ≤ c, ab + bc + ca is at least (1 + r)·bc, and so abc·(a + b + c) at most 1 −
/// (1 + r)⁻² times its square.
pub(super) fn principal(spread: Matrix3<f64>, share: f64) -> Option<([f64; 3], Unit<Vector3<f64>>)> {
    let minor = |one: usize, two: usize| {
        spread[(one, one)] * spread[(two, two)] - spread[(one, two)] * spread[(two, one)]
    };
    let (minors, trace) = (minor(0, 1) + minor(1, 2) + minor(2, 0), spread.trace());
    let most = (1.0 - (1.0 + share * share).powi(-2)) * minors * minors;
    if spread.determinant() * trace > most + ROUNDING * trace.powi(4) {
        return None;
    }
    let (thinnest, extents) = principal_directions(&spread);
    Some((extents, thinnest))
}

/// By how much the distances of points from a cylinder differ at most, mm, from what their derivatives state after a step to the next
/// cylinder: the axis moves away from a point to the first order, and to the second past it.
fn neglected(points: &[Point3<f64>], from: &Cylinder, to: &Cylinder) -> f64 {
    let past = |point: &Point3<f64>| {
        let [before, after] = [from, to].map(|cylinder| cylinder.split(point).1);
        let moved = after - before;
        moved.norm_squared() - moved.dot(&after).powi(2) / after.norm_squared()
    };
    points.iter().map(past).fold(0.0, f64::max) / (2.0 * from.radius.min(to.radius))
}

/// The cylinder nearest to the points, in at most `steps` steps from `start`, which is close to the points.
fn fitted_cylinder(steps: usize, points: &[Point3<f64>], start: Cylinder) -> Cylinder {
    shape_fit::fitted(steps, points, start, Cylinder::distances_and_derivatives, Cylinder::moved)
}

/// The cone nearest to the points, which may be off by `near`, mm, from one that is close to them. A point at
/// its apex stays there, because distances have no derivatives at the apex.
fn fitted_cone(points: &[Point3<f64>], start: Cone, near: f64) -> Cone {
    let is_at_apex = |point: &&Point3<f64>| (*point - start.apex).norm() <= near;
    let Some(&apex) = points.iter().find(is_at_apex) else {
        return shape_fit::fitted(
            shape_fit::MAX_STEPS,
            points,
            start,
            Cone::distances_and_derivatives,
            Cone::moved,
        );
    };
    let others: Vec<Point3<f64>> = points.iter().filter(|point| !is_at_apex(point)).copied().collect();
    let distances_from = |cone: Cone| {
        let distance_of = cone.distances_and_derivatives();
        move |point: &Point3<f64>| {
            let (distance, [_, _, _, turn, other_turn, angle]) = distance_of(point);
            (distance, [turn, other_turn, angle])
        }
    };
    let moved = |cone: &Cone, &[turn, other_turn, angle]: &[f64; 3]| {
        cone.moved(&[0.0, 0.0, 0.0, turn, other_turn, angle])
    };
    let start = Cone { apex, ..start };
    shape_fit::fitted(shape_fit::MAX_STEPS, &others, start, distances_from, moved)
}

/// The cylinder about a direction whose circle is nearest to the points (Kåsa, A circle fitting procedure and its error analysis,
/// IEEE Transactions on Instrumentation and Measurement 25, 1976).
fn circle_about(axis: Unit<Vector3<f64>>, points: &[Point3<f64>]) -> Option<Cylinder> {
    let middle =
        Point3::from(points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / points.len() as f64);
    let (first, second) = cross_directions(&axis);
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for point in points {
        let from = point - middle;
        let row = Vector3::new(from.dot(&first), from.dot(&second), 1.0);
        matrix += row * row.transpose();
        right += row * (row.x * row.x + row.y * row.y);
    }
    let solution = matrix.cholesky()?.solve(&right);
    let [x, y] = [solution.x / 2.0, solution.y / 2.0];
    let radius = (solution.z + x * x + y * y).sqrt();
    radius.is_finite().then(|| Cylinder { center: middle + first * x + second * y, axis, radius })
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    #[test]
    fn the_invariants_of_a_spread_exclude_only_what_its_eigenvalues_exclude() {
        let mut state = 5u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        let (mut excluded, mut all) = (0, 0);
        for share in [LEAVES, OF_BEND] {
            for _ in 0..20_000 {
                // Roots of eigenvalues: what normals turn by, from 0.01 rad on.
                let most = 0.01 + random();
                let middle = 0.01 + (most - 0.01) * random().powi(3);
                let least = middle * random();
                let axes = Rotation3::from_euler_angles(6.0 * random(), 6.0 * random(), 6.0 * random());
                let roots = Matrix3::from_diagonal(&Vector3::new(least, middle, most));
                let half = axes.matrix() * roots;
                let found = principal(half * half.transpose(), share);
                if least < share * middle {
                    let (roots, _) = found.expect("within the share");
                    assert!((roots[0] - least).abs() < 1e-6 && (roots[1] - middle).abs() < 1e-6, "{roots:?}");
                } else {
                    (excluded, all) = (excluded + usize::from(found.is_none()), all + 1);
                }
            }
        }
        assert!(4 * excluded > 3 * all, "{excluded} of {all}");
    }

    #[test]
    fn a_bend_is_shown_by_points_between_the_ends_that_it_moves() {
        let cylinder = Cylinder { center: Point3::origin(), axis: Vector3::z_axis(), radius: 3.0 };
        let at = |degrees: f64, z: f64| {
            let angle = degrees.to_radians();
            Point3::new(3.0 * angle.cos(), 3.0 * angle.sin(), z)
        };
        // A quarter of a fillet along a ring: where it meets the plane of the ring, a bend does not move its points.
        let ends = (0..=6).flat_map(|step| [-3.0, 3.0].map(|z| at(15.0 * f64::from(step), z)));
        let mut points: Vec<Point3<f64>> = ends.chain([-1.0, 0.0, 1.0].map(|z| at(90.0, z))).collect();
        let shown = |points: &[Point3<f64>]| Round::Cylinder(cylinder).shown_bend(points, 0.01);
        assert!(shown(&points) < 1e-9, "{}", shown(&points));
        // By 0.045 mm.
        points.extend([-1.0, 0.0, 1.0].map(|z| at(0.0, z)));
        assert!(shown(&points) > 5e-3, "{}", shown(&points));
    }
}
