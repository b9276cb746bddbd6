//! Polylines with a width: filled bands, with mitred corners.

use i_overlay::core::fill_rule::FillRule;
use i_overlay::float::simplify::SimplifyShape;
use nalgebra::Vector3;

use super::budget::{Budget, Exceeded};
use super::curves::{BulgeVertex, Curve, SpaceSegment, bridge, bulge_segment, flattened, through};
use crate::geometry::space::FlatPoint;

/// Largest distance of a mitred corner from the centreline, in half widths; sharper corners are bevelled.
const MITRE_LIMIT: f64 = 4.0;
/// Largest coordinate of bands whose overlaps are found, in the drawing's units: larger ones vanish between two steps of the
/// grid for it, or overflow. They are out of range in every unit.
const MAX_COORDINATE: f64 = 1e9;
/// Number of chords per full turn for the edges of bands whose width changes along an arc.
const TAPERED_CHORDS: f64 = 256.0;

/// A vertex with the widths of the segment that starts there, at the segment's start and end.
#[derive(Clone, Copy)]
pub(super) struct WideVertex {
    pub(super) vertex: BulgeVertex,
    pub(super) widths: [f64; 2],
}

/// A piece of the centreline with the widths at its ends.
type Piece = (SpaceSegment, [f64; 2]);

/// The contours of a filled band: one for an open polyline, two for a closed one, any number if the band overlaps
/// itself. In that case they are approximated within `tolerance`, otherwise they are exact.
pub(super) fn band(
    vertices: &[WideVertex],
    closed: bool,
    height: f64,
    tolerance: f64,
    budget: &mut Budget,
) -> Result<Vec<Curve>, Exceeded> {
    let following = vertices.iter().skip(1).chain(vertices.first().filter(|_| closed));
    let pieces: Vec<Piece> = vertices
        .iter()
        .zip(following)
        .filter(|(from, to)| (from.vertex.x, from.vertex.y) != (to.vertex.x, to.vertex.y))
        .map(|(from, to)| (bulge_segment(&from.vertex, &to.vertex, height), from.widths))
        .collect();
    let outline = outline(&pieces, closed, budget)?;
    let flat = flattened(&outline, tolerance, budget)?;
    let covered = covered(&pieces, closed, tolerance, budget)?;
    // If the band overlaps itself, the outline bounds another area than the band covers: overlaps would become holes.
    let areas: Vec<f64> = flat.iter().map(|contour| area(contour).abs()).collect();
    let bounded = match areas.as_slice() {
        [outer, inner] => (outer - inner).abs(),
        areas => areas.iter().sum(),
    };
    let in_all: f64 = covered.iter().map(|contour| area(contour)).sum();
    let around: f64 = flat.iter().map(|contour| length(contour)).sum();
    if (bounded - in_all.abs()).abs() <= 2.0 * tolerance * around {
        return Ok(outline);
    }
    let lifted = |point: &FlatPoint| Vector3::new(point.x, point.y, height);
    Ok(covered.iter().map(|contour| through(&contour.iter().map(lifted).collect::<Vec<_>>(), true)).collect())
}

/// The two edges of the band, joined at the ends if it is open.
fn outline(pieces: &[Piece], closed: bool, budget: &mut Budget) -> Result<Vec<Curve>, Exceeded> {
    let left = edge(pieces, 0.5, closed, budget)?;
    let right = edge(pieces, -0.5, closed, budget)?;
    let contour = |segments: Vec<SpaceSegment>| Curve { segments, closed: true };
    if closed {
        // In a disc, the inner edge has shrunk to the centre.
        let is_hole = |edge: &Vec<SpaceSegment>| edge.iter().any(|segment| segment.start() != segment.end());
        return Ok([left, right].into_iter().filter(is_hole).map(contour).collect());
    }
    let around = ring(left, right, budget)?;
    Ok(if around.len() > 1 { vec![contour(around)] } else { Vec::new() })
}

/// Along one edge and back along the other.
fn ring(
    mut there: Vec<SpaceSegment>,
    back: Vec<SpaceSegment>,
    budget: &mut Budget,
) -> Result<Vec<SpaceSegment>, Exceeded> {
    for segment in back.into_iter().rev().map(SpaceSegment::reversed) {
        bridge(&mut there, segment.start(), budget)?;
        there.push(segment);
    }
    if let Some(start) = there.first().map(SpaceSegment::start) {
        bridge(&mut there, start, budget)?;
    }
    Ok(there)
}

