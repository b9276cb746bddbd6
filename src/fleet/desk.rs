//! What a station has to do with jobs for other lines, between its dispatcher, its job threads and the thread of the fleet.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::mpsc::SyncSender;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use tokio::sync::oneshot;

use crate::hotfolder::line::{Answer, Arriving, Claim, Ended, JobNews, Offered, OurJobs, Wake};

/// How long after its last sign of life a station begins with jobs of others. Then it waits: after 45 s, a person may give its jobs to
/// another station (`isomark.take_over`).
const CONFIRMED: Duration = Duration::from_secs(30);

/// A moment by two clocks: one stands still while the computer sleeps, the other may be set back.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contact(Instant, SystemTime);

impl Contact {
    pub(super) fn now() -> Self {
        Self(Instant::now(), SystemTime::now())
    }

    fn is_recent(self, now: Self) -> bool {
        let by_calendar = now.1.duration_since(self.1).unwrap_or_default();
        now.0.saturating_duration_since(self.0).max(by_calendar) < CONFIRMED
    }
}

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
    /// Open jobs of which the station has heard, since the last connection, that they are its own.
    confirmed: BTreeSet<Claim>,
    /// The beginning of the last sign of life that the database has answered.
    contact: Option<Contact>,
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
        let is_open = |claim: &Claim| ours.open.iter().any(|(open, _)| open == claim);
        state.checked.retain(is_open);
        state.confirmed.retain(is_open);
        state.ours = ours;
        let news = std::mem::take(&mut state.news);
        // Not before: what the database states and the station has not heard may be that a job is not its own.
        let confirmed = news.iter().filter_map(|news| match news {
            JobNews::IsOurs(claim) => Some(claim.clone()),
            _ => None,
        });
        state.confirmed.extend(confirmed);
        (news, is_new)
    }

    /// Another connection begins: everything is asked again.
    pub(super) fn begin(&self) {
        let mut state = self.state();
        state.checked.clear();
        state.confirmed.clear();
        // They are asked for once more.
        state.news.retain(|news| !matches!(news, JobNews::IsOurs(_)));
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

    /// The database has answered a sign of life that was sent then.
    pub(super) fn has_contact(&self, at: Contact) {
        self.state().contact = Some(at);
    }

    /// Whether the database has stated that an open job is this station's, and nobody else can have taken it over since.
    pub(super) fn is_confirmed(&self, claim: &Claim, now: Contact) -> bool {
        let state = self.state();
        state.confirmed.contains(claim) && state.contact.is_some_and(|contact| contact.is_recent(now))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_is_confirmed_for_a_limited_time_after_the_database_has_named_its_station() {
        let (desk, claim) = (Desk::default(), ("ab".to_owned(), 1));
        let start = Contact::now();
        let after = |seconds: u64, calendar: i64| {
            let shift = Duration::from_secs(calendar.unsigned_abs());
            let calendar = if calendar < 0 { start.1 - shift } else { start.1 + shift };
            Contact(start.0 + Duration::from_secs(seconds), calendar)
        };
        let is_confirmed = |now| desk.is_confirmed(&claim, now);
        desk.note(JobNews::IsOurs(claim.clone()));
        desk.has_contact(start);
        assert!(!is_confirmed(start), "the station has not heard of it");
        let ours = OurJobs { open: vec![(claim.clone(), true)], ..OurJobs::default() };
        let (news, _) = desk.exchange(ours.clone());
        assert_eq!(news, [JobNews::IsOurs(claim.clone())]);
        assert!(is_confirmed(after(29, 29)));
        assert!(is_confirmed(after(29, -3600)), "the calendar was set back");
        assert!(!is_confirmed(after(30, 30)), "a person may take it over soon");
        assert!(!is_confirmed(after(1, 3600)), "the computer has slept");
        desk.has_contact(after(60, 60));
        assert!(is_confirmed(after(60, 60)));
        desk.note(JobNews::IsOurs(claim.clone()));
        desk.begin();
        desk.exchange(ours);
        assert!(!is_confirmed(after(60, 60)), "it may have been taken over before this connection");
    }
}
