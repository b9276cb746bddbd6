//! Cuts the corrected drawing by height, for heads whose focus is moved between jobs, and lifts it onto the part, for heads
//! with three axes.

use nalgebra::Point3;

use super::correction::{AboveLens, Projection};
use super::marking::{MarkingDrawing, MarkingPath, MarkingShape};
use crate::geometry::pattern::{Color, Layer};
use crate::geometry::space::FlatPoint;

/// Distance of the places along a line at which its height is taken, mm: product surfaces have no waves between them.
const PROBE: f64 = 0.5;
/// A cut is at its height to within this, mm.
const ON_HEIGHT: f64 = 1e-6;
/// Pieces shorter than this on the part, mm, are joined to the piece before them.
const SHORTEST: f64 = 0.02;
/// Greatest number of steps.
pub const MOST_STEPS: usize = 200;

/// Heights that are divided into equal steps, from the highest to the lowest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FocusBands {
    highest: f64,
    height: f64,
    count: usize,
}

impl FocusBands {
    /// The fewest equal steps of at most `step` mm (positive) from `highest` down to `lowest`; at most [`MOST_STEPS`].
    pub fn new(lowest: f64, highest: f64, step: f64) -> Self {
        let range = (highest - lowest).max(0.0);
        // A range of exactly some steps needs no further one because of rounding.
        let count = (range / step - 1e-9).ceil().clamp(1.0, MOST_STEPS as f64) as usize;
        Self { highest, height: range / count as f64, count }
    }

    /// Number of steps.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Lowest and highest height of a step, mm.
    pub fn range(&self, step: usize) -> [f64; 2] {
        [self.border(step + 1), self.border(step)]
    }

    /// The height that should be in focus for a step, mm.
    pub fn focus(&self, step: usize) -> f64 {
        self.highest - (step as f64 + 0.5) * self.height
    }

    /// The height above a step, mm.
    fn border(&self, step: usize) -> f64 {
        self.highest - step as f64 * self.height
    }

    /// The step of a height; the first or the last one for heights outside.
    fn of(&self, height: f64) -> usize {
        if self.count == 1 {
            return 0;
        }
        (((self.highest - height) / self.height).max(0.0) as usize).min(self.count - 1)
    }
}

/// One step of a drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct FocusStep {
    /// The height that should be in focus, mm in the laser's frame.
    pub focus: f64,
    /// Lowest and highest height, mm.
    pub range: [f64; 2],
    /// What is marked, on the layers of the whole drawing.
    pub drawing: MarkingDrawing,
    /// For each path, the points of the placed drawing that its points mark.
    pub drawn: Vec<Vec<FlatPoint>>,
}

/// Cuts a drawing into the steps, in their order; `drawn` holds, for each path, the points of the placed drawing that its points
/// mark. Lines are cut where their height on the part is that of a border, and then extended beyond it by half of `overlap` mm,
/// measured on the part. A contour that is cut becomes open lines.
///
/// # Errors
/// When the part is as high as the lens at a cut.
pub fn divide(
    drawing: &MarkingDrawing,
    drawn: &[Vec<FlatPoint>],
    projection: &Projection<'_>,
    bands: &FocusBands,
    overlap: f64,
) -> Result<Vec<FocusStep>, AboveLens> {
    let mut steps: Vec<FocusStep> = (0..bands.count())
        .map(|step| FocusStep {
            focus: bands.focus(step),
            range: bands.range(step),
            drawing: MarkingDrawing { paths: Vec::new(), ..drawing.clone() },
            drawn: Vec::new(),
        })
        .collect();
    for (path, flat) in drawing.paths.iter().zip(drawn) {
        let is_closed = matches!(path.shape, MarkingShape::Closed(_));
        let line = Line::new(flat, is_closed, projection);
        let pieces = line.pieces(bands, projection);
        if let [only] = pieces[..] {
            if let Some(step) = steps.get_mut(only.step) {
                step.drawing.paths.push(path.clone());
                step.drawn.push(flat.clone());
            }
            continue;
        }
        for piece in pieces {
            let points = line.cut_out(&piece, overlap);
            let field = points.iter().map(|at| projection.aim(*at)).collect::<Result<Vec<_>, _>>()?;
            if let Some(step) = steps.get_mut(piece.step) {
                step.drawing.paths.push(MarkingPath { shape: MarkingShape::Open(field), ..path.clone() });
                step.drawn.push(points);
            }
        }
    }
    Ok(steps)
}

