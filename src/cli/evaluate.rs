//! `isomark evaluate`: every method for one drawing on one part, side by side.

use std::fmt::Write;

use clap::Args;

use super::job::{Job, JobArguments};
use super::named_files::name_of;
use super::outcome::{Failure, Outcome, print, print_json};
use super::set::useless_to_a_comparison;
use crate::config::{Method, Overrides};
use crate::pipeline::{Evaluation, EvaluationRow, PatternInput};
use crate::printable::on_one_line;

#[derive(Debug, Args)]
#[command(
    override_usage = "isomark evaluate [OPTIONS] <PART> <DRAWING>\n       isomark evaluate [OPTIONS] --sku <SKU> <DRAWING>\n       isomark evaluate [OPTIONS] --cylinder <D,LENGTH> <DRAWING>"
)]
pub(super) struct EvaluateArguments {
    #[command(flatten)]
    job: JobArguments,
    /// The methods to compare: all (default), or names as in `correct --method`.
    #[arg(long, value_name = "A,B", value_delimiter = ',', value_parser = parse_methods, default_value = "all")]
    method: Vec<Methods>,
    /// Prints the results as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Debug, Clone, Copy)]
enum Methods {
    All,
    One(Method),
}

fn parse_methods(text: &str) -> Result<Methods, crate::config::UnknownChoice> {
    if text == "all" { Ok(Methods::All) } else { text.parse().map(Methods::One) }
}

pub(super) fn run(arguments: &EvaluateArguments) -> Outcome {
    let Job { sku, settings, pipeline, learned, pattern, drawing, progress, .. } =
        arguments.job.prepare(Overrides::default(), useless_to_a_comparison)?;
    let asked = |method: &Method| {
        arguments.method.iter().any(|named| match named {
            // `auto` always chooses one of the others.
            Methods::All => *method != Method::Auto,
            Methods::One(named) => named == method,
        })
    };
    let methods: Vec<Method> = Method::ALL.iter().copied().filter(asked).collect();
    let input = PatternInput { name: &name_of(pattern)?, bytes: &drawing, previous: None };
    let evaluation = pipeline.evaluate(&sku, &learned, input, &settings, &methods)?;
    drop(progress);
    let refused: Vec<_> = evaluation.rows.iter().filter_map(|row| row.reason.as_ref()).collect();
    let nothing = refused.first().filter(|_| refused.len() == evaluation.rows.len());
    if let Some(reason) = nothing {
        return Err(Failure::rejected((*reason).clone()));
    }
    if arguments.json {
        let json =
            serde_json::to_string_pretty(&evaluation).map_err(|error| Failure::environment(&error.into()))?;
        print_json(&(json + "\n"));
    } else {
        print(&table(&evaluation));
    }
    Ok(())
}

/// What the last line of the table means.
const FLOOR: &str = "
`floor` is the least that was found for each value alone: an estimate, not a proven bound. Where a part is curved in two
directions, no map reaches all three at once. The rows `only ...` lower one value, and show what that costs in the others.
";

fn table(evaluation: &Evaluation) -> String {
    let Evaluation { pattern, part, size_mm: [width, height], length_mm, area_mm2, .. } = evaluation;
    let (pattern, part) = (on_one_line(pattern), on_one_line(&part.file));
    let mut text = format!(
        "{pattern} ({width:.1} x {height:.1} mm, {length_mm:.1} mm of lines, {area_mm2:.1} mm2) on {part}\n\n"
    );
    let label = |row: &EvaluationRow| match row.variant.as_str() {
        "" => row.method.clone(),
        variant => format!("{}, {variant}", row.method),
    };
    let widest = evaluation.rows.iter().map(|row| label(row).len()).max().unwrap_or(0).max("method".len());
    let heads = ["e_l mm", "e_a mm2", "e_l %", "stretch %", "angle deg", "time ms"];
    let _ = write!(text, "{:<widest$}", "method");
    heads.iter().for_each(|head| text += &format!("  {head:>9}"));
    text.push('\n');
    for row in &evaluation.rows {
        let _ = write!(text, "{:<widest$}", label(row));
        if let Some(quality) = &row.quality {
            let _ = write!(
                text,
                "  {:>9.3}  {:>9.3}  {:>9.3}  {:>9.2}  {:>9.2}  {:>9.1}",
                quality.length_error_mm,
                quality.area_error_mm2,
                quality.length_error_relative * 100.0,
                quality.max_stretch * 100.0,
                quality.max_angle_error_deg,
                row.map_ms,
            );
        }
        let words = row.reason.as_ref().map(|reason| reason.what.as_str()).or(row.note.as_deref());
        if let Some(words) = words {
            let _ = write!(text, "  {}", on_one_line(words));
        }
        text.push('\n');
    }
    if let Some(floor) = &evaluation.floor {
        let none = "-";
        let _ = writeln!(
            text,
            "{:<widest$}  {:>9.3}  {:>9.3}  {none:>9}  {none:>9}  {:>9.2}  {none:>9}",
            "floor", floor.length_error_mm, floor.area_error_mm2, floor.max_angle_error_deg,
        );
        text += FLOOR;
    }
    text
}
