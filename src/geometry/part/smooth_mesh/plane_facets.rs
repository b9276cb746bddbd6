//! The plane facets of a mesh: triangles that continue each other in one plane, as where a program divides a polygon.

use nalgebra::Point3;

use super::SmoothMesh;
use super::disjoint_sets::DisjointSets;
use crate::geometry::adjacency::{NONE, facet_normal, sliver_side, width};

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
    pub(super) fn of(mesh: &SmoothMesh, near: f64) -> Self {
        let count = mesh.triangles.len();
        let area = |triangle: usize| {
            let [a, b, c] = mesh.corners(triangle).0;
            (b - a).cross(&(c - a)).norm()
        };
        let areas: Vec<f64> = (0..count).map(area).collect();
        let mut sets = DisjointSets::new(count);
        for (side, &other) in mesh.continued.iter().enumerate() {
            let (here, there) = (side / 3, other as usize / 3);
            if other == NONE || areas[here] < areas[there] {
                continue;
            }
            // A sliver has no plane of its own; it belongs to the facet along its longest side.
            if sliver_side(mesh.corners(there).0).is_some_and(|longest| longest != other as usize % 3) {
                continue;
            }
            let corners = mesh.corners(here).0;
            let far = mesh.corners(there).0[(other as usize % 3 + 2) % 3];
            // How far a plane is off beyond the triangle that defines it.
            let reach = width(mesh.corners(there).0, other as usize % 3) / width(corners, side % 3);
            if (far - corners[0]).dot(&facet_normal(corners)).abs() <= near * (1.0 + reach) {
                sets.join(here, there);
            }
        }
        let (of_triangle, facets) = sets.numbered();
        let mut starts = vec![0u32; facets + 1];
        of_triangle.iter().for_each(|&facet| starts[facet as usize + 1] += 1);
        (0..facets).for_each(|facet| starts[facet + 1] += starts[facet]);
        let mut triangles = vec![0u32; count];
        let mut next = starts.clone();
        for (triangle, &facet) in of_triangle.iter().enumerate() {
            let (first, free) = (starts[facet as usize] as usize, next[facet as usize] as usize);
            next[facet as usize] += 1;
            triangles[free] = triangle as u32;
            if areas[triangle] > areas[triangles[first] as usize] {
                triangles.swap(first, free);
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

    /// For each vertex of the mesh, whether it is a vertex of one facet only: where a hole is cut into a mesh, its vertices are on the
    /// facets, and not on the part from which these were cut. A sliver has no plane.
    pub(super) fn only_one(&self, mesh: &SmoothMesh) -> Vec<bool> {
        let mut first = vec![None; mesh.positions.len()];
        let mut is_of_one = vec![true; mesh.positions.len()];
        for (triangle, (corners, facet)) in mesh.triangles.iter().zip(&self.of_triangle).enumerate() {
            if sliver_side(mesh.corners(triangle).0).is_some() {
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
