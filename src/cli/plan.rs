//! `isomark plan`: how long a drawing takes on a belt, and whether the belt leaves that time.

use std::path::PathBuf;

use clap::Args;
use nalgebra::Vector2;
use serde::Serialize;

use super::named_files::{name_of, read_file, station};
use super::outcome::{Failure, Outcome, print, print_json};
use crate::formats::pattern::{PatternOptions, read};
use crate::geometry::belt::{Belt, BeltPlan};
use crate::geometry::pattern::Pattern;
use crate::reason::Reason;

/// Name and version of the JSON form.
const SCHEMA: &str = "isomark.plan/1";

#[derive(Debug, Args)]
pub(super) struct PlanArguments {
    /// The corrected drawing (.dxf).
    drawing: PathBuf,
    /// Speed of the belt, mm/s.
    #[arg(long, value_name = "MM/S", allow_hyphen_values = true, value_parser = above_zero)]
    speed: f64,
    /// Direction of the belt in the field: x (default), -x, y, -y.
    #[arg(long, value_name = "AXIS", default_value = "x", allow_hyphen_values = true, value_parser = ["x", "-x", "y", "-y"])]
    direction: String,
    /// A station's file, whose field is used.
    #[arg(long, value_name = "FILE")]
    station: Option<PathBuf>,
    /// Width and height of the field, mm; needed without `--station`.
    #[arg(long, value_name = "W,H", value_delimiter = ',', num_args = 1, allow_hyphen_values = true, value_parser = above_zero)]
    field: Option<Vec<f64>>,
    /// Distance from one product to the next, mm.
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = above_zero)]
    pitch: Option<f64>,
    /// Time from the scan of a product to its corrected drawing, s: for the lead distance.
    #[arg(long, value_name = "S", allow_hyphen_values = true, value_parser = above_zero)]
    correction_time: Option<f64>,
    /// Speed at which lines are marked, mm/s.
    #[arg(long, value_name = "MM/S", default_value = "1000", allow_hyphen_values = true, value_parser = above_zero)]
    marking_speed: f64,
    /// Speed of jumps between lines, mm/s.
    #[arg(long, value_name = "MM/S", default_value = "4000", allow_hyphen_values = true, value_parser = above_zero)]
    jump_speed: f64,
    /// Time after each jump, ms.
    #[arg(long, value_name = "MS", default_value = "0.3", allow_hyphen_values = true, value_parser = not_negative)]
    jump_delay: f64,
    /// Time to switch the laser on and off for each line, ms.
    #[arg(long, value_name = "MS", default_value = "0.2", allow_hyphen_values = true, value_parser = not_negative)]
    line_delay: f64,
    /// Time at each corner of a line, ms.
    #[arg(long, value_name = "MS", default_value = "0.01", allow_hyphen_values = true, value_parser = not_negative)]
    corner_delay: f64,
    /// Prints the plan as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

fn above_zero(text: &str) -> Result<f64, String> {
    let number =
        text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0 && *number <= 1e9);
    number.ok_or_else(|| "give a number above 0, such as 100".into())
}

fn not_negative(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| (0.0..=1e6).contains(number));
    number.ok_or_else(|| "give a number of milliseconds, 0 or more".into())
}

