//! Parts: glTF 2, GLB, OBJ, STL and PLY become a [`TriMesh`](crate::geometry::mesh::TriMesh) in mm with +Z up, scans in PLY or lists of points a
//! [`PointCloud`](crate::geometry::point_cloud::PointCloud).
//!
//! No format says reliably in which unit and with which axis up its numbers were meant: glTF has a standard that
//! programs break, the others have none. So the file's word is held against the sizes of products and its producer's habits;
//! [`PartFacts`] says what was decided and why, and [`MeshOptions`] overrides it.
//!
//! STEP is not read here.

use std::collections::BTreeMap;

use super::Pace;

mod units;
mod format;
mod options;
mod facts;
mod error;
mod raw;
mod gltf;
mod obj;
mod stl;
mod ply;
mod points;
mod text;
mod scan_facts;
mod polygon;
mod normals;
mod clues;

pub use error::{EmptyCause, MeshReadError, VertexPlace};
pub use facts::{Buffer, NamedFiles, NormalsFound, PartFacts, PartReading, Shape};
pub use format::{MeshFormat, is_unread_part};
pub use options::MeshOptions;
pub use scan_facts::{ScanFacts, ScanSurface};
pub use units::{Decision, LengthUnit, UnknownWord, UpAxis};

use raw::{MOMENT, MOST_POINTS, MOST_TRIANGLES, RawPart, a_moment, at_most};

/// A part in memory: its file, and the files beside it that are needed to read it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PartFile {
    /// The file's name.
    pub name: String,
    /// Its content.
    pub bytes: Vec<u8>,
    /// The contents of the files that [`named_files`] calls its buffers, by their names.
    pub siblings: BTreeMap<String, Vec<u8>>,
}

impl PartFile {
    /// A part that needs no other file.
    pub fn alone(name: impl Into<String>, bytes: impl Into<Vec<u8>>) -> Self {
        Self { name: name.into(), bytes: bytes.into(), siblings: BTreeMap::new() }
    }

    /// A part with the buffers that it names; `read` gives the content of the file of a plain name beside it.
    ///
    /// # Errors
    /// When the names of the buffers cannot be read or lead elsewhere, or `read` fails.
    pub fn with_buffers(
        name: impl Into<String>,
        bytes: impl Into<Vec<u8>>,
        mut read: impl FnMut(&str) -> std::io::Result<Vec<u8>>,
    ) -> Result<Self, MeshReadError> {
        let mut part = Self::alone(name, bytes);
        let Some(format) = MeshFormat::from_name(&part.name) else { return Ok(part) };
        for Buffer { name, .. } in named_files(&part.bytes, format)?.buffers {
            let content = read(&name);
            let missing = |error: std::io::Error| MeshReadError::BufferMissing {
                name: name.clone(),
                kind: error.kind(),
            };
            let content = content.map_err(missing)?;
            part.siblings.insert(name, content);
        }
        Ok(part)
    }
}

/// Reads a part; `siblings` are the contents of files beside it, by their names, which only a `.gltf` needs.
///
/// The bytes decide between text and binary glTF, whatever `format` says of the two.
///
/// # Errors
/// See [`MeshReadError`].
pub fn read(
    bytes: &[u8],
    format: MeshFormat,
    options: &MeshOptions,
    siblings: &BTreeMap<String, Vec<u8>>,
) -> Result<PartReading, MeshReadError> {
    let format = format.of_content(bytes);
    let part = match format {
        MeshFormat::Gltf | MeshFormat::Glb => gltf::read(bytes, format, options.pace, siblings)?,
        MeshFormat::Obj => obj::read(bytes, options.pace)?,
        MeshFormat::Stl => stl::read(bytes)?,
        MeshFormat::Ply => ply::read(bytes, options.pace)?,
        MeshFormat::Xyz => points::read(bytes)?,
    };
    // How much noise a scan has is found by fitting it several times.
    if part.is_scan && options.pace == Pace::Quick {
        return Err(MeshReadError::TakesLong);
    }
    a_moment(options.pace, part.triangles.len(), MOMENT)?;
    part.into_reading(options)
}

/// The files beside a part that it names.
///
/// # Errors
/// See [`MeshReadError`]; buffers that lie outside the part's folder are an error.
pub fn named_files(bytes: &[u8], format: MeshFormat) -> Result<NamedFiles, MeshReadError> {
    match format.of_content(bytes) {
        format @ (MeshFormat::Gltf | MeshFormat::Glb) => gltf::named_files(bytes, format),
        MeshFormat::Obj | MeshFormat::Stl | MeshFormat::Ply | MeshFormat::Xyz => Ok(NamedFiles::default()),
    }
}

/// Whether the bytes of an STL, PLY or list of points are whole, without reading them all; what is missing otherwise.
/// The end of the other formats shows only when they are read.
///
/// # Errors
/// When more bytes would help; see [`MeshReadError`].
pub fn is_whole(bytes: &[u8], format: MeshFormat) -> Result<(), MeshReadError> {
    match format.of_content(bytes) {
        MeshFormat::Stl => stl::is_whole(bytes),
        MeshFormat::Ply => ply::is_whole(bytes),
        MeshFormat::Xyz => points::is_whole(bytes),
        MeshFormat::Gltf | MeshFormat::Glb | MeshFormat::Obj => Ok(()),
    }
}
