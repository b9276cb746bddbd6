//! Flat sides stay flat and round sides stay round with any shading of a modelling program: its normals are averages of
//! facets, not normals of the surface.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::fmt::Write as _;

use isomark::formats::mesh::{
    self, LengthUnit, MeshFormat, MeshOptions, NormalsFound, PartReading, Shape, UpAxis,
};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::mapping::cylinder::CylinderFit;
use isomark::geometry::mapping::patch::SampledPatch;
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::shading;
use isomark::geometry::space::{Extents, Facing, View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use nalgebra::{Point3, Vector2, Vector3};

use super::forms::{ALL, Normals};
use super::profiles::Profile;

/// Largest allowed deviation of a flat side, mm.
const FLAT: f64 = 0.01;

fn read(name: &str, bytes: &[u8], options: &MeshOptions) -> PartReading {
    mesh::read(bytes, MeshFormat::from_name(name).unwrap(), options, &BTreeMap::new()).unwrap()
}

fn sample(name: &str) -> PartReading {
    let folder = format!("{}/tests/data/parts/shaded", env!("CARGO_MANIFEST_DIR"));
    read(name, &fs_err::read(format!("{folder}/{name}")).unwrap(), &MeshOptions::default())
}

fn mesh_of(reading: &PartReading) -> &TriMesh {
    let Shape::Mesh(mesh) = &reading.shape else { panic!("a mesh was read") };
    mesh
}

fn seen_from(reading: &PartReading, facing: Vector3<f64>) -> FittedSurface {
    let view = View::new(Facing::towards(facing).unwrap(), 0.0);
    FittedSurface::of_part(&FacingPart::new(mesh_of(reading), &view), &FitOptions::default()).unwrap()
}

/// Largest distance from a plane at `height`, within `half` mm of (0, `middle`).
fn unevenness(surface: &FittedSurface, middle: f64, half: f64, height: f64) -> f64 {
    let along = |index: i32| half * f64::from(index) / 20.0;
    let places = (-20..=20).flat_map(|row| (-20..=20).map(move |column| (column, row)));
    let off = |(column, row)| {
        let at = ViewPoint::new(along(column), middle + along(row));
        (surface.sampled_height(at).unwrap_or(f64::INFINITY) - height).abs()
    };
    places.map(off).fold(0.0, f64::max)
}

#[test]
fn flat_tops_of_real_exports_are_flat() {
    for (name, normals) in [
        ("bl34-box.glb", NormalsFound::Averaged),
        ("bl34-bevel-2-auto-smooth.glb", NormalsFound::Averaged),
        ("bl34-bevel-3.glb", NormalsFound::Averaged),
        ("bl34-bevel-8-weighted.glb", NormalsFound::Averaged),
        ("fc020-fillets.obj", NormalsFound::FacetsOnly),
        ("fc020-top-fillets.stl", NormalsFound::FacetsOnly),
    ] {
        let reading = sample(name);
        assert_eq!(reading.facts.normals, normals, "{name}");
        let top = seen_from(&reading, Vector3::z());
        let off = unevenness(&top, 0.0, 19.0, 30.0);
        assert!(off <= FLAT, "{name}: {off} mm");
        assert!(top.doubts().iter().all(|doubt| *doubt == 0.0), "{name}");
        // The sides stand on z = 0 and also have fillets or edges all round.
        for side in [Vector3::x(), -Vector3::y()] {
            let off = unevenness(&seen_from(&reading, side), 15.0, 9.0, 25.0);
            assert!(off <= FLAT, "{name} {side:?}: {off} mm");
        }
    }
}

#[test]
fn the_default_cylinder_of_blender_is_recognised_as_a_cylinder() {
    let reading = sample("bl34-cylinder.glb");
    assert_eq!(reading.facts.normals, NormalsFound::Averaged);
    let side = seen_from(&reading, -Vector3::y());
    let patch = Extents { min: Vector2::new(-400.0, -700.0), max: Vector2::new(400.0, 700.0) };
    let fit = CylinderFit::to(&SampledPatch::under(&side, &patch).unwrap()).unwrap();
    // It has a radius of 1 m; a real part has a few centimetres.
    assert!((fit.cylinder.radius - 1000.0).abs() < 0.01 && fit.residual < 0.005, "{fit:?}");
}

/// How a modelling program weights the polygons round a vertex.
type Weight = fn(angle: f64, area: f64) -> f64;
const WEIGHTS: [(&str, Weight); 4] = [
    ("angle", |angle, _| angle),
    ("area", |_, area| area),
    ("even", |_, _| 1.0),
    ("both", |angle, area| angle * area),
];

/// A bar along y, ±`half` mm long, with a convex, counter-clockwise profile in x and z, as [`averaged`] writes it.
fn shaded_bar(profile: &[[f64; 2]], half: f64, weight: Weight) -> String {
    shaded(profile, half, weight, false)
}

/// The same, with ends that are one polygon each or fans of triangles round their middles.
fn shaded(profile: &[[f64; 2]], half: f64, weight: Weight, are_fans: bool) -> String {
    let count = profile.len();
    let mut points: Vec<Point3<f64>> =
        [-half, half].iter().flat_map(|y| profile.iter().map(|[x, z]| Point3::new(*x, *y, *z))).collect();
    let sides = (0..count).map(|first| {
        let second = (first + 1) % count;
        vec![first, second, count + second, count + first]
    });
    let front: Vec<usize> = (0..count).rev().collect();
    let back: Vec<usize> = (count..2 * count).collect();
    let mut polygons: Vec<Vec<usize>> = sides.collect();
    for end in [front, back] {
        if !are_fans {
            polygons.push(end);
            continue;
        }
        let sum: Vector3<f64> = end.iter().map(|&vertex| points[vertex].coords).sum();
        let middle = points.len();
        points.push(Point3::from(sum / end.len() as f64));
        polygons.extend((0..count).map(|place| vec![end[place], end[(place + 1) % count], middle]));
    }
    averaged(&points, polygons, weight)
}

/// A convex part as an OBJ file of polygons whose normals are averaged over all polygons at a vertex.
fn averaged(points: &[Point3<f64>], mut polygons: Vec<Vec<usize>>, weight: Weight) -> String {
    // Counter-clockwise seen from outside.
    for polygon in &mut polygons {
        let middle =
            polygon.iter().map(|&vertex| points[vertex].coords).sum::<Vector3<f64>>() / polygon.len() as f64;
        let outward =
            middle - points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / points.len() as f64;
        if area_vector(points, polygon).dot(&outward) < 0.0 {
            polygon.reverse();
        }
    }
    averaged_as_they_run(points, &polygons, weight)
}

/// The same for polygons that run counter-clockwise seen from outside.
fn averaged_as_they_run(points: &[Point3<f64>], polygons: &[Vec<usize>], weight: Weight) -> String {
    let mut normals = vec![Vector3::zeros(); points.len()];
    for polygon in polygons {
        let across = area_vector(points, polygon);
        for (place, &vertex) in polygon.iter().enumerate() {
            let beside = |step: usize| points[polygon[(place + step) % polygon.len()]] - points[vertex];
            let angle = beside(1).angle(&beside(polygon.len() - 1));
            normals[vertex] += across.normalize() * weight(angle, across.norm());
        }
    }
    let mut text = String::new();
    for (point, normal) in points.iter().zip(&normals) {
        let normal = normal.normalize();
        writeln!(text, "v {:.6} {:.6} {:.6}", point.x, point.y, point.z).unwrap();
        writeln!(text, "vn {:.4} {:.4} {:.4}", normal.x, normal.y, normal.z).unwrap();
    }
    for polygon in polygons {
        let corners: Vec<String> = polygon.iter().map(|vertex| format!("{0}//{0}", vertex + 1)).collect();
        writeln!(text, "f {}", corners.join(" ")).unwrap();
    }
    text
}

fn area_vector(points: &[Point3<f64>], polygon: &[usize]) -> Vector3<f64> {
    let next = |place: usize| points[polygon[(place + 1) % polygon.len()]].coords;
    let terms = polygon.iter().enumerate().map(|(place, &vertex)| points[vertex].coords.cross(&next(place)));
    terms.sum::<Vector3<f64>>() / 2.0
}

fn read_bar(text: &str) -> PartReading {
    let options = MeshOptions::default().with_unit(LengthUnit::Millimetre).with_up(UpAxis::Z);
    read("bar.obj", text.as_bytes(), &options)
}

/// A profile 50 mm wide and 30 mm high whose upper corners are rounded with a radius, in a number of pieces.
fn rounded(radius: f64, pieces: i32) -> Vec<[f64; 2]> {
    let arc = |x: f64, from: f64| {
        (0..=pieces).map(move |step| {
            let angle = from + FRAC_PI_2 * f64::from(step) / f64::from(pieces);
            [x + radius * angle.cos(), 30.0 - radius + radius * angle.sin()]
        })
    };
    let corners = [[-25.0, 0.0], [25.0, 0.0]].into_iter();
    corners.chain(arc(25.0 - radius, 0.0)).chain(arc(radius - 25.0, FRAC_PI_2)).collect()
}

#[test]
fn averaged_normals_distort_neither_flat_sides_nor_cylinders() {
    let mut failures = Vec::new();
    for (name, weight) in WEIGHTS {
        for (radius, pieces) in [(5.0, 1), (5.0, 2), (5.0, 3), (5.0, 8), (2.0, 4), (8.0, 5), (8.0, 16)] {
            let reading = read_bar(&shaded_bar(&rounded(radius, pieces), 30.0, weight));
            let off = unevenness(&seen_from(&reading, Vector3::z()), 0.0, 24.0 - radius, 30.0);
            if !(off <= FLAT) {
                failures.push(format!(
                    "radius {radius} in {pieces}, {name}: {off} mm, {:?}",
                    reading.facts.normals
                ));
            }
        }
        for sides in [16, 24, 32, 64] {
            let corner = |step: i32| {
                let angle = TAU * (f64::from(step) + 0.5) / f64::from(sides);
                [30.0 * angle.cos(), 30.0 * angle.sin()]
            };
            let profile: Vec<[f64; 2]> = (0..sides).map(corner).collect();
            let side = seen_from(&read_bar(&shaded_bar(&profile, 40.0, weight)), Vector3::z());
            let patch = Extents { min: Vector2::new(-18.0, -35.0), max: Vector2::new(18.0, 35.0) };
            let fit = CylinderFit::to(&SampledPatch::under(&side, &patch).unwrap()).unwrap();
            let limit = if sides < 24 { 0.005 } else { 0.001 };
            if !((fit.cylinder.radius - 30.0).abs() < limit && fit.residual < limit) {
                failures.push(format!("{sides} sides, {name}: {fit:?}"));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// Programs average the normals of the polygons that they keep, which need not be plane; in a file they are cut into triangles.
#[test]
fn averages_over_twisted_quadrangles_are_recognised() {
    for (name, weight) in WEIGHTS {
        for count in [4, 8, 20] {
            let at = |step: usize, size: f64| size * (step as f64 / count as f64 - 0.5);
            let place = |row: usize, column: usize| row * (count + 1) + column;
            let grid = (0..=count).flat_map(|row| (0..=count).map(move |column| (row, column)));
            let points: Vec<Point3<f64>> = grid
                .map(|(row, column)| (at(column, 80.0), at(row, 60.0)))
                .map(|(x, y)| Point3::new(x, y, x * y / 80.0 + (x + 0.5 * y).powi(2) / 300.0))
                .collect();
            let cells = (0..count).flat_map(|row| (0..count).map(move |column| (row, column)));
            let polygons: Vec<Vec<usize>> = cells
                .map(|(row, column)| {
                    [(row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column)]
                })
                .map(|corners| corners.map(|(row, column)| place(row, column)).to_vec())
                .collect();
            let reading = read_bar(&averaged_as_they_run(&points, &polygons, weight));
            let judged = shading::judged(mesh_of(&reading), false);
            assert_eq!(judged.averages, judged.of, "{name} {count}: {judged:?}");
            assert!(judged.of >= (count - 1) * (count - 1), "{name} {count}: {judged:?}");
        }
    }
}

/// Blender and others close a cylinder with a polygon or with triangles round a vertex in its middle.
#[test]
fn ends_that_are_fans_distort_no_cylinder() {
    let mut failures = Vec::new();
    for (name, weight) in WEIGHTS {
        for sides in [16, 24, 32, 64] {
            let corner = |step: i32| {
                let angle = TAU * (f64::from(step) + 0.5) / f64::from(sides);
                [20.0 * angle.cos(), 20.0 * angle.sin()]
            };
            let profile: Vec<[f64; 2]> = (0..sides).map(corner).collect();
            let reading = read_bar(&shaded(&profile, 30.0, weight, true));
            let side = seen_from(&reading, Vector3::z());
            let patch = Extents { min: Vector2::new(-12.0, -26.0), max: Vector2::new(12.0, 26.0) };
            let fit = SampledPatch::under(&side, &patch).ok().and_then(|patch| CylinderFit::to(&patch).ok());
            let limit = if sides < 24 { 0.005 } else { 0.001 };
            let is_round =
                |fit: &CylinderFit| (fit.cylinder.radius - 20.0).abs() < limit && fit.residual < limit;
            if !fit.as_ref().is_some_and(is_round) || side.doubts().iter().any(|doubt| *doubt > 0.0) {
                failures.push(format!("{sides} sides, {name}: {fit:?}, {:?}", reading.facts.normals));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// Every vertex of a prism is between facets that are not in one plane, and its normal is their average.
#[test]
fn the_number_of_averages_is_reported() {
    let corner = |step: i32| {
        [20.0 * (TAU * f64::from(step) / 16.0).cos(), 20.0 * (TAU * f64::from(step) / 16.0).sin()]
    };
    let profile: Vec<[f64; 2]> = (0..16).map(corner).collect();
    for (name, weight) in WEIGHTS {
        let reading = read_bar(&shaded_bar(&profile, 30.0, weight));
        let notice = reading.facts.notices.iter().find(|notice| notice.code == "normals-estimated").unwrap();
        assert!(notice.message.contains("of 32 normals"), "{name}: {}", notice.message);
        assert!(notice.message.contains(" 32 are averages"), "{name}: {}", notice.message);
    }
}

/// A can along y whose rims are bevelled in three pieces: beside such narrow facets, averages lean by less than half a degree.
#[test]
fn averages_beside_narrow_bevels_bend_no_long_cylinder() {
    const SIDES: usize = 32;
    let mut failures = Vec::new();
    for (name, weight) in WEIGHTS {
        let quarter = |step: i32| 3.0 * (f64::from(step) * FRAC_PI_2 / 3.0).sin_cos().0;
        let end = (0..=3).map(|step| [27.0 + quarter(step), 37.0 + quarter(3 - step)]);
        let rings: Vec<[f64; 2]> = end.clone().chain(end.rev().map(|[radius, y]| [radius, -y])).collect();
        let on = |[radius, y]: [f64; 2], side: usize| {
            let angle = TAU * (side as f64 + 0.5) / SIDES as f64;
            Point3::new(radius * angle.cos(), y, radius * angle.sin())
        };
        let points: Vec<_> =
            rings.iter().flat_map(|&ring| (0..SIDES).map(move |side| on(ring, side))).collect();
        let mut polygons: Vec<Vec<usize>> = Vec::new();
        for ring in 0..rings.len() - 1 {
            for side in 0..SIDES {
                let (own, next) = (ring * SIDES + side, ring * SIDES + (side + 1) % SIDES);
                polygons.push(vec![own, next, next + SIDES, own + SIDES]);
            }
        }
        let last = (rings.len() - 1) * SIDES;
        polygons.extend([(0..SIDES).collect(), (last..last + SIDES).collect()]);
        let surface = seen_from(&read_bar(&averaged(&points, polygons, weight)), Vector3::z());
        let patch = Extents { min: Vector2::new(-18.0, -30.0), max: Vector2::new(18.0, 30.0) };
        let fit = CylinderFit::to(&SampledPatch::under(&surface, &patch).unwrap()).unwrap();
        if !((fit.cylinder.radius - 30.0).abs() < 0.001 && fit.residual < 0.001) {
            failures.push(format!("{name}: {fit:?}"));
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn averages_are_recognised_where_corners_of_facets_do_not_quite_meet() {
    for (name, weight) in WEIGHTS {
        let reading = read_bar(&shaded_bar(&rounded(5.0, 2), 30.0, weight));
        let whole = mesh_of(&reading);
        let corners = whole.triangles().as_flattened();
        let shift = |corner: usize| Vector3::from_fn(|axis, _| 1e-5 * ((corner * 7 + axis * 3) % 5) as f64);
        let at = |(corner, vertex): (usize, &u32)| whole.positions()[*vertex as usize] + shift(corner);
        let positions: Vec<_> = corners.iter().enumerate().map(at).collect();
        let normals = corners.iter().map(|vertex| whole.normals()[*vertex as usize]).collect();
        let triangles = (0..whole.triangles().len() as u32).map(|at| [3 * at, 3 * at + 1, 3 * at + 2]);
        let apart = TriMesh::new(positions, normals, triangles.collect()).unwrap();
        assert!(shading::only_shade(&apart), "{name}");
    }
}

#[test]
fn slivers_distort_no_cylinder_and_cause_no_doubt() {
    const SIDES: u32 = 24;
    let on = |side: u32, radius: f64, y: f64| {
        let angle = TAU * f64::from(side % SIDES) / f64::from(SIDES);
        Point3::new(radius * angle.cos(), y, radius * angle.sin())
    };
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    for side in 0..SIDES {
        // A strip ends in the middle of its neighbour's side, where rounding moves its vertex off that side.
        let first = u32::try_from(points.len()).unwrap();
        points.extend([on(side, 30.0, -40.0), on(side + 1, 30.0, -40.0), on(side + 1, 30.0, 40.0)]);
        points.extend([on(side, 30.0, 40.0), on(side, 30.0 + 4e-5, f64::from(side) - 12.3)]);
        let strip = [[0, 4, 1], [4, 2, 1], [4, 3, 2], [0, 3, 4]];
        triangles.extend(strip.map(|corners| corners.map(|corner| first + corner)));
    }
    let exact = points.iter().map(|point| Vector3::new(point.x, 0.0, point.z)).collect();
    for normals in [exact, Vec::new()] {
        let limit = if normals.is_empty() { 0.01 } else { 0.001 };
        let mesh = TriMesh::new(points.clone(), normals, triangles.clone()).unwrap();
        assert!(!shading::only_shade(&mesh));
        let part = FacingPart::new(&mesh, &View::top());
        let side = FittedSurface::of_part(&part, &FitOptions::default()).unwrap();
        let patch = Extents { min: Vector2::new(-18.0, -35.0), max: Vector2::new(18.0, 35.0) };
        let fit = CylinderFit::to(&SampledPatch::under(&side, &patch).unwrap()).unwrap();
        assert!((fit.cylinder.radius - 30.0).abs() < limit && fit.residual < limit, "{fit:?}");
        assert!(side.doubts().iter().all(|doubt| *doubt == 0.0));
    }
}

/// Cylinders of which some lengthwise edges are missing, as after removing edges or planar decimation: each normal leans from the
/// radius towards its wider facet.
#[test]
fn averages_of_unequal_facets_distort_no_cylinder() {
    let regular = |count: i32, is_kept: fn(i32) -> bool| -> Vec<f64> {
        (0..count)
            .filter(|&step| is_kept(step))
            .map(|step| TAU * f64::from(step) / f64::from(count))
            .collect()
    };
    let sections = [
        ("every third missing, once two wide", regular(32, |step| step % 3 != 0)),
        ("every third missing", regular(36, |step| step % 3 != 0)),
        ("decimated", regular(96, |step| step % 4 == 0 || step % 12 == 2)),
    ];
    let mut failures = Vec::new();
    for (section, angles) in sections {
        for (name, weight) in WEIGHTS {
            let profile: Vec<[f64; 2]> =
                angles.iter().map(|angle| [20.0 * angle.cos(), 20.0 * angle.sin()]).collect();
            let reading = read_bar(&shaded_bar(&profile, 40.0, weight));
            let side = seen_from(&reading, Vector3::z());
            let patch = Extents { min: Vector2::new(-12.0, -35.0), max: Vector2::new(12.0, 35.0) };
            let fit = CylinderFit::to(&SampledPatch::under(&side, &patch).unwrap()).unwrap();
            if !((fit.cylinder.radius - 20.0).abs() < 0.001 && fit.residual < 0.001) {
                failures.push(format!("{section}, {name}: {fit:?}, {:?}", reading.facts.normals));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// A sheet of quadrangles of unequal sizes whose corners are not in one plane: averages over these are none over the triangles
/// into which they are divided.
#[test]
fn averages_over_quadrangles_that_are_not_flat_only_shade() {
    const COUNT: usize = 12;
    let height = |x: f64, y: f64| 12.0 * (x / 28.0).cos() * (y / 24.0).cos();
    // Steps of 1, 2 and 3 take turns, so that no place is in the middle of its neighbours.
    let line = |half: f64, first: usize| {
        let steps = (0..COUNT).map(|step| [1.0, 3.0, 2.0, 2.0, 1.0][(step + first) % 5]);
        let ends: Vec<f64> = std::iter::once(0.0)
            .chain(steps.scan(0.0, |sum, step| {
                *sum += step;
                Some(*sum)
            }))
            .collect();
        let last = ends[COUNT];
        ends.into_iter().map(move |end| half * (2.0 * end / last - 1.0)).collect::<Vec<f64>>()
    };
    let (columns, rows) = (line(40.0, 0), line(30.0, 2));
    let points: Vec<Point3<f64>> =
        rows.iter().flat_map(|&y| columns.iter().map(move |&x| Point3::new(x, y, height(x, y)))).collect();
    let at = |column: usize, row: usize| row * (COUNT + 1) + column;
    let quadrangles = (0..COUNT).flat_map(|row| {
        (0..COUNT).map(move |column| {
            vec![at(column, row), at(column + 1, row), at(column + 1, row + 1), at(column, row + 1)]
        })
    });
    for (name, weight) in WEIGHTS {
        let reading =
            read_bar(&averaged_as_they_run(&points, &quadrangles.clone().collect::<Vec<_>>(), weight));
        assert_eq!(reading.facts.normals, NormalsFound::Averaged, "{name}");
        let surface = seen_from(&reading, Vector3::z());
        let off = |x: f64, y: f64| {
            (surface.sampled_height(ViewPoint::new(x, y)).unwrap_or(f64::INFINITY) - height(x, y)).abs()
        };
        let places = (-10..=10)
            .flat_map(|column| (-8..=8).map(move |row| (3.0 * f64::from(column), 3.0 * f64::from(row))));
        let most = places.map(|(x, y)| off(x, y)).fold(0.0, f64::max);
        assert!(most < 0.1, "{name}: {most} mm");
    }
}

#[test]
fn cad_normals_are_not_treated_as_shading() {
    let mut failures = Vec::new();
    for form in ALL {
        for sag in [0.02, 0.1, 0.5] {
            let mesh = form.mesh(sag, Normals::Exact);
            // As files of few digits round them.
            for step in [0.0, 0.001, 0.01, 0.1] {
                let round = |at: &Point3<f64>| match step > 0.0 {
                    true => Point3::from(at.coords.map(|value| (value / step).round() * step)),
                    false => *at,
                };
                let places = mesh.positions().iter().map(round).collect();
                let Ok(rounded) = TriMesh::new(places, mesh.normals().to_vec(), mesh.triangles().to_vec())
                else {
                    continue;
                };
                if shading::only_shade(&rounded) {
                    failures.push(format!("{} {sag}, rounded to {step} mm", form.name));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// The normals of an ellipse whose facets all turn by the same angle, and of a cylinder whose facets do not, are the surface's.
#[test]
fn cad_normals_of_unequal_facets_are_not_treated_as_shading() {
    let normals_of = |turns: &[f64], half_axes: [f64; 2]| {
        let place = |normal: f64| {
            let [wide, high] = half_axes;
            let (along, up) = (wide * wide * normal.cos(), high * high * normal.sin());
            let size = (wide * normal.cos()).hypot(high * normal.sin());
            [along / size, up / size]
        };
        let (mut points, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        let count = turns.len();
        for y in [-40.0, 40.0] {
            for &turn in turns {
                let [x, z] = place(turn);
                points.push(Point3::new(x, y, z));
                normals.push(Vector3::new(turn.cos(), 0.0, turn.sin()));
            }
        }
        for first in 0..count {
            let second = (first + 1) % count;
            let [a, b, c, d] = [first, second, count + second, count + first].map(|index| index as u32);
            triangles.extend([[a, c, b], [a, d, c]]);
        }
        TriMesh::new(points, normals, triangles).unwrap()
    };
    let even: Vec<f64> = (0..32).map(|step| TAU * f64::from(step) / 32.0).collect();
    let uneven: Vec<f64> =
        (0..36).filter(|step| step % 3 != 0).map(|step| TAU * f64::from(step) / 36.0).collect();
    for (name, turns, half_axes) in [
        ("ellipse", &even, [25.6, 16.0]),
        ("narrow ellipse", &even, [40.0, 16.0]),
        ("uneven cylinder", &uneven, [20.0, 20.0]),
        ("uneven ellipse", &uneven, [25.6, 16.0]),
    ] {
        assert!(!shading::only_shade(&normals_of(turns, half_axes)), "{name}");
    }
}

/// Where the two half-round ends of a bar are cut into facets of 2°, all normals but those beside its narrow flats are averages.
#[test]
fn few_normals_that_are_no_averages_show_that_the_others_are_exact() {
    let end = |middle: f64, from: f64| {
        (0..=90).map(move |step| (middle, (from + 2.0 * f64::from(step)).to_radians()))
    };
    let ring: Vec<(f64, f64)> = end(0.3, -90.0).chain(end(-0.3, 90.0)).collect();
    let (mut points, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    for y in [-40.0, 40.0] {
        for &(middle, turn) in &ring {
            let normal = Vector3::new(turn.cos(), 0.0, turn.sin());
            points.push(Point3::new(middle, y, 0.0) + normal * 10.0);
            normals.push(normal);
        }
    }
    for first in 0..ring.len() {
        let second = (first + 1) % ring.len();
        let [a, b, c, d] = [first, second, ring.len() + second, ring.len() + first].map(|index| index as u32);
        triangles.extend([[a, c, b], [a, d, c]]);
    }
    assert!(!shading::only_shade(&TriMesh::new(points, normals, triangles).unwrap()));
}

/// As in a file in metres with six decimals: the facets of the bevel are 0.4 mm wide, and tilted by the rounding.
#[test]
fn averages_are_recognised_where_positions_are_rounded() {
    let reading = sample("bl45-octagon-bevel.glb");
    let whole = mesh_of(&reading);
    let rounded = |at: &Point3<f64>| Point3::from(at.coords.map(|along| (along / 4.0 * 1e3).round() / 1e3));
    let positions = whole.positions().iter().map(rounded).collect();
    let small = TriMesh::new(positions, whole.normals().to_vec(), whole.triangles().to_vec()).unwrap();
    assert!(shading::only_shade(&small));
}

#[test]
fn cad_normals_of_tangent_arcs_are_not_treated_as_shading() {
    let mut profiles = Profile::all();
    for top in [60.0, 80.0, 150.0] {
        for side in [12.0, 20.0, 30.0] {
            // The crown ends within the strip.
            for angle in
                [6.0f64, 10.0, 14.0].into_iter().filter(|angle| top * angle.to_radians().sin() < 22.0)
            {
                profiles.push(Profile::oval(top, side, angle, 24.0));
            }
        }
    }
    let (mut count, mut failures) = (0, Vec::new());
    for profile in profiles {
        for deviation in [0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.5] {
            for (rows, is_merged) in [(1, true), (1, false), (3, true)] {
                count += 1;
                if shading::only_shade(&profile.strip(deviation, rows, is_merged)) {
                    failures.push(format!("{} {deviation} {rows} {is_merged}", profile.name));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{} of {count}: {failures:#?}", failures.len());
}

#[test]
fn normals_that_contradict_the_facets_cause_doubt() {
    let text = shaded_bar(&rounded(5.0, 3), 30.0, WEIGHTS[0].1);
    // Half way between the averages and the flat side: neither an average nor the normal of a surface.
    let damped: String = text
        .lines()
        .map(|line| match line.strip_prefix("vn ") {
            Some(normal) => {
                let [x, y, z] = numbers(normal);
                let damped = Vector3::new(x * 0.6, y * 0.6, z).normalize();
                format!("vn {} {} {}\n", damped.x, damped.y, damped.z)
            }
            None => format!("{line}\n"),
        })
        .collect();
    let reading = read_bar(&damped);
    assert_eq!(reading.facts.normals, NormalsFound::Smooth);
    let top = seen_from(&reading, Vector3::z());
    let off = unevenness(&top, 0.0, 15.0, 30.0);
    let doubt = top.doubt(ViewPoint::new(0.5, 0.5));
    assert!(off > 0.3 && doubt > 0.5 * off, "{off} mm off, {doubt} mm in doubt");
}

fn numbers(text: &str) -> [f64; 3] {
    let numbers: Vec<f64> = text.split_whitespace().map(|number| number.parse().unwrap()).collect();
    numbers.try_into().unwrap()
}

/// Cans whose rims have a chamfer or a small fillet: the wall stays a cylinder, whatever the narrow facets lead to. The fillet
/// of OpenCASCADE has vertices at irregular places.
#[test]
fn cans_with_narrow_rims_are_recognised_as_cylinders() {
    for (name, facing, radius, half) in [
        ("bl42-can-chamfer.glb", -Vector3::y(), 33.0, [18.0, 40.0]),
        ("occ-can-fillet-2.stl", Vector3::z(), 20.0, [18.0, 8.0]),
    ] {
        let side = seen_from(&sample(name), facing);
        let [x, y] = half;
        let patch = Extents { min: Vector2::new(-x, -y), max: Vector2::new(x, y) };
        let fit = CylinderFit::to(&SampledPatch::under(&side, &patch).unwrap()).unwrap();
        assert!((fit.cylinder.radius - radius).abs() < 0.01 && fit.residual < 0.005, "{name}: {fit:?}");
    }
}

/// The top of a coin with a small fillet, and that of a box with a wide bevel of one segment.
#[test]
fn tops_beside_narrow_fillets_and_wide_bevels_are_flat() {
    for (name, half, height) in [("occ-coin-fillet-1.stl", 19.0, 3.0), ("bl42-bevel-10.glb", 14.0, 30.0)] {
        let off = unevenness(&seen_from(&sample(name), Vector3::z()), 0.0, half, height);
        assert!(off <= FLAT, "{name}: {off} mm");
    }
}

/// Regular prisms and a disc with the Bevel modifier of Blender. The averages round such a top are the normals of a ball, and the
/// narrow facets beside it turn by so much that the normals that they lead to are not exact.
#[test]
fn tops_of_bevelled_prisms_and_discs_are_flat() {
    for (name, half, normals) in [
        ("bl45-octagon-bevel.glb", 14.0, NormalsFound::Averaged),
        ("bl45-hexagon-bevel.stl", 13.0, NormalsFound::FacetsOnly),
        ("bl45-disc-bevel.obj", 11.0, NormalsFound::Averaged),
    ] {
        let reading = sample(name);
        assert_eq!(reading.facts.normals, normals, "{name}");
        let off = unevenness(&seen_from(&reading, Vector3::z()), 0.0, half, 10.0);
        assert!(off <= FLAT, "{name}: {off} mm");
    }
}

/// A Boolean modifier leaves slivers: averages that a sliver has a share in contradict nothing.
#[test]
fn averages_beside_slivers_bend_no_cylinder() {
    let reading = sample("bl45-mug-pocket.glb");
    assert_eq!(reading.facts.normals, NormalsFound::Averaged);
    let patch = Extents { min: Vector2::new(-30.0, -15.0), max: Vector2::new(25.0, 15.0) };
    let fit = CylinderFit::to(&SampledPatch::under(&seen_from(&reading, Vector3::z()), &patch).unwrap());
    let fit = fit.unwrap();
    assert!((fit.cylinder.radius - 40.0).abs() < 0.001 && fit.residual < 0.001, "{fit:?}");
}

/// The facets of a small fillet are long, low and irregular: they tilt by far more than the normals turn.
#[test]
fn exact_normals_beside_small_fillets_cause_no_doubt() {
    let reading = sample("occ-can-fillet-0.5.glb");
    assert_eq!(reading.facts.normals, NormalsFound::Smooth);
    let side = seen_from(&reading, Vector3::z());
    let patch = Extents { min: Vector2::new(-27.0, -8.0), max: Vector2::new(27.0, 8.0) };
    let fit = CylinderFit::to(&SampledPatch::under(&side, &patch).unwrap()).unwrap();
    assert!((fit.cylinder.radius - 12.5).abs() < 0.001 && fit.residual < 0.001, "{fit:?}");
    for row in -8..=8 {
        for column in -27..=27 {
            let doubt = side.doubt(ViewPoint::new(f64::from(column), f64::from(row)));
            assert!(doubt < 0.001, "{doubt} mm at ({column}, {row})");
        }
    }
}

/// The vertices of a coarse fillet round a disc are so even that averages of its facets are its normals.
#[test]
fn exact_normals_of_coarse_fillets_are_not_treated_as_shading() {
    let reading = sample("occ-disc-fillet-0.3.glb");
    assert_eq!(reading.facts.normals, NormalsFound::Smooth);
    let off = unevenness(&seen_from(&reading, Vector3::z()), 0.0, 23.0, 10.9);
    assert!(off <= FLAT, "{off} mm");
}
