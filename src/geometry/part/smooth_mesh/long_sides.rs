//! Normals at the ends of long, straight sides, for example of a fillet that runs along a part and ends in
//! its corner.
//!
//! An estimate from the facets round such an end leans towards the short facets. Over the length of the side,
//! this lean is a bulge. The short facets show where they begin to bend: a curve through the section behind
//! the end starts in the direction of the side.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::SmoothMesh;
use super::sections::{Facets, turn};
use crate::geometry::adjacency::{NONE, facet_normal};
use crate::geometry::fork::{Fork, found};

/// A normal is not changed if it bends a side by less than this, mm.
const PLAIN: f64 = 2e-3;
/// Facets contain the direction of a side if the angle between their normals and the side differs from a
/// right angle by less than this, rad.
const CONTAINS: f64 = 2e-3;
/// Facets are in one plane if the cosine of the angle between their normals is larger than this. Diagonals in
/// that plane are not sides of the part.
const COPLANAR: f64 = 0.9998;
/// At most this many facets are looked at round a vertex.
const MOST_FACETS: usize = 64;
/// The section behind an end is followed over at most this share of the length of the side.
const BEHIND: f64 = 0.4;
/// The section behind an end is followed until it has turned by this, rad, but over at least
/// [`LEAST_PIECES`].
const FAR: f64 = 0.8;
/// The section behind an end shows a bend only if it has at least this many pieces.
const LEAST_PIECES: usize = 3;
/// A side is straight if it would be flatter than the section behind its end by this factor.
const FLATTER: f64 = 0.04;
/// A side is straight if it would bulge this many times as far as every other side at its end. The chords of
/// a tessellation leave the part by about the same distance everywhere.
const IMPLAUSIBLE: f64 = 6.0;
/// A side that is straight because of its bulge is also this many times as long as every other side at its
/// end. Where vertices are placed at random, one side bulges by chance.
const MUCH_LONGER: f64 = 4.0;
/// Sides whose angle with a side has a larger cosine than this are diagonals beside it and would bulge as
/// far.
const ALONGSIDE: f64 = 0.5;
/// Sides are parallel and equally long if they differ by less than this share of their length. The chords of two rings round a
/// fillet are parallel, too, but not as long.
const PARALLEL: f64 = 1e-4;
/// From a straight side on, at most this many parallel sides are followed.
const MOST_PARALLEL: usize = 32;
/// At most this many sides at one vertex can be straight: two define a plane.
const MOST_SIDES: usize = 2;
/// On a twisted side of a part, the straight lines run in one direction. A facet's side and one beside it are
/// a straight line and its bent diagonal if the facets at the one and at the other bend in opposite ways, and
/// if the cosine of the angle between the two is larger than this.
const BESIDE: f64 = 0.9;
/// Of a diagonal and the straight line beside it ([`BESIDE`]), the straight line continues within the surface
/// with less than this share of the turn of the diagonal.
const MORE_IN_LINE: f64 = 0.5;

/// One end of a side that may be straight.
#[derive(Clone, Copy)]
pub(super) struct SideEnd {
    vertex: u32,
    /// From the vertex to the other end, mm.
    chord: Vector3<f64>,
    /// 3·t + k: from corner k of triangle t to the next.
    side: usize,
}

/// Turns normals at the ends of straight sides to a right angle with them. Returns the vertices whose side is
/// much longer than all others there: such a normal is known better than the narrow facets show it.
pub(super) fn straighten(mesh: &mut SmoothMesh, mut straight: Vec<SideEnd>) -> Vec<u32> {
    // The longest side of a vertex comes first.
    straight.sort_by(|one, other| {
        let lengths = [other, one].map(|end| end.chord.norm_squared());
        one.vertex.cmp(&other.vertex).then(lengths[0].total_cmp(&lengths[1]))
    });
    let known = straight.iter().filter(|end| is_much_longer(mesh, end)).map(|end| end.vertex);
    let mut known: Vec<u32> = known.collect();
    known.dedup();
    let at_vertices = straight.chunk_by(|one, other| one.vertex == other.vertex);
    let longest = at_vertices.flat_map(|sides| &sides[..sides.len().min(MOST_SIDES)]);
    let held: Vec<SideEnd> = longest.map(|end| straight_beside(mesh, end).unwrap_or(*end)).collect();
    for sides in held.chunk_by(|one, other| one.vertex == other.vertex) {
        let vertex = sides[0].vertex as usize;
        for SideEnd { chord, .. } in sides {
            let normal = mesh.normals[vertex];
            let level = normal - chord * (normal.dot(chord) / chord.norm_squared());
            mesh.normals[vertex] = level.try_normalize(0.0).unwrap_or(normal);
        }
    }
    known
}

