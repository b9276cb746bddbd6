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
    /// SKUs whose part was unknown when they were checked: the cache was emptied, or has another version.
    unknown: BTreeMap<Sku, Search>,
    /// SKUs whose settings or part could not be read: they are checked again later.
    unreadable: BTreeSet<Sku>,
    /// Whether every SKU is checked or in `unchecked`; false at the start and after a change of the station's settings.
    all_checked: bool,
    /// By the folded names of the results.
    marked: BTreeMap<String, Marked>,
    /// What people asked to be corrected again: the drawings of one SKU, or all.
    asked: Vec<Option<Sku>>,
}

/// Whether an unknown part is looked for in the archive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Search {
    /// It is looked for from this moment on; with `takes_long`, it turned out to be a large job.
    Due {
        at: Moment,
        takes_long: bool,
    },
    UnderWay,
    /// It was found, so the SKU is checked again.
    Found,
    /// The archive has none that can be fitted.
    InVain,
}

/// How a search for an unknown part ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Searched {
    /// The part is known.
    Found,
    /// It is a large job, which waits for its turn.
    TakesLong,
    /// The archive could not be read; it is looked for again at this moment.
    Postponed(Moment),
    /// The archive has no part that can be fitted.
    InVain,
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
        if matches!(self.unknown.get(sku), Some(Search::Due { .. } | Search::InVain)) {
            self.unknown.remove(sku);
            self.check(sku.clone());
        }
    }

    /// The next SKU whose unknown part is to be looked for in the archive, and whether that takes long; one at a time,
    /// because other jobs need the threads more.
    pub(crate) fn next_search(
        &mut self,
        now: Moment,
        is_free: impl Fn(&Sku) -> bool,
        large_too: bool,
    ) -> Option<(Sku, bool)> {
        if self.unknown.values().any(|search| *search == Search::UnderWay) {
            return None;
        }
        self.unknown.iter_mut().find_map(|(sku, search)| match *search {
            Search::Due { at, takes_long } if at <= now && (large_too || !takes_long) && is_free(sku) => {
                *search = Search::UnderWay;
                Some((sku.clone(), takes_long))
            }
            _ => None,
        })
    }

    /// Notes how the search for an unknown part ended.
    pub(crate) fn searched(&mut self, sku: &Sku, end: Searched) {
        let Some(search) = self.unknown.get_mut(sku) else { return };
        *search = match end {
            Searched::Found => Search::Found,
            Searched::TakesLong => Search::Due { at: Moment::ZERO, takes_long: true },
            Searched::Postponed(at) => Search::Due { at, takes_long: false },
            Searched::InVain => {
                tracing::warn!("{}", cannot_check([sku].into_iter()));
                Search::InVain
            }
        };
        if end == Searched::Found {
            self.check(sku.clone());
        }
    }

    /// Skips the searches that match and have not begun.
    pub(crate) fn leave_searches(&mut self, these: impl Fn(&Sku) -> bool) {
        self.unknown.retain(|sku, search| !matches!(search, Search::Due { .. }) || !these(sku));
    }

    /// Why delivered drawings cannot be checked, if there are any.
    pub(crate) fn trouble(&self) -> Option<String> {
        let in_vain = self.unknown.iter().filter(|(_, search)| **search == Search::InVain);
        let skus: Vec<&Sku> = in_vain.map(|(sku, _)| sku).collect();
        (!skus.is_empty()).then(|| cannot_check(skus.into_iter()))
    }

    /// Has an unknown part looked for. If the search found it and it is still unknown, it is not looked for again.
    fn search(&mut self, sku: &Sku, is_first: bool) {
        let due = Search::Due { at: Moment::ZERO, takes_long: false };
        let search = self.unknown.entry(sku.clone()).or_insert(due);
        *search = match *search {
            Search::Found if is_first => Search::InVain,
            Search::InVain if is_first => due,
            other => other,
        };
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
        self.unknown.remove(sku);
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
        let Ok(part) = executor.agreed_identity(&station.folders, sku, settings) else {
            self.unreadable.insert(sku.clone());
            return;
        };
        let (results, last) = executor.journal().results_of(sku, progress.after.as_deref(), SLICE);
        let archive = station.folders.archive.join(sku.key());
        executor.rebase(&archive, &results, part.as_deref(), settings);
        match part {
            Some(_) => drop(self.unknown.remove(sku)),
            None if results.iter().any(|result| !result.original.is_empty()) => {
                self.search(sku, progress.after.is_none());
            }
            None => {}
        }
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
            None => self.marked.contains_key(&key),
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
        // These can be checked later, and must not delay the others.
        let searched = self.unknown.iter().filter(|(_, search)| **search != Search::InVain);
        let late: BTreeSet<Sku> = searched.map(|(sku, _)| sku).chain(&self.unreadable).cloned().collect();
        let unchecked = &self.unchecked;
        let is_known = |sku: &mut Option<Sku>| match sku {
            Some(sku) => !unchecked.contains_key(sku) && !late.contains(sku),
            None => unchecked.keys().all(|sku| late.contains(sku)),
        };
        for sku in self.asked.extract_if(.., is_known).collect::<Vec<_>>() {
            let is_meant = |marked: &&mut Marked| {
                !marked.uncertain && sku.as_ref().is_none_or(|sku| marked.again.sku == *sku)
            };
            let meant = self.marked.values_mut().filter(is_meant);
            let count = meant.map(|marked| marked.due = Some(Moment::ZERO)).count();
            let plural = if count == 1 { "drawing" } else { "drawings" };
            tracing::info!("correcting {count} outdated {plural} again, as requested");
            if sku.is_none() {
                self.asked.extend(late.iter().cloned().map(Some));
            }
        }
    }

    /// Ends the pauses of all drawings that wait for another attempt.
    pub(crate) fn free_all(&mut self) {
        self.marked.values_mut().filter_map(|marked| marked.due.as_mut()).for_each(|due| *due = Moment::ZERO);
        for search in self.unknown.values_mut() {
            if let Search::Due { at, .. } = search {
                *at = Moment::ZERO;
            }
        }
    }

    /// Whether nothing is left to check or to correct now.
    pub(crate) fn is_idle(&self, now: Moment) -> bool {
        let is_searched = |search: &Search| match search {
            Search::Due { at, .. } => *at <= now,
            Search::UnderWay | Search::Found => true,
            Search::InVain => false,
        };
        self.unchecked.is_empty()
            && self.all_checked
            && !self.unknown.values().any(is_searched)
            && !self.marked.values().any(|m| m.under_way || m.due.is_some_and(|due| due <= now))
    }

    /// The number of outdated drawings, and the first `limit` of them by name, each with its SKU.
    pub(crate) fn marked(&self, limit: usize) -> (usize, Vec<(String, Sku)>) {
        let outdated = || self.marked.values().filter(|marked| !marked.uncertain);
        let both = |marked: &Marked| (marked.again.name.clone(), marked.again.sku.clone());
        (outdated().count(), outdated().take(limit).map(both).collect())
    }
}

