//! Maps the drawing through the length-true map and the optics to the field coordinates for the marking software, and
//! checks that it can be marked.

use nalgebra::{Point3, Vector2, Vector3};

use super::chords::{Chords, STRAIGHT};
use super::marking::{MarkingDrawing, MarkingPath, MarkingShape};
use super::optics::{Fixture, Lens, ScanHead};
use crate::geometry::ink::Ink;
use crate::geometry::mapping::LengthTrueMap;
use crate::geometry::mapping::quality::Shortening;
use crate::geometry::pattern::{Pattern, Segment, Shape};
use crate::geometry::space::{Extents, FieldPoint, FlatPoint, ViewPoint};
use crate::geometry::surface::fit::FittedSurface;

/// How the lines of the drawing are divided into points.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Subdivision {
    /// As few points as the chord tolerance allows.
    #[default]
    Adaptive,
    /// The ends of the drawing's own segments; arcs and curves are first flattened to the chord tolerance.
    Keep,
}

/// The share of the chord tolerance used when points are added along the true image; the rest is used to remove points
/// that are not needed.
const REFINEMENT_SHARE: f64 = 0.05;
/// Chord tolerance for the length of a curve as drawn, mm. Halved chords show the missing length to the
/// fourth order.
const DRAWN: f64 = 1e-3;
/// A chord is shorter than its curve by at most this share of the curve, even if the curve is small compared
/// with the tolerance. On an arc, such a chord turns by at most 20 degrees.
const MAX_LOST_SHARE: f64 = 5e-3;
/// The same share where points are added along the true image.
const REFINED_LOST_SHARE: f64 = 1e-3;
/// Chords that together are as long as their curve leave it by at most this share of the tolerance at their
/// ends.
const FARTHEST_OUTSIDE: f64 = 0.75;
/// Lines may be pieces of one curve if they turn by at most 20 degrees: if the cosine of the turn is at least
/// this.
const SMOOTH_CORNER: f64 = 0.94;
/// The share of a segment over which its direction at an end is taken.
const DIRECTION_STEP: f64 = 1e-3;
/// Curves that are shorter than this, mm, may lose as much length as one of this length. It is far below a
/// laser's spot: noise is not marked.
const SHORTEST_CURVE: f64 = 0.01;
/// Lines that are shorter than this, mm, are as long on the part as they are drawn. Lines that a repeated
/// point leaves have only the length of its rounding.
const SHORTEST_LINE: f64 = 0.01;
/// A line of the field is as long as the image of its drawn line if it leaves this image by a smaller share
/// of its length.
const NEGLIGIBLE_OFF: f64 = 1e-5;
/// Lines that are longer by more than this share are examined more closely.
const LONG_SHARE: f64 = 1e-5;
/// The share of a line over which the image of a point beside it is taken.
const PROBE_STEP: f64 = 1e-3;
/// Three times the derivatives of a quartic at five even points of its range from 0 to 1. The factors apply
/// to its values at these points.
const QUARTIC_SPEEDS: [[f64; 5]; 5] = [
    [-25.0, 48.0, -36.0, 16.0, -3.0],
    [-3.0, -10.0, 18.0, -6.0, 1.0],
    [1.0, -8.0, 0.0, 8.0, -1.0],
    [-1.0, 6.0, -18.0, 10.0, 3.0],
    [3.0, -16.0, 36.0, -48.0, 25.0],
];
/// 90 times the weights of the five values in an integral from 0 to 1 (Abramowitz & Stegun, Handbook of
/// mathematical functions, 1964, 25.3 and 25.4).
const BOOLE: [f64; 5] = [7.0, 32.0, 12.0, 32.0, 7.0];
/// The radius of curvature of the image of a straight line is at least this, mm: less than the distance of
/// samples.
const MIN_BEND_RADIUS: f64 = 0.2;

/// A beam is followed down to the part in at most this many steps; three or four are usual.
const MOST_STEPS_DOWN: usize = 40;
/// A beam that is followed down ends at most this far from the part, mm. The height of the part between
/// samples is less exact than this.
const ON_THE_PART: f64 = 1e-6;

/// Everything between the drawing's plane and the field.
#[derive(Debug, Clone, Copy)]
pub struct Projection<'a> {
    /// Maps the drawing onto the view.
    pub map: &'a LengthTrueMap,
    /// The part's surface over the view.
    pub surface: &'a FittedSurface,
    /// Maps the view into the laser's frame.
    pub fixture: Fixture,
    /// Maps the laser's frame into the field.
    pub head: ScanHead,
}

/// The corrected drawing, and what its chords cost.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Bent {
    /// The drawing.
    pub drawing: MarkingDrawing,
    /// For each path, by how much the chords of the marked polyline differ from the drawn curve.
    pub shortening: Vec<Shortening>,
    /// The same for the chords of a marking program, which have their ends on the curve.
    pub inscribed: Vec<Shortening>,
    /// For each path, the points of the placed drawing that its points mark.
    pub drawn: Vec<Vec<FlatPoint>>,
}

/// A point of the drawing with the field coordinates that mark it.
#[derive(Debug, Clone, Copy)]
struct Aimed {
    flat: FlatPoint,
    field: FieldPoint,
    /// The number of its segment and the parameter there.
    on: (usize, f64),
}

/// The part reaches up to the lens, where no beam can reach it.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("the part is as high as the lens at ({:.3}, {:.3}) mm", at.x, at.y)]
#[non_exhaustive]
pub struct AboveLens {
    /// The point of the view.
    pub at: ViewPoint,
}

/// The part where a point of the drawing lands, in the laser's frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contact {
    /// The point of the part, mm.
    pub(super) at: Point3<f64>,
    /// The unit normal of the part there.
    pub(super) normal: Vector3<f64>,
    /// Height of the sampled part minus height of the fit, mm.
    pub(super) difference: f64,
}

