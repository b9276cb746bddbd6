//! The running station: receives events, lists the hot folder, gives jobs to its threads, and handles their outcomes.
//!
//! One thread knows all drops and decides; other threads do the jobs ([`Executor`]). A part is fitted while no other
//! job of its SKU runs. Drawings are corrected in parallel, also those of one SKU. Drawings with the same result are
//! corrected one after the other, in the order in which they arrived. Every job that is not known to be large starts as
//! a quick one. It is cancelled as soon as its input turns out to be a large job; then it waits for its turn among the
//! large jobs, which never take all threads. So a small job waits for small jobs only.

mod arrivals;
mod claims;
mod hand_out;
mod lanes;
mod late;
mod listing;
mod outcomes;
mod rounds;
mod threads;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};

use crate::config::{
    ConfigError, FleetSettings, FolderPaths, JobSettings, LiveSettings, LogSettings, PageSettings,
    SettingsEvent, Sku, changed_settings,
};
use crate::hotfolder::api::{Corrector, JobError, Mode, Pulse, Tally};
use crate::hotfolder::error::{StationError, guarded};
use crate::hotfolder::fleet::Fleet;
use crate::hotfolder::jobs::{Executor, Keeper, Reprocessing, Unfiled, filing};
use crate::hotfolder::page::Page;
use crate::hotfolder::seen::{Drops, Message, Moment, Obstacle, SettleTimes, Signal, StopSignal, Watcher};
use crate::hotfolder::state::status::LISTED;
use crate::hotfolder::state::{
    Delivered, HotLock, Journal, Request, Shares, StationLock, StatusBoard, UncertainDrawing, requests,
};
use crate::printable::on_one_line;
use crate::reason::Reason;

use claims::Arrivals;
use lanes::Lanes;
use late::Late;
use rounds::Rounds;
use threads::Threads;

/// How long to wait for the rest of a file after its writer closed it: some programs write in two steps.
const INCOMPLETE_AFTER_CLOSE: Duration = Duration::from_secs(3);
/// How long the station checks delivered drawings before it handles its drops again.
const LOOK: Duration = Duration::from_millis(20);
/// The station wakes up at least this often, to report that it is alive and to look for requests.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// Events that may wait in the channel; if there are more, the folder is listed instead.
const MAX_MESSAGES: usize = 4096;
/// The largest useful number of threads.
const MAX_THREADS: usize = 64;

