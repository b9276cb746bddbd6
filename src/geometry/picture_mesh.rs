//! A part's mesh for pictures: bounded in size, with normals that show edges as edges.

use nalgebra::{Point3, Vector3};

use crate::geometry::adjacency::{NONE, numbered, opposite_sides, weld};
use crate::geometry::divided::{SAGS, divided, must_divide};
use crate::geometry::height_field::{HeightField, Node};
use crate::geometry::mesh::TriMesh;
use crate::geometry::primitive::Primitive;
use crate::geometry::space::{Extents, View, ViewPoint};

/// Facets whose normals differ by more than this, rad, meet at an edge.
const EDGE: f64 = 35.0 * std::f64::consts::PI / 180.0;
/// The same angle for a part that consists of its flat facets.
const FACET_EDGE: f64 = 1.0 * std::f64::consts::PI / 180.0;
/// A vertex is at an edge if its sharpness is at least this: 0.03 is a fold of 28 degrees.
const SHARP: f64 = 0.03;
/// Largest distance of the chords from the round side of a primitive, mm.
const CHORD: f64 = 0.005;
/// Vertices that are this close to the sampled surface are on it, mm.
const NEAR: f64 = 0.05;
/// Nodes along the longer side of a mesh that is made from heights.
const MAX_NODES: usize = 128;
/// Neighbouring heights that differ by more than this, in steps, are at a cliff.
const CLIFF: f64 = 8.0;

/// Triangles for a picture, mm in the part frame, single precision: about 1e-5 mm on a part of 200 mm.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PictureMesh {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    source_triangles: usize,
}

impl PictureMesh {
    /// Largest number of triangles of a part in a picture: with their vertices about half a megabyte.
    pub const MAX_TRIANGLES: usize = 30_000;

    /// A mesh of vertices (mm, part frame), a unit normal for each, triangles, and the number of triangles of the mesh that
    /// it stands for; `None` if the numbers of vertices and normals differ, a number is not finite, or a triangle names a
    /// vertex that does not exist.
    #[must_use]
    pub fn new(
        positions: Vec<[f32; 3]>,
        normals: Vec<[f32; 3]>,
        triangles: Vec<[u32; 3]>,
        source_triangles: usize,
    ) -> Option<Self> {
        let is_finite = |vectors: &[[f32; 3]]| vectors.iter().flatten().all(|value| value.is_finite());
        let count = positions.len();
        let is_valid = normals.len() == count
            && is_finite(&positions)
            && is_finite(&normals)
            && triangles.iter().flatten().all(|index| (*index as usize) < count);
        is_valid.then_some(Self { positions, normals, triangles, source_triangles })
    }

    /// The mesh of a part with at most `most` triangles. A larger mesh is thinned: the vertices in one cell of a cubic grid
    /// that face the same way become one, at the place of one of them (J. Rossignac and P. Borrel, Multi-resolution 3D
    /// approximations, 1993), so all vertices stay on the part.
    #[must_use]
    pub fn of(mesh: &TriMesh, most: usize) -> Self {
        let facets: Vec<Vector3<f64>> =
            mesh.triangles().iter().map(|corners| across(mesh, *corners)).collect();
        let welded = weld(mesh.positions());
        if mesh.triangles().len() <= most {
            let positions = mesh.positions();
            return Self::with_normals(mesh, &facets, &welded, &representatives(positions, &welded, |_| 0.0));
        }
        let corners = Corners::of(mesh, &facets, &welded);
        let places = thinned(mesh, &facets, &corners, most);
        let sharpness = |vertex: usize| corners.sharpness[corners.welded[vertex] as usize];
        let positions = representatives(mesh.positions(), &places, sharpness);
        Self::with_normals(mesh, &facets, &places, &positions)
    }

