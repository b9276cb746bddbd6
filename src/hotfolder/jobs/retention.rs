//! Removes old reports, archived originals and rejected drops, and keeps the journal short.
//!
//! A separate thread does this, so that no drop waits for it. It removes only files that a station filed:
//! reports by their suffixes, rejected drops by their reasons, and in a SKU's archive the drawings that are
//! in the journal and the files in numbered folders. Before an archived original is removed, its entry is
//! removed from the journal.

use std::collections::{BTreeMap, BTreeSet, BinaryHeap};
use std::ffi::OsString;
use std::fs::Metadata;
use std::io;
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use fs_err as fs;

use super::filing::{LIST_REPORT, REPORT, current_part_note, noted_part};
use super::recovery::sweep_own;
use super::rejected::{self, REASON};
use crate::config::{FolderPaths, Retention, Sku, Station};
use crate::formats::pattern::is_drawing;
use crate::hotfolder::api::PictureKind;
use crate::hotfolder::clock;
use crate::hotfolder::seen::names::CURRENT_PART;
use crate::hotfolder::seen::{Meaning, StopSignal, is_sidecar, meaning, sidecar_of};
use crate::hotfolder::state::status::{Kept, Status};
use crate::hotfolder::state::{Journal, keep_short, with_slashes};
use crate::printable::on_one_line;

/// Time between the start of a station and its first pass over the folders.
const FIRST_PAUSE: Duration = Duration::from_secs(60);
/// Time between two passes over the folders.
const PAUSE: Duration = Duration::from_secs(3600);
/// Time between two checks of the length of the journal.
const JOURNAL_PAUSE: Duration = Duration::from_secs(1);
/// After a longer time without running, the clock may have been set forward: the station removes nothing for a day.
const LONGEST_REST: Duration = Duration::from_secs(30 * 86_400);
const DAY: Duration = Duration::from_secs(86_400);
/// The number of oldest files that one pass remembers as candidates for freeing space.
const MAX_CANDIDATES: usize = 10_000;

/// Keeps the folders within the limits of the settings.
pub(crate) struct Keeper {
    shared: Mutex<Shared>,
    wake: Condvar,
    ends: AtomicBool,
    stop: StopSignal,
    /// When the station was started, by the time of day and by the monotonic clock.
    started: (SystemTime, Instant),
    /// Whether the time of day is plausible, compared with the last run of the station.
    clock_is_known: bool,
}

/// Ends the keeper's work when it is dropped.
pub(crate) struct Ends<'k>(&'k Keeper);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.end();
    }
}

struct Shared {
    folders: FolderPaths,
    retention: Retention,
    is_new: bool,
    kept: Option<Kept>,
}

impl Keeper {
    pub(crate) fn new(station: &Station, state: &Path, stop: StopSignal) -> Self {
        let (folders, retention) = (station.folders.clone(), station.retention.clone());
        let shared = Shared { folders, retention, is_new: true, kept: None };
        let now = SystemTime::now();
        let last = Status::read(state).ok().flatten().map(|status| status.at);
        let earliest = clock::timestamp(now.checked_sub(LONGEST_REST).unwrap_or(SystemTime::UNIX_EPOCH));
        let clock_is_known = last.as_ref().is_some_and(|last| *last >= earliest);
        if let Some(last) = last.filter(|_| !clock_is_known) {
            tracing::warn!(
                "waiting a day before removing old files: the station last ran at {last}. Check the clock of this computer"
            );
        }
        Self {
            shared: Mutex::new(shared),
            wake: Condvar::new(),
            ends: AtomicBool::new(false),
            stop,
            started: (now, Instant::now()),
            clock_is_known,
        }
    }

