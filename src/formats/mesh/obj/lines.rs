//! Statements of an OBJ file: numbered lines, with continued lines joined.

use std::borrow::Cow;

/// Statements with the number of their first line; a backslash at the end of a line continues it on the next one.
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    line_break: u8,
    line: u64,
    ends_open: bool,
}

impl<'a> Lines<'a> {
    pub(super) fn of(bytes: &'a [u8]) -> Self {
        let line_break = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
        Self { rest: bytes, line_break, line: 0, ends_open: false }
    }

    /// Whether the last returned statement ended the file without a line break.
    pub(super) fn is_cut(&self) -> bool {
        self.ends_open
    }

    pub(super) fn next_statement(&mut self) -> Option<(u64, Cow<'a, [u8]>)> {
        let mut statement = Cow::Borrowed(self.next_line()?);
        let first_line = self.line;
        while let Some(shorter) = statement.strip_suffix(b"\\") {
            let mut joined = shorter.to_vec();
            joined.push(b' ');
            let next = self.next_line().unwrap_or_default();
            joined.extend_from_slice(next);
            statement = Cow::Owned(joined);
        }
        Some((first_line, statement))
    }

    fn next_line(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        self.line += 1;
        let end = self.rest.iter().position(|&byte| byte == self.line_break);
        let (line, rest) = match end {
            Some(end) => (&self.rest[..end], &self.rest[end + 1..]),
            None => (self.rest, &[][..]),
        };
        self.rest = rest;
        let text = line.trim_ascii();
        self.ends_open = end.is_none() && !text.is_empty();
        Some(text)
    }
}
