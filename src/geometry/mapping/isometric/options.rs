//! What the strain is weighted by.

/// What the strain is weighted by. Each weight belongs to a mean square, so only their ratios count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IsometricOptions {
    /// Weight of the strain along the drawing's own lines.
    pub line_weight: f64,
    /// Weight of the area strain over the inked area.
    pub area_weight: f64,
    /// Weight of the strain in all directions alike where the ink is: along the lines and over the inked area. With
    /// little of it lines and areas become truer still, but what is drawn shears.
    pub shape_weight: f64,
    /// Weight of the strain in all directions alike over the whole box, inked or not. With little of it the parts of
    /// the drawing drift against each other.
    pub box_weight: f64,
    /// Largest angle error of the ink, as a multiple of what the box alone would give it; infinite for any.
    pub angle_cap: f64,
    /// Side of a cell of the map, mm.
    pub cell: f64,
    /// Number of cells that the box is divided into at least and at most, whatever its size.
    pub cells: [usize; 2],
}

impl IsometricOptions {
    /// All of the drawing's box counts evenly.
    pub const UNIFORM: Self = Self {
        line_weight: 0.0,
        area_weight: 0.0,
        shape_weight: 0.0,
        box_weight: 1.0,
        angle_cap: f64::INFINITY,
        cell: 1.5,
        cells: [200, 900],
    };
    /// What is inked counts most.
    ///
    /// With much more weight on the lines, the inside of large filled shapes turns against their outline; with much
    /// less on areas, `e_a` of a filled disc gets worse than that of [`Self::UNIFORM`].
    pub const INK: Self = Self {
        line_weight: 1.0,
        area_weight: 2.0,
        shape_weight: 0.5,
        box_weight: 0.1,
        angle_cap: 1.0,
        ..Self::UNIFORM
    };

    /// The same with lines that count `lengths` times and shapes that count `angles` times as much.
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
