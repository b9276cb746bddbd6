//! What a page shows, besides the values of the report.

use crate::preview::OnPart;
use crate::report::Report;

/// The content of the report. Coordinates are in the part frame, mm.
#[derive(Debug, Clone, Copy)]
pub struct PageContent<'a> {
    /// What was read, decided and measured.
    pub report: &'a Report,
    /// The flat panels, as [`svg`](crate::preview::svg) draws them.
    pub panels: &'a str,
    /// The mark on the part.
    pub on_part: &'a OnPart,
    /// The same as [`glb`](crate::preview::glb) writes it.
    pub glb: &'a [u8],
    /// What is around the mark.
    pub landmarks: &'a Landmarks,
}

/// What is around the mark: planes of the laser, and where the largest values were measured. Coordinates are in the part
/// frame, mm.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Landmarks {
    /// The working area at the height of the best focus, if the field is known.
    pub field: Option<Plane>,
    /// The lowest and the highest plane in focus around the mark, if the depth of focus is known.
    pub focus: Option<[Plane; 2]>,
    /// Where the length of a line is most wrong after the correction.
    pub stretch_at: Option<[f64; 3]>,
    /// Where the beam meets the part at the largest angle to its normal.
    pub incidence_at: Option<[f64; 3]>,
    /// Where the fitted surface is farthest from the part under the ink.
    pub residual_at: Option<[f64; 3]>,
}

/// A rectangle across the laser's axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Its corners in the part frame, mm, one after the other round the rectangle.
    pub corners: [[f64; 3]; 4],
    /// Width and height, mm.
    pub size: [f64; 2],
    /// Height in the laser's frame, mm.
    pub height: f64,
}
