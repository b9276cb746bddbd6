//! Lines of a drawing that are too close together: marked twice, or closer than the laser's spot can separate.

use std::collections::BTreeMap;

use nalgebra::Vector2;

use super::ink::{Ink, Piece};
use super::space::FlatPoint;

/// Two lines no farther apart than this, mm, are one line that is marked twice: half of the finest laser spot.
const SAME_LINE: f64 = 0.01;
/// Lines that differ by a larger angle, rad, cross and do not run beside each other.
const PARALLEL: f64 = 10.0 * std::f64::consts::PI / 180.0;
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
    /// Compares every piece of a line with the pieces round it. Distances up to `within` mm are of interest.
    ///
    /// Pieces that follow each other along a line are no neighbours: each starts where the other ends. A line that turns back
    /// on itself is marked twice.
    pub fn close_lines(&self, within: f64) -> CloseLines {
        let reach = within.max(SAME_LINE);
        let longest = self.pieces.iter().map(Piece::length).fold(0.0, f64::max);
        let cell = longest / 2.0 + reach;
        if !(cell > 0.0 && cell.is_finite()) {
            return CloseLines::default();
        }
        let cell_of = |at: FlatPoint| [(at.x / cell).floor() as i64, (at.y / cell).floor() as i64];
        // A piece reaches less than one cell from its middle, so pieces near each other are at most two cells apart.
        let mut cells: BTreeMap<[i64; 2], Vec<u32>> = BTreeMap::new();
        for (index, piece) in self.pieces.iter().enumerate() {
            cells.entry(cell_of(piece.from.lerp(piece.to, 0.5))).or_default().push(index as u32);
        }
        let mut found = CloseLines::default();
        let (mut run, mut run_start, mut longest_run) = (0.0f64, None, 0.0f64);
        for (index, piece) in self.pieces.iter().enumerate() {
            let [column, row] = cell_of(piece.from.lerp(piece.to, 0.5));
            let block = (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| [column + dx, row + dy]));
            let near: Vec<u32> = block.filter_map(|at| cells.get(&at)).flatten().copied().collect();
            if near.len() > MOST_NEIGHBOURS {
                continue;
            }
            let mut covered: Vec<[f64; 2]> = Vec::new();
            for other in near {
                if other as usize == index {
                    continue;
                }
                let Some(beside) = Beside::of(piece, &self.pieces[other as usize], reach) else { continue };
                if beside.distance <= SAME_LINE {
                    // Of two pieces one above the other, the later one is the second mark.
                    if (other as usize) < index {
                        covered.push(beside.along);
                    }
                } else if found.finest.is_none_or(|(finest, _)| beside.distance < finest) {
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

/// A piece beside another one.
struct Beside {
    /// Largest distance between the two where they run beside each other, mm.
    distance: f64,
    /// From where to where along the first piece, mm.
    along: [f64; 2],
}

impl Beside {
    /// `None` if the two are farther apart, not nearly parallel, or only touch.
    fn of(piece: &Piece, other: &Piece, within: f64) -> Option<Self> {
        let length = piece.length();
        let along: Vector2<f64> = (piece.to - piece.from) / length;
        let direction = (other.to - other.from) / other.length();
        if along.perp(&direction).abs() > PARALLEL.sin() {
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
        // Lines that cross or meet here do not run beside each other, unless they are the same line.
        let distance = first.abs().max(last.abs());
        let is_beside =
            distance <= SAME_LINE || first * last > 0.0 && first.abs().min(last.abs()) > SAME_LINE;
        (is_beside && distance <= within).then_some(Self { distance, along: [from, to] })
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
