//! The units and up axes of part files, and decisions with their reasons.

use std::fmt;
use std::str::FromStr;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// The unit of a part file's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub enum LengthUnit {
    /// 1 mm.
    #[serde(rename = "mm")]
    Millimetre,
    /// 10 mm.
    #[serde(rename = "cm")]
    Centimetre,
    /// 100 mm.
    #[serde(rename = "dm")]
    Decimetre,
    /// 1000 mm.
    #[serde(rename = "m")]
    Metre,
    /// 25.4 mm.
    #[serde(rename = "inch")]
    Inch,
}

/// The axis of a part file that points up in the designer's model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum UpAxis {
    /// +Y up, as glTF requires.
    Y,
    /// +Z up, as in CAD programs.
    Z,
}

/// A value that was decided, and why.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema), schemars(rename = "Decision_{T}"))]
pub struct Decision<T> {
    /// What was decided.
    pub value: T,
    /// Why, as a clause that can follow "because".
    pub why: String,
}

const SETTINGS: &str = "the settings say so";

/// A setting's value that is not a unit or an axis.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("\"{word}\" is not one of {expected}")]
#[non_exhaustive]
pub struct UnknownWord {
    /// The word as written.
    pub word: String,
    /// The allowed words.
    pub expected: &'static str,
}

impl LengthUnit {
    /// Length of the unit, mm.
    #[must_use]
    pub fn in_mm(self) -> f64 {
        match self {
            Self::Millimetre => 1.0,
            Self::Centimetre => 10.0,
            Self::Decimetre => 100.0,
            Self::Metre => 1000.0,
            Self::Inch => 25.4,
        }
    }
}

impl fmt::Display for LengthUnit {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Millimetre => "mm",
            Self::Centimetre => "cm",
            Self::Decimetre => "dm",
            Self::Metre => "m",
            Self::Inch => "inch",
        })
    }
}

impl FromStr for LengthUnit {
    type Err = UnknownWord;

    fn from_str(word: &str) -> Result<Self, UnknownWord> {
        match word.to_ascii_lowercase().as_str() {
            "mm" => Ok(Self::Millimetre),
            "cm" => Ok(Self::Centimetre),
            "dm" => Ok(Self::Decimetre),
            "m" => Ok(Self::Metre),
            "inch" => Ok(Self::Inch),
            _ => Err(UnknownWord { word: word.into(), expected: "mm, cm, dm, m, inch" }),
        }
    }
}

impl UpAxis {
    /// A vector of the file, rotated so that +Z is up.
    pub(super) fn to_z_up(self, vector: Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Y => Vector3::new(vector.x, -vector.z, vector.y),
            Self::Z => vector,
        }
    }
}

impl fmt::Display for UpAxis {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Y => "y",
            Self::Z => "z",
        })
    }
}

impl FromStr for UpAxis {
    type Err = UnknownWord;

    fn from_str(word: &str) -> Result<Self, UnknownWord> {
        match word.to_ascii_lowercase().as_str() {
            "y" => Ok(Self::Y),
            "z" => Ok(Self::Z),
            _ => Err(UnknownWord { word: word.into(), expected: "y, z" }),
        }
    }
}

impl<T> Decision<T> {
    /// The value and its reason.
    pub fn new(value: T, why: impl Into<String>) -> Self {
        Self { value, why: why.into() }
    }

    /// A value from the settings.
    pub(super) fn by_settings(value: T) -> Self {
        Self::new(value, SETTINGS)
    }

    /// Whether the value comes from the settings.
    pub fn is_by_settings(&self) -> bool {
        self.why == SETTINGS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_and_axes_are_parsed_and_printed_with_the_same_words() {
        for word in ["mm", "cm", "dm", "m", "inch"] {
            assert_eq!(word.parse::<LengthUnit>().unwrap().to_string(), word);
        }
        for word in ["y", "z"] {
            assert_eq!(word.parse::<UpAxis>().unwrap().to_string(), word);
        }
        assert_eq!("Z".parse(), Ok(UpAxis::Z));
        assert_eq!(
            "ell".parse::<LengthUnit>().unwrap_err().to_string(),
            "\"ell\" is not one of mm, cm, dm, m, inch"
        );
        assert!("x".parse::<UpAxis>().is_err());
    }

    #[test]
    fn y_up_is_rotated_not_mirrored() {
        let turn = |x, y, z| UpAxis::Y.to_z_up(Vector3::new(x, y, z));
        assert_eq!(turn(0.0, 1.0, 0.0), Vector3::z());
        assert_eq!(turn(1.0, 0.0, 0.0).cross(&turn(0.0, 1.0, 0.0)), turn(0.0, 0.0, 1.0));
    }
}