    /// The side of a part that faces the laser, from its sampled heights, with at most `most` triangles. Empty without
    /// surface.
    #[must_use]
    pub fn of_heights(field: &HeightField, view: &View, most: usize) -> Self {
        let (columns, rows) = field.size();
        let stride = columns.max(rows).div_ceil(MAX_NODES).max(1);
        let (across, up) = ((columns - 1) / stride + 1, (rows - 1) / stride + 1);
        let height = |column: usize, row: usize| match field.nodes()[row * columns + column] {
            Node::Empty => None,
            Node::Wall(height) | Node::Surface(height) => Some(height),
        };
        let mut positions = Vec::with_capacity(across * up);
        for row in 0..up {
            for column in 0..across {
                let (column, row) = (column * stride, row * stride);
                let at = field.position(column, row);
                // A node without a height is in no triangle.
                let height = height(column, row).unwrap_or(0.0);
                positions.push(view.part_point(Point3::new(at.x, at.y, height)));
            }
        }
        let mut triangles = Vec::new();
        let limit = CLIFF * field.step() * stride as f64;
        for row in 0..up.saturating_sub(1) {
            for column in 0..across.saturating_sub(1) {
                let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| (column + x, row + y));
                let numbers = corners.map(|(column, row)| (row * across + column) as u32);
                let heights = corners.map(|(column, row)| height(column * stride, row * stride));
                for triangle in [[0, 1, 3], [0, 3, 2]] {
                    let [Some(a), Some(b), Some(c)] = triangle.map(|corner| heights[corner]) else {
                        continue;
                    };
                    if a.max(b).max(c) - a.min(b).min(c) < limit {
                        triangles.push(triangle.map(|corner| numbers[corner]));
                    }
                }
            }
        }
        TriMesh::new(positions, Vec::new(), triangles).map(|mesh| Self::of(&mesh, most)).unwrap_or_default()
    }

    /// A primitive with its two ends, in the frame of the view.
    #[must_use]
    pub fn of_primitive(primitive: &Primitive) -> Self {
        let [start, end, length] = primitive.sizes();
        let axis = primitive.axis();
        let helper = if axis.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
        let u = helper.cross(&axis).normalize();
        let v = axis.cross(&u);
        let radius = start.max(end) / 2.0;
        let sides = (std::f64::consts::PI / (1.0 - CHORD / radius).clamp(-1.0, 1.0).acos()).ceil();
        let sides = if sides.is_finite() { sides.clamp(24.0, 720.0) as u32 } else { 24 };
        let mut positions = Vec::new();
        let ends = [(-0.5, start / 2.0), (0.5, end / 2.0)];
        for (share, radius) in ends {
            let middle = primitive.middle() + *axis * (share * length);
            for side in 0..sides {
                let angle = f64::from(side) / f64::from(sides) * std::f64::consts::TAU;
                positions.push(middle + (u * angle.cos() + v * angle.sin()) * radius);
            }
        }
        let middles = [2 * sides, 2 * sides + 1];
        positions.extend(ends.map(|(share, _)| primitive.middle() + *axis * (share * length)));
        let triangles = (0..sides).flat_map(|side| {
            let next = (side + 1) % sides;
            let (far, far_next) = (sides + side, sides + next);
            [
                [side, next, far_next],
                [side, far_next, far],
                [middles[0], next, side],
                [middles[1], far, far_next],
            ]
        });
        let mesh = TriMesh::new(positions, Vec::new(), triangles.collect());
        mesh.map(|mesh| Self::of(&mesh, usize::MAX)).unwrap_or_default()
    }

    /// The mesh with the facets under `area` (mm in the view) divided until their sides follow the surface to
    /// within 0.004 mm, to prevent them from covering what is drawn on a hollow surface. They follow it less
    /// closely if this would need more than `most` new vertices. Vertices stay where they are. `height`
    /// returns the height of the surface, mm in the view.
    #[must_use]
    pub fn following(
        self,
        view: &View,
        area: &Extents,
        height: &dyn Fn(ViewPoint) -> Option<f64>,
        most: usize,
    ) -> Self {
        let corners: Vec<Point3<f64>> =
            self.positions.iter().map(|at| view.point(Point3::from(*at).cast())).collect();
        let on_surface = |at: ViewPoint| height(at).map(|height| Point3::new(at.x, at.y, height));
        let is_near =
            |point: &Point3<f64>| height(flat(*point)).is_some_and(|height| (height - point.z).abs() < NEAR);
        // Outside the area the sides are longer the farther away they are.
        let is_close =
            |[from, to]: [ViewPoint; 2]| area.distance(from.lerp(to, 0.5).coords()) <= from.distance(to);
        let (close, rest): (Vec<[u32; 3]>, Vec<[u32; 3]>) = self.triangles.iter().partition(|triangle| {
            let [a, b, c] = triangle.map(|vertex| flat(corners[vertex as usize]));
            [[a, b], [b, c], [c, a]].into_iter().any(is_close)
        });
        let mut result = self;
        for sag in SAGS {
            let mut points = corners.clone();
            let (mut positions, mut normals) = (result.positions.clone(), result.normals.clone());
            positions.truncate(corners.len());
            normals.truncate(corners.len());
            let mut is_full = false;
            // Whether a side is divided depends on its place alone: facets that meet at an edge have separate vertices there.
            let mut triangles = divided(close.clone(), |ends| {
                let chord = ends.map(|end| points[end as usize]);
                let [from, to] = chord.map(flat);
                let at = |t: f64| on_surface(from.lerp(to, t));
                is_full |= points.len() >= corners.len() + most;
                if is_full || !is_close([from, to]) || !chord.iter().all(is_near) {
                    return None;
                }
                let middle = at(0.5).filter(|_| must_divide(sag, from.distance(to), chord, at))?;
                let [a, b] = ends.map(|end| Vector3::from(normals[end as usize]));
                points.push(middle);
                positions.push(single(view.part_point(middle).coords));
                normals.push((a + b).try_normalize(0.0).unwrap_or(a).into());
                Some(points.len() as u32 - 1)
            });
            triangles.extend(&rest);
            result = Self { positions, normals, triangles, ..result };
            if !is_full {
                break;
            }
        }
        result
    }

    /// One vertex for each place and for each side of an edge there.
    fn with_normals(
        mesh: &TriMesh,
        facets: &[Vector3<f64>],
        places: &[u32],
        positions: &[Point3<f64>],
    ) -> Self {
        let kept: Vec<usize> = (0..facets.len())
            .filter(|triangle| {
                let [a, b, c] = mesh.triangles()[*triangle].map(|vertex| places[vertex as usize]);
                a != b && b != c && c != a
            })
            .collect();
        // The corners at each place, in the order of the triangles: counted, then listed.
        let corners = || kept.iter().flat_map(|triangle| (0..3).map(move |corner| (*triangle, corner)));
        let place = |(triangle, corner): (usize, usize)| places[mesh.triangles()[triangle][corner] as usize];
        let mut starts = vec![0usize; positions.len() + 1];
        corners().for_each(|corner| starts[place(corner) as usize + 1] += 1);
        (0..positions.len()).for_each(|index| starts[index + 1] += starts[index]);
        let mut listed = vec![(0usize, 0usize); kept.len() * 3];
        let mut ends = starts.clone();
        for (number, triangle) in kept.iter().enumerate() {
            for corner in 0..3 {
                let end = &mut ends[place((*triangle, corner)) as usize];
                listed[*end] = (number, corner);
                *end += 1;
            }
        }
        let edge = if mesh.is_facetted() { FACET_EDGE } else { EDGE }.cos();
        let mut triangles = vec![[0u32; 3]; kept.len()];
        let mut picture = Self { source_triangles: facets.len(), ..Self::default() };
        // The sides at one place: the direction of the first corner, and the sum over all.
        let mut sides: Vec<(Vector3<f64>, Vector3<f64>)> = Vec::new();
        for (place, position) in positions.iter().enumerate() {
            sides.clear();
            let first = picture.positions.len();
            for &(number, corner) in &listed[starts[place]..starts[place + 1]] {
                let triangle = kept[number];
                let facet = facets[triangle];
                let of_file = mesh.normals().get(mesh.triangles()[triangle][corner] as usize);
                let normal = match of_file.filter(|normal| **normal != Vector3::zeros()) {
                    Some(normal) => *normal,
                    None => facet.try_normalize(0.0).unwrap_or_else(Vector3::zeros),
                };
                let side = match sides.iter().position(|(direction, _)| direction.dot(&normal) >= edge) {
                    Some(side) => side,
                    None => {
                        sides.push((normal, Vector3::zeros()));
                        sides.len() - 1
                    }
                };
                sides[side].1 += normal * facet.norm();
                triangles[number][corner] = (first + side) as u32;
            }
            for (direction, sum) in &sides {
                let normal =
                    sum.try_normalize(0.0).or(direction.try_normalize(0.0)).unwrap_or_else(Vector3::z);
                picture.positions.push(single(position.coords));
                picture.normals.push(single(normal));
            }
        }
        picture.triangles = triangles;
        picture
    }

    /// The same triangles without normals; `None` if all of them have no area.
    #[must_use]
    pub fn to_mesh(&self) -> Option<TriMesh> {
        let positions = self.positions.iter().map(|position| Point3::from(position.map(f64::from)));
        TriMesh::new(positions.collect(), Vec::new(), self.triangles.clone()).ok()
    }

    /// Vertex positions, mm.
    #[must_use]
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// Unit normals, one for each vertex.
    #[must_use]
    pub fn normals(&self) -> &[[f32; 3]] {
        &self.normals
    }

    /// Triangles, three vertices each, counter-clockwise seen from outside.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Number of triangles of the mesh that was thinned, or that it is a copy of.
    #[must_use]
    pub fn source_triangles(&self) -> usize {
        self.source_triangles
    }
}

