//! The status of a station, for people at another terminal and for programs: `state/status.json`, written at most once
//! a second.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::Path;
use std::time::{Duration, SystemTime};

use serde::{Deserialize, Serialize};

use super::{Delivered, DropId, Job};
use crate::config::{Sku, Station};
use crate::files::write_whole_unsynced;
use crate::hotfolder::api::{Waiting, WaitsFor};
use crate::hotfolder::clock;
use crate::hotfolder::fleet::{Figures, FleetSeen};
use crate::hotfolder::jobs::Work;
use crate::hotfolder::seen::{Drops, Moment};
use crate::reason::Reason;

/// Name and version of the JSON form; `plugins/README.md` states what is stable.
pub const SCHEMA: &str = "isomark.status/1";
/// The file in the state folder.
pub const FILE: &str = "status.json";

const SHORTEST_INTERVAL: Duration = Duration::from_secs(1);
/// An unchanged status is written again after this time, to show that the station is alive.
const LONGEST_INTERVAL: Duration = Duration::from_secs(10);
/// A station without a new status for this time hangs, or cannot write its state folder.
const LONGEST_SILENCE: Duration = Duration::from_secs(30);
const HOUR: Duration = Duration::from_secs(3600);
/// Entries of a list that are written out; the rest is counted.
pub(crate) const LISTED: usize = 500;
const ERRORS: usize = 20;
/// Finished drops that are listed.
const FINISHED: usize = 20;

/// A station as it was at one moment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Status {
    /// [`SCHEMA`].
    pub schema: String,
    /// The station's name.
    pub station: String,
    /// Whether it was running when this was written; only the lock shows whether it still is.
    pub running: bool,
    /// The same in more detail.
    #[serde(default)]
    pub state: State,
    /// When this was written, in universal time.
    pub at: String,
    /// When the station was started.
    pub since: String,
    /// What it has done since then, and in the last hour.
    pub done: Done,
    /// The minutes of the last hour in which something was delivered or rejected, also before the start, the oldest first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub minutes: Vec<Minute>,
    /// The problems with the folders and the settings.
    #[serde(default)]
    pub troubles: Vec<String>,
    /// Number of rejected drops in the rejected folder; the station itself does not count them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_rejected: Option<usize>,
    /// The jobs that are being done.
    pub under_way: Vec<UnderWay>,
    /// Drops that wait for something else.
    pub waiting: Listed<Waits>,
    /// Drops that are still being written, or end too early.
    pub incomplete: Listed<Waits>,
    /// Delivered drawings that are outdated.
    pub outdated: Listed<OutdatedDrawing>,
    /// Drawings that may not have been delivered.
    #[serde(default)]
    pub uncertain: Listed<UncertainDrawing>,
    /// The last drops that were finished, newest first; those that were rejected are in `rejections`.
    #[serde(default)]
    pub finished: Vec<Finished>,
    /// The last rejections, newest first, without the drops that were put right since.
    pub rejections: Vec<Rejection>,
    /// What is kept for how long; absent before the first pass over the folders.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kept: Option<Kept>,
    /// The fleet of the station; absent for a station without one, or without a page.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fleet: Option<FleetSeen>,
}

/// How long reports, archived originals and rejected drops are kept, and the result of the last pass over the folders.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Kept {
    /// When that pass was, in universal time.
    pub at: String,
    /// How long reports are kept, days; absent if they are never removed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reports_days: Option<f64>,
    /// How long archived originals are kept, days; absent if they are never removed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub archive_days: Option<f64>,
    /// How long rejected drops are kept, days; absent if they are never removed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rejected_days: Option<f64>,
    /// The limit for the total size, bytes: above it, the oldest files are removed earlier; absent without a limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_bytes: Option<u64>,
    /// The total size, bytes.
    pub bytes: u64,
    /// Number of reports, pictures, originals and rejected drops that were removed.
    pub removed: u64,
    /// The size of the removed files, bytes.
    pub removed_bytes: u64,
    /// Whether the total size is above the limit, and nothing else may be removed.
    pub too_much: bool,
    /// Why a file could not be removed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trouble: Option<String>,
}

/// The state of a station, as seen from outside.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum State {
    /// It is running and writes its status.
    Running,
    /// It is running but no longer writes its status: it hangs, or cannot write its state folder.
    Silent,
    /// It was stopped.
    #[default]
    Stopped,
    /// It is not running, and did not report that it was stopping: it crashed or was killed.
    EndedSilently,
}

