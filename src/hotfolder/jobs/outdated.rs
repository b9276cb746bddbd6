//! Delivered drawings that are outdated, because their SKU has a new part or new settings.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{Executor, is_comparable};
use crate::config::{DeliveryKind, JobSettings, Outdated, Sku, Station, fold};
use crate::hotfolder::api::Corrector;
use crate::hotfolder::seen::Moment;
use crate::hotfolder::state::{Delivered, DropId, Import};
use crate::reason::Reason;

/// The number of results that are checked at a time, so that the station stays responsive.
const SLICE: usize = 50;

/// The outdated drawings, and which of them are to be corrected again.
#[derive(Default)]
pub(crate) struct Reprocessing {
    /// The SKUs to check, with the progress of each.
    unchecked: BTreeMap<Sku, Progress>,
    /// SKUs whose part was unknown when they were checked.
    unknown: BTreeSet<Sku>,
    /// SKUs whose settings or part could not be read: they are checked again later.
    unreadable: BTreeSet<Sku>,
    /// Whether every SKU is checked or in `unchecked`; false at the start and after a change of the station's settings.
    all_checked: bool,
    /// By the folded names of the results.
    marked: BTreeMap<String, Marked>,
    /// What people asked to be corrected again: the drawings of one SKU, or all.
    asked: Vec<Option<Sku>>,
}

/// How far the results of a SKU are checked.
#[derive(Default)]
struct Progress {
    /// The folded name of the last result.
    after: Option<Arc<str>>,
    /// The number of results that became outdated.
    news: usize,
}

/// One outdated drawing.
struct Marked {
    again: Recorrection,
    /// When it is corrected again; `None` until somebody asks for it.
    due: Option<Moment>,
    under_way: bool,
    /// It turned out to be a large job.
    takes_long: bool,
    /// It is corrected again because its delivery is uncertain.
    uncertain: bool,
    /// The last logged reason why it is not corrected again yet.
    last_reason: Option<String>,
}

impl Marked {
    fn new(again: Recorrection) -> Self {
        Self { again, due: None, under_way: false, takes_long: false, uncertain: false, last_reason: None }
    }
}

/// An archived pattern that is to be corrected again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Recorrection {
    pub(crate) sku: Sku,
    /// The name of the result.
    pub(crate) name: String,
    /// The archived original.
    pub(crate) original: PathBuf,
    /// Its path relative to the SKU's archive folder.
    place: String,
}

impl Recorrection {
    pub(crate) fn drop(&self) -> DropId {
        DropId::archived(&self.sku, &self.place)
    }
}

impl Reprocessing {
    /// Checks the SKU again: its part or settings may have changed.
    pub(crate) fn check(&mut self, sku: Sku) {
        self.unchecked.entry(sku).or_default().after = None;
    }

    /// Checks the SKU again if its part was unknown: a job may have found it in the archive.
    pub(crate) fn check_if_unknown(&mut self, sku: &Sku) {
        if let Some(sku) = self.unknown.take(sku) {
            self.check(sku);
        }
    }

    /// Checks SKUs again whose settings or part could not be read: the file may be complete or correct now, and the
    /// cache may be available again.
    pub(crate) fn check_unreadable(&mut self) {
        std::mem::take(&mut self.unreadable).into_iter().for_each(|sku| self.check(sku));
    }

    /// Checks all SKUs again: their settings may have changed.
    pub(crate) fn check_all(&mut self) {
        self.all_checked = false;
    }

    /// The next SKU to check that is not held back.
    pub(crate) fn next_unchecked(
        &mut self,
        all: impl FnOnce() -> BTreeSet<Sku>,
        is_held: impl Fn(&Sku) -> bool,
    ) -> Option<Sku> {
        if !std::mem::replace(&mut self.all_checked, true) {
            self.unchecked = all().into_iter().map(|sku| (sku, Progress::default())).collect();
        }
        self.unchecked.keys().find(|sku| !is_held(sku)).cloned()
    }

    /// Checks the SKU later: its settings are being saved, or are wrong.
    pub(crate) fn cannot_read(&mut self, sku: &Sku) {
        self.unchecked.remove(sku);
        self.unreadable.insert(sku.clone());
    }

