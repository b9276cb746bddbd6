//! Rewrites a long journal with only the needed records, while jobs continue.

use std::collections::BTreeSet;
use std::io;
use std::sync::MutexGuard;

use super::new_journal::NewJournal;
use super::{IDLE_LINES, Journal, MAX_RESULTS, age};

/// Number of results that are written while no job can use the journal: this takes less than a millisecond.
const SLICE: usize = 200;

impl Journal {
    /// Whether it has many lines that are no longer needed.
    pub(crate) fn is_long(&self) -> bool {
        self.lines > self.live() + IDLE_LINES
    }
}

/// Rewrites the journal if it has become long, in slices, so that no job waits for it.
pub(crate) fn keep_short<'j>(journal: impl Fn() -> MutexGuard<'j, Journal>) {
    if !journal().is_long() {
        return;
    }
    let rewritten = rewrite(&journal);
    let mut journal = journal();
    journal.changed = None;
    if let Err(error) = rewritten {
        tracing::warn!("the journal cannot be shortened: {error}");
        // The next attempt is made after as many new lines.
        journal.lines = 0;
    }
}

/// The same as [`Journal::forget_surplus`], in slices.
fn forget_surplus<'j>(journal: &impl Fn() -> MutexGuard<'j, Journal>) {
    let surplus = journal().results.len().saturating_sub(MAX_RESULTS);
    if surplus == 0 {
        return;
    }
    let (mut by_age, mut last) = (Vec::new(), None);
    loop {
        let (results, next) = journal().results.after(last.as_deref(), SLICE);
        by_age.extend(results.into_iter().filter_map(age));
        if next.is_none() {
            break;
        }
        last = next;
    }
    by_age.sort();
    by_age.truncate(surplus);
    for slice in by_age.chunks(SLICE) {
        let mut journal = journal();
        for (at, name) in slice {
            // A result that was replaced meanwhile is not old.
            if journal.results.get(name).is_some_and(|result| result.at == *at) {
                journal.results.remove(name);
            }
        }
    }
}

fn rewrite<'j>(journal: &impl Fn() -> MutexGuard<'j, Journal>) -> io::Result<()> {
    forget_surplus(journal);
    let mut new = {
        let mut journal = journal();
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
    // The results that were added meanwhile are written after those that they replace.
    for name in journal.changed.take().unwrap_or_default() {
        if let Some(result) = journal.results.get(&name) {
            new.put(&result.line())?;
        }
    }
    journal.replace_by(new)
}
