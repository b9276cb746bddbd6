//! Fields in texts, such as `{serial:06}`, and the values that replace them.
//!
//! Only known names in braces are fields: `{serial}`, `{date}`, `{shift}`, `{csv:COLUMN}` and `{sku}`. All other braces are
//! letters, or formats of an MTEXT, as in any drawing. Doubled braces round a field, `{{serial}}`, draw the field's own text.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::str::FromStr;

use chrono::format::{Item, Numeric, Pad, StrftimeItems};
use chrono::{Datelike as _, NaiveDate, NaiveDateTime, NaiveTime};
use serde::{Deserialize, Serialize};

use crate::reason::Notice;

/// Longest field, bytes.
const LONGEST: usize = 200;
/// Most notices about texts that are no fields.
const MOST_NOTICES: usize = 20;
/// Longest text in a message, letters.
const SHOWN: usize = 60;

/// Most columns of a list that a message names.
const MOST_COLUMNS: usize = 20;
/// Most digits of a serial number.
const MOST_DIGITS: usize = 20;
/// The names of fields.
const NAMES: [&str; 5] = ["serial", "date", "shift", "csv", "sku"];
/// The first year of a date: an earlier one was written with two digits.
const FIRST_YEAR: i32 = 1900;
/// The last year.
const LAST_YEAR: i32 = 9999;
/// How a date is written without a format.
const USUAL_DATE: &str = "%Y-%m-%d";
/// How the reason begins why a field has no value, if none is given.
const NOT_GIVEN: &str = "no ";

/// The values of the fields for one product. Clock and counter are inputs: equal values give equal drawings.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Content {
    /// The product's identity; an empty one is none, and no name of the job replaces it.
    pub sku: Option<String>,
    /// The serial number.
    pub serial: Option<u64>,
    /// Date and time of the mark.
    pub date: Option<Moment>,
    /// The name of the shift.
    pub shift: Option<String>,
    /// The row of a list: values by column.
    pub row: BTreeMap<String, String>,
    /// Only fields that are equally long on all products have a value, which is the same on all of them.
    pub(crate) is_typical: bool,
}

impl Content {
    /// The same for all products: zeros for the digits of padded serial numbers and of dates of one length, and the SKU. Other
    /// fields have no value.
    pub(crate) fn typical(&self) -> Self {
        Self { is_typical: true, ..self.clone() }
    }
}

/// A date with a time of day, as a clock in the workshop shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Moment(NaiveDateTime);

impl Moment {
    /// The moment that a calendar library gives.
    #[must_use]
    pub fn new(moment: NaiveDateTime) -> Self {
        Self(moment)
    }

    /// The minutes since midnight.
    #[must_use]
    pub fn minutes(self) -> u32 {
        use chrono::Timelike as _;
        self.0.hour() * 60 + self.0.minute()
    }
}

impl FromStr for Moment {
    type Err = ();

    /// `2026-11-23`, at midnight, or `2026-11-23T14:05`, with or without seconds; the year has four digits.
    fn from_str(text: &str) -> Result<Self, ()> {
        let (date, time) = text.trim().split_once(['T', ' ']).unwrap_or((text.trim(), "00:00"));
        let date = NaiveDate::parse_from_str(date, "%Y-%m-%d").map_err(drop)?;
        if !(FIRST_YEAR..=LAST_YEAR).contains(&date.year()) {
            return Err(());
        }
        let time = NaiveTime::parse_from_str(time, "%H:%M:%S")
            .or_else(|_| NaiveTime::parse_from_str(time, "%H:%M"))
            .map_err(drop)?;
        Ok(Self(date.and_time(time)))
    }
}

impl std::fmt::Display for Moment {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{}", self.0.format("%Y-%m-%dT%H:%M:%S"))
    }
}

/// A field of the drawing with its value.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct FieldUse {
    /// The field, such as `{serial:06}`.
    pub field: String,
    /// The text that is drawn in its place; absent if it has no value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<String>,
    /// Why it has no value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// Type of the entity that contains it, such as `TEXT`.
    pub entity: String,
    /// The entity's handle in hexadecimal, if the file has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub handle: Option<String>,
    /// The entity's layer.
    pub layer: String,
    #[serde(skip)]
    meant: Option<String>,
}

