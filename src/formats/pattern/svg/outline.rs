//! Path data and basic shapes as curves, in the units of their element (SVG 1.1, chapters 8 and 9).

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::Vector2;
use svgtypes::{NumberListParser, PathParser, PathSegment};

use crate::geometry::pattern::{Segment, Shape};
use crate::geometry::space::FlatPoint;

/// Collects the curves of a path.
#[derive(Default)]
struct Pen {
    done: Vec<Shape>,
    current: Vec<Segment>,
    start: Option<FlatPoint>,
    at: FlatPointOrOrigin,
    /// Whether something was drawn since the last move, even without length.
    drew: bool,
}

/// The current point, the origin at first.
struct FlatPointOrOrigin(FlatPoint);

impl Default for FlatPointOrOrigin {
    fn default() -> Self {
        Self(FlatPoint::new(0.0, 0.0))
    }
}

impl Pen {
    fn move_to(&mut self, to: FlatPoint) {
        self.finish(false);
        (self.start, self.at.0) = (Some(to), to);
    }

    fn push(&mut self, segment: Segment, to: FlatPoint) {
        self.drew = true;
        self.start.get_or_insert(self.at.0);
        self.at.0 = to;
        self.current.push(segment);
    }

    fn line_to(&mut self, to: FlatPoint) {
        if to == self.at.0 {
            self.drew = true;
            self.start.get_or_insert(to);
            return;
        }
        self.push(Segment::Line { from: self.at.0, to }, to);
    }

    fn cubic_to(&mut self, b: FlatPoint, c: FlatPoint, to: FlatPoint) {
        let points = [self.at.0, b, c, to];
        if points.iter().all(|point| *point == to) {
            return self.line_to(to);
        }
        self.push(Segment::Bezier { points, weights: [1.0; 4] }, to);
    }

    fn quadratic_to(&mut self, control: FlatPoint, to: FlatPoint) {
        // Raised to degree 3.
        let third = |end: FlatPoint| ((end.coords() + control.coords() * 2.0) / 3.0).into();
        self.cubic_to(third(self.at.0), third(to), to);
    }

    fn close(&mut self) {
        if let Some(start) = self.start {
            if self.at.0 != start {
                self.line_to(start);
            }
            self.drew = true;
            self.finish(true);
            self.at.0 = start;
        }
    }

    /// Ends the current curve. One without length is a dot, which only shows with round or square ends.
    fn finish(&mut self, closed: bool) {
        let segments = std::mem::take(&mut self.current);
        let start = self.start.take();
        match (segments.is_empty(), start) {
            (true, Some(start)) if self.drew => self.done.push(Shape::Dot(start)),
            (true, _) => {}
            (false, _) if closed => self.done.push(Shape::Closed(segments)),
            (false, _) => self.done.push(Shape::Open(segments)),
        }
        self.drew = false;
    }
}

/// The curves of path data, and whether it could be read to its end.
pub(super) fn path(data: &str) -> (Vec<Shape>, Result<(), String>) {
    let mut pen = Pen::default();
    // The last control point, for the commands that continue a curve smoothly.
    let (mut cubic, mut quadratic): (Option<FlatPoint>, Option<FlatPoint>) = (None, None);
    for segment in PathParser::from(data) {
        let segment = match segment {
            Ok(segment) => segment,
            Err(error) => {
                pen.finish(false);
                return (pen.done, Err(error.to_string()));
            }
        };
        let at = pen.at.0;
        let point = |abs: bool, x: f64, y: f64| match abs {
            true => FlatPoint::new(x, y),
            false => FlatPoint::new(at.x + x, at.y + y),
        };
        let mirrored = |control: Option<FlatPoint>| control.map_or(at, |control| at + (at - control));
        let (mut next_cubic, mut next_quadratic) = (None, None);
        match segment {
            PathSegment::MoveTo { abs, x, y } => pen.move_to(point(abs, x, y)),
            PathSegment::LineTo { abs, x, y } => pen.line_to(point(abs, x, y)),
            PathSegment::HorizontalLineTo { abs, x } => {
                pen.line_to(FlatPoint::new(if abs { x } else { at.x + x }, at.y));
            }
            PathSegment::VerticalLineTo { abs, y } => {
                pen.line_to(FlatPoint::new(at.x, if abs { y } else { at.y + y }));
            }
            PathSegment::CurveTo { abs, x1, y1, x2, y2, x, y } => {
                let (b, c) = (point(abs, x1, y1), point(abs, x2, y2));
                pen.cubic_to(b, c, point(abs, x, y));
                next_cubic = Some(c);
            }
            PathSegment::SmoothCurveTo { abs, x2, y2, x, y } => {
                let c = point(abs, x2, y2);
                pen.cubic_to(mirrored(cubic), c, point(abs, x, y));
                next_cubic = Some(c);
            }
            PathSegment::Quadratic { abs, x1, y1, x, y } => {
                let control = point(abs, x1, y1);
                pen.quadratic_to(control, point(abs, x, y));
                next_quadratic = Some(control);
            }
            PathSegment::SmoothQuadratic { abs, x, y } => {
                let control = mirrored(quadratic);
                pen.quadratic_to(control, point(abs, x, y));
                next_quadratic = Some(control);
            }
            PathSegment::EllipticalArc { abs, rx, ry, x_axis_rotation, large_arc, sweep, x, y } => {
                let to = point(abs, x, y);
                match arc(at, [rx, ry], x_axis_rotation.to_radians(), large_arc, sweep, to) {
                    Some(arc) => pen.push(arc, to),
                    None => pen.line_to(to),
                }
            }
            PathSegment::ClosePath { .. } => pen.close(),
        }
        (cubic, quadratic) = (next_cubic, next_quadratic);
    }
    pen.finish(false);
    (pen.done, Ok(()))
}

