//! The station at work: hears, lists, and does one job after the other.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant, SystemTime};

use super::drops::Drops;
use super::filing;
use super::folders::{self, Found};
use super::job::{Corrector, Delivery, Mode, StationError, Tally};
use super::lock::StationLock;
use super::names::is_ignored;
use super::settle::{Moment, SettleTimes, Stamp};
use super::watcher::{Signal, StopSignal, Watcher};
use crate::config::{Backend, FolderPaths, JobSettings, LiveSettings, SettingsEvent, Sku};

/// How long an incomplete file is waited for after its writer closed it: some programs write in two goes.
const INCOMPLETE_AFTER_CLOSE: Duration = Duration::from_secs(3);
/// How often a hot folder that vanished is looked for.
const MISSING_FOLDER_LOOK: Duration = Duration::from_millis(500);

/// Runs a station: once over what lies there, or until it is stopped.
///
/// # Errors
/// When one of the station's own folders cannot be made, or a job says that nothing can be done any more. Whatever
/// goes wrong with a single drop is no error: the drop is rejected or waits.
pub fn run(
    settings: LiveSettings,
    corrector: &mut impl Corrector,
    stop: &StopSignal,
    mode: Mode,
) -> Result<Tally, StationError> {
    let (sender, signals) = channel();
    stop.connect(sender.clone());
    let mut worker = Worker {
        settings,
        corrector,
        stop,
        mode,
        signals,
        watcher: Watcher::new(sender),
        drops: Drops::default(),
        started: Instant::now(),
        next_listing: Moment::ZERO,
        hot_is_missing: false,
        told: BTreeSet::new(),
        delivered: BTreeMap::new(),
        late_companions: BTreeMap::new(),
        unfit_archive: BTreeMap::new(),
        tally: Tally::default(),
    };
    filing::prepare(worker.folders()).map_err(|(purpose, path, source)| StationError::Folder {
        purpose,
        path,
        source,
    })?;
    let _lock = StationLock::take(&worker.folders().state, &worker.settings.station().name)?;
    worker.introduce();
    worker.work_until_done()?;
    let (waiting, incomplete) = worker.drops.left();
    Ok(Tally { waiting, incomplete, ..worker.tally })
}

/// A station at work. What it does with one drop is in `outcome` and `intake`.
pub(super) struct Worker<'a, C> {
    pub(super) settings: LiveSettings,
    pub(super) corrector: &'a mut C,
    stop: &'a StopSignal,
    pub(super) mode: Mode,
    signals: Receiver<Signal>,
    watcher: Watcher,
    pub(super) drops: Drops,
    started: Instant,
    next_listing: Moment,
    hot_is_missing: bool,
    /// Complaints about the hot folder itself that were told already.
    told: BTreeSet<String>,
    /// Patterns whose result is delivered while report or original could not be filed yet.
    pub(super) delivered: BTreeMap<PathBuf, (Stamp, Delivery)>,
    /// Companions that were not there when their part was done: until when they may follow it, and where it went.
    pub(super) late_companions: BTreeMap<PathBuf, (Moment, PathBuf)>,
    /// Archived parts that cannot be fitted with these settings.
    pub(super) unfit_archive: BTreeMap<Sku, (PathBuf, JobSettings)>,
    pub(super) tally: Tally,
}

