//! The rounds in which the hot folder is listed.

use std::collections::BTreeMap;

use crate::hotfolder::seen::Moment;

/// When the next round is due, and what the last one found wrong with the hot folder itself.
#[derive(Default)]
pub(super) struct Rounds {
    pub(super) next: Moment,
    /// The folder is not listed again before this moment, whatever asks for it.
    pub(super) rests_until: Moment,
    pub(super) hot_is_missing: bool,
    pub(super) troubles: Vec<String>,
    pub(super) complaints: Complaints,
    /// What crashes left behind was removed.
    pub(super) swept: bool,
}

impl Rounds {
    pub(super) fn is_due(&self) -> Moment {
        self.next.max(self.rests_until)
    }

    /// Only a listing tells what there is.
    pub(super) fn is_due_now(&mut self) {
        self.next = Moment::ZERO;
    }

    /// Something is wrong with the hot folder itself.
    pub(super) fn trouble(&mut self, words: String) {
        self.complaints.tell(words.clone());
        self.troubles.push(words);
    }
}

/// What is wrong in each listing, told when it begins; what is healed and comes back is told again.
#[derive(Default)]
pub(super) struct Complaints {
    /// Each with the round in which it was last heard of.
    told: BTreeMap<String, u64>,
    round: u64,
}

impl Complaints {
    pub(super) fn tell(&mut self, words: String) {
        if !self.told.contains_key(&words) {
            tracing::warn!("{words}");
        }
        self.told.insert(words, self.round);
    }

    /// What the last round did not find any more has healed.
    pub(super) fn next_round(&mut self) {
        self.told.retain(|_, round| *round == self.round);
        self.round += 1;
    }
}
