//! Measures how well lengths, areas and angles are kept on the part: the quality results of every report.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

use super::isometric;
use crate::geometry::facing_part::Uncertainty;
use crate::geometry::ink::{Block, Ink, Piece, is_before};
use crate::geometry::pattern::Pattern;
use crate::geometry::relief::{Cover, Relief, ReliefMap};
use crate::geometry::space::{FlatPoint, ViewPoint};
use crate::geometry::surface::fit::FittedSurface;

/// Maximum length of the pieces of lines for the quality results, mm; in small drawings they are shorter, see [`sample`].
pub const PIECE: f64 = 0.25;
/// Side of the squares of the inked area for the quality results, mm; in small drawings it is smaller.
pub const SQUARE: f64 = 0.2;

/// Ink is sampled with smaller squares, by these factors one after the other, until the squares show the ink.
const SMALLER: [f64; 3] = [0.5, 0.25, 0.125];

/// The largest value of a doubt is this many times its mean.
const PEAK: f64 = Uncertainty::PEAK;
/// The largest doubt about an angle is this many times its mean: errors of the slope in two directions add to
/// it.
const PEAK_OF_ANGLE: f64 = 3.4;

/// The differences between the drawing and its image on the part.
///
/// The sums are those of Chuang, Shape correction for laser marking, 2023, equations 5.1 and 5.2.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Distortion {
    /// e_l: sum over all pieces of the lines of |length on the part − length drawn|, mm.
    pub length_error: f64,
    /// e_a: sum over all squares of the inked area of |area on the part − area drawn|, mm².
    pub area_error: f64,
    /// Length of all lines as drawn, mm.
    pub length: f64,
    /// Inked area as drawn, mm².
    pub area: f64,
    /// Largest |length on the part / length drawn − 1| of a piece.
    pub max_stretch: f64,
    /// Its position in the drawing.
    pub max_stretch_at: FlatPoint,
    /// Smallest and largest length on the part / length drawn − 1 of a piece; both 0 without lines.
    pub stretch_range: [f64; 2],
    /// Root mean square of length on the part / length drawn − 1, weighted by length.
    pub rms_stretch: f64,
    /// Largest change of the angle between any two directions, over the inked squares and along the lines, rad.
    pub max_angle_error: f64,
    /// Largest |area on the part / area drawn − 1| of a square; 0 without inked area.
    pub max_area_stretch: f64,
    /// The share of the results that follows from what is not known about the slope of the part.
    pub uncertain: Uncertain,
}

/// By how much the chords of a marked polyline differ in length from the pieces of the drawn curve that they replace. Chords
/// with their ends on the curve are shorter.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Shortening {
    /// The sum over the path, mm.
    pub lost: f64,
    /// The largest difference of one chord, as a share of its piece of the curve.
    pub largest_share: f64,
}

/// The share of a [`Distortion`] that follows from what is not known about the slope of the part.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct Uncertain {
    /// Share of e_l, mm.
    pub length_error: f64,
    /// Share of e_a, mm².
    pub area_error: f64,
    /// Share of the largest stretch of a length.
    pub max_stretch: f64,
    /// Largest share of an angle error, rad.
    pub max_angle_error: f64,
    /// Largest possible error of the slope under the ink, rad.
    pub max_slope: f64,
    /// Largest possible error of the height under the ink, mm.
    pub max_height: f64,
}

/// Samples the paths of a drawing on layers for which `is_marked` is true (given the layer's name) for the quality results, with
/// [`PIECE`] and [`SQUARE`] or, in small drawings, as close as the cells of their map need it.
pub fn sample(pattern: &Pattern, is_marked: impl Fn(&str) -> bool) -> Ink {
    covering(|part| {
        isometric::several_in_cell(|factor| {
            Ink::sample(pattern, &is_marked, factor * PIECE, part_of_square(part * factor))
        })
    })
}

/// The same without the areas inside outlines that nothing fills: there, a laser marks only the lines. The
/// squares are as large as those of `ink`, which is the same drawing with these areas.
pub fn sample_as_marked(pattern: &Pattern, is_marked: impl Fn(&str) -> bool, ink: &Ink) -> Ink {
    let factor = (ink.side / SQUARE).min(1.0);
    Ink::sample_as_marked(pattern, is_marked, factor * PIECE, ink.side)
}

/// The samples of ink with smaller squares where these are too large to show its area; `sample` takes the factor on their sides.
fn covering(sample: impl Fn(f64) -> Ink) -> Ink {
    let mut ink = sample(1.0);
    for part in SMALLER {
        if ink.is_shown() {
            break;
        }
        let finer = sample(part);
        // The number of squares is limited, so smaller ones are not always possible.
        if finer.side >= ink.side {
            break;
        }
        ink = finer;
    }
    ink
}

/// The side of squares that are smaller by at least a factor and divide [`SQUARE`] evenly, mm: what the large ones cover exactly, they do, too.
fn part_of_square(factor: f64) -> f64 {
    SQUARE / (1.0 / factor).ceil()
}

