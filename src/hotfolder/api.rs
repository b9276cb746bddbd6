//! The interface between a job and the rest of the program, and the results of jobs.

use crate::config::{JobSettings, Sku, Station};
use crate::formats::Pace;
use crate::formats::list::Products;
use crate::formats::mesh::PartFile;
use crate::hotfolder::fleet::Fleet;
use crate::reason::Reason;

/// Fits parts and corrects patterns: the pipeline, as the hot folder uses it.
///
/// The hot folder calls it from several threads: for one part of a SKU at a time, or for several of its drawings. A
/// panic inside rejects the job, and the next call uses the same value. So an implementation must keep no half-changed
/// state between calls.
pub trait Corrector: Sync {
    /// Whether the bytes of a part or pattern are complete, and which files it names.
    fn completeness(&self, name: &str, bytes: &[u8]) -> Completeness;

    /// Whether a surface for the SKU is available that matches the settings.
    fn knows(&self, sku: &Sku, settings: &JobSettings) -> bool;

    /// The identity of the SKU's part: it changes with the part's content, and is the same in every version of isomark.
    /// `None` for an unknown SKU. The surface itself may be missing.
    ///
    /// # Errors
    /// See [`JobError`].
    fn part_identity(&self, sku: &Sku, settings: &JobSettings) -> Result<Option<String>, JobError>;

    /// The current part of the SKU from a file, to be compared with the archive. [`PartNow::Untold`] if there is nothing to
    /// compare, as without a cache that others can change.
    ///
    /// # Errors
    /// See [`JobError`].
    fn part_now(&self, _: &Sku) -> Result<PartNow, JobError> {
        Ok(PartNow::Untold)
    }

    /// Records the moment at which the current part of the SKU became it, if that is not recorded.
    ///
    /// # Errors
    /// See [`JobError`].
    fn record_part(&self, _: &Sku) -> Result<(), JobError> {
        Ok(())
    }

    /// The hash of a part, as [`part_now`](Self::part_now) states it.
    fn part_hash(&self, part: &DroppedFile) -> String {
        blake3::hash(&part.bytes).to_hex().to_string()
    }

    /// The station's settings changed: its folders may be different now.
    fn follow(&self, station: &Station);

    /// What the station shares with others; `None` for a station that works alone.
    fn fleet(&self) -> Option<&dyn Fleet> {
        None
    }

    /// Fits an archived part whose surface was lost, and keeps the surface. It is the SKU's part since the moment `since`, ms since
    /// 1970, if that is known, and replaces one that was learned before.
    ///
    /// # Errors
    /// [`JobError::Rejected`] when another station that shares the surfaces has learned a newer part of the SKU;
    /// [`JobError::TakesLong`] for a large part at [`Pace::Quick`].
    fn restore_part(
        &self,
        sku: &Sku,
        part: &DroppedFile,
        settings: &JobSettings,
        since: Option<u64>,
        pace: Pace,
    ) -> Result<PartLearned, JobError>;

    /// Fits a dropped part, and keeps the surface.
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

    /// Corrects a pattern for a known SKU. `previous` is the drawing of the same name in the import folder.
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

    /// Whether a file shows that it is a corrected drawing.
    fn is_corrected(&self, file: &[u8]) -> bool;

    /// The products of the list with this name beside a pattern; at most `most` products are allowed. `used`
    /// serial numbers were used before it.
    ///
    /// # Errors
    /// See [`JobError`].
    fn products(
        &self,
        sku: &Sku,
        pattern: &DroppedFile,
        list: (&str, &[u8]),
        settings: &JobSettings,
        used: u64,
        most: u64,
    ) -> Result<Products, JobError>;
}

/// What a [`Corrector`] reports of the current part of a SKU.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PartNow {
    /// It does not report this.
    Untold,
    /// The SKU is unknown.
    Unknown,
    /// The part.
    Known {
        /// Its file's name.
        file: String,
        /// Its [hash](Corrector::part_hash).
        blake3: String,
        /// When it became the SKU's part, ms since 1970; a later part always has a larger number.
        learned_ms: u64,
        /// Whether that moment is recorded, and not only the time of a file.
        is_recorded: bool,
    },
}

/// A part or pattern as it was read, with the files that it needs. A pattern needs none, and is named after its SKU
/// even if it was in a folder.
pub type DroppedFile = PartFile;

/// Whether a file's bytes are complete.
#[derive(Debug, Clone, PartialEq)]
pub enum Completeness {
    /// The bytes reach the format's end mark, or are invalid in a way that more bytes cannot repair.
    Whole {
        /// The files it names.
        companions: Vec<Companion>,
    },
    /// The bytes end too early. This is the reason for the rejection if no more bytes arrive.
    CutShort(Reason),
}

/// A file that a part names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Companion {
    /// Its name; anything except a plain name in the same folder is ignored.
    pub name: String,
    /// Whether the part cannot be read without it.
    pub needed: bool,
    /// The smallest size of the complete file, bytes.
    pub bytes: u64,
}

