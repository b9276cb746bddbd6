//! The fixture from what a person sees: the field coordinates at which known points of the part are hit, or points that are
//! hit along its edges.

use nalgebra::{DMatrix, DVector, Point3, Rotation3, Vector2, Vector3};

use super::least_squares::{self, Solution};
use super::{Fixture, Lens, ScanHead};
use crate::geometry::space::FieldPoint;

/// Points closer to a line than this share of its length are on it.
const ON_LINE: f64 = 0.05;
/// Smallest angle between two edges, rad.
const SMALLEST_ANGLE: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Contacts that show the height worse than this do not show it, mm.
const WORST_HEIGHT: f64 = 2.0;
/// How far the height of a part may be from that of the settings if no height is given, mm, as a standard
/// deviation. The uncertainties of the other unknowns contain it.
const ASSUMED_HEIGHT: f64 = 20.0;
/// A point contradicts the others if they fit better by this ratio without it, and if it is this far away,
/// mm.
const CONTRADICTS: (f64, f64) = (5.0, 0.5);
/// Contacts that deviate by more than this many standard deviations of the readings are not on one part.
const MOST_DEVIATION: f64 = 10.0;
/// A tilt of the part explains the scatter of the contacts if it makes it at least this many times smaller.
/// [`SURE`] must hold, too.
const EXPLAINS: f64 = 2.0;
/// A tilt of the part explains the scatter of the contacts if it is at least this many of its standard
/// deviations. [`EXPLAINS`] must hold, too.
const SURE: f64 = 3.0;
/// Largest number of contacts.
const MOST_CONTACTS: usize = 200;
/// With this number of spare values, their residuals show how well was measured.
const ENOUGH_SPARE: usize = 4;
/// With this number of spare values, a tilt can be distinguished from a mistake.
const ENOUGH_TO_CHECK: usize = 3;
/// Rotations from which the search starts when points do not show one.
const STARTS: u32 = 12;
/// Steps of the numerical derivatives: x and y, mm; rotation, rad; height, mm.
const STEPS: [f64; 4] = [1e-4, 1e-4, 1e-6, 1e-3];
/// The same of a tilt, rad.
const STEP_OF_TILT: f64 = 1e-6;

/// A point of the part and where the beam hits it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The point in the view, mm.
    pub view: Point3<f64>,
    /// The point of the field whose beam hits it.
    pub hit: FieldPoint,
}

/// A straight edge of the part and a point of the field whose beam hits it somewhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeContact {
    /// Two points of the edge in the view, mm; it may be hit beyond them.
    pub ends: [Point3<f64>; 2],
    /// The point of the field.
    pub hit: FieldPoint,
}

/// What was seen.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Contacts {
    /// Points.
    pub points: Vec<Contact>,
    /// Points along edges.
    pub edges: Vec<EdgeContact>,
    /// Standard deviation of one observation, mm; used while too few show it.
    pub reading: f64,
}

/// How the height of the fixture is found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Height {
    /// It is this, mm.
    Known(f64),
    /// From the contacts if they show it. Otherwise near this, mm; the uncertainties then contain that it is not known.
    Unknown(f64),
}

/// A height that contacts do not show and that is not given.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct AssumedHeight {
    /// By how much x and y move for each mm that the part is higher.
    pub shift: Vector2<f64>,
}

/// The fixture that fits the contacts best.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Registration {
    /// The fixture.
    pub fixture: Fixture,
    /// Standard deviations of x, y and the rotation, mm and rad.
    pub deviations: [f64; 3],
    /// Standard deviation of the height, mm; `None` if it was given, or has no effect under this lens.
    pub height_deviation: Option<f64>,
    /// Whether the height is little more than an assumption; `None` if it was given or found, or has no effect.
    pub assumed_height: Option<AssumedHeight>,
    /// The tilt of the part that would explain most of the scatter, rad; `None` if a tilt does not.
    pub tilt: Option<f64>,
    /// For each point, seen minus fitted, mm in the field.
    pub residuals: Vec<Vector2<f64>>,
    /// For each contact with an edge, its distance from the fitted edge, mm in the field.
    pub edge_residuals: Vec<f64>,
    /// Standard deviation of one observation, mm.
    pub reading: f64,
    /// The number of values beyond those that are needed.
    pub spare: usize,
    /// The index of a point that contradicts the others and was left out.
    pub left_out: Option<usize>,
}

