//! How well the curved patches over neighbouring triangles agree about the slope of the part between the vertices.
//!
//! The vertices of a mesh are on the part, and two patches share the curve between two of them. If the patches represent
//! the part well, they also share their tangent planes along that curve; the less the vertices and their normals define
//! the part between them, the more the tangent planes differ.
//!
//! Where they agree, they may be wrong alike. In an even mesh each triangle is its neighbour, turned by 180° about the middle
//! of their common side. There, the third derivatives of the part turn both tangent planes by the same angle. The curve between
//! the two corners opposite to this side shows it: it crosses the side, and with exact normals it has the slope of any part of
//! the fourth degree at its middle.
//!
//! The patches of an extruded strip always agree. There the leans of the normals show the error, as on a turned part without
//! normals: on an arc the normals at both ends of a side lean from it by equal and opposite angles. Where nothing confirms the
//! arc of a side, it may be another one (`chains`), and so may an edge that only the facets show (`hidden_arcs`). Normals that
//! are estimated have a deviation of their own, and vertices that are not on the part scatter (`scatter`). On parts given by
//! formulas, with facets of 0.75 to 5 mm, with and without normals, even, uneven and decimated, half the difference bounds the
//! error of the lengths, areas and angles that follows from the error of the slope (`tests/true_surface/bounds.rs`).

use std::ops::Range;

use nalgebra::Vector3;

use super::SmoothMesh;
use super::chains::{Chains, NEGLIGIBLE_BULGE, ON_ONE_LINE};
use super::hidden_arcs::HiddenArc;
use super::settling::Estimates;
use super::straightest::{STRAIGHT, Straightest};
use crate::geometry::adjacency::{NONE, Neighbours, least_width, spread, width};
use crate::geometry::chord_normals::{Chord, are_of_smooth_curves};
use crate::geometry::curved_triangle::direction_between;
use crate::geometry::fork::{Fork, found, join, mapped};
use crate::geometry::space::Extents;

/// The error of the slope over a side, root mean square, as a share of the error of the normal at one of its ends: the slope
/// of a cubic is (1 − s)(1 − 3s) times that error at the share s of the side.
const OF_LEAN: f64 = 0.5;
/// The same share as [`OF_LEAN`] for normals of the file, which are exact: their uneven leans only show that
/// the curvature changes along the side.
const OF_EXACT_LEAN: f64 = 0.25;
/// The error of the slope over a triangle as a share of the slope from one vertex to another that both are too high or too low.
const OF_SCATTER: f64 = 1.0;
/// The same share as [`OF_SCATTER`] with exact normals: their vertices are on the part. What seems to be
/// scatter is curvature that the mesh is too coarse to show.
const OF_EXACT_SCATTER: f64 = 0.2;
/// Rounding with a standard deviation of at least this, mm, is not taken into account: vertices of such
/// models are on whole numbers. The limit is above the deviation of coordinates in hundredths of an inch.
const MOST_ROUNDING: f64 = 0.08;
/// The error of the slope over a triangle in terms of that which the rounding of its corners has on average.
const OF_ROUNDING: f64 = 1.4;
/// The error of the slope over a triangle as a share of the standard deviation of the normals at its corners.
const OF_NORMALS: f64 = 0.6;
/// The same share as [`OF_LEAN`] on turned parts: only the slope along the profile has an error.
const OF_TURNED_LEAN: f64 = 0.27;
/// The same share as [`OF_TURNED_LEAN`] for normals of the file.
const OF_EXACT_TURNED_LEAN: f64 = 0.16;
/// The error over a chord that no other continues, as a share of the turn of the normals along it. It is
/// twice the error of a curve of the fourth power from its vertex on, which has the normals of an arc at both
/// ends of a symmetric chord.
const OF_LONE_CHORD: f64 = 0.07;
/// A side is straight where the normals at its ends lean from it by at most this share of the angle between them.
const OF_TWIST: f64 = 0.1;
/// The root mean square of a parabola that is 1 at its top and 0 at both ends.
const OF_PARABOLA: f64 = 0.73;
/// A triangle belongs to a turned part if the normals lean along one of its sides, which is on a ring, by at
/// most this share of the largest lean.
const OF_RINGS: f64 = 0.1;
/// Curves are compared with the sides that they cross at these shares of both: the error of a patch is largest at the middle of a
/// side.
const NEAR_MIDDLE: Range<f64> = 0.4..0.6;
/// A triangle belongs to a strip if the normals turn along one of its sides by at most this share of the largest turn.
const RULING: f64 = 0.05;
/// Leans are compared between sides whose lengths differ by at most this factor.
const MOST_LONGER: f64 = 2.0;

