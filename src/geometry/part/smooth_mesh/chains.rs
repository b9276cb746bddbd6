//! What the surface may be over a side whose arc nothing confirms. A CAD program cuts each arc of a profile
//! evenly. An arc that is cut into one facet shows only by what it continues.
//!
//! The sides of an extruded strip across its rulings, and of a turned part along its profile, are the chords
//! of one curve. If the curve consists of tangent arcs, the normals at both ends of a chord lean from it by
//! half the turn of its arc, and two chords turn at the vertex between them by half the turns of both arcs.
//! Two chords of the same length are cut from one arc, which turns by as much as they do. A chord without
//! such a neighbour takes the rest of the turns at its ends that the arcs beyond leave. If these arcs are not
//! known either, it takes the whole turns: the curve is between the chord and the arc that continues a flat
//! side.

use nalgebra::{Matrix3, Vector3};

use super::SmoothMesh;
use super::straightest::Straightest;
use crate::geometry::adjacency::{Neighbours, facet_normal, spread};

/// Chords that their arc leaves by less than this, mm, are not looked at: fine meshes have many, and their slopes are known well.
pub(super) const NEGLIGIBLE_BULGE: f64 = 1e-3;
/// A side continues another one where the cosine of their angle in the tangent plane is below this.
pub(super) const ON_ONE_LINE: f64 = -0.995;
/// The largest error over a chord, where the part is steepest, is this many times the mean error over it.
const OF_LONE: f64 = 1.5;
/// On a turned part, only the slope along the profile has an error. This is the mean share of it over lines
/// in all directions.
pub(super) const OF_TURNED: f64 = std::f64::consts::FRAC_2_PI;
/// Facets contain a ruling if they are off it by at most this share of the turn at the side. If [`ROUNDING`]
/// is larger, it is the limit.
const RULING: f64 = 0.05;
/// Facets contain a ruling if they are off it by at most this, rad, which rounding explains. If the limit by
/// [`RULING`] is larger, that applies.
const ROUNDING: f64 = 1e-4;
/// Sides are cut evenly from one arc if their lengths differ by at most this factor.
pub(super) const EVENLY_CUT: f64 = 1.1;
/// Two sides at a vertex are on a ring only if their lengths differ by at most this factor.
const EVEN_RING: f64 = 1.02;
/// The line between two vertices that mirror each other is at right angles to the mirror plane within this,
/// rad.
const MIRRORED: f64 = 0.05;
/// The normals at two vertices that mirror each other differ along the profile by less than this, rad.
const MIRRORED_NORMALS: f64 = 0.01;
/// Two chords of one length are cut from one arc if the turns at their ends differ by at most this share.
const SAME_ARC: f64 = 0.5;
/// A side beside an arc is flat if it takes at most this share of the turn between them.
pub(super) const NOT_FLAT: f64 = 0.25;
/// The lengths of the chords of a smooth curve change by less than this factor from one to the next.
const MOST_STEADY: f64 = 1.6;
/// The factors by which the lengths of the chords of a smooth curve change differ by less than this factor
/// from one to the next.
const STEADY: f64 = 1.3;
/// The curvatures at four vertices in a row are those of a smooth curve if the inner two leave the line
/// between the outer two by at most this share of the largest one. At a flat side between two arcs, and at an
/// arc of one facet between two others, they leave it farther.
const EVEN_BEND: f64 = 0.15;
/// Where wide and narrow sides take turns, a wide one is more than this many times as long as a narrow one.
/// Such sides are not the chords of one smooth curve.
const IN_TURN: f64 = 1.5;
/// A straight side is followed over at most this many pieces.
const MOST_PIECES: usize = 8;
/// The pieces of a straight side turn by at most this from one to the next, rad.
const STRAIGHT: f64 = 1e-3;
/// Beyond both ends of a side there is a curve, not a fillet of one facet, if it bends at this many vertices
/// in a row on average.
const BENDING: usize = 3;
/// Vertices beyond an end of a straight line that are looked at, at most.
const MOST_BEYOND: usize = MOST_PIECES + 2 * BENDING;
/// CAD programs cut an arc into facets that turn by at most twice this, rad.
const MOST_LEAN: f64 = 0.25;
/// Neighbours of a vertex among which its ring is looked for.
const MOST_NEIGHBOURS: usize = 64;

/// The error of the slope of a cubic over a chord, root mean square, with these errors of its slope at both ends, rad: positive where the
/// normal leans away from the chord too little.
pub(super) fn of_cubic(first: f64, last: f64) -> f64 {
    ((2.0 * (first * first + last * last) + first * last) / 15.0).sqrt()
}

