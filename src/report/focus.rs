//! The steps of focus of a job.

use serde::{Deserialize, Serialize};

/// The steps into which a drawing is cut by height.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct FocusReport {
    /// By how much neighbouring steps overlap, mm on the part.
    pub overlap_mm: f64,
    /// The steps in their order, from the highest to the lowest; a single one if the drawing was not cut.
    pub steps: Vec<FocusStepReport>,
}

/// A step of focus.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct FocusStepReport {
    /// The height that must be in focus, mm in the laser's frame.
    pub focus_mm: f64,
    /// Lowest and highest height of the step, mm in the laser's frame.
    pub height_mm: [f64; 2],
    /// Number of its paths.
    pub paths: usize,
}

impl FocusReport {
    /// The report of these steps.
    pub(crate) fn new(overlap_mm: f64, steps: Vec<(f64, [f64; 2], usize)>) -> Self {
        let steps = steps.into_iter();
        let steps = steps.map(|(focus_mm, height_mm, paths)| FocusStepReport { focus_mm, height_mm, paths });
        Self { overlap_mm, steps: steps.collect() }
    }

    /// One line for the summary.
    pub(super) fn summary(&self) -> String {
        let heights: Vec<String> =
            self.steps.iter().map(|step| format!("{:+.3}", step.focus_mm + 0.0)).collect();
        match heights.len() {
            1 => format!("focus steps   1, at z = {} mm; the drawing is not cut", heights.join("")),
            count => format!("focus steps   {count}, at z = {} mm", heights.join(", ")),
        }
    }
}
