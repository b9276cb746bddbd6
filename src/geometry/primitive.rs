//! A part without a mesh: a cylinder or cone given by its sizes, as the laser sees it.

use nalgebra::{Point3, Unit, Vector2, Vector3};

use crate::geometry::height_field::{HeightField, Node, STEEPEST_SURFACE};
use crate::geometry::mapping::cone::Cone;
use crate::geometry::mapping::cylinder::Cylinder;
use crate::geometry::space::ViewPoint;
use crate::geometry::surface::fit::{FitError, FittedSurface};

/// A round bar, straight or tapered, under the laser. The origin of the view is the middle of its crest, the line
/// that is nearest to the laser.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Primitive {
    start_diameter: f64,
    end_diameter: f64,
    length: f64,
    axis: Unit<Vector3<f64>>,
    /// Where the axis is at half the length, mm.
    middle: Point3<f64>,
}

/// The surface that a [`Primitive`] is unrolled as.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Form {
    /// Both ends have the same diameter.
    Cylinder(Cylinder),
    /// The bar is tapered.
    Cone(Cone),
}

/// With a taper below this, rad, the primitive is treated as a cylinder: lines move by less than a
/// micrometre.
const MIN_TAPER: f64 = 1e-6;
/// Sampling steps along the longer side: as fine as the finest fit of a mesh.
const STEPS: f64 = 256.0;

impl Primitive {
    /// The primitive with these diameters at its two ends (mm, positive) and this length along its axis (mm, positive);
    /// `axis` points from the first end to the other, in the frame of the view. `None` for invalid sizes, including a
    /// cone that ends in its apex, and for an axis that points at the laser.
    pub fn new(start_diameter: f64, end_diameter: f64, length: f64, axis: Vector3<f64>) -> Option<Self> {
        let sizes = [start_diameter, end_diameter, length];
        let axis = Unit::try_new(axis, 1e-9).filter(|axis| axis.iter().all(|part| part.is_finite()))?;
        let crest = Vector3::z() - *axis * axis.z;
        if !sizes.iter().all(|size| *size > 0.0 && size.is_finite()) || crest.norm() < 1e-3 {
            return None;
        }
        let middle = Point3::from(-crest.normalize() * (start_diameter + end_diameter) / 4.0);
        Some(Self { start_diameter, end_diameter, length, axis, middle })
    }

    /// Diameters at both ends and length, mm.
    pub fn sizes(&self) -> [f64; 3] {
        [self.start_diameter, self.end_diameter, self.length]
    }

    /// Direction of the axis in the view, from the first end to the other.
    pub fn axis(&self) -> Unit<Vector3<f64>> {
        self.axis
    }

    /// The middle of the axis, mm, in the view.
    pub fn middle(&self) -> Point3<f64> {
        self.middle
    }

    /// Change of the radius per length along the axis.
    fn taper(&self) -> f64 {
        (self.end_diameter - self.start_diameter) / (2.0 * self.length)
    }

    fn middle_radius(&self) -> f64 {
        (self.start_diameter + self.end_diameter) / 4.0
    }

    /// The cylinder or cone itself.
    pub fn form(&self) -> Form {
        let (taper, radius) = (self.taper(), self.middle_radius());
        if taper.abs() < MIN_TAPER {
            return Form::Cylinder(Cylinder { center: self.middle, axis: self.axis, radius });
        }
        let axis = if taper > 0.0 { self.axis } else { -self.axis };
        Form::Cone(Cone {
            apex: self.middle - *self.axis * (radius / taper),
            axis,
            half_angle: taper.abs().atan(),
        })
    }

    /// Height at a point of the view, mm; `None` outside the round side of the primitive.
    pub fn height(&self, at: ViewPoint) -> Option<f64> {
        self.hit(at).map(|(height, _)| height)
    }

    /// Height and unit normal where the line of sight first meets the round side.
    fn hit(&self, at: ViewPoint) -> Option<(f64, Vector3<f64>)> {
        // |q|² − (q·a)² = (r + k·(q·a))² for q = from + z·ẑ, measured from the middle.
        let (taper, radius) = (self.taper(), self.middle_radius());
        let from = Point3::new(at.x, at.y, 0.0) - self.middle;
        let (along, rise) = (from.dot(&self.axis), self.axis.z);
        let a = 1.0 - rise * rise * (1.0 + taper * taper);
        let b = from.z - rise * along - taper * rise * (radius + taper * along);
        let c = from.norm_squared() - along * along - (radius + taper * along).powi(2);
        let height = (-b + (b * b - a * c).sqrt()) / a;
        let reached = along + rise * height;
        if !(a > 0.0 && height.is_finite() && reached.abs() <= self.length / 2.0) {
            return None;
        }
        let outward = from + Vector3::z() * height - *self.axis * reached;
        Some((height, (outward.normalize() - *self.axis * taper).normalize()))
    }

