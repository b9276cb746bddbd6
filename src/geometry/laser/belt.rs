//! A production line: products pass the laser on a belt and are marked while they move.
//!
//! The lead distance is that of Chuang, Shape correction for laser marking, 2023, chapter 7: the speed of the
//! belt times the time from the scan to the corrected drawing. The chapter does not state that one computer
//! then corrects only one product in that time; [`Belt::corrections_at_once`] does.

use nalgebra::Vector2;

use crate::geometry::pattern::{Pattern, Shape};
use crate::geometry::space::{Extents, FlatPoint};

/// Chord tolerance for lengths, mm.
const FINE: f64 = 1e-3;

/// A belt and the laser above it. All numbers are positive, times may be 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Belt {
    /// Speed of the belt, mm/s.
    pub speed: f64,
    /// Unit direction of the belt in the field.
    pub direction: Vector2<f64>,
    /// Length of the field in the direction of the belt, mm.
    pub field: f64,
    /// Speed at which lines are marked, mm/s.
    pub marking_speed: f64,
    /// Speed of jumps between lines, mm/s.
    pub jump_speed: f64,
    /// Time after a jump until the mirrors are at rest, s.
    pub jump_delay: f64,
    /// Time to switch the laser on and off for a line, s.
    pub line_delay: f64,
    /// Time at a corner between two pieces of a line, s.
    pub corner_delay: f64,
}

/// A line of the drawing.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    /// Its hindmost and its foremost position along the belt, mm.
    along: [f64; 2],
    ends: [Vector2<f64>; 2],
    length: f64,
    corners: usize,
}

/// How long a drawing takes, and whether the belt leaves that time.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct BeltPlan {
    /// Extent of the drawing along the belt and across it, mm.
    pub size: [f64; 2],
    /// Length of all lines and of all jumps, mm.
    pub lengths: [f64; 2],
    /// Time for lines, for jumps and for delays, s.
    pub times: [f64; 3],
    /// Time from the moment when the first line can be marked until the last one is marked, s.
    pub span: f64,
    /// The lines that one laser marks after another, in the order of the belt: one section if one laser can mark all.
    pub sections: Vec<Section>,
    /// The fastest belt at which one laser can mark all, mm/s; `None` if a line is longer than the field.
    pub fastest: Option<f64>,
    /// The longest line along the belt, mm.
    pub longest: f64,
}

/// Lines that one laser can mark while the product passes it.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Section {
    /// The indices of its paths in the drawing, in the order of marking: the foremost first.
    pub paths: Vec<usize>,
    /// Its hindmost and foremost position along the belt, mm.
    pub along: [f64; 2],
    /// Time for its lines, jumps and delays, s.
    pub time: f64,
    /// How long a line that no laser can mark in time is in the field as a whole, s.
    pub too_short: Option<f64>,
}

impl Belt {
    /// The plan for a drawing in the field. `None` for a drawing without lines.
    pub fn plan(&self, drawing: &Pattern) -> Option<BeltPlan> {
        let lines: Vec<Line> = drawing.paths.iter().map(|path| self.line(&path.shape)).collect();
        let mut order: Vec<usize> = (0..lines.len()).collect();
        order.sort_by(|a, b| lines[*b].along[1].total_cmp(&lines[*a].along[1]).then(a.cmp(b)));
        let front = lines[*order.first()?].along[1];
        let back = lines.iter().map(|line| line.along[0]).fold(f64::INFINITY, f64::min);
        let across = Vector2::new(-self.direction.y, self.direction.x);
        let points = drawing.paths.iter().flat_map(|path| path.shape.flattened(FINE));
        let width = Extents::of(points.map(|at| Vector2::new(at.coords().dot(&across), 0.0))).size().x;

        let marked: f64 = lines.iter().map(|line| line.length).sum();
        let pairs = || order.windows(2).map(|pair| (lines[pair[0]], lines[pair[1]]));
        // From 0, because `sum` makes -0 of nothing.
        let jumped =
            pairs().map(|(from, to)| (to.ends[0] - from.ends[1]).norm()).fold(0.0, |sum, jump| sum + jump);
        let delays = lines.iter().map(|line| self.line_delay + line.corners as f64 * self.corner_delay);
        let delays = delays.sum::<f64>() + self.jump_delay * (lines.len() - 1) as f64;
        let times = [marked / self.marking_speed, jumped / self.jump_speed, delays];
        let longest = lines.iter().map(|line| line.along[1] - line.along[0]).fold(0.0, f64::max);
        let sections = self.sections(&lines, &order, front);
        let span = self.done(&lines, &order, front).unwrap_or(f64::INFINITY);
        Some(BeltPlan {
            size: [front - back, width],
            lengths: [marked, jumped],
            times,
            span: if span.is_finite() { span } else { times.iter().sum() },
            sections,
            fastest: (longest < self.field).then(|| self.fastest(&lines, &order, front)),
            longest,
        })
    }