/// Why contacts give no fixture.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RegistrationError {
    /// Fewer points than needed, and no edges.
    #[error("there are {count} points, and 3 are needed")]
    TooFew {
        /// Their number.
        count: usize,
    },
    /// More contacts than a person finds.
    #[error("there are {count} points, and at most 200 are used")]
    TooMany {
        /// Their number.
        count: usize,
    },
    /// The points are on a line.
    #[error("all points are within {width:.2} mm of one line")]
    OnLine {
        /// The largest distance of a point from the line, mm.
        width: f64,
        /// The distance that would be enough, mm.
        needed: f64,
    },
    /// The edges do not fix the part.
    #[error("the edges are nearly parallel, at {degrees:.1} deg")]
    Parallel {
        /// The largest angle between two of them, deg.
        degrees: f64,
    },
    /// The part and the field are mirror images.
    #[error(
        "the points in the field are a mirror image of those on the part; x and y seem swapped, or a sign is wrong"
    )]
    Mirrored,
    /// A point of the part is above the lens.
    #[error("the part reaches up to {height:.1} mm, and the lens is at {lens:.1} mm")]
    AboveLens {
        /// The height of the highest point, mm.
        height: f64,
        /// That of the lens, mm.
        lens: f64,
    },
    /// The contacts do not belong to one part.
    #[error("the points contradict each other by {deviation:.2} mm")]
    Contradictory {
        /// Standard deviation of an observation, mm.
        deviation: f64,
        /// The index of the worst point, if there are points.
        worst: Option<usize>,
    },
    /// The search did not end.
    #[error("no fixture fits the points")]
    NotFound,
}

impl Registration {
    /// The fit.
    ///
    /// # Errors
    /// When the contacts do not determine the fixture or contradict each other; see [`RegistrationError`].
    pub fn fit(contacts: &Contacts, head: &ScanHead, height: Height) -> Result<Self, RegistrationError> {
        check(contacts)?;
        let (Height::Known(z) | Height::Unknown(z)) = height;
        let lens = head.lens.height();
        let ends = contacts.edges.iter().flat_map(|edge| edge.ends);
        let highest = contacts.points.iter().map(|point| point.view).chain(ends).map(|view| view.z + z);
        let highest = highest.fold(f64::NEG_INFINITY, f64::max);
        if highest >= lens {
            return Err(RegistrationError::AboveLens { height: highest, lens });
        }
        let problem = Problem { head, z };
        let solve = |contacts: &Contacts| problem.solve(contacts, height);
        let all = solve(contacts)?;
        let deviation = all.deviation(contacts);
        let (points, spare) = (&contacts.points, all.solution.spare());
        let mut left_out = None;
        // Without one point there must be enough to check the others.
        if points.len() >= 4 && spare >= 4 {
            let without = |index: usize| {
                let mut contacts = contacts.clone();
                contacts.points.remove(index);
                let found = solve(&contacts).ok().filter(|_| check(&contacts).is_ok())?;
                Some((index, found.deviation(&contacts).max(1e-6), found))
            };
            let best = (0..points.len()).filter_map(without).min_by(|one, other| one.1.total_cmp(&other.1));
            left_out = best.filter(|(index, others, found)| {
                let away = problem
                    .miss(&found.unknowns(), &points[*index])
                    .map_or(f64::INFINITY, |miss| miss.norm());
                deviation > CONTRADICTS.0 * others && away > CONTRADICTS.1
            });
        }
        let (index, used, found) = match left_out {
            Some((index, _, found)) => {
                let mut used = contacts.clone();
                used.points.remove(index);
                (Some(index), used, found)
            }
            None => (None, contacts.clone(), all),
        };
        let deviation = found.deviation(&used);
        if deviation > MOST_DEVIATION * contacts.reading {
            let miss = |index: &usize| {
                problem.miss(&found.unknowns(), &points[*index]).map_or(f64::INFINITY, |miss| miss.norm())
            };
            let worst = (0..points.len()).max_by(|one, other| miss(one).total_cmp(&miss(other)));
            return Err(RegistrationError::Contradictory { deviation, worst });
        }
        let unknowns = found.unknowns();
        // The assumed height is as uncertain as ever, however well the contacts agree.
        let scatter =
            if found.height == HeightIs::Assumed { deviation.max(contacts.reading) } else { deviation };
        let known = |unknown: usize| found.solution.uncertainty(unknown, scatter);
        let [x, y, rotation, z] = unknowns;
        let rotation = rotation.sin().atan2(rotation.cos());
        let residual = |point: &Contact| problem.miss(&unknowns, point).unwrap_or(Vector2::repeat(f64::NAN));
        let beside = |edge: &EdgeContact| problem.beside(&unknowns, edge).unwrap_or(f64::NAN);
        Ok(Self {
            fixture: Fixture { x, y, z, rotation },
            deviations: [known(0), known(1), known(2)],
            height_deviation: (found.height != HeightIs::Fixed).then(|| known(3)),
            assumed_height: (found.height == HeightIs::Assumed).then(|| {
                let covariance = &found.solution.covariance;
                let with_height = |unknown: usize| covariance[(unknown, 3)] / covariance[(3, 3)];
                AssumedHeight { shift: Vector2::new(with_height(0), with_height(1)) }
            }),
            tilt: problem.tilt(&used, &found),
            residuals: points.iter().map(residual).collect(),
            edge_residuals: contacts.edges.iter().map(beside).collect(),
            reading: deviation,
            spare: found.solution.spare(),
            left_out: index,
        })
    }
}

