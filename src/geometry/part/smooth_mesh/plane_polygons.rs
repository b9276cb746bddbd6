//! Plane polygons, divided into triangles that are as wide as possible.
//!
//! Some programs cut polygons with many corners into needles from one end to the other, as at the poles of
//! balls that a hull joins. Estimates from the triangles round a vertex then depend on how the polygon was
//! cut. Sides are turned until each triangle is that of Delaunay (C. L. Lawson, Software for C¹ surface
//! interpolation, Mathematical Software III, 1977).

use nalgebra::{Point3, Vector3};

use super::ends;
use crate::geometry::adjacency::NONE;
use crate::geometry::fork::{Fork, found};

/// A side is turned if the angles opposite to it sum up to half a turn and more than this, rad: the corners of a rectangle, and of
/// others on one circle, may be joined either way.
const NOTABLE: f64 = 0.02;
/// Sides are turned at most this many times per triangle, which limits the time; polygons need fewer turns.
const MOST_TURNS: usize = 8;

/// Triangles over `positions`, with the places of their corners and, for each side, the one that it faces.
struct Division<'a> {
    positions: &'a [Point3<f64>],
    triangles: Vec<[u32; 3]>,
    places: &'a mut [[u32; 3]],
    opposite: &'a mut [u32],
    /// How far vertices may be off, mm.
    near: f64,
}

/// The triangles of a mesh in which the polygons of three or more are divided evenly; `None` if all are. `is_open` says of a vertex
/// that the file has no normal there. The numbers of the triangles remain.
pub(super) fn divided_evenly(
    triangles: &[[u32; 3]],
    positions: &[Point3<f64>],
    (places, opposite): (&mut [[u32; 3]], &mut [u32]),
    is_open: impl Fn(u32) -> bool + Sync,
    fork: &dyn Fork,
) -> Option<Vec<[u32; 3]>> {
    let points = |triangle: usize| triangles[triangle].map(|vertex| positions[vertex as usize]);
    let narrow = found(fork, triangles.len(), |triangle| {
        let here = points(triangle);
        let is_narrow = |side: usize| {
            let other = opposite[3 * triangle + side];
            if other == NONE || (other as usize) < 3 * triangle + side {
                return false;
            }
            let there = points(other as usize / 3);
            let far = [here[(side + 2) % 3], there[(other as usize + 2) % 3]];
            is_narrow([here[side], here[(side + 1) % 3]], far)
        };
        let is_open = triangles[triangle].iter().all(|&vertex| is_open(vertex));
        (is_open && (0..3).any(is_narrow)).then_some(triangle as u32)
    });
    if narrow.is_empty() {
        return None;
    }
    let near = ends::precision_of(positions).max(ends::rounding(positions));
    let mut division = Division { positions, triangles: triangles.to_vec(), places, opposite, near };
    // The last one comes first.
    let mut open: Vec<usize> =
        narrow.iter().rev().flat_map(|&triangle| 3 * triangle as usize..3 * triangle as usize + 3).collect();
    let (mut turned, most) = (0, MOST_TURNS * triangles.len());
    while let Some(side) = open.pop() {
        let Some(other) = division.facing(side) else { continue };
        let mut corners = [side, other].into_iter().flat_map(|side| division.triangles[side / 3]);
        if !corners.all(&is_open) || !division.is_to_turn(side, other) {
            continue;
        }
        division.turn(side, other);
        open.extend([side / 3, other / 3].iter().flat_map(|triangle| 3 * triangle..3 * triangle + 3));
        turned += 1;
        if turned == most {
            break;
        }
    }
    (turned > 0).then_some(division.triangles)
}

/// Whether the angles at two points opposite to a side sum up to notably more than half a turn.
fn is_narrow(ends: [Point3<f64>; 2], far: [Point3<f64>; 2]) -> bool {
    let arms = far.map(|far| ends.map(|end| end - far));
    let cosines = arms.map(|[one, other]| one.dot(&other));
    if cosines.iter().all(|cosine| *cosine >= 0.0) {
        return false;
    }
    let sines = arms.map(|[one, other]| one.cross(&other).norm());
    // Of the sum of both angles.
    let sine = sines[0] * cosines[1] + cosines[0] * sines[1];
    let cosine = cosines[0] * cosines[1] - sines[0] * sines[1];
    sine < -NOTABLE.sin() * sine.hypot(cosine)
}

