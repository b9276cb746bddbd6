//! The report of one job: the inputs, the decisions, the accuracy of the result, and what to check.
//!
//! The JSON form is stable and identified by [`SCHEMA`]; `plugins/README.md` explains what programs can rely on.
//! Lengths are in mm, angles in degrees, times in milliseconds; the name of every field contains its unit.

use serde::{Deserialize, Serialize};

mod content;
mod fill;
mod focus;
mod lens;
mod list;

pub use content::{CodeReport, ContentReport};
pub use fill::FillReport;
pub use focus::{FocusReport, FocusStepReport};
pub use lens::LensTableReport;
pub(crate) use lens::lens_assumed;
pub use list::{ListGap, ListReport, ListRow};

use crate::cache::PartOrigin;
use crate::diff::DrawingDiff;
use crate::formats::mesh::{FrameFacts, PartFacts};
use crate::formats::pattern::PatternFacts;
use crate::geometry::correction::Exposure;
use crate::geometry::distances::Distances;
use crate::geometry::mapping::LengthTrueMap;
use crate::geometry::mapping::floater::FloaterWeights;
use crate::geometry::mapping::mapping_domain::MappingDomainOptions;
use crate::geometry::mapping::quality::{Distortion, Uncertain};
use crate::geometry::space::Extents;
use crate::geometry::surface::fit::FittedSurface;
use crate::printable::on_one_line;
use crate::reason::{Notice, Severity};

mod rotary;
mod sensitivity;

pub use rotary::{ROTARY_SCHEMA, RotaryReport, RotaryTable, TileReport};
pub use sensitivity::{EffectReport, MisplacedReport, Movement, SensitivityReport, UncertaintyReport};

/// Name and version of the JSON form.
pub const SCHEMA: &str = "isomark.report/1";
/// Maximum number of changes in the summary.
const MAX_CHANGES: usize = 5;

/// The report of a delivered job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Report {
    /// [`SCHEMA`].
    pub schema: String,
    /// Name and version of the program.
    pub program: String,
    /// The product.
    pub sku: String,
    /// The part and its surface.
    pub part: PartReport,
    /// The drawing.
    pub pattern: PatternReport,
    /// The placement of the drawing.
    pub placement: PlacementReport,
    /// The map of the drawing onto the part.
    pub map: MapReport,
    /// The accuracy of lengths, areas and angles on the part.
    pub quality: Quality,
    /// The part under the ink, as the beam reaches it.
    pub exposure: ExposureReport,
    /// What a misplaced part does to the mark; absent in reports of older programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivity: Option<SensitivityReport>,
    /// How well the lens is known; absent without a lens table.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens_table: Option<LensTableReport>,
    /// The lines that fill contours; absent without a fill.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fill: Option<FillReport>,
    /// The values of fields and the codes; absent for a drawing without them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub content: Option<ContentReport>,
    /// The steps into which the drawing is cut by height; absent without steps of focus.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub focus: Option<FocusReport>,
    /// The corrected drawing.
    pub output: OutputReport,
    /// The tiles of a mark that goes round the part; absent if the part does not turn.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotary: Option<RotaryReport>,
    /// The differences from the drawing that the new one replaces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub changes: Option<ChangesReport>,
    /// Everything that a person should know, the most important first.
    pub notices: Vec<Notice>,
    /// The time of each stage, in processing order.
    pub timings: Vec<Timing>,
}

/// The part and its surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct PartReport {
    /// File and hash.
    #[serde(flatten)]
    pub origin: PartOrigin,
    /// Facts about the file.
    pub facts: PartFacts,
    /// Name of the surface in the cache.
    pub surface_key: String,
    /// Whether the surface was loaded from the cache.
    pub surface_from_cache: bool,
    /// Control points along x and y.
    pub control_points: [usize; 2],
    /// Distance between control points, mm.
    pub span_mm: f64,
    /// The residual of the fit over the whole visible side.
    pub residual: ResidualReport,
}

/// Distance between the fitted surface and the sampled part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ResidualReport {
    /// Largest, mm.
    #[serde(rename = "largest_mm")]
    pub max_mm: f64,
    /// Position in the view, mm.
    pub at_mm: [f64; 2],
    /// Root mean square, mm.
    pub rms_mm: f64,
    /// 95th percentile, mm: 95 % of the samples are below it. Not the maximum.
    #[serde(rename = "most_mm")]
    pub p95_mm: f64,
    /// Largest under the ink, mm.
    pub under_ink_mm: f64,
    /// Largest possible distance of the part from its samples under the ink, mm, if the file's normals contradict its
    /// facets; absent if they do not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub doubt_under_ink_mm: Option<f64>,
    /// Number of samples.
    pub samples: usize,
}

