//! How well the curved patches over neighbouring triangles agree about the slope of the part between the vertices.
//!
//! The vertices of a mesh are on the part, and two patches share the curve between two of them. If the patches represent
//! the part well, they also share their tangent planes along that curve; the less the vertices and their normals define
//! the part between them, the more the tangent planes differ. The patches of an extruded strip always agree, however; there the
//! leans of the normals show the error, as on a turned part without normals: on an arc the normals at both ends of a side lean from it by equal and opposite angles.
//! On parts given by formulas, with facets of 0.75 to 5 mm,
//! with and without normals, even, uneven and decimated, half the difference bounds the error of the lengths, areas and
//! angles that follows from the error of the slope (`tests/true_surface/bounds.rs`).

use nalgebra::Vector3;

use super::SmoothMesh;
use crate::geometry::adjacency::{NONE, Neighbours};

/// Patches whose sides bulge by less than this, mm, are not compared: fine meshes have many, and their slopes are known
/// well.
const NEGLIGIBLE_BULGE: f64 = 1e-3;

/// The error of the slope over a side, root mean square, as a share of the error of the normal at one of its ends: the slope
/// of a cubic is (1 − s)(1 − 3s) times that error at the share s of the side.
const OF_LEAN: f64 = 0.5;
/// The same for normals of the file, which are exact: their uneven leans only show that the curvature changes along the side.
const OF_EXACT_LEAN: f64 = 0.25;
/// The share on turned parts: the error is that of the slope along the profile only.
const OF_TURNED_LEAN: f64 = 0.27;
/// A triangle belongs to a turned part if along one of its sides, as on a ring, the normals lean by at most this share of the
/// largest lean.
const OF_RINGS: f64 = 0.1;
/// A triangle belongs to a strip if the normals turn along one of its sides by at most this share of the largest turn.
const RULING: f64 = 0.05;
/// A side continues another one if they meet at an angle with a smaller cosine than this in the tangent plane.
const STRAIGHT: f64 = -0.95;
/// The same on turned parts, where only the lines of a regular mesh are compared.
const ON_ONE_LINE: f64 = -0.995;
/// The share of the error over an arc that is cut into one facet: the error is largest where the part is steepest.
const OF_LONE: f64 = 1.5;
/// A side beside an arc is flat if it takes at most this share of the turn between them.
const NOT_FLAT: f64 = 0.25;
/// Rulings of a strip are parallel within this angle, rad.
const PARALLEL: f64 = 0.01;
/// Sides are cut evenly from one arc where their lengths differ by at most this factor, and rings where they differ by at most
/// the second.
const EVENLY_CUT: f64 = 1.1;
const EVEN_RING: f64 = 1.02;
/// CAD programs cut an arc into facets that turn by at most twice this, rad.
const MOST_LEAN: f64 = 0.25;
/// Neighbours of a vertex among which its ring is looked for.
const MOST_NEIGHBOURS: usize = 64;
/// Leans are compared between sides whose lengths differ by at most this factor.
const MOST_LONGER: f64 = 2.0;

impl SmoothMesh {
    /// For each triangle that faces the laser, how far the slope of the part may be from that of its curved patch, rad, root
    /// mean square; 0 for the others. Empty if all facets are small.
    ///
    /// It is half the angle between the patch and its neighbours' at the middles of their common sides, together with the
    /// uneven leans of normals that are `estimated`.
    pub(super) fn found_slope_doubts(&self, estimated: &[bool]) -> Vec<f32> {
        let mut slots = vec![NONE; self.triangles.len()];
        let mut normals: Vec<[Vector3<f64>; 3]> = Vec::new();
        for (triangle, slot) in slots.iter_mut().enumerate() {
            if self.faces_laser(triangle) && self.bulges(triangle) {
                *slot = normals.len() as u32;
                let patch = self.patch(triangle);
                normals.push([0, 1, 2].map(|side| patch.normal_beside(side)));
            }
        }
        if normals.is_empty() {
            return Vec::new();
        }
        let around = Neighbours::of(&self.triangles, self.positions.len());
        let doubt = |triangle: usize| {
            let Some(own) = normals.get(slots[triangle] as usize) else { return 0.0 };
            let (mut squares, mut count) = (0.0, 0.0);
            for (side, normal) in own.iter().enumerate() {
                let other = self.continued[3 * triangle + side] as usize;
                let Some(beyond) = slots.get(other / 3).and_then(|&slot| normals.get(slot as usize)) else {
                    continue;
                };
                squares += normal.cross(&beyond[other % 3]).norm_squared();
                count += 1.0;
            }
            let half = if count > 0.0 { squares / count / 4.0 } else { 0.0 };
            (half + self.lean_doubt(triangle, estimated, &around).powi(2)).sqrt() as f32
        };
        (0..self.triangles.len()).map(doubt).collect()
    }

