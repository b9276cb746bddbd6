//! Loose pieces chained into contours: CAD exporters write every line and arc of an outline on its own.
//!
//! Two ends are joined when they lie within the tolerance of each other and of no third end, on the same layer and in
//! the same colour. A piece keeps its place in the drawing order; a chain takes that of its first piece.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix2, Vector2};

use super::pattern::{Affine, Color, Path, Segment, Shape};
use super::space::FlatPoint;

/// What joining made of a drawing.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Joining {
    /// The paths after joining, in drawing order.
    pub paths: Vec<Path>,
    /// Number of loose pieces that were chained to others.
    pub joined_pieces: usize,
    /// Number of contours made of chained pieces.
    pub contours: usize,
    /// Number of open chains made of pieces.
    pub chains: usize,
    /// Single paths whose ends met within the tolerance and that are contours now.
    pub closed: Vec<Closing>,
    /// Open paths whose ends nearly meet, but not within the tolerance.
    pub nearly_closed: Vec<Closing>,
    /// Ends that were left alone because more than two meet there.
    pub ambiguous_ends: usize,
    /// Paths drawn twice: index into `paths` of the later copy. They are kept as they are.
    pub duplicates: Vec<usize>,
}

/// A path with two ends close together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closing {
    /// Index into [`Joining::paths`].
    pub path: usize,
    /// Distance between the two ends, mm.
    pub gap: f64,
}

/// A gap up to this length, mm, makes an open path worth a look: far above rounding, far below a drawn opening.
pub const NEARLY_CLOSED: f64 = 0.1;

/// Chains open paths whose ends lie within `tolerance` mm of each other, and closes those that come back to themselves.
///
/// Paths that bound a fill are not touched. Pieces no larger than the tolerance are no bridge: they stay as they are.
/// Takes O(n log n).
pub fn join(paths: Vec<Path>, tolerance: f64) -> Joining {
    let copies = later_copies(&paths);
    let joinable: Vec<bool> = paths
        .iter()
        .enumerate()
        .map(|(index, path)| !copies.contains(&index) && is_joinable(path, tolerance))
        .collect();
    let (partners, ambiguous_ends) = partners(&paths, &joinable, tolerance);

    let mut result = Joining { ambiguous_ends, ..Joining::default() };
    let mut done = vec![false; paths.len()];
    for first in 0..paths.len() {
        if done[first] {
            continue;
        }
        let place = result.paths.len();
        let (pieces, returns) = chain(first, &partners);
        pieces.iter().for_each(|piece| done[piece / 2] = true);
        let mut path = paths[first].clone();
        if pieces.len() > 1 {
            result.joined_pieces += pieces.len();
            if returns {
                result.contours += 1;
            } else {
                result.chains += 1;
            }
        }
        if joinable[first] {
            let mut segments = connected(&pieces, &paths);
            let gap = match (segments.first(), segments.last()) {
                (Some(first), Some(last)) => first.start().distance(last.end()),
                _ => f64::INFINITY,
            };
            if returns {
                if pieces.len() == 1 && gap > 0.0 {
                    result.closed.push(Closing { path: place, gap });
                }
                close(&mut segments);
                path.shape = Shape::Closed(segments);
            } else {
                if gap <= NEARLY_CLOSED && gap > tolerance && reach(&segments) > 2.0 * gap {
                    result.nearly_closed.push(Closing { path: place, gap });
                }
                path.shape = Shape::Open(segments);
            }
        }
        if copies.contains(&first) {
            result.duplicates.push(place);
        }
        result.paths.push(path);
    }
    result
}

/// Whether the path is an open curve, larger than the tolerance, that bounds no fill.
fn is_joinable(path: &Path, tolerance: f64) -> bool {
    match &path.shape {
        Shape::Open(segments) => path.region.is_none() && reach(segments) > tolerance,
        _ => false,
    }
}

/// The largest distance from the start that is met on the way, mm.
fn reach(segments: &[Segment]) -> f64 {
    let Some(start) = segments.first().map(Segment::start) else { return 0.0 };
    let on_the_way = segments.iter().flat_map(|segment| [0.25, 0.5, 0.75, 1.0].map(|t| segment.point(t)));
    on_the_way.map(|point| point.distance(start)).fold(0.0, f64::max)
}

// An end is numbered 2·path for its start and 2·path + 1 for its end; the other end of the same path is `end ^ 1`.

