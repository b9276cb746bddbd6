//! The text of ISO 10303-21: records by number, read only when they are needed.

use super::error::{StepError, StepProblem};

/// Largest depth of lists in lists.
const MAX_DEPTH: usize = 32;
/// Largest number of records.
const MAX_RECORDS: usize = 20_000_000;

/// The beginning of every STEP file.
const MARK: &[u8] = b"ISO-10303-21";

/// Checks the beginning of a file that has no end; one that is too short to be recognised passes, and so do zeros, which some
/// programs write before the content.
///
/// # Errors
/// If it does not begin as STEP files do.
pub(super) fn check_beginning(bytes: &[u8]) -> Result<(), StepError> {
    let file = Exchange { bytes, index: Vec::new(), header: Vec::new() };
    let at = file.skip_blank(bytes.strip_prefix(b"\xEF\xBB\xBF").map_or(0, |_| 3))?;
    let found = &bytes[at..bytes.len().min(at + MARK.len())];
    let may_be_step = MARK.starts_with(found) || found.starts_with(&[0]);
    let problem = || StepProblem::NotStep { found: file.shown(at) };
    if may_be_step { Ok(()) } else { Err(file.error(at, None, problem())) }
}

/// A STEP file with an index of its records.
#[derive(Debug)]
pub(super) struct Exchange<'a> {
    bytes: &'a [u8],
    /// Number and place of each record, behind its `=`, in ascending order of the numbers.
    index: Vec<(u64, usize)>,
    /// The records of the header.
    header: Vec<Part<'a>>,
}

/// A kind of a record, in capitals, with its parameters.
type Part<'a> = (&'a str, Vec<Value<'a>>);

/// A parameter of a record.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value<'a> {
    /// `$`.
    Unset,
    /// `*`.
    Derived,
    /// A number with or without a decimal point.
    Number(f64),
    /// The bytes between quotes.
    Text(&'a [u8]),
    /// `.NAME.`, also `.T.` and `.F.`.
    Name(&'a str),
    /// `#number`.
    Reference(u64),
    /// `(…)`.
    List(Vec<Value<'a>>),
    /// `KIND(…)` within a record.
    Typed(&'a str, Vec<Value<'a>>),
}

/// A record: one kind with its parameters, or several.
#[derive(Debug, Clone)]
pub(super) struct Record<'a> {
    pub(super) id: u64,
    offset: usize,
    parts: Vec<Part<'a>>,
}

/// The parameters of one kind of a record.
#[derive(Debug, Clone, Copy)]
pub(super) struct Parameters<'r, 'a> {
    file: &'r Exchange<'a>,
    id: u64,
    offset: usize,
    values: &'r [Value<'a>],
}

