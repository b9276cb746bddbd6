//! The areas of strokes (SVG 2, section 13.5): the outlines of lines with joins and ends.
//!
//! An outline is filled by the nonzero rule, as programs that show SVG do. At the inner side of a corner it goes through the corner: it
//! would otherwise run backwards at a short leg, which leaves notches and holes.

use std::f64::consts::{FRAC_PI_4, PI, TAU};

use i_overlay::core::fill_rule::FillRule;
use kurbo::{Cap, Join};
use nalgebra::Vector2;

use super::super::budget::Budget;
use super::area::{self, Polygons, STEPS_OF_CORNER, Unworkable};
use crate::geometry::pattern::{Affine, Segment, Shape};
use crate::geometry::space::FlatPoint;

/// What draws a line, in the units of its element.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pen {
    pub(super) width: f64,
    pub(super) cap: Cap,
    pub(super) join: Join,
    pub(super) miter_limit: f64,
}

/// Largest angle between the directions of neighbouring places on a curve, as cosine: 30°.
const BEND: f64 = 0.866;
/// Larger angles between neighbouring places on a curve are cusps; as cosine: 75°.
const CUSP: f64 = 0.259;
/// How often a curve is halved at most.
const MAX_HALVINGS: usize = 12;
/// Largest number of corners of an arc.
const MAX_CORNERS: f64 = 65_536.0;

/// The area of strokes along the shapes, mm. The shapes, the pen and `tolerance` are in the units of an element, which `to_mm` maps to mm.
pub(super) fn band(
    shapes: &[Shape],
    pen: &Pen,
    to_mm: &Affine,
    tolerance: f64,
    budget: &mut Budget,
) -> Result<Polygons, Unworkable> {
    match united(shapes, pen, to_mm, tolerance, true, budget) {
        // Corners that are much nearer to each other than the line is wide make too many crossings.
        Err(Unworkable::Exceeded) => united(shapes, pen, to_mm, tolerance, false, budget),
        other => other,
    }
}

fn united(
    shapes: &[Shape],
    pen: &Pen,
    to_mm: &Affine,
    tolerance: f64,
    through_corners: bool,
    budget: &mut Budget,
) -> Result<Polygons, Unworkable> {
    let mut band = Band {
        pen,
        half: pen.width / 2.0,
        to_mm,
        through_corners,
        tolerance: tolerance / 2.0,
        least: tolerance * area::ROUNDING_SHARE,
        outlines: Vec::new(),
        budget,
    };
    for shape in shapes {
        band.add(shape)?;
    }
    let Band { outlines, budget, .. } = band;
    area::united(&outlines, FillRule::NonZero, budget)
}

/// A place on a line, with the direction there.
#[derive(Debug, Clone, Copy)]
struct Place {
    at: FlatPoint,
    along: Vector2<f64>,
}

impl Place {
    /// The point beside the place at this distance, to the left if it is positive.
    fn beside(&self, distance: f64) -> FlatPoint {
        self.at + Vector2::new(-self.along.y, self.along.x) * distance
    }
}

/// The two sides of a line, both in its direction.
#[derive(Default)]
struct Sides {
    left: Vec<FlatPoint>,
    right: Vec<FlatPoint>,
}

/// A band in the making.
struct Band<'b> {
    pen: &'b Pen,
    half: f64,
    to_mm: &'b Affine,
    /// Whether outlines go through the corners of lines.
    through_corners: bool,
    /// Largest distance of the outline from what it replaces.
    tolerance: f64,
    /// Nearer points are the same.
    least: f64,
    /// In mm; all have the same orientation.
    outlines: Polygons,
    budget: &'b mut Budget,
}

