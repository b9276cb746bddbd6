//! From the drawing's plane onto the part.
//!
//! All lengths can be kept only where the Gaussian curvature is zero (Gauss, Disquisitiones generales circa superficies
//! curvas, 1827); elsewhere [`quality`] says how far lengths, areas and angles move.

mod tangent;
pub mod isometric;
pub mod patch;
pub mod cylinder;
pub mod cone;
pub mod mapping_domain;
pub mod floater;
pub mod quality;

use nalgebra::Vector3;

use self::cone::{ConeError, ConeFit, ConeMap};
use self::cylinder::{CylinderError, CylinderFit, CylinderMap};
use self::floater::{FloaterError, FloaterMap, FloaterWeights};
use self::isometric::{IsometricError, IsometricMap, IsometricOptions};
use self::mapping_domain::{MappingDomainError, MappingDomainMap, MappingDomainOptions};
use self::patch::{SampledPatch, TooFewPoints};
use super::ink::Ink;
use super::pattern::Pattern;
use super::primitive::{Form, Primitive};
use super::space::{Extents, FlatPoint, ViewPoint};
use super::surface::fit::FittedSurface;

/// How the map is found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// [`Method::Cylinder`] or [`Method::Cone`] where the part is one to within the tolerance, mm, otherwise
    /// [`Method::Isometric`].
    Auto {
        /// Largest distance of the part from a cylinder or cone, mm.
        exact_tolerance: f64,
        /// For everything else.
        otherwise: IsometricOptions,
    },
    /// The map of least strain; for any surface.
    Isometric(IsometricOptions),
    /// Exact unrolling of the cylinder that fits best.
    Cylinder,
    /// Exact unrolling of the cone that fits best.
    Cone,
    /// Exact unrolling of the primitive that the part is known to be.
    Given(Primitive),
    /// The thesis' own method, for comparison.
    MappingDomain(MappingDomainOptions),
    /// The thesis' state of the art, for comparison.
    Floater(FloaterWeights),
    /// Plain projection along the laser's axis: what comes out without a correction.
    Plain,
}

impl Method {
    /// [`Method::Auto`] takes a part for a cylinder or a cone when it is one to within this, mm. A length that goes
    /// round it by an angle is then off by at most this times the angle in rad.
    pub const EXACT_TOLERANCE: f64 = 0.005;
}