impl Projection<'_> {
    /// The part at `view`, the image of a point of the drawing.
    pub(super) fn contact(&self, flat: FlatPoint, view: ViewPoint) -> Contact {
        let (height, normal) = self.map.height_and_normal(self.surface, flat, view);
        let difference = self.surface.difference(view);
        Contact {
            at: self.fixture.point(Point3::new(view.x, view.y, height + difference)),
            normal: self.fixture.direction(normal),
            difference,
        }
    }

    /// The point of the part onto which a point of the drawing is mapped: in the view, and in the laser's frame, mm.
    pub(super) fn landing(&self, at: FlatPoint) -> (ViewPoint, Point3<f64>) {
        let view = self.map.point(at);
        let height = self.surface.nurbs.height(view) + self.surface.difference(view);
        (view, self.fixture.point(Point3::new(view.x, view.y, height)))
    }

    /// The field coordinates that mark a point of the drawing, mm.
    ///
    /// # Errors
    /// When the part is as high as the lens there.
    pub fn aim(&self, at: FlatPoint) -> Result<FieldPoint, AboveLens> {
        let (view, landing) = self.landing(at);
        self.head.aim(landing).ok_or(AboveLens { at: view })
    }

    /// Where a point of the drawing is in the view if the field gets the placed drawing without a correction.
    /// A beam that leaves the lens obliquely meets points above or below the calibrated plane beside its aim.
    /// `None` if the search for the place does not end, as where a beam only grazes the part.
    pub fn uncorrected(&self, at: FlatPoint) -> Option<ViewPoint> {
        if self.head.lens == Lens::Telecentric {
            return Some(at.coords().into());
        }
        let drawn = self.fixture.point(Point3::new(at.x, at.y, -self.fixture.z));
        let beam = self.head.beam(drawn.xy().coords.into());
        let along = self.fixture.in_view(beam.at(1.0)) - self.fixture.in_view(beam.at(0.0));
        let mut z = self.fixture.z;
        for _ in 0..MOST_STEPS_DOWN {
            let place = ViewPoint::from(self.fixture.in_view(beam.at(z)).xy().coords);
            let above =
                self.surface.nurbs.height(place) + self.surface.difference(place) + self.fixture.z - z;
            if above.abs() < ON_THE_PART {
                return Some(place);
            }
            // Newton's method: as the beam goes down, the part below it rises or falls.
            z += above / (1.0 - self.surface.nurbs.gradient(place).dot(&along.xy()));
        }
        None
    }

    fn aimed(&self, flat: FlatPoint, on: (usize, f64)) -> Result<Aimed, AboveLens> {
        Ok(Aimed { flat, field: self.aim(flat)?, on })
    }

    /// The whole drawing as polylines in the field. With [`Subdivision::Adaptive`], every polyline stays
    /// within `tolerance` mm of the true image. The chords of curves together are as long on the part as the
    /// curves, because their ends are up to `tolerance` outside. With [`Subdivision::Keep`], this applies
    /// only to arcs and curves. No chord turns by more than about 20 degrees, however small the curve: small
    /// letters keep their shape and their lengths.
    ///
    /// # Errors
    /// When the part is as high as the lens somewhere.
    pub fn bend(
        &self,
        pattern: &Pattern,
        tolerance: f64,
        subdivision: Subdivision,
    ) -> Result<Bent, AboveLens> {
        let (mut shortening, mut inscribed) = (Vec::new(), Vec::new());
        let mut paths = Vec::with_capacity(pattern.paths.len());
        let mut drawn = Vec::with_capacity(pattern.paths.len());
        let junctions = Junctions::of(pattern);
        for path in &pattern.paths {
            let mut lost = [Shortening::default(); 2];
            let mut bend = |segments: &[Segment]| {
                let (mut points, junctions) = match subdivision {
                    Subdivision::Adaptive => {
                        (self.bend_with_few_points(segments, tolerance, &junctions)?, Some(&junctions))
                    }
                    Subdivision::Keep => (self.bend_point_by_point(segments, tolerance)?, None),
                };
                let mut chords = self.chords_of(segments, &points, path.shape.is_closed(), junctions)?;
                lost[0] = chords.inscribed();
                chords.lengthen(tolerance * FARTHEST_OUTSIDE);
                lost[1] = chords.shortening();
                for (point, vertex) in points.iter_mut().zip(&chords.vertices) {
                    if point.flat != *vertex {
                        *point = self.aimed(*vertex, point.on)?;
                    }
                }
                Ok(points.iter().map(|point| (point.field, point.flat)).unzip::<_, _, Vec<_>, Vec<_>>())
            };
            let (shape, flat) = match &path.shape {
                Shape::Dot(point) => (MarkingShape::Dot(self.aim(*point)?), vec![*point]),
                Shape::Open(segments) => {
                    let (points, flat) = bend(segments)?;
                    (MarkingShape::Open(points), flat)
                }
                Shape::Closed(segments) => {
                    let (mut points, mut flat) = bend(segments)?;
                    points.pop();
                    // A repeated first point may differ by rounding; the side between the two has no length.
                    while points.len() > 2 && points.first().zip(points.last()).is_some_and(is_same) {
                        points.pop();
                    }
                    flat.truncate(points.len());
                    (MarkingShape::Closed(points), flat)
                }
            };
            inscribed.push(lost[0]);
            shortening.push(lost[1]);
            drawn.push(flat);
            paths.push(MarkingPath { layer: path.layer, color: path.color, shape });
        }
        let drawing = MarkingDrawing { layers: pattern.layers.clone(), paths, comments: Vec::new() };
        Ok(Bent { drawing, shortening, inscribed, drawn })
    }

    /// The chords between the points of a path. The points of a curve may move, but not where other lines meet it (`junctions`;
    /// without them no end of a segment moves), nor at a corner.
    fn chords_of(
        &self,
        segments: &[Segment],
        points: &[Aimed],
        is_closed: bool,
        junctions: Option<&Junctions>,
    ) -> Result<Chords, AboveLens> {
        let steps: Vec<usize> = segments.iter().map(|segment| segment.steps(DRAWN)).collect();
        let [mut drawn, mut goals, mut missed, mut longer] =
            std::array::from_fn(|_| Vec::with_capacity(points.len()));
        for ends in points.windows(2) {
            let [from, to] = [&ends[0], &ends[1]];
            let chord = from.flat.distance(to.flat);
            let length = drawn_length(segments, &steps, [from.on, to.on]);
            let missing = length - chord;
            let is_curved = missing > STRAIGHT * chord;
            let [left, most] = if is_curved { self.straightness(segments, from, to)? } else { [1.0; 2] };
            longer.push(if is_curved { 0.0 } else { self.lengthening(from.flat, to.flat)? });
            drawn.push(length);
            goals.push(chord + missing * left);
            missed.push(most);
        }
        let is_free = |point: &Aimed| {
            let (number, share) = point.on;
            if share > 0.0 && share < 1.0 {
                return true;
            }
            if junctions.is_none_or(|junctions| junctions.contain(point.flat)) {
                return false;
            }
            // The segments before and after the point; the ends of an open path do not move anyway.
            let number = if share > 0.0 { number + 1 } else { number };
            let before = number.checked_sub(1).unwrap_or(segments.len() - 1);
            is_smooth(&segments[before], &segments[number % segments.len()])
        };
        let vertices = points.iter().map(|point| point.flat).collect();
        let is_free = points.iter().map(is_free).collect();
        Ok(Chords { vertices, drawn, goals, missed, longer, is_free, is_closed })
    }

    /// The share of what a chord in the plane of the drawing misses that the mark misses, too, by what is in the middle; and the
    /// largest share by this and by the quarters.
    fn straightness(&self, segments: &[Segment], from: &Aimed, to: &Aimed) -> Result<[f64; 2], AboveLens> {
        let ((first, start), (last, end)) = (from.on, to.on);
        let middle = match first == last {
            true => segments[first].point(f64::midpoint(start, end)),
            false => segments[(first + last).div_ceil(2)].start(),
        };
        let left = self.straightness_beside(middle, from, to)?;
        let mut most = left.abs();
        let [start, end] = [first as f64 + start, last as f64 + end];
        for share in [0.25, 0.75] {
            let on = start + share * (end - start);
            let number = (on as usize).min(last);
            let point = segments[number].point(on - number as f64);
            most = most.max(self.straightness_beside(point, from, to)?.abs());
        }
        // A chord that the field bends to the other side has no more to lose than its curve.
        Ok([left, most.min(1.0)])
    }

    /// The same by one point of the curve: the line of the field from end to end is itself a curve on the part. 1 where it marks the
    /// chord, 0 where it marks the drawn curve.
    fn straightness_beside(&self, point: FlatPoint, from: &Aimed, to: &Aimed) -> Result<f64, AboveLens> {
        // Of the chord's point beside it, so that both images differ across the chord only.
        let chord = to.flat - from.flat;
        let share = (point - from.flat).dot(&chord) / chord.norm_squared();
        let [curved, straight] = [self.aim(point)?, self.aim(from.flat.lerp(to.flat, share))?];
        let bulge = curved - straight;
        let marked = from.field.lerp(to.field, share) - straight;
        let bent = marked.dot(&bulge) / bulge.norm_squared();
        // The length that an arc adds to its chord grows with the square of its height.
        Ok(if bent.is_finite() { 1.0 - bent * bent } else { 1.0 })
    }

    /// By how much the line of the field between the images of two points is longer on the part than the straight drawn line between
    /// them, mm: it leaves the image of that line to one side or both, as a plane section of a round part does.
    fn lengthening(&self, from: FlatPoint, to: FlatPoint) -> Result<f64, AboveLens> {
        let way = to - from;
        if way.norm() < SHORTEST_LINE {
            return Ok(0.0);
        }
        let ends = [self.aim(from)?, self.aim(to)?];
        // The point of the drawing whose image is at a share of the line.
        let marked = |share: f64| -> Result<FlatPoint, AboveLens> {
            let at = from.lerp(to, share);
            let here = self.aim(at)?;
            let off = ends[0].lerp(ends[1], share) - here;
            if off.norm() < NEGLIGIBLE_OFF * way.norm() {
                return Ok(at);
            }
            let steps = [way, Vector2::new(-way.y, way.x)].map(|step| step * PROBE_STEP);
            let [along, across] = [self.aim(at + steps[0])? - here, self.aim(at + steps[1])? - here];
            let area = along.perp(&across);
            Ok(at + steps[0] * (off.perp(&across) / area) + steps[1] * (along.perp(&off) / area))
        };
        // By the quartics through four pieces each.
        let longer = |pieces: usize| -> Result<f64, AboveLens> {
            let mut points = vec![from];
            for piece in 1..pieces {
                points.push(marked(piece as f64 / pieces as f64)?);
            }
            points.push(to);
            let speed = |points: &[FlatPoint], factors: &[f64; 5]| {
                let ways = points.iter().map(|point| *point - from).zip(factors);
                ways.map(|(way, factor)| way * *factor).sum::<Vector2<f64>>().norm() / 3.0
            };
            let length = |points: &[FlatPoint]| -> f64 {
                QUARTIC_SPEEDS
                    .iter()
                    .zip(BOOLE)
                    .map(|(factors, weight)| weight * speed(points, factors))
                    .sum()
            };
            let lengths: f64 = points.windows(5).step_by(4).map(length).sum();
            Ok(lengths / 90.0 - from.distance(to))
        };
        let mut found = longer(4)?;
        if found > LONG_SHARE * way.norm() {
            found = longer(8)?;
        }
        Ok(if found.is_finite() { found.max(0.0) } else { 0.0 })
    }

    /// The images of the ends of all segments, after curves are flattened.
    fn bend_point_by_point(&self, segments: &[Segment], tolerance: f64) -> Result<Vec<Aimed>, AboveLens> {
        let mut points = Vec::with_capacity(segments.len() + 1);
        for (number, segment) in segments.iter().enumerate() {
            if points.is_empty() {
                points.push(self.aimed(segment.point(0.0), (number, 0.0))?);
            }
            let steps = steps_of_true_length(segment, tolerance);
            for step in 1..=steps {
                let share = step as f64 / steps as f64;
                points.push(self.aimed(segment.point(share), (number, share))?);
            }
        }
        Ok(points)
    }

    /// A polyline within `tolerance` mm of the image of the segments, with as few points as possible and one at every
    /// junction.
    fn bend_with_few_points(
        &self,
        segments: &[Segment],
        tolerance: f64,
        junctions: &Junctions,
    ) -> Result<Vec<Aimed>, AboveLens> {
        let mut kept = Vec::new();
        // Points along the image since the last junction.
        let mut points: Vec<Aimed> = Vec::with_capacity(segments.len() + 1);
        for (number, segment) in segments.iter().enumerate() {
            let (from, to) = (segment.point(0.0), segment.point(1.0));
            let start = match points.last() {
                Some(last) if last.flat == from => *last,
                _ => self.aimed(from, (number, 0.0))?,
            };
            let end = self.aimed(to, (number, 1.0))?;
            if points.is_empty() {
                points.push(start);
            } else if junctions.contain(from) {
                kept.extend(simplified(&points, tolerance * (1.0 - REFINEMENT_SHARE)));
                points.clear();
                points.push(kept.pop().unwrap_or(start));
            }
            self.subdivide(segment, (0.0, start), (1.0, end), tolerance * REFINEMENT_SHARE, &mut points)?;
        }
        kept.extend(simplified(&points, tolerance * (1.0 - REFINEMENT_SHARE)));
        Ok(kept)
    }

    /// Adds the points after `from` up to `to`: the piece is halved until probes along it are close to its chord.
    fn subdivide(
        &self,
        segment: &Segment,
        from: (f64, Aimed),
        to: (f64, Aimed),
        tolerance: f64,
        points: &mut Vec<Aimed>,
    ) -> Result<(), AboveLens> {
        let span = to.0 - from.0;
        let rough_length = from.1.field.distance(to.1.field);
        // An arc of this length with the smallest radius deviates from its chord by the tolerance.
        let is_short = |length: f64| length * length <= 8.0 * tolerance * MIN_BEND_RADIUS;
        if is_short(rough_length)
            && matches!(segment, Segment::Line { from, to } if is_short(from.distance(*to)))
        {
            points.push(to.1);
            return Ok(());
        }
        // Product surfaces have no waves between probes 2 mm apart; three probes detect an S-shape.
        let probes = ((rough_length / 2.0).ceil() as usize).clamp(3, 1000);
        let middle = from.0 + span / 2.0;
        let mut length = 0.0;
        let mut last = from.1.field;
        let mut close = |t: f64| -> Result<bool, AboveLens> {
            let image = self.aim(segment.point(t))?;
            length += last.distance(image);
            last = image;
            Ok(distance_to_line(image, from.1.field, to.1.field) <= tolerance)
        };
        // A closed circle has a chord of length zero. The limit of 1e-5 ends the search at a fold between probes.
        let mut straight = span < 1.0 || !matches!(segment, Segment::Arc { sweep, .. } if sweep.abs() > 3.0);
        for probe in 1..=probes {
            straight = straight && close(from.0 + span * probe as f64 / (probes + 1) as f64)?;
        }
        let keeps_length = |length: f64| loses_little(length, rough_length, REFINED_LOST_SHARE);
        straight = straight && keeps_length(length + last.distance(to.1.field));
        if straight || span < 1e-5 {
            points.push(to.1);
            return Ok(());
        }
        let halfway = (middle, self.aimed(segment.point(middle), (to.1.on.0, middle))?);
        self.subdivide(segment, from, halfway, tolerance, points)?;
        self.subdivide(segment, halfway, to, tolerance, points)
    }

    /// The fixture, moved in x and y only, with which the middle of the marked rectangle is at `middle`; `None` if the part
    /// then reaches up to the lens.
    pub fn centred(&self, ink: &Ink, middle: FieldPoint) -> Option<Fixture> {
        let mut moved = *self;
        // Each step leaves a share of about height / lens distance.
        for _ in 0..20 {
            let points = ink.pieces.iter().flat_map(|piece| [piece.from, piece.to]);
            let points = points.chain(ink.squares.iter().copied()).chain(ink.dots.iter().copied());
            let aims: Result<Vec<_>, _> = points.map(|at| moved.aim(at).map(FieldPoint::coords)).collect();
            let step = middle.coords() - Extents::of(aims.ok()?).center();
            moved.fixture.x += step.x;
            moved.fixture.y += step.y;
            if step.norm() < 1e-4 {
                return Some(moved.fixture);
            }
        }
        None
    }
}

