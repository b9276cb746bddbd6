//! What can be done now, in the order in which it is to be done.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Bound::{Excluded, Included, Unbounded};
use std::path::PathBuf;

use super::threads::Threads;
use crate::config::{Sku, fold};
use crate::hotfolder::seen::{Drop, Drops, Meaning, Moment, SettleTimes, delivered_as};
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
    /// The lane that was served last.
    last: Option<Sku>,
    /// What was due by this moment is in the lanes.
    pub(super) made: Moment,
    /// Something happened since they were made.
    pub(super) stale: bool,
}

impl Lanes {
    pub(super) fn new(suspected: BTreeMap<DropId, (StampRecord, u32)>) -> Self {
        let (lanes, suspects) = (BTreeMap::new(), VecDeque::new());
        Self { lanes, suspects, suspected, last: None, made: Moment::ZERO, stale: true }
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

    /// The next drop that no job or earlier drop stands in the way of, and that is small enough for the threads that are
    /// left; of a SKU with the fewest jobs, one SKU after the other, so that many drawings of one hold up no other.
    pub(super) fn next(&mut self, drops: &Drops, threads: &Threads) -> Option<PathBuf> {
        let mut next: Option<(usize, Option<Sku>, usize)> = None;
        let (behind, before) = (Excluded(&self.last), Included(&self.last));
        let in_turn = self.lanes.range((behind, Unbounded)).chain(self.lanes.range((Unbounded, before)));
        for (sku, lane) in in_turn {
            let jobs = sku.as_ref().map_or(0, |sku| threads.jobs_of(sku).count());
            if next.as_ref().is_some_and(|(fewest, ..)| *fewest <= jobs) {
                continue;
            }
            if let Some(index) = first_free(lane, drops, threads) {
                next = Some((jobs, sku.clone(), index));
                if jobs == 0 {
                    break;
                }
            }
        }
        let (_, sku, index) = next?;
        let lane = self.lanes.get_mut(&sku)?;
        let path = lane.remove(index);
        if lane.is_empty() {
            self.lanes.remove(&sku);
        }
        self.last = sku;
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

/// The first drop of a lane that can begin: a part when its SKU is free, a drawing when no job and no earlier drop of the
/// SKU makes the result of its name.
fn first_free(lane: &VecDeque<PathBuf>, drops: &Drops, threads: &Threads) -> Option<usize> {
    let large_too = threads.have_room_for_large();
    let mut held = BTreeSet::new();
    for (index, drop) in lane.iter().enumerate().filter_map(|(index, path)| Some((index, drops.get(path)?))) {
        let fits = large_too || !is_large(drop);
        match &drop.meaning {
            Ok(Meaning::Pattern { sku, name }) => {
                let result = fold(&delivered_as(name));
                if fits && !held.contains(&result) && threads.may_make(sku, &result) {
                    return Some(index);
                }
                held.insert(result);
            }
            // What follows is made for the shape that it has.
            Ok(Meaning::Part(sku)) => {
                return (fits && threads.jobs_of(sku).next().is_none()).then_some(index);
            }
            // It needs no thread.
            Ok(Meaning::Companion) => return Some(index),
            Err(_) if fits => return Some(index),
            Err(_) => {}
        }
    }
    None
}

/// Whether a drop is known to be more than a moment's work.
pub(super) fn is_large(drop: &Drop) -> bool {
    drop.takes_long || drop.settle.stamp().size >= LARGE
}
