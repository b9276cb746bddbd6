use super::*;
use crate::geometry::facing_part::FacingPart;
use crate::geometry::height_field::Grid;
use crate::geometry::mesh::TriMesh;
use crate::geometry::space::{Facing, View};

/// The strip between two rings about the z axis, each with its angles, rad, from the first to the last of them; the next vertex is
/// taken on the ring that is behind.
fn strip(positions: &mut Vec<Point3<f64>>, triangles: &mut Vec<[u32; 3]>, rings: [(f64, f64, &[f64]); 2]) {
    let first = [0, 1].map(|ring: usize| {
        let (radius, height, angles) = rings[ring];
        let start = positions.len() as u32;
        positions.extend(
            angles.iter().map(|angle| Point3::new(radius * angle.cos(), radius * angle.sin(), height)),
        );
        start
    });
    let (low, high) = (rings[0].2, rings[1].2);
    let (mut i, mut j) = (0, 0);
    while i + 1 < low.len() || j + 1 < high.len() {
        let (one, other) = (first[0] + i as u32, first[1] + j as u32);
        if j + 1 == high.len() || (i + 1 < low.len() && low[i + 1] <= high[j + 1]) {
            triangles.push([one, one + 1, other]);
            i += 1;
        } else {
            triangles.push([one, other + 1, other]);
            j += 1;
        }
    }
}

fn uneven(count: usize, seed: u64) -> Vec<f64> {
    let mut state = seed;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
    };
    let inner = |index: usize| if index == 0 || index == count { 0.0 } else { 0.7 };
    (0..=count).map(|index| (index as f64 + inner(index) * random()) * 3.0 / count as f64).collect()
}

fn smooth(positions: Vec<Point3<f64>>, triangles: Vec<[u32; 3]>) -> SmoothMesh {
    SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top())
}

#[test]
fn normals_of_a_can_are_exact_however_unevenly_its_rims_are_cut() {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let (low, high) = (uneven(20, 3), uneven(23, 8));
    strip(&mut positions, &mut triangles, [(33.0, 0.0, &low), (33.0, 60.0, &high)]);
    // A fillet at one rim.
    for step in 0..4 {
        let at = |step: usize| {
            let angle = step as f64 / 4.0 * std::f64::consts::FRAC_PI_2;
            (32.0 + angle.cos(), 60.0 + angle.sin(), high.as_slice())
        };
        strip(&mut positions, &mut triangles, [at(step), at(step + 1)]);
    }
    let can = smooth(positions, triangles);
    let mut found = 0;
    for (at, normal) in can.positions.iter().zip(&can.normals) {
        if (at.coords.xy().norm() - 33.0).abs() < 1e-9 {
            let radial = Vector3::new(at.x, at.y, 0.0).normalize();
            assert!((normal - radial).norm() < 1e-6, "{at}: {normal:?}");
            found += 1;
        }
    }
    assert!(found >= 45, "{found}");
}

/// A filleted can of this radius: the length between the fillets, mm, their radius and the number of their chords, and the
/// steps round it. The rings of the fillets are cut at other angles than the rims.
fn filleted_can(radius: f64, between: f64, fillet: f64, chords: usize, steps: usize) -> SmoothMesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let even: Vec<f64> = (0..=steps).map(|step| 3.0 * step as f64 / steps as f64).collect();
    let half = between / 2.0;
    strip(&mut positions, &mut triangles, [(radius, -half, &even), (radius, half, &even)]);
    let rings: Vec<Vec<f64>> = (0..=chords)
        .map(|ring| if ring == 0 { even.clone() } else { uneven(steps + ring, 7 * ring as u64) })
        .collect();
    for end in [-1.0, 1.0] {
        let at = |ring: usize| {
            let angle = ring as f64 / chords as f64 * std::f64::consts::FRAC_PI_2;
            let height = end * (half + fillet * angle.sin());
            (radius - fillet + fillet * angle.cos(), height, rings[ring].as_slice())
        };
        for ring in 0..chords {
            let [near, far] = [at(ring), at(ring + 1)];
            let rings = if end > 0.0 { [near, far] } else { [far, near] };
            strip(&mut positions, &mut triangles, rings);
        }
    }
    smooth(positions, triangles)
}

