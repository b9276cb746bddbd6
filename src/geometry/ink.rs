//! Where the drawing puts ink: short pieces along its lines, and small squares over its inked areas.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector2;

use super::contour::Drawn;
use super::pattern::{Pattern, Segment, Shape};
use super::space::{Extents, FlatPoint};

/// What is shorter than this, mm, has no stretch of its own: far above what is lost by rounding, a twentieth of the finest
/// laser spot.
pub const SHORTEST: f64 = 1e-3;
/// Chords of a curve are cut finer until they have this share of its length: one chord of a small circle has none.
const SHARE_OF_LENGTH: f64 = 0.98;
/// Pieces are made longer rather than more than this many; the ends of segments come on top.
const MOST_PIECES: f64 = 2e6;

/// Squares are made larger rather than more than this many.
const MOST_SQUARES_IN_BOX: f64 = 4e6;

/// Pieces that continue each other are put together, up to the length asked for, rather than more than this many.
const MOST_SHORT_PIECES: usize = 200_000;

/// The drawing as samples: what the quality figures sum over and what the length-true map is weighted by.
#[derive(Debug, Clone, PartialEq)]
pub struct Ink {
    /// Pieces of all curves: no longer than asked for, as long as they are no more than two million, and no shorter than
    /// [`SHORTEST`].
    pub pieces: Vec<Piece>,
    /// Single spots.
    pub dots: Vec<FlatPoint>,
    /// Centres of the squares of an axis-parallel grid that lie inside the inked area.
    pub squares: Vec<FlatPoint>,
    /// Side of the squares, mm.
    pub side: f64,
    /// The smallest rectangle round everything, dots included.
    pub extents: Extents,
}

/// A short piece of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Start, mm.
    pub from: FlatPoint,
    /// End, mm.
    pub to: FlatPoint,
}

impl Piece {
    /// Straight length, mm.
    pub fn length(&self) -> f64 {
        self.from.distance(self.to)
    }
}

impl Ink {
    /// Samples the paths for which `counts` says yes (given the layer's name) with pieces of at most `piece` mm and
    /// squares of `side` mm.
    ///
    /// The inked area of a layer is bounded by its contours under the even-odd rule, one that is drawn again by the first;
    /// a fill (HATCH, SOLID) is a region of its own. What several regions cover counts once.
    pub fn sample(pattern: &Pattern, counts: impl Fn(&str) -> bool, piece: f64, side: f64) -> Self {
        let (mut pieces, mut dots) = (Vec::new(), Vec::new());
        let mut contours: BTreeMap<(usize, Option<u32>), Vec<Vec<FlatPoint>>> = BTreeMap::new();
        let is_ink = |layer: usize| pattern.layers.get(layer).is_some_and(|layer| counts(&layer.name));
        let inked = || pattern.paths.iter().filter(|path| is_ink(path.layer));
        let (mut extents, mut length, mut outlines) = (Extents::EMPTY, 0.0, BTreeSet::new());
        for segment in inked().flat_map(|path| path.shape.segments()) {
            length += chords(segment, segment.steps(FINE), |point| extents.include(point.coords()));
        }
        let piece = piece.max(length / MOST_PIECES);
        for path in inked() {
            if let Shape::Dot(point) = path.shape {
                extents.include(point.coords());
                dots.push(point);
            }
            let stations = stations(&path.shape, piece);
            pieces.extend(stations.windows(2).map(|ends| Piece { from: ends[0], to: ends[1] }));
            // A second outline in the same place would make a hole of what the first one bounds.
            if path.is_contour() && (path.region.is_some() || outlines.insert((path.layer, Drawn::by(path))))
            {
                let group = contours.entry((path.layer, path.region)).or_default();
                group.push(path.shape.flattened(side / 40.0));
            }
        }
        if pieces.len() > MOST_SHORT_PIECES {
            put_together(&mut pieces, piece);
        }
        let size = extents.size();
        let side = side.max((size.x * size.y / MOST_SQUARES_IN_BOX).max(0.0).sqrt());
        let squares =
            if contours.is_empty() { Vec::new() } else { squares_inside(&contours, &extents, side) };
        Self { pieces, dots, squares, side, extents }
    }

    /// Sum of the lengths of all pieces, mm.
    pub fn length(&self) -> f64 {
        self.pieces.iter().map(Piece::length).sum()
    }

