//! Tables of measured values as spreadsheets write them: a line of column names, then one line for each measurement. Cells
//! may be empty.
//!
//! Commas, semicolons or tabs separate the cells. With semicolons or tabs, and in quotes, the decimal sign may be a comma. Lines
//! that start with `#` and empty lines are skipped. The text is UTF-8, or UTF-16 with its mark, as Excel writes "Unicode text".

use crate::reason::{Place, Reason};

/// Largest number of lines of a table.
const MAX_LINES: usize = 20_000;
/// Coordinates beyond this are mistakes, mm.
const FARTHEST: f64 = 10_000.0;
/// Scales of readings in other units than mm, and what these are.
const UNITS: [(f64, &str); 6] = [
    (1.0 / 25.4, "in inches"),
    (25.4, "in mm of a drawing in inches"),
    (0.1, "in cm"),
    (10.0, "in tenths of a mm"),
    (0.001, "in m"),
    (1000.0, "in micrometres"),
];
/// Readings on the calibrated plane differ by less than this share from their unit.
const ON_PLANE: std::ops::RangeInclusive<f64> = 0.95..=1.05;
/// Readings on a higher plate are smaller, up to this share.
const ON_RAISED_PLATE: std::ops::RangeInclusive<f64> = 0.6..=1.05;

/// The unit of readings that are this many times as long as what was drawn, such as `in inches`. On a plate above the calibrated
/// plane marks are smaller.
#[must_use]
pub fn unit_of_scale(scale: f64, is_raised: bool) -> Option<&'static str> {
    let around = if is_raised { ON_RAISED_PLATE } else { ON_PLANE };
    UNITS.iter().find(|(unit, _)| around.contains(&(scale / unit))).map(|(_, name)| *name)
}

/// A table, by its column names.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurements {
    names: Vec<String>,
    rows: Vec<Row>,
}

/// A line of a table.
#[derive(Debug, Clone, PartialEq)]
struct Row {
    line: u64,
    cells: Vec<String>,
}

/// Why a table cannot be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeasurementsError {
    /// The bytes are not text, or there is no line of column names.
    #[error("the file contains no line of column names")]
    NoTable,
    /// A required column is missing.
    #[error("the column `{name}` is missing")]
    NoColumn {
        /// Its name.
        name: String,
        /// The columns that exist.
        found: Vec<String>,
    },
    /// A cell is not a number in the allowed range.
    #[error("`{cell}` is not a number from -10000 to 10000")]
    NotANumber {
        /// Its content.
        cell: String,
        /// The column.
        column: String,
        /// The line, counted from 1.
        line: u64,
    },
    /// A required cell is empty.
    #[error("the cell `{column}` is empty")]
    Empty {
        /// The column.
        column: String,
        /// The line, counted from 1.
        line: u64,
    },
    /// A line has more cells than there are column names.
    #[error("the line has {cells} cells for {columns} columns")]
    TooManyCells {
        /// The number of cells.
        cells: usize,
        /// The number of columns.
        columns: usize,
        /// The line, counted from 1.
        line: u64,
    },
    /// The table is too long.
    #[error("the table has more than 20000 lines")]
    TooLong,
}

impl MeasurementsError {
    /// The reason that people are shown.
    #[must_use]
    pub fn reason(&self) -> Reason {
        let (line, item) = match self {
            Self::NotANumber { line, column, .. } | Self::Empty { line, column } => {
                (Some(*line), Some(format!("column {column}")))
            }
            Self::TooManyCells { line, .. } => (Some(*line), None),
            Self::NoTable | Self::NoColumn { .. } | Self::TooLong => (None, None),
        };
        let remedy = match self {
            Self::NoTable => "Save the table as CSV text, with the line of column names that isomark wrote.".to_owned(),
            Self::NoColumn { found, .. } => {
                format!("Keep the line of column names that isomark wrote. The table has {}.", found.join(", "))
            }
            Self::NotANumber { .. } => {
                "Write the number in mm, such as 12.5; with semicolons between the cells, 12,5 is also understood.".to_owned()
            }
            Self::Empty { .. } => "Fill in the cell, or remove the whole line.".to_owned(),
            Self::TooManyCells { .. } => {
                "Separate the cells with semicolons if the numbers contain decimal commas.".to_owned()
            }
            Self::TooLong => "Leave only the measurements in the table.".to_owned(),
        };
        let place = Place { line, item, ..Place::default() };
        Reason::new("measurements-unreadable", format!("{self}."), remedy).at(place)
    }
}

