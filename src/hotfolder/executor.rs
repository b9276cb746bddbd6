//! One job, from a drop that is ready to its outcome, in a thread of its own.
//!
//! ```text
//! read ─▶ correct ─▶ journal: delivering ─▶ rename into import/ ─▶ journal: delivered
//!                                                                      │
//!              journal: done ◀─ move original to archive/ ◀─ journal: filing ◀─ report, preview
//! ```
//!
//! Whatever ends the program between two steps, the drop and the journal together say how far it came, and the next
//! start goes on from there.

use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::beamserver;
use super::delivery::{self, How};
use super::filing::{self, Original, with_slashes};
use super::folders;
use super::intake::{self, Intake, Read};
use super::job::{Corrector, Delivery, DroppedFile, JobError, PartLearned};
use super::journal::{Delivered, Import, Job, Journal};
use super::names::{Meaning, delivered_as, meaning};
use super::reprocess::ARCHIVE;
use super::settle::{Gap, Stamp};
use super::shares::Shares;
use crate::config::{DeliveryKind, FolderPaths, JobSettings, Repeat, Sku, Station, fold};
use crate::files::{read_if_there, sync_folder};
use crate::formats::mesh::MeshFormat;
use crate::reason::{Reason, on_one_line};

/// The code of the reason why patterns wait for a good part.
pub(super) const PART_REFUSED: &str = "part-rejected";

/// What the threads of a station share.
pub(super) struct Executor<'a, C> {
    pub(super) corrector: &'a C,
    pub(super) journal: Mutex<Journal>,
    /// SKUs for which a part came while a drawing of them was being corrected.
    overtaken: Mutex<BTreeSet<Sku>>,
    /// Archived parts that cannot be fitted with these settings.
    unfit_archive: Mutex<BTreeMap<Sku, (PathBuf, JobSettings)>>,
    beamserver: beamserver::Turns,
    pub(super) shares: Shares,
    /// The name of the surface that each SKU was last seen to have under these settings.
    shapes: Mutex<BTreeMap<Sku, (JobSettings, String)>>,
}

/// One job, with all it needs to know.
pub(super) struct Task {
    /// Where the drop lies.
    pub(super) path: PathBuf,
    /// Its path in the hot folder; for an archived original its place in the archive.
    pub(super) relative: PathBuf,
    pub(super) work: Work,
    /// The station as it was when the job began.
    pub(super) station: Station,
    /// The SKU's settings.
    pub(super) settings: JobSettings,
    /// The file as it was seen last.
    pub(super) stamp: Stamp,
    /// What is incomplete now stays so.
    pub(super) last_chance: bool,
    /// Why it can only be rejected.
    pub(super) doomed: Option<Reason>,
    /// Other drops that may still be written.
    pub(super) settling: BTreeSet<PathBuf>,
    /// The drawing waited for the import folder before, so there is no need to work it through again until it is there.
    pub(super) waits_for_import: bool,
    /// What was delivered while report or original could not be filed.
    pub(super) kept: Option<Kept>,
    /// The settings that were seen beside the drop.
    pub(super) sidecar: Option<PathBuf>,
}

impl Task {
    /// The place of the settings beside a pattern: as they were seen, or where they belong.
    fn place_of_sidecar(&self) -> Option<PathBuf> {
        let there = intake::sidecar_of(&self.path).filter(|path| matches!(folders::look(path), Ok(Some(_))));
        match self.work {
            Work::Correct { .. } => there.or_else(|| self.sidecar.clone()),
            Work::CorrectAgain { .. } => there,
            Work::Learn(_) | Work::Nothing => None,
        }
    }
}

/// What is to be done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Work {
    /// Fit a part.
    Learn(Sku),
    /// Correct the pattern of this name and deliver it.
    Correct { sku: Sku, name: String },
    /// Correct an archived pattern again.
    CorrectAgain { sku: Sku, name: String },
    /// Reject what is nothing.
    Nothing,
}

/// A delivered drawing whose report or original could not be filed yet.
pub(super) struct Kept {
    pub(super) stamp: Stamp,
    job: Job,
    delivery: Delivery,
    /// The preview as SVG.
    preview: Option<Vec<u8>>,
    import: Import,
    /// Whether BeamServer was asked for it, too.
    asked: bool,
}

