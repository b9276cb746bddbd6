//! The drawing to be marked, free of any file format: layers, paths and segments in mm.

use std::sync::Arc;

use nalgebra::Vector2;

use crate::geometry::space::{Extents, FlatPoint};

/// Points no farther apart than this, mm, are treated as one point: a nanometre, the precision of numbers in drawings.
pub const SAME_POINT: f64 = 1e-6;

/// A flat drawing, mm.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pattern {
    /// The layers that paths refer to by index.
    pub layers: Vec<Layer>,
    /// Everything to be marked, in drawing order.
    pub paths: Vec<Path>,
}

/// A layer of the drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// Its name, as in the file.
    pub name: String,
    /// Its colour; never [`Color::ByLayer`].
    pub color: Color,
}

/// A colour as the drawing file gives it. Marking software may choose the pen by colour, so it is kept, not converted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Color {
    /// The colour of the path's layer.
    ByLayer,
    /// An index of the AutoCAD colour table, 1 to 255.
    Aci(u8),
    /// A true colour, with the given or nearest index for readers that support only the table.
    Rgb {
        /// Index of the AutoCAD colour table, 1 to 255.
        aci: u8,
        /// Red, green, blue.
        rgb: [u8; 3],
    },
}

impl std::fmt::Display for Color {
    /// `by layer`, the index of the table, or `#rrggbb`.
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::ByLayer => out.write_str("by layer"),
            Self::Aci(index) => write!(out, "{index}"),
            Self::Rgb { rgb: [red, green, blue], .. } => write!(out, "#{red:02x}{green:02x}{blue:02x}"),
        }
    }
}

/// One connected thing to mark.
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    /// Index into [`Pattern::layers`].
    pub layer: usize,
    /// The path's own colour.
    pub color: Color,
    /// What is drawn.
    pub shape: Shape,
    /// The filled region that the path bounds, if it comes from a fill (HATCH, SOLID): paths with the same number bound
    /// one region by the even-odd rule. A closed path without a number bounds the inked area of its layer.
    pub region: Option<u32>,
    /// Where the path comes from.
    pub source: Source,
}

/// What a path draws.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A single spot.
    Dot(FlatPoint),
    /// A connected curve with two ends; each segment starts where the last one ended.
    Open(Vec<Segment>),
    /// A contour: the last segment ends where the first one starts.
    Closed(Vec<Segment>),
}

/// The entity of the file that a path comes from.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Source {
    /// Entity type, such as `LWPOLYLINE`.
    pub entity: String,
    /// The entity's handle in hexadecimal, if the file has one.
    pub handle: Option<String>,
    /// Whether the path is one of several strokes that the entity draws, as letters and hatch patterns do. Such strokes
    /// are not pieces of an exploded line, so their ends are not joined.
    pub is_stroke: bool,
    /// The innermost block whose definition contains the entity, or the element that a copy in an SVG shows.
    pub block: Option<Arc<str>>,
}

/// A smooth piece of a path, mm, with a parameter from 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub enum Segment {
    /// A straight line segment.
    Line {
        /// Start, mm.
        from: FlatPoint,
        /// End, mm.
        to: FlatPoint,
    },
    /// An arc of a circle or an ellipse: `center + cos(a)·u + sin(a)·v` for `a` from `start` over `sweep`.
    Arc {
        /// Centre, mm.
        center: FlatPoint,
        /// Half axis at angle 0, mm; any conjugate half diameter is allowed.
        u: Vector2<f64>,
        /// Half axis at angle π/2, mm.
        v: Vector2<f64>,
        /// Start angle, rad.
        start: f64,
        /// Signed angle from start to end, rad.
        sweep: f64,
    },
    /// A Bézier curve of degree 3, rational where a weight differs from 1.
    Bezier {
        /// Control points, mm.
        points: [FlatPoint; 4],
        /// Weights, all positive.
        weights: [f64; 4],
    },
}