/// An elliptical arc by its ends (SVG 1.1, appendix F.6.5); `None` if it is a straight line.
fn arc(
    from: FlatPoint,
    radii: [f64; 2],
    rotation: f64,
    large: bool,
    positive: bool,
    to: FlatPoint,
) -> Option<Segment> {
    let [mut rx, mut ry] = radii.map(f64::abs);
    if from == to || rx == 0.0 || ry == 0.0 {
        return None;
    }
    let (sin, cos) = rotation.sin_cos();
    let half = (from - to) / 2.0;
    let x = cos * half.x + sin * half.y;
    let y = cos * half.y - sin * half.x;
    let reach = (x / rx).powi(2) + (y / ry).powi(2);
    if reach > 1.0 {
        (rx, ry) = (rx * reach.sqrt(), ry * reach.sqrt());
    }
    let square = (1.0 / reach.min(1.0) - 1.0).max(0.0);
    let factor = if large == positive { -square.sqrt() } else { square.sqrt() };
    let (cx, cy) = (factor * rx * y / ry, -factor * ry * x / rx);
    let middle = (from.coords() + to.coords()) / 2.0;
    let center = middle + Vector2::new(cos * cx - sin * cy, sin * cx + cos * cy);
    let angle = |sign: f64| ((sign * y - cy) / ry).atan2((sign * x - cx) / rx);
    let start = angle(1.0);
    let mut sweep = (angle(-1.0) - start).rem_euclid(TAU);
    if !positive {
        sweep -= TAU;
    }
    let (u, v) = (Vector2::new(cos, sin) * rx, Vector2::new(-sin, cos) * ry);
    Some(Segment::Arc { center: center.into(), u, v, start, sweep })
}

/// A circle or ellipse; `None` without size.
pub(super) fn ellipse(center: FlatPoint, rx: f64, ry: f64) -> Option<Shape> {
    let (u, v) = (Vector2::new(rx, 0.0), Vector2::new(0.0, ry));
    (rx > 0.0 && ry > 0.0).then(|| Shape::Closed(vec![Segment::Arc { center, u, v, start: 0.0, sweep: TAU }]))
}

/// A rectangle with round corners of the given radii, or sharp ones; `None` without size.
pub(super) fn rectangle(corner: FlatPoint, size: Vector2<f64>, radii: [f64; 2]) -> Option<Shape> {
    if !(size.x > 0.0 && size.y > 0.0) {
        return None;
    }
    let [rx, ry] = [radii[0].clamp(0.0, size.x / 2.0), radii[1].clamp(0.0, size.y / 2.0)];
    let round = rx > 0.0 && ry > 0.0;
    let mut segments = Vec::new();
    let at = |x: f64, y: f64| FlatPoint::new(corner.x + x, corner.y + y);
    let (w, h) = (size.x, size.y);
    let line = |from: FlatPoint, to: FlatPoint| Segment::Line { from, to };
    if !round {
        let corners = [at(0.0, 0.0), at(w, 0.0), at(w, h), at(0.0, h)];
        let ends = corners.iter().zip(corners.iter().cycle().skip(1));
        return Some(Shape::Closed(ends.map(|(from, to)| line(*from, *to)).collect()));
    }
    let (u, v) = (Vector2::new(rx, 0.0), Vector2::new(0.0, ry));
    // Each side with the corner at its end, from the top one on.
    let sides = [
        (at(rx, 0.0), at(w - rx, 0.0), at(w - rx, ry)),
        (at(w, ry), at(w, h - ry), at(w - rx, h - ry)),
        (at(w - rx, h), at(rx, h), at(rx, h - ry)),
        (at(0.0, h - ry), at(0.0, ry), at(rx, ry)),
    ];
    for (index, (from, to, center)) in sides.into_iter().enumerate() {
        if from.distance(to) > 0.0 {
            segments.push(line(from, to));
        }
        let start = -FRAC_PI_2 + FRAC_PI_2 * index as f64;
        segments.push(Segment::Arc { center, u, v, start, sweep: FRAC_PI_2 });
    }
    Some(Shape::Closed(segments))
}

/// The corners of a polyline or polygon, or why they cannot be read.
pub(super) fn polyline(points: &str, closed: bool) -> Result<Option<Shape>, String> {
    let mut pen = Pen::default();
    let numbers: Vec<f64> =
        NumberListParser::from(points).collect::<Result<_, _>>().map_err(|error| error.to_string())?;
    let (corners, []) = numbers.as_chunks::<2>() else {
        return Err("the last of them has no second coordinate".into());
    };
    for (index, [x, y]) in corners.iter().enumerate() {
        let point = FlatPoint::new(*x, *y);
        if index == 0 { pen.move_to(point) } else { pen.line_to(point) }
    }
    match closed {
        true => pen.close(),
        false => pen.finish(false),
    }
    Ok(pen.done.pop())
}

/// A straight line.
pub(super) fn line(from: FlatPoint, to: FlatPoint) -> Shape {
    if from == to { Shape::Dot(from) } else { Shape::Open(vec![Segment::Line { from, to }]) }
}
