//! The [`Corrector`] of the hot folder, implemented with the [`Pipeline`].

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use crate::cache::{Cache, CurrentPart, DatedPart};
use crate::config::{JobSettings, PartSettings, Sku, Station};
use crate::formats::Pace;
use crate::formats::list::Products;
use crate::formats::mesh::{self, Buffer, MeshFormat, MeshOptions, MeshReadError, NamedFiles, PartFile};
use crate::formats::pattern::{self, PatternOptions};
use crate::hotfolder::api::{
    Check, Companion, Completeness, Corrector, Delivery, DroppedFile, JobError, PartLearned, PartNow,
    PictureKind, Sketch,
};
use crate::hotfolder::fleet::Fleet;
use crate::pipeline::{
    Corrected, FrameDrawing, LearnedPart, ListJob, Marked, PatternInput, Pipeline, PipelineError, part_hash,
};
use crate::preview::{Backdrop, OnPart, Preview, glb, svg, svg_on};
use crate::reason::{Notice, Reason};
use crate::report::Report;
use crate::report_html::{Landmarks, PageContent, html};

/// Number of surfaces that are kept in memory: successive drops are usually for few products.
const SURFACES: usize = 16;

/// A binary mesh that ends with this many zeros is incomplete: no triangle looks like this, bytes.
const UNWRITTEN: usize = 64;

/// Fits parts and corrects patterns with the [`Pipeline`].
pub struct PipelineCorrector {
    pipeline: Mutex<Pipeline>,
    /// The surfaces of the last jobs, the newest last.
    recent: Mutex<Vec<Recent>>,
    fleet: Option<Arc<dyn Fleet>>,
}

struct Recent {
    sku: Sku,
    settings: PartSettings,
    known: Arc<Known>,
}

/// A surface that is kept in memory.
struct Known {
    learned: LearnedPart,
    /// The drawn part for previews, with the limit above which they show residuals, mm.
    backdrop: OnceLock<(f64, Backdrop)>,
}

impl Known {
    /// Draws the preview of a drawing on the part. Almost all drawings of a SKU show the same residuals.
    fn draw(&self, preview: &Preview) -> String {
        let limit = preview.part_outline.residual_limit;
        let (drawn_with, backdrop) =
            self.backdrop.get_or_init(|| (limit, Backdrop::of(&preview.part_outline)));
        if *drawn_with == limit { svg_on(backdrop, preview) } else { svg(preview) }
    }
}

/// What the pictures of a drawing are drawn from after the delivery.
struct Pictures {
    pipeline: Pipeline,
    known: Arc<Known>,
    preview: Preview,
    marked: Marked,
    landmarks: Landmarks,
    frame: FrameDrawing,
    report: Report,
    /// Whether the second reader has checked the drawing.
    read_back: AtomicBool,
    /// The flat panels: a picture and a part of the page.
    panels: OnceLock<String>,
    /// The mark on the part, and its file.
    on_part: OnceLock<(OnPart, Vec<u8>)>,
}

impl Pictures {
    fn of(corrected: &mut Corrected, pipeline: Pipeline, known: Arc<Known>) -> Option<Self> {
        Some(Self {
            pipeline,
            known,
            preview: corrected.preview.take()?,
            marked: corrected.marked.take()?,
            landmarks: corrected.landmarks.take()?,
            frame: corrected.frame.take()?,
            report: corrected.report.clone(),
            read_back: AtomicBool::new(false),
            panels: OnceLock::new(),
            on_part: OnceLock::new(),
        })
    }

    fn sketches(self: &Arc<Self>) -> impl Iterator<Item = (PictureKind, Sketch)> {
        PictureKind::ALL.into_iter().map(|kind| {
            let pictures = self.clone();
            (kind, Box::new(move || pictures.draw(kind)) as Sketch)
        })
    }

    fn draw(&self, kind: PictureKind) -> Vec<u8> {
        match kind {
            PictureKind::Preview => self.panels().as_bytes().to_vec(),
            PictureKind::OnPart => self.on_part().1.clone(),
            PictureKind::Page => self.page().into_bytes(),
            PictureKind::Frame => self.frame.dxf(),
        }
    }

