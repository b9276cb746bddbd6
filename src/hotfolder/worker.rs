//! The station at work: hears, lists, hands out jobs to its threads, and takes in what became of them.
//!
//! One thread knows all drops and decides; the jobs themselves are done by others ([`Executor`]). Jobs of one SKU are
//! done one after the other, parts first and then in the order in which the drops came; jobs of different SKUs side by
//! side. Large jobs never take all threads, so that a small one has to wait for a small one at most.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use super::delivery::{self, IMPORT_MISSING};
use super::drops::{Block, Drops};
use super::executor::{End, Executor, Kept, Outcome, Task, Work, guarded};
use super::filing::{self, with_slashes};
use super::folders::{self, Found};
use super::intake::sidecar_of;
use super::job::{Corrector, JobError, Mode, Pulse, StationError, Tally};
use super::journal::{Journal, OpenJob};
use super::lock::StationLock;
use super::names::{Meaning, delivered_as, is_ignored, is_sidecar};
use super::reprocess::{ARCHIVE, Reprocessing};
use super::requests::{self, Request};
use super::settle::{Moment, SettleTimes, Stamp, Verdict, Writer};
use super::status::StatusBoard;
use super::watcher::{Message, Signal, StopSignal, Watcher};
use crate::config::{Backend, FolderPaths, JobSettings, LiveSettings, SettingsEvent, Sku};
use crate::diff;
use crate::formats::pattern::is_picture;
use crate::reason::Reason;

/// How long an incomplete file is waited for after its writer closed it: some programs write in two goes.
const INCOMPLETE_AFTER_CLOSE: Duration = Duration::from_secs(3);
/// How often a hot folder that vanished is looked for.
const MISSING_FOLDER_LOOK: Duration = Duration::from_millis(500);
/// How often a folder on a network is listed, which tells of no other computer's files.
const NETWORK_LISTING: Duration = Duration::from_secs(1);
/// The station wakes at least this often, to say that it is alive and to look for requests.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// The pause after the first failure of something around a job; it doubles with each further failure.
const FIRST_PAUSE: Duration = Duration::from_millis(250);
/// The longest pause between two tries, so that a healed folder is noticed soon.
const LONGEST_PAUSE: Duration = Duration::from_secs(10);
/// Events that may wait to be heard; when there are more, the folder is listed instead.
const MOST_MESSAGES: usize = 4096;
/// A drop of this size or more is a large job, bytes: its fit takes seconds.
const LARGE: u64 = 4 << 20;
/// Delivered drawings whose reports and previews are held in memory until they can be filed.
const MOST_KEPT: usize = 200;
/// How long after a pattern was delivered settings for it are told to have come too late.
const LATE_SIDECAR: Duration = Duration::from_secs(10);
/// The greatest number of threads that is of use.
const MOST_THREADS: usize = 64;

/// Runs a station: once over what lies there, or until it is stopped. `pulse` is called when the station is ready, at
/// least every second as long as it is alive, and when it stops.
///
/// # Errors
/// When another process runs the station, one of its own folders cannot be made or written, or a job says that nothing
/// can be done any more. Whatever goes wrong with a single drop is no error: the drop is rejected or waits.
pub fn run(
    settings: LiveSettings,
    corrector: &impl Corrector,
    stop: &StopSignal,
    mode: Mode,
    pulse: &mut dyn FnMut(Pulse),
) -> Result<Tally, StationError> {
    let station = settings.station().clone();
    filing::prepare(&station.folders).map_err(|(purpose, path, source)| StationError::Folder {
        purpose,
        path,
        source,
    })?;
    filing::prepare_skus(&station).map_err(|source| StationError::Folder {
        purpose: "skus",
        path: station.folders.skus.clone(),
        source,
    })?;
    let state = station.folders.state.clone();
    let _lock = StationLock::take(&state, &station.name)?;
    let journal =
        Journal::open(&state).map_err(|source| StationError::Journal { path: state.clone(), source })?;
    let executor = Executor::new(corrector, journal);
    let (sender, messages) = sync_channel(MOST_MESSAGES);
    stop.connect(sender.clone());
    let threads = threads(station.watch.jobs);
    let (tasks, taken) = sync_channel(threads);
    let taken = Mutex::new(taken);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let (taken, executor, sender) = (&taken, &executor, sender.clone());
            scope.spawn(move || labour(taken, executor, &sender));
        }
        let mut worker = Worker {
            settings,
            executor: &executor,
            stop,
            mode,
            state,
            messages,
            tasks,
            threads,
            watcher: Watcher::new(sender),
            drops: Drops::default(),
            lanes: BTreeMap::new(),
            lanes_made: Moment::ZERO,
            stale: true,
            running: BTreeMap::new(),
            started: Instant::now(),
            next_listing: Moment::ZERO,
            hot_is_missing: false,
            troubles: Vec::new(),
            complaints: Complaints::default(),
            not_again: BTreeMap::new(),
            kept: BTreeMap::new(),
            late_companions: BTreeMap::new(),
            late_sidecars: BTreeMap::new(),
            reprocessing: Reprocessing::default(),
            status: StatusBoard::new(&station),
            tally: Tally::default(),
            stopped: None,
        };
        worker.introduce();
        pulse(Pulse::Ready);
        worker.work_until_done(pulse);
        pulse(Pulse::Stopping);
        worker.write_status(false);
        // The threads end when nothing can come any more.
        let Worker { drops, tally, stopped, .. } = worker;
        let (waiting, incomplete) = drops.left();
        match stopped {
            Some(reason) => Err(StationError::Stopped(reason)),
            None => Ok(Tally { waiting, incomplete, ..tally }),
        }
    })
}

