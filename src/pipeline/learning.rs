//! Learning a part: its bytes become a fitted surface, which the cache keeps for the drawings of its SKU.

use std::io;

use super::converting::read_or_convert;
use super::recent::RecentDrawings;
use super::scan::surface_of;
use super::{Clock, LearnedPart, Pipeline, PipelineError, Step, checks, hash};
use crate::cache::{CacheKey, CachedSurface, CurrentPart, DatedPart, FitTask, Lookup, PartOrigin};
use crate::config::{IncidenceLimits, PartSettings, Sku, canonical};
use crate::cores::Cores;
use crate::formats::Pace;
use crate::formats::mesh::{
    self, Decision, LengthUnit, MeshFormat, MeshReadError, NormalsFound, PartFacts, PartFile, SideFacts,
    UpAxis,
};
use crate::geometry::mark_region::MarkRegion;
use crate::geometry::picture_mesh::PictureMesh;
use crate::geometry::primitive::Primitive;
use crate::geometry::sides::{ON_SURFACE, Side};
use crate::reason::{Notice, Reason};

/// A part of this size is worth asking another computer to fit it, bytes. The hot folder treats such files as large ones, too.
const HEAVY: usize = 4 << 20;

impl Pipeline {
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
        self.learn_from(sku, part, origin, settings, Newness::New, clock)
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
        self.restore_as_of(sku, part, settings, None)
    }

    /// The same for a part that became the SKU's part at this moment, ms since 1970: it replaces one that became it earlier.
    ///
    /// # Errors
    /// As [`learn`](Self::learn), and if another part has been learned since.
    pub fn restore_as_of(
        &self,
        sku: &Sku,
        part: &PartFile,
        settings: &PartSettings,
        learned_ms: Option<u64>,
    ) -> Result<LearnedPart, PipelineError> {
        let (origin, clock) = identified(part);
        if let Some(DatedPart {
            part: CurrentPart { origin: current, .. },
            learned_ms: since,
            is_recorded,
            ..
        }) = self.dated_part(sku)?
            && current.blake3 != origin.blake3
            && !learned_ms.is_some_and(|learned_ms| learned_ms >= since || !is_recorded)
        {
            return Err(checks::superseded(sku, &current.file).into());
        }
        self.learn_from(sku, part, origin, settings, Newness::Restored { learned_ms }, clock)
    }

    fn learn_from(
        &self,
        sku: &Sku,
        part: &PartFile,
        origin: PartOrigin,
        settings: &PartSettings,
        newness: Newness,
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
        let mut kept = self.look_up_everywhere(sku, &key, &current.origin, &mut notices)?;
        if kept.is_none() && self.is_made_by_others(sku, part, format, &key, &current.origin, settings) {
            kept = self.look_up(sku, &key, &mut notices)?;
        }
        if let Some(kept) = kept {
            clock.lap("load surface");
            self.complete_mesh(sku, part, format, &key, &kept.facts, settings);
            self.check_frame(sku, &key, &kept, settings).map_err(rejected)?;
            // The others may have lost it.
            if let Some(others) = &self.shared.0 {
                others.offer(sku, &key, &current.origin);
            }
            self.make_current(sku, &current, newness)?;
            let kept = CachedSurface { origin: current.origin, ..kept };
            let settings = settings.for_part_with(kept.facts.marking_frame());
            let timings = clock.laps;
            return Ok(LearnedPart {
                kept,
                key,
                from_cache: true,
                settings,
                mesh: None,
                notices,
                timings,
                recent: RecentDrawings::default(),
            });
        }
        let options = settings.mesh_options(self.pace);
        let (reading, surface) = read_or_convert(part, settings, self.pace, |part| {
            steps.at(Step::Read);
            let mut reading =
                mesh::read(&part.bytes, format, &options, &part.siblings).map_err(|error| match error {
                    MeshReadError::TakesLong => PipelineError::TakesLong,
                    error => rejected(error.reason()),
                })?;
            clock.lap("read part");
            steps.at(Step::Fit);
            if let Some(mesh) = reading.shape.mesh() {
                reading.facts.sides =
                    SideFacts::of_all(&Side::all(mesh, IncidenceLimits::default().refuse, &Cores));
            }
            let surface =
                surface_of(&reading.shape, &mut reading.facts, settings, &self.fit).map_err(rejected)?;
            clock.lap("sample and fit");
            Ok((reading, surface))
        })?;
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
            if let Some(others) = &self.shared.0 {
                others.offer(sku, &key, &current.origin);
            }
            self.make_current(sku, &current, newness)?;
            clock.lap("keep surface");
        }
        let settings = settings.for_part_with(kept.facts.marking_frame());
        Ok(LearnedPart {
            kept,
            key,
            from_cache: false,
            settings,
            mesh,
            notices,
            timings: clock.laps,
            recent: RecentDrawings::default(),
        })
    }

    /// Refuses a marking frame that points into the part, on a surface that was kept for another frame or side of the same view.
    fn check_frame(
        &self,
        sku: &Sku,
        key: &CacheKey,
        kept: &CachedSurface,
        settings: &PartSettings,
    ) -> Result<(), Reason> {
        let settings = settings.for_part_with(kept.facts.marking_frame());
        let frame = settings.view_source.frame();
        // The mesh is only read where the frame is under the surface.
        let Some(frame) = frame.filter(|frame| checks::depth_of(frame, kept, &settings) > ON_SURFACE) else {
            return Ok(());
        };
        let mesh = self.cache.as_ref().and_then(|cache| cache.picture_mesh(sku, key)?.to_mesh());
        mesh.map_or(Ok(()), |mesh| checks::frame_direction(frame, &mesh))
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
        let reading = mesh::read(&part.bytes, format, &settings.mesh_options(self.pace), &part.siblings);
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
        let Some(part) = self.current_part(sku, settings)? else { return Ok(None) };
        let key = self.key(&part, settings);
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
            (None, None) => {
                if let (Some(others), Some(cache)) = (&self.shared.0, &self.cache) {
                    others.wish(cache, sku, &key, &part.origin);
                }
                None
            }
            (kept, _) => kept,
        };
        if let Some(kept) = &kept {
            self.check_frame(sku, &key, kept, settings)?;
        }
        let timings = clock.laps;
        let learned = |kept: CachedSurface| {
            let settings = settings.for_part_with(kept.facts.marking_frame());
            LearnedPart {
                kept,
                key,
                from_cache,
                settings,
                mesh: None,
                notices: Vec::new(),
                timings,
                recent: RecentDrawings::default(),
            }
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

    /// The surface from the cache, or from those of other stations.
    fn look_up_everywhere(
        &self,
        sku: &Sku,
        key: &CacheKey,
        part: &PartOrigin,
        notices: &mut Vec<Notice>,
    ) -> io::Result<Option<CachedSurface>> {
        let found = self.look_up(sku, key, notices)?;
        match (&found, &self.shared.0, &self.cache) {
            (None, Some(others), Some(cache)) if others.fetch(cache, sku, key, part) => {
                self.look_up(sku, key, notices)
            }
            _ => Ok(found),
        }
    }

    /// Has others make the surface of a heavy part; returns whether the cache has it now.
    fn is_made_by_others(
        &self,
        sku: &Sku,
        part: &PartFile,
        format: MeshFormat,
        key: &CacheKey,
        origin: &PartOrigin,
        settings: &PartSettings,
    ) -> bool {
        let (Some(others), Some(cache)) = (&self.shared.0, &self.cache) else { return false };
        let bytes =
            part.siblings.values().fold(part.bytes.len(), |bytes, file| bytes.saturating_add(file.len()));
        let is_heavy = bytes >= HEAVY || mesh::is_scan(&part.bytes, format);
        // A quick job that turns out to be heavy comes again at any pace.
        self.pace == Pace::Any
            && is_heavy
            && others.have_made(cache, sku, key, origin, &|| FitTask::to_bytes(part, settings))
    }

    /// The cache key of the surface of a part; `None` for a format that is not read.
    pub(super) fn key_of(
        &self,
        part: &PartFile,
        origin: PartOrigin,
        settings: &PartSettings,
    ) -> Option<CacheKey> {
        let format = MeshFormat::from_name(&part.name)?;
        Some(self.key(&CurrentPart::new(origin, mesh::has_frame(&part.bytes, format)), settings))
    }

    /// The SKU's current part from a file, and when it became it; `None` for an unknown SKU.
    ///
    /// # Errors
    /// When the cache's folder cannot be used.
    pub fn dated_part(&self, sku: &Sku) -> Result<Option<DatedPart>, PipelineError> {
        Ok(self.cache.as_ref().map(|cache| cache.dated_current(sku)).transpose()?.flatten())
    }

    /// Records the moment at which the SKU's current part became it, if only an older version has written it.
    ///
    /// # Errors
    /// When the cache's folder cannot be used.
    pub fn record_part(&self, sku: &Sku) -> Result<(), PipelineError> {
        if let (Some(cache), Some(known)) = (&self.cache, self.dated_part(sku)?)
            && !known.is_recorded
        {
            cache.make_current_as_of(sku, &known.part, known.learned_ms)?;
        }
        Ok(())
    }

    /// Makes a part the SKU's current one, and announces a new one to other stations.
    fn make_current(&self, sku: &Sku, part: &CurrentPart, newness: Newness) -> Result<(), PipelineError> {
        let Some(cache) = &self.cache else { return Ok(()) };
        match (newness, &self.shared.0) {
            (Newness::New, Some(others)) => others.make_current(cache, sku, part)?,
            (Newness::New, None) => cache.make_current(sku, part)?,
            (Newness::Restored { learned_ms }, _) => {
                // Without a moment, the part is the current one already, or nothing is known of any.
                let known = self.dated_part(sku)?.map(|known| known.learned_ms);
                if !cache.make_current_as_of(sku, part, learned_ms.or(known).unwrap_or(0))? {
                    return Err(checks::superseded(sku, "another file").into());
                }
            }
        }
        Ok(())
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
}

/// How a part becomes the current one of its SKU.
#[derive(Debug, Clone, Copy)]
enum Newness {
    /// It is being given to the SKU now.
    New,
    /// The SKU had it since this moment, ms since 1970.
    Restored { learned_ms: Option<u64> },
}

/// The hash of a part's bytes and of its buffers', as [`PartOrigin`] has it.
#[must_use]
pub fn part_hash(part: &PartFile) -> String {
    identified(part).0.blake3
}

/// The origin of a part, and a clock with the time that hashing took. The hash must stay the same in every version:
/// drawings for a part with another hash are outdated.
pub(super) fn identified(part: &PartFile) -> (PartOrigin, Clock) {
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
        scatter: None,
        normals_lean_deg: None,
        one_sided_at_mm: None,
        frame: None,
        mark_area_mm2: None,
        sides: Vec::new(),
        bodies: Vec::new(),
        faces: Vec::new(),
        round_faces: Vec::new(),
        materials: Vec::new(),
        skipped: Vec::new(),
        scan: None,
        notices: Vec::new(),
    }
}

/// The reason for a part in a format that is not supported.
pub(crate) fn unknown_part_format(name: &str) -> Reason {
    let export = format!("Export the part or scan as {}", MeshFormat::ENDINGS);
    let (what, remedy) = if let Some(format) = mesh::unread_scan(name) {
        (
            format!("\"{name}\" cannot be read as a scan: isomark does not read this format ({format})."),
            "Export the points as .ply, .xyz, .csv, .txt, .asc or .pts in the scanner's program, or in CloudCompare.".to_owned(),
        )
    } else if mesh::is_unread_part(name) {
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
