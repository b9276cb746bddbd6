//! Repairs drawings: joins loose pieces into contours, because CAD exporters write every line and arc of an outline
//! separately, and removes duplicates and curves without length.
//!
//! Two ends are joined when they are within the tolerance of each other, no third end is that close, and both have the
//! same layer and colour. A piece keeps its place in the drawing order; a chain takes the place of its first piece.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2};

use super::pattern::{Affine, Color, Path, SAME_POINT, Segment, Shape, Source};
use crate::geometry::space::FlatPoint;

/// The result of a repair. Every list is complete and in drawing order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Repaired {
    /// The paths after the repair, in drawing order.
    pub paths: Vec<Path>,
    /// Contours made by repaired pieces.
    pub contours: Vec<Finding>,
    /// Open lines made by repaired pieces.
    pub chains: Vec<Finding>,
    /// Single paths that were closed, because their ends met within the tolerance.
    pub closed: Vec<Finding>,
    /// Open paths whose ends nearly meet, but are farther apart than the tolerance.
    pub nearly_closed: Vec<Finding>,
    /// Paths that draw the same as another path on the same layer in the same colour; removed unless repairs are off.
    pub duplicates: Vec<Finding>,
    /// Curves without length, and pieces without length inside longer ones; removed unless repairs are off.
    pub without_length: Vec<Finding>,
    /// Number of ends that were not joined because more than two meet there.
    pub ambiguous_ends: usize,
}

/// Something found in a drawing, and where.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The path, or the first of its pieces.
    pub source: Source,
    /// Index of its layer.
    pub layer: usize,
    /// Its start, mm.
    pub at: FlatPoint,
    /// Number of pieces concerned.
    pub pieces: usize,
    /// The widest gap between two ends that were joined, or that nearly meet, mm.
    pub gap: f64,
}

impl Finding {
    fn of(path: &Path, pieces: usize, gap: f64) -> Self {
        let at = match &path.shape {
            Shape::Dot(point) => *point,
            Shape::Open(segments) | Shape::Closed(segments) => {
                segments.first().map_or(FlatPoint::new(0.0, 0.0), Segment::start)
            }
        };
        Self { source: path.source.clone(), layer: path.layer, at, pieces, gap }
    }
}

/// Open paths with a gap up to this length, mm, are reported: far above rounding, far below an intended opening.
pub const NEARLY_CLOSED: f64 = 0.1;

/// Repairs a drawing: removes curves without length and duplicates, joins open paths whose ends are within
/// `tolerance` mm of each other, and closes paths that return to their start.
///
/// Paths that bound a fill and strokes of letters and patterns are not joined. A fill is a duplicate only if all its
/// contours are. Between an outline and an equal contour of a fill, the fill's contour is kept; between an open line
/// and an equal contour, the contour is kept. Pieces no larger than the tolerance are joined only where ends
/// coincide. A tolerance of 0 joins nothing. Takes O(n log n) time.
pub fn repair(mut paths: Vec<Path>, tolerance: f64) -> Repaired {
    let mut result = Repaired::default();
    paths.retain_mut(|path| {
        let found = remove_empty(path);
        result.without_length.extend(found);
        matches!(path.shape, Shape::Dot(_)) || !path.shape.segments().is_empty()
    });
    result.remove_copies(&mut paths);
    let mut loose: Vec<Loose> = paths.into_iter().map(|path| Loose { path, pieces: 1, gap: 0.0 }).collect();
    // Ends that coincide are joined first, even if other ends are near.
    for tolerance in [tolerance.min(SAME_POINT), tolerance] {
        if tolerance > 0.0 {
            (loose, result.ambiguous_ends) = chained(loose, tolerance);
        }
    }
    for Loose { path, pieces, gap } in loose {
        match (pieces, path.shape.is_closed()) {
            (1, true) if gap > 0.0 => result.closed.push(Finding::of(&path, 1, gap)),
            (1, _) => {}
            (count, true) => result.contours.push(Finding::of(&path, count, gap)),
            (count, false) => result.chains.push(Finding::of(&path, count, gap)),
        }
        result.note_opening(&path, tolerance);
        result.paths.push(path);
    }
    // If a path was drawn once as a whole and once in pieces, the two are equal only after repaired.
    if !(result.contours.is_empty() && result.chains.is_empty()) {
        let mut paths = std::mem::take(&mut result.paths);
        result.remove_copies(&mut paths);
        result.paths = paths;
    }
    result
}

