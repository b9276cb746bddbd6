//! Remembers which folders of the station are on shares and disks that can be disconnected.
//!
//! ```text
//! state/shares.json       for each folder that was seen on one: its path and its mount point
//! ```
//!
//! When a share is disconnected, its mount point remains as an empty folder. Files written there are on the wrong disk,
//! and hidden when the share is mounted again; the settings of a SKU and the part that another station fitted seem to be
//! removed. So a folder that was once seen on a mounted share or disk is only used while it is on one.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::{Deserialize, Serialize};

use crate::config::FolderPaths;
use crate::files::{read_if_there, write_whole};
use crate::hotfolder::api::JobError;
use crate::hotfolder::seen::folders::{device_of, mount_of};
use crate::reason::Reason;

const FILE: &str = "shares.json";
/// The code of the reason when drops wait for a share.
const SHARE_MISSING: &str = "share-missing";

/// The mount points of the folders for results, originals, surfaces and SKU files.
pub(crate) struct Shares {
    state: PathBuf,
    seen: Mutex<BTreeMap<String, Seen>>,
    /// The device of each folder at the last check: while it is the same, nothing was mounted or unmounted.
    devices: Mutex<BTreeMap<PathBuf, u64>>,
}

/// A folder as it was seen.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Seen {
    folder: PathBuf,
    /// Its mount point: the folder itself or a folder above it.
    mount: PathBuf,
}

impl Seen {
    /// The folder as it is now; `None` if it does not exist, and where mount points are not known.
    fn now(folder: &Path) -> Option<Self> {
        let mount = mount_of(folder)?;
        // Commands are run in other folders than the station.
        let folder = std::path::absolute(folder).ok()?;
        Some(Self { folder, mount })
    }
}

/// A folder that commands use without being the station.
#[cfg(feature = "cli")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum UsedFolder {
    /// That of the SKU files.
    Skus,
    /// That of the fitted surfaces.
    Cache,
}

/// Checks that a folder is on the mount point on which the station saw it last; remembers nothing.
///
/// # Errors
/// With the share or disk that is not mounted.
#[cfg(feature = "cli")]
pub(crate) fn known_share_is_there(folders: &FolderPaths, used: UsedFolder) -> Result<(), Reason> {
    let (purpose, folder) = match used {
        UsedFolder::Skus => ("skus", &folders.skus),
        UsedFolder::Cache => ("cache", &folders.cache),
    };
    let now = Seen::now(folder);
    let missing = now.and_then(|now| Shares::open(&folders.state).missing(purpose, &now));
    missing.map_or(Ok(()), Err)
}

impl Shares {
    /// Reads the remembered mount points from the state folder; without a readable file, it starts empty.
    pub(crate) fn open(state: &Path) -> Self {
        let text = read_if_there(&state.join(FILE)).ok().flatten().unwrap_or_default();
        let seen = serde_json::from_slice(&text).unwrap_or_default();
        Self { state: state.into(), seen: Mutex::new(seen), devices: Mutex::default() }
    }

    /// Checks that all folders that a job uses, except the hot folder, are still on the same mount points; with `closely` also if
    /// one disk is mounted at several places.
    ///
    /// # Errors
    /// With the share or disk that is not mounted.
    pub(crate) fn are_there(&self, folders: &FolderPaths, closely: bool) -> Result<(), JobError> {
        let FolderPaths { import, archive, rejected, reports, cache, skus: _, hot: _, state: _ } = folders;
        let all = [
            ("import", import),
            ("archive", archive),
            ("rejected", rejected),
            ("reports", reports),
            ("cache", cache),
        ];
        all.into_iter().try_for_each(|(purpose, folder)| self.check(purpose, folder, closely))?;
        self.skus_are_there(folders, closely)
    }

    /// Checks the same of the folder of the SKU files: in an empty mount point, every SKU seems to have the station's settings.
    ///
    /// # Errors
    /// With the share or disk that is not mounted.
    pub(crate) fn skus_are_there(&self, folders: &FolderPaths, closely: bool) -> Result<(), JobError> {
        self.check("skus", &folders.skus, closely)
    }

    fn check(&self, purpose: &str, folder: &Path, closely: bool) -> Result<(), JobError> {
        let device = device_of(folder);
        let last = self.devices().remove(folder);
        if (closely || device.is_none() || last != device)
            && let Some(now) = Seen::now(folder)
        {
            self.is_there(purpose, now)?;
        }
        self.devices().extend(device.map(|device| (folder.to_path_buf(), device)));
        Ok(())
    }

    fn seen(&self) -> MutexGuard<'_, BTreeMap<String, Seen>> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn devices(&self) -> MutexGuard<'_, BTreeMap<PathBuf, u64>> {
        self.devices.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_there(&self, purpose: &str, now: Seen) -> Result<(), JobError> {
        if let Some(missing) = self.missing(purpose, &now) {
            return Err(JobError::Retry(missing));
        }
        let mut seen = self.seen();
        match seen.get(purpose) {
            Some(before) if *before == now => return Ok(()),
            // The machine's own disk cannot be disconnected.
            None if now.mount.parent().is_none() => return Ok(()),
            _ => {}
        }
        seen.insert(purpose.into(), now);
        let written = serde_json::to_string_pretty(&*seen).map_err(std::io::Error::other);
        // If it cannot be written, it is known until the station ends.
        if let Err(error) = written.and_then(|text| write_whole(&self.state, FILE, text.as_bytes())) {
            tracing::warn!("cannot record that the {purpose} folder is on a share: {error}");
        }
        Ok(())
    }

    /// The share or disk of a folder that was on one, and is on one above it now: it is not mounted.
    fn missing(&self, purpose: &str, now: &Seen) -> Option<Reason> {
        let seen = self.seen();
        let before = seen.get(purpose)?;
        if before == now || before.folder != now.folder || !before.mount.starts_with(&now.mount) {
            return None;
        }
        let Seen { folder, mount } = before;
        let what = format!(
            "The {purpose} folder {} was on a share or disk that is not mounted at {} now.",
            folder.display(),
            mount.display()
        );
        let remedy = format!(
            "Mount it. If the folder is no longer on a share, remove {}.",
            self.state.join(FILE).display()
        );
        Some(Reason::new(SHARE_MISSING, what, remedy))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_on_a_share_is_used_only_while_it_is_mounted() {
        let state = tempfile::tempdir().unwrap();
        let see = |shares: &Shares, folder: &str, mount: &str| {
            shares.is_there("import", Seen { folder: folder.into(), mount: mount.into() }).is_ok()
        };
        let shares = Shares::open(state.path());
        assert!(see(&shares, "/srv/import", "/") && see(&shares, "/srv/import", "/srv"));
        assert!(!see(&shares, "/srv/import", "/"));
        let shares = Shares::open(state.path());
        assert!(!see(&shares, "/srv/import", "/"), "it is known after a restart");
        assert!(see(&shares, "/srv/import", "/srv/import"), "another share on top of it");
        assert!(!see(&shares, "/srv/import", "/srv"));
        assert!(see(&shares, "/home/import", "/"), "the settings name another folder");
        assert!(see(&shares, "/srv/import", "/"), "and the old one again");
        std::fs::remove_file(state.path().join(FILE)).unwrap();
        assert!(see(&Shares::open(state.path()), "/srv/import", "/"));
    }
}
