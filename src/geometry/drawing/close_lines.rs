//! Lines of a drawing that are too close together: marked twice, or closer than the laser's spot can separate.

use nalgebra::Vector2;

use super::ink::{Ink, Piece};
use crate::geometry::space::FlatPoint;
use cells::{Cells, Neighbourhood, Strip};

mod cells;

/// Two lines are one line that is marked twice if they are at most this far apart, mm. [`SAME_DIRECTION`]
/// must hold, too. The limit is larger for curves, whose pieces are chords.
const SAME_LINE: f64 = 0.002;
/// Two lines are one line that is marked twice if they are parallel to within this angle, rad. [`SAME_LINE`]
/// must hold, too. The limit is larger for curves, whose pieces are chords.
const SAME_DIRECTION: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Lines that differ by more than this, rad, cross and do not run beside each other.
const PARALLEL: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Pieces that turn by more than this, rad, meet at a corner and are not on a curve.
const CORNER: f64 = 0.6;
/// Two pieces meet end to end if they run beside each other over a smaller part of one of them than this.
const OVERLAP: f64 = 1e-3;
/// If a piece has more neighbours than this, they are not compared with it: a drawing as dense as that is a
/// fill.
const MOST_NEIGHBOURS: usize = 400;

/// Where lines of a drawing are too close together.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct CloseLines {
    /// Length that is marked more than once, mm: of two lines one above the other, the length of one.
    pub twice: f64,
    /// The start of the longest such stretch.
    pub twice_at: Option<FlatPoint>,
    /// The smallest distance between lines that run beside each other, mm, if below the asked one.
    pub finest: Option<(f64, FlatPoint)>,
}

impl Ink {
    /// Compares every piece of a line with the pieces round it. Distances up to `within` mm are searched; 0 searches only for
    /// lines on lines.
    ///
    /// Pieces that follow each other along a line are no neighbours: each starts where the other ends. A line that turns back
    /// on itself is marked twice.
    pub fn close_lines(&self, within: f64) -> CloseLines {
        let chords = Chords::of(&self.pieces);
        let reach = within.max(SAME_LINE + chords.longest * chords.sharpest / 4.0);
        // The middles of two pieces that are near each other are in the same cell or in neighbouring ones.
        let side = chords.longest + reach;
        if !(side > 0.0 && side.is_finite()) {
            return CloseLines::default();
        }
        let cells = Cells::sorted(&self.pieces, side, |index| chords.widening(chords.turns[index]));
        let mut search = Search::new(chords, within);
        for neighbourhood in cells.neighbourhoods() {
            search.compare(&cells, &neighbourhood);
        }
        search.found()
    }
}

/// The pieces, with what is measured once for all comparisons.
struct Chords<'a> {
    pieces: &'a [Piece],
    /// Length of each, mm.
    lengths: Vec<f64>,
    /// By how much the curve of each piece turns along it, rad: the angle to the next or the last piece, unless there is a corner.
    turns: Vec<f64>,
    /// The largest length, mm.
    longest: f64,
    /// The largest turn, rad.
    sharpest: f64,
}

impl<'a> Chords<'a> {
    fn of(pieces: &'a [Piece]) -> Self {
        let lengths: Vec<f64> = pieces.iter().map(Piece::length).collect();
        let mut turns = vec![0.0f64; pieces.len()];
        for (index, pair) in pieces.windows(2).enumerate() {
            let [piece, next] = [pair[0], pair[1]];
            if piece.to == next.from {
                let cosine = (piece.to - piece.from).dot(&(next.to - next.from))
                    / (lengths[index] * lengths[index + 1]);
                let turn = cosine.clamp(-1.0, 1.0).acos();
                if turn < CORNER {
                    turns[index] = turns[index].max(turn);
                    turns[index + 1] = turn;
                }
            }
        }
        let largest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
        let (longest, sharpest) = (largest(&lengths), largest(&turns));
        Self { pieces, lengths, turns, longest, sharpest }
    }

    /// How much farther a piece on one line with another can be from it, mm, if the curve of one of them turns by `turn`, rad.
    fn widening(&self, turn: f64) -> f64 {
        same_line(self.longest, turn) - same_line(self.longest, 0.0)
            + (same_direction(turn) - same_direction(0.0)) * self.longest / 2.0
    }