/// A field in a text, with its value or the reason why it has none.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundField {
    /// The field with its braces.
    pub field: String,
    /// The value, or why there is none.
    pub value: Result<String, String>,
    /// The field that is probably meant, if this is no field; it is drawn as it is written.
    pub meant: Option<String>,
}

impl FoundField {
    /// The same as a fact about an entity.
    pub(super) fn of(self, entity: &str, handle: Option<String>, layer: &str) -> FieldUse {
        let (value, why) = match self.value {
            Ok(value) => (Some(value), None),
            Err(why) => (None, Some(why)),
        };
        let (entity, layer) = (entity.into(), layer.into());
        FieldUse { field: self.field, value, why, entity, handle, layer, meant: self.meant }
    }
}

/// How a text is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Syntax {
    /// Every letter is itself.
    Plain,
    /// A TEXT of a DXF, with `%%` and `^` codes.
    Line,
    /// An MTEXT, in which braces may be written as `\{`.
    Paragraph,
}

/// The text with its fields replaced by their values. Without `content`, the text is unchanged and the fields are only found.
pub(super) fn expand(text: &str, syntax: Syntax, content: Option<&Content>) -> (String, Vec<FoundField>) {
    let forms: &[(&str, &str)] = match syntax {
        Syntax::Plain | Syntax::Line => &[("{", "}")],
        Syntax::Paragraph => &[("\\{", "\\}"), ("{", "}")],
    };
    let mut out = String::with_capacity(text.len());
    let mut found = Vec::new();
    let mut rest = text;
    'text: while let Some(first) = rest.chars().next() {
        for (open, close) in forms {
            let Some(inner) = rest.strip_prefix(open) else { continue };
            let doubled = inner.strip_prefix(open).and_then(|inner| field(inner, close));
            if let Some((name, after)) = doubled
                && let Some(after) = after.strip_prefix(close)
            {
                if content.is_some() {
                    let [open, close] = if syntax == Syntax::Paragraph { ["\\{", "\\}"] } else { ["{", "}"] };
                    out += &format!("{open}{name}{close}");
                } else {
                    out += &rest[..rest.len() - after.len()];
                }
                rest = after;
                continue 'text;
            }
            if let Some((name, after)) = field(inner, close) {
                let value = value(name, content.unwrap_or(&Content::default()));
                match (&value, content) {
                    (Ok(value), Some(_)) => out += &escaped(value, syntax),
                    _ => out += &rest[..rest.len() - after.len()],
                }
                found.push(FoundField { field: format!("{{{name}}}"), value, meant: None });
                rest = after;
                continue 'text;
            }
            if let Some(meant) = misspelt(inner, close) {
                let written = inner.split(close).next().unwrap_or_default();
                let field = format!("{{{written}}}");
                found.push(FoundField { value: Ok(field.clone()), field, meant: Some(meant) });
            }
        }
        // The letter behind a backslash belongs to it.
        let mut length = first.len_utf8();
        if first == '\\' && syntax == Syntax::Paragraph {
            length += rest[1..].chars().next().map_or(0, char::len_utf8);
        }
        out += &rest[..length];
        rest = &rest[length..];
    }
    (out, found)
}

/// The content of a code with its fields replaced by their values.
///
/// # Errors
/// The first field without a value.
pub fn filled(text: &str, content: &Content) -> Result<String, FoundField> {
    let (text, found) = expand(text, Syntax::Plain, Some(content));
    match found.into_iter().find(|field| field.value.is_err()) {
        Some(field) => Err(field),
        None => Ok(text),
    }
}

/// The name of a field at the beginning of `text`, behind its opening brace, and the text behind its closing brace.
fn field<'t>(text: &'t str, close: &str) -> Option<(&'t str, &'t str)> {
    let end = text.bytes().take(LONGEST).position(|byte| byte == b'}')?;
    let inner = text.get(..=end)?.strip_suffix(close)?;
    let (name, argument) = inner.split_once(':').map_or((inner, None), |(name, rest)| (name, Some(rest)));
    let is_field = NAMES.contains(&name) && !inner.contains(['{', '\\', '\n']) && argument != Some("");
    is_field.then(|| (inner, &text[end + 1..]))
}

