//! The products of a list: their values, their serial numbers, and what cannot be marked.

use super::content::{Variable, check_values, variable};
use crate::config::{BadRows, JobSettings, Sku};
use crate::formats::list::{LeftOut, List, ListError, Product, Products, Row};
use crate::reason::{Place, Reason};

/// A list with the drawing and the settings of its products.
#[derive(Debug)]
pub struct ListJob<'a> {
    /// The name of the list, for messages.
    pub file: &'a str,
    /// The SKU of its products.
    pub sku: &'a Sku,
    /// The drawing.
    pub drawing: &'a [u8],
    /// The settings of the drawing.
    pub settings: &'a JobSettings,
    /// How many serial numbers were used before the first row.
    pub used: u64,
    known: Option<Variable>,
}

impl<'a> ListJob<'a> {
    /// The job of a list whose first row gets the serial number with this index.
    #[must_use]
    pub fn new(file: &'a str, sku: &'a Sku, drawing: &'a [u8], settings: &'a JobSettings, used: u64) -> Self {
        Self { file, sku, drawing, settings, used, known: None }
    }

    /// The serial number of a row; `None` beyond the last one.
    #[must_use]
    pub fn serial(&self, number: u64) -> Option<u64> {
        self.settings.content.serial.number(self.used.checked_add(number - 1)?)
    }

    /// The settings of a row, with its values and its serial number.
    ///
    /// # Errors
    /// When no serial number is left.
    pub fn settings_of(&self, row: &Row) -> Result<JobSettings, Reason> {
        let number = self.serial(row.number).ok_or_else(|| {
            let last = self.settings.content.serial.last.unwrap_or(u64::MAX);
            self.refused(
                row,
                Reason::new(
                    "serial-used-up",
                    format!("There is no serial number for this row: {last} is the last one."),
                    "Give a new range, `start` and `last` under [serial], or a shorter list.",
                )
                .with_number("last serial number", last as f64, "", None),
            )
        })?;
        let mut settings = self.settings.clone();
        settings.content.values.serial = Some(number);
        settings.content.values.row = row.values.clone();
        Ok(settings)
    }

    /// Checks the values of a row for the fields and codes of the drawing.
    ///
    /// # Errors
    /// When a field has no value, a code cannot be encoded, or the drawing cannot be read.
    pub fn check(&mut self, row: &Row) -> Result<(), Reason> {
        let settings = self.settings_of(row)?;
        let Variable { fields, places } = match &self.known {
            Some(known) => known,
            None => self.known.insert(variable(self.drawing, &settings)?),
        };
        let content = &settings.content;
        let values = content.values_of(self.sku.as_str());
        check_values(fields.iter().map(String::as_str), places, content, &values, self.file)
            .map_err(|reason| self.refused(row, reason))
    }

    /// The reason for a list or a row that cannot be read.
    #[must_use]
    pub fn unreadable(&self, error: &ListError) -> Reason {
        let reason =
            Reason::new("list-unreadable", format!("The list cannot be read: {error}."), error.remedy);
        let item = error.column.as_ref().map(|column| format!("column {column}"));
        reason.at(Place { file: Some(self.file.into()), line: error.line, item, ..Place::default() })
    }

    /// The reason for a row that cannot be marked, with its number and line.
    #[must_use]
    pub fn refused(&self, row: &Row, mut reason: Reason) -> Reason {
        reason.what = format!("Row {}: {}", row.number, reason.what);
        let place = std::mem::take(&mut reason.place);
        reason.at(Place { file: Some(self.file.into()), line: Some(row.line), ..place })
    }

    /// The reason for a list without a row that can be marked.
    #[must_use]
    pub fn empty(&self) -> Reason {
        let reason = Reason::new(
            "list-empty",
            "The list has no row that can be marked.",
            "Add a row for each product.",
        );
        reason.in_file(self.file)
    }

    /// All products of a list that is short enough to be checked as a whole.
    ///
    /// # Errors
    /// When the list cannot be read, has no row that can be marked or more than `most` rows, or when a row cannot be marked and
    /// the settings refuse such lists.
    pub fn products(mut self, list: &[u8], most: u64) -> Result<Products, Reason> {
        let rows = List::new(list).map_err(|error| self.unreadable(&error))?;
        let mut found = Products::default();
        for (row, number) in rows.zip(1u64..) {
            if number > most {
                let reason = Reason::new(
                    "list-too-long",
                    "The list has more rows than a station takes at once.",
                    "Split the list.",
                );
                return Err(reason
                    .with_number("rows", number as f64, "", Some(most as f64))
                    .in_file(self.file));
            }
            found.count = number;
            let checked = row.map_err(|error| self.unreadable(&error));
            let checked = checked.and_then(|row| self.check(&row).map(|()| row));
            match (checked, self.serial(number)) {
                (Ok(row), Some(serial)) => found.rows.push(Product { row, serial }),
                (Err(reason), _) if self.settings.content.bad_rows == BadRows::Refuse => return Err(reason),
                (Err(reason), serial) => found.left_out.push(LeftOut { serial, reason }),
                // A row without a serial number is refused above.
                (Ok(_), None) => {}
            }
        }
        if found.rows.is_empty() { Err(self.empty()) } else { Ok(found) }
    }
}