/// The drawing as it was read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct PatternReport {
    /// The file's name.
    pub file: String,
    /// BLAKE3 hash of its bytes, in hexadecimal.
    pub blake3: String,
    /// Facts about the file.
    pub facts: PatternFacts,
    /// Number of paths read.
    pub paths: usize,
    /// How many of them are contours.
    pub contours: usize,
    /// The ink layers; absent if all layers are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ink_layers: Option<Vec<String>>,
}

/// The placement of the drawing in the view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct PlacementReport {
    /// Direction, in the part's frame, that faces the laser.
    pub facing: [f64; 3],
    /// Rotation of the view about the laser's axis, degrees.
    pub roll_deg: f64,
    /// The anchor in the drawing, mm.
    pub anchor_mm: [f64; 2],
    /// Its position in the view, mm.
    pub place_mm: [f64; 2],
    /// Rotation of the drawing, degrees.
    pub rotate_deg: f64,
    /// The direction of the drawing's x beside that round the axis of a cylinder or cone; absent on other surfaces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub round: Option<RoundReport>,
    /// The marking frame that gives the view and the place; absent if settings do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<FrameReport>,
}

/// The direction of the drawing's x, at its anchor, beside the direction round the axis of a cylinder or cone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct RoundReport {
    /// The turn of the drawing along the axis (`align = "axis"`), in addition to `rotate_deg`, degrees counter-clockwise.
    pub turned_deg: f64,
    /// The angle from the direction round the axis to the drawing's x, on the unrolled surface, degrees counter-clockwise,
    /// from -180 to 180.
    pub angle_deg: f64,
}

/// The marking frame of a job, in the part frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct FrameReport {
    /// Where it comes from.
    pub source: FrameSource,
    /// Origin and axes.
    #[serde(flatten)]
    pub frame: FrameFacts,
}

/// Where a marking frame comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum FrameSource {
    /// The settings or the command line.
    Settings,
    /// The node `isomark` in the part's file.
    Part,
}

/// The map of the drawing onto the part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(tag = "method", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum MapReport {
    /// The map with the smallest strain.
    Isometric {
        /// The weights.
        #[serde(flatten)]
        weights: WeightsReport,
        /// Number of steps of the solver.
        iterations: usize,
        /// Whether the search converged.
        settled: bool,
        /// Largest shift of a control point in the last step, mm.
        last_step_mm: f64,
        /// Weighted mean squared strain before the first and after the last step on the finest grid.
        energy: [f64; 2],
    },
    /// Exact unrolling.
    Cylinder {
        /// Radius, mm.
        radius_mm: f64,
        /// Direction of the axis in the view.
        axis: [f64; 3],
        /// A point of the axis in the view, mm.
        center_mm: [f64; 3],
        /// Largest distance of the part from the cylinder under the drawing, mm.
        residual_mm: f64,
    },
    /// Exact unrolling.
    Cone {
        /// Angle between axis and generators, degrees.
        half_angle_deg: f64,
        /// Direction of the axis in the view, from the apex into the cone.
        axis: [f64; 3],
        /// The apex in the view, mm.
        apex_mm: [f64; 3],
        /// Largest distance of the part from the cone under the drawing, mm.
        residual_mm: f64,
    },
    /// The thesis' own method, for comparison.
    MappingDomain {
        /// Cells along each side of the domain.
        grid: usize,
        /// Intervals of Simpson's rule along each side of a cell.
        intervals: usize,
        /// Largest distance between the samples of the surface, mm.
        sample_step_mm: f64,
        /// Errors of the thesis that were kept as printed: `simpson-weights`, `diagonal-sums`, `knot-vectors`.
        as_printed: Vec<String>,
    },
    /// The state of the art that the thesis compares with, for comparison.
    Floater {
        /// `uniform` or `mean-value`.
        weights: String,
        /// Sides of the square in the drawing, mm.
        scale_mm: [f64; 2],
    },
    /// Projection without a correction.
    None,
}

