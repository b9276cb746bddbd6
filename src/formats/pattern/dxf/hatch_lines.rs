//! The lines of a hatch's pattern, cut to its boundary.

use nalgebra::{Vector2, Vector3};

use super::curves::{Curve, SpaceSegment, through};
use super::entities::Item;
use crate::geometry::pattern::Shape;
use crate::geometry::space::FlatPoint;

/// Patterns denser than so many pieces are not drawn: what a laser would melt.
const MAX_PIECES: usize = 1_000_000;
/// Islands are told by where they lie up to this many comparisons.
const MAX_COMPARISONS: usize = 50_000_000;

/// Which of its nested contours a hatch fills between.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Style {
    /// Every other one, from outside to inside.
    EvenOdd,
    /// The outermost and those directly inside.
    Outermost,
    /// The outermost alone.
    IgnoreIslands,
}

/// Parallel lines at equal distances, in the hatch's plane.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Family {
    /// Direction of the lines, rad.
    pub(super) angle: f64,
    /// A point of the first line, where its dashes begin.
    pub(super) base: Vector2<f64>,
    /// From a line's beginning to that of the next.
    pub(super) offset: Vector2<f64>,
    /// Lengths of dashes (more than 0), gaps (less than 0) and dots (0), over and over; none for whole lines.
    pub(super) dashes: Vec<f64>,
}

fn flattened(contour: &Curve, tolerance: f64) -> Vec<FlatPoint> {
    let segments = contour.segments.iter().map(SpaceSegment::seen_from_above).collect();
    Shape::Closed(segments).flattened(tolerance)
}

fn edges(points: &[FlatPoint]) -> impl Iterator<Item = (FlatPoint, FlatPoint)> {
    points.iter().copied().zip(points.iter().copied().cycle().skip(1))
}

/// The contours between which the style fills by the even-odd rule.
pub(super) fn filled_part(contours: Vec<Curve>, style: Style, tolerance: f64) -> Vec<Curve> {
    let deepest = match style {
        Style::EvenOdd => return contours,
        Style::Outermost => 1,
        Style::IgnoreIslands => 0,
    };
    let flat: Vec<Vec<FlatPoint>> =
        contours.iter().map(|contour| flattened(contour, tolerance.max(1e-9) * 100.0)).collect();
    if flat.iter().map(Vec::len).sum::<usize>().saturating_mul(flat.len()) > MAX_COMPARISONS {
        return contours;
    }
    let depth = |index: usize| {
        let inside = edges(&flat[index]).next().map(|(from, to)| from.lerp(to, 0.5));
        let others = flat.iter().enumerate().filter(|(other, _)| *other != index);
        others.filter(|(_, other)| inside.is_some_and(|point| is_inside(point, other))).count()
    };
    let kept: Vec<bool> = (0..flat.len()).map(|index| depth(index) <= deepest).collect();
    contours.into_iter().zip(kept).filter(|(_, kept)| *kept).map(|(contour, _)| contour).collect()
}

fn is_inside(point: FlatPoint, contour: &[FlatPoint]) -> bool {
    let crossings = edges(contour).filter(|(a, b)| {
        let above = a.y > point.y;
        above != (b.y > point.y) && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x)
    });
    crossings.count() % 2 == 1
}

/// The pattern's lines inside the contours (even-odd rule), as lines and dots at a height.
///
/// # Errors
/// There would be more than [`MAX_PIECES`], as a sentence.
pub(super) fn lines(
    contours: &[Curve],
    families: &[Family],
    height: f64,
    tolerance: f64,
) -> Result<Vec<Item>, String> {
    let polygons: Vec<Vec<FlatPoint>> =
        contours.iter().map(|contour| flattened(contour, tolerance)).collect();
    let mut drawn = Vec::new();
    for family in families {
        family.draw(&polygons, height, &mut drawn)?;
    }
    Ok(drawn)
}

