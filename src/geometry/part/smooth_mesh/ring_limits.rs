//! Edges of turned parts that no smooth profile explains, as those of a short cone between two cylinders.
//!
//! A CAD program limits how far chords leave a curve, and by how much they turn, on the rings of a turned part as along its profile. A
//! profile that is smooth at a ring turns there by no more than the chords beside it may. Meshes that are built as a net do not have such
//! limits: there all rings have the same number of vertices.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};

use super::creases::{Steps, at_place};
use crate::geometry::adjacency::{NONE, width};

/// Chords turn by at most this, rad, in any CAD program: half a radian.
const LARGEST_TURN: f64 = 0.5;
/// Chords along the profile turn by at most this many times what those of a ring turn, if that is the limit.
const OF_TURN: f64 = 1.15;
/// Chords along the profile leave it by at most this many times what those of a ring leave their circle, if that is the limit.
const OF_SAGITTA: f64 = 1.5;
/// Sides of a ring that CAD programs cut have lengths, and turn by angles, that differ by less than this share.
const REGULAR: f64 = 0.05;
/// Numbers of vertices on two rings that differ by less than this share are the same.
const SAME_COUNT: f64 = 0.03;
/// Vertices that are within this share of the height of a facet of the plane of a ring are on one ring.
const ON_RING: f64 = 0.1;
/// Facets at one vertex that are looked at until one has a side on the next ring.
const MOST_AT_VERTEX: usize = 6;

/// The circle of which a step is a chord.
struct Ring {
    center: Point3<f64>,
    /// Unit vectors along the step and from it to the center.
    along: Vector3<f64>,
    inward: Vector3<f64>,
    /// What a chord turns by, rad.
    turn: f64,
    /// How far a chord leaves the circle, mm.
    sagitta: f64,
}

impl Ring {
    /// The angle of a point about the axis from the middle of the step, rad.
    fn angle(&self, at: &Point3<f64>) -> f64 {
        let out = at - self.center;
        out.dot(&self.along).atan2(-out.dot(&self.inward))
    }

    /// How far a point is from the plane of the ring, mm, with its sign.
    fn off_plane(&self, at: &Point3<f64>) -> f64 {
        (at - self.center).dot(&self.along.cross(&self.inward))
    }
}

impl Steps<'_> {
    /// Whether a step is a chord of a ring at which the part turns by more than a smooth profile would, cut by the limits that the ring
    /// shows. `ends` are the steps by place, and `turned` is its angle, rad.
    pub(super) fn exceeds_limits(&self, number: usize, turned: f64, ends: &[(u32, u32)]) -> bool {
        let Some(ring) = self.ring(number, ends) else { return false };
        let sides = self.steps[number].map(|side| side as usize);
        let chord = |side: usize| width(self.facets.corners(side / 3), side % 3);
        let by_sagitta = |length: f64| (8.0 * OF_SAGITTA * ring.sagitta / length).min(LARGEST_TURN);
        // The two chords turn by twice the angle between them.
        let limited_by_sagitta = sides.map(chord).map(by_sagitta).into_iter().sum::<f64>() / 2.0;
        let limit = limited_by_sagitta.max(OF_TURN * ring.turn);
        turned > limit + super::creases::LEAST
            && sides.into_iter().any(|side| self.has_other_count(&ring, side))
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
        if !(turn > 0.0 && (one - other).abs() < REGULAR * turn) {
            return None;
        }
        let bend = back.normalize() + ahead.normalize();
        let inward = (bend - along * bend.dot(&along)).try_normalize(0.0)?;
        let radius = length / (2.0 * (turn / 2.0).sin());
        let center = nalgebra::center(&from, &to) + inward * radius * (turn / 2.0).cos();
        Some(Ring { center, along, inward, turn, sagitta: radius * (1.0 - (turn / 2.0).cos()) })
    }

    /// Whether the ring beyond the facet at a side of a ring has another number of vertices than this one, and neither twice nor half of
    /// it.
    fn has_other_count(&self, ring: &Ring, side: usize) -> bool {
        let apex = self.facets.corners(side / 3)[(side % 3 + 2) % 3];
        let height = ring.off_plane(&apex);
        let near = ON_RING * height.abs();
        let spacing = [1, 2].into_iter().find_map(|turn| {
            let mut at = side / 3 * 3 + (side % 3 + turn) % 3;
            for _ in 0..MOST_AT_VERTEX {
                let beyond = self.facets.continued[at];
                if beyond == NONE {
                    return None;
                }
                let beyond = beyond as usize;
                let corner = self.facets.corners(beyond / 3)[(beyond % 3 + 2) % 3];
                let off = ring.off_plane(&corner);
                if (off - height).abs() <= near {
                    return Some((ring.angle(&corner) - ring.angle(&apex) + PI).rem_euclid(TAU) - PI);
                }
                if off.abs() > near {
                    return None;
                }
                // Another side of this ring: on round the apex, through the side that has it and the new corner.
                at = beyond / 3 * 3 + (beyond % 3 + 3 - turn) % 3;
            }
            None
        });
        let is_same = |ratio: f64| [0.5, 1.0, 2.0].iter().any(|same| (ratio / same - 1.0).abs() < SAME_COUNT);
        spacing.is_some_and(|spacing| !is_same(spacing.abs() / ring.turn))
    }
}