impl Segment {
    /// The point at parameter `t`, 0 to 1, mm.
    pub fn point(&self, t: f64) -> FlatPoint {
        match self {
            Self::Line { from, to } => from.lerp(*to, t),
            Self::Arc { center, u, v, start, sweep } => {
                let (sin, cos) = (start + sweep * t).sin_cos();
                *center + u * cos + v * sin
            }
            Self::Bezier { points, weights } => {
                let s = 1.0 - t;
                let bernstein = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
                let mut sum = Vector2::zeros();
                let mut weight = 0.0;
                for ((point, w), b) in points.iter().zip(weights).zip(bernstein) {
                    sum += point.coords() * (w * b);
                    weight += w * b;
                }
                (sum / weight).into()
            }
        }
    }

    /// Where the segment starts, mm; exact to the bit for lines and Bézier curves.
    pub fn start(&self) -> FlatPoint {
        match self {
            Self::Bezier { points, .. } => points[0],
            other => other.point(0.0),
        }
    }

    /// Where the segment ends, mm; exact to the bit for lines and Bézier curves.
    pub fn end(&self) -> FlatPoint {
        match self {
            Self::Line { to, .. } => *to,
            Self::Bezier { points, .. } => points[3],
            other => other.point(1.0),
        }
    }

    /// The segment in the opposite direction.
    pub fn reversed(&self) -> Self {
        match self {
            Self::Line { from, to } => Self::Line { from: *to, to: *from },
            Self::Arc { center, u, v, start, sweep } => {
                Self::Arc { center: *center, u: *u, v: *v, start: start + sweep, sweep: -sweep }
            }
            Self::Bezier { points: [a, b, c, d], weights: [wa, wb, wc, wd] } => {
                Self::Bezier { points: [*d, *c, *b, *a], weights: [*wd, *wc, *wb, *wa] }
            }
        }
    }

    /// The piece from parameter `from` to `to`, both 0 to 1.
    pub fn section(&self, from: f64, to: f64) -> Self {
        match self {
            Self::Line { .. } => Self::Line { from: self.point(from), to: self.point(to) },
            Self::Arc { center, u, v, start, sweep } => Self::Arc {
                center: *center,
                u: *u,
                v: *v,
                start: start + sweep * from,
                sweep: sweep * (to - from),
            },
            Self::Bezier { points, weights } => {
                let controls: [nalgebra::Vector3<f64>; 4] =
                    std::array::from_fn(|index| points[index].coords().push(1.0) * weights[index]);
                // The polar form of the curve: its value for three parameters (Farin, Curves and Surfaces, section 4.4).
                let polar = |parameters: [f64; 3]| {
                    let mut row = controls.to_vec();
                    for t in parameters {
                        row = row.windows(2).map(|pair| pair[0].lerp(&pair[1], t)).collect();
                    }
                    row[0]
                };
                let cut = [[from; 3], [from, from, to], [from, to, to], [to; 3]].map(polar);
                Self::Bezier {
                    points: cut.map(|point| (point.xy() / point.z).into()),
                    weights: cut.map(|point| point.z),
                }
            }
        }
    }

    /// The image under an affine map.
    pub fn transformed(&self, map: &Affine) -> Self {
        match self {
            Self::Line { from, to } => Self::Line { from: map.point(*from), to: map.point(*to) },
            Self::Arc { center, u, v, start, sweep } => Self::Arc {
                center: map.point(*center),
                u: map.linear * u,
                v: map.linear * v,
                start: *start,
                sweep: *sweep,
            },
            Self::Bezier { points, weights } => {
                Self::Bezier { points: points.map(|point| map.point(point)), weights: *weights }
            }
        }
    }

