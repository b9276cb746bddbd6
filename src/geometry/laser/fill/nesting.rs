//! Which contours are inside which: regions in outlines, and outlines that only frame regions.

use super::scan::{self, Outline};
use crate::geometry::space::{Extents, FlatPoint};

/// An outline is only a line round its regions if they cover at least this share of its inside, holes
/// included.
const COVERED: f64 = 0.8;
/// An outline is only a line round a region if the contour of the region is at most this many times as large
/// as the outline. Larger contours surround the outline.
const LARGER: f64 = 1.05;

/// For each point, whether it is inside an odd number of these contours.
pub(super) fn are_inside_odd(points: &[FlatPoint], contours: &[Outline]) -> Vec<bool> {
    // A ray from a point crosses every contour round it an odd number of times, and every other one an even number.
    let upwards = |(from, to): (FlatPoint, FlatPoint)| if from.y < to.y { (from, to) } else { (to, from) };
    let mut sides: Vec<(FlatPoint, FlatPoint)> =
        contours.iter().flat_map(Outline::sides).map(upwards).filter(|(low, high)| low.y < high.y).collect();
    sides.sort_unstable_by(|a, b| a.0.y.total_cmp(&b.0.y));
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|a, b| points[*a].y.total_cmp(&points[*b].y));
    let mut are_inside = vec![false; points.len()];
    let (mut active, mut next): (Vec<(FlatPoint, FlatPoint)>, usize) = (Vec::new(), 0);
    for index in order {
        let at = points[index];
        let beginning = sides[next..].iter().take_while(|(low, _)| low.y <= at.y);
        active.extend(beginning);
        next = sides.partition_point(|(low, _)| low.y <= at.y);
        active.retain(|(_, high)| high.y > at.y);
        are_inside[index] = active.iter().filter(|side| is_left_of(at, **side)).count() % 2 == 1;
    }
    are_inside
}

/// Removes the outlines whose inside is nearly covered by regions, as an outline round two hatches is: they frame these. Of the
/// outlines in them, only those in holes of the regions are kept, unless they are frames, too.
pub(super) fn drop_covered(outlines: &mut Vec<Outline>) {
    let (mut frames, regions): (Vec<usize>, Vec<usize>) =
        (0..outlines.len()).partition(|index| outlines[*index].region.is_none());
    if frames.is_empty() || regions.is_empty() {
        return;
    }
    let boxes: Vec<Extents> = outlines.iter().map(Outline::extents).collect();
    let size = |index: usize| boxes[index].size().norm();
    frames.sort_by(|one, other| size(*other).total_cmp(&size(*one)));
    let regions = Overlaps::new(regions, &boxes);
    let mut is_dropped = vec![false; outlines.len()];
    while !frames.is_empty() {
        let mut in_holes = Vec::new();
        for nest in nests(&frames, outlines, &boxes) {
            if is_framing(nest[0], outlines, &regions) {
                let (inside, kept): (Vec<usize>, Vec<usize>) = nest[1..]
                    .iter()
                    .partition(|frame| is_in_region(outlines[**frame].points[0], outlines, &regions));
                is_dropped[nest[0]] = true;
                inside.iter().for_each(|&frame| is_dropped[frame] = true);
                in_holes.extend(kept);
            }
        }
        frames = in_holes;
    }
    let mut is_dropped = is_dropped.into_iter();
    outlines.retain(|_| !is_dropped.next().unwrap_or_default());
}

/// The outermost of these outlines, each with those inside it, which follow it. They are sorted by size, the largest first.
fn nests(frames: &[usize], outlines: &[Outline], boxes: &[Extents]) -> Vec<Vec<usize>> {
    let places = Overlaps::new(frames.to_vec(), boxes);
    let mut nests: Vec<Vec<usize>> = Vec::new();
    let mut outermost = vec![None; outlines.len()];
    for &frame in frames {
        let at = outlines[frame].points[0];
        let mut around: Vec<(usize, usize)> = places
            .with(&Extents::of([at.coords()]))
            .into_iter()
            .filter_map(|outline| outermost[outline].map(|nest| (nest, outline)))
            .collect();
        around.sort_unstable();
        match around.into_iter().find(|(_, outline)| is_inside(at, &outlines[*outline])) {
            Some((nest, _)) => nests[nest].push(frame),
            None => {
                outermost[frame] = Some(nests.len());
                nests.push(vec![frame]);
            }
        }
    }
    nests
}

/// Whether regions nearly cover the inside of an outline.
fn is_framing(frame: usize, outlines: &[Outline], regions: &Overlaps<'_>) -> bool {
    let outer = &regions.boxes[frame];
    let largest = LARGER * outer.size().norm();
    // Each contour of a region for itself: holes belong to what is framed.
    let inside =
        regions.with(outer).into_iter().filter(|index| regions.boxes[*index].size().norm() <= largest);
    let inside: Vec<Outline> = inside
        .zip(0..)
        .map(|(index, number)| Outline { region: Some(number), ..outlines[index].clone() })
        .collect();
    if inside.is_empty() {
        return false;
    }
    let frame = [outlines[frame].clone()];
    let [framed, filled] = [&frame[..], &inside[..]].map(scan::area);
    let either = scan::area(&[&frame[..], &inside[..]].concat());
    let common = (framed + filled - either) / 2.0;
    common >= COVERED * framed
}

