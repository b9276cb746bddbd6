//! Meshes whose vertices scatter: as good as the same vertices in a scan, and never mistaken for anything else.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use isomark::config::PartSettings;
use isomark::formats::mesh::{
    self, LengthUnit, MeshFormat, MeshOptions, NormalsChoice, NormalsUsed, PartReading, Shape, UpAxis,
};
use isomark::formats::pattern::{PatternOptions, read as read_pattern};
use isomark::geometry::mapping::isometric::IsometricOptions;
use isomark::geometry::mapping::quality::{self, Distortion};
use isomark::geometry::mapping::{LengthTrueMap, Method};
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::noise;
use isomark::geometry::pattern::Affine;
use isomark::geometry::point_cloud::PointCloud;
use isomark::geometry::shapes;
use isomark::geometry::space::{FlatPoint, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use isomark::pipeline::surface_of;
use isomark::reason::Severity;
use nalgebra::{Point3, Vector3};

use super::forms::{ALL, Normals};

type Height = fn(f64, f64) -> f64;

fn saddle(x: f64, y: f64) -> f64 {
    5.0 * (x / 14.0).tanh() + 0.006 * x * x - 0.012 * y * y
}

fn egg(x: f64, y: f64) -> f64 {
    22.0 * (1.0 - (x / (36.0 + 0.12 * x)).powi(2) - (y / 29.0).powi(2)).max(0.0).sqrt()
}

/// Random numbers that are the same everywhere.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Box & Muller.
    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// The mesh with its vertices moved along z by noise of a standard deviation, mm.
fn noisy(mesh: &TriMesh, deviation: f64, random: &mut Random) -> TriMesh {
    let moved = |at: &Point3<f64>| at + Vector3::z() * (deviation * random.normal());
    let positions = mesh.positions().iter().map(moved).collect();
    TriMesh::new(positions, Vec::new(), mesh.triangles().to_vec()).unwrap()
}

fn read(mesh: &TriMesh, normals: NormalsChoice) -> PartReading {
    let mut text = String::new();
    for at in mesh.positions() {
        writeln!(text, "v {:.9} {:.9} {:.9}", at.x, at.y, at.z).unwrap();
    }
    for [a, b, c] in mesh.triangles() {
        writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1).unwrap();
    }
    let options =
        MeshOptions::default().with_unit(LengthUnit::Millimetre).with_up(UpAxis::Z).with_normals(normals);
    mesh::read(text.as_bytes(), MeshFormat::Obj, &options, &BTreeMap::new()).unwrap()
}

fn fitted(reading: &mut PartReading) -> FittedSurface {
    surface_of(&reading.shape, &mut reading.facts, &PartSettings::default(), &FitOptions::default()).unwrap()
}

/// The letters on the true surface.
fn judged(surface: &FittedSurface, height: Height) -> Distortion {
    let bytes = include_bytes!("../../examples/patterns/letters.dxf");
    let pattern = read_pattern(bytes, &PatternOptions::default()).unwrap().pattern;
    let anchor = FlatPoint::new(0.0, 0.0);
    let pattern = pattern.transformed(&Affine::rigid(pattern.extents().center().into(), 0.0, anchor));
    let method = Method::Isometric(IsometricOptions::INK);
    let map = LengthTrueMap::find(surface, &pattern, |_| true, anchor, &method).unwrap();
    let ink = quality::sample(&pattern, |_| true);
    quality::measure(&ink, |at| map.point(at), |at: ViewPoint| Some(height(at.x, at.y))).unwrap()
}

#[test]
fn a_noisy_mesh_is_as_good_as_its_vertices_in_a_scan() {
    let mut random = Random(1);
    for (name, height) in [("saddle", saddle as Height), ("egg", egg)] {
        for (edge, deviation) in [(0.5, 0.02), (1.0, 0.02), (1.0, 0.05), (1.5, 0.02)] {
            let mesh = noisy(&shapes::graph(24.0, edge, height), deviation, &mut random);
            let mut reading = read(&mesh, NormalsChoice::Auto);
            assert_eq!(reading.facts.normals_used, Some(NormalsUsed::Smoothed), "{name} {edge} {deviation}");
            let found = reading.facts.noise.unwrap();
            // Along the normal, which is up to 60° from z on the egg.
            assert!(
                (0.75..1.1).contains(&(found.noise_mm / deviation)),
                "{name} {edge} {deviation}: {found:?}"
            );
            assert!((found.spacing_mm / edge - 1.0).abs() < 0.25, "{name} {edge}: {found:?}");
            let after = judged(&fitted(&mut reading), height);
            let mut points = reading.clone();
            points.shape = Shape::Scan(PointCloud::new(mesh.positions().to_vec(), Vec::new()));
            let best = judged(&fitted(&mut points), height);
            assert!(
                after.length_error < 1.1 * best.length_error + 0.01
                    && after.area_error < 1.1 * best.area_error + 0.01
                    && after.max_angle_error < 1.1 * best.max_angle_error + 0.001,
                "{name} {edge} {deviation}: {after:?} for {best:?} in a scan"
            );
            assert!(after.length_error < 0.25, "{name} {edge} {deviation}: {} mm", after.length_error);
            let notices = &reading.facts.notices;
            let notice = notices.iter().find(|notice| notice.code == "mesh-noisy").unwrap();
            assert_eq!(notice.severity, Severity::Warning);
            assert!(notice.message.contains(&format!("{:.4} mm", found.noise_mm)), "{}", notice.message);
            assert!(notices.iter().any(|notice| notice.code == "scan-smoothed"));
        }
    }
}

