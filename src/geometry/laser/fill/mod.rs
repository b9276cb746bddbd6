//! Fills regions of the drawing with lines that are evenly spaced on the part.
//!
//! Lines that are even in the drawing are uneven on a part that cannot be unrolled. So the lines here are the level lines of a
//! distance that is measured on the part (`distance`), cut at the contours (`scan`). They are found in the plane of the
//! drawing: there the contours are as drawn, and the map of the drawing takes lines and contours to the same places.

mod crossing;
mod distance;
mod nesting;
mod scan;
mod trace;

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2};

use self::crossing::crossing;
use self::distance::DistanceField;
use self::nesting::{are_inside_odd, drop_covered};
use self::scan::{Interval, Outline};
use self::trace::Tracer;
use super::correction::{AboveLens, Projection};
use crate::geometry::ink::{bounding_paths, squares_filled};
use crate::geometry::mapping::Method;
use crate::geometry::normal_equations::SolveError;
use crate::geometry::pattern::{Color, Path, Pattern, Shape};
use crate::geometry::space::{Extents, FieldPoint, FlatPoint};
use crate::geometry::surface::knots::UniformKnots;

/// Chord tolerance of contours, mm.
const CONTOUR: f64 = 2e-4;
/// Greatest distance between the points of a contour, mm: the distance across the lines is linear between them.
const SIDE: f64 = 0.5;
/// Half the distance between the points whose difference gives a direction on the part, mm.
const STEP: f64 = 0.1;
/// Places at which the spacing is measured.
const PLACES: f64 = 5000.0;
/// A spacing that deviates by more than this share is uneven.
pub const EVEN: f64 = 0.01;
/// Share of the spacing by which a line may deviate from the true curve between its points.
const CHORD_SHARE: f64 = 0.005;
/// Greatest total length of all lines, mm: more than an hour of marking.
pub const LONGEST: f64 = 5e6;
/// Greatest number of points of all lines, and of pieces of them.
pub const MOST_POINTS: usize = 3_000_000;

/// What a fill is.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FillOptions {
    /// Distance of neighbouring lines on the part, mm.
    pub spacing: f64,
    /// The direction of the lines of each family in the placed drawing, rad.
    pub angles: Vec<f64>,
    /// Distance of the lines from the contours on the part, mm.
    pub border: f64,
    /// Largest distance between a line and its chords in the field, mm; less for a small spacing.
    pub tolerance: f64,
}

impl FillOptions {
    /// Lines `spacing` mm apart, one family for each of `angles` (rad), `border` mm from the contours, as chords within
    /// `tolerance` mm.
    #[must_use]
    pub fn new(spacing: f64, angles: Vec<f64>, border: f64, tolerance: f64) -> Self {
        Self { spacing, angles, border, tolerance }
    }
}

/// A line of a fill.
#[derive(Debug, Clone, PartialEq)]
pub struct FillLine {
    /// Its number in its family, from one side to the other.
    pub number: i64,
    /// The layer of its contours: index into [`Pattern::layers`].
    pub layer: usize,
    /// The colour of the contour round it.
    pub color: Color,
    /// Its points in the placed drawing, mm.
    pub drawn: Vec<FlatPoint>,
    /// The same points in the field, mm.
    pub marked: Vec<FieldPoint>,
}

/// All lines of a fill, and how even they are on the part.
#[derive(Debug, Clone, PartialEq)]
pub struct Filling {
    /// The lines: layer by layer, family by family, from one side to the other, every second line in the opposite direction.
    pub lines: Vec<FillLine>,
    /// Their length on the part, mm.
    pub length: f64,
    /// The filled area as drawn, of all layers, mm².
    pub area: f64,
    /// Smallest and largest deviation of the spacing on the part, as a share of it.
    pub deviation: [f64; 2],
    /// Where the larger of the two is, in the placed drawing.
    pub deviation_at: FlatPoint,
    /// The share of the fill whose spacing deviates by more than [`EVEN`].
    pub uneven: f64,
    /// Smallest and largest length of a piece of a line on the part divided by its length in the field: where it is larger
    /// than 1, spots are farther apart on the part and the line gets less energy.
    pub spot_spacing: [f64; 2],
    /// Where the largest is, in the placed drawing.
    pub spot_spacing_at: FlatPoint,
}

/// Why there is no fill.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FillError {
    /// The lines are too long, or too many.
    #[error("the fill needs {length:.0} mm of lines in {pieces} pieces")]
    TooMuch {
        /// Length of all lines, mm, estimated.
        length: f64,
        /// Number of pieces or points, counted so far.
        pieces: usize,
    },
    /// The part is as high as the lens.
    #[error(transparent)]
    AboveLens(#[from] AboveLens),
    /// The distance on the part could not be found.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// An unusual contour of a fill.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpenLine {
    /// Distance between its ends, mm.
    pub gap: f64,
    /// Its start, mm.
    pub at: FlatPoint,
}

