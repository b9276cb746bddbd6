//! All stages of a job: read → sample → fit → map → bend → check → write.
//!
//! ```text
//! part bytes ──read──▶ TriMesh ──sample, fit──▶ FittedSurface ─┐   kept per SKU in the cache
//! pattern bytes ──read──▶ Pattern ──place──────────────────────┴▶ LengthTrueMap ▶ MarkingDrawing ▶ DXF + Report
//! ```
//!
//! [`Pipeline::learn`] runs the upper line, [`Pipeline::correct`] the lower one. Input and output are bytes; only the
//! files of the cache are read and written.

use std::io;
use std::sync::Arc;
use std::time::Instant;

use nalgebra::Vector3;

use crate::cache::{Cache, CacheKey, CachedSurface, Shared, SharedSurfaces};
use crate::config::{Aim, CorrectionSettings, DxfVersion, JobSettings, PartSettings, Sku, Verify, Weighting};
use crate::diff;
use crate::formats::Pace;
use crate::formats::mesh::PartFacts;
use crate::formats::pattern::{self, DxfProfile, PatternFacts, PatternOptions, RepairPlace};
use crate::geometry::correction::{Bent, Exposure, Projection};
use crate::geometry::distances::distances;
use crate::geometry::frame_outline::frame_outline;
use crate::geometry::ink::Ink;
use crate::geometry::mapping::quality::Distortion;
use crate::geometry::mapping::{LengthTrueMap, Method};
use crate::geometry::marking::MarkingDrawing;
use crate::geometry::optics::Lens;
use crate::geometry::pattern::Pattern;
use crate::geometry::picture_mesh::PictureMesh;
use crate::geometry::space::FlatPoint;
use crate::geometry::surface::fit::{FitOptions, FittedSurface};
use crate::preview::Preview;
use crate::reason::{Notice, Reason};
use crate::report::{
    self, ChangesReport, DistancesReport, DistortionReport, MapReport, OutputReport, PartReport,
    PatternReport, PlacementReport, Quality, Report, SensitivityReport, Timing, WeightsReport,
};
use crate::report_html::Landmarks;

pub(crate) mod learning;
mod scan;
mod placing;
mod causes;
mod chords;
mod checks;
mod content;
mod converting;
mod evaluate;
mod fill;
mod focus;
mod in_space;
mod landmarks;
mod list;
mod mapped_ink;
mod map_method;
mod suggested_place;
mod marked;
mod preview;
mod on_part;
mod progress;
mod recent;
mod regions;
mod rotary;
mod task;

#[cfg(feature = "cli")]
pub(crate) use content::misspelt_fields;
pub use content::{Variable, check_fixed_codes, check_values, variable};
pub use evaluate::{EVALUATION_SCHEMA, Evaluation, EvaluationRow, FloorReport};
pub use focus::StepDrawing;
pub use learning::part_hash;
pub use list::ListJob;
pub use marked::Marked;
pub use progress::{Progress, Step};
pub use rotary::{TileFile, rotary_table};
pub use scan::surface_of;

use landmarks::Lift;
use progress::Observer;
use recent::RecentDrawings;

/// The work for a piece of a line, in squares of inked area.
const WORK_OF_PIECE: usize = 6;
/// The work that a quick job may take, in squares of inked area.
const QUICK_WORK: usize = 200_000;
/// The size of an older drawing that can be compared in a quick job, bytes.
const QUICK_BYTES: usize = 2 << 20;

/// Distances that change by less than this share do not change.
const LEAST_CHANGE: f64 = 1e-4;

/// Stands between the program and the SKU in a corrected drawing's first comment.
const CORRECTED_FOR: &str = ", corrected for SKU ";
/// The second comment of a frame drawing.
const FRAME_USE: &str = "Trace it with the pilot beam; do not mark it";
/// The comments of a corrected drawing are within this many bytes of its beginning.
const LENGTH_OF_HEAD: usize = 4096;

