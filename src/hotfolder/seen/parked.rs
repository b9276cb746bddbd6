//! Files that are filed, but that their writers may still have open.
//!
//! ```text
//! state/parked/<signature of the filed content>/<path in the hot folder>
//! ```
//!
//! A program that has a file open can write to it even after the file was renamed or removed. So a processed drop is
//! copied to its place, and the file itself is parked for `watch.incomplete_s`. If it changes meanwhile, the same file
//! is moved back into the hot folder under its name, so that its writer continues there: it is a new drop. If it does
//! not change, it is removed. A folder around the file is named after the filed content, so that the next start can
//! continue.
//!
//! A file is parked by a rename, so it stays on the disk of the hot folder: in the state folder if that is on the same
//! disk, otherwise in a hidden folder in the archive, the rejected or the hot folder.
//!
//! On Windows, a program can open a file so that no other program can write to it. So there the file is removed at
//! once, and a file that another program has open for writing stays in the hot folder until it is closed.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use fs_err as fs;

use super::folders::{content_hash, identity, is_on_network, look, move_new, open};
use super::{Found, Identity, Stamp};
use crate::config::FolderPaths;
use crate::files::sync_folder;
use crate::hotfolder::clock;

/// The folder in the state folder, and the hidden one elsewhere.
const PARKED: &str = "parked";
const HIDDEN: &str = ".isomark-parked";
/// Files up to this size are read before they are removed: a change within one tick of the file system's clock is
/// visible only in the content.
const READ_AT_THE_END: u64 = 64 << 20;
/// The largest total size of the parked files, bytes; above it, the oldest are removed.
const MAX_BYTES: u64 = 4 << 30;

/// The filed content of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Filed {
    pub(crate) stamp: Stamp,
    pub(crate) hash: blake3::Hash,
}

/// All parked files.
#[derive(Default)]
pub(crate) struct Parking {
    all: Mutex<Vec<Parked>>,
    /// The identity of the hot folder.
    hot: Mutex<Option<Identity>>,
}

/// A parked file.
struct Parked {
    /// The folder around it, named after the filed content.
    folder: PathBuf,
    /// Its path in the hot folder.
    relative: PathBuf,
    filed: Signature,
    /// The machine was restarted since, so the writer of the file has ended.
    outlived_its_writer: bool,
    /// Size and time of the file at the last check, if it differs from the filed one.
    changed: Option<(u64, Option<u128>)>,
    /// It could not be moved back into the hot folder.
    is_stuck: bool,
    /// How long it had been parked at `since`.
    age: Duration,
    since: Instant,
}

/// Shows whether a file still has the filed content.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Signature {
    size: u64,
    /// Nanoseconds since 1970.
    modified: Option<u128>,
    /// The hash of the content, in hexadecimal digits.
    hash: String,
}

/// What is known about a parked file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Evidence {
    /// Size and time of the last write; `None` if the file was removed.
    now: Option<(u64, Option<u128>)>,
    /// It has been parked for the whole waiting time.
    is_over: bool,
    /// It was written before the machine was started.
    outlived_its_writer: bool,
}

/// What to do with a parked file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    /// Keep it.
    Stays,
    /// Wait: it changed since the last check, and may still be written.
    Changes,
    /// It changed and has settled: move it back, unless its content is the filed one.
    IsAnother,
    /// Its time is over: remove it, if its content is the filed one.
    IsOver,
    /// Forget it: somebody removed it.
    IsGone,
}

/// A file that was written after it was filed.
pub(crate) struct Returned {
    /// Its path in the hot folder.
    pub(crate) relative: PathBuf,
    /// Where it is now, if a newer drop has its name in the hot folder.
    pub(crate) overtaken: Option<PathBuf>,
}

