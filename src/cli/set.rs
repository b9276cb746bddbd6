//! Settings on the command line: `--set`, and the options that are short forms of it.

use clap::Args;

use super::outcome::{Failure, Outcome};
use crate::config::{FocusSteps, JobSettings, Overrides, Tiles};
use crate::formats::pattern;

/// The option that gives any setting.
#[derive(Debug, Args)]
pub(super) struct SetArguments {
    /// Sets any setting for this run, such as `correction.tolerance_mm=0.02` or `part.unit=inch`; may be repeated. In `check`,
    /// `watch`, `status`, `retry`, `calibrate` and `register` it replaces the value in the station's file, and a SKU's file still
    /// overrides it. In all other commands it replaces the value in all files.
    #[arg(long, value_name = "TABLE.KEY=VALUE", value_parser = parse_pair)]
    set: Vec<(String, String)>,
}

fn parse_pair(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => Ok((name.trim().into(), value.into())),
        _ => Err("give a setting and its value, as in correction.tolerance_mm=0.02".into()),
    }
}

impl SetArguments {
    /// Adds the settings that were typed. `useless` gives the reason why a setting has no effect in the command.
    pub(super) fn add_to(
        &self,
        overrides: &mut Overrides,
        useless: impl Fn(&str) -> Option<&'static str>,
    ) -> Result<(), Failure> {
        for (name, value) in &self.set {
            let option = format!("--set {name}={value}");
            overrides.add(&option, name, value)?;
            if let Some(why) = useless(name) {
                return Err(Failure::usage(format!("`{option}` has no effect here: {why}."), "Remove it."));
            }
        }
        Ok(())
    }

    /// The settings of a station, all of which may be given.
    pub(super) fn of_station(&self) -> Result<Overrides, Failure> {
        let mut overrides = Overrides::default();
        self.add_to(&mut overrides, |_| None)?;
        Ok(overrides)
    }
}

/// Adds the settings of the options that stand for one: each option with its setting and the typed value.
pub(super) fn add_options(
    overrides: &mut Overrides,
    options: &[(&str, &str, Option<&String>)],
) -> Result<(), Failure> {
    for (option, name, value) in options {
        if let Some(value) = value {
            overrides.add(&format!("{option} {value}"), name, value)?;
        }
    }
    Ok(())
}

/// Adds a switch, if it was typed.
pub(super) fn add_switch(
    overrides: &mut Overrides,
    option: &str,
    name: &str,
    is_given: bool,
) -> Result<(), Failure> {
    if is_given {
        overrides.add(option, name, "true")?;
    }
    Ok(())
}

/// Adds a list, if it was typed.
pub(super) fn add_list(
    overrides: &mut Overrides,
    option: &str,
    name: &str,
    items: Option<&Vec<String>>,
) -> Result<(), Failure> {
    if let Some(items) = items {
        overrides.add_list(&format!("{option} {}", items.join(",")), name, items)?;
    }
    Ok(())
}

/// Refuses options that have no effect on the drawing `name`, because only drawings in other formats have what they change.
/// Settings in files are for all drawings and are not checked.
pub(super) fn refuse_options_of_other_formats(overrides: &Overrides, name: &str, drawing: &[u8]) -> Outcome {
    let format = match drawing {
        _ if pattern::is_dxf(drawing) => "a DXF",
        _ if pattern::is_svg(drawing) => "an SVG",
        _ => return Ok(()),
    };
    for (setting, option) in overrides.names() {
        let (why, remedy) = match (setting.as_str(), format) {
            ("pattern.width_mm" | "pattern.height_mm", "a DXF") => {
                ("is never scaled", "Remove it, or scale the drawing in the drawing program.")
            }
            ("pattern.threshold_percent" | "pattern.invert", _) => ("has no pixels", "Remove it."),
            ("pattern.space", "an SVG") => ("has no sheets", "Remove it."),
            ("pattern.strokes", "a DXF") => ("has widths only on polylines", "Remove it."),
            _ => continue,
        };
        let why = format!("{name} is {format}, which {why}");
        return Err(without_effect(option, &why, remedy));
    }
    Ok(())
}

