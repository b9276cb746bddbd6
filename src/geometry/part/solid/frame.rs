//! Placements of curves and surfaces in space.

use nalgebra::{Matrix3, Point3, Vector3};

/// A right-handed system of axes, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Where it is.
    pub origin: Point3<f64>,
    /// Unit direction of x.
    pub x: Vector3<f64>,
    /// Unit direction of y.
    pub y: Vector3<f64>,
    /// Unit direction of z.
    pub z: Vector3<f64>,
}

impl Frame {
    /// The axes of the part.
    pub fn identity() -> Self {
        Self { origin: Point3::origin(), x: Vector3::x(), y: Vector3::y(), z: Vector3::z() }
    }

    /// The frame with this `z` and an x as near to `x` as possible, as ISO 10303-42 defines it; missing directions are
    /// chosen. `None` if a direction has no length.
    pub fn new(origin: Point3<f64>, z: Option<Vector3<f64>>, x: Option<Vector3<f64>>) -> Option<Self> {
        let unit = |vector: Vector3<f64>| {
            let length = vector.norm();
            (length.is_finite() && length > 1e-300).then(|| vector / length)
        };
        let z = unit(z.unwrap_or_else(Vector3::z))?;
        let across = |hint: Vector3<f64>| {
            unit(hint - z * z.dot(&hint)).filter(|_| (hint - z * z.dot(&hint)).norm() > 1e-9)
        };
        let fallback = || if z.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let x = match x {
            Some(x) => across(unit(x)?).or_else(|| across(fallback())),
            None => across(Vector3::x()).or_else(|| across(Vector3::y())),
        }?;
        let finite = origin.iter().all(|value| value.is_finite());
        finite.then(|| Self { origin, x, y: z.cross(&x), z })
    }

    /// The coordinates of a point in the frame, mm.
    pub fn local(&self, point: &Point3<f64>) -> Vector3<f64> {
        let from = point - self.origin;
        Vector3::new(from.dot(&self.x), from.dot(&self.y), from.dot(&self.z))
    }

    /// The coordinates of a direction in the frame.
    pub fn local_vector(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(vector.dot(&self.x), vector.dot(&self.y), vector.dot(&self.z))
    }

    /// The direction with these coordinates in the frame.
    pub fn vector(&self, x: f64, y: f64, z: f64) -> Vector3<f64> {
        self.x * x + self.y * y + self.z * z
    }

    /// The point with these coordinates in the frame.
    pub fn point(&self, x: f64, y: f64, z: f64) -> Point3<f64> {
        self.origin + self.vector(x, y, z)
    }
}

/// A rotation and a shift, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    rotation: Matrix3<f64>,
    shift: Vector3<f64>,
}

impl Placement {
    /// No change.
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), shift: Vector3::zeros() }
    }

    /// A rotation about the origin.
    pub fn turned(rotation: Matrix3<f64>) -> Self {
        Self { rotation, shift: Vector3::zeros() }
    }

    /// The placement that moves the frame `from` onto the frame `to`.
    pub fn between(from: &Frame, to: &Frame) -> Self {
        let matrix = |frame: &Frame| Matrix3::from_columns(&[frame.x, frame.y, frame.z]);
        let rotation = matrix(to) * matrix(from).transpose();
        Self { rotation, shift: to.origin.coords - rotation * from.origin.coords }
    }

    /// First `inner`, then this one.
    pub fn after(&self, inner: &Self) -> Self {
        Self { rotation: self.rotation * inner.rotation, shift: self.rotation * inner.shift + self.shift }
    }

    /// The point after the move.
    pub fn point(&self, point: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation * point.coords + self.shift)
    }

    /// The direction after the move.
    pub fn vector(&self, vector: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * vector
    }

    /// The frame after the move.
    pub fn frame(&self, frame: &Frame) -> Frame {
        Frame {
            origin: self.point(&frame.origin),
            x: self.vector(&frame.x),
            y: self.vector(&frame.y),
            z: self.vector(&frame.z),
        }
    }
}