    /// Inked area, mm².
    pub fn area(&self) -> f64 {
        self.squares.len() as f64 * self.side * self.side
    }
}

/// Chords stay this close to the curve where its length is measured, mm.
const FINE: f64 = 1e-3;

/// Length of a segment cut into so many chords, mm; `meet` is given their ends.
fn chords(segment: &Segment, count: usize, mut meet: impl FnMut(FlatPoint)) -> f64 {
    let mut last = segment.point(0.0);
    meet(last);
    let mut length = 0.0;
    for step in 1..=count {
        let next = segment.point(step as f64 / count as f64);
        meet(next);
        length += last.distance(next);
        last = next;
    }
    length
}

/// Points along a curve from its start on, `piece` mm or less apart and at least [`SHORTEST`]: what is shorter belongs to the
/// piece before or after it. The end itself is left out where it is nearer than that. None for a dot.
pub fn stations(shape: &Shape, piece: f64) -> Vec<FlatPoint> {
    let mut stations: Vec<FlatPoint> = shape.segments().first().map(Segment::start).into_iter().collect();
    for segment in shape.segments() {
        let fine = segment.steps(FINE);
        let length = chords(segment, fine, |_| {});
        let mut count = (length / piece).ceil().clamp(1.0, 1e6) as usize;
        while count < fine && chords(segment, count, |_| {}) < SHARE_OF_LENGTH * length {
            count = (2 * count).min(fine);
        }
        for step in 1..=count {
            let next = segment.point(step as f64 / count as f64);
            if !stations.last().is_some_and(|last| last.distance(next) < SHORTEST) {
                stations.push(next);
            }
        }
    }
    stations
}

/// Lets the ends of pieces be one piece as long as none is longer than `longest` mm.
fn put_together(pieces: &mut Vec<Piece>, longest: f64) {
    pieces.dedup_by(|next, piece| {
        let longer = Piece { from: piece.from, to: next.to };
        // One that is shorter than what it is made of turns back, and would hide that.
        let is_whole =
            piece.to == next.from && (piece.length().max(next.length())..=longest).contains(&longer.length());
        if is_whole {
            *piece = longer;
        }
        is_whole
    });
}

