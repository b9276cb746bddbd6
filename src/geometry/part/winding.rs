//! Which way round the triangles of a mesh run. Estimated normals are sums over facets, and facets that run in opposite ways
//! cancel out.

use nalgebra::{Point3, Vector3};

use super::adjacency::{NONE, opposite_sides, weld};
use super::mesh::TriMesh;

/// What was found of a mesh whose triangles were made to run alike.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Winding {
    /// Triangles that were reversed.
    pub reversed: usize,
    /// The first place, mm, where two neighbours cannot run alike because the mesh has only one side, as a Möbius strip.
    pub contradiction: Option<Point3<f64>>,
}

/// The mesh with triangles that all run alike: neighbours run along their common side in opposite directions. A closed body
/// whose triangles disagree gets its outside outside; of an open one the smaller area is reversed.
///
/// Where triangles have normals, each runs as its own normals ask for, and nothing is counted. A one-sided mesh keeps a seam
/// across which its triangles disagree. A triangle that is in the mesh once more is no neighbour of its copy: both are reversed, or none.
pub fn made_alike(mesh: TriMesh) -> (TriMesh, Winding) {
    if !mesh.normals().is_empty() {
        let is_against = |&corners: &[u32; 3]| runs_against_normals(&mesh, corners);
        let is_reversed: Vec<bool> = mesh.triangles().iter().map(is_against).collect();
        return (mesh.with_reversed(&is_reversed), Winding::default());
    }
    let welded = weld(mesh.positions());
    let places: Vec<[u32; 3]> =
        mesh.triangles().iter().map(|corners| corners.map(|vertex| welded[vertex as usize])).collect();
    let sides = Sides { opposite: opposite_sides(&places), places };
    if (0..sides.opposite.len()).all(|side| sides.agrees(side)) {
        return (mesh, Winding::default());
    }
    let copies = copies(&sides.places);
    let sides = if copies.is_empty() { sides } else { sides.without(&copies) };
    let (mut is_reversed, contradiction) = reversals(&mesh, &sides);
    copies.iter().for_each(|&[first, copy]| is_reversed[copy] = is_reversed[first]);
    let reversed = is_reversed.iter().filter(|reversed| **reversed).count();
    (mesh.with_reversed(&is_reversed), Winding { reversed, contradiction })
}

fn runs_against_normals(mesh: &TriMesh, corners: [u32; 3]) -> bool {
    let across = area_vector(mesh, corners);
    corners.iter().all(|&vertex| mesh.normals()[vertex as usize].dot(&across) < 0.0)
}

/// The triangles between places that are in a mesh once more, each after the first one with the same corners.
fn copies(places: &[[u32; 3]]) -> Vec<[usize; 2]> {
    let sorted = |triangle: usize| {
        let mut corners = places[triangle];
        corners.sort_unstable();
        corners
    };
    let mut all: Vec<([u32; 3], usize)> =
        (0..places.len()).map(|triangle| (sorted(triangle), triangle)).collect();
    all.sort_unstable();
    let runs = all.chunk_by(|one, other| one.0 == other.0);
    runs.flat_map(|same| same[1..].iter().map(|copy| [same[0].1, copy.1])).collect()
}

/// Sides of triangles between places.
struct Sides {
    places: Vec<[u32; 3]>,
    opposite: Vec<u32>,
}

impl Sides {
    /// The sides that are left when copies have none.
    fn without(mut self, copies: &[[usize; 2]]) -> Self {
        // A triangle whose corners are at one place has no sides.
        copies.iter().for_each(|&[_, copy]| self.places[copy] = [self.places[copy][0]; 3]);
        Self { opposite: opposite_sides(&self.places), places: self.places }
    }

    /// Whether a side's triangle and the one beyond it run alike, or nothing is beyond.
    fn agrees(&self, side: usize) -> bool {
        let start = |side: usize| self.places[side / 3][side % 3];
        self.opposite[side] == NONE || start(side) != start(self.opposite[side] as usize)
    }
}

/// For each triangle whether it is to be reversed, and the first place where that does not help.
fn reversals(mesh: &TriMesh, sides: &Sides) -> (Vec<bool>, Option<Point3<f64>>) {
    let count = mesh.triangles().len();
    let (mut is_reversed, mut is_met) = (vec![false; count], vec![false; count]);
    let mut contradiction = None;
    for first in 0..count {
        if std::mem::replace(&mut is_met[first], true) {
            continue;
        }
        // All that hangs together, nearest first.
        let mut body = vec![first];
        let mut at = 0;
        while at < body.len() {
            let here = body[at];
            at += 1;
            for side in here * 3..here * 3 + 3 {
                let beyond = sides.opposite[side] as usize / 3;
                if sides.opposite[side] != NONE && !std::mem::replace(&mut is_met[beyond], true) {
                    is_reversed[beyond] = is_reversed[here] ^ !sides.agrees(side);
                    body.push(beyond);
                }
            }
        }
        let own_sides = || body.iter().flat_map(|&triangle| triangle * 3..triangle * 3 + 3);
        let disagrees = |side: &usize| {
            let beyond = sides.opposite[*side] as usize / 3;
            sides.opposite[*side] != NONE
                && (is_reversed[side / 3] == is_reversed[beyond]) != sides.agrees(*side)
        };
        let disagreeing = own_sides().filter(disagrees).count();
        let before = own_sides().filter(|&side| !sides.agrees(side)).count();
        if let Some(side) = own_sides().find(disagrees) {
            let corners = mesh.corners(mesh.triangles()[side / 3]);
            contradiction.get_or_insert(nalgebra::center(&corners[side % 3], &corners[(side + 1) % 3]));
        }
        if before <= disagreeing {
            body.iter().for_each(|&triangle| is_reversed[triangle] = false);
            continue;
        }
        let is_closed = own_sides().all(|side| sides.opposite[side] != NONE);
        if is_inside_out(mesh, &body, &is_reversed, is_closed) {
            body.iter().for_each(|&triangle| is_reversed[triangle] = !is_reversed[triangle]);
        }
    }
    (is_reversed, contradiction)
}

/// Whether a body with some triangles reversed has its inside outside, or, where it is open, more than half of its area
/// reversed.
fn is_inside_out(mesh: &TriMesh, body: &[usize], is_reversed: &[bool], is_closed: bool) -> bool {
    let signed = |triangle: usize, value: f64| if is_reversed[triangle] { -value } else { value };
    let origin = mesh.corners(mesh.triangles()[body[0]])[0];
    let share = |&triangle: &usize| {
        let corners = mesh.triangles()[triangle];
        let across = area_vector(mesh, corners);
        let height = if is_closed { across.dot(&(mesh.corners(corners)[0] - origin)) } else { across.norm() };
        signed(triangle, height)
    };
    body.iter().map(share).sum::<f64>() < 0.0
}

/// At right angles to a triangle, twice as long as its area.
fn area_vector(mesh: &TriMesh, corners: [u32; 3]) -> Vector3<f64> {
    let [a, b, c] = mesh.corners(corners);
    (b - a).cross(&(c - a))
}
