//! Files that arrive after the drop they belong to, and files whose events are still to come.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::hotfolder::seen::Moment;

/// Settings that arrive within this time after the delivery of their pattern are reported as too late.
const LATE_SIDECAR: Duration = Duration::from_secs(10);
/// Companions that are taken along within this time are not logged: they arrive together with their drop.
const TOGETHER: Duration = Duration::from_secs(2);
/// How long the system may take to report a file that the station itself put back.
const HEARD_BY: Duration = Duration::from_secs(5);

/// Files that are expected for a while.
#[derive(Default)]
pub(super) struct Late {
    /// How many companions have arrived so far.
    pub(super) companions_arrived: u64,
    /// Companions that were missing when their part was filed: until when they may follow it, and where it was moved.
    companions: BTreeMap<PathBuf, (Moment, PathBuf)>,
    /// The paths of settings for patterns that were delivered without any: until when they are reported as too late.
    sidecars: BTreeMap<PathBuf, Moment>,
    /// Files that the station itself moved into the hot folder: until when an event for them is expected.
    put_back: BTreeMap<PathBuf, Moment>,
    /// Companions that nothing has taken along yet: when that is logged, and the words.
    unclaimed: BTreeMap<PathBuf, (Moment, String)>,
}

impl Late {
    /// Forgets what was expected before `now`.
    pub(super) fn forget_before(&mut self, now: Moment) {
        self.companions.retain(|_, (until, _)| now < *until);
        self.sidecars.retain(|_, until| now < *until);
        self.put_back.retain(|_, until| now < *until);
    }

    /// Lets companions follow their part, which was moved to `place`.
    pub(super) fn expect_companions(&mut self, absent: Vec<PathBuf>, place: &Path, until: Moment) {
        self.companions.extend(absent.into_iter().map(|path| (path, (until, place.into()))));
    }

    pub(super) fn is_companion(&self, path: &Path) -> bool {
        self.companions.contains_key(path)
    }

    /// Returns where the part of a late companion was moved.
    pub(super) fn take_companion(&mut self, path: &Path) -> Option<PathBuf> {
        self.companions.remove(path).map(|(_, place)| place)
    }

    /// Expects settings that were missing when their pattern was delivered.
    pub(super) fn expect_sidecar(&mut self, sidecar: &Path, now: Moment) {
        self.sidecars.insert(sidecar.into(), now + LATE_SIDECAR);
    }

    /// Whether these settings are too late for their pattern.
    pub(super) fn take_sidecar(&mut self, path: &Path) -> bool {
        self.sidecars.remove(path).is_some()
    }

    /// Logs these words if nothing takes the companion along for a while.
    pub(super) fn log_if_unclaimed(&mut self, path: &Path, words: String, now: Moment) {
        self.unclaimed.insert(path.into(), (now + TOGETHER, words));
    }

    /// The companions whose time is over, with the words for the log.
    pub(super) fn take_unclaimed(&mut self, now: Moment) -> Vec<(PathBuf, String)> {
        let (due, later): (BTreeMap<_, _>, _) =
            std::mem::take(&mut self.unclaimed).into_iter().partition(|(_, (due, _))| *due <= now);
        self.unclaimed = later;
        due.into_iter().map(|(path, (_, words))| (path, words)).collect()
    }

    /// Expects an event for a file that the station itself put into the hot folder.
    pub(super) fn expect_own(&mut self, path: &Path, now: Moment) {
        self.put_back.insert(path.into(), now + HEARD_BY);
    }

    /// Whether an event for this file is caused by the station itself.
    pub(super) fn take_own(&mut self, path: &Path) -> bool {
        self.put_back.remove(path).is_some()
    }
}
