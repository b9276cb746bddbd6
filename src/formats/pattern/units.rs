//! Units of drawings: from `$INSUNITS`, else from the settings, else from `$MEASUREMENT`, else mm.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::reason::Notice;

/// The length of one unit of a drawing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(try_from = "String", into = "&'static str")]
pub enum DrawingUnit {
    /// 1e-6 mm.
    Nanometre,
    /// 0.001 mm.
    Micrometre,
    /// 1 mm.
    Millimetre,
    /// 10 mm.
    Centimetre,
    /// 100 mm.
    Decimetre,
    /// 1000 mm.
    Metre,
    /// 1e6 mm.
    Kilometre,
    /// 25.4e-6 mm.
    Microinch,
    /// A thousandth of an inch, 0.0254 mm.
    Mil,
    /// 25.4 mm.
    Inch,
    /// 304.8 mm.
    Foot,
    /// 914.4 mm.
    Yard,
    /// 1 609 344 mm.
    Mile,
    /// A pixel of Inkscape and browsers, 1/96 inch: 25.4/96 mm.
    Pixel96,
    /// A typographic point, 1/72 inch: 25.4/72 mm.
    Point72,
}

/// A word that is not a unit.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not a unit of length; use nm, um, mm, cm, dm, m, km, uin, mil, in, ft, yd, mi, px or pt")]
pub struct UnknownUnit(String);

const ALL: [(DrawingUnit, &str, f64); 15] = [
    (DrawingUnit::Nanometre, "nm", 1e-6),
    (DrawingUnit::Micrometre, "um", 1e-3),
    (DrawingUnit::Millimetre, "mm", 1.0),
    (DrawingUnit::Centimetre, "cm", 10.0),
    (DrawingUnit::Decimetre, "dm", 100.0),
    (DrawingUnit::Metre, "m", 1e3),
    (DrawingUnit::Kilometre, "km", 1e6),
    (DrawingUnit::Microinch, "uin", 25.4e-6),
    (DrawingUnit::Mil, "mil", 25.4e-3),
    (DrawingUnit::Inch, "in", 25.4),
    (DrawingUnit::Foot, "ft", 304.8),
    (DrawingUnit::Yard, "yd", 914.4),
    (DrawingUnit::Mile, "mi", 1_609_344.0),
    (DrawingUnit::Pixel96, "px", 25.4 / 96.0),
    (DrawingUnit::Point72, "pt", 25.4 / 72.0),
];

impl DrawingUnit {
    /// The length of one unit, mm.
    #[must_use]
    pub fn in_mm(self) -> f64 {
        ALL[self as usize].2
    }

    /// The sign, such as `mm` or `in`.
    #[must_use]
    pub fn sign(self) -> &'static str {
        ALL[self as usize].1
    }

    /// The unit for a code of `$INSUNITS` (DXF Reference, HEADER); `None` for 0 and for units too large for products.
    #[must_use]
    pub fn from_insunits(code: i64) -> Option<Self> {
        Some(match code {
            // 21, 22, 23 and 24 are the US survey units, 2e-6 longer than the others.
            1 | 22 => Self::Inch,
            2 | 21 => Self::Foot,
            3 | 24 => Self::Mile,
            4 => Self::Millimetre,
            5 => Self::Centimetre,
            6 => Self::Metre,
            7 => Self::Kilometre,
            8 => Self::Microinch,
            9 => Self::Mil,
            10 | 23 => Self::Yard,
            12 => Self::Nanometre,
            13 => Self::Micrometre,
            14 => Self::Decimetre,
            _ => return None,
        })
    }
}

impl fmt::Display for DrawingUnit {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(self.sign())
    }
}

impl From<DrawingUnit> for &'static str {
    fn from(unit: DrawingUnit) -> Self {
        unit.sign()
    }
}

impl TryFrom<String> for DrawingUnit {
    type Error = UnknownUnit;

    fn try_from(word: String) -> Result<Self, UnknownUnit> {
        word.parse()
    }
}

impl FromStr for DrawingUnit {
    type Err = UnknownUnit;

