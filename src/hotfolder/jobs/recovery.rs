//! Closes jobs that were interrupted: collects the evidence on the disk, and does what [`after_a_crash`] decides.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use fs_err as fs;

use super::delivery::{TRIAL_END, look_into_import, note_delivered, remove_quietly, temporary_of};
use super::filing;
use super::resume::{Evidence, Hidden, InImport, Inputs, Original, Resume, Seen, after_a_crash};
use crate::config::{DeliveryKind, FolderPaths, Sku, Station};
use crate::files::{TEMPORARY_END, TEMPORARY_START};
use crate::hotfolder::api::JobError;
use crate::hotfolder::error::folder_trouble;
use crate::hotfolder::seen::folders::is_file;
use crate::hotfolder::seen::{Found, Parking, folders, other_form, sidecar_of};
use crate::hotfolder::state::{DropId, Journal, OpenJob, Stage};
use crate::reason::Reason;

/// A temporary file of this age was left behind by a crash.
const LEFT_BEHIND: Duration = Duration::from_secs(3600);

/// The import folder does not matter, so it was not read.
const NOT_LOOKED: InImport =
    InImport { temporary: false, result: Seen::Nothing, same_folder: true, on_network: false };

/// Decides how an interrupted job continues, and notes it in the journal.
///
/// # Errors
/// [`JobError::Retry`] while a folder is not available.
pub(crate) fn resume(
    station: &Station,
    journal: &mut Journal,
    drop: &DropId,
    open: &OpenJob,
    original: Original,
) -> Result<Resume, JobError> {
    let import = match original {
        Original::OutOfSight => NOT_LOOKED,
        _ => in_import(station, journal, &open.stage)?,
    };
    let resume = after_a_crash(&open.stage, Evidence { original, import, kind: station.delivery.kind });
    match (resume, &open.stage) {
        (Resume::Wait(Hidden::Import), _) => {
            return Err(JobError::Retry(other_import(&station.folders.import)));
        }
        (Resume::Redo, stage) => {
            journal.cancelled(drop).map_err(folder_trouble)?;
            temporary(&station.folders, journal, stage).iter().for_each(|path| remove_quietly(path));
        }
        (
            Resume::Finish { certainty, .. } | Resume::NoteDrawing { certainty, .. },
            Stage::Renaming { result, .. },
        ) => {
            let why = "the station was interrupted while it delivered the drawing";
            note_delivered(station, journal, result, certainty, why).map_err(folder_trouble)?;
        }
        _ => {}
    }
    Ok(resume)
}

/// The finished copy of the original in the archive, if the copy was made before the interruption.
pub(crate) fn copy_of(station: &Station, open: &OpenJob, sku: &Sku, bytes: &[u8]) -> Option<PathBuf> {
    let Stage::Filing { to, .. } = &open.stage else { return None };
    let copy = station.folders.archive.join(sku.key()).join(to);
    let original = Original::AtHand { inputs: Inputs::Same, copied: folders::has_content(&copy, bytes) };
    let seen = Evidence { original, import: NOT_LOOKED, kind: station.delivery.kind };
    let resume = after_a_crash(&open.stage, seen);
    matches!(resume, Resume::Finish { copied: true, .. } | Resume::Refile { copied: true }).then_some(copy)
}

