//! A plane curve through points: its normals there, and how far the slope between them may be off.
//!
//! Extruded strips (`curve_strip`) and the profiles of turned faces (`profile`) follow such a curve.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

/// Vertices are on a curve within this share of how far it leaves its chords, where its curvature changes from one to the next.
const OF_BULGE: f64 = 0.5;
/// Points nearer than this share of a chord are one.
const SAME_POINT: f64 = 0.02;
/// A curve has at least this many points.
pub(super) const LEAST_POINTS: usize = 4;
/// Chords beside those at a vertex on which others are looked for.
const BESIDE: usize = 3;
/// Where arcs of different curvature meet, each cut evenly, the normals of cubics are off by a sixth of the
/// turn between two chords. The error of the slope over a chord, root mean square, is this many times the
/// length of the chord times the distance of the curvature beside it from a straight line.
const OF_JUMP: f64 = 0.25;
/// The curvature of points that leave a straight line by less than this, mm, is that of rounded numbers.
const NEGLIGIBLE: f64 = 1e-5;
/// The slope of a curve that leaves another by one unit of length between the ends of a chord of one unit, root mean square.
pub(super) const OF_OFF: f64 = 3.0;

/// A plane curve through points, across an axis.
pub(super) struct PlaneCurve {
    pub(super) axis: Vector3<f64>,
    /// In the order of the curve; the last one is followed by the first one if it is closed.
    pub(super) points: Vec<Point3<f64>>,
    pub(super) normals: Vec<Vector3<f64>>,
    /// How far the slope between a point and the next one may be off, rad, root mean square.
    pub(super) doubts: Vec<f32>,
    /// How far it leaves its chords at most, mm.
    pub(super) largest_bulge: f64,
    pub(super) is_closed: bool,
}

/// A curve with the places of vertices on it.
pub(super) type Placed = (PlaneCurve, BTreeMap<u32, Place>);

/// A place on a curve.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// The chord and the share of it, as the sum of both.
    pub(super) at: f64,
    /// From the curve, mm.
    pub(super) off: f64,
    /// How far it is beyond the ends of the chord, mm.
    pub(super) beyond: f64,
    /// The unit normal of the curve.
    pub(super) normal: Vector3<f64>,
}

impl Place {
    /// The parts of the unit normal of a profile along the axis and away from it.
    pub(super) fn normal_of_profile(&self) -> [f64; 2] {
        [self.normal.x, self.normal.y]
    }

    fn distance(&self) -> f64 {
        self.off.hypot(self.beyond)
    }
}

/// The height of a curve over its chord, whose share is given, with these normals at its ends, and its unit normal; mm.
fn over_chord(
    axis: Vector3<f64>,
    chord: Vector3<f64>,
    normals: [Vector3<f64>; 2],
    share: f64,
) -> Option<(f64, Vector3<f64>)> {
    let length = chord.norm();
    let along = chord.try_normalize(0.0)?;
    let up = axis.cross(&along);
    // The slopes of the curve at both ends, over the share of the chord.
    let [first, last] = normals.map(|normal| -length * normal.dot(&along) / normal.dot(&up));
    let rest = 1.0 - share;
    let height = share * rest * (rest * first - share * last);
    let slope = rest * (1.0 - 3.0 * share) * first - share * (2.0 - 3.0 * share) * last;
    let normal = (up * length - along * slope).try_normalize(0.0)?;
    let side = (normals[0] + normals[1]).dot(&normal).signum();
    height.is_finite().then_some((height, normal * side))
}

