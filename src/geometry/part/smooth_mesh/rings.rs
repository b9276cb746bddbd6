//! The rings of a turned face: vertices on circles about one axis, and the curves along the profile on which the rings are.

use std::collections::BTreeSet;

use nalgebra::{Matrix4, Point3, Vector2, Vector3, Vector4};

use super::MOST_BEND;
use super::ends::range;
use super::profile::RingPlace;
use crate::geometry::adjacency::NONE;
use crate::geometry::shape_fit::cross_directions;

/// A ring has at least this many vertices, unless it is a single vertex on the axis: three vertices define a
/// circle, the others confirm it.
pub(super) const LEAST_ON_RING: usize = 6;
/// A turned face has at least this many rings.
pub(super) const LEAST_RINGS: usize = 5;
/// At most this many rings are beside a ring of a profile.
pub(super) const MOST_BESIDE: usize = 12;
/// At most this share of the rings beside those of a profile belongs to other profiles.
const MOST_OF_OTHERS: f64 = 0.1;
/// Axes that differ by less than this are tried once; as the sine of their angle, and as a share of their
/// distance.
const SAME_AXIS: f64 = 0.01;

/// The axis of a turned face.
#[derive(Clone, Copy)]
pub(super) struct Axis {
    through: Point3<f64>,
    pub(super) direction: Vector3<f64>,
}

impl Axis {
    /// That of the circle through three points.
    pub(super) fn of_circle([one, middle, other]: [Point3<f64>; 3]) -> Option<Self> {
        let (to_one, to_other) = (one - middle, other - middle);
        let across = to_other.cross(&to_one);
        let to_center = (to_one * to_other.norm_squared() - to_other * to_one.norm_squared()).cross(&across);
        let through = middle + to_center / (2.0 * across.norm_squared());
        let direction = across.try_normalize(0.0)?;
        through.coords.amax().is_finite().then_some(Self { through, direction })
    }

    /// How far along the axis a point is, mm, and the vector from the axis to it, mm.
    fn split(&self, at: &Point3<f64>) -> (f64, Vector3<f64>) {
        let from = at - self.through;
        let along = from.dot(&self.direction);
        (along, from - self.direction * along)
    }

    /// How far along the axis and from it a point is, mm.
    pub(super) fn place(&self, at: &Point3<f64>) -> [f64; 2] {
        let (along, radial) = self.split(at);
        [along, radial.norm()]
    }

    /// The sine of the angle at which a normal at a point leaves the plane through the axis.
    pub(super) fn misses(&self, at: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
        let out = self.split(at).1.try_normalize(0.0);
        out.map_or(0.0, |out| self.direction.cross(&out).dot(normal).abs())
    }

    /// The parts of a normal at a point along the axis and away from it.
    pub(super) fn in_profile(&self, at: &Point3<f64>, normal: &Vector3<f64>) -> [f64; 2] {
        let out = self.split(at).1.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        [normal.dot(&self.direction), normal.dot(&out)]
    }

    /// The unit vector at a point with these parts along the axis and away from it.
    pub(super) fn in_space(&self, at: &Point3<f64>, [along, out]: [f64; 2]) -> Vector3<f64> {
        let radial = self.split(at).1.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let vector = self.direction * along + radial * out;
        vector.try_normalize(0.0).unwrap_or(vector)
    }

