//! What a map keeps first.

use super::strain::Weights;

/// The largest angle error of a drawing as it is, round the top of a sphere, as a multiple of the one with equal weights.
const UNCORRECTED_ANGLES: f64 = 2.0;

/// A figure by which a map is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Figure {
    /// The lengths of lines.
    Lengths,
    /// The sizes of inked areas.
    Areas,
    /// The angles of the ink.
    Angles,
}

/// What a map keeps first. The weights of the strains multiply mean squares, so only their ratios matter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IsometricOptions {
    /// The figure that comes first, in which the map must not be worse than the drawing as it is; `None` for all together.
    pub first: Option<Figure>,
    /// Weight of the strain along the drawing's own lines.
    pub line_weight: f64,
    /// Weight of the strain of the inked area.
    pub area_weight: f64,
    /// Weight of the largest angle error at the ink.
    pub angle_weight: f64,
    /// Largest accepted angle error at the ink, as a multiple of the one with equal weights over the box.
    pub angle_limit: f64,
    /// Weight of the strain in all directions equally over the whole box, inked or not. With a small weight, the
    /// parts of the drawing move relative to each other.
    pub box_weight: f64,
    /// Whether outlines that nothing fills, and the cells that lines enclose, are areas too, whose sizes and shapes the map
    /// keeps. If not, they are lines.
    pub are_outlines_areas: bool,
    /// Side of a cell of the map, mm.
    pub cell: f64,
    /// Minimum and maximum number of cells in the box.
    pub cells: [usize; 2],
    /// Whether rounds continue as long as they have any gain, for comparison; otherwise they end when the
    /// gain is small.
    pub is_thorough: bool,
}

impl IsometricOptions {
    /// Equal weight over the whole box of the drawing.
    pub const UNIFORM: Self = Self {
        first: None,
        line_weight: 0.0,
        area_weight: 0.0,
        angle_weight: 0.0,
        angle_limit: f64::INFINITY,
        box_weight: 1.0,
        are_outlines_areas: true,
        cell: 1.5,
        cells: [200, 900],
        is_thorough: false,
    };
    /// Lengths, areas and angles of the ink together.
    ///
    /// With a limit of 1, samples that are closer than the solver's would find a little more than the even map's shear.
    pub const INK: Self = Self {
        line_weight: 1.0,
        area_weight: 5.0,
        angle_weight: 0.22,
        angle_limit: 0.97,
        box_weight: 0.006,
        ..Self::UNIFORM
    };
    /// The lengths of lines first. Outlines that nothing fills keep only their lengths. The ink may shear
    /// half as much again as with [`Self::UNIFORM`].
    pub const LENGTHS: Self = Self {
        first: Some(Figure::Lengths),
        area_weight: 1.5,
        angle_weight: 0.1,
        angle_limit: 1.5,
        are_outlines_areas: false,
        ..Self::INK
    };
    /// The sizes of inked areas first.
    pub const AREAS: Self =
        Self { first: Some(Figure::Areas), line_weight: 0.2, area_weight: 40.0, ..Self::INK };
    /// The shapes of the ink first: its angles.
    pub const SHAPES: Self = Self { first: Some(Figure::Angles), angle_weight: 4.0, ..Self::INK };
    /// One figure without regard to the others. It is only for comparison: the paper between the ink gives way freely.
    const ONE: Self = Self {
        line_weight: 0.0,
        area_weight: 0.0,
        angle_weight: 0.0,
        angle_limit: 1e3,
        box_weight: 1e-4,
        is_thorough: true,
        ..Self::INK
    };
    /// Only the lengths of lines.
    pub const ONLY_LENGTHS: Self = Self { line_weight: 1.0, are_outlines_areas: false, ..Self::ONE };
    /// Only the sizes of inked areas.
    pub const ONLY_AREAS: Self = Self { area_weight: 1.0, ..Self::ONE };
    /// Only the angles of the ink.
    pub const ONLY_ANGLES: Self = Self { angle_weight: 1.0, ..Self::ONE };

    /// These options with the lengths of lines this many times as heavy; the ink may shear about as much as it does without a
    /// correction.
    pub(crate) fn nearly_lengths_alone(self, lengths: f64) -> Self {
        Self { angle_limit: self.angle_limit.max(UNCORRECTED_ANGLES), ..self.emphasised(lengths, 1.0) }
    }

    /// The same options with the weight of lines multiplied by `lengths` and the weight of angles by `angles`.
    pub fn emphasised(self, lengths: f64, angles: f64) -> Self {
        Self { line_weight: self.line_weight * lengths, angle_weight: self.angle_weight * angles, ..self }
    }

    pub(super) fn weights(&self) -> Weights {
        Weights { line: self.line_weight, area: self.area_weight, shape: 0.0, paper: self.box_weight }
    }

    pub(super) fn is_even(&self) -> bool {
        self.line_weight == 0.0 && self.area_weight == 0.0 && self.angle_weight == 0.0
    }
}
