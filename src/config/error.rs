//! What can be wrong with a settings file, and where.

use std::path::PathBuf;

use super::suggest::{listed, nearest};
use crate::reason::{Place, Quantity, Reason};

/// A mistake in a settings file.
#[derive(Debug)]
pub enum ConfigError {
    /// The file cannot be opened or is not UTF-8.
    Unreadable {
        /// The file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
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
        /// What the parser said.
        message: String,
        /// Whether the line holds a backslash, as an unquoted Windows path does.
        backslash: bool,
    },
    /// A key that means nothing at this place.
    UnknownKey {
        /// Where.
        spot: Spot,
        /// The key as written.
        key: String,
        /// The keys that mean something here.
        allowed: Vec<String>,
    },
    /// A name that is none of the choices.
    UnknownChoice {
        /// Where.
        spot: Spot,
        /// The name as written.
        given: String,
        /// The names to choose from.
        allowed: Vec<String>,
    },
    /// A key that cannot be left out.
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
    /// Values that are fine alone and wrong together or at this place.
    Contradiction {
        /// Where.
        spot: Spot,
        /// What is wrong, as a sentence.
        what: String,
        /// What to do, as a sentence.
        remedy: String,
    },
}

/// A place in a settings file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Spot {
    /// The file.
    pub file: PathBuf,
    /// Line, counted from 1.
    pub line: u64,
    /// Column in characters, counted from 1.
    pub column: u64,
}

impl ConfigError {
    /// The file that is wrong.
    pub fn file(&self) -> &std::path::Path {
        match self {
            Self::Unreadable { file, .. } | Self::BeingSaved { file } => file,
            Self::Syntax { spot, .. }
            | Self::UnknownKey { spot, .. }
            | Self::UnknownChoice { spot, .. }
            | Self::Missing { spot, .. }
            | Self::OutOfRange { spot, .. }
            | Self::Contradiction { spot, .. } => &spot.file,
        }
    }

    /// The reason that people are shown.
    pub fn reason(&self) -> Reason {
        let mut reason = Reason::new(self.code(), self.what(), self.remedy());
        reason.place = self.place();
        if let Self::OutOfRange { key, value, low, high, unit, .. } = self {
            let limit = Some(if *value < *low { *low } else { *high });
            reason.number = Some(Quantity { name: key.clone(), value: *value, unit: (*unit).into(), limit });
        }
        reason
    }

    fn code(&self) -> &'static str {
        match self {
            Self::Unreadable { .. } => "settings-unreadable",
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
        let file = Some(self.file().display().to_string());
        let (spot, item) = match self {
            Self::Unreadable { .. } | Self::BeingSaved { .. } => return Place { file, ..Place::default() },
            Self::UnknownKey { spot, key, .. }
            | Self::Missing { spot, key }
            | Self::OutOfRange { spot, key, .. } => (spot, Some(key.clone())),
            Self::Syntax { spot, .. }
            | Self::UnknownChoice { spot, .. }
            | Self::Contradiction { spot, .. } => (spot, None),
        };
        Place { file, line: Some(spot.line), column: Some(spot.column), item, ..Place::default() }
    }

    fn what(&self) -> String {
        match self {
            Self::Unreadable { source, .. } => format!("The settings cannot be read: {source}."),
            Self::BeingSaved { .. } => "The settings may still be written.".into(),
            Self::Syntax { message, .. } => format!("The settings cannot be understood: {message}."),
            Self::UnknownKey { key, .. } => format!("There is no key `{key}` here."),
            Self::UnknownChoice { given, .. } => format!("`{given}` is none of the choices."),
            Self::Missing { key, .. } => format!("The key `{key}` is missing."),
            Self::OutOfRange { key, value, unit, .. } => format!("`{key}` cannot be {value} {unit}."),
            Self::Contradiction { what, .. } => what.clone(),
        }
    }

    fn remedy(&self) -> String {
        match self {
            Self::Unreadable { file, .. } if file.is_dir() => {
                format!("Name the file in that folder, such as {}.", file.join("station.toml").display())
            }
            Self::BeingSaved { .. } => "Nothing: they are read again in a moment.".into(),
            Self::Unreadable { .. } => "Check the path, the permissions and that it is UTF-8 text.".into(),
            Self::Syntax { backslash: true, .. } => {
                "Write paths with forward slashes, or put them in single quotes: 'C:\\laser\\import'.".into()
            }
            Self::Syntax { .. } => "Correct the line; text stands in quotes, numbers do not.".into(),
            Self::UnknownKey { key: given, allowed, .. } | Self::UnknownChoice { given, allowed, .. } => {
                match nearest(given, allowed) {
                    Some(name) => format!("Did you mean `{name}`? Known here: {}.", listed(allowed)),
                    None if allowed.is_empty() => "Remove it.".into(),
                    None => format!("Known here: {}.", listed(allowed)),
                }
            }
            Self::Missing { key, .. } => format!("Add `{key}`; the sample in watch-config/ explains it."),
            Self::OutOfRange { low, high, unit, .. } => {
                format!("Give a number from {low} to {high} {unit}.").replace(" .", ".")
            }
            Self::Contradiction { remedy, .. } => remedy.clone(),
        }
    }
}

impl std::fmt::Display for ConfigError {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{}: {} {}", self.place(), self.what(), self.remedy())
    }
}

impl std::error::Error for ConfigError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Unreadable { source, .. } => Some(source),
            _ => None,
        }
    }
}