    /// The bounding rectangle of the segment, mm: exact, except for rational Bézier curves, where it is accurate to
    /// 1e-6 of their size.
    pub fn extents(&self) -> Extents {
        let mut extents = Extents::of([self.start().coords(), self.end().coords()]);
        match self {
            Self::Line { .. } => {}
            Self::Arc { u, v, start, sweep, .. } => {
                for axis in 0..2 {
                    // Along an axis, u·cos + v·sin has an extremum once every half turn.
                    let turn = v[axis].atan2(u[axis]);
                    for half in 0..2 {
                        let angle = turn + std::f64::consts::PI * f64::from(half);
                        let along = ((angle - start) * sweep.signum()).rem_euclid(std::f64::consts::TAU);
                        if along < sweep.abs() {
                            extents.include(self.point(along / sweep.abs()).coords());
                        }
                    }
                }
            }
            Self::Bezier { points, weights: [a, b, c, d] } if a == b && b == c && c == d => {
                for axis in 0..2 {
                    let [a, b, c, d] = points.map(|point| point.coords()[axis]);
                    for t in roots([b - a, c - b, d - c]) {
                        extents.include(self.point(t).coords());
                    }
                }
            }
            Self::Bezier { .. } => {
                let steps = 64;
                let size = |t: f64, axis: usize| self.point(t).coords()[axis];
                for axis in 0..2 {
                    for sign in [1.0, -1.0] {
                        let at = |step: i32| f64::from(step) / f64::from(steps);
                        let mut best = 0.0;
                        for step in 1..=steps {
                            if sign * size(at(step), axis) > sign * size(best, axis) {
                                best = at(step);
                            }
                        }
                        // Near a maximum the curve is flat: ternary search over the two neighbouring steps.
                        let (mut low, mut high) = ((best - at(1)).max(0.0), (best + at(1)).min(1.0));
                        for _ in 0..24 {
                            let (left, right) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
                            if sign * size(left, axis) < sign * size(right, axis) {
                                low = left;
                            } else {
                                high = right;
                            }
                        }
                        extents.include(self.point((low + high) / 2.0).coords());
                    }
                }
            }
        }
        extents
    }

    /// A bound on the distance between the curve and its chords when it is cut into `pieces` equal parameter steps,
    /// mm: the second-difference bound for polynomial pieces, the sagitta for arcs. Rational pieces are measured.
    fn chord_error(&self, pieces: usize) -> f64 {
        let pieces = pieces as f64;
        match self {
            Self::Line { .. } => 0.0,
            Self::Arc { u, v, sweep, .. } => {
                // An upper bound of the largest half axis of the ellipse with the conjugate half diameters u and v.
                let radius = (u.norm_squared().max(v.norm_squared()) + u.dot(v).abs()).sqrt();
                let half = (sweep.abs() / pieces / 2.0).min(std::f64::consts::PI);
                radius * (1.0 - half.cos())
            }
            Self::Bezier { points, weights } => {
                let [a, b, c, d] = points.map(FlatPoint::coords);
                let bend = (a - b * 2.0 + c).norm().max((b - c * 2.0 + d).norm());
                let largest = weights.iter().copied().fold(0.0, f64::max);
                let smallest = weights.iter().copied().fold(f64::INFINITY, f64::min);
                // Wang's formula: d(d-1)/8 · max second difference / n², with a margin for uneven weights.
                0.75 * bend * (largest / smallest).powi(2) / (pieces * pieces)
            }
        }
    }

    /// Number of equal parameter steps for which the chords stay within `tolerance` mm of the curve (at most 65,536).
    pub fn steps(&self, tolerance: f64) -> usize {
        let mut pieces = match self {
            Self::Line { .. } => return 1,
            // The chords of a closed arc in fewer than four pieces would fold onto each other.
            Self::Arc { sweep, .. } => {
                (sweep.abs() / std::f64::consts::FRAC_PI_2).ceil().clamp(1.0, 64.0) as usize
            }
            Self::Bezier { .. } => 1,
        };
        while self.chord_error(pieces) > tolerance && pieces < 65_536 {
            pieces *= 2;
        }
        pieces
    }
}

/// The roots between 0 and 1 of the quadratic Bézier polynomial with these coefficients.
fn roots([a, b, c]: [f64; 3]) -> impl Iterator<Item = f64> {
    let (square, half) = (a - 2.0 * b + c, b - a);
    let root = (half * half - square * a).max(0.0).sqrt();
    // The form of the roots that avoids cancellation (Press et al., Numerical Recipes, section 5.6).
    let sum = -(half + root.copysign(half));
    [sum / square, a / sum].into_iter().filter(|t| (0.0..=1.0).contains(t))
}

/// An affine map of the drawing plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine {
    /// The linear part, without unit.
    pub linear: nalgebra::Matrix2<f64>,
    /// The image of the origin, mm.
    pub offset: Vector2<f64>,
}

impl Affine {
    /// The image of a point.
    pub fn point(&self, point: FlatPoint) -> FlatPoint {
        (self.linear * point.coords() + self.offset).into()
    }