#[test]
fn filleted_cans_are_known_from_their_vertices() {
    // As CAD programs cut them: fillets in fine and in few chords, short cans, cans that are cut finely round the axis.
    let cans = [
        (20.0, 58.0, 1.0, 9, 23),
        (58.0, 20.0, 3.0, 16, 36),
        (33.0, 40.0, 0.5, 2, 62),
        (20.0, 60.0, 3.0, 4, 70),
    ];
    for (radius, between, fillet, chords, steps) in cans {
        let can = filleted_can(radius, between, fillet, chords, steps);
        let mut found = 0;
        for (triangle, corners) in can.triangles.iter().enumerate() {
            let is_on = |&vertex: &u32| {
                let at = can.positions[vertex as usize];
                (at.coords.xy().norm() - radius).abs() < 1e-9
            };
            if !corners.iter().all(is_on) {
                continue;
            }
            found += 1;
            for &vertex in corners {
                let (at, normal) = (can.positions[vertex as usize], can.normals[vertex as usize]);
                let radial = Vector3::new(at.x, at.y, 0.0).normalize();
                assert!((normal - radial).norm() < 1e-6, "R {radius}, fillet {fillet}, {at}: {normal:?}");
            }
            let doubt = can.slope_doubts.get(triangle).copied().unwrap_or(0.0);
            assert_eq!(doubt, 0.0, "R {radius}, fillet {fillet}");
        }
        assert_eq!(found, 2 * steps, "R {radius}, fillet {fillet}");
    }
}

/// The largest angle between the normals in the middle of a mesh and those of a twisted prism, rad, and the number of these. The prism has
/// a square section with sides from corner to corner of so many mm, and fillets; it turns by `twist`, rad, over 80 mm, in rows. The
/// section of a `corner` of 0 mm is a circle.
fn lean_of_twisted(corner: f64, fillet: f64, chords: u32, twist: f64, rows: u32) -> (f64, usize) {
    let (height, quarter) = (80.0, std::f64::consts::FRAC_PI_2);
    let section = (0..4).flat_map(|side| {
        let last = if corner > 0.0 { chords } else { chords - 1 };
        (0..=last).map(move |step| {
            let middle = quarter * (f64::from(side) + 0.5);
            let out = quarter * (f64::from(side) + f64::from(step) / f64::from(chords));
            let center = Vector3::new(middle.cos(), middle.sin(), 0.0) * (corner * std::f64::consts::SQRT_2);
            let normal = Vector3::new(out.cos(), out.sin(), 0.0);
            [center + normal * fillet, normal]
        })
    });
    let section: Vec<_> = section.collect();
    let count = section.len() as u32;
    let exact = |row: u32, own: &[Vector3<f64>; 2]| {
        let share = f64::from(row) / f64::from(rows);
        let rotation = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), twist * share);
        let [at, normal] = own.map(|vector| rotation * vector);
        // Both the section and the line through a point of it are on the side.
        let line = Vector3::z() * (height / twist) + Vector3::z().cross(&at);
        (
            Point3::from(at + Vector3::z() * (height * share)),
            Vector3::z().cross(&normal).cross(&line).normalize(),
        )
    };
    let vertices = (0..=rows).flat_map(|row| section.iter().map(move |own| exact(row, own)));
    let (positions, normals): (Vec<_>, Vec<_>) = vertices.unzip();
    let cells = (0..rows).flat_map(|row| (0..count).map(move |step| (row * count, step, (step + 1) % count)));
    let triangles = cells.flat_map(|(row, step, next)| {
        let [a, b, c, d] = [row + step, row + next, row + count + next, row + count + step];
        [[a, b, c], [a, c, d]]
    });
    let found = smooth(positions.clone(), triangles.collect());
    let mut most = (0.0, 0);
    for (at, normal) in found.positions.iter().zip(&found.normals) {
        let is_inside = (0.25 * height..0.75 * height).contains(&at.z);
        if let Some(index) = positions.iter().position(|own| is_inside && own == at) {
            most = (f64::max(most.0, normal.angle(&normals[index])), most.1 + 1);
        }
    }
    most
}

#[test]
fn a_twisted_flat_side_is_no_cylinder_although_its_ends_are_on_one() {
    for (corner, fillet, chords, twist, rows) in [
        (18.0, 4.0, 8, 60.0, 40),
        (12.0, 10.0, 25, 60.0, 40),
        (12.0, 10.0, 16, 60.0, 80),
        (12.0, 10.0, 6, 30.0, 20),
    ] {
        let (lean, count) = lean_of_twisted(corner, fillet, chords, f64::to_radians(twist), rows);
        let name = format!("{corner} mm, fillet of {fillet} mm, {twist} deg in {rows} rows");
        assert!(lean < 0.02 && count as u32 >= 4 * chords * (rows / 2 - 1), "{name}: {lean} rad of {count}");
    }
    let (lean, count) = lean_of_twisted(0.0, 22.0, 6, 1.0, 40);
    assert!(lean < 1e-6 && count > 24 * 19, "circle: {lean} rad of {count}");
}

