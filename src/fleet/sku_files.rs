//! The SKU files of a station, as far as the office releases them.
//!
//! `fleet/settings` in the state folder has a copy of each file as it was released last. By it a station notices a local change also
//! while the database is away, and uses the release in its place before the next job, if its settings do not allow the change.

use std::collections::BTreeMap;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use fs_err as fs;

use super::released_text::{MOST_LINES, hash, parsed, written};
use crate::config::{FleetSettings, JobSettings, LocalSettings, ReleasedSettings, Sku, Station, sku_files};
use crate::diff::text_changes;
use crate::files::{TEMPORARY_END, TEMPORARY_START, read_if_there, write_new, write_whole};
use crate::printable::on_one_line;

/// The folder of the copies in the state folder.
const COPIES: &str = "fleet/settings";
/// A temporary file of this age is not being written any more.
const ABANDONED: Duration = Duration::from_secs(3600);
/// What is added to the name of a file whose local change is kept.
const KEPT: &str = "local";
/// Different local changes of one file that are kept.
const MOST_KEPT: usize = 1000;
/// Changed lines that the log names.
const LINES: usize = 40;
/// The longest of them, characters.
const LONGEST_LINE: usize = 200;
/// Notices that the status lists.
const NOTICES: usize = 10;
/// Notices that are remembered.
const MOST_NOTICES: usize = 10_000;
/// The longest note for the fleet, characters.
const LONGEST_NOTE: usize = 500;

/// A release for a station, checked as far as this is possible without its settings.
#[derive(Debug, Clone)]
pub(super) struct Release {
    pub(super) sku: Sku,
    pub(super) version: i64,
    /// Who released it, when, for whom.
    pub(super) about: String,
    /// The settings; `None` if they were removed.
    pub(super) settings: Option<String>,
}

/// What a station does with a release.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Report {
    pub(super) version: i64,
    pub(super) state: ReportState,
    pub(super) note: Option<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ReportState {
    Used,
    Local,
    Refused,
}

impl ReportState {
    /// Its name in the tables.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Used => "used",
            Self::Local => "local",
            Self::Refused => "refused",
        }
    }
}

/// The SKU files of a station, as far as the office releases them.
#[derive(Debug)]
pub struct SkuFiles {
    copies: PathBuf,
    local: LocalSettings,
    /// Held while a file is compared and written, so that no two threads do it.
    inner: Mutex<Inner>,
}

#[derive(Debug)]
struct Inner {
    folder: PathBuf,
    settings: JobSettings,
    /// By the key of the SKU.
    notices: BTreeMap<String, Notice>,
    /// What was found outside the thread of the fleet.
    reports: BTreeMap<Sku, Report>,
}

/// What people should know about the settings of a SKU.
#[derive(Debug, Clone, PartialEq)]
enum Notice {
    /// A local change is used in place of the release.
    Used { file: PathBuf, version: i64 },
    /// A local change was refused, and is in this file.
    Kept { file: PathBuf, kept: PathBuf },
    /// The release cannot be used here.
    Wrong { version: i64, why: String },
    /// The file cannot be written.
    Stuck(String),
}

impl Notice {
    fn text(&self, sku: &str) -> String {
        let sku = on_one_line(sku);
        let name = |file: &Path| on_one_line(&file.file_name().unwrap_or_default().to_string_lossy());
        match self {
            Self::Used { file, version } => format!(
                "{} of this station is used in place of version {version} that the office released for {sku}, as `local_settings` \
                 allows. Remove the file to use the release.",
                name(file)
            ),
            Self::Kept { file, kept } => format!(
                "A local change of {} was refused, because the office releases the settings of {sku}; it is kept as {}. Ask the \
                 office to release it, or remove it.",
                name(file),
                name(kept)
            ),
            Self::Wrong { version, why } => format!(
                "Version {version} of the settings of {sku} that the office released is not used: {why}"
            ),
            Self::Stuck(why) => {
                format!("The settings that the office released for {sku} cannot be written: {why}")
            }
        }
    }
}

/// What is in the file of a SKU.
enum Found {
    Nothing,
    /// What was released last, or earlier.
    Untouched,
    Changed(Vec<u8>),
}