/// Decides what to do with a file; `changed` is its state at the last check, if that differed from the filed one.
fn verdict(filed: &Signature, changed: Option<(u64, Option<u128>)>, seen: Evidence) -> Verdict {
    let Some(now) = seen.now else { return Verdict::IsGone };
    // After a power cut, a file that was not flushed may be shorter, with its time unchanged.
    let is_torn = seen.outlived_its_writer && now.1.is_some() && now.1 == filed.modified;
    if now == (filed.size, filed.modified) || is_torn {
        return if seen.is_over || is_torn { Verdict::IsOver } else { Verdict::Stays };
    }
    if changed == Some(now) || seen.is_over { Verdict::IsAnother } else { Verdict::Changes }
}

impl Parking {
    fn all(&self) -> MutexGuard<'_, Vec<Parked>> {
        self.all.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Finds the files that were parked before this start.
    pub(crate) fn restore(&self, folders: &FolderPaths) {
        let (boot, on_network) = (boot(), is_on_network(&folders.hot));
        for base in places(folders) {
            for folder in entries(&base) {
                let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
                let Some((filed, its_boot)) = Signature::parse(&name) else { continue };
                let written = fs::metadata(&folder).and_then(|metadata| metadata.modified()).ok();
                let age = written.and_then(|written| SystemTime::now().duration_since(written).ok());
                let mut all = self.all();
                if all.iter().any(|parked| parked.folder == folder) {
                    continue;
                }
                let files = files_in(&folder);
                if files.is_empty() {
                    remove_empty(&folder);
                }
                all.extend(files.into_iter().map(|relative| {
                    Parked {
                        folder: folder.clone(),
                        // A change while no station was running is treated as seen once.
                        changed: size_and_time(&folder.join(&relative))
                            .ok()
                            .flatten()
                            .filter(|now| *now != (filed.size, filed.modified)),
                        is_stuck: false,
                        relative,
                        filed: filed.clone(),
                        // The writer of a file on a share may be another machine, which was not restarted.
                        outlived_its_writer: its_boot != boot && !on_network,
                        age: age.unwrap_or_default(),
                        since: Instant::now(),
                    }
                }));
            }
        }
    }

    /// Removes a file from the hot folder that was filed as `filed`. If a different file has its name now, that one
    /// stays.
    ///
    /// # Errors
    /// As [`Self::check_removed`]; when it cannot be moved; on Windows also while another program has it open for
    /// writing.
    pub(crate) fn take_out(&self, folders: &FolderPaths, path: &Path, filed: &Filed) -> io::Result<()> {
        if cfg!(windows) {
            return self.remove_exclusively(folders, path, filed);
        }
        match look(path)? {
            Some(Found::File(stamp)) if stamp == filed.stamp => {}
            // This is another drop now.
            Some(_) => return Ok(()),
            None => return self.check_removed(folders, path),
        }
        let relative = path.strip_prefix(&folders.hot).ok().map(Path::to_path_buf);
        let relative = relative.unwrap_or_else(|| PathBuf::from(path.file_name().unwrap_or_default()));
        let signature = Signature::of(filed);
        let mut trouble = io::Error::from(ErrorKind::CrossesDevices);
        for base in places(folders) {
            let folder = match set_aside(path, &base, &relative, &signature) {
                Ok(folder) => folder,
                Err(error) if error.kind() == ErrorKind::NotFound && look(path)?.is_none() => {
                    return self.check_removed(folders, path);
                }
                Err(error) => {
                    trouble = error;
                    continue;
                }
            };
            let place = folder.join(&relative);
            // It may have been written since it was read, within one tick of the file system's clock.
            let is_another = filed.stamp.size <= READ_AT_THE_END
                && content_hash(&place).is_ok_and(|hash| hash != filed.hash);
            // A signature without a time never matches a file that has a time, so the file is known as changed.
            let signature = Signature { modified: signature.modified.filter(|_| !is_another), ..signature };
            // The next start reads the same from the name of the folder.
            let folder = if is_another { renamed(folder, &base, &signature) } else { folder };
            let place = folder.join(&relative);
            self.all().push(Parked {
                folder,
                relative,
                filed: signature,
                outlived_its_writer: false,
                changed: size_and_time(&place).ok().flatten().filter(|_| is_another),
                is_stuck: false,
                age: Duration::ZERO,
                since: Instant::now(),
            });
            // Without the flush, a power cut could bring it back into the hot folder as a new drop.
            return sync_folder(path.parent().unwrap_or(path));
        }
        Err(crate::files::named(trouble, "cannot remove", path))
    }

