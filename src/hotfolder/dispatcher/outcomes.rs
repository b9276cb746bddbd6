//! Handles the outcome of a job, and records what a drop waits for.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::Dispatcher;
use super::hand_out::waits_for_right_name;
use super::threads::Running;
use crate::config::Sku;
use crate::hotfolder::api::{Corrector, Mode};
use crate::hotfolder::jobs::{Outcome, Searched, Task, Unfiled, Work, filing};
use crate::hotfolder::seen::{
    Block, Gap, Moment, Obstacle, Writer, delivered_as, folders, is_list, is_sidecar, other_form, sidecar_of,
    well_named,
};
use crate::hotfolder::state::status::FinishedAs;
use crate::hotfolder::state::{Certainty, with_slashes};
use crate::reason::Reason;

/// The pause after the first environment error of a job; it doubles with each further error.
const FIRST_PAUSE: Duration = Duration::from_millis(250);
/// The longest pause between two attempts, so that the station soon notices when a folder is available again.
const LONGEST_PAUSE: Duration = Duration::from_secs(10);
/// The largest number of delivered drawings whose reports and pictures stay in memory until they can be filed.
const MAX_UNFILED: usize = 200;
/// The largest size of these reports and pictures, bytes.
const MAX_UNFILED_BYTES: usize = 64 << 20;

