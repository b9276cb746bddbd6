//! Normals of vertices that are on one sphere, as those of a ball cap on a shaft.
//!
//! Two rows of vertices round an axis are on a sphere on many surfaces, but not all vertices that surround another one in two rows:
//! where these are on one sphere, to within what files state of them, and so are others that can be reached from there, it is that of
//! the part. Of a small cap, some of them are at its rim.

use nalgebra::{Matrix2, Matrix4, Point3, Vector2, Vector3, Vector4};

use super::SmoothMesh;
use super::ends::{Surface, Surroundings, precision};
use super::settling::Settling;
use crate::geometry::adjacency::{NONE, Neighbours, facet_normal, sliver_side};
use crate::geometry::fork::{Fork, join};
use crate::geometry::shape_fit::cross_directions;

/// The vertices round a first one in two rows are at least so many, …
const LEAST_VERTICES: usize = 12;
/// … at so many distances from it where some of them are at a rim, as those of a small cap: a profile with its axis has a sphere through
/// one more vertex, …
const LEAST_ROWS: usize = 3;
/// … which differ by more than this share, …
const SAME_ROW: f64 = 0.05;
/// … and leave their tangent plane by so many times what a vertex may be off.
const LEAST_BULGE: f64 = 50.0;
/// A sphere has so many facets, at least.
const LEAST_TRIANGLES: usize = 16;
/// Plane facets of more triangles, as flat sides are, leave a sphere by at most so many times as far as those round a first vertex.
const FACET_TRIANGLES: usize = 2;
const FLAT: f64 = 2.5;
/// The normals of facets differ from that of the sphere by at most this, rad.
const LEAN: f64 = 0.4;
/// Normals of the file that differ from that of the sphere by less than this, rad, are as exact; …
const EXACT: f64 = 1e-3;
/// … those that differ by more than this are not meant for it.
const MOST_OFF: f64 = 0.06;
/// Triangles are looked at so many times on average, at most.
const MOST_VISITS: usize = 4;
/// Meshes with more triangles are fine; a search would take long.
const MOST_TRIANGLES: usize = 300_000;
/// Facets to which a sphere is fitted, at most.
const MOST_FITTED: usize = 400;
/// Rounds in which a sphere is fitted to the facets that it has gained.
const ROUNDS: usize = 4;

#[derive(Clone, Copy)]
struct Sphere {
    center: Point3<f64>,
    /// mm.
    radius: f64,
}

impl Sphere {
    fn distance(&self, at: &Point3<f64>) -> f64 {
        (at - self.center).norm() - self.radius
    }

    fn outward(&self, at: &Point3<f64>) -> Vector3<f64> {
        (at - self.center).try_normalize(0.0).unwrap_or_else(Vector3::zeros)
    }

    /// That with the least squares of the powers of points (Pratt, Direct least-squares fitting of algebraic surfaces, SIGGRAPH 1987).
    fn through(points: &[Point3<f64>]) -> Option<Self> {
        let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
        let middle = Point3::from(sum / points.len() as f64);
        let (mut matrix, mut right) = (Matrix4::zeros(), Vector4::zeros());
        for point in points {
            let from = point - middle;
            let row = Vector4::new(from.x, from.y, from.z, 1.0);
            matrix += row * row.transpose();
            right += row * from.norm_squared();
        }
        let solution = matrix.cholesky()?.solve(&right);
        let to_center = solution.xyz() / 2.0;
        let radius = (solution.w + to_center.norm_squared()).sqrt();
        radius.is_finite().then(|| Self { center: middle + to_center, radius })
    }
}

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

