//! Points as text, one per line: x, y and z, and any further columns.
//!
//! There is no standard. Blanks, tabs, commas or semicolons separate the columns, and the decimal sign is a point or a
//! comma; the first lines may contain column names, and any line may be a comment. The reader detects all this from the
//! file, which no CSV crate does.

use nalgebra::{Point3, Vector3};

use super::clues::{Clues, is_inch, stated_unit, unit_word};
use super::error::VertexPlace;
use super::raw::is_infinite;
use super::text::{
    bad_line, beginning, first_bytes, last_line, lines, no_number, number, without_mark, words,
};
use super::{LengthUnit, MAX_POINTS, MeshFormat, MeshReadError, RawPart, at_most};
use crate::reason::Notice;

/// The beginnings of comment lines.
const COMMENTS: [&[u8]; 4] = [b"#", b"//", b"%", b"!"];
/// Largest number of lines of other text above the points.
const MAX_HEAD_LINES: usize = 100;
/// Words for a missing value, in lower case.
const MISSING: [&[u8]; 12] =
    [b"", b"nan", b"-nan", b"nan(ind)", b"-nan(ind)", b"null", b"none", b"na", b"n/a", b"#n/a", b"-", b"*"];
/// Heights that mean a missing value (Esri's usual NODATA).
const NO_DATA: [f64; 2] = [-9999.0, -99999.0];
/// Largest deviation of a normal's length from 1.
const UNIT_LENGTH: f64 = 0.01;
/// Number of rows that are examined for decimal commas.
const DECIMAL_ROWS: usize = 10;
/// Words before a list of column names; `FIELDS` is of PCD files.
const LIST_WORDS: [&str; 3] = ["fields", "columns", "format"];
/// Words that are in sentences and no names of columns.
const SENTENCE_WORDS: [&str; 8] = ["and", "are", "as", "in", "is", "of", "the", "with"];
const FORMAT: MeshFormat = MeshFormat::Xyz;

/// How numbers are written in a line.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Dialect {
    /// The column separator; `None` for blanks.
    separator: Option<u8>,
    decimal_comma: bool,
}

/// Which columns are read.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Columns {
    point: [usize; 3],
    normal: Option<[usize; 3]>,
}

/// The content of the lines above the first point.
#[derive(Default)]
struct Head {
    producer: Option<String>,
    unit: Option<LengthUnit>,
    /// The lines that may have the names of the columns, the last one first.
    named: Vec<NamedLine>,
}

/// A line with the letters x, y and z above the first point, in lower case.
struct NamedLine {
    line: u64,
    is_comment: bool,
    text: String,
}

/// Reads a scan from a list of points.
pub(super) fn read(bytes: &[u8]) -> Result<RawPart, MeshReadError> {
    let text = checked(bytes)?;
    let (head, dialect, columns, first) = head(text)?;
    let (mut points, mut normals) = (Vec::new(), Vec::new());
    let (mut missing, mut origins, mut infinite) = (0, 0, None::<(usize, VertexPlace)>);
    let last = columns.point.into_iter().chain(columns.normal.into_iter().flatten()).max().unwrap_or(2);
    let needed = columns.point.into_iter().max().unwrap_or(2);
    let mut fields = Vec::new();
    for (line, text) in lines(text).skip(first).filter(|(_, text)| !has_no_point(text)) {
        dialect.split(text, &mut fields);
        if fields.len() <= needed {
            return Err(bad_line(line, text, "it has fewer columns than the first line of numbers"));
        }
        let mut values = [f64::NAN; 3];
        for (value, column) in values.iter_mut().zip(columns.point) {
            *value = dialect
                .value(fields[column])
                .ok_or_else(|| bad_line(line, text, no_number(fields[column])))?;
        }
        let is_origin = values == [0.0; 3];
        if is_infinite(&Point3::from(values)) {
            infinite.get_or_insert((0, VertexPlace::Obj { line })).0 += 1;
            continue;
        }
        if !values.iter().all(|value| value.is_finite()) || NO_DATA.contains(&values[2]) {
            missing += 1;
            continue;
        }
        at_most("points", points.len() + 1, MAX_POINTS)?;
        if let Some(normal) = columns.normal {
            let value = |column: usize| fields.get(column).and_then(|field| dialect.value(field));
            let normal = normal.map(|column| value(column).filter(|_| column <= last).unwrap_or(f64::NAN));
            normals.push(Vector3::from(normal));
        }
        origins += usize::from(is_origin);
        points.push(Point3::from(values));
    }
    let are_normals = |normals: &[Vector3<f64>]| {
        normals.iter().all(|normal| (normal.norm() - 1.0).abs() <= UNIT_LENGTH || *normal == Vector3::zeros())
    };
    if normals.len() != points.len() || !are_normals(&normals) {
        normals.clear();
    }
    // One point may be at the origin; several are pixels without a measurement.
    if origins > 1 {
        missing += origins;
        let mut kept = points.iter().map(|point| *point != Point3::origin());
        normals.retain(|_| kept.next().unwrap_or(true));
        points.retain(|point| *point != Point3::origin());
    }
    let mut clues = Clues::new(FORMAT, head.producer);
    clues.stated_unit = head.unit;
    let mut part = RawPart::new(clues);
    if points.is_empty() {
        missing += infinite.map_or(0, |(count, _)| count);
        return Err(MeshReadError::NoPoints { missing });
    }
    (part.missing, part.infinite) = (missing, infinite);
    if !last_line(bytes).2 {
        let text = "the last line has no line break; if the file was cut off there, the last point is wrong";
        part.notices.push(Notice::note("last-line-open", text));
    }
    part.set_scan(points, normals);
    Ok(part)
}

