//! The file as group codes and values, text or binary, before interpretation.
//!
//! The scan copies nothing: a value is a range of the file's bytes and is parsed as text or number on demand.

use super::super::error::{EMPTY, PatternReadError, Spot};
use super::code_page::{CodePage, unescaped};

/// Largest size of a file, bytes.
pub(crate) const MAX_BYTES: usize = 200 << 20;
/// Largest number of group codes; a dense file of [`MAX_BYTES`] has about 20 million.
const MAX_PAIRS: usize = 24_000_000;

/// The group code that begins an embedded object, in which the codes have other meanings.
pub(super) const EMBEDDED: i32 = 101;

const BINARY_MARK: &[u8] = b"AutoCAD Binary DXF\r\n\x1a\0";

/// A group code and the position of its value.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    pub(super) code: i32,
    start: u32,
    end: u32,
    /// Line of the value, from 1, or offset of the group code in a binary file.
    spot: u32,
}

/// All group codes of a file up to its `EOF`, of its comments only those at the beginning.
pub(super) struct Scan<'a> {
    bytes: &'a [u8],
    binary: bool,
    pub(super) pairs: Vec<Pair>,
    /// Code page of texts and names; without one, valid UTF-8 is read as such, everything else as Windows-1252.
    pub(super) code_page: Option<CodePage>,
}

/// Whether the bytes begin as a DXF file does: with the mark of a binary file, or with the group code of a section or
/// comment.
pub(crate) fn begins_a_file(bytes: &[u8]) -> bool {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let first = text.split(|byte| matches!(byte, b'\n' | b'\r')).next().unwrap_or_default();
    bytes.starts_with(BINARY_MARK) || matches!(first.trim_ascii(), b"0" | b"999")
}

/// Whether the bytes end with an `EOF` mark, so that the file is fully written. Blanks, line breaks, NUL and Ctrl-Z may
/// follow it.
pub(crate) fn is_complete(bytes: &[u8]) -> bool {
    if let Some(body) = bytes.strip_prefix(BINARY_MARK) {
        return body.ends_with(b"\0EOF\0");
    }
    let tail = &bytes[bytes.len().saturating_sub(4096)..];
    let is_blank = |byte: &u8| byte.is_ascii_whitespace() || matches!(byte, 0 | 0x1a);
    let last = tail.iter().rposition(|byte| !is_blank(byte)).map_or(0, |last| last + 1);
    let Some(before) = tail[..last].strip_suffix(b"EOF") else { return false };
    let mut lines = before.rsplit(|byte| matches!(byte, b'\n' | b'\r')).map(<[u8]>::trim_ascii);
    // "EOF" is alone on its line, and the line before it is the group code 0.
    lines.next().is_some_and(<[u8]>::is_empty) && lines.find(|line| !line.is_empty()) == Some(b"0")
}

/// Reads all group codes.
///
/// # Errors
/// When the file is not DXF, too large or cut off, or when a group code cannot be read.
pub(super) fn scan(bytes: &[u8]) -> Result<Scan<'_>, PatternReadError> {
    if bytes.len() > MAX_BYTES {
        return Err(PatternReadError::FileTooLarge { bytes: bytes.len(), limit: MAX_BYTES });
    }
    let mut scan = Scan { bytes, binary: bytes.starts_with(BINARY_MARK), pairs: Vec::new(), code_page: None };
    if scan.binary {
        scan.read_binary()?;
    } else {
        scan.read_text()?;
    }
    if !scan.pairs.iter().any(|pair| scan.is(pair, 0, b"SECTION")) {
        return Err(PatternReadError::NotDxf { found: "it has no DXF section".into() });
    }
    Ok(scan)
}

