//! The differences between two drawings, as text for people and as entries for programs.
//!
//! [`compare`] first finds the paths that are equal in both drawings with `similar`, then pairs the remaining ones:
//! the same lines at another position in the order, on another layer or in another colour; paths that moved together
//! or alone; resized and reshaped paths. A path without a partner was added or removed. A different start of a
//! contour or a different direction of a path is not a change.
//!
//! ```
//! use isomark::diff::{DiffKind, DiffPath, TOLERANCE, compare};
//!
//! let line = |x: f64| DiffPath {
//!     layer: "OUTLINE".into(),
//!     color: "7".into(),
//!     kind: DiffKind::Open,
//!     points: vec![[x, 0.0], [x + 5.0, 2.0]],
//! };
//! let diff = compare(&[line(0.0), line(20.0)], &[line(0.0), line(20.42)], TOLERANCE);
//! assert_eq!(
//!     diff.to_string(),
//!     "layer OUTLINE: open path of 2 vertices near (22.5, 1.0) mm moved by 0.42 mm to the right\n1 path unchanged"
//! );
//! ```

mod path;
mod outline;
mod in_order;
mod matching;
mod words;

use serde::{Deserialize, Serialize};

use crate::geometry::pattern::{Color, Pattern, Shape};
use crate::geometry::space::FlatPoint;
use matching::{Found, Pair};
use outline::{Outline, deviation};

pub use path::{DiffKind, DiffPath, PathNote};

/// Smaller differences, in mm, are ignored by default: drawings are written with a few more digits than this.
pub const TOLERANCE: f64 = 0.001;

/// The lines that differ between two texts: lines of the old text start with `-`, lines of the new one with `+`.
///
/// ```
/// let lines = isomark::diff::text_changes("a = 1\nb = 2\n", "a = 1\nb = 3\n");
/// assert_eq!(lines, ["- b = 2", "+ b = 3"]);
/// ```
#[must_use]
pub fn text_changes(old: &str, new: &str) -> Vec<String> {
    let [old, new]: [Vec<&str>; 2] = [old, new].map(|text| text.lines().map(str::trim_end).collect());
    let removed = |from: usize, len: usize| old[from..from + len].iter().map(|line| format!("- {line}"));
    let added = |from: usize, len: usize| new[from..from + len].iter().map(|line| format!("+ {line}"));
    let mut changed = Vec::new();
    for operation in in_order::operations(&old, &new) {
        let [old, new] = [operation.old_range(), operation.new_range()];
        if operation.tag() != similar::DiffTag::Equal {
            changed.extend(removed(old.start, old.len()));
            changed.extend(added(new.start, new.len()));
        }
    }
    changed
}

/// The differences between an old and a new drawing. [`Display`](std::fmt::Display) gives a few lines, with similar
/// changes combined.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct DrawingDiff {
    /// The tolerance of the comparison, mm.
    pub tolerance: f64,
    /// Number of paths in the old drawing.
    pub old_paths: usize,
    /// Number of paths in the new drawing.
    pub new_paths: usize,
    /// Number of paths that are the same in both.
    pub unchanged: usize,
    /// The changes: those of old paths in the order of the old drawing, then the added paths in the order of the new
    /// one. A path with several changes has an entry for each.
    pub entries: Vec<Change>,
}

