//! Sections through the facets of a mesh: what a plane cuts of them, one piece for each facet.

use nalgebra::{Point3, Vector3};

use crate::geometry::adjacency::NONE;

/// Pieces that are shorter than this, mm, have no direction.
const SHORT: f64 = 0.01;
/// Facets looked at on each side of a step, at most.
const MOST_BESIDE: usize = 16;
/// Facets looked at behind a vertex, at most.
const MOST_BEHIND: usize = 64;

/// The facets of a mesh and which of them continue each other.
pub(super) struct Facets<'a> {
    /// mm.
    pub(super) positions: &'a [Point3<f64>],
    /// Three vertices each.
    pub(super) triangles: &'a [[u32; 3]],
    /// For each side (3·t + k runs from corner k of triangle t to the next) the one that continues it, or [`NONE`].
    pub(super) continued: &'a [u32],
}

impl Facets<'_> {
    /// The corners of a triangle, mm.
    pub(super) fn corners(&self, triangle: usize) -> [Point3<f64>; 3] {
        self.triangles[triangle].map(|vertex| self.positions[vertex as usize])
    }

    /// The ends of a side, mm.
    pub(super) fn ends(&self, side: usize) -> [Point3<f64>; 2] {
        let corners = self.corners(side / 3);
        [corners[side % 3], corners[(side % 3 + 1) % 3]]
    }

    /// Follows the section in the plane at right angles to `across` from a point of a side into its triangle and on, as long as
    /// `visit` wants more of its pieces, with the triangle, mm; whether there is more.
    pub(super) fn section_from(
        &self,
        side: usize,
        start: Point3<f64>,
        across: Vector3<f64>,
        visit: impl FnMut(usize, Vector3<f64>) -> bool,
    ) -> bool {
        self.follow([start, start], across, side, MOST_BESIDE, visit)
    }

    /// Follows the section in the plane at right angles to `across` from a corner of a triangle through it and on, away from
    /// `ahead`, as long as `visit` wants more of its pieces, mm; whether it runs through the triangle.
    pub(super) fn section_behind(
        &self,
        (triangle, corner): (usize, usize),
        across: Vector3<f64>,
        ahead: Vector3<f64>,
        mut visit: impl FnMut(usize, Vector3<f64>) -> bool,
    ) -> bool {
        let corners = self.corners(triangle);
        let [start, one, other] = [0, 1, 2].map(|turn| corners[(corner + turn) % 3]);
        let off = [one, other].map(|point| (point - start).dot(&across));
        if (off[0] > 0.0) == (off[1] > 0.0) {
            return false;
        }
        let to = one + (other - one) * (off[0] / (off[0] - off[1]));
        if (to - start).dot(&ahead) >= 0.0 {
            return false;
        }
        let next = self.continued[triangle * 3 + (corner + 1) % 3];
        let has_direction = (to - start).norm() > SHORT;
        if (!has_direction || visit(triangle, to - start)) && next != NONE {
            self.follow([start, to], across, next as usize, MOST_BEHIND, visit);
        }
        true
    }

    /// Visits the pieces of `most` facets in the plane through a point at right angles to `across`. It starts
    /// from another point of that plane on a side, and goes into the side's triangle and on. Returns whether
    /// there are more.
    fn follow(
        &self,
        [through, mut from]: [Point3<f64>; 2],
        across: Vector3<f64>,
        mut side: usize,
        most: usize,
        mut visit: impl FnMut(usize, Vector3<f64>) -> bool,
    ) -> bool {
        for _ in 0..most {
            let corners = self.corners(side / 3);
            let off = corners.map(|point| (point - through).dot(&across));
            let [entry, next, apex] = [0, 1, 2].map(|turn| (side + turn) % 3);
            // The section leaves through the side whose ends are on different sides of the plane.
            let leaves = if (off[apex] > 0.0) == (off[entry] > 0.0) { next } else { apex };
            let (one, other) = (leaves, (leaves + 1) % 3);
            let whole = off[one] - off[other];
            if whole == 0.0 {
                return false;
            }
            let share = (off[one] / whole).clamp(0.0, 1.0);
            let to = corners[one] + (corners[other] - corners[one]) * share;
            if (to - from).norm() > SHORT && !visit(side / 3, to - from) {
                return true;
            }
            from = to;
            let continued = self.continued[side / 3 * 3 + leaves];
            if continued == NONE {
                return false;
            }
            side = continued as usize;
        }
        true
    }
}

/// The signed angle from one piece of a section to the next, rad, about `across`.
pub(super) fn turn(from: Vector3<f64>, to: Vector3<f64>, across: Vector3<f64>) -> f64 {
    from.cross(&to).dot(&across).atan2(from.dot(&to))
}
