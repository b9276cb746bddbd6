//! The order of the records in the journal, for programs that only read it.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use super::line::{JOURNAL, Line, Parsed, Record, parse};
use crate::config::{Sku, fold};
use crate::files::read_if_there;

/// The line numbers of the outcomes of drops. They show the order even if the clock was set back.
#[derive(Default)]
pub(crate) struct JournalPositions {
    /// By the path in the rejected folder, with `/`.
    rejected: BTreeMap<String, usize>,
    /// By the result's folded name, with the key of its job and the place of its original.
    delivered: BTreeMap<String, (usize, String, String)>,
    /// By the SKU's key.
    learned: BTreeMap<String, usize>,
}

impl JournalPositions {
    /// Reads the journal in the state folder; a station may write it at the same time.
    pub(crate) fn read(state: &Path) -> io::Result<Self> {
        let bytes = read_if_there(&state.join(JOURNAL))?.unwrap_or_default();
        let mut order = Self::default();
        for (number, line) in bytes.split_inclusive(|byte| *byte == b'\n').enumerate() {
            let Parsed::Good(Line { record, .. }) = parse(line) else { continue };
            match record {
                Record::Rejected { to, .. } => {
                    order.rejected.insert(to, number);
                }
                Record::Done { job, original, .. } if !job.drop.is_archived() => {
                    let last = order.delivered.entry(fold(&job.name)).or_default();
                    // A line for the same job only records an import by BeamServer, a new basis, or the removal of the
                    // original.
                    if last.1 == job.key && original.is_empty() {
                        last.2.clear();
                    } else if (&last.1, &last.2) != (&job.key, &original) {
                        *last = (number, job.key, original);
                    }
                }
                Record::Learned { sku, .. } => {
                    if let Ok(sku) = sku.parse::<Sku>() {
                        order.learned.insert(sku.key().to_owned(), number);
                    }
                }
                _ => {}
            }
        }
        Ok(order)
    }

    /// The line of this rejection; `None` if the journal has been rewritten since.
    pub(crate) fn rejected(&self, to: &str) -> Option<usize> {
        self.rejected.get(to).copied()
    }

    /// The line of the last delivery with this name.
    pub(crate) fn delivered(&self, name: &str) -> Option<usize> {
        self.delivered.get(&fold(name)).map(|(number, ..)| *number)
    }

    /// The line of the SKU's last learned part.
    pub(crate) fn learned(&self, sku: &Sku) -> Option<usize> {
        self.learned.get(sku.key()).copied()
    }
}
