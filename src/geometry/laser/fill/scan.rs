//! Where the lines of a fill begin and end: the crossings of the level lines with the contours.

use nalgebra::{Matrix2, Vector2};

use super::distance::DistanceField;
use crate::geometry::pattern::Color;
use crate::geometry::space::{Extents, FlatPoint};

/// Pieces shorter than this are not marked, mm.
const SHORTEST: f64 = 0.005;

/// Areas are measured along at most this many rows.
const MOST_ROWS: f64 = 20_000.0;
/// The rows along which areas are measured cross at most about this many contours in all.
const MOST_CROSSINGS: f64 = 2e7;

/// A contour of filled regions: points so close that the distance is linear between them.
#[derive(Debug, Clone)]
pub(super) struct Outline {
    /// The fill that it bounds with others by the even-odd rule.
    pub(super) region: Option<u32>,
    pub(super) color: Color,
    /// Its points; the last one is joined to the first.
    pub(super) points: Vec<FlatPoint>,
}

impl Outline {
    pub(super) fn extents(&self) -> Extents {
        Extents::of(self.points.iter().map(|point| point.coords()))
    }

    pub(super) fn sides(&self) -> impl Iterator<Item = (FlatPoint, FlatPoint)> {
        self.points.iter().copied().zip(self.points.iter().copied().cycle().skip(1))
    }
}

/// A piece of a level line inside the regions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Interval {
    /// The number of the line.
    pub(super) line: i64,
    /// Where it starts and ends, mm along the lines.
    pub(super) from: f64,
    pub(super) to: f64,
    /// How far to the left its start is, mm.
    pub(super) left: f64,
    pub(super) color: Color,
}

/// Where a line crosses a contour.
struct Crossing {
    line: i64,
    along: f64,
    left: f64,
    outline: usize,
}

/// The distance at which a line is, mm. No line is at 0, so that none runs along a side of a symmetric drawing whose size is
/// a multiple of the spacing.
pub(super) fn level(line: i64, spacing: f64) -> f64 {
    (line as f64 + 0.5) * spacing
}

/// The first line at this distance or beyond.
fn first_line(distance: f64, spacing: f64) -> i64 {
    (distance / spacing - 0.5).ceil() as i64
}

/// The pieces of all level lines inside the regions, at least `border` mm from their contours on the part, line by line and in
/// the direction of the lines. `metric` is the first fundamental form of the part over the drawing.
pub(super) fn intervals(
    field: &DistanceField,
    outlines: &[Outline],
    spacing: f64,
    border: f64,
    metric: impl Fn(FlatPoint) -> Matrix2<f64>,
) -> Vec<Interval> {
    let mut crossings = crossings(field, outlines, spacing);
    crossings.sort_unstable_by(|a, b| {
        a.line.cmp(&b.line).then(a.along.total_cmp(&b.along)).then(a.outline.cmp(&b.outline))
    });
    let mut intervals = Vec::with_capacity(crossings.len() / 2);
    for line in crossings.chunk_by(|a, b| a.line == b.line) {
        inside(line, outlines, &mut intervals);
    }
    if border > 0.0 {
        let cuts = cuts(field, outlines, spacing, border, metric);
        intervals = without(&intervals, &cuts);
    }
    intervals.retain(|piece| piece.to - piece.from >= SHORTEST);
    intervals
}

fn crossings(field: &DistanceField, outlines: &[Outline], spacing: f64) -> Vec<Crossing> {
    let mut crossings = Vec::new();
    for (index, outline) in outlines.iter().enumerate() {
        let distances: Vec<f64> = outline.points.iter().map(|point| field.distance(*point)).collect();
        let next = distances.iter().cycle().skip(1);
        for ((from, to), (start, end)) in outline.sides().zip(distances.iter().zip(next)) {
            // Each side has its lower end but not its upper one, so that a line through a corner crosses it once or twice.
            for line in first_line(start.min(*end), spacing)..first_line(start.max(*end), spacing) {
                let level = level(line, spacing);
                let share = |distance: f64| (level - distance) / (end - start);
                let rough = share(*start).clamp(0.0, 1.0);
                let better = rough + share(field.distance(from.lerp(to, rough)));
                let at = from.lerp(to, better.clamp(0.0, 1.0));
                crossings.push(Crossing {
                    line,
                    along: field.along(at),
                    left: field.left(at),
                    outline: index,
                });
            }
        }
    }
    crossings
}

/// Whether a place is filled that is inside of these regions, where `None` is the inside of outlines: inside of a region or of
/// outlines, but not of both.
fn is_filled(regions: &[Option<u32>]) -> bool {
    regions.contains(&None) != regions.iter().any(Option::is_some)
}

