//! What a station has to send to its fleet: files in its state folder, sent in order and then removed.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use fs_err as fs;
use serde::{Deserialize, Serialize};

use crate::cache::{CacheKey, CurrentPart, PartOrigin};
use crate::config::Sku;
use crate::files::{TEMPORARY_START, ms_since_1970, read_if_there, write_whole, write_whole_unsynced};

/// Fits that may wait; of more, the oldest are forgotten, because every station can make them again.
const FITS: usize = 10_000;
/// The largest file of an entry, bytes.
const LARGEST: u64 = 64 << 10;

/// Something to send.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "send", rename_all = "kebab-case")]
pub(super) enum Entry {
    /// A surface in the cache.
    Fit { sku: String, key: CacheKey, part: PartOrigin },
    /// A part that was learned here.
    Learned { sku: String, part: CurrentPart, at_ms: u64 },
}

impl Entry {
    /// A part that is learned now.
    pub(super) fn learned(sku: &Sku, part: &CurrentPart) -> Self {
        Self::Learned { sku: sku.as_str().into(), part: part.clone(), at_ms: now_ms() }
    }

    fn is_fit(&self) -> bool {
        matches!(self, Self::Fit { .. })
    }
}

/// The time since a moment of this clock, also if it was set back.
pub(super) fn age(at_ms: u64) -> Duration {
    Duration::from_millis(now_ms().saturating_sub(at_ms))
}

/// The moment of this clock that was so long ago, ms since 1970.
pub(super) fn moment(age: Duration) -> u64 {
    now_ms().saturating_sub(u64::try_from(age.as_millis()).unwrap_or(u64::MAX))
}

fn now_ms() -> u64 {
    ms_since_1970(SystemTime::now())
}

/// The entries, by number.
#[derive(Debug)]
pub(super) struct Outbox {
    folder: PathBuf,
    entries: BTreeMap<u64, Entry>,
    next: u64,
    is_loaded: bool,
}

impl Outbox {
    /// The outbox in a folder, which is read when it is first needed: by then the station holds its lock.
    pub(super) fn new(folder: &Path) -> Self {
        Self { folder: folder.into(), entries: BTreeMap::new(), next: 1, is_loaded: false }
    }

    /// Reads what an earlier run left in the folder. A file that is no entry is removed and logged.
    fn load(&mut self) -> io::Result<()> {
        if self.is_loaded {
            return Ok(());
        }
        fs::create_dir_all(&self.folder)?;
        let mut entries = BTreeMap::new();
        for file in fs::read_dir(&self.folder)? {
            let path = file?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if name.starts_with(TEMPORARY_START) {
                // The program ended while it wrote it.
                fs::remove_file(&path)?;
                continue;
            }
            let Some(number) = name.strip_suffix(".json").and_then(|stem| stem.parse::<u64>().ok()) else {
                continue;
            };
            let is_small = fs::metadata(&path)?.len() <= LARGEST;
            let bytes = if is_small { read_if_there(&path)? } else { None };
            match bytes.and_then(|bytes| serde_json::from_slice(&bytes).ok()) {
                Some(entry) => drop(entries.insert(number, entry)),
                None => {
                    tracing::warn!("removing {}: it is not a valid message to the fleet", path.display());
                    fs::remove_file(&path)?;
                }
            }
        }
        self.next = entries.keys().next_back().map_or(1, |last| last.saturating_add(1));
        self.entries = entries;
        self.is_loaded = true;
        Ok(())
    }

    fn name(number: u64) -> String {
        format!("{number:012}.json")
    }