/// Finds everything that [`repair`] would remove, and small openings in outlines that may be unintended, without
/// changing the paths.
pub fn examine(paths: Vec<Path>) -> Repaired {
    let mut result = Repaired::default();
    for path in &paths {
        result.without_length.extend(remove_empty(&mut path.clone()));
        result.note_opening(path, 0.0);
    }
    let copies = copies(&paths);
    let found = paths.iter().zip(&copies).filter(|(_, is_copy)| **is_copy);
    result.duplicates = found.map(|(path, _)| Finding::of(path, 1, 0.0)).collect();
    result.paths = paths;
    result
}

impl Repaired {
    fn remove_copies(&mut self, paths: &mut Vec<Path>) {
        let mut copies = copies(paths).into_iter();
        paths.retain(|path| {
            let is_copy = copies.next().unwrap_or(false);
            if is_copy {
                self.duplicates.push(Finding::of(path, 1, 0.0));
            }
            !is_copy
        });
    }

    fn note_opening(&mut self, path: &Path, tolerance: f64) {
        let Shape::Open(segments) = &path.shape else { return };
        let (Some(first), Some(last)) = (segments.first(), segments.last()) else { return };
        let gap = first.start().distance(last.end());
        if gap <= NEARLY_CLOSED && gap > tolerance.max(SAME_POINT) && reaches_beyond(segments, 2.0 * gap) {
            self.nearly_closed.push(Finding::of(path, 1, gap));
        }
    }
}

/// A path, the number of pieces it is made of, and the widest gap between two of them, mm.
struct Loose {
    path: Path,
    pieces: usize,
    gap: f64,
}

/// The paths joined where their ends meet, and the number of ends that meet more than one other end.
fn chained(mut loose: Vec<Loose>, tolerance: f64) -> (Vec<Loose>, usize) {
    let joinable: Vec<bool> = loose.iter().map(|loose| is_joinable(&loose.path, tolerance)).collect();
    let (partners, ambiguous_ends) = partners(&loose, &joinable, tolerance);
    let mut done = vec![false; loose.len()];
    for first in 0..loose.len() {
        if done[first] || !joinable[first] {
            continue;
        }
        let (ends, returns) = chain(first, &partners);
        if ends.len() == 1 && !returns {
            continue;
        }
        let (mut segments, mut gap) = connected(&ends, &mut loose);
        if let (true, Some(start), Some(end)) =
            (returns, segments.first().map(Segment::start), segments.last().map(Segment::end))
        {
            gap = gap.max(start.distance(end));
            close(&mut segments);
        }
        let mut pieces = 0;
        for piece in ends.iter().map(|end| end / 2) {
            done[piece] = true;
            pieces += std::mem::take(&mut loose[piece].pieces);
            gap = gap.max(loose[piece].gap);
        }
        let chain = &mut loose[first];
        chain.path.shape = if returns { Shape::Closed(segments) } else { Shape::Open(segments) };
        (chain.pieces, chain.gap) = (pieces, gap);
    }
    loose.retain(|loose| loose.pieces > 0);
    (loose, ambiguous_ends)
}

/// Removes the pieces without length from a path; if the whole path has no length, all its pieces.
fn remove_empty(path: &mut Path) -> Option<Finding> {
    let found = Finding::of(path, 0, 0.0);
    let segments = match &mut path.shape {
        Shape::Dot(_) => return None,
        Shape::Open(segments) | Shape::Closed(segments) => segments,
    };
    let before = segments.len();
    if reaches_beyond(segments, SAME_POINT) {
        segments.retain(|segment| !matches!(segment, Segment::Line { from, to } if from == to));
    } else {
        segments.clear();
    }
    let pieces = before - segments.len();
    (pieces > 0).then_some(Finding { pieces, ..found })
}

/// Whether the path is an open curve, larger than the tolerance, that is neither part of a fill nor one stroke of
/// several.
fn is_joinable(path: &Path, tolerance: f64) -> bool {
    match &path.shape {
        Shape::Open(segments) => {
            path.region.is_none() && !path.source.is_stroke && reaches_beyond(segments, tolerance)
        }
        _ => false,
    }
}