/// The pieces of one line that are filled, each in the colour of the innermost contour round its start.
fn inside(line: &[Crossing], outlines: &[Outline], intervals: &mut Vec<Interval>) {
    // The contours round the place, the innermost last, and the regions that it is inside of.
    let mut around: Vec<usize> = Vec::new();
    let mut regions: Vec<Option<u32>> = Vec::new();
    let mut open: Option<Interval> = None;
    for crossing in line {
        match around.iter().position(|outline| *outline == crossing.outline) {
            Some(position) => drop(around.remove(position)),
            None => around.push(crossing.outline),
        }
        let Some(outline) = outlines.get(crossing.outline) else { continue };
        match regions.iter().position(|region| *region == outline.region) {
            Some(position) => drop(regions.remove(position)),
            None => regions.push(outline.region),
        }
        match (is_filled(&regions), open.as_mut()) {
            (true, None) => {
                let color = around.last().and_then(|index| outlines.get(*index)).unwrap_or(outline).color;
                open = Some(Interval {
                    line: crossing.line,
                    from: crossing.along,
                    to: crossing.along,
                    left: crossing.left,
                    color,
                });
            }
            (false, Some(piece)) => {
                piece.to = crossing.along;
                intervals.push(*piece);
                open = None;
            }
            (true, Some(_)) | (false, None) => {}
        }
    }
}

/// The filled area, mm²: the sum of the lengths inside along rows of the drawing. If there are few corners,
/// the rows are between the heights of all corners, which is exact where contours do not cross. Otherwise
/// there are [`MOST_ROWS`] or fewer, at uneven heights, to prevent a periodic drawing from matching them.
pub(super) fn area(outlines: &[Outline]) -> f64 {
    let mut sides: Vec<(FlatPoint, FlatPoint, Option<u32>)> = Vec::new();
    for outline in outlines {
        let upwards = outline.sides().map(|(from, to)| if from.y < to.y { (from, to) } else { (to, from) });
        sides.extend(upwards.map(|(low, high)| (low, high, outline.region)));
    }
    sides.retain(|(low, high, _)| low.y < high.y);
    sides.sort_unstable_by(|a, b| a.0.y.total_cmp(&b.0.y).then(a.0.x.total_cmp(&b.0.x)));
    let mut heights: Vec<f64> = sides.iter().flat_map(|(low, high, _)| [low.y, high.y]).collect();
    heights.sort_unstable_by(f64::total_cmp);
    heights.dedup();
    let (Some(bottom), Some(top)) = (heights.first().copied(), heights.last().copied()) else { return 0.0 };
    let crossed: f64 = sides.iter().map(|(low, high, _)| high.y - low.y).sum::<f64>() / (top - bottom);
    let most = (MOST_CROSSINGS / crossed.max(1.0)).clamp(256.0, MOST_ROWS) as usize;
    let rows: Vec<(f64, f64)> = if heights.len() <= most {
        heights.windows(2).map(|ends| ((ends[0] + ends[1]) / 2.0, ends[1] - ends[0])).collect()
    } else {
        let height = (top - bottom) / most as f64;
        // Multiples of the golden ratio are spread evenly, and never periodic.
        let place = |row: usize| row as f64 + (row as f64 * 0.618_033_988_749_895).fract();
        (0..most).map(|row| (bottom + place(row) * height, height)).collect()
    };
    let (mut area, mut next) = (0.0, 0);
    let mut active: Vec<usize> = Vec::new();
    let mut crossings: Vec<(f64, Option<u32>)> = Vec::new();
    let mut regions: Vec<Option<u32>> = Vec::new();
    for (y, height) in rows {
        while sides.get(next).is_some_and(|(low, ..)| low.y <= y) {
            active.push(next);
            next += 1;
        }
        active.retain(|&side| sides[side].1.y > y);
        crossings.clear();
        crossings.extend(active.iter().map(|&side| {
            let (low, high, region) = sides[side];
            (low.x + (high.x - low.x) * ((y - low.y) / (high.y - low.y)), region)
        }));
        crossings.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        regions.clear();
        let mut last = 0.0;
        for &(at, region) in &crossings {
            if is_filled(&regions) {
                area += (at - last) * height;
            }
            match regions.iter().position(|inside| *inside == region) {
                Some(position) => drop(regions.swap_remove(position)),
                None => regions.push(region),
            }
            last = at;
        }
    }
    area
}

/// A part of a line that is too close to a contour: its number, start and end.
type Cut = (i64, f64, f64);