    /// Removes a file that no other program has open for writing, if it has the filed content. Only Windows can ensure
    /// this.
    fn remove_exclusively(&self, folders: &FolderPaths, path: &Path, filed: &Filed) -> io::Result<()> {
        // While this handle is open, no other program can open the file for writing.
        let _exclusive = match open(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return self.check_removed(folders, path),
            opened => opened?,
        };
        let is_filed = look(path)? == Some(Found::File(filed.stamp))
            && (filed.stamp.size > READ_AT_THE_END || content_hash(path)? == filed.hash);
        if is_filed { fs::remove_file(path) } else { Ok(()) }
    }

    /// Sets the identity of the hot folder, as it was seen last.
    pub(crate) fn set_hot(&self, identity: Option<Identity>) {
        *self.hot.lock().unwrap_or_else(PoisonError::into_inner) = identity;
    }

    /// Checks that a missing drop was removed alone: then it is filed with the content that was read. A drop that is
    /// missing because the whole hot folder is not available returns with the folder, and would be processed twice.
    ///
    /// # Errors
    /// `NotFound` when the hot folder is not available or is a different one, such as an empty mount point;
    /// `Interrupted` when it is available again.
    pub(crate) fn check_removed(&self, folders: &FolderPaths, drop: &Path) -> io::Result<()> {
        let hot = &folders.hot;
        let known = *self.hot.lock().unwrap_or_else(PoisonError::into_inner);
        let now = identity(hot);
        if now.is_none() || known.is_some_and(|known| Some(known) != now) {
            let message = format!("the hot folder {}, with the drop, is not available", hot.display());
            return Err(io::Error::new(ErrorKind::NotFound, message));
        }
        if look(drop)?.is_some() {
            let message = format!("the hot folder {} was not available for a moment", hot.display());
            return Err(io::Error::new(ErrorKind::Interrupted, message));
        }
        Ok(())
    }

    /// Whether a file was written again and is about to be moved back.
    pub(crate) fn any_changes(&self) -> bool {
        self.all().iter().any(|parked| parked.changed.is_some() && !parked.is_stuck)
    }

    /// The number of parked files.
    pub(crate) fn count(&self) -> usize {
        self.all().len()
    }

    /// A folder with parked files.
    pub(crate) fn folder(&self) -> Option<PathBuf> {
        self.all().first().and_then(|parked| parked.folder.parent()).map(Path::to_path_buf)
    }

    /// Whether no file is parked.
    pub(crate) fn is_empty(&self) -> bool {
        self.all().is_empty()
    }

    /// Checks all parked files: moves those back that were written since, and removes those that did not change for
    /// `silence`.
    pub(crate) fn look(&self, folders: &FolderPaths, silence: Duration) -> Vec<Returned> {
        // Other threads may park more files meanwhile.
        let mut all = std::mem::take(&mut *self.all());
        let mut surplus = all.iter().map(|parked| parked.filed.size).sum::<u64>().saturating_sub(MAX_BYTES);
        let mut returned = Vec::new();
        all.retain_mut(|parked| {
            let is_surplus = surplus > 0;
            surplus = surplus.saturating_sub(if is_surplus { parked.filed.size } else { 0 });
            parked.look(folders, silence, is_surplus, &mut returned)
        });
        self.all().splice(0..0, all);
        returned
    }
}