/// Whether the curve goes farther than `distance` mm from its start.
fn reaches_beyond(segments: &[Segment], distance: f64) -> bool {
    let Some(start) = segments.first().map(Segment::start) else { return false };
    let reaches = |segment: &Segment| match segment {
        Segment::Line { to, .. } => to.distance(start) > distance,
        curve => [0.25, 0.5, 0.75, 1.0].iter().any(|t| curve.point(*t).distance(start) > distance),
    };
    segments.iter().any(reaches)
}

// The start of a path has the number 2·path and its end 2·path + 1; the other end of the same path is `end ^ 1`.

fn end_point(loose: &[Loose], end: usize) -> Option<FlatPoint> {
    let segments = loose[end / 2].path.shape.segments();
    if end.is_multiple_of(2) {
        segments.first().map(Segment::start)
    } else {
        segments.last().map(Segment::end)
    }
}

type Group = (usize, (u8, u8, [u8; 3]));

fn group(path: &Path) -> Group {
    let color = match path.color {
        Color::ByLayer => (0, 0, [0; 3]),
        Color::Aci(aci) => (1, aci, [0; 3]),
        Color::Rgb { aci, rgb } => (2, aci, rgb),
    };
    (path.layer, color)
}

/// For every end, the one other end that it meets; and the number of ends that meet more than one.
fn partners(loose: &[Loose], joinable: &[bool], tolerance: f64) -> (Vec<Option<usize>>, usize) {
    // Cells of half the tolerance: all ends in one cell meet, so no cell is searched more than a few times.
    let cell = |coordinate: f64| (2.0 * coordinate / tolerance).floor() as i64;
    let mut ends: Vec<((Group, i64, i64), usize, FlatPoint)> = (0..2 * loose.len())
        .filter(|end| joinable[end / 2])
        .filter_map(|end| end_point(loose, end).map(|point| (end, point)))
        .map(|(end, point)| ((group(&loose[end / 2].path), cell(point.x), cell(point.y)), end, point))
        .collect();
    ends.sort_unstable_by_key(|(cell, end, _)| (*cell, *end));
    let mut met: Vec<Meeting> = vec![Meeting::None; 2 * loose.len()];
    // The start of the search in each of the neighbouring columns of cells. Cells are visited in order, so it only
    // moves forward.
    let mut begins = [0; 7];
    for here in ends.chunk_by(|a, b| a.0 == b.0) {
        let (group, x, y) = here[0].0;
        for (begin, dx) in begins.iter_mut().zip(-3..) {
            let column = (group, x.saturating_add(dx), y.saturating_sub(3));
            *begin += ends[*begin..].iter().take_while(|(cell, ..)| *cell < column).count();
        }
        for (_, end, point) in here {
            if here.len() > 2 {
                met[*end] = Meeting::Many;
                continue;
            }
            let near = begins.iter().zip(-3..).flat_map(|(begin, dx)| {
                let last = (group, x.saturating_add(dx), y.saturating_add(3));
                ends[*begin..].iter().take_while(move |(cell, ..)| *cell <= last)
            });
            let mut others =
                near.filter(|(_, other, there)| other != end && there.distance(*point) <= tolerance);
            met[*end] = match (others.next(), others.next()) {
                (None, _) => Meeting::None,
                (Some((_, other, _)), None) => Meeting::One(*other),
                _ => Meeting::Many,
            };
        }
    }
    let ambiguous = met.iter().filter(|meeting| **meeting == Meeting::Many).count();
    let mutual = (0..met.len()).map(|end| match met[end] {
        Meeting::One(other) if met[other] == Meeting::One(end) => Some(other),
        _ => None,
    });
    (mutual.collect(), ambiguous)
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Meeting {
    None,
    One(usize),
    Many,
}

/// The chain that `first` belongs to, as the ends at which its pieces are entered, and whether it is closed. The first
/// piece keeps its direction.
fn chain(first: usize, partners: &[Option<usize>]) -> (Vec<usize>, bool) {
    let start = 2 * first;
    let mut forward = vec![start];
    let mut end = start ^ 1;
    while let Some(next) = partners[end] {
        if next == start {
            return (forward, true);
        }
        forward.push(next);
        end = next ^ 1;
    }
    let mut backward = Vec::new();
    let mut end = start;
    while let Some(previous) = partners[end] {
        // It is entered at its far end, so that it leads to the following piece.
        backward.push(previous ^ 1);
        end = previous ^ 1;
    }
    backward.reverse();
    backward.append(&mut forward);
    (backward, false)
}

/// The segments of consecutive pieces, with each piece adjusted to start exactly where the last one ended, and the
/// widest gap between two pieces, mm.
fn connected(ends: &[usize], loose: &mut [Loose]) -> (Vec<Segment>, f64) {
    let mut row: Vec<Segment> = Vec::new();
    let mut widest = 0.0f64;
    for &end in ends {
        let mut segments = match &mut loose[end / 2].path.shape {
            Shape::Dot(_) => Vec::new(),
            Shape::Open(segments) | Shape::Closed(segments) => std::mem::take(segments),
        };
        if !end.is_multiple_of(2) {
            segments = segments.iter().rev().map(Segment::reversed).collect();
        }
        if let (Some(start), Some(first)) = (row.last().map(Segment::end), segments.first_mut()) {
            widest = widest.max(start.distance(first.start()));
            match with_ends(first, start, first.end()) {
                Some(moved) => *first = moved,
                None => row.push(Segment::Line { from: start, to: first.start() }),
            }
        }
        if row.is_empty() {
            row = segments;
        } else {
            row.append(&mut segments);
        }
    }
    (row, widest)
}

/// Moves the end of the last segment onto the start of the first.
fn close(segments: &mut Vec<Segment>) {
    let Some(start) = segments.first().map(Segment::start) else { return };
    if let [Segment::Arc { sweep, .. }] = segments.as_mut_slice() {
        *sweep = std::f64::consts::TAU.copysign(*sweep);
    } else if let Some(last) = segments.last_mut() {
        let end = last.end();
        match with_ends(last, last.start(), start) {
            Some(moved) => *last = moved,
            None => segments.push(Segment::Line { from: end, to: start }),
        }
    }
}

/// The segment with its ends moved to nearby points; no point of it moves more than three times as far as both ends
/// together. `None` for an arc that would move farther because its ends are close to each other.
fn with_ends(segment: &Segment, start: FlatPoint, end: FlatPoint) -> Option<Segment> {
    let (first, last) = (start - segment.start(), end - segment.end());
    Some(match segment {
        Segment::Line { .. } => Segment::Line { from: start, to: end },
        // Each control point moves with its end, so the directions at the ends are kept.
        Segment::Bezier { points: [_, after, before, _], weights } => {
            Segment::Bezier { points: [start, *after + first, *before + last, end], weights: *weights }
        }
        unchanged if first == last && first.norm() == 0.0 => unchanged.clone(),
        Segment::Arc { u, v, .. } => {
            let (old, new) = (segment.end() - segment.start(), end - start);
            let square = old.norm_squared();
            let reach = 2.0 * u.norm().max(v.norm());
            if square == 0.0
                || (new - old).norm() * reach > (first.norm() + last.norm()) * square.sqrt() * 2.0
            {
                return None;
            }
            let (cos, sin) = (old.dot(&new) / square, (old.x * new.y - old.y * new.x) / square);
            let linear = Matrix2::new(cos, -sin, sin, cos);
            let offset: Vector2<f64> = start.coords() - linear * segment.start().coords();
            segment.transformed(&Affine { linear, offset })
        }
    })
}

/// For each path, whether it draws the same as another one on the same layer in the same colour.
fn copies(paths: &[Path]) -> Vec<bool> {
    let drawn: Vec<Drawn> = paths.iter().map(Drawn::by).collect();
    // A fill is compared as a whole: all its contours together.
    let mut fills: BTreeMap<u32, (Group, Drawn)> = BTreeMap::new();
    for (path, drawn) in paths.iter().zip(&drawn) {
        if let Some(region) = path.region {
            fills.entry(region).or_insert((group(path), Drawn::default())).1.add(drawn);
        }
    }
    let mut seen: BTreeMap<(Group, Drawn), u32> = BTreeMap::new();
    for (region, key) in &fills {
        seen.entry(*key).or_insert(*region);
    }
    let is_kept = |region: u32| fills.get(&region).and_then(|key| seen.get(key)) == Some(&region);
    // Of equal paths, the first by rank is kept: fill, contour, line. Removing a contour instead of an equal open line
    // would lose the area that it bounds.
    let (of_fill, contour, line) = (0, 1, 2);
    let mut is_copy = vec![false; paths.len()];
    let mut ranked: Vec<([u64; 2], i32, usize)> = Vec::with_capacity(paths.len());
    for (index, (path, drawn)) in paths.iter().zip(&drawn).enumerate() {
        let rank = match path.region {
            Some(region) if is_kept(region) => of_fill,
            Some(_) => {
                is_copy[index] = true;
                continue;
            }
            None if path.shape.is_closed() => contour,
            None => line,
        };
        ranked.push((drawn.in_group(group(path)), rank, index));
    }
    ranked.sort_unstable();
    for same in ranked.chunk_by(|a, b| a.0 == b.0) {
        for (_, rank, index) in &same[1..] {
            is_copy[*index] = *rank != of_fill;
        }
    }
    is_copy
}

/// A hash of what is drawn, rounded to 1e-6 mm: sums over its pieces that do not depend on their order or direction.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Drawn {
    pieces: usize,
    sum: u64,
    sum_of_others: u64,
}

