//! What a station shares with others, as the hot folder uses it.

use serde::{Deserialize, Serialize};

use super::line::Lines;
use crate::config::{Sku, Station};

/// The fleet of a station. No method waits for the network or a disk.
pub trait Fleet: Lines {
    /// Takes the newest figures of the station.
    fn publish(&self, figures: Figures);

    /// The SKUs whose part or surface arrived from the fleet since the last call.
    fn take_news(&self) -> Vec<Sku>;

    /// The settings of the station are others now.
    fn follow(&self, station: &Station);

    /// Why the fleet cannot be used as the settings ask for it; `None` while it can.
    fn trouble(&self) -> Option<String>;

    /// The notices for people about settings that the office released.
    fn notices(&self) -> Vec<String>;

    /// The fleet as it was seen last, for the status; `None` if nobody needs it.
    fn seen(&self) -> Option<FleetSeen>;
}

/// The figures of a station that its fleet shows.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Figures {
    /// Drops that wait or are incomplete.
    pub waiting: u64,
    /// Drawings delivered since the start.
    pub delivered: u64,
    /// Parts learned since the start.
    pub learned: u64,
    /// Drops rejected since the start.
    pub rejected: u64,
    /// Delivered drawings that are outdated.
    pub outdated: u64,
    /// Drawings that may not have been delivered.
    pub uncertain: u64,
    /// The first problem with folders and settings.
    pub trouble: Option<String>,
}

/// The fleet as a station sees it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct FleetSeen {
    /// The station's name in the fleet.
    pub name: String,
    /// Whether the database answers.
    pub available: bool,
    /// Why it does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trouble: Option<String>,
    /// When the stations were read, in universal time; absent before the first time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at: Option<String>,
    /// How many stations there were at that time.
    pub count: u64,
    /// The first ones; those that need a person come first.
    pub stations: Vec<StationRow>,
    /// Its workers; absent without any.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub workers: Vec<WorkerRow>,
}

/// A worker as its fleet knows it. One that was stopped is not known any more.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct WorkerRow {
    /// Its name for people; several may have the same.
    pub name: String,
    /// Whether it gave a sign of life in the last 45 s.
    pub alive: bool,
    /// The time since its last sign of life, s.
    pub silent_for_s: f64,
    /// The time since its start, s.
    pub up_for_s: f64,
    /// Its program with the version.
    pub program: String,
    /// Fits that it made since its start.
    pub made: i64,
    /// Parts that it could not fit since its start.
    pub failed: i64,
    /// The SKU whose part it fits at the moment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sku: Option<String>,
}

/// A station as its fleet knows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct StationRow {
    /// Its name in the fleet.
    pub name: String,
    /// Whether it is alive.
    pub state: StationState,
    /// The time since its last sign of life, s.
    pub silent_for_s: f64,
    /// The time since its start, s.
    pub up_for_s: f64,
    /// Its program with the version.
    pub program: String,
    /// Drops that wait or are incomplete.
    pub waiting: i64,
    /// Drawings that it delivered since its start.
    pub delivered: i64,
    /// Parts that it learned since its start.
    pub learned: i64,
    /// Drops that it rejected since its start.
    pub rejected: i64,
    /// Its delivered drawings that are outdated.
    pub outdated: i64,
    /// Its drawings that may not have been delivered.
    pub uncertain: i64,
    /// Its first problem with folders and settings, if any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trouble: Option<String>,
}

/// Whether a station is alive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum StationState {
    /// It gives signs of life.
    Alive,
    /// It gave none for 45 s: it crashed, or the database was away from it.
    Silent,
    /// It was stopped.
    Stopped,
}
