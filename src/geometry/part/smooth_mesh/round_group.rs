//! The facets of a mesh that are on one cylinder or cone.

use super::SmoothMesh;
use super::round::Round;

/// Vertices at this many angles round the axis show a circle: three define it, and two confirm it.
pub(super) const LEAST_ANGLES: usize = 5;
/// Five vertices define a cylinder; by chance, five more are not on it.
pub(super) const LEAST_VERTICES: usize = 10;
/// Angles that differ by less than this, rad, are one.
pub(super) const SAME_ANGLE: f64 = 1e-3;
/// A facet is long if one side is this many times as long as another.
pub(super) const LONG: f64 = 4.0;
/// Long facets may leave their cylinder by only this share of what others of their kind do, if enough of them
/// are on one cylinder.
pub(super) const FINER: f64 = 0.1;
/// A triangle is that of the cylinder where its normals differ from the cylinder's by less than this, rad.
pub(super) const SAME_NORMAL: f64 = 1e-3;

/// The facets of a mesh that are on one cylinder or cone.
pub(super) struct Group {
    pub(super) round: Round,
    /// Its vertices may be off by this, mm.
    pub(super) near: f64,
    /// How far its facets may leave it, mm.
    pub(super) most: f64,
    /// In the order in which they are found.
    pub(super) triangles: Vec<usize>,
    /// Another one on which its vertices may be as well.
    pub(super) rival: Option<Round>,
}

impl Group {
    /// Those of these triangles, whose vertices are on a cylinder within `near`, mm.
    pub(super) fn of(mesh: &SmoothMesh, round: Round, near: f64, triangles: Vec<usize>) -> Self {
        let most = triangles.iter().map(|&triangle| bulge_on(mesh, &round, triangle)).fold(0.0, f64::max);
        Self { round, near, most, triangles, rival: None }
    }

    /// The sides of its triangles with `estimated` normals that run along it without a bend, each with its triangle.
    pub(super) fn straight_sides(&self, mesh: &SmoothMesh, estimated: &[bool]) -> Vec<(usize, [u32; 2])> {
        let is_straight = |ends: &[u32; 2]| {
            let [one, other] = ends.map(|end| self.round.outward(&mesh.positions[end as usize]));
            one.cross(&other).norm() < SAME_NORMAL
        };
        let sides = |&triangle: &usize| {
            let [a, b, c] = mesh.triangles[triangle];
            [[a, b], [b, c], [c, a]].map(|ends| (triangle, ends))
        };
        let is_open = |ends: &[u32; 2]| ends.iter().any(|&end| estimated[end as usize]);
        let sides = self.triangles.iter().flat_map(sides);
        sides.filter(|(_, ends)| is_open(ends) && is_straight(ends)).collect()
    }
}

/// How far the sides of a triangle are from the cylinder at their middles, at most, mm.
pub(super) fn bulge_on(mesh: &SmoothMesh, round: &Round, triangle: usize) -> f64 {
    let [a, b, c] = mesh.corners(triangle).0;
    let middles = [[a, b], [b, c], [c, a]].map(|[from, to]| nalgebra::center(&from, &to));
    middles.map(|middle| round.distance(&middle).abs()).into_iter().fold(0.0, f64::max)
}
