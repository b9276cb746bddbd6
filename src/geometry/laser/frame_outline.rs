//! The frame drawing: where a mark will be, as a few lines that the pilot beam follows before anything is marked.

use super::correction::{AboveLens, Projection, Subdivision};
use super::marking::MarkingDrawing;
use crate::geometry::ink::{Ink, stations};
use crate::geometry::pattern::{Color, Layer, Path, Pattern, Segment, Shape, Source};
use crate::geometry::space::{Extents, FlatPoint};

/// The layer of the line round the ink.
pub const OUTLINE: &str = "isomark-outline";
/// The layer of the box of the ink.
pub const BOX: &str = "isomark-box";
/// Distance between the places where lines of the frame are examined for surface under them, mm.
const STEP: f64 = 0.25;
/// A frame of a single line or dot is still this wide, mm, so that it is seen.
const SMALLEST: f64 = 0.5;

/// The convex outline of the ink and its bounding rectangle, bent onto the part as the drawing is, to `tolerance` mm.
///
/// A box has corners where there is no ink, so a part of it may be beside the part; such stretches are left out. Without ink,
/// the drawing is empty.
///
/// # Errors
/// When a place of the frame is as high as the lens.
pub fn frame_outline(
    projection: &Projection<'_>,
    ink: &Ink,
    tolerance: f64,
) -> Result<MarkingDrawing, AboveLens> {
    if ink.extents.is_empty() {
        return Ok(MarkingDrawing::default());
    }
    let Extents { min, max } = ink.extents.grown_to(SMALLEST);
    let corners = [[min.x, min.y], [max.x, min.y], [max.x, max.y], [min.x, max.y]];
    let rectangle = corners.map(|[x, y]| FlatPoint::new(x, y)).to_vec();
    let ends = ink.pieces.iter().flat_map(|piece| [piece.from, piece.to]);
    let hull = convex_hull(ends.chain(ink.dots.iter().copied()).collect());
    let is_flat = |hull: &[FlatPoint]| hull.len() < 3;
    let outlines = [if is_flat(&hull) { rectangle.clone() } else { hull }, rectangle];
    let layer = |name: &str, aci: u8| Layer { name: name.into(), color: Color::Aci(aci) };
    let paths = outlines.into_iter().enumerate().flat_map(|(layer, outline)| {
        on_surface(projection, closed(&outline)).into_iter().map(move |shape| Path {
            layer,
            color: Color::ByLayer,
            shape,
            region: None,
            source: Source::default(),
        })
    });
    let pattern = Pattern { paths: paths.collect(), layers: vec![layer(OUTLINE, 3), layer(BOX, 4)] };
    Ok(projection.bend(&pattern, tolerance, Subdivision::Adaptive)?.drawing)
}

/// The contour through these points.
fn closed(points: &[FlatPoint]) -> Shape {
    let ends = points.iter().zip(points.iter().cycle().skip(1));
    Shape::Closed(ends.map(|(from, to)| Segment::Line { from: *from, to: *to }).collect())
}

/// The contour, or where it leaves the surface, its stretches on the surface.
fn on_surface(projection: &Projection<'_>, contour: Shape) -> Vec<Shape> {
    let is_on = |at: &FlatPoint| projection.surface.field.is_surface(projection.map.point(*at));
    let mut points = stations(&contour, STEP);
    let Some(first_off) = points.iter().position(|at| !is_on(at)) else { return vec![contour] };
    // The contour starts beside the surface, so that no stretch is divided by its start.
    points.rotate_left(first_off);
    points.push(points[0]);
    points
        .split(|at| !is_on(at))
        .filter(|stretch| stretch.len() > 1)
        .map(|stretch| {
            let pairs = stretch.windows(2);
            Shape::Open(pairs.map(|ends| Segment::Line { from: ends[0], to: ends[1] }).collect())
        })
        .collect()
}

/// The corners of the convex hull, counter-clockwise (Andrew, Another efficient algorithm for convex hulls in two dimensions,
/// 1979). Fewer than three points if all are on one line.
fn convex_hull(mut points: Vec<FlatPoint>) -> Vec<FlatPoint> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let turns_left = |a: FlatPoint, b: FlatPoint, c: FlatPoint| (b - a).perp(&(c - b)) > 0.0;
    let chain = |points: &mut dyn Iterator<Item = FlatPoint>| {
        let mut chain: Vec<FlatPoint> = Vec::new();
        for point in points {
            while let [.., before, last] = chain[..]
                && !turns_left(before, last, point)
            {
                chain.pop();
            }
            chain.push(point);
        }
        // The last point is the first one of the other chain.
        chain.pop();
        chain
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(coordinates: &[[f64; 2]]) -> Vec<FlatPoint> {
        coordinates.iter().map(|&[x, y]| FlatPoint::new(x, y)).collect()
    }

    #[test]
    fn the_hull_of_a_square_with_points_inside_and_on_its_sides_is_the_square() {
        let square = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
        let mut all = points(&square);
        all.extend(points(&[[1.0, 1.0], [1.0, 0.0], [2.0, 1.0], [0.0, 0.0], [0.5, 1.9]]));
        assert_eq!(convex_hull(all), points(&square));
    }

    #[test]
    fn points_on_one_line_have_no_hull() {
        for line in [&[[0.0, 0.0], [1.0, 1.0], [3.0, 3.0]][..], &[[1.0, 2.0]], &[]] {
            assert!(convex_hull(points(line)).len() < 3);
        }
    }
}
