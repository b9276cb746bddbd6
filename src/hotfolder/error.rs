//! Errors that end a job or the station: folders that fail, and panics that must not stop the station.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use crate::hotfolder::api::JobError;
use crate::hotfolder::state::Holder;
use crate::reason::Reason;

/// Calls into the pipeline; a panic there rejects the job and does not stop the station.
pub(crate) fn guarded<T>(call: impl FnOnce() -> Result<T, JobError>) -> Result<T, JobError> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|panic| {
        let message = panic.downcast_ref::<&str>().copied().map(str::to_owned);
        let message = message.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
        let what = format!("An internal error stopped this job: {message}.");
        let remedy = "Keep the file and report it with this message: this is a bug in isomark.";
        Err(JobError::Rejected(Reason::new("internal-error", what, remedy)))
    })
}

/// The reason for a folder that fails: the drop stays and is tried again, since folders become available again.
pub(crate) fn folder_trouble(error: std::io::Error) -> JobError {
    use std::io::ErrorKind::{PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull};
    if is_held_open(&error) {
        let what = format!("Another program has a file of the station open: {error}.");
        let remedy = "Close the program that has it open, or let it read files without locking them; the job then continues by itself.";
        return JobError::Retry(Reason::new("file-held-open", what, remedy));
    }
    let how = match error.kind() {
        StorageFull | QuotaExceeded => "is full",
        ReadOnlyFilesystem => "is read-only",
        PermissionDenied => "is not writable for isomark",
        _ => "cannot be used",
    };
    let remedy =
        "Check that the folder exists, is writable and has free space; the job then continues by itself.";
    JobError::Retry(Reason::new("folder-trouble", format!("A folder of the station {how}: {error}."), remedy))
}

/// Whether another program has locked the file, or has it open in a way that Windows does not let others touch it.
fn is_held_open(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{ExecutableFileBusy, ResourceBusy};
    // Sharing violation and lock violation. An error that names its file has the number only in its text.
    let is_code = |code: i32| {
        error.raw_os_error() == Some(code) || error.to_string().contains(&format!("(os error {code})"))
    };
    matches!(error.kind(), ResourceBusy | ExecutableFileBusy)
        || cfg!(windows) && [32, 33].into_iter().any(is_code)
}

/// Warns about a line that could not be written to the journal. The next start finds out the same from the folders. The same
/// problem, such as a full disk, is warned of once until a line is written again.
pub(crate) fn warn_if_not_noted(noted: std::io::Result<()>) {
    static LAST: Mutex<Option<String>> = Mutex::new(None);
    let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
    let Err(error) = noted else { return *last = None };
    let text = error.to_string();
    if last.as_ref() != Some(&text) {
        tracing::warn!("a line of the journal could not be written: {text}");
        *last = Some(text);
    }
}

/// Why a station cannot start or continue.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StationError {
    /// A folder of the station cannot be created.
    #[error("the {purpose} folder cannot be created: {source}")]
    Folder {
        /// Which folder, as its key in the settings.
        purpose: &'static str,
        /// Where it should be.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The station's journal cannot be read or written.
    #[error("the station's journal in {path} cannot be used: {source}")]
    Journal {
        /// The state folder.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// Another process already runs this station.
    #[error("{}", held_message(.0))]
    Held(Option<Holder>),
    /// The lock of the station cannot be taken, although no other process holds it.
    #[error("the station's lock {path} cannot be taken: {source}")]
    Lock {
        /// The lock's file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A job reported that the station cannot continue.
    #[error("{}", .0.what)]
    Stopped(Reason),
}

/// The remedy for a second station.
pub(crate) const STOP_THE_OTHER: &str =
    "Stop it first. A second station needs its own `hot` and `state` folders.";

impl StationError {
    /// The reason to show to people.
    pub fn reason(&self) -> Reason {
        match self {
            Self::Folder { purpose, path, .. } => {
                let remedy = format!("Create the folder, or change `folders.{purpose}` in the station file.");
                Reason::new("folder-missing", format!("{self}."), remedy).in_file(path.display().to_string())
            }
            Self::Held(_) => Reason::new("station-held", format!("{self}."), STOP_THE_OTHER),
            Self::Journal { .. } => {
                let remedy = "Give isomark read and write access to `folders.state`, and check the free space on its disk.";
                Reason::new("station-journal", format!("{self}."), remedy)
            }
            Self::Lock { .. } => {
                let remedy =
                    "Give isomark write access to `folders.state`, and use a folder on a local disk for it.";
                Reason::new("station-lock", format!("{self}."), remedy)
            }
            Self::Stopped(reason) => reason.clone(),
        }
    }
}

fn held_message(holder: &Option<Holder>) -> String {
    match holder {
        Some(holder) => format!("the station is already running: {holder}"),
        None => "the station is already running in another process".into(),
    }
}