    /// Reads a sign (`mm`, `in`, `px`, …), its usual variants (`"`, `µm`, `inch`) or the full word.
    fn from_str(word: &str) -> Result<Self, UnknownUnit> {
        let sign = match word.trim().to_lowercase().as_str() {
            "nanometre" | "nanometer" => "nm",
            "µm" | "μm" | "micron" | "micrometre" | "micrometer" => "um",
            "millimetre" | "millimeter" => "mm",
            "centimetre" | "centimeter" => "cm",
            "decimetre" | "decimeter" => "dm",
            "metre" | "meter" => "m",
            "kilometre" | "kilometer" => "km",
            "microinch" => "uin",
            "thou" => "mil",
            "inch" | "\"" => "in",
            "foot" | "feet" | "'" => "ft",
            "yard" => "yd",
            "mile" => "mi",
            "pixel" | "px96" => "px",
            "point" => "pt",
            sign => {
                let known = ALL.iter().find(|(_, known, _)| *known == sign);
                return known.map(|(unit, ..)| *unit).ok_or_else(|| UnknownUnit(word.to_owned()));
            }
        };
        sign.parse()
    }
}

/// What the header states about the unit.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct UnitHints {
    /// `$INSUNITS`.
    pub(super) code: Option<i64>,
    /// `$MEASUREMENT`: 0 is imperial, 1 metric.
    pub(super) measurement: Option<i64>,
}

/// The unit of a drawing, the reason for it, and a notice if needed.
///
/// A setting for drawings without a unit takes precedence over `$MEASUREMENT`, which programs write by default.
pub(super) fn decide(
    hints: UnitHints,
    forced: Option<DrawingUnit>,
    if_unitless: Option<DrawingUnit>,
) -> (DrawingUnit, String, Option<Notice>) {
    if let Some(unit) = forced {
        return (unit, "the settings give the unit for all drawings".into(), None);
    }
    let code = hints.code.unwrap_or(0);
    if let Some(unit) = DrawingUnit::from_insunits(code) {
        let unused = if_unitless.filter(|asked| *asked != unit).map(|asked| {
            let message = format!(
                "the unit of the file is {unit}, so the setting `{asked}` for drawings without a unit is not used"
            );
            Notice::note("unit-setting-unused", message)
        });
        return (unit, format!("$INSUNITS {code}"), unused);
    }
    let lack = match hints.code {
        None => "the file has no $INSUNITS".to_owned(),
        Some(0) => "$INSUNITS 0 (no unit)".to_owned(),
        Some(code) => format!("$INSUNITS {code} is not usable"),
    };
    if let Some(unit) = if_unitless {
        return (unit, format!("{lack}; the settings give {unit}"), None);
    }
    if hints.measurement == Some(0) {
        let why = format!("{lack}; $MEASUREMENT 0 (imperial)");
        let message =
            format!("inches assumed: {why}; if this is wrong, set the unit for drawings without a unit");
        return (DrawingUnit::Inch, why, Some(Notice::warning("unit-assumed", message)));
    }
    let why = match hints.measurement {
        Some(1) => format!("{lack}; $MEASUREMENT 1 (metric), so mm"),
        _ => format!("{lack}; mm by default"),
    };
    let message = format!("millimetres assumed: {why}");
    // If the file states a unit that cannot be used, mm is more likely to be wrong.
    let notice = if code == 0 { Notice::note } else { Notice::warning };
    (DrawingUnit::Millimetre, why, Some(notice("unit-assumed", message)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_by_their_sign_and_listed_in_enum_order() {
        for (index, (unit, sign, _)) in ALL.into_iter().enumerate() {
            assert_eq!((unit as usize, sign.parse()), (index, Ok(unit)));
        }
        assert_eq!("Inch".parse(), Ok(DrawingUnit::Inch));
        assert!("furlong".parse::<DrawingUnit>().unwrap_err().to_string().contains("furlong"));
    }

    #[test]
    fn the_file_overrides_the_setting_and_the_setting_overrides_the_hint() {
        let hints = |code, measurement| UnitHints { code, measurement };
        let pixel = Some(DrawingUnit::Pixel96);
        assert_eq!(decide(hints(Some(1), None), None, pixel).0, DrawingUnit::Inch);
        assert_eq!(decide(hints(Some(0), Some(1)), None, pixel).0, DrawingUnit::Pixel96);
        assert_eq!(decide(hints(None, Some(0)), None, None).0, DrawingUnit::Inch);
        assert_eq!(decide(hints(None, None), None, None).0, DrawingUnit::Millimetre);
        assert_eq!(decide(hints(Some(4), None), Some(DrawingUnit::Metre), None).0, DrawingUnit::Metre);
    }
}
