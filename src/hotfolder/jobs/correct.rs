//! Corrects a drawing, step by step: prepare, resume, repeat, make, deliver, and then [`Executor::finish`].

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::Read;
use super::delivery::{self, How};
use super::finish::{Ready, is_missing_for_server};
use super::resume::{Inputs, Original, Resume};
use super::surfaces::Surface;
use super::{EarlyEnd, Executor, Outcome, Task, Unfiled, filing, recovery};
use crate::config::{DeliveryKind, FolderPaths, JobSettings, Repeat, Sku, fold, near, nearest_first};
use crate::formats::mesh::MeshFormat;
use crate::hotfolder::api::{Corrector, Delivery, JobError};
use crate::hotfolder::beamserver;
use crate::hotfolder::error::{folder_trouble, guarded};
use crate::hotfolder::seen::{Found, Meaning, delivered_as, folders, meaning, sidecar_of};
use crate::hotfolder::state::{Certainty, Delivered, DropId, Import, Job};
use crate::reason::Reason;

/// Largest number of SKUs that are suggested for an unknown one.
const NEAR_NAMES: usize = 3;

/// A drawing that is being corrected.
struct Correction<'a> {
    ready: Ready<'a>,
    settings: JobSettings,
    result: Job,
    /// The newest result with the same name.
    last: Option<Delivered>,
    started: Instant,
}

/// What an interrupted job on the same file has done.
struct Before {
    result: Job,
    certainty: Certainty,
    import: Import,
    /// Whether the report can be made now.
    report: bool,
}