/// Why the drawings of SKUs cannot be checked.
fn cannot_check<'s>(skus: impl ExactSizeIterator<Item = &'s Sku>) -> String {
    const NAMED: usize = 5;
    let more = skus.len().saturating_sub(NAMED);
    let names = skus.take(NAMED).map(Sku::as_str).collect::<Vec<_>>().join(", ");
    let names = if more > 0 { format!("{names} and {more} more SKUs") } else { names };
    format!(
        "cannot check whether delivered drawings of {names} are outdated: the part is unknown, and the archive has none \
         that can be fitted. Drop the part again"
    )
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_answered_for_each_sku_as_soon_as_it_is_checked() {
        let mut all = Reprocessing { all_checked: true, ..Reprocessing::default() };
        let [can, mug, jar]: [Sku; 3] = ["can", "mug", "jar"].map(|sku| sku.parse().unwrap());
        let mark = |all: &mut Reprocessing, sku: &Sku| {
            let (name, original, place) = (format!("{sku}.dxf"), PathBuf::new(), String::new());
            let again = Recorrection { sku: sku.clone(), name: name.clone(), original, place };
            all.marked.insert(name, Marked::new(again));
        };
        let next = |all: &mut Reprocessing| {
            all.answer();
            let next = all.next(Moment::ZERO, |_, _| true, true);
            next.map(|(again, _)| again.name)
        };
        mark(&mut all, &can);
        // The settings of one are being saved, and the part of the other is looked for.
        all.check(mug.clone());
        all.cannot_read(&mug);
        all.search(&jar, true);
        all.ask_for(None);
        assert_eq!(next(&mut all).as_deref(), Some("can.dxf"));
        for sku in [&mug, &jar] {
            mark(&mut all, sku);
            assert_eq!(next(&mut all), None, "{sku} is not checked yet");
        }
        all.check_unreadable();
        assert_eq!(next(&mut all), None, "it is about to be checked");
        all.unchecked.clear();
        assert_eq!(next(&mut all).as_deref(), Some("mug.dxf"));
        all.searched(&jar, Searched::InVain);
        assert_eq!(next(&mut all).as_deref(), Some("jar.dxf"));
    }

    #[test]
    fn a_part_that_is_found_and_still_unknown_is_not_looked_for_again() {
        let mut all = Reprocessing { all_checked: true, ..Reprocessing::default() };
        let can: Sku = "can".parse().unwrap();
        let search = |all: &mut Reprocessing| all.next_search(Moment::ZERO, |_| true, true);
        all.search(&can, true);
        assert_eq!(search(&mut all), Some((can.clone(), false)));
        assert_eq!(search(&mut all), None, "it is under way");
        all.searched(&can, Searched::TakesLong);
        assert_eq!(search(&mut all), Some((can.clone(), true)));
        all.searched(&can, Searched::Found);
        assert!(!all.is_idle(Moment::ZERO));
        // The check finds it unknown, in two slices.
        all.unchecked.clear();
        all.search(&can, true);
        all.search(&can, false);
        assert!(search(&mut all).is_none() && all.is_idle(Moment::ZERO));
        assert!(all.trouble().unwrap().contains("of can are outdated"));
        // A later check may find it: something has changed.
        all.search(&can, true);
        assert!(search(&mut all).is_some() && all.trouble().is_none());
    }
}