/// The unit normal of a curve through points at one of them, and how far it may be off, rad. The normal is
/// the mean of the normals of two cubics: one through the point, two points before and one after it, and one
/// through one point before and two after it, over the lengths of the chords (Floater & Surazhsky,
/// Parameterization for curve interpolation, 2006). It may be off by half of their difference. At an end, the
/// cubic and the parabola are used.
fn normal_at(points: &[Point3<f64>], axis: Vector3<f64>, at: usize, is_closed: bool) -> (Vector3<f64>, f64) {
    let count = points.len();
    let tangent = |first: usize, length: usize| {
        let of: Vec<Point3<f64>> = (first..first + length).map(|index| points[index % count]).collect();
        let mut places = vec![0.0; length];
        for index in 1..length {
            places[index] = places[index - 1] + (of[index] - of[index - 1]).norm();
        }
        let own = (at + count - first) % count;
        let from_own = |index: usize| places[own] - places[index];
        let mut sum = Vector3::zeros();
        for (index, point) in of.iter().enumerate().filter(|(index, _)| *index != own) {
            let others = (0..length).filter(|other| ![index, own].contains(other));
            let share: f64 = others.map(|other| from_own(other) / (places[index] - places[other])).product();
            sum += (point - of[own]) * (share / -from_own(index));
        }
        sum.cross(&axis).try_normalize(0.0).unwrap_or_else(Vector3::zeros)
    };
    let [one, other] = match is_closed {
        true => [tangent(at + count - 2, 4), tangent(at + count - 1, 4)],
        false if at == 0 => [tangent(0, 4), tangent(0, 3)],
        false if at == count - 1 => [tangent(count - 4, 4), tangent(count - 3, 3)],
        false => [tangent((at - 1).min(count - 4), 4), tangent(at.saturating_sub(2), 4)],
    };
    let normal = (one + other).try_normalize(0.0).unwrap_or(one);
    (normal, (one - other).norm() / 2.0)
}

impl PlaneCurve {
    /// The curve through points across an axis. Its outside is that of a strip which runs along the points about the axis.
    pub(super) fn through(points: Vec<Point3<f64>>, axis: Vector3<f64>, is_closed: bool) -> Self {
        let count = points.len();
        let estimates = (0..count).map(|index| normal_at(&points, axis, index, is_closed));
        let (normals, deviations): (Vec<Vector3<f64>>, Vec<f64>) = estimates.unzip();
        let chords = if is_closed { count } else { count - 1 };
        let doubt = |chord: usize| {
            let [one, other] = [deviations[chord], deviations[(chord + 1) % count]];
            one.hypot(other) / 2f64.sqrt()
        };
        let doubts = (0..chords).map(|chord| doubt(chord) as f32).collect();
        let mut curve = Self { axis, points, normals, doubts, largest_bulge: 0.0, is_closed };
        curve.largest_bulge = (0..chords).map(|chord| curve.bulge(chord)).fold(0.0, f64::max);
        curve
    }

    /// The point that is `by` points after the point `at`.
    pub(super) fn around(&self, at: usize, by: isize) -> Option<usize> {
        let count = self.points.len() as isize;
        let moved = at as isize + by;
        let moved = if self.is_closed { moved.rem_euclid(count) } else { moved };
        (0..count).contains(&moved).then_some(moved as usize)
    }

    /// The curvature at a point between two chords, rad/mm.
    fn curvature(&self, at: usize) -> Option<f64> {
        let before = self.chord(self.around(at, -1)?);
        self.around(at, 1)?;
        let after = self.chord(at);
        let angle = before.cross(&after).dot(&self.axis).atan2(before.dot(&after));
        Some(2.0 * angle / (before.norm() + after.norm()))
    }

    /// By how much the curvature at each point leaves a straight line between those beside it, rad/mm, and as a share of the largest of the
    /// three; `None` near the ends.
    pub(super) fn jumps(&self) -> Vec<Option<[f64; 2]>> {
        let jump = |at: usize| {
            let beside = [self.around(at, -1)?, at, self.around(at, 1)?];
            let [before, own, after] = beside.map(|at| self.curvature(at));
            let (before, own, after) = (before?, own?, after?);
            // The curvature of three points is that in the middle of them.
            let lengths = [-2, -1, 0, 1].map(|by| self.around(at, by).map(|at| self.chord(at).norm()));
            let [Some(one), Some(two), Some(three), Some(four)] = lengths else { return None };
            let middles = [(two - one) / 3.0 - two, (three - two) / 3.0, three + (four - three) / 3.0];
            let share = (middles[1] - middles[0]) / (middles[2] - middles[0]);
            let jump = (own - before - (after - before) * share).abs();
            let largest = [before, own, after].into_iter().map(f64::abs).fold(0.0, f64::max);
            let bulge = jump * two.max(three).powi(2) / 8.0;
            Some([jump, if bulge > NEGLIGIBLE { jump / largest } else { 0.0 }])
        };
        (0..self.points.len()).map(jump).collect()
    }

