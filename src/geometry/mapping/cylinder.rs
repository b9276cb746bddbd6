//! The exact map onto a cylinder with any direction, tilt and offset.

use nalgebra::{Matrix3, Point3, Vector3};

use super::patch::{SampledPatch, TooFewPoints};
use super::tangent::tangent_frame;
pub use crate::geometry::cylinder::Cylinder;
use crate::geometry::shape_fit::{ONE_WAY, principal_directions};
use crate::geometry::solid::round::RoundForm;
use crate::geometry::space::{FlatPoint, ViewPoint};

/// A cylinder that was fitted to a part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CylinderFit {
    /// The cylinder.
    pub cylinder: Cylinder,
    /// Largest distance of a sampled point from it, mm.
    pub residual: f64,
    /// Whether its radius is known well: from the part's file, or because the surface beside the drawing is on it, too.
    pub is_determined: bool,
}

/// Why no cylinder was found under the drawing.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CylinderError {
    /// There are too few points of the part under the drawing.
    #[error(transparent)]
    TooFewPoints(#[from] TooFewPoints),
    /// The normals do not turn about one axis: the surface is flat or not a cylinder.
    #[error("the surface under the drawing is not a cylinder: {what}")]
    NoAxis {
        /// What was found instead.
        what: &'static str,
    },
    /// The anchor's line of sight misses the cylinder.
    #[error("the anchor at ({:.3}, {:.3}) mm is outside the cylinder of radius {radius:.3} mm", at.x, at.y)]
    AnchorBeside {
        /// Position of the anchor.
        at: ViewPoint,
        /// The cylinder's radius, mm.
        radius: f64,
    },
}

/// Surfaces whose normals turn by less than this under the drawing, rad, are treated as flat: the radius is
/// undetermined.
const MIN_TURN: f64 = 0.01;

/// Points of the part that are this close to a cylinder or cone of its file, mm, are on it.
pub(super) const ON_FACE: f64 = 1e-6;

impl CylinderFit {
    /// The cylinder of the part's file on which all points of the patch are; `None` if there is none.
    pub(super) fn known(known: &[RoundForm], patch: &SampledPatch) -> Option<Self> {
        let middle = patch.center();
        known.iter().find_map(|form| {
            let RoundForm::Cylinder { center, axis, radius } = *form else { return None };
            let center = center + *axis * (middle - center).dot(&axis);
            let cylinder = Cylinder { center, axis, radius };
            let residual = patch.largest_distance(|point| cylinder.distance(point));
            (residual <= ON_FACE).then_some(Self { cylinder, residual, is_determined: true })
        })
    }

    /// The cylinder that best fits the part under the drawing.
    ///
    /// At the start, the axis is perpendicular to all normals; then the squared distances of the sampled points are
    /// minimised over axis and radius (Lukács, Martin & Marshall, Faithful least-squares fitting of spheres, cylinders,
    /// cones and tori, ECCV 1998).
    ///
    /// # Errors
    /// See [`CylinderError`].
    pub fn to(patch: &SampledPatch) -> Result<Self, CylinderError> {
        let start = start_cylinder(patch)?;
        let cylinder = patch.fit(start, Cylinder::distances_and_derivatives, Cylinder::moved);
        let residual = patch.points.iter().map(|point| cylinder.distance(point).abs()).fold(0.0, f64::max);
        if !residual.is_finite() {
            return Err(CylinderError::NoAxis { what: "the fit did not converge" });
        }
        Ok(Self { cylinder, residual, is_determined: false })
    }
}

fn start_cylinder(patch: &SampledPatch) -> Result<Cylinder, CylinderError> {
    let SampledPatch { points, normals } = patch;
    let spread: Matrix3<f64> =
        normals.iter().map(|normal| normal * normal.transpose()).sum::<Matrix3<f64>>() / normals.len() as f64;
    let (axis, [thin, turn, _]) = principal_directions(&spread);
    if turn < MIN_TURN {
        return Err(CylinderError::NoAxis { what: "it is flat" });
    }
    if thin > turn / ONE_WAY {
        return Err(CylinderError::NoAxis { what: "it is curved in both directions" });
    }
    Ok(Cylinder::from_normals(axis, points, normals))
}