    /// Ends the keeper's work when the returned guard is dropped.
    pub(crate) fn end_on_drop(&self) -> Ends<'_> {
        Ends(self)
    }

    fn has_ended(&self) -> bool {
        self.ends.load(Ordering::Acquire) || self.stop.is_raised()
    }

    fn shared(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes over the station's settings, which may have changed.
    pub(crate) fn follow(&self, station: &Station) {
        let mut shared = self.shared();
        if shared.folders != station.folders || shared.retention != station.retention {
            shared.folders = station.folders.clone();
            shared.retention = station.retention.clone();
            shared.is_new = true;
            self.wake.notify_all();
        }
    }

    /// Ends the keeper's threads.
    pub(crate) fn end(&self) {
        self.ends.store(true, Ordering::Release);
        // With the lock taken once, no thread can be between its check of the flag and its wait.
        drop(self.shared());
        self.wake.notify_all();
    }

    /// The result of the last pass over the folders.
    pub(crate) fn kept(&self) -> Option<Kept> {
        self.shared().kept.clone()
    }

    /// Rewrites the journal whenever it has become long, until the station ends.
    pub(crate) fn keep_journal_short<'j>(&self, journal: impl Fn() -> MutexGuard<'j, Journal>) {
        while !self.has_ended() {
            keep_short(&journal);
            let is_running = |_: &mut Shared| !self.has_ended();
            drop(self.wake.wait_timeout_while(self.shared(), JOURNAL_PAUSE, is_running));
        }
    }

    /// Passes over the folders some time after the start, after each change of the settings and then every hour, until
    /// the station ends. With `once`, there is one pass, at the start.
    pub(crate) fn run<'j>(&self, journal: impl Fn() -> MutexGuard<'j, Journal>, once: bool) {
        let folders = self.shared().folders.clone();
        sweep_own(&folders);
        if !once {
            // The drops in the hot folder are processed first.
            let is_running = |_: &mut Shared| !self.has_ended();
            drop(self.wake.wait_timeout_while(self.shared(), FIRST_PAUSE, is_running));
        }
        loop {
            if self.has_ended() {
                return;
            }
            let (folders, retention) = {
                let mut shared = self.shared();
                shared.is_new = false;
                (shared.folders.clone(), shared.retention.clone())
            };
            let (started, running) = (self.started.0, self.started.1.elapsed());
            let has_ended = || self.has_ended();
            // Computed from the start, so a clock that is set forward later makes no file old.
            let mut pass = Pass::new(&folders, &retention, started + running, &has_ended);
            pass.removes = self.clock_is_known || running >= DAY;
            pass.run(&journal);
            if !self.has_ended() {
                pass.report();
                let last = self.shared().kept.replace(pass.kept.clone());
                if let Some(trouble) = &pass.kept.trouble
                    && last.and_then(|last| last.trouble).as_ref() != Some(trouble)
                {
                    tracing::warn!("{}", on_one_line(trouble));
                }
            }
            let shared = self.shared();
            let is_unchanged = |shared: &mut Shared| !shared.is_new && !self.has_ended();
            let waited = match once {
                true => shared,
                false => {
                    self.wake
                        .wait_timeout_while(shared, PAUSE, is_unchanged)
                        .unwrap_or_else(PoisonError::into_inner)
                        .0
                }
            };
            drop(waited);
            if once || self.has_ended() {
                return;
            }
        }
    }
}

/// One pass over the folders.
struct Pass<'a> {
    folders: &'a FolderPaths,
    retention: &'a Retention,
    now: SystemTime,
    has_ended: &'a dyn Fn() -> bool,
    /// Whether anything is removed.
    removes: bool,
    kept: Kept,
    /// The oldest candidates for freeing space; the youngest of them leaves the heap first.
    oldest: BinaryHeap<Aged>,
    /// There were more candidates than are remembered.
    are_more: bool,
    trouble: Option<io::Error>,
}

/// Something that can be removed as a whole.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Aged {
    at: SystemTime,
    what: What,
    bytes: u64,
}

#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum What {
    /// A report or a picture.
    Report(PathBuf),
    /// A rejected drop, by the file with its reason.
    Rejected(PathBuf),
    /// An archived original, by its place in the SKU's folder, and the settings beside it if they belong to no other
    /// file.
    Original { sku: Sku, place: String, sidecar: Option<PathBuf> },
}