impl<'a> Exchange<'a> {
    /// Finds the records of a file.
    pub(super) fn new(bytes: &'a [u8]) -> Result<Self, StepError> {
        let mut file = Self { bytes, index: Vec::new(), header: Vec::new() };
        let mut at = bytes.strip_prefix(b"\xEF\xBB\xBF").map_or(0, |_| 3);
        at = file.skip_blank(at)?;
        if !bytes[at..].starts_with(MARK) {
            return Err(file.error(at, None, StepProblem::NotStep { found: file.shown(at) }));
        }
        at = file.statement_end(at, None)? + 1;
        let mut in_data = false;
        loop {
            at = file.skip_blank(at)?;
            match bytes.get(at) {
                None => return Err(file.cut_off(at, None)),
                Some(b'#') if in_data => at = file.note_record(at)?,
                Some(byte) if byte.is_ascii_alphabetic() || *byte == b'!' => {
                    let word = file.word(at);
                    let end = file.statement_end(at, None)?;
                    match word {
                        "DATA" => in_data = true,
                        "ENDSEC" => in_data = false,
                        "HEADER" | "ANCHOR" | "REFERENCE" | "SIGNATURE" => {}
                        "END-ISO-10303-21" => break,
                        _ if !in_data => {
                            // A damaged header loses only the name of the producer.
                            if let Ok((_, parts)) = file.parts(at, 0) {
                                file.header.extend(parts);
                            }
                        }
                        _ => return Err(file.expected(at, None, "a record such as #1=…")),
                    }
                    at = end + 1;
                }
                // References and anchors of edition 3 start with `<` or `#`.
                Some(b'<' | b'#') if !in_data => at = file.statement_end(at, None)? + 1,
                Some(b'\x0c' | 0x0b) => at += 1,
                Some(_) => return Err(file.expected(at, None, "a record such as #1=…")),
            }
        }
        if !file.index.is_sorted_by_key(|(id, _)| *id) {
            file.index.sort_unstable();
        }
        if let Some(pair) = file.index.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            return Err(file.error(pair[1].1, Some(pair[1].0), StepProblem::Duplicate));
        }
        Ok(file)
    }

    /// Notes the record at `at` and returns the place behind it.
    fn note_record(&mut self, at: usize) -> Result<usize, StepError> {
        let (id, next) = self.number_of_record(at)?;
        let equals = self.skip_blank(next)?;
        match self.bytes.get(equals) {
            Some(b'=') => {}
            None => return Err(self.cut_off(equals, Some(id))),
            Some(_) => return Err(self.expected(equals, Some(id), "=")),
        }
        if self.index.len() >= MAX_RECORDS {
            let problem = StepProblem::TooLarge { what: "records", limit: MAX_RECORDS as u64 };
            return Err(self.error(at, Some(id), problem));
        }
        self.index.push((id, equals + 1));
        Ok(self.statement_end(equals + 1, Some(id))? + 1)
    }

    /// The `;` behind `at`, outside texts and comments.
    fn statement_end(&self, mut at: usize, id: Option<u64>) -> Result<usize, StepError> {
        while let Some(&byte) = self.bytes.get(at) {
            match byte {
                b';' => return Ok(at),
                b'\'' | b'"' => {
                    let length = self.bytes[at + 1..].iter().position(|other| *other == byte);
                    at += 2 + length.ok_or_else(|| self.cut_off(at, id))?;
                }
                b'/' if self.bytes.get(at + 1) == Some(&b'*') => at = self.comment_end(at)?,
                _ => at += 1,
            }
        }
        Err(self.cut_off(self.bytes.len(), id))
    }

    fn comment_end(&self, at: usize) -> Result<usize, StepError> {
        let inner = &self.bytes[at + 2..];
        let length = inner.windows(2).position(|pair| pair == b"*/");
        length.map(|length| at + length + 4).ok_or_else(|| self.cut_off(at, None))
    }

    fn skip_blank(&self, mut at: usize) -> Result<usize, StepError> {
        loop {
            match self.bytes.get(at) {
                Some(byte) if byte.is_ascii_whitespace() => at += 1,
                Some(b'/') if self.bytes.get(at + 1) == Some(&b'*') => at = self.comment_end(at)?,
                _ => return Ok(at),
            }
        }
    }

    fn number_of_record(&self, at: usize) -> Result<(u64, usize), StepError> {
        let digits = self.bytes[at + 1..].iter().take_while(|byte| byte.is_ascii_digit()).count();
        let text = &self.bytes[at + 1..at + 1 + digits];
        let number = text
            .iter()
            .try_fold(0u64, |number, digit| number.checked_mul(10)?.checked_add(u64::from(digit - b'0')));
        match number {
            Some(number) if digits > 0 => Ok((number, at + 1 + digits)),
            _ => Err(self.expected(at, None, "the number of a record")),
        }
    }

    /// The keyword at `at`.
    fn word(&self, at: usize) -> &'a str {
        let is_part = |byte: &&u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-' | b'!');
        let length = self.bytes[at..].iter().take_while(is_part).count();
        std::str::from_utf8(&self.bytes[at..at + length]).unwrap_or_default()
    }

    /// The kinds with their parameters at `at`, and the place behind them.
    fn parts(&self, at: usize, id: u64) -> Result<(usize, Vec<Part<'a>>), StepError> {
        let mut at = self.skip_blank(at)?;
        let mut parts = Vec::new();
        let is_complex = self.bytes.get(at) == Some(&b'(');
        if is_complex {
            at = self.skip_blank(at + 1)?;
        }
        loop {
            if is_complex && self.bytes.get(at) == Some(&b')') {
                return Ok((at + 1, parts));
            }
            let word = self.word(at);
            if word.is_empty() {
                return Err(self.expected(at, Some(id), "the kind of a record"));
            }
            at = self.skip_blank(at + word.len())?;
            if self.bytes.get(at) != Some(&b'(') {
                return Err(self.expected(at, Some(id), "("));
            }
            let (end, values) = self.list(at, id, 0)?;
            parts.push((word, values));
            at = self.skip_blank(end)?;
            if !is_complex {
                return Ok((at, parts));
            }
        }
    }

    /// The values between the parentheses at `at`, and the place behind them.
    fn list(&self, at: usize, id: u64, depth: usize) -> Result<(usize, Vec<Value<'a>>), StepError> {
        if depth > MAX_DEPTH {
            return Err(self.error(at, Some(id), StepProblem::Nested { limit: MAX_DEPTH }));
        }
        let mut at = self.skip_blank(at + 1)?;
        let mut values = Vec::new();
        if self.bytes.get(at) == Some(&b')') {
            return Ok((at + 1, values));
        }
        loop {
            let (end, value) = self.value(at, id, depth)?;
            values.push(value);
            at = self.skip_blank(end)?;
            match self.bytes.get(at) {
                Some(b',') => at = self.skip_blank(at + 1)?,
                Some(b')') => return Ok((at + 1, values)),
                _ => return Err(self.expected(at, Some(id), ", or )")),
            }
        }
    }

    fn value(&self, at: usize, id: u64, depth: usize) -> Result<(usize, Value<'a>), StepError> {
        let rest = &self.bytes[at..];
        match rest.first() {
            Some(b'$') => Ok((at + 1, Value::Unset)),
            Some(b'*') => Ok((at + 1, Value::Derived)),
            Some(b'#') => self.number_of_record(at).map(|(number, end)| (end, Value::Reference(number))),
            Some(b'(') => self.list(at, id, depth + 1).map(|(end, values)| (end, Value::List(values))),
            Some(b'\'') => {
                let mut end = 1;
                loop {
                    let length = rest[end..].iter().position(|byte| *byte == b'\'');
                    end += length.ok_or_else(|| self.cut_off(at, Some(id)))? + 1;
                    if rest.get(end) != Some(&b'\'') {
                        return Ok((at + end, Value::Text(&rest[1..end - 1])));
                    }
                    end += 1;
                }
            }
            Some(b'"') => {
                let length = rest[1..].iter().position(|byte| *byte == b'"');
                let length = length.ok_or_else(|| self.cut_off(at, Some(id)))?;
                Ok((at + length + 2, Value::Text(&rest[1..=length])))
            }
            Some(b'.') if rest.get(1).is_some_and(u8::is_ascii_alphabetic) => {
                let name = self.word(at + 1);
                match self.bytes.get(at + 1 + name.len()) {
                    Some(b'.') => Ok((at + name.len() + 2, Value::Name(name))),
                    _ => Err(self.expected(at, Some(id), "a name between points")),
                }
            }
            Some(byte) if byte.is_ascii_digit() || matches!(byte, b'+' | b'-' | b'.') => {
                let is_part =
                    |byte: &&u8| byte.is_ascii_digit() || matches!(byte, b'+' | b'-' | b'.' | b'E' | b'e');
                let length = rest.iter().take_while(is_part).count();
                let text = std::str::from_utf8(&rest[..length]).unwrap_or_default();
                let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
                number
                    .map(|number| (at + length, Value::Number(number)))
                    .ok_or_else(|| self.expected(at, Some(id), "a finite number"))
            }
            Some(byte) if byte.is_ascii_alphabetic() || *byte == b'!' => {
                let word = self.word(at);
                let open = self.skip_blank(at + word.len())?;
                if self.bytes.get(open) != Some(&b'(') {
                    return Err(self.expected(at, Some(id), "a value"));
                }
                self.list(open, id, depth + 1).map(|(end, values)| (end, Value::Typed(word, values)))
            }
            None => Err(self.cut_off(at, Some(id))),
            Some(_) => Err(self.expected(at, Some(id), "a value")),
        }
    }

    /// The number of every record with its kind, or with `(` for a record of several kinds.
    pub(super) fn kinds(&self) -> impl Iterator<Item = (u64, &'a str)> {
        self.index.iter().map(|&(id, at)| {
            let at = self.skip_blank(at).unwrap_or(at);
            let word = self.word(at);
            (id, if word.is_empty() { "(" } else { word })
        })
    }

    /// A record, for which `user` asks.
    pub(super) fn record(&self, id: u64, user: &Parameters<'_, 'a>) -> Result<Record<'a>, StepError> {
        match self.find(id)? {
            Some(record) => Ok(record),
            None => Err(self.error(user.offset, Some(user.id), StepProblem::Missing { target: id })),
        }
    }

    /// A record, if there is one.
    pub(super) fn find(&self, id: u64) -> Result<Option<Record<'a>>, StepError> {
        let Ok(place) = self.index.binary_search_by_key(&id, |(id, _)| *id) else { return Ok(None) };
        let offset = self.index[place].1;
        let (end, parts) = self.parts(offset, id)?;
        let end = self.skip_blank(end)?;
        if self.bytes.get(end) != Some(&b';') {
            return Err(self.expected(end, Some(id), ";"));
        }
        Ok(Some(Record { id, offset, parts }))
    }

    /// The parameters of a record of the header.
    pub(super) fn header(&self, kind: &str) -> Option<&[Value<'a>]> {
        self.header.iter().find(|(found, _)| *found == kind).map(|(_, values)| values.as_slice())
    }

    pub(super) fn error(&self, at: usize, record: Option<u64>, problem: StepProblem) -> StepError {
        let before = &self.bytes[..at.min(self.bytes.len())];
        let line = before.iter().filter(|byte| **byte == b'\n').count() as u64 + 1;
        StepError { line, record, problem }
    }

    fn cut_off(&self, at: usize, id: Option<u64>) -> StepError {
        self.error(at, id, StepProblem::CutOff)
    }

    fn expected(&self, at: usize, id: Option<u64>, expected: &'static str) -> StepError {
        if at >= self.bytes.len() {
            return self.cut_off(at, id);
        }
        self.error(at, id, StepProblem::Syntax { expected, found: self.shown(at) })
    }

    /// The beginning of what is at a place, for people.
    fn shown(&self, at: usize) -> String {
        let rest = &self.bytes[at.min(self.bytes.len())..];
        let text = String::from_utf8_lossy(&rest[..rest.len().min(24)]);
        text.chars()
            .take_while(|sign| *sign != '\n' && *sign != '\r')
            .collect::<String>()
            .escape_debug()
            .to_string()
    }
}

