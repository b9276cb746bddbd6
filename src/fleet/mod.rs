//! The fleet: stations that share what they know through a PostgreSQL database, each still able to work alone.
//!
//! ```text
//! station ──figures──▶ Member ──one thread, one connection──▶ PostgreSQL ◀── isomark fleet init, check, status, prune, release
//! pipeline ──fetch, wish──▶  │  ──fits and current parts──▶ cache of the station
//!          ──offer, announce──▶ Outbox, files in the state folder
//! ```
//!
//! | file | contains |
//! |---|---|
//! | `address` | the URL, with the rules for passwords and encryption |
//! | `tls` | encryption with verification, over `rustls` |
//! | `session` | one connection, in which every wait has a limit |
//! | `migrations` | the tables, in numbered steps; `roles.sql` has the rights |
//! | `fits` | fitted surfaces and the current part of each SKU |
//! | `outbox` | what a station has to send, in files |
//! | `releases`, `incoming` | settings that the office released, and how a station receives them |
//! | `sku_files`, `released_text` | the files of a station with these settings, and local changes of them |
//! | `releasing` | how the office releases settings, and what the stations do with them |
//! | `jobs` | jobs for other lines |
//! | `desk` | what the rest of the station and the thread of the fleet give each other for them |
//! | `asking` | how a station asks workers for a heavy fit, and takes it back |
//! | `worker` | a process without a laser that makes these fits |
//! | `workers` | the workers for a status |
//! | `office` | what people do at a terminal: set up, check, look |
//! | `member` | the thread of a station |
//!
//! # Settings that the office released
//!
//! ```text
//! isomark fleet release ──▶ PostgreSQL ──NOTIFY──▶ Incoming ──▶ SkuFiles ──▶ skus/<sku>.toml, and a copy in the state folder
//!                                                                  ▲                │
//!                              what is used in place of a change ──┴─ LiveSettings ◀┘
//! ```
//!
//! A station compares the list of releases with its files whenever it connects, so nothing that it missed matters. The copies
//! decide what is a local change, also without the database; [`SkuFiles`] answers before the settings are used.
//!
//! # One thread
//!
//! One thread of a station does everything in the database. Only a part that is dropped waits for it, at most
//! a moment and only while it answers: fetching a fit is faster than making it. The rest of the station reads and writes memory and
//! the outbox. While the database is away, the station reports it once, works alone, and sends the outbox afterwards.
//!
//! # Workers
//!
//! ```text
//! job of a station ──part, settings──▶ request ──lease, attempt──▶ worker ──fit, end of the attempt──▶ fits ──fetch──▶ job
//! ```
//!
//! A station asks for a heavy fit only if a worker of the same program is alive, waits for a limited time, and then makes the fit itself.
//! Numbers of attempts are never used twice, so a worker that is late changes nothing. All stations that need the same fit wait for
//! one request.
//!
//! # The current part
//!
//! The database gives each new part of a SKU the next version, under a lock, so all stations agree on one order. A part that a
//! station learned while it was cut off takes its place by the time when it was learned: if another station has learned one
//! since, that one stays. A station notes the announcement in its outbox before the part becomes current in its own cache; until it is
//! sent, parts of others do not replace it there.

mod error;
mod address;
mod tls;
mod session;
mod migrations;
mod outbox;
mod fits;
mod released_text;
mod sku_files;
mod releases;
mod incoming;
mod releasing;
mod desk;
mod jobs;
mod workers;
mod asking;
mod office;
mod pruning;
mod member;
mod worker;

pub use address::Address;
pub use error::{FleetError, Needed, Refusal};
#[cfg(feature = "cli")]
pub(crate) use jobs::short_id;
pub use jobs::{JobRow, Jobs, Sending, Sent, TakeOver, TakenOver, send, take_over};
pub use member::{Member, Running};
pub use office::{Checked, FleetStatus, Initialised, SCHEMA, SharedFits, check, init, status};
pub use pruning::{Prune, Pruned, prune};
pub use releasing::{
    NewRelease, ReleaseRow, Released, Releases, SkuSettings, SkuSettingsState, StationSettings, history,
    release,
};
pub use sku_files::SkuFiles;
pub use worker::{Ending, Fitter, Worker};

use std::time::{SystemTime, UNIX_EPOCH};

pub use crate::hotfolder::{StationRow, StationState, WorkerRow};

/// This program, as the tables name it.
fn program() -> String {
    format!("isomark {}", env!("CARGO_PKG_VERSION"))
}

/// A name for one run of the program.
fn process() -> String {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let process = format!("{} {}", std::process::id(), now.as_nanos());
    blake3::hash(process.as_bytes()).to_hex()[..16].to_owned()
}
