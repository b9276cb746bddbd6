//! From the drawing's plane onto the part.
//!
//! All lengths can be kept only where the Gaussian curvature is zero (Gauss, Disquisitiones generales circa superficies
//! curvas, 1827); elsewhere [`quality`] says how far lengths, areas and angles move.

pub mod isometric;
pub mod cylinder;
pub mod quality;

use nalgebra::Vector3;

use self::cylinder::{CylinderError, CylinderFit, CylinderMap};
use self::isometric::{IsometricError, IsometricMap, IsometricOptions};
use super::ink::Ink;
use super::pattern::Pattern;
use super::space::{FlatPoint, ViewPoint};
use super::surface::fit::FittedSurface;

/// How the map is found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// [`Method::Cylinder`] where the part is one to within the tolerance, mm, otherwise [`Method::Isometric`].
    Auto {
        /// Largest distance of the part from a cylinder, mm.
        cylinder_tolerance: f64,
        /// For everything that is no cylinder.
        otherwise: IsometricOptions,
    },
    /// The map of least strain; for any surface.
    Isometric(IsometricOptions),
    /// Exact unrolling of the cylinder that fits best.
    Cylinder,
    /// Plain projection along the laser's axis: what comes out without a correction.
    Plain,
}

impl Method {
    /// [`Method::Auto`] takes a part for a cylinder when it is one to within this, mm. A crown of that height over a
    /// 40 mm drawing changes its lengths by less than 0.001 mm.
    pub const CYLINDER_TOLERANCE: f64 = 0.02;
}

/// A map from the placed drawing to the view, chosen for one drawing on one surface.
#[derive(Debug, Clone, PartialEq)]
pub enum LengthTrueMap {
    /// Found by [`IsometricMap::solve`].
    Isometric(IsometricMap),
    /// Exact unrolling.
    Cylinder(CylinderMap, CylinderFit),
    /// No correction.
    Plain,
}

/// Why there is no map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MapError {
    /// The free-form map could not be found.
    #[error(transparent)]
    Isometric(#[from] IsometricError),
    /// The part is no cylinder where the drawing lies.
    #[error(transparent)]
    Cylinder(#[from] CylinderError),
}

impl LengthTrueMap {
    /// The map for a placed drawing; the anchor keeps its place in the view, and the drawing's x direction there its
    /// direction.
    ///
    /// # Errors
    /// See [`MapError`]. [`Method::Auto`] never fails for want of a cylinder.
    pub fn find(
        surface: &FittedSurface,
        pattern: &Pattern,
        counts: impl Fn(&str) -> bool,
        anchor: FlatPoint,
        method: &Method,
    ) -> Result<Self, MapError> {
        match method {
            Method::Plain => Ok(Self::Plain),
            Method::Cylinder => Self::unroll(surface, &coarse_ink(pattern, counts), anchor),
            Method::Isometric(options) => {
                let map = IsometricMap::solve(&surface.nurbs, &coarse_ink(pattern, counts), anchor, options)?;
                Ok(Self::Isometric(map))
            }
            Method::Auto { cylinder_tolerance, otherwise } => {
                let ink = coarse_ink(pattern, counts);
                match Self::unroll(surface, &ink, anchor) {
                    Ok(Self::Cylinder(map, fit)) if fit.residual <= *cylinder_tolerance => {
                        Ok(Self::Cylinder(map, fit))
                    }
                    _ => Ok(Self::Isometric(IsometricMap::solve(&surface.nurbs, &ink, anchor, otherwise)?)),
                }
            }
        }
    }

    fn unroll(surface: &FittedSurface, ink: &Ink, anchor: FlatPoint) -> Result<Self, MapError> {
        let fit = CylinderFit::under(surface, &ink.extents)?;
        let height = surface.nurbs.height(anchor.coords().into());
        Ok(Self::Cylinder(CylinderMap::new(fit.cylinder, anchor, height)?, fit))
    }

    /// The image of a point of the drawing in the view.
    pub fn point(&self, at: FlatPoint) -> ViewPoint {
        match self {
            Self::Isometric(map) => map.point(at),
            Self::Cylinder(map, _) => map.point(at),
            Self::Plain => at.coords().into(),
        }
    }

    /// Unit normal of the part at the image of a point of the drawing, in the frame of the view. On a cylinder its z
    /// component is negative where the surface turns away from the laser; elsewhere what lies behind the horizon is not
    /// known.
    pub fn normal(&self, surface: &FittedSurface, at: FlatPoint) -> Vector3<f64> {
        match self {
            Self::Cylinder(map, _) => map.normal(at),
            Self::Isometric(_) | Self::Plain => {
                let gradient = surface.jet(self.point(at)).gradient;
                Vector3::new(-gradient.x, -gradient.y, 1.0).normalize()
            }
        }
    }
}

/// Samples for the solver: half as dense as those of the quality figures along each direction; denser ones move the
/// solution by less than 1 % of what remains.
fn coarse_ink(pattern: &Pattern, counts: impl Fn(&str) -> bool) -> Ink {
    Ink::sample(pattern, counts, 2.0 * quality::PIECE, 2.0 * quality::SQUARE)
}
