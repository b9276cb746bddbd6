//! How much the vertices of a mesh scatter about the surface that they sample.
//!
//! Round a vertex, a smooth surface is nearly a quadric. The distances of the vertices from the quadric that
//! fits them best are noise on three conditions: the distances of neighbours are independent (Moran, Notes on
//! continuous stochastic phenomena, Biometrika 37, 1950); they are similar everywhere; and they are larger
//! than the bend between neighbours explains. Edges, engravings and waves cause distances in some places,
//! where neighbours are alike. Tessellations cause hardly any.

use nalgebra::{Matrix3, Point3, SMatrix, SVector, Vector3};

use super::adjacency::{NONE, Neighbours};
use super::mesh::TriMesh;
use super::rounding;

/// At most this many vertices are looked at; those of larger meshes are sampled evenly.
const SAMPLE: usize = 800;
/// A quadric is fitted to this many rings of neighbours.
const RINGS: usize = 3;
/// One neighbourhood has at most this many vertices.
const MOST_AROUND: usize = 72;
/// One neighbourhood has at least this many vertices: the quadric has six unknowns.
const LEAST_AROUND: usize = 16;
/// Noise shows only in at least this many neighbourhoods.
const LEAST_PATCHES: usize = 150;
/// At least this share of the neighbourhoods must be smooth enough to show noise.
const USABLE: f64 = 0.5;
/// A neighbourhood rises above its tangent plane by less than this share of its radius; otherwise an edge
/// runs through it.
const FLAT: f64 = 0.5;
/// The lowest and the highest correlation of independent neighbours. The fit itself makes that of noise
/// -0.14. If the triangles of a noisy mesh are reduced, the vertices that stick out remain, and the
/// correlation is down to -0.25. In waves that the vertices hardly resolve, neighbours are opposite.
const INDEPENDENT: [f64; 2] = [-0.26, -0.03];
/// The median of deviations is 0.67 of their root mean square in a normal distribution, 0.87 in an even one; where some
/// vertices are pressed in, as by an engraving, the others deviate less.
const NORMAL: [f64; 2] = [0.64, 0.84];
/// With noise, the upper quartile of all neighbourhoods is less than this many times the lower quartile.
const ALIKE: f64 = 1.7;
/// Noise is more than this many times the height of an arc between neighbours. The vertices of remeshed parts
/// leave the original surface by less.
const BEYOND_SAG: f64 = 1.25;
/// Scatter below this share of the distance between vertices does not change normals.
const MISLEADS: f64 = 0.003;
/// If the scatter is above this share of the distance between vertices, the facets are intended to be
/// visible.
const MOST: f64 = 0.5;
/// Scatter below this, mm, is caused by the rounding of a file's numbers.
const LEAST: f64 = 0.0015;

/// Scatter below this many steps of the file's numbers is their rounding: its standard deviation is 0.29 steps along an axis
/// of the file, and at most 0.5 steps across a surface.
const ROUNDING: f64 = 1.0;

/// The scatter of a mesh's vertices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Standard deviation of the vertices from the surface, along its normal, mm.
    pub deviation: f64,
    /// Mean distance between neighbouring vertices, mm.
    pub spacing: f64,
    /// Whether it is so large that it misleads the normals.
    pub misleads: bool,
}

/// What the vertices round one show.
struct Patch {
    /// Standard deviation from the quadric, mm.
    deviation: f64,
    /// Mean distance between neighbours, mm.
    spacing: f64,
    /// Height of an arc of the quadric between neighbours, mm.
    sag: f64,
    /// Of the deviations of neighbours, -1 to 1.
    correlation: f64,
    /// The median of the deviations' sizes by their root mean square.
    middle: f64,
}

