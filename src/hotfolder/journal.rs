//! What the station must not forget, whatever happens to it: one line for each step that cannot be taken back.
//!
//! ```text
//! state/journal.log
//! 5b1c02aa {"at":"2026-03-01T12:34:56Z","did":"delivering","drop":"can@date.dxf", … }
//! 09fe77d1 {"at":"2026-03-01T12:34:56Z","did":"delivered","drop":"can@date.dxf"}
//! ```
//!
//! Each line begins with the first eight hexadecimal digits of the BLAKE3 hash of what follows, so that a line cut by
//! a crash is known for what it is. Lines are only ever appended and flushed to the disk; when the journal has become
//! long it is written anew, whole, with what still counts.
//!
//! # Exactly once
//!
//! A drawing lies flushed in the import folder under a name that importers ignore *before* the journal says
//! `delivering`, and is renamed to its own name *after* that. Nobody but this station touches the temporary name, so
//! after a crash it alone decides: it is still there, then the drawing was not delivered; it is gone, then it was, also
//! when the importer has taken the drawing away since. A drop is known by its path and its [`Stamp`]: should another
//! file bear its name by then, that is another drop.

use std::collections::{BTreeMap, BTreeSet};
use std::hash::{BuildHasher, RandomState};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, UNIX_EPOCH};

use fs_err as fs;
use serde::{Deserialize, Serialize};

use super::clock;
use super::folders::{Identity, identity, lies_at};
use super::reprocess::ARCHIVE;
use super::settle::Stamp;
use crate::config::{Sku, fold};
use crate::files::{read_if_there, sync_folder, write_whole};

const JOURNAL: &str = "journal.log";
/// Results that are remembered; the oldest are forgotten first. A dropped drawing that is forgotten is new again.
const MOST_RESULTS: usize = 100_000;
/// The journal is written anew when it has this many lines more than what still counts.
const IDLE_LINES: usize = 20_000;

/// What one drawing was made of and became.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Job {
    /// The drop, relative to the hot folder, with `/`; for an archived original that is corrected again, its place in
    /// the archive after `archive:`.
    pub(super) drop: String,
    /// The SKU's name.
    pub(super) sku: String,
    /// The name of the result in the import folder.
    pub(super) name: String,
    /// Hash of everything the result depends on: name, pattern, surface, settings and version.
    pub(super) key: String,
    /// Hash of what may change without a new drop: surface and settings.
    pub(super) basis: String,
    /// Hash of the pattern.
    pub(super) pattern: String,
    /// Hash of the corrected drawing.
    pub(super) result: String,
}

/// Whether BeamConstruct holds a drawing that lies in the import folder.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Import {
    /// Nobody was to see to it: an importer takes drawings from the folder.
    #[default]
    ByFolder,
    /// BeamServer has still to be told.
    Due,
    /// It was imported.
    Done,
}

/// A job that was begun and not filed away.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct OpenJob {
    pub(super) stamp: StampRecord,
    pub(super) sku: String,
    /// The drawing; `None` for a part.
    pub(super) job: Option<Job>,
    /// Which folder was the import folder.
    pub(super) import: Option<Identity>,
    /// Which folder was the hot folder, where that was noted.
    pub(super) hot: Option<Identity>,
    /// What its temporary file bears in its name, if it was noted.
    pub(super) tag: String,
    /// Whether the drawing lies, or lay, in the import folder.
    pub(super) delivered: bool,
    /// Where its original goes in the archive, relative to the SKU's folder.
    pub(super) to: Option<String>,
}

/// The newest result of a name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Delivered {
    pub(super) job: Job,
    /// When it was delivered.
    pub(super) at: String,
    /// Its original in the archive, relative to the SKU's folder; empty when it is not there.
    pub(super) original: String,
    pub(super) import: Import,
    /// Hash of the older result that BeamConstruct holds as long as this one is due there.
    older: String,
}

impl Delivered {
    /// Hash of the result that the marking software has.
    pub(super) fn held(&self) -> &str {
        if self.import == Import::Due { &self.older } else { &self.job.result }
    }
}

/// A part that was rejected while an older shape of its SKU is known.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Refused {
    pub(super) drop: String,
    /// Where it lies in the rejected folder, with `/`.
    pub(super) to: String,
}

/// A [`Stamp`] as it is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct StampRecord {
    size: u64,
    /// Nanoseconds since 1970.
    modified: Option<u64>,
    identity: u64,
}