/// As many as the machine has, or as the settings say; at least two, so that a large job blocks no small one.
fn threads(asked: Option<usize>) -> usize {
    let cores = std::thread::available_parallelism().map_or(2, usize::from);
    asked.unwrap_or(cores).clamp(2, MOST_THREADS)
}

/// Does jobs as long as any come.
fn labour<C: Corrector>(
    tasks: &Mutex<Receiver<Task>>,
    executor: &Executor<'_, C>,
    sender: &SyncSender<Message>,
) {
    loop {
        let next = tasks.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(task) = next else { return };
        let path = task.path.clone();
        let end = guarded(|| Ok(executor.perform(task))).unwrap_or_else(|error| match error {
            JobError::Rejected(reason) | JobError::Retry(reason) | JobError::Stop(reason) => {
                End { outcome: Outcome::Retry(reason, None), went_along: Vec::new() }
            }
        });
        if sender.send(Message::Finished(path, Box::new(end))).is_err() {
            return;
        }
    }
}

/// A station at work.
struct Worker<'a, C> {
    settings: LiveSettings,
    executor: &'a Executor<'a, C>,
    stop: &'a StopSignal,
    mode: Mode,
    /// The state folder in which lock and journal are, whatever the settings say later.
    state: PathBuf,
    messages: Receiver<Message>,
    tasks: SyncSender<Task>,
    threads: usize,
    watcher: Watcher,
    drops: Drops,
    /// What can be done now, for each SKU in its order; without a SKU each drop for itself.
    lanes: BTreeMap<Option<Sku>, VecDeque<PathBuf>>,
    /// What was due by this moment is in the lanes.
    lanes_made: Moment,
    /// Something happened since the lanes were made.
    stale: bool,
    running: BTreeMap<PathBuf, Running>,
    started: Instant,
    next_listing: Moment,
    hot_is_missing: bool,
    /// What the last listing found wrong with the hot folder itself.
    troubles: Vec<String>,
    /// Complaints about the hot folder itself.
    complaints: Complaints,
    /// Why outdated drawings are not corrected again yet, as it was last told.
    not_again: BTreeMap<String, String>,
    /// Patterns whose result is delivered while report or original could not be filed yet.
    kept: BTreeMap<PathBuf, Kept>,
    /// Companions that were not there when their part was done: until when they may follow it, and where it went.
    late_companions: BTreeMap<PathBuf, (Moment, PathBuf)>,
    /// The places of settings beside patterns that were done without any: until when they are told to be late.
    late_sidecars: BTreeMap<PathBuf, Moment>,
    reprocessing: Reprocessing,
    status: StatusBoard,
    tally: Tally,
    stopped: Option<Reason>,
}

/// A job that a thread is at.
pub(super) struct Running {
    pub(super) drop: String,
    pub(super) work: Work,
    pub(super) since: Moment,
    stamp: Stamp,
    large: bool,
}

impl Running {
    fn sku(&self) -> Option<&Sku> {
        match &self.work {
            Work::Learn(sku) | Work::Correct { sku, .. } | Work::CorrectAgain { sku, .. } => Some(sku),
            Work::Nothing => None,
        }
    }
}

