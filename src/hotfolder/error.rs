//! Why a station cannot go on, and why a job ends early: folders that fail, panics that must not take the station along.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

use crate::hotfolder::api::JobError;
use crate::hotfolder::state::Holder;
use crate::reason::Reason;

/// Calls into the pipeline; a panic there is the job's failure, not the station's.
pub(crate) fn guarded<T>(call: impl FnOnce() -> Result<T, JobError>) -> Result<T, JobError> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|panic| {
        let words = panic.downcast_ref::<&str>().copied().map(str::to_owned);
        let words = words.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
        let what = format!("An internal error stopped this job: {words}.");
        let remedy = "Keep the file and report it with this message: it is a mistake in isomark.";
        Err(JobError::Rejected(Reason::new("internal-error", what, remedy)))
    })
}

/// Folders heal: the drop stays and is tried again.
pub(crate) fn folder_trouble(error: std::io::Error) -> JobError {
    use std::io::ErrorKind::{PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull};
    let how = match error.kind() {
        StorageFull | QuotaExceeded => "is full",
        ReadOnlyFilesystem => "is read-only",
        PermissionDenied => "may not be written by isomark",
        _ => "fails",
    };
    let remedy =
        "Check that the folder exists, can be written and has space; the job then goes on by itself.";
    JobError::Retry(Reason::new("folder-trouble", format!("A folder of the station {how}: {error}."), remedy))
}

/// What the journal would have said is found out from the folders at the next start.
pub(crate) fn tell_trouble(noted: std::io::Result<()>) {
    if let Err(error) = noted {
        tracing::warn!("the journal lacks a line: {error}");
    }
}

/// Why a station cannot start or go on.
#[derive(Debug, thiserror::Error)]
pub enum StationError {
    /// A folder of the station cannot be made.
    #[error("the {purpose} folder cannot be made: {source}")]
    Folder {
        /// Which folder, as its key in the settings.
        purpose: &'static str,
        /// Where it should be.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The station's journal cannot be read or written.
    #[error("the station's journal in {path} cannot be used: {source}")]
    Journal {
        /// The state folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Another process runs this station.
    #[error("{}", held_words(.0))]
    Held(Option<Holder>),
    /// The lock of the station cannot be taken for another reason than that somebody holds it.
    #[error("the station's lock {path} cannot be taken: {source}")]
    Lock {
        /// The lock's file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A job said that nothing can be done any more.
    #[error("{}", .0.what)]
    Stopped(Reason),
}

/// What to do about a second station.
pub(crate) const STOP_THE_OTHER: &str =
    "Stop that one first. Another station needs folders `hot` and `state` of its own.";

impl StationError {
    /// The reason that people are shown.
    pub fn reason(&self) -> Reason {
        match self {
            Self::Folder { purpose, path, .. } => {
                let remedy = format!("Make the folder, or change `folders.{purpose}` in the station file.");
                Reason::new("folder-missing", format!("{self}."), remedy).in_file(path.display().to_string())
            }
            Self::Held(_) => Reason::new("station-held", format!("{self}."), STOP_THE_OTHER),
            Self::Journal { .. } => {
                let remedy = "Let isomark read and write `folders.state`, and see to free space on its disk.";
                Reason::new("station-journal", format!("{self}."), remedy)
            }
            Self::Lock { .. } => {
                let remedy =
                    "Let isomark write into `folders.state`, and choose a folder on a local disk for it.";
                Reason::new("station-lock", format!("{self}."), remedy)
            }
            Self::Stopped(reason) => reason.clone(),
        }
    }
}

fn held_words(holder: &Option<Holder>) -> String {
    match holder {
        Some(holder) => format!("the station is run by {holder}"),
        None => "the station is run by another process".into(),
    }
}
