//! Divides a drawing with a list beside it into one drop for each row: each row becomes a drop once, with one serial number, also when
//! the station is interrupted. The page of [`hotfolder`](crate::hotfolder) describes the protocol.

use std::path::{Path, PathBuf};

use fs_err as fs;

use super::Read;
use super::filing::{self, LIST_REPORT};
use super::{EarlyEnd, Executor, Outcome, Task};
use crate::config::{JobSettings, Sku, with_row};
use crate::files::{TEMPORARY_END, TEMPORARY_START, sync_folder, write_flushed, write_whole_or_not};
use crate::formats::Pace;
use crate::formats::list::{Product, Products, Row};
use crate::formats::pattern::Moment;
use crate::hotfolder::api::{Corrector, JobError};
use crate::hotfolder::error::{folder_trouble, guarded, warn_if_not_noted};
use crate::hotfolder::seen::{delivered_as, folders, meaning, sidecar_of};
use crate::hotfolder::state::{Listing, NewListing};
use crate::printable::on_one_line;
use crate::reason::Reason;
use crate::report::ListReport;

/// Largest number of rows: more files make a hot folder slow.
const MOST_ROWS: u64 = 10_000;
/// Largest size of the drawings of all rows, bytes.
const MOST_BYTES: u64 = 1 << 30;
/// Largest number of rows of a quick job.
const QUICK_ROWS: u64 = 100;
/// Number of drawings that get their names after one line of the journal.
const BATCH: usize = 50;
/// Largest serial number that a settings file can give.
const LARGEST_SERIAL: u64 = 9_007_199_254_740_991;
/// Least digits of the serial number in the names of the drawings.
const DIGITS: usize = 6;

/// The drops of a list.
struct Rows<'a> {
    task: &'a Task,
    read: &'a Read,
    /// The name of the list.
    name: &'a str,
    listing: Listing,
    tag: String,
}

