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

mod ending;
mod surfaces;
mod task;

use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::beamserver;
use super::delivery::{self, How};
use super::filing::{self, with_slashes};
use super::folders;
use super::intake::{self, Intake, Read};
use super::job::{Corrector, Delivery, JobError, PartLearned};
use super::journal::{Certainty, Delivered, Import, Job, Journal};
use super::names::{Meaning, delivered_as, meaning};
use super::parked::Parking;
use super::reprocess::ARCHIVE;
use super::settle::Stamp;
use super::shares::Shares;
use super::watcher::StopSignal;
use crate::config::{DeliveryKind, FolderPaths, JobSettings, Repeat, Sku, fold};
use crate::files::read_if_there;
use crate::formats::mesh::MeshFormat;
use crate::reason::Reason;

use ending::{is_missing_for_server, tell_trouble};
use task::Ready;
pub(super) use task::{Broken, End, Kept, Outcome, Task, Work};

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
    pub(super) parking: Parking,
    /// The name of the surface that each SKU was last seen to have under these settings.
    shapes: Mutex<BTreeMap<Sku, (JobSettings, String)>>,
}

impl<'a, C: Corrector> Executor<'a, C> {
    pub(super) fn new(corrector: &'a C, journal: Journal, shares: Shares, stop: StopSignal) -> Self {
        Self {
            corrector,
            journal: Mutex::new(journal),
            overtaken: Mutex::default(),
            unfit_archive: Mutex::default(),
            beamserver: beamserver::Turns::new(stop),
            shares,
            parking: Parking::default(),
            shapes: Mutex::default(),
        }
    }

    pub(super) fn journal(&self) -> MutexGuard<'_, Journal> {
        self.journal.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn overtaken(&self) -> MutexGuard<'_, BTreeSet<Sku>> {
        self.overtaken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A part of the SKU lies in the hot folder: what is not delivered yet waits for it.
    pub(super) fn part_came(&self, sku: &Sku) {
        self.overtaken().insert(sku.clone());
    }

    /// A drawing of the SKU begins, with no part of it in the hot folder.
    pub(super) fn begins(&self, sku: &Sku) {
        self.overtaken().remove(sku);
    }

    /// Whether the drawing of this drop was delivered before the station was interrupted.
    pub(super) fn is_delivered(&self, relative: &Path, stamp: Stamp) -> bool {
        self.journal().begun(&with_slashes(relative), stamp).is_some_and(|open| open.delivered)
    }

    /// Does one job.
    pub(super) fn perform(&self, task: Task) -> End {
        let drop = with_slashes(&task.relative);
        tell_trouble(self.journal().began(&drop, task.stamp));
        let end = self.attempt(task);
        tell_trouble(self.journal().ended(&drop));
        end
    }

    fn attempt(&self, mut task: Task) -> End {
        let kept = task.kept.take();
        let mut read = None;
        if let Err(JobError::Retry(reason)) = self.shares.are_there(&task.station.folders, false) {
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
            Err(Broken::Error(JobError::TakesLong)) => Outcome::TakesLong,
            Err(Broken::Error(JobError::Rejected(reason))) => {
                self.reject(&task, read.as_ref(), reason).unwrap_or_else(|error| match error {
                    JobError::Stop(reason) => Outcome::Stop(reason),
                    trouble => Outcome::Retry(trouble.into_reason(), None),
                })
            }
        };
        let went_along = read.map(|read| read.companions).unwrap_or_default();
        End { outcome, went_along: went_along.into_iter().map(|companion| companion.path).collect() }
    }

