//! Delivers a drawing to the import folder: once, complete, and known as delivered after any crash. The [`Journal`]
//! describes the protocol.

use std::path::{Path, PathBuf};
use std::sync::MutexGuard;

use fs_err as fs;

use super::resume::{InImport, Renamed, Seen, after_a_failed_rename};
use crate::config::{DeliveryKind, FolderPaths, Repeat, Station};
use crate::files::{
    TEMPORARY_END, TEMPORARY_START, read_if_there, rename_over, sync_folder, write_flushed, write_whole,
};
use crate::hotfolder::api::{Check, Delivery, JobError};
use crate::hotfolder::error::{folder_trouble, guarded, warn_if_not_noted};
use crate::hotfolder::seen::{Identity, Stamp, folders};
use crate::hotfolder::state::{Certainty, Delivered, Job, Journal};

/// The folder in the state folder with the drawings that are in BeamConstruct while their replacements are tried.
const PREVIOUS: &str = "previous";
/// The suffix of a drawing that BeamServer imports as a trial.
pub(crate) const TRIAL_END: &str = "-trial.dxf";

/// How a drawing was delivered to the import folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum How {
    /// There was no drawing of its name.
    New,
    /// It replaced another drawing.
    Replaced,
    /// The file had the same bytes and was not written: importers treat a file that is written again as a new one.
    Unchanged,
    /// The file had the same bytes and was written again, because the settings ask for it.
    Again,
    /// The station delivered it before it was interrupted, or may have.
    BeforeTheCrash(Certainty),
    /// The share reported that renaming it failed, and contains neither the drawing nor its temporary file.
    Perhaps,
}

impl How {
    /// Whether its delivery is certain.
    pub(crate) fn certainty(self) -> Certainty {
        match self {
            Self::BeforeTheCrash(certainty) => certainty,
            Self::Perhaps => Certainty::Uncertain,
            Self::New | Self::Replaced | Self::Unchanged | Self::Again => Certainty::Certain,
        }
    }
}

/// Delivers the drawing to the import folder, after a second reader has confirmed the written file; `previous` is the
/// existing file with its name.
pub(crate) fn deliver<'a>(
    journal: impl Fn() -> MutexGuard<'a, Journal>,
    station: &Station,
    job: &Job,
    stamp: Stamp,
    made: &mut Delivery,
    previous: Option<&[u8]>,
) -> Result<How, JobError> {
    let how = match previous {
        None => How::New,
        Some(same) if same == made.drawing && station.delivery.repeat == Repeat::Always => How::Again,
        Some(same) if same == made.drawing => {
            read_back(station, made, || Ok(same.to_vec()))?;
            return Ok(How::Unchanged);
        }
        Some(_) => How::Replaced,
    };
    let import = &station.folders.import;
    if let Some(previous) = previous.filter(|previous| is_held(&journal(), station, &job.name, previous)) {
        let folder = station.folders.state.join(PREVIOUS);
        fs::create_dir_all(&folder).map_err(folder_trouble)?;
        write_whole(&folder, &job.name, previous).map_err(folder_trouble)?;
    }
    let temporary = temporary_of(import, journal().tag(), job);
    let written = write_flushed(&temporary, &made.drawing).map_err(folder_trouble);
    if let Err(error) = written.and_then(|()| read_back(station, made, || fs::read(&temporary))) {
        remove_quietly(&temporary);
        return Err(error);
    }
    let identity = folders::identity(import);
    let noted = journal().delivering(job, stamp, identity);
    let mut certainty = Certainty::Certain;
    if let Err(error) = noted.and_then(|()| rename_over(&temporary, &import.join(&job.name))) {
        let seen = look_into_import(import, &temporary, job, identity);
        // If the folder cannot be read now, the next attempt reads it.
        let Ok(seen) = seen else { return Err(folder_trouble(error)) };
        match after_a_failed_rename(seen) {
            Renamed::Yes => {}
            Renamed::Unknown => certainty = Certainty::Uncertain,
            Renamed::No | Renamed::NotVisible => {
                // While the journal may contain `delivering`, the temporary file proves that it was not delivered.
                if journal().cancelled(&job.drop).is_ok() {
                    remove_quietly(&temporary);
                }
                return Err(folder_trouble(error));
            }
        }
    }
    // An importer may already have read the drawing, so this error does not undo the delivery.
    if let Err(error) = sync_folder(import) {
        tracing::warn!("{} is in import, but a power cut may still remove it: {error}", job.name);
    }
    // If this line is lost, the folder shows the same until somebody takes the drawing away.
    let why = "the share reported that it could not rename the file";
    warn_if_not_noted(note_delivered(station, &mut journal(), job, certainty, why));
    Ok(if certainty == Certainty::Certain { how } else { How::Perhaps })
}

