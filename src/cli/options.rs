//! Options that several commands share.

use clap::Args;

use super::outcome::{Exit, Failure};
use crate::config::{JOINING, LOW_PASS, Losses, PatternSettings, Sku, Smoothing};
use crate::formats::mesh::{LengthUnit, UpAxis};
use crate::formats::pattern::DrawingUnit;
use crate::geometry::surface::scan;

/// What a file's numbers mean where the file itself does not say it, or says it wrongly.
#[derive(Debug, Args)]
pub(super) struct MeaningArguments {
    /// Unit of the part's numbers: mm, cm, dm, m or inch; default: what format and producer say.
    #[arg(long, value_name = "UNIT", help_heading = "Part and drawing")]
    pub(super) part_unit: Option<LengthUnit>,
    /// Axis of the part's file that points up: z or y; default: what format and producer say.
    #[arg(long, value_name = "AXIS", help_heading = "Part and drawing")]
    pub(super) part_up: Option<UpAxis>,
    /// Unit of a drawing that names none: mm, in, px and others; default mm, or inches where the drawing hints at them.
    #[arg(long, value_name = "UNIT", help_heading = "Part and drawing")]
    pub(super) pattern_unit: Option<DrawingUnit>,
    /// Width of a picture, mm; one side is enough. Without both, the resolution (dpi) that its file names.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing", value_parser = parse_side)]
    pub(super) width: Option<f64>,
    /// Height of a picture, mm.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing", value_parser = parse_side)]
    pub(super) height: Option<f64>,
    /// Pixels of a picture darker than this are marked: 0 is black, 100 white; default 50.
    #[arg(long, value_name = "PERCENT", help_heading = "Part and drawing", value_parser = parse_threshold)]
    pub(super) threshold: Option<f64>,
    /// Ends of loose pieces no farther apart are joined, mm, 0 to 1; default 0.002, 0 joins nothing.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing", value_parser = parse_joining)]
    pub(super) joining: Option<f64>,
    /// Leaves a drawing as it is: nothing is joined, closed or taken out, only warned of.
    #[arg(long, help_heading = "Part and drawing")]
    pub(super) strict: bool,
    /// What is done when the drawing shows ink on an ink layer that cannot be taken over: refuse (default) or warn, which
    /// marks the rest.
    #[arg(long, value_name = "WHAT", help_heading = "Part and drawing")]
    pub(super) losses: Option<Losses>,
    /// Marks the light pixels of a picture instead of the dark ones.
    #[arg(long, help_heading = "Part and drawing")]
    pub(super) invert: bool,
}

impl MeaningArguments {
    /// The settings for drawings, with what was typed in their place.
    pub(super) fn apply(&self, to: &mut PatternSettings) {
        to.unit_if_unitless = self.pattern_unit.or(to.unit_if_unitless);
        if self.width.is_some() || self.height.is_some() {
            (to.picture.width, to.picture.height) = (self.width, self.height);
        }
        to.picture.threshold = self.threshold.unwrap_or(to.picture.threshold);
        to.picture.inverted |= self.invert;
        to.joining_tolerance = self.joining.unwrap_or(to.joining_tolerance);
        to.strict |= self.strict;
        to.losses = self.losses.unwrap_or(to.losses);
    }
}

/// How a scan becomes a surface.
#[derive(Debug, Args)]
pub(super) struct ScanArguments {
    /// How noise is taken out of a scan: auto (as much as the points ask for, default), low-pass or none.
    #[arg(long, value_name = "HOW", help_heading = "Part and drawing")]
    pub(super) smoothing: Option<Smoothing>,
    /// Waves of this length are halved and shorter ones taken out, mm; with `--smoothing low-pass`, default 16.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing")]
    pub(super) low_pass: Option<f64>,
}

impl ScanArguments {
    /// The smoothing, if it was given.
    pub(super) fn smoothing(&self) -> Result<Option<scan::Smoothing>, Failure> {
        let named = self.smoothing.or(self.low_pass.map(|_| Smoothing::LowPass));
        match self.low_pass {
            Some(wavelength) if !LOW_PASS.contains(&wavelength) => Err(Failure::usage(
                format!("A low pass of {wavelength} mm makes no sense."),
                format!("Give `--low-pass` between {} and {} mm.", LOW_PASS.start(), LOW_PASS.end()),
            )),
            Some(_) if named != Some(Smoothing::LowPass) => Err(Failure::usage(
                "`--low-pass` means nothing with another smoothing.",
                "Leave out one of `--smoothing` and `--low-pass`.",
            )),
            wavelength => Ok(named.map(|named| named.with_wavelength(wavelength))),
        }
    }
}

fn parse_side(text: &str) -> Result<f64, String> {
    let side = text.trim().parse().ok().filter(|side| (0.01..=10_000.0).contains(side));
    side.ok_or_else(|| "give a length in mm, from 0.01 to 10000".into())
}

fn parse_joining(text: &str) -> Result<f64, String> {
    let gap = text.trim().parse().ok().filter(|gap| JOINING.contains(gap));
    gap.ok_or_else(|| format!("give a length in mm, from {} to {}", JOINING.start(), JOINING.end()))
}

fn parse_threshold(text: &str) -> Result<f64, String> {
    let percent = text.trim().trim_end_matches('%').parse().ok();
    let percent = percent.filter(|percent: &f64| (1.0..=99.0).contains(percent));
    percent.map(|percent| percent / 100.0).ok_or_else(|| "give a number from 1 to 99".into())
}

pub(super) fn parse_sku(text: &str) -> Result<Sku, Failure> {
    text.parse::<Sku>().map_err(|error| Failure { exit: Exit::Usage, reason: error.reason() })
}
