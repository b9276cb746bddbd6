//! Settings that follow their files while a station runs. A valid edit takes effect from the next job on; after an invalid one
//! the previous settings are kept, and it is reported once. Half a file may be valid, too, so a text is used only after it has
//! not changed for a while.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::error::ConfigError;
use super::overrides::Overrides;
use super::released::ReleasedSettings;
use super::settings::JobSettings;
use super::sku::Sku;
use super::station::{Station, read};

/// How long an emptied file must not change: editors empty a file before they write it.
const EMPTIED: Duration = Duration::from_secs(10);

/// The settings of a station and of its SKUs, as of the last look at the files.
#[derive(Debug)]
pub struct LiveSettings {
    station: Station,
    /// Settings of the command line, in place of the station file's.
    overrides: Overrides,
    /// The text of its file, followed by that of the lens table.
    station_text: String,
    skus: BTreeMap<Sku, SkuFile>,
    /// What is released for SKUs elsewhere.
    released: Option<Arc<dyn ReleasedSettings>>,
    /// Texts that are not used, or not yet.
    new_texts: BTreeMap<PathBuf, NewText>,
    /// The files are read only once.
    at_once: bool,
    /// The complaint about each broken file, so that it is reported once.
    complaints: BTreeMap<PathBuf, String>,
    /// The SKU files that the first listing of their folder found and every later one: any other was made since.
    first_files: Option<BTreeSet<PathBuf>>,
    events: Vec<SettingsEvent>,
}

/// What was noticed in the files.
#[derive(Debug)]
#[non_exhaustive]
pub enum SettingsEvent {
    /// The station file changed and is used.
    StationChanged {
        /// Its text before.
        old: String,
        /// Its text now.
        new: String,
    },
    /// The SKU's file was added, changed or removed, and that is used.
    SkuChanged {
        /// The SKU.
        sku: Sku,
        /// The file's text before; empty when there was none.
        old: String,
        /// Its text now; empty when it was removed.
        new: String,
    },
    /// A file is broken, or the folder of the SKU files cannot be listed.
    Broken {
        /// What is wrong.
        error: ConfigError,
        /// Whether the previous settings are kept; a SKU's file that was never valid holds up its jobs.
        old_stay: bool,
    },
    /// A broken file is valid again. If it differs from the last valid version, another event has the change.
    Mended(PathBuf),
    /// A SKU's broken file was removed: the station's settings apply to the SKU.
    BrokenRemoved {
        /// The SKU.
        sku: Sku,
        /// The file.
        file: PathBuf,
    },
}

/// A text as it was read.
#[derive(Debug)]
struct NewText {
    text: String,
    /// When it was first seen.
    since: Instant,
    /// It has not changed for long enough, and is checked.
    settled: bool,
}

#[derive(Debug)]
struct SkuFile {
    file: PathBuf,
    /// The last valid text.
    text: String,
    /// The last listing did not find it.
    missed: bool,
}

impl LiveSettings {
    /// Reads and checks the station file.
    ///
    /// # Errors
    /// When it is wrong: there are no previous settings to keep.
    pub fn open(file: &Path) -> Result<Self, ConfigError> {
        Self::open_with(file, Overrides::default())
    }

