//! The products of a list, each with its serial number and its drawing.

use serde::{Deserialize, Serialize};

use crate::formats::list::{LeftOut, Product};
use crate::reason::Reason;

/// Name and version of the JSON form.
const SCHEMA: &str = "isomark.list/1";

/// What became of each row of a list.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ListReport {
    /// Name and version of this form.
    pub schema: String,
    /// The product.
    pub sku: String,
    /// The name of the list.
    pub list: String,
    /// The name of the drawing that the list is for.
    pub drawing: String,
    /// Date and time of all its drawings, if they have one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub date: Option<String>,
    /// The rows that are drawings, in the order of the list.
    pub rows: Vec<ListRow>,
    /// The rows that are left out, in the order of the list.
    pub left_out: Vec<ListGap>,
}

/// A row of a list with its drawing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ListRow {
    /// Its number, from 1, without the row of names.
    pub row: u64,
    /// The line of the list on which it begins.
    pub line: u64,
    /// Its serial number.
    pub serial: u64,
    /// The name of its drawing.
    pub drawing: String,
}

/// A row of a list without a drawing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ListGap {
    /// Its serial number, which will not be used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<u64>,
    /// Why it is left out, with its line.
    pub reason: Reason,
}

impl ListReport {
    /// The report of a list without rows.
    #[must_use]
    pub fn new(sku: &str, list: &str, drawing: &str, date: Option<String>) -> Self {
        let [sku, list, drawing] = [sku, list, drawing].map(str::to_owned);
        Self { schema: SCHEMA.into(), sku, list, drawing, date, rows: Vec::new(), left_out: Vec::new() }
    }

    /// Adds a row with the name of its drawing.
    pub fn add(&mut self, product: &Product, drawing: String) {
        let Product { row, serial } = product;
        self.rows.push(ListRow { row: row.number, line: row.line, serial: *serial, drawing });
    }

    /// Adds a row that is left out.
    pub fn leave_out(&mut self, row: &LeftOut) {
        self.left_out.push(ListGap { serial: row.serial, reason: row.reason.clone() });
    }

    /// The JSON form, indented, with a newline at its end.
    ///
    /// # Errors
    /// Never for finite numbers in the reasons.
    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }
}
