//! Normals of vertices that are on one sphere, for example on a ball cap on a shaft.
//!
//! On many surfaces, two rows of vertices round an axis are on a sphere. All vertices that surround another
//! vertex in two rows are on one sphere only if the part has a sphere there. They must be on it to within the
//! precision of the file, and so must others that can be reached from there. At a small cap, some of the
//! surrounding vertices are at its rim. A plane polygon with its vertices on a sphere is a flat side that is
//! cut from the sphere.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

use super::caps;
use super::creases::Facing;
use super::ends::{Surface, Surroundings, precision};
use super::settling::{Estimates, Settling};
use super::{MOST_SEARCHED, SmoothMesh};
use crate::geometry::adjacency::{NONE, Neighbours, facet_normal, sliver_side};
use crate::geometry::fork::{Fork, join};
use crate::geometry::shape_fit::cross_directions;
use crate::geometry::sphere::Sphere;

/// A sphere is fitted at a vertex only if at least this many vertices surround it in two rows.
const LEAST_VERTICES: usize = 12;
/// Where some of the vertices that surround a first one are at a rim, they show a sphere only if they have at
/// least this many different distances from it. A small cap has such a rim. Fewer are not enough, because a
/// sphere through one more vertex fits any profile with its axis.
const LEAST_ROWS: usize = 3;
/// Two distances from a vertex are different if they differ by more than this share.
const SAME_ROW: f64 = 0.05;
/// Vertices show a sphere only if they leave its tangent plane by at least this many times the tolerance of a
/// vertex (`near`). A flat side is cut from a sphere only if it leaves the sphere by more than this many
/// times the same tolerance.
const LEAST_BULGE: f64 = 50.0;
/// A sphere has at least this many facets.
const LEAST_TRIANGLES: usize = 16;
/// A plane polygon with its vertices on a sphere is a flat side only if it leaves the sphere by a distance
/// that differs by more than this share from that of the facets beside it. The polygons at the poles of some
/// balls leave it equally far.
const AS_FAR: f64 = 0.01;
/// A flat side fills at least this share of the circle in which its plane cuts the sphere. Facets that are in
/// one plane by chance are two triangles with slivers beside them.
const FULL: f64 = 0.7;
/// The corners of a flat side leave its plane by at most this share of the distance by which the plane leaves
/// the sphere. In a fine fan, each facet is nearly in one plane with the next.
const PLANE: f64 = 0.1;
/// The normals of facets differ from that of the sphere by at most this, rad.
const LEAN: f64 = 0.4;
/// Normals of the file that differ from the normal of the sphere by less than this, rad, are as exact as it.
const EXACT: f64 = 1e-3;
/// Normals of the file that differ from the normal of the sphere by more than this, rad, do not belong to it.
const MOST_OFF: f64 = 0.06;
/// At most this many looks per triangle on average.
const MOST_VISITS: usize = 4;
/// A sphere is fitted to at most this many facets.
const MOST_FITTED: usize = 400;
/// A sphere is fitted again to the facets that it has gained in at most this many rounds.
const ROUNDS: usize = 4;

/// What a search has looked at.
struct Looks {
    /// For each triangle, the last round in which it was found.
    last: Vec<u32>,
    round: u32,
    /// How many triangles may still be found.
    left: usize,
}

/// The facets of a mesh that are on one sphere.
struct Ball<'a> {
    mesh: &'a SmoothMesh,
    sphere: Sphere,
    /// In ascending order.
    triangles: Vec<usize>,
}

impl Surface for Ball<'_> {
    fn triangles(&self) -> &[usize] {
        &self.triangles
    }

    fn outward(&self, side: usize) -> Vector3<f64> {
        let [from, to] = self.mesh.ends(side);
        self.sphere.outward(&nalgebra::center(&from, &to))
    }

    fn largest_bulge(&self) -> f64 {
        let bulges = self.triangles.iter();
        bulges.map(|&triangle| bulge_on(self.mesh, &self.sphere, triangle)).fold(0.0, f64::max)
    }
}