/// Slopes are those of lines of at least about this length, mm. Part and patch are both near their facet. So
/// over a line, the slopes of the two differ by at most four times the bend of the patch and the error of the
/// vertices, divided by the length of the line. Slivers that are narrower than the line, as at the pole of a
/// ball, have steep patches over very short distances. The patches of such slivers differ in height by at
/// most their disagreement times the width.
const SHORTEST: f64 = 0.25;
/// The same as a share of the diagonal of a small part, whose drawings are small.
const SHORTEST_SHARE: f64 = 0.005;

/// A patch beside its sides.
#[derive(Debug, Clone, Copy, Default)]
struct Beside {
    /// The unit normals at the middles of the sides; zero where the patch is degenerate.
    normals: [Vector3<f64>; 3],
    /// The angles between the patch and the curves that cross its sides, rad; 0 where none does.
    off: [f64; 3],
}

impl SmoothMesh {
    /// For each triangle that faces the laser, how far the slope of the part may be from that of its curved
    /// patch, rad, root mean square; 0 for the others. Empty if all facets are small.
    ///
    /// It is the patch's [share](Self::share_of_turn) of several angles: the angle to the patches of its
    /// neighbours at the middles of their common sides; the angle between the patch and the curve that
    /// crosses there, or the twist of the part there, together with the uneven leans of normals; or the error
    /// that the chords of estimated normals leave open, and the deviations of these, rad. `hidden` are
    /// the arcs that edges may be beside vertices that are estimated.
    pub(super) fn found_slope_doubts(
        &self,
        estimates: &Estimates,
        hidden: &[HiddenArc],
        fork: &dyn Fork,
    ) -> Vec<f32> {
        let estimated = &estimates.is_estimated;
        let bulges = |triangle: usize| self.faces_laser(triangle) && self.bulges(triangle);
        let bulging = found(fork, self.triangles.len(), |triangle| bulges(triangle).then_some(triangle));
        if bulging.is_empty() && hidden.is_empty() {
            return Vec::new();
        }
        // For each triangle which of the patches is its own, from 1 on.
        let mut patches = vec![0u32; self.triangles.len()];
        bulging.iter().zip(1..).for_each(|(&triangle, number)| patches[triangle] = number);
        let mut is_corner = vec![false; self.positions.len()];
        let corners = bulging.iter().flat_map(|&triangle| self.triangles[triangle]);
        corners.for_each(|vertex| is_corner[vertex as usize] = true);
        let beside = || mapped(fork, bulging.len(), |index| self.beside(bulging[index], estimated));
        let scatter = || {
            let mut is_near = is_corner.clone();
            spread(&mut is_near, &self.triangles, 2);
            let around = Neighbours::of_chosen(&self.triangles, &is_near);
            let is_at_rim = self.rim();
            let scatter = self.scatter(&is_at_rim, &around, &is_corner, fork);
            (around, is_at_rim, scatter)
        };
        let (beside, (around, is_at_rim, scatter)) = join(fork, beside, scatter);
        let of_patch = |triangle: usize| beside.get((patches.get(triangle)?.checked_sub(1)?) as usize);
        let straightest = Straightest::of(self, &around);
        // A flat side may have vertices of its own between those of the curves beside it.
        let are_near = estimated.contains(&true).then(|| {
            let mut are_near = is_corner.clone();
            spread(&mut are_near, &self.triangles, 1);
            are_near
        });
        let chains = are_near.as_ref().map(|are_near| Chains::of(self, &straightest, are_near));
        let of_sides = |triangle: usize, doubt: &dyn Fn([u32; 2]) -> f64| {
            let corners = self.triangles[triangle];
            let sides = [0, 1, 2].map(|side| [corners[side], corners[(side + 1) % 3]]);
            let open = sides.into_iter().filter(|side| side.iter().any(|&end| estimated[end as usize]));
            open.map(doubt).fold(0.0, f64::max)
        };
        let of_chords = |triangle: usize| {
            chains.as_ref().map_or(0.0, |chains| of_sides(triangle, &|side| chains.doubt(side)))
        };
        let shortest = self.shortest();
        let doubt = |triangle: usize, own: &Beside| {
            let (mut squares, mut count) = (0.0, 0.0);
            let (corners, is_extruded) = (self.triangles[triangle], is_on_strip(self.turns(triangle)));
            for (side, normal) in own.normals.iter().enumerate() {
                let other = self.continued[3 * triangle + side] as usize;
                let Some(beyond) = of_patch(other / 3) else { continue };
                let apart = normal.cross(&beyond.normals[other % 3]).norm()
                    * self.share_of_turn([3 * triangle + side, other]);
                let of_twist = if is_extruded { 0.0 } else { self.twist_doubt(triangle, side, normal) };
                squares += apart.max(own.off[side]).max(of_twist).powi(2);
                count += 1.0;
            }
            let of_patches = if count > 0.0 { squares / count } else { 0.0 };
            let of_curve =
                self.lean_doubt(triangle, estimated, &is_at_rim, &straightest).max(of_chords(triangle));
            // The chords of a strip show the error better.
            let of_normals = match is_extruded {
                true => 0.0,
                false => {
                    corners
                        .map(|corner| estimates.deviation(corner))
                        .into_iter()
                        .map(|rad| rad * rad)
                        .sum::<f64>()
                        / 3.0
                }
            };
            let of_scatter = self.scatter_doubt(triangle, estimated, &scatter);
            let of_vertices = of_scatter.max(self.rounding_doubt(triangle)).powi(2);
            let of_shape = (of_patches + of_curve.powi(2)).max(of_vertices);
            let doubt = (of_shape + OF_NORMALS.powi(2) * of_normals).sqrt();
            let width = least_width(self.corners(triangle).0);
            let off = corners.map(|corner| scatter[corner as usize].abs()).into_iter().fold(0.0, f64::max);
            let by_bend = 4.0 * (self.largest_bend(triangle) + off) / shortest;
            let by_width = 4.0 * (of_patches.sqrt() * width + off) / shortest;
            let shown = by_bend.min(by_width + of_curve + OF_NORMALS * of_normals.sqrt());
            let is_sliver = width < shortest;
            if is_sliver { doubt.min(shown) as f32 } else { doubt as f32 }
        };
        let of_bulging = mapped(fork, bulging.len(), |index| doubt(bulging[index], &beside[index]));
        let mut doubts = vec![0.0; self.triangles.len()];
        bulging.iter().zip(of_bulging).for_each(|(&triangle, doubt)| doubts[triangle] = doubt);
        if let Some((chains, are_near)) = chains.as_ref().zip(are_near.as_ref()) {
            let is_between = |triangle: usize| {
                let is_flat = patches[triangle] == 0 && self.faces_laser(triangle);
                is_flat && self.triangles[triangle].iter().all(|&vertex| are_near[vertex as usize])
            };
            for (triangle, doubt) in
                doubts.iter_mut().enumerate().filter(|(triangle, _)| is_between(*triangle))
            {
                *doubt = of_sides(triangle, &|side| chains.doubt_of_straight(side)) as f32;
            }
        }
        let is_open =
            |triangle: usize| self.triangles[triangle].iter().any(|&vertex| estimated[vertex as usize]);
        for &HiddenArc { triangle, doubt, .. } in hidden {
            if self.faces_laser(triangle) && is_open(triangle) {
                doubts[triangle] = doubts[triangle].max(doubt as f32);
            }
        }
        doubts
    }

