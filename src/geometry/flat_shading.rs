//! Facets that are shaded flat although they may be cut from a smooth surface.
//!
//! Flat shading gives every facet the normal of its plane. Such normals do not tell a round part from one with flat sides.
//! The facets do: those of a round face turn on and on by about the same angle, and are about equally wide.

use nalgebra::{Point3, Vector3};

use super::adjacency::{NONE, facet_normal, opposite_sides, weld};
use super::mesh::TriMesh;
use super::smooth_mesh::{CREASE_ANGLE, NORMAL_TOLERANCE};

/// The normal of a facet is within this of that of each of its triangles, rad (1.2°): a polygon may be bent a little.
const SAME_NORMAL: f64 = 0.021;
/// The normals of a facet are one that is written three times, to three decimals or more.
const ROUNDED: f64 = 2e-3;
/// Two turns, or two widths, are alike if one is at most this many times the other.
const ALIKE: f64 = 1.5;
/// Share of the triangles whose normals may differ from their planes: slivers have no well-defined plane.
const SLIVERS: f64 = 0.01;

/// The bodies of a mesh that are shaded flat throughout, where some of their facets continue one another as those of a round
/// face do: for each vertex, whether it belongs to one. `None` if there are none.
///
/// A body is what is connected by sides of triangles.
pub fn flat_bodies(mesh: &TriMesh) -> Option<Vec<bool>> {
    let shading = Shading::of(mesh).filter(|_| !mesh.normals().is_empty())?;
    let bodies = shading.bodies();
    let count = bodies.iter().max().map_or(0, |last| *last as usize + 1);
    let mut found = vec![Body::default(); count];
    for ((&body, face), turn) in bodies.iter().zip(&shading.faces).zip(shading.turns()) {
        let body = &mut found[body as usize];
        body.triangles += 1;
        body.curved += usize::from(*face == NONE);
        body.is_round |= turn > 0.0;
    }
    let is_flat: Vec<bool> = found.iter().map(Body::is_flat_and_round).collect();
    if !is_flat.contains(&true) {
        return None;
    }
    let mut is_chosen = vec![false; mesh.positions().len()];
    for (corners, &body) in mesh.triangles().iter().zip(&bodies) {
        corners.iter().for_each(|&vertex| is_chosen[vertex as usize] |= is_flat[body as usize]);
    }
    Some(is_chosen)
}

/// How far a smooth surface through the vertices of such facets leaves them at most, mm; 0 if there are none. In a mesh without
/// normals, all facets are flat.
pub fn largest_bulge(mesh: &TriMesh) -> f64 {
    let Some(shading) = Shading::of(mesh) else { return 0.0 };
    shading.continuing().iter().map(|turn| turn.bulge).fold(0.0, f64::max)
}

/// Whether the file's normals make such facets flat beside others of their body that they make smooth, as
/// [`SmoothMesh`](super::smooth_mesh::SmoothMesh) doubts them.
pub fn leaves_facets_open(mesh: &TriMesh) -> bool {
    !mesh.normals().is_empty() && turns_of_facets(mesh).iter().any(|turn| *turn > NORMAL_TOLERANCE)
}

/// For each triangle, the angle by which it and the next ones turn, rad, where they are shaded flat and continue one another as
/// the facets of a round face do; 0 elsewhere. Empty if there are none.
pub(super) fn turns_of_facets(mesh: &TriMesh) -> Vec<f64> {
    let turns = Shading::of(mesh).map(|shading| shading.turns()).unwrap_or_default();
    if turns.iter().any(|turn| *turn > 0.0) { turns } else { Vec::new() }
}

#[derive(Clone, Default)]
struct Body {
    triangles: usize,
    /// Triangles with other normals than those of their planes.
    curved: usize,
    is_round: bool,
}

impl Body {
    fn is_flat_and_round(&self) -> bool {
        self.is_round && self.curved as f64 <= SLIVERS * self.triangles as f64
    }
}

/// The flat facets of a mesh: triangles with one normal that continue one another in a plane.
struct Shading {
    opposite: Vec<u32>,
    /// For each triangle the number of its facet; [`NONE`] where it is not shaded flat.
    faces: Vec<u32>,
    facets: Vec<Facet>,
}

#[derive(Default)]
struct Facet {
    normal: Vector3<f64>,
    /// The sum over its triangles, weighted by their areas.
    middle: Vector3<f64>,
    area: f64,
    perimeter: f64,
}

impl Facet {
    /// Twice the width of a strip, the side of a square, mm.
    fn width(&self) -> f64 {
        4.0 * self.area / self.perimeter
    }

    fn middle(&self) -> Vector3<f64> {
        self.middle / self.area
    }
}

/// A side between two facets.
struct Turn {
    facets: [u32; 2],
    /// rad.
    angle: f64,
    /// Height of an arc over a facet that goes on to turn like that, mm.
    bulge: f64,
    is_convex: bool,
}

impl Turn {
    fn goes_on_in(&self, other: &Self) -> bool {
        self.facets[1] != other.facets[1]
            && self.is_convex == other.is_convex
            && are_alike(self.angle, other.angle)
    }
}