/// Measures a map on a part. `ink` should be from [`sample`]; `height` returns the height of
/// the part itself (mm), not of a fit to it, and `None` outside the part. Without ink every value is 0.
///
/// # Errors
/// The first point of the view for which `height` returns `None`.
pub fn measure(
    ink: &Ink,
    map: impl Fn(FlatPoint) -> ViewPoint,
    height: impl Fn(ViewPoint) -> Option<f64>,
) -> Result<Distortion, ViewPoint> {
    measure_at_most(ink, map, height, |_| Uncertainty::NONE)
}

/// The same as [`measure_at_most`] on the sampled part of a surface, with few samples in large inked areas
/// where they are smooth. With `is_doubted`, the uncertainty of the part is that of the surface. What the
/// samples leave open is added: at most 0.2 % to sums, and 0.2 % or rounding to largest values.
///
/// # Errors
/// The first point of the view where there is no surface.
pub fn measure_on(
    surface: &FittedSurface,
    ink: &Ink,
    map: &dyn Fn(FlatPoint) -> ViewPoint,
    is_doubted: bool,
) -> Result<Distortion, ViewPoint> {
    let relief = ReliefMap::under(ink, surface);
    let relief = relief.map(|relief| if is_doubted { relief } else { relief.without_doubt() });
    let doubt = |at| if is_doubted { surface.uncertainty(at) } else { Uncertainty::NONE };
    measure_with(relief.as_ref(), ink, map, |at| surface.sampled_height(at), doubt)
}

/// The same where `doubt` states what is not known of the part between the vertices of its mesh: every result is an estimate from
/// above, and [`Distortion::uncertain`] is the share that the doubt adds.
///
/// If a line climbs at the angle θ, an error δ of that angle changes its length by the share δ·tan θ + δ²/2. Areas change
/// by the same share, with the angle between the surface and the view for θ; angles by as many radians.
///
/// # Errors
/// The first point of the view for which `height` returns `None`.
pub fn measure_at_most(
    ink: &Ink,
    map: impl Fn(FlatPoint) -> ViewPoint,
    height: impl Fn(ViewPoint) -> Option<f64>,
    doubt: impl Fn(ViewPoint) -> Uncertainty,
) -> Result<Distortion, ViewPoint> {
    measure_with(None, ink, map, height, doubt)
}

/// Inked areas are measured square by square without a relief.
fn measure_with(
    relief: Option<&ReliefMap<'_>>,
    ink: &Ink,
    map: impl Fn(FlatPoint) -> ViewPoint,
    height: impl Fn(ViewPoint) -> Option<f64>,
    doubt: impl Fn(ViewPoint) -> Uncertainty,
) -> Result<Distortion, ViewPoint> {
    let lift = |flat: FlatPoint| lift(flat, &map, &height);
    let spread = Spread::of(ink);
    let mut distortion = Distortion {
        length_error: 0.0,
        area_error: 0.0,
        length: 0.0,
        area: ink.area(),
        max_stretch: 0.0,
        max_stretch_at: FlatPoint::new(0.0, 0.0),
        stretch_range: [0.0; 2],
        rms_stretch: 0.0,
        max_angle_error: 0.0,
        max_area_stretch: 0.0,
        uncertain: Uncertain::default(),
    };
    let mut range = None;
    for lifted in lifted(ink, lift) {
        let Lifted { piece, from, to } = lifted?;
        let drawn = piece.length();
        let stretch = (to - from).norm() / drawn - 1.0;
        let doubt = doubt(ViewPoint::from(nalgebra::center(&from, &to).coords.xy()));
        let along = to - from;
        let share = (1.0 + stretch) * share(along.z.abs() / along.xy().norm(), doubt);
        let uncertain = share * spread.times_mean(doubt);
        let most = stretch.abs() + uncertain;
        let peak = PEAK * share;
        widen(&mut range, stretch - peak);
        widen(&mut range, stretch + peak);
        distortion.length += drawn;
        let sideways = Vector2::new(piece.from.y - piece.to.y, piece.to.x - piece.from.x) / 2.0;
        let middle = piece.from.lerp(piece.to, 0.5);
        let beside = |step: Vector2<f64>| lift(middle + step);
        // A point beside the piece may be outside the part; then the angle is not measured.
        if let (Ok(left), Ok(right)) = (beside(sideways), beside(-sideways)) {
            distortion.include_angle([&along, &(left - right)], doubt);
        }
        distortion.length_error += most * drawn;
        distortion.uncertain.length_error += uncertain * drawn;
        distortion.rms_stretch += most * most * drawn;
        if stretch.abs() + peak > distortion.max_stretch {
            distortion.max_stretch = stretch.abs() + peak;
            distortion.max_stretch_at = piece.from.lerp(piece.to, 0.5);
            distortion.uncertain.max_stretch = peak;
        }
    }
    distortion.stretch_range = range.unwrap_or_default();
    if distortion.length > 0.0 {
        distortion.rms_stretch = (distortion.rms_stretch / distortion.length).sqrt();
    }
    match relief {
        None => {
            let mut corners = SharedCorners::default();
            for square in &ink.squares {
                let corners = corners.of(*square, ink.side, lift)?;
                distortion.include(&Square::between(corners, ink.side, &doubt, &spread), 1.0);
            }
        }
        Some(relief) => measure_blocks(ink, relief, &map, lift, doubt, &mut distortion)?,
    }
    distortion.area_error *= ink.weight();
    distortion.uncertain.area_error *= ink.weight();
    Ok(distortion)
}