    /// The same, with settings of the command line in place of the station file's for as long as the program runs.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_with(file: &Path, overrides: Overrides) -> Result<Self, ConfigError> {
        let text = read(file)?;
        let station = Station::parse_with(file, &text, &overrides)?;
        let station_text = with_lens_table(text, station.lens_table.as_deref());
        Ok(Self {
            station,
            overrides,
            station_text,
            skus: BTreeMap::new(),
            released: None,
            new_texts: BTreeMap::new(),
            at_once: false,
            complaints: BTreeMap::new(),
            first_files: None,
            events: Vec::new(),
        })
    }

    /// Uses every text at once, without waiting for it to settle: the files are read only once.
    #[must_use]
    pub fn at_once(self) -> Self {
        Self { at_once: true, ..self }
    }

    /// The same settings, where files of SKUs are released elsewhere, too.
    #[must_use]
    pub fn released_by(self, released: Arc<dyn ReleasedSettings>) -> Self {
        Self { released: Some(released), ..self }
    }

    /// The station as it is used now.
    #[must_use]
    pub fn station(&self) -> &Station {
        &self.station
    }

    /// Reads the station file and its lens table again. The whole texts are compared, because two edits may have the same
    /// time.
    pub fn refresh(&mut self) {
        let file = self.station.file.clone();
        let text = match read(&file) {
            Ok(text) => text,
            Err(error) => return self.complain(error),
        };
        let all = with_lens_table(text.clone(), self.station.lens_table.as_deref());
        if all == self.station_text {
            self.new_texts.remove(&file);
            return self.resolved(&file);
        }
        if !self.is_settled(&file, &all, false) {
            return;
        }
        match Station::parse_with(&file, &text, &self.overrides) {
            Ok(station) => {
                self.station = station;
                let text = with_lens_table(text, self.station.lens_table.as_deref());
                let old = std::mem::replace(&mut self.station_text, text.clone());
                self.resolved(&file);
                self.events.push(SettingsEvent::StationChanged { old, new: text });
            }
            Err(error) => self.complain(error),
        }
    }

    /// The settings for a job on this SKU, after a look at its file. A file that is missing while it is saved or checked out is
    /// still used; [`Self::refresh_skus`] decides when it was removed.
    ///
    /// # Errors
    /// When the SKU's file is wrong, or the folder of all SKU files is missing, and no previous valid version is known;
    /// [`ConfigError::BeingSaved`] as long as the station's file or the SKU's may still be written.
    pub fn job(&mut self, sku: &Sku) -> Result<JobSettings, ConfigError> {
        if self.new_texts.get(&self.station.file).is_some_and(|new| !new.settled) {
            return Err(ConfigError::BeingSaved { file: self.station.file.clone() });
        }
        let files = sku_files(&self.station.folders.skus).map(|mut files| files.remove(sku));
        if let (Ok(None), false) = (&files, self.skus.contains_key(sku))
            && let Some(file) = misnamed_files(&self.station.folders.skus).remove(sku)
        {
            let error = || ConfigError::Misnamed { file: file.clone(), sku: sku.clone() };
            self.complain(error());
            return Err(error());
        }
        match files.and_then(|files| self.read_sku(sku, &files.unwrap_or_default())) {
            Ok(settings) => Ok(settings),
            Err(error @ ConfigError::BeingSaved { .. }) => Err(error),
            Err(error) => {
                let Some(old) = self.skus.get(sku) else { return Err(error) };
                let settings = self.station.settings.overridden_by(&old.file, &old.text);
                self.complain(error);
                settings
            }
        }
    }

    /// Reads all SKU files again, so that an edit is noticed before the SKU's next job. A file was removed when two listings in
    /// a row do not find it in a folder that exists.
    pub fn refresh_skus(&mut self) {
        let folder = self.station.folders.skus.clone();
        let found = match sku_files(&folder) {
            Ok(found) => found,
            Err(error) => return self.complain(error),
        };
        self.resolved(&folder);
        let missed = self.skus.iter_mut().filter(|(sku, _)| !found.contains_key(*sku));
        let removed: Vec<Sku> = missed
            .filter_map(|(sku, file)| std::mem::replace(&mut file.missed, true).then(|| sku.clone()))
            .collect();
        for sku in removed {
            let Some(SkuFile { file, text: old, .. }) = self.skus.remove(&sku) else { continue };
            if self.forgive(&file) {
                self.events.push(SettingsEvent::BrokenRemoved { sku: sku.clone(), file });
            }
            self.events.push(SettingsEvent::SkuChanged { sku, old, new: String::new() });
        }
        let station = &self.station.file;
        let known = |file: &PathBuf| self.skus.values().any(|sku| sku.file == *file);
        let is_found = |file: &PathBuf| found.values().flatten().any(|path| path == file);
        let misnamed = misnamed_files(&folder);
        let is_misnamed =
            |file: &PathBuf| misnamed.iter().any(|(sku, path)| path == file && !found.contains_key(sku));
        let is_used = |file: &PathBuf| file == station || is_found(file) || known(file) || is_misnamed(file);
        let unused: Vec<PathBuf> = self.complaints.keys().filter(|file| !is_used(file)).cloned().collect();
        self.new_texts.retain(|file, _| is_used(file));
        for file in unused {
            self.complaints.remove(&file);
            // After a change of the station's settings, the file may be in the former folder.
            let Some(sku) = sku_of(&file).filter(|_| file.parent() == Some(&*folder)) else { continue };
            match found.get(&sku).map(Vec::as_slice) {
                // It was one of two.
                Some([left]) => self.events.push(SettingsEvent::Mended(left.clone())),
                None if !self.skus.contains_key(&sku) => {
                    self.events.push(SettingsEvent::BrokenRemoved { sku, file });
                }
                _ => {}
            }
        }
        match &mut self.first_files {
            Some(first) => first.retain(|file| is_found(file) || known(file)),
            None => self.first_files = Some(found.values().flatten().cloned().collect()),
        }
        for (sku, files) in found {
            match self.read_sku(&sku, &files) {
                Ok(_) | Err(ConfigError::BeingSaved { .. }) => {}
                Err(error) => self.complain(error),
            }
        }
    }

    /// What was noticed since the last call.
    pub fn take_events(&mut self) -> Vec<SettingsEvent> {
        std::mem::take(&mut self.events)
    }

    /// What is wrong in the files now.
    pub fn complaints(&self) -> impl Iterator<Item = &str> {
        self.complaints.values().map(String::as_str)
    }

    fn read_sku(&mut self, sku: &Sku, files: &[PathBuf]) -> Result<JobSettings, ConfigError> {
        let Some(file) = files.first().cloned() else {
            return match self.skus.get(sku) {
                Some(last) => self.station.settings.overridden_by(&last.file, &last.text),
                None => match self.released.as_ref().and_then(|released| released.instead(sku, None)) {
                    Some(text) => {
                        let file = self.station.folders.skus.join(format!("{sku}.toml"));
                        self.station.settings.overridden_by(&file, &text)
                    }
                    None => Ok(self.station.settings.clone()),
                },
            };
        };
        if let [first, second, ..] = files {
            let used = self.skus.get(sku).map(|old| &old.file).filter(|used| files.contains(used));
            let (file, other) = match used {
                Some(used) if used == first => (second, first),
                Some(used) => (first, used),
                None => (second, first),
            };
            return Err(ConfigError::Twice { file: file.clone(), other: other.clone() });
        }
        let mut text = read(&file)?;
        let old = self.skus.get(sku).filter(|old| old.file == file);
        if old.is_some_and(|old| old.text == text) {
            self.new_texts.remove(&file);
        } else {
            let held_text = old.is_some_and(|old| !old.text.trim().is_empty());
            if !self.is_settled(&file, &text, held_text) {
                return Err(ConfigError::BeingSaved { file });
            }
            let released = self.released.as_ref();
            if let Some(released) = released.and_then(|released| released.instead(sku, Some((&file, &text))))
            {
                text = released;
            }
        }
        let settings = self.station.settings.overridden_by(&file, &text)?;
        self.resolved(&file);
        let old =
            self.skus.insert(sku.clone(), SkuFile { file: file.clone(), text: text.clone(), missed: false });
        let old = match old {
            Some(old) => old.text,
            None if self.first_files.as_ref().is_some_and(|first| !first.contains(&file)) => String::new(),
            None => text.clone(),
        };
        if old != text {
            self.events.push(SettingsEvent::SkuChanged { sku: sku.clone(), old, new: text });
        }
        Ok(settings)
    }

    /// Whether a new text is complete, judged by how long it has not changed.
    fn is_settled(&mut self, file: &Path, text: &str, held_text: bool) -> bool {
        let emptied = held_text && text.trim().is_empty();
        let still = if emptied { EMPTIED } else { self.station.watch.settle };
        let modified = std::fs::metadata(file).and_then(|metadata| metadata.modified());
        let age = modified.ok().and_then(|modified| modified.elapsed().ok()).unwrap_or_default();
        let is_whole = self.released.as_ref().is_some_and(|released| released.is_whole(text));
        let new = || NewText { text: text.into(), since: Instant::now(), settled: false };
        let seen = self.new_texts.entry(file.into()).or_insert_with(new);
        if seen.text != text {
            *seen = new();
        }
        seen.settled |= self.at_once || is_whole || age.max(seen.since.elapsed()) >= still;
        seen.settled
    }

    fn complain(&mut self, error: ConfigError) {
        let words = error.to_string();
        // An option of the command line is wrong only together with the station's file.
        let file = error.file().unwrap_or(&self.station.file).to_path_buf();
        if self.complaints.insert(file.clone(), words.clone()) != Some(words) {
            let of_sku = file != self.station.file && file != self.station.folders.skus;
            let old_stay = !of_sku || sku_of(&file).is_some_and(|sku| self.skus.contains_key(&sku));
            self.events.push(SettingsEvent::Broken { error, old_stay });
        }
    }

    /// Whether there was a complaint of the file.
    fn forgive(&mut self, file: &Path) -> bool {
        self.complaints.remove(file).is_some()
    }

    fn resolved(&mut self, file: &Path) {
        if self.forgive(file) {
            self.events.push(SettingsEvent::Mended(file.into()));
        }
    }
}

