//! Parts: glTF 2, GLB, OBJ, STL and PLY become a [`TriMesh`] in mm with +Z up, scans in PLY or lists of points a
//! [`PointCloud`].
//!
//! No format says reliably in which unit and with which axis up its numbers were meant: glTF has a standard that
//! programs break, the others have none. So the file's word is held against the sizes of products and its producer's habits;
//! [`PartFacts`] says what was decided and why, and [`MeshOptions`] overrides it.
//!
//! STEP is not read here.

use std::collections::BTreeMap;
use std::fmt;

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::Pace;
use crate::geometry::mesh::{MeshError, TriMesh};
use crate::geometry::point_cloud::PointCloud;
use crate::geometry::shading;
use crate::reason::{Notice, Severity};

mod units;
mod error;
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
pub use scan_facts::{ScanFacts, ScanSurface};
pub use units::{Decision, LengthUnit, UnknownWord, UpAxis};

use clues::{Clues, Corners};

/// Most triangles a part may have; a million is already finer than any marking needs.
const MOST_TRIANGLES: usize = 10_000_000;
/// So many triangles are a moment's work, with the fit that follows.
const MOMENT: usize = 200_000;
/// Most points a scan may have; a million is already finer than any marking needs.
const MOST_POINTS: usize = 10_000_000;

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
    /// STL, text or binary.
    Stl,
    /// Polygon file format: a mesh if it has faces, otherwise a scan.
    Ply,
    /// Points as text, a line each: a scan.
    Xyz,
}

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
}

/// What the settings say of a part file; `None` leaves it to the file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MeshOptions {
    /// Unit of the file's numbers.
    pub unit: Option<LengthUnit>,
    /// Axis of the file that points up.
    pub up: Option<UpAxis>,
    /// How long reading and fitting may take.
    pub pace: Pace,
}

/// A part with what its file says about it.
#[derive(Debug, Clone, PartialEq)]
pub struct PartReading {
    /// The part, mm, +Z up.
    pub shape: Shape,
    /// What was found and decided.
    pub facts: PartFacts,
}

/// What a part is made of.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// Triangles.
    Mesh(TriMesh),
    /// Measured points.
    Scan(PointCloud),
}

impl Shape {
    /// The mesh, if it is one.
    pub fn mesh(&self) -> Option<&TriMesh> {
        match self {
            Self::Mesh(mesh) => Some(mesh),
            Self::Scan(_) => None,
        }
    }
}

/// What was found in a part file, and how it was understood.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PartFacts {
    /// The format the bytes were in, whatever the file's name says; absent for a part that the settings give by its
    /// sizes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<MeshFormat>,
    /// The program that wrote the file, in its own words; for OBJ the first comment.
    pub producer: Option<String>,
    /// Unit of the file's numbers.
    pub unit: Decision<LengthUnit>,
    /// Axis of the file that points up.
    pub up: Decision<UpAxis>,
    /// Extents of the part along x, y and z with +Z up, mm.
    #[serde(rename = "size_mm")]
    pub size: [f64; 3],
    /// Number of triangles with an area; 0 in a scan.
    pub triangles: usize,
    /// Number of vertices in the mesh, or of points in the scan.
    pub vertices: usize,
    /// What the file's normals are good for.
    pub normals: NormalsFound,
    /// Names of the bodies, in the file's order; empty where the file has no names.
    pub bodies: Vec<String>,
    /// Names of the materials that faces use, in the order of first use.
    pub materials: Vec<String>,
    /// What the file holds besides and was left aside, such as `2 x camera`.
    pub not_taken: Vec<String>,
    /// What was found in the points of a scan once it was smoothed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scan: Option<ScanFacts>,
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
    /// They average the facets round a vertex, as smooth shading does, where the surface has other ones; they tell the
    /// part's edges and nothing else.
    Averaged,
    /// They follow the surface.
    Smooth,
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
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct NamedFiles {
    /// Those that are needed to read it, the `.bin` files of a `.gltf`, in the order of the file and each once.
    pub buffers: Vec<Buffer>,
    /// The pictures that are its textures, as far as their names are plain; they are not needed.
    pub textures: Vec<String>,
}

/// A file beside a part that is needed to read it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Buffer {
    /// Its plain name.
    pub name: String,
    /// The size that the part says it has at least, bytes.
    pub bytes: u64,
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

/// Endings of parts that other programs read, in lower case.
const UNREAD: [&str; 31] = [
    "step", "stp", "p21", "iges", "igs", "3mf", "amf", "fcstd", "brep", "brp", "blend", "sldprt", "sldasm",
    "ipt", "iam", "prt", "catpart", "x_t", "x_b", "sat", "jt", "3dm", "f3d", "fbx", "dae", "3ds", "skp",
    "wrl", "usd", "usdz", "off",
];

/// Whether a file of this name is a part in a format that is not read, in capitals or not.
///
/// ```
/// use isomark::formats::mesh::is_unread_part;
/// assert!(is_unread_part("can.STEP") && !is_unread_part("can.glb") && !is_unread_part("can.dxf"));
/// ```
pub fn is_unread_part(file_name: &str) -> bool {
    file_name.rsplit_once('.').is_some_and(|(_, ending)| UNREAD.contains(&&*ending.to_ascii_lowercase()))
}