impl<C: Corrector> Executor<'_, C> {
    pub(crate) fn correct(
        &self,
        task: &Task,
        sku: &Sku,
        pattern: &str,
        unfiled: Option<Unfiled>,
        slot: &mut Option<Read>,
    ) -> Result<Outcome, EarlyEnd> {
        let started = Instant::now();
        let name = delivered_as(pattern);
        // The first spelling of the name is kept: on a case-sensitive disk, another spelling would be a second drawing.
        let name = &*self.journal().result(&name).map_or(name, |last| last.job.name);
        let is_valid = |unfiled: &Unfiled| {
            unfiled.stamp == task.stamp && (unfiled.asked || !is_missing_for_server(&task.station, name))
        };
        if let Some(unfiled) = unfiled.filter(is_valid) {
            let read = match slot {
                Some(read) => &*read,
                None => &*slot.insert(self.read(task, Some(pattern))?),
            };
            return self.complete(&Ready { task, sku, pattern, name, read }, unfiled);
        }
        self.expect_surface(task, sku, name)?;
        let read = &*slot.insert(self.read(task, Some(pattern))?);
        let mut drawing = self.prepare(Ready { task, sku, pattern, name, read }, started)?;
        let before = match self.resume(&drawing)? {
            Some(before) if !before.report => {
                return self.complete(&drawing.ready, before.without_report(task));
            }
            before => before,
        };
        if before.is_none() && self.repeat(&mut drawing)? {
            return Ok(Outcome::Repeated);
        }
        let (mut made, mut previous) = self.make(&mut drawing, before.is_some())?;
        if before.is_none() && self.stays_as_delivered(&drawing)? {
            return Ok(Outcome::Repeated);
        }
        if before.is_none() {
            // Somebody may have put a file there while the drawing was corrected.
            let now = filing::delivered_before(&task.station.folders, name).map_err(folder_trouble)?;
            if now != previous {
                now.as_deref().map_or(Ok(()), |now| self.may_replace(&drawing, now))?;
                previous = now;
            }
        }
        // The older version would be marked, although its designer has replaced it.
        if before.is_none() && !task.drop.is_archived() && is_replaced(task) {
            tracing::info!("{} was replaced while it was corrected, and is read again", task.drop);
            return Ok(Outcome::Changed);
        }
        let how = match &before {
            Some(before) => How::BeforeTheCrash(before.certainty),
            None => delivery::deliver(
                || self.journal(),
                &task.station,
                &drawing.result,
                task.stamp,
                &mut made,
                previous.as_deref(),
            )?,
        };
        drawing.log(how, &made.summary, previous.as_deref());
        let unfiled = drawing.unfiled(how, made, before.map(|before| before.import));
        // BeamServer may have imported it only now.
        let is_unchanged = how == How::Unchanged && task.station.delivery.kind == DeliveryKind::Folder;
        if !is_unchanged {
            return self.finish(&drawing.ready, unfiled);
        }
        Ok(match self.complete(&drawing.ready, unfiled)? {
            Outcome::Delivered => Outcome::Unchanged,
            outcome => outcome,
        })
    }

    /// Makes the drawing of this name wait if there is no surface.
    pub(super) fn expect_surface(&self, task: &Task, sku: &Sku, name: &str) -> Result<(), EarlyEnd> {
        // A primitive is given in the settings, so a rejected part file does not affect it.
        let is_from_file = task.settings.part.primitive.is_none();
        if let Some(reason) = self.refused(&task.station.folders, sku).filter(|_| is_from_file) {
            return Err(EarlyEnd::Outcome(Outcome::PartRefused(reason)));
        }
        let surface = self.has_surface(&task.station.folders, sku, &task.settings, task.pace)?;
        if let Surface::Lost(reason) = surface {
            return Err(EarlyEnd::Outcome(Outcome::NoSurface(reason)));
        }
        if matches!(surface, Surface::Unknown) {
            if self.corrector.fleet().is_some() && self.identity(sku, &task.settings)?.is_some() {
                return Err(EarlyEnd::Outcome(Outcome::NoSurface(waits_for_surface(sku))));
            }
            let what = format!("The drawing waits for a part: the SKU `{sku}` has no surface yet.");
            let mut remedy = format!("Drop the part as {sku}{}.", MeshFormat::ENDINGS);
            let known: Vec<String> = filing::known_skus(&task.station.folders).into_iter().collect();
            let near: Vec<&str> =
                near(sku.key(), &known).into_iter().filter(|name| *name != sku.key()).collect();
            if !near.is_empty() {
                let names = near
                    .iter()
                    .take(NEAR_NAMES)
                    .map(|name| format!("{name}@"))
                    .collect::<Vec<_>>()
                    .join(" or ");
                remedy += &format!(" If the drawing is for another product, begin its name with {names}.");
            } else if !name.contains('@') {
                remedy += &format!(
                    " If the drawing is for another product, name it in the form SKU@name.dxf, such as {}@{name}.",
                    nearest_first(sku.key(), &known)
                        .into_iter()
                        .find(|name| *name != sku.key())
                        .unwrap_or("mouse")
                );
                remedy += &known_names(sku, &known);
            }
            return Err(EarlyEnd::Outcome(Outcome::NoSurface(Reason::new("waits-for-part", what, remedy))));
        }
        self.note_shape(sku, &task.settings, false);
        Ok(())
    }

    /// Collects everything that the drawing is made from.
    fn prepare<'a>(&self, ready: Ready<'a>, started: Instant) -> Result<Correction<'a>, EarlyEnd> {
        let Ready { task, sku, name, read, .. } = ready;
        let settings = match &read.sidecar {
            Some((path, text)) => {
                task.settings.with_sidecar(path, text).map_err(|error| JobError::Rejected(error.reason()))?
            }
            None => task.settings.clone(),
        };
        let basis = self.basis(sku, &settings)?.unwrap_or_default();
        let pattern = blake3::hash(&read.file.bytes).to_hex().to_string();
        let all = format!("{}\n{}\n{pattern}\n{basis}\n{}", env!("CARGO_PKG_VERSION"), name, sku.key());
        let result = Job {
            drop: task.drop.clone(),
            sku: sku.as_str().into(),
            name: name.into(),
            key: blake3::hash(all.as_bytes()).to_hex()[..32].to_owned(),
            basis,
            pattern,
            result: String::new(),
        };
        let last = self.journal().result(name);
        if task.drop.is_archived() && last.as_ref().is_some_and(|last| last.job.pattern != result.pattern) {
            let what = "The original in the archive is not the one that was delivered.";
            let remedy = "Drop the drawing that is to be marked.";
            return Err(JobError::Rejected(Reason::new("archive-changed", what, remedy)).into());
        }
        Ok(Correction { ready, settings, result, last, started })
    }

    /// What an interrupted job has delivered for this file.
    fn resume(&self, drawing: &Correction) -> Result<Option<Before>, JobError> {
        let (task, result) = (drawing.ready.task, &drawing.result);
        let mut journal = self.journal();
        let Some(open) = journal.begun(&task.drop, task.stamp).cloned() else { return Ok(None) };
        let inputs = match open.stage.result() {
            Some(begun) if begun.pattern != result.pattern => Inputs::AnotherFile,
            Some(begun) if begun.key != result.key => Inputs::Changed,
            _ => Inputs::Same,
        };
        let original = Original::AtHand { inputs, copied: false };
        let resume = recovery::resume(&task.station, &mut journal, &task.drop, &open, original)?;
        Ok(match (resume, open.stage.result().cloned()) {
            (Resume::Finish { certainty, import, report, .. }, Some(result)) => {
                Some(Before { result, certainty, import, report })
            }
            _ => None,
        })
    }

    /// Files a drawing that was already delivered, if the settings ask not to deliver it again; returns whether it did.
    fn repeat(&self, drawing: &mut Correction) -> Result<bool, JobError> {
        let (task, name) = (drawing.ready.task, drawing.ready.name);
        let delivery = &task.station.delivery;
        let Some(last) = drawing.last.as_ref().filter(|last| {
            last.job.key == drawing.result.key
                && delivery.repeat == Repeat::Never
                && !task.drop.is_archived()
                && is_imported(task, last)
        }) else {
            return Ok(false);
        };
        match last.certainty {
            Certainty::Certain => {
                tracing::info!("{name} was already delivered at {} and is not delivered again", last.at);
            }
            Certainty::Uncertain => tracing::warn!(
                "{name} may have been delivered before {} and is not delivered again; `{}` delivers it again",
                last.at,
                delivery::retry_command(&task.station, name)
            ),
        }
        drawing.result.result.clone_from(&last.job.result);
        self.file_original(&drawing.ready, &drawing.result, last.import, last.certainty)?;
        Ok(true)
    }

    /// Files a drawing that was corrected again, if it is the same as the delivered one: an importer would mark a
    /// second delivery a second time. Returns whether it did.
    fn stays_as_delivered(&self, drawing: &Correction) -> Result<bool, JobError> {
        let is_the_same = |last: &&Delivered| {
            last.job.result == drawing.result.result
                && last.certainty == Certainty::Certain
                && is_imported(drawing.ready.task, last)
        };
        let Some(last) = drawing.last.as_ref().filter(is_the_same) else { return Ok(false) };
        if !drawing.ready.task.drop.is_archived() {
            return Ok(false);
        }
        tracing::info!("{} did not change, and is not delivered again", drawing.ready.name);
        self.file_original(&drawing.ready, &drawing.result, last.import, last.certainty)?;
        Ok(true)
    }

    /// Rejects the drawing if what it would replace in the import folder is somebody else's.
    fn may_replace(&self, drawing: &Correction, previous: &[u8]) -> Result<(), JobError> {
        match self.corrector.is_corrected(previous) {
            true => drawing.keeps_results_of_other_stations(previous)?,
            false => drawing.keeps_files_of_others(previous)?,
        }
        drawing.keeps_results_of_others(previous)
    }

    /// Corrects the drawing; returns it, and the existing file with its name in the import folder.
    fn make(
        &self,
        drawing: &mut Correction,
        was_delivered: bool,
    ) -> Result<(Delivery, Option<Vec<u8>>), EarlyEnd> {
        let Ready { task, sku, name, read, .. } = drawing.ready;
        let folders = &task.station.folders;
        let import_is_there = || match folders.import_trouble() {
            Some(reason) => Err(EarlyEnd::Outcome(Outcome::NoImportFolder(reason))),
            None => Ok(()),
        };
        // A drawing is corrected once even without an import folder, so that errors in it are reported early; while it
        // waits for the folder, it is not corrected again and again.
        if task.waits_for_import {
            import_is_there()?;
        }
        if task.station.delivery.kind == DeliveryKind::Beamserver {
            beamserver::sendable(&task.station.delivery.path_for_server(&folders.import, name))?;
        }
        // Files that are dropped together arrive one after the other, and the drawing may arrive before its part.
        let part_arrived = || !was_delivered && self.overtaken().contains(sku);
        if part_arrived() {
            return Err(EarlyEnd::Outcome(Outcome::PartArrived));
        }
        let previous = filing::delivered_before(folders, name).map_err(folder_trouble)?;
        let made = guarded(|| {
            self.corrector.correct(sku, &read.file, previous.as_deref(), &drawing.settings, task.pace)
        })?;
        drawing.result.result = delivery::hash_of(&made.drawing);
        if let Some(previous) = previous.as_deref().filter(|_| !was_delivered) {
            self.may_replace(drawing, previous)?;
        }
        import_is_there()?;
        self.shares.are_there(folders, false)?;
        if part_arrived() {
            return Err(EarlyEnd::Outcome(Outcome::PartArrived));
        }
        Ok((made, previous))
    }
}

