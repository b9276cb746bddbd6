//! The station's memory that survives any interruption: one line for each step that cannot be undone.
//!
//! ```text
//! state/journal.log
//! 5b1c02aa {"at":"2026-03-01T12:34:56Z","did":"delivering","drop":"can@date.dxf", … }
//! 09fe77d1 {"at":"2026-03-01T12:34:56Z","did":"delivered","drop":"can@date.dxf"}
//! ```
//!
//! Each line starts with the first eight hexadecimal digits of the BLAKE3 hash of the rest, so that a line cut by a
//! crash is recognized. Lines are only appended and flushed to the disk. A journal that has become long is replaced by
//! a new one with the records that are still needed.
//!
//! # Exactly once
//!
//! A drawing is flushed in the import folder, under a name that importers ignore, *before* the journal records
//! `delivering`. It is renamed to its final name *after* that. So after a crash the folder decides. If the temporary
//! file exists, the drawing was not delivered. If the drawing exists, it was delivered. If neither exists, either the
//! importer has taken the drawing, or somebody removed the temporary file before it was renamed. Then the drawing is
//! not delivered a second time, and is `uncertain` until a person decides (`jobs::resume`). A drop is identified by its
//! path and its [`Stamp`]: another file with its name is another drop.

mod line;
mod line_jobs;
mod listing;
mod new_journal;
mod order;
mod results;
mod routed;
mod rewriting;
mod stage;

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{BuildHasher, RandomState};
use std::io::{self, BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use fs_err as fs;

use super::DropId;
use crate::config::Sku;
use crate::files::sync_folder;
use crate::hotfolder::clock;
use crate::hotfolder::clock::Uptime;
use crate::hotfolder::seen::folders::is_still_at;
use crate::hotfolder::seen::{Identity, Stamp, delivered_as};

pub(crate) use line::{Certainty, Import, Job, Listing, Series, StampRecord, checksum};
use line::{DAMAGED, JOURNAL, Line, Parsed, Record, STATUS, parse, written};
pub(crate) use listing::NewListing;
use new_journal::NewJournal;
pub(crate) use order::JournalPositions;
pub(crate) use results::Delivered;
use results::Results;
pub(crate) use rewriting::keep_short;
use routed::Routed;
pub(crate) use routed::{Arrival, EndedJob};
pub(crate) use stage::{OpenJob, Stage};

/// Number of results that are remembered; the oldest are forgotten first. A forgotten drawing is treated as new.
const MAX_RESULTS: usize = 100_000;
/// The journal is rewritten when it has this many lines that are no longer needed.
const IDLE_LINES: usize = 20_000;

/// Crashes that follow each other within this time have a cause outside the station, and are counted once.
const SHORTEST_LIFE: Duration = Duration::from_secs(60);

/// A part that was rejected while an older part of its SKU is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Refused {
    pub(crate) drop: DropId,
    /// Its path in the rejected folder, with `/`.
    pub(crate) to: String,
}

/// The journal, with the records that are still needed.
pub(crate) struct Journal {
    folder: PathBuf,
    tag: String,
    /// The identity of the state folder when the tag was written.
    home: Option<Identity>,
    /// Whether the tag is written.
    tag_is_kept: bool,
    /// The identity of the hot folder.
    hot: Option<Identity>,
    /// Closed while the file is replaced, and opened again by the next line.
    file: Option<std::fs::File>,
    /// Length of the file up to the last complete line.
    length: u64,
    lines: usize,
    /// Why the last line could not be written.
    unwritten: Option<String>,
    open: BTreeMap<DropId, OpenJob>,
    results: Results,
    /// The folded names of the results that were added while the journal is being rewritten.
    changed: Option<BTreeSet<Arc<str>>>,
    refused: BTreeMap<String, Refused>,
    at_work: BTreeMap<DropId, AtWork>,
    listings: BTreeMap<DropId, Listing>,
    /// The serial numbers of each SKU, by its key.
    serials: BTreeMap<String, Series>,
    /// Jobs for other lines and of other senders.
    routed: Routed,
}