/// A straight line up to where it ends in a bend.
struct StraightRun {
    /// The vertex at its end, and the one beyond.
    end: u32,
    beyond: u32,
    /// How much the curve turns at its end, rad.
    turn: f64,
    /// mm.
    length: f64,
    /// The number of its sides.
    pieces: usize,
}

/// How a curve bends beyond the end of a straight line.
struct Bend {
    /// How far the normal at the end leans from the line, rad: the rest of the turn there beside a known arc,
    /// or the lean of a circle through the vertices.
    lean: f64,
    /// At how many vertices it bends that way, up to twice [`BENDING`].
    count: usize,
    /// Whether the turn at the end is larger than that of an arc which begins there.
    leaves_tangent: bool,
}

/// Of triangles, each given with a side that is taken for straight, those whose side may be the chord of an S-shaped curve, with the error
/// of their slope if it is, rad, root mean square: see [`Chains::doubt_of_straight`].
pub(super) fn of_straight_sides(mesh: &SmoothMesh, sides: &[(usize, [u32; 2])]) -> Vec<(usize, f64)> {
    if sides.is_empty() {
        return Vec::new();
    }
    let mut is_end = vec![false; mesh.positions.len()];
    sides.iter().flat_map(|(_, ends)| ends).for_each(|&end| is_end[end as usize] = true);
    let mut is_near = is_end.clone();
    spread(&mut is_near, &mesh.triangles, MOST_BEYOND);
    let around = Neighbours::of_chosen(&mesh.triangles, &is_near);
    let straightest = Straightest::of(mesh, &around);
    let chains = Chains::of(mesh, &straightest, &is_end);
    let doubts = sides.iter().map(|&(triangle, ends)| (triangle, chains.doubt_of_straight(ends)));
    doubts.filter(|(_, doubt)| *doubt > 0.0).collect()
}

/// The curves that the sides of a mesh are chords of.
pub(super) struct Chains<'a> {
    mesh: &'a SmoothMesh,
    straightest: &'a Straightest<'a>,
    /// For each chosen vertex its place in `facets`.
    places: Vec<u32>,
    /// The means of n·nᵀ over the normals n of the facets round a vertex.
    facets: Vec<Matrix3<f64>>,
}

impl<'a> Chains<'a> {
    /// The sides between `chosen` vertices, one flag for each; `straightest` has the sides of all vertices
    /// within a side of these.
    pub(super) fn of(mesh: &'a SmoothMesh, straightest: &'a Straightest<'a>, chosen: &[bool]) -> Self {
        let mut places = vec![0; chosen.len()];
        let mut count = 0;
        for (place, _) in places.iter_mut().zip(chosen).filter(|(_, chosen)| **chosen) {
            *place = count;
            count += 1;
        }
        let mut facets = vec![(Matrix3::zeros(), 0u32); count as usize];
        for (triangle, corners) in mesh.triangles.iter().enumerate() {
            let mut corners = corners.iter().filter(|&&vertex| chosen[vertex as usize]).peekable();
            if corners.peek().is_none() {
                continue;
            }
            let normal = facet_normal(mesh.corners(triangle).0);
            let product = normal * normal.transpose();
            for &vertex in corners {
                let (sum, count) = &mut facets[places[vertex as usize] as usize];
                *sum += product;
                *count += 1;
            }
        }
        let facets = facets.into_iter().map(|(sum, count)| sum / f64::from(count.max(1))).collect();
        Self { mesh, straightest, places, facets }
    }