    /// The map that applies `inner` first, then this one.
    #[must_use]
    pub fn after(&self, inner: &Self) -> Self {
        Self { linear: self.linear * inner.linear, offset: self.linear * inner.offset + self.offset }
    }

    /// The rigid motion that rotates by `angle` rad about `anchor` and then moves `anchor` to `target`.
    pub fn rigid(anchor: FlatPoint, angle: f64, target: FlatPoint) -> Self {
        let linear = *nalgebra::Rotation2::new(angle).matrix();
        Self { linear, offset: target.coords() - linear * anchor.coords() }
    }
}

impl Shape {
    /// The segments of a curve; empty for a dot.
    pub fn segments(&self) -> &[Segment] {
        match self {
            Self::Dot(_) => &[],
            Self::Open(segments) | Self::Closed(segments) => segments,
        }
    }

    /// The bounding rectangle, mm; see [`Segment::extents`].
    pub fn extents(&self) -> Extents {
        let mut extents = match self {
            Self::Dot(point) => Extents::of([point.coords()]),
            Self::Open(_) | Self::Closed(_) => Extents::EMPTY,
        };
        for Extents { min, max } in self.segments().iter().map(Segment::extents) {
            extents.include(min);
            extents.include(max);
        }
        extents
    }

    /// Whether the shape is a contour.
    pub fn is_closed(&self) -> bool {
        matches!(self, Self::Closed(_))
    }

    /// Points along the shape whose chords stay within `tolerance` mm of it; a contour's first point is not repeated.
    pub fn flattened(&self, tolerance: f64) -> Vec<FlatPoint> {
        let mut points = Vec::new();
        match self {
            Self::Dot(point) => points.push(*point),
            Self::Open(segments) | Self::Closed(segments) => {
                points.extend(segments.first().map(Segment::start));
                for segment in segments {
                    let steps = segment.steps(tolerance);
                    points.extend((1..steps).map(|step| segment.point(step as f64 / steps as f64)));
                    points.push(segment.end());
                }
                if self.is_closed() && points.len() > 1 {
                    points.pop();
                }
            }
        }
        points
    }
}

impl Path {
    /// Whether the path bounds an area: it is closed, or its two ends coincide, as when a program repeats the first
    /// point instead of closing the line. A stroke of a letter or a hatch pattern is always a line, even if its ends
    /// coincide.
    pub fn is_contour(&self) -> bool {
        match &self.shape {
            Shape::Dot(_) => false,
            Shape::Closed(_) => true,
            Shape::Open(segments) => match (segments.first(), segments.last()) {
                (Some(first), Some(last)) if !self.source.is_stroke => {
                    first.start().distance(last.end()) <= SAME_POINT
                }
                _ => false,
            },
        }
    }
}

impl Pattern {
    /// The bounding rectangle of everything drawn, to within 0.001 mm; empty for an empty drawing.
    pub fn extents(&self) -> Extents {
        Extents::of(self.paths.iter().flat_map(|path| path.shape.flattened(1e-3)).map(FlatPoint::coords))
    }

    /// The paths on layers for which `is_kept` is true, given the layer's name.
    #[must_use]
    pub fn with_layers(mut self, is_kept: impl Fn(&str) -> bool) -> Self {
        let kept: Vec<bool> = self.layers.iter().map(|layer| is_kept(&layer.name)).collect();
        self.paths.retain(|path| kept.get(path.layer).is_some_and(|kept| *kept));
        self
    }

