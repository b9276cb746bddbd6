//! Which part of a surface a face covers: its boundary in the plane of the surface's parameters.
//!
//! A side that bounds the face twice, as a seam of a cylinder does, bounds nothing and is skipped. The rest
//! is a set of directed segments. On periodic surfaces they need not close in the plane. On a surface that is
//! open along one parameter, the number of crossings towards that end decides; it does not depend on the
//! sense of the loops. On a closed surface, such as a sphere, both sides of a loop are bounded, and its sense
//! decides: the face is on its left.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Point3, Vector2};

use super::surface::Surface;

/// Buckets of segments along each parameter.
const BUCKETS: usize = 256;
/// A test is moved by this share of the face, to prevent it from meeting a corner. Places that near to the
/// boundary are found by their distance.
const ASIDE: f64 = 1.734e-10;
/// Crossings closer than this share of the face are at one place.
const TIE: f64 = 1e-9;

/// The boundary of a face in the plane of its surface's parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Trimming {
    segments: Vec<[Vector2<f64>; 2]>,
    periods: [Option<f64>; 2],
    /// The smallest and largest parameters of the boundary.
    low: Vector2<f64>,
    high: Vector2<f64>,
    rule: Rule,
    /// For each parameter, the segments that meet each of its buckets.
    buckets: [Vec<Vec<u32>>; 2],
    /// Where each of these starts, and how wide a bucket is.
    starts: [(f64, f64); 2],
}

/// How a side of the boundary is recognised.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Rule {
    /// The face is the whole surface.
    All,
    /// The number of crossings towards larger (`up`) or smaller values of the given parameter is odd, within its limits.
    Parity { across: usize, up: bool, from: f64, to: f64 },
    /// The nearest crossing has the face on the given side: +1 for the left.
    Sense(f64),
}

/// The parameters of points on a boundary, found one after the other.
#[derive(Debug)]
pub struct Locator<'a> {
    surface: &'a Surface,
    starts: Vec<(Vector2<f64>, Point3<f64>)>,
    enough: f64,
}

/// A point of a boundary in the plane of the parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    /// Its parameters.
    pub at: Vector2<f64>,
    /// How far it is from the surface, mm.
    pub distance: f64,
    /// The distance of the last point, up to this one, that a search all over the surface could not bring near enough, mm.
    searched: f64,
    /// Whether it is at a pole, where this parameter has no meaning.
    pub any: Option<usize>,
}

impl<'a> Locator<'a> {
    /// For points on a surface; a distance of `enough` mm from it needs no further search.
    pub fn new(surface: &'a Surface, enough: f64) -> Self {
        let starts = match surface {
            Surface::Patches(patches) => patches.starts(),
            _ => Vec::new(),
        };
        Self { surface, starts, enough }
    }

