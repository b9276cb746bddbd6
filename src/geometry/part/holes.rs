//! Bridges small holes of a mesh, where triangles are missing, as the surface round them leads.
//!
//! A designed hole goes down into the part, and its walls continue the mesh. Where triangles are missing, the
//! mesh ends at a closed loop of sides that belong to one triangle only.

use nalgebra::{Point3, Vector3};

use super::adjacency::{NONE, sliver_side, weld};
use super::mesh::TriMesh;

/// Without a setting, a hole is bridged if it has at most this many sides: one or two triangles are missing.
/// [`NARROW`] and [`LIKE_ITS_SURROUNDINGS`] must hold, too.
const FEW: usize = 4;
/// Without a setting, a hole is bridged if it is at most this wide, mm: more than a triangle with sides of 1
/// mm.
const NARROW: f64 = 2.0;
/// Without a setting, a hole is bridged if the triangles round it are at most this many times as long as its
/// sides. A square that is cut out of a large sheet is intended.
const LIKE_ITS_SURROUNDINGS: f64 = 2.5;
/// Holes with more sides remain open: too much is missing to continue the surface.
const MOST_SIDES: usize = 64;
/// A mesh with more holes consists of loose triangles.
const MOST_HOLES: usize = 10_000;
/// Without a setting, all holes remain open if there are more than this.
const MANY: usize = 3;
/// The cosine of the angle at which a bridge meets the triangles beside it is at least this (75°).
const LEADS: f64 = 0.26;

/// A hole that was bridged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bridge {
    /// Its middle, in the part frame, mm.
    pub at: Point3<f64>,
    /// Its width: the longest way across, mm.
    pub width: f64,
    /// Number of its sides.
    pub sides: usize,
}

/// The mesh with its small holes bridged by triangles, and a list of the bridges, the widest first.
///
/// With a `widest` hole given, mm, all holes up to it are bridged; 0 bridges none. Without it, holes of one
/// or two missing triangles that are up to 2 mm wide are bridged, unless there are more than three of them.
/// All triangles of the mesh must run the same way round.
pub fn bridged(mesh: TriMesh, widest: Option<f64>) -> (TriMesh, Vec<Bridge>) {
    if widest.is_some_and(|widest| !(widest > 0.0)) {
        return (mesh, Vec::new());
    }
    let border = Border::of(&mesh);
    let mut bridges = Vec::new();
    let mut added = Vec::new();
    for hole in border.loops().iter().take(MOST_HOLES) {
        if let Some((bridge, triangles)) = border.bridge(&mesh, hole, widest) {
            bridges.push(bridge);
            added.extend(triangles);
        }
    }
    // One or two triangles get lost; many equal holes are a design.
    if widest.is_none() && bridges.len() > MANY {
        return (mesh, Vec::new());
    }
    bridges.sort_by(|one, other| other.width.total_cmp(&one.width));
    (mesh.with_added(&added), bridges)
}

/// A side of a triangle that no second triangle has.
#[derive(Debug, Clone, Copy)]
struct Side {
    /// Places of its ends, in the order of its triangle.
    ends: [u32; 2],
    /// Its first vertex.
    vertex: u32,
    triangle: u32,
}

/// The sides at which a mesh ends, in rising order of their first places.
struct Border(Vec<Side>);

impl Border {
    fn of(mesh: &TriMesh) -> Self {
        let ends = ends_of_border(mesh);
        if ends.is_empty() {
            return Self(Vec::new());
        }
        let positions: Vec<Point3<f64>> =
            ends.iter().map(|&vertex| mesh.positions()[vertex as usize]).collect();
        let mut places = vec![NONE; mesh.positions().len()];
        for (&vertex, place) in ends.iter().zip(weld(&positions)) {
            places[vertex as usize] = place;
        }
        let mut sides = Vec::new();
        for (triangle, corners) in mesh.triangles().iter().enumerate() {
            for corner in 0..3 {
                let [from, to] = [corners[corner], corners[(corner + 1) % 3]];
                let ends = [places[from as usize], places[to as usize]];
                if ends[0] != NONE && ends[1] != NONE && ends[0] != ends[1] {
                    sides.push(Side { ends, vertex: from, triangle: triangle as u32 });
                }
            }
        }
        let key = |side: &Side| (side.ends[0].min(side.ends[1]), side.ends[0].max(side.ends[1]));
        sides.sort_by_key(key);
        let mut border: Vec<Side> = sides
            .chunk_by(|one, other| key(one) == key(other))
            .filter_map(|same| if let [side] = same { Some(*side) } else { None })
            .collect();
        border.sort_by_key(|side| side.ends);
        Self(border)
    }

    /// The side that starts at a place, if it is the only one.
    fn from(&self, place: u32) -> Option<&Side> {
        let first = self.0.partition_point(|side| side.ends[0] < place);
        let starts = |at: usize| self.0.get(at).filter(|side| side.ends[0] == place);
        starts(first).filter(|_| starts(first + 1).is_none())
    }