/// The lines on layers for which `is_filled` is true that enclose no area because they are open, the smallest
/// gap first. Strokes of letters and patterns are open on purpose.
pub fn open_lines(pattern: &Pattern, is_filled: impl Fn(&str) -> bool) -> Vec<OpenLine> {
    let is_on_layer = |index: usize| pattern.layers.get(index).is_some_and(|layer| is_filled(&layer.name));
    let open = pattern.paths.iter().filter(|path| {
        is_on_layer(path.layer)
            && matches!(path.shape, Shape::Open(_))
            && !path.is_contour()
            && !path.source.is_stroke
    });
    let mut open: Vec<OpenLine> = open
        .filter_map(|path| {
            let segments = path.shape.segments();
            let (at, end) = (segments.first()?.start(), segments.last()?.end());
            Some(OpenLine { gap: at.distance(end), at })
        })
        .collect();
    open.sort_by(|a, b| a.gap.total_cmp(&b.gap));
    open
}

/// The places where contours on filled layers cross themselves, mm, one for each contour.
pub fn self_crossings(pattern: &Pattern, is_filled: impl Fn(&str) -> bool) -> Vec<FlatPoint> {
    let groups = bounding_paths(pattern, is_filled);
    let outlines = groups.values().flatten().filter(|path| bounds_an_area(path));
    outlines.filter_map(|path| crossing(&path.shape.flattened(CONTOUR * 10.0))).collect()
}

/// Where hatches, letters and other regions on filled layers are inside outlines that are filled too, and so stay unfilled: the
/// start of each region, mm.
pub fn regions_in_outlines(pattern: &Pattern, is_filled: impl Fn(&str) -> bool) -> Vec<FlatPoint> {
    let mut starts = Vec::new();
    for (_, outlines) in layers_of(pattern, is_filled) {
        let (regions, outlines): (Vec<Outline>, Vec<Outline>) =
            outlines.into_iter().partition(|outline| outline.region.is_some());
        let regions = regions.chunk_by(|one, other| one.region == other.region);
        let of_layer: Vec<FlatPoint> = regions.map(|region| region[0].points[0]).collect();
        let are_inside = are_inside_odd(&of_layer, &outlines);
        starts.extend(
            of_layer.into_iter().zip(are_inside).filter_map(|(start, is_inside)| is_inside.then_some(start)),
        );
    }
    starts
}

/// The contours of the fill, layer by layer.
fn layers_of(pattern: &Pattern, is_filled: impl Fn(&str) -> bool) -> Vec<(usize, Vec<Outline>)> {
    let mut layers: Vec<(usize, Vec<Outline>)> = Vec::new();
    for ((layer, region), paths) in bounding_paths(pattern, is_filled) {
        let bounding = paths.into_iter().filter(|path| bounds_an_area(path));
        let outlines = bounding.map(|path| Outline {
            region,
            color: path.color,
            points: divided(&path.shape.flattened(CONTOUR)),
        });
        let outlines = outlines.filter(|outline| outline.points.len() > 2);
        match layers.last_mut() {
            Some((last, all)) if *last == layer => all.extend(outlines),
            _ => layers.push((layer, outlines.collect())),
        }
    }
    layers.retain(|(_, outlines)| !outlines.is_empty());
    layers.iter_mut().for_each(|(_, outlines)| drop_covered(outlines));
    layers
}

/// Whether a closed path bounds something that can be filled: strokes of letters and patterns are lines, unless they bound a region, as
/// the letters of outline fonts and the cells of codes do.
fn bounds_an_area(path: &Path) -> bool {
    path.region.is_some() || !path.source.is_stroke
}

