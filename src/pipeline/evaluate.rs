//! Compares all methods for one drawing on one part.

use serde::{Deserialize, Serialize};

use super::map_method::method;
use super::mapped_ink::{measured, without_open_areas};
use super::placing::PlacedPattern;
use super::{Clock, LearnedPart, PatternInput, Pipeline, PipelineError, Step};
use super::{checks, chords, fill, hash, program, weights};
use crate::cache::{CachedSurface, PartOrigin};
use crate::config::{Aim, CorrectionSettings, FloaterWeights, JobSettings, Method, Sku, Weighting};
use crate::cores::Cores;
use crate::geometry::correction::Projection;
use crate::geometry::ink::Ink;
use crate::geometry::mapping::isometric::IsometricOptions;
use crate::geometry::mapping::mapping_domain::{AsPrinted, MappingDomainOptions};
use crate::geometry::mapping::{self, LengthTrueMap};
use crate::reason::Reason;
use crate::report::{DistortionReport, MapReport, PlacementReport, Timing, WeightsReport};

/// Name and version of the JSON form of an [`Evaluation`].
pub const EVALUATION_SCHEMA: &str = "isomark.evaluate/1";

/// The accuracy of each method for a drawing on a part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Evaluation {
    /// [`EVALUATION_SCHEMA`].
    pub schema: String,
    /// Name and version of the program.
    pub program: String,
    /// The product.
    pub sku: String,
    /// The part's file and hash.
    pub part: PartOrigin,
    /// The drawing's file.
    pub pattern: String,
    /// BLAKE3 hash of its bytes, in hexadecimal.
    pub pattern_blake3: String,
    /// Width and height of the drawing, mm.
    pub size_mm: [f64; 2],
    /// Length of all its lines, mm.
    pub length_mm: f64,
    /// Its inked area, mm².
    pub area_mm2: f64,
    /// Its placement.
    pub placement: PlacementReport,
    /// One row for each method and variant.
    pub rows: Vec<EvaluationRow>,
    /// The least values that were found; absent if `isometric` is not compared or none of its maps can be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor: Option<FloorReport>,
    /// The time of each stage.
    pub timings: Vec<Timing>,
}

/// The least value of each figure, which no row goes below. Each can be reached alone, not together with the others.
///
/// They are estimates: the least that is found when one figure is lowered without regard to the others, and not proven bounds.
/// Areas alone and angles alone can be kept on any smooth surface (Moser 1965; isothermal coordinates, Gauss 1822), so that
/// their floors are what the fit of the part leaves; what they cost is in the rows "only areas" and "only angles".
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct FloorReport {
    /// Of the sum of the length errors, mm.
    pub length_error_mm: f64,
    /// Of the sum of the area errors, mm².
    pub area_error_mm2: f64,
    /// Of the largest angle error, degrees.
    #[serde(rename = "largest_angle_error_deg")]
    pub max_angle_error_deg: f64,
}

/// One method in one variant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct EvaluationRow {
    /// The method's name, as in the settings.
    pub method: String,
    /// The variant as text; empty for methods without variants. "only lengths", "only areas" and "only angles" are not for
    /// production: they show what the floor of a figure costs.
    pub variant: String,
    /// Time to find the map, ms.
    pub map_ms: f64,
    /// The map of the drawing; absent if the method cannot be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<MapReport>,
    /// The distortion on the part; absent if the method cannot be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quality: Option<DistortionReport>,
    /// Why the method cannot be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<Reason>,
    /// A remark on the results.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