    /// Skips all SKUs that match.
    pub(crate) fn leave_all(&mut self, these: impl Fn(&Sku) -> bool) {
        self.unchecked.retain(|sku, _| !these(sku));
    }

    /// Marks the outdated drawings among the next results of the SKU, and has them corrected again if the station's
    /// settings ask for it.
    pub(crate) fn look_at<C: Corrector>(
        &mut self,
        executor: &Executor<'_, C>,
        station: &Station,
        sku: &Sku,
        settings: &JobSettings,
    ) {
        let Some(mut progress) = self.unchecked.remove(sku) else { return };
        let Ok(part) = executor.identity(sku, settings) else {
            self.unreadable.insert(sku.clone());
            return;
        };
        let (results, last) = executor.journal().results_of(sku, progress.after.as_deref(), SLICE);
        let archive = station.folders.archive.join(sku.key());
        executor.rebase(&archive, &results, part.as_deref(), settings);
        for result in results {
            if result.original.is_empty() {
                // The original was removed, so the drawing cannot be corrected again.
                if !self.is_uncertain(&result.job.name) {
                    self.forget(&result.job.name);
                }
                continue;
            }
            let basis = part
                .as_deref()
                .map(|part| executor.basis_of_original(part, &archive.join(&result.original), settings));
            progress.news += usize::from(self.mark(station, sku, result, basis));
        }
        if last.is_some() {
            progress.after = last;
            self.unchecked.insert(sku.clone(), progress);
        } else if progress.news > 0 {
            log_outdated(station, sku, progress.news);
        }
    }

    /// Marks a result if it is outdated or due, and forgets it otherwise; `basis` is the basis that it would have now,
    /// if the SKU's part is known. Returns whether it became outdated.
    fn mark(&mut self, station: &Station, sku: &Sku, result: Delivered, basis: Option<String>) -> bool {
        let name = result.job.name;
        let key = fold(&name);
        let is_due = station.delivery.kind == DeliveryKind::Beamserver && result.import == Import::Due;
        let is_outdated = match basis {
            Some(basis) => is_comparable(&result.job.basis) && basis != result.job.basis,
            // While its part is unknown, the last result of the check is kept.
            None => {
                self.unknown.insert(sku.clone());
                self.marked.contains_key(&key)
            }
        };
        if self.marked.get(&key).is_some_and(|marked| marked.uncertain) {
            return false;
        }
        if !is_outdated && !is_due {
            self.forget(&name);
            return false;
        }
        let original = station.folders.archive.join(sku.key()).join(&result.original);
        let again = Recorrection { sku: sku.clone(), name: name.clone(), original, place: result.original };
        let is_new = !self.marked.contains_key(&key);
        if is_new && is_due {
            tracing::info!("{name} is not in BeamConstruct yet");
        }
        let marked = self.marked.entry(key).or_insert_with(|| Marked::new(again));
        if is_due || station.delivery.outdated == Outdated::Correct {
            marked.due.get_or_insert(Moment::ZERO);
        }
        is_new && is_outdated
    }

    /// The next drawing to correct again, and whether it takes long; `may_make` decides by SKU and folded name.
    pub(crate) fn next(
        &mut self,
        now: Moment,
        may_make: impl Fn(&Sku, &str) -> bool,
        large_too: bool,
    ) -> Option<(Recorrection, bool)> {
        let is_due = |name: &str, marked: &Marked| {
            marked.due.is_some_and(|due| due <= now) && may_make(&marked.again.sku, name)
        };
        let (_, next) = self.marked.iter_mut().find(|(name, marked)| {
            !marked.under_way && (large_too || !marked.takes_long) && is_due(name, marked)
        })?;
        next.under_way = true;
        Some((next.again.clone(), next.takes_long))
    }

    /// Notes that it is a large job, which waits for its turn.
    pub(crate) fn takes_long(&mut self, name: &str) {
        if let Some(marked) = self.marked.get_mut(&fold(name)) {
            (marked.under_way, marked.takes_long) = (false, true);
        }
    }

    /// Notes that it could not be done, and tries again at `moment`; `never` in a station that runs once.
    pub(crate) fn postpone(&mut self, name: &str, moment: Moment, never: bool) {
        if let Some(marked) = self.marked.get_mut(&fold(name)) {
            marked.under_way = false;
            marked.due = (!never).then_some(moment);
        }
    }