/// Fills the contours on layers for which `is_filled` is true, by the even-odd rule. An area that several
/// regions of a layer cover is filled once. Regions inside outlines that are filled too, as letters in a
/// frame, stay unfilled: the whole frame would be one block. An outline that regions cover nearly is only a
/// line; outlines in the holes of these regions are filled. Strokes of letters and patterns are lines, also
/// where they close. `None` if no area is enclosed.
///
/// # Errors
/// See [`FillError`].
pub fn fill(
    pattern: &Pattern,
    is_filled: impl Fn(&str) -> bool,
    projection: &Projection<'_>,
    options: &FillOptions,
) -> Result<Option<Filling>, FillError> {
    let layers = layers_of(pattern, is_filled);
    let mut contours: BTreeMap<(usize, Option<u32>), Vec<Vec<FlatPoint>>> = BTreeMap::new();
    for (layer, outlines) in &layers {
        for outline in outlines {
            contours.entry((*layer, outline.region)).or_default().push(outline.points.clone());
        }
    }
    let corners = contours.values().flatten().flatten().map(|point| point.coords());
    let extents = Extents::of(corners);
    let size = extents.size();
    if extents.is_empty() || !(size.x > 0.0 && size.y > 0.0) {
        return Ok(None);
    }
    let places = |number: f64| {
        let side = (size.x * size.y / number).sqrt().max(size.max() / number);
        squares_filled(&contours, &extents, side)
    };
    let area = layers.iter().map(|(_, outlines)| scan::area(outlines)).sum::<f64>();
    let families = options.angles.len().max(1) as f64;
    let length = families * area / options.spacing;
    let too_much = |pieces: usize| Err(FillError::TooMuch { length, pieces });
    if length > LONGEST {
        return too_much(0);
    }
    let metric = |at: FlatPoint| metric(projection, at);
    let is_exact = projection.map.fit_residual().is_some_and(|residual| residual <= Method::EXACT_TOLERANCE);
    let mut filling = Filling {
        lines: Vec::new(),
        length: 0.0,
        area,
        deviation: [0.0; 2],
        deviation_at: extents.center().into(),
        uneven: 0.0,
        spot_spacing: [f64::INFINITY, 0.0],
        spot_spacing_at: extents.center().into(),
    };
    let mut fields = Vec::new();
    for angle in &options.angles {
        fields.push(match is_exact {
            true => DistanceField::straight(&extents, *angle),
            false => {
                let filled = |s: &UniformKnots, t: &UniformKnots, samples| filled(&layers, s, t, samples);
                DistanceField::true_on_part(&extents, *angle, filled, metric)?
            }
        });
    }
    if !is_exact {
        let mut squares = places(PLACES * (size.x * size.y / area.max(1e-9)).min(20.0));
        if squares.is_empty() {
            squares = contours.values().flatten().flatten().copied().collect();
        }
        filling.measure(&fields, &squares, metric);
    }
    let (mut points, mut pieces) = (0, 0);
    let tolerance = options.tolerance.min(CHORD_SHARE * options.spacing);
    for (layer, outlines) in &layers {
        for field in &fields {
            let sides = outlines.iter().flat_map(Outline::sides);
            // Each side is crossed by the lines between its ends, and reaches those within the border round it.
            let reached = |(from, to): (FlatPoint, FlatPoint)| {
                (field.distance(from) - field.distance(to)).abs() + 2.0 * options.border
            };
            pieces = ((sides.map(reached).sum::<f64>() / options.spacing) as usize).saturating_add(pieces);
            if pieces > MOST_POINTS {
                return too_much(pieces);
            }
            let tracer = Tracer { field, projection, spacing: options.spacing, tolerance };
            let intervals = scan::intervals(field, outlines, options.spacing, options.border, metric);
            for line in intervals.chunk_by(|a, b| a.line == b.line) {
                let first = filling.lines.len();
                for piece in line {
                    let (drawn, marked) = filling.include(&tracer, piece)?;
                    points += drawn.len();
                    if points > MOST_POINTS {
                        return too_much(points);
                    }
                    filling.lines.push(FillLine {
                        number: piece.line,
                        layer: *layer,
                        color: piece.color,
                        drawn,
                        marked,
                    });
                }
                if line[0].line.rem_euclid(2) == 1 {
                    let pieces = &mut filling.lines[first..];
                    pieces.reverse();
                    pieces.iter_mut().for_each(|piece| {
                        piece.drawn.reverse();
                        piece.marked.reverse();
                    });
                }
            }
        }
    }
    Ok(Some(filling))
}

/// The points with others between them, at most [`SIDE`] apart.
fn divided(points: &[FlatPoint]) -> Vec<FlatPoint> {
    let mut divided = Vec::with_capacity(points.len());
    for (from, to) in points.iter().zip(points.iter().cycle().skip(1)) {
        let steps = (from.distance(*to) / SIDE).ceil().clamp(1.0, 1e5) as usize;
        divided.extend((0..steps).map(|step| from.lerp(*to, step as f64 / steps as f64)));
    }
    divided
}

/// The first fundamental form of the part over the drawing.
fn metric(projection: &Projection<'_>, at: FlatPoint) -> Matrix2<f64> {
    let landing = |x: f64, y: f64| projection.landing(at + Vector2::new(x, y)).1;
    let by_s = (landing(STEP, 0.0) - landing(-STEP, 0.0)) / (2.0 * STEP);
    let by_t = (landing(0.0, STEP) - landing(0.0, -STEP)) / (2.0 * STEP);
    let mixed = by_s.dot(&by_t);
    Matrix2::new(by_s.norm_squared(), mixed, mixed, by_t.norm_squared())
}

