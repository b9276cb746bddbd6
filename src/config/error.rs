//! What can be wrong with settings, and where.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::overrides::{JOB_TABLES, STATION_TABLES};
use super::sku::Sku;
use super::suggest::{listed, nearest};
use crate::reason::{Place, Reason};

/// The largest whole number up to which all are exact.
const MOST_EXACT: f64 = 9_007_199_254_740_992.0;

/// A mistake in a settings file or in a setting of the command line.
#[derive(Debug)]
#[non_exhaustive]
pub enum ConfigError {
    /// The file cannot be opened or is not UTF-8.
    Unreadable {
        /// The file.
        file: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The folder of the SKU files does not exist or cannot be listed.
    NoSkuFiles {
        /// The folder.
        folder: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// Two files are for the same SKU: their names differ only in case or in how accents are composed.
    Twice {
        /// The file that is too many.
        file: PathBuf,
        /// The other one.
        other: PathBuf,
    },
    /// The name of the file has an ending that isomark does not read.
    Misnamed {
        /// The file.
        file: PathBuf,
        /// The SKU that it is meant for.
        sku: Sku,
    },
    /// The file may still be written.
    BeingSaved {
        /// The file.
        file: PathBuf,
    },
    /// The text is not TOML, or a value has the wrong type.
    Syntax {
        /// Where.
        spot: Spot,
        /// The parser's message.
        message: String,
        /// Whether the line holds a backslash, as an unquoted Windows path does.
        backslash: bool,
    },
    /// A key that does not exist at this place.
    UnknownKey {
        /// Where.
        spot: Spot,
        /// The key as written.
        key: String,
        /// The keys that exist here.
        allowed: Vec<String>,
        /// The tables of the same settings in which this key exists.
        tables: Vec<String>,
    },
    /// A name that is not one of the choices.
    UnknownChoice {
        /// Where.
        spot: Spot,
        /// The name as written.
        given: String,
        /// The names to choose from.
        allowed: Vec<String>,
    },
    /// A required key that is missing.
    Missing {
        /// The table it belongs to.
        spot: Spot,
        /// The key.
        key: String,
    },
    /// A number outside its range.
    OutOfRange {
        /// Where.
        spot: Spot,
        /// The key.
        key: String,
        /// The number, in `unit`.
        value: f64,
        /// Smallest allowed number, in `unit`.
        low: f64,
        /// Greatest allowed number, in `unit`.
        high: f64,
        /// `mm`, `deg`, `s`, `ms`.
        unit: &'static str,
    },
    /// Values that are valid alone and wrong together or at this place.
    Contradiction {
        /// Where.
        spot: Spot,
        /// What is wrong, as a sentence.
        what: String,
        /// What to do, as a sentence.
        remedy: String,
    },
}

/// Where a setting is given.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Spot {
    /// In a settings file.
    File {
        /// The file.
        file: PathBuf,
        /// Line, counted from 1.
        line: u64,
        /// Column in characters, counted from 1.
        column: u64,
        /// The line itself.
        excerpt: Excerpt,
    },
    /// On the command line, with the option as it was typed.
    Option(String),
}

/// A line of a settings file, and its wrong part.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Excerpt {
    /// The line without its end.
    pub line: String,
    /// The bytes of the line that are wrong; empty for a place between two characters.
    pub marked: Range<usize>,
}

impl ConfigError {
    /// The file that is wrong; `None` for an option of the command line.
    #[must_use]
    pub fn file(&self) -> Option<&Path> {
        match self {
            Self::Unreadable { file, .. }
            | Self::Twice { file, .. }
            | Self::Misnamed { file, .. }
            | Self::BeingSaved { file } => Some(file),
            Self::NoSkuFiles { folder, .. } => Some(folder),
            _ => match self.spot()? {
                Spot::File { file, .. } => Some(file),
                Spot::Option(_) => None,
            },
        }
    }

    /// Where the mistake is; `None` for a file as a whole.
    pub fn spot(&self) -> Option<&Spot> {
        match self {
            Self::Unreadable { .. }
            | Self::NoSkuFiles { .. }
            | Self::Twice { .. }
            | Self::Misnamed { .. }
            | Self::BeingSaved { .. } => None,
            Self::Syntax { spot, .. }
            | Self::UnknownKey { spot, .. }
            | Self::UnknownChoice { spot, .. }
            | Self::Missing { spot, .. }
            | Self::OutOfRange { spot, .. }
            | Self::Contradiction { spot, .. } => Some(spot),
        }
    }

