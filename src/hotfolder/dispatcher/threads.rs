//! The threads that do the jobs, and the job of each.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ffi::OsString;
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crate::config::{Sku, fold};
use crate::hotfolder::api::Corrector;
use crate::hotfolder::error::guarded;
use crate::hotfolder::jobs::{End, Executor, Outcome, Task, Work};
use crate::hotfolder::seen::{Message, Moment, Stamp};
use crate::hotfolder::state::{DropId, UnderWay};

/// A job that takes this long is treated as a large one.
const LONG: Duration = Duration::from_secs(2);
/// A job whose pictures have waited for this long is continued before other drops.
const LONGEST_PAUSE: Duration = Duration::from_secs(30);
/// The largest number of jobs that pause: each keeps its original, its map and its lines in memory.
const MAX_PAUSED: usize = 1_000;
/// The largest size of their drawings, bytes; a job keeps about ten times as much.
const MAX_PAUSED_BYTES: usize = 16 << 20;

/// The loop of a thread: does jobs until the channel is closed.
pub(super) fn work<C: Corrector>(
    tasks: &Mutex<Receiver<Task>>,
    executor: &Executor<'_, C>,
    sender: &SyncSender<Message>,
) {
    loop {
        let next = tasks.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(task) = next else { return };
        let path = task.path.clone();
        let end = guarded(|| Ok(executor.perform(task))).unwrap_or_else(|error| End {
            outcome: Outcome::Retry(error.into_reason(), None),
            went_along: Vec::new(),
        });
        if sender.send(Message::Finished(path, Box::new(end))).is_err() {
            return;
        }
    }
}

/// All threads, and the jobs that pause.
pub(super) struct Threads {
    tasks: SyncSender<Task>,
    /// To as many spare threads, for small jobs while other jobs unexpectedly take long.
    spare_tasks: SyncSender<Task>,
    pub(super) count: usize,
    /// The jobs in threads, by the text of their paths: to compare paths part by part takes ten times as long, and many are looked
    /// up.
    running: BTreeMap<OsString, Running>,
    /// The jobs that pause before they draw pictures.
    paused: BTreeMap<OsString, Running>,
    /// The same in their order, with the moment when each began to pause.
    queue: VecDeque<(Moment, Task)>,
    /// Size of their drawings, bytes.
    paused_bytes: usize,
}

/// A job that a thread is doing, or that pauses.
pub(super) struct Running {
    pub(super) drop: DropId,
    pub(super) work: Work,
    pub(super) since: Moment,
    pub(super) stamp: Stamp,
    pub(super) large: bool,
    /// No other job runs at the same time.
    pub(super) alone: bool,
    /// How many companions had arrived when it started.
    pub(super) companions_arrived: u64,
    /// How often the settings had changed when it started.
    pub(super) settings_changes: u64,
    /// The drawing is already delivered, and is only filed.
    pub(super) was_delivered: bool,
    /// The delivery is counted already.
    pub(super) is_counted: bool,
    /// A spare thread does it.
    is_spare: bool,
    /// The folded name of the drawing that it makes.
    result: Option<String>,
}

impl Threads {
    pub(super) fn new(tasks: SyncSender<Task>, spare_tasks: SyncSender<Task>, count: usize) -> Self {
        let (running, paused) = (BTreeMap::new(), BTreeMap::new());
        Self { tasks, spare_tasks, count, running, paused, queue: VecDeque::new(), paused_bytes: 0 }
    }

    pub(super) fn are_idle(&self) -> bool {
        self.running.is_empty() && self.paused.is_empty()
    }

    /// The jobs in threads, and those that pause.
    fn all(&self) -> impl Iterator<Item = &Running> {
        self.running.values().chain(self.paused.values())
    }

    pub(super) fn is_at(&self, path: &Path) -> bool {
        self.running.contains_key(path.as_os_str()) || self.paused.contains_key(path.as_os_str())
    }

    pub(super) fn are_at(&self, drop: &DropId) -> bool {
        self.all().any(|running| running.drop == *drop)
    }

    /// The jobs of a SKU.
    pub(super) fn jobs_of<'t>(&'t self, sku: &'t Sku) -> impl Iterator<Item = &'t Running> {
        self.all().filter(move |running| running.sku() == Some(sku))
    }

    /// How many threads do jobs of a SKU.
    pub(super) fn count_of(&self, sku: &Sku) -> usize {
        self.running.values().filter(|running| running.sku() == Some(sku)).count()
    }

    /// Whether a job fits a part of the SKU, a dropped one or that in the archive.
    pub(super) fn are_fitting(&self, sku: &Sku) -> bool {
        self.jobs_of(sku).any(|running| matches!(running.work, Work::Learn(_) | Work::Restore(_)))
    }