impl StampRecord {
    /// Whether it is the stamp of this file. Some shares number their files anew with each mount: size and time of the
    /// last write, to the nanosecond, decide where the system tells the time.
    pub(super) fn is_of(&self, stamp: Stamp) -> bool {
        let now = Self::from(stamp);
        *self == now || (self.modified.is_some() && (self.size, self.modified) == (now.size, now.modified))
    }
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "did", rename_all = "kebab-case")]
enum Record {
    /// What this station's temporary files bear in their names.
    Tag {
        tag: String,
        /// Which folder was the state folder: a copy of it is another station's.
        #[serde(default)]
        home: Option<Identity>,
    },
    /// The drawing lies in the import folder under its temporary name and is about to be renamed.
    Delivering {
        #[serde(flatten)]
        job: Job,
        stamp: StampRecord,
        import: Option<Identity>,
        #[serde(default)]
        hot: Option<Identity>,
        /// The tag in the temporary file's name.
        #[serde(default)]
        tag: String,
    },
    /// It bears its own name.
    Delivered { drop: String },
    /// A thread is at this drop.
    Began { drop: String, stamp: StampRecord },
    /// It is not any more.
    Ended { drop: String },
    /// The station ended as often while a thread was at this drop.
    Died { drop: String, stamp: StampRecord, deaths: u32 },
    /// It could not be renamed; the drop waits.
    Cancelled { drop: String },
    /// The original is about to go to the archive.
    Filing {
        drop: String,
        sku: String,
        stamp: StampRecord,
        to: String,
        /// The drawing, if it had not to be delivered.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        job: Option<Job>,
        #[serde(default)]
        hot: Option<Identity>,
    },
    /// A drawing is done; all that later jobs need to know of it.
    Done {
        #[serde(flatten)]
        job: Job,
        original: String,
        #[serde(default)]
        import: Import,
        #[serde(default, skip_serializing_if = "String::is_empty")]
        older: String,
    },
    /// A part is done.
    Learned { drop: String, sku: String, original: String },
    /// A drop was rejected; `part_of` names the SKU of a part.
    Rejected {
        drop: String,
        code: String,
        to: String,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        part_of: Option<String>,
    },
}

#[derive(Serialize, Deserialize)]
struct Line {
    at: String,
    #[serde(flatten)]
    record: Record,
}

/// The journal with what still counts of it.
pub(super) struct Journal {
    folder: PathBuf,
    tag: String,
    /// Which folder was the state folder when the tag was written.
    home: Option<Identity>,
    /// Whether the tag is written.
    tag_is_kept: bool,
    /// Which folder is the hot folder.
    hot: Option<Identity>,
    /// Closed while the file is replaced, and opened again by the next line.
    file: Option<std::fs::File>,
    /// Length of the file up to the last whole line.
    length: u64,
    lines: usize,
    open: BTreeMap<String, OpenJob>,
    /// By their names, folded: on a Windows share two spellings are one file.
    results: BTreeMap<String, Delivered>,
    /// The folded names of the results of each SKU.
    by_sku: BTreeMap<Sku, BTreeSet<String>>,
    refused: BTreeMap<String, Refused>,
    at_work: BTreeMap<String, AtWork>,
}

/// A drop that a thread is at, or was at when the station ended.
#[derive(Debug, Clone, PartialEq, Eq)]
struct AtWork {
    stamp: StampRecord,
    /// In how many minutes the station ended meanwhile, without a word. What ends it comes from outside if that happens
    /// again and again within one.
    deaths: u32,
    /// When it did so last, to the minute.
    last_death: String,
    under_way: bool,
}

