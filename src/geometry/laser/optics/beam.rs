//! A beam under the lens.

use nalgebra::{Point3, Vector2, Vector3};

/// No scan head deflects a beam as far as this, rad: 2D heads reach 35 deg in the corners of their fields.
pub(super) const STEEPEST_BEAM: f64 = 50.0 * std::f64::consts::PI / 180.0;

/// A straight beam below the lens, by its height in the laser's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// Where it meets the calibrated plane z = 0, mm.
    pub(super) foot: Vector2<f64>,
    /// How far it moves sideways for each mm of height.
    pub(super) slope: Vector2<f64>,
}

impl Beam {
    /// The point of the beam at height `z`, mm in the laser's frame.
    pub fn at(&self, z: f64) -> Point3<f64> {
        Point3::from((self.foot + self.slope * z).push(z))
    }

    /// Unit direction against the beam, to the laser.
    pub fn towards(&self) -> Vector3<f64> {
        self.slope.push(1.0).normalize()
    }
}