    /// The patch over a triangle beside its sides.
    fn beside(&self, triangle: usize, estimated: &[bool]) -> Beside {
        let crossings = [0, 1, 2].map(|side| self.crossing(3 * triangle + side, estimated));
        let shares = crossings.map(|crossing| crossing.map_or(0.5, |(share, _)| share));
        let normals = self.patch(triangle).normals_beside(shares);
        let off = |side: usize| {
            crossings[side].map_or(0.0, |(_, direction)| direction.dot(&normals[side][1]).abs())
        };
        Beside { normals: normals.map(|[middle, _]| middle), off: [0, 1, 2].map(off) }
    }

    /// The share of the first of two triangles that continue each other, each given by its side there, in the angle between their
    /// patches: half, or less where it is wider. A common side that is off its place turns the patches in inverse proportion to their
    /// widths.
    fn share_of_turn(&self, sides: [usize; 2]) -> f64 {
        let [here, there] = sides.map(|side| width(self.corners(side / 3).0, side % 3));
        if here > there { there / (here + there) } else { 0.5 }
    }

    /// Where the curve between the corners opposite to a side, in the two triangles that share it, crosses
    /// the side, as a share of the side, and the unit direction of the curve there. `None` if that is not
    /// near the middles of both, if the curve is not smooth, or on strips. Also `None` if normals of the
    /// triangles are estimated: these have larger errors, which their deviations and chords show.
    fn crossing(&self, side: usize, estimated: &[bool]) -> Option<(f64, Vector3<f64>)> {
        let corner = |side: usize, next: usize| self.triangles[side / 3][(side % 3 + next) % 3] as usize;
        let other = self.continuing(side)?;
        // At the crest of a bent tube one of two facets seems to be on a strip.
        if [side, other].iter().all(|side| is_on_strip(self.turns(side / 3))) {
            return None;
        }
        let far = [corner(side, 2), corner(other, 2)];
        if [corner(side, 0), corner(side, 1)].into_iter().chain(far).any(|vertex| estimated[vertex]) {
            return None;
        }
        let chord = Chord {
            ends: far.map(|vertex| self.positions[vertex]),
            normals: far.map(|vertex| self.normals[vertex]),
        };
        let [from, to] = self.ends(side);
        let (along, across, start) = (to - from, chord.ends[1] - chord.ends[0], chord.ends[0] - from);
        // Where the two lines are closest to each other.
        let normal = along.cross(&across);
        let shares = [across, along].map(|beside| start.cross(&beside).dot(&normal) / normal.norm_squared());
        let is_near = shares.iter().all(|share| NEAR_MIDDLE.contains(share));
        // Where a fillet ends the curvature jumps, and no curve across is near the part.
        if !is_near || !are_of_smooth_curves([(chord, 1.0)].into_iter()) {
            return None;
        }
        let direction = direction_between(chord.ends, chord.normals, shares[1]).try_normalize(0.0)?;
        Some((shares[0], direction))
    }

