//! Shallow cylinders whose facets do not run along their lines, for example on cambered plates.
//!
//! Where the outline of a face on a shallow cylinder is rounded, some programs divide the face only there.
//! The middle of the face is then one plane polygon. It meets the facets beside it in chords of the cylinder,
//! which look like edges of the part. All vertices are on the cylinder, though. An edge between two flat
//! sides whose corners are on one cylinder, as on a prism or on a shaft with a flat, runs along a line of the
//! cylinder. A side that leaves the cylinder between its ends is not an edge if the facets on both sides of
//! it, and enough other facets, have their corners on the cylinder.

use nalgebra::{Point3, Vector3};

use super::creases::Facing;
use super::cylinders::OnMesh;
use super::ends::{Surroundings, precision, rounding};
use super::rivals::{Others, cylinders, mean_normal, others, squares};
use super::round::{Camber, Round};
use super::round_group::{Group, LEAST_ANGLES, LEAST_VERTICES, SAME_ANGLE};
use super::{MOST_SEARCHED, SmoothMesh};
use crate::geometry::adjacency::{NONE, WELD_DISTANCE, facet_normal, middle, sliver_side};
use crate::geometry::fork::{Fork, mapped};
use crate::geometry::shape_fit::cross_directions;

/// The first facets of a camber meet one of the two facets beside a chord at an angle of at most this many
/// times the angle between these two.
const AROUND: f64 = 1.25;
/// Facets of a shallow cylinder lean from it by at most this, rad.
const LEAN: f64 = 0.2;
/// A shallow cylinder turns by at most this in all, rad. Chords of other cylinders may be edges of low-poly
/// models.
const MOST_TURN: f64 = 0.7;
/// A chord leaves the cylinder by at least this many times the tolerance of a vertex (`near`).
const LEAST_BULGE: f64 = 10.0;
/// A side runs along a line of the cylinder if it leaves the line by less than this many times the tolerance
/// of a vertex (`near`).
const ON_LINE: f64 = 2.0;
/// Cambers are searched for at this many sides at most, those with the most at stake ([`LEAST_AT_STAKE`]).
const MOST_TRIES: usize = 256;
/// A fit begins with at most this many facets.
const MOST_FIRST: usize = 200;
/// The largest facets round a side are searched for among at most this many facets.
const MOST_AROUND: usize = 2000;
/// Vertices are certainly on a camber if they leave its cylinder by at most this share of the tolerance of a
/// vertex (`precise`), root mean square. [`OF_ROUNDING`] is the other limit; the larger one applies.
const EXACT: f64 = 0.1;
/// Vertices are certainly on a camber if they leave its cylinder by at most this many standard deviations of
/// their rounding, root mean square. [`EXACT`] is the other limit; the larger one applies.
const OF_ROUNDING: f64 = 3.0;
/// A camber is searched for at sides whose length times the angle between their facets is at least this, mm.
const LEAST_AT_STAKE: f64 = 0.016;
/// A cylinder is fitted again to the facets that it has gained in at most this many rounds.
const ROUNDS: usize = 4;

/// What a mesh shows of its facets.
pub(super) struct Shown<'a> {
    /// Sides at which facets meet that seem to be edges of the part.
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
    if !shown.estimated.contains(&true) || mesh.triangles.len() > MOST_SEARCHED {
        return Vec::new();
    }
    let near = precision(mesh).max(rounding(shown.written));
    let is_open: Vec<bool> = (0..mesh.triangles.len())
        .map(|triangle| mesh.triangles[triangle].iter().all(|vertex| shown.estimated[*vertex as usize]))
        .collect();
    let is_round = |triangle: usize| shown.is_round.get(triangle).is_some_and(|is_round| *is_round);
    let seed = |side: usize| {
        let other = mesh.continued[side] as usize;
        let [one, there] = [side, other].map(|side| side / 3);
        if mesh.continued[side] == NONE || other < side || !is_open[one] || !is_open[there] {
            return None;
        }
        seed_at(mesh, [side as u32, other as u32]).filter(|_| !(is_round(one) && is_round(there)))
    };
    let of_triangle = |triangle: usize| [0, 1, 2].map(|side| seed(3 * triangle + side));
    let continued = mapped(fork, mesh.triangles.len(), of_triangle).into_iter().flatten().flatten();
    let is_open_crease = |[side, other]: &&Facing| {
        let [one, there] = [side, other].map(|side| *side as usize / 3);
        is_open[one] && is_open[there] && !(is_round(one) && is_round(there))
    };
    let creases = shown.creases.iter().filter(is_open_crease).filter_map(|&facing| seed_at(mesh, facing));
    let mut seeds: Vec<(f64, Facing, f64)> = continued.chain(creases).collect();
    if seeds.is_empty() {
        return Vec::new();
    }
    seeds.sort_by(|one, other| other.0.total_cmp(&one.0).then(one.1.cmp(&other.1)));
    let mut continued = mesh.continued.clone();
    for &[side, other] in shown.creases {
        (continued[side as usize], continued[other as usize]) = (other, side);
    }
    let is_tried = vec![false; mesh.triangles.len()];
    let precise = precision(mesh);
    let mut search = Search { mesh, near, precise, is_open, continued, creases: shown.creases, is_tried };
    let mut cambers: Vec<Camber> = Vec::new();
    for &(_, facing, turn) in seeds.iter().take(MOST_TRIES) {
        if facing.iter().any(|side| !search.is_open[*side as usize / 3]) {
            continue;
        }
        let Some(camber) = search.at(facing, turn).or_else(|| search.round(facing, &seeds)) else { continue };
        camber.triangles.iter().for_each(|&triangle| search.is_open[triangle] = false);
        cambers.push(camber);
    }
    search.confirmed(cambers, fork)
}

