//! The input and the possible outcomes of a job.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::filing::{Beside, Content, Original};
use crate::config::{JobSettings, Sku, Station};
use crate::formats::Pace;
use crate::hotfolder::api::{Delivery, DroppedFile, JobError, PictureKind};
use crate::hotfolder::error::guarded;
use crate::hotfolder::seen::{Gap, Stamp, delivered_as, folders, list_of, sidecar_of};
use crate::hotfolder::state::{Certainty, DropId, Import, Job};
use crate::reason::Reason;

/// One job, with everything that it needs.
pub(crate) struct Task {
    /// Where the drop is.
    pub(crate) path: PathBuf,
    pub(crate) drop: DropId,
    /// The path of a drop in the hot folder.
    pub(crate) relative: PathBuf,
    pub(crate) work: Work,
    /// The station as it was when the job was started.
    pub(crate) station: Station,
    /// The SKU's settings.
    pub(crate) settings: JobSettings,
    /// The file as it was seen last.
    pub(crate) stamp: Stamp,
    /// The file is rejected if it is incomplete now.
    pub(crate) last_chance: bool,
    /// How long it may take.
    pub(crate) pace: Pace,
    /// Why the file is rejected without processing it.
    pub(crate) doomed: Option<Reason>,
    /// Other drops that may still be written.
    pub(crate) settling: BTreeSet<PathBuf>,
    /// The drawing already waits for the import folder, so it is not corrected again until that is available.
    pub(crate) waits_for_import: bool,
    /// The result that is delivered, but whose report or original could not be filed.
    pub(crate) unfiled: Option<Unfiled>,
    /// What was read before the job paused.
    pub(crate) read: Option<Read>,
    /// The settings that were seen for the drop.
    pub(crate) sidecar: Option<PathBuf>,
    /// The list that was seen for the drop.
    pub(crate) list: Option<PathBuf>,
    /// A drawing whose name differs only in its spelling was in the hot folder at the same time.
    pub(crate) has_rival: bool,
}

impl Task {
    /// The path of the settings beside a pattern: the usual path, or the one where they were seen.
    pub(crate) fn place_of_sidecar(&self) -> Option<PathBuf> {
        let existing = sidecar_of(&self.path).filter(|path| matches!(folders::look(path), Ok(Some(_))));
        match self.work {
            Work::Correct { .. } => existing.or_else(|| self.sidecar.clone()),
            Work::CorrectAgain { .. } => existing,
            Work::Learn(_) | Work::Restore(_) | Work::Reject(_) => None,
        }
    }

    /// The path of the list of products of a dropped pattern: the usual path, or the one where it was seen.
    pub(crate) fn place_of_list(&self) -> Option<PathBuf> {
        match self.work {
            Work::Correct { .. } => {
                let lower = list_of(&self.path);
                let spellings = lower
                    .iter()
                    .flat_map(|lower| ["csv", "CSV", "Csv"].map(|ending| lower.with_extension(ending)));
                let existing = spellings.into_iter().find(|path| folders::is_file(path));
                existing.or_else(|| self.list.clone()).or(lower)
            }
            Work::CorrectAgain { .. } | Work::Learn(_) | Work::Restore(_) | Work::Reject(_) => None,
        }
    }
}

/// A drop as it was read.
pub(crate) struct Read {
    pub(crate) file: DroppedFile,
    pub(crate) stamp: Stamp,
    /// Files beside it that are filed with it.
    pub(crate) companions: Vec<Beside>,
    /// Optional files that it names and that are missing.
    pub(crate) absent: Vec<PathBuf>,
    /// A pattern's own settings: the file and its text.
    pub(crate) sidecar: Option<(PathBuf, String)>,
    /// The list of products of a pattern: its name and its bytes.
    pub(crate) list: Option<(String, Vec<u8>)>,
}

impl Read {
    pub(crate) fn original<'a>(&'a self, path: &'a Path) -> Original<'a> {
        let content = Content::Read(&self.file.bytes, self.stamp);
        Original { path, content, companions: &self.companions }
    }
}

/// The kind of a job.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Work {
    /// Fit a part.
    Learn(Sku),
    /// Correct the pattern of this name and deliver it.
    Correct { sku: Sku, name: String },
    /// Correct an archived pattern again.
    CorrectAgain { sku: Sku, name: String },
    /// Fit the archived part of a SKU again, whose surface was lost.
    Restore(Sku),
    /// Reject a drop whose name is invalid.
    Reject(Reason),
}

