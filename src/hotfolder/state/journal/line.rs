//! The lines of the journal: writing and reading.

use std::io;
use std::time::{Duration, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use crate::hotfolder::seen::folders::Identity;
use crate::hotfolder::seen::settle::Stamp;
use crate::hotfolder::state::drop_id::DropId;

/// The file in the state folder.
pub(super) const JOURNAL: &str = "journal.log";
/// The status beside it, which a station writes soon after its first start.
pub(super) const STATUS: &str = "status.json";
/// A copy of a journal with damaged lines, until somebody removes it.
pub(super) const DAMAGED: &str = "journal.damaged.log";

/// The inputs and the result of one drawing.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Job {
    /// Its original.
    pub(crate) drop: DropId,
    /// The SKU's name.
    pub(crate) sku: String,
    /// The name of the result in the import folder.
    pub(crate) name: String,
    /// Hash of everything that the result depends on: name, pattern, surface, settings and version.
    pub(crate) key: String,
    /// Hash of the inputs that may change without a new drop: surface and settings.
    pub(crate) basis: String,
    /// Hash of the pattern.
    pub(crate) pattern: String,
    /// Hash of the corrected drawing.
    pub(crate) result: String,
}

/// Whether a drawing in the import folder is imported into BeamConstruct.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Import {
    /// Not needed: an importer takes drawings from the folder.
    #[default]
    ByFolder,
    /// It is still to be imported by BeamServer.
    Due,
    /// It was imported.
    Done,
}

/// Whether it is certain that a drawing got its final name in the import folder.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Certainty {
    /// It is certain.
    #[default]
    Certain,
    /// The station was interrupted, and the folder contains neither the drawing nor its temporary file.
    Uncertain,
}

impl Certainty {
    fn is_certain(&self) -> bool {
        *self == Self::Certain
    }
}

/// A [`Stamp`] in the form in which it is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct StampRecord {
    size: u64,
    /// Nanoseconds since 1970.
    modified: Option<u64>,
    identity: u64,
}

impl StampRecord {
    /// Whether it is the stamp of this file. Some shares give their files new numbers with each mount. So where the
    /// time is known, size and time of the last write, to the nanosecond, decide.
    pub(crate) fn is_of(&self, stamp: Stamp) -> bool {
        self.is_same(Self::from(stamp))
    }

    /// Whether both are stamps of one file, by the same rule.
    pub(super) fn is_same(&self, now: Self) -> bool {
        *self == now || (self.modified.is_some() && (self.size, self.modified) == (now.size, now.modified))
    }
}

/// A list of products, from the moment when its serial numbers are reserved until all its drawings are in the hot folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Listing {
    /// The drawing's.
    pub(super) stamp: StampRecord,
    /// The SKU's name.
    pub(crate) sku: String,
    /// Hash of the list and the settings beside it.
    pub(crate) list: String,
    /// The first number of the SKU's series.
    pub(super) start: u64,
    /// The distance of two numbers.
    pub(super) step: u64,
    /// How many serial numbers were used before.
    pub(crate) used: u64,
    /// Number of rows; each has a serial number.
    pub(crate) rows: u64,
    /// The date of all rows.
    pub(crate) date: String,
    /// How many drawings were about to get their names in the hot folder, or have them.
    #[serde(default)]
    pub(crate) named: u64,
}

/// The serial numbers of a SKU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Series {
    /// The first number.
    pub(crate) start: u64,
    /// The distance of two numbers.
    pub(crate) step: u64,
    /// How many are used.
    pub(crate) used: u64,
}

impl Series {
    /// The last number that is used; `None` if there is none.
    pub(crate) fn last(&self) -> Option<u64> {
        Some(self.start.saturating_add(self.used.checked_sub(1)?.saturating_mul(self.step)))
    }
}