impl Before {
    /// The remaining steps when the report cannot be made any more.
    fn without_report(self, task: &Task) -> Unfiled {
        tracing::warn!(
            "{} has no report: part or settings changed after the station was interrupted while delivering it",
            self.result.name
        );
        Unfiled {
            stamp: task.stamp,
            job: self.result,
            certainty: self.certainty,
            delivery: Delivery::default(),
            drawn_from: 0,
            pictures: Vec::new(),
            is_resumed: self.import != Import::Due,
            import: self.import,
            asked: false,
            is_counted: false,
        }
    }
}

impl Correction<'_> {
    fn is_same_again(&self) -> bool {
        self.last.as_ref().is_some_and(|last| last.job.key == self.result.key)
    }

    /// Rejects the drawing if the file of its name in the import folder, `previous`, which does not show that it is a corrected drawing,
    /// was there before any result of this name: there may be no other copy of it. Marking software that saves a result again
    /// may leave out what shows it, and without comments nothing does.
    fn keeps_files_of_others(&self, previous: &[u8]) -> Result<(), JobError> {
        let Ready { name, .. } = self.ready;
        let is_known = self.last.is_some() || delivery::hash_of(previous) == self.result.result;
        if is_known || previous.is_empty() || !self.settings.output.comments {
            return Ok(());
        }
        let what =
            format!("The import folder has a file {name} that is not from isomark, and would be lost.");
        let remedy = format!(
            "Move {name} out of the import folder, or rename this drawing. Then drop the drawing again."
        );
        Err(JobError::Rejected(Reason::new("foreign-file", what, remedy)))
    }

    /// Rejects the drawing if the one in the import folder, `previous`, is the result of a drawing with
    /// another name: no user asked to replace that drawing, and its designer has seen it as delivered.
    fn keeps_results_of_others(&self, previous: &[u8]) -> Result<(), JobError> {
        let Ready { task, name, .. } = self.ready;
        let hash = delivery::hash_of(previous);
        let is_of_another = |last: &&Delivered| {
            last.job.result == hash
                && last.job.result != self.result.result
                && !is_same_pattern(&last.job.drop, &task.drop, task.has_rival)
        };
        let Some(last) = self.last.as_ref().filter(is_of_another) else { return Ok(()) };
        let older = &last.job.drop;
        let what = format!(
            "The result would be {name}, which is in the import folder as the result of another drawing, {older}."
        );
        let remedy = format!(
            "Rename this drawing, and drop it again. If it is the new version of {older}, remove {name} from the import folder first."
        );
        Err(JobError::Rejected(Reason::new("result-of-another", what, remedy)))
    }

    /// Rejects the drawing if the corrected one in the import folder, `previous`, was not delivered by this
    /// station: it is recorded as delivered at its own station. Without a journal, the report and the archive
    /// show what this station has delivered.
    fn keeps_results_of_other_stations(&self, previous: &[u8]) -> Result<(), JobError> {
        let Ready { task, sku, pattern, name, .. } = self.ready;
        let (folders, hash) = (&task.station.folders, delivery::hash_of(previous));
        let is_in_journal = match &self.last {
            // It is not known which of the two is there.
            Some(last) => {
                last.certainty == Certainty::Uncertain || [&*last.job.result, last.held()].contains(&&*hash)
            }
            None => folders.archive.join(sku.key()).join(pattern).exists(),
        };
        let is_known = hash == self.result.result
            || is_in_journal
            || filing::reported_result(folders, sku, pattern).is_some_and(|reported| reported == hash);
        if is_known {
            return Ok(());
        }
        let what = format!(
            "The import folder has a corrected drawing {name} that this station has not delivered: it may be of another station, and \
             would be lost."
        );
        let remedy = format!(
            "Give each station its own import folder, or rename this drawing. If {name} is not needed, remove it from the import \
             folder. Then drop the drawing again."
        );
        Err(JobError::Rejected(Reason::new("result-of-another-station", what, remedy)))
    }

    /// Logs the delivery, with warnings about anything unusual.
    fn log(&self, how: How, summary: &str, previous: Option<&[u8]>) {
        let Ready { task, sku, name, read, .. } = self.ready;
        let is_for_server = task.station.delivery.kind == DeliveryKind::Beamserver;
        let is_new = matches!(how, How::New | How::Replaced | How::Again);
        let then = if is_for_server && is_new { "; BeamServer imports it next" } else { "" };
        let took = self.started.elapsed().as_millis();
        let last = self.last.as_ref().map(|last| (last.at.as_str(), self.is_same_again()));
        let outcome = describe(how, last, is_for_server);
        let drop = self.result.drop.to_string();
        let from = if drop == *name { String::new() } else { format!(", from {drop}") };
        tracing::info!("{name} {outcome}{then} ({took} ms{from}): {summary}");
        let last = self.last.as_ref();
        if let Some(last) = last
            && !self.is_same_again()
            && !is_same_drop(&last.job.drop, &self.result.drop)
        {
            let [older, newer] = distinguishable(&last.job.drop.to_string(), &self.result.drop.to_string());
            tracing::warn!(
                "{older} and {newer} have the same result name: {name} now comes from {newer}. Rename one of the drawings"
            );
        }
        if read.sidecar.is_none()
            && let Some(settings) = last.and_then(|last| sidecar_of_last(&task.station.folders, sku, last))
        {
            tracing::warn!(
                "{name} arrived without the settings of its previous version. If they still apply, drop it again with {}",
                settings.display()
            );
        }
        let is_ours = |bytes: &[u8]| last.is_some_and(|last| last.job.result == delivery::hash_of(bytes));
        if how == How::Replaced && !previous.is_some_and(is_ours) {
            tracing::warn!(
                "the replaced {name} in import was not the drawing that this station had delivered"
            );
        }
    }

    /// The remaining steps. `import` is the state that an interrupted job left.
    fn unfiled(&self, how: How, mut made: Delivery, import: Option<Import>) -> Unfiled {
        let task = self.ready.task;
        let drawn_from = made.drawing.len();
        (made.drawing, made.check) = (Vec::new(), None);
        let import = match (import, &self.last) {
            (Some(import), _) => import,
            (None, Some(last)) if how == How::Unchanged && self.is_same_again() => last.import,
            _ if task.station.delivery.kind == DeliveryKind::Folder => Import::ByFolder,
            _ => Import::Due,
        };
        Unfiled {
            stamp: task.stamp,
            job: self.result.clone(),
            certainty: how.certainty(),
            delivery: made,
            drawn_from,
            pictures: Vec::new(),
            // A drawing for BeamServer is delivered when that has imported it.
            is_resumed: matches!(how, How::BeforeTheCrash(_)) && import != Import::Due,
            import,
            asked: false,
            is_counted: false,
        }
    }
}