    /// Closed chains of sides.
    fn loops(&self) -> Vec<Vec<Side>> {
        let mut loops = Vec::new();
        for first in &self.0 {
            // Each once: from its smallest place.
            let mut chain = vec![*first];
            while let Some(next) = chain.last().and_then(|last| self.from(last.ends[1])) {
                if next.ends[0] == first.ends[0] {
                    loops.push(chain);
                    break;
                }
                if next.ends[0] < first.ends[0] || chain.len() == MOST_SIDES {
                    break;
                }
                chain.push(*next);
            }
        }
        loops
    }

    /// The triangles that bridge a hole, if it is to be bridged.
    fn bridge(&self, mesh: &TriMesh, hole: &[Side], widest: Option<f64>) -> Option<(Bridge, Vec<[u32; 3]>)> {
        // A triangle in the hole runs along its sides in the other direction.
        let vertices: Vec<u32> = hole.iter().rev().map(|side| side.vertex).collect();
        let points: Vec<Point3<f64>> = vertices.iter().map(|&at| mesh.positions()[at as usize]).collect();
        let sides = points.len();
        let width = pairs(&points).map(|[one, other]| (one - other).norm()).fold(0.0, f64::max);
        let length = |at: usize| (points[at] - points[(at + 1) % sides]).norm();
        let is_small = match widest {
            Some(widest) => width <= widest,
            None => {
                let around = hole.iter().map(|side| longest_side(mesh, side.triangle)).sum::<f64>();
                let own = (0..sides).map(length).sum::<f64>();
                sides <= FEW && width <= NARROW && around <= LIKE_ITS_SURROUNDINGS * own
            }
        };
        if sides < 3 || !is_small {
            return None;
        }
        let triangles = smallest_area(&points);
        let corners = |triangle: [usize; 3]| triangle.map(|at| points[at]);
        if triangles.iter().all(|&triangle| sliver_side(corners(triangle)).is_some()) {
            return None;
        }
        let leads = triangles.iter().all(|&triangle| {
            let normal = across(corners(triangle));
            (0..3).all(|corner| {
                let [from, to] = [triangle[corner], triangle[(corner + 1) % 3]];
                if (from + 1) % sides != to {
                    return true;
                }
                // From point `from` to the next runs the hole's side that starts at the latter.
                let beside = across(mesh.corners(mesh.triangles()[hole[sides - 1 - to].triangle as usize]));
                normal.dot(&beside) > LEADS * normal.norm() * beside.norm()
            })
        });
        let at = Point3::from(points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / sides as f64);
        let triangles = triangles.iter().map(|triangle| triangle.map(|at| vertices[at])).collect();
        leads.then_some((Bridge { at, width, sides }, triangles))
    }
}

/// The vertices at which a mesh ends, by their numbers, ascending; those that triangles repeat at one place are among them.
pub(super) fn ends_of_border(mesh: &TriMesh) -> Vec<u32> {
    // Round a vertex within the mesh each neighbour is the next corner of one triangle and the one before of another.
    let mark = |vertex: u32| {
        let mixed = (u64::from(vertex) + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        (mixed ^ (mixed >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9)
    };
    let mut sums = vec![0u64; mesh.positions().len()];
    for &[a, b, c] in mesh.triangles() {
        for (here, next, before) in [(a, b, c), (b, c, a), (c, a, b)] {
            let sum = &mut sums[here as usize];
            *sum = sum.wrapping_add(mark(next)).wrapping_sub(mark(before));
        }
    }
    (0..sums.len() as u32).filter(|&vertex| sums[vertex as usize] != 0).collect()
}

fn across([a, b, c]: [Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

fn longest_side(mesh: &TriMesh, triangle: u32) -> f64 {
    let corners = mesh.corners(mesh.triangles()[triangle as usize]);
    pairs(&corners).map(|[one, other]| (one - other).norm()).fold(0.0, f64::max)
}

fn pairs(points: &[Point3<f64>]) -> impl Iterator<Item = [Point3<f64>; 2]> {
    points.iter().enumerate().flat_map(|(at, one)| points[..at].iter().map(|other| [*one, *other]))
}

/// The triangles over a polygon that have the smallest area together (Barequet & Sharir, Filling gaps in the boundary of a
/// polyhedron, Computer Aided Geometric Design 12, 1995).
fn smallest_area(points: &[Point3<f64>]) -> Vec<[usize; 3]> {
    let count = points.len();
    let mut best = vec![(0.0, 0usize); count * count];
    for span in 2..count {
        for first in 0..count - span {
            let last = first + span;
            let area = |middle: usize| {
                let own = across([points[first], points[middle], points[last]]).norm();
                (best[first * count + middle].0 + best[middle * count + last].0 + own, middle)
            };
            let smallest = (first + 1..last).map(area).min_by(|one, other| one.0.total_cmp(&other.0));
            best[first * count + last] = smallest.unwrap_or((0.0, first));
        }
    }
    let (mut open, mut triangles) = (vec![(0, count - 1)], Vec::new());
    while let Some((first, last)) = open.pop() {
        if last - first >= 2 {
            let middle = best[first * count + last].1;
            triangles.push([first, middle, last]);
            open.extend([(first, middle), (middle, last)]);
        }
    }
    triangles
}
