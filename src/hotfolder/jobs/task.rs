//! What a job needs to know, and what can become of it.

use std::collections::BTreeSet;
use std::path::PathBuf;

use crate::config::{JobSettings, Sku, Station};
use crate::formats::Pace;
use crate::hotfolder::api::{Delivery, JobError};
use crate::hotfolder::seen::{Gap, Stamp, delivered_as, folders, sidecar_of};
use crate::hotfolder::state::{Certainty, DropId, Import, Job};
use crate::reason::Reason;

/// One job, with all it needs to know.
pub(crate) struct Task {
    /// Where the drop lies.
    pub(crate) path: PathBuf,
    pub(crate) drop: DropId,
    /// The path of a drop in the hot folder.
    pub(crate) relative: PathBuf,
    pub(crate) work: Work,
    /// The station as it was when the job began.
    pub(crate) station: Station,
    /// The SKU's settings.
    pub(crate) settings: JobSettings,
    /// The file as it was seen last.
    pub(crate) stamp: Stamp,
    /// What is incomplete now stays so.
    pub(crate) last_chance: bool,
    /// How long it may take.
    pub(crate) pace: Pace,
    /// Why the file can only be rejected, whatever it is.
    pub(crate) doomed: Option<Reason>,
    /// Other drops that may still be written.
    pub(crate) settling: BTreeSet<PathBuf>,
    /// The drawing waited for the import folder before, so there is no need to work it through again until it is there.
    pub(crate) waits_for_import: bool,
    /// What was delivered while report or original could not be filed.
    pub(crate) unfiled: Option<Unfiled>,
    /// The settings that were seen beside the drop.
    pub(crate) sidecar: Option<PathBuf>,
}

impl Task {
    /// The place of the settings beside a pattern: as they were seen, or where they belong.
    pub(crate) fn place_of_sidecar(&self) -> Option<PathBuf> {
        let there = sidecar_of(&self.path).filter(|path| matches!(folders::look(path), Ok(Some(_))));
        match self.work {
            Work::Correct { .. } => there.or_else(|| self.sidecar.clone()),
            Work::CorrectAgain { .. } => there,
            Work::Learn(_) | Work::Reject(_) => None,
        }
    }
}

/// What is to be done.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Work {
    /// Fit a part.
    Learn(Sku),
    /// Correct the pattern of this name and deliver it.
    Correct { sku: Sku, name: String },
    /// Correct an archived pattern again.
    CorrectAgain { sku: Sku, name: String },
    /// Reject what is nothing.
    Reject(Reason),
}

impl Work {
    /// The SKU that it is for.
    pub(crate) fn sku(&self) -> Option<&Sku> {
        match self {
            Self::Learn(sku) | Self::Correct { sku, .. } | Self::CorrectAgain { sku, .. } => Some(sku),
            Self::Reject(_) => None,
        }
    }

    /// The name of the result that it makes.
    pub(crate) fn result(&self) -> Option<String> {
        match self {
            Self::Correct { name, .. } | Self::CorrectAgain { name, .. } => Some(delivered_as(name)),
            Self::Learn(_) | Self::Reject(_) => None,
        }
    }
}

/// A delivered drawing whose report or original could not be filed yet.
pub(crate) struct Unfiled {
    pub(crate) stamp: Stamp,
    pub(crate) job: Job,
    pub(crate) certainty: Certainty,
    pub(crate) delivery: Delivery,
    /// The preview as SVG.
    pub(crate) preview: Option<Vec<u8>>,
    pub(crate) import: Import,
    /// Whether BeamServer was asked for it, too.
    pub(crate) asked: bool,
}

/// The end of a job.
pub(crate) struct End {
    pub(crate) outcome: Outcome,
    /// Files beside the drop that, if it is done, went with it.
    pub(crate) went_along: Vec<PathBuf>,
}

/// What became of a job.
pub(crate) enum Outcome {
    /// A part is known; companions that it names and that were not there may follow to the place.
    Learned { absent: Vec<PathBuf>, place: PathBuf },
    /// A drawing was delivered, or lies in the import folder already.
    Delivered,
    /// The same, and nobody knows whether it was.
    Uncertain,
    /// A drawing was not delivered again.
    Repeated,
    /// The drop lies in the rejected folder.
    Rejected(Reason),
    /// The file changed or went: look again.
    Changed,
    /// It lacks something; `anew` when that is on its way.
    Incomplete { gap: Gap, reason: Reason, anew: bool },
    /// There is no surface for the SKU.
    NoSurface(Reason),
    /// A part of the SKU came before the drawing was delivered.
    PartCame,
    /// It was to be quick, and is not.
    TakesLong,
    /// The newest part of the SKU was rejected, and its older shape is not used.
    PartRefused(Reason),
    /// There is no import folder.
    NoImportFolder(Reason),
    /// Something around the job fails.
    Retry(Reason, Option<Box<Unfiled>>),
    /// Nothing can be done any more.
    Stop(Reason),
}

/// How a job ended before its end.
pub(crate) enum EarlyEnd {
    Error(JobError),
    Outcome(Outcome),
}

impl From<JobError> for EarlyEnd {
    fn from(error: JobError) -> Self {
        Self::Error(error)
    }
}