/// Lets the second reader check the file, if the settings ask for it; the report then states the result.
fn read_back(
    station: &Station,
    made: &mut Delivery,
    file: impl FnOnce() -> std::io::Result<Vec<u8>>,
) -> Result<(), JobError> {
    let asked = |check: &Check| station.delivery.verify.applies_to(check.vertices);
    if let Some(check) = made.check.take().filter(asked) {
        let file = file().map_err(folder_trouble)?;
        made.report = guarded(|| (check.read_back)(&file))?;
    }
    Ok(())
}

/// The state of the import folder for a drawing that was about to get its final name there; `then` is the identity of
/// the folder at that time.
pub(crate) fn look_into_import(
    import: &Path,
    temporary: &Path,
    job: &Job,
    then: Option<Identity>,
) -> std::io::Result<InImport> {
    Ok(InImport {
        temporary: folders::look(temporary)?.is_some(),
        result: match read_if_there(&import.join(&job.name))? {
            None => Seen::Nothing,
            Some(bytes) if hash_of(&bytes) == job.result => Seen::Ours,
            Some(_) => Seen::Another,
        },
        same_folder: then == folders::identity(import),
        on_network: folders::is_on_network(import),
    })
}

/// Notes that the drawing has its final name, with the certainty of that.
pub(crate) fn note_delivered(
    station: &Station,
    journal: &mut Journal,
    job: &Job,
    certainty: Certainty,
    why_uncertain: &str,
) -> std::io::Result<()> {
    journal.delivered(&job.drop, certainty)?;
    if certainty == Certainty::Uncertain {
        tracing::warn!(
            "{} may not have been delivered: {why_uncertain}, and the import folder contains neither the drawing nor its \
             temporary file. Check whether the importer took it; if not, `{}` delivers it again",
            job.name,
            retry_command(station, &job.name)
        );
    }
    Ok(())
}

/// The command that delivers an uncertain drawing again.
pub(crate) fn retry_command(station: &Station, name: &str) -> String {
    let [file, name] = [&*station.file.to_string_lossy(), name].map(crate::reason::quoted);
    format!("isomark retry {file} {name}")
}

/// Whether the drawing in the import folder is the one in BeamConstruct.
fn is_held(journal: &Journal, station: &Station, name: &str, drawing: &[u8]) -> bool {
    let is_it = |last: Delivered| last.held() == hash_of(drawing);
    station.delivery.kind == DeliveryKind::Beamserver && journal.result(name).is_some_and(is_it)
}

/// The hash of a drawing in the journal.
pub(crate) fn hash_of(drawing: &[u8]) -> String {
    blake3::hash(drawing).to_hex().to_string()
}

/// The path of a drawing's temporary file. Its name contains the station's tag, because several stations may deliver to
/// one folder.
pub(crate) fn temporary_of(import: &Path, tag: &str, job: &Job) -> PathBuf {
    import.join(format!("{TEMPORARY_START}{tag}-{}{TEMPORARY_END}", &job.key))
}

/// Removes a drawing that must not be marked from the import folder, and restores the one that is in BeamConstruct.
///
/// # Errors
/// When the journal cannot be written; then nothing is changed.
pub(crate) fn take_back(folders: &FolderPaths, journal: &mut Journal, job: &Job) -> Result<(), JobError> {
    // Noted first: the restored drawing must never be taken for the delivered one.
    journal.cancelled(&job.drop).map_err(folder_trouble)?;
    let kept = folders.state.join(PREVIOUS).join(&job.name);
    let last = journal.result(&job.name);
    let is_last = |bytes: &Vec<u8>| last.is_some_and(|last| last.held() == hash_of(bytes));
    let previous = read_if_there(&kept).ok().flatten().filter(is_last);
    match previous.map(|previous| write_whole(&folders.import, &job.name, &previous)) {
        Some(Ok(())) => {
            tracing::info!("restored the previous drawing {} in import", job.name);
            return Ok(());
        }
        Some(Err(error)) => tracing::warn!("cannot restore the previous drawing {}: {error}", job.name),
        None => {}
    }
    remove_quietly(&folders.import.join(&job.name));
    Ok(())
}

/// Removes the kept copy of the previous drawing: the new one is in BeamConstruct.
pub(crate) fn forget_previous(folders: &FolderPaths, name: &str) {
    remove_quietly(&folders.state.join(PREVIOUS).join(name));
}

/// The name of the file for the trial import; importers and this program ignore it.
pub(crate) fn trial_name(journal: &Journal) -> String {
    format!("{TEMPORARY_START}{}{TRIAL_END}", journal.tag())
}

/// Removes a hidden file; an error is only logged, because importers ignore the file and a later start removes it.
pub(crate) fn remove_quietly(path: &Path) {
    match fs::remove_file(path) {
        // A read-only disk reports this error also for a file that does not exist.
        Err(error) if fs::symlink_metadata(path).is_ok() => tracing::warn!("{error}"),
        _ => {}
    }
}
