//! Entities as curves in the space of the block that holds them.

use std::collections::BTreeSet;

use dxf::entities::{Entity, EntityType, Polyline};
use nalgebra::Vector3;

use super::super::error::PatternReadError;
use super::curves::{BulgeVertex, Curve, Placement, arc, bulged, is_full_turn, sweep_between, through};
use super::hatch;
use super::scan::Scan;
use super::splines::{ControlSpline, by_control_points, through_fit_points};
use super::stream::{clean, groups_of, numbers, read_portion};
use super::structure::{Record, Structure};

/// What an entity draws.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Item {
    /// A single spot.
    Dot(Vector3<f64>),
    /// A line or contour.
    Curve(Curve),
    /// Contours that bound one filled region; a sentence on what the fill loses, if anything.
    Fill(Vec<Curve>, Option<&'static str>),
    /// A block.
    Insert(Box<Insert>),
    /// Nothing, with the reason.
    NotTaken(String),
}

/// A block put somewhere, once or in rows and columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Insert {
    pub(super) block: String,
    /// From the block's space, base point at the origin, to the space that holds the insert.
    pub(super) placement: Placement,
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) column_step: Vector3<f64>,
    pub(super) row_step: Vector3<f64>,
}

/// What is read beside the curves themselves.
#[derive(Default)]
pub(super) struct Remarks {
    /// Positions in the inventory of polylines with a width, of which the middle line is taken.
    pub(super) wide: BTreeSet<usize>,
    /// Polylines from which the point was taken that the old FreeCAD exporter puts in front.
    pub(super) extra_vertices: usize,
}

/// Said of polylines that exporters leave behind; nothing is lost with them.
pub(super) const SINGLE_VERTEX: &str = "it has a single vertex and draws nothing";

/// Entities that are read with `dxf` at a time.
const PORTION: usize = 20_000;

/// What every entity of the inventory draws, in its order. Pieces of splines of high degree stay within `tolerance`, in
/// units of the drawing.
///
/// # Errors
/// A number of an entity that is drawn cannot be read or is not finite.
pub(super) fn items(
    scan: &Scan<'_>,
    structure: &Structure,
    tolerance: f64,
    remarks: &mut Remarks,
) -> Result<Vec<Item>, PatternReadError> {
    let mut items = vec![Item::NotTaken(String::new()); structure.entities.len()];
    let mut portion = Vec::new();
    for (index, record) in structure.entities.iter().enumerate() {
        match structure.kind(record) {
            "HATCH" | "MPOLYGON" => {
                items[index] = hatch::fill(&numbers(scan, structure, record)?, tolerance);
            }
            "DIMENSION" => items[index] = dimension(scan, structure, record)?,
            kind if groups_of(kind).is_some() => {
                portion.push((index, clean(scan, structure, index, remarks)?))
            }
            kind => items[index] = Item::NotTaken(why_not(kind)),
        }
        if portion.len() == PORTION || index + 1 == structure.entities.len() {
            read_portion(&portion, &mut |index, read| {
                let record = &structure.entities[index];
                items[index] = match read {
                    Ok(entity) => {
                        if has_width(entity) {
                            remarks.wide.insert(index);
                        }
                        item(entity, scan, record, tolerance)
                    }
                    Err(why) => Item::NotTaken(format!("it cannot be read: {why}")),
                };
            });
            portion.clear();
        }
    }
    Ok(items)
}

fn vector(point: &dxf::Point) -> Vector3<f64> {
    Vector3::new(point.x, point.y, point.z)
}

fn plane(normal: &dxf::Vector) -> Placement {
    Placement::of_extrusion(Vector3::new(normal.x, normal.y, normal.z))
}

