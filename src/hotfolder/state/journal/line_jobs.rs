//! The steps of jobs for other lines and of other senders, as lines of the journal.

use std::io;

use super::line::Record;
use super::routed::{Arrival, EndedJob, Offer};
use super::{DropId, Journal};
use crate::hotfolder::line::Claim;
use crate::hotfolder::seen::settle::Stamp;

impl Journal {
    /// The line that exactly this drop was offered to.
    pub(crate) fn offer(&self, drop: &DropId, stamp: Stamp) -> Option<&Offer> {
        self.routed.offers.get(drop).filter(|offer| offer.stamp.is_of(stamp))
    }

    /// Notes that a drop is about to be offered to a line: from now on it belongs there.
    pub(crate) fn offering(&mut self, drop: &DropId, stamp: Stamp, line: &str, job: &str) -> io::Result<()> {
        let (drop, stamp, line, job) = (drop.clone(), stamp.into(), line.into(), job.into());
        self.append(Record::Offering { drop, stamp, line, job }, true)
    }

    /// Notes that a drop is in the queue of another line, and filed.
    pub(crate) fn handed_over(&mut self, drop: &DropId, line: &str, job: &str) -> io::Result<()> {
        self.append(Record::HandedOver { drop: drop.clone(), line: line.into(), job: job.into() }, false)
    }

    /// The job of another sender that a drop is, or is about to be.
    pub(crate) fn arrival(&self, drop: &DropId) -> Option<&Arrival> {
        self.routed.arrivals.get(drop)
    }

    /// All jobs of other senders that have not ended.
    pub(crate) fn arrivals(&self) -> Vec<(DropId, Arrival)> {
        self.routed.arrivals.iter().map(|(drop, arrival)| (drop.clone(), arrival.clone())).collect()
    }

    /// The end of a job of another sender.
    pub(crate) fn ended_job(&self, job: &str) -> Option<&EndedJob> {
        self.routed.ended.get(job)
    }

    /// Up to `limit` jobs whose end is to be reported.
    pub(crate) fn unreported_jobs(&self, limit: usize) -> Vec<(String, EndedJob)> {
        let jobs = self.routed.unreported.iter().take(limit);
        jobs.filter_map(|job| Some((job.clone(), self.routed.ended.get(job)?.clone()))).collect()
    }

    /// Notes a job of another sender, whose files are flushed under hidden names; or its next attempt.
    pub(crate) fn arriving(
        &mut self,
        drop: &DropId,
        (job, attempt): &Claim,
        is_drop: bool,
    ) -> io::Result<()> {
        let (drop, job, hot) = (drop.clone(), job.clone(), self.hot);
        self.append(Record::Arriving { drop, job, attempt: *attempt, is_drop, hot }, true)
    }

    /// Notes that a job is certainly this station's, and its files are about to get their names.
    pub(crate) fn arrived(&mut self, drop: &DropId) -> io::Result<()> {
        self.append(Record::Arrived { drop: drop.clone() }, true)
    }

    /// Notes that a job is certainly not this station's.
    pub(crate) fn returned(&mut self, drop: &DropId) -> io::Result<()> {
        self.append(Record::Returned { drop: drop.clone() }, false)
    }

    /// Notes the end of a job that has no drop: it was removed, or ended in an earlier attempt.
    pub(crate) fn job_ended(
        &mut self,
        drop: Option<&DropId>,
        (job, attempt): &Claim,
        outcome: &str,
        detail: &str,
    ) -> io::Result<()> {
        let (drop, job, outcome, detail) = (drop.cloned(), job.clone(), outcome.into(), detail.into());
        let record = Record::JobEnded { drop, job, attempt: *attempt, outcome, detail, is_reported: false };
        self.append(record, true)
    }

    /// Notes that the fleet knows the end of a job.
    pub(crate) fn job_reported(&mut self, (job, attempt): &Claim) -> io::Result<()> {
        self.append(Record::JobReported { job: job.clone(), attempt: *attempt }, false)
    }
}