    /// The length of the lines whose slopes matter, mm.
    pub fn shortest(&self) -> f64 {
        let size = Extents::of(self.positions.iter().map(|at| at.coords.xy())).size().norm();
        SHORTEST.min(SHORTEST_SHARE * size)
    }

    /// By how much the slope of the patch over a sliver, which is narrower than the `shortest` line, mm, may differ from that of the
    /// part because the patch is steep across it, rad; 0 for other triangles.
    pub fn steepness_of_sliver(&self, triangle: usize, shortest: f64) -> f64 {
        let width = least_width(self.corners(triangle).0);
        if width < shortest { 4.0 * self.bulge(triangle) / width } else { 0.0 }
    }

    /// The error of the slope over a triangle, rad, root mean square, where its vertices are too high or too low by their `scatter`, mm.
    fn scatter_doubt(&self, triangle: usize, estimated: &[bool], scatter: &[f64]) -> f64 {
        let corners = self.triangles[triangle].map(|corner| corner as usize);
        let squares = [0, 1, 2].map(|side| {
            let [one, other] = [corners[side], corners[(side + 1) % 3]];
            let length = (self.positions[other] - self.positions[one]).norm();
            let share = if estimated[one] || estimated[other] { OF_SCATTER } else { OF_EXACT_SCATTER };
            if length > 0.0 { (share * (scatter[other] - scatter[one]) / length).powi(2) } else { 0.0 }
        });
        (squares.into_iter().sum::<f64>() / 3.0).sqrt()
    }

    /// The error of the slope over a triangle, rad, root mean square, by the rounding of the file's numbers: that of the plane
    /// through corners that are off independently. What few facets are off does not average out.
    fn rounding_doubt(&self, triangle: usize) -> f64 {
        let [a, b, c] = self.corners(triangle).0;
        let squares = [b - a, c - b, a - c].map(|side| side.norm_squared());
        let area = (b - a).cross(&(c - a)).norm();
        if area > 0.0 && self.rounding < MOST_ROUNDING {
            OF_ROUNDING * self.rounding * squares.into_iter().sum::<f64>().sqrt() / area
        } else {
            0.0
        }
    }