/// The largest angle between the normals of vertices on the cone with this radius at a height of 0 and this slope of its side,
/// and those of the cone, rad, and the number of such vertices.
fn largest_lean(mesh: &SmoothMesh, radius: f64, slope: f64) -> (f64, usize) {
    let vertices = mesh.positions.iter().zip(&mesh.normals);
    let leans = vertices.filter_map(|(at, normal)| {
        let across = at.coords.xy();
        let exact = Vector3::new(across.x, across.y, slope * across.norm());
        let is_on = (across.norm() - (radius - slope * at.z)).abs() < 1e-6;
        is_on.then(|| normal.angle(&exact))
    });
    leans.fold((0.0, 0), |(most, count), lean| (most.max(lean), count + 1))
}

#[test]
fn normals_of_a_cone_are_exact_however_unevenly_its_rings_are_cut() {
    for (radius, slope, between) in
        [(33.0, 0.3, &[60.0][..]), (40.0, -0.1, &[30.0, 60.0]), (30.0, 1.0, &[18.0])]
    {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let (mut low, mut from) = (uneven(19, 3), 0.0);
        for (row, &to) in between.iter().enumerate() {
            let high = uneven(21 + row, 8 + row as u64);
            let rings = [(radius, from, low.as_slice()), (radius, to, &high)];
            strip(&mut positions, &mut triangles, rings.map(|(radius, z, cut)| (radius - slope * z, z, cut)));
            (low, from) = (high, to);
        }
        let (most, count) = largest_lean(&smooth(positions, triangles), radius, slope);
        assert!(most < 1e-6 && count >= 40, "slope {slope}: {most} rad at {count} vertices");
    }
}

/// A cone of one strip of `count` sectors between two rings about the z axis, or a fan to its tip if the upper radius is 0, and its
/// ends, as programs of solid geometry export it: all coordinates have six digits. The upper ring is turned by a share of a sector.
/// `first` is the corner with which the triangles of the side begin.
fn closed_cone([low, high]: [f64; 2], height: f64, count: u32, turned: f64, first: usize) -> SmoothMesh {
    let ring = |radius: f64, z: f64, turned: f64| {
        (0..count).map(move |step| {
            let angle = std::f64::consts::TAU * (f64::from(step) + turned) / f64::from(count);
            let digits = |value: f64| format!("{value:.5e}").parse::<f64>().unwrap();
            Point3::new(digits(radius * angle.cos()), digits(radius * angle.sin()), z)
        })
    };
    let is_fan = high == 0.0;
    let tips = if is_fan { 1 } else { count };
    let upper = ring(high, height, turned).take(tips as usize);
    let positions = ring(low, 0.0, 0.0).chain(upper).collect();
    let mut triangles = Vec::new();
    for step in 0..count {
        let next = (step + 1) % count;
        let rotated = |mut corners: [u32; 3]| {
            corners.rotate_left(first);
            corners
        };
        triangles.push(rotated([step, next, count + step % tips]));
        if !is_fan {
            triangles.push(rotated([next, count + next, count + step]));
        }
        if step > 1 {
            triangles.push([0, step, step - 1]);
            if !is_fan {
                triangles.push([count, count + step - 1, count + step]);
            }
        }
    }
    smooth(positions, triangles)
}

#[test]
fn a_cone_whose_upper_ring_is_near_its_tip_is_no_cylinder() {
    // Every second facet is narrower than a sliver.
    for (count, high) in [(48, 0.01), (48, 0.02), (64, 0.02), (64, 0.05), (100, 0.05), (100, 0.07)] {
        for turned in [0.0, 0.5] {
            let cone = closed_cone([20.0, high], 60.0, count, turned, 0);
            let slope = (20.0 - high) / 60.0;
            for triangle in 0..cone.triangles.len() {
                let (corners, normals) = cone.corners(triangle);
                if corners.iter().all(|at| at.z == corners[0].z) {
                    continue;
                }
                for (at, normal) in corners.iter().zip(normals) {
                    let name = format!("{count} sectors to {high} mm, turned by {turned}, {at}");
                    let across = at.coords.xy();
                    let off = across.norm() - (20.0 - slope * at.z);
                    assert!(off.abs() < 1e-3, "{name}: off by {off} mm");
                    let exact = Vector3::new(across.x, across.y, slope * across.norm());
                    let lean = normal.angle(&exact);
                    assert!(turned > 0.0 || lean < 1e-4, "{name}: {lean} rad");
                }
            }
        }
    }
}

