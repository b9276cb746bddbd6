//! `isomark status` and `isomark retry`: shows and controls a running station from another terminal.

use std::io::{ErrorKind, Write};
use std::path::{Component, Path, PathBuf};
use std::time::SystemTime;

use clap::Args;

use super::fleet_place::{Place, parse_line};
use super::options::parse_sku;
use super::outcome::{Exit, Failure, Outcome, print, print_json, shown, tell};
use super::send::take_over;
use super::set::SetArguments;
use crate::config::{FolderPaths, Sku, Station, fold};
use crate::files::temporary;
use crate::hotfolder::status::{
    Kept, Listed, OutdatedDrawing, State, Status, UncertainDrawing, UnderWay, Waits,
};
use crate::hotfolder::{
    AS_ITS_USER, Holder, Request, StationLock, count_rejected, is_rejected, return_rejected,
};
use crate::printable::on_one_line;
use crate::reason::Reason;

/// What is written to find out whether a disk is full, bytes: more than a file system keeps beside the name of a file.
const ROOM: usize = 64 << 10;

#[derive(Debug, Args)]
pub(super) struct StatusArguments {
    /// The station's settings.
    station: PathBuf,
    /// Prints the status as JSON.
    #[arg(long)]
    pub(super) json: bool,
    #[command(flatten)]
    set: SetArguments,
}

#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("forced").args(["take_over", "drops"]))]
pub(super) struct RetryArguments {
    /// The station's settings.
    #[arg(required_unless_present = "outdated")]
    station: Option<PathBuf>,
    /// Drops, by their names in the hot folder: rejected ones are put back there, uncertain drawings are delivered again, and
    /// waiting ones are tried now. Without a name, everything that waits is tried now.
    #[arg(value_name = "DROP")]
    drops: Vec<String>,
    /// Puts all rejected drops back into the hot folder.
    #[arg(long, conflicts_with = "drops")]
    rejected: bool,
    /// Delivers all uncertain drawings again: those that may or may not have been delivered.
    #[arg(long, conflicts_with_all = ["drops", "rejected"])]
    uncertain: bool,
    /// Corrects delivered drawings again if their part or settings changed; of one SKU, or of all.
    #[arg(long, value_name = "SKU", num_args = 0..=1, conflicts_with_all = ["drops", "rejected", "uncertain"])]
    outdated: Option<Option<String>>,
    /// Returns jobs to their line's queue when the station that took them will not finish them: the job with this number, or all
    /// jobs of this station. Check at the laser first: they may have been marked. With `--to`, also puts a job that no station has
    /// taken into the queue of another line. Give the URL of the fleet, or the settings of any of its stations.
    #[arg(long, value_name = "JOB|STATION", conflicts_with_all = ["drops", "rejected", "uncertain", "outdated"])]
    take_over: Option<String>,
    /// With `--take-over`: into the queue of this line.
    #[arg(long, value_name = "LINE", requires = "take_over", value_parser = parse_line)]
    to: Option<String>,
    /// With `--take-over`: also if the station gave a sign of life in the last 45 s. With a rejected drop: also if its job was given to
    /// another station, which may have marked it.
    #[arg(long, requires = "forced")]
    force: bool,
    /// With `--take-over`: reads the password for the database from the first line of this file.
    #[arg(long, value_name = "FILE", requires = "take_over")]
    password_file: Option<PathBuf>,
    /// With `--take-over`: checks the server with the certificates (PEM) of the authorities in this file.
    #[arg(long, value_name = "FILE", requires = "take_over")]
    certificate: Option<PathBuf>,
    #[command(flatten)]
    set: SetArguments,
}

/// The folders of a station. While its file is wrong it runs on with its previous settings, and still answers.
fn folders_of(file: &Path, set: &SetArguments) -> Result<FolderPaths, Failure> {
    let overrides = set.of_station()?;
    match (Station::load_with(file, &overrides), FolderPaths::of_broken(file, &overrides)) {
        (Ok(station), _) => Ok(station.folders),
        (Err(error), Some(folders)) => {
            tell(&format!("isomark: warning: {}", error.reason()));
            Ok(folders)
        }
        (Err(error), None) => Err(error.into()),
    }
}

/// The last status of the station, if it was ever started, and the process that runs it.
fn status_of(folders: &FolderPaths) -> Result<(Option<Status>, Option<Holder>), Failure> {
    let holder = StationLock::holder(&folders.state).map_err(|error| Failure::environment(&error))?;
    let status = Status::read(&folders.state).map_err(|error| Failure::environment(&error))?;
    Ok((status.map(|status| status.seen(holder.is_some(), SystemTime::now())), holder))
}

