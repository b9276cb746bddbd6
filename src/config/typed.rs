//! Settings as they are typed on the command line: looks up their names and interprets their values.

use std::sync::OnceLock;

use toml::Value;
use toml::de::DeTable;

use super::error::{ConfigError, Spot};
use super::overrides::{Override, Overrides};
use super::station::{is_of_its_kind, keys_of};
use super::text::SettingsText;

impl Overrides {
    /// Adds a setting by its name `table.key`. The value is TOML; text needs no quotes, and a list no brackets. `option` is
    /// what errors name as the place.
    ///
    /// # Errors
    /// When there is no such setting, it is given twice, or the value is of another kind, such as text for a number.
    pub fn add(&mut self, option: &str, name: &str, value: &str) -> Result<(), ConfigError> {
        let (table, key) = known(option, name)?;
        if let Some(other) = self.0.iter().find(|other| (&*other.table, &*other.key) == (table, key)) {
            return Err(ConfigError::Contradiction {
                spot: Spot::Option(option.into()),
                what: format!("`{name}` is given twice, also by `{}`.", other.option),
                remedy: "Remove one of the two.".into(),
            });
        }
        let mut first_error = None;
        for value in readings(value.trim()) {
            let given = Override { table: table.into(), key: key.into(), value, option: option.into() };
            let alone = Self(vec![given]);
            match is_of_its_kind(&SettingsText::of_options(&alone)) {
                Ok(()) => {
                    self.0.extend(alone.0);
                    return Ok(());
                }
                // An error that lists the choices helps most.
                Err(error @ ConfigError::UnknownChoice { .. }) => return Err(error),
                Err(error) => {
                    first_error.get_or_insert(error);
                }
            }
        }
        let nothing = || ConfigError::Syntax {
            spot: Spot::Option(option.into()),
            message: "it is not valid TOML".into(),
            backslash: false,
        };
        Err(first_error.unwrap_or_else(nothing))
    }

    /// Adds a text exactly as it is, although it may look like a list or a number.
    ///
    /// # Errors
    /// As [`add`](Self::add).
    pub fn add_text(&mut self, option: &str, name: &str, text: &str) -> Result<(), ConfigError> {
        self.add(option, name, &Value::String(text.to_owned()).to_string())
    }

    /// Adds a list of texts, each exactly as it is.
    ///
    /// # Errors
    /// As [`add`](Self::add).
    pub fn add_list(&mut self, option: &str, name: &str, texts: &[String]) -> Result<(), ConfigError> {
        let texts = texts.iter().map(|text| Value::String(text.clone())).collect();
        self.add(option, name, &Value::Array(texts).to_string())
    }
}

/// The names of all settings of stations and SKUs, as `table.key`, in alphabetical order.
pub fn setting_names() -> &'static [String] {
    static NAMES: OnceLock<Vec<String>> = OnceLock::new();
    NAMES.get_or_init(|| {
        let keys = |table: String| keys_of(Some(&table)).into_iter().map(move |key| format!("{table}.{key}"));
        let mut names: Vec<String> = keys_of(None).into_iter().flat_map(keys).collect();
        names.sort();
        names
    })
}

/// Table and key of a setting that exists.
fn known<'a>(option: &str, name: &'a str) -> Result<(&'a str, &'a str), ConfigError> {
    let has = |names: &[String], name: &str| names.iter().any(|known| known == name);
    let exists = |(table, key): &(&str, &str)| has(&keys_of(None), table) && has(&keys_of(Some(table)), key);
    // Not all names of settings: to collect them takes longer than to read a drawing.
    if let Some(parts) = name.split_once('.').filter(exists) {
        return Ok(parts);
    }
    let names = setting_names();
    let (table, key) = name.split_once('.').unwrap_or(("", name));
    let in_table: Vec<&String> =
        names.iter().filter(|known| known.split_once('.').is_some_and(|(other, _)| other == table)).collect();
    let with_key: Vec<&String> =
        names.iter().filter(|known| known.split_once('.').is_some_and(|(_, other)| other == key)).collect();
    let allowed = match (in_table.is_empty(), with_key.is_empty()) {
        (false, _) => in_table.into_iter().cloned().collect(),
        (true, false) => with_key.into_iter().cloned().collect(),
        (true, true) if table.is_empty() => names.to_vec(),
        (true, true) => keys_of(None),
    };
    let spot = Spot::Option(option.into());
    Err(ConfigError::UnknownKey { spot, key: name.into(), allowed, tables: Vec::new() })
}

/// The possible meanings of a typed value in TOML, the likeliest first.
fn readings(typed: &str) -> Vec<String> {
    let mut readings = Vec::new();
    // A text with more than one setting is not a value.
    if DeTable::parse(&format!("x = {typed}")).is_ok_and(|table| table.get_ref().len() == 1) {
        readings.push(typed.to_owned());
    }
    // A value that starts with a quote, bracket or brace must be TOML.
    if typed.starts_with(['"', '\'', '[', '{']) {
        return readings;
    }
    let number = |text: &str| text.trim().parse().ok().map(|number: f64| Value::Float(number).to_string());
    let text = |text: &str| Value::String(text.to_owned()).to_string();
    let list = |items: Vec<String>| format!("[{}]", items.join(", "));
    readings.extend(number(typed));
    readings.push(text(typed));
    let items = || typed.split(',').map(str::trim);
    readings.extend(items().map(number).collect::<Option<Vec<_>>>().map(list));
    readings.push(list(items().map(text).collect()));
    readings
}
