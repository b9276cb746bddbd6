//! Compares all methods for one drawing on one part.

use serde::{Deserialize, Serialize};

use super::placing::PlacedPattern;
use super::{Clock, LearnedPart, PatternInput, Pipeline, PipelineError, Step};
use super::{checks, chords, hash, measured, method, program, weights};
use crate::cache::PartOrigin;
use crate::config::{Aim, CorrectionSettings, FloaterWeights, JobSettings, Method, Sku, Weighting};
use crate::geometry::correction::Projection;
use crate::geometry::mapping::mapping_domain::{AsPrinted, MappingDomainOptions};
use crate::geometry::mapping::{self, LengthTrueMap};
use crate::reason::Reason;
use crate::report::{DistortionReport, MapReport, PlacementReport, Timing};

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
    /// The time of each stage.
    pub timings: Vec<Timing>,
}

/// One method in one variant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct EvaluationRow {
    /// The method's name, as in the settings.
    pub method: String,
    /// The variant as text; empty for methods without variants.
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
        let compared: Vec<_> =
            methods.iter().flat_map(|method| variants(*method, &settings.correction)).collect();
        let (of, mut rows) = (compared.len(), Vec::new());
        for (index, (variant, correction)) in compared.into_iter().enumerate() {
            let settings = JobSettings { correction, ..settings.clone() };
            let name = label(&settings, &variant);
            steps.at(Step::Method { number: index + 1, of, name: &name });
            rows.push(row(learned, &placed, variant, &settings, &mut clock));
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
            rows,
            timings,
        })
    }
}

/// A method in each of its variants, with their names.
fn variants(method: Method, given: &CorrectionSettings) -> Vec<(String, CorrectionSettings)> {
    let given = CorrectionSettings { method, ..given.clone() };
    let domain = |name: &str, as_printed: AsPrinted| {
        let mapping_domain = MappingDomainOptions { as_printed, ..given.mapping_domain };
        (name.to_owned(), CorrectionSettings { mapping_domain, ..given.clone() })
    };
    match method {
        Method::Isometric => {
            let aims = Aim::ALL.iter().map(|aim| (Weighting::Ink, *aim, format!("aim {aim}")));
            let uniform = (Weighting::Uniform, Aim::default(), Weighting::Uniform.to_string());
            let of = |(weighting, aim, name)| (name, CorrectionSettings { weighting, aim, ..given.clone() });
            aims.chain([uniform]).map(of).collect()
        }
        Method::MappingDomain => vec![
            domain("corrected", AsPrinted::NOTHING),
            domain("Simpson as printed", AsPrinted::SIMPSON),
            domain("all as printed", AsPrinted::EVERYTHING),
        ],
        Method::Floater => [FloaterWeights::Uniform, FloaterWeights::MeanValue]
            .map(|floater_weights| {
                (floater_weights.to_string(), CorrectionSettings { floater_weights, ..given.clone() })
            })
            .into(),
        Method::Auto | Method::Cylinder | Method::Cone | Method::None => vec![(String::new(), given)],
    }
}

/// The name of a method with its choice.
fn label(settings: &JobSettings, variant: &str) -> String {
    let name = settings.correction.method.name();
    if variant.is_empty() { name.to_owned() } else { format!("{name}, {variant}") }
}

fn row(
    learned: &LearnedPart,
    placed: &PlacedPattern,
    variant: String,
    settings: &JobSettings,
    clock: &mut Clock,
) -> EvaluationRow {
    let surface = &learned.kept.surface;
    let PlacedPattern { facts, placed: pattern, placing, ink } = placed;
    let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
    let name = settings.correction.method.name();
    let label = label(settings, &variant);
    clock.lap("measure");
    let map = LengthTrueMap::find(surface, pattern, is_ink, placing.place, &method(settings));
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
    let results =
        map.map_err(|error| checks::map_reason(&error, placing.place, &learned.kept, ink)).and_then(|map| {
            let mut distortion = measured(ink, &map, &|at| map.point(at), surface)
                .map_err(|at| checks::off_surface(at, &learned.kept, &ink.extents))?;
            let projection =
                Projection { map: &map, surface, fixture: settings.fixture, head: settings.scan_head() };
            let bent = chords::bend(&projection, pattern, settings)
                .map_err(|error| checks::not_reached(error.at, settings))?;
            distortion.shorten(chords::of_ink(pattern, &bent, settings));
            Ok((map, distortion))
        });
    match results {
        Err(reason) => EvaluationRow { reason: Some(checks::doubting_unit(reason, facts)), ..empty },
        Ok((map, distortion)) => {
            let limit = mapping::Method::EXACT_TOLERANCE;
            let far = map.fit_residual().filter(|residual| *residual > limit);
            EvaluationRow {
                note: far.map(|residual| format!("the part is up to {residual:.3} mm from this {name}")),
                map: Some(MapReport::new(&map, weights(&settings.correction))),
                quality: Some((&distortion).into()),
                ..empty
            }
        }
    }
}