/// A drop that a thread is processing, or was processing when the station crashed.
#[derive(Debug, Clone, PartialEq, Eq)]
struct AtWork {
    stamp: StampRecord,
    /// How often the station crashed while it processed the drop. Crashes within [`SHORTEST_LIFE`] of each other and of
    /// one start of the machine are counted once.
    deaths: u32,
    /// When the last crash was counted, where the system reports it.
    last_death: Option<Uptime>,
    under_way: bool,
}

impl Journal {
    /// Reads the journal in the state folder, or starts a new one. Damaged lines are logged and skipped; a copy of the
    /// file is kept.
    ///
    /// # Errors
    /// When the folder cannot be read or written; `InvalidData` for a line that a newer version wrote.
    pub(crate) fn open(folder: &Path) -> io::Result<Self> {
        let mut file = match std::fs::File::open(folder.join(JOURNAL)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            file => Some(BufReader::new(
                file.map_err(|error| crate::files::named(error, "cannot read", &folder.join(JOURNAL)))?,
            )),
        };
        let exists = file.is_some();
        let mut journal = Self {
            folder: folder.into(),
            tag: String::new(),
            home: None,
            tag_is_kept: false,
            hot: None,
            file: None,
            length: 0,
            lines: 0,
            unwritten: None,
            open: BTreeMap::new(),
            results: Results::default(),
            changed: None,
            refused: BTreeMap::new(),
            at_work: BTreeMap::new(),
            listings: BTreeMap::new(),
            serials: BTreeMap::new(),
            routed: Routed::default(),
        };
        let (mut damaged, mut read) = (0, 0);
        let mut line = Vec::new();
        while let Some(file) = &mut file {
            line.clear();
            if file.read_until(b'\n', &mut line)? == 0 {
                break;
            }
            read += line.len() as u64;
            match parse(&line) {
                Parsed::Good(line) => {
                    journal.apply(&line.at, line.record);
                    journal.length = read;
                }
                Parsed::Unknown => {
                    let message = "a newer version of isomark wrote it; use that version";
                    return Err(io::Error::new(io::ErrorKind::InvalidData, message));
                }
                // The end of the last line was being written when the station ended.
                Parsed::Damaged if !line.ends_with(b"\n") => {}
                Parsed::Damaged => damaged += 1,
            }
            journal.lines += 1;
        }
        // Windows cannot replace a file that is open.
        drop(file);
        // Without a valid line, the first start may have been interrupted; it had not written a status then.
        let is_damaged = match journal.length {
            0 => exists && folder.join(STATUS).exists(),
            _ => damaged > 0,
        };
        if is_damaged {
            keep_damaged(folder, damaged);
        }
        if journal.tag.is_empty() {
            journal.tag = if journal.lines > 0 { tag_of_older(folder) } else { new_tag() };
        }
        let home = home_of(folder);
        if journal.home.is_some() && journal.home != home {
            (journal.tag, journal.tag_is_kept) = (new_tag(), false);
        }
        journal.home = home;
        // The bytes after the last valid line were being written when the station ended.
        let length = journal.length;
        journal.file()?.set_len(length)?;
        journal.length = length;
        sync_folder(folder)?;
        // The tag is written before the first file with it; on a full disk, it is written with the first delivery.
        if !journal.tag_is_kept
            && let Err(error) = journal.keep_tag()
        {
            tracing::warn!("the journal cannot be written: {error}");
        }
        if let Err(error) = journal.count_deaths() {
            tracing::warn!("the journal cannot be written: {error}");
        }
        if is_damaged || journal.lines > 2 * journal.live() + 1000 {
            journal.rewrite_if_possible();
        }
        Ok(journal)
    }