impl Journal {
    /// Reads the journal in the state folder, or begins one. Lines that are damaged are told and skipped.
    ///
    /// # Errors
    /// When the folder cannot be read or written; `InvalidData` for a line that a newer version wrote.
    pub(super) fn open(folder: &Path) -> io::Result<Self> {
        let bytes = read_if_there(&folder.join(JOURNAL))?.unwrap_or_default();
        let mut journal = Self {
            folder: folder.into(),
            tag: String::new(),
            home: None,
            tag_is_kept: false,
            hot: None,
            file: None,
            length: 0,
            lines: 0,
            open: BTreeMap::new(),
            results: BTreeMap::new(),
            by_sku: BTreeMap::new(),
            refused: BTreeMap::new(),
            at_work: BTreeMap::new(),
        };
        let (mut damaged, mut read) = (0, 0);
        for line in bytes.split_inclusive(|byte| *byte == b'\n') {
            read += line.len() as u64;
            match parse(line) {
                Parsed::Good(line) => {
                    journal.apply(&line.at, line.record);
                    journal.length = read;
                }
                Parsed::Unknown => {
                    let words = "a newer version of isomark wrote into it; start that one";
                    return Err(io::Error::new(io::ErrorKind::InvalidData, words));
                }
                Parsed::Damaged => damaged += 1,
            }
            journal.lines += 1;
        }
        if journal.tag.is_empty() {
            journal.tag = if journal.lines > 0 { tag_of_older(folder) } else { new_tag() };
        }
        let home = identity(folder);
        if journal.home.is_some() && journal.home != home {
            (journal.tag, journal.tag_is_kept) = (new_tag(), false);
        }
        journal.home = home;
        // What follows the last good line was being written when the station ended.
        let length = journal.length;
        journal.file()?.set_len(length)?;
        journal.length = length;
        sync_folder(folder)?;
        // Before the first file that bears it; on a full disk it is written with the first delivery.
        if !journal.tag_is_kept
            && let Err(error) = journal.keep_tag()
        {
            tracing::warn!("the journal cannot be written: {error}");
        }
        if let Err(error) = journal.count_deaths() {
            tracing::warn!("the journal cannot be written: {error}");
        }
        if damaged > 0 {
            tracing::warn!("{damaged} damaged lines of {} are skipped", folder.join(JOURNAL).display());
        }
        if journal.lines > 2 * journal.live() + 1000 {
            journal.write_anew_if_possible();
        }
        Ok(journal)
    }

    /// What the station was at when it ended may be why it ended.
    fn count_deaths(&mut self) -> io::Result<()> {
        let now = to_the_minute(&clock::now());
        let begun = self.at_work.iter().filter(|(_, at_work)| at_work.under_way);
        let died = begun.map(|(drop, at_work)| {
            let deaths = at_work.deaths + u32::from(at_work.last_death != now);
            Record::Died { drop: drop.clone(), stamp: at_work.stamp, deaths }
        });
        died.collect::<Vec<_>>().into_iter().try_for_each(|record| self.append(record, false))
    }

    fn keep_tag(&mut self) -> io::Result<()> {
        self.append(Record::Tag { tag: self.tag.clone(), home: self.home }, true)
    }

    fn live(&self) -> usize {
        self.open.len() + self.results.len() + self.refused.len() + self.at_work.len()
    }

    fn file(&mut self) -> io::Result<&mut std::fs::File> {
        if self.file.is_none() {
            let path = self.folder.join(JOURNAL);
            let file = fs::OpenOptions::new().create(true).truncate(false).write(true).open(path)?;
            // A file that was replaced without a word of it may have another length.
            self.length = file.metadata()?.len();
            self.file = Some(file.into_parts().0);
        }
        self.file.as_mut().ok_or_else(|| io::ErrorKind::NotFound.into())
    }

