//! The exact map onto a cone with any direction, tilt and offset.

use nalgebra::{Matrix3, Point3, Vector2, Vector3};

use super::cylinder::ON_FACE;
use super::patch::{SampledPatch, TooFewPoints};
use super::tangent::tangent_frame;
pub use crate::geometry::cone::Cone;
use crate::geometry::shape_fit::{ONE_WAY, principal_directions};
use crate::geometry::solid::round::RoundForm;
use crate::geometry::space::{FlatPoint, ViewPoint};

/// A cone that was fitted to a part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConeFit {
    /// The cone.
    pub cone: Cone,
    /// Largest distance of a sampled point from it, mm.
    pub residual: f64,
    /// Whether its radius is known well: from the part's file, or because the surface beside the drawing is on it, too.
    pub is_determined: bool,
}

/// Why no cone was found under the drawing.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ConeError {
    /// There are too few points of the part under the drawing.
    #[error(transparent)]
    TooFewPoints(#[from] TooFewPoints),
    /// The normals do not lie on a circle: the surface is flat, a cylinder or not a cone.
    #[error("the surface under the drawing is not a cone: {what}")]
    NoApex {
        /// What was found instead.
        what: &'static str,
    },
    /// The anchor's line of sight misses the cone.
    #[error("the anchor at ({:.3}, {:.3}) mm is outside the cone", at.x, at.y)]
    AnchorBeside {
        /// Position of the anchor.
        at: ViewPoint,
    },
    /// The drawing extends beyond the apex.
    #[error(
        "the apex of the cone is only {distance:.3} mm from the anchor, but the drawing extends {reach:.3} mm"
    )]
    ApexInDrawing {
        /// Distance from the anchor to the apex, mm.
        distance: f64,
        /// Distance from the anchor to the farthest point of the drawing, mm.
        reach: f64,
    },
}

/// Surfaces whose normals turn by less than this under the drawing, rad, are treated as flat: the axis is undetermined.
const MIN_TURN: f64 = 0.01;
/// Cones slimmer or flatter than this, rad, are better treated as cylinders or planes.
const MIN_ANGLE: f64 = 0.5 * std::f64::consts::PI / 180.0;

impl ConeFit {
    /// The cone of the part's file on which all points of the patch are; `None` if there is none.
    pub(super) fn known(known: &[RoundForm], patch: &SampledPatch) -> Option<Self> {
        known.iter().find_map(|form| {
            let RoundForm::Cone { apex, axis, half_angle } = *form else { return None };
            let cone = Cone { apex, axis, half_angle };
            let residual = patch.largest_distance(|point| cone.distance(point));
            (residual <= ON_FACE).then_some(Self { cone, residual, is_determined: true })
        })
    }

    /// The cone that best fits the part under the drawing.
    ///
    /// The start follows from two facts: the normals of a cone lie on a circle about its axis, and its tangent planes
    /// meet in its apex. Then the squared distances are minimised (Lukács, Martin & Marshall, Faithful least-squares
    /// fitting of spheres, cylinders, cones and tori, ECCV 1998).
    ///
    /// # Errors
    /// See [`ConeError`].
    pub fn to(patch: &SampledPatch) -> Result<Self, ConeError> {
        let start = start_cone(patch)?;
        let cone = patch.fit(start, Cone::distances_and_derivatives, Cone::moved);
        let residual = patch.points.iter().map(|point| cone.distance(point).abs()).fold(0.0, f64::max);
        let sensible = MIN_ANGLE..=std::f64::consts::FRAC_PI_2 - MIN_ANGLE;
        if !residual.is_finite() || !sensible.contains(&cone.half_angle) {
            return Err(ConeError::NoApex { what: "the fit did not converge" });
        }
        Ok(Self { cone, residual, is_determined: false })
    }
}

fn start_cone(patch: &SampledPatch) -> Result<Cone, ConeError> {
    let count = patch.normals.len() as f64;
    let mean = patch.normals.iter().sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> = patch
        .normals
        .iter()
        .map(|normal| (normal - mean) * (normal - mean).transpose())
        .sum::<Matrix3<f64>>()
        / count;
    let (axis, [thin, middle, wide]) = principal_directions(&spread);
    if wide < MIN_TURN {
        return Err(ConeError::NoApex { what: "it is flat" });
    }
    // A short arc of the circle is nearly straight, so its plane is determined by its bend: compare thin with middle.
    if thin > middle / ONE_WAY {
        return Err(ConeError::NoApex { what: "it is curved in both directions" });
    }
    let planes = patch.points.iter().copied().zip(patch.normals.iter().copied());
    Cone::from_tangent_planes(axis, &mean, planes, &patch.center())
        .ok_or(ConeError::NoApex { what: "its tangent planes do not meet in a point" })
}

