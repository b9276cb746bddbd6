//! The text of a settings file: from spans to lines and columns, from the parser's words to typed errors.

use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use toml::Spanned;

use super::error::{ConfigError, Spot};

/// A settings file as it was read.
pub(super) struct SettingsText {
    file: PathBuf,
    text: String,
}

impl SettingsText {
    pub(super) fn new(file: &Path, text: &str) -> Self {
        // An editor's byte order mark is no mistake of the person who wrote the file.
        Self { file: file.into(), text: text.strip_prefix('\u{feff}').unwrap_or(text).into() }
    }

    /// The tables of the file.
    pub(super) fn parse<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        toml::from_str(&self.text).map_err(|error| self.explain(&error))
    }

    /// The line and column where `span` starts.
    pub(super) fn spot(&self, span: &Range<usize>) -> Spot {
        let before = self.text.get(..span.start).unwrap_or(&self.text);
        let line_start = before.rfind('\n').map_or(0, |end| end + 1);
        Spot {
            file: self.file.clone(),
            line: before.matches('\n').count() as u64 + 1,
            column: before[line_start..].chars().count() as u64 + 1,
        }
    }

    /// The number, if it lies in its range.
    pub(super) fn number(
        &self,
        key: &str,
        given: &Spanned<f64>,
        range: RangeInclusive<f64>,
        unit: &'static str,
    ) -> Result<f64, ConfigError> {
        self.in_range(key, *given.get_ref(), &given.span(), range, unit)
    }

    /// The numbers, if each lies in the range.
    pub(super) fn numbers<const N: usize>(
        &self,
        key: &str,
        given: &Spanned<[f64; N]>,
        range: RangeInclusive<f64>,
        unit: &'static str,
    ) -> Result<[f64; N], ConfigError> {
        for value in given.get_ref() {
            self.in_range(key, *value, &given.span(), range.clone(), unit)?;
        }
        Ok(*given.get_ref())
    }

    /// The count, if it lies in its range.
    pub(super) fn count(
        &self,
        key: &str,
        given: &Spanned<usize>,
        range: RangeInclusive<usize>,
    ) -> Result<usize, ConfigError> {
        let (low, high) = (*range.start() as f64, *range.end() as f64);
        self.in_range(key, *given.get_ref() as f64, &given.span(), low..=high, "")?;
        Ok(*given.get_ref())
    }

    pub(super) fn in_range(
        &self,
        key: &str,
        value: f64,
        span: &Range<usize>,
        range: RangeInclusive<f64>,
        unit: &'static str,
    ) -> Result<f64, ConfigError> {
        if range.contains(&value) {
            return Ok(value);
        }
        let (low, high) = range.into_inner();
        Err(ConfigError::OutOfRange { spot: self.spot(span), key: key.into(), value, low, high, unit })
    }

    /// The parser names unknown keys and choices only in its message, with the names in backticks.
    fn explain(&self, error: &toml::de::Error) -> ConfigError {
        let span = error.span().unwrap_or(0..0);
        let spot = self.spot(&span);
        let message = error.message().trim_end_matches('.').replace('\n', "; ");
        let mut names = message.split('`').skip(1).step_by(2).map(str::to_owned);
        match (message.split_once('`').map(|(head, _)| head), names.next()) {
            (Some("unknown field "), Some(key)) => {
                ConfigError::UnknownKey { spot, key, allowed: names.collect() }
            }
            (Some("unknown variant "), Some(given)) => {
                ConfigError::UnknownChoice { spot, given, allowed: names.collect() }
            }
            (Some("missing field "), Some(key)) => ConfigError::Missing { spot, key },
            _ => {
                let line = self.text.lines().nth(spot.line as usize - 1).unwrap_or("");
                let message = in_plain_words(message);
                ConfigError::Syntax { spot, message, backslash: line.contains('\\') }
            }
        }
    }
}

/// What the parser says, without the names of a programmer's types.
fn in_plain_words(message: String) -> String {
    let words = [
        (", expected literal string", ""),
        ("expected f64", "expected a number"),
        ("expected u64", "expected a whole number"),
        ("expected usize", "expected a whole number"),
        ("expected a string", "expected text in quotes"),
        ("expected a boolean", "expected true or false"),
        ("invalid type: ", ""),
        ("floating point `", "number `"),
    ];
    words.into_iter().fold(message, |message, (theirs, ours)| message.replace(theirs, ours))
}
