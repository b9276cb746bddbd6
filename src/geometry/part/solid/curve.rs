//! The curves of edges and profiles.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Point3, Vector3, Vector4};

use super::bezier::{
    BezierCurve, SplineError, Weighted, check_knots, check_points, plain, span_points, spans,
};
use super::frame::Frame;

/// One span or one turn of a curve is divided into at most this many pieces.
const MAX_PIECES: usize = 16384;
/// A span of a spline is halved at most this many times.
const MAX_HALVINGS: u32 = 12;

/// A curve in space, mm.
#[derive(Debug, Clone, PartialEq)]
pub enum Curve {
    /// A line through a point along a unit direction; its parameter is a length, mm.
    Line(Point3<f64>, Vector3<f64>),
    /// An ellipse or circle in the xy plane of a frame, with its radii along x and y; its parameter is an angle, rad.
    Ellipse(Frame, f64, f64),
    /// A parabola in the xy plane of a frame, open along x, with its focal length.
    Parabola(Frame, f64),
    /// The branch of a hyperbola in the xy plane of a frame, open along x, with its semi-axes.
    Hyperbola(Frame, f64, f64),
    /// A spline.
    Spline(Spline),
    /// Straight pieces.
    Polyline(Vec<Point3<f64>>),
}

/// A rational spline as Bézier curves one after the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    /// The parameters at the ends of the curves: one more than curves.
    pub breaks: Vec<f64>,
    /// The curves.
    pub curves: Vec<BezierCurve>,
}

impl Spline {
    /// The spline of a degree with these knots, repeated as often as they are multiple, and control points.
    ///
    /// # Errors
    /// See [`SplineError`].
    pub fn new(degree: usize, knots: &[f64], points: &[Weighted]) -> Result<Self, SplineError> {
        check_knots(degree, knots, points.len())?;
        check_points(points)?;
        let spans = spans(degree, knots, points.len());
        let curve =
            |&span: &usize| BezierCurve { points: span_points(degree, knots, span, |index| points[index]) };
        let ends = spans.iter().map(|&span| knots[span]).chain([knots[points.len()]]);
        Ok(Self { breaks: ends.collect(), curves: spans.iter().map(curve).collect() })
    }

    /// The arc of a circle in the xy plane of a frame, between two angles, rad.
    pub fn arc(frame: &Frame, radius: f64, from: f64, to: f64) -> Self {
        Self::elliptic(frame, radius, radius, from, to)
    }

    fn elliptic(frame: &Frame, a: f64, b: f64, from: f64, to: f64) -> Self {
        let count = ((to - from) / FRAC_PI_2 - 1e-9).ceil().max(1.0);
        let angle = (to - from) / count;
        let weight = (angle / 2.0).cos();
        let at = |index: f64| from + angle * index;
        let curve = |index: f64| {
            let on = |t: f64| plain(frame.point(a * t.cos(), b * t.sin(), 0.0));
            let middle = at(index + 0.5);
            let corner = frame.point(a * middle.cos() / weight, b * middle.sin() / weight, 0.0);
            BezierCurve { points: vec![on(at(index)), plain(corner) * weight, on(at(index + 1.0))] }
        };
        let count = count as u32;
        let breaks = (0..=count).map(|index| at(f64::from(index))).collect();
        Self { breaks, curves: (0..count).map(|index| curve(f64::from(index))).collect() }
    }

    fn ends(&self) -> [f64; 2] {
        [self.breaks[0], self.breaks[self.curves.len()]]
    }

    fn local(&self, t: f64) -> (usize, f64) {
        let index = self.breaks.partition_point(|&start| start <= t).clamp(1, self.curves.len()) - 1;
        (index, (t - self.breaks[index]) / (self.breaks[index + 1] - self.breaks[index]))
    }

    /// The point at a parameter.
    pub fn point(&self, t: f64) -> Point3<f64> {
        let (index, local) = self.local(t);
        self.curves[index].point(local)
    }

    /// Whether it ends where it starts.
    pub(super) fn is_closed(&self) -> bool {
        let [start, end] = self.ends();
        let (first, last) = (self.point(start), self.point(end));
        (first - last).norm() <= 1e-6 * (1.0 + first.coords.norm())
    }

    /// The parameter of the point of the spline that is nearest to `at`.
    fn nearest(&self, at: &Point3<f64>) -> f64 {
        let mut starts: Vec<(f64, usize, f64)> = Vec::new();
        for (index, curve) in self.curves.iter().enumerate() {
            let pieces = 2 * curve.points.len() + 2;
            for piece in 0..=pieces {
                let t = piece as f64 / pieces as f64;
                starts.push(((curve.point(t) - at).norm_squared(), index, t));
            }
        }
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best = (f64::INFINITY, 0.0);
        for &(_, index, start) in starts.iter().take(4) {
            let curve = &self.curves[index];
            let mut t = start;
            for _ in 0..30 {
                let (point, slope) = curve.jet(t);
                let square = slope.norm_squared();
                if square == 0.0 {
                    break;
                }
                let next = (t + (at - point).dot(&slope) / square).clamp(0.0, 1.0);
                let step = (next - t).abs();
                t = next;
                if step < 1e-15 {
                    break;
                }
            }
            let distance = (curve.point(t) - at).norm();
            if distance < best.0 {
                let width = self.breaks[index + 1] - self.breaks[index];
                best = (distance, self.breaks[index] + t * width);
            }
        }
        best.1
    }
}

