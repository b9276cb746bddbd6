//! Settings for reading a part file.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{LengthUnit, UnknownWord, UpAxis};
use crate::formats::Pace;

/// Settings for reading a part file; with `None` the reader decides from the file.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct MeshOptions {
    /// Unit of the file's numbers.
    pub unit: Option<LengthUnit>,
    /// Axis of the file that points up.
    pub up: Option<UpAxis>,
    /// What the surface between the vertices of a mesh follows.
    pub normals: NormalsChoice,
    /// The widest hole of a mesh that is bridged, mm; see [`bridged`](crate::geometry::holes::bridged).
    pub bridge: Option<f64>,
    /// The time limit for reading and fitting.
    pub pace: Pace,
}

impl MeshOptions {
    /// The same with this unit of the file's numbers.
    #[must_use]
    pub fn with_unit(self, unit: LengthUnit) -> Self {
        Self { unit: Some(unit), ..self }
    }

    /// The same with this axis of the file pointing up.
    #[must_use]
    pub fn with_up(self, up: UpAxis) -> Self {
        Self { up: Some(up), ..self }
    }

    /// The same with this choice of what the surface follows between the vertices.
    #[must_use]
    pub fn with_normals(self, normals: NormalsChoice) -> Self {
        Self { normals, ..self }
    }

    /// The same with holes bridged up to this width, mm; `None` for one or two missing triangles.
    #[must_use]
    pub fn with_bridge(self, bridge: Option<f64>) -> Self {
        Self { bridge, ..self }
    }
}

/// What the surface between the vertices of a mesh follows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum NormalsChoice {
    /// The file's normals where they are the surface's, else estimated ones; a noisy mesh is smoothed as a scan.
    #[default]
    Auto,
    /// The file's normals.
    File,
    /// The flat facets themselves.
    Facets,
    /// Normals that are estimated from the facets.
    Estimate,
}

impl fmt::Display for NormalsChoice {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Auto => "auto",
            Self::File => "file",
            Self::Facets => "facets",
            Self::Estimate => "estimate",
        })
    }
}

impl FromStr for NormalsChoice {
    type Err = UnknownWord;

    fn from_str(word: &str) -> Result<Self, UnknownWord> {
        match word.to_ascii_lowercase().as_str() {
            "auto" => Ok(Self::Auto),
            "file" => Ok(Self::File),
            "facets" => Ok(Self::Facets),
            "estimate" => Ok(Self::Estimate),
            _ => Err(UnknownWord { word: word.into(), expected: "auto, file, facets, estimate" }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_the_settings_are_read_and_written_alike() {
        for word in ["auto", "file", "facets", "estimate"] {
            assert_eq!(word.parse::<NormalsChoice>().unwrap().to_string(), word);
        }
        assert!("smooth".parse::<NormalsChoice>().is_err());
    }
}
