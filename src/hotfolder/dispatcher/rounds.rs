//! The repeated listings of the hot folder.

use std::collections::BTreeMap;

use crate::hotfolder::seen::Moment;

/// When the next listing is due, and the problems that the last one found with the hot folder itself.
#[derive(Default)]
pub(super) struct Rounds {
    pub(super) next: Moment,
    /// The folder is never listed again before this moment.
    pub(super) rests_until: Moment,
    pub(super) hot_is_missing: bool,
    /// The folders for results and originals that the last listing did not find, as text for the log.
    pub(super) missing: Option<String>,
    pub(super) troubles: Vec<String>,
    /// The problems, with the number of the last round that found them. A problem is logged once; if it is resolved and
    /// occurs again, it is logged again.
    warned: BTreeMap<String, u64>,
    number: u64,
    /// The leftovers of crashes were removed.
    pub(super) swept: bool,
}

impl Rounds {
    /// Starts another round: problems that the last one did not find are resolved.
    pub(super) fn begin(&mut self) {
        self.warned.retain(|_, number| *number == self.number);
        self.number += 1;
        self.troubles.clear();
    }

    /// When the next listing is due.
    pub(super) fn due(&self) -> Moment {
        self.next.max(self.rests_until)
    }

    /// Lists the folder as soon as possible.
    pub(super) fn make_due(&mut self) {
        self.next = Moment::ZERO;
    }

    /// Reports a problem with the hot folder itself, also in the status.
    pub(super) fn trouble(&mut self, problem: String) {
        self.warn_once(problem.clone());
        self.troubles.push(problem);
    }

    /// Logs a problem, unless the last round has logged it.
    pub(super) fn warn_once(&mut self, problem: String) {
        if !self.warned.contains_key(&problem) {
            tracing::warn!("{problem}");
        }
        self.warned.insert(problem, self.number);
    }
}