impl MeshFormat {
    /// File name endings of parts, for people.
    pub const ENDINGS: &str = ".glb, .gltf, .obj, .stl, .ply, .xyz or .csv";

    /// Whether half a file is known for what it is; of lines alone, any number looks whole.
    pub fn has_end_mark(self) -> bool {
        !matches!(self, Self::Obj | Self::Xyz)
    }

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
            "stl" => Some(Self::Stl),
            "ply" => Some(Self::Ply),
            "xyz" | "csv" | "txt" | "asc" | "pts" => Some(Self::Xyz),
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

impl PartFacts {
    /// Whether the unit of the file's numbers may be another one: somebody set it, or it is a guess.
    pub fn has_doubtful_unit(&self) -> bool {
        let is_doubt = |notice: &Notice| {
            notice.code == "size-implausible"
                || (notice.code == "unit-assumed" && notice.severity == Severity::Warning)
        };
        self.format.is_some() && (self.unit.is_by_settings() || self.notices.iter().any(is_doubt))
    }
}

impl NormalsFound {
    fn notice(self) -> Option<Notice> {
        let found = match self {
            Self::None => "the file has no normals",
            Self::FacetsOnly => "the file's normals only repeat the flat facets",
            Self::Averaged => {
                "the file's normals are averages of the facets beside them, as smooth shading makes them, and not the surface's"
            }
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
            Self::Stl => "STL",
            Self::Ply => "PLY",
            Self::Xyz => "XYZ",
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
    /// Whether the positions are measured points; there are no triangles then.
    is_scan: bool,
    /// Number of points that the scanner marked as missing.
    missing: usize,
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
            is_scan: false,
            missing: 0,
            bodies: Vec::new(),
            materials: Vec::new(),
            not_taken: Vec::new(),
            notices: Vec::new(),
        }
    }

    /// Makes it a scan of these points, with a normal for each or none at all.
    fn set_scan(&mut self, points: Vec<Point3<f64>>, normals: Vec<Vector3<f64>>) {
        self.is_scan = true;
        self.normals_found = if normals.is_empty() { NormalsFound::None } else { NormalsFound::Smooth };
        (self.positions, self.normals) = (points, normals);
    }

    /// Decides unit and axis, and brings the part to mm with +Z up.
    fn into_reading(mut self, options: &MeshOptions) -> Result<PartReading, MeshReadError> {
        let corners = match self.is_scan {
            true => Corners::of_points(&self.positions),
            false => Corners::of(&self.positions, &self.triangles),
        };
        let verdict = self.clues.judge(&corners, options);
        let (scale, up) = (verdict.unit.value.in_mm(), verdict.up.value);
        for position in &mut self.positions {
            *position = Point3::from(up.to_z_up(position.coords) * scale);
        }
        for normal in &mut self.normals {
            *normal = up.to_z_up(*normal);
        }
        let shape =
            match self.is_scan {
                true => Shape::Scan(PointCloud::new(self.positions, self.normals)),
                false => Shape::Mesh(TriMesh::new(self.positions, self.normals, self.triangles).map_err(
                    |error| match error {
                        MeshError::BadCoordinate { coordinate, .. } => MeshReadError::TooFar { coordinate },
                        _ => MeshReadError::NoTriangles { cause: EmptyCause::Flat },
                    },
                )?),
            };
        let shape = match shape {
            Shape::Mesh(mesh) if shading::only_shade(&mesh) => {
                self.normals_found = NormalsFound::Averaged;
                Shape::Mesh(mesh.with_shading_normals())
            }
            shape => shape,
        };
        let (size, triangles, vertices) = match &shape {
            Shape::Mesh(mesh) => (mesh.size(), mesh.triangles().len(), mesh.positions().len()),
            Shape::Scan(cloud) => (cloud.size(), 0, cloud.points().len()),
        };
        if vertices == 0 {
            return Err(MeshReadError::NoPoints { missing: self.missing });
        }
        self.notices.extend(verdict.notices);
        if !self.is_scan {
            self.notices.extend(self.normals_found.notice());
        }
        let facts = PartFacts {
            format: Some(self.clues.format),
            producer: self.clues.producer,
            unit: verdict.unit,
            up: verdict.up,
            size: size.into(),
            triangles,
            vertices,
            normals: self.normals_found,
            bodies: self.bodies,
            materials: self.materials,
            not_taken: self.not_taken,
            scan: None,
            notices: self.notices,
        };
        Ok(PartReading { shape, facts })
    }
}

/// Refuses more work than the pace allows, where `moment` of it is a moment's.
fn a_moment(pace: Pace, work: usize, moment: usize) -> Result<(), MeshReadError> {
    if pace.allows(work, moment) { Ok(()) } else { Err(MeshReadError::TakesLong) }
}

/// Refuses more of something than can be kept.
fn at_most(what: &'static str, count: usize, limit: usize) -> Result<(), MeshReadError> {
    if count > limit {
        return Err(MeshReadError::TooLarge { what, count: count as u64, limit: limit as u64 });
    }
    Ok(())
}
