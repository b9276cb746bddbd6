//! A drawing into the import folder: once, whole, and known for done after any crash. The protocol is that of the
//! [`journal`](super::journal).

use std::path::{Path, PathBuf};
use std::sync::MutexGuard;
use std::time::{Duration, SystemTime};

use fs_err as fs;

use super::executor::{folder_trouble, guarded};
use super::filing;
use super::folders::{self, Identity, is_file};
use super::job::{Check, Delivery, JobError};
use super::journal::{Certainty, Delivered, Import, Job, Journal, OpenJob};
use super::reprocess::ARCHIVE;
use super::settle::Stamp;
use crate::config::{DeliveryKind, FolderPaths, Repeat, Sku, Station};
use crate::files::{TEMPORARY_END, TEMPORARY_START, read_if_there, sync_folder, write_flushed, write_whole};
use crate::formats::mesh::MeshFormat;
use crate::reason::Reason;

/// Code of the reason for which drawings wait when there is no import folder.
pub(super) const IMPORT_MISSING: &str = "import-missing";
/// The folder in the state folder with the drawings that BeamConstruct holds while others of their names are tried.
const PREVIOUS: &str = "previous";
/// How the name of a drawing ends that BeamServer imports for trial.
const TRIAL_END: &str = "-trial.dxf";
/// A temporary file that nobody renamed for this long was left by a crash.
const LEFT_BEHIND: Duration = Duration::from_secs(3600);

/// How a drawing came to lie in the import folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum How {
    /// There was none of its name.
    New,
    /// It replaced another drawing.
    Replaced,
    /// The same bytes lay there and were left alone: importers take a file that is written again for a new one.
    Unchanged,
    /// The same bytes lay there and were written again, because the settings say so.
    Again,
    /// The station put it there before it was interrupted.
    BeforeTheCrash,
    /// The station may have put it there before it was interrupted.
    PerhapsBeforeTheCrash,
    /// The share reported that it could not be renamed, and holds neither it nor its temporary file.
    Perhaps,
}

/// Puts the drawing into the import folder, once a second reader has found in the written file what was meant; `previous`
/// is what lies there under its name.
pub(super) fn deliver<'a>(
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
        let seen = Evidence::seen(import, &temporary, job, identity);
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
    let noted = match certainty {
        Certainty::Certain => journal().delivered(&job.drop),
        Certainty::Uncertain => {
            perhaps_delivered(station, &mut journal(), job, "the share reported that it could not be renamed")
        }
    };
    if let Err(error) = noted {
        tracing::warn!("the journal lacks a line: {error}");
    }
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

/// What is seen in the import folder of a drawing that was about to get its name there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Evidence {
    /// Its temporary file is there.
    temporary: bool,
    result: Seen,
    /// It is the folder that it was.
    same_folder: bool,
    /// The folder is on another computer, which may have done what it reported as failed.
    on_network: bool,
}

/// What is seen under the drawing's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Seen {
    Nothing,
    Ours,
    /// Another drawing, which was to be replaced.
    Another,
}

/// Whether the drawing got its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Renamed {
    Yes,
    No,
    /// It did, and somebody took it away, or somebody removed its temporary file before.
    Unknown,
    /// The folder is another one now, such as the place of a share that is not connected.
    NotToBeSeen,
}

impl Evidence {
    fn seen(
        import: &Path,
        temporary: &Path,
        job: &Job,
        then: Option<Identity>,
    ) -> Result<Self, std::io::Error> {
        let result = import.join(&job.name);
        Ok(Self {
            temporary: folders::look(temporary)?.is_some(),
            result: match read_if_there(&result)? {
                None => Seen::Nothing,
                Some(bytes) if hash_of(&bytes) == job.result => Seen::Ours,
                Some(_) => Seen::Another,
            },
            same_folder: then == folders::identity(import),
            on_network: folders::is_on_network(import),
        })
    }
}

/// What the folder says after an interruption.
fn after_a_crash(seen: Evidence) -> Renamed {
    match seen {
        Evidence { temporary: true, .. } => Renamed::No,
        Evidence { same_folder: false, .. } => Renamed::NotToBeSeen,
        Evidence { result: Seen::Ours, .. } => Renamed::Yes,
        // Renamed, the drawing would have replaced it.
        Evidence { result: Seen::Another, .. } => Renamed::No,
        Evidence { result: Seen::Nothing, .. } => Renamed::Unknown,
    }
}

/// What the folder says after the system reported that it could not rename the drawing.
fn after_a_failed_rename(seen: Evidence) -> Renamed {
    match after_a_crash(seen) {
        // On a disk of this machine, what failed was not done: somebody removed the temporary file.
        Renamed::Unknown if !seen.on_network => Renamed::No,
        renamed => renamed,
    }
}

