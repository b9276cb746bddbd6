//! What the times of files state on this system.

#![allow(unreachable_pub, reason = "a module of tests")]

use std::path::Path;
use std::time::{Duration, UNIX_EPOCH};

use fs_err as fs;

/// Whether a station recognizes its folders after files in them changed; otherwise prints that this is skipped. On Windows it
/// recognizes them by the time of their creation, for which Wine states the time of the last change.
pub fn are_those_of_creation(folder: &Path) -> bool {
    let probe = tempfile::NamedTempFile::new_in(folder).unwrap();
    let changed = UNIX_EPOCH + Duration::from_secs(1_000_000_000);
    probe.as_file().set_modified(changed).unwrap();
    let is_kept = fs::metadata(probe.path()).unwrap().created().map_or(true, |created| created != changed);
    if !is_kept {
        eprintln!("SKIPPED: this system does not keep the time when a folder was created");
    }
    is_kept
}
