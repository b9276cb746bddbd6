//! Jobs that others sent to this line: takes them into the hot folder, each once, and reports how they ended. The page of
//! [`hotfolder`](crate::hotfolder) describes the protocol.

use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;

use super::Dispatcher;
use crate::config::FolderPaths;
use crate::files::{TEMPORARY_END, TEMPORARY_START, read_if_there, write_flushed};
use crate::hotfolder::api::{Corrector, Mode};
use crate::hotfolder::error::warn_if_not_noted;
use crate::hotfolder::jobs::filing;
use crate::hotfolder::line::{Answer, Arriving, Claim, Ended, JobNews, OurJobs};
use crate::hotfolder::seen::names::list_of;
use crate::hotfolder::seen::{Block, Writer, folders, sidecar_of};
use crate::hotfolder::state::{Arrival, DropId, EndedJob};
use crate::printable::on_one_line;
use crate::reason::Reason;

/// Jobs of others that a station processes at a time; while these wait for nothing, it takes no other.
const AT_A_TIME: usize = 4;
/// Jobs of others in the hot folder, with those that wait for a part or a folder.
const MOST: usize = 64;
/// Ends that are reported at a time.
const REPORTS: usize = 20;
/// The largest file with a reason, bytes.
const LARGEST_REASON: u64 = 1 << 20;

