//! Which job is done next: each SKU in its order, large ones never on all threads.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::super::drop_id::DropId;
use super::super::drops::{Block, Drop, Obstacle};
use super::super::folders::{self, Found};
use super::super::job::Corrector;
use super::super::journal::StampRecord;
use super::super::names::{Meaning, delivered_as};
use super::super::settle::{Gap, Stamp, Verdict};
use super::super::task::{Task, Work};
use super::outcomes::part_under_way;
use super::{Running, Worker};
use crate::config::{ConfigError, JobSettings, Sku};
use crate::formats::Pace;
use crate::formats::pattern::is_picture;
use crate::reason::Reason;

/// A drop of this size or more is a large job, bytes: reading it alone takes longer than a moment.
const LARGE: u64 = 4 << 20;
/// A job that takes this long is a large one, whatever it looked like.
const LONG: Duration = Duration::from_secs(2);
/// A drop is rejected after the station ended as often while it was at it, as the journal counts; but for the first time
/// it was at nothing else.
const MOST_DEATHS: u32 = 5;

impl<C: Corrector> Worker<'_, C> {
    /// Gives every free thread something to do.
    pub(super) fn hand_out(&mut self) {
        if self.stale || self.lanes.is_empty() {
            self.make_lanes();
        }
        while self.has_room() {
            let Some(path) = self.next_in_lanes() else { break };
            self.begin(&path);
        }
        while self.running.is_empty() && self.lanes.is_empty() {
            let Some(path) = self.suspects.pop_front() else { break };
            self.begin(&path);
        }
        while self.has_room() {
            let busy: BTreeSet<Sku> =
                self.running.values().filter_map(|running| running.sku().cloned()).collect();
            let large_too = self.has_room_for_large();
            let next = self.reprocessing.next(self.now(), &busy, large_too);
            let Some((again, takes_long)) = next else { break };
            self.correct_again(again, takes_long, large_too);
        }
    }

    /// Whether a thread is free for a job that is not known to be large. Jobs that take long without having looked like it
    /// make room for as many others.
    pub(super) fn has_room(&self) -> bool {
        let now = self.now();
        let takes_long = |running: &&Running| !running.large && now.saturating_sub(running.since) >= LONG;
        let spare = self.running.values().filter(takes_long).count().min(self.threads);
        self.running.len() < self.threads + spare && !self.running.values().any(|running| running.alone)
    }

    /// Whether a large job leaves a thread to the small ones.
    fn has_room_for_large(&self) -> bool {
        self.running.values().filter(|running| running.large).count() + 1 < self.threads
    }

    fn make_lanes(&mut self) {
        self.stale = false;
        self.lanes.clear();
        self.suspects.clear();
        self.lanes_made = self.now();
        for (sku, path) in self.drops.ready(self.lanes_made, &self.times()) {
            if self.running.contains_key(&path) {
                continue;
            }
            if self.drops.get(&path).is_some_and(|drop| deaths(&self.suspected, drop) > 0) {
                self.suspects.push_back(path);
            } else {
                self.lanes.entry(sku).or_default().push_back(path);
            }
        }
    }

    pub(super) fn is_busy(&self, sku: &Sku) -> bool {
        self.running.values().any(|running| running.sku() == Some(sku))
    }

    /// The first drop whose SKU is free and that is small enough for the threads that are left.
    fn next_in_lanes(&mut self) -> Option<PathBuf> {
        let large_too = self.has_room_for_large();
        let mut found = None;
        for (sku, lane) in &self.lanes {
            let Some(first) = lane.front() else { continue };
            let is_large = self.drops.get(first).is_some_and(is_large);
            if sku.as_ref().is_none_or(|sku| !self.is_busy(sku)) && (large_too || !is_large) {
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
            Verdict::GiveUp(Gap::Companion) => (true, None),
            Verdict::GiveUp(Gap::Content) => (true, Some(drop.lacks.clone().unwrap_or_else(cut_short))),
        };
        let work = match drop.meaning.clone() {
            Ok(Meaning::Companion) => return self.companion(path),
            // A texture of a part that was done before it came.
            Ok(_)
                if is_picture(&drop.relative.to_string_lossy())
                    && self.late_companions.contains_key(path) =>
            {
                return self.companion(path);
            }
            Ok(Meaning::Part(sku)) => Work::Learn(sku),
            Ok(Meaning::Pattern { sku, name }) => Work::Correct { sku, name },
            Err(reason) => Work::Reject(reason),
        };
        if let Work::Correct { sku, .. } = &work
            && self.drops.has_part(sku)
        {
            return self.wait(path, Block::PartUnderWay, part_under_way(sku));
        }
        let (id, relative, stamp) = (DropId::hot(&drop.relative), drop.relative.clone(), drop.settle.stamp());
        let mut deaths = deaths(&self.suspected, drop);
        // What is delivered is only filed, and no fault of the file any more.
        if deaths > 0 && self.executor.is_delivered(&id, stamp) {
            deaths = 0;
        }
        let doomed = doomed.or_else(|| (deaths >= MOST_DEATHS).then(|| ends_isomark(deaths)));
        let waits_for_import = matches!(drop.block, Block::Until { obstacle: Obstacle::NoImportFolder, .. });
        let chance =
            Chance { last_chance, doomed, waits_for_import, alone: deaths > 0, large: is_large(drop) };
        self.start(path, (id, relative), work, stamp, chance);
    }

    fn start(
        &mut self,
        path: &Path,
        (drop, relative): (DropId, PathBuf),
        work: Work,
        stamp: Stamp,
        chance: Chance,
    ) {
        let settings = match &work {
            Work::Learn(sku) | Work::Correct { sku, .. } | Work::CorrectAgain { sku, .. } => {
                match self.job_settings(sku) {
                    Ok(settings) => settings,
                    Err(error) => {
                        let obstacle = match error {
                            ConfigError::BeingSaved { .. } => Obstacle::SettingsBeingSaved,
                            _ => Obstacle::Other,
                        };
                        return match &work {
                            Work::CorrectAgain { sku, name } => {
                                self.correct_again_later(sku, &delivered_as(name), error.reason());
                            }
                            _ => self.retry_later(path, obstacle, error.reason()),
                        };
                    }
                }
            }
            Work::Reject(_) => JobSettings::default(),
        };
        let running = Running {
            drop: drop.clone(),
            work: work.clone(),
            since: self.now(),
            stamp,
            large: chance.large,
            is_spare: self.running.values().filter(|running| !running.is_spare).count() >= self.threads,
            companions_came: self.companions_came,
            alone: chance.alone,
            settings_changes: self.settings_changes,
            was_delivered: self.kept.contains_key(path),
        };
        let task = Task {
            path: path.into(),
            drop,
            relative,
            work,
            station: self.settings.station().clone(),
            settings,
            stamp,
            last_chance: chance.last_chance,
            // Nothing waits for what is done alone.
            pace: if chance.large || chance.alone { Pace::Any } else { Pace::Quick },
            doomed: chance.doomed,
            settling: self.drops.settling_beside(path, self.now(), &self.times()),
            waits_for_import: chance.waits_for_import,
            kept: self.kept.remove(path),
            sidecar: self.drops.sidecar_beside(path),
        };
        if let Work::Correct { sku, .. } | Work::CorrectAgain { sku, .. } = &running.work {
            if self.drops.has_part(sku) { self.executor.part_came(sku) } else { self.executor.begins(sku) }
        }
        let tasks = if running.is_spare { &self.spare_tasks } else { &self.tasks };
        let sent = tasks.send(task);
        self.running.insert(path.into(), running);
        if sent.is_err() {
            self.running.remove(path);
        }
    }

    fn correct_again(&mut self, again: super::super::reprocess::Again, takes_long: bool, large_too: bool) {
        let look = folders::look(&again.original);
        let Ok(Some(Found::File(stamp))) = look else {
            tracing::warn!("{} cannot be corrected again: its original is not in the archive", again.name);
            return self.reprocessing.forget(&again.name);
        };
        let large = takes_long || stamp.size >= LARGE;
        if large && !large_too {
            return self.reprocessing.takes_long(&again.name);
        }
        let drop = again.drop();
        // The archived original bears the pattern's name.
        let name = again.original.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let work = Work::CorrectAgain { sku: again.sku, name };
        let chance = Chance { last_chance: true, doomed: None, waits_for_import: false, alone: false, large };
        self.start(&again.original, (drop, PathBuf::new()), work, stamp, chance);
    }
}

/// What is known of a drop's chances before it is read.
struct Chance {
    last_chance: bool,
    doomed: Option<Reason>,
    waits_for_import: bool,
    alone: bool,
    large: bool,
}

/// Whether a drop is known to be more than a moment's work.
fn is_large(drop: &Drop) -> bool {
    drop.takes_long || drop.settle.stamp().size >= LARGE
}

/// How often the station ended while it was at this very file.
fn deaths(suspects: &BTreeMap<DropId, (StampRecord, u32)>, drop: &Drop) -> u32 {
    if suspects.is_empty() {
        return 0;
    }
    let suspect = suspects.get(&DropId::hot(&drop.relative));
    suspect.filter(|(stamp, _)| stamp.is_of(drop.settle.stamp())).map_or(0, |(_, deaths)| *deaths)
}

fn ends_isomark(deaths: u32) -> Reason {
    let what = "isomark ended without a word each time it worked at this file, for want of memory perhaps.";
    let remedy = "Export it with fewer triangles or lines, or give the machine more memory.";
    Reason::new("ends-isomark", what, remedy).with_number("ends", f64::from(deaths), "", None)
}

fn cut_short() -> Reason {
    Reason::new("cut-short", "The file ends too early.", "Export or copy it again.")
}