pub(super) fn run(arguments: &StatusArguments) -> Outcome {
    let folders = folders_of(&arguments.station, &arguments.set)?;
    let (Some(mut status), holder) = status_of(&folders)? else {
        let what = format!("The station of {} was never started.", arguments.station.display());
        return Err(Failure::usage(what, "Start it with `isomark watch`."));
    };
    status.in_rejected = count_rejected(&folders.rejected).ok();
    if status.running {
        status.troubles.extend(full_disks(&folders));
    }
    let import = folders.import_trouble().map(|reason| reason.on_one_line());
    status.troubles.extend(import.filter(|trouble| !status.troubles.contains(trouble)));
    if arguments.json {
        let text =
            serde_json::to_string_pretty(&status).map_err(|error| Failure::environment(&error.into()))?;
        print_json(&(text + "\n"));
    } else {
        print(&words(&status, holder.as_ref(), &folders));
    }
    Ok(())
}

/// The station's file, and the SKU whose outdated drawings are meant. What follows `--outdated` is the file if none is named
/// before it.
fn station_and_outdated(arguments: &RetryArguments) -> Result<(&Path, Option<Option<&str>>), Failure> {
    let outdated = arguments.outdated.as_ref().map(Option::as_deref);
    match (&arguments.station, outdated) {
        (Some(station), outdated) => Ok((station, outdated)),
        (None, Some(Some(file))) if Path::new(file).is_file() || file.ends_with(".toml") => {
            Ok((Path::new(file), Some(None)))
        }
        (None, _) => Err(Failure::usage(
            "The command line names no station.",
            "Name the station's file first: `isomark retry STATION --outdated SKU`.",
        )),
    }
}

/// The folders whose disk is full. The station cannot write that into its status, because its status would be a file there.
fn full_disks(folders: &FolderPaths) -> Vec<String> {
    let FolderPaths { state, archive, reports, .. } = folders;
    let is_full = |folder: &&PathBuf| {
        let written = temporary(folder).and_then(|mut file| {
            file.write_all(&[0; ROOM])?;
            file.as_file().sync_all()
        });
        let kind = written.err().map(|error| error.kind());
        matches!(kind, Some(ErrorKind::StorageFull | ErrorKind::QuotaExceeded))
    };
    let full = [("state", state), ("archive", archive), ("reports", reports)];
    let full = full.into_iter().filter(|(_, folder)| is_full(folder));
    full.map(|(purpose, folder)| {
        format!("the disk of the {purpose} folder {} is full: free some space", folder.display())
    })
    .collect()
}

pub(super) fn retry(arguments: &RetryArguments) -> Outcome {
    let (station, outdated) = station_and_outdated(arguments)?;
    if let Some(target) = &arguments.take_over {
        let place = Place {
            fleet: station.to_string_lossy().into_owned(),
            password_file: arguments.password_file.clone(),
            certificate: arguments.certificate.clone(),
        };
        return take_over(&place, target, arguments.to.as_deref(), arguments.force);
    }
    let folders = folders_of(station, &arguments.set)?;
    let state = &folders.state;
    let runs = StationLock::holder(state).map_err(|error| Failure::environment(&error))?.is_some();
    let then = if runs { "" } else { " when the station is started" };
    let (known, waiting) = match arguments.drops.is_empty() {
        true => Default::default(),
        false => status_of(&folders)
            .ok()
            .and_then(|(status, _)| status)
            .map(|status| (status.uncertain, status.waiting))
            .unwrap_or_default(),
    };
    let (mut drops, mut is_asked) = (Vec::new(), false);
    for asked in &arguments.drops {
        let name = match uncertain_name(&known, asked) {
            Some(name) => name,
            None if waits(&waiting, &folders, asked) => {
                leave(&Request::Waiting, state)?;
                print(&format!(
                    "{} waits; everything that waits will be tried again{then}\n",
                    on_one_line(asked)
                ));
                is_asked = true;
                continue;
            }
            // The station may know more of them than its status lists.
            None if known.count > known.first.len() && !is_rejected(&folders.rejected, asked) => asked,
            None => {
                drops.push(asked.clone());
                continue;
            }
        };
        leave(&Request::Uncertain(Some(name.to_owned())), state)?;
        print(&format!("{} will be delivered again{then}\n", on_one_line(name)));
        is_asked = true;
    }
    if drops.is_empty() && is_asked {
        return Ok(());
    }
    if arguments.rejected || !drops.is_empty() {
        let wanted = (!arguments.rejected).then_some(drops.as_slice());
        let (returned, mut trouble) = return_rejected(&folders, wanted, arguments.force)
            .map_err(|error| Failure::environment(&error))?;
        if returned.is_empty() && trouble.is_empty() {
            print("no drop is rejected\n");
        }
        print(
            &returned
                .iter()
                .map(|drop| format!("{} is back in the hot folder\n", on_one_line(drop)))
                .collect::<String>(),
        );
        let Some(last) = trouble.pop() else { return Ok(()) };
        trouble.iter().for_each(|reason| tell(&format!("isomark: {reason}")));
        return Err(Failure::new(Exit::Environment, last));
    }
    let request = match outdated {
        Some(sku) => Request::Outdated(sku.map(parse_sku).transpose()?),
        None if arguments.uncertain => Request::Uncertain(None),
        None => Request::Waiting,
    };
    // Read first: the station may answer the request at once. Left in any case: the station may know more by then.
    let status = status_of(&folders).ok().and_then(|(status, _)| status);
    leave(&request, state)?;
    if let Some(nothing) = status.as_ref().and_then(|status| nothing_to_do(&request, status, runs)) {
        print(&nothing);
        return Ok(());
    }
    if matches!(request, Request::Waiting) && status.is_some_and(|status| status.uncertain.count > 0) {
        tell(
            "isomark: warning: this does not deliver uncertain drawings again: name them, or use `--uncertain`",
        );
    }
    print(&match request {
        Request::Waiting => format!("everything that waits will be tried again{then}\n"),
        Request::Outdated(_) => format!("outdated drawings will be corrected again{then}\n"),
        Request::Uncertain(_) => format!("uncertain drawings will be delivered again{then}\n"),
    });
    Ok(())
}

