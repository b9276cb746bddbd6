//! What a part file contains, and how it was interpreted.

use nalgebra::{Point3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::{Decision, LengthUnit, MeshFormat, ScanFacts, UpAxis};
use crate::geometry::mesh::TriMesh;
use crate::geometry::noise::Noise;
use crate::geometry::point_cloud::PointCloud;
use crate::geometry::shading::Judgement;
use crate::geometry::sides::{SIDES, Side};
use crate::geometry::solid::Solid;
use crate::geometry::solid::round::RoundForm;
use crate::geometry::space::{Extents, MarkingFrame};
use crate::reason::{Notice, Severity};

/// A part with the facts about its file.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct PartReading {
    /// The part, mm, +Z up.
    pub shape: Shape,
    /// The faces named `mark`, on which ink may be, in the part frame, mm; without them ink may be anywhere.
    pub mark_faces: Vec<[Point3<f64>; 3]>,
    /// What was found in the file, and what was decided.
    pub facts: PartFacts,
}

/// What a part is made of.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Shape {
    /// Triangles.
    Mesh(TriMesh),
    /// Measured points.
    Scan(PointCloud),
    /// Exact faces.
    Solid(Box<SolidPart>),
}

/// A part with exact faces, and triangles over them for everything that needs a mesh. What is marked is measured on the faces.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SolidPart {
    /// The faces, mm, +Z up.
    pub solid: Solid,
    /// Triangles over them, with exact normals.
    pub mesh: TriMesh,
}

impl Shape {
    /// The mesh, unless it is a scan.
    #[must_use]
    pub fn mesh(&self) -> Option<&TriMesh> {
        match self {
            Self::Mesh(mesh) => Some(mesh),
            Self::Solid(part) => Some(&part.mesh),
            Self::Scan(_) => None,
        }
    }
}

/// What was found in a part file, and how it was interpreted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct PartFacts {
    /// The format of the bytes, which may differ from the file name's ending; absent for a primitive from the settings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<MeshFormat>,
    /// The program that wrote the file, as the file names it; for OBJ the first comment.
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
    /// The quality of the file's normals.
    pub normals: NormalsFound,
    /// What the surface between the vertices follows; absent for a scan and for a part that is given by its sizes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normals_used: Option<NormalsUsed>,
    /// Number of vertices without a normal in the file, if the normals of the others are used.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub normals_missing: usize,
    /// Where a mesh has only one side, as a Möbius strip, in the part frame, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub one_sided_at_mm: Option<[f64; 3]>,
    /// The scatter of a mesh's vertices, where it misleads the normals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<MeshNoise>,
    /// The scatter of a mesh's vertices, where it is seen and too small to mislead the normals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scatter: Option<MeshNoise>,
    /// How far the file's normals, where they are used, lean from those of a smooth surface through the vertices, root mean
    /// square, deg; absent where they fit one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normals_lean_deg: Option<f64>,
    /// The marking frame, from a node `isomark` in a glTF file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<FrameFacts>,
    /// Area of the faces named `mark`, mm²: ink may be only there; absent without such faces.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mark_area_mm2: Option<f64>,
    /// The sides along the axes of a mesh; empty for a scan.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sides: Vec<SideFacts>,
    /// The faces of a STEP file by the kind of their surface; empty for other formats.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faces: Vec<FaceKind>,
    /// The cylinders and cones of a STEP file, or on which the points of a scan are, in the frame of the view that its surface was learned
    /// for; known after learning.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub round_faces: Vec<RoundFacts>,
    /// Names of the bodies, in the file's order; empty if the file has no names.
    pub bodies: Vec<String>,
    /// Names of the materials that faces use, in the order of first use.
    pub materials: Vec<String>,
    /// Other content of the file, which was skipped, such as `2 x camera`.
    #[serde(rename = "not_taken")]
    pub skipped: Vec<String>,
    /// What was found in the points of a scan, known after smoothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scan: Option<ScanFacts>,
    /// The notices for people about this file and how it was read.
    pub notices: Vec<Notice>,
}

/// How many faces of a STEP file have a kind of surface.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct FaceKind {
    /// The kind, such as `cylinder`.
    pub kind: String,
    /// Number of faces.
    pub count: usize,
}

