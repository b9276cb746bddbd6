//! A circular cylinder.

use nalgebra::{Point3, Unit, Vector3};

use super::shape_fit::cross_directions;
use crate::geometry::space::ViewPoint;

/// A circular cylinder in the frame of the view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    /// A point of the axis, mm.
    pub center: Point3<f64>,
    /// Direction of the axis.
    pub axis: Unit<Vector3<f64>>,
    /// Radius, mm.
    pub radius: f64,
}

impl Cylinder {
    /// The cylinder with this axis on which points are as their unit normals say: across the axis, a point is the center plus the
    /// (signed) radius times the normal, which is linear in both.
    pub(crate) fn from_normals(
        axis: Unit<Vector3<f64>>,
        points: &[Point3<f64>],
        normals: &[Vector3<f64>],
    ) -> Self {
        let across = |vector: Vector3<f64>| vector - *axis * axis.dot(&vector);
        let count = points.len() as f64;
        let middle = points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / count;
        let mean = normals.iter().map(|normal| across(*normal)).sum::<Vector3<f64>>() / count;
        let (mut product, mut square) = (0.0, 0.0);
        for (point, normal) in points.iter().zip(normals) {
            let (p, n) = (across(point.coords - middle), across(*normal) - mean);
            product += p.dot(&n);
            square += n.norm_squared();
        }
        let radius = product / square;
        Self { center: Point3::from(middle - mean * radius), axis, radius: radius.abs() }
    }

    /// Distance along the axis from the centre, mm, and the vector from the axis to the point, mm.
    pub(crate) fn split(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let from_center = point - self.center;
        let along = from_center.dot(&self.axis);
        (along, from_center - *self.axis * along)
    }

    /// Signed distance of a point from the surface, mm; positive outside.
    pub fn distance(&self, point: &Point3<f64>) -> f64 {
        self.split(point).1.norm() - self.radius
    }

    /// The unit direction away from the axis at a point that is not on it.
    pub fn outward(&self, point: &Point3<f64>) -> Vector3<f64> {
        self.split(point).1.normalize()
    }

    /// Of points, the distances and their derivatives by shifts and rotations of the axis, and by the radius.
    pub(crate) fn distances_and_derivatives(self) -> impl Fn(&Point3<f64>) -> (f64, [f64; 5]) {
        let (first, second) = cross_directions(&self.axis);
        move |point| {
            let (along, radial) = self.split(point);
            let from_axis = radial.norm();
            let outward = radial / from_axis;
            let (a, b) = (outward.dot(&first), outward.dot(&second));
            (from_axis - self.radius, [-a, -b, -a * along, -b * along, -1.0])
        }
    }

    pub(crate) fn moved(&self, step: &[f64; 5]) -> Self {
        let (first, second) = cross_directions(&self.axis);
        Self {
            center: self.center + first * step[0] + second * step[1],
            axis: Unit::new_normalize(*self.axis + first * step[2] + second * step[3]),
            radius: self.radius + step[4],
        }
    }

    /// The heights z at which the line of sight through `at` meets the cylinder, mm, the lower first.
    pub(crate) fn heights(&self, at: ViewPoint) -> Option<[f64; 2]> {
        let across = |vector: Vector3<f64>| vector - *self.axis * self.axis.dot(&vector);
        let start = across(Point3::new(at.x, at.y, 0.0) - self.center);
        let sight = across(Vector3::z());
        let (a, b) = (sight.norm_squared(), start.dot(&sight));
        let c = start.norm_squared() - self.radius * self.radius;
        let root = (b * b - a * c).sqrt();
        (a > 0.0 && root.is_finite()).then(|| [(-b - root) / a, (-b + root) / a])
    }
}
