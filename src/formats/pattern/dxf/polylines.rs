//! LWPOLYLINE and POLYLINE: plain curves, or filled bands if they have a width.

use super::super::error::PatternReadError;
use super::bands::{WideVertex, band};
use super::budget::Budget;
use super::curves::{BulgeVertex, Placement, bulged, through};
use super::groups::Groups;
use super::items::{Item, Reader, Remarks, WideLine};
use super::scan::Pair;
use super::structure::{Record, Structure};

/// The reason for skipping a polyline of one vertex, as some exporters write; no ink is lost.
pub(super) const SINGLE_VERTEX: &str = "it has a single vertex";

/// What an LWPOLYLINE draws.
pub(super) fn light(
    &Reader { scan, structure, tolerance, .. }: &Reader<'_>,
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
        return Ok(Item::Skipped(exceeded.into()));
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
    let geometry =
        Geometry { closed: groups.flags(70) & 1 == 1, plane: groups.plane(), height: groups.or(38, 0.0) };
    Ok(drawn(&vertices, &geometry, tolerance, budget))
}

/// The old FreeCAD exporter writes LWPOLYLINE into R12 files with an extra first point that group 90 does not count.
fn has_extra_vertex(structure: &Structure, groups: &Groups, vertices: &[WideVertex]) -> bool {
    structure.header.version.as_str() <= "AC1009"
        && groups.get(90) == Some(vertices.len() as f64 - 1.0)
        && vertices.first().is_some_and(|first| (first.vertex.x, first.vertex.y) == (0.0, 0.0))
}

/// What a POLYLINE with its VERTEX entities draws.
pub(super) fn heavy(
    &Reader { scan, structure, tolerance, .. }: &Reader<'_>,
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
        return Ok(Item::Skipped("it is a mesh, not a curve: draw its edges as lines".into()));
    }
    let (mut vertices, mut points, mut has_frame) = (Vec::new(), Vec::new(), false);
    for part in parts.filter(|part| scan.raw(&part[0]) == b"VERTEX") {
        let groups = read(part)?;
        // Flag 16 of a vertex: a control point of the spline frame, which is not drawn.
        if groups.flags(70) & 16 != 0 {
            has_frame = true;
            continue;
        }
        if let Err(exceeded) = budget.hold(1) {
            return Ok(Item::Skipped(exceeded.into()));
        }
        let at = groups.point(10);
        points.push(at);
        vertices.push(WideVertex {
            vertex: BulgeVertex { x: at.x, y: at.y, bulge: groups.or(42, 0.0) },
            widths: [40, 41].map(|code| groups.get(code).unwrap_or(head.or(code, 0.0))),
        });
    }
    let geometry =
        Geometry { closed: head.flags(70) & 1 == 1, plane: head.plane(), height: head.or(30, 0.0) };
    Ok(match points.len() {
        0 if has_frame => Item::Skipped(
            "it contains the frame of a curve without the curve: explode it in the drawing program".into(),
        ),
        2.. if head.flags(70) & 8 != 0 => Item::Curve(through(&points, geometry.closed)),
        _ => drawn(&vertices, &geometry, tolerance, budget),
    })
}

/// Whether a polyline is closed, and its plane and height.
struct Geometry {
    closed: bool,
    plane: Placement,
    height: f64,
}

fn drawn(vertices: &[WideVertex], geometry: &Geometry, tolerance: f64, budget: &mut Budget) -> Item {
    match vertices {
        [] => return Item::DrawsNothing("it has no vertex"),
        [_] => return Item::DrawsNothing(SINGLE_VERTEX),
        _ => {}
    }
    // The widths at the last vertex of an open polyline are not used.
    let with_segments = if geometry.closed { vertices } else { &vertices[..vertices.len() - 1] };
    let centreline: Vec<BulgeVertex> = vertices.iter().map(|wide| wide.vertex).collect();
    let centre = bulged(&centreline, geometry.closed, &geometry.plane, geometry.height);
    let width =
        with_segments.iter().flat_map(|wide| wide.widths).fold(0.0, |most: f64, width| most.max(width.abs()));
    if width == 0.0 {
        return Item::Curve(centre);
    }
    let contours = match band(vertices, geometry.closed, geometry.height, tolerance, budget) {
        Ok(contours) => contours,
        Err(exceeded) => return Item::Skipped(exceeded.into()),
    };
    match contours.is_empty() {
        true => Item::DrawsNothing("it has a width but no length"),
        false => {
            let area = contours.into_iter().map(|contour| contour.placed(&geometry.plane)).collect();
            Item::Wide(Box::new(WideLine { centre, area, width }))
        }
    }
}
