//! Edges of turned parts that no smooth profile explains, as those of a short cone between two cylinders.
//!
//! A CAD program limits how far chords leave a curve, and by how much they turn, on the rings of a turned part as along its profile. A
//! profile that is smooth at a ring turns there by no more than the chords beside it may. Other meshes do not have such limits. In
//! nets, all rings have the same number of vertices, or multiples of it; where the size of facets is given, they are about as high as
//! wide.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};

use super::creases::{LEAST, Steps, at_place};
use crate::geometry::adjacency::{NONE, width};

/// Chords turn by at most this, rad, with the usual settings of CAD programs: half a radian.
const LARGEST_TURN: f64 = 0.5;
/// Chords along the profile turn by at most this many times what those of a ring turn, if that is the limit.
const OF_TURN: f64 = 1.15;
/// Chords along the profile leave it by at most this many times what those of a ring leave their circle, if that is the limit.
const OF_SAGITTA: f64 = 1.5;
/// A ring has between these numbers of vertices: the limits of coarser ones are as large as most edges, and finer ones show none that
/// matter.
const VERTICES: [f64; 2] = [30.0, 720.0];
/// Sides of one ring have lengths, and turn by angles, that differ by less than this share.
const REGULAR: f64 = 0.05;
/// The difference of two angles of a ring is at most this many standard deviations of the vertices over the length of a side.
const OF_ROUNDING: f64 = 9.0;
/// Rings of a net have numbers of vertices in one of these proportions.
const OF_NET: [f64; 7] = [1.0, 2.0, 0.5, 3.0, 1.0 / 3.0, 1.5, 2.0 / 3.0];
/// A number of vertices is known to within this.
const OF_COUNT: f64 = 0.6;
/// Vertices are on one ring if they differ by at most this share of the height of a facet along the axis and from it.
const ON_RING: f64 = 0.1;
/// A facet that rises over the plane of its ring by less than this share of its width is of a flat side.
const FLAT: f64 = 0.01;
/// Facets whose size is given are between these many times as high as wide.
const OF_SIZE: [f64; 2] = [0.6, 1.4];
/// Facets at one vertex that are looked at until one has a side on the next ring.
const MOST_AT_VERTEX: usize = 6;

/// The circle of which a step is a chord.
struct Ring {
    center: Point3<f64>,
    /// Unit vectors along the step and from it to the center.
    along: Vector3<f64>,
    inward: Vector3<f64>,
    /// What a chord turns by, rad, and the share of it that rounded vertices leave open.
    turn: f64,
    open: f64,
    /// How far a chord leaves the circle, mm.
    sagitta: f64,
}

impl Ring {
    /// The angle of a point about the axis from the middle of the step, rad.
    fn angle(&self, at: &Point3<f64>) -> f64 {
        let out = at - self.center;
        out.dot(&self.along).atan2(-out.dot(&self.inward))
    }

    /// How far a point is from the plane of the ring, with its sign, and from the axis, mm.
    fn place(&self, at: &Point3<f64>) -> [f64; 2] {
        let out = at - self.center;
        let axis = self.along.cross(&self.inward);
        [out.dot(&axis), (out - axis * out.dot(&axis)).norm()]
    }
}

