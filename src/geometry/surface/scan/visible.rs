//! Assigns the points of a scan to the surfaces that face the laser.
//!
//! The view is divided into square cells a little wider than the point spacing. In every cell, the uppermost points
//! that are confirmed by their neighbourhood are visible, points below them are hidden, and single points above are
//! strays. Neighbouring cells belong to one region unless the height jumps between them: part and table, or two
//! levels of a part, are smoothed separately.

use nalgebra::{Matrix2, Point3, Vector2};

use super::cells::{CELL, Cells, TO_DEVIATION, extents_of, median};
use super::{ScanError, behind};
use crate::geometry::height_field::STEEPEST_SURFACE;
use crate::geometry::space::Extents;

/// Share of the points that may be far outside on each side.
const FAR: f64 = 0.01;
/// Share of the neighbours of occupied cells that must be occupied too; otherwise cells are widened. A small disc has
/// 0.75.
const FILLED: f64 = 0.7;
/// Share of the points round a point that must be near its height.
const SUPPORT: f64 = 0.15;
/// For [`SUPPORT`], at most this many times the usual number of points is counted in a cell: a steep side has
/// many points under one another.
const MOST_OF_USUAL: f64 = 2.0;
/// Side of the cells of the first look, in units of the side for all points. Points on undersides and steep
/// sides make the cells for all points narrower than the points on the visible surface require.
const FIRST_LOOK: f64 = 3.0;
/// The first look determines the spacing again if it hides more than this share of the points.
const NOTABLE_HIDDEN: f64 = 0.1;
/// A cell is a gap between the points of the surface if at least this many of the 24 cells round it are above
/// it by more than the steepest surface climbs. There the laser meets the surface, and the points in the cell
/// are behind it. In the corner of two cliffs, 16 cells are above.
const ROUND_GAP: usize = 17;
/// Minimum number of points of a region.
pub(super) const MIN_POINTS: usize = 64;
/// Maximum number of regions; smaller ones are debris.
const MAX_REGIONS: usize = 16;
/// Heights that scatter by more than this about their neighbours form no surface, in sides of a cell.
pub(super) const ROUGHEST: f64 = 4.0;
/// A point of the surface is at most this many times as far below the top of its cell as the slopes there fall over a cell.
const OF_SLOPE: f64 = 1.25;
/// It may be this share of a cell lower, for the curvature of the surface.
const OF_CELL: f64 = 0.3;
/// Points that support the top of a cell are at most this many times as far from its height as they may be away.
const STEEPEST_TOP: f64 = 1.2;
/// Deviations beyond this many standard deviations are not noise.
const BEYOND_NOISE: f64 = 6.0;

/// The points of one surface, including those that may belong to it.
pub(super) struct Region {
    /// The points, mm.
    pub(super) points: Vec<Point3<f64>>,
    /// The cell of each.
    pub(super) cells: Vec<usize>,
    /// Whether the point is certainly on the surface; the others are compared with the fit.
    pub(super) trusted: Vec<bool>,
}

/// The points of a scan, assigned to surfaces.
pub(super) struct Seen {
    /// Surfaces that face the laser, ordered by the number of points, largest first.
    pub(super) regions: Vec<Region>,
    pub(super) cells: Cells,
    /// Number of points below a surface.
    pub(super) hidden: usize,
}

/// The surface in a cell.
#[derive(Clone, Copy)]
struct Cell {
    /// Height of the surface, mm; NaN in an empty cell.
    height: f64,
    /// Its slope, towards the flatter side along each axis.
    slope: f64,
}

