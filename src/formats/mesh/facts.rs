//! What a part file holds, and how it was understood.

use serde::{Deserialize, Serialize};

use super::{Decision, LengthUnit, MeshFormat, ScanFacts, UpAxis};
use crate::geometry::mesh::TriMesh;
use crate::geometry::point_cloud::PointCloud;
use crate::reason::{Notice, Severity};

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
    #[serde(rename = "not_taken")]
    pub skipped: Vec<String>,
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
    pub(super) fn notice(self) -> Option<Notice> {
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