/// Finds out whether a drawing that was about to be renamed was renamed, and notes it.
pub(super) fn settle(
    station: &Station,
    journal: &mut Journal,
    drop: &str,
    open: &OpenJob,
    job: &Job,
) -> Result<(), JobError> {
    let import = &station.folders.import;
    import_is_there(&station.folders)?;
    let temporary = temporary_of(import, tag_of(journal, open), job);
    let seen = Evidence::seen(import, &temporary, job, open.import).map_err(folder_trouble)?;
    match (after_a_crash(seen), station.delivery.kind) {
        (Renamed::NotToBeSeen, _) => Err(JobError::Retry(other_import(import))),
        // Nobody takes drawings away from BeamServer's folder: what is not there is made anew.
        (Renamed::No, _) | (Renamed::Unknown, DeliveryKind::Beamserver) => {
            journal.cancelled(drop).map_err(folder_trouble)?;
            remove_quietly(&temporary);
            Ok(())
        }
        (Renamed::Yes, _) => journal.delivered(drop).map_err(folder_trouble),
        (Renamed::Unknown, DeliveryKind::Folder) => {
            let why = "the station was interrupted while it delivered the drawing";
            perhaps_delivered(station, journal, job, why).map_err(folder_trouble)
        }
    }
}

fn perhaps_delivered(station: &Station, journal: &mut Journal, job: &Job, why: &str) -> std::io::Result<()> {
    journal.perhaps_delivered(&job.drop)?;
    tracing::warn!(
        "{} may not have been delivered: {why}, and the import folder holds neither it nor its temporary file. See whether the importer took it; if not, \
         `{}` delivers it again",
        job.name,
        retry_command(station, &job.name)
    );
    Ok(())
}

/// What delivers an uncertain drawing again, as it is typed.
pub(super) fn retry_command(station: &Station, name: &str) -> String {
    let [file, name] = [&*station.file.to_string_lossy(), name].map(crate::reason::quoted);
    format!("isomark retry {file} {name}")
}

/// Closes a job whose drop is gone from the hot folder: its last step was done, or somebody took the drop away. An
/// archived original is never in the hot folder: it is closed, and corrected again if BeamServer was not told yet.
pub(super) fn close(
    station: &Station,
    journal: &mut Journal,
    drop: &str,
    open: &OpenJob,
) -> Result<(), JobError> {
    let folders = &station.folders;
    if let Some(job) = open.job.as_ref().filter(|_| !open.delivered) {
        settle(station, journal, drop, open, job)?;
        if !journal.is_open(drop) {
            return Ok(());
        }
    }
    let Ok(sku) = open.sku.parse::<Sku>() else {
        return journal.cancelled(drop).map_err(folder_trouble);
    };
    let archived = |to: &String| is_file(&folders.archive.join(sku.key()).join(to));
    let original = match drop.strip_prefix(&format!("{ARCHIVE}{}/", sku.key())) {
        Some(original) => original.to_owned(),
        None => open.to.clone().filter(archived).unwrap_or_default(),
    };
    match &open.job {
        Some(job) => journal.done(job, &original, imported(station, open)),
        // A pattern that was filed without a word on its drawing, as older versions did.
        None if MeshFormat::from_name(&original).is_none() => journal.cancelled(drop),
        None => {
            let part = folders.archive.join(sku.key()).join(&original);
            filing::set_current_part(folders, &sku, &part).map_err(folder_trouble)?;
            journal.learned(drop, sku.as_str(), &original)
        }
    }
    .map_err(folder_trouble)
}

/// Whether BeamConstruct holds the drawing of an interrupted job: its original is only filed after that.
pub(super) fn imported(station: &Station, open: &OpenJob) -> Import {
    match station.delivery.kind {
        DeliveryKind::Folder => Import::ByFolder,
        DeliveryKind::Beamserver if open.to.is_some() => Import::Done,
        DeliveryKind::Beamserver => Import::Due,
    }
}

/// Whether the drawing in the import folder is the one that BeamConstruct holds.
fn is_held(journal: &Journal, station: &Station, name: &str, drawing: &[u8]) -> bool {
    let is_it = |last: &Delivered| last.held() == hash_of(drawing);
    station.delivery.kind == DeliveryKind::Beamserver && journal.result(name).is_some_and(is_it)
}

/// What the journal knows a drawing by.
pub(super) fn hash_of(drawing: &[u8]) -> String {
    blake3::hash(drawing).to_hex().to_string()
}