/// A line with its height and its length on the part.
struct Line<'a> {
    flat: &'a [FlatPoint],
    is_closed: bool,
    probes: Vec<Probe>,
}

/// A place of a line.
#[derive(Debug, Clone, Copy)]
struct Probe {
    /// Number of the point before it, and the share of the way to the next one.
    at: f64,
    /// Its height in the laser's frame, mm.
    height: f64,
    /// Length of the line on the part up to here, mm.
    length: f64,
}

/// A piece of a line in one step; a closed line continues beyond its end at its start.
#[derive(Debug, Clone, Copy)]
struct Piece {
    step: usize,
    from: Probe,
    to: Probe,
    /// Whether it starts or ends at a cut.
    is_cut: [bool; 2],
}

impl<'a> Line<'a> {
    fn new(flat: &'a [FlatPoint], is_closed: bool, projection: &Projection<'_>) -> Self {
        let mut line = Self { flat, is_closed, probes: Vec::new() };
        let sides = if is_closed { flat.len() } else { flat.len().saturating_sub(1) };
        let mut length = 0.0;
        let mut last: Option<Point3<f64>> = None;
        for side in 0..sides.max(1) {
            let (from, to) = (line.flat_point(side as f64), line.flat_point(side as f64 + 1.0));
            let parts = (from.distance(to) / PROBE).ceil().clamp(2.0, 1e5) as usize;
            let first = usize::from(side > 0);
            for part in first..=parts {
                let at = side as f64 + part as f64 / parts as f64;
                let landing = projection.landing(line.flat_point(at)).1;
                length += last.map_or(0.0, |last| (landing - last).norm());
                last = Some(landing);
                line.probes.push(Probe { at, height: landing.z, length });
            }
        }
        line
    }

    /// The point of the placed drawing at a place of the line.
    fn flat_point(&self, at: f64) -> FlatPoint {
        let count = self.flat.len().max(1);
        let whole = at.floor();
        let index = |number: f64| match self.is_closed {
            true => (number as i64).rem_euclid(count as i64) as usize,
            false => (number.max(0.0) as usize).min(count - 1),
        };
        let (from, to) = (self.flat.get(index(whole)), self.flat.get(index(whole + 1.0)));
        match (from, to) {
            (Some(from), Some(to)) if at > whole => from.lerp(*to, at - whole),
            (Some(from), _) => *from,
            _ => FlatPoint::new(0.0, 0.0),
        }
    }

    fn pieces(&self, bands: &FocusBands, projection: &Projection<'_>) -> Vec<Piece> {
        let [first, rest @ ..] = &self.probes[..] else { return Vec::new() };
        let mut pieces =
            vec![Piece { step: bands.of(first.height), from: *first, to: *first, is_cut: [false; 2] }];
        for (from, to) in self.probes.iter().zip(rest) {
            let (mut step, end) = (bands.of(from.height), bands.of(to.height));
            let mut from = *from;
            while step != end {
                let is_falling = end > step;
                let height = bands.border(if is_falling { step + 1 } else { step });
                let cut = self.place_of(height, from, *to, projection);
                step = if is_falling { step + 1 } else { step - 1 };
                if let Some(last) = pieces.last_mut() {
                    last.to = cut;
                    // Where a line runs along a border, it is not cut to pieces.
                    if cut.length - last.from.length >= SHORTEST {
                        last.is_cut[1] = true;
                        pieces.push(Piece { step, from: cut, to: cut, is_cut: [true, false] });
                    } else {
                        last.step = step;
                    }
                }
                from = cut;
            }
            if let Some(last) = pieces.last_mut() {
                last.to = *to;
            }
        }
        self.joined(pieces)
    }