impl<'a> Record<'a> {
    /// The kind of the record; of several the last but the general ones, for messages.
    pub(super) fn kind(&self) -> &'a str {
        let general = [
            "BOUNDED_SURFACE",
            "BOUNDED_CURVE",
            "CURVE",
            "SURFACE",
            "GEOMETRIC_REPRESENTATION_ITEM",
            "REPRESENTATION_ITEM",
        ];
        let special = self.parts.iter().rev().find(|(kind, _)| !general.contains(kind));
        special.or(self.parts.last()).map_or("", |(kind, _)| kind)
    }

    /// Whether it is of this kind.
    pub(super) fn is(&self, kind: &str) -> bool {
        self.parts.iter().any(|(found, _)| *found == kind)
    }

    /// Whether it is of several kinds.
    pub(super) fn is_complex(&self) -> bool {
        self.parts.len() > 1
    }

    /// The parameters of the kind that it is of, if it is of one only, or of the given one.
    pub(super) fn of<'r>(&'r self, file: &'r Exchange<'a>, kind: &str) -> Option<Parameters<'r, 'a>> {
        let (_, values) = self.parts.iter().find(|(found, _)| *found == kind)?;
        Some(Parameters { file, id: self.id, offset: self.offset, values })
    }

    /// The parameters of its first kind.
    pub(super) fn first<'r>(&'r self, file: &'r Exchange<'a>) -> Parameters<'r, 'a> {
        let values = self.parts.first().map_or(&[][..], |(_, values)| values.as_slice());
        Parameters { file, id: self.id, offset: self.offset, values }
    }

    /// The parameters of its first kind, which must be one of these.
    pub(super) fn expect<'r>(
        &'r self,
        file: &'r Exchange<'a>,
        kinds: &[&'static str],
    ) -> Result<Parameters<'r, 'a>, StepError> {
        if let Some(found) = kinds.iter().find_map(|kind| self.of(file, kind)) {
            return Ok(found);
        }
        let problem = StepProblem::WrongKind {
            expected: kinds.first().copied().unwrap_or_default(),
            found: self.kind().to_owned(),
        };
        Err(file.error(self.offset, Some(self.id), problem))
    }
}