/// A cylinder or cone of a STEP file, or on which the points of a scan are, in the frame of the view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct RoundFacts {
    /// A point of the axis of a cylinder, or the apex of a cone, mm.
    pub point_mm: [f64; 3],
    /// Unit direction of the axis; of a cone from the apex into it.
    pub axis: [f64; 3],
    /// Radius of a cylinder, mm; absent for a cone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
    /// Angle between axis and side of a cone, deg; absent for a cylinder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub half_angle_deg: Option<f64>,
}

impl From<RoundForm> for RoundFacts {
    fn from(form: RoundForm) -> Self {
        match form {
            RoundForm::Cylinder { center, axis, radius } => Self {
                point_mm: center.coords.into(),
                axis: axis.into_inner().into(),
                radius_mm: Some(radius),
                half_angle_deg: None,
            },
            RoundForm::Cone { apex, axis, half_angle } => Self {
                point_mm: apex.coords.into(),
                axis: axis.into_inner().into(),
                radius_mm: None,
                half_angle_deg: Some(half_angle.to_degrees()),
            },
        }
    }
}

impl RoundFacts {
    fn form(&self) -> Option<RoundForm> {
        let axis = Unit::try_new(Vector3::from(self.axis), 1e-9)?;
        let point = Point3::from(self.point_mm);
        match (self.radius_mm, self.half_angle_deg) {
            (Some(radius), _) => Some(RoundForm::Cylinder { center: point, axis, radius }),
            (None, Some(angle)) => {
                Some(RoundForm::Cone { apex: point, axis, half_angle: angle.to_radians() })
            }
            (None, None) => None,
        }
    }
}

/// A side of a part, as the laser sees it with `facing` of this name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SideFacts {
    /// Its name, as in `facing`: `+z`, `-z`, `+x`, `-x`, `+y`, `-y`.
    pub side: String,
    /// Area of the surface that the laser sees at an incidence of at most 60 degrees, mm².
    pub area_mm2: f64,
    /// Whether this surface is curved; false for one plane with small fillets.
    pub curved: bool,
    /// Whether this is probably the side to be marked; several sides can be equally likely.
    pub meant: bool,
    /// The bounding rectangle of the part in the view: left, bottom, right, top, mm.
    pub extents_mm: [f64; 4],
    /// The largest rectangle along the axes of the view in which a drawing fits: left, bottom, right, top, mm; absent if
    /// nothing can be marked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rectangle_mm: Option<[f64; 4]>,
    /// The middle of that rectangle, for `place`, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place_mm: Option<[f64; 2]>,
}

/// A marking frame, in the part frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct FrameFacts {
    /// Where the drawing's anchor is placed, mm.
    pub origin_mm: [f64; 3],
    /// Unit direction to the laser.
    pub z: [f64; 3],
    /// Unit direction of the drawing's x.
    pub x: [f64; 3],
}

/// The quality of a file's normals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum NormalsFound {
    /// The file has none.
    None,
    /// They are the normals of the flat triangles and do not describe a curved surface. The mesh is returned without
    /// them, with welded vertices.
    FacetsOnly,
    /// They are averages of the facets around a vertex, as for smooth shading, and differ from the normals of the
    /// surface. They only show where the part has edges.
    Averaged,
    /// They follow the surface.
    Smooth,
}

/// What the surface between the vertices of a mesh follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub enum NormalsUsed {
    /// The file's normals.
    File,
    /// Normals that are estimated from the facets.
    Estimated,
    /// The file's normals, and estimated ones where it has none.
    Mixed,
    /// The flat facets themselves.
    Facets,
    /// None: the vertices are smoothed as the points of a scan.
    Smoothed,
}

/// The scatter of a mesh's vertices.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct MeshNoise {
    /// Standard deviation of the vertices from a smooth surface, mm.
    pub noise_mm: f64,
    /// Mean distance between neighbouring vertices, mm.
    pub spacing_mm: f64,
    /// About how far the normals of such vertices lean from those of the surface, deg.
    pub normals_off_deg: f64,
}

/// The files beside a part that it refers to.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct NamedFiles {
    /// The files that are needed to read the part: the `.bin` files of a `.gltf`, in the file's order, each once.
    pub buffers: Vec<Buffer>,
    /// The texture images with plain file names; they are not needed to read the part.
    pub textures: Vec<String>,
}

/// A file beside a part that is needed to read it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Buffer {
    /// Its file name, without a path.
    pub name: String,
    /// The smallest size that the part requires, bytes.
    pub bytes: u64,
}