/// The side beside a diagonal of a twisted side, at the same vertex, that is straight instead of it; `None` for all others.
fn straight_beside(mesh: &SmoothMesh, end: &SideEnd) -> Option<SideEnd> {
    let at = mesh.positions[end.vertex as usize];
    let facets = [end.side, mesh.continued[end.side] as usize];
    let others = facets.into_iter().flat_map(|own| [1, 2].map(|turn| own / 3 * 3 + (own % 3 + turn) % 3));
    let beside = others.filter_map(|side| {
        let corners = mesh.triangles[side / 3];
        let far = match [corners[side % 3], corners[(side % 3 + 1) % 3]] {
            [near, far] if near == end.vertex => far,
            [far, near] if near == end.vertex => far,
            _ => return None,
        };
        let chord = mesh.positions[far as usize] - at;
        let is_beside = chord.dot(&end.chord) > BESIDE * chord.norm() * end.chord.norm();
        (is_beside && mesh.continued[side] != NONE).then_some(SideEnd { vertex: end.vertex, chord, side })
    });
    let mut beside = beside.filter(|other| is_convex(mesh, other.side) != is_convex(mesh, end.side));
    let limit = MORE_IN_LINE * turns_aside(mesh, end);
    beside.find(|other| turns_aside(mesh, other) < limit)
}

/// Whether the facets on both sides of a side, which another one continues, are lower than its tangent plane.
fn is_convex(mesh: &SmoothMesh, side: usize) -> bool {
    let other = mesh.continued[side] as usize;
    let apex = mesh.corners(other / 3).0[(other % 3 + 2) % 3];
    let (corners, _) = mesh.corners(side / 3);
    facet_normal(corners).dot(&(apex - corners[side % 3])) < 0.0
}

/// By how much a side turns within the surface at both of its ends, as the sum of two sines. It continues to
/// the next vertices most nearly straight ahead; an end at which it does not continue adds nothing.
fn turns_aside(mesh: &SmoothMesh, end: &SideEnd) -> f64 {
    let corners = mesh.triangles[end.side / 3];
    let ends = [corners[end.side % 3], corners[(end.side % 3 + 1) % 3]];
    let far = if ends[0] == end.vertex { ends[1] } else { ends[0] };
    let there = SideEnd { vertex: far, chord: -end.chord, side: end.side };
    let turn = |SideEnd { vertex, chord, side }: &SideEnd| {
        let (at, normal) = (mesh.positions[*vertex as usize], mesh.normals[*vertex as usize]);
        let (Some(along), Some(across)) = (chord.try_normalize(0.0), normal.cross(chord).try_normalize(0.0))
        else {
            return 0.0;
        };
        let (mut ahead, mut aside) = (ALONGSIDE, 0.0);
        find_round(mesh, *vertex, *side, |triangle, _| {
            for next in mesh.triangles[triangle] {
                let step =
                    (mesh.positions[next as usize] - at).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
                if -step.dot(&along) > ahead {
                    (ahead, aside) = (-step.dot(&along), step.dot(&across).abs());
                }
            }
            false
        });
        aside
    };
    turn(end) + turn(&there)
}