fn flat(point: Point3<f64>) -> ViewPoint {
    ViewPoint::new(point.x, point.y)
}

fn single(vector: Vector3<f64>) -> [f32; 3] {
    vector.map(|value| value as f32).into()
}

/// The vector along a triangle's normal, twice as long as its area.
fn across(mesh: &TriMesh, corners: [u32; 3]) -> Vector3<f64> {
    let [a, b, c] = mesh.corners(corners);
    (b - a).cross(&(c - a))
}

/// For each vertex, the number of its cell, with cells so large that at most `most` triangles are left.
fn thinned(mesh: &TriMesh, facets: &[Vector3<f64>], corners: &Corners, most: usize) -> Vec<u32> {
    // Opposite sides of a thin wall must not become one.
    let side = |vertex: usize| -> i64 {
        let normal = corners.outward[corners.welded[vertex] as usize];
        let axis = normal.iamax();
        2 * axis as i64 + i64::from(normal[axis] < 0.0)
    };
    let positions = mesh.positions();
    let (min, max) = mesh.bounds();
    let size = (max - min).norm();
    let area: f64 = facets.iter().map(|facet| facet.norm() / 2.0).sum();
    // A surface meets 1.5 cells for each area of a cell, and has two triangles for each vertex.
    let mut cell = (3.0 * area / most.max(1) as f64).sqrt().max(size * 1e-6);
    loop {
        let key = |vertex: usize| {
            let [x, y, z] = ((positions[vertex] - min) / cell).map(|value| value.floor() as i64).into();
            [x * 6 + side(vertex), y, z]
        };
        let places = numbered(positions.len(), key);
        let left = mesh.triangles().iter().filter(|corners| {
            let [a, b, c] = corners.map(|vertex| places[vertex as usize]);
            a != b && b != c && c != a
        });
        let left = left.count();
        // Beyond the size of the part only corners are left; a larger cell changes nothing.
        if left <= most || !(cell < 2.0 * size) {
            return places;
        }
        cell *= (left as f64 / most as f64).sqrt().max(1.1);
    }
}