    /// The error of the slope across a straight side along which the part twists, rad, root mean square: it has the slopes of the
    /// vertices at both ends, and between them that of the patch, `normal`, or their mean.
    fn twist_doubt(&self, triangle: usize, side: usize, normal: &Vector3<f64>) -> f64 {
        let (corners, normals) = self.corners(triangle);
        let [one, other] = [side, (side + 1) % 3];
        let Some(along) = (corners[other] - corners[one]).try_normalize(0.0) else { return 0.0 };
        let lean = normals[one].dot(&along).abs().max(normals[other].dot(&along).abs());
        let twist = (normals[other] - normals[one]).norm();
        if lean > OF_TWIST * twist {
            return 0.0;
        }
        let across = along.cross(&(normals[one] + normals[other])).try_normalize(0.0);
        across.map_or(0.0, |across| OF_PARABOLA * normal.dot(&across).abs().min(twist))
    }

    /// The error of the slope over a triangle, rad, that the leans at the ends of its sides show: on extruded strips and turned
    /// parts, and at borders, where no neighbour's patch shows it; 0 elsewhere.
    fn lean_doubt(
        &self,
        triangle: usize,
        estimated: &[bool],
        is_at_rim: &[bool],
        straightest: &Straightest<'_>,
    ) -> f64 {
        let corners = self.triangles[triangle];
        let ends = [0, 1, 2].map(|side| [corners[side], corners[(side + 1) % 3]]);
        let leans = ends.map(|[one, other]| self.lean(one, other));
        let most_lean = leans.into_iter().map(|(_, lean)| lean.abs()).fold(0.0, f64::max);
        let is_extruded = is_on_strip(self.turns(triangle));
        let is_revolved = leans.into_iter().any(|(_, lean)| lean.abs() <= OF_RINGS * most_lean);
        let straight = if is_extruded { STRAIGHT } else { ON_ONE_LINE };
        let of_side = |side: usize| {
            let ([one, other], (along, lean)) = (ends[side], leans[side]);
            let is_at_border = self.continued[3 * triangle + side] == NONE;
            if !is_extruded && !is_revolved && !is_at_border {
                return 0.0;
            }
            let excesses = [
                straightest
                    .beyond(other, one, straight)
                    .map(|beyond| self.excess(one, beyond, (along, lean))),
                straightest
                    .beyond(one, other, straight)
                    .map(|beyond| self.excess(other, beyond, (-along, -lean))),
            ];
            let Some(excess) = excesses.into_iter().flatten().reduce(f64::max) else {
                let is_diagonal = leans.iter().all(|(other, _)| other.norm() <= along.norm());
                if is_diagonal || !is_at_rim[one as usize] || !is_at_rim[other as usize] {
                    return 0.0;
                }
                let turn = self.normals[other as usize] - self.normals[one as usize];
                return OF_LONE_CHORD * along.try_normalize(0.0).map_or(0.0, |along| turn.dot(&along).abs());
            };
            let is_estimated = [one, other].iter().any(|&end| estimated[end as usize]);
            let share = match (is_extruded, is_estimated) {
                (true, true) => OF_LEAN,
                (true, false) => OF_EXACT_LEAN,
                (false, true) => OF_TURNED_LEAN,
                (false, false) => OF_EXACT_TURNED_LEAN,
            };
            excess.min(lean.abs()) * share
        };
        [0, 1, 2].map(of_side).into_iter().fold(0.0, f64::max)
    }

    /// By how much the normals at the ends of each side of a triangle turn, no unit.
    fn turns(&self, triangle: usize) -> [f64; 3] {
        let [a, b, c] = self.corners(triangle).1;
        [(b - a).norm(), (c - b).norm(), (a - c).norm()]
    }

    /// From one vertex to another, mm, and by how much the normals at both lean towards the other, rad.
    pub(super) fn lean(&self, one: u32, other: u32) -> (Vector3<f64>, f64) {
        let along = self.positions[other as usize] - self.positions[one as usize];
        let sum = self.normals[one as usize] + self.normals[other as usize];
        (along, along.try_normalize(0.0).map_or(0.0, |along| sum.dot(&along)))
    }

