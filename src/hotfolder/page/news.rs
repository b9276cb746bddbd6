//! The newest status, for the thread of the page.

use std::path::PathBuf;
use std::sync::Arc;

use crate::config::FolderPaths;
use crate::hotfolder::state::status::Status;

/// The newest status, for the page.
#[derive(Clone, Default)]
pub(super) struct News {
    pub(super) seen: Option<Arc<Seen>>,
    pub(super) has_ended: bool,
}

/// A status with the folders that it is about.
pub(super) struct Seen {
    pub(super) status: Status,
    pub(super) folders: FolderPaths,
    /// The state folder, which no change of the settings moves.
    pub(super) state: PathBuf,
}