    /// Whether the result with this folded name may be made now: no job fits a part of the SKU, and no job makes the
    /// same result.
    pub(super) fn may_make(&self, sku: &Sku, result: &str) -> bool {
        self.jobs_of(sku).all(|running| running.result.as_ref().is_some_and(|made| made != result))
    }

    pub(super) fn are_busy_with(&self, sku: &Sku) -> bool {
        self.jobs_of(sku).next().is_some()
    }

    /// The jobs that the status shows. A job that only rejects a drop is too short to be shown.
    pub(super) fn under_way(&self, now: Moment) -> Vec<UnderWay> {
        let jobs = self.running.values().filter(|running| running.sku().is_some());
        jobs.map(|running| UnderWay {
            drop: running.drop.to_string(),
            for_s: now.saturating_sub(running.since).as_millis() as f64 / 1e3,
        })
        .collect()
    }

    /// The drops whose drawings are delivered, and whose pictures and originals are due.
    pub(super) fn delivered(&self) -> BTreeSet<String> {
        self.paused.values().map(|paused| paused.drop.to_string()).collect()
    }

    /// Whether a thread is free for a job that is not known to be large. For each job that unexpectedly takes long, one
    /// more may run.
    pub(super) fn have_room(&self, now: Moment) -> bool {
        let takes_long = |running: &&Running| !running.large && now.saturating_sub(running.since) >= LONG;
        let spare = self.running.values().filter(takes_long).count().min(self.count);
        self.running.len() < self.count + spare && !self.running.values().any(|running| running.alone)
    }

    /// Whether one more large job leaves a thread to the small ones.
    pub(super) fn have_room_for_large(&self) -> bool {
        self.running.values().filter(|running| running.large).count() + 1 < self.count
    }

    /// Gives a job to a thread.
    pub(super) fn begin(&mut self, task: Task, mut running: Running) {
        running.is_spare = self.running.values().filter(|running| !running.is_spare).count() >= self.count;
        let tasks = if running.is_spare { &self.spare_tasks } else { &self.tasks };
        let path = task.path.clone().into_os_string();
        if tasks.send(task).is_ok() {
            self.running.insert(path, running);
        }
    }

    /// Keeps a job that pauses.
    pub(super) fn pause(&mut self, task: Task, now: Moment) {
        if let Some(mut running) = self.running.remove(task.path.as_os_str()) {
            running.is_counted |= task.unfiled.as_ref().is_some_and(|unfiled| unfiled.is_counted);
            self.paused_bytes += bytes_of_drawing(&task);
            self.paused.insert(task.path.clone().into_os_string(), running);
            self.queue.push_back((now, task));
        }
    }

    /// Whether one more job may pause.
    pub(super) fn may_pause(&self) -> bool {
        self.queue.len() < MAX_PAUSED && self.paused_bytes < MAX_PAUSED_BYTES
    }

    /// Whether a job has paused for so long that it is continued before other drops.
    pub(super) fn is_overdue(&self, now: Moment) -> bool {
        self.queue.front().is_some_and(|(since, _)| now.saturating_sub(*since) >= LONGEST_PAUSE)
    }

    /// Continues the job that has paused for the longest time; returns whether there is one.
    pub(super) fn resume(&mut self, now: Moment) -> bool {
        let Some((_, task)) = self.queue.pop_front() else { return false };
        self.paused_bytes = self.paused_bytes.saturating_sub(bytes_of_drawing(&task));
        if let Some(running) = self.paused.remove(task.path.as_os_str()) {
            self.begin(task, Running { since: now, ..running });
        }
        true
    }

    /// The job on this drop is over.
    pub(super) fn finished(&mut self, path: &Path) -> Option<Running> {
        self.running.remove(path.as_os_str())
    }
}

impl Running {
    /// A job that starts now.
    pub(super) fn of(task: &Task, since: Moment) -> Self {
        Self {
            drop: task.drop.clone(),
            work: task.work.clone(),
            since,
            stamp: task.stamp,
            large: false,
            alone: false,
            companions_arrived: 0,
            settings_changes: 0,
            was_delivered: task.unfiled.is_some(),
            is_counted: task.unfiled.as_ref().is_some_and(|unfiled| unfiled.is_counted),
            is_spare: false,
            result: task.work.result().map(|made| fold(&made)),
        }
    }

    pub(super) fn sku(&self) -> Option<&Sku> {
        self.work.sku()
    }
}

/// Size of the drawing whose pictures are due, bytes.
fn bytes_of_drawing(task: &Task) -> usize {
    task.unfiled.as_ref().map_or(0, |unfiled| unfiled.drawn_from)
}