/// Whether a point is inside a region and not in a hole of it.
fn is_in_region(at: FlatPoint, outlines: &[Outline], regions: &Overlaps<'_>) -> bool {
    let around = regions.with(&Extents::of([at.coords()]));
    let mut around = around.chunk_by(|one, other| outlines[*one].region == outlines[*other].region);
    around.any(|region| region.iter().filter(|index| is_inside(at, &outlines[**index])).count() % 2 == 1)
}

/// Whether a point is inside a closed polyline, by the even-odd rule.
fn is_inside(at: FlatPoint, contour: &Outline) -> bool {
    let crossed =
        contour.sides().filter(|(from, to)| (from.y > at.y) != (to.y > at.y) && is_left_of(at, (*from, *to)));
    crossed.count() % 2 == 1
}

/// Whether a point is to the left of a side that reaches over its height.
fn is_left_of(at: FlatPoint, (from, to): (FlatPoint, FlatPoint)) -> bool {
    at.x < from.x + (to.x - from.x) * ((at.y - from.y) / (to.y - from.y))
}

/// Finds those of many boxes that have points in common with one.
struct Overlaps<'a> {
    boxes: &'a [Extents],
    /// The boxes in question, by their left sides.
    sorted: Vec<usize>,
    /// How far to the right each [`Self::BLOCK`] of them reaches.
    reaches: Vec<f64>,
}

impl<'a> Overlaps<'a> {
    /// Number of boxes in a block; the right end of each block is known.
    const BLOCK: usize = 64;

    fn new(mut sorted: Vec<usize>, boxes: &'a [Extents]) -> Self {
        sorted.sort_by(|one, other| boxes[*one].min.x.total_cmp(&boxes[*other].min.x));
        let reach =
            |block: &[usize]| block.iter().map(|index| boxes[*index].max.x).fold(f64::NEG_INFINITY, f64::max);
        let reaches = sorted.chunks(Self::BLOCK).map(reach).collect();
        Self { boxes, sorted, reaches }
    }

    /// The boxes with points in common with this one, by their numbers.
    fn with(&self, other: &Extents) -> Vec<usize> {
        let end = self.sorted.partition_point(|index| self.boxes[*index].min.x <= other.max.x);
        let blocks = self.sorted[..end].chunks(Self::BLOCK).zip(&self.reaches);
        let near = blocks.filter(|(_, reach)| **reach >= other.min.x).flat_map(|(block, _)| block).copied();
        let mut found: Vec<usize> = near
            .filter(|index| {
                let own = &self.boxes[*index];
                (0..2).all(|axis| own.min[axis] <= other.max[axis] && own.max[axis] >= other.min[axis])
            })
            .collect();
        found.sort_unstable();
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::pattern::Color;

    fn square(x: f64, y: f64, half: f64) -> Outline {
        let corners = [[-half, -half], [half, -half], [half, half], [-half, half]];
        let points = corners.map(|[dx, dy]| FlatPoint::new(x + dx, y + dy)).to_vec();
        Outline { region: None, color: Color::ByLayer, points }
    }

    /// Squares in rows, of many sizes, as a small generator of numbers gives them.
    fn squares(count: usize) -> Vec<Outline> {
        let mut state = 7u64;
        let mut random = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 40) as f64 / f64::from(1u32 << 24)
        };
        (0..count)
            .map(|_| square(100.0 * random(), 100.0 * random(), 10.0 * random().powi(3) + 0.01))
            .collect()
    }

    #[test]
    fn points_are_inside_an_odd_number_of_contours_as_they_are_inside_each() {
        let outlines = squares(400);
        let points: Vec<FlatPoint> = outlines.iter().map(|outline| outline.points[2]).collect();
        let expected: Vec<bool> = points
            .iter()
            .map(|at| outlines.iter().filter(|outline| is_inside(*at, outline)).count() % 2 == 1)
            .collect();
        assert_eq!(are_inside_odd(&points, &outlines), expected);
        assert!(expected.contains(&true) && expected.contains(&false));
    }

    #[test]
    fn the_boxes_that_overlap_are_those_of_a_search_through_all() {
        let boxes: Vec<Extents> = squares(500).iter().map(Outline::extents).collect();
        let overlaps = Overlaps::new((0..500).step_by(2).collect(), &boxes);
        for other in &boxes {
            let is_near = |index: &usize| {
                (0..2).all(|axis| {
                    boxes[*index].min[axis] <= other.max[axis] && boxes[*index].max[axis] >= other.min[axis]
                })
            };
            let expected: Vec<usize> = (0..500).step_by(2).filter(is_near).collect();
            assert_eq!(overlaps.with(other), expected);
        }
    }
}