impl Pipeline {
    /// Finds and measures the maps of `methods`, in all their variants.
    ///
    /// # Errors
    /// When the pattern cannot be read, or has nothing to mark on the part. If a method fails, that is not an error;
    /// its row states the reason.
    pub fn evaluate(
        &self,
        sku: &Sku,
        learned: &LearnedPart,
        input: PatternInput<'_>,
        settings: &JobSettings,
        methods: &[Method],
    ) -> Result<Evaluation, PipelineError> {
        let mut clock = Clock::start();
        let settings = &Self::framed(settings, sku, &learned.kept, &mut Vec::new());
        let steps = self.observer.steps(input.name);
        let placed = self.place(input, &learned.kept, settings, &steps, &mut clock)?;
        let needed = learned.needed_for(&placed, settings);
        let near = needed.as_ref().unwrap_or(learned);
        let compared: Vec<_> =
            methods.iter().flat_map(|method| variants(*method, &settings.correction)).collect();
        let (of, mut rows) = (compared.len(), Vec::new());
        for (index, Compared { variant, correction, only }) in compared.into_iter().enumerate() {
            let settings = JobSettings { correction, ..settings.clone() };
            let name = label(&settings, &variant);
            steps.at(Step::Method { number: index + 1, of, name: &name });
            rows.push(row(near, &learned.kept, &placed, variant, only, &settings, &mut clock));
        }
        let mut timings = learned.timings.clone();
        timings.append(&mut clock.laps);
        Ok(Evaluation {
            schema: EVALUATION_SCHEMA.into(),
            program: program(),
            sku: sku.to_string(),
            part: learned.kept.origin.clone(),
            pattern: input.name.into(),
            pattern_blake3: hash(input.bytes),
            size_mm: placed.facts.size,
            length_mm: placed.ink.length(),
            area_mm2: placed.ink.area(),
            placement: placed.placing.report(settings),
            floor: floor(&rows),
            rows,
            timings,
        })
    }
}

/// The maps that lower one figure without regard to the others.
const ONLY: [(&str, IsometricOptions); 3] = [
    ("only lengths", IsometricOptions::ONLY_LENGTHS),
    ("only areas", IsometricOptions::ONLY_AREAS),
    ("only angles", IsometricOptions::ONLY_ANGLES),
];

/// A method in one variant.
struct Compared {
    variant: String,
    correction: CorrectionSettings,
    /// The options of a map that no setting asks for.
    only: Option<IsometricOptions>,
}

/// A method in each of its variants.
fn variants(method: Method, given: &CorrectionSettings) -> Vec<Compared> {
    let given = CorrectionSettings { method, ..given.clone() };
    let set = |name: &str, correction: CorrectionSettings| Compared {
        variant: name.into(),
        correction,
        only: None,
    };
    let domain = |name: &str, as_printed: AsPrinted| {
        let mapping_domain = MappingDomainOptions { as_printed, ..given.mapping_domain };
        set(name, CorrectionSettings { mapping_domain, ..given.clone() })
    };
    match method {
        Method::Isometric => {
            let aim = |aim: &Aim| {
                let correction = CorrectionSettings { weighting: Weighting::Ink, aim: *aim, ..given.clone() };
                set(&format!("aim {aim}"), correction)
            };
            let weighting = Weighting::Uniform;
            let uniform = CorrectionSettings { weighting, aim: Aim::default(), ..given.clone() };
            let only = |(name, options): (&str, IsometricOptions)| {
                let correction = CorrectionSettings { weighting: Weighting::Ink, ..given.clone() };
                Compared { only: Some(options), ..set(name, correction) }
            };
            let settable = Aim::ALL.iter().map(aim).chain([set(weighting.name(), uniform)]);
            settable.chain(ONLY.map(only)).collect()
        }
        Method::MappingDomain => vec![
            domain("corrected", AsPrinted::NOTHING),
            domain("Simpson as printed", AsPrinted::SIMPSON),
            domain("all as printed", AsPrinted::EVERYTHING),
        ],
        Method::Floater => [FloaterWeights::Uniform, FloaterWeights::MeanValue]
            .map(|floater_weights| {
                set(floater_weights.name(), CorrectionSettings { floater_weights, ..given.clone() })
            })
            .into(),
        Method::Auto | Method::Cylinder | Method::Cone | Method::None => vec![set("", given)],
    }
}