    fn panels(&self) -> &str {
        self.panels.get_or_init(|| self.known.draw(&self.preview))
    }

    fn on_part(&self) -> &(OnPart, Vec<u8>) {
        self.on_part.get_or_init(|| {
            let on_part = self.pipeline.on_part(&self.known.learned, &self.marked);
            let file = glb(&on_part);
            (on_part, file)
        })
    }

    fn page(&self) -> String {
        let mut report = self.report.clone();
        report.output.read_back |= self.read_back.load(Ordering::Acquire);
        let (on_part, glb) = self.on_part();
        let landmarks = &self.landmarks;
        html(&PageContent { report: &report, panels: self.panels(), on_part, glb, landmarks })
    }
}

impl PipelineCorrector {
    /// A corrector that works with `pipeline`.
    pub fn new(pipeline: Pipeline) -> Self {
        Self { pipeline: Mutex::new(pipeline), recent: Mutex::default(), fleet: None }
    }

    /// The same corrector for a station of a fleet.
    #[must_use]
    pub fn in_fleet(self, fleet: Arc<dyn Fleet>) -> Self {
        Self { fleet: Some(fleet), ..self }
    }

    fn pipeline(&self) -> Pipeline {
        self.pipeline.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn recent(&self) -> MutexGuard<'_, Vec<Recent>> {
        self.recent.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The surface of a SKU, from memory while it is the current one in the cache.
    fn surface(&self, sku: &Sku, settings: &PartSettings) -> Result<Option<Arc<Known>>, PipelineError> {
        let pipeline = self.pipeline();
        let Some(current) = pipeline.current_key(sku, settings)? else { return Ok(None) };
        let is_it = |recent: &&Recent| {
            recent.sku == *sku && recent.settings == *settings && recent.known.learned.key == current
        };
        if let Some(recent) = self.recent().iter().find(is_it) {
            return Ok(Some(recent.known.clone()));
        }
        let recalled = pipeline.recall(sku, settings, &mut Vec::new())?;
        Ok(recalled.map(|learned| self.remember(sku, settings, learned)))
    }

    /// Remembers a learned part, and summarizes it.
    fn learned(
        &self,
        sku: &Sku,
        part: &PartFile,
        settings: &JobSettings,
        learned: LearnedPart,
    ) -> PartLearned {
        let [x, y, z] = learned.kept.facts.size;
        let residual = &learned.kept.surface.residual;
        let surface = match &learned.kept.facts.scan {
            Some(scan) => scan.summary(),
            None => format!("residual at most {:.4} mm on 95 % of the part", residual.p95),
        };
        let summary = format!(
            "{}: {x:.1} x {y:.1} x {z:.1} mm, {surface}{}",
            part.name,
            if learned.from_cache { ", already known" } else { "" }
        );
        self.remember(sku, &settings.part, learned);
        PartLearned { summary, report: None }
    }

    fn remember(&self, sku: &Sku, settings: &PartSettings, learned: LearnedPart) -> Arc<Known> {
        let known = Arc::new(Known { learned, backdrop: OnceLock::new() });
        let mut recent = self.recent();
        recent.retain(|recent| recent.sku != *sku || recent.settings != *settings);
        if recent.len() >= SURFACES {
            recent.remove(0);
        }
        recent.push(Recent { sku: sku.clone(), settings: settings.clone(), known: known.clone() });
        known
    }
}

impl Corrector for PipelineCorrector {
    fn completeness(&self, name: &str, bytes: &[u8]) -> Completeness {
        match MeshFormat::from_name(name) {
            Some(format) => part_completeness(name, format, bytes),
            None => pattern_completeness(name, bytes),
        }
    }

    fn knows(&self, sku: &Sku, settings: &JobSettings) -> bool {
        // If the cache cannot be read, the job itself reports that, and is tried again.
        !matches!(self.surface(sku, &settings.part), Ok(None))
    }

    fn part_identity(&self, sku: &Sku, settings: &JobSettings) -> Result<Option<String>, JobError> {
        let current = self.pipeline().current_part(sku, &settings.part)?;
        Ok(current.map(|part| match part.has_frame && settings.part.leaves_view_to_file() {
            // The same part under settings that use its marking frame is another one: its drawings are elsewhere.
            true if settings.placement.is_place_given => {
                format!("{} placed in its frame", part.origin.blake3)
            }
            true => format!("{} in its frame", part.origin.blake3),
            false => part.origin.blake3,
        }))
    }