/// The end of a job.
pub(super) struct End {
    pub(super) outcome: Outcome,
    /// Files beside the drop that, if it is done, went with it.
    pub(super) went_along: Vec<PathBuf>,
}

/// What became of a job.
pub(super) enum Outcome {
    /// A part is known; companions that it names and that were not there may follow to the place.
    Learned { absent: Vec<PathBuf>, place: PathBuf },
    /// A drawing was delivered, or lies in the import folder already.
    Delivered,
    /// A drawing was not delivered again.
    Repeated,
    /// The drop lies in the rejected folder.
    Rejected(Reason),
    /// The file changed or went: look again.
    Changed,
    /// It lacks something; `anew` when that is on its way.
    Incomplete { gap: Gap, reason: Reason, anew: bool },
    /// There is no surface for the SKU.
    NoSurface(Reason),
    /// A part of the SKU came before the drawing was delivered.
    PartCame,
    /// The newest part of the SKU was rejected, and its older shape is not used.
    PartRefused(Reason),
    /// Something around the job fails.
    Retry(Reason, Option<Box<Kept>>),
    /// Nothing can be done any more.
    Stop(Reason),
}

/// How a job ended before its end.
pub(super) enum Broken {
    Error(JobError),
    Outcome(Outcome),
}

impl From<JobError> for Broken {
    fn from(error: JobError) -> Self {
        Self::Error(error)
    }
}

/// A drawing on its way to its place.
struct Ready<'a> {
    task: &'a Task,
    sku: &'a Sku,
    /// The pattern's name, after which report and original are named.
    pattern: &'a str,
    /// The name of the result in the import folder.
    name: &'a str,
    read: &'a Read,
}

impl<'a, C: Corrector> Executor<'a, C> {
    pub(super) fn new(corrector: &'a C, journal: Journal, shares: Shares) -> Self {
        Self {
            corrector,
            journal: Mutex::new(journal),
            overtaken: Mutex::default(),
            unfit_archive: Mutex::default(),
            beamserver: beamserver::Turns::default(),
            shares,
            shapes: Mutex::default(),
        }
    }

    pub(super) fn journal(&self) -> MutexGuard<'_, Journal> {
        self.journal.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn overtaken(&self) -> MutexGuard<'_, BTreeSet<Sku>> {
        self.overtaken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn shapes(&self) -> MutexGuard<'_, BTreeMap<Sku, (JobSettings, String)>> {
        self.shapes.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes the SKU's surface, if it was not noted for these settings or is `new`.
    fn note_shape(&self, sku: &Sku, settings: &JobSettings, new: bool) {
        let is_noted = self.shapes().get(sku).is_some_and(|(noted, _)| noted == settings);
        if (new || !is_noted)
            && let Ok(Some(name)) = guarded(|| self.corrector.surface_name(sku, settings))
        {
            self.shapes().insert(sku.clone(), (settings.clone(), name));
        }
    }

    /// The SKUs that nobody is at and whose shape is another one than was last seen here: another station that shares the
    /// surfaces learned a part.
    pub(super) fn learned_elsewhere(&self, is_busy: impl Fn(&Sku) -> bool) -> Vec<Sku> {
        let mut changed = Vec::new();
        for (sku, (settings, last)) in self.shapes().iter_mut().filter(|(sku, _)| !is_busy(sku)) {
            if let Ok(Some(now)) = guarded(|| self.corrector.surface_name(sku, settings))
                && now != *last
            {
                *last = now;
                changed.push(sku.clone());
            }
        }
        changed
    }

    /// A part of the SKU lies in the hot folder: what is not delivered yet waits for it.
    pub(super) fn part_came(&self, sku: &Sku) {
        self.overtaken().insert(sku.clone());
    }

    /// A drawing of the SKU begins, with no part of it in the hot folder.
    pub(super) fn begins(&self, sku: &Sku) {
        self.overtaken().remove(sku);
    }