/// The corners of a drawing that several paths share, or that one path passes twice. They are kept, so that branching
/// lines still meet.
struct Junctions(Vec<[u64; 2]>);

impl Junctions {
    fn of(pattern: &Pattern) -> Self {
        let mut corners: Vec<[u64; 2]> = Vec::new();
        for path in &pattern.paths {
            let segments = path.shape.segments();
            let end = segments.last().filter(|_| !path.shape.is_closed()).map(Segment::end);
            corners.extend(segments.iter().map(Segment::start).chain(end).map(Self::key));
        }
        corners.sort_unstable();
        let shared = corners.chunk_by(|a, b| a == b).filter(|same| same.len() > 1);
        Self(shared.map(|same| same[0]).collect())
    }

    fn contain(&self, corner: FlatPoint) -> bool {
        !self.0.is_empty() && self.0.binary_search(&Self::key(corner)).is_ok()
    }

    /// Equal for equal points; -0 is treated as 0.
    fn key(point: FlatPoint) -> [u64; 2] {
        [(point.x + 0.0).to_bits(), (point.y + 0.0).to_bits()]
    }
}

/// The part under the ink, as the beam reaches it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Exposure {
    /// Number of samples checked.
    pub samples: usize,
    /// How many of them have no surface under them.
    pub off_surface: usize,
    /// The first such sample: in the drawing and in the view.
    pub first_off_surface: Option<(FlatPoint, ViewPoint)>,
    /// Largest angle between beam and surface normal, rad.
    pub steepest: f64,
    /// Where that is.
    pub steepest_at: ViewPoint,
    /// Lowest height in the laser's frame, mm.
    pub lowest: f64,
    /// Highest height in the laser's frame, mm.
    pub highest: f64,
    /// Where that is.
    pub highest_at: ViewPoint,
    /// The rectangle of the field that is marked, mm.
    pub field: Extents,
    /// Largest distance between the sampled part and the fitted surface, mm.
    pub max_difference: f64,
    /// Where that is.
    pub max_difference_at: ViewPoint,
    /// Largest possible distance between the part and its samples, mm; see [`FittedSurface::doubt`].
    pub max_doubt: f64,
    /// Where that is.
    pub max_doubt_at: ViewPoint,
}

