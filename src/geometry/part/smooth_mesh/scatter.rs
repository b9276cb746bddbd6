//! How far vertices are from the surface through their neighbours, on meshes whose vertices are not on the
//! part.
//!
//! Decimation by quadric errors (Garland & Heckbert, Surface simplification using quadric error metrics,
//! SIGGRAPH 1997), as in Blender's modifier, moves the remaining vertices off the part. Their heights above
//! it differ by about a fifth of the height of an arc over an edge. Such vertices scatter independently of
//! one another. If a mesh is too coarse for the curvature, vertices also seem too high or too low, but
//! steadily from neighbour to neighbour.

use super::SmoothMesh;
use crate::geometry::adjacency::Neighbours;
use crate::geometry::fork::{Fork, for_each};

/// Below this correlation of neighbouring offsets, vertices scatter: that of independent heights, each above the mean of its
/// neighbours', is -0.3.
const INDEPENDENT: f64 = -0.15;
/// Above this correlation they are on the part; between the two they are partly.
const STEADY: f64 = 0.1;

/// Of the offsets at the ends of sides, the sums of their products and of the means of their squares.
type Sums = [f64; 2];

impl SmoothMesh {
    /// For each `chosen` vertex its height above the surface through its neighbours, mm, where the heights of neighbours are
    /// independent; 0 where they are alike, at a rim, and for other vertices. `around` has the neighbours of all vertices within two
    /// sides of the chosen ones.
    ///
    /// On an arc, the normals at both ends of a side lean from it by opposite angles. If one end is too high, both lean the same
    /// way: half the sum of the leans times the length of the side is its height above the other end. A change of curvature makes
    /// opposite sides lean in opposite ways, so the mean over all sides leaves it out; derivatives of the fourth order are alike
    /// at neighbours, so the mean of the neighbours' heights is subtracted.
    pub(super) fn scatter(
        &self,
        is_at_rim: &[bool],
        around: &Neighbours,
        chosen: &[bool],
        fork: &dyn Fork,
    ) -> Vec<f64> {
        let offsets = self.offsets(is_at_rim);
        let of_edge = |one: usize, other: usize| {
            let [here, there] = [offsets[one], offsets[other]];
            [here * there, (here * here + there * there) / 2.0]
        };
        let mut of_mesh = Sums::default();
        self.for_each_edge(|ends| {
            let [one, other] = ends.map(|end| end as usize);
            if !is_at_rim[one] && !is_at_rim[other] {
                of_mesh = with(of_mesh, of_edge(one, other));
            }
        });
        let of_mesh = independence(of_mesh);
        let inner = |vertex: usize| {
            let ring = if is_at_rim[vertex] { &[] } else { around.of_vertex(vertex) };
            ring.iter().map(|&other| other as usize).filter(|&other| !is_at_rim[other])
        };
        // Memory that nothing is written to costs nothing: most vertices of large meshes have no neighbours here.
        let mut sums = vec![Sums::default(); self.positions.len()];
        for_each(fork, &mut sums, |vertex, sums| {
            inner(vertex).for_each(|other| *sums = with(*sums, of_edge(vertex, other)));
        });
        // A few rings hold enough sides for a correlation.
        let ring = |vertex: usize| inner(vertex).fold(sums[vertex], |near, other| with(near, sums[other]));
        let rings = |vertex: usize| inner(vertex).fold(ring(vertex), |near, other| with(near, ring(other)));
        let mut scatter = vec![0.0; self.positions.len()];
        for_each(fork, &mut scatter, |vertex, scatter| {
            let count = if chosen[vertex] { inner(vertex).count() } else { 0 };
            if count > 0 {
                let mean = inner(vertex).map(|other| offsets[other]).sum::<f64>() / count as f64;
                *scatter = (offsets[vertex] - mean) * independence(rings(vertex)).max(of_mesh);
            }
        });
        scatter
    }

    /// For each vertex its height above its neighbours by the leans of the sides between them, mm; 0 at a rim.
    fn offsets(&self, is_at_rim: &[bool]) -> Vec<f64> {
        let mut slopes = vec![0.0; self.positions.len()];
        let mut steepness = vec![0.0; self.positions.len()];
        self.for_each_edge(|[one, other]| {
            let (along, lean) = self.lean(one, other);
            let length = along.norm();
            if length > 0.0 {
                for (vertex, lean) in [(one as usize, lean), (other as usize, -lean)] {
                    slopes[vertex] += lean / 2.0;
                    steepness[vertex] += 1.0 / length;
                }
            }
        });
        for ((slope, steepness), is_at_rim) in slopes.iter_mut().zip(steepness).zip(is_at_rim) {
            *slope = if steepness > 0.0 && !is_at_rim { -*slope / steepness } else { 0.0 };
        }
        slopes
    }
}

fn with([products, squares]: Sums, other: Sums) -> Sums {
    [products + other[0], squares + other[1]]
}

/// 1 where neighbouring offsets are independent, 0 where they are alike.
fn independence([products, squares]: Sums) -> f64 {
    if squares > 0.0 { ((STEADY - products / squares) / (STEADY - INDEPENDENT)).clamp(0.0, 1.0) } else { 0.0 }
}
