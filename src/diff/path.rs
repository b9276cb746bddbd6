//! The paths of a drawing, prepared for a comparison.

use serde::{Deserialize, Serialize};

/// One path of a drawing, with the properties that a comparison needs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DiffPath {
    /// The layer's name.
    pub layer: String,
    /// The visible colour: an index of the AutoCAD colour table such as `7`, or `#rrggbb`.
    pub color: String,
    /// Dot, open path or contour.
    pub kind: DiffKind,
    /// Its points, mm; a contour does not repeat the first.
    pub points: Vec<[f64; 2]>,
}

/// The kind of a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum DiffKind {
    /// A single spot.
    Dot,
    /// A curve with two ends.
    Open,
    /// A contour.
    Closed,
}

/// The properties that identify a path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct PathNote {
    /// The layer's name.
    pub layer: String,
    /// Dot, open path or contour.
    pub kind: DiffKind,
    /// Number of its points.
    pub vertices: usize,
    /// The centre of its extents, mm.
    pub center: [f64; 2],
    /// Its width and height, mm.
    pub size: [f64; 2],
}