    /// Why something may be missing in the journal: lines of it were damaged, and nobody has removed the copy of it since.
    pub(crate) fn trouble(&self) -> Option<String> {
        if let Some(error) = &self.unwritten {
            return Some(format!(
                "a line of the journal could not be written: {error}. Free space on the disk of the state folder"
            ));
        }
        let copy = self.folder.join(DAMAGED);
        copy.exists().then(|| {
            format!(
                "the journal was damaged and is not complete. Serial numbers go on after the last one that the archive or the \
                 reports show; drawings that were delivered before may be delivered again when they are dropped again, and \
                 are not found when they are outdated. Check the disk, then remove {}, the copy of the damaged journal",
                copy.display()
            )
        })
    }

    /// Counts a crash for each drop that was being processed: the drop may be the cause.
    fn count_deaths(&mut self) -> io::Result<()> {
        let now = clock::uptime();
        let begun = self.at_work.iter().filter(|(_, at_work)| at_work.under_way);
        let died = begun.map(|(drop, at_work)| {
            let is_new = is_new_death(at_work, now.as_ref());
            let deaths = at_work.deaths + u32::from(is_new);
            let last = if is_new { now.clone() } else { at_work.last_death.clone() };
            died(drop.clone(), at_work.stamp, deaths, last)
        });
        died.collect::<Vec<_>>().into_iter().try_for_each(|record| self.append(record, false))
    }

    fn keep_tag(&mut self) -> io::Result<()> {
        self.append(Record::Tag { tag: self.tag.clone(), home: self.home }, true)
    }

    fn live(&self) -> usize {
        self.open.len()
            + self.results.len()
            + self.refused.len()
            + self.at_work.len()
            + self.listings.len()
            + self.serials.len()
            + self.routed.len()
    }

    fn file(&mut self) -> io::Result<&mut std::fs::File> {
        if self.file.is_none() {
            let path = self.folder.join(JOURNAL);
            let file = fs::OpenOptions::new().create(true).truncate(false).write(true).open(path)?;
            // If replacing the journal failed after the rename, the known length is that of the old file.
            self.length = file.metadata()?.len();
            self.file = Some(file.into_parts().0);
        }
        self.file.as_mut().ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    /// Writes all needed records again if the file was removed or replaced.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(crate) fn keep_in_place(&mut self) -> io::Result<()> {
        match &self.file {
            Some(file) if !is_still_at(file, &self.folder.join(JOURNAL)) => self.rewrite(),
            // The journal was replaced and has not been opened since.
            None if !self.folder.join(JOURNAL).exists() => self.rewrite(),
            _ => Ok(()),
        }
    }

    /// Sets the identity of the hot folder, which is noted with every job that is started from now on.
    pub(crate) fn set_hot(&mut self, identity: Option<Identity>) {
        self.hot = identity;
    }

    /// Notes that a thread starts to process this drop.
    pub(crate) fn began(&mut self, drop: &DropId, stamp: Stamp) -> io::Result<()> {
        self.append(Record::Began { drop: drop.clone(), stamp: stamp.into() }, false)
    }

    /// Notes that no thread processes this drop any more, unless a line already states that it is done.
    pub(crate) fn ended(&mut self, drop: &DropId) -> io::Result<()> {
        if !self.at_work.contains_key(drop) {
            return Ok(());
        }
        self.append(Record::Ended { drop: drop.clone() }, false)
    }

    /// The drops that were being processed when the station crashed, with the number of crashes.
    pub(crate) fn suspects(&self) -> BTreeMap<DropId, (StampRecord, u32)> {
        let died = self.at_work.iter().filter(|(_, at_work)| at_work.deaths > 0);
        died.map(|(drop, at_work)| (drop.clone(), (at_work.stamp, at_work.deaths))).collect()
    }

    /// The job that was started on exactly this file.
    pub(crate) fn begun(&self, drop: &DropId, stamp: Stamp) -> Option<&OpenJob> {
        self.open.get(drop).filter(|open| open.stamp.is_of(stamp))
    }