/// The exact map from the drawing to the view by unrolling a cone about the anchor: the generators become rays from the
/// apex, and an angle θ about the axis becomes θ·sin α (do Carmo, Differential Geometry of Curves and Surfaces, section
/// 4-2, example 3).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConeMap {
    /// The cone.
    pub cone: Cone,
    anchor: FlatPoint,
    /// Distance of the anchor from the apex along its generator, mm.
    start: f64,
    /// Unit vector from the axis to the anchor.
    radial: Vector3<f64>,
    /// Unit vector from the apex to the anchor.
    generator: Vector3<f64>,
    /// Images of the drawing's s and t directions at the anchor: unit vectors on the surface.
    right: Vector3<f64>,
    up: Vector3<f64>,
    /// Whether the laser sees the concave side.
    hollow: bool,
}

impl ConeMap {
    /// The map that keeps `anchor` at its place in the view and keeps the drawing's x direction there. `height` is the
    /// height of the part at the anchor, mm; the drawing extends `reach` mm from the anchor.
    ///
    /// # Errors
    /// When the anchor is outside the cone, or the drawing would reach the apex.
    pub fn new(cone: Cone, anchor: FlatPoint, height: f64, reach: f64) -> Result<Self, ConeError> {
        let at = ViewPoint::from(anchor.coords());
        let point = cone.on_sight(at, height).ok_or(ConeError::AnchorBeside { at })?;
        let (_, from_axis) = cone.split(&point);
        let radial = from_axis.normalize();
        let from_apex = point - cone.apex;
        let distance = from_apex.norm();
        if reach >= distance {
            return Err(ConeError::ApexInDrawing { distance, reach });
        }
        let normal = radial * cone.half_angle.cos() - *cone.axis * cone.half_angle.sin();
        if normal.z.abs() < 1e-6 {
            return Err(ConeError::AnchorBeside { at });
        }
        let gradient = -normal.xy() / normal.z;
        let frame = tangent_frame(&gradient);
        let lift = |column: usize| {
            let flat = frame.column(column);
            Vector3::new(flat[0], flat[1], gradient.dot(&flat))
        };
        let generator = from_apex / distance;
        let hollow = normal.z < 0.0;
        Ok(Self { cone, anchor, start: distance, radial, generator, right: lift(0), up: lift(1), hollow })
    }

    /// The point of the drawing that keeps its place, mm.
    pub fn anchor(&self) -> FlatPoint {
        self.anchor
    }

    /// The apex in the plane of the drawing, mm.
    pub fn flat_apex(&self) -> FlatPoint {
        self.anchor
            + Vector2::new(self.generator.dot(&self.right), self.generator.dot(&self.up)) * -self.start
    }

    /// Whether the laser sees the concave side.
    pub fn is_hollow(&self) -> bool {
        self.hollow
    }

    /// The angle from the drawing's x to the direction round the axis, at the anchor, rad.
    pub fn round_angle(&self) -> f64 {
        let round = self.cone.axis.cross(&self.radial);
        round.dot(&self.up).atan2(round.dot(&self.right))
    }

    /// Distance from the apex, mm, and angle about the axis from the anchor, rad.
    fn unrolled(&self, at: FlatPoint) -> (f64, f64) {
        let from_anchor = at - self.anchor;
        let step = self.right * from_anchor.x + self.up * from_anchor.y;
        let sideways = self.cone.axis.cross(&self.radial);
        let (out, across) = (self.start + step.dot(&self.generator), step.dot(&sideways));
        (out.hypot(across), across.atan2(out) / self.cone.half_angle.sin())
    }

    fn radial_at(&self, angle: f64) -> Vector3<f64> {
        self.radial * angle.cos() + self.cone.axis.cross(&self.radial) * angle.sin()
    }

    /// The point of the cone onto which a point of the drawing is mapped, mm, in the frame of the view.
    pub fn point_on_part(&self, at: FlatPoint) -> Point3<f64> {
        let (out, angle) = self.unrolled(at);
        let (sin, cos) = self.cone.half_angle.sin_cos();
        self.cone.apex + (*self.cone.axis * cos + self.radial_at(angle) * sin) * out
    }

    /// The image of a point of the drawing in the view.
    pub fn point(&self, at: FlatPoint) -> ViewPoint {
        let point = self.point_on_part(at);
        ViewPoint::new(point.x, point.y)
    }

