//! The frames: part, view, laser, field, and the plane of the drawing. Lengths in mm, angles in rad.
//!
//! A point of the drawing, a point of the view and a point of the field are all two numbers in mm, and mixing them up
//! would produce scrap. So they have different types ([`FlatPoint`], [`ViewPoint`], [`FieldPoint`]).

use std::marker::PhantomData;
use std::ops::{Add, Sub};

use nalgebra::{Matrix3, Point3, Vector2, Vector3};

/// The plane of the placed drawing: coordinates (s, t) in mm, true lengths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FlatSpace {}
/// The part as the laser sees it, along its axis: x to the right, y up, in mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ViewSpace {}
/// The marking software's working area: the coordinates of the corrected drawing, in mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldSpace {}

/// A point in one of the plane frames, in mm.
pub struct Point2<Space> {
    /// Coordinate to the right, mm.
    pub x: f64,
    /// Coordinate upwards, mm.
    pub y: f64,
    space: PhantomData<Space>,
}

/// A point of the pattern.
pub type FlatPoint = Point2<FlatSpace>;
/// A point of the view.
pub type ViewPoint = Point2<ViewSpace>;
/// A point of the marking field.
pub type FieldPoint = Point2<FieldSpace>;

impl<Space> Point2<Space> {
    /// The point (x, y), mm.
    pub const fn new(x: f64, y: f64) -> Self {
        Self { x, y, space: PhantomData }
    }

    /// The vector from the origin to the point, mm.
    pub fn coords(self) -> Vector2<f64> {
        Vector2::new(self.x, self.y)
    }

    /// Distance to another point of the same frame, mm.
    pub fn distance(self, other: Self) -> f64 {
        (other - self).norm()
    }

    /// The point at parameter `t` on the straight line to `other`: this point at 0, the other at 1.
    pub fn lerp(self, other: Self, t: f64) -> Self {
        Self::new(self.x + (other.x - self.x) * t, self.y + (other.y - self.y) * t)
    }

    /// Whether both coordinates are finite.
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite()
    }
}

impl<Space> From<Vector2<f64>> for Point2<Space> {
    fn from(vector: Vector2<f64>) -> Self {
        Self::new(vector.x, vector.y)
    }
}

impl<Space> Clone for Point2<Space> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<Space> Copy for Point2<Space> {}

impl<Space> PartialEq for Point2<Space> {
    fn eq(&self, other: &Self) -> bool {
        self.x == other.x && self.y == other.y
    }
}

impl<Space> std::fmt::Debug for Point2<Space> {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "({}, {})", self.x, self.y)
    }
}

impl<Space> Sub for Point2<Space> {
    type Output = Vector2<f64>;
    fn sub(self, other: Self) -> Vector2<f64> {
        Vector2::new(self.x - other.x, self.y - other.y)
    }
}

impl<Space> Add<Vector2<f64>> for Point2<Space> {
    type Output = Self;
    fn add(self, step: Vector2<f64>) -> Self {
        Self::new(self.x + step.x, self.y + step.y)
    }
}

/// An axis-parallel rectangle in one of the plane frames, in mm; empty until a point is included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extents {
    /// Smallest x and y, mm.
    pub min: Vector2<f64>,
    /// Largest x and y, mm.
    pub max: Vector2<f64>,
}

