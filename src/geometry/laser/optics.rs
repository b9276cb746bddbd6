//! The position of the part under the laser, the aim with which the marking software hits a point of it, and the beam that
//! an aim sends out.
//!
//! ```text
//! view ──Fixture::point──▶ laser's frame ──ScanHead::aim──▶ field        what to draw
//! view ◀─Fixture::in_view─ laser's frame ◀─ScanHead::cast── field        what is hit
//! ```
//!
//! The zero of the drawing, the zero of the field and the lens axis are three different points; [`ScanHead`] holds the
//! only place at which the axis is used.

use nalgebra::{Point3, Vector2, Vector3};

use crate::geometry::space::FieldPoint;

mod beam;
mod least_squares;
pub mod calibration;
pub mod registration;
pub mod measured;

pub use beam::Beam;
use measured::MeasuredLens;

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

    /// A point of the laser's frame in the view, mm: the inverse of [`point`](Self::point).
    pub fn in_view(&self, at: Point3<f64>) -> Point3<f64> {
        let back = Self { x: 0.0, y: 0.0, z: 0.0, rotation: -self.rotation };
        back.point(at - Vector3::new(self.x, self.y, self.z))
    }

    /// A direction of the view in the laser's frame.
    pub fn direction(&self, view: Vector3<f64>) -> Vector3<f64> {
        let (sin, cos) = self.rotation.sin_cos();
        Vector3::new(cos * view.x - sin * view.y, sin * view.x + cos * view.y, view.z)
    }
}

/// The projection of the lens. Pincushion and barrel distortion are left to the marking software's correction file.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[allow(
    clippy::large_enum_variant,
    reason = "a station has one lens, and its copies live as long as one job"
)]
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
    /// The beams are those that were measured.
    Measured(MeasuredLens),
}

impl Lens {
    /// The height in the laser's frame that the part must stay below, mm; infinite for a telecentric lens.
    pub fn height(&self) -> f64 {
        match self {
            Self::Telecentric => f64::INFINITY,
            Self::Perspective { x, y } => x.min(*y),
            Self::Measured(lens) => lens.height(),
        }
    }

    /// The lens that was measured, if it is one.
    pub fn measured(&self) -> Option<&MeasuredLens> {
        match self {
            Self::Measured(lens) => Some(lens),
            Self::Telecentric | Self::Perspective { .. } => None,
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
    /// Where the lens axis meets the field; not used for a telecentric lens, nor for a measured one, whose measurements
    /// contain it.
    pub axis: FieldPoint,
}

impl ScanHead {
    /// A head whose beam is parallel to its axis everywhere.
    pub const TELECENTRIC: Self = Self { lens: Lens::Telecentric, axis: FieldPoint::new(0.0, 0.0) };

    /// The point of the drawing that hits a point of the laser's frame (mm): X = x·Lx/(Lx − z), and similarly for y,
    /// with x and X measured from the lens axis. `None` if the point is as high as the lens or higher, or no measured beam
    /// reaches it.
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
            Lens::Measured(lens) => lens.aim(at),
        }
    }

    /// The beam that a point of the drawing sends out.
    pub fn beam(&self, aim: FieldPoint) -> Beam {
        match self.lens {
            Lens::Telecentric => Beam { foot: aim.coords(), slope: Vector2::zeros() },
            Lens::Perspective { x, y } => {
                let beside = aim - self.axis;
                Beam { foot: aim.coords(), slope: Vector2::new(-beside.x / x, -beside.y / y) }
            }
            Lens::Measured(lens) => lens.beam(aim),
        }
    }

    /// The point at height `z` (mm in the laser's frame) that a point of the drawing hits: the inverse of
    /// [`aim`](Self::aim).
    pub fn cast(&self, aim: FieldPoint, z: f64) -> Point3<f64> {
        self.beam(aim).at(z)
    }

