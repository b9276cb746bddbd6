//! The drops that can be processed now, in their order.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Bound::{Excluded, Included, Unbounded};
use std::path::PathBuf;

use super::threads::Threads;
use crate::config::{Sku, fold};
use crate::hotfolder::seen::{Drop, Drops, Meaning, Moment, SettleTimes, delivered_as};
use crate::hotfolder::state::{DropId, StampRecord};

/// A drop of this size or more is a large job, bytes: even reading it takes long.
pub(super) const LARGE: u64 = 4 << 20;

/// The drops that are ready, one lane for each SKU and one for drops without a SKU.
pub(super) struct Lanes {
    lanes: BTreeMap<Option<Sku>, VecDeque<PathBuf>>,
    /// Drops that were being processed when the station crashed: processed alone, after all others.
    suspects: VecDeque<PathBuf>,
    /// These drops, with the number of crashes from the journal.
    suspected: BTreeMap<DropId, (StampRecord, u32)>,
    /// The lane that was served last.
    last: Option<Sku>,
    /// The lanes contain the drops that were due at this moment.
    pub(super) made: Moment,
    /// Something happened after they were made.
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

    /// Makes the lanes again, if anything happened or they are empty.
    pub(super) fn refresh(&mut self, drops: &Drops, threads: &Threads, now: Moment, times: &SettleTimes) {
        if !self.stale && !self.lanes.is_empty() {
            return;
        }
        (self.stale, self.made) = (false, now);
        self.lanes.clear();
        self.suspects.clear();
        for (path, drop) in drops.ready(now, times, |path| threads.is_at(path)) {
            if self.deaths(drop) > 0 {
                self.suspects.push_back(path.into());
            } else {
                self.lanes.entry(drop.sku().cloned()).or_default().push_back(path.into());
            }
        }
    }

    /// The next drop that is blocked by no job and no earlier drop, and is small enough for the free threads. It is of
    /// a SKU with the fewest jobs, one SKU after the other, so that many drawings of one SKU do not delay other SKUs.
    pub(super) fn next(&mut self, drops: &Drops, threads: &Threads) -> Option<PathBuf> {
        let mut next: Option<(usize, Option<Sku>, usize)> = None;
        let (behind, before) = (Excluded(&self.last), Included(&self.last));
        let in_turn = self.lanes.range((behind, Unbounded)).chain(self.lanes.range((Unbounded, before)));
        for (sku, lane) in in_turn {
            let jobs = sku.as_ref().map_or(0, |sku| threads.count_of(sku));
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

    /// The next drop to be processed alone, when no other drops are left.
    pub(super) fn next_suspect(&mut self) -> Option<PathBuf> {
        if self.lanes.is_empty() { self.suspects.pop_front() } else { None }
    }

    /// How often the station crashed while it processed exactly this file.
    pub(super) fn deaths(&self, drop: &Drop) -> u32 {
        if self.suspected.is_empty() {
            return 0;
        }
        let suspect = self.suspected.get(&DropId::hot(&drop.relative));
        suspect.filter(|(stamp, _)| stamp.is_of(drop.settle.stamp())).map_or(0, |(_, deaths)| *deaths)
    }

    /// The station processed the drop without a crash.
    pub(super) fn survived(&mut self, drop: &DropId) {
        self.suspected.remove(drop);
    }
}

/// The first drop of a lane that can start: a part when its SKU is free, a drawing when no job and no earlier drop of
/// the SKU makes the same result.
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
            // The drops after it need the surface of this part.
            Ok(Meaning::Part(sku)) => {
                return (fits && threads.jobs_of(sku).next().is_none()).then_some(index);
            }
            // A companion needs no thread.
            Ok(Meaning::Companion) => return Some(index),
            Err(_) if fits => return Some(index),
            Err(_) => {}
        }
    }
    None
}

/// Whether a drop is known to be a large job.
pub(super) fn is_large(drop: &Drop) -> bool {
    drop.takes_long || drop.settle.stamp().size >= LARGE
}
