//! The lines of a hatch pattern, clipped to the boundary.

use nalgebra::{Vector2, Vector3};

use super::budget::{Budget, Exceeded};
use super::curves::{Curve, STEPS_OF_POINT, flattened, through};
use super::items::Item;
use crate::geometry::space::{Extents, FlatPoint};

/// Largest number of pieces of a pattern; a laser would melt a denser one.
const MAX_PIECES: usize = 1_000_000;
/// Number of steps of the budget for sorting in an intersection of a line with the boundary.
const STEPS_OF_CROSSING: usize = 16;

/// Which of its nested contours a hatch uses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Style {
    /// All of them, by the even-odd rule.
    EvenOdd,
    /// The outermost and those directly inside.
    Outermost,
    /// Only the outermost.
    IgnoreIslands,
}

/// A family of parallel lines with equal distances, in the plane of the hatch.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Family {
    /// Direction of the lines, rad.
    pub(super) angle: f64,
    /// A point of the first line, where its dashes begin.
    pub(super) base: Vector2<f64>,
    /// From the beginning of a line to that of the next one.
    pub(super) offset: Vector2<f64>,
    /// Lengths of dashes (positive), gaps (negative) and dots (0), which repeat; empty for continuous lines.
    pub(super) dashes: Vec<f64>,
}

fn edges(points: &[FlatPoint]) -> impl Iterator<Item = (FlatPoint, FlatPoint)> {
    points.iter().copied().zip(points.iter().copied().cycle().skip(1))
}

/// The contours that the style uses for filling by the even-odd rule.
///
/// # Errors
/// A sentence if the islands need more work than the budget allows.
pub(super) fn filled_part(
    contours: Vec<Curve>,
    style: Style,
    tolerance: f64,
    budget: &mut Budget,
) -> Result<Vec<Curve>, String> {
    let deepest = match style {
        Style::EvenOdd => return Ok(contours),
        Style::Outermost => 1,
        Style::IgnoreIslands => 0,
    };
    let depths = flattened(&contours, tolerance.max(1e-9) * 100.0, budget)
        .and_then(|flat| depths(&flat, budget))
        .map_err(|Exceeded| "it has too many islands: split it into several hatches")?;
    let kept = contours.into_iter().zip(depths).filter(|(_, depth)| *depth <= deepest);
    Ok(kept.map(|(contour, _)| contour).collect())
}

/// The number of contours around each contour. Sweeps from left to right, so that a point is compared only with the
/// contours above and below it.
fn depths(flat: &[Vec<FlatPoint>], budget: &mut Budget) -> Result<Vec<usize>, Exceeded> {
    let bounds: Vec<Extents> =
        flat.iter().map(|contour| Extents::of(contour.iter().map(|point| point.coords()))).collect();
    let on_edge = |(index, contour): (usize, &Vec<FlatPoint>)| {
        edges(contour).next().map(|(from, to)| (index, from.lerp(to, 0.5)))
    };
    let mut points: Vec<(usize, FlatPoint)> = flat.iter().enumerate().filter_map(on_edge).collect();
    points.sort_by(|(_, a), (_, b)| a.x.total_cmp(&b.x));
    let mut ahead: Vec<usize> = (0..flat.len()).collect();
    ahead.sort_by(|a, b| bounds[*a].min.x.total_cmp(&bounds[*b].min.x));
    let mut ahead = ahead.into_iter().peekable();
    let mut here: Vec<usize> = Vec::new();
    let mut depths = vec![0; flat.len()];
    for (index, point) in points {
        here.extend(std::iter::from_fn(|| ahead.next_if(|next| bounds[*next].min.x <= point.x)));
        budget.work(here.len())?;
        here.retain(|other| point.x <= bounds[*other].max.x);
        for other in here.iter().copied().filter(|other| *other != index) {
            if bounds[other].contains(point.coords()) {
                budget.work(flat[other].len())?;
                depths[index] += usize::from(is_inside(point, &flat[other]));
            }
        }
    }
    Ok(depths)
}

fn is_inside(point: FlatPoint, contour: &[FlatPoint]) -> bool {
    let crossings = edges(contour).filter(|(a, b)| {
        let above = a.y > point.y;
        above != (b.y > point.y) && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x)
    });
    crossings.count() % 2 == 1
}