    /// The parameters of a point, near those of the previous one.
    pub fn find(&self, point: &Point3<f64>, previous: Option<&Located>) -> Located {
        let plain = |x: f64, y: f64, distance: f64| Located {
            at: Vector2::new(x, y),
            distance,
            searched: distance,
            any: None,
        };
        let angle = |x: f64, y: f64, size: f64| {
            if x.hypot(y) <= 1e-9 * size.abs() + 1e-12 { None } else { Some(y.atan2(x)) }
        };
        let round = |angle: Option<f64>, v: f64, distance: f64| Located {
            at: Vector2::new(angle.unwrap_or(0.0), v),
            distance,
            searched: distance,
            any: angle.is_none().then_some(0),
        };
        match self.surface {
            Surface::Plane(frame) => {
                let local = frame.local(point);
                plain(local.x, local.y, local.z.abs())
            }
            Surface::Cylinder(frame, radius) => {
                let local = frame.local(point);
                let away = (local.x.hypot(local.y) - radius).abs();
                round(angle(local.x, local.y, *radius), local.z, away)
            }
            Surface::Cone(frame, radius, tangent) => {
                let local = frame.local(point);
                let here = radius + tangent * local.z;
                let away = (local.x.hypot(local.y) - here.abs()).abs() / 1f64.hypot(*tangent);
                // The other half of a double cone has its angle on the other side.
                let side = if here < 0.0 { -1.0 } else { 1.0 };
                round(angle(local.x * side, local.y * side, *radius), local.z, away)
            }
            Surface::Sphere(frame, radius) => {
                let local = frame.local(point);
                let flat = local.x.hypot(local.y);
                round(angle(local.x, local.y, *radius), local.z.atan2(flat), (local.norm() - radius).abs())
            }
            Surface::Patches(patches) => {
                // Where the edge is off the surface, the next point is, too. The allowed distance does not
                // grow from point to point.
                let before = previous.map_or(0.0, |previous| previous.searched);
                let enough = self.enough.max(2.0 * before);
                let guess = previous.map(|previous| previous.at);
                let (mut at, distance) = patches.nearest(point, guess, &self.starts, enough);
                let (domain, poles) = (patches.domain(), patches.poles());
                let mut any = None;
                for axis in 0..2 {
                    let width = domain[axis][1] - domain[axis][0];
                    for end in 0..2 {
                        let mut side = at;
                        side[axis] = domain[axis][end];
                        if poles[axis][end] && (patches.jet(side).point - point).norm() <= distance.max(1e-7)
                        {
                            at[axis] = domain[axis][end];
                            any = Some(1 - axis);
                        } else if patches.closed()[axis]
                            && (at[axis] - domain[axis][end]).abs() < 1e-12 * width
                        {
                            at[axis] = domain[axis][0];
                        }
                    }
                }
                let searched = if distance <= enough && previous.is_some() { before } else { distance };
                Located { at, distance, searched, any }
            }
            Surface::Unread(_) => plain(0.0, 0.0, 0.0),
        }
    }
}

impl Trimming {
    /// The face of a surface inside these directed segments; `sense` is whether the face has the sense of the surface's
    /// parameters.
    pub fn new(surface: &Surface, segments: Vec<[Located; 2]>, sense: bool) -> Self {
        let periods = surface.periods();
        let mut flat: Vec<[Vector2<f64>; 2]> = Vec::with_capacity(segments.len());
        for [from, to] in segments {
            let (mut a, mut b) = (from.at, to.at);
            match (from.any, to.any) {
                (Some(_), Some(_)) => continue,
                (Some(axis), None) => a[axis] = b[axis],
                (None, Some(axis)) => b[axis] = a[axis],
                (None, None) => {}
            }
            for axis in 0..2 {
                if let Some(period) = periods[axis] {
                    b[axis] -= ((b[axis] - a[axis]) / period).round() * period;
                }
            }
            if a != b {
                flat.push([a, b]);
            }
        }
        let mut low = Vector2::repeat(f64::INFINITY);
        let mut high = Vector2::repeat(f64::NEG_INFINITY);
        for point in flat.iter().flatten() {
            (low, high) = (low.inf(point), high.sup(point));
        }
        let rule = Self::rule(surface, &flat, low, high, sense);
        let mut trimming = Self {
            segments: flat,
            periods,
            low,
            high,
            rule,
            buckets: [Vec::new(), Vec::new()],
            starts: [(0.0, 1.0); 2],
        };
        trimming.fill_buckets();
        trimming
    }

    fn rule(
        surface: &Surface,
        segments: &[[Vector2<f64>; 2]],
        low: Vector2<f64>,
        high: Vector2<f64>,
        sense: bool,
    ) -> Rule {
        if segments.is_empty() {
            return Rule::All;
        }
        let along = |across: usize, from: f64, to: f64| Rule::Parity { across, up: true, from, to };
        match surface {
            Surface::Plane(_) | Surface::Unread(_) | Surface::Cylinder(..) => along(1, low.y, high.y),
            Surface::Cone(_, radius, tangent) => {
                // Crossings are counted towards the wide end of the half on which the boundary is.
                let apex = if *tangent == 0.0 { f64::NEG_INFINITY } else { -radius / tangent };
                match (low.y + high.y) / 2.0 > apex {
                    true => Rule::Parity { across: 1, up: true, from: apex, to: high.y },
                    false => Rule::Parity { across: 1, up: false, from: low.y, to: apex },
                }
            }
            Surface::Sphere(..) => Rule::Sense(if sense { 1.0 } else { -1.0 }),
            Surface::Patches(patches) => {
                let (closed, poles, domain) = (patches.closed(), patches.poles(), patches.domain());
                let open = |axis: usize| !closed[axis] && poles[axis] == [false; 2];
                match (open(1), open(0)) {
                    (true, _) => along(1, domain[1][0], domain[1][1]),
                    (_, true) => along(0, domain[0][0], domain[0][1]),
                    _ => Rule::Sense(if sense { 1.0 } else { -1.0 }),
                }
            }
        }
    }

