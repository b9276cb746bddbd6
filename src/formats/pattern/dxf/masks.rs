//! Backgrounds of texts that hide what is drawn before them.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2};

use crate::geometry::pattern::{Path, Shape};
use crate::geometry::space::{Extents, FlatPoint};

/// Chord tolerance of curves behind a background, mm.
const TOLERANCE: f64 = 0.01;

/// A parallelogram that hides what is behind it, as seen from above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Mask {
    corner: FlatPoint,
    /// From the plane to the parallelogram's own coordinates, from 0 to 1 inside.
    into: Matrix2<f64>,
    extents: Extents,
}

impl Mask {
    /// The parallelogram with these corners in circular order; `None` if it has no area.
    pub(super) fn new(corners: [FlatPoint; 4]) -> Option<Self> {
        let [corner, along, _, across] = corners;
        let into = Matrix2::from_columns(&[along - corner, across - corner]).try_inverse()?;
        Some(Self { corner, into, extents: Extents::of(corners.map(FlatPoint::coords)) })
    }

    /// Whether it hides ink of one of the paths; each comes with its extents.
    pub(super) fn hides<'p>(&self, paths: impl Iterator<Item = (&'p Path, &'p Extents)>) -> bool {
        let middle = self.corner + self.into.try_inverse().unwrap_or_default() * Vector2::new(0.5, 0.5);
        // Fills by the number of their region: whether the middle is inside by the even-odd rule.
        let mut is_inside: BTreeMap<u32, bool> = BTreeMap::new();
        for (path, extents) in paths.filter(|(_, extents)| self.meets(extents)) {
            let points = match &path.shape {
                Shape::Dot(point) => vec![*point],
                shape => shape.flattened(TOLERANCE),
            };
            let closing = points.first().filter(|_| matches!(path.shape, Shape::Closed(_) | Shape::Dot(_)));
            let ends = || points.iter().zip(points.iter().skip(1).chain(closing));
            if ends().any(|(from, to)| self.is_crossed(*from, *to)) {
                return true;
            }
            if let Some(region) = path.region.filter(|_| extents.contains(middle.coords())) {
                let is_right = |from: &FlatPoint, to: &FlatPoint| {
                    let share = (middle.y - from.y) / (to.y - from.y);
                    (from.y > middle.y) != (to.y > middle.y) && from.x + share * (to.x - from.x) > middle.x
                };
                let crossings = ends().filter(|(from, to)| is_right(from, to)).count();
                *is_inside.entry(region).or_default() ^= crossings % 2 == 1;
            }
        }
        is_inside.values().any(|inside| *inside)
    }

    fn meets(&self, extents: &Extents) -> bool {
        (0..2).all(|axis| {
            extents.min[axis] <= self.extents.max[axis] && extents.max[axis] >= self.extents.min[axis]
        })
    }

    /// Whether a part of a line is inside (Liang and Barsky, A new concept and method for line clipping, 1984).
    fn is_crossed(&self, from: FlatPoint, to: FlatPoint) -> bool {
        let [from, to] = [from, to].map(|end| self.into * (end - self.corner));
        let (mut enters, mut leaves) = (0.0f64, 1.0f64);
        for axis in 0..2 {
            let step = to[axis] - from[axis];
            if step == 0.0 {
                if !(0.0..=1.0).contains(&from[axis]) {
                    return false;
                }
                continue;
            }
            let [one, other] = [0.0, 1.0].map(|side| (side - from[axis]) / step);
            enters = enters.max(one.min(other));
            leaves = leaves.min(one.max(other));
        }
        enters <= leaves
    }
}