    /// Does one job.
    pub(super) fn perform(&self, mut task: Task) -> End {
        let kept = task.kept.take();
        let mut read = None;
        if let Err(JobError::Retry(reason)) = self.shares.are_there(&task.station.folders) {
            return End { outcome: Outcome::Retry(reason, kept.map(Box::new)), went_along: Vec::new() };
        }
        let doomed = task.doomed.take();
        let attempt = match &task.work {
            _ if doomed.is_some() => {
                doomed.map_or(Ok(Outcome::Changed), |reason| Err(JobError::Rejected(reason).into()))
            }
            Work::Nothing => Ok(Outcome::Changed),
            Work::Learn(sku) => self.learn(&task, sku, &mut read),
            Work::Correct { sku, name } | Work::CorrectAgain { sku, name } => {
                self.correct(&task, sku, name, kept, &mut read)
            }
        };
        let outcome = match attempt {
            Ok(outcome) | Err(Broken::Outcome(outcome)) => outcome,
            Err(Broken::Error(JobError::Stop(reason))) => Outcome::Stop(reason),
            Err(Broken::Error(JobError::Retry(reason))) => Outcome::Retry(reason, None),
            Err(Broken::Error(JobError::Rejected(reason))) => {
                self.reject(&task, read.as_ref(), reason).unwrap_or_else(|error| match error {
                    JobError::Retry(trouble) | JobError::Rejected(trouble) => Outcome::Retry(trouble, None),
                    JobError::Stop(reason) => Outcome::Stop(reason),
                })
            }
        };
        End { outcome, went_along: read.map(|read| read.companions).unwrap_or_default() }
    }

    fn learn(&self, task: &Task, sku: &Sku, slot: &mut Option<Read>) -> Result<Outcome, Broken> {
        let started = Instant::now();
        let read = &*slot.insert(self.read(task, None)?);
        let learned = guarded(|| self.corrector.learn_part(sku, &read.file, &task.settings))?;
        let PartLearned { summary, report } = learned;
        let (folders, name) = (&task.station.folders, &read.file.name);
        if let Some(report) = &report {
            filing::write_report(folders, sku, name, "report.json", report).map_err(folder_trouble)?;
        }
        let archived = self.archive(task, sku, name, read, None)?;
        // Should it fail, the job stays open, and the next listing closes it: the note must not name an older part.
        filing::set_current_part(folders, sku, &archived).map_err(folder_trouble)?;
        self.note_shape(sku, &task.settings, true);
        let original = filing::in_archive(folders, sku, &archived);
        tell_trouble(self.journal().learned(&with_slashes(&task.relative), sku.as_str(), &original));
        self.unfit_archive.lock().unwrap_or_else(PoisonError::into_inner).remove(sku);
        let took = started.elapsed().as_millis();
        tracing::info!("{name} is now the shape of {sku}, in {took} ms: {summary}");
        let place = archived.parent().unwrap_or(&archived).to_path_buf();
        Ok(Outcome::Learned { absent: read.absent.clone(), place })
    }