/// The plan of a drawing on a belt.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Document {
    /// Name and version of this form.
    schema: &'static str,
    /// The drawing's file.
    drawing: String,
    /// Extent of the drawing along the belt and across it, mm.
    size_mm: [f64; 2],
    /// Length of all lines, mm.
    ink_mm: f64,
    /// Length of all jumps, mm.
    jumps_mm: f64,
    /// Time for lines, s.
    marking_s: f64,
    /// Time for jumps, s.
    jump_s: f64,
    /// Time for delays, s.
    delay_s: f64,
    /// All three together, s.
    total_s: f64,
    /// Whether one laser can mark all lines while the product passes, before the next product.
    fits: bool,
    /// The fastest belt at which one laser can mark every product, mm/s, with a pitch also before the next one; absent if a line is
    /// longer than the field, or products are longer than the pitch.
    #[serde(skip_serializing_if = "Option::is_none")]
    fastest_belt_mm_per_s: Option<f64>,
    /// Smallest distance from one product to the next, mm, that leaves the laser the time for each.
    smallest_pitch_mm: f64,
    /// Products per second: as many as the belt brings if all fits, otherwise as many as one laser can mark.
    products_per_s: f64,
    /// How far before the laser the scanner must be, mm; absent without a correction time.
    #[serde(skip_serializing_if = "Option::is_none")]
    lead_mm: Option<f64>,
    /// How many products are corrected at the same time; absent without a correction time and a pitch.
    #[serde(skip_serializing_if = "Option::is_none")]
    corrections_at_once: Option<f64>,
    /// The lines in the order of the belt, for one laser after another: one section if one laser can mark all.
    sections: Vec<SectionReport>,
    /// What to change if the belt outruns the laser.
    #[serde(skip_serializing_if = "Option::is_none")]
    remedy: Option<String>,
}

/// Lines that one laser marks.
#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct SectionReport {
    /// The numbers of the paths in the file, from 1, in the order of marking.
    paths: Vec<usize>,
    /// Hindmost and foremost position along the belt, mm.
    along_mm: [f64; 2],
    /// Time for its lines, jumps and delays, s.
    time_s: f64,
}

pub(super) fn run(arguments: &PlanArguments) -> Outcome {
    let name = name_of(&arguments.drawing)?;
    let reading = read(&read_file(&arguments.drawing)?, &PatternOptions::default())
        .map_err(|error| Failure::rejected(error.reason().in_file(name.clone())))?;
    let field = arguments.field()?;
    let direction = match arguments.direction.as_str() {
        "-x" => Vector2::new(-1.0, 0.0),
        "y" => Vector2::new(0.0, 1.0),
        "-y" => Vector2::new(0.0, -1.0),
        _ => Vector2::new(1.0, 0.0),
    };
    let turned = if direction.x == 0.0 { [field[1], field[0]] } else { field };
    let belt = Belt {
        speed: arguments.speed,
        direction,
        field: turned[0],
        marking_speed: arguments.marking_speed,
        jump_speed: arguments.jump_speed,
        jump_delay: arguments.jump_delay / 1e3,
        line_delay: arguments.line_delay / 1e3,
        corner_delay: arguments.corner_delay / 1e3,
    };
    let rejected = |reason: Reason| Failure::rejected(reason.in_file(name.clone()));
    if let Some(layer) = reading.pattern.layers.iter().find(|layer| is_of_tile(&layer.name)) {
        let what = format!(
            "The drawing is divided into tiles, such as layer {}: the part turns between them.",
            layer.name
        );
        let remedy = "Plan one tile at a time (`--tiles-as files`), and add the time that the rotary axis needs to turn.";
        return Err(rejected(Reason::new("plan-tiles", what, remedy)));
    }
    let plan = belt.plan(&reading.pattern).ok_or_else(|| {
        rejected(Reason::new("plan-empty", "The drawing has no lines.", "Name a corrected drawing."))
    })?;
    if plan.size[1] > turned[1] {
        let what = "The drawing is wider than the field, across the belt.";
        let remedy = "Make the drawing narrower, turn the part or the belt (`--direction`), or divide the drawing between lasers \
                      side by side.";
        let reason = Reason::new("plan-outside-field", what, remedy);
        return Err(rejected(reason.with_number(
            "width across the belt",
            plan.size[1],
            "mm",
            Some(turned[1]),
        )));
    }
    let document = document(name, &belt, (&reading.pattern, &plan), arguments);
    if arguments.json {
        let text =
            serde_json::to_string_pretty(&document).map_err(|error| Failure::environment(&error.into()))?;
        print_json(&(text + "\n"));
    } else {
        print(&text(&document, arguments));
    }
    Ok(())
}