impl SkuFiles {
    /// The files of a station that belongs to this fleet.
    #[must_use]
    pub fn new(fleet: &FleetSettings, station: &Station) -> Self {
        let inner = Inner {
            folder: station.folders.skus.clone(),
            settings: station.settings.clone(),
            notices: BTreeMap::new(),
            reports: BTreeMap::new(),
        };
        Self {
            copies: station.folders.state.join(COPIES),
            local: fleet.local_settings,
            inner: Mutex::new(inner),
        }
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Removes the temporary files that an earlier run left, once the station holds its lock.
    pub(super) fn tidy(&self) {
        let folder = self.inner().folder.clone();
        // Another command may be writing a settings file at this moment.
        for (folder, age) in [(&self.copies, Duration::ZERO), (&folder, ABANDONED)] {
            for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
                let name = entry.file_name().to_string_lossy().into_owned();
                let is_temporary = name.starts_with(TEMPORARY_START) && name.ends_with(TEMPORARY_END);
                let modified = entry.metadata().and_then(|metadata| metadata.modified());
                let is_old = modified.is_ok_and(|at| at.elapsed().is_ok_and(|since| since >= age));
                if is_temporary && is_old {
                    let _ = fs::remove_file(entry.path());
                }
            }
        }
    }

    /// The settings of the station changed.
    pub(super) fn follow(&self, station: &Station) {
        let mut inner = self.inner();
        inner.folder.clone_from(&station.folders.skus);
        inner.settings = station.settings.clone();
    }

    /// The file of each SKU now; of several for one SKU, the first by name.
    pub(super) fn listed(&self) -> io::Result<BTreeMap<Sku, PathBuf>> {
        let folder = self.inner().folder.clone();
        let files = sku_files(&folder).map_err(|error| io::Error::other(error.reason().on_one_line()))?;
        Ok(files.into_iter().filter_map(|(sku, files)| Some((sku, files.into_iter().next()?))).collect())
    }

    /// What people should know.
    pub(super) fn notices(&self) -> Vec<String> {
        let mut inner = self.inner();
        // Somebody has seen to it.
        inner.notices.retain(|_, notice| !matches!(notice, Notice::Kept { kept, .. } if !kept.exists()));
        let mut texts: Vec<String> =
            inner.notices.iter().take(NOTICES).map(|(sku, notice)| notice.text(sku)).collect();
        if inner.notices.len() > NOTICES {
            texts.push(format!("The log has {} more like this.", inner.notices.len() - NOTICES));
        }
        texts
    }

    /// What was found since the last call outside the thread of the fleet.
    pub(super) fn take_reports(&self) -> BTreeMap<Sku, Report> {
        std::mem::take(&mut self.inner().reports)
    }

    /// What the station does with the release that the fleet has for it, if that is the one that it received last: a file that was
    /// removed or changed since is restored. `None` if the release must be received.
    pub(super) fn compared(
        &self,
        sku: &Sku,
        version: i64,
        its_hash: Option<&str>,
        file: Option<&Path>,
    ) -> io::Result<Option<Report>> {
        let mut inner = self.inner();
        let copy = self.copy(sku)?;
        let known = copy.as_deref().and_then(parsed).map(|(version, settings)| (version, hash(settings)));
        match (known, its_hash) {
            (Some((known, its)), Some(wanted)) if known == version && its == wanted => {
                self.settled(&mut inner, sku, file, version, copy.as_deref().unwrap_or_default()).map(Some)
            }
            // Removed, and nothing was ever received.
            (None, None) if !is_released(&path_of(&inner, sku, file)) => {
                Ok(Some(Report { version, state: ReportState::Used, note: None }))
            }
            _ => Ok(None),
        }
    }

    /// Takes a release: writes the file, or keeps what is there.
    pub(super) fn take(&self, release: &Release, file: Option<&Path>) -> io::Result<Report> {
        let mut inner = self.inner();
        let Release { sku, version, about, settings } = release;
        let taken = match settings {
            None => self.removed(&mut inner, release, file),
            Some(settings) => {
                let text = written(*version, about, settings);
                // The settings alone have the lines that the office knows.
                let valid = checked(&inner.settings, sku, settings);
                if let Err(why) = valid.and_then(|()| checked(&inner.settings, sku, &text)) {
                    return Ok(refused(&mut inner, sku.key(), *version, why));
                }
                let before = read_if_there(&path_of(&inner, sku, file))?;
                let is_known = self.copy(sku)?.as_deref() == Some(&*text);
                let report = self.settled(&mut inner, sku, file, *version, &text);
                if !is_known && matches!(&report, Ok(Report { state: ReportState::Used, .. })) {
                    let before = String::from_utf8_lossy(before.as_deref().unwrap_or_default()).into_owned();
                    let before = parsed(&before).map_or(&*before, |(_, settings)| settings);
                    tracing::info!(
                        "received settings: {}: {}",
                        on_one_line(about),
                        changes(before, settings)
                    );
                }
                report
            }
        };
        if let Err(error) = &taken {
            note(&mut inner, sku.key(), Some(Notice::Stuck(error.to_string())));
        }
        taken
    }