impl Work {
    /// The SKU that it is for.
    pub(crate) fn sku(&self) -> Option<&Sku> {
        match self {
            Self::Learn(sku)
            | Self::Restore(sku)
            | Self::Correct { sku, .. }
            | Self::CorrectAgain { sku, .. } => Some(sku),
            Self::Reject(_) => None,
        }
    }

    /// The name of the result that it makes.
    pub(crate) fn result(&self) -> Option<String> {
        match self {
            Self::Correct { name, .. } | Self::CorrectAgain { name, .. } => Some(delivered_as(name)),
            Self::Learn(_) | Self::Restore(_) | Self::Reject(_) => None,
        }
    }
}

/// A delivered drawing whose report or original could not be filed yet.
pub(crate) struct Unfiled {
    pub(crate) stamp: Stamp,
    pub(crate) job: Job,
    pub(crate) certainty: Certainty,
    /// Its report until that is written, and its pictures until they are drawn.
    pub(crate) delivery: Delivery,
    /// Size of the drawing that its pictures show, bytes.
    pub(crate) drawn_from: usize,
    /// The pictures that could be drawn.
    pub(crate) pictures: Vec<(PictureKind, Vec<u8>)>,
    pub(crate) import: Import,
    /// Whether BeamServer has already imported it.
    pub(crate) asked: bool,
    /// Whether the station delivered it before it was interrupted.
    pub(crate) is_resumed: bool,
    /// Whether it is counted as delivered already.
    pub(crate) is_counted: bool,
}

impl Unfiled {
    /// Draws the pictures.
    pub(crate) fn draw(&mut self) {
        for (kind, draw) in std::mem::take(&mut self.delivery.pictures) {
            match guarded(|| Ok(draw())) {
                Ok(picture) => self.pictures.push((kind, picture)),
                Err(error) => {
                    let (name, ending) = (&self.job.name, kind.ending());
                    tracing::warn!("{name} has no {ending}: {}", error.into_reason().what);
                }
            }
        }
    }

    /// Size of the report and the pictures, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.delivery.report.len() + self.pictures.iter().map(|(_, picture)| picture.len()).sum::<usize>()
    }
}

/// The end of a job.
pub(crate) struct End {
    pub(crate) outcome: Outcome,
    /// Files beside the drop that were filed with it, if it is done.
    pub(crate) went_along: Vec<PathBuf>,
}

/// The outcome of a job.
pub(crate) enum Outcome {
    /// A part was learned; missing companions that it names may be moved to `place` later.
    Learned { absent: Vec<PathBuf>, place: PathBuf },
    /// The surface of a SKU is known again.
    Restored,
    /// A drawing was delivered.
    Delivered,
    /// A drawing that was delivered before the station was interrupted was filed.
    Resumed,
    /// A drawing was delivered and its report is written; its pictures and its original are due when no other drop waits.
    PicturesDue(Box<Task>),
    /// The drawing was delivered before and is unchanged in the import folder; its original was filed.
    Unchanged,
    /// A drawing was filed, but may not have been delivered.
    Uncertain,
    /// A drawing was not delivered again.
    Repeated,
    /// The drawings of all rows of a list are in the hot folder.
    Listed,
    /// The drawing is in the queue of another line.
    HandedOver,
    /// The drop is in the rejected folder.
    Rejected(Reason),
    /// The file was changed or removed: check it again.
    Changed,
    /// The drop is incomplete; with `arriving`, its waiting time starts again, because the missing file is arriving.
    Incomplete { gap: Gap, reason: Reason, arriving: bool },
    /// There is no surface for the SKU.
    NoSurface(Reason),
    /// A part of the SKU arrived before the drawing was delivered.
    PartArrived,
    /// It was started as a quick job, and is a large one.
    TakesLong,
    /// The newest part of the SKU was rejected, and the older part is not used.
    PartRefused(Reason),
    /// There is no import folder.
    NoImportFolder(Reason),
    /// Environment error.
    Retry(Reason, Option<Box<Unfiled>>),
    /// The station cannot continue.
    Stop(Reason),
}

/// Why a job ended early.
pub(crate) enum EarlyEnd {
    Error(JobError),
    Outcome(Outcome),
    /// The job pauses before it draws pictures.
    PicturesDue(Box<Unfiled>),
}

impl From<JobError> for EarlyEnd {
    fn from(error: JobError) -> Self {
        Self::Error(error)
    }
}