/// The contours of the area that the pieces and the corners between them cover; holes have the opposite orientation.
fn covered(
    pieces: &[Piece],
    closed: bool,
    tolerance: f64,
    budget: &mut Budget,
) -> Result<Vec<Vec<FlatPoint>>, Exceeded> {
    let mut parts: Vec<Curve> = Vec::with_capacity(2 * pieces.len());
    let mut sides: Vec<[Vec<SpaceSegment>; 2]> = Vec::with_capacity(pieces.len());
    for (middle, widths) in pieces {
        let aside =
            |side: f64, budget: &mut Budget| moved_aside(middle, widths.map(|width| width * side), budget);
        let [left, right] = [aside(0.5, budget)?, aside(-0.5, budget)?];
        parts.push(Curve { segments: ring(left.clone(), right.clone(), budget)?, closed: true });
        sides.push([left, right]);
    }
    let next =
        |index: usize| if index + 1 < pieces.len() { Some(index + 1) } else { Some(0).filter(|_| closed) };
    for (index, before) in sides.iter().enumerate() {
        let Some(after) = next(index).filter(|next| *next != index) else { continue };
        let (corner, half) = (pieces[after].0.start(), pieces[after].1[0] / 2.0);
        parts.extend(outer_corner(before, &sides[after], corner, half));
    }
    let contours: Vec<Vec<[f64; 2]>> = flattened(&parts, tolerance, budget)?
        .into_iter()
        .map(|mut contour| {
            if area(&contour) < 0.0 {
                contour.reverse();
            }
            contour.iter().map(|point| [point.x, point.y]).collect()
        })
        .collect();
    let is_sound = |value: &f64| value.abs() <= MAX_COORDINATE;
    let shapes = match contours.iter().flatten().flatten().all(is_sound) {
        true => contours.simplify_shape(FillRule::NonZero),
        false => vec![contours],
    };
    let point = |[x, y]: [f64; 2]| FlatPoint::new(x, y);
    Ok(shapes.into_iter().flatten().map(|contour| contour.into_iter().map(point).collect()).collect())
}

/// The outer side of a corner between two pieces, mitred or bevelled.
fn outer_corner(
    before: &[Vec<SpaceSegment>; 2],
    after: &[Vec<SpaceSegment>; 2],
    corner: Vector3<f64>,
    half: f64,
) -> Option<Curve> {
    let ends = [before[0].last()?.end(), before[1].last()?.end()];
    let starts = [after[0].first()?.start(), after[1].first()?.start()];
    let across = [(ends[0] - ends[1]).xy(), (starts[0] - starts[1]).xy()];
    let turn = across[0].perp(&across[1]);
    if turn == 0.0 {
        return None;
    }
    let side = usize::from(turn > 0.0);
    let (mut last, mut first) = (before[side].last()?.clone(), after[side].first()?.clone());
    mitre(&mut last, &mut first, corner, half);
    Some(through(&[corner, ends[side], last.end(), first.start(), starts[side]], true))
}

/// The enclosed area, negative if the contour is clockwise.
fn area(contour: &[FlatPoint]) -> f64 {
    let ends = contour.iter().zip(contour.iter().cycle().skip(1));
    ends.map(|(a, b)| a.coords().perp(&b.coords())).sum::<f64>() / 2.0
}

fn length(contour: &[FlatPoint]) -> f64 {
    contour.iter().zip(contour.iter().cycle().skip(1)).map(|(a, b)| a.distance(*b)).sum()
}

/// One edge of a band, `side` widths to the left of its centreline, with mitred corners.
fn edge(
    pieces: &[Piece],
    side: f64,
    closed: bool,
    budget: &mut Budget,
) -> Result<Vec<SpaceSegment>, Exceeded> {
    let mut around: Vec<SpaceSegment> = Vec::new();
    for (middle, widths) in pieces {
        let moved = moved_aside(middle, widths.map(|width| width * side), budget)?;
        for (position, mut segment) in moved.into_iter().enumerate() {
            if let (0, Some(last)) = (position, around.last_mut()) {
                mitre(last, &mut segment, middle.start(), widths[0] * side);
            }
            bridge(&mut around, segment.start(), budget)?;
            around.push(segment);
        }
    }
    if let (true, [first, .., last], Some((middle, widths))) = (closed, around.as_mut_slice(), pieces.first())
    {
        mitre(last, first, middle.start(), widths[0] * side);
        let start = first.start();
        bridge(&mut around, start, budget)?;
    }
    Ok(around)
}

