//! Chooses the next job: jobs with the same result in their order, and large jobs never on all threads.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use super::Dispatcher;
use super::lanes::{LARGE, is_large};
use super::threads::Running;
use crate::config::{JobSettings, Sku};
use crate::formats::Pace;
use crate::formats::pattern::is_picture;
use crate::hotfolder::api::Corrector;
use crate::hotfolder::jobs::{Outcome, Recorrection, Searched, Task, Work, filing};
use crate::hotfolder::seen::{Block, Found, Gap, Meaning, Obstacle, Stamp, Verdict, delivered_as, folders};
use crate::hotfolder::state::DropId;
use crate::reason::Reason;

/// A drop is rejected after the station has crashed this often while processing it, as counted by the journal. After
/// the first crash, the drop is processed alone.
const MAX_DEATHS: u32 = 5;

impl<C: Corrector> Dispatcher<'_, C> {
    /// Gives a job to every free thread.
    pub(super) fn hand_out(&mut self) {
        let now = self.now();
        self.lanes.refresh(&self.drops, &self.threads, now, &self.times());
        while self.threads.have_room(self.now()) {
            let now = self.now();
            if self.threads.is_overdue(now) {
                self.threads.resume(now);
                continue;
            }
            let Some(path) = self.lanes.next(&self.drops, &self.threads) else { break };
            self.begin(&path);
        }
        while self.threads.are_idle() {
            let Some(path) = self.lanes.next_suspect() else { break };
            self.begin(&path);
        }
        while self.threads.have_room(self.now()) {
            let large_too = self.threads.have_room_for_large();
            let may_make = |sku: &Sku, result: &str| self.threads.may_make(sku, result);
            let next = self.reprocessing.next(self.now(), may_make, large_too);
            let Some((again, takes_long)) = next else { break };
            self.correct_again(again, takes_long, large_too);
        }
        self.search_parts();
        self.continue_paused();
        let others_wait = !self.lanes.are_empty() && self.threads.may_pause();
        self.executor.others_wait.store(others_wait, Ordering::Relaxed);
    }

    /// Gives the jobs that pause to the threads that are free.
    pub(super) fn continue_paused(&mut self) {
        while self.threads.have_room(self.now()) && self.threads.resume(self.now()) {}
    }

    /// Starts the job of a drop that is ready, or records what the drop waits for.
    fn begin(&mut self, path: &Path) {
        let (now, times) = (self.now(), self.times());
        let Some(drop) = self.drops.get(path) else { return };
        let (last_chance, doomed) = match drop.settle.verdict(now, &times) {
            Verdict::Wait(_) => return,
            Verdict::Read => (false, None),
            Verdict::GiveUp(Gap::Companion) => (true, None),
            Verdict::GiveUp(Gap::Content) => (true, Some(drop.lacks.clone().unwrap_or_else(cut_short))),
        };
        let work = match drop.meaning.clone() {
            Ok(Meaning::Companion) => return self.companion(path),
            // A texture that arrived after its part was processed.
            Ok(_) if is_picture(&drop.relative.to_string_lossy()) && self.late.is_companion(path) => {
                return self.companion(path);
            }
            Ok(Meaning::Part(sku)) => Work::Learn(sku),
            Ok(Meaning::Pattern { sku, name }) => Work::Correct { sku, name },
            Err(reason) => Work::Reject(reason),
        };
        if let Work::Correct { sku, .. } = &work
            && self.drops.has_part(sku)
        {
            let sku = sku.clone();
            return self.wait_for_part(path, &sku);
        }
        if let (Work::Correct { .. }, Some((misnamed, right))) = (&work, self.drops.misnamed_of(path)) {
            return self.retry_later(path, Obstacle::Other, waits_for_right_name(&misnamed, &right));
        }
        let (id, relative, stamp) = (DropId::hot(&drop.relative), drop.relative.clone(), drop.settle.stamp());
        let (block, large) = (drop.block, is_large(drop));
        let mut deaths = self.lanes.deaths(drop);
        // A delivered drawing is only filed, which cannot crash because of its content and delivers nothing twice.
        let is_delivered = self.executor.is_delivered(&id, stamp);
        let revoked = self.is_revoked(&id).filter(|_| !is_delivered);
        if is_delivered {
            deaths = 0;
        } else if revoked.is_none()
            && let Some(reason) = self.may_be_revoked(&id)
        {
            return self.retry_later(path, Obstacle::Other, reason);
        }
        let doomed = doomed.or(revoked).or_else(|| (deaths >= MAX_DEATHS).then(|| ends_isomark(deaths)));
        let waits_for_import = matches!(block, Block::Until { obstacle: Obstacle::NoImportFolder, .. });
        let attempt = Attempt { last_chance, doomed, waits_for_import, alone: deaths > 0, large };
        self.start(path, (id, relative), work, stamp, attempt);
    }

    fn start(
        &mut self,
        path: &Path,
        (drop, relative): (DropId, PathBuf),
        work: Work,
        stamp: Stamp,
        attempt: Attempt,
    ) {
        let settings = match work.sku().map(|sku| self.job_settings(sku)) {
            None => JobSettings::default(),
            Some(Ok(settings)) => settings,
            Some(Err((obstacle, reason))) => {
                if let Work::CorrectAgain { sku, name } = &work {
                    return self.postpone_recorrection(sku, &delivered_as(name), reason);
                }
                if let Work::Restore(sku) = &work {
                    return self.reprocessing.cannot_read(sku);
                }
                return self.retry_later(path, obstacle, reason);
            }
        };
        let task = Task {
            path: path.into(),
            drop,
            relative,
            work,
            station: self.settings.station().clone(),
            settings,
            stamp,
            last_chance: attempt.last_chance,
            // A job that runs alone delays no other.
            pace: if attempt.large || attempt.alone { Pace::Any } else { Pace::Quick },
            doomed: attempt.doomed,
            settling: self.drops.settling_beside(path, self.now(), &self.times()),
            waits_for_import: attempt.waits_for_import,
            unfiled: self.unfiled.remove(path),
            read: None,
            sidecar: self.drops.sidecar_of(path),
            list: self.drops.list_of(path),
            has_rival: self.drops.get(path).is_some_and(|drop| drop.has_rival),
        };
        if let Work::Correct { sku, .. } | Work::CorrectAgain { sku, .. } = &task.work {
            if self.drops.has_part(sku) { self.executor.part_arrived(sku) } else { self.executor.begins(sku) }
        }
        let mut running = Running::of(&task, self.now());
        (running.large, running.alone) = (attempt.large, attempt.alone);
        running.companions_arrived = self.late.companions_arrived;
        running.settings_changes = self.settings_changes;
        self.threads.begin(task, running);
    }

    /// Fits an archived part again, if delivered drawings cannot be checked without it.
    fn search_parts(&mut self) {
        // The archive is the place to look.
        if self.rounds.missing.is_some() || !self.threads.have_room(self.now()) {
            return;
        }
        let is_free = |sku: &Sku| !self.drops.has_part(sku) && !self.threads.are_busy_with(sku);
        let large_too = self.threads.have_room_for_large();
        let next = self.reprocessing.next_search(self.now(), is_free, large_too);
        let Some((sku, takes_long)) = next else { return };
        let folders = self.folders();
        let part = filing::current_part(folders, &sku);
        let found = part.as_deref().map(folders::look);
        let (Some(part), Some(Ok(Some(Found::File(stamp))))) = (part, found) else {
            return self.reprocessing.searched(&sku, Searched::InVain);
        };
        let drop = DropId::archived(&sku, &filing::in_archive(folders, &sku, &part));
        let crashes = self.executor.journal().suspects().get(&drop).map_or(0, |(_, deaths)| *deaths);
        if crashes >= MAX_DEATHS {
            return self.reprocessing.searched(&sku, Searched::InVain);
        }
        let large = takes_long || stamp.size >= LARGE;
        if large && !large_too {
            return self.reprocessing.searched(&sku, Searched::TakesLong);
        }
        let attempt =
            Attempt { last_chance: true, doomed: None, waits_for_import: false, alone: false, large };
        self.start(&part, (drop, PathBuf::new()), Work::Restore(sku), stamp, attempt);
    }

    fn correct_again(&mut self, again: Recorrection, takes_long: bool, large_too: bool) {
        // The part is processed first, and may change the drawing.
        if self.drops.has_part(&again.sku) {
            return self.finished_recorrection(&again.sku, &again.name, Outcome::PartArrived);
        }
        let look = folders::look(&again.original);
        let Ok(Some(Found::File(stamp))) = look else {
            tracing::warn!("{} cannot be corrected again: its original is not in the archive", again.name);
            return self.reprocessing.forget(&again.name);
        };
        let large = takes_long || stamp.size >= LARGE;
        if large && !large_too {
            return self.reprocessing.takes_long(&again.name);
        }
        let drop = again.drop();
        // The archived original has the pattern's name.
        let name = again.original.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let work = Work::CorrectAgain { sku: again.sku, name };
        let attempt =
            Attempt { last_chance: true, doomed: None, waits_for_import: false, alone: false, large };
        self.start(&again.original, (drop, PathBuf::new()), work, stamp, attempt);
    }
}

