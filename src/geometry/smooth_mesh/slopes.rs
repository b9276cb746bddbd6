//! How well the curved patches over neighbouring triangles agree about the slope of the part between the vertices.
//!
//! The vertices of a mesh are on the part, and two patches share the curve between two of them. If the patches represent
//! the part well, they also share their tangent planes along that curve; the less the vertices and their normals define
//! the part between them, the more the tangent planes differ. On parts given by formulas, with facets of 0.75 to 5 mm,
//! with and without normals, even, uneven and decimated, half the difference bounds the error of the lengths, areas and
//! angles that follows from the error of the slope (`tests/true_surface/bounds.rs`).

use nalgebra::Vector3;

use super::SmoothMesh;
use crate::geometry::adjacency::NONE;

/// Patches whose sides bulge by less than this, mm, are not compared: fine meshes have many, and their slopes are known
/// well.
const NEGLIGIBLE_BULGE: f64 = 1e-3;

impl SmoothMesh {
    /// For each triangle that faces the laser, half the angle, rad, between its curved patch and its neighbours' at the
    /// middles of their common sides, root mean square; 0 for the others. Empty if all facets are small.
    pub(super) fn found_slope_doubts(&self) -> Vec<f32> {
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
            if count > 0.0 { (f64::sqrt(squares / count) / 2.0) as f32 } else { 0.0 }
        };
        (0..self.triangles.len()).map(doubt).collect()
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