impl Measurements {
    /// Reads a table.
    ///
    /// # Errors
    /// When it has no column names, or a line does not fit them.
    pub fn read(bytes: &[u8]) -> Result<Self, MeasurementsError> {
        let text = decoded(bytes);
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        let lines = text.lines().zip(1u64..);
        // Excel writes and reads the separator in a line `sep=;`.
        let is_skipped = |line: &str| line.is_empty() || line.starts_with('#') || line.starts_with("sep=");
        let mut lines = lines.filter(|(line, _)| !is_skipped(line.trim()));
        let (head, _) = lines.next().ok_or(MeasurementsError::NoTable)?;
        let separator = [';', '\t'].into_iter().find(|sign| head.contains(*sign)).unwrap_or(',');
        let cells = |line: &str| cells(line, separator);
        let names: Vec<String> = cells(head).iter().map(|name| name.to_lowercase()).collect();
        if names.len() < 2 || names.iter().any(|name| name.chars().any(char::is_control)) {
            return Err(MeasurementsError::NoTable);
        }
        let mut rows = Vec::new();
        for (text, line) in lines {
            let mut cells = cells(text);
            while cells.len() > names.len() && cells.last().is_some_and(String::is_empty) {
                cells.pop();
            }
            if cells.len() > names.len() {
                return Err(MeasurementsError::TooManyCells {
                    cells: cells.len(),
                    columns: names.len(),
                    line,
                });
            }
            // Spreadsheets keep lines whose cells were all cleared.
            if cells.iter().all(String::is_empty) {
                continue;
            }
            if rows.len() == MAX_LINES {
                return Err(MeasurementsError::TooLong);
            }
            rows.push(Row { line, cells });
        }
        Ok(Self { names, rows })
    }

    /// The number of lines with measurements.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no measurements.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The line in the file of a row, counted from 1.
    #[must_use]
    pub fn line(&self, row: usize) -> u64 {
        self.rows[row].line
    }

    /// Whether there is a column of this name.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        self.names.iter().any(|found| found == name)
    }

    /// The text in a cell; empty if there is none.
    ///
    /// # Errors
    /// When there is no such column.
    pub fn text(&self, row: usize, name: &str) -> Result<&str, MeasurementsError> {
        let column = self
            .names
            .iter()
            .position(|found| found == name)
            .ok_or_else(|| MeasurementsError::NoColumn { name: name.into(), found: self.names.clone() })?;
        Ok(self.rows[row].cells.get(column).map_or("", String::as_str))
    }

    /// The number in a cell; `None` if it is empty.
    ///
    /// # Errors
    /// When there is no such column, or the cell is not a number.
    pub fn number(&self, row: usize, name: &str) -> Result<Option<f64>, MeasurementsError> {
        let cell = self.text(row, name)?;
        if cell.is_empty() {
            return Ok(None);
        }
        // A comma inside a cell cannot separate cells.
        let number = cell.replace(',', ".").parse::<f64>().ok().filter(|value| value.abs() <= FARTHEST);
        number.map(Some).ok_or_else(|| MeasurementsError::NotANumber {
            cell: cell.chars().take(40).collect(),
            column: name.into(),
            line: self.line(row),
        })
    }

    /// The number in a cell that must not be empty.
    ///
    /// # Errors
    /// As [`number`](Self::number), and when it is empty.
    pub fn required(&self, row: usize, name: &str) -> Result<f64, MeasurementsError> {
        let empty = || MeasurementsError::Empty { column: name.into(), line: self.line(row) };
        self.number(row, name)?.ok_or_else(empty)
    }
}

