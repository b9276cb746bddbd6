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
use std::time::Instant;

use nalgebra::Vector3;

use crate::cache::{Cache, CacheKey, CachedSurface, CurrentPart, Lookup, PartOrigin};
use crate::config::{
    self, Align, Anchor, CorrectionSettings, DxfVersion, IncidenceLimits, JobSettings, PartSettings, Sku,
    Verify, Vertices, ViewSource, Weighting, canonical,
};
use crate::diff;
use crate::formats::Pace;
use crate::formats::mesh::{
    self, Decision, LengthUnit, MeshFormat, MeshOptions, MeshReadError, NormalsFound, PartFacts, PartFile,
    SideFacts, UpAxis,
};
use crate::formats::pattern::{
    self, DxfProfile, PatternFacts, PatternOptions, PatternReadError, PatternReading, RepairPlace,
};
use crate::geometry::correction::{self, Bent, Exposure, Projection, Subdivision};
use crate::geometry::height_field::Uncertainty;
use crate::geometry::ink::Ink;
use crate::geometry::mapping::floater::FloaterWeights;
use crate::geometry::mapping::isometric::IsometricOptions;
use crate::geometry::mapping::quality::{self, Distortion};
use crate::geometry::mapping::{LengthTrueMap, Method};
use crate::geometry::mark_region::MarkRegion;
use crate::geometry::marking::MarkingDrawing;
use crate::geometry::pattern::{Affine, Pattern};
use crate::geometry::picture_mesh::PictureMesh;
use crate::geometry::primitive::{Form, Primitive};
use crate::geometry::sides::Side;
use crate::geometry::space::{FlatPoint, ViewPoint};
use crate::geometry::surface::fit::{FitOptions, FittedSurface};
use crate::preview::Preview;
use crate::reason::{Notice, Reason};
use crate::report::{
    self, ChangesReport, DistortionReport, MapReport, OutputReport, PartReport, PatternReport, WeightsReport,
};
use crate::report::{FrameReport, FrameSource, PlacementReport, Quality, Report, RoundReport, Timing};
use crate::report_html::Landmarks;

mod scan;
mod causes;
mod checks;
mod evaluate;
mod landmarks;
mod preview;
mod on_part;
mod progress;

pub use evaluate::{EVALUATION_SCHEMA, Evaluation, EvaluationRow};
pub use on_part::Marked;
pub use progress::{Progress, Step};
pub use scan::surface_of;

use landmarks::Lift;
use progress::{Observer, Steps};

/// The work for a piece of a line, in squares of inked area.
const WORK_OF_PIECE: usize = 6;
/// The work that a quick job may take, in squares of inked area.
const QUICK_WORK: usize = 200_000;
/// The size of an older drawing that can be compared in a quick job, bytes.
const QUICK_BYTES: usize = 2 << 20;

/// Stands between the program and the SKU in a corrected drawing's first comment.
const CORRECTED_FOR: &str = ", corrected for SKU ";
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
}

/// A corrected drawing with its report.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Corrected {
    /// The DXF file.
    pub dxf: Vec<u8>,
    /// The drawing in the file.
    pub drawing: MarkingDrawing,
    /// The DXF dialect of the file.
    pub profile: DxfProfile,
    /// The report.
    pub report: Report,
    /// The content of the preview, if requested; [`svg`](crate::preview::svg) draws it, which takes longer than all
    /// other stages.
    pub preview: Option<Preview>,
    /// What [`Pipeline::on_part`] needs, if pictures were requested.
    pub marked: Option<Marked>,
    /// What is around the mark, for a report in HTML, if pictures were requested.
    pub landmarks: Option<Landmarks>,
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
}

