//! The inked area of contours.

use std::ops::Range;

use crate::geometry::space::{Extents, FlatPoint};

/// At least this many lines run through the lowest contour, unless [`MAX_CROSSINGS`] or [`MAX_LINES`] would
/// be exceeded.
const LINES: f64 = 64.0;

/// The lines have at most this many crossings with contours.
const MAX_CROSSINGS: f64 = 1e6;
/// There are at most this many lines.
const MAX_LINES: f64 = 1e5;

/// The area inside the contours of any group, by the even-odd rule in each, mm²: the mean length of lines through it, so close that
/// the lowest contour has [`LINES`] of them. `side` is twice their largest distance, mm.
pub(super) fn inside(groups: &[Vec<Vec<FlatPoint>>], extents: &Extents, side: f64) -> f64 {
    let height = extents.size().y;
    let (mut lowest, mut climb) = (f64::INFINITY, 0.0);
    for contour in groups.iter().flatten().filter(|contour| !contour.is_empty()) {
        let across = extents_of(contour).size().y;
        lowest = if across > 0.0 { f64::min(lowest, across) } else { lowest };
        let ends = contour.iter().zip(contour.iter().cycle().skip(1));
        climb += ends.map(|(from, to)| (to.y - from.y).abs()).sum::<f64>();
    }
    let apart = (lowest / LINES).min(side / 2.0).max(climb / MAX_CROSSINGS).max(height / MAX_LINES);
    if !(apart > 0.0 && apart.is_finite()) {
        return 0.0;
    }
    let count = (height / apart).ceil().max(1.0);
    let apart = height / count;
    let line_at = |y: f64| ((y - extents.min.y) / apart - 0.5).ceil().clamp(0.0, count) as usize;
    let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); count as usize];
    let mut inside: Vec<Vec<[f64; 2]>> = vec![Vec::new(); count as usize];
    for group in groups {
        let mut crossed: Option<Range<usize>> = None;
        for contour in group {
            for (from, to) in contour.iter().zip(contour.iter().cycle().skip(1)) {
                let (low, high) = if from.y < to.y { (from, to) } else { (to, from) };
                let lines = line_at(low.y)..line_at(high.y);
                for (line, crossings) in lines.clone().zip(&mut crossings[lines.clone()]) {
                    let y = extents.min.y + (line as f64 + 0.5) * apart;
                    crossings.push(low.x + (high.x - low.x) * ((y - low.y) / (high.y - low.y)));
                }
                crossed = Some(crossed.map_or(lines.clone(), |crossed| {
                    crossed.start.min(lines.start)..crossed.end.max(lines.end)
                }));
            }
        }
        let crossed = crossed.unwrap_or_default();
        for (crossings, inside) in crossings[crossed.clone()].iter_mut().zip(&mut inside[crossed]) {
            crossings.sort_unstable_by(f64::total_cmp);
            inside.extend(crossings.chunks_exact(2).map(|pair| [pair[0], pair[1]]));
            crossings.clear();
        }
    }
    apart * inside.into_iter().map(covered).sum::<f64>()
}

/// The length that pieces of a line cover together, mm.
fn covered(mut pieces: Vec<[f64; 2]>) -> f64 {
    pieces.sort_unstable_by(|one, other| one[0].total_cmp(&other[0]));
    let (mut length, mut reached) = (0.0, f64::NEG_INFINITY);
    for [from, to] in pieces {
        length += (to - from.max(reached)).max(0.0);
        reached = to.max(reached);
    }
    length
}

/// The bounding rectangle of a contour, mm.
pub(super) fn extents_of(contour: &[FlatPoint]) -> Extents {
    Extents::of(contour.iter().map(|at| at.coords()))
}
