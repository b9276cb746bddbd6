//! Finds the points of a scan that are behind others, as the laser sees them: the underside of a part that
//! was scanned from all sides.
//!
//! Random points leave gaps. A point that is visible through such a gap is behind the surface all the same.
//! So a point is behind the surface if points above it surround it, not only if one is exactly above it
//! (compare Katz, Tal & Basri, Direct visibility of point sets, SIGGRAPH 2007). How far away these points may
//! be follows from the distance between the points there. A wider hole is a real hole, through which the
//! laser meets the surface below.

use nalgebra::{Matrix3, Point3};

use super::cells::{Cells, extents_of, is_surrounded, median, octant};
use crate::geometry::height_field::STEEPEST_SURFACE;
use crate::geometry::surface::summed_area::SummedArea;

/// Side of a cell, in units of the mean distance between the points.
const CELL: f64 = 0.7;
/// Number of points round a point among which those above it must surround it. On one surface, they are at
/// most 2.8 times as far away as the points are apart, so that a groove must be three times as wide as that
/// to be seen. Of this many random points, no octant and both beside it are empty with a probability of
/// 1.6e-4.
const AMONG: usize = 24;
/// Once some points are known to be behind others, [`AMONG`] of the points that are left are taken. The place
/// is skipped if there are more than this many times [`AMONG`] points there in all.
const OF_ALL: f64 = 2.2;
/// At most this many rounds. Each one finds the points that are behind fewer others than there are sheets.
const ROUNDS: usize = 3;
/// Rounds end when fewer than this share of the points are found to be behind others.
const HARDLY_ANY: f64 = 0.002;
/// These points are searched for within at most this many cells: strays have no others round them.
const FARTHEST: usize = 12;
/// A point is above another one if it is higher by more than the steepest surface climbs and by this many
/// standard deviations of the noise. The deviation is measured across the surface. On a surface that is
/// tilted by 60°, it is twice as large along the line of sight.
const BEYOND_NOISE: f64 = 12.0;
/// The noise is the scatter of this many neighbours of a point about their plane.
const NEIGHBOURS: usize = 12;
/// The noise is measured at this many points at most.
const PROBES: usize = 256;
/// At most this many distances are calculated for the noise; in large scans it is measured at fewer points.
const DISTANCES: usize = 100_000_000;

/// For each point of the view, whether those `inside` that are above it surround it.
pub(super) fn behind_others(points: &[Point3<f64>], inside: &[u32]) -> Vec<bool> {
    let mut behind = vec![false; points.len()];
    let size = extents_of(points, inside).size();
    let side = CELL * (size.x * size.y / inside.len() as f64).sqrt();
    let margin = BEYOND_NOISE * noise(points, inside);
    let cells = Cells::new(points, inside, side);
    let all = SummedArea::of_counts(cells.size(), |cell| cells.points(cell).len());
    for _ in 0..ROUNDS {
        let is_left = |at: &&u32| !behind[**at as usize];
        let left =
            SummedArea::of_counts(cells.size(), |cell| cells.points(cell).iter().filter(is_left).count());
        let mut found = Vec::new();
        for cell in 0..cells.count() {
            let Some(reach) = left.reach(cell, AMONG, FARTHEST) else { continue };
            if all.count(cell, reach - 1) as f64 > OF_ALL * AMONG as f64 {
                continue;
            }
            for &at in cells.points(cell).iter().filter(is_left) {
                if is_behind(&cells, points, &behind, cell, reach, at, margin) {
                    found.push(at);
                }
            }
        }
        found.iter().for_each(|&at| behind[at as usize] = true);
        if (found.len() as f64) < HARDLY_ANY * inside.len() as f64 {
            break;
        }
    }
    behind
}

/// Whether the points above a point surround it, of those that are left within `reach` cells.
fn is_behind(
    cells: &Cells,
    points: &[Point3<f64>],
    behind: &[bool],
    cell: usize,
    reach: usize,
    at: u32,
    margin: f64,
) -> bool {
    let point = points[at as usize];
    let climb = STEEPEST_SURFACE.tan();
    let mut octants = 0u8;
    for near in cells.square(cell, reach) {
        for &other in cells.points(near) {
            let to = points[other as usize] - point;
            if to.z <= margin {
                break;
            }
            if !behind[other as usize] && to.z > margin + climb * to.xy().norm() {
                octants |= octant(to.xy());
            }
        }
        if is_surrounded(octants) {
            return true;
        }
    }
    false
}

/// The standard deviation of the points across the surface on which they are, mm, from planes through a few of them and those next to
/// each in space: whatever is above or below that surface.
fn noise(points: &[Point3<f64>], inside: &[u32]) -> f64 {
    let probes = (DISTANCES / inside.len()).clamp(1, PROBES).min(inside.len());
    let scatter = |probe: usize| {
        let of = points[inside[probe * (inside.len() / probes)] as usize];
        let mut near: Vec<(f64, u32)> =
            inside.iter().map(|&at| ((points[at as usize] - of).norm_squared(), at)).collect();
        let nearest = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        let last = NEIGHBOURS.min(near.len() - 1);
        near.select_nth_unstable_by(last, nearest);
        near.truncate(last + 1);
        // Sums depend on the order.
        near.sort_by(nearest);
        let count = near.len() as f64;
        let mean =
            near.iter().map(|(_, at)| points[*at as usize].coords).sum::<nalgebra::Vector3<f64>>() / count;
        let off = near.iter().map(|(_, at)| points[*at as usize].coords - mean);
        let spread: Matrix3<f64> = off.map(|off| off * off.transpose()).sum();
        // The plane takes three of the values.
        (spread.symmetric_eigenvalues().min().max(0.0) / (count - 3.0).max(1.0)).sqrt()
    };
    let mut scatters: Vec<f64> = (0..probes).map(scatter).collect();
    median(&mut scatters).unwrap_or(0.0)
}