    /// The reason that people are shown.
    #[must_use]
    pub fn reason(&self) -> Reason {
        let written = |text: String| if self.is_option() { as_typed(&text) } else { text };
        let mut reason = Reason::new(self.code(), written(self.what()), written(self.remedy()));
        reason.place = self.place();
        if let Self::OutOfRange { key, value, low, high, unit, .. } = self {
            let limit = Some(if *value < *low { *low } else { *high });
            return reason.with_number(key, *value, unit, limit);
        }
        reason
    }

    fn code(&self) -> &'static str {
        match self {
            Self::Unreadable { .. } | Self::NoSkuFiles { .. } => "settings-unreadable",
            Self::Twice { .. } => "settings-twice",
            Self::Misnamed { .. } => "name-misspelt",
            Self::BeingSaved { .. } => "settings-being-saved",
            Self::Syntax { .. } => "settings-syntax",
            Self::UnknownKey { .. } => "settings-unknown-key",
            Self::UnknownChoice { .. } => "settings-unknown-choice",
            Self::Missing { .. } => "settings-missing-key",
            Self::OutOfRange { .. } => "settings-out-of-range",
            Self::Contradiction { .. } => "settings-contradiction",
        }
    }

    fn place(&self) -> Place {
        let item = match self {
            Self::UnknownKey { key, .. } | Self::Missing { key, .. } | Self::OutOfRange { key, .. } => {
                Some(key.clone())
            }
            _ => None,
        };
        match self.spot() {
            Some(Spot::File { file, line, column, .. }) => {
                let file = Some(file.display().to_string());
                Place { file, line: Some(*line), column: Some(*column), item, ..Place::default() }
            }
            Some(Spot::Option(option)) => Place { item: Some(option.clone()), ..Place::default() },
            None => {
                let file = self.file().map(|file| file.display().to_string());
                Place { file, ..Place::default() }
            }
        }
    }

    fn is_option(&self) -> bool {
        matches!(self.spot(), Some(Spot::Option(_)))
    }

    fn what(&self) -> String {
        if let Some((what, _)) = self.misplaced_table().or_else(|| self.quoted_value()) {
            return what;
        }
        match self {
            Self::Unreadable { file, source } if source.kind() == std::io::ErrorKind::NotFound => {
                format!("There is no file {}.", file.display())
            }
            Self::Unreadable { source, .. } => format!("The settings cannot be read: {source}."),
            Self::NoSkuFiles { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
                "The folder of the SKU files does not exist.".into()
            }
            Self::NoSkuFiles { source, .. } => {
                format!("The folder of the SKU files cannot be listed: {source}.")
            }
            Self::Misnamed { file, sku } => {
                format!(
                    "{} is not read: the settings of SKU `{sku}` must have the name {sku}.toml.",
                    file.display()
                )
            }
            Self::Twice { file, other } => format!(
                "Two settings files are for the same SKU, {} and {}: their names differ only in case, or in how accents are composed.",
                file.display(),
                other.display()
            ),
            Self::BeingSaved { .. } => "The settings may still be written.".into(),
            Self::Syntax { message, .. } if self.is_option() => {
                format!("The value cannot be understood: {message}.")
            }
            Self::Syntax { message, .. } => format!("The settings cannot be understood: {message}."),
            Self::UnknownKey { key, allowed, .. } if self.is_option() && allowed.contains(key) => {
                format!("`{key}` is a table, not a setting.")
            }
            Self::UnknownKey { key, .. } if self.is_option() => format!("There is no setting `{key}`."),
            Self::UnknownKey { key, .. } if self.is_table() => format!("There is no table `[{key}]` here."),
            Self::UnknownKey { key, .. } => format!("There is no key `{key}` here."),
            Self::UnknownChoice { given, .. } => format!("`{given}` is not one of the choices."),
            Self::Missing { key, .. } => format!("The key `{key}` is missing."),
            // Larger whole numbers are not shown as they were given.
            Self::OutOfRange { key, value, high, unit, .. }
                if value.is_finite() && *value > MOST_EXACT && *high <= MOST_EXACT =>
            {
                format!("`{key}` cannot be more than {high} {unit}.").replace(" .", ".")
            }
            Self::OutOfRange { key, value, unit, .. } => {
                format!("`{key}` cannot be {value} {unit}.").replace(" .", ".")
            }
            Self::Contradiction { what, .. } => what.clone(),
        }
    }

    fn remedy(&self) -> String {
        if let Some((_, remedy)) = self.misplaced_table().or_else(|| self.quoted_value()) {
            return remedy;
        }
        match self {
            Self::Unreadable { file, .. } if file.is_dir() => {
                format!("Name the file in that folder, such as {}.", file.join("station.toml").display())
            }
            Self::Unreadable { file, source }
                if source.kind() != std::io::ErrorKind::InvalidData && file.to_string_lossy().contains('"') =>
            {
                "Remove the backslash in front of the closing quote: Windows takes \\\" for a quote that belongs to the name.".into()
            }
            Self::Unreadable { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
                "Check its name and its folder.".into()
            }
            Self::NoSkuFiles { .. } => {
                "Connect its share, create it, or correct `skus` under [folders]. Until then, drawings of a SKU whose file was not read \
                 before wait."
                    .into()
            }
            Self::Twice { .. } => "Keep one of the two files.".into(),
            Self::Misnamed { sku, .. } => format!(
                "Rename it to {sku}.toml, or move it elsewhere if the SKU has no settings of its own. Windows hides the ending .txt: turn on \
                 “File name extensions” in the Explorer."
            ),
            Self::BeingSaved { .. } => "Wait: isomark reads them again in a moment.".into(),
            Self::Unreadable { source, .. } if source.kind() == std::io::ErrorKind::InvalidData => {
                "Save it as UTF-8; in the Editor (Notepad) of Windows with “Save as” and the encoding UTF-8.".into()
            }
            Self::Unreadable { .. } => "Check the path, the permissions and that it is UTF-8 text.".into(),
            Self::Syntax { backslash: true, .. } => {
                "Write paths with forward slashes, or put them in single quotes: 'C:\\laser\\import'.".into()
            }
            Self::Syntax { message, .. } if self.is_option() && message.contains("expected ") => {
                format!("Give {}.", message.rsplit("expected ").next().unwrap_or_default())
            }
            Self::Syntax { .. } if self.is_option() => {
                "Give text such as `inch`, a number such as 0.5, `true`, `false`, or a list such as `[1, 2]`."
                    .into()
            }
            Self::Syntax { .. } => {
                "Correct the line: write `key = \"text\"`, `key = 1.5`, or `[table]`.".into()
            }
            Self::UnknownKey { key, allowed, .. } if self.is_option() && allowed.contains(key) => {
                format!("Name one of its keys, as in `--set {key}.KEY=VALUE`; watch-config/ lists them.")
            }
            Self::UnknownKey { key, tables, .. } if !tables.is_empty() => {
                let tables: Vec<String> = tables.iter().map(|table| format!("[{table}]")).collect();
                format!("Move `{key}` into {}.", tables.join(" or "))
            }
            Self::UnknownKey { key, allowed, .. } if self.is_table() => {
                let tables: Vec<String> = allowed.iter().map(|table| format!("[{table}]")).collect();
                match nearest(key, allowed) {
                    Some(name) => format!("Did you mean `[{name}]`? Known: {}.", listed(&tables)),
                    None => format!("Use one of: {}.", listed(&tables)),
                }
            }
            Self::UnknownKey { key, allowed, .. } if self.is_option() && !key.contains('.') => {
                match nearest_setting(key, allowed) {
                    Some(name) => format!("Give table.key=value. Did you mean `{name}`?"),
                    None => "Give table.key=value; watch-config/ lists the tables and their keys.".into(),
                }
            }
            Self::UnknownKey { key: given, allowed, .. } | Self::UnknownChoice { given, allowed, .. } => {
                match nearest_setting(given, allowed) {
                    Some(name) => format!("Did you mean `{name}`? Known: {}.", listed(allowed)),
                    None if allowed.is_empty() => "Remove it.".into(),
                    None => format!("Use one of: {}.", listed(allowed)),
                }
            }
            Self::Missing { key, .. } if self.is_option() => format!("Also give `{key}` of the same table."),
            Self::Missing { key, .. } => format!("Add `{key}`; the sample in watch-config/ explains it."),
            Self::OutOfRange { low, high, unit, .. } => {
                format!("Give a number from {low} to {high} {unit}.").replace(" .", ".")
            }
            Self::Contradiction { remedy, .. } => remedy.clone(),
        }
    }
}

