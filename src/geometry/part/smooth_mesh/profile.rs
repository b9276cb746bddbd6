//! The profile of a turned face, as a plane curve through the rings of its vertices.

use nalgebra::{Point3, Vector3};

use super::plane_curve::{LEAST_POINTS, OF_OFF, Place, PlaneCurve};

/// On a smooth curve, the curvature at a point leaves a straight line between the curvatures beside it by
/// less than this share. Where an arc begins, the shares are a quarter and a half. At both ends of an arc
/// that is cut into one facet between straight lines, they are a half.
const SMOOTH: f64 = 0.2;
/// The error of the slope between points that are off, as a share of their distance off divided by the length
/// of the chord.
const OF_DEVIATION: f64 = 2.0;

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
