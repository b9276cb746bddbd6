//! Messages for people: why an input was rejected, and what was noticed while it was processed.
//!
//! Every typed error of the readers and of the pipeline can be turned into a [`Reason`]; that is what
//! `rejected/*.reason.json`, `--json` and the summary on stderr show. A [`Notice`] never stops a job.

use serde::{Deserialize, Serialize};

use crate::printable::on_one_line;

mod code;
mod codes;
#[cfg(feature = "station")]
mod shell;

pub use code::{Code, CodeKind};

#[cfg(feature = "station")]
pub(crate) use shell::quoted;

/// Name and version of the JSON form of a [`Reason`]; `plugins/README.md` states what is stable.
pub const SCHEMA: &str = "isomark.reason/1";
/// Largest number of places of a notice.
const MAX_PLACES: usize = 100;

/// Why an input was rejected: what is wrong, where, the number with its unit, and what to do about it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Reason {
    /// Stable name for machines, in kebab case, such as `mesh-truncated`.
    pub code: String,
    /// What is wrong, as one sentence.
    pub what: String,
    /// Where it is wrong, as far as known.
    #[serde(default, skip_serializing_if = "Place::is_unknown")]
    pub place: Place,
    /// The deciding number, with its unit and the limit it violates.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub number: Option<Quantity>,
    /// What to do about it, as one sentence that starts with a verb.
    pub remedy: String,
}

/// A place in a file or on a part; unknown fields are left out.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Place {
    /// The file's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Line in a text file, counted from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
    /// Column in that line, counted from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub column: Option<u64>,
    /// Offset in a binary file, in bytes from its start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub byte: Option<u64>,
    /// The item in the file, such as `LWPOLYLINE 2F`, `mesh "Solid", primitive 3` or `station.folders.hot`; or the option of the
    /// command line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub item: Option<String>,
    /// The layer of the drawing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layer: Option<String>,
    /// A coordinate in mm, in the frame that `what` names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coordinate: Option<Vec<f64>>,
}

/// A number with its unit, and the limit it was compared with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Quantity {
    /// What was measured, such as `incidence angle`.
    pub name: String,
    /// The measured value, in `unit`.
    pub value: f64,
    /// Unit of `value` and `limit`: `mm`, `deg`, `bytes`, `triangles`, or empty for a plain count.
    pub unit: String,
    /// The violated limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
}

/// Something that was assumed, repaired, skipped or found unusual; the job continues.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Notice {
    /// Stable name for machines, in kebab case, such as `unit-assumed`.
    pub code: String,
    /// How much attention it deserves.
    pub severity: Severity,
    /// The text for people, as one sentence with numbers and units.
    pub message: String,
    /// The places on the part that it is about, in the part frame, mm; at most 100.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub places_mm: Vec<[f64; 3]>,
}

/// How much attention a [`Notice`] deserves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Severity {
    /// Worth knowing, nothing to do.
    Note,
    /// Look at it before marking.
    Warning,
}

/// The JSON form of a reason: the schema, the path of the rejected file, and the reason's fields.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(crate) struct ReasonFile<'a> {
    schema: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    drop: Option<&'a str>,
    #[serde(flatten)]
    reason: &'a Reason,
}

impl Reason {
    /// The JSON form, indented, with a newline at its end. `drop` is the path of the rejected file in the hot folder,
    /// with `/` between folders.
    ///
    /// # Errors
    /// Never for a finite number and place.
    pub fn to_json(&self, drop: Option<&str>) -> serde_json::Result<String> {
        let file = ReasonFile { schema: SCHEMA, drop, reason: self };
        serde_json::to_string_pretty(&file).map(|text| text + "\n")
    }

    /// A reason with a code and two sentences; place and number are added with [`at`](Self::at),
    /// [`in_file`](Self::in_file) and [`with_number`](Self::with_number).
    ///
    /// ```
    /// # use isomark::reason::Reason;
    /// let reason = Reason::new("mesh-truncated", "the file is cut off", "copy it again");
    /// assert_eq!(reason.to_string(), "The file is cut off.\n  what to do: Copy it again.");
    /// ```
    pub fn new(code: &str, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            code: code.into(),
            what: sentence(what.into()),
            place: Place::default(),
            number: None,
            remedy: sentence(remedy.into()),
        }
    }

    /// Adds the file's name, unless one is already known.
    #[must_use]
    pub fn in_file(mut self, file: impl Into<String>) -> Self {
        self.place.file.get_or_insert(file.into());
        self
    }

    /// Adds a place.
    #[must_use]
    pub fn at(mut self, place: Place) -> Self {
        let file = self.place.file.take();
        self.place = place;
        if self.place.file.is_none() {
            self.place.file = file;
        }
        self
    }

    /// Adds the deciding number; one that is not finite is left out, because JSON has no word for it.
    #[must_use]
    pub fn with_number(mut self, name: &str, value: f64, unit: &str, limit: Option<f64>) -> Self {
        let limit = limit.filter(|limit| limit.is_finite());
        let quantity = Quantity { name: name.into(), value, unit: unit.into(), limit };
        self.number = Some(quantity).filter(|_| value.is_finite());
        self
    }
}