    fn correct(
        &self,
        task: &Task,
        sku: &Sku,
        pattern: &str,
        kept: Option<Kept>,
        slot: &mut Option<Read>,
    ) -> Result<Outcome, Broken> {
        let started = Instant::now();
        let drop = with_slashes(&task.relative);
        let name = delivered_as(pattern);
        // The first spelling stays: where files are told apart by it, another one would be a second drawing.
        let name = &*self.journal().result(&name).map_or(name, |last| last.job.name.clone());
        let is_of_use = |kept: &Kept| {
            kept.stamp == task.stamp && (kept.asked || !is_missing_for_server(&task.station, name))
        };
        if let Some(kept) = kept.filter(is_of_use) {
            let read = &*slot.insert(self.read(task, Some(pattern))?);
            return self.finish(&Ready { task, sku, pattern, name, read }, kept);
        }
        // The shape that settings give by its sizes is never that of a file.
        let is_from_file = task.settings.part.figure.is_none();
        if let Some(reason) = self.refused(&task.station.folders, sku).filter(|_| is_from_file) {
            return Ok(Outcome::PartRefused(reason));
        }
        if !self.has_surface(&task.station.folders, sku, &task.settings)? {
            let what = format!("The pattern waits for a part: no surface of {sku} is known.");
            let remedy = format!("Drop the part as {sku}{}.", MeshFormat::ENDINGS);
            return Ok(Outcome::NoSurface(Reason::new("waits-for-part", what, remedy)));
        }
        self.note_shape(sku, &task.settings, false);
        let read = &*slot.insert(self.read(task, Some(pattern))?);
        let ready = Ready { task, sku, pattern, name, read };
        let last = self.journal().result(name).cloned();
        if read.sidecar.is_none()
            && let Some(settings) =
                last.as_ref().and_then(|last| sidecar_of_last(&task.station.folders, sku, last))
        {
            tracing::warn!(
                "{drop} comes without the settings that its last version had: if they still hold, drop it again with {}",
                settings.display()
            );
        }
        let settings = match &read.sidecar {
            Some((path, text)) => {
                task.settings.with_sidecar(path, text).map_err(|error| JobError::Rejected(error.reason()))?
            }
            None => task.settings.clone(),
        };
        let mut job = self.job(&ready, drop, &settings)?;
        if matches!(task.work, Work::CorrectAgain { .. })
            && last.as_ref().is_some_and(|last| last.job.pattern != job.pattern)
        {
            let what = "The original in the archive is another one than was delivered.";
            let remedy = "Drop the drawing that is to be marked.";
            return Err(JobError::Rejected(Reason::new("archive-changed", what, remedy)).into());
        }
        let folders = &task.station.folders;
        let begun = self.was_delivered(task, &job.drop)?;
        let was_begun = begun.filter(|(begun, _)| begun.pattern == job.pattern);
        let same_again = last.as_ref().filter(|last| last.job.key == job.key);
        if let Some((begun, import)) = &was_begun
            && begun.key != job.key
        {
            tracing::warn!(
                "{name} was delivered before the station was interrupted, and part or settings changed since: \
                 it has no report of its own"
            );
            let kept = Kept {
                stamp: task.stamp,
                job: begun.clone(),
                delivery: Delivery::default(),
                preview: None,
                import: *import,
                asked: false,
            };
            return self.finish(&ready, kept);
        }
        if let Some(last) = same_again
            && was_begun.is_none()
            && task.station.delivery.repeat == Repeat::Never
            && !matches!(task.work, Work::CorrectAgain { .. })
            && (task.station.delivery.kind == DeliveryKind::Folder || last.import == Import::Done)
        {
            tracing::info!("{name} was already delivered at {} and is not delivered again", last.at);
            job.result.clone_from(&last.job.result);
            self.file_original(&ready, &job, last.import)?;
            return Ok(Outcome::Repeated);
        }
        // Many drawings may wait for long: each is worked through once, to tell early what is wrong with it.
        if task.waits_for_import {
            delivery::import_is_there(folders)?;
        }
        if task.station.delivery.kind == DeliveryKind::Beamserver {
            beamserver::sendable(&task.station.delivery.path_for_server(&folders.import, name))?;
        }
        let previous = filing::delivered_before(folders, name).map_err(folder_trouble)?;
        let mut made = guarded(|| self.corrector.correct(sku, &read.file, previous.as_deref(), &settings))?;
        job.result = delivery::hash_of(&made.drawing);
        delivery::import_is_there(folders)?;
        self.shares.are_there(folders)?;
        // Files that are dropped together come one after the other, the drawing first perhaps.
        if was_begun.is_none() && self.overtaken().contains(sku) {
            return Ok(Outcome::PartCame);
        }
        let how = match &was_begun {
            Some(_) => How::BeforeTheCrash,
            None => delivery::deliver(
                || self.journal(),
                &task.station,
                &job,
                task.stamp,
                &made.drawing,
                previous.as_deref(),
            )?,
        };
        let took = started.elapsed().as_millis();
        let summary = &made.summary;
        tracing::info!(
            "{name} {} in {took} ms: {summary}",
            words(how, last.as_ref().map(|last| (last.at.as_str(), last.job.key == job.key)))
        );
        if let Some(last) = &last
            && last.job.key != job.key
            && !is_same_drop(&last.job.drop, &job.drop)
        {
            tracing::warn!(
                "{} and {} claim one result: {name} is now made of {}. Give the drawings different names.",
                last.job.drop,
                job.drop,
                job.drop
            );
        }
        let is_ours =
            |bytes: &[u8]| last.as_ref().is_some_and(|last| last.job.result == delivery::hash_of(bytes));
        if how == How::Replaced && !previous.as_deref().is_some_and(is_ours) {
            tracing::warn!(
                "the {name} that was replaced in import was another one than this station had put there"
            );
        }
        made.drawing = Vec::new();
        let import = match (was_begun, same_again) {
            (Some((_, import)), _) => import,
            (None, Some(last)) if how == How::Unchanged => last.import,
            _ if task.station.delivery.kind == DeliveryKind::Folder => Import::ByFolder,
            _ => Import::Due,
        };
        let preview = made.preview.take().and_then(|draw| {
            let trouble =
                |(JobError::Rejected(reason) | JobError::Retry(reason) | JobError::Stop(reason))| {
                    tracing::warn!("{name} has no preview: {}", reason.what);
                };
            guarded(|| Ok(draw())).map_err(trouble).ok()
        });
        self.finish(&ready, Kept { stamp: task.stamp, job, delivery: made, preview, import, asked: false })
    }

