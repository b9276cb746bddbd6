//! Lines and numbers of text files that hold one entry in a line, and beginnings of files as people read them.

use crate::formats::mesh::MeshReadError;

/// The lines of a text with their numbers, from 1, trimmed; an older Mac's text has carriage returns alone.
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

/// A line that cannot be understood.
pub(super) fn bad_line(line: u64, text: &[u8], problem: &'static str) -> MeshReadError {
    MeshReadError::BadLine { line, text: beginning(text), problem }
}

/// The beginning of a line.
pub(super) fn beginning(text: &[u8]) -> String {
    String::from_utf8_lossy(&text[..text.len().min(60)]).into_owned()
}

/// The first bytes of a file as a person can read them.
pub(super) fn first_bytes(bytes: &[u8]) -> String {
    if bytes.is_empty() {
        return "nothing: it is empty".into();
    }
    format!("\"{}\"", bytes[..bytes.len().min(16)].escape_ascii())
}

/// The end of a text: number and content of its last line that is not empty, and whether a line break follows.
pub(super) fn last_line(text: &[u8]) -> (u64, &[u8], bool) {
    let (line, last) = lines(text).filter(|(_, line)| !line.is_empty()).last().unwrap_or((1, b""));
    (line, last, matches!(text.last(), Some(b'\n' | b'\r')))
}