/// The pattern lines inside the contours (even-odd rule), as lines and dots at a height.
///
/// # Errors
/// A sentence if there are more than [`MAX_PIECES`], or if they need more work than the budget allows.
pub(super) fn lines(
    contours: &[Curve],
    families: &[Family],
    height: f64,
    tolerance: f64,
    budget: &mut Budget,
) -> Result<Vec<Item>, String> {
    let polygons = flattened(contours, tolerance, budget)
        .map_err(|Exceeded| "its boundary is too large to divide its arcs into chords: check its scale")?;
    let mut drawn = Vec::new();
    for family in families {
        family.draw(&polygons, height, &mut drawn, budget).map_err(|Exceeded| {
            format!("its pattern is too dense, more than {MAX_PIECES} pieces: check the scale of the pattern")
        })?;
    }
    Ok(drawn)
}

/// A number of steps; the largest possible one if it is NaN.
fn steps(count: f64) -> usize {
    if count.is_nan() { usize::MAX } else { count as usize }
}

impl Family {
    fn draw(
        &self,
        polygons: &[Vec<FlatPoint>],
        height: f64,
        drawn: &mut Vec<Item>,
        budget: &mut Budget,
    ) -> Result<(), Exceeded> {
        let (sin, cos) = self.angle.sin_cos();
        let (along, across) = (Vector2::new(cos, sin), Vector2::new(-sin, cos));
        let spacing = self.offset.dot(&across);
        // Without a distance between lines there is nothing to draw.
        if spacing.abs() < 1e-12 {
            return Ok(());
        }
        // Number of the line and position along it, for every intersection with the boundary.
        let mut crossings: Vec<(i64, f64)> = Vec::new();
        for (from, to) in polygons.iter().flat_map(|polygon| edges(polygon)) {
            let row = |point: FlatPoint| (point.coords() - self.base).dot(&across) / spacing;
            let position = |point: FlatPoint| (point.coords() - self.base).dot(&along);
            let ends = (row(from), row(to));
            // Half open, so that a corner on a line is counted once if the boundary crosses the line there.
            let (first, last) = (ends.0.min(ends.1).ceil(), ends.0.max(ends.1).ceil());
            budget
                .work(steps(last - first).saturating_mul(STEPS_OF_CROSSING).saturating_add(STEPS_OF_POINT))?;
            for number in first as i64..last as i64 {
                let share = (number as f64 - ends.0) / (ends.1 - ends.0);
                crossings.push((number, position(from) + share * (position(to) - position(from))));
            }
        }
        crossings.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let step = self.offset.dot(&along);
        for line in crossings.chunk_by(|a, b| a.0 == b.0) {
            let number = line[0].0 as f64;
            let at = |position: f64| {
                let point = self.base + across * (number * spacing) + along * position;
                Vector3::new(point.x, point.y, height)
            };
            for pair in line.chunks_exact(2) {
                let between = (pair[0].1, pair[1].1);
                self.dash(number * step, between, budget, |from, to, budget| {
                    if drawn.len() == MAX_PIECES {
                        return Err(Exceeded);
                    }
                    budget.hold(1)?;
                    drawn.push(match from == to {
                        true => Item::Dot(at(from)),
                        false => Item::Curve(through(&[at(from), at(to)], false)),
                    });
                    Ok(())
                })?;
            }
        }
        Ok(())
    }