impl<'r, 'a> Parameters<'r, 'a> {
    /// An error in this record.
    pub(super) fn error(&self, problem: StepProblem) -> StepError {
        self.file.error(self.offset, Some(self.id), problem)
    }

    fn wrong(&self, index: usize, expected: &'static str) -> StepError {
        self.error(StepProblem::WrongValue { index: index + 1, expected })
    }

    /// A parameter.
    pub(super) fn value(&self, index: usize) -> Option<&'r Value<'a>> {
        self.values.get(index)
    }

    /// A parameter that is a number.
    pub(super) fn number(&self, index: usize) -> Result<f64, StepError> {
        number(self.value(index)).ok_or_else(|| self.wrong(index, "a number"))
    }

    /// A parameter that is a whole number from 0 to a thousand.
    pub(super) fn count(&self, index: usize) -> Result<usize, StepError> {
        let number = self.number(index)?;
        let is_count = number.fract() == 0.0 && (0.0..=1000.0).contains(&number);
        is_count.then_some(number as usize).ok_or_else(|| self.wrong(index, "a small whole number"))
    }

    /// A parameter that refers to a record.
    pub(super) fn reference(&self, index: usize) -> Result<u64, StepError> {
        self.optional(index)?.ok_or_else(|| self.wrong(index, "a reference"))
    }

