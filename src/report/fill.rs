//! The fill of a job.

use serde::{Deserialize, Serialize};

use crate::geometry::fill::Filling;

/// The lines that fill contours, and how even they are on the part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct FillReport {
    /// Distance of neighbouring lines on the part, as set, mm.
    pub spacing_mm: f64,
    /// Direction of the lines of each family in the drawing, degrees counter-clockwise from its x.
    pub angles_deg: Vec<f64>,
    /// Distance of the lines from the contours on the part, mm.
    pub border_mm: f64,
    /// The layers of the corrected drawing that contain the lines.
    pub layers: Vec<String>,
    /// Number of lines; a line that an island interrupts is several.
    pub lines: usize,
    /// Their length on the part, mm.
    pub length_mm: f64,
    /// The filled area as drawn, mm².
    pub area_mm2: f64,
    /// Smallest and largest deviation of the spacing on the part, as a share of it.
    pub spacing_deviation: [f64; 2],
    /// The share of the fill whose spacing deviates by more than 1 %.
    pub uneven_share: f64,
    /// Smallest and largest length of a piece of a line on the part divided by its length in the field. The laser moves
    /// evenly in the field, so pulses are this many times as far apart on the part, and the energy per length is divided by it.
    pub spot_spacing: [f64; 2],
}

impl FillReport {
    /// The report of a fill in these directions (rad) of the drawing.
    #[must_use]
    pub fn new(filling: &Filling, spacing: f64, angles: &[f64], border: f64, layers: Vec<String>) -> Self {
        Self {
            spacing_mm: spacing,
            angles_deg: angles.iter().map(|angle| angle.to_degrees()).collect(),
            border_mm: border,
            layers,
            lines: filling.lines.len(),
            length_mm: filling.length,
            area_mm2: filling.area,
            spacing_deviation: filling.deviation,
            uneven_share: filling.uneven,
            // Lines too short to be measured have no ratio.
            spot_spacing: if filling.spot_spacing[1] > 0.0 { filling.spot_spacing } else { [1.0; 2] },
        }
    }

    /// How far apart the lines are on the part, as text.
    #[must_use]
    pub fn spacing_text(&self) -> String {
        let [least, most] = self.spacing_deviation.map(|share| share * 100.0 + 0.0);
        format!("{} mm apart on the part ({least:+.2} to {most:+.2} %)", self.spacing_mm)
    }

    /// One line for the summary.
    pub(super) fn summary(&self) -> String {
        let mut text =
            format!("fill          {} lines, {:.0} mm, {}", self.lines, self.length_mm, self.spacing_text());
        if self.spot_spacing[1] > 1.005 {
            text += &format!(
                "; where the beam is inclined, pulses are up to {:.2} times as far apart",
                self.spot_spacing[1]
            );
        }
        text
    }
}