/// The length of the drawing from one place to another, each a segment's number and the parameter there, mm; `steps` divide each
/// segment.
fn drawn_length(segments: &[Segment], steps: &[usize], [from, to]: [(usize, f64); 2]) -> f64 {
    let pieces = (from.0..=to.0).zip(segments.iter().zip(steps).skip(from.0));
    let lengths = pieces.map(|(number, (segment, steps))| {
        let start = if number == from.0 { from.1 } else { 0.0 };
        let end = if number == to.0 { to.1 } else { 1.0 };
        if matches!(segment, Segment::Line { .. }) {
            return segment.point(start).distance(segment.point(end));
        }
        let steps = (*steps as f64 * (end - start)).ceil().max(1.0) as usize;
        let point = |step: usize| segment.point(start + (end - start) * step as f64 / (2 * steps) as f64);
        let halves: f64 = (1..=2 * steps).map(|step| point(step - 1).distance(point(step))).sum();
        let chords: f64 = (1..=steps).map(|step| point(2 * step - 2).distance(point(2 * step))).sum();
        // Two half chords miss a quarter of what one chord misses.
        halves + (halves - chords) / 3.0
    });
    lengths.sum()
}

/// Whether a segment leads into the next one without a corner.
fn is_smooth(segment: &Segment, next: &Segment) -> bool {
    let before = segment.end() - segment.point(1.0 - DIRECTION_STEP);
    let after = next.point(DIRECTION_STEP) - next.start();
    before.dot(&after) > SMOOTH_CORNER * before.norm() * after.norm()
}