fn leave(request: &Request, state: &Path) -> Outcome {
    request.leave(state).map_err(|error| match error.kind() {
        ErrorKind::PermissionDenied => {
            let reason = Reason::new("environment", format!("{error}."), AS_ITS_USER);
            Failure::new(Exit::Environment, reason)
        }
        _ => Failure::environment(&error),
    })
}

/// The station's name of the uncertain drawing that `asked` means: the drawing's name or its drop's, in any spelling, or as a
/// terminal shows it.
fn uncertain_name<'a>(known: &'a Listed<UncertainDrawing>, asked: &str) -> Option<&'a str> {
    let is_meant = |name: &String| fold(name) == fold(asked) || fold(&on_one_line(name)) == fold(asked);
    let drawing = known.first.iter().find(|drawing| is_meant(&drawing.name) || is_meant(&drawing.drop));
    drawing.map(|drawing| &*drawing.name)
}

/// Whether the drop waits: the station lists it, or it is in the hot folder and was not rejected.
fn waits(waiting: &Listed<Waits>, folders: &FolderPaths, asked: &str) -> bool {
    let is_listed = |waits: &Waits| fold(&waits.drop) == fold(asked) || on_one_line(&waits.drop) == asked;
    let is_inside = Path::new(asked).components().all(|part| matches!(part, Component::Normal(_)));
    let is_there =
        || is_inside && folders.hot.join(asked).is_file() && !is_rejected(&folders.rejected, asked);
    waiting.first.iter().any(is_listed) || is_there()
}

/// Why a request has no effect, if the station's status shows that.
fn nothing_to_do(request: &Request, status: &Status, runs: bool) -> Option<String> {
    match request {
        // A stopped station checks its drawings when it starts.
        Request::Outdated(sku) if runs && !may_be_outdated(status, sku.as_ref()) => {
            let whose = sku.as_ref().map_or("".into(), |sku| format!(" of {sku}"));
            Some(format!(
                "no delivered drawing{whose} is known to be outdated; `isomark status` lists outdated drawings\n"
            ))
        }
        // After a crash, the next start may find uncertain deliveries.
        Request::Uncertain(None)
            if status.uncertain.count == 0 && (runs || status.state == State::Stopped) =>
        {
            Some("no delivery is uncertain\n".into())
        }
        _ => None,
    }
}

/// Whether the station may know an outdated drawing of the SKU, or any; its status lists only the first ones.
fn may_be_outdated(status: &Status, sku: Option<&Sku>) -> bool {
    let Listed { count, first } = &status.outdated;
    let is_asked =
        |drawing: &OutdatedDrawing| sku.is_none_or(|sku| drawing.sku.parse::<Sku>().as_ref() == Ok(sku));
    *count > first.len() || first.iter().any(is_asked)
}