    /// Doubts the slopes round points where the curvature `jumps`, as where an arc begins: cubics may be wrong alike there.
    pub(super) fn doubt_bends(&mut self, jumps: &[Option<[f64; 2]>]) {
        let doubt = |chord: usize| {
            let near = (-1..=2).filter_map(|by| jumps[self.around(chord, by)?]);
            OF_JUMP * near.map(|[jump, _]| jump).fold(0.0, f64::max) * self.chord(chord).norm()
        };
        let doubts: Vec<f64> = (0..self.chords()).map(doubt).collect();
        self.doubts.iter_mut().zip(doubts).for_each(|(own, doubt)| *own = own.max(doubt as f32));
    }

    pub(super) fn chords(&self) -> usize {
        self.doubts.len()
    }

    pub(super) fn chord(&self, index: usize) -> Vector3<f64> {
        self.points[(index + 1) % self.points.len()] - self.points[index]
    }

    /// How far the curve leaves a chord, mm.
    fn bulge(&self, chord: usize) -> f64 {
        let turn = self.normals[(chord + 1) % self.points.len()] - self.normals[chord];
        turn.norm() * self.chord(chord).norm() / 8.0
    }

    /// The same for the arc that the turns to the chords beside it show.
    fn bulge_of_chords(&self, chord: usize) -> f64 {
        let (chords, own) = (self.chords(), self.chord(chord));
        let curvature = |other: usize| {
            let beside = self.chord(other);
            2.0 * own.angle(&beside) / (own.norm() + beside.norm())
        };
        let before = (self.is_closed || chord > 0).then(|| curvature((chord + chords - 1) % chords));
        let after = (self.is_closed || chord + 1 < chords).then(|| curvature((chord + 1) % chords));
        before.into_iter().chain(after).fold(0.0, f64::max) * own.norm_squared() / 8.0
    }

    fn over(&self, chord: usize, at: &Point3<f64>) -> Option<Place> {
        let (step, vector) = (at - self.points[chord], self.chord(chord));
        let length = vector.norm();
        let share = step.dot(&vector) / (length * length);
        let normals = [self.normals[chord], self.normals[(chord + 1) % self.points.len()]];
        let (height, normal) = over_chord(self.axis, vector, normals, share)?;
        let up = self.axis.cross(&vector) / length;
        let beyond = (-share).max(share - 1.0).max(0.0) * length;
        let off = (step.dot(&up) - height).abs();
        Some(Place { at: chord as f64 + share.clamp(0.0, 1.0), off, beyond, normal })
    }

    /// The place of a point on the chords round others.
    pub(super) fn nearest(&self, round: impl Iterator<Item = f64>, at: &Point3<f64>) -> Option<Place> {
        let chords = self.chords();
        let beside = round.flat_map(|place| {
            let first = place as usize + chords - BESIDE.min(chords);
            (first..=first + 2 * BESIDE).filter_map(move |index| match self.is_closed {
                true => Some(index % chords),
                false => index.checked_sub(chords).filter(|index| *index < chords),
            })
        });
        let places = beside.filter_map(|chord| self.over(chord, at));
        places.min_by(|one, other| one.distance().total_cmp(&other.distance()))
    }

    /// The curve through a row of vertices that are given by their places on this one and across the rulings, and the places of its points.
    pub(super) fn through_row(&self, row: &[(f64, Point3<f64>)]) -> Option<(Self, Vec<f64>)> {
        let chord = (0..self.chords()).map(|chord| self.chord(chord).norm()).fold(0.0, f64::max);
        let is_same = |one: &Point3<f64>, other: &Point3<f64>| (other - one).norm() <= SAME_POINT * chord;
        let (mut ats, mut points): (Vec<f64>, Vec<Point3<f64>>) = (Vec::new(), Vec::new());
        for (place, at) in row {
            if points.last().is_none_or(|last| !is_same(last, at)) {
                ats.push(*place);
                points.push(*at);
            }
        }
        if let [first, .., last] = &points[..]
            && self.is_closed
            && is_same(first, last)
        {
            points.pop();
        }
        (points.len() >= LEAST_POINTS).then(|| (Self::through(points, self.axis, self.is_closed), ats))
    }

