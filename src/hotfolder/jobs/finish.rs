//! The end of a job: the marking software, report and pictures, and moving the original out of the hot folder.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use super::Read;
use super::filing::{Beside, Content, Original};
use super::{EarlyEnd, Executor, Outcome, Task, Unfiled, Work, delivery, filing, recovery};
use crate::config::{DeliveryKind, Sku, Station, fold};
use crate::formats::Pace;
use crate::formats::mesh::MeshFormat;
use crate::hotfolder::api::{Corrector, JobError};
use crate::hotfolder::beamserver;
use crate::hotfolder::error::{folder_trouble, guarded, warn_if_not_noted};
use crate::hotfolder::seen::names::is_list_ending;
use crate::hotfolder::seen::{Found, LARGEST_DROP, delivered_as, folders};
use crate::hotfolder::state::{Certainty, Import, Job, with_slashes};
use crate::printable::on_one_line;
use crate::reason::Reason;

/// A drawing that is being delivered and filed.
#[derive(Clone, Copy)]
pub(crate) struct Ready<'a> {
    pub(crate) task: &'a Task,
    pub(crate) sku: &'a Sku,
    /// The pattern's name; report and original are named after it.
    pub(crate) pattern: &'a str,
    /// The name of the result in the import folder.
    pub(crate) name: &'a str,
    pub(crate) read: &'a Read,
}

