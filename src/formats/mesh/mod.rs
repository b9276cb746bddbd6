//! Parts as triangle meshes: glTF 2, GLB and OBJ become a [`TriMesh`] in mm with +Z up.
//!
//! No format says reliably in which unit and with which axis up its numbers were meant: glTF has a standard that
//! programs break, OBJ has none. So the file's word is held against the sizes of products and its producer's habits;
//! [`PartFacts`] says what was decided and why, and [`MeshOptions`] overrides it.
//!
//! Point clouds, STL and STEP are not read here.

use std::fmt;
use std::io;

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::geometry::mesh::{MeshError, TriMesh};
use crate::reason::Notice;

mod units;
mod error;
mod gltf;
mod obj;
mod polygon;
mod normals;
mod clues;

pub use error::{EmptyCause, MeshReadError, VertexPlace};
pub use units::{Decision, LengthUnit, UnknownWord, UpAxis};

use clues::{Clues, Corners};

/// Most triangles a part may have; a million is already finer than any marking needs.
const MOST_TRIANGLES: usize = 10_000_000;

/// A format that parts can be read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MeshFormat {
    /// glTF 2 as text, its buffers beside it or inside.
    Gltf,
    /// glTF 2 in one binary file.
    Glb,
    /// Wavefront OBJ.
    Obj,
}

/// What the settings say of a part file; `None` leaves it to the file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MeshOptions {
    /// Unit of the file's numbers.
    pub unit: Option<LengthUnit>,
    /// Axis of the file that points up.
    pub up: Option<UpAxis>,
}

/// A part with what its file says about it.
#[derive(Debug, Clone, PartialEq)]
pub struct PartReading {
    /// The part, mm, +Z up.
    pub mesh: TriMesh,
    /// What was found and decided.
    pub facts: PartFacts,
}

/// What was found in a part file, and how it was understood.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PartFacts {
    /// The format the bytes were in, whatever the file's name says.
    pub format: MeshFormat,
    /// The program that wrote the file, in its own words; for OBJ the first comment.
    pub producer: Option<String>,
    /// Unit of the file's numbers.
    pub unit: Decision<LengthUnit>,
    /// Axis of the file that points up.
    pub up: Decision<UpAxis>,
    /// Extents of the part along x, y and z with +Z up, mm.
    #[serde(rename = "size_mm")]
    pub size: [f64; 3],
    /// Number of triangles with an area.
    pub triangles: usize,
    /// Number of vertices in the mesh.
    pub vertices: usize,
    /// What the file's normals are good for.
    pub normals: NormalsFound,
    /// Names of the bodies, in the file's order; empty where the file has no names.
    pub bodies: Vec<String>,
    /// Names of the materials that faces use, in the order of first use.
    pub materials: Vec<String>,
    /// What the file holds besides and was left aside, such as `2 x camera`.
    pub not_taken: Vec<String>,
    /// What a person should know of this reading.
    pub notices: Vec<Notice>,
}

/// What a file's normals are good for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NormalsFound {
    /// The file has none.
    None,
    /// They repeat each triangle's own plane and say nothing of a curved surface; the mesh comes without them, its
    /// vertices welded.
    FacetsOnly,
    /// They follow the surface.
    Smooth,
}

/// Reads a part; `sibling` gives the bytes of a file beside it, which only a `.gltf` asks for.
///
/// The bytes decide between text and binary glTF, whatever `format` says of the two.
///
/// # Errors
/// See [`MeshReadError`].
pub fn read(
    bytes: &[u8],
    format: MeshFormat,
    options: &MeshOptions,
    sibling: &mut dyn FnMut(&str) -> io::Result<Vec<u8>>,
) -> Result<PartReading, MeshReadError> {
    let format = format.of_content(bytes);
    let part = match format {
        MeshFormat::Gltf | MeshFormat::Glb => gltf::read(bytes, format, sibling)?,
        MeshFormat::Obj => obj::read(bytes)?,
    };
    part.into_reading(options)
}

/// Names of the files beside a part that are needed to read it: the `.bin` files of a `.gltf`.
///
/// # Errors
/// See [`MeshReadError`]; buffers that lie outside the part's folder are an error.
pub fn siblings(bytes: &[u8], format: MeshFormat) -> Result<Vec<String>, MeshReadError> {
    match format.of_content(bytes) {
        format @ (MeshFormat::Gltf | MeshFormat::Glb) => gltf::siblings(bytes, format),
        MeshFormat::Obj => Ok(Vec::new()),
    }
}