/// A map from the placed drawing to the view, chosen for one drawing on one surface.
#[derive(Debug, Clone, PartialEq)]
pub enum LengthTrueMap {
    /// Found by [`IsometricMap::solve`].
    Isometric(IsometricMap),
    /// Exact unrolling.
    Cylinder(CylinderMap, CylinderFit),
    /// Exact unrolling.
    Cone(ConeMap, ConeFit),
    /// Found by [`MappingDomainMap::find`].
    MappingDomain(MappingDomainMap),
    /// Found by [`FloaterMap::find`].
    Floater(FloaterMap),
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
    /// The part is no cone where the drawing lies.
    #[error(transparent)]
    Cone(#[from] ConeError),
    /// The drawing has no place in the thesis' mapping domain.
    #[error(transparent)]
    MappingDomain(#[from] MappingDomainError),
    /// The part could not be laid on a square.
    #[error(transparent)]
    Floater(#[from] FloaterError),
}

impl LengthTrueMap {
    /// The map for a placed drawing; the anchor keeps its place in the view, and the drawing's x direction there its
    /// direction (but for [`Method::MappingDomain`] and [`Method::Floater`], which have directions of their own).
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
            Method::Cylinder => Self::unroll_cylinder(surface, &coarse_ink(pattern, counts), anchor),
            Method::Cone => Self::unroll_cone(surface, &coarse_ink(pattern, counts), anchor),
            Method::Given(primitive) => {
                let ink = coarse_ink(pattern, counts);
                let height = primitive.height(anchor.coords().into()).unwrap_or(0.0);
                match primitive.form() {
                    Form::Cylinder(cylinder) => {
                        let map = CylinderMap::new(cylinder, anchor, height)?;
                        Ok(Self::Cylinder(map, CylinderFit { cylinder, residual: 0.0 }))
                    }
                    Form::Cone(cone) => {
                        let map = ConeMap::new(cone, anchor, height, reach(&ink, anchor))?;
                        Ok(Self::Cone(map, ConeFit { cone, residual: 0.0 }))
                    }
                }
            }
            Method::MappingDomain(options) => {
                let ink = coarse_ink(pattern, counts);
                Ok(Self::MappingDomain(MappingDomainMap::find(surface, &ink, anchor, options)?))
            }
            Method::Floater(weights) => {
                Ok(Self::Floater(FloaterMap::find(surface, &coarse_ink(pattern, counts), anchor, *weights)?))
            }
            Method::Isometric(options) => {
                let map = IsometricMap::solve(&surface.nurbs, &coarse_ink(pattern, counts), anchor, options)?;
                Ok(Self::Isometric(map))
            }
            Method::Auto { exact_tolerance, otherwise } => {
                let ink = coarse_ink(pattern, counts);
                // The cylinder first: every cylinder is nearly a cone with a far apex.
                for exact in [Self::unroll_cylinder, Self::unroll_cone] {
                    if let Ok(map) = exact(surface, &ink, anchor)
                        && map.fit_residual().is_some_and(|residual| residual <= *exact_tolerance)
                    {
                        return Ok(map);
                    }
                }
                Ok(Self::Isometric(IsometricMap::solve(&surface.nurbs, &ink, anchor, otherwise)?))
            }
        }
    }

    fn unroll_cylinder(surface: &FittedSurface, ink: &Ink, anchor: FlatPoint) -> Result<Self, MapError> {
        let height = surface.nurbs.height(anchor.coords().into());
        unroll(surface, ink, |patch| {
            let fit = CylinderFit::to(&patch.map_err(CylinderError::from)?)?;
            Ok(Self::Cylinder(CylinderMap::new(fit.cylinder, anchor, height)?, fit))
        })
    }

    fn unroll_cone(surface: &FittedSurface, ink: &Ink, anchor: FlatPoint) -> Result<Self, MapError> {
        let height = surface.nurbs.height(anchor.coords().into());
        let reach = reach(ink, anchor);
        unroll(surface, ink, |patch| {
            let fit = ConeFit::to(&patch.map_err(ConeError::from)?)?;
            Ok(Self::Cone(ConeMap::new(fit.cone, anchor, height, reach)?, fit))
        })
    }

    /// Largest distance of the part from the primitive that is unrolled, mm; `None` for maps that unroll none.
    pub fn fit_residual(&self) -> Option<f64> {
        match self {
            Self::Cylinder(_, fit) => Some(fit.residual),
            Self::Cone(_, fit) => Some(fit.residual),
            Self::Isometric(_) | Self::MappingDomain(_) | Self::Floater(_) | Self::Plain => None,
        }
    }

    /// Whether the map is there to be compared with, and not made to keep lengths as well as can be.
    pub fn is_for_comparison(&self) -> bool {
        matches!(self, Self::MappingDomain(_) | Self::Floater(_) | Self::Plain)
    }

    /// The image of a point of the drawing in the view.
    pub fn point(&self, at: FlatPoint) -> ViewPoint {
        match self {
            Self::Isometric(map) => map.point(at),
            Self::Cylinder(map, _) => map.point(at),
            Self::Cone(map, _) => map.point(at),
            Self::MappingDomain(map) => map.point(at),
            Self::Floater(map) => map.point(at),
            Self::Plain => at.coords().into(),
        }
    }

    /// Unit normal of the part at the image of a point of the drawing, in the frame of the view. On a cylinder or cone its z
    /// component is negative where the surface turns away from the laser; elsewhere what lies behind the horizon is not
    /// known.
    pub fn normal(&self, surface: &FittedSurface, at: FlatPoint) -> Vector3<f64> {
        match self {
            Self::Cylinder(map, _) => map.normal(at),
            Self::Cone(map, _) => map.normal(at),
            Self::Isometric(_) | Self::MappingDomain(_) | Self::Floater(_) | Self::Plain => {
                let gradient = surface.jet(self.point(at)).gradient;
                Vector3::new(-gradient.x, -gradient.y, 1.0).normalize()
            }
        }
    }
}

/// Unrolls twice: what is found under the middle of the drawing tells where the drawing really comes to lie, which is
/// less far out than it was drawn, and there the primitive is fitted and judged.
fn unroll(
    surface: &FittedSurface,
    ink: &Ink,
    find: impl Fn(Result<SampledPatch, TooFewPoints>) -> Result<LengthTrueMap, MapError>,
) -> Result<LengthTrueMap, MapError> {
    let rough = find(SampledPatch::under(surface, &ink.extents.scaled(0.5)))?;
    let ends = ink.pieces.iter().flat_map(|piece| [piece.from, piece.to]).chain(ink.dots.iter().copied());
    let reached = Extents::of(ends.map(|end| rough.point(end).coords()));
    find(SampledPatch::under(surface, &reached))
}

/// Distance from the anchor to the farthest corner of the drawing, mm.
fn reach(ink: &Ink, anchor: FlatPoint) -> f64 {
    let farthest = (ink.extents.max - anchor.coords()).sup(&(anchor.coords() - ink.extents.min));
    farthest.norm()
}

/// Samples for the solver: half as dense as those of the quality figures along each direction, which is enough for the
/// reference cases to reach their figures.
fn coarse_ink(pattern: &Pattern, counts: impl Fn(&str) -> bool) -> Ink {
    Ink::sample(pattern, counts, 2.0 * quality::PIECE, 2.0 * quality::SQUARE)
}