impl Scan<'_> {
    /// The bytes of the value, trimmed in a text file.
    pub(super) fn raw(&self, pair: &Pair) -> &[u8] {
        let raw = &self.bytes[pair.start as usize..pair.end as usize];
        if self.binary { raw } else { raw.trim_ascii() }
    }

    /// Whether the pair has this group code and value.
    pub(super) fn is(&self, pair: &Pair, code: i32, value: &[u8]) -> bool {
        pair.code == code && self.raw(pair) == value
    }

    /// The position of the value in the file.
    pub(super) fn spot(&self, pair: &Pair) -> Spot {
        if self.binary { Spot::Byte(pair.spot.into()) } else { Spot::Line(pair.spot.into()) }
    }

    /// The value as text, with `\U+XXXX` and `\M+nXXXX` decoded.
    pub(super) fn text(&self, pair: &Pair) -> String {
        self.decoded(self.raw(pair))
    }

    /// The text of several values joined, not trimmed.
    pub(super) fn whole_text<'p>(&self, pairs: impl IntoIterator<Item = &'p Pair>) -> String {
        let mut raw = Vec::new();
        for pair in pairs {
            let value = &self.bytes[pair.start as usize..pair.end as usize];
            raw.extend_from_slice(value.strip_suffix(b"\r").filter(|_| !self.binary).unwrap_or(value));
        }
        self.decoded(&raw)
    }

    /// The code page of characters given by number.
    pub(super) fn page_of_letters(&self) -> CodePage {
        self.code_page.unwrap_or(CodePage::WINDOWS_1252).of_single_bytes()
    }

    /// Bytes as text, with `\U+XXXX` and `\M+nXXXX` decoded.
    pub(super) fn decoded(&self, raw: &[u8]) -> String {
        let decoded = match (self.code_page, std::str::from_utf8(raw)) {
            (Some(page), _) => page.decode(raw),
            (None, Ok(text)) => text.into(),
            (None, Err(_)) => CodePage::WINDOWS_1252.decode(raw),
        };
        unescaped(&decoded)
    }

    /// The value as a finite number.
    pub(super) fn number(&self, pair: &Pair) -> Option<f64> {
        let raw = self.raw(pair);
        if !self.binary {
            return std::str::from_utf8(raw).ok()?.parse().ok().filter(|number: &f64| number.is_finite());
        }
        match (kind_of(pair.code)?, raw) {
            (Kind::Double, raw) => Some(f64::from_le_bytes(raw.try_into().ok()?)).filter(|n| n.is_finite()),
            (Kind::Text | Kind::Chunk, _) => None,
            (_, [byte]) => Some(f64::from(*byte)),
            (_, [a, b]) => Some(f64::from(i16::from_le_bytes([*a, *b]))),
            (_, [a, b, c, d]) => Some(f64::from(i32::from_le_bytes([*a, *b, *c, *d]))),
            (_, raw) => Some(i64::from_le_bytes(raw.try_into().ok()?) as f64),
        }
    }

    /// The value for a message, cut to a short length.
    pub(super) fn shown(&self, pair: &Pair) -> String {
        if self.binary {
            return format!("{:02X?}", self.raw(pair));
        }
        String::from_utf8_lossy(self.raw(pair)).chars().take(40).collect()
    }

    /// Adds a pair, unless it is a comment (999) after the beginning: comments may separate any two pairs.
    fn push(&mut self, pair: Pair) -> Result<(), PatternReadError> {
        if pair.code == 999 && self.pairs.last().is_some_and(|last| last.code != 999) {
            return Ok(());
        }
        if self.pairs.len() == MAX_PAIRS {
            return Err(PatternReadError::TooMany { what: "group codes", limit: MAX_PAIRS, entity: None });
        }
        self.pairs.push(pair);
        Ok(())
    }

    fn read_text(&mut self) -> Result<(), PatternReadError> {
        let bytes = self.bytes;
        // Old Macintosh programs end lines with CR only.
        let line_end = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
        let mut at = if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        let mut line = 0;
        let next_line = |at: &mut usize| -> Option<(usize, usize)> {
            if *at >= bytes.len() {
                return None;
            }
            let start = *at;
            let length = bytes[start..].iter().position(|byte| *byte == line_end);
            let end = length.map_or(bytes.len(), |length| start + length);
            *at = end + 1;
            Some((start, end))
        };
        while let Some((start, end)) = next_line(&mut at) {
            line += 1;
            let text = bytes[start..end].trim_ascii();
            let code = std::str::from_utf8(text).ok().and_then(|text| text.parse::<i32>().ok());
            let Some(code) = code else {
                let is_last = at >= bytes.len() || bytes[at..].trim_ascii().is_empty();
                if self.pairs.is_empty() {
                    return Err(PatternReadError::NotDxf { found: appearance(bytes) });
                } else if is_last {
                    break;
                }
                let text = String::from_utf8_lossy(text).chars().take(40).collect();
                return Err(PatternReadError::UnreadableGroupCode { spot: Spot::Line(line), text });
            };
            line += 1;
            let Some((start, end)) = next_line(&mut at) else { break };
            let pair = Pair { code, start: start as u32, end: end as u32, spot: line as u32 };
            self.push(pair)?;
            if self.is(&pair, 0, b"EOF") {
                return Ok(());
            }
        }
        if self.pairs.is_empty() {
            return Err(PatternReadError::NotDxf { found: appearance(bytes) });
        }
        Err(PatternReadError::Truncated { spot: Spot::Line(line) })
    }

    fn read_binary(&mut self) -> Result<(), PatternReadError> {
        let bytes = self.bytes;
        let mut at = BINARY_MARK.len();
        // Group codes take one byte up to R12 and two bytes from R13 on; the first one is always 0, before SECTION.
        let two_bytes = bytes.get(at + 1) == Some(&0);
        let cut = PatternReadError::Truncated { spot: Spot::Byte(bytes.len() as u64) };
        loop {
            let spot = at;
            let byte = |at: usize| bytes.get(at).copied().map(i32::from).ok_or(cut.clone());
            let code = if two_bytes {
                at += 2;
                byte(at - 2)? | byte(at - 1)? << 8
            } else if byte(at)? == 255 {
                at += 3;
                byte(at - 2)? | byte(at - 1)? << 8
            } else {
                at += 1;
                byte(at - 1)?
            };
            let Some(kind) = kind_of(code) else {
                let spot = Spot::Byte(spot as u64);
                return Err(PatternReadError::UnreadableGroupCode { spot, text: code.to_string() });
            };
            let rest = bytes.get(at..).unwrap_or_default();
            let (length, skip) = match kind {
                Kind::Double | Kind::Long => (8, 0),
                Kind::Integer => (4, 0),
                Kind::Short => (2, 0),
                Kind::Flag => (if two_bytes { 1 } else { 2 }, 0),
                Kind::Text => (rest.iter().position(|byte| *byte == 0).ok_or(cut.clone())?, 1),
                Kind::Chunk => {
                    at += 1;
                    (rest.first().copied().ok_or(cut.clone())?.into(), 0)
                }
            };
            if at + length > bytes.len() {
                return Err(cut);
            }
            let pair = Pair { code, start: at as u32, end: (at + length) as u32, spot: spot as u32 };
            at += length + skip;
            self.push(pair)?;
            if self.is(&pair, 0, b"EOF") {
                return Ok(());
            }
        }
    }
}

