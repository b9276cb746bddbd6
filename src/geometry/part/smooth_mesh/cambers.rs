//! Shallow cylinders whose facets do not run along their lines, as those of cambered plates.
//!
//! Where the outline of a face on a shallow cylinder is rounded, some programs divide it only there: its middle is one plane polygon,
//! which meets the facets beside it in chords of the cylinder, as at edges of the part. All vertices are on the cylinder, though. An edge
//! between two flat sides whose corners are on one cylinder runs along a line of it, as those of a prism and of a flat on a shaft do; one
//! that leaves the cylinder between its ends is none if the facets on both sides of it, and enough others, have their corners there.

use nalgebra::{Matrix2, Point3, SMatrix, SVector, Unit, Vector3};

use super::SmoothMesh;
use super::creases::Facing;
use super::cylinders::{Group, LEAST_ANGLES, LEAST_VERTICES, OnMesh, SAME_ANGLE, middle};
use super::ends::{Surroundings, precision, rounding};
use super::round::{Camber, Round};
use crate::geometry::adjacency::{NONE, WELD_DISTANCE, facet_normal, sliver_side};
use crate::geometry::fork::Fork;
use crate::geometry::shape_fit::cross_directions;

/// The first facets of a camber meet the two beside a chord at angles of at most so many times theirs.
const AROUND: f64 = 1.25;
/// Facets of a shallow cylinder lean from it by at most this, rad.
const LEAN: f64 = 0.2;
/// A shallow cylinder turns by at most this in all, rad. Chords of others are edges of low-poly models, too.
const MOST_TURN: f64 = 0.7;
/// A chord leaves the cylinder by at least so many times what a vertex may be off.
const LEAST_BULGE: f64 = 10.0;
/// A side runs along a line of the cylinder where it leaves that by less than so many times what a vertex may be off.
const ON_LINE: f64 = 2.0;
/// Sides at which a camber is looked for, at most: those beside which the most is at stake.
const MOST_TRIES: usize = 256;
/// Facets from which a fit begins, at most.
const MOST_FIRST: usize = 200;
/// Points of which a cylinder is fitted, at most.
const MOST_POINTS: usize = 400;
/// Rounds in which a cylinder is fitted to the facets that it has gained.
const ROUNDS: usize = 4;
/// Meshes with more triangles are fine; a search would take long.
const MOST_TRIANGLES: usize = 300_000;
/// What points show of a paraboloid by less than this share of what they show best, they do not show.
const DETERMINED: f64 = 1e-7;

/// What a mesh shows of its facets.
pub(super) struct Shown<'a> {
    /// Sides at which facets meet at an angle that matters.
    pub(super) steps: &'a [Facing],
    /// Those of them that seem to be edges of the part.
    pub(super) creases: &'a [Facing],
    /// For each vertex whether its normal is estimated.
    pub(super) estimated: &'a [bool],
    /// For each triangle whether it is of a known cylinder; empty if none is.
    pub(super) is_round: &'a [bool],
    /// The positions as the file states them, mm.
    pub(super) written: &'a [Point3<f64>],
}

/// The cambers of a mesh that have a chord between facets that meet at an angle and are not known to be of a cylinder.
pub(super) fn found(mesh: &SmoothMesh, shown: &Shown<'_>, fork: &dyn Fork) -> Vec<Camber> {
    if shown.steps.is_empty() || mesh.triangles.len() > MOST_TRIANGLES {
        return Vec::new();
    }
    let near = precision(mesh).max(rounding(shown.written));
    let is_open: Vec<bool> = (0..mesh.triangles.len())
        .map(|triangle| mesh.triangles[triangle].iter().all(|vertex| shown.estimated[*vertex as usize]))
        .collect();
    let is_round = |triangle: usize| shown.is_round.get(triangle).is_some_and(|is_round| *is_round);
    let seed = |&facing: &Facing| {
        let [one, other] = facing.map(|side| side as usize / 3);
        if !is_open[one] || !is_open[other] || is_round(one) && is_round(other) {
            return None;
        }
        let turn = facet_normal(mesh.corners(one).0).angle(&facet_normal(mesh.corners(other).0));
        let [from, to] = mesh.ends(facing[0] as usize);
        (turn < MOST_TURN / 2.0).then(|| (turn * (to - from).norm(), facing, turn))
    };
    let mut seeds: Vec<(f64, Facing, f64)> = shown.steps.iter().filter_map(seed).collect();
    if seeds.is_empty() {
        return Vec::new();
    }
    seeds.sort_by(|one, other| other.0.total_cmp(&one.0).then(one.1.cmp(&other.1)));
    let mut continued = mesh.continued.clone();
    for &[side, other] in shown.creases {
        (continued[side as usize], continued[other as usize]) = (other, side);
    }
    let mut search = Search { mesh, near, is_open, continued, creases: shown.creases };
    let mut cambers: Vec<Camber> = Vec::new();
    for (_, facing, turn) in seeds.into_iter().take(MOST_TRIES) {
        if facing.iter().any(|side| !search.is_open[*side as usize / 3]) {
            continue;
        }
        let Some(camber) = search.at(facing, turn) else { continue };
        camber.triangles.iter().for_each(|&triangle| search.is_open[triangle] = false);
        cambers.push(camber);
    }
    search.confirmed(cambers, fork)
}

