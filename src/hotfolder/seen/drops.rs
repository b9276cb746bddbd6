//! The drops in the hot folder, and the state of each.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::settle::{Ending, Settle};
use super::{
    Found, Gap, Meaning, Moment, SettleTimes, Verdict, Writer, delivered_as, full_stem, is_list, is_sidecar,
    meaning, well_named,
};
use crate::config::{Sku, fold};
use crate::formats::mesh::MeshFormat;
use crate::formats::pattern::is_picture;
use crate::hotfolder::api::{Waiting, WaitsFor};
use crate::hotfolder::state::with_slashes;
use crate::reason::Reason;

/// One drop.
pub(crate) struct Drop {
    /// Its path in the hot folder.
    pub(crate) relative: PathBuf,
    /// What it is, or why its name is invalid.
    pub(crate) meaning: Result<Meaning, Reason>,
    pub(crate) settle: Settle,
    /// Its place in the order in which drops arrived.
    number: u64,
    pub(crate) block: Block,
    /// Why it was incomplete when it was read last.
    pub(crate) lacks: Option<Reason>,
    /// The last reported reason why it waits.
    pub(crate) last_reason: Option<Reason>,
    /// It turned out to be a large job.
    pub(crate) takes_long: bool,
    /// A drawing that arrived before has this name in another spelling.
    pub(crate) has_rival: bool,
}

/// What prevents a settled drop from being processed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Block {
    /// Nothing.
    Free,
    /// Environment error: it is tried again at this moment; the next error doubles the pause.
    Until { moment: Moment, pause: Duration, obstacle: Obstacle },
    /// A pattern whose SKU has no surface.
    UnknownSku,
    /// A pattern whose SKU is about to get a new surface.
    PartUnderWay,
    /// A companion that no part has used yet.
    Unclaimed,
}

/// What prevented a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Obstacle {
    /// The newest part of the SKU was rejected.
    RefusedPart,
    /// There is no import folder.
    NoImportFolder,
    /// The settings may still be written.
    SettingsBeingSaved,
    Other,
}

/// All drops, by path.
#[derive(Default)]
pub(crate) struct Drops {
    all: BTreeMap<PathBuf, Drop>,
    /// Number of parts per SKU.
    parts: BTreeMap<Sku, usize>,
    /// Drops that may belong to a part or pattern beside them.
    companions: BTreeSet<PathBuf>,
    /// The same, and the patterns, by their folded full names: the spelling of a name and its form do not matter.
    by_name: BTreeMap<String, BTreeSet<PathBuf>>,
    /// How many drops have arrived so far.
    count: u64,
}

fn is_bitmap(relative: &Path) -> bool {
    relative.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("bmp"))
}

/// The folded full name without its extension; a misnamed file has the name that it should have.
fn folded_name(relative: &Path) -> String {
    let right = well_named(relative);
    fold(&full_stem(right.as_deref().unwrap_or(relative)))
}

impl Drops {
    pub(crate) fn get(&self, path: &Path) -> Option<&Drop> {
        self.all.get(path)
    }

    pub(crate) fn get_mut(&mut self, path: &Path) -> Option<&mut Drop> {
        self.all.get_mut(path)
    }