/// The mean of the sizes of normally distributed errors as a share of their root mean square: √(2/π).
const OF_SIZES: f64 = 0.8;

/// How far ink spreads: the sides of the rectangle, in any direction, over which ink has the same moments if it covers it evenly,
/// mm.
struct Spread {
    sides: [f64; 2],
}

impl Spread {
    fn of(ink: &Ink) -> Self {
        let pieces = ink.pieces.iter().map(|piece| piece.from.lerp(piece.to, 0.5).coords());
        let places = || pieces.clone().chain(ink.squares.iter().map(|square| square.coords()));
        let count = places().count().max(1) as f64;
        let middle = places().sum::<Vector2<f64>>() / count;
        let moments: Matrix2<f64> =
            places().map(|place| (place - middle) * (place - middle).transpose()).sum::<Matrix2<f64>>()
                / count;
        let sides = moments.symmetric_eigenvalues().map(|moment| (12.0 * moment.max(0.0)).sqrt());
        Self { sides: sides.into() }
    }

    /// How many times larger the mean of a doubt over the ink is than over the facets, at most. Ink that
    /// covers the share s of the facets may be where the squares of the doubt are 1/s times their mean
    /// (Cauchy & Schwarz), and nowhere more than [`PEAK`] squared. A line is as wide as its pieces are long.
    fn times_mean(&self, doubt: Uncertainty) -> f64 {
        let reach = doubt.reach();
        let squared = self.sides.iter().map(|side| 1.0 + reach / side.max(PIECE)).product::<f64>();
        if reach > 0.0 { (OF_SIZES * squared.sqrt()).clamp(1.0, PEAK) } else { 1.0 }
    }
}

/// An inked square on the part.
#[derive(Debug, Clone, Copy)]
struct Square {
    /// |area on the part − area drawn|, mm².
    error: f64,
    /// The share of the area, mm², that is uncertain.
    uncertain: f64,
    /// Largest |area on the part / area drawn − 1|.
    stretch: f64,
    across: Vector3<f64>,
    up: Vector3<f64>,
    doubt: Uncertainty,
}

impl Square {
    fn measure(
        center: FlatPoint,
        side: f64,
        lift: impl Fn(FlatPoint) -> Result<Point3<f64>, ViewPoint>,
        doubt: impl Fn(ViewPoint) -> Uncertainty,
        spread: &Spread,
    ) -> Result<Self, ViewPoint> {
        let [a, b, c, d] = corners_of(center, side);
        Ok(Self::between([lift(a)?, lift(b)?, lift(c)?, lift(d)?], side, doubt, spread))
    }

    /// The square between the images of its corners, anticlockwise from the lower left one.
    fn between(
        [a, b, c, d]: [Point3<f64>; 4],
        side: f64,
        doubt: impl Fn(ViewPoint) -> Uncertainty,
        spread: &Spread,
    ) -> Self {
        let area = ((b - a).cross(&(c - a)).norm() + (c - a).cross(&(d - a)).norm()) / 2.0;
        let drawn = side * side;
        let across = (b - a) + (c - d);
        let up = (d - a) + (c - b);
        let doubt = doubt(ViewPoint::from(nalgebra::center(&a, &c).coords.xy()));
        let mean = area * share(tilt(&across, &up), doubt);
        let error = (area - drawn).abs();
        let uncertain = mean * spread.times_mean(doubt);
        Self { error, uncertain, stretch: (error + PEAK * mean) / drawn, across, up, doubt }
    }
}

/// The corners of a square, anticlockwise from the lower left one.
fn corners_of(center: FlatPoint, side: f64) -> [FlatPoint; 4] {
    let half = side / 2.0;
    let corner = |x: f64, y: f64| FlatPoint::new(center.x + x * half, center.y + y * half);
    [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]
}

/// A corner of a square with its image on the part.
type Corner = (FlatPoint, Point3<f64>);

/// The images of the corners of squares that follow row by row. Neighbours share corners: those at one place are lifted once.
#[derive(Default)]
struct SharedCorners {
    /// The right corners of the last square: the lower one and the upper one.
    right: Option<[Corner; 2]>,
    /// The upper corners of the last row, from left to right.
    below: Vec<Corner>,
    /// The first of them that is not to the left of the last square.
    next: usize,
    /// The upper corners of this row.
    above: Vec<Corner>,
}

/// Corners closer than this share of the side are at one place; they differ by rounding.
const SAME_CORNER: f64 = 1e-9;