impl<C: Corrector> Executor<'_, C> {
    /// Does the steps after a delivery: the marking software, the report, the pictures, and filing the original. While other
    /// drops wait, it ends before the pictures with [`EarlyEnd::PicturesDue`].
    pub(crate) fn finish(&self, ready: &Ready, mut unfiled: Unfiled) -> Result<Outcome, EarlyEnd> {
        if !self.may_wait(ready.task, &unfiled) {
            return self.complete(ready, unfiled);
        }
        // The pictures of an older drawing must not be visible beside the new report.
        for (kind, _) in &unfiled.delivery.pictures {
            let folders = &ready.task.station.folders;
            delivery::remove_quietly(&filing::report_path(folders, ready.sku, ready.pattern, kind.ending()));
        }
        if let Err(error) = write_reports(ready, &mut unfiled) {
            return retried(error, unfiled);
        }
        Err(EarlyEnd::PicturesDue(Box::new(unfiled)))
    }

    /// Does all steps after a delivery that are not done yet.
    pub(crate) fn complete(&self, ready: &Ready, mut unfiled: Unfiled) -> Result<Outcome, EarlyEnd> {
        match self.remaining_steps(ready, &mut unfiled) {
            Ok(()) => Ok(match unfiled.certainty {
                Certainty::Certain if unfiled.is_resumed => Outcome::Resumed,
                Certainty::Certain => Outcome::Delivered,
                Certainty::Uncertain => Outcome::Uncertain,
            }),
            Err(error) => retried(error, unfiled),
        }
    }

    /// Whether the pictures are drawn later. After an interruption, the journal and the original in the hot folder show that
    /// they are missing; an original in the archive would not, and BeamServer would import the drawing a second time.
    fn may_wait(&self, task: &Task, unfiled: &Unfiled) -> bool {
        matches!(task.work, Work::Correct { .. })
            && task.station.delivery.kind == DeliveryKind::Folder
            && task.pace == Pace::Quick
            && !unfiled.delivery.pictures.is_empty()
            && self.others_wait.load(Ordering::Relaxed)
    }

    fn remaining_steps(&self, ready: &Ready, unfiled: &mut Unfiled) -> Result<(), JobError> {
        let Task { station, .. } = ready.task;
        if station.delivery.kind == DeliveryKind::Beamserver && !unfiled.asked {
            let imported = self.import(station, ready.name, unfiled);
            if matches!(imported, Err(JobError::Rejected(_))) {
                delivery::take_back(&station.folders, &mut self.journal(), &unfiled.job)?;
            }
            let outcome = imported?;
            delivery::forget_previous(&station.folders, ready.name);
            tracing::info!("{} {outcome}", ready.name);
            (unfiled.import, unfiled.asked) = (Import::Done, true);
        }
        unfiled.draw();
        write_reports(ready, unfiled)?;
        self.file_original(ready, &unfiled.job, unfiled.import, unfiled.certainty)
    }

    /// Imports the drawing into BeamConstruct, unless it is already there.
    fn import(&self, station: &Station, name: &str, unfiled: &Unfiled) -> Result<String, JobError> {
        let import = &station.folders.import;
        let for_server = |name: &str| beamserver::sendable(&station.delivery.path_for_server(import, name));
        let trial_name = delivery::trial_name(&self.journal());
        let trial = import.join(&trial_name);
        let drawing = beamserver::Drawing {
            name,
            path: for_server(name)?,
            size: unfiled.delivery.size,
            trial: (&trial_name, for_server(&trial_name)?),
            is_known: unfiled.import == Import::Done,
        };
        let lay_out = || fs_err::copy(import.join(name), &trial).map(drop).map_err(folder_trouble);
        self.beamserver.exclusive(|stop| {
            let imported = beamserver::import(&station.delivery, &drawing, stop, lay_out);
            delivery::remove_quietly(&trial);
            imported
        })
    }

    /// Moves the original to the archive and notes that the job is done; `certainty` is that of the delivery.
    pub(crate) fn file_original(
        &self,
        ready: &Ready,
        job: &Job,
        import: Import,
        certainty: Certainty,
    ) -> Result<(), JobError> {
        let folders = &ready.task.station.folders;
        let original = match ready.task.work {
            Work::CorrectAgain { .. } => filing::in_archive(folders, ready.sku, &ready.task.path),
            _ => {
                let job = Some((job, certainty));
                let archived = self.archive(ready.task, ready.sku, ready.pattern, ready.read, job)?;
                filing::in_archive(folders, ready.sku, &archived)
            }
        };
        warn_if_not_noted(self.journal().done(job, &original, import, certainty));
        Ok(())
    }

    /// Moves an original to the archive; `result` is the drawing that was made from it, and whether its delivery is
    /// certain.
    pub(crate) fn archive(
        &self,
        task: &Task,
        sku: &Sku,
        name: &str,
        read: &Read,
        result: Option<(&Job, Certainty)>,
    ) -> Result<PathBuf, JobError> {
        let folders = &task.station.folders;
        let original = read.original(&task.path);
        let begun = self.journal().begun(&task.drop, task.stamp).cloned();
        let copy = begun.and_then(|open| recovery::copy_of(&task.station, &open, sku, &read.file.bytes));
        if let Some(copy) = copy {
            filing::remove_copied(folders, &self.parking, &original, &copy).map_err(folder_trouble)?;
            return Ok(copy);
        }
        let place = filing::archive_place(folders, sku, name, &original).map_err(folder_trouble)?;
        let to = filing::in_archive(folders, sku, &place);
        let noted = self.journal().filing(&task.drop, sku.as_str(), read.stamp, &to, result);
        noted.map_err(folder_trouble)?;
        filing::put_away(folders, &self.parking, &original, &place).map_err(folder_trouble)?;
        Ok(place)
    }

    pub(crate) fn reject(
        &self,
        task: &Task,
        read: Option<&Read>,
        reason: Reason,
    ) -> Result<Outcome, JobError> {
        let drop = &task.drop;
        let mut reason = reason.in_file(drop.to_string());
        if drop.is_archived() {
            let name = drop.file_name();
            tracing::warn!(
                "{name} cannot be corrected again; the outdated drawing is not replaced: {}",
                reason.on_one_line()
            );
            return Ok(Outcome::Rejected(reason));
        }
        if read.is_none() && matches!(folders::look(&task.path), Ok(None)) {
            return Ok(Outcome::Changed);
        }
        let is_worth_reading = !matches!(task.work, Work::Reject(_)) && task.stamp.size <= LARGEST_DROP;
        let content = if is_worth_reading && folders::can_be_read(&task.path) {
            if read.is_none() && folders::look(&task.path).ok() != Some(Some(Found::File(task.stamp))) {
                return Ok(Outcome::Changed);
            }
            Content::Seen(task.stamp)
        } else {
            Content::Unknown
        };
        let sidecars: Vec<Beside> =
            task.place_of_sidecar().as_deref().and_then(Beside::at).into_iter().collect();
        let bare = Original { path: &task.path, content, companions: &sidecars };
        let original = read.map_or(bare, |read| read.original(&task.path));
        let folders = &task.station.folders;
        let is_note = is_note(task, read, &reason);
        if is_note {
            reason.remedy += " If this is a note, keep it outside the hot folder; the drawings continue.";
        }
        let part_of = match &task.work {
            Work::Learn(sku) if !is_note => {
                guarded(|| Ok(self.corrector.knows(sku, &task.settings)))?.then_some(sku)
            }
            _ => None,
        };
        if let Work::Learn(sku) = &task.work
            && is_list_ending(&task.path)
        {
            reason.remedy += &format!(
                " If this is the list of products for a drawing, drop it as {sku}@label.csv, before the drawing {sku}@label.dxf: both \
                 names need the same text behind an @."
            );
        }
        if let Work::Correct { name, .. } = &task.work
            && let Some(older) = self.journal().result(&delivered_as(name))
        {
            reason.what += &format!(
                " The drawing {} that was delivered at {} is not replaced.",
                older.job.name, older.at
            );
        }
        // Noted before the move: after a crash between the two, no pattern may be corrected for the older part.
        let note = |rejected: &Path| {
            let to = with_slashes(rejected.strip_prefix(&folders.rejected).unwrap_or(rejected));
            self.journal().rejected(drop, &reason.code, &to, part_of)
        };
        let rejected = filing::reject(
            &task.station.file,
            folders,
            &self.parking,
            &task.relative,
            &original,
            &reason,
            note,
        );
        let rejected = match rejected {
            // The file was written again.
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => return Ok(Outcome::Changed),
            rejected => rejected.map_err(folder_trouble)?,
        };
        tracing::warn!(
            "{} rejected and moved to {}: {}",
            on_one_line(&drop.to_string()),
            on_one_line(&rejected.to_string_lossy()),
            reason.on_one_line()
        );
        Ok(Outcome::Rejected(reason))
    }
}

