//! `isomark send`: sends drawings to a line of a fleet; and what `isomark retry --take-over` does.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use clap::Args;
use serde::Serialize;

use super::fleet_place::{Place, parse_line};
use super::named_files::file_trouble;
use super::outcome::{Exit, Failure, Outcome, print, print_json, tell};
use crate::fleet::{self, FleetError, Sending, TakeOver};
use crate::hotfolder::line::{Inputs, check_name};
use crate::hotfolder::names::{list_of, sidecar_of};
use crate::printable::on_one_line;
use crate::reason::Reason;

/// Name and version of the JSON form.
const SCHEMA: &str = "isomark.sent/1";

#[derive(Debug, Args)]
pub(super) struct SendArguments {
    #[command(flatten)]
    place: Place,
    /// The line: the name of a station in the fleet, or of a group of stations. A drawing with a list goes to one station.
    #[arg(long, value_name = "LINE", value_parser = parse_line)]
    to: String,
    /// The drawings, named as in a hot folder: can@date.dxf. The settings (can@date.toml) and the list (can@date.csv) beside a
    /// drawing are sent with it.
    #[arg(value_name = "DRAWING", required = true)]
    drawings: Vec<PathBuf>,
    /// Sends drawings again that were sent before and have not changed since.
    #[arg(long)]
    again: bool,
    /// Prints what was sent as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// What was sent.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct SentDocument {
    /// `isomark.sent/1`.
    schema: String,
    /// The line.
    line: String,
    /// Whether any station of the fleet takes jobs for the line.
    is_served: bool,
    /// The jobs, in the order of the drawings.
    jobs: Vec<SentJob>,
}

/// A drawing that was sent.
#[derive(Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
struct SentJob {
    /// The identity of the job.
    id: String,
    /// The name of the drawing.
    name: String,
    /// Whether it was not sent before.
    is_new: bool,
}

pub(super) fn run(arguments: &SendArguments) -> Outcome {
    let (address, station) = arguments.place.address_and_station()?;
    let drawings =
        arguments.drawings.iter().map(|path| read(path, arguments.again)).collect::<Result<Vec<_>, _>>()?;
    let line = &arguments.to;
    let mut document =
        SentDocument { schema: SCHEMA.into(), line: line.clone(), is_served: false, jobs: Vec::new() };
    let sent = fleet::send(&address, station.as_deref(), line, drawings, |name, sent| {
        document.is_served = sent.is_served;
        document.jobs.push(SentJob { id: sent.id, name: name.into(), is_new: sent.is_new });
    });
    if sent.is_err() {
        for SentJob { name, .. } in &document.jobs {
            tell(&format!("{} was sent before the error", on_one_line(name)));
        }
    }
    sent?;
    if arguments.json {
        let text =
            serde_json::to_string_pretty(&document).map_err(|error| Failure::environment(&error.into()))?;
        print_json(&(text + "\n"));
    } else {
        print(&words(&document));
    }
    if !document.is_served {
        warn_of_unserved(line);
    }
    Ok(())
}

fn warn_of_unserved(line: &str) {
    tell(&format!(
        "isomark: warning: no station of the fleet takes jobs for {} yet; they wait in its queue",
        on_one_line(line)
    ));
}

fn words(document: &SentDocument) -> String {
    let line = on_one_line(&document.line);
    let job = |job: &SentJob| {
        let (name, id) = (on_one_line(&job.name), fleet::short_id(&job.id));
        match job.is_new {
            true => format!("{name} is sent to {line}, as job {id}\n"),
            false => format!("{name} was sent to {line} before, as job {id}; `--again` sends it again\n"),
        }
    };
    document.jobs.iter().map(job).collect()
}

/// A drawing with what is beside it.
fn read(path: &Path, again: bool) -> Result<Sending, Failure> {
    let rejected = |reason: Reason| Failure::rejected(reason);
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    check_name(&name).map_err(rejected)?;
    let bytes_of = |path: &Path| -> Result<Vec<u8>, Failure> {
        let size = fs_err::metadata(path).map_err(|error| file_trouble("read", path, &error))?.len();
        if let Some(reason) = Inputs::limit(size) {
            return Err(rejected(reason.in_file(path.display().to_string())));
        }
        fs_err::read(path).map_err(|error| file_trouble("read", path, &error))
    };
    let beside = |path: Option<PathBuf>| -> Result<Option<Vec<u8>>, Failure> {
        path.filter(|path| path.is_file()).map(|path| bytes_of(&path)).transpose()
    };
    let metadata = fs_err::metadata(path).map_err(|error| file_trouble("read", path, &error))?;
    let at = if again { Some(SystemTime::now()) } else { metadata.modified().ok() };
    let inputs = Inputs {
        drawing: bytes_of(path)?,
        settings: beside(sidecar_of(path))?,
        list: beside(list_of(path))?,
    };
    match inputs.too_large() {
        Some(reason) => Err(rejected(reason.in_file(name))),
        None => Ok(Sending { name, at, inputs }),
    }
}

/// Puts jobs that a station has taken back into a queue, and jobs that wait into the queue of another line.
pub(super) fn take_over(place: &Place, target: &str, line: Option<&str>, is_forced: bool) -> Outcome {
    let (address, _) = place.address_and_station()?;
    let jobs = fleet::take_over(&address, target, line, is_forced)?;
    let shown = on_one_line(target);
    if jobs.is_empty() {
        let what = format!("No job that waits or that a station has taken is called {shown}.");
        let remedy = "Give the name of the station, or at least the first 8 digits of the job that `isomark fleet status` shows.";
        return Err(Failure::usage(what, remedy));
    }
    let count = |outcome| jobs.iter().filter(|job| job.outcome == outcome).count();
    for job in &jobs {
        let [name, line] = [&job.name, &job.line].map(|text| on_one_line(text));
        let id = &job.id[..job.id.len().min(12)];
        let station = job.station.as_ref().map(|station| on_one_line(station));
        let station = station.as_deref();
        let became = match (job.outcome, station) {
            (TakeOver::Moved, Some(station)) => {
                format!("is in the queue of {line} again; {station} may have marked it before")
            }
            (TakeOver::Moved, None) => format!("is in the queue of {line}; no station had taken it"),
            (TakeOver::StationAlive, _) => {
                format!("stays with {}, which is alive", station.unwrap_or_default())
            }
            (_, Some(station)) => format!("stays with {station}"),
            (_, None) => format!("waits in the queue of {line}"),
        };
        print(&format!("{name} (job {id}) {became}\n"));
    }
    if let Some(moved) = jobs.iter().find(|job| job.outcome == TakeOver::Moved && !job.is_served) {
        warn_of_unserved(&moved.line);
    }
    if let Some(job) = jobs.iter().find(|job| job.outcome == TakeOver::ListForGroup) {
        let line = line.unwrap_or(&job.line).to_owned();
        return Err(FleetError::ListForGroup { line }.into());
    }
    let staying = count(TakeOver::StationAlive);
    if staying > 0 {
        let what = format!("{staying} of {} jobs stay with a station that is alive.", jobs.len());
        let remedy = "Stop that station first, or wait until it is silent for 45 s. If it is certainly not running, add `--force`.";
        return Err(Failure::new(Exit::Environment, Reason::new("station-alive", what, remedy)));
    }
    match count(TakeOver::Waits) {
        0 => Ok(()),
        _ => Err(Failure::usage(
            "A job that no station has taken waits in its queue already.",
            "Add `--to LINE` to put it into the queue of another line.",
        )),
    }
}