/// Assigns the points, which are given in the view, to surfaces.
pub(super) fn separate_surfaces(points: &[Point3<f64>]) -> Result<Seen, ScanError> {
    if points.len() < MIN_POINTS {
        return Err(ScanError::TooFewPoints { points: points.len(), needed: MIN_POINTS });
    }
    let extents = middle(points);
    let inside: Vec<u32> =
        (0..points.len() as u32).filter(|&at| extents.contains(points[at as usize].coords.xy())).collect();
    has_area(points, &inside)?;
    let behind = behind::behind_others(points, &inside);
    let inside: Vec<u32> = inside.into_iter().filter(|&at| !behind[at as usize]).collect();
    let (cells, Look { tops: surface_tops, known, mut hidden, noise, reaches }) = resolved(points, &inside)?;
    let surface: Vec<Cell> = (0..cells.count())
        .map(|cell| Cell {
            height: known[cell],
            slope: slopes(&cells, &known, cell, reaches[cell]).map(|s| s * s).iter().sum::<f64>().sqrt(),
        })
        .collect();
    let labels = connected(&cells, &surface, &reaches, noise);
    hide_steep(&cells, &surface, &labels, &mut hidden);
    let regions = regions(&cells, points, &labels, &surface_tops, &hidden);
    if regions.is_empty() {
        return Err(ScanError::NoSurface { points: points.len() });
    }
    let hidden = hidden.iter().zip(&behind).filter(|(hidden, behind)| **hidden || **behind).count();
    Ok(Seen { regions, cells, hidden })
}

/// What a view of the points shows in cells of one size.
struct Look {
    /// For each cell, its uppermost supported height, mm; NaN without one.
    tops: Vec<f64>,
    /// For each cell, the median height of its visible points, mm; NaN without one.
    known: Vec<f64>,
    /// For each point, whether it is below a surface.
    hidden: Vec<bool>,
    /// Deviation of the heights from those round them, mm: no less than the noise.
    noise: f64,
    /// For each cell, within how many cells the next points are: more than 1 where they are sparse.
    reaches: Vec<usize>,
}

/// Cells that are as wide as the visible points require, and what they show.
fn resolved(points: &[Point3<f64>], inside: &[u32]) -> Result<(Cells, Look), ScanError> {
    let narrow = side_of(points, inside, inside);
    let first = look(points, &Cells::new(points, inside, narrow * FIRST_LOOK))?;
    let visible: Vec<u32> = inside.iter().copied().filter(|&at| !first.hidden[at as usize]).collect();
    let hides = (inside.len() - visible.len()) as f64 > NOTABLE_HIDDEN * inside.len() as f64;
    let side = if hides { side_of(points, &visible, inside).max(narrow) } else { narrow };
    let cells = Cells::new(points, inside, side);
    let look = look(points, &cells)?;
    Ok((cells, look))
}

fn look(points: &[Point3<f64>], cells: &Cells) -> Result<Look, ScanError> {
    let highest = |cell: usize| cells.points(cell).first().map_or(f64::NAN, |&at| points[at as usize].z);
    let noise = roughness(cells, &(0..cells.count()).map(highest).collect::<Vec<_>>());
    if !(noise <= ROUGHEST * cells.side()) {
        return Err(ScanError::NoSurface { points: points.len() });
    }
    let mut counts: Vec<f64> =
        (0..cells.count()).map(|cell| cells.points(cell).len() as f64).filter(|count| *count > 0.0).collect();
    let usual = median(&mut counts).unwrap_or(0.0);
    let sparseness = cells.sparseness(|cell| cells.points(cell).len());
    let reaches: Vec<usize> = sparseness.iter().map(|times| times.ceil() as usize).collect();
    let mut tops: Vec<f64> = (0..cells.count())
        .map(|cell| supported_top(cells, points, cell, reaches[cell], noise, usual))
        .collect();
    let mut hidden = vec![false; points.len()];
    let gaps: Vec<usize> = (0..cells.count()).filter(|&cell| is_gap(cells, &tops, cell, noise)).collect();
    for cell in gaps {
        tops[cell] = f64::NAN;
        cells.points(cell).iter().for_each(|&at| hidden[at as usize] = true);
    }
    let mut known = Vec::with_capacity(cells.count());
    let mut seen = Vec::new();
    for cell in 0..cells.count() {
        let top = tops[cell];
        let [along, across] = slopes(cells, &tops, cell, reaches[cell]);
        let lowest = top - (OF_SLOPE * (along + across) + OF_CELL) * cells.side() - BEYOND_NOISE * noise;
        seen.clear();
        for &at in cells.points(cell) {
            let height = points[at as usize].z;
            if height < lowest {
                hidden[at as usize] = true;
            } else if height <= top {
                seen.push(height);
            }
        }
        known.push(seen.get(seen.len() / 2).copied().unwrap_or(f64::NAN));
    }
    Ok(Look { tops, known, hidden, noise, reaches })
}