    fn at(&self, index: usize) -> Chord {
        let Piece { from, to } = self.pieces[index];
        Chord { from, to, length: self.lengths[index], turn: self.turns[index] }
    }
}

/// A piece as the chord of a curve.
#[derive(Debug, Clone, Copy)]
struct Chord {
    from: FlatPoint,
    to: FlatPoint,
    /// Its length, mm.
    length: f64,
    /// By how much the curve turns along it, rad.
    turn: f64,
}

impl Chord {
    /// The direction from its start to its end, of length 1.
    fn along(&self) -> Vector2<f64> {
        (self.to - self.from) / self.length
    }
}

/// The search, cell by cell.
struct Search<'a> {
    chords: Chords<'a>,
    /// Distances of lines beside each other are searched up to this, mm: as asked, then up to the smallest so far.
    within: f64,
    /// The smallest distance, mm, and the first piece that has it.
    finest: Option<(f64, usize)>,
    /// The pieces that are on earlier ones, with the length that is, mm.
    twice: Vec<(usize, f64)>,
    /// Whether a piece has too many neighbours to be compared ([`MOST_NEIGHBOURS`]).
    is_fill: Vec<bool>,
    /// Used again for each piece: from where to where it is on earlier ones.
    covered: Vec<[f64; 2]>,
    /// Used again for each cell: its pieces.
    own: Vec<Chord>,
}

impl<'a> Search<'a> {
    fn new(chords: Chords<'a>, within: f64) -> Self {
        let is_fill = vec![false; chords.pieces.len()];
        Self {
            chords,
            within,
            finest: None,
            twice: Vec::new(),
            is_fill,
            covered: Vec::new(),
            own: Vec::new(),
        }
    }

    /// Compares the pieces in a cell with those round it.
    fn compare(&mut self, cells: &Cells, neighbourhood: &Neighbourhood) {
        if neighbourhood.count() > MOST_NEIGHBOURS {
            for position in neighbourhood.own.clone() {
                self.is_fill[cells.index(position)] = true;
            }
            return;
        }
        // Pieces of one cell can be far apart in memory; one after the other, each would be waited for.
        let mut chords = std::mem::take(&mut self.own);
        chords.extend(neighbourhood.own.clone().map(|position| self.chords.at(cells.index(position))));
        for (position, chord) in neighbourhood.own.clone().zip(chords.drain(..)) {
            let index = cells.index(position);
            let along = chord.along();
            let half_length = (0.5 - OVERLAP) * chord.length;
            let strip = Strip { position, half_length, half_width: self.reach(chord.turn), angle: PARALLEL };
            cells.in_strip(neighbourhood, strip, |other| self.compare_two(index, (chord, along), other));
            let twice = length_of_union(&mut self.covered);
            self.covered.clear();
            if twice > 0.0 {
                self.twice.push((index, twice));
            }
        }
        self.own = chords;
    }

    /// How far the middle of a straight piece can be from the line through a piece that turns by `turn`, mm, if the two are beside
    /// each other.
    fn reach(&self, turn: f64) -> f64 {
        // The middle is at most half a piece from where the two are side by side.
        let half = self.chords.longest / 2.0;
        let same = SAME_LINE + half * SAME_DIRECTION + self.chords.widening(turn);
        if self.within > 0.0 { same.max(self.within + half * PARALLEL.sin()) } else { same }
    }

    /// Compares a piece, given with its direction, with another one.
    fn compare_two(&mut self, index: usize, chord: (Chord, Vector2<f64>), other: usize) {
        // Of two pieces one above the other, the later one is the second mark.
        let is_later = other < index;
        if other == index || !(is_later || self.within > 0.0) {
            return;
        }
        let Some(beside) = Beside::of(chord, self.chords.at(other), self.within) else {
            return;
        };
        if beside.is_same {
            if is_later {
                self.covered.push(beside.along);
            }
        } else if beside.distance <= self.within
            && self.finest.is_none_or(|(finest, first)| {
                beside.distance < finest || (beside.distance == finest && index < first)
            })
        {
            self.finest = Some((beside.distance, index));
            self.within = beside.distance;
        }
    }