    /// Whether a job was started on this drop, and not filed.
    pub(crate) fn has_begun(&self, drop: &DropId) -> bool {
        self.open.contains_key(drop)
    }

    /// The newest results that may not have been delivered.
    pub(crate) fn uncertain(&self) -> impl Iterator<Item = Delivered> {
        self.results.uncertain()
    }

    /// The times of the newest certain results after a time, as text.
    pub(crate) fn delivered_after(&self, from: &str) -> Vec<String> {
        let is_new = |result: &Delivered| result.at.as_str() > from && result.certainty == Certainty::Certain;
        self.results.iter().filter(is_new).map(|result| result.at).collect()
    }

    /// All jobs that were started and not filed.
    pub(crate) fn all_begun(&self) -> Vec<(DropId, OpenJob)> {
        self.open.iter().map(|(drop, open)| (drop.clone(), open.clone())).collect()
    }

    /// The newest result of a name, in any spelling.
    pub(crate) fn result(&self, name: &str) -> Option<Delivered> {
        self.results.get(name)
    }

    /// Up to `limit` of the newest results of a SKU, in the order of their folded names after `after`, with the folded
    /// name of the last one. The limit is needed because there may be a hundred thousand.
    pub(crate) fn results_of(
        &self,
        sku: &Sku,
        after: Option<&str>,
        limit: usize,
    ) -> (Vec<Delivered>, Option<Arc<str>>) {
        self.results.of_sku(sku, after, limit)
    }

    /// Number of results whose basis an older version wrote.
    pub(crate) fn of_older_form(&self) -> usize {
        self.results.of_older_form()
    }

    /// The SKUs of all results.
    pub(crate) fn skus(&self) -> BTreeSet<Sku> {
        self.results.skus().cloned().collect()
    }

    /// Whether drawings of the SKU were delivered.
    pub(crate) fn has_results(&self, sku: &Sku) -> bool {
        self.results.has_any_of(sku)
    }

    /// Whether patterns wait because of the part at this place in the rejected folder.
    pub(crate) fn holds_patterns_back(&self, rejected: &str) -> bool {
        self.refused.values().any(|refused| refused.to == rejected)
    }

    /// The tag in the names of this station's temporary files.
    pub(crate) fn tag(&self) -> &str {
        &self.tag
    }

    /// The part of the SKU that was rejected last, if no part was learned since.
    pub(crate) fn refused(&self, sku: &Sku) -> Option<&Refused> {
        self.refused.get(sku.key())
    }

    /// Notes that the drawing is flushed under its temporary name and is about to get its final one.
    pub(crate) fn delivering(&mut self, job: &Job, stamp: Stamp, import: Option<Identity>) -> io::Result<()> {
        if !self.tag_is_kept {
            self.keep_tag()?;
        }
        let (job, stamp, hot, tag) = (job.clone(), stamp.into(), self.hot, self.tag.clone());
        self.append(Record::Delivering { job, stamp, import, hot, tag }, true)
    }

    /// Notes that the drawing has its final name, with the certainty of that.
    pub(crate) fn delivered(&mut self, drop: &DropId, certainty: Certainty) -> io::Result<()> {
        self.append(Record::Delivered { drop: drop.clone(), certainty }, false)
    }

    /// Notes that the drawing did not get its final name.
    pub(crate) fn cancelled(&mut self, drop: &DropId) -> io::Result<()> {
        self.append(Record::Cancelled { drop: drop.clone() }, true)
    }