    /// Writes all that counts anew if the file is not there any more.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(super) fn keep_in_place(&mut self) -> io::Result<()> {
        match &self.file {
            Some(file) if !lies_at(file, &self.folder.join(JOURNAL)) => self.write_anew(),
            _ => Ok(()),
        }
    }

    /// Notes with the jobs that are begun from now on which folder is the hot folder.
    pub(super) fn hot_is(&mut self, identity: Option<Identity>) {
        self.hot = identity;
    }

    /// A thread is at this drop.
    pub(super) fn began(&mut self, drop: &str, stamp: Stamp) -> io::Result<()> {
        self.append(Record::Began { drop: drop.into(), stamp: stamp.into() }, false)
    }

    /// No thread is at this drop any more.
    pub(super) fn ended(&mut self, drop: &str) -> io::Result<()> {
        self.append(Record::Ended { drop: drop.into() }, false)
    }

    /// The drops that the station was at when it ended without a word, and how often.
    pub(super) fn suspects(&self) -> BTreeMap<String, (StampRecord, u32)> {
        let died = self.at_work.iter().filter(|(_, at_work)| at_work.deaths > 0);
        died.map(|(drop, at_work)| (drop.clone(), (at_work.stamp, at_work.deaths))).collect()
    }

    /// The job that was begun on this very file.
    pub(super) fn begun(&self, drop: &str, stamp: Stamp) -> Option<&OpenJob> {
        self.open.get(drop).filter(|open| open.stamp.is_of(stamp))
    }

    /// All jobs that were begun and not filed away.
    pub(super) fn all_begun(&self) -> Vec<(String, OpenJob)> {
        self.open.iter().map(|(drop, open)| (drop.clone(), open.clone())).collect()
    }

    /// The newest result of a name, however it is spelled.
    pub(super) fn result(&self, name: &str) -> Option<&Delivered> {
        self.results.get(&fold(name))
    }

    /// The newest results of a SKU.
    pub(super) fn results_of(&self, sku: &Sku) -> Vec<Delivered> {
        let names = self.by_sku.get(sku).into_iter().flatten();
        names.filter_map(|name| self.results.get(name)).cloned().collect()
    }

    /// The SKUs of all results.
    pub(super) fn skus(&self) -> BTreeSet<Sku> {
        self.by_sku.keys().cloned().collect()
    }

    /// What this station's temporary files bear in their names.
    pub(super) fn tag(&self) -> &str {
        &self.tag
    }

    /// The part of the SKU that was rejected last, if none was taken since.
    pub(super) fn refused(&self, sku: &Sku) -> Option<&Refused> {
        self.refused.get(sku.key())
    }

    /// The drawing lies flushed under its temporary name and is about to get its own.
    pub(super) fn delivering(&mut self, job: &Job, stamp: Stamp, import: Option<Identity>) -> io::Result<()> {
        if !self.tag_is_kept {
            self.keep_tag()?;
        }
        let (job, stamp, hot, tag) = (job.clone(), stamp.into(), self.hot, self.tag.clone());
        self.append(Record::Delivering { job, stamp, import, hot, tag }, true)
    }

    /// The drawing bears its own name.
    pub(super) fn delivered(&mut self, drop: &str) -> io::Result<()> {
        self.append(Record::Delivered { drop: drop.into() }, false)
    }

    /// The drawing was not given its own name.
    pub(super) fn cancelled(&mut self, drop: &str) -> io::Result<()> {
        self.append(Record::Cancelled { drop: drop.into() }, true)
    }

    /// The original is about to go to `to`, relative to the SKU's archive folder; `job` is the drawing that is done,
    /// `None` for a part.
    pub(super) fn filing(
        &mut self,
        drop: &str,
        sku: &str,
        stamp: Stamp,
        to: &str,
        job: Option<&Job>,
    ) -> io::Result<()> {
        let record = Record::Filing {
            drop: drop.into(),
            sku: sku.into(),
            stamp: stamp.into(),
            to: to.into(),
            job: job.cloned(),
            hot: self.hot,
        };
        self.append(record, true)
    }

    /// A drawing is done, its original filed away.
    pub(super) fn done(&mut self, job: &Job, original: &str, import: Import) -> io::Result<()> {
        let last = self.result(&job.name).filter(|_| import == Import::Due);
        let older = last.map(|last| last.held().to_owned()).unwrap_or_default();
        self.append(Record::Done { job: job.clone(), original: original.into(), import, older }, false)
    }

    /// A part is done and filed away.
    pub(super) fn learned(&mut self, drop: &str, sku: &str, original: &str) -> io::Result<()> {
        let record = Record::Learned { drop: drop.into(), sku: sku.into(), original: original.into() };
        self.append(record, false)
    }

    /// A drop lies in the rejected folder.
    pub(super) fn rejected(
        &mut self,
        drop: &str,
        code: &str,
        to: &str,
        part_of: Option<&Sku>,
    ) -> io::Result<()> {
        let part_of = part_of.map(|sku| sku.as_str().to_owned());
        let record = Record::Rejected { drop: drop.into(), code: code.into(), to: to.into(), part_of };
        // Without this line on the disk, patterns might go on with the older shape after a crash.
        let keep = matches!(&record, Record::Rejected { part_of: Some(_), .. });
        self.append(record, keep)
    }

    /// Appends a line; with `flush` it survives a power cut. What fails leaves the journal as it was.
    fn append(&mut self, record: Record, flush: bool) -> io::Result<()> {
        let at = clock::now();
        let line = Line { at, record };
        let text = written(&line)?;
        if let Err(error) = self.write(text.as_bytes(), flush) {
            // A line cut by a full disk would spoil the next one.
            if let Some(file) = &self.file {
                file.set_len(self.length)?;
                file.sync_data()?;
            }
            return Err(crate::files::named(error, "cannot write", &self.folder.join(JOURNAL)));
        }
        self.length += text.len() as u64;
        self.lines += 1;
        self.apply(&line.at, line.record);
        if self.lines > self.live() + IDLE_LINES {
            self.write_anew_if_possible();
        }
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

    fn write_anew_if_possible(&mut self) {
        if let Err(error) = self.write_anew() {
            tracing::warn!("the journal stays long: {error}");
            self.lines = 0;
        }
    }

    fn apply(&mut self, at: &str, record: Record) {
        match record {
            Record::Tag { tag, home } => (self.tag, self.home, self.tag_is_kept) = (tag, home, true),
            Record::Delivering { job, stamp, import, hot, tag } => {
                let open = OpenJob {
                    stamp,
                    import,
                    hot,
                    tag,
                    sku: job.sku.clone(),
                    delivered: false,
                    to: None,
                    job: Some(job.clone()),
                };
                self.open.insert(job.drop, open);
            }
            Record::Delivered { drop } => {
                self.open.entry(drop).and_modify(|open| open.delivered = true);
            }
            Record::Began { drop, stamp } => {
                let same = self.at_work.get(&drop).filter(|at_work| at_work.stamp == stamp);
                let (deaths, last_death) =
                    same.map_or((0, String::new()), |last| (last.deaths, last.last_death.clone()));
                self.at_work.insert(drop, AtWork { stamp, deaths, last_death, under_way: true });
            }
            Record::Ended { drop } => {
                self.at_work.remove(&drop);
            }
            Record::Died { drop, stamp, deaths } => {
                let last_death = to_the_minute(at);
                self.at_work.insert(drop, AtWork { stamp, deaths, last_death, under_way: false });
            }
            Record::Cancelled { drop } => {
                self.open.remove(&drop);
            }
            Record::Filing { drop, sku, stamp, to, job, hot } => {
                match self.open.get_mut(&drop) {
                    Some(open) if open.stamp == stamp => open.to = Some(to),
                    _ => {
                        // What needs no delivery is filed without one.
                        let delivered = job.is_some();
                        let (import, to, tag) = (None, Some(to), String::new());
                        let open = OpenJob { stamp, sku, job, import, hot, tag, delivered, to };
                        self.open.insert(drop, open);
                    }
                }
            }
            Record::Done { job, original, import, older } => {
                self.open.remove(&job.drop);
                self.forget(&job.name);
                if let Ok(sku) = job.sku.parse::<Sku>() {
                    self.by_sku.entry(sku).or_default().insert(fold(&job.name));
                }
                let result = Delivered { at: at.into(), original, job, import, older };
                self.results.insert(fold(&result.job.name), result);
            }
            Record::Learned { drop, sku, .. } => {
                self.open.remove(&drop);
                if let Ok(sku) = sku.parse::<Sku>() {
                    self.refused.remove(sku.key());
                }
            }
            Record::Rejected { drop, to, part_of, .. } => {
                self.open.remove(&drop);
                if let Some(Ok(sku)) = part_of.map(|sku| sku.parse::<Sku>()) {
                    self.refused.insert(sku.key().to_owned(), Refused { drop, to });
                }
            }
        }
    }

    fn forget(&mut self, name: &str) {
        let Some(result) = self.results.remove(&fold(name)) else { return };
        let Ok(sku) = result.job.sku.parse::<Sku>() else { return };
        if let Some(names) = self.by_sku.get_mut(&sku) {
            names.remove(&fold(name));
            if names.is_empty() {
                self.by_sku.remove(&sku);
            }
        }
    }

    /// Writes what still counts, whole, over the old journal.
    fn write_anew(&mut self) -> io::Result<()> {
        if self.results.len() > MOST_RESULTS {
            let mut by_age: Vec<_> =
                self.results.values().map(|r| (r.at.clone(), r.job.name.clone())).collect();
            by_age.sort();
            let surplus = by_age.len() - MOST_RESULTS;
            by_age.into_iter().take(surplus).for_each(|(_, name)| self.forget(&name));
        }
        let mut lines = Vec::new();
        for result in self.results.values() {
            let Delivered { job, original, import, older, .. } = result.clone();
            let record = Record::Done { job, original, import, older };
            lines.push(Line { at: result.at.clone(), record });
        }
        let at = clock::now();
        let home = identity(&self.folder);
        lines.push(Line { at: at.clone(), record: Record::Tag { tag: self.tag.clone(), home } });
        let mut push = |record| lines.push(Line { at: at.clone(), record });
        for (sku, refused) in &self.refused {
            let Refused { drop, to } = refused.clone();
            push(Record::Rejected { drop, to, code: String::new(), part_of: Some(sku.clone()) });
        }
        for (drop, at_work) in &self.at_work {
            let AtWork { stamp, deaths, under_way, .. } = *at_work;
            let drop = drop.clone();
            push(Record::Died { drop: drop.clone(), stamp, deaths });
            if under_way {
                push(Record::Began { drop, stamp });
            }
        }
        for (drop, open) in &self.open {
            if let Some(job) = &open.job {
                let (job, hot, tag) = (job.clone(), open.hot, open.tag.clone());
                push(Record::Delivering { job, stamp: open.stamp, import: open.import, hot, tag });
            }
            if open.delivered {
                push(Record::Delivered { drop: drop.clone() });
            }
            if let Some(to) = &open.to {
                let (drop, sku, job) = (drop.clone(), open.sku.clone(), open.job.clone());
                push(Record::Filing { drop, sku, stamp: open.stamp, to: to.clone(), job, hot: open.hot });
            }
        }
        let text: String = lines.iter().map(written).collect::<io::Result<_>>()?;
        // Windows replaces no file that is open.
        self.file = None;
        write_whole(&self.folder, JOURNAL, text.as_bytes())?;
        (self.lines, self.length, self.tag_is_kept) = (lines.len(), text.len() as u64, true);
        self.home = home;
        Ok(())
    }
}

