//! `isomark watch`: the hot folder.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;

use super::log;
use super::outcome::{Exit, Failure, Outcome, print, tell};
use super::progress::ProgressLine;
use super::service::ServiceManager;
use super::set::SetArguments;
use crate::cache::Cache;
use crate::config::{LiveSettings, PageSettings};
use crate::fleet::{Member, SkuFiles};
use crate::hotfolder::{self, Mode, PipelineCorrector, Pulse, StationError, StopSignal, Tally, WaitsFor};
use crate::pipeline::Pipeline;
use crate::printable::on_one_line;
use crate::reason::Reason;

#[derive(Debug, Args)]
pub(super) struct WatchArguments {
    /// The station's settings.
    station: PathBuf,
    /// Processes what is in the hot folder, reports the results, and stops. Exit code 1: something was rejected. Exit code 3:
    /// something waits because a folder, a disk or a server fails, or a drawing may not have been delivered.
    #[arg(long)]
    once: bool,
    /// Shows the station in browsers on this computer: what waits for what, what was done, what was rejected and why. Short for
    /// `--set page.address=…`; `[page]` in the station's settings opens it to other computers, with a password.
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = PageSettings::ADDRESS, conflicts_with = "once")]
    page: Option<String>,
    #[command(flatten)]
    set: SetArguments,
}

pub(super) fn run(arguments: &WatchArguments) -> Outcome {
    let mut overrides = arguments.set.of_station()?;
    if let Some(address) = &arguments.page {
        overrides.add_text(&format!("--page {address}"), "page.address", address)?;
    }
    let settings = LiveSettings::open_with(&arguments.station, overrides)?;
    log::start(settings.station().log.as_ref()).map_err(|error| Failure::environment(&error))?;
    let stop = StopSignal::default();
    let raise = stop.clone();
    if let Err(error) = ctrlc::set_handler(move || raise.raise()) {
        tell(&format!("isomark: warning: Ctrl-C will not stop the station cleanly: {error}"));
    }
    let mut pipeline = Pipeline::new(Some(Cache::new(&settings.station().folders.cache)));
    // A station that keeps running has its log instead.
    let progress = arguments.once.then(ProgressLine::start);
    if let Some(progress) = &progress {
        pipeline = pipeline.observed(progress.observer());
    }
    let mode = if arguments.once { Mode::Once } else { Mode::UntilStopped };
    let station = settings.station();
    let files = station.fleet.as_ref().map(|fleet| Arc::new(SkuFiles::new(fleet, station)));
    let settings = match &files {
        Some(files) => settings.released_by(files.clone()),
        None => settings,
    };
    // A station that runs once works alone, with the settings that it received before.
    let fleet = settings.station().fleet.clone().filter(|_| !arguments.once);
    let member = fleet.zip(files).map(|(fleet, files)| {
        let (member, station) = (Member::new(fleet, &settings.station().folders, files), settings.station());
        Arc::new(if station.page.is_some() { member.showing_fleet() } else { member })
    });
    if let Some(member) = &member {
        pipeline = pipeline.sharing(member.clone());
    }
    let mut corrector = PipelineCorrector::new(pipeline);
    if let Some(member) = &member {
        corrector = corrector.in_fleet(member.clone());
    }
    let mut manager = ServiceManager::of_this_process();
    let mut in_fleet = None;
    let tally = hotfolder::run(settings, &corrector, &stop, mode, &mut |pulse| {
        if matches!(pulse, Pulse::Ready) {
            in_fleet = member.as_ref().and_then(Member::start);
        }
        manager.hear(pulse);
    });
    drop(in_fleet);
    let tally = tally.map_err(|error| failure(&error))?;
    drop(progress);
    if !arguments.once {
        return Ok(());
    }
    print(&words(&tally));
    match tally.rejected {
        0 if tally.uncertain > 0 => {
            let drawings = if tally.uncertain == 1 { "drawing" } else { "drawings" };
            let what = format!("{} {drawings} may not have been delivered.", tally.uncertain);
            let remedy = "List them with `isomark status` and check whether the importer took them; if not, \
                          `isomark retry` delivers them again.";
            Err(Failure::new(Exit::Environment, Reason::new("drawings-uncertain", what, remedy)))
        }
        0 => match tally.waiting.iter().find(|left| left.waits_for == WaitsFor::Surroundings) {
            Some(left) => Err(Failure::new(Exit::Environment, left.reason.clone())),
            None => Ok(()),
        },
        count => {
            let drops = if count == 1 { "drop was" } else { "drops were" };
            let remedy = "Read the .reason.txt beside each of them in the rejected folder.";
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
        "{} delivered, {} {} fitted, {} rejected, {} waiting, {} incomplete\n",
        tally.delivered,
        tally.learned,
        if tally.learned == 1 { "part" } else { "parts" },
        tally.rejected,
        tally.waiting.len(),
        tally.incomplete.len()
    );
    if tally.uncertain > 0 {
        text += &format!("{} uncertain (may or may not be delivered)\n", tally.uncertain);
    }
    if tally.unchanged > 0 {
        text += &format!("{} already delivered and unchanged in import\n", tally.unchanged);
    }
    if tally.repeated > 0 {
        text += &format!("{} delivered before, not delivered again\n", tally.repeated);
    }
    for left in tally.waiting.iter().chain(&tally.incomplete) {
        text += &format!("  {}\n", on_one_line(&format!("{}: {}", left.drop, left.reason.what)));
    }
    text
}