    /// What follows a delivery: the marking software, the report, the preview, and the original out of the hot folder.
    fn finish(&self, ready: &Ready, mut kept: Kept) -> Result<Outcome, Broken> {
        match self.finish_steps(ready, &mut kept) {
            Ok(()) => Ok(Outcome::Delivered),
            Err(JobError::Retry(reason)) => Ok(Outcome::Retry(reason, Some(Box::new(kept)))),
            Err(error) => Err(error.into()),
        }
    }

    fn finish_steps(&self, ready: &Ready, kept: &mut Kept) -> Result<(), JobError> {
        let Task { station, .. } = ready.task;
        if station.delivery.kind == DeliveryKind::Beamserver && !kept.asked {
            let imported = self.import(station, ready.name, kept);
            if matches!(imported, Err(JobError::Rejected(_))) {
                delivery::take_back(&station.folders, &mut self.journal(), &kept.job)?;
            }
            let story = imported?;
            delivery::forget_previous(&station.folders, ready.name);
            tracing::info!("{} {story}", ready.name);
            (kept.import, kept.asked) = (Import::Done, true);
        }
        let (folders, sku, name) = (&station.folders, ready.sku, ready.pattern);
        if !kept.delivery.report.is_empty() {
            let report = &kept.delivery.report;
            filing::write_report(folders, sku, name, "report.json", report).map_err(folder_trouble)?;
        }
        if let Some(preview) = &kept.preview {
            filing::write_report(folders, sku, name, "preview.svg", preview).map_err(folder_trouble)?;
        }
        self.file_original(ready, &kept.job, kept.import)
    }

    /// Sees to it that BeamConstruct holds the drawing.
    fn import(&self, station: &Station, name: &str, kept: &Kept) -> Result<String, JobError> {
        let import = &station.folders.import;
        let for_server = |name: &str| beamserver::sendable(&station.delivery.path_for_server(import, name));
        let trial_name = delivery::trial_name(&self.journal());
        let trial = import.join(&trial_name);
        let drawing = beamserver::Drawing {
            name,
            path: for_server(name)?,
            size: kept.delivery.size,
            trial: (&trial_name, for_server(&trial_name)?),
            is_known: kept.import == Import::Done,
        };
        let lay_out = || fs_err::copy(import.join(name), &trial).map(drop).map_err(folder_trouble);
        self.beamserver.talk(|| {
            let imported = beamserver::import(&station.delivery, &drawing, lay_out);
            delivery::remove_quietly(&trial);
            imported
        })
    }

    /// Moves the original to the archive and notes that all is done.
    fn file_original(&self, ready: &Ready, job: &Job, import: Import) -> Result<(), JobError> {
        let folders = &ready.task.station.folders;
        let original = match ready.task.work {
            Work::CorrectAgain { .. } => filing::in_archive(folders, ready.sku, &ready.task.path),
            _ => {
                let archived = self.archive(ready.task, ready.sku, ready.pattern, ready.read, Some(job))?;
                filing::in_archive(folders, ready.sku, &archived)
            }
        };
        tell_trouble(self.journal().done(job, &original, import));
        Ok(())
    }

