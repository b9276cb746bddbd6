//! A circular cone.

use nalgebra::{Matrix3, Point3, Unit, Vector3};

use super::shape_fit::cross_directions;
use crate::geometry::space::ViewPoint;

/// A circular cone in the frame of the view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// The apex, mm.
    pub apex: Point3<f64>,
    /// Direction of the axis from the apex into the cone.
    pub axis: Unit<Vector3<f64>>,
    /// Angle between axis and generators, rad.
    pub half_angle: f64,
}

impl Cone {
    /// The cone with an axis in this direction or against it whose apex is on the planes through points with these unit normals: with
    /// `mean`, the mean of the normals, and a point `inside` of which the apex is the tip. `None` if the planes do not meet in a point.
    pub(crate) fn from_tangent_planes(
        axis: Unit<Vector3<f64>>,
        mean: &Vector3<f64>,
        planes: impl Iterator<Item = (Point3<f64>, Vector3<f64>)>,
        inside: &Point3<f64>,
    ) -> Option<Self> {
        let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for (point, normal) in planes {
            matrix += normal * normal.transpose();
            right += normal * normal.dot(&point.coords);
        }
        let apex = Point3::from(matrix.cholesky()?.solve(&right));
        let into = if (inside - apex).dot(&axis) < 0.0 { -axis } else { axis };
        Some(Self { apex, axis: into, half_angle: mean.dot(&into).abs().min(1.0).asin() })
    }

    /// Height along the axis from the apex, mm, and the vector from the axis to the point, mm.
    pub(crate) fn split(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let from_apex = point - self.apex;
        let along = from_apex.dot(&self.axis);
        (along, from_apex - *self.axis * along)
    }

    /// Signed distance of a point from the surface, mm; positive outside.
    pub fn distance(&self, point: &Point3<f64>) -> f64 {
        let (along, radial) = self.split(point);
        radial.norm() * self.half_angle.cos() - along * self.half_angle.sin()
    }

    /// The unit normal at a point that is not on the axis, away from it.
    pub fn outward(&self, point: &Point3<f64>) -> Vector3<f64> {
        let (sin, cos) = self.half_angle.sin_cos();
        self.split(point).1.normalize() * cos - *self.axis * sin
    }

    /// Of points, the distances and their derivatives by shifts of the apex, rotations of the axis, and the half angle.
    pub(crate) fn distances_and_derivatives(self) -> impl Fn(&Point3<f64>) -> (f64, [f64; 6]) {
        let (sin, cos) = self.half_angle.sin_cos();
        let (first, second) = cross_directions(&self.axis);
        move |point| {
            let (along, radial) = self.split(point);
            let radius = radial.norm();
            let outward = radial / radius;
            let normal = outward * cos - *self.axis * sin;
            let by_turn = |direction: &Vector3<f64>| {
                -outward.dot(direction) * along * cos - radial.dot(direction) * sin
            };
            let by_angle = -radius * sin - along * cos;
            let derivatives = [-normal.x, -normal.y, -normal.z, by_turn(&first), by_turn(&second), by_angle];
            (radius * cos - along * sin, derivatives)
        }
    }

    pub(crate) fn moved(&self, step: &[f64; 6]) -> Self {
        let (first, second) = cross_directions(&self.axis);
        Self {
            apex: self.apex + Vector3::new(step[0], step[1], step[2]),
            axis: Unit::new_normalize(*self.axis + first * step[3] + second * step[4]),
            half_angle: self.half_angle + step[5],
        }
    }

    /// The point of the cone (not of its mirror image beyond the apex) on the line of sight through `at` that is
    /// nearest to `height`, mm.
    pub(crate) fn on_sight(&self, at: ViewPoint, height: f64) -> Option<Point3<f64>> {
        // (q·a)² = cos²α |q|² for q = start + z·ẑ.
        let start = Point3::new(at.x, at.y, 0.0) - self.apex;
        let square = self.half_angle.cos().powi(2);
        let axis = &*self.axis;
        let a = axis.z * axis.z - square;
        let b = start.dot(axis) * axis.z - square * start.z;
        let c = start.dot(axis).powi(2) - square * start.norm_squared();
        let root = (b * b - a * c).sqrt();
        let heights = if a.abs() < 1e-12 { [-c / (2.0 * b); 2] } else { [(-b - root) / a, (-b + root) / a] };
        let points = heights.map(|z| Point3::new(at.x, at.y, z));
        points
            .into_iter()
            .filter(|point| point.z.is_finite() && self.split(point).0 > 0.0)
            .min_by(|p, q| (p.z - height).abs().total_cmp(&(q.z - height).abs()))
    }
}
