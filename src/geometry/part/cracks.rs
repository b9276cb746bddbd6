//! Cracks of a mesh, where the corners of neighbouring triangles are near each other but not at one place, joined.
//!
//! Programs that cut each face of a part into triangles by itself, or move the corners of each triangle by themselves, leave cracks of
//! some thousandths of a millimetre. No triangle continues another one across them, so that each would be a facet by itself.

use nalgebra::{Point3, Vector3};

use super::adjacency::{NONE, weld, weld_within};
use super::holes::ends_of_border;
use super::mesh::TriMesh;

/// Corners at the border of a mesh are joined where they are nearer to each other than this, mm: skins that are 0.01 mm apart stay two.
const WIDEST: f64 = 5e-3;
/// Where a triangle has a side that is shorter than this, mm, its corners stay where they are.
const SHORTEST_SIDE: f64 = 4.0 * WIDEST;
/// Triangles that meet at an angle of less than 60° are the two skins of a sheet: the cosine.
const FOLDED: f64 = 0.5;

/// The cracks of a mesh that were closed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cracks {
    /// Number of pairs of sides that were joined.
    pub sides: usize,
    /// The largest distance between two ends of sides that were joined, mm.
    pub width: f64,
    /// Its place in the part frame, mm.
    pub at: Point3<f64>,
}

/// A side of a triangle at the border.
#[derive(Clone, Copy)]
struct Side {
    /// The numbers of its ends among the places that are joined, the smaller one first.
    key: [u32; 2],
    /// Its ends in this order, and the corner opposite to it, as vertices.
    ends: [u32; 2],
    opposite: u32,
}

/// The mesh with corners that are up to 0.005 mm apart moved to the middle between them, where that joins two triangles, and what was
/// joined; `None` and the mesh as it is if there is nothing to join, or if two of its skins are that near to each other.
pub fn joined(mesh: TriMesh) -> (TriMesh, Option<Cracks>) {
    let mut places = vec![NONE; mesh.positions().len()];
    let ends = loose_ends(&mesh);
    let positions: Vec<Point3<f64>> = ends.iter().map(|&end| mesh.positions()[end as usize]).collect();
    let [same, near] = [weld(&positions), weld_within(&positions, WIDEST)];
    if same.iter().max() == near.iter().max() {
        return (mesh, None);
    }
    // For each vertex where it is in `ends`.
    ends.iter().zip(0..).for_each(|(&end, index)| places[end as usize] = index);
    let place = |vertex: u32| places[vertex as usize] as usize;
    let mut sides = sides_of(&mesh, |vertex| near.get(place(vertex)).copied());
    sides.sort_by_key(|side| side.key);
    let is_apart = |[one, other]: [u32; 2]| same[place(one)] != same[place(other)];
    let mut is_joined = vec![false; near.len()];
    let mut cracks = Cracks { sides: 0, width: 0.0, at: Point3::origin() };
    for pair in sides.chunk_by(|one, other| one.key == other.key) {
        let [one, other] = pair else { continue };
        let ends = [0, 1].map(|end| [one.ends[end], other.ends[end]]);
        if !ends.into_iter().any(is_apart) {
            continue;
        }
        if is_folded(&mesh, one, other) {
            return (mesh, None);
        }
        cracks.sides += 1;
        for pair in ends {
            let [first, second] = pair.map(|end| mesh.positions()[end as usize]);
            let width = (second - first).norm();
            if width > cracks.width {
                (cracks.width, cracks.at) = (width, first);
            }
            is_joined[near[place(pair[0])] as usize] = true;
        }
    }
    if cracks.sides == 0 {
        return (mesh, None);
    }
    let mut sums = vec![(Vector3::zeros(), 0u32); near.len()];
    for (position, &place) in positions.iter().zip(&near) {
        let (sum, count) = &mut sums[place as usize];
        *sum += position.coords;
        *count += 1;
    }
    let moved = |vertex: usize, position: Point3<f64>| match near.get(places[vertex] as usize) {
        Some(&place) if is_joined[place as usize] => {
            let (sum, count) = sums[place as usize];
            Point3::from(sum / f64::from(count))
        }
        _ => position,
    };
    (mesh.with_moved(moved), Some(cracks))
}

/// The vertices at the border of a mesh, ascending, without those of triangles with a short side.
fn loose_ends(mesh: &TriMesh) -> Vec<u32> {
    let mut ends = ends_of_border(mesh);
    if ends.is_empty() {
        return ends;
    }
    let mut is_kept = vec![false; mesh.positions().len()];
    for corners in mesh.triangles() {
        let [a, b, c] = mesh.corners(*corners);
        let is_short = |side: Vector3<f64>| side.norm_squared() < SHORTEST_SIDE * SHORTEST_SIDE;
        if [b - a, c - b, a - c].into_iter().any(is_short) {
            corners.iter().for_each(|&vertex| is_kept[vertex as usize] = true);
        }
    }
    ends.retain(|&end| !is_kept[end as usize]);
    ends
}

