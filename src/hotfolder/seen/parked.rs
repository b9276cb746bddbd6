//! Files that are done and filed, and that their writers may still hold open.
//!
//! ```text
//! state/parked/<what was filed>/<path in the hot folder>
//! ```
//!
//! A file goes on being written after it was renamed or removed, by whoever opened it before. So a drop that is done is
//! copied to its place, and the file itself is set aside for as long as a silent writer is waited for
//! (`watch.incomplete_s`). If it changes meanwhile, it goes back into the hot folder under its name, the same file, so that
//! its writer goes on writing there: it is a new drop. If it does not, it is removed. What was filed stands in the name of
//! a folder around it, so that the next start goes on from there.
//!
//! It is set aside by a rename, so on the disk of the hot folder: in the state folder if that is there, otherwise in the
//! archive, the rejected or the hot folder, hidden.
//!
//! Windows lets a program open a file so that nobody else can write it; there the file is removed at once, and one that
//! somebody has open to write stays where it is until it is closed.

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
/// Files up to this size are read before they are removed: what was written within one tick of the file system's clock
/// shows in nothing else.
const READ_AT_THE_END: u64 = 64 << 20;
/// The files that are set aside take no more than this, bytes, or the oldest is removed.
const MOST_BYTES: u64 = 4 << 30;

/// What was filed of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Filed {
    pub(crate) stamp: Stamp,
    pub(crate) hash: blake3::Hash,
}

/// All files that are set aside.
#[derive(Default)]
pub(crate) struct Parking {
    all: Mutex<Vec<Parked>>,
    /// Which folder the hot folder is.
    hot: Mutex<Option<Identity>>,
}

/// One of them.
struct Parked {
    /// The folder around it, named after what was filed.
    folder: PathBuf,
    /// Its path in the hot folder.
    relative: PathBuf,
    filed: Signature,
    /// The machine was started anew since: who wrote it then does not any more.
    outlived_its_writer: bool,
    /// As it was seen last, if it is not what was filed.
    changed: Option<(u64, Option<u128>)>,
    /// It cannot go back where it came from.
    is_stuck: bool,
    /// How long it had been set aside when `since` began.
    age: Duration,
    since: Instant,
}

/// What tells whether a file is still what was filed.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Signature {
    size: u64,
    /// Nanoseconds since 1970.
    modified: Option<u128>,
    /// The hash of the content, in hexadecimal digits.
    hash: String,
}

/// What is seen of a file that is set aside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Evidence {
    /// Size and time of the last write; `None` when it is gone.
    now: Option<(u64, Option<u128>)>,
    /// It was set aside for as long as a silent writer is waited for.
    is_over: bool,
    /// It was written before the machine was started.
    outlived_its_writer: bool,
}

/// What is to be done about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    /// Nothing yet.
    Stays,
    /// It changed since the last look: it may be in the middle of being written.
    Changes,
    /// It stands still and is not what was filed, unless its content is.
    IsAnother,
    /// Nobody writes it any more: it is removed, if its content is what was filed.
    IsOver,
    /// Somebody removed it.
    IsGone,
}

/// A file that was written after it was filed.
pub(crate) struct Returned {
    /// Its path in the hot folder.
    pub(crate) relative: PathBuf,
    /// Where it is now, if a newer drop bears its name in the hot folder.
    pub(crate) overtaken: Option<PathBuf>,
}