/// The weights of the map with the smallest strain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct WeightsReport {
    /// `ink` or `uniform`.
    pub weighting: String,
    /// What is kept first with `ink`: `balanced`, `lengths`, `areas` or `shapes`; in a comparison also `only lengths`,
    /// `only areas` or `only angles`. Absent from older reports.
    #[serde(default)]
    pub aim: String,
    /// Factor on the weight of line lengths.
    pub length_weight: f64,
    /// Factor on the weight of angles.
    pub angle_weight: f64,
}

/// The accuracy of the drawing on the part, measured on the sampled part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Quality {
    /// Without the correction, as this laser would mark the drawing, with its lens and the height of the part; absent if the drawing would
    /// then not be completely on the part.
    pub before: Option<DistortionReport>,
    /// With the correction.
    pub after: DistortionReport,
    /// How distances between the marks change, with the correction; absent where they do not, as on planes, cylinders and cones, for
    /// marks round a part, and without two marks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distances: Option<DistancesReport>,
}

/// How distances between neighbouring places of the marks change: across gaps, from letter to letter, from dot to dot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct DistancesReport {
    /// Number of distances that were measured.
    pub measured: usize,
    /// Sum of their changes / sum of the distances.
    pub mean_change: f64,
    /// The largest relative change: distance on the part / distance drawn - 1.
    pub largest_change: f64,
    /// This distance in the drawing, mm.
    pub drawn_mm: f64,
    /// The same on the part, mm.
    pub marked_mm: f64,
    /// Its middle in the placed drawing, mm.
    pub at_mm: [f64; 2],
}

/// The results of [`Distortion`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct DistortionReport {
    /// e_l, mm. It includes by how much chords differ in length from what they replace; without the correction, the drawing as
    /// drawn is divided by the same tolerance.
    pub length_error_mm: f64,
    /// e_l / length of all lines.
    pub length_error_relative: f64,
    /// e_a, mm².
    pub area_error_mm2: f64,
    /// e_a / inked area; 0 without inked area.
    pub area_error_relative: f64,
    /// Length of all lines as drawn, mm.
    pub length_mm: f64,
    /// Inked area as drawn, mm².
    pub area_mm2: f64,
    /// Largest relative change of length.
    #[serde(rename = "largest_stretch")]
    pub max_stretch: f64,
    /// Its position in the placed drawing, mm.
    #[serde(rename = "largest_stretch_at_mm")]
    pub max_stretch_at_mm: [f64; 2],
    /// Root mean square relative change of length.
    pub rms_stretch: f64,
    /// Largest relative change of area.
    #[serde(rename = "largest_area_stretch")]
    pub max_area_stretch: f64,
    /// Largest change of an angle, degrees.
    #[serde(rename = "largest_angle_error_deg")]
    pub max_angle_error_deg: f64,
    /// What these results contain because the surface is not known exactly between the vertices of the part's mesh; absent
    /// if it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertain: Option<UncertainReport>,
}

/// How far the surface may be from the part's mesh under the ink, and how much of the results that is.
///
/// The results are estimates from above as far as the mesh shows what is uncertain: where neighbouring facets or the normals
/// of a strip contradict each other, and where points scatter. What no vertex shows, such as a detail between the vertices, a
/// smooth surface that is read as an edge, or a single facet without neighbours, is not part of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct UncertainReport {
    /// Largest possible error of the height, mm.
    pub height_mm: f64,
    /// Largest possible error of the slope, degrees.
    pub slope_deg: f64,
    /// Share of e_l, mm.
    pub length_error_mm: f64,
    /// Share of e_a, mm².
    pub area_error_mm2: f64,
    /// Share of the largest relative change of length.
    #[serde(default)]
    pub stretch: f64,
    /// Largest share of an angle error, degrees.
    pub angle_error_deg: f64,
}

/// The part under the ink, as the beam reaches it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ExposureReport {
    /// Largest angle between beam and surface normal, degrees.
    pub incidence_deg: f64,
    /// Its position in the view, mm.
    pub incidence_at_mm: [f64; 2],
    /// Lowest and highest point in the laser's frame, mm.
    pub height_mm: [f64; 2],
    /// Height that should be in focus: the middle of the two, mm.
    pub best_focus_mm: f64,
}

