//! A mesh that knows where it is smooth: one vertex with one normal where facets continue each other, several where
//! they meet at an edge of the part.

mod joining;

use nalgebra::{Point3, Vector3};

/// Facets that meet at a larger angle than this, rad, are taken for the two sides of an edge of the part when the file
/// has no normals. CAD tessellations turn by up to 28.6° (0.5 rad) from facet to facet of one face; chamfers by 45°.
pub const CREASE_ANGLE: f64 = 40.0 * std::f64::consts::PI / 180.0;

/// Normals of the file that differ by more than this, rad, at one place are those of two sides of an edge of the part.
/// Exact normals of one face agree to 0.2°, Blender's merged ones to 1°.
pub const NORMAL_TOLERANCE: f64 = 4.0 * std::f64::consts::PI / 180.0;

/// Triangles over shared vertices, in the frame of a view, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothMesh {
    /// Positions; a place on an edge of the part has one vertex for each smooth side.
    pub positions: Vec<Point3<f64>>,
    /// Unit normals, one for each vertex.
    pub normals: Vec<Vector3<f64>>,
    /// Three vertices each.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle the smooth region it belongs to: those that can be reached without crossing an edge of the
    /// part.
    pub regions: Vec<u32>,
    /// For each side of each triangle (side 3·t + k runs from corner k to the next) the side of the neighbour that continues it;
    /// [`NONE`](super::adjacency::NONE) at a border and at an edge of the part.
    pub(super) continued: Vec<u32>,
    /// For each triangle how far the part may be from the surface that the normals make of it, mm: where they round an edge of
    /// the facets, or contradict one another (`flats`); empty where there is no doubt.
    pub doubts: Vec<f64>,
}

impl SmoothMesh {
    /// The corners of a triangle and their normals.
    pub fn corners(&self, triangle: usize) -> ([Point3<f64>; 3], [Vector3<f64>; 3]) {
        let corners = self.triangles[triangle];
        (
            corners.map(|index| self.positions[index as usize]),
            corners.map(|index| self.normals[index as usize]),
        )
    }
}