impl ConfigError {
    /// Whether an unknown key is a table.
    fn is_table(&self) -> bool {
        let Self::UnknownKey { spot: Spot::File { excerpt, .. }, tables, .. } = self else { return false };
        tables.is_empty() && excerpt.line.trim_start().starts_with('[')
    }

    /// What to say of a table that exists, but not in this file.
    fn misplaced_table(&self) -> Option<(String, String)> {
        let Self::UnknownKey { spot: Spot::File { file, .. }, key, .. } = self else { return None };
        let exists = JOB_TABLES.iter().chain(STATION_TABLES).any(|table| table == key);
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        let home = match stem.split_once('@') {
            _ if !JOB_TABLES.contains(&key.as_str()) => "the station's file".to_owned(),
            Some((sku, _)) if !sku.is_empty() => format!("`skus/{sku}.toml`"),
            _ => "the file of the SKU".to_owned(),
        };
        let remedy = "Move the table there, or remove it.".to_owned();
        (exists && self.is_table()).then(|| (format!("The table `[{key}]` belongs in {home}."), remedy))
    }

    /// What to say of a value in quotes whose key needs one without.
    fn quoted_value(&self) -> Option<(String, String)> {
        let Self::Syntax { spot: Spot::File { excerpt, .. }, message, .. } = self else { return None };
        let (key, value) = excerpt.line.split_once('=')?;
        let inner = value.trim_start().strip_prefix(['"', '\''])?.split(['"', '\'']).next()?.trim();
        let needed = match () {
            () if message.ends_with("expected a number")
                && inner.parse::<f64>().is_ok_and(f64::is_finite) =>
            {
                "a number"
            }
            () if message.ends_with("expected a whole number") && inner.parse::<u64>().is_ok() => {
                "a whole number"
            }
            () if message.ends_with("expected true or false") && ["true", "false"].contains(&inner) => {
                "true or false"
            }
            () => return None,
        };
        let key = key.trim();
        Some((
            format!("`{key}` needs {needed}, not text."),
            format!("Write `{key} = {inner}` without quotes."),
        ))
    }
}

