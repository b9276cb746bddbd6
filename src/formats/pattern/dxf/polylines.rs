//! LWPOLYLINE and POLYLINE: plain curves, and filled bands where they have a width.

use nalgebra::Vector3;

use super::super::error::PatternReadError;
use super::budget::{Budget, Exceeded};
use super::curves::{BulgeVertex, Curve, Placement, SpaceSegment, bulge_segment, bulged, through};
use super::entities::{Item, Remarks};
use super::groups::Groups;
use super::scan::{Pair, Scan};
use super::structure::{Record, Structure};

/// Said of polylines that exporters leave behind; nothing is lost with them.
pub(super) const SINGLE_VERTEX: &str = "it has a single vertex";

/// Corners of bands are mitred up to this many half widths from the middle line, sharper ones are cut.
const MITRE_LIMIT: f64 = 4.0;
/// Edges of bands that grow wider along an arc are drawn with so many chords for a full turn.
const TAPERED_CHORDS: f64 = 256.0;

/// A vertex with the widths of the segment that leaves it, at its start and at its end.
#[derive(Clone, Copy)]
struct WideVertex {
    vertex: BulgeVertex,
    widths: [f64; 2],
}

/// What an LWPOLYLINE draws.
pub(super) fn light(
    scan: &Scan<'_>,
    structure: &Structure,
    index: usize,
    record: &Record,
    remarks: &mut Remarks,
    budget: &mut Budget,
) -> Result<Item, PatternReadError> {
    let wanted = |code| matches!(code, 38 | 70 | 43 | 10 | 20 | 40..=42 | 90 | 210 | 220 | 230);
    let groups = Groups::read(scan, structure, record, record.pairs(scan), wanted)?;
    let width = groups.or(43, 0.0);
    let count = groups.0.iter().filter(|(code, _)| *code == 10).count();
    if let Err(exceeded) = budget.hold(count) {
        return Ok(Item::NotTaken(exceeded.into()));
    }
    let mut vertices: Vec<WideVertex> = Vec::with_capacity(count);
    for (code, number) in &groups.0 {
        match (code, vertices.last_mut()) {
            (10, _) => vertices.push(WideVertex {
                vertex: BulgeVertex { x: *number, y: 0.0, bulge: 0.0 },
                widths: [width; 2],
            }),
            (20, Some(last)) => last.vertex.y = *number,
            (40, Some(last)) => last.widths[0] = *number,
            (41, Some(last)) => last.widths[1] = *number,
            (42, Some(last)) => last.vertex.bulge = *number,
            _ => {}
        }
    }
    if has_extra_vertex(structure, &groups, &vertices) {
        if !remarks.strict {
            vertices.remove(0);
        }
        remarks.extra_vertices.push(index);
    }
    Ok(drawn(&vertices, groups.flags(70) & 1 == 1, &groups.plane(), groups.or(38, 0.0), budget))
}

/// The old FreeCAD exporter writes LWPOLYLINE into R12 files with a first point that is not counted in group 90.
fn has_extra_vertex(structure: &Structure, groups: &Groups, vertices: &[WideVertex]) -> bool {
    structure.header.version.as_str() <= "AC1009"
        && groups.get(90) == Some(vertices.len() as f64 - 1.0)
        && vertices.first().is_some_and(|first| (first.vertex.x, first.vertex.y) == (0.0, 0.0))
}

