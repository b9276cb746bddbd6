//! Which way round the triangles of a mesh run. Estimated normals are sums over facets, and facets that run in opposite ways
//! cancel out.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::adjacency::{NONE, numbered, opposite_sides, sliver_side, weld};
use super::mesh::TriMesh;

/// Directions are different if they differ by more than this, rad: files round normals to three or four
/// digits.
const SAME: f64 = 0.25 * std::f64::consts::PI / 180.0;
/// If more than this share of the vertices meets triangles that run in opposite ways, the other normals show
/// nothing more.
const FEW: f64 = 0.25;
/// Normals were computed from the triangles as they run if more than this many times as many normals show
/// this as the opposite.
const MANY_TIMES: usize = 3;
/// Normals are equal if their components, multiplied by this and rounded, are equal.
const ONE: f64 = 1e4;
/// Normals of triangles that meet and run in opposite ways are opposite below this, as a cosine.
const OPPOSITE: f64 = -0.8;

/// What was found of a mesh whose triangles were made to run alike.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Winding {
    /// Triangles that were reversed.
    pub reversed: usize,
    /// The first place, mm, where two neighbours cannot run alike because the mesh has only one side, as a Möbius strip.
    pub contradiction: Option<Point3<f64>>,
    /// Vertices whose normals in the file are averages over triangles that run in opposite ways: they are missing now.
    pub spoilt_normals: usize,
}

/// The mesh with triangles that all run alike: neighbours run along their common side in opposite directions.
/// A closed body whose triangles disagree is oriented so that its outside is outside. Of an open body, the
/// smaller area is reversed.
///
/// Where triangles have normals, each runs as its own normals require, and none is reported as reversed,
/// unless the normals were computed from triangles that ran in opposite ways. A one-sided mesh keeps a seam
/// across which its triangles disagree. A triangle that is in the mesh twice is not a neighbour of its copy:
/// both are reversed, or none.
pub fn made_alike(mesh: TriMesh) -> (TriMesh, Winding) {
    let welded = weld(mesh.positions());
    let places: Vec<[u32; 3]> =
        mesh.triangles().iter().map(|corners| corners.map(|vertex| welded[vertex as usize])).collect();
    let sides = Sides { opposite: opposite_sides(&places), places };
    if (0..sides.opposite.len()).all(|side| sides.agrees(side)) {
        return as_normals_ask(mesh);
    }
    let copies = copies(&sides.places);
    let sides = if copies.is_empty() { sides } else { sides.without(&copies) };
    let (mut is_reversed, contradiction) = reversals(&mesh, &sides);
    copies.iter().for_each(|&[first, copy]| is_reversed[copy] = is_reversed[first]);
    let reversed = is_reversed.iter().filter(|reversed| **reversed).count();
    let winding = Winding { reversed, contradiction, spoilt_normals: 0 };
    if mesh.normals().is_empty() {
        return (mesh.with_reversed(&is_reversed), winding);
    }
    let mixed = Mixed::of(&mesh, &welded, &is_reversed);
    if !mixed.explains_normals(&mesh) {
        return as_normals_ask(mesh);
    }
    let (mesh, spoilt_normals) = mixed.without_spoilt_normals(mesh);
    (mesh.with_reversed(&is_reversed), Winding { spoilt_normals, ..winding })
}

/// The mesh with triangles that run as their own normals ask for.
fn as_normals_ask(mesh: TriMesh) -> (TriMesh, Winding) {
    if mesh.normals().is_empty() {
        return (mesh, Winding::default());
    }
    let is_against = |&corners: &[u32; 3]| runs_against_normals(&mesh, corners);
    let is_reversed: Vec<bool> = mesh.triangles().iter().map(is_against).collect();
    (mesh.with_reversed(&is_reversed), Winding::default())
}

/// Triangles round something: sums of their normals, as they run in the file, weighted by their angles there.
#[derive(Clone, Copy, Default)]
struct Around {
    /// Of those that run right.
    kept: Vector3<f64>,
    /// Of those that were reversed.
    reversed: Vector3<f64>,
    counts: [usize; 2],
}

impl Around {
    fn add(&mut self, normal: Vector3<f64>, is_reversed: bool) {
        *(if is_reversed { &mut self.reversed } else { &mut self.kept }) += normal;
        self.counts[usize::from(is_reversed)] += 1;
    }

    fn is_mixed(&self) -> bool {
        !self.counts.contains(&0)
    }
}

/// Where triangles that were reversed meet others.
struct Mixed<'a> {
    /// The place of each vertex.
    welded: &'a [u32],
    /// The number of the place and normal of each vertex: programs write one of several vertices where the texture has a seam.
    numbers: Vec<u32>,
    /// For each of these.
    around: Vec<Around>,
    /// For each place, whether reversed triangles have opposite normals of their own there.
    is_opposed: Vec<bool>,
}