/// Names of the pictures beside a part that are its textures, as far as it can be read; they are not needed.
pub fn textures(bytes: &[u8], format: MeshFormat) -> Vec<String> {
    match format.of_content(bytes) {
        format @ (MeshFormat::Gltf | MeshFormat::Glb) => gltf::textures(bytes, format),
        MeshFormat::Obj => Vec::new(),
    }
}

impl MeshFormat {
    /// The format that a file name's ending stands for, in capitals or not.
    ///
    /// ```
    /// use isomark::formats::mesh::MeshFormat;
    /// assert_eq!(MeshFormat::from_name("can.GLB"), Some(MeshFormat::Glb));
    /// assert_eq!(MeshFormat::from_name("can.dxf"), None);
    /// ```
    pub fn from_name(file_name: &str) -> Option<Self> {
        let (_, ending) = file_name.rsplit_once('.')?;
        match ending.to_ascii_lowercase().as_str() {
            "gltf" => Some(Self::Gltf),
            "glb" => Some(Self::Glb),
            "obj" => Some(Self::Obj),
            _ => None,
        }
    }

    /// The format the bytes are in, where their beginning leaves no doubt.
    fn of_content(self, bytes: &[u8]) -> Self {
        let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes).trim_ascii_start();
        if bytes.starts_with(b"glTF") {
            Self::Glb
        } else if text.starts_with(b"{") {
            Self::Gltf
        } else {
            self
        }
    }
}

impl NormalsFound {
    fn notice(self) -> Option<Notice> {
        let found = match self {
            Self::None => "the file has no normals",
            Self::FacetsOnly => "the file's normals only repeat the flat facets",
            Self::Smooth => return None,
        };
        let message = format!(
            "{found}, so curvature between vertices is estimated; a GLB from CAD has the exact normals"
        );
        Some(Notice::note("normals-estimated", message))
    }
}

impl fmt::Display for MeshFormat {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Gltf => "glTF",
            Self::Glb => "GLB",
            Self::Obj => "OBJ",
        })
    }
}

/// A part in its file's own unit and axes.
struct RawPart {
    positions: Vec<Point3<f64>>,
    /// One for each position, or none at all.
    normals: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    normals_found: NormalsFound,
    clues: Clues,
    bodies: Vec<String>,
    materials: Vec<String>,
    not_taken: Vec<String>,
    notices: Vec<Notice>,
}

impl RawPart {
    fn new(clues: Clues) -> Self {
        Self {
            positions: Vec::new(),
            normals: Vec::new(),
            triangles: Vec::new(),
            normals_found: NormalsFound::None,
            clues,
            bodies: Vec::new(),
            materials: Vec::new(),
            not_taken: Vec::new(),
            notices: Vec::new(),
        }
    }

    /// Decides unit and axis, and brings the part to mm with +Z up.
    fn into_reading(mut self, options: &MeshOptions) -> Result<PartReading, MeshReadError> {
        let verdict = self.clues.judge(&Corners::of(&self.positions, &self.triangles), options);
        let (scale, up) = (verdict.unit.value.in_mm(), verdict.up.value);
        for position in &mut self.positions {
            *position = Point3::from(up.to_z_up(position.coords) * scale);
        }
        for normal in &mut self.normals {
            *normal = up.to_z_up(*normal);
        }
        let mesh =
            TriMesh::new(self.positions, self.normals, self.triangles).map_err(|error| match error {
                MeshError::BadCoordinate { coordinate, .. } => MeshReadError::TooFar { coordinate },
                _ => MeshReadError::NoTriangles { cause: EmptyCause::Flat },
            })?;
        self.notices.extend(verdict.notices);
        self.notices.extend(self.normals_found.notice());
        let facts = PartFacts {
            format: self.clues.format,
            producer: self.clues.producer,
            unit: verdict.unit,
            up: verdict.up,
            size: mesh.size().into(),
            triangles: mesh.triangles().len(),
            vertices: mesh.positions().len(),
            normals: self.normals_found,
            bodies: self.bodies,
            materials: self.materials,
            not_taken: self.not_taken,
            notices: self.notices,
        };
        Ok(PartReading { mesh, facts })
    }
}

/// Refuses more of something than can be kept.
fn at_most(what: &'static str, count: usize, limit: usize) -> Result<(), MeshReadError> {
    if count > limit {
        return Err(MeshReadError::TooLarge { what, count: count as u64, limit: limit as u64 });
    }
    Ok(())
}
