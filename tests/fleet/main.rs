//! Fleets: real stations with a real PostgreSQL server, which the tests start and stop themselves.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    unreachable_pub,
    missing_docs,
    dead_code,
    reason = "helpers of tests may panic"
)]

#[path = "../program/desk.rs"]
mod desk;
#[path = "../schemas/mod.rs"]
mod schemas;

#[path = "../browser/mod.rs"]
mod browser;

mod server;
mod station;
mod proxy;
mod client;

mod away;
mod fits;
mod kills;
mod histories;
mod load;
mod lost;
mod job_load;
mod page;
mod settings;
mod jobs;
mod workers;
mod job_kills;
mod stations;
mod tables;
#[cfg(unix)]
mod encryption;