    /// Moves an original to the archive; `job` is the drawing that was made of it.
    fn archive(
        &self,
        task: &Task,
        sku: &Sku,
        name: &str,
        read: &Read,
        job: Option<&Job>,
    ) -> Result<PathBuf, JobError> {
        let (folders, drop) = (&task.station.folders, with_slashes(&task.relative));
        let original = read.original(&task.path);
        let begun = self.journal().begun(&drop, task.stamp).and_then(|open| open.to.clone());
        let copied = begun.map(|to| folders.archive.join(sku.key()).join(to));
        if let Some(copy) = copied.filter(|copy| folders::has_content(copy, &read.file.bytes)) {
            // The archive is on another disk, and the original was copied when the station was interrupted.
            filing::remove_copied(folders, &original, &copy).map_err(folder_trouble)?;
            return Ok(copy);
        }
        let place = filing::archive_place(folders, sku, name, &original).map_err(folder_trouble)?;
        let to = filing::in_archive(folders, sku, &place);
        self.journal().filing(&drop, sku.as_str(), read.stamp, &to, job).map_err(folder_trouble)?;
        filing::put_away(folders, &original, &place).map_err(folder_trouble)?;
        // Done and back in the hot folder after a power cut, the original would be another drop.
        sync_folder(place.parent().unwrap_or(&place)).map_err(folder_trouble)?;
        Ok(place)
    }

    /// The job on this drop if its drawing lay in the import folder before the station was interrupted, and whether
    /// BeamConstruct holds it.
    fn was_delivered(&self, task: &Task, drop: &str) -> Result<Option<(Job, Import)>, JobError> {
        let mut journal = self.journal();
        let Some(open) = journal.begun(drop, task.stamp).cloned() else { return Ok(None) };
        let Some(job) = open.job.clone() else { return Ok(None) };
        if !open.delivered {
            delivery::settle(&task.station.folders, &mut journal, drop, &open, &job)?;
        }
        // Nobody takes drawings away from BeamServer's folder as an importer does: it is to be made anew.
        if open.to.is_none() && is_missing_for_server(&task.station, &job.name) {
            journal.cancelled(drop).map_err(folder_trouble)?;
        }
        let import = delivery::imported(&task.station, &open);
        Ok(journal.begun(drop, task.stamp).is_some_and(|open| open.delivered).then_some((job, import)))
    }

    /// All that the result depends on.
    fn job(&self, ready: &Ready, drop: String, settings: &JobSettings) -> Result<Job, JobError> {
        let basis = self.basis(ready.sku, settings)?;
        let pattern = blake3::hash(&ready.read.file.bytes).to_hex().to_string();
        let all =
            format!("{}\n{}\n{pattern}\n{basis}\n{}", env!("CARGO_PKG_VERSION"), ready.name, ready.sku.key());
        Ok(Job {
            drop,
            sku: ready.sku.as_str().into(),
            name: ready.name.into(),
            key: blake3::hash(all.as_bytes()).to_hex()[..32].to_owned(),
            basis,
            pattern,
            result: String::new(),
        })
    }

    /// Name of the SKU's surface and settings together: what may change under a delivered drawing.
    pub(super) fn basis(&self, sku: &Sku, settings: &JobSettings) -> Result<String, JobError> {
        let surface = guarded(|| self.corrector.surface_name(sku, settings))?.unwrap_or_default();
        let all = format!("{surface}\n{settings:?}");
        Ok(blake3::hash(all.as_bytes()).to_hex()[..32].to_owned())
    }

    /// Why the older shape of the SKU is not used: its newest part was rejected and still lies in the rejected folder.
    fn refused(&self, folders: &FolderPaths, sku: &Sku) -> Option<Reason> {
        let journal = self.journal();
        let refused = journal.refused(sku)?;
        let lies = folders.rejected.join(&refused.to);
        if !matches!(folders::look(&lies), Ok(Some(_))) {
            return None;
        }
        let what =
            format!("The new part {} of {sku} was rejected; its older shape is not used.", refused.drop);
        let remedy = format!(
            "Drop a good part of {sku}; or remove {}, to go on with the older shape.",
            lies.display()
        );
        Some(Reason::new(PART_REFUSED, what, remedy))
    }

