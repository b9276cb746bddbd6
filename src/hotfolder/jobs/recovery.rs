//! What an interruption left open: what is found of it on the disk, and what is done about it as [`after_a_crash`] decides.

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
use crate::hotfolder::seen::{Found, Parking, folders, sidecar_of};
use crate::hotfolder::state::{DropId, Journal, OpenJob, Stage};
use crate::reason::Reason;

/// A temporary file that nobody renamed for this long was left by a crash.
const LEFT_BEHIND: Duration = Duration::from_secs(3600);

/// Nothing was to be looked for.
const NOT_LOOKED: InImport =
    InImport { temporary: false, result: Seen::Nothing, same_folder: true, on_network: false };

/// Decides how a job that was interrupted goes on, and notes it.
///
/// # Errors
/// To be tried again when the folders cannot tell now.
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

/// Where the original of a job lies already that is at hand, if its copy was finished before an interruption.
pub(crate) fn copy_of(station: &Station, open: &OpenJob, sku: &Sku, bytes: &[u8]) -> Option<PathBuf> {
    let Stage::Filing { to, .. } = &open.stage else { return None };
    let copy = station.folders.archive.join(sku.key()).join(to);
    let original = Original::AtHand { inputs: Inputs::Same, copied: folders::has_content(&copy, bytes) };
    let seen = Evidence { original, import: NOT_LOOKED, kind: station.delivery.kind };
    let resume = after_a_crash(&open.stage, seen);
    matches!(resume, Resume::Finish { copied: true, .. } | Resume::Refile { copied: true }).then_some(copy)
}

/// Closes the jobs that were begun and whose drop is gone: their last step was done, or somebody took the drop away. An
/// archived original is never in the hot folder: its job is closed, and done again if BeamServer has still to be told.
pub(crate) fn close_all(
    station: &Station,
    journal: &mut Journal,
    parking: &Parking,
    is_at_work: impl Fn(&DropId) -> bool,
    mut complain: impl FnMut(String),
) {
    journal.hot_is(folders::identity(&station.folders.hot));
    for (drop, open) in journal.all_begun() {
        let Some(original) = look_for(&station.folders, &drop, &open).filter(|_| !is_at_work(&drop)) else {
            continue;
        };
        if original == (Original::Gone { filed: true }) {
            leftover_sidecar_follows(&station.folders, parking, &drop, &open);
        }
        match close(station, journal, &drop, &open, original) {
            Ok(Resume::Wait(_)) => complain(format!(
                "{drop} was interrupted, and the hot folder {} is another one than then: if a share is missing, \
                 connect it; the drop is done to its end when it is back",
                station.folders.hot.display()
            )),
            Err(JobError::Retry(reason)) => {
                complain(format!("{drop} was interrupted and cannot be closed: {}", reason.what));
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

/// What became of the original of a job that nobody is at; `None` when it lies in the hot folder, so that its turn comes.
fn look_for(folders: &FolderPaths, drop: &DropId, open: &OpenJob) -> Option<Original> {
    let DropId::Hot(path) = drop else { return Some(Original::InArchive) };
    match folders::look(&folders.hot.join(path)) {
        Ok(Some(Found::File(stamp))) if open.stamp.is_of(stamp) => return None,
        _ => {}
    }
    // An empty mount point, or another share: the drop may come back with the folder it lay in.
    if open.hot.is_some() && open.hot != folders::identity(&folders.hot) {
        return Some(Original::OutOfSight);
    }
    Some(Original::Gone { filed: archived(folders, open).is_some_and(|place| is_file(&place)) })
}

/// Where the original of an interrupted job was about to go.
fn archived(folders: &FolderPaths, open: &OpenJob) -> Option<PathBuf> {
    let (Stage::Filing { to, .. }, Ok(sku)) = (&open.stage, open.sku.parse::<Sku>()) else { return None };
    Some(folders.archive.join(sku.key()).join(to))
}

/// What lies in the import folder, as far as that decides at this stage.
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

/// The temporary file of a drawing that is about to get its name.
fn temporary(folders: &FolderPaths, journal: &Journal, stage: &Stage) -> Option<PathBuf> {
    let Stage::Renaming { result, tag, .. } = stage else { return None };
    let tag = if tag.is_empty() { journal.tag() } else { tag };
    Some(temporary_of(&folders.import, tag, result))
}

fn other_import(import: &Path) -> Reason {
    let what = format!(
        "The station was interrupted while it delivered the drawing, and {} is another folder since.",
        import.display()
    );
    let remedy = "Connect the share with the import folder; or see there whether the drawing arrived, and drop it again if not.";
    Reason::new("import-other", what, remedy)
}

/// Settings that an interruption left behind when their pattern went to the archive go there, too: the next pattern of
/// that name must not take them for its own. Should one lie there already, they are its own by now.
fn leftover_sidecar_follows(folders: &FolderPaths, parking: &Parking, drop: &DropId, open: &OpenJob) {
    let DropId::Hot(path) = drop else { return };
    let path = folders.hot.join(path);
    let (true, Some(archived), Some(sidecar), Ok(None)) =
        (open.is_delivered(), archived(folders, open), sidecar_of(&path), folders::look(&path))
    else {
        return;
    };
    if is_file(&sidecar) {
        let place = archived.parent().unwrap_or(&archived);
        if let Err(error) = filing::follow(folders, parking, &sidecar, place) {
            tracing::warn!("{} stays in the hot folder: {error}", sidecar.display());
        }
    }
}

/// Removes what crashes left behind in the import folder: this station's temporary files that no job needs any more.
pub(crate) fn sweep(folders: &FolderPaths, journal: &Journal) {
    let ours = format!("{TEMPORARY_START}{}-", journal.tag());
    let needed: Vec<PathBuf> =
        journal.all_begun().iter().filter_map(|(_, open)| temporary(folders, journal, &open.stage)).collect();
    for (path, name) in temporaries(&folders.import) {
        // What bears another station's tag is that one's, however old it is.
        let is_tagged = name[TEMPORARY_START.len()..].contains('-');
        let is_left = if is_tagged { name.starts_with(&ours) } else { is_left_behind(&path) };
        if is_left && !needed.contains(&path) {
            remove_quietly(&path);
        }
    }
}

/// Removes the old temporary files that crashes left behind in the station's own folders.
pub(crate) fn sweep_own(folders: &FolderPaths) {
    let FolderPaths { archive, rejected, cache, reports, state, .. } = folders;
    for own in [archive, rejected, cache, reports, state] {
        sweep_below(own, 0);
    }
}

/// Whether nobody renamed the temporary file for so long that nobody will.
fn is_left_behind(path: &Path) -> bool {
    let written = fs::metadata(path).and_then(|metadata| metadata.modified());
    let age = written.ok().and_then(|written| SystemTime::now().duration_since(written).ok());
    age.is_some_and(|age| age > LEFT_BEHIND)
}

/// A SKU's folder lies at most two folders deep, and a numbered one in it.
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