impl SideFacts {
    /// The facts about the sides of a mesh, as [`Side::all`] returns them.
    #[must_use]
    pub fn of_all(sides: &[Side]) -> Vec<Self> {
        let named = SIDES.iter().zip(sides).zip(Side::meant(sides));
        named.map(|(((name, _), side), meant)| Self { meant, ..Self::of((*name).to_owned(), side) }).collect()
    }

    /// The facts about one side, which `name` gives as `facing` does.
    #[must_use]
    pub fn of(name: String, side: &Side) -> Self {
        let corners = |extents: &Extents| [extents.min.x, extents.min.y, extents.max.x, extents.max.y];
        Self {
            side: name,
            area_mm2: side.area,
            curved: side.is_curved,
            meant: false,
            extents_mm: corners(&side.extents),
            rectangle_mm: side.rectangle.as_ref().map(corners),
            place_mm: side.rectangle.as_ref().map(|rectangle| rectangle.center().into()),
        }
    }
}

impl From<MarkingFrame> for FrameFacts {
    fn from(frame: MarkingFrame) -> Self {
        Self { origin_mm: frame.origin().coords.into(), z: frame.z().into(), x: frame.x().into() }
    }
}

impl PartFacts {
    /// The marking frame of the file.
    #[must_use]
    pub fn marking_frame(&self) -> Option<MarkingFrame> {
        let FrameFacts { origin_mm, z, x } = self.frame?;
        MarkingFrame::new(origin_mm.into(), z.into(), x.into())
    }

    /// The cylinders and cones of a STEP file, or on which the points of a scan are, in the frame of the view that its surface was learned
    /// for.
    #[must_use]
    pub fn known_forms(&self) -> Vec<RoundForm> {
        self.round_faces.iter().filter_map(RoundFacts::form).collect()
    }

    /// Whether the unit of the file's numbers may be wrong: it comes from the settings, or it is a guess.
    #[must_use]
    pub fn has_doubtful_unit(&self) -> bool {
        let is_doubt = |notice: &Notice| {
            notice.code == "size-implausible"
                || (notice.code == "unit-assumed" && notice.severity == Severity::Warning)
        };
        self.format.is_some() && (self.unit.is_by_settings() || self.notices.iter().any(is_doubt))
    }
}

impl MeshNoise {
    pub(super) fn new(noise: &Noise) -> Self {
        let normals_off_deg = (noise.deviation / noise.spacing).atan().to_degrees();
        Self { noise_mm: noise.deviation, spacing_mm: noise.spacing, normals_off_deg }
    }

    pub(super) fn notice(&self, used: NormalsUsed) -> Notice {
        let Self { noise_mm, spacing_mm, normals_off_deg } = self;
        let consequence = match used {
            NormalsUsed::Smoothed => {
                "so its vertices are smoothed as the points of a scan, where they are dense enough, and sharp edges are rounded; \
                 `normals = \"estimate\"` follows every vertex"
            }
            NormalsUsed::Facets | NormalsUsed::File | NormalsUsed::Estimated | NormalsUsed::Mixed => {
                "and lengths can be as wrong as that; `normals = \"auto\"` smooths the part as a scan"
            }
        };
        let message = format!(
            "the mesh is noisy: its vertices, {spacing_mm:.2} mm apart, scatter by {noise_mm:.4} mm about a smooth surface, \
             which turns normals by about {normals_off_deg:.1} deg, {consequence}"
        );
        Notice::warning("mesh-noisy", message)
    }
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

impl NormalsFound {
    /// Reports that the curvature is estimated, and why. `spoilt` of the file's normals are averages of
    /// triangles that run in opposite ways.
    pub(super) fn notice(self, judged: &Judgement, spoilt: usize) -> Option<Notice> {
        let found = match self {
            Self::None if spoilt > 0 => {
                "the file's normals are averages of triangles that run in opposite ways".to_owned()
            }
            Self::None => "the file has no normals".to_owned(),
            Self::FacetsOnly => "the file's normals only repeat the flat facets".to_owned(),
            Self::Averaged => format!(
                "the file's normals are averages for smooth shading, not the normals of the surface (of {} normals between facets \
                 that are not in one plane, {} are averages of these facets)",
                judged.of, judged.averages
            ),
            Self::Smooth => return None,
        };
        let message = format!(
            "{found}, so the curvature between vertices is estimated; a STEP file has the exact surfaces, and a GLB from CAD the exact normals"
        );
        Some(Notice::note("normals-estimated", message))
    }
}