impl<C: Corrector> Dispatcher<'_, C> {
    /// Reports the contents of the station to the fleet, and does what the fleet asks for.
    pub(super) fn exchange_jobs(&mut self, ends: bool) {
        let executor = self.executor;
        let Some(fleet) = executor.corrector.fleet().filter(|_| self.mode == Mode::UntilStopped) else {
            return;
        };
        loop {
            let news = fleet.exchange(self.our_jobs(ends));
            if news.is_empty() {
                return;
            }
            for one in news {
                match one {
                    JobNews::Arrives(job) => {
                        let takes = !ends && !self.rounds.hot_is_missing;
                        let answer = if takes { self.take_in_job(&job) } else { Answer::NotNow };
                        fleet.answer(&(job.id, job.attempt), answer);
                    }
                    JobNews::IsOurs(claim) => self.is_ours(&claim),
                    JobNews::IsNotOurs(claim) => self.is_not_ours(&claim),
                    JobNews::Reported(claim) => warn_if_not_noted(executor.journal().job_reported(&claim)),
                    JobNews::Available => {
                        self.drops.free_all();
                        self.lanes.stale = true;
                    }
                }
            }
        }
    }

    fn our_jobs(&self, ends: bool) -> OurJobs {
        let (open, ended) = {
            let journal = self.executor.journal();
            (journal.arrivals(), journal.unreported_jobs(REPORTS))
        };
        let hot = &self.folders().hot;
        let is_active = |drop: &DropId| {
            self.drops.get(&hot.join(drop.file_name())).is_none_or(|drop| drop.block == Block::Free)
        };
        let active = open.iter().filter(|(drop, _)| is_active(drop)).count();
        let has_room = !ends && !self.rounds.hot_is_missing && active < AT_A_TIME && open.len() < MOST;
        let ended = ended.into_iter().filter_map(|(job, ended)| reported(self.folders(), job, &ended));
        let ended = ended.collect();
        let open = open.into_iter().map(|(_, arrival)| (arrival.claim, arrival.is_drop)).collect();
        OurJobs { has_room, open, ended }
    }

    /// Writes the files of a job under hidden names, and notes it.
    fn take_in_job(&self, job: &Arriving) -> Answer {
        let claim = (job.id.clone(), job.attempt);
        match self.keep_job(job, &claim) {
            Ok(answer) => answer,
            Err(error) => {
                let name = on_one_line(&job.name);
                tracing::warn!("the job {name} of {} cannot be taken now: {error}", on_one_line(&job.sender));
                Answer::NotNow
            }
        }
    }

    fn keep_job(&self, job: &Arriving, claim: &Claim) -> io::Result<Answer> {
        let (hot, drop) = (&self.folders().hot, DropId::Hot(job.name.clone()));
        let mut journal = self.executor.journal();
        // It ended here in an earlier attempt.
        if let Some(EndedJob { outcome, detail, .. }) = journal.ended_job(&job.id).cloned() {
            journal.job_ended(None, claim, &outcome, &detail)?;
            return Ok(Answer::Kept);
        }
        let known = journal.arrivals().into_iter().find(|(_, arrival)| arrival.claim.0 == job.id);
        if let Some((known, Arrival { is_drop: true, .. })) = known {
            journal.arriving(&known, claim, true)?;
            return Ok(Answer::Kept);
        }
        let path = hot.join(&job.name);
        let is_another = known.is_none() && journal.arrival(&drop).is_some();
        if is_another || places(&path).iter().any(|place| place.symlink_metadata().is_ok()) {
            return Ok(Answer::NotNow);
        }
        let tag = journal.tag().to_owned();
        // The others continue meanwhile.
        std::mem::drop(journal);
        // Beside a name without `@` there is no list.
        let list = job.inputs.list.as_ref().filter(|_| list_of(&path).is_some());
        let contents = [Some(&job.inputs.drawing), job.inputs.settings.as_ref(), list];
        for (file, content) in hidden(hot, &tag, &job.id).iter().zip(contents) {
            match content {
                Some(bytes) => write_flushed(file, bytes)?,
                None if file.exists() => fs::remove_file(file)?,
                None => {}
            }
        }
        self.executor.journal().arriving(&drop, claim, false)?;
        Ok(Answer::Kept)
    }

    fn is_ours(&mut self, claim: &Claim) {
        self.arrivals.confirmed.insert(claim.clone());
        self.name_jobs();
        let open = self.executor.journal().arrivals();
        for (drop, _) in open.into_iter().filter(|(_, arrival)| arrival.claim == *claim) {
            self.free(&drop);
        }
    }

    /// Looks at a drop again, whatever it waits for.
    fn free(&mut self, drop: &DropId) {
        let path = self.folders().hot.join(drop.file_name());
        if let Some(waiting) = self.drops.get_mut(&path) {
            waiting.block = Block::Free;
        }
        self.lanes.stale = true;
    }

    /// Gives the files of jobs that are this station's their names, as far as the names are free.
    pub(super) fn name_jobs(&mut self) {
        let (hot, tag) = (self.folders().hot.clone(), self.executor.journal().tag().to_owned());
        let all = self.executor.journal().arrivals();
        let is_open = |claim: &Claim| all.iter().any(|(_, arrival)| arrival.claim == *claim);
        self.arrivals.confirmed.retain(is_open);
        self.arrivals.revoked.retain(|_, claim| is_open(claim));
        for (drop, arrival) in all {
            let is_ours = arrival.is_drop || self.arrivals.confirmed.contains(&arrival.claim);
            let [drawing, settings, list] = hidden(&hot, &tag, &arrival.claim.0);
            if !is_ours || !folders::is_file(&drawing) {
                continue;
            }
            let path = hot.join(drop.file_name());
            match self.name_job(&drop, &arrival, &path, [drawing, settings, list]) {
                Ok(true) => {
                    self.arrivals.confirmed.remove(&arrival.claim);
                    if let Ok(Some(what)) = folders::look(&path) {
                        self.observe(&hot, &path, what, Writer::Renamed);
                    }
                    tracing::info!(
                        "{} arrived as job {}",
                        on_one_line(drop.file_name()),
                        short(&arrival.claim.0)
                    );
                }
                Ok(false) => {}
                Err(error) => {
                    let name = on_one_line(drop.file_name());
                    self.rounds.warn_once(format!("the job {name} cannot get its name yet: {error}"));
                }
            }
        }
    }

    /// Gives the files of a job their names, the drawing last; `false` while another file has one of them.
    fn name_job(
        &self,
        drop: &DropId,
        arrival: &Arrival,
        path: &Path,
        from: [PathBuf; 3],
    ) -> io::Result<bool> {
        let to = places(path);
        let is_blocked =
            from.iter().zip(&to).any(|(from, to)| from.exists() && to.symlink_metadata().is_ok());
        if is_blocked {
            return Ok(false);
        }
        if !arrival.is_drop {
            self.executor.journal().arrived(drop)?;
        }
        for (from, to) in from.iter().zip(&to).rev() {
            if folders::is_file(from) {
                folders::move_new(from, to)?;
            }
        }
        Ok(true)
    }

    fn is_not_ours(&mut self, claim: &Claim) {
        let (hot, tag) = (self.folders().hot.clone(), self.executor.journal().tag().to_owned());
        let open = self.executor.journal().arrivals();
        for (drop, _) in open.into_iter().filter(|(_, arrival)| arrival.claim == *claim) {
            let is_hidden = self.executor.journal().arrival(&drop).is_some_and(|arrival| !arrival.is_drop);
            if is_hidden {
                for file in hidden(&hot, &tag, &claim.0) {
                    let _ = fs::remove_file(file);
                }
                warn_if_not_noted(self.executor.journal().returned(&drop));
                continue;
            }
            self.free(&drop);
            self.arrivals.revoked.insert(drop, claim.clone());
        }
    }

    /// Why a drop is not processed: its job was put back into the queue of its line.
    pub(super) fn is_revoked(&self, drop: &DropId) -> Option<Reason> {
        let claim = self.arrivals.revoked.get(drop)?;
        let is_it = self.executor.journal().arrival(drop).is_some_and(|arrival| arrival.claim == *claim);
        is_it.then(|| {
            let what = "Somebody put this job back into its line's queue (`isomark retry --take-over`), so this station no longer processes it.";
            let remedy =
                "Nothing, if the drawing is marked elsewhere. `isomark fleet status` shows where the job is.";
            Reason::new("job-taken-over", what, remedy)
        })
    }

    /// Why a job of others waits: it may have been taken over while the station was ended or cut off.
    pub(super) fn may_be_revoked(&self, drop: &DropId) -> Option<Reason> {
        let fleet = self.executor.corrector.fleet()?;
        let arrival = self.executor.journal().arrival(drop).cloned()?;
        (!fleet.is_confirmed(&arrival.claim)).then(|| {
            let what = "The fleet has not confirmed that this job is still this station's.";
            let remedy = "Wait: it continues when the fleet answers. `isomark status` shows what is wrong with the fleet.";
            Reason::new("job-being-checked", what, remedy)
        })
    }

    /// Notes jobs whose drops somebody removed from the hot folder, and removes hidden files of jobs that were never noted.
    pub(super) fn close_removed_jobs(&mut self) {
        let (hot, tag) = (self.folders().hot.clone(), self.executor.journal().tag().to_owned());
        let identity = folders::identity(&hot);
        let all = self.executor.journal().arrivals();
        if !std::mem::replace(&mut self.arrivals.is_swept, true) {
            sweep(&hot, &tag, &all);
        }
        for (drop, Arrival { claim, is_drop, hot: its_hot }) in all {
            let is_there = folders::look(&hot.join(drop.file_name())).is_ok_and(|found| found.is_none());
            let [drawing, ..] = hidden(&hot, &tag, &claim.0);
            let is_another_folder = its_hot.is_some() && its_hot != identity;
            let is_removed = is_drop && is_there && !is_another_folder && !drawing.exists();
            if !is_removed || self.threads.are_at(&drop) {
                continue;
            }
            let mut journal = self.executor.journal();
            if !journal.has_begun(&drop) {
                warn_if_not_noted(journal.job_ended(Some(&drop), &claim, "removed", ""));
                tracing::warn!(
                    "{} was removed from the hot folder: job {} ends without a drawing",
                    on_one_line(drop.file_name()),
                    short(&claim.0)
                );
            }
        }
    }
}