/// The settings files of each SKU, in any spelling of its name, by name; more than one is a mistake.
///
/// # Errors
/// When the folder is missing or cannot be listed: its files may still exist.
pub(crate) fn sku_files(folder: &Path) -> Result<BTreeMap<Sku, Vec<PathBuf>>, ConfigError> {
    let unreadable = |source| ConfigError::NoSkuFiles { folder: folder.into(), source };
    let mut files = BTreeMap::<Sku, Vec<PathBuf>>::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if let Some(sku) = sku_of(&path) {
            files.entry(sku).or_default().push(path);
        }
    }
    files.values_mut().for_each(|files| files.sort());
    Ok(files)
}

/// Endings of settings files that were saved under a wrong name, in lower case. Editors add `.txt`, and Windows hides that.
const MISNAMED: &[&str] = &[".toml.txt", ".tml", ".tolm"];

/// The name of a settings file with a wrong ending, without that; `None` for all other names.
pub(crate) fn misnamed_settings(name: &str) -> Option<&str> {
    MISNAMED.iter().find_map(|ending| without_ending(name, ending))
}

/// A name without this ending, which is in lower case; `None` if it has another, or nothing else.
pub(crate) fn without_ending<'n>(name: &'n str, ending: &str) -> Option<&'n str> {
    let (stem, its) = name.split_at_checked(name.len().checked_sub(ending.len())?)?;
    (its.eq_ignore_ascii_case(ending) && !stem.is_empty()).then_some(stem)
}

/// The misnamed settings files of each SKU, by its name.
fn misnamed_files(folder: &Path) -> BTreeMap<Sku, PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let named = entries.filter_map(|path| {
        let sku = misnamed_settings(path.file_name()?.to_str()?)?.parse().ok()?;
        Some((sku, path))
    });
    named.collect()
}

/// The SKU whose settings are in this file, by its name.
fn sku_of(path: &Path) -> Option<Sku> {
    path.extension().filter(|ending| ending.eq_ignore_ascii_case("toml"))?;
    path.file_stem()?.to_str()?.parse().ok()
}

/// A station's text, followed by that of its lens table. A table that cannot be read is like an empty one: reading the
/// station reports it.
fn with_lens_table(text: String, table: Option<&Path>) -> String {
    let Some(table) = table else { return text };
    let bytes = std::fs::read(table).unwrap_or_default();
    format!("{text}\n# {}\n{}", table.display(), String::from_utf8_lossy(&bytes))
}