    /// The error of the slope over a side, rad, root mean square, if the curve through its ends is made of tangent arcs; 0 for
    /// sides of irregular meshes.
    pub(super) fn doubt(&self, ends: [u32; 2]) -> f64 {
        let is_extruded = self.is_across_rulings(ends);
        if !is_extruded && !self.is_along_profile(ends) {
            return 0.0;
        }
        let of_known = if is_extruded { 1.0 } else { OF_TURNED };
        let leans = [self.lean_at(ends[0], ends[1]), self.lean_at(ends[1], ends[0])];
        let error = |lean: f64| {
            let [first, last] = leans.map(|known| lean - known);
            of_cubic(first, last)
        };
        let ways = [[ends[1], ends[0]], [ends[0], ends[1]]];
        match ways.map(|way| self.lean_of_arc(way)) {
            [Some(one), Some(other)] if (one - other).abs() <= SAME_ARC * one.abs().max(other.abs()) => 0.0,
            [Some(_), Some(_)] if self.is_ramp(ends) => 0.0,
            // One of the two is the lean of its arc: chords of two arcs may be of one length.
            [Some(one), Some(other)] => of_known * error(one).max(error(other)),
            // The arc of the side is known. What does not belong to it at its last vertex is that of a lone facet, or of a flat side.
            [Some(lean), None] if self.ends_openly(ways[1], lean) => error(lean),
            [None, Some(lean)] if self.ends_openly(ways[0], lean) => error(lean),
            [Some(lean), None] if self.bends_back(ways[1], lean) => of_known * error(lean),
            [None, Some(lean)] if self.bends_back(ways[0], lean) => of_known * error(lean),
            [Some(_), None] | [None, Some(_)] => 0.0,
            [None, None] if self.is_steady(ends) || self.bends_evenly(ends) => 0.0,
            [None, None] => {
                let possible = ways.into_iter().filter_map(|way| self.arrives(way));
                // A chamfer is flat, and so may be the band of a turned part that turns by more than the arcs beside it are cut
                // into, or beside which none is known.
                let of_flat = if self.is_narrow(ends) {
                    error(0.0)
                } else if !is_extruded && self.turns_more(ends, leans) {
                    of_known * error(0.0)
                } else {
                    0.0
                };
                (OF_LONE * possible.map(error).fold(0.0, f64::max)).max(of_flat)
            }
        }
    }

    /// The error of the slope over a side that is treated as straight, rad, root mean square; 0 for others.
    /// Such a side has an error if smooth curves without known arcs continue to bend beyond both ends, in
    /// opposite ways. They must bend at several vertices, or by more than the facets beyond can explain: a
    /// flat side leads from one fillet to another, and so does the bend of a spline.
    pub(super) fn doubt_of_straight(&self, ends: [u32; 2]) -> f64 {
        let is_extruded = self.is_across_rulings(ends);
        if !is_extruded && !self.is_along_profile(ends) {
            return 0.0;
        }
        let Some([one, other]) = self.bends_beside(ends) else { return 0.0 };
        let is_curve = one.count + other.count >= 2 * BENDING || one.leaves_tangent && other.leaves_tangent;
        if one.lean * other.lean >= 0.0 || !is_curve {
            return 0.0;
        }
        let error = of_cubic(one.lean, other.lean);
        if is_extruded { error } else { OF_TURNED * error }
    }

    /// The bends at both ends of the straight line that a side is part of.
    fn bends_beside(&self, ends: [u32; 2]) -> Option<[Bend; 2]> {
        let [back, ahead] = [[ends[1], ends[0]], ends].map(|way| self.to_bend(way));
        let (back, ahead) = (back?, ahead?);
        // Both reach over the side itself. An S-shaped curve has one vertex on its chord at most.
        if back.pieces + ahead.pieces - 1 > 2 {
            return None;
        }
        let length = back.length + ahead.length - self.distance(ends);
        Some([self.bend_at(&back, length)?, self.bend_at(&ahead, length)?])
    }

    /// The last piece of a straight line from a side on.
    fn to_bend(&self, [mut from, mut end]: [u32; 2]) -> Option<StraightRun> {
        let mut length = self.distance([from, end]);
        for pieces in 1..=MOST_PIECES {
            let beyond = self.straight_on(from, end)?;
            let turn = self.turn_at(end, [from, beyond]);
            if turn.abs() > STRAIGHT {
                return Some(StraightRun { end, beyond, turn, length, pieces });
            }
            (from, end) = (end, beyond);
            length += self.distance([from, end]);
        }
        None
    }

    /// The bend at the end of a straight line of such a length, mm; `None` where the curve ends, or the arc is tangent to it.
    fn bend_at(&self, straight: &StraightRun, length: f64) -> Option<Bend> {
        let StraightRun { end, beyond, turn, .. } = *straight;
        let mut side = [end, beyond];
        let lean = match self.lean_of_even_sides(side) {
            Some(of_arc) => turn - of_arc,
            None => turn * length / (length + self.distance(side)),
        };
        if lean * turn <= NOT_FLAT * turn * turn {
            return None;
        }
        let (mut count, mut leaves_tangent) = (1, false);
        // What is beyond a long side is another bend.
        while count < 2 * BENDING
            && self.distance(side) <= length
            && let Some(after) = self.straight_on(side[0], side[1])
            && let next = self.turn_at(side[1], [side[0], after])
            && next * turn > 0.0
        {
            // The normals of the arc over the next side lean as much at its end as here.
            leaves_tangent |= count == 1 && (turn - next) * turn > NOT_FLAT * turn * turn;
            (side, count) = ([side[1], after], count + 1);
        }
        Some(Bend { lean, count, leaves_tangent })
    }

