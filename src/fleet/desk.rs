//! What a station has to do with jobs for other lines, between its dispatcher, its job threads and the thread of the fleet.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::SyncSender;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::oneshot;

use crate::hotfolder::line::{Answer, Arriving, Claim, Ended, JobNews, Offered, OurJobs, Wake};

/// The desk of a station.
#[derive(Default)]
pub(super) struct Desk {
    state: Mutex<State>,
    wake: Mutex<Option<Wake>>,
}

#[derive(Default)]
struct State {
    news: Vec<JobNews>,
    ours: OurJobs,
    /// Open jobs whose state in the database is known, since the last connection.
    checked: BTreeSet<Claim>,
    /// Ends that the database has, until the station notes that.
    reported: BTreeSet<Claim>,
    has_checked: bool,
    /// Jobs that cannot be taken at the moment.
    busy: BTreeSet<String>,
    /// Whether a queue may have a job.
    looks: bool,
    /// The job that the station is about to note.
    asked: Option<(Claim, oneshot::Sender<Answer>)>,
    /// Offers that are being sent (`None`), or whose sender did not wait for the answer.
    offers: BTreeMap<String, Option<Offered>>,
}

/// An earlier offer of the same job.
pub(super) enum Earlier {
    None,
    IsBeingSent,
    Answered(Offered),
}

impl Desk {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn wake_with(&self, wake: Wake) {
        *self.wake.lock().unwrap_or_else(PoisonError::into_inner) = Some(wake);
    }

    /// Has news for the station.
    pub(super) fn note(&self, news: JobNews) {
        self.state().news.push(news);
        if let Some(wake) = self.wake.lock().unwrap_or_else(PoisonError::into_inner).as_ref() {
            wake();
        }
    }

    /// Takes what the station has; gives the news, and whether the thread of the fleet has something to do.
    pub(super) fn exchange(&self, ours: OurJobs) -> (Vec<JobNews>, bool) {
        let mut state = self.state();
        let is_new = state.ours != ours;
        if ours.has_room && !state.ours.has_room {
            state.looks = true;
        }
        state.reported.retain(|claim| ours.ended.iter().any(|ended| ended.claim == *claim));
        state.ours = ours;
        (std::mem::take(&mut state.news), is_new)
    }

    /// Another connection begins: everything is asked again.
    pub(super) fn begin(&self) {
        let mut state = self.state();
        state.checked.clear();
        state.reported.clear();
        state.busy.clear();
        state.offers.retain(|_, answer| answer.is_some());
        (state.looks, state.asked) = (true, None);
    }

    /// There may be a job.
    pub(super) fn look(&self) {
        let mut state = self.state();
        state.looks = true;
    }

    /// The same, also for jobs that could not be taken before.
    pub(super) fn look_again(&self) {
        let mut state = self.state();
        state.looks = true;
        state.busy.clear();
    }

    pub(super) fn found_nothing(&self) {
        self.state().looks = false;
    }

    /// Open jobs whose state is not known, and whether each is a drop.
    pub(super) fn unchecked(&self) -> Vec<(Claim, bool)> {
        let state = self.state();
        state.ours.open.iter().filter(|(claim, _)| !state.checked.contains(claim)).cloned().collect()
    }

    pub(super) fn is_checked(&self, claim: &Claim) {
        self.state().checked.insert(claim.clone());
    }

    /// The open jobs are known, or cannot be asked for.
    pub(super) fn has_answer(&self) {
        let is_first = !std::mem::replace(&mut self.state().has_checked, true);
        if is_first {
            self.note(JobNews::Available);
        }
    }

    pub(super) fn has_checked(&self) -> bool {
        self.state().has_checked
    }

    /// Ends that the database does not have yet.
    pub(super) fn unreported(&self) -> Vec<Ended> {
        let state = self.state();
        state.ours.ended.iter().filter(|ended| !state.reported.contains(&ended.claim)).cloned().collect()
    }

    pub(super) fn is_reported(&self, claim: &Claim) {
        self.state().reported.insert(claim.clone());
        self.note(JobNews::Reported(claim.clone()));
    }

    /// Whether a job may be taken, and those that may not.
    pub(super) fn may_take(&self) -> Option<Vec<String>> {
        let state = self.state();
        let is_known = state.ours.open.iter().all(|(claim, _)| state.checked.contains(claim));
        (state.looks && state.ours.has_room && is_known).then(|| state.busy.iter().cloned().collect())
    }

    pub(super) fn is_busy(&self, job: &str) {
        self.state().busy.insert(job.into());
    }

    /// Asks the station to note a job.
    pub(super) fn ask(&self, job: Arriving) -> oneshot::Receiver<Answer> {
        let claim = (job.id.clone(), job.attempt);
        let (answer, answered) = oneshot::channel();
        {
            let mut state = self.state();
            state.checked.remove(&claim);
            state.asked = Some((claim, answer));
        }
        self.note(JobNews::Arrives(Box::new(job)));
        answered
    }

    pub(super) fn answer(&self, claim: &Claim, answer: Answer) {
        let asked = self.state().asked.take_if(|(asked, _)| asked == claim);
        if let Some((_, asked)) = asked {
            let _ = asked.send(answer);
        }
    }

    /// Begins an offer, unless the same one was begun before.
    pub(super) fn begin_offer(&self, job: &str) -> Earlier {
        let mut state = self.state();
        match state.offers.remove(job) {
            Some(Some(answer)) => return Earlier::Answered(answer),
            Some(None) => {
                state.offers.insert(job.into(), None);
                return Earlier::IsBeingSent;
            }
            None => {}
        }
        state.offers.insert(job.into(), None);
        Earlier::None
    }

    pub(super) fn forget_offer(&self, job: &str) {
        self.state().offers.remove(job);
    }

    /// Gives the answer to the sender, or keeps it if he does not wait any more.
    pub(super) fn end_offer(&self, job: &str, answer: Offered, to: &SyncSender<Offered>) {
        let mut state = self.state();
        if state.offers.contains_key(job) && to.try_send(answer.clone()).is_err() {
            state.offers.insert(job.into(), Some(answer));
        }
    }
}
