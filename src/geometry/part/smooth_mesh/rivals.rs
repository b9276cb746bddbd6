//! Whether the vertices of a shallow face show one cylinder alone.
//!
//! An ellipse is the outline of a piece of either of two surfaces. One is a cylinder about one axis of the
//! ellipse. The other is nearly a cylinder about the other axis, and it is hollow where the first is not. An
//! outline that is nearly an ellipse has two surfaces as well: that of a stadium, or of a rectangle whose
//! facets show only its corners. Where a face is divided only at its outline, its surface is the one that is
//! nearer to the vertices. Rounding in files may leave no difference between the two.

use nalgebra::{Matrix2, Point3, SMatrix, SVector, Unit, Vector3, center};

use super::SmoothMesh;
use super::round::Round;
use crate::geometry::adjacency::{WELD_DISTANCE, facet_normal, middle};
use crate::geometry::shape_fit::cross_directions;

/// A face turns by at most this to either side of its middle, rad, if it is shallow.
pub(super) const SHALLOW: f64 = 0.35;
/// Of two surfaces through the same points, one is clearly nearer if the other is on average more than this
/// many times as far from the points.
const CLEARLY: f64 = 4.0;
/// What a fit leaves of points that are on a surface, mm.
const FITTED: f64 = 1e-8;
/// Surfaces that lean from one another by less than this at all points, rad, are one.
const SAME: f64 = 1e-4;
/// A cylinder is fitted to at most this many points.
const MOST_POINTS: usize = 400;
/// A parameter of a paraboloid is not determined if the points show it by less than this share of the
/// parameter that they show best.
const DETERMINED: f64 = 1e-7;

/// What else than a given surface some vertices show.
pub(super) enum Others {
    /// Nothing.
    None,
    /// They may be on this one, too.
    Perhaps(Round),
    /// They are on another one.
    Instead,
}

/// What else the corners of facets on a surface show, which may be off by `near`, mm.
pub(super) fn others(mesh: &SmoothMesh, round: &Round, triangles: &[usize], near: f64) -> Others {
    let outward = mean_normal(mesh, triangles);
    let leans = |triangle: &usize| outward.angle(&facet_normal(mesh.corners(*triangle).0)) > SHALLOW;
    if triangles.iter().any(leans) {
        return Others::None;
    }
    let points = mesh.corner_points(triangles);
    let least = FITTED * FITTED * points.len() as f64;
    let own = squares(round, &points).max(least);
    let fits = cylinders(&points, outward, near).into_iter();
    let fits: Vec<(f64, Round)> = fits.map(|other| (squares(&other, &points).max(least), other)).collect();
    if fits.iter().any(|&(off, _)| is_clear(off, own)) {
        return Others::Instead;
    }
    let turned = |other: &Round| points.iter().map(|at| between(round, other, at).1).fold(0.0, f64::max);
    let perhaps = fits.into_iter().filter(|&(off, _)| !is_clear(own, off));
    let farthest = perhaps
        .map(|(_, other)| (turned(&other), other))
        .filter(|(turn, _)| *turn > SAME)
        .max_by(|one, other| one.0.total_cmp(&other.0));
    farthest.map_or(Others::None, |(_, other)| Others::Perhaps(other))
}

/// Whether points with the first sum of squared distances are clearly nearer than those with the second.
fn is_clear(near: f64, far: f64) -> bool {
    CLEARLY * CLEARLY * near < far
}

/// The sum of the squared distances of points, mm².
pub(super) fn squares(round: &Round, points: &[Point3<f64>]) -> f64 {
    points.iter().map(|at| round.distance(at).powi(2)).sum()
}

/// The shallow cylinders on which all points of a face are, within `near`, mm; the facets of the face have a
/// mean normal. Cylinders that run down to the points beside it are excluded, for example one through the two
/// ends of a narrow face.
pub(super) fn cylinders(points: &[Point3<f64>], normal: Vector3<f64>, near: f64) -> Vec<Round> {
    let is_shallow =
        |round: &Round| points.iter().all(|at| round.outward(at).dot(&normal).abs() >= SHALLOW.cos());
    let through = |axis| Round::cylinder_about(axis, points, near);
    axes(points, normal).into_iter().filter_map(through).filter(is_shallow).collect()
}