/// The type of a group code's value (DXF Reference, "Group Code Value Types").
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Text,
    Double,
    Short,
    Integer,
    Long,
    Flag,
    Chunk,
}

/// The type of a group code's value; `None` if there is no such code.
pub(super) fn kind_of(code: i32) -> Option<Kind> {
    Some(match code {
        0..=9 | 100..=105 | 300..=309 | 320..=369 | 390..=399 | 410..=419 | 430..=439 | 470..=481 | 999 => {
            Kind::Text
        }
        10..=59 | 110..=149 | 210..=239 | 460..=469 | 1010..=1059 => Kind::Double,
        60..=79 | 170..=179 | 270..=289 | 370..=389 | 400..=409 | 1060..=1070 => Kind::Short,
        90..=99 | 420..=429 | 440..=459 | 1071 => Kind::Integer,
        160..=169 => Kind::Long,
        290..=299 => Kind::Flag,
        310..=319 | 1004 => Kind::Chunk,
        1000..=1009 => Kind::Text,
        _ => return None,
    })
}

/// What a file that is not DXF seems to be.
fn appearance(bytes: &[u8]) -> String {
    let text = bytes.trim_ascii_start();
    let seems = match bytes {
        _ if text.is_empty() => return EMPTY.into(),
        _ if bytes.starts_with(b"AC10") => {
            let version = String::from_utf8_lossy(&bytes[..6.min(bytes.len())]);
            return format!("it seems to be a DWG file ({version}); DXF is needed");
        }
        _ if bytes.starts_with(b"AutoCAD DXB") => "a DXB file",
        _ if text.starts_with(b"%PDF") => "a PDF file",
        _ if text.starts_with(b"%!PS") => "a PostScript file",
        _ if bytes.starts_with(b"\x1f\x8b") => "a compressed file, such as .svgz; save it as plain SVG",
        _ if bytes.starts_with(b"PK\x03\x04") => "a zip archive",
        // Files with the full PNG mark do not get here.
        _ if bytes.starts_with(b"\x89PNG") => "a PNG picture damaged by a transfer in text mode",
        _ if bytes.starts_with(b"\xff\xd8\xff") => "a JPEG picture",
        _ if bytes.starts_with(b"GIF8") => "a GIF picture",
        _ if bytes.starts_with(b"II*\0") || bytes.starts_with(b"MM\0*") => "a TIFF picture",
        _ if bytes.starts_with(b"RIFF") && contains(bytes, b"WEBP") => "a WebP picture",
        _ if bytes.starts_with(b"glTF") => "a GLB part",
        _ if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") => "UTF-16 text",
        _ if text.starts_with(b"<") => "an XML or HTML file",
        _ if text.starts_with(b"IN;") => "an HPGL plot file",
        _ if text.starts_with(b"ISO-10303-21") => "a STEP file",
        _ if bytes.contains(&0) => "another binary file",
        _ => "another text file",
    };
    format!("it seems to be {seems}")
}