impl<C: Corrector> Worker<'_, C> {
    fn work_until_done(&mut self, pulse: &mut dyn FnMut(Pulse)) {
        loop {
            let ends = self.stop.is_raised() || self.stopped.is_some();
            if !ends {
                self.refresh_settings();
                if self.now() >= self.next_listing {
                    self.list();
                }
                self.take_requests();
                self.look_for_outdated();
                self.hand_out();
            }
            pulse(Pulse::Alive);
            if self.running.is_empty() && (ends || (self.mode == Mode::Once && self.is_idle())) {
                return;
            }
            self.write_status(true);
            let now = self.now();
            let mut next = self.next_listing.min(now + HEARTBEAT);
            let mut due = Moment::MAX;
            if !ends && self.running.len() < self.threads {
                // What is ready and cannot begin waits for a job to finish, which is heard.
                due = self.drops.next_due(self.lanes_made, &self.times()).unwrap_or(due);
                next = next.min(due);
            }
            match self.messages.recv_timeout(next.saturating_sub(now).max(Duration::from_millis(1))) {
                Ok(message) => self.hear(message),
                // Something may have settled or healed.
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => self.stale = true,
            }
            self.stale |= due <= self.now();
        }
    }

    fn is_idle(&self) -> bool {
        let now = self.now();
        self.lanes.is_empty() && self.reprocessing.is_idle(now) && !self.drops.any_settles(now, &self.times())
    }

    fn introduce(&self) {
        let station = self.settings.station();
        tracing::info!("{} takes drops from {}", station.name, station.folders.hot.display());
        if !station.folders.import.is_dir() {
            let import = station.folders.import.display();
            tracing::warn!(
                "the import folder {import} does not exist; corrected drawings wait until it does"
            );
        }
    }

    /// Gives every free thread something to do.
    fn hand_out(&mut self) {
        if self.stale || self.lanes.is_empty() {
            self.make_lanes();
        }
        while self.running.len() < self.threads {
            let Some(path) = self.next_in_lanes() else { break };
            self.begin(&path);
        }
        while self.running.len() < self.threads {
            let busy: BTreeSet<Sku> =
                self.running.values().filter_map(|running| running.sku().cloned()).collect();
            let Some(again) = self.reprocessing.next(self.now(), &busy) else { break };
            self.correct_again(again);
        }
    }

    fn make_lanes(&mut self) {
        self.stale = false;
        self.lanes.clear();
        self.lanes_made = self.now();
        for (sku, path) in self.drops.ready(self.lanes_made, &self.times()) {
            if !self.running.contains_key(&path) {
                self.lanes.entry(sku).or_default().push_back(path);
            }
        }
    }

    fn is_busy(&self, sku: &Sku) -> bool {
        self.running.values().any(|running| running.sku() == Some(sku))
    }

    /// The first drop whose SKU is free and that is small enough for the threads that are left.
    fn next_in_lanes(&mut self) -> Option<PathBuf> {
        let large_too = self.running.values().filter(|running| running.large).count() + 1 < self.threads;
        let mut found = None;
        for (sku, lane) in &self.lanes {
            let Some(first) = lane.front() else { continue };
            let size = self.drops.get(first).map_or(0, |drop| drop.settle.stamp().size);
            if sku.as_ref().is_none_or(|sku| !self.is_busy(sku)) && (large_too || size < LARGE) {
                found = Some(sku.clone());
                break;
            }
        }
        let lane = self.lanes.get_mut(found.as_ref()?)?;
        let path = lane.pop_front();
        if lane.is_empty() {
            self.lanes.remove(&found?);
        }
        path
    }

    /// Begins the job of one drop that is ready, or says what it waits for.
    fn begin(&mut self, path: &Path) {
        let (now, times) = (self.now(), self.times());
        let Some(drop) = self.drops.get(path) else { return };
        let (last_chance, doomed) = match drop.settle.verdict(now, &times) {
            Verdict::Wait(_) => return,
            Verdict::Read => (false, None),
            Verdict::GiveUp(super::settle::Gap::Companion) => (true, None),
            Verdict::GiveUp(super::settle::Gap::Content) => {
                (true, Some(drop.reason.clone().unwrap_or_else(cut_short)))
            }
        };
        let (work, doomed) = match drop.meaning.clone() {
            Ok(Meaning::Companion) => return self.companion(path),
            // A texture of a part that was done before it came.
            Ok(_)
                if is_picture(&drop.relative.to_string_lossy())
                    && self.late_companions.contains_key(path) =>
            {
                return self.companion(path);
            }
            Ok(Meaning::Part(sku)) => (Work::Learn(sku), doomed),
            Ok(Meaning::Pattern { sku, name }) => (Work::Correct { sku, name }, doomed),
            Err(reason) => (Work::Nothing, Some(reason)),
        };
        if let Work::Correct { sku, .. } = &work
            && self.drops.has_part(sku)
        {
            return self.wait(path, Block::PartUnderWay, part_under_way(sku));
        }
        let (relative, stamp) = (drop.relative.clone(), drop.settle.stamp());
        let waits_for_import = drop.reason.as_ref().is_some_and(|reason| reason.code == IMPORT_MISSING);
        self.start(path, relative, work, stamp, Chance { last_chance, doomed, waits_for_import });
    }

    fn start(&mut self, path: &Path, relative: PathBuf, work: Work, stamp: Stamp, chance: Chance) {
        let settings = match &work {
            Work::Learn(sku) | Work::Correct { sku, .. } | Work::CorrectAgain { sku, .. } => {
                match self.job_settings(sku) {
                    Ok(settings) => settings,
                    Err(reason) => return self.retry_later(path, reason),
                }
            }
            Work::Nothing => JobSettings::default(),
        };
        let running = Running {
            drop: with_slashes(&relative),
            work: work.clone(),
            since: self.now(),
            stamp,
            large: stamp.size >= LARGE,
        };
        let task = Task {
            path: path.into(),
            relative,
            work,
            station: self.settings.station().clone(),
            settings,
            stamp,
            last_chance: chance.last_chance,
            doomed: chance.doomed,
            settling: self.drops.settling_beside(path, self.now(), &self.times()),
            waits_for_import: chance.waits_for_import,
            kept: self.kept.remove(path),
        };
        if let Work::Correct { sku, .. } | Work::CorrectAgain { sku, .. } = &running.work {
            if self.drops.has_part(sku) { self.executor.part_came(sku) } else { self.executor.begins(sku) }
        }
        self.running.insert(path.into(), running);
        if self.tasks.send(task).is_err() {
            self.running.remove(path);
        }
    }

    fn correct_again(&mut self, again: super::reprocess::Again) {
        let look = folders::look(&again.original);
        let Ok(Some(Found::File(stamp))) = look else {
            tracing::warn!("{} cannot be corrected again: its original is not in the archive", again.name);
            return self.reprocessing.forget(&again.name);
        };
        let relative = PathBuf::from(again.drop());
        // The archived original bears the pattern's name.
        let name = again.original.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let work = Work::CorrectAgain { sku: again.sku, name };
        let chance = Chance { last_chance: true, doomed: None, waits_for_import: false };
        self.start(&again.original, relative, work, stamp, chance);
    }

    /// A job is over.
    fn finished(&mut self, path: &Path, outcome: Outcome, went_along: &[PathBuf]) {
        let Some(running) = self.running.remove(path) else { return };
        went_along.iter().for_each(|companion| self.look_again(companion));
        let same = self.drops.get(path).is_some_and(|drop| drop.settle.stamp() == running.stamp);
        if let Work::CorrectAgain { sku, name } = &running.work {
            return self.finished_again(sku, &delivered_as(name), outcome);
        }
        // Whatever else happened may let other drops go on.
        self.stale |= !matches!(outcome, Outcome::Delivered | Outcome::Repeated);
        match outcome {
            Outcome::Learned { absent, place } => {
                let until = self.now() + self.times().incomplete;
                self.late_companions.extend(absent.into_iter().map(|path| (path, (until, place.clone()))));
                self.tally.learned += 1;
                self.status.learned();
                self.done(path);
                if let Some(sku) = running.sku() {
                    self.drops.release(sku);
                    self.reprocessing.check(sku.clone());
                }
            }
            Outcome::Delivered => {
                self.tally.delivered += 1;
                self.status.delivered();
                if let Work::Correct { name, .. } = &running.work {
                    self.reprocessing.forget(&delivered_as(name));
                    if let Some(sidecar) = sidecar_of(path).filter(|path| !went_along.contains(path)) {
                        self.late_sidecars.insert(sidecar, self.now() + LATE_SIDECAR);
                    }
                }
                self.done(path);
            }
            Outcome::Repeated => {
                self.tally.repeated += 1;
                self.done(path);
            }
            Outcome::Rejected(reason) => {
                self.tally.rejected += 1;
                self.status.rejected(&running.drop, &reason);
                self.done(path);
            }
            Outcome::Changed => self.look_again(path),
            Outcome::Incomplete { gap, reason, anew } => {
                let now = self.now();
                let Some(drop) = self.drops.get_mut(path).filter(|_| same) else { return };
                if anew {
                    drop.settle.wait_anew(now);
                }
                drop.settle.found_incomplete(gap);
                if drop.reason.as_ref() != Some(&reason) {
                    tracing::info!("{} is not complete yet: {}", running.drop, reason.what);
                    drop.reason = Some(reason);
                }
            }
            Outcome::NoSurface(reason) => self.wait(path, Block::UnknownSku, reason),
            Outcome::PartCame => {
                if let Some(sku) = running.sku() {
                    self.wait(path, Block::PartUnderWay, part_under_way(sku));
                }
            }
            Outcome::PartRefused(reason) => self.retry_later(path, reason),
            Outcome::Retry(reason, kept) => {
                // Without what is kept, the journal says how far the job came, and it is worked through again.
                if let Some(kept) = kept.filter(|_| self.kept.len() < MOST_KEPT) {
                    self.kept.insert(path.into(), *kept);
                }
                self.retry_later(path, reason);
            }
            Outcome::Stop(reason) => self.stopped = Some(reason),
        }
    }

    fn finished_again(&mut self, sku: &Sku, name: &str, outcome: Outcome) {
        let told = self.not_again.remove(name);
        match outcome {
            Outcome::Delivered | Outcome::Repeated => {
                self.tally.delivered += 1;
                self.status.delivered();
                self.reprocessing.forget(name);
            }
            Outcome::Rejected(reason) => {
                self.status.rejected(name, &reason);
                self.reprocessing.forget(name);
            }
            Outcome::Retry(reason, _) | Outcome::PartRefused(reason) | Outcome::NoSurface(reason) => {
                let (now, once) = (self.now(), self.mode == Mode::Once);
                self.reprocessing.again_later(name, now + LONGEST_PAUSE, once);
                if told.as_ref() != Some(&reason.what) {
                    tracing::warn!("{name} of {sku} is not corrected again yet: {}", reason.what);
                }
                self.not_again.insert(name.to_owned(), reason.what);
            }
            Outcome::Stop(reason) => self.stopped = Some(reason),
            // The part may come to nothing, and then it is as outdated as before.
            Outcome::PartCame => {
                self.reprocessing.forget(name);
                self.reprocessing.check(sku.clone());
            }
            Outcome::Learned { .. } | Outcome::Changed | Outcome::Incomplete { .. } => {
                self.reprocessing.forget(name);
            }
        }
    }

    /// A companion has settled: what it belongs to may go on, or went on without it before.
    fn companion(&mut self, path: &Path) {
        if let Some((_, place)) = self.late_companions.remove(path)
            && filing::follow(path, &place).is_ok()
        {
            self.drops.forget(path);
            return;
        }
        self.drops.companion_came(path);
        self.stale = true;
        let is_late = self.late_sidecars.remove(path).is_some();
        if let Some(drop) = self.drops.get_mut(path) {
            drop.block = Block::Unclaimed;
            drop.reason = Some(if is_late {
                let what = "The settings came after their pattern, which was delivered without them.";
                let remedy = "Drop the pattern again; next time drop its settings first.";
                let reason = Reason::new("sidecar-late", what, remedy);
                tracing::warn!("{}: {}", with_slashes(&drop.relative), reason.on_one_line());
                reason
            } else if is_sidecar(path) {
                let what = "The settings wait for the pattern of the same name.";
                Reason::new("waits-for-pattern", what, "Drop the pattern (again), or remove the file.")
            } else {
                let what = "The file waits for the part that names it.";
                Reason::new("waits-for-part", what, "Drop the part, or remove the file if nothing needs it.")
            });
        }
    }

    /// The drop is done. Should another file bear its name by now, that is a new drop.
    fn done(&mut self, path: &Path) {
        self.drops.forget(path);
        self.look_again(path);
    }

    /// Takes the file as it is now, or forgets it when it is gone.
    fn look_again(&mut self, path: &Path) {
        let hot = self.folders().hot.clone();
        match folders::look(path) {
            Ok(Some(what)) => {
                self.see(&hot, path, what, Writer::Unknown);
            }
            _ => self.drops.forget(path),
        }
    }

    fn wait(&mut self, path: &Path, block: Block, reason: Reason) {
        let Some(drop) = self.drops.get_mut(path) else { return };
        drop.block = block;
        if drop.reason.as_ref() != Some(&reason) {
            tracing::info!("{}: {}", with_slashes(&drop.relative), reason.on_one_line());
            drop.reason = Some(reason);
        }
    }

    fn retry_later(&mut self, path: &Path, reason: Reason) {
        let now = self.now();
        let once = self.mode == Mode::Once;
        let Some(drop) = self.drops.get_mut(path) else { return };
        let pause = match drop.block {
            Block::Until { pause, .. } => (pause * 2).min(LONGEST_PAUSE),
            _ => FIRST_PAUSE,
        };
        let moment = if once { Moment::MAX } else { now + pause };
        drop.block = Block::Until { moment, pause };
        if drop.reason.as_ref() != Some(&reason) {
            tracing::warn!("{} waits: {}", with_slashes(&drop.relative), reason.on_one_line());
            drop.reason = Some(reason);
        }
    }

    fn job_settings(&mut self, sku: &Sku) -> Result<JobSettings, Reason> {
        let settings = self.settings.job(sku).map_err(|error| error.reason());
        self.tell_settings_events();
        settings
    }

    fn folders(&self) -> &FolderPaths {
        &self.settings.station().folders
    }

    fn now(&self) -> Moment {
        self.started.elapsed()
    }

    fn times(&self) -> SettleTimes {
        let watch = &self.settings.station().watch;
        SettleTimes {
            still: watch.settle,
            // Windows lets nobody read what somebody has open to write.
            open_ended: if cfg!(windows) { watch.settle } else { watch.open_ended.min(watch.incomplete) },
            incomplete: watch.incomplete,
            incomplete_after_close: INCOMPLETE_AFTER_CLOSE,
        }
    }

    fn refresh_settings(&mut self) {
        self.settings.refresh();
        self.tell_settings_events();
    }

    fn tell_settings_events(&mut self) {
        for event in self.settings.take_events() {
            match event {
                SettingsEvent::StationChanged { old, new } => {
                    tracing::info!(
                        "the station's settings changed and are in force:\n{}",
                        changes(&old, &new)
                    );
                    if let Err((purpose, _, error)) = filing::prepare(self.folders()) {
                        tracing::warn!("the {purpose} folder cannot be made: {error}");
                    }
                    let station = self.settings.station();
                    if station.folders.state != self.state {
                        tracing::warn!(
                            "`folders.state` counts from the next start on; until then it is {}",
                            self.state.display()
                        );
                    }
                    if threads(station.watch.jobs) != self.threads {
                        tracing::warn!("`watch.jobs` counts from the next start on");
                    }
                    self.executor.corrector.follow(station);
                    self.status.follow(station);
                    self.reprocessing.check_all();
                    self.next_listing = Moment::ZERO;
                }
                SettingsEvent::SkuChanged { sku, old, new } => {
                    tracing::info!(
                        "the settings of {sku} changed and are in force:\n{}",
                        changes(&old, &new)
                    );
                    self.drops.release(&sku);
                    self.reprocessing.check(sku);
                }
                SettingsEvent::Broken(error) => tracing::error!("{error} The old settings stay in force."),
            }
        }
    }

    /// Lists the hot folder: whatever events said or did not say, this is how it is.
    fn list(&mut self) {
        let watch = self.settings.station().watch.clone();
        let hot = self.folders().hot.clone();
        let now = self.now();
        self.complaints.next_round();
        self.settings.refresh_skus();
        self.tell_settings_events();
        self.late_companions.retain(|_, (until, _)| now < *until);
        self.late_sidecars.retain(|_, until| now < *until);
        let (backend, interval) = match watch.backend {
            _ if self.mode == Mode::Once => (Backend::Poll, watch.rescan),
            Backend::Auto if folders::is_on_network(&hot) => {
                self.tell_once(format!(
                    "{} is on a network, which tells of no other computer's files: it is listed every {} s",
                    hot.display(),
                    watch.rescan.min(NETWORK_LISTING).as_secs_f64()
                ));
                (Backend::Poll, watch.rescan.min(NETWORK_LISTING))
            }
            Backend::Auto => (Backend::Native, watch.rescan),
            chosen => (chosen, watch.rescan),
        };
        self.next_listing = now + interval;
        self.troubles.clear();
        if !self.watcher.follow(&hot, backend) {
            self.troubles.push(format!("the hot folder {} is gone", hot.display()));
            if !self.hot_is_missing {
                tracing::error!("the hot folder {} is gone; waiting for it to come back", hot.display());
            }
            self.hot_is_missing = true;
            self.drops = Drops::default();
            self.next_listing = self.now() + watch.rescan.min(MISSING_FOLDER_LOOK);
            return;
        }
        if std::mem::take(&mut self.hot_is_missing) {
            tracing::info!("the hot folder {} is back", hot.display());
        }
        let listing = match folders::list(&hot) {
            Ok(listing) => listing,
            Err(error) => return self.trouble(format!("the hot folder cannot be listed: {error}")),
        };
        for error in &listing.unseen {
            self.trouble(format!("something in the hot folder cannot be looked at: {error}"));
        }
        for folder in &listing.too_deep {
            self.trouble(format!("{} is a folder in a SKU's folder; nobody looks into it", folder.display()));
        }
        let mut found = BTreeSet::new();
        for (path, what) in listing.drops {
            self.see(&hot, &path, what, Writer::Unknown);
            found.insert(path);
        }
        self.drops.keep_only(&found);
        self.kept.retain(|path, _| found.contains(path));
        self.close_what_was_interrupted(&hot);
        for sku in self.drops.awaited() {
            // What is wrong with the settings or the surface is told when the pattern's turn comes.
            let known =
                self.settings.job(&sku).map(|settings| self.executor.corrector.knows(&sku, &settings));
            let archived = filing::current_part(self.folders(), &sku).is_some();
            if !matches!(known, Ok(false)) || archived {
                self.drops.release(&sku);
            }
        }
        self.tell_settings_events();
    }

    /// Jobs that were begun and whose drop is gone were interrupted after their last step: they are closed.
    fn close_what_was_interrupted(&mut self, hot: &Path) {
        let station = self.settings.station().clone();
        let running: BTreeSet<&str> = self.running.values().map(|running| running.drop.as_str()).collect();
        let mut journal = self.executor.journal();
        let identity = folders::identity(hot);
        journal.hot_is(identity);
        for (drop, open) in journal.all_begun() {
            let there = matches!(folders::look(&hot.join(&drop)), Ok(Some(Found::File(stamp))) if open.stamp.is_of(stamp));
            if running.contains(drop.as_str()) || there {
                continue;
            }
            // An empty mount point, or another share: the drop may come back with the folder it lay in.
            if open.hot.is_some() && open.hot != identity && !drop.starts_with(ARCHIVE) {
                self.complaints.tell(format!(
                    "{drop} was interrupted, and the hot folder {} is another one than then: if a share is missing, \
                     connect it; the drop is done to its end when it is back",
                    hot.display()
                ));
                continue;
            }
            leftover_sidecar_follows(&station.folders, hot, &drop, &open);
            if let Err(JobError::Retry(reason)) = delivery::close(&station, &mut journal, &drop, &open) {
                self.complaints.tell(format!("{drop} was interrupted and cannot be closed: {}", reason.what));
            }
        }
        if !std::mem::replace(&mut self.status.swept, true) {
            delivery::sweep(&station.folders, &journal);
        }
    }

    /// Something is wrong with the hot folder itself.
    fn trouble(&mut self, words: String) {
        self.tell_once(words.clone());
        self.troubles.push(words);
    }

    fn tell_once(&mut self, words: String) {
        self.complaints.tell(words);
    }

    /// What people asked for from another terminal.
    fn take_requests(&mut self) {
        for request in requests::take(&self.state) {
            match request {
                Request::Waiting => {
                    self.drops.free_all();
                    self.reprocessing.free_all();
                    tracing::info!("what waits is tried again, as asked");
                }
                Request::Outdated(sku) => {
                    let count = self.reprocessing.correct_marked(sku.as_ref());
                    tracing::info!("{count} outdated drawings are corrected again, as asked");
                }
            }
            self.stale = true;
        }
    }

    /// Which delivered drawings would be others today.
    fn look_for_outdated(&mut self) {
        let skus = self.reprocessing.take_unchecked(|| self.executor.journal().skus());
        for sku in skus {
            if self.drops.has_part(&sku) || self.is_busy(&sku) {
                // A part that is learned asks for another look by itself; one that is not whole would hold up the end.
                if self.mode == Mode::UntilStopped || self.is_busy(&sku) {
                    self.reprocessing.check(sku);
                }
                continue;
            }
            let Ok(settings) = self.job_settings(&sku) else { continue };
            let station = self.settings.station().clone();
            self.reprocessing.look_at(self.executor, &station, &sku, &settings);
        }
    }

    fn write_status(&mut self, alive: bool) {
        let now = self.now();
        if !self.status.is_due(now) && alive {
            return;
        }
        let view = super::status::View {
            drops: &self.drops,
            running: &self.running,
            outdated: self.reprocessing.marked(),
            troubles: &self.troubles,
            now,
            alive,
        };
        self.status.write(&self.state, &view);
    }

    /// Takes in what was signalled, beginning with `first`.
    fn hear(&mut self, first: Message) {
        // For each path when it was first named, which is the order of the drops, and what its writer did last.
        let (mut hints, mut overflow) = (BTreeMap::new(), false);
        let (mut next, mut turn) = (Some(first), 0);
        while let Some(message) = next {
            match message {
                Message::Finished(path, end) => self.finished(&path, end.outcome, &end.went_along),
                Message::Signal(Signal::Touched(path)) => {
                    hints.entry(path).or_insert((turn, Writer::Unknown));
                }
                Message::Signal(Signal::Written(path)) => {
                    hints.entry(path).or_insert((turn, Writer::Open)).1 = Writer::Open;
                }
                Message::Signal(Signal::Closed(path)) => {
                    hints.entry(path).or_insert((turn, Writer::Closed)).1 = Writer::Closed;
                }
                Message::Signal(Signal::Overflow) => overflow = true,
                Message::Signal(Signal::Stop) => {}
            }
            next = self.messages.try_recv().ok();
            turn += 1;
        }
        if self.watcher.lost_events() {
            tracing::info!("more events than can be heard: the hot folder is listed");
            overflow = true;
        }
        let hot = self.folders().hot.clone();
        let mut hints: Vec<_> = hints.into_iter().collect();
        hints.sort_by_key(|(_, (turn, _))| *turn);
        for (path, (_, writer)) in hints {
            self.hint(&hot, &path, writer);
        }
        if overflow {
            self.drops.events_were_lost();
            self.next_listing = Moment::ZERO;
        }
    }

    /// Looks at one path that an event named.
    fn hint(&mut self, hot: &Path, path: &Path, writer: Writer) {
        let Ok(relative) = path.strip_prefix(hot) else {
            self.next_listing = Moment::ZERO;
            return;
        };
        let depth = relative.components().count();
        if relative.components().any(|part| is_ignored(&part.as_os_str().to_string_lossy())) || depth > 2 {
            return;
        }
        match folders::look(path) {
            Ok(Some(Found::Folder)) if writer == Writer::Closed && depth == 1 => {
                // A whole folder was renamed into place, so its files are whole, too.
                let entries = folders::entries(path, &mut Vec::new()).unwrap_or_default();
                for (path, what) in entries {
                    self.see(hot, &path, what, Writer::Closed);
                }
            }
            Ok(Some(Found::File(_) | Found::Other(_))) if depth == 0 => {}
            Ok(Some(what @ (Found::File(_) | Found::Other(_)))) => self.see(hot, path, what, writer),
            Ok(None) if depth > 0 => self.drops.forget(path),
            Ok(_) | Err(_) => self.next_listing = Moment::ZERO,
        }
    }

    fn see(&mut self, hot: &Path, path: &Path, what: Found, writer: Writer) {
        let still_for = match (self.mode, what) {
            // There is no later look, so the file's own time must tell how long it has stood still.
            (Mode::Once, Found::File(Stamp { modified: Some(modified), .. })) => {
                SystemTime::now().duration_since(modified).unwrap_or_default()
            }
            _ => Duration::ZERO,
        };
        let relative = path.strip_prefix(hot).unwrap_or(path);
        self.drops.see(hot, relative, what, writer, self.now(), still_for);
        if let Some(Ok(Meaning::Part(sku))) = self.drops.get(path).map(|drop| &drop.meaning)
            && self.is_busy(sku)
        {
            self.executor.part_came(sku);
        }
        self.stale = true;
    }
}