/// The field that a text in braces, behind its opening brace, is probably meant to be, if it is none.
fn misspelt(text: &str, close: &str) -> Option<String> {
    let end = text.bytes().take(LONGEST).position(|byte| byte == b'}')?;
    let inner = text.get(..=end)?.strip_suffix(close)?;
    if inner.contains(['{', '\\', '\n']) {
        return None;
    }
    let (name, argument) = inner.split_once(':').map_or((inner, None), |(name, rest)| (name, Some(rest)));
    let given = name.trim().to_lowercase();
    // Of three letters, another one makes another word.
    let is_near = |known: &&&str| given == **known || known.len() > 3 && differs_once(&given, known);
    let known = *NAMES.iter().find(is_near)?;
    let is_known = |argument: &&str| match known {
        "serial" => serial(0, Some(argument)).is_ok(),
        "date" => date(Moment(NaiveDateTime::default()), argument).is_ok(),
        "csv" => true,
        _ => false,
    };
    let argument = argument.filter(|argument| !argument.is_empty()).filter(is_known);
    let argument = argument.or_else(|| (known == "csv").then_some("COLUMN"));
    Some(argument.map_or_else(|| format!("{{{known}}}"), |argument| format!("{{{known}:{argument}}}")))
}

/// Whether two words differ by one letter that is missing, added, changed or exchanged with the next one.
fn differs_once(one: &str, other: &str) -> bool {
    let (one, other): (Vec<char>, Vec<char>) = (one.chars().collect(), other.chars().collect());
    let same = one.iter().zip(&other).take_while(|(one, other)| one == other).count();
    let (one, other) = (&one[same..], &other[same..]);
    let same = one.iter().rev().zip(other.iter().rev()).take_while(|(one, other)| one == other).count();
    match (&one[..one.len() - same], &other[..other.len() - same]) {
        ([a, b], [c, d]) => a == d && b == c,
        (one, other) => one.len() < 2 && other.len() < 2,
    }
}

/// What is no field although it is written like one, apart from the fields.
pub(super) fn without_misspelt(found: Vec<FieldUse>) -> (Vec<FieldUse>, Vec<Notice>) {
    let (odd, fields): (Vec<_>, Vec<_>) = found.into_iter().partition(|field| field.meant.is_some());
    let notice = |field: FieldUse| {
        let item = field.handle.as_ref().map_or_else(String::new, |handle| format!(" {handle}"));
        let place = format!("{}{item} on layer {}", field.entity, field.layer);
        Some(misspelt_field(&field.field, &field.meant?, &place))
    };
    (fields, odd.into_iter().take(MOST_NOTICES).filter_map(notice).collect())
}

/// Warns of the texts in the content of a code that are written like fields and are none.
pub(crate) fn misspelt_in(content: &str, place: &str) -> Vec<Notice> {
    let (_, found) = expand(content, Syntax::Plain, None);
    let odd = found.iter().filter_map(|field| Some((&field.field, field.meant.as_ref()?)));
    odd.map(|(field, meant)| misspelt_field(field, meant, place)).collect()
}

fn misspelt_field(field: &str, meant: &str, place: &str) -> Notice {
    let message = format!(
        "{place} contains `{field}`, which is no field and is marked as it is; if a value is meant, write `{meant}`"
    );
    Notice::warning("field-misspelt", message)
}

fn escaped(value: &str, syntax: Syntax) -> String {
    let mut out = String::with_capacity(value.len());
    for letter in value.chars() {
        match (syntax, letter) {
            (Syntax::Line | Syntax::Paragraph, '^') => out.push_str("^ "),
            (Syntax::Line | Syntax::Paragraph, '%') => out.push_str("%%%"),
            (Syntax::Paragraph, '\\' | '{' | '}') => out.extend(['\\', letter]),
            _ => out.push(letter),
        }
    }
    out
}

