//! Jobs for other lines in the journal: drops that are handed over, and jobs that others sent.
//!
//! ```text
//!  a drop for another line:  nothing ──offering──▶ Offer ──handed-over──▶ nothing
//!
//!                                      returned
//!  a job that another sent:  nothing ◀───────── hidden ──arrived──▶ a drop ──done, listed, rejected──▶ Ended
//!                               └──arriving──────▲                                                  job-reported
//! ```
//!
//! A job's identity is noted before anything of it is visible in the hot folder, and its end is the same line as that of its drop.
//! So whichever step is the last before a crash, the station knows what the job is and whether it has ended.

use std::collections::{BTreeMap, BTreeSet};

use super::line::{Certainty, Record, StampRecord};
use crate::hotfolder::line::Claim;
use crate::hotfolder::seen::folders::Identity;
use crate::hotfolder::state::drop_id::DropId;

/// Ended jobs that are remembered after their report, to recognise them if they arrive again.
const MAX_ENDED: usize = 10_000;

/// A drop that was offered to another line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Offer {
    pub(super) stamp: StampRecord,
    pub(crate) line: String,
    pub(crate) job: String,
}

/// A job that another sent, and that has not ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Arrival {
    pub(crate) claim: Claim,
    /// Whether it is a drop in the hot folder, or is about to get that name.
    pub(crate) is_drop: bool,
    /// The identity of the hot folder.
    pub(crate) hot: Option<Identity>,
}

/// A job of another sender that has ended here.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct EndedJob {
    pub(crate) attempt: i32,
    pub(crate) outcome: String,
    /// The path of a rejected drop, or the code of the reason.
    pub(crate) detail: String,
    at: String,
    pub(crate) is_reported: bool,
}

/// The jobs for other lines and of other senders.
#[derive(Debug, Default)]
pub(super) struct Routed {
    pub(super) offers: BTreeMap<DropId, Offer>,
    pub(super) arrivals: BTreeMap<DropId, Arrival>,
    pub(super) ended: BTreeMap<String, EndedJob>,
    pub(super) unreported: BTreeSet<String>,
}

impl Routed {
    pub(super) fn len(&self) -> usize {
        self.offers.len() + self.arrivals.len() + self.ended.len()
    }

    /// Applies a record of this file.
    pub(super) fn apply(&mut self, at: &str, record: Record) {
        match record {
            Record::Offering { drop, stamp, line, job } => {
                self.offers.insert(drop, Offer { stamp, line, job });
            }
            Record::HandedOver { drop, .. } => self.forget_offer(&drop),
            Record::Arriving { drop, job, attempt, is_drop, hot } => {
                self.arrivals.insert(drop, Arrival { claim: (job, attempt), is_drop, hot });
            }
            Record::Arrived { drop } => {
                self.arrivals.entry(drop).and_modify(|arrival| arrival.is_drop = true);
            }
            Record::Returned { drop } => {
                self.arrivals.remove(&drop);
            }
            Record::JobEnded { drop, job, attempt, outcome, detail, is_reported } => {
                if let Some(drop) = drop {
                    self.arrivals.remove(&drop);
                }
                let ended = EndedJob { attempt, outcome, detail, at: at.into(), is_reported };
                self.insert(job, ended);
            }
            Record::JobReported { job, attempt } => {
                if let Some(ended) = self.ended.get_mut(&job).filter(|ended| ended.attempt == attempt) {
                    ended.is_reported = true;
                    self.unreported.remove(&job);
                }
            }
            _ => {}
        }
    }

    fn insert(&mut self, job: String, ended: EndedJob) {
        if ended.is_reported {
            self.unreported.remove(&job);
        } else {
            self.unreported.insert(job.clone());
        }
        self.ended.insert(job, ended);
        if self.ended.len() > 2 * MAX_ENDED {
            let mut ages: Vec<String> = self.ended.values().map(|ended| ended.at.clone()).collect();
            ages.sort();
            let oldest = ages.swap_remove(ages.len() - MAX_ENDED);
            self.ended.retain(|_, ended| !ended.is_reported || ended.at >= oldest);
        }
    }

    pub(super) fn forget_offer(&mut self, drop: &DropId) {
        self.offers.remove(drop);
    }

    /// Notes that a drop has ended, if it is a job of another sender.
    pub(super) fn end(&mut self, drop: &DropId, at: &str, outcome: &str, detail: &str) {
        if !self.arrivals.get(drop).is_some_and(|arrival| arrival.is_drop) {
            return;
        }
        if let Some(Arrival { claim: (job, attempt), .. }) = self.arrivals.remove(drop) {
            let (outcome, detail) = (outcome.into(), detail.into());
            self.insert(job, EndedJob { attempt, outcome, detail, at: at.into(), is_reported: false });
        }
    }

    pub(super) fn end_of_drawing(&mut self, drop: &DropId, at: &str, certainty: Certainty) {
        let outcome = if certainty == Certainty::Certain { "delivered" } else { "uncertain" };
        self.end(drop, at, outcome, "");
    }

    /// The records that are still needed.
    pub(super) fn records(&self) -> Vec<Record> {
        let mut records = Vec::new();
        for (drop, Offer { stamp, line, job }) in &self.offers {
            let (drop, line, job) = (drop.clone(), line.clone(), job.clone());
            records.push(Record::Offering { drop, stamp: *stamp, line, job });
        }
        for (drop, Arrival { claim: (job, attempt), is_drop, hot }) in &self.arrivals {
            let (drop, job, attempt) = (drop.clone(), job.clone(), *attempt);
            records.push(Record::Arriving { drop, job, attempt, is_drop: *is_drop, hot: *hot });
        }
        let mut reported: Vec<_> = self.ended.iter().filter(|(_, ended)| ended.is_reported).collect();
        reported.sort_by(|(_, a), (_, b)| b.at.cmp(&a.at));
        let kept = self.ended.iter().filter(|(_, ended)| !ended.is_reported);
        for (job, ended) in kept.chain(reported.into_iter().take(MAX_ENDED)) {
            let EndedJob { attempt, outcome, detail, is_reported, at: _ } = ended.clone();
            let job = job.clone();
            records.push(Record::JobEnded { drop: None, job, attempt, outcome, detail, is_reported });
        }
        records
    }
}