/// The end of a job with its reason.
fn reported(folders: &FolderPaths, job: String, ended: &EndedJob) -> Option<Ended> {
    let (outcome, reason) = match ended.outcome.as_str() {
        "delivered" => ("delivered", None),
        "listed" => ("listed", None),
        "uncertain" => ("uncertain", Some("It may or may not have been delivered.".to_owned())),
        "removed" => ("removed", Some("It was removed from the hot folder.".to_owned())),
        "rejected" => ("rejected", Some(reason_of(folders, &ended.detail))),
        _ => return None,
    };
    Some(Ended { claim: (job, ended.attempt), outcome, reason })
}

/// The reason beside a rejected drop.
fn reason_of(folders: &FolderPaths, rejected: &str) -> String {
    let path = folders.rejected.join(rejected);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let file = path.with_file_name(filing::reason_name(&name));
    let is_small = fs::metadata(&file).is_ok_and(|metadata| metadata.len() <= LARGEST_REASON);
    let bytes = if is_small { read_if_there(&file).ok().flatten() } else { None };
    let reason = bytes.and_then(|bytes| serde_json::from_slice::<Reason>(&bytes).ok());
    reason.map_or_else(|| format!("See {rejected} in its rejected folder."), |reason| reason.what)
}

/// The paths of a drawing, its settings and its list.
fn places(drawing: &Path) -> Vec<PathBuf> {
    [Some(drawing.to_path_buf()), sidecar_of(drawing), list_of(drawing)].into_iter().flatten().collect()
}

/// The hidden files of a job: drawing, settings, list.
fn hidden(hot: &Path, tag: &str, job: &str) -> [PathBuf; 3] {
    let name = |what: &str| hot.join(format!("{TEMPORARY_START}{tag}-job-{job}-{what}{TEMPORARY_END}"));
    ["drawing", "settings", "list"].map(name)
}

/// Removes the hidden files of this station's jobs that a crash left behind before they were noted.
fn sweep(hot: &Path, tag: &str, needed: &[(DropId, Arrival)]) {
    let ours = format!("{TEMPORARY_START}{tag}-job-");
    for entry in fs::read_dir(hot).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_needed = || needed.iter().any(|(_, arrival)| name[ours.len()..].starts_with(&arrival.claim.0));
        if name.starts_with(&ours) && name.ends_with(TEMPORARY_END) && !is_needed() {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// The first digits of a job's identity.
fn short(job: &str) -> &str {
    job.get(..12).unwrap_or(job)
}