    /// Whether there is a surface for the SKU; one that got lost is fitted again from the archived part.
    fn has_surface(
        &self,
        folders: &FolderPaths,
        sku: &Sku,
        settings: &JobSettings,
    ) -> Result<bool, JobError> {
        if guarded(|| Ok(self.corrector.knows(sku, settings)))? {
            return Ok(true);
        }
        let Some(part) = filing::current_part(folders, sku) else { return Ok(false) };
        let attempt = (part, settings.clone());
        let unfit = || self.unfit_archive.lock().unwrap_or_else(PoisonError::into_inner);
        if unfit().get(sku) == Some(&attempt) {
            return Ok(false);
        }
        let path = attempt.0.clone();
        let Some((bytes, _)) = folders::read_whole(&path).map_err(folder_trouble)? else { return Ok(false) };
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let file = DroppedFile { name, path, bytes };
        match guarded(|| self.corrector.restore_part(sku, &file, settings)) {
            Ok(learned) => {
                tracing::info!("the surface of {sku} is restored from the archive: {}", learned.summary);
                Ok(true)
            }
            Err(JobError::Rejected(reason)) => {
                tracing::warn!(
                    "the surface of {sku} cannot be restored from the archive: {}",
                    reason.on_one_line()
                );
                unfit().insert(sku.clone(), attempt);
                Ok(false)
            }
            Err(other) => Err(other),
        }
    }

    fn read(&self, task: &Task, name: Option<&str>) -> Result<Read, Broken> {
        let own_name = task.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let intake = Intake {
            path: &task.path,
            own_name: &own_name,
            name: name.unwrap_or(&own_name),
            stamp: task.stamp,
            last_chance: task.last_chance,
            settling: &task.settling,
            sidecar: task.place_of_sidecar(),
        };
        intake::read(&intake, |name, bytes| guarded(|| Ok(self.corrector.completeness(name, bytes))))
    }

    fn reject(&self, task: &Task, read: Option<&Read>, reason: Reason) -> Result<Outcome, JobError> {
        let drop = with_slashes(&task.relative);
        let mut reason = reason.in_file(drop.clone());
        if matches!(task.work, Work::CorrectAgain { .. }) {
            let name = drop.rsplit('/').next().unwrap_or(&drop);
            tracing::warn!(
                "{name} cannot be corrected again, and what was delivered stays in force, outdated: {}",
                reason.on_one_line()
            );
            return Ok(Outcome::Rejected(reason));
        }
        if read.is_none() && matches!(folders::look(&task.path), Ok(None)) {
            return Ok(Outcome::Changed);
        }
        let sidecars: Vec<PathBuf> =
            task.place_of_sidecar().into_iter().filter(|path| folders::is_file(path)).collect();
        let bare = Original { path: &task.path, content: None, companions: &sidecars };
        let original = read.map_or(bare, |read| read.original(&task.path));
        let folders = &task.station.folders;
        let part_of = match &task.work {
            Work::Learn(sku) => guarded(|| Ok(self.corrector.knows(sku, &task.settings)))?.then_some(sku),
            _ => None,
        };
        if let Work::Correct { name, .. } = &task.work
            && let Some(older) = self.journal().result(&delivered_as(name))
        {
            reason.what +=
                &format!(" What was delivered as {} at {} stays in force.", older.job.name, older.at);
        }
        // Noted before the move: a pattern must not slip through with the older shape after a crash between the two.
        let note = |rejected: &Path| {
            let to = with_slashes(rejected.strip_prefix(&folders.rejected).unwrap_or(rejected));
            self.journal().rejected(&drop, &reason.code, &to, part_of)
        };
        let rejected =
            filing::reject(folders, &task.relative, &original, &reason, note).map_err(folder_trouble)?;
        tracing::warn!(
            "{} rejected and moved to {}: {}",
            on_one_line(&drop),
            on_one_line(&rejected.to_string_lossy()),
            reason.on_one_line()
        );
        Ok(Outcome::Rejected(reason))
    }

    /// The sidecar's text of an archived original, if it has one.
    pub(super) fn settings_of_original(&self, original: &Path, settings: &JobSettings) -> JobSettings {
        let sidecar = intake::sidecar_of(original);
        let text = sidecar.as_ref().and_then(|path| read_if_there(path).ok().flatten());
        let text = text.and_then(|bytes| String::from_utf8(bytes).ok());
        match (sidecar, text) {
            (Some(path), Some(text)) => {
                settings.with_sidecar(&path, &text).unwrap_or_else(|_| settings.clone())
            }
            _ => settings.clone(),
        }
    }
}