    /// Unit direction against the beam, from a point of the laser's frame (mm) that must be below the lens.
    pub fn towards(&self, at: Point3<f64>) -> Vector3<f64> {
        match self.lens {
            Lens::Telecentric => Vector3::z(),
            Lens::Perspective { x, y } => {
                let beside = at.xy().coords - self.axis.coords();
                Vector3::new(-beside.x / (x - at.z), -beside.y / (y - at.z), 1.0).normalize()
            }
            Lens::Measured(lens) => lens.aim(at).map_or(Vector3::z(), |aim| lens.beam(aim).towards()),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Normally distributed numbers with a standard deviation of 1, from a fixed sequence.
    pub(super) struct Noise(pub(super) u64);

    impl Noise {
        fn uniform(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        }

        pub(super) fn next(&mut self) -> f64 {
            let (radius, angle) = (self.uniform(), self.uniform() * std::f64::consts::TAU);
            (-2.0 * radius.ln()).sqrt() * angle.cos()
        }
    }

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
    fn the_way_from_the_view_to_the_laser_leads_back() {
        let fixture = Fixture { x: 5.0, y: -3.0, z: 2.0, rotation: 0.7 };
        let point = Point3::new(1.0, 2.0, 3.0);
        assert!((fixture.in_view(fixture.point(point)) - point).norm() < 1e-12);
    }

    fn any_head() -> impl Strategy<Value = ScanHead> {
        let axis = [-150.0..150.0, -150.0..150.0f64];
        (axis, 120.0..900.0f64, 0.9..1.1, 0..3u8, -0.2..0.2f64).prop_map(
            |([x, y], near, ratio, kind, bulge)| {
                let axis = FieldPoint::new(x, y);
                let two_points = Lens::Perspective { x: near, y: near * ratio };
                let lens = match kind {
                    0 => Lens::Telecentric,
                    1 => two_points,
                    _ => {
                        // The same lens, with slopes that grow faster towards the rim and a field that is not quite true.
                        let head = ScanHead { lens: two_points, axis };
                        let rows = grid(axis, &[-10.0, 0.0, 25.0], |aim, z| {
                            let beside = (aim - axis) / 80.0;
                            let rim = beside * beside.norm_squared() * bulge;
                            head.cast(aim, z).coords.xy() + rim * (z / 25.0) + beside * 0.05
                        });
                        Lens::Measured(MeasuredLens::fit(&rows).unwrap().0)
                    }
                };
                ScanHead { lens, axis }
            },
        )
    }

    /// Measurements of a lens on 9 × 7 places round the axis.
    fn grid(
        axis: FieldPoint,
        heights: &[f64],
        seen: impl Fn(FieldPoint, f64) -> Vector2<f64>,
    ) -> Vec<measured::Sighting> {
        let places =
            (0..63).map(|i| axis + Vector2::new(f64::from(i % 9 - 4) * 20.0, f64::from(i / 9 - 3) * 25.0));
        let row = |(z, aim): (f64, FieldPoint)| measured::Sighting { aim, z, seen: seen(aim, z) };
        heights.iter().flat_map(|z| places.clone().map(|aim| (*z, aim))).map(row).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn any_table_gives_a_lens_that_casts_what_it_aims_or_a_reason(
            rows in prop::collection::vec((0..4u8, 0..4u8, 0..3u8, [-200.0..200.0f64, -200.0..200.0], any::<bool>()), 0..60),
        ) {
            let sighting = |(i, j, z, [x, y], is_wild): &(u8, u8, u8, [f64; 2], bool)| {
                let aim = FieldPoint::new(f64::from(*i) * 30.0, f64::from(*j) * 30.0);
                let share = if *is_wild { 1.0 } else { 1e-4 };
                let z = f64::from(*z) * 10.0;
                measured::Sighting { aim, z, seen: aim.coords() * (1.0 - z / 300.0) + Vector2::new(*x, *y) * share }
            };
            let rows: Vec<_> = rows.iter().map(sighting).collect();
            if let Ok((lens, _)) = MeasuredLens::fit(&rows) {
                let at = Point3::new(40.0, 50.0, 5.0);
                if let Some(aim) = lens.aim(at) {
                    prop_assert!((lens.beam(aim).at(5.0) - at).norm() < 1e-8);
                }
            }
        }

        #[test]
        fn aim_and_cast_are_inverses_for_every_lens_axis_and_fixture(
            head in any_head(),
            [x, y, z] in [-60.0..60.0f64, -60.0..60.0, -20.0..40.0],
            [shift_x, shift_y, lift, rotation] in [-20.0..20.0f64, -20.0..20.0, -15.0..20.0, -3.2..3.2f64],
        ) {
            // A point of the part, fixed near the axis wherever the zero is.
            let middle = head.axis;
            let fixture = Fixture { x: middle.x + shift_x, y: middle.y + shift_y, z: lift, rotation };
            let view = Point3::new(0.6 * x, 0.6 * y, z);
            let at = fixture.point(view);
            let aim = head.aim(at).unwrap();
            prop_assert!((head.cast(aim, at.z) - at).norm() < 1e-9);
            prop_assert!((fixture.in_view(head.cast(aim, at.z)) - view).norm() < 1e-9);
            let again = head.aim(head.cast(aim, at.z)).unwrap();
            prop_assert!(again.distance(aim) < 1e-9);
            // The direction against the beam leads along it.
            let along = head.cast(aim, at.z + 5.0) - head.cast(aim, at.z);
            prop_assert!(head.towards(at).cross(&along).norm() < 1e-8);
        }
    }

    #[test]
    fn the_fixture_rotates_before_it_shifts() {
        let fixture = Fixture { x: 5.0, y: 1.0, z: -2.0, rotation: std::f64::consts::FRAC_PI_2 };
        assert!((fixture.point(Point3::new(3.0, 0.0, 4.0)) - Point3::new(5.0, 4.0, 2.0)).norm() < 1e-12);
    }
}