    /// With vertices whose places on another curve are known, and that are points of it; `None` if one is not
    /// on this curve.
    pub(super) fn with_places(
        self,
        known: &BTreeMap<u32, Place>,
        ats: &[f64],
        flat: impl Fn(u32) -> Point3<f64>,
        near: f64,
    ) -> Option<Placed> {
        let place = |(&vertex, known): (&u32, &Place)| {
            let round = ats.partition_point(|at| *at < known.at) % self.chords();
            Some((vertex, self.place([round as f64].into_iter(), &flat(vertex), near)?))
        };
        let places: Option<BTreeMap<u32, Place>> = known.iter().map(place).collect();
        places.map(|places| self.doubted(places))
    }

    /// With the doubts about the slope that vertices show which it leaves.
    pub(super) fn doubted(mut self, places: BTreeMap<u32, Place>) -> Placed {
        for place in places.values() {
            let chord = (place.at as usize).min(self.chords() - 1);
            let of_off = (OF_OFF * place.off / self.chord(chord).norm()) as f32;
            self.doubts[chord] = self.doubts[chord].max(of_off);
        }
        (self, places)
    }

    /// mm.
    pub(super) fn length(&self) -> f64 {
        (0..self.chords()).map(|chord| self.chord(chord).norm()).sum()
    }

    /// The sum of the squares of its doubts over its length.
    pub(super) fn doubt_of_all(&self) -> f64 {
        let of_chord = |chord: usize| f64::from(self.doubts[chord]).powi(2) * self.chord(chord).norm();
        (0..self.chords()).map(of_chord).sum()
    }

    /// Whether a place is at a point of the curve.
    pub(super) fn is_at_point(&self, place: &Place, near: f64) -> bool {
        let chord = (place.at as usize).min(self.chords() - 1);
        let share = place.at - chord as f64;
        place.off <= near && share.min(1.0 - share) * self.chord(chord).norm() <= near
    }

    /// The place of a point, if it may be on the curve; vertices may be off by `near`, mm.
    pub(super) fn place(
        &self,
        round: impl Iterator<Item = f64>,
        at: &Point3<f64>,
        near: f64,
    ) -> Option<Place> {
        let place = self.nearest(round, at)?;
        let chord = (place.at as usize).min(self.chords() - 1);
        let bulge = self.largest_bulge.max(self.bulge_of_chords(chord));
        (place.beyond <= near && place.off <= near.max(OF_BULGE * bulge)).then_some(place)
    }

    /// The doubt about the slope of a patch between places on the curve, rad: that of the curve there, and how far the slopes of the
    /// points between them are from those of a chord with the normals at its ends.
    pub(super) fn doubt(&self, places: [Place; 3]) -> f32 {
        let (chords, count) = (self.chords(), self.points.len());
        // Seen from the first one, on the shorter way round.
        let half = chords as f64 / 2.0;
        let from_first = places.map(|place| match place.at - places[0].at {
            ahead if self.is_closed && ahead > half => ahead - chords as f64,
            ahead if self.is_closed && ahead < -half => ahead + chords as f64,
            ahead => ahead,
        });
        let by = |one: &usize, other: &usize| from_first[*one].total_cmp(&from_first[*other]);
        let (Some(low), Some(high)) = ([0, 1, 2].into_iter().min_by(by), [0, 1, 2].into_iter().max_by(by))
        else {
            return 0.0;
        };
        let origin = places[0].at + chords as f64;
        let ends = [low, high].map(|end| origin + from_first[end]);
        let range = ends[0].floor() as usize..(ends[1].ceil() as usize).max(ends[0].floor() as usize + 1);
        let of_curve = range.clone().map(|chord| self.doubts[chord % chords]).fold(0.0, f32::max);
        let point = |place: f64| {
            let chord = (place as usize).min(if self.is_closed { usize::MAX } else { 2 * chords - 1 });
            self.points[chord % chords] + self.chord(chord % chords) * (place - chord as f64)
        };
        let [from, to] = ends.map(point);
        let chord = to - from;
        let normals = [places[low].normal, places[high].normal];
        let (mut squares, mut between) = (0.0, 0.0);
        for index in range.skip(1) {
            let index = if self.is_closed { index % count } else { index - chords };
            let share = (self.points[index] - from).dot(&chord) / chord.norm_squared();
            let Some((_, normal)) = over_chord(self.axis, chord, normals, share) else { continue };
            squares += normal.cross(&self.normals[index]).norm_squared();
            between += 1.0;
        }
        let of_patch: f64 = if between > 0.0 { squares / between } else { 0.0 };
        of_curve.hypot(of_patch.sqrt() as f32)
    }
}