impl Parked {
    /// Checks the file and handles it; returns whether it stays parked.
    fn look(
        &mut self,
        folders: &FolderPaths,
        silence: Duration,
        is_surplus: bool,
        returned: &mut Vec<Returned>,
    ) -> bool {
        let place = self.folder.join(&self.relative);
        // A file that cannot be checked now is checked again.
        let Ok(now) = size_and_time(&place) else { return true };
        let evidence = Evidence {
            now,
            is_over: is_surplus || self.age + self.since.elapsed() >= silence,
            outlived_its_writer: self.outlived_its_writer,
        };
        let verdict = verdict(&self.filed, self.changed, evidence);
        let has_its_content = || content_hash(&place).is_ok_and(|hash| *hash.to_hex() == *self.filed.hash);
        match verdict {
            Verdict::Stays => self.changed = None,
            Verdict::Changes => self.changed = evidence.now,
            // It was saved again unchanged, or only its time was changed.
            Verdict::IsAnother if has_its_content() => {
                if let Some((size, modified)) = evidence.now {
                    (self.filed.size, self.filed.modified) = (size, modified);
                }
                self.changed = None;
            }
            Verdict::IsAnother => {
                self.is_stuck = !self.move_back(folders, returned);
                return self.is_stuck;
            }
            Verdict::IsOver
                if !self.outlived_its_writer
                    && self.filed.size <= READ_AT_THE_END
                    && content_hash(&place).is_ok_and(|hash| *hash.to_hex() != *self.filed.hash) =>
            {
                self.is_stuck = !self.move_back(folders, returned);
                return self.is_stuck;
            }
            Verdict::IsOver => match fs::remove_file(&place) {
                // It is checked again.
                Err(error) if error.kind() != ErrorKind::NotFound => {
                    tracing::debug!("{error}");
                    return true;
                }
                _ => {
                    remove_empty(&self.folder);
                    return false;
                }
            },
            Verdict::IsGone => {
                remove_empty(&self.folder);
                return false;
            }
        }
        true
    }

    /// Moves it back into the hot folder; returns whether it is no longer parked.
    fn move_back(&self, folders: &FolderPaths, returned: &mut Vec<Returned>) -> bool {
        let (place, target) = (self.folder.join(&self.relative), folders.hot.join(&self.relative));
        if !folders.hot.is_dir() {
            return false;
        }
        let parent = target.parent().unwrap_or(&folders.hot);
        let moved = crate::files::make_folder(parent).and_then(|()| move_new(&place, &target));
        let overtaken = match moved {
            Ok(()) => None,
            Err(error) if error.kind() == ErrorKind::AlreadyExists => Some(place),
            Err(error) => {
                tracing::warn!("cannot move {} back into the hot folder: {error}", self.relative.display());
                return false;
            }
        };
        // The caller rejects an overtaken file, which stays parked until then.
        let is_moved = overtaken.is_none();
        if is_moved {
            remove_empty(&self.folder);
        }
        returned.push(Returned { relative: self.relative.clone(), overtaken });
        is_moved
    }
}

impl Signature {
    fn of(filed: &Filed) -> Self {
        let Filed { stamp, hash } = filed;
        Self { size: stamp.size, modified: nanoseconds(stamp.modified), hash: hash.to_hex().to_string() }
    }

    /// The name of the folder around a file; `number` distinguishes folders with the same signature.
    fn name(&self, boot: &str, number: u32) -> String {
        let modified = self.modified.map_or("x".to_owned(), |modified| modified.to_string());
        format!("{boot}-{}-{modified}-{}-{number}", self.size, self.hash)
    }

    /// Reads such a name: the signature, and the start of the machine.
    fn parse(name: &str) -> Option<(Self, String)> {
        let words: Vec<&str> = name.split('-').collect();
        let [boot, size, modified, hash, _] = <[&str; 5]>::try_from(words).ok()?;
        let modified = if modified == "x" { None } else { Some(modified.parse().ok()?) };
        Some((Self { size: size.parse().ok()?, modified, hash: hash.to_owned() }, boot.to_owned()))
    }
}

/// The folders where files may be parked: at least one of them is on the disk of the hot folder.
fn places(folders: &FolderPaths) -> [PathBuf; 4] {
    let FolderPaths { hot, archive, rejected, state, .. } = folders;
    [state.join(PARKED), archive.join(HIDDEN), rejected.join(HIDDEN), hot.join(HIDDEN)]
}

