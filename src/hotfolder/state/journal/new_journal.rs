//! A new journal that is written beside the old one and then replaces it.

use std::io::{self, Write};
use std::path::Path;

use super::line::{JOURNAL, Line, written};
use crate::files::{persist_over, sync_folder, temporary};

/// The journal is flushed each time after this many bytes, so that the last flush, for which jobs wait, is short.
const FLUSHED: u64 = 1 << 20;

/// A journal that is being written beside the old one.
pub(super) struct NewJournal {
    file: tempfile::NamedTempFile,
    lines: usize,
    length: u64,
    flushed: u64,
}

impl NewJournal {
    pub(super) fn begin(folder: &Path) -> io::Result<Self> {
        Ok(Self { file: temporary(folder)?, lines: 0, length: 0, flushed: 0 })
    }

    pub(super) fn put(&mut self, line: &Line) -> io::Result<()> {
        let text = written(line)?;
        self.file.write_all(text.as_bytes())?;
        self.lines += 1;
        self.length += text.len() as u64;
        if self.length - self.flushed >= FLUSHED {
            self.flush()?;
        }
        Ok(())
    }

    /// Flushes the lines that were written so far.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        self.file.as_file().sync_data()?;
        self.flushed = self.length;
        Ok(())
    }

    /// Replaces the old journal; returns the number of lines and the length in bytes.
    pub(super) fn keep(self, folder: &Path) -> io::Result<(usize, u64)> {
        self.file.as_file().sync_all()?;
        persist_over(self.file, &folder.join(JOURNAL))?;
        sync_folder(folder)?;
        Ok((self.lines, self.length))
    }
}
