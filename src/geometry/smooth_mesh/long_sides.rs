//! Normals at the ends of long, straight sides, as those of a fillet that runs along a part and ends in its corner.
//!
//! An estimate from the facets round such an end leans towards the short ones, and over the length of the side that is a bulge.
//! The short ones tell where they begin to bend: a curve through the section behind the end starts in the direction of the
//! side.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::SmoothMesh;
use super::sections::{Facets, turn};
use crate::geometry::adjacency::{NONE, facet_normal};

/// What a normal bends a side by is left as it is below this, mm.
const PLAIN: f64 = 2e-3;
/// Facets contain the direction of a side when their normals are this near to a right angle with it, rad.
const CONTAINS: f64 = 2e-3;
/// Facets of one plane: the cosine between their normals. Diagonals in it are no sides of the part.
const COPLANAR: f64 = 0.9998;
/// Facets looked at round a vertex, at most.
const MOST_FACETS: usize = 64;
/// The section behind an end is looked at over this share of the side's length, and until it has turned by [`FAR`], rad; over
/// so many pieces at least.
const BEHIND: f64 = 0.4;
const FAR: f64 = 0.8;
const LEAST_PIECES: usize = 3;
/// A side is straight where it would be flatter than the section behind its end by this factor.
const FLATTER: f64 = 0.04;
/// The chords of a tessellation leave the part by about the same distance everywhere. A side is straight where it would bulge so
/// many times as far as all others at its end.
const IMPLAUSIBLE: f64 = 6.0;
/// Sides nearer to the direction of a side than this, as a cosine, are diagonals beside it and would bulge as far.
const ALONGSIDE: f64 = 0.5;
/// Sides are parallel and equally long if they differ by less than this share of their length. The chords of two rings round a
/// fillet are parallel, too, but not as long.
const PARALLEL: f64 = 1e-4;
/// Parallel sides from a straight one on, at most.
const MOST_PARALLEL: usize = 32;
/// Sides at one vertex that can be straight: a plane is held by two.
const MOST_SIDES: usize = 2;

/// Turns the `estimated` normals at the ends of straight sides of the `chosen` triangles to a right angle with them; returns the
/// vertices.
pub(super) fn straighten(mesh: &mut SmoothMesh, estimated: &[bool], chosen: &[bool]) -> Vec<u32> {
    let mut straight = ends_of_straight_sides(mesh, estimated, chosen);
    // The longest side of a vertex comes first.
    straight.sort_by(|one, other| {
        one.0.cmp(&other.0).then(other.1.norm_squared().total_cmp(&one.1.norm_squared()))
    });
    for sides in straight.chunk_by(|one, other| one.0 == other.0) {
        let vertex = sides[0].0 as usize;
        for (_, chord) in sides.iter().take(MOST_SIDES) {
            let normal = mesh.normals[vertex];
            let level = normal - chord * (normal.dot(chord) / chord.norm_squared());
            mesh.normals[vertex] = level.try_normalize(0.0).unwrap_or(normal);
        }
    }
    straight.dedup_by_key(|side| side.0);
    straight.into_iter().map(|side| side.0).collect()
}

/// Each vertex that leans from a straight side, with the side from there on.
fn ends_of_straight_sides(
    mesh: &SmoothMesh,
    estimated: &[bool],
    chosen: &[bool],
) -> Vec<(u32, Vector3<f64>)> {
    let facets =
        Facets { positions: &mesh.positions, triangles: &mesh.triangles, continued: &mesh.continued };
    let normal = |side: usize| facet_normal(facets.corners(side / 3));
    let (mut straight, mut open) = (Vec::new(), Vec::new());
    for side in 0..mesh.continued.len() {
        let other = mesh.continued[side] as usize;
        if mesh.continued[side] == NONE || other < side || !chosen[side / 3] {
            continue;
        }
        let corners = mesh.triangles[side / 3];
        let ends = [corners[side % 3], corners[(side % 3 + 1) % 3]];
        let [from, to] = facets.ends(side);
        let chord = to - from;
        let leans = ends.map(|vertex| {
            estimated[vertex as usize] && mesh.normals[vertex as usize].dot(&chord).abs() > 4.0 * PLAIN
        });
        if leans == [false; 2] || normal(side).dot(&normal(other)) > COPLANAR {
            continue;
        }
        let is_ruling = ends.iter().all(|&vertex| {
            let limit = CONTAINS * chord.norm();
            let contains = |triangle| facet_normal(facets.corners(triangle)).dot(&chord).abs() < limit;
            find_round(mesh, vertex, side, |triangle, _| !contains(triangle)).is_none()
        });
        for (vertex, chord, leans) in [(ends[0], chord, leans[0]), (ends[1], -chord, leans[1])] {
            if !leans {
                continue;
            }
            let is_straight = is_ruling
                || bulges_alone(mesh, vertex, side, chord)
                || bends_from(mesh, &facets, vertex, side, chord);
            match is_straight {
                true => straight.push((vertex, chord)),
                false => open.push((vertex, chord, side)),
            }
        }
    }
    add_parallel(mesh, &mut straight, open);
    straight
}