/// Whether another file has the name of the drop now.
fn is_replaced(task: &Task) -> bool {
    matches!(folders::look(&task.path), Ok(Some(Found::File(now))) if now != task.stamp)
}

/// Why a drawing waits whose part another station has fitted.
fn waits_for_surface(sku: &Sku) -> Reason {
    let what = format!(
        "The drawing waits for a surface: the fleet knows the part of SKU `{sku}`, but its surface has not arrived here."
    );
    let remedy = format!(
        "Wait: a station that has the surface sends it while it is connected. If none has it for the settings of this station, drop the \
         part here, as {sku}{}.",
        MeshFormat::ENDINGS
    );
    Reason::new("waits-for-part", what, remedy)
}

/// The known SKUs whose names are nearest to that of an unknown one, as a sentence.
fn known_names(unknown: &Sku, known: &[String]) -> String {
    let others: Vec<&str> =
        nearest_first(unknown.key(), known).into_iter().filter(|name| *name != unknown.key()).collect();
    if others.is_empty() {
        return String::new();
    }
    let more = if others.len() > NEAR_NAMES { " and others" } else { "" };
    format!(" Known SKUs: {}{more}.", others[..others.len().min(NEAR_NAMES)].join(", "))
}

/// Whether the last result needs no import by BeamServer.
fn is_imported(task: &Task, last: &Delivered) -> bool {
    task.station.delivery.kind == DeliveryKind::Folder || last.import == Import::Done
}