/// Whether a field has no value because none is given. Otherwise a value is given that the field cannot show.
pub(crate) fn is_not_given(why: &str) -> bool {
    why.starts_with(NOT_GIVEN)
}

/// The value of a field, or why it has none: the reason begins with [`NOT_GIVEN`] exactly if no value is given.
fn value(field: &str, content: &Content) -> Result<String, String> {
    let (name, argument) = field.split_once(':').map_or((field, None), |(name, rest)| (name, Some(rest)));
    let value = match (name, argument) {
        ("serial" | "date", format) if content.is_typical => {
            typical(name, format).ok_or("it is not equally long on all products")?
        }
        ("shift" | "csv", _) if content.is_typical => Err("it is not equally long on all products")?,
        ("serial", format) => serial(content.serial.ok_or("no serial number is given")?, format)?,
        ("date", format) => date(content.date.ok_or("no date is given")?, format.unwrap_or(USUAL_DATE))?,
        ("shift", None) => content.shift.clone().ok_or("no shift is given")?,
        ("sku", None) => content.sku.clone().filter(|sku| !sku.is_empty()).ok_or("no SKU is given")?,
        ("csv", Some(column)) => match content.row.get(column) {
            Some(value) if value.trim().is_empty() => Err(format!("the column `{column}` is empty"))?,
            Some(value) => value.clone(),
            None => Err(match content.row.is_empty() {
                true => format!("no value of the column `{column}` is given"),
                false => {
                    let columns: Vec<String> =
                        content.row.keys().take(MOST_COLUMNS).map(|name| short(name)).collect();
                    let more = match content.row.len() - columns.len() {
                        0 => String::new(),
                        more => format!(" and {more} more"),
                    };
                    let column = short(column);
                    format!("there is no column `{column}`; the columns are {}{more}", columns.join(", "))
                }
            })?,
        },
        ("csv", None) => Err("it names no column; write {csv:COLUMN}")?,
        _ => Err(format!("`{name}` has no format"))?,
    };
    match value.chars().find(|letter| letter.is_control()) {
        Some(letter) => Err(format!("its value contains the control character U+{:04X}", u32::from(letter))),
        None => Ok(value),
    }
}

/// Zeros for the digits of a serial number or a date that has the same number of them on all products.
fn typical(name: &str, format: Option<&str>) -> Option<String> {
    if name == "serial" {
        return serial(0, Some(format.filter(|format| format.starts_with('0'))?)).ok();
    }
    let format = format.unwrap_or(USUAL_DATE);
    let is_fixed = |item| match item {
        Item::Numeric(Numeric::NumDaysFromSun | Numeric::WeekdayFromMon, _) => true,
        Item::Numeric(_, pad) => pad == Pad::Zero,
        Item::Literal(_) | Item::Space(_) => true,
        _ => false,
    };
    if !StrftimeItems::new(format).all(is_fixed) {
        return None;
    }
    let text = date("2000-01-01".parse().ok()?, format).ok()?;
    Some(text.chars().map(|letter| if letter.is_ascii_digit() { '0' } else { letter }).collect())
}

/// A serial number: `06` for six digits with zeros in front, `x` or `X` behind it for hexadecimal digits.
fn serial(serial: u64, format: Option<&str>) -> Result<String, String> {
    let format = format.unwrap_or_default();
    let unknown = || {
        format!(
            "the format `{format}` is not known; write 06 for six digits, 06x or 06X for hexadecimal ones"
        )
    };
    let (width, digits) = match format.chars().last() {
        Some('x') => (&format[..format.len() - 1], format!("{serial:x}")),
        Some('X') => (&format[..format.len() - 1], format!("{serial:X}")),
        _ => (format, serial.to_string()),
    };
    let width = match width.strip_prefix('0') {
        Some(number) if number.bytes().all(|byte| byte.is_ascii_digit()) => number
            .parse::<usize>()
            .ok()
            .filter(|width| (1..=MOST_DIGITS).contains(width))
            .ok_or_else(unknown)?,
        None if width.is_empty() => 0,
        _ => return Err(unknown()),
    };
    if width > 0 && digits.len() > width {
        return Err(format!("the serial number {digits} has more than {width} digits"));
    }
    Ok(format!("{digits:0>width$}"))
}

