//! Facets whose corners, and the file's normals there, are on one cylinder or sphere.
//!
//! Narrow facets of a fillet, or long facets, leave in doubt how a face runs between its vertices. Their
//! exact normals may show it. On a sphere, equal steps lead from all vertices along their normals to one
//! point; on a cylinder, they lead to one straight line. A facet and one beside it have eight numbers more
//! than this requires.

use nalgebra::{Point3, Vector3};

use super::SmoothMesh;
use crate::geometry::adjacency::NONE;
use crate::geometry::fork::{Fork, found};

/// Normals in files are exact to this, rad.
const DIGITS: f64 = 1e-6;
/// The facets leave a cylinder or sphere by at least this many times the tolerance of their corners.
const LEAST_BULGE: f64 = 10.0;
/// Facets of one face turn by at most this in the exports of CAD programs, rad. Normals of models with fewer facets may be those
/// of a sphere through the corners of a cube.
const MOST_TURN: f64 = 0.51;
/// Doubts below these, mm and rad, do not matter.
const NEGLIGIBLE: [f64; 2] = [1e-6, 1e-6];

/// A cylinder or a sphere.
struct Exact {
    /// The middle of a sphere, or a point of the axis of a cylinder.
    center: Point3<f64>,
    /// Of a cylinder.
    axis: Option<Vector3<f64>>,
    /// Negative where the normals point to the middle, mm.
    radius: f64,
    /// How far corners may be off, mm.
    near: f64,
}

impl Exact {
    /// The one that a facet shows whose vertices may be off by `near`, mm.
    fn of(corners: [Point3<f64>; 3], normals: [Vector3<f64>; 3], near: f64) -> Option<Self> {
        let pairs = [[0, 1], [1, 2], [2, 0]];
        let turns = pairs.map(|[one, other]| normals[other] - normals[one]);
        let most = turns.iter().map(|turn| turn.norm()).fold(0.0, f64::max);
        if !(DIGITS..=MOST_TURN).contains(&most) {
            return None;
        }
        let ways = pairs.map(|[one, other]| corners[other] - corners[one]);
        let crosses = pairs.map(|[one, other]| normals[one].cross(&normals[other]));
        let by_length = |one: &&Vector3<f64>, other: &&Vector3<f64>| one.norm().total_cmp(&other.norm());
        let axis = crosses.iter().max_by(by_length)?.try_normalize(0.0)?;
        let longest = ways.iter().map(|way| way.norm()).fold(0.0, f64::max);
        // An axis is as exact as the normals over what they turn by.
        [(None, 0.0), (Some(axis), DIGITS / most * longest)].into_iter().find_map(|(axis, off)| {
            let across = |way: Vector3<f64>| axis.map_or(way, |axis| way - axis * axis.dot(&way));
            let products = ways.iter().zip(&turns).map(|(way, turn)| across(*way).dot(turn));
            let radius = products.sum::<f64>() / turns.iter().map(Vector3::norm_squared).sum::<f64>();
            let near = near + DIGITS * radius.abs() + off;
            let center = corners[0] - normals[0] * radius;
            let exact = Self { center, axis, radius, near };
            let is_enough = radius.abs() * most * most / 8.0 >= LEAST_BULGE * near;
            (is_enough && exact.has(corners, normals)).then_some(exact)
        })
    }

    /// The vector from the middle or the axis to a point.
    fn out(&self, at: &Point3<f64>) -> Vector3<f64> {
        let way = at - self.center;
        self.axis.map_or(way, |axis| way - axis * axis.dot(&way))
    }

    fn has(&self, corners: [Point3<f64>; 3], normals: [Vector3<f64>; 3]) -> bool {
        corners
            .iter()
            .zip(normals)
            .all(|(at, normal)| (self.out(at) - normal * self.radius).norm() <= self.near)
    }
}

impl SmoothMesh {
    /// Leaves no more doubt about facets that are of one cylinder or sphere, as their normals in the file show, than that their patches
    /// are off it. Their vertices may be off by `near`, mm.
    pub(super) fn trust_exact_normals(&mut self, estimated: &[bool], near: f64, fork: &dyn Fork) {
        if estimated.iter().all(|is_estimated| *is_estimated) {
            return;
        }
        let mesh = &*self;
        let of_triangle = |triangle: usize| {
            let doubt = mesh.doubts.get(triangle).copied().unwrap_or(0.0);
            let slope = f64::from(mesh.slope_doubts.get(triangle).copied().unwrap_or(0.0));
            let is_given =
                |triangle: usize| mesh.triangles[triangle].iter().all(|&vertex| !estimated[vertex as usize]);
            if doubt <= NEGLIGIBLE[0] && slope <= NEGLIGIBLE[1] || !is_given(triangle) {
                return None;
            }
            let (corners, normals) = mesh.corners(triangle);
            let exact = Exact::of(corners, normals, near)?;
            let beside = mesh.continued[3 * triangle..3 * triangle + 3].iter().filter(|&&side| side != NONE);
            let is_alike = |&side: &u32| {
                let there = side as usize / 3;
                let (corners, normals) = mesh.corners(there);
                is_given(there) && exact.has(corners, normals)
            };
            if !beside.into_iter().any(is_alike) {
                return None;
            }
            let (mut off, mut squares, mut count) = (0.0f64, 0.0, 0.0);
            for (at, normal) in mesh.patch(triangle).grid() {
                let out = exact.out(&at);
                off = off.max((out.norm() - exact.radius.abs()).abs());
                squares += normal.cross(&out.normalize()).norm_squared();
                count += 1.0;
            }
            Some((triangle, off.min(doubt), (squares / count).sqrt().min(slope)))
        };
        for (triangle, doubt, slope) in found(fork, mesh.triangles.len(), of_triangle) {
            if let Some(own) = self.doubts.get_mut(triangle) {
                *own = doubt;
            }
            if let Some(own) = self.slope_doubts.get_mut(triangle) {
                *own = slope as f32;
            }
        }
    }
}
