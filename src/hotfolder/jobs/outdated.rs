//! Delivered drawings that would be others today, because their SKU has a new part or new settings.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::{Executor, is_comparable};
use crate::config::{DeliveryKind, JobSettings, Outdated, Sku, Station, fold};
use crate::hotfolder::api::Corrector;
use crate::hotfolder::seen::Moment;
use crate::hotfolder::state::{Delivered, DropId, Import};
use crate::reason::Reason;

/// Results that are looked at in one go: the station must stay responsive.
const SLICE: usize = 50;

/// What is outdated, and what of it is to be corrected again.
#[derive(Default)]
pub(crate) struct Reprocessing {
    /// The SKUs to look at, with how far that is.
    unchecked: BTreeMap<Sku, Look>,
    /// Nothing was known of their parts when they were looked at.
    unknown: BTreeSet<Sku>,
    /// What is known of their parts could not be read.
    unreadable: BTreeSet<Sku>,
    /// At the start and after a change of the station's settings every SKU counts.
    all_checked: bool,
    /// By the names of the results, folded.
    marked: BTreeMap<String, Marked>,
    /// What people asked to be corrected again: of one SKU or of all.
    asked: Vec<Option<Sku>>,
}

/// How far the results of a SKU were looked at.
#[derive(Default)]
struct Look {
    /// The folded name of the last result.
    after: Option<Arc<str>>,
    /// How many were found outdated that were not before.
    news: usize,
}

/// One outdated drawing.
struct Marked {
    again: Recorrection,
    /// When it is corrected again; `None` until somebody asks for it.
    due: Option<Moment>,
    under_way: bool,
    /// It turned out to be more than a moment's work.
    takes_long: bool,
    /// It is corrected again because nobody knows whether it was delivered.
    uncertain: bool,
    /// Why it is not corrected again yet, as it was last told.
    told: Option<String>,
}

impl Marked {
    fn new(again: Recorrection) -> Self {
        Self { again, due: None, under_way: false, takes_long: false, uncertain: false, told: None }
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
    /// The same relative to the SKU's archive folder.
    place: String,
}

impl Recorrection {
    pub(crate) fn drop(&self) -> DropId {
        DropId::archived(&self.sku, &self.place)
    }
}

impl Reprocessing {
    /// The SKU's part or settings may be others now.
    pub(crate) fn check(&mut self, sku: Sku) {
        self.unchecked.entry(sku).or_default().after = None;
    }

    /// A job of the SKU is over, and may have found its part in the archive.
    pub(crate) fn check_if_unknown(&mut self, sku: &Sku) {
        if let Some(sku) = self.unknown.take(sku) {
            self.check(sku);
        }
    }

    /// A cache that could not be read may be there again.
    pub(crate) fn check_unreadable(&mut self) {
        std::mem::take(&mut self.unreadable).into_iter().for_each(|sku| self.check(sku));
    }

    /// The settings of all may be others now.
    pub(crate) fn check_all(&mut self) {
        self.all_checked = false;
    }

    /// The next SKU to look at that is not `held`.
    pub(crate) fn next_unchecked(
        &mut self,
        all: impl FnOnce() -> BTreeSet<Sku>,
        is_held: impl Fn(&Sku) -> bool,
    ) -> Option<Sku> {
        if !std::mem::replace(&mut self.all_checked, true) {
            self.unchecked = all().into_iter().map(|sku| (sku, Look::default())).collect();
        }
        self.unchecked.keys().find(|sku| !is_held(sku)).cloned()
    }

    /// The SKU cannot be looked at.
    pub(crate) fn leave(&mut self, sku: &Sku) {
        self.unchecked.remove(sku);
    }

    /// Nor can those.
    pub(crate) fn leave_all(&mut self, these: impl Fn(&Sku) -> bool) {
        self.unchecked.retain(|sku, _| !these(sku));
    }

    /// Marks what is outdated among the next results of the SKU, and lets it be corrected again if the station's settings
    /// say so.
    pub(crate) fn look_at<C: Corrector>(
        &mut self,
        executor: &Executor<'_, C>,
        station: &Station,
        sku: &Sku,
        settings: &JobSettings,
    ) {
        let Some(mut look) = self.unchecked.remove(sku) else { return };
        let Ok(part) = executor.identity(sku, settings) else {
            self.unreadable.insert(sku.clone());
            return;
        };
        let (results, last) = executor.journal().results_of(sku, look.after.as_deref(), SLICE);
        let archive = station.folders.archive.join(sku.key());
        executor.rebase(&archive, &results, part.as_deref(), settings);
        for result in results {
            if result.original.is_empty() {
                // It was removed, and nothing can be corrected again.
                if !self.is_uncertain(&result.job.name) {
                    self.forget(&result.job.name);
                }
                continue;
            }
            let basis = part
                .as_deref()
                .map(|part| executor.basis_of_original(part, &archive.join(&result.original), settings));
            look.news += usize::from(self.mark(station, sku, result, basis));
        }
        if last.is_some() {
            look.after = last;
            self.unchecked.insert(sku.clone(), look);
        } else if look.news > 0 {
            tell_of_outdated(station, sku, look.news);
        }
    }