    /// Whether the arc of a side ends at its second end, and nothing is known beyond: the border of the
    /// smooth side, or a chord that is cut from no arc.
    fn ends_openly(&self, [from, end]: [u32; 2], lean: f64) -> bool {
        let Some(beyond) = self.straight_on(from, end) else { return true };
        let turn = self.turn_at(end, [from, beyond]);
        (turn - lean).abs() > NOT_FLAT * turn.abs() && self.lean_of_arc([end, beyond]).is_none()
    }

    /// Whether the arc of a side ends at its second end, where a known one bends the other way or takes back as much as it turns, and
    /// the turns before and after do not change evenly.
    fn bends_back(&self, [from, end]: [u32; 2], lean: f64) -> bool {
        let Some(beyond) = self.straight_on(from, end) else { return false };
        let is_straight = self.turn_at(end, [from, beyond]).abs() <= NOT_FLAT * lean.abs();
        let is_other_way = || self.lean_of_arc([end, beyond]).is_some_and(|other| other * lean < 0.0);
        (is_straight || is_other_way()) && !self.is_ramp([from, end])
    }

    /// By how much the normals of an arc lean from a side if the arc continues the curve beyond the side's second end, rad.
    fn arrives(&self, [from, end]: [u32; 2]) -> Option<f64> {
        let beyond = self.straight_on(from, end)?;
        let of_arc = self.lean_of_arc([end, beyond]).unwrap_or(0.0);
        Some((self.turn_at(end, [from, beyond]) - of_arc).clamp(-MOST_LEAN, MOST_LEAN))
    }

    /// Whether the turns before, at and after a side change evenly, as on a smooth curve that starts to bend
    /// the other way.
    fn is_ramp(&self, [one, other]: [u32; 2]) -> bool {
        let turns = |from: u32, end: u32| {
            let beyond = self.straight_on(from, end)?;
            let after = self.straight_on(end, beyond)?;
            Some([self.turn_at(end, [from, beyond]), self.turn_at(beyond, [end, after])])
        };
        let (Some([first, before]), Some([last, after])) = (turns(other, one), turns(one, other)) else {
            return false;
        };
        let change = last - first;
        let is_like = |near: f64| (near - change).abs() <= SAME_ARC * change.abs();
        is_like(first - before) && is_like(after - last)
    }

    /// Whether a side is shorter than those that continue it at both ends, as a chamfer between two flat sides is.
    fn is_narrow(&self, [one, other]: [u32; 2]) -> bool {
        let here = self.distance([one, other]);
        [[other, one], [one, other]].into_iter().all(|[from, end]| {
            self.straight_on(from, end).is_some_and(|beyond| self.distance([end, beyond]) > IN_TURN * here)
        })
    }

    /// Whether the normals at the ends of a side lean from it by more than those of the arcs beyond do from their chords, or no arc is
    /// known there.
    fn turns_more(&self, [one, other]: [u32; 2], leans: [f64; 2]) -> bool {
        let of_arcs = [[other, one], [one, other]].into_iter().filter_map(|[from, end]| {
            let beyond = self.straight_on(from, end)?;
            self.lean_of_arc([end, beyond])
        });
        let most = of_arcs.map(f64::abs).reduce(f64::max).unwrap_or(0.0);
        leans.into_iter().map(f64::abs).fold(0.0, f64::max) > EVENLY_CUT * most
    }

    /// Whether a side is one of the chords of a smooth curve: their lengths change by steady factors, as do those of arcs and
    /// flat sides between them by chance only.
    fn is_steady(&self, [one, other]: [u32; 2]) -> bool {
        let [before, after] = [[other, one], [one, other]]
            .map(|way| self.straight_on(way[0], way[1]).map(|beyond| self.distance([way[1], beyond])));
        let (Some(before), Some(after), here) = (before, after, self.distance([one, other])) else {
            return false;
        };
        let factors = [here / before, after / here];
        factors.into_iter().all(|factor| factor < MOST_STEADY && factor * MOST_STEADY > 1.0)
            && factors[0] < STEADY * factors[1]
            && factors[1] < STEADY * factors[0]
    }

