//! `isomark fleet`: sets up, checks and shows a fleet.

use clap::{Args, Subcommand};

use super::fleet_jobs::words_of_jobs;
use super::fleet_place::Place;
use super::outcome::{Exit, Failure, Outcome, print, print_json, tell};
use super::release;
use crate::fleet::{
    self, Address, FleetStatus, Prune, SharedFits, SkuSettings, SkuSettingsState, StationSettings,
    StationState, WorkerRow,
};
use crate::printable::on_one_line;

/// SKUs that are named for each station whose settings are not as released.
const SETTINGS: usize = 5;

#[derive(Debug, Args)]
pub(super) struct FleetArguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Makes or upgrades the tables and roles of a fleet. Log in as the owner of the database, who may create roles. Safe to run
    /// twice.
    Init(Place),
    /// Checks the connection, the server, its clock, the tables and the rights of the login; with the settings of a station, also that
    /// the login may be this station.
    Check(Place),
    /// Shows every station of a fleet.
    Status {
        #[command(flatten)]
        place: Place,
        /// Prints the status as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Releases the settings of a SKU to the stations of a fleet, which write them into their folder `skus`.
    Release(release::ReleaseArguments),
    /// Removes fits that stations share (they make them again when they are needed), jobs that have ended, or a station that no longer exists.
    #[command(group = clap::ArgGroup::new("which").required(true).multiple(true))]
    Prune {
        #[command(flatten)]
        place: Place,
        /// Removes fits that no station used for this number of days, unless they are of the current part of a SKU.
        #[arg(long, value_name = "DAYS", group = "which", allow_hyphen_values = true, value_parser = parse_amount)]
        unused_days: Option<f64>,
        /// Removes the fits that were used longest ago until all together have this size, unless they are of the current part of a SKU.
        #[arg(long, value_name = "GB", group = "which", allow_hyphen_values = true, value_parser = parse_amount)]
        max_gb: Option<f64>,
        /// Removes the fit with this key.
        #[arg(long, value_name = "KEY", group = "which")]
        fit: Option<String>,
        /// Removes jobs for other lines that ended this number of days ago.
        #[arg(long, value_name = "DAYS", group = "which", allow_hyphen_values = true, value_parser = parse_amount)]
        ended_days: Option<f64>,
        /// Removes a station that no longer exists. Its name is then free for another login.
        #[arg(long, value_name = "NAME", group = "which")]
        station: Option<String>,
    },
}

fn parse_amount(text: &str) -> Result<f64, String> {
    let amount = text.parse::<f64>().ok().filter(|amount| (0.0..=1e6).contains(amount));
    amount.ok_or_else(|| "give a number from 0 to 1000000".into())
}

impl FleetArguments {
    pub(super) fn json(&self) -> bool {
        match &self.verb {
            Verb::Status { json, .. } => *json,
            Verb::Release(arguments) => arguments.json,
            _ => false,
        }
    }
}

pub(super) fn run(arguments: &FleetArguments) -> Outcome {
    match &arguments.verb {
        Verb::Init(place) => init(&place.address()?),
        Verb::Check(place) => {
            let (address, station) = place.address_and_station()?;
            check(&address, station.as_deref())
        }
        Verb::Status { place, json } => status(&place.address()?, *json),
        Verb::Release(arguments) => release::run(arguments),
        Verb::Prune { place, unused_days, max_gb, fit, ended_days, station } => {
            let max_bytes = max_gb.map(|gigabytes| (gigabytes * 1e9) as i64);
            let which = Prune {
                unused_days: *unused_days,
                max_bytes,
                key: fit.clone(),
                ended_days: *ended_days,
                station: station.clone(),
            };
            let pruned = fleet::prune(&place.address()?, &which)?;
            if let Some(station) = station {
                tell(&format!("{} removed", on_one_line(station)));
            }
            if ended_days.is_some() {
                tell(&format!("{} removed", count_of(pruned.jobs, "job")));
            }
            if unused_days.is_some() || max_bytes.is_some() || fit.is_some() {
                tell(&format!("{} removed; {} left", count_of(pruned.fits, "fit"), shown_fits(pruned.left)));
                if max_bytes.is_some_and(|most| pruned.left.bytes > most) {
                    tell("the fits that are left are of current parts, which stay");
                }
            }
            Ok(())
        }
    }
}

fn init(address: &Address) -> Outcome {
    let done = fleet::init(address)?;
    match (done.from, done.to) {
        (0, to) => tell(&format!("{address}: made the tables of version {to} and the roles")),
        (from, to) if from == to => tell(&format!("{address}: the tables have version {to} already")),
        (from, to) => tell(&format!("{address}: upgraded the tables from version {from} to {to}")),
    }
    Ok(())
}

