//! Settings that follow their files while a station runs: a good edit counts from the next job on, a broken one
//! leaves the old settings in force and is told once. Half a file may be good settings, too, so a text counts only once
//! it stood still.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::error::ConfigError;
use super::overrides::Overrides;
use super::settings::JobSettings;
use super::sku::Sku;
use super::station::{Station, read};

/// How long an emptied file must stand still: editors empty a file before they write it.
const EMPTIED: Duration = Duration::from_secs(10);

/// The settings of a station and of its SKUs, as of the last look at the files.
#[derive(Debug)]
pub struct LiveSettings {
    station: Station,
    /// Settings of the command line, in place of the station file's.
    overrides: Overrides,
    station_text: String,
    skus: BTreeMap<Sku, SkuFile>,
    /// Texts that are not in force, or not yet.
    new_texts: BTreeMap<PathBuf, NewText>,
    /// There is no later look.
    at_once: bool,
    /// The complaint about each broken file, so that it is told once.
    complaints: BTreeMap<PathBuf, String>,
    /// The SKU files that the first listing of their folder found and every later one: any other was made since.
    first_files: Option<BTreeSet<PathBuf>>,
    events: Vec<SettingsEvent>,
}

/// What was noticed in the files.
#[derive(Debug)]
pub enum SettingsEvent {
    /// The station file changed and is in force.
    StationChanged {
        /// Its text before.
        old: String,
        /// Its text now.
        new: String,
    },
    /// The SKU's file came, changed or went, and that is in force.
    SkuChanged {
        /// The SKU.
        sku: Sku,
        /// The file's text before; empty when there was none.
        old: String,
        /// Its text now; empty when it went.
        new: String,
    },
    /// A file is broken, or the folder of the SKU files cannot be listed.
    Broken {
        /// What is wrong.
        error: ConfigError,
        /// Whether older settings stay in force; a SKU's file that was never right holds up its jobs.
        old_stay: bool,
    },
    /// What was broken is again as it was before.
    Mended(PathBuf),
}

/// A text as it was read.
#[derive(Debug)]
struct NewText {
    text: String,
    /// When it was first seen.
    since: Instant,
    /// It stood still long enough, and is judged.
    settled: bool,
}

#[derive(Debug)]
struct SkuFile {
    file: PathBuf,
    /// The last text that was right.
    text: String,
    /// The last listing did not find it.
    missed: bool,
}

impl LiveSettings {
    /// Reads and checks the station file.
    ///
    /// # Errors
    /// When it is wrong: there are no older settings to keep.
    pub fn open(file: &Path) -> Result<Self, ConfigError> {
        Self::open_with(file, Overrides::default())
    }

