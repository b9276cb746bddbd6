//! One laser with its folders, its field and the settings of all its jobs.

use std::ops::Range;
use std::path::{Component, Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;
use serde::de::DeserializeOwned;
use toml::Spanned;

use super::choices::{Backend, DeliveryKind, Outdated, Repeat};
use super::content_keys::{ContentKeys, SerialKeys};
use super::error::ConfigError;
use super::fill_keys::{FillKeys, FocusKeys};
use super::fleet::{FleetKeys, FleetSettings};
use super::keys::{
    CorrectionKeys, FieldKeys, FixtureKeys, JobKeys, OpticsKeys, OutputKeys, PartKeys, PatternKeys,
    PlacementKeys, RotaryKeys, SidecarKeys,
};
use super::overrides::Overrides;
use super::page::{PageKeys, PageSettings};
use super::route::{Route, RouteKeys};
use super::settings::{JobSettings, ViewSource};
use super::sku::{Sku, fold};
use super::text::SettingsText;
use crate::reason::Reason;

/// A station, validated.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Station {
    /// What people call it.
    pub name: String,
    /// The file it was read from.
    pub file: PathBuf,
    /// The folders of drops and results.
    pub folders: FolderPaths,
    /// How drops are noticed.
    pub watch: Watch,
    /// How results reach the marking software.
    pub delivery: DeliverySettings,
    /// How long reports, originals and rejected drops are kept.
    pub retention: Retention,
    /// The log file, if there is one.
    pub log: Option<LogSettings>,
    /// The page in browsers, if there is one.
    pub page: Option<PageSettings>,
    /// The fleet that the station belongs to, if any.
    pub fleet: Option<FleetSettings>,
    /// Which drawings are for other lines; the first rule that fits applies.
    pub routes: Vec<Route>,
    /// The table of a measured lens, if the lens is one.
    pub lens_table: Option<PathBuf>,
    /// The settings of every SKU without its own file.
    pub settings: JobSettings,
}

/// The folders of a station; relative paths in the file are relative to the file.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct FolderPaths {
    /// Where designers drop parts and patterns.
    pub hot: PathBuf,
    /// Where the marking software imports from; only complete corrected drawings appear there.
    pub import: PathBuf,
    /// The originals of finished drops, one folder per SKU.
    pub archive: PathBuf,
    /// The originals of rejected drops, with the reason beside them.
    pub rejected: PathBuf,
    /// Where fitted surfaces are kept.
    pub cache: PathBuf,
    /// Report and pictures of each delivered drawing, one folder per SKU.
    pub reports: PathBuf,
    /// Where the SKUs' settings are read from.
    pub skus: PathBuf,
    /// Where the station keeps its lock, its journal and its status; no two stations may share it.
    pub state: PathBuf,
}

impl FolderPaths {
    /// The folders that a station file names although it is wrong elsewhere. Of a text that cannot be parsed, only the lines
    /// above the mistake are used. `None` when they are not enough.
    #[must_use]
    pub fn of_broken(file: &Path, overrides: &Overrides) -> Option<Self> {
        let whole = read(file).ok()?;
        let resolved = |text: &str| -> Result<Self, ConfigError> {
            let text = SettingsText::new(file, text).with(overrides);
            text.parse::<OnlyFolders>()?.folders.resolve(&text, file.parent().unwrap_or(Path::new("")))
        };
        resolved(&whole)
            .or_else(|error| {
                let above = error.reason().place.line.map_or(0, |line| line.saturating_sub(1));
                let above: String = whole.split_inclusive('\n').take(above as usize).collect();
                resolved(&above)
            })
            .ok()
    }