/// Closes the jobs that were started and whose drop was removed: their last step was done, or somebody took the drop
/// away. An archived original is never in the hot folder: its job is closed, and done again if the drawing is still to
/// be imported by BeamServer.
pub(crate) fn close_all(
    station: &Station,
    journal: &mut Journal,
    parking: &Parking,
    is_at_work: impl Fn(&DropId) -> bool,
    mut complain: impl FnMut(String),
) {
    journal.set_hot(folders::identity(&station.folders.hot));
    for (drop, open) in journal.all_begun() {
        let Some(original) = look_for(&station.folders, &drop, &open).filter(|_| !is_at_work(&drop)) else {
            continue;
        };
        if original == (Original::Gone { filed: true }) {
            leftover_sidecar_follows(&station.folders, parking, &drop, &open);
        }
        match close(station, journal, &drop, &open, original) {
            Ok(Resume::Wait(_)) => complain(format!(
                "{drop} was interrupted, and the hot folder {} is a different folder now. If a share is missing, \
                 connect it: isomark then finishes the drop",
                station.folders.hot.display()
            )),
            Err(JobError::Retry(reason)) => {
                complain(format!("{drop} was interrupted and cannot be finished yet: {}", reason.what));
            }
            _ => {}
        }
    }
}

fn close(
    station: &Station,
    journal: &mut Journal,
    drop: &DropId,
    open: &OpenJob,
    original: Original,
) -> Result<Resume, JobError> {
    let folders = &station.folders;
    let resume = resume(station, journal, drop, open, original)?;
    let place = match (drop, &open.stage) {
        (DropId::Archived { place, .. }, _) => place,
        (_, Stage::Filing { to, .. }) if original == (Original::Gone { filed: true }) => to,
        _ => "",
    };
    match (resume, open.stage.result(), open.sku.parse::<Sku>()) {
        (Resume::NoteDrawing { certainty, import }, Some(result), _) => {
            journal.done(result, place, import, certainty)
        }
        (Resume::NotePart, _, Ok(sku)) => {
            let part = folders.archive.join(sku.key()).join(place);
            filing::set_current_part(folders, &sku, &part).map_err(folder_trouble)?;
            journal.learned(drop, sku.as_str(), place)
        }
        _ => Ok(()),
    }
    .map_err(folder_trouble)?;
    Ok(resume)
}

/// The place of the original of a job that is not running; `None` if it is in the hot folder, where it is processed
/// again.
fn look_for(folders: &FolderPaths, drop: &DropId, open: &OpenJob) -> Option<Original> {
    let DropId::Hot(path) = drop else { return Some(Original::InArchive) };
    match folders::look(&folders.hot.join(path)) {
        Ok(Some(Found::File(stamp))) if open.stamp.is_of(stamp) => return None,
        _ => {}
    }
    // An empty mount point, or another share: the drop may return together with its folder.
    if open.hot.is_some() && open.hot != folders::identity(&folders.hot) {
        return Some(Original::OutOfSight);
    }
    Some(Original::Gone { filed: archived(folders, open).is_some_and(|place| is_file(&place)) })
}

/// The path in the archive to which the original of an interrupted job was being moved.
fn archived(folders: &FolderPaths, open: &OpenJob) -> Option<PathBuf> {
    let (Stage::Filing { to, .. }, Ok(sku)) = (&open.stage, open.sku.parse::<Sku>()) else { return None };
    Some(folders.archive.join(sku.key()).join(to))
}

/// The state of the import folder, as far as it matters at this stage.
fn in_import(station: &Station, journal: &Journal, stage: &Stage) -> Result<InImport, JobError> {
    let folders = &station.folders;
    match (stage, temporary(folders, journal, stage)) {
        (Stage::Renaming { result, import, .. }, Some(temporary)) => {
            folders.import_trouble().map_or(Ok(()), |reason| Err(JobError::Retry(reason)))?;
            look_into_import(&folders.import, &temporary, result, *import).map_err(folder_trouble)
        }
        (Stage::Delivered { result, .. }, _)
            if station.delivery.kind == DeliveryKind::Beamserver
                && is_file(&folders.import.join(&result.name)) =>
        {
            Ok(InImport { result: Seen::Another, ..NOT_LOOKED })
        }
        _ => Ok(NOT_LOOKED),
    }
}

/// The temporary file of a drawing that is about to get its final name.
fn temporary(folders: &FolderPaths, journal: &Journal, stage: &Stage) -> Option<PathBuf> {
    let Stage::Renaming { result, tag, .. } = stage else { return None };
    let tag = if tag.is_empty() { journal.tag() } else { tag };
    Some(temporary_of(&folders.import, tag, result))
}