/// The corrected drawing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct OutputReport {
    /// BLAKE3 hash of the file, in hexadecimal.
    pub blake3: String,
    /// Size of the file, bytes.
    pub bytes: usize,
    /// Its version, `R2000` or `R12`.
    pub dxf: String,
    /// Number of paths.
    pub paths: usize,
    /// Number of vertices.
    pub vertices: usize,
    /// Its bounding rectangle in the field: left, bottom, right, top, mm.
    pub extents_mm: [f64; 4],
    /// By how much the chords of curves differ in length from the curves that they replace, and the marks of straight lines from
    /// these, mm, summed; a part of e_l.
    #[serde(default)]
    pub shortening_mm: f64,
    /// Whether a second reader checked that the written file contains the intended drawing.
    #[serde(default)]
    pub read_back: bool,
}

/// The differences between the drawing and the one it replaces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ChangesReport {
    /// Number of paths in the older drawing.
    pub old_paths: usize,
    /// Number of paths in the new one.
    pub new_paths: usize,
    /// Number of paths that are the same.
    pub unchanged: usize,
    /// The changes as text.
    pub lines: Vec<String>,
}

/// The time of a stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Timing {
    /// The stage.
    pub stage: String,
    /// Its time, ms.
    pub ms: f64,
}

impl PartReport {
    /// The report of a surface.
    #[must_use]
    pub fn new(
        origin: PartOrigin,
        facts: PartFacts,
        surface: &FittedSurface,
        key: &str,
        from_cache: bool,
        exposure: &Exposure,
    ) -> Self {
        let (knots_x, knots_y) = surface.nurbs.knots();
        let residual = &surface.residual;
        Self {
            origin,
            facts,
            surface_key: key.into(),
            surface_from_cache: from_cache,
            control_points: [knots_x.control_points(), knots_y.control_points()],
            span_mm: knots_x.step(),
            residual: ResidualReport {
                max_mm: residual.max,
                at_mm: residual.at.coords().into(),
                rms_mm: residual.rms,
                p95_mm: residual.p95,
                under_ink_mm: exposure.max_difference,
                doubt_under_ink_mm: Some(exposure.max_doubt).filter(|doubt| *doubt > 0.0),
                samples: residual.nodes,
            },
        }
    }
}

impl MapReport {
    /// The report of a map; `weights` are those of an isometric map.
    #[must_use]
    pub fn new(map: &LengthTrueMap, weights: WeightsReport) -> Self {
        match map {
            LengthTrueMap::Isometric(map) => {
                let finest = map.iterations.last().map_or(0, |last| last.cells);
                let first = map.iterations.iter().find(|step| step.cells == finest);
                Self::Isometric {
                    weights,
                    iterations: map.iterations.len(),
                    settled: map.settled,
                    last_step_mm: map.iterations.last().map_or(0.0, |step| step.step),
                    energy: [
                        first.map_or(0.0, |step| step.energy),
                        map.iterations.last().map_or(0.0, |step| step.reached),
                    ],
                }
            }
            LengthTrueMap::Cylinder(map, fit) => Self::Cylinder {
                radius_mm: map.cylinder.radius,
                axis: (*map.cylinder.axis).into(),
                center_mm: map.cylinder.center.coords.into(),
                residual_mm: fit.residual,
            },
            LengthTrueMap::Cone(map, fit) => Self::Cone {
                half_angle_deg: map.cone.half_angle.to_degrees(),
                axis: (*map.cone.axis).into(),
                apex_mm: map.cone.apex.coords.into(),
                residual_mm: fit.residual,
            },
            LengthTrueMap::MappingDomain(map) => {
                let MappingDomainOptions { grid, intervals, sample_step, as_printed } = map.options;
                let kept = [
                    ("simpson-weights", as_printed.simpson_weights),
                    ("diagonal-sums", as_printed.diagonal_sums),
                    ("knot-vectors", as_printed.knot_vectors),
                ];
                let as_printed =
                    kept.into_iter().filter(|(_, kept)| *kept).map(|(name, _)| name.to_owned()).collect();
                Self::MappingDomain { grid, intervals, sample_step_mm: sample_step, as_printed }
            }
            LengthTrueMap::Floater(map) => Self::Floater {
                weights: match map.weights {
                    FloaterWeights::Uniform => "uniform".into(),
                    FloaterWeights::MeanValue => "mean-value".into(),
                },
                scale_mm: map.scale.into(),
            },
            LengthTrueMap::Plain => Self::None,
        }
    }

    /// The method's name, as on the command line.
    #[must_use]
    pub fn method(&self) -> &'static str {
        match self {
            Self::Isometric { .. } => "isometric",
            Self::Cylinder { .. } => "cylinder",
            Self::Cone { .. } => "cone",
            Self::MappingDomain { .. } => "mapping-domain",
            Self::Floater { .. } => "floater",
            Self::None => "none",
        }
    }
}

