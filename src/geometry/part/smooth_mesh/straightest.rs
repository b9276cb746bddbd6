//! Which side at the end of a side continues it.

use nalgebra::Vector3;

use super::SmoothMesh;
use crate::geometry::adjacency::{NONE, Neighbours};

/// No side continues one where the cosine of their angle in the tangent plane is above this.
pub(super) const STRAIGHT: f64 = -0.95;

/// Vertices with more neighbours, as the middle of a fan, are processed only when needed.
const MOST_NEIGHBOURS: usize = 64;

/// For each side of a mesh, the one that continues it best at either end.
pub(super) struct Straightest<'a> {
    mesh: &'a SmoothMesh,
    pub(super) around: &'a Neighbours,
    /// For each neighbour of each vertex, in the order of the neighbours, the one that is opposite to it.
    opposite: Vec<Opposite>,
}

/// The neighbour of a vertex, or [`NONE`], that is best opposite to another one, and the cosine of the angle between both in the
/// tangent plane.
type Opposite = (u32, f64);

impl<'a> Straightest<'a> {
    pub(super) fn of(mesh: &'a SmoothMesh, around: &'a Neighbours) -> Self {
        let (mut opposite, mut level) = (Vec::new(), [Vector3::zeros(); MOST_NEIGHBOURS]);
        for vertex in 0..mesh.positions.len() {
            let ring = around.of_vertex(vertex);
            if ring.len() > MOST_NEIGHBOURS {
                opposite.resize(opposite.len() + ring.len(), (NONE, 0.0));
                continue;
            }
            level.iter_mut().zip(ring).for_each(|(level, &to)| *level = mesh.level(vertex, to));
            opposite.extend((0..ring.len()).map(|own| opposite_to(own, ring, |other| level[other])));
        }
        Self { mesh, around, opposite }
    }

    /// The vertex beyond the end of a side, on one line with it: of those whose angle in the tangent plane has a cosine below
    /// `straight`, which is [`STRAIGHT`] at most, the straightest.
    pub(super) fn beyond(&self, from: u32, end: u32, straight: f64) -> Option<u32> {
        let ring = self.around.of_vertex(end as usize);
        let own = ring.iter().position(|&other| other == from)?;
        let (beyond, cosine) = match ring.len() > MOST_NEIGHBOURS {
            true => opposite_to(own, ring, |other| self.mesh.level(end as usize, ring[other])),
            false => self.opposite[self.around.range(end as usize).start + own],
        };
        (beyond != NONE && cosine < straight).then_some(beyond)
    }
}

impl SmoothMesh {
    /// The direction from one vertex to another in the tangent plane of the first; not a number along its normal.
    fn level(&self, vertex: usize, to: u32) -> Vector3<f64> {
        let (step, normal) = (self.positions[to as usize] - self.positions[vertex], self.normals[vertex]);
        (step - normal * step.dot(&normal)).normalize()
    }
}

/// The vertex of a ring that is opposite to its `own`; `level` gives the directions to its vertices.
fn opposite_to(own: usize, ring: &[u32], level: impl Fn(usize) -> Vector3<f64>) -> Opposite {
    let back = level(own);
    let others = (0..ring.len()).filter(|&other| other != own);
    let cosines = others.map(|other| (ring[other], level(other).dot(&back)));
    let opposite = cosines.filter(|(_, cosine)| *cosine < STRAIGHT);
    opposite.min_by(|one, other| one.1.total_cmp(&other.1)).unwrap_or((NONE, 0.0))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use nalgebra::Point3;

    use super::*;

    #[test]
    fn the_spoke_of_a_fan_goes_on_in_the_opposite_one() {
        for spokes in [8u32, 64, 65, 200] {
            let rim = (0..spokes).map(|spoke| {
                let angle = TAU * f64::from(spoke) / f64::from(spokes);
                Point3::new(angle.cos(), angle.sin(), 0.3)
            });
            let mut positions = vec![Point3::origin()];
            positions.extend(rim);
            let mesh = SmoothMesh {
                normals: vec![Vector3::z(); positions.len()],
                positions,
                triangles: (0..spokes).map(|spoke| [0, spoke + 1, (spoke + 1) % spokes + 1]).collect(),
                ..SmoothMesh::default()
            };
            let around = Neighbours::of(&mesh.triangles, mesh.positions.len());
            let straightest = Straightest::of(&mesh, &around);
            for spoke in 0..spokes {
                let opposite = (spoke + spokes / 2) % spokes;
                let even = spokes % 2 == 0;
                assert!(
                    straightest.beyond(spoke + 1, 0, STRAIGHT).is_some_and(|beyond| {
                        beyond == opposite + 1 || !even && beyond == (opposite + 1) % spokes + 1
                    }),
                    "{spoke} of {spokes}"
                );
                assert_eq!(straightest.beyond(0, spoke + 1, STRAIGHT), None);
            }
        }
    }
}