    /// Whether another axis is about the same.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        let [_, apart] = self.place(&other.through);
        let size = (other.through - self.through).norm().max(1.0);
        self.direction.cross(&other.direction).norm() < SAME_AXIS && apart < SAME_AXIS * size
    }

    /// Moved to where points on rings are nearest to these (Gauss-Newton steps on the distances along and from the axis). Each point
    /// has the number of its ring.
    pub(super) fn fitted(self, points: &[(usize, Point3<f64>)], rings: usize) -> Option<Self> {
        let (first, second) = cross_directions(&self.direction);
        // For each point the distances with their derivatives by two turns and two shifts of the axis.
        let rows = points.iter().map(|(ring, at)| {
            let (along, radial) = self.split(at);
            let radius = radial.norm();
            let out = radial.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
            let (one, two) = (out.dot(&first), out.dot(&second));
            let by_along = Vector4::new(radius * one, radius * two, 0.0, 0.0);
            let by_radius = -Vector4::new(one * along, two * along, one, two);
            (*ring, [(along, by_along), (radius, by_radius)])
        });
        let rows: Vec<_> = rows.collect();
        let mut means = vec![([(0.0, Vector4::zeros()); 2], 0.0); rings];
        for (ring, row) in &rows {
            let (sums, count) = &mut means[*ring];
            for ((sum, derivatives), (value, by)) in sums.iter_mut().zip(row) {
                *sum += value;
                *derivatives += by;
            }
            *count += 1.0;
        }
        let (mut matrix, mut right) = (Matrix4::zeros(), Vector4::zeros());
        for (ring, row) in &rows {
            let (sums, count) = &means[*ring];
            for ((sum, derivatives), (value, by)) in sums.iter().zip(row) {
                let (off, by) = (value - sum / count, by - derivatives / *count);
                matrix += by * by.transpose();
                right -= by * off;
            }
        }
        let step = matrix.cholesky()?.solve(&right);
        let direction = (self.direction + first * step.x + second * step.y).try_normalize(0.0)?;
        Some(Self { through: self.through + first * step.z + second * step.w, direction })
    }
}

/// The rings of some vertices about an axis.
pub(super) struct Rings {
    /// For each vertex its ring, or [`NONE`].
    pub(super) of_vertex: Vec<u32>,
    pub(super) count: usize,
}

impl Rings {
    /// Those of vertices that are apart by at most `apart`, mm.
    pub(super) fn about(axis: &Axis, points: &[Point3<f64>], apart: f64) -> Self {
        let places: Vec<[f64; 2]> = points.iter().map(|at| axis.place(at)).collect();
        let place = |vertex: u32, side: usize| places[vertex as usize][side];
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.sort_by(|&one, &other| place(one, 0).total_cmp(&place(other, 0)));
        let (mut of_vertex, mut count) = (vec![NONE; points.len()], 0);
        for level in order.chunk_by_mut(|&one, &other| place(other, 0) - place(one, 0) <= apart) {
            level.sort_by(|&one, &other| place(one, 1).total_cmp(&place(other, 1)));
            for ring in level.chunk_by(|&one, &other| place(other, 1) - place(one, 1) <= apart) {
                let is_narrow = [0, 1].into_iter().all(|side| {
                    let [low, high] = range(ring.iter().map(|&vertex| place(vertex, side)));
                    high - low <= 2.0 * apart
                });
                let is_pole = ring.len() == 1 && place(ring[0], 1) <= apart;
                if is_pole || is_narrow && ring.len() >= LEAST_ON_RING {
                    ring.iter().for_each(|&vertex| of_vertex[vertex as usize] = count);
                    count += 1;
                }
            }
        }
        Self { of_vertex, count: count as usize }
    }

    /// The points on rings, each with the number of its ring.
    pub(super) fn members(&self, points: &[Point3<f64>]) -> Vec<(usize, Point3<f64>)> {
        let on_rings = self.of_vertex.iter().zip(points).filter(|(ring, _)| **ring != NONE);
        on_rings.map(|(&ring, &at)| (ring as usize, at)).collect()
    }
}

impl RingPlace {
    /// That of some of the points.
    pub(super) fn of(axis: &Axis, points: &[Point3<f64>], ring: &[u32]) -> Self {
        let count = ring.len() as f64;
        let places = || ring.iter().map(|&point| axis.place(&points[point as usize]));
        let sum = places().fold([0.0; 2], |sum, place| [sum[0] + place[0], sum[1] + place[1]]);
        let at = sum.map(|sum| sum / count);
        let squares: f64 =
            places().map(|place| (place[0] - at[0]).powi(2) + (place[1] - at[1]).powi(2)).sum();
        Self { at, deviation: squares.sqrt() / count }
    }
}