/// Whether the contacts fix a part: three points in a triangle, or two edges at an angle.
fn check(contacts: &Contacts) -> Result<(), RegistrationError> {
    let Contacts { points, edges, .. } = contacts;
    let count = points.len() + edges.len();
    if count > MOST_CONTACTS {
        return Err(RegistrationError::TooMany { count });
    }
    if edges.is_empty() {
        if points.len() < 3 {
            return Err(RegistrationError::TooFew { count: points.len() });
        }
        // The field's points matter as much: all may be typed for the same corner.
        on_line(points.iter().map(|point| point.view.coords.xy()).collect())?;
        on_line(points.iter().map(|point| point.hit.coords()).collect())?;
        let matrix = DMatrix::from_fn(points.len(), 3, |row, column| match column {
            0 => 1.0,
            column => points[row].view[column - 1],
        });
        let along = |axis: usize| {
            let hits =
                DVector::from_iterator(points.len(), points.iter().map(|point| point.hit.coords()[axis]));
            least_squares::linear(&matrix, &hits).map(|found| found.unknowns)
        };
        if let (Some(x), Some(y)) = (along(0), along(1))
            && x[1] * y[2] - x[2] * y[1] < 0.0
        {
            return Err(RegistrationError::Mirrored);
        }
        return Ok(());
    }
    let direction = |edge: &EdgeContact| (edge.ends[1] - edge.ends[0]).xy().try_normalize(1e-6);
    let directions: Vec<Vector2<f64>> = edges.iter().filter_map(direction).collect();
    let angles = directions
        .iter()
        .flat_map(|one| directions.iter().map(move |other| one.perp(other).abs().min(1.0).asin()));
    let angle = angles.fold(0.0, f64::max);
    // One point beside an edge fixes the part along the edge.
    if angle < SMALLEST_ANGLE && points.is_empty() {
        return Err(RegistrationError::Parallel { degrees: angle.to_degrees() });
    }
    if 2 * points.len() + edges.len() < 3 {
        return Err(RegistrationError::TooFew { count: points.len() });
    }
    Ok(())
}

fn on_line(points: Vec<Vector2<f64>>) -> Result<(), RegistrationError> {
    let far = |from: &Vector2<f64>| {
        points.iter().copied().max_by(|a, b| (a - from).norm().total_cmp(&(b - from).norm())).unwrap_or(*from)
    };
    let Some(first) = points.first() else { return Ok(()) };
    let one = far(first);
    let other = far(&one);
    let length = (other - one).norm();
    let width = match (other - one).try_normalize(1e-9) {
        Some(along) => points.iter().map(|at| along.perp(&(at - one)).abs()).fold(0.0, f64::max),
        None => 0.0,
    };
    let needed = (ON_LINE * length).max(1.0);
    if width < needed { Err(RegistrationError::OnLine { width, needed }) } else { Ok(()) }
}

struct Problem<'a> {
    head: &'a ScanHead,
    z: f64,
}

/// Where a height comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum HeightIs {
    /// It was given, or has no effect.
    Fixed,
    /// The contacts show it.
    Found,
    /// Mostly from the settings.
    Assumed,
}

struct Found {
    solution: Solution,
    height: HeightIs,
    z: f64,
}

