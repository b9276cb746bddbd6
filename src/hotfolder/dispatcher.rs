//! The station at work: hears, lists, hands out jobs to its threads, and takes in what became of them.
//!
//! One thread knows all drops and decides; the jobs themselves are done by others ([`Executor`]). A part is fitted while no
//! other job of its SKU is done. Drawings are done side by side, of one SKU, too; those with one result one after the other,
//! in the order in which the drops came. Every job that is not known to be large begins as a quick one, and is given up as soon as what it reads turns out
//! to be more than a moment's work; then it waits for its turn among the large ones, which never take all threads. So a
//! small one has to wait for small ones at most.

mod hand_out;
mod lanes;
mod late;
mod listing;
mod outcomes;
mod rounds;
mod threads;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};

use crate::config::{ConfigError, FolderPaths, JobSettings, LiveSettings, LogSettings, SettingsEvent, Sku};
use crate::diff;
use crate::hotfolder::api::{Corrector, Mode, Pulse, Tally};
use crate::hotfolder::error::{StationError, guarded};
use crate::hotfolder::jobs::{Executor, Keeper, Reprocessing, Unfiled, filing};
use crate::hotfolder::seen::{Drops, Message, Moment, SettleTimes, StopSignal, Watcher};
use crate::hotfolder::state::status::LISTED;
use crate::hotfolder::state::{
    Delivered, HotLock, Journal, Request, Shares, StationLock, StatusBoard, UncertainDrawing, requests,
};
use crate::reason::Reason;

use lanes::Lanes;
use late::Late;
use rounds::Rounds;
use threads::Threads;

/// How long an incomplete file is waited for after its writer closed it: some programs write in two goes.
const INCOMPLETE_AFTER_CLOSE: Duration = Duration::from_secs(3);
/// How long the station looks at delivered drawings before it sees to its drops again.
const LOOK: Duration = Duration::from_millis(20);
/// The station wakes at least this often, to say that it is alive and to look for requests.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// Events that may wait to be heard; when there are more, the folder is listed instead.
const MOST_MESSAGES: usize = 4096;
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
    let settings = if mode == Mode::Once { settings.at_once() } else { settings };
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
    let lock = StationLock::take(&state, &station.name)?;
    let journal =
        Journal::open(&state).map_err(|source| StationError::Journal { path: state.clone(), source })?;
    let known = uncertain_in(&journal);
    let executor = Executor::new(corrector, journal, Shares::open(&state), stop.clone());
    let (sender, messages) = sync_channel(MOST_MESSAGES);
    stop.connect(sender.clone());
    let count = threads(station.watch.jobs);
    let (tasks, taken) = sync_channel(count);
    // Memory that a thread had stays with it, so these only take what the others cannot.
    let (spare_tasks, taken_by_spare) = sync_channel(count);
    let keeper = Keeper::new(&station, &state, stop.clone());
    let (taken, taken_by_spare) = (Mutex::new(taken), Mutex::new(taken_by_spare));
    std::thread::scope(|scope| {
        for taken in [&taken, &taken_by_spare] {
            for _ in 0..count {
                let (executor, sender) = (&executor, sender.clone());
                scope.spawn(move || threads::work(taken, executor, &sender));
            }
        }
        let keeper = &keeper;
        // Their threads end with this one, however that ends.
        let _ends = keeper.ends_with_this();
        scope.spawn(|| {
            goes_on(|| keeper.keep_journal_short(|| executor.journal()), "keeps the journal short")
        });
        let cleaning = scope.spawn(|| {
            goes_on(|| keeper.run(|| executor.journal(), mode == Mode::Once), "removes old files");
        });
        let mut dispatcher = Dispatcher {
            settings,
            keeper,
            executor: &executor,
            stop,
            mode,
            lock,
            hot_lock: None,
            status: StatusBoard::new(&station, &state),
            state,
            log: station.log.clone(),
            messages,
            threads: Threads::new(tasks, spare_tasks, count),
            watcher: Watcher::new(sender),
            drops: Drops::default(),
            lanes: Lanes::new(executor.journal().suspects()),
            started: Instant::now(),
            rounds: Rounds::default(),
            unfiled: BTreeMap::new(),
            settings_changes: 0,
            late: Late::default(),
            next_look_at_parked: Moment::ZERO,
            reprocessing: Reprocessing::default(),
            tally: Tally::default(),
            stopped: None,
        };
        executor.parking.restore(&station.folders);
        dispatcher.introduce();
        executor.tell_of_older_form();
        pulse(Pulse::Ready);
        dispatcher.work_until_done(pulse);
        pulse(Pulse::Stopping);
        if mode == Mode::UntilStopped || stop.is_raised() || dispatcher.stopped.is_some() {
            keeper.end();
        }
        // What it removed is in the status.
        let _ = cleaning.join();
        keeper.end();
        dispatcher.write_status(false);
        let parked = executor.parking.count();
        if mode == Mode::Once && parked > 0 {
            tracing::info!(
                "files that are done and kept in case their writers go on: {parked}; the next start looks at them"
            );
        }
        // The threads end when nothing can come any more.
        let Dispatcher { drops, tally, stopped, .. } = dispatcher;
        let (waiting, incomplete) = drops.left();
        // Also what was filed without a job of its own.
        let uncertain = uncertain_in(&executor.journal()).difference(&known).count() as u64;
        match stopped {
            Some(reason) => Err(StationError::Stopped(reason)),
            None => Ok(Tally { waiting, incomplete, uncertain, ..tally }),
        }
    })
}