/// The parts of the lines within `border` mm of a contour, measured on the part, sorted.
///
/// What is within a distance of a straight side is convex, so a line has one such part for each side.
fn cuts(
    field: &DistanceField,
    outlines: &[Outline],
    spacing: f64,
    border: f64,
    metric: impl Fn(FlatPoint) -> Matrix2<f64>,
) -> Vec<Cut> {
    let mut cuts = Vec::new();
    for (from, to) in outlines.iter().flat_map(Outline::sides) {
        let middle = from.lerp(to, 0.5);
        // In the coordinates after the Cholesky factor of the metric, lengths are those on the part.
        let Some(factor) = metric(middle).cholesky().map(|factor| factor.l().transpose()) else { continue };
        let Some(inverse) = factor.try_inverse() else { continue };
        let gradient = inverse.transpose() * field.gradient(middle);
        let steepness = gradient.norm();
        if !(steepness > 1e-6) {
            continue;
        }
        let (upwards, distance) = (gradient / steepness, field.distance(middle));
        let sideways = Vector2::new(upwards.y, -upwards.x);
        let ends = [from, to].map(|end| factor * (end - middle));
        let [a, b] = ends.map(|end| Vector2::new(end.dot(&sideways), end.dot(&upwards)));
        let reach = |end: f64| distance + steepness * end;
        let (lowest, highest) = (a.y.min(b.y) - border, a.y.max(b.y) + border);
        for line in first_line(reach(lowest), spacing)..first_line(reach(highest), spacing) {
            let height = (level(line, spacing) - distance) / steepness;
            let Some([first, last]) = chord_of_stadium([a, b], border, height) else { continue };
            let along = |x: f64| {
                let at = middle + inverse * (sideways * x + upwards * height);
                field.along(at)
            };
            let (first, last) = (along(first), along(last));
            cuts.push((line, first.min(last), first.max(last)));
        }
    }
    cuts.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2)));
    cuts
}

/// Where the horizontal line at `height` enters and leaves the set of points within `radius` of the straight line from `a` to
/// `b`; `None` if it misses the set.
fn chord_of_stadium([a, b]: [Vector2<f64>; 2], radius: f64, height: f64) -> Option<[f64; 2]> {
    let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut include = |x: f64| (first, last) = (first.min(x), last.max(x));
    for end in [a, b] {
        let half = (radius * radius - (height - end.y).powi(2)).sqrt();
        if half >= 0.0 {
            include(end.x - half);
            include(end.x + half);
        }
    }
    let side = b - a;
    if let Some(direction) = side.try_normalize(1e-12) {
        let beside = Vector2::new(-direction.y, direction.x) * radius;
        for offset in [beside, -beside] {
            let share = (height - a.y - offset.y) / side.y;
            if (0.0..=1.0).contains(&share) {
                include(a.x + offset.x + share * side.x);
            }
        }
    }
    (first <= last).then_some([first, last])
}

/// The pieces without the cuts; both are sorted by line.
fn without(pieces: &[Interval], cuts: &[Cut]) -> Vec<Interval> {
    let mut rest = Vec::with_capacity(pieces.len());
    for piece in pieces {
        let start = cuts.partition_point(|cut| cut.0 < piece.line);
        let of_line = cuts[start..].iter().take_while(|cut| cut.0 == piece.line);
        let mut from = piece.from;
        for (_, first, last) in of_line {
            if *first >= piece.to {
                break;
            }
            if *first > from {
                rest.push(Interval { from, to: *first, ..*piece });
            }
            from = from.max(*last);
        }
        if from < piece.to {
            rest.push(Interval { from, ..*piece });
        }
    }
    rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chord_of_a_stadium_is_that_of_its_discs_and_its_sides() {
        let ends = [Vector2::new(0.0, 0.0), Vector2::new(10.0, 0.0)];
        assert_eq!(chord_of_stadium(ends, 2.0, 0.0), Some([-2.0, 12.0]));
        let [first, last] = chord_of_stadium(ends, 2.0, 1.0).unwrap();
        assert!((first + 3f64.sqrt()).abs() < 1e-12 && (last - 10.0 - 3f64.sqrt()).abs() < 1e-12);
        assert_eq!(chord_of_stadium(ends, 2.0, 2.1), None);
        // Across an upright stadium, its width.
        let upright = [Vector2::new(0.0, 0.0), Vector2::new(0.0, 10.0)];
        let [first, last] = chord_of_stadium(upright, 2.0, 5.0).unwrap();
        assert!((first + 2.0).abs() < 1e-12 && (last - 2.0).abs() < 1e-12);
    }
}
