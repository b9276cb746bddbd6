//! What is there: files, what their names mean, when they are whole, and what is known of each drop.

pub mod names;
pub mod settle;
pub(crate) mod folders;
pub(crate) mod parked;
mod watcher;
mod drops;

pub(crate) use drops::{Block, Drop, Drops, Obstacle};
pub(crate) use folders::{Found, Identity, LARGEST_DROP};
pub(crate) use names::{Meaning, delivered_as, is_ignored, is_sidecar, meaning, sidecar_of};
pub(crate) use parked::{Filed, Parking};
pub(crate) use settle::{Gap, Moment, SettleTimes, Stamp, Verdict, Writer};
pub use watcher::StopSignal;
pub(crate) use watcher::{Message, Signal, Watcher};