impl Shading {
    /// `None` where no triangle is shaded flat.
    fn of(mesh: &TriMesh) -> Option<Self> {
        let plane = |triangle: usize| facet_normal(mesh.corners(mesh.triangles()[triangle]));
        let given = |triangle: usize| {
            let normals = mesh.triangles()[triangle].map(|index| mesh.normals().get(index as usize).copied());
            normals.map(|normal| normal.unwrap_or_else(|| plane(triangle)))
        };
        let is_flat = |triangle: usize| {
            let given = given(triangle);
            let is_own = |normal: &Vector3<f64>| {
                normal.dot(&plane(triangle)).abs() >= SAME_NORMAL.cos()
                    && (normal - given[0]).norm() < ROUNDED
            };
            given.iter().all(is_own)
        };
        let count = mesh.triangles().len();
        let are_flat: Vec<bool> = (0..count).map(is_flat).collect();
        if !are_flat.contains(&true) {
            return None;
        }
        let welded = weld(mesh.positions());
        let places: Vec<[u32; 3]> =
            mesh.triangles().iter().map(|corners| corners.map(|index| welded[index as usize])).collect();
        let opposite = opposite_sides(&places);
        let mut shading = Self { opposite, faces: vec![NONE; count], facets: Vec::new() };
        let mut front = Vec::new();
        for seed in 0..count {
            if !are_flat[seed] || shading.faces[seed] != NONE {
                continue;
            }
            let number = shading.facets.len() as u32;
            let normal = given(seed)[0];
            let mut facet = Facet { normal, ..Facet::default() };
            shading.faces[seed] = number;
            front.push(seed);
            while let Some(triangle) = front.pop() {
                let points = mesh.corners(mesh.triangles()[triangle]);
                let area = area(points);
                facet.area += area;
                facet.middle += points.iter().map(|point| point.coords).sum::<Vector3<f64>>() * (area / 3.0);
                for side in 0..3 {
                    let other = shading.opposite[3 * triangle + side] as usize / 3;
                    let continues = are_flat.get(other) == Some(&true)
                        && given(other)[0].dot(&normal) >= SAME_NORMAL.cos();
                    if !continues {
                        facet.perimeter += (points[(side + 1) % 3] - points[side]).norm();
                    } else if shading.faces[other] == NONE {
                        shading.faces[other] = number;
                        front.push(other);
                    }
                }
            }
            shading.facets.push(facet);
        }
        Some(shading)
    }

    /// For each triangle, the number of the body that it belongs to.
    fn bodies(&self) -> Vec<u32> {
        let (mut bodies, mut next, mut front) = (vec![NONE; self.faces.len()], 0, Vec::new());
        for seed in 0..bodies.len() {
            if bodies[seed] != NONE {
                continue;
            }
            bodies[seed] = next;
            front.push(seed);
            while let Some(triangle) = front.pop() {
                for &side in &self.opposite[3 * triangle..3 * triangle + 3] {
                    let other = side as usize / 3;
                    if side != NONE && bodies[other] == NONE {
                        bodies[other] = next;
                        front.push(other);
                    }
                }
            }
            next += 1;
        }
        bodies
    }

    /// See [`turns_of_facets`].
    fn turns(&self) -> Vec<f64> {
        let mut largest = vec![0.0f64; self.facets.len()];
        for Turn { facets, angle, .. } in self.continuing() {
            // The last facet of a face has one neighbour that is like it.
            for facet in facets {
                largest[facet as usize] = largest[facet as usize].max(angle);
            }
        }
        self.faces.iter().map(|&face| largest.get(face as usize).copied().unwrap_or(0.0)).collect()
    }

    /// The turns that go on at another side of their first facet.
    fn continuing(&self) -> Vec<Turn> {
        let mut turns: Vec<Turn> = (0..self.opposite.len()).filter_map(|side| self.turn(side)).collect();
        turns.sort_by_key(|turn| turn.facets);
        let goes_on: Vec<bool> = turns
            .chunk_by(|one, other| one.facets[0] == other.facets[0])
            .flat_map(|around| around.iter().map(|turn| around.iter().any(|other| turn.goes_on_in(other))))
            .collect();
        turns.into_iter().zip(goes_on).filter(|(_, goes_on)| *goes_on).map(|(turn, _)| turn).collect()
    }

    /// The turn across a side, if the facets on both sides could be of one round face.
    fn turn(&self, side: usize) -> Option<Turn> {
        let facets = [self.faces[side / 3], *self.faces.get(self.opposite[side] as usize / 3)?];
        let [one, other] = facets.map(|facet| self.facets.get(facet as usize));
        let (one, other) = (one?, other?);
        let angle = one.normal.angle(&other.normal);
        let could_be_round =
            (SAME_NORMAL..=CREASE_ANGLE).contains(&angle) && are_alike(one.width(), other.width());
        let step = other.middle() - one.middle();
        let (bulge, is_convex) = (step.norm() * angle / 8.0, one.normal.dot(&step) < 0.0);
        (could_be_round && facets[0] != facets[1]).then_some(Turn { facets, angle, bulge, is_convex })
    }
}

fn area([a, b, c]: [Point3<f64>; 3]) -> f64 {
    (b - a).cross(&(c - a)).norm() / 2.0
}

fn are_alike(one: f64, other: f64) -> bool {
    one <= ALIKE * other && other <= ALIKE * one
}