impl Steps<'_> {
    /// Whether a step is a chord of a ring at which the part turns by more than a smooth profile would, cut by the limits that the ring
    /// shows. `ends` are the steps by place, and `turned` is its angle, rad.
    pub(super) fn exceeds_limits(&self, number: usize, turned: f64, ends: &[(u32, u32)]) -> bool {
        if turned <= LEAST {
            return false;
        }
        let Some(ring) = self.ring(number, ends) else { return false };
        let sides = self.steps[number].map(|side| side as usize);
        let chords = sides.map(|side| width(self.facets.corners(side / 3), side % 3));
        let [from, to] = self.facets.ends(sides[0]);
        let length = (to - from).norm();
        if chords.iter().all(|chord| (OF_SIZE[0]..OF_SIZE[1]).contains(&(chord / length))) {
            return false;
        }
        let by_sagitta = |length: f64| (8.0 * OF_SAGITTA * ring.sagitta / length).min(LARGEST_TURN);
        // The two chords turn by twice the angle between them.
        let limited_by_sagitta = chords.map(by_sagitta).into_iter().sum::<f64>() / 2.0;
        let limit = limited_by_sagitta.max(OF_TURN * ring.turn);
        turned > limit + LEAST && sides.into_iter().any(|side| self.has_other_count(&ring, side))
    }

    /// The ring of which a step is a side, if those that continue it at both ends are as long and turn by as much.
    fn ring(&self, number: usize, ends: &[(u32, u32)]) -> Option<Ring> {
        let side = self.steps[number][0];
        let [from, to] = self.facets.ends(side as usize);
        let length = (to - from).norm();
        let along = (to - from) / length;
        let next = |place: u32| {
            let others = at_place(ends, place).filter(|&other| other != number);
            let others = others.map(|other| self.steps[other][0]).filter(|&other| {
                let [from, to] = self.facets.ends(other as usize);
                ((to - from).norm() / length - 1.0).abs() < REGULAR && self.runs_on(place, side, other)
            });
            let bent = others.map(|other| (self.bend(place, side, other), self.away(place, other)));
            bent.min_by(|(one, _), (other, _)| one.total_cmp(other))
        };
        let [before, after] = self.end_places(side).map(next);
        let ((one, back), (other, ahead)) = (before?, after?);
        let turn = (one + other) / 2.0;
        let open = OF_ROUNDING * self.rounding / (length * turn);
        let is_fine = (VERTICES[0]..VERTICES[1]).contains(&(TAU / turn));
        if !(is_fine && (one - other).abs() < REGULAR.max(open) * turn && open < 0.5) {
            return None;
        }
        let bend = back.normalize() + ahead.normalize();
        let across = bend - along * bend.dot(&along);
        // Both ends turn to one side, in one plane.
        if across.norm() < (1.0 - REGULAR) * 2.0 * turn.sin() {
            return None;
        }
        let inward = across.try_normalize(0.0)?;
        let radius = length / (2.0 * (turn / 2.0).sin());
        let center = nalgebra::center(&from, &to) + inward * radius * (turn / 2.0).cos();
        Some(Ring { center, along, inward, turn, open, sagitta: radius * (1.0 - (turn / 2.0).cos()) })
    }

    /// Whether the ring beyond the facet at a side of a ring is as regular, and has a number of vertices that is in no proportion to that
    /// of this one.
    fn has_other_count(&self, ring: &Ring, side: usize) -> bool {
        let corners = self.facets.corners(side / 3);
        let apex = corners[(side % 3 + 2) % 3];
        let [height, radius] = ring.place(&apex);
        if height.abs() < FLAT * width(corners, side % 3) {
            return false;
        }
        let near = ON_RING * height.abs();
        let next = |turn: usize| {
            let mut at = side / 3 * 3 + (side % 3 + turn) % 3;
            for _ in 0..MOST_AT_VERTEX {
                let beyond = self.facets.continued[at];
                if beyond == NONE {
                    return None;
                }
                let beyond = beyond as usize;
                let corner = self.facets.corners(beyond / 3)[(beyond % 3 + 2) % 3];
                let place = ring.place(&corner);
                if (place[0] - height).abs() <= near && (place[1] - radius).abs() <= near {
                    let apart = (ring.angle(&corner) - ring.angle(&apex) + PI).rem_euclid(TAU) - PI;
                    return Some(apart.abs());
                }
                if place[0].abs() > near {
                    return None;
                }
                // Another side of this ring: on round the apex, through the side that has it and the new corner.
                at = beyond / 3 * 3 + (beyond % 3 + 3 - turn) % 3;
            }
            None
        };
        let Some((one, other)) = next(1).zip(next(2)) else { return false };
        let spacing = (one + other) / 2.0;
        let allowed = REGULAR.max(ring.open);
        if (one - other).abs() >= allowed * spacing {
            return false;
        }
        let same = OF_COUNT * ring.turn / TAU + ring.open;
        OF_NET.iter().all(|times| (spacing / ring.turn / times - 1.0).abs() > same)
    }
}