impl std::fmt::Display for ConfigError {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Reason { what, remedy, .. } = self.reason();
        write!(out, "{}: {what} {remedy}", self.place())
    }
}

/// The name nearest to `given`, or else the first one whose key begins with it. The table that all names begin with does not make
/// a key similar to another; without a table, only the keys are compared.
fn nearest_setting(given: &str, names: &[String]) -> Option<String> {
    let (table, key) = given.split_once('.').map_or(("", given), |(table, key)| (table, key));
    let key_of = |name: &'_ String| -> Option<String> {
        match name.split_once('.') {
            Some((other, key)) => (table.is_empty() || table == other).then(|| key.to_owned()),
            None => table.is_empty().then(|| name.clone()),
        }
    };
    let keys: Option<Vec<String>> = names.iter().map(key_of).collect();
    let Some(keys) = keys else { return nearest(given, names).map(str::to_owned) };
    let begins = || keys.iter().find(|known| key.len() >= 3 && known.starts_with(key)).map(String::as_str);
    let found = nearest(key, &keys).or_else(begins)?;
    names.iter().zip(&keys).find(|(_, known)| *known == found).map(|(name, _)| name.clone())
}

/// A message about a settings file as one about an option, which needs neither quotes nor the brackets of lists:
/// `[12.5, -3]` becomes `12.5,-3`. What is in backticks stays as it is in a file.
fn as_typed(text: &str) -> String {
    let pieces = text.split('`').enumerate();
    let typed =
        pieces.map(|(index, piece)| if index % 2 == 0 { without_syntax(piece) } else { piece.to_owned() });
    typed.collect::<Vec<_>>().join("`")
}

fn without_syntax(text: &str) -> String {
    let mut typed = String::new();
    let mut rest = text;
    while let Some((before, (list, after))) =
        rest.split_once('[').and_then(|(before, rest)| Some((before, rest.split_once(']')?)))
    {
        typed += before;
        match list.contains(',') {
            true => typed += &list.replace(", ", ","),
            false => typed += &format!("[{list}]"),
        }
        rest = after;
    }
    (typed + rest).replace('"', "")
}

impl std::error::Error for ConfigError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Unreadable { source, .. } | Self::NoSkuFiles { source, .. } => Some(source),
            _ => None,
        }
    }
}