    /// The pieces without neighbours in one step and without tiny ends.
    fn joined(&self, pieces: Vec<Piece>) -> Vec<Piece> {
        let mut joined: Vec<Piece> = Vec::with_capacity(pieces.len());
        for piece in pieces {
            match joined.last_mut() {
                Some(last) if last.step == piece.step || piece.to.length - piece.from.length < SHORTEST => {
                    (last.to, last.is_cut[1]) = (piece.to, piece.is_cut[1]);
                }
                _ => joined.push(piece),
            }
        }
        // The last piece of a closed line continues with its first one.
        if self.is_closed
            && let [first, .., last] = &joined[..]
            && first.step == last.step
        {
            let (first, last) = (*first, *last);
            joined.remove(0);
            if let Some(last_piece) = joined.last_mut() {
                let (count, whole) = (self.flat.len() as f64, last.to.length);
                let beyond =
                    |probe: Probe| Probe { at: probe.at + count, length: probe.length + whole, ..probe };
                (last_piece.to, last_piece.is_cut) = (beyond(first.to), [last.is_cut[0], first.is_cut[1]]);
            }
        } else if self.is_closed && joined.len() > 1 {
            // Its start is a border between two steps, too.
            for piece in [0, joined.len() - 1] {
                joined[piece].is_cut = [true; 2];
            }
        }
        joined
    }

    /// The place between two others at which the line has a height.
    fn place_of(&self, height: f64, mut from: Probe, mut to: Probe, projection: &Projection<'_>) -> Probe {
        let (start, end) = (from, to);
        for round in 0..60 {
            let share = (height - from.height) / (to.height - from.height);
            // Regula falsi, with bisection so that it ends.
            let share = if round % 2 == 0 && share.is_finite() { share.clamp(0.0, 1.0) } else { 0.5 };
            let at = from.at + (to.at - from.at) * share;
            let found = projection.landing(self.flat_point(at)).1.z;
            let of_whole = (at - start.at) / (end.at - start.at);
            let length = start.length + (end.length - start.length) * of_whole;
            let probe = Probe { at, height: found, length };
            if (found - height).abs() <= ON_HEIGHT {
                return probe;
            }
            if (found < height) == (from.height < height) {
                from = probe;
            } else {
                to = probe;
            }
        }
        from
    }

    /// The points of a piece, extended at its cuts.
    fn cut_out(&self, piece: &Piece, overlap: f64) -> Vec<FlatPoint> {
        let reach = |place: Probe, is_cut: bool, sign: f64| match is_cut {
            true => self.at_length(place.length + sign * overlap / 2.0, place),
            false => place.at,
        };
        let whole = self.probes.last().map_or(0.0, |last| last.length);
        let (from, to) = (reach(piece.from, piece.is_cut[0], -1.0), reach(piece.to, piece.is_cut[1], 1.0));
        // A closed line is not passed twice.
        let to = if piece.to.length - piece.from.length + overlap >= whole && self.is_closed {
            to.min(from + self.flat.len() as f64)
        } else {
            to
        };
        let mut points = vec![self.flat_point(from)];
        let mut next = from.floor() + 1.0;
        while next < to - 1e-9 {
            if next > from + 1e-9 {
                points.push(self.flat_point(next));
            }
            next += 1.0;
        }
        points.push(self.flat_point(to));
        points
    }

    /// The place at a length along the line; a closed line continues beyond its ends.
    fn at_length(&self, length: f64, near: Probe) -> f64 {
        let (Some(first), Some(last)) = (self.probes.first(), self.probes.last()) else { return near.at };
        let whole = last.length;
        if length == near.length || !(whole > 0.0) {
            return near.at;
        }
        let rounds = if self.is_closed { (length / whole).floor() } else { 0.0 };
        let within = length - rounds * whole;
        let after = self.probes.partition_point(|probe| probe.length <= within);
        let at = match (self.probes.get(after.wrapping_sub(1)), self.probes.get(after)) {
            (Some(before), Some(after)) => {
                let share = (within - before.length) / (after.length - before.length);
                before.at + (after.at - before.at) * share
            }
            (None, _) => first.at,
            (_, None) => last.at,
        };
        at + rounds * self.flat.len() as f64
    }
}

/// One path on the part.
#[derive(Debug, Clone, PartialEq)]
pub struct SpacePath {
    /// Index into the layers of the drawing.
    pub layer: usize,
    /// The path's own colour.
    pub color: Color,
    /// Whether its last point is joined to its first.
    pub closed: bool,
    /// Its points on the part in the laser's frame, mm; a single one is a dot.
    pub points: Vec<Point3<f64>>,
}