/// Checks whether the last line is complete.
pub(super) fn is_whole(bytes: &[u8]) -> Result<(), MeshReadError> {
    let text = checked(bytes)?;
    let (line, last, ends) = last_line(text);
    if ends || has_no_point(last) {
        return Ok(());
    }
    // Without a line break it is complete if it has as many columns as the first line of numbers.
    let (_, dialect, _, first) = head(text)?;
    let columns = |line: &[u8]| {
        let mut fields = Vec::new();
        dialect.split(line, &mut fields);
        fields.len()
    };
    let expected = lines(text).nth(first).map_or(0, |(_, line)| columns(line));
    if columns(last) >= expected {
        Ok(())
    } else {
        Err(MeshReadError::CutLine { line, text: beginning(last) })
    }
}

fn checked(bytes: &[u8]) -> Result<&[u8], MeshReadError> {
    let text = without_mark(bytes);
    // UTF-16 text has zero bytes, too.
    if text.is_empty() {
        return Err(MeshReadError::EmptyFile);
    }
    if text[..text.len().min(4096)].contains(&0) {
        return Err(MeshReadError::NotThisFormat { format: FORMAT, found: first_bytes(bytes) });
    }
    Ok(text)
}

/// Whether a line is empty or a comment.
fn has_no_point(line: &[u8]) -> bool {
    line.is_empty() || COMMENTS.iter().any(|comment| line.starts_with(comment))
}

/// The content of the lines above the points, how the points are written, and the number of lines above them.
fn head(all: &[u8]) -> Result<(Head, Dialect, Columns, usize), MeshReadError> {
    let mut head = Head::default();
    let mut skipped = 0;
    // Depth cameras often have no measurement in the first rows.
    let (mut first_missing, mut missing) = (None, 0);
    for (line, text) in lines(all) {
        if let Some(dialect) = Dialect::of(text).filter(|_| !has_no_point(text)) {
            if dialect.separator == Some(b',') && has_decimal_commas(all, line) {
                return Err(MeshReadError::DecimalCommas { line });
            }
            let (columns, unit) = head.columns(dialect, text)?;
            head.unit = head.unit.or(unit);
            return Ok((head, dialect, columns, first_missing.unwrap_or(line) as usize - 1));
        }
        if text.is_empty() {
            continue;
        }
        let separators = [b';', b',', b'\t', b' '];
        if text.split(|byte| separators.contains(byte)).all(is_missing) {
            first_missing.get_or_insert(line);
            missing += 1;
            continue;
        }
        skipped += 1;
        if skipped > MAX_HEAD_LINES {
            break;
        }
        head.read(text, line)?;
    }
    if missing > 0 {
        return Err(MeshReadError::NoPoints { missing });
    }
    let few = lines(all).filter(|(_, text)| !has_no_point(text));
    if let Some((line, columns)) =
        few.map(|(line, text)| (line, numbers_in(text))).find(|(_, count)| *count > 0)
    {
        return Err(MeshReadError::TooFewColumns { line, columns });
    }
    if head.named.iter().any(|named| Header::all_of(&named.text, None).next().is_some()) {
        return Err(MeshReadError::NoRows { found: "a header" });
    }
    match lines(all).map(|(_, line)| line).find(|line| !has_no_point(line)) {
        Some(first) => Err(MeshReadError::NotThisFormat { format: FORMAT, found: first_bytes(first) }),
        None => Err(MeshReadError::NoRows { found: "comments" }),
    }
}