/// The exact map from the drawing to the view by unrolling a cylinder about the anchor.
///
/// Chuang, Shape correction for laser marking, 2023, appendix E (x = R·sin(s/R)), for any direction, tilt and offset of
/// the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CylinderMap {
    /// The cylinder.
    pub cylinder: Cylinder,
    anchor: FlatPoint,
    /// The anchor on the cylinder, mm.
    start: Point3<f64>,
    /// Unit vector from the axis to the anchor.
    radial: Vector3<f64>,
    /// Images of the drawing's s and t directions at the anchor: unit vectors on the surface.
    right: Vector3<f64>,
    up: Vector3<f64>,
    /// Whether the laser sees the concave side.
    hollow: bool,
}

impl CylinderMap {
    /// The map that keeps `anchor` at its place in the view and keeps the drawing's x direction there. `height` is the
    /// height of the part at the anchor, mm; it selects the near or the far side of the cylinder.
    ///
    /// # Errors
    /// When the anchor is outside the cylinder.
    pub fn new(cylinder: Cylinder, anchor: FlatPoint, height: f64) -> Result<Self, CylinderError> {
        let at = ViewPoint::from(anchor.coords());
        let beside = CylinderError::AnchorBeside { at, radius: cylinder.radius };
        let [lower, upper] = cylinder.heights(at).ok_or(beside)?;
        let hollow = (lower - height).abs() < (upper - height).abs();
        let start = Point3::new(at.x, at.y, if hollow { lower } else { upper });
        let (_, from_axis) = cylinder.split(&start);
        let radial = from_axis.normalize();
        if radial.z.abs() < 1e-6 {
            return Err(beside);
        }
        let gradient = -radial.xy() / radial.z;
        let frame = tangent_frame(&gradient);
        let lift = |column: usize| {
            let flat = frame.column(column);
            Vector3::new(flat[0], flat[1], gradient.dot(&flat))
        };
        Ok(Self { cylinder, anchor, start, radial, right: lift(0), up: lift(1), hollow })
    }

    /// The point of the drawing that keeps its place, mm.
    pub fn anchor(&self) -> FlatPoint {
        self.anchor
    }

    /// Whether the laser sees the concave side.
    pub fn is_hollow(&self) -> bool {
        self.hollow
    }

    /// The point of the cylinder onto which a point of the drawing is mapped, mm, in the frame of the view.
    pub fn point_on_part(&self, at: FlatPoint) -> Point3<f64> {
        let (along, angle) = self.unrolled(at);
        let axis = *self.cylinder.axis;
        let sideways = axis.cross(&self.radial);
        let turned = self.radial * (angle.cos() - 1.0) + sideways * angle.sin();
        self.start + axis * along + turned * self.cylinder.radius
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
        let radial = self.radial * angle.cos() + self.cylinder.axis.cross(&self.radial) * angle.sin();
        if self.hollow { -radial } else { radial }
    }

    /// The angle from the drawing's x to the direction round the axis, at the anchor, rad.
    pub fn round_angle(&self) -> f64 {
        let round = self.cylinder.axis.cross(&self.radial);
        round.dot(&self.up).atan2(round.dot(&self.right))
    }