    /// Notes that the original is about to be moved to `to`, relative to the SKU's archive folder. `result` is the
    /// drawing that was made from it, with the certainty of its delivery; `None` for a part.
    pub(crate) fn filing(
        &mut self,
        drop: &DropId,
        sku: &str,
        stamp: Stamp,
        to: &str,
        result: Option<(&Job, Certainty)>,
    ) -> io::Result<()> {
        let record = Record::Filing {
            drop: drop.clone(),
            sku: sku.into(),
            stamp: stamp.into(),
            to: to.into(),
            job: result.map(|(job, _)| job.clone()),
            certainty: result.map(|(_, certainty)| certainty).unwrap_or_default(),
            hot: self.hot,
        };
        self.append(record, true)
    }

    /// Notes that a drawing is done and its original filed.
    pub(crate) fn done(
        &mut self,
        job: &Job,
        original: &str,
        import: Import,
        certainty: Certainty,
    ) -> io::Result<()> {
        let last = self.result(&job.name).filter(|_| import == Import::Due);
        let older = last.map(|last| last.held().to_owned()).unwrap_or_default();
        let ends =
            self.arrival(&job.drop).filter(|arrival| arrival.is_drop).map(|arrival| arrival.claim.0.clone());
        let (job, original) = (job.clone(), original.into());
        self.append(Record::Done { job, original, import, older, certainty, ends }, false)
    }

    /// Replaces the basis that an older version wrote in the results with these names, unless their drop is being
    /// processed.
    pub(crate) fn rebase(&mut self, bases: Vec<(&str, String)>) -> io::Result<()> {
        for (name, basis) in bases {
            let Some(result) = self.result(name).filter(Delivered::is_of_older_form) else { continue };
            let Delivered { job, at, original, import, certainty, older } = result;
            if self.open.contains_key(&job.drop) || self.at_work.contains_key(&job.drop) {
                continue;
            }
            let job = Job { basis, ..job };
            self.append_line(
                Line { at, record: Record::Done { job, original, import, older, certainty, ends: None } },
                false,
            )?;
        }
        Ok(())
    }

    /// Forgets the original at this place in the SKU's archive folder, and calls `remove` to remove it. Returns `false`
    /// if the original is still needed, or was not filed by this station. No job can start on it meanwhile.
    ///
    /// # Errors
    /// When the journal cannot be written, or `remove` fails; then the original is not forgotten.
    pub(crate) fn remove_original(
        &mut self,
        sku: &Sku,
        place: &str,
        remove: impl FnOnce() -> io::Result<()>,
    ) -> io::Result<bool> {
        let again = DropId::archived(sku, place);
        let is_open = |open: &OpenJob| {
            matches!(&open.stage, Stage::Filing { to, .. } if to == place)
                && open.sku.parse::<Sku>().is_ok_and(|open| open == *sku)
        };
        if self.at_work.contains_key(&again)
            || self.open.contains_key(&again)
            || self.open.values().any(is_open)
        {
            return Ok(false);
        }
        let is_its_original = |result: &Delivered| {
            result.original == place && result.job.sku.parse::<Sku>().is_ok_and(|of| of == *sku)
        };
        let Some(result) = self.result(&delivered_as(again.file_name())).filter(is_its_original) else {
            // Only numbered folders are certainly created by a station.
            return if place.contains('/') { remove().map(|()| true) } else { Ok(false) };
        };
        let is_needed = result.certainty == Certainty::Uncertain
            || result.import == Import::Due
            || self.open.contains_key(&result.job.drop)
            || self.at_work.contains_key(&result.job.drop);
        if is_needed {
            return Ok(false);
        }
        let gone = Delivered { original: String::new(), ..result.clone() };
        self.append_line(gone.line(), false)?;
        if let Err(error) = remove() {
            self.append_line(result.line(), false)?;
            return Err(error);
        }
        Ok(true)
    }

    /// Notes that a part is done and filed.
    pub(crate) fn learned(&mut self, drop: &DropId, sku: &str, original: &str) -> io::Result<()> {
        let record = Record::Learned { drop: drop.clone(), sku: sku.into(), original: original.into() };
        self.append(record, false)
    }