/// How many numbers a line without a point consists of; 0 if it contains anything else.
fn numbers_in(line: &[u8]) -> usize {
    let counts = Dialect::ALL.into_iter().map(|dialect| {
        let mut fields = Vec::new();
        dialect.split(line, &mut fields);
        let are_numbers = fields.iter().all(|field| dialect.value(field).is_some_and(f64::is_finite));
        if are_numbers { fields.len() } else { 0 }
    });
    counts.max().unwrap_or_default()
}

/// Whether the lines from this one on are numbers such as `0,5`, separated by blanks, with or without another comma, or by commas.
fn has_decimal_commas(text: &[u8], first: u64) -> bool {
    let is_decimal = |word: &[u8]| {
        let word = word.strip_suffix(b",").unwrap_or(word);
        let digits = word.strip_prefix(b"-").or(word.strip_prefix(b"+")).unwrap_or(word);
        let mut halves = digits.split(|byte| *byte == b',');
        halves.clone().count() == 2
            && halves.all(|half| !half.is_empty() && half.iter().all(u8::is_ascii_digit))
    };
    let rows = lines(text).skip_while(|(line, _)| *line < first).map(|(_, row)| row);
    let rows: Vec<&[u8]> = rows.filter(|row| !has_no_point(row)).take(DECIMAL_ROWS).collect();
    rows.iter().all(|row| words(row).count() >= 3 && words(row).all(is_decimal)) || are_halves(&rows)
}

/// Whether lines such as `0,5000,-1,0250,7,0000` are pairs of a whole number and its decimals. Then all have
/// equally many decimals, and some begin with zero, unlike whole numbers.
fn are_halves(rows: &[&[u8]]) -> bool {
    let (mut decimals, mut has_zeros) = (None, false);
    let mut is_pair = |whole: &[u8], part: &[u8]| {
        let digits = whole.strip_prefix(b"-").or(whole.strip_prefix(b"+")).unwrap_or(whole);
        has_zeros |= part.starts_with(b"0");
        let is_whole = !digits.is_empty() && digits.iter().chain(part).all(u8::is_ascii_digit);
        is_whole && part.len() > 1 && *decimals.get_or_insert(part.len()) == part.len()
    };
    let are_pairs = rows.iter().all(|row| {
        let fields: Vec<&[u8]> = row.split(|byte| *byte == b',').map(<[u8]>::trim_ascii).collect();
        fields.len() >= 6
            && fields.len().is_multiple_of(2)
            && fields.chunks(2).all(|pair| is_pair(pair[0], pair[1]))
    });
    are_pairs && has_zeros
}

impl Head {
    fn read(&mut self, text: &[u8], line: u64) -> Result<(), MeshReadError> {
        if text.to_ascii_lowercase().starts_with(b"ncols") {
            let problem = "it is a grid of heights (ncols, nrows), not a list of points".into();
            return Err(MeshReadError::BadHeader { format: FORMAT, line, problem });
        }
        let text_line = String::from_utf8_lossy(text);
        let words = text_line.trim_start_matches(['#', '/', '%', '!']).trim();
        self.unit = self.unit.or_else(|| stated_unit(words)).or_else(|| bracketed_unit(words));
        let lower = words.to_ascii_lowercase();
        if Header::all_of(&lower, None).next().is_none()
            && has_no_point(text)
            && self.producer.is_none()
            && !words.is_empty()
        {
            self.producer = Some(words.chars().take(120).collect());
        }
        if ['x', 'y', 'z'].iter().all(|&letter| lower.contains(letter)) {
            self.named.insert(0, NamedLine { line, is_comment: has_no_point(text), text: lower });
        }
        Ok(())
    }