/// Runs a station: once over the files in the hot folder, or until it is stopped. `pulse` is called when the station is
/// ready, at least every second while it is alive, and when it stops.
///
/// # Errors
/// When another process runs the station, when one of its own folders cannot be created or written, or when a job
/// reports that the station cannot continue. A problem with a single drop is not an error: the drop is rejected or
/// waits.
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
    let (sender, messages) = sync_channel(MAX_MESSAGES);
    stop.connect(sender.clone());
    if let Some(fleet) = corrector.fleet() {
        let sender = sender.clone();
        // If this fails, the station has many messages, and asks for news soon.
        fleet.wake_with(Box::new(move || drop(sender.try_send(Message::Signal(Signal::News)))));
    }
    let count = threads(station.watch.jobs);
    let (tasks, taken) = sync_channel(count);
    // A thread keeps the memory that it once used, so the spare threads only take what the others cannot.
    let (spare_tasks, taken_by_spare) = sync_channel(count);
    let keeper = Keeper::new(&station, &state, stop.clone());
    let page = (mode == Mode::UntilStopped).then(|| Page::of(&station)).flatten();
    let (taken, taken_by_spare) = (Mutex::new(taken), Mutex::new(taken_by_spare));
    std::thread::scope(|scope| {
        for taken in [&taken, &taken_by_spare] {
            for _ in 0..count {
                let (executor, sender) = (&executor, sender.clone());
                scope.spawn(move || threads::work(taken, executor, &sender));
            }
        }
        let keeper = &keeper;
        // The keeper's threads end when this function returns or panics.
        let _ends = keeper.end_on_drop();
        scope.spawn(|| {
            run_side_task(|| keeper.keep_journal_short(|| executor.journal()), "shortens the journal")
        });
        let cleaning = scope.spawn(|| {
            run_side_task(|| keeper.run(|| executor.journal(), mode == Mode::Once), "removes old files");
        });
        let page = page.as_ref();
        let _page_ends = page.map(Page::end_on_drop);
        if let Some(page) = page {
            scope.spawn(|| run_side_task(|| page.run(), "shows its page"));
        }
        let mut dispatcher = Dispatcher {
            settings,
            page,
            page_settings: station.page.clone(),
            fleet_settings: station.fleet.clone(),
            fleet_news: BTreeSet::new(),
            arrivals: Arrivals::default(),
            keeper,
            executor: &executor,
            stop,
            mode,
            lock,
            hot_lock: None,
            status: StatusBoard::new(&station, &state, |from| executor.journal().delivered_after(from)),
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
        if dispatcher.holds_hot() {
            dispatcher.introduce();
            executor.warn_of_older_form();
            pulse(Pulse::Ready);
        }
        dispatcher.work_until_done(pulse);
        pulse(Pulse::Stopping);
        dispatcher.log_unclaimed(Moment::MAX);
        if mode == Mode::UntilStopped || stop.is_raised() || dispatcher.stopped.is_some() {
            keeper.end();
        }
        // The status reports what it removed.
        let _ = cleaning.join();
        keeper.end();
        dispatcher.write_status(false);
        let parked = executor.parking.count();
        if mode == Mode::Once && parked > 0 {
            let (files, them) = match parked {
                1 => ("processed file is", "it"),
                _ => ("processed files are", "them"),
            };
            let place = executor.parking.folder().map(|folder| format!(" in {}", folder.display()));
            tracing::info!(
                "{parked} {files} kept{} until the next start, in case a program still writes to {them}. No action is needed",
                place.unwrap_or_default()
            );
        }
        // Dropping the rest of the dispatcher closes the channels, so the threads end.
        let Dispatcher { drops, tally, stopped, settings, .. } = dispatcher;
        let (waiting, incomplete) = drops.left();
        if mode == Mode::UntilStopped && stopped.is_none() {
            let waits = match waiting.len() + incomplete.len() {
                0 => "no drop waits".to_owned(),
                1 => "1 drop waits".to_owned(),
                count => format!("{count} drops wait"),
            };
            tracing::info!("{} stopped; {waits}", settings.station().name);
        }
        // This includes drawings that the listing filed without a job.
        let uncertain = uncertain_in(&executor.journal()).difference(&known).count() as u64;
        match stopped {
            Some(reason) => Err(StationError::Stopped(reason)),
            None => Ok(Tally { waiting, incomplete, uncertain, ..tally }),
        }
    })
}

/// Does work that a station can do without: a panic there stops nothing else.
fn run_side_task(work: impl FnOnce(), what: &str) {
    let work = || {
        work();
        Ok(())
    };
    if guarded(work).is_err() {
        tracing::error!(
            "an internal error stopped a task: isomark no longer {what}. Restart the station and report this"
        );
    }
}

/// The drawings that may not have been delivered, each with the time when it was filed.
fn uncertain_in(journal: &Journal) -> BTreeSet<(String, String)> {
    journal.uncertain().map(|result| (result.job.name.clone(), result.at.clone())).collect()
}

/// The number of threads: from the settings, or one for each processor; at least two, so that a large job never blocks
/// the small ones.
fn threads(asked: Option<usize>) -> usize {
    let cores = std::thread::available_parallelism().map_or(2, usize::from);
    asked.unwrap_or(cores).clamp(2, MAX_THREADS)
}