    /// The error of the slope over a triangle, rad, that the leans at the ends of its sides show: on an extruded strip, and on a
    /// turned part where an end is `estimated`; 0 elsewhere.
    fn lean_doubt(&self, triangle: usize, estimated: &[bool], around: &Neighbours) -> f64 {
        let corners = self.triangles[triangle];
        let ends = [0, 1, 2].map(|side| [corners[side], corners[(side + 1) % 3]]);
        let turns =
            ends.map(|[one, other]| (self.normals[other as usize] - self.normals[one as usize]).norm());
        let largest = turns.into_iter().fold(0.0, f64::max);
        let leans = ends.map(|[one, other]| self.lean(one, other));
        let most_lean = leans.into_iter().map(|(_, lean)| lean.abs()).fold(0.0, f64::max);
        let is_extruded = turns.into_iter().any(|turn| turn <= RULING * largest);
        let is_revolved = leans.into_iter().any(|(_, lean)| lean.abs() <= OF_RINGS * most_lean);
        if !is_extruded && !is_revolved {
            return 0.0;
        }
        let straight = if is_extruded { STRAIGHT } else { ON_ONE_LINE };
        let of_side = |([one, other], (along, lean)): ([u32; 2], (Vector3<f64>, f64))| {
            let excess = self.excess(one, other, (along, lean), straight, around);
            let excess = excess.max(self.excess(other, one, (-along, -lean), straight, around));
            let is_estimated = [one, other].iter().any(|&end| estimated[end as usize]);
            let share = match (is_extruded, is_estimated) {
                (true, true) => OF_LEAN,
                (true, false) => OF_EXACT_LEAN,
                (false, true) => OF_TURNED_LEAN,
                (false, false) => 0.0,
            };
            let of_lean = excess.min(lean.abs()) * share;
            if !is_estimated {
                return of_lean;
            }
            // Facets of other parts are in one line by accident, but not so three times.
            let is_regular = |ends: [u32; 2]| match is_extruded {
                true => self.is_across_rulings(ends, around),
                false => ends.into_iter().all(|end| self.is_on_ring(end, along, around)),
            };
            let goes_on = |[from, end]: [u32; 2]| {
                self.straight_on(from, end, around).is_none_or(|beyond| is_regular([end, beyond]))
            };
            let is_profile = is_regular([one, other]) && goes_on([one, other]) && goes_on([other, one]);
            if is_profile { of_lean.max(self.lone_doubt([one, other], around)) } else { of_lean }
        };
        [0, 1, 2].map(|side| of_side((ends[side], leans[side]))).into_iter().fold(0.0, f64::max)
    }

    /// From one vertex to another, mm, and by how much the normals at both lean towards the other, rad.
    fn lean(&self, one: u32, other: u32) -> (Vector3<f64>, f64) {
        let along = self.positions[other as usize] - self.positions[one as usize];
        let sum = self.normals[one as usize] + self.normals[other as usize];
        (along, along.try_normalize(0.0).map_or(0.0, |along| sum.dot(&along)))
    }