impl From<&Distortion> for DistortionReport {
    fn from(distortion: &Distortion) -> Self {
        let relative = |part: f64, whole: f64| if whole > 0.0 { part / whole } else { 0.0 };
        Self {
            length_error_mm: distortion.length_error,
            length_error_relative: relative(distortion.length_error, distortion.length),
            area_error_mm2: distortion.area_error,
            area_error_relative: relative(distortion.area_error, distortion.area),
            length_mm: distortion.length,
            area_mm2: distortion.area,
            max_stretch: distortion.max_stretch,
            max_stretch_at_mm: distortion.max_stretch_at.coords().into(),
            rms_stretch: distortion.rms_stretch,
            max_area_stretch: distortion.max_area_stretch,
            max_angle_error_deg: distortion.max_angle_error.to_degrees(),
            uncertain: UncertainReport::new(&distortion.uncertain),
        }
    }
}

impl From<&Distances> for DistancesReport {
    fn from(distances: &Distances) -> Self {
        let Distances { count, mean_change, worst, .. } = distances;
        Self {
            measured: *count,
            mean_change: *mean_change,
            largest_change: worst.share(),
            drawn_mm: worst.drawn,
            marked_mm: worst.marked,
            at_mm: worst.at.coords().into(),
        }
    }
}

impl UncertainReport {
    fn new(uncertain: &Uncertain) -> Option<Self> {
        (uncertain.max_slope > 0.0).then(|| Self {
            height_mm: uncertain.max_height,
            slope_deg: uncertain.max_slope.to_degrees(),
            length_error_mm: uncertain.length_error,
            area_error_mm2: uncertain.area_error,
            stretch: uncertain.max_stretch,
            angle_error_deg: uncertain.max_angle_error.to_degrees(),
        })
    }
}

impl From<&DrawingDiff> for ChangesReport {
    fn from(diff: &DrawingDiff) -> Self {
        Self {
            old_paths: diff.old_paths,
            new_paths: diff.new_paths,
            unchanged: diff.unchanged,
            lines: diff.lines(),
        }
    }
}

impl From<&Exposure> for ExposureReport {
    fn from(exposure: &Exposure) -> Self {
        Self {
            incidence_deg: exposure.steepest.to_degrees(),
            incidence_at_mm: exposure.steepest_at.coords().into(),
            height_mm: [exposure.lowest, exposure.highest],
            best_focus_mm: (exposure.lowest + exposure.highest) / 2.0,
        }
    }
}

/// Left, bottom, right, top.
#[must_use]
pub fn corners(extents: &Extents) -> [f64; 4] {
    [extents.min.x, extents.min.y, extents.max.x, extents.max.y]
}