/// What the evidence says; `changed` is how the file was seen last, if it was not what was filed.
fn verdict(filed: &Signature, changed: Option<(u64, Option<u128>)>, seen: Evidence) -> Verdict {
    let Some(now) = seen.now else { return Verdict::IsGone };
    // A power cut leaves a file that nobody flushed shorter, and its time as it was.
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

    /// Takes up what an earlier start set aside.
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
                        // What changed while no station ran is taken as seen once.
                        changed: size_and_time(&folder.join(&relative))
                            .ok()
                            .flatten()
                            .filter(|now| *now != (filed.size, filed.modified)),
                        is_stuck: false,
                        relative,
                        filed: filed.clone(),
                        // The writer of a file on a share is another machine.
                        outlived_its_writer: its_boot != boot && !on_network,
                        age: age.unwrap_or_default(),
                        since: Instant::now(),
                    }
                }));
            }
        }
    }

    /// Takes a file out of the hot folder that was filed as `filed`. What bears its name by now and is another file stays
    /// where it is.
    ///
    /// # Errors
    /// As [`Self::stays_gone`]; and when it cannot be moved; on Windows also as long as somebody has it open to write.
    pub(crate) fn take_away(&self, folders: &FolderPaths, path: &Path, filed: &Filed) -> io::Result<()> {
        if cfg!(windows) {
            return self.remove_alone(folders, path, filed);
        }
        match look(path)? {
            Some(Found::File(stamp)) if stamp == filed.stamp => {}
            // Another drop by now.
            Some(_) => return Ok(()),
            None => return self.stays_gone(folders, path),
        }
        let relative = path.strip_prefix(&folders.hot).ok().map(Path::to_path_buf);
        let relative = relative.unwrap_or_else(|| PathBuf::from(path.file_name().unwrap_or_default()));
        let signature = Signature::of(filed);
        let mut trouble = io::Error::from(ErrorKind::CrossesDevices);
        for base in places(folders) {
            let folder = match set_aside(path, &base, &relative, &signature) {
                Ok(folder) => folder,
                Err(error) if error.kind() == ErrorKind::NotFound && look(path)?.is_none() => {
                    return self.stays_gone(folders, path);
                }
                Err(error) => {
                    trouble = error;
                    continue;
                }
            };
            let place = folder.join(&relative);
            // It may have been written since it was looked at, within one tick of the file system's clock.
            let is_another = filed.stamp.size <= READ_AT_THE_END
                && content_hash(&place).is_ok_and(|hash| hash != filed.hash);
            // No file is without a time where this one has one.
            let signature = Signature { modified: signature.modified.filter(|_| !is_another), ..signature };
            // The next start knows it by that, too.
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
            // Back in the hot folder after a power cut, it would be a new drop.
            return sync_folder(path.parent().unwrap_or(path));
        }
        Err(crate::files::named(trouble, "cannot take away", path))
    }

    /// Removes a file that nobody has open to write, if it is what was filed. Only Windows makes that certain.
    fn remove_alone(&self, folders: &FolderPaths, path: &Path, filed: &Filed) -> io::Result<()> {
        // As long as this is open, nobody can open it to write.
        let _alone = match open(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return self.stays_gone(folders, path),
            opened => opened?,
        };
        let is_filed = look(path)? == Some(Found::File(filed.stamp))
            && (filed.stamp.size > READ_AT_THE_END || content_hash(path)? == filed.hash);
        if is_filed { fs::remove_file(path) } else { Ok(()) }
    }

    /// Which folder the hot folder is, as it was seen last.
    pub(crate) fn hot_is(&self, identity: Option<Identity>) {
        *self.hot.lock().unwrap_or_else(PoisonError::into_inner) = identity;
    }

    /// A drop that somebody took away is done with what was read of it; one that went with the whole hot folder comes back
    /// with it and would be done twice.
    ///
    /// # Errors
    /// `NotFound` when the hot folder is gone, too, or another one, such as the place of a share that is not connected;
    /// `Interrupted` when it is back.
    pub(crate) fn stays_gone(&self, folders: &FolderPaths, drop: &Path) -> io::Result<()> {
        let hot = &folders.hot;
        let known = *self.hot.lock().unwrap_or_else(PoisonError::into_inner);
        let now = identity(hot);
        if now.is_none() || known.is_some_and(|known| Some(known) != now) {
            let words = format!("the hot folder {} is gone, and the drop with it", hot.display());
            return Err(io::Error::new(ErrorKind::NotFound, words));
        }
        if look(drop)?.is_some() {
            let words = format!("the hot folder {} was gone for a moment", hot.display());
            return Err(io::Error::new(ErrorKind::Interrupted, words));
        }
        Ok(())
    }

    /// Whether a file was written again that is about to go back.
    pub(crate) fn any_changes(&self) -> bool {
        self.all().iter().any(|parked| parked.changed.is_some() && !parked.is_stuck)
    }

    /// How many files are set aside.
    pub(crate) fn count(&self) -> usize {
        self.all().len()
    }

    /// Whether nothing is set aside.
    pub(crate) fn is_empty(&self) -> bool {
        self.all().is_empty()
    }

    /// Looks at everything that is set aside: brings back what was written since, and removes what was not for `silence`.
    pub(crate) fn look(&self, folders: &FolderPaths, silence: Duration) -> Vec<Returned> {
        // The others may set something aside meanwhile.
        let mut all = std::mem::take(&mut *self.all());
        let mut surplus = all.iter().map(|parked| parked.filed.size).sum::<u64>().saturating_sub(MOST_BYTES);
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
    /// Does what is to be done about it; whether it stays.
    fn look(
        &mut self,
        folders: &FolderPaths,
        silence: Duration,
        is_surplus: bool,
        returned: &mut Vec<Returned>,
    ) -> bool {
        let place = self.folder.join(&self.relative);
        // What cannot be looked at now is looked at again.
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
            // Saved again as it was, or given another time.
            Verdict::IsAnother if has_its_content() => {
                if let Some((size, modified)) = evidence.now {
                    (self.filed.size, self.filed.modified) = (size, modified);
                }
                self.changed = None;
            }
            Verdict::IsAnother => {
                self.is_stuck = !self.goes_back(folders, returned);
                return self.is_stuck;
            }
            Verdict::IsOver
                if !self.outlived_its_writer
                    && self.filed.size <= READ_AT_THE_END
                    && content_hash(&place).is_ok_and(|hash| *hash.to_hex() != *self.filed.hash) =>
            {
                self.is_stuck = !self.goes_back(folders, returned);
                return self.is_stuck;
            }
            Verdict::IsOver => match fs::remove_file(&place) {
                // It is looked at again.
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

    /// Moves it back into the hot folder; whether it is gone from here.
    fn goes_back(&self, folders: &FolderPaths, returned: &mut Vec<Returned>) -> bool {
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
                tracing::warn!("{} cannot go back into the hot folder: {error}", self.relative.display());
                return false;
            }
        };
        // What was overtaken is moved from here by whoever is told, and stays until that is done.
        let is_gone = overtaken.is_none();
        if is_gone {
            remove_empty(&self.folder);
        }
        returned.push(Returned { relative: self.relative.clone(), overtaken });
        is_gone
    }
}