struct Search<'a> {
    mesh: &'a SmoothMesh,
    /// Vertices on a cylinder are this close to it, mm.
    near: f64,
    /// For each triangle whether it may be of another camber.
    is_open: Vec<bool>,
    /// For each side the one that continues it, also across what seems to be an edge.
    continued: Vec<u32>,
    /// In ascending order.
    creases: &'a [Facing],
}

impl Search<'_> {
    /// The camber of which a side between two facets that meet at an angle, rad, is a chord.
    fn at(&self, facing: Facing, turn: f64) -> Option<Camber> {
        let first = self.first(facing, turn);
        let mut points = self.points(&first);
        if points.len() < LEAST_VERTICES {
            return None;
        }
        let is_chord = |round: &Round| self.leaves(round, facing[0] as usize) >= LEAST_BULGE * self.near;
        let of_axis = |axis| Round::cylinder_about(axis, &points, self.near).filter(is_chord);
        let found: Vec<Round> = axes(&points, self.normal(&first)).into_iter().filter_map(of_axis).collect();
        // A face whose outline is on an ellipse may be on either of two cylinders.
        let &[mut cylinder] = found.as_slice() else { return None };
        let mut triangles = Vec::new();
        for _ in 0..ROUNDS {
            let grown = self.grown(&cylinder, facing[0] as usize / 3);
            if grown.len() <= triangles.len() {
                break;
            }
            triangles = grown;
            points = self.points(&triangles);
            cylinder = cylinder.fitted(&points, self.near);
        }
        triangles.retain(|&triangle| self.is_on(&cylinder, triangle));
        triangles.sort_unstable();
        let camber = Camber { cylinder, triangles };
        (camber.has(facing) && is_chord(&cylinder) && self.is_shown(&camber)).then_some(camber)
    }

    /// The facets beside a side and those round them that meet one of both at about the same angle at most.
    fn first(&self, facing: Facing, turn: f64) -> Vec<usize> {
        let seeds = facing.map(|side| side as usize / 3);
        let normals = seeds.map(|triangle| facet_normal(self.mesh.corners(triangle).0));
        let places = seeds.map(|triangle| self.mesh.corners(triangle).0);
        let is_at_seed =
            |at: &Point3<f64>| places.as_flattened().iter().any(|place| (at - place).norm() <= WELD_DISTANCE);
        let mut found = seeds.to_vec();
        let mut next = 0;
        while next < found.len() && found.len() < MOST_FIRST {
            let here = found[next];
            next += 1;
            for side in 3 * here..3 * here + 3 {
                let there = self.continued[side] as usize / 3;
                if self.continued[side] == NONE || !self.is_open[there] || found.contains(&there) {
                    continue;
                }
                let corners = self.mesh.corners(there).0;
                let normal = facet_normal(corners);
                let is_alike = normals.iter().any(|seed| seed.angle(&normal) <= AROUND * turn);
                if is_alike && sliver_side(corners).is_none() && corners.iter().any(is_at_seed) {
                    found.push(there);
                }
            }
        }
        found
    }

    /// The mean normal of facets by their areas.
    fn normal(&self, triangles: &[usize]) -> Vector3<f64> {
        let across = triangles.iter().map(|&triangle| {
            let [a, b, c] = self.mesh.corners(triangle).0;
            (b - a).cross(&(c - a))
        });
        across.sum::<Vector3<f64>>().try_normalize(0.0).unwrap_or_else(Vector3::z)
    }

    /// The different places of the corners of some triangles, evenly chosen if there are many.
    fn points(&self, triangles: &[usize]) -> Vec<Point3<f64>> {
        let corners = triangles.iter().flat_map(|&triangle| self.mesh.corners(triangle).0);
        let mut points: Vec<Point3<f64>> = corners.collect();
        points.sort_by(|one, other| {
            let by = |axis: usize| one[axis].total_cmp(&other[axis]);
            by(0).then(by(1)).then(by(2))
        });
        points.dedup_by(|next, kept| (*next - *kept).norm() <= WELD_DISTANCE);
        let step = points.len().div_ceil(MOST_POINTS).max(1);
        points.into_iter().step_by(step).collect()
    }

    /// How far a side leaves a cylinder in its middle, mm.
    fn leaves(&self, round: &Round, side: usize) -> f64 {
        let [from, to] = self.mesh.ends(side);
        round.distance(&nalgebra::center(&from, &to)).abs()
    }

    fn is_on(&self, round: &Round, triangle: usize) -> bool {
        let corners = self.mesh.corners(triangle).0;
        let leans = || facet_normal(corners).cross(&round.outward(&middle(corners))).norm() > LEAN;
        corners.iter().all(|corner| round.distance(corner).abs() <= self.near)
            && (sliver_side(corners).is_some() || !leans())
    }

    /// The triangles on a cylinder that can be reached from one of them. What seems to be an edge and runs along a line of the cylinder
    /// may be one.
    fn grown(&self, round: &Round, from: usize) -> Vec<usize> {
        let mut is_found = vec![false; self.is_open.len()];
        let mut found = vec![from];
        is_found[from] = true;
        let mut next = 0;
        while next < found.len() {
            let here = found[next];
            next += 1;
            for side in 3 * here..3 * here + 3 {
                let other = self.continued[side];
                let there = other as usize / 3;
                if other == NONE || is_found[there] || !self.is_open[there] || !self.is_on(round, there) {
                    continue;
                }
                let facing = [other.min(side as u32), other.max(side as u32)];
                let is_crease = || self.creases.binary_search(&facing).is_ok();
                if self.leaves(round, side) < ON_LINE * self.near && is_crease() {
                    continue;
                }
                is_found[there] = true;
                found.push(there);
            }
        }
        found
    }

    /// The cambers that nothing beyond their ends contradicts.
    fn confirmed(&self, cambers: Vec<Camber>, fork: &dyn Fork) -> Vec<Camber> {
        if cambers.is_empty() {
            return cambers;
        }
        let mut whole = self.mesh.clone();
        whole.continued.clone_from(&self.continued);
        for Camber { cylinder, triangles } in &cambers {
            for vertex in triangles.iter().flat_map(|&triangle| self.mesh.triangles[triangle]) {
                whole.normals[vertex as usize] = cylinder.outward(&whole.positions[vertex as usize]);
            }
        }
        let surroundings = Surroundings::of(&whole, self.near, fork);
        let mut around = None;
        let mut is_confirmed = |Camber { cylinder, triangles }: &Camber| {
            let group = Group::of(&whole, *cylinder, self.near, triangles.clone());
            surroundings.confirm(&OnMesh { mesh: &whole, group: &group }, &mut around)
        };
        cambers.into_iter().filter(|camber| is_confirmed(camber)).collect()
    }

    /// Whether the vertices of a camber leave no doubt of its cylinder, and it is shallow.
    fn is_shown(&self, Camber { cylinder, triangles }: &Camber) -> bool {
        let points = self.points(triangles);
        let outward = self.normal(triangles);
        let (first, _) = cross_directions(&cylinder.axis());
        let second = cylinder.axis().cross(&first);
        let middle = outward.dot(&second).atan2(outward.dot(&first));
        let mut angles: Vec<f64> = points
            .iter()
            .map(|point| {
                let at = cylinder.outward(point);
                let at = at * at.dot(&outward).signum();
                let angle = at.dot(&second).atan2(at.dot(&first)) - middle;
                angle.sin().atan2(angle.cos())
            })
            .collect();
        angles.sort_by(f64::total_cmp);
        let whole = angles.last().zip(angles.first()).map_or(0.0, |(last, first)| last - first);
        angles.dedup_by(|next, kept| *next - *kept < SAME_ANGLE);
        points.len() >= LEAST_VERTICES && angles.len() >= LEAST_ANGLES && whole <= MOST_TURN
    }
}

