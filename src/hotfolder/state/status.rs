//! What a station is at, for people at another terminal and for programs: `state/status.json`, written anew at most
//! once a second.

use std::collections::VecDeque;
use std::path::Path;
use std::time::{Duration, Instant, SystemTime};

use serde::{Deserialize, Serialize};

use super::{Delivered, Job};
use crate::config::{Sku, Station};
use crate::files::write_whole_unsynced;
use crate::hotfolder::api::{Waiting, WaitsFor};
use crate::hotfolder::clock;
use crate::hotfolder::seen::{Drops, Moment};
use crate::reason::Reason;

/// Name and version of the JSON form; `plugins/README.md` says what is stable.
pub const SCHEMA: &str = "isomark.status/1";
/// The file in the state folder.
pub const FILE: &str = "status.json";

const SHORTEST_INTERVAL: Duration = Duration::from_secs(1);
/// A status that says nothing new is written anyway after this time, so that a station that hangs is seen.
const LONGEST_INTERVAL: Duration = Duration::from_secs(10);
/// A station that says nothing for longer than this hangs, or its state folder cannot be written.
const LONGEST_SILENCE: Duration = Duration::from_secs(30);
const HOUR: Duration = Duration::from_secs(3600);
/// Entries of a list that are written out; the rest is counted.
pub(crate) const LISTED: usize = 500;
const ERRORS: usize = 20;

/// A station as it was at one moment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// [`SCHEMA`].
    pub schema: String,
    /// The station's name.
    pub station: String,
    /// Whether it ran when this was written; only the lock tells whether it still does.
    pub running: bool,
    /// The same in more words.
    #[serde(default)]
    pub state: State,
    /// When this was written, in universal time.
    pub at: String,
    /// When the station was started.
    pub since: String,
    /// What it did since then.
    pub done: Done,
    /// What is wrong with the folders and the settings themselves.
    #[serde(default)]
    pub troubles: Vec<String>,
    /// How many rejected drops lie in the rejected folder; the station itself does not count them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_rejected: Option<usize>,
    /// What it is doing.
    pub under_way: Vec<UnderWay>,
    /// What waits for something else.
    pub waiting: Listed<Waits>,
    /// What is still being written, or ends too early.
    pub incomplete: Listed<Waits>,
    /// Delivered drawings that would be others today.
    pub outdated: Listed<OutdatedDrawing>,
    /// Drawings of which nobody knows whether they were delivered.
    #[serde(default)]
    pub uncertain: Listed<UncertainDrawing>,
    /// The last rejections, newest first.
    pub rejections: Vec<Rejection>,
    /// What is kept for how long; absent before the folders were looked through.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kept: Option<Kept>,
}

/// How long reports, archived originals and rejected drops are kept, and what that came to when the folders were looked
/// through last.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// When that was, in universal time.
    pub at: String,
    /// For how long reports are kept, days; absent for ever.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reports_days: Option<f64>,
    /// For how long archived originals are kept, days; absent for ever.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub archive_days: Option<f64>,
    /// For how long rejected drops are kept, days; absent for ever.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rejected_days: Option<f64>,
    /// The size of all three above which the oldest go earlier, bytes; absent without such a limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_bytes: Option<u64>,
    /// What the three take, bytes.
    pub bytes: u64,
    /// How many reports, pictures, originals and rejected drops were removed then.
    pub removed: u64,
    /// What they took, bytes.
    pub removed_bytes: u64,
    /// Whether they take more than they may, and nothing else may be removed.
    pub too_much: bool,
    /// Why something could not be removed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trouble: Option<String>,
}

/// What can be told of a station from outside.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// It runs, and says so.
    Running,
    /// It runs and says nothing any more: it hangs, or cannot write its state folder.
    Silent,
    /// It was stopped.
    #[default]
    Stopped,
    /// It does not run, and never said that it would end.
    EndedSilently,
}

/// Counts since the start, and of the last hour.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Done {
    /// Corrected drawings delivered.
    pub delivered: u64,
    /// Parts fitted.
    pub learned: u64,
    /// Drops rejected.
    pub rejected: u64,
    /// Drawings delivered in the last hour.
    pub delivered_last_hour: u64,
    /// Drops rejected in the last hour.
    pub rejected_last_hour: u64,
}

/// A job that is being done.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UnderWay {
    /// The drop, relative to the hot folder.
    pub drop: String,
    /// For how long, s.
    pub for_s: f64,
}