    /// Whether this reason differs from the last logged one.
    pub(crate) fn is_news(&mut self, name: &str, reason: &Reason) -> bool {
        let last = self.marked.get_mut(&fold(name)).map(|marked| &mut marked.last_reason);
        last.is_some_and(|last| last.replace(reason.what.clone()).as_ref() != Some(&reason.what))
    }

    /// It is up to date, or cannot be corrected again.
    pub(crate) fn forget(&mut self, name: &str) {
        self.marked.remove(&fold(name));
    }

    /// Whether it is corrected again because its delivery is uncertain.
    pub(crate) fn is_uncertain(&self, name: &str) -> bool {
        self.marked.get(&fold(name)).is_some_and(|marked| marked.uncertain)
    }

    /// Requests the correction of all outdated drawings, of one SKU or of all.
    pub(crate) fn ask_for(&mut self, sku: Option<Sku>) {
        self.asked.push(sku);
    }

    /// Delivers a drawing again that may not have been delivered, on request; `archive` is the archive folder of its
    /// SKU.
    pub(crate) fn deliver_again(&mut self, sku: Sku, result: &Delivered, archive: &Path) {
        let (name, place) = (result.job.name.clone(), result.original.clone());
        let key = fold(&name);
        if self.marked.get(&key).is_some_and(|marked| marked.under_way) {
            return;
        }
        let again = Recorrection { sku, name, original: archive.join(&place), place };
        let marked = Marked { due: Some(Moment::ZERO), uncertain: true, ..Marked::new(again) };
        self.marked.insert(key, marked);
    }

    /// Starts the requested corrections, once it is known which drawings are outdated.
    pub(crate) fn answer(&mut self) {
        if !self.all_checked {
            return;
        }
        let (unchecked, unreadable) = (&self.unchecked, &self.unreadable);
        let is_known = |sku: &mut Option<Sku>| match sku {
            Some(sku) => !unchecked.contains_key(sku) && !unreadable.contains(sku),
            None => unchecked.is_empty() && unreadable.is_empty(),
        };
        for sku in self.asked.extract_if(.., is_known).collect::<Vec<_>>() {
            let is_meant = |marked: &&mut Marked| {
                !marked.uncertain && sku.as_ref().is_none_or(|sku| marked.again.sku == *sku)
            };
            let meant = self.marked.values_mut().filter(is_meant);
            let count = meant.map(|marked| marked.due = Some(Moment::ZERO)).count();
            let plural = if count == 1 { "drawing" } else { "drawings" };
            tracing::info!("correcting {count} outdated {plural} again, as requested");
        }
    }

    /// Ends the pauses of all drawings that wait for another attempt.
    pub(crate) fn free_all(&mut self) {
        self.marked.values_mut().filter_map(|marked| marked.due.as_mut()).for_each(|due| *due = Moment::ZERO);
    }

    /// Whether nothing is left to check or to correct now.
    pub(crate) fn is_idle(&self, now: Moment) -> bool {
        self.unchecked.is_empty()
            && self.all_checked
            && !self.marked.values().any(|m| m.under_way || m.due.is_some_and(|due| due <= now))
    }

    /// The number of outdated drawings, and the first `limit` of them by name, each with its SKU.
    pub(crate) fn marked(&self, limit: usize) -> (usize, Vec<(String, Sku)>) {
        let outdated = || self.marked.values().filter(|marked| !marked.uncertain);
        let both = |marked: &Marked| (marked.again.name.clone(), marked.again.sku.clone());
        (outdated().count(), outdated().take(limit).map(both).collect())
    }
}

fn log_outdated(station: &Station, sku: &Sku, count: usize) {
    let (drawings, them) = match count {
        1 => (format!("1 delivered drawing of {sku} is"), "it"),
        more => (format!("{more} delivered drawings of {sku} are"), "them"),
    };
    let outdated = format!("{drawings} outdated: the part or the settings changed");
    match station.delivery.outdated {
        Outdated::Correct => tracing::info!("{outdated}. Correcting {them} again from the archive"),
        Outdated::Mark => {
            let [station, name] = [&*station.file.to_string_lossy(), sku.as_str()].map(crate::reason::quoted);
            let command = format!("isomark retry {station} --outdated {name}");
            tracing::warn!("{outdated}. `{command}` corrects {them} again");
        }
    }
}
