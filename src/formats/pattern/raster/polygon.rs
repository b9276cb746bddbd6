//! Reduces the many places of a border to the few corners of a polygon, without rounding its corners.
//!
//! The places are divided into runs that fit a straight line within the tolerance, and the polygon's corners are the
//! intersections of the lines of neighbouring runs. So a corner is where its edges meet, not where pixels cut it off;
//! and along a curve, lines through the middle of the places keep the enclosed area. After P. Selinger, Potrace: a
//! polygon-based tracing algorithm (2003), section 2.3.1 (corners from lines of best fit), but with runs as long as the
//! tolerance allows instead of the polygon with the fewest sides.

use nalgebra::Vector2;

use super::trace::{Along, Place, Side};

type Point = Vector2<f64>;

/// Largest share of places at grey pixels for a border without smooth edges.
const MAX_SMOOTH_OF_HARD: f64 = 0.005;
/// Largest distance of places on a border without smooth edges from the true edge, pixels: half a pixel and rounding.
const HARD_TOLERANCE: f64 = 0.55;
/// A step of this size against the direction of its run, pixels, ends the run, because the border turns back.
const STEP_BACK: f64 = 0.5;
/// Largest number of runs that cut off one corner.
const MAX_CUT_OFF: usize = 4;
/// Largest distance of places from the corner that pixels cut off, pixels, measured across the bisector; the distance
/// from the corner itself grows with the sharpness of the corner.
const CUT_OFF: f64 = 1.2;
/// Largest distance of a corner from its places, pixels: the tip of a needle is unknown.
const FARTHEST_CORNER: f64 = 5.0;
/// Below this angle between two lines, rad, they approximate one curve, and their intersection may move along it.
const GENTLE: f64 = 0.5;
/// Largest area of a corner that was cut off, square pixels.
const AREA_OF_A_CORNER: f64 = 0.25;
/// Largest relative change of a shape's area; with a larger change the shape keeps its places.
const LARGEST_CHANGE: f64 = 0.25;
/// Largest number of places that change to the neighbouring run.
const MAX_MOVED: usize = 4;

/// How to interpret the pixels of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fineness {
    /// Largest distance between the places of a smooth border and the lines through them, pixels.
    pub(super) tolerance: f64,
    /// Whether hard-edged pixels are to be marked as squares, like the modules of a code.
    pub(super) pixels_are_squares: bool,
}

/// The outline of one border.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Outline {
    /// Its corners, in pixels from the upper left corner of the picture, y down; the first one is not repeated.
    pub(super) corners: Vec<Point>,
    /// Whether the border was drawn without smooth edges.
    pub(super) is_hard: bool,
}

/// The places of a border from the first to the last, inclusive, and the straight line through them.
#[derive(Debug, Clone, Copy)]
struct Run {
    first: usize,
    last: usize,
    line: Line,
}

#[derive(Debug, Clone, Copy)]
struct Line {
    point: Point,
    direction: Point,
}

/// The outline of a border, with as few corners as the tolerance allows.
pub(super) fn outline(walk: &[Side], places: &[Place], fineness: &Fineness) -> Outline {
    let smooth = places.iter().filter(|place| place.is_smooth).count();
    let is_hard = smooth as f64 <= MAX_SMOOTH_OF_HARD * places.len() as f64;
    let turns = turns(walk);
    if is_hard && fineness.pixels_are_squares || places.len() < 3 {
        return Outline { corners: corners(walk, &turns), is_hard };
    }
    let (points, fixed, tolerance) = if is_hard {
        let (points, fixed) = hard_points(walk, &turns);
        (points, fixed, HARD_TOLERANCE)
    } else {
        let points = places.iter().map(|place| Point::from(place.at)).collect();
        (points, vec![false; places.len()], fineness.tolerance)
    };
    let fitted = fitted(&points, &fixed, tolerance);
    // A shape of a few pixels, which lines would change too much, keeps its places.
    let (area, change) = (area(&points).abs(), (area(&points) - area(&fitted)).abs());
    let max_change = 2.0 * (tolerance * perimeter(&points) + AREA_OF_A_CORNER * fitted.len() as f64);
    let is_close = fitted.len() >= 3 && change <= max_change.min(area * LARGEST_CHANGE);
    let corners = match (is_close, is_hard) {
        (true, _) => fitted,
        (false, true) => self::corners(walk, &turns),
        (false, false) => points,
    };
    Outline { corners, is_hard }
}

impl Outline {
    /// The enclosed area, square pixels.
    pub(super) fn area(&self) -> f64 {
        area(&self.corners).abs() / 2.0
    }
}

/// Twice the signed area.
fn area(points: &[Point]) -> f64 {
    pairs(points).map(|(a, b)| a.perp(b)).sum()
}

fn perimeter(points: &[Point]) -> f64 {
    pairs(points).map(|(a, b)| (b - a).norm()).sum()
}

fn pairs(points: &[Point]) -> impl Iterator<Item = (&Point, &Point)> {
    points.iter().zip(points.iter().cycle().skip(1))
}