    /// Notes that a drop is moved to the rejected folder.
    pub(crate) fn rejected(
        &mut self,
        drop: &DropId,
        code: &str,
        to: &str,
        part_of: Option<&Sku>,
    ) -> io::Result<()> {
        let part_of = part_of.map(|sku| sku.as_str().to_owned());
        let record = Record::Rejected { drop: drop.clone(), code: code.into(), to: to.into(), part_of };
        // Without this line on the disk, patterns might be corrected for the older part after a crash.
        let keep = matches!(&record, Record::Rejected { part_of: Some(_), .. });
        self.append(record, keep)
    }

    /// Appends a line; with `flush` it survives a power cut. An error leaves the journal unchanged.
    fn append(&mut self, record: Record, flush: bool) -> io::Result<()> {
        self.append_line(Line { at: clock::now(), record }, flush)
    }

    fn append_line(&mut self, line: Line, flush: bool) -> io::Result<()> {
        let text = written(&line)?;
        if let Err(error) = self.write(text.as_bytes(), flush) {
            // A line cut by a full disk would make the next one unreadable.
            if let Some(file) = &self.file {
                file.set_len(self.length)?;
                file.sync_data()?;
            }
            let error = crate::files::named(error, "cannot write", &self.folder.join(JOURNAL));
            self.unwritten = Some(error.to_string());
            return Err(error);
        }
        self.unwritten = None;
        self.length += text.len() as u64;
        self.lines += 1;
        self.apply(&line.at, line.record);
        Ok(())
    }

    fn write(&mut self, bytes: &[u8], flush: bool) -> io::Result<()> {
        self.file()?;
        let end = self.length;
        let file = self.file()?;
        file.seek(SeekFrom::Start(end))?;
        file.write_all(bytes)?;
        if flush { file.sync_data() } else { Ok(()) }
    }

    fn rewrite_if_possible(&mut self) {
        if let Err(error) = self.rewrite() {
            tracing::warn!("the journal cannot be shortened: {error}");
            self.lines = 0;
        }
    }