/// Which samples of a grid are in or beside a filled region.
fn filled(
    layers: &[(usize, Vec<Outline>)],
    knots_s: &UniformKnots,
    knots_t: &UniformKnots,
    samples: usize,
) -> Vec<bool> {
    let (columns, rows) = (knots_s.spans() * samples, knots_t.spans() * samples);
    let steps = [knots_s.step() / samples as f64, knots_t.step() / samples as f64];
    let mut filled = vec![false; columns * rows];
    let index = |value: f64, most: usize| (value.max(0.0) as usize).min(most - 1);
    for (_, outlines) in layers {
        let mut regions: Vec<Option<u32>> = outlines.iter().map(|outline| outline.region).collect();
        regions.sort_unstable();
        regions.dedup();
        for region in regions {
            let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); rows];
            for (from, to) in
                outlines.iter().filter(|outline| outline.region == region).flat_map(Outline::sides)
            {
                let place = |at: FlatPoint| {
                    ((at.x - knots_s.start()) / steps[0], (at.y - knots_t.start()) / steps[1])
                };
                let ((x0, y0), (x1, y1)) = (place(from), place(to));
                // Samples beside a contour, so that a stroke narrower than the grid has some.
                filled[index(y0, rows) * columns + index(x0, columns)] = true;
                let (low, high) = (y0.min(y1), y0.max(y1));
                let first = |y: f64| (y - 0.5).ceil().max(0.0) as usize;
                for row in first(low)..first(high).min(rows) {
                    crossings[row].push(x0 + (x1 - x0) * ((row as f64 + 0.5 - y0) / (y1 - y0)));
                }
            }
            for (row, crossings) in crossings.iter_mut().enumerate() {
                crossings.sort_unstable_by(f64::total_cmp);
                for pair in crossings.chunks_exact(2) {
                    let column = |x: f64| (x - 0.5).ceil().clamp(0.0, columns as f64) as usize;
                    filled[row * columns + column(pair[0])..row * columns + column(pair[1])].fill(true);
                }
            }
        }
    }
    // The samples beside them, too.
    let around = |index: usize| {
        let (column, row) = (index % columns, index / columns);
        (row.saturating_sub(1)..(row + 2).min(rows)).any(|row| {
            (column.saturating_sub(1)..(column + 2).min(columns)).any(|column| filled[row * columns + column])
        })
    };
    (0..filled.len()).map(around).collect()
}

impl Filling {
    /// Measures how even the lines of all fields are at these places.
    fn measure(
        &mut self,
        fields: &[DistanceField],
        places: &[FlatPoint],
        metric: impl Fn(FlatPoint) -> Matrix2<f64>,
    ) {
        let (mut uneven, mut all, mut largest) = (0usize, 0usize, 0.0);
        for at in places {
            let Some(inverse) = metric(*at).try_inverse() else { continue };
            for field in fields {
                let gradient = field.gradient(*at);
                let deviation = 1.0 / gradient.dot(&(inverse * gradient)).sqrt() - 1.0;
                if !deviation.is_finite() {
                    continue;
                }
                all += 1;
                uneven += usize::from(deviation.abs() > EVEN);
                self.deviation = [self.deviation[0].min(deviation), self.deviation[1].max(deviation)];
                if deviation.abs() > largest {
                    (largest, self.deviation_at) = (deviation.abs(), *at);
                }
            }
        }
        self.uneven = uneven as f64 / all.max(1) as f64;
    }

    /// Traces a piece of a line and adds it to the results; returns its points in the drawing and in the field.
    fn include(
        &mut self,
        tracer: &Tracer<'_>,
        piece: &Interval,
    ) -> Result<(Vec<FlatPoint>, Vec<FieldPoint>), AboveLens> {
        let stations = tracer.stations(piece)?;
        for ends in stations.windows(2) {
            let on_part = (ends[1].landing - ends[0].landing).norm();
            let in_field = ends[0].field.distance(ends[1].field);
            self.length += on_part;
            let ratio = on_part / in_field;
            if ratio.is_finite() && on_part > STEP {
                self.spot_spacing[0] = self.spot_spacing[0].min(ratio);
                if ratio > self.spot_spacing[1] {
                    (self.spot_spacing[1], self.spot_spacing_at) = (ratio, ends[0].flat);
                }
            }
        }
        let kept = tracer.simplified(piece, &stations)?;
        Ok(kept.iter().map(|station| (station.flat, station.field)).unzip())
    }
}

#[cfg(test)]
mod tests;