    /// Adds an entry. When this returns, one that matters survives a power cut.
    pub(super) fn add(&mut self, entry: Entry) -> io::Result<()> {
        self.load()?;
        if self.entries.values().any(|known| *known == entry) {
            return Ok(());
        }
        let bytes = serde_json::to_vec(&entry)?;
        fs::create_dir_all(&self.folder)?;
        let write = if entry.is_fit() { write_whole_unsynced } else { write_whole };
        write(&self.folder, &Self::name(self.next), &bytes)?;
        self.entries.insert(self.next, entry);
        self.next += 1;
        let fits = self.entries.iter().filter(|(_, entry)| entry.is_fit());
        if fits.clone().count() > FITS
            && let Some(oldest) = fits.map(|(number, _)| *number).next()
        {
            self.remove(oldest);
        }
        Ok(())
    }

    /// The next entry to send.
    pub(super) fn first(&mut self) -> io::Result<Option<(u64, Entry)>> {
        self.load()?;
        Ok(self.entries.iter().next().map(|(number, entry)| (*number, entry.clone())))
    }

    /// The next part to announce.
    pub(super) fn first_announcement(&mut self) -> io::Result<Option<(u64, Entry)>> {
        self.load()?;
        let mut parts = self.entries.iter().filter(|(_, entry)| !entry.is_fit());
        Ok(parts.next().map(|(number, entry)| (*number, entry.clone())))
    }

    /// Whether a part of the SKU is still to be announced.
    pub(super) fn announces(&mut self, sku: &Sku) -> io::Result<bool> {
        self.load()?;
        Ok(self.entries.values().any(|entry| match entry {
            Entry::Learned { sku: name, .. } => {
                name.parse::<Sku>().is_ok_and(|known| known.key() == sku.key())
            }
            Entry::Fit { .. } => false,
        }))
    }

    /// Forgets an entry that was sent. A file that stays is sent again, which changes nothing.
    pub(super) fn remove(&mut self, number: u64) {
        self.entries.remove(&number);
        let _ = fs::remove_file(self.folder.join(Self::name(number)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_kept_in_order_and_rubbish_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let mut outbox = Outbox::new(folder.path());
        let [one, two]: [Sku; 2] = ["One", "two"].map(|name| name.parse().unwrap());
        let part =
            |file: &str| CurrentPart::new(PartOrigin { file: file.into(), blake3: "ab".repeat(32) }, false);
        for (sku, file) in [(&one, "a.obj"), (&two, "b.obj"), (&one, "c.obj")] {
            outbox.add(Entry::learned(sku, &part(file))).unwrap();
        }
        fs::write(folder.path().join("000000000007.json"), "{}").unwrap();
        fs::write(folder.path().join("other.txt"), "").unwrap();
        let torn = folder.path().join(format!("{TEMPORARY_START}7.part"));
        fs::write(&torn, "{").unwrap();
        let mut again = Outbox::new(folder.path());
        assert!(again.announces(&"ONE".parse().unwrap()).unwrap());
        assert!(!again.announces(&"three".parse().unwrap()).unwrap());
        assert_eq!(again.entries, outbox.entries);
        assert!(!torn.exists());
        let mut files = Vec::new();
        while let Some((number, Entry::Learned { part, .. })) = again.first().unwrap() {
            files.push(part.origin.file);
            again.remove(number);
        }
        assert_eq!(files, ["a.obj", "b.obj", "c.obj"]);
        assert_eq!(Outbox::new(folder.path()).first().unwrap(), None);
    }

    #[test]
    fn only_so_many_fits_wait() {
        let folder = tempfile::tempdir().unwrap();
        let mut outbox = Outbox::new(folder.path());
        let part = PartOrigin { file: "a.obj".into(), blake3: "ab".repeat(32) };
        outbox.add(Entry::learned(&"a".parse().unwrap(), &CurrentPart::new(part.clone(), false))).unwrap();
        for index in 0..FITS + 5 {
            let key = CacheKey::new("ab", &index.to_string());
            outbox.add(Entry::Fit { sku: "a".into(), key, part: part.clone() }).unwrap();
        }
        assert_eq!(outbox.entries.len(), FITS + 1);
        assert!(matches!(outbox.first().unwrap(), Some((1, Entry::Learned { .. }))));
    }
}
