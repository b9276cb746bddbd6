//! The profile of a surface of revolution: the run of it on one side of the axis that a face uses.

use nalgebra::{Point3, Unit, Vector3};

use super::bezier::{BezierCurve, Weighted, projected};
use super::curve::Spline;

/// Points are on the axis, or in one plane with it, within this share of the profile's largest distance from the axis.
const ON_AXIS: f64 = 1e-9;
/// The same for the plane of a profile: files write directions with about this precision.
const IN_PLANE: f64 = 1e-6;
/// A profile meets the axis at the end of a curve if it does so within this share of its parameters.
const AT_END: f64 = 1e-9;
/// A curve is halved this many times at a place where it touches the axis; then the place is skipped.
const MAX_HALVINGS: u32 = 40;
/// An interval with one crossing is halved this many times, down to rounding.
const BISECTIONS: u32 = 60;
/// Places along each curve of a run, between which its distance from a face is interpolated.
const PLACES: u32 = 32;

/// A part of a profile on one side of the axis.
#[derive(Debug, Clone)]
struct Run {
    spline: Spline,
    is_positive: bool,
}

/// The axis of a revolution, and the half plane of its profile.
struct HalfPlane {
    origin: Point3<f64>,
    axis: Unit<Vector3<f64>>,
    side: Unit<Vector3<f64>>,
}

impl Spline {
    /// The part of this profile that sweeps, round an axis, the face whose loops go through the points
    /// `around`. A profile that crosses the axis, as the circle of a spindle torus does, is cut there: both
    /// sides would sweep surfaces of their own, or the same one twice. `None` if the profile is on the axis,
    /// or crosses sides outside a plane with it.
    #[must_use]
    pub fn one_side(
        &self,
        origin: Point3<f64>,
        axis: Unit<Vector3<f64>>,
        around: &[Point3<f64>],
    ) -> Option<Self> {
        let outward = |point: &Point3<f64>| {
            let from = point - origin;
            from - *axis * from.dot(&axis)
        };
        let controls = || self.curves.iter().flat_map(|curve| &curve.points).map(projected);
        let far = controls()
            .map(|point| outward(&point))
            .max_by(|one, other| one.norm().total_cmp(&other.norm()))?;
        let side = Unit::try_new(far, 1e-12)?;
        let plane = HalfPlane { origin, axis, side };
        let across = axis.cross(&side);
        let is_plane = controls().all(|point| outward(&point).dot(&across).abs() <= IN_PLANE * far.norm());
        if !is_plane {
            // A straight line that is skew to the axis sweeps a hyperboloid, each circle of it once.
            let is_line = matches!(self.curves.as_slice(), [curve] if curve.points.len() == 2);
            let is_beside = controls().all(|point| outward(&point).dot(&side) >= -ON_AXIS * far.norm());
            return (is_line || is_beside).then(|| self.clone());
        }
        let mut runs = self.runs(&plane, ON_AXIS * far.norm());
        if runs.len() == 1 {
            return runs.pop().map(|run| run.spline);
        }
        let mut found: Option<(Run, [f64; 3])> = None;
        for run in runs {
            let score = plane.score(&run, around);
            let is_better = found.as_ref().is_none_or(|(_, best)| {
                let same = |index: usize| (score[index] - best[index]).abs() <= IN_PLANE * far.norm();
                let first = (0..2).find(|&index| !same(index)).unwrap_or(2);
                score[first] < best[first]
            });
            if is_better {
                found = Some((run, score));
            }
        }
        found.map(|(run, _)| run.spline)
    }

    /// The parts of a profile in a plane with the axis between its places within `near` mm of the axis.
    fn runs(&self, plane: &HalfPlane, near: f64) -> Vec<Run> {
        let mut runs: Vec<Run> = Vec::new();
        let mut continues = false;
        for (curve, ends) in self.curves.iter().zip(self.breaks.windows(2)) {
            let mut cuts = vec![0.0];
            crossings(&plane.across(curve, near), [0.0, 1.0], 0, &mut cuts);
            cuts.retain(|t| *t == 0.0 || (*t > AT_END && *t < 1.0 - AT_END));
            cuts.push(1.0);
            for pair in cuts.windows(2) {
                let piece = curve.between([pair[0], pair[1]]);
                let offsets = plane.across(&piece, near);
                let Some(farthest) = offsets.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs()))
                else {
                    continue;
                };
                if farthest == 0.0 {
                    continues = false;
                    continue;
                }
                let is_positive = farthest > 0.0;
                let [from, to] = [pair[0], pair[1]].map(|t| ends[0] + (ends[1] - ends[0]) * t);
                match runs.last_mut().filter(|run| continues && run.is_positive == is_positive) {
                    Some(run) => run.spline.append(piece, to),
                    None => {
                        let spline = Self { breaks: vec![from, to], curves: vec![piece] };
                        runs.push(Run { spline, is_positive });
                    }
                }
                continues = true;
            }
        }
        // A circle may start anywhere.
        let is_round = self.is_closed() && runs.len() > 1;
        if is_round && runs[0].is_positive == runs[runs.len() - 1].is_positive {
            let first = runs.remove(0).spline;
            if let Some(last) = runs.last_mut() {
                let shift = last.spline.breaks[last.spline.curves.len()] - first.breaks[0];
                for (curve, end) in first.curves.into_iter().zip(&first.breaks[1..]) {
                    last.spline.append(curve, end + shift);
                }
            }
        }
        runs
    }

    fn append(&mut self, curve: BezierCurve, end: f64) {
        self.curves.push(curve);
        self.breaks.push(end);
    }
}