    /// The axis-parallel bounding box of the primitive: its lowest and highest corner, mm, in the frame of the view.
    pub fn bounds(&self) -> [Vector3<f64>; 2] {
        // An end is a circle; it extends along each coordinate axis by its radius times the sine of the angle to that
        // axis.
        let reach = self.axis.map(|part| (1.0 - part * part).max(0.0).sqrt());
        let end = |share: f64, diameter: f64, side: f64| {
            self.middle.coords + *self.axis * (share * self.length) + reach * (side * diameter / 2.0)
        };
        let (start, far) = (self.start_diameter, self.end_diameter);
        [end(-0.5, start, -1.0).inf(&end(0.5, far, -1.0)), end(-0.5, start, 1.0).sup(&end(0.5, far, 1.0))]
    }

    /// The primitive as a fitted surface with exact samples, for checks, previews and all general methods.
    ///
    /// # Errors
    /// When too little of it faces the laser, or its length is more than a thousand times its thickness.
    pub fn surface(&self) -> Result<FittedSurface, FitError> {
        let [min, max] = self.bounds().map(|corner| corner.xy());
        let size = max - min;
        let too_small = FitError::TooSmall { width: size.x, height: size.y };
        if size.min() < size.max() * 1e-3 {
            return Err(too_small);
        }
        let step = size.max() / STEPS;
        let count = size.map(|side| (side / step).ceil() as usize + 1);
        let node = |index: usize| {
            let place = Vector2::new((index % count.x) as f64, (index / count.x) as f64);
            match self.hit((min + place * step).into()) {
                None => Node::Empty,
                Some((height, normal)) if normal.z >= STEEPEST_SURFACE.cos() => Node::Surface(height),
                Some((height, _)) => Node::Wall(height),
            }
        };
        let nodes = (0..count.x * count.y).map(node).collect();
        let field = HeightField::new(min, step, count.x, count.y, nodes).ok_or(too_small)?;
        FittedSurface::of_field(field)
    }
}

impl std::fmt::Display for Primitive {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { start_diameter, end_diameter, length, .. } = self;
        match self.form() {
            Form::Cylinder(_) => write!(out, "cylinder {start_diameter} x {length} mm"),
            Form::Cone(_) => write!(out, "cone {start_diameter} to {end_diameter} x {length} mm"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_lie_on_the_cylinder_or_cone_and_the_crest_is_at_zero() {
        for (sizes, axis) in [
            ([73.0, 73.0, 180.0], Vector3::x()),
            ([73.0, 73.0, 180.0], Vector3::new(0.3, -1.0, 0.2)),
            ([60.0, 85.0, 120.0], Vector3::y()),
            ([85.0, 60.0, 120.0], Vector3::new(1.0, 0.4, -0.1)),
        ] {
            let primitive = Primitive::new(sizes[0], sizes[1], sizes[2], axis).unwrap();
            assert!(primitive.height(ViewPoint::new(0.0, 0.0)).unwrap().abs() < 1e-9);
            let surface = primitive.surface().unwrap();
            let mut nodes = 0;
            for (column, row, height) in surface.field.surface_nodes() {
                let at = surface.field.position(column, row);
                let point = Point3::new(at.x, at.y, height);
                let distance = match primitive.form() {
                    Form::Cylinder(cylinder) => cylinder.distance(&point),
                    Form::Cone(cone) => cone.distance(&point),
                };
                assert!(distance.abs() < 1e-9, "{distance} mm at {at:?}");
                assert!(height <= 1e-9 + 0.3 * at.coords().norm());
                nodes += 1;
            }
            assert!(nodes > 10_000);
            // Between the nodes, the fit and the interpolated residual represent the primitive.
            let worst = (0..500).map(|step| {
                let at = ViewPoint::new(0.06 * f64::from(step) - 15.0, 0.031 * f64::from(step) - 7.0);
                (surface.sampled_height(at).unwrap() - primitive.height(at).unwrap()).abs()
            });
            assert!(worst.fold(0.0, f64::max) < 1e-6);
        }
    }

    #[test]
    fn invalid_sizes_and_axes_give_none() {
        for (sizes, axis) in [
            ([0.0, 73.0, 180.0], Vector3::x()),
            ([73.0, f64::NAN, 180.0], Vector3::x()),
            ([73.0, 73.0, -1.0], Vector3::x()),
            ([73.0, 73.0, 180.0], Vector3::zeros()),
            ([73.0, 73.0, 180.0], Vector3::z()),
        ] {
            assert_eq!(Primitive::new(sizes[0], sizes[1], sizes[2], axis), None);
        }
    }

    #[test]
    fn there_is_no_surface_beyond_the_ends() {
        let primitive = Primitive::new(40.0, 40.0, 100.0, Vector3::x()).unwrap();
        assert!(primitive.height(ViewPoint::new(49.9, 0.0)).is_some());
        assert!(primitive.height(ViewPoint::new(50.1, 0.0)).is_none());
        assert!(primitive.height(ViewPoint::new(0.0, 20.1)).is_none());
        let [min, max] = primitive.bounds();
        assert!((min + Vector3::new(50.0, 20.0, 40.0)).norm() < 1e-12);
        assert!((max - Vector3::new(50.0, 20.0, 0.0)).norm() < 1e-12);
    }
}
