//! How well the curved patches over neighbouring triangles agree about the slope of the part between the vertices.
//!
//! The vertices of a mesh are on the part, and two patches share the curve between two of them. If the patches represent
//! the part well, they also share their tangent planes along that curve; the less the vertices and their normals define
//! the part between them, the more the tangent planes differ. The patches of an extruded strip always agree, however; there the
//! leans of the normals show the error: on an arc the normals at both ends of a side lean from it by equal and opposite angles.
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
/// A triangle belongs to a strip if the normals turn along one of its sides by at most this share of the largest turn.
const RULING: f64 = 0.05;
/// A side continues another one if they meet at an angle with a smaller cosine than this.
const STRAIGHT: f64 = -0.95;
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

    /// The error of the slope over a triangle of a strip, rad, that the leans at the ends of its sides show.
    fn lean_doubt(&self, triangle: usize, estimated: &[bool], around: &Neighbours) -> f64 {
        let corners = self.triangles[triangle];
        let ends = [0, 1, 2].map(|side| [corners[side], corners[(side + 1) % 3]]);
        let turns =
            ends.map(|[one, other]| (self.normals[other as usize] - self.normals[one as usize]).norm());
        let largest = turns.into_iter().fold(0.0, f64::max);
        if turns.into_iter().all(|turn| turn > RULING * largest) {
            return 0.0;
        }
        let of_side = |[one, other]: [u32; 2]| {
            let (along, lean) = self.lean(one, other);
            let excess = self.excess(one, other, (along, lean), around);
            let excess = excess.max(self.excess(other, one, (-along, -lean), around));
            let is_estimated = [one, other].iter().any(|&end| estimated[end as usize]);
            excess.min(lean.abs()) * if is_estimated { OF_LEAN } else { OF_EXACT_LEAN }
        };
        ends.map(of_side).into_iter().fold(0.0, f64::max)
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
    fn excess(&self, from: u32, to: u32, (along, lean): (Vector3<f64>, f64), around: &Neighbours) -> f64 {
        let length = along.norm();
        let straight = |&other: &u32| {
            let (back, lean) = self.lean(from, other);
            let cosine = back.dot(&along) / (back.norm() * length);
            (other != to && cosine < STRAIGHT).then_some((cosine, lean, back.norm()))
        };
        let continued = around.of_vertex(from as usize).iter().filter_map(straight);
        let straightest = continued.min_by(|one, other| one.0.total_cmp(&other.0));
        straightest.map_or(0.0, |(_, beyond, beyond_length)| {
            (lean + beyond * (length / beyond_length).min(MOST_LONGER).powi(2)).abs()
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
