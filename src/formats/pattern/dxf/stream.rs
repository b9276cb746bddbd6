//! The stream that the `dxf` crate reads: cleaned by the scan, with only the groups that matter, every number finite, and
//! the position in the inventory as the handle.
//!
//! So files that `dxf` would refuse for a quirk elsewhere are read, nothing it leaves out goes unnoticed, and its memory
//! (about 2 kB an entity) is needed for one portion of the file at a time.

use std::fmt::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};

use dxf::entities::Entity;

use super::super::error::PatternReadError;
use super::entities::Remarks;
use super::scan::{Kind, Pair, Scan, kind_of};
use super::structure::{Record, Structure};

/// The groups that matter of the entities that `dxf` reads: own group codes, then those of its vertices.
pub(super) fn groups_of(kind: &str) -> Option<&'static [i32]> {
    Some(match kind {
        "LINE" | "3DLINE" => &[10, 20, 30, 11, 21, 31],
        "POINT" => &[10, 20, 30],
        "CIRCLE" => &[10, 20, 30, 40, 210, 220, 230],
        "ARC" => &[10, 20, 30, 40, 50, 51, 210, 220, 230],
        "ELLIPSE" => &[10, 20, 30, 11, 21, 31, 40, 41, 42, 210, 220, 230],
        "LWPOLYLINE" => &[38, 70, 43, 10, 20, 40, 41, 42, 210, 220, 230],
        "POLYLINE" | "VERTEX" => &[10, 20, 30, 40, 41, 42, 70, 210, 220, 230],
        "SPLINE" => &[70, 71, 10, 20, 30, 11, 21, 31, 12, 22, 32, 13, 23, 33, 40, 41, 210, 220, 230],
        "SOLID" | "TRACE" => &[10, 20, 30, 11, 21, 31, 12, 22, 32, 13, 23, 33, 210, 220, 230],
        "INSERT" => &[10, 20, 30, 41, 42, 43, 44, 45, 50, 70, 71, 210, 220, 230],
        _ => return None,
    })
}

/// The entity as text for `dxf`, with its position in the inventory as the handle (from 1).
pub(super) fn clean(
    scan: &Scan<'_>,
    structure: &Structure,
    index: usize,
    remarks: &mut Remarks,
) -> Result<String, PatternReadError> {
    let record = &structure.entities[index];
    let kind = structure.kind(record);
    let mut groups = groups_of(kind).unwrap_or_default();
    let mut out = format!("0\n{kind}\n5\n{:X}\n", index + 1);
    let mut foreign = false;
    let mut vertices = 0;
    let mut skip_vertex = has_extra_vertex(scan, structure, record);
    remarks.extra_vertices += usize::from(skip_vertex);
    let mut awaited_height = None;
    for pair in &record.pairs(scan)[1..] {
        match pair.code {
            0 => {
                let part = scan.raw(pair);
                // Attributes of a block are text, and named with the block.
                if part == b"ATTRIB" || kind == "INSERT" {
                    break;
                }
                groups = if part == b"VERTEX" { groups_of("VERTEX").unwrap_or_default() } else { &[] };
                let _ = write!(out, "0\n{}\n", if part == b"VERTEX" { "VERTEX" } else { "SEQEND" });
                foreign = false;
                continue;
            }
            1000.. => foreign = true,
            102 => foreign = scan.raw(pair).starts_with(b"{"),
            _ => {}
        }
        if foreign || !groups.contains(&pair.code) {
            continue;
        }
        let Some(number) = scan.number(pair) else {
            return Err(unreadable(scan, structure, record, pair));
        };
        if kind == "LWPOLYLINE" {
            vertices += usize::from(pair.code == 10);
            skip_vertex &= vertices < 2;
            let of_vertex = matches!(pair.code, 10 | 20 | 40..=42);
            if of_vertex && (skip_vertex || vertices == 0) {
                continue;
            }
        }
        // `dxf` pairs the coordinates of a spline by their order, so no height may be left out.
        if kind == "SPLINE" {
            if let Some(height) = awaited_height.take().filter(|height| *height != pair.code) {
                let _ = write!(out, "{height}\n0.0\n");
            }
            awaited_height = matches!(pair.code, 20 | 21).then_some(pair.code + 10);
        }
        let _ = match kind_of(pair.code) {
            Some(Kind::Double) => write!(out, "{}\n{number:?}\n", pair.code),
            _ => write!(out, "{}\n{}\n", pair.code, number as i64),
        };
    }
    if let Some(height) = awaited_height {
        let _ = write!(out, "{height}\n0.0\n");
    }
    if kind == "POLYLINE" && !out.ends_with("SEQEND\n") {
        out += "0\nSEQEND\n";
    }
    Ok(out)
}