    fn part_now(&self, sku: &Sku) -> Result<PartNow, JobError> {
        Ok(match self.pipeline().dated_part(sku)? {
            None => PartNow::Unknown,
            Some(DatedPart { part: CurrentPart { origin, .. }, learned_ms, is_recorded }) => {
                PartNow::Known { file: origin.file, blake3: origin.blake3, learned_ms, is_recorded }
            }
        })
    }

    fn record_part(&self, sku: &Sku) -> Result<(), JobError> {
        Ok(self.pipeline().record_part(sku)?)
    }

    fn part_hash(&self, part: &DroppedFile) -> String {
        part_hash(part)
    }

    fn is_corrected(&self, file: &[u8]) -> bool {
        crate::pipeline::is_corrected(file)
    }

    fn follow(&self, station: &Station) {
        let mut pipeline = self.pipeline.lock().unwrap_or_else(PoisonError::into_inner);
        *pipeline = pipeline.clone().with_cache(Some(Cache::new(&station.folders.cache)));
        if let Some(fleet) = &self.fleet {
            fleet.follow(station);
        }
    }

    fn fleet(&self) -> Option<&dyn Fleet> {
        self.fleet.as_deref()
    }

    fn restore_part(
        &self,
        sku: &Sku,
        part: &DroppedFile,
        settings: &JobSettings,
        since: Option<u64>,
        pace: Pace,
    ) -> Result<PartLearned, JobError> {
        let learned = self.pipeline().at(pace).restore_as_of(sku, part, &settings.part, since)?;
        Ok(self.learned(sku, part, settings, learned))
    }

    fn learn_part(
        &self,
        sku: &Sku,
        part: &DroppedFile,
        settings: &JobSettings,
        pace: Pace,
    ) -> Result<PartLearned, JobError> {
        let learned = self.pipeline().at(pace).learn(sku, part, &settings.part)?;
        Ok(self.learned(sku, part, settings, learned))
    }

    fn products(
        &self,
        sku: &Sku,
        pattern: &DroppedFile,
        (name, list): (&str, &[u8]),
        settings: &JobSettings,
        used: u64,
        most: u64,
    ) -> Result<Products, JobError> {
        let job = ListJob::new(name, sku, &pattern.bytes, settings, used);
        job.products(list, most).map_err(JobError::Rejected)
    }