    /// Records what is at `hot/relative`.
    pub(crate) fn see(
        &mut self,
        hot: &Path,
        relative: &Path,
        found: Found,
        writer: Writer,
        now: Moment,
        still_for: Duration,
    ) {
        let path = hot.join(relative);
        let (stamp, is_file) = match found {
            Found::File(stamp) => (stamp, true),
            Found::Other(stamp) => (stamp, false),
            Found::Folder => return,
        };
        if let Some(drop) = self.all.get_mut(&path) {
            let changed = drop.settle.stamp() != stamp;
            if changed && drop.takes_long {
                (drop.takes_long, drop.last_reason) = (false, None);
            }
            drop.settle.see(stamp, writer, now);
            // A changed file may succeed where the last one failed.
            if changed && drop.block != Block::UnknownSku {
                drop.block = Block::Free;
            }
            return;
        }
        let meaning = if is_file { meaning(relative) } else { Err(not_a_file()) };
        let part = if let Ok(Meaning::Part(sku)) = &meaning { Some(sku.clone()) } else { None };
        if meaning == Ok(Meaning::Companion) || is_picture(&relative.to_string_lossy()) {
            self.companions.insert(path.clone());
        }
        if matches!(meaning, Ok(Meaning::Companion | Meaning::Pattern { .. })) {
            self.by_name.entry(folded_name(relative)).or_default().insert(path.clone());
        }
        if let Some(sku) = part {
            *self.parts.entry(sku).or_default() += 1;
        }
        let ending = match MeshFormat::from_name(&relative.to_string_lossy()) {
            // A list is short, and is written at once.
            _ if is_list(relative) || well_named(relative).is_some() => Ending::Short,
            Some(format) if !format.has_end_mark() => Ending::Unmarked,
            // The length is not enough: some programs reserve the full length before they write.
            Some(MeshFormat::Stl | MeshFormat::Ply) => Ending::Short,
            _ if is_sidecar(relative) || is_bitmap(relative) => Ending::Short,
            _ => Ending::Marked,
        };
        let spelling = fold(&relative.to_string_lossy());
        let is_rival = |other: &PathBuf| {
            *other != path
                && self
                    .all
                    .get(other)
                    .is_some_and(|other| fold(&other.relative.to_string_lossy()) == spelling)
        };
        let has_rival = matches!(meaning, Ok(Meaning::Pattern { .. }))
            && self.by_name.get(&folded_name(relative)).is_some_and(|of_name| of_name.iter().any(is_rival));
        let settle = Settle::new(stamp, writer, now, still_for).ending(ending);
        let (number, block) = (self.count, Block::Free);
        self.count += 1;
        let drop = Drop {
            relative: relative.into(),
            meaning,
            settle,
            number,
            block,
            lacks: None,
            last_reason: None,
            takes_long: false,
            has_rival,
        };
        self.all.insert(path, drop);
    }

    /// Records that events about writers may have been lost.
    pub(crate) fn events_were_lost(&mut self) {
        self.all.values_mut().for_each(|drop| drop.settle.events_were_lost());
    }

    /// Forgets a drop that is no longer in the hot folder.
    pub(crate) fn forget(&mut self, path: &Path) {
        let Some(drop) = self.all.remove(path) else { return };
        self.companions.remove(path);
        let name = folded_name(&drop.relative);
        if let Some(of_name) = self.by_name.get_mut(&name) {
            of_name.remove(path);
            if of_name.is_empty() {
                self.by_name.remove(&name);
            }
        }
        if let Ok(Meaning::Part(sku)) = drop.meaning {
            let left = self.parts.get(&sku).map_or(0, |count| count - 1);
            if left == 0 {
                self.parts.remove(&sku);
            } else {
                self.parts.insert(sku, left);
            }
        }
    }

    /// Forgets every drop that a listing did not find.
    pub(crate) fn keep_only(&mut self, found: &BTreeSet<PathBuf>) {
        let gone: Vec<_> = self.all.keys().filter(|path| !found.contains(*path)).cloned().collect();
        gone.iter().for_each(|path| self.forget(path));
    }

    /// Whether a part for the SKU is in the hot folder.
    pub(crate) fn has_part(&self, sku: &Sku) -> bool {
        self.parts.contains_key(sku)
    }

