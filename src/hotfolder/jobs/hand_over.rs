//! Hands a drawing over to another line: the drop leaves the hot folder only after the job is in the queue of that line.

use std::sync::Arc;

use super::Read;
use super::{EarlyEnd, Executor, Outcome, Task};
use crate::config::Sku;
use crate::hotfolder::api::{Corrector, JobError};
use crate::hotfolder::error::{folder_trouble, warn_if_not_noted};
use crate::hotfolder::line::{Inputs, LineJob, Offered, Origin, check_name};
use crate::printable::on_one_line;
use crate::reason::Reason;

impl<C: Corrector> Executor<'_, C> {
    /// The line that a dropped drawing is for; `None` for this station. A drop that was offered stays with its line, also if the rules
    /// changed since, and one that was begun here stays here.
    pub(super) fn line_for(&self, task: &Task, sku: &Sku, name: &str) -> Option<String> {
        let journal = self.journal();
        if let Some(offer) = journal.offer(&task.drop, task.stamp) {
            return Some(offer.line.clone());
        }
        let line = task.station.line_for(sku, name)?;
        let is_begun = journal.arrival(&task.drop).is_some_and(|arrival| arrival.is_drop)
            || journal.begun(&task.drop, task.stamp).is_some()
            || journal.listing(&task.drop, task.stamp).is_some();
        (!is_begun).then(|| line.to_owned())
    }

    pub(super) fn hand_over(
        &self,
        task: &Task,
        sku: &Sku,
        name: &str,
        line: &str,
        slot: &mut Option<Read>,
    ) -> Result<Outcome, EarlyEnd> {
        let Some(fleet) = self.corrector.fleet() else { return Err(JobError::Retry(no_fleet(line)).into()) };
        let noted = self.journal().offer(&task.drop, task.stamp).map(|offer| offer.job.clone());
        if noted.is_none() {
            check_name(name).map_err(JobError::Rejected)?;
            if let Some(reason) = fleet.cannot_offer() {
                return Err(JobError::Retry(waits(line, &reason)).into());
            }
        }
        let read = &*slot.insert(self.read(task, Some(name))?);
        let inputs = Inputs {
            drawing: read.file.bytes.clone(),
            settings: read.sidecar.as_ref().map(|(_, text)| text.clone().into_bytes()),
            list: read.list.as_ref().map(|(_, bytes)| bytes.clone()),
        };
        if let Some(reason) = inputs.too_large().filter(|_| noted.is_none()) {
            return Err(JobError::Rejected(reason).into());
        }
        let drop = task.drop.to_string();
        let origin = Origin { sender: fleet.own_name(), drop: &drop, at: task.stamp.modified };
        let mut job = LineJob::new(line, name, origin, inputs);
        match noted {
            Some(id) => job.id = id,
            None => self.journal().offering(&task.drop, task.stamp, line, &job.id).map_err(folder_trouble)?,
        }
        let job = Arc::new(job);
        let shown = on_one_line(line);
        match fleet.offer(&job) {
            Offered::Kept { is_same, is_served } => {
                if !is_same {
                    tracing::warn!(
                        "{drop} changed after it was sent: {shown} has it as it was before. Drop it again if the change matters"
                    );
                }
                if !is_served {
                    tracing::warn!("no station of the fleet takes jobs for {shown} yet; {name} waits there");
                }
            }
            Offered::NotNow(reason) => return Err(JobError::Retry(waits(line, &reason)).into()),
            Offered::Refused(reason) => return Err(JobError::Rejected(reason).into()),
        }
        self.archive(task, sku, name, read, None)?;
        warn_if_not_noted(self.journal().handed_over(&task.drop, line, &job.id));
        tracing::info!("{name} is handed over to {shown}, as job {}", &job.id[..12]);
        Ok(Outcome::HandedOver)
    }
}

fn no_fleet(line: &str) -> Reason {
    let what =
        format!("The drawing is for the line {}, and this run takes no part in a fleet.", on_one_line(line));
    let remedy = "Start the station without `--once`, in a program with the feature `fleet`.";
    Reason::new("line-away", what, remedy)
}

fn waits(line: &str, cause: &Reason) -> Reason {
    let what = format!("The drawing is for the line {}, and waits here. {}", on_one_line(line), cause.what);
    Reason::new("line-away", what, cause.remedy.clone())
}