/// Replaces estimated normals by the normals of the spheres that their vertices show. They are as exact as
/// those of a file, are not estimated any more, and have no deviations. Normals of the file that
/// are nearly right, as averages of the facets round a vertex are, are replaced in the same way. `is_round`
/// are the triangles whose normals are known. At an edge that the facets beyond show, the sphere gets
/// vertices of its own. Returns the edges of flat sides that are cut from the spheres, in ascending order.
pub(super) fn settle(
    mesh: &mut SmoothMesh,
    estimates: &mut Estimates,
    is_round: &[bool],
    fork: &dyn Fork,
) -> Vec<Facing> {
    if mesh.triangles.len() > MOST_SEARCHED {
        return Vec::new();
    }
    let is_open = open(mesh, &estimates.is_estimated);
    if !is_open.contains(&true) {
        return Vec::new();
    }
    let mut edges = Vec::new();
    let found = balls(mesh, &estimates.is_estimated, &is_open, is_round, &mut edges, fork);
    if found.is_empty() {
        return edges;
    }
    let mut is_known = vec![false; mesh.positions.len()];
    for (corners, _) in mesh.triangles.iter().zip(is_round).filter(|(_, is_round)| **is_round) {
        corners.iter().for_each(|&vertex| is_known[vertex as usize] = true);
    }
    // Normals of the file that are nearly right are replaced as estimated ones are, and what keeps them is the file's again after that.
    let mut replaced = Vec::new();
    for (sphere, triangles, _, way) in &found {
        for vertex in triangles.iter().flat_map(|&triangle| mesh.triangles[triangle]) {
            let vertex = vertex as usize;
            let outward = sphere.outward(&mesh.positions[vertex]) * *way;
            let is_near = mesh.normals[vertex].dot(&outward) > MOST_OFF.cos();
            if !estimates.is_estimated[vertex] && !is_known[vertex] && is_near {
                estimates.is_estimated[vertex] = true;
                replaced.push(vertex);
            }
        }
    }
    let mut settling = Settling::of(mesh, estimates);
    for (sphere, triangles, at_edges, way) in &found {
        let normal = |mesh: &SmoothMesh, vertex: u32| {
            let is_open = is_known.get(vertex as usize) == Some(&false);
            is_open.then(|| sphere.outward(&mesh.positions[vertex as usize]) * *way)
        };
        settling.set(triangles, at_edges, normal);
    }
    replaced.into_iter().for_each(|vertex| estimates.is_estimated[vertex] = false);
    let of_balls = found.iter().flat_map(|(_, triangles, ..)| triangles);
    for vertex in of_balls.flat_map(|&triangle| mesh.triangles[triangle]) {
        if is_known.get(vertex as usize) != Some(&true) {
            estimates.set_known(vertex);
        }
    }
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// For each vertex whether its normal is estimated or, together with that of a neighbour, differs from those of a circle through
/// both.
fn open(mesh: &SmoothMesh, estimated: &[bool]) -> Vec<bool> {
    let mut is_open = estimated.to_vec();
    for triangle in 0..mesh.triangles.len() {
        let vertices = mesh.triangles[triangle].map(|vertex| vertex as usize);
        let (corners, normals) = mesh.corners(triangle);
        for [from, to] in [[0, 1], [1, 2], [2, 0]] {
            let along = corners[to] - corners[from];
            let uneven = along.dot(&(normals[from] + normals[to]));
            if uneven * uneven > EXACT * EXACT * along.norm_squared() {
                is_open[vertices[from]] = true;
                is_open[vertices[to]] = true;
            }
        }
    }
    is_open
}

/// A sphere with its triangles, its vertices at edges, and −1 if it is hollow.
type Found = (Sphere, Vec<usize>, Vec<u32>, f64);

fn balls(
    mesh: &SmoothMesh,
    estimated: &[bool],
    is_open: &[bool],
    is_round: &[bool],
    edges: &mut Vec<Facing>,
    fork: &dyn Fork,
) -> Vec<Found> {
    let near = precision(mesh);
    let neighbours = || Neighbours::of(&mesh.triangles, mesh.positions.len());
    // Which vertices are at the rim of anything, and a triangle of each vertex.
    let rims = || {
        let mut is_at_rim = vec![false; is_open.len()];
        for side in (0..mesh.continued.len()).filter(|&side| mesh.continued[side] == NONE) {
            let corners = mesh.triangles[side / 3];
            for corner in [side % 3, (side % 3 + 1) % 3] {
                is_at_rim[corners[corner] as usize] = true;
            }
        }
        let mut triangle_of = vec![NONE; mesh.positions.len()];
        for (triangle, corners) in mesh.triangles.iter().enumerate() {
            corners.iter().for_each(|&vertex| triangle_of[vertex as usize] = triangle as u32);
        }
        (is_at_rim, triangle_of)
    };
    let (around, (is_at_rim, triangle_of)) = join(fork, neighbours, rims);
    let mut is_tried = vec![false; mesh.positions.len()];
    let mut gathering = Gathering::of(mesh, near, is_round, fork);
    for vertex in 0..mesh.positions.len() {
        let ring = around.of_vertex(vertex);
        let is_open = |&vertex: &u32| is_open[vertex as usize] && !is_tried[vertex as usize];
        if is_at_rim[vertex] || !is_open(&(vertex as u32)) || !ring.iter().all(is_open) {
            continue;
        }
        let is_cap = ring.iter().any(|&other| is_at_rim[other as usize]);
        let ball = ball_at(mesh, &around, vertex, near, if is_cap { LEAST_ROWS } else { 1 });
        // Others inside may show what a first one of a cap does not.
        if ball.is_some() || !is_cap {
            ring.iter().for_each(|&other| is_tried[other as usize] = true);
        }
        is_tried[vertex] = true;
        let Some(ball) = ball else { continue };
        let is_exact = |&other: &u32| {
            let other = other as usize;
            let outward = ball.outward(&mesh.positions[other]);
            !estimated[other] && mesh.normals[other].cross(&outward).norm() < EXACT
        };
        if !ring.iter().all(is_exact) {
            for &triangle in gathering.add(ball, triangle_of[vertex] as usize) {
                mesh.triangles[triangle].iter().for_each(|&vertex| is_tried[vertex as usize] = true);
            }
        }
    }
    let is_estimated =
        |triangle: usize| mesh.triangles[triangle].iter().all(|&vertex| estimated[vertex as usize]);
    let is_free = |triangle: usize| is_estimated(triangle) && !gathering.is_known[triangle];
    for (sphere, triangle) in caps::shown(mesh, is_free, near) {
        gathering.add(sphere, triangle);
    }
    edges.append(&mut gathering.edges);
    gathering.found
}

/// The spheres of a mesh as they are found.
struct Gathering<'m> {
    mesh: &'m SmoothMesh,
    fork: &'m dyn Fork,
    /// How far vertices may be off, mm.
    near: f64,
    surroundings: Option<Surroundings<'m>>,
    /// For each triangle whether its surface is known.
    is_known: Vec<bool>,
    looks: Looks,
    /// Of flat sides that are cut from the spheres.
    edges: Vec<Facing>,
    found: Vec<Found>,
}