fn squares_inside<Key: Ord>(
    contours: &BTreeMap<Key, Vec<Vec<FlatPoint>>>,
    extents: &Extents,
    side: f64,
) -> Vec<FlatPoint> {
    let size = extents.size();
    let (columns, rows) = ((size.x / side).ceil() as usize, (size.y / side).ceil() as usize);
    if columns == 0 || rows == 0 {
        return Vec::new();
    }
    // Centred, so that a symmetric drawing is sampled symmetrically.
    let origin = extents.center() - Vector2::new(columns as f64, rows as f64) * (side / 2.0);
    let mut inked = vec![false; columns * rows];
    let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); rows];
    for group in contours.values() {
        crossings.iter_mut().for_each(Vec::clear);
        for contour in group {
            for (from, to) in contour.iter().zip(contour.iter().cycle().skip(1)) {
                let (low, high) = if from.y < to.y { (from, to) } else { (to, from) };
                let row_at = |y: f64| ((y - origin.y) / side - 0.5).ceil().max(0.0) as usize;
                for row in row_at(low.y)..row_at(high.y).min(rows) {
                    let y = origin.y + (row as f64 + 0.5) * side;
                    crossings[row].push(low.x + (high.x - low.x) * ((y - low.y) / (high.y - low.y)));
                }
            }
        }
        for (row, crossings) in crossings.iter_mut().enumerate() {
            crossings.sort_unstable_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                let column_at =
                    |x: f64| ((x - origin.x) / side - 0.5).ceil().clamp(0.0, columns as f64) as usize;
                inked[row * columns + column_at(pair[0])..row * columns + column_at(pair[1])].fill(true);
            }
        }
    }
    let center = |index: usize| {
        let place = Vector2::new((index % columns) as f64 + 0.5, (index / columns) as f64 + 0.5);
        FlatPoint::from(origin + place * side)
    };
    inked.iter().enumerate().filter(|(_, inked)| **inked).map(|(index, _)| center(index)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::pattern::{Color, Layer, Path, Segment, Source};

    fn square(half: f64, region: Option<u32>) -> Path {
        let corners =
            [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[x, y]| FlatPoint::new(x, y));
        let sides = (0..4).map(|side| Segment::Line { from: corners[side], to: corners[(side + 1) % 4] });
        let shape = Shape::Closed(sides.collect());
        Path { layer: 0, color: Color::ByLayer, shape, region, source: Source::default() }
    }

    fn ink(paths: Vec<Path>) -> Ink {
        let layers = vec![Layer { name: "MARK".into(), color: Color::Aci(7) }];
        Ink::sample(&Pattern { layers, paths }, |_| true, 0.25, 0.1)
    }

    #[test]
    fn a_frame_has_its_hole_and_its_lengths() {
        let frame = ink(vec![square(5.0, None), square(2.0, None)]);
        assert!((frame.area() - 84.0).abs() < 1e-9, "{}", frame.area());
        assert!((frame.length() - 56.0).abs() < 1e-9);
        assert!(frame.pieces.iter().all(|piece| piece.length() <= 0.25 + 1e-12));
    }

    /// Closing pieces of exporters, and outlines made of nothing but rounding.
    #[test]
    fn what_is_too_short_to_have_a_stretch_is_part_of_its_neighbour() {
        let at = |x: f64| FlatPoint::new(x, 0.0);
        let line = |from: f64, to: f64| Segment::Line { from: at(from), to: at(to) };
        let path = |segments| Path { shape: Shape::Open(segments), ..square(1.0, None) };
        let sampled = ink(vec![
            path(vec![line(0.0, 1e-14), line(1e-14, 1.0), line(1.0, 1.0 + 1e-5)]),
            path(vec![line(5.0, 5.0 + 1e-14)]),
        ]);
        assert_eq!(sampled.pieces.len(), 4);
        assert!(sampled.pieces.iter().all(|piece| piece.length() >= SHORTEST));
        // Segments far shorter than that add up.
        let fine =
            ink(vec![path((0..10_000).map(|k| line(k as f64 * 1e-4, (k + 1) as f64 * 1e-4)).collect())]);
        assert!((fine.length() - 1.0).abs() <= SHORTEST && fine.pieces.len() <= 1000, "{}", fine.length());
    }

    /// The ends of a circle's only chord are one point.
    #[test]
    fn a_circle_smaller_than_a_piece_has_its_length() {
        for radius in [0.01, 0.04, 0.3, 10.0] {
            let circle = Segment::Arc {
                center: FlatPoint::new(3.0, 4.0),
                u: Vector2::new(radius, 0.0),
                v: Vector2::new(0.0, radius),
                start: 0.0,
                sweep: std::f64::consts::TAU,
            };
            let sampled = ink(vec![Path { shape: Shape::Closed(vec![circle]), ..square(1.0, None) }]);
            let share = sampled.length() / (std::f64::consts::TAU * radius);
            assert!((0.9..=1.0 + 1e-12).contains(&share), "{radius}: {share}");
        }
    }

    #[test]
    fn a_contour_that_repeats_its_first_point_has_its_area_and_a_stroke_has_none() {
        let around = square(5.0, None);
        let open = Path { shape: Shape::Open(around.shape.segments().to_vec()), ..around.clone() };
        assert_eq!(ink(vec![open.clone()]), ink(vec![around]));
        let stroke = Path { source: Source { is_stroke: true, ..Source::default() }, ..open.clone() };
        assert_eq!(ink(vec![stroke]).area(), 0.0);
        let Shape::Open(mut sides) = open.shape.clone() else { panic!() };
        sides.pop();
        assert_eq!(ink(vec![Path { shape: Shape::Open(sides), ..open }]).area(), 0.0);
    }

    #[test]
    fn a_contour_drawn_again_empties_nothing() {
        let back = match square(5.0, None).shape {
            Shape::Closed(sides) => Shape::Closed(sides.iter().rev().map(Segment::reversed).collect()),
            _ => panic!(),
        };
        let back = Path { shape: back, color: Color::Aci(1), ..square(5.0, None) };
        assert!((ink(vec![square(5.0, None), back]).area() - 100.0).abs() < 1e-9);
        // In a fill it is what the fill is made of.
        assert_eq!(ink(vec![square(5.0, Some(1)), square(5.0, Some(1))]).area(), 0.0);
    }

    #[test]
    fn an_outline_round_a_fill_does_not_empty_it() {
        assert!((ink(vec![square(5.0, None), square(5.0, Some(1))]).area() - 100.0).abs() < 1e-9);
    }
}