    /// The drops that can be processed now, with their paths, but for those at work: parts first, because patterns need them, then
    /// in the order of their arrival. A drop that pauses after an error is not overtaken by a newer drop with the same result:
    /// the older drop would replace that result later.
    pub(crate) fn ready(
        &self,
        now: Moment,
        times: &SettleTimes,
        is_at_work: impl Fn(&Path) -> bool,
    ) -> Vec<(&Path, &Drop)> {
        let pausing = self.all.values().filter(|drop| matches!(drop.block, Block::Until { .. }));
        let mut held = BTreeMap::<Aim, u64>::new();
        for drop in pausing.filter(|drop| self.due(drop, times).is_some_and(|due| due > now)) {
            let Some(aim) = drop.aim() else { continue };
            held.entry(aim).and_modify(|first| *first = drop.number.min(*first)).or_insert(drop.number);
        }
        let is_held = |drop: &Drop| {
            !held.is_empty()
                && drop.aim().and_then(|aim| held.get(&aim)).is_some_and(|first| *first < drop.number)
        };
        let mut ready: Vec<_> = self
            .all
            .iter()
            .filter(|(_, drop)| self.due(drop, times).is_some_and(|due| due <= now) && !is_held(drop))
            .filter(|(path, _)| !is_at_work(path))
            .map(|(path, drop)| (path.as_path(), drop))
            .collect();
        ready.sort_by_key(|(_, drop)| (rank(drop), drop.number));
        ready
    }

    /// The companions beside a drop that may still be written.
    pub(crate) fn settling_beside(&self, path: &Path, now: Moment, times: &SettleTimes) -> BTreeSet<PathBuf> {
        let settles = |companion: &&PathBuf| {
            let drop = self.all.get(*companion);
            drop.is_some_and(|drop| matches!(drop.settle.verdict(now, times), Verdict::Wait(_)))
        };
        // Only files of its own name belong to a drawing: there may be thousands of others.
        if self.is_pattern(path) {
            let companions = self.of_name(path).filter(|companion| self.companions.contains(*companion));
            return companions.filter(settles).cloned().collect();
        }
        let beside = self.companions.iter().filter(|companion| companion.parent() == path.parent());
        beside.filter(settles).cloned().collect()
    }

    /// The settings that were seen for a pattern, in any spelling and form of their name.
    pub(crate) fn sidecar_of(&self, pattern: &Path) -> Option<PathBuf> {
        self.companion_of(pattern, is_sidecar)
    }

    /// The list that was seen for a pattern, in any spelling and form of its name.
    pub(crate) fn list_of(&self, pattern: &Path) -> Option<PathBuf> {
        self.companion_of(pattern, is_list)
    }

    /// Misnamed settings or a misnamed list of a pattern, with the path that the file should have. One that is there under the
    /// right name is used.
    pub(crate) fn misnamed_of(&self, pattern: &Path) -> Option<(PathBuf, PathBuf)> {
        let mut found = self.of_name(pattern).filter_map(|path| Some((path.clone(), well_named(path)?)));
        found.find(|(_, right)| {
            let is_there = if is_list(right) { self.list_of(pattern) } else { self.sidecar_of(pattern) };
            is_there.is_none()
        })
    }

    /// A companion of this kind and of a pattern's name; one in the same folder before others.
    fn companion_of(&self, pattern: &Path, is_meant: impl Fn(&Path) -> bool) -> Option<PathBuf> {
        let found = || self.of_name(pattern).filter(|path| is_meant(path));
        found().find(|path| path.parent() == pattern.parent()).or_else(|| found().next()).cloned()
    }

    /// Whether the drawing that a companion belongs to is there, too.
    pub(crate) fn has_pattern_of(&self, companion: &Path) -> bool {
        self.of_name(companion).any(|path| self.is_pattern(path))
    }

    fn is_pattern(&self, path: &Path) -> bool {
        self.all.get(path).is_some_and(|drop| matches!(drop.meaning, Ok(Meaning::Pattern { .. })))
    }

    /// The patterns and companions of the full name of a drop.
    fn of_name(&self, path: &Path) -> impl Iterator<Item = &PathBuf> {
        let drop = self.all.get(path);
        drop.and_then(|drop| self.by_name.get(&folded_name(&drop.relative))).into_iter().flatten()
    }

    /// Ends the pauses of all drops that wait for another attempt.
    pub(crate) fn free_all(&mut self) {
        for drop in self.all.values_mut() {
            if matches!(drop.block, Block::Until { .. } | Block::UnknownSku) {
                drop.block = Block::Free;
            }
        }
    }