/// The result for a part.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PartLearned {
    /// One line for the log.
    pub summary: String,
    /// A report in JSON, for the reports folder.
    pub report: Option<Vec<u8>>,
}

/// A picture that is drawn later.
pub type Sketch = Box<dyn FnOnce() -> Vec<u8> + Send>;

/// The kind of a picture of a delivered drawing, each with its file in the reports folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PictureKind {
    /// The flat preview, SVG.
    Preview,
    /// The part with the mark on it, binary glTF.
    OnPart,
    /// The report as a page for people, HTML.
    Page,
    /// The outline of the ink and its box for the pilot beam, DXF.
    Frame,
}

impl PictureKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Preview, Self::OnPart, Self::Page, Self::Frame];

    /// What follows the drawing's name in the name of the file.
    #[must_use]
    pub fn ending(self) -> &'static str {
        match self {
            Self::Preview => "preview.svg",
            Self::OnPart => "on-part.glb",
            Self::Page => "report.html",
            Self::Frame => "frame.dxf",
        }
    }
}

/// Compares the written file, read again from the disk, with the intended drawing. Returns the report, which then
/// states that the check passed.
pub type ReadBack = Box<dyn FnOnce(&[u8]) -> Result<Vec<u8>, JobError> + Send>;

/// The check of the written drawing by a second reader, before it is delivered.
pub struct Check {
    /// The work of the check, in vertices, as `[delivery] verify` measures it.
    pub vertices: usize,
    /// The check itself.
    pub read_back: ReadBack,
}

/// The result for a pattern.
#[derive(Default)]
pub struct Delivery {
    /// The corrected drawing, for the import folder.
    pub drawing: Vec<u8>,
    /// The report in JSON, for the reports folder.
    pub report: Vec<u8>,
    /// The second reader, if there is one.
    pub check: Option<Check>,
    /// The pictures for the reports folder, at most one of each kind. They are drawn after the delivery, because drawing
    /// takes longer than the correction.
    pub pictures: Vec<(PictureKind, Sketch)>,
    /// Width and height of the drawing in the field, mm, to compare with the size in the marking software.
    pub size: Option<[f64; 2]>,
    /// One line for the log.
    pub summary: String,
}

/// Why a job was not done.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum JobError {
    /// The drop cannot be processed; it is moved to the rejected folder with the reason.
    Rejected(Reason),
    /// Environment error (a folder, a disk): the drop stays and is tried again; other drops continue.
    Retry(Reason),
    /// The station cannot continue: it stops, and the drop stays.
    Stop(Reason),
    /// The job was started as a quick one and is a large one. It is started again when it blocks no small jobs.
    TakesLong,
}

impl JobError {
    pub(crate) fn into_reason(self) -> Reason {
        match self {
            Self::Rejected(reason) | Self::Retry(reason) | Self::Stop(reason) => reason,
            Self::TakesLong => Reason::new("takes-long", "The job is a large one.", "Wait until it is done."),
        }
    }
}

/// How long [`run`](crate::hotfolder::run) runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Processes the drops in the hot folder once they have settled, and returns. Incomplete files are left there.
    Once,
    /// Until the [`StopSignal`](crate::hotfolder::StopSignal) is raised; the current jobs are finished.
    UntilStopped,
}

/// A sign of life from a station to the program that started it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Pulse {
    /// It accepts drops from now on.
    Ready,
    /// It is alive.
    Alive,
    /// It is about to end.
    Stopping,
}

/// What was done, and what is left in the hot folder.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct Tally {
    /// Number of corrected drawings put into the import folder.
    pub delivered: u64,
    /// Number of parts fitted.
    pub learned: u64,
    /// Number of drawings that were delivered before and are unchanged in the import folder.
    pub unchanged: u64,
    /// Number of drawings that were already delivered, also before the station was interrupted, and were not delivered again.
    pub repeated: u64,
    /// Number of drops moved to the rejected folder.
    pub rejected: u64,
    /// Number of drawings that were filed, but may not have been delivered.
    pub uncertain: u64,
    /// Drops that wait for something else: their part, a folder, a setting.
    pub waiting: Vec<Waiting>,
    /// Drops that end too early or are still being written.
    pub incomplete: Vec<Waiting>,
}

/// A drop that is left in the hot folder.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Waiting {
    /// Its path in the hot folder, with `/`.
    pub drop: String,
    /// What it waits for.
    pub reason: Reason,
    /// The kind of obstacle.
    pub waits_for: WaitsFor,
}

/// What a drop waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum WaitsFor {
    /// The rest of its content, or a file that it names.
    Rest,
    /// Its turn among the large jobs.
    Turn,
    /// Another drop: its part, a valid part, or the pattern or part that it belongs to.
    AnotherDrop,
    /// Its environment: a folder, a disk, a server or the settings.
    Surroundings,
}