#[test]
fn cones_are_known_from_the_ring_at_their_foot_and_their_tip() {
    // Steep, at right angles, flat, and to a ring about as small as what is welded.
    for (low, high, height) in
        [(20.0, 0.0, 60.0), (20.0, 0.0, 20.0), (30.0, 0.0, 6.0), (20.0, 0.03, 60.0), (20.0, 8.0, 60.0)]
    {
        for (count, first) in
            [24, 33, 48, 100].into_iter().flat_map(|count| [0, 1, 2].map(|first| (count, first)))
        {
            let name = format!("{count} sectors from {low} to {high} mm over {height} mm, corner {first}");
            let cone = closed_cone([low, high], height, count, 0.0, first);
            let sides = count * if high > 0.0 { 2 } else { 1 };
            assert_eq!(cone.cones.len(), sides as usize, "{name}");
            let half_angle = ((low - high) / height).atan();
            for (triangle, found) in &cone.cones {
                assert!((found.half_angle - half_angle).abs() < 1e-5, "{name}: {}", found.half_angle);
                assert!((found.axis.z.abs() - 1.0).abs() < 1e-9, "{name}");
                let doubt = cone.slope_doubts.get(*triangle as usize).copied().unwrap_or(0.0);
                assert_eq!(doubt, 0.0, "{name}");
            }
        }
    }
}

#[test]
fn a_cone_is_met_where_it_is_and_not_where_its_patches_are() {
    // Seen along its axis and across it.
    for (facing, steep) in [(Vector3::z(), 20.0), (Vector3::x(), 60.0), (Vector3::new(0.6, 0.0, 0.8), 30.0)] {
        let view = View::new(Facing::towards(facing).unwrap(), 0.0);
        let mesh = {
            let cone = closed_cone([20.0, 0.0], steep, 24, 0.0, 0);
            TriMesh::new(cone.positions, Vec::new(), cone.triangles).unwrap()
        };
        let exact = Cone {
            apex: view.point(Point3::new(0.0, 0.0, steep)),
            axis: nalgebra::Unit::new_normalize(view.vector(-Vector3::z())),
            half_angle: (20.0f64 / steep).atan(),
        };
        let part = FacingPart::new(&mesh, &view);
        let samples = part.sample(&Grid::over(&part.extents(), 0.7));
        let mut count = 0;
        for (column, row, height) in samples.field.surface_nodes() {
            let at = samples.field.position(column, row);
            let point = Point3::new(at.x, at.y, height);
            // The foot is seen, too, from some sides.
            let is_on_foot = (exact.split(&point).0 - steep).abs() < 0.3;
            if !is_on_foot {
                assert!(exact.distance(&point).abs() < 2e-4, "{facing}, {at:?}: {}", exact.distance(&point));
                count += 1;
            }
        }
        assert!(count > 500, "{count}");
    }
}

#[test]
fn a_cone_and_a_cylinder_are_known_from_coordinates_with_three_decimals() {
    for slope in [0.2, 0.0] {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let (low, high) = (uneven(15, 3), uneven(18, 8));
        let rings = [(33.0, 0.0, low.as_slice()), (33.0 - slope * 60.0, 60.0, &high)];
        strip(&mut positions, &mut triangles, rings);
        positions.iter_mut().for_each(|at| *at = at.map(|value| (value * 1e3).round() / 1e3));
        let round = smooth(positions, triangles);
        let leans = round.positions.iter().zip(&round.normals).map(|(at, normal)| {
            let across = at.coords.xy();
            normal.angle(&Vector3::new(across.x, across.y, slope * across.norm()))
        });
        // Half a micrometre at either end of 60 mm, or over 33 mm round the axis.
        let most = leans.fold(0.0, f64::max);
        assert!(most < 1e-4, "slope {slope}: {most} rad");
    }
}