/// The noise of a mesh, if the shape of the mesh shows it; `None` for other meshes.
///
/// Vertices that the mesh repeats, as at the borders of CAD faces, are not neighbours.
pub fn of(mesh: &TriMesh) -> Option<Noise> {
    let (patches, seeds) = patches(mesh);
    if patches.len() < LEAST_PATCHES || (patches.len() as f64) < USABLE * seeds as f64 {
        return None;
    }
    let quantile = |share: f64, value: fn(&Patch) -> f64| {
        let mut values: Vec<f64> = patches.iter().map(value).collect();
        let at = ((values.len() - 1) as f64 * share) as usize;
        *values.select_nth_unstable_by(at, f64::total_cmp).1
    };
    let [lower, deviation, upper] = [0.25, 0.5, 0.75].map(|share| quantile(share, |patch| patch.deviation));
    let spacing = quantile(0.5, |patch| patch.spacing);
    let correlation = quantile(0.5, |patch| patch.correlation);
    let middle = quantile(0.5, |patch| patch.middle);
    let is_noise = deviation > LEAST.max(ROUNDING * rounding::step(mesh.positions()))
        && deviation < MOST * spacing
        && upper < ALIKE * lower
        && (INDEPENDENT[0]..INDEPENDENT[1]).contains(&correlation)
        && (NORMAL[0]..NORMAL[1]).contains(&middle);
    let misleads = deviation > MISLEADS * spacing
        && quantile(0.5, |patch| patch.deviation - BEYOND_SAG * patch.sag) > 0.0;
    is_noise.then_some(Noise { deviation, spacing, misleads })
}

/// The noise round some vertices, spread evenly, where no edge runs through; and the number of vertices that
/// were tried.
fn patches(mesh: &TriMesh) -> (Vec<Patch>, usize) {
    let stride = mesh.triangles().len().div_ceil(SAMPLE).max(1);
    let mut seeds: Vec<u32> = mesh.triangles().iter().step_by(stride).map(|corners| corners[0]).collect();
    seeds.sort_unstable();
    seeds.dedup();
    let near = Submesh::round(mesh, &seeds);
    let around = Neighbours::of(&near.triangles, near.positions.len());
    let mut nearby = Nearby { places: vec![NONE; near.positions.len()], found: Vec::new() };
    let shown = seeds.iter().filter_map(|&seed| {
        nearby.gather(near.numbers[seed as usize], &around);
        let patch = nearby.patch(&near.positions, &around);
        nearby.clear();
        patch
    });
    (shown.collect(), seeds.len())
}

/// The triangles within some rings of the chosen vertices.
struct Submesh {
    positions: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// For each vertex of the mesh its number here.
    numbers: Vec<u32>,
}

impl Submesh {
    fn round(mesh: &TriMesh, seeds: &[u32]) -> Self {
        let mut is_near = vec![false; mesh.positions().len()];
        seeds.iter().for_each(|&seed| is_near[seed as usize] = true);
        let mut is_chosen = vec![false; mesh.triangles().len()];
        let mut chosen: Vec<[u32; 3]> = Vec::new();
        for _ in 0..RINGS {
            let before = chosen.len();
            for (corners, is_chosen) in mesh.triangles().iter().zip(&mut is_chosen) {
                if !*is_chosen && corners.iter().any(|&vertex| is_near[vertex as usize]) {
                    *is_chosen = true;
                    chosen.push(*corners);
                }
            }
            chosen[before..].iter().flatten().for_each(|&vertex| is_near[vertex as usize] = true);
        }
        let (mut numbers, mut positions) = (vec![NONE; mesh.positions().len()], Vec::new());
        for &vertex in chosen.iter().flatten() {
            if numbers[vertex as usize] == NONE {
                numbers[vertex as usize] = positions.len() as u32;
                positions.push(mesh.positions()[vertex as usize]);
            }
        }
        let triangles = chosen.iter().map(|corners| corners.map(|vertex| numbers[vertex as usize])).collect();
        Self { positions, triangles, numbers }
    }
}

/// The vertices round one, nearest first.
struct Nearby {
    found: Vec<u32>,
    /// For each vertex its place among the found ones.
    places: Vec<u32>,
}

impl Nearby {
    fn gather(&mut self, seed: u32, around: &Neighbours) {
        self.add(seed);
        let mut from = 0;
        for _ in 0..RINGS {
            let to = self.found.len();
            for at in from..to {
                for &next in around.of_vertex(self.found[at] as usize) {
                    if self.found.len() < MOST_AROUND && self.places[next as usize] == NONE {
                        self.add(next);
                    }
                }
            }
            from = to;
        }
    }