impl<C: Corrector> Dispatcher<'_, C> {
    /// Handles the end of a job.
    pub(super) fn finished(&mut self, path: &Path, outcome: Outcome, went_along: &[PathBuf]) {
        if let Outcome::PicturesDue(mut task) = outcome {
            self.count_delivery(&mut task);
            return self.threads.pause(*task, self.now());
        }
        let Some(running) = self.threads.finished(path) else { return };
        self.lanes.survived(&running.drop);
        went_along.iter().for_each(|companion| self.look_again(companion));
        let same = self.drops.get(path).is_some_and(|drop| drop.settle.stamp() == running.stamp);
        if let Work::Restore(sku) = &running.work {
            return self.finished_search(sku, outcome);
        }
        if let Some(sku) = running.sku() {
            self.reprocessing.check_if_unknown(sku);
        }
        if let Work::CorrectAgain { sku, name } = &running.work {
            let result = match outcome {
                Outcome::Delivered => Some(FinishedAs::DeliveredAgain),
                Outcome::Uncertain => Some(FinishedAs::Uncertain),
                _ => None,
            };
            if let Some(result) = result {
                self.status.finished(&running.drop, &running.work, result);
            }
            return self.finished_recorrection(sku, &delivered_as(name), outcome);
        }
        // Every other outcome may unblock other drops.
        self.lanes.stale |= !matches!(
            outcome,
            Outcome::Delivered
                | Outcome::Unchanged
                | Outcome::Resumed
                | Outcome::Uncertain
                | Outcome::Repeated
        );
        match outcome {
            Outcome::Learned { absent, place } => {
                let until = self.now() + self.times().incomplete;
                self.late.expect_companions(absent, &place, until);
                self.tally.learned += 1;
                self.status.finished(&running.drop, &running.work, FinishedAs::Learned);
                self.done(path);
                if let Some(sku) = running.sku() {
                    self.drops.release(sku);
                    self.reprocessing.check(sku.clone());
                }
            }
            Outcome::Delivered | Outcome::Uncertain => {
                let is_certain = matches!(outcome, Outcome::Delivered);
                if !running.is_counted {
                    self.tally.delivered += u64::from(is_certain);
                    let result = if is_certain { FinishedAs::Delivered } else { FinishedAs::Uncertain };
                    self.status.finished(&running.drop, &running.work, result);
                }
                self.drawing_is_done(path, &running, went_along);
            }
            // It pauses, see above.
            Outcome::PicturesDue(_) | Outcome::Restored => {}
            Outcome::Unchanged => {
                self.tally.unchanged += 1;
                self.status.finished(&running.drop, &running.work, FinishedAs::Repeated);
                self.drawing_is_done(path, &running, went_along);
            }
            Outcome::Resumed => {
                self.tally.repeated += 1;
                self.status.finished(&running.drop, &running.work, FinishedAs::Repeated);
                self.drawing_is_done(path, &running, went_along);
            }
            Outcome::Repeated => {
                self.tally.repeated += 1;
                self.status.finished(&running.drop, &running.work, FinishedAs::Repeated);
                self.done(path);
            }
            Outcome::HandedOver => {
                self.status.finished(&running.drop, &running.work, FinishedAs::HandedOver);
                self.done(path);
            }
            Outcome::Listed => {
                self.done(path);
                // With `--once`, the station ends when no drop is left.
                (self.rounds.next, self.rounds.rests_until) = (Moment::ZERO, Moment::ZERO);
            }
            Outcome::Rejected(reason) => {
                self.tally.rejected += 1;
                self.status.rejected(&running.drop.to_string(), &reason);
                self.done(path);
            }
            Outcome::Changed => self.look_again(path),
            Outcome::Incomplete { gap, reason, arriving } if same => {
                self.found_incomplete(path, &running, gap, reason, arriving);
            }
            Outcome::Incomplete { .. } => {}
            Outcome::NoSurface(reason) => self.wait(path, Block::UnknownSku, reason),
            Outcome::PartArrived => {
                if let Some(sku) = running.sku() {
                    self.wait_for_part(path, sku);
                }
            }
            Outcome::PartRefused(reason) => self.retry_later(path, Obstacle::RefusedPart, reason),
            Outcome::NoImportFolder(reason) => self.retry_later(path, Obstacle::NoImportFolder, reason),
            Outcome::Retry(reason, unfiled) => {
                // Without this record, the job is done again from the stage that the journal contains.
                let kept: usize = self.unfiled.values().map(|unfiled| unfiled.bytes()).sum();
                if let Some(unfiled) = unfiled.filter(|unfiled| {
                    self.unfiled.len() < MAX_UNFILED && kept + unfiled.bytes() <= MAX_UNFILED_BYTES
                }) {
                    self.unfiled.insert(path.into(), *unfiled);
                }
                self.retry_later(path, Obstacle::Other, reason);
            }
            Outcome::TakesLong => {
                if let Some(drop) = self.drops.get_mut(path).filter(|_| same) {
                    drop.found_large();
                }
            }
            Outcome::Stop(reason) => self.stopped = Some(reason),
        }
    }

    /// Counts a drawing as soon as it is in the import folder: its pictures may be due for as long as other drops wait, and the
    /// station may be interrupted before they are drawn.
    fn count_delivery(&mut self, task: &mut Task) {
        let is_new = |unfiled: &&mut Unfiled| {
            unfiled.certainty == Certainty::Certain && !unfiled.is_resumed && !unfiled.is_counted
        };
        if let Some(unfiled) = task.unfiled.as_mut().filter(is_new) {
            unfiled.is_counted = true;
            self.tally.delivered += 1;
            self.status.finished(&task.drop, &task.work, FinishedAs::Delivered);
        }
    }

    /// Handles a drawing that was delivered, or may have been.
    fn drawing_is_done(&mut self, path: &Path, running: &Running, went_along: &[PathBuf]) {
        if let Work::Correct { sku, name } = &running.work {
            self.reprocessing.forget(&delivered_as(name));
            // While the job was running, no check could find the drawing outdated.
            if running.was_delivered || running.settings_changes != self.settings_changes {
                self.reprocessing.check(sku.clone());
            }
            // If the settings were filed with the drawing and a file of the same name exists, that is a new one.
            let is_late = |path: &PathBuf| !went_along.contains(path) || folders::is_file(path);
            let has_settings = went_along.iter().any(|path| is_sidecar(path));
            let hot = self.folders().hot.clone();
            let other = path.strip_prefix(&hot).ok().and_then(other_form).map(|other| hot.join(other));
            // What the drawing was delivered with in another form is not missing.
            let other = other.filter(|_| !has_settings).as_deref().and_then(sidecar_of);
            for sidecar in sidecar_of(path).into_iter().chain(other).filter(is_late) {
                self.late.expect_sidecar(&sidecar, self.now());
                // It may have arrived while the job was ending.
                if self.drops.get(&sidecar).is_some_and(|drop| drop.block == Block::Unclaimed) {
                    self.companion(&sidecar);
                }
            }
        }
        self.done(path);
    }

    /// Records that a drop is incomplete; with `arriving`, its waiting time starts again.
    fn found_incomplete(&mut self, path: &Path, running: &Running, gap: Gap, reason: Reason, arriving: bool) {
        let now = self.now();
        let Some(drop) = self.drops.get_mut(path) else { return };
        if arriving {
            drop.settle.wait_anew(now);
        }
        let what = reason.what.clone();
        if drop.found_incomplete(gap, reason) {
            tracing::info!("{} waits: {}", running.drop, continued(&what));
        }
        if running.companions_arrived != self.late.companions_arrived {
            // The missing file may have arrived while this one was read.
            drop.settle.companion_came();
        }
    }

    pub(super) fn finished_recorrection(&mut self, sku: &Sku, name: &str, outcome: Outcome) {
        match outcome {
            Outcome::Delivered => {
                self.tally.delivered += 1;
                self.reprocessing.forget(name);
            }
            Outcome::Unchanged => {
                self.tally.unchanged += 1;
                self.reprocessing.forget(name);
            }
            Outcome::Resumed => {
                self.tally.repeated += 1;
                self.reprocessing.forget(name);
            }
            Outcome::Repeated => self.reprocessing.forget(name),
            // The journal lists it as uncertain.
            Outcome::Uncertain => self.reprocessing.forget(name),
            // The request is answered; from now on the drawing is checked like any other.
            Outcome::Rejected(_) if self.reprocessing.is_uncertain(name) => {
                self.reprocessing.forget(name);
                self.reprocessing.check(sku.clone());
            }
            // It stays marked as outdated: changed settings may resolve the problem.
            Outcome::Rejected(_) => self.reprocessing.postpone(name, self.now(), true),
            Outcome::Retry(reason, _)
            | Outcome::NoImportFolder(reason)
            | Outcome::PartRefused(reason)
            | Outcome::NoSurface(reason) => {
                self.postpone_recorrection(sku, name, reason);
            }
            Outcome::Stop(reason) => self.stopped = Some(reason),
            // Somebody asked for this delivery, and nothing else would try it again.
            Outcome::PartArrived
            | Outcome::Changed
            | Outcome::Incomplete { .. }
            | Outcome::Learned { .. }
                if self.reprocessing.is_uncertain(name) =>
            {
                let what = "A part arrived, or the archived original changed, while isomark corrected it.";
                let remedy = "Wait: isomark tries again. With `--once`, run `isomark retry` again.";
                self.postpone_recorrection(sku, name, Reason::new("correction-overtaken", what, remedy));
            }
            // The part may be rejected; then the drawing is as outdated as before.
            Outcome::PartArrived => {
                self.reprocessing.forget(name);
                self.reprocessing.check(sku.clone());
            }
            Outcome::TakesLong => self.reprocessing.takes_long(name),
            Outcome::Learned { .. }
            | Outcome::Restored
            | Outcome::PicturesDue(_)
            | Outcome::Listed
            | Outcome::HandedOver
            | Outcome::Changed
            | Outcome::Incomplete { .. } => {
                self.reprocessing.forget(name);
            }
        }
    }

    /// Handles the end of a job that fitted an archived part again.
    fn finished_search(&mut self, sku: &Sku, outcome: Outcome) {
        // What waits for the part or its threads can continue.
        self.lanes.stale = true;
        let end = match outcome {
            Outcome::Restored => {
                self.drops.release(sku);
                Searched::Found
            }
            Outcome::TakesLong => Searched::TakesLong,
            Outcome::Retry(reason, _) if self.mode == Mode::UntilStopped => {
                self.rounds
                    .warn_once(format!("the part of {sku} cannot be fitted again yet: {}", reason.what));
                Searched::Postponed(self.now() + LONGEST_PAUSE)
            }
            Outcome::Stop(reason) => {
                self.stopped = Some(reason);
                Searched::InVain
            }
            _ => Searched::InVain,
        };
        self.reprocessing.searched(sku, end);
    }

    /// Records that an archived original cannot be corrected again now.
    pub(super) fn postpone_recorrection(&mut self, sku: &Sku, name: &str, reason: Reason) {
        let (now, once) = (self.now(), self.mode == Mode::Once);
        self.reprocessing.postpone(name, now + LONGEST_PAUSE, once);
        if self.reprocessing.is_news(name, &reason) {
            tracing::warn!("cannot correct {name} of {sku} again yet: {}", reason.what);
        }
    }

    /// Handles a companion that has settled: the drop that it belongs to can continue, or continued without it before.
    pub(super) fn companion(&mut self, path: &Path) {
        if let Some(place) = self.late.take_companion(path)
            && filing::follow(self.folders(), &self.executor.parking, path, &place).is_ok()
        {
            self.drops.forget(path);
            return;
        }
        self.late.companions_arrived += 1;
        self.drops.companion_arrived(path);
        self.lanes.stale = true;
        let is_late = self.late.take_sidecar(path);
        let now = self.now();
        if let Some(drop) = self.drops.get_mut(path) {
            let reason = if is_late {
                let what = "The settings arrived too late: their drawing was delivered without them.";
                let remedy = "Drop the drawing again. The settings file stays in the hot folder until then. Next time drop the \
                              settings first.";
                Reason::new("sidecar-late", what, remedy)
            } else if let Some(right) = well_named(path) {
                waits_for_right_name(path, &right)
            } else if is_list(path) {
                let what = "The list waits for the drawing of the same name.";
                let stem = drop.relative.with_extension("");
                let remedy = format!(
                    "Drop {}.dxf (or .svg), or remove the list. If this is a scan, give it a name without @.",
                    with_slashes(&stem)
                );
                Reason::new("waits-for-pattern", what, remedy)
            } else if is_sidecar(path) {
                let what = "The settings wait for the drawing of the same name.";
                Reason::new(
                    "waits-for-pattern",
                    what,
                    "Drop the drawing (again, if it was delivered already), or remove this file.",
                )
            } else {
                let what = "The file waits for the part that uses it.";
                Reason::new("waits-for-part", what, "Drop the part, or remove the file if no part needs it.")
            };
            let message = format!("{}: {}", with_slashes(&drop.relative), reason.on_one_line());
            match drop.wait(Block::Unclaimed, reason) {
                false => {}
                true if is_late => tracing::warn!("{message}"),
                true => self.late.log_if_unclaimed(path, message, now),
            }
        }
    }

    /// Logs the companions that nothing has taken along until this moment.
    pub(super) fn log_unclaimed(&mut self, now: Moment) {
        for (path, words) in self.late.take_unclaimed(now) {
            let waits = self.drops.get(&path).is_some_and(|drop| drop.block == Block::Unclaimed);
            if waits && !self.drops.has_pattern_of(&path) {
                tracing::info!("{words}");
            }
        }
    }

    /// Forgets a drop that is done. If a file of its name exists now, that is a new drop.
    pub(super) fn done(&mut self, path: &Path) {
        self.drops.forget(path);
        self.look_again(path);
    }

    /// Observes the file as it is now, or forgets the drop if the file does not exist.
    pub(super) fn look_again(&mut self, path: &Path) {
        let hot = self.folders().hot.clone();
        match folders::look(path) {
            Ok(Some(what)) => {
                self.observe(&hot, path, what, Writer::Unknown);
            }
            _ => self.drops.forget(path),
        }
    }

    pub(super) fn wait(&mut self, path: &Path, block: Block, reason: Reason) {
        let Some(drop) = self.drops.get_mut(path) else { return };
        let message = format!("{}: {}", with_slashes(&drop.relative), reason.on_one_line());
        if drop.wait(block, reason) {
            tracing::info!("{message}");
        }
    }

    /// Makes a drawing wait for the part of its SKU in the hot folder, with what that part waits for.
    pub(super) fn wait_for_part(&mut self, path: &Path, sku: &Sku) {
        let why = self.drops.obstacle_of_part(sku);
        self.wait(path, Block::PartUnderWay, part_under_way(sku, why));
    }

    pub(super) fn retry_later(&mut self, path: &Path, obstacle: Obstacle, reason: Reason) {
        let now = self.now();
        let once = self.mode == Mode::Once;
        let Some(drop) = self.drops.get_mut(path) else { return };
        let pause = match drop.block {
            Block::Until { pause, .. } => (pause * 2).min(LONGEST_PAUSE),
            _ => FIRST_PAUSE,
        };
        let moment = if once { Moment::MAX } else { now + pause };
        let message = format!("{} waits: {}", with_slashes(&drop.relative), reason.on_one_line());
        // Settings that are being saved are complete after a moment, so nobody has to act.
        if drop.wait(Block::Until { moment, pause, obstacle }, reason)
            && obstacle != Obstacle::SettingsBeingSaved
        {
            tracing::warn!("{message}");
            for (waiting, sku) in self.drops.waiting_for_part(path) {
                self.wait_for_part(&waiting, &sku);
            }
        }
    }
}

/// A sentence behind a colon: without its capital, unless its first word is a name, and without its full stop.
fn continued(sentence: &str) -> String {
    let text = sentence.trim_end_matches('.');
    let first_word = text.split(' ').next().unwrap_or_default();
    let is_word = !first_word.contains('.') && first_word.chars().skip(1).all(char::is_lowercase);
    match text.chars().next().filter(|_| is_word) {
        Some(first) => first.to_lowercase().chain(text.chars().skip(1)).collect(),
        None => text.to_owned(),
    }
}

/// The reason of a drawing that waits for the part of its SKU; with `why`, the part itself waits.
fn part_under_way(sku: &Sku, why: Option<(String, Reason)>) -> Reason {
    let what = format!("The drawing waits until the part of SKU `{sku}` is complete and fitted");
    match why {
        Some((part, why)) => {
            let what = format!("{what}. The part {part} waits, too: {}.", continued(&why.what));
            Reason { what, code: "waits-for-part".into(), ..why }
        }
        None => {
            let remedy = "`isomark status` shows whether the part itself waits, and for what. If its copy stopped, copy it again.";
            Reason::new("waits-for-part", format!("{what}."), remedy)
        }
    }
}