#[test]
fn rings_of_a_vase_are_no_cones() {
    // Each row of facets between two rings is on a cone. The profile is an arc of 80 mm about a point beside the axis.
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let ring = |step: i32| {
        let tilt = 0.12 * f64::from(step);
        (80.0 * tilt.cos() - 50.0, 80.0 * tilt.sin())
    };
    let angles: Vec<f64> = (0..=20).map(|step| f64::from(step) * 0.15).collect();
    for step in 0..5 {
        let rings = [ring(step), ring(step + 1)].map(|(radius, z)| (radius, z, angles.as_slice()));
        strip(&mut positions, &mut triangles, rings);
    }
    let vase = smooth(positions, triangles);
    for (at, normal) in vase.positions.iter().zip(&vase.normals) {
        let across = at.coords.xy();
        let is_inside = (9.0..40.0).contains(&at.z) && (0.4..2.6).contains(&at.y.atan2(at.x));
        let out = across * (1.0 + 50.0 / across.norm());
        let exact = Vector3::new(out.x, out.y, at.z);
        assert!(!is_inside || normal.angle(&exact) < 0.01, "{at}: {normal:?} for {exact:?}");
    }
}

#[test]
fn the_crown_of_a_roller_between_fillets_is_no_cylinder() {
    // Turned on a lathe: a crown in one chord, which begins its fillets in another direction than a cylinder would.
    for (profile, fillet, steps) in [(28.0, 3.0, 15), (28.0, 3.0, 30), (60.0, 4.0, 18), (60.0, 4.0, 24)] {
        let turn = std::f64::consts::TAU / f64::from(steps);
        let angles: Vec<f64> = (0..=steps / 2).map(|step| f64::from(step) * turn).collect();
        let (end, radius) = (turn / 2.0, 30.0);
        let chords = ((std::f64::consts::FRAC_PI_2 - end) / turn).round().max(2.0) as i32;
        let ring = |index: i32| {
            let beyond = f64::from(index.abs() - 1) * (std::f64::consts::FRAC_PI_2 - end) / f64::from(chords);
            let (center, middle) = (radius - profile, (profile - fillet) * end.sin());
            let across = center + (profile - fillet) * end.cos() + fillet * (end + beyond).cos();
            let height = middle + fillet * (end + beyond).sin();
            (across, f64::from(index.signum()) * height, angles.as_slice())
        };
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let indices = (-chords - 1..=-1).chain(1..=chords + 1);
        for (low, high) in indices.clone().zip(indices.skip(1)) {
            strip(&mut positions, &mut triangles, [ring(low), ring(high)]);
        }
        let roller = smooth(positions, triangles);
        let limit = (profile * end.sin()).abs() + 1e-9;
        for triangle in 0..roller.triangles.len() {
            let (corners, normals) = roller.corners(triangle);
            if corners.iter().all(|at| at.z.abs() < limit) {
                let leans = normals.iter().any(|normal| normal.z.abs() > 1e-3);
                assert!(leans, "{steps} steps, crown of {profile}: {normals:?}");
            }
        }
    }
}

/// Whether all normals of triangles on a cylinder about the z axis are at right angles to it, of which there are `count`.
fn assert_upright(mesh: &SmoothMesh, radius: f64, count: usize, name: &str) {
    let mut found = 0;
    for triangle in 0..mesh.triangles.len() {
        let (corners, normals) = mesh.corners(triangle);
        if corners.iter().all(|at| (at.coords.xy().norm() - radius).abs() < 1e-9) {
            found += 1;
            assert!(normals.iter().all(|normal| normal.z.abs() < 1e-6), "{name}: {normals:?}");
        }
    }
    assert_eq!(found, count, "{name}");
}

#[test]
fn a_long_body_between_cones_is_a_cylinder() {
    // Rings with radius and height. The cones of pens follow one another, are cut into narrow rows, or lean gently.
    let rows = |row: i32| (6.0 - 0.01 * f64::from(row), 40.0 + 0.625 * f64::from(row));
    let narrow_rows: Vec<_> = [(6.0, -50.0)].into_iter().chain((0..=8).map(rows)).collect();
    let two_cones = vec![(1.8, -75.0), (4.8, -55.0), (6.0, -50.0), (6.0, 40.0), (5.0, 45.0)];
    let gentle = vec![(1.8, -75.0), (4.8, -55.0), (6.0, -50.0), (6.0, 40.0), (5.7, 60.0), (4.2, 70.0)];
    let wide_rows = |row: i32| (30.0 - 0.043 * f64::from(row), 19.0 + 4.2 * f64::from(row));
    let barely: Vec<_> = [(30.0, -19.0)].into_iter().chain((0..=4).map(wide_rows)).collect();
    for (name, rings, step) in [
        ("narrow rows", narrow_rows, 0.05),
        ("two cones", two_cones, 0.2),
        ("gentle", gentle, 0.24),
        ("barely leaning", barely, 0.115),
    ] {
        let angles: Vec<f64> = (0..=24).map(|index| f64::from(index) * step).collect();
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for pair in rings.windows(2) {
            let ends = [pair[0], pair[1]].map(|(radius, z)| (radius, z, angles.as_slice()));
            strip(&mut positions, &mut triangles, ends);
        }
        let radius = rings.iter().map(|ring| ring.0).fold(0.0, f64::max);
        assert_upright(&smooth(positions, triangles), radius, 48, name);
    }
}

