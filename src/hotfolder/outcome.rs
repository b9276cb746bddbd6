//! One job: from a drop that is ready to its outcome.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::time::{Duration, Instant};

use super::drops::Block;
use super::filing::{self, Original, with_slashes};
use super::folders;
use super::intake::Read;
use super::job::{Corrector, Delivery, DroppedFile, JobError, Mode, StationError};
use super::names::{Meaning, delivered_as};
use super::settle::Moment;
use super::worker::Worker;
use crate::config::{JobSettings, Sku};
use crate::formats::mesh::MeshFormat;
use crate::formats::pattern::is_picture;
use crate::reason::Reason;

/// The pause after the first failure of something around a job; it doubles with each further failure.
const FIRST_PAUSE: Duration = Duration::from_millis(250);
/// Code of the reason for which drawings wait when there is no import folder.
const IMPORT_MISSING: &str = "import-missing";
/// The longest pause between two tries, so that a healed folder is noticed soon.
const LONGEST_PAUSE: Duration = Duration::from_secs(10);

impl<C: Corrector> Worker<'_, C> {
    /// Does the job of one drop that is ready.
    pub(super) fn handle(&mut self, path: &Path) -> Result<(), StationError> {
        self.refresh_settings();
        let Some(drop) = self.drops.get(path) else { return Ok(()) };
        let started = Instant::now();
        let meaning = if self.is_late_texture(path) { Ok(Meaning::Companion) } else { drop.meaning.clone() };
        let (sku, pattern) = match meaning {
            Ok(Meaning::Companion) => {
                self.companion(path);
                return Ok(());
            }
            Ok(Meaning::Part(sku)) => (sku, None),
            Ok(Meaning::Pattern { sku, name }) => (sku, Some(name)),
            Err(reason) => return self.fail(path, None, JobError::Rejected(reason)),
        };
        let (settings, read) = match self.begin(path, &sku, pattern.as_deref()) {
            Ok(Some(begun)) => begun,
            Ok(None) => return Ok(()),
            Err(error) => return self.fail(path, None, error),
        };
        let outcome = match pattern {
            None => self.learn(path, &sku, &settings, &read, started),
            Some(_) => self.correct(path, &sku, &settings, &read, started),
        };
        match outcome {
            Ok(()) => {
                self.done(path);
                if pattern.is_none() {
                    self.drops.release(&sku);
                }
                read.companions.iter().for_each(|companion| self.look_again(companion));
                Ok(())
            }
            Err(error) => self.fail(path, Some(&read), error),
        }
    }

    /// The settings and the content of a drop whose time has come; `None` when it has to wait. A pattern is not
    /// read before its SKU has a surface.
    fn begin(
        &mut self,
        path: &Path,
        sku: &Sku,
        pattern: Option<&str>,
    ) -> Result<Option<(JobSettings, Read)>, JobError> {
        if pattern.is_some() && self.drops.has_part(sku) {
            let what = format!("The pattern waits for a part of {sku} that is not whole or not done yet.");
            self.wait(
                path,
                Block::PartUnderWay,
                Reason::new("waits-for-part", what, "Finish dropping the part."),
            );
            return Ok(None);
        }
        let settings = self.job_settings(sku)?;
        if pattern.is_some() && !self.has_surface(sku, &settings)? {
            let what = format!("The pattern waits for a part: no surface of {sku} is known.");
            let remedy = format!("Drop the part as {sku}{}.", MeshFormat::ENDINGS);
            self.wait(path, Block::UnknownSku, Reason::new("waits-for-part", what, remedy));
            return Ok(None);
        }
        Ok(self.read(path, pattern)?.map(|read| (settings, read)))
    }

    fn learn(
        &mut self,
        path: &Path,
        sku: &Sku,
        settings: &JobSettings,
        read: &Read,
        started: Instant,
    ) -> Result<(), JobError> {
        let learned = guarded(|| self.corrector.learn_part(sku, &read.file, settings))?;
        let folders = self.folders();
        let name = &read.file.name;
        if let Some(report) = &learned.report {
            filing::write_report(folders, sku, name, "report.json", report).map_err(folder_trouble)?;
        }
        let archived = filing::archive(folders, sku, name, &read.original(path)).map_err(folder_trouble)?;
        if let Err(error) = filing::set_current_part(folders, sku, &archived) {
            tracing::warn!("the surface of {sku} cannot be restored from the archive later: {error}");
        }
        let place = archived.parent().unwrap_or(&archived).to_path_buf();
        let until = self.now() + self.times().incomplete;
        self.late_companions.extend(read.absent.iter().map(|path| (path.clone(), (until, place.clone()))));
        self.unfit_archive.remove(sku);
        self.tally.learned += 1;
        let took = started.elapsed().as_millis();
        tracing::info!("{name} is now the shape of {sku}, in {took} ms: {}", learned.summary);
        Ok(())
    }

    fn correct(
        &mut self,
        path: &Path,
        sku: &Sku,
        settings: &JobSettings,
        read: &Read,
        started: Instant,
    ) -> Result<(), JobError> {
        let name = &delivered_as(&read.file.name);
        let delivery = match self.delivered.remove(path) {
            Some((stamp, delivery)) if stamp == read.stamp => delivery,
            _ => {
                // Many drawings may wait for long: each is worked through once, to tell early what is wrong with it.
                let waits = self.drops.get(path).and_then(|drop| drop.reason.as_ref());
                if waits.is_some_and(|reason| reason.code == IMPORT_MISSING) {
                    self.import_is_there()?;
                }
                let previous = filing::delivered_before(self.folders(), name).map_err(folder_trouble)?;
                let previous = previous.as_deref();
                let mut delivery = guarded(|| self.corrector.correct(sku, &read.file, previous, settings))?;
                self.import_is_there()?;
                let is_new = filing::deliver(self.folders(), name, &delivery.drawing, previous)
                    .map_err(folder_trouble)?;
                let took = started.elapsed().as_millis();
                let how = if is_new { "delivered to import" } else { "lies in import already, unchanged," };
                tracing::info!("{name} {how} in {took} ms: {}", delivery.summary);
                self.tally.delivered += 1;
                delivery.drawing = Vec::new();
                delivery
            }
        };
        let filed = self.file_away(path, sku, read, &delivery);
        if filed.is_err() {
            self.delivered.insert(path.into(), (read.stamp, delivery));
        }
        filed
    }

    fn import_is_there(&self) -> Result<(), JobError> {
        let import = &self.folders().import;
        if import.is_dir() { Ok(()) } else { Err(JobError::Retry(import_missing(import))) }
    }

    /// What follows a delivery: the report, the preview, and the original out of the hot folder.
    fn file_away(&self, path: &Path, sku: &Sku, read: &Read, delivery: &Delivery) -> Result<(), JobError> {
        let (folders, name) = (self.folders(), &read.file.name);
        filing::write_report(folders, sku, name, "report.json", &delivery.report).map_err(folder_trouble)?;
        if let Some(preview) = &delivery.preview {
            filing::write_report(folders, sku, name, "preview.svg", preview).map_err(folder_trouble)?;
        }
        filing::archive(folders, sku, name, &read.original(path)).map_err(folder_trouble)?;
        Ok(())
    }

    /// Whether there is a surface for the SKU; one that got lost is fitted again from the archived part.
    pub(super) fn has_surface(&mut self, sku: &Sku, settings: &JobSettings) -> Result<bool, JobError> {
        if guarded(|| Ok(self.corrector.knows(sku, settings)))? {
            return Ok(true);
        }
        let Some(part) = filing::current_part(self.folders(), sku) else { return Ok(false) };
        let attempt = (part, settings.clone());
        if self.unfit_archive.get(sku) == Some(&attempt) {
            return Ok(false);
        }
        let path = attempt.0.clone();
        let Some((bytes, _)) = folders::read_whole(&path).map_err(folder_trouble)? else { return Ok(false) };
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let file = DroppedFile { name, path, bytes };
        match guarded(|| self.corrector.learn_part(sku, &file, settings)) {
            Ok(learned) => {
                tracing::info!("the surface of {sku} is restored from the archive: {}", learned.summary);
                Ok(true)
            }
            Err(JobError::Rejected(reason)) => {
                tracing::warn!("the surface of {sku} cannot be restored from the archive: {reason}");
                self.unfit_archive.insert(sku.clone(), attempt);
                Ok(false)
            }
            Err(other) => Err(other),
        }
    }

    fn job_settings(&mut self, sku: &Sku) -> Result<JobSettings, JobError> {
        let settings = self.settings.job(sku).map_err(|error| JobError::Retry(error.reason()));
        self.tell_settings_events();
        settings
    }

    /// Whether the picture belongs to a part that was done before it came, as one of its textures.
    fn is_late_texture(&self, path: &Path) -> bool {
        self.late_companions.contains_key(path) && is_picture(&path.to_string_lossy())
    }

    /// A companion has settled: its part may go on, or went on without it before.
    fn companion(&mut self, path: &Path) {
        if let Some((_, place)) = self.late_companions.remove(path)
            && filing::follow(path, &place).is_ok()
        {
            self.drops.forget(path);
            return;
        }
        self.drops.companion_came(path);
        if let Some(drop) = self.drops.get_mut(path) {
            drop.block = Block::Unclaimed;
            drop.reason = Some(Reason::new(
                "waits-for-part",
                "The file waits for the part that names it.",
                "Drop the part, or remove the file if nothing needs it.",
            ));
        }
    }

    /// The drop is done. Should another file bear its name by now, that is a new drop.
    fn done(&mut self, path: &Path) {
        self.drops.forget(path);
        self.look_again(path);
    }

    fn wait(&mut self, path: &Path, block: Block, reason: Reason) {
        let Some(drop) = self.drops.get_mut(path) else { return };
        drop.block = block;
        if drop.reason.as_ref() != Some(&reason) {
            tracing::info!("{}: {} {}", with_slashes(&drop.relative), reason.what, reason.remedy);
            drop.reason = Some(reason);
        }
    }

    /// A job was not done: the drop is rejected, or waits, or the station stops.
    fn fail(&mut self, path: &Path, read: Option<&Read>, error: JobError) -> Result<(), StationError> {
        match error {
            JobError::Stop(reason) => return Err(StationError::Stopped(reason)),
            JobError::Retry(reason) => self.retry_later(path, reason),
            JobError::Rejected(reason) => {
                if let Err(JobError::Retry(trouble)) = self.reject(path, read, reason) {
                    self.retry_later(path, trouble);
                }
            }
        }
        Ok(())
    }

    fn reject(&mut self, path: &Path, read: Option<&Read>, reason: Reason) -> Result<(), JobError> {
        let Some(drop) = self.drops.get(path) else { return Ok(()) };
        if read.is_none() && matches!(folders::look(path), Ok(None)) {
            self.drops.forget(path);
            return Ok(());
        }
        let relative = drop.relative.clone();
        let name = with_slashes(&relative);
        let reason = reason.in_file(name.clone());
        let bare = Original { path, content: None, companions: &[] };
        let original = read.map_or(bare, |read| read.original(path));
        let rejected =
            filing::reject(self.folders(), &relative, &original, &reason).map_err(folder_trouble)?;
        self.tally.rejected += 1;
        tracing::warn!("{name} rejected and moved to {}: {}", rejected.display(), reason.what);
        self.done(path);
        Ok(())
    }

    pub(super) fn retry_later(&mut self, path: &Path, reason: Reason) {
        let now = self.now();
        let once = self.mode == Mode::Once;
        let Some(drop) = self.drops.get_mut(path) else { return };
        let pause = match drop.block {
            Block::Until { pause, .. } => (pause * 2).min(LONGEST_PAUSE),
            _ => FIRST_PAUSE,
        };
        let moment = if once { Moment::MAX } else { now + pause };
        drop.block = Block::Until { moment, pause };
        if drop.reason.as_ref() != Some(&reason) {
            tracing::warn!("{} waits: {} {}", with_slashes(&drop.relative), reason.what, reason.remedy);
            drop.reason = Some(reason);
        }
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

fn import_missing(import: &Path) -> Reason {
    let what = format!("The import folder {} does not exist.", import.display());
    let remedy = "Make it, connect its share, or correct `folders.import`; the drawing is then delivered.";
    Reason::new(IMPORT_MISSING, what, remedy)
}

/// Folders heal: the drop stays and is tried again.
pub(super) fn folder_trouble(error: std::io::Error) -> JobError {
    let remedy =
        "Check that the folder exists, can be written and has space; the job then goes on by itself.";
    JobError::Retry(Reason::new("folder-trouble", format!("A folder of the station fails: {error}."), remedy))
}
