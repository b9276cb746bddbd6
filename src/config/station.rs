//! One laser with its folders, its field and what holds for all its jobs.

use std::path::{Component, Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;
use toml::Spanned;

use super::choices::Backend;
use super::error::ConfigError;
use super::keys::{
    CorrectionKeys, FieldKeys, FixtureKeys, JobKeys, OpticsKeys, OutputKeys, PartKeys, PatternKeys,
    PlacementKeys,
};
use super::settings::JobSettings;
use super::text::SettingsText;

/// A station, validated.
#[derive(Debug, Clone, PartialEq)]
pub struct Station {
    /// What people call it.
    pub name: String,
    /// The file it was read from.
    pub file: PathBuf,
    /// Where drops come from and results go to.
    pub folders: FolderPaths,
    /// How drops are noticed.
    pub watch: Watch,
    /// What holds for every SKU that has no file of its own.
    pub settings: JobSettings,
}

/// The folders of a station; relative paths in the file are relative to the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FolderPaths {
    /// Where designers drop parts and patterns.
    pub hot: PathBuf,
    /// Where the marking software imports from; only whole corrected drawings ever appear there.
    pub import: PathBuf,
    /// Where originals go once they are done, one folder per SKU.
    pub archive: PathBuf,
    /// Where originals go that cannot be done, with the reason beside them.
    pub rejected: PathBuf,
    /// Where fitted surfaces are kept.
    pub cache: PathBuf,
    /// Where the report and the preview of each delivered drawing lie, one folder per SKU.
    pub reports: PathBuf,
    /// Where the SKUs' settings are read from.
    pub skus: PathBuf,
    /// Where the station keeps its lock, its journal and its status; no two stations may share it.
    pub state: PathBuf,
}

/// How drops are noticed, and when they count as whole.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Watch {
    /// How long a file's size and time must stand still before it is read, unless its writer was seen to close it.
    pub settle: Duration,
    /// Time between two listings of the hot folder.
    pub rescan: Duration,
    /// How long a file that stands still but ends too early is waited for before it is rejected.
    pub incomplete: Duration,
    /// What notices new files between two listings.
    pub backend: Backend,
}

impl Default for Watch {
    fn default() -> Self {
        Self {
            settle: Duration::from_millis(500),
            rescan: Duration::from_secs(5),
            incomplete: Duration::from_secs(120),
            backend: Backend::Native,
        }
    }
}

impl Station {
    /// Reads and checks a station file.
    ///
    /// # Errors
    /// When the file cannot be read, or anything in it is wrong; see [`ConfigError`].
    pub fn load(file: &Path) -> Result<Self, ConfigError> {
        Self::parse(file, &read(file)?)
    }

    /// Checks the text of a station file; `file` is where relative paths start and what errors name.
    ///
    /// # Errors
    /// When anything in the text is wrong; see [`ConfigError`].
    pub fn parse(file: &Path, text: &str) -> Result<Self, ConfigError> {
        let text = SettingsText::new(file, text);
        let keys: StationKeys = text.parse()?;
        let name = keys.station.name;
        if name.get_ref().trim().is_empty() || name.get_ref().chars().any(char::is_control) {
            return Err(ConfigError::Contradiction {
                spot: text.spot(&name.span()),
                what: "The station has no readable name.".into(),
                remedy: "Give it the name that people use for it, on one line.".into(),
            });
        }
        let mut settings = JobSettings::default();
        keys.field.apply(&text, &mut settings)?;
        keys.optics.apply(&text, &mut settings)?;
        keys.output.apply(&mut settings);
        JobKeys::from_tables(keys.part, keys.pattern, keys.placement, keys.correction, keys.fixture)
            .apply(&text, &mut settings)?;
        Ok(Self {
            name: name.into_inner(),
            file: file.into(),
            folders: keys.folders.resolve(&text, file.parent().unwrap_or(Path::new("")))?,
            watch: keys.watch.check(&text)?,
            settings,
        })
    }
}

impl JobSettings {
    /// These settings with those that the text of a SKU file names; `file` is what errors name.
    ///
    /// # Errors
    /// When anything in the text is wrong; see [`ConfigError`].
    pub fn overridden_by(&self, file: &Path, text: &str) -> Result<Self, ConfigError> {
        let text = SettingsText::new(file, text);
        let mut settings = self.clone();
        text.parse::<JobKeys>()?.apply(&text, &mut settings)?;
        Ok(settings)
    }
}

