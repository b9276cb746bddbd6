//! What a job needs from the rest of the program, and what becomes of it.

use crate::config::{JobSettings, Sku, Station};
use crate::formats::Pace;
use crate::formats::mesh::PartFile;
use crate::reason::Reason;

/// Fits parts and corrects patterns: the pipeline, as the hot folder sees it.
///
/// The hot folder calls it from several threads, for one part of a SKU at a time or for several of its drawings. A panic
/// inside rejects the job and the next call follows on the same value, so an implementation keeps no half-changed state
/// between calls.
pub trait Corrector: Sync {
    /// Whether the bytes of a part or pattern are whole, and which files it names.
    fn completeness(&self, name: &str, bytes: &[u8]) -> Completeness;

    /// Whether a surface for the SKU is at hand that fits the settings.
    fn knows(&self, sku: &Sku, settings: &JobSettings) -> bool;

    /// What the SKU's part is known by: it changes with the part's content, and stays the same in every version of
    /// isomark. `None` for an unknown SKU. The surface itself may be gone.
    ///
    /// # Errors
    /// See [`JobError`].
    fn part_identity(&self, sku: &Sku, settings: &JobSettings) -> Result<Option<String>, JobError>;

    /// The station's settings changed: other folders may count now.
    fn follow(&self, station: &Station);

    /// Fits an archived part whose surface got lost, and keeps the surface.
    ///
    /// # Errors
    /// [`JobError::Rejected`] when another station that shares the surfaces learned another part of the SKU since;
    /// [`JobError::TakesLong`].
    fn restore_part(
        &self,
        sku: &Sku,
        part: &DroppedFile,
        settings: &JobSettings,
        pace: Pace,
    ) -> Result<PartLearned, JobError>;

    /// Fits a part that was dropped, and keeps the surface.
    ///
    /// # Errors
    /// See [`JobError`].
    fn learn_part(
        &self,
        sku: &Sku,
        part: &DroppedFile,
        settings: &JobSettings,
        pace: Pace,
    ) -> Result<PartLearned, JobError>;

    /// Corrects a pattern for a known SKU. `previous` is the drawing of the same name that lies in the import folder.
    /// The same inputs give the same drawing, byte for byte.
    ///
    /// # Errors
    /// See [`JobError`].
    fn correct(
        &self,
        sku: &Sku,
        pattern: &DroppedFile,
        previous: Option<&[u8]>,
        settings: &JobSettings,
        pace: Pace,
    ) -> Result<Delivery, JobError>;
}

/// A part or pattern as it was read, with the files that it needs; a pattern needs none, and is named after its SKU even
/// if it lay in a folder.
pub type DroppedFile = PartFile;

/// Whether a file's bytes are whole.
#[derive(Debug, Clone, PartialEq)]
pub enum Completeness {
    /// The bytes reach to the format's end mark, or are wrong in a way that no further byte will change.
    Whole {
        /// The files it names.
        companions: Vec<Companion>,
    },
    /// The bytes end too early; the reason is given when nothing more comes.
    CutShort(Reason),
}

/// A file that a part names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Companion {
    /// Its name; anything but a plain name in the same folder is left alone.
    pub name: String,
    /// Whether the part cannot be read without it.
    pub needed: bool,
    /// The size it must have reached at least, bytes.
    pub bytes: u64,
}

/// What came of a part.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PartLearned {
    /// One line for the log.
    pub summary: String,
    /// A report in JSON, for the reports folder.
    pub report: Option<Vec<u8>>,
}

/// A picture that is still to be drawn.
pub type Sketch = Box<dyn FnOnce() -> Vec<u8> + Send>;

/// Holds the written file, as it was read again from the disk, against what was meant. Returns the report, which then
/// states it.
pub type ReadBack = Box<dyn FnOnce(&[u8]) -> Result<Vec<u8>, JobError> + Send>;

/// How a second reader can check the written drawing before it is delivered.
pub struct Check {
    /// What that takes, in vertices, as `[delivery] verify` measures it.
    pub vertices: usize,
    /// The check itself.
    pub read_back: ReadBack,
}

/// What came of a pattern.
#[derive(Default)]
pub struct Delivery {
    /// The corrected drawing, for the import folder.
    pub drawing: Vec<u8>,
    /// The report in JSON, for the reports folder.
    pub report: Vec<u8>,
    /// The second reader, if there is one.
    pub check: Option<Check>,
    /// The preview as SVG, for the reports folder; it is drawn when the drawing lies in the import folder, because that
    /// takes longer than the correction.
    pub preview: Option<Sketch>,
    /// Width and height of the drawing in the field, mm, for marking software that is asked for them.
    pub size: Option<[f64; 2]>,
    /// One line for the log.
    pub summary: String,
}

/// Why a job was not done.
#[derive(Debug, Clone, PartialEq)]
pub enum JobError {
    /// This drop cannot be done; it goes to the rejected folder with the reason.
    Rejected(Reason),
    /// Something around the job fails (a folder, a disk); the drop stays, is tried again, and the others go on.
    Retry(Reason),
    /// Nothing can be done any more; the station stops and the drop stays.
    Stop(Reason),
    /// The job is more than a moment's work and was to be quick; it is begun again where that stands in nobody's way.
    TakesLong,
}

impl JobError {
    pub(crate) fn into_reason(self) -> Reason {
        match self {
            Self::Rejected(reason) | Self::Retry(reason) | Self::Stop(reason) => reason,
            Self::TakesLong => {
                Reason::new("takes-long", "The job takes longer than a moment.", "Wait until it is done.")
            }
        }
    }
}

/// How long [`run`](crate::hotfolder::run) works.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Does what lies in the hot folder, once it stands still, and returns. Incomplete files are left there.
    Once,
    /// Until the [`StopSignal`](crate::hotfolder::StopSignal) is raised; the job under way is finished.
    UntilStopped,
}

/// What a station tells whoever started it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pulse {
    /// It takes drops from now on.
    Ready,
    /// It is alive.
    Alive,
    /// It is about to end.
    Stopping,
}

/// What was done, and what still lies in the hot folder.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tally {
    /// Number of corrected drawings put into the import folder.
    pub delivered: u64,
    /// Number of parts fitted.
    pub learned: u64,
    /// Number of drawings that were delivered before and not again.
    pub repeated: u64,
    /// Number of drops moved to the rejected folder.
    pub rejected: u64,
    /// Number of drawings that were filed, and of which nobody knows whether they were delivered.
    pub uncertain: u64,
    /// Drops that wait for something else: their part, a folder, a setting.
    pub waiting: Vec<Waiting>,
    /// Drops that end too early or are still being written.
    pub incomplete: Vec<Waiting>,
}

/// A drop that still lies in the hot folder.
#[derive(Debug, Clone, PartialEq)]
pub struct Waiting {
    /// Its path in the hot folder, with `/`.
    pub drop: String,
    /// What it waits for.
    pub reason: Reason,
    /// What kind of thing that is.
    pub waits_for: WaitsFor,
}

/// What a drop waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WaitsFor {
    /// Its own end, or a file that it names.
    Rest,
    /// Its turn among the large ones.
    Turn,
    /// Another drop: its part, a better part, or what it belongs to.
    AnotherDrop,
    /// Something around the station that fails: a folder, a disk, a server, the settings.
    Surroundings,
}