    /// By how much the lean of a side from a vertex differs from that of the side that continues it there, rad; 0 if there is
    /// none.
    ///
    /// Where the curvature changes steadily along a curve, leans grow with the square of the length.
    fn excess(
        &self,
        from: u32,
        to: u32,
        (along, lean): (Vector3<f64>, f64),
        straight: f64,
        around: &Neighbours,
    ) -> f64 {
        let length = along.norm();
        // Curves also turn within their own plane.
        let normal = self.normals[from as usize];
        let level = |side: Vector3<f64>| (side - normal * side.dot(&normal)).normalize();
        let level_along = level(along);
        let continuing = |&other: &u32| {
            let (back, lean) = self.lean(from, other);
            let cosine = level(back).dot(&level_along);
            (other != to && cosine < straight).then_some((cosine, lean, back.norm()))
        };
        let continued = around.of_vertex(from as usize).iter().filter_map(continuing);
        let straightest = continued.min_by(|one, other| one.0.total_cmp(&other.0));
        straightest.map_or(0.0, |(_, beyond, beyond_length)| {
            (lean + beyond * (length / beyond_length).min(MOST_LONGER).powi(2)).abs()
        })
    }

    /// The error of the slope over a side, rad, root mean square, where an arc that is cut into one facet has an end.
    ///
    /// Such an arc continues what is beyond the ends of the side: the normals at both ends lean from the side by the angle at
    /// which the curve beyond one of the ends arrives there.
    fn lone_doubt(&self, ends: [u32; 2], around: &Neighbours) -> f64 {
        let leans = [self.lean_at(ends[0], ends[1]), self.lean_at(ends[1], ends[0])];
        let error = |lean: f64| {
            let [first, last] = leans.map(|known| lean - known);
            // The slope of a cubic with these errors of its slope at both ends.
            ((2.0 * (first * first + last * last) + first * last) / 15.0).sqrt()
        };
        let ways = [[ends[1], ends[0]], [ends[0], ends[1]]];
        let cut_evenly = ways.map(|way| self.lean_of_arc(way, around));
        match cut_evenly {
            [Some(_), Some(_)] => 0.0,
            // The arc of the side is known. What does not belong to it at its last vertex is that of a lone facet, or of a flat side.
            [Some(lean), None] | [None, Some(lean)] => {
                let last = ways[usize::from(cut_evenly[0].is_some())];
                let beyond = self.straight_on(last[0], last[1], around);
                let is_lone = beyond.is_some_and(|beyond| {
                    let turn = self.turn_at(last[1], [last[0], beyond]);
                    (turn - lean).abs() > NOT_FLAT * turn.abs()
                        && self.lean_of_arc([last[1], beyond], around).is_none()
                });
                if is_lone { error(lean) } else { 0.0 }
            }
            [None, None] => {
                let arrives = |[from, end]: [u32; 2]| {
                    let beyond = self.straight_on(from, end, around)?;
                    let of_arc = self.lean_of_arc([end, beyond], around).unwrap_or(0.0);
                    Some(self.turn_at(end, [from, beyond]) - of_arc)
                };
                let possible = ways.into_iter().filter_map(arrives).filter(|lean| lean.abs() < MOST_LEAN);
                OF_LONE * possible.map(error).fold(0.0, f64::max)
            }
        }
    }

    /// By how much the normals of an arc lean from a side of it, rad, if the side that continues it at its second end is cut from
    /// the same arc.
    fn lean_of_arc(&self, [from, end]: [u32; 2], around: &Neighbours) -> Option<f64> {
        let beyond = self.straight_on(from, end, around)?;
        let turn = self.turn_at(end, [from, beyond]);
        let bends = turn.abs() * self.distance([from, end]) > 8.0 * NEGLIGIBLE_BULGE;
        (bends && self.is_even([from, end], [end, beyond], EVENLY_CUT)).then_some(turn / 2.0)
    }

    /// By how much the normal at a vertex leans away from the side to another one, rad.
    fn lean_at(&self, from: u32, to: u32) -> f64 {
        let along = self.positions[to as usize] - self.positions[from as usize];
        along.try_normalize(0.0).map_or(0.0, |along| -self.normals[from as usize].dot(&along))
    }