impl SharedCorners {
    /// The images of the corners of a square, anticlockwise from the lower left one.
    ///
    /// # Errors
    /// Those of `lift`.
    fn of<E>(
        &mut self,
        center: FlatPoint,
        side: f64,
        lift: impl Fn(FlatPoint) -> Result<Point3<f64>, E>,
    ) -> Result<[Point3<f64>; 4], E> {
        let [a, b, c, d] = corners_of(center, side);
        if self.right.is_none_or(|[lower, _]| lower.0.y != a.y) {
            std::mem::swap(&mut self.below, &mut self.above);
            self.above.clear();
            self.next = 0;
        }
        let near = SAME_CORNER * side;
        let is_at =
            |of: FlatPoint, flat: FlatPoint| (of.x - flat.x).abs() < near && (of.y - flat.y).abs() < near;
        let known = |corner: Option<&Corner>, flat: FlatPoint| {
            corner.filter(|(of, _)| is_at(*of, flat)).map(|(_, image)| *image)
        };
        let beside =
            |index: usize, flat: FlatPoint| known(self.right.as_ref().map(|right| &right[index]), flat);
        self.next += self.below[self.next..].iter().take_while(|(of, _)| of.x < a.x - near).count();
        let below = |index: usize, flat: FlatPoint| known(self.below.get(self.next + index), flat);
        let left = below(0, a);
        let right = below(usize::from(left.is_some()), b);
        let (left, upper_left) = (beside(0, a).or(left), beside(1, d));
        let lifted = |known: Option<Point3<f64>>, flat: FlatPoint| known.map_or_else(|| lift(flat), Ok);
        let images = [lifted(left, a)?, lifted(right, b)?, lift(c)?, lifted(upper_left, d)?];
        if upper_left.is_none() {
            self.above.push((d, images[3]));
        }
        self.above.push((c, images[2]));
        self.right = Some([(b, images[1]), (c, images[2])]);
        Ok(images)
    }
}

/// Blocks are divided until at most this share of a sum over an inked area is open. [`SAME_AREA`] applies if
/// it allows more.
const OPEN: f64 = 2e-3;
/// Blocks are divided until at most this share of the inked area is open. [`OPEN`] applies if it allows more.
const SAME_AREA: f64 = 1e-8;
/// Rounding may change the sums of samples by this share of the area.
const ROUNDING: f64 = 1e-10;
/// Blocks are divided until a largest value can grow by no more than this factor, and by [`SAME`].
const SLACK: f64 = 1.002;
/// Blocks are divided until a largest stretch, or a largest angle in rad, can grow by no more than this in
/// addition to [`SLACK`].
const SAME: f64 = 2e-6;

/// How far a sum over many blocks may be wrong. A trend over the area adds up from block to block; roughness does not.
#[derive(Debug, Clone, Copy, Default)]
struct Open {
    sum: f64,
    squares: f64,
}

impl Open {
    /// The standard deviations of errors that do not add up.
    const DEVIATIONS: f64 = 3.0;

    fn add(&mut self, off_by: f64) {
        self.sum += off_by;
        self.squares += off_by * off_by;
    }

    fn remove(&mut self, off_by: f64) {
        self.sum -= off_by;
        self.squares -= off_by * off_by;
    }

    fn total(&self) -> f64 {
        self.sum.abs() + Self::DEVIATIONS * self.squares.max(0.0).sqrt()
    }
}

/// What is known of a block of inked area.
enum Measured {
    /// Every square was measured, or none of it is on the part.
    Exactly,
    /// It may be partly beside the part.
    Divided,
    /// On the surface.
    Within(Estimate),
}

/// What follows from the squares at six places of a block.
struct Estimate {
    /// Mean error and uncertain share of a square, mm².
    mean: [f64; 2],
    /// How much less their sums over the block may be than what a coarser formula gives, mm²: the error of the sums is smaller.
    off_by: [f64; 2],
    /// The largest stretch of an area and error of an angle that are possible in the block.
    largest: [f64; 2],
    /// The largest uncertainty in the block.
    uncertainty: Uncertainty,
}

impl Estimate {
    fn of(squares: &[Square; 6], block: Block, known: &Relief, slope: f64) -> Self {
        let [one, other, quarters @ ..] = squares;
        let mean = |value: fn(&Square) -> f64| {
            let around = quarters.iter().map(value).sum::<f64>() / 4.0;
            let middle = (value(one) + value(other)) / 2.0;
            let mean = middle + (around - middle) * block.weight();
            [if mean > 0.0 { mean } else { around }, around - middle]
        };
        let of_squares = [mean(|square| square.error), mean(|square| square.uncertain)];
        let reach = |value: &dyn Fn(&Square) -> f64| {
            let [least, most] =
                squares.iter().map(value).fold([f64::INFINITY, 0.0], |[least, most], value| {
                    [f64::min(least, value), f64::max(most, value)]
                });
            2.0 * most - least
        };
        let steepest = squares.iter().map(|square| tilt(&square.across, &square.up)).fold(0.0, f64::max);
        let between = share(steepest, Uncertainty { slope: slope as f32, height: 0.0 });
        let doubted = squares.iter().map(|square| square.doubt).fold(Uncertainty::NONE, Uncertainty::largest);
        let beyond = PEAK_OF_ANGLE * (share(steepest, known.uncertainty) - share(steepest, doubted)).max(0.0);
        let angle = |square: &Square| {
            let Square { across, up, doubt, .. } = square;
            angle_error(across, up) + PEAK_OF_ANGLE * share(tilt(across, up), *doubt)
        };
        Self {
            mean: of_squares.map(|[mean, _]| mean),
            off_by: of_squares.map(|[_, apart]| apart / 2.0 * block.squares() as f64),
            largest: [reach(&|square| square.stretch), reach(&angle)].map(|reach| reach + between + beyond),
            uncertainty: known.uncertainty,
        }
    }
}