    /// Why nothing can be delivered into the import folder now; `None` if it can.
    #[must_use]
    pub fn import_trouble(&self) -> Option<Reason> {
        let import = self.import.display();
        let (code, what, remedy) = if self.import.is_dir() {
            return None;
        } else if self.import.exists() {
            let what = format!("The import folder {import} is a file.");
            ("import-is-file", what, "Name the folder that the marking software imports from.")
        } else {
            let what = format!("The import folder {import} does not exist.");
            let remedy = "Create the folder or connect its share. `watch` never creates it; drawings wait until it exists.";
            ("import-missing", what, remedy)
        };
        Some(Reason::new(code, what, remedy))
    }
}

/// How drops are noticed, and when they are complete.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Watch {
    /// How long a file must not change before it is read, unless its writer was seen to close it.
    pub settle: Duration,
    /// The same for a file whose format has no end mark, so that half of it looks whole; never more than `incomplete`.
    pub open_ended: Duration,
    /// Time between two listings of the hot folder.
    pub rescan: Duration,
    /// How long the station waits for the rest of an incomplete file before it is rejected.
    pub incomplete: Duration,
    /// What notices new files between two listings.
    pub backend: Backend,
    /// Number of jobs done in parallel; `None` for as many as the machine has processors.
    pub jobs: Option<usize>,
}

/// How results reach the marking software.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct DeliverySettings {
    /// By folder alone, or with BeamServer.
    pub kind: DeliveryKind,
    /// What is done with a drawing that was delivered before.
    pub repeat: Repeat,
    /// What is done with delivered drawings whose part or settings changed.
    pub outdated: Outdated,
    /// Where BeamServer listens, as `host:port`.
    pub address: String,
    /// The import folder as BeamServer knows it; `None` for the same name as here.
    pub server_folder: Option<String>,
    /// How long BeamServer may take for an answer.
    pub answer: Duration,
    /// Which drawings a second reader reads back before they are delivered.
    pub verify: Verify,
}

/// Which written drawings a second reader reads back from their files and compares with the intended ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Verify {
    /// Every one.
    Always,
    /// None.
    Never,
    /// Those that take no longer than this number of vertices of one polyline.
    UpTo(usize),
}

impl Verify {
    /// This number of vertices is read back within 20 ms: measured 17 ms.
    pub const VERTICES: usize = 35_000;

    /// Whether a drawing is read back that takes as long as this number of vertices
    /// ([`readback_work`](crate::formats::pattern::readback_work)).
    #[must_use]
    pub fn applies_to(self, vertices: usize) -> bool {
        match self {
            Self::Always => true,
            Self::Never => false,
            Self::UpTo(limit) => vertices <= limit,
        }
    }
}

impl Default for Verify {
    fn default() -> Self {
        Self::UpTo(Self::VERTICES)
    }
}

impl Default for DeliverySettings {
    fn default() -> Self {
        Self {
            kind: DeliveryKind::default(),
            repeat: Repeat::default(),
            outdated: Outdated::default(),
            address: "127.0.0.1:11350".into(),
            server_folder: None,
            answer: Duration::from_secs(30),
            verify: Verify::default(),
        }
    }
}

impl DeliverySettings {
    /// The path of a drawing in the import folder, as BeamServer knows it.
    #[must_use]
    pub fn path_for_server(&self, import: &Path, name: &str) -> PathBuf {
        match &self.server_folder {
            // The server may run on another system, so the separator is taken from the setting.
            Some(folder) if folder.ends_with(['/', '\\']) => format!("{folder}{name}").into(),
            Some(folder) if folder.contains('\\') => format!("{folder}\\{name}").into(),
            Some(folder) => format!("{folder}/{name}").into(),
            None => std::path::absolute(import).unwrap_or_else(|_| import.into()).join(name),
        }
    }
}

/// How long files of finished drops are kept; `None` without limit.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Retention {
    /// Reports and their pictures.
    pub reports: Option<Duration>,
    /// Archived originals; never the part that a SKU's surface comes from, nor what is still needed.
    pub archive: Option<Duration>,
    /// Rejected drops with their reasons.
    pub rejected: Option<Duration>,
    /// Size of all three together above which the oldest files are removed earlier, bytes; files that are kept without limit
    /// are not removed.
    pub largest: Option<u64>,
}