/// One change of one path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(tag = "change", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Change {
    /// The path is only in the new drawing.
    Added {
        /// The new path.
        what: PathNote,
    },
    /// The path is only in the old drawing.
    Removed {
        /// The old path.
        what: PathNote,
    },
    /// The path is at another place.
    Moved {
        /// The old path.
        what: PathNote,
        /// Its old centre, mm.
        from: [f64; 2],
        /// Its new centre, mm.
        to: [f64; 2],
        /// The move, mm.
        by: [f64; 2],
        /// The length of the move, mm.
        distance: f64,
        /// The direction of the move.
        direction: Direction,
    },
    /// The path has the same shape but another size.
    Resized {
        /// The old path.
        what: PathNote,
        /// Its old width and height, mm.
        from: [f64; 2],
        /// Its new width and height, mm.
        to: [f64; 2],
    },
    /// The path has another shape.
    Reshaped {
        /// The old path.
        what: PathNote,
        /// The largest distance between the old and the new line, mm; after the move, if there is one.
        deviation: f64,
    },
    /// The path has another colour.
    Recoloured {
        /// The old path.
        what: PathNote,
        /// Its old colour.
        from: String,
        /// Its new colour.
        to: String,
    },
    /// The path is on another layer.
    Relayered {
        /// The old path.
        what: PathNote,
        /// Its old layer.
        from: String,
        /// Its new layer.
        to: String,
    },
    /// The path is at another position in the drawing order.
    Reordered {
        /// The old path.
        what: PathNote,
        /// Its position in the old order, counted from 1.
        from: usize,
        /// Its position in the new order, counted from 1.
        to: usize,
    },
}

/// The direction of a move; it is diagonal if both components are large enough (see [`Direction::of`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[expect(missing_docs, reason = "the names are self-explanatory")]
pub enum Direction {
    Right,
    UpRight,
    Up,
    UpLeft,
    Left,
    DownLeft,
    Down,
    DownRight,
}

