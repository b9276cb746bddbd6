//! The plane curve of which an extruded strip is made, where the strip has rows of vertices inside it.
//!
//! Programs that divide a face as a grid, and its rims at other places, leave facets between both that contain no ruling. Along the
//! rulings, all vertices of such a strip are on one curve nevertheless: that through the columns of the grid, the vertices of the rims,
//! or both, whichever shows its normals best. Facets between the grid and the rims have a vertex of a column and do not face the ends of
//! the strip, as those of a fillet do.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};

use super::SmoothMesh;
use super::ends::{Straight, Surface};
use crate::geometry::adjacency::{facet_normal, sliver_side};
use crate::geometry::disjoint_sets::DisjointSets;

/// Vertices are on a curve within this share of how far it leaves its chords, where its curvature changes from one to the next.
const OF_BULGE: f64 = 0.5;
/// The normals of facets on a strip leave the plane across its rulings by less than this, rad: those between rows that are cut
/// differently lean.
const LEAN: f64 = 0.2;
/// Points nearer than this share of a chord are one.
const SAME_POINT: f64 = 0.02;
/// Points of vertices that do not face each other are one where they are nearer than this share of the mean chord.
const OF_MEAN_CHORD: f64 = 0.3;
/// A curve has so many points, at least.
const LEAST_POINTS: usize = 4;
/// Chords beside those at a vertex on which others are looked for.
const BESIDE: usize = 3;
/// Where arcs of different curvature meet, each cut evenly, the normals of cubics are off by a sixth of the turn between two chords. The
/// error of the slope over a chord, root mean square, is this share of the chord times that by which the curvature beside it leaves a
/// straight line.
const OF_JUMP: f64 = 0.25;
/// On a smooth curve the curvature at a point leaves a straight line between those beside it by less than this share. Where an arc begins,
/// it is a quarter and a half, and half at both ends of an arc that is cut into one facet between straight lines.
const SMOOTH: f64 = 0.2;
/// Unless the chords leave the curve by less than this, mm, for that: a straight line has no curvature but that of rounded numbers.
const NEGLIGIBLE: f64 = 1e-5;
/// The error of the slope between points that are off, as a share of how far they are off over the length of the chord.
const OF_DEVIATION: f64 = 2.0;
/// The slope of a curve that leaves another by one unit of length between the ends of a chord of one unit, root mean square.
const OF_OFF: f64 = 3.0;

/// A plane curve through points, across an axis.
struct PlaneCurve {
    axis: Vector3<f64>,
    /// In the order of the curve; the last one is followed by the first one if it is closed.
    points: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
    /// How far the slope between a point and the next one may be off, rad, root mean square.
    doubts: Vec<f32>,
    /// How far it leaves its chords at most, mm.
    largest_bulge: f64,
    is_closed: bool,
}

/// A curve with the places of vertices on it.
type Placed = (PlaneCurve, BTreeMap<u32, Place>);

/// A place on a curve.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// The chord and the share of it, as the sum of both.
    at: f64,
    /// From the curve, mm.
    off: f64,
    /// How far it is beyond the ends of the chord, mm.
    beyond: f64,
    /// The unit normal of the curve.
    normal: Vector3<f64>,
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