impl Default for Retention {
    fn default() -> Self {
        let year = Duration::from_secs(365 * DAY);
        Self { reports: Some(year), archive: None, rejected: Some(year), largest: None }
    }
}

/// Length of a day, s.
const DAY: u64 = 86_400;

/// A log file of limited size.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct LogSettings {
    /// The file.
    pub file: PathBuf,
    /// Size at which a new file is started, bytes.
    pub largest: u64,
    /// Number of older ones that are kept, as `<file>.1`, `<file>.2` …
    pub keep: usize,
}

impl Default for Watch {
    fn default() -> Self {
        Self {
            settle: Duration::from_millis(500),
            open_ended: Duration::from_secs(90),
            rescan: Duration::from_secs(5),
            incomplete: Duration::from_secs(120),
            backend: Backend::Auto,
            jobs: None,
        }
    }
}

impl Station {
    /// Reads and checks a station file.
    ///
    /// # Errors
    /// When the file cannot be read, or anything in it is wrong; see [`ConfigError`].
    pub fn load(file: &Path) -> Result<Self, ConfigError> {
        Self::load_with(file, &Overrides::default())
    }

    /// The same, with settings of the command line in place of the file's.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn load_with(file: &Path, overrides: &Overrides) -> Result<Self, ConfigError> {
        Self::parse_with(file, &read(file)?, overrides)
    }

    /// Checks the text of a station file; `file` is where relative paths start and what errors name.
    ///
    /// # Errors
    /// When anything in the text is wrong; see [`ConfigError`].
    pub fn parse(file: &Path, text: &str) -> Result<Self, ConfigError> {
        Self::parse_with(file, text, &Overrides::default())
    }

    /// The same, with settings of the command line in place of the file's.
    ///
    /// # Errors
    /// As [`parse`](Self::parse).
    pub fn parse_with(file: &Path, text: &str, overrides: &Overrides) -> Result<Self, ConfigError> {
        let text = SettingsText::new(file, text).with(overrides);
        let keys: StationKeys = understood(&text)?;
        let name = keys.station.name;
        if name.get_ref().trim().is_empty() || name.get_ref().chars().any(char::is_control) {
            return Err(ConfigError::Contradiction {
                spot: text.spot(&name.span()),
                what: "The station has no readable name.".into(),
                remedy: "Give it a name on one line.".into(),
            });
        }
        let mut settings = JobSettings::default();
        keys.field.apply(&text, &mut settings)?;
        let base = file.parent().unwrap_or(Path::new(""));
        let lens_table = lens_table(&text, &keys.optics, base)?;
        keys.optics.apply(&text, lens_table.as_deref(), &mut settings)?;
        keys.output.apply(&mut settings);
        let for_all_skus = JobKeys {
            part: keys.part,
            pattern: keys.pattern,
            placement: keys.placement,
            correction: keys.correction,
            rotary: keys.rotary,
            fixture: keys.fixture,
            fill: keys.fill,
            focus: keys.focus,
            content: keys.content,
            serial: keys.serial,
        };
        for_all_skus.apply(&text, &mut settings)?;
        settings.are_for_every_part();
        let folders = keys.folders.resolve(&text, base)?;
        let resolved = |path: &Spanned<PathBuf>| {
            refuse_half_absolute(&text, path)?;
            Ok(normal(&base.join(path.get_ref())))
        };
        let fleet = keys.fleet.check(&text, name.get_ref(), resolved)?;
        Ok(Self {
            routes: keys.route.check(&text, fleet.as_ref())?,
            fleet,
            name: name.into_inner(),
            file: file.into(),
            watch: keys.watch.check(&text)?,
            delivery: keys.delivery.check(&text)?,
            retention: keys.retention.check(&text)?,
            log: keys.log.check(&text, base, &folders)?,
            page: keys.page.check(&text, resolved)?,
            folders,
            lens_table,
            settings,
        })
    }
}

