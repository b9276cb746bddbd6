//! How far vertices are from the surface through their neighbours, on meshes whose vertices are not on the part.
//!
//! Decimation by quadric errors (Garland & Heckbert, Surface simplification using quadric error metrics, SIGGRAPH 1997), as in
//! Blender's modifier, moves the vertices that it leaves off the part; their heights above it differ by about a fifth of the
//! height of an arc over an edge. Such vertices scatter independently of one another. Curvature that a mesh is too coarse for also
//! makes vertices seem too high or too low, but steadily from neighbour to neighbour.

use super::SmoothMesh;
use crate::geometry::adjacency::Neighbours;

/// Below this correlation of neighbouring offsets, vertices scatter: that of independent heights, each above the mean of its
/// neighbours', is -0.3.
const INDEPENDENT: f64 = -0.15;
/// Above this correlation they are on the part; between the two they are partly.
const STEADY: f64 = 0.1;

/// Products and squares of the offsets at the ends of sides.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    products: f64,
    squares: f64,
}

impl SmoothMesh {
    /// For each vertex its height above the surface through its neighbours, mm, where the heights of neighbours are independent;
    /// 0 where they are alike, and at a rim.
    ///
    /// On an arc, the normals at both ends of a side lean from it by opposite angles. If one end is too high, both lean the same
    /// way: half the sum of the leans times the length of the side is its height above the other end. A change of curvature makes
    /// opposite sides lean in opposite ways, so the mean over all sides leaves it out; derivatives of the fourth order are alike
    /// at neighbours, so the mean of the neighbours' heights is subtracted.
    pub(super) fn scatter(&self, is_at_rim: &[bool], around: &Neighbours) -> Vec<f64> {
        let inner = |vertex: usize| {
            let ring = if is_at_rim[vertex] { &[] } else { around.of_vertex(vertex) };
            ring.iter().map(|&other| other as usize).filter(|&other| !is_at_rim[other])
        };
        let vertices = 0..self.positions.len();
        let offset = |vertex: usize| {
            let ring = if is_at_rim[vertex] { &[] } else { around.of_vertex(vertex) };
            let (mut slopes, mut steepness) = (0.0, 0.0);
            for &other in ring {
                let (along, lean) = self.lean(vertex as u32, other);
                let length = along.norm();
                if length > 0.0 {
                    slopes += lean / 2.0;
                    steepness += 1.0 / length;
                }
            }
            if steepness > 0.0 { -slopes / steepness } else { 0.0 }
        };
        let offsets: Vec<f64> = vertices.clone().map(offset).collect();
        let sums = |vertex: usize| {
            inner(vertex).fold(Sums::default(), |sums, other| {
                let [here, there] = [offsets[vertex], offsets[other]];
                sums.with(Sums { products: here * there, squares: (here * here + there * there) / 2.0 })
            })
        };
        let sums: Vec<Sums> = vertices.clone().map(sums).collect();
        // A few rings hold enough sides for a correlation.
        let widened = |sums: &[Sums], vertex: usize| {
            inner(vertex).fold(sums[vertex], |near, other| near.with(sums[other]))
        };
        let rings: Vec<Sums> = vertices.clone().map(|vertex| widened(&sums, vertex)).collect();
        let of_mesh = sums.iter().copied().fold(Sums::default(), Sums::with).independence();
        let scatter = |vertex: usize| {
            let count = inner(vertex).count();
            if count == 0 {
                return 0.0;
            }
            let mean = inner(vertex).map(|other| offsets[other]).sum::<f64>() / count as f64;
            (offsets[vertex] - mean) * widened(&rings, vertex).independence().max(of_mesh)
        };
        vertices.map(scatter).collect()
    }
}

impl Sums {
    fn with(self, other: Self) -> Self {
        Self { products: self.products + other.products, squares: self.squares + other.squares }
    }

    /// 1 where neighbouring offsets are independent, 0 where they are alike.
    fn independence(self) -> f64 {
        if self.squares > 0.0 {
            ((STEADY - self.products / self.squares) / (STEADY - INDEPENDENT)).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }
}
