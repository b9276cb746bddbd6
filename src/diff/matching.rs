//! Pairs the paths of the old drawing with those of the new one.

use std::collections::{BTreeMap, BTreeSet};

use similar::DiffOp;

use super::DiffKind;
use super::in_order::{numbered, operations};
use super::outline::{Outline, quantum};

/// Maximum number of groups of paths that moved together.
const MAX_GROUPS: usize = 12;
/// A common move must explain at least one in this many of the remaining paths.
const GROUP_SHARE: usize = 20;
/// Maximum number of pairs of equal shapes that vote for a common move.
const VOTES: usize = 64;
/// Number of common moves that are tried in each round.
const CANDIDATES: usize = 4;
/// Groups with at most this many possible pairs are matched by sorting all distances.
const MAX_PAIRS: usize = 4096;
/// Maximum number of rings of cells, and of paths in a cell, in the search for the nearest partner.
const MAX_RINGS: i64 = 12;
const MAX_IN_CELL: usize = 64;

/// A path of the old drawing and its partner in the new one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pair {
    pub(super) old: usize,
    pub(super) new: usize,
    pub(super) found: Found,
}

/// What the two paths of a pair have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Found {
    /// Everything, in the same order.
    InPlace,
    /// Everything except the position in the drawing order.
    OutOfOrder,
    /// The lines, but not the layer or the colour.
    SameLines,
    /// The shape, but not the place.
    SameShape,
    /// Kind and layer; the change of the shape is still to be determined.
    Alike,
}

/// The pairs of two drawings; the same pairs when the drawings are swapped.
pub(super) fn pairs(old: &[Outline<'_>], new: &[Outline<'_>], tolerance: f64) -> Vec<Pair> {
    let [old, new] = items(old, new);
    // The steps below prefer one side if several partners are equally good. A fixed side makes the result symmetric.
    let content = |items: &[Item]| items.iter().map(Item::content).collect::<Vec<_>>();
    let is_swapped = content(&old) > content(&new);
    let items = if is_swapped { [new, old] } else { [old, new] };
    let free = [0, 1].map(|side| (0..items[side].len()).collect());
    let mut matching = Matching { items, tolerance, free, pairs: Vec::new() };
    matching.run();
    let mut pairs = matching.pairs;
    if is_swapped {
        pairs.iter_mut().for_each(|pair| std::mem::swap(&mut pair.old, &mut pair.new));
    }
    pairs
}

/// The properties of a path that pairing compares: equal values have equal numbers in both drawings.
#[derive(Clone, Copy)]
struct Item {
    lines: usize,
    shape: usize,
    kind: DiffKind,
    layer: usize,
    color: usize,
    vertices: usize,
    center: [f64; 2],
    size: [f64; 2],
}

impl Item {
    fn content(&self) -> [usize; 4] {
        [self.lines, self.kind as usize, self.layer, self.color]
    }

    /// Whether one path may be the other one reshaped: close for their size, and of similar size.
    fn may_become(&self, other: &Self) -> bool {
        let [size, other_size] = [self.size, other.size].map(|size| size[0].hypot(size[1]));
        let [small, large] = [size.min(other_size), size.max(other_size)];
        distance(self.center, other.center) <= large && large <= 3.0 * small
    }
}

fn items(old: &[Outline<'_>], new: &[Outline<'_>]) -> [Vec<Item>; 2] {
    let sides = [old, new];
    let lines = numbered(sides, |outline| &outline.lines);
    let shapes = numbered(sides, |outline| &outline.shape);
    let layers = numbered(sides, |outline| &outline.path.layer);
    let colors = numbered(sides, |outline| &outline.path.color);
    [0, 1].map(|side| {
        let items = sides[side].iter().enumerate().map(|(index, outline)| Item {
            lines: lines[side][index],
            shape: shapes[side][index],
            kind: outline.path.kind,
            layer: layers[side][index],
            color: colors[side][index],
            vertices: outline.path.points.len(),
            center: outline.center,
            size: outline.size,
        });
        items.collect()
    })
}

struct Matching {
    items: [Vec<Item>; 2],
    tolerance: f64,
    /// Paths without a partner, in drawing order.
    free: [Vec<usize>; 2],
    pairs: Vec<Pair>,
}

/// Free paths of both drawings that could be partners.
type Class = [Vec<usize>; 2];

impl Matching {
    fn run(&mut self) {
        self.in_order();
        self.equal(Found::OutOfOrder, |item| item.content());
        self.equal(Found::SameLines, |item| [item.lines, item.kind as usize, item.layer]);
        self.equal(Found::SameLines, |item| [item.lines, item.kind as usize, item.color]);
        self.equal(Found::SameLines, |item| [item.lines, item.kind as usize]);
        let same_shape = |item: &Item| [item.shape, item.kind as usize, item.layer, item.color];
        for _ in 0..MAX_GROUPS {
            if !self.moved_together(&self.classes(same_shape)) {
                break;
            }
        }
        self.nearest(Found::SameShape, same_shape);
        self.nearest(Found::SameShape, |item| [item.shape, item.kind as usize]);
        self.nearest(Found::Alike, |item| [item.kind as usize, item.layer, item.color, item.vertices]);
        self.nearest(Found::Alike, |item| [item.kind as usize, item.layer, item.color]);
        self.nearest(Found::Alike, |item| [item.kind as usize]);
    }

