//! Codes for machines: Data Matrix (ECC 200), QR and Code 128 as modules, and the outlines of their inked cells.

mod code128;
mod error;
mod gs1;
mod outline;

use datamatrix::{DataMatrix, DataMatrixBuilder, SymbolList};
use qrcode::bits::Bits;
use qrcode::types::QrError;
use qrcode::{Color, EcLevel, QrCode, Version};
use serde::{Deserialize, Serialize};

pub use error::CodeError;
pub use outline::outlines;

/// Longest content, bytes; no code holds more.
const LONGEST: usize = 4000;
/// Error correction of QR codes.
const QR_CORRECTION: EcLevel = EcLevel::M;
/// The ECI designator of UTF-8 (AIM ECI, part 3).
const UTF_8: u32 = 26;

/// A kind of code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Kind {
    /// Data Matrix, ECC 200 (ISO/IEC 16022).
    DataMatrix,
    /// Data Matrix with GS1 elements.
    Gs1DataMatrix,
    /// QR code, error correction M (ISO/IEC 18004).
    Qr,
    /// Code 128 (ISO/IEC 15417).
    #[serde(rename = "code-128")]
    Code128,
    /// Code 128 with GS1 elements.
    #[serde(rename = "gs1-128")]
    Gs1Code128,
}

impl Kind {
    /// Its name in settings and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::DataMatrix => "data-matrix",
            Self::Gs1DataMatrix => "gs1-data-matrix",
            Self::Qr => "qr",
            Self::Code128 => "code-128",
            Self::Gs1Code128 => "gs1-128",
        }
    }

    /// Whether the code is bars, whose height is free.
    #[must_use]
    pub fn is_linear(self) -> bool {
        matches!(self, Self::Code128 | Self::Gs1Code128)
    }

    /// Width of the quiet zone that its standard asks for, modules.
    #[must_use]
    pub fn quiet_zone(self) -> usize {
        match self {
            Self::DataMatrix | Self::Gs1DataMatrix => 1,
            Self::Qr => 4,
            Self::Code128 | Self::Gs1Code128 => 10,
        }
    }
}

impl std::fmt::Display for Kind {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(self.name())
    }
}

/// Dark and light modules in rows from the bottom, without a quiet zone. Bars have one row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Modules {
    columns: usize,
    rows: usize,
    dark: Vec<bool>,
}

impl Modules {
    /// Modules in rows from the bottom; a last row that is not complete is left out.
    #[must_use]
    pub fn new(columns: usize, mut dark: Vec<bool>) -> Self {
        let rows = dark.len().checked_div(columns).unwrap_or(0);
        dark.truncate(rows * columns);
        Self { columns, rows, dark }
    }

    /// The number of columns and rows.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.columns, self.rows]
    }

    /// Whether the module is dark; outside all are light.
    #[must_use]
    pub fn is_dark(&self, column: usize, row: usize) -> bool {
        column < self.columns && row < self.rows && self.dark.get(row * self.columns + column) == Some(&true)
    }

    /// The same with a margin of light modules at the sides, and below and above.
    #[must_use]
    pub fn with_margin(&self, [beside, above]: [usize; 2]) -> Self {
        let [columns, rows] = [self.columns + 2 * beside, self.rows + 2 * above];
        let inside = |column: usize, row: usize| {
            let (column, row) = (column.checked_sub(beside), row.checked_sub(above));
            column.zip(row).is_some_and(|(column, row)| self.is_dark(column, row))
        };
        let dark = (0..rows).flat_map(|row| (0..columns).map(move |column| inside(column, row))).collect();
        Self { columns, rows, dark }
    }

    /// Dark modules light and light ones dark.
    #[must_use]
    pub fn inverted(mut self) -> Self {
        self.dark.iter_mut().for_each(|dark| *dark = !*dark);
        self
    }
}

/// The modules of a code with this content. A Data Matrix is square, unless `rectangular` is set.
///
/// # Errors
/// When the content is empty or too long, has a character that the code lacks, or is not valid for GS1.
pub fn encode(kind: Kind, content: &str, rectangular: bool) -> Result<Modules, CodeError> {
    let too_long = || CodeError::TooLong { bytes: content.len(), kind: kind.name() };
    if content.is_empty() {
        return Err(CodeError::Empty);
    }
    if content.len() > LONGEST {
        return Err(too_long());
    }
    match kind {
        Kind::DataMatrix | Kind::Gs1DataMatrix => {
            let sizes = match rectangular {
                true => SymbolList::default().enforce_rectangular(),
                false => SymbolList::default().enforce_square(),
            };
            let elements = match kind {
                Kind::Gs1DataMatrix => Some(gs1::elements(content)?),
                _ => None,
            };
            let code = data_matrix(content, elements.as_deref(), &sizes).ok_or_else(too_long)?;
            let bitmap = code.bitmap();
            let (columns, rows) = (bitmap.width(), bitmap.height());
            let mut dark = vec![false; columns * rows];
            for (column, row) in bitmap.pixels() {
                if let Some(module) =
                    (rows - 1).checked_sub(row).and_then(|row| dark.get_mut(row * columns + column))
                {
                    *module = true;
                }
            }
            Ok(Modules::new(columns, dark))
        }
        Kind::Qr => {
            let code = qr(content).map_err(|_| too_long())?;
            let (columns, colors) = (code.width(), code.to_colors());
            let rows: Vec<&[Color]> = colors.chunks(columns.max(1)).collect();
            let dark = rows.into_iter().rev().flatten().map(|color| *color == Color::Dark).collect();
            Ok(Modules::new(columns, dark))
        }
        Kind::Code128 | Kind::Gs1Code128 => {
            let modules = match kind {
                Kind::Gs1Code128 => code128::modules(&gs1::elements(content)?, true),
                _ => code128::modules(content.as_bytes(), false),
            };
            let dark = modules.map_err(|byte| CodeError::Character {
                character: content
                    .chars()
                    .find(|c| !c.is_ascii() || c.is_ascii_control())
                    .unwrap_or(char::from(byte)),
                kind: kind.name(),
            })?;
            if dark.len() > code128::LONGEST {
                return Err(too_long());
            }
            Ok(Modules::new(dark.len(), dark))
        }
    }
}