/// Adds the `open` sides that run beside a straight one, as long as it and in its direction: the sides of a cylinder are alike.
fn add_parallel(
    mesh: &SmoothMesh,
    straight: &mut Vec<(u32, Vector3<f64>)>,
    mut open: Vec<(u32, Vector3<f64>, usize)>,
) {
    let mut known: BTreeMap<u32, Vec<Vector3<f64>>> = BTreeMap::new();
    straight.iter().for_each(|&(vertex, chord)| known.entry(vertex).or_default().push(chord));
    for _ in 0..MOST_PARALLEL {
        let is_alike = |&(vertex, chord, side): &(u32, Vector3<f64>, usize)| {
            let alike = |other: &u32| {
                let chords = known.get(other).into_iter().flatten();
                chords.into_iter().any(|other| (other - chord).norm() < PARALLEL * chord.norm())
            };
            find_round(mesh, vertex, side, |triangle, _| mesh.triangles[triangle].iter().any(alike)).is_some()
        };
        let (alike, others): (Vec<_>, Vec<_>) = open.into_iter().partition(is_alike);
        open = others;
        if alike.is_empty() {
            break;
        }
        for (vertex, chord, _) in alike {
            known.entry(vertex).or_default().push(chord);
            straight.push((vertex, chord));
        }
    }
}

/// The first of the facets round a `vertex` of a side, triangle and corner, that is wanted; of those that continue the side's.
fn find_round(
    mesh: &SmoothMesh,
    vertex: u32,
    side: usize,
    mut is_wanted: impl FnMut(usize, usize) -> bool,
) -> Option<(usize, usize)> {
    let corner_of = |triangle: usize| {
        (0..3).find(|&corner| mesh.triangles[triangle][corner] == vertex).unwrap_or_default()
    };
    let start = (side / 3, corner_of(side / 3));
    if is_wanted(start.0, start.1) {
        return Some(start);
    }
    let mut count = 1;
    for turn in [0, 2] {
        let mut side = start.0 * 3 + (start.1 + turn) % 3;
        while count < MOST_FACETS && mesh.continued[side] != NONE {
            let entered = mesh.continued[side] as usize;
            let (triangle, corner) = (entered / 3, corner_of(entered / 3));
            if triangle == start.0 {
                return None;
            }
            if is_wanted(triangle, corner) {
                return Some((triangle, corner));
            }
            count += 1;
            // The other side at the vertex.
            side = triangle * 3 + if entered % 3 == corner { (corner + 2) % 3 } else { corner };
        }
    }
    None
}

/// Whether a side, `chord` from its `vertex`, would bulge much farther than the others there, of which some lead away from it.
fn bulges_alone(mesh: &SmoothMesh, vertex: u32, side: usize, chord: Vector3<f64>) -> bool {
    let (at, normal) = (mesh.positions[vertex as usize], mesh.normals[vertex as usize]);
    let limit = normal.dot(&chord).abs() / IMPLAUSIBLE;
    let mut leads_away = false;
    let bulges = |triangle: usize, _: usize| {
        let others = mesh.triangles[triangle].iter().map(|&other| mesh.positions[other as usize] - at);
        let mut aside = others.filter(|other| {
            let along = other.dot(&chord) / chord.norm();
            leads_away |= along < -ALONGSIDE * other.norm();
            along <= ALONGSIDE * other.norm()
        });
        aside.any(|other| normal.dot(&other).abs() > limit)
    };
    find_round(mesh, vertex, side, bulges).is_none() && leads_away
}

/// Whether the section behind a `vertex` of a side begins to bend there, in the direction of the side, `chord`, that leads from
/// the vertex.
fn bends_from(mesh: &SmoothMesh, facets: &Facets, vertex: u32, side: usize, chord: Vector3<f64>) -> bool {
    let Some(across) = mesh.normals[vertex as usize].cross(&chord).try_normalize(0.0) else { return false };
    // The directions of the pieces as a straight line over the way from the vertex, by least squares.
    let long = chord.norm();
    let (mut way, mut turned, mut last, mut count) = (0.0, 0.0, -chord, 0);
    let [mut weight, mut by_way, mut by_square, mut turns, mut turns_by_way] = [0.0; 5];
    let mut add = |_: usize, piece: Vector3<f64>| {
        let length = piece.norm();
        turned += turn(last, piece, across);
        last = piece;
        let at = way + length / 2.0;
        way += length;
        if way > BEHIND * long || (count >= LEAST_PIECES && turned.abs() > FAR) {
            return false;
        }
        count += 1;
        weight += length;
        by_way += length * at;
        by_square += length * at * at;
        turns += length * turned;
        turns_by_way += length * at * turned;
        true
    };
    let is_behind = |triangle, corner| facets.section_behind((triangle, corner), across, chord, &mut add);
    if find_round(mesh, vertex, side, is_behind).is_none() || count < LEAST_PIECES {
        return false;
    }
    let whole = weight * by_square - by_way * by_way;
    if !(whole > 0.0) {
        return false;
    }
    let start = (by_square * turns - by_way * turns_by_way) / whole;
    let bend = (weight * turns_by_way - by_way * turns) / whole;
    start.abs() < FLATTER * bend.abs() * long / 2.0
}