    /// Distance along the axis, mm, and angle about it, rad, from the anchor.
    fn unrolled(&self, at: FlatPoint) -> (f64, f64) {
        let from_anchor = at - self.anchor;
        let step = self.right * from_anchor.x + self.up * from_anchor.y;
        let sideways = self.cylinder.axis.cross(&self.radial);
        (step.dot(&self.cylinder.axis), step.dot(&sideways) / self.cylinder.radius)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::mapping::{LengthTrueMap, Method};
    use crate::geometry::mesh::TriMesh;
    use crate::geometry::shapes;
    use crate::geometry::space::{Extents, Facing, View};
    use crate::geometry::surface::fit::{FitOptions, FittedSurface};
    use nalgebra::Vector2;
    use proptest::prelude::*;

    fn cylinder(azimuth: f64, tilt: f64, radius: f64) -> Cylinder {
        let axis = Vector3::new(azimuth.cos() * tilt.cos(), azimuth.sin() * tilt.cos(), tilt.sin());
        Cylinder { center: Point3::new(1.0, -2.0, 3.0), axis: nalgebra::Unit::new_normalize(axis), radius }
    }

    #[test]
    fn from_the_crest_the_arc_length_becomes_a_sine() {
        let radius = 33.0;
        let upright = Cylinder { center: Point3::origin(), axis: Vector3::y_axis(), radius };
        let map = CylinderMap::new(upright, FlatPoint::new(0.0, 0.0), radius).unwrap();
        for s in [-20.0, -3.0, 0.0, 10.0, 30.0] {
            let image = map.point(FlatPoint::new(s, 7.0));
            assert!((image - ViewPoint::new(radius * (s / radius).sin(), 7.0)).norm() < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn the_map_is_isometric_and_keeps_the_anchor(
            azimuth in 0.0..6.3f64, tilt in -0.7..0.7f64, radius in 8.0..80.0f64,
            x in -6.0..6.0f64, y in -6.0..6.0f64, anchor_x in -3.0..3.0f64, hollow: bool,
        ) {
            let cylinder = cylinder(azimuth, tilt, radius);
            let anchor = FlatPoint::new(anchor_x, -2.0);
            let height = if hollow { -1e3 } else { 1e3 };
            let map = CylinderMap::new(cylinder, anchor, height).unwrap();
            prop_assert!((map.point(anchor).coords() - anchor.coords()).norm() < 1e-12);
            let right = map.point(anchor + Vector2::new(1e-6, 0.0)) - map.point(anchor).coords().into();
            prop_assert!(right.y.abs() < 1e-12 && right.x > 0.0);
            let at = FlatPoint::new(x, y);
            prop_assert!(cylinder.distance(&map.point_on_part(at)).abs() < 1e-11);
            let h = 1e-5;
            let by = |step: Vector2<f64>| (map.point_on_part(at + step) - map.point_on_part(at + -step)) / (2.0 * h);
            let (by_s, by_t) = (by(Vector2::new(h, 0.0)), by(Vector2::new(0.0, h)));
            prop_assert!((by_s.norm() - 1.0).abs() < 1e-8 && (by_t.norm() - 1.0).abs() < 1e-8);
            prop_assert!(by_s.dot(&by_t).abs() < 1e-8);
        }
    }

    #[test]
    fn a_cylinder_is_found_with_any_direction_and_tilt() {
        for (azimuth, tilt) in [(0.0, 0.0), (1.0, 0.0), (2.2, 0.3), (4.0, -0.4)] {
            let truth = cylinder(azimuth, tilt, 30.0);
            let height = |x: f64, y: f64| truth.heights(ViewPoint::new(x, y)).map_or(0.0, |[_, upper]| upper);
            let mesh = shapes::graph(20.0, 0.75, height);
            let part = FacingPart::new(&mesh, &View::new(Facing::TOP, 0.0));
            let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
            let under = Extents { min: Vector2::new(-12.0, -6.0), max: Vector2::new(12.0, 6.0) };
            let found = CylinderFit::to(&SampledPatch::under(&surface, &under).unwrap()).unwrap();
            assert!(found.residual < 2e-4, "{found:?}");
            assert!((found.cylinder.radius - 30.0).abs() < 2e-3, "{found:?}");
            assert!(found.cylinder.axis.dot(&truth.axis).abs() > 1.0 - 1e-8);
        }
    }

    /// The map found for a rectangle of ink 24 mm long and 8 mm wide on a strip along x with this section.
    fn found(height: impl Fn(f64) -> f64) -> LengthTrueMap {
        found_on(&shapes::graph(20.0, 0.5, |_, y| height(y)), [12.0, 4.0])
    }

    /// The map found for a rectangle of ink with these half sides, mm, about the origin.
    fn found_on(mesh: &TriMesh, [half_x, half_y]: [f64; 2]) -> LengthTrueMap {
        use crate::geometry::mapping::isometric::IsometricOptions;
        use crate::geometry::pattern::{Color, Layer, Path, Pattern, Segment, Shape, Source};
        let part = FacingPart::new(mesh, &View::top());
        let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
        let corners = [(-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y)];
        let sides = [0, 1, 2, 3].map(|side: usize| {
            let [from, to] = [corners[side], corners[(side + 1) % 4]].map(|(x, y)| FlatPoint::new(x, y));
            Segment::Line { from, to }
        });
        let shape = Shape::Closed(sides.to_vec());
        let path = Path { layer: 0, color: Color::ByLayer, shape, region: None, source: Source::default() };
        let layer = Layer { name: String::new(), color: Color::Aci(7) };
        let pattern = Pattern { layers: vec![layer], paths: vec![path] };
        let method =
            Method::Auto { exact_tolerance: Method::EXACT_TOLERANCE, otherwise: IsometricOptions::INK };
        LengthTrueMap::find(&surface, &pattern, |_| true, FlatPoint::new(0.0, 0.0), &method).unwrap()
    }

    #[test]
    fn the_surface_beside_narrow_ink_determines_the_radius() {
        let round = found(|y| (33.0f64 * 33.0 - y * y).sqrt());
        assert!(round.is_determined(), "{round:?}");
        // Beside the strip of ±4 mm, which a cylinder of another radius fits, it is straight, or bends more.
        let strip = |bend: f64| {
            move |y: f64| {
                let beyond = (y.abs() - 4.0).max(0.0);
                (33.0f64 * 33.0 - y * y).sqrt() - bend * beyond * beyond
            }
        };
        for bend in [-0.015, 0.01] {
            let map = found(strip(bend));
            assert!(map.fit_residual().is_some_and(|residual| residual < 5e-3), "{map:?}");
            assert!(!map.is_determined(), "{map:?}");
        }
    }

    /// Each is within 0.005 mm of a cylinder under ink of 2 mm.
    #[test]
    fn small_ink_on_a_cone_or_a_dome_is_not_on_a_cylinder() {
        let cone = |x: f64, y: f64| -0.8 * ((x + 6.0).hypot(y) - 6.0);
        let map = found_on(&shapes::graph(3.0, 0.1, cone), [1.0, 1.0]);
        assert!(matches!(map, LengthTrueMap::Cone(_, fit) if fit.residual < 2e-4), "{map:?}");
        let dome = |x: f64, y: f64| -0.8 * x - 0.06 * x * x - 0.008 * y * y;
        let map = found_on(&shapes::graph(3.0, 0.1, dome), [1.0, 1.0]);
        assert!(matches!(map, LengthTrueMap::Isometric(_)), "{map:?}");
    }

    #[test]
    fn planes_and_spheres_are_not_cylinders() {
        let under = Extents { min: Vector2::new(-9.0, -9.0), max: Vector2::new(9.0, 9.0) };
        let fit = |height: fn(f64, f64) -> f64| {
            let part = FacingPart::new(&shapes::graph(15.0, 0.75, height), &View::top());
            let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
            CylinderFit::to(&SampledPatch::under(&surface, &under).unwrap())
        };
        assert!(matches!(fit(|x, _| 0.1 * x), Err(CylinderError::NoAxis { .. })));
        assert!(matches!(fit(shapes::sphere), Err(CylinderError::NoAxis { .. })));
    }
}