/// The text of a settings file.
pub(super) fn read(file: &Path) -> Result<String, ConfigError> {
    let unreadable = |source| ConfigError::Unreadable { file: file.into(), source };
    // Not through fs-err: the error names its file itself.
    std::fs::read_to_string(file).map_err(unreadable)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StationKeys {
    station: NameKeys,
    folders: FolderKeys,
    field: FieldKeys,
    #[serde(default)]
    optics: OpticsKeys,
    #[serde(default)]
    fixture: FixtureKeys,
    #[serde(default)]
    part: PartKeys,
    #[serde(default)]
    pattern: PatternKeys,
    #[serde(default)]
    placement: PlacementKeys,
    #[serde(default)]
    correction: CorrectionKeys,
    #[serde(default)]
    output: OutputKeys,
    #[serde(default)]
    watch: WatchKeys,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NameKeys {
    name: Spanned<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FolderKeys {
    hot: Spanned<PathBuf>,
    import: Spanned<PathBuf>,
    archive: Option<Spanned<PathBuf>>,
    rejected: Option<Spanned<PathBuf>>,
    cache: Option<Spanned<PathBuf>>,
    reports: Option<Spanned<PathBuf>>,
    skus: Option<Spanned<PathBuf>>,
    state: Option<Spanned<PathBuf>>,
}

impl FolderKeys {
    fn resolve(&self, text: &SettingsText, base: &Path) -> Result<FolderPaths, ConfigError> {
        let all = [
            ("hot", Some(&self.hot)),
            ("import", Some(&self.import)),
            ("archive", self.archive.as_ref()),
            ("rejected", self.rejected.as_ref()),
            ("cache", self.cache.as_ref()),
            ("reports", self.reports.as_ref()),
            ("skus", self.skus.as_ref()),
            ("state", self.state.as_ref()),
        ]
        .map(|(name, given)| {
            let path = given.map_or(Path::new(name), |given| given.get_ref());
            (name, normal(&base.join(path)), given.unwrap_or(&self.hot).span())
        });
        for (name, path, span) in &all {
            for (other, other_path, _) in &all[..2] {
                // Everything in the hot folder is a drop and everything in the import folder is marked.
                if name != other && path.starts_with(other_path) {
                    return Err(ConfigError::Contradiction {
                        spot: text.spot(span),
                        what: format!("The folder `{name}` lies in the folder `{other}` or is the same."),
                        remedy: format!("Choose a folder outside {}.", other_path.display()),
                    });
                }
            }
            let twin = all.iter().find(|(other, other_path, _)| other != name && other_path == path);
            if let Some((other, ..)) = twin {
                return Err(ConfigError::Contradiction {
                    spot: text.spot(span),
                    what: format!("The folders `{name}` and `{other}` are the same."),
                    remedy: "Give each its own folder.".into(),
                });
            }
        }
        let [hot, import, archive, rejected, cache, reports, skus, state] = all.map(|(_, path, _)| path);
        Ok(FolderPaths { hot, import, archive, rejected, cache, reports, skus, state })
    }
}

/// The path without `.` and with `..` resolved by name, so that two spellings of one folder compare equal.
fn normal(path: &Path) -> PathBuf {
    let mut normal = PathBuf::new();
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir if matches!(normal.components().next_back(), Some(Component::Normal(_))) => {
                normal.pop();
            }
            other => normal.push(other),
        }
    }
    normal
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct WatchKeys {
    backend: Backend,
    settle_ms: Option<Spanned<f64>>,
    rescan_s: Option<Spanned<f64>>,
    incomplete_s: Option<Spanned<f64>>,
}

impl WatchKeys {
    fn check(&self, text: &SettingsText) -> Result<Watch, ConfigError> {
        let mut watch = Watch { backend: self.backend, ..Watch::default() };
        if self.backend == Backend::Poll {
            // Without events the listing alone decides how soon a drop is seen.
            watch.rescan = Duration::from_secs(1);
        }
        if let Some(settle) = &self.settle_ms {
            let milliseconds = text.number("watch.settle_ms", settle, 0.0..=600_000.0, "ms")?;
            watch.settle = Duration::from_secs_f64(milliseconds / 1000.0);
        }
        if let Some(rescan) = &self.rescan_s {
            watch.rescan =
                Duration::from_secs_f64(text.number("watch.rescan_s", rescan, 0.05..=3600.0, "s")?);
        }
        if let Some(limit) = &self.incomplete_s {
            let seconds = text.number("watch.incomplete_s", limit, 0.0..=86_400.0, "s")?;
            watch.incomplete = Duration::from_secs_f64(seconds);
        }
        Ok(watch)
    }
}
