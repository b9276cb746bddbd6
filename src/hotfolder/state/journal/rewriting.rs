//! The journal written anew with what still counts, beside the old one and then in its place.

use std::collections::BTreeSet;
use std::io::{self, Write};
use std::path::Path;
use std::sync::MutexGuard;

use super::line::{Line, written};
use super::{IDLE_LINES, JOURNAL, Journal};
use crate::files::{in_full, named, sync_folder, temporary};

/// Results that are written while nobody else can use the journal: less than a millisecond.
const SLICE: usize = 200;
/// What is written before it is flushed: the last flush, for which jobs wait, is to be a short one, bytes.
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

    fn flush(&mut self) -> io::Result<()> {
        self.file.as_file().sync_data()?;
        self.flushed = self.length;
        Ok(())
    }

    /// Gives it the journal's name; returns its lines and its length in bytes.
    pub(super) fn keep(self, folder: &Path) -> io::Result<(usize, u64)> {
        let place = folder.join(JOURNAL);
        self.file.as_file().sync_all()?;
        self.file.persist(in_full(&place)).map_err(|error| named(error.error, "cannot write", &place))?;
        sync_folder(folder)?;
        Ok((self.lines, self.length))
    }
}

impl Journal {
    /// Whether it has many more lines than what still counts.
    pub(crate) fn is_long(&self) -> bool {
        self.lines > self.live() + IDLE_LINES
    }
}

/// Writes the journal anew if it has become long, slice by slice, so that no job waits for it.
pub(crate) fn keep_short<'j>(journal: impl Fn() -> MutexGuard<'j, Journal>) {
    if !journal().is_long() {
        return;
    }
    let rewritten = rewrite(&journal);
    let mut journal = journal();
    journal.changed = None;
    if let Err(error) = rewritten {
        tracing::warn!("the journal stays long: {error}");
        // It is tried again when as many lines have come.
        journal.lines = 0;
    }
}

fn rewrite<'j>(journal: &impl Fn() -> MutexGuard<'j, Journal>) -> io::Result<()> {
    let mut new = {
        let mut journal = journal();
        journal.forget_surplus();
        journal.changed = Some(BTreeSet::new());
        NewJournal::begin(&journal.folder)?
    };
    let mut last = None;
    loop {
        let (results, next) = journal().results.after(last.as_deref(), SLICE);
        for result in results {
            new.put(&result.line())?;
        }
        if next.is_none() {
            break;
        }
        last = next;
    }
    new.flush()?;
    let mut journal = journal();
    // What came meanwhile stands behind what it replaces.
    for name in journal.changed.take().unwrap_or_default() {
        if let Some(result) = journal.results.get(&name) {
            new.put(&result.line())?;
        }
    }
    journal.replace_by(new)
}