/// A cylinder of a radius about the z axis that spans 0.5 rad, in facets of a width, mm, from rim to rim. The rims run up and down, their
/// vertices do not face each other, and rows of a fillet begin at them. Every fourth facet is so much wider.
fn between_free_rims(radius: f64, facet: f64, wider: f64) -> SmoothMesh {
    let count = (0.5 * radius / facet) as u32;
    let angle = |step: f64| 0.5 * step / f64::from(count);
    let rim = |side: f64, step: f64| {
        let angle = angle(step);
        // Not an ellipse: on one, a cylinder of another radius with bent lines would have the same rim.
        side * (9.0 + 3.0 * (16.0 * angle).sin() + 12.0 * angle)
    };
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (row, side) in [(2, -1.0), (1, -1.0), (0, -1.0), (0, 1.0), (1, 1.0), (2, 1.0)] {
        for step in 0..=count {
            // The far rim is cut elsewhere.
            let inner = step > 0 && step < count && side > 0.0;
            let widened = if step % 4 == 2 && step < count { wider } else { 0.0 };
            let step = f64::from(step) + widened + if inner { 0.3 * (1.0 - wider) } else { 0.0 };
            let turn = 0.2 * f64::from(row);
            let from_axis = radius - 2.0 * (1.0 - f64::cos(turn));
            let z = rim(side, step) + side * 2.0 * turn.sin();
            positions.push(Point3::new(from_axis * angle(step).cos(), from_axis * angle(step).sin(), z));
        }
    }
    for low in (0..5).flat_map(|row| (0..count).map(move |step| row * (count + 1) + step)) {
        let high = low + count + 1;
        triangles.extend([[low, low + 1, high + 1], [low, high + 1, high]]);
    }
    smooth(positions, triangles)
}

#[test]
fn a_face_with_a_free_outline_is_a_cylinder() {
    for (radius, facet, wider, count) in [(40.0, 2.0, 0.0, 20), (150.0, 0.8, 0.0, 186), (60.0, 1.5, 0.75, 40)]
    {
        let name = format!("radius {radius}");
        assert_upright(&between_free_rims(radius, facet, wider), radius, count, &name);
    }
}

#[test]
fn a_short_body_is_a_cylinder_where_one_arc_begins_at_its_rim() {
    // The vertices beyond the rim are on an arc of 315 mm that begins there, at different heights; an arc of 40 mm follows.
    const STEPS: u32 = 20;
    let on_arc = |z: f64| 30.0 - (315.0 - (315.0f64 * 315.0 - z * z).sqrt());
    let rows = [
        |_: u32| (30.0, -22.0),
        |_: u32| (30.0, 0.0),
        |step: u32| (0.0, [3.0, 6.5, 13.0][step as usize % 3]),
        |_: u32| (26.5, 24.0),
    ];
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for row in rows {
        for step in 0..=STEPS {
            let (radius, z) = row(step);
            let radius = if radius == 0.0 { on_arc(z) } else { radius };
            let angle = 0.15 * f64::from(step);
            positions.push(Point3::new(radius * angle.cos(), radius * angle.sin(), z));
        }
    }
    for low in (0..3).flat_map(|row| (0..STEPS).map(move |step| row * (STEPS + 1) + step)) {
        let high = low + STEPS + 1;
        triangles.extend([[low, low + 1, high + 1], [low, high + 1, high]]);
    }
    assert_upright(&smooth(positions, triangles), 30.0, 40, "short body");
}