impl Station {
    /// The line that a drawing is for; `None` for this station.
    #[must_use]
    pub fn line_for(&self, sku: &Sku, name: &str) -> Option<&str> {
        let route = self.routes.iter().find(|route| route.is_for(sku, name))?;
        let own = self.fleet.as_ref().map(|fleet| fleet.name.as_str());
        (own != Some(route.line.as_str())).then_some(route.line.as_str())
    }
}

impl JobSettings {
    /// Marks sides and place as the station's, which give way to a marking frame in a part's file.
    fn are_for_every_part(&mut self) {
        if matches!(self.part.view_source, ViewSource::Sides | ViewSource::Rolled) {
            self.part.view_source = ViewSource::Station;
        }
        self.placement.is_place_given = false;
    }

    /// These settings with those of a file beside a pattern: its place, its ink layers, and the method.
    ///
    /// # Errors
    /// When anything in the text is wrong; see [`ConfigError`].
    pub fn with_sidecar(&self, file: &Path, text: &str) -> Result<Self, ConfigError> {
        let text = SettingsText::new(Path::new(file.file_name().unwrap_or_default()), text);
        let mut settings = self.clone();
        understood::<SidecarKeys>(&text)?.apply(&text, &mut settings)?;
        Ok(settings)
    }

    /// These settings with those that the text of a SKU file names; `file` is what errors name.
    ///
    /// # Errors
    /// When anything in the text is wrong; see [`ConfigError`].
    pub fn overridden_by(&self, file: &Path, text: &str) -> Result<Self, ConfigError> {
        let text = SettingsText::new(file, text);
        let mut settings = self.clone();
        understood::<JobKeys>(&text)?.apply(&text, &mut settings)?;
        Ok(settings)
    }
}

impl JobSettings {
    /// These settings with those of the command line that a SKU's file may hold, too.
    ///
    /// # Errors
    /// When any of them is wrong, or is not for a SKU; see [`ConfigError`].
    pub fn with_overrides(&self, overrides: &Overrides) -> Result<Self, ConfigError> {
        let text = SettingsText::of_options(overrides);
        let mut settings = self.clone();
        understood::<JobKeys>(&text)?.apply(&text, &mut settings)?;
        Ok(settings)
    }

    /// The settings of the command line for a laser without a station's file, and which drawings are read back.
    ///
    /// # Errors
    /// When any of them is wrong, or is not for a laser; see [`ConfigError`].
    pub fn without_station(overrides: &Overrides) -> Result<(Self, Verify), ConfigError> {
        let text = SettingsText::of_options(overrides);
        let keys: LaserKeys = understood(&text)?;
        let mut settings = Self::default();
        if let Some(field) = keys.field {
            field.apply(&text, &mut settings)?;
        }
        let lens_table = lens_table(&text, &keys.optics, Path::new(""))?;
        keys.optics.apply(&text, lens_table.as_deref(), &mut settings)?;
        keys.output.apply(&mut settings);
        Ok((settings, keys.delivery.check(&text)?.verify))
    }
}

/// The file of the lens table, if there is one; relative paths start at `base`.
fn lens_table(text: &SettingsText, optics: &OpticsKeys, base: &Path) -> Result<Option<PathBuf>, ConfigError> {
    let Some(given) = optics.table() else { return Ok(None) };
    refuse_half_absolute(text, given)?;
    Ok(Some(normal(&base.join(given.get_ref()))))
}

/// Whether a setting of the command line holds a value of the right kind. Its range is not checked.
pub(super) fn is_of_its_kind(text: &SettingsText) -> Result<(), ConfigError> {
    match text.parse::<StationKeys>() {
        // One setting alone is never a complete station.
        Ok(_) | Err(ConfigError::Missing { .. }) => Ok(()),
        Err(error) => Err(error),
    }
}