impl Drawn {
    pub(super) fn by(path: &Path) -> Self {
        let mut drawn = Self::default();
        if let Shape::Dot(point) = path.shape {
            drawn.add_piece(mixed(point));
            drawn.pieces = 0;
        }
        for segment in path.shape.segments() {
            drawn.add_piece(match segment {
                Segment::Line { from, to } => mixed(*from).wrapping_add(mixed(*to)),
                curve => {
                    let pair = |a: f64, b: f64| mixed(curve.point(a)).wrapping_add(mixed(curve.point(b)));
                    let outer = pair(0.0, 1.0).wrapping_add(stirred(pair(0.25, 0.75)));
                    outer ^ stirred(mixed(curve.point(0.5)).wrapping_mul(3))
                }
            });
        }
        drawn
    }

    /// A hash that also includes the layer and the colour.
    fn in_group(&self, (layer, (kind, aci, [red, green, blue])): Group) -> [u64; 2] {
        let color = u64::from_le_bytes([kind, aci, red, green, blue, 0, 0, 0]);
        let group = stirred(stirred(layer as u64) ^ color);
        [self.sum ^ group, stirred(self.sum_of_others ^ stirred(self.pieces as u64) ^ group)]
    }

    fn add_piece(&mut self, piece: u64) {
        self.pieces += 1;
        self.sum = self.sum.wrapping_add(stirred(piece));
        self.sum_of_others = self.sum_of_others.wrapping_add(stirred(piece ^ 0x5bd1_e995_9d1c_a3f7));
    }