    fn add(&mut self, vertex: u32) {
        self.places[vertex as usize] = self.found.len() as u32;
        self.found.push(vertex);
    }

    fn clear(&mut self) {
        self.found.drain(..).for_each(|vertex| self.places[vertex as usize] = NONE);
    }

    /// What the found vertices show; nothing if they are too few, or rise too steeply to be one smooth side.
    fn patch(&self, positions: &[Point3<f64>], around: &Neighbours) -> Option<Patch> {
        let count = self.found.len();
        if count < LEAST_AROUND {
            return None;
        }
        let points: Vec<Vector3<f64>> =
            self.found.iter().map(|&vertex| positions[vertex as usize].coords).collect();
        let middle = points.iter().sum::<Vector3<f64>>() / count as f64;
        let spread: Matrix3<f64> =
            points.iter().map(|point| (point - middle) * (point - middle).transpose()).sum();
        let eigen = spread.symmetric_eigen();
        let order = |at: usize| eigen.eigenvalues[at];
        let least = (0..3).min_by(|&one, &other| order(one).total_cmp(&order(other)))?;
        let most = (0..3).max_by(|&one, &other| order(one).total_cmp(&order(other)))?;
        if least == most {
            return None;
        }
        let normal = eigen.eigenvectors.column(least).into_owned();
        let along: Vector3<f64> = eigen.eigenvectors.column(most).into_owned();
        let across = normal.cross(&along);
        let radius = (order(most) / count as f64).sqrt() * 2.0;
        if !(radius > 0.0) {
            return None;
        }
        let local: Vec<Vector3<f64>> = points
            .iter()
            .map(|point| {
                let from = (point - middle) / radius;
                Vector3::new(along.dot(&from), across.dot(&from), normal.dot(&from))
            })
            .collect();
        if local.iter().any(|at| at.z.abs() > FLAT) {
            return None;
        }
        let row = |at: &Vector3<f64>| {
            SVector::<f64, 6>::from([1.0, at.x, at.y, at.x * at.x, at.x * at.y, at.y * at.y])
        };
        let (mut left, mut right) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
        for at in &local {
            let row = row(at);
            left += row * row.transpose();
            right += row * at.z;
        }
        let eigenvalues = left.symmetric_eigenvalues();
        if eigenvalues.min() < 1e-4 * eigenvalues.max() {
            return None;
        }
        let quadric = left.cholesky()?.solve(&right);
        let left_over: Vec<f64> = local.iter().map(|at| at.z - row(at).dot(&quadric)).collect();
        let squares: f64 = left_over.iter().map(|value| value * value).sum();
        let (mut products, mut sides, mut length) = (0.0, 0usize, 0.0);
        for (one, &vertex) in self.found.iter().enumerate() {
            for &next in around.of_vertex(vertex as usize) {
                let other = self.places[next as usize] as usize;
                if self.places[next as usize] != NONE && other > one {
                    products += left_over[one] * left_over[other];
                    length += (points[one] - points[other]).norm();
                    sides += 1;
                }
            }
        }
        let sides = sides.max(1) as f64;
        let spacing = length / sides;
        let bend =
            [quadric[3] * 2.0, quadric[5] * 2.0, quadric[4]].into_iter().map(f64::abs).fold(0.0, f64::max);
        let root = (squares / count as f64).sqrt().max(f64::MIN_POSITIVE);
        let mut sizes: Vec<f64> = left_over.iter().map(|value| value.abs()).collect();
        let middle = *sizes.select_nth_unstable_by(count / 2, f64::total_cmp).1 / root;
        Some(Patch {
            middle,
            deviation: (squares / (count - 6) as f64).sqrt() * radius,
            spacing,
            sag: bend / radius * spacing * spacing / 8.0,
            correlation: products / sides / (root * root).max(f64::MIN_POSITIVE),
        })
    }
}
