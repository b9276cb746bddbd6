//! Normals where arcs of different radii continue each other, as on ovals, bottles and filleted boxes.
//!
//! The estimate from the facets round a vertex is exact on an arc that is cut evenly. Where two arcs meet it is wrong, and
//! estimates from more vertices are wrong beside it, too. Leans show it: the normals at both ends of a side of an arc lean
//! from it by equal and opposite angles. Where exact estimates surround a vertex at which the leans are uneven, the normal
//! of that vertex follows from them.

use nalgebra::Vector3;

use super::SmoothMesh;
use crate::geometry::adjacency::Neighbours;
use crate::geometry::flats::derived_normal;
use crate::geometry::osculating_jet::EstimatedNormal;

/// A vertex is on an extruded strip if its normal turns along one side by at most this share of the largest turn.
const RULING: f64 = 0.05;
/// Uneven leans that bend a side by less than this, mm, do not matter.
pub(super) const NEGLIGIBLE_BEND: f64 = 1e-3;
/// A lean is even beside a vertex if it is uneven by at most this share of what the vertex gains from another normal.
const EVEN: f64 = 0.125;
/// Sides go on beyond a neighbour if they turn by less than this, rad.
const BEYOND: f64 = 1.0;
/// A vertex explains the leans at a neighbour if it gains more than this many times as much from another
/// normal as the neighbour does. Where arcs meet, it gains twice as much as beside that place.
const EXPLAINS: f64 = 1.3;
/// A side that normals bend is at most this many times as long as the shortest side at its vertex.
const MOST_LONGER: f64 = 6.0;
/// Another normal at a vertex helps if it takes at least this share of the largest lean: all of it where arcs meet, and a third
/// beside.
const HELPED: f64 = 0.25;
/// A derived normal is accepted where it leaves at most this share of the squares of the leans.
const LEFT: f64 = 1.0 / 16.0;

/// A vertex with uneven leans.
struct Uneven {
    vertex: u32,
    /// The sum of their squares, rad².
    squares: f64,
    /// By how much another normal at the vertex would reduce the largest lean, rad.
    gain: f64,
    /// Whether that is a notable share of it.
    is_helped: bool,
}

