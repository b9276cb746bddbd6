//! A sphere.

use nalgebra::{Matrix4, Point3, Vector3, Vector4};

/// A sphere in the frame of the view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sphere {
    /// mm.
    pub(crate) center: Point3<f64>,
    /// mm.
    pub(crate) radius: f64,
}

impl Sphere {
    /// Signed distance of a point, mm; positive outside.
    pub(crate) fn distance(&self, at: &Point3<f64>) -> f64 {
        (at - self.center).norm() - self.radius
    }

    /// The unit normal away from the centre; zero there.
    pub(crate) fn outward(&self, at: &Point3<f64>) -> Vector3<f64> {
        (at - self.center).try_normalize(0.0).unwrap_or_else(Vector3::zeros)
    }

    /// The sphere with the least squares of the powers of points (Pratt, Direct least-squares fitting of algebraic surfaces, SIGGRAPH 1987).
    pub(crate) fn through(points: &[Point3<f64>]) -> Option<Self> {
        let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
        let middle = Point3::from(sum / points.len() as f64);
        let (mut matrix, mut right) = (Matrix4::zeros(), Vector4::zeros());
        for point in points {
            let from = point - middle;
            let row = Vector4::new(from.x, from.y, from.z, 1.0);
            matrix += row * row.transpose();
            right += row * from.norm_squared();
        }
        let solution = matrix.cholesky()?.solve(&right);
        let to_center = solution.xyz() / 2.0;
        let radius = (solution.w + to_center.norm_squared()).sqrt();
        radius.is_finite().then(|| Self { center: middle + to_center, radius })
    }
}