/// A drawing on the part.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SpaceDrawing {
    /// The layers that paths refer to by index.
    pub layers: Vec<Layer>,
    /// Everything to be marked, in drawing order.
    pub paths: Vec<SpacePath>,
    /// Comment lines at the start of the file; they are not marked.
    pub comments: Vec<String>,
}

/// The drawing on the part, with chords that are within `tolerance` mm of the lines in space. `drawn` holds, for each path, the
/// points of the placed drawing that its points mark.
pub fn lifted(
    drawing: &MarkingDrawing,
    drawn: &[Vec<FlatPoint>],
    projection: &Projection<'_>,
    tolerance: f64,
) -> SpaceDrawing {
    let paths = drawing.paths.iter().zip(drawn).map(|(path, flat)| {
        let closed = matches!(path.shape, MarkingShape::Closed(_));
        let mut points: Vec<Point3<f64>> =
            flat.first().map(|at| projection.landing(*at).1).into_iter().collect();
        let back = flat.first().filter(|_| closed);
        for (from, to) in flat.iter().zip(flat.iter().skip(1).chain(back)) {
            // Probes 2 mm apart, as for the lines of the field.
            let parts = (from.distance(*to) / (4.0 * PROBE)).ceil().clamp(1.0, 1e4) as usize;
            let at = |part: usize| {
                let flat = from.lerp(*to, part as f64 / parts as f64);
                (flat, projection.landing(flat).1)
            };
            let (start, end) = (at(0), at(parts));
            let is_straight = (1..parts).all(|part| is_near(&at(part).1, &start.1, &end.1, tolerance));
            if is_straight && parts > 1 {
                points.push(end.1);
                continue;
            }
            for part in 0..parts {
                divide_chord(projection, at(part), at(part + 1), tolerance, 0, &mut points);
            }
        }
        if closed {
            points.pop();
        }
        SpacePath { layer: path.layer, color: path.color, closed, points }
    });
    SpaceDrawing {
        layers: drawing.layers.clone(),
        paths: paths.collect(),
        comments: drawing.comments.clone(),
    }
}

/// Adds the points after the first end up to the second one.
fn divide_chord(
    projection: &Projection<'_>,
    from: (FlatPoint, Point3<f64>),
    to: (FlatPoint, Point3<f64>),
    tolerance: f64,
    depth: usize,
    points: &mut Vec<Point3<f64>>,
) {
    let flat = from.0.lerp(to.0, 0.5);
    let middle = (flat, projection.landing(flat).1);
    if is_near(&middle.1, &from.1, &to.1, tolerance) || depth >= 12 {
        points.push(to.1);
        return;
    }
    divide_chord(projection, from, middle, tolerance, depth + 1, points);
    divide_chord(projection, middle, to, tolerance, depth + 1, points);
}