/// Measures a large inked area: blocks of squares are divided where the sums are not known well enough from the squares at
/// six places of each, where the part could reach beyond the largest values that are known, and where it may be missing.
fn measure_blocks(
    ink: &Ink,
    relief: &ReliefMap<'_>,
    map: impl Fn(FlatPoint) -> ViewPoint,
    lift: impl Fn(FlatPoint) -> Result<Point3<f64>, ViewPoint>,
    doubt: impl Fn(ViewPoint) -> Uncertainty,
    distortion: &mut Distortion,
) -> Result<(), ViewPoint> {
    let mut missing: Option<(FlatPoint, ViewPoint)> = None;
    let mut is_missing = |at: FlatPoint, seen: ViewPoint| {
        if missing.is_none_or(|(first, _)| is_before(at, first)) {
            missing = Some((at, seen));
        }
    };
    let spread = Spread::of(ink);
    let measure = |at: FlatPoint| Square::measure(at, ink.side, &lift, &doubt, &spread);
    let examine = |distortion: &mut Distortion, block: Block| {
        let area = relief.image(block.corners(ink.side).map(&map));
        let known = match relief.over(&area) {
            Cover::None => {
                if let Err(seen) = measure(block.first) {
                    is_missing(block.first, seen);
                }
                return Measured::Exactly;
            }
            Cover::Some if block.count > 2 => return Measured::Divided,
            Cover::Some => None,
            Cover::All(known) => Some(known).filter(|_| block.count > 2),
        };
        let Some(known) = known else {
            for at in block.each(ink.side) {
                match measure(at) {
                    Ok(square) => distortion.include(&square, 1.0),
                    Err(seen) => is_missing(at, seen),
                }
            }
            return Measured::Exactly;
        };
        let [Ok(a), Ok(b), Ok(c), Ok(d), Ok(e), Ok(f)] = block.places(ink.side).map(measure) else {
            return Measured::Divided;
        };
        let squares = [a, b, c, d, e, f];
        squares.iter().for_each(|square| distortion.include(square, 0.0));
        let slope = relief.slope_between(&known, f64::from(block.count) * ink.side);
        Measured::Within(Estimate::of(&squares, block, &known, slope))
    };
    let blocks = ink.survey(distortion, examine, choose);
    if let Some((_, seen)) = missing {
        return Err(seen);
    }
    let mut open = [Open::default(); 2];
    for (block, measured) in blocks {
        if let Measured::Within(estimate) = measured {
            distortion.include_open(&estimate, block.squares() as f64);
            open.iter_mut().zip(estimate.off_by).for_each(|(open, off_by)| open.add(off_by));
        }
    }
    let [error, uncertain] = open.map(|open| open.total());
    distortion.area_error += error + uncertain + ROUNDING * distortion.area;
    distortion.uncertain.area_error += uncertain;
    Ok(())
}

/// The blocks to divide.
fn choose(distortion: &Distortion, blocks: &[(Block, Measured)]) -> Vec<bool> {
    let beyond = |possible: f64, known: f64| possible > SLACK * known + SAME;
    let is_open = |(_, measured): &(Block, Measured)| match measured {
        Measured::Exactly => false,
        Measured::Divided => true,
        Measured::Within(estimate) => {
            let (largest, uncertain) = (estimate.uncertainty, &distortion.uncertain);
            beyond(estimate.largest[0], distortion.max_area_stretch)
                || beyond(estimate.largest[1], distortion.max_angle_error)
                || f64::from(largest.slope) > SLACK * uncertain.max_slope
                || f64::from(largest.height) > SLACK * uncertain.max_height
        }
    };
    let mut chosen: Vec<bool> = blocks.iter().map(is_open).collect();
    let (mut sum, mut open) = (distortion.area_error, [Open::default(); 2]);
    let mut estimates = Vec::new();
    for (index, (block, measured)) in blocks.iter().enumerate() {
        if let Measured::Within(Estimate { mean, off_by, .. }) = measured {
            sum += (mean[0] + mean[1]) * block.squares() as f64;
            open.iter_mut().zip(off_by).for_each(|(open, off_by)| open.add(*off_by));
            estimates.push((*off_by, index));
        }
    }
    let limit = (OPEN * sum).max(SAME_AREA * distortion.area);
    estimates.sort_by(|(one, _), (other, _)| other[0].abs().total_cmp(&one[0].abs()));
    for (off_by, index) in estimates {
        if !(open[0].total() + open[1].total() > limit) {
            break;
        }
        open.iter_mut().zip(off_by).for_each(|(open, off_by)| open.remove(off_by));
        chosen[index] = true;
    }
    chosen
}

impl Distortion {
    /// Adds the differences of chords, for each path.
    ///
    /// The map may shorten the same pieces, so that both add up in the estimate from above.
    pub fn shorten(&mut self, paths: impl IntoIterator<Item = Shortening>) {
        let (mut most, mut squares) = (0.0f64, 0.0);
        for path in paths {
            self.length_error += path.lost;
            most = most.max(path.largest_share);
            // No chord differs by a larger share.
            squares += path.lost * path.largest_share;
        }
        self.stretch_range[0] -= most;
        self.max_stretch = self.max_stretch.max(-self.stretch_range[0]);
        if self.length > 0.0 {
            self.rms_stretch += (squares / self.length).sqrt();
        }
    }

