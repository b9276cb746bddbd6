//! The round surfaces that a part's file names, or on which the points of a scan are.

use nalgebra::{Point3, Unit, Vector3};

/// A cylinder or a cone that is a face of the part according to its file, or that the points of a scan are
/// on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RoundForm {
    /// A cylinder.
    Cylinder {
        /// A point of the axis, mm.
        center: Point3<f64>,
        /// Direction of the axis.
        axis: Unit<Vector3<f64>>,
        /// Radius, mm.
        radius: f64,
    },
    /// A cone.
    Cone {
        /// The apex, mm.
        apex: Point3<f64>,
        /// Direction of the axis from the apex into the cone.
        axis: Unit<Vector3<f64>>,
        /// Angle between axis and generators, rad.
        half_angle: f64,
    },
}
