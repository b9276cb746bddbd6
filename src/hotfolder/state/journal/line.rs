//! The lines of the journal, as they are written and read.

use std::io;
use std::time::{Duration, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use crate::hotfolder::seen::folders::Identity;
use crate::hotfolder::seen::settle::Stamp;
use crate::hotfolder::state::drop_id::DropId;

/// The file in the state folder.
pub(super) const JOURNAL: &str = "journal.log";

/// What one drawing was made of and became.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Job {
    /// Its original.
    pub(crate) drop: DropId,
    /// The SKU's name.
    pub(crate) sku: String,
    /// The name of the result in the import folder.
    pub(crate) name: String,
    /// Hash of everything the result depends on: name, pattern, surface, settings and version.
    pub(crate) key: String,
    /// Hash of what may change without a new drop: surface and settings.
    pub(crate) basis: String,
    /// Hash of the pattern.
    pub(crate) pattern: String,
    /// Hash of the corrected drawing.
    pub(crate) result: String,
}

/// Whether BeamConstruct holds a drawing that lies in the import folder.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Import {
    /// Nobody was to see to it: an importer takes drawings from the folder.
    #[default]
    ByFolder,
    /// BeamServer has still to be told.
    Due,
    /// It was imported.
    Done,
}

/// Whether a drawing is known to have got its name in the import folder.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Certainty {
    /// It did.
    #[default]
    Certain,
    /// The station was interrupted, and the folder holds neither the drawing nor its temporary file.
    Uncertain,
}

impl Certainty {
    fn is_certain(&self) -> bool {
        *self == Self::Certain
    }
}

/// A [`Stamp`] as it is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct StampRecord {
    size: u64,
    /// Nanoseconds since 1970.
    modified: Option<u64>,
    identity: u64,
}

impl StampRecord {
    /// Whether it is the stamp of this file. Some shares number their files anew with each mount: size and time of the
    /// last write, to the nanosecond, decide where the system tells the time.
    pub(crate) fn is_of(&self, stamp: Stamp) -> bool {
        self.is_same(Self::from(stamp))
    }

    /// Whether both are stamps of one file, by the same rule.
    pub(super) fn is_same(&self, now: Self) -> bool {
        *self == now || (self.modified.is_some() && (self.size, self.modified) == (now.size, now.modified))
    }
}

/// A step that cannot be taken back.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "did", rename_all = "kebab-case")]
pub(super) enum Record {
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
    Delivered {
        drop: DropId,
        #[serde(default, skip_serializing_if = "Certainty::is_certain")]
        certainty: Certainty,
    },
    /// A thread is at this drop.
    Began { drop: DropId, stamp: StampRecord },
    /// It is not any more.
    Ended { drop: DropId },
    /// The station ended as often while a thread was at this drop; ends within less than a minute of one start of the machine
    /// are one.
    Died {
        drop: DropId,
        stamp: StampRecord,
        deaths: u32,
        /// Which start of the machine it was that `uptime` counts from.
        #[serde(default, skip_serializing_if = "String::is_empty")]
        boot: String,
        /// How long the machine had been running when this was counted, s.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        uptime: Option<u64>,
    },
    /// It could not be renamed; the drop waits.
    Cancelled { drop: DropId },
    /// The original is about to go to the archive.
    Filing {
        drop: DropId,
        sku: String,
        stamp: StampRecord,
        to: String,
        /// The drawing; of one that was delivered before, older versions may have noted none.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        job: Option<Job>,
        /// Whether that drawing is known to have been delivered.
        #[serde(default, skip_serializing_if = "Certainty::is_certain")]
        certainty: Certainty,
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
        #[serde(default, skip_serializing_if = "Certainty::is_certain")]
        certainty: Certainty,
    },
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

/// A step and when it was taken.
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

/// What a line begins with.
pub(super) fn checksum(text: &str) -> String {
    blake3::hash(text.as_bytes()).to_hex()[..8].to_owned()
}

/// The line as it stands in the file.
pub(super) fn written(line: &Line) -> io::Result<String> {
    let json = serde_json::to_string(line).map_err(io::Error::other)?;
    Ok(format!("{} {json}\n", checksum(&json)))
}

/// What a line is.
pub(super) enum Parsed {
    Good(Line),
    /// It is as it was written, and says what this version does not know.
    Unknown,
    Damaged,
}

/// What a line of the file is.
pub(super) fn parse(line: &[u8]) -> Parsed {
    let text = std::str::from_utf8(line).ok().and_then(|text| text.strip_suffix('\n'));
    let Some((sum, json)) = text.and_then(|text| text.split_once(' ')) else { return Parsed::Damaged };
    if sum != checksum(json) {
        return Parsed::Damaged;
    }
    serde_json::from_str(json).map_or(Parsed::Unknown, Parsed::Good)
}