fn item(entity: &Entity, scan: &Scan<'_>, record: &Record, tolerance: f64) -> Item {
    match &entity.specific {
        EntityType::Line(line) => Item::Curve(through(&[vector(&line.p1), vector(&line.p2)], false)),
        EntityType::ModelPoint(point) => Item::Dot(vector(&point.location)),
        EntityType::Circle(circle) => {
            let center = vector(&circle.center);
            round(circle.radius, || {
                arc(center, circle.radius, 0.0, std::f64::consts::TAU, &plane(&circle.normal))
            })
        }
        EntityType::Arc(part) => {
            let (start, end) = (part.start_angle.to_radians(), part.end_angle.to_radians());
            let center = vector(&part.center);
            let sweep = sweep_between(start, end);
            round(part.radius, || arc(center, part.radius, start, sweep, &plane(&part.normal)))
        }
        EntityType::Ellipse(ellipse) => {
            let major = Vector3::new(ellipse.major_axis.x, ellipse.major_axis.y, ellipse.major_axis.z);
            let normal = plane(&ellipse.normal).linear.column(2).into_owned();
            let sweep = sweep_between(ellipse.start_parameter, ellipse.end_parameter);
            let segment = super::curves::SpaceSegment::Arc {
                center: vector(&ellipse.center),
                u: major,
                v: normal.cross(&major) * ellipse.minor_axis_ratio,
                start: ellipse.start_parameter,
                sweep,
            };
            round(major.norm(), || Curve { segments: vec![segment], closed: is_full_turn(sweep) })
        }
        EntityType::LwPolyline(line) => {
            let vertices: Vec<BulgeVertex> = line
                .vertices
                .iter()
                .map(|vertex| BulgeVertex { x: vertex.x, y: vertex.y, bulge: vertex.bulge })
                .collect();
            let height = entity.common.elevation;
            polyline(&vertices, line.flags & 1 == 1, &plane(&line.extrusion_direction), height)
        }
        EntityType::Polyline(line) => old_polyline(line),
        EntityType::Spline(spline) => self::spline(spline, tolerance),
        EntityType::Solid(solid) => {
            let corners =
                [&solid.first_corner, &solid.second_corner, &solid.fourth_corner, &solid.third_corner];
            quadrangle(corners.map(vector), &plane(&solid.extrusion_direction))
        }
        EntityType::Trace(trace) => {
            let corners =
                [&trace.first_corner, &trace.second_corner, &trace.fourth_corner, &trace.third_corner];
            quadrangle(corners.map(vector), &plane(&trace.extrusion_direction))
        }
        EntityType::Insert(insert) => Item::Insert(Box::new(self::insert(insert, scan, record))),
        _ => Item::NotTaken("the DXF reader returned another entity".into()),
    }
}

fn has_width(entity: &Entity) -> bool {
    match &entity.specific {
        EntityType::LwPolyline(line) => {
            line.constant_width != 0.0
                || line.vertices.iter().any(|v| v.starting_width != 0.0 || v.ending_width != 0.0)
        }
        EntityType::Polyline(line) => {
            line.default_starting_width != 0.0
                || line.default_ending_width != 0.0
                || line.vertices().any(|v| v.starting_width != 0.0 || v.ending_width != 0.0)
        }
        _ => false,
    }
}

fn round(radius: f64, curve: impl FnOnce() -> Curve) -> Item {
    if radius == 0.0 { Item::NotTaken("its radius is 0".into()) } else { Item::Curve(curve()) }
}

fn polyline(vertices: &[BulgeVertex], closed: bool, plane: &Placement, height: f64) -> Item {
    match vertices {
        [] => Item::NotTaken("it has no vertex".into()),
        [_] => Item::NotTaken(SINGLE_VERTEX.into()),
        _ => Item::Curve(bulged(vertices, closed, plane, height)),
    }
}

fn old_polyline(line: &Polyline) -> Item {
    if line.flags & (16 | 64) != 0 {
        return Item::NotTaken("it is a mesh, not a curve: draw its edges as lines".into());
    }
    // Flag 16 of a vertex: a control point of a spline frame, which is not drawn.
    let drawn = || line.vertices().filter(|vertex| vertex.flags & 16 == 0);
    let closed = line.flags & 1 == 1;
    if line.flags & 8 != 0 {
        let points: Vec<Vector3<f64>> = drawn().map(|vertex| vector(&vertex.location)).collect();
        return match points.len() {
            0 | 1 => polyline(&[], closed, &Placement::scaling(1.0), 0.0),
            _ => Item::Curve(through(&points, closed)),
        };
    }
    let vertices: Vec<BulgeVertex> = drawn()
        .map(|vertex| BulgeVertex { x: vertex.location.x, y: vertex.location.y, bulge: vertex.bulge })
        .collect();
    polyline(&vertices, closed, &plane(&line.normal), line.location.z)
}