/// A side at which facets meet at an angle, with its length times this, mm, and this, rad, if it would matter for a shallow face: that of
/// a strip is much longer than its facets are wide.
fn seed_at(mesh: &SmoothMesh, facing: Facing) -> Option<(f64, Facing, f64)> {
    let [one, other] = facing.map(|side| facet_normal(mesh.corners(side as usize / 3).0));
    let [from, to] = mesh.ends(facing[0] as usize);
    let cosine = one.dot(&other);
    let squared = (2.0 - 2.0 * cosine) * (to - from).norm_squared();
    if squared < LEAST_AT_STAKE * LEAST_AT_STAKE || cosine < (MOST_TURN / 2.0).cos() {
        return None;
    }
    let turn = one.angle(&other);
    Some((turn * (to - from).norm(), facing, turn))
}

struct Search<'a> {
    mesh: &'a SmoothMesh,
    /// Vertices on a cylinder are this close to it, mm.
    near: f64,
    /// The same where the file does not round them otherwise, mm.
    precise: f64,
    /// For each triangle whether it may be of another camber.
    is_open: Vec<bool>,
    /// For each side the one that continues it, also across what seems to be an edge.
    continued: Vec<u32>,
    /// In ascending order.
    creases: &'a [Facing],
    /// For each triangle whether it is one of the largest ones round a side that are on no cylinder.
    is_tried: Vec<bool>,
}