impl<'a> Mixed<'a> {
    fn of(mesh: &TriMesh, welded: &'a [u32], is_reversed: &[bool]) -> Self {
        let digits = |value: f64| (value * ONE).round() as i64;
        let key = |vertex: usize| {
            let [x, y, z] = mesh.normals()[vertex].map(digits).into();
            [i64::from(welded[vertex]), x * 2 * ONE as i64 + y, z]
        };
        let numbers = numbered(welded.len(), key);
        let count = numbers.iter().max().map_or(0, |last| *last as usize + 1);
        let mut around = vec![Around::default(); count];
        for (&corners, &is_reversed) in mesh.triangles().iter().zip(is_reversed) {
            let points = mesh.corners(corners);
            if sliver_side(points).is_some() {
                continue;
            }
            let normal = area_vector(mesh, corners).normalize();
            for corner in 0..3 {
                let [here, next, last] = [0, 1, 2].map(|turn| points[(corner + turn) % 3]);
                let weighted = normal * (next - here).angle(&(last - here));
                around[numbers[corners[corner] as usize] as usize].add(weighted, is_reversed);
            }
        }
        let mut is_opposed = vec![false; welded.len()];
        let around_of = |vertex: usize| &around[numbers[vertex] as usize];
        let vertices = |is_wanted: fn([usize; 2]) -> bool| {
            let vertices = (0..welded.len()).filter(move |&vertex| is_wanted(around_of(vertex).counts));
            vertices.map(|vertex| (welded[vertex], mesh.normals()[vertex]))
        };
        let mut of_reversed: BTreeMap<u32, Vec<Vector3<f64>>> = BTreeMap::new();
        for (place, normal) in vertices(|[kept, reversed]| kept == 0 && reversed > 0) {
            of_reversed.entry(place).or_default().push(normal);
        }
        for (place, normal) in vertices(|[kept, reversed]| kept > 0 && reversed == 0) {
            let mut others = of_reversed.get(&place).into_iter().flatten();
            is_opposed[place as usize] |= others.any(|other| normal.dot(other) < OPPOSITE);
        }
        Self { welded, numbers, around, is_opposed }
    }

    fn around(&self, vertex: usize) -> &Around {
        &self.around[self.numbers[vertex] as usize]
    }

    /// Whether the file's normals follow the triangles as they run in the file, and not as they should run.
    /// Then they were computed from the triangles. Only normals where both kinds of triangles meet show this:
    /// normals of the modelled surface show its outside for both kinds, or its inside.
    fn explains_normals(&self, mesh: &TriMesh) -> bool {
        let off =
            |normal: &Vector3<f64>, sum: Vector3<f64>| normal.cross(&sum).norm().atan2(normal.dot(&sum));
        let (mut for_file, mut for_surface) = (0usize, 0usize);
        for (vertex, normal) in mesh.normals().iter().enumerate() {
            let Around { kept, reversed, counts } = *self.around(vertex);
            if counts[1] == 0 || *normal == Vector3::zeros() {
                continue;
            }
            if counts[0] == 0 {
                for_file += usize::from(self.is_opposed[self.welded[vertex] as usize]);
                continue;
            }
            let surface = kept - reversed;
            let from_file = off(normal, kept + reversed);
            let from_surface = off(normal, surface).min(off(normal, -surface));
            if from_file + SAME < from_surface {
                for_file += 1;
            } else if from_surface + SAME < from_file {
                for_surface += 1;
            }
        }
        for_file > MANY_TIMES * for_surface
    }

    /// The mesh whose normals show the outside of the reversed triangles, without those that are averages over triangles which run in
    /// opposite ways, or over one kind of them where both meet, and their number. A mesh with few others keeps none.
    fn without_spoilt_normals(&self, mesh: TriMesh) -> (TriMesh, usize) {
        let is_used = |vertex: &usize| self.around(*vertex).counts != [0, 0];
        let used = (0..self.numbers.len()).filter(is_used).count();
        let is_spoilt =
            |vertex: usize| self.around(vertex).is_mixed() || self.is_opposed[self.welded[vertex] as usize];
        let spoilt = (0..self.numbers.len()).filter(|vertex| is_used(vertex) && is_spoilt(*vertex)).count();
        if spoilt as f64 > FEW * used as f64 {
            return (mesh.without_normals(), used);
        }
        let repaired = |vertex: usize, normal: Vector3<f64>| {
            if is_spoilt(vertex) {
                Vector3::zeros()
            } else if normal.dot(&self.around(vertex).reversed) > 0.0 {
                -normal
            } else {
                normal
            }
        };
        (mesh.with_changed_normals(repaired), spoilt)
    }
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