    /// When the next drop after `moment` can be processed, if nothing else happens.
    pub(crate) fn next_due(&self, moment: Moment, times: &SettleTimes) -> Option<Moment> {
        self.all.values().filter_map(|drop| self.due(drop, times)).filter(|due| *due > moment).min()
    }

    /// Whether a drop has not settled yet.
    pub(crate) fn any_settles(&self, now: Moment, times: &SettleTimes) -> bool {
        self.all.values().any(|drop| drop.settle.is_settling(now, times))
    }

    /// When the drop can be processed; `None` while something else must happen first.
    fn due(&self, drop: &Drop, times: &SettleTimes) -> Option<Moment> {
        let free = match &drop.block {
            Block::Free => Moment::ZERO,
            Block::Until { moment, .. } => *moment,
            Block::UnknownSku | Block::Unclaimed => return None,
            Block::PartUnderWay => match &drop.meaning {
                Ok(Meaning::Pattern { sku, .. }) if self.has_part(sku) => return None,
                _ => Moment::ZERO,
            },
        };
        Some(free.max(drop.settle.due(times)))
    }

    /// The part of the SKU with what it waits for, if it waits for more than its own rest.
    pub(crate) fn obstacle_of_part(&self, sku: &Sku) -> Option<(String, Reason)> {
        let waits = |drop: &&Drop| match drop.block {
            Block::Until { obstacle, .. } => obstacle != Obstacle::SettingsBeingSaved,
            _ => false,
        };
        let is_part = |drop: &&Drop| matches!(&drop.meaning, Ok(Meaning::Part(of)) if of == sku);
        let part = self.all.values().filter(is_part).find(waits)?;
        Some((with_slashes(&part.relative), part.last_reason.clone()?))
    }

    /// The patterns that wait for the part at `path`, with its SKU.
    pub(crate) fn waiting_for_part(&self, path: &Path) -> Vec<(PathBuf, Sku)> {
        let Some(Ok(Meaning::Part(sku))) = self.all.get(path).map(|part| &part.meaning) else {
            return Vec::new();
        };
        let waiting = self.all.iter().filter(|(_, drop)| drop.block == Block::PartUnderWay);
        let of_sku = waiting
            .filter(|(_, drop)| matches!(&drop.meaning, Ok(Meaning::Pattern { sku: of, .. }) if of == sku));
        of_sku.map(|(path, _)| (path.clone(), sku.clone())).collect()
    }

    /// The SKUs that patterns wait for.
    pub(crate) fn awaited(&self) -> BTreeSet<Sku> {
        let waiting = self.all.values().filter(|drop| drop.block == Block::UnknownSku);
        let skus = waiting.filter_map(|drop| match &drop.meaning {
            Ok(Meaning::Pattern { sku, .. }) => Some(sku.clone()),
            _ => None,
        });
        skus.collect()
    }

    /// Releases the patterns of a SKU that has a surface now.
    pub(crate) fn release(&mut self, known: &Sku) {
        for drop in self.all.values_mut().filter(|drop| drop.block == Block::UnknownSku) {
            if matches!(&drop.meaning, Ok(Meaning::Pattern { sku, .. }) if sku == known) {
                drop.block = Block::Free;
            }
        }
    }

    /// Records a new companion: incomplete drops in its folder are checked again.
    pub(crate) fn companion_arrived(&mut self, companion: &Path) {
        let folder = companion.parent();
        let of_name: BTreeSet<PathBuf> = self.of_name(companion).cloned().collect();
        for (path, drop) in &mut self.all {
            // Comparing folders takes long beside thousands of drops.
            if drop.settle.lacks_companion()
                && (path.parent() == folder || of_name.contains(path))
                && drop.sku().is_some()
            {
                drop.settle.companion_came();
            }
        }
    }

