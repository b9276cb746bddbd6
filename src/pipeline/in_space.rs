//! What a corrected drawing is besides one flat file: a file for each step of focus, and the drawing on the part.

use super::{Corrected, JobSettings, LearnedPart, Pipeline, Projection};
use crate::formats::pattern;
use crate::geometry::focus::{self, SpaceDrawing};

impl Corrected {
    /// The DXF file of each step of focus with the name of its height, in their order; none if the drawing was not cut.
    pub fn step_files(&self) -> impl Iterator<Item = (String, Vec<u8>)> {
        // Between heights at which nothing is marked there are steps without lines.
        self.steps.iter().filter(|step| !step.drawing.paths.is_empty()).map(|step| {
            let name = step.name();
            let mut drawing = step.drawing.clone();
            drawing.comments.clone_from(&self.drawing.comments);
            if !drawing.comments.is_empty() {
                drawing.comments.push(format!("focus {name} mm"));
            }
            (name, pattern::write(&drawing, self.profile))
        })
    }
}

impl Pipeline {
    /// A corrected drawing on its part in the laser's frame, with chords that are within the tolerance of the settings in space;
    /// `None` if it was corrected without pictures.
    #[must_use]
    pub fn in_space(
        &self,
        learned: &LearnedPart,
        corrected: &Corrected,
        settings: &JobSettings,
    ) -> Option<SpaceDrawing> {
        let marked = corrected.marked.as_ref()?;
        let projection = Projection {
            map: &marked.map,
            surface: marked.surface(&learned.kept.surface),
            fixture: settings.fixture,
            head: settings.scan_head(),
        };
        let tolerance = settings.correction.tolerance;
        Some(focus::lifted(&corrected.drawing, &marked.drawn, &projection, tolerance))
    }
}