fn check(address: &Address, station: Option<&str>) -> Outcome {
    let (found, end) = fleet::check(address, station);
    let mut wrong = 0;
    for checked in &found {
        match &checked.remedy {
            None => print(&format!("ok     {}\n", on_one_line(&checked.what))),
            Some(remedy) => {
                wrong += 1;
                print(&format!("wrong  {}. {remedy}\n", on_one_line(&checked.what)));
            }
        }
    }
    if let Some(error) = end {
        return Err(error.into());
    }
    if wrong == 0 {
        return Ok(());
    }
    let what = "The fleet does not work as it should.";
    Err(Failure::new(
        Exit::Environment,
        crate::reason::Reason::new(
            "fleet-check",
            what,
            "Follow the remedies in the lines that begin with `wrong`.",
        )
        .with_number("problems", f64::from(wrong), "", Some(0.0)),
    ))
}

fn status(address: &Address, json: bool) -> Outcome {
    let status = fleet::status(address)?;
    if json {
        let text =
            serde_json::to_string_pretty(&status).map_err(|error| Failure::environment(&error.into()))?;
        print_json(&(text + "\n"));
    } else {
        print(&words(&status, address));
    }
    Ok(())
}

fn count_of(count: i64, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

fn shown_fits(fits: SharedFits) -> String {
    format!("{}, {:.1} MB", count_of(fits.count, "fit"), fits.bytes as f64 / 1e6)
}

/// Which of the released settings a station uses, and the first ones that it does not.
fn shown_settings(settings: &StationSettings) -> String {
    let StationSettings { count, current, skus, .. } = settings;
    let mut text = format!("settings: {current} of {count} as released");
    let others = skus.iter().filter(|sku| sku.state != SkuSettingsState::Current);
    for SkuSettings { sku, released, version, state, note, .. } in others.take(SETTINGS) {
        let sku = on_one_line(sku);
        text += &match (state, version) {
            (SkuSettingsState::Behind, Some(version)) => {
                format!("; {sku}: version {version}, {released} is not received yet")
            }
            (SkuSettingsState::Behind, None) => format!("; {sku}: version {released} is not received yet"),
            (SkuSettingsState::Local, _) => {
                format!("; {sku}: a local change is used in place of version {released}")
            }
            _ => format!(
                "; {sku}: version {released} cannot be used: {}",
                on_one_line(note.as_deref().unwrap_or("no reason was given"))
            ),
        };
    }
    text
}

fn words(status: &FleetStatus, address: &Address) -> String {
    let count = status.stations.len();
    let stations = if count == 1 { "1 station".to_owned() } else { format!("{count} stations") };
    let mut text = format!("{address}: {stations}, {}\n", shown_fits(status.fits));
    for station in &status.stations {
        let state = match station.state {
            StationState::Alive => "alive".to_owned(),
            StationState::Silent => format!("silent for {:.0} s", station.silent_for_s),
            StationState::Stopped => "stopped".to_owned(),
        };
        text += &format!(
            "  {}: {state}; {} delivered, {} fitted, {} rejected, {} waiting",
            on_one_line(&station.name),
            station.delivered,
            station.learned,
            station.rejected,
            station.waiting
        );
        for (count, what) in [(station.outdated, "outdated"), (station.uncertain, "uncertain")] {
            if count > 0 {
                text += &format!(", {count} {what}");
            }
        }
        text += &format!(" ({})\n", on_one_line(&station.program));
        if let Some(trouble) = &station.trouble {
            text += &format!("    {}\n", on_one_line(trouble));
        }
        if let Some(settings) = status.settings.iter().find(|settings| settings.station == station.name) {
            text += &format!("    {}\n", shown_settings(settings));
        }
    }
    text + &words_of_workers(status) + &words_of_jobs(&status.jobs)
}

fn words_of_workers(status: &FleetStatus) -> String {
    if status.workers.is_empty() {
        return String::new();
    }
    let parts = if status.parts_waiting == 1 { "part waits" } else { "parts wait" };
    let mut text = format!("workers: {} {parts}\n", status.parts_waiting);
    for worker in &status.workers {
        let WorkerRow { name, alive, silent_for_s, program, made, failed, sku, .. } = worker;
        let state = match (alive, sku) {
            (false, _) => format!("silent for {silent_for_s:.0} s"),
            (true, Some(sku)) => format!("fits the part of {}", on_one_line(sku)),
            (true, None) => "alive".to_owned(),
        };
        let [name, program] = [name, program].map(|text| on_one_line(text));
        text += &format!("  {name}: {state}; {made} made, {failed} failed ({program})\n");
    }
    text
}