impl<'m> Gathering<'m> {
    fn of(mesh: &'m SmoothMesh, near: f64, is_round: &[bool], fork: &'m dyn Fork) -> Self {
        let count = mesh.triangles.len();
        let mut is_known = vec![false; count];
        is_known.iter_mut().zip(is_round).for_each(|(known, round)| *known = *round);
        let looks = Looks { last: vec![0; count], round: 0, left: MOST_VISITS * count };
        Self { mesh, fork, near, surroundings: None, is_known, looks, edges: Vec::new(), found: Vec::new() }
    }

    /// Adds a sphere from one of its triangles on, and returns its triangles; none if they are too few.
    fn add(&mut self, sphere: Sphere, first: usize) -> &[usize] {
        let Self { mesh, near, .. } = *self;
        if first >= self.is_known.len() || self.is_known[first] || self.looks.left == 0 {
            return &[];
        }
        let surroundings = self.surroundings.get_or_insert_with(|| Surroundings::of(mesh, near, self.fork));
        let Some((mut flat_sides, triangles)) =
            grown(surroundings, sphere, first, &self.is_known, &mut self.looks)
        else {
            return &[];
        };
        self.edges.extend(flat_sides.edges(&triangles));
        let sphere = flat_sides.sphere;
        triangles.iter().for_each(|&triangle| self.is_known[triangle] = true);
        let facing = |&triangle: &usize| {
            let corners = mesh.corners(triangle).0;
            facet_normal(corners).dot(&sphere.outward(&corners[0]))
        };
        let way = triangles.iter().map(facing).sum::<f64>().signum();
        let ball = Ball { mesh, sphere, triangles };
        let at_edges = surroundings.at_edges(&ball);
        self.found.push((sphere, ball.triangles, at_edges, way));
        self.found.last().map_or(&[], |(_, triangles, ..)| triangles)
    }
}