/// Reduction keeps the vertices that stick out: neighbours are then more often on opposite sides of the part than by chance. Its narrow
/// facets tilt by far more than the part: what is left of them is no edge.
#[test]
fn reduced_noisy_meshes_are_smoothed() {
    for (name, noise, height) in [
        ("cylinder-reduced.ply", 0.03, (|_, y| (900.0 - y * y).sqrt()) as Height),
        ("sphere-reduced.ply", 0.01, |x, y| (2500.0 - x * x - y * y).sqrt()),
    ] {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/scans");
        let bytes = std::fs::read(format!("{folder}/{name}")).unwrap();
        let options = MeshOptions::default().with_unit(LengthUnit::Millimetre).with_up(UpAxis::Z);
        let mut reading = mesh::read(&bytes, MeshFormat::Ply, &options, &BTreeMap::new()).unwrap();
        assert_eq!(reading.facts.normals_used, Some(NormalsUsed::Smoothed), "{name}");
        let found = reading.facts.noise.unwrap().noise_mm;
        assert!((0.75..1.3).contains(&(found / noise)), "{name}: {found} mm");
        let surface = fitted(&mut reading);
        assert!(surface.residual.max < 0.002, "{name}: {:?}", surface.residual);
        for (x, y) in (-10..=10).flat_map(|x| (-10..=10).map(move |y| (f64::from(x), f64::from(y)))) {
            let off = (surface.sampled_height(ViewPoint::new(x, y)).unwrap() - height(x, y)).abs();
            assert!(off < 0.75 * noise, "{name}: {off} mm at ({x}, {y})");
        }
    }
}

#[test]
fn settings_overrule_the_smoothing_of_a_noisy_mesh() {
    let mesh = noisy(&shapes::graph(24.0, 1.0, saddle), 0.02, &mut Random(2));
    for (choice, used) in
        [(NormalsChoice::Estimate, NormalsUsed::Estimated), (NormalsChoice::Facets, NormalsUsed::Facets)]
    {
        let mut reading = read(&mesh, choice);
        assert_eq!(reading.facts.normals_used, Some(used));
        assert!(reading.facts.notices.iter().any(|notice| notice.code == "mesh-noisy"));
        fitted(&mut reading);
        assert!(reading.facts.scan.is_none());
    }
}

#[test]
fn what_is_no_noise_is_not_taken_for_it() {
    let wave = |length: f64| move |x: f64, _: f64| 0.05 * (std::f64::consts::TAU * x / length).sin();
    let relief =
        |x: f64, y: f64| saddle(x, y) + 0.2 * ((1.3 * x).sin() * (1.1 * y).sin() * 4.0).clamp(-1.0, 1.0);
    let engraved = |x: f64, y: f64| {
        let is_line = (x.abs() < 15.0 && (y % 4.0).abs() < 0.4) || (y.abs() < 10.0 && (x % 5.0).abs() < 0.4);
        egg(x, y) - if is_line { 0.2 } else { 0.0 }
    };
    for edge in [0.25, 0.4, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0] {
        let graph = |height: &dyn Fn(f64, f64) -> f64| {
            let flat = shapes::graph(24.0, edge, |_, _| 0.0);
            let positions = flat.positions().iter().map(|at| Point3::new(at.x, at.y, height(at.x, at.y)));
            TriMesh::new(positions.collect(), Vec::new(), flat.triangles().to_vec()).unwrap()
        };
        for (name, height) in [
            ("saddle", &saddle as &dyn Fn(f64, f64) -> f64),
            ("egg", &egg),
            ("mouse", &shapes::mouse),
            ("mandarin", &shapes::mandarin),
            ("waves of 2 mm", &wave(2.0)),
            ("waves of 3 mm", &wave(3.0)),
            ("waves of 8 mm", &wave(8.0)),
            ("relief", &relief),
            ("engraving", &engraved),
        ] {
            // Waves that the vertices do not resolve are what they seem to be.
            if name.starts_with("waves") && edge > 0.75 {
                continue;
            }
            assert_eq!(noise::of(&graph(height)), None, "{name} at {edge} mm");
        }
    }
    for form in ALL {
        for sag in [0.005, 0.02, 0.1, 0.5] {
            assert_eq!(noise::of(&form.mesh(sag, Normals::Missing)), None, "{} {sag}", form.name);
        }
    }
}

/// Every sample that a CAD program or a modeller wrote.
#[test]
fn no_sample_is_noisy() {
    let mut folders =
        vec![std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/parts"))];
    let mut count = 0;
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            let Some(format) = MeshFormat::from_name(&name) else { continue };
            let bytes = std::fs::read(&path).unwrap();
            let Ok(reading) = mesh::read(&bytes, format, &MeshOptions::default(), &BTreeMap::new()) else {
                continue;
            };
            if matches!(reading.shape, Shape::Mesh(_)) {
                count += 1;
                assert_eq!(reading.facts.noise, None, "{name}");
            }
        }
    }
    assert!(count > 20, "{count} samples");
}