/// What is known of a drop's chances before it is read.
struct Chance {
    last_chance: bool,
    doomed: Option<Reason>,
    waits_for_import: bool,
}

/// Settings that an interruption left behind when their pattern went to the archive go there, too: the next pattern of
/// that name must not take them for its own. Should one lie there already, they are its own by now.
fn leftover_sidecar_follows(folders: &FolderPaths, hot: &Path, drop: &str, open: &OpenJob) {
    let (path, Some(to), Some(_)) = (hot.join(drop), &open.to, &open.job) else { return };
    let (Some(sidecar), Ok(sku), Ok(None)) =
        (sidecar_of(&path), open.sku.parse::<Sku>(), folders::look(&path))
    else {
        return;
    };
    let archived = folders.archive.join(sku.key()).join(to);
    if matches!(folders::look(&sidecar), Ok(Some(Found::File(_)))) && archived.exists() {
        let place = archived.parent().unwrap_or(&archived);
        if let Err(error) = filing::follow(&sidecar, place) {
            tracing::warn!("{} stays in the hot folder: {error}", sidecar.display());
        }
    }
}

/// What is wrong in each listing, told when it begins; what is healed and comes back is told again.
#[derive(Default)]
struct Complaints {
    /// Each with the round in which it was last heard of.
    told: BTreeMap<String, u64>,
    round: u64,
}

impl Complaints {
    fn tell(&mut self, words: String) {
        if !self.told.contains_key(&words) {
            tracing::warn!("{words}");
        }
        self.told.insert(words, self.round);
    }

    /// What the last round did not find any more has healed.
    fn next_round(&mut self) {
        self.told.retain(|_, round| *round == self.round);
        self.round += 1;
    }
}

/// The lines of a settings file that changed.
fn changes(old: &str, new: &str) -> String {
    diff::text_changes(old, new).join("\n")
}

fn part_under_way(sku: &Sku) -> Reason {
    let what = format!("The pattern waits for a part of {sku} that is not whole or not done yet.");
    Reason::new("waits-for-part", what, "Finish dropping the part.")
}

fn cut_short() -> Reason {
    Reason::new("cut-short", "The file ends too early.", "Export or copy it again.")
}