/// A step that cannot be undone.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "did", rename_all = "kebab-case")]
pub(super) enum Record {
    /// The tag in the names of this station's temporary files.
    Tag {
        tag: String,
        /// The identity of the state folder: a copy of the folder belongs to another station.
        #[serde(default)]
        home: Option<Identity>,
    },
    /// The drawing is in the import folder under its temporary name and is about to be renamed.
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
    /// The drawing has its final name.
    Delivered {
        drop: DropId,
        #[serde(default, skip_serializing_if = "Certainty::is_certain")]
        certainty: Certainty,
    },
    /// A thread started to process this drop.
    Began { drop: DropId, stamp: StampRecord },
    /// The thread ended its work on this drop.
    Ended { drop: DropId },
    /// The number of crashes of the station while a thread processed this drop. Crashes within a minute of each other
    /// and of one start of the machine are counted once.
    Died {
        drop: DropId,
        stamp: StampRecord,
        deaths: u32,
        /// The start of the machine from which `uptime` is counted.
        #[serde(default, skip_serializing_if = "String::is_empty")]
        boot: String,
        /// How long the machine had been running when this was counted, s.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        uptime: Option<u64>,
    },
    /// The drawing could not be renamed; the drop waits.
    Cancelled { drop: DropId },
    /// The original is about to be moved to the archive.
    Filing {
        drop: DropId,
        sku: String,
        stamp: StampRecord,
        to: String,
        /// The drawing; older versions left it out for a drawing that was delivered before.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        job: Option<Job>,
        /// Whether the delivery of that drawing is certain.
        #[serde(default, skip_serializing_if = "Certainty::is_certain")]
        certainty: Certainty,
        #[serde(default)]
        hot: Option<Identity>,
    },
    /// A drawing is done, with everything that later jobs need to know about it.
    Done {
        #[serde(flatten)]
        job: Job,
        original: String,
        #[serde(default)]
        import: Import,
        #[serde(default, skip_serializing_if = "String::is_empty")]
        older: String,
        #[serde(default, skip_serializing_if = "Certainty::is_certain")]
        certainty: Certainty,
        /// The job of another sender that ends with this line.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        ends: Option<String>,
    },
    /// Serial numbers are reserved for the rows of a list.
    Listing {
        drop: DropId,
        #[serde(flatten)]
        listing: Listing,
    },
    /// The first drawings of a list are in the hot folder under hidden names and are about to be renamed.
    Naming { drop: DropId, named: u64 },
    /// All drawings of a list are in the hot folder.
    Listed { drop: DropId },
    /// How many serial numbers of a SKU are used.
    Serials { sku: String, start: u64, step: u64, used: u64 },
    /// The drop is about to be offered to another line.
    Offering { drop: DropId, stamp: StampRecord, line: String, job: String },
    /// The drop is in the queue of another line, and filed.
    HandedOver { drop: DropId, line: String, job: String },
    /// The files of a job of another sender are in the hot folder under hidden names; with `is_drop`, under their names.
    Arriving {
        drop: DropId,
        job: String,
        attempt: i32,
        #[serde(default)]
        is_drop: bool,
        #[serde(default)]
        hot: Option<Identity>,
    },
    /// The job is this station's, and its files are about to get their names.
    Arrived { drop: DropId },
    /// The job is not this station's.
    Returned { drop: DropId },
    /// A job of another sender has ended.
    JobEnded {
        #[serde(default, skip_serializing_if = "Option::is_none")]
        drop: Option<DropId>,
        job: String,
        attempt: i32,
        outcome: String,
        #[serde(default, skip_serializing_if = "String::is_empty")]
        detail: String,
        #[serde(default)]
        is_reported: bool,
    },
    /// The fleet knows the end of a job.
    JobReported { job: String, attempt: i32 },
    /// A part is done.
    Learned { drop: DropId, sku: String, original: String },
    /// A drop was rejected; `part_of` names the SKU of a part.
    Rejected {
        drop: DropId,
        code: String,
        to: String,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        part_of: Option<String>,
    },
}

/// A step and its time.
#[derive(Serialize, Deserialize)]
pub(super) struct Line {
    pub(super) at: String,
    #[serde(flatten)]
    pub(super) record: Record,
}

impl From<Stamp> for StampRecord {
    fn from(stamp: Stamp) -> Self {
        let since = stamp.modified.and_then(|modified| modified.duration_since(UNIX_EPOCH).ok());
        let modified = since.map(|since: Duration| since.as_nanos() as u64);
        Self { size: stamp.size, modified, identity: stamp.identity }
    }
}

/// The checksum at the start of a line.
pub(crate) fn checksum(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex()[..8].to_owned()
}

/// A line in the form in which it is written to the file.
pub(super) fn written(line: &Line) -> io::Result<String> {
    let json = serde_json::to_string(line).map_err(io::Error::other)?;
    Ok(format!("{} {json}\n", checksum(&json)))
}

/// The result of reading a line.
pub(super) enum Parsed {
    Good(Line),
    /// It is undamaged, but this version cannot read its content.
    Unknown,
    Damaged,
}

/// Reads a line of the file.
pub(super) fn parse(line: &[u8]) -> Parsed {
    let text = std::str::from_utf8(line).ok().and_then(|text| text.strip_suffix('\n'));
    let Some((sum, json)) = text.and_then(|text| text.split_once(' ')) else { return Parsed::Damaged };
    if sum != checksum(json) {
        return Parsed::Damaged;
    }
    serde_json::from_str(json).map_or(Parsed::Unknown, Parsed::Good)
}
