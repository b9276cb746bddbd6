//! The causes of a misfit or of a remaining stretch at a place: what an operator reads, and what helps.

use super::CachedSurface;
use crate::formats::mesh::{MeshNoise, NormalsUsed, PartFacts};
use crate::geometry::space::ViewPoint;
use crate::geometry::surface::fit::FittedSurface;

/// Noise explains differences of at most this many standard deviations.
pub(super) const NOISE_REACH: f64 = 4.0;
/// Slope at which two facets of a square grid meet at their diagonal, on a plane whose vertices scatter by as much as a cell is
/// wide: one standard deviation.
pub(super) const KINK_OF_NOISE: f64 = 2.83;
/// Minimum doubt about the surface, mm, that is named as a cause.
const NOTABLE_DOUBT: f64 = 0.005;
/// Kinks between facets of a smooth surface have smaller angles than this, rad; those of an edge are larger.
const OF_FACETS: f64 = 12.0 * std::f64::consts::PI / 180.0;
/// Facets are coarse if they are at least this many times as long as the distance between samples.
const COARSE: f64 = 4.0;
/// The Gaussian curvature is the cause if it explains at least this share of the remaining stretch.
const EXPLAINED: f64 = 0.5;
/// The stretch that remains on a part of Gaussian curvature K, under ink of length 2·b, is about this times K·b².
const STRETCH_OF_CURVATURE: f64 = 0.3;

/// What helps where normals do not fit the vertices.
const TRUE_NORMALS: &str = "Recalculate the normals (in Blender: Mesh > Normals > Reset Vectors) and export the part again, \
                                       or set `normals = \"estimate\"` (`--normals estimate`), which takes them from the facets.";

/// Why the surface is uncertain, or lengths change, at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cause {
    /// The vertices of the mesh scatter by this standard deviation, mm.
    Noise(f64),
    /// The same, where it is too small to be smoothed.
    Scatter(f64),
    /// The file's normals lean by this angle, deg, from those of a smooth surface through the vertices.
    Normals(f64),
    /// The surface ends beside it.
    Hole,
    /// An edge or a ridge with this angle, rad.
    Crease(f64),
    /// The facets have this length, mm, and the shape between their vertices is not known.
    Facets(f64),
    /// The part is curved in both directions.
    Curvature,
    /// The part bends within a few samples, which are this far apart, mm.
    Detail(f64),
}

impl Cause {
    /// Why the fitted surface differs from the part at a place of the view.
    pub(super) fn of_misfit(part: &CachedSurface, at: ViewPoint) -> Self {
        let surface = &part.surface;
        let misfit =
            surface.sampled_height(at).map_or(0.0, |height| (height - surface.nurbs.height(at)).abs());
        let is_noise = |noise: &MeshNoise| misfit <= NOISE_REACH * noise.noise_mm;
        Self::of_the_part(part, at, is_noise).unwrap_or(Self::Detail(surface.field.step()))
    }

    /// Why a line changes its length by `stretch`, at a place of the view, in a drawing that is `length` mm long; `is_uncertain`
    /// if most of that follows from what is not known of the part.
    pub(super) fn of_stretch(
        part: &CachedSurface,
        at: ViewPoint,
        stretch: f64,
        is_uncertain: bool,
        length: f64,
    ) -> Self {
        let explained =
            STRETCH_OF_CURVATURE * gauss_curvature(&part.surface, at).abs() * (length / 2.0).powi(2);
        let is_noise = |noise: &MeshNoise| {
            let kinks = (NOISE_REACH * KINK_OF_NOISE * noise.noise_mm / noise.spacing_mm).atan();
            stretch.abs() <= 2.0 * noise.normals_off_deg.to_radians().tan()
                || is_uncertain && part.surface.field.kink(at).is_none_or(|kink| kink <= kinks)
        };
        let explains = |lean: &f64| is_uncertain && stretch.abs() <= 2.0 * lean.to_radians().tan();
        if let Some(lean) = part.facts.normals_lean_deg.filter(explains) {
            return Self::Normals(lean);
        }
        let facet = facet_length(&part.facts).filter(|_| is_uncertain);
        match (Self::of_the_part(part, at, is_noise), facet) {
            (Some(cause), _) => cause,
            (None, Some(length)) => Self::Facets(length),
            (None, None) if explained >= EXPLAINED * stretch => Self::Curvature,
            (None, None) => Self::Detail(part.surface.field.step()),
        }
    }

    /// What is wrong with the part itself; noise is named only if it is large enough.
    fn of_the_part(
        part: &CachedSurface,
        at: ViewPoint,
        is_noise: impl Fn(&MeshNoise) -> bool,
    ) -> Option<Self> {
        let (facts, surface) = (&part.facts, &part.surface);
        let noise = facts.noise.filter(|_| facts.normals_used != Some(NormalsUsed::Smoothed));
        if let Some(noise) = noise.filter(is_noise) {
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
            Self::Noise(noise) | Self::Scatter(noise) => {
                format!("the vertices of the mesh scatter by {noise:.4} mm")
            }
            Self::Normals(lean) => format!(
                "the normals in the file lean by {lean:.1} deg from those of a smooth surface through its vertices"
            ),
            Self::Hole => "the surface ends there, at a hole, a rim or a cliff".into(),
            Self::Crease(angle) => {
                format!("the part has an edge or a ridge of {:.0} deg there", angle.to_degrees())
            }
            Self::Facets(length) => {
                format!(
                    "the facets of the mesh, about {length:.1} mm long, are too coarse to determine the surface between them"
                )
            }
            Self::Curvature => {
                "the part is curved in both directions there, and no map can keep all lengths".into()
            }
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
            Self::Scatter(_) => {
                "Export the part from CAD, with more decimals, or smooth the mesh before it is exported."
            }
            Self::Normals(_) => TRUE_NORMALS,
            Self::Hole => {
                "Move the drawing away from there, or close the hole (`bridge_mm` bridges small ones)."
            }
            Self::Crease(_) => "Place the drawing away from the edge.",
            Self::Facets(_) => {
                "Export the part from CAD as STEP or GLB, or with finer facets, or apply the Subdivision modifier in Blender."
            }
            Self::Curvature => "Make the drawing smaller, or split it into parts that are placed one by one.",
            Self::Detail(_) => {
                "Place the drawing where the part is smoother, or export only the side that is marked."
            }
        }
    }
}

/// The approximate side length of the triangles, mm, as if they covered the part's box evenly.
fn facet_length(facts: &PartFacts) -> Option<f64> {
    let [x, y, z] = facts.size;
    let area = 2.0 * (x * y + y * z + z * x);
    (facts.triangles > 0 && facts.faces.is_empty())
        .then(|| (area / facts.triangles as f64 * 4.0 / 3f64.sqrt()).sqrt())
}

/// The Gauss curvature of the fit, 1/mm².
fn gauss_curvature(surface: &FittedSurface, at: ViewPoint) -> f64 {
    let jet = surface.jet(at);
    jet.hessian.determinant() / (1.0 + jet.gradient.norm_squared()).powi(2)
}
