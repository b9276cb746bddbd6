//! What comes later than it belongs to, and what is still to be heard of.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::hotfolder::seen::Moment;

/// How long after a pattern was delivered settings for it are told to have come too late.
const LATE_SIDECAR: Duration = Duration::from_secs(10);
/// How long after a file was put back the system may take to report that.
const HEARD_BY: Duration = Duration::from_secs(5);

/// Files that are expected for a while.
#[derive(Default)]
pub(super) struct Late {
    /// How many companions came so far.
    pub(super) companions_came: u64,
    /// Companions that were not there when their part was done: until when they may follow it, and where it went.
    companions: BTreeMap<PathBuf, (Moment, PathBuf)>,
    /// The places of settings beside patterns that were done without any: until when they are told to be late.
    sidecars: BTreeMap<PathBuf, Moment>,
    /// Files that the station itself moved into the hot folder: until when that is heard.
    put_back: BTreeMap<PathBuf, Moment>,
}

impl Late {
    /// Nobody waits any longer for what did not come by now.
    pub(super) fn forget_before(&mut self, now: Moment) {
        self.companions.retain(|_, (until, _)| now < *until);
        self.sidecars.retain(|_, until| now < *until);
        self.put_back.retain(|_, until| now < *until);
    }

    /// Companions of a part that went to `place` may follow it.
    pub(super) fn expect_companions(&mut self, absent: Vec<PathBuf>, place: &Path, until: Moment) {
        self.companions.extend(absent.into_iter().map(|path| (path, (until, place.into()))));
    }

    pub(super) fn is_companion(&self, path: &Path) -> bool {
        self.companions.contains_key(path)
    }

    /// A companion came: where its part went.
    pub(super) fn take_companion(&mut self, path: &Path) -> Option<PathBuf> {
        self.companions.remove(path).map(|(_, place)| place)
    }

    /// A pattern was done without these settings.
    pub(super) fn expect_sidecar(&mut self, sidecar: &Path, now: Moment) {
        self.sidecars.insert(sidecar.into(), now + LATE_SIDECAR);
    }

    /// Whether settings that came are too late for their pattern.
    pub(super) fn take_sidecar(&mut self, path: &Path) -> bool {
        self.sidecars.remove(path).is_some()
    }

    /// The station put this file into the hot folder.
    pub(super) fn expect_own(&mut self, path: &Path, now: Moment) {
        self.put_back.insert(path.into(), now + HEARD_BY);
    }

    /// Whether what is heard of this file is the station's own doing.
    pub(super) fn take_own(&mut self, path: &Path) -> bool {
        self.put_back.remove(path).is_some()
    }
}