fn end_point(paths: &[Path], end: usize) -> Option<FlatPoint> {
    let segments = paths[end / 2].shape.segments();
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

/// For every end the one end it meets, and how many ends meet more than one.
fn partners(paths: &[Path], joinable: &[bool], tolerance: f64) -> (Vec<Option<usize>>, usize) {
    // Cells of half the tolerance: all ends in one cell meet, so no cell is searched more than a few times.
    let size = tolerance / 2.0;
    let cell = |point: FlatPoint| ((point.x / size).floor() as i64, (point.y / size).floor() as i64);
    let mut cells: BTreeMap<(Group, i64, i64), Vec<usize>> = BTreeMap::new();
    for end in (0..2 * paths.len()).filter(|end| joinable[end / 2]) {
        if let Some(point) = end_point(paths, end) {
            let (x, y) = cell(point);
            cells.entry((group(&paths[end / 2]), x, y)).or_default().push(end);
        }
    }
    let mut met: Vec<Meeting> = vec![Meeting::Nobody; 2 * paths.len()];
    for ((group, x, y), ends) in &cells {
        for &end in ends {
            met[end] = if ends.len() > 2 { Meeting::Many } else { Meeting::Nobody };
            let Some(point) = end_point(paths, end).filter(|_| met[end] == Meeting::Nobody) else { continue };
            'cells: for dx in -3..=3 {
                let column = (*group, x.saturating_add(dx), y.saturating_sub(3))
                    ..=(*group, x.saturating_add(dx), y.saturating_add(3));
                for other in cells.range(column).flat_map(|(_, others)| others).filter(|other| **other != end)
                {
                    if end_point(paths, *other).is_some_and(|there| there.distance(point) <= tolerance) {
                        met[end] = match met[end] {
                            Meeting::Nobody => Meeting::One(*other),
                            _ => Meeting::Many,
                        };
                    }
                    if met[end] == Meeting::Many {
                        break 'cells;
                    }
                }
            }
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
    Nobody,
    One(usize),
    Many,
}

/// The chain that `first` belongs to, as the ends at which its pieces are entered, and whether it comes back to itself.
/// The first piece keeps its direction.
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
        // Entered from its far end, so that it leads to the piece after it.
        backward.push(previous ^ 1);
        end = previous ^ 1;
    }
    backward.reverse();
    backward.append(&mut forward);
    (backward, false)
}

/// The segments of the pieces in a row, each moved so that it starts exactly where the last one ended.
fn connected(pieces: &[usize], paths: &[Path]) -> Vec<Segment> {
    let mut row: Vec<Segment> = Vec::new();
    for &piece in pieces {
        let segments = paths[piece / 2].shape.segments();
        let directed: Vec<Segment> = if piece.is_multiple_of(2) {
            segments.to_vec()
        } else {
            segments.iter().rev().map(Segment::reversed).collect()
        };
        for (index, segment) in directed.into_iter().enumerate() {
            let target = row.last().map(Segment::end).filter(|_| index == 0);
            row.push(match target {
                Some(start) => with_ends(&segment, start, segment.end()),
                None => segment,
            });
        }
    }
    row
}

/// Moves the last end onto the first start.
fn close(segments: &mut [Segment]) {
    let count = segments.len();
    let Some(start) = segments.first().map(Segment::start) else { return };
    if let [Segment::Arc { sweep, .. }] = segments {
        *sweep = std::f64::consts::TAU.copysign(*sweep);
    } else if let Some(last) = segments.last_mut() {
        let from = last.start();
        *last = with_ends(last, from, start);
    }
    debug_assert_eq!(count, segments.len());
}

/// The segment carried by the similarity that takes its ends to new ones near by; exact to the bit for lines and Bézier
/// curves. An arc that hardly leaves its start is not changed.
fn with_ends(segment: &Segment, start: FlatPoint, end: FlatPoint) -> Segment {
    if segment.start() == start && segment.end() == end {
        return segment.clone();
    }
    let old = segment.end() - segment.start();
    let new = end - start;
    let square = old.norm_squared();
    let shift = (start - segment.start()).norm() + (end - segment.end()).norm();
    let mut moved = segment.clone();
    // Ends nearer to each other than ten times the shift would turn or swell the segment visibly.
    if square.sqrt() > 10.0 * shift {
        let (cos, sin) = (old.dot(&new) / square, (old.x * new.y - old.y * new.x) / square);
        let linear = Matrix2::new(cos, -sin, sin, cos);
        let offset: Vector2<f64> = start.coords() - linear * segment.start().coords();
        moved = segment.transformed(&Affine { linear, offset });
    }
    match &mut moved {
        Segment::Line { from, to } => (*from, *to) = (start, end),
        Segment::Bezier { points, .. } => (points[0], points[3]) = (start, end),
        Segment::Arc { .. } => {}
    }
    moved
}

/// Paths that draw exactly what an earlier path on the same layer and in the same colour draws, in either direction.
fn later_copies(paths: &[Path]) -> BTreeSet<usize> {
    let mut seen = BTreeSet::new();
    let copies = paths.iter().enumerate().filter(|(_, path)| !seen.insert((group(path), signature(path))));
    copies.map(|(index, _)| index).collect()
}