impl HalfPlane {
    /// The distances of the control points from the axis, negative beyond it and times their weights; 0 within `near`.
    fn across(&self, curve: &BezierCurve, near: f64) -> Vec<f64> {
        let across = |point: &Weighted| (point.xyz() - self.origin.coords * point.w).dot(&self.side);
        curve
            .points
            .iter()
            .map(across)
            .map(|offset| if offset.abs() <= near { 0.0 } else { offset })
            .collect()
    }

    /// Distance from the axis and along it, mm.
    fn place(&self, point: &Point3<f64>) -> [f64; 2] {
        let from = point - self.origin;
        let along = from.dot(&self.axis);
        [(from - *self.axis * along).norm(), along]
    }

    /// How badly a run fits a face, as three values in order, mm: the mean distance of the points of the face
    /// from the surface that the run sweeps; if this is equal, their smallest distance from the run; if this
    /// is equal, how little the run reaches away from the axis.
    fn score(&self, run: &Run, around: &[Point3<f64>]) -> [f64; 3] {
        let steps = |curve: &BezierCurve| -> Vec<Point3<f64>> {
            (0..=PLACES).map(|step| curve.point(f64::from(step) / f64::from(PLACES))).collect()
        };
        let points: Vec<Point3<f64>> = run.spline.curves.iter().flat_map(steps).collect();
        let places: Vec<[f64; 2]> = points.iter().map(|point| self.place(point)).collect();
        let from_swept = |point: &Point3<f64>| {
            let at = self.place(point);
            places.windows(2).map(|ends| distance(at, ends)).fold(f64::INFINITY, f64::min)
        };
        let mean = around.iter().map(from_swept).sum::<f64>() / around.len().max(1) as f64;
        let apart = around.iter().flat_map(|point| points.iter().map(move |other| (point - other).norm()));
        let reach = places.iter().map(|place| place[0]).fold(0.0, f64::max);
        [mean, if around.is_empty() { 0.0 } else { apart.fold(f64::INFINITY, f64::min) }, -reach]
    }
}

