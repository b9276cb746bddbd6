//! The differences as a few lines of text: similar changes share a line.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{Display, Formatter};

use super::outline::quantum;
use super::{Change, DiffKind, Direction, DrawingDiff, PathNote};
use crate::printable::on_one_line;

/// Maximum number of lines for each kind of change; one more line summarises the rest.
const MAX_LINES: usize = 8;
/// Maximum number of layers named in a line.
const MAX_LAYERS: usize = 3;

impl Display for DrawingDiff {
    fn fmt(&self, out: &mut Formatter<'_>) -> std::fmt::Result {
        let mut lines = self.lines();
        if self.unchanged > 0 || lines.is_empty() {
            let rest = if lines.is_empty() { "no difference: " } else { "" };
            lines.push(format!("{rest}{} unchanged", paths(self.unchanged)));
        }
        let lines: Vec<String> = lines.iter().map(|line| on_one_line(line)).collect();
        write!(out, "{}", lines.join("\n"))
    }
}

impl DrawingDiff {
    /// The changes as text, one line for each group of similar changes; empty if nothing changed.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut lines = self.moved();
        lines.extend(self.reshaped());
        lines.extend(self.grouped("resized", |change| match change {
            Change::Resized { from, to, .. } => Some(resized(*from, *to)),
            _ => None,
        }));
        lines.extend(self.grouped("recoloured", |change| match change {
            Change::Recoloured { from, to, .. } => Some(format!("recoloured from {from} to {to}")),
            _ => None,
        }));
        lines.extend(self.grouped("moved to other layers", |change| match change {
            Change::Relayered { to, .. } => Some(format!("moved to layer {to}")),
            _ => None,
        }));
        lines.extend(self.reordered());
        for word in ["added", "removed"] {
            lines.extend(self.grouped(word, |change| {
                let is_meant = match change {
                    Change::Added { .. } => word == "added",
                    Change::Removed { .. } => word == "removed",
                    _ => false,
                };
                is_meant.then(|| word.to_owned())
            }));
        }
        lines
    }

    /// One line for each layer and phrase; `summary` is the phrase for all that have no separate line.
    fn grouped(&self, summary: &str, phrase: impl Fn(&Change) -> Option<String>) -> Vec<String> {
        let mut groups: BTreeMap<(&str, String), Vec<&PathNote>> = BTreeMap::new();
        for change in &self.entries {
            if let Some(phrase) = phrase(change) {
                groups.entry((&change.what().layer, phrase)).or_default().push(change.what());
            }
        }
        let mut groups: Vec<_> = groups.into_iter().collect();
        groups.sort_by_key(|(_, notes)| std::cmp::Reverse(notes.len()));
        let more: usize = groups.iter().skip(MAX_LINES).map(|(_, notes)| notes.len()).sum();
        groups.truncate(MAX_LINES);
        let line = |((_, phrase), notes): &((&str, String), Vec<&PathNote>)| {
            let subject = if phrase == "added" { some(notes) } else { self.subject(notes) };
            format!("{subject} {phrase}")
        };
        let mut lines: Vec<String> = groups.iter().map(line).collect();
        lines.extend((more > 0).then(|| format!("{} {summary}", more_paths(more))));
        lines
    }

    fn moved(&self) -> Vec<String> {
        let mut groups: BTreeMap<[i64; 2], Vec<(&PathNote, [f64; 2])>> = BTreeMap::new();
        for change in &self.entries {
            if let Change::Moved { what, by, .. } = change {
                groups.entry(quantum(*by, self.tolerance)).or_default().push((what, *by));
            }
        }
        let total: usize = groups.values().map(Vec::len).sum();
        let groups = with_neighbours(groups);
        // Among many moves in all directions, small groups are coincidences and get no separate line.
        let is_listed = |group: &Vec<_>| groups.len() <= MAX_LINES || group.len() * 10 >= total;
        let (listed, more): (Vec<_>, Vec<_>) = groups.iter().partition(|group| is_listed(group));
        let mut lines: Vec<String> = Vec::new();
        for group in listed {
            let notes: Vec<&PathNote> = group.iter().map(|(what, _)| *what).collect();
            lines.push(format!("{} moved by {}", self.subject(&notes), step(group[0].1, notes.len())));
        }
        if !more.is_empty() {
            let lengths = more.iter().copied().flatten().map(|(_, [x, y])| x.hypot(*y));
            let (min, max) = lengths.fold((f64::INFINITY, 0.0), |(a, b), x| (f64::min(a, x), f64::max(b, x)));
            let notes: Vec<&PathNote> = more.iter().copied().flatten().map(|(what, _)| *what).collect();
            let subject = if lines.is_empty() { self.subject(&notes) } else { more_paths(notes.len()) };
            lines.push(format!("{subject} moved by {} to {}", length(min), length(max)));
        }
        lines
    }

    fn reshaped(&self) -> Vec<String> {
        let mut groups: BTreeMap<&str, (Vec<&PathNote>, f64)> = BTreeMap::new();
        for change in &self.entries {
            if let Change::Reshaped { what, deviation } = change {
                let (notes, worst) = groups.entry(&what.layer).or_default();
                notes.push(what);
                *worst = worst.max(*deviation);
            }
        }
        let line = |(notes, worst): &(Vec<&PathNote>, f64)| {
            format!("{} reshaped by up to {}", self.subject(notes), length(*worst))
        };
        let mut lines: Vec<String> = groups.values().take(MAX_LINES).map(line).collect();
        let more = || groups.values().skip(MAX_LINES);
        if more().count() > 0 {
            let count = more().map(|(notes, _)| notes.len()).sum();
            let worst = more().fold(0.0, |worst, (_, here)| f64::max(worst, *here));
            lines.push(format!("{} reshaped by up to {}", more_paths(count), length(worst)));
        }
        lines
    }

    fn reordered(&self) -> Vec<String> {
        let moves = self.entries.iter().filter_map(|change| match change {
            Change::Reordered { what, from, to } => Some((what, from, to)),
            _ => None,
        });
        let moves: Vec<_> = moves.collect();
        match moves.as_slice() {
            [] => Vec::new(),
            [(what, from, to)] => {
                vec![format!(
                    "{} drawn at position {to} in the order instead of {from}",
                    self.subject(&[*what])
                )]
            }
            _ => {
                let notes: Vec<_> = moves.iter().map(|(what, _, _)| *what).collect();
                vec![format!("{} drawn in another order", self.subject(&notes))]
            }
        }
    }

    /// The subject of a line about old paths.
    fn subject(&self, notes: &[&PathNote]) -> String {
        if notes.len() > 1 && notes.len() == self.old_paths {
            return format!("all {}", paths(notes.len()));
        }
        some(notes)
    }
}