/// What was done in one minute.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Minute {
    /// When it begins, in universal time.
    pub at: String,
    /// Corrected drawings delivered.
    pub delivered: u64,
    /// Drops rejected.
    pub rejected: u64,
}

/// Counts since the start, and of the last hour, which may have begun before the start.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Done {
    /// Corrected drawings delivered, without those that were delivered before.
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
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct UnderWay {
    /// The drop, relative to the hot folder.
    pub drop: String,
    /// How long it has been running, s.
    pub for_s: f64,
}

/// The first entries of a list, and how many there are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema), schemars(rename = "Listed_{T}"))]
pub struct Listed<T> {
    /// How many there are.
    pub count: usize,
    /// The first ones.
    pub first: Vec<T>,
}

/// A drop that waits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Waits {
    /// The drop, relative to the hot folder.
    pub drop: String,
    /// What it waits for.
    pub reason: Reason,
}

/// A delivered drawing that is outdated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct OutdatedDrawing {
    /// Its name in the import folder.
    pub name: String,
    /// Its SKU.
    pub sku: String,
}

/// A drawing that may not have been delivered: the station was interrupted, and the import folder contains neither the
/// drawing nor its temporary file. Either an importer took it, or somebody removed the temporary file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct UncertainDrawing {
    /// Its name in the import folder.
    pub name: String,
    /// The drop that it was made from, relative to the hot folder.
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

/// A drop that was processed to its end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Finished {
    /// When.
    pub at: String,
    /// The drop, relative to the hot folder.
    pub drop: String,
    /// Its SKU.
    pub sku: String,
    /// The name of a drawing, with which the names of its files in the SKU's reports folder begin; absent for a part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drawing: Option<String>,
    /// What was done with it.
    pub result: FinishedAs,
}

/// What was done with a finished drop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum FinishedAs {
    /// The drawing was delivered.
    Delivered,
    /// The drawing was corrected again from its original in the archive, and delivered.
    DeliveredAgain,
    /// The drawing was delivered before, and not delivered again.
    Repeated,
    /// The drawing was filed, but may not have been delivered.
    Uncertain,
    /// The part was fitted.
    Learned,
    /// The drawing is in the queue of another line.
    HandedOver,
}

/// A drop that was rejected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Rejection {
    /// When.
    pub at: String,
    /// The drop, relative to the hot folder.
    pub drop: String,
    /// Why.
    pub reason: Reason,
}

impl Status {
    /// The last status that a station wrote; `None` if there is none.
    ///
    /// # Errors
    /// When the file cannot be read, or does not have this version's form.
    pub fn read(state: &Path) -> std::io::Result<Option<Self>> {
        let Some(bytes) = crate::files::read_if_there(&state.join(FILE))? else { return Ok(None) };
        Ok(Some(serde_json::from_slice(&bytes)?))
    }

    /// What the fleet of the station shows of it, without what is wrong with the fleet itself.
    pub(crate) fn figures(&self, of_fleet: Option<&str>) -> Figures {
        let trouble = self.troubles.iter().find(|trouble| Some(trouble.as_str()) != of_fleet);
        Figures {
            waiting: (self.waiting.count + self.incomplete.count) as u64,
            delivered: self.done.delivered,
            learned: self.done.learned,
            rejected: self.done.rejected,
            outdated: self.outdated.count as u64,
            uncertain: self.uncertain.count as u64,
            trouble: trouble.cloned(),
        }
    }