/// A pattern file in memory.
#[derive(Debug, Clone, Copy)]
pub struct PatternInput<'a> {
    /// The file's name.
    pub name: &'a str,
    /// Its content.
    pub bytes: &'a [u8],
    /// The corrected drawing that the new one replaces, if any.
    pub previous: Option<&'a [u8]>,
}

/// A surface ready for patterns.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct LearnedPart {
    /// The surface with its origin.
    pub kept: CachedSurface,
    /// Its name in the cache.
    pub key: CacheKey,
    /// Whether it was loaded from the cache.
    pub from_cache: bool,
    /// The settings that it was fitted with, with the view of a marking frame in the part's file.
    pub settings: PartSettings,
    /// The part's mesh for pictures, if it was read just now; otherwise the cache may have it.
    pub mesh: Option<PictureMesh>,
    /// Notices, in addition to those in the facts of the file.
    pub notices: Vec<Notice>,
    /// The times of the stages.
    pub timings: Vec<Timing>,
    recent: RecentDrawings,
}

/// A corrected drawing with its report.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Corrected {
    /// The DXF file.
    pub dxf: Vec<u8>,
    /// The drawing in the file.
    pub drawing: MarkingDrawing,
    /// The steps of focus into which it is cut; empty if it is not cut.
    pub steps: Vec<StepDrawing>,
    /// The DXF dialect of the file.
    pub profile: DxfProfile,
    /// The files of a mark in tiles (`[rotary] as = "files"`), in the order of their angles; otherwise empty, and all tiles
    /// are layers of [`dxf`](Self::dxf).
    pub tile_files: Vec<TileFile>,
    /// The report.
    pub report: Report,
    /// The content of the preview, if requested; [`svg`](crate::preview::svg) draws it, which takes longer than all
    /// other stages.
    pub preview: Option<Preview>,
    /// What [`Pipeline::on_part`] needs, if pictures were requested.
    pub marked: Option<Marked>,
    /// What is around the mark, for a report in HTML, if pictures were requested.
    pub landmarks: Option<Landmarks>,
    /// The outline of the ink and its box for the pilot beam, in the field, if pictures were requested.
    pub frame: Option<FrameDrawing>,
}

/// The frame drawing: a few lines for the pilot beam.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameDrawing {
    drawing: MarkingDrawing,
    profile: DxfProfile,
}

impl FrameDrawing {
    /// Its DXF file, in the dialect of the corrected drawing.
    #[must_use]
    pub fn dxf(&self) -> Vec<u8> {
        pattern::write(&self.drawing, self.profile)
    }
}

impl Corrected {
    /// Whether a drawing of this size is to be read back under these settings.
    #[must_use]
    pub fn is_to_be_read_back(&self, verify: Verify) -> bool {
        verify.applies_to(pattern::readback_work(&self.drawing, self.profile))
    }

    /// Compares the content of the written file with the intended drawing, using a second reader, and records the
    /// check in the report.
    ///
    /// # Errors
    /// The first difference ([`pattern::read_back`]).
    pub fn read_back(&mut self, file: &[u8]) -> Result<(), Reason> {
        pattern::read_back(file, &self.drawing, self.profile).map_err(|error| error.reason())?;
        self.report.output.read_back = true;
        Ok(())
    }
}

/// Why a job failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PipelineError {
    /// The input is rejected; trying again gives the same result.
    #[error("{0}")]
    Rejected(Reason),
    /// The job is too much work for a quick job, which [`Pipeline::at`] requested.
    #[error("the job is too large for a quick job")]
    TakesLong,
    /// The cache's folder cannot be used; the input may be valid.
    #[error("the cache cannot be used: {0}")]
    Environment(#[from] io::Error),
}

impl From<Reason> for PipelineError {
    fn from(reason: Reason) -> Self {
        Self::Rejected(reason)
    }
}

