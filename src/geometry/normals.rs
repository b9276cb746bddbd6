//! Vertex normals for meshes whose file has none that carry curvature.

use nalgebra::{Point3, Vector3};

/// Facets that meet at a larger angle than this, rad, are taken for the two sides of an edge of the part. CAD
/// tessellations turn by up to 28.6° (0.5 rad) from facet to facet of one face; chamfers turn by 45°.
pub const CREASE_ANGLE: f64 = 40.0 * std::f64::consts::PI / 180.0;

/// Positions closer together than this, mm, are one vertex: exporters repeat vertices at face borders, and a float
/// holds a 200 mm part to 0.00002 mm.
const WELD_DISTANCE: f64 = 1e-4;

/// One unit normal for each corner of each triangle, from the facets round the corner's vertex that belong to the same
/// smooth region as the corner's own facet.
///
/// The facets are weighted by sin(angle) / (product of edge lengths), which is exact on spheres: Max, Weights for
/// computing vertex normals from facet normals, Journal of Graphics Tools 4(2), 1999. The regions are separated by
/// [`CREASE_ANGLE`].
pub fn estimate_corner_normals(positions: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<[Vector3<f64>; 3]> {
    let vertices = weld(positions);
    let count = vertices.iter().copied().max().map_or(0, |last| last as usize + 1);
    let facets: Vec<Vector3<f64>> = triangles
        .iter()
        .map(|corners| {
            let [a, b, c] = corners.map(|index| positions[index as usize]);
            (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vector3::zeros)
        })
        .collect();

    let mut starts = vec![0u32; count + 1];
    for &index in triangles.iter().flatten() {
        starts[vertices[index as usize] as usize + 1] += 1;
    }
    for vertex in 0..count {
        starts[vertex + 1] += starts[vertex];
    }
    let mut around = vec![(0u32, Vector3::zeros()); triangles.len() * 3];
    let mut next = starts.clone();
    for (triangle, corners) in triangles.iter().enumerate() {
        for corner in 0..3 {
            let [here, one, two] = [0, 1, 2].map(|turn| positions[corners[(corner + turn) % 3] as usize]);
            let (first, second) = (one - here, two - here);
            let lengths = first.norm_squared() * second.norm_squared();
            let weighted = if lengths > 0.0 { first.cross(&second) / lengths } else { Vector3::zeros() };
            let slot = &mut next[vertices[corners[corner] as usize] as usize];
            around[*slot as usize] = (triangle as u32, weighted);
            *slot += 1;
        }
    }

    let same_region = CREASE_ANGLE.cos();
    let normal_at = |triangle: usize, corner: usize| {
        let vertex = vertices[triangles[triangle][corner] as usize] as usize;
        let facet = facets[triangle];
        let mut sum = Vector3::zeros();
        for &(other, weighted) in &around[starts[vertex] as usize..starts[vertex + 1] as usize] {
            if facets[other as usize].dot(&facet) >= same_region {
                sum += weighted;
            }
        }
        sum.try_normalize(0.0).unwrap_or(facet)
    };
    (0..triangles.len()).map(|triangle| [0, 1, 2].map(|corner| normal_at(triangle, corner))).collect()
}

/// For each position the number of its vertex; positions within a weld cell share one.
fn weld(positions: &[Point3<f64>]) -> Vec<u32> {
    let cell = |position: &Point3<f64>| position.coords.map(|value| (value / WELD_DISTANCE).round() as i64);
    let mut order: Vec<([i64; 3], u32)> =
        positions.iter().enumerate().map(|(index, position)| (cell(position).into(), index as u32)).collect();
    order.sort_unstable();
    let mut vertices = vec![0; positions.len()];
    let mut vertex = 0;
    for at in 0..order.len() {
        if at > 0 && order[at].0 != order[at - 1].0 {
            vertex += 1;
        }
        vertices[order[at].1 as usize] = vertex;
    }
    vertices
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An n-sided prism of radius 1 and height 1, without caps; every facet has vertices of its own.
    fn prism(sides: usize) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let rim = |side: usize, z: f64| {
            let angle = side as f64 / sides as f64 * std::f64::consts::TAU;
            Point3::new(angle.cos(), angle.sin(), z)
        };
        for side in 0..sides {
            let first = positions.len() as u32;
            positions.extend([rim(side, 0.0), rim(side + 1, 0.0), rim(side + 1, 1.0), rim(side, 1.0)]);
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        (positions, triangles)
    }

    #[test]
    fn a_fine_prism_is_a_cylinder_and_a_coarse_one_has_edges() {
        let (positions, triangles) = prism(16);
        for (corners, normals) in triangles.iter().zip(estimate_corner_normals(&positions, &triangles)) {
            for (index, normal) in corners.iter().zip(normals) {
                let radial = positions[*index as usize].coords.xy().normalize();
                // The weights of a quadrangle's two triangles add up alike at all its corners: the normal is exact.
                assert!((normal.xy() - radial).norm() < 1e-12 && normal.z.abs() < 1e-12);
            }
        }
        let (positions, triangles) = prism(6);
        for (corners, normals) in triangles.iter().zip(estimate_corner_normals(&positions, &triangles)) {
            let [a, b, c] = corners.map(|index| positions[index as usize]);
            let facet = (b - a).cross(&(c - a)).normalize();
            assert!(normals.iter().all(|normal| (normal - facet).norm() < 1e-12));
        }
    }

    #[test]
    fn the_normal_of_an_uneven_fan_on_a_sphere_is_exact() {
        let mut positions = vec![Point3::new(0.0, 0.0, 5.0)];
        for (azimuth, polar) in [(0.0, 0.2), (1.1, 0.12), (2.9, 0.25), (3.6, 0.1), (5.0, 0.18)] {
            let (sin, cos) = f64::sin_cos(polar);
            positions.push(Point3::new(sin * f64::cos(azimuth), sin * f64::sin(azimuth), cos) * 5.0);
        }
        let triangles = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [0, 5, 1]];
        for normals in estimate_corner_normals(&positions, &triangles) {
            assert!((normals[0] - Vector3::z()).norm() < 1e-12);
        }
    }
}