/// Whether a point is within `tolerance` mm of a straight line between two others.
fn is_near(point: &Point3<f64>, from: &Point3<f64>, to: &Point3<f64>, tolerance: f64) -> bool {
    let (chord, offset) = (to - from, point - from);
    let length = chord.norm_squared();
    let share = if length > 0.0 { (offset.dot(&chord) / length).clamp(0.0, 1.0) } else { 0.0 };
    (offset - chord * share).norm() <= tolerance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::correction::Subdivision;
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::mapping::{LengthTrueMap, Method};
    use crate::geometry::optics::{Fixture, ScanHead};
    use crate::geometry::pattern::{Path, Pattern, Segment, Shape, Source};
    use crate::geometry::shapes;
    use crate::geometry::space::View;
    use crate::geometry::surface::fit::{FitOptions, FittedSurface};

    fn surface(height: impl Fn(f64, f64) -> f64) -> FittedSurface {
        let part = FacingPart::new(&shapes::graph(25.0, 0.75, height), &View::top());
        FittedSurface::of_part(&part, &FitOptions::default()).unwrap()
    }

    fn through(points: &[[f64; 2]], is_closed: bool) -> Pattern {
        let points: Vec<FlatPoint> = points.iter().map(|[x, y]| FlatPoint::new(*x, *y)).collect();
        let count = if is_closed { points.len() } else { points.len() - 1 };
        let side =
            |index: usize| Segment::Line { from: points[index], to: points[(index + 1) % points.len()] };
        let sides = (0..count).map(side).collect();
        let shape = if is_closed { Shape::Closed(sides) } else { Shape::Open(sides) };
        let path = Path { layer: 0, color: Color::Aci(3), shape, region: None, source: Source::default() };
        Pattern { layers: vec![Layer { name: "MARK".into(), color: Color::Aci(7) }], paths: vec![path] }
    }

    /// The steps of a drawing on a cylinder of radius 30 mm about the y axis.
    fn on_cylinder(pattern: &Pattern, bands: &FocusBands, overlap: f64) -> Vec<FocusStep> {
        let surface = surface(shapes::cylinder);
        let map =
            LengthTrueMap::find(&surface, pattern, |_| true, FlatPoint::new(0.0, 0.0), &Method::Cylinder)
                .unwrap();
        let projection = Projection {
            map: &map,
            surface: &surface,
            fixture: Fixture { z: -30.0, ..Fixture::default() },
            head: ScanHead::TELECENTRIC,
        };
        let bent = projection.bend(pattern, 0.01, Subdivision::Adaptive).unwrap();
        divide(&bent.drawing, &bent.drawn, &projection, bands, overlap).unwrap()
    }

    fn ends(path: &MarkingPath) -> [f64; 2] {
        let points = path.shape.points();
        [points[0].x, points[points.len() - 1].x]
    }

    /// Length of a path on the cylinder, for paths round it.
    fn length(path: &MarkingPath) -> f64 {
        let [from, to] = ends(path).map(|x| 30.0 * (x / 30.0).asin());
        (to - from).abs()
    }

    #[test]
    fn a_line_is_cut_where_its_height_on_the_part_is_that_of_a_border() {
        // 20 mm round a radius of 30 mm; the heights are 30 (cos(s / 30) - 1).
        let lowest = 30.0 * ((2f64 / 3.0).cos() - 1.0);
        let bands = FocusBands::new(lowest, 0.0, 2.5);
        assert_eq!(bands.count(), 3);
        let steps = on_cylinder(&through(&[[-20.0, 3.0], [20.0, 3.0]], false), &bands, 0.0);
        let counts: Vec<usize> = steps.iter().map(|step| step.drawing.paths.len()).collect();
        assert_eq!(counts, [1, 2, 2]);
        let at = |height: f64| (900.0 - (30.0 + height).powi(2)).sqrt();
        let [first, second] = [at(lowest / 3.0), at(lowest * 2.0 / 3.0)];
        for (step, expected) in steps.iter().zip([first, second, 30.0 * (2f64 / 3.0).sin()]) {
            let outermost = step.drawing.paths.iter().flat_map(ends).map(f64::abs).fold(0.0, f64::max);
            // The slope of the part makes an error of its height in the fit one of the place.
            assert!((outermost - expected).abs() < 5e-3, "{outermost} for {expected}");
            let middle = (step.range[0] + step.range[1]) / 2.0;
            assert!(
                (step.focus - middle).abs() < 1e-12
                    && step.drawing.paths.iter().all(|path| path.color == Color::Aci(3))
            );
        }
        let whole: f64 = steps.iter().flat_map(|step| &step.drawing.paths).map(length).sum();
        assert!((whole - 40.0).abs() < 1e-3, "{whole}");
    }

    #[test]
    fn steps_overlap_by_the_length_on_the_part() {
        let bands = FocusBands::new(30.0 * ((2f64 / 3.0).cos() - 1.0), 0.0, 2.5);
        let steps = on_cylinder(&through(&[[-20.0, 3.0], [20.0, 3.0]], false), &bands, 0.4);
        let whole: f64 = steps.iter().flat_map(|step| &step.drawing.paths).map(length).sum();
        // Four cuts.
        assert!((whole - 40.0 - 4.0 * 0.4).abs() < 5e-3, "{whole}");
    }

    #[test]
    fn a_contour_becomes_open_pieces_that_pass_it_once() {
        let square = through(&[[-15.0, -5.0], [15.0, -5.0], [15.0, 5.0], [-15.0, 5.0]], true);
        let bands = FocusBands::new(-4.0, 0.0, 2.0);
        let steps = on_cylinder(&square, &bands, 0.0);
        let counts: Vec<usize> = steps.iter().map(|step| step.drawing.paths.len()).collect();
        assert_eq!(counts, [2, 2]);
        let pieces: Vec<&MarkingPath> = steps.iter().flat_map(|step| &step.drawing.paths).collect();
        assert!(pieces.iter().all(|path| matches!(path.shape, MarkingShape::Open(_))));
        // The ends of the pieces meet in pairs.
        let mut all: Vec<[i64; 2]> = Vec::new();
        for path in &pieces {
            let points = path.shape.points();
            for end in [points[0], points[points.len() - 1]] {
                all.push([(end.x * 1e3).round() as i64, (end.y * 1e3).round() as i64]);
            }
        }
        all.sort_unstable();
        assert!(all.len() == 8 && all.chunks(2).all(|pair| pair[0] == pair[1]), "{all:?}");
        // Both upright sides are whole, in the lower step.
        let uprights = steps[1].drawing.paths.iter().filter(|path| {
            let ys = path.shape.points().iter().map(|point| point.y);
            let (low, high) = ys.fold((f64::MAX, f64::MIN), |(low, high), y| (low.min(y), high.max(y)));
            high - low > 9.99
        });
        assert_eq!(uprights.count(), 2);
    }

    #[test]
    fn what_is_in_one_step_is_kept_whole() {
        let along = through(&[[3.0, -15.0], [3.0, 15.0]], false);
        let steps = on_cylinder(&along, &FocusBands::new(-6.0, 0.0, 2.0), 0.5);
        let counts: Vec<usize> = steps.iter().map(|step| step.drawing.paths.len()).collect();
        assert_eq!(counts, [1, 0, 0]);
        // Along a border, too.
        let height = 30.0 * ((10f64 / 30.0).cos() - 1.0);
        let border = through(&[[10.0, -15.0], [10.0, 15.0]], false);
        let steps = on_cylinder(&border, &FocusBands::new(2.0 * height, 0.0, -height * 1.0001), 0.0);
        let pieces: usize = steps.iter().map(|step| step.drawing.paths.len()).sum();
        assert!(steps.len() == 2 && pieces <= 40, "{pieces}");
    }

    #[test]
    fn steps_are_equal_and_no_higher_than_allowed() {
        for (range, step, count) in
            [(10.0, 4.0, 3), (8.0, 4.0, 2), (0.0, 1.0, 1), (3.0, 4.0, 1), (1e9, 1.0, 200)]
        {
            let bands = FocusBands::new(-range, 0.0, step);
            assert_eq!(bands.count(), count);
            assert!((bands.range(count - 1)[0] + range).abs() <= range * 1e-12);
        }
    }

    #[test]
    fn in_space_a_line_follows_the_part() {
        let surface = surface(shapes::cylinder);
        let pattern = through(&[[-20.0, 3.0], [20.0, 3.0], [20.0, 18.0]], false);
        let map =
            LengthTrueMap::find(&surface, &pattern, |_| true, FlatPoint::new(0.0, 0.0), &Method::Cylinder)
                .unwrap();
        let projection = Projection {
            map: &map,
            surface: &surface,
            fixture: Fixture::default(),
            head: ScanHead::TELECENTRIC,
        };
        let bent = projection.bend(&pattern, 0.01, Subdivision::Adaptive).unwrap();
        // In the field the line round the cylinder is straight: two points.
        assert_eq!(bent.drawing.paths[0].shape.points().len(), 3);
        let lifted = lifted(&bent.drawing, &bent.drawn, &projection, 0.01);
        let points = &lifted.paths[0].points;
        for point in points {
            // The fit near the rim of the mesh is this far from the cylinder.
            assert!((point.x.hypot(point.z) - 30.0).abs() < 1e-2, "{point}");
        }
        // A chord of a circle of radius 30 with a sagitta of 0.01 mm is 1.55 mm long.
        let chord = |ends: &[Point3<f64>]| (ends[1].xz() - ends[0].xz()).norm();
        assert!(points.windows(2).map(chord).fold(0.0, f64::max) < 1.56);
        assert!(points.len() < 60, "{}", points.len());
    }
}