    /// The result, after all cells.
    fn found(mut self) -> CloseLines {
        let middle = |index: usize| self.chords.pieces[index].from.lerp(self.chords.pieces[index].to, 0.5);
        let mut found = CloseLines {
            finest: self.finest.map(|(distance, index)| (distance, middle(index))),
            ..CloseLines::default()
        };
        self.twice.sort_unstable_by_key(|(index, _)| *index);
        let (mut run, mut run_start, mut longest_run, mut next) = (0.0f64, None, 0.0f64, 0);
        for (index, twice) in self.twice {
            found.twice += twice;
            // A piece that was not compared does not end a stretch.
            if !self.is_fill[next..index].iter().all(|is_fill| *is_fill) {
                run = 0.0;
            }
            if run == 0.0 {
                run_start = Some(self.chords.pieces[index].from);
            }
            run += twice;
            if run > longest_run {
                (longest_run, found.twice_at) = (run, run_start);
            }
            next = index + 1;
        }
        found
    }
}

/// The largest distance of two pieces on one line, mm: for pieces of at most `length` mm, whose curves turn together by `turn`, rad.
fn same_line(length: f64, turn: f64) -> f64 {
    // The arc over a chord of length l that turns by θ is l·θ/8 high.
    SAME_LINE + length * turn / 8.0
}

/// The largest angle between two pieces on one line, rad, if their curves turn together by `turn`, rad.
fn same_direction(turn: f64) -> f64 {
    SAME_DIRECTION + turn / 2.0
}

/// A piece beside another one.
struct Beside {
    /// Largest distance between the two where they run beside each other, mm.
    distance: f64,
    /// From where to where along the first piece, mm.
    along: [f64; 2],
    /// Whether they are on one line.
    is_same: bool,
}

impl Beside {
    /// The second piece beside the first, which is given with its direction. `None` if the two are not nearly
    /// parallel, only touch, or cross. Also `None` for some pieces on two lines that are farther apart than
    /// `within` mm.
    fn of((piece, along): (Chord, Vector2<f64>), other: Chord, within: f64) -> Option<Self> {
        let length = piece.length;
        let place = |at: FlatPoint| {
            let offset = at - piece.from;
            [along.dot(&offset), along.perp(&offset)]
        };
        let [mut start, mut end] = [place(other.from), place(other.to)];
        let turn = piece.turn + other.turn;
        let same = same_line(length.max(other.length), turn);
        // Most pairs end here. The distance is between those of the two ends, but for rounding.
        let nearest = if start[1] * end[1] > 0.0 { start[1].abs().min(end[1].abs()) } else { 0.0 };
        if nearest > same.max(within) * (1.0 + 1e-6) {
            return None;
        }
        if start[0] > end[0] {
            std::mem::swap(&mut start, &mut end);
        }
        let (from, to) = (start[0].max(0.0), end[0].min(length));
        // Lines that meet end to end overlap by nothing.
        if to - from <= OVERLAP * length {
            return None;
        }
        let angle = along.perp(&other.along()).abs();
        if angle > PARALLEL.sin() {
            return None;
        }
        let across = |at: f64| start[1] + (end[1] - start[1]) * (at - start[0]) / (end[0] - start[0]);
        let (first, last) = (across(from), across(to));
        let distance = first.abs().max(last.abs());
        // A line and an arc that leaves it, or two curves that touch, have different curvatures.
        let curvatures = [piece.turn / length, other.turn / other.length];
        let is_alike = (curvatures[0] - curvatures[1]).abs() * length <= SAME_DIRECTION + turn / 8.0;
        let is_same = is_alike && distance <= same && angle <= same_direction(turn);
        // Lines that cross or meet here do not run beside each other.
        let is_beside = first * last > 0.0 && first.abs().min(last.abs()) > same;
        (is_same || is_beside).then_some(Self { distance, along: [from, to], is_same })
    }
}