    /// Draws the dashes of a line that begins at `origin`, between two positions.
    fn dash(
        &self,
        origin: f64,
        (from, to): (f64, f64),
        budget: &mut Budget,
        mut draw: impl FnMut(f64, f64, &mut Budget) -> Result<(), Exceeded>,
    ) -> Result<(), Exceeded> {
        let period: f64 = self.dashes.iter().map(|dash| dash.abs()).sum();
        if !(period > 0.0) {
            return if to > from { draw(from, to, budget) } else { Ok(()) };
        }
        let (first, last) = (((from - origin) / period).floor(), ((to - origin) / period).ceil());
        // Gaps take time, too.
        budget.work(steps((last - first + 1.0) * self.dashes.len() as f64))?;
        for round in 0..steps(last - first) {
            let mut position = origin + (first + round as f64) * period;
            for dash in &self.dashes {
                let end = position + dash.abs();
                let (start, stop) = (position.max(from), end.min(to));
                if *dash > 0.0 && start < stop || *dash == 0.0 && (from..=to).contains(&position) {
                    draw(start, stop, budget)?;
                }
                position = end;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::budget::Cost;
    use super::super::curves::Placement;
    use super::super::curves::SpaceSegment;
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
    fn lines_end_at_the_boundary_and_skip_islands() {
        let contours = [square(0.0, 10.0), square(2.0, 8.0), square(4.0, 6.0)];
        let drawn = lines(&contours, &[family(0.0, 1.0, &[])], 0.0, 1e-6, &mut Budget::default()).unwrap();
        // Lines at y = 0.5, 1.5, … 9.5: the total length is the area divided by the distance of 1.
        assert!((length(&drawn) - (100.0 - 36.0 + 4.0)).abs() < 1e-9);
        let dashed = lines(
            &contours[..1],
            &[family(0.0, 1.0, &[0.5, -0.25, 0.0, -0.25])],
            0.0,
            1e-6,
            &mut Budget::default(),
        )
        .unwrap();
        assert!((length(&dashed) - 50.0).abs() < 1e-9);
        assert_eq!(dashed.iter().filter(|item| matches!(item, Item::Dot(_))).count(), 100);
    }

    #[test]
    fn styles_choose_their_islands() {
        let contours = || vec![square(0.0, 10.0), square(2.0, 8.0), square(4.0, 6.0)];
        for (style, count) in [(Style::EvenOdd, 3), (Style::Outermost, 2), (Style::IgnoreIslands, 1)] {
            assert_eq!(
                filled_part(contours(), style, 1e-6, &mut Budget::default()).unwrap().len(),
                count,
                "{style:?}"
            );
        }
    }

    #[test]
    fn dense_patterns_are_refused_and_degenerate_ones_draw_nothing() {
        let dense = lines(&[square(0.0, 10.0)], &[family(0.0, 1e-7, &[])], 0.0, 1e-6, &mut Budget::default());
        assert!(dense.unwrap_err().contains("too dense"));
        let dashes = lines(
            &[square(0.0, 10.0)],
            &[family(0.0, 1.0, &[1e-9, -1e-9])],
            0.0,
            1e-6,
            &mut Budget::default(),
        );
        assert!(dashes.unwrap_err().contains("too dense"));
        assert_eq!(
            lines(&[square(0.0, 10.0)], &[family(0.0, 0.0, &[])], 0.0, 1e-6, &mut Budget::default())
                .unwrap()
                .len(),
            0
        );
    }

    #[test]
    fn gaps_and_families_that_draw_nothing_spend_steps_too() {
        // 5e5 lines with 5e5 gaps each on a square of 100: 2.5e11 steps without a single piece.
        let gaps =
            lines(&[square(0.0, 100.0)], &[family(0.0, 2e-4, &[-2e-4])], 0.0, 1e-6, &mut Budget::default());
        assert!(gaps.unwrap_err().contains("too dense"));
        let mut budget = Budget::default();
        let families = vec![family(0.0, 1.0, &[-1000.0, -1000.0]); 200_000];
        assert!(lines(&[square(0.0, 100.0)], &families, 0.0, 1e-6, &mut budget).is_err());
        // The drawing has steps left for its other hatches, but not for any number of such hatches.
        assert_eq!(budget.exceeded(), None);
        while budget.exceeded().is_none() {
            budget.begin_entity();
            assert!(lines(&[square(0.0, 100.0)], &families, 0.0, 1e-6, &mut budget).is_err());
        }
        assert_eq!(budget.exceeded(), Some(Cost::Steps));
    }

    #[test]
    fn boundaries_of_huge_arcs_are_refused_before_they_are_flattened() {
        let (center, u, v) = (Vector3::zeros(), Vector3::x() * 9e6, Vector3::y() * 9e6);
        let circle = SpaceSegment::Arc { center, u, v, start: 0.0, sweep: std::f64::consts::TAU };
        let contour = Curve { segments: vec![circle; 1500], closed: true };
        let refused = lines(&[contour], &[family(0.0, 1e5, &[])], 0.0, 1e-4, &mut Budget::default());
        assert!(refused.unwrap_err().contains("its boundary is too large"));
    }

    #[test]
    fn many_islands_are_nested_correctly_or_the_hatch_is_refused() {
        // A frame around 10,000 squares: 1e8 comparisons of all pairs, but few with the sweep from left to right.
        let grid = |index: u32| {
            let corner = Vector3::new(f64::from(index % 100), f64::from(index / 100), 0.0) * 10.0;
            square(1.0, 9.0).placed(&Placement { offset: corner, ..Placement::scaling(1.0) })
        };
        let islands: Vec<Curve> = (0..10_000).map(grid).collect();
        let mut budget = Budget::default();
        let contours = [vec![square(-1.0, 1001.0)], islands, vec![square(2.0, 3.0)]].concat();
        for (style, count) in [(Style::Outermost, 10_001), (Style::IgnoreIslands, 1)] {
            budget.begin_entity();
            let kept = filled_part(contours.clone(), style, 1e-6, &mut budget).unwrap();
            assert_eq!(kept.len(), count, "{style:?}");
        }
        let nested = (0..20_000).map(|index| square(-f64::from(index) - 1.0, f64::from(index) + 1.0));
        let refused = filled_part(nested.collect(), Style::Outermost, 1e-6, &mut Budget::default());
        assert!(refused.unwrap_err().contains("too many islands"));
    }
}