    /// Marks a result if it is outdated or due, and forgets it otherwise; `basis` is what it would be made of today, if
    /// the SKU's part is known. Whether it is outdated and was not before.
    fn mark(&mut self, station: &Station, sku: &Sku, result: Delivered, basis: Option<String>) -> bool {
        let name = result.job.name;
        let key = fold(&name);
        let is_due = station.delivery.kind == DeliveryKind::Beamserver && result.import == Import::Due;
        let is_outdated = match basis {
            Some(basis) => is_comparable(&result.job.basis) && basis != result.job.basis,
            // As long as its part is not known, it is what it was last found to be.
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

    /// The next drawing to correct again whose result, by its folded name, may be made, and whether it takes long.
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

    /// It is more than a moment's work, and waits for its turn.
    pub(crate) fn takes_long(&mut self, name: &str) {
        if let Some(marked) = self.marked.get_mut(&fold(name)) {
            (marked.under_way, marked.takes_long) = (false, true);
        }
    }

    /// It could not be done; `never` in a station that stops as soon as it can.
    pub(crate) fn postpone(&mut self, name: &str, moment: Moment, never: bool) {
        if let Some(marked) = self.marked.get_mut(&fold(name)) {
            marked.under_way = false;
            marked.due = (!never).then_some(moment);
        }
    }

    /// Whether nobody was told this reason yet why it is not corrected again.
    pub(crate) fn is_news(&mut self, name: &str, reason: &Reason) -> bool {
        let told = self.marked.get_mut(&fold(name)).map(|marked| &mut marked.told);
        told.is_some_and(|told| told.replace(reason.what.clone()).as_ref() != Some(&reason.what))
    }

    /// It is up to date, or cannot be corrected again.
    pub(crate) fn forget(&mut self, name: &str) {
        self.marked.remove(&fold(name));
    }

    /// Whether it is corrected again because nobody knows whether it was delivered.
    pub(crate) fn is_uncertain(&self, name: &str) -> bool {
        self.marked.get(&fold(name)).is_some_and(|marked| marked.uncertain)
    }

    /// Somebody wants what is outdated to be corrected again, of one SKU or of all.
    pub(crate) fn ask_for(&mut self, sku: Option<Sku>) {
        self.asked.push(sku);
    }

    /// Somebody decided that a drawing which may not have been delivered is delivered again; `archive` is its SKU's.
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

    /// Lets what was asked for be corrected again, once it is known what is outdated.
    pub(crate) fn answer(&mut self) {
        if !self.all_checked {
            return;
        }
        let unchecked = &self.unchecked;
        let is_known = |sku: &mut Option<Sku>| match sku {
            Some(sku) => !unchecked.contains_key(sku),
            None => unchecked.is_empty(),
        };
        for sku in self.asked.extract_if(.., is_known).collect::<Vec<_>>() {
            let is_meant = |marked: &&mut Marked| {
                !marked.uncertain && sku.as_ref().is_none_or(|sku| marked.again.sku == *sku)
            };
            let meant = self.marked.values_mut().filter(is_meant);
            let count = meant.map(|marked| marked.due = Some(Moment::ZERO)).count();
            let plural = if count == 1 { "drawing is" } else { "drawings are" };
            tracing::info!("{count} outdated {plural} corrected again, as asked");
        }
    }

    /// What waits for its time need not wait any longer.
    pub(crate) fn free_all(&mut self) {
        self.marked.values_mut().filter_map(|marked| marked.due.as_mut()).for_each(|due| *due = Moment::ZERO);
    }

    /// Whether nothing is left to be looked at or corrected now.
    pub(crate) fn is_idle(&self, now: Moment) -> bool {
        self.unchecked.is_empty()
            && self.all_checked
            && !self.marked.values().any(|m| m.under_way || m.due.is_some_and(|due| due <= now))
    }

    /// The number of outdated drawings, and the first `most` of them by name, each with its SKU.
    pub(crate) fn marked(&self, most: usize) -> (usize, Vec<(String, Sku)>) {
        let outdated = || self.marked.values().filter(|marked| !marked.uncertain);
        let both = |marked: &Marked| (marked.again.name.clone(), marked.again.sku.clone());
        (outdated().count(), outdated().take(most).map(both).collect())
    }
}

fn tell_of_outdated(station: &Station, sku: &Sku, count: usize) {
    let (drawings, them) = match count {
        1 => (format!("1 delivered drawing of {sku} is"), "it"),
        more => (format!("{more} delivered drawings of {sku} are"), "them"),
    };
    let outdated = format!("{drawings} outdated by a new part or new settings");
    match station.delivery.outdated {
        Outdated::Correct => tracing::info!("{outdated}: isomark corrects {them} again from the archive"),
        Outdated::Mark => {
            let [station, name] = [&*station.file.to_string_lossy(), sku.as_str()].map(crate::reason::quoted);
            let command = format!("isomark retry {station} --outdated {name}");
            tracing::warn!("{outdated}: `{command}` corrects {them} again");
        }
    }
}