    /// Includes a square of the inked area: its largest values, and its sums `times` times.
    fn include(&mut self, square: &Square, times: f64) {
        self.area_error += times * (square.error + square.uncertain);
        self.uncertain.area_error += times * square.uncertain;
        self.max_area_stretch = self.max_area_stretch.max(square.stretch);
        self.include_angle([&square.across, &square.up], square.doubt);
    }

    /// Includes a block in which some squares were measured, with the amount that they leave open.
    fn include_open(&mut self, block: &Estimate, squares: f64) {
        let [error, uncertain] = block.mean.map(|mean| mean * squares);
        self.area_error += error + uncertain;
        self.uncertain.area_error += uncertain;
        self.max_area_stretch = self.max_area_stretch.max(block.largest[0]);
        self.max_angle_error = self.max_angle_error.max(block.largest[1]);
        self.uncertain.max_slope = self.uncertain.max_slope.max(f64::from(block.uncertainty.slope));
        self.uncertain.max_height = self.uncertain.max_height.max(f64::from(block.uncertainty.height));
    }

    /// Includes the angle error where unit steps of the drawing become two vectors on the part, with a doubt about
    /// the part.
    fn include_angle(&mut self, [across, up]: [&Vector3<f64>; 2], doubt: Uncertainty) {
        // No angle changes by more than half a turn, whatever the slope.
        let uncertain = (PEAK_OF_ANGLE * share(tilt(across, up), doubt)).min(PI);
        self.max_angle_error = self.max_angle_error.max((angle_error(across, up) + uncertain).min(PI));
        self.uncertain.max_angle_error = self.uncertain.max_angle_error.max(uncertain);
        self.uncertain.max_slope = self.uncertain.max_slope.max(f64::from(doubt.slope));
        self.uncertain.max_height = self.uncertain.max_height.max(f64::from(doubt.height));
    }
}

/// The share by which a length changes where it climbs with the slope `tan`, if the angle of the slope is wrong by as
/// much as it may; 0 without a doubt.
fn share(tan: f64, doubt: Uncertainty) -> f64 {
    let slope = f64::from(doubt.slope);
    if slope > 0.0 { tan * slope + slope * slope / 2.0 } else { 0.0 }
}

/// The tangent of the angle between the laser's axis and the normal of a plane through two vectors.
fn tilt(across: &Vector3<f64>, up: &Vector3<f64>) -> f64 {
    let normal = across.cross(up);
    normal.xy().norm() / normal.z.abs()
}

/// Smallest and largest length on the part / length drawn − 1 of the pieces that are on the part; `None` if none is.
pub fn stretch_range(
    ink: &Ink,
    map: impl Fn(FlatPoint) -> ViewPoint,
    height: impl Fn(ViewPoint) -> Option<f64>,
) -> Option<[f64; 2]> {
    let mut range = None;
    for Lifted { piece, from, to } in lifted(ink, |flat| lift(flat, &map, &height)).flatten() {
        widen(&mut range, (to - from).norm() / piece.length() - 1.0);
    }
    range
}

fn widen(range: &mut Option<[f64; 2]>, stretch: f64) {
    let [min, max] = range.unwrap_or([stretch; 2]);
    *range = Some([min.min(stretch), max.max(stretch)]);
}

/// A piece of a line, and the images of its ends on the part.
struct Lifted {
    piece: Piece,
    from: Point3<f64>,
    to: Point3<f64>,
}

/// The pieces on the part; for a piece with an end outside the part, the position of that end in the view.
fn lifted(
    ink: &Ink,
    lift: impl Fn(FlatPoint) -> Result<Point3<f64>, ViewPoint>,
) -> impl Iterator<Item = Result<Lifted, ViewPoint>> {
    let mut last: Option<(FlatPoint, Point3<f64>)> = None;
    // `Ink` has public fields, so callers may add pieces without length.
    ink.pieces.iter().filter(|piece| piece.length() > 0.0).map(move |piece| {
        // Most pieces start where the last one ended.
        let from = match last {
            Some((flat, point)) if flat == piece.from => point,
            _ => lift(piece.from)?,
        };
        let to = lift(piece.to)?;
        last = Some((piece.to, to));
        Ok(Lifted { piece: *piece, from, to })
    })
}

/// The image of a point of the drawing on the part, or its position in the view if there is no surface.
fn lift(
    flat: FlatPoint,
    map: &impl Fn(FlatPoint) -> ViewPoint,
    height: &impl Fn(ViewPoint) -> Option<f64>,
) -> Result<Point3<f64>, ViewPoint> {
    let seen = map(flat);
    height(seen).map(|z| Point3::new(seen.x, seen.y, z)).ok_or(seen)
}