    /// The same, with settings of the command line in place of the station file's for as long as the program runs.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_with(file: &Path, overrides: Overrides) -> Result<Self, ConfigError> {
        let station_text = read(file)?;
        Ok(Self {
            station: Station::parse_with(file, &station_text, &overrides)?,
            overrides,
            station_text,
            skus: BTreeMap::new(),
            new_texts: BTreeMap::new(),
            at_once: false,
            complaints: BTreeMap::new(),
            first_files: None,
            events: Vec::new(),
        })
    }

    /// Takes every text as it is: there is no later look.
    pub fn at_once(self) -> Self {
        Self { at_once: true, ..self }
    }

    /// The station as it is in force.
    pub fn station(&self) -> &Station {
        &self.station
    }

    /// Looks at the station file again. The whole text is compared: two edits within a clock tick differ, too.
    pub fn refresh(&mut self) {
        let file = self.station.file.clone();
        let text = match read(&file) {
            Ok(text) if text == self.station_text => {
                self.new_texts.remove(&file);
                return self.resolved(&file);
            }
            Ok(text) if !self.is_settled(&file, &text, false) => return,
            Ok(text) => text,
            Err(error) => return self.complain(error),
        };
        match Station::parse_with(&file, &text, &self.overrides) {
            Ok(station) => {
                self.station = station;
                let old = std::mem::replace(&mut self.station_text, text.clone());
                self.forgive(&file);
                self.events.push(SettingsEvent::StationChanged { old, new: text });
            }
            Err(error) => self.complain(error),
        }
    }

    /// The settings for a job on this SKU, after a look at its file. A file that is not there while it is saved or
    /// checked out still counts; [`Self::refresh_skus`] says when it is gone.
    ///
    /// # Errors
    /// When the SKU's file is wrong, or the folder of all SKU files is missing, and no older right version is known;
    /// [`ConfigError::BeingSaved`] as long as the station's file or the SKU's may still be written.
    pub fn job(&mut self, sku: &Sku) -> Result<JobSettings, ConfigError> {
        if self.new_texts.get(&self.station.file).is_some_and(|new| !new.settled) {
            return Err(ConfigError::BeingSaved { file: self.station.file.clone() });
        }
        let file = sku_files(&self.station.folders.skus).map(|mut files| files.remove(sku));
        match file.and_then(|file| self.read_sku(sku, file)) {
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

    /// Looks at all SKU files again, so that an edit is noticed before the SKU's next job. A file is gone when two
    /// looks in a row do not find it in a folder that is there.
    pub fn refresh_skus(&mut self) {
        let folder = self.station.folders.skus.clone();
        let found = match sku_files(&folder) {
            Ok(found) => found,
            Err(error) => return self.complain(error),
        };
        self.resolved(&folder);
        let missed = self.skus.iter_mut().filter(|(sku, _)| !found.contains_key(*sku));
        let gone: Vec<Sku> = missed
            .filter_map(|(sku, file)| std::mem::replace(&mut file.missed, true).then(|| sku.clone()))
            .collect();
        for sku in gone {
            let Some(SkuFile { file, text: old, .. }) = self.skus.remove(&sku) else { continue };
            self.forgive(&file);
            self.events.push(SettingsEvent::SkuChanged { sku, old, new: String::new() });
        }
        let station = &self.station.file;
        let known = |file: &PathBuf| self.skus.values().any(|sku| sku.file == *file);
        let counts =
            |file: &PathBuf| file == station || found.values().any(|path| path == file) || known(file);
        self.complaints.retain(|file, _| counts(file));
        self.new_texts.retain(|file, _| counts(file));
        match &mut self.first_files {
            Some(first) => first.retain(|file| found.values().any(|path| path == file) || known(file)),
            None => self.first_files = Some(found.values().cloned().collect()),
        }
        for (sku, path) in found {
            match self.read_sku(&sku, Some(path)) {
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

    fn read_sku(&mut self, sku: &Sku, file: Option<PathBuf>) -> Result<JobSettings, ConfigError> {
        let Some(file) = file else {
            return match self.skus.get(sku) {
                Some(last) => self.station.settings.overridden_by(&last.file, &last.text),
                None => Ok(self.station.settings.clone()),
            };
        };
        let text = read(&file)?;
        let old = self.skus.get(sku).filter(|old| old.file == file);
        if old.is_some_and(|old| old.text == text) {
            self.new_texts.remove(&file);
        } else {
            let held_text = old.is_some_and(|old| !old.text.trim().is_empty());
            if !self.is_settled(&file, &text, held_text) {
                return Err(ConfigError::BeingSaved { file });
            }
        }
        let settings = self.station.settings.overridden_by(&file, &text)?;
        let was_broken = self.forgive(&file);
        let old =
            self.skus.insert(sku.clone(), SkuFile { file: file.clone(), text: text.clone(), missed: false });
        let old = match old {
            Some(old) => old.text,
            None if self.first_files.as_ref().is_some_and(|first| !first.contains(&file)) => String::new(),
            None => text.clone(),
        };
        if old != text {
            self.events.push(SettingsEvent::SkuChanged { sku: sku.clone(), old, new: text });
        } else if was_broken {
            self.events.push(SettingsEvent::Mended(file));
        }
        Ok(settings)
    }

    /// Whether a new text is whole, as far as stillness tells.
    fn is_settled(&mut self, file: &Path, text: &str, held_text: bool) -> bool {
        let emptied = held_text && text.trim().is_empty();
        let still = if emptied { EMPTIED } else { self.station.watch.settle };
        let modified = std::fs::metadata(file).and_then(|metadata| metadata.modified());
        let age = modified.ok().and_then(|modified| modified.elapsed().ok()).unwrap_or_default();
        let new = || NewText { text: text.into(), since: Instant::now(), settled: false };
        let seen = self.new_texts.entry(file.into()).or_insert_with(new);
        if seen.text != text {
            *seen = new();
        }
        seen.settled |= self.at_once || age.max(seen.since.elapsed()) >= still;
        seen.settled
    }

    fn complain(&mut self, error: ConfigError) {
        let words = error.to_string();
        // An option of the command line is wrong only together with the station's file.
        let file = error.file().unwrap_or(&self.station.file).to_path_buf();
        if self.complaints.insert(file.clone(), words.clone()) != Some(words) {
            let of_sku = file != self.station.file && file != self.station.folders.skus;
            let old_stay = !of_sku || self.skus.values().any(|sku| sku.file == file);
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

/// The settings file of each SKU, however its name is spelled. Of two for one SKU the first by name counts.
///
/// # Errors
/// When the folder is missing or cannot be listed: its files may only be out of reach.
fn sku_files(folder: &Path) -> Result<BTreeMap<Sku, PathBuf>, ConfigError> {
    let unreadable = |source| ConfigError::Unreadable { file: folder.into(), source };
    let mut files = BTreeMap::<Sku, PathBuf>::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if let Some(sku) = sku_of(&path) {
            let first = files.entry(sku).or_insert_with(|| path.clone());
            *first = path.min(std::mem::take(first));
        }
    }
    Ok(files)
}

/// The SKU whose settings file this is by its name.
fn sku_of(path: &Path) -> Option<Sku> {
    path.extension().filter(|ending| ending.eq_ignore_ascii_case("toml"))?;
    path.file_stem()?.to_str()?.parse().ok()
}