/// The identity of this start of the machine, in a form for the name of a folder.
fn boot() -> String {
    let boot = clock::uptime().map(|uptime| uptime.boot).unwrap_or_default();
    blake3::hash(boot.as_bytes()).to_hex()[..8].to_owned()
}

/// Renames a file into its own new folder; returns that folder.
fn set_aside(path: &Path, base: &Path, relative: &Path, filed: &Signature) -> io::Result<PathBuf> {
    let (boot, mut number, mut tries) = (boot(), 1, 0);
    let folder = loop {
        let folder = base.join(filed.name(&boot, number));
        match fs::create_dir_all(base).and_then(|()| fs::create_dir(&folder)) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => number += 1,
            // Another thread removed `base` with the last file in it.
            Err(error) if error.kind() == ErrorKind::NotFound && tries < 3 => tries += 1,
            made => break made.map(|()| folder)?,
        }
    };
    let place = folder.join(relative);
    let made = place.parent().map_or(Ok(()), fs::create_dir_all);
    // The folder is new, so nothing is overwritten.
    made.and_then(|()| fs::rename(path, &place)).inspect_err(|_| remove_empty(&folder))?;
    Ok(folder)
}

/// Renames the folder around a file for another signature; if that fails, it keeps its name.
fn renamed(folder: PathBuf, base: &Path, filed: &Signature) -> PathBuf {
    let boot = boot();
    let free = (1..100).map(|number| base.join(filed.name(&boot, number))).find(|other| !other.exists());
    free.filter(|other| fs::rename(&folder, other).is_ok()).unwrap_or(folder)
}

/// The files in a folder around a parked file and in the SKU folders in it, relative to it.
fn files_in(folder: &Path) -> Vec<PathBuf> {
    let is_folder = |path: &PathBuf| matches!(look(path), Ok(Some(Found::Folder)));
    let (folders, mut files): (Vec<_>, Vec<_>) = entries(folder).into_iter().partition(is_folder);
    files.extend(folders.iter().flat_map(|inner| entries(inner)).filter(|path| !is_folder(path)));
    files.iter().filter_map(|path| path.strip_prefix(folder).ok().map(Path::to_path_buf)).collect()
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect()
}

/// Removes the folders around a parked file that was moved away.
pub(crate) fn remove_around(place: &Path, relative: &Path) {
    if let Some(folder) = place.ancestors().nth(relative.components().count()) {
        remove_empty(folder);
    }
}

/// Removes the empty folder around a former file, and the folder with all of them if it was the last.
fn remove_empty(folder: &Path) {
    for inner in entries(folder) {
        let _ = std::fs::remove_dir(inner);
    }
    // The system refuses to remove a folder that is not empty.
    if std::fs::remove_dir(folder).is_ok()
        && let Some(base) = folder.parent()
    {
        let _ = std::fs::remove_dir(base);
    }
}

fn size_and_time(path: &Path) -> io::Result<Option<(u64, Option<u128>)>> {
    Ok(match look(path)? {
        Some(Found::File(stamp)) => Some((stamp.size, nanoseconds(stamp.modified))),
        _ => None,
    })
}

