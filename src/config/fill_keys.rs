//! The tables `[fill]` and `[focus]`: the lines that fill contours, and the steps of focus on parts that are higher than the
//! depth of focus.

use serde::Deserialize;
use toml::Spanned;

use super::choices::FocusSteps;
use super::error::ConfigError;
use super::settings::JobSettings;
use super::text::SettingsText;

/// Spacings that the output and marking software can hold, mm: below, neighbouring lines are nearer than galvos resolve.
const SPACING: std::ops::RangeInclusive<f64> = 0.005..=10.0;
/// Distances of a fill from its contours, mm.
const BORDER: std::ops::RangeInclusive<f64> = 0.0..=10.0;
/// Heights of a step of focus, mm.
const STEP: std::ops::RangeInclusive<f64> = 0.01..=1000.0;
/// Overlaps of two steps of focus, mm.
const OVERLAP: std::ops::RangeInclusive<f64> = 0.0..=10.0;
/// Two families of lines must differ by more than this angle, rad.
const SAME_ANGLE: f64 = 0.002;

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct FillKeys {
    spacing_mm: Option<Spanned<f64>>,
    angle_deg: Option<Spanned<f64>>,
    second_angle_deg: Option<Spanned<f64>>,
    border_mm: Option<Spanned<f64>>,
    layers: Option<Spanned<Vec<String>>>,
}

impl FillKeys {
    pub(super) fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        let fill = &mut to.fill;
        if let Some(spacing) = &self.spacing_mm {
            fill.spacing = match *spacing.get_ref() {
                // Switches a station's fill off.
                0.0 => None,
                _ => Some(text.number("fill.spacing_mm", spacing, SPACING, "mm")?),
            };
        }
        let angle =
            |key, given: &Spanned<f64>| Ok(text.number(key, given, -360.0..=360.0, "deg")?.to_radians());
        if let Some(given) = &self.angle_deg {
            fill.angle = angle("fill.angle_deg", given)?;
        }
        if let Some(given) = &self.second_angle_deg {
            fill.second_angle = Some(angle("fill.second_angle_deg", given)?);
        }
        let half = std::f64::consts::PI;
        let apart =
            |second: f64| ((second - fill.angle) / half - ((second - fill.angle) / half).round()) * half;
        if let (Some(second), Some(given)) = (fill.second_angle, self.second_angle_deg.or(self.angle_deg))
            && apart(second).abs() < SAME_ANGLE
        {
            return Err(ConfigError::Contradiction {
                spot: text.spot(&given.span()),
                what: "`fill.angle_deg` and `fill.second_angle_deg` give the same direction, so every line would be marked twice."
                    .into(),
                remedy: "Give two directions, such as 45 and 135, or remove `second_angle_deg`.".into(),
            });
        }
        if let Some(border) = &self.border_mm {
            fill.border = text.number("fill.border_mm", border, BORDER, "mm")?;
        }
        if let Some(layers) = self.layers {
            if layers.get_ref().is_empty() {
                return Err(ConfigError::Contradiction {
                    spot: text.spot(&layers.span()),
                    what: "`fill.layers` is empty, so nothing would be filled.".into(),
                    remedy: "Name at least one layer, or remove the key to fill all; `spacing_mm = 0` fills nothing.".into(),
                });
            }
            fill.layers = Some(layers.into_inner());
        }
        Ok(())
    }
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct FocusKeys {
    steps: Option<Spanned<FocusSteps>>,
    step_mm: Option<Spanned<f64>>,
    overlap_mm: Option<Spanned<f64>>,
}

impl FocusKeys {
    pub(super) fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        let focus = &mut to.focus;
        focus.steps = self.steps.as_ref().map_or(focus.steps, |steps| *steps.get_ref());
        if let Some(step) = &self.step_mm {
            focus.step = Some(text.number("focus.step_mm", step, STEP, "mm")?);
        }
        if let Some(overlap) = &self.overlap_mm {
            focus.overlap = text.number("focus.overlap_mm", overlap, OVERLAP, "mm")?;
        }
        let has_step = focus.step.or(to.optics.focus_depth).is_some();
        match self.steps {
            Some(steps) if *steps.get_ref() != FocusSteps::Off && !has_step => {
                Err(ConfigError::Contradiction {
                    spot: text.spot(&steps.span()),
                    what: "`focus.steps` cuts the drawing by height, and the height of a step is not known."
                        .into(),
                    remedy: "Give `step_mm` under [focus], or `focus_depth_mm` under [optics].".into(),
                })
            }
            _ => Ok(()),
        }
    }
}