impl<'a> Pass<'a> {
    fn new(
        folders: &'a FolderPaths,
        retention: &'a Retention,
        now: SystemTime,
        has_ended: &'a dyn Fn() -> bool,
    ) -> Self {
        let days = |kept: Option<Duration>| kept.map(|kept| kept.as_secs_f64() / 86_400.0);
        let kept = Kept {
            at: clock::timestamp(now),
            reports_days: days(retention.reports),
            archive_days: days(retention.archive),
            rejected_days: days(retention.rejected),
            max_bytes: retention.largest,
            ..Kept::default()
        };
        Self {
            folders,
            retention,
            now,
            has_ended,
            removes: true,
            kept,
            oldest: BinaryHeap::new(),
            are_more: false,
            trouble: None,
        }
    }

    fn run<'j>(&mut self, journal: &impl Fn() -> MutexGuard<'j, Journal>) {
        loop {
            (self.kept.bytes, self.are_more) = (0, false);
            self.oldest.clear();
            self.look_at_reports(journal);
            self.look_at_rejected(journal);
            self.look_at_archive(journal);
            let removed = self.make_room(journal);
            // Candidates that were not remembered may be older than the remaining ones.
            if !(removed && self.are_more && self.is_too_much()) || self.ends() {
                break;
            }
        }
        self.kept.too_much = self.is_too_much();
    }

    fn ends(&self) -> bool {
        (self.has_ended)()
    }

    fn is_too_much(&self) -> bool {
        self.retention.largest.is_some_and(|largest| self.kept.bytes > largest)
    }

    fn make_room<'j>(&mut self, journal: &impl Fn() -> MutexGuard<'j, Journal>) -> bool {
        let mut removed = false;
        for aged in std::mem::take(&mut self.oldest).into_sorted_vec() {
            if !self.is_too_much() || !self.removes || self.ends() {
                break;
            }
            if self.remove(&aged.what, aged.bytes, journal) {
                self.kept.bytes = self.kept.bytes.saturating_sub(aged.bytes);
                removed = true;
            }
        }
        removed
    }

    /// Handles one thing that was found, and removes it if it is older than its limit.
    fn found<'j>(
        &mut self,
        what: What,
        files: &[Metadata],
        limit: Option<Duration>,
        journal: &impl Fn() -> MutexGuard<'j, Journal>,
    ) {
        let bytes = files.iter().map(Metadata::len).sum();
        let Some(at) = files.iter().filter_map(filed_at).max() else { return };
        let is_over = |limit: Duration| self.now.duration_since(at).is_ok_and(|age| age > limit);
        if self.removes && limit.is_some_and(is_over) && self.remove(&what, bytes, journal) {
            return;
        }
        self.kept.bytes += bytes;
        if self.retention.largest.is_some() && limit.is_some() {
            self.oldest.push(Aged { at, what, bytes });
            if self.oldest.len() > MAX_CANDIDATES {
                self.oldest.pop();
                self.are_more = true;
            }
        }
    }

    fn remove<'j>(
        &mut self,
        what: &What,
        bytes: u64,
        journal: &impl Fn() -> MutexGuard<'j, Journal>,
    ) -> bool {
        let removed = match what {
            What::Report(file) => remove_if_there(file).map(|()| true),
            What::Rejected(reason) => self.remove_rejected(reason, journal),
            What::Original { sku, place, sidecar } => {
                self.remove_original(sku, place, sidecar.as_deref(), journal)
            }
        };
        match removed {
            Ok(true) => {
                self.kept.removed += 1;
                self.kept.removed_bytes += bytes;
                true
            }
            Ok(false) => false,
            Err(error) => {
                self.trouble.get_or_insert(error);
                false
            }
        }
    }

    fn look_at_reports<'j>(&mut self, journal: &impl Fn() -> MutexGuard<'j, Journal>) {
        let pictures = PictureKind::ALL.map(PictureKind::ending);
        let endings: Vec<String> =
            pictures.iter().chain([&REPORT, &LIST_REPORT]).map(|ending| format!(".{ending}")).collect();
        for (path, is_folder) in entries(&self.folders.reports) {
            for (file, is_folder) in is_folder.then(|| entries(&path)).into_iter().flatten() {
                if self.ends() {
                    return;
                }
                let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
                if !is_folder && endings.iter().any(|ending| name.ends_with(ending)) {
                    let files: Vec<Metadata> = fs::symlink_metadata(&file).into_iter().collect();
                    self.found(What::Report(file), &files, self.retention.reports, journal);
                }
            }
        }
    }

    fn look_at_rejected<'j>(&mut self, journal: &impl Fn() -> MutexGuard<'j, Journal>) {
        let mut folders = vec![(self.folders.rejected.clone(), 0)];
        while let Some((folder, depth)) = folders.pop() {
            let mut others = BTreeSet::new();
            let mut reasons = Vec::new();
            for (path, is_folder) in entries(&folder) {
                if is_folder && depth < 2 {
                    folders.push((path, depth + 1));
                } else if !is_folder && path.to_string_lossy().ends_with(REASON) {
                    reasons.push(path);
                } else if !is_folder {
                    others.insert(path);
                }
            }
            for reason in reasons {
                if self.ends() {
                    return;
                }
                let Some(drop) = rejected::drop_of(&reason) else { continue };
                let own = [&drop, &reason.with_extension("txt")];
                for file in own {
                    others.remove(file);
                }
                let all = own.into_iter().chain([&reason]);
                let files: Vec<Metadata> = all.filter_map(|file| fs::symlink_metadata(file).ok()).collect();
                self.found(What::Rejected(reason), &files, self.retention.rejected, journal);
            }
            // Companions are removed with the last drop beside them.
            self.kept.bytes += others
                .iter()
                .filter_map(|file| fs::symlink_metadata(file).ok())
                .map(|m| m.len())
                .sum::<u64>();
        }
    }

    fn remove_rejected<'j>(
        &self,
        reason: &Path,
        journal: &impl Fn() -> MutexGuard<'j, Journal>,
    ) -> io::Result<bool> {
        let Some(drop) = rejected::drop_of(reason) else { return Ok(false) };
        let place = with_slashes(drop.strip_prefix(&self.folders.rejected).unwrap_or(&drop));
        // While this part is there, patterns wait for a valid part, also at another station that shares the folder.
        if journal().holds_patterns_back(&place) || self.is_newer_than_the_part(&drop) {
            return Ok(false);
        }
        let mut beside = files(reason.parent().unwrap_or(reason));
        let is_reason = |path: &Path| path.to_string_lossy().ends_with(REASON);
        if !beside.any(|path| path != reason && is_reason(&path)) {
            rejected::companions_of(&drop).iter().try_for_each(|companion| remove_if_there(companion))?;
        }
        remove_if_there(&drop)?;
        remove_if_there(&reason.with_extension("txt"))?;
        // The reason is last: without it, the other files would never be found again.
        remove_if_there(reason)?;
        remove_if_empty(reason);
        Ok(true)
    }

    fn look_at_archive<'j>(&mut self, journal: &impl Fn() -> MutexGuard<'j, Journal>) {
        for (folder, is_folder) in entries(&self.folders.archive) {
            let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let sku = name.parse::<Sku>().ok().filter(|sku| is_folder && sku.key() == name);
            let Some(sku) = sku else { continue };
            // A folder without these was not created by this station.
            if !folder.join(CURRENT_PART).is_file() && !journal().has_results(&sku) {
                continue;
            }
            let current = match noted_part(self.folders, &sku) {
                Ok(current) => current,
                // Without the note, the part of the surface is unknown, so nothing is removed.
                Err(error) => {
                    self.trouble.get_or_insert(error);
                    continue;
                }
            };
            self.look_at_originals(&sku, &folder, current.as_deref(), journal);
            for (inner, _) in entries(&folder).filter(|(path, is_folder)| *is_folder && is_numbered(path)) {
                self.look_at_originals(&sku, &inner, current.as_deref(), journal);
            }
        }
    }

    /// Checks the originals in one folder of a SKU.
    fn look_at_originals<'j>(
        &mut self,
        sku: &Sku,
        folder: &Path,
        current: Option<&Path>,
        journal: &impl Fn() -> MutexGuard<'j, Journal>,
    ) {
        let stem = |file: &Path| file.file_stem().unwrap_or_default().to_owned();
        // How many drawings each sidecar belongs to.
        let mut drawings: BTreeMap<OsString, usize> =
            files(folder).filter(|file| is_sidecar(file)).map(|file| (stem(&file), 0)).collect();
        if !drawings.is_empty() {
            for file in files(folder).filter(|file| is_drawing(&file.to_string_lossy())) {
                drawings.entry(stem(&file)).and_modify(|count| *count += 1);
            }
        }
        let drawings_of = |file: &Path| drawings.get(&stem(file)).copied().unwrap_or(0);
        let top = self.folders.archive.join(sku.key());
        for file in files(folder) {
            // If files cannot be removed, the journal must not forget them either.
            if self.ends() || self.trouble.is_some() {
                return;
            }
            let is_drawing = is_drawing(&file.to_string_lossy());
            // The settings of a drawing are removed with it.
            if is_sidecar(&file) && drawings_of(&file) == 1 {
                continue;
            }
            // A file beside the part of the surface may be needed by that part. The SKU's own folder may also contain
            // parts and files of other people.
            let is_of_current = current.is_some_and(|part| part.parent() == Some(folder));
            if !is_drawing && (is_of_current || folder == top) {
                self.kept.bytes += fs::symlink_metadata(&file).map_or(0, |metadata| metadata.len());
                continue;
            }
            let place = with_slashes(file.strip_prefix(&top).unwrap_or(&file));
            let sidecar = sidecar_of(&file).filter(|_| is_drawing && drawings_of(&file) == 1);
            let all = [Some(&file), sidecar.as_ref()].into_iter().flatten();
            let seen: Vec<Metadata> = all.filter_map(|file| fs::symlink_metadata(file).ok()).collect();
            self.found(
                What::Original { sku: sku.clone(), place, sidecar },
                &seen,
                self.retention.archive,
                journal,
            );
        }
    }

    fn remove_original<'j>(
        &self,
        sku: &Sku,
        place: &str,
        sidecar: Option<&Path>,
        journal: &impl Fn() -> MutexGuard<'j, Journal>,
    ) -> io::Result<bool> {
        let file = self.folders.archive.join(sku.key()).join(place);
        let is_drawing = is_drawing(&file.to_string_lossy());
        // The SKU may have a newer part now.
        let is_of_current = |part: PathBuf| part == file || (!is_drawing && part.parent() == file.parent());
        if noted_part(self.folders, sku)?.is_some_and(is_of_current) {
            return Ok(false);
        }
        let removed = journal().remove_original(sku, place, || remove_if_there(&file))?;
        if removed {
            sidecar.map_or(Ok(()), remove_if_there)?;
            remove_if_empty(&file);
        }
        Ok(removed)
    }

    /// Whether a rejected part arrived after the part that its SKU's surface comes from.
    fn is_newer_than_the_part(&self, rejected: &Path) -> bool {
        let relative = rejected.strip_prefix(&self.folders.rejected).unwrap_or(rejected);
        let is_numbered = |part: &Component| is_numbered(Path::new(part.as_os_str()));
        let relative: PathBuf = relative.components().filter(|part| !is_numbered(part)).collect();
        let Ok(Meaning::Part(sku)) = meaning(&relative) else { return false };
        let filed = |file: &Path| fs::symlink_metadata(file).ok().and_then(|metadata| filed_at(&metadata));
        filed(&current_part_note(self.folders, &sku)).is_some_and(|note| filed(rejected) > Some(note))
    }

    fn report(&mut self) {
        if self.kept.removed > 0 {
            let plural = if self.kept.removed == 1 { "file" } else { "files" };
            tracing::info!(
                "removed {} old {plural} from reports, rejected and archive ({:.1} MB), as set in `[retention]`",
                self.kept.removed,
                self.kept.removed_bytes as f64 / 1e6
            );
        }
        if let Some(error) = &self.trouble {
            self.kept.trouble = Some(format!(
                "cannot read or remove old files: {error}. Give isomark read and write access to that folder"
            ));
        } else if self.kept.too_much {
            self.kept.trouble = Some(format!(
                "reports, archive and rejected take {:.3} GB, more than `max_gb` under `[retention]`. Raise it, set \
                 `archive_days`, or move originals elsewhere: the settings allow isomark to remove nothing else",
                self.kept.bytes as f64 / 1e9
            ));
        }
    }
}