/// The text of a file.
fn decoded(bytes: &[u8]) -> std::borrow::Cow<'_, str> {
    let utf_16 = |bytes: &[u8], number: fn([u8; 2]) -> u16| {
        let numbers: Vec<u16> = bytes.chunks_exact(2).map(|pair| number([pair[0], pair[1]])).collect();
        String::from_utf16_lossy(&numbers).into()
    };
    match bytes {
        [0xff, 0xfe, text @ ..] => utf_16(text, u16::from_le_bytes),
        [0xfe, 0xff, text @ ..] => utf_16(text, u16::from_be_bytes),
        _ => String::from_utf8_lossy(bytes),
    }
}

/// The cells of a line. Separators inside quotes belong to the cell.
fn cells(line: &str, separator: char) -> Vec<String> {
    let (mut cells, mut cell, mut is_quoted) = (Vec::new(), String::new(), false);
    for sign in line.chars() {
        match sign {
            '"' => is_quoted = !is_quoted,
            _ if sign == separator && !is_quoted => {
                cells.push(cell.trim().to_owned());
                cell.clear();
            }
            _ => cell.push(sign),
        }
    }
    cells.push(cell.trim().to_owned());
    cells
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn any_bytes_give_a_table_or_a_reason(bytes in prop_oneof![
            prop::collection::vec(any::<u8>(), 0..200),
            "[xyz;,\\t\\n\"#0-9.eE+-]{0,200}".prop_map(String::into_bytes),
        ]) {
            match Measurements::read(&bytes) {
                Ok(table) => for row in 0..table.len() {
                    for name in table.names.clone() {
                        let number = table.required(row, &name);
                        prop_assert!(number.is_err() || number.is_ok_and(f64::is_finite));
                    }
                },
                Err(error) => prop_assert!(!error.reason().remedy.is_empty()),
            }
        }
    }

    #[test]
    fn tables_of_spreadsheets_are_read_with_their_gaps() {
        for text in [
            "\u{feff}sep=;\r\n# a comment\r\nName;X_mm;y_mm\r\nA1;1,5;-2\r\n;;\r\nB1;;3\r\n",
            "name\tx_mm\ty_mm\nA1\t1.5\t-2\n\nB1\t\t3",
            "name,x_mm,y_mm\n\"A1\",1.5,-2,,\nB1,,3\n",
            "name,x_mm,y_mm\n\"A1\",\"1,5\",-2\nB1,\"\",\"3,0\"\n",
        ] {
            let utf_16 = |bytes: fn(u16) -> [u8; 2]| -> Vec<u8> {
                "\u{feff}"
                    .encode_utf16()
                    .chain(text.trim_start_matches('\u{feff}').encode_utf16())
                    .flat_map(bytes)
                    .collect()
            };
            let table = Measurements::read(text.as_bytes()).unwrap();
            assert_eq!(Measurements::read(&utf_16(u16::to_le_bytes)).as_ref(), Ok(&table));
            assert_eq!(Measurements::read(&utf_16(u16::to_be_bytes)).as_ref(), Ok(&table));
            assert_eq!((table.len(), table.text(0, "name").unwrap()), (2, "A1"), "{text}");
            assert_eq!([0, 1].map(|row| table.number(row, "x_mm").unwrap()), [Some(1.5), None], "{text}");
            assert_eq!([0, 1].map(|row| table.required(row, "y_mm").unwrap()), [-2.0, 3.0], "{text}");
        }
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        let table = Measurements::read(b"a,b\n1,2\n#\n3,x\n,1e9\n").unwrap();
        assert!(table.number(0, "c").unwrap_err().reason().remedy.contains("a, b"));
        let wrong = table.number(1, "b").unwrap_err().reason();
        assert_eq!((wrong.place.line, wrong.place.item.as_deref()), (Some(4), Some("column b")));
        assert!(table.number(2, "b").is_err() && table.required(2, "a").is_err());
        let comma = Measurements::read(b"a,b\n1,5,2,5\n").unwrap_err();
        assert!(comma.reason().remedy.contains("semicolons"), "{comma:?}");
        for bytes in [&b""[..], b"\xff\xfe\0\0", b"# only\n", b"one column\n1\n"] {
            assert_eq!(Measurements::read(bytes), Err(MeasurementsError::NoTable));
        }
    }
}