impl PlanArguments {
    fn field(&self) -> Result<[f64; 2], Failure> {
        let of_station = station(self.station.as_deref())?
            .and_then(|station| station.settings.field)
            .map(|field| [field.width, field.height]);
        match (self.field.as_deref(), of_station) {
            (Some([width, height]), _) => Ok([*width, *height]),
            (None, Some(field)) => Ok(field),
            (Some(_), _) => Err(Failure::usage(
                "`--field` needs two numbers.".to_owned(),
                "Give width and height in mm, as in 110,110.",
            )),
            (None, None) => Err(Failure::usage(
                "The size of the field is not known.".to_owned(),
                "Give `--field W,H` or `--station FILE`.",
            )),
        }
    }
}

/// Whether a layer is of a tile of a mark round a part, such as `R+045.000 MARK`.
fn is_of_tile(layer: &str) -> bool {
    let Some((angle, _)) = layer.strip_prefix('R').and_then(|rest| rest.split_once(' ')) else {
        return false;
    };
    angle.starts_with(['+', '-']) && angle.len() == "+045.000".len() && angle.parse::<f64>().is_ok()
}

/// A speed rounded down, so that it works as it is printed, mm/s.
fn rounded_down(speed: f64) -> f64 {
    let steps = if speed < 1.0 { 1e5 } else { 100.0 };
    (speed * steps).floor() / steps
}

/// The same as text.
fn shown_speed(speed: f64) -> String {
    let digits = if speed < 1.0 { 5 } else { 2 };
    format!("{:.digits$} mm/s", rounded_down(speed))
}

/// A distance rounded up, so that it is enough as it is printed, mm.
fn rounded_up(distance: f64) -> f64 {
    (distance * 100.0 - 1e-6).ceil() / 100.0
}

fn document(
    drawing: String,
    belt: &Belt,
    (pattern, plan): (&Pattern, &BeltPlan),
    arguments: &PlanArguments,
) -> Document {
    let total: f64 = plan.times.iter().sum();
    let pitch = arguments.pitch;
    let fastest = match pitch {
        Some(pitch) => belt.fastest_at(pattern, pitch),
        None => plan.fastest,
    };
    // Marks of neighbouring products do not overlap, however fast the laser is.
    let smallest_pitch = (plan.span * belt.speed).max(plan.size[0]);
    let passes =
        plan.sections.len() == 1 && plan.fastest.is_some_and(|fastest| fastest >= belt.speed * (1.0 - 1e-9));
    let follows = pitch.is_none_or(|pitch| pitch >= smallest_pitch * (1.0 - 1e-9));
    let brought = pitch.map(|pitch| belt.speed / pitch);
    let possible = (1.0 / plan.span).min(belt.speed / smallest_pitch);
    let slow = |fastest: f64| format!("Slow the belt to at most {}", shown_speed(fastest));
    let remedy = match (passes, plan.fastest) {
        (false, None) => Some(format!(
            "Split lines longer than the field: one spans {:.2} mm along the belt, and the field is {:.2} mm long.",
            plan.longest, belt.field
        )),
        // However slow the belt is, products are on each other.
        (_, Some(alone)) if pitch.is_some_and(|pitch| pitch < plan.size[0] * (1.0 - 1e-9)) => {
            let speed = if passes { belt.speed } else { rounded_down(alone) };
            let needed = Belt { speed, ..*belt }.plan(pattern).map_or(0.0, |plan| plan.span * speed);
            let needed = rounded_up(needed.max(plan.size[0]));
            let and = if passes {
                String::new()
            } else {
                format!(" and slow the belt to at most {}", shown_speed(alone))
            };
            Some(format!(
                "Put products at least {needed:.2} mm apart{and}: each is {:.2} mm long, so that marks of neighbouring products would \
                 overlap.",
                plan.size[0]
            ))
        }
        (false, Some(alone)) if plan.sections.iter().any(|section| section.too_short.is_some()) => {
            let late = plan.sections.iter().filter_map(|section| Some((section.time, section.too_short?)));
            let (time, left) = late.max_by(|a, b| (a.0 - a.1).total_cmp(&(b.0 - b.1))).unwrap_or_default();
            Some(format!(
                "{}, mark faster, or split long lines: one line takes {time:.4} s, and is in the field for {left:.4} s.",
                slow(fastest.unwrap_or(alone))
            ))
        }
        (false, Some(alone)) => Some(format!(
            "{}, or divide the drawing between {} lasers as in the sections.",
            slow(fastest.unwrap_or(alone)),
            plan.sections.len()
        )),
        (true, _) if !follows => Some(format!(
            "{} products at least {:.2} mm apart, mark faster, or use more lasers: each product takes {:.3} s and is {:.2} mm long.",
            fastest.map_or_else(|| "Put".to_owned(), |fastest| slow(fastest) + ", put"),
            rounded_up(smallest_pitch),
            plan.span,
            plan.size[0]
        )),
        (true, _) => None,
    };
    Document {
        schema: SCHEMA,
        drawing,
        size_mm: plan.size,
        ink_mm: plan.lengths[0],
        jumps_mm: plan.lengths[1],
        marking_s: plan.times[0],
        jump_s: plan.times[1],
        delay_s: plan.times[2],
        total_s: total,
        fits: passes && follows,
        fastest_belt_mm_per_s: fastest,
        smallest_pitch_mm: smallest_pitch,
        products_per_s: brought.map_or(possible, |brought| brought.min(possible)),
        lead_mm: arguments.correction_time.map(|time| belt.lead(time)),
        corrections_at_once: arguments
            .correction_time
            .zip(pitch)
            .map(|(time, pitch)| belt.corrections_at_once(time, pitch)),
        sections: plan
            .sections
            .iter()
            .map(|section| SectionReport {
                paths: section.paths.iter().map(|index| index + 1).collect(),
                along_mm: section.along,
                time_s: section.time,
            })
            .collect(),
        remedy,
    }
}