/// Refuses options that have no effect, because another setting switches off what they change. Settings in files are for
/// all drawings and are not checked.
pub(super) fn refuse_options_of_what_is_off(overrides: &Overrides, settings: &JobSettings) -> Outcome {
    for (setting, option) in overrides.names() {
        let (why, remedy) = match setting.split_once('.') {
            Some(("rotary", key)) if key != "tiles" && settings.rotary.tiles == Tiles::Off => {
                ("the mark is not divided into tiles", "Remove it, or add `--rotary`.")
            }
            Some(("focus", key)) if key != "steps" && settings.focus.steps == FocusSteps::Off => {
                (WITHOUT_STEPS, ADD_STEPS)
            }
            Some(("fill", key)) if key != "spacing_mm" && settings.fill.spacing.is_none() => {
                ("nothing is filled", "Remove it, or add `--fill` with the distance of the lines.")
            }
            _ => continue,
        };
        return Err(without_effect(option, why, remedy));
    }
    Ok(())
}

/// Why options of steps of focus have no effect.
const WITHOUT_STEPS: &str = "the drawing is not divided into steps of focus";
const ADD_STEPS: &str = "Remove it, or add `--set focus.steps=layers`.";

/// Refuses an option of the steps of focus of a drawing that is not divided into them.
pub(super) fn refuse_without_steps(option: &str, settings: &JobSettings) -> Outcome {
    match settings.focus.steps {
        FocusSteps::Off => Err(without_effect(option, WITHOUT_STEPS, ADD_STEPS)),
        FocusSteps::Layers => Ok(()),
    }
}

/// Refuses an option that was typed.
pub(super) fn without_effect(option: &str, why: &str, remedy: &str) -> Failure {
    // The value of a short option is of no use in the message.
    let typed = match option.starts_with("--set ") {
        true => option,
        false => option.split(' ').next().unwrap_or(option),
    };
    Failure::usage(format!("`{typed}` has no effect: {why}."), remedy)
}

/// Refuses options of drawings for the part `name`, or options of parts for the drawing `name`.
pub(super) fn refuse_options_of_the_other(overrides: &Overrides, name: &str, is_part: bool) -> Outcome {
    let (table, why) = match is_part {
        true => ("pattern.", "is a part, and it is for drawings"),
        false => ("part.", "is a drawing, and it is for parts"),
    };
    match overrides.names().find(|(setting, _)| setting.starts_with(table)) {
        Some((_, option)) => Err(without_effect(option, &format!("{name} {why}"), "Remove it.")),
        None => Ok(()),
    }
}

/// Why a setting has no effect in a single job.
pub(super) fn useless_to_a_job(name: &str) -> Option<&'static str> {
    match name.split_once('.').map_or(name, |(table, _)| table) {
        _ if name == "delivery.verify" => None,
        "station" => Some("only a station has a name"),
        "folders" => Some("files are named on the command line; `--cache` names the folder of surfaces"),
        "watch" | "delivery" | "retention" | "log" | "page" => Some("only `isomark watch` uses it"),
        _ => None,
    }
}

/// Why a setting has no effect in a comparison of methods.
pub(super) fn useless_to_a_comparison(name: &str) -> Option<&'static str> {
    match (name, name.split_once('.').map_or(name, |(table, _)| table)) {
        ("correction.method", _) => Some("`--method` names the methods to compare"),
        (
            "correction.weighting"
            | "correction.aim"
            | "correction.floater_weights"
            | "correction.mapping_domain_as_printed",
            _,
        ) => Some("`isomark evaluate` compares all choices of it"),
        ("correction.tolerance_mm" | "correction.vertices", _) | (_, "output" | "delivery") => {
            Some("`isomark evaluate` writes no drawing")
        }
        (_, "fill" | "focus") => Some("`isomark evaluate` writes no drawing"),
        (_, "rotary") => Some("`isomark evaluate` compares the methods on the side that faces the laser"),
        (_, "field" | "optics" | "fixture") => {
            Some("`isomark evaluate` compares the methods on the part, without field and lens")
        }
        _ => useless_to_a_job(name),
    }
}

/// Why a setting has no effect in a look at a file.
pub(super) fn useless_to_an_inspection(name: &str) -> Option<&'static str> {
    const SIZES: &[&str] =
        &["part.shape", "part.diameter_mm", "part.end_diameter_mm", "part.length_mm", "part.axis"];
    match name.split_once('.').map_or(name, |(table, _)| table) {
        _ if name == "pattern.ink_layers" => Some("`isomark inspect` shows all layers"),
        _ if SIZES.contains(&name) => {
            Some("`isomark inspect` reads a file, and a part of these sizes has none")
        }
        _ if name == "part.converter" => Some("`isomark inspect` shows the faces of the file itself"),
        "part" | "pattern" => None,
        _ => Some("`isomark inspect` only reads a part or a drawing, and uses `part` and `pattern`"),
    }
}