/// What is known about a drop before it is read.
struct Attempt {
    last_chance: bool,
    doomed: Option<Reason>,
    waits_for_import: bool,
    alone: bool,
    large: bool,
}

fn ends_isomark(deaths: u32) -> Reason {
    let what = "isomark crashed each time it processed this file, possibly out of memory.";
    let remedy = "Export it with fewer triangles or lines, or add memory to the computer.";
    Reason::new("ends-isomark", what, remedy).with_number("crashes", f64::from(deaths), "", None)
}

/// Why a drawing waits beside settings or a list with a wrong ending: without them, it would be marked elsewhere, or otherwise.
pub(super) fn waits_for_right_name(misnamed: &Path, right: &Path) -> Reason {
    let [misnamed, right] =
        [misnamed, right].map(|path| path.file_name().unwrap_or_default().to_string_lossy().into_owned());
    let what =
        format!("{misnamed} is not read: its name must be {right}. The drawing of this name waits for it.");
    let remedy = format!(
        "Rename it to {right}, or remove it if the drawing needs no such file. Windows hides the ending .txt: turn on “File name \
         extensions” in the Explorer."
    );
    Reason::new("name-misspelt", what, remedy).in_file(misnamed)
}

fn cut_short() -> Reason {
    Reason::new("cut-short", "The file ends too early.", "Export or copy it again.")
}