    fn add(&mut self, other: &Self) {
        self.pieces += other.pieces;
        self.sum = self.sum.wrapping_add(other.sum);
        self.sum_of_others = self.sum_of_others.wrapping_add(other.sum_of_others);
    }
}

fn mixed(point: FlatPoint) -> u64 {
    let rounded = [point.x, point.y].map(|value| (value * 1e6).round() as i64 as u64);
    stirred(stirred(rounded[0]).wrapping_add(rounded[1]))
}

/// Mixes every bit of the number into all bits (Steele, Lea, Flood, "Fast splittable pseudorandom number generators",
/// 2014, the mixer of SplitMix64).
fn stirred(number: u64) -> u64 {
    let number = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let number = (number ^ (number >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let number = (number ^ (number >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    number ^ (number >> 31)
}

#[cfg(test)]
mod tests {
    use super::super::pattern::Source;
    use super::*;
    use std::f64::consts::PI;

    fn point(x: f64, y: f64) -> FlatPoint {
        FlatPoint::new(x, y)
    }

    fn line(from: (f64, f64), to: (f64, f64)) -> Path {
        open(Segment::Line { from: point(from.0, from.1), to: point(to.0, to.1) })
    }

    fn open(segment: Segment) -> Path {
        Path {
            layer: 0,
            color: Color::ByLayer,
            shape: Shape::Open(vec![segment]),
            region: None,
            source: Source::default(),
        }
    }

    fn arc(center: FlatPoint, radius: f64, start: f64, sweep: f64) -> Path {
        let (u, v) = (Vector2::new(radius, 0.0), Vector2::new(0.0, radius));
        open(Segment::Arc { center, u, v, start, sweep })
    }

    fn assert_connected(shape: &Shape) {
        let segments = shape.segments();
        for pair in segments.windows(2) {
            assert!(pair[0].end().distance(pair[1].start()) < 1e-9, "{pair:?}");
        }
        if shape.is_closed() {
            assert!(segments[segments.len() - 1].end().distance(segments[0].start()) < 1e-9);
        }
    }

    #[test]
    fn loose_pieces_become_one_contour_at_the_place_of_the_first_piece() {
        let pieces = vec![
            line((0.0, 0.0), (10.0, 0.0)),
            line((50.0, 0.0), (60.0, 0.0)),
            line((0.0, 4.0), (10.0, 4.0)),
            arc(point(10.0, 2.0), 2.0, -PI / 2.0, PI),
            arc(point(0.0005, 2.0), 2.0, PI / 2.0, PI),
        ];
        let repaired = repair(pieces, 0.002);
        assert_eq!((repaired.paths.len(), repaired.contours.len(), repaired.contours[0].pieces), (2, 1, 4));
        assert!(
            (repaired.contours[0].gap - 0.0005).abs() < 1e-9 && repaired.contours[0].at == point(0.0, 0.0)
        );
        assert!(repaired.paths[0].shape.is_closed());
        assert_eq!(repaired.paths[0].shape.segments()[0].start(), point(0.0, 0.0));
        assert_connected(&repaired.paths[0].shape);
    }

    #[test]
    fn a_chain_entered_in_its_middle_keeps_the_direction_of_its_first_piece() {
        let pieces = vec![
            line((10.0, 0.0), (20.0, 0.0)),
            line((10.0, 0.0), (0.0, 0.0)),
            line((30.0, 5.0), (20.0, 0.0)),
        ];
        let repaired = repair(pieces, 0.002);
        assert_eq!((repaired.paths.len(), repaired.chains.len()), (1, 1));
        let segments = repaired.paths[0].shape.segments();
        assert_eq!((segments[0].start(), segments[2].end()), (point(0.0, 0.0), point(30.0, 5.0)));
        assert_connected(&repaired.paths[0].shape);
    }

    #[test]
    fn three_ends_at_one_point_are_not_joined() {
        let pieces =
            vec![line((0.0, 0.0), (1.0, 0.0)), line((0.0, 0.0), (0.0, 1.0)), line((0.0, 0.0), (-1.0, 0.0))];
        let repaired = repair(pieces.clone(), 0.002);
        assert_eq!(repaired.paths, pieces);
        assert_eq!(repaired.ambiguous_ends, 3);
    }

    /// Largest distance of the drawing from the origin.
    fn reach(repaired: &Repaired) -> f64 {
        let points = repaired.paths.iter().flat_map(|path| path.shape.flattened(1e-4));
        points.map(|point| point.coords().norm()).fold(0.0, f64::max)
    }

    #[test]
    fn closing_a_small_gap_moves_no_point_farther_than_the_gap() {
        // An arc of almost a full turn with its ends 0.02 mm apart, and a line that ends 0.0015 mm from one of them.
        let open_by = 2e-4;
        let almost = || arc(point(0.0, 0.0), 50.0, open_by, 2.0 * PI - 2.0 * open_by);
        let (y, x) = open_by.sin_cos();
        let joined = repair(vec![line((60.0, 0.0), (50.0 * x + 0.0015, 50.0 * y)), almost()], 0.002);
        assert_eq!((joined.paths.len(), joined.chains.len()), (1, 1));
        assert_connected(&joined.paths[0].shape);
        let apart = repair(vec![almost()], 0.0);
        assert!((reach(&apart) - 50.0).abs() < 1e-6 && (reach(&joined) - 60.0).abs() < 1e-6);
        let left = joined.paths[0].shape.flattened(1e-4).iter().map(|at| at.x).fold(0.0, f64::min);
        assert!((left + 50.0).abs() < 1e-3, "{left}");
        // A loop whose ends are 0.04 mm apart also keeps its shape.
        let control = [point(0.0, 0.02), point(40.0, 30.0), point(40.0, -30.0), point(0.0, -0.02)];
        let turn = open(Segment::Bezier { points: control, weights: [1.0; 4] });
        let before = reach(&repair(vec![turn.clone()], 0.0));
        let lead = line((-1.0, 0.0), (-0.001, 0.021));
        let joined = repair(vec![lead, turn], 0.002);
        assert_eq!(joined.chains.len(), 1);
        assert!((reach(&joined) - before).abs() < 0.002, "{} for {before}", reach(&joined));
    }

    #[test]
    fn strokes_of_letters_and_patterns_are_not_joined() {
        let stroke = |from, to| {
            let path = line(from, to);
            Path { source: Source { is_stroke: true, ..path.source.clone() }, ..path }
        };
        let zigzag = vec![stroke((0.0, 0.0), (1.0, 1.0)), stroke((1.0, 1.0), (2.0, 0.0))];
        assert_eq!(repair(zigzag.clone(), 0.002).paths, zigzag);
        let branch = [zigzag, vec![line((2.0, 0.0), (3.0, 0.0))]].concat();
        assert_eq!(repair(branch.clone(), 0.002).paths, branch);
    }

    #[test]
    fn a_contour_is_kept_and_an_equal_open_line_is_removed() {
        let around = square([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)]);
        let open = Path { shape: Shape::Open(around.shape.segments().to_vec()), ..around.clone() };
        // A third end prevents the open line from being closed.
        let tail = line((0.0, 0.0), (-1.0, -1.0));
        let found = repair(vec![open, tail.clone(), around.clone()], 0.002);
        assert_eq!(found.paths, [tail, around]);
        assert_eq!(found.duplicates.len(), 1);
    }

    #[test]
    fn pieces_on_other_layers_in_other_colours_or_too_far_away_are_not_joined() {
        let mut other_layer = line((1.0, 0.0), (2.0, 0.0));
        other_layer.layer = 1;
        let mut other_color = line((2.0, 0.0), (3.0, 0.0));
        other_color.color = Color::Aci(1);
        let pieces =
            vec![line((0.0, 0.0), (1.0, 0.0)), other_layer, other_color, line((1.003, 0.0), (1.5, 1.0))];
        assert_eq!(repair(pieces.clone(), 0.002).paths, pieces);
    }

    #[test]
    fn a_duplicate_line_is_removed_and_makes_no_contour() {
        let pieces =
            vec![line((0.0, 0.0), (1.0, 0.0)), line((1.0, 0.0), (0.0, 0.0)), line((1.0, 0.0), (1.0, 1.0))];
        let repaired = repair(pieces, 0.002);
        assert_eq!((repaired.duplicates.len(), repaired.duplicates[0].at), (1, point(1.0, 0.0)));
        assert_eq!((repaired.paths.len(), repaired.contours.len(), repaired.chains[0].pieces), (1, 0, 2));
    }

    #[test]
    fn a_nearly_closed_circle_is_closed_and_a_wider_gap_is_reported() {
        let repaired = repair(vec![arc(point(0.0, 0.0), 10.0, 0.0, 2.0 * PI - 5e-6)], 0.002);
        assert_eq!(repaired.closed.len(), 1);
        assert!(
            matches!(repaired.paths[0].shape.segments(), [Segment::Arc { sweep, .. }] if *sweep == 2.0 * PI)
        );
        let repaired = repair(vec![arc(point(0.0, 0.0), 10.0, 0.0, 6.282)], 0.002);
        assert!(repaired.closed.is_empty() && repaired.nearly_closed.len() == 1);
    }

    #[test]
    fn pieces_without_length_are_removed_and_do_not_prevent_joining() {
        let pieces =
            vec![line((0.0, 0.0), (1.0, 0.0)), line((1.0, 0.0), (1.0, 0.0)), line((1.0, 0.0), (1.0, 1.0))];
        let repaired = repair(pieces, 0.002);
        assert_eq!((repaired.paths.len(), repaired.chains.len()), (1, 1));
    }

    fn square(corners: [(f64, f64); 4]) -> Path {
        let corners = corners.map(|(x, y)| point(x, y));
        let sides = (0..4).map(|i| Segment::Line { from: corners[i], to: corners[(i + 1) % 4] });
        Path { shape: Shape::Closed(sides.collect()), ..line((0.0, 0.0), (1.0, 0.0)) }
    }

    #[test]
    fn copies_are_found_with_any_start_direction_and_division() {
        let around = square([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)]);
        let back = square([(2.0, 1.0), (2.0, 0.0), (0.0, 0.0), (0.0, 1.0)]);
        let bow_tie = square([(0.0, 0.0), (2.0, 1.0), (2.0, 0.0), (0.0, 1.0)]);
        let found = repair(vec![around.clone(), back, bow_tie.clone()], 0.002);
        assert_eq!(found.paths, [around.clone(), bow_tie]);
        let sides: Vec<Path> = around.shape.segments().iter().cloned().map(open).collect();
        let found = repair([sides, vec![around]].concat(), 0.002);
        assert_eq!((found.paths.len(), found.contours.len(), found.duplicates.len()), (1, 1, 1));
    }

    #[test]
    fn an_outline_equal_to_a_fill_is_removed_and_fills_are_compared_whole() {
        let outer = square([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)]);
        let hole = square([(1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0)]);
        let of = |path: &Path, region| Path { region: Some(region), ..path.clone() };
        let ring = [of(&outer, 1), of(&hole, 1)];
        let paths = [vec![outer.clone()], ring.to_vec(), vec![of(&outer, 2), of(&hole, 3), of(&hole, 4)]];
        let found = repair(paths.concat(), 0.002);
        assert_eq!(found.paths, [ring.to_vec(), vec![of(&outer, 2), of(&hole, 3)]].concat());
        // The same contour twice in one fill means that nothing is filled; this is kept.
        let nothing = vec![of(&outer, 1), of(&outer, 1)];
        assert_eq!(repair(nothing.clone(), 0.002).paths, nothing);
    }

    #[test]
    fn repeated_points_are_removed_and_counted() {
        let segment = |from: f64, to: f64| Segment::Line { from: point(from, 0.0), to: point(to, 0.0) };
        let repeated = Path {
            shape: Shape::Open(vec![segment(0.0, 0.0), segment(0.0, 3.0), segment(3.0, 3.0)]),
            ..line((0.0, 0.0), (1.0, 0.0))
        };
        let found = repair(vec![repeated, line((5.0, 5.0), (5.0, 5.0))], 0.002);
        let counted: Vec<_> = found.without_length.iter().map(|found| (found.at, found.pieces)).collect();
        assert_eq!(counted, [(point(0.0, 0.0), 2), (point(5.0, 5.0), 1)]);
        assert_eq!(found.paths, [line((0.0, 0.0), (3.0, 0.0))]);
    }

    #[test]
    fn pieces_smaller_than_the_tolerance_are_joined_where_they_meet_exactly() {
        // Pieces of 0.0002 mm, so ten more ends are within the tolerance.
        let at = |step: i32| (f64::from(step % 5000) / 5000.0 * 2.0 * PI).sin_cos();
        let side = |step: i32| {
            let ((y0, x0), (y1, x1)) = (at(step), at(step + 1));
            line((0.16 * x0, 0.16 * y0), (0.16 * x1, 0.16 * y1))
        };
        let found = repair((0..5000).map(side).collect(), 0.002);
        assert_eq!((found.paths.len(), found.contours.len(), found.contours[0].pieces), (1, 1, 5000));
    }

    #[test]
    fn examining_reports_the_same_and_changes_nothing() {
        let pieces = vec![
            line((0.0, 0.0), (1.0, 0.0)),
            line((1.0, 0.0), (0.0, 0.0)),
            line((7.0, 7.0), (7.0, 7.0)),
            arc(point(0.0, 0.0), 10.0, 0.0, 2.0 * PI - 5e-6),
        ];
        let found = examine(pieces.clone());
        assert_eq!(found.paths, pieces);
        let counts = (found.duplicates.len(), found.without_length.len(), found.nearly_closed.len());
        assert_eq!(counts, (1, 1, 1));
    }

    #[test]
    fn many_ends_at_one_point_are_fast() {
        let star: Vec<Path> = (0..50_000).map(|i| line((0.0, 0.0), (f64::from(i), 1.0))).collect();
        assert_eq!(repair(star, 0.002).ambiguous_ends, 50_000);
    }
}
