//! Lines of a drawing that are too close together: marked twice, or closer than the laser's spot can separate.

use nalgebra::Vector2;

use super::ink::{Ink, Piece};
use super::space::FlatPoint;

/// Two lines no farther apart than this, mm, and parallel to within this angle, rad, are one line that is marked twice. Both are
/// larger for curves, whose pieces are chords.
const SAME_LINE: f64 = 0.002;
const SAME_DIRECTION: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Lines that differ by a larger angle, rad, cross and do not run beside each other.
const PARALLEL: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Pieces that turn by a larger angle, rad, meet at a corner and are not on a curve.
const CORNER: f64 = 0.6;
/// More pieces than this in the neighbourhood of one are not compared with it: so dense a drawing is a fill.
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
        let turns = self.turns();
        let sharpest = turns.iter().copied().fold(0.0, f64::max);
        let longest = self.pieces.iter().map(Piece::length).fold(0.0, f64::max);
        let reach = within.max(SAME_LINE + longest * sharpest / 4.0);
        // The middles of two pieces that are near each other are in the same cell or in neighbouring ones.
        let cell = longest + reach;
        if !(cell > 0.0 && cell.is_finite()) {
            return CloseLines::default();
        }
        let cell_of = |piece: &Piece| {
            let at = piece.from.lerp(piece.to, 0.5);
            [(at.y / cell).floor() as i64, (at.x / cell).floor() as i64]
        };
        let mut by_cell: Vec<([i64; 2], u32)> =
            self.pieces.iter().enumerate().map(|(index, piece)| (cell_of(piece), index as u32)).collect();
        by_cell.sort_unstable();
        let in_row = |row: i64, column: i64| {
            let from = by_cell.partition_point(|(at, _)| *at < [row, column - 1]);
            let to = by_cell.partition_point(|(at, _)| *at < [row, column + 2]);
            &by_cell[from..to]
        };
        let mut found = CloseLines::default();
        let (mut run, mut run_start, mut longest_run) = (0.0f64, None, 0.0f64);
        for (index, piece) in self.pieces.iter().enumerate() {
            let [row, column] = cell_of(piece);
            let rows = [row - 1, row, row + 1].map(|row| in_row(row, column));
            if rows.iter().map(|row| row.len()).sum::<usize>() > MOST_NEIGHBOURS {
                continue;
            }
            let mut covered: Vec<[f64; 2]> = Vec::new();
            for other in rows.into_iter().flatten().map(|(_, other)| *other as usize) {
                if other == index {
                    continue;
                }
                let Some(beside) = Beside::of([piece, &self.pieces[other]], [turns[index], turns[other]])
                else {
                    continue;
                };
                if beside.is_same {
                    // Of two pieces one above the other, the later one is the second mark.
                    if other < index {
                        covered.push(beside.along);
                    }
                } else if beside.distance <= within
                    && found.finest.is_none_or(|(finest, _)| beside.distance < finest)
                {
                    found.finest = Some((beside.distance, piece.from.lerp(piece.to, 0.5)));
                }
            }
            let twice = length_of_union(&mut covered);
            found.twice += twice;
            if twice > 0.0 {
                if run == 0.0 {
                    run_start = Some(piece.from);
                }
                run += twice;
                if run > longest_run {
                    (longest_run, found.twice_at) = (run, run_start);
                }
            } else {
                run = 0.0;
            }
        }
        found
    }
}

impl Ink {
    /// By how much the curve of each piece turns along it, rad: the angle to the next or the last piece, unless there is a corner.
    fn turns(&self) -> Vec<f64> {
        let mut turns = vec![0.0f64; self.pieces.len()];
        for (index, pair) in self.pieces.windows(2).enumerate() {
            let [piece, next] = [pair[0], pair[1]];
            if piece.to == next.from {
                let turn = (piece.to - piece.from).angle(&(next.to - next.from));
                if turn < CORNER {
                    turns[index] = turns[index].max(turn);
                    turns[index + 1] = turn;
                }
            }
        }
        turns
    }
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
    /// The second piece beside the first; `turns` are the angles by which the curves of both turn along them, rad. `None` if the
    /// two are not nearly parallel, only touch, or cross.
    fn of([piece, other]: [&Piece; 2], turns: [f64; 2]) -> Option<Self> {
        let length = piece.length();
        let along: Vector2<f64> = (piece.to - piece.from) / length;
        let direction = (other.to - other.from) / other.length();
        let angle = along.perp(&direction).abs();
        if angle > PARALLEL.sin() {
            return None;
        }
        let place = |at: FlatPoint| {
            let offset = at - piece.from;
            [along.dot(&offset), along.perp(&offset)]
        };
        let [mut start, mut end] = [place(other.from), place(other.to)];
        if start[0] > end[0] {
            std::mem::swap(&mut start, &mut end);
        }
        let (from, to) = (start[0].max(0.0), end[0].min(length));
        // Lines that meet end to end overlap by nothing.
        if to - from <= 1e-3 * length {
            return None;
        }
        let across = |at: f64| start[1] + (end[1] - start[1]) * (at - start[0]) / (end[0] - start[0]);
        let (first, last) = (across(from), across(to));
        let distance = first.abs().max(last.abs());
        // The arc over a chord of length l that turns by θ is l·θ/8 high.
        let turn = turns[0] + turns[1];
        let same = SAME_LINE + length.max(other.length()) * turn / 8.0;
        // A line and an arc that leaves it, or two curves that touch, have different curvatures.
        let curvatures = [turns[0] / length, turns[1] / other.length()];
        let is_alike = (curvatures[0] - curvatures[1]).abs() * length <= SAME_DIRECTION + turn / 8.0;
        let is_same = is_alike && distance <= same && angle <= SAME_DIRECTION + turn / 2.0;
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
}