/// The smallest Data Matrix with this content, or with these GS1 elements.
fn data_matrix(content: &str, elements: Option<&[u8]>, sizes: &SymbolList) -> Option<DataMatrix> {
    let encoded = |sizes: SymbolList| {
        let builder = DataMatrixBuilder::new().with_symbol_list(sizes).with_fnc1_start(elements.is_some());
        match elements {
            Some(elements) => builder.encode(elements),
            None => builder.encode_str(content),
        }
    };
    // Of several sizes, the crate takes none for a content that is longer than the bytes which the largest one holds, although
    // digits and capitals are packed.
    let one = |size| encoded(SymbolList::from(size)).ok();
    encoded(sizes.clone()).ok().or_else(|| sizes.clone().into_iter().find_map(one))
}

/// The smallest QR code with this content.
fn qr(content: &str) -> Result<QrCode, QrError> {
    if content.is_ascii() {
        return QrCode::with_error_correction_level(content, QR_CORRECTION);
    }
    // The crate packs pairs of bytes that could be Shift-JIS as Kanji, and readers decode them as such: UTF-8 must be bytes.
    for version in (1..=40).map(Version::Normal) {
        let mut bits = Bits::new(version);
        bits.push_eci_designator(UTF_8)?;
        let filled =
            bits.push_byte_data(content.as_bytes()).and_then(|()| bits.push_terminator(QR_CORRECTION));
        match filled {
            Err(QrError::DataTooLong) => {}
            Err(error) => return Err(error),
            Ok(()) => return QrCode::with_bits(bits, QR_CORRECTION),
        }
    }
    Err(QrError::DataTooLong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_square_and_have_their_borders() {
        let code = encode(Kind::DataMatrix, "SN000017", false).unwrap();
        let [columns, rows] = code.size();
        assert_eq!(columns, rows);
        // The finder of ECC 200: the left column and the bottom row are dark, the others alternate.
        for index in 0..columns {
            assert!(code.is_dark(0, index) && code.is_dark(index, 0));
            assert_eq!(code.is_dark(index, rows - 1), index % 2 == 0);
            assert_eq!(code.is_dark(columns - 1, index), index % 2 == 0);
        }
        let [columns, rows] = encode(Kind::DataMatrix, "SN000017", true).unwrap().size();
        assert!(columns > rows);
        // Three finder patterns of a QR code, none at the lower right.
        let code = encode(Kind::Qr, "https://example.com/17", false).unwrap();
        let last = code.size()[0] - 1;
        assert!(code.is_dark(0, 0) && code.is_dark(0, last) && code.is_dark(last, last));
        assert!((0..7).all(|index| code.is_dark(index, last)) && !code.is_dark(7, last));
    }

    #[test]
    fn a_data_matrix_holds_as_many_digits_as_its_standard_states() {
        // ISO/IEC 16022, table 7: 144 x 144 modules hold 3116 digits, 132 x 132 hold 2608.
        for (digits, side) in [(1800, 120), (2608, 132), (2609, 144), (3116, 144)] {
            let code = encode(Kind::DataMatrix, &"1".repeat(digits), false).unwrap();
            assert_eq!(code.size(), [side; 2], "{digits} digits");
        }
        // 2335 capitals, by the same table.
        assert_eq!(encode(Kind::DataMatrix, &"A".repeat(2335), false).unwrap().size(), [144; 2]);
        let error = encode(Kind::DataMatrix, &"1".repeat(3117), false).unwrap_err();
        assert!(matches!(error, CodeError::TooLong { .. }));
    }

    #[test]
    fn contents_that_cannot_be_encoded_are_refused() {
        for kind in [Kind::DataMatrix, Kind::Qr, Kind::Code128, Kind::Gs1DataMatrix, Kind::Gs1Code128] {
            assert_eq!(encode(kind, "", false), Err(CodeError::Empty));
            for length in [3000, 100_000] {
                let error = encode(kind, &"z".repeat(length), false).err().unwrap();
                assert!(matches!(error, CodeError::TooLong { .. } | CodeError::Gs1(_)), "{kind} {error}");
            }
        }
        let error = encode(Kind::Code128, "Größe", false).unwrap_err();
        assert_eq!(error.to_string(), "a code-128 code has no character 'ö'");
        assert!(encode(Kind::Code128, "a\tb", false).is_err());
    }

    #[test]
    fn a_margin_is_light_and_inverted_dark() {
        let code = encode(Kind::Code128, "17", false).unwrap().with_margin([10, 0]);
        let [columns, rows] = code.size();
        // Start, one symbol for two digits, check symbol, stop.
        assert_eq!((columns, rows), (11 * 3 + 13 + 20, 1));
        assert!(!code.is_dark(9, 0) && code.is_dark(10, 0) && !code.is_dark(columns - 10, 0));
        let inverted = code.inverted();
        assert!(inverted.is_dark(9, 0) && !inverted.is_dark(10, 0));
    }
}