/// The directions that the axis of a shallow cylinder through points may have whose facets have a mean normal: the two principal
/// directions of the paraboloid nearest to the points, the flatter one first.
fn axes(points: &[Point3<f64>], normal: Vector3<f64>) -> Vec<Unit<Vector3<f64>>> {
    let center =
        Point3::from(points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / points.len() as f64);
    let reach = points.iter().map(|point| (point - center).norm()).fold(0.0, f64::max);
    let (first, second) = cross_directions(&normal);
    let (mut matrix, mut right) = (SMatrix::<f64, 6, 6>::zeros(), SVector::<f64, 6>::zeros());
    for point in points {
        let from = (point - center) / reach;
        let (x, y) = (from.dot(&first), from.dot(&second));
        let row = SVector::<f64, 6>::from([1.0, x, y, x * x, x * y, y * y]);
        matrix += row * row.transpose();
        right += row * from.dot(&normal);
    }
    let decomposed = matrix.svd(true, true);
    let least = decomposed.singular_values.max() * DETERMINED;
    let Ok(solution) = decomposed.solve(&right, least) else { return Vec::new() };
    let [_, by_x, by_y, xx, xy, yy]: [f64; 6] = solution.into();
    let bends = Matrix2::new(2.0 * xx, xy, xy, 2.0 * yy).symmetric_eigen();
    let mut order = [0, 1];
    order.sort_by(|&one, &other| bends.eigenvalues[one].abs().total_cmp(&bends.eigenvalues[other].abs()));
    order
        .into_iter()
        .map(|index| {
            let along = bends.eigenvectors.column(index);
            let rise = along[0] * by_x + along[1] * by_y;
            Unit::new_normalize(first * along[0] + second * along[1] + normal * rise)
        })
        .collect()
}
