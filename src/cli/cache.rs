//! `isomark cache`: lists, verifies and removes fitted surfaces.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::named_files::{cache_of, share_is_there, station};
use super::options::parse_sku;
use super::outcome::{Failure, Outcome, print, shown, tell};
use crate::cache::{Cache, CacheEntry, EntryState};
use crate::hotfolder::UsedFolder;
use crate::printable::on_one_line;
use crate::reason::Reason;

#[derive(Debug, Args)]
pub(super) struct CacheArguments {
    #[command(subcommand)]
    verb: Verb,
    /// The station whose cache is used. Default: the user's cache.
    #[arg(long, value_name = "FILE", global = true)]
    station: Option<PathBuf>,
    /// The folder of the cache.
    #[arg(long, value_name = "DIR", global = true)]
    cache: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Lists the fitted surfaces, one per line; `*` marks the current part of its SKU.
    List,
    /// Reads every entry and its checksum; exit code 1 if one is damaged.
    Verify {
        /// Removes damaged entries; isomark fits their surfaces again when they are needed.
        #[arg(long)]
        repair: bool,
    },
    /// Removes the surfaces of SKUs.
    Remove {
        /// The SKUs.
        #[arg(required = true)]
        skus: Vec<String>,
    },
}

pub(super) fn run(arguments: &CacheArguments) -> Outcome {
    if let Some(folder) =
        arguments.cache.as_ref().filter(|folder| folder.try_exists().is_ok_and(|is_there| !is_there))
    {
        return Err(Failure::usage(
            format!("There is no folder {}.", shown(folder)),
            "Check the name that follows `--cache`.",
        ));
    }
    let station = station(arguments.station.as_deref())?;
    if let Some(station) = station.as_ref().filter(|_| arguments.cache.is_none()) {
        share_is_there(station, UsedFolder::Cache)?;
    }
    let cache = cache_of(arguments.cache.as_deref(), station.as_ref())?;
    match &arguments.verb {
        Verb::List => list(&cache),
        Verb::Verify { repair } => verify(&cache, *repair),
        Verb::Remove { skus } => remove(&cache, skus),
    }
}

fn entries(cache: &Cache) -> Result<Vec<CacheEntry>, Failure> {
    cache.entries().map_err(|error| Failure::environment(&error))
}

fn list(cache: &Cache) -> Outcome {
    for entry in entries(cache)? {
        let state = match &entry.state {
            EntryState::Good { part, residual_mm } => format!("{part}, largest residual {residual_mm:.4} mm"),
            EntryState::Damaged(what) => format!("damaged: {what}"),
        };
        let mark = if entry.current { '*' } else { ' ' };
        let kilobytes = entry.bytes.div_ceil(1000);
        let (sku, state) = (on_one_line(&entry.sku.to_string()), on_one_line(&state));
        print(&format!("{mark} {sku:<24} {} {kilobytes:>6} kB  {state}\n", entry.key.as_str()));
    }
    tell(&format!("cache: {}", shown(cache.root())));
    Ok(())
}

fn verify(cache: &Cache, repair: bool) -> Outcome {
    let entries = entries(cache)?;
    let damaged: Vec<_> =
        entries.iter().filter(|entry| matches!(entry.state, EntryState::Damaged(_))).collect();
    for entry in &damaged {
        if let EntryState::Damaged(what) = &entry.state {
            let what = on_one_line(&format!("{} {}: {what}", entry.sku, entry.key.as_str()));
            print(&format!("{what}\n"));
        }
        if repair {
            cache.remove_entry(entry).map_err(|error| Failure::environment(&error))?;
        }
    }
    tell(&format!(
        "{} {}, {} damaged{}",
        entries.len(),
        if entries.len() == 1 { "entry" } else { "entries" },
        damaged.len(),
        if repair && !damaged.is_empty() { ", removed" } else { "" }
    ));
    if damaged.is_empty() || repair {
        return Ok(());
    }
    Err(Failure::rejected(
        Reason::new(
            "cache-damaged",
            "Some fitted surfaces are damaged and not used.",
            "Run `isomark cache verify --repair`, or ignore them: isomark fits them again when they are needed.",
        )
        .with_number("damaged entries", damaged.len() as f64, "", Some(0.0)),
    ))
}

fn remove(cache: &Cache, skus: &[String]) -> Outcome {
    for name in skus {
        let known = cache.remove(&parse_sku(name)?).map_err(|error| Failure::environment(&error))?;
        let name = on_one_line(name);
        tell(&if known { format!("{name}: removed") } else { format!("{name} has no fitted surface here") });
    }
    Ok(())
}
