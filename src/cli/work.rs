//! `isomark work`: a worker without a laser.

use std::path::Path;
use std::sync::Arc;

use clap::Args;

use super::fleet_place::Place;
use super::log;
use super::outcome::{Failure, Outcome, tell};
use crate::fleet::Worker;
use crate::pipeline::Pipeline;

/// The files with the name of this computer, on Linux.
const HOST_NAMES: [&str; 2] = ["/proc/sys/kernel/hostname", "/etc/hostname"];

#[derive(Debug, Args)]
pub(super) struct WorkArguments {
    #[command(flatten)]
    place: Place,
    /// The worker's name in the status of the fleet. Default: the name of this computer.
    #[arg(long, value_name = "NAME")]
    name: Option<String>,
}

pub(super) fn run(arguments: &WorkArguments) -> Outcome {
    let address = arguments.place.address()?;
    log::start(None).map_err(|error| Failure::environment(&error))?;
    let name = arguments.name.clone().unwrap_or_else(name_of_computer);
    let pipeline = Pipeline::new(None);
    let fit = move |sku: &_, task: &_, part: &_, key: &_| pipeline.fit_task(sku, task, part, key);
    let worker = Worker::new(address, &name, Arc::new(fit));
    let ending = worker.ending();
    if let Err(error) = ctrlc::set_handler(move || ending.end()) {
        tell(&format!("isomark: warning: Ctrl-C will not stop the worker cleanly: {error}"));
    }
    Ok(worker.run()?)
}

fn name_of_computer() -> String {
    let of_file = |path: &&str| fs_err::read_to_string(Path::new(path)).ok();
    let name = std::env::var("COMPUTERNAME").ok().or_else(|| HOST_NAMES.iter().find_map(of_file));
    name.unwrap_or_default().trim().to_owned()
}
