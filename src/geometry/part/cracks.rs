//! Joins cracks of a mesh, where the corners of neighbouring triangles are near each other but not at one
//! place.
//!
//! Some programs cut each face of a part into triangles by itself, or move the corners of each triangle by
//! themselves. This leaves cracks of some thousandths of a millimetre. No triangle continues another one
//! across a crack, so that each would be a facet by itself.

use nalgebra::{Point3, Vector3};

use super::adjacency::{weld, weld_within};
use super::holes::ends_of_border;
use super::mesh::TriMesh;

/// Corners at the border of a mesh are joined if they are nearer to each other than this, mm. Skins that are
/// 0.01 mm apart remain two skins.
const WIDEST: f64 = 5e-3;
/// The corners of a triangle are not moved, and no corner at the same place is, if the triangle has a side
/// shorter than this, mm, or is lower than [`WIDEST`]. It may be a wall between two faces that are as near to
/// each other.
const SHORTEST_SIDE: f64 = 4.0 * WIDEST;
/// Triangles are the two skins of a sheet if the cosine of the angle at which they meet is larger than this
/// (26°). Skins that are near enough to be joined meet at less than 15°, unless their triangles are slivers.
const FOLDED: f64 = 0.9;

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

/// The mesh with corners that are up to 0.005 mm apart moved to the middle between them, where that joins two
/// triangles; and a description of the joined cracks. `None` and the unchanged mesh if there is nothing to
/// join, or if two of its skins are that near to each other.
pub fn joined(mesh: TriMesh) -> (TriMesh, Option<Cracks>) {
    let Some(places) = Places::of(&mesh) else { return (mesh, None) };
    let mut is_joined = vec![false; places.middles.len()];
    let mut cracks = Cracks { sides: 0, width: 0.0, at: Point3::origin() };
    let mut sides = sides_of(&mesh, |vertex| places.of_vertex(vertex).map(|place| place.near));
    sides.sort_by_key(|side| side.key);
    for pair in sides.chunk_by(|one, other| one.key == other.key) {
        let [one, other] = pair else { continue };
        let ends = [0, 1].map(|end| [one.ends[end], other.ends[end]]);
        if !ends.into_iter().any(|[one, other]| places.of_vertex(one) != places.of_vertex(other)) {
            continue;
        }
        if is_folded(&mesh, one, other) {
            return (mesh, None);
        }
        if one.key.into_iter().any(|place| places.is_kept[place as usize]) {
            continue;
        }
        cracks.sides += 1;
        one.key.into_iter().for_each(|place| is_joined[place as usize] = true);
        for [first, second] in ends.map(|pair| pair.map(|end| mesh.positions()[end as usize])) {
            let width = (second - first).norm();
            if width > cracks.width {
                (cracks.width, cracks.at) = (width, first);
            }
        }
    }
    if cracks.sides == 0 {
        return (mesh, None);
    }
    let moved = |vertex: usize, position: Point3<f64>| match places.of_vertex(vertex as u32) {
        Some(place) if is_joined[place.near as usize] => places.middles[place.near as usize],
        _ => position,
    };
    (mesh.with_moved(moved), Some(cracks))
}

/// Where a vertex is.
#[derive(Clone, Copy, PartialEq)]
struct Place {
    /// The number of its place in the file.
    same: u32,
    /// The number of the places that may be one with it.
    near: u32,
}

/// The places at the border of a mesh.
struct Places {
    /// For each vertex the number of its place below, from 1 on; 0 for those that are not at the border.
    numbers: Vec<u32>,
    places: Vec<Place>,
    /// For each group of places that may be one, by its number: the middle between the places, mm.
    middles: Vec<Point3<f64>>,
    /// For each group of places that may be one, by its number: whether they are different places after all.
    is_kept: Vec<bool>,
}

impl Places {
    /// `None` if no two of them are near to each other.
    fn of(mesh: &TriMesh) -> Option<Self> {
        let ends = ends_of_border(mesh);
        let position = |vertex: &u32| mesh.positions()[*vertex as usize];
        let positions: Vec<Point3<f64>> = ends.iter().map(position).collect();
        let same = weld(&positions);
        // Numbers are in the order of first appearance.
        let mut firsts: Vec<Point3<f64>> = Vec::new();
        for (position, &number) in positions.iter().zip(&same) {
            if number as usize == firsts.len() {
                firsts.push(*position);
            }
        }
        let near = weld_within(&firsts, WIDEST);
        let count = near.iter().max().map_or(0, |last| *last as usize + 1);
        if count == firsts.len() {
            return None;
        }
        let mut sums = vec![(Vector3::zeros(), 0u32); count];
        for (first, &near) in firsts.iter().zip(&near) {
            let (sum, count) = &mut sums[near as usize];
            *sum += first.coords;
            *count += 1;
        }
        let middles: Vec<Point3<f64>> =
            sums.into_iter().map(|(sum, count)| Point3::from(sum / f64::from(count))).collect();
        let mut is_kept = vec![false; count];
        // Others between them may connect places that are far apart.
        for (first, &near) in firsts.iter().zip(&near) {
            is_kept[near as usize] |= (first - middles[near as usize]).norm() > WIDEST;
        }
        let places = same.iter().map(|&same| Place { same, near: near[same as usize] }).collect();
        let mut numbers = vec![0; mesh.positions().len()];
        ends.iter().zip(1..).for_each(|(&end, number)| numbers[end as usize] = number);
        let mut found = Self { numbers, places, middles, is_kept };
        for corners in mesh.triangles().iter().filter(|corners| is_fine(mesh.corners(**corners))) {
            for place in corners.map(|vertex| found.of_vertex(vertex)).into_iter().flatten() {
                found.is_kept[place.near as usize] = true;
            }
        }
        Some(found)
    }

