//! `isomark watch`: the hot folder.

use std::io::IsTerminal;
use std::path::PathBuf;

use clap::Args;
use tracing_subscriber::EnvFilter;

use super::{Exit, Failure, Outcome, print, tell};
use crate::cache::Cache;
use crate::config::LiveSettings;
use crate::hotfolder::{self, Mode, PipelineCorrector, StationError, StopSignal, Tally};
use crate::pipeline::Pipeline;

#[derive(Debug, Args)]
pub(super) struct WatchArguments {
    /// The station's settings.
    station: PathBuf,
    /// Handles what lies in the hot folder, says what became of it, and stops.
    #[arg(long)]
    once: bool,
}

pub(super) fn run(arguments: &WatchArguments) -> Outcome {
    start_log();
    let settings = LiveSettings::open(&arguments.station)?;
    let stop = StopSignal::default();
    let raise = stop.clone();
    if let Err(error) = ctrlc::set_handler(move || raise.raise()) {
        tell(&format!("isomark: Ctrl-C will not end the station cleanly: {error}"));
    }
    let corrector =
        PipelineCorrector::new(Pipeline::new(Some(Cache::new(&settings.station().folders.cache))));
    let mode = if arguments.once { Mode::Once } else { Mode::UntilStopped };
    let tally =
        hotfolder::run(settings, &corrector, &stop, mode, &mut |_| {}).map_err(|error| failure(&error))?;
    if arguments.once {
        print(&words(&tally));
    }
    Ok(())
}

/// Lines for people on standard error; `RUST_LOG` chooses others.
pub(super) fn start_log() {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("isomark=info"));
    // A log that cannot be written (its disk is full, its reader went) must not end the station.
    let lines = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_target(false)
        .with_ansi(
            std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|set| set.is_empty()),
        )
        .with_writer(std::io::stderr)
        .log_internal_errors(false);
    // A second log in one process is a test's; the first one goes on.
    let _ = lines.try_init();
}

fn failure(error: &StationError) -> Failure {
    Failure { exit: Exit::Environment, reason: error.reason() }
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
    for left in tally.waiting.iter().chain(&tally.incomplete) {
        text += &format!("  {}: {}\n", left.drop, left.reason.what);
    }
    text
}
