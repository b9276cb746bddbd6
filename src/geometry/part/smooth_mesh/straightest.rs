//! Which side at the end of a side continues it.

use super::SmoothMesh;
use crate::geometry::adjacency::{NONE, Neighbours};

/// No side continues one where the cosine of their angle in the tangent plane is above this.
const MOST: f64 = -0.95;

/// For each side of a mesh, the one that continues it best at either end.
pub(super) struct Straightest<'a> {
    pub(super) around: &'a Neighbours,
    /// For each neighbour of each vertex, in the order of the neighbours: the other neighbour that is best opposite to it, or
    /// [`NONE`], and the cosine of the angle between both in the tangent plane.
    beyond: Vec<(u32, f64)>,
}

impl<'a> Straightest<'a> {
    pub(super) fn of(mesh: &SmoothMesh, around: &'a Neighbours) -> Self {
        let mut beyond = Vec::new();
        let mut level = Vec::new();
        for (vertex, normal) in mesh.normals.iter().enumerate() {
            let ring = around.of_vertex(vertex);
            // Curves also turn within their own plane. Along the normal, a step is not a number.
            level.clear();
            level.extend(ring.iter().map(|&to| {
                let step = mesh.positions[to as usize] - mesh.positions[vertex];
                (step - normal * step.dot(normal)).normalize()
            }));
            for (own, back) in level.iter().enumerate() {
                let others = level.iter().enumerate().filter(|(other, _)| *other != own);
                let cosines = others.map(|(other, step)| (ring[other], step.dot(back)));
                let opposite = cosines.filter(|(_, cosine)| *cosine < MOST);
                beyond.push(opposite.min_by(|one, other| one.1.total_cmp(&other.1)).unwrap_or((NONE, 0.0)));
            }
        }
        Self { around, beyond }
    }

    /// The vertex beyond the end of a side, on one line with it: of those whose angle in the tangent plane has a cosine below
    /// `straight` ([`MOST`] at most) the straightest.
    pub(super) fn beyond(&self, from: u32, end: u32, straight: f64) -> Option<u32> {
        let range = self.around.range(end as usize);
        let own = self.around.of_vertex(end as usize).iter().position(|&other| other == from)?;
        let (beyond, cosine) = self.beyond[range.start + own];
        (beyond != NONE && cosine < straight).then_some(beyond)
    }
}
