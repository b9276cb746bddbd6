//! Does one job, from a ready drop to its outcome, in its own thread.
//!
//! ```text
//! read ─▶ correct ─▶ write, read back ─▶ journal: delivering ─▶ rename into import/ ─▶ journal: delivered
//!                                                                                           │
//!                      journal: done ◀─ move original to archive/ ◀─ journal: filing ◀─ pictures ◀─ report
//! ```
//!
//! While other drops wait for a thread, a job pauses before the pictures ([`Outcome::PicturesDue`]).
//!
//! If the program ends between two steps, the drop and the journal together show how far the job got, and the next
//! start continues from there.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::Read;
use super::intake::{self, Intake};
use super::restoring::Restoring;
use super::{EarlyEnd, End, Outcome, Task, Work, filing};
use crate::config::{JobSettings, Sku};
use crate::files::read_if_there;
use crate::hotfolder::api::{Corrector, JobError, PartLearned};
use crate::hotfolder::beamserver;
use crate::hotfolder::error::{folder_trouble, guarded, warn_if_not_noted};
use crate::hotfolder::seen::{Parking, Stamp, StopSignal, sidecar_of};
use crate::hotfolder::state::{DropId, Journal, OpenJob, Shares};
use crate::reason::Reason;

/// An archived part that was to be fitted: its path, the settings, and since when it was the SKU's part.
pub(super) type Attempt = (PathBuf, JobSettings, Option<u64>);

/// An archived part that cannot be fitted with these settings, and why drawings wait, if there is a more
/// specific reason.
pub(super) type Unfit = (Attempt, Option<Reason>);

/// The state that the threads of a station share.
pub(crate) struct Executor<'a, C> {
    pub(crate) corrector: &'a C,
    pub(crate) journal: Mutex<Journal>,
    /// SKUs for which a part arrived while a drawing of them was being corrected.
    pub(super) overtaken: Mutex<BTreeSet<Sku>>,
    pub(super) restoring: Restoring,
    /// Archived parts that cannot be fitted with these settings.
    pub(super) unfit_archive: Mutex<BTreeMap<Sku, Unfit>>,
    /// Whether pictures are drawn later, because drops wait for a thread.
    pub(crate) others_wait: AtomicBool,
    /// Held while the serial numbers of a SKU are noted.
    pub(super) serial_notes: Mutex<()>,
    pub(super) beamserver: beamserver::Gate,
    pub(crate) shares: Shares,
    pub(crate) parking: Parking,
    /// The settings and the last known part identity of each SKU.
    pub(super) shapes: Mutex<BTreeMap<Sku, (JobSettings, String)>>,
}

impl<'a, C: Corrector> Executor<'a, C> {
    pub(crate) fn new(corrector: &'a C, journal: Journal, shares: Shares, stop: StopSignal) -> Self {
        Self {
            corrector,
            journal: Mutex::new(journal),
            overtaken: Mutex::default(),
            restoring: Restoring::default(),
            unfit_archive: Mutex::default(),
            others_wait: AtomicBool::new(false),
            serial_notes: Mutex::default(),
            beamserver: beamserver::Gate::new(stop),
            shares,
            parking: Parking::default(),
            shapes: Mutex::default(),
        }
    }

    pub(crate) fn journal(&self) -> MutexGuard<'_, Journal> {
        self.journal.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn overtaken(&self) -> MutexGuard<'_, BTreeSet<Sku>> {
        self.overtaken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes that a part of the SKU is in the hot folder: drawings that are not delivered yet wait for it.
    pub(crate) fn part_arrived(&self, sku: &Sku) {
        self.overtaken().insert(sku.clone());
    }

    /// Notes that a drawing of the SKU is started, with no part of it in the hot folder.
    pub(crate) fn begins(&self, sku: &Sku) {
        self.overtaken().remove(sku);
    }

    /// Whether the drawing of this drop was delivered before the station was interrupted.
    pub(crate) fn is_delivered(&self, drop: &DropId, stamp: Stamp) -> bool {
        self.journal().begun(drop, stamp).is_some_and(OpenJob::is_delivered)
    }

    /// Does one job.
    pub(crate) fn perform(&self, task: Task) -> End {
        let drop = task.drop.clone();
        warn_if_not_noted(self.journal().began(&drop, task.stamp));
        let end = self.attempt(task);
        warn_if_not_noted(self.journal().ended(&drop));
        end
    }