    /// Notes that a release cannot be used here, whoever made its row.
    pub(super) fn refuse(&self, sku_key: &str, version: i64, why: String) -> Report {
        refused(&mut self.inner(), sku_key, version, why)
    }

    /// Makes the file what it must be for this released text, and keeps a copy of that.
    fn settled(
        &self,
        inner: &mut Inner,
        sku: &Sku,
        file: Option<&Path>,
        version: i64,
        text: &str,
    ) -> io::Result<Report> {
        let path = path_of(inner, sku, file);
        let found = found(&path, text)?;
        let report = |state| Ok(Report { version, state, note: None });
        if self.copy(sku)?.as_deref() != Some(text) {
            fs::create_dir_all(&self.copies)?;
            write_whole(&self.copies, &copy_name(sku), text.as_bytes())?;
        }
        if matches!(found, Found::Changed(_)) && self.local == LocalSettings::Allow {
            note(inner, sku.key(), Some(Notice::Used { file: path, version }));
            return report(ReportState::Local);
        }
        let mut notice = None;
        if let Found::Changed(bytes) = &found {
            notice = Some(Notice::Kept { kept: keep_beside(&path, bytes)?, file: path.clone() });
        }
        let is_written = matches!(&found, Found::Untouched) && fs::read(&path)? == text.as_bytes();
        if !is_written {
            write_into(&path, text)?;
        }
        // A change that was kept is still there.
        let is_kept = matches!(inner.notices.get(sku.key()), Some(Notice::Kept { .. }));
        if notice.is_some() || !is_kept {
            note(inner, sku.key(), notice);
        }
        report(ReportState::Used)
    }

    /// Removes the file whose release was removed.
    fn removed(&self, inner: &mut Inner, release: &Release, file: Option<&Path>) -> io::Result<Report> {
        let Release { sku, version, about, .. } = release;
        let (copy, path) = (self.copy(sku)?, path_of(inner, sku, file));
        let mut notice = None;
        // Without its copy it is a local file, also after a crash at this place.
        if copy.is_some() || is_released(&path) {
            match found(&path, copy.as_deref().unwrap_or_default())? {
                Found::Nothing => {}
                Found::Untouched => fs::remove_file(&path)?,
                Found::Changed(_) if self.local == LocalSettings::Allow => {}
                Found::Changed(bytes) => {
                    notice = Some(Notice::Kept { kept: keep_beside(&path, &bytes)?, file: path.clone() });
                    fs::remove_file(&path)?;
                }
            }
            tracing::info!("received settings: {}", on_one_line(about));
        }
        if copy.is_some() {
            fs::remove_file(self.copies.join(copy_name(sku)))?;
        }
        note(inner, sku.key(), notice);
        Ok(Report { version: *version, state: ReportState::Used, note: None })
    }

    /// The copy of what was released last.
    fn copy(&self, sku: &Sku) -> io::Result<Option<String>> {
        let bytes = read_if_there(&self.copies.join(copy_name(sku)))?;
        Ok(bytes.and_then(|bytes| String::from_utf8(bytes).ok()))
    }
}

impl ReleasedSettings for SkuFiles {
    fn is_whole(&self, text: &str) -> bool {
        parsed(text).is_some()
    }

    fn instead(&self, sku: &Sku, file: Option<(&Path, &str)>) -> Option<String> {
        let mut inner = self.inner();
        let copy = self.copy(sku).ok().flatten()?;
        let (version, _) = parsed(&copy)?;
        if file.is_some_and(|(_, text)| text == copy) {
            return None;
        }
        let is_used = match self.settled(&mut inner, sku, file.map(|(path, _)| path), version, &copy) {
            Ok(report) => {
                let state = report.state;
                inner.reports.insert(sku.clone(), report);
                state == ReportState::Used
            }
            Err(error) => {
                note(&mut inner, sku.key(), Some(Notice::Stuck(error.to_string())));
                file.is_none() || self.local == LocalSettings::Refuse
            }
        };
        is_used.then_some(copy)
    }
}