impl Curve {
    fn point(&self, t: f64) -> Point3<f64> {
        match self {
            Self::Line(point, direction) => point + direction * t,
            Self::Ellipse(frame, a, b) => frame.point(a * t.cos(), b * t.sin(), 0.0),
            Self::Parabola(frame, focal) => frame.point(focal * t * t, 2.0 * focal * t, 0.0),
            Self::Hyperbola(frame, a, b) => frame.point(a * t.cosh(), b * t.sinh(), 0.0),
            Self::Spline(spline) => spline.point(t),
            Self::Polyline(points) => {
                let index = (t.max(0.0) as usize).min(points.len().saturating_sub(2));
                let next = points.get(index + 1).unwrap_or(&points[index]);
                points[index] + (next - points[index]) * (t - index as f64)
            }
        }
    }

    fn parameter(&self, at: &Point3<f64>) -> f64 {
        match self {
            Self::Line(point, direction) => (at - point).dot(direction),
            Self::Ellipse(frame, a, b) => {
                let local = frame.local(at);
                (local.y / b).atan2(local.x / a)
            }
            Self::Parabola(frame, focal) => frame.local(at).y / (2.0 * focal),
            Self::Hyperbola(frame, _, b) => (frame.local(at).y / b).asinh(),
            Self::Spline(spline) => spline.nearest(at),
            Self::Polyline(points) => {
                let mut best = (f64::INFINITY, 0.0);
                for (index, pair) in points.windows(2).enumerate() {
                    let along = pair[1] - pair[0];
                    let square = along.norm_squared();
                    let t = if square > 0.0 {
                        ((at - pair[0]).dot(&along) / square).clamp(0.0, 1.0)
                    } else {
                        0.0
                    };
                    let distance = (pair[0] + along * t - at).norm();
                    if distance < best.0 {
                        best = (distance, index as f64 + t);
                    }
                }
                best.1
            }
        }
    }

    /// After how much of its parameter the curve is at the same point again.
    fn period(&self) -> Option<f64> {
        match self {
            Self::Ellipse(..) => Some(TAU),
            Self::Spline(spline) if spline.is_closed() => Some(spline.ends()[1] - spline.ends()[0]),
            Self::Polyline(points) => {
                let closed = points.first().zip(points.last()).is_some_and(|(a, b)| (a - b).norm() < 1e-9);
                closed.then(|| (points.len() - 1) as f64)
            }
            _ => None,
        }
    }

    /// Points along the curve from `start` to `end`, which are the first and the last of them; no chord is farther from the
    /// curve than `tolerance`, mm. `forward` is whether the way has the direction of the curve.
    pub fn between(
        &self,
        start: Point3<f64>,
        end: Point3<f64>,
        forward: bool,
        tolerance: f64,
    ) -> Vec<Point3<f64>> {
        if let Self::Line(..) = self {
            return vec![start, end];
        }
        let (first, last) = if forward { (start, end) } else { (end, start) };
        let (from, mut to) = (self.parameter(&first), self.parameter(&last));
        if let Some(period) = self.period() {
            let near = 1e-9 * period;
            let same = (start - end).norm() < 1e-9;
            if same || to < from - near {
                to += if same { period - (to - from) } else { period };
            }
        }
        let mut points = vec![first];
        let mut inner = self.inner_parameters(from, to, tolerance);
        inner.retain(|t| *t > from.min(to) && *t < from.max(to));
        let wrap = |t: f64| match (self, self.period()) {
            (Self::Spline(spline), Some(period)) if t > spline.ends()[1] => t - period,
            (Self::Polyline(_), Some(period)) if t > period => t - period,
            _ => t,
        };
        points.extend(inner.into_iter().map(|t| self.point(wrap(t))));
        points.push(last);
        if !forward {
            points.reverse();
        }
        points
    }

