//! The page of a station, in a program without the feature `page`: it is only reported as missing.

use std::path::Path;

#[cfg(feature = "cli")]
use crate::config::PageSettings;
use crate::config::{FolderPaths, Station};
use crate::hotfolder::state::status::Status;
#[cfg(feature = "cli")]
use crate::reason::Reason;

/// There is no page, so nothing prevents it.
#[cfg(feature = "cli")]
pub(crate) fn page_trouble(_: &PageSettings) -> Option<Reason> {
    None
}

/// A page that cannot be shown.
pub(crate) struct Page;

/// Does nothing when it is dropped.
pub(crate) struct Ends;

impl Page {
    /// The page that the settings ask for.
    pub(crate) fn of(station: &Station) -> Option<Self> {
        station.page.as_ref().map(|_| Self)
    }

    /// Does nothing.
    pub(crate) fn end_on_drop(&self) -> Ends {
        Ends
    }

    /// Does nothing.
    pub(crate) fn publish(&self, _: Status, _: &FolderPaths, _: &Path) {}

    /// Why there is no page.
    pub(crate) fn trouble(&self) -> Option<String> {
        Some("[page] has no effect: this isomark was built without the feature `page`.".into())
    }

    /// Reports that there is no page.
    pub(crate) fn run(&self) {
        tracing::warn!("{}", self.trouble().unwrap_or_default());
    }
}