    /// Pairs the paths that are equal in both drawing orders, found by `similar`.
    fn in_order(&mut self) {
        let [first, second] =
            [0, 1].map(|side| self.items[side].iter().map(Item::content).collect::<Vec<_>>());
        for operation in operations(&first, &second) {
            if let DiffOp::Equal { old_index, new_index, len } = operation {
                let steps = (0..len).map(|step| (old_index + step, new_index + step));
                self.pairs.extend(steps.map(|(old, new)| Pair { old, new, found: Found::InPlace }));
            }
        }
        self.remove_paired();
    }

    /// Pairs paths with equal keys, in drawing order.
    fn equal<const N: usize>(&mut self, found: Found, key: impl Fn(&Item) -> [usize; N]) {
        for [old, new] in self.classes(key) {
            self.pairs.extend(old.into_iter().zip(new).map(|(old, new)| Pair { old, new, found }));
        }
        self.remove_paired();
    }

    /// Finds the move that explains most of the remaining paths, and pairs the paths that made it.
    fn moved_together(&mut self, classes: &[Class]) -> bool {
        let remaining: usize = classes.iter().map(|[old, new]| old.len().min(new.len())).sum();
        let needed = (remaining / GROUP_SHARE).max(2);
        let mut votes: BTreeMap<[i64; 2], (usize, [f64; 2])> = BTreeMap::new();
        for [old, new] in classes {
            for (old, new) in voters(old, new) {
                let step = self.step(old, new);
                votes.entry(quantum(step, self.tolerance)).or_insert((0, step)).0 += 1;
            }
        }
        let mut candidates: Vec<(usize, [f64; 2])> = votes.into_values().collect();
        candidates.sort_by(|a, b| {
            let length = |step: [f64; 2]| step[0].hypot(step[1]);
            b.0.cmp(&a.0).then(length(a.1).total_cmp(&length(b.1))).then(a.1[0].total_cmp(&b.1[0]))
        });
        let mut best: Vec<Pair> = Vec::new();
        for (_, step) in candidates.into_iter().take(CANDIDATES) {
            let explained: Vec<Pair> = classes.iter().flat_map(|class| self.explained(class, step)).collect();
            if explained.len() > best.len() {
                best = explained;
            }
        }
        let is_found = best.len() >= needed;
        if is_found {
            self.pairs.append(&mut best);
            self.remove_paired();
        }
        is_found
    }

    /// The pairs of a class whose paths are `step` apart.
    fn explained(&self, [old, new]: &Class, step: [f64; 2]) -> Vec<Pair> {
        let mut places: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
        let cell = 8.0 * self.tolerance;
        for index in new.iter().rev() {
            places.entry(quantum(self.items[1][*index].center, cell)).or_default().push(*index);
        }
        let mut pairs = Vec::new();
        for index in old {
            let center = self.items[0][*index].center;
            let target = [center[0] + step[0], center[1] + step[1]];
            let around =
                [-1.0, 1.0].map(|side| quantum(target.map(|place| place + side * self.tolerance), cell));
            let cells = (around[0][0]..=around[1][0])
                .flat_map(|x| (around[0][1]..=around[1][1]).map(move |y| [x, y]));
            for cell in cells {
                let Some(here) = places.get_mut(&cell) else { continue };
                let is_near = |new: usize| distance(self.items[1][new].center, target) <= self.tolerance;
                let found = here.iter().rev().take(MAX_IN_CELL).position(|new| is_near(*new));
                if let Some(position) = found {
                    let new = here.remove(here.len() - 1 - position);
                    pairs.push(Pair { old: *index, new, found: Found::SameShape });
                    break;
                }
            }
        }
        pairs
    }

    /// Pairs paths with equal keys by the distance of their centres and the difference of their sizes.
    fn nearest<const N: usize>(&mut self, found: Found, key: impl Fn(&Item) -> [usize; N]) {
        for [old, new] in self.classes(key) {
            let chosen = if old.len() * new.len() <= MAX_PAIRS {
                self.nearest_of_all(&old, &new, found)
            } else {
                self.nearest_in_cells(&old, &new, found)
            };
            self.pairs.extend(chosen.into_iter().map(|(old, new)| Pair { old, new, found }));
        }
        self.remove_paired();
    }

    fn nearest_of_all(&self, old: &[usize], new: &[usize], found: Found) -> Vec<(usize, usize)> {
        let all = old.iter().flat_map(|old| new.iter().map(|new| (*old, *new)));
        let mut all: Vec<_> = all.filter(|(old, new)| self.is_possible(*old, *new, found)).collect();
        all.sort_by(|a, b| self.difference(*a).total_cmp(&self.difference(*b)).then(a.cmp(b)));
        let mut taken = [BTreeSet::new(), BTreeSet::new()];
        all.retain(|(old, new)| {
            let is_free = !taken[0].contains(old) && !taken[1].contains(new);
            if is_free {
                taken[0].insert(*old);
                taken[1].insert(*new);
            }
            is_free
        });
        all
    }