fn text(plan: &Document, arguments: &PlanArguments) -> String {
    let mut text = format!(
        "{}: {:.1} x {:.1} mm along and across a belt at {:.1} mm/s\n  \
         time          {:.3} s: lines {:.3} s ({:.1} mm), jumps {:.3} s ({:.1} mm), delays {:.3} s\n",
        plan.drawing,
        plan.size_mm[0],
        plan.size_mm[1],
        arguments.speed,
        plan.total_s,
        plan.marking_s,
        plan.ink_mm,
        plan.jump_s,
        plan.jumps_mm,
        plan.delay_s,
    );
    if let Some(fastest) = plan.fastest_belt_mm_per_s {
        text += &format!(
            "  fastest belt  {} for one laser{}, with the paths in the order along the belt (`--json` lists it)\n",
            shown_speed(fastest),
            arguments.pitch.map_or(String::new(), |pitch| format!(" and products {pitch} mm apart"))
        );
    }
    text += &format!(
        "  products      {:.3} per second; at least {:.2} mm from one to the next\n",
        plan.products_per_s, plan.smallest_pitch_mm
    );
    if let Some(lead) = plan.lead_mm {
        text += &format!("  lead          the scanner {lead:.1} mm before the laser\n");
    }
    if let Some(count) = plan.corrections_at_once.filter(|count| *count > 1.0) {
        text += &format!("  corrections   {count:.0} at the same time\n");
    }
    if plan.sections.len() > 1 {
        for (index, section) in plan.sections.iter().enumerate() {
            text += &format!(
                "  laser {:<7} {} lines from {:.2} to {:.2} mm along the belt, {:.3} s\n",
                index + 1,
                section.paths.len(),
                section.along_mm[1],
                section.along_mm[0],
                section.time_s
            );
        }
    }
    match &plan.remedy {
        Some(remedy) => text + &format!("  warning: the belt outruns the laser. {remedy}\n"),
        None => text,
    }
}
