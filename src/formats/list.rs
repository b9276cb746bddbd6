//! Lists of products: CSV with the names of its columns in the first row, and one product in each other row.

use std::collections::BTreeMap;

use csv::{ByteRecord, ReaderBuilder, Trim};

use crate::reason::Reason;

/// Largest list, bytes.
const LARGEST: usize = 64 << 20;
/// Most rows and columns.
const MOST_ROWS: usize = 1_000_000;
const MOST_COLUMNS: usize = 1_000;
/// Longest value, bytes: a quote that is never closed swallows the rows behind it.
const LONGEST: usize = 10_000;

/// Why a list cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what}")]
#[non_exhaustive]
pub struct ListError {
    /// What is wrong, as a sentence without its full stop.
    pub what: String,
    /// The line of the file.
    pub line: Option<u64>,
    /// The column, if the error is about one.
    pub column: Option<String>,
    /// What to do, as a sentence.
    pub remedy: &'static str,
}

/// What to do about a row, or the row of names.
const CORRECT: &str =
    "Correct this row. The first row has the names of the columns, each other row a value for each column.";
/// What to do about a list in another encoding.
const SAVE_AS_UTF8: &str = "Save the list as CSV in UTF-8. In Excel, that is the file type `CSV UTF-8`.";

/// What is wrong with a value, and what to do.
type WrongText = (String, &'static str);

/// A row of a list.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Row {
    /// The row's number, from 1, without the row of names.
    pub number: u64,
    /// The line of the file on which it begins.
    pub line: u64,
    /// Its values by column.
    pub values: BTreeMap<String, String>,
}

/// A product that can be marked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Product {
    /// Its row.
    pub row: Row,
    /// Its serial number.
    pub serial: u64,
}

/// A row that cannot be marked.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// Its serial number, which will not be used.
    pub serial: Option<u64>,
    /// Why it cannot be marked.
    pub reason: Reason,
}

/// The products of a list.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct Products {
    /// Those that can be marked, in the order of the list.
    pub rows: Vec<Product>,
    /// The rows that cannot be marked.
    pub left_out: Vec<LeftOut>,
    /// The number of all rows; each has a serial number.
    pub count: u64,
}

/// A list whose columns are valid; its rows are read one by one.
#[derive(Debug)]
pub struct List<'b> {
    reader: csv::Reader<&'b [u8]>,
    columns: Vec<String>,
    separator: u8,
    record: ByteRecord,
    number: u64,
    bytes: &'b [u8],
    /// A place in the bytes, and its line.
    counted: (usize, u64),
}

impl<'b> List<'b> {
    /// The list in UTF-8, separated by commas, semicolons or tabs, whichever the first line has most.
    ///
    /// # Errors
    /// When the file is too large, or its columns have no or equal names.
    pub fn new(bytes: &'b [u8]) -> Result<Self, ListError> {
        let wrong =
            |what: String, column: Option<String>| ListError { what, line: Some(1), column, remedy: CORRECT };
        if bytes.len() > LARGEST {
            return Err(wrong(
                format!("the list has {} bytes, and at most {LARGEST} are allowed", bytes.len()),
                None,
            ));
        }
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let first = bytes.split(|byte| matches!(byte, b'\n' | b'\r')).next().unwrap_or_default();
        let stated = stated_separator(first);
        let count = |separator: u8| first.iter().filter(|byte| **byte == separator).count();
        let most = [b',', b';', b'\t'].into_iter().rev().max_by_key(|separator| count(*separator));
        let separator = stated.or(most).unwrap_or(b',');
        let mut reader = ReaderBuilder::new()
            .delimiter(separator)
            .trim(Trim::All)
            .flexible(true)
            .has_headers(false)
            .from_reader(bytes);
        let mut record = ByteRecord::new();
        let mut next =
            || reader.read_byte_record(&mut record).map_err(|error| wrong(error.to_string(), None));
        let is_there = match stated {
            Some(_) => next()? && next()?,
            None => next()?,
        };
        if !is_there {
            return Err(wrong("the list is empty".into(), None));
        }
        if ends_in_quotes(bytes, &reader, &record, separator) {
            return Err(wrong(OPEN_QUOTE.into(), None));
        }
        if record.len() > MOST_COLUMNS {
            return Err(wrong(format!("the list has more than {MOST_COLUMNS} columns"), None));
        }
        let mut columns: Vec<String> = Vec::with_capacity(record.len());
        for (index, name) in record.iter().enumerate() {
            let name = text(name).map_err(|(what, remedy)| ListError {
                remedy,
                ..wrong(format!("the name of column {} {what}", index + 1), None)
            })?;
            if name.is_empty() && index + 1 < record.len() {
                return Err(wrong(format!("column {} has no name", index + 1), None));
            }
            if columns.contains(&name) {
                return Err(wrong(format!("two columns are named `{name}`"), Some(name)));
            }
            columns.push(name);
        }
        Ok(Self { reader, columns, separator, record, number: 0, bytes, counted: (0, 1) })
    }

