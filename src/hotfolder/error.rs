//! Why a job ends early: folders that fail, and panics that must not take the station along.

use std::panic::{AssertUnwindSafe, catch_unwind};

use super::job::JobError;
use crate::reason::Reason;

/// Calls into the pipeline; a panic there is the job's failure, not the station's.
pub(super) fn guarded<T>(call: impl FnOnce() -> Result<T, JobError>) -> Result<T, JobError> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|panic| {
        let words = panic.downcast_ref::<&str>().copied().map(str::to_owned);
        let words = words.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
        let what = format!("An internal error stopped this job: {words}.");
        let remedy = "Keep the file and report it with this message: it is a mistake in isomark.";
        Err(JobError::Rejected(Reason::new("internal-error", what, remedy)))
    })
}

/// Folders heal: the drop stays and is tried again.
pub(super) fn folder_trouble(error: std::io::Error) -> JobError {
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
pub(super) fn tell_trouble(noted: std::io::Result<()>) {
    if let Err(error) = noted {
        tracing::warn!("the journal lacks a line: {error}");
    }
}