/// Does what a station can do without: a panic there ends nothing else.
fn goes_on(work: impl FnOnce(), what: &str) {
    let work = || {
        work();
        Ok(())
    };
    if guarded(work).is_err() {
        tracing::error!(
            "isomark no longer {what}, for a fault of its own: start the station again, and report this"
        );
    }
}

/// The drawings that may not have been delivered, each with the time when it was filed.
fn uncertain_in(journal: &Journal) -> BTreeSet<(String, String)> {
    journal.uncertain().map(|result| (result.job.name.clone(), result.at.clone())).collect()
}

/// As many as the machine has, or as the settings say; at least two, so that a large job blocks no small one.
fn threads(asked: Option<usize>) -> usize {
    let cores = std::thread::available_parallelism().map_or(2, usize::from);
    asked.unwrap_or(cores).clamp(2, MOST_THREADS)
}

/// A station at work.
struct Dispatcher<'a, C> {
    settings: LiveSettings,
    executor: &'a Executor<'a, C>,
    keeper: &'a Keeper,
    stop: &'a StopSignal,
    mode: Mode,
    lock: StationLock,
    hot_lock: Option<HotLock>,
    /// The state folder in which lock and journal are, whatever the settings say later.
    state: PathBuf,
    /// The log file that is written, whatever the settings say later.
    log: Option<LogSettings>,
    messages: Receiver<Message>,
    threads: Threads,
    watcher: Watcher,
    drops: Drops,
    lanes: Lanes,
    started: Instant,
    rounds: Rounds,
    /// Patterns whose result is delivered while report or original could not be filed yet.
    unfiled: BTreeMap<PathBuf, Unfiled>,
    /// How often the settings changed so far.
    settings_changes: u64,
    late: Late,
    next_look_at_parked: Moment,
    reprocessing: Reprocessing,
    status: StatusBoard,
    tally: Tally,
    stopped: Option<Reason>,
}