    fn learn(&self, task: &Task, sku: &Sku, slot: &mut Option<Read>) -> Result<Outcome, Broken> {
        let started = Instant::now();
        let read = &*slot.insert(self.read(task, None)?);
        self.take_as_up_to_date(&task.station.folders, sku, &task.settings);
        let learned = guarded(|| self.corrector.learn_part(sku, &read.file, &task.settings, task.pace))?;
        let PartLearned { summary, report } = learned;
        // It may have been learned with one version of them, and is filed with another.
        if !read.companions.iter().all(filing::Beside::is_unchanged) {
            return Ok(Outcome::Changed);
        }
        let (folders, name) = (&task.station.folders, &read.file.name);
        if let Some(report) = &report {
            filing::write_report(folders, sku, name, filing::REPORT, report).map_err(folder_trouble)?;
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
        if !self.has_surface(&task.station.folders, sku, &task.settings, task.pace)? {
            let what = format!("The pattern waits for a part: no surface of {sku} is known.");
            let remedy = format!("Drop the part as {sku}{}.", MeshFormat::ENDINGS);
            return Ok(Outcome::NoSurface(Reason::new("waits-for-part", what, remedy)));
        }
        self.note_shape(sku, &task.settings, false);
        let read = &*slot.insert(self.read(task, Some(pattern))?);
        let ready = Ready { task, sku, pattern, name, read };
        let last = self.journal().result(name).cloned();
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
                "part or settings changed since the station was interrupted while it delivered {name}: \
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
            match last.certainty {
                Certainty::Certain => {
                    tracing::info!("{name} was already delivered at {} and is not delivered again", last.at);
                }
                Certainty::Uncertain => tracing::warn!(
                    "{name} may have been delivered before {} and is not delivered again: \
                     `{}` does that",
                    last.at,
                    delivery::retry_command(&task.station, name)
                ),
            }
            job.result.clone_from(&last.job.result);
            self.file_original(&ready, &job, last.import, last.certainty)?;
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
        let previous_bytes = previous.as_deref();
        let mut made =
            guarded(|| self.corrector.correct(sku, &read.file, previous_bytes, &settings, task.pace))?;
        job.result = delivery::hash_of(&made.drawing);
        delivery::import_is_there(folders)?;
        self.shares.are_there(folders, false)?;
        // Files that are dropped together come one after the other, the drawing first perhaps.
        if was_begun.is_none() && self.overtaken().contains(sku) {
            return Ok(Outcome::PartCame);
        }
        let how = match &was_begun {
            Some(_) => match self.journal().certainty(&job.drop) {
                Certainty::Certain => How::BeforeTheCrash,
                Certainty::Uncertain => How::PerhapsBeforeTheCrash,
            },
            None => delivery::deliver(
                || self.journal(),
                &task.station,
                &job,
                task.stamp,
                &mut made,
                previous.as_deref(),
            )?,
        };
        let took = started.elapsed().as_millis();
        let summary = &made.summary;
        let is_for_server = task.station.delivery.kind == DeliveryKind::Beamserver;
        let for_server = if is_for_server { " for BeamServer" } else { "" };
        tracing::info!(
            "{name} {}{for_server} in {took} ms: {summary}",
            words(how, last.as_ref().map(|last| (last.at.as_str(), last.job.key == job.key)))
        );
        if let Some(last) = &last
            && last.job.key != job.key
            && !is_same_drop(&last.job.drop, &job.drop)
        {
            let [older, newer] = told_apart(&last.job.drop, &job.drop);
            tracing::warn!(
                "{older} and {newer} claim one result: {name} is now made of {newer}. Give the drawings different names."
            );
        }
        if read.sidecar.is_none()
            && let Some(settings) =
                last.as_ref().and_then(|last| sidecar_of_last(&task.station.folders, sku, last))
        {
            tracing::warn!(
                "{name} comes without the settings that its last version had: if they still hold, drop it again with {}",
                settings.display()
            );
        }
        let is_ours =
            |bytes: &[u8]| last.as_ref().is_some_and(|last| last.job.result == delivery::hash_of(bytes));
        if how == How::Replaced && !previous.as_deref().is_some_and(is_ours) {
            tracing::warn!(
                "the {name} that was replaced in import was another one than this station had put there"
            );
        }
        (made.drawing, made.check) = (Vec::new(), None);
        let import = match (was_begun, same_again) {
            (Some((_, import)), _) => import,
            (None, Some(last)) if how == How::Unchanged => last.import,
            _ if task.station.delivery.kind == DeliveryKind::Folder => Import::ByFolder,
            _ => Import::Due,
        };
        let preview = made.preview.take().and_then(|draw| {
            let trouble =
                |error: JobError| tracing::warn!("{name} has no preview: {}", error.into_reason().what);
            guarded(|| Ok(draw())).map_err(trouble).ok()
        });
        self.finish(&ready, Kept { stamp: task.stamp, job, delivery: made, preview, import, asked: false })
    }

    /// All that the result depends on.
    fn job(&self, ready: &Ready, drop: String, settings: &JobSettings) -> Result<Job, JobError> {
        let basis = self.basis(ready.sku, settings)?.unwrap_or_default();
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

/// Two names that differ, spelled so that the difference is seen: an accent may be a letter of its own.
fn told_apart(one: &str, other: &str) -> [String; 2] {
    let looks_alike = fold(one) == fold(other);
    let spelled = |name: &str| match looks_alike {
        true => name
            .chars()
            .map(|c| if c.is_ascii() { c.to_string() } else { c.escape_unicode().to_string() })
            .collect(),
        false => name.to_owned(),
    };
    [spelled(one), spelled(other)]
}

/// The settings in the archive that lie beside the original of a result.
fn sidecar_of_last(folders: &FolderPaths, sku: &Sku, last: &Delivered) -> Option<PathBuf> {
    let original = Some(&last.original).filter(|original| !original.is_empty())?;
    intake::sidecar_of(&folders.archive.join(sku.key()).join(original)).filter(|path| folders::is_file(path))
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
        (How::PerhapsBeforeTheCrash, _) => {
            "may have been delivered before the station was interrupted, and is filed".into()
        }
        (How::Perhaps, _) => "may have been delivered to import, and is filed".into(),
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

    #[test]
    fn names_that_look_alike_are_told_apart() {
        let [one, other] = told_apart("m\u{fc}g@pic.dxf", "mu\u{308}g@pic.dxf");
        assert_eq!((&*one, &*other), ("m\\u{fc}g@pic.dxf", "mu\\u{308}g@pic.dxf"));
        assert_eq!(told_apart("mug@pic.png", "m\u{fc}g@pic.dxf"), ["mug@pic.png", "m\u{fc}g@pic.dxf"]);
        assert_eq!(told_apart("Mug@pic.dxf", "mug@pic.dxf"), ["Mug@pic.dxf", "mug@pic.dxf"]);
    }
}
