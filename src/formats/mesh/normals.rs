//! Whether a file's normals describe curvature, and welding of vertices by position.

use nalgebra::{Point3, Vector3};

use crate::geometry::polygons;

/// A normal within this angle of the facet normal is treated as equal to it, rad (1.2°). Blender merges normals that
/// are less than 1° apart.
const SAME_NORMAL: f64 = 0.021;
/// Facets that meet at a larger angle than this form an edge of the design, rad (40°).
const EDGE_OF_DESIGN: f64 = 0.70;
/// Share of triangles whose normals may differ from the facet: slivers have no well-defined plane.
const SLIVERS: f64 = 0.01;
/// Smallest share of positions between facets at small angles; below it the part has no curvature to lose.
const BENT: f64 = 0.05;
/// Sides of the design that are distinguished at one position, as at the corner of a box.
const SIDES: usize = 3;

/// Positions, and triangles as indices into them.
pub(super) type IndexedTriangles = (Vec<Point3<f64>>, Vec<[u32; 3]>);

/// The mesh welded by position if its normals are only the facet normals, otherwise `None`.
///
/// Such normals are perpendicular to the plane of each triangle, or to the polygon that it was cut from, whichever way round it runs,
/// and differ between neighbouring facets of a curved surface. `normal(triangle, corner)` returns the file's normal. Curved surfaces with
/// facets so small that both cases agree within 1.2° keep their normals.
pub(super) fn weld_facets(
    positions: &[Point3<f64>],
    triangles: &[[u32; 3]],
    normal: impl Fn(usize, usize) -> Vector3<f64>,
) -> Option<IndexedTriangles> {
    let slivers = (triangles.len() as f64 * SLIVERS) as usize;
    let is_own = |(triangle, corners): (usize, &[u32; 3])| {
        let [a, b, c] = corners.map(|index| positions[index as usize]);
        let facet = (b - a).cross(&(c - a));
        let facet = if facet.dot(&normal(triangle, 0)) < 0.0 { -facet } else { facet };
        (0..3).all(|corner| is_within(SAME_NORMAL, facet, normal(triangle, corner)))
    };
    let mut is_flat: Vec<bool> = triangles.iter().enumerate().map(is_own).collect();
    let others = |is_flat: &[bool]| is_flat.iter().filter(|is_flat| !**is_flat).count();
    if others(&is_flat) > slivers {
        let unit = |normal: Vector3<f64>| normal.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let normals = |triangle: usize| [0, 1, 2].map(|corner| unit(normal(triangle, corner)));
        polygons::add_bent(&mut is_flat, positions, triangles, normals);
        if others(&is_flat) > slivers {
            return None;
        }
    }
    let (welded, welded_triangles) = weld(positions, triangles);
    // Where an edge of the design runs along the curved surface, facets on both sides of it meet at one position.
    let mut known = vec![[Vector3::zeros(); SIDES]; welded.len()];
    let mut is_bent = vec![false; welded.len()];
    for (triangle, corners) in welded_triangles.iter().enumerate() {
        for (corner, &position) in corners.iter().enumerate() {
            let here = normal(triangle, corner);
            let known = &mut known[position as usize];
            let beside = known.iter().find(|other| is_within(EDGE_OF_DESIGN, **other, here));
            match beside {
                Some(other) => is_bent[position as usize] |= !is_within(SAME_NORMAL, *other, here),
                None => {
                    if let Some(free) = known.iter_mut().find(|other| **other == Vector3::zeros()) {
                        *free = here;
                    }
                }
            }
        }
    }
    let bent = is_bent.iter().filter(|bent| **bent).count();
    (bent as f64 >= BENT * welded.len() as f64).then_some((welded, welded_triangles))
}

/// Whether two directions of any length differ by at most `angle` rad, which must be less than a right angle.
fn is_within(angle: f64, a: Vector3<f64>, b: Vector3<f64>) -> bool {
    let cosine = a.dot(&b);
    cosine > 0.0 && a.cross(&b).norm_squared() <= (angle.tan() * cosine).powi(2)
}

