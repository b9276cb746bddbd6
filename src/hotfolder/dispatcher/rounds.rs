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
    /// What is wrong in each listing, told when it begins, and in which round it was last heard of; what is healed and
    /// comes back is told again.
    warned: BTreeMap<String, u64>,
    number: u64,
    /// What crashes left behind was removed.
    pub(super) swept: bool,
}

impl Rounds {
    /// Begins another round: what the last one did not find any more has healed.
    pub(super) fn begin(&mut self) {
        self.warned.retain(|_, number| *number == self.number);
        self.number += 1;
        self.troubles.clear();
    }

    /// When it is due.
    pub(super) fn due(&self) -> Moment {
        self.next.max(self.rests_until)
    }

    /// Only a listing tells what there is.
    pub(super) fn make_due(&mut self) {
        self.next = Moment::ZERO;
    }

    /// Something is wrong with the hot folder itself.
    pub(super) fn trouble(&mut self, words: String) {
        self.warn_once(words.clone());
        self.troubles.push(words);
    }

    /// Something is wrong that stays so.
    pub(super) fn warn_once(&mut self, words: String) {
        if !self.warned.contains_key(&words) {
            tracing::warn!("{words}");
        }
        self.warned.insert(words, self.number);
    }
}