    fn apply(&mut self, at: &str, record: Record) {
        match record {
            Record::Tag { tag, home } => (self.tag, self.home, self.tag_is_kept) = (tag, home, true),
            Record::Delivering { job: result, stamp, import, hot, tag } => {
                let (drop, sku) = (result.drop.clone(), result.sku.clone());
                self.open.insert(
                    drop,
                    OpenJob { stamp, sku, hot, stage: Stage::Renaming { result, import, tag } },
                );
            }
            Record::Delivered { drop, certainty } => {
                self.open.entry(drop).and_modify(|open| open.delivered(certainty));
            }
            Record::Began { drop, stamp } => {
                let same = self.at_work.get(&drop).filter(|at_work| at_work.stamp == stamp);
                let (deaths, last_death) =
                    same.map_or((0, None), |last| (last.deaths, last.last_death.clone()));
                self.at_work.insert(drop, AtWork { stamp, deaths, last_death, under_way: true });
            }
            Record::Ended { drop } => {
                self.at_work.remove(&drop);
            }
            Record::Died { drop, stamp, deaths, boot, uptime } => {
                let last_death = uptime.map(|uptime| Uptime { boot, since: Duration::from_secs(uptime) });
                self.at_work.insert(drop, AtWork { stamp, deaths, last_death, under_way: false });
            }
            Record::Cancelled { drop } => {
                self.open.remove(&drop);
                // A list that was filed, but not noted as such.
                self.listings.remove(&drop);
                self.routed.forget_offer(&drop);
            }
            Record::Filing { drop, sku, stamp, to, job, certainty, hot } => {
                let result = job.map(|job| (job, certainty));
                match self.open.get_mut(&drop) {
                    Some(open) if open.stamp.is_same(stamp) => open.filing(result, to),
                    // A job without a delivery starts with this line.
                    _ => {
                        self.open
                            .insert(drop, OpenJob { stamp, sku, hot, stage: Stage::Filing { result, to } });
                    }
                }
            }
            Record::Done { job, original, import, older, certainty, ends } => {
                self.open.remove(&job.drop);
                self.at_work.remove(&job.drop);
                if ends.is_some() {
                    self.routed.end_of_drawing(&job.drop, at, certainty);
                }
                let result = Delivered { at: at.into(), original, job, import, certainty, older };
                let name = self.results.insert(&result);
                if let Some(changed) = &mut self.changed {
                    changed.insert(name);
                }
            }
            Record::Listing { drop, listing } => self.apply_listing(drop, listing),
            Record::Naming { drop, named } => {
                self.listings.entry(drop).and_modify(|listing| listing.named = named);
            }
            Record::Listed { drop } => {
                self.routed.end(&drop, at, "listed", "");
                self.listings.remove(&drop);
                self.open.remove(&drop);
                self.at_work.remove(&drop);
            }
            Record::Serials { sku, start, step, used } => {
                self.serials.insert(sku, Series { start, step, used });
            }
            Record::Learned { drop, sku, .. } => {
                self.open.remove(&drop);
                self.at_work.remove(&drop);
                if let Ok(sku) = sku.parse::<Sku>() {
                    self.refused.remove(sku.key());
                }
            }
            Record::Rejected { drop, to, part_of, .. } => {
                self.routed.end(&drop, at, "rejected", &to);
                self.routed.forget_offer(&drop);
                self.listings.remove(&drop);
                self.open.remove(&drop);
                self.at_work.remove(&drop);
                if let Some(Ok(sku)) = part_of.map(|sku| sku.parse::<Sku>()) {
                    self.refused.insert(sku.key().to_owned(), Refused { drop, to });
                }
            }
            record @ Record::HandedOver { .. } => {
                if let Record::HandedOver { drop, .. } = &record {
                    self.open.remove(drop);
                    self.at_work.remove(drop);
                }
                self.routed.apply(at, record);
            }
            record @ (Record::Offering { .. }
            | Record::Arriving { .. }
            | Record::Arrived { .. }
            | Record::Returned { .. }
            | Record::JobEnded { .. }
            | Record::JobReported { .. }) => self.routed.apply(at, record),
        }
    }

    /// Forgets the oldest results when there are too many, except those that are uncertain or still to be imported.
    fn forget_surplus(&mut self) {
        let surplus = self.results.len().saturating_sub(MAX_RESULTS);
        if surplus > 0 {
            let mut by_age: Vec<_> = self.results.iter().filter_map(age).collect();
            by_age.sort();
            by_age.into_iter().take(surplus).for_each(|(_, name)| self.results.remove(&name));
        }
    }

    /// Replaces the journal by one with only the needed records.
    fn rewrite(&mut self) -> io::Result<()> {
        self.forget_surplus();
        let mut new = NewJournal::begin(&self.folder)?;
        for result in self.results.iter() {
            new.put(&result.line())?;
        }
        self.replace_by(new)
    }

    /// The lines of all needed records except the results.
    fn lines_but_results(&self) -> Vec<Line> {
        let at = clock::now();
        let tag = Record::Tag { tag: self.tag.clone(), home: home_of(&self.folder) };
        let mut records = vec![tag];
        for (sku, refused) in &self.refused {
            let Refused { drop, to } = refused.clone();
            records.push(Record::Rejected { drop, to, code: String::new(), part_of: Some(sku.clone()) });
        }
        for (drop, at_work) in &self.at_work {
            let AtWork { stamp, deaths, ref last_death, under_way } = *at_work;
            let drop = drop.clone();
            records.push(died(drop.clone(), stamp, deaths, last_death.clone()));
            if under_way {
                records.push(Record::Began { drop, stamp });
            }
        }
        records.extend(self.open.iter().flat_map(|(drop, open)| open.records(drop)));
        records.extend(self.listing_records());
        records.extend(self.routed.records());
        records.into_iter().map(|record| Line { at: at.clone(), record }).collect()
    }