/// Whether nearly all cells round a cell are above it by more than a surface climbs: then it has no point of that surface.
fn is_gap(cells: &Cells, tops: &[f64], cell: usize, noise: f64) -> bool {
    let offsets = (-2..=2).flat_map(|up| (-2..=2).map(move |right| (right, up)));
    let is_above = |&(right, up): &(isize, isize)| {
        let climb = STEEPEST_SURFACE.tan() * cells.side() * (right as f64).hypot(up as f64);
        let near = cells.neighbour(cell, right, up);
        near.is_some_and(|near| tops[near] - tops[cell] > climb + BEYOND_NOISE * noise)
    };
    offsets.filter(is_above).count() >= ROUND_GAP
}

/// Hides the points of surfaces that are too steep to be marked nearly everywhere: the sides of a part.
fn hide_steep(cells: &Cells, surface: &[Cell], labels: &[u32], hidden: &mut [bool]) {
    let mut counts = vec![[0usize; 2]; labels.iter().max().map_or(0, |last| *last as usize + 1)];
    for (cell, label) in labels.iter().enumerate().filter(|(_, label)| **label != 0) {
        counts[*label as usize][usize::from(surface[cell].slope > STEEPEST_SURFACE.tan())] += 1;
    }
    for (cell, label) in labels.iter().enumerate() {
        let [flat, steep] = counts[*label as usize];
        if steep > flat {
            cells.points(cell).iter().for_each(|&at| hidden[at as usize] = true);
        }
    }
}

/// The rectangle of all points except a few far ones, extended by half its size on every side.
fn middle(points: &[Point3<f64>]) -> Extents {
    let rank = (points.len() as f64 * FAR) as usize;
    let between = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        let low = *values.select_nth_unstable_by(rank, f64::total_cmp).1;
        let high = *values.select_nth_unstable_by(points.len() - 1 - rank, f64::total_cmp).1;
        [low - (high - low) / 2.0, high + (high - low) / 2.0]
    };
    let ([left, right], [bottom, top]) = (between(0), between(1));
    Extents::of([Vector2::new(left, bottom), Vector2::new(right, top)])
}

/// Rejects points in one place or in one line.
fn has_area(points: &[Point3<f64>], inside: &[u32]) -> Result<(), ScanError> {
    let at = |index: &u32| points[*index as usize].coords.xy();
    let mean = inside.iter().map(at).sum::<Vector2<f64>>() / inside.len() as f64;
    let spread = inside.iter().map(|index| (at(index) - mean) * (at(index) - mean).transpose());
    let spread = spread.sum::<Matrix2<f64>>() / inside.len() as f64;
    let deviations = spread.symmetric_eigenvalues().map(|square| square.max(0.0).sqrt());
    // A uniform distribution extends √3 deviations to both sides.
    let [width, length] = [deviations.min(), deviations.max()].map(|deviation| 2.0 * 3f64.sqrt() * deviation);
    if width > length * 1e-3 && length > 1e-2 { Ok(()) } else { Err(ScanError::NoArea { width, length }) }
}