    /// The columns that are read, from the names above them and the first line of numbers, and the unit in the names.
    fn columns(
        &self,
        dialect: Dialect,
        first: &[u8],
    ) -> Result<(Columns, Option<LengthUnit>), MeshReadError> {
        let mut fields = Vec::new();
        dialect.split(first, &mut fields);
        let most = fields.len();
        // Columns may be empty at the end, and so may the end of every line.
        let least = fields.iter().rposition(|field| !field.is_empty()).map_or(0, |last| last + 1);
        for NamedLine { line, is_comment, text } in &self.named {
            let headers = || Header::all_of(text, dialect.separator);
            if let Some(header) = headers().find(|header| (least..=most).contains(&header.names)) {
                return header.checked(*line);
            }
            // Further columns do not matter if the first ones are x, y and z. But if a line of names that is no comment lacks one, it
            // may be that of the first column, as in files of R.
            let are_first =
                |header: &Header| header.columns.point == [0, 1, 2] && (*is_comment || header.names > least);
            if let Some(header) = headers().find(are_first) {
                let columns = header.columns;
                let last = columns.normal.into_iter().flatten().max();
                let normal = columns.normal.filter(|_| last.is_some_and(|last| last < least));
                return Header { columns: Columns { normal, ..columns }, ..header }.checked(*line);
            }
            if let Some(header) = headers().next() {
                let problem = format!(
                    "it has {} column names, but the first line of points has {least} columns, so it is unclear which \
                     columns are x, y and z",
                    header.names
                );
                return Err(MeshReadError::BadHeader { format: FORMAT, line: *line, problem });
            }
        }
        let normal = (most >= 6).then_some([3, 4, 5]);
        Ok((Columns { point: [0, 1, 2], normal }, None))
    }
}

/// The unit in `x [mm]` or `X(m)`.
fn bracketed_unit(words: &str) -> Option<LengthUnit> {
    let inside = words.split(['[', '(']).skip(1).filter_map(|rest| rest.split([']', ')']).next());
    inside.map(|word| word.trim().to_ascii_lowercase()).find_map(|word| unit_word(&word))
}

/// A line of column names, split in one way.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Header {
    /// The number of names.
    names: usize,
    columns: Columns,
    /// The units in the names of x, y and z.
    units: [Option<LengthUnit>; 3],
}

impl Header {
    /// The ways to understand a line of column names, in lower case: split by this separator, then by the others.
    fn all_of(line: &str, separator: Option<u8>) -> impl Iterator<Item = Self> {
        let others = [Some(b';'), Some(b'\t'), Some(b','), None];
        let others = others.into_iter().filter(move |&other| other != separator);
        // What is before a colon is no name, as in `Columns: x y z`; nor is the keyword of a PCD file.
        let after_colon = line.rsplit_once(": ").map(|(_, names)| names);
        let after_keyword = LIST_WORDS.iter().find_map(|word| line.strip_prefix(word));
        let lists = [Some(line), after_colon, after_keyword.filter(|names| names.starts_with([' ', '\t']))];
        std::iter::once(separator).chain(others).flat_map(move |separator| {
            lists.into_iter().rev().flatten().filter_map(move |names| Self::of(names, separator))
        })
    }

    /// The names of a line that has x, y and z among them, unless it is a sentence.
    fn of(line: &str, separator: Option<u8>) -> Option<Self> {
        let mut names: Vec<String> = match separator {
            Some(separator) => line.split(char::from(separator)).map(plain_name).collect(),
            None => with_their_units(line.split_whitespace().map(plain_name)),
        };
        names.truncate(names.iter().rposition(|name| !name.is_empty()).map_or(0, |last| last + 1));
        if names.iter().any(|name| SENTENCE_WORDS.contains(&name.as_str())) {
            return None;
        }
        let plain: Vec<(&str, Option<LengthUnit>)> = names.iter().map(|name| without_unit(name)).collect();
        let find = |known: [&str; 5]| plain.iter().position(|(name, _)| known.contains(name));
        let all = |[x, y, z]: [Option<usize>; 3]| Some([x?, y?, z?]);
        let point = all([
            find(["x", "points:0", "x-coordinate", "x coordinate", "pos_x"]),
            find(["y", "points:1", "y-coordinate", "y coordinate", "pos_y"]),
            find(["z", "points:2", "z-coordinate", "z coordinate", "pos_z"]),
        ])?;
        let normal = all([
            find(["nx", "normals:0", "normal_x", "normalx", "normal x"]),
            find(["ny", "normals:1", "normal_y", "normaly", "normal y"]),
            find(["nz", "normals:2", "normal_z", "normalz", "normal z"]),
        ]);
        let units = point.map(|column| plain[column].1);
        Some(Self { names: names.len(), columns: Columns { point, normal }, units })
    }