impl Band<'_> {
    fn add(&mut self, shape: &Shape) -> Result<(), Unworkable> {
        let mut lines: Vec<Vec<Place>> = Vec::new();
        for segment in shape.segments() {
            let mut line = self.places(segment)?;
            // What has no length has no direction.
            let Some(first) = line.first_mut() else { continue };
            if let Some(before) = lines.last().and_then(|line| line.last()) {
                first.at = before.at;
            }
            lines.push(line);
        }
        let Some(begin) = lines.first().and_then(|line| line.first()).copied() else {
            return self.dot(shape);
        };
        if let (true, Some(end)) = (shape.is_closed(), lines.last_mut().and_then(|line| line.last_mut())) {
            end.at = begin.at;
        }
        let mut sides = Sides::default();
        let mut before: Option<Place> = None;
        for line in &lines {
            if let (Some(before), Some(first)) = (&before, line.first()) {
                self.join(&mut sides, before, first);
            }
            for (index, place) in line.iter().enumerate() {
                sides.left.push(place.beside(self.half));
                sides.right.push(place.beside(-self.half));
                if index > 0 && line[index - 1].along.dot(&place.along) < CUSP {
                    self.disc(place.at)?;
                }
            }
            before = line.last().copied();
        }
        let Some(end) = before else { return Ok(()) };
        if shape.is_closed() {
            self.join(&mut sides, &end, &begin);
            let Sides { left, mut right } = sides;
            right.reverse();
            self.push(&left)?;
            return self.push(&right);
        }
        let mut outline = sides.left;
        self.cap(&mut outline, &end);
        outline.extend(sides.right.into_iter().rev());
        self.cap(&mut outline, &Place { at: begin.at, along: -begin.along });
        self.push(&outline)
    }

    /// Places along a segment, near enough to each other for the outline of its band; none if it has no length.
    fn places(&mut self, segment: &Segment) -> Result<Vec<Place>, Unworkable> {
        let (from, to) = (segment.start(), segment.end());
        let reach = match segment {
            Segment::Line { .. } => from.distance(to),
            Segment::Bezier { points, .. } => {
                points.iter().map(|point| point.distance(from)).fold(0.0, f64::max)
            }
            Segment::Arc { u, v, sweep, .. } => (u.norm() + v.norm()) * sweep.abs(),
        };
        // Also rejects what is no number.
        if !(reach > self.least) {
            return Ok(Vec::new());
        }
        let place = |t: f64| Some(Place { at: segment.point(t), along: direction(segment, t, reach)? });
        let (Some(first), Some(last)) = (place(0.0), place(1.0)) else { return Ok(Vec::new()) };
        let first_steps = match segment {
            Segment::Line { .. } => 1,
            Segment::Bezier { .. } => 4,
            Segment::Arc { sweep, .. } => (sweep.abs() / FRAC_PI_4).ceil().clamp(1.0, 64.0) as usize,
        };
        let mut places = vec![Place { at: from, ..first }];
        let mut before = (0.0, first);
        for step in 1..=first_steps {
            let t = step as f64 / first_steps as f64;
            let Some(at) = (if step == first_steps { Some(last) } else { place(t) }) else { continue };
            // Sections that are still to do, the next one last.
            let mut open = vec![(t, at, MAX_HALVINGS)];
            while let Some((t, at, halvings)) = open.pop() {
                let inside = [0.25, 0.5, 0.75].map(|share| {
                    let t = before.0 + (t - before.0) * share;
                    (t, place(t))
                });
                let is_near = inside
                    .iter()
                    .all(|(_, inside)| inside.is_none_or(|inside| self.is_near(&inside, &before.1, &at)));
                match inside[1] {
                    (middle, Some(inside)) if !is_near && halvings > 0 => {
                        open.push((t, at, halvings - 1));
                        open.push((middle, inside, halvings - 1));
                    }
                    _ => {
                        places.push(at);
                        before = (t, at);
                    }
                }
            }
        }
        if let Some(last) = places.last_mut() {
            last.at = to;
        }
        self.budget.work(places.len() * STEPS_OF_CORNER)?;
        Ok(places)
    }

    /// Whether both sides of a line at a place are near the chords of the sides between its neighbours.
    fn is_near(&self, place: &Place, from: &Place, to: &Place) -> bool {
        let bends_little = |one: &Place| one.along.dot(&place.along) > BEND;
        let is_side_near = |side: f64| {
            let (start, end, point) = (from.beside(side), to.beside(side), place.beside(side));
            let chord = end - start;
            let share =
                if chord.norm() > 0.0 { (point - start).dot(&chord) / chord.norm_squared() } else { 0.0 };
            point.distance(start + chord * share.clamp(0.0, 1.0)) <= self.tolerance
        };
        bends_little(from) && bends_little(to) && is_side_near(self.half) && is_side_near(-self.half)
    }

    /// Adds the corner between two lines.
    fn join(&self, sides: &mut Sides, from: &Place, to: &Place) {
        // Without a negative zero, a line that turns back turns to the left.
        let (cross, dot) = (from.along.perp(&to.along) + 0.0, from.along.dot(&to.along));
        let (outer, inner, side) = match cross >= 0.0 {
            true => (&mut sides.right, &mut sides.left, -self.half),
            false => (&mut sides.left, &mut sides.right, self.half),
        };
        let (start, end) = (from.beside(side), to.beside(side));
        if start.distance(end) <= self.least {
            return;
        }
        let radius = start - from.at;
        match self.pen.join {
            Join::Round => self.turn(outer, from.at, radius, cross.atan2(dot)),
            // The square of the width divided by the length of the mitre.
            Join::Miter if (1.0 + dot) / 2.0 * self.pen.miter_limit.powi(2) >= 1.0 => {
                outer.push(from.at + (radius + (end - to.at)) / (1.0 + dot));
            }
            _ => {}
        }
        if self.through_corners && start.distance(end) > self.tolerance {
            inner.push(from.at);
        }
    }

    /// Adds the end of a line, from its left to its right side.
    fn cap(&self, outline: &mut Vec<FlatPoint>, end: &Place) {
        let left = end.beside(self.half);
        match self.pen.cap {
            Cap::Butt => {}
            Cap::Square => {
                outline.extend([left, end.beside(-self.half)].map(|side| side + end.along * self.half));
            }
            Cap::Round => self.turn(outline, end.at, left - end.at, -PI),
        }
    }

    /// A line without length shows only its ends.
    fn dot(&mut self, shape: &Shape) -> Result<(), Unworkable> {
        let at = match shape {
            Shape::Dot(at) => *at,
            _ => match shape.segments().first() {
                Some(segment) => segment.start(),
                None => return Ok(()),
            },
        };
        let corner = |x: f64, y: f64| at + Vector2::new(x, y) * self.half;
        match self.pen.cap {
            Cap::Butt => Ok(()),
            Cap::Square => {
                let corners = [corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0)];
                self.push(&corners)
            }
            Cap::Round => self.disc(at),
        }
    }

    /// A disc with the orientation of the outlines.
    fn disc(&mut self, center: FlatPoint) -> Result<(), Unworkable> {
        let radius = Vector2::new(self.half, 0.0);
        let mut outline = vec![center + radius];
        self.turn(&mut outline, center, radius, -TAU);
        self.push(&outline)
    }

    /// Adds the corners between the ends of an arc that begins at `center + radius`.
    fn turn(&self, outline: &mut Vec<FlatPoint>, center: FlatPoint, radius: Vector2<f64>, angle: f64) {
        let step = (2.0 * (1.0 - self.tolerance / self.half).clamp(0.0, 1.0).acos()).min(FRAC_PI_4);
        let corners = (angle.abs() / step).ceil().clamp(1.0, MAX_CORNERS);
        for corner in 1..corners as usize {
            let (sin, cos) = (angle * corner as f64 / corners).sin_cos();
            outline.push(center + radius * cos + Vector2::new(-radius.y, radius.x) * sin);
        }
    }

    fn push(&mut self, outline: &[FlatPoint]) -> Result<(), Unworkable> {
        self.budget.work(outline.len() * STEPS_OF_CORNER)?;
        let in_mm = outline.iter().map(|point| self.to_mm.point(*point));
        self.outlines.push(in_mm.map(|point| [point.x, point.y]).collect());
        Ok(())
    }
}

/// The direction of a segment at a parameter; none if it has no length. `reach` is its size.
fn direction(segment: &Segment, t: f64, reach: f64) -> Option<Vector2<f64>> {
    let derivative = match segment {
        Segment::Line { from, to } => *to - *from,
        Segment::Arc { u, v, start, sweep, .. } => {
            let (sin, cos) = (start + sweep * t).sin_cos();
            (v * cos - u * sin) * sweep.signum()
        }
        Segment::Bezier { points: [a, b, c, d], .. } => {
            let s = 1.0 - t;
            (*b - *a) * (s * s) + (*c - *b) * (2.0 * s * t) + (*d - *c) * (t * t)
        }
    };
    let is_known = |way: &Vector2<f64>| way.norm() > reach * 1e-9;
    // Where control points coincide or the curve has a cusp, its direction is that to the points nearby.
    let nearby =
        |distance: f64| segment.point((t + distance).min(1.0)) - segment.point((t - distance).max(0.0));
    let ways = [derivative, nearby(1e-4), nearby(1e-2), segment.end() - segment.start()];
    ways.into_iter().find(is_known).and_then(|way| way.try_normalize(0.0))
}
