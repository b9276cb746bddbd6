//! Shallow caps of spheres, for example the crowned face of a button.
//!
//! Such a face has few vertices inside its outline, and at each of them some neighbours in two rows are at
//! the outline. Beside a fillet, these neighbours are on no sphere. The facets of the cap turn little,
//! though, and those of the fillet turn away. So facets that can be reached from one facet and face nearly as
//! it does have their corners on one sphere, to within the precision of the file.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Point3, SMatrix, SVector, Vector3};

use super::SmoothMesh;
use super::ends::range;
use super::rivals::mean_normal;
use crate::geometry::adjacency::{NONE, facet_normal, sliver_side};
use crate::geometry::shape_fit::cross_directions;
use crate::geometry::sphere::Sphere;

/// A cap shows in at least this many corners: three more than the number that some quadric always fits.
const LEAST_VERTICES: usize = 12;
/// Facets are searched that turn from a first one by at most these angles, rad. The shallowest caps come
/// first.
const TURNS: [f64; 3] = [0.02, 0.08, 0.3];
/// At most this many facets round a first one are searched.
const MOST_AROUND: usize = 400;
/// At most this many first facets are tried, the largest ones first.
const MOST_TRIES: usize = 48;
/// The corners leave the plane of a cap by at least this many times the tolerance of a vertex (`near`).
const LEAST_BULGE: f64 = 20.0;
/// The corners are certainly on a cap if they leave its sphere by at most this share of the tolerance of a
/// vertex (`near`), root mean square. [`OF_ROUNDING`] is the other limit; the larger one applies.
const EXACT: f64 = 0.1;
/// The corners are certainly on a cap if they leave its sphere by at most this many standard deviations of
/// their rounding, root mean square. [`EXACT`] is the other limit; the larger one applies.
const OF_ROUNDING: f64 = 3.0;
/// The corners leave every other quadric by more than this, root mean square, if the face is scaled to size 1
/// in all directions. Faces from CAD programs leave it by 0.014 to 0.1. Corners that are on another quadric
/// leave it by 0.000002 where files round them.
const LEAST_OTHER: f64 = 5e-3;
/// The corners leave the sphere by less than this share of the distance by which they leave every other
/// quadric.
const OF_OTHER: f64 = 0.02;

/// The spheres of shallow caps, each with a facet from which the others can be reached; `is_open` are the triangles that may be of one.
/// Vertices may be off by `near`, mm.
pub(super) fn shown(mesh: &SmoothMesh, is_open: impl Fn(usize) -> bool, near: f64) -> Vec<(Sphere, usize)> {
    // Areas are not negative, so that their bits are in their order; of equal ones, the first comes first.
    let area = |triangle: usize| {
        let [a, b, c] = mesh.corners(triangle).0;
        (b - a).cross(&(c - a)).norm_squared().to_bits()
    };
    let seeds = (0..mesh.triangles.len()).filter(|&triangle| is_open(triangle));
    let mut seeds: BinaryHeap<_> = seeds.map(|triangle| (area(triangle), Reverse(triangle))).collect();
    let mut search = Search { mesh, is_open, last_walk: vec![0; mesh.triangles.len()], walk: 0 };
    let (mut found, mut tries) = (Vec::new(), 0);
    while let Some((_, Reverse(seed))) = seeds.pop().filter(|_| tries < MOST_TRIES) {
        if search.last_walk[seed] > 0 {
            continue;
        }
        tries += 1;
        for turn in TURNS {
            let triangles = search.around(seed, turn);
            let points = mesh.corner_points(&triangles);
            if points.len() < LEAST_VERTICES
                || bulge(&points, mean_normal(mesh, &triangles)) < LEAST_BULGE * near
            {
                continue;
            }
            if let Some(sphere) = cap(mesh, &triangles, &points, near) {
                found.push((sphere, seed));
            }
            break;
        }
    }
    found
}

struct Search<'a, F> {
    mesh: &'a SmoothMesh,
    /// Whether a triangle may be of a cap.
    is_open: F,
    /// For each triangle, the number of the last walk that reached it; 0 if none did.
    last_walk: Vec<u32>,
    /// The number of walks so far.
    walk: u32,
}

impl<F: Fn(usize) -> bool> Search<'_, F> {
    /// The facets that can be reached from a first one through others that turn from it by at most `turn`,
    /// rad.
    fn around(&mut self, seed: usize, turn: f64) -> Vec<usize> {
        let mesh = self.mesh;
        let (normal, least) = (facet_normal(mesh.corners(seed).0), turn.cos());
        self.walk += 1;
        self.last_walk[seed] = self.walk;
        let mut found = vec![seed];
        let mut next = 0;
        while next < found.len() && found.len() < MOST_AROUND {
            let here = found[next];
            next += 1;
            for side in 3 * here..3 * here + 3 {
                let there = mesh.continued[side] as usize / 3;
                if mesh.continued[side] == NONE
                    || self.last_walk[there] == self.walk
                    || !(self.is_open)(there)
                {
                    continue;
                }
                let corners = mesh.corners(there).0;
                if sliver_side(corners).is_none() && facet_normal(corners).dot(&normal) >= least {
                    self.last_walk[there] = self.walk;
                    found.push(there);
                }
            }
        }
        found
    }
}