/// What a POLYLINE with its VERTEX entities draws.
pub(super) fn heavy(
    scan: &Scan<'_>,
    structure: &Structure,
    record: &Record,
    budget: &mut Budget,
) -> Result<Item, PatternReadError> {
    let read = |pairs: &[Pair]| {
        let wanted = |code| matches!(code, 10 | 20 | 30 | 40..=42 | 70 | 210 | 220 | 230);
        Groups::read(scan, structure, record, pairs, wanted)
    };
    let mut parts = record.pairs(scan).chunk_by(|_, next| next.code != 0);
    let head = read(parts.next().unwrap_or_default())?;
    if head.flags(70) & (16 | 64) != 0 {
        return Ok(Item::NotTaken("it is a mesh, not a curve: draw its edges as lines".into()));
    }
    let (mut vertices, mut points) = (Vec::new(), Vec::new());
    for part in parts.filter(|part| scan.raw(&part[0]) == b"VERTEX") {
        let groups = read(part)?;
        // Flag 16 of a vertex: a control point of a spline frame, which is not drawn.
        if groups.flags(70) & 16 != 0 {
            continue;
        }
        if let Err(exceeded) = budget.hold(1) {
            return Ok(Item::NotTaken(exceeded.into()));
        }
        let at = groups.point(10);
        points.push(at);
        vertices.push(WideVertex {
            vertex: BulgeVertex { x: at.x, y: at.y, bulge: groups.or(42, 0.0) },
            widths: [40, 41].map(|code| groups.get(code).unwrap_or(head.or(code, 0.0))),
        });
    }
    let closed = head.flags(70) & 1 == 1;
    Ok(match points.len() {
        2.. if head.flags(70) & 8 != 0 => Item::Curve(through(&points, closed)),
        _ => drawn(&vertices, closed, &head.plane(), head.or(30, 0.0), budget),
    })
}

fn drawn(vertices: &[WideVertex], closed: bool, plane: &Placement, height: f64, budget: &mut Budget) -> Item {
    match vertices {
        [] => return Item::DrawsNothing("it has no vertex"),
        [_] => return Item::DrawsNothing(SINGLE_VERTEX),
        _ => {}
    }
    // The widths at the last vertex of an open polyline belong to no segment.
    let with_segments = if closed { vertices } else { &vertices[..vertices.len() - 1] };
    if with_segments.iter().all(|wide| wide.widths == [0.0; 2]) {
        let middle: Vec<BulgeVertex> = vertices.iter().map(|wide| wide.vertex).collect();
        return Item::Curve(bulged(&middle, closed, plane, height));
    }
    let contours = match band(vertices, closed, height, budget) {
        Ok(contours) => contours,
        Err(exceeded) => return Item::NotTaken(exceeded.into()),
    };
    match contours.is_empty() {
        true => Item::DrawsNothing("it has a width but no length"),
        false => Item::Fill(contours.into_iter().map(|contour| contour.placed(plane)).collect()),
    }
}

/// The contours of a filled band: one round an open polyline, two for a closed one.
fn band(
    vertices: &[WideVertex],
    closed: bool,
    height: f64,
    budget: &mut Budget,
) -> Result<Vec<Curve>, Exceeded> {
    let following = vertices.iter().skip(1).chain(vertices.first().filter(|_| closed));
    let pieces: Vec<(SpaceSegment, [f64; 2])> = vertices
        .iter()
        .zip(following)
        .filter(|(from, to)| (from.vertex.x, from.vertex.y) != (to.vertex.x, to.vertex.y))
        .map(|(from, to)| (bulge_segment(&from.vertex, &to.vertex, height), from.widths))
        .collect();
    let left = edge(&pieces, 0.5, closed, budget)?;
    let right = edge(&pieces, -0.5, closed, budget)?;
    let contour = |segments: Vec<SpaceSegment>| Curve { segments, closed: true };
    if closed {
        // A disc is a ring without a hole: its inner edge has shrunk to the centre.
        let is_hole = |edge: &Vec<SpaceSegment>| edge.iter().any(|segment| segment.start() != segment.end());
        return Ok([left, right].into_iter().filter(is_hole).map(contour).collect());
    }
    let mut around = left;
    for segment in right.into_iter().rev().map(SpaceSegment::reversed) {
        bridge(&mut around, segment.start(), budget)?;
        around.push(segment);
    }
    if let Some(start) = around.first().map(SpaceSegment::start) {
        bridge(&mut around, start, budget)?;
    }
    Ok(if around.len() > 1 { vec![contour(around)] } else { Vec::new() })
}