    /// The fastest belt at which one laser can mark all before the next product, mm/s, if products are `pitch` mm apart. `None` if a
    /// line is longer than the field, or products overlap.
    pub fn fastest_at(&self, drawing: &Pattern, pitch: f64) -> Option<f64> {
        let lines: Vec<Line> = drawing.paths.iter().map(|path| self.line(&path.shape)).collect();
        let mut order: Vec<usize> = (0..lines.len()).collect();
        order.sort_by(|a, b| lines[*b].along[1].total_cmp(&lines[*a].along[1]).then(a.cmp(b)));
        let front = lines[*order.first()?].along[1];
        let back = lines.iter().map(|line| line.along[0]).fold(f64::INFINITY, f64::min);
        let longest = lines.iter().map(|line| line.along[1] - line.along[0]).fold(0.0, f64::max);
        if longest >= self.field || pitch < front - back {
            return None;
        }
        let can = |speed: f64| {
            let done = Self { speed, ..*self }.done(&lines, &order, front);
            done.is_some_and(|span| span * speed <= pitch)
        };
        let (mut slow, mut fast) = (0.0, self.fastest(&lines, &order, front));
        if can(fast) {
            return Some(fast);
        }
        for _ in 0..60 {
            let middle = f64::midpoint(slow, fast);
            if can(middle) { slow = middle } else { fast = middle }
        }
        (slow > 0.0).then_some(slow)
    }

    /// The distance by which a scanner is before the laser, mm, if a corrected drawing is ready `time` s after the scan.
    pub fn lead(&self, time: f64) -> f64 {
        self.speed * time
    }

    /// How many products are corrected at the same time, if a correction takes `time` s and products are `pitch` mm apart.
    pub fn corrections_at_once(&self, time: f64, pitch: f64) -> f64 {
        (self.lead(time) / pitch).ceil().max(1.0)
    }