    /// A parameter that may refer to a record.
    pub(super) fn optional(&self, index: usize) -> Result<Option<u64>, StepError> {
        match self.value(index) {
            Some(Value::Reference(id)) => Ok(Some(*id)),
            Some(Value::Unset | Value::Derived) => Ok(None),
            _ => Err(self.wrong(index, "a reference")),
        }
    }

    /// The record to which a parameter refers.
    pub(super) fn follow(&self, index: usize) -> Result<Record<'a>, StepError> {
        self.file.record(self.reference(index)?, self)
    }

    /// A parameter that is a list.
    pub(super) fn list(&self, index: usize) -> Result<&'r [Value<'a>], StepError> {
        match self.value(index) {
            Some(Value::List(values)) => Ok(values),
            // `KIND((…))` around a list of measures.
            Some(Value::Typed(_, values)) => match values.as_slice() {
                [Value::List(values)] => Ok(values),
                _ => Err(self.wrong(index, "a list")),
            },
            _ => Err(self.wrong(index, "a list")),
        }
    }

    /// A parameter that is a list of references.
    pub(super) fn references(&self, index: usize) -> Result<Vec<u64>, StepError> {
        let reference = |value: &Value<'a>| match value {
            Value::Reference(id) => Ok(*id),
            _ => Err(self.wrong(index, "a list of references")),
        };
        self.list(index)?.iter().map(reference).collect()
    }

    /// A parameter that is a list of numbers.
    pub(super) fn numbers(&self, index: usize) -> Result<Vec<f64>, StepError> {
        let wrong = || self.wrong(index, "a list of numbers");
        self.list(index)?.iter().map(|value| number(Some(value)).ok_or_else(wrong)).collect()
    }

    /// A parameter that is `.T.` or `.F.`.
    pub(super) fn flag(&self, index: usize) -> Result<bool, StepError> {
        match self.value(index) {
            Some(Value::Name("T" | "TRUE")) => Ok(true),
            Some(Value::Name("F" | "FALSE")) => Ok(false),
            _ => Err(self.wrong(index, ".T. or .F.")),
        }
    }

    /// A parameter that is a name between points.
    pub(super) fn name(&self, index: usize) -> Option<&'a str> {
        match self.value(index) {
            Some(Value::Name(name)) => Some(name),
            _ => None,
        }
    }

    /// A parameter that is text; empty if it is none.
    pub(super) fn text(&self, index: usize) -> String {
        text(self.value(index))
    }
}

