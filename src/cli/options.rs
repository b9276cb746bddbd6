//! Options that several commands share.

use clap::Args;

use super::outcome::{Exit, Failure};
use super::set::{add_options, add_switch};
use crate::config::{Overrides, Sku};

/// How a file's numbers are read where the file itself does not state it, or states it wrongly.
#[derive(Debug, Args)]
pub(super) struct MeaningArguments {
    /// Unit of the part's numbers: mm, cm, dm, m or inch. Default: decided by the format and the program that wrote the file.
    #[arg(long, value_name = "UNIT", help_heading = "Part and drawing")]
    part_unit: Option<String>,
    /// Axis of the part's file that points up: z or y. Default: decided by the format and the program that wrote the file.
    #[arg(long, value_name = "AXIS", help_heading = "Part and drawing")]
    part_up: Option<String>,
    /// What the surface follows between the vertices of a mesh: auto (default: the file's normals if they are those of
    /// the surface, otherwise estimated), file (the normals of the file), facets (the flat triangles) or estimate (normals
    /// estimated from the triangles).
    #[arg(long, value_name = "WHAT", help_heading = "Part and drawing")]
    normals: Option<String>,
    /// Widest gap that is bridged, mm, 0 to 100: a hole in a mesh where triangles are missing, or a gap in a scan. Default:
    /// one or two missing triangles, up to 2 mm.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing", allow_hyphen_values = true)]
    bridge: Option<String>,
    /// Unit of a drawing that names none: mm, in, px and others. Default: mm, or inches where the drawing suggests them.
    #[arg(long, value_name = "UNIT", help_heading = "Part and drawing")]
    pattern_unit: Option<String>,
    /// How strokes in an SVG drawing are marked: center (default), along their centre lines, or band, the area that they cover.
    #[arg(long, value_name = "WHAT", help_heading = "Part and drawing")]
    strokes: Option<String>,
    /// Marks polylines, and strokes that are marked as bands, along their centre lines if they are narrower than this, mm, 0 to
    /// 1; default 0.05.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing", allow_hyphen_values = true)]
    hairline: Option<String>,
    /// Which part of a DXF is read: model (default), paper (the only sheet with content) or paper:NAME (the sheet of this name).
    #[arg(long, value_name = "SPACE", help_heading = "Part and drawing")]
    space: Option<String>,
    /// Width of the whole picture with its blank border, or of the page of an SVG drawing, mm, 0.01 to 10000; one side is enough. Default: by the resolution (dpi) or size in its file.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing", allow_hyphen_values = true)]
    width: Option<String>,
    /// Height of a picture or page, mm, 0.01 to 10000.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing", allow_hyphen_values = true)]
    height: Option<String>,
    /// Pixels of a picture darker than this are marked: 1 (nearly black) to 99 (nearly white); default 50.
    #[arg(long, value_name = "PERCENT", help_heading = "Part and drawing", allow_hyphen_values = true)]
    threshold: Option<String>,
    /// Joins the ends of loose pieces up to this far apart, mm, 0 to 1; default 0.002, 0 joins nothing.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing", allow_hyphen_values = true)]
    joining: Option<String>,
    /// Keeps a drawing unchanged: nothing is joined, closed or removed; isomark only warns.
    #[arg(long, help_heading = "Part and drawing")]
    strict: bool,
    /// If visible ink on an ink layer cannot be read: refuse (default) rejects the drawing, warn marks the rest.
    #[arg(long, value_name = "WHAT", help_heading = "Part and drawing")]
    losses: Option<String>,
    /// Marks the light pixels of a picture instead of the dark ones.
    #[arg(long, help_heading = "Part and drawing")]
    invert: bool,
}

impl MeaningArguments {
    /// Adds the settings that were typed.
    pub(super) fn add_to(&self, overrides: &mut Overrides) -> Result<(), Failure> {
        // The settings have one spelling.
        let [unit, up, normals] = [&self.part_unit, &self.part_up, &self.normals]
            .map(|typed| typed.as_ref().map(|typed| typed.to_ascii_lowercase()));
        let percent = self.threshold.as_ref().map(|typed| typed.trim().trim_end_matches('%').to_owned());
        add_options(
            overrides,
            &[
                ("--part-unit", "part.unit", unit.as_ref()),
                ("--part-up", "part.up", up.as_ref()),
                ("--normals", "part.normals", normals.as_ref()),
                ("--bridge", "part.bridge_mm", self.bridge.as_ref()),
                ("--pattern-unit", "pattern.unit_if_unitless", self.pattern_unit.as_ref()),
                ("--width", "pattern.width_mm", self.width.as_ref()),
                ("--height", "pattern.height_mm", self.height.as_ref()),
                ("--threshold", "pattern.threshold_percent", percent.as_ref()),
                ("--joining", "pattern.joining_mm", self.joining.as_ref()),
                ("--losses", "pattern.losses", self.losses.as_ref()),
                ("--strokes", "pattern.strokes", self.strokes.as_ref()),
                ("--hairline", "pattern.hairline_mm", self.hairline.as_ref()),
                ("--space", "pattern.space", self.space.as_ref()),
            ],
        )?;
        add_switch(overrides, "--strict", "pattern.strict", self.strict)?;
        add_switch(overrides, "--invert", "pattern.invert", self.invert)
    }
}

/// How a scan becomes a surface.
#[derive(Debug, Args)]
pub(super) struct ScanArguments {
    /// How noise is removed from a scan: auto (as much as the points need, default), low-pass or none.
    #[arg(long, value_name = "HOW", help_heading = "Part and drawing")]
    smoothing: Option<String>,
    /// Wavelength that the low pass halves, mm, 0.1 to 1000; shorter waves are removed. Implies `--smoothing low-pass`; default 16.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing", allow_hyphen_values = true)]
    low_pass: Option<String>,
}

impl ScanArguments {
    /// Adds the settings that were typed.
    pub(super) fn add_to(&self, overrides: &mut Overrides) -> Result<(), Failure> {
        add_options(
            overrides,
            &[
                ("--smoothing", "part.smoothing", self.smoothing.as_ref()),
                ("--low-pass", "part.low_pass_mm", self.low_pass.as_ref()),
            ],
        )
    }
}

pub(super) fn parse_sku(text: &str) -> Result<Sku, Failure> {
    text.parse::<Sku>().map_err(|error| Failure::new(Exit::Usage, error.reason()))
}