/// All stages of a job, with the cache.
#[derive(Debug, Clone)]
pub struct Pipeline {
    cache: Option<Cache>,
    fit: FitOptions,
    pace: Pace,
    observer: Observer,
    shared: Shared,
}

impl Pipeline {
    /// A pipeline that keeps surfaces in `cache`, or keeps none.
    #[must_use]
    pub fn new(cache: Option<Cache>) -> Self {
        Self {
            cache,
            fit: FitOptions::default(),
            pace: Pace::Any,
            observer: Observer::default(),
            shared: Shared::default(),
        }
    }

    /// The same pipeline with another cache.
    #[must_use]
    pub fn with_cache(self, cache: Option<Cache>) -> Self {
        Self { cache, ..self }
    }

    /// The same pipeline with `observe` called at the beginning of every step, by the thread that does it.
    #[must_use]
    pub fn observed(self, observe: impl Fn(Progress<'_>) + Send + Sync + 'static) -> Self {
        Self { observer: Observer::new(observe), ..self }
    }

    /// The same pipeline with surfaces that other stations share.
    #[must_use]
    pub fn sharing(self, shared: Arc<dyn SharedSurfaces>) -> Self {
        Self { shared: Shared(Some(shared)), ..self }
    }

    /// The same pipeline at another pace: a quick one stops with [`PipelineError::TakesLong`] as soon as the content
    /// of the files turns out to be too much work.
    #[must_use]
    pub fn at(self, pace: Pace) -> Self {
        Self { pace, ..self }
    }

    /// Fails if `work` is more than the pace allows; `quick` is the limit for a quick job.
    fn check_pace(&self, work: usize, quick: usize) -> Result<(), PipelineError> {
        if self.pace.allows(work, quick) { Ok(()) } else { Err(PipelineError::TakesLong) }
    }

    /// Corrects a pattern for a surface.
    ///
    /// # Errors
    /// When the pattern cannot be read, is not on the part, or cannot be marked there.
    pub fn correct(
        &self,
        sku: &Sku,
        learned: &LearnedPart,
        input: PatternInput<'_>,
        settings: &JobSettings,
        with_pictures: bool,
    ) -> Result<Corrected, PipelineError> {
        let given = settings;
        let mut clock = Clock::start();
        let part = &learned.kept;
        let mut notices = learned.notices.clone();
        let settings = &Self::framed(settings, sku, part, &mut notices);
        self.check_pace(input.previous.map_or(0, <[u8]>::len), QUICK_BYTES)?;
        let steps = self.observer.steps(input.name);
        let placed_pattern = self.place(input, part, settings, &steps, &mut clock)?;

        steps.at(Step::Map);
        let whole = learned;
        let needed = whole.needed_for(&placed_pattern, settings);
        let learned = needed.as_ref().unwrap_or(whole);
        let part = &learned.kept;
        let surface = &part.surface;
        let rolled = Self::rolled(placed_pattern, learned, whole, settings, input.name)?;
        let (placed_pattern, map, tiles) = (rolled.pattern, rolled.map, rolled.tiles);
        let settings = &rolled.settings;
        let (facts, placing) = (placed_pattern.facts, placed_pattern.placing);
        let placed = placed_pattern.placed;
        let mut mapped = learned.recent.mapped(placed_pattern.ink, map, settings);
        // The ink of tiles is on several sides of the part.
        let lines = tiles
            .is_none()
            .then(|| {
                mapped.without_open_areas(surface, settings, |ink| fill::marked_ink(&placed, ink, settings))
            })
            .flatten();
        if let Some((lines, open)) = lines {
            let lines = learned.recent.mapped(lines, mapped.map.clone(), settings);
            if lines.exposure(surface).off_surface == 0 {
                notices.push(checks::open_areas(&open, &lines.map));
                mapped = lines;
            }
        }
        let (ink, map, projection) = (&mapped.ink, &mapped.map, mapped.projection(surface));
        let rejected = |reason: Reason| {
            let reason = suggested_place::suggesting_place(reason, &placed, &whole.kept, settings);
            checks::doubting_unit(reason, &facts).in_file(input.name)
        };
        if let Some(tiles) = &tiles {
            fill::in_tiles((&tiles.drawn, given), (&placed, settings)).map_err(rejected)?;
        }
        clock.lap("map");

        let exposure = mapped.exposure(surface);
        checks::ink_layers(&placed, settings, &mut notices);
        let lift = Lift::new(surface, &learned.settings);
        checks::on_surface(exposure, &whole.kept, &ink.extents).map_err(rejected)?;
        checks::exposure(exposure, &projection, part, lift, ink, settings, &mut notices).map_err(rejected)?;
        let over_part = Lift::new(&whole.kept.surface, &learned.settings);
        checks::hidden(&projection, ink, &whole.kept, settings, over_part).map_err(rejected)?;
        notices.extend(checks::mark_region(map, part, ink, settings).map_err(rejected)?);
        if settings.optics.lens_is_assumed && settings.optics.lens == Lens::Telecentric {
            let field = settings.field.map(|field| field.extents());
            notices.extend(report::lens_assumed(exposure, field.as_ref()));
        }
        clock.lap("check");
        // Tiles are marked one after the other in front of the laser, where their lines cross.
        if tiles.is_none() {
            notices.extend(checks::close_lines(ink, map, settings, lift));
        }
        clock.lap("check lines");

        steps.at(Step::Bend);
        let bent = chords::bend(&projection, &placed, settings)
            .map_err(|error| rejected(checks::not_reached(error.at, settings)))?;
        let shortened = chords::of_ink(&placed, &bent.shortening, settings);
        let Bent { mut drawing, mut drawn, .. } = bent;
        let shortening = shortened.iter().fold(0.0, |sum, path| sum + path.lost);
        let shortened_as_drawn = chords::as_drawn(&projection, &placed, settings).unwrap_or_default();
        clock.lap("bend");
        let on_part = match &tiles {
            None => content::OnPart::Side(map, surface),
            Some(_) => content::OnPart::Round(map),
        };
        let content =
            content::report(&placing.codes, &facts, &placing.whole_motion(), on_part, settings, &mut notices);
        notices.extend(placing.notices.iter().cloned());
        let sensitivity = mapped.sensitivity(surface);
        clock.lap("sensitivity");
        let outline = with_pictures
            .then(|| frame_outline(&projection, ink, settings.correction.tolerance))
            .transpose()
            .map_err(|error| rejected(checks::not_reached(error.at, settings)))?;
        if with_pictures {
            clock.lap("frame");
        }
        if let Some(spacing) = settings.fill.spacing {
            self.check_pace((ink.area() / spacing) as usize, QUICK_WORK)?;
        }
        let turn = placing.direction();
        let filled = fill::add(&placed, turn, &projection, settings, lift, &mut drawing, &mut notices);
        let mut filled = filled.map_err(rejected)?;
        clock.lap("fill");
        drawn.extend(filled.iter_mut().flat_map(|filled| std::mem::take(&mut filled.drawn)));
        let (drawn, stepped) =
            focus::divide(&mut drawing, drawn, &projection, exposure, settings, &mut notices)
                .map_err(rejected)?;
        clock.lap("focus");

        steps.at(Step::Measure);
        let (mut after, mut before) = mapped
            .results(surface)
            .map_err(|at| rejected(checks::off_surface(at, &whole.kept, &ink.extents)))?;
        after.shorten(shortened);
        before.iter_mut().for_each(|before| before.shorten(shortened_as_drawn.iter().copied()));
        clock.lap("measure");

        // Where the part can be unrolled, distances are as true as lines.
        let distances = (tiles.is_none() && map.fit_residual().is_none())
            .then(|| {
                let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
                let height = |at| surface.sampled_height(at);
                distances(&placed, &is_ink, &|at| map.point(at), &height)
            })
            .flatten()
            .filter(|found| found.worst.share().abs() >= LEAST_CHANGE);
        clock.lap("measure distances");

        steps.at(Step::Write);
        let map_report = MapReport::new(map, weights(&settings.correction));
        checks::unrolled(map, &mut notices);
        let round = placing.round(map, settings);
        notices.extend(checks::alignment(round.as_ref(), settings));
        checks::settled(sku, map, settings, &mut notices);
        // Every map follows the lens, so that its errors are no loss by the choice of one.
        let under_lens = || {
            let mut seen = mapped.as_seen(surface)?;
            seen.shorten(shortened_as_drawn.iter().copied());
            Some(seen)
        };
        let untraded = if projection.head.lens == Lens::Telecentric { before } else { under_lens() };
        checks::traded(map, untraded.as_ref(), &after, settings, &mut notices);
        checks::distances(map, distances.as_ref(), lift, settings, &mut notices);
        checks::quality(map, &after, part, lift, &ink.extents, &mut notices);
        checks::uncertain(&after, &part.facts, part.surface.field.step(), &mut notices).map_err(&rejected)?;
        drawing.comments = comments(sku, learned, input, settings);
        let rotary = tiles.as_ref().map(|tiles| tiles.report(&placed, &projection, &drawing, settings));
        notices.extend(tiles.iter().flat_map(|tiles| tiles.notices(part, settings)));
        let files = tiles.as_ref().map(|tiles| tiles.files(&drawing, sku, learned, input, settings));
        let profile = profile(settings);
        let dxf = pattern::write(&drawing, profile);
        notices.extend(pattern::losses(&drawing, profile));
        clock.lap("write");

        let frame = outline.map(|mut drawing| {
            if settings.output.comments {
                drawing.comments = vec![
                    format!("Frame drawing by {}, for {} of SKU {}", program(), input.name, sku),
                    FRAME_USE.into(),
                ];
            }
            FrameDrawing { drawing, profile }
        });
        let changes = input.previous.and_then(|previous| changes(previous, &dxf));
        let preview = with_pictures.then(|| {
            steps.at(Step::Preview);
            let title = format!("{sku} · {} · {}", input.name, map_report.method());
            let distortions = (before.as_ref(), &after);
            let limit = settings.correction.tolerance;
            let shown = preview::Shown {
                part_outline: whole.recent.outline(limit, || preview::relief(&whole.kept.surface, limit)),
                residual_under_ink: exposure.max_difference,
                anchor: placing.place,
                part_size: seen_size(&part.facts, &settings.part),
                heights: [exposure.lowest, exposure.highest],
                tiles: tiles
                    .as_ref()
                    .zip(rotary.as_ref())
                    .map(|(tiles, report)| tiles.picture(report, &drawing)),
            };
            let mut preview =
                preview::preview(title, (&placed, ink), &projection, settings, distortions, shown);
            if let Some(filled) = &filled {
                preview::add_fill(&mut preview, filled, (map, surface), placing.place, &after);
            }
            preview
        });
        if with_pictures {
            clock.lap("prepare preview");
        }
        // Of a part that turns, the drawing is on no plane.
        let as_seen = || mapped.as_seen(surface).filter(|_| tiles.is_none());
        notices.extend(checks::notices_of_part(&part.facts, as_seen, &after).cloned());
        notices.extend(facts.repairs.iter().map(|repair| {
            let on_part = |place: &RepairPlace| {
                let [x, y] = place.at_mm;
                lift.point(map.point(placing.motion.point(FlatPoint::new(x, y))))
            };
            // Places on the sides of a part that turns are not in the picture.
            let shown = repair.places.iter().filter(|_| tiles.is_none());
            repair.notice.clone().at_places(shown.filter_map(on_part))
        }));
        let landmarks = with_pictures.then(|| landmarks::landmarks(lift, map, exposure, &after, settings));
        let is_filled = settings.fill.spacing.is_some();
        notices.extend(
            facts.notices.iter().filter(|notice| !(is_filled && notice.code == "fills-outlined")).cloned(),
        );
        notices.sort_by_key(|notice| std::cmp::Reverse(notice.severity));

        let mut timings = learned.timings.clone();
        timings.append(&mut clock.laps);
        let read = tiles.as_ref().map_or(&placed, |tiles| &tiles.drawn);
        let report = Report {
            schema: report::SCHEMA.into(),
            program: program(),
            sku: sku.to_string(),
            part: PartReport::new(
                learned.kept.origin.clone(),
                learned.kept.facts.clone(),
                &whole.kept.surface,
                learned.key.as_str(),
                learned.from_cache,
                exposure,
            ),
            pattern: PatternReport {
                file: input.name.into(),
                blake3: hash(input.bytes),
                paths: read.paths.len(),
                contours: read.paths.iter().filter(|path| path.is_contour()).count(),
                facts,
                ink_layers: given.pattern.ink_layers.clone(),
            },
            placement: PlacementReport { round, ..placing.report(settings) },
            map: map_report,
            quality: Quality {
                before: before.as_ref().map(DistortionReport::from),
                after: (&after).into(),
                distances: distances.as_ref().map(DistancesReport::from),
            },
            exposure: exposure.into(),
            sensitivity: Some(SensitivityReport::new(sensitivity, &settings.pose_uncertainty)),
            lens_table: settings.optics.lens.measured().map(|lens| lens.residuals().into()),
            fill: filled.as_ref().map(|filled| filled.report.clone()),
            content,
            focus: stepped.as_ref().map(|stepped| stepped.report.clone()),
            output: output_report(&dxf, &drawing, shortening, settings),
            rotary,
            changes,
            notices,
            timings,
        };
        let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
        let marked = with_pictures.then(|| Marked {
            sku: sku.clone(),
            drawing: input.name.to_owned(),
            drawn_range: preview::before_range(before.as_ref(), ink, &projection),
            mark_range: after.stretch_range,
            length: after.length,
            is_round: tiles.is_some(),
            // The lines of the fill are in front of the laser, tile by tile.
            fill: filled.filter(|_| tiles.is_none()).map_or_else(Pattern::default, |filled| filled.shown),
            ink: match tiles {
                Some(tiles) => tiles.drawn.with_layers(|layer| given.pattern.counts_as_ink(layer)),
                None => placed.with_layers(is_ink),
            },
            map: map.clone(),
            fixture: projection.fixture,
            head: projection.head,
            surface: needed.as_ref().map(|part| Arc::new(part.kept.surface.clone())),
            drawn,
        });
        let steps = stepped.map_or_else(Vec::new, |stepped| stepped.steps);
        let tile_files = files.unwrap_or_default();
        Ok(Corrected { dxf, drawing, steps, profile, tile_files, report, preview, marked, landmarks, frame })
    }
}

/// Width and height of the part in the view, mm; `None` in a view that is not along an axis of the part.
fn seen_size(facts: &PartFacts, settings: &PartSettings) -> Option<[f64; 2]> {
    if settings.primitive.is_some() {
        return Some([facts.size[0], facts.size[1]]);
    }
    let view = settings.view();
    let side = |direction: Vector3<f64>| {
        let along = view.part_vector(direction);
        let axis = (0..3).find(|axis| (along[*axis].abs() - 1.0).abs() < 1e-9)?;
        Some(facts.size[axis])
    };
    Some([side(Vector3::x())?, side(Vector3::y())?])
}

/// Name and version of the program.
#[must_use]
pub fn program() -> String {
    format!("isomark {}", env!("CARGO_PKG_VERSION"))
}

/// The start of a hash, by which a person distinguishes files.
fn short_hash(hash: &str) -> &str {
    hash.get(..16).unwrap_or(hash)
}

fn hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

fn weights(settings: &CorrectionSettings) -> WeightsReport {
    WeightsReport {
        weighting: settings.weighting.name().into(),
        aim: settings.aim.name().into(),
        length_weight: settings.length_weight,
        angle_weight: settings.angle_weight,
    }
}

/// The form of the files that the settings ask for.
pub(crate) fn profile(settings: &JobSettings) -> DxfProfile {
    match settings.output.dxf {
        DxfVersion::R2000 => DxfProfile::R2000,
        DxfVersion::R12 => DxfProfile::R12,
        DxfVersion::R12Lines => DxfProfile::R12Lines,
    }
}

fn comments(
    sku: &Sku,
    learned: &LearnedPart,
    input: PatternInput<'_>,
    settings: &JobSettings,
) -> Vec<String> {
    if !settings.output.comments {
        return Vec::new();
    }
    vec![
        format!("{}{CORRECTED_FOR}{sku}", program()),
        format!("pattern {} blake3 {}", input.name, short_hash(&hash(input.bytes))),
        format!("part {} blake3 {}", learned.kept.origin.file, short_hash(&learned.kept.origin.blake3)),
    ]
}

/// Whether the comments of a file state that it is a corrected drawing.
#[cfg(feature = "station")]
pub(crate) fn is_corrected(dxf: &[u8]) -> bool {
    !job_in_comments(dxf).is_empty()
}

/// The SKU and the pattern's name in the comments of a corrected drawing; empty without comments.
fn job_in_comments(dxf: &[u8]) -> Vec<String> {
    let head = String::from_utf8_lossy(&dxf[..dxf.len().min(LENGTH_OF_HEAD)]);
    let job = |line: &str| {
        let sku = line.strip_prefix("isomark ").and_then(|line| Some(line.split_once(CORRECTED_FOR)?.1));
        let pattern = line.strip_prefix("pattern ").and_then(|line| Some(line.rsplit_once(" blake3 ")?.0));
        sku.or(pattern).map(str::to_owned)
    };
    head.lines().filter_map(job).collect()
}

fn output_report(
    dxf: &[u8],
    drawing: &MarkingDrawing,
    shortening: f64,
    settings: &JobSettings,
) -> OutputReport {
    OutputReport {
        blake3: hash(dxf),
        bytes: dxf.len(),
        dxf: settings.output.dxf.name().into(),
        paths: drawing.paths.len(),
        vertices: drawing.paths.iter().map(|path| path.shape.points().len()).sum(),
        extents_mm: report::corners(&drawing.extents()),
        shortening_mm: shortening,
        read_back: false,
    }
}

/// The differences between two corrected drawings; `None` if they are equal, or if the older one cannot be read or belongs,
/// by its comments, to another SKU or pattern. A drawing without comments is compared with any other.
fn changes(previous: &[u8], dxf: &[u8]) -> Option<ChangesReport> {
    let job = job_in_comments(dxf);
    if previous == dxf || !(job.is_empty() || job == job_in_comments(previous)) {
        return None;
    }
    let paths = |bytes: &[u8]| {
        pattern::read(bytes, &PatternOptions::default()).ok().map(|reading| diff::paths_of(&reading.pattern))
    };
    let (old, new) = (paths(previous)?, paths(dxf)?);
    Some((&diff::compare(&old, &new, diff::TOLERANCE)).into())
}

/// Times the stages.
struct Clock {
    last: Instant,
    laps: Vec<Timing>,
}

impl Clock {
    fn start() -> Self {
        Self { last: Instant::now(), laps: Vec::new() }
    }

    fn lap(&mut self, stage: &str) {
        let now = Instant::now();
        let ms = (now - self.last).as_secs_f64() * 1e3;
        self.laps.push(Timing { stage: stage.into(), ms: (ms * 1e3).round() / 1e3 });
        self.last = now;
    }
}

#[cfg(test)]
mod tests;