/// Whether two drops are the same; of a drawing that was corrected again from the archive, only the pattern's name is
/// known.
fn is_same_drop(a: &DropId, b: &DropId) -> bool {
    a == b || ((a.is_archived() || b.is_archived()) && fold(&pattern_of(a)) == fold(&pattern_of(b)))
}

/// Whether two drops are the same drawing. A name in another spelling is the same one, unless both were there at the same time.
fn is_same_pattern(a: &DropId, b: &DropId, were_together: bool) -> bool {
    let [a, b] = [pattern_of(a), pattern_of(b)];
    a == b || fold(&a) == fold(&b) && !were_together
}

/// The name of a drawing, with its ending.
fn pattern_of(drop: &DropId) -> String {
    match drop {
        DropId::Hot(path) => match meaning(Path::new(path)) {
            Ok(Meaning::Pattern { name, .. }) => name,
            _ => drop.file_name().to_owned(),
        },
        DropId::Archived { .. } => drop.file_name().to_owned(),
    }
}

/// Two different names, spelled so that the difference is visible: an accent may be a separate character.
fn distinguishable(one: &str, other: &str) -> [String; 2] {
    let looks_alike = fold(one) == fold(other);
    let spelled = |name: &str| match looks_alike {
        true => name
            .chars()
            .map(|c| if c.is_ascii() { c.to_string() } else { c.escape_unicode().to_string() })
            .collect(),
        false => name.to_owned(),
    };
    [spelled(one), spelled(other)]
}

