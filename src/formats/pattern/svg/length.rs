//! Lengths (CSS Values and Units Level 4, chapters 5 and 6).

/// What lengths may refer to, in user units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    /// Size of the letters of the element.
    pub(super) font_size: f64,
    /// Size of the letters of the outermost element.
    pub(super) root_font_size: f64,
    /// What 100 % is.
    pub(super) whole: f64,
}

/// A number with a unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Length {
    pub(super) number: f64,
    pub(super) unit: Unit,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unit {
    None,
    Px,
    Em,
    Ex,
    Rem,
    In,
    Cm,
    Mm,
    Quarter,
    Pt,
    Pc,
    Percent,
}

impl Length {
    /// Reads a length; `None` if it is none, or not finite.
    pub(super) fn parsed(text: &str) -> Option<Self> {
        let text = text.trim();
        let unit = match text.find(|letter: char| letter == '%' || letter.is_alphabetic()) {
            Some(at) => text[unit_start(text, at)..].to_ascii_lowercase(),
            None => String::new(),
        };
        let number = &text[..text.len() - unit.len()];
        let unit = match unit.as_str() {
            "" => Unit::None,
            "px" => Unit::Px,
            "em" => Unit::Em,
            "ex" => Unit::Ex,
            "rem" => Unit::Rem,
            "in" => Unit::In,
            "cm" => Unit::Cm,
            "mm" => Unit::Mm,
            "q" => Unit::Quarter,
            "pt" => Unit::Pt,
            "pc" => Unit::Pc,
            "%" => Unit::Percent,
            _ => return None,
        };
        Some(Self { number: number_of(number)?, unit })
    }

    /// The length in user units.
    pub(super) fn user_units(self, scale: Scale) -> f64 {
        self.number
            * match self.unit {
                Unit::None | Unit::Px => 1.0,
                Unit::Em => scale.font_size,
                // What CSS assumes where the height of an x is not known.
                Unit::Ex => scale.font_size / 2.0,
                Unit::Rem => scale.root_font_size,
                Unit::In => 96.0,
                Unit::Cm => 96.0 / 2.54,
                Unit::Mm => 96.0 / 25.4,
                Unit::Quarter => 96.0 / 101.6,
                Unit::Pt => 96.0 / 72.0,
                Unit::Pc => 16.0,
                Unit::Percent => scale.whole / 100.0,
            }
    }
}

/// Where the unit begins if the first letter is at `at`: an exponent belongs to the number.
fn unit_start(text: &str, at: usize) -> usize {
    let after = &text[at..];
    let Some(exponent) = after.strip_prefix(['e', 'E']) else { return at };
    let digits = exponent.strip_prefix(['+', '-']).unwrap_or(exponent);
    let count = digits.find(|letter: char| !letter.is_ascii_digit()).unwrap_or(digits.len());
    if count == 0 { at } else { text.len() - digits.len() + count }
}

/// A finite number as CSS and SVG write it.
pub(super) fn number_of(text: &str) -> Option<f64> {
    let is_number = text.ends_with(|letter: char| letter.is_ascii_digit() || letter == '.')
        && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'+' | b'-' | b'.' | b'e' | b'E'));
    text.parse().ok().filter(|number: &f64| is_number && number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_the_units_of_css() {
        let scale = Scale { font_size: 10.0, root_font_size: 7.0, whole: 300.0 };
        for (text, expected) in [
            ("3", Some(3.0)),
            (" -1.5e1px ", Some(-15.0)),
            ("2E1MM", Some(20.0 * 96.0 / 25.4)),
            ("160Q", Some(40.0 * 96.0 / 25.4)),
            ("4q", Some(96.0 / 25.4)),
            ("2em", Some(20.0)),
            ("1.e1em", Some(100.0)),
            ("2ex", Some(10.0)),
            ("2rem", Some(14.0)),
            ("1in", Some(96.0)),
            ("2.54cm", Some(96.0)),
            ("72pt", Some(96.0)),
            ("6PC", Some(96.0)),
            ("50%", Some(150.0)),
            ("5furlong", None),
            ("3x", None),
            ("10,5", None),
            ("40 mm", None),
            ("1e400", None),
            ("inf", None),
            ("NaN", None),
            ("calc(1px + 2px)", None),
            ("1vw", None),
            ("px", None),
            ("", None),
        ] {
            let found = Length::parsed(text).map(|length| length.user_units(scale));
            match (found, expected) {
                (Some(found), Some(expected)) => assert!((found - expected).abs() < 1e-12, "{text}: {found}"),
                _ => assert_eq!(found, expected, "{text}"),
            }
        }
    }
}