/// The tables of a station's file, or the keys of one of them.
pub(super) fn keys_of(table: Option<&str>) -> Vec<String> {
    keys_in::<StationKeys>(table)
}

/// The tables of a kind of settings, or the keys of one of them.
fn keys_in<T: DeserializeOwned>(table: Option<&str>) -> Vec<String> {
    // The error for an unknown key lists all known ones.
    let text = table.map_or("\"\" = 0".into(), |table| format!("{table}.\"\" = 0"));
    match SettingsText::new(Path::new(""), &text).parse::<T>() {
        Err(ConfigError::UnknownKey { allowed, .. }) => allowed,
        _ => Vec::new(),
    }
}

/// The keys of a text. The error for an unknown key names the tables that have this key.
fn understood<T: DeserializeOwned>(text: &SettingsText) -> Result<T, ConfigError> {
    text.parse().map_err(|error| match error {
        ConfigError::UnknownKey { spot, key, allowed, .. } => {
            let mut tables = keys_in::<T>(None);
            tables.retain(|table| keys_in::<T>(Some(table)).contains(&key));
            ConfigError::UnknownKey { spot, key, allowed, tables }
        }
        error => error,
    })
}

/// The text of a settings file.
pub(crate) fn read(file: &Path) -> Result<String, ConfigError> {
    let unreadable = |source| ConfigError::Unreadable { file: file.into(), source };
    // Not through fs-err: the error already names its file.
    let bytes = std::fs::read(file).map_err(unreadable)?;
    String::from_utf8(bytes).map_err(|error| {
        let encoding = match error.as_bytes() {
            [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => "UTF-16",
            [_, 0, ..] | [0, _, ..] => "UTF-16 without a byte order mark",
            _ => "the code page of an older Windows program (ANSI)",
        };
        let what = format!("it is not UTF-8 text, but seems to be in {encoding}");
        unreadable(std::io::Error::new(std::io::ErrorKind::InvalidData, what))
    })
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
    fill: FillKeys,
    #[serde(default)]
    focus: FocusKeys,
    #[serde(default)]
    content: ContentKeys,
    #[serde(default)]
    serial: SerialKeys,
    #[serde(default)]
    rotary: RotaryKeys,
    #[serde(default)]
    output: OutputKeys,
    #[serde(default)]
    watch: WatchKeys,
    #[serde(default)]
    delivery: DeliveryKeys,
    #[serde(default)]
    retention: RetentionKeys,
    #[serde(default)]
    log: LogKeys,
    #[serde(default)]
    page: PageKeys,
    #[serde(default)]
    fleet: FleetKeys,
    #[serde(default)]
    route: RouteKeys,
}

/// The tables of a station that matter to a job without one.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct LaserKeys {
    field: Option<FieldKeys>,
    optics: OpticsKeys,
    output: OutputKeys,
    delivery: DeliveryKeys,
}