/// Whether a chord of this length, mm, may replace a line of `length` mm: it is shorter by no more than this share.
fn loses_little(length: f64, chord: f64, share: f64) -> bool {
    length - chord <= share * length.max(SHORTEST_CURVE)
}

/// Number of equal parameter steps for which the chords stay within `tolerance` mm of the segment and keep its length, as far
/// as eight times the steps of the tolerance alone can: at a cusp no number of them does.
fn steps_of_true_length(segment: &Segment, tolerance: f64) -> usize {
    let mut steps = segment.steps(tolerance);
    let most = steps.saturating_mul(8).min(65_536);
    let keep_length = |steps: usize| {
        let point = |share: f64| segment.point(share / steps as f64);
        (0..steps).map(|step| step as f64).all(|step| {
            let [from, middle, to] = [step, step + 0.5, step + 1.0].map(point);
            let (halves, chord) = (from.distance(middle) + middle.distance(to), from.distance(to));
            // Two half chords lose a quarter of what one chord loses.
            loses_little(halves + (halves - chord) / 3.0, chord, MAX_LOST_SHARE)
        })
    };
    while steps < most && !matches!(segment, Segment::Line { .. }) && !keep_length(steps) {
        steps *= 2;
    }
    steps
}

/// A polyline through a small selection of the points, including both ends, such that all others are within
/// `tolerance` mm of it and no piece is much shorter than the line that it replaces.
///
/// One pass along the points. From the last point kept, a line continues while it meets the discs of this
/// radius round all points passed, and while the points move away from its start. Each disc narrows a wedge
/// of directions (Williams, An efficient algorithm for the piecewise linear approximation of planar curves,
/// 1978).
fn simplified(points: &[Aimed], tolerance: f64) -> Vec<Aimed> {
    let [first, rest @ ..] = points else { return Vec::new() };
    let mut kept = vec![*first];
    let mut anchor = *first;
    let mut wedge = Wedge::default();
    let mut length = 0.0;
    for (last, point) in points.iter().zip(rest) {
        let step = last.field.distance(point.field);
        length += step;
        let keeps_length = loses_little(length, anchor.field.distance(point.field), MAX_LOST_SHARE);
        if !(wedge.narrow(point.field - anchor.field, tolerance) && keeps_length) {
            kept.push(*last);
            anchor = *last;
            length = step;
            wedge = Wedge::default();
            wedge.narrow(point.field - anchor.field, tolerance);
        }
    }
    if let Some(end) = rest.last() {
        kept.push(*end);
    }
    kept
}

/// The directions in which a line may continue, and the distance of the farthest point passed.
#[derive(Default)]
struct Wedge {
    /// The first direction, and the limits to its right and left, rad.
    opening: Option<(Vector2<f64>, f64, f64)>,
    farthest: f64,
}

impl Wedge {
    /// Whether a line may end at this offset. If so, the wedge is narrowed to lines that pass close to it.
    fn narrow(&mut self, offset: Vector2<f64>, tolerance: f64) -> bool {
        let distance = offset.norm();
        if distance < self.farthest {
            return false;
        }
        self.farthest = distance;
        // A disc that contains the start is met in every direction.
        if distance <= tolerance {
            return true;
        }
        let half = (tolerance / distance).asin();
        let Some((axis, right, left)) = &mut self.opening else {
            self.opening = Some((offset, -half, half));
            return true;
        };
        let angle = (axis.x * offset.y - axis.y * offset.x).atan2(axis.dot(&offset));
        if !(*right..=*left).contains(&angle) {
            return false;
        }
        (*right, *left) = (right.max(angle - half), left.min(angle + half));
        true
    }
}

fn is_same((a, b): (&FieldPoint, &FieldPoint)) -> bool {
    a.distance(*b) < 1e-6
}