    fn fill_buckets(&mut self) {
        if self.segments.is_empty() {
            return;
        }
        for axis in 0..2 {
            let (start, width) = match self.periods[axis] {
                Some(period) => (0.0, period / BUCKETS as f64),
                None => (self.low[axis], ((self.high[axis] - self.low[axis]) / BUCKETS as f64).max(1e-300)),
            };
            let mut buckets = vec![Vec::new(); BUCKETS];
            for (index, [a, b]) in self.segments.iter().enumerate() {
                let (from, to) = (a[axis].min(b[axis]), a[axis].max(b[axis]));
                let number = |value: f64| ((value - start) / width).floor().clamp(-1e9, 1e9) as i64;
                let last = number(to) - number(from) + 1;
                for step in 0..=last.min(BUCKETS as i64 - 1) {
                    let number = number(from) + step;
                    let bucket = match self.periods[axis] {
                        Some(_) => number.rem_euclid(BUCKETS as i64),
                        None => number.clamp(0, BUCKETS as i64 - 1),
                    };
                    let bucket: &mut Vec<u32> = &mut buckets[bucket as usize];
                    if bucket.last() != Some(&(index as u32)) {
                        bucket.push(index as u32);
                    }
                }
            }
            (self.buckets[axis], self.starts[axis]) = (buckets, (start, width));
        }
    }

    /// The segments of the boundary in the plane of the parameters; on periodic surfaces each is where it starts.
    pub fn segments(&self) -> &[[Vector2<f64>; 2]] {
        &self.segments
    }

    /// The smallest and largest parameters of the boundary; infinite if there is none.
    pub fn bounds(&self) -> [Vector2<f64>; 2] {
        [self.low, self.high]
    }

    /// The size of the face along a parameter, for tolerances.
    fn size(&self, axis: usize) -> f64 {
        self.periods[axis].unwrap_or(self.high[axis] - self.low[axis]).max(1e-12)
    }

    /// The crossings of the line on which the parameter `axis` is `value`: where, along the other parameter, and +1 where the
    /// boundary crosses towards larger values of `axis`, −1 otherwise.
    fn crossings(&self, axis: usize, value: f64, found: &mut Vec<(f64, f64)>) {
        found.clear();
        if self.segments.is_empty() {
            return;
        }
        let (start, width) = self.starts[axis];
        let number = ((value - start) / width).floor();
        let bucket = match self.periods[axis] {
            Some(_) => (number as i64).rem_euclid(BUCKETS as i64) as usize,
            None if number < -1.0 || number > BUCKETS as f64 => return,
            None => number.clamp(0.0, BUCKETS as f64 - 1.0) as usize,
        };
        let other = 1 - axis;
        for &index in &self.buckets[axis][bucket] {
            let [a, b] = &self.segments[index as usize];
            let value = match self.periods[axis] {
                Some(period) => value - ((value - (a[axis] + b[axis]) / 2.0) / period).round() * period,
                None => value,
            };
            let (before, after) = (a[axis] <= value, b[axis] <= value);
            if before != after {
                let share = (value - a[axis]) / (b[axis] - a[axis]);
                found.push((a[other] + (b[other] - a[other]) * share, if before { 1.0 } else { -1.0 }));
            }
        }
    }

