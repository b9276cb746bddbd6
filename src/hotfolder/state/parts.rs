//! What the station remembers of the current part of each SKU: `<state>/parts/<sku>.note`, JSON.
//!
//! The cache may be deleted, restored from a backup, or shared with other stations, and the archive has only the parts that
//! were dropped here. With this note, the station knows when the cache is behind what it has marked on before.

use std::io;
use std::path::Path;

use fs_err as fs;
use serde::{Deserialize, Serialize};

use crate::config::Sku;
use crate::files::{read_if_there, write_whole_or_not};

/// The folder of the notes in the state folder.
const PARTS: &str = "parts";

/// The part of a SKU that the station used last.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct PartNote {
    /// Its file's name.
    pub(crate) file: String,
    /// BLAKE3 hash of its bytes and of its buffers', in hexadecimal.
    pub(crate) blake3: String,
    /// When it became the SKU's part, ms since 1970.
    pub(crate) learned_ms: u64,
    /// The path of the part that the archive named then, relative to the SKU's archive folder; empty without one.
    pub(crate) archived: String,
    /// When the archive got to name it, ms since 1970 by the clock of its disk.
    #[serde(default)]
    pub(crate) filed_ms: u64,
    /// The hash of that part; empty if it is unknown.
    pub(crate) archived_blake3: String,
}

impl PartNote {
    /// The note of a SKU; `None` without one that can be read.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub(crate) fn read(state: &Path, sku: &Sku) -> io::Result<Option<Self>> {
        let bytes = read_if_there(&state.join(PARTS).join(name(sku)))?;
        Ok(bytes.and_then(|bytes| serde_json::from_slice(&bytes).ok()))
    }

    /// Writes the note, unless it is the one that is there.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub(crate) fn write(&self, state: &Path, sku: &Sku) -> io::Result<()> {
        if Self::read(state, sku)?.as_ref() == Some(self) {
            return Ok(());
        }
        let folder = state.join(PARTS);
        fs::create_dir_all(&folder)?;
        write_whole_or_not(&folder, &name(sku), &serde_json::to_vec(self)?)
    }

    /// Whether the part is the one in the archive.
    pub(crate) fn is_archived(&self) -> bool {
        !self.archived.is_empty() && self.blake3 == self.archived_blake3
    }
}

fn name(sku: &Sku) -> String {
    format!("{}.note", sku.key())
}