/// What a path draws, rounded to 1e-6 mm and mixed into two numbers that do not depend on its direction.
fn signature(path: &Path) -> (u64, u64, usize) {
    let rounded = |point: FlatPoint| [(point.x * 1e6).round() as i64, (point.y * 1e6).round() as i64];
    let mixed = |points: &mut dyn Iterator<Item = FlatPoint>| {
        // FNV-1a, 64 bit.
        points.flat_map(rounded).fold(0xcbf2_9ce4_8422_2325_u64, |hash, value| {
            value
                .to_le_bytes()
                .iter()
                .fold(hash, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3))
        })
    };
    if let Shape::Dot(point) = path.shape {
        return (mixed(&mut [point].into_iter()), 0, 0);
    }
    let segments = path.shape.segments();
    let ahead = mixed(&mut segments.iter().flat_map(|s| [0.0, 0.25, 0.5, 0.75, 1.0].map(|t| s.point(t))));
    let back =
        mixed(&mut segments.iter().rev().flat_map(|s| [1.0, 0.75, 0.5, 0.25, 0.0].map(|t| s.point(t))));
    let kind = segments.len() * 2 + usize::from(path.shape.is_closed());
    (ahead.min(back), ahead.max(back), kind)
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
    fn a_slot_of_loose_pieces_becomes_one_contour_in_the_place_of_its_first_piece() {
        let pieces = vec![
            line((0.0, 0.0), (10.0, 0.0)),
            line((50.0, 0.0), (60.0, 0.0)),
            line((0.0, 4.0), (10.0, 4.0)),
            arc(point(10.0, 2.0), 2.0, -PI / 2.0, PI),
            arc(point(0.0005, 2.0), 2.0, PI / 2.0, PI),
        ];
        let joining = join(pieces, 0.002);
        assert_eq!((joining.paths.len(), joining.contours, joining.joined_pieces), (2, 1, 4));
        assert!(joining.paths[0].shape.is_closed());
        assert_eq!(joining.paths[0].shape.segments()[0].start(), point(0.0, 0.0));
        assert_connected(&joining.paths[0].shape);
    }

    #[test]
    fn a_chain_entered_in_its_middle_keeps_the_direction_of_its_first_piece() {
        let pieces = vec![
            line((10.0, 0.0), (20.0, 0.0)),
            line((10.0, 0.0), (0.0, 0.0)),
            line((30.0, 5.0), (20.0, 0.0)),
        ];
        let joining = join(pieces, 0.002);
        assert_eq!((joining.paths.len(), joining.chains), (1, 1));
        let segments = joining.paths[0].shape.segments();
        assert_eq!((segments[0].start(), segments[2].end()), (point(0.0, 0.0), point(30.0, 5.0)));
        assert_connected(&joining.paths[0].shape);
    }

    #[test]
    fn three_ends_at_one_point_are_left_alone() {
        let pieces =
            vec![line((0.0, 0.0), (1.0, 0.0)), line((0.0, 0.0), (0.0, 1.0)), line((0.0, 0.0), (-1.0, 0.0))];
        let joining = join(pieces.clone(), 0.002);
        assert_eq!(joining.paths, pieces);
        assert_eq!(joining.ambiguous_ends, 3);
    }

    #[test]
    fn other_layers_colours_and_distances_are_not_joined() {
        let mut other_layer = line((1.0, 0.0), (2.0, 0.0));
        other_layer.layer = 1;
        let mut other_color = line((2.0, 0.0), (3.0, 0.0));
        other_color.color = Color::Aci(1);
        let pieces =
            vec![line((0.0, 0.0), (1.0, 0.0)), other_layer, other_color, line((1.003, 0.0), (1.5, 1.0))];
        assert_eq!(join(pieces.clone(), 0.002).paths, pieces);
    }

    #[test]
    fn a_line_drawn_twice_is_noted_and_makes_no_contour() {
        let pieces =
            vec![line((0.0, 0.0), (1.0, 0.0)), line((1.0, 0.0), (0.0, 0.0)), line((1.0, 0.0), (1.0, 1.0))];
        let joining = join(pieces, 0.002);
        assert_eq!(joining.duplicates, [1]);
        assert_eq!((joining.paths.len(), joining.contours, joining.chains), (2, 0, 1));
    }

    #[test]
    fn a_turn_that_almost_closes_is_closed_and_a_wider_gap_is_named() {
        let joining = join(vec![arc(point(0.0, 0.0), 10.0, 0.0, 2.0 * PI - 5e-6)], 0.002);
        assert_eq!(joining.closed.len(), 1);
        assert!(
            matches!(joining.paths[0].shape.segments(), [Segment::Arc { sweep, .. }] if *sweep == 2.0 * PI)
        );
        let joining = join(vec![arc(point(0.0, 0.0), 10.0, 0.0, 6.282)], 0.002);
        assert!(joining.closed.is_empty() && joining.nearly_closed.len() == 1);
    }

    #[test]
    fn pieces_smaller_than_the_tolerance_do_not_hide_a_joint() {
        let pieces =
            vec![line((0.0, 0.0), (1.0, 0.0)), line((1.0, 0.0), (1.0, 0.0)), line((1.0, 0.0), (1.0, 1.0))];
        let joining = join(pieces, 0.002);
        assert_eq!((joining.paths.len(), joining.chains), (2, 1));
    }

    #[test]
    fn many_ends_in_one_place_take_no_time() {
        let star: Vec<Path> = (0..50_000).map(|i| line((0.0, 0.0), (f64::from(i), 1.0))).collect();
        assert_eq!(join(star, 0.002).ambiguous_ends, 50_000);
    }
}
