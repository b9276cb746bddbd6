//! Readers for parts, in mm with +Z up: glTF 2, GLB, OBJ, STL, PLY and 3MF meshes become a
//! [`TriMesh`](crate::geometry::mesh::TriMesh), STEP files a [`Solid`](crate::geometry::solid::Solid) with exact faces, scans in PLY or lists of points a
//! [`PointCloud`](crate::geometry::point_cloud::PointCloud).
//!
//! No format gives the unit and the up axis reliably: glTF has a standard that programs break, the others have none. So
//! what the file states is checked against the usual sizes of products and the known behaviour of its producer.
//! [`PartFacts`] contains what was decided and why, and [`MeshOptions`] overrides it.
//!

use std::collections::BTreeMap;

use super::Pace;

mod units;
mod format;
mod options;
mod facts;
mod error;
mod raw;
mod root_pose;
mod gltf;
mod obj;
mod stl;
mod ply;
mod step;
mod package;
mod threemf;
mod content;
mod foreign;
mod points;
mod text;
mod scan_facts;
mod polygon;
mod normals;
mod clues;

pub use content::Content;
pub use error::{EmptyCause, MeshReadError, VertexPlace};
pub use facts::{
    Buffer, FaceKind, FrameFacts, MeshNoise, NamedFiles, NormalsFound, NormalsUsed, PartFacts, PartReading,
    RoundFacts, Shape, SideFacts, SolidPart,
};
pub use format::{MeshFormat, is_unread_part, unread_scan};
pub use options::{MeshOptions, NormalsChoice};
pub use scan_facts::{ScanFacts, ScanSurface};
pub use step::{StepError, StepProblem};
pub use units::{Decision, LengthUnit, UnknownWord, UpAxis};

use raw::{MAX_POINTS, MAX_TRIANGLES, QUICK_TRIANGLES, RawPart, at_most, check_pace};

/// A part in memory: its file, and the files beside it that are needed to read it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PartFile {
    /// The file's name.
    pub name: String,
    /// Its content.
    pub bytes: Vec<u8>,
    /// The contents of its buffer files (see [`named_files`]), by file name.
    pub siblings: BTreeMap<String, Vec<u8>>,
}

impl PartFile {
    /// A part in a single file.
    pub fn alone(name: impl Into<String>, bytes: impl Into<Vec<u8>>) -> Self {
        Self { name: name.into(), bytes: bytes.into(), siblings: BTreeMap::new() }
    }

    /// A part with the buffer files that it refers to; `read` returns the content of the file with the given name
    /// beside the part.
    ///
    /// # Errors
    /// When the buffer names cannot be read or lead out of the part's folder, or `read` fails.
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

/// Whether the part's file contains a node for a marking frame; the part may still be refused because of it. Only glTF has
/// such nodes.
pub fn has_frame(bytes: &[u8], format: MeshFormat) -> bool {
    match format.of_content(bytes) {
        MeshFormat::Gltf | MeshFormat::Glb => gltf::has_frame(bytes, format),
        MeshFormat::Step => step::has_frame(bytes),
        MeshFormat::Obj | MeshFormat::Stl | MeshFormat::Ply | MeshFormat::Xyz | MeshFormat::ThreeMf => false,
    }
}

/// Whether the file is a scan, by its format and header: points without faces.
pub fn is_scan(bytes: &[u8], format: MeshFormat) -> bool {
    match format.of_content(bytes) {
        MeshFormat::Xyz => true,
        MeshFormat::Ply => ply::is_scan(bytes),
        MeshFormat::Gltf
        | MeshFormat::Glb
        | MeshFormat::Obj
        | MeshFormat::Stl
        | MeshFormat::ThreeMf
        | MeshFormat::Step => false,
    }
}

/// Reads a part; `siblings` are the contents of files beside it, by file name, which only a `.gltf` needs.
///
/// For glTF the bytes decide between text and binary, whichever of the two `format` is.
///
/// # Errors
/// See [`MeshReadError`].
pub fn read(
    bytes: &[u8],
    format: MeshFormat,
    options: &MeshOptions,
    siblings: &BTreeMap<String, Vec<u8>>,
) -> Result<PartReading, MeshReadError> {
    if bytes.is_empty() {
        return Err(MeshReadError::EmptyFile);
    }
    let format = format.of_content(bytes);
    foreign::check(bytes, format)?;
    let part = match format {
        MeshFormat::Gltf | MeshFormat::Glb => gltf::read(bytes, format, options.pace, siblings)?,
        MeshFormat::Obj => obj::read(bytes, options.pace)?,
        MeshFormat::Stl => stl::read(bytes)?,
        MeshFormat::Ply => ply::read(bytes, options.pace)?,
        MeshFormat::Xyz => points::read(bytes)?,
        MeshFormat::ThreeMf => threemf::read(bytes, options.pace)?,
        MeshFormat::Step => step::read(bytes, options)?,
    };
    // A scan is fitted several times to find its noise.
    if part.is_scan && options.pace == Pace::Quick {
        return Err(MeshReadError::TakesLong);
    }
    check_pace(options.pace, part.triangles.len(), QUICK_TRIANGLES)?;
    part.into_reading(options)
}

/// The files beside a part that it refers to.
///
/// # Errors
/// See [`MeshReadError`]; buffers outside the part's folder are an error.
pub fn named_files(bytes: &[u8], format: MeshFormat) -> Result<NamedFiles, MeshReadError> {
    match format.of_content(bytes) {
        MeshFormat::Gltf | MeshFormat::Glb if bytes.is_empty() => Err(MeshReadError::EmptyFile),
        format @ (MeshFormat::Gltf | MeshFormat::Glb) => gltf::named_files(bytes, format),
        MeshFormat::Obj
        | MeshFormat::Stl
        | MeshFormat::Ply
        | MeshFormat::Xyz
        | MeshFormat::ThreeMf
        | MeshFormat::Step => Ok(NamedFiles::default()),
    }
}

/// Checks whether an STL, a PLY, a 3MF, a STEP file or a list of points is complete, without reading all of it. For the other formats this
/// is known only after reading.
///
/// # Errors
/// When the file is incomplete; see [`MeshReadError`].
pub fn is_whole(bytes: &[u8], format: MeshFormat) -> Result<(), MeshReadError> {
    if bytes.is_empty() {
        return Err(MeshReadError::EmptyFile);
    }
    let format = format.of_content(bytes);
    foreign::check(bytes, format)?;
    match format {
        MeshFormat::Stl => stl::is_whole(bytes),
        MeshFormat::ThreeMf => threemf::is_whole(bytes),
        MeshFormat::Ply => ply::is_whole(bytes),
        MeshFormat::Xyz => points::is_whole(bytes),
        MeshFormat::Step => step::is_whole(bytes),
        MeshFormat::Gltf | MeshFormat::Glb | MeshFormat::Obj => Ok(()),
    }
}