    fn inner_parameters(&self, from: f64, to: f64, tolerance: f64) -> Vec<f64> {
        let even = |count: usize| -> Vec<f64> {
            let count = count.clamp(1, MAX_PIECES);
            (1..count).map(|index| from + (to - from) * index as f64 / count as f64).collect()
        };
        match self {
            Self::Line(..) => Vec::new(),
            Self::Ellipse(_, a, b) => {
                let angle = chord_angle(a.abs().max(b.abs()), tolerance);
                even(((to - from).abs() / angle).ceil() as usize)
            }
            // The second derivative is constant for a parabola, and bounded by the ends for a hyperbola.
            Self::Parabola(_, focal) => {
                even(((to - from).abs() * (focal / (4.0 * tolerance)).sqrt()).ceil() as usize)
            }
            Self::Hyperbola(_, a, b) => {
                let bend = a.hypot(*b) * from.abs().max(to.abs()).cosh();
                even(((to - from).abs() * (bend / (8.0 * tolerance)).sqrt()).ceil() as usize)
            }
            Self::Polyline(_) => {
                let (low, high) = (from.min(to), from.max(to));
                let count = (high - low).clamp(0.0, 1e7) as usize + 2;
                (0..count).map(|index| low.floor() + index as f64).filter(|t| *t > low && *t < high).collect()
            }
            Self::Spline(spline) => {
                let [first, last] = spline.ends();
                let period = last - first;
                let mut found = Vec::new();
                for turn in [-1.0, 0.0, 1.0] {
                    for (index, pair) in spline.breaks.windows(2).enumerate() {
                        let (low, high) = (pair[0] + turn * period, pair[1] + turn * period);
                        let (start, end) = (low.max(from), high.min(to));
                        if start >= end {
                            continue;
                        }
                        let width = pair[1] - pair[0];
                        let local = |t: f64| (t - low) / width;
                        if start > from {
                            found.push(start);
                        }
                        let curve = &spline.curves[index];
                        let mut inner = Vec::new();
                        halve(curve, [local(start), local(end)], tolerance, 0, &mut inner);
                        found.extend(inner.into_iter().map(|t| low + t * width));
                    }
                }
                found
            }
        }
    }

    /// The whole curve as Bézier curves, for a profile of a swept surface; lines and parabolas reach `reach` mm from their
    /// points. `None` for a hyperbola and for a polyline without length.
    pub fn as_spline(&self, reach: f64) -> Option<Spline> {
        match self {
            Self::Line(point, direction) => {
                let ends = [point - direction * reach, point + direction * reach];
                let points = ends.map(plain).to_vec();
                Some(Spline { breaks: vec![-reach, reach], curves: vec![BezierCurve { points }] })
            }
            Self::Ellipse(frame, a, b) => Some(Spline::elliptic(frame, *a, *b, 0.0, TAU)),
            Self::Parabola(frame, focal) => {
                let t = (reach / focal).sqrt().max(reach / (2.0 * focal)).min(1e4);
                let points = vec![
                    plain(self.point(-t)),
                    plain(frame.point(-focal * t * t, 0.0, 0.0)),
                    plain(self.point(t)),
                ];
                Some(Spline { breaks: vec![-t, t], curves: vec![BezierCurve { points }] })
            }
            Self::Hyperbola(..) => None,
            Self::Spline(spline) => Some(spline.clone()),
            Self::Polyline(points) => {
                let curves: Vec<BezierCurve> = points
                    .windows(2)
                    .filter(|pair| pair[0] != pair[1])
                    .map(|pair| BezierCurve { points: vec![plain(pair[0]), plain(pair[1])] })
                    .collect();
                (!curves.is_empty()).then(|| Spline {
                    breaks: (0..=curves.len()).map(|index| index as f64).collect(),
                    curves,
                })
            }
        }
    }
}

/// The angle of an arc of this radius whose chord is `tolerance` from it, rad; at most 0.5 rad.
pub(super) fn chord_angle(radius: f64, tolerance: f64) -> f64 {
    (2.0 * (1.0 - (tolerance / radius.max(1e-9)).min(1.0)).acos()).clamp(TAU / MAX_PIECES as f64, 0.5)
}

fn halve(curve: &BezierCurve, [from, to]: [f64; 2], tolerance: f64, depth: u32, found: &mut Vec<f64>) {
    let at = |share: f64| curve.point(from + (to - from) * share);
    let (start, end) = (at(0.0), at(1.0));
    let along = end - start;
    let away = |share: f64| {
        let from_start = at(share) - start;
        let length = along.norm_squared();
        let foot = if length > 0.0 {
            along * (from_start.dot(&along) / length).clamp(0.0, 1.0)
        } else {
            Vector3::zeros()
        };
        (from_start - foot).norm()
    };
    let straight = curve.points.len() == 2 && curve.points[0].w == curve.points[1].w;
    if straight
        || depth >= MAX_HALVINGS
        || (depth > 0 && [0.25, 0.5, 0.75].iter().all(|&share| away(share) < tolerance))
    {
        return;
    }
    let middle = (from + to) / 2.0;
    halve(curve, [from, middle], tolerance, depth + 1, found);
    found.push(middle);
    halve(curve, [middle, to], tolerance, depth + 1, found);
}

/// The weighted point with these coordinates.
pub fn weighted(point: Point3<f64>, weight: f64) -> Weighted {
    Vector4::new(point.x * weight, point.y * weight, point.z * weight, weight)
}