/// The old FreeCAD exporter writes LWPOLYLINE into R12 files with a first point that is not counted in group 90.
fn has_extra_vertex(scan: &Scan<'_>, structure: &Structure, record: &Record) -> bool {
    if structure.kind(record) != "LWPOLYLINE" || structure.header.version.as_str() > "AC1009" {
        return false;
    }
    let pairs = record.pairs(scan);
    let counted = pairs.iter().find(|pair| pair.code == 90).and_then(|pair| scan.number(pair));
    let present = pairs.iter().filter(|pair| pair.code == 10).count();
    let is_zero =
        |code| pairs.iter().find(|pair| pair.code == code).and_then(|p| scan.number(p)) == Some(0.0);
    counted == Some(present as f64 - 1.0) && is_zero(10) && is_zero(20)
}

fn unreadable(scan: &Scan<'_>, structure: &Structure, record: &Record, pair: &Pair) -> PatternReadError {
    PatternReadError::UnreadableNumber {
        spot: scan.spot(pair),
        group: pair.code,
        text: scan.shown(pair),
        entity: structure.name(scan, record),
    }
}

/// The entity's numbers with their group codes, for entities that `dxf` does not return.
pub(super) fn numbers(
    scan: &Scan<'_>,
    structure: &Structure,
    record: &Record,
) -> Result<Vec<(i32, f64)>, PatternReadError> {
    let mut numbers = Vec::new();
    for pair in record.pairs(scan)[1..].iter().take_while(|pair| pair.code < 1000) {
        if matches!(kind_of(pair.code), Some(Kind::Double | Kind::Short | Kind::Integer)) {
            let number = scan.number(pair).ok_or_else(|| unreadable(scan, structure, record, pair))?;
            numbers.push((pair.code, number));
        }
    }
    Ok(numbers)
}

/// Reads a portion with `dxf`. If it refuses or panics, halves are tried until the entity at fault is alone.
pub(super) fn read_portion(
    portion: &[(usize, String)],
    found: &mut dyn FnMut(usize, Result<&Entity, String>),
) {
    if portion.is_empty() {
        return;
    }
    let texts: String = portion.iter().map(|(_, text)| text.as_str()).collect();
    let file = format!("0\nSECTION\n2\nENTITIES\n{texts}0\nENDSEC\n0\nEOF\n");
    let load = || dxf::Drawing::load_with_encoding(&mut file.as_bytes(), encoding_rs::UTF_8);
    let why = match catch_unwind(AssertUnwindSafe(load)) {
        Ok(Ok(drawing)) => {
            let is_its = |(entity, (index, _)): (&Entity, &(usize, String))| {
                entity.common.handle.0 == *index as u64 + 1
            };
            if drawing.entities().count() == portion.len() && drawing.entities().zip(portion).all(is_its) {
                drawing.entities().zip(portion).for_each(|(entity, (index, _))| found(*index, Ok(entity)));
                return;
            }
            "it was left out by the DXF reader".into()
        }
        Ok(Err(error)) => error.to_string(),
        Err(_) => "the DXF reader stumbled over it".into(),
    };
    match portion {
        [(index, _)] => found(*index, Err(why)),
        _ => {
            let (left, right) = portion.split_at(portion.len() / 2);
            read_portion(left, found);
            read_portion(right, found);
        }
    }
}