impl Extents {
    /// The empty rectangle.
    pub const EMPTY: Self = Self {
        min: Vector2::new(f64::INFINITY, f64::INFINITY),
        max: Vector2::new(f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    /// Extends the rectangle to include `point`.
    pub fn include(&mut self, point: Vector2<f64>) {
        self.min = self.min.inf(&point);
        self.max = self.max.sup(&point);
    }

    /// The bounding rectangle of the points.
    pub fn of(points: impl IntoIterator<Item = Vector2<f64>>) -> Self {
        let mut extents = Self::EMPTY;
        points.into_iter().for_each(|point| extents.include(point));
        extents
    }

    /// Whether no point was included.
    pub fn is_empty(&self) -> bool {
        self.min.x > self.max.x || self.min.y > self.max.y
    }

    /// Width and height, mm; −∞ for the empty rectangle.
    pub fn size(&self) -> Vector2<f64> {
        self.max - self.min
    }

    /// The centre, mm; NaN for the empty rectangle.
    pub fn center(&self) -> Vector2<f64> {
        (self.min + self.max) / 2.0
    }

    /// The rectangle with `margin` mm added on every side.
    pub fn grown(&self, margin: f64) -> Self {
        let step = Vector2::new(margin, margin);
        Self { min: self.min - step, max: self.max + step }
    }

    /// The smallest rectangle round it whose sides are at multiples of `step` mm.
    pub fn outwards_to(&self, step: f64) -> Self {
        Self { min: (self.min / step).map(f64::floor) * step, max: (self.max / step).map(f64::ceil) * step }
    }

    /// The rectangle with its sides multiplied by `factor` about its centre.
    pub fn scaled(&self, factor: f64) -> Self {
        let half = self.size() * (factor / 2.0);
        Self { min: self.center() - half, max: self.center() + half }
    }

    /// The rectangle extended about its centre so that both sides are at least `min_side` mm long.
    pub fn grown_to(&self, min_side: f64) -> Self {
        let half = self.size().map(|side| side.max(min_side) / 2.0);
        Self { min: self.center() - half, max: self.center() + half }
    }

    /// Distance of a point from the rectangle, mm; 0 inside.
    pub fn distance(&self, point: Vector2<f64>) -> f64 {
        (self.min - point).sup(&(point - self.max)).sup(&Vector2::zeros()).norm()
    }

    /// Whether the rectangles have a point in common.
    pub fn touches(&self, other: &Self) -> bool {
        (0..2).all(|axis| other.min[axis] <= self.max[axis] && other.max[axis] >= self.min[axis])
    }

    /// Whether the point is inside or on the border.
    pub fn contains(&self, point: Vector2<f64>) -> bool {
        point.x >= self.min.x && point.x <= self.max.x && point.y >= self.min.y && point.y <= self.max.y
    }
}

/// Which side of the part faces the laser, as a direction in the part frame that points to the laser.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facing {
    direction: Vector3<f64>,
}

impl Facing {
    /// The part's top: +Z points to the laser.
    pub const TOP: Self = Self { direction: Vector3::new(0.0, 0.0, 1.0) };

    /// The side whose outward direction is `direction` (any length except zero, part frame); `None` if the length is
    /// zero or not finite.
    pub fn towards(direction: Vector3<f64>) -> Option<Self> {
        let length = direction.norm();
        (length.is_finite() && length > 0.0).then(|| Self { direction: direction / length })
    }

    /// The side whose outward direction is exactly `direction` (part frame); `None` unless its length is 1, to within rounding.
    pub fn of_unit(direction: Vector3<f64>) -> Option<Self> {
        ((direction.norm() - 1.0).abs() < 1e-12).then_some(Self { direction })
    }

    /// The unit direction to the laser, in the part frame.
    pub fn direction(&self) -> Vector3<f64> {
        self.direction
    }
}

/// Where a drawing is marked, in the part frame, mm: its z axis points to the laser, its x axis is the drawing's x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkingFrame {
    origin: Point3<f64>,
    z: Vector3<f64>,
    x: Vector3<f64>,
}

/// Directions within this angle of an axis of the part, rad, are along it: files hold them with seven digits.
const ALONG_AXIS: f64 = 1e-6;

impl MarkingFrame {
    /// The frame with this origin, mm, and these directions of any length. The x axis is turned until it is perpendicular to
    /// z. `None` if a number is not finite, a direction has no length, or both directions are the same or opposite to
    /// within 0.06 deg.
    pub fn new(origin: Point3<f64>, z: Vector3<f64>, x: Vector3<f64>) -> Option<Self> {
        let (z, x) = (along_axes(Facing::towards(z)?.direction), Facing::towards(x)?.direction);
        let across = x - z * z.dot(&x);
        let is_valid = origin.iter().all(|value| value.is_finite()) && across.norm() > 1e-3;
        is_valid.then(|| Self { origin, z, x: along_axes(across.normalize()) })
    }

