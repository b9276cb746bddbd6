//! How far a job came whose steps cannot be taken back.

use super::line::{Certainty, Job, Record, StampRecord};
use crate::hotfolder::seen::folders::Identity;
use crate::hotfolder::state::drop_id::DropId;

/// A job that was begun and not filed away.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct OpenJob {
    pub(crate) stamp: StampRecord,
    pub(crate) sku: String,
    /// Which folder was the hot folder, where that was noted.
    pub(crate) hot: Option<Identity>,
    pub(crate) stage: Stage,
}

/// The last step of a job that the journal knows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Stage {
    /// The drawing lies flushed in the import folder under a temporary name with this tag, and is about to get its own.
    Renaming { result: Job, import: Option<Identity>, tag: String },
    /// It bears its own name, or may have borne it.
    Delivered { result: Job, certainty: Certainty },
    /// The original is about to go to the archive, to a path relative to the SKU's folder. A part has no result, nor has
    /// a pattern that an older version filed.
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
    /// Whether the drawing lies, or may have lain, in the import folder.
    pub(crate) fn is_delivered(&self) -> bool {
        match &self.stage {
            Stage::Renaming { .. } => false,
            Stage::Delivered { .. } => true,
            Stage::Filing { result, .. } => result.is_some(),
        }
    }

    /// The drawing got its name.
    pub(super) fn delivered(&mut self, now: Certainty) {
        match &mut self.stage {
            Stage::Renaming { result, .. } | Stage::Delivered { result, .. } => {
                self.stage = Stage::Delivered { result: result.clone(), certainty: now };
            }
            // Older versions noted it after they had begun to file.
            Stage::Filing { result: Some((_, certainty)), .. } => *certainty = now,
            Stage::Filing { result: None, .. } => {}
        }
    }

    /// The original is about to go to `to`. Nothing is filed that was not delivered, also where the journal lacks that line.
    pub(super) fn filing(&mut self, now: Option<(Job, Certainty)>, to: String) {
        let noted = now.as_ref().map(|(_, certainty)| *certainty).unwrap_or_default();
        let result = match &self.stage {
            Stage::Renaming { result, .. } => Some((result.clone(), noted)),
            Stage::Delivered { result, certainty } => Some((result.clone(), noted.max(*certainty))),
            Stage::Filing { result, .. } => result.clone().or(now),
        };
        self.stage = Stage::Filing { result, to };
    }

    /// The lines that say so.
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