impl Report {
    /// The JSON form, indented, with a newline at its end.
    ///
    /// # Errors
    /// Never for a report of finite numbers.
    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }

    /// One line for the log.
    #[must_use]
    pub fn headline(&self) -> String {
        let (after, before) = (&self.quality.after, self.quality.before.as_ref());
        let before = before.map_or(String::new(), |before| format!("{:.3} -> ", before.length_error_mm));
        let warnings = self.notices.iter().filter(|notice| notice.severity == Severity::Warning).count();
        let attention = match warnings {
            0 => String::new(),
            1 => ", 1 warning in the report".to_owned(),
            more => format!(", {more} warnings in the report"),
        };
        format!("{}, length error {before}{:.3} mm{attention}", self.map.method(), after.length_error_mm)
    }

    /// One paragraph for people: the job, its accuracy, what to check, and what changed from the previous drawing.
    #[must_use]
    pub fn summary(&self) -> String {
        self.summary_replacing("drawing")
    }

    /// The same for a result that replaced the drawing named `previous`.
    pub(crate) fn summary_replacing(&self, previous: &str) -> String {
        let after = &self.quality.after;
        let before = self.quality.before.as_ref();
        // Where the drawing as drawn is partly beside the part, it has no values there.
        let from = |value: fn(&DistortionReport) -> f64, digits: usize| {
            before.map_or(String::new(), |before| format!("{:.digits$} -> ", value(before)))
        };
        let mut text = format!(
            "{}: {} ({:.1} x {:.1} mm, {}) corrected with `{}` on {} ({:.1} x {:.1} x {:.1} mm{})",
            self.sku,
            self.pattern.file,
            self.pattern.facts.size[0],
            self.pattern.facts.size[1],
            match self.pattern.paths {
                1 => "1 path".to_owned(),
                paths => format!("{paths} paths"),
            },
            self.map.method(),
            self.part.origin.file,
            self.part.facts.size[0],
            self.part.facts.size[1],
            self.part.facts.size[2],
            if self.part.surface_from_cache { ", from the cache" } else { "" },
        );
        let mut lines = vec![format!(
            "length error  {}{:.3} mm on {:.1} mm of lines, largest stretch {}{:.3} %",
            from(|quality| quality.length_error_mm, 3),
            after.length_error_mm,
            after.length_mm,
            from(|quality| quality.max_stretch * 100.0, 2),
            after.max_stretch * 100.0,
        )];
        if after.area_mm2 > 0.0 {
            lines.push(format!(
                "area error    {}{:.3} mm2 on {:.1} mm2",
                from(|quality| quality.area_error_mm2, 3),
                after.area_error_mm2,
                after.area_mm2,
            ));
        }
        lines.push(format!(
            "angle error   {}{:.2} deg at most",
            from(|quality| quality.max_angle_error_deg, 2),
            after.max_angle_error_deg,
        ));
        if let Some(distances) = &self.quality.distances {
            lines.push(format!(
                "distances     between marks change by {:.2} % on average, the most of {} measured by {:+.1} %: {:.2} mm are {:.2} mm",
                distances.mean_change * 100.0,
                distances.measured,
                distances.largest_change * 100.0,
                distances.drawn_mm,
                distances.marked_mm,
            ));
        }
        if before.is_none() {
            lines.push(
                "without values before the correction: the drawing as drawn is not completely on the part"
                    .into(),
            );
        }
        let scan = self.part.facts.scan.as_ref();
        let measured = match scan.and_then(|scan| scan.surfaces.first()) {
            Some(surface) => {
                format!("smoothed scan, whose points scatter by {:.3} mm", surface.noise_mm)
            }
            None => "part".to_owned(),
        };
        lines.push(format!(
            "surface       residual at most {:.4} mm under the ink, from the {measured}; the beam hits it at up to {:.0} deg",
            self.part.residual.under_ink_mm, self.exposure.incidence_deg,
        ));
        let [lowest, highest] = self.exposure.height_mm;
        lines.push(format!(
            "focus         best at z = {:.2} mm in the laser's frame; the ink spans {:.2} mm of height",
            self.exposure.best_focus_mm + 0.0,
            highest - lowest,
        ));
        lines.extend(self.focus.as_ref().map(FocusReport::summary));
        lines.extend(self.fill.as_ref().map(FillReport::summary));
        lines.extend(self.content.iter().flat_map(ContentReport::lines));
        lines.extend(self.sensitivity.iter().flat_map(SensitivityReport::lines));
        lines.extend(self.lens_table.map(|table| format!("lens table    {}", table.summary())));
        lines.extend(self.rotary.as_ref().map(RotaryReport::summary));
        if let Some(scan) = scan {
            let what = if self.part.facts.triangles > 0 { "mesh, smoothed as a scan" } else { "scan" };
            lines.push(format!("{what}: {}", scan.summary()));
        }
        text = on_one_line(&text);
        for line in &lines {
            text += &format!("\n  {}", on_one_line(line));
        }
        for notice in &self.notices {
            // A wrong unit of the drawing is a wrong size on the part.
            let is_of_unit = ["unit-assumed", "unit-setting-unused"].contains(&notice.code.as_str());
            match notice.severity {
                Severity::Warning => text += &format!("\n  warning: {}", on_one_line(&notice.message)),
                // Under another lens, the values above are not those of the mark.
                Severity::Note if notice.code == "lens-assumed" => {
                    text += &format!("\n  note: {}", on_one_line(&notice.message));
                }
                Severity::Note if is_of_unit && self.pattern.facts.notices.contains(notice) => {
                    text += &format!("\n  note: {}", on_one_line(&notice.message));
                }
                Severity::Note => {}
            }
        }
        if let Some(changes) = &self.changes {
            text += &format!("\n  compared with the previous {}, which was replaced:", on_one_line(previous));
            for line in changes.lines.iter().take(MAX_CHANGES) {
                text += &format!("\n    {}", on_one_line(line));
            }
            if changes.lines.len() > MAX_CHANGES {
                text += &format!("\n    {} more; see the report", changes.lines.len() - MAX_CHANGES);
            }
        }
        text
    }
}