/// The pieces of a curve through points between places where it bends by more than [`MOST_BEND`] from one chord to the next.
fn smooth_pieces(points: &[[f64; 2]], mut order: Vec<usize>, is_closed: bool) -> Vec<(Vec<usize>, bool)> {
    let is_corner = |order: &[usize], at: usize| {
        let count = order.len();
        let [before, here, after] = [at + count - 1, at, at + 1].map(|at| points[order[at % count]]);
        let chord = |from: [f64; 2], to: [f64; 2]| Vector2::new(to[0] - from[0], to[1] - from[1]);
        chord(before, here).angle(&chord(here, after)) > MOST_BEND
    };
    if is_closed {
        let Some(corner) = (0..order.len()).find(|&at| is_corner(&order, at)) else {
            return vec![(order, true)];
        };
        order.rotate_left(corner);
        order.push(order[0]);
    }
    let mut pieces = Vec::new();
    let mut first = 0;
    for at in 1..order.len() {
        if at + 1 == order.len() || is_corner(&order, at) {
            pieces.push((order[first..=at].to_vec(), false));
            first = at;
        }
    }
    pieces
}

/// The curves on which points follow each other: each with its points in order, and whether it is closed. Of
/// the points `beside` a point, and beside these, a point follows it if no third point is nearer to both than
/// they are to each other (Toussaint, The relative neighbourhood graph of a finite planar set, 1980). A point
/// with more than two followers is on no curve.
pub(super) fn curves(points: &[[f64; 2]], beside: &[BTreeSet<usize>]) -> Vec<(Vec<usize>, bool)> {
    let apart = |one: usize, other: usize| {
        (points[one][0] - points[other][0]).hypot(points[one][1] - points[other][1])
    };
    let near: Vec<BTreeSet<usize>> = (0..points.len())
        .map(|one| {
            let second = beside[one].iter().flat_map(|&other| beside[other].iter().copied());
            beside[one].iter().copied().chain(second).filter(|other| *other != one).collect()
        })
        .collect();
    let next: Vec<Vec<usize>> = (0..points.len())
        .map(|one| {
            let is_next = |&other: &usize| {
                let length = apart(one, other);
                let is_between = |&point: &usize| apart(one, point) < length && apart(point, other) < length;
                !near[one].iter().chain(&near[other]).any(is_between)
            };
            near[one].iter().copied().filter(is_next).collect()
        })
        .collect();
    let mut is_seen = vec![false; points.len()];
    let mut curves = Vec::new();
    // Those with ends first; the others are closed.
    for ends in [1, 2] {
        for first in 0..points.len() {
            if is_seen[first] || next[first].len() != ends {
                continue;
            }
            is_seen[first] = true;
            let (mut order, mut here) = (vec![first], next[first][0]);
            while !is_seen[here] && next[here].len() <= 2 {
                is_seen[here] = true;
                order.push(here);
                let onward =
                    next[here].iter().copied().find(|&point| !is_seen[point] && next[point].len() <= 2);
                here = onward.unwrap_or(here);
            }
            let own: BTreeSet<usize> = order.iter().copied().collect();
            let others = order.iter().flat_map(|&point| &beside[point]);
            let of_other_curves = others.clone().filter(|other| !own.contains(other)).count();
            if of_other_curves as f64 <= MOST_OF_OTHERS * others.count() as f64 {
                let is_closed = ends == 2 && next[here].contains(&first);
                let pieces = smooth_pieces(points, order, is_closed).into_iter();
                curves.extend(pieces.filter(|(order, _)| order.len() >= LEAST_RINGS));
            }
        }
    }
    curves
}
