//! The settings of fills and of steps of focus. Lengths in mm, angles in rad.

use super::choices::FocusSteps;
use crate::formats::pattern::{is_among, is_same_layer};

/// How contours are filled with lines.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FillSettings {
    /// Distance of neighbouring lines on the part, mm; `None` fills nothing.
    pub spacing: Option<f64>,
    /// Direction of the lines in the drawing, rad counter-clockwise from its x.
    pub angle: f64,
    /// Direction of a second family of lines; `None` for one family.
    pub second_angle: Option<f64>,
    /// Distance of the lines from the contours on the part, mm.
    pub border: f64,
    /// The layers that are filled, compared without regard to case; `None` for all ink layers.
    pub layers: Option<Vec<String>>,
}

impl Default for FillSettings {
    fn default() -> Self {
        Self { spacing: None, angle: 0.0, second_angle: None, border: 0.0, layers: None }
    }
}

impl FillSettings {
    /// Whether contours on the layer are filled.
    #[must_use]
    pub fn includes(&self, layer: &str) -> bool {
        is_among(self.layers.as_deref(), layer)
    }

    /// The layers of the settings that are not among the given ones.
    #[must_use]
    pub fn layers_missing_in(&self, layers: &[&str]) -> Vec<&str> {
        let is_missing = |name: &&str| !layers.iter().any(|layer| is_same_layer(name, layer));
        self.layers.iter().flatten().map(String::as_str).filter(is_missing).collect()
    }
}

/// How a drawing is divided where it is higher than the depth of focus.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct FocusSettings {
    /// Whether it is divided, and into what.
    pub steps: FocusSteps,
    /// Height of a step, mm; `None` for the depth of focus of the lens.
    pub step: Option<f64>,
    /// By how much neighbouring steps overlap, mm on the part.
    pub overlap: f64,
}