    /// Whether the curvatures at the ends of a side and at the vertices beyond them change evenly, and the sides beside it are not both
    /// longer or shorter.
    fn bends_evenly(&self, [one, other]: [u32; 2]) -> bool {
        let beyond = |from: u32, end: u32| {
            let next = self.straight_on(from, end)?;
            Some([next, self.straight_on(end, next)?])
        };
        let (Some(before), Some(after)) = (beyond(other, one), beyond(one, other)) else { return false };
        let row = [before[1], before[0], one, other, after[0], after[1]];
        let lengths: Vec<f64> = row.windows(2).map(|ends| self.distance([ends[0], ends[1]])).collect();
        let is_longer = |one: f64, other: f64| one > IN_TURN * other;
        let [before, here, after] = [lengths[1], lengths[2], lengths[3]];
        if is_longer(before.min(after), here) || is_longer(here, before.max(after)) {
            return false;
        }
        let at = |index: usize| self.turn_at(row[index], [row[index - 1], row[index + 1]]);
        let curvatures = [1, 2, 3, 4].map(|index| 2.0 * at(index) / (lengths[index - 1] + lengths[index]));
        // That of three points is the curvature in the middle of them.
        let middle = |index: usize| (lengths[index] - lengths[index - 1]) / 3.0;
        let mut places = [0.0; 4];
        for index in 1..4 {
            places[index] = places[index - 1] + lengths[index] + middle(index + 1) - middle(index);
        }
        let line = |index: usize| {
            let share = (places[index] - places[0]) / (places[3] - places[0]);
            curvatures[0] + (curvatures[3] - curvatures[0]) * share
        };
        let largest = curvatures.into_iter().map(f64::abs).fold(0.0, f64::max);
        [1, 2].into_iter().all(|index| (curvatures[index] - line(index)).abs() <= EVEN_BEND * largest)
    }

    /// Whether a side is a chord of the profile of a turned part. Facets of other parts are in one line by accident, but not so
    /// three times.
    fn is_along_profile(&self, ends: [u32; 2]) -> bool {
        let along = self.mesh.positions[ends[1] as usize] - self.mesh.positions[ends[0] as usize];
        let are_on_rings = |ends: [u32; 2]| ends.into_iter().all(|end| self.is_on_ring(end, along));
        let goes_on = |[from, end]: [u32; 2]| {
            self.straight_on(from, end).is_none_or(|beyond| are_on_rings([end, beyond]))
        };
        are_on_rings(ends) && goes_on(ends) && goes_on([ends[1], ends[0]])
    }

    /// Whether the facets round both ends of a side contain one direction: that of a side at one of the ends.
    fn is_across_rulings(&self, ends: [u32; 2]) -> bool {
        let [one, other] = ends;
        let turn = |[from, end]: [u32; 2]| {
            self.straight_on(from, end).map_or(0.0, |beyond| self.turn_at(end, [from, beyond]).abs())
        };
        let most = (RULING * turn([one, other]).max(turn([other, one]))).max(ROUNDING).powi(2);
        let others = self.straightest.around.of_vertex(one as usize).iter().take(MOST_NEIGHBOURS);
        others.filter(|&&to| to != other).any(|&to| {
            let side = self.mesh.positions[to as usize] - self.mesh.positions[one as usize];
            let limit = most * side.norm_squared();
            let off = |vertex: u32| side.dot(&(self.facets[self.places[vertex as usize] as usize] * side));
            limit > 0.0 && off(one) <= limit && off(other) <= limit
        })
    }

    /// By how much the normals of an arc lean from a side of it, rad, if the side that continues it at its second end is cut from
    /// the same arc.
    fn lean_of_arc(&self, [from, end]: [u32; 2]) -> Option<f64> {
        let lean = self.lean_of_even_sides([from, end])?;
        (lean.abs() * self.distance([from, end]) > 4.0 * NEGLIGIBLE_BULGE).then_some(lean)
    }

    /// The same for arcs that leave their chords by any height.
    fn lean_of_even_sides(&self, [from, end]: [u32; 2]) -> Option<f64> {
        let beyond = self.straight_on(from, end)?;
        let is_even = self.is_even([from, end], [end, beyond], EVENLY_CUT);
        is_even.then(|| self.turn_at(end, [from, beyond]) / 2.0)
    }

    /// By how much the normal at a vertex leans away from the side to another one, rad.
    fn lean_at(&self, from: u32, to: u32) -> f64 {
        let along = self.mesh.positions[to as usize] - self.mesh.positions[from as usize];
        along.try_normalize(0.0).map_or(0.0, |along| -self.mesh.normals[from as usize].dot(&along))
    }

    /// By how much two sides turn at the vertex where they meet, rad; negative where the part is concave.
    fn turn_at(&self, vertex: u32, ends: [u32; 2]) -> f64 {
        ends.into_iter().map(|end| self.lean_at(vertex, end)).sum()
    }

    /// The length of a side, mm.
    fn distance(&self, [one, other]: [u32; 2]) -> f64 {
        (self.mesh.positions[other as usize] - self.mesh.positions[one as usize]).norm()
    }