/// The indices of the sides at whose start the walk turns.
fn turns(walk: &[Side]) -> Vec<usize> {
    let before = |index: usize| walk[(index + walk.len() - 1) % walk.len()];
    (0..walk.len()).filter(|&index| walk[index].along != before(index).along).collect()
}

fn corners(walk: &[Side], turns: &[usize]) -> Vec<Point> {
    turns.iter().map(|&turn| walk[turn].from.map(f64::from).into()).collect()
}

/// The midpoints of all sides of a hard border, together with the true corners, and which points are true corners.
///
/// A slanting straight edge makes steps alternately to the left and to the right, and of two adjacent rows of sides one
/// has a single side. So two longer rows meet at a true corner, and a single side between two turns to the same side is
/// the end of something one pixel wide.
fn hard_points(walk: &[Side], turns: &[usize]) -> (Vec<Point>, Vec<bool>) {
    let (sides, count) = (walk.len(), turns.len());
    let length = |turn: usize| (turns[(turn + 1) % count] + sides - turns[turn % count] - 1) % sides + 1;
    let before = |turn: usize| (turn + count - 1) % count;
    let side = |turn: usize| {
        let at = turns[turn % count];
        let (from, to) = (walk[(at + sides - 1) % sides].along, walk[at].along);
        (to as usize + 4 - from as usize) % 4
    };
    let is_corner = |turn: usize| {
        let (last, next) = (length(before(turn)), length(turn));
        last.min(next) >= 2
            || last == 1 && side(before(turn)) == side(turn)
            || next == 1 && side(turn + 1) == side(turn)
    };
    let (mut points, mut fixed) = (Vec::with_capacity(sides + count), Vec::with_capacity(sides + count));
    let mut next_turn = 0;
    for (index, side) in walk.iter().enumerate() {
        let from = Point::from(side.from.map(f64::from));
        if turns.get(next_turn) == Some(&index) {
            if is_corner(next_turn) {
                points.push(from);
                fixed.push(true);
            }
            next_turn += 1;
        }
        points.push(from + middle(side.along));
        fixed.push(false);
    }
    (points, fixed)
}

fn middle(along: Along) -> Point {
    Point::from(along.step().map(|step| step as f64 / 2.0))
}

/// The corners of the polygon that fits the closed sequence of points.
fn fitted(points: &[Point], fixed: &[bool], tolerance: f64) -> Vec<Point> {
    // Start at a true corner; without one, at the end of the run from an arbitrary point.
    let count = points.len();
    let start = fixed.iter().position(|fixed| *fixed).unwrap_or_else(|| longest(points, tolerance));
    let around: Vec<Point> = (0..=count).map(|index| points[(start + index) % count]).collect();
    let stops: Vec<usize> =
        (1..=count).filter(|index| *index == count || fixed[(start + index) % count]).collect();
    let mut runs = runs(&around, &stops, tolerance);
    for _ in 0..2 {
        settle(&mut runs, &around, &stops);
    }
    sharpen(&mut runs, &around);
    if runs.len() < 3 {
        return Vec::new();
    }
    let before = |index: usize| &runs[(index + runs.len() - 1) % runs.len()];
    (0..runs.len()).map(|index| corner(before(index), &runs[index], &around)).collect()
}

/// Divides the points into runs as long as the tolerance allows, but not beyond a stop; each begins where the last one
/// ends.
fn runs(points: &[Point], stops: &[usize], tolerance: f64) -> Vec<Run> {
    let mut runs = Vec::new();
    let mut first = 0;
    for &stop in stops {
        while first < stop {
            let last = first + longest(&points[first..=stop], tolerance);
            runs.push(Run { first, last, line: Line::through(&points[first..=last]) });
            first = last;
        }
    }
    runs
}

/// Index of the last point up to which a line fits all points.
fn longest(points: &[Point], tolerance: f64) -> usize {
    let fits = |last: usize| last == 1 || Line::meets(&points[..=last], tolerance);
    let end = points.len() - 1;
    let (mut good, mut step) = (1, 1);
    while good < end && fits((good + step).min(end)) {
        good = (good + step).min(end);
        step *= 2;
    }
    // The end is between the last length that fits and the next one tried.
    while step > 1 {
        step /= 2;
        if good + step <= end && fits(good + step) {
            good += step;
        }
    }
    good
}

/// Assigns every place near the end of a run to the nearer line, and fits the lines again.
fn settle(runs: &mut [Run], points: &[Point], stops: &[usize]) {
    for index in 1..runs.len() {
        let (a, b) = (runs[index - 1], runs[index]);
        if a.last != b.first || stops.binary_search(&a.last).is_ok() {
            continue;
        }
        let low = a.last.saturating_sub(MAX_MOVED).max(a.first + 1);
        let high = (a.last + MAX_MOVED).min(b.last - 1);
        if low > high {
            continue;
        }
        let square = |line: &Line, at: usize| line.offset(points[at]).powi(2);
        let cost = |end: usize| {
            let (mine, others) = (low..=end, end..=high);
            mine.map(|at| square(&a.line, at)).sum::<f64>()
                + others.map(|at| square(&b.line, at)).sum::<f64>()
        };
        let best = (low..=high).map(|end| (cost(end), end)).min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, end)) = best.filter(|(_, end)| *end != a.last) {
            runs[index - 1].last = end;
            runs[index].first = end;
            for run in &mut runs[index - 1..=index] {
                run.line = Line::through(&points[run.first..=run.last]);
            }
        }
    }
}