impl Signature {
    fn of(filed: &Filed) -> Self {
        let Filed { stamp, hash } = filed;
        Self { size: stamp.size, modified: nanoseconds(stamp.modified), hash: hash.to_hex().to_string() }
    }

    /// The name of the folder around a file; `number` tells folders of one name apart.
    fn name(&self, boot: &str, number: u32) -> String {
        let modified = self.modified.map_or("x".to_owned(), |modified| modified.to_string());
        format!("{boot}-{}-{modified}-{}-{number}", self.size, self.hash)
    }

    /// What such a name says, and when the machine had been started.
    fn parse(name: &str) -> Option<(Self, String)> {
        let words: Vec<&str> = name.split('-').collect();
        let [boot, size, modified, hash, _] = <[&str; 5]>::try_from(words).ok()?;
        let modified = if modified == "x" { None } else { Some(modified.parse().ok()?) };
        Some((Self { size: size.parse().ok()?, modified, hash: hash.to_owned() }, boot.to_owned()))
    }
}

/// Where files may be set aside: one of them is on the disk of the hot folder.
fn places(folders: &FolderPaths) -> [PathBuf; 4] {
    let FolderPaths { hot, archive, rejected, state, .. } = folders;
    [state.join(PARKED), archive.join(HIDDEN), rejected.join(HIDDEN), hot.join(HIDDEN)]
}

/// Which start of the machine this is, as a folder's name may hold it.
fn boot() -> String {
    let boot = clock::uptime().map(|uptime| uptime.boot).unwrap_or_default();
    blake3::hash(boot.as_bytes()).to_hex()[..8].to_owned()
}

/// Renames a file into a folder of its own; returns that folder.
fn set_aside(path: &Path, base: &Path, relative: &Path, filed: &Signature) -> io::Result<PathBuf> {
    let (boot, mut number, mut tries) = (boot(), 1, 0);
    let folder = loop {
        let folder = base.join(filed.name(&boot, number));
        match fs::create_dir_all(base).and_then(|()| fs::create_dir(&folder)) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => number += 1,
            // It was removed with the last file in it.
            Err(error) if error.kind() == ErrorKind::NotFound && tries < 3 => tries += 1,
            made => break made.map(|()| folder)?,
        }
    };
    let place = folder.join(relative);
    let made = place.parent().map_or(Ok(()), fs::create_dir_all);
    // No file can have that name yet, so nothing is overwritten.
    made.and_then(|()| fs::rename(path, &place)).inspect_err(|_| remove_empty(&folder))?;
    Ok(folder)
}