/// The length that the intervals cover together.
fn length_of_union(intervals: &mut [[f64; 2]]) -> f64 {
    intervals.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let (mut length, mut reached) = (0.0, f64::NEG_INFINITY);
    for [from, to] in intervals.iter().copied() {
        length += (to - from.max(reached)).max(0.0);
        reached = reached.max(to);
    }
    length
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::pattern::{Color, Layer, Path, Pattern, Segment, Shape, Source};

    fn at(x: f64, y: f64) -> FlatPoint {
        FlatPoint::new(x, y)
    }

    fn ink(lines: &[Vec<FlatPoint>]) -> Ink {
        let path = |points: &Vec<FlatPoint>| Path {
            layer: 0,
            color: Color::ByLayer,
            shape: Shape::Open(
                points.windows(2).map(|ends| Segment::Line { from: ends[0], to: ends[1] }).collect(),
            ),
            region: None,
            source: Source::default(),
        };
        let layers = vec![Layer { name: "0".into(), color: Color::Aci(7) }];
        let pattern = Pattern { layers, paths: lines.iter().map(path).collect() };
        Ink::sample(&pattern, |_| true, 0.25, 0.2)
    }

    #[test]
    fn an_overlap_is_measured_whatever_the_direction_and_the_division() {
        let line = |from: f64, to: f64| vec![at(from, 0.3 * from), at(to, 0.3 * to)];
        let slope = 1.09f64.sqrt();
        for (second, expected) in [
            (line(3.0, 20.0), 7.0),
            (line(20.0, 3.0), 7.0),
            (line(2.03, 4.06), 2.03),
            (line(10.0, 14.0), 0.0),
        ] {
            let found = ink(&[line(0.0, 10.0), second]).close_lines(0.05);
            assert!((found.twice - expected * slope).abs() < 1e-6, "{} for {expected}", found.twice);
            assert_eq!(found.finest, None);
        }
    }

    #[test]
    fn a_line_that_turns_back_is_marked_twice_and_a_corner_is_not() {
        let back = ink(&[vec![at(0.0, 0.0), at(5.0, 0.0), at(2.0, 0.0)]]).close_lines(0.05);
        assert!((back.twice - 3.0).abs() < 1e-6, "{}", back.twice);
        let corner = ink(&[vec![at(0.0, 0.0), at(5.0, 0.0), at(5.0, 5.0), at(0.0, 0.1)]]).close_lines(0.05);
        assert_eq!((corner.twice, corner.finest), (0.0, None));
    }

    #[test]
    fn three_lines_above_each_other_are_marked_twice_too_much() {
        let line = || vec![at(0.0, 0.0), at(4.0, 0.0)];
        assert!((ink(&[line(), line(), line()]).close_lines(0.05).twice - 8.0).abs() < 1e-6);
    }

    #[test]
    fn the_finest_distance_is_that_of_neighbours_and_not_of_lines_that_cross() {
        let lines = |gap: f64| [vec![at(0.0, 0.0), at(10.0, 0.0)], vec![at(3.0, gap), at(8.0, gap)]];
        let found = ink(&lines(0.03)).close_lines(0.05);
        assert!((found.finest.unwrap().0 - 0.03).abs() < 1e-9 && found.twice == 0.0);
        assert_eq!(ink(&lines(0.06)).close_lines(0.05).finest, None);
        let cross = [vec![at(0.0, 0.0), at(10.0, 0.0)], vec![at(3.0, -1.0), at(8.0, 1.0)]];
        assert_eq!(ink(&cross).close_lines(0.05), CloseLines::default());
    }

    #[test]
    fn circles_of_the_same_size_are_marked_twice_wherever_they_start() {
        let circle = |start: f64| {
            let arc = Segment::Arc {
                center: at(1.0, 2.0),
                u: Vector2::new(3.0, 0.0),
                v: Vector2::new(0.0, 3.0),
                start,
                sweep: std::f64::consts::TAU,
            };
            Path {
                layer: 0,
                color: Color::ByLayer,
                shape: Shape::Closed(vec![arc]),
                region: None,
                source: Source::default(),
            }
        };
        let layers = vec![Layer { name: "0".into(), color: Color::Aci(7) }];
        let pattern = Pattern { layers, paths: vec![circle(0.0), circle(0.4)] };
        let found = Ink::sample(&pattern, |_| true, 0.25, 0.2).close_lines(0.05);
        let perimeter = 6.0 * std::f64::consts::PI;
        assert!((found.twice - perimeter).abs() < 0.01 * perimeter, "{} of {perimeter}", found.twice);
    }

    /// The same result from all pairs, without cells and strips.
    fn exhaustive(ink: &Ink, within: f64) -> CloseLines {
        let chords = Chords::of(&ink.pieces);
        let reach = within.max(SAME_LINE + chords.longest * chords.sharpest / 4.0);
        let cell_of = |piece: &Piece| {
            let at = piece.from.lerp(piece.to, 0.5);
            [at.y, at.x].map(|coordinate| (coordinate / (chords.longest + reach)).floor() as i64)
        };
        let cells: Vec<[i64; 2]> = ink.pieces.iter().map(cell_of).collect();
        let mut in_order: Vec<usize> = (0..cells.len()).collect();
        in_order.sort_by_key(|index| cells[*index]);
        let is_near = |[a, b]: [usize; 2]| (0..2).all(|part| cells[a][part].abs_diff(cells[b][part]) <= 1);
        let (mut found, mut run, mut run_start, mut longest_run) = (CloseLines::default(), 0.0, None, 0.0);
        for (index, piece) in ink.pieces.iter().enumerate() {
            let near: Vec<usize> =
                in_order.iter().copied().filter(|other| is_near([index, *other])).collect();
            if near.len() > MOST_NEIGHBOURS {
                continue;
            }
            let chord = chords.at(index);
            let mut covered = Vec::new();
            for other in near.into_iter().filter(|other| *other != index) {
                match Beside::of((chord, chord.along()), chords.at(other), f64::INFINITY) {
                    Some(beside) if beside.is_same && other < index => covered.push(beside.along),
                    Some(beside)
                        if !beside.is_same
                            && beside.distance <= within
                            && found.finest.is_none_or(|(finest, _)| beside.distance < finest) =>
                    {
                        found.finest = Some((beside.distance, piece.from.lerp(piece.to, 0.5)));
                    }
                    _ => {}
                }
            }
            let twice = length_of_union(&mut covered);
            found.twice += twice;
            run = if twice > 0.0 { run + twice } else { 0.0 };
            if twice > 0.0 && run == twice {
                run_start = Some(piece.from);
            }
            if run > longest_run {
                (longest_run, found.twice_at) = (run, run_start);
            }
        }
        found
    }

    /// A drawing that hits every case: lines close to others, on others and across them, curves of all sizes, fills, and marks
    /// far away.
    fn crowded(random: &mut impl FnMut(f64, f64) -> f64) -> Vec<Vec<FlatPoint>> {
        let far = 10f64.powf(random(-1.0, 4.0));
        let mut lines = Vec::new();
        if random(0.0, 1.0) < 0.2 {
            lines
                .extend((0..150).map(|k| vec![at(0.0, f64::from(k) * 0.004), at(1.0, f64::from(k) * 0.004)]));
        }
        for _ in 0..random(2.0, 25.0) as usize {
            let start = at(random(-2.0, 2.0), random(-2.0, 2.0));
            let along = Vector2::new(random(-2.0, 2.0), random(-2.0, 2.0));
            let line = match random(0.0, 5.0) as usize {
                0 => vec![start, start + along, start + along * random(-0.5, 0.5)],
                1 => vec![start, start + Vector2::new(along.x, 0.0)],
                2 => vec![start, start + Vector2::new(0.0, along.y)],
                3 => {
                    let radius = random(0.05, 1.5);
                    let point = |k: i32| (f64::from(k) * random(0.0999, 0.1001)).sin_cos();
                    (0..40).map(point).map(|(y, x)| at(start.x + radius * x, start.y + radius * y)).collect()
                }
                _ => vec![start, at(start.x + along.x * far, start.y + along.y * far.min(3.0))],
            };
            let apart = if random(0.0, 1.0) < 0.5 { 0.0 } else { random(0.0, 0.03) };
            for copy in 0..random(1.0, 4.0) as usize {
                let moved =
                    |point: &FlatPoint| at(point.x + apart * copy as f64, point.y - apart * copy as f64);
                lines.push(line.iter().map(moved).collect());
            }
        }
        lines
    }

    #[test]
    fn the_search_finds_what_a_comparison_of_all_pairs_finds() {
        let mut state = 1u64;
        let mut random = |low: f64, high: f64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            low + (high - low) * ((state >> 11) as f64 / (1u64 << 53) as f64)
        };
        let (mut twice, mut fine) = (0, 0);
        for drawing in 0..60 {
            let ink = ink(&crowded(&mut random));
            // All pairs of a long line take too long.
            let ink = Ink { pieces: ink.pieces.into_iter().take(1200).collect(), ..ink };
            for within in [0.0, 0.02, 0.3] {
                let found = ink.close_lines(within);
                assert_eq!(found, exhaustive(&ink, within), "drawing {drawing} within {within}");
                twice += usize::from(found.twice > 0.0);
                fine += usize::from(found.finest.is_some());
            }
        }
        assert!(twice > 50 && fine > 50, "{twice} {fine}");
    }
}
