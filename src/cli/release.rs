//! `isomark fleet release`: releases the settings of a SKU to the stations of a fleet.

use std::io::Read;
use std::path::{Path, PathBuf};

use clap::Args;

use super::fleet_place::Place;
use super::options::parse_sku;
use super::outcome::{Exit, Failure, Outcome, print, print_json, shown, tell};
use crate::config::{ConfigError, JobSettings, Station};
use crate::diff::text_changes;
use crate::fleet::{self, Address, NewRelease, ReleaseRow, Releases};
use crate::printable::on_one_line;
use crate::reason::Reason;

/// Changed lines that are shown.
const LINES: usize = 40;

#[derive(Debug, Args)]
#[command(
    allow_missing_positional = true,
    override_usage = "isomark fleet release SKU FILE.toml URL [--with STATION.TOML] [--station LINE] [--author NAME]\n       \
                      isomark fleet release SKU --remove URL [--station LINE]\n       \
                      isomark fleet release SKU --history URL [--json]"
)]
pub(super) struct ReleaseArguments {
    /// The SKU, such as `can-500`.
    sku: String,
    /// The SKU's settings, in the form of `skus/<sku>.toml` of a station. isomark checks them first; with `--with`, together with those
    /// of a station.
    #[arg(value_name = "FILE.toml", conflicts_with_all = ["remove", "history"])]
    file: Option<PathBuf>,
    #[command(flatten)]
    place: Place,
    /// Checks the settings together with those of this station, for example if they need a depth of focus that only the stations
    /// state.
    #[arg(long, value_name = "STATION.TOML", requires = "file")]
    with: Option<PathBuf>,
    /// Only for the station with this name. There, it is used in place of the release for all.
    #[arg(long, value_name = "STATION", conflicts_with = "history")]
    station: Option<String>,
    /// Records this name as the author, beside the login, in the list of versions and in the files at the stations.
    #[arg(long, value_name = "NAME", conflicts_with = "history", value_parser = parse_author)]
    author: Option<String>,
    /// Removes what was released: the settings of the stations then apply to the SKU. With `--station`, that station uses the release for all
    /// stations again.
    #[arg(long)]
    remove: bool,
    /// Lists the versions, who released them, and which stations use them.
    #[arg(long, conflicts_with = "remove")]
    history: bool,
    /// Prints the list as JSON.
    #[arg(long, requires = "history")]
    pub(super) json: bool,
}

fn parse_author(text: &str) -> Result<String, String> {
    let longest = NewRelease::LONGEST_AUTHOR;
    let is_name =
        !text.trim().is_empty() && !text.chars().any(char::is_control) && text.chars().count() <= longest;
    if is_name { Ok(text.trim().into()) } else { Err(format!("give a name of at most {longest} characters")) }
}

pub(super) fn run(arguments: &ReleaseArguments) -> Outcome {
    let ReleaseArguments { sku, file, place, with, station, author, remove, history, json } = arguments;
    let sku = parse_sku(sku)?;
    let new =
        NewRelease { sku: &sku, settings: None, station: station.as_deref(), author: author.as_deref() };
    match (file, remove, history) {
        (Some(file), ..) => {
            let station = match with {
                Some(with) => Some(Station::load(with)?),
                None => place.station()?,
            };
            let base = station.map_or_else(JobSettings::default, |station| station.settings);
            let settings = checked(file, &base)?;
            release(&place.address()?, &NewRelease { settings: Some(&settings), ..new })
        }
        (None, true, _) => release(&place.address()?, &new),
        (None, _, true) => show(&fleet::history(&place.address()?, &sku)?, *json),
        (None, false, false) => Err(Failure::usage(
            "The settings file or the address of the fleet is missing.",
            "Give both: `isomark fleet release SKU FILE.toml URL`; or `--remove` or `--history` in place of the file.",
        )),
    }
}