#[test]
fn at_an_edge_the_chamfer_keeps_its_own_normals() {
    // A can with a chamfer of 20 degrees, 4 mm long, which its own facets show to be straight.
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let angles: Vec<f64> = (0..=60).map(|step| f64::from(step) * 0.05).collect();
    let tilt = 20.0f64.to_radians();
    let end = (30.0 - 4.0 * tilt.sin(), 25.0 + 4.0 * tilt.cos(), angles.as_slice());
    strip(&mut positions, &mut triangles, [(30.0, -25.0, &angles), (30.0, 25.0, &angles)]);
    strip(&mut positions, &mut triangles, [(30.0, 25.0, &angles), end]);
    let can = smooth(positions, triangles);
    for triangle in 0..can.triangles.len() {
        let (corners, normals) = can.corners(triangle);
        if corners.iter().any(|at| at.z > 25.1) {
            let facet = facet_normal(corners);
            assert!(normals.iter().all(|normal| normal.dot(&facet) > 0.99), "{normals:?} for {facet:?}");
        } else {
            assert!(normals.iter().all(|normal| normal.z.abs() < 1e-6), "{normals:?}");
        }
    }
}

#[test]
fn a_flat_side_between_two_lines_of_a_shaft_stays_flat() {
    const RADIUS: f64 = 12.0;
    // The angles of the facets and of the flat side, rad; rounded as FreeCAD writes STL files.
    for (step, flat, length, is_rounded) in [
        (0.15, 1.2, 30.0, false),
        (0.1, 0.4, 30.0, false),
        (0.23, 0.45, 5.0, false),
        (0.08, 0.63, 36.0, true),
        (0.14, 0.9, 20.0, true),
        (0.25, 0.4, 36.0, true),
    ] {
        let angles: Vec<f64> = (0..20)
            .map(|index| f64::from(index) * step + if index > 8 { flat - step } else { 0.0 })
            .collect();
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        strip(&mut positions, &mut triangles, [(RADIUS, 0.0, &angles), (RADIUS, length, &angles)]);
        if is_rounded {
            positions.iter_mut().for_each(|at| *at = at.map(|value| (value * 1e3).round() / 1e3));
        }
        // Half a micrometre at either edge of a facet, and normals of a cylinder that its facets show only so well.
        let [limit, limit_round] = if is_rounded { [1e-3, 0.03] } else { [1e-6; 2] };
        let shaft = smooth(positions, triangles);
        let mut found = 0;
        for triangle in 0..shaft.triangles.len() {
            let (corners, normals) = shaft.corners(triangle);
            let facet = facet_normal(corners);
            let is_of_flat = facet.dot(&corners[0].coords).abs() < RADIUS * (0.45 * flat).cos();
            found += usize::from(is_of_flat);
            for (corner, normal) in corners.iter().zip(normals) {
                let radial = Vector3::new(corner.x, corner.y, 0.0).normalize();
                let (exact, limit) = if is_of_flat { (facet, limit) } else { (radial, limit_round) };
                let lean = normal.cross(&exact).norm();
                assert!(lean < limit, "step {step}, flat side {flat}, {corner}: {lean} rad");
            }
        }
        assert_eq!(found, 2, "step {step}, flat side {flat}");
    }
}

#[test]
fn a_ball_without_its_middle_ring_has_no_edges() {
    // Its middle row of facets is twice as high as the others, and its rings are as far from one another as on a cylinder.
    const ROWS: i32 = 16;
    let step = std::f64::consts::PI / f64::from(ROWS);
    let angles: Vec<f64> = (0..=10).map(|index| f64::from(index) * 2.0 * step).collect();
    let rings: Vec<(f64, f64)> = (-5..=5)
        .filter(|&ring| ring != 0)
        .map(|ring| (20.0 * (f64::from(ring) * step).cos(), 20.0 * (f64::from(ring) * step).sin()))
        .collect();
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for rows in rings.windows(2) {
        let rings = [0, 1].map(|ring: usize| (rows[ring].0, rows[ring].1, angles.as_slice()));
        strip(&mut positions, &mut triangles, rings);
    }
    let ball = smooth(positions, triangles);
    assert_eq!(ball.regions.iter().max(), Some(&0));
    let is_inside = |at: &Point3<f64>| at.z.abs() < 10.0 && (0.5..3.2).contains(&at.y.atan2(at.x));
    for (at, normal) in ball.positions.iter().zip(&ball.normals).filter(|(at, _)| is_inside(at)) {
        let lean = normal.angle(&at.coords);
        assert!(lean < 0.02, "{at}: {lean} rad");
    }
}

