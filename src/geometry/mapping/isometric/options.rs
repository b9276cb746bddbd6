//! The weights of the strain.

/// The weights of the strain. Each weight multiplies a mean square, so only their ratios matter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IsometricOptions {
    /// Weight of the strain along the drawing's own lines.
    pub line_weight: f64,
    /// Weight of the area strain over the inked area.
    pub area_weight: f64,
    /// Weight of the strain in all directions equally at the ink: along the lines and over the inked area. A small
    /// weight improves lengths and areas further, but shapes are sheared.
    pub shape_weight: f64,
    /// Weight of the strain in all directions equally over the whole box, inked or not. With a small weight, the
    /// parts of the drawing move relative to each other.
    pub box_weight: f64,
    /// The angle error from which on the ink resists shear, as a multiple of the largest one with equal weights over the box;
    /// infinite for no resistance. Filled areas may exceed it by about a tenth.
    pub angle_cap: f64,
    /// Side of a cell of the map, mm.
    pub cell: f64,
    /// Minimum and maximum number of cells in the box.
    pub cells: [usize; 2],
}

impl IsometricOptions {
    /// Equal weight over the whole box of the drawing.
    pub const UNIFORM: Self = Self {
        line_weight: 0.0,
        area_weight: 0.0,
        shape_weight: 0.0,
        box_weight: 1.0,
        angle_cap: f64::INFINITY,
        cell: 1.5,
        cells: [200, 900],
    };
    /// More weight on the ink.
    ///
    /// With much more weight on the lines, the inside of large filled shapes rotates relative to their outline; with
    /// much less on areas, `e_a` of a filled disc is worse than with [`Self::UNIFORM`].
    pub const INK: Self = Self {
        line_weight: 1.0,
        area_weight: 2.0,
        shape_weight: 0.5,
        box_weight: 0.1,
        angle_cap: 1.0,
        ..Self::UNIFORM
    };

    /// The same options with the weight of lines multiplied by `lengths` and the weights of shapes by `angles`.
    pub fn emphasised(self, lengths: f64, angles: f64) -> Self {
        Self {
            line_weight: self.line_weight * lengths,
            shape_weight: self.shape_weight * angles,
            box_weight: self.box_weight * angles,
            ..self
        }
    }

    pub(super) fn is_even(&self) -> bool {
        self.line_weight == 0.0 && self.area_weight == 0.0 && self.shape_weight == 0.0
    }
}