    /// Whether the lengths of two sides differ by at most a factor.
    fn is_even(&self, one: [u32; 2], other: [u32; 2], factor: f64) -> bool {
        let (one, other) = (self.distance(one), self.distance(other));
        one <= factor * other && other <= factor * one
    }

    /// The vertex beyond the end of a side, on one line with it.
    fn straight_on(&self, from: u32, end: u32) -> Option<u32> {
        self.straightest.beyond(from, end, ON_ONE_LINE)
    }

    /// Whether two neighbours of a vertex mirror each other in the plane of its normal and of `along`: turned parts are cut into even
    /// sectors. Rings bend where the profile is tilted.
    fn is_on_ring(&self, vertex: u32, along: Vector3<f64>) -> bool {
        let (here, normal) = (self.mesh.positions[vertex as usize], self.mesh.normals[vertex as usize]);
        let along = (along - normal * along.dot(&normal)).normalize();
        let ring = self.straightest.around.of_vertex(vertex as usize);
        let ring = &ring[..ring.len().min(MOST_NEIGHBOURS)];
        let step = |to: u32| self.mesh.positions[to as usize] - here;
        let normal_at = |to: u32| self.mesh.normals[to as usize];
        ring.iter().enumerate().any(|(index, &one)| {
            let (to_one, square) = (step(one), step(one).norm_squared());
            ring[..index].iter().any(|&other| {
                let to_other = step(other);
                let other_square = to_other.norm_squared();
                let across = to_one - to_other;
                let limit = MIRRORED.powi(2) * across.norm_squared();
                square <= EVEN_RING.powi(2) * other_square
                    && other_square <= EVEN_RING.powi(2) * square
                    && across.dot(&along).powi(2) < limit
                    && across.dot(&normal).powi(2) < limit
                    && across.norm_squared() > square
                    && (normal_at(one) - normal_at(other)).dot(&along).abs() < MIRRORED_NORMALS
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use nalgebra::Point3;

    use super::*;
    use crate::geometry::mesh::TriMesh;
    use crate::geometry::space::View;

    /// The radius of both arcs, mm, the turn of their chords, rad, the number of the chords of each, and the radius of the body, mm.
    const SHOULDER: (f64, f64, u32, f64) = (10.8, 0.22, 3, 18.5);
    /// Round the axis.
    const STEPS: u32 = 30;

    /// A shoulder of two equal arcs that bend opposite ways between a body and a neck, turned about the x axis.
    fn shoulder() -> SmoothMesh {
        let (radius, turn, chords, body) = SHOULDER;
        let steepest = f64::from(chords) * turn;
        let (reach, fall) = (radius * steepest.sin(), radius * (1.0 - steepest.cos()));
        let first = |index: u32| {
            let tilt = f64::from(index) * turn;
            [radius * tilt.sin(), body - radius * (1.0 - tilt.cos())]
        };
        let last = |index: u32| first(index).map(|value| -value);
        let moved = |[x, out]: [f64; 2]| [2.0 * reach + x, 2.0 * (body - fall) + out];
        let arcs = (0..=chords).map(first).chain((0..chords).rev().map(|index| moved(last(index))));
        let rings: Vec<[f64; 2]> = std::iter::once([-30.0, body])
            .chain(arcs)
            .chain([[2.0 * reach + 30.0, body - 2.0 * fall]])
            .collect();
        turned(&rings)
    }

    /// A part whose profile is turned about the x axis: the places along it and the distances from it, mm.
    fn turned(rings: &[[f64; 2]]) -> SmoothMesh {
        let at = |[x, out]: [f64; 2], step: u32| {
            let angle = TAU * f64::from(step) / f64::from(STEPS);
            Point3::new(x, -out * angle.sin(), out * angle.cos())
        };
        let positions: Vec<Point3<f64>> =
            rings.iter().flat_map(|&ring| (0..STEPS).map(move |step| at(ring, step))).collect();
        let cells =
            (0..rings.len() as u32 - 1).flat_map(|row| (0..STEPS).map(move |step| (row * STEPS, step)));
        let triangles = cells.flat_map(|(row, step)| {
            let next = (step + 1) % STEPS;
            let [a, b, c, d] = [row + step, row + next, row + STEPS + next, row + STEPS + step];
            [[a, b, c], [a, c, d]]
        });
        SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles.collect()).unwrap(), &View::top())
    }

    #[test]
    fn where_two_equal_arcs_meet_half_of_the_error_of_the_slope_is_in_doubt_at_least() {
        let (radius, turn, chords, _) = SHOULDER;
        let reach = radius * (f64::from(chords) * turn).sin();
        let part = shoulder();
        let (mut squares, mut doubts, mut count) = (0.0, 0.0, 0.0);
        for triangle in 0..part.triangles.len() {
            let corners = part.corners(triangle).0;
            let meets = corners.iter().any(|at| (at.x - reach).abs() < 1e-9);
            if !meets || corners.iter().any(|at| at.z < 5.0) {
                continue;
            }
            let grid: Vec<(Point3<f64>, Vector3<f64>)> = part.patch(triangle).grid().collect();
            let off = |(at, normal): &(Point3<f64>, Vector3<f64>)| {
                let sine = (if at.x < reach { at.x } else { 2.0 * reach - at.x }) / radius;
                let around = Vector3::new(0.0, at.y, at.z).normalize();
                normal.angle(&(around * (1.0 - sine * sine).sqrt() + Vector3::x() * sine)).powi(2)
            };
            squares += grid.iter().map(off).sum::<f64>() / grid.len() as f64;
            doubts += f64::from(part.slope_doubts[triangle]).powi(2);
            count += 1.0;
        }
        let [error, doubt] = [squares, doubts].map(|sum: f64| (sum / count).sqrt());
        // A doubt is the mean over lines in all directions, and the grid has many points at the corners, where the error is largest.
        assert!(error > 0.01 && doubt >= 0.5 * error, "{doubt} rad for {error} rad");
    }

    /// A strip along y with these points of its section, x and z in mm.
    fn extruded(section: &[[f64; 2]]) -> SmoothMesh {
        let count = section.len() as u32;
        let at = |y: f64| section.iter().map(move |&[x, z]| Point3::new(x, y, z));
        let positions: Vec<Point3<f64>> = at(-25.0).chain(at(25.0)).collect();
        let cells = (0..count - 1).map(|at| [at, at + 1, count + at + 1, count + at]);
        let triangles = cells.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]);
        SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles.collect()).unwrap(), &View::top())
    }

    /// The error and the doubt of the slope over the facet in the middle, rad, root mean square; `slope` is that of the section.
    fn of_middle(part: &SmoothMesh, slope: impl Fn(f64) -> f64) -> [f64; 2] {
        let (mut squares, mut doubts, mut count) = (0.0, 0.0, 0.0);
        for triangle in 0..part.triangles.len() {
            let corners = part.corners(triangle).0;
            if corners.iter().all(|at| at.x < 0.0) || corners.iter().all(|at| at.x > 0.0) {
                continue;
            }
            let grid: Vec<(Point3<f64>, Vector3<f64>)> = part.patch(triangle).grid().collect();
            let off = |(at, normal): &(Point3<f64>, Vector3<f64>)| {
                normal.angle(&Vector3::new(-slope(at.x), 0.0, 1.0)).powi(2)
            };
            squares += grid.iter().map(off).sum::<f64>() / grid.len() as f64;
            doubts += f64::from(part.slope_doubts.get(triangle).copied().unwrap_or(0.0)).powi(2);
            count += 1.0;
        }
        [squares, doubts].map(|sum: f64| (sum / count).sqrt())
    }

    /// Splines are cut where they bend, so that a long facet reaches from one bend to the other.
    #[test]
    fn a_long_facet_between_opposite_bends_of_a_spline_is_in_doubt() {
        for [height, length] in [[0.6, 11.0], [1.2, 10.0], [0.4, 14.0]] {
            let curve = |x: f64| height * (x / length).sin();
            let far = [0.55, 0.78, 0.99, 1.25, 1.6, 2.1].map(|share| share * length);
            let places = far.iter().rev().map(|x| -x).chain(far);
            let section: Vec<[f64; 2]> = places.map(|x| [x, curve(x)]).collect();
            let part = extruded(&section);
            let [error, doubt] = of_middle(&part, |x| height / length * (x / length).cos());
            // The grid has many points at the corners, where the error is largest.
            assert!(error > 1e-3 && doubt > 0.5 * error, "{height}, {length}: {doubt} rad for {error} rad");
            assert!(doubt < 2.0 * error, "{height}, {length}: {doubt} rad for {error} rad");
        }
    }

    #[test]
    fn a_flat_side_between_opposite_fillets_is_not_in_doubt() {
        for (radius, turn, chords) in [(10.0, 0.12, 3u32), (6.0, 0.2, 2), (20.0, 0.05, 6)] {
            let slope = f64::from(chords) * turn;
            let end = [8.0 * slope.cos(), 8.0 * slope.sin()];
            // From the flat side on along the arc, which bends down.
            let arc = (1..=chords).map(|index| {
                let angle = slope - f64::from(index) * turn;
                [end[0] + radius * (slope.sin() - angle.sin()), end[1] + radius * (angle.cos() - slope.cos())]
            });
            let last = |points: &[[f64; 2]]| points.last().map(|[x, z]| [x + 15.0, *z]);
            let mut half: Vec<[f64; 2]> = std::iter::once(end).chain(arc).collect();
            half.extend(last(&half));
            let section: Vec<[f64; 2]> =
                half.iter().rev().map(|[x, z]| [-x, -z]).chain(half.iter().copied()).collect();
            let [error, doubt] = of_middle(&extruded(&section), |_| slope.tan());
            assert!(error < 2e-4 && doubt < 2e-4, "{radius}, {turn}: {doubt} rad for {error} rad");
        }
    }

    #[test]
    fn a_wide_band_beside_shoulders_of_one_facet_may_be_straight() {
        // The turn at the edge and that of the shoulder, rad; half the length and the radius of the band, and the radius of the
        // shoulder's arc, mm.
        let shapes =
            [[0.15, 0.55, 14.7, 22.3, 40.0], [0.21, 0.26, 6.0, 17.2, 30.0], [0.35, 0.25, 4.5, 16.0, 20.0]];
        for [kink, turn, half, out, radius] in shapes {
            let [reach, fall] = [
                radius * (f64::sin(kink + turn) - f64::sin(kink)),
                radius * (f64::cos(kink) - f64::cos(kink + turn)),
            ];
            let end = [half + reach, out - fall];
            let part = turned(&[
                [-end[0] - 0.01, 1.0],
                [-end[0], end[1]],
                [-half, out],
                [half, out],
                end,
                [end[0] + 0.01, 1.0],
            ]);
            let (mut squares, mut doubts, mut count) = (0.0, 0.0, 0.0);
            for triangle in 0..part.triangles.len() {
                let corners = part.corners(triangle).0;
                if corners.iter().any(|at| at.x.abs() > half + 1e-9 || at.z < 5.0) {
                    continue;
                }
                // What the patch is inclined along the band.
                let grid: Vec<f64> =
                    part.patch(triangle).grid().map(|(_, normal)| normal.x.powi(2)).collect();
                squares += grid.iter().sum::<f64>() / grid.len() as f64;
                doubts += f64::from(part.slope_doubts[triangle]).powi(2);
                count += 1.0;
            }
            let [error, doubt] = [squares, doubts].map(|sum: f64| (sum / count).sqrt());
            // A doubt is the mean over lines in all directions.
            assert!(error > 0.05 && doubt >= 0.5 * error, "{kink}, {turn}: {doubt} rad for {error} rad");
        }
    }

    /// As on bottles and stepped shafts, also where the facets of the fillets leave their arcs by next to nothing.
    #[test]
    fn a_cone_or_cylinder_between_opposite_fillets_is_not_in_doubt() {
        for [outer, inner] in [[0.0f64, -0.4], [-0.4, 0.0]] {
            for (radius, chords) in [(0.2, 2), (0.5, 3), (1.0, 5), (5.0, 4), (5.0, 10)] {
                let mut at = [-30.0, 22.0 - 20.0 * outer];
                let mut rings = vec![at];
                let go_on = |at: [f64; 2], length: f64, angle: f64| {
                    [at[0] + length * angle.cos(), at[1] + length * angle.sin()]
                };
                at = go_on(at, 20.0, outer);
                rings.push(at);
                let mut ends = [0.0; 2];
                for (from, to) in [(outer, inner), (inner, outer)] {
                    let step = (to - from) / f64::from(chords);
                    for chord in 0..chords {
                        let middle = from + step * (f64::from(chord) + 0.5);
                        at = go_on(at, 2.0 * radius * (step.abs() / 2.0).sin(), middle);
                        rings.push(at);
                    }
                    if from == outer {
                        ends[0] = at[0];
                    }
                    at = go_on(at, 12.0, to);
                    rings.push(at);
                    if from == outer {
                        ends[1] = at[0];
                    }
                }
                let part = turned(&rings);
                let is_inner = |triangle: &usize| {
                    part.corners(*triangle).0.iter().all(|at| at.x > ends[0] - 1e-9 && at.x < ends[1] + 1e-9)
                };
                let inner_triangles: Vec<usize> = (0..part.triangles.len()).filter(is_inner).collect();
                assert_eq!(inner_triangles.len(), 2 * STEPS as usize);
                let doubt = |&triangle: &usize| part.slope_doubts.get(triangle).copied().unwrap_or(0.0);
                let most = inner_triangles.iter().map(doubt).fold(0.0, f32::max);
                assert!(most < 1e-3, "{inner}, R {radius} in {chords}: {most} rad");
            }
        }
    }
}