/// Replaces normals that are `estimated` by those of the spheres that their vertices show, as exact as those of a file: they are not
/// estimated any more, and have no `deviations`. So are those of the file that are nearly right, as averages of the facets round a
/// vertex are. `is_round` are the triangles whose normals are known. At an edge that the facets beyond show, the sphere gets vertices of
/// its own.
pub(super) fn settle(
    mesh: &mut SmoothMesh,
    estimated: &mut Vec<bool>,
    deviations: &mut Vec<f64>,
    is_round: &[bool],
    fork: &dyn Fork,
) {
    if mesh.triangles.len() > MOST_TRIANGLES {
        return;
    }
    let is_open = open(mesh, estimated);
    if !is_open.contains(&true) {
        return;
    }
    let found = balls(mesh, estimated, &is_open, is_round, fork);
    if found.is_empty() {
        return;
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
            if !estimated[vertex] && !is_known[vertex] && is_near {
                estimated[vertex] = true;
                replaced.push(vertex);
            }
        }
    }
    let mut settling = Settling::of(mesh, estimated, deviations);
    for (sphere, triangles, at_edges, way) in &found {
        let normal = |mesh: &SmoothMesh, vertex: u32| {
            let is_open = is_known.get(vertex as usize) == Some(&false);
            is_open.then(|| sphere.outward(&mesh.positions[vertex as usize]) * *way)
        };
        settling.set(triangles, at_edges, normal);
    }
    replaced.into_iter().for_each(|vertex| estimated[vertex] = false);
    let of_balls = found.iter().flat_map(|(_, triangles, ..)| triangles);
    for vertex in of_balls.flat_map(|&triangle| mesh.triangles[triangle]) {
        let vertex = vertex as usize;
        if is_known.get(vertex) != Some(&true) {
            estimated[vertex] = false;
            if let Some(deviation) = deviations.get_mut(vertex) {
                *deviation = 0.0;
            }
        }
    }
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
    let mut is_known = vec![false; mesh.triangles.len()];
    is_known.iter_mut().zip(is_round).for_each(|(known, round)| *known = *round);
    let count = mesh.triangles.len();
    let mut looks = Looks { last: vec![0; count], round: 0, left: MOST_VISITS * count };
    let mut surroundings = None;
    let mut found = Vec::new();
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
            let outward = ball.0.outward(&mesh.positions[other]);
            !estimated[other] && mesh.normals[other].cross(&outward).norm() < EXACT
        };
        if ring.iter().all(is_exact) {
            continue;
        }
        let first = triangle_of[vertex] as usize;
        if first >= is_known.len() || is_known[first] || looks.left == 0 {
            continue;
        }
        let surroundings = surroundings.get_or_insert_with(|| Surroundings::of(mesh, near, fork));
        let Some((sphere, triangles)) = grown(surroundings, ball, first, &is_known, &mut looks) else {
            continue;
        };
        for &triangle in &triangles {
            is_known[triangle] = true;
            mesh.triangles[triangle].iter().for_each(|&vertex| is_tried[vertex as usize] = true);
        }
        let facing = |&triangle: &usize| {
            let corners = mesh.corners(triangle).0;
            facet_normal(corners).dot(&sphere.outward(&corners[0]))
        };
        let way = triangles.iter().map(facing).sum::<f64>().signum();
        let ball = Ball { mesh, sphere, triangles };
        let at_edges = surroundings.at_edges(&ball);
        found.push((sphere, ball.triangles, at_edges, way));
    }
    found
}

/// The sphere of a vertex and those round it in two rows, which have so many distances from it, and how far facets there leave it, mm.
fn ball_at(
    mesh: &SmoothMesh,
    around: &Neighbours,
    vertex: usize,
    near: f64,
    rows: usize,
) -> Option<(Sphere, f64)> {
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
    let sides = around
        .of_vertex(vertex)
        .iter()
        .map(|&other| sphere.distance(&nalgebra::center(&own, &mesh.positions[other as usize])).abs());
    Some((sphere, sides.fold(0.0, f64::max)))
}

/// How far the sides of a triangle are from a sphere at their middles, at most, mm.
fn bulge_on(mesh: &SmoothMesh, sphere: &Sphere, triangle: usize) -> f64 {
    let [a, b, c] = mesh.corners(triangle).0;
    let middles = [[a, b], [b, c], [c, a]].map(|[from, to]| nalgebra::center(&from, &to));
    middles.map(|middle| sphere.distance(&middle).abs()).into_iter().fold(0.0, f64::max)
}

/// The triangles on a sphere that can be reached from one, in ascending order, and the sphere of all their vertices.
fn grown(
    &Surroundings { mesh, ref facets, near }: &Surroundings,
    (mut sphere, usual): (Sphere, f64),
    from: usize,
    is_known: &[bool],
    looks: &mut Looks,
) -> Option<(Sphere, Vec<usize>)> {
    let is_of_few = |triangle: usize| facets.with(triangle).nth(FACET_TRIANGLES).is_none();
    let is_on = |sphere: &Sphere, triangle: usize| {
        let corners = mesh.corners(triangle).0;
        let middle = nalgebra::center(&nalgebra::center(&corners[0], &corners[1]), &corners[2]);
        corners.iter().all(|corner| sphere.distance(corner).abs() <= near)
            && (is_of_few(triangle) || bulge_on(mesh, sphere, triangle) <= FLAT * usual + near)
            && (facet_normal(corners).cross(&sphere.outward(&middle)).norm() < LEAN
                || sliver_side(corners).is_some())
    };
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
                    || !is_on(&sphere, there)
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
        sphere = Sphere::through(&points)?;
    }
    found.retain(|&triangle| is_on(&sphere, triangle));
    found.sort_unstable();
    (found.len() >= LEAST_TRIANGLES).then_some((sphere, found))
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
        let mut estimated = vec![false; cap.positions.len()];
        settle(&mut cap, &mut estimated, &mut Vec::new(), &is_round, &crate::geometry::fork::InTurn);
        assert!(!estimated.contains(&true));
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
