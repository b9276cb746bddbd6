use std::f64::consts::{PI, TAU};

use super::*;
use crate::geometry::fork::InTurn;
use crate::geometry::mesh::TriMesh;
use crate::geometry::space::{Facing, View};

const SECTORS: u32 = 36;

/// A face turned about the y axis with these rings of [along the axis, radius]: vertices of every second ring are between those of
/// the others, as programs set them, so that sides along the profile skip a ring.
fn staggered(rings: &[[f64; 2]]) -> TriMesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (number, &[along, radius]) in rings.iter().enumerate() {
        for sector in 0..SECTORS {
            let angle = TAU * (f64::from(sector) + (number % 2) as f64 / 2.0) / f64::from(SECTORS);
            positions.push(Point3::new(radius * angle.sin(), along, radius * angle.cos()));
        }
    }
    for first in (0..rings.len() as u32 - 2).step_by(2) {
        for sector in 0..SECTORS {
            let next = (sector + 1) % SECTORS;
            let at = |ring: u32, sector: u32| (first + ring) * SECTORS + sector;
            let around = [at(0, sector), at(2, sector), at(2, next), at(0, next)];
            triangles.extend((0..4).map(|side| [at(1, sector), around[side], around[(side + 1) % 4]]));
        }
    }
    TriMesh::new(positions, Vec::new(), triangles).unwrap()
}

/// The rings of a bracelet with an elliptic profile, cut unevenly, and its normal there.
fn bracelet(count: usize) -> Vec<[f64; 2]> {
    let angle = |ring: usize| {
        0.12 * PI + 0.76 * PI * (ring as f64 + 0.3 * (2.1 * ring as f64).sin()) / (count as f64 - 1.0)
    };
    (0..count).map(|ring| [7.2 * angle(ring).cos(), 32.75 + 1.7 * angle(ring).sin()]).collect()
}

fn normal_of_bracelet(at: &Point3<f64>) -> Vector3<f64> {
    let radius = at.x.hypot(at.z);
    let out = (radius - 32.75) / (1.7 * 1.7);
    Vector3::new(out * at.x / radius, at.y / (7.2 * 7.2), out * at.z / radius).normalize()
}

#[test]
fn the_rings_of_a_bracelet_show_its_profile() {
    let mesh = SmoothMesh::new(&staggered(&bracelet(17)), &View::top());
    let (mut error, mut largest_doubt): (f64, f32) = (0.0, 0.0);
    for triangle in 0..mesh.triangles.len() {
        let (corners, normals) = mesh.corners(triangle);
        if corners.iter().any(|at| at.y.abs() > 4.0 || at.z < 10.0) {
            continue;
        }
        for (at, normal) in corners.iter().zip(normals) {
            error = error.max(normal.angle(&normal_of_bracelet(at)));
        }
        largest_doubt = largest_doubt.max(mesh.slope_doubts[triangle]);
    }
    // The profile turns by 0.1 rad from one ring to the next.
    assert!(error < 0.002, "{error} rad");
    assert!((0.5 * error..0.01).contains(&f64::from(largest_doubt)), "{largest_doubt} rad for {error} rad");
}

#[test]
fn faces_are_turned_about_any_axis() {
    let oblique = Facing::towards(Vector3::new(0.3, 0.8, 0.5)).unwrap();
    for view in [View::top(), View::new(oblique, 0.4)] {
        let mesh = SmoothMesh::new(&staggered(&bracelet(17)), &view);
        let estimated = vec![true; mesh.positions.len()];
        let faces = Search::faces(&mesh, &estimated, 1e-4);
        assert_eq!(faces.len(), 1);
        assert_eq!(faces[0].triangles.len(), mesh.triangles.len());
        let axis = view.vector(Vector3::y());
        assert!(faces[0].axis.direction.cross(&axis).norm() < 1e-6);
    }
}

#[test]
fn vertices_near_the_first_ring_of_a_closed_profile_are_beside_its_rings() {
    const COUNT: usize = 24;
    let ring = |at: f64| {
        let angle = TAU * at / COUNT as f64;
        [7.2 * angle.cos(), 32.75 + 1.7 * angle.sin()]
    };
    let rings: Vec<RingPlace> =
        (0..COUNT).map(|number| RingPlace { at: ring(number as f64), deviation: 0.0 }).collect();
    let profile = Profile::through(&rings, true, [false; 2]).unwrap();
    let mut count = 0;
    for number in 0..COUNT {
        for step in [-1e-3, -1e-5, 0.0, 1e-5, 1e-3] {
            let [along, radius] = ring(number as f64 + step);
            let off = 1.0 + 1e-5;
            let at = [along * off, 32.75 + (radius - 32.75) * off];
            let Some(place) = profile.place(&[profile.at_ring(number)], at, 1e-3) else { continue };
            let before = (number + COUNT - 1) % COUNT;
            let near = [before, number, (number + 1) % COUNT];
            assert!(profile.rings_beside(&place).iter().all(|ring| near.contains(ring)), "{number} {step}");
            count += 1;
        }
    }
    assert_eq!(count, 5 * COUNT);
}

#[test]
fn a_square_cushion_is_not_turned() {
    const STEPS: i32 = 12;
    let height = |x: f64, y: f64| 12.0 - (x.powi(4) + y.powi(4)) / 5e3;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for row in -STEPS..=STEPS {
        for column in -STEPS..=STEPS {
            let (x, y) = (f64::from(column), f64::from(row));
            positions.push(Point3::new(x, y, height(x, y)));
            if row > -STEPS && column > -STEPS {
                let d = positions.len() as u32 - 1;
                let [a, b, c] = [d - 2 * STEPS as u32 - 2, d - 2 * STEPS as u32 - 1, d - 1];
                triangles.extend([[a, b, d], [a, d, c]]);
            }
        }
    }
    let mesh = SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top());
    let estimated = vec![true; mesh.positions.len()];
    assert!(Search::faces(&mesh, &estimated, 1e-4).is_empty());
}

#[test]
fn where_the_facets_show_as_much_nothing_changes() {
    let mut mesh = SmoothMesh::new(&staggered(&bracelet(17)), &View::top());
    let before = mesh.clone();
    let mut estimates = Estimates::new(vec![true; mesh.positions.len()], Vec::new());
    let without_doubt = || vec![0.0; before.triangles.len()];
    let found = found(&before, &estimates.is_estimated, &[], 1e-4, without_doubt, &InTurn);
    found.settle(&mut mesh, &mut estimates);
    assert_eq!(mesh, before);
    assert!(!estimates.is_estimated.contains(&false));
}