impl<C: Corrector> Worker<'_, C> {
    fn work_until_done(&mut self) -> Result<(), StationError> {
        loop {
            self.refresh_settings();
            if self.now() >= self.next_listing {
                self.list();
            }
            self.work()?;
            if self.mode == Mode::Once || self.stop.is_raised() {
                return Ok(());
            }
            let next = self.drops.next_due(&self.times()).unwrap_or(Moment::MAX).min(self.next_listing);
            match self.signals.recv_timeout(next.saturating_sub(self.now())) {
                Ok(signal) => {
                    self.hear(Some(signal));
                }
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {}
            }
        }
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

    /// Does all that can be done now.
    fn work(&mut self) -> Result<(), StationError> {
        loop {
            let ready = self.drops.ready(self.now(), &self.times());
            if ready.is_empty() {
                return Ok(());
            }
            for path in ready {
                if self.stop.is_raised() {
                    return Ok(());
                }
                self.handle(&path)?;
                // A part that came meanwhile goes before the patterns that are still to do.
                if self.hear(None) {
                    break;
                }
            }
            if self.mode == Mode::UntilStopped && self.now() >= self.next_listing {
                return Ok(());
            }
        }
    }

    pub(super) fn folders(&self) -> &FolderPaths {
        &self.settings.station().folders
    }

    pub(super) fn now(&self) -> Moment {
        self.started.elapsed()
    }

    pub(super) fn times(&self) -> SettleTimes {
        let watch = &self.settings.station().watch;
        SettleTimes {
            still: if self.mode == Mode::Once { Duration::ZERO } else { watch.settle },
            incomplete: watch.incomplete,
            incomplete_after_close: INCOMPLETE_AFTER_CLOSE,
        }
    }

    pub(super) fn refresh_settings(&mut self) {
        self.settings.refresh();
        self.tell_settings_events();
    }

    pub(super) fn tell_settings_events(&mut self) {
        for event in self.settings.take_events() {
            match event {
                SettingsEvent::StationChanged => {
                    tracing::info!("the station's settings changed and are in force");
                    if let Err((purpose, _, error)) = filing::prepare(self.folders()) {
                        tracing::warn!("the {purpose} folder cannot be made: {error}");
                    }
                    self.next_listing = Moment::ZERO;
                }
                SettingsEvent::SkuChanged(sku) => {
                    tracing::info!("the settings of {sku} changed and are in force")
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
        self.next_listing = now + watch.rescan;
        self.late_companions.retain(|_, (until, _)| now < *until);
        let backend = if self.mode == Mode::Once { Backend::Poll } else { watch.backend };
        if !self.watcher.follow(&hot, backend) {
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
            Err(error) => return self.tell_once(format!("the hot folder cannot be listed: {error}")),
        };
        for error in &listing.unseen {
            self.tell_once(format!("something in the hot folder cannot be looked at: {error}"));
        }
        for folder in &listing.too_deep {
            self.tell_once(format!(
                "{} is a folder in a SKU's folder; nobody looks into it",
                folder.display()
            ));
        }
        let mut found = BTreeSet::new();
        for (path, what) in listing.drops {
            self.see(&hot, &path, what, false);
            found.insert(path);
        }
        self.drops.keep_only(&found);
        for sku in self.drops.awaited() {
            // What is wrong with the settings or the surface is told when the pattern's turn comes.
            let settings = self.settings.job(&sku);
            let known = settings.map(|settings| self.has_surface(&sku, &settings));
            if !matches!(known, Ok(Ok(false))) {
                self.drops.release(&sku);
            }
        }
    }

    fn tell_once(&mut self, words: String) {
        if self.told.insert(words.clone()) {
            tracing::warn!("{words}");
        }
    }

    /// Takes in what was signalled, beginning with `first`; returns whether a part is among it.
    fn hear(&mut self, first: Option<Signal>) -> bool {
        let mut hints = BTreeMap::new();
        let mut next = first.or_else(|| self.signals.try_recv().ok());
        while let Some(signal) = next {
            match signal {
                Signal::Touched(path) => {
                    hints.entry(path).or_insert(false);
                }
                Signal::Closed(path) => {
                    hints.insert(path, true);
                }
                Signal::Overflow => self.next_listing = Moment::ZERO,
                Signal::Stop => {}
            }
            next = self.signals.try_recv().ok();
        }
        let hot = self.folders().hot.clone();
        let parts = hints.into_iter().filter(|(path, closed)| self.hint(&hot, path, *closed)).count();
        parts > 0
    }

    /// Looks at one path that an event named; returns whether a part lies there.
    fn hint(&mut self, hot: &Path, path: &Path, closed: bool) -> bool {
        let Ok(relative) = path.strip_prefix(hot) else {
            self.next_listing = Moment::ZERO;
            return false;
        };
        let depth = relative.components().count();
        if relative.components().any(|part| is_ignored(&part.as_os_str().to_string_lossy())) || depth > 2 {
            return false;
        }
        match folders::look(path) {
            Ok(Some(Found::Folder)) if closed && depth == 1 => {
                // A whole folder was renamed into place, so its files are whole, too.
                let entries = folders::entries(path, &mut Vec::new()).unwrap_or_default();
                entries.into_iter().filter(|(path, what)| self.see(hot, path, *what, true)).count() > 0
            }
            Ok(Some(Found::File(_) | Found::Other(_))) if depth == 0 => false,
            Ok(Some(what @ (Found::File(_) | Found::Other(_)))) => self.see(hot, path, what, closed),
            Ok(None) if depth > 0 => {
                self.drops.forget(path);
                false
            }
            Ok(_) | Err(_) => {
                self.next_listing = Moment::ZERO;
                false
            }
        }
    }

    pub(super) fn see(&mut self, hot: &Path, path: &Path, what: Found, closed: bool) -> bool {
        let still_for = match (self.mode, what) {
            // There is no later look, so the file's own time must tell how long it has stood still.
            (Mode::Once, Found::File(Stamp { modified: Some(modified), .. })) => {
                SystemTime::now().duration_since(modified).unwrap_or_default()
            }
            _ => Duration::ZERO,
        };
        let relative = path.strip_prefix(hot).unwrap_or(path);
        self.drops.see(hot, relative, what, closed, self.now(), still_for)
    }
}
