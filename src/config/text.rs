//! The text of settings: from spans to lines and columns, from the parser's messages to typed errors.

use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue, Deserializer};

use super::error::{ConfigError, Excerpt, Spot};
use super::overrides::Overrides;

/// Settings as they were read: a file, options of the command line, or a file with options that override it.
pub(super) struct SettingsText {
    pieces: Vec<Piece>,
}

/// A text with its place in the numbering of spans, in which one piece follows the other.
struct Piece {
    origin: Origin,
    text: String,
    start: usize,
}

enum Origin {
    File(PathBuf),
    /// An option as it was typed.
    Option(String),
}

impl SettingsText {
    pub(super) fn new(file: &Path, text: &str) -> Self {
        // Editors may write a byte order mark.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text).into();
        Self { pieces: vec![Piece { origin: Origin::File(file.into()), text, start: 0 }] }
    }

    /// Options alone.
    pub(super) fn of_options(overrides: &Overrides) -> Self {
        Self { pieces: Vec::new() }.with(overrides)
    }

    /// The same text with settings of the command line, which replace those of the text.
    pub(super) fn with(mut self, overrides: &Overrides) -> Self {
        for (option, text) in overrides.texts() {
            // One more, because a span may start at the end of its text.
            let start = self.pieces.last().map_or(0, |last| last.start + last.text.len() + 1);
            self.pieces.push(Piece { origin: Origin::Option(option.into()), text, start });
        }
        self
    }

    /// The tables of the text.
    pub(super) fn parse<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        let mut tables = Spanned::new(0..0, DeTable::new());
        for piece in &self.pieces {
            let parsed = DeTable::parse(&piece.text).map_err(|error| self.explain(&error, piece.start))?;
            match piece.origin {
                Origin::File(_) => tables = parsed,
                Origin::Option(_) => replace(tables.get_mut(), moved(parsed.into_inner(), piece.start)),
            }
        }
        T::deserialize(Deserializer::from(tables)).map_err(|error| self.explain(&error, 0))
    }

    /// The place where `span` starts.
    pub(super) fn spot(&self, span: &Range<usize>) -> Spot {
        let piece = self.pieces.iter().rev().find(|piece| piece.start <= span.start);
        match piece.or(self.pieces.first()) {
            Some(Piece { origin: Origin::File(file), text, .. }) => spot_in_file(file, text, span),
            Some(Piece { origin: Origin::Option(option), .. }) => Spot::Option(option.clone()),
            None => Spot::Option(String::new()),
        }
    }

    /// The number, if it is in its range.
    pub(super) fn number(
        &self,
        key: &str,
        given: &Spanned<f64>,
        range: RangeInclusive<f64>,
        unit: &'static str,
    ) -> Result<f64, ConfigError> {
        self.in_range(key, *given.get_ref(), &given.span(), range, unit)
    }

    /// The numbers, if each is in the range.
    pub(super) fn numbers<const N: usize>(
        &self,
        key: &str,
        given: &Spanned<Numbers<N>>,
        range: RangeInclusive<f64>,
        unit: &'static str,
    ) -> Result<[f64; N], ConfigError> {
        for value in &given.get_ref().0 {
            self.in_range(key, *value, &given.span(), range.clone(), unit)?;
        }
        Ok(given.get_ref().0)
    }

    /// The count, if it is in its range.
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
    fn explain(&self, error: &toml::de::Error, start: usize) -> ConfigError {
        let span = error.span().unwrap_or(0..0);
        let span = span.start + start..span.end + start;
        let spot = self.spot(&span);
        let message = error.message().trim_end_matches('.').replace('\n', "; ");
        let mut names = message.split('`').skip(1).step_by(2).map(str::to_owned);
        match (message.split_once('`').map(|(head, _)| head), names.next()) {
            (Some("unknown field "), Some(key)) => {
                ConfigError::UnknownKey { spot, key, allowed: names.collect(), tables: Vec::new() }
            }
            (Some("unknown variant "), Some(given)) => {
                ConfigError::UnknownChoice { spot, given, allowed: names.collect() }
            }
            (Some("missing field "), Some(key)) => ConfigError::Missing { spot, key },
            _ => {
                let backslash = matches!(&spot, Spot::File { excerpt, .. } if excerpt.line.contains('\\'));
                ConfigError::Syntax { spot, message: in_plain_words(message), backslash }
            }
        }
    }
}

/// As many numbers as a direction or a point has, no more and no fewer.
#[derive(Clone, Copy)]
pub(super) struct Numbers<const COUNT: usize>(pub(super) [f64; COUNT]);

impl<'de, const COUNT: usize> Deserialize<'de> for Numbers<COUNT> {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        // Read as an array, the numbers behind the last one would be dropped.
        let numbers = Vec::deserialize(from).ok().and_then(|numbers| numbers.try_into().ok());
        let example =
            if COUNT == 2 { "two numbers, such as [12.5, -3]" } else { "three numbers, such as [1, 0, 0.5]" };
        numbers.map(Self).ok_or_else(|| serde::de::Error::custom(format!("expected {example}")))
    }
}

/// Line and column where `span` starts, with the line itself.
fn spot_in_file(file: &Path, text: &str, span: &Range<usize>) -> Spot {
    let before = text.get(..span.start).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |end| end + 1);
    let line = text[line_start..].lines().next().unwrap_or("");
    let from = (before.len() - line_start).min(line.len());
    let to = span.end.saturating_sub(line_start).clamp(from, line.len());
    Spot::File {
        file: file.into(),
        line: before.matches('\n').count() as u64 + 1,
        column: before[line_start..].chars().count() as u64 + 1,
        excerpt: Excerpt { line: line.into(), marked: from..to },
    }
}

/// Puts the settings of `options` in the place of those in `tables`.
fn replace<'a>(tables: &mut DeTable<'a>, options: DeTable<'a>) {
    for (name, given) in options {
        match (tables.get_mut(name.get_ref().as_ref()).map(Spanned::get_mut), given.into_inner()) {
            (Some(DeValue::Table(keys)), DeValue::Table(given)) => {
                for (key, value) in given {
                    // The key's span is replaced, too.
                    keys.remove(key.get_ref().as_ref());
                    keys.insert(key, value);
                }
            }
            // The file is wrong here, and its own error is shown.
            (Some(_), _) => {}
            (None, given) => {
                let span = name.span();
                tables.insert(name, Spanned::new(span, given));
            }
        }
    }
}

/// The same tables with all spans moved by `start`.
fn moved<'a>(tables: DeTable<'a>, start: usize) -> DeTable<'a> {
    let mut all = DeTable::new();
    for (key, value) in tables {
        all.insert(Spanned::new(later(&key.span(), start), key.into_inner()), moved_value(value, start));
    }
    all
}

fn moved_value<'a>(value: Spanned<DeValue<'a>>, start: usize) -> Spanned<DeValue<'a>> {
    let span = later(&value.span(), start);
    let value = match value.into_inner() {
        DeValue::Table(table) => DeValue::Table(moved(table, start)),
        DeValue::Array(array) => {
            DeValue::Array(array.into_iter().map(|value| moved_value(value, start)).collect())
        }
        other => other,
    };
    Spanned::new(span, value)
}

fn later(span: &Range<usize>, start: usize) -> Range<usize> {
    span.start + start..span.end + start
}

/// The parser's message without the names of Rust's types.
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
        ("expected a sequence", "expected a list, such as [\"a\", \"b\"]"),
    ];
    words.into_iter().fold(message, |message, (theirs, ours)| message.replace(theirs, ours))
}