/// The mesh has estimates from the facets round each vertex. Replaces them by `refined` ones. Where arcs
/// meet, and beside such places, replaces them by the normals that the arcs lead to. Returns the vertices
/// where these arcs settle the normal: beside a side that is much longer than another one, a small error
/// would bend it far. `refined`, in ascending order, has all vertices at which a side bends.
pub(super) fn join(
    mesh: &mut SmoothMesh,
    refined: &[(u32, EstimatedNormal)],
    estimated: &[bool],
    around: &Neighbours,
) -> Vec<u32> {
    let first = &mesh.normals;
    let uneven = uneven_vertices(mesh, refined.iter().map(|(vertex, _)| *vertex), around);
    let gain_at = |vertex: u32| {
        let found = uneven.binary_search_by_key(&vertex, |there| there.vertex);
        found.map_or(0.0, |index| uneven[index].gain)
    };
    let ring = |vertex: u32| around.of_vertex(vertex as usize).iter().copied();
    let lean = |one: u32, other: u32| lean(mesh, [one, other], [first[one as usize], first[other as usize]]);
    // Whether a neighbour is on an arc: the lean beyond it is even, and others explain better what is uneven round it.
    let is_exact = |neighbour: u32, there: &Uneven| {
        let step = |from: u32, to: u32| mesh.positions[to as usize] - mesh.positions[from as usize];
        let (gain, to_it) = (gain_at(neighbour), step(there.vertex, neighbour));
        let is_even = |other: u32| lean(neighbour, other).abs() <= EVEN * there.gain;
        let goes_on = |other: u32| step(neighbour, other).angle(&to_it) < BEYOND;
        let mut others = ring(neighbour).filter(|&other| other != there.vertex);
        others.clone().any(|other| goes_on(other) && is_even(other))
            && others.all(|other| is_even(other) || gain_at(other) > EXPLAINS * gain)
    };
    let derived: Vec<Option<Vector3<f64>>> = uneven
        .iter()
        .map(|there| {
            let exact = ring(there.vertex).filter(|&other| there.is_helped && is_exact(other, there));
            derived_normal(&mesh.positions, first, there.vertex as usize, exact.map(|other| other as usize))
        })
        .collect();
    let now = |vertex: u32| {
        let found = uneven.binary_search_by_key(&vertex, |there| there.vertex);
        found.ok().and_then(|index| derived[index]).unwrap_or(first[vertex as usize])
    };
    let mut changes: Vec<(u32, Vector3<f64>)> = Vec::new();
    for (there, derived) in uneven.iter().zip(&derived) {
        let Some(derived) = derived else { continue };
        let left =
            ring(there.vertex).map(|other| self::lean(mesh, [there.vertex, other], [*derived, now(other)]));
        if left.map(|lean| lean * lean).sum::<f64>() <= LEFT * there.squares {
            changes.push((there.vertex, *derived));
        }
    }
    // Refined estimates reach two vertices far.
    let is_changed = |vertex: u32| changes.binary_search_by_key(&vertex, |change| change.0).is_ok();
    let near = changes.iter().flat_map(|change| ring(change.0).flat_map(ring));
    let mut near: Vec<u32> =
        near.filter(|&vertex| estimated[vertex as usize] && !is_changed(vertex)).collect();
    near.sort_unstable();
    near.dedup();
    near.retain(|&vertex| uneven.binary_search_by_key(&vertex, |there| there.vertex).is_err());
    for (vertex, estimate) in refined.iter().filter(|(vertex, _)| near.binary_search(vertex).is_err()) {
        mesh.normals[*vertex as usize] = estimate.normal;
    }
    changes.iter().for_each(|&(vertex, normal)| mesh.normals[vertex as usize] = normal);
    let is_settled = |vertex: u32| {
        let (mut shortest, mut longest) = (f64::INFINITY, 0.0f64);
        for &other in around.of_vertex(vertex as usize) {
            let length = (mesh.positions[other as usize] - mesh.positions[vertex as usize]).norm();
            let turn = (mesh.normals[other as usize] - mesh.normals[vertex as usize]).norm();
            shortest = shortest.min(length);
            if turn * length > 8.0 * NEGLIGIBLE_BEND {
                longest = longest.max(length);
            }
        }
        longest <= MOST_LONGER * shortest
    };
    changes.into_iter().map(|(vertex, _)| vertex).filter(|&vertex| is_settled(vertex)).collect()
}

/// By how much the normals at both ends of a side lean towards the same end, rad; 0 on an arc.
fn lean(mesh: &SmoothMesh, [one, other]: [u32; 2], normals: [Vector3<f64>; 2]) -> f64 {
    let side = mesh.positions[other as usize] - mesh.positions[one as usize];
    side.try_normalize(0.0).map_or(0.0, |along| (normals[0] + normals[1]).dot(&along))
}

/// Those of some vertices at which leans are uneven, in the same order.
fn uneven_vertices(
    mesh: &SmoothMesh,
    vertices: impl Iterator<Item = u32>,
    around: &Neighbours,
) -> Vec<Uneven> {
    let first = &mesh.normals;
    let mut uneven = Vec::new();
    for vertex in vertices {
        let here = vertex as usize;
        let ring = around.of_vertex(here);
        let of = |normal: Vector3<f64>| {
            ring.iter().map(move |&other| lean(mesh, [vertex, other], [normal, first[other as usize]]))
        };
        let bends = ring.iter().zip(of(first[here])).any(|(&other, lean)| {
            let length = (mesh.positions[other as usize] - mesh.positions[here]).norm();
            lean.abs() * length > 8.0 * NEGLIGIBLE_BEND
        });
        let turns = || ring.iter().map(|&other| (first[other as usize] - first[here]).norm());
        let is_on_strip = || turns().fold(f64::INFINITY, f64::min) <= RULING * turns().fold(0.0, f64::max);
        if !bends || !is_on_strip() {
            continue;
        }
        let squares: f64 = of(first[here]).map(|lean| lean * lean).sum();
        let all = ring.iter().map(|&other| other as usize);
        let Some(better) = derived_normal(&mesh.positions, first, here, all) else { continue };
        let largest = |normal| of(normal).map(f64::abs).fold(0.0, f64::max);
        let lean = largest(first[here]);
        let gain = (lean - largest(better)).max(0.0);
        uneven.push(Uneven { vertex, squares, gain, is_helped: gain > HELPED * lean });
    }
    uneven
}
