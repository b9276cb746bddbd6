//! Normals of parts with finely cut profiles whose coordinates are rounded, against the formulas of the parts.

use std::f64::consts::TAU;

use nalgebra::{Point3, Rotation3, Vector3};

use crate::geometry::mesh::TriMesh;
use crate::geometry::smooth_mesh::SmoothMesh;
use crate::geometry::space::View;

/// A surface over two parameters, along the profile in mm and from 0 to 1 across it, with its unit normal.
type Surface<'a> = &'a dyn Fn(f64, f64) -> (Point3<f64>, Vector3<f64>);

/// How a surface is cut into facets.
struct Cut {
    /// From one row to the next, mm.
    step: f64,
    rows: u32,
    sectors: u32,
    /// 0 or 1: along which diagonal; 2: along both in turn.
    diagonal: u32,
}

/// The vertices along the profile are about its middle; `write` is what the file states.
fn mesh(
    surface: Surface,
    cut: &Cut,
    write: impl Fn(Point3<f64>) -> Point3<f64>,
) -> (SmoothMesh, Vec<Vector3<f64>>) {
    let Cut { step, rows, sectors, diagonal } = *cut;
    let (mut positions, mut exact, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..=rows {
        for sector in 0..=sectors {
            let along = (f64::from(row) - f64::from(rows) / 2.0) * step;
            let (at, normal) = surface(along, f64::from(sector) / f64::from(sectors));
            positions.push(write(at));
            let is_rim = row.min(rows - row) < 4 || sector.min(sectors - sector) < 2;
            exact.push(if is_rim { Vector3::zeros() } else { normal });
            if row > 0 && sector > 0 {
                let d = row * (sectors + 1) + sector;
                let [a, b, c] = [d - sectors - 2, d - sectors - 1, d - 1];
                match diagonal == 1 || diagonal == 2 && (row + sector) % 2 == 1 {
                    true => triangles.extend([[a, c, b], [b, c, d]]),
                    false => triangles.extend([[a, c, d], [a, d, b]]),
                }
            }
        }
    }
    let mesh = TriMesh::new(positions, Vec::new(), triangles).unwrap();
    (SmoothMesh::new(&mesh, &View::top()), exact)
}

/// The largest angle between the normals of a mesh and the exact ones of its first vertices, rad, where there are any.
fn largest_error((mesh, exact): &(SmoothMesh, Vec<Vector3<f64>>)) -> f64 {
    let inner = exact.iter().zip(&mesh.normals).filter(|(exact, _)| **exact != Vector3::zeros());
    inner.map(|(exact, normal)| exact.angle(normal)).fold(0.0, f64::max)
}

/// The upper half of a part turned about the x axis, by its radius and the slope of that.
fn turned(profile: impl Fn(f64) -> [f64; 2]) -> impl Fn(f64, f64) -> (Point3<f64>, Vector3<f64>) {
    move |along, share| {
        let ([radius, slope], angle) = (profile(along), (share - 0.5) * TAU / 2.0);
        let outward = Vector3::new(0.0, angle.sin(), angle.cos());
        let normal = (outward - Vector3::x() * slope).normalize();
        (Point3::new(along, 0.0, 0.0) + outward * radius, normal)
    }
}

fn barrel(along: f64) -> [f64; 2] {
    let fall = (60.0f64 * 60.0 - along * along).sqrt();
    [20.0 - 60.0 + fall, -along / fall]
}

fn rounded(decimals: i32) -> impl Fn(Point3<f64>) -> Point3<f64> {
    let scale = 10f64.powi(decimals);
    move |at| at.map(|value| (value * scale).round() / scale)
}

#[test]
fn facets_of_turned_parts_that_rounding_lays_in_one_plane_are_no_flat_sides() {
    let hourglass = |along: f64| {
        let fall = (50.0f64 * 50.0 - along * along).sqrt();
        [15.0 + 50.0 - fall, along / fall]
    };
    let parts: [Surface; 2] = [&turned(barrel), &turned(hourglass)];
    for (decimals, step, sectors) in [(3, 0.25, 24), (3, 0.25, 6), (3, 0.1, 16), (2, 0.25, 12), (2, 0.5, 24)]
    {
        for (part, diagonal) in parts.into_iter().flat_map(|part| [0, 1, 2].map(|diagonal| (part, diagonal)))
        {
            let cut = Cut { step, rows: 60, sectors, diagonal };
            let error = largest_error(&mesh(part, &cut, rounded(decimals)));
            // Rounding turns facets along the profile. Half a sector is 0.06 rad and more.
            let limit = 10f64.powi(-decimals) / step;
            assert!(error < limit, "{decimals} decimals, {step} mm, {sectors}, {diagonal}: {error} rad");
        }
    }
}

#[test]
fn a_few_rows_of_a_fine_profile_are_no_extruded_strip() {
    // The section is an ellipse that shrinks towards both ends.
    let loft = |along: f64, share: f64| {
        let size = |along: f64| 1.0 - 0.3 * (along / 30.0).powi(2);
        let (slope, angle) = (-0.6 * along / 900.0, (share - 0.5) * 2.4);
        let at = Point3::new(along, 18.0 * size(along) * angle.sin(), 12.0 * size(along) * angle.cos());
        let lengthwise = Vector3::new(1.0, 18.0 * slope * angle.sin(), 12.0 * slope * angle.cos());
        let across = Vector3::new(0.0, 18.0 * angle.cos(), -12.0 * angle.sin());
        (at, lengthwise.cross(&across).normalize())
    };
    let error = largest_error(&mesh(&loft, &Cut { step: 0.1, rows: 100, sectors: 12, diagonal: 0 }, |at| at));
    assert!(error < 0.02, "{error} rad");
}

#[test]
fn narrow_rows_of_a_cone_far_from_the_origin_show_no_sphere() {
    let turn = Rotation3::from_euler_angles(0.0, 0.0, 0.7);
    let cone = turned(|along| [15.0 + 0.2 * along, 0.2]);
    let tilted = |along: f64, share: f64| {
        let (at, normal) = cone(along, share);
        (turn * at, turn * normal)
    };
    let far =
        |at: Point3<f64>| (at + Vector3::new(9000.0, 6300.0, 2700.0)).map(|value| f64::from(value as f32));
    let error = largest_error(&mesh(&tilted, &Cut { step: 0.25, rows: 80, sectors: 12, diagonal: 0 }, far));
    assert!(error < 0.005, "{error} rad");
}

#[test]
fn rows_of_a_bottle_shoulder_that_are_parallel_by_rounding_are_no_columns() {
    let shoulder =
        turned(|along| [13.0 + 5.0 * (along / 6.0).tanh(), 5.0 / 6.0 / (along / 6.0).cosh().powi(2)]);
    let error =
        largest_error(&mesh(&shoulder, &Cut { step: 0.1, rows: 300, sectors: 16, diagonal: 2 }, rounded(3)));
    assert!(error < 0.02, "{error} rad");
}

/// A part turned about the z axis, from rings by their radius and height, mm, and so many sectors.
fn rings(profile: &[[f64; 2]], sectors: u32) -> TriMesh {
    let (mut positions, mut triangles) = (vec![Point3::new(0.0, 0.0, profile[0][1])], Vec::new());
    for (ring, &[radius, height]) in (0u32..).zip(&profile[1..]) {
        for sector in 0..sectors {
            let angle = f64::from(sector) / f64::from(sectors) * TAU;
            positions.push(Point3::new(radius * angle.cos(), radius * angle.sin(), height));
            let next = (sector + 1) % sectors;
            let [own, after] = [sector, next].map(|sector| 1 + sectors * ring + sector);
            match ring {
                0 => triangles.push([0, own, after]),
                _ => triangles.extend([[own - sectors, own, after], [own - sectors, after, after - sectors]]),
            }
        }
    }
    TriMesh::new(positions, Vec::new(), triangles).unwrap()
}

/// The upper side of a watch back: a dome of a ball, a step that slopes by an angle, rad, and a flat cone.
fn watch_back(slope: f64, rows: &[f64]) -> (Vec<[f64; 2]>, [f64; 3]) {
    let (ball, rim, cone) = (120.0f64, 10.0, 0.2);
    let height = |radius: f64| (ball * ball - radius * radius).sqrt() - ball;
    let mut profile: Vec<[f64; 2]> = rows.iter().map(|&radius| [radius, height(radius)]).collect();
    let foot = [rim + 1.4, height(rim) - 1.4 * slope.tan()];
    profile.extend([[rim, height(rim)], foot, [foot[0] + 5.0, foot[1] - 5.0 * cone]]);
    (profile, [ball, rim, cone])
}

#[test]
fn the_sloping_step_of_a_watch_back_has_edges_on_both_sides() {
    for (slope, sectors) in [(0.45, 16), (0.45, 33), (0.6, 16), (0.6, 48)] {
        let (profile, [ball, rim, cone]) = watch_back(slope, &[0.0, 3.3, 6.6]);
        let part = SmoothMesh::new(&rings(&profile, sectors), &View::top());
        for triangle in 0..part.triangles.len() {
            let (corners, normals) = part.corners(triangle);
            let out = corners.iter().map(|at| at.coords.xy().norm()).fold(0.0, f64::max);
            for (at, normal) in corners.iter().zip(normals) {
                let outward = Vector3::new(at.x, at.y, 0.0).normalize();
                let exact = match out {
                    out if out < rim + 0.1 => (at + Vector3::z() * ball).coords.normalize(),
                    out if out < rim + 2.0 => outward * slope.sin() + Vector3::z() * slope.cos(),
                    _ => (outward * cone + Vector3::z()).normalize(),
                };
                assert!(normal.angle(&exact) < 0.01, "{slope} {sectors} {at}: {normal:.3?} for {exact:.3?}");
            }
        }
    }
}

/// Each of its two arcs is cut into one row of facets, as coarsely as CAD programs do.
#[test]
fn a_step_of_two_arcs_is_smooth() {
    for turn in [0.3f64, 0.4, 0.5] {
        let arc = [2.0 * turn.sin(), 2.0 * (1.0 - turn.cos())];
        let foot = [10.0 + 2.0 * arc[0], -2.0 * arc[1]];
        let profile =
            [[0.0, 0.0], [5.0, 0.0], [10.0, 0.0], [10.0 + arc[0], -arc[1]], foot, [foot[0] + 5.0, foot[1]]];
        let part = SmoothMesh::new(&rings(&profile, 24), &View::top());
        let regions = part.regions.iter().collect::<std::collections::BTreeSet<_>>();
        assert_eq!((regions.len(), part.positions.len()), (1, 1 + 5 * 24), "{turn}");
    }
}

#[test]
fn a_flat_disc_that_is_cut_from_a_ball_stays_flat() {
    let ball = 20.0f64;
    for (steps, sectors, disc) in
        [(0.1, 48, 0.08), (0.1, 48, 0.12), (0.15, 32, 0.13), (0.2, 24, 0.2), (0.2, 24, 0.5), (0.4, 16, 0.15)]
    {
        let tilts = (0..6).map(|row| disc + f64::from(row) * steps);
        let profile = std::iter::once([0.0, ball * f64::cos(disc)])
            .chain(tilts.map(|tilt| [ball * tilt.sin(), ball * tilt.cos()]));
        let mesh = rings(&profile.collect::<Vec<_>>(), sectors);
        // CAD programs put no vertex into a plane face.
        let rest = mesh.triangles().iter().filter(|corners| !corners.contains(&0)).copied();
        let disc_facets = (2..sectors).map(|sector| [1, sector, sector + 1]);
        let mesh =
            TriMesh::new(mesh.positions().to_vec(), Vec::new(), disc_facets.chain(rest).collect()).unwrap();
        let part = SmoothMesh::new(&mesh, &View::top());
        let of_disc = part.slope_doubts.iter().take(sectors as usize - 2);
        let most = of_disc.copied().fold(0.0, f32::max);
        assert!(most < 1e-4, "{steps} {disc}: {most} rad in doubt");
        for triangle in 0..part.triangles.len() {
            let (corners, normals) = part.corners(triangle);
            for (at, normal) in corners.iter().zip(normals) {
                let exact =
                    if triangle < sectors as usize - 2 { Vector3::z() } else { at.coords.normalize() };
                assert!(normal.angle(&exact) < 1e-4, "{steps} {disc} {at}: {normal:?} for {exact:?}");
            }
        }
    }
}

/// As OpenSCAD cuts balls: its rings are half a step from the poles.
#[test]
fn the_polygon_at_the_pole_of_a_ball_is_of_the_ball() {
    let ball = 20.0f64;
    for sectors in [16, 24, 48u32] {
        let step = TAU / f64::from(sectors);
        let tilts = (0..sectors / 2).map(|row| (f64::from(row) + 0.5) * step);
        let profile = std::iter::once([0.0, ball * f64::cos(step / 2.0)])
            .chain(tilts.map(|tilt| [ball * tilt.sin(), ball * tilt.cos()]));
        let mesh = rings(&profile.collect::<Vec<_>>(), sectors);
        let rest = mesh.triangles().iter().filter(|corners| !corners.contains(&0)).copied();
        let pole = (2..sectors).map(|sector| [1, sector, sector + 1]);
        let mesh = TriMesh::new(mesh.positions().to_vec(), Vec::new(), pole.chain(rest).collect()).unwrap();
        let part = SmoothMesh::new(&mesh, &View::top());
        let (corners, normals) = part.corners(0);
        for (at, normal) in corners.iter().zip(normals) {
            assert!(normal.angle(&at.coords) < 1e-4, "{sectors} {at}: {normal:?}");
        }
    }
}

/// Each facet of the fan is in one plane with the next, and they fill a circle.
#[test]
fn the_fine_fan_at_the_top_of_a_dome_is_no_flat_side() {
    let ball = 168.0f64;
    let profile = [0.0, 5.1, 6.8, 10.2].map(|radius| [radius, (ball * ball - radius * radius).sqrt()]);
    let part = SmoothMesh::new(&rings(&profile, 200), &View::top());
    for (at, normal) in part.positions.iter().zip(&part.normals) {
        assert!(normal.angle(&at.coords) < 1e-5, "{at}: {normal:?}");
    }
}