#[test]
fn two_equal_rings_of_a_barrel_are_no_cylinder() {
    // Rings at even steps of a profile of R = 100 mm: the middle strip is on a cylinder.
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let angles: Vec<f64> = (0..=20).map(|step| f64::from(step) * 0.15).collect();
    let ring = |step: i32| {
        let tilt = (f64::from(step) - 0.5) * 0.1;
        (100.0 * tilt.cos() - 70.0, 100.0 * tilt.sin(), angles.as_slice())
    };
    for step in -3..4 {
        strip(&mut positions, &mut triangles, [ring(step), ring(step + 1)]);
    }
    let barrel = smooth(positions, triangles);
    for (at, normal) in barrel.positions.iter().zip(&barrel.normals) {
        let across = at.coords.xy().norm();
        let exact =
            Vector3::new(at.x / across * (across + 70.0), at.y / across * (across + 70.0), at.z).normalize();
        let is_inside = at.z.abs() < 20.0 && (0.4..2.6).contains(&at.y.atan2(at.x));
        assert!(!is_inside || (normal - exact).norm() < 0.01, "{at}: {normal:?} for {exact:?}");
    }
}

#[test]
fn a_hole_that_is_cut_into_the_facets_of_a_shaft_leaves_its_cylinder() {
    const FACETS: u32 = 20;
    const CUT: u32 = 10;
    let at = |step: u32, z: f64| {
        let angle = f64::from(step) * 0.15;
        Point3::new(20.0 * angle.cos(), 20.0 * angle.sin(), z)
    };
    let mut positions: Vec<_> = (0..=FACETS).flat_map(|step| [at(step, 0.0), at(step, 50.0)]).collect();
    let mut triangles = Vec::new();
    for step in (0..FACETS).filter(|step| *step != CUT) {
        let [a, b, c, d] = [2 * step, 2 * step + 2, 2 * step + 3, 2 * step + 1];
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    let facet = [2 * CUT, 2 * CUT + 2, 2 * CUT + 3, 2 * CUT + 1];
    let hole = [(0.3, 20.0), (0.7, 20.0), (0.7, 24.0), (0.3, 24.0)].map(|(share, z)| {
        positions.push(at(CUT, z) + (at(CUT + 1, z) - at(CUT, z)) * share);
        positions.len() as u32 - 1
    });
    for side in 0..4 {
        let next = (side + 1) % 4;
        triangles.push([facet[side], facet[next], hole[next]]);
        triangles.push([facet[side], hole[next], hole[side]]);
    }
    let shaft = smooth(positions, triangles);
    for (at, normal) in shaft.positions.iter().zip(&shaft.normals) {
        let across = Vector3::new(at.x, at.y, 0.0);
        assert!((across.norm() - 20.0).abs() < 1e-6, "{at}");
        assert!((normal - across.normalize()).norm() < 1e-6, "{at}: {normal:?}");
    }
}

#[test]
fn a_sliver_of_a_flat_side_beside_a_fillet_stays_flat() {
    // Programs with polygons for circles let a flat side run into a fillet by one of its facets.
    const STEP: f64 = 0.1;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for step in 0..=15 {
        let angle = (f64::from(step) + 0.5) * STEP;
        let [x, z] = [3.0 * angle.sin(), 3.0 * angle.cos()];
        positions.extend([Point3::new(x, 0.0, z), Point3::new(x, 50.0, z)]);
    }
    for step in 0..15 {
        let [a, b, c, d] = [2 * step, 2 * step + 2, 2 * step + 3, 2 * step + 1];
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    let edge = positions[0];
    let beside = positions.len() as u32;
    positions
        .extend([(-40.0, 0.0), (-40.0, 50.0), (edge.x - 1e-3, 0.0)].map(|(x, y)| Point3::new(x, y, edge.z)));
    triangles.extend([[beside + 2, 0, 1], [beside, beside + 2, 1], [beside, 1, beside + 1]]);
    let bar = smooth(positions, triangles);
    for triangle in 0..bar.triangles.len() {
        let (corners, normals) = bar.corners(triangle);
        let is_sliver = corners.iter().all(|at| at.x > 0.0);
        if !is_sliver && corners.iter().all(|at| (at.z - edge.z).abs() < 1e-9) {
            assert!(normals.iter().all(|normal| normal.z.abs() > 1.0 - 1e-6), "{corners:?}: {normals:?}");
        }
    }
}