/// What surrounds the vertices of a mesh.
struct Corners<'a> {
    /// The place of each vertex.
    welded: &'a [u32],
    /// The sum of the facets' vectors round each place.
    outward: Vec<Vector3<f64>>,
    /// For each place, 0 on a flat side, up to 1 at an edge or a corner of the part, and more at a border of the mesh.
    sharpness: Vec<f64>,
}

impl<'a> Corners<'a> {
    fn of(mesh: &TriMesh, facets: &[Vector3<f64>], welded: &'a [u32]) -> Self {
        let count = welded.iter().max().map_or(0, |last| *last as usize + 1);
        let (mut outward, mut areas) = (vec![Vector3::zeros(); count], vec![0.0; count]);
        let triangles: Vec<[u32; 3]> =
            mesh.triangles().iter().map(|corners| corners.map(|vertex| welded[vertex as usize])).collect();
        for (places, facet) in triangles.iter().zip(facets) {
            for place in places {
                outward[*place as usize] += facet;
                areas[*place as usize] += facet.norm();
            }
        }
        let flat =
            |(sum, area): (&Vector3<f64>, &f64)| if *area > 0.0 { 1.0 - sum.norm() / area } else { 0.0 };
        let mut sharpness: Vec<f64> = outward.iter().zip(&areas).map(flat).collect();
        for (side, opposite) in opposite_sides(&triangles).into_iter().enumerate() {
            if opposite == NONE {
                let ends = [side % 3, (side + 1) % 3].map(|corner| triangles[side / 3][corner]);
                ends.iter().for_each(|place| sharpness[*place as usize] = 1.0);
            }
        }
        Self { welded, outward, sharpness }
    }
}