/// The settings in a file, if a station can use them.
fn checked(file: &Path, base: &JobSettings) -> Result<String, Failure> {
    let unreadable = |source| ConfigError::Unreadable { file: file.into(), source };
    let too_large =
        |number: usize, unit, limit: usize| {
            let what = format!("The settings in {} are too large to be released.", shown(file));
            let reason = Reason::new("fleet-release-too-large", what, "Remove what is not needed.")
                .with_number(unit, number as f64, "", Some(limit as f64));
            Failure::new(Exit::Usage, reason)
        };
    let mut bytes = Vec::new();
    let opened = fs_err::File::open(file).map_err(unreadable)?;
    // One byte more shows that there is more.
    opened.take(NewRelease::LARGEST as u64 + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() > NewRelease::LARGEST {
        let length = fs_err::metadata(file).map_err(unreadable)?.len();
        return Err(too_large(length as usize, "bytes", NewRelease::LARGEST));
    }
    let text = String::from_utf8(bytes).map_err(|_| {
        unreadable(std::io::Error::new(std::io::ErrorKind::InvalidData, "it is not UTF-8 text"))
    })?;
    let lines = text.lines().count();
    if lines > NewRelease::MOST_LINES {
        return Err(too_large(lines, "lines", NewRelease::MOST_LINES));
    }
    base.overridden_by(file, &text)?;
    // At the stations, comments stand above it.
    Ok(text.strip_prefix('\u{feff}').unwrap_or(&text).to_owned())
}

fn release(address: &Address, new: &NewRelease<'_>) -> Outcome {
    let sku = on_one_line(new.sku.as_str());
    let stations = match new.station {
        Some(station) => format!("the station {}", on_one_line(station)),
        None => "all stations".to_owned(),
    };
    let done = fleet::release(address, new)?;
    match (done.version, new.settings) {
        (Some(version), Some(_)) if done.is_new => {
            tell(&format!("{sku}: released version {version} for {stations}"));
        }
        (Some(version), Some(_)) => {
            tell(&format!(
                "{sku}: version {version} for {stations} has these settings already; nothing to release"
            ));
        }
        (Some(version), None) if done.is_new => {
            tell(&format!("{sku}: removed the settings for {stations}, as version {version}"));
        }
        _ => tell(&format!("{sku}: no settings are released for {stations}; nothing to remove")),
    }
    if done.is_new {
        // A larger one was not released by this program.
        let is_ours = done.before.lines().count() <= NewRelease::MOST_LINES;
        let before = if is_ours { &*done.before } else { "" };
        let changes = text_changes(before, new.settings.unwrap_or_default());
        let shown = changes.iter().take(LINES).map(|line| format!("  {}\n", on_one_line(line)));
        print(&shown.collect::<String>());
        if changes.len() > LINES {
            print(&format!("  and {} more lines\n", changes.len() - LINES));
        }
    }
    Ok(())
}

fn show(releases: &Releases, json: bool) -> Outcome {
    if json {
        let text =
            serde_json::to_string_pretty(releases).map_err(|error| Failure::environment(&error.into()))?;
        print_json(&(text + "\n"));
        return Ok(());
    }
    if releases.versions.is_empty() {
        print(&format!("{}: nothing was released\n", on_one_line(&releases.sku)));
    }
    for row in &releases.versions {
        let ReleaseRow { version, station, removed, current, at, login, author, stations, .. } = row;
        let [at, login] = [at, login].map(|text| on_one_line(text));
        let by = author.as_ref().map_or(login.clone(), |author| format!("{} ({login})", on_one_line(author)));
        let scope = station.as_ref().map_or("all stations".into(), |station| on_one_line(station));
        let verb = if *removed { "removed" } else { "released" };
        let current = if *current { ", current" } else { "" };
        let mut text = format!("version {version}: {verb} for {scope} by {by} at {at}{current}");
        if !stations.is_empty() && !removed {
            let names: Vec<String> = stations.iter().map(|name| on_one_line(name)).collect();
            text += &format!("; used by {}", names.join(", "));
        }
        print(&(text + "\n"));
    }
    Ok(())
}