impl<C: Corrector> Executor<'_, C> {
    /// Whether the drop is divided into rows: a list is beside it, or it was divided before.
    pub(super) fn is_listed(&self, task: &Task) -> bool {
        let Some(list) = task.place_of_list() else { return false };
        let journal = self.journal();
        let is_marked =
            journal.begun(&task.drop, task.stamp).is_some_and(|open| open.stage.result().is_some());
        !is_marked && (folders::is_file(&list) || journal.listing(&task.drop, task.stamp).is_some())
    }

    pub(super) fn list(
        &self,
        task: &Task,
        sku: &Sku,
        pattern: &str,
        slot: &mut Option<Read>,
    ) -> Result<Outcome, EarlyEnd> {
        self.expect_surface(task, sku, &delivered_as(pattern))?;
        let read = &*slot.insert(self.read(task, Some(pattern))?);
        let begun = self.journal().listing(&task.drop, task.stamp).cloned();
        let mut settings = match &read.sidecar {
            Some((path, text)) => {
                task.settings.with_sidecar(path, text).map_err(|error| JobError::Rejected(error.reason()))?
            }
            None => task.settings.clone(),
        };
        let Some((name, bytes)) = &read.list else {
            return match begun {
                Some(listing) if listing.named == listing.rows => self.file_list(task, sku, pattern, slot),
                _ => {
                    remove_hidden(task, self.journal().tag());
                    Err(JobError::Rejected(list_is_gone()).into())
                }
            };
        };
        let list = identity(bytes, read, &settings);
        let same = begun.as_ref().filter(|listing| listing.list == list);
        // The date of the first attempt, or now.
        let begun_at = same.and_then(|listing| listing.date.parse::<Moment>().ok());
        let date = begun_at
            .or(settings.content.values.date)
            .unwrap_or_else(|| Moment::new(chrono::Local::now().naive_local()));
        settings.content.values.date = Some(date);
        let products_from = |used: u64| {
            guarded(|| self.corrector.products(sku, &read.file, (name, bytes), &settings, used, MOST_ROWS))
        };
        self.recall_serials(task, sku, &settings.content.serial)?;
        let (products, listing) = loop {
            let used = match same {
                Some(listing) => listing.used,
                None => self.journal().serials_used(sku, &settings.content.serial),
            };
            let products = products_from(used)?;
            if task.pace == Pace::Quick && products.count > QUICK_ROWS {
                return Err(JobError::TakesLong.into());
            }
            check_size(name, read, &products)?;
            check_names(task, &products)?;
            let listing = match same {
                Some(listing) => Some(listing.clone()),
                None => {
                    self.reserve(task, sku, (name, &list), (used, &products), &settings, begun.as_ref())?
                }
            };
            // Another list of the SKU may have taken the numbers meanwhile.
            if let Some(listing) = listing {
                break (products, listing);
            }
        };
        self.note_serials(task, sku)?;
        let mut rows = Rows { task, read, name, listing, tag: self.journal().tag().to_owned() };
        for (batch, number) in products.rows.chunks(BATCH).zip(0u64..) {
            let end = number * BATCH as u64 + batch.len() as u64;
            if rows.listing.named < end {
                rows.write(batch)?;
                // The rows without a drawing have numbers, too.
                let is_last = end == products.rows.len() as u64;
                rows.listing.named = if is_last { products.count } else { end };
                self.journal().naming(&task.drop, rows.listing.named).map_err(folder_trouble)?;
            }
            rows.name(batch)?;
        }
        self.report_list(task, (sku, pattern), (name, &products), &rows)?;
        let (first, last) = (products.rows.first(), products.rows.last());
        if let (Some(first), Some(last)) = (first, last) {
            let made = match products.rows.len() {
                1 => format!("1 drawing is in the hot folder, with the serial number {}", first.serial),
                many => format!(
                    "{many} drawings are in the hot folder, with the serial numbers {} to {}",
                    first.serial, last.serial
                ),
            };
            tracing::info!("{}: {made}", on_one_line(name));
        }
        self.file_list(task, sku, pattern, slot)
    }

    /// Reserves the serial numbers of a list, and reports the numbers that no drawing gets; `None` if other numbers are used
    /// than those that the products were made for.
    fn reserve(
        &self,
        task: &Task,
        sku: &Sku,
        (name, list): (&str, &str),
        (used, products): (u64, &Products),
        settings: &JobSettings,
        begun: Option<&Listing>,
    ) -> Result<Option<Listing>, JobError> {
        let serial = settings.content.serial;
        let mut journal = self.journal();
        let older = journal.older_series(sku, &serial);
        let date = settings.content.values.date.map_or_else(String::new, |date| date.to_string());
        if journal.serials_used(sku, &serial) != used {
            return Ok(None);
        }
        let new = NewListing { sku, stamp: task.stamp, list: list.into(), rows: products.count, date };
        let listing = journal.reserve(&task.drop, new, &serial).map_err(folder_trouble)?;
        drop(journal);
        if let Some(older) = older {
            tracing::warn!(
                "the serial numbers of {sku} start again at {}: `start` under [serial] was {older} before. Numbers from {} on may \
                 be marked a second time",
                serial.start,
                serial.start
            );
        }
        if let Some(begun) = begun {
            let numbers = |index: u64| {
                serial.number(index).map_or_else(|| "the last".into(), |number| number.to_string())
            };
            tracing::warn!(
                "{} changed while its drawings were made: the serial numbers {} to {} of its previous content will not be used again, \
                 except those in the hot folder and in import",
                on_one_line(name),
                numbers(begun.used),
                numbers(begun.used + begun.rows.saturating_sub(1))
            );
        }
        for row in &products.left_out {
            tracing::warn!("{}", row.reason.on_one_line());
            if let Some(serial) = row.serial {
                tracing::warn!("the serial number {serial} of {sku} will not be used: its row is left out");
            }
        }
        Ok(Some(listing))
    }

    /// Writes which row got which serial number and drawing.
    fn report_list(
        &self,
        task: &Task,
        (sku, pattern): (&Sku, &str),
        (name, products): (&str, &Products),
        rows: &Rows<'_>,
    ) -> Result<(), JobError> {
        let mut report = ListReport::new(sku.as_str(), name, pattern, Some(rows.listing.date.clone()));
        for product in &products.rows {
            let place = rows.place(product);
            let drawing = place.file_name().unwrap_or_default().to_string_lossy().into_owned();
            report.add(product, drawing);
        }
        products.left_out.iter().for_each(|row| report.leave_out(row));
        let json = report.to_json().map_err(|error| folder_trouble(error.into()))?;
        filing::write_report(&task.station.folders, sku, name, LIST_REPORT, json.as_bytes())
            .map_err(folder_trouble)
    }

    /// Files the drawing and its list. The list is hidden first: beside the next drawing of this name it would be another list.
    fn file_list(
        &self,
        task: &Task,
        sku: &Sku,
        pattern: &str,
        slot: &mut Option<Read>,
    ) -> Result<Outcome, EarlyEnd> {
        let hidden = hidden(task, self.journal().tag(), "list");
        let list = task.place_of_list();
        if let Some(list) = list.as_ref().filter(|list| folders::is_file(list)) {
            fs::rename(list, &hidden).map_err(folder_trouble)?;
        }
        let Some(read) = slot else { return Ok(Outcome::Changed) };
        read.companions.retain(|companion| Some(&companion.path) != list.as_ref());
        let archived = self.archive(task, sku, pattern, read, None)?;
        if let (Some(list), true) = (list.as_deref().and_then(Path::file_name), folders::is_file(&hidden)) {
            let beside = archived.with_file_name(list);
            // A list of the same name from another day.
            let place = if beside.exists() {
                archived.with_extension(format!("{}.csv", self.journal().tag()))
            } else {
                beside
            };
            if let Err(error) = fs::rename(&hidden, place) {
                tracing::warn!("the list of {} is not in the archive: {error}", task.drop);
            }
        }
        warn_if_not_noted(self.journal().listed(&task.drop));
        Ok(Outcome::Listed)
    }
}