/// A running station.
struct Dispatcher<'a, C> {
    settings: LiveSettings,
    executor: &'a Executor<'a, C>,
    keeper: &'a Keeper,
    stop: &'a StopSignal,
    mode: Mode,
    lock: StationLock,
    hot_lock: Option<HotLock>,
    /// The state folder with lock and journal; later changes of the settings do not move it.
    state: PathBuf,
    /// The log file that is written; later changes of the settings do not move it.
    log: Option<LogSettings>,
    /// The page for browsers; later changes of the settings do not move it.
    page: Option<&'a Page>,
    page_settings: Option<PageSettings>,
    /// The fleet; later changes of the settings do not move it.
    fleet_settings: Option<FleetSettings>,
    /// SKUs with a job, whose part changed in the fleet.
    fleet_news: BTreeSet<Sku>,
    /// Jobs that others sent to this line.
    arrivals: Arrivals,
    messages: Receiver<Message>,
    threads: Threads,
    watcher: Watcher,
    drops: Drops,
    lanes: Lanes,
    started: Instant,
    rounds: Rounds,
    /// Patterns whose result is delivered, but whose report or original could not be filed yet.
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
            let mut has_more_to_check = false;
            if !ends {
                self.refresh_settings();
                self.take_news_of_fleet();
                if self.now() >= self.rounds.due() {
                    self.list();
                }
                self.exchange_jobs(false);
                self.look_at_parked();
                self.log_unclaimed(self.now());
                self.take_requests();
                has_more_to_check = self.look_for_outdated();
                self.hand_out();
            }
            if ends {
                self.exchange_jobs(true);
                self.executor.others_wait.store(false, Ordering::Relaxed);
                self.continue_paused();
            }
            pulse(Pulse::Alive);
            if self.threads.are_idle() && (ends || (self.mode == Mode::Once && self.is_idle())) {
                return;
            }
            self.write_status(true);
            let now = self.now();
            let mut next = now + HEARTBEAT;
            let mut due = Moment::MAX;
            // A station that is ending does not list the folder or check parked files.
            if !ends {
                next = next.min(self.rounds.due());
            }
            if !ends && !self.executor.parking.is_empty() {
                next = next.min(self.next_look_at_parked.max(now));
            }
            if !ends && self.threads.have_room(now) {
                // A drop that is ready and cannot start waits for a job to finish, which sends a message.
                due = self.drops.next_due(self.lanes.made, &self.times()).unwrap_or(due);
                next = if self.lanes.stale { now } else { next.min(due) };
            }
            if has_more_to_check {
                next = now;
            }
            match self.messages.recv_timeout(next.saturating_sub(now).max(Duration::from_millis(1))) {
                Ok(message) => self.drain_events(message),
                // A drop may have settled, or a folder may be available again.
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => self.lanes.stale = true,
            }
            self.lanes.stale |= due <= self.now();
        }
    }

    /// Restores lock and journal if somebody removed the state folder: without them a second station could start and
    /// deliver the same drawings again.
    fn keep_state(&mut self) {
        let state = self.state.display().to_string();
        match self.lock.keep_in_place(&self.state, &self.settings.station().name) {
            Ok(false) => {}
            Ok(true) => {
                tracing::error!(
                    "the state folder {state} was removed while the station was running; created it again"
                );
            }
            Err(StationError::Lock { source, .. }) => {
                return self
                    .rounds
                    .trouble(format!("the state folder {state} cannot be created again: {source}"));
            }
            Err(error) => return self.stopped = Some(error.reason()),
        }
        if let Err(error) = self.executor.journal().keep_in_place() {
            self.rounds.trouble(format!("the journal was removed and cannot be written again: {error}"));
        }
    }

    fn is_idle(&self) -> bool {
        let now = self.now();
        // A drop that settled a moment ago may unblock others that are not in a lane yet.
        !self.lanes.stale
            && self.lanes.are_empty()
            && self.reprocessing.is_idle(now)
            && !self.executor.parking.any_changes()
            // At the moment when the lanes were made: drops that settled later are not in them yet.
            && !self.drops.any_settles(self.lanes.made, &self.times())
    }

    fn introduce(&self) {
        let station = self.settings.station();
        tracing::info!("{} takes drops from {}", station.name, station.folders.hot.display());
    }

    /// The settings for a job on this SKU.
    ///
    /// # Errors
    /// With what the job waits for, and why.
    fn job_settings(&mut self, sku: &Sku) -> Result<JobSettings, (Obstacle, Reason)> {
        if let Err(JobError::Retry(reason)) = self.executor.shares.skus_are_there(self.folders(), false) {
            return Err((Obstacle::Other, reason));
        }
        let settings = self.settings.job(sku);
        self.log_settings_events();
        settings.map_err(|error| match error {
            ConfigError::BeingSaved { .. } => (Obstacle::SettingsBeingSaved, error.reason()),
            _ => (Obstacle::Other, error.reason()),
        })
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
            // On Windows, a file cannot be read while another program has it open for writing.
            open_ended: if cfg!(windows) { watch.settle } else { watch.open_ended.min(watch.incomplete) },
            incomplete: watch.incomplete,
            incomplete_after_close: INCOMPLETE_AFTER_CLOSE,
        }
    }

    fn refresh_settings(&mut self) {
        self.settings.refresh();
        self.log_settings_events();
    }

    fn log_settings_events(&mut self) {
        for event in self.settings.take_events() {
            match event {
                SettingsEvent::StationChanged { old, new } => {
                    self.settings_changes += 1;
                    // They may name another folder.
                    self.rounds.missing = None;
                    tracing::info!(
                        "using the changed station settings: {}",
                        on_one_line(&changed_settings(&old, &new))
                    );
                    if let Err((purpose, _, error)) = filing::prepare(self.folders()) {
                        tracing::warn!("the {purpose} folder cannot be created: {error}");
                    }
                    let station = self.settings.station();
                    if station.folders.state != self.state {
                        tracing::warn!(
                            "`folders.state` takes effect after a restart; until then it is {}",
                            self.state.display()
                        );
                    }
                    if threads(station.watch.jobs) != self.threads.count {
                        tracing::warn!("`watch.jobs` takes effect after a restart");
                    }
                    if station.log != self.log {
                        tracing::warn!("`log` takes effect after a restart");
                    }
                    if station.page != self.page_settings {
                        tracing::warn!("`page` takes effect after a restart");
                    }
                    if station.fleet != self.fleet_settings {
                        tracing::warn!("`fleet` takes effect after a restart");
                    }
                    self.executor.corrector.follow(station);
                    self.status.follow(station);
                    self.keeper.follow(station);
                    self.reprocessing.check_all();
                    self.rounds.make_due();
                }
                SettingsEvent::SkuChanged { sku, old, new } => {
                    self.settings_changes += 1;
                    tracing::info!(
                        "using the changed settings of SKU `{sku}`: {}",
                        on_one_line(&changed_settings(&old, &new))
                    );
                    self.drops.release(&sku);
                    self.reprocessing.check(sku);
                }
                SettingsEvent::Broken { error, old_stay: true } => {
                    tracing::error!("{error} Keeping the previous settings.");
                }
                SettingsEvent::Broken { error, old_stay: false } => {
                    let sku = error.file().and_then(Path::file_stem).unwrap_or_default().to_string_lossy();
                    tracing::error!(
                        "{error} Until this file is corrected or removed, the drawings of SKU `{sku}` wait."
                    );
                }
                SettingsEvent::Mended(file) => tracing::info!("{} is valid again", file.display()),
                SettingsEvent::BrokenRemoved { sku, file } => {
                    tracing::info!(
                        "{} was removed; using the station's settings for SKU `{sku}`",
                        file.display()
                    );
                }
            }
        }
    }

    /// Handles the requests from other terminals.
    fn take_requests(&mut self) {
        for request in requests::take(&self.state) {
            match request {
                Request::Waiting => {
                    self.drops.free_all();
                    self.reprocessing.free_all();
                    tracing::info!("trying all waiting drops again, as requested");
                }
                Request::Outdated(sku) => self.reprocessing.ask_for(sku),
                Request::Uncertain(name) => self.deliver_again(name.as_deref()),
            }
            self.lanes.stale = true;
        }
    }

    /// Delivers the drawing of this name again, or all drawings that may not have been delivered: somebody asked for
    /// it.
    fn deliver_again(&mut self, name: Option<&str>) {
        let archive = self.folders().archive.clone();
        let is_meant = |result: &Delivered| name.is_none_or(|name| result.is_called(name));
        let results: Vec<Delivered> = self.executor.journal().uncertain().filter(is_meant).collect();
        if results.is_empty() {
            match name {
                Some(name) => tracing::warn!("not delivering {name} again: its delivery is not uncertain"),
                None => tracing::info!("nothing to deliver again: no delivery is uncertain"),
            }
        }
        for result in results {
            match result.job.sku.parse::<Sku>() {
                Ok(sku) if !result.original.is_empty() => {
                    tracing::info!("delivering {} again, as requested", result.job.name);
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

    /// Checks for a moment which delivered drawings are outdated; returns whether there is more to check.
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
                Err(_) => self.reprocessing.cannot_read(&sku),
            }
        }
        // A part that is being learned causes another check. A part that is incomplete must not delay the end.
        if self.mode == Mode::Once {
            self.reprocessing.leave_all(|sku| !self.threads.are_fitting(sku));
            let is_missing = self.rounds.missing.is_some();
            self.reprocessing.leave_searches(|sku| is_missing || self.drops.has_part(sku));
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
        let of_fleet = self.fleet_trouble();
        let fleet = self.executor.corrector.fleet();
        let of_settings = fleet.map(Fleet::notices).unwrap_or_default();
        let troubles = self
            .rounds
            .troubles
            .iter()
            .map(String::as_str)
            .chain(self.settings.complaints())
            .chain(kept.as_ref().and_then(|kept| kept.trouble.as_deref()))
            .map(str::to_owned)
            .chain(self.reprocessing.trouble())
            .chain(self.executor.journal().trouble())
            .chain(self.page.and_then(Page::trouble))
            .chain(of_fleet.clone())
            .chain(of_settings.clone())
            .collect();
        let view = crate::hotfolder::state::status::View {
            drops: &self.drops,
            under_way: self.threads.under_way(now),
            delivered: self.threads.delivered(),
            outdated: self.reprocessing.marked(LISTED),
            uncertain: self
                .executor
                .journal()
                .uncertain()
                .map(|result| UncertainDrawing::from(&result))
                .collect(),
            kept,
            troubles,
            fleet: fleet.and_then(Fleet::seen),
            now,
            alive,
        };
        let written = self.status.write(&self.state, &view);
        if let (Some(fleet), Some(status)) = (self.executor.corrector.fleet(), &written) {
            fleet.publish(status.figures(of_fleet.as_deref()));
        }
        if let (Some(page), Some(status)) = (self.page, written) {
            page.publish(status, &self.settings.station().folders, &self.state);
        }
    }

    /// Checks the drops and drawings of the SKUs whose part or surface arrived from the fleet.
    fn take_news_of_fleet(&mut self) {
        let Some(fleet) = self.executor.corrector.fleet() else { return };
        self.fleet_news.extend(fleet.take_news());
        let (busy, free): (BTreeSet<Sku>, BTreeSet<Sku>) =
            std::mem::take(&mut self.fleet_news).into_iter().partition(|sku| self.threads.are_busy_with(sku));
        self.fleet_news = busy;
        for sku in free {
            self.drops.release(&sku);
            self.reprocessing.check(sku);
            self.rounds.make_due();
            self.lanes.stale = true;
        }
    }

    /// Why the fleet cannot be used as the settings ask for it.
    fn fleet_trouble(&self) -> Option<String> {
        match self.executor.corrector.fleet() {
            Some(fleet) => fleet.trouble(),
            None if self.fleet_settings.is_some() && self.mode == Mode::UntilStopped => {
                Some("[fleet] has no effect: this isomark was built without the feature `fleet`.".into())
            }
            None => None,
        }
    }
}