/// The side of cells that are wide enough that few cells between the `chosen` points are empty, over the extents of all points
/// that are `inside`.
fn side_of(points: &[Point3<f64>], chosen: &[u32], inside: &[u32]) -> f64 {
    let extents = extents_of(points, inside);
    let (size, count) = (extents.size(), chosen.len() as f64);
    let grid = |side: f64| ((size.x / side) as usize + 1, (size.y / side) as usize + 1);
    let occupied = |side: f64| {
        let (columns, rows) = grid(side);
        let mut occupied = vec![false; columns * rows];
        for &at in chosen {
            let place = (points[at as usize].coords.xy() - extents.min) / side;
            occupied[place.y as usize * columns + place.x as usize] = true;
        }
        (occupied, columns, rows)
    };
    let mut side = CELL * (size.x * size.y / count).sqrt();
    loop {
        let filled = occupied(side).0.iter().filter(|occupied| **occupied).count() as f64;
        let finer = CELL * side * (filled / count).sqrt();
        let (columns, rows) = grid(finer);
        if finer > 0.9 * side || columns.saturating_mul(rows) > 8 * chosen.len() + 1000 {
            break;
        }
        side = finer;
    }
    loop {
        let (occupied, columns, rows) = occupied(side);
        let (mut neighbours, mut filled) = (0usize, 0usize);
        for row in 1..rows.saturating_sub(1) {
            for column in 1..columns.saturating_sub(1) {
                let at = row * columns + column;
                if occupied[at] {
                    neighbours += 4;
                    let round = [at - 1, at + 1, at - columns, at + columns];
                    filled += round.iter().filter(|&&cell| occupied[cell]).count();
                }
            }
        }
        if filled as f64 >= FILLED * neighbours as f64 {
            break;
        }
        side *= 1.25;
    }
    side
}

/// A robust measure of how far heights deviate from the mean of their neighbours, mm: no less than the noise.
fn roughness(cells: &Cells, heights: &[f64]) -> f64 {
    let mut deviations = Vec::new();
    for cell in 0..cells.count() {
        for (right, up) in [(1, 0), (0, 1)] {
            let before = cells.neighbour(cell, -right, -up);
            let (Some(before), Some(after)) = (before, cells.neighbour(cell, right, up)) else { continue };
            let deviation = heights[cell] - (heights[before] + heights[after]) / 2.0;
            if deviation.is_finite() {
                deviations.push(deviation.abs());
            }
        }
    }
    // For three independent values with deviation 1, this combination has the deviation √1.5.
    median(&mut deviations).map_or(0.0, |median| median * TO_DEVIATION / 1.5f64.sqrt())
}

/// The uppermost point of a cell that has enough points near its height round it; NaN if there is none.
///
/// `usual` is the number of points in most cells; the points round it are within `reach` cells.
fn supported_top(
    cells: &Cells,
    points: &[Point3<f64>],
    cell: usize,
    reach: usize,
    noise: f64,
    usual: f64,
) -> f64 {
    let near = STEEPEST_TOP * cells.side() * reach as f64 + BEYOND_NOISE * noise;
    let around: f64 = cells
        .square(cell, reach)
        .map(|cell| (cells.points(cell).len() as f64).min(MOST_OF_USUAL * usual))
        .sum();
    let needed = (SUPPORT * around).max(2.0);
    let height = |at: u32| points[at as usize].z;
    let is_supported = |&top: &f64| {
        let supporters = cells.square(cell, reach).map(|cell| {
            let inside = cells.points(cell);
            let above = inside.partition_point(|&at| height(at) > top + near);
            inside.partition_point(|&at| height(at) >= top - near) - above
        });
        // The point itself is counted too.
        supporters.sum::<usize>() as f64 > needed
    };
    cells.points(cell).iter().map(|&at| height(at)).find(is_supported).unwrap_or(f64::NAN)
}

/// Slopes along x and y, each towards the flatter side, so that a cliff beside the cell is ignored; 0 if unknown. The next height is
/// within `reach` cells.
fn slopes(cells: &Cells, heights: &[f64], cell: usize, reach: usize) -> [f64; 2] {
    [(1, 0), (0, 1)].map(|(right, up)| {
        let sides = [(right, up), (-right, -up)];
        let climbs = sides.into_iter().filter_map(|(right, up)| {
            let climb = |steps: usize| {
                let away = steps as isize;
                let climb = heights[cells.neighbour(cell, away * right, away * up)?] - heights[cell];
                climb.is_finite().then(|| climb.abs() / (cells.side() * steps as f64))
            };
            (1..=reach).find_map(climb)
        });
        climbs.reduce(f64::min).unwrap_or(0.0)
    })
}