    /// The names of the columns.
    #[must_use]
    pub fn columns(&self) -> &[String] {
        &self.columns
    }
}

/// The separator that Excel writes and reads in a line before the names, such as `sep=;`.
fn stated_separator(line: &[u8]) -> Option<u8> {
    let line = line.strip_prefix(b"\"").map_or(line, |line| line.strip_suffix(b"\"").unwrap_or(line));
    let (_, separator) = line.split_at_checked(4).filter(|(name, _)| name.eq_ignore_ascii_case(b"sep="))?;
    match separator {
        [separator @ (b',' | b';' | b'\t')] => Some(*separator),
        _ => None,
    }
}

impl Iterator for List<'_> {
    type Item = Result<Row, ListError>;

    /// The next row; blank ones are left out.
    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let line = self.reader.position().line();
            match self.reader.read_byte_record(&mut self.record) {
                Ok(false) => return None,
                Ok(true) => {}
                Err(error) => {
                    return Some(Err(ListError {
                        what: error.to_string(),
                        line: Some(line),
                        column: None,
                        remedy: CORRECT,
                    }));
                }
            }
            let is_open = ends_in_quotes(self.bytes, &self.reader, &self.record, self.separator);
            if !is_open && self.record.iter().all(<[u8]>::is_empty) {
                continue;
            }
            self.number += 1;
            if self.number > MOST_ROWS as u64 {
                let what = format!("the list has more than {MOST_ROWS} rows");
                return (self.number == MOST_ROWS as u64 + 1).then_some(Err(ListError {
                    what,
                    line: Some(line),
                    column: None,
                    remedy: "Divide it into several lists.",
                }));
            }
            let line = self.line();
            let row = self.row(line);
            if is_open && row.is_ok() {
                let column =
                    self.record.len().checked_sub(1).and_then(|last| self.columns.get(last)).cloned();
                return Some(Err(ListError {
                    what: OPEN_QUOTE.into(),
                    line: Some(line),
                    column,
                    remedy: CORRECT,
                }));
            }
            return Some(row);
        }
    }
}

