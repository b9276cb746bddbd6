//! What is in the folders: files, the meaning of their names, when they are complete, and the state of each drop.

pub mod names;
pub mod settle;
pub(crate) mod folders;
pub(crate) mod parked;
mod watcher;
mod drops;

pub(crate) use drops::{Block, Drop, Drops, Obstacle};
pub(crate) use folders::{Found, Identity, LARGEST_DROP};
pub(crate) use names::{
    Meaning, delivered_as, full_stem, is_ignored, is_list, is_sidecar, list_of, meaning, other_form,
    sidecar_of, well_named,
};
pub(crate) use parked::{Filed, Parking};
pub(crate) use settle::{Gap, Moment, SettleTimes, Stamp, Verdict, Writer};
pub use watcher::StopSignal;
pub(crate) use watcher::{Message, Signal, Watcher};