/// The plane facets of a mesh that are flat sides of a sphere.
struct FlatSides<'s, 'm> {
    surroundings: &'s Surroundings<'m>,
    sphere: Sphere,
    /// For each facet that was looked at, whether it is one.
    of_facet: BTreeMap<u32, bool>,
}

impl<'s, 'm> FlatSides<'s, 'm> {
    fn of(surroundings: &'s Surroundings<'m>, sphere: Sphere) -> Self {
        Self { surroundings, sphere, of_facet: BTreeMap::new() }
    }

    fn has_corners_of(&self, triangle: usize) -> bool {
        let Surroundings { mesh, near, .. } = self.surroundings;
        mesh.corners(triangle).0.iter().all(|corner| self.sphere.distance(corner).abs() <= *near)
    }

    /// Whether a triangle is of the sphere, and not of a flat side.
    fn leave_to_sphere(&mut self, triangle: usize) -> bool {
        let corners = self.surroundings.mesh.corners(triangle).0;
        let middle = nalgebra::center(&nalgebra::center(&corners[0], &corners[1]), &corners[2]);
        self.has_corners_of(triangle)
            && (facet_normal(corners).cross(&self.sphere.outward(&middle)).norm() < LEAN
                || sliver_side(corners).is_some())
            && !self.contain(triangle)
    }

    /// Whether a triangle with its corners on the sphere is of a flat side.
    fn contain(&mut self, triangle: usize) -> bool {
        let facets = &self.surroundings.facets;
        if !facets.is_polygon(triangle) {
            return false;
        }
        let facet = facets.of_triangle(triangle);
        if let Some(known) = self.of_facet.get(&facet) {
            return *known;
        }
        let is_flat = self.is_flat(triangle);
        self.of_facet.insert(facet, is_flat);
        is_flat
    }

    /// Whether the polygon of a triangle fills its circle, and does not leave the sphere as far as the nearest vertices beside it do.
    fn is_flat(&self, triangle: usize) -> bool {
        let Self { surroundings, sphere, .. } = self;
        let Surroundings { mesh, facets, near } = surroundings;
        let mut beside = f64::INFINITY;
        for side in facets.with(triangle).flat_map(|triangle| 3 * triangle..3 * triangle + 3) {
            let other = mesh.continued[side] as usize;
            if mesh.continued[side] == NONE || facets.of_triangle(other / 3) == facets.of_triangle(triangle) {
                continue;
            }
            let apex = mesh.corners(other / 3).0[(other % 3 + 2) % 3];
            let leaves = mesh.ends(side).map(|end| sphere.distance(&nalgebra::center(&end, &apex)).abs());
            beside = leaves.into_iter().fold(beside, f64::min);
        }
        let Some(largest) = facets.with(triangle).next() else { return false };
        let corners = mesh.corners(largest).0;
        let normal = facet_normal(corners);
        let leaves = sphere.radius - normal.dot(&(corners[0] - sphere.center)).abs();
        let is_plane = || {
            let all = facets.with(triangle).flat_map(|triangle| mesh.corners(triangle).0);
            all.map(|corner| normal.dot(&(corner - corners[0])).abs()).fold(0.0, f64::max) < PLANE * leaves
        };
        let area = |[a, b, c]: [Point3<f64>; 3]| (b - a).cross(&(c - a)).norm() / 2.0;
        let is_full = || {
            let circle = PI * leaves * (2.0 * sphere.radius - leaves);
            facets.with(triangle).map(|triangle| area(mesh.corners(triangle).0)).sum::<f64>() > FULL * circle
        };
        beside.is_finite()
            && (leaves - beside).abs() > AS_FAR * beside + near
            && leaves > LEAST_BULGE * near
            && is_plane()
            && is_full()
    }

    /// The sides at which triangles of the sphere meet flat sides.
    fn edges(&mut self, triangles: &[usize]) -> Vec<Facing> {
        let ends = self.surroundings.ends(triangles);
        let is_edge =
            |&(_, other): &(usize, usize)| self.has_corners_of(other / 3) && self.contain(other / 3);
        let edges = ends.into_iter().filter(is_edge);
        edges.map(|(side, other)| [side.min(other) as u32, side.max(other) as u32]).collect()
    }
}

