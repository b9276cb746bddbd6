//! What a job needs to know, and what can become of it.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::super::folders;
use super::super::intake::{self, Read};
use super::super::job::{Delivery, JobError};
use super::super::journal::{Import, Job};
use super::super::settle::{Gap, Stamp};
use crate::config::{JobSettings, Sku, Station};
use crate::formats::Pace;
use crate::reason::Reason;

/// One job, with all it needs to know.
pub(in crate::hotfolder) struct Task {
    /// Where the drop lies.
    pub(in crate::hotfolder) path: PathBuf,
    /// Its path in the hot folder; for an archived original its place in the archive.
    pub(in crate::hotfolder) relative: PathBuf,
    pub(in crate::hotfolder) work: Work,
    /// The station as it was when the job began.
    pub(in crate::hotfolder) station: Station,
    /// The SKU's settings.
    pub(in crate::hotfolder) settings: JobSettings,
    /// The file as it was seen last.
    pub(in crate::hotfolder) stamp: Stamp,
    /// What is incomplete now stays so.
    pub(in crate::hotfolder) last_chance: bool,
    /// How long it may take.
    pub(in crate::hotfolder) pace: Pace,
    /// Why it can only be rejected.
    pub(in crate::hotfolder) doomed: Option<Reason>,
    /// Other drops that may still be written.
    pub(in crate::hotfolder) settling: BTreeSet<PathBuf>,
    /// The drawing waited for the import folder before, so there is no need to work it through again until it is there.
    pub(in crate::hotfolder) waits_for_import: bool,
    /// What was delivered while report or original could not be filed.
    pub(in crate::hotfolder) kept: Option<Kept>,
    /// The settings that were seen beside the drop.
    pub(in crate::hotfolder) sidecar: Option<PathBuf>,
}

impl Task {
    /// The place of the settings beside a pattern: as they were seen, or where they belong.
    pub(super) fn place_of_sidecar(&self) -> Option<PathBuf> {
        let there = intake::sidecar_of(&self.path).filter(|path| matches!(folders::look(path), Ok(Some(_))));
        match self.work {
            Work::Correct { .. } => there.or_else(|| self.sidecar.clone()),
            Work::CorrectAgain { .. } => there,
            Work::Learn(_) | Work::Nothing => None,
        }
    }
}

/// What is to be done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::hotfolder) enum Work {
    /// Fit a part.
    Learn(Sku),
    /// Correct the pattern of this name and deliver it.
    Correct { sku: Sku, name: String },
    /// Correct an archived pattern again.
    CorrectAgain { sku: Sku, name: String },
    /// Reject what is nothing.
    Nothing,
}

/// A delivered drawing whose report or original could not be filed yet.
pub(in crate::hotfolder) struct Kept {
    pub(in crate::hotfolder) stamp: Stamp,
    pub(super) job: Job,
    pub(super) delivery: Delivery,
    /// The preview as SVG.
    pub(super) preview: Option<Vec<u8>>,
    pub(super) import: Import,
    /// Whether BeamServer was asked for it, too.
    pub(super) asked: bool,
}

/// The end of a job.
pub(in crate::hotfolder) struct End {
    pub(in crate::hotfolder) outcome: Outcome,
    /// Files beside the drop that, if it is done, went with it.
    pub(in crate::hotfolder) went_along: Vec<PathBuf>,
}

/// What became of a job.
pub(in crate::hotfolder) enum Outcome {
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
    /// Something around the job fails.
    Retry(Reason, Option<Box<Kept>>),
    /// Nothing can be done any more.
    Stop(Reason),
}

/// How a job ended before its end.
pub(in crate::hotfolder) enum Broken {
    Error(JobError),
    Outcome(Outcome),
}

impl From<JobError> for Broken {
    fn from(error: JobError) -> Self {
        Self::Error(error)
    }
}

/// A drawing on its way to its place.
pub(super) struct Ready<'a> {
    pub(super) task: &'a Task,
    pub(super) sku: &'a Sku,
    /// The pattern's name, after which report and original are named.
    pub(super) pattern: &'a str,
    /// The name of the result in the import folder.
    pub(super) name: &'a str,
    pub(super) read: &'a Read,
}