fn other_import(import: &Path) -> Reason {
    let what = format!(
        "The station was interrupted while it delivered the drawing, and {} is a different folder now.",
        import.display()
    );
    let remedy = "Connect the share with the import folder; or check there whether the drawing arrived, and drop it again if not.";
    Reason::new("import-other", what, remedy)
}

/// Moves settings to the archive that an interruption left behind when their pattern was moved there: the next pattern
/// of that name must not use them. If such a pattern is there already, the settings belong to it.
fn leftover_sidecar_follows(folders: &FolderPaths, parking: &Parking, drop: &DropId, open: &OpenJob) {
    let DropId::Hot(path) = drop else { return };
    let forms = [Some(PathBuf::from(path)), other_form(Path::new(path))];
    let (true, Some(archived)) = (open.is_delivered(), archived(folders, open)) else { return };
    for path in forms.into_iter().flatten().map(|form| folders.hot.join(form)) {
        let (Some(sidecar), Ok(None)) = (sidecar_of(&path), folders::look(&path)) else { return };
        if is_file(&sidecar) {
            let place = archived.parent().unwrap_or(&archived);
            if let Err(error) = filing::follow(folders, parking, &sidecar, place) {
                tracing::warn!("{} remains in the hot folder: {error}", sidecar.display());
            }
            return;
        }
    }
}

/// Removes the leftovers of crashes in the import folder: this station's temporary files that no job needs.
pub(crate) fn sweep(folders: &FolderPaths, journal: &Journal) {
    let ours = format!("{TEMPORARY_START}{}-", journal.tag());
    let needed: Vec<PathBuf> =
        journal.all_begun().iter().filter_map(|(_, open)| temporary(folders, journal, &open.stage)).collect();
    for (path, name) in temporaries(&folders.import) {
        // A file with another station's tag belongs to that station, even if it is old.
        let is_tagged = name[TEMPORARY_START.len()..].contains('-');
        let is_left = if is_tagged { name.starts_with(&ours) } else { is_left_behind(&path) };
        if is_left && !needed.contains(&path) {
            remove_quietly(&path);
        }
    }
}

/// Removes old temporary files, left behind by crashes, from the station's own folders.
pub(crate) fn sweep_own(folders: &FolderPaths) {
    let FolderPaths { archive, rejected, cache, reports, state, .. } = folders;
    for own in [archive, rejected, cache, reports, state] {
        sweep_below(own, 0);
    }
}

/// Whether the temporary file is so old that no running job needs it.
fn is_left_behind(path: &Path) -> bool {
    let written = fs::metadata(path).and_then(|metadata| metadata.modified());
    let age = written.ok().and_then(|written| SystemTime::now().duration_since(written).ok());
    age.is_some_and(|age| age > LEFT_BEHIND)
}

/// Removes old temporary files from a folder and from the SKU folders and numbered folders in it.
fn sweep_below(folder: &Path, depth: usize) {
    temporaries(folder)
        .iter()
        .filter(|(path, _)| is_left_behind(path))
        .for_each(|(path, _)| remove_quietly(path));
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let folders = entries.filter(|entry| depth < 3 && entry.file_type().is_ok_and(|kind| kind.is_dir()));
    folders.for_each(|entry| sweep_below(&entry.path(), depth + 1));
}

fn temporaries(folder: &Path) -> Vec<(PathBuf, String)> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let named = entries.map(|entry| (entry.path(), entry.file_name().to_string_lossy().into_owned()));
    let is_temporary = |name: &str| name.ends_with(TEMPORARY_END) || name.ends_with(TRIAL_END);
    named.filter(|(_, name)| name.starts_with(TEMPORARY_START) && is_temporary(name)).collect()
}