impl List<'_> {
    /// The line on which the record begins.
    fn line(&mut self) -> u64 {
        let start = self.record.position().map_or(0, |position| position.byte() as usize);
        let blank = self.bytes.iter().skip(start).take_while(|byte| matches!(byte, b'\n' | b'\r')).count();
        let (from, line) = self.counted;
        let passed = self.bytes.get(from..start + blank).unwrap_or_default();
        let line = line + passed.iter().filter(|byte| **byte == b'\n').count() as u64;
        self.counted = (start + blank, line);
        line
    }

    fn row(&self, line: u64) -> Result<Row, ListError> {
        let wrong = |what: String, column: Option<&String>| ListError {
            what,
            line: Some(line),
            column: column.cloned(),
            remedy: CORRECT,
        };
        let mut values = BTreeMap::new();
        for (index, value) in self.record.iter().enumerate() {
            let column = self.columns.get(index);
            let value = text(value).map_err(|(what, remedy)| ListError {
                remedy,
                ..wrong(format!("the value {what}"), column)
            })?;
            match column {
                Some(column) if column.is_empty() && value.is_empty() => {}
                Some(column) if !column.is_empty() => drop(values.insert(column.clone(), value)),
                _ if value.is_empty() => {}
                _ => {
                    let (values, columns) = (self.record.len(), self.columns.len());
                    let columns = if columns == 1 { "1 column".into() } else { format!("{columns} columns") };
                    let separator = if self.separator == b'\t' {
                        "tab".into()
                    } else {
                        char::from(self.separator).to_string()
                    };
                    return Err(wrong(
                        format!(
                            "the row has {values} values separated by `{separator}`, and the list {columns}; put a value \
                             that contains the separator in double quotes"
                        ),
                        None,
                    ));
                }
            }
        }
        if self.record.len() < self.columns.len()
            && self
                .columns
                .last()
                .is_some_and(|last| !last.is_empty() || self.record.len() + 1 < self.columns.len())
        {
            let column = self.columns.get(self.record.len());
            return Err(wrong("the row has no value for this column and those behind it".into(), column));
        }
        Ok(Row { number: self.number, line, values })
    }
}

/// What is wrong with the last value of a file that ends in quotes.
const OPEN_QUOTE: &str = "the quote of the last value is not closed";

/// Whether the record is the last one and the file ends within its quotes, which the crate accepts. Its rules are those of
/// the crate: a quote opens only at the beginning of a value, and two in a row are one within quotes.
fn ends_in_quotes(bytes: &[u8], reader: &csv::Reader<&[u8]>, record: &ByteRecord, separator: u8) -> bool {
    let end = reader.position().byte() as usize;
    let Some(start) = record.position().map(|position| position.byte() as usize) else { return false };
    if end < bytes.len() || !bytes[start..].contains(&b'"') {
        return false;
    }
    let (mut is_quoted, mut begins) = (false, true);
    let mut rest = bytes[start..].iter().peekable();
    while let Some(byte) = rest.next() {
        match byte {
            b'"' if is_quoted => is_quoted = rest.next_if(|next| **next == b'"').is_some(),
            b'"' if begins => is_quoted = true,
            _ => {}
        }
        begins = !is_quoted && (*byte == separator || matches!(byte, b'\n' | b'\r'));
    }
    is_quoted
}

