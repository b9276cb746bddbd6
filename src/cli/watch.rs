//! `isomark watch`: the hot folder.

use std::path::PathBuf;

use clap::Args;

use super::log;
use super::outcome::{Exit, Failure, Outcome, print, tell};
use super::service::ServiceManager;
use super::set::SetArguments;
use crate::cache::Cache;
use crate::config::LiveSettings;
use crate::hotfolder::{self, Mode, PipelineCorrector, StationError, StopSignal, Tally, WaitsFor};
use crate::pipeline::Pipeline;
use crate::printable::on_one_line;
use crate::reason::Reason;

#[derive(Debug, Args)]
pub(super) struct WatchArguments {
    /// The station's settings.
    station: PathBuf,
    /// Handles what lies in the hot folder, says what became of it, and stops; exit code 1 when something was rejected, 3
    /// when something waits because a folder, a disk or a server fails, or nobody knows whether a drawing was delivered.
    #[arg(long)]
    once: bool,
    #[command(flatten)]
    set: SetArguments,
}

pub(super) fn run(arguments: &WatchArguments) -> Outcome {
    let settings = LiveSettings::open_with(&arguments.station, arguments.set.of_station()?)?;
    log::start(settings.station().log.as_ref()).map_err(|error| Failure::environment(&error))?;
    let stop = StopSignal::default();
    let raise = stop.clone();
    if let Err(error) = ctrlc::set_handler(move || raise.raise()) {
        tell(&format!("isomark: Ctrl-C will not end the station cleanly: {error}"));
    }
    let corrector =
        PipelineCorrector::new(Pipeline::new(Some(Cache::new(&settings.station().folders.cache))));
    let mode = if arguments.once { Mode::Once } else { Mode::UntilStopped };
    let mut manager = ServiceManager::of_this_process();
    let tally = hotfolder::run(settings, &corrector, &stop, mode, &mut |pulse| manager.hear(pulse))
        .map_err(|error| failure(&error))?;
    if !arguments.once {
        return Ok(());
    }
    print(&words(&tally));
    match tally.rejected {
        0 if tally.uncertain > 0 => {
            let drawings = if tally.uncertain == 1 { "drawing" } else { "drawings" };
            let what = format!("{} {drawings} may not have been delivered.", tally.uncertain);
            let remedy = "See with `isomark status` which, and whether the importer took them; if not, \
                          `isomark retry` delivers them again.";
            Err(Failure::new(Exit::Environment, Reason::new("drawings-uncertain", what, remedy)))
        }
        0 => match tally.waiting.iter().find(|left| left.waits_for == WaitsFor::Surroundings) {
            Some(left) => Err(Failure::new(Exit::Environment, left.reason.clone())),
            None => Ok(()),
        },
        count => {
            let drops = if count == 1 { "drop was" } else { "drops were" };
            let remedy = "Read the .reason.txt beside each in the rejected folder.";
            Err(Failure::rejected(Reason::new(
                "drops-rejected",
                format!("{count} {drops} rejected."),
                remedy,
            )))
        }
    }
}

fn failure(error: &StationError) -> Failure {
    Failure::new(Exit::Environment, error.reason())
}

fn words(tally: &Tally) -> String {
    let mut text = format!(
        "{} delivered, {} {} learned, {} rejected, {} waiting, {} incomplete\n",
        tally.delivered,
        tally.learned,
        if tally.learned == 1 { "part" } else { "parts" },
        tally.rejected,
        tally.waiting.len(),
        tally.incomplete.len()
    );
    if tally.uncertain > 0 {
        text += &format!("{} uncertain whether delivered\n", tally.uncertain);
    }
    if tally.repeated > 0 {
        text += &format!("{} delivered before and not again\n", tally.repeated);
    }
    for left in tally.waiting.iter().chain(&tally.incomplete) {
        text += &format!("  {}\n", on_one_line(&format!("{}: {}", left.drop, left.reason.what)));
    }
    text
}