impl Display for Direction {
    fn fmt(&self, out: &mut Formatter<'_>) -> std::fmt::Result {
        out.write_str(match self {
            Self::Right => "to the right",
            Self::UpRight => "up and to the right",
            Self::Up => "up",
            Self::UpLeft => "up and to the left",
            Self::Left => "to the left",
            Self::DownLeft => "down and to the left",
            Self::Down => "down",
            Self::DownRight => "down and to the right",
        })
    }
}

/// One path with its place, or the number of paths with their layers.
fn some(notes: &[&PathNote]) -> String {
    let [note] = notes else {
        let layers: BTreeSet<&str> = notes.iter().map(|note| note.layer.as_str()).collect();
        let named: Vec<&str> = layers.iter().copied().take(MAX_LAYERS).collect();
        return match layers.len() - named.len() {
            0 if named.len() == 1 => format!("layer {}: {}", named[0], paths(notes.len())),
            0 => format!("layers {}: {}", named.join(", "), paths(notes.len())),
            more => format!("layers {} and {more} more: {}", named.join(", "), paths(notes.len())),
        };
    };
    let what = match note.kind {
        DiffKind::Dot => "dot".to_owned(),
        DiffKind::Open => format!("open path of {} vertices", thousands(note.vertices)),
        DiffKind::Closed => format!("closed path of {} vertices", thousands(note.vertices)),
    };
    let [x, y] = note.center.map(|place| format!("{:.1}", place + 0.0));
    format!("layer {}: {what} near ({x}, {y}) mm", note.layer)
}

/// The groups of moves, largest first, each merged with the smaller groups that differ from it only by rounding.
fn with_neighbours<T>(groups: BTreeMap<[i64; 2], Vec<T>>) -> Vec<Vec<T>> {
    let mut by_size: Vec<_> = groups.into_iter().collect();
    by_size.sort_by_key(|(_, members)| std::cmp::Reverse(members.len()));
    let mut places: BTreeMap<[i64; 2], usize> = BTreeMap::new();
    let mut joined: Vec<Vec<T>> = Vec::new();
    for ([x, y], mut members) in by_size {
        let around = (-1..=1).flat_map(|up| (-1..=1).map(move |right| [x + right, y + up]));
        let found = around.filter_map(|place| places.get(&place).copied()).min();
        match found {
            Some(index) => joined[index].append(&mut members),
            None => {
                places.insert([x, y], joined.len());
                joined.push(members);
            }
        }
    }
    joined
}

/// A move of `count` paths: its length and direction, or its two components if several paths moved diagonally.
fn step(by: [f64; 2], count: usize) -> String {
    let [x, y] = by;
    let distance = length(x.hypot(y));
    match Direction::of(by) {
        direction @ (Direction::Right | Direction::Up | Direction::Left | Direction::Down) => {
            format!("{distance} {direction}")
        }
        direction if count == 1 => format!("{distance} {direction}"),
        _ => {
            let decimals = decimals(x.hypot(y));
            format!("({x:.decimals$}, {y:.decimals$}) mm")
        }
    }
}

fn resized(from: [f64; 2], to: [f64; 2]) -> String {
    let smallest =
        (0..2).map(|axis| (from[axis] - to[axis]).abs()).filter(|change| *change > 0.0).fold(1.0, f64::min);
    let digits = decimals(smallest);
    let [old, new] = [from, to].map(|[width, height]| format!("{width:.digits$} × {height:.digits$} mm"));
    format!("resized from {old} to {new}")
}

/// A length with as many decimals as its size requires.
fn length(millimetres: f64) -> String {
    let decimals = decimals(millimetres);
    format!("{millimetres:.decimals$} mm")
}

fn decimals(millimetres: f64) -> usize {
    match millimetres {
        length if length >= 0.095 => 2,
        length if length >= 0.0095 => 3,
        length if length >= 0.00095 => 4,
        _ => 6,
    }
}

fn paths(count: usize) -> String {
    format!("{} {}", thousands(count), if count == 1 { "path" } else { "paths" })
}

fn more_paths(count: usize) -> String {
    format!("{} more {}", thousands(count), if count == 1 { "path" } else { "paths" })
}

/// A count with a comma after every three digits.
fn thousands(count: usize) -> String {
    let digits = count.to_string();
    let groups: Vec<&[u8]> = digits.as_bytes().rchunks(3).rev().collect();
    groups.into_iter().map(String::from_utf8_lossy).collect::<Vec<_>>().join(",")
}