/// Removes runs that only cut off the corner between their neighbours.
fn sharpen(runs: &mut Vec<Run>, points: &[Point]) {
    // Start with the longest run, which cannot be a corner that was cut off.
    let longest = (0..runs.len()).max_by(|a, b| runs[*a].length(points).total_cmp(&runs[*b].length(points)));
    runs.rotate_left(longest.unwrap_or(0));
    let mut kept: Vec<Run> = Vec::with_capacity(runs.len());
    let mut index = 0;
    while index < runs.len() {
        let cut_off = (1..=MAX_CUT_OFF).rev().find(|&count| {
            let (Some(a), Some(between)) = (kept.last(), runs.get(index..index + count)) else {
                return false;
            };
            let b = &runs[(index + count) % runs.len()];
            cuts_off(a, between, b, points)
        });
        match cut_off {
            Some(count) => index += count,
            None => {
                kept.push(runs[index]);
                index += 1;
            }
        }
    }
    if kept.len() >= 3 {
        *runs = kept;
    }
}

/// Whether the runs between `a` and `b` only cut off the corner of the two.
fn cuts_off(a: &Run, between: &[Run], b: &Run, points: &[Point]) -> bool {
    let length: f64 = between.iter().map(|run| run.length(points)).sum();
    2.0 * length < a.length(points).min(b.length(points))
        && a.line.angle(&b.line) > GENTLE
        && a.line.crossing(&b.line).is_some_and(|corner| {
            let mut places = between.iter().flat_map(|run| &points[run.first..=run.last]);
            places.all(|place| (place - corner).norm() <= a.line.reach(&b.line))
        })
}

/// The corner between two runs.
fn corner(a: &Run, b: &Run, points: &[Point]) -> Point {
    let end = (points[a.last] + points[b.first]) / 2.0;
    let farthest = if a.line.angle(&b.line) < GENTLE {
        a.length(points).min(b.length(points)) / 2.0
    } else {
        a.line.reach(&b.line)
    };
    match a.line.crossing(&b.line) {
        Some(crossing) if (crossing - end).norm() <= farthest => crossing,
        _ => (a.line.nearest(end) + b.line.nearest(end)) / 2.0,
    }
}

impl Run {
    fn length(&self, points: &[Point]) -> f64 {
        (points[self.last] - points[self.first]).norm()
    }
}

impl Line {
    /// The least-squares line through the points, in the direction of their order. The end points, which two runs
    /// share, have half the weight, so that a line along an arc has as much area on one side as on the other.
    fn through(points: &[Point]) -> Self {
        let ends = [points[0], points[points.len() - 1]];
        let point = (points.iter().sum::<Point>() - (ends[0] + ends[1]) / 2.0) / (points.len() - 1) as f64;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        let mut add = |at: &Point, weight: f64| {
            let offset = at - point;
            xx += weight * offset.x * offset.x;
            xy += weight * offset.x * offset.y;
            yy += weight * offset.y * offset.y;
        };
        points.iter().for_each(|at| add(at, 1.0));
        ends.iter().for_each(|at| add(at, -0.5));
        let angle = (2.0 * xy).atan2(xx - yy) / 2.0;
        let direction = Point::new(angle.cos(), angle.sin());
        let onwards = ends[1] - ends[0];
        Self { point, direction: if direction.dot(&onwards) < 0.0 { -direction } else { direction } }
    }

    /// Whether a line fits all points within the tolerance, and their order along it does not turn back.
    fn meets(points: &[Point], tolerance: f64) -> bool {
        let line = Self::through(points);
        points.iter().all(|point| line.offset(*point).abs() <= tolerance)
            && points.windows(2).all(|pair| line.direction.dot(&(pair[1] - pair[0])) > -STEP_BACK)
    }

    /// Signed distance of a point.
    fn offset(&self, point: Point) -> f64 {
        self.direction.perp(&(point - self.point))
    }

    fn nearest(&self, point: Point) -> Point {
        self.point + self.direction * self.direction.dot(&(point - self.point))
    }

    fn angle(&self, other: &Self) -> f64 {
        self.direction.perp(&other.direction).atan2(self.direction.dot(&other.direction)).abs()
    }

    /// Largest distance of the places next to a corner of two lines from it, pixels.
    fn reach(&self, other: &Self) -> f64 {
        // Half the inner angle of the corner is a right angle less half the turn.
        (CUT_OFF / (self.angle(other) / 2.0).cos()).min(FARTHEST_CORNER)
    }

    /// The intersection of two lines; `None` for parallel ones.
    fn crossing(&self, other: &Self) -> Option<Point> {
        let sine = self.direction.perp(&other.direction);
        let along = (other.point - self.point).perp(&other.direction) / sine;
        (sine.abs() > 1e-9).then(|| self.point + self.direction * along)
    }
}