/// The part of a station file that is used although the rest is wrong.
#[derive(Deserialize)]
struct OnlyFolders {
    folders: FolderKeys,
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
        ];
        for given in all.iter().filter_map(|(_, given)| *given) {
            refuse_odd_path(text, given)?;
        }
        let all = all.map(|(name, given)| {
            let path = given.map_or(Path::new(name), |given| given.get_ref());
            (name, normal(&base.join(path)), given.unwrap_or(&self.hot).span())
        });
        for (name, path, span) in &all {
            for (other, other_path, other_span) in all[..2].iter().filter(|(other, ..)| other != name) {
                let [inner, outer] = [path, other_path].map(|path| comparable(path));
                // Everything in the hot folder is a drop and everything in the import folder is marked.
                let what = if inner.starts_with(&outer) {
                    format!("The folder `{name}` is in the folder `{other}` or is the same.")
                // Archived and rejected files go into folders named after their SKU, and a SKU may have this name.
                } else if outer.starts_with(&inner) && !["hot", "import", "skus"].contains(name) {
                    format!("The folder `{name}` contains the folder `{other}`.")
                } else {
                    continue;
                };
                let remedy = format!("Choose a folder beside {}.", other_path.display());
                let spot = text.spot(later(span, other_span));
                return Err(ConfigError::Contradiction { spot, what, remedy });
            }
            let twin = all
                .iter()
                .find(|(other, other_path, _)| other != name && comparable(other_path) == comparable(path));
            if let Some((other, _, other_span)) = twin {
                return Err(ConfigError::Contradiction {
                    spot: text.spot(later(span, other_span)),
                    what: format!("The folders `{name}` and `{other}` are the same."),
                    remedy: "Give each of them a separate folder.".into(),
                });
            }
        }
        let [hot, import, archive, rejected, cache, reports, skus, state] = all.map(|(_, path, _)| path);
        Ok(FolderPaths { hot, import, archive, rejected, cache, reports, skus, state })
    }
}

/// The later one of two places; an option of the command line is later than the file.
fn later<'a>(one: &'a Range<usize>, other: &'a Range<usize>) -> &'a Range<usize> {
    if other.start > one.start { other } else { one }
}

/// Refuses a path that names another folder than it seems to.
fn refuse_odd_path(text: &SettingsText, given: &Spanned<PathBuf>) -> Result<(), ConfigError> {
    let path = given.get_ref().to_string_lossy();
    let wrong = |what: String, remedy: String| {
        Err(ConfigError::Contradiction { spot: text.spot(&given.span()), what, remedy })
    };
    if let Some(control) = path.chars().find(|c| c.is_control()) {
        let character = match control {
            '\t' => "a tab (\\t)".to_owned(),
            '\n' => "a line break (\\n)".to_owned(),
            other => format!("the control character {other:?}"),
        };
        return wrong(
            format!("The path has {character}: in double quotes, a backslash begins such a character."),
            "Put paths with backslashes in single quotes, such as 'C:\\temp\\new', or write C:/temp/new."
                .into(),
        );
    }
    if let Some(variable) = variable_in(&path) {
        return wrong(
            format!(
                "The path has {variable}, which isomark does not replace: it would be the name of a folder."
            ),
            "Write the whole path, such as 'C:\\laser\\hot' or /srv/laser/hot, or one relative to this file."
                .into(),
        );
    }
    refuse_half_absolute(text, given)
}

/// What only a shell replaces in a path: `~`, `$HOME`, `%TEMP%`.
fn variable_in(path: &str) -> Option<&str> {
    let parts = || path.split(['/', '\\']);
    let is_word =
        |text: &str| !text.is_empty() && text.chars().all(|c| c.is_alphanumeric() || "_()".contains(c));
    if let Some(home) = parts().next().filter(|first| *first == "~") {
        return Some(home);
    }
    let begins_variable = |part: &&str| {
        part.strip_prefix('$')
            .is_some_and(|rest| rest.starts_with('{') || rest.starts_with("env:") || is_word(rest))
    };
    let is_replaced_on_windows = |part: &&str| {
        let mut pieces = part.split('%').skip(1);
        let name = pieces.next().unwrap_or_default();
        is_word(name) && pieces.next().is_some()
    };
    parts().find(|part| begins_variable(part) || is_replaced_on_windows(part))
}

/// Refuses a path that on Windows depends on the drive or the folder in which the program was started (`C:laser`,
/// `\laser`): another command would use another folder.
fn refuse_half_absolute(text: &SettingsText, given: &Spanned<PathBuf>) -> Result<(), ConfigError> {
    let path = given.get_ref();
    let begins_absolute = matches!(path.components().next(), Some(Component::Prefix(_) | Component::RootDir));
    if path.is_absolute() || !begins_absolute {
        return Ok(());
    }
    Err(ConfigError::Contradiction {
        spot: text.spot(&given.span()),
        what: format!("The path {} depends on where the program is started.", path.display()),
        remedy: "Write it with drive and root, such as 'C:\\laser\\hot' or '\\\\server\\laser\\hot', or relative to this file.".into(),
    })
}

