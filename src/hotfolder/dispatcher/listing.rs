//! Finds out what is in the hot folder: from events, and from the listing, which decides.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::{Duration, SystemTime};

use super::Dispatcher;
use crate::config::Backend;
use crate::hotfolder::api::{Corrector, JobError, Mode};
use crate::hotfolder::error::STOP_THE_OTHER;
use crate::hotfolder::jobs::filing::{Content, Original};
use crate::hotfolder::jobs::{filing, recovery};
use crate::hotfolder::seen::{
    Drops, Found, Meaning, Message, Signal, Stamp, Writer, folders, is_ignored, parked,
};
use crate::hotfolder::state::{DropId, HotLock, with_slashes};
use crate::reason::Reason;

/// How often the station looks for a hot folder that is not available.
const MISSING_FOLDER_LOOK: Duration = Duration::from_millis(500);
/// How often filed files are checked while their writers may still write to them.
const LOOK_AT_PARKED: Duration = Duration::from_millis(500);
/// How often a folder on a network share is listed: a share does not report changes by other computers.
const NETWORK_LISTING: Duration = Duration::from_secs(1);
/// The pause after a listing, as a multiple of its duration: listing a slow folder must not take all the time.
const REST_AFTER_LISTING: u32 = 4;

impl<C: Corrector> Dispatcher<'_, C> {
    /// Lists the hot folder. The listing corrects everything that was concluded from events.
    pub(super) fn list(&mut self) {
        let now = self.now();
        self.rounds.begin();
        // In an empty mount point, all SKU files would seem to be removed.
        if self.executor.shares.skus_are_there(self.folders(), true).is_ok() {
            self.settings.refresh_skus();
        }
        self.log_settings_events();
        self.late.forget_before(now);
        let backend = self.backend();
        self.keep_state();
        for sku in self.executor.learned_elsewhere(|sku| self.threads.are_busy_with(sku)) {
            tracing::warn!("{sku} has a new part: another station fitted it");
            self.reprocessing.check(sku);
        }
        self.reprocessing.check_unreadable();
        let folders_are_there = self.folders_are_there();
        if !self.hot_is_there(backend) || !self.holds_hot() {
            return;
        }
        self.executor.parking.set_hot(folders::identity(&self.folders().hot));
        let begun = self.now();
        let listing = folders::list(&self.folders().hot);
        let listed = self.now();
        self.rounds.rests_until = listed + REST_AFTER_LISTING * (listed - begun);
        match listing {
            Ok(listing) => self.take_in(listing),
            Err(error) => return self.rounds.trouble(format!("the hot folder cannot be listed: {error}")),
        }
        if folders_are_there {
            self.close_what_was_interrupted();
        }
        self.name_jobs();
        self.close_removed_jobs();
        self.release_awaited();
        self.log_settings_events();
    }

    /// How changes of the hot folder are noticed. This also sets the time of the next listing.
    fn backend(&mut self) -> Backend {
        let (now, watch) = (self.now(), self.settings.station().watch.clone());
        let hot = &self.folders().hot;
        let network = watch.rescan.min(NETWORK_LISTING);
        let (backend, interval) = match watch.backend {
            _ if self.mode == Mode::Once => (Backend::Poll, watch.rescan),
            Backend::Auto if folders::is_on_network(hot) => {
                let problem = format!(
                    "{} is on a network share, which does not report changes by other computers: \
                     listing it every {} s",
                    hot.display(),
                    network.as_secs_f64()
                );
                self.rounds.warn_once(problem);
                (Backend::Poll, network)
            }
            Backend::Auto => (Backend::Native, watch.rescan),
            chosen => (chosen, watch.rescan),
        };
        self.rounds.next = now + interval;
        backend
    }

    /// Whether the folders that jobs use are available.
    fn folders_are_there(&mut self) -> bool {
        let folders = self.folders();
        let import = folders.import_trouble();
        let missing = match &import {
            Some(_) => format!("the import folder {} is", folders.import.display()),
            None => "the folders of the station are".to_owned(),
        };
        let trouble = import.or_else(|| match self.executor.shares.are_there(folders, true) {
            Err(JobError::Retry(reason)) => Some(reason),
            _ => None,
        });
        match &trouble {
            Some(reason) => {
                self.rounds.trouble(reason.on_one_line());
                self.rounds.missing = Some(missing);
            }
            None => {
                if let Some(missing) = self.rounds.missing.take() {
                    tracing::info!("{missing} available again");
                }
            }
        }
        trouble.is_none()
    }

    /// Whether the hot folder is available; if so, it is watched.
    fn hot_is_there(&mut self, backend: Backend) -> bool {
        let hot = self.folders().hot.clone();
        let is_there = self.watcher.follow(&hot, backend);
        let was_missing = std::mem::replace(&mut self.rounds.hot_is_missing, !is_there);
        if !is_there {
            self.rounds.troubles.push(format!("the hot folder {} is not available", hot.display()));
            self.drops = Drops::default();
            self.rounds.next = self.now() + self.settings.station().watch.rescan.min(MISSING_FOLDER_LOOK);
        }
        match (was_missing, is_there) {
            (false, false) => {
                tracing::error!("the hot folder {} is not available; waiting for it", hot.display());
            }
            (true, true) => tracing::info!("the hot folder {} is available again", hot.display()),
            _ => {}
        }
        is_there
    }

    /// Takes in a listing: the drops are exactly what it contains.
    fn take_in(&mut self, listing: folders::Listing) {
        let hot = self.folders().hot.clone();
        for error in &listing.unseen {
            self.rounds.trouble(format!("cannot read something in the hot folder: {error}"));
        }
        for folder in &listing.too_deep {
            self.rounds.trouble(format!(
                "ignoring {}: folders inside a SKU's folder are not read. Move its files one level up",
                folder.display()
            ));
        }
        let mut found = BTreeSet::new();
        for (path, what) in listing.drops {
            self.observe(&hot, &path, what, Writer::Unknown);
            found.insert(path);
        }
        self.drops.keep_only(&found);
        self.unfiled.retain(|path, _| found.contains(path));
    }

    /// Releases patterns whose SKU has a surface now. An error is reported later, by the job of such a pattern.
    fn release_awaited(&mut self) {
        for sku in self.drops.awaited() {
            let known =
                self.settings.job(&sku).map(|settings| self.executor.corrector.knows(&sku, &settings));
            let archived = filing::current_part(self.folders(), &sku).is_some();
            if !matches!(known, Ok(false)) || archived {
                self.drops.release(&sku);
            }
        }
    }

    /// Whether no other station uses the hot folder; if one does, this station ends.
    pub(super) fn holds_hot(&mut self) -> bool {
        let hot = &self.settings.station().folders.hot;
        // A folder that cannot be looked at for a moment is still the same.
        let is_another =
            |lock: &HotLock| folders::identity(hot).is_some_and(|now| lock.identity != Some(now));
        if self.hot_lock.as_ref().is_none_or(is_another) {
            self.hot_lock = None;
            self.hot_lock = HotLock::take(hot);
        }
        if self.hot_lock.is_none() {
            let what = format!("Another station already uses the hot folder {}.", hot.display());
            self.stopped = Some(Reason::new("hot-folder-held", what, STOP_THE_OTHER));
        }
        self.hot_lock.is_some()
    }

    /// Closes jobs that were started and whose drop was removed: they were interrupted after their last step.
    fn close_what_was_interrupted(&mut self) {
        let station = self.settings.station().clone();
        let Self { executor, threads, rounds, .. } = self;
        let mut journal = executor.journal();
        let is_at_work = |drop: &DropId| threads.are_at(drop);
        let complain = |problem| rounds.warn_once(problem);
        recovery::close_all(&station, &mut journal, &executor.parking, is_at_work, complain);
        // A temporary file that a job has just written is not in the journal yet.
        if threads.are_idle() && !std::mem::replace(&mut rounds.swept, true) {
            recovery::sweep(&station.folders, &journal);
        }
    }

    /// Checks the files that are filed and parked: a file that was written since then is a new drop.
    pub(super) fn look_at_parked(&mut self) {
        let now = self.now();
        if now < self.next_look_at_parked || self.executor.parking.is_empty() {
            return;
        }
        self.next_look_at_parked = now + LOOK_AT_PARKED;
        let folders = self.folders().clone();
        let station = self.settings.station().file.clone();
        let times = self.times();
        let silence = times.incomplete.max(times.incomplete_after_close);
        for parked::Returned { relative, overtaken } in self.executor.parking.look(&folders, silence) {
            let drop = with_slashes(&relative);
            let Some(place) = overtaken else {
                tracing::warn!("{drop} was written again after it was processed: treating it as a new drop");
                let path = folders.hot.join(&relative);
                self.late.expect_own(&path, now);
                self.look_again(&path);
                continue;
            };
            let original = Original { path: &place, content: Content::Unknown, companions: &[] };
            let reason = overtaken_by_a_newer(&drop).in_file(drop.clone());
            let parking = &self.executor.parking;
            match filing::reject(&station, &folders, parking, &relative, &original, &reason, |_| Ok(())) {
                Ok(rejected) => {
                    parked::remove_around(&place, &relative);
                    self.tally.rejected += 1;
                    self.status.rejected(&drop, &reason);
                    tracing::warn!(
                        "{drop} rejected and moved to {}: {}",
                        rejected.display(),
                        reason.on_one_line()
                    );
                }
                Err(error) => {
                    self.rounds.warn_once(format!("cannot reject {}: {error}", place.display()));
                }
            }
        }
    }

    /// Handles all waiting messages, starting with `first`.
    pub(super) fn drain_events(&mut self, first: Message) {
        // For each path: when it was first named, which is the order of the drops, and what its writer did last.
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
                Message::Signal(Signal::Renamed(path)) => {
                    hints.entry(path).or_insert((turn, Writer::Renamed)).1 = Writer::Renamed;
                }
                Message::Signal(Signal::Overflow) => overflow = true,
                Message::Signal(Signal::Stop | Signal::News) => {}
            }
            next = self.messages.try_recv().ok();
            turn += 1;
        }
        if self.watcher.lost_events() {
            tracing::info!("too many events at once: listing the hot folder");
            overflow = true;
        }
        let hot = self.folders().hot.clone();
        let mut hints: Vec<_> = hints.into_iter().collect();
        hints.sort_by_key(|(_, (turn, _))| *turn);
        for (path, (_, writer)) in hints {
            self.apply_event(&hot, &path, writer);
        }
        if overflow {
            self.drops.events_were_lost();
            self.rounds.make_due();
        }
    }

    /// Checks a path that an event named.
    pub(super) fn apply_event(&mut self, hot: &Path, path: &Path, writer: Writer) {
        let Ok(relative) = path.strip_prefix(hot) else {
            self.rounds.make_due();
            return;
        };
        let depth = relative.components().count();
        if relative.components().any(|part| is_ignored(&part.as_os_str().to_string_lossy())) || depth > 2 {
            return;
        }
        // A file that this station renamed into the folder is not complete for that reason.
        let writer = match writer {
            Writer::Renamed if self.late.take_own(path) => Writer::Unknown,
            writer => writer,
        };
        match folders::look(path) {
            Ok(Some(Found::Folder)) if writer == Writer::Renamed && depth == 1 => {
                // A whole folder was renamed into place, so its files are complete, too.
                let entries = folders::entries(path, &mut Vec::new()).unwrap_or_default();
                for (path, what) in entries {
                    self.observe(hot, &path, what, Writer::Renamed);
                }
            }
            Ok(Some(Found::File(_) | Found::Other(_))) if depth == 0 => {}
            Ok(Some(what @ (Found::File(_) | Found::Other(_)))) => self.observe(hot, path, what, writer),
            Ok(None) if depth > 0 => self.drops.forget(path),
            Ok(_) | Err(_) => self.rounds.make_due(),
        }
    }

    pub(super) fn observe(&mut self, hot: &Path, path: &Path, what: Found, writer: Writer) {
        let still_for = match (self.mode, what) {
            // There is no later check, so the time of the last write decides how long the file has been unchanged.
            (Mode::Once, Found::File(Stamp { modified: Some(modified), .. })) => {
                SystemTime::now().duration_since(modified).unwrap_or_default()
            }
            _ => Duration::ZERO,
        };
        // The hot folder may have been a different folder when the job started.
        let Ok(relative) = path.strip_prefix(hot) else { return self.drops.forget(path) };
        self.drops.see(hot, relative, what, writer, self.now(), still_for);
        if let Some(Ok(Meaning::Part(sku))) = self.drops.get(path).map(|drop| &drop.meaning)
            && self.threads.are_busy_with(sku)
        {
            self.executor.part_arrived(sku);
        }
        self.lanes.stale = true;
    }
}

fn overtaken_by_a_newer(drop: &str) -> Reason {
    let what = format!(
        "{drop} was written again after it was processed, but the hot folder already had a newer file of this name."
    );
    let remedy = "Drop it again if it is to replace the newer file.";
    Reason::new("overtaken", what, remedy)
}