    /// Unit normal, on the marked side, of the part at the image of a point of the drawing; its z component is negative
    /// where the surface faces away from the laser.
    pub fn normal(&self, at: FlatPoint) -> Vector3<f64> {
        let (_, angle) = self.unrolled(at);
        let (sin, cos) = self.cone.half_angle.sin_cos();
        let normal = self.radial_at(angle) * cos - *self.cone.axis * sin;
        if self.hollow { -normal } else { normal }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::shapes;
    use crate::geometry::space::{Extents, View};
    use crate::geometry::surface::fit::{FitOptions, FittedSurface};
    use proptest::prelude::*;

    fn cone(azimuth: f64, tilt: f64, half_angle: f64) -> Cone {
        let axis = Vector3::new(azimuth.cos() * tilt.cos(), azimuth.sin() * tilt.cos(), tilt.sin());
        // The middle of the view is 60 mm from the apex along the axis and about 60·tan α above the axis.
        let apex = Point3::new(0.0, 0.0, -60.0 * half_angle.tan()) - axis * 60.0;
        Cone { apex, axis: nalgebra::Unit::new_normalize(axis), half_angle }
    }

    proptest! {
        #[test]
        fn the_map_is_isometric_and_keeps_the_anchor(
            azimuth in 0.0..6.3f64, tilt in -0.3..0.3f64, half_angle in 0.05..0.9f64,
            x in -8.0..8.0f64, y in -8.0..8.0f64, anchor_x in -3.0..3.0f64,
        ) {
            let cone = cone(azimuth, tilt, half_angle);
            let anchor = FlatPoint::new(anchor_x, -2.0);
            prop_assume!(cone.on_sight(ViewPoint::new(anchor_x, -2.0), 1e3).is_some());
            let map = ConeMap::new(cone, anchor, 1e3, 12.0);
            prop_assume!(map.is_ok());
            let map = map.unwrap();
            prop_assert!((map.point(anchor).coords() - anchor.coords()).norm() < 1e-9);
            let at = FlatPoint::new(x, y);
            prop_assert!(cone.distance(&map.point_on_part(at)).abs() < 1e-10);
            let h = 1e-5;
            let by = |step: Vector2<f64>| (map.point_on_part(at + step) - map.point_on_part(at + -step)) / (2.0 * h);
            let (by_s, by_t) = (by(Vector2::new(h, 0.0)), by(Vector2::new(0.0, h)));
            prop_assert!((by_s.norm() - 1.0).abs() < 1e-7 && (by_t.norm() - 1.0).abs() < 1e-7);
            prop_assert!(by_s.dot(&by_t).abs() < 1e-7);
        }
    }

    #[test]
    fn a_cone_is_found_with_any_direction_and_tilt() {
        for (azimuth, tilt, half_angle) in
            [(0.0, 0.0, 0.3), (1.0, 0.1, 0.15), (2.2, -0.2, 0.5), (4.0, 0.0, 0.12)]
        {
            let truth = cone(azimuth, tilt, half_angle);
            let height =
                |x: f64, y: f64| truth.on_sight(ViewPoint::new(x, y), 1e3).map_or(-50.0, |point| point.z);
            let part = FacingPart::new(&shapes::graph(6.5, 0.3, height), &View::top());
            let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
            let under = Extents { min: Vector2::new(-4.0, -4.0), max: Vector2::new(4.0, 4.0) };
            let patch = SampledPatch::under(&surface, &under).unwrap();
            let found = ConeFit::to(&patch).unwrap();
            assert!(found.residual < 2e-4, "{found:?}");
            assert!((found.cone.half_angle - half_angle).abs() < 2e-3, "{found:?} for {truth:?}");
            assert!((found.cone.apex - truth.apex).norm() < 1.0, "{found:?} for {truth:?}");
        }
    }

    #[test]
    fn planes_and_spheres_are_not_cones() {
        let under = Extents { min: Vector2::new(-9.0, -9.0), max: Vector2::new(9.0, 9.0) };
        let fit = |height: fn(f64, f64) -> f64| {
            let part = FacingPart::new(&shapes::graph(15.0, 0.75, height), &View::top());
            let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
            ConeFit::to(&SampledPatch::under(&surface, &under).unwrap())
        };
        assert!(matches!(fit(|x, _| 0.1 * x), Err(ConeError::NoApex { .. })));
        match fit(shapes::sphere) {
            Err(ConeError::NoApex { .. }) => {}
            other => assert!(other.unwrap().residual > 0.05, "a sphere is not a cone"),
        }
    }
}