impl<C: Corrector> Dispatcher<'_, C> {
    fn work_until_done(&mut self, pulse: &mut dyn FnMut(Pulse)) {
        loop {
            let ends = self.stop.is_raised() || self.stopped.is_some();
            let mut looks_on = false;
            if !ends {
                self.refresh_settings();
                if self.now() >= self.rounds.due() {
                    self.list();
                }
                self.look_at_parked();
                self.take_requests();
                looks_on = self.look_for_outdated();
                self.hand_out();
            }
            pulse(Pulse::Alive);
            if self.threads.are_idle() && (ends || (self.mode == Mode::Once && self.is_idle())) {
                return;
            }
            self.write_status(true);
            let now = self.now();
            let mut next = now + HEARTBEAT;
            let mut due = Moment::MAX;
            // A station that ends does neither.
            if !ends {
                next = next.min(self.rounds.due());
            }
            if !ends && !self.executor.parking.is_empty() {
                next = next.min(self.next_look_at_parked.max(now));
            }
            if !ends && self.threads.have_room(now) {
                // What is ready and cannot begin waits for a job to finish, which is heard.
                due = self.drops.next_due(self.lanes.made, &self.times()).unwrap_or(due);
                next = if self.lanes.stale { now } else { next.min(due) };
            }
            if looks_on {
                next = now;
            }
            match self.messages.recv_timeout(next.saturating_sub(now).max(Duration::from_millis(1))) {
                Ok(message) => self.drain_events(message),
                // Something may have settled or healed.
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => self.lanes.stale = true,
            }
            self.lanes.stale |= due <= self.now();
        }
    }

    /// Somebody may have tidied up the state folder: without lock and journal a second station could start, and deliver
    /// again what this one delivered.
    fn keep_state(&mut self) {
        let state = self.state.display().to_string();
        match self.lock.keep_in_place(&self.state, &self.settings.station().name) {
            Ok(false) => {}
            Ok(true) => {
                tracing::error!(
                    "the state folder {state} was removed while the station ran; it is made anew"
                );
            }
            Err(StationError::Lock { source, .. }) => {
                return self
                    .rounds
                    .trouble(format!("the state folder {state} cannot be made anew: {source}"));
            }
            Err(error) => return self.stopped = Some(error.reason()),
        }
        if let Err(error) = self.executor.journal().keep_in_place() {
            self.rounds.trouble(format!("the journal was removed and cannot be written anew: {error}"));
        }
    }

    fn is_idle(&self) -> bool {
        let now = self.now();
        // What settled a moment ago may let others go on that are in no lane yet.
        !self.lanes.stale
            && self.lanes.are_empty()
            && self.reprocessing.is_idle(now)
            && !self.executor.parking.any_changes()
            // As of the moment when the lanes were made: what settled since is not in them yet.
            && !self.drops.any_settles(self.lanes.made, &self.times())
    }

    fn introduce(&self) {
        let station = self.settings.station();
        tracing::info!("{} takes drops from {}", station.name, station.folders.hot.display());
    }

    fn job_settings(&mut self, sku: &Sku) -> Result<JobSettings, ConfigError> {
        let settings = self.settings.job(sku);
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
                    self.settings_changes += 1;
                    tracing::info!(
                        "the station's settings changed and are in force: {}",
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
                    if threads(station.watch.jobs) != self.threads.count {
                        tracing::warn!("`watch.jobs` counts from the next start on");
                    }
                    if station.log != self.log {
                        tracing::warn!("`[log]` counts from the next start on");
                    }
                    self.executor.corrector.follow(station);
                    self.status.follow(station);
                    self.keeper.follow(station);
                    self.reprocessing.check_all();
                    self.rounds.make_due();
                }
                SettingsEvent::SkuChanged { sku, old, new } => {
                    self.settings_changes += 1;
                    tracing::info!("the settings of {sku} changed and are in force: {}", changes(&old, &new));
                    self.drops.release(&sku);
                    self.reprocessing.check(sku);
                }
                SettingsEvent::Broken { error, old_stay: true } => {
                    tracing::error!("{error} The old settings stay in force.");
                }
                SettingsEvent::Broken { error, old_stay: false } => {
                    tracing::error!("{error} There are no older ones; drawings of this SKU wait.");
                }
                SettingsEvent::Mended(file) => tracing::info!("{} is right again", file.display()),
            }
        }
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
                Request::Outdated(sku) => self.reprocessing.ask_for(sku),
                Request::Uncertain(name) => self.deliver_again(name.as_deref()),
            }
            self.lanes.stale = true;
        }
    }

    /// Somebody decided what becomes of the drawing of this name, or of all, that may not have been delivered.
    fn deliver_again(&mut self, name: Option<&str>) {
        let archive = self.folders().archive.clone();
        let is_meant = |result: &Delivered| name.is_none_or(|name| result.is_called(name));
        let results: Vec<Delivered> = self.executor.journal().uncertain().filter(is_meant).collect();
        if results.is_empty() {
            match name {
                Some(name) => tracing::warn!("{name} is not uncertain, and is not delivered again"),
                None => tracing::info!("no drawing is uncertain: none is delivered again"),
            }
        }
        for result in results {
            match result.job.sku.parse::<Sku>() {
                Ok(sku) if !result.original.is_empty() => {
                    tracing::info!("{} is delivered again, as asked", result.job.name);
                    let archive = archive.join(sku.key());
                    self.reprocessing.deliver_again(sku, &result, &archive);
                }
                _ => tracing::warn!(
                    "{} cannot be delivered again: its original is not in the archive. Drop it again",
                    result.job.name
                ),
            }
        }
    }

    /// Looks for a moment which delivered drawings would be others today; whether there is more to look at.
    fn look_for_outdated(&mut self) -> bool {
        let (started, station) = (Instant::now(), self.settings.station().clone());
        loop {
            let is_held = |sku: &Sku| self.drops.has_part(sku) || self.threads.are_fitting(sku);
            let next = self.reprocessing.next_unchecked(|| self.executor.journal().skus(), is_held);
            let Some(sku) = next else { break };
            if started.elapsed() >= LOOK {
                self.reprocessing.answer();
                return true;
            }
            match self.job_settings(&sku) {
                Ok(settings) => self.reprocessing.look_at(self.executor, &station, &sku, &settings),
                Err(_) => self.reprocessing.leave(&sku),
            }
        }
        // A part that is learned asks for another look by itself; one that is not whole would hold up the end.
        if self.mode == Mode::Once {
            self.reprocessing.leave_all(|sku| !self.threads.are_fitting(sku));
        }
        self.reprocessing.answer();
        false
    }

    fn write_status(&mut self, alive: bool) {
        let now = self.now();
        if !self.status.is_due(now) && alive {
            return;
        }
        let kept = self.keeper.kept();
        let troubles = self
            .rounds
            .troubles
            .iter()
            .map(String::as_str)
            .chain(self.settings.complaints())
            .chain(kept.as_ref().and_then(|kept| kept.trouble.as_deref()))
            .map(str::to_owned)
            .collect();
        let view = crate::hotfolder::state::status::View {
            drops: &self.drops,
            under_way: self.threads.under_way(now),
            outdated: self.reprocessing.marked(LISTED),
            uncertain: self
                .executor
                .journal()
                .uncertain()
                .map(|result| UncertainDrawing::from(&result))
                .collect(),
            kept,
            troubles,
            now,
            alive,
        };
        self.status.write(&self.state, &view);
    }
}

/// The lines of a settings file that changed, on one line of the log.
fn changes(old: &str, new: &str) -> String {
    diff::text_changes(old, new).join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_of_settings_stand_on_one_line() {
        let (old, new) = ("[beam]\na = 1\nb = 2\n", "[beam]\na = 1\nb = 3\nc = 4\n");
        assert_eq!(changes(old, new), "- b = 2; + b = 3; + c = 4");
    }
}