fn distance_to_line(point: FieldPoint, from: FieldPoint, to: FieldPoint) -> f64 {
    let (along, offset) = (to - from, point - from);
    let square = along.norm_squared();
    let t = if square > 0.0 { (offset.dot(&along) / square).clamp(0.0, 1.0) } else { 0.0 };
    (offset - along * t).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::ink::Ink;
    use crate::geometry::mapping::Method;
    use crate::geometry::mapping::isometric::IsometricOptions;
    use crate::geometry::pattern::{Color, Layer, Path, Source};
    use crate::geometry::shapes;
    use crate::geometry::space::View;
    use crate::geometry::surface::fit::FitOptions;

    fn surface(height: impl Fn(f64, f64) -> f64) -> FittedSurface {
        let part = FacingPart::new(&shapes::graph(25.0, 0.75, height), &View::top());
        FittedSurface::of_part(&part, &FitOptions::default()).unwrap()
    }

    fn drawing(shape: Shape) -> Pattern {
        let layers = vec![Layer { name: "MARK".into(), color: Color::Aci(7) }];
        Pattern {
            layers,
            paths: vec![Path {
                layer: 0,
                color: Color::ByLayer,
                shape,
                region: None,
                source: Source::default(),
            }],
        }
    }

    fn line(from: [f64; 2], to: [f64; 2]) -> Pattern {
        drawing(Shape::Open(vec![Segment::Line {
            from: FlatPoint::new(from[0], from[1]),
            to: FlatPoint::new(to[0], to[1]),
        }]))
    }

    /// A laser straight above the part.
    fn from_above<'a>(map: &'a LengthTrueMap, surface: &'a FittedSurface) -> Projection<'a> {
        Projection { map, surface, fixture: Fixture::default(), head: ScanHead::TELECENTRIC }
    }

    fn bent(
        surface: &FittedSurface,
        pattern: &Pattern,
        method: Method,
        tolerance: f64,
    ) -> (MarkingDrawing, LengthTrueMap) {
        let map = LengthTrueMap::find(surface, pattern, |_| true, FlatPoint::new(0.0, 0.0), &method).unwrap();
        let projection = from_above(&map, surface);
        (projection.bend(pattern, tolerance, Subdivision::Adaptive).unwrap().drawing, map)
    }

    #[test]
    fn a_corner_where_another_line_ends_is_kept() {
        let surface = surface(|_, _| 0.0);
        let at = |x: f64, y: f64| FlatPoint::new(x, y);
        let through = |points: &[FlatPoint]| {
            let pairs = points.windows(2);
            drawing(Shape::Open(pairs.map(|pair| Segment::Line { from: pair[0], to: pair[1] }).collect()))
        };
        let corners = [at(0.0, 0.0), at(5.0, 0.009), at(10.0, 0.0)];
        let mut pattern = through(&corners);
        let points =
            |pattern: &Pattern| bent(&surface, pattern, Method::Plain, 0.02).0.paths[0].shape.points().len();
        assert_eq!(points(&pattern), 2);
        pattern.paths.extend(through(&[corners[1], at(5.0, 5.0)]).paths);
        assert_eq!(points(&pattern), 3);
    }

    #[test]
    fn a_slanted_line_on_a_cylinder_becomes_a_sine_within_the_tolerance() {
        let surface = surface(shapes::cylinder);
        let pattern = line([-15.0, -15.0], [15.0, 15.0]);
        for tolerance in [0.1, 0.01, 0.001] {
            let (bent, _) = bent(&surface, &pattern, Method::Cylinder, tolerance);
            let points = bent.paths[0].shape.points();
            let mut worst = 0.0f64;
            for step in 0..=3000 {
                let s = -15.0 + 30.0 * f64::from(step) / 3000.0;
                let truth = FieldPoint::new(30.0 * (s / 30.0).sin(), s);
                let nearest = points.windows(2).map(|pair| distance_to_line(truth, pair[0], pair[1]));
                worst = worst.max(nearest.fold(f64::INFINITY, f64::min));
            }
            assert!(worst < tolerance * 1.02 + 2e-4, "{worst} mm");
            // A chord of length l with its ends on a curve of curvature k deviates from it by k·l²/8, so the smallest
            // number of chords is the integral of √(k / 8 / tolerance) along the curve.
            let root_of_curvature = |step: i32| {
                let angle = -0.5 + (f64::from(step) + 0.5) / 1000.0;
                let (speed, bend) = (angle.cos().hypot(1.0), angle.sin().abs() / 30.0);
                (bend / speed.powi(3)).sqrt() * speed * 30.0 / 1000.0
            };
            let fewest = (0..1000).map(root_of_curvature).sum::<f64>() / (8.0 * tolerance).sqrt();
            assert!((points.len() as f64) < 1.25 * fewest + 3.0, "{} for {fewest}", points.len());
        }
    }

    #[test]
    fn the_lengthening_of_a_straight_line_by_its_chords_is_that_on_the_part() {
        let surface = surface(shapes::cylinder);
        let cases = [
            ([15.0, 15.0], 0.1, Subdivision::Adaptive),
            ([15.0, 15.0], 0.02, Subdivision::Adaptive),
            ([18.0, 6.0], 0.02, Subdivision::Keep),
            ([20.0, -12.0], 0.02, Subdivision::Keep),
            ([22.0, 14.0], 0.02, Subdivision::Keep),
            ([24.0, 10.0], 0.02, Subdivision::Keep),
            ([0.0, 14.0], 0.02, Subdivision::Keep),
        ];
        // Across the crest of the cylinder, lines are shaped like an S.
        let cases = cases.into_iter().flat_map(|case| [(1.0 / 3.0, case), (1.0, case)]);
        for (start, (to, tolerance, subdivision)) in cases {
            let pattern = line([-start * to[0], -to[1]], to);
            let origin = FlatPoint::new(0.0, 0.0);
            let map = LengthTrueMap::find(&surface, &pattern, |_| true, origin, &Method::Cylinder).unwrap();
            let bent = from_above(&map, &surface).bend(&pattern, tolerance, subdivision).unwrap();
            let on_part = |from: FieldPoint, to: FieldPoint| {
                let place = |share: f64| {
                    let at = from.lerp(to, share);
                    Point3::new(at.x, at.y, shapes::cylinder(at.x, at.y))
                };
                let step = |index: i32| place(f64::from(index) / 1000.0);
                (0..1000).map(|index| (step(index + 1) - step(index)).norm()).sum::<f64>()
            };
            let marked = bent.drawing.paths[0].shape.points().windows(2);
            let marked: f64 = marked.map(|pair| on_part(pair[0], pair[1])).sum();
            let longer = marked - ((1.0 + start) * to[0]).hypot(2.0 * to[1]);
            let reported = bent.shortening[0].lost;
            let is_right = (reported - longer).abs() < 0.02 * longer + 3e-5;
            assert!(is_right, "{start}, {to:?}, {tolerance}: {reported} mm for {longer} mm");
        }
    }

    #[test]
    fn on_a_plane_a_line_has_two_points_and_a_circle_stays_closed() {
        let surface = surface(|x, y| 5.0 + 0.0 * (x + y));
        let method = Method::Isometric(IsometricOptions::INK);
        let (straight, _) = bent(&surface, &line([-10.0, 2.0], [12.0, -3.0]), method, 0.01);
        assert_eq!(straight.paths[0].shape.points().len(), 2);
        let circle = drawing(Shape::Closed(vec![Segment::Arc {
            center: FlatPoint::new(0.0, 0.0),
            u: nalgebra::Vector2::new(10.0, 0.0),
            v: nalgebra::Vector2::new(0.0, 10.0),
            start: 0.0,
            sweep: std::f64::consts::TAU,
        }]));
        let (round, _) = bent(&surface, &circle, method, 0.01);
        let points = round.paths[0].shape.points();
        // Of a sagitta of at most 0.01 mm a third is outside, so that the polygon has the circumference of the circle.
        let outside = points.iter().map(|point| point.coords().norm() - 10.0);
        assert!(outside.clone().fold(0.0, f64::max) < 0.01 / 2.9, "{outside:?}");
        let around = points.iter().zip(points.iter().cycle().skip(1));
        let perimeter: f64 = around.map(|(from, to)| from.distance(*to)).sum();
        assert!((perimeter - 10.0 * std::f64::consts::TAU).abs() < 5e-4, "{perimeter}");
        let nearly = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [1e-15, 0.0]].map(|[x, y]| FlatPoint::new(x, y));
        let sides = (0..4).map(|i| Segment::Line { from: nearly[i], to: nearly[(i + 1) % 4] });
        let (triangle, _) = bent(&surface, &drawing(Shape::Closed(sides.collect())), method, 0.01);
        assert_eq!(triangle.paths[0].shape.points().len(), 3);
        // With corners on the circle and a sagitta of 0.01 mm, the smallest number of sides is π / acos(1 − 0.001) =
        // 70.2.
        assert!((71..=85).contains(&points.len()), "{}", points.len());
        assert!(points[0].distance(points[points.len() - 1]) > 0.1, "the first point is not repeated");
    }

    #[test]
    fn collinear_pieces_are_merged_and_corners_are_kept() {
        let surface = surface(|x, y| 5.0 + 0.0 * (x + y));
        let method = Method::Isometric(IsometricOptions::INK);
        let at = |step: i32| match f64::from(step) / 500.0 {
            along if along < 1.0 => FlatPoint::new(10.0 * along, 5.0),
            along => FlatPoint::new(10.0, 5.0 + 10.0 * (along - 1.0)),
        };
        let pieces = (0..1000).map(|step| Segment::Line { from: at(step), to: at(step + 1) });
        let (bent, _) = bent(&surface, &drawing(Shape::Open(pieces.collect())), method, 0.01);
        let points = bent.paths[0].shape.points();
        let corners = [[0.0, 5.0], [10.0, 5.0], [10.0, 15.0]].map(|[x, y]| FieldPoint::new(x, y));
        assert_eq!(points.len(), 3, "{points:?}");
        assert!(points.iter().zip(corners).all(|(found, corner)| found.distance(corner) < 1e-6));
    }

    /// The points that [`simplified`] keeps.
    fn selected(points: &[FieldPoint], tolerance: f64) -> Vec<FieldPoint> {
        let flat = FlatPoint::new(0.0, 0.0);
        let points: Vec<Aimed> = points.iter().map(|&field| Aimed { flat, field, on: (0, 0.0) }).collect();
        simplified(&points, tolerance).iter().map(|point| point.field).collect()
    }

    #[test]
    fn the_shortening_by_chords_is_that_of_the_inscribed_polygon() {
        let surface = surface(|_, _| 0.0);
        let turn = std::f64::consts::TAU;
        let circle = |radius: f64| Segment::Arc {
            center: FlatPoint::new(0.0, 0.0),
            u: nalgebra::Vector2::new(radius, 0.0),
            v: nalgebra::Vector2::new(0.0, radius),
            start: 0.0,
            sweep: turn,
        };
        let mut pattern = drawing(Shape::Closed(vec![circle(3.0)]));
        pattern.paths.extend(line([-5.0, 0.0], [5.0, 1.0]).paths);
        let map = LengthTrueMap::Plain;
        let projection = from_above(&map, &surface);
        for (tolerance, subdivision) in
            [(0.1, Subdivision::Adaptive), (0.01, Subdivision::Adaptive), (0.01, Subdivision::Keep)]
        {
            let bent = projection.bend(&pattern, tolerance, subdivision).unwrap();
            let points = bent.drawing.paths[0].shape.points();
            let perimeter = |radius: &dyn Fn(&FieldPoint) -> f64| {
                let at = |point: &FieldPoint| FieldPoint::from(point.coords() * radius(point));
                let around = points.iter().zip(points.iter().cycle().skip(1));
                around.map(|(from, to)| at(from).distance(at(to))).sum::<f64>()
            };
            let lost = 3.0 * turn - perimeter(&|point| 3.0 / point.coords().norm());
            // A third of the tolerance for each radian of turning, at most.
            assert!((bent.inscribed[0].lost - lost).abs() < 1e-3 * lost, "{lost} mm");
            assert!(lost <= turn * tolerance / 3.0 + 1e-3 && lost > turn * tolerance / 30.0, "{lost} mm");
            let left = (3.0 * turn - perimeter(&|_| 1.0)).abs();
            let reported = bent.shortening[0].lost;
            // With `Keep` the ends of the circle stay.
            assert!(
                left < 1e-3 * lost && left <= reported + 1e-7 && reported < 0.1 * lost,
                "{left}, {reported}"
            );
            assert!(bent.inscribed[1].lost < 1e-9 && bent.shortening[1].lost < 1e-9);
        }
    }

    /// A rectangle whose corners are rounded: 60 mm of straight lines lose nothing, the arcs of a millimetre do.
    #[test]
    fn the_largest_shortening_is_that_of_one_chord() {
        let surface = surface(|_, _| 0.0);
        let (radius, half) = (1.0, 8.0);
        let quarter = std::f64::consts::FRAC_PI_2;
        let mut segments = Vec::new();
        for (number, [x, y]) in
            [[half, half], [-half, half], [-half, -half], [half, -half]].into_iter().enumerate()
        {
            segments.push(Segment::Arc {
                center: FlatPoint::new(x, y),
                u: nalgebra::Vector2::new(radius, 0.0),
                v: nalgebra::Vector2::new(0.0, radius),
                start: quarter * number as f64,
                sweep: quarter,
            });
        }
        let corners = segments.clone();
        let lines = corners.iter().zip(corners.iter().cycle().skip(1));
        let lines = lines.map(|(one, next)| Segment::Line { from: one.end(), to: next.start() });
        let segments: Vec<Segment> =
            corners.iter().cloned().zip(lines).flat_map(|(arc, line)| [arc, line]).collect();
        let pattern = drawing(Shape::Closed(segments));
        let map = LengthTrueMap::Plain;
        let projection = from_above(&map, &surface);
        for subdivision in [Subdivision::Adaptive, Subdivision::Keep] {
            let bent = projection.bend(&pattern, 0.02, subdivision).unwrap();
            let points = bent.drawing.paths[0].shape.points();
            let around = points.iter().zip(points.iter().cycle().skip(1));
            let shares = around
                .map(|(from, to)| from.distance(*to))
                .filter(|chord| *chord < 2.0 * radius)
                .map(|chord| {
                    let arc = 2.0 * radius * (chord / 2.0 / radius).asin();
                    1.0 - chord / arc
                });
            // The chords have their ends on the arc or a little outside.
            let most = shares.fold(0.0, f64::max);
            let inscribed = bent.inscribed[0].largest_share;
            assert!(most > 0.001 && (inscribed - most).abs() < 0.02 * most + 1e-4, "{inscribed} for {most}");
            let reported = bent.shortening[0];
            assert!(reported.largest_share < 0.5 * inscribed, "{reported:?}");
            let perimeter: f64 =
                points.iter().zip(points.iter().cycle().skip(1)).map(|(from, to)| from.distance(*to)).sum();
            let drawn = 4.0 * (16.0 + quarter * radius);
            assert!((perimeter - drawn).abs() < 1e-5, "{perimeter} for {drawn}");
        }
    }

    /// Circles of 0.02 to 2 mm in diameter, as arcs and as many short lines: the tolerance alone would leave triangles and squares.
    #[test]
    fn small_circles_keep_their_perimeter_with_few_points() {
        let surface = surface(|_, _| 0.0);
        let map = LengthTrueMap::Plain;
        let projection = from_above(&map, &surface);
        let turn = std::f64::consts::TAU;
        for radius in [0.01, 0.05, 0.1, 0.3, 1.0] {
            let arc = Segment::Arc {
                center: FlatPoint::new(1.0, 2.0),
                u: nalgebra::Vector2::new(radius, 0.0),
                v: nalgebra::Vector2::new(0.0, radius),
                start: 0.3,
                sweep: turn,
            };
            let at = |step: usize| arc.point((step % 720) as f64 / 720.0);
            let lines = (0..720).map(|step| Segment::Line { from: at(step), to: at(step + 1) });
            let lines = drawing(Shape::Closed(lines.collect()));
            let arc = drawing(Shape::Closed(vec![arc]));
            for tolerance in [0.001, 0.01, 0.2] {
                for (pattern, subdivision) in [
                    (&arc, Subdivision::Adaptive),
                    (&arc, Subdivision::Keep),
                    (&lines, Subdivision::Adaptive),
                ] {
                    let bent = projection.bend(pattern, tolerance, subdivision).unwrap();
                    let points = bent.drawing.paths[0].shape.points();
                    let around = points.iter().zip(points.iter().cycle().skip(1));
                    let perimeter: f64 = around.map(|(from, to)| from.distance(*to)).sum();
                    let share = 1.0 - perimeter / (turn * radius);
                    let of_one = bent.shortening[0].largest_share;
                    let case = format!("{radius} mm, {tolerance} mm, {subdivision:?}: {share}, {of_one}");
                    // On 0.02 mm, what is lost is negligible.
                    let most = if radius < 0.05 { 0.01 } else { 5.1e-3 };
                    assert!(share < most && of_one < 1.5 * most, "{case}");
                    // 18 chords lose 0.5 %; the tolerance demands more of large circles only.
                    let needed = turn / (8.0 * tolerance / radius).sqrt().min(0.346);
                    assert!((points.len() as f64) < 2.5 * needed + 8.0, "{case}, {} points", points.len());
                }
            }
        }
    }

    #[test]
    fn removed_points_are_within_the_tolerance_and_hairpins_are_kept() {
        // A walk with turns of every angle, including hairpins.
        let mut points = vec![FieldPoint::new(0.0, 0.0)];
        let mut angle = 0.0f64;
        for step in 0..3000 {
            angle += (f64::from(step) * 0.618).sin().powi(5) * 2.5;
            let last = points[points.len() - 1];
            let length = 0.002 + 0.05 * (f64::from(step) * 0.37).sin().abs();
            points.push(FieldPoint::new(last.x + length * angle.cos(), last.y + length * angle.sin()));
        }
        for tolerance in [0.001, 0.01, 0.1] {
            let kept = selected(&points, tolerance);
            assert_eq!((kept[0], kept[kept.len() - 1]), (points[0], points[points.len() - 1]));
            assert!(kept.len() < points.len());
            // Every removed point is close to the piece that replaces it.
            let mut rest = points.as_slice();
            for piece in kept.windows(2) {
                let end = rest.iter().skip(1).position(|point| *point == piece[1]).unwrap() + 1;
                for point in &rest[..end] {
                    assert!(distance_to_line(*point, piece[0], piece[1]) <= tolerance * (1.0 + 1e-9));
                }
                rest = &rest[end..];
            }
        }
        let hairpin =
            [[0.0, 0.0], [10.0, 0.0], [3.0, 0.001], [12.0, 0.0]].map(|[x, y]| FieldPoint::new(x, y));
        assert_eq!(selected(&hairpin, 0.01), hairpin);
    }

    #[test]
    fn exposure_measures_incidence_height_and_missing_surface() {
        let surface = surface(shapes::cylinder);
        let pattern = line([-15.0, 0.0], [15.0, 0.0]);
        let (_, map) = bent(&surface, &pattern, Method::Cylinder, 0.01);
        let projection = Projection {
            map: &map,
            surface: &surface,
            fixture: Fixture { z: -30.0, ..Fixture::default() },
            head: ScanHead::TELECENTRIC,
        };
        let seen = projection.expose(&Ink::sample(&pattern, |_| true, 0.25, 0.2));
        assert_eq!(seen.off_surface, 0);
        assert!((seen.steepest - 0.5).abs() < 1e-3, "15 mm on R = 30 mm is 0.5 rad, not {}", seen.steepest);
        assert!(seen.highest.abs() < 1e-3 && (seen.lowest - 30.0 * (0.5f64.cos() - 1.0)).abs() < 1e-3);
        let beyond = line([0.0, 0.0], [0.0, 40.0]);
        let seen = projection.expose(&Ink::sample(&beyond, |_| true, 0.25, 0.2));
        assert!(seen.off_surface > 50 && seen.first_off_surface.unwrap().1.y > 24.0);
    }
}