impl Rows<'_> {
    /// The path of the drop of a row.
    fn place(&self, product: &Product) -> PathBuf {
        place(&self.task.path, product.serial)
    }

    /// The hidden file that gets the name of a row.
    fn hidden(&self, product: &Product) -> PathBuf {
        hidden(self.task, &self.tag, &product.serial.to_string())
    }

    /// Writes the hidden drawings of rows that have no names yet.
    fn write(&self, batch: &[Product]) -> Result<(), JobError> {
        let folder = self.task.path.parent().unwrap_or(Path::new(""));
        for product in batch {
            let place = self.place(product);
            if place.exists() {
                return Err(JobError::Retry(name_is_taken(&place)));
            }
            write_flushed(&self.hidden(product), &self.read.file.bytes).map_err(folder_trouble)?;
        }
        sync_folder(folder).map_err(folder_trouble)
    }

    fn write_settings(&self, product: &Product) -> Result<(), JobError> {
        let text = self.read.sidecar.as_ref().map_or("", |(_, text)| text);
        let row = with_row(text, product.serial, &self.listing.date, &product.row.values);
        let row = row.ok_or_else(|| JobError::Rejected(too_large_a_number(product)))?;
        let Row { number, line, .. } = product.row;
        let text = format!("# Row {number} of {}, line {line}.\n{row}", on_one_line(self.name));
        let Some(place) = sidecar_of(&self.place(product)) else { return Ok(()) };
        let (folder, name) = (place.parent().unwrap_or(Path::new("")), place.file_name().unwrap_or_default());
        write_whole_or_not(folder, &name.to_string_lossy(), text.as_bytes()).map_err(folder_trouble)
    }

    /// Gives the hidden drawings of rows their names; those that have none left got theirs before.
    fn name(&self, batch: &[Product]) -> Result<(), JobError> {
        let folder = self.task.path.parent().unwrap_or(Path::new(""));
        let without_name = |product: &&Product| folders::is_file(&self.hidden(product));
        let left: Vec<&Product> = batch.iter().filter(without_name).collect();
        for product in &left {
            self.write_settings(product)?;
        }
        // A drawing must not appear without its settings, also after a power cut.
        sync_folder(folder).map_err(folder_trouble)?;
        for product in left {
            fs::rename(self.hidden(product), self.place(product)).map_err(folder_trouble)?;
        }
        Ok(())
    }
}

