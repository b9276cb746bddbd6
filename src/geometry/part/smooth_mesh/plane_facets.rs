//! The plane facets of a mesh: triangles that continue each other in one plane, as where a program divides a polygon.

use nalgebra::Point3;

use super::SmoothMesh;
use crate::geometry::adjacency::{NONE, grouped, sliver_side};
use crate::geometry::disjoint_sets::DisjointSets;
use crate::geometry::fork::{Fork, mapped};

/// Which triangles are of one plane facet.
pub(super) struct PlaneFacets {
    /// The facet of each triangle.
    of_triangle: Vec<u32>,
    /// Where the triangles of each facet begin in `triangles`.
    starts: Vec<u32>,
    /// The triangles, facet by facet; in each the one with the largest area comes first.
    triangles: Vec<u32>,
}

impl PlaneFacets {
    /// Those of a mesh whose vertices may be off by `near`, mm. The larger of two triangles defines the plane.
    pub(super) fn of(mesh: &SmoothMesh, near: f64, fork: &dyn Fork) -> Self {
        let count = mesh.triangles.len();
        let across = mapped(fork, count, |triangle| {
            let [a, b, c] = mesh.corners(triangle).0;
            (b - a).cross(&(c - a))
        });
        let areas = mapped(fork, count, |triangle| across[triangle].norm());
        // For each side of a triangle, whether the triangle beyond it, which is not larger, is in its plane.
        let continues = mapped(fork, count, |here| {
            let (corners, normal) = (mesh.corners(here).0, across[here] / areas[here]);
            [0, 1, 2].map(|side| {
                let other = mesh.continued[3 * here + side];
                let there = other as usize / 3;
                if other == NONE || areas[here] < areas[there] {
                    return false;
                }
                let beyond = mesh.corners(there).0;
                let [one, two, far] = [0, 1, 2].map(|turn| beyond[(other as usize + turn) % 3]);
                // How far a plane is off beyond the triangle that defines it: as many times as that is narrower at their side.
                let ends = [corners[side], corners[(side + 1) % 3]];
                let lengths = [ends[1] - ends[0], two - one].map(|side| side.norm_squared());
                let beyond_near = (far - corners[0]).dot(&normal).abs() / near - 1.0;
                let is_near = beyond_near <= 0.0
                    || (beyond_near * areas[here]).powi(2) * lengths[1] <= areas[there].powi(2) * lengths[0];
                // A sliver has no plane of its own; it belongs to the facet along its longest side.
                is_near && sliver_side(beyond).is_none_or(|longest| longest == other as usize % 3)
            })
        });
        let mut sets = DisjointSets::new(count);
        for (side, _) in continues.as_flattened().iter().enumerate().filter(|(_, continues)| **continues) {
            sets.join(side / 3, mesh.continued[side] as usize / 3);
        }
        let (of_triangle, facets) = sets.numbered();
        let (starts, mut triangles) = grouped(facets, || of_triangle.iter().copied().zip(0..));
        for facet in starts.windows(2) {
            let here = &mut triangles[facet[0] as usize..facet[1] as usize];
            for at in 1..here.len() {
                if areas[here[at] as usize] > areas[here[0] as usize] {
                    here.swap(0, at);
                }
            }
        }
        Self { of_triangle, starts, triangles }
    }

    /// The number of the facet of a triangle.
    pub(super) fn of_triangle(&self, triangle: usize) -> u32 {
        self.of_triangle[triangle]
    }

    /// The triangles of the facet of a triangle, the largest first.
    pub(super) fn with(&self, triangle: usize) -> impl Iterator<Item = usize> {
        let facet = self.of_triangle[triangle] as usize;
        let range = self.starts[facet] as usize..self.starts[facet + 1] as usize;
        self.triangles[range].iter().map(|&triangle| triangle as usize)
    }

    /// Whether the facet of a triangle is of more triangles than those of a curved side, which are divided once at most.
    pub(super) fn is_polygon(&self, triangle: usize) -> bool {
        self.with(triangle).nth(2).is_some()
    }

    /// For each vertex of the mesh, whether it is a vertex of one facet only. Where a hole is cut into a
    /// mesh, its vertices are on the facets, and not on the part from which these were cut. A sliver has no
    /// plane, unless a larger triangle has the same: the needles to the tip of a cone are as narrow as
    /// slivers there, and belong to its facets.
    pub(super) fn only_one(&self, mesh: &SmoothMesh) -> Vec<bool> {
        let mut first = vec![None; mesh.positions.len()];
        let mut is_of_one = vec![true; mesh.positions.len()];
        for (triangle, (corners, facet)) in mesh.triangles.iter().zip(&self.of_triangle).enumerate() {
            let is_sliver = |triangle: usize| sliver_side(mesh.corners(triangle).0).is_some();
            if is_sliver(triangle) && self.with(triangle).next().is_none_or(is_sliver) {
                continue;
            }
            for &vertex in corners {
                is_of_one[vertex as usize] &= first[vertex as usize].get_or_insert(facet) == &facet;
            }
        }
        is_of_one
    }

    /// How far the facet of a triangle reaches from the line through two points, mm.
    pub(super) fn reach(&self, mesh: &SmoothMesh, triangle: usize, [from, to]: [Point3<f64>; 2]) -> f64 {
        let Some(along) = (to - from).try_normalize(0.0) else { return 0.0 };
        let largest = self.with(triangle).take(1).chain([triangle]);
        let corners = largest.flat_map(|triangle| mesh.corners(triangle).0);
        corners.map(|corner| along.cross(&(corner - from)).norm()).fold(0.0, f64::max)
    }
}