fn contains(bytes: &[u8], needle: &[u8]) -> bool {
    bytes[..bytes.len().min(4096)].windows(needle.len()).any(|window| window == needle)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn completeness_is_decided_by_the_end_of_the_file() {
        for complete in [&b"0\nSECTION\n0\nEOF"[..], b"  0\r\nEOF\r\n", b"0\rEOF\r", b"0\nEOF\n\n\x1a\0"] {
            assert!(is_complete(complete), "{complete:?}");
        }
        for cut in [&b""[..], b"EOF", b"8\nEOF\n", b"0\nXEOF\n", b"0\nEO", b"0\nSECTION\n0\nENDSEC\n0\n"] {
            assert!(!is_complete(cut), "{cut:?}");
        }
        let binary = [BINARY_MARK, b"\0\0EOF\0"].concat();
        assert!(is_complete(&binary) && !is_complete(&binary[..binary.len() - 1]));
    }

    #[test]
    fn errors_name_the_format_of_other_files() {
        for (bytes, name) in [
            (&b"%PDF-1.7\n"[..], "PDF"),
            (b"AC1032\0\0", "DWG file (AC1032)"),
            (b"<?xml version=\"1.0\"?>\n<html>", "XML or HTML"),
            (b"PK\x03\x04abc", "zip"),
            (b"", "empty"),
            (b" \n\n", "empty"),
            (b"hello\nworld\n", "text"),
        ] {
            let Err(PatternReadError::NotDxf { found }) = scan(bytes) else { panic!("{name} was read") };
            assert!(found.contains(name), "{found}");
        }
    }

    #[test]
    fn line_ends_and_byte_order_marks_do_not_matter() {
        for end in ["\n", "\r\n", "\r"] {
            for mark in ["", "\u{feff}"] {
                let file =
                    format!("{mark}0\nSECTION\n 2 \n ENTITIES\n0\nENDSEC\n0\nEOF\n").replace('\n', end);
                let scan = scan(file.as_bytes()).unwrap();
                assert_eq!(scan.pairs.len(), 4);
                assert_eq!(scan.text(&scan.pairs[1]), "ENTITIES");
                assert_eq!(scan.spot(&scan.pairs[1]), Spot::Line(4));
            }
        }
    }

    #[test]
    fn comments_between_pairs_are_left_out() {
        let pairs = "0 SECTION 2 ENTITIES 0 ENDSEC 0 EOF".replace(' ', "\n");
        let file = pairs.replace("\n2\n", "\n999\nbetween\n999\n0\n2\n");
        let file = format!("999\nby a program\n999\nfor a test\n{file}\n");
        let scan = scan(file.as_bytes()).unwrap();
        let codes: Vec<i32> = scan.pairs.iter().map(|pair| pair.code).collect();
        assert_eq!(codes, [999, 999, 0, 2, 0, 0]);
        assert_eq!(scan.spot(&scan.pairs[3]), Spot::Line(12));
    }
}
