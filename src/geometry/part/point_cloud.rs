//! Point clouds from scanners.

use nalgebra::{Point3, Vector3};

use super::mesh::TriMesh;

/// Measured points in the part frame: mm, +Z up; in no order, with noise, outliers and gaps.
#[derive(Debug, Clone, PartialEq)]
pub struct PointCloud {
    points: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
}

impl PointCloud {
    /// A cloud of `points` (mm), with one normal for each (any length) or none at all; if the number of normals
    /// differs, they are ignored. Points that are not finite or beyond [`TriMesh::LARGEST_COORDINATE`] are skipped:
    /// some scanners mark missing points this way.
    pub fn new(mut points: Vec<Point3<f64>>, mut normals: Vec<Vector3<f64>>) -> Self {
        let is_point =
            |point: &Point3<f64>| point.iter().all(|value| value.abs() <= TriMesh::LARGEST_COORDINATE);
        if normals.len() == points.len() {
            let kept: Vec<bool> = points.iter().map(is_point).collect();
            let mut keep = kept.iter();
            normals.retain(|_| keep.next().is_some_and(|keep| *keep));
        } else {
            normals.clear();
        }
        points.retain(is_point);
        Self { points, normals }
    }

    /// The points, mm.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Normals, one for each point, or none at all.
    pub fn normals(&self) -> &[Vector3<f64>] {
        &self.normals
    }

    /// Extents along x, y and z, mm; zero for an empty cloud.
    pub fn size(&self) -> Vector3<f64> {
        let Some(first) = self.points.first() else { return Vector3::zeros() };
        let bounds = |(min, max): (Vector3<f64>, Vector3<f64>), point: &Point3<f64>| {
            (min.inf(&point.coords), max.sup(&point.coords))
        };
        let (min, max) = self.points.iter().fold((first.coords, first.coords), bounds);
        max - min
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placeholders_for_missing_points_are_skipped_with_their_normals() {
        let points = [[0.0, 0.0, 0.0], [f64::NAN, 0.0, 0.0], [1.0, 2.0, 3.0], [0.0, 0.0, 1e30]];
        let normals = [0.0, 1.0, 2.0, 3.0].map(|x| Vector3::new(x, 0.0, 1.0)).to_vec();
        let cloud = PointCloud::new(points.map(Point3::from).to_vec(), normals);
        assert_eq!((cloud.points().len(), cloud.normals()[1].x), (2, 2.0));
        assert_eq!(cloud.size(), Vector3::new(1.0, 2.0, 3.0));
        assert_eq!(PointCloud::new(Vec::new(), Vec::new()).size(), Vector3::zeros());
    }
}