/// The path of the drop with a serial number, for the drawing at a path.
fn place(drawing: &Path, serial: u64) -> PathBuf {
    let stem = drawing.file_stem().unwrap_or_default().to_string_lossy();
    let ending = drawing.extension().unwrap_or_default().to_string_lossy();
    drawing.with_file_name(format!("{stem}-{serial:0DIGITS$}.{ending}"))
}

/// A hidden file of a drop, beside it.
fn hidden(task: &Task, tag: &str, what: &str) -> PathBuf {
    let drop = blake3::hash(task.drop.to_string().as_bytes()).to_hex();
    task.path.with_file_name(format!("{TEMPORARY_START}{tag}-{}-{what}{TEMPORARY_END}", &drop[..8]))
}

/// Removes the hidden drawings of rows that get no names.
fn remove_hidden(task: &Task, tag: &str) {
    let first = hidden(task, tag, "");
    let start = first.file_name().unwrap_or_default().to_string_lossy();
    let start = start.trim_end_matches(TEMPORARY_END);
    let Some(entries) = first.parent().and_then(|folder| fs::read_dir(folder).ok()) else { return };
    for entry in entries.filter_map(Result::ok) {
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with(start)
            && name.ends_with(TEMPORARY_END)
            && let Err(error) = fs::remove_file(entry.path())
        {
            tracing::warn!("a hidden drawing of {} remains: {error}", task.drop);
        }
    }
}

/// Refuses names that no drop may have, and numbers that no settings may have.
fn check_names(task: &Task, products: &Products) -> Result<(), JobError> {
    let Some(last) = products.rows.last() else { return Ok(()) };
    if last.serial > LARGEST_SERIAL {
        return Err(JobError::Rejected(too_large_a_number(last)));
    }
    // With the folder of the SKU, whose name is in that of the result.
    meaning(&place(&task.relative, last.serial)).map(drop).map_err(JobError::Rejected)
}

/// Hash of everything that the drops of a list depend on.
fn identity(list: &[u8], read: &Read, settings: &JobSettings) -> String {
    let mut hasher = blake3::Hasher::new();
    let text = read.sidecar.as_ref().map_or("", |(_, text)| text);
    for part in [list, text.as_bytes()] {
        hasher.update(&(part.len() as u64).to_le_bytes()).update(part);
    }
    let serial = settings.content.serial;
    for number in [serial.start, serial.step, serial.last.unwrap_or(u64::MAX)] {
        hasher.update(&number.to_le_bytes());
    }
    hasher.finalize().to_hex()[..32].to_owned()
}

fn check_size(name: &str, read: &Read, products: &Products) -> Result<(), JobError> {
    let bytes = (read.file.bytes.len() as u64).saturating_mul(products.rows.len() as u64);
    if bytes <= MOST_BYTES {
        return Ok(());
    }
    let reason = Reason::new(
        "list-too-long",
        "The drawings of all rows of the list are larger than a station takes at once.",
        "Split the list, or simplify the drawing.",
    );
    Err(JobError::Rejected(
        reason.with_number("size", bytes as f64, "bytes", Some(MOST_BYTES as f64)).in_file(name),
    ))
}

fn list_is_gone() -> Reason {
    Reason::new(
        "list-removed",
        "The list of this drawing was removed before isomark had made a drawing from every row.",
        "Drop the drawing and a list with the missing rows again. The serial numbers of these rows will not be used.",
    )
}

fn name_is_taken(place: &Path) -> Reason {
    let name = place.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Reason::new(
        "row-name-taken",
        format!("The row of the list needs the name {name}, and a file in the hot folder has it."),
        "Move that file out of the hot folder.",
    )
}

fn too_large_a_number(product: &Product) -> Reason {
    Reason::new(
        "serial-used-up",
        format!("The serial number {} is too large.", product.serial),
        "Give smaller numbers, `start` and `step` under [serial].",
    )
}