/// The largest change of the angle between any two directions, rad, where unit steps in s and t of the drawing become
/// the vectors `across` and `up` on the part: 2·asin((σ₁ − σ₂)/(σ₁ + σ₂)) for the principal stretches σ₁ ≥ σ₂.
///
/// Tissot's maximum angular distortion (Snyder, Map Projections: A Working Manual, 1987, eq. 4-1a).
fn angle_error(across: &Vector3<f64>, up: &Vector3<f64>) -> f64 {
    let (e, f, g) = (across.norm_squared(), across.dot(up), up.norm_squared());
    // (σ₁ ± σ₂)² = E + G ± 2√(EG − F²)
    let twice_area = 2.0 * (e * g - f * f).max(0.0).sqrt();
    let ratio = ((e + g - twice_area).max(0.0) / (e + g + twice_area)).sqrt();
    2.0 * ratio.clamp(0.0, 1.0).asin()
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::f64::consts::TAU;

    use super::*;
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::mapping::isometric::IsometricOptions;
    use crate::geometry::mapping::{LengthTrueMap, Method};
    use crate::geometry::pattern::Pattern;
    use crate::geometry::shapes;
    use crate::geometry::space::View;
    use crate::geometry::surface::fit::FitOptions;
    use nalgebra::Vector2;

    /// A circle that the map makes smaller, marked as a regular polygon.
    #[test]
    fn what_the_map_and_the_chords_shorten_adds_up() {
        let (radius, share, sides) = (8.0, 0.001, 48.0);
        let at = |angle: f64| FlatPoint::new(radius * angle.cos(), radius * angle.sin());
        let steps = 4800;
        let angle = |step: i32| TAU * f64::from(step) / f64::from(steps);
        let pieces = (0..steps).map(|step| Piece { from: at(angle(step)), to: at(angle(step + 1)) });
        let mut ink = Ink::sample(&Pattern::default(), |_| true, PIECE, SQUARE);
        ink.pieces = pieces.collect();
        let smaller = |flat: FlatPoint| ViewPoint::from(flat.coords() * (1.0 - share));
        let mut reported = measure(&ink, smaller, |_| Some(0.0)).unwrap();
        let drawn = TAU * radius;
        let polygon = 2.0 * sides * radius * (TAU / 2.0 / sides).sin();
        reported.shorten([Shortening { lost: drawn - polygon, largest_share: 1.0 - polygon / drawn }]);
        let truth = 1.0 - (1.0 - share) * polygon / drawn;
        for stretch in [
            reported.max_stretch,
            -reported.stretch_range[0],
            reported.rms_stretch,
            reported.length_error / drawn,
        ] {
            assert!(stretch >= truth && stretch < 1.01 * truth, "{stretch} for {truth}");
        }
    }

    #[test]
    fn no_angle_changes_by_more_than_half_a_turn() {
        let ink = Ink::sample(&Pattern::outline(3.0), |_| true, PIECE, SQUARE);
        let doubt = |_: ViewPoint| Uncertainty { slope: 2.0, ..Uncertainty::NONE };
        let steep = |at: ViewPoint| Some(3.0 * at.x);
        let reported = measure_at_most(&ink, |at| ViewPoint::from(at.coords()), steep, doubt).unwrap();
        assert_eq!([reported.max_angle_error, reported.uncertain.max_angle_error], [PI; 2]);
    }

    #[test]
    fn a_corner_of_several_squares_is_lifted_once_and_changes_no_result() {
        let mut ink = Ink::sample(&Pattern::outline(3.0), |_| true, PIECE, SQUARE);
        ink.pieces.clear();
        let lifts = Cell::new(0);
        let area_error = |squares: Vec<FlatPoint>| {
            let map = |at: FlatPoint| {
                lifts.set(lifts.get() + 1);
                ViewPoint::new(1.1 * at.x, at.y)
            };
            let inked_area = squares.len() as f64 * SQUARE.powi(2);
            let ink = Ink { squares, inked_area, ..ink.clone() };
            measure(&ink, map, |at| Some(0.1 * at.x * at.y)).unwrap().area_error
        };
        area_error(ink.squares.clone());
        assert_eq!((ink.squares.len(), lifts.get()), (30 * 30, 31 * 31));
        // Rows with gaps, and squares that are no neighbours.
        let is_kept = |at: &&FlatPoint| at.distance(FlatPoint::new(0.3, -0.4)) > 1.0 && at.x.sin() < 0.9;
        let kept: Vec<FlatPoint> = ink.squares.iter().filter(is_kept).copied().collect();
        let alone: f64 = kept.iter().map(|square| area_error(vec![*square])).sum();
        assert!((area_error(kept) - alone).abs() < 1e-12 * alone);
    }

    /// Ribs with straight flanks of slope 0.2, 40 mm long, over a length along x, mm, as a mesh with the normals of its facets.
    fn ribs(pitch: f64, length: f64) -> FacingPart<'static> {
        let half = pitch / 2.0;
        let count = (length / half).round() as i32;
        let (mut positions, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        for flank in 0..count {
            let first = positions.len() as u32;
            let rises = flank % 2 == 0;
            let normal = Vector3::new(if rises { -0.2 } else { 0.2 }, 0.0, 1.0).normalize();
            for (end, y) in [(0, -20.0), (1, -20.0), (1, 20.0), (0, 20.0)] {
                let x = f64::from(flank + end) * half - length / 2.0;
                positions.push(Point3::new(x, y, if rises == (end == 1) { 0.2 * half } else { 0.0 }));
                normals.push(normal);
            }
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        FacingPart::new(
            &crate::geometry::mesh::TriMesh::new(positions, normals, triangles).unwrap(),
            &View::top(),
        )
    }

    #[test]
    fn ribs_as_fine_as_the_samples_are_reported() {
        // At the first samples, 120 mm / 144 apart, ribs of 0.8 mm look like waves of 20 mm.
        for pitch in [0.4, 0.8, 0.84, 1.2, 2.0] {
            let part = ribs(pitch, (120.0 / pitch).round() * pitch);
            let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
            let mut ink = Ink::sample(&Pattern::default(), |_| true, PIECE, SQUARE);
            let at = |step: i32| FlatPoint::new(f64::from(step) * PIECE - 15.0, 3.3);
            ink.pieces = (0..120).map(|step| Piece { from: at(step), to: at(step + 1) }).collect();
            let reported = measure_on(&surface, &ink, &|at| ViewPoint::from(at.coords()), true).unwrap();
            let truth = 30.0 * (1.04f64.sqrt() - 1.0);
            let length_error = reported.length_error;
            assert!(
                length_error > 0.98 * truth && length_error < 3.0 * truth,
                "{pitch}: {length_error} for {truth}"
            );
        }
    }

    /// A plane with a dent of 0.3 mm and a radius of about 2 mm.
    fn dented(x: f64, y: f64) -> f64 {
        let square = (x - 5.3).powi(2) + (y + 4.1).powi(2);
        0.05 * x - 0.3 * (-square / 2.0).exp()
    }

    /// A roof with its ridge along y.
    fn roof(x: f64, _: f64) -> f64 {
        8.0 - 0.2 * (x - 1.23).abs()
    }

    fn compared(surface: &FittedSurface, pattern: &Pattern, map: &LengthTrueMap, name: &str) {
        let ink = Ink::sample(pattern, |_| true, PIECE, SQUARE);
        let (place, doubt) = (|at| map.point(at), |at| surface.uncertainty(at));
        let each = measure_at_most(&ink, place, |at| surface.sampled_height(at), doubt);
        let found = measure_on(surface, &ink, &place, true);
        let (Ok(each), Ok(found)) = (each, found) else {
            let apart = each.unwrap_err().distance(found.unwrap_err());
            return assert!(apart < 1e-9, "{name}: {apart} mm");
        };
        for (what, each, found, same) in [
            ("area error", each.area_error, found.area_error, 1e-7 * each.area),
            ("stretch of an area", each.max_area_stretch, found.max_area_stretch, SAME),
            ("angle error", each.max_angle_error, found.max_angle_error, SAME),
            (
                "uncertain area",
                each.uncertain.area_error,
                found.uncertain.area_error,
                0.002 * each.area_error,
            ),
            ("uncertain slope", each.uncertain.max_slope, found.uncertain.max_slope, 0.0),
            ("uncertain height", each.uncertain.max_height, found.uncertain.max_height, 0.0),
        ] {
            let is_above = found >= each * (1.0 - 1e-9);
            assert!(is_above && found <= 1.004 * each + same, "{name}: {what} {found} for {each}");
        }
        assert_eq!((each.length_error, each.area), (found.length_error, found.area));
        assert_eq!((each.max_stretch, each.max_stretch_at), (found.max_stretch, found.max_stretch_at));
    }

    #[test]
    fn a_large_area_is_measured_as_its_single_squares_are() {
        for (name, height, edge) in [
            ("mouse", &shapes::mouse as &dyn Fn(f64, f64) -> f64, 0.75),
            ("cylinder", &shapes::cylinder, 0.75),
            ("coarse mouse", &shapes::mouse, 4.0),
            ("dent", &dented, 0.75),
            ("roof", &roof, 0.75),
            ("plane", &|x, _| 0.02 * x, 0.75),
        ] {
            let part = FacingPart::new(&shapes::graph(25.0, edge, height), &View::top());
            let surface = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
            let uncertainties = vec![Uncertainty { slope: 2e-3, height: 1e-3 }; surface.field.nodes().len()];
            let surface = surface.doubted(Vec::new(), uncertainties);
            let pattern = Pattern::outline(12.9);
            let anchor = FlatPoint::new(0.0, 0.0);
            let method = Method::Isometric(IsometricOptions::INK);
            let found = LengthTrueMap::find(&surface, &pattern, |_| true, anchor, &method).unwrap();
            for map in [&LengthTrueMap::Plain, &found] {
                compared(&surface, &pattern, map, name);
            }
        }
    }

    /// A hole in the middle, or the border of the part.
    #[test]
    fn a_place_without_surface_is_the_first_of_the_single_squares() {
        let mut mesh = shapes::graph(25.0, 0.75, shapes::cylinder);
        let far = |at: Vector2<f64>| (at - Vector2::new(3.0, -2.0)).norm() > 1.5;
        let all = mesh.triangles().to_vec();
        let positions = mesh.positions().to_vec();
        let kept = all
            .into_iter()
            .filter(|corners| corners.iter().all(|&corner| far(positions[corner as usize].coords.xy())));
        mesh = crate::geometry::mesh::TriMesh::new(positions.clone(), Vec::new(), kept.collect()).unwrap();
        let surface = FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default());
        let surface = surface.unwrap();
        for half in [10.0, 24.0, 60.0] {
            compared(&surface, &Pattern::outline(half), &LengthTrueMap::Plain, "hole");
        }
    }
}
