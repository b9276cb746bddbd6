//! The commands of the program.

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::printable::on_one_line;
use crate::reason::Reason;

mod cache;
mod calibrate;
mod correct;
mod demo;
mod diff;
mod evaluate;
mod explain;
mod fleet;
mod fleet_place;
mod release;
mod fleet_jobs;
mod send;
mod work;
mod inspect;
mod schema;
mod job;
mod list;
mod log;
mod marked_line;
mod plan;
mod rotary;
mod service;
mod set;
mod shell;
mod watch;
mod status;
mod station_edit;
mod register;
mod check;
mod content;
mod named_files;
mod options;
mod outcome;
mod progress;

pub use outcome::Exit;
use outcome::{print_json, tell};

/// Bends flat drawings so that a galvo laser marks true lengths on curved parts.
#[derive(Debug, Parser)]
#[command(name = "isomark", version, about, max_term_width = 100)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Corrects one drawing for one part.
    Correct(Box<correct::CorrectArguments>),
    /// Compares all methods for one drawing on one part, side by side.
    Evaluate(Box<evaluate::EvaluateArguments>),
    /// Runs a station: corrects the drawings that are dropped into its hot folder.
    Watch(watch::WatchArguments),
    /// Shows what a station did, what waits and why, and what was rejected last.
    Status(status::StatusArguments),
    /// Retries drops of a station: those that wait, were rejected, or are outdated.
    Retry(status::RetryArguments),
    /// Checks the settings of a station and of its SKUs.
    Check(check::CheckArguments),
    /// Sets up the folders and annotated settings of a station.
    Init(check::InitArguments),
    /// Measures the lens: writes the drawing to mark, and finds the lens distances from what was measured on it.
    Calibrate(calibrate::CalibrateArguments),
    /// Finds where the part stands under the laser, and draws its outline for a plate that holds it.
    Register(Box<register::RegisterArguments>),
    /// Shows what isomark reads in a part or a drawing, and what it assumes.
    Inspect(inspect::InspectArguments),
    /// Describes what changed between two drawings.
    Diff(diff::DiffArguments),
    /// Plans a production line: how long a drawing takes on a belt, and how fast the belt may move.
    Plan(plan::PlanArguments),
    /// Explains a code of a reason or notice: what it means and what to do.
    Explain(explain::ExplainArguments),
    /// Prints the JSON Schema of a document that isomark writes.
    Schema(schema::SchemaArguments),
    /// Lists, verifies and removes fitted surfaces.
    Cache(cache::CacheArguments),
    /// Sets up, checks and shows a fleet: stations that share what they know through a PostgreSQL database.
    Fleet(fleet::FleetArguments),
    /// Sends drawings to a line of a fleet, as if they were dropped at one of its stations.
    Send(send::SendArguments),
    /// Fits heavy parts and scans for the stations of a fleet, on a computer without a laser. Ctrl-C ends it.
    Work(work::WorkArguments),
    /// Sets up a station with sample parts and drawings, runs it once, and shows the results.
    Demo(demo::DemoArguments),
}

/// Runs the program on its command line.
pub fn main() -> ExitCode {
    // A closed pipe (`isomark … | head`) is no error: writes to it just end.
    let line = match CommandLine::try_parse() {
        Ok(line) => line,
        Err(error) => {
            let exit = if error.use_stderr() { Exit::Usage } else { Exit::Done };
            if exit == Exit::Usage && wants_json(std::env::args_os()) {
                print_json(&usage(&error.to_string()).to_json(None).unwrap_or_default());
            }
            tell_mistake(&error);
            return ExitCode::from(exit as u8);
        }
    };
    let (outcome, json) = match line.command {
        Command::Correct(arguments) => (correct::run(&arguments), arguments.json),
        Command::Evaluate(arguments) => (evaluate::run(&arguments), arguments.json),
        Command::Watch(arguments) => (watch::run(&arguments), false),
        Command::Status(arguments) => (status::run(&arguments), arguments.json),
        Command::Retry(arguments) => (status::retry(&arguments), false),
        Command::Check(arguments) => (check::run(&arguments), false),
        Command::Init(arguments) => (check::init(&arguments), false),
        Command::Calibrate(arguments) => (calibrate::run(&arguments), arguments.json()),
        Command::Register(arguments) => (register::run(&arguments), arguments.json),
        Command::Inspect(arguments) => (inspect::run(&arguments), arguments.json),
        Command::Diff(arguments) => (diff::run(&arguments), arguments.json),
        Command::Plan(arguments) => (plan::run(&arguments), arguments.json),
        Command::Explain(arguments) => (explain::run(&arguments), arguments.json),
        Command::Schema(arguments) => (schema::run(&arguments), false),
        Command::Cache(arguments) => (cache::run(&arguments), false),
        Command::Fleet(arguments) => (fleet::run(&arguments), arguments.json()),
        Command::Send(arguments) => (send::run(&arguments), arguments.json),
        Command::Work(arguments) => (work::run(&arguments), false),
        Command::Demo(arguments) => (demo::run(&arguments), false),
    };
    match outcome {
        Ok(()) => ExitCode::from(Exit::Done as u8),
        Err(failure) => {
            if json {
                // The text below names the failure even without its JSON form.
                print_json(&failure.reason.to_json(None).unwrap_or_default());
            }
            failure.tell();
            ExitCode::from(failure.exit as u8)
        }
    }
}

/// Whether a command line that cannot be parsed as a whole asks for JSON.
fn wants_json(arguments: impl Iterator<Item = OsString>) -> bool {
    arguments.skip(1).take_while(|argument| argument != "--").any(|argument| argument == "--json")
}

/// What is wrong with a command line, from the text for people: the mistake, then tips and the usage.
fn usage(text: &str) -> Reason {
    let mut parts = text.split("\n\n").map(|part| part.split_whitespace().collect::<Vec<_>>().join(" "));
    let what = parts.next().unwrap_or_default();
    let what = what.strip_prefix("error: ").unwrap_or(&what).to_owned();
    let tip = parts.find_map(|part| part.strip_prefix("tip: ").map(str::to_owned));
    Reason::new("usage", what, tip.unwrap_or_else(|| "See `isomark help`.".into()))
}

/// Writes what is wrong with the command line, or its help. A typed word may be a file's name that the shell put in.
fn tell_mistake(error: &clap::Error) {
    let typed: Vec<String> =
        std::env::args_os().map(|argument| on_one_line(&argument.to_string_lossy())).collect();
    match CommandLine::try_parse_from(typed) {
        Err(error) => {
            let _ = error.print();
        }
        Ok(_) => tell(error.to_string().trim_end()),
    }
}

#[cfg(test)]
mod tests;
