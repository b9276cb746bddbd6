//! What can be done now, in the order in which it is to be done.

use std::collections::{BTreeMap, VecDeque};
use std::path::PathBuf;

use super::threads::Threads;
use crate::config::Sku;
use crate::hotfolder::seen::{Drop, Drops, Moment, SettleTimes};
use crate::hotfolder::state::{DropId, StampRecord};

/// A drop of this size or more is a large job, bytes: reading it alone takes longer than a moment.
pub(super) const LARGE: u64 = 4 << 20;

/// What is ready, for each SKU in its order; without a SKU each drop for itself.
pub(super) struct Lanes {
    lanes: BTreeMap<Option<Sku>, VecDeque<PathBuf>>,
    /// What was under way when the station ended without a word: done alone, after all others.
    suspects: VecDeque<PathBuf>,
    /// These drops, and how often that happened, as the journal counts.
    suspected: BTreeMap<DropId, (StampRecord, u32)>,
    /// What was due by this moment is in the lanes.
    pub(super) made: Moment,
    /// Something happened since they were made.
    pub(super) stale: bool,
}

impl Lanes {
    pub(super) fn new(suspected: BTreeMap<DropId, (StampRecord, u32)>) -> Self {
        let (lanes, suspects) = (BTreeMap::new(), VecDeque::new());
        Self { lanes, suspects, suspected, made: Moment::ZERO, stale: true }
    }

    pub(super) fn are_empty(&self) -> bool {
        self.lanes.is_empty() && self.suspects.is_empty()
    }

    /// Makes them anew, if anything happened or they are used up.
    pub(super) fn refresh(&mut self, drops: &Drops, threads: &Threads, now: Moment, times: &SettleTimes) {
        if !self.stale && !self.lanes.is_empty() {
            return;
        }
        (self.stale, self.made) = (false, now);
        self.lanes.clear();
        self.suspects.clear();
        for (sku, path) in drops.ready(now, times).into_iter().filter(|(_, path)| !threads.is_at(path)) {
            if drops.get(&path).is_some_and(|drop| self.deaths(drop) > 0) {
                self.suspects.push_back(path);
            } else {
                self.lanes.entry(sku).or_default().push_back(path);
            }
        }
    }

    /// The first drop whose SKU is free and that is small enough for the threads that are left.
    pub(super) fn next(&mut self, drops: &Drops, threads: &Threads) -> Option<PathBuf> {
        let large_too = threads.have_room_for_large();
        let is_next = |sku: &Option<Sku>, lane: &VecDeque<PathBuf>| {
            let is_large = lane.front().and_then(|first| drops.get(first)).is_some_and(is_large);
            sku.as_ref().is_none_or(|sku| !threads.are_busy_with(sku)) && (large_too || !is_large)
        };
        let sku = self.lanes.iter().find(|(sku, lane)| is_next(sku, lane))?.0.clone();
        let lane = self.lanes.get_mut(&sku)?;
        let path = lane.pop_front();
        if lane.is_empty() {
            self.lanes.remove(&sku);
        }
        path
    }

    /// The next drop to be done alone, once nothing else is left to do.
    pub(super) fn next_suspect(&mut self) -> Option<PathBuf> {
        if self.lanes.is_empty() { self.suspects.pop_front() } else { None }
    }

    /// How often the station ended while it was at this very file.
    pub(super) fn deaths(&self, drop: &Drop) -> u32 {
        if self.suspected.is_empty() {
            return 0;
        }
        let suspect = self.suspected.get(&DropId::hot(&drop.relative));
        suspect.filter(|(stamp, _)| stamp.is_of(drop.settle.stamp())).map_or(0, |(_, deaths)| *deaths)
    }

    /// The station did not end while it was at it.
    pub(super) fn survived(&mut self, drop: &DropId) {
        self.suspected.remove(drop);
    }
}

/// Whether a drop is known to be more than a moment's work.
pub(super) fn is_large(drop: &Drop) -> bool {
    drop.takes_long || drop.settle.stamp().size >= LARGE
}