    fn correct(
        &self,
        sku: &Sku,
        pattern: &DroppedFile,
        previous: Option<&[u8]>,
        settings: &JobSettings,
        pace: Pace,
    ) -> Result<Delivery, JobError> {
        let known = self.surface(sku, &settings.part)?.ok_or_else(|| {
            let what = format!("The surface of {sku} was removed from the cache.");
            JobError::Retry(Reason::new(
                "surface-gone",
                what,
                "Wait: isomark fits the part again from the archive.",
            ))
        })?;
        let input = PatternInput { name: &pattern.name, bytes: &pattern.bytes, previous };
        let mut corrected = self.pipeline().at(pace).correct(sku, &known.learned, input, settings, true)?;
        if !corrected.tile_files.is_empty() {
            let message = "a station delivers one file for each drawing, so the tiles are its layers, although `[rotary] as` is \
                           \"files\"";
            corrected.report.notices.push(Notice::note("rotary-as-layers", message));
        }
        let [left, bottom, right, top] = corrected.report.output.extents_mm;
        let drawing = std::mem::take(&mut corrected.dxf);
        let pictures = Pictures::of(&mut corrected, self.pipeline(), known).map(Arc::new);
        let read = pictures.clone();
        Ok(Delivery {
            drawing,
            report: report(&corrected)?,
            pictures: pictures.iter().flat_map(Pictures::sketches).collect(),
            size: Some([right - left, top - bottom]),
            summary: corrected.report.headline(),
            check: Some(Check {
                vertices: pattern::readback_work(&corrected.drawing, corrected.profile),
                read_back: Box::new(move |file| {
                    corrected.read_back(file).map_err(JobError::Rejected)?;
                    if let Some(pictures) = read {
                        pictures.read_back.store(true, Ordering::Release);
                    }
                    report(&corrected)
                }),
            }),
        })
    }
}

fn report(corrected: &Corrected) -> Result<Vec<u8>, JobError> {
    let text = corrected.report.to_json().map_err(|error| PipelineError::Environment(error.into()))?;
    Ok(text.into_bytes())
}

impl From<PipelineError> for JobError {
    fn from(error: PipelineError) -> Self {
        match error {
            PipelineError::Rejected(reason) => Self::Rejected(reason),
            PipelineError::TakesLong => Self::TakesLong,
            PipelineError::Environment(error) => Self::Retry(Reason::new(
                "cache-unusable",
                format!("The cache cannot be used: {error}."),
                "Check that its folder is writable and its disk is not full.",
            )),
        }
    }
}

fn pattern_completeness(name: &str, bytes: &[u8]) -> Completeness {
    if pattern::is_complete(bytes) {
        return Completeness::Whole { companions: Vec::new() };
    }
    let options = PatternOptions { pace: Pace::Quick, ..PatternOptions::default() };
    match pattern::read(bytes, &options) {
        Err(error) if error.is_cut_short() => Completeness::CutShort(error.reason_for(name)),
        // More bytes do not resolve other errors. An empty file may still be written.
        Err(error) if bytes.is_empty() => Completeness::CutShort(error.reason_for(name)),
        _ => Completeness::Whole { companions: Vec::new() },
    }
}

fn part_completeness(name: &str, format: MeshFormat, bytes: &[u8]) -> Completeness {
    let ends_with_a_line = bytes.last() == Some(&b'\n');
    let cut = |error: &MeshReadError| error.is_cut_short() || bytes.is_empty();
    match format {
        // An OBJ has no end mark except a complete last line; only without one is the file checked further.
        MeshFormat::Obj if ends_with_a_line => {}
        MeshFormat::Obj => {
            let options = MeshOptions { pace: Pace::Quick, ..MeshOptions::default() };
            let reading = mesh::read(bytes, format, &options, &BTreeMap::new());
            if let Some(error) = reading.err().filter(cut) {
                return Completeness::CutShort(error.reason().in_file(name));
            }
        }
        // Some programs reserve the full length of a file before they copy it.
        MeshFormat::Stl | MeshFormat::Ply if bytes.ends_with(&[0; UNWRITTEN]) => {
            let what = "The file ends with zeros only: its copy is incomplete.";
            return Completeness::CutShort(
                Reason::new("mesh-truncated", what, "Copy it again.").in_file(name),
            );
        }
        MeshFormat::Stl | MeshFormat::Ply | MeshFormat::Xyz | MeshFormat::ThreeMf | MeshFormat::Step => {
            if let Some(error) = mesh::is_whole(bytes, format).err().filter(cut) {
                return Completeness::CutShort(error.reason().in_file(name));
            }
        }
        MeshFormat::Gltf | MeshFormat::Glb => match mesh::named_files(bytes, format) {
            Ok(NamedFiles { buffers, textures }) => {
                let buffer = |Buffer { name, bytes }| Companion { name, needed: true, bytes };
                let texture = |name| Companion { name, needed: false, bytes: 0 };
                let (buffers, textures) =
                    (buffers.into_iter().map(buffer), textures.into_iter().map(texture));
                return Completeness::Whole { companions: buffers.chain(textures).collect() };
            }
            Err(error) if cut(&error) => return Completeness::CutShort(error.reason().in_file(name)),
            Err(_) => {}
        },
    }
    Completeness::Whole { companions: material_libraries(format, bytes) }
}

/// The `.mtl` files that an OBJ names: they are not read, but filed with their part.
fn material_libraries(format: MeshFormat, bytes: &[u8]) -> Vec<Companion> {
    if format != MeshFormat::Obj {
        return Vec::new();
    }
    // Exporters name them at the start of the file.
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(4096)]).into_owned();
    let named = head.lines().filter_map(|line| line.trim().strip_prefix("mtllib "));
    named.map(|name| Companion { name: name.trim().to_owned(), needed: false, bytes: 0 }).collect()
}