fn number(value: Option<&Value<'_>>) -> Option<f64> {
    match value {
        Some(Value::Number(number)) => Some(*number),
        Some(Value::Typed(_, values)) => match values.as_slice() {
            [Value::Number(number)] => Some(*number),
            _ => None,
        },
        _ => None,
    }
}

/// The text of a value, with the escapes of ISO 10303-21 resolved; empty if it is none.
pub(super) fn text(value: Option<&Value<'_>>) -> String {
    let Some(Value::Text(bytes)) = value else { return String::new() };
    let raw = match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|byte| char::from(*byte)).collect(),
    };
    let raw = raw.replace("''", "'");
    let mut out = String::with_capacity(raw.len());
    let mut rest = raw.as_str();
    while let Some(place) = rest.find('\\') {
        out.push_str(&rest[..place]);
        rest = &rest[place..];
        let (taken, decoded) = escape(rest);
        out.push_str(&decoded);
        rest = &rest[taken..];
    }
    out.push_str(rest);
    out
}

/// The length of the escape at the beginning of a text, and what it means.
fn escape(text: &str) -> (usize, String) {
    for (start, width) in [("\\X2\\", 4), ("\\X4\\", 8)] {
        if let Some(inner) = text.strip_prefix(start)
            && let Some(end) = inner.find("\\X0\\")
        {
            let codes: Vec<u32> = inner.as_bytes()[..end]
                .chunks(width)
                .filter_map(|code| u32::from_str_radix(std::str::from_utf8(code).ok()?, 16).ok())
                .collect();
            let decoded = match width {
                4 => String::from_utf16_lossy(&codes.iter().map(|code| *code as u16).collect::<Vec<_>>()),
                _ => codes.into_iter().filter_map(char::from_u32).collect(),
            };
            return (start.len() + end + 4, decoded);
        }
    }
    if let Some(inner) = text.strip_prefix("\\X\\")
        && let Some(code) = inner.get(..2).and_then(|code| u8::from_str_radix(code, 16).ok())
    {
        return (5, char::from(code).to_string());
    }
    if let Some(inner) = text.strip_prefix("\\S\\")
        && let Some(sign) = inner.chars().next().filter(char::is_ascii)
    {
        return (4, char::from(sign as u8 | 0x80).to_string());
    }
    if text.starts_with("\\\\") {
        return (2, "\\".to_owned());
    }
    (1, "\\".to_owned())
}