    /// The image under an affine map.
    pub fn transformed(&self, map: &Affine) -> Self {
        let all = |segments: &[Segment]| segments.iter().map(|segment| segment.transformed(map)).collect();
        let paths = self.paths.iter().map(|path| Path {
            shape: match &path.shape {
                Shape::Dot(point) => Shape::Dot(map.point(*point)),
                Shape::Open(segments) => Shape::Open(all(segments)),
                Shape::Closed(segments) => Shape::Closed(all(segments)),
            },
            ..path.clone()
        });
        Self { layers: self.layers.clone(), paths: paths.collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_4, PI, TAU};

    fn circle(radius: f64) -> Segment {
        Segment::Arc {
            center: FlatPoint::new(1.0, 2.0),
            u: Vector2::new(radius, 0.0),
            v: Vector2::new(0.0, radius),
            start: 0.0,
            sweep: TAU,
        }
    }

    #[test]
    fn chords_stay_within_the_tolerance() {
        let shape = Shape::Closed(vec![circle(10.0)]);
        for tolerance in [0.1, 0.01, 0.001] {
            let points = shape.flattened(tolerance);
            let center = FlatPoint::new(1.0, 2.0);
            let ends = points.iter().zip(points.iter().cycle().skip(1));
            let worst = ends.map(|(a, b)| 10.0 - a.lerp(*b, 0.5).distance(center)).fold(0.0, f64::max);
            assert!(worst <= tolerance && worst > tolerance / 8.0, "{worst} of {tolerance}");
        }
    }

    #[test]
    fn a_quarter_circle_as_a_rational_bezier_lies_on_the_circle() {
        // Degree-raised from the quadratic with weights 1, cos 45°, 1 (The NURBS Book, eq. 7.33).
        let w = (1.0 + 2.0 * FRAC_PI_4.cos()) / 3.0;
        let a = 2.0 * (0.5f64).sqrt() / 3.0 / w;
        let points = [[1.0, 0.0], [1.0 / 3.0 / w + a, a], [a, 1.0 / 3.0 / w + a], [0.0, 1.0]]
            .map(|[x, y]| FlatPoint::new(x, y));
        let quarter = Segment::Bezier { points, weights: [1.0, w, w, 1.0] };
        for step in 0..=10 {
            assert!((quarter.point(f64::from(step) / 10.0).coords().norm() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn extents_touch_the_outermost_points() {
        let close = |extents: Extents, expected: [f64; 4]| {
            let found = [extents.min.x, extents.min.y, extents.max.x, extents.max.y];
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
        };
        close(circle(5.0).extents(), [-4.0, -3.0, 6.0, 7.0]);
        let (center, u, v) = (FlatPoint::new(0.0, 0.0), Vector2::new(2.0, 0.0), Vector2::new(0.0, 1.0));
        let upper = Segment::Arc { center, u, v, start: PI, sweep: -PI };
        close(upper.extents(), [-2.0, 0.0, 2.0, 1.0]);
        // y = 3·4·t(1 − t) has its maximum, 3, in the middle.
        let points = [[0.0, 0.0], [1.0, 4.0], [2.0, 4.0], [3.0, 0.0]].map(|[x, y]| FlatPoint::new(x, y));
        close(Segment::Bezier { points, weights: [1.0; 4] }.extents(), [0.0, 0.0, 3.0, 3.0]);
        // x = t (1 - t) (1 - 2 t) has extrema ±√3/18 at t = 1/2 ± √3/6; slightly different weights hardly change them.
        let points =
            [[0.0, 0.0], [1.0 / 3.0, 1.0], [-1.0 / 3.0, 2.0], [0.0, 3.0]].map(|[x, y]| FlatPoint::new(x, y));
        let turn = 3.0f64.sqrt() / 18.0;
        for weights in [[1.0; 4], [1.0, 1.0, 1.0, 1.0 + 1e-12]] {
            close(Segment::Bezier { points, weights }.extents(), [-turn, 0.0, turn, 3.0]);
        }
    }

    #[test]
    fn affine_maps_and_reversal_commute_with_evaluation() {
        let map =
            Affine { linear: nalgebra::Matrix2::new(2.0, 0.5, -0.3, -1.0), offset: Vector2::new(3.0, -4.0) };
        let arc = circle(5.0);
        for t in [0.0, 0.2, 0.7, 1.0] {
            assert!(arc.transformed(&map).point(t).distance(map.point(arc.point(t))) < 1e-12);
            assert!(arc.reversed().point(t).distance(arc.point(1.0 - t)) < 1e-12);
        }
    }

    #[test]
    fn a_rigid_motion_moves_the_anchor_to_its_target() {
        let anchor = FlatPoint::new(3.0, 1.0);
        let map = Affine::rigid(anchor, PI / 3.0, FlatPoint::new(-7.0, 2.0));
        assert!(map.point(anchor).distance(FlatPoint::new(-7.0, 2.0)) < 1e-12);
        let right = map.point(FlatPoint::new(4.0, 1.0)) - map.point(anchor);
        assert!((right.y.atan2(right.x) - PI / 3.0).abs() < 1e-12);
    }
}