    fn of_vertex(&self, vertex: u32) -> Option<Place> {
        self.places.get((self.numbers[vertex as usize] as usize).checked_sub(1)?).copied()
    }
}

/// Whether a triangle is so small that cracks may be as large.
fn is_fine([a, b, c]: [Point3<f64>; 3]) -> bool {
    let sides = [b - a, c - b, a - c].map(|side| side.norm());
    let [shortest, longest] = [f64::min, f64::max].map(|of| sides.into_iter().fold(sides[0], of));
    shortest < SHORTEST_SIDE || (b - a).cross(&(c - a)).norm() < WIDEST * longest
}

/// The sides between vertices at different places; `place` returns `None` for vertices that stay.
fn sides_of(mesh: &TriMesh, place: impl Fn(u32) -> Option<u32>) -> Vec<Side> {
    let mut sides = Vec::new();
    for corners in mesh.triangles() {
        for corner in 0..3 {
            let [from, to, opposite] = [0, 1, 2].map(|turn| corners[(corner + turn) % 3]);
            let (Some(first), Some(last)) = (place(from), place(to)) else { continue };
            let (key, ends) = match first < last {
                true => ([first, last], [from, to]),
                false => ([last, first], [to, from]),
            };
            if first != last {
                sides.push(Side { key, ends, opposite });
            }
        }
    }
    sides
}

/// Whether two triangles are folded onto each other at their common side.
fn is_folded(mesh: &TriMesh, one: &Side, other: &Side) -> bool {
    let across = |side: &Side| {
        let [from, to, opposite] =
            [side.ends[0], side.ends[1], side.opposite].map(|vertex| mesh.positions()[vertex as usize]);
        let (along, away) = (to - from, opposite - from);
        away - along * (away.dot(&along) / along.norm_squared())
    };
    let [one, other] = [across(one), across(other)];
    let lengths = [one.norm(), other.norm()];
    // The corners of a sliver do not show its direction.
    lengths.iter().all(|length| *length > SHORTEST_SIDE) && one.dot(&other) > FOLDED * lengths[0] * lengths[1]
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
        // Of the smaller ones some are at one place as they are.
        for (by, share) in [(4e-4, 0.5), (1e-3, 0.9)] {
            let (closed, cracks) = joined(shaken(&mesh, by));
            let cracks = cracks.unwrap();
            // All but those at the border, each with its other half.
            let inside = (sides - ends_of_border(&mesh).len()) / 2;
            let least = (share * inside as f64) as usize;
            assert!((least..=inside).contains(&cracks.sides), "{cracks:?} of {inside}");
            assert!(cracks.width <= 12f64.sqrt() * by && cracks.width > by, "{cracks:?}");
            let places = weld(closed.positions());
            assert!((*places.iter().max().unwrap() as usize) < mesh.positions().len() * 11 / 10);
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
    /// Quadrilaterals, each with corners of its own.
    fn faces(corners: &[[[f64; 3]; 4]]) -> TriMesh {
        let positions = corners.iter().flatten().map(|at| Point3::from(*at)).collect();
        let first = |face: usize| 4 * face as u32;
        let halves = |face: usize| [[0, 1, 2], [0, 2, 3]].map(|half| half.map(|corner| first(face) + corner));
        TriMesh::new(positions, Vec::new(), (0..corners.len()).flat_map(halves).collect()).unwrap()
    }

    #[test]
    fn what_is_at_one_place_stays_at_one_place() {
        let square = |x: f64, z: f64| [[x, 0.0, z], [x + 5.0, 0.0, z], [x + 5.0, 5.0, z], [x, 5.0, z]];
        let wall =
            |x: f64, low: f64, high: f64| [[x, 0.0, low], [x, 5.0, low], [x, 5.0, high], [x, 0.0, high]];
        // A step that is as low as a crack has a wall.
        let step = faces(&[square(0.0, 0.0), wall(5.0, -0.004, 0.0), square(5.0, -0.004)]);
        assert_eq!(joined(step.clone()), (step, None));
        // Of three faces in a row the last does not quite meet the second one, …
        let row = [square(0.0, 0.0), square(5.0, 0.0), square(10.004, 0.0)];
        let (moved, cracks) = joined(faces(&row));
        assert_eq!(cracks.map(|cracks| cracks.sides), Some(1));
        assert!((cracks.unwrap().width - 0.004).abs() < 1e-9);
        assert_eq!(*weld(moved.positions()).iter().max().unwrap(), 7);
        // … and at two of its corners there is a face that is too small to be moved.
        let small = [[10.0, 0.0, 0.0], [10.0, -0.01, 0.0], [10.01, -0.01, 0.0], [10.01, 0.0, 0.0]];
        let beside = faces(&[row[0], row[1], row[2], small]);
        assert_eq!(joined(beside.clone()), (beside, None));
    }

    #[test]
    fn chains_of_corners_do_not_become_one() {
        let corner = |index: usize| {
            let x = 0.004 * index as f64;
            [[x, 0.0, 0.0], [x, 3.0 + x, 1.0], [x, 3.0 + x, 2.0], [x, 1.0 + x, 3.0]]
        };
        let fan = faces(&(0..40).map(corner).collect::<Vec<_>>());
        assert_eq!(joined(fan.clone()), (fan, None));
    }
}