impl Pipeline {
    /// A pipeline that keeps surfaces in `cache`, or keeps none.
    #[must_use]
    pub fn new(cache: Option<Cache>) -> Self {
        Self { cache, fit: FitOptions::default(), pace: Pace::Any, observer: Observer::default() }
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

    /// Reads, samples and fits a part, or loads its surface from the cache, and makes it the SKU's part.
    ///
    /// # Errors
    /// When the part cannot be read or has no surface to mark, or the cache's folder cannot be used.
    pub fn learn(
        &self,
        sku: &Sku,
        part: &PartFile,
        settings: &PartSettings,
    ) -> Result<LearnedPart, PipelineError> {
        let (origin, clock) = identified(part);
        self.learn_from(sku, part, origin, settings, clock)
    }

    /// Learns again a part that the SKU had before. Stations that share a cache also share the part of each SKU, so
    /// this is rejected if another part has been learned since.
    ///
    /// # Errors
    /// As [`learn`](Self::learn), and if another part has been learned since.
    pub fn restore(
        &self,
        sku: &Sku,
        part: &PartFile,
        settings: &PartSettings,
    ) -> Result<LearnedPart, PipelineError> {
        let (origin, clock) = identified(part);
        if let Some(CurrentPart { origin: current, .. }) =
            self.cache.as_ref().map(|cache| cache.current(sku)).transpose()?.flatten()
            && current.blake3 != origin.blake3
        {
            return Err(checks::superseded(sku, &current.file).into());
        }
        self.learn_from(sku, part, origin, settings, clock)
    }

    fn learn_from(
        &self,
        sku: &Sku,
        part: &PartFile,
        origin: PartOrigin,
        settings: &PartSettings,
        mut clock: Clock,
    ) -> Result<LearnedPart, PipelineError> {
        let rejected = |reason: Reason| PipelineError::from(reason.in_file(&part.name));
        let steps = self.observer.steps(&part.name);
        if let Some(primitive) = &settings.primitive {
            return Err(rejected(checks::part_not_needed(primitive)));
        }
        let format = MeshFormat::from_name(&part.name).ok_or_else(|| unknown_part_format(&part.name))?;
        let current = CurrentPart::new(origin, mesh::has_frame(&part.bytes, format));
        let key = self.key(&current, settings);
        let mut notices = Vec::new();
        if let Some(kept) = self.look_up(sku, &key, &mut notices)? {
            clock.lap("load surface");
            if let Some(cache) = &self.cache {
                cache.make_current(sku, &current)?;
            }
            let kept = CachedSurface { origin: current.origin, ..kept };
            self.complete_mesh(sku, part, format, &key, &kept.facts, settings);
            let settings = settings.for_part_with(kept.facts.marking_frame());
            let timings = clock.laps;
            return Ok(LearnedPart { kept, key, from_cache: true, settings, mesh: None, notices, timings });
        }
        let options = self.mesh_options(settings);
        steps.at(Step::Read);
        let mut reading =
            mesh::read(&part.bytes, format, &options, &part.siblings).map_err(|error| match error {
                MeshReadError::TakesLong => PipelineError::TakesLong,
                error => rejected(error.reason()),
            })?;
        clock.lap("read part");
        steps.at(Step::Fit);
        if let Some(mesh) = reading.shape.mesh() {
            reading.facts.sides = SideFacts::of_all(&Side::all(mesh, IncidenceLimits::default().refuse));
        }
        let surface =
            surface_of(&reading.shape, &mut reading.facts, settings, &self.fit).map_err(rejected)?;
        clock.lap("sample and fit");
        let seen_settings = settings.for_part_with(reading.facts.marking_frame());
        if let (Some(frame), Some(mesh)) = (seen_settings.view_source.frame(), reading.shape.mesh()) {
            checks::frame_direction(frame, mesh).map_err(rejected)?;
        }
        let view = seen_settings.view();
        let mark = (!reading.mark_faces.is_empty())
            .then(|| MarkRegion::seen(&reading.mark_faces, &view, &surface.field));
        let kept = CachedSurface { origin: current.origin.clone(), facts: reading.facts, surface, mark };
        let mesh = reading.shape.mesh().map(|mesh| PictureMesh::of(mesh, PictureMesh::MAX_TRIANGLES));
        if let Some(cache) = &self.cache {
            steps.at(Step::Keep);
            cache.keep(sku, &key, &kept, mesh.as_ref())?;
            cache.make_current(sku, &current)?;
            clock.lap("keep surface");
        }
        let settings = settings.for_part_with(kept.facts.marking_frame());
        Ok(LearnedPart { kept, key, from_cache: false, settings, mesh, notices, timings: clock.laps })
    }

    fn mesh_options(&self, settings: &PartSettings) -> MeshOptions {
        MeshOptions {
            unit: settings.unit,
            up: settings.up,
            normals: settings.normals,
            bridge: settings.bridge,
            pace: self.pace,
        }
    }

    /// Keeps the mesh for pictures of a part whose surface was kept without it, by an older version. Without the mesh,
    /// pictures are less complete, so nothing fails here.
    fn complete_mesh(
        &self,
        sku: &Sku,
        part: &PartFile,
        format: MeshFormat,
        key: &CacheKey,
        facts: &PartFacts,
        settings: &PartSettings,
    ) {
        let Some(cache) = self.cache.as_ref().filter(|cache| !cache.has_picture_mesh(sku, key)) else {
            return;
        };
        // A scan has no triangles.
        if facts.triangles == 0 {
            return;
        }
        let reading = mesh::read(&part.bytes, format, &self.mesh_options(settings), &part.siblings);
        if let Some(mesh) = reading.ok().as_ref().and_then(|reading| reading.shape.mesh())
            && let Err(error) =
                cache.keep_picture_mesh(sku, key, &PictureMesh::of(mesh, PictureMesh::MAX_TRIANGLES))
        {
            tracing::warn!("the mesh of {sku} for pictures cannot be kept: {error}");
        }
    }

    /// The cached surface of a SKU under these settings; `None` if the part must be read (again). A damaged cache
    /// entry is reported in `notices`. If the settings give the part by its sizes, its surface is computed and cached
    /// when needed.
    ///
    /// # Errors
    /// When the cache's folder cannot be used, or a part given by its sizes has no surface to mark.
    pub fn recall(
        &self,
        sku: &Sku,
        settings: &PartSettings,
        notices: &mut Vec<Notice>,
    ) -> Result<Option<LearnedPart>, PipelineError> {
        let mut clock = Clock::start();
        let Some(key) = self.current_key(sku, settings)? else { return Ok(None) };
        let kept = self.look_up(sku, &key, notices)?;
        clock.lap("load surface");
        let from_cache = kept.is_some();
        let kept = match (kept, &settings.primitive) {
            (None, Some(primitive)) => {
                let surface = primitive.surface().map_err(|error| checks::fit_reason(&error, settings))?;
                let kept = CachedSurface {
                    origin: primitive_origin(primitive),
                    facts: primitive_facts(primitive),
                    surface,
                    mark: None,
                };
                clock.lap("sample and fit");
                // The SKU's current part is kept for the case that the sizes are removed from the settings again.
                if let Some(cache) = &self.cache {
                    cache.keep(sku, &key, &kept, None)?;
                    clock.lap("keep surface");
                }
                Some(kept)
            }
            (kept, _) => kept,
        };
        let timings = clock.laps;
        let learned = |kept: CachedSurface| {
            let settings = settings.for_part_with(kept.facts.marking_frame());
            LearnedPart { kept, key, from_cache, settings, mesh: None, notices: Vec::new(), timings }
        };
        Ok(kept.map(learned))
    }

    /// The current part of the SKU, from a file or given by its sizes; `None` for an unknown SKU.
    ///
    /// # Errors
    /// When the cache's folder cannot be used.
    pub fn current_part(
        &self,
        sku: &Sku,
        settings: &PartSettings,
    ) -> Result<Option<CurrentPart>, PipelineError> {
        match (&settings.primitive, &self.cache) {
            (Some(primitive), _) => Ok(Some(CurrentPart::new(primitive_origin(primitive), false))),
            (None, Some(cache)) => Ok(cache.current(sku)?),
            (None, None) => Ok(None),
        }
    }

    /// The cache key of the surface of the SKU's current part under these settings; `None` for an unknown SKU.
    ///
    /// # Errors
    /// When the cache's folder cannot be used.
    pub fn current_key(&self, sku: &Sku, settings: &PartSettings) -> Result<Option<CacheKey>, PipelineError> {
        Ok(self.current_part(sku, settings)?.map(|current| self.key(&current, settings)))
    }

    fn look_up(
        &self,
        sku: &Sku,
        key: &CacheKey,
        notices: &mut Vec<Notice>,
    ) -> io::Result<Option<CachedSurface>> {
        let Some(cache) = &self.cache else { return Ok(None) };
        match cache.get(sku, key)? {
            Lookup::Hit(kept) => Ok(Some(*kept)),
            Lookup::Miss => Ok(None),
            Lookup::Damaged(what) => {
                let text =
                    format!("the cached surface {} of {sku} is damaged and not used: {what}", key.as_str());
                tracing::warn!("{text}");
                notices.push(Notice::warning("cache-damaged", text));
                Ok(None)
            }
        }
    }

    fn key(&self, part: &CurrentPart, settings: &PartSettings) -> CacheKey {
        let text = match part.has_frame {
            true => canonical::surface_of_framed_part(settings, &self.fit),
            false => canonical::surface(settings, &self.fit),
        };
        CacheKey::new(&part.origin.blake3, &text)
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
        let mut clock = Clock::start();
        let part = &learned.kept;
        let mut notices = learned.notices.clone();
        let settings = &framed(settings, part, &mut notices);
        let surface = &part.surface;
        self.check_pace(input.previous.map_or(0, <[u8]>::len), QUICK_BYTES)?;
        let steps = self.observer.steps(input.name);
        let placed_pattern = self.place(input, part, settings, &steps, &mut clock)?;

        steps.at(Step::Map);
        let (placed_pattern, map) = mapped(placed_pattern, part, settings, input.name)?;
        let PlacedPattern { facts, placing, placed, ink } = placed_pattern;
        let rejected = |reason: Reason| checks::doubting_unit(reason, &facts).in_file(input.name);
        clock.lap("map");

        let projection =
            Projection { map: &map, surface, fixture: settings.fixture, head: settings.scan_head() };
        let exposure = projection.expose(&ink);
        checks::ink_layers(&placed, settings, &mut notices);
        let lift = Lift::new(surface, &learned.settings);
        checks::exposure(&exposure, part, lift, &ink, settings, &mut notices).map_err(rejected)?;
        notices.extend(checks::mark_region(&map, part, &ink, settings).map_err(rejected)?);
        clock.lap("check");

        steps.at(Step::Bend);
        let subdivision = match settings.correction.vertices {
            Vertices::Adaptive => Subdivision::Adaptive,
            Vertices::Keep => Subdivision::Keep,
        };
        let Bent { mut drawing, shortening, .. } = projection
            .bend(&placed, settings.correction.tolerance, subdivision)
            .map_err(|error| rejected(checks::above_lens(error.at)))?;
        let marked = placed.paths.iter().zip(&shortening);
        let marked = marked.filter(|(path, _)| {
            placed.layers.get(path.layer).is_some_and(|layer| settings.pattern.counts_as_ink(&layer.name))
        });
        let (mut shortening, mut shortest) = (0.0, 0.0f64);
        for (path, lost) in marked.filter(|(_, lost)| **lost > 0.0) {
            shortening += lost;
            shortest = shortest.max(lost / correction::drawn_length(path.shape.segments()));
        }
        clock.lap("bend");

        steps.at(Step::Measure);
        let measured = |placed_at: &dyn Fn(FlatPoint) -> ViewPoint| measured(&ink, &map, placed_at, surface);
        let mut after = measured(&|at| map.point(at))
            .map_err(|at| rejected(checks::off_surface(at, part, &ink.extents)))?;
        after.length_error += shortening;
        after.max_stretch = after.max_stretch.max(shortest);
        let before = measured(&|at| ViewPoint::from(at.coords())).ok();
        clock.lap("measure");

        steps.at(Step::Write);
        let map_report = MapReport::new(&map, weights(&settings.correction));
        checks::unrolled(&map, &mut notices);
        let round = placing.round(&map, settings);
        notices.extend(checks::alignment(round.as_ref(), settings));
        checks::settled(sku, &map, settings, &mut notices);
        checks::quality(&map, &after, part, lift, &ink.extents, &mut notices);
        checks::uncertain(&after, &part.facts, &mut notices);
        drawing.comments = comments(sku, learned, input, settings);
        let profile = profile(settings);
        let dxf = pattern::write(&drawing, profile);
        notices.extend(pattern::losses(&drawing, profile));
        clock.lap("write");

        let changes = input.previous.and_then(|previous| changes(previous, &dxf));
        let preview = with_pictures.then(|| {
            steps.at(Step::Preview);
            let title = format!("{sku} · {} · {}", input.name, map_report.method());
            let distortions = (before.as_ref(), &after);
            let shown = preview::Shown {
                residual_under_ink: exposure.max_difference,
                anchor: placing.place,
                part_size: seen_size(&part.facts, &settings.part),
            };
            preview::preview(title, (&placed, &ink), &map, surface, settings, distortions, shown)
        });
        if with_pictures {
            clock.lap("prepare preview");
        }
        notices.extend(learned.kept.facts.notices.iter().cloned());
        notices.extend(facts.repairs.iter().map(|repair| {
            let on_part = |place: &RepairPlace| {
                let [x, y] = place.at_mm;
                lift.point(map.point(placing.motion.point(FlatPoint::new(x, y))))
            };
            repair.notice.clone().at_places(repair.places.iter().filter_map(on_part))
        }));
        let landmarks = with_pictures.then(|| landmarks::landmarks(lift, &map, &exposure, &after, settings));
        notices.extend(facts.notices.iter().cloned());
        notices.sort_by_key(|notice| std::cmp::Reverse(notice.severity));

        let mut timings = learned.timings.clone();
        timings.append(&mut clock.laps);
        let report = Report {
            schema: report::SCHEMA.into(),
            program: program(),
            sku: sku.to_string(),
            part: PartReport::new(
                learned.kept.origin.clone(),
                learned.kept.facts.clone(),
                surface,
                learned.key.as_str(),
                learned.from_cache,
                &exposure,
            ),
            pattern: PatternReport {
                file: input.name.into(),
                blake3: hash(input.bytes),
                paths: placed.paths.len(),
                contours: placed.paths.iter().filter(|path| path.is_contour()).count(),
                facts,
                ink_layers: settings.pattern.ink_layers.clone(),
            },
            placement: PlacementReport { round, ..placing.report(settings) },
            map: map_report,
            quality: Quality { before: before.as_ref().map(DistortionReport::from), after: (&after).into() },
            exposure: (&exposure).into(),
            output: output_report(&dxf, &drawing, shortening, settings),
            changes,
            notices,
            timings,
        };
        let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
        let marked = with_pictures.then(|| Marked {
            sku: sku.clone(),
            drawing: input.name.to_owned(),
            drawn_range: preview::before_range(before.as_ref(), &ink, surface),
            mark_range: after.stretch_range,
            length: after.length,
            ink: placed.with_layers(is_ink),
            map,
        });
        Ok(Corrected { dxf, drawing, profile, report, preview, marked, landmarks })
    }
}

/// The errors that a drawing has on the part if `place` projects it, estimated from above.
///
/// Where the part is recognised as a cylinder or cone, its surface is also known between the vertices.
fn measured(
    ink: &Ink,
    map: &LengthTrueMap,
    place: &dyn Fn(FlatPoint) -> ViewPoint,
    surface: &FittedSurface,
) -> Result<Distortion, ViewPoint> {
    let is_recognised = map.fit_residual().is_some_and(|residual| residual <= Method::EXACT_TOLERANCE);
    let doubt = |at| if is_recognised { Uncertainty::NONE } else { surface.uncertainty(at) };
    quality::measure_at_most(ink, place, |at| surface.sampled_height(at), doubt)
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

/// The settings for a part whose file may contain a marking frame, with what a person should know of it.
fn framed(settings: &JobSettings, part: &CachedSurface, notices: &mut Vec<Notice>) -> JobSettings {
    let of_file = part.facts.marking_frame().filter(|_| settings.part.primitive.is_none());
    notices.extend(checks::frame_of_file(of_file.as_ref(), settings));
    let settings = JobSettings { part: settings.part.for_part_with(of_file), ..settings.clone() };
    let frame = settings.part.view_source.frame();
    notices.extend(checks::flat_side(&part.facts, &settings.part));
    notices.extend(frame.and_then(|frame| checks::frame_on_surface(frame, part, &settings.part)));
    settings
}

/// The map of a placed drawing from the file `name`, which is turned along the axis of a cylinder or cone first if the
/// settings ask for that.
///
/// # Errors
/// When there is no map, or the turned drawing has ink where no part can be.
fn mapped(
    pattern: PlacedPattern,
    part: &CachedSurface,
    settings: &JobSettings,
    name: &str,
) -> Result<(PlacedPattern, LengthTrueMap), PipelineError> {
    let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
    let method = method(settings);
    let rejected = |reason: Reason, facts: &PatternFacts| {
        PipelineError::from(checks::doubting_unit(reason, facts).in_file(name))
    };
    let find = |pattern: &PlacedPattern| {
        let place = pattern.placing.place;
        LengthTrueMap::find(&part.surface, &pattern.placed, is_ink, place, &method)
            .map_err(|error| rejected(checks::map_reason(&error, place, part, &pattern.ink), &pattern.facts))
    };
    let map = find(&pattern)?;
    let Some(turn) = map.round_angle().filter(|_| settings.placement.align == Align::Axis) else {
        return Ok((pattern, map));
    };
    let PlacedPattern { facts, mut placing, placed, .. } = pattern;
    placing.turn(turn);
    let placed = placed.transformed(&Affine::rigid(placing.place, turn, placing.place));
    checks::reach(&placed, is_ink, part).map_err(|reason| rejected(reason, &facts))?;
    let ink = Ink::sample(&placed, is_ink, quality::PIECE, quality::SQUARE);
    let pattern = PlacedPattern { facts, placing, placed, ink };
    let map = find(&pattern)?;
    Ok((pattern, map))
}

/// A placed drawing.
struct PlacedPattern {
    facts: PatternFacts,
    placing: Placing,
    placed: Pattern,
    ink: Ink,
}

impl Pipeline {
    fn place(
        &self,
        input: PatternInput<'_>,
        part: &CachedSurface,
        settings: &JobSettings,
        steps: &Steps<'_>,
        clock: &mut Clock,
    ) -> Result<PlacedPattern, PipelineError> {
        steps.at(Step::Read);
        let rejected = |reason: Reason| PipelineError::from(reason.in_file(input.name));
        let options = PatternOptions { pace: self.pace, ..settings.pattern.options() };
        let PatternReading { pattern, facts } =
            pattern::read(input.bytes, &options).map_err(|error| match error {
                PatternReadError::TakesLong => PipelineError::TakesLong,
                error => rejected(error.reason()),
            })?;
        clock.lap("read pattern");
        steps.at(Step::Place);
        let is_ink = |layer: &str| settings.pattern.counts_as_ink(layer);
        let placing = Placing::new(&pattern, settings);
        let placed = pattern.transformed(&placing.motion);
        drop(pattern);
        let length = checks::reach(&placed, is_ink, part)
            .map_err(|reason| rejected(checks::doubting_unit(reason, &facts)))?;
        checks::lost_ink(&facts, settings).map_err(rejected)?;
        self.check_pace((length / quality::PIECE) as usize * WORK_OF_PIECE, QUICK_WORK)?;
        let ink = Ink::sample(&placed, is_ink, quality::PIECE, quality::SQUARE);
        checks::anything_inked(&ink, &placed, settings).map_err(rejected)?;
        let work = ink.pieces.len() * WORK_OF_PIECE + ink.squares.len();
        self.check_pace(work, QUICK_WORK)?;
        clock.lap("place");
        Ok(PlacedPattern { facts, placing, placed, ink })
    }
}

/// The placement of a drawing: its anchor, the anchor's place in the view, and the rigid motion between them.
struct Placing {
    anchor: FlatPoint,
    place: FlatPoint,
    motion: Affine,
    /// The turn along the axis of a cylinder or cone, rad, in addition to that of the settings.
    aligned: f64,
}

impl Placing {
    fn new(pattern: &Pattern, settings: &JobSettings) -> Self {
        let anchor = match settings.placement.anchor {
            Anchor::Center => pattern.extents().center().into(),
            Anchor::Origin => FlatPoint::new(0.0, 0.0),
            Anchor::At(point) => point,
        };
        let place = settings.placement.place.map(|place| place.coords());
        let place = match &settings.part.view_source {
            ViewSource::Station | ViewSource::Sides => place.map_or(anchor, FlatPoint::from),
            source @ (ViewSource::Frame(frame) | ViewSource::FrameOfFile(frame)) => {
                let is_used = settings.placement.is_place_given || matches!(source, ViewSource::Frame(_));
                (frame.place().coords() + place.filter(|_| is_used).unwrap_or_default()).into()
            }
        };
        Self { anchor, place, motion: Affine::rigid(anchor, settings.placement.rotate, place), aligned: 0.0 }
    }

    /// Turns the placed drawing about its anchor by this angle, rad.
    fn turn(&mut self, angle: f64) {
        self.aligned += angle;
    }

    /// The direction of the drawing's x beside that round the axis of the map, if it has one.
    fn round(&self, map: &LengthTrueMap, settings: &JobSettings) -> Option<RoundReport> {
        let round = map.round_angle()?;
        let whole = std::f64::consts::TAU;
        let from_round = settings.placement.rotate + self.aligned - round;
        let from_round = from_round - whole * (from_round / whole).round();
        Some(RoundReport { turned_deg: self.aligned.to_degrees(), angle_deg: from_round.to_degrees() })
    }

    fn report(&self, settings: &JobSettings) -> PlacementReport {
        PlacementReport {
            facing: settings.part.facing.direction().into(),
            roll_deg: settings.part.roll.to_degrees(),
            anchor_mm: self.anchor.coords().into(),
            place_mm: self.place.coords().into(),
            rotate_deg: settings.placement.rotate.to_degrees(),
            round: None,
            frame: match settings.part.view_source {
                ViewSource::Station | ViewSource::Sides => None,
                ViewSource::Frame(frame) => {
                    Some(FrameReport { source: FrameSource::Settings, frame: frame.into() })
                }
                ViewSource::FrameOfFile(frame) => {
                    Some(FrameReport { source: FrameSource::Part, frame: frame.into() })
                }
            },
        }
    }
}

/// Name and version of the program.
#[must_use]
pub fn program() -> String {
    format!("isomark {}", env!("CARGO_PKG_VERSION"))
}

fn hash(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// The origin of a part, and a clock with the time that hashing took. The hash must stay the same in every version:
/// drawings for a part with another hash are outdated.
fn identified(part: &PartFile) -> (PartOrigin, Clock) {
    let mut clock = Clock::start();
    let PartFile { name, bytes, .. } = part;
    let mut hasher = blake3::Hasher::new();
    hasher.update(bytes);
    for sibling in in_order_of_file(part) {
        hasher.update(sibling);
    }
    let blake3 = hasher.finalize().to_hex().to_string();
    clock.lap("hash part");
    (PartOrigin { file: name.clone(), blake3 }, clock)
}

/// The contents of the files beside a part, in the order in which the part names them: the alphabetical order of
/// numbered names, such as `buffer2.bin` and `buffer10.bin`, is different.
fn in_order_of_file(part: &PartFile) -> Vec<&[u8]> {
    let PartFile { name, bytes, siblings } = part;
    let format = MeshFormat::from_name(name).filter(|_| siblings.len() > 1);
    match format.and_then(|format| mesh::named_files(bytes, format).ok()) {
        Some(named) => {
            named.buffers.iter().filter_map(|buffer| siblings.get(&buffer.name)).map(Vec::as_slice).collect()
        }
        None => siblings.values().map(Vec::as_slice).collect(),
    }
}

/// The origin of a part that the settings give by its sizes.
fn primitive_origin(primitive: &Primitive) -> PartOrigin {
    PartOrigin { file: primitive.to_string(), blake3: hash(canonical::primitive(primitive).as_bytes()) }
}

fn primitive_facts(primitive: &Primitive) -> PartFacts {
    let [min, max] = primitive.bounds();
    PartFacts {
        format: None,
        producer: None,
        unit: Decision { value: LengthUnit::Millimetre, why: "the settings give its sizes in mm".into() },
        up: Decision { value: UpAxis::Z, why: "the settings give the part as the laser sees it".into() },
        size: (max - min).into(),
        triangles: 0,
        vertices: 0,
        normals: NormalsFound::Smooth,
        normals_used: None,
        normals_missing: 0,
        noise: None,
        one_sided_at_mm: None,
        frame: None,
        mark_area_mm2: None,
        sides: Vec::new(),
        bodies: Vec::new(),
        materials: Vec::new(),
        skipped: Vec::new(),
        scan: None,
        notices: Vec::new(),
    }
}

/// The reason for a part in a format that is not supported.
pub(crate) fn unknown_part_format(name: &str) -> Reason {
    let export = format!("Export the part or scan as {}", MeshFormat::ENDINGS);
    let (what, remedy) = if mesh::is_unread_part(name) {
        (
            format!("\"{name}\" cannot be read as a part: isomark does not read this format."),
            format!(
                "{export}, with a deviation of at most 0.05 mm, in a program that opens it, such as FreeCAD."
            ),
        )
    } else {
        (format!("\"{name}\" cannot be read as a part."), format!("{export}."))
    };
    Reason::new("part-format-unknown", what, remedy).in_file(name)
}

fn weights(settings: &CorrectionSettings) -> WeightsReport {
    WeightsReport {
        weighting: settings.weighting.name().into(),
        length_weight: settings.length_weight,
        angle_weight: settings.angle_weight,
    }
}

fn method(settings: &JobSettings) -> Method {
    let JobSettings { part, correction, .. } = settings;
    let options = match correction.weighting {
        Weighting::Ink => IsometricOptions::INK.emphasised(correction.length_weight, correction.angle_weight),
        Weighting::Uniform => IsometricOptions::UNIFORM,
    };
    match (correction.method, part.primitive.map(|primitive| (primitive, primitive.form()))) {
        (config::Method::Auto, Some((primitive, _)))
        | (config::Method::Cylinder, Some((primitive, Form::Cylinder(_))))
        | (config::Method::Cone, Some((primitive, Form::Cone(_)))) => Method::Given(primitive),
        (config::Method::Auto, None) => {
            Method::Auto { exact_tolerance: Method::EXACT_TOLERANCE, otherwise: options }
        }
        (config::Method::Isometric, _) => Method::Isometric(options),
        (config::Method::Cylinder, _) => Method::Cylinder,
        (config::Method::Cone, _) => Method::Cone,
        (config::Method::MappingDomain, _) => Method::MappingDomain(correction.mapping_domain),
        (config::Method::Floater, _) => Method::Floater(match correction.floater_weights {
            config::FloaterWeights::Uniform => FloaterWeights::Uniform,
            config::FloaterWeights::MeanValue => FloaterWeights::MeanValue,
        }),
        (config::Method::None, _) => Method::Plain,
    }
}

fn profile(settings: &JobSettings) -> DxfProfile {
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
        format!("pattern {} blake3 {}", input.name, &hash(input.bytes)[..16]),
        format!("part {} blake3 {}", learned.kept.origin.file, &learned.kept.origin.blake3[..16]),
    ]
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