    /// Completes a new journal, which contains all results, and replaces this one by it.
    fn replace_by(&mut self, mut new: NewJournal) -> io::Result<()> {
        for line in self.lines_but_results() {
            new.put(&line)?;
        }
        // Windows cannot replace a file that is open.
        self.file = None;
        (self.lines, self.length) = new.keep(&self.folder)?;
        (self.home, self.tag_is_kept) = (home_of(&self.folder), true);
        Ok(())
    }
}

/// Keeps a copy of a damaged journal, unless there is one already.
fn keep_damaged(folder: &Path, lines: usize) {
    let (journal, copy) = (folder.join(JOURNAL), folder.join(DAMAGED));
    let what = match lines {
        0 => format!("{} has no valid line", journal.display()),
        1 => format!("skipping 1 damaged line of {}", journal.display()),
        more => format!("skipping {more} damaged lines of {}", journal.display()),
    };
    let kept = if copy.exists() { Ok(0) } else { fs::copy(&journal, &copy) };
    match kept {
        Ok(_) => tracing::error!("{what}; {} is a copy", copy.display()),
        Err(error) => tracing::error!("{what}; no copy of it can be kept: {error}"),
    }
}

/// The time and name of a result; `None` for one that must not be forgotten.
fn age(result: Delivered) -> Option<(String, String)> {
    let is_over = result.certainty == Certainty::Certain && result.import != Import::Due;
    is_over.then_some((result.at, result.job.name))
}

/// A tag that no other station has: two machines with the same path of the state folder may deliver to one folder.
fn new_tag() -> String {
    // The standard library uses random keys for its hashers.
    format!("{:08x}", RandomState::new().hash_one(clock::now()) as u32)
}

/// The identity of the state folder, so that a copy of it is recognized.
#[cfg(unix)]
fn home_of(folder: &Path) -> Option<Identity> {
    crate::hotfolder::seen::folders::identity(folder)
}

/// The identity of the state folder, so that a copy of it is recognized: a copy has another path.
#[cfg(not(unix))]
fn home_of(folder: &Path) -> Option<Identity> {
    let full = fs::canonicalize(folder).ok()?;
    let hash = blake3::hash(crate::config::fold(&full.to_string_lossy()).as_bytes());
    hash.as_bytes().first_chunk().map(|bytes| Identity::from_le_bytes(*bytes))
}

/// The tag of a station whose journal contains none, because an older version wrote it.
fn tag_of_older(folder: &Path) -> String {
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
    blake3::hash(folder.as_os_str().as_encoded_bytes()).to_hex()[..8].to_owned()
}

/// Whether the crash that is found now is counted as a new one. Where the system does not report the uptime, only the
/// first crash is counted, so that no drop is rejected by mistake.
fn is_new_death(at_work: &AtWork, now: Option<&Uptime>) -> bool {
    match (&at_work.last_death, now) {
        // Counted by an older version, which used another clock.
        (None, Some(_)) => true,
        (None, None) => at_work.deaths == 0,
        // The machine was restarted; a wrong clock cannot cause this.
        (Some(last), Some(now))
            if ![&last.boot, &now.boot].contains(&&String::new()) && last.boot != now.boot =>
        {
            true
        }
        (Some(last), Some(now)) => now.passed_since(last) >= SHORTEST_LIFE,
        (Some(_), None) => false,
    }
}

fn died(drop: DropId, stamp: StampRecord, deaths: u32, last: Option<Uptime>) -> Record {
    let uptime = last.as_ref().map(|last| last.since.as_secs());
    Record::Died { drop, stamp, deaths, boot: last.map(|last| last.boot).unwrap_or_default(), uptime }
}

#[cfg(test)]
mod tests;