impl Family {
    fn draw(&self, polygons: &[Vec<FlatPoint>], height: f64, drawn: &mut Vec<Item>) -> Result<(), String> {
        let (sin, cos) = self.angle.sin_cos();
        let (along, across) = (Vector2::new(cos, sin), Vector2::new(-sin, cos));
        let spacing = self.offset.dot(&across);
        // Lines without a distance between them fill nothing.
        if spacing.abs() < 1e-12 {
            return Ok(());
        }
        let too_dense = || {
            format!("its pattern is too dense, more than {MAX_PIECES} pieces: check the scale of the pattern")
        };
        // Number of the line and position along it, wherever the boundary crosses a line.
        let mut crossings: Vec<(i64, f64)> = Vec::new();
        for (from, to) in polygons.iter().flat_map(|polygon| edges(polygon)) {
            let row = |point: FlatPoint| (point.coords() - self.base).dot(&across) / spacing;
            let position = |point: FlatPoint| (point.coords() - self.base).dot(&along);
            let ends = (row(from), row(to));
            // Half open, so that a corner on a line counts once where the boundary passes through.
            let (first, last) = (ends.0.min(ends.1).ceil(), ends.0.max(ends.1).ceil());
            if !(last - first + crossings.len() as f64 <= 2.0 * MAX_PIECES as f64) {
                return Err(too_dense());
            }
            for number in first as i64..last as i64 {
                let share = (number as f64 - ends.0) / (ends.1 - ends.0);
                crossings.push((number, position(from) + share * (position(to) - position(from))));
            }
        }
        crossings.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let step = self.offset.dot(&along);
        for line in crossings.chunk_by(|a, b| a.0 == b.0) {
            for pair in line.chunks_exact(2) {
                let number = pair[0].0 as f64;
                let at = |position: f64| {
                    let point = self.base + across * (number * spacing) + along * position;
                    Vector3::new(point.x, point.y, height)
                };
                for (from, to) in
                    self.dashes_between(number * step, pair[0].1, pair[1].1).ok_or_else(too_dense)?
                {
                    drawn.push(match from == to {
                        true => Item::Dot(at(from)),
                        false => Item::Curve(through(&[at(from), at(to)], false)),
                    });
                }
                if drawn.len() > MAX_PIECES {
                    return Err(too_dense());
                }
            }
        }
        Ok(())
    }

    /// The dashes of a line that begins at `origin`, between two positions; none if there are too many.
    fn dashes_between(&self, origin: f64, from: f64, to: f64) -> Option<Vec<(f64, f64)>> {
        let period: f64 = self.dashes.iter().map(|dash| dash.abs()).sum();
        if !(period > 0.0) {
            return Some(if to > from { vec![(from, to)] } else { Vec::new() });
        }
        let (first, last) = (((from - origin) / period).floor(), ((to - origin) / period).ceil());
        if !((last - first) * self.dashes.len() as f64 <= MAX_PIECES as f64) {
            return None;
        }
        let mut found = Vec::new();
        for round in 0..(last - first) as usize {
            let mut position = origin + (first + round as f64) * period;
            for dash in &self.dashes {
                let end = position + dash.abs();
                let (start, stop) = (position.max(from), end.min(to));
                if *dash > 0.0 && start < stop || *dash == 0.0 && (from..=to).contains(&position) {
                    found.push((start, stop));
                }
                position = end;
            }
        }
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(low: f64, high: f64) -> Curve {
        let corners = [(low, low), (high, low), (high, high), (low, high)];
        through(&corners.map(|(x, y)| Vector3::new(x, y, 0.0)), true)
    }

    fn family(angle: f64, offset: f64, dashes: &[f64]) -> Family {
        let (sin, cos) = angle.sin_cos();
        Family {
            angle,
            base: [0.0, 0.5].into(),
            offset: [-sin * offset, cos * offset].into(),
            dashes: dashes.into(),
        }
    }

    fn length(items: &[Item]) -> f64 {
        let of = |item: &Item| match item {
            Item::Curve(curve) => (curve.segments[0].end() - curve.segments[0].start()).norm(),
            _ => 0.0,
        };
        items.iter().map(of).sum()
    }

    #[test]
    fn lines_end_at_the_boundary_and_leave_islands_out() {
        let contours = [square(0.0, 10.0), square(2.0, 8.0), square(4.0, 6.0)];
        let drawn = lines(&contours, &[family(0.0, 1.0, &[])], 0.0, 1e-6).unwrap();
        // At y = 0.5, 1.5, … 9.5: area by area, the length is the area divided by the distance of 1.
        assert!((length(&drawn) - (100.0 - 36.0 + 4.0)).abs() < 1e-9);
        let dashed =
            lines(&contours[..1], &[family(0.0, 1.0, &[0.5, -0.25, 0.0, -0.25])], 0.0, 1e-6).unwrap();
        assert!((length(&dashed) - 50.0).abs() < 1e-9);
        assert_eq!(dashed.iter().filter(|item| matches!(item, Item::Dot(_))).count(), 100);
    }

    #[test]
    fn styles_choose_their_islands() {
        let contours = || vec![square(0.0, 10.0), square(2.0, 8.0), square(4.0, 6.0)];
        for (style, count) in [(Style::EvenOdd, 3), (Style::Outermost, 2), (Style::IgnoreIslands, 1)] {
            assert_eq!(filled_part(contours(), style, 1e-6).len(), count, "{style:?}");
        }
    }

    #[test]
    fn dense_patterns_are_refused_and_degenerate_ones_end() {
        let dense = lines(&[square(0.0, 10.0)], &[family(0.0, 1e-7, &[])], 0.0, 1e-6);
        assert!(dense.unwrap_err().contains("too dense"));
        let dashes = lines(&[square(0.0, 10.0)], &[family(0.0, 1.0, &[1e-9, -1e-9])], 0.0, 1e-6);
        assert!(dashes.unwrap_err().contains("too dense"));
        assert_eq!(lines(&[square(0.0, 10.0)], &[family(0.0, 0.0, &[])], 0.0, 1e-6).unwrap().len(), 0);
    }
}
