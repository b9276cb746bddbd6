//! Content of a job that differs from product to product: the values that were used, and the codes.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::formats::code::Kind;
use crate::formats::pattern::Content;

/// The values of fields that the job used, and its codes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ContentReport {
    /// The serial number that was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<u64>,
    /// Date and time that were given, such as `2026-11-23T14:05:00`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<String>,
    /// The shift.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shift: Option<String>,
    /// The row of a list: values by column.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub row: BTreeMap<String, String>,
    /// The codes in placeholders.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub codes: Vec<CodeReport>,
}

/// A code for machines on the part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct CodeReport {
    /// Its kind.
    pub kind: Kind,
    /// Its content.
    pub content: String,
    /// Its layer.
    pub layer: String,
    /// The block whose rectangle it replaces, if the settings name one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub block: Option<String>,
    /// The handle of its placeholder, if the file has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub handle: Option<String>,
    /// Columns and rows of its modules, without the quiet zone; bars have one row.
    pub modules: [usize; 2],
    /// Width of its quiet zone inside the placeholder, modules.
    pub quiet_zone: usize,
    /// Whether its light modules are marked.
    pub inverted: bool,
    /// Width of a module as drawn, mm.
    pub cell_mm: f64,
    /// Smallest and largest side of a cell on the part, mm; absent beside the part. For bars, only their width.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell_on_part_mm: Option<[f64; 2]>,
    /// The largest change of a side or diagonal of a cell on the part, percent; absent beside the part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_distortion_percent: Option<f64>,
}

impl ContentReport {
    /// The values that a job was given, and its codes.
    #[must_use]
    pub fn new(values: &Content, codes: Vec<CodeReport>) -> Self {
        Self {
            serial: values.serial,
            date: values.date.map(|date| date.to_string()),
            shift: values.shift.clone(),
            row: values.row.clone(),
            codes,
        }
    }

    /// A line for each code.
    pub(super) fn lines(&self) -> impl Iterator<Item = String> {
        self.codes.iter().map(|code| {
            let [columns, rows] = code.modules;
            let mut line = format!(
                "code          {} `{}` on layer {}: {columns} x {rows} modules of {:.3} mm",
                code.kind, code.content, code.layer, code.cell_mm
            );
            if let Some(distortion) = code.max_distortion_percent {
                line += &format!("; cells on the part change by at most {distortion:.2} %");
            }
            line
        })
    }
}