impl From<Stamp> for StampRecord {
    fn from(stamp: Stamp) -> Self {
        let since = stamp.modified.and_then(|modified| modified.duration_since(UNIX_EPOCH).ok());
        let modified = since.map(|since: Duration| since.as_nanos() as u64);
        Self { size: stamp.size, modified, identity: stamp.identity }
    }
}

/// A tag that no other station has: two machines may call their state folders the same and deliver into one folder.
fn new_tag() -> String {
    // The standard library draws the keys of its hashers at random.
    format!("{:08x}", RandomState::new().hash_one(clock::now()) as u32)
}

/// The tag of stations whose journal has none, as older versions wrote it.
fn tag_of_older(folder: &Path) -> String {
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
    blake3::hash(folder.as_os_str().as_encoded_bytes()).to_hex()[..8].to_owned()
}

/// The moment without its seconds.
fn to_the_minute(at: &str) -> String {
    at.chars().take("2026-03-01T12:34".len()).collect()
}

fn checksum(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex()[..8].to_owned()
}

fn written(line: &Line) -> io::Result<String> {
    let json = serde_json::to_string(line).map_err(io::Error::other)?;
    Ok(format!("{} {json}\n", checksum(&json)))
}

/// What a line is.
enum Parsed {
    Good(Line),
    /// It is as it was written, and says what this version does not know.
    Unknown,
    Damaged,
}