/// The path by which folders are compared: links are followed as far as the path exists, and on Windows case does not
/// matter.
fn comparable(path: &Path) -> PathBuf {
    let full = std::path::absolute(path).unwrap_or_else(|_| path.into());
    let there = full.ancestors().find_map(|folder| Some((folder, std::fs::canonicalize(folder).ok()?)));
    let real = match there {
        Some((folder, real)) => real.join(full.strip_prefix(folder).unwrap_or(Path::new(""))),
        None => full,
    };
    if cfg!(windows) { fold(&real.to_string_lossy()).into() } else { real }
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
    open_ended_s: Option<Spanned<f64>>,
    rescan_s: Option<Spanned<f64>>,
    incomplete_s: Option<Spanned<f64>>,
    jobs: Option<Spanned<f64>>,
}

impl WatchKeys {
    fn check(&self, text: &SettingsText) -> Result<Watch, ConfigError> {
        let mut watch = Watch { backend: self.backend, ..Watch::default() };
        if self.backend == Backend::Poll {
            // Without events only the listing shows new drops.
            watch.rescan = Duration::from_secs(1);
        }
        if let Some(settle) = &self.settle_ms {
            let milliseconds = text.number("watch.settle_ms", settle, 0.0..=600_000.0, "ms")?;
            watch.settle = Duration::from_secs_f64(milliseconds / 1000.0);
        }
        if let Some(limit) = &self.open_ended_s {
            let seconds = text.number("watch.open_ended_s", limit, 0.0..=86_400.0, "s")?;
            watch.open_ended = Duration::from_secs_f64(seconds);
        }
        if let Some(rescan) = &self.rescan_s {
            watch.rescan =
                Duration::from_secs_f64(text.number("watch.rescan_s", rescan, 0.05..=3600.0, "s")?);
        }
        if let Some(limit) = &self.incomplete_s {
            let seconds = text.number("watch.incomplete_s", limit, 0.0..=86_400.0, "s")?;
            watch.incomplete = Duration::from_secs_f64(seconds);
        }
        if let Some(jobs) = &self.jobs {
            watch.jobs = Some(text.number("watch.jobs", jobs, 2.0..=64.0, "jobs")? as usize);
        }
        Ok(watch)
    }
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct DeliveryKeys {
    kind: DeliveryKind,
    repeat: Repeat,
    outdated: Outdated,
    address: Option<Spanned<String>>,
    server_folder: Option<String>,
    answer_s: Option<Spanned<f64>>,
    verify: Option<Spanned<toml::Value>>,
}

impl DeliveryKeys {
    fn check(self, text: &SettingsText) -> Result<DeliverySettings, ConfigError> {
        let mut delivery = DeliverySettings {
            kind: self.kind,
            repeat: self.repeat,
            outdated: self.outdated,
            server_folder: self.server_folder,
            ..DeliverySettings::default()
        };
        if let Some(address) = self.address {
            let port = address.get_ref().rsplit_once(':').map(|(host, port)| (host, port.parse::<u16>()));
            if !matches!(port, Some((host, Ok(_))) if !host.is_empty()) {
                return Err(ConfigError::Contradiction {
                    spot: text.spot(&address.span()),
                    what: "`delivery.address` is not a valid address.".into(),
                    remedy: "Give the host and the port, such as \"127.0.0.1:11350\".".into(),
                });
            }
            delivery.address = address.into_inner();
        }
        if let Some(answer) = &self.answer_s {
            let seconds = text.number("delivery.answer_s", answer, 0.1..=3600.0, "s")?;
            delivery.answer = Duration::from_secs_f64(seconds);
        }
        if let Some(verify) = &self.verify {
            delivery.verify = match verify.get_ref() {
                toml::Value::Boolean(true) => Verify::Always,
                toml::Value::Boolean(false) | toml::Value::Integer(0) => Verify::Never,
                toml::Value::Integer(vertices) => Verify::UpTo(text.in_range(
                    "delivery.verify",
                    *vertices as f64,
                    &verify.span(),
                    1.0..=1e9,
                    "vertices",
                )? as usize),
                _ => {
                    return Err(ConfigError::Contradiction {
                        spot: text.spot(&verify.span()),
                        what: "`delivery.verify` is neither true nor false nor a number of vertices.".into(),
                        remedy: format!(
                            "Give true, false, or the most vertices to read back, such as {}.",
                            Verify::VERTICES
                        ),
                    });
                }
            };
        }
        Ok(delivery)
    }
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct RetentionKeys {
    reports_days: Option<Spanned<toml::Value>>,
    archive_days: Option<Spanned<toml::Value>>,
    rejected_days: Option<Spanned<toml::Value>>,
    max_gb: Option<Spanned<f64>>,
}

impl RetentionKeys {
    fn check(&self, text: &SettingsText) -> Result<Retention, ConfigError> {
        let mut retention = Retention::default();
        for (key, given, kept) in [
            ("retention.reports_days", &self.reports_days, &mut retention.reports),
            ("retention.archive_days", &self.archive_days, &mut retention.archive),
            ("retention.rejected_days", &self.rejected_days, &mut retention.rejected),
        ] {
            let Some(given) = given else { continue };
            let days = match given.get_ref() {
                toml::Value::Boolean(false) => {
                    *kept = None;
                    continue;
                }
                toml::Value::Integer(days) => *days as f64,
                toml::Value::Float(days) => *days,
                _ => {
                    return Err(ConfigError::Contradiction {
                        spot: text.spot(&given.span()),
                        what: format!("`{key}` is neither a number of days nor false."),
                        remedy: "Give a number of days, such as 365, or false to keep everything.".into(),
                    });
                }
            };
            let days = text.in_range(key, days, &given.span(), 1e-5..=36_500.0, "days")?;
            *kept = Some(Duration::from_secs_f64(days * DAY as f64));
        }
        if let Some(given) = &self.max_gb {
            let gigabytes = text.number("retention.max_gb", given, 1e-6..=1e6, "GB")?;
            retention.largest = Some((gigabytes * 1e9) as u64);
        }
        Ok(retention)
    }
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct LogKeys {
    file: Option<Spanned<PathBuf>>,
    max_mb: Option<Spanned<f64>>,
    keep: Option<Spanned<f64>>,
}

impl LogKeys {
    fn check(
        self,
        text: &SettingsText,
        base: &Path,
        folders: &FolderPaths,
    ) -> Result<Option<LogSettings>, ConfigError> {
        let number = |key, given: &Option<Spanned<f64>>, default, range, unit| match given {
            Some(given) => text.number(key, given, range, unit),
            None => Ok(default),
        };
        let megabytes = number("log.max_mb", &self.max_mb, 10.0, 0.001..=10_000.0, "MB")?;
        let keep = number("log.keep", &self.keep, 5.0, 1.0..=1000.0, "files")? as usize;
        let largest = (megabytes * 1e6) as u64;
        let Some(given) = self.file else { return Ok(None) };
        refuse_odd_path(text, &given)?;
        let file = normal(&base.join(given.get_ref()));
        for (name, folder) in [("hot", &folders.hot), ("import", &folders.import)] {
            if comparable(&file).starts_with(comparable(folder)) {
                return Err(ConfigError::Contradiction {
                    spot: text.spot(&given.span()),
                    what: format!("The log would be written into the folder `{name}`."),
                    remedy: format!("Choose a file outside {}.", folder.display()),
                });
            }
        }
        Ok(Some(LogSettings { file, largest, keep }))
    }
}