/// A label for each cell, from 1: cells of one surface have the same label; 0 for cells without a surface.
fn connected(cells: &Cells, surface: &[Cell], reaches: &[usize], noise: f64) -> Vec<u32> {
    // As between nodes of a height field: a smooth surface climbs no faster than its slopes, plus a margin for
    // curvature. The smaller slope is used, because an outlier is steep on all sides.
    let joined = |a: Cell, b: Cell, distance: f64| {
        let slope = a.slope.min(b.slope).min(STEEPEST_SURFACE.tan());
        let climb = (2.0 * slope + 1.0) * distance * cells.side();
        (a.height - b.height).abs() <= climb + BEYOND_NOISE * noise
    };
    let mut labels = vec![0; surface.len()];
    let (mut last, mut open) = (0, Vec::new());
    for start in 0..surface.len() {
        if labels[start] != 0 || surface[start].height.is_nan() {
            continue;
        }
        last += 1;
        labels[start] = last;
        open.push(start);
        while let Some(cell) = open.pop() {
            for (right, up) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                // An empty cell is a missing point, not a border.
                let seen = |steps: usize| {
                    let away = steps as isize;
                    let next = cells.neighbour(cell, away * right, away * up)?;
                    (!surface[next].height.is_nan()).then_some((next, steps as f64))
                };
                let next = (1..=2 * reaches[cell]).find_map(seen);
                let Some((next, distance)) = next else { continue };
                if labels[next] == 0 && joined(surface[cell], surface[next], distance) {
                    labels[next] = last;
                    open.push(next);
                }
            }
        }
    }
    labels
}

/// The regions with enough points, the largest first, each with the uncertain points in and next to its cells.
fn regions(
    cells: &Cells,
    points: &[Point3<f64>],
    labels: &[u32],
    tops: &[f64],
    hidden: &[bool],
) -> Vec<Region> {
    let trusted = |cell: usize, at: u32| !hidden[at as usize] && points[at as usize].z <= tops[cell];
    let mut sizes = vec![(0usize, 0u32); labels.iter().max().map_or(0, |last| *last as usize + 1)];
    for cell in 0..cells.count() {
        let size = &mut sizes[labels[cell] as usize];
        *size = (size.0 + cells.points(cell).iter().filter(|at| trusted(cell, **at)).count(), labels[cell]);
    }
    let mut largest: Vec<(usize, u32)> =
        sizes.into_iter().filter(|(size, label)| *label != 0 && *size >= MIN_POINTS).collect();
    largest.sort_by_key(|(size, label)| (std::cmp::Reverse(*size), *label));
    largest.truncate(MAX_REGIONS);
    let mut place = vec![usize::MAX; labels.iter().max().map_or(0, |last| *last as usize + 1)];
    for (index, (_, label)) in largest.iter().enumerate() {
        place[*label as usize] = index;
    }
    let region = |_| Region { points: Vec::new(), cells: Vec::new(), trusted: Vec::new() };
    let mut regions: Vec<Region> = largest.iter().map(region).collect();
    for cell in 0..cells.count() {
        let own = place[labels[cell] as usize];
        // A cell of debris is compared with the largest surface next to it.
        let nearest = || cells.window(cell).map(|near| place[labels[near] as usize]).min();
        let index = if own == usize::MAX { nearest().unwrap_or(own) } else { own };
        let Some(region) = regions.get_mut(index) else { continue };
        for &at in cells.points(cell).iter().filter(|&&at| !hidden[at as usize]) {
            region.points.push(points[at as usize]);
            region.cells.push(cell);
            region.trusted.push(own != usize::MAX && trusted(cell, at));
        }
    }
    regions
}