fn parse(line: &[u8]) -> Parsed {
    let text = std::str::from_utf8(line).ok().and_then(|text| text.strip_suffix('\n'));
    let Some((sum, json)) = text.and_then(|text| text.split_once(' ')) else { return Parsed::Damaged };
    if sum != checksum(json) {
        return Parsed::Damaged;
    }
    serde_json::from_str(json).map_or(Parsed::Unknown, Parsed::Good)
}

/// In which order the journal tells what became of drops, in lines: clocks may be set back.
#[derive(Default)]
pub(super) struct Order {
    /// By where they lie in the rejected folder, with `/`.
    rejected: BTreeMap<String, usize>,
    /// By the result's folded name, with the key of its job and the place of its original.
    delivered: BTreeMap<String, (usize, String, String)>,
    /// By the SKU's key.
    learned: BTreeMap<String, usize>,
}

impl Order {
    /// Reads the journal in the state folder, also while a station writes it.
    pub(super) fn read(state: &Path) -> io::Result<Self> {
        let bytes = read_if_there(&state.join(JOURNAL))?.unwrap_or_default();
        let mut order = Self::default();
        for (number, line) in bytes.split_inclusive(|byte| *byte == b'\n').enumerate() {
            let Parsed::Good(Line { record, .. }) = parse(line) else { continue };
            match record {
                Record::Rejected { to, .. } => {
                    order.rejected.insert(to, number);
                }
                Record::Done { job, original, .. } if !job.drop.starts_with(ARCHIVE) => {
                    let last = order.delivered.entry(fold(&job.name)).or_default();
                    // A line that repeats the one before it says only that BeamServer was told.
                    if (&last.1, &last.2) != (&job.key, &original) {
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

    /// The line that says that this was rejected; `None` when the journal has been written anew since.
    pub(super) fn rejected(&self, to: &str) -> Option<usize> {
        self.rejected.get(to).copied()
    }

    /// The line by which a drawing of this name was done.
    pub(super) fn delivered(&self, name: &str) -> Option<usize> {
        self.delivered.get(&fold(name)).map(|(number, ..)| *number)
    }

    /// The line by which the SKU's part was done.
    pub(super) fn learned(&self, sku: &Sku) -> Option<usize> {
        self.learned.get(sku.key()).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn job(name: &str, key: &str) -> Job {
        let text = |text: &str| text.to_owned();
        Job {
            drop: text(name),
            sku: text("Can"),
            name: text(name),
            key: text(key),
            basis: text("b"),
            pattern: text("p"),
            result: text("r"),
        }
    }

    const STAMP: Stamp = Stamp { size: 7, modified: None, identity: 3 };

    /// Everything that counts, for comparison.
    fn state(
        journal: &Journal,
    ) -> (BTreeMap<String, OpenJob>, BTreeMap<String, Delivered>, BTreeMap<String, Refused>) {
        (journal.open.clone(), journal.results.clone(), journal.refused.clone())
    }

    #[test]
    fn every_cut_of_the_journal_reads_as_the_lines_before_it() {
        let folder = tempfile::tempdir().unwrap();
        let mut states = Vec::new();
        let mut journal = Journal::open(folder.path()).unwrap();
        let sku: Sku = "can".parse().unwrap();
        states.push((0, state(&journal)));
        for step in 0..6 {
            match step {
                0 => journal.delivering(&job("a.dxf", "1"), STAMP, Some(7)),
                1 => journal.delivered("a.dxf"),
                2 => journal.filing("a.dxf", "Can", STAMP, "(2)/a.dxf", None),
                3 => journal.done(&job("a.dxf", "1"), "(2)/a.dxf", Import::Done),
                4 => journal.rejected("can.glb", "bad", "can.glb", Some(&sku)),
                _ => journal.delivering(&job("b.dxf", "2"), STAMP, Some(7)),
            }
            .unwrap();
            states.push((journal.length, state(&journal)));
        }
        assert!(journal.begun("b.dxf", STAMP).is_some());
        assert!(journal.begun("b.dxf", Stamp { size: 8, ..STAMP }).is_none(), "another file of that name");
        assert_eq!(journal.results_of(&sku).len(), 1);
        drop(journal);
        let whole = fs::read(folder.path().join(JOURNAL)).unwrap();
        for cut in 0..=whole.len() {
            fs::write(folder.path().join(JOURNAL), &whole[..cut]).unwrap();
            let expected = states.iter().rev().find(|(length, _)| *length <= cut as u64).unwrap();
            let journal = Journal::open(folder.path()).unwrap();
            assert_eq!(state(&journal), expected.1, "cut after {cut} bytes");
            drop(journal);
            assert_eq!(
                state(&Journal::open(folder.path()).unwrap()),
                expected.1,
                "written anew after {cut} bytes"
            );
        }
    }

    /// Two stations may deliver into one folder, and each knows its own temporary files for ever.
    #[test]
    fn a_station_keeps_a_tag_of_its_own() {
        let [one, other] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let mut journal = Journal::open(one.path()).unwrap();
        let tag = journal.tag().to_owned();
        assert_ne!(tag, Journal::open(other.path()).unwrap().tag());
        journal.delivering(&job("a.dxf", "1"), STAMP, Some(7)).unwrap();
        assert_eq!(Journal::open(one.path()).unwrap().tag(), tag);
        journal.write_anew().unwrap();
        assert_eq!(Journal::open(one.path()).unwrap().tag(), tag);
        // A station of an older version may have been interrupted.
        let older = written(&Line { at: clock::now(), record: Record::Cancelled { drop: "a".into() } });
        fs::write(one.path().join(JOURNAL), older.unwrap()).unwrap();
        assert_eq!(Journal::open(one.path()).unwrap().tag(), tag_of_older(one.path()));
    }

    /// Two stations may deliver into one folder, and one must not sweep away what the other is about to deliver.
    #[test]
    fn a_copy_of_a_state_folder_is_another_stations() {
        let [one, other] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let mut journal = Journal::open(one.path()).unwrap();
        journal.delivering(&job("a.dxf", "1"), STAMP, Some(7)).unwrap();
        let tag = journal.tag().to_owned();
        fs::copy(one.path().join(JOURNAL), other.path().join(JOURNAL)).unwrap();
        let copy = Journal::open(other.path()).unwrap();
        assert_ne!(copy.tag(), tag);
        assert_eq!(copy.begun("a.dxf", STAMP).unwrap().tag, tag, "its own temporary file is known");
        assert_eq!(Journal::open(other.path()).unwrap().tag(), copy.tag());
    }

    #[test]
    fn ends_without_a_word_are_counted_for_what_was_under_way() {
        let folder = tempfile::tempdir().unwrap();
        let open = || Journal::open(folder.path()).unwrap();
        let deaths = |journal: &Journal, drop: &str| journal.suspects().get(drop).map(|(_, deaths)| *deaths);
        drop(open());
        let at = "2026-01-01T00:00:00Z".to_owned();
        let died = Record::Died { drop: "a.obj".into(), stamp: STAMP.into(), deaths: 1 };
        let line = written(&Line { at, record: died }).unwrap();
        let text = fs::read_to_string(folder.path().join(JOURNAL)).unwrap() + &line;
        fs::write(folder.path().join(JOURNAL), text).unwrap();
        for count in [1, 2, 2] {
            let mut journal = open();
            assert_eq!((deaths(&journal, "a.obj"), deaths(&journal, "b.obj")), (Some(count), None));
            journal.began("a.obj", STAMP).unwrap();
            journal.began("b.obj", STAMP).unwrap();
            journal.ended("b.obj").unwrap();
        }
        let mut journal = open();
        assert_eq!(deaths(&journal, "a.obj"), Some(2), "once in a minute");
        journal.began("a.obj", Stamp { size: 8, ..STAMP }).unwrap();
        assert_eq!(deaths(&journal, "a.obj"), None, "another file of that name");
        journal.ended("a.obj").unwrap();
        assert!(open().suspects().is_empty());
    }

    #[test]
    fn what_a_newer_version_wrote_is_not_thrown_away() {
        let folder = tempfile::tempdir().unwrap();
        drop(Journal::open(folder.path()).unwrap());
        let path = folder.path().join(JOURNAL);
        let json = r#"{"at":"2030-01-01T00:00:00Z","did":"dreaming"}"#;
        let text = fs::read_to_string(&path).unwrap() + &format!("{} {json}\n", checksum(json));
        fs::write(&path, &text).unwrap();
        let Err(error) = Journal::open(folder.path()) else { panic!("it was read") };
        assert!(error.to_string().contains("newer version"), "{error}");
        assert_eq!(fs::read_to_string(&path).unwrap(), text);
    }

    /// Should the folder not be flushed after the journal is replaced, nobody knows how long it is.
    #[test]
    fn a_journal_that_was_replaced_goes_on_at_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = Journal::open(folder.path()).unwrap();
        journal.done(&job("a.dxf", "1"), "a.dxf", Import::ByFolder).unwrap();
        let (length, line) = (journal.length, fs::read(folder.path().join(JOURNAL)).unwrap());
        journal.done(&job("b.dxf", "1"), "b.dxf", Import::ByFolder).unwrap();
        (journal.file, journal.length) = (None, 10 * length);
        fs::write(folder.path().join(JOURNAL), line).unwrap();
        journal.done(&job("c.dxf", "1"), "c.dxf", Import::ByFolder).unwrap();
        let journal = Journal::open(folder.path()).unwrap();
        assert_eq!(journal.results.keys().collect::<Vec<_>>(), ["a.dxf", "c.dxf"]);
    }

    #[test]
    fn a_long_journal_is_written_anew_with_what_counts() {
        let folder = tempfile::tempdir().unwrap();
        let mut journal = Journal::open(folder.path()).unwrap();
        for round in 0..IDLE_LINES + 2 {
            journal.done(&job("a.dxf", &round.to_string()), "a.dxf", Import::Done).unwrap();
        }
        journal.delivering(&job("b.dxf", "x"), STAMP, Some(7)).unwrap();
        journal.done(&job("a.dxf", "last"), "a.dxf", Import::Due).unwrap();
        let before = state(&journal);
        assert!(journal.lines < 100 && journal.length < 10_000, "{} lines", journal.lines);
        journal.delivered("b.dxf").unwrap();
        drop(journal);
        let journal = Journal::open(folder.path()).unwrap();
        assert_eq!(journal.result("a.dxf"), before.1.get("a.dxf"));
        assert!(journal.begun("b.dxf", STAMP).unwrap().delivered);
    }
}
