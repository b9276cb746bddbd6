//! Triangle meshes, checked on construction.

use nalgebra::{Point3, Vector3};

/// A triangle mesh in the part frame: mm, +Z up as the designer modelled it, counter-clockwise seen from outside.
///
/// Vertices may be repeated (CAD exports split them at face borders). If the file has normals, there is one for each
/// vertex; whether they describe the curvature or only repeat the facets is decided when the surface is sampled.
#[derive(Debug, Clone, PartialEq)]
pub struct TriMesh {
    positions: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    meaning: Meaning,
    open_turns: Vec<f32>,
}

/// What the normals of a mesh, or the lack of them, stand for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Meaning {
    /// The surface that the mesh samples.
    Surface,
    /// The same, exactly: where two normals at one place differ, there is an edge.
    ExactSurface,
    /// Its edges only.
    Shading,
    /// Nothing: the part is its facets.
    Facets,
}

/// Why a set of triangles is not a valid mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// No triangle has an area above zero.
    #[error("the part has no triangle with an area above zero")]
    Empty,
    /// A coordinate is not finite or beyond [`TriMesh::LARGEST_COORDINATE`].
    #[error("vertex {vertex} has invalid coordinates ({}, {}, {})", coordinate[0], coordinate[1], coordinate[2])]
    BadCoordinate {
        /// Index of the vertex, from 0.
        vertex: usize,
        /// The coordinates as read, converted to mm.
        coordinate: [f64; 3],
    },
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} refers to vertex {vertex}, but the number of vertices is {vertices}")]
    BadIndex {
        /// Index of the triangle, from 0.
        triangle: usize,
        /// The vertex index it refers to.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// The number of normals is neither zero nor the number of vertices.
    #[error("{normals} normals for {vertices} vertices")]
    NormalCount {
        /// Number of normals.
        normals: usize,
        /// Number of vertices.
        vertices: usize,
    },
}

impl TriMesh {
    /// Larger coordinates are rejected as damaged, mm: no product on a marking table is larger than 100 m.
    pub const LARGEST_COORDINATE: f64 = 1e5;