/// Whether a rejected file is a text that a person wrote, such as `can@note.txt` or `can/readme.txt`, rather
/// than a scan: its drawings need not wait for another one. A file with the name of the SKU is intended as
/// its part. A file that is empty or has no text may have been a scan.
fn is_note(task: &Task, read: Option<&Read>, reason: &Reason) -> bool {
    let name = task.path.file_name().unwrap_or_default().to_string_lossy();
    let is_text = MeshFormat::from_name(&name) == Some(MeshFormat::Xyz);
    if !is_text || reason.code != "mesh-wrong-format" {
        return false;
    }
    let Work::Learn(sku) = &task.work else { return false };
    let stem = task.path.file_stem().unwrap_or_default().to_string_lossy();
    let has_text = || read.is_some_and(|read| !read.file.bytes.is_empty() && !read.file.bytes.contains(&0));
    name.contains('@') || fold(&stem) != sku.key() && has_text()
}

/// Writes the report, unless it is written, and the pictures that are drawn.
fn write_reports(ready: &Ready, unfiled: &mut Unfiled) -> Result<(), JobError> {
    let report =
        [(filing::REPORT, &*unfiled.delivery.report)].into_iter().filter(|(_, report)| !report.is_empty());
    let pictures = unfiled.pictures.iter().map(|(kind, picture)| (kind.ending(), &**picture));
    let files: Vec<(&str, &[u8])> = report.chain(pictures).collect();
    let folders = &ready.task.station.folders;
    filing::write_reports(folders, ready.sku, ready.pattern, &files).map_err(folder_trouble)?;
    unfiled.delivery.report.clear();
    Ok(())
}

/// The outcome of a job that could not do a step after the delivery.
fn retried(error: JobError, unfiled: Unfiled) -> Result<Outcome, EarlyEnd> {
    match error {
        JobError::Retry(reason) => Ok(Outcome::Retry(reason, Some(Box::new(unfiled)))),
        error => Err(error.into()),
    }
}

/// Whether BeamServer would look for a drawing that is missing.
pub(crate) fn is_missing_for_server(station: &Station, name: &str) -> bool {
    let exists = || folders::is_file(&station.folders.import.join(name));
    station.delivery.kind == DeliveryKind::Beamserver && !exists()
}
