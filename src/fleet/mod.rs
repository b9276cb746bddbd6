//! The fleet: stations that share what they know through a PostgreSQL database, each still able to work alone.
//!
//! ```text
//! station ──figures──▶ Member ──one thread, one connection──▶ PostgreSQL ◀── isomark fleet init, check, status, prune
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
//! | `office` | what people do at a terminal: set up, check, look |
//! | `member` | the thread of a station |
//!
//! One thread of a station does everything in the database. Only a part that is dropped waits for it, at most
//! a moment and only while it answers: fetching a fit is faster than making it. The rest of the station reads and writes memory and
//! the outbox. While the database is away, the station reports it once, works alone, and sends the outbox afterwards.
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
mod office;
mod member;

pub use address::Address;
pub use error::FleetError;
pub use member::{Member, Running};
pub use office::{
    Checked, FleetStatus, Initialised, Prune, SCHEMA, SharedFits, StationRow, StationState, check, init,
    prune, status,
};

/// This program, as the tables name it.
fn program() -> String {
    format!("isomark {}", env!("CARGO_PKG_VERSION"))
}