    /// By how much the lean of a side from a vertex differs from that of the side to another one that continues it there, rad.
    ///
    /// Where the curvature changes steadily along a curve, leans grow with the square of the length.
    fn excess(&self, from: u32, beyond: u32, (along, lean): (Vector3<f64>, f64)) -> f64 {
        let (back, lean_beyond) = self.lean(from, beyond);
        (lean + lean_beyond * (along.norm() / back.norm()).min(MOST_LONGER).powi(2)).abs()
    }

    fn faces_laser(&self, triangle: usize) -> bool {
        self.triangles[triangle].iter().any(|&vertex| self.normals[vertex as usize].z.abs() > 0.1)
    }

    /// Whether a side of the triangle is the chord of a curve that leaves it notably.
    pub(super) fn bulges(&self, triangle: usize) -> bool {
        self.largest_bend(triangle) > NEGLIGIBLE_BULGE
    }

    /// How far the sides of a triangle, as chords, are from their curves at most, mm, if the curves bend one
    /// way.
    fn largest_bend(&self, triangle: usize) -> f64 {
        let (corners, normals) = self.corners(triangle);
        let squares = [0, 1, 2].map(|side| {
            let next = (side + 1) % 3;
            (normals[next] - normals[side]).norm_squared() * (corners[next] - corners[side]).norm_squared()
        });
        squares.into_iter().fold(0.0, f64::max).sqrt() / 8.0
    }

    /// How far the sides of a triangle, as chords, are from their curves at most, mm, if the curves do not
    /// leave their plane.
    pub(super) fn bulge(&self, triangle: usize) -> f64 {
        let (corners, normals) = self.corners(triangle);
        let bulges = [0, 1, 2].map(|side| {
            let next = (side + 1) % 3;
            (normals[next] - normals[side]).dot(&(corners[next] - corners[side])).abs() / 8.0
        });
        bulges.into_iter().fold(0.0, f64::max)
    }
}

