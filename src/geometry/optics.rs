//! The position of the part under the laser, and the aim with which the marking software hits a point of it.

use nalgebra::{Point3, Vector2, Vector3};

use super::space::FieldPoint;

/// The position of the part's view in the laser's frame; z = 0 is the plane in which the marking software's lens
/// correction was calibrated.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Fixture {
    /// Offset to the right in the field, mm.
    pub x: f64,
    /// Offset upwards in the field, mm.
    pub y: f64,
    /// Height of the part's origin above the calibrated plane, mm.
    pub z: f64,
    /// Rotation about the laser's axis, counter-clockwise, rad.
    pub rotation: f64,
}

impl Fixture {
    /// A point of the view in the laser's frame, mm.
    pub fn point(&self, view: Point3<f64>) -> Point3<f64> {
        Point3::from(self.direction(view.coords) + Vector3::new(self.x, self.y, self.z))
    }

    /// A direction of the view in the laser's frame.
    pub fn direction(&self, view: Vector3<f64>) -> Vector3<f64> {
        let (sin, cos) = self.rotation.sin_cos();
        Vector3::new(cos * view.x - sin * view.y, sin * view.x + cos * view.y, view.z)
    }
}

/// The projection of the lens. Pincushion and barrel distortion are left to the marking software's correction file.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Lens {
    /// The beam is parallel to the axis everywhere, so the height of the part does not shift the mark.
    #[default]
    Telecentric,
    /// For each mirror, all beams seem to start from one point.
    Perspective {
        /// Distance from the calibrated plane to that point for x, mm.
        x: f64,
        /// Distance from the calibrated plane to that point for y, mm.
        y: f64,
    },
}

impl Lens {
    /// The height in the laser's frame that the part must stay below, mm; infinite for a telecentric lens.
    pub fn height(&self) -> f64 {
        match self {
            Self::Telecentric => f64::INFINITY,
            Self::Perspective { x, y } => x.min(*y),
        }
    }
}

/// The scan head over the field: its lens, and the position of the lens axis in the field.
///
/// The origin of the marking software may be at a corner of the field; the axis does not move with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanHead {
    /// The projection of the lens.
    pub lens: Lens,
    /// Where the lens axis meets the field; not used for a telecentric lens.
    pub axis: FieldPoint,
}

impl ScanHead {
    /// A head whose beam is parallel to its axis everywhere.
    pub const TELECENTRIC: Self = Self { lens: Lens::Telecentric, axis: FieldPoint::new(0.0, 0.0) };

    /// The point of the drawing that hits a point of the laser's frame (mm): X = x·Lx/(Lx − z), and similarly for y,
    /// with x and X measured from the lens axis. `None` if the point is as high as the lens or higher.
    ///
    /// The stretch is linear in z as in Scanlab's RTC5 manual, page 176, "correction for z ≠ 0".
    pub fn aim(&self, at: Point3<f64>) -> Option<FieldPoint> {
        match self.lens {
            Lens::Telecentric => Some(FieldPoint::new(at.x, at.y)),
            Lens::Perspective { x, y } => {
                let (clear_x, clear_y) = (x - at.z, y - at.z);
                let beside = at.xy().coords - self.axis.coords();
                (clear_x > 0.0 && clear_y > 0.0)
                    .then(|| self.axis + Vector2::new(beside.x * x / clear_x, beside.y * y / clear_y))
            }
        }
    }

    /// Unit direction against the beam, from a point of the laser's frame (mm) that must be below the lens.
    pub fn towards(&self, at: Point3<f64>) -> Vector3<f64> {
        match self.lens {
            Lens::Telecentric => Vector3::z(),
            Lens::Perspective { x, y } => {
                let beside = at.xy().coords - self.axis.coords();
                Vector3::new(-beside.x / (x - at.z), -beside.y / (y - at.z), 1.0).normalize()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(x: f64, y: f64, axis: [f64; 2]) -> ScanHead {
        ScanHead { lens: Lens::Perspective { x, y }, axis: FieldPoint::new(axis[0], axis[1]) }
    }

    #[test]
    fn height_shifts_the_aim_by_the_lens_distance() {
        // At r = 50 mm, z = 10 mm, L = 300 mm the shift is 1.7 mm.
        let aim = head(300.0, 300.0, [0.0, 0.0]).aim(Point3::new(50.0, 0.0, 10.0)).unwrap();
        assert!((aim.x - 50.0 - 50.0 / 29.0).abs() < 1e-12 && aim.y == 0.0);
        let low = head(300.0, 290.0, [0.0, 0.0]);
        assert_eq!((low.lens.height(), low.aim(Point3::new(1.0, 1.0, 290.0))), (290.0, None));
    }

    #[test]
    fn the_beam_from_the_aim_lands_on_the_point() {
        for axis in [[0.0, 0.0], [100.0, 75.0], [-3.5, 20.0]] {
            let head = head(310.0, 290.0, axis);
            let at = Point3::new(40.0, -30.0, 12.0);
            let aim = head.aim(at).unwrap();
            // The beam goes from (axis, ·, Lx) in x and from (·, axis, Ly) in y through the aim at z = 0.
            let landing = [
                axis[0] + (aim.x - axis[0]) * (310.0 - 12.0) / 310.0,
                axis[1] + (aim.y - axis[1]) * (290.0 - 12.0) / 290.0,
            ];
            assert!((landing[0] - at.x).abs() < 1e-12 && (landing[1] - at.y).abs() < 1e-12);
            let back = head.towards(at);
            assert!(((at + back * ((310.0 - 12.0) / back.z)).x - axis[0]).abs() < 1e-9);
            assert!(((at + back * ((290.0 - 12.0) / back.z)).y - axis[1]).abs() < 1e-9);
        }
    }

    #[test]
    fn a_point_on_the_lens_axis_is_not_shifted() {
        let head = head(300.0, 285.0, [100.0, 75.0]);
        let on_axis = Point3::new(100.0, 75.0, 20.0);
        assert_eq!(head.aim(on_axis), Some(FieldPoint::new(100.0, 75.0)));
        assert_eq!(head.towards(on_axis), Vector3::z());
    }

    #[test]
    fn the_fixture_rotates_before_it_shifts() {
        let fixture = Fixture { x: 5.0, y: 1.0, z: -2.0, rotation: std::f64::consts::FRAC_PI_2 };
        assert!((fixture.point(Point3::new(3.0, 0.0, 4.0)) - Point3::new(5.0, 4.0, 2.0)).norm() < 1e-12);
    }
}
