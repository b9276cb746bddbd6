//! Code pages: decoding of texts and names in drawings before R2007.

use std::borrow::Cow;

use encoding_rs::Encoding;
use oem_cp::code_table::DECODING_TABLE_CP_MAP;
use oem_cp::code_table_type::TableType;

/// A mapping from bytes to letters.
#[derive(Clone, Copy)]
pub(super) enum CodePage {
    /// UTF-8, and the pages of Windows and of East Asia.
    Standard(&'static Encoding),
    /// A page of DOS, as in drawings from AutoCAD for DOS.
    Dos(&'static TableType),
}

impl CodePage {
    pub(super) const UTF_8: Self = Self::Standard(encoding_rs::UTF_8);
    pub(super) const WINDOWS_1252: Self = Self::Standard(encoding_rs::WINDOWS_1252);

    /// The page that `$DWGCODEPAGE` names, such as `ANSI_1251` or `dos850`; `None` if it is unknown.
    pub(super) fn named(name: &str) -> Option<Self> {
        let name = name.to_ascii_lowercase();
        let number = name.trim_start_matches("ansi_").trim_start_matches("dos");
        let standard = match number {
            "932" => Some(encoding_rs::SHIFT_JIS),
            "936" | "gb2312" => Some(encoding_rs::GBK),
            "949" | "johab" => Some(encoding_rs::EUC_KR),
            "950" | "big5" => Some(encoding_rs::BIG5),
            number => Encoding::for_label(format!("windows-{number}").as_bytes()),
        };
        let dos = || DECODING_TABLE_CP_MAP.get(&number.parse().ok()?).map(Self::Dos);
        standard.map(Self::Standard).or_else(dos)
    }

    /// The page for the number `n` in `\M+nXXXX` (DXF Reference, "Multibyte characters").
    fn of_multibyte(number: u8) -> Option<Self> {
        let name = [None, Some("932"), Some("950"), Some("949"), None, Some("936")];
        name.get(usize::from(number)).copied().flatten().and_then(Self::named)
    }

    pub(super) fn decode<'b>(&self, bytes: &'b [u8]) -> Cow<'b, str> {
        match self {
            Self::Standard(encoding) => encoding.decode_without_bom_handling(bytes).0,
            Self::Dos(table) => table.decode_string_lossy(bytes).into(),
        }
    }

    /// The page for letters that are given by a single byte, which is never UTF-8.
    pub(super) fn of_single_bytes(self) -> Self {
        match self {
            Self::Standard(encoding) if encoding == encoding_rs::UTF_8 => Self::WINDOWS_1252,
            page => page,
        }
    }
}

/// Text with complete `\U+XXXX` and `\M+nXXXX` decoded.
pub(super) fn unescaped(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find('\\') {
        let (before, escape) = rest.split_at(at);
        out += before;
        match universal(escape).or_else(|| multibyte(escape)) {
            Some((letters, length)) => {
                out += &letters;
                rest = &escape[length..];
            }
            None => {
                out.push('\\');
                rest = &escape[1..];
            }
        }
    }
    out + rest
}

fn universal(escape: &str) -> Option<(String, usize)> {
    let number = escape.strip_prefix("\\U+")?.get(..4)?;
    let letter = u32::from_str_radix(number, 16).ok().and_then(char::from_u32)?;
    Some((letter.into(), 7))
}

fn multibyte(escape: &str) -> Option<(String, usize)> {
    let number = escape.strip_prefix("\\M+")?.get(..5)?;
    let page = number[..1].parse().ok().and_then(CodePage::of_multibyte)?;
    let bytes = u16::from_str_radix(&number[1..], 16).ok()?.to_be_bytes();
    let letters = page.decode(if bytes[0] == 0 { &bytes[1..] } else { &bytes });
    (!letters.contains(char::REPLACEMENT_CHARACTER)).then(|| (letters.into_owned(), 8))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_of_windows_and_dos_are_found_by_name() {
        let decoded =
            |page: &str, bytes: &[u8]| CodePage::named(page).map(|page| page.decode(bytes).into_owned());
        assert_eq!(decoded("ANSI_1252", b"Gr\xf6\xdfe").as_deref(), Some("Größe"));
        assert_eq!(decoded("dos850", b"Gr\x94\xe1e").as_deref(), Some("Größe"));
        assert_eq!(decoded("DOS437", b"\xe1").as_deref(), Some("ß"));
        assert_eq!(decoded("ansi_1251", b"\xc3\xee").as_deref(), Some("Го"));
        assert_eq!(decoded("ANSI_932", b"\x89\xef").as_deref(), Some("会"));
        assert_eq!(decoded("dos866", b"\x83\xae").as_deref(), Some("Го"));
        assert_eq!(decoded("mac-roman", b""), None);
    }

    #[test]
    fn complete_escapes_are_decoded() {
        assert_eq!(unescaped("a\\U+00F6b\\U+12"), "aöb\\U+12");
        assert_eq!(unescaped("\\M+189ef\\P\\M+9123\\M+4"), "会\\P\\M+9123\\M+4");
        assert_eq!(unescaped("\\M+1ö123"), "\\M+1ö123");
    }
}