    fn line(&self, shape: &Shape) -> Line {
        let mut points: Vec<FlatPoint> = shape.flattened(FINE);
        if shape.is_closed() {
            points.extend(points.first().copied());
        }
        let along = points.iter().map(|at| at.coords().dot(&self.direction));
        let along =
            along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)]);
        let end = |at: Option<&FlatPoint>| at.map_or_else(Vector2::zeros, |at| at.coords());
        Line {
            along,
            ends: [end(points.first()), end(points.last())],
            length: points.windows(2).map(|pair| pair[0].distance(pair[1])).sum(),
            corners: points.len().saturating_sub(2),
        }
    }

    /// Time to mark a line after the one before it, s.
    fn time(&self, line: &Line, before: Option<&Line>) -> f64 {
        let jump = before
            .map_or(0.0, |before| (line.ends[0] - before.ends[1]).norm() / self.jump_speed + self.jump_delay);
        jump + self.line_delay + line.corners as f64 * self.corner_delay + line.length / self.marking_speed
    }

    /// When the last of these lines is marked, s from the moment when the first one can be; `None` if one of them leaves the
    /// field before. A line is marked while all of it is in the field.
    fn done(&self, lines: &[Line], order: &[usize], front: f64) -> Option<f64> {
        let mut clock: Option<(f64, f64)> = None;
        let mut before: Option<&Line> = None;
        for index in order {
            let line = lines.get(*index)?;
            let enters = (front - line.along[0]) / self.speed;
            let leaves = (front - line.along[1] + self.field) / self.speed;
            let (start, now) = clock.unwrap_or((enters, enters));
            let now = now.max(enters) + self.time(line, before);
            if now > leaves + 1e-12 {
                return None;
            }
            clock = Some((start, now));
            before = Some(line);
        }
        clock.map(|(start, now)| now - start)
    }

    /// As many lines as possible for the first laser, then for the second, and so on; a line that no laser can mark in time
    /// is a section of its own.
    fn sections(&self, lines: &[Line], order: &[usize], front: f64) -> Vec<Section> {
        let mut sections = Vec::new();
        let mut rest = order;
        while !rest.is_empty() {
            // A longer beginning is never easier.
            let (mut fits, mut fails) = (1, rest.len() + 1);
            while fails - fits > 1 {
                let middle = usize::midpoint(fits, fails);
                if self.done(lines, &rest[..middle], front).is_some() {
                    fits = middle
                } else {
                    fails = middle
                }
            }
            let (now, later) = rest.split_at(fits);
            let mut before = None;
            let (mut time, mut along) = (0.0, [f64::INFINITY, f64::NEG_INFINITY]);
            for line in now.iter().filter_map(|index| lines.get(*index)) {
                time += self.time(line, before);
                along = [along[0].min(line.along[0]), along[1].max(line.along[1])];
                before = Some(line);
            }
            let is_in_time = self.done(lines, now, front).is_some();
            let too_short = (!is_in_time).then(|| (self.field - (along[1] - along[0])) / self.speed);
            sections.push(Section { paths: now.to_vec(), along, time, too_short });
            rest = later;
        }
        sections
    }

    fn fastest(&self, lines: &[Line], order: &[usize], front: f64) -> f64 {
        let can = |speed: f64| Self { speed, ..*self }.done(lines, order, front).is_some();
        let (mut slow, mut fast) = (0.0, self.speed);
        while can(fast) && fast < 1e9 {
            (slow, fast) = (fast, 2.0 * fast);
        }
        for _ in 0..60 {
            let middle = f64::midpoint(slow, fast);
            if can(middle) { slow = middle } else { fast = middle }
        }
        slow
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::pattern::{Color, Path, Segment, Source};

    fn belt() -> Belt {
        Belt {
            speed: 100.0,
            direction: Vector2::new(1.0, 0.0),
            field: 100.0,
            marking_speed: 1000.0,
            jump_speed: 5000.0,
            jump_delay: 0.001,
            line_delay: 0.0005,
            corner_delay: 0.0,
        }
    }

    /// Lines across the belt of 20 mm, at these positions along it.
    fn across(positions: impl IntoIterator<Item = f64>) -> Pattern {
        let line = |x: f64| Segment::Line { from: FlatPoint::new(x, 0.0), to: FlatPoint::new(x, 20.0) };
        let path = |x: f64| Path {
            layer: 0,
            color: Color::ByLayer,
            shape: Shape::Open(vec![line(x)]),
            region: None,
            source: Source::default(),
        };
        Pattern { layers: Vec::new(), paths: positions.into_iter().map(path).collect() }
    }

    #[test]
    fn the_lead_distance_is_that_of_the_thesis() {
        // Chapter 7: at 10 cm/s and about 50 s, the shape is detected 5 m before the laser.
        assert_eq!(belt().lead(50.0), 5000.0);
        // The thesis does not mention that products 0.2 m apart then need 25 corrections at once.
        assert_eq!(belt().corrections_at_once(50.0, 200.0), 25.0);
        // Today a correction takes milliseconds.
        assert_eq!((belt().lead(0.04), belt().corrections_at_once(0.04, 200.0)), (4.0, 1.0));
    }

    #[test]
    fn the_times_are_those_of_the_lines_jumps_and_delays() {
        let plan = belt().plan(&across([0.0, 10.0, 20.0])).unwrap();
        assert_eq!((plan.size, plan.longest), ([20.0, 20.0], 0.0));
        let jump = 20f64.hypot(10.0);
        let expected = [0.06, 2.0 * jump / 5000.0, 3.0 * 0.0005 + 2.0 * 0.001];
        assert!(plan.times.iter().zip(expected).all(|(found, time)| (found - time).abs() < 1e-12));
        // Foremost first, and the hindmost line waits for the belt: it enters 0.2 s after the first.
        assert_eq!(plan.sections.len(), 1);
        assert_eq!(plan.sections[0].paths, [2, 1, 0]);
        let last = 0.2 + jump / 5000.0 + 0.001 + 0.0005 + 0.02;
        assert!((plan.span - last).abs() < 1e-12, "{}", plan.span);
    }

    #[test]
    fn a_belt_that_outruns_the_laser_is_named_with_the_speed_that_does_not() {
        // 200 lines at one place of the belt take 200 · 20.5 ms and 199 jumps of 20 mm and 1 ms each: 5.095 s in 100 mm.
        let drawing = across(std::iter::repeat_n(0.0, 200));
        let plan = belt().plan(&drawing).unwrap();
        let total = 200.0 * 0.0205 + 199.0 * 0.005;
        assert!((plan.times.iter().sum::<f64>() - total).abs() < 1e-9);
        assert!((plan.fastest.unwrap() - 100.0 / total).abs() < 1e-6);
        // In one second, a laser marks 39 lines and 38 jumps, and 40 are too many.
        let counts: Vec<usize> = plan.sections.iter().map(|section| section.paths.len()).collect();
        assert_eq!(counts, [39, 39, 39, 39, 39, 5]);
        assert!(plan.sections.iter().all(|section| section.too_short.is_none()));
        let slower = Belt { speed: plan.fastest.unwrap() * 0.999, ..belt() };
        assert_eq!(slower.plan(&drawing).unwrap().sections.len(), 1);
    }

    #[test]
    fn the_fastest_belt_leaves_the_time_for_a_product_before_the_next() {
        // Three lines at one place take 61.5 ms and two jumps of 20 mm and 1 ms each, 10 ms: 71.5 ms, while the belt moves by 50 mm.
        let drawing = across([0.0, 0.0, 0.0]);
        let fastest = belt().fastest_at(&drawing, 50.0).unwrap();
        assert!((fastest - 50.0 / 0.0715).abs() < 1e-6, "{fastest}");
        // Farther apart, only the field limits it.
        let far = belt().fastest_at(&drawing, 500.0);
        assert_eq!(far, belt().plan(&drawing).unwrap().fastest);
        // Products of 20 mm cannot be 10 mm apart.
        assert_eq!(belt().fastest_at(&across([0.0, 20.0]), 10.0), None);
    }

    /// At 10000 mm/s, a line is in a field of 100 mm for 10 ms; it takes 20.5 ms.
    #[test]
    fn a_line_that_no_laser_can_mark_in_time_is_named() {
        let fast = Belt { speed: 10_000.0, ..belt() };
        for count in [1, 3] {
            let plan = fast.plan(&across((0..count).map(f64::from))).unwrap();
            let found: Vec<_> =
                plan.sections.iter().map(|section| (section.time, section.too_short)).collect();
            assert!(found.len() == count as usize, "{found:?}");
            for (time, too_short) in found {
                assert!((time - 0.0205).abs() < 1e-12 && (too_short.unwrap() - 0.01).abs() < 1e-12);
            }
        }
        // No jump, with the sign of nothing.
        let alone = fast.plan(&across([0.0])).unwrap();
        assert!(alone.lengths[1].is_sign_positive() && alone.times[1].is_sign_positive());
    }

    #[test]
    fn a_drawing_longer_than_the_field_is_marked_as_it_passes() {
        let drawing = across((0..50).map(|index| f64::from(index) * 10.0));
        let plan = belt().plan(&drawing).unwrap();
        assert_eq!((plan.size[0], plan.sections.len()), (490.0, 1));
        // A line of 120 mm along the belt is never in the field as a whole.
        let along = Segment::Line { from: FlatPoint::new(0.0, 0.0), to: FlatPoint::new(120.0, 0.0) };
        let mut long = across([0.0]);
        long.paths[0].shape = Shape::Open(vec![along]);
        let plan = belt().plan(&long).unwrap();
        assert_eq!((plan.fastest, plan.longest), (None, 120.0));
        assert_eq!(belt().plan(&Pattern::default()), None);
    }
}
