//! A drawing on the part as a list of points (CSV) and as a DXF with polylines in space.

use std::fmt::Write;

use super::write::{
    DxfProfile, FIRST_FREE_HANDLE, Groups, MODEL_SPACE, blocks, color, comment_lines, header, layer_names,
    number, objects, tables,
};
use crate::geometry::focus::SpaceDrawing;
use crate::geometry::space::Extents;

/// The first line of a list of points.
const COLUMNS: &str = "path,layer,closed,x_mm,y_mm,z_mm";

/// The points of a drawing in space, one for each line: number of the path from 1, layer, 1 for a contour (whose last point is joined to its
/// first), x, y, z. The layer is in quotation marks, with those in its name doubled (RFC 4180).
#[must_use]
pub fn write_points(drawing: &SpaceDrawing) -> Vec<u8> {
    let mut text = format!("{COLUMNS}\r\n");
    for (index, path) in drawing.paths.iter().enumerate() {
        let layer = drawing.layers.get(path.layer).map_or("0", |layer| layer.name.as_str());
        // A spreadsheet would treat a line break as the end of the row.
        let layer: String =
            layer.chars().map(|letter| if letter.is_control() { '_' } else { letter }).collect();
        let layer = layer.replace('"', "\"\"");
        for point in &path.points {
            let [x, y, z] = [point.x, point.y, point.z].map(number);
            // Writing into a String cannot fail.
            let _ = write!(text, "{},\"{layer}\",{},{x},{y},{z}\r\n", index + 1, u8::from(path.closed));
        }
    }
    text.into_bytes()
}

/// The drawing as a DXF file (R2000) in millimetres: a POLYLINE in space for each line, a POINT for each dot, on the layers and in
/// the colours of the drawing.
#[must_use]
pub fn write_space(drawing: &SpaceDrawing) -> Vec<u8> {
    let profile = DxfProfile::R2000;
    let mut file = Groups::new(FIRST_FREE_HANDLE, profile);
    for comment in &drawing.comments {
        comment_lines(comment).iter().for_each(|line| file.put(999, line));
    }
    let names = layer_names(&drawing.layers, profile);
    let mut entities = Groups::new(FIRST_FREE_HANDLE, profile);
    let point = |file: &mut Groups, point: &nalgebra::Point3<f64>| {
        for (code, value) in [(10, point.x), (20, point.y), (30, point.z)] {
            file.put(code, number(value));
        }
    };
    for path in &drawing.paths {
        let layer = names.get(path.layer).map_or("0", String::as_str);
        let entity = |file: &mut Groups, kind: &str, owner: u64| {
            let handle = file.next_handle;
            file.put(0, kind);
            file.put_new_handle(owner);
            file.put_class("AcDbEntity");
            file.put(8, layer);
            color(file, path.color);
            handle
        };
        match &path.points[..] {
            [] => {}
            [dot] => {
                entity(&mut entities, "POINT", MODEL_SPACE);
                entities.put_class("AcDbPoint");
                point(&mut entities, dot);
            }
            points => {
                let polyline = entity(&mut entities, "POLYLINE", MODEL_SPACE);
                entities.put_class("AcDb3dPolyline");
                entities.put_all(&[(66, "1"), (10, "0.0"), (20, "0.0"), (30, "0.0")]);
                entities.put(70, if path.closed { 9 } else { 8 });
                for vertex in points {
                    entity(&mut entities, "VERTEX", polyline);
                    entities.put_class("AcDbVertex");
                    entities.put_class("AcDb3dPolylineVertex");
                    point(&mut entities, vertex);
                    entities.put(70, 32);
                }
                entity(&mut entities, "SEQEND", polyline);
            }
        }
    }
    file.next_handle = entities.next_handle;
    let corners = drawing.paths.iter().flat_map(|path| &path.points);
    header(&mut file, &Extents::of(corners.map(|point| point.coords.xy())), drawing.layers.len());
    file.section("TABLES", |file| tables(file, &drawing.layers, &names));
    file.section("BLOCKS", blocks);
    file.section("ENTITIES", |file| file.text.push_str(&entities.text));
    file.section("OBJECTS", objects);
    file.put(0, "EOF");
    file.text.into_bytes()
}