    /// Searches round each path on a grid with about one partner in each cell.
    fn nearest_in_cells(&self, old: &[usize], new: &[usize], found: Found) -> Vec<(usize, usize)> {
        let centers = || new.iter().map(|index| self.items[1][*index].center);
        let span = [0, 1].map(|axis| {
            let coordinates = || centers().map(|center| center[axis]);
            coordinates().fold(f64::NEG_INFINITY, f64::max) - coordinates().fold(f64::INFINITY, f64::min)
        });
        let cell = (span[0].max(span[1]) / (new.len() as f64).sqrt()).max(self.tolerance);
        let mut places: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
        for index in new.iter().rev() {
            places.entry(quantum(self.items[1][*index].center, cell)).or_default().push(*index);
        }
        let mut chosen = Vec::new();
        for index in old {
            let center = self.items[0][*index].center;
            let [x, y] = quantum(center, cell);
            let mut best: Option<(f64, [i64; 2], usize)> = None;
            for ring in 0..=MAX_RINGS {
                if best.is_some_and(|(nearest, ..)| nearest <= (ring - 1).max(0) as f64 * cell) {
                    break;
                }
                for place in ring_cells([x, y], ring) {
                    let Some(here) = places.get(&place) else { continue };
                    for (position, new) in here.iter().enumerate().rev().take(MAX_IN_CELL) {
                        let difference = self.difference((*index, *new));
                        let is_nearer = best.is_none_or(|(nearest, ..)| difference < nearest);
                        if is_nearer && self.is_possible(*index, *new, found) {
                            best = Some((difference, place, position));
                        }
                    }
                }
            }
            if let Some((_, place, position)) = best
                && let Some(here) = places.get_mut(&place)
            {
                chosen.push((*index, here.remove(position)));
            }
        }
        chosen
    }

    /// Distance of two paths plus the difference of their sizes, mm.
    fn difference(&self, (old, new): (usize, usize)) -> f64 {
        let (old, new) = (&self.items[0][old], &self.items[1][new]);
        distance(old.center, new.center) + distance(old.size, new.size)
    }

    fn is_possible(&self, old: usize, new: usize, found: Found) -> bool {
        found != Found::Alike || self.items[0][old].may_become(&self.items[1][new])
    }

    /// The vector from the centre of a path to that of a possible partner, mm.
    fn step(&self, old: usize, new: usize) -> [f64; 2] {
        let (from, to) = (self.items[0][old].center, self.items[1][new].center);
        [to[0] - from[0], to[1] - from[1]]
    }

    /// The free paths grouped by key; groups with paths from only one drawing are omitted.
    fn classes<const N: usize>(&self, key: impl Fn(&Item) -> [usize; N]) -> Vec<Class> {
        let mut classes: BTreeMap<[usize; N], Class> = BTreeMap::new();
        for side in [0, 1] {
            for index in &self.free[side] {
                classes.entry(key(&self.items[side][*index])).or_default()[side].push(*index);
            }
        }
        classes.into_values().filter(|[old, new]| !old.is_empty() && !new.is_empty()).collect()
    }

    /// Removes the paths that have a partner from the free ones.
    fn remove_paired(&mut self) {
        let mut is_free = [0, 1].map(|side| vec![true; self.items[side].len()]);
        for pair in &self.pairs {
            is_free[0][pair.old] = false;
            is_free[1][pair.new] = false;
        }
        for (free, is_free) in self.free.iter_mut().zip(is_free) {
            free.retain(|index| is_free[*index]);
        }
    }
}

/// The pairs of a class that vote: all pairs of a small class; for a large class, pairs in order from both ends.
fn voters(old: &[usize], new: &[usize]) -> Vec<(usize, usize)> {
    if old.len() * new.len() <= VOTES {
        return old.iter().flat_map(|old| new.iter().map(|new| (*old, *new))).collect();
    }
    let forward = old.iter().zip(new).take(VOTES);
    let backward = old.iter().rev().zip(new.iter().rev()).take(VOTES);
    forward.chain(backward).map(|(old, new)| (*old, *new)).collect()
}

/// The cells at `ring` steps from a cell.
fn ring_cells([x, y]: [i64; 2], ring: i64) -> impl Iterator<Item = [i64; 2]> {
    let rows = -ring..=ring;
    rows.flat_map(move |up| {
        let is_edge = up.abs() == ring;
        let stride = if is_edge { 1 } else { (2 * ring).max(1) as usize };
        (-ring..=ring).step_by(stride).map(move |right| [x.saturating_add(right), y.saturating_add(up)])
    })
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (b[0] - a[0]).hypot(b[1] - a[1])
}