/// Distance of a place from the line between two others.
fn distance(at: [f64; 2], ends: &[[f64; 2]]) -> f64 {
    let [from, to] = [ends[0], ends[1]];
    let along = [to[0] - from[0], to[1] - from[1]];
    let square = along[0] * along[0] + along[1] * along[1];
    let share = if square > 0.0 {
        (((at[0] - from[0]) * along[0] + (at[1] - from[1]) * along[1]) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (from[0] + along[0] * share - at[0]).hypot(from[1] + along[1] * share - at[1])
}

/// The parameters from `from` to `to` at which a polynomial with these Bernstein coefficients over that range changes its sign,
/// ascending. It changes it at most as often as the coefficients do (Farouki & Rajan, On the numerical condition of polynomials
/// in Bernstein form, Computer Aided Geometric Design 4, 1987).
fn crossings(coefficients: &[f64], [from, to]: [f64; 2], depth: u32, found: &mut Vec<f64>) {
    let signs = || coefficients.iter().filter(|value| **value != 0.0).map(|value| *value > 0.0);
    let changes = signs().zip(signs().skip(1)).filter(|(one, next)| one != next).count();
    if changes == 0 || depth > MAX_HALVINGS {
        return;
    }
    if changes > 1 {
        let [low, high] = divided(coefficients, 0.5);
        let middle = f64::midpoint(from, to);
        crossings(&low, [from, middle], depth + 1, found);
        // A crossing right at the middle shows in neither half.
        let last = |half: &[f64]| half.iter().rev().find(|value| **value != 0.0).map(|value| *value > 0.0);
        let first = high.iter().find(|value| **value != 0.0).map(|value| *value > 0.0);
        if last(&low).zip(first).is_some_and(|(before, after)| before != after) {
            found.push(middle);
        }
        crossings(&high, [middle, to], depth + 1, found);
        return;
    }
    let starts_positive = signs().next().unwrap_or(true);
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..BISECTIONS {
        let middle = f64::midpoint(low, high);
        let [before, _] = divided(coefficients, middle);
        let value = before[before.len() - 1];
        if (value > 0.0) == starts_positive { low = middle } else { high = middle }
    }
    found.push(from + (to - from) * f64::midpoint(low, high));
}

/// The coefficients below and above a share of the range (de Casteljau).
fn divided(coefficients: &[f64], share: f64) -> [Vec<f64>; 2] {
    let count = coefficients.len();
    let (mut work, mut low, mut high) = (coefficients.to_vec(), Vec::new(), coefficients.to_vec());
    for level in 0..count {
        low.push(work[0]);
        high[count - 1 - level] = work[count - 1 - level];
        for index in 0..count - 1 - level {
            work[index] += (work[index + 1] - work[index]) * share;
        }
    }
    [low, high]
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::geometry::solid::frame::Frame;

    /// The circle round (`off`, 0) in the half plane of x and z, which starts at an angle.
    fn circle(off: f64, radius: f64, start: f64) -> Spline {
        let (x, z) = (Vector3::x(), Vector3::z());
        let frame = Frame { origin: Point3::new(off, 0.0, 0.0), x, y: z, z: -Vector3::y() };
        Spline::arc(&frame, radius, start, start + TAU)
    }

    /// A ring of a face at this distance from the z axis and height, mm.
    fn ring(radius: f64, height: f64) -> Vec<Point3<f64>> {
        (0..12)
            .map(|step| TAU * f64::from(step) / 12.0)
            .map(|angle| Point3::new(radius * angle.cos(), radius * angle.sin(), height))
            .collect()
    }

    #[test]
    fn of_a_circle_that_crosses_the_axis_the_side_of_the_face_is_swept() {
        // Round (−20, 0) with R = 50 mm, the side x > 0 is a barrel of radius 30 mm, the other one an apple of 70 mm.
        for start in [0.0, 0.3, 1.0, 2.0, 3.1, 4.5, 6.0] {
            for (off, reach) in [(-20.0, 30.0), (20.0, 70.0)] {
                let height = 18.0f64;
                let radius = off + (50.0 * 50.0 - height * height).sqrt();
                let around = [ring(radius, height), ring(radius, -height)].concat();
                let kept = circle(-20.0, 50.0, start).one_side(Point3::origin(), Vector3::z_axis(), &around);
                let kept = kept.unwrap();
                let crossing = (50.0f64 * 50.0 - 20.0 * 20.0).sqrt();
                let ends = [kept.breaks[0], kept.breaks[kept.curves.len()]].map(|t| kept.point(t));
                for end in ends {
                    assert!(end.coords.xy().norm() < 1e-9 && (end.z.abs() - crossing).abs() < 1e-9, "{end}");
                }
                assert!((ends[0] - ends[1]).norm() > 1.0, "{start}: {kept:?}");
                let mut largest = 0.0f64;
                for step in 0..=200 {
                    let share = f64::from(step) / 200.0;
                    let (first, last) = (kept.breaks[0], kept.breaks[kept.curves.len()]);
                    let at = kept.point(first + (last - first) * share);
                    assert!(((at.x + 20.0).hypot(at.z) - 50.0).abs() < 1e-9);
                    largest = largest.max(at.x.abs());
                }
                assert!((largest - reach).abs() < 0.05, "{start}: reaches {largest} mm, not {reach}");
            }
        }
    }

    #[test]
    fn a_circle_beside_the_axis_stays_whole_and_a_line_is_cut_at_the_axis() {
        let beside = circle(60.0, 50.0, 1.0);
        let kept = beside.one_side(Point3::origin(), Vector3::z_axis(), &ring(110.0, 0.0)).unwrap();
        assert_eq!(kept, beside);
        let ends = [Point3::new(-10.0, 0.0, -20.0), Point3::new(10.0, 0.0, 20.0)];
        let points = ends.map(|end| end.to_homogeneous()).to_vec();
        let line = Spline { breaks: vec![-1.0, 1.0], curves: vec![BezierCurve { points }] };
        let kept = line.one_side(Point3::origin(), Vector3::z_axis(), &ring(4.0, -8.0)).unwrap();
        assert!((kept.point(kept.breaks[0]) - ends[0]).norm() < 1e-9, "{kept:?}");
        assert!((kept.point(kept.breaks[1]) - Point3::origin()).norm() < 1e-9, "{kept:?}");
    }

    #[test]
    fn a_wave_across_the_axis_leaves_the_run_of_the_face() {
        // x = 8·t·(t − 0.5)·(t − 1) crosses at its ends and in the middle, in a plane with the axis.
        let x = [0.0, 4.0 / 3.0, -4.0 / 3.0, 0.0];
        let control = |(index, x): (usize, f64)| Point3::new(x, 0.0, 10.0 * index as f64).to_homogeneous();
        let points = x.into_iter().enumerate().map(control).collect();
        let wave = Spline { breaks: vec![0.0, 1.0], curves: vec![BezierCurve { points }] };
        let kept = wave.one_side(Point3::origin(), Vector3::z_axis(), &ring(0.38, 24.0)).unwrap();
        assert!((kept.breaks[0] - 0.5).abs() < 1e-9 && kept.breaks[1] == 1.0, "{kept:?}");
    }

    #[test]
    fn a_line_that_is_skew_to_the_axis_sweeps_its_hyperboloid() {
        let points = [Point3::new(5.0, -20.0, -20.0), Point3::new(5.0, 20.0, 20.0)];
        let points = points.map(|end| end.to_homogeneous()).to_vec();
        let line = Spline { breaks: vec![-1.0, 1.0], curves: vec![BezierCurve { points }] };
        assert_eq!(line.one_side(Point3::origin(), Vector3::z_axis(), &ring(5.0, 0.0)).unwrap(), line);
    }
}