/// Extends or shortens two lines at a corner of the centreline to their intersection, unless that is too far away.
fn mitre(before: &mut SpaceSegment, after: &mut SpaceSegment, corner: Vector3<f64>, half: f64) {
    let (SpaceSegment::Line { from: a, to: b }, SpaceSegment::Line { from: c, to: d }) = (before, after)
    else {
        return;
    };
    let (along, next) = (*b - *a, *d - *c);
    let cross = along.x * next.y - along.y * next.x;
    if cross.abs() <= 1e-12 * along.norm() * next.norm() {
        return;
    }
    let gap = *c - *a;
    let meeting = *a + along * ((gap.x * next.y - gap.y * next.x) / cross);
    if (meeting - corner).norm() <= MITRE_LIMIT * half.abs() {
        (*b, *c) = (meeting, meeting);
    }
}

/// The segment, moved to its left by the first distance at its start and by the second at its end.
fn moved_aside(
    segment: &SpaceSegment,
    distances: [f64; 2],
    budget: &mut Budget,
) -> Result<Vec<SpaceSegment>, Exceeded> {
    let line = |from, to| SpaceSegment::Line { from, to };
    budget.hold(1)?;
    Ok(match segment {
        SpaceSegment::Arc { center, u, start, sweep, .. } => {
            // The left side of a counter-clockwise arc is towards its centre.
            let radius = |share: f64| {
                u.norm() - sweep.signum() * (distances[0] * (1.0 - share) + distances[1] * share)
            };
            if distances[0] == distances[1] && radius(0.0) >= 0.0 {
                let (u, v) = (Vector3::x() * radius(0.0), Vector3::y() * radius(0.0));
                return Ok(vec![SpaceSegment::Arc { center: *center, u, v, start: *start, sweep: *sweep }]);
            }
            let count = (sweep.abs() / std::f64::consts::TAU * TAPERED_CHORDS).ceil().max(1.0);
            budget.hold(count as usize)?;
            let at = |step: f64| {
                let (sin, cos) = (start + sweep * step / count).sin_cos();
                center + Vector3::new(cos, sin, 0.0) * radius(step / count)
            };
            (0..count as usize).map(|step| line(at(step as f64), at(step as f64 + 1.0))).collect()
        }
        other => {
            let (from, to) = (other.start(), other.end());
            let along = (to - from).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
            let left = Vector3::new(-along.y, along.x, 0.0);
            vec![line(from + left * distances[0], to + left * distances[1])]
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::pattern::Shape;
    use std::f64::consts::PI;

    fn wide(x: f64, y: f64, bulge: f64, widths: [f64; 2]) -> WideVertex {
        WideVertex { vertex: BulgeVertex { x, y, bulge }, widths }
    }

    fn band(vertices: &[WideVertex], closed: bool, height: f64) -> Vec<Curve> {
        super::band(vertices, closed, height, 1e-5, &mut Budget::default()).unwrap()
    }

    /// The filled area of a band by the even-odd rule; its contours do not intersect in these tests.
    fn area(contours: &[Curve]) -> f64 {
        let areas = contours.iter().map(|contour| {
            let flat = contour.segments.iter().map(SpaceSegment::seen_from_above).collect();
            let points = Shape::Closed(flat).flattened(1e-6);
            let ends = points.iter().zip(points.iter().cycle().skip(1));
            (ends.map(|(a, b)| a.x * b.y - b.x * a.y).sum::<f64>() / 2.0).abs()
        });
        let mut areas: Vec<f64> = areas.collect();
        areas.sort_by(f64::total_cmp);
        areas.iter().rev().enumerate().map(|(index, area)| if index == 0 { *area } else { -area }).sum()
    }

    #[test]
    fn a_straight_band_is_a_rectangle_and_a_tapering_one_a_trapezium() {
        let straight = band(&[wide(0.0, 0.0, 0.0, [2.0; 2]), wide(10.0, 0.0, 0.0, [2.0; 2])], false, 0.0);
        assert!((area(&straight) - 20.0).abs() < 1e-9 && straight[0].segments.len() == 4);
        let arrow = band(&[wide(0.0, 0.0, 0.0, [4.0, 0.0]), wide(10.0, 0.0, 0.0, [0.0; 2])], false, 0.0);
        assert!((area(&arrow) - 20.0).abs() < 1e-9 && arrow[0].segments.len() == 3);
    }

    #[test]
    fn corners_are_mitred() {
        // An L of two legs of 10 mm, 2 mm wide: 2·10·2 mm², because the mitre adds as much outside as the inside loses.
        let l = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)].map(|(x, y)| wide(x, y, 0.0, [2.0; 2]));
        assert!((area(&band(&l, false, 0.0)) - 40.0).abs() < 1e-9);
        let square =
            [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)].map(|(x, y)| wide(x, y, 0.0, [2.0; 2]));
        let frame = band(&square, true, 0.0);
        assert!(frame.len() == 2 && (area(&frame) - (144.0 - 64.0)).abs() < 1e-9);
    }

    #[test]
    fn a_donut_is_a_ring_or_without_a_hole_a_disc() {
        let donut = |width: f64| [wide(-4.0, 0.0, 1.0, [width; 2]), wide(4.0, 0.0, 1.0, [width; 2])];
        let ring = band(&donut(2.0), true, 0.0);
        assert!(ring.len() == 2 && (area(&ring) - PI * (25.0 - 9.0)).abs() < 1e-3);
        let disc = band(&donut(8.0), true, 0.0);
        assert!(disc.len() == 1 && (area(&disc) - PI * 64.0).abs() < 1e-3);
    }

    #[test]
    fn a_band_that_is_out_of_range_keeps_its_reach() {
        for (far, width) in [(1e10, 1.0), (1e160, 1.0), (1e300, 1.0), (10.0, 1e300), (1e308, 1e308)] {
            let corner = [(0.0, 0.0), (far, far), (0.9 * far, 0.0)].map(|(x, y)| wide(x, y, 0.0, [width; 2]));
            let band = band(&corner, false, 0.0);
            let reach = band.iter().flat_map(|curve| &curve.segments).map(SpaceSegment::reach);
            assert!(reach.fold(0.0, f64::max) > 1e9, "{far} {width}");
        }
    }

    #[test]
    fn the_width_of_a_band_can_change_along_an_arc() {
        // Half a ring of radius 5 whose width grows from 0 to 2: ∫ w(φ)·5 dφ over π = 5π.
        let horn = [wide(5.0, 0.0, 1.0, [0.0, 2.0]), wide(-5.0, 0.0, 0.0, [0.0; 2])];
        assert!((area(&band(&horn, false, 0.0)) - 5.0 * PI).abs() < 0.01);
    }

    #[test]
    fn a_band_that_crosses_itself_has_no_hole_there() {
        // A loop of four legs, 2 mm wide; the last crosses the first in a square of 2 x 2 mm, which is filled once.
        let corners = [(0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (10.0, 10.0), (10.0, -10.0)];
        let crossing = band(&corners.map(|(x, y)| wide(x, y, 0.0, [2.0; 2])), false, 0.0);
        assert!(
            (area(&crossing) - (2.0 * (20.0 + 10.0 + 10.0 + 20.0) - 4.0)).abs() < 1e-3,
            "{}",
            area(&crossing)
        );
    }

    #[test]
    fn a_leg_shorter_than_the_width_keeps_its_corner() {
        // A leg of 10 mm, 2 mm wide, then one of 0.5 mm across: it adds only its mitre, 2 x 1 mm, which reaches 0.5 mm
        // up.
        let corners = [(0.0, 0.0), (10.0, 0.0), (10.0, 0.5)];
        let hook = band(&corners.map(|(x, y)| wide(x, y, 0.0, [2.0; 2])), false, 0.0);
        // The first leg has 20 mm², the outer corner 1 mm²; the short leg adds 0.5 mm² outside.
        assert!((area(&hook) - 21.5).abs() < 1e-3, "{}", area(&hook));
    }

    #[test]
    fn chords_of_tapered_arcs_are_counted_before_they_are_created() {
        // Each arc of nearly a full turn needs 254 chords on each side, so 12,000 arcs exceed the limit.
        let bows: Vec<WideVertex> =
            (0..12_000).map(|index| wide(f64::from(index % 2), 0.0, 99.0, [1.0, 2.0])).collect();
        let mut budget = Budget::default();
        assert!(super::band(&bows, false, 0.0, 1e-5, &mut budget).is_err());
        assert_eq!(budget.exceeded(), Some(super::super::budget::Cost::Held));
    }
}