/// A value as text.
fn text(bytes: &[u8]) -> Result<String, WrongText> {
    let wrong = |what: String| (what, CORRECT);
    if bytes.len() > LONGEST {
        return Err(wrong(format!("has more than {LONGEST} bytes; a quote may be missing at its end")));
    }
    let text = std::str::from_utf8(bytes).map_err(|_| ("is not UTF-8 text".to_owned(), SAVE_AS_UTF8))?;
    match text.chars().find(|letter| letter.is_control()) {
        Some('\n' | '\r') => Err(wrong("contains a line break; a quote may be missing at its end".into())),
        Some(letter) => Err(wrong(format!("contains the control character U+{:04X}", u32::from(letter)))),
        None => Ok(text.trim().to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(text: &[u8]) -> Vec<Result<Row, ListError>> {
        List::new(text).unwrap().collect()
    }

    #[test]
    fn a_quote_that_is_not_closed_at_the_end_of_the_list_is_an_error() {
        for text in ["LOT\n\"A\n", "LOT\n\"A", "Name;LOT\nx;y\nz;\"A\"\"\n", "LOT\r\n\"\r\n"] {
            let found = rows(text.as_bytes()).pop().unwrap().unwrap_err();
            assert_eq!((found.what.as_str(), found.column.as_deref()), (OPEN_QUOTE, Some("LOT")), "{text:?}");
        }
        assert_eq!(List::new(b"\"LOT\n").unwrap_err().what, OPEN_QUOTE);
        for text in [
            "LOT\n\"A\"\n",
            "LOT\n\"A\"",
            "LOT\n5\"\n",
            "LOT\n\"A\"\"\"\n\n",
            "LOT\n \"A\n",
            "LOT\n\"A\"b\"\n",
        ] {
            assert!(rows(text.as_bytes()).iter().all(Result::is_ok), "{text:?}");
        }
    }

    #[test]
    fn separators_quotes_and_blank_rows_are_understood() {
        for text in [
            "LOT,No\nA7,1\n\n\"B, 8\",2\n",
            "\u{feff}LOT;No\r\nA7;1\r\n;\r\n\"B, 8\";2",
            "LOT\tNo\nA7\t1\n\t\nB, 8\t2",
        ] {
            let rows: Vec<Row> = rows(text.as_bytes()).into_iter().map(Result::unwrap).collect();
            let values: Vec<_> = rows.iter().map(|row| (row.number, row.values["LOT"].as_str())).collect();
            assert_eq!(values, [(1, "A7"), (2, "B, 8")], "{text}");
            assert_eq!((rows[0].line, rows[1].line), (2, 4), "{text}");
        }
    }

    #[test]
    fn a_line_that_states_the_separator_is_skipped() {
        for text in [
            "sep=;\r\nLOT;No\r\n\r\nA,7;1\r\nB8;2\r\n",
            "\u{feff}sep=,\nLOT,No\n\n\"A,7\",1\nB8,2",
            "\"sep=\t\"\nLOT\tNo\n\nA,7\t1\nB8\t2\n",
            "SEP=;\nLOT\n\nA,7\nB8\n",
        ] {
            let list = List::new(text.as_bytes()).unwrap();
            assert_eq!(list.columns()[0], "LOT", "{text}");
            let rows: Vec<Row> = list.map(Result::unwrap).collect();
            let lots: Vec<_> =
                rows.iter().map(|row| (row.number, row.line, row.values["LOT"].as_str())).collect();
            assert_eq!(lots, [(1, 4, "A,7"), (2, 5, "B8")], "{text}");
        }
        assert!(List::new(b"sep=;\n").unwrap_err().what.contains("empty"));
        // A column may have this name.
        assert_eq!(List::new(b"sep=x;LOT\n1;2\n").unwrap().columns(), ["sep=x", "LOT"]);
    }

    #[test]
    fn rows_that_cannot_be_read_are_named() {
        for (text, words, line) in [
            (&b"A,B\n1\n"[..], "no value for this column", 2),
            (b"A,B\n1,2\n1,2,3\n", "the row has 3 values separated by `,`, and the list 2 columns", 3),
            (b"A\n1,5\n", "the row has 2 values separated by `,`, and the list 1 column;", 2),
            (b"A\n\"x\ny\n", "line break; a quote may be missing", 2),
            (b"A\n\xff\n", "not UTF-8", 2),
            (b"A\nx\x07\n", "control character U+0007", 2),
        ] {
            let error = rows(text).into_iter().find_map(Result::err).unwrap();
            assert!(error.what.contains(words), "{error}");
            assert_eq!(error.line, Some(line), "{error}");
            let is_encoding = error.what.contains("UTF-8");
            let remedy = if is_encoding { "Save the list as CSV in UTF-8" } else { "Correct this row" };
            assert!(error.remedy.starts_with(remedy), "{error}: {}", error.remedy);
        }
        let open = [b"A\n\"".to_vec(), vec![b'x'; 20_000]].concat();
        assert!(rows(&open)[0].as_ref().unwrap_err().what.contains("quote may be missing"));
        for (text, words) in [
            (&b""[..], "empty"),
            (b"A,A\n1,2\n", "two columns are named `A`"),
            (b"A,,B\n", "column 2 has no name"),
        ] {
            assert!(List::new(text).unwrap_err().what.contains(words));
        }
        // A separator at the end of each line is no column.
        assert_eq!(rows(b"A;B;\n1;2;\n")[0].as_ref().unwrap().values.len(), 2);
    }
}