    /// The remaining drops: those that wait for something else, and those that are incomplete.
    pub(crate) fn left(&self) -> (Vec<Waiting>, Vec<Waiting>) {
        let (mut waiting, mut incomplete) = (Vec::new(), Vec::new());
        for (path, drop) in &self.all {
            let (waits_for, mut reason) = drop.waits_for();
            let is_with_drawing = (is_sidecar(path) || is_list(path)) && reason.code == "waits-for-pattern";
            if is_with_drawing && self.has_pattern_of(path) {
                reason = belongs_to_drawing();
            }
            let kind = if waits_for == WaitsFor::Rest { &mut incomplete } else { &mut waiting };
            kind.push(Waiting { drop: with_slashes(&drop.relative), reason, waits_for });
        }
        (waiting, incomplete)
    }
}

/// What a drop changes when it is processed: of several drops with one aim, the newest must be the last.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
enum Aim {
    /// The part of a SKU.
    Shape(Sku),
    /// The drawing of this name.
    Drawing(String),
}

impl Drop {
    fn aim(&self) -> Option<Aim> {
        match &self.meaning {
            Ok(Meaning::Part(sku)) => Some(Aim::Shape(sku.clone())),
            Ok(Meaning::Pattern { name, .. }) => Some(Aim::Drawing(fold(&delivered_as(name)))),
            _ => None,
        }
    }

    /// What it waits for, and the reason for people.
    fn waits_for(&self) -> (WaitsFor, Reason) {
        let reason = || self.last_reason.clone().unwrap_or_else(still_settling);
        match (self.block, &self.lacks) {
            (Block::Free, None) if self.takes_long => (WaitsFor::Turn, waits_for_turn()),
            (Block::Free, lacks) => (WaitsFor::Rest, lacks.clone().unwrap_or_else(still_settling)),
            (Block::Until { obstacle: Obstacle::RefusedPart, .. }, _) => (WaitsFor::AnotherDrop, reason()),
            (Block::Until { .. }, _) => (WaitsFor::Surroundings, reason()),
            (Block::UnknownSku | Block::PartUnderWay | Block::Unclaimed, _) => {
                (WaitsFor::AnotherDrop, reason())
            }
        }
    }

    /// Records that it is incomplete; returns whether the reason is new.
    pub(crate) fn found_incomplete(&mut self, gap: Gap, reason: Reason) -> bool {
        self.settle.found_incomplete(gap);
        (self.block, self.lacks) = (Block::Free, Some(reason.clone()));
        self.set_reason(reason)
    }

    /// Records that it is complete, and a large job.
    pub(crate) fn found_large(&mut self) {
        (self.block, self.lacks, self.takes_long) = (Block::Free, None, true);
    }

    /// Records that it waits; returns whether the reason is new.
    pub(crate) fn wait(&mut self, block: Block, reason: Reason) -> bool {
        self.block = block;
        self.set_reason(reason)
    }

    fn set_reason(&mut self, reason: Reason) -> bool {
        let is_new = self.last_reason.as_ref() != Some(&reason);
        self.last_reason = Some(reason);
        is_new
    }

    /// The SKU that it is a part or pattern of.
    pub(crate) fn sku(&self) -> Option<&Sku> {
        match &self.meaning {
            Ok(Meaning::Part(sku) | Meaning::Pattern { sku, .. }) => Some(sku),
            _ => None,
        }
    }
}

/// The order in which drops of one moment are processed.
fn rank(drop: &Drop) -> u8 {
    match drop.meaning {
        Ok(Meaning::Companion) => 0,
        Ok(Meaning::Part(_)) => 1,
        Ok(Meaning::Pattern { .. }) => 2,
        Err(_) => 3,
    }
}

fn not_a_file() -> Reason {
    Reason::new("not-a-file", "This is a link or a device, not a file.", "Drop the file itself.")
}

/// The reason of a drop that was read and is a large job.
fn waits_for_turn() -> Reason {
    let what = "The file is complete. It is a large job and waits for those before it.";
    Reason::new("waits-for-turn", what, "Wait: it is processed after the large jobs before it.")
}