/// Whether a triangle belongs to an extruded strip; its normals turn by `turns` along its sides.
fn is_on_strip(turns: [f64; 3]) -> bool {
    let largest = turns.into_iter().fold(0.0, f64::max);
    turns.into_iter().any(|turn| turn <= RULING * largest)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use nalgebra::{Point3, Vector3};

    use super::{SHORTEST, SmoothMesh};
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::mesh::TriMesh;
    use crate::geometry::space::{View, ViewPoint};
    use crate::geometry::surface::fit::{FitOptions, FittedSurface};

    const HALF_AXES: [f64; 3] = [40.0, 30.0, 25.0];

    /// The top of an ellipsoid in uneven meridians, which end in slivers at its pole.
    fn ellipsoid() -> TriMesh {
        const COUNT: u32 = 48;
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
        };
        let near = [0.002, 0.03, 0.05, 0.07, 0.09, 0.11, 0.13, 0.16];
        let tilts = near.into_iter().chain((4..24).map(|step| 0.05 * f64::from(step)));
        let [a, b, c] = HALF_AXES;
        let mut positions = vec![Point3::new(0.0, 0.0, c)];
        for tilt in tilts {
            positions.extend((0..COUNT).map(|step| {
                let turn = (f64::from(step) + 0.8 * random()) * TAU / f64::from(COUNT);
                let tilt = tilt * (1.0 + 0.1 * random());
                Point3::new(a * tilt.sin() * turn.cos(), b * tilt.sin() * turn.sin(), c * tilt.cos())
            }));
        }
        let next = |step: u32| (step + 1) % COUNT;
        let mut triangles: Vec<[u32; 3]> = (0..COUNT).map(|step| [0, 1 + step, 1 + next(step)]).collect();
        for first in (1..positions.len() as u32 - COUNT).step_by(COUNT as usize) {
            for step in 0..COUNT {
                let [a, b, c, d] =
                    [first + step, first + COUNT + step, first + COUNT + next(step), first + next(step)];
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        TriMesh::new(positions, Vec::new(), triangles).unwrap()
    }

    /// Facets of a scan may be narrower than any line. They are off because their vertices are.
    #[test]
    fn the_noise_of_fine_facets_stays_in_doubt() {
        const COUNT: u32 = 160;
        let (radius, noise, step) = (30.0f64, 0.02, 0.25);
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        let positions = (0..COUNT * COUNT).map(|index| {
            let [x, y] = [index % COUNT, index / COUNT].map(|at| (f64::from(at) - 79.5) * step);
            // Box & Muller, A note on the generation of random normal deviates, 1958.
            let off = noise * (-2.0 * random().max(1e-9).ln()).sqrt() * (TAU * random()).cos();
            Point3::new(x, y, (radius * radius - x * x - y * y).sqrt() + off)
        });
        let cells = (0..COUNT - 1).flat_map(|row| (0..COUNT - 1).map(move |column| row * COUNT + column));
        let triangles = cells.flat_map(|a| [[a, a + 1, a + COUNT + 1], [a, a + COUNT + 1, a + COUNT]]);
        let mesh = TriMesh::new(positions.collect(), Vec::new(), triangles.collect()).unwrap();
        let part = SmoothMesh::new(&mesh, &View::top());
        let (mut squares, mut doubts, mut count) = (0.0, 0.0, 0.0);
        for triangle in 0..part.triangles.len() {
            if part.corners(triangle).0.iter().any(|at| at.coords.xy().norm() > 5.0) {
                continue;
            }
            let grid: Vec<(Point3<f64>, Vector3<f64>)> = part.patch(triangle).grid().collect();
            let off = |(at, normal): &(Point3<f64>, Vector3<f64>)| normal.angle(&at.coords).powi(2);
            squares += grid.iter().map(off).sum::<f64>() / grid.len() as f64;
            doubts += f64::from(part.slope_doubts[triangle]).powi(2);
            count += 1.0;
        }
        let [error, doubt] = [squares, doubts].map(|sum: f64| (sum / count).sqrt());
        assert!(error > 0.1 && doubt > 0.9 * error, "{doubt} rad for {error} rad");
    }

    /// A band of even facets: points with their unit normals by column and row, and columns along the first direction.
    fn band(columns: u32, rows: u32, at: impl Fn(u32, u32) -> (Point3<f64>, Vector3<f64>)) -> SmoothMesh {
        let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        let (positions, normals) = places.map(|(column, row)| at(column, row)).unzip();
        let cells = (0..rows - 1).flat_map(|row| (0..columns - 1).map(move |column| row * columns + column));
        let triangles = cells.flat_map(|a| [[a, a + 1, a + columns + 1], [a, a + columns + 1, a + columns]]);
        let mesh = TriMesh::new(positions, normals, triangles.collect()).unwrap();
        SmoothMesh::new(&mesh, &View::top())
    }

    /// A torus, of which all patches agree: in an even mesh each facet is its neighbour turned about their common side.
    #[test]
    fn the_slope_of_a_coarse_bent_tube_is_in_doubt_by_its_error() {
        for (bend, tube) in [(95.0, 16.5), (60.0, 12.6)] {
            let steps = [0.107, 0.24];
            let on_tube = |column: u32, row: u32| {
                let [turn, tilt] = [column, row].map(f64::from);
                let [turn, tilt] = [(turn - 4.0) * steps[0], (tilt - 5.0) * steps[1]];
                let out = Vector3::new(turn.sin(), turn.cos(), 0.0);
                let normal = out * tilt.sin() + Vector3::z() * tilt.cos();
                (Point3::from(out * bend + normal * tube), normal)
            };
            let part = band(9, 11, on_tube);
            let (mut squares, mut doubts, mut count) = (0.0, 0.0, 0.0);
            for triangle in 0..part.triangles.len() {
                if part.corners(triangle).0.iter().any(|at| at.x.abs() > 0.35 * bend || at.z < 0.4 * tube) {
                    continue;
                }
                let grid: Vec<(Point3<f64>, Vector3<f64>)> = part.patch(triangle).grid().collect();
                let off = |(at, normal): &(Point3<f64>, Vector3<f64>)| {
                    let middle = Vector3::new(at.x, at.y, 0.0).normalize() * bend;
                    normal.angle(&(at.coords - middle)).powi(2)
                };
                squares += grid.iter().map(off).sum::<f64>() / grid.len() as f64;
                doubts += f64::from(part.slope_doubts[triangle]).powi(2);
                count += 1.0;
            }
            let [error, doubt] = [squares, doubts].map(|sum: f64| (sum / count).sqrt());
            assert!(error > 5e-4 && count > 20.0, "{error} rad on {count} facets");
            assert!(doubt > 0.9 * error && doubt < 2.0 * error, "{bend}: {doubt} rad for {error} rad");
        }
    }

    /// The curvature jumps there, and the patches on both sides are right.
    #[test]
    fn the_end_of_a_fillet_leaves_no_slope_in_doubt() {
        let (inner, turn) = (20.0, 0.2);
        let on_top = |column: u32, row: u32| {
            let (step, around) = (f64::from(column) - 3.0, 0.1 * f64::from(row));
            // A crown inside of the fillet.
            let (radius, turn) = if step < 0.0 { (200.0, turn / 20.0) } else { (10.0, turn) };
            let out = Vector3::new(around.cos(), around.sin(), 0.0);
            let normal = out * (turn * step).sin() + Vector3::z() * (turn * step).cos();
            (Point3::from(out * inner - Vector3::z() * radius + normal * radius), normal)
        };
        let part = band(8, 8, on_top);
        let most = part.slope_doubts.iter().copied().fold(0.0, f32::max);
        // A curve across the end is off by an eighth of the turn.
        assert!(f64::from(most) < turn / 40.0, "{most} rad");
    }

    /// The top of an ellipsoid in a grid with a seam of slivers along its middle, whose vertices are uneven.
    fn ellipsoid_with_a_seam() -> TriMesh {
        const STEP: f64 = 1.5;
        const SEAM: f64 = 0.02;
        const COUNT: u32 = 17;
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
        };
        let [a, b, c] = HALF_AXES;
        let rows =
            (0..18u32).map(|row| SEAM * (f64::from(row / 9) - 0.5) + STEP * (f64::from(row - row / 9) - 8.0));
        let positions = rows.flat_map(|y| {
            (0..COUNT)
                .map(|column| {
                    let is_inner = column > 0 && column + 1 < COUNT;
                    let x = STEP * (f64::from(column) - 8.0 + if is_inner { 0.8 * random() } else { 0.0 });
                    Point3::new(x, y, c * (1.0 - (x / a).powi(2) - (y / b).powi(2)).sqrt())
                })
                .collect::<Vec<_>>()
        });
        let positions = positions.collect();
        let cells = (0..17).flat_map(|row| (0..COUNT - 1).map(move |column| row * COUNT + column));
        let triangles = cells.flat_map(|a| [[a, a + 1, a + COUNT + 1], [a, a + COUNT + 1, a + COUNT]]);
        TriMesh::new(positions, Vec::new(), triangles.collect()).unwrap()
    }

    /// The largest error of the slope of short lines within a distance of the top of the ellipsoid, mm, and the largest doubt, rad.
    fn most_off_and_doubted(mesh: &TriMesh, within: f64) -> [f64; 2] {
        let part = FacingPart::new(mesh, &View::top());
        let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
        let [a, b, c] = HALF_AXES;
        let exact = |at: ViewPoint| c * (1.0 - (at.x / a).powi(2) - (at.y / b).powi(2)).sqrt();
        let (mut most_off, mut most_doubt) = (0.0f64, 0.0f64);
        for index in 0..60 * 60 {
            let [x, y] = [index % 60, index / 60].map(|step| (f64::from(step) / 30.0 - 1.0) * within);
            let middle = ViewPoint::new(x, y);
            let [from, to] = [-0.5, 0.5].map(|side| ViewPoint::new(middle.x + side * SHORTEST, middle.y));
            let rise = surface.sampled_height(to).unwrap() - surface.sampled_height(from).unwrap();
            most_off = most_off.max((rise - (exact(to) - exact(from))).abs() / SHORTEST);
            most_doubt = most_doubt.max(f64::from(surface.uncertainty(middle).slope));
        }
        [most_off, most_doubt]
    }

    #[test]
    fn slivers_at_a_pole_leave_no_slope_in_doubt_that_no_line_could_show() {
        let [most_off, most_doubt] = most_off_and_doubted(&ellipsoid(), 6.0);
        // The facets bend by at most 2 µm.
        assert!(most_doubt < 0.03 && most_off < most_doubt, "{most_off} rad off, {most_doubt} rad in doubt");
    }

    #[test]
    fn the_steep_patch_of_a_sliver_under_a_sample_is_no_jump_of_the_slope() {
        let [most_off, most_doubt] = most_off_and_doubted(&ellipsoid_with_a_seam(), 4.0);
        assert!(most_doubt < 0.3 && most_off < most_doubt, "{most_off} rad off, {most_doubt} rad in doubt");
    }
}