/// One edge of a band, `side` widths to the left of its middle line, with its corners mitred.
fn edge(
    pieces: &[(SpaceSegment, [f64; 2])],
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

/// Lets two lines that meet at a corner of the middle line end where they cross, unless that is too far away.
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

/// The segment moved to its left by the first distance at its start and the second at its end.
fn moved_aside(
    segment: &SpaceSegment,
    distances: [f64; 2],
    budget: &mut Budget,
) -> Result<Vec<SpaceSegment>, Exceeded> {
    let line = |from, to| SpaceSegment::Line { from, to };
    budget.hold(1)?;
    Ok(match segment {
        SpaceSegment::Arc { center, u, start, sweep, .. } => {
            // The left of an arc that turns left is towards its centre.
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

/// Adds a line to `target` if the last segment does not end there, up to rounding.
pub(super) fn bridge(
    segments: &mut Vec<SpaceSegment>,
    target: Vector3<f64>,
    budget: &mut Budget,
) -> Result<(), Exceeded> {
    let is_gap = |from: &Vector3<f64>| (target - from).norm() > 1e-9 * (1.0 + target.norm());
    if let Some(from) = segments.last().map(SpaceSegment::end).filter(is_gap) {
        budget.hold(1)?;
        segments.push(SpaceSegment::Line { from, to: target });
    }
    Ok(())
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
        super::band(vertices, closed, height, &mut Budget::default()).unwrap()
    }

    /// Inked area of a band by the even-odd rule; its contours do not cross here.
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
        // An L of two legs of 10 mm, 2 mm wide: 2·10·2 mm², as the mitre outside adds what the inside loses.
        let l = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)].map(|(x, y)| wide(x, y, 0.0, [2.0; 2]));
        assert!((area(&band(&l, false, 0.0)) - 40.0).abs() < 1e-9);
        let square =
            [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)].map(|(x, y)| wide(x, y, 0.0, [2.0; 2]));
        let frame = band(&square, true, 0.0);
        assert!(frame.len() == 2 && (area(&frame) - (144.0 - 64.0)).abs() < 1e-9);
    }

    #[test]
    fn a_donut_is_a_ring_and_without_a_hole_a_disc() {
        let donut = |width: f64| [wide(-4.0, 0.0, 1.0, [width; 2]), wide(4.0, 0.0, 1.0, [width; 2])];
        let ring = band(&donut(2.0), true, 0.0);
        assert!(ring.len() == 2 && (area(&ring) - PI * (25.0 - 9.0)).abs() < 1e-3);
        let disc = band(&donut(8.0), true, 0.0);
        assert!(disc.len() == 1 && (area(&disc) - PI * 64.0).abs() < 1e-3);
    }

    #[test]
    fn a_band_may_grow_wider_along_an_arc() {
        // Half a ring whose width grows from 0 to 2 about the radius 5: ∫ w(φ)·5 dφ over π = 5π.
        let horn = [wide(5.0, 0.0, 1.0, [0.0, 2.0]), wide(-5.0, 0.0, 0.0, [0.0; 2])];
        assert!((area(&band(&horn, false, 0.0)) - 5.0 * PI).abs() < 0.01);
    }

    #[test]
    fn what_grows_wider_along_arcs_is_counted_before_it_is_drawn() {
        // Each arc of nearly a full turn needs 254 chords on each side: 12,000 of them more than is held.
        let bow = |index: u32| wide(f64::from(index % 2), 0.0, 99.0, [1.0, 2.0]);
        let mut budget = Budget::default();
        let Item::NotTaken(_) = drawn(
            &(0..12_000).map(bow).collect::<Vec<_>>(),
            false,
            &Placement::scaling(1.0),
            0.0,
            &mut budget,
        ) else {
            panic!()
        };
        assert_eq!(budget.exceeded(), Some(super::super::budget::Cost::Held));
    }
}