    fn attempt(&self, mut task: Task) -> End {
        let unfiled = task.unfiled.take();
        let mut read = task.read.take();
        if let Err(JobError::Retry(reason)) = self.shares.are_there(&task.station.folders, false) {
            return End { outcome: Outcome::Retry(reason, unfiled.map(Box::new)), went_along: Vec::new() };
        }
        let line = match (&task.doomed, &task.work) {
            (None, Work::Correct { sku, name }) if unfiled.is_none() => self.line_for(&task, sku, name),
            _ => None,
        };
        let attempt = match (&task.doomed, &task.work) {
            (Some(reason), _) | (None, Work::Reject(reason)) => {
                Err(JobError::Rejected(reason.clone()).into())
            }
            (None, Work::Learn(sku)) => self.learn(&task, sku, &mut read),
            (None, Work::Restore(sku)) => self.restore(&task, sku),
            (None, Work::Correct { sku, name }) if line.is_some() => {
                self.hand_over(&task, sku, name, line.as_deref().unwrap_or_default(), &mut read)
            }
            (None, Work::Correct { sku, name }) if unfiled.is_none() && self.is_listed(&task) => {
                self.list(&task, sku, name, &mut read)
            }
            (None, Work::Correct { sku, name } | Work::CorrectAgain { sku, name }) => {
                self.correct(&task, sku, name, unfiled, &mut read)
            }
        };
        let ended = match attempt {
            Err(EarlyEnd::Error(JobError::Rejected(reason))) => {
                self.reject(&task, read.as_ref(), reason).map_err(EarlyEnd::Error)
            }
            attempt => attempt,
        };
        let outcome = match ended {
            Ok(outcome) | Err(EarlyEnd::Outcome(outcome)) => outcome,
            Err(EarlyEnd::PicturesDue(unfiled)) => {
                (task.unfiled, task.read) = (Some(*unfiled), read.take());
                Outcome::PicturesDue(Box::new(task))
            }
            Err(EarlyEnd::Error(JobError::Stop(reason))) => Outcome::Stop(reason),
            Err(EarlyEnd::Error(JobError::TakesLong)) => Outcome::TakesLong,
            Err(EarlyEnd::Error(JobError::Retry(reason) | JobError::Rejected(reason))) => {
                Outcome::Retry(reason, None)
            }
        };
        let went_along = read.map(|read| read.companions).unwrap_or_default();
        End { outcome, went_along: went_along.into_iter().map(|companion| companion.path).collect() }
    }

    fn learn(&self, task: &Task, sku: &Sku, slot: &mut Option<Read>) -> Result<Outcome, EarlyEnd> {
        let started = Instant::now();
        let read = &*slot.insert(self.read(task, None)?);
        self.take_as_up_to_date(&task.station.folders, sku, &task.settings);
        let learned = guarded(|| self.corrector.learn_part(sku, &read.file, &task.settings, task.pace))?;
        let PartLearned { summary, report } = learned;
        // A companion that changed meanwhile would be filed in another version than the one that was learned.
        if !read.companions.iter().all(filing::Beside::is_unchanged) {
            return Ok(Outcome::Changed);
        }
        let (folders, name) = (&task.station.folders, &read.file.name);
        if let Some(report) = &report {
            filing::write_report(folders, sku, name, filing::REPORT, report).map_err(folder_trouble)?;
        }
        let archived = self.archive(task, sku, name, read, None)?;
        // If this fails, the job stays open and the next listing closes it: the note must not name an older part.
        filing::set_current_part(folders, sku, &archived).map_err(folder_trouble)?;
        self.note_part(folders, sku, &archived, &guarded(|| Ok(self.corrector.part_hash(&read.file)))?);
        self.note_shape(sku, &task.settings, true);
        let original = filing::in_archive(folders, sku, &archived);
        warn_if_not_noted(self.journal().learned(&task.drop, sku.as_str(), &original));
        self.unfit_archive.lock().unwrap_or_else(PoisonError::into_inner).remove(sku);
        let took = started.elapsed().as_millis();
        tracing::info!("{name} is now the part of SKU `{sku}` ({took} ms): {summary}");
        let place = archived.parent().unwrap_or(&archived).to_path_buf();
        Ok(Outcome::Learned { absent: read.absent.clone(), place })
    }

    pub(super) fn read(&self, task: &Task, name: Option<&str>) -> Result<Read, EarlyEnd> {
        let own_name = task.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let intake = Intake {
            path: &task.path,
            own_name: &own_name,
            name: name.unwrap_or(&own_name),
            stamp: task.stamp,
            last_chance: task.last_chance,
            settling: &task.settling,
            sidecar: task.place_of_sidecar(),
            list: task.place_of_list(),
        };
        intake::read(&intake, |name, bytes| guarded(|| Ok(self.corrector.completeness(name, bytes))))
    }

    /// The settings of an archived original, with those of its sidecar if it has one.
    pub(crate) fn settings_of_original(&self, original: &Path, settings: &JobSettings) -> JobSettings {
        let sidecar = sidecar_of(original);
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