/// The reason of settings or a list whose drawing is there, too.
fn belongs_to_drawing() -> Reason {
    let what = "The file belongs to the drawing of the same name in the hot folder, which waits, too.";
    let remedy = "Leave it there: isomark files it together with the drawing. Without it, the drawing would be marked differently.";
    Reason::new("waits-for-pattern", what, remedy)
}

fn still_settling() -> Reason {
    let what = "A program may still be writing the file, or other files are processed first.";
    Reason::new("still-settling", what, "Wait: isomark checks it again.")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hotfolder::seen::settle::Stamp;

    #[test]
    fn a_pausing_drop_is_not_overtaken_by_one_with_the_same_result() {
        let hot = Path::new("hot");
        let at = Duration::from_secs;
        let (still, open_ended) = (at(0), at(0));
        let times = SettleTimes { still, open_ended, incomplete: at(9), incomplete_after_close: at(3) };
        let mut drops = Drops::default();
        for name in ["can.glb", "can.stl", "mug.glb", "mug.png", "mug.dxf", "mug@2.dxf", "at-work.dxf"] {
            let stamp = Stamp { size: 1, modified: None, identity: 1 };
            drops.see(hot, Path::new(name), Found::File(stamp), Writer::Closed, at(0), at(0));
        }
        for name in ["can.glb", "mug.png"] {
            drops.get_mut(&hot.join(name)).unwrap().block =
                Block::Until { moment: at(5), pause: at(1), obstacle: Obstacle::Other };
        }
        let ready = |now| -> Vec<_> {
            let ready = drops.ready(at(now), &times, |path| path.ends_with("at-work.dxf"));
            ready.into_iter().map(|(path, _)| path).collect()
        };
        assert_eq!(ready(4), ["mug.glb", "mug@2.dxf"].map(|name| hot.join(name)));
        let all = ["can.glb", "can.stl", "mug.glb", "mug.png", "mug.dxf", "mug@2.dxf"];
        assert_eq!(ready(5), all.map(|name| hot.join(name)));
    }

    /// Whoever removed the settings of a row would have it marked with the values of another one.
    #[test]
    fn settings_whose_drawing_is_there_are_not_to_be_removed() {
        let (at, hot) = (Duration::from_secs, Path::new("hot"));
        let mut drops = Drops::default();
        let see = |drops: &mut Drops, name: &str| {
            let stamp = Stamp { size: 1, modified: None, identity: 1 };
            drops.see(hot, Path::new(name), Found::File(stamp), Writer::Closed, at(0), at(0));
        };
        for name in ["can@l-000001.toml", "can@late.toml", "can/m.toml"] {
            see(&mut drops, name);
            let reason = Reason::new("waits-for-pattern", "It waits.", "Drop it, or remove this file.");
            drops.get_mut(&hot.join(name)).unwrap().wait(Block::Unclaimed, reason);
        }
        see(&mut drops, "can@l-000001.dxf");
        see(&mut drops, "can@M.svg");
        let (waiting, _) = drops.left();
        let remedies: Vec<_> = waiting
            .iter()
            .map(|waiting| (&*waiting.drop, waiting.reason.remedy.contains("remove")))
            .collect();
        assert_eq!(remedies, [("can/m.toml", false), ("can@l-000001.toml", false), ("can@late.toml", true)]);
    }

    #[test]
    fn a_large_drop_that_waits_for_its_turn_is_not_incomplete() {
        let at = Duration::from_secs;
        let mut drops = Drops::default();
        let see = |drops: &mut Drops, size| {
            let stamp = Stamp { size, modified: None, identity: 1 };
            drops.see(
                Path::new("hot"),
                Path::new("can.dxf"),
                Found::File(stamp),
                Writer::Closed,
                at(0),
                at(0),
            );
            let (waiting, incomplete) = drops.left();
            (waiting.len(), incomplete.len())
        };
        assert_eq!(see(&mut drops, 1), (0, 1));
        drops.get_mut(Path::new("hot/can.dxf")).unwrap().found_large();
        assert_eq!(see(&mut drops, 1), (1, 0));
        assert_eq!(see(&mut drops, 2), (0, 1), "a changed file");
    }
}