/// Removes a file, if it exists.
fn remove_if_there(file: &Path) -> io::Result<()> {
    match fs::remove_file(file) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        removed => removed,
    }
}

/// The files and folders in a folder, each with whether it is a folder; links and devices are left out. It is an
/// iterator, because a folder may contain a hundred thousand files.
fn entries(folder: &Path) -> impl Iterator<Item = (PathBuf, bool)> + use<> {
    let kind = |entry: fs::DirEntry| {
        let kind = entry.file_type().ok()?;
        (kind.is_dir() || kind.is_file()).then(|| (entry.path(), kind.is_dir()))
    };
    fs::read_dir(folder).into_iter().flatten().flatten().filter_map(kind)
}

/// The files in a folder.
fn files(folder: &Path) -> impl Iterator<Item = PathBuf> + use<> {
    entries(folder).filter(|(_, is_folder)| !is_folder).map(|(path, _)| path)
}

/// Whether the name of a folder is a number, such as `(2)`: it contains files whose names were taken.
fn is_numbered(folder: &Path) -> bool {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    let number = name.strip_prefix('(').and_then(|rest| rest.strip_suffix(')'));
    number.is_some_and(|number| number.parse::<u64>().is_ok())
}

/// Removes the numbered folder of a file, if it is empty now.
fn remove_if_empty(file: &Path) {
    if let Some(folder) = file.parent().filter(|folder| is_numbered(folder)) {
        // The system refuses to remove a folder that is not empty.
        let _ = std::fs::remove_dir(folder);
    }
}

