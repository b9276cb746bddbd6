//! A drawing into the import folder: once, whole, and known for done after any crash. The protocol is that of the
//! [`Journal`].

use std::path::{Path, PathBuf};
use std::sync::MutexGuard;

use fs_err as fs;

use super::resume::{InImport, Renamed, Seen, after_a_failed_rename};
use crate::config::{DeliveryKind, FolderPaths, Repeat, Station};
use crate::files::{TEMPORARY_END, TEMPORARY_START, read_if_there, sync_folder, write_flushed, write_whole};
use crate::hotfolder::api::{Check, Delivery, JobError};
use crate::hotfolder::error::{folder_trouble, guarded, tell_trouble};
use crate::hotfolder::seen::{Identity, Stamp, folders};
use crate::hotfolder::state::{Certainty, Delivered, Job, Journal};

/// The folder in the state folder with the drawings that BeamConstruct holds while others of their names are tried.
const PREVIOUS: &str = "previous";
/// How the name of a drawing ends that BeamServer imports for trial.
pub(crate) const TRIAL_END: &str = "-trial.dxf";

/// How a drawing came to lie in the import folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum How {
    /// There was none of its name.
    New,
    /// It replaced another drawing.
    Replaced,
    /// The same bytes lay there and were left alone: importers take a file that is written again for a new one.
    Unchanged,
    /// The same bytes lay there and were written again, because the settings say so.
    Again,
    /// The station put it there before it was interrupted, or may have.
    BeforeTheCrash(Certainty),
    /// The share reported that it could not be renamed, and holds neither it nor its temporary file.
    Perhaps,
}

impl How {
    /// Whether it is known to lie, or to have lain, there.
    pub(crate) fn certainty(self) -> Certainty {
        match self {
            Self::BeforeTheCrash(certainty) => certainty,
            Self::Perhaps => Certainty::Uncertain,
            Self::New | Self::Replaced | Self::Unchanged | Self::Again => Certainty::Certain,
        }
    }
}

/// Puts the drawing into the import folder, once a second reader has found in the written file what was meant; `previous`
/// is what lies there under its name.
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
    if let Err(error) = noted.and_then(|()| fs::rename(&temporary, import.join(&job.name))) {
        let seen = look_into_import(import, &temporary, job, identity);
        // What cannot be looked at now is looked at by the next try.
        let Ok(seen) = seen else { return Err(folder_trouble(error)) };
        match after_a_failed_rename(seen) {
            Renamed::Yes => {}
            Renamed::Unknown => certainty = Certainty::Uncertain,
            Renamed::No | Renamed::NotToBeSeen => {
                // As long as the journal may say `delivering`, the temporary file is what says that it was not done.
                if journal().cancelled(&job.drop).is_ok() {
                    remove_quietly(&temporary);
                }
                return Err(folder_trouble(error));
            }
        }
    }
    // Importers may have seen it.
    if let Err(error) = sync_folder(import) {
        tracing::warn!("{} lies in import, and a power cut may take it away again: {error}", job.name);
    }
    // Should this line get lost, the folder says the same as long as nobody takes the drawing away.
    let why = "the share reported that it could not be renamed";
    tell_trouble(note_delivered(station, &mut journal(), job, certainty, why));
    Ok(if certainty == Certainty::Certain { how } else { How::Perhaps })
}

/// Has the second reader check the file, if the settings ask for it; the report then states it.
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

/// What lies in the import folder of a drawing that was about to get its name there; `then` is which folder that was.
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

/// Notes that the drawing bears its name, as far as is known.
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
            "{} may not have been delivered: {why_uncertain}, and the import folder holds neither it nor its temporary file. \
             See whether the importer took it; if not, `{}` delivers it again",
            job.name,
            retry_command(station, &job.name)
        );
    }
    Ok(())
}

/// What delivers an uncertain drawing again, as it is typed.
pub(crate) fn retry_command(station: &Station, name: &str) -> String {
    let [file, name] = [&*station.file.to_string_lossy(), name].map(crate::reason::quoted);
    format!("isomark retry {file} {name}")
}

/// Whether the drawing in the import folder is the one that BeamConstruct holds.
fn is_held(journal: &Journal, station: &Station, name: &str, drawing: &[u8]) -> bool {
    let is_it = |last: Delivered| last.held() == hash_of(drawing);
    station.delivery.kind == DeliveryKind::Beamserver && journal.result(name).is_some_and(is_it)
}

/// What the journal knows a drawing by.
pub(crate) fn hash_of(drawing: &[u8]) -> String {
    blake3::hash(drawing).to_hex().to_string()
}

/// The name bears the station's mark, because several stations may deliver into one folder.
pub(crate) fn temporary_of(import: &Path, tag: &str, job: &Job) -> PathBuf {
    import.join(format!("{TEMPORARY_START}{tag}-{}{TEMPORARY_END}", &job.key))
}

/// Takes a drawing that must not be marked out of the import folder; the one that BeamConstruct holds comes back.
///
/// # Errors
/// When the journal cannot be written; nothing is changed then.
pub(crate) fn take_back(folders: &FolderPaths, journal: &mut Journal, job: &Job) -> Result<(), JobError> {
    // Noted first: what comes back must never pass for what was delivered.
    journal.cancelled(&job.drop).map_err(folder_trouble)?;
    let kept = folders.state.join(PREVIOUS).join(&job.name);
    let last = journal.result(&job.name);
    let is_last = |bytes: &Vec<u8>| last.is_some_and(|last| last.held() == hash_of(bytes));
    let previous = read_if_there(&kept).ok().flatten().filter(is_last);
    match previous.map(|previous| write_whole(&folders.import, &job.name, &previous)) {
        Some(Ok(())) => {
            tracing::info!("the drawing before it is back in import as {}", job.name);
            return Ok(());
        }
        Some(Err(error)) => tracing::warn!("the drawing before it cannot come back: {error}"),
        None => {}
    }
    remove_quietly(&folders.import.join(&job.name));
    Ok(())
}

/// The drawing is what BeamConstruct holds now: the one before it is not needed any more.
pub(crate) fn forget_previous(folders: &FolderPaths, name: &str) {
    remove_quietly(&folders.state.join(PREVIOUS).join(name));
}

/// A file of this name is imported for trial; importers and this program ignore it.
pub(crate) fn trial_name(journal: &Journal) -> String {
    format!("{TEMPORARY_START}{}{TRIAL_END}", journal.tag())
}

/// What cannot be removed is hidden, ignored by importers, and removed at a later start.
pub(crate) fn remove_quietly(path: &Path) {
    match fs::remove_file(path) {
        // A read-only disk says so also of what is not there.
        Err(error) if fs::symlink_metadata(path).is_ok() => tracing::warn!("{error}"),
        _ => {}
    }
}