impl Division<'_> {
    fn points(&self, triangle: usize) -> [Point3<f64>; 3] {
        self.triangles[triangle].map(|vertex| self.positions[vertex as usize])
    }

    /// The side that a side faces, if both triangles are wound alike and have two other corners.
    fn facing(&self, side: usize) -> Option<usize> {
        let other = self.opposite[side];
        if other == NONE {
            return None;
        }
        let place = |side: usize, turn: usize| self.places[side / 3][(side + turn) % 3];
        let other = other as usize;
        let is_alike = place(side, 0) == place(other, 1) && place(side, 1) == place(other, 0);
        (is_alike && place(side, 2) != place(other, 2)).then_some(other)
    }

    /// Whether the triangles at a side are of one polygon, with a third one, and would be wider if it were turned.
    fn is_to_turn(&self, side: usize, other: usize) -> bool {
        let [here, there] = [side, other].map(|side| self.points(side / 3));
        let ends = [0, 1].map(|turn| here[(side + turn) % 3]);
        let far = [here[(side + 2) % 3], there[(other + 2) % 3]];
        if !is_narrow(ends, far) || !self.is_plane(side, other) {
            return false;
        }
        let normal = across(here) + across(there);
        // Rounding folds slivers.
        let turned = [[far[0], ends[0], far[1]], [far[1], ends[1], far[0]]];
        turned.iter().all(|&corners| across(corners).dot(&normal) > 0.0)
            && [side, other].iter().any(|&side| {
                let others = [1, 2].map(|turn| side / 3 * 3 + (side + turn) % 3);
                others
                    .into_iter()
                    .any(|side| self.facing(side).is_some_and(|other| self.is_plane(side, other)))
            })
    }

    /// Whether the triangles at a side are in one plane. The larger one defines it, the farther off the narrower it is.
    fn is_plane(&self, side: usize, other: usize) -> bool {
        let [here, there] = [side, other].map(|side| across(self.points(side / 3)));
        let [larger, smaller] =
            if here.norm_squared() >= there.norm_squared() { [side, other] } else { [other, side] };
        let [corners, beyond] = [larger, smaller].map(|side| self.points(side / 3));
        let (normal, other) = (across(corners), across(beyond));
        let off = (beyond[(smaller + 2) % 3] - corners[0]).dot(&normal).abs();
        off <= self.near * (normal.norm() + other.norm())
    }

    /// Joins the corners opposite to a side instead of its ends.
    fn turn(&mut self, side: usize, other: usize) {
        let [here, there] = [side / 3, other / 3];
        // The sides that the four outer ones face, round the polygon from the first end of the side.
        let next = |side: usize, turn: usize| side / 3 * 3 + (side + turn) % 3;
        let outer =
            [next(other, 1), next(other, 2), next(side, 1), next(side, 2)].map(|side| self.opposite[side]);
        for corners in [&mut self.triangles[..], self.places] {
            let [from, to, left] = [0, 1, 2].map(|turn| corners[here][(side + turn) % 3]);
            let right = corners[there][(other + 2) % 3];
            (corners[here], corners[there]) = ([from, right, left], [right, to, left]);
        }
        let sides = [3 * here, 3 * there, 3 * there + 1, 3 * here + 2];
        let mut join = |side: usize, other: u32| {
            self.opposite[side] = other;
            if other != NONE {
                self.opposite[other as usize] = side as u32;
            }
        };
        join(3 * here + 1, 3 * there as u32 + 2);
        for (side, facing) in sides.into_iter().zip(outer) {
            join(side, facing);
        }
    }
}