/// Merges vertices at exactly the same position; vertices and triangles keep their order.
pub(super) fn weld(positions: &[Point3<f64>], triangles: &[[u32; 3]]) -> IndexedTriangles {
    const FREE: u32 = u32::MAX;
    // Open addressing with a load of at most one half; a std map would not keep the order of first appearance.
    let places = (positions.len() * 2).next_power_of_two().max(2);
    let mut table = vec![FREE; places];
    let mut welded: Vec<Point3<f64>> = Vec::new();
    let mut new_index = vec![FREE; positions.len()];
    let mut index_of = |old: u32| {
        if new_index[old as usize] != FREE {
            return new_index[old as usize];
        }
        // Adding zero turns -0 into 0, which is the same position.
        let position = positions[old as usize].map(|coordinate| coordinate + 0.0);
        let mut place = hash(position) & (places - 1);
        let index = loop {
            match table[place] {
                FREE => {
                    table[place] = welded.len() as u32;
                    welded.push(position);
                    break table[place];
                }
                taken if welded[taken as usize] == position => break taken,
                _ => place = (place + 1) & (places - 1),
            }
        };
        new_index[old as usize] = index;
        index
    };
    let triangles = triangles.iter().map(|corners| corners.map(&mut index_of)).collect();
    (welded, triangles)
}

fn hash(position: Point3<f64>) -> usize {
    let mixed = position.iter().fold(0u64, |sum, coordinate| {
        (sum.rotate_left(23) ^ coordinate.to_bits()).wrapping_mul(0x9E37_79B9_7F4A_7C15)
    });
    (mixed >> 20) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ridge() -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let points = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [1.0, 0.0, 0.0],
            [1.0, 1.0, 1.0],
            [-0.0, 1.0, 0.0],
        ];
        (points.map(Point3::from).to_vec(), vec![[0, 1, 2], [3, 4, 5]])
    }

    fn facet(positions: &[Point3<f64>], corners: [u32; 3]) -> Vector3<f64> {
        let [a, b, c] = corners.map(|index| positions[index as usize]);
        (b - a).cross(&(c - a)).normalize()
    }

    /// A quarter of a cylinder in strips of `step` rad; triangles share no vertices.
    fn strips(step: f64) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let point = |at: usize, z| Point3::new((step * at as f64).cos(), (step * at as f64).sin(), z);
        let strips = (std::f64::consts::FRAC_PI_2 / step) as usize;
        let corners = |at| {
            let [a, b, c, d] = [point(at, 0.0), point(at + 1, 0.0), point(at + 1, 1.0), point(at, 1.0)];
            [a, b, c, a, c, d]
        };
        let positions: Vec<Point3<f64>> = (0..strips).flat_map(corners).collect();
        let triangles = (0..positions.len() as u32 / 3).map(|at| [3 * at, 3 * at + 1, 3 * at + 2]).collect();
        (positions, triangles)
    }

    #[test]
    fn facet_normals_are_distinguished_from_surface_normals() {
        let (positions, triangles) = strips(0.2);
        let flat = |triangle: usize, _| facet(&positions, triangles[triangle]);
        let (welded, _) = weld_facets(&positions, &triangles, flat).unwrap();
        assert_eq!(welded.len(), 2 * (triangles.len() / 2 + 1));
        let exact = |triangle: usize, corner: usize| {
            let position = positions[triangles[triangle][corner] as usize];
            Vector3::new(position.x, position.y, 0.0)
        };
        assert_eq!(weld_facets(&positions, &triangles, exact), None);
        assert_eq!(weld_facets(&positions, &triangles, |_, _| Vector3::zeros()), None);
    }

    #[test]
    fn normals_of_small_facets_and_of_sharp_edges_are_kept() {
        let (positions, triangles) = strips(0.01);
        let exact = |triangle: usize, corner: usize| {
            let position = positions[triangles[triangle][corner] as usize];
            Vector3::new(position.x, position.y, 0.0)
        };
        assert_eq!(weld_facets(&positions, &triangles, exact), None);
        let (positions, triangles) = strips(0.75);
        let flat = |triangle: usize, _| facet(&positions, triangles[triangle]);
        assert_eq!(weld_facets(&positions, &triangles, flat), None);
    }

    #[test]
    fn equal_positions_become_one_vertex() {
        let (positions, triangles) = ridge();
        let (welded, triangles) = weld(&positions, &triangles);
        assert_eq!(welded.len(), 4);
        assert_eq!(triangles, vec![[0, 1, 2], [1, 3, 2]]);
    }
}
