//! Settings of the command line, which override those of files.

use toml::Value;

/// The tables that a SKU's file may hold; all others are the station's.
pub(super) const JOB_TABLES: &[&str] = &[
    "part",
    "pattern",
    "placement",
    "correction",
    "rotary",
    "fixture",
    "fill",
    "focus",
    "content",
    "serial",
];

/// The other tables of a station's file.
pub(super) const STATION_TABLES: &[&str] = &[
    "station",
    "folders",
    "field",
    "optics",
    "output",
    "watch",
    "delivery",
    "retention",
    "log",
    "page",
    "fleet",
    "route",
];

/// Settings that the command line gives, as `table.key=value` or by options of their own.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Overrides(pub(super) Vec<Override>);

/// A setting of the command line, whose name exists.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Override {
    pub(super) table: String,
    pub(super) key: String,
    /// The value in TOML.
    pub(super) value: String,
    /// The option as it was typed.
    pub(super) option: String,
}

impl Overrides {
    /// The names of all settings that are given, each with its option.
    pub fn names(&self) -> impl Iterator<Item = (String, &str)> {
        self.0.iter().map(|given| (format!("{}.{}", given.table, given.key), given.option.as_str()))
    }

    /// Whether the setting is given.
    pub fn has(&self, name: &str) -> bool {
        self.names().any(|(given, _)| given == name)
    }

    /// The text that is given for a setting; `None` if there is none or it is not text.
    pub fn text(&self, name: &str) -> Option<String> {
        let given = self.0.iter().find(|given| name.split_once('.') == Some((&given.table, &given.key)))?;
        given.value.parse::<Value>().ok()?.as_str().map(str::to_owned)
    }

    /// The settings that a SKU's file may hold, and those that only a station's file may hold.
    pub fn split(self) -> (Self, Self) {
        let (job, station) = self.0.into_iter().partition(|given| JOB_TABLES.contains(&given.table.as_str()));
        (Self(job), Self(station))
    }

    /// Each setting as a document, with its option.
    pub(super) fn texts(&self) -> impl Iterator<Item = (&str, String)> {
        let text = |Override { table, key, value, .. }: &Override| format!("{table}.{key} = {value}");
        self.0.iter().map(move |given| (given.option.as_str(), text(given)))
    }
}