/// The first entries of a list, and how many there are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Listed<T> {
    /// How many there are.
    pub count: usize,
    /// The first ones.
    pub first: Vec<T>,
}

/// A drop that waits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Waits {
    /// The drop, relative to the hot folder.
    pub drop: String,
    /// What it waits for.
    pub reason: Reason,
}

/// A delivered drawing that would be another one today.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OutdatedDrawing {
    /// Its name in the import folder.
    pub name: String,
    /// Its SKU.
    pub sku: String,
}

/// A drawing that the station was interrupted at, and that neither lies in the import folder nor is ready to get there:
/// an importer took it, or somebody removed its temporary file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UncertainDrawing {
    /// Its name in the import folder.
    pub name: String,
    /// The drop it was made of, relative to the hot folder.
    pub drop: String,
    /// Its SKU.
    pub sku: String,
    /// When it was filed.
    pub at: String,
}

impl From<&Delivered> for UncertainDrawing {
    fn from(result: &Delivered) -> Self {
        let Job { name, drop, sku, .. } = result.job.clone();
        Self { name, drop: drop.to_string(), sku, at: result.at.clone() }
    }
}

/// A drop that was rejected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rejection {
    /// When.
    pub at: String,
    /// The drop, relative to the hot folder.
    pub drop: String,
    /// Why.
    pub reason: Reason,
}

impl Status {
    /// The status that a station wrote last; `None` when none ever did.
    ///
    /// # Errors
    /// When the file cannot be read, or is not of this version's form.
    pub fn read(state: &Path) -> std::io::Result<Option<Self>> {
        let Some(bytes) = crate::files::read_if_there(&state.join(FILE))? else { return Ok(None) };
        Ok(Some(serde_json::from_slice(&bytes)?))
    }

    /// What this says at a later time of a station that runs, or does not: a running one writes its status every few
    /// seconds.
    pub fn seen(self, runs: bool, now: SystemTime) -> Self {
        let heard = now.checked_sub(LONGEST_SILENCE).unwrap_or(SystemTime::UNIX_EPOCH);
        let state = match (runs, self.running) {
            (true, _) if self.at < clock::timestamp(heard) => State::Silent,
            (true, _) => State::Running,
            (false, true) => State::EndedSilently,
            (false, false) => State::Stopped,
        };
        Self { running: runs, state, ..self }
    }
}

/// What a station remembers to tell.
pub(crate) struct StatusBoard {
    station: String,
    since: String,
    started: Instant,
    done: Done,
    /// Deliveries and rejections of the last hour, by minute since the start.
    minutes: VecDeque<(u64, u64, u64)>,
    rejections: VecDeque<Rejection>,
    next: Moment,
    heartbeat: Moment,
    /// What was written last, without its time.
    last: Option<Status>,
    complained: bool,
}

/// What the status shows of the station.
pub(crate) struct View<'a> {
    pub(crate) drops: &'a Drops,
    pub(crate) under_way: Vec<UnderWay>,
    /// How many there are, and the first [`LISTED`].
    pub(crate) outdated: (usize, Vec<(String, Sku)>),
    pub(crate) uncertain: Vec<UncertainDrawing>,
    pub(crate) kept: Option<Kept>,
    pub(crate) troubles: Vec<String>,
    pub(crate) now: Moment,
    pub(crate) alive: bool,
}

impl StatusBoard {
    /// Begins with what was rejected before the station was started; an older status that cannot be read is no loss.
    pub(crate) fn new(station: &Station, state: &Path) -> Self {
        let before = Status::read(state).ok().flatten().map(|status| status.rejections);
        Self {
            station: station.name.clone(),
            since: clock::now(),
            started: Instant::now(),
            done: Done::default(),
            minutes: VecDeque::new(),
            rejections: before.unwrap_or_default().into(),
            next: Moment::ZERO,
            heartbeat: Moment::ZERO,
            last: None,
            complained: false,
        }
    }

    pub(crate) fn follow(&mut self, station: &Station) {
        self.station = station.name.clone();
    }

    pub(crate) fn learned(&mut self) {
        self.done.learned += 1;
    }

    pub(crate) fn delivered(&mut self) {
        self.done.delivered += 1;
        self.minute().1 += 1;
    }

    pub(crate) fn rejected(&mut self, drop: &str, reason: &Reason) {
        self.done.rejected += 1;
        self.minute().2 += 1;
        self.rejections.push_front(Rejection { at: clock::now(), drop: drop.into(), reason: reason.clone() });
        self.rejections.truncate(ERRORS);
    }