impl std::fmt::Display for Reason {
    /// One line each for what, where, number and remedy, even if a name in them contains a line break.
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{}", on_one_line(&self.what))?;
        if !self.place.is_unknown() {
            write!(out, "\n  where:      {}", on_one_line(&self.place.to_string()))?;
        }
        if let Some(number) = &self.number {
            write!(out, "\n  number:     {}", on_one_line(&number.to_string()))?;
        }
        write!(out, "\n  what to do: {}", on_one_line(&self.remedy))
    }
}

impl Reason {
    /// The same as text, with the command that explains the code.
    #[must_use]
    pub fn to_text(&self) -> String {
        // These two are clear from their text.
        let is_plain = ["environment", "usage"].contains(&self.code.as_str());
        match Code::named(&self.code).filter(|_| !is_plain) {
            Some(Code { code, .. }) => format!("{self}\n  more:       isomark explain {code}"),
            None => self.to_string(),
        }
    }

    /// The whole reason on one line: what is wrong, then place and number in brackets, then the remedy.
    pub fn on_one_line(&self) -> String {
        let place = (!self.place.is_unknown()).then(|| self.place.to_string());
        let number = self.number.as_ref().map(Quantity::to_string);
        let facts: Vec<String> = place.into_iter().chain(number).collect();
        let facts = if facts.is_empty() { String::new() } else { format!(" ({})", facts.join("; ")) };
        on_one_line(&format!("{}{facts} {}", self.what, self.remedy))
    }
}

impl Place {
    /// Whether nothing is known about the place.
    #[must_use]
    pub fn is_unknown(&self) -> bool {
        *self == Self::default()
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut parts = Vec::new();
        parts.extend(self.file.clone());
        match (self.line, self.column) {
            (Some(line), Some(column)) => parts.push(format!("line {line}, column {column}")),
            (Some(line), None) => parts.push(format!("line {line}")),
            _ => {}
        }
        parts.extend(self.byte.map(|byte| format!("byte {byte}")));
        parts.extend(self.item.clone());
        parts.extend(self.layer.as_ref().map(|layer| format!("layer {layer}")));
        parts.extend(self.coordinate.as_ref().map(|coordinate| {
            let numbers: Vec<String> = coordinate.iter().map(|value| format!("{value:.3}")).collect();
            format!("at ({}) mm", numbers.join(", "))
        }));
        write!(out, "{}", parts.join(", "))
    }
}

impl std::fmt::Display for Quantity {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{} {}", self.name, round_for_people(self.value))?;
        if !self.unit.is_empty() {
            write!(out, " {}", self.unit)?;
        }
        if let Some(limit) = self.limit {
            let gap = if self.unit.is_empty() { "" } else { " " };
            write!(out, " (limit {}{gap}{})", round_for_people(limit), self.unit)?;
        }
        Ok(())
    }
}

impl Notice {
    /// A notice that needs no action.
    pub fn note(code: &str, message: impl Into<String>) -> Self {
        Self { code: code.into(), severity: Severity::Note, message: message.into(), places_mm: Vec::new() }
    }

    /// A notice to look at before marking.
    pub fn warning(code: &str, message: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, ..Self::note(code, message) }
    }

    /// Adds places on the part, mm in the part frame; those that are not finite are left out.
    #[must_use]
    pub fn at_places(mut self, places: impl IntoIterator<Item = [f64; 3]>) -> Self {
        let is_finite = |place: &[f64; 3]| place.iter().all(|value| value.is_finite());
        let room = MAX_PLACES.saturating_sub(self.places_mm.len());
        self.places_mm.extend(places.into_iter().filter(is_finite).take(room));
        self
    }
}

/// Turns an error message, which in Rust has no capital and no full stop, into a sentence. A first word such as `glTF`,
/// `part.bin` or `isomark` keeps its case.
fn sentence(mut text: String) -> String {
    let first = text.split([' ', ',']).next().unwrap_or_default();
    if !first.is_empty() && first != "isomark" && first.chars().all(|letter| letter.is_ascii_lowercase()) {
        text[..1].make_ascii_uppercase();
    }
    if !text.is_empty() && !text.ends_with(['.', '!', '?', ':']) {
        text.push('.');
    }
    text
}

fn round_for_people(value: f64) -> String {
    match value.abs() {
        size if value == value.trunc() && size < 1e15 => format!("{value:.0}"),
        size if size < 5e-4 => format!("{value:.2e}"),
        _ => format!("{value:.4}"),
    }
}