    /// The frame with this origin, mm, on the side that `facing` names, whose x axis is to the right in the view without
    /// roll.
    pub fn upright(origin: Point3<f64>, facing: Facing) -> Self {
        let z = along_axes(facing.direction);
        let x = View::new(Facing { direction: z }, 0.0).part_vector(Vector3::x());
        Self { origin, z, x: along_axes(x) }
    }

    /// The origin, mm.
    pub fn origin(&self) -> Point3<f64> {
        self.origin
    }

    /// The unit direction to the laser.
    pub fn z(&self) -> Vector3<f64> {
        self.z
    }

    /// The unit direction of the drawing's x.
    pub fn x(&self) -> Vector3<f64> {
        self.x
    }

    /// The origin in the view that the frame gives, mm.
    pub fn place(&self) -> ViewPoint {
        let origin = View::new(self.facing(), self.roll()).point(self.origin);
        ViewPoint::new(origin.x, origin.y)
    }

    /// The side of the part that the frame turns to the laser.
    pub fn facing(&self) -> Facing {
        Facing { direction: self.z }
    }

    /// The roll of the view in which the frame's x is to the right, rad, from −π to π.
    pub fn roll(&self) -> f64 {
        let right = View::new(self.facing(), 0.0).vector(self.x);
        let quarter = std::f64::consts::FRAC_PI_2;
        let roll = (-right.y).atan2(right.x);
        let quarters = (roll / quarter).round();
        let is_quarter = (roll - quarters * quarter).abs() < ALONG_AXIS;
        match quarters {
            // The same roll as half a turn and as none.
            -2.0 if is_quarter => 2.0 * quarter,
            -0.0 if is_quarter => 0.0,
            _ if is_quarter => quarters * quarter,
            _ => roll,
        }
    }
}

/// A unit direction without the rounding of files that hold it with seven digits.
fn along_axes(direction: Vector3<f64>) -> Vector3<f64> {
    direction.map(|share| if share.abs() < ALONG_AXIS { 0.0 } else { share }).normalize()
}

/// The rotation from the part frame to the view: x to the right, y up, z to the laser; the origin is that of the part.
///
/// For `±x` and `±y` the part's +Z is up, for `±z` its +Y is up; for any other direction +Z is as far up as possible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    rotation: Matrix3<f64>,
}

impl View {
    /// The view onto the side `facing`, turned by `roll` rad counter-clockwise about the laser's axis.
    pub fn new(facing: Facing, roll: f64) -> Self {
        let out = facing.direction;
        // Within 1e-6 rad of ±Z, the part's +Z no longer defines a direction in the view.
        let up_hint = if out.x.hypot(out.y) < 1e-6 { Vector3::y() } else { Vector3::z() };
        let right = up_hint.cross(&out).normalize();
        let up = out.cross(&right);
        let (sin, cos) = roll.sin_cos();
        let rolled_right = right * cos - up * sin;
        let rolled_up = right * sin + up * cos;
        let rotation =
            Matrix3::from_rows(&[rolled_right.transpose(), rolled_up.transpose(), out.transpose()]);
        Self { rotation }
    }

    /// The view onto the part's top, without a rotation.
    pub fn top() -> Self {
        Self { rotation: Matrix3::identity() }
    }

    /// The rotation from the part frame to the view.
    pub fn rotation(&self) -> Matrix3<f64> {
        self.rotation
    }