/// The settings in the archive beside the original of a result.
fn sidecar_of_last(folders: &FolderPaths, sku: &Sku, last: &Delivered) -> Option<PathBuf> {
    let original = Some(&last.original).filter(|original| !original.is_empty())?;
    sidecar_of(&folders.archive.join(sku.key()).join(original)).filter(|path| folders::is_file(path))
}

/// What happened to a drawing, as text for the log; `last` is the time of the last result, and whether it is the same.
/// A drawing for BeamServer is delivered when BeamServer has imported it.
fn describe(how: How, last: Option<(&str, bool)>, is_for_server: bool) -> String {
    let delivered = if is_for_server { "written" } else { "delivered" };
    match (how, last) {
        (How::Replaced, Some((at, false))) => format!("replaced the result of {at} in import"),
        (How::Replaced, _) => "replaced the older drawing in import".into(),
        (How::New, Some((at, true))) => {
            format!("was already delivered at {at}, is missing in import, and is {delivered} again")
        }
        (How::New, Some((at, false))) => {
            format!("{delivered} to import; the previous result of {at} is no longer there")
        }
        (How::New, None) => format!("{delivered} to import"),
        (How::Unchanged, _) => "was already delivered and is unchanged in import".into(),
        (How::Again, _) => "was already delivered and is written to import again".into(),
        (How::BeforeTheCrash(Certainty::Certain), _) => {
            "was delivered before the station was interrupted; its original goes to the archive".into()
        }
        (How::BeforeTheCrash(Certainty::Uncertain), _) => {
            "may have been delivered before the station was interrupted; its original goes to the archive"
                .into()
        }
        (How::Perhaps, _) => "may have been delivered to import; its original goes to the archive".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drops_are_the_same_if_path_or_archived_name_agree() {
        for (a, b, same) in [
            ("mug@pic.dxf", "mug@pic.dxf", true),
            ("mug@pic.png", "mug@pic.dxf", false),
            ("mug/pic.dxf", "mug@pic.dxf", false),
            ("archive:mug/(2)/mug@pic.dxf", "mug@pic.dxf", true),
            ("mug@pic.dxf", "archive:mug/mug@pic.png", false),
            ("mug/pic.dxf", "archive:mug/mug@pic.dxf", true),
        ] {
            let [a, b] = [a, b].map(|drop| DropId::from(drop.to_owned()));
            assert_eq!(is_same_drop(&a, &b), same, "{a} {b}");
        }
    }

    #[test]
    fn names_that_differ_in_case_are_two_drawings_if_both_were_there() {
        for (a, b, same, same_later) in [
            ("abc.dxf", "abc.dxf", true, true),
            ("abc.dxf", "ABC.dxf", false, true),
            ("abc.dxf", "abc.DXF", false, true),
            ("mug/pic.dxf", "mug@pic.dxf", true, true),
            ("mug@pic.png", "mug@pic.dxf", false, false),
        ] {
            let [a, b] = [a, b].map(|drop| DropId::from(drop.to_owned()));
            assert_eq!(is_same_pattern(&a, &b, true), same, "{a} {b}");
            assert_eq!(is_same_pattern(&a, &b, false), same_later, "{a} {b}");
        }
    }

    #[test]
    fn names_that_look_alike_are_made_distinguishable() {
        let [one, other] = distinguishable("m\u{fc}g@pic.dxf", "mu\u{308}g@pic.dxf");
        assert_eq!((&*one, &*other), ("m\\u{fc}g@pic.dxf", "mu\\u{308}g@pic.dxf"));
        assert_eq!(distinguishable("mug@pic.png", "m\u{fc}g@pic.dxf"), ["mug@pic.png", "m\u{fc}g@pic.dxf"]);
        assert_eq!(distinguishable("Mug@pic.dxf", "mug@pic.dxf"), ["Mug@pic.dxf", "mug@pic.dxf"]);
    }
}