/// Drawings wait for their import folder.
pub(super) fn import_is_there(folders: &FolderPaths) -> Result<(), JobError> {
    if folders.import.is_dir() {
        return Ok(());
    }
    let what = format!("The import folder {} does not exist.", folders.import.display());
    let remedy = "Make it, connect its share, or correct `folders.import`; the drawing is then delivered.";
    Err(JobError::Retry(Reason::new(IMPORT_MISSING, what, remedy)))
}

fn other_import(import: &Path) -> Reason {
    let what = format!(
        "The station was interrupted while it delivered the drawing, and {} is another folder since.",
        import.display()
    );
    let remedy = "Connect the share with the import folder; or see there whether the drawing arrived, and drop it again if not.";
    Reason::new("import-other", what, remedy)
}

/// Removes what crashes left behind: this station's temporary files in the import folder that no job needs any more,
/// and old ones in its own folders.
pub(super) fn sweep(folders: &FolderPaths, journal: &Journal) {
    let ours = format!("{TEMPORARY_START}{}-", journal.tag());
    let needed: Vec<PathBuf> = journal
        .all_begun()
        .iter()
        .filter_map(|(_, open)| Some((open, open.job.as_ref().filter(|_| !open.delivered)?)))
        .map(|(open, job)| temporary_of(&folders.import, tag_of(journal, open), job))
        .collect();
    for (path, name) in temporaries(&folders.import) {
        // What bears another station's tag is that one's, however old it is.
        let is_tagged = name[TEMPORARY_START.len()..].contains('-');
        let is_left = if is_tagged { name.starts_with(&ours) } else { is_left_behind(&path) };
        if is_left && !needed.contains(&path) {
            remove_quietly(&path);
        }
    }
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

/// The tag in the name of an interrupted job's temporary file.
fn tag_of<'a>(journal: &'a Journal, open: &'a OpenJob) -> &'a str {
    if open.tag.is_empty() { journal.tag() } else { &open.tag }
}

/// The name bears the station's mark, because several stations may deliver into one folder.
fn temporary_of(import: &Path, tag: &str, job: &Job) -> PathBuf {
    import.join(format!("{TEMPORARY_START}{tag}-{}{TEMPORARY_END}", &job.key))
}

/// Takes a drawing that must not be marked out of the import folder; the one that BeamConstruct holds comes back.
///
/// # Errors
/// When the journal cannot be written; nothing is changed then.
pub(super) fn take_back(folders: &FolderPaths, journal: &mut Journal, job: &Job) -> Result<(), JobError> {
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
pub(super) fn forget_previous(folders: &FolderPaths, name: &str) {
    remove_quietly(&folders.state.join(PREVIOUS).join(name));
}

/// A file of this name is imported for trial; importers and this program ignore it.
pub(super) fn trial_name(journal: &Journal) -> String {
    format!("{TEMPORARY_START}{}{TRIAL_END}", journal.tag())
}

/// What cannot be removed is hidden, ignored by importers, and removed at a later start.
pub(super) fn remove_quietly(path: &Path) {
    match fs::remove_file(path) {
        // A read-only disk says so also of what is not there.
        Err(error) if fs::symlink_metadata(path).is_ok() => tracing::warn!("{error}"),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_import_folder_decides_what_became_of_an_interrupted_delivery() {
        use Renamed::{No, NotToBeSeen, Unknown, Yes};
        use Seen::{Another, Nothing, Ours};
        for (name, result, [temporary, same_folder, on_network], crash, failed) in [
            ("not renamed yet", Nothing, [true, true, false], No, No),
            ("not renamed yet over the same", Ours, [true, true, false], No, No),
            ("there, wherever that is", Nothing, [true, false, false], No, No),
            ("renamed", Ours, [false, true, false], Yes, Yes),
            ("taken away, or never renamed", Nothing, [false, true, false], Unknown, No),
            ("the same on a share", Nothing, [false, true, true], Unknown, Unknown),
            ("the older one was not replaced", Another, [false, true, false], No, No),
            ("the same on a share", Another, [false, true, true], No, No),
            ("another folder", Nothing, [false, false, false], NotToBeSeen, NotToBeSeen),
            ("another folder with such a drawing", Ours, [false, false, true], NotToBeSeen, NotToBeSeen),
            ("another folder with another", Another, [false, false, false], NotToBeSeen, NotToBeSeen),
        ] {
            let seen = Evidence { temporary, result, same_folder, on_network };
            assert_eq!((after_a_crash(seen), after_a_failed_rename(seen)), (crash, failed), "{name}");
        }
    }
}