    /// By how much two sides turn at the vertex where they meet, rad; negative where the part is concave.
    fn turn_at(&self, vertex: u32, ends: [u32; 2]) -> f64 {
        ends.into_iter().map(|end| self.lean_at(vertex, end)).sum()
    }

    /// The length of a side, mm.
    fn distance(&self, [one, other]: [u32; 2]) -> f64 {
        (self.positions[other as usize] - self.positions[one as usize]).norm()
    }

    /// Whether the lengths of two sides differ by at most a factor.
    fn is_even(&self, one: [u32; 2], other: [u32; 2], factor: f64) -> bool {
        let (one, other) = (self.distance(one), self.distance(other));
        one <= factor * other && other <= factor * one
    }

    /// A step within the tangent plane of a vertex, as a unit vector; not a number for a step along the normal.
    fn level(&self, vertex: u32, step: Vector3<f64>) -> Vector3<f64> {
        let normal = self.normals[vertex as usize];
        (step - normal * step.dot(&normal)).normalize()
    }

    /// The vertex beyond the end of a side, on one line with it.
    fn straight_on(&self, from: u32, end: u32, around: &Neighbours) -> Option<u32> {
        let step = |to: u32| self.level(end, self.positions[to as usize] - self.positions[end as usize]);
        let back = step(from);
        let others = around.of_vertex(end as usize).iter().copied().filter(|&other| other != from);
        let cosines = others.map(|other| (other, step(other).dot(&back)));
        let straightest = cosines
            .filter(|(_, cosine)| *cosine < ON_ONE_LINE)
            .min_by(|one, other| one.1.total_cmp(&other.1));
        straightest.map(|(other, _)| other)
    }

    /// Whether parallel rulings of a strip begin at both ends of a side.
    fn is_across_rulings(&self, [one, other]: [u32; 2], around: &Neighbours) -> bool {
        let limit = RULING * (self.normals[other as usize] - self.normals[one as usize]).norm();
        let rulings = |from: u32, not: u32| {
            let ring = around.of_vertex(from as usize).iter().take(MOST_NEIGHBOURS).copied();
            ring.filter(move |&to| {
                to != not && (self.normals[to as usize] - self.normals[from as usize]).norm() <= limit
            })
            .map(move |to| (self.positions[to as usize] - self.positions[from as usize]).normalize())
        };
        rulings(one, other)
            .any(|ruling| rulings(other, one).any(|parallel| ruling.cross(&parallel).norm() < PARALLEL))
    }

    /// Whether two sides of equal length continue each other at a vertex, across `along`: turned parts are cut into even sectors.
    fn is_on_ring(&self, vertex: u32, along: Vector3<f64>, around: &Neighbours) -> bool {
        let ring = around.of_vertex(vertex as usize);
        let along = self.level(vertex, along);
        let step =
            |to: u32| self.level(vertex, self.positions[to as usize] - self.positions[vertex as usize]);
        ring.iter().take(MOST_NEIGHBOURS).any(|&one| {
            step(one).dot(&along).abs() < 0.5
                && self
                    .straight_on(one, vertex, around)
                    .is_some_and(|other| self.is_even([vertex, one], [vertex, other], EVEN_RING))
        })
    }

    fn faces_laser(&self, triangle: usize) -> bool {
        self.triangles[triangle].iter().any(|&vertex| self.normals[vertex as usize].z.abs() > 0.1)
    }

    /// Whether a side of the triangle is the chord of a curve that leaves it notably.
    fn bulges(&self, triangle: usize) -> bool {
        let (corners, normals) = self.corners(triangle);
        (0..3).any(|side| {
            let next = (side + 1) % 3;
            let turn = (normals[next] - normals[side]).norm_squared();
            let length = (corners[next] - corners[side]).norm_squared();
            length * turn > (8.0 * NEGLIGIBLE_BULGE).powi(2)
        })
    }
}
