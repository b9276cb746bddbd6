//! Why a surface is not met, or a stretch remains, at a place: what an operator reads, and what helps.

use super::CachedSurface;
use crate::formats::mesh::{NormalsUsed, PartFacts};
use crate::geometry::space::ViewPoint;
use crate::geometry::surface::fit::FittedSurface;

/// A doubt of the normals above this, mm, is a cause.
const NOTABLE_DOUBT: f64 = 0.005;
/// Kinks of facets turn by less than this, rad; the angle of an edge is larger.
const OF_FACETS: f64 = 12.0 * std::f64::consts::PI / 180.0;
/// Facets so many times as long as the distance between samples are coarse.
const COARSE: f64 = 4.0;
/// A surface whose Gauss curvature stretches a drawing of this size by at least this share of what remains is the cause.
const EXPLAINED: f64 = 0.5;
/// The stretch that is left on a part of Gauss curvature K under ink 2·b long is about this times K·b².
const STRETCH_OF_CURVATURE: f64 = 0.3;

/// Why the surface is uncertain, or lengths change, at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cause {
    /// The vertices of the mesh scatter by so much, mm.
    Noise(f64),
    /// The surface ends beside it.
    Hole,
    /// An edge or a ridge that turns by so much, rad.
    Crease(f64),
    /// The facets are so long, mm, and nothing tells how the part bends between their corners.
    Facets(f64),
    /// The part is curved both ways.
    Curvature,
    /// The part bends within a few samples, that are so far apart, mm.
    Detail(f64),
}

impl Cause {
    /// Why the fitted surface leaves the part at a place of the view.
    pub(super) fn of_misfit(part: &CachedSurface, at: ViewPoint) -> Self {
        let step = part.surface.field.step();
        Self::of_the_part(part, at).unwrap_or(Self::Detail(step))
    }

    /// Why a line changes its length by a share, at a place of the view, in a drawing so many mm long.
    pub(super) fn of_stretch(part: &CachedSurface, at: ViewPoint, stretch: f64, length: f64) -> Self {
        let explained =
            STRETCH_OF_CURVATURE * gauss_curvature(&part.surface, at).abs() * (length / 2.0).powi(2);
        match Self::of_the_part(part, at) {
            Some(cause) => cause,
            None if explained >= EXPLAINED * stretch => Self::Curvature,
            None => Self::Detail(part.surface.field.step()),
        }
    }

    /// What is wrong with the part itself.
    fn of_the_part(part: &CachedSurface, at: ViewPoint) -> Option<Self> {
        let (facts, surface) = (&part.facts, &part.surface);
        if let Some(noise) = facts.noise.filter(|_| facts.normals_used != Some(NormalsUsed::Smoothed)) {
            return Some(Self::Noise(noise.noise_mm));
        }
        let facet = facet_length(facts).filter(|length| *length > COARSE * surface.field.step());
        let facet = facet.filter(|_| facts.normals_used != Some(NormalsUsed::File));
        match (surface.field.kink(at), facet) {
            (Some(kink), Some(length)) if kink < OF_FACETS => Some(Self::Facets(length)),
            (Some(kink), _) => Some(Self::Crease(kink)),
            (None, Some(length)) if surface.doubt(at) > NOTABLE_DOUBT => Some(Self::Facets(length)),
            (None, _) => surface.field.ends_near(at).then_some(Self::Hole),
        }
    }

    /// What the cause is, as a clause.
    pub(super) fn clause(self) -> String {
        match self {
            Self::Noise(noise) => format!("the vertices of the mesh scatter by {noise:.4} mm"),
            Self::Hole => "the surface ends there, at a hole, a rim or a cliff".into(),
            Self::Crease(angle) => {
                format!(
                    "an edge or a ridge of the part runs there and turns it by {:.0} deg",
                    angle.to_degrees()
                )
            }
            Self::Facets(length) => {
                format!(
                    "the facets of the mesh, about {length:.1} mm long, are too coarse to show the surface between them"
                )
            }
            Self::Curvature => "the part is curved both ways there, and no map can keep all lengths".into(),
            Self::Detail(step) => {
                format!("the part bends there within a few samples, which are {step:.2} mm apart")
            }
        }
    }

    /// What helps, as a sentence.
    pub(super) fn remedy(self) -> &'static str {
        match self {
            Self::Noise(_) => {
                "Set `normals = \"auto\"`, which smooths the part as a scan, or smooth the mesh before it is exported."
            }
            Self::Hole => {
                "Move the drawing away from there, or close the hole (`bridge_mm` bridges small ones)."
            }
            Self::Crease(_) => "Place the drawing beside the edge.",
            Self::Facets(_) => {
                "Export the part with a deviation of 0.05 mm, as GLB from CAD, or apply the Subdivision modifier in Blender."
            }
            Self::Curvature => "Make the drawing smaller, or split it into parts that are placed one by one.",
            Self::Detail(_) => {
                "Place the drawing where the part is smoother, or mark only that side of it in a part file."
            }
        }
    }
}

/// About how long the sides of a mesh's triangles are: as if they covered the box round the part evenly, mm.
fn facet_length(facts: &PartFacts) -> Option<f64> {
    let [x, y, z] = facts.size;
    let area = 2.0 * (x * y + y * z + z * x);
    (facts.triangles > 0).then(|| (area / facts.triangles as f64 * 4.0 / 3f64.sqrt()).sqrt())
}

/// The Gauss curvature of the fit, 1/mm².
fn gauss_curvature(surface: &FittedSurface, at: ViewPoint) -> f64 {
    let jet = surface.jet(at);
    jet.hessian.determinant() / (1.0 + jet.gradient.norm_squared()).powi(2)
}
