//! Lines and numbers of text files with one entry per line, and readable beginnings of files for messages.

use std::borrow::Cow;

use crate::formats::mesh::MeshReadError;

/// The trimmed lines of a text with their numbers, from 1; texts from old Macs have carriage returns only.
pub(super) fn lines(text: &[u8]) -> impl Iterator<Item = (u64, &[u8])> {
    let line_break = if text.contains(&b'\n') { b'\n' } else { b'\r' };
    text.split(move |&byte| byte == line_break).zip(1..).map(|(line, number)| (number, line.trim_ascii()))
}

/// The text without a byte order mark.
pub(super) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes)
}

/// Words between blanks.
pub(super) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// A number with a decimal point; NaN and infinities are numbers too.
pub(super) fn number(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// The error for a line that is not valid.
pub(super) fn bad_line(line: u64, text: &[u8], problem: impl Into<Cow<'static, str>>) -> MeshReadError {
    MeshReadError::BadLine { line, text: beginning(text), problem: problem.into() }
}

/// What is wrong with a line that has this word in place of a number.
pub(super) fn no_number(word: &[u8]) -> String {
    format!("`{}` is not a number", beginning(word))
}

/// The beginning of a line.
pub(super) fn beginning(text: &[u8]) -> String {
    String::from_utf8_lossy(&text[..text.len().min(60)]).into_owned()
}

/// The first bytes of a file in a readable form.
pub(super) fn first_bytes(bytes: &[u8]) -> String {
    format!("\"{}\"", bytes[..bytes.len().min(16)].escape_ascii())
}

/// The number and content of the last line that is not empty, and whether the text ends with a line break.
pub(super) fn last_line(text: &[u8]) -> (u64, &[u8], bool) {
    let (line, last) = lines(text).filter(|(_, line)| !line.is_empty()).last().unwrap_or((1, b""));
    (line, last, matches!(text.last(), Some(b'\n' | b'\r')))
}