/// Compares two drawings; differences of at most `tolerance` mm are ignored (see [`TOLERANCE`]).
///
/// Comparing in the opposite direction gives the same pairs: added paths become removed paths. If many equal paths were
/// shuffled, several descriptions are correct; the result is always the same one.
#[must_use]
pub fn compare(old: &[DiffPath], new: &[DiffPath], tolerance: f64) -> DrawingDiff {
    let tolerance = if tolerance.is_finite() && tolerance > 1e-9 { tolerance } else { 1e-9 };
    let outlines = [old, new].map(|paths| paths.iter().map(|path| Outline::of(path, tolerance)).collect());
    let [old_outlines, new_outlines]: [Vec<Outline<'_>>; 2] = outlines;
    let pairs = matching::pairs(&old_outlines, &new_outlines, tolerance);

    let mut diff = DrawingDiff {
        tolerance,
        old_paths: old.len(),
        new_paths: new.len(),
        unchanged: 0,
        entries: Vec::new(),
    };
    let mut partner = vec![None; old.len()];
    let mut is_new = vec![true; new.len()];
    for Pair { old, new, found } in pairs {
        partner[old] = Some((new, found));
        is_new[new] = false;
    }
    for (index, outline) in old_outlines.iter().enumerate() {
        let before = diff.entries.len();
        match partner[index] {
            None => diff.entries.push(Change::Removed { what: outline.note() }),
            Some((_, Found::InPlace)) => {}
            Some((new, Found::OutOfOrder)) => {
                diff.entries.push(Change::Reordered { what: outline.note(), from: index + 1, to: new + 1 });
            }
            Some((new, found)) => {
                diff.entries.extend(changes(outline, &new_outlines[new], found, tolerance));
            }
        }
        diff.unchanged += usize::from(diff.entries.len() == before);
    }
    let added = new_outlines.iter().zip(is_new).filter(|(_, is_new)| *is_new);
    diff.entries.extend(added.map(|(outline, _)| Change::Added { what: outline.note() }));
    diff
}

/// The paths of a drawing for a comparison, flattened to 0.001 mm; colours by layer are resolved.
#[must_use]
pub fn paths_of(pattern: &Pattern) -> Vec<DiffPath> {
    let paths = pattern.paths.iter().map(|path| {
        let layer = pattern.layers.get(path.layer);
        let color = match (path.color, layer) {
            (Color::ByLayer, Some(layer)) => layer.color,
            (color, _) => color,
        };
        DiffPath {
            layer: layer.map_or_else(|| "0".to_owned(), |layer| layer.name.clone()),
            color: match color {
                Color::ByLayer => "7".to_owned(),
                known => known.to_string(),
            },
            kind: match path.shape {
                Shape::Dot(_) => DiffKind::Dot,
                Shape::Open(_) => DiffKind::Open,
                Shape::Closed(_) => DiffKind::Closed,
            },
            points: path.shape.flattened(1e-3).into_iter().map(|FlatPoint { x, y, .. }| [x, y]).collect(),
        }
    });
    paths.collect()
}

/// The changes of a path that has a partner.
fn changes(old: &Outline<'_>, new: &Outline<'_>, found: Found, tolerance: f64) -> Vec<Change> {
    let mut changes = Vec::new();
    if old.path.layer != new.path.layer {
        let (from, to) = (old.path.layer.clone(), new.path.layer.clone());
        changes.push(Change::Relayered { what: old.note(), from, to });
    }
    if old.path.color != new.path.color {
        let (from, to) = (old.path.color.clone(), new.path.color.clone());
        changes.push(Change::Recoloured { what: old.note(), from, to });
    }
    let by = [new.center[0] - old.center[0], new.center[1] - old.center[1]];
    let distance = by[0].hypot(by[1]);
    let moved = || Change::Moved {
        what: old.note(),
        from: old.center,
        to: new.center,
        by,
        distance,
        direction: Direction::of(by),
    };
    match found {
        Found::InPlace | Found::OutOfOrder | Found::SameLines => return changes,
        Found::SameShape => {
            changes.extend((distance > tolerance).then(moved));
            return changes;
        }
        Found::Alike => {}
    }
    let in_place = deviation(old, new, |point| point);
    let shifted = deviation(old, new, |[x, y]| [x + by[0], y + by[1]]);
    if in_place <= tolerance {
        return changes;
    }
    let factor =
        [0, 1].map(|axis| if old.size[axis] > tolerance { new.size[axis] / old.size[axis] } else { 1.0 });
    let scaled = |point: [f64; 2]| {
        [0, 1].map(|axis| new.center[axis] + (point[axis] - old.center[axis]) * factor[axis])
    };
    if shifted <= tolerance {
        changes.push(moved());
    } else if deviation(old, new, scaled) <= tolerance {
        changes.extend((distance > tolerance).then(moved));
        changes.push(Change::Resized { what: old.note(), from: old.size, to: new.size });
    } else if shifted < 0.5 * in_place {
        changes.push(moved());
        changes.push(Change::Reshaped { what: old.note(), deviation: shifted });
    } else {
        changes.push(Change::Reshaped { what: old.note(), deviation: in_place });
    }
    changes
}

impl Change {
    /// The changed path: the new one if it was added, otherwise the old one.
    #[must_use]
    pub fn what(&self) -> &PathNote {
        match self {
            Self::Added { what }
            | Self::Removed { what }
            | Self::Moved { what, .. }
            | Self::Resized { what, .. }
            | Self::Reshaped { what, .. }
            | Self::Recoloured { what, .. }
            | Self::Relayered { what, .. }
            | Self::Reordered { what, .. } => what,
        }
    }
}

impl Direction {
    /// The direction of a step (x to the right, y up); a component of less than a tenth of the other is ignored.
    #[must_use]
    pub fn of([x, y]: [f64; 2]) -> Self {
        let (is_level, is_upright) = (y.abs() < 0.1 * x.abs(), x.abs() < 0.1 * y.abs());
        match (x >= 0.0, y >= 0.0) {
            (true, _) if is_level => Self::Right,
            (false, _) if is_level => Self::Left,
            (_, true) if is_upright => Self::Up,
            (_, false) if is_upright => Self::Down,
            (true, true) => Self::UpRight,
            (false, true) => Self::UpLeft,
            (false, false) => Self::DownLeft,
            (true, false) => Self::DownRight,
        }
    }
}