/// When a file was filed. The time of its last write comes from the designer, so the latest of all its times decides:
/// in doubt, a file is kept longer.
fn filed_at(metadata: &Metadata) -> Option<SystemTime> {
    let times = [metadata.modified().ok(), metadata.created().ok(), changed(metadata)];
    times.into_iter().flatten().max()
}

/// When a file's name or content changed last.
#[cfg(unix)]
fn changed(metadata: &Metadata) -> Option<SystemTime> {
    use std::os::unix::fs::MetadataExt;
    let seconds = u64::try_from(metadata.ctime()).ok()?;
    SystemTime::UNIX_EPOCH.checked_add(Duration::from_secs(seconds))
}

/// When a file's name or content changed last: unknown on this system.
#[cfg(not(unix))]
fn changed(_: &Metadata) -> Option<SystemTime> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_a_year_reports_and_rejected_drops_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("station.toml");
        let text = "[station]\nname = \"test\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n\
                    [field]\nwidth_mm = 110\nheight_mm = 110\n";
        let station = Station::parse(&file, text).unwrap();
        let FolderPaths { reports, rejected, archive, state, .. } = &station.folders;
        let place = |folder: &Path, name: &str, content: &str| {
            let file = folder.join(name);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, content).unwrap();
        };
        place(reports, "can/can@a.dxf.report.json", "{}");
        place(rejected, "can/(2)/bad.dxf", "0");
        place(rejected, "can/(2)/bad.dxf.reason.json", "{\"drop\": \"can/bad.dxf\"}");
        place(rejected, "can/(2)/bad.dxf.reason.txt", "no drawing");
        place(archive, "can/current-part.txt", "can.obj\n");
        place(archive, "can/can.obj", "v 0 0 0");
        place(archive, "can/can@a.dxf", "0");
        fs::create_dir_all(state).unwrap();
        let journal = Mutex::new(Journal::open(state).unwrap());
        let has_ended = || false;
        let removed_after = |days: u64| {
            let now = SystemTime::now() + Duration::from_secs(days * 86_400);
            let mut pass = Pass::new(&station.folders, &station.retention, now, &has_ended);
            pass.run(&|| journal.lock().unwrap());
            pass.kept.removed
        };
        assert_eq!([364, 366, 40_000].map(removed_after), [0, 2, 0]);
        assert_eq!(
            [reports, rejected, archive].map(|folder| entries(&folder.join("can")).count()),
            [0, 0, 3]
        );
    }
}