/// The sphere of a vertex and of the vertices round it in two rows, if these have at least `rows` different
/// distances from it.
fn ball_at(mesh: &SmoothMesh, around: &Neighbours, vertex: usize, near: f64, rows: usize) -> Option<Sphere> {
    let mut vertices: Vec<u32> = around
        .of_vertex(vertex)
        .iter()
        .flat_map(|&other| around.of_vertex(other as usize))
        .copied()
        .collect();
    vertices.sort_unstable();
    vertices.dedup();
    if vertices.len() < LEAST_VERTICES {
        return None;
    }
    let points: Vec<Point3<f64>> = vertices.iter().map(|&vertex| mesh.positions[vertex as usize]).collect();
    let sphere = Sphere::through(&points)?;
    if points.iter().any(|point| sphere.distance(point).abs() > near) {
        return None;
    }
    let own = mesh.positions[vertex];
    let mut distances: Vec<f64> = points.iter().map(|point| (point - own).norm()).collect();
    distances.sort_by(f64::total_cmp);
    let steps = distances.windows(2).filter(|pair| pair[1] > pair[0] * (1.0 + SAME_ROW));
    if steps.count() < rows {
        return None;
    }
    // Vertices of a narrow row show no sphere.
    let (first, second) = cross_directions(&sphere.outward(&own));
    let steps = || {
        let steps = points.iter().map(|point| point - own);
        steps.map(|step| Vector2::new(step.dot(&first), step.dot(&second)))
    };
    let spread: Matrix2<f64> = steps().map(|step| step * step.transpose()).sum();
    let reach = |direction: Vector2<f64>| {
        let along = steps().map(|step| step.dot(&direction));
        along.fold([0.0f64; 2], |[low, high], along| [low.max(-along), high.max(along)])
    };
    let axes = spread.symmetric_eigen().eigenvectors;
    let reaches = [0, 1].map(|axis| reach(axes.column(axis).into_owned()));
    let least = reaches.into_iter().flatten().fold(f64::INFINITY, f64::min);
    if least * least < 2.0 * LEAST_BULGE * near * sphere.radius {
        return None;
    }
    Some(sphere)
}

/// How far the sides of a triangle are from a sphere at their middles, at most, mm.
fn bulge_on(mesh: &SmoothMesh, sphere: &Sphere, triangle: usize) -> f64 {
    let [a, b, c] = mesh.corners(triangle).0;
    let middles = [[a, b], [b, c], [c, a]].map(|[from, to]| nalgebra::center(&from, &to));
    middles.map(|middle| sphere.distance(&middle).abs()).into_iter().fold(0.0, f64::max)
}