/// How far two surfaces are apart over a triangle at most, mm, and the angle between them, rad, root mean square.
pub(super) fn apart(mesh: &SmoothMesh, rounds: [&Round; 2], triangle: usize) -> (f64, f64) {
    let corners = mesh.corners(triangle).0;
    let [a, b, c] = corners;
    let [one, other] = rounds;
    let places = [a, b, c, middle(corners), center(&a, &b), center(&b, &c), center(&c, &a)];
    let differences = places.map(|at| between(one, other, &at));
    let height = differences.iter().map(|(height, _)| *height).fold(0.0, f64::max);
    let squares = differences.iter().map(|(_, slope)| slope * slope).sum::<f64>();
    (height, (squares / places.len() as f64).sqrt())
}

/// How far two surfaces are apart at a point, mm, and the angle between them, as its sine.
fn between(one: &Round, other: &Round, at: &Point3<f64>) -> (f64, f64) {
    let [to_one, to_other] = [one, other].map(|round| round.outward(at) * -round.distance(at));
    ((to_one - to_other).norm(), one.outward(at).cross(&other.outward(at)).norm())
}

/// The mean normal of facets by their areas.
pub(super) fn mean_normal(mesh: &SmoothMesh, triangles: &[usize]) -> Vector3<f64> {
    let across = triangles.iter().map(|&triangle| {
        let [a, b, c] = mesh.corners(triangle).0;
        (b - a).cross(&(c - a))
    });
    across.sum::<Vector3<f64>>().try_normalize(0.0).unwrap_or_else(Vector3::z)
}

/// The directions that the axis of a shallow cylinder through points may have whose facets have a mean normal: the two principal
/// directions of the paraboloid nearest to the points, the flatter one first.
fn axes(points: &[Point3<f64>], normal: Vector3<f64>) -> Vec<Unit<Vector3<f64>>> {
    let center =
        Point3::from(points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / points.len() as f64);
    let reach = points.iter().map(|point| (point - center).norm()).fold(0.0, f64::max);
    let (first, second) = cross_directions(&normal);
    let (mut matrix, mut right) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
    for point in points {
        let from = (point - center) / reach;
        let (x, y) = (from.dot(&first), from.dot(&second));
        let row = SVector::<f64, 6>::from([1.0, x, y, x * x, x * y, y * y]);
        matrix += row * row.transpose();
        right += row * from.dot(&normal);
    }
    let decomposed = matrix.svd(true, true);
    let least = decomposed.singular_values.max() * DETERMINED;
    let Ok(solution) = decomposed.solve(&right, least) else { return Vec::new() };
    let [_, by_x, by_y, xx, xy, yy]: [f64; 6] = solution.into();
    let bends = Matrix2::new(2.0 * xx, xy, xy, 2.0 * yy).symmetric_eigen();
    let mut order = [0, 1];
    order.sort_by(|&one, &other| bends.eigenvalues[one].abs().total_cmp(&bends.eigenvalues[other].abs()));
    order
        .into_iter()
        .map(|index| {
            let along = bends.eigenvectors.column(index);
            let rise = along[0] * by_x + along[1] * by_y;
            Unit::new_normalize(first * along[0] + second * along[1] + normal * rise)
        })
        .collect()
}

impl SmoothMesh {
    /// The different places of the corners of some triangles, evenly chosen if there are many.
    pub(super) fn corner_points(&self, triangles: &[usize]) -> Vec<Point3<f64>> {
        let corners = triangles.iter().flat_map(|&triangle| self.corners(triangle).0);
        let mut points: Vec<Point3<f64>> = corners.collect();
        points.sort_by(|one, other| {
            let by = |axis: usize| one[axis].total_cmp(&other[axis]);
            by(0).then(by(1)).then(by(2))
        });
        points.dedup_by(|next, kept| (*next - *kept).norm() <= WELD_DISTANCE);
        let step = points.len().div_ceil(MOST_POINTS).max(1);
        points.into_iter().step_by(step).collect()
    }
}