fn refused(inner: &mut Inner, sku_key: &str, version: i64, why: String) -> Report {
    let note_for_fleet = on_one_line(&why).chars().take(LONGEST_NOTE).collect();
    note(inner, sku_key, Some(Notice::Wrong { version, why }));
    Report { version, state: ReportState::Refused, note: Some(note_for_fleet) }
}

/// Sets the notice of a SKU, and logs a new one.
fn note(inner: &mut Inner, sku_key: &str, notice: Option<Notice>) {
    let Some(notice) = notice else { return drop(inner.notices.remove(sku_key)) };
    if inner.notices.get(sku_key) == Some(&notice) {
        return;
    }
    tracing::warn!("{}", notice.text(sku_key));
    if inner.notices.len() < MOST_NOTICES || inner.notices.contains_key(sku_key) {
        inner.notices.insert(sku_key.to_owned(), notice);
    }
}

/// Whether the settings can be used with those of the station.
fn checked(station: &JobSettings, sku: &Sku, settings: &str) -> Result<(), String> {
    let file = PathBuf::from(format!("{sku}.toml"));
    // The text comes from another computer.
    match catch_unwind(AssertUnwindSafe(|| station.overridden_by(&file, settings))) {
        Ok(Ok(_)) => Ok(()),
        Ok(Err(error)) => Err(on_one_line(&error.to_string())),
        Err(_) => Err("they cannot be read.".into()),
    }
}

/// The file of a SKU: the one that was found, or the one that is made.
fn path_of(inner: &Inner, sku: &Sku, file: Option<&Path>) -> PathBuf {
    file.map_or_else(|| inner.folder.join(format!("{sku}.toml")), Path::to_path_buf)
}

/// What is in a file for which this text was released last, or is released now.
fn found(path: &Path, text: &str) -> io::Result<Found> {
    let Some(bytes) = read_if_there(path)? else { return Ok(Found::Nothing) };
    let released = parsed(text).map_or("", |(_, settings)| settings);
    let is_ours = std::str::from_utf8(&bytes).is_ok_and(|found| {
        parsed(found).is_some() || found == text || (!released.is_empty() && hash(found) == hash(released))
    });
    Ok(if is_ours { Found::Untouched } else { Found::Changed(bytes) })
}

/// Whether the file is as it was released at some time.
fn is_released(path: &Path) -> bool {
    fs::read_to_string(path).is_ok_and(|text| parsed(&text).is_some())
}

fn copy_name(sku: &Sku) -> String {
    format!("{}.toml", sku.key())
}

/// Keeps a changed file under another name, which no station reads as settings.
fn keep_beside(path: &Path, bytes: &[u8]) -> io::Result<PathBuf> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    for number in 1..=MOST_KEPT {
        let number = if number == 1 { String::new() } else { format!("-{number}") };
        let kept = path.with_file_name(format!("{name}.{KEPT}{number}"));
        match write_new(&kept, bytes, None) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                if read_if_there(&kept)?.is_some_and(|known| known == bytes) {
                    return Ok(kept);
                }
            }
            written => return written.map(|()| kept),
        }
    }
    Err(io::Error::other(format!("{MOST_KEPT} local changes of {name} are kept already; remove some")))
}

fn write_into(path: &Path, text: &str) -> io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new(""));
    write_whole(folder, &path.file_name().unwrap_or_default().to_string_lossy(), text.as_bytes())
}

/// The changed lines for the log.
fn changes(old: &str, new: &str) -> String {
    if old.lines().count() > MOST_LINES {
        return "all lines changed".into();
    }
    let all = text_changes(old, new);
    let cut = |line: &String| on_one_line(&line.chars().take(LONGEST_LINE).collect::<String>());
    let mut shown: Vec<String> = all.iter().take(LINES).map(cut).collect();
    if all.len() > LINES {
        shown.push(format!("and {} more lines", all.len() - LINES));
    }
    if shown.is_empty() { "no line changed".into() } else { shown.join("; ") }
}
