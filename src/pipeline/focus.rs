//! The steps of focus of a job: the corrected drawing cut by height, one set of layers for each step.

use std::collections::{BTreeMap, BTreeSet};

use super::checks;
use super::{Exposure, JobSettings, MarkingDrawing, Projection};
use crate::config::FocusSteps;
use crate::formats::pattern::unused_name;
use crate::geometry::focus::{self, FocusBands, FocusStep, MOST_STEPS};
use crate::geometry::marking::MarkingShape;
use crate::geometry::pattern::Layer;
use crate::geometry::space::FlatPoint;
use crate::reason::{Notice, Reason};
use crate::report::FocusReport;

/// The part of a corrected drawing that is marked at one height of focus.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct StepDrawing {
    /// The height that must be in focus, mm in the laser's frame.
    pub focus: f64,
    /// What is marked, on the layers of the original drawing and of its fill.
    pub drawing: MarkingDrawing,
}

impl StepDrawing {
    /// The height as a part of a name, such as `z+001.500`.
    #[must_use]
    pub fn name(&self) -> String {
        height_name(self.focus)
    }
}

/// The corrected drawing after it was cut.
#[derive(Debug)]
pub(super) struct Stepped {
    pub(super) report: FocusReport,
    /// The steps; empty if the drawing was not cut.
    pub(super) steps: Vec<StepDrawing>,
}

/// Cuts the corrected drawing if the settings ask for it, and notes what that opens; `None` if they do not. `drawn` holds, for
/// each path, the points of the placed drawing that its points mark; it is returned for the paths of the result.
///
/// # Errors
/// When there would be too many steps.
pub(super) fn divide(
    drawing: &mut MarkingDrawing,
    drawn: Vec<Vec<FlatPoint>>,
    projection: &Projection<'_>,
    exposure: &Exposure,
    settings: &JobSettings,
    notices: &mut Vec<Notice>,
) -> Result<(Vec<Vec<FlatPoint>>, Option<Stepped>), Reason> {
    let overlap = settings.focus.overlap;
    let step = settings.focus.step.or(settings.optics.focus_depth);
    let (FocusSteps::Layers, Some(step)) = (settings.focus.steps, step) else { return Ok((drawn, None)) };
    let range = exposure.highest - exposure.lowest;
    if range / step > MOST_STEPS as f64 {
        return Err(Reason::new(
            "focus-too-many-steps",
            format!("The drawing spans {range:.2} mm of height, which is more than {MOST_STEPS} steps of {step} mm."),
            "Raise `step_mm` under [focus].",
        )
        .with_number("steps of focus", (range / step).ceil(), "", Some(MOST_STEPS as f64)));
    }
    let bands = FocusBands::new(exposure.lowest, exposure.highest, step);
    let steps = focus::divide(drawing, &drawn, projection, &bands, overlap)
        .map_err(|error| checks::above_lens(error.at))?;
    let numbers = steps.iter().map(|step| (step.focus, step.range, step.drawing.paths.len()));
    let report = FocusReport::new(overlap, numbers.collect());
    if steps.len() < 2 {
        return Ok((drawn, Some(Stepped { report, steps: Vec::new() })));
    }
    let contours = |drawing: &MarkingDrawing| {
        drawing.paths.iter().filter(|path| matches!(path.shape, MarkingShape::Closed(_))).count()
    };
    let left: usize = steps.iter().map(|step| contours(&step.drawing)).sum();
    let opened = contours(drawing).saturating_sub(left);
    if opened > 0 && settings.fill.spacing.is_none() {
        let what = if opened == 1 { "1 contour is" } else { &format!("{opened} contours are") };
        notices.push(Notice::note(
            "focus-opens-contours",
            format!(
                "{what} cut between steps of focus and then open: the marking software cannot fill them. To fill them, set \
                 `spacing_mm` under [fill] (`--fill`)"
            ),
        ));
    }
    let drawn = on_layers(drawing, &steps);
    let steps = steps.into_iter().map(|step| StepDrawing { focus: step.focus, drawing: step.drawing });
    Ok((drawn, Some(Stepped { report, steps: steps.collect() })))
}

/// Replaces the paths of a drawing by those of the steps, each on layers of its own; returns the points of the paths.
fn on_layers(drawing: &mut MarkingDrawing, steps: &[FocusStep]) -> Vec<Vec<FlatPoint>> {
    let original = std::mem::take(&mut drawing.layers);
    drawing.paths.clear();
    let mut drawn = Vec::new();
    let mut names = BTreeSet::new();
    for step in steps {
        let mut layers: BTreeMap<usize, usize> = BTreeMap::new();
        let mut used: Vec<usize> = step.drawing.paths.iter().map(|path| path.layer).collect();
        used.sort_unstable();
        used.dedup();
        for index in used {
            let Some(layer) = original.get(index) else { continue };
            let base = format!("{}-{}", layer.name, height_name(step.focus));
            let name = unused_name(&base, &mut names);
            layers.insert(index, drawing.layers.len());
            drawing.layers.push(Layer { name, color: layer.color });
        }
        for (path, points) in step.drawing.paths.iter().zip(&step.drawn) {
            let mut path = path.clone();
            path.layer = layers.get(&path.layer).copied().unwrap_or(0);
            drawing.paths.push(path);
            drawn.push(points.clone());
        }
    }
    drawn
}

/// A height as a part of a name: `z` and the height in mm with its sign, in digits that sort by it.
fn height_name(height: f64) -> String {
    format!("z{:+08.3}", (height * 1000.0).round() / 1000.0 + 0.0)
}

#[cfg(test)]
mod tests {
    use super::height_name;

    #[test]
    fn the_names_of_heights_sort_by_height() {
        let names = [0.0, 0.5, 9.857, 14.021, 120.0].map(height_name);
        assert!(names.is_sorted(), "{names:?}");
        assert_eq!(height_name(9.8566), "z+009.857");
        assert_eq!(height_name(-0.0001), "z+000.000");
    }
}