/// Each end of a straight side of the `chosen` triangles at which the normal is `estimated` and leans from it.
pub(super) fn ends_of_straight_sides(
    mesh: &SmoothMesh,
    estimated: &[bool],
    chosen: &[bool],
    fork: &dyn Fork,
) -> Vec<SideEnd> {
    let facets =
        Facets { positions: &mesh.positions, triangles: &mesh.triangles, continued: &mesh.continued };
    let normal = |side: usize| facet_normal(facets.corners(side / 3));
    // The ends from which the vertices lean, and for each whether the side is straight by itself.
    let leaning = found(fork, mesh.continued.len(), |side| {
        let other = mesh.continued[side] as usize;
        if mesh.continued[side] == NONE || other < side || !chosen[side / 3] {
            return None;
        }
        let corners = mesh.triangles[side / 3];
        let ends = [corners[side % 3], corners[(side % 3 + 1) % 3]];
        let [from, to] = facets.ends(side);
        let chord = to - from;
        let leans = ends.map(|vertex| {
            estimated[vertex as usize] && mesh.normals[vertex as usize].dot(&chord).abs() > 4.0 * PLAIN
        });
        if leans == [false; 2] || normal(side).dot(&normal(other)) > COPLANAR {
            return None;
        }
        let is_ruling = ends.iter().all(|&vertex| {
            let limit = CONTAINS * chord.norm();
            let contains = |triangle| facet_normal(facets.corners(triangle)).dot(&chord).abs() < limit;
            find_round(mesh, vertex, side, |triangle, _| !contains(triangle)).is_none()
        });
        let ends =
            [SideEnd { vertex: ends[0], chord, side }, SideEnd { vertex: ends[1], chord: -chord, side }];
        let leaning = || ends.iter().zip(leans).filter(|(_, leans)| *leans).map(|(end, _)| end);
        let bulges_alone = leaning().all(|end| is_much_longer(mesh, end) && bulges_alone(mesh, end));
        let is_straight = |end: &SideEnd| is_ruling || bulges_alone || bends_from(mesh, &facets, end);
        Some([0, 1].map(|index| leans[index].then(|| (ends[index], is_straight(&ends[index])))))
    });
    let (mut straight, mut open) = (Vec::new(), Vec::new());
    for (end, is_straight) in leaning.into_iter().flatten().flatten() {
        if is_straight { straight.push(end) } else { open.push(end) }
    }
    add_parallel(mesh, &mut straight, open);
    straight
}

/// Adds the `open` sides that run beside a straight one, as long as it and in its direction: the sides of a cylinder are alike.
fn add_parallel(mesh: &SmoothMesh, straight: &mut Vec<SideEnd>, mut open: Vec<SideEnd>) {
    let mut known: BTreeMap<u32, Vec<Vector3<f64>>> = BTreeMap::new();
    straight.iter().for_each(|end| known.entry(end.vertex).or_default().push(end.chord));
    for _ in 0..MOST_PARALLEL {
        let is_alike = |end: &SideEnd| {
            let alike = |vertex: &u32| {
                let chords = known.get(vertex).into_iter().flatten();
                chords.into_iter().any(|other| (other - end.chord).norm() < PARALLEL * end.chord.norm())
            };
            let is_beside = |triangle: usize, _| mesh.triangles[triangle].iter().any(alike);
            find_round(mesh, end.vertex, end.side, is_beside).is_some()
        };
        let (alike, others): (Vec<_>, Vec<_>) = open.into_iter().partition(is_alike);
        open = others;
        if alike.is_empty() {
            break;
        }
        alike.iter().for_each(|end| known.entry(end.vertex).or_default().push(end.chord));
        straight.extend(alike);
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

/// Whether `is_wanted` is true for any offset, mm, from an end of a side to another corner of the facets
/// round it. Offsets nearly in the direction of the side are skipped.
fn any_aside(mesh: &SmoothMesh, end: &SideEnd, mut is_wanted: impl FnMut(Vector3<f64>) -> bool) -> bool {
    let at = mesh.positions[end.vertex as usize];
    let long = end.chord.norm();
    find_round(mesh, end.vertex, end.side, |triangle, _| {
        let others = mesh.triangles[triangle].iter().map(|&other| mesh.positions[other as usize] - at);
        let mut aside = others.filter(|other| other.dot(&end.chord) <= ALONGSIDE * other.norm() * long);
        aside.any(&mut is_wanted)
    })
    .is_some()
}

/// Whether a side is much longer than all others at an end of it.
fn is_much_longer(mesh: &SmoothMesh, end: &SideEnd) -> bool {
    !any_aside(mesh, end, |other| MUCH_LONGER * other.norm() > end.chord.norm())
}

/// Whether a side would bulge much farther than the others at an end of it, and some of these lead away from
/// it.
fn bulges_alone(mesh: &SmoothMesh, end: &SideEnd) -> bool {
    let normal = mesh.normals[end.vertex as usize];
    let (long, limit) = (end.chord.norm(), normal.dot(&end.chord).abs() / IMPLAUSIBLE);
    let mut leads_away = false;
    let bulges = any_aside(mesh, end, |other| {
        leads_away |= other.dot(&end.chord) < -ALONGSIDE * other.norm() * long;
        normal.dot(&other).abs() > limit
    });
    leads_away && !bulges
}

/// Whether the section behind an end of a side begins to bend there, in the direction of the side.
fn bends_from(mesh: &SmoothMesh, facets: &Facets, &SideEnd { vertex, chord, side }: &SideEnd) -> bool {
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