/// Whether two drops are one; of what was corrected again from the archive, only the pattern's name is known.
fn is_same_drop(a: &str, b: &str) -> bool {
    let is_archived = |drop: &str| drop.starts_with(ARCHIVE);
    let name = |drop: &str| match meaning(Path::new(drop)) {
        Ok(Meaning::Pattern { name, .. }) if !is_archived(drop) => name,
        _ => drop.rsplit('/').next().unwrap_or(drop).to_owned(),
    };
    a == b || ((is_archived(a) || is_archived(b)) && fold(&name(a)) == fold(&name(b)))
}

/// The settings in the archive that lie beside the original of a result.
fn sidecar_of_last(folders: &FolderPaths, sku: &Sku, last: &Delivered) -> Option<PathBuf> {
    let original = Some(&last.original).filter(|original| !original.is_empty())?;
    intake::sidecar_of(&folders.archive.join(sku.key()).join(original)).filter(|path| folders::is_file(path))
}

/// Whether BeamServer would look for a drawing that is not there.
fn is_missing_for_server(station: &Station, name: &str) -> bool {
    let there = || folders::is_file(&station.folders.import.join(name));
    station.delivery.kind == DeliveryKind::Beamserver && !there()
}

fn words(how: How, last: Option<(&str, bool)>) -> String {
    match (how, last) {
        (How::Replaced, Some((at, false))) => format!("replaces in import the result of {at},"),
        (How::Replaced, _) => "replaces the older drawing in import,".into(),
        (How::New, Some((at, true))) => {
            format!("was already delivered at {at}, is gone from import, and is delivered again,")
        }
        (How::New, Some((at, false))) => format!("delivered to import after an older result of {at},"),
        (How::New, None) => "delivered to import".into(),
        (How::Unchanged, _) => "was already delivered and lies in import unchanged,".into(),
        (How::Again, _) => "was already delivered and is delivered again,".into(),
        (How::BeforeTheCrash, _) => "was delivered before the station was interrupted, and is filed".into(),
    }
}

/// What the journal would have said is found out from the folders at the next start.
pub(super) fn tell_trouble(noted: std::io::Result<()>) {
    if let Err(error) = noted {
        tracing::warn!("the journal lacks a line: {error}");
    }
}

/// Calls into the pipeline; a panic there is the job's failure, not the station's.
pub(super) fn guarded<T>(call: impl FnOnce() -> Result<T, JobError>) -> Result<T, JobError> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|panic| {
        let words = panic.downcast_ref::<&str>().copied().map(str::to_owned);
        let words = words.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
        let what = format!("An internal error stopped this job: {words}.");
        let remedy = "Keep the file and report it with this message: it is a mistake in isomark.";
        Err(JobError::Rejected(Reason::new("internal-error", what, remedy)))
    })
}

/// Folders heal: the drop stays and is tried again.
pub(super) fn folder_trouble(error: std::io::Error) -> JobError {
    use std::io::ErrorKind::{PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull};
    let how = match error.kind() {
        StorageFull | QuotaExceeded => "is full",
        ReadOnlyFilesystem => "is read-only",
        PermissionDenied => "may not be written by isomark",
        _ => "fails",
    };
    let remedy =
        "Check that the folder exists, can be written and has space; the job then goes on by itself.";
    JobError::Retry(Reason::new("folder-trouble", format!("A folder of the station {how}: {error}."), remedy))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_another_drop_of_one_name_is_another() {
        for (a, b, same) in [
            ("mug@pic.dxf", "mug@pic.dxf", true),
            ("mug@pic.png", "mug@pic.dxf", false),
            ("mug/pic.dxf", "mug@pic.dxf", false),
            ("archive:mug/(2)/mug@pic.dxf", "mug@pic.dxf", true),
            ("mug@pic.dxf", "archive:mug/mug@pic.png", false),
            ("mug/pic.dxf", "archive:mug/mug@pic.dxf", true),
        ] {
            assert_eq!(is_same_drop(a, b), same, "{a} {b}");
        }
    }
}