impl Search<'_> {
    /// The camber of which a side between two facets that meet at an angle, rad, is a chord.
    fn at(&self, facing: Facing, turn: f64) -> Option<Camber> {
        let first = self.first(facing, turn);
        let points = self.mesh.corner_points(&first);
        if points.len() < LEAST_VERTICES {
            return None;
        }
        let is_chord = |round: &Round| self.is_chord(round, facing);
        let mut found = cylinders(&points, mean_normal(self.mesh, &first), self.near);
        found.retain(is_chord);
        // A face whose outline is on an ellipse may be on either of two cylinders.
        let &[cylinder] = found.as_slice() else { return None };
        let camber = self.whole(cylinder, facing[0] as usize / 3);
        if !camber.has(facing) || !is_chord(&camber.cylinder) {
            return None;
        }
        self.shown(camber)
    }

    /// The camber that the largest facets round a side show, if any of the `seeds` is a chord of it.
    ///
    /// The facets beside one chord often have too few corners, and those of a face are larger than those of the fillet round it.
    fn round(&mut self, facing: Facing, seeds: &[(f64, Facing, f64)]) -> Option<Camber> {
        if facing.iter().all(|side| self.is_tried[*side as usize / 3]) {
            return None;
        }
        let largest = self.largest(facing);
        let camber = self.through(&largest, seeds);
        if camber.is_none() {
            largest.iter().for_each(|&triangle| self.is_tried[triangle] = true);
        }
        camber
    }

    /// The camber through the corners of some facets.
    fn through(&self, largest: &[usize], seeds: &[(f64, Facing, f64)]) -> Option<Camber> {
        let points = self.mesh.corner_points(largest);
        if points.len() < LEAST_VERTICES {
            return None;
        }
        let from = *largest.first()?;
        let found = cylinders(&points, mean_normal(self.mesh, largest), self.near);
        found.into_iter().find_map(|cylinder| {
            let camber = self.whole(cylinder, from);
            let is_chord = |(_, seed, _): &(f64, Facing, f64)| {
                camber.has(*seed) && self.is_chord(&camber.cylinder, *seed)
            };
            let points = self.mesh.corner_points(&camber.triangles);
            let limit = (EXACT * self.precise).max(OF_ROUNDING * self.mesh.rounding);
            let is_exact = || squares(&camber.cylinder, &points) <= limit * limit * points.len() as f64;
            if !is_exact() || !seeds.iter().any(is_chord) {
                return None;
            }
            self.shown(camber)
        })
    }

    /// A camber, if its vertices show it, with the other one that they may be on as well.
    fn shown(&self, camber: Camber) -> Option<Camber> {
        if !self.is_shown(&camber) {
            return None;
        }
        match others(self.mesh, &camber.cylinder, &camber.triangles, self.near) {
            Others::None => Some(camber),
            Others::Perhaps(rival) => Some(Camber { rival: Some(rival), ..camber }),
            Others::Instead => None,
        }
    }

    /// The camber of a cylinder from one of its facets on.
    fn whole(&self, mut cylinder: Round, from: usize) -> Camber {
        let mut triangles = Vec::new();
        for _ in 0..ROUNDS {
            let grown = self.grown(&cylinder, from);
            if grown.len() <= triangles.len() {
                break;
            }
            triangles = grown;
            cylinder = cylinder.fitted(&self.mesh.corner_points(&triangles), self.near);
        }
        triangles.retain(|&triangle| self.is_on(&cylinder, triangle));
        triangles.sort_unstable();
        Camber { cylinder, triangles, rival: None }
    }

    fn is_chord(&self, round: &Round, facing: Facing) -> bool {
        self.leaves(round, facing[0] as usize) >= LEAST_BULGE * self.near
    }

    /// The largest facets round a side that do not turn far from the facets beside it; enough of them that
    /// their corners can show a cylinder.
    fn largest(&self, facing: Facing) -> Vec<usize> {
        let seeds = facing.map(|side| side as usize / 3);
        let normals = seeds.map(|triangle| facet_normal(self.mesh.corners(triangle).0));
        let mut is_found = vec![false; self.is_open.len()];
        seeds.iter().for_each(|&triangle| is_found[triangle] = true);
        let mut around = seeds.to_vec();
        let mut next = 0;
        while next < around.len() && around.len() < MOST_AROUND {
            for side in 3 * around[next]..3 * around[next] + 3 {
                let there = self.continued[side] as usize / 3;
                if self.continued[side] == NONE || !self.is_open[there] || is_found[there] {
                    continue;
                }
                let corners = self.mesh.corners(there).0;
                let turns_little =
                    |normal: &Vector3<f64>| normal.angle(&facet_normal(corners)) < MOST_TURN / 2.0;
                if sliver_side(corners).is_some() || normals.iter().any(turns_little) {
                    is_found[there] = true;
                    around.push(there);
                }
            }
            next += 1;
        }
        let area = |triangle: usize| {
            let [a, b, c] = self.mesh.corners(triangle).0;
            (b - a).cross(&(c - a)).norm()
        };
        let mut by_area: Vec<(f64, usize)> =
            around.into_iter().map(|triangle| (area(triangle), triangle)).collect();
        by_area.sort_by(|one, other| other.0.total_cmp(&one.0).then(one.1.cmp(&other.1)));
        let by_area: Vec<usize> = by_area.into_iter().map(|(_, triangle)| triangle).collect();
        // Two facets that share a side have four corners; each further one has one more at most.
        let mut count = by_area.len().min(LEAST_VERTICES / 3);
        while count < by_area.len() && self.mesh.corner_points(&by_area[..count]).len() < LEAST_VERTICES {
            count += 1;
        }
        by_area[..count].to_vec()
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
        for Camber { cylinder, triangles, .. } in &cambers {
            for vertex in triangles.iter().flat_map(|&triangle| self.mesh.triangles[triangle]) {
                whole.normals[vertex as usize] = cylinder.outward(&whole.positions[vertex as usize]);
            }
        }
        let surroundings = Surroundings::of(&whole, self.near, fork);
        let mut around = None;
        let mut is_confirmed = |Camber { cylinder, triangles, .. }: &Camber| {
            let group = Group::of(&whole, *cylinder, self.near, triangles.clone());
            surroundings.confirm(&OnMesh { mesh: &whole, group: &group }, &mut around)
        };
        cambers.into_iter().filter(|camber| is_confirmed(camber)).collect()
    }

    /// Whether the vertices of a camber leave no doubt of its cylinder, and it is shallow.
    fn is_shown(&self, Camber { cylinder, triangles, .. }: &Camber) -> bool {
        let points = self.mesh.corner_points(triangles);
        let outward = mean_normal(self.mesh, triangles);
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
