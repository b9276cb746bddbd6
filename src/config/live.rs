//! Settings that follow their files while a station runs: a good edit counts from the next job on, a broken one
//! leaves the old settings in force and is told once.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::error::ConfigError;
use super::settings::JobSettings;
use super::sku::Sku;
use super::station::{Station, read};

/// The settings of a station and of its SKUs, as of the last look at the files.
#[derive(Debug)]
pub struct LiveSettings {
    station: Station,
    station_text: String,
    skus: BTreeMap<Sku, SkuFile>,
    /// The complaint about each broken file, so that it is told once.
    complaints: BTreeMap<PathBuf, String>,
    events: Vec<SettingsEvent>,
}

/// What was noticed in the files.
#[derive(Debug)]
pub enum SettingsEvent {
    /// The station file changed and is in force.
    StationChanged,
    /// The SKU's file changed or went, and that is in force.
    SkuChanged(Sku),
    /// The file is broken; the settings from before stay in force.
    Broken(ConfigError),
}

#[derive(Debug)]
struct SkuFile {
    file: PathBuf,
    /// The last text that was right.
    text: String,
}

impl LiveSettings {
    /// Reads and checks the station file.
    ///
    /// # Errors
    /// When it is wrong: there are no older settings to keep.
    pub fn open(file: &Path) -> Result<Self, ConfigError> {
        let station_text = read(file)?;
        Ok(Self {
            station: Station::parse(file, &station_text)?,
            station_text,
            skus: BTreeMap::new(),
            complaints: BTreeMap::new(),
            events: Vec::new(),
        })
    }

    /// The station as it is in force.
    pub fn station(&self) -> &Station {
        &self.station
    }

    /// Looks at the station file again. The whole text is compared: two edits within a clock tick differ, too.
    pub fn refresh(&mut self) {
        let file = self.station.file.clone();
        let text = match read(&file) {
            Ok(text) if text == self.station_text => return self.forgive(&file),
            Ok(text) => text,
            Err(error) => return self.complain(error),
        };
        match Station::parse(&file, &text) {
            Ok(station) => {
                self.station = station;
                self.station_text = text;
                self.forgive(&file);
                self.events.push(SettingsEvent::StationChanged);
            }
            Err(error) => self.complain(error),
        }
    }

    /// The settings for a job on this SKU, after a look at its file.
    ///
    /// # Errors
    /// When the SKU's file is wrong and there is no older right version of it.
    pub fn job(&mut self, sku: &Sku) -> Result<JobSettings, ConfigError> {
        match self.read_sku(sku) {
            Ok(settings) => Ok(settings),
            Err(error) => {
                let Some(old) = self.skus.get(sku) else { return Err(error) };
                let settings = self.station.settings.overridden_by(&old.file, &old.text);
                self.complain(error);
                settings
            }
        }
    }

    /// What was noticed since the last call.
    pub fn take_events(&mut self) -> Vec<SettingsEvent> {
        std::mem::take(&mut self.events)
    }

    fn read_sku(&mut self, sku: &Sku) -> Result<JobSettings, ConfigError> {
        let Some(file) = find_sku_file(&self.station.folders.skus, sku)? else {
            if let Some(gone) = self.skus.remove(sku) {
                self.forgive(&gone.file);
                self.events.push(SettingsEvent::SkuChanged(sku.clone()));
            }
            return Ok(self.station.settings.clone());
        };
        let text = read(&file)?;
        let settings = self.station.settings.overridden_by(&file, &text)?;
        self.forgive(&file);
        let old = self.skus.insert(sku.clone(), SkuFile { file, text: text.clone() });
        if old.is_some_and(|old| old.text != text) {
            self.events.push(SettingsEvent::SkuChanged(sku.clone()));
        }
        Ok(settings)
    }

    fn complain(&mut self, error: ConfigError) {
        let words = error.to_string();
        if self.complaints.insert(error.file().into(), words.clone()) != Some(words) {
            self.events.push(SettingsEvent::Broken(error));
        }
    }

    fn forgive(&mut self, file: &Path) {
        self.complaints.remove(file);
    }
}

/// The SKU's settings file, whatever the case of its name.
fn find_sku_file(folder: &Path, sku: &Sku) -> Result<Option<PathBuf>, ConfigError> {
    let unreadable = |source| ConfigError::Unreadable { file: folder.into(), source };
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(unreadable(error)),
    };
    let wanted = format!("{}.toml", sku.key());
    for entry in entries {
        let entry = entry.map_err(unreadable)?;
        if entry.file_name().to_string_lossy().to_lowercase() == wanted {
            return Ok(Some(entry.path()));
        }
    }
    Ok(None)
}