    pub(crate) fn is_due(&self, now: Moment) -> bool {
        now >= self.next
    }

    pub(crate) fn write(&mut self, state: &Path, view: &View) {
        self.next = view.now + SHORTEST_INTERVAL;
        let mut status = self.status(view);
        if self.last.as_ref() == Some(&status) && view.now < self.heartbeat {
            return;
        }
        self.heartbeat = view.now + LONGEST_INTERVAL;
        self.last = Some(status.clone());
        status.at = clock::now();
        let Ok(mut bytes) = serde_json::to_vec_pretty(&status) else { return };
        bytes.push(b'\n');
        match write_whole_unsynced(state, FILE, &bytes) {
            Ok(()) => self.complained = false,
            Err(error) => {
                if !std::mem::replace(&mut self.complained, true) {
                    tracing::warn!("the status cannot be told: {error}");
                }
            }
        }
    }

    fn status(&mut self, view: &View) -> Status {
        let oldest = (self.started.elapsed().saturating_sub(HOUR)).as_secs() / 60;
        while self.minutes.front().is_some_and(|(minute, ..)| *minute < oldest) {
            self.minutes.pop_front();
        }
        let mut done = self.done.clone();
        done.delivered_last_hour = self.minutes.iter().map(|(_, delivered, _)| delivered).sum();
        done.rejected_last_hour = self.minutes.iter().map(|(.., rejected)| rejected).sum();
        let running = |drop: &Waiting| view.under_way.iter().any(|job| job.drop == drop.drop);
        let (mut waiting, incomplete) = view.drops.left();
        let waits = |list: Vec<Waiting>| {
            let waits = |waiting: Waiting| Waits { drop: waiting.drop, reason: waiting.reason };
            listed(list.into_iter().map(waits).collect())
        };
        // What waits goes on waiting while it is tried again; what is read for the first time lacks nothing yet.
        waiting.retain(|drop| drop.waits_for != WaitsFor::Turn || !running(drop));
        let incomplete = incomplete.into_iter().filter(|drop| !running(drop)).collect();
        let (count, outdated) = &view.outdated;
        let outdated =
            outdated.iter().map(|(name, sku)| OutdatedDrawing { name: name.clone(), sku: sku.to_string() });
        Status {
            schema: SCHEMA.into(),
            station: self.station.clone(),
            running: view.alive,
            state: if view.alive { State::Running } else { State::Stopped },
            in_rejected: None,
            at: String::new(),
            since: self.since.clone(),
            done,
            troubles: view.troubles.clone(),
            under_way: view.under_way.clone(),
            waiting: waits(waiting),
            incomplete: waits(incomplete),
            outdated: Listed { count: *count, first: outdated.collect() },
            uncertain: listed(view.uncertain.clone()),
            rejections: self.rejections.iter().cloned().collect(),
            kept: view.kept.clone(),
        }
    }

    fn minute(&mut self) -> &mut (u64, u64, u64) {
        let now = self.started.elapsed().as_secs() / 60;
        if self.minutes.back().is_none_or(|(minute, ..)| *minute != now) {
            self.minutes.push_back((now, 0, 0));
        }
        let last = self.minutes.len() - 1;
        &mut self.minutes[last]
    }
}

impl<T> Default for Listed<T> {
    fn default() -> Self {
        Self { count: 0, first: Vec::new() }
    }
}

fn listed<T>(mut all: Vec<T>) -> Listed<T> {
    let count = all.len();
    all.truncate(LISTED);
    Listed { count, first: all }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_can_be_told_of_a_station_from_outside() {
        let at = SystemTime::UNIX_EPOCH + Duration::from_secs(1_767_225_600);
        let bytes = serde_json::json!({
            "schema": SCHEMA, "station": "test", "running": true, "at": clock::timestamp(at), "since": "",
            "done": Done::default(), "under_way": [], "rejections": [],
            "waiting": {"count": 0, "first": []}, "incomplete": {"count": 0, "first": []},
            "outdated": {"count": 0, "first": []},
        });
        // One that an older version wrote knows no troubles.
        let status: Status = serde_json::from_value(bytes).unwrap();
        let ended = Status { running: false, ..status.clone() };
        for (status, runs, after, state) in [
            (&status, true, 30, State::Running),
            (&status, true, 31, State::Silent),
            (&status, false, 1, State::EndedSilently),
            (&ended, false, 31, State::Stopped),
        ] {
            let seen = status.clone().seen(runs, at + Duration::from_secs(after));
            assert_eq!((seen.running, seen.state), (runs, state));
        }
    }
}
