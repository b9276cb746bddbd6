//! The stage of a job, from the steps that cannot be undone.

use super::line::{Certainty, Job, Record, StampRecord};
use crate::hotfolder::seen::folders::Identity;
use crate::hotfolder::state::drop_id::DropId;

/// A job that was started and not filed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct OpenJob {
    pub(crate) stamp: StampRecord,
    pub(crate) sku: String,
    /// The identity of the hot folder, if it was noted.
    pub(crate) hot: Option<Identity>,
    pub(crate) stage: Stage,
}

/// The last step of a job in the journal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Stage {
    /// The drawing is flushed in the import folder under a temporary name with this tag, and is about to get its final
    /// name.
    Renaming { result: Job, import: Option<Identity>, tag: String },
    /// The drawing has its final name, or may have had it.
    Delivered { result: Job, certainty: Certainty },
    /// The original is about to be moved to the archive, to a path relative to the SKU's folder. There is no result for
    /// a part, and for a pattern that an older version filed.
    Filing { result: Option<(Job, Certainty)>, to: String },
}

impl Stage {
    /// The drawing.
    pub(crate) fn result(&self) -> Option<&Job> {
        match self {
            Self::Renaming { result, .. } | Self::Delivered { result, .. } => Some(result),
            Self::Filing { result, .. } => result.as_ref().map(|(result, _)| result),
        }
    }
}

impl OpenJob {
    /// Whether the drawing was delivered, or may have been.
    pub(crate) fn is_delivered(&self) -> bool {
        match &self.stage {
            Stage::Renaming { .. } => false,
            Stage::Delivered { .. } => true,
            Stage::Filing { result, .. } => result.is_some(),
        }
    }

    /// Notes that the drawing got its final name.
    pub(super) fn delivered(&mut self, now: Certainty) {
        match &mut self.stage {
            Stage::Renaming { result, .. } | Stage::Delivered { result, .. } => {
                self.stage = Stage::Delivered { result: result.clone(), certainty: now };
            }
            // Older versions noted the delivery after the start of the filing.
            Stage::Filing { result: Some((_, certainty)), .. } => *certainty = now,
            Stage::Filing { result: None, .. } => {}
        }
    }

    /// Notes that the original is about to be moved to `to`. Only a delivered drawing is filed, so it was delivered
    /// even if the journal lacks that line.
    pub(super) fn filing(&mut self, now: Option<(Job, Certainty)>, to: String) {
        let noted = now.as_ref().map(|(_, certainty)| *certainty).unwrap_or_default();
        let result = match &self.stage {
            Stage::Renaming { result, .. } => Some((result.clone(), noted)),
            Stage::Delivered { result, certainty } => Some((result.clone(), noted.max(*certainty))),
            Stage::Filing { result, .. } => result.clone().or(now),
        };
        self.stage = Stage::Filing { result, to };
    }

    /// The records that restore this job.
    pub(super) fn records(&self, drop: &DropId) -> Vec<Record> {
        let (stamp, hot) = (self.stamp, self.hot);
        let delivering = |job: &Job, import, tag: &str| {
            let (job, tag) = (job.clone(), tag.to_owned());
            Record::Delivering { job, stamp, import, hot, tag }
        };
        match &self.stage {
            Stage::Renaming { result, import, tag } => vec![delivering(result, *import, tag)],
            Stage::Delivered { result, certainty } => {
                let delivered = Record::Delivered { drop: drop.clone(), certainty: *certainty };
                vec![delivering(result, None, ""), delivered]
            }
            Stage::Filing { result, to } => {
                let (drop, sku, to) = (drop.clone(), self.sku.clone(), to.clone());
                let certainty = result.as_ref().map(|(_, certainty)| *certainty).unwrap_or_default();
                let job = result.as_ref().map(|(job, _)| job.clone());
                vec![Record::Filing { drop, sku, stamp, to, job, certainty, hot }]
            }
        }
    }
}
