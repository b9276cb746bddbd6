//! A part in the unit and axes of its file, and the size limits of reading.

use nalgebra::{Point3, Vector3};

use super::clues::{Clues, Corners};
use super::error::EmptyCause;
use super::{MeshOptions, MeshReadError, NormalsFound, PartFacts, PartReading, Shape};
use crate::formats::Pace;
use crate::geometry::mesh::{MeshError, TriMesh};
use crate::geometry::point_cloud::PointCloud;
use crate::geometry::shading;
use crate::geometry::winding::{self, Winding};
use crate::reason::Notice;

/// Largest number of triangles of a part; a million is already finer than any marking needs.
pub(super) const MAX_TRIANGLES: usize = 10_000_000;
/// Largest number of triangles at a quick pace, with the fit that follows.
pub(super) const QUICK_TRIANGLES: usize = 200_000;
/// Largest number of points of a scan; a million is already finer than any marking needs.
pub(super) const MAX_POINTS: usize = 10_000_000;

/// A part in the unit and axes of its file.
pub(super) struct RawPart {
    pub(super) positions: Vec<Point3<f64>>,
    /// One for each position, or empty.
    pub(super) normals: Vec<Vector3<f64>>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) normals_found: NormalsFound,
    pub(super) clues: Clues,
    /// Whether the positions are measured points; there are no triangles then.
    pub(super) is_scan: bool,
    /// Number of points that the scanner marked as missing.
    pub(super) missing: usize,
    pub(super) bodies: Vec<String>,
    pub(super) materials: Vec<String>,
    pub(super) skipped: Vec<String>,
    pub(super) notices: Vec<Notice>,
}

impl RawPart {
    pub(super) fn new(clues: Clues) -> Self {
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
            skipped: Vec::new(),
            notices: Vec::new(),
        }
    }

    /// Makes it a scan of these points, with one normal for each or no normals.
    pub(super) fn set_scan(&mut self, points: Vec<Point3<f64>>, normals: Vec<Vector3<f64>>) {
        self.is_scan = true;
        self.normals_found = if normals.is_empty() { NormalsFound::None } else { NormalsFound::Smooth };
        (self.positions, self.normals) = (points, normals);
    }

    /// Decides the unit and the up axis, and converts the part to mm with +Z up.
    pub(super) fn into_reading(mut self, options: &MeshOptions) -> Result<PartReading, MeshReadError> {
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
        let (shape, winding) = match self.is_scan {
            true => (Shape::Scan(PointCloud::new(self.positions, self.normals)), Winding::default()),
            false => {
                let mesh = TriMesh::new(self.positions, self.normals, self.triangles);
                let (mesh, winding) = winding::made_alike(mesh.map_err(|error| match error {
                    MeshError::BadCoordinate { coordinate, .. } => MeshReadError::TooFar { coordinate },
                    _ => MeshReadError::NoTriangles { cause: EmptyCause::Flat },
                })?);
                (Shape::Mesh(mesh), winding)
            }
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
        self.notices.extend(winding_notices(&winding, triangles));
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
            skipped: self.skipped,
            scan: None,
            notices: self.notices,
        };
        Ok(PartReading { shape, facts })
    }
}

fn winding_notices(winding: &Winding, triangles: usize) -> impl Iterator<Item = Notice> {
    let reversed = (winding.reversed > 0).then(|| {
        let message = format!(
            "{} of {triangles} triangles were reversed because their corners ran the other way round than those of \
             their neighbours; the file has no normals that show the outside",
            winding.reversed
        );
        Notice::note("winding-made-alike", message)
    });
    let contradiction = winding.contradiction.map(|at| {
        let message = format!(
            "the part has only one side, like a Möbius strip: its triangles cannot all have the same orientation, so \
             the surface is unknown near ({:.2}, {:.2}, {:.2}) mm of the part; repair the mesh, or keep the drawing \
             away from there",
            at.x, at.y, at.z
        );
        Notice::warning("winding-contradicts", message)
    });
    reversed.into_iter().chain(contradiction)
}

/// Refuses more work than the pace allows; a quick pace allows at most `quick_limit`.
pub(super) fn check_pace(pace: Pace, work: usize, quick_limit: usize) -> Result<(), MeshReadError> {
    if pace.allows(work, quick_limit) { Ok(()) } else { Err(MeshReadError::TakesLong) }
}

/// Refuses a number of something above its limit.
pub(super) fn at_most(what: &'static str, count: usize, limit: usize) -> Result<(), MeshReadError> {
    if count > limit {
        return Err(MeshReadError::TooLarge { what, count: count as u64, limit: limit as u64 });
    }
    Ok(())
}