    /// A mesh of `positions` (mm), one normal for each position (any length; empty when the file has none) and
    /// `triangles` (three indices each). Triangles with an area of zero are skipped.
    ///
    /// # Errors
    /// See [`MeshError`].
    pub fn new(
        positions: Vec<Point3<f64>>,
        mut normals: Vec<Vector3<f64>>,
        mut triangles: Vec<[u32; 3]>,
    ) -> Result<Self, MeshError> {
        for (vertex, position) in positions.iter().enumerate() {
            if !position.iter().all(|value| value.abs() <= Self::LARGEST_COORDINATE) {
                return Err(MeshError::BadCoordinate { vertex, coordinate: position.coords.into() });
            }
        }
        if !normals.is_empty() && normals.len() != positions.len() {
            return Err(MeshError::NormalCount { normals: normals.len(), vertices: positions.len() });
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&index| index as usize >= positions.len()) {
                return Err(MeshError::BadIndex { triangle, vertex, vertices: positions.len() });
            }
        }
        for normal in &mut normals {
            let length = normal.norm();
            // A normal without a direction becomes zero, which means missing; the sampler then estimates it.
            *normal = if length.is_finite() && length > 1e-12 { *normal / length } else { Vector3::zeros() };
        }
        triangles.retain(|corners| {
            let [a, b, c] = corners.map(|index| positions[index as usize]);
            (b - a).cross(&(c - a)).norm() > 0.0
        });
        if triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        Ok(Self { positions, normals, triangles, meaning: Meaning::Surface, open_turns: Vec::new() })
    }

    /// Vertex positions, mm.
    pub fn positions(&self) -> &[Point3<f64>] {
        &self.positions
    }

    /// Unit normals, one for each vertex (zero where the file's normal has no direction); empty if the file has none.
    pub fn normals(&self) -> &[Vector3<f64>] {
        &self.normals
    }

    /// The same mesh, with its normals marked as shading normals: averages of facets from smooth shading, which show
    /// the edges of the part but not its curvature.
    pub fn with_shading_normals(self) -> Self {
        Self { meaning: Meaning::Shading, ..self }
    }

    /// The same mesh, with its normals marked as normals of the exact faces of the part: where they differ,
    /// there is an edge.
    pub fn with_exact_normals(self) -> Self {
        Self { meaning: Meaning::ExactSurface, ..self }
    }

    /// See [`with_exact_normals`](Self::with_exact_normals).
    pub fn has_exact_normals(&self) -> bool {
        self.meaning == Meaning::ExactSurface
    }

    /// The same mesh with the winding of some of its triangles reversed; one flag for each triangle.
    pub(super) fn with_reversed(mut self, is_reversed: &[bool]) -> Self {
        let chosen = self.triangles.iter_mut().zip(is_reversed).filter(|(_, reversed)| **reversed);
        chosen.for_each(|(corners, _)| corners.swap(1, 2));
        self
    }

    /// Whether the normals show only the edges of the part, not its curvature.
    pub fn normals_only_shade(&self) -> bool {
        self.meaning == Meaning::Shading
    }

    /// The same mesh, with some facets that may belong to a round face although their normals are flat. For
    /// each triangle: the angle by which its facet turns to the next ones, rad; 0 if the triangle is
    /// certainly flat.
    pub fn with_open_turns(self, open_turns: Vec<f32>) -> Self {
        Self { open_turns, ..self }
    }

    /// See [`with_open_turns`](Self::with_open_turns); empty if nothing is in doubt.
    pub(super) fn open_turns(&self) -> &[f32] {
        &self.open_turns
    }

    /// The same mesh as a part that is exactly its flat facets.
    pub fn with_flat_facets(self) -> Self {
        Self { meaning: Meaning::Facets, normals: Vec::new(), open_turns: Vec::new(), ..self }
    }

    /// Whether the part is exactly its facets.
    pub fn is_facetted(&self) -> bool {
        self.meaning == Meaning::Facets
    }

    /// The same mesh with nothing known of its normals.
    pub fn without_normals(self) -> Self {
        Self { meaning: Meaning::Surface, normals: Vec::new(), open_turns: Vec::new(), ..self }
    }

    /// The same mesh with nothing known of the normals of the `chosen` vertices, one flag for each.
    pub fn without_normals_at(mut self, chosen: &[bool]) -> Self {
        let normals = self.normals.iter_mut().zip(chosen).filter(|(_, chosen)| **chosen);
        normals.for_each(|(normal, _)| *normal = Vector3::zeros());
        self
    }

    /// The same mesh with other normals; `changed` returns that of a vertex for the one that it has.
    pub(super) fn with_changed_normals(
        mut self,
        changed: impl Fn(usize, Vector3<f64>) -> Vector3<f64>,
    ) -> Self {
        let normals = self.normals.iter_mut().enumerate();
        normals.for_each(|(vertex, normal)| *normal = changed(vertex, *normal));
        self
    }

    /// The same mesh with its vertices at other places; `moved` returns that of a vertex for the one that it has, mm.
    pub(super) fn with_moved(mut self, moved: impl Fn(usize, Point3<f64>) -> Point3<f64>) -> Self {
        let positions = self.positions.iter_mut().enumerate();
        positions.for_each(|(vertex, position)| *position = moved(vertex, *position));
        self
    }

    /// The mesh with only the triangles for which `is_kept` is true.
    pub(super) fn with_only(&self, is_kept: &[bool]) -> Self {
        let kept = self.triangles.iter().zip(is_kept).filter(|(_, is_kept)| **is_kept);
        let turns = self.open_turns.iter().zip(is_kept).filter(|(_, is_kept)| **is_kept);
        Self {
            triangles: kept.map(|(corners, _)| *corners).collect(),
            open_turns: turns.map(|(turn, _)| *turn).collect(),
            ..self.clone()
        }
    }

    /// The same mesh with more triangles over its vertices.
    pub(super) fn with_added(mut self, triangles: &[[u32; 3]]) -> Self {
        self.triangles.extend(triangles);
        self
    }

    /// A unit normal for each vertex: that of the facets round it, each as large as it is; zero without facets.
    pub fn facet_normals(&self) -> Vec<Vector3<f64>> {
        let mut sums = vec![Vector3::zeros(); self.positions.len()];
        for &triangle in &self.triangles {
            let [a, b, c] = self.corners(triangle);
            let across = (b - a).cross(&(c - a));
            triangle.iter().for_each(|&vertex| sums[vertex as usize] += across);
        }
        sums.iter().map(|sum| sum.try_normalize(0.0).unwrap_or_else(Vector3::zeros)).collect()
    }

    /// Triangles, three vertex indices each.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The corners of a triangle, mm.
    pub fn corners(&self, triangle: [u32; 3]) -> [Point3<f64>; 3] {
        triangle.map(|index| self.positions[index as usize])
    }

    /// Smallest and largest coordinates over the triangles, mm.
    pub fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let mut min = Point3::from(Vector3::repeat(f64::INFINITY));
        let mut max = Point3::from(Vector3::repeat(f64::NEG_INFINITY));
        for &index in self.triangles.iter().flatten() {
            let position = self.positions[index as usize];
            min = min.inf(&position);
            max = max.sup(&position);
        }
        (min, max)
    }

    /// Extents along x, y and z, mm.
    pub fn size(&self) -> Vector3<f64> {
        let (min, max) = self.bounds();
        max - min
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(third: [f64; 3]) -> Result<TriMesh, MeshError> {
        TriMesh::new(
            vec![Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::from(third)],
            Vec::new(),
            vec![[0, 1, 2]],
        )
    }

    #[test]
    fn invalid_meshes_are_rejected_with_the_index_at_fault() {
        assert!(matches!(triangle([0.0, f64::NAN, 0.0]), Err(MeshError::BadCoordinate { vertex: 2, .. })));
        assert!(matches!(triangle([0.0, 1e6, 0.0]), Err(MeshError::BadCoordinate { vertex: 2, .. })));
        assert_eq!(triangle([2.0, 0.0, 0.0]), Err(MeshError::Empty));
        let outside = TriMesh::new(vec![Point3::origin()], Vec::new(), vec![[0, 0, 7]]);
        assert_eq!(outside, Err(MeshError::BadIndex { triangle: 0, vertex: 7, vertices: 1 }));
    }

    #[test]
    fn the_size_ignores_vertices_without_triangles() {
        let positions = vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 1.0], [90.0, 90.0, 90.0]]
            .into_iter()
            .map(Point3::from);
        let mesh = TriMesh::new(positions.collect(), Vec::new(), vec![[0, 1, 2]]).unwrap();
        assert_eq!(mesh.size(), Vector3::new(2.0, 3.0, 1.0));
    }
}
