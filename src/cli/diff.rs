//! `isomark diff`: what changed between two drawings.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;

use super::named_files::{name_of, read_file};
use super::outcome::{Failure, Outcome, print, print_json};
use crate::diff::{DiffPath, DrawingDiff, TOLERANCE, compare, paths_of};
use crate::formats::pattern::{PatternOptions, read};

#[derive(Debug, Args)]
pub(super) struct DiffArguments {
    /// The older drawing.
    old: PathBuf,
    /// The newer drawing.
    new: PathBuf,
    /// Ignores differences up to this length, mm.
    #[arg(long, value_name = "MM", default_value_t = TOLERANCE, allow_hyphen_values = true, value_parser = parse_tolerance)]
    tolerance: f64,
    /// Prints the differences as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// Name and version of the JSON form.
const SCHEMA: &str = "isomark.diff/1";

#[derive(Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct Document<'a> {
    schema: &'static str,
    #[serde(flatten)]
    diff: &'a DrawingDiff,
}

pub(super) fn run(arguments: &DiffArguments) -> Outcome {
    let diff = compare(&paths(&arguments.old)?, &paths(&arguments.new)?, arguments.tolerance);
    if arguments.json {
        let text = serde_json::to_string_pretty(&Document { schema: SCHEMA, diff: &diff })
            .map_err(|error| Failure::environment(&error.into()))?;
        print_json(&(text + "\n"));
    } else {
        print(&format!("{diff}\n"));
    }
    Ok(())
}

fn parse_tolerance(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| "give a length above 0 in mm, as in 0.001".into())
}

fn paths(file: &Path) -> Result<Vec<DiffPath>, Failure> {
    let name = name_of(file)?;
    let reading = read(&read_file(file)?, &PatternOptions::default())
        .map_err(|error| Failure::rejected(error.reason().in_file(name)))?;
    Ok(paths_of(&reading.pattern))
}