    /// The status at a later time, with the current state of the station: a running one writes its status every few
    /// seconds.
    pub fn seen(mut self, runs: bool, now: SystemTime) -> Self {
        // A status of an older version has no minutes.
        if !self.minutes.is_empty() {
            self.done.count_last_hour(&self.minutes, now);
        }
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

impl Done {
    /// Counts what was done in the hour before `now`.
    fn count_last_hour(&mut self, minutes: &[Minute], now: SystemTime) {
        let (from, to) = last_hour(now);
        let counted = || minutes.iter().filter(|minute| from <= minute.at && minute.at <= to);
        self.delivered_last_hour = counted().map(|minute| minute.delivered).sum();
        self.rejected_last_hour = counted().map(|minute| minute.rejected).sum();
    }
}

/// The first and the last minute of the hour before `now`.
fn last_hour(now: SystemTime) -> (String, String) {
    let hour_ago = now.checked_sub(HOUR).unwrap_or(SystemTime::UNIX_EPOCH);
    (minute_of(hour_ago), minute_of(now))
}

/// The minute of a moment, as text whose order is that of time.
fn minute_of(moment: SystemTime) -> String {
    minute_with(&clock::timestamp(moment))
}

/// The minute with a second, given as text.
fn minute_with(second: &str) -> String {
    format!("{}:00Z", second.get(..16).unwrap_or(second))
}

/// The minutes with the deliveries at these times, too.
fn with_deliveries(minutes: Vec<Minute>, times: &[String]) -> Vec<Minute> {
    let mut all: BTreeMap<String, Minute> =
        minutes.into_iter().map(|minute| (minute.at.clone(), minute)).collect();
    for at in times.iter().map(|time| minute_with(time)) {
        all.entry(at.clone()).or_insert(Minute { at, delivered: 0, rejected: 0 }).delivered += 1;
    }
    all.into_values().collect()
}

/// What a station remembers for its status.
pub(crate) struct StatusBoard {
    station: String,
    since: String,
    done: Done,
    /// Deliveries and rejections of the last hour.
    minutes: Vec<Minute>,
    finished: VecDeque<Finished>,
    rejections: VecDeque<Rejection>,
    next: Moment,
    heartbeat: Moment,
    /// The last written status, without its time.
    last: Option<Status>,
    complained: bool,
}

/// The state of the station that the status shows.
pub(crate) struct View<'a> {
    pub(crate) drops: &'a Drops,
    pub(crate) under_way: Vec<UnderWay>,
    /// The drops whose drawings are delivered, and that are filed later.
    pub(crate) delivered: BTreeSet<String>,
    /// The number of outdated drawings, and the first [`LISTED`] of them.
    pub(crate) outdated: (usize, Vec<(String, Sku)>),
    pub(crate) uncertain: Vec<UncertainDrawing>,
    pub(crate) kept: Option<Kept>,
    pub(crate) troubles: Vec<String>,
    pub(crate) fleet: Option<FleetSeen>,
    pub(crate) now: Moment,
    pub(crate) alive: bool,
}

impl StatusBoard {
    /// Starts with the last hour and the finished and rejected drops from the previous status, if that can be read. A station that
    /// was interrupted may not have written its last deliveries: `delivered` gives the times of those in the journal after a time.
    pub(crate) fn new(station: &Station, state: &Path, delivered: impl FnOnce(&str) -> Vec<String>) -> Self {
        let before = Status::read(state).ok().flatten();
        let hour_ago = last_hour(SystemTime::now()).0;
        let from = before.as_ref().map_or(hour_ago.clone(), |status| status.at.clone().max(hour_ago));
        let (minutes, finished, rejections) =
            before.map(|status| (status.minutes, status.finished, status.rejections)).unwrap_or_default();
        let minutes = with_deliveries(minutes, &delivered(&from));
        Self {
            station: station.name.clone(),
            since: clock::now(),
            done: Done::default(),
            minutes,
            finished: finished.into(),
            rejections: rejections.into(),
            next: Moment::ZERO,
            heartbeat: Moment::ZERO,
            last: None,
            complained: false,
        }
    }

    pub(crate) fn follow(&mut self, station: &Station) {
        self.station = station.name.clone();
    }

    pub(crate) fn finished(&mut self, drop: &DropId, work: &Work, result: FinishedAs) {
        match result {
            FinishedAs::Delivered | FinishedAs::DeliveredAgain => {
                self.done.delivered += 1;
                self.minute().delivered += 1;
            }
            FinishedAs::Learned => self.done.learned += 1,
            FinishedAs::Repeated | FinishedAs::Uncertain | FinishedAs::HandedOver => {}
        }
        let drawing = match work {
            Work::Correct { name, .. } | Work::CorrectAgain { name, .. } => Some(name.clone()),
            Work::Learn(_) | Work::Restore(_) | Work::Reject(_) => None,
        };
        let sku = work.sku().map(Sku::to_string).unwrap_or_default();
        let drop = drop.to_string();
        // What was wrong with the drop before no longer matters.
        self.rejections.retain(|rejection| rejection.drop != drop);
        self.finished.push_front(Finished { at: clock::now(), drop, sku, drawing, result });
        self.finished.truncate(FINISHED);
    }

    pub(crate) fn rejected(&mut self, drop: &str, reason: &Reason) {
        self.done.rejected += 1;
        self.minute().rejected += 1;
        self.rejections.push_front(Rejection { at: clock::now(), drop: drop.into(), reason: reason.clone() });
        self.rejections.truncate(ERRORS);
    }

