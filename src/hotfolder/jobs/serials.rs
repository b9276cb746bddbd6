//! The serial numbers of a SKU, a second time: a note in its archive folder, for the case that the journal is damaged or
//! lost.
//!
//! ```text
//! archive/can/serial-numbers.json
//! {"start":1,"step":1,"used":200,"check":"5b1c02aa"}
//! ```
//!
//! The journal reserves the numbers of a list first, then they are noted, and only then the drawings get their names. So
//! whichever of the two is ahead, no number that it lacks is on a drawing.

use std::io;
use std::sync::PoisonError;

use fs_err as fs;
use serde::{Deserialize, Serialize};

use super::filing::LIST_REPORT;
use super::{Executor, Task};
use crate::config::{FolderPaths, SerialSettings, Sku};
use crate::files::{read_if_there, write_whole};
use crate::hotfolder::api::{Corrector, JobError};
use crate::hotfolder::error::folder_trouble;
use crate::hotfolder::state::{Series, checksum};
use crate::reason::Reason;
use crate::report::ListReport;

/// The note in the SKU's archive folder. Neither a drop nor a file that belongs to one has this ending.
const NOTE: &str = "serial-numbers.json";

#[derive(Serialize, Deserialize)]
struct Note {
    start: u64,
    step: u64,
    used: u64,
    /// Hash of the others: a damaged number must not be taken for another one.
    check: String,
}

impl Note {
    fn of(series: Series) -> Self {
        let Series { start, step, used } = series;
        Self { start, step, used, check: checksum(&format!("{start} {step} {used}")) }
    }

    fn series(&self) -> Option<Series> {
        let series = Series { start: self.start, step: self.step, used: self.used };
        (Self::of(series).check == self.check).then_some(series)
    }
}

/// What the note shows.
enum Noted {
    Nothing,
    Series(Series),
    Damaged,
}

impl<C: Corrector> Executor<'_, C> {
    /// Adds numbers to the journal that are not in it, and that the note or the reports of lists show as
    /// used.
    ///
    /// # Errors
    /// When the note or the reports cannot be read, or when a damaged note is all that is left: the list
    /// waits.
    pub(super) fn recall_serials(
        &self,
        task: &Task,
        sku: &Sku,
        serial: &SerialSettings,
    ) -> Result<(), JobError> {
        let folders = &task.station.folders;
        let is_known = self.journal().series(sku).is_some();
        let (series, source) = match noted(folders, sku).map_err(folder_trouble)? {
            Noted::Series(series) => (Some(series), "its note in the archive"),
            // The journal writes it again.
            Noted::Damaged | Noted::Nothing if is_known => (None, ""),
            Noted::Damaged => return Err(JobError::Retry(are_lost(folders, sku))),
            Noted::Nothing => {
                (reported(folders, sku, serial).map_err(folder_trouble)?, "the reports of its lists")
            }
        };
        let last = series.and_then(|series| series.last());
        if let (Some(series), Some(last)) = (series, last)
            && self.journal().take_series(sku, series, serial)
        {
            tracing::warn!(
                "the serial numbers of {sku} go on after {last}, according to {source}: the journal does not contain them"
            );
        }
        Ok(())
    }

    /// Notes the numbers of the SKU that the journal shows as used, before they are on drawings.
    ///
    /// # Errors
    /// When the note cannot be written.
    pub(super) fn note_serials(&self, task: &Task, sku: &Sku) -> Result<(), JobError> {
        // Lists at the same time write their notes in the order of their numbers. No job waits for a slow archive.
        let _turn = self.serial_notes.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(series) = self.journal().series(sku) else { return Ok(()) };
        note(&task.station.folders, sku, series).map_err(folder_trouble)
    }
}

fn noted(folders: &FolderPaths, sku: &Sku) -> io::Result<Noted> {
    let Some(bytes) = read_if_there(&folders.archive.join(sku.key()).join(NOTE))? else {
        return Ok(Noted::Nothing);
    };
    let note = serde_json::from_slice::<Note>(&bytes).ok();
    Ok(note.and_then(|note| note.series()).map_or(Noted::Damaged, Noted::Series))
}

fn note(folders: &FolderPaths, sku: &Sku, series: Series) -> io::Result<()> {
    if matches!(noted(folders, sku), Ok(Noted::Series(noted)) if noted == series) {
        return Ok(());
    }
    let folder = folders.archive.join(sku.key());
    fs::create_dir_all(&folder)?;
    let mut text = serde_json::to_vec(&Note::of(series)).map_err(io::Error::other)?;
    text.push(b'\n');
    write_whole(&folder, NOTE, &text)
}

/// The numbers that the reports of the SKU's lists show.
fn reported(folders: &FolderPaths, sku: &Sku, serial: &SerialSettings) -> io::Result<Option<Series>> {
    let entries = match fs::read_dir(folders.reports.join(sku.key())) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        entries => entries?,
    };
    let mut last = None;
    for entry in entries {
        let entry = entry?;
        if !entry.file_name().to_string_lossy().ends_with(LIST_REPORT) {
            continue;
        }
        let bytes = read_if_there(&entry.path())?.unwrap_or_default();
        let Ok(report) = serde_json::from_slice::<ListReport>(&bytes) else { continue };
        let marked = report.rows.iter().map(|row| row.serial);
        last = last.max(marked.chain(report.left_out.iter().filter_map(|row| row.serial)).max());
    }
    let beyond = last.and_then(|last| last.checked_sub(serial.start));
    let used = beyond.map(|beyond| (beyond / serial.step.max(1)).saturating_add(1));
    Ok(used.map(|used| Series { start: serial.start, step: serial.step, used }))
}

fn are_lost(folders: &FolderPaths, sku: &Sku) -> Reason {
    let note = folders.archive.join(sku.key()).join(NOTE);
    let what = format!(
        "The last serial number of SKU `{sku}` is unknown: the journal does not contain it, and the note {} is damaged.",
        note.display()
    );
    let remedy =
        "Set `start` under [serial] to a number above the last one that was marked, and remove the note.";
    Reason::new("serials-lost", what, remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_digit_of_a_note_is_noticed() {
        let text = serde_json::to_string(&Note::of(Series { start: 1, step: 1, used: 200 })).unwrap();
        let read = |text: &str| serde_json::from_str::<Note>(text).ok().and_then(|note| note.series());
        assert_eq!(read(&text), Some(Series { start: 1, step: 1, used: 200 }));
        for (digits, changed) in [(":200", ":201"), (":200", ":20"), ("\"step\":1", "\"step\":3")] {
            assert!(text.contains(digits));
            assert_eq!(read(&text.replace(digits, changed)), None, "{changed}");
        }
    }
}