impl Found {
    /// x, y, rotation and z.
    fn unknowns(&self) -> [f64; 4] {
        let found = &self.solution.unknowns;
        [found[0], found[1], found[2], if self.height == HeightIs::Fixed { self.z } else { found[3] }]
    }

    fn deviation(&self, contacts: &Contacts) -> f64 {
        match self.solution.deviation() {
            Some(deviation) if self.solution.spare() >= ENOUGH_SPARE => deviation,
            Some(deviation) => deviation.max(contacts.reading),
            None => contacts.reading,
        }
    }
}

impl Problem<'_> {
    fn aim(&self, unknowns: &[f64], view: Point3<f64>) -> Option<Vector2<f64>> {
        let z = unknowns.get(3).copied().unwrap_or(self.z);
        let fixture = Fixture { x: unknowns[0], y: unknowns[1], z, rotation: unknowns[2] };
        self.head.aim(fixture.point(view)).map(FieldPoint::coords)
    }

    /// Seen minus fitted.
    fn miss(&self, unknowns: &[f64], point: &Contact) -> Option<Vector2<f64>> {
        Some(point.hit.coords() - self.aim(unknowns, point.view)?)
    }

    /// The distance of the hit from the image of the edge, mm in the field.
    fn beside(&self, unknowns: &[f64], edge: &EdgeContact) -> Option<f64> {
        self.on_edge(unknowns, edge).map(|(_, distance)| distance)
    }

    /// Where along the edge the hit is, from 0 to 1 between its two points, and its distance from the image of the edge.
    fn on_edge(&self, unknowns: &[f64], edge: &EdgeContact) -> Option<(f64, f64)> {
        let [from, to] = edge.ends;
        let image = |t: f64| self.aim(unknowns, from + (to - from) * t);
        let (mut t, hit) = (0.5, edge.hit.coords());
        let mut along = Vector2::zeros();
        let mut at = image(t)?;
        // The image is nearly straight.
        for _ in 0..8 {
            along = (image(t + 1e-3)? - image(t - 1e-3)?) / 2e-3;
            t += along.dot(&(hit - at)) / along.norm_squared().max(1e-12);
            // Far beyond its ends an edge may leave the part's height.
            t = t.clamp(-20.0, 21.0);
            at = image(t)?;
        }
        Some((t, along.try_normalize(1e-12)?.perp(&(hit - at))))
    }

    /// By how much hits are beyond the two points of their edges, in lengths of the edges. A part that is turned by 180 deg
    /// may meet the same lines, but beyond its edges.
    fn overshoot(&self, unknowns: &[f64], contacts: &Contacts) -> f64 {
        let beyond = |edge: &EdgeContact| {
            self.on_edge(unknowns, edge).map_or(f64::INFINITY, |(t, _)| (-t).max(t - 1.0).max(0.0))
        };
        contacts.edges.iter().map(beyond).sum()
    }

    fn residuals(&self, contacts: &Contacts, unknowns: &[f64]) -> Option<Vec<f64>> {
        let mut residuals = Vec::with_capacity(2 * contacts.points.len() + contacts.edges.len());
        for point in &contacts.points {
            residuals.extend(self.miss(unknowns, point)?.iter());
        }
        for edge in &contacts.edges {
            residuals.push(self.beside(unknowns, edge)?);
        }
        Some(residuals)
    }

    fn solve(&self, contacts: &Contacts, height: Height) -> Result<Found, RegistrationError> {
        let without = self.search(contacts).ok_or(RegistrationError::NotFound)?;
        let fixed = Found { solution: without, height: HeightIs::Fixed, z: self.z };
        if matches!(height, Height::Known(_)) || self.head.lens == Lens::Telecentric {
            return Ok(fixed);
        }
        let mut start = fixed.solution.unknowns.as_slice().to_vec();
        start.push(self.z);
        let free = least_squares::nonlinear(&start, &STEPS, |at| self.residuals(contacts, at));
        let is_found = |free: &Solution| free.uncertainty(3, contacts.reading) <= WORST_HEIGHT;
        if let Some(solution) = free.filter(is_found) {
            return Ok(Found { solution, height: HeightIs::Found, z: self.z });
        }
        if !self.height_matters(contacts, fixed.solution.unknowns.as_slice()) {
            return Ok(fixed);
        }
        // The assumption as one more observation, so that all uncertainties follow from it.
        let share = contacts.reading / ASSUMED_HEIGHT;
        let assumed = least_squares::nonlinear(&start, &STEPS, |at| {
            let mut residuals = self.residuals(contacts, at)?;
            residuals.push((self.z - at[3]) * share);
            Some(residuals)
        });
        let solution = assumed.ok_or(RegistrationError::NotFound)?;
        Ok(Found { solution, height: HeightIs::Assumed, z: self.z })
    }

    /// The tilt of the part, about any direction across the laser's axis, with which the contacts scatter much less.
    fn tilt(&self, contacts: &Contacts, found: &Found) -> Option<f64> {
        let deviation = found.solution.deviation()?;
        let mut start = found.solution.unknowns.as_slice().to_vec();
        let height = start.len() - 3;
        start.extend([0.0, 0.0]);
        let steps: Vec<f64> = STEPS.into_iter().take(3 + height).chain([STEP_OF_TILT; 2]).collect();
        let solution = least_squares::nonlinear(&start, &steps, |at| {
            let (pose, tilt) = at.split_at(at.len() - 2);
            let turn = Rotation3::from_scaled_axis(Vector3::new(tilt[0], tilt[1], 0.0));
            let points = contacts.points.iter().map(|point| Contact { view: turn * point.view, ..*point });
            let edges = contacts
                .edges
                .iter()
                .map(|edge| EdgeContact { ends: edge.ends.map(|end| turn * end), ..*edge });
            let tilted = Contacts { points: points.collect(), edges: edges.collect(), ..contacts.clone() };
            let mut residuals = self.residuals(&tilted, pose)?;
            if found.height == HeightIs::Assumed {
                residuals.push((self.z - pose[3]) * contacts.reading / ASSUMED_HEIGHT);
            }
            Some(residuals)
        })?;
        let remaining = solution.deviation().filter(|_| solution.spare() >= ENOUGH_TO_CHECK)?;
        let first = start.len() - 2;
        let size = solution.unknowns[first].hypot(solution.unknowns[first + 1]);
        let known =
            [first, first + 1].map(|index| solution.uncertainty(index, remaining.max(contacts.reading)));
        (EXPLAINS * remaining < deviation && size > SURE * known[0].hypot(known[1])).then_some(size)
    }

    /// Whether a height that may be anywhere near the assumed one changes where a contact is hit.
    fn height_matters(&self, contacts: &Contacts, unknowns: &[f64]) -> bool {
        let [x, y, rotation, ..] = *unknowns else { return false };
        let views = contacts.points.iter().map(|point| point.view);
        let mut views = views.chain(contacts.edges.iter().flat_map(|edge| edge.ends));
        views.any(|view| {
            let at = |z: f64| self.aim(&[x, y, rotation, z], view);
            match (at(self.z), at(self.z - ASSUMED_HEIGHT)) {
                (Some(here), Some(lower)) => (here - lower).norm() > contacts.reading,
                // Beams are not known there.
                _ => true,
            }
        })
    }

    /// The best solution from all starts.
    fn search(&self, contacts: &Contacts) -> Option<Solution> {
        let turns = f64::from(STARTS);
        let seen = contacts.points.iter().map(|point| (point.view, point.hit));
        let middle = |edge: &EdgeContact| (edge.ends[0] + (edge.ends[1] - edge.ends[0]) * 0.5, edge.hit);
        let pairs: Vec<_> = seen.chain(contacts.edges.iter().map(middle)).collect();
        let count = pairs.len().max(1) as f64;
        let views = pairs.iter().map(|(view, _)| view.coords).sum::<Vector3<f64>>() / count;
        let hits = pairs.iter().map(|(_, hit)| hit.coords()).sum::<Vector2<f64>>() / count;
        let found = (0..STARTS).filter_map(|start| {
            let rotation = f64::from(start) / turns * std::f64::consts::TAU;
            let moved = Fixture { rotation, ..Fixture::default() }.point(views.into());
            let at = self.head.cast(hits.into(), self.z + views.z);
            let start = [at.x - moved.x, at.y - moved.y, rotation];
            least_squares::nonlinear(&start, &STEPS[..3], |at| self.residuals(contacts, at))
        });
        let rank = |found: &Solution| {
            found.residuals.norm() + contacts.reading * self.overshoot(found.unknowns.as_slice(), contacts)
        };
        found.min_by(|one, other| rank(one).total_cmp(&rank(other)))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::optics::tests::Noise;

    fn head(distance: f64) -> ScanHead {
        ScanHead {
            lens: Lens::Perspective { x: distance, y: 0.95 * distance },
            axis: FieldPoint::new(100.0, 80.0),
        }
    }

    const CORNERS: [[f64; 3]; 4] =
        [[-45.0, -30.0, 0.0], [50.0, -28.0, 12.0], [48.0, 35.0, 5.0], [-40.0, 33.0, 20.0]];

    fn contacts(head: &ScanHead, fixture: &Fixture, noise: &[f64]) -> Contacts {
        let points = CORNERS.iter().zip(noise.chunks(2)).map(|(view, noise)| {
            let view = Point3::from(*view);
            let hit = head.aim(fixture.point(view)).unwrap();
            Contact { view, hit: hit + Vector2::new(noise[0], noise[1]) * 0.05 }
        });
        Contacts { points: points.collect(), reading: 0.05, ..Contacts::default() }
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn four_points_give_the_pose_for_every_fixture_and_lens(
            distance in 140.0..600.0f64,
            [x, y, z, rotation] in [70.0..130.0f64, 60.0..100.0, -15.0..15.0, -3.1..3.1f64],
            noise in prop::collection::vec(-2.5..2.5f64, 8),
            telecentric in any::<bool>(),
        ) {
            let head = if telecentric { ScanHead::TELECENTRIC } else { head(distance) };
            let fixture = Fixture { x, y, z, rotation };
            let exact = Registration::fit(&contacts(&head, &fixture, &[0.0; 8]), &head, Height::Known(z)).unwrap();
            let off = |found: &Registration| {
                let turn = (found.fixture.rotation - rotation).sin().abs().to_degrees();
                ((found.fixture.x - x).hypot(found.fixture.y - y), turn)
            };
            let (shift, turn) = off(&exact);
            prop_assert!(shift < 1e-6 && turn < 1e-6, "{exact:?}");
            // The most that errors of this length can do to four points: half of it, and its share of their distances.
            let length = 0.05 * noise.iter().map(|value| value * value).sum::<f64>().sqrt();
            let seen = contacts(&head, &fixture, &noise);
            let found = Registration::fit(&seen, &head, Height::Known(z)).unwrap();
            let (shift, turn) = off(&found);
            prop_assert!(shift < 0.55 * length && turn < (length / 95.0).to_degrees(), "{found:?}");
            // Without a known height, the lens shows it: as well as it states.
            let free = Registration::fit(&seen, &head, Height::Unknown(z + 3.0)).unwrap();
            prop_assert_eq!(free.height_deviation.is_some(), !telecentric);
            if let Some(deviation) = free.height_deviation {
                prop_assert!((free.fixture.z - z).abs() < length * distance / 70.0, "{free:?}");
                prop_assert!(deviation < 1.0, "{free:?}");
            }
        }

        #[test]
        fn two_edges_give_the_pose(
            [x, y, rotation] in [70.0..130.0f64, 60.0..100.0, -3.1..3.1f64],
            distance in 140.0..600.0f64,
        ) {
            let head = head(distance);
            let fixture = Fixture { x, y, z: 4.0, rotation };
            let [a, b, c] = [[-40.0, -30.0, 8.0], [40.0, -30.0, 8.0], [-40.0, 30.0, 2.0]].map(Point3::from);
            let on = |ends: [Point3<f64>; 2], t: f64| EdgeContact {
                ends,
                hit: head.aim(fixture.point(ends[0] + (ends[1] - ends[0]) * t)).unwrap(),
            };
            let edges = vec![on([a, b], 0.1), on([a, b], 0.9), on([a, c], 0.3), on([a, c], 0.8)];
            let contacts = Contacts { edges, reading: 0.05, ..Contacts::default() };
            let found = Registration::fit(&contacts, &head, Height::Known(4.0)).unwrap();
            let off = (found.fixture.x - x).hypot(found.fixture.y - y);
            // Turned by 180 deg, the part touches the same lines beyond its edges.
            let turn = (found.fixture.rotation - rotation).cos();
            prop_assert!(off < 1e-4 && turn > 1.0 - 1e-9, "{off} {found:?}");
        }
    }

    /// Contacts that do not show the height of the part: two edges of its top, or three points that are close together.
    fn blind_to_height(head: &ScanHead, fixture: &Fixture, three_points: bool) -> Contacts {
        let aim = |view: Point3<f64>| head.aim(fixture.point(view)).unwrap();
        let mut contacts = Contacts { reading: 0.05, ..Contacts::default() };
        if three_points {
            let views = [[-2.0, -2.0, 20.0], [2.0, -2.0, 20.0], [0.0, 2.0, 20.0]].map(Point3::from);
            contacts.points = views.map(|view| Contact { view, hit: aim(view) }).to_vec();
            return contacts;
        }
        let [a, b, c] = [[-25.0, -15.0, 20.0], [25.0, -15.0, 20.0], [25.0, 15.0, 20.0]].map(Point3::from);
        for (ends, shares) in [([a, b], &[0.0, 0.5, 1.0][..]), ([b, c], &[0.3, 0.9])] {
            let at = |share: &f64| aim(ends[0] + (ends[1] - ends[0]) * *share);
            contacts.edges.extend(shares.iter().map(|share| EdgeContact { ends, hit: at(share) }));
        }
        contacts
    }

    #[test]
    fn a_height_that_nobody_gives_and_no_contact_shows_is_in_the_uncertainty() {
        let head = head(300.0);
        for height in [-14.0, 0.0, 9.0, 14.0, 30.0] {
            let fixture = Fixture { x: 118.0, y: 66.0, z: height, rotation: 0.4 };
            for three_points in [false, true] {
                let contacts = blind_to_height(&head, &fixture, three_points);
                let found = Registration::fit(&contacts, &head, Height::Unknown(0.0)).unwrap();
                let off = [found.fixture.x - 118.0, found.fixture.y - 66.0];
                for (off, deviation) in off.into_iter().zip(found.deviations) {
                    assert!(off.abs() < 2.0 * deviation, "z {height}: {found:?}");
                }
                let deviation = found.height_deviation.unwrap();
                assert!((found.fixture.z - height).abs() < 2.0 * deviation, "z {height}: {found:?}");
                assert!(deviation > WORST_HEIGHT && found.assumed_height.is_some(), "z {height}: {found:?}");
                // With the height, the contacts show everything else.
                let known = Registration::fit(&contacts, &head, Height::Known(height)).unwrap();
                assert!(
                    (known.fixture.x - 118.0).abs() < 1e-6 && known.assumed_height.is_none(),
                    "{known:?}"
                );
            }
        }
    }

    #[test]
    fn an_assumed_height_moves_the_part_as_stated() {
        let (head, fixture) = (head(300.0), Fixture { x: 118.0, y: 66.0, z: 6.0, rotation: 0.0 });
        let contacts = blind_to_height(&head, &fixture, false);
        let at = |z: f64| Registration::fit(&contacts, &head, Height::Unknown(z)).unwrap();
        // Along the axes, the beam at an aim X is at 100 + (X − 100)·(1 − z/300), and at 80 + (Y − 80)·(1 − z/285): the edges
        // are at x = 143 and y = 51, 26 mm above the plane, so that x moves by −43/(300 − 26) for each mm.
        let shift = at(6.0).assumed_height.unwrap().shift;
        assert!((shift.x + 43.0 / 274.0).abs() < 1e-3 && (shift.y - 29.0 / 259.0).abs() < 1e-3, "{shift}");
        let (low, high) = (at(5.0).fixture, at(7.0).fixture);
        assert!(((high.x - low.x) / (high.z - low.z) - shift.x).abs() < 1e-3, "{low:?} {high:?}");
        // Under a telecentric lens, and one that nearly is, the height has no effect.
        for head in [ScanHead::TELECENTRIC, super::tests::head(1e6)] {
            let contacts = blind_to_height(&head, &fixture, false);
            let found = Registration::fit(&contacts, &head, Height::Unknown(0.0)).unwrap();
            assert!(found.assumed_height.is_none() && found.height_deviation.is_none(), "{found:?}");
            assert!((found.fixture.x - 118.0).abs() < 0.01, "{found:?}");
        }
    }

    #[test]
    fn a_tilt_of_the_part_is_found_and_a_mistyped_point_is_none() {
        let (head, fixture) = (head(300.0), Fixture { x: 92.0, y: 75.0, z: 3.0, rotation: 0.4 });
        let views = CORNERS.into_iter().chain([[0.0, 0.0, 35.0], [-10.0, 20.0, 8.0]]).map(Point3::from);
        let seen = |degrees: f64, seed: u64| {
            let turn = Rotation3::from_scaled_axis(Vector3::new(0.6, -0.8, 0.0) * degrees.to_radians());
            let mut noise = Noise(seed);
            let points = views.clone().map(|view| {
                let off = Vector2::new(noise.next(), noise.next()) * 0.05;
                Contact { view, hit: head.aim(fixture.point(turn * view)).unwrap() + off }
            });
            Contacts { points: points.collect(), reading: 0.05, ..Contacts::default() }
        };
        let fit = |contacts: &Contacts| Registration::fit(contacts, &head, Height::Known(3.0)).unwrap();
        for seed in 0..20 {
            let found = fit(&seen(1.0, seed)).tilt.unwrap().to_degrees();
            assert!((found - 1.0).abs() < 0.3, "seed {seed}: {found}");
            assert_eq!(fit(&seen(0.0, seed)).tilt, None, "seed {seed}");
        }
    }

    #[test]
    fn four_points_with_noise_of_a_twentieth_give_the_pose_to_a_tenth() {
        let (head, fixture) = (head(300.0), Fixture { x: 92.0, y: 75.0, z: 3.0, rotation: 0.4 });
        for seed in 0..100 {
            let mut noise = Noise(seed);
            let noise: Vec<f64> = (0..8).map(|_| noise.next()).collect();
            let seen = contacts(&head, &fixture, &noise);
            let found = Registration::fit(&seen, &head, Height::Known(3.0)).unwrap();
            let shift = (found.fixture.x - 92.0).hypot(found.fixture.y - 75.0);
            let turn = (found.fixture.rotation - 0.4).abs().to_degrees();
            assert!(shift < 0.1 && turn < 0.1 && found.left_out.is_none(), "seed {seed}: {found:?}");
        }
    }

    #[test]
    fn contacts_that_do_not_fix_a_part_are_refused_with_numbers() {
        let (head, fixture) = (head(300.0), Fixture { x: 100.0, y: 80.0, z: 2.0, rotation: 0.3 });
        let sound = contacts(&head, &fixture, &[0.0; 8]);
        let fit =
            |contacts: &Contacts, z: f64| Registration::fit(contacts, &head, Height::Known(z)).unwrap_err();
        let mut line = sound.clone();
        line.points.truncate(3);
        assert!(Registration::fit(&line, &head, Height::Known(2.0)).is_ok());
        line.points[2] = Contact {
            view: Point3::new(0.0, -29.0, 3.0),
            hit: head.aim(fixture.point(Point3::new(0.0, -29.0, 3.0))).unwrap(),
        };
        assert!(matches!(fit(&line, 2.0), RegistrationError::OnLine { width, .. } if width < 1.0));
        let mut swapped = sound.clone();
        for point in &mut swapped.points {
            point.hit = FieldPoint::new(point.hit.y, point.hit.x);
        }
        assert_eq!(fit(&swapped, 2.0), RegistrationError::Mirrored);
        assert_eq!(
            fit(&Contacts { points: sound.points[..2].into(), ..sound.clone() }, 2.0),
            RegistrationError::TooFew { count: 2 }
        );
        assert!(matches!(fit(&sound, 290.0), RegistrationError::AboveLens { height, lens } if height > lens));
        let edge = EdgeContact {
            ends: [[0.0; 3], [50.0, 0.0, 0.0]].map(Point3::from),
            hit: FieldPoint::new(100.0, 80.0),
        };
        let edges = Contacts { edges: vec![edge; 3], reading: 0.05, ..Contacts::default() };
        assert!(matches!(fit(&edges, 2.0), RegistrationError::Parallel { degrees } if degrees < 1.0));
    }

    #[test]
    fn a_mistyped_point_is_left_out() {
        let (head, fixture) = (head(300.0), Fixture { x: 100.0, y: 80.0, z: 2.0, rotation: 0.3 });
        for wrong in 0..4 {
            let mut seen = contacts(&head, &fixture, &[0.3, -0.5, 0.1, 0.4, -0.6, 0.2, 0.5, 0.1]);
            seen.points[wrong].hit.x += 5.0;
            let found = Registration::fit(&seen, &head, Height::Known(2.0)).unwrap();
            assert_eq!(found.left_out, Some(wrong));
            assert!(
                (found.fixture.x - 100.0).abs() < 0.1 && (found.residuals[wrong].x - 5.0).abs() < 0.3,
                "{found:?}"
            );
        }
    }
}