/// The least of each figure in all rows, if they include maps that lower one figure alone.
fn floor(rows: &[EvaluationRow]) -> Option<FloorReport> {
    let is_only = |row: &EvaluationRow| ONLY.iter().any(|(name, _)| row.variant == *name);
    rows.iter().find(|row| is_only(row) && row.quality.is_some())?;
    let least = |figure: fn(&DistortionReport) -> f64| {
        rows.iter().filter_map(|row| row.quality.as_ref()).map(figure).fold(f64::INFINITY, f64::min)
    };
    Some(FloorReport {
        length_error_mm: least(|quality| quality.length_error_mm),
        area_error_mm2: least(|quality| quality.area_error_mm2),
        max_angle_error_deg: least(|quality| quality.max_angle_error_deg),
    })
}

/// The name of a method with its choice.
fn label(settings: &JobSettings, variant: &str) -> String {
    let name = settings.correction.method.name();
    if variant.is_empty() { name.to_owned() } else { format!("{name}, {variant}") }
}

fn row(
    learned: &LearnedPart,
    whole: &CachedSurface,
    placed: &PlacedPattern,
    variant: String,
    only: Option<IsometricOptions>,
    settings: &JobSettings,
    clock: &mut Clock,
) -> EvaluationRow {
    let surface = &learned.kept.surface;
    let PlacedPattern { facts, placed: pattern, placing, ink } = placed;
    let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
    let name = settings.correction.method.name();
    let label = label(settings, &variant);
    clock.lap("measure");
    let method = only.map_or_else(|| method(settings), mapping::Method::Isometric);
    let marked = fill::for_map(pattern, settings);
    let map = LengthTrueMap::find_with_fork(surface, &marked, is_ink, placing.place, &method, &Cores);
    clock.lap(&format!("map {label}"));
    let map_ms = clock.laps.last().map_or(0.0, |lap| lap.ms);
    let empty = EvaluationRow {
        method: name.into(),
        variant,
        map_ms,
        map: None,
        quality: None,
        reason: None,
        note: None,
    };
    let results = map.map_err(|error| placed.map_reason(&error, whole, settings)).and_then(|map| {
        let projection =
            Projection { map: &map, surface, fixture: settings.fixture, head: settings.scan_head() };
        let measure = |ink: &Ink| measured(ink, &map, &|at| map.point(at), surface);
        let lines =
            || without_open_areas(ink, &fill::marked_ink(pattern, ink, settings), &projection, settings);
        let mut distortion = measure(ink)
            .or_else(|at| lines().map_or(Err(at), |(lines, _)| measure(&lines)))
            .map_err(|at| checks::off_surface(at, whole, &ink.extents))?;
        let shortened = match map {
            LengthTrueMap::Plain => chords::as_drawn(&projection, pattern, settings),
            _ => chords::bend(&projection, pattern, settings)
                .map(|bent| chords::of_ink(pattern, &bent.shortening, settings)),
        };
        distortion.shorten(shortened.map_err(|error| checks::not_reached(error.at, settings))?);
        Ok((map, distortion))
    });
    match results {
        Err(reason) => EvaluationRow { reason: Some(checks::doubting_unit(reason, facts)), ..empty },
        Ok((map, distortion)) => {
            let limit = mapping::Method::EXACT_TOLERANCE;
            let mut weights = weights(&settings.correction);
            if only.is_some() {
                weights = WeightsReport {
                    aim: empty.variant.clone(),
                    length_weight: 1.0,
                    angle_weight: 1.0,
                    ..weights
                };
            }
            let far = map.fit_residual().filter(|residual| *residual > limit);
            EvaluationRow {
                note: far.map(|residual| format!("the part is up to {residual:.3} mm from this {name}")),
                map: Some(MapReport::new(&map, weights)),
                quality: Some((&distortion).into()),
                ..empty
            }
        }
    }
}