    /// Whether the face covers the place with these parameters.
    pub fn contains(&self, at: Vector2<f64>) -> bool {
        let mut found = Vec::new();
        let at = at + Vector2::new(self.size(0), self.size(1)) * ASIDE;
        match self.rule {
            Rule::All => true,
            Rule::Parity { across, up, from, to } => {
                let (place, margin) = (at[across], TIE * self.size(across));
                if place < from - margin || place > to + margin {
                    return false;
                }
                self.crossings(1 - across, at[1 - across], &mut found);
                found.iter().filter(|(other, _)| (*other > place) == up).count() % 2 == 1
            }
            Rule::Sense(left) => self.by_sense(at, left, &mut found),
        }
    }

    /// Whether the boundary crosses the lines of constant parameters through a place nearer than `near`.
    pub(super) fn is_near(&self, at: Vector2<f64>, near: Vector2<f64>) -> bool {
        let mut found = Vec::new();
        (0..2).any(|axis| {
            self.crossings(axis, at[axis], &mut found);
            let other = 1 - axis;
            found.iter().any(|(value, _)| {
                let step = value - at[other];
                let step = self.periods[other].map_or(step, |period| step - (step / period).round() * period);
                step.abs() < near[other]
            })
        })
    }

    fn by_sense(&self, at: Vector2<f64>, left: f64, found: &mut Vec<(f64, f64)>) -> bool {
        // Up and down from the place; else to the left and right; else up and down beside a segment, which a line without
        // crossings leads to.
        if let Some(inside) = self.nearest_side(0, at, left, found) {
            return inside;
        }
        if let Some(inside) = self.nearest_side(1, at, left, found) {
            return inside;
        }
        for index in [self.segments.len() / 2, self.segments.len() / 3, 0] {
            let [a, b] = self.segments[index];
            if (a.x - b.x).abs() > 1e-12 * self.size(0)
                && let Some(inside) =
                    self.nearest_side(0, Vector2::new(a.x * 0.618 + b.x * 0.382, at.y), left, found)
            {
                return inside;
            }
            if let Some(inside) =
                self.nearest_side(1, Vector2::new(at.x, a.y * 0.618 + b.y * 0.382), left, found)
            {
                return inside;
            }
        }
        false
    }

    /// The side of the nearest crossing of the line along which the parameter `axis` is constant.
    fn nearest_side(
        &self,
        axis: usize,
        at: Vector2<f64>,
        left: f64,
        found: &mut Vec<(f64, f64)>,
    ) -> Option<bool> {
        self.crossings(axis, at[axis], found);
        let other = 1 - axis;
        let place = at[other];
        let mut steps: Vec<(f64, f64)> = found
            .iter()
            .map(|(value, turn)| {
                let step = value - place;
                let step = self.periods[other].map_or(step, |period| step - (step / period).round() * period);
                (step, *turn)
            })
            .collect();
        steps.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Two sides at one place, in opposite senses, bound nothing.
        let tie = TIE * self.size(other);
        let mut kept: Vec<(f64, f64)> = Vec::with_capacity(steps.len());
        for step in steps {
            match kept.last() {
                Some(last) if (step.0 - last.0).abs() < tie && step.1 == -last.1 => {
                    kept.pop();
                }
                _ => kept.push(step),
            }
        }
        let (step, turn) = kept.into_iter().min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))?;
        // A segment towards +u has its left side towards +v; one towards +v has it towards −u.
        let left_is_ahead = if axis == 0 { turn > 0.0 } else { turn < 0.0 };
        let place_is_ahead = step < 0.0;
        Some((left_is_ahead == place_is_ahead) == (left > 0.0))
    }
}

/// The limits of the parameters of an elementary surface.
pub(super) fn natural_limits(surface: &Surface) -> [[f64; 2]; 2] {
    let all = [f64::NEG_INFINITY, f64::INFINITY];
    match surface {
        Surface::Sphere(..) => [[-PI, PI], [-FRAC_PI_2, FRAC_PI_2]],
        Surface::Cylinder(..) | Surface::Cone(..) => [[-PI, PI], all],
        Surface::Patches(patches) => patches.domain(),
        Surface::Plane(_) | Surface::Unread(_) => [all, all],
    }
}
