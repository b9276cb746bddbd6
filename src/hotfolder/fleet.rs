//! What a station shares with others, as the hot folder uses it.

use crate::config::{FolderPaths, Sku};

/// The fleet of a station. No method waits for the network or a disk.
pub trait Fleet: Send + Sync {
    /// Takes the newest figures of the station.
    fn publish(&self, figures: Figures);

    /// The SKUs whose part or surface arrived from the fleet since the last call.
    fn take_news(&self) -> Vec<Sku>;

    /// The folders of the station are others now.
    fn follow(&self, folders: &FolderPaths);

    /// Why the fleet cannot be used as the settings ask for it; `None` while it can.
    fn trouble(&self) -> Option<String>;
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