/// The unit normal of a curve through points at one of them, and how far it may be off, rad: the mean of those of the cubics through it
/// and two points before and one after it, or one before and two after, over the lengths of the chords (Floater & Surazhsky,
/// Parameterization for curve interpolation, 2006), and half of what they differ by. At an end, the cubic and the parabola.
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
    fn through(points: Vec<Point3<f64>>, axis: Vector3<f64>, is_closed: bool) -> Self {
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

    /// The point so many points after another one.
    fn around(&self, at: usize, by: isize) -> Option<usize> {
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
    fn jumps(&self) -> Vec<Option<[f64; 2]>> {
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
    fn doubt_bends(&mut self, jumps: &[Option<[f64; 2]>]) {
        let doubt = |chord: usize| {
            let near = (-1..=2).filter_map(|by| jumps[self.around(chord, by)?]);
            OF_JUMP * near.map(|[jump, _]| jump).fold(0.0, f64::max) * self.chord(chord).norm()
        };
        let doubts: Vec<f64> = (0..self.chords()).map(doubt).collect();
        self.doubts.iter_mut().zip(doubts).for_each(|(own, doubt)| *own = own.max(doubt as f32));
    }

    fn chords(&self) -> usize {
        self.doubts.len()
    }

    fn chord(&self, index: usize) -> Vector3<f64> {
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
    fn nearest(&self, round: impl Iterator<Item = f64>, at: &Point3<f64>) -> Option<Place> {
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
    fn through_row(&self, row: &[(f64, Point3<f64>)]) -> Option<(Self, Vec<f64>)> {
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

    /// With vertices whose places on another curve are known, as those of its points are; `None` if one is not on this curve.
    fn with_places(
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
    fn doubted(mut self, places: BTreeMap<u32, Place>) -> Placed {
        for place in places.values() {
            let chord = (place.at as usize).min(self.chords() - 1);
            let of_off = (OF_OFF * place.off / self.chord(chord).norm()) as f32;
            self.doubts[chord] = self.doubts[chord].max(of_off);
        }
        (self, places)
    }

    /// mm.
    fn length(&self) -> f64 {
        (0..self.chords()).map(|chord| self.chord(chord).norm()).sum()
    }

    /// The sum of the squares of its doubts over its length.
    fn doubt_of_all(&self) -> f64 {
        let of_chord = |chord: usize| f64::from(self.doubts[chord]).powi(2) * self.chord(chord).norm();
        (0..self.chords()).map(of_chord).sum()
    }

    /// Whether a place is at a point of the curve.
    fn is_at_point(&self, place: &Place, near: f64) -> bool {
        let chord = (place.at as usize).min(self.chords() - 1);
        let share = place.at - chord as f64;
        place.off <= near && share.min(1.0 - share) * self.chord(chord).norm() <= near
    }

    /// The place of a point, if it may be on the curve; vertices may be off by `near`, mm.
    fn place(&self, round: impl Iterator<Item = f64>, at: &Point3<f64>, near: f64) -> Option<Place> {
        let place = self.nearest(round, at)?;
        let chord = (place.at as usize).min(self.chords() - 1);
        let bulge = self.largest_bulge.max(self.bulge_of_chords(chord));
        (place.beyond <= near && place.off <= near.max(OF_BULGE * bulge)).then_some(place)
    }

    /// The doubt about the slope of a patch between places on the curve, rad: that of the curve there, and how far the slopes of the
    /// points between them are from those of a chord with the normals at its ends.
    fn doubt(&self, places: [Place; 3]) -> f32 {
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

/// The area of some facets as seen along an axis, from that end of a strip which shows more of them, mm². Those between the chords of
/// a row and more chords of a rim face the middle, and those of a fillet an end.
fn facing_ends(
    mesh: &SmoothMesh,
    triangles: impl Iterator<Item = usize>,
    axis: Vector3<f64>,
    [low, high]: [f64; 2],
) -> f64 {
    let mut areas = [0.0; 2];
    for triangle in triangles {
        let [a, b, c] = mesh.corners(triangle).0;
        let facing = (b - a).cross(&(c - a)).dot(&axis) / 2.0;
        let along = (a.coords + b.coords + c.coords).dot(&axis) / 3.0;
        if along > (low + high) / 2.0 { areas[1] += facing } else { areas[0] -= facing }
    }
    areas[0].max(areas[1])
}

/// Where a ring of vertices crosses the profile of a turned face.
#[derive(Clone, Copy)]
pub(super) struct RingPlace {
    /// How far along the axis and from it, mm.
    pub(super) at: [f64; 2],
    /// The standard deviation of that, mm.
    pub(super) deviation: f64,
}

/// The profile of a turned face, through the rings of its vertices.
pub(super) struct Profile {
    curve: PlaneCurve,
    /// The number of points before the first ring.
    before: usize,
    /// For each ring, whether the curvature changes evenly there, as nowhere that an arc begins or is cut into one facet.
    is_smooth: Vec<bool>,
}

impl Profile {
    /// That through rings. Where one at an end is a pole, on the axis, the profile goes on beyond it as its mirror image. `None` if there
    /// are too few rings.
    pub(super) fn through(rings: &[RingPlace], is_closed: bool, is_pole: [bool; 2]) -> Option<Self> {
        let count = rings.len();
        if count < LEAST_POINTS {
            return None;
        }
        let mirrored = |ring: usize| Point3::new(rings[ring].at[0], -rings[ring].at[1], 0.0);
        let beyond =
            |is_pole: bool, next: [usize; 2]| next.map(mirrored).into_iter().filter(move |_| is_pole);
        let mut points: Vec<Point3<f64>> = beyond(is_pole[0], [2, 1]).collect();
        let before = points.len();
        points.extend(rings.iter().map(|ring| Point3::new(ring.at[0], ring.at[1], 0.0)));
        points.extend(beyond(is_pole[1], [count - 2, count - 3]));
        let mut curve = PlaneCurve::through(points, Vector3::z(), is_closed);
        let jumps = curve.jumps();
        curve.doubt_bends(&jumps);
        let is_even = |at: usize, by: isize| {
            let jump = curve.around(at, by).and_then(|at| jumps[at]);
            jump.is_some_and(|[_, share]| share < SMOOTH)
        };
        let is_smooth = (before..before + count).map(|at| (-1..=1).all(|by| is_even(at, by))).collect();
        for (ring, place) in rings.iter().enumerate() {
            let at = before + ring;
            for chord in [at.checked_sub(1), Some(at)].into_iter().flatten() {
                let Some(doubt) = curve.doubts.get(chord).copied() else { continue };
                let of_rounding = OF_DEVIATION * place.deviation / curve.chord(chord).norm();
                curve.doubts[chord] = doubt.max(of_rounding as f32);
            }
        }
        Some(Self { curve, before, is_smooth })
    }

    /// Turns its normals to the other side.
    pub(super) fn turn_over(&mut self) {
        self.curve.normals.iter_mut().for_each(|normal| *normal = -*normal);
    }

    /// Replaces the normals at rings by those that are known.
    pub(super) fn set_known(&mut self, normals: &[Option<[f64; 2]>]) {
        for (own, known) in self.curve.normals[self.before..].iter_mut().zip(normals) {
            if let Some([along, out]) = *known {
                *own = Vector3::new(along, out, 0.0);
            }
        }
    }

    /// The number of its rings.
    pub(super) fn count(&self) -> usize {
        self.is_smooth.len()
    }

    /// Whether the curvature changes evenly at a ring and those beside it.
    pub(super) fn is_smooth(&self, ring: usize) -> bool {
        self.is_smooth[ring]
    }

    /// The place of a ring.
    pub(super) fn at_ring(&self, ring: usize) -> Place {
        let at = self.before + ring;
        Place { at: at as f64, off: 0.0, beyond: 0.0, normal: self.curve.normals[at] }
    }

    /// The place of a vertex with such a distance along the axis and from it, mm, near some others, if it is on the profile as far as
    /// that is known; it may be off by `near`, mm.
    pub(super) fn place(&self, round: &[Place], [along, radius]: [f64; 2], near: f64) -> Option<Place> {
        let place =
            self.curve.nearest(round.iter().map(|place| place.at), &Point3::new(along, radius, 0.0))?;
        let chord = (place.at as usize).min(self.curve.chords() - 1);
        let known = f64::from(self.curve.doubts[chord]) * self.curve.chord(chord).norm() / OF_OFF;
        let last = self.before + self.count() - usize::from(!self.curve.is_closed);
        let is_between = (self.before as f64..=last as f64).contains(&place.at);
        (is_between && place.beyond <= near && place.off <= near.max(known)).then_some(place)
    }

    /// The rings beside a place.
    pub(super) fn rings_beside(&self, place: &Place) -> [usize; 2] {
        // The last chord of a closed profile ends at the first ring.
        [place.at.floor(), place.at.ceil()].map(|at| (at as usize - self.before) % self.count())
    }

    /// How far the slope of the part may be from that of a patch between places, rad.
    pub(super) fn doubt(&self, places: [Place; 3]) -> f32 {
        self.curve.doubt(places)
    }
}

/// A strip whose vertices are on one plane curve, with rows inside it.
pub(super) struct CurveStrip<'a> {
    mesh: &'a SmoothMesh,
    curve: PlaneCurve,
    /// In ascending order.
    triangles: Vec<usize>,
    places: BTreeMap<u32, Place>,
}

impl<'a> CurveStrip<'a> {
    /// The strip that continues some triangles with sides along an axis (`is_ruling`) to rims whose vertices follow each other
    /// differently; `None` if nothing continues them so, or they have no rows. At most so many triangles are looked at. Vertices may be off by
    /// `near`, mm.
    pub(super) fn of(
        mesh: &'a SmoothMesh,
        axis: Vector3<f64>,
        triangles: &[usize],
        is_ruling: impl Fn(usize) -> bool,
        near: f64,
        visits: &mut usize,
    ) -> Option<Self> {
        let rows = Rows::of(mesh, axis, triangles, is_ruling, near)?;
        let along = triangles.iter().flat_map(|&triangle| mesh.corners(triangle).0);
        let heights = along
            .map(|at| at.coords.dot(&axis))
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], along| [low.min(along), high.max(along)]);
        let of_columns = PlaneCurve::through(rows.points, axis, rows.is_closed);
        let columns: BTreeMap<u32, Place> = rows
            .columns
            .iter()
            .map(|(&vertex, &column)| {
                let normal = of_columns.normals[column];
                (vertex, Place { at: column as f64, off: 0.0, beyond: 0.0, normal })
            })
            .collect();
        // Where single columns reach farther than the others, they reach the rims.
        let is_rim = heights.map(|height| {
            let at = columns.keys().map(|&vertex| mesh.positions[vertex as usize].coords.dot(&axis));
            2 * at.filter(|at| (at - height).abs() <= near).count() < of_columns.points.len()
        });
        let is_within = |at: &Point3<f64>| {
            let at = at.coords.dot(&axis);
            (!is_rim[0] || at >= heights[0] - near) && (!is_rim[1] || at <= heights[1] + near)
        };
        let (found, places) = of_columns.continued(mesh, &rows.triangles, &columns, is_within, near, visits);
        let is_new = |triangle: &usize| triangles.binary_search(triangle).is_err();
        let facing_ends = facing_ends(mesh, found.iter().copied().filter(is_new), axis, heights);
        if found.len() <= triangles.len() || facing_ends > near * of_columns.length() {
            return None;
        }
        let flat = |vertex: u32| {
            let at = mesh.positions[vertex as usize];
            at - axis * at.coords.dot(&axis)
        };
        let on = |vertices: &dyn Fn(&u32) -> bool| {
            let chosen = places.iter().filter(|(vertex, _)| vertices(vertex));
            let mut row: Vec<(f64, Point3<f64>)> =
                chosen.map(|(&vertex, place)| (place.at, flat(vertex))).collect();
            row.sort_by(|one, other| one.0.total_cmp(&other.0));
            let (curve, ats) = of_columns.through_row(&row)?;
            curve.with_places(&places, &ats, flat, near)
        };
        let of_rims = on(&|vertex| !columns.contains_key(vertex));
        let of_all = on(&|_| true);
        let of_columns = of_columns.doubted(places);
        let better = |one: Placed, other: Placed| {
            if one.0.doubt_of_all() <= other.0.doubt_of_all() { one } else { other }
        };
        let (curve, places) = of_rims.into_iter().chain(of_all).fold(of_columns, better);
        Some(Self { mesh, curve, triangles: found, places })
    }

    /// The strip of some triangles, in ascending order, with the curve through all their vertices, which are given in its order across
    /// an axis; `None` if there are too few.
    pub(super) fn of_all(
        mesh: &'a SmoothMesh,
        axis: Vector3<f64>,
        triangles: &[usize],
        vertices: &[u32],
    ) -> Option<Self> {
        let flat = |vertex: u32| {
            let at = mesh.positions[vertex as usize];
            at - axis * at.coords.dot(&axis)
        };
        let all: Vec<Point3<f64>> = vertices.iter().map(|&vertex| flat(vertex)).collect();
        let length: f64 = all.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
        let apart = OF_MEAN_CHORD * length / all.len().max(1) as f64;
        // Those that nearly coincide are one, in their middle.
        let mut points: Vec<Vec<Point3<f64>>> = Vec::new();
        let mut point_of = Vec::new();
        for point in all {
            match points.last_mut() {
                Some(same) if (point - same[0]).norm() < apart => same.push(point),
                _ => points.push(vec![point]),
            }
            point_of.push(points.len() - 1);
        }
        let middle = |same: Vec<Point3<f64>>| {
            let sum: Vector3<f64> = same.iter().map(|point| point.coords).sum();
            Point3::from(sum / same.len() as f64)
        };
        let points: Vec<Point3<f64>> = points.into_iter().map(middle).collect();
        if points.len() < LEAST_POINTS {
            return None;
        }
        let curve = PlaneCurve::through(points, axis, false);
        let place = |(&vertex, &point): (&u32, &usize)| {
            Some((vertex, curve.nearest([point as f64].into_iter(), &flat(vertex))?))
        };
        let places: Option<BTreeMap<u32, Place>> = vertices.iter().zip(&point_of).map(place).collect();
        let (curve, places) = curve.doubted(places?);
        Some(Self { mesh, curve, triangles: triangles.to_vec(), places })
    }

    /// The vertices, in ascending order, with their normals.
    pub(super) fn normals(&self) -> (Vec<u32>, Vec<Vector3<f64>>) {
        self.places.iter().map(|(vertex, place)| (*vertex, place.normal)).unzip()
    }

    /// For each triangle, how far the slope of the part may be from that of its patch, rad.
    pub(super) fn doubts(&self) -> Vec<f32> {
        let doubt = |&triangle: &usize| {
            let places = self.mesh.triangles[triangle].map(|vertex| self.places.get(&vertex).copied());
            match places {
                [Some(one), Some(two), Some(three)] => self.curve.doubt([one, two, three]),
                _ => 0.0,
            }
        };
        self.triangles.iter().map(doubt).collect()
    }

    fn places_of(&self, side: usize) -> impl Iterator<Item = Place> {
        let corners = self.mesh.triangles[side / 3];
        let ends = [corners[side % 3], corners[(side % 3 + 1) % 3]];
        ends.map(|end| self.places.get(&end).copied()).into_iter().flatten()
    }
}

impl PlaneCurve {
    /// The triangles, in ascending order, that continue some of which all vertices have places, and the places of all. Each has a
    /// vertex on a ruling, or only vertices with places.
    fn continued(
        &self,
        mesh: &SmoothMesh,
        triangles: &[usize],
        columns: &BTreeMap<u32, Place>,
        is_within: impl Fn(&Point3<f64>) -> bool,
        near: f64,
        visits: &mut usize,
    ) -> (Vec<usize>, BTreeMap<u32, Place>) {
        let flat = |vertex: u32| {
            let at = mesh.positions[vertex as usize];
            at - self.axis * at.coords.dot(&self.axis)
        };
        let mut found: BTreeSet<usize> = triangles.iter().copied().collect();
        let mut front = triangles.to_vec();
        let mut places = columns.clone();
        while let Some(here) = front.pop() {
            for side in 3 * here..3 * here + 3 {
                let Some(there) = mesh.continuing(side).map(|other| other / 3) else { continue };
                if *visits == 0 || found.contains(&there) {
                    continue;
                }
                *visits -= 1;
                let corners = mesh.triangles[there];
                let is_placed = corners.iter().all(|vertex| places.contains_key(vertex));
                let has_ruling = corners.iter().any(|vertex| {
                    places.get(vertex).is_some_and(|place| self.is_at_point(place, 4.0 * near))
                });
                if !(is_placed || has_ruling && mesh.corners(there).0.iter().all(&is_within)) {
                    continue;
                }
                let normal = facet_normal(mesh.corners(there).0);
                let is_sliver = sliver_side(mesh.corners(there).0).is_some();
                if !is_sliver && normal.dot(&self.axis).abs() >= LEAN {
                    continue;
                }
                let known: Vec<f64> =
                    corners.iter().filter_map(|vertex| places.get(vertex).map(|place| place.at)).collect();
                let new: Option<Vec<(u32, Place)>> = corners
                    .iter()
                    .filter(|vertex| !places.contains_key(vertex))
                    .map(|&vertex| Some((vertex, self.place(known.iter().copied(), &flat(vertex), near)?)))
                    .collect();
                let Some(new) = new else { continue };
                places.extend(new);
                found.insert(there);
                front.push(there);
            }
        }
        (found.into_iter().collect(), places)
    }
}

impl Surface for CurveStrip<'_> {
    fn triangles(&self) -> &[usize] {
        &self.triangles
    }

    fn outward(&self, side: usize) -> Vector3<f64> {
        let sum: Vector3<f64> = self.places_of(side).map(|place| place.normal).sum();
        sum.try_normalize(0.0).unwrap_or(sum)
    }

    fn largest_bulge(&self) -> f64 {
        self.curve.largest_bulge
    }
}

impl Straight for CurveStrip<'_> {
    fn ruling(&self, _: &Point3<f64>) -> Vector3<f64> {
        self.curve.axis
    }

    fn distance(&self, side: usize, at: &Point3<f64>) -> f64 {
        let flat = at - self.curve.axis * at.coords.dot(&self.curve.axis);
        let nearest = self.curve.nearest(self.places_of(side).map(|place| place.at), &flat);
        nearest.map_or(0.0, |place| place.off)
    }

    fn doubt(&self, side: usize) -> f64 {
        let of_place = |place: Place| {
            let chord = (place.at as usize).min(self.curve.chords() - 1);
            f64::from(self.curve.doubts[chord]) * self.curve.chord(chord).norm() / OF_OFF
        };
        self.places_of(side).map(of_place).fold(0.0, f64::max)
    }
}

/// The columns of vertices along the rulings of a strip, in the order of its curve.
struct Rows {
    /// Across the rulings.
    points: Vec<Point3<f64>>,
    /// Of each vertex.
    columns: BTreeMap<u32, usize>,
    /// Those between columns.
    triangles: Vec<usize>,
    is_closed: bool,
}

impl Rows {
    /// `None` where the columns are not in one order.
    fn of(
        mesh: &SmoothMesh,
        axis: Vector3<f64>,
        triangles: &[usize],
        is_ruling: impl Fn(usize) -> bool,
        near: f64,
    ) -> Option<Self> {
        let mut vertices: Vec<u32> =
            triangles.iter().flat_map(|&triangle| mesh.triangles[triangle]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let index = |vertex: u32| vertices.binary_search(&vertex).unwrap_or_default();
        let ends = |side: usize| {
            let corners = mesh.triangles[side / 3];
            [corners[side % 3], corners[(side % 3 + 1) % 3]].map(index)
        };
        let sides = || triangles.iter().flat_map(|&triangle| 3 * triangle..3 * triangle + 3);
        let mut sets = DisjointSets::new(vertices.len());
        for side in sides().filter(|&side| is_ruling(side)) {
            let [one, other] = ends(side);
            sets.join(one, other);
        }
        let (set_of, sets) = sets.numbered();
        let mut sizes = vec![0usize; sets];
        set_of.iter().for_each(|&set| sizes[set as usize] += 1);
        // A vertex by itself is one of a rim.
        let mut count = 0;
        let numbers: Vec<Option<usize>> = sizes
            .into_iter()
            .map(|size| {
                count += usize::from(size > 1);
                (size > 1).then(|| count - 1)
            })
            .collect();
        if count < LEAST_POINTS {
            return None;
        }
        let column = |vertex: usize| numbers[set_of[vertex] as usize];
        let mut points: Vec<Option<Point3<f64>>> = vec![None; count];
        for (vertex, &at) in vertices.iter().enumerate() {
            let Some(column) = column(vertex) else { continue };
            let at = mesh.positions[at as usize];
            let flat = at - axis * at.coords.dot(&axis);
            let first = points[column].get_or_insert(flat);
            if (flat - *first).norm() > 4.0 * near {
                return None;
            }
        }
        let triangles: Vec<usize> = triangles
            .iter()
            .copied()
            .filter(|&triangle| {
                mesh.triangles[triangle].iter().all(|&vertex| column(index(vertex)).is_some())
            })
            .collect();
        let of_side = |side: usize| {
            let [one, other] = ends(side).map(column);
            Some([one?, other?])
        };
        let mut beside: Vec<[usize; 2]> = triangles
            .iter()
            .flat_map(|&triangle| 3 * triangle..3 * triangle + 3)
            .filter_map(of_side)
            .filter(|[one, other]| one != other)
            .flat_map(|[one, other]| [[one, other], [other, one]])
            .collect();
        beside.sort_unstable();
        beside.dedup();
        let neighbours = |column: usize| {
            let first = beside.partition_point(|pair| pair[0] < column);
            beside[first..].iter().take_while(move |pair| pair[0] == column).map(|pair| pair[1])
        };
        if (0..count).any(|column| neighbours(column).count() > 2) {
            return None;
        }
        let end = (0..count).find(|&column| neighbours(column).count() < 2);
        let mut order = vec![end.unwrap_or(0)];
        let mut is_in = vec![false; count];
        is_in[order[0]] = true;
        while let Some(next) = neighbours(order[order.len() - 1]).find(|&next| !is_in[next]) {
            is_in[next] = true;
            order.push(next);
        }
        if order.len() < count {
            return None;
        }
        // The facets show the outside.
        let mut rank = vec![0; count];
        order.iter().enumerate().for_each(|(place, &column)| rank[column] = place);
        let ahead: f64 = triangles
            .iter()
            .map(|&triangle| {
                let corners = mesh.corners(triangle).0;
                let ranks =
                    mesh.triangles[triangle].map(|vertex| column(index(vertex)).map(|column| rank[column]));
                let normal = facet_normal(corners);
                [[0, 1], [1, 2], [2, 0]]
                    .into_iter()
                    .filter(|&[one, other]| ranks[one].map(|rank| rank + 1) == ranks[other])
                    .map(|[one, other]| (corners[other] - corners[one]).cross(&axis).dot(&normal))
                    .sum::<f64>()
            })
            .sum();
        if ahead < 0.0 {
            order.reverse();
            order.iter().enumerate().for_each(|(place, &column)| rank[column] = place);
        }
        let columns = vertices
            .iter()
            .enumerate()
            .filter_map(|(index, &vertex)| Some((vertex, rank[column(index)?])))
            .collect();
        let points = order.iter().map(|&column| points[column].unwrap_or(Point3::origin())).collect();
        Some(Self { points, columns, triangles, is_closed: end.is_none() })
    }
}