/// The triangles on a sphere that can be reached from one, in ascending order, and the sphere of all their vertices, with its flat sides.
fn grown<'s, 'm>(
    surroundings: &'s Surroundings<'m>,
    sphere: Sphere,
    from: usize,
    is_known: &[bool],
    looks: &mut Looks,
) -> Option<(FlatSides<'s, 'm>, Vec<usize>)> {
    let mesh = surroundings.mesh;
    let mut flat_sides = FlatSides::of(surroundings, sphere);
    let mut found: Vec<usize> = Vec::new();
    for _ in 0..ROUNDS {
        looks.round += 1;
        looks.last[from] = looks.round;
        let mut now = vec![from];
        let mut next = 0;
        while next < now.len() {
            let here = now[next];
            next += 1;
            for side in 3 * here..3 * here + 3 {
                let other = mesh.continued[side];
                let there = other as usize / 3;
                if other == NONE
                    || is_known[there]
                    || looks.last[there] == looks.round
                    || !flat_sides.leave_to_sphere(there)
                {
                    continue;
                }
                looks.last[there] = looks.round;
                now.push(there);
            }
        }
        looks.left = looks.left.saturating_sub(now.len());
        if now.len() <= found.len() {
            break;
        }
        found = now;
        let some = found.iter().step_by(found.len().div_ceil(MOST_FITTED));
        let points: Vec<Point3<f64>> = some.flat_map(|&triangle| mesh.corners(triangle).0).collect();
        flat_sides = FlatSides::of(surroundings, Sphere::through(&points)?);
    }
    found.retain(|&triangle| flat_sides.leave_to_sphere(triangle));
    found.sort_unstable();
    (found.len() >= LEAST_TRIANGLES).then_some((flat_sides, found))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::mesh::TriMesh;
    use crate::geometry::space::View;

    /// A part of a surface over a grid of steps of 2.5 mm, whose vertices are moved by up to a third of a step.
    fn over_grid(height: impl Fn(f64, f64) -> f64) -> SmoothMesh {
        SmoothMesh::new(&mesh_over_grid(height), &View::top())
    }

    fn mesh_over_grid(height: impl Fn(f64, f64) -> f64) -> TriMesh {
        let mut state = 11u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
        };
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for row in 0..17u32 {
            for column in 0..17u32 {
                let place = |index: u32, moved: f64| 2.5 * (f64::from(index) - 8.0 + moved);
                let (x, y) = (place(column, 0.6 * random()), place(row, 0.6 * random()));
                positions.push(Point3::new(x, y, height(x, y)));
                if row > 0 && column > 0 {
                    let upper = row * 17 + column;
                    triangles.extend([[upper - 18, upper - 17, upper], [upper - 18, upper, upper - 1]]);
                }
            }
        }
        TriMesh::new(positions, Vec::new(), triangles).unwrap()
    }

    /// A cap of a ball of 80 mm whose normals are averages of its facets, weighted by their areas.
    fn shaded_ball() -> TriMesh {
        let mesh = mesh_over_grid(|x, y| (80.0f64 * 80.0 - x * x - y * y).sqrt());
        let mut averages = vec![Vector3::zeros(); mesh.positions().len()];
        for &triangle in mesh.triangles() {
            let [a, b, c] = mesh.corners(triangle);
            triangle.iter().for_each(|&vertex| averages[vertex as usize] += (b - a).cross(&(c - a)));
        }
        averages.iter_mut().for_each(|average| *average = average.normalize());
        TriMesh::new(mesh.positions().to_vec(), averages, mesh.triangles().to_vec()).unwrap()
    }

    #[test]
    fn averages_over_the_facets_of_a_ball_give_way_to_its_normals() {
        let mesh = shaded_ball();
        let off = |at: &Point3<f64>, normal: &Vector3<f64>| (normal - at.coords / 80.0).norm();
        let is_inside = |at: &Point3<f64>| at.x.abs().max(at.y.abs()) < 16.0;
        let lean = mesh
            .positions()
            .iter()
            .zip(mesh.normals())
            .filter(|(at, _)| is_inside(at))
            .map(|(at, n)| off(at, n));
        assert!(lean.fold(0.0, f64::max) > 5e-3);
        let cap = SmoothMesh::new(&mesh, &View::top());
        for (at, normal) in cap.positions.iter().zip(&cap.normals).filter(|(at, _)| is_inside(at)) {
            assert!(off(at, normal) < 1e-5, "{at}: {normal:?}");
        }
    }

    #[test]
    fn no_normal_that_is_known_beside_a_ball_is_taken_for_an_estimate() {
        let mesh = shaded_ball();
        let mut cap = SmoothMesh {
            positions: mesh.positions().to_vec(),
            normals: mesh.normals().to_vec(),
            triangles: mesh.triangles().to_vec(),
            ..SmoothMesh::new(&mesh, &View::top())
        };
        // One half belongs to a cylinder, say.
        let is_round: Vec<bool> = mesh
            .triangles()
            .iter()
            .map(|&corners| mesh.corners(corners).iter().all(|at| at.x < 0.0))
            .collect();
        let mut estimates = Estimates::new(vec![false; cap.positions.len()], Vec::new());
        settle(&mut cap, &mut estimates, &is_round, &crate::geometry::fork::InTurn);
        assert!(!estimates.is_estimated.contains(&true));
        for (corners, _) in mesh.triangles().iter().zip(&is_round).filter(|(_, is_round)| **is_round) {
            for vertex in corners.map(|vertex| vertex as usize) {
                assert_eq!(cap.normals[vertex], mesh.normals()[vertex]);
            }
        }
        assert_ne!(cap.normals, mesh.normals());
    }

    #[test]
    fn normals_of_a_ball_are_exact_where_its_vertices_are_at_random() {
        for radius in [40.0f64, 80.0, 150.0] {
            let cap = over_grid(|x, y| (radius * radius - x * x - y * y).sqrt());
            for (at, normal) in cap.positions.iter().zip(&cap.normals) {
                assert!((normal - at.coords / radius).norm() < 1e-5, "R {radius}, {at}: {normal:?}");
            }
        }
    }

    #[test]
    fn an_ellipsoid_that_is_nearly_a_ball_keeps_its_own_normals() {
        for axes in [[60.0, 60.0, 61.0], [60.0, 62.0, 60.0], [50.0, 60.0, 70.0]] {
            let [a, b, c]: [f64; 3] = axes;
            let cap = over_grid(|x, y| c * (1.0 - (x / a).powi(2) - (y / b).powi(2)).sqrt());
            for (at, normal) in cap.positions.iter().zip(&cap.normals) {
                let exact = Vector3::new(at.x / (a * a), at.y / (b * b), at.z / (c * c)).normalize();
                // At the border, the vertices are on one side only.
                let is_inside = at.x.abs().max(at.y.abs()) < 14.0;
                assert!(
                    !is_inside || normal.angle(&exact) < 2e-3,
                    "{axes:?}, {at}: {normal:?} for {exact:?}"
                );
            }
        }
    }

    /// As a CAD program cuts a dome: nearly all facets reach from its top to its rim.
    #[test]
    fn a_dome_is_known_from_few_vertices_between_its_top_and_its_rim() {
        const RIM: u32 = 16;
        let radius = 130.0;
        let on_dome = |out: f64, angle: f64| {
            Point3::new(out * angle.cos(), out * angle.sin(), (radius * radius - out * out).sqrt())
        };
        let mut positions = vec![on_dome(0.0, 0.0), on_dome(3.3, 0.0), on_dome(6.6, 0.0)];
        let angle = |step: u32| f64::from(step) / f64::from(RIM) * std::f64::consts::TAU;
        positions.extend((0..RIM).map(|step| on_dome(9.9, angle(step))));
        let mut triangles: Vec<[u32; 3]> = (1..RIM - 1).map(|step| [0, 3 + step, 4 + step]).collect();
        let last = 2 + RIM;
        triangles.extend([[0, 1, 4], [1, 2, 4], [2, 3, 4], [0, last, 1], [1, last, 2], [2, last, 3]]);
        let dome = SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top());
        for (at, normal) in dome.positions.iter().zip(&dome.normals) {
            assert!((normal - at.coords / radius).norm() < 1e-5, "{at}: {normal:?}");
        }
    }

    #[test]
    fn a_chamfer_at_the_rim_of_a_ball_cap_keeps_its_own_normals() {
        // Rings about the axis at even angles of a ball of 50 mm, and a cone beyond that leans 25 degrees farther.
        let (mut positions, mut triangles) = (vec![Point3::new(0.0, 0.0, 50.0)], Vec::new());
        let tilt = |ring: u32| 0.05 * f64::from(ring);
        let rim = 8;
        for ring in 1..=rim + 1 {
            let (sin, cos) = tilt(ring.min(rim)).sin_cos();
            let (out, down) =
                if ring > rim { (tilt(rim) + 25f64.to_radians()).sin_cos() } else { (0.0, 0.0) };
            let (out, down) = (5.0 * down, 5.0 * out);
            let (radius, height) = (50.0 * sin + out, 50.0 * cos - down);
            for step in 0..48u32 {
                let angle = f64::from(step) / 48.0 * std::f64::consts::TAU;
                positions.push(Point3::new(radius * angle.cos(), radius * angle.sin(), height));
                let next = |step: u32| (step + 1) % 48;
                let (own, after) = (1 + 48 * (ring - 1) + step, 1 + 48 * (ring - 1) + next(step));
                if ring == 1 {
                    triangles.push([0, own, after]);
                } else {
                    triangles.extend([[own - 48, own, after], [own - 48, after, after - 48]]);
                }
            }
        }
        let cap = SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top());
        let height = 50.0 * tilt(rim).cos();
        for triangle in 0..cap.triangles.len() {
            let (corners, normals) = cap.corners(triangle);
            let is_cap = corners.iter().all(|at| at.z > height - 1e-9);
            for (at, normal) in corners.iter().zip(normals) {
                let lean = normal.z.acos();
                let of_cone = tilt(rim) + 25f64.to_radians();
                if is_cap {
                    assert!((normal - at.coords / 50.0).norm() < 1e-5, "{at}: {normal:?}");
                } else {
                    assert!((lean - of_cone).abs() < 0.25, "{at}: {normal:?}");
                }
            }
        }
    }
}
