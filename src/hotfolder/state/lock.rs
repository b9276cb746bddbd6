//! One process for each station: a lock that the operating system frees when the process ends for any reason.
//!
//! ```text
//! state/station.lock      locked while the station runs; empty, and never removed
//! state/station.toml      the holder: process, machine and time; valid only while the lock is taken
//! ```
//!
//! The holder is in a separate file, because on Windows no other process can read a locked file.

use std::fs::TryLockError;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use fs_err as fs;

use super::Holder;
use crate::hotfolder::error::StationError;
use crate::hotfolder::seen::Identity;
use crate::hotfolder::seen::folders::{identity, is_still_at};

const LOCK: &str = "station.lock";
/// `isomark status` takes the lock for a moment to check whether a station holds it; a start waits for longer than
/// that.
const ATTEMPTS: u32 = 20;
const PAUSE: Duration = Duration::from_millis(50);

/// The right to run a station, until it is dropped or the process ends.
#[derive(Debug)]
pub struct StationLock {
    path: PathBuf,
    file: std::fs::File,
}

/// Keeps a second station from using the same hot folder. On Unix the folder itself is locked. Windows cannot lock
/// folders, so there it is a file in the temporary folder of the user; stations of other users are not noticed.
#[derive(Debug)]
pub(crate) struct HotLock {
    /// The folder that it is for.
    pub(crate) identity: Option<Identity>,
    /// `None` where nothing can be locked, as on some shares.
    _file: Option<std::fs::File>,
}

impl HotLock {
    /// Takes the lock; `None` when another station has it.
    pub(crate) fn take(hot: &Path) -> Option<Self> {
        let identity = identity(hot);
        let Ok(file) = lockable(hot) else { return Some(Self { identity, _file: None }) };
        for attempt in 1..=ATTEMPTS {
            match file.try_lock() {
                Ok(()) => return Some(Self { identity, _file: Some(file) }),
                Err(TryLockError::WouldBlock) if attempt == ATTEMPTS => {}
                Err(TryLockError::WouldBlock) => std::thread::sleep(PAUSE),
                Err(TryLockError::Error(_)) => return Some(Self { identity, _file: None }),
            }
        }
        None
    }
}

/// Whether another station uses the hot folder now.
#[cfg(feature = "cli")]
pub(crate) fn is_hot_folder_held(hot: &Path) -> bool {
    hot.exists() && HotLock::take(hot).is_none()
}

#[cfg(unix)]
fn lockable(hot: &Path) -> std::io::Result<std::fs::File> {
    std::fs::File::open(hot)
}

#[cfg(not(unix))]
fn lockable(hot: &Path) -> std::io::Result<std::fs::File> {
    let full = std::fs::canonicalize(hot)?;
    let hash = blake3::hash(crate::config::fold(&full.to_string_lossy()).as_bytes()).to_hex();
    let path = tempfile::env::temp_dir().join(format!("isomark-hot-{}.lock", &hash[..16]));
    std::fs::OpenOptions::new().create(true).read(true).write(true).truncate(false).open(path)
}

impl StationLock {
    /// Takes the lock in the station's state folder, which must exist.
    ///
    /// # Errors
    /// [`StationError::Held`] with the holder, or [`StationError::Lock`] when the file cannot be created or locked.
    pub fn take(state: &Path, station: &str) -> Result<Self, StationError> {
        let path = state.join(LOCK);
        let trouble = |source| StationError::Lock { path: path.clone(), source };
        // Windows does not lock a file that is opened only for appending.
        let file =
            fs::OpenOptions::new().create(true).read(true).append(true).open(&path).map_err(trouble)?;
        let file = file.into_parts().0;
        for attempt in 1..=ATTEMPTS {
            match file.try_lock() {
                Ok(()) => break,
                Err(TryLockError::WouldBlock) if attempt == ATTEMPTS => {
                    return Err(StationError::Held(Holder::read(state)));
                }
                Err(TryLockError::WouldBlock) => std::thread::sleep(PAUSE),
                Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => {
                    tracing::warn!(
                        "cannot lock {}: make sure that no second isomark runs this station",
                        path.display()
                    );
                    break;
                }
                Err(TryLockError::Error(error)) => return Err(trouble(error)),
            }
        }
        // The lock is valid without this file, too: a full disk must not prevent a start.
        if let Err(error) = Holder::this_process(station).write(state) {
            tracing::warn!("cannot record which process runs this station: {error}");
        }
        Ok(Self { path, file })
    }

    /// Takes the lock again if its file was removed or replaced, since such a lock stops no other station. Returns
    /// whether it did.
    pub(crate) fn keep_in_place(&mut self, state: &Path, station: &str) -> Result<bool, StationError> {
        if is_still_at(&self.file, &self.path) {
            return Ok(false);
        }
        let path = self.path.clone();
        fs::create_dir_all(state).map_err(|source| StationError::Lock { path, source })?;
        *self = Self::take(state, station)?;
        Ok(true)
    }

    /// The process that runs the station now; `None` when it is not running.
    ///
    /// # Errors
    /// When the lock's file cannot be read.
    pub fn holder(state: &Path) -> std::io::Result<Option<Holder>> {
        let file = match fs::File::open(state.join(LOCK)) {
            Ok(file) => file.into_parts().0,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(error),
        };
        match file.try_lock_shared() {
            Ok(()) => Ok(None),
            Err(TryLockError::WouldBlock) => Ok(Some(Holder::read(state).unwrap_or_else(Holder::unknown))),
            Err(TryLockError::Error(error)) => Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hot_folder_is_used_by_one_station() {
        let [hot, other] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let taken = HotLock::take(hot.path());
        assert!(taken.is_some() && HotLock::take(hot.path()).is_none());
        assert!(HotLock::take(other.path()).is_some());
        drop(taken);
        assert!(HotLock::take(hot.path()).is_some());
    }

    #[test]
    fn a_second_start_names_the_holder_and_succeeds_afterwards() {
        let state = tempfile::tempdir().unwrap();
        assert_eq!(StationLock::holder(state.path()).unwrap(), None);
        let lock = StationLock::take(state.path(), "Laser \"1\"").unwrap();
        let Err(StationError::Held(Some(holder))) = StationLock::take(state.path(), "other") else {
            panic!("the lock is held")
        };
        assert_eq!((holder.process, holder.station.as_str()), (std::process::id(), "Laser '1'"));
        assert_eq!(StationLock::holder(state.path()).unwrap(), Some(holder));
        drop(lock);
        assert_eq!(StationLock::holder(state.path()).unwrap(), None);
        StationLock::take(state.path(), "other").unwrap();
    }
}