/// A text for a message, which names very long ones by their beginning.
pub(crate) fn short(text: &str) -> String {
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}

fn date(moment: Moment, format: &str) -> Result<String, String> {
    let unknown =
        || format!("the format `{format}` is not known; write %Y, %m, %d, %H, %M, %S, %j, %V or %y");
    let items: Vec<Item<'_>> = StrftimeItems::new(format).collect();
    let is_part = |item: &Item<'_>| matches!(item, Item::Numeric(..) | Item::Fixed(_));
    // Letters of other programs, such as `dd.MM.yyyy`, would be marked as they are.
    let is_year =
        |item: &Item<'_>| matches!(item, Item::Literal(text) if text.to_lowercase().contains("yyyy"));
    if items.contains(&Item::Error) || items.iter().any(is_year) || !items.iter().any(is_part) {
        return Err(unknown());
    }
    let mut text = String::new();
    write!(text, "{}", moment.0.format_with_items(items.into_iter())).map_err(|_| unknown())?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn content() -> Content {
        Content {
            sku: Some("can".into()),
            serial: Some(417),
            date: Some("2026-11-23T14:05".parse().unwrap()),
            shift: Some("late".into()),
            row: [("LOT".to_owned(), "A7".to_owned()), ("100%".to_owned(), "a^b%%c{\\".to_owned())].into(),
            is_typical: false,
        }
    }

    fn of(text: &str, syntax: Syntax) -> String {
        expand(text, syntax, Some(&content())).0
    }

    #[test]
    fn typical_values_are_those_that_are_equally_long_on_all_products() {
        for (text, expected) in [
            ("{serial:06} {serial:04X}", "000000 0000"),
            ("{date} {date:%d.%m.%y %H:%M}", "0000-00-00 00.00.00 00:00"),
            ("{sku} {{sku}}", "can {sku}"),
            ("{serial}{serial:x}{csv:LOT}{shift}", "{serial}{serial:x}{csv:LOT}{shift}"),
            ("{date:%-d.%m.} {date:%B} {date:%e}", "{date:%-d.%m.} {date:%B} {date:%e}"),
        ] {
            assert_eq!(expand(text, Syntax::Plain, Some(&content().typical())).0, expected);
        }
    }

    #[test]
    fn known_names_are_replaced_and_all_other_braces_stay() {
        for (text, expected) in [
            ("No {serial:06}", "No 000417"),
            ("{serial}{serial:04x}{serial:X}", "41701a11A1"),
            ("{date} {date:%d.%m.%y} {date:%H:%M} {date:%j}", "2026-11-23 23.11.26 14:05 327"),
            ("{shift}/{sku}/{csv:LOT}", "late/can/A7"),
            ("{lot} {} {Serial} {serial {serial:} }{", "{lot} {} {Serial} {serial {serial:} }{"),
            ("{serail} { serial } {CSV:LOT}", "{serail} { serial } {CSV:LOT}"),
            ("{{serial}} {{date:%Y}}", "{serial} {date:%Y}"),
            ("{{lot}}", "{{lot}}"),
            ("ä{serial}ß", "ä417ß"),
        ] {
            assert_eq!(of(text, Syntax::Plain), expected, "{text}");
            assert_eq!(of(text, Syntax::Line), expected, "{text}");
            // Without values a text is as it was.
            assert_eq!(expand(text, Syntax::Plain, None).0, text);
            assert_eq!(expand(text, Syntax::Paragraph, None).0, text);
        }
    }

    #[test]
    fn braces_of_formats_are_no_fields() {
        for (text, expected) in [
            (r"{\fArial|b1;No} \{serial:06\}", r"{\fArial|b1;No} 000417"),
            (r"{\C1;\{serial\}}\P{serial:04}", r"{\C1;417}\P0417"),
            (r"\\{serial}", r"\\417"),
            (r"\{\{serial\}\}", r"\{serial\}"),
            (r"{\H2x;serial}", r"{\H2x;serial}"),
            ("{serial\\}", "{serial\\}"),
        ] {
            assert_eq!(of(text, Syntax::Paragraph), expected, "{text}");
        }
        // A value is drawn letter by letter, whatever it contains.
        assert_eq!(of("{csv:100%}", Syntax::Plain), "a^b%%c{\\");
        assert_eq!(of("{csv:100%}", Syntax::Line), "a^ b%%%%%%c{\\");
        assert_eq!(of("{csv:100%}", Syntax::Paragraph), "a^ b%%%%%%c\\{\\\\");
    }

    #[test]
    fn what_is_written_almost_like_a_field_is_named() {
        for (text, meant) in [
            ("No {serail}", Some("{serial}")),
            ("{Serial:06}", Some("{serial:06}")),
            ("{ serial }", Some("{serial}")),
            ("{serial:}", Some("{serial}")),
            ("{seria}{datum}", Some("{serial}")),
            ("{CSV:LOT}", Some("{csv:LOT}")),
            // What is proposed is a field.
            ("{csv:}", Some("{csv:COLUMN}")),
            ("{CSV}", Some("{csv:COLUMN}")),
            ("{Serial:6}", Some("{serial}")),
            ("{Date:dd.MM.yyyy}", Some("{date}")),
            ("{Date:%d.%m.%Y}", Some("{date:%d.%m.%Y}")),
            ("{Shift:early}", Some("{shift}")),
            ("{dates}", Some("{date}")),
            ("{lot} {} {serie} {sky} {cst:LOT} {{serial}} {serial}", None),
        ] {
            let (_, found) = expand(text, Syntax::Plain, Some(&content()));
            let odd: Vec<_> = found.into_iter().filter_map(|field| field.meant).collect();
            assert_eq!(odd.first().map(String::as_str), meant, "{text}");
            assert!(odd.len() < 2, "{text}");
        }
        assert_eq!(filled("{serail}{serial}", &content()).unwrap(), "{serail}417");
    }

    #[test]
    fn a_field_without_a_value_states_why() {
        let why = |text: &str, content: &Content| filled(text, content).unwrap_err().value.unwrap_err();
        let nothing = Content::default();
        for (text, words) in [
            ("{serial}", "no serial number"),
            ("{date}", "no date"),
            ("{shift}", "no shift"),
            ("{sku}", "no SKU"),
            ("{csv:LOT}", "no value of the column `LOT`"),
        ] {
            assert!(why(text, &nothing).contains(words), "{text}");
        }
        let mut content = content();
        content.row.insert("bad".into(), "a\u{7}".into());
        content.row.insert("none".into(), "  ".into());
        for (text, words) in [
            ("{serial:02}", "more than 2 digits"),
            ("{serial:6}", "the format `6` is not known"),
            ("{serial:0}", "the format `0` is not known"),
            ("{serial:021}", "is not known"),
            ("{serial:ä}", "is not known"),
            ("{date:%Q}", "the format `%Q` is not known"),
            ("{date:%z}", "is not known"),
            ("{date:dd.MM.yyyy}", "the format `dd.MM.yyyy` is not known; write %Y"),
            ("{date: }", "is not known"),
            ("{date:%%Y}", "is not known"),
            ("{date:%d.%m.YYYY}", "is not known"),
            ("{date:%n}", "is not known"),
            ("{date:%Y%n}", "control character U+000A"),
            ("{shift:x}", "has no format"),
            ("{csv}", "names no column"),
            ("{csv:lot}", "no column `lot`; the columns are 100%, LOT"),
            ("{csv:none}", "is empty"),
            ("{csv:bad}", "control character U+0007"),
        ] {
            assert!(why(text, &content).contains(words), "{text}: {}", why(text, &content));
        }
        for wrong in
            ["2026-02-30", "today", "26-11-23", "-5-11-23", "0026-11-23", "20226-11-23", "+2026-11-23T1"]
        {
            assert!(wrong.parse::<Moment>().is_err(), "{wrong}");
        }
        assert_eq!("2026-11-23".parse::<Moment>().unwrap().to_string(), "2026-11-23T00:00:00");
    }
}