/// How far points are apart along a direction, mm.
fn bulge(points: &[Point3<f64>], normal: Vector3<f64>) -> f64 {
    let [low, high] = range(points.iter().map(|point| point.coords.dot(&normal)));
    high - low
}

/// The sphere on which the corners of some facets are, and on no other quadric.
fn cap(mesh: &SmoothMesh, triangles: &[usize], points: &[Point3<f64>], near: f64) -> Option<Sphere> {
    let sphere = Sphere::through(points)?;
    let count = points.len() as f64;
    let own = points.iter().map(|at| sphere.distance(at).powi(2)).sum::<f64>();
    let limit = (EXACT * near).max(OF_ROUNDING * mesh.rounding);
    if own > limit * limit * count {
        return None;
    }
    is_alone(points, mean_normal(mesh, triangles), limit).then_some(sphere)
}

/// Whether points on one sphere, which may be off by `off`, mm, are on no other quadric. All points on two
/// planes, as on two rings of a turned part or on two meridians of a barrel, are on the quadric of these
/// planes. Points on a cone or on the rim of an oval are on the quadric of that shape.
fn is_alone(points: &[Point3<f64>], normal: Vector3<f64>, off: f64) -> bool {
    let count = points.len() as f64;
    let center = Point3::from(points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / count);
    let reach = points.iter().map(|point| (point - center).norm()).fold(0.0, f64::max);
    let bulge = bulge(points, normal);
    let (first, second) = cross_directions(&normal);
    let mut matrix = SMatrix::<f64, 10, 10>::zeros();
    for point in points {
        let from = point - center;
        let [x, y, z] = [from.dot(&first) / reach, from.dot(&second) / reach, from.dot(&normal) / bulge];
        let row = SVector::<f64, 10>::from([1.0, x, y, z, x * x, x * y, y * y, x * z, y * z, z * z]);
        matrix += row * row.transpose() / count;
    }
    // The first one is that of the sphere.
    let mut squares: Vec<f64> = matrix.symmetric_eigenvalues().iter().copied().collect();
    squares.sort_by(f64::total_cmp);
    let next = squares[1].max(0.0).sqrt();
    next > LEAST_OTHER && off < OF_OTHER * next * bulge
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::mesh::TriMesh;
    use crate::geometry::space::View;

    /// A face of 20 x 12 mm whose vertices are on its outline, but for some on its middle line, with fillets of 2 mm at its long sides,
    /// which begin in the direction of the face.
    fn crowned(height: impl Fn(f64, f64) -> f64) -> SmoothMesh {
        let mut rows: Vec<Vec<Point3<f64>>> = Vec::new();
        let on_face = |x: f64, y: f64| Point3::new(x, y, height(x, y));
        let along =
            |count: u32| (0..=count).map(move |step| 20.0 * f64::from(step) / f64::from(count) - 10.0);
        let fillet = |side: f64, turn: f64| {
            let on_fillet = |x: f64| {
                let slope = (height(x, side * 6.0) - height(x, side * (6.0 - 1e-4))) / 1e-4;
                let lean = -slope.atan();
                let out = 2.0 * ((lean + turn).sin() - lean.sin());
                let down = 2.0 * (lean.cos() - (lean + turn).cos());
                on_face(x, side * 6.0) + Vector3::new(0.0, side * out, -down)
            };
            along(20).map(on_fillet).collect::<Vec<_>>()
        };
        rows.extend([0.9, 0.6, 0.3].map(|turn| fillet(-1.0, turn)));
        rows.push(along(20).map(|x| on_face(x, -6.0)).collect());
        rows.push(along(4).map(|x| on_face(x, 0.0)).collect());
        rows.push(along(20).map(|x| on_face(x, 6.0)).collect());
        rows.extend([0.3, 0.6, 0.9].map(|turn| fillet(1.0, turn)));
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for pair in rows.windows(2) {
            let [lower, upper] = [&pair[0], &pair[1]];
            let [first, second] = [positions.len() as u32, positions.len() as u32 + lower.len() as u32];
            let (mut here, mut there) = (0, 0);
            while here + 1 < lower.len() || there + 1 < upper.len() {
                let ends = [lower.get(here + 1), upper.get(there + 1)]
                    .map(|end| end.map_or(f64::INFINITY, |at| at.x));
                let (low, up) = (first + here as u32, second + there as u32);
                if ends[0] <= ends[1] {
                    triangles.push([low, low + 1, up]);
                    here += 1;
                } else {
                    triangles.push([low, up + 1, up]);
                    there += 1;
                }
            }
            positions.extend(lower);
        }
        positions.extend(rows.last().into_iter().flatten());
        SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top())
    }

    fn caps_of(mesh: &SmoothMesh) -> Vec<f64> {
        shown(mesh, |_| true, 1e-4).into_iter().map(|(sphere, _)| sphere.radius).collect()
    }

    #[test]
    fn a_crowned_face_between_fillets_has_the_normals_of_its_sphere() {
        for radius in [150.0f64, 500.0, 2000.0] {
            for sign in [1.0, -1.0] {
                let z = |x: f64, y: f64| sign * ((radius * radius - x * x - y * y).sqrt() - radius);
                let mesh = crowned(z);
                // At an end of the edge, the fillet has vertices of its own.
                for (corners, normals) in (0..mesh.triangles.len()).map(|triangle| mesh.corners(triangle)) {
                    if corners.iter().any(|at| at.y.abs() > 6.0 + 1e-9) {
                        continue;
                    }
                    for (at, normal) in corners.iter().zip(normals) {
                        let exact = Vector3::new(sign * at.x, sign * at.y, at.z * sign + radius) / radius;
                        assert!((normal - exact).norm() < 1e-5, "R {}, {at}: {normal:?}", sign * radius);
                    }
                }
            }
        }
    }

    #[test]
    fn no_other_crowned_face_is_a_cap() {
        let radius = 500.0f64;
        let arc = |radius: f64, x: f64| (radius * radius - x * x).sqrt() - radius;
        for times in [1.1, 2.0, 10.0] {
            // A torus, and an ellipsoid.
            assert!(caps_of(&crowned(|x, y| arc(radius, x) + arc(times * radius, y))).is_empty());
            let ellipsoid = |x: f64, y: f64| arc(radius, x.hypot(y / times));
            assert!(caps_of(&crowned(ellipsoid)).is_empty());
        }
        for slope in [0.003, 0.03, 0.3] {
            assert!(caps_of(&crowned(|x, y| -slope * x.hypot(y))).is_empty());
        }
        assert!(caps_of(&crowned(|x, _| arc(radius, x))).is_empty());
        assert!(caps_of(&crowned(|_, _| 0.0)).is_empty());
    }

    /// Two rings of a turned face are on a sphere, whatever its profile.
    #[test]
    fn two_rings_and_a_tip_show_no_cap() {
        const COUNT: u32 = 24;
        for tip in [None, Some(0.5)] {
            let mut positions: Vec<Point3<f64>> = [(10.0, 0.0), (6.0, 0.2)]
                .into_iter()
                .flat_map(|(out, height): (f64, f64)| {
                    (0..COUNT).map(move |step| {
                        let angle = f64::from(step) / f64::from(COUNT) * std::f64::consts::TAU;
                        Point3::new(out * angle.cos(), out * angle.sin(), height)
                    })
                })
                .collect();
            let next = |step: u32| (step + 1) % COUNT;
            let mut triangles: Vec<[u32; 3]> = (0..COUNT)
                .flat_map(|step| {
                    let [a, b, c, d] = [step, next(step), COUNT + next(step), COUNT + step];
                    [[a, b, c], [a, c, d]]
                })
                .collect();
            if let Some(tip) = tip {
                positions.push(Point3::new(0.0, 0.0, 0.2 + 6.0 * 0.05 + tip * 1e-9));
                triangles.extend((0..COUNT).map(|step| [COUNT + step, COUNT + next(step), 2 * COUNT]));
            }
            let mesh =
                SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top());
            assert!(caps_of(&mesh).is_empty());
        }
    }

    /// Two arcs that mirror each other are on a sphere, too.
    #[test]
    fn the_stave_of_a_barrel_is_no_cap() {
        for (profile, sides) in [(80.0f64, 12), (80.0, 16), (200.0, 12), (30.5, 24)] {
            let rows = (0..=12).map(|row| 5.0 * f64::from(row) - 30.0);
            let across = |y: f64| 30.0 - profile + (profile * profile - y * y).sqrt();
            let (sin, cos) = (std::f64::consts::PI / f64::from(sides)).sin_cos();
            let both = |y: f64| [-sin, sin].map(|sin| Point3::new(across(y) * sin, y, across(y) * cos));
            let positions: Vec<_> = rows.flat_map(both).collect();
            let triangles: Vec<_> =
                (0..12).map(|row| 2 * row).flat_map(|a| [[a, a + 1, a + 3], [a, a + 3, a + 2]]).collect();
            let mesh =
                SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top());
            assert!(caps_of(&mesh).is_empty(), "{profile}, {sides}");
        }
    }
}