/// Twice the area vector of a triangle.
fn across([a, b, c]: [Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

#[cfg(test)]
mod tests {
    use super::super::SmoothMesh;
    use super::*;
    use crate::geometry::adjacency::opposite_sides;
    use crate::geometry::fork::InTurn;
    use crate::geometry::mesh::TriMesh;
    use crate::geometry::space::View;

    const RADIUS: f64 = 12.0;

    /// The hull of two balls of 48 sides, 40 mm apart along x, as OpenSCAD makes it: the rings of the balls are round z, and there are
    /// none at the poles, where a plane polygon closes both. It is cut into needles from its first corner.
    fn capsule() -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let (rings, half) = (24u32, 24u32);
        let mut positions = Vec::new();
        for ring in 0..rings {
            let (across, along) =
                (std::f64::consts::PI * (f64::from(ring) + 0.5) / f64::from(rings)).sin_cos();
            for (end, x) in [(0, -20.0), (1, 20.0)] {
                for step in 0..=half {
                    let turn = std::f64::consts::PI * (f64::from(step + half * end) / f64::from(half) + 0.5);
                    let round = Vector3::new(turn.cos() * across, turn.sin() * across, along);
                    positions.push(Point3::new(x, 0.0, 0.0) + round * RADIUS);
                }
            }
        }
        let count = 2 * half + 2;
        let mut triangles = Vec::new();
        for ring in 1..rings {
            for step in 0..count {
                let [above, below] = [(ring - 1) * count, ring * count];
                let next = (step + 1) % count;
                triangles.extend([
                    [above + step, below + step, below + next],
                    [above + step, below + next, above + next],
                ]);
            }
        }
        let last = (rings - 1) * count;
        for step in 1..count - 1 {
            triangles.extend([[0, step, step + 1], [last, last + step + 1, last + step]]);
        }
        (positions, triangles)
    }

    fn divided(triangles: &[[u32; 3]], positions: &[Point3<f64>], is_open: bool) -> Option<Vec<[u32; 3]>> {
        let (mut places, mut opposite) = (triangles.to_vec(), opposite_sides(triangles));
        let links = (&mut places[..], &mut opposite[..]);
        let divided = divided_evenly(triangles, positions, links, |_| is_open, &InTurn);
        let now = divided.as_deref().unwrap_or(triangles);
        assert_eq!((&places[..], &opposite), (now, &opposite_sides(now)));
        divided
    }

    #[test]
    fn vertices_beside_a_polygon_between_two_balls_have_the_normals_of_the_hull() {
        let (positions, triangles) = capsule();
        let mesh = TriMesh::new(positions, Vec::new(), triangles).unwrap();
        let smooth = SmoothMesh::new(&mesh, &View::top());
        assert!(smooth.regions.iter().all(|region| *region == 0));
        for (at, normal) in smooth.positions.iter().zip(&smooth.normals) {
            let exact = Vector3::new(at.x - at.x.clamp(-20.0, 20.0), at.y, at.z) / RADIUS;
            assert!((normal - exact).norm() < 0.002, "{at:?}: {normal:?} for {exact:?}");
        }
    }

    #[test]
    fn polygons_are_divided_into_triangles_whose_circles_are_empty() {
        let (positions, triangles) = capsule();
        let even = divided(&triangles, &positions, true).unwrap();
        assert_eq!(even.len(), triangles.len());
        let area = |triangles: &[[u32; 3]]| -> f64 {
            let corners = triangles.iter().map(|corners| corners.map(|vertex| positions[vertex as usize]));
            corners.map(|corners| across(corners).norm()).sum()
        };
        assert!((area(&even) - area(&triangles)).abs() < 1e-9);
        // Of the polygon at the upper pole, only the rectangle between both balls reaches from one to the other.
        let reaching = even.iter().filter(|corners| {
            let corners = corners.map(|vertex| positions[vertex as usize]);
            let is_at_pole = corners.iter().all(|corner| corner.z > 11.9);
            is_at_pole
                && corners.iter().any(|corner| corner.x > 0.0)
                && corners.iter().any(|corner| corner.x < 0.0)
        });
        assert_eq!(reaching.count(), 2);
        assert_eq!(divided(&even, &positions, true), None);
    }

    #[test]
    fn triangles_with_normals_and_the_halves_of_quadrangles_remain() {
        let (positions, triangles) = capsule();
        assert_eq!(divided(&triangles, &positions, false), None);
        // The long diagonals of a row of parallelograms, each in a plane of its own.
        let at = |step: u32, y: f64| Point3::new(f64::from(step) + y, y, f64::from(step * step) * 0.05);
        let positions: Vec<_> = (0..6).flat_map(|step| [at(step, 0.0), at(step, 2.0)]).collect();
        let halves = (0..5).flat_map(|step| {
            let first = 2 * step;
            [[first, first + 2, first + 3], [first, first + 3, first + 1]]
        });
        let halves: Vec<_> = halves.collect();
        let [a, b] = [0, 3].map(|vertex| positions[vertex]);
        assert!(is_narrow([a, b], [positions[2], positions[1]]));
        assert_eq!(divided(&halves, &positions, true), None);
    }
}