    pub(crate) fn is_due(&self, now: Moment) -> bool {
        now >= self.next
    }

    /// Writes the status, and returns it; `None` if it is unchanged and need not be written yet.
    pub(crate) fn write(&mut self, state: &Path, view: &View) -> Option<Status> {
        self.next = view.now + SHORTEST_INTERVAL;
        let mut status = self.status(view);
        if self.last.as_ref() == Some(&status) && view.now < self.heartbeat {
            return None;
        }
        self.heartbeat = view.now + LONGEST_INTERVAL;
        self.last = Some(status.clone());
        status.at = clock::now();
        let mut bytes = serde_json::to_vec_pretty(&status).ok()?;
        bytes.push(b'\n');
        match write_whole_unsynced(state, FILE, &bytes) {
            Ok(()) => self.complained = false,
            Err(error) => {
                if !std::mem::replace(&mut self.complained, true) {
                    tracing::warn!("cannot write the status: {error}");
                }
            }
        }
        Some(status)
    }

    fn status(&mut self, view: &View) -> Status {
        let now = SystemTime::now();
        let (oldest, newest) = last_hour(now);
        // If the clock was set back, minutes in the future would be kept for too long.
        self.minutes.retain(|minute| oldest <= minute.at && minute.at <= newest);
        let mut done = self.done.clone();
        done.count_last_hour(&self.minutes, now);
        let running = |drop: &Waiting| view.under_way.iter().any(|job| job.drop == drop.drop);
        let (mut waiting, incomplete) = view.drops.left();
        let waits = |list: Vec<Waiting>| {
            let waits = |waiting: Waiting| Waits { drop: waiting.drop, reason: waiting.reason };
            listed(list.into_iter().map(waits).collect())
        };
        // What belongs to a delivered drawing is neither copied nor queued.
        waiting.retain(|drop| !view.delivered.contains(&drop.drop));
        // A waiting drop is listed as waiting while it is tried again. A drop that is being read is not listed as
        // incomplete.
        waiting.retain(|drop| drop.waits_for != WaitsFor::Turn || !running(drop));
        let incomplete = incomplete
            .into_iter()
            .filter(|drop| !running(drop) && !view.delivered.contains(&drop.drop))
            .collect();
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
            minutes: self.minutes.clone(),
            troubles: view.troubles.clone(),
            under_way: view.under_way.clone(),
            waiting: waits(waiting),
            incomplete: waits(incomplete),
            outdated: Listed { count: *count, first: outdated.collect() },
            uncertain: listed(view.uncertain.clone()),
            finished: self.finished.iter().cloned().collect(),
            rejections: self.rejections.iter().cloned().collect(),
            kept: view.kept.clone(),
            fleet: view.fleet.clone(),
        }
    }

    fn minute(&mut self) -> &mut Minute {
        let at = minute_of(SystemTime::now());
        if self.minutes.last().is_none_or(|minute| minute.at != at) {
            self.minutes.push(Minute { at, delivered: 0, rejected: 0 });
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
    fn a_station_has_four_states_seen_from_outside() {
        let at = SystemTime::UNIX_EPOCH + Duration::from_secs(1_767_225_600);
        let bytes = serde_json::json!({
            "schema": SCHEMA, "station": "test", "running": true, "at": clock::timestamp(at), "since": "",
            "done": Done::default(), "under_way": [], "rejections": [],
            "waiting": {"count": 0, "first": []}, "incomplete": {"count": 0, "first": []},
            "outdated": {"count": 0, "first": []},
        });
        // A status of an older version has no `troubles`.
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

    /// GNU date: 1767225600 is 2026-01-01T00:00:00Z.
    #[test]
    fn the_last_hour_is_that_before_the_look() {
        let midnight = SystemTime::UNIX_EPOCH + Duration::from_secs(1_767_225_600);
        let minute = |at: &str, delivered, rejected| Minute { at: at.into(), delivered, rejected };
        let minutes = [
            minute("2025-12-31T23:05:00Z", 1, 10),
            minute("2026-01-01T00:00:00Z", 2, 20),
            minute("2026-01-01T00:30:00Z", 4, 40),
        ];
        for (later, delivered) in [(0, 3), (1800, 6), (3659, 6), (3660, 4), (7300, 0)] {
            let mut done = Done::default();
            done.count_last_hour(&minutes, midnight + Duration::from_secs(later));
            assert_eq!(
                (done.delivered_last_hour, done.rejected_last_hour),
                (delivered, 10 * delivered),
                "{later}"
            );
        }
    }
}