fn words(status: &Status, holder: Option<&Holder>, folders: &FolderPaths) -> String {
    let mut text = match holder {
        Some(holder) => format!("{}: running, {}\n", status.station, on_one_line(&holder.to_string())),
        None if status.state == State::EndedSilently => {
            format!("{}: not running; it ended unexpectedly after {}\n", status.station, status.at)
        }
        None => format!("{}: not running; stopped at {}\n", status.station, status.at),
    };
    if status.state == State::Silent {
        text += &format!(
            "no status since {}: it hangs, or cannot write its state folder; read its log, or start it again\n",
            status.at
        );
    }
    text.extend(status.troubles.iter().map(|trouble| format!("problem: {}\n", on_one_line(trouble))));
    let done = &status.done;
    text += &format!(
        "since {}: {} delivered, {} rejected, {} fitted; in the last hour {} delivered, {} rejected\n",
        status.since,
        done.delivered,
        done.rejected,
        if done.learned == 1 { "1 part".into() } else { format!("{} parts", done.learned) },
        done.delivered_last_hour,
        done.rejected_last_hour
    );
    if let Some(count) = status.in_rejected.filter(|count| *count > 0) {
        let drops = if count == 1 { "drop is" } else { "drops are" };
        text += &format!("{count} rejected {drops} in {}\n", shown(&folders.rejected));
    }
    if let Some(kept) = &status.kept {
        text += &kept_words(kept);
    }
    if !status.under_way.is_empty() {
        text += match status.state {
            State::Running | State::Silent => "working on\n",
            State::Stopped | State::EndedSilently => "was working on, and continues when it is started\n",
        };
        let line = |job: &UnderWay| match status.state {
            State::Running | State::Silent => {
                format!("  {}, for {:.1} s\n", on_one_line(&job.drop), job.for_s)
            }
            State::Stopped | State::EndedSilently => format!("  {}\n", on_one_line(&job.drop)),
        };
        let lines = status.under_way.iter().map(line);
        text.extend(lines);
    }
    let waits = |waits: &Waits| format!("{}: {}", waits.drop, waits.reason.on_one_line());
    text += &list("waiting", &status.waiting, waits);
    text += &list("being copied, or queued", &status.incomplete, |waits| {
        format!("{}: {}", waits.drop, waits.reason.what)
    });
    if status.uncertain.count > 0 {
        text += &list("uncertain (may or may not be delivered)", &status.uncertain, |drawing| {
            format!("{}, interrupted before {}", on_one_line(&drawing.name), drawing.at)
        });
        text += "  check whether the importer took them; `isomark retry STATION NAME` delivers one again, \
                 `--uncertain` all\n";
    }
    text += &list("outdated by a new part or new settings", &status.outdated, |drawing| drawing.name.clone());
    if !status.rejections.is_empty() {
        text += "rejected last\n";
        let line = |rejection: &crate::hotfolder::status::Rejection| {
            let drop = on_one_line(&rejection.drop);
            format!("  {} {drop}: {}\n", rejection.at, rejection.reason.on_one_line())
        };
        text.extend(status.rejections.iter().map(line));
    }
    text
}

/// How long files are kept, and what was removed last.
fn kept_words(kept: &Kept) -> String {
    let for_days = |days: Option<f64>| match days {
        Some(days) => format!("for {days} days"),
        None => "without limit".into(),
    };
    let limit = kept.max_bytes.map_or(String::new(), |bytes| format!(", at most {}", gigabytes(bytes)));
    let mut text = format!(
        "kept: {} in archive, rejected and reports{limit}; originals {}, rejected drops {}, reports {}\n",
        gigabytes(kept.bytes),
        for_days(kept.archive_days),
        for_days(kept.rejected_days),
        for_days(kept.reports_days),
    );
    if kept.removed > 0 {
        text += &format!("  removed {} ({}) at {}\n", kept.removed, gigabytes(kept.removed_bytes), kept.at);
    }
    text
}

fn gigabytes(bytes: u64) -> String {
    format!("{:.3} GB", bytes as f64 / 1e9)
}

fn list<T>(title: &str, listed: &Listed<T>, words: impl Fn(&T) -> String) -> String {
    if listed.count == 0 {
        return String::new();
    }
    let mut text = format!("{title}: {}\n", listed.count);
    text.extend(listed.first.iter().map(|entry| format!("  {}\n", on_one_line(&words(entry)))));
    let more = listed.count - listed.first.len();
    if more > 0 {
        text += &format!("  and {more} more\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uncertain_drawings_are_called_by_their_names_however_they_are_spelled() {
        let drawing = |name: &str, drop: &str| UncertainDrawing {
            name: name.into(),
            drop: drop.into(),
            sku: "can".into(),
            at: String::new(),
        };
        let first = vec![drawing("Can@M\u{fc}g.dxf", "can/M\u{fc}g.png"), drawing("a\u{202e}b.dxf", "c.dxf")];
        let known = Listed { count: 2, first };
        for (asked, name) in [
            ("can@mu\u{308}g.DXF", Some("Can@M\u{fc}g.dxf")),
            ("CAN/m\u{fc}g.png", Some("Can@M\u{fc}g.dxf")),
            ("a\\u{202e}b.dxf", Some("a\u{202e}b.dxf")),
            ("other.dxf", None),
        ] {
            assert_eq!(uncertain_name(&known, asked), name, "{asked}");
        }
    }
}