fn spline(spline: &dxf::entities::Spline, tolerance: f64) -> Item {
    let closed = spline.flags & 1 == 1;
    let curve = if spline.control_points.is_empty() {
        let points: Vec<Vector3<f64>> = spline.fit_points.iter().map(vector).collect();
        let direction = |tangent: &dxf::Point| Some(vector(tangent)).filter(|t| t.norm() > 0.0);
        through_fit_points(
            &points,
            closed,
            [direction(&spline.start_tangent), direction(&spline.end_tangent)],
        )
    } else {
        let points: Vec<Vector3<f64>> = spline.control_points.iter().map(vector).collect();
        let spline = ControlSpline {
            degree: usize::try_from(spline.degree_of_curve).unwrap_or(0),
            knots: &spline.knot_values,
            points: &points,
            weights: &spline.weight_values,
            closed,
        };
        by_control_points(&spline, tolerance)
    };
    curve.map_or_else(Item::NotTaken, Item::Curve)
}

fn quadrangle(corners: [Vector3<f64>; 4], plane: &Placement) -> Item {
    let mut corners: Vec<Vector3<f64>> = corners.iter().map(|corner| plane.point(*corner)).collect();
    // A triangle repeats a corner.
    corners.dedup();
    if corners.len() < 3 {
        return Item::NotTaken("it has no area".into());
    }
    Item::Fill(vec![through(&corners, true)], None)
}

fn block_name(scan: &Scan<'_>, record: &Record) -> String {
    let pair = record.pairs(scan).iter().take_while(|pair| pair.code < 1000).find(|pair| pair.code == 2);
    pair.map(|pair| scan.text(pair)).unwrap_or_default()
}

fn insert(insert: &dxf::entities::Insert, scan: &Scan<'_>, record: &Record) -> Insert {
    let plane = plane(&insert.extrusion_direction);
    let turn = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), insert.rotation.to_radians());
    let turned = plane.linear * turn.matrix();
    let scale = Vector3::new(insert.x_scale_factor, insert.y_scale_factor, insert.z_scale_factor);
    Insert {
        block: block_name(scan, record),
        placement: Placement {
            linear: turned * nalgebra::Matrix3::from_diagonal(&scale),
            offset: plane.point(vector(&insert.location)),
        },
        columns: usize::try_from(insert.column_count).unwrap_or(1).max(1),
        rows: usize::try_from(insert.row_count).unwrap_or(1).max(1),
        column_step: turned * Vector3::x() * insert.column_spacing,
        row_step: turned * Vector3::y() * insert.row_spacing,
    }
}

/// A dimension is drawn by a block that the drawing program made for it. Group 12 moves copies of it.
fn dimension(scan: &Scan<'_>, structure: &Structure, record: &Record) -> Result<Item, PatternReadError> {
    let block = block_name(scan, record);
    if block.is_empty() {
        return Ok(Item::NotTaken("it has no block that draws it: explode it in the drawing program".into()));
    }
    let mut shift = Vector3::zeros();
    let mut extrusion = Vector3::z();
    for (code, number) in numbers(scan, structure, record)? {
        match code {
            12 => shift.x = number,
            22 => shift.y = number,
            32 => shift.z = number,
            210 => extrusion.x = number,
            220 => extrusion.y = number,
            230 => extrusion.z = number,
            _ => {}
        }
    }
    let plane = Placement::of_extrusion(extrusion);
    Ok(Item::Insert(Box::new(Insert {
        block,
        placement: Placement { linear: plane.linear, offset: plane.point(shift) },
        columns: 1,
        rows: 1,
        column_step: Vector3::zeros(),
        row_step: Vector3::zeros(),
    })))
}

/// Why an entity of a kind that is not read is left out, and what to do.
fn why_not(kind: &str) -> String {
    match kind {
        "TEXT" | "MTEXT" | "ATTRIB" | "ATTDEF" | "RTEXT" | "ARCALIGNEDTEXT" => {
            "text is not marked: convert text to outlines in the drawing program"
        }
        "3DFACE" | "3DSOLID" | "BODY" | "REGION" | "SURFACE" | "MESH" | "PLANESURFACE"
        | "EXTRUDEDSURFACE" | "LOFTEDSURFACE" | "REVOLVEDSURFACE" | "SWEPTSURFACE" => {
            "it is a surface or a solid, not a curve: draw its outline"
        }
        "IMAGE" | "OLEFRAME" | "OLE2FRAME" | "WIPEOUT" | "PDFUNDERLAY" | "DWFUNDERLAY" | "DGNUNDERLAY" => {
            "pictures and covers are not marked: trace them to curves"
        }
        "RAY" | "XLINE" => "it has no end: trim it to a line",
        "VIEWPORT" => "it is a window of a layout, not part of the drawing",
        "VERTEX" | "SEQEND" => "it belongs to no polyline or block",
        _ => "this kind of entity is not read: explode it in the drawing program",
    }
    .into()
}