fn nanoseconds(time: Option<SystemTime>) -> Option<u128> {
    time.and_then(|time| time.duration_since(UNIX_EPOCH).ok()).map(|since| since.as_nanos())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_evidence_decides_about_a_parked_file() {
        let filed = Signature { size: 7, modified: Some(100), hash: String::new() };
        let (same, longer, later) = (Some((7, Some(100))), Some((9, Some(200))), Some((7, Some(200))));
        let torn = Some((0, Some(100)));
        for (name, changed, now, is_over, outlived, expected) in [
            ("unchanged", None, same, false, false, Verdict::Stays),
            ("unchanged for the whole time", None, same, true, false, Verdict::IsOver),
            ("a writer has started", None, longer, false, false, Verdict::Changes),
            ("the writer continues", later, longer, false, false, Verdict::Changes),
            ("the writer stopped", longer, longer, false, false, Verdict::IsAnother),
            ("changed, with the same length", later, later, false, false, Verdict::IsAnother),
            ("written at the end of the time", None, longer, true, false, Verdict::IsAnother),
            ("removed by somebody", longer, None, false, false, Verdict::IsGone),
            ("truncated within a tick of the clock", torn, torn, false, false, Verdict::IsAnother),
            ("truncated by a power cut", None, torn, false, true, Verdict::IsOver),
            ("written before the power cut", longer, longer, false, true, Verdict::IsAnother),
        ] {
            let seen = Evidence { now, is_over, outlived_its_writer: outlived };
            assert_eq!(verdict(&filed, changed, seen), expected, "{name}");
        }
    }

    fn folders_in(folder: &Path) -> FolderPaths {
        let [hot, import, archive, rejected, cache, reports, skus, state] =
            ["hot", "import", "archive", "rejected", "cache", "reports", "skus", "state"]
                .map(|name| folder.join(name));
        FolderPaths { hot, import, archive, rejected, cache, reports, skus, state }
    }

    /// A hot folder with one file that is filed and parked.
    #[cfg(not(windows))]
    fn park_one(folder: &Path) -> (FolderPaths, Parking) {
        let folders = folders_in(folder);
        fs::create_dir_all(folders.hot.join("can")).unwrap();
        let path = folders.hot.join("can/a.dxf");
        fs::write(&path, "first").unwrap();
        let Some(Found::File(stamp)) = look(&path).unwrap() else { panic!("a file") };
        let parking = Parking::default();
        let filed = Filed { stamp, hash: blake3::hash(b"first") };
        parking.take_out(&folders, &path, &filed).unwrap();
        assert!(!path.exists() && !parking.is_empty());
        (folders, parking)
    }

    #[cfg(not(windows))]
    #[test]
    fn only_files_that_are_written_again_are_moved_back() {
        const LONG: Duration = Duration::from_secs(3600);
        let folder = tempfile::tempdir().unwrap();
        let (folders, parking) = park_one(folder.path());
        let label = entries(&folders.state.join(PARKED)).remove(0);
        let place = label.join("can/a.dxf");
        let looks = |parking: &Parking| {
            let both = [parking.look(&folders, LONG), parking.look(&folders, LONG)];
            both.into_iter().flatten().map(|returned| returned.relative).collect::<Vec<_>>()
        };
        assert!(looks(&parking).is_empty());
        // Written with the same content, and with a different time.
        fs::write(&place, "first").unwrap();
        fs::File::options().write(true).open(&place).unwrap().set_modified(UNIX_EPOCH).unwrap();
        assert!(looks(&parking).is_empty() && place.exists());
        // Another start finds it, and the change made between the starts.
        fs::write(&place, "second").unwrap();
        let next = Parking::default();
        next.restore(&folders);
        next.restore(&folders);
        assert_eq!(looks(&next), [Path::new("can/a.dxf")]);
        assert_eq!(fs::read_to_string(folders.hot.join("can/a.dxf")).unwrap(), "second");
        assert!(next.is_empty() && !folders.state.join(PARKED).exists());
    }

    #[cfg(not(windows))]
    #[test]
    fn a_change_within_one_tick_of_the_clock_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let (folders, parking) = park_one(folder.path());
        let place = entries(&folders.state.join(PARKED)).remove(0).join("can/a.dxf");
        let modified = fs::metadata(&place).unwrap().modified().unwrap();
        fs::write(&place, "FIRST").unwrap();
        fs::File::options().write(true).open(&place).unwrap().set_modified(modified).unwrap();
        assert_eq!(parking.look(&folders, Duration::ZERO).len(), 1);
        assert_eq!(fs::read_to_string(folders.hot.join("can/a.dxf")).unwrap(), "FIRST");
    }

    #[cfg(not(windows))]
    #[test]
    fn a_file_that_cannot_be_moved_back_yet_is_not_forgotten() {
        const LONG: Duration = Duration::from_secs(3600);
        let folder = tempfile::tempdir().unwrap();
        let (folders, parking) = park_one(folder.path());
        let place = entries(&folders.state.join(PARKED)).remove(0).join("can/a.dxf");
        assert!(!parking.any_changes());
        fs::write(&place, "second").unwrap();
        assert!(parking.look(&folders, LONG).is_empty() && parking.any_changes());
        fs::write(folders.hot.join("can/a.dxf"), "newer").unwrap();
        for _ in 0..2 {
            let returned = parking.look(&folders, LONG);
            assert_eq!(returned.iter().map(|one| one.overtaken.as_ref()).collect::<Vec<_>>(), [Some(&place)]);
            assert!(!parking.any_changes(), "a station that runs once does not wait for it");
        }
        fs::remove_file(&place).unwrap();
        assert!(parking.look(&folders, LONG).is_empty() && parking.is_empty());
    }

    #[cfg(not(windows))]
    #[test]
    fn a_file_that_changed_before_it_was_parked_returns_after_a_restart() {
        let folder = tempfile::tempdir().unwrap();
        let (folders, parking) = park_one(folder.path());
        let path = folders.hot.join("can/b.dxf");
        fs::write(&path, "second").unwrap();
        let Some(Found::File(stamp)) = look(&path).unwrap() else { panic!("a file") };
        parking.take_out(&folders, &path, &Filed { stamp, hash: blake3::hash(b"another") }).unwrap();
        let next = Parking::default();
        next.restore(&folders);
        // The change is treated as seen once.
        let returned = next.look(&folders, Duration::from_secs(3600));
        assert_eq!(returned.iter().map(|one| &one.relative).collect::<Vec<_>>(), [Path::new("can/b.dxf")]);
        assert!(path.exists());
    }

    #[test]
    fn a_drop_that_vanished_with_the_hot_folder_is_not_filed() {
        let folder = tempfile::tempdir().unwrap();
        let folders = folders_in(folder.path());
        let (path, parking) = (folders.hot.join("a.dxf"), Parking::default());
        fs::create_dir_all(&folders.hot).unwrap();
        fs::write(&path, "first").unwrap();
        let Some(Found::File(stamp)) = look(&path).unwrap() else { panic!("a file") };
        let filed = Filed { stamp, hash: blake3::hash(b"first") };
        fs::rename(&folders.hot, folder.path().join("elsewhere")).unwrap();
        let gone = parking.take_out(&folders, &path, &filed).unwrap_err();
        assert_eq!(gone.kind(), ErrorKind::NotFound);
        // Somebody removed only the drop.
        fs::create_dir_all(&folders.hot).unwrap();
        parking.take_out(&folders, &path, &filed).unwrap();
        assert!(parking.is_empty());
        // An empty folder replaces the share.
        parking.set_hot(identity(&folder.path().join("elsewhere")));
        let gone = parking.take_out(&folders, &path, &filed).unwrap_err();
        assert_eq!(gone.kind(), ErrorKind::NotFound);
    }

    #[cfg(not(windows))]
    #[test]
    fn a_file_that_nobody_writes_is_removed_in_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let (folders, parking) = park_one(folder.path());
        assert!(parking.look(&folders, Duration::ZERO).is_empty());
        assert!(parking.is_empty() && !folders.state.join(PARKED).exists());
        assert_eq!(files_in(&folders.hot), Vec::<PathBuf>::new());
    }

    #[test]
    fn a_signature_is_written_and_read_as_a_name() {
        for modified in [Some(1_767_225_600_123_456_789), None] {
            let filed = Signature { size: 12, modified, hash: "ab12".into() };
            assert_eq!(Signature::parse(&filed.name("0f", 3)), Some((filed, "0f".to_owned())));
        }
        for name in ["", "can", "a-b-c-d-e", "0f-1-2-3"] {
            assert_eq!(Signature::parse(name), None, "{name}");
        }
    }
}