/// Gives a folder around a file its name for another signature; where that cannot be, it keeps its own.
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

/// Removes the folders around a file that is gone from its place.
pub(crate) fn remove_around(place: &Path, relative: &Path) {
    if let Some(folder) = place.ancestors().nth(relative.components().count()) {
        remove_empty(folder);
    }
}

/// Removes the folder around a file that is gone, and the one with all of them if it was the last.
fn remove_empty(folder: &Path) {
    for inner in entries(folder) {
        let _ = std::fs::remove_dir(inner);
    }
    // What is not empty stays.
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
    fn what_is_seen_of_a_file_decides_what_it_is() {
        let filed = Signature { size: 7, modified: Some(100), hash: String::new() };
        let (same, longer, later) = (Some((7, Some(100))), Some((9, Some(200))), Some((7, Some(200))));
        let torn = Some((0, Some(100)));
        for (name, changed, now, is_over, outlived, expected) in [
            ("it is as it was filed", None, same, false, false, Verdict::Stays),
            ("nobody wrote it for long enough", None, same, true, false, Verdict::IsOver),
            ("somebody began to write", None, longer, false, false, Verdict::Changes),
            ("goes on writing", later, longer, false, false, Verdict::Changes),
            ("and stopped", longer, longer, false, false, Verdict::IsAnother),
            ("of the same length", later, later, false, false, Verdict::IsAnother),
            ("wrote at the very end", None, longer, true, false, Verdict::IsAnother),
            ("somebody took it away", longer, None, false, false, Verdict::IsGone),
            ("cut off within a tick of the clock", torn, torn, false, false, Verdict::IsAnother),
            ("a power cut tore it", None, torn, false, true, Verdict::IsOver),
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

    /// A hot folder with one file that is filed and set aside, and what looks at it.
    #[cfg(not(windows))]
    fn set_aside_one(folder: &Path) -> (FolderPaths, Parking) {
        let folders = folders_in(folder);
        fs::create_dir_all(folders.hot.join("can")).unwrap();
        let path = folders.hot.join("can/a.dxf");
        fs::write(&path, "first").unwrap();
        let Some(Found::File(stamp)) = look(&path).unwrap() else { panic!("a file") };
        let parking = Parking::default();
        let filed = Filed { stamp, hash: blake3::hash(b"first") };
        parking.take_away(&folders, &path, &filed).unwrap();
        assert!(!path.exists() && !parking.is_empty());
        (folders, parking)
    }

    #[cfg(not(windows))]
    #[test]
    fn only_what_is_written_again_goes_back() {
        const LONG: Duration = Duration::from_secs(3600);
        let folder = tempfile::tempdir().unwrap();
        let (folders, parking) = set_aside_one(folder.path());
        let label = entries(&folders.state.join(PARKED)).remove(0);
        let place = label.join("can/a.dxf");
        let looks = |parking: &Parking| {
            let both = [parking.look(&folders, LONG), parking.look(&folders, LONG)];
            both.into_iter().flatten().map(|returned| returned.relative).collect::<Vec<_>>()
        };
        assert!(looks(&parking).is_empty());
        // The same again, and given another time.
        fs::write(&place, "first").unwrap();
        fs::File::options().write(true).open(&place).unwrap().set_modified(UNIX_EPOCH).unwrap();
        assert!(looks(&parking).is_empty() && place.exists());
        // Another start takes it up, and sees what was written between.
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
    fn what_was_written_within_one_tick_of_the_clock_goes_back() {
        let folder = tempfile::tempdir().unwrap();
        let (folders, parking) = set_aside_one(folder.path());
        let place = entries(&folders.state.join(PARKED)).remove(0).join("can/a.dxf");
        let modified = fs::metadata(&place).unwrap().modified().unwrap();
        fs::write(&place, "FIRST").unwrap();
        fs::File::options().write(true).open(&place).unwrap().set_modified(modified).unwrap();
        assert_eq!(parking.look(&folders, Duration::ZERO).len(), 1);
        assert_eq!(fs::read_to_string(folders.hot.join("can/a.dxf")).unwrap(), "FIRST");
    }

    #[cfg(not(windows))]
    #[test]
    fn what_cannot_go_back_yet_is_not_forgotten() {
        const LONG: Duration = Duration::from_secs(3600);
        let folder = tempfile::tempdir().unwrap();
        let (folders, parking) = set_aside_one(folder.path());
        let place = entries(&folders.state.join(PARKED)).remove(0).join("can/a.dxf");
        assert!(!parking.any_changes());
        fs::write(&place, "second").unwrap();
        assert!(parking.look(&folders, LONG).is_empty() && parking.any_changes());
        fs::write(folders.hot.join("can/a.dxf"), "newer").unwrap();
        for _ in 0..2 {
            let returned = parking.look(&folders, LONG);
            assert_eq!(returned.iter().map(|one| one.overtaken.as_ref()).collect::<Vec<_>>(), [Some(&place)]);
            assert!(!parking.any_changes(), "nothing that could end waits for it");
        }
        fs::remove_file(&place).unwrap();
        assert!(parking.look(&folders, LONG).is_empty() && parking.is_empty());
    }

    #[cfg(not(windows))]
    #[test]
    fn what_was_another_when_it_was_set_aside_is_so_after_a_restart() {
        let folder = tempfile::tempdir().unwrap();
        let (folders, parking) = set_aside_one(folder.path());
        let path = folders.hot.join("can/b.dxf");
        fs::write(&path, "second").unwrap();
        let Some(Found::File(stamp)) = look(&path).unwrap() else { panic!("a file") };
        parking.take_away(&folders, &path, &Filed { stamp, hash: blake3::hash(b"another") }).unwrap();
        let next = Parking::default();
        next.restore(&folders);
        // It is taken as seen once.
        let returned = next.look(&folders, Duration::from_secs(3600));
        assert_eq!(returned.iter().map(|one| &one.relative).collect::<Vec<_>>(), [Path::new("can/b.dxf")]);
        assert!(path.exists());
    }

    #[test]
    fn what_went_with_the_hot_folder_is_not_filed() {
        let folder = tempfile::tempdir().unwrap();
        let folders = folders_in(folder.path());
        let (path, parking) = (folders.hot.join("a.dxf"), Parking::default());
        fs::create_dir_all(&folders.hot).unwrap();
        fs::write(&path, "first").unwrap();
        let Some(Found::File(stamp)) = look(&path).unwrap() else { panic!("a file") };
        let filed = Filed { stamp, hash: blake3::hash(b"first") };
        fs::rename(&folders.hot, folder.path().join("elsewhere")).unwrap();
        let gone = parking.take_away(&folders, &path, &filed).unwrap_err();
        assert_eq!(gone.kind(), ErrorKind::NotFound);
        // Somebody took the drop alone.
        fs::create_dir_all(&folders.hot).unwrap();
        parking.take_away(&folders, &path, &filed).unwrap();
        assert!(parking.is_empty());
        // An empty folder stands where the share was.
        parking.hot_is(identity(&folder.path().join("elsewhere")));
        let gone = parking.take_away(&folders, &path, &filed).unwrap_err();
        assert_eq!(gone.kind(), ErrorKind::NotFound);
    }

    #[cfg(not(windows))]
    #[test]
    fn what_nobody_writes_is_removed_in_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let (folders, parking) = set_aside_one(folder.path());
        assert!(parking.look(&folders, Duration::ZERO).is_empty());
        assert!(parking.is_empty() && !folders.state.join(PARKED).exists());
        assert_eq!(files_in(&folders.hot), Vec::<PathBuf>::new());
    }

    #[test]
    fn what_was_filed_stands_in_a_name() {
        for modified in [Some(1_767_225_600_123_456_789), None] {
            let filed = Signature { size: 12, modified, hash: "ab12".into() };
            assert_eq!(Signature::parse(&filed.name("0f", 3)), Some((filed, "0f".to_owned())));
        }
        for name in ["", "can", "a-b-c-d-e", "0f-1-2-3"] {
            assert_eq!(Signature::parse(name), None, "{name}");
        }
    }
}
