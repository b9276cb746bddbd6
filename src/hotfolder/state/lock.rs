//! One station, one process: a lock that the operating system frees however its holder ends.
//!
//! ```text
//! state/station.lock      locked as long as the station runs; empty, and never removed
//! state/station.toml      who holds it: process, machine and time; what it says holds only while the lock is taken
//! ```
//!
//! The words lie beside the lock and not in it, because on Windows nobody else can read a locked file.

use std::fs::TryLockError;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use fs_err as fs;

use super::Holder;
use crate::hotfolder::error::StationError;
use crate::hotfolder::seen::Identity;
use crate::hotfolder::seen::folders::{identity, lies_at};

const LOCK: &str = "station.lock";
/// `isomark status` takes the lock for a moment to see whether somebody has it; a start waits for as long as that.
const ATTEMPTS: u32 = 20;
const PAUSE: Duration = Duration::from_millis(50);

/// The right to run a station; dropping it, or the end of the process, gives it back.
#[derive(Debug)]
pub struct StationLock {
    path: PathBuf,
    file: std::fs::File,
}

/// Holds other stations off a hot folder, whose drops both would take. On Unix the folder itself is locked; on Windows,
/// which locks no folders, a file for it among the temporary files of the user, so that others' stations are not seen.
#[derive(Debug)]
pub(crate) struct HotLock {
    /// Which folder it is for.
    pub(crate) identity: Option<Identity>,
    /// `None` where nothing can be locked, as on some shares.
    _file: Option<std::fs::File>,
}

impl HotLock {
    /// Takes it; `None` when another station has it.
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
    /// [`StationError::Held`] with who holds it, or [`StationError::Lock`] when the file cannot be made or locked.
    pub fn take(state: &Path, station: &str) -> Result<Self, StationError> {
        let path = state.join(LOCK);
        let trouble = |source| StationError::Lock { path: path.clone(), source };
        // Windows locks no file that is opened for appending alone.
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
                        "{} cannot be locked there: see to it yourself that no second isomark runs this station",
                        path.display()
                    );
                    break;
                }
                Err(TryLockError::Error(error)) => return Err(trouble(error)),
            }
        }
        // The lock holds without these words, too: a full disk must not keep a station from starting.
        if let Err(error) = Holder::this_process(station).write(state) {
            tracing::warn!("others cannot be told who runs this station: {error}");
        }
        Ok(Self { path, file })
    }

    /// Takes it again if its file is not where it was taken, since a lock on a removed file holds nobody off; returns
    /// whether it had to.
    pub(crate) fn keep_in_place(&mut self, state: &Path, station: &str) -> Result<bool, StationError> {
        if lies_at(&self.file, &self.path) {
            return Ok(false);
        }
        let path = self.path.clone();
        fs::create_dir_all(state).map_err(|source| StationError::Lock { path, source })?;
        *self = Self::take(state, station)?;
        Ok(true)
    }

    /// Who runs the station now; `None` when nobody does.
    ///
    /// # Errors
    /// When the lock's file cannot be looked at.
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
    fn a_hot_folder_serves_one_station() {
        let [hot, other] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let taken = HotLock::take(hot.path());
        assert!(taken.is_some() && HotLock::take(hot.path()).is_none());
        assert!(HotLock::take(other.path()).is_some());
        drop(taken);
        assert!(HotLock::take(hot.path()).is_some());
    }

    #[test]
    fn a_second_start_is_told_who_holds_the_lock_and_gets_it_afterwards() {
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