    /// A point of the part, mm, in the view: x to the right, y up, z towards the laser.
    pub fn point(&self, part: Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation * part.coords)
    }

    /// A point of the view, mm, in the part frame.
    pub fn part_point(&self, view: Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation.tr_mul(&view.coords))
    }

    /// A direction of the view in the part frame.
    pub fn part_vector(&self, view: Vector3<f64>) -> Vector3<f64> {
        self.rotation.tr_mul(&view)
    }

    /// A direction of the part frame in the view.
    pub fn vector(&self, part: Vector3<f64>) -> Vector3<f64> {
        self.rotation * part
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view_of(direction: [f64; 3]) -> View {
        View::new(Facing::towards(Vector3::from(direction)).unwrap(), 0.0)
    }

    #[test]
    fn facing_keeps_the_part_upright() {
        let is_up_in_view = |view: View, up: Vector3<f64>| (view.vector(up) - Vector3::y()).norm() < 1e-12;
        for side in [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]] {
            assert!(is_up_in_view(view_of(side), Vector3::z()), "{side:?}");
        }
        for side in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]] {
            assert!(is_up_in_view(view_of(side), Vector3::y()), "{side:?}");
        }
        assert_eq!(view_of([0.0, 0.0, 1.0]), View::top());
    }

    #[test]
    fn a_view_is_a_rotation_that_turns_its_side_to_the_laser() {
        for side in [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [0.3, -0.4, 0.8]] {
            let view = view_of(side);
            assert!((view.rotation.determinant() - 1.0).abs() < 1e-12);
            let out = view.vector(Vector3::from(side).normalize());
            assert!((out - Vector3::z()).norm() < 1e-12);
            let point = Point3::new(1.0, -2.0, 3.0);
            assert!((view.part_point(view.point(point)) - point).norm() < 1e-12);
            assert!((view.part_vector(out) - Vector3::from(side).normalize()).norm() < 1e-12);
        }
    }

    #[test]
    fn a_frame_turns_its_x_to_the_right_and_its_z_to_the_laser() {
        for (z, x) in [
            ([0.0, -1.0, 0.0], [1.0, 0.0, 0.0]),
            ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
            ([0.0, 0.0, -1.0], [0.6, 0.8, 0.0]),
            ([0.3, -0.4, 0.8], [-0.2, 0.9, 0.1]),
            ([1e-5, 0.0, 1.0], [0.0, -3.0, 0.0]),
        ] {
            let (z, x) = (Vector3::from(z), Vector3::from(x));
            let frame = MarkingFrame::new(Point3::new(1.0, 2.0, 3.0), z, x).unwrap();
            let view = View::new(frame.facing(), frame.roll());
            assert!((view.vector(z.normalize()) - Vector3::z()).norm() < 1e-12, "{z} {x}");
            let right = view.vector(x);
            assert!(right.x > 0.0 && right.y.abs() < 1e-12, "{z} {x}: {right}");
        }
    }

    #[test]
    fn a_frame_along_the_axes_is_the_side_that_has_a_name() {
        let noise = 3e-8;
        let z = Vector3::new(noise, -1.0, -noise);
        let frame = MarkingFrame::new(Point3::origin(), z, Vector3::new(1.0, noise, noise)).unwrap();
        assert_eq!((frame.facing().direction, frame.roll()), (-Vector3::y(), 0.0));
        assert!(frame.roll().is_sign_positive());
        let turned = MarkingFrame::new(Point3::origin(), z, Vector3::new(noise, noise, -1.0)).unwrap();
        assert_eq!(turned.roll(), 90f64.to_radians());
        let upright = MarkingFrame::upright(Point3::origin(), Facing::towards(-Vector3::y()).unwrap());
        assert_eq!((upright.x(), upright.roll()), (Vector3::x(), 0.0));
        for (z, x) in [([0.0; 3], [1.0, 0.0, 0.0]), ([0.0, 0.0, 1.0], [0.0, 0.0, -2.0])] {
            assert_eq!(MarkingFrame::new(Point3::origin(), z.into(), x.into()), None);
        }
    }

    #[test]
    fn roll_rotates_the_view_counter_clockwise() {
        let view = View::new(Facing::TOP, std::f64::consts::FRAC_PI_2);
        assert!((view.vector(Vector3::x()) - Vector3::y()).norm() < 1e-12);
    }
}