/// For each place, the one of its vertices that is nearest to their mean; where an edge of the part passes, only the vertices
/// on it are considered, so that edges stay where they are.
fn representatives(
    positions: &[Point3<f64>],
    places: &[u32],
    sharpness: impl Fn(usize) -> f64,
) -> Vec<Point3<f64>> {
    let count = places.iter().max().map_or(0, |last| *last as usize + 1);
    let mut sharpest = vec![0.0f64; count];
    for (vertex, place) in places.iter().enumerate() {
        sharpest[*place as usize] = sharpest[*place as usize].max(sharpness(vertex));
    }
    let is_candidate = |vertex: usize, place: u32| {
        let limit = sharpest[place as usize];
        limit < SHARP || sharpness(vertex) >= 0.8 * limit
    };
    let mut sums = vec![(Vector3::zeros(), 0.0); count];
    for (vertex, place) in places.iter().enumerate().filter(|(vertex, place)| is_candidate(*vertex, **place))
    {
        let sum = &mut sums[*place as usize];
        *sum = (sum.0 + positions[vertex].coords, sum.1 + 1.0);
    }
    let mut nearest = vec![(f64::INFINITY, Point3::origin()); count];
    for (vertex, place) in places.iter().enumerate().filter(|(vertex, place)| is_candidate(*vertex, **place))
    {
        let (sum, number) = sums[*place as usize];
        let position = &positions[vertex];
        let distance = (position.coords - sum / number).norm_squared();
        let best = &mut nearest[*place as usize];
        if distance < best.0 {
            *best = (distance, *position);
        }
    }
    nearest.into_iter().map(|(_, position)| position).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::shapes;

    fn box_mesh() -> TriMesh {
        let corner =
            |index: u32| Point3::new(f64::from(index & 1), f64::from(index >> 1 & 1), f64::from(index >> 2));
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]);
        TriMesh::new((0..8).map(corner).collect(), Vec::new(), triangles.collect()).unwrap()
    }

    #[test]
    fn the_edges_of_a_box_stay_sharp() {
        let picture = PictureMesh::of(&box_mesh(), 100);
        assert_eq!((picture.positions().len(), picture.triangles().len()), (24, 12));
        for triangle in picture.triangles() {
            let [a, b, c] = triangle.map(|index| Vector3::from(picture.positions()[index as usize]));
            let facet = (b - a).cross(&(c - a)).normalize();
            for index in triangle {
                assert!((Vector3::from(picture.normals()[*index as usize]) - facet).norm() < 1e-6);
            }
        }
    }

    #[test]
    fn a_large_mesh_is_thinned_to_vertices_of_its_own() {
        let mesh = shapes::graph(30.0, 0.15, shapes::sphere);
        let picture = PictureMesh::of(&mesh, 5000);
        assert!(mesh.triangles().len() > 100_000);
        assert!((1500..=5000).contains(&picture.triangles().len()), "{}", picture.triangles().len());
        assert_eq!(picture.source_triangles(), mesh.triangles().len());
        for ([x, y, z], normal) in picture.positions().iter().zip(picture.normals()) {
            let (x, y) = (f64::from(*x), f64::from(*y));
            // Beyond this the sphere is so steep that the precision of x shows in z.
            assert!(x.hypot(y) > 25.0 || (f64::from(*z) - shapes::sphere(x, y)).abs() < 1e-4);
            assert!((Vector3::from(*normal).norm() - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn both_sides_of_a_thin_wall_remain() {
        // A plate of 0.2 mm with 100,000 triangles, thinned to cells of several mm.
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let count = 160u32;
        for z in [0.0, 0.2] {
            for index in 0..count * count {
                let (x, y) = (f64::from(index % count), f64::from(index / count));
                positions.push(Point3::new(x, y, z));
            }
        }
        for index in 0..count * count {
            if index % count + 1 < count && index / count + 1 < count {
                let (a, b, c, d) = (index, index + 1, index + count, index + count + 1);
                let upper = [[a, b, d], [a, d, c]].map(|corners| corners.map(|index| index + count * count));
                triangles.extend([[a, d, b], [a, c, d]].into_iter().chain(upper));
            }
        }
        let picture = PictureMesh::of(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), 2000);
        let up = picture.normals().iter().filter(|normal| normal[2] > 0.99).count();
        let down = picture.normals().iter().filter(|normal| normal[2] < -0.99).count();
        assert_eq!(up + down, picture.normals().len());
        assert!(up > 200 && up == down, "{up} {down}");
        for (position, normal) in picture.positions().iter().zip(picture.normals()) {
            assert_eq!(normal[2] > 0.0, position[2] > 0.1);
        }
    }

    #[test]
    fn a_primitive_has_its_sizes_and_faces_outwards() {
        let primitive = Primitive::new(40.0, 60.0, 100.0, Vector3::y()).unwrap();
        let picture = PictureMesh::of_primitive(&primitive);
        let [min, max] = primitive.bounds();
        let mut volume = 0.0;
        for triangle in picture.triangles() {
            let [a, b, c] =
                triangle.map(|index| Vector3::from(picture.positions()[index as usize]).cast::<f64>());
            volume += a.cross(&b).dot(&c) / 6.0;
        }
        let exact = std::f64::consts::PI * 100.0 / 3.0 * (20.0 * 20.0 + 20.0 * 30.0 + 30.0 * 30.0);
        assert!((volume / exact - 1.0).abs() < 1e-3, "{volume} for {exact}");
        for axis in 0..3 {
            let values = picture.positions().iter().map(|position| f64::from(position[axis]));
            let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
            assert!((low - min[axis]).abs() < 0.02 && (high - max[axis]).abs() < 0.02);
        }
    }

    #[test]
    fn numbers_that_do_not_match_are_refused() {
        let one = vec![[0.0f32; 3]; 3];
        assert!(PictureMesh::new(one.clone(), one.clone(), vec![[0, 1, 2]], 1).is_some());
        assert!(PictureMesh::new(one.clone(), one[..2].to_vec(), vec![[0, 1, 2]], 1).is_none());
        assert!(PictureMesh::new(one.clone(), one.clone(), vec![[0, 1, 3]], 1).is_none());
        assert!(PictureMesh::new(vec![[f32::NAN; 3]; 3], one, vec![[0, 1, 2]], 1).is_none());
    }
}