/// The sides between vertices at different places; `place` returns `None` for vertices that stay.
fn sides_of(mesh: &TriMesh, place: impl Fn(u32) -> Option<u32>) -> Vec<Side> {
    let mut sides = Vec::new();
    for corners in mesh.triangles() {
        for corner in 0..3 {
            let [from, to, opposite] = [0, 1, 2].map(|turn| corners[(corner + turn) % 3]);
            let (Some(first), Some(last)) = (place(from), place(to)) else { continue };
            if first < last {
                sides.push(Side { key: [first, last], ends: [from, to], opposite });
            } else if last < first {
                sides.push(Side { key: [last, first], ends: [to, from], opposite });
            }
        }
    }
    sides
}

/// Whether two triangles lie on each other, from their common side on.
fn is_folded(mesh: &TriMesh, one: &Side, other: &Side) -> bool {
    let across = |side: &Side| {
        let [from, to, opposite] =
            [side.ends[0], side.ends[1], side.opposite].map(|vertex| mesh.positions()[vertex as usize]);
        let (along, away) = (to - from, opposite - from);
        away - along * (away.dot(&along) / along.norm_squared())
    };
    let [one, other] = [across(one), across(other)];
    one.dot(&other) > FOLDED * one.norm() * other.norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::shapes;

    /// The triangles of a mesh, each with corners of its own that are up to `by` off along each axis, mm.
    fn shaken(mesh: &TriMesh, by: f64) -> TriMesh {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            by * ((state >> 33) as f64 / f64::from(1u32 << 30) - 1.0)
        };
        let corners = mesh.triangles().iter().flat_map(|&corners| mesh.corners(corners));
        let positions: Vec<_> = corners.map(|at| at + Vector3::new(random(), random(), random())).collect();
        let triangles =
            (0..positions.len() as u32 / 3).map(|first| [0, 1, 2].map(|corner| 3 * first + corner));
        TriMesh::new(positions, Vec::new(), triangles.collect()).unwrap()
    }

    #[test]
    fn triangles_that_do_not_quite_meet_are_joined_where_they_would() {
        let mesh = shapes::graph(20.0, 4.0, |x, y| 0.02 * (x * x + y * y));
        let sides = 3 * mesh.triangles().len();
        let whole = shaken(&mesh, 0.0);
        assert_eq!(joined(whole.clone()), (whole, None));
        for by in [4e-4, 1e-3] {
            let (closed, cracks) = joined(shaken(&mesh, by));
            let cracks = cracks.unwrap();
            // All but those at the border, each with its other half.
            let inside = (sides - ends_of_border(&mesh).len()) / 2;
            assert!(cracks.sides > inside / 2 && cracks.sides <= inside, "{cracks:?} of {inside}");
            assert!(cracks.width <= 12f64.sqrt() * by && cracks.width > by, "{cracks:?}");
            let places = weld(closed.positions());
            assert!(*places.iter().max().unwrap() as usize + 1 <= mesh.positions().len() * 11 / 10);
            for (corners, moved) in mesh.triangles().iter().zip(closed.triangles()) {
                for (before, after) in mesh.corners(*corners).iter().zip(closed.corners(*moved)) {
                    assert!((after - before).norm() <= 3f64.sqrt() * by);
                }
            }
        }
        let (_, cracks) = joined(shaken(&mesh, 0.02));
        assert!(cracks.is_none_or(|cracks| cracks.sides < sides / 100));
    }

    #[test]
    fn two_skins_stay_two() {
        let mesh = shapes::graph(20.0, 4.0, |x, y| 0.02 * (x * x + y * y));
        let count = mesh.positions().len() as u32;
        for apart in [1e-3, 4e-3, 1e-2] {
            let above = mesh.positions().iter().map(|at| at + Vector3::new(0.0, 0.0, apart));
            let positions: Vec<_> = mesh.positions().iter().copied().chain(above).collect();
            let copies = mesh.triangles().iter().map(|corners| corners.map(|vertex| vertex + count));
            let triangles: Vec<_> = mesh.triangles().iter().copied().chain(copies).collect();
            let skins = TriMesh::new(positions, Vec::new(), triangles).unwrap();
            assert_eq!(joined(skins.clone()), (skins, None));
        }
    }
}
