//! Wavefront OBJ, polygons only (Alias|Wavefront, Advanced Visualizer manual, appendix B1).
//!
//! [`check`] goes through the file line by line, so that every error has its line, and writes a plain text of vertices,
//! normals and faces, which the format crate parses. Material files are never opened.

use std::path::Path;

use nalgebra::{Point3, Vector3};

use super::clues::Clues;
use super::error::EmptyCause;
use super::text::first_bytes;
use super::{MeshFormat, MeshReadError, NormalsFound, RawPart, normals, polygon};
use crate::formats::Pace;
use crate::reason::Notice;

use check::Checked;

mod lines;
mod check;

/// Reads a part from an OBJ file.
pub(super) fn read(bytes: &[u8], pace: Pace) -> Result<RawPart, MeshReadError> {
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    // OBJ is text and has no zero bytes.
    if bytes.is_empty() || bytes[..bytes.len().min(4096)].contains(&0) {
        return Err(not_obj(bytes));
    }
    let checked = Checked::of(bytes)?;
    if checked.vertices == 0 && checked.unknown.is_some() {
        return Err(not_obj(bytes));
    }
    let ends_open = checked.ends_open;
    let absent = absent_notice(&checked);
    let mut part = part_of(checked, pace)?;
    part.notices.extend(absent);
    if ends_open {
        let message =
            "the last line has no line break; if the file was cut off there, the last face is wrong";
        part.notices.push(Notice::warning("last-line-open", message));
    }
    Ok(part)
}

fn absent_notice(checked: &Checked) -> Option<Notice> {
    (checked.absent_normals > 0).then(|| {
        let message = format!(
            "{} face corners name a normal that the file does not contain, the first in line {}; they are read without a \
             normal, and the file has {} normals",
            checked.absent_normals, checked.first_absent, checked.normals
        );
        Notice::warning("obj-normals-absent", message)
    })
}

fn not_obj(bytes: &[u8]) -> MeshReadError {
    MeshReadError::NotThisFormat { format: MeshFormat::Obj, found: first_bytes(bytes) }
}

fn part_of(mut checked: Checked, pace: Pace) -> Result<RawPart, MeshReadError> {
    let mut clues = Clues::new(MeshFormat::Obj, checked.producer.take());
    clues.stated_unit = checked.stated_unit;
    let mut part = RawPart::new(clues);
    part.skipped = checked.skipped();
    if checked.corners == 0 {
        let cause = if !part.skipped.is_empty() {
            EmptyCause::OnlyOthers(part.skipped)
        } else if part.clues.is_arch_export() {
            EmptyCause::ArchContainer
        } else {
            EmptyCause::Nothing
        };
        return Err(MeshReadError::NoTriangles { cause });
    }
    let model = parse(&checked)?;
    let positions: Vec<Point3<f64>> =
        model.positions.as_chunks().0.iter().map(|&position| Point3::from(position)).collect();
    let triangles = triangles(&model, &positions, pace)?;
    let normals: Vec<Vector3<f64>> =
        model.normals.as_chunks().0.iter().map(|&normal| Vector3::from(normal)).collect();
    let normal = |triangle: usize, corner: usize| {
        let index: u32 = triangles[triangle][corner];
        normals[index as usize]
    };
    if normals.is_empty() {
        part.normals_found = NormalsFound::None;
        (part.positions, part.triangles) = (positions, triangles);
    } else if let Some(welded) = normals::weld_facets(&positions, &triangles, normal) {
        part.normals_found = NormalsFound::FacetsOnly;
        (part.positions, part.triangles) = welded;
    } else {
        part.normals_found = NormalsFound::Smooth;
        (part.positions, part.normals, part.triangles) = (positions, normals, triangles);
    }
    part.bodies = if checked.objects.used.is_empty() { checked.groups.used } else { checked.objects.used };
    part.materials = checked.materials.used;
    part.is_mark = of_triangles(&checked.is_mark, &model.face_arities);
    Ok(part)
}

/// The faces of a checked file, with one vertex for every pair of position and normal that occurs at a corner.
fn parse(checked: &Checked) -> Result<tobj::Mesh, MeshReadError> {
    // The crate triangulates only convex faces correctly, so `polygon` does it.
    let options =
        tobj::LoadOptions { single_index: true, triangulate: false, ignore_lines: true, ignore_points: true };
    let no_materials = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let refused = |message| MeshReadError::Refused { format: MeshFormat::Obj, message };
    let (models, _) = tobj::load_obj_buf(&mut &checked.text[..], &options, no_materials)
        .map_err(|error| refused(error.to_string()))?;
    let model = models.into_iter().next().map(|model| model.mesh).unwrap_or_default();
    let (read, normals) = (model.indices.len(), model.normals.len());
    if read != checked.corners || (normals != 0 && normals != model.positions.len()) {
        return Err(refused(format!("only {read} of {} face corners were read", checked.corners)));
    }
    Ok(model)
}

/// The flags of faces for the triangles that they are cut into.
fn of_triangles(of_faces: &[bool], arities: &[u32]) -> Vec<bool> {
    if arities.is_empty() {
        return of_faces.to_vec();
    }
    let pairs = of_faces.iter().zip(arities);
    pairs.flat_map(|(flag, arity)| std::iter::repeat_n(*flag, (*arity as usize).saturating_sub(2))).collect()
}

/// All faces cut into triangles.
fn triangles(
    model: &tobj::Mesh,
    positions: &[Point3<f64>],
    pace: Pace,
) -> Result<Vec<[u32; 3]>, MeshReadError> {
    // The crate leaves the arities empty if all faces are triangles.
    if model.face_arities.is_empty() {
        return Ok(model.indices.as_chunks().0.to_vec());
    }
    let mut cutter = polygon::Cutter::new(pace);
    let mut triangles = Vec::with_capacity(model.indices.len());
    let mut outline = Vec::new();
    let mut rest = &model.indices[..];
    for &arity in &model.face_arities {
        let (face, others) = rest.split_at(arity as usize);
        rest = others;
        if let &[a, b, c] = face {
            triangles.push([a, b, c]);
            continue;
        }
        outline.clear();
        outline.extend(face.iter().map(|&vertex| positions[vertex as usize]));
        cutter.cut(&outline, |corners| triangles.push(corners.map(|corner| face[corner])))?;
    }
    Ok(triangles)
}

#[cfg(test)]
mod tests;
