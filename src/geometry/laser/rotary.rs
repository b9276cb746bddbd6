//! Marks that go round a cylinder or cone: the unrolled plane of the drawing, with angles about the axis.
//!
//! A turn of the part about its axis is a rigid motion of this plane: a shift on a cylinder, a rotation about the apex on a
//! cone. So a tile of the drawing is moved to the side that faces the laser and is corrected there like any drawing.

mod cut;
mod even;
mod plan;

use nalgebra::Vector2;

use crate::geometry::mapping::LengthTrueMap;
use crate::geometry::pattern::{Affine, Path, Pattern, Shape};
use crate::geometry::space::FlatPoint;

pub use cut::{Item, items, tile};
pub use plan::{Cut, Limits, Tiling, counts, plan};

/// The plane of a drawing that is unrolled from a cylinder or cone. Angles are about the axis, in rad from the anchor; they
/// grow in the direction round the axis that is nearer to the drawing's x ([`LengthTrueMap::round_angle`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unrolled {
    form: Form,
    /// Unit vector in the direction of growing angles at the anchor.
    round: Vector2<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Form {
    Cylinder {
        anchor: FlatPoint,
        radius: f64,
    },
    Cone {
        apex: FlatPoint,
        /// Unit vector from the apex to the anchor.
        out: Vector2<f64>,
        /// Sine of the angle between axis and generators.
        sin: f64,
        /// The direction opposite to which angles jump, rad in the plane from `out`.
        middle: f64,
    },
}

impl Unrolled {
    /// The plane of a map that unrolls a cylinder or cone; `None` for other maps.
    pub fn of(map: &LengthTrueMap) -> Option<Self> {
        let angle = map.round_angle()?;
        let round = Vector2::new(angle.cos(), angle.sin());
        let form = match map {
            LengthTrueMap::Cylinder(map, _) => {
                Form::Cylinder { anchor: map.anchor(), radius: map.cylinder.radius }
            }
            LengthTrueMap::Cone(map, _) => {
                let apex = map.flat_apex();
                let out = (map.anchor() - apex).normalize();
                Form::Cone { apex, out, sin: map.cone.half_angle.sin(), middle: 0.0 }
            }
            _ => return None,
        };
        Some(Self { form, round })
    }

    /// The same plane with angles that do not jump between points of the pattern, as far as there is a gap round the apex
    /// of a cone.
    #[must_use]
    pub fn without_jump_in(mut self, pattern: &Pattern) -> Self {
        let round = self.round;
        if let Form::Cone { apex, out, middle, .. } = &mut self.form {
            let polar = |at: FlatPoint| (at - *apex).dot(&round).atan2((at - *apex).dot(out));
            let points = pattern.paths.iter().flat_map(|path| path.shape.flattened(0.1));
            let mut angles: Vec<f64> = points.map(polar).collect();
            angles.sort_by(f64::total_cmp);
            let whole = std::f64::consts::TAU;
            let next = angles.iter().skip(1).copied().chain(angles.first().map(|first| first + whole));
            let gap = angles.iter().copied().zip(next).max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0)));
            if let Some((from, to)) = gap {
                let opposite = (from + to) / 2.0 - std::f64::consts::PI;
                *middle = opposite - whole * (opposite / whole).round();
            }
        }
        self
    }

    /// The angle of a point about the axis, rad.
    pub fn angle(&self, at: FlatPoint) -> f64 {
        match self.form {
            Form::Cylinder { anchor, radius } => (at - anchor).dot(&self.round) / radius,
            Form::Cone { apex, out, sin, middle } => {
                let (turned_sin, turned_cos) = middle.sin_cos();
                let ahead = out * turned_cos + self.round * turned_sin;
                let aside = self.round * turned_cos - out * turned_sin;
                let from_apex = at - apex;
                (middle + from_apex.dot(&aside).atan2(from_apex.dot(&ahead))) / sin
            }
        }
    }

    /// The position of a point along the axis, mm: on a cone the distance from the apex.
    pub fn along(&self, at: FlatPoint) -> f64 {
        match self.form {
            Form::Cylinder { anchor, .. } => (at - anchor).dot(&self.axis()),
            Form::Cone { apex, .. } => at.distance(apex),
        }
    }

    /// The point at an angle (rad) and a position along the axis (mm).
    pub fn point(&self, angle: f64, along: f64) -> FlatPoint {
        let (from, direction) = self.generator(angle);
        from + direction * along
    }

    /// Distance from the axis at a position along it, mm.
    pub fn radius(&self, along: f64) -> f64 {
        match self.form {
            Form::Cylinder { radius, .. } => radius,
            Form::Cone { sin, .. } => along * sin,
        }
    }

    /// The motion of the plane when the angles of all points grow by `angle` rad.
    pub fn turn(&self, angle: f64) -> Affine {
        match self.form {
            Form::Cylinder { anchor, radius } => {
                Affine::rigid(anchor, 0.0, anchor + self.round * (angle * radius))
            }
            Form::Cone { apex, out, sin, .. } => {
                let sense = out.perp(&self.round).signum();
                Affine::rigid(apex, angle * sin * sense, apex)
            }
        }
    }

    /// The direction along the axis on a cylinder.
    fn axis(&self) -> Vector2<f64> {
        Vector2::new(-self.round.y, self.round.x)
    }

    /// The line along the part at an angle: a point, from which positions along the axis are measured, and its unit
    /// direction.
    fn generator(&self, angle: f64) -> (FlatPoint, Vector2<f64>) {
        match self.form {
            Form::Cylinder { anchor, radius } => (anchor + self.round * (angle * radius), self.axis()),
            Form::Cone { apex, out, sin, .. } => {
                let (turned_sin, turned_cos) = (angle * sin).sin_cos();
                (apex, out * turned_cos + self.round * turned_sin)
            }
        }
    }

    /// The smallest and the largest angle of a path, rad, to within a micrometre of the path.
    fn span(&self, path: &Path) -> [f64; 2] {
        let angles = path.shape.flattened(FINE).into_iter().map(|at| self.angle(at));
        angles.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], angle| {
            [least.min(angle), most.max(angle)]
        })
    }

    /// Whether this line along the part passes so near to a corner of the paths that it is not clear on which side the
    /// corner is.
    fn touches(&self, angle: f64, paths: &[Path]) -> bool {
        let (from, direction) = self.generator(angle);
        let is_near = |at: FlatPoint| direction.perp(&(at - from)).abs() < TOUCHING;
        paths.iter().any(|path| match &path.shape {
            Shape::Dot(at) => is_near(*at),
            shape => shape.segments().iter().any(|each| is_near(each.start()) || is_near(each.end())),
        })
    }

    /// The angle nearest to `angle` whose line along the part passes no corner of the paths; it is at most a hundredth of a
    /// millimetre away.
    fn clear_of_corners(&self, angle: f64, paths: &[Path], radius: f64) -> f64 {
        let aside = |step: i32| {
            let steps = if step % 2 == 0 { step / 2 } else { -(step + 1) / 2 };
            angle + f64::from(steps) * 5.0 * TOUCHING / radius
        };
        (0..1000).map(aside).find(|angle| !self.touches(*angle, paths)).unwrap_or(angle)
    }
}

/// Chord tolerance for the angles of curves, mm.
const FINE: f64 = 1e-3;
/// A corner nearer than this to a border is on it, mm.
const TOUCHING: f64 = 2e-6;

#[cfg(test)]
mod tests;