    /// The columns and the unit in their names, which must be the same for all three.
    fn checked(self, line: u64) -> Result<(Columns, Option<LengthUnit>), MeshReadError> {
        if self.units.iter().any(|unit| *unit != self.units[0]) {
            let problem = "the columns x, y and z have different units".into();
            return Err(MeshReadError::BadHeader { format: FORMAT, line, problem });
        }
        Ok((self.columns, self.units[0]))
    }
}

/// A column's name without quotes and without the slash of `/x`.
fn plain_name(name: &str) -> String {
    name.trim_matches(['"', '\'', ' ', '\t', '/']).to_owned()
}

/// Names that were split at blanks, together with the units that follow them, as in `x (mm) y (mm)`.
fn with_their_units(words: impl Iterator<Item = String>) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for word in words {
        match names.last_mut() {
            Some(name) if word.starts_with(['[', '(']) || (unit_word(&word).is_some() && word.len() > 1) => {
                *name = format!("{name} {word}");
            }
            _ => names.push(word),
        }
    }
    names
}

/// A column's name and the unit in it, as in `x [mm]`, `x(in)`, `x mm` or `x_m`.
fn without_unit(name: &str) -> (&str, Option<LengthUnit>) {
    let (plain, word) = match name.split_once(['[', '(']) {
        Some((plain, rest)) => (plain, rest.split([']', ')']).next().unwrap_or_default()),
        None => match name.rsplit_once(['_', ' ']) {
            Some((plain, word)) if unit_word(word).is_some() || is_inch(word) => (plain, word),
            _ => return (name, None),
        },
    };
    let word = word.trim();
    (plain.trim_end(), unit_word(word).or_else(|| is_inch(word).then_some(LengthUnit::Inch)))
}

impl Dialect {
    const ALL: [Self; 5] = [
        Self { separator: Some(b';'), decimal_comma: true },
        Self { separator: Some(b'\t'), decimal_comma: true },
        Self { separator: Some(b','), decimal_comma: false },
        Self { separator: None, decimal_comma: false },
        Self { separator: None, decimal_comma: true },
    ];

    /// How the numbers of a line are written; `None` if it does not contain three numbers.
    fn of(line: &[u8]) -> Option<Self> {
        Self::ALL.into_iter().find(|dialect| {
            let mut fields = Vec::new();
            dialect.split(line, &mut fields);
            // An ambiguous comma separates columns only if there are numbers between the commas.
            let numbers =
                fields.iter().take(3).filter(|field| !is_missing(field) && dialect.value(field).is_some());
            numbers.count() == 3 || (fields.len() >= 3 && dialect.all_values(&fields))
        })
    }

    /// Whether the first three fields are values or marked as missing, and at least one is a number.
    fn all_values(self, fields: &[&[u8]]) -> bool {
        let values: Vec<Option<f64>> = fields.iter().take(3).map(|field| self.value(field)).collect();
        values.iter().all(Option::is_some) && values.iter().flatten().any(|value| value.is_finite())
    }

    fn split<'a>(self, line: &'a [u8], fields: &mut Vec<&'a [u8]>) {
        fields.clear();
        match self.separator {
            Some(separator) => fields.extend(line.split(|&byte| byte == separator).map(<[u8]>::trim_ascii)),
            None => fields.extend(words(line)),
        }
    }

    /// The value of a field; NaN if it is marked as missing, `None` if it cannot be read.
    fn value(self, field: &[u8]) -> Option<f64> {
        let field = field.strip_prefix(b"\"").and_then(|field| field.strip_suffix(b"\"")).unwrap_or(field);
        if let Some(value) = number(field) {
            return Some(value);
        }
        if is_missing(field) {
            return Some(f64::NAN);
        }
        let with_point =
            || field.iter().map(|byte| if *byte == b',' { b'.' } else { *byte }).collect::<Vec<u8>>();
        self.decimal_comma.then(with_point).and_then(|field| number(&field))
    }
}

fn is_missing(field: &[u8]) -> bool {
    MISSING.iter().any(|missing| field.eq_ignore_ascii_case(missing))
}

#[cfg(test)]
mod tests;
