//! A warning names the true cause, and what helps.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt::Write as _;

use isomark::config::JobSettings;
use isomark::formats::mesh::{
    self, LengthUnit, MeshFormat, MeshOptions, MeshReadError, NormalsChoice, PartFile, UpAxis,
};
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::shapes;
use isomark::pipeline::{PatternInput, Pipeline, PipelineError};
use isomark::reason::{Notice, Reason};
use nalgebra::{Point3, Vector3};

use super::profiles::Profile;

fn obj(mesh: &TriMesh, normals: &[Vector3<f64>]) -> Vec<u8> {
    let mut text = String::new();
    for at in mesh.positions() {
        writeln!(text, "v {:.9} {:.9} {:.9}", at.x, at.y, at.z).unwrap();
    }
    for normal in normals {
        writeln!(text, "vn {:.6} {:.6} {:.6}", normal.x, normal.y, normal.z).unwrap();
    }
    for corners in mesh.triangles() {
        let corners = corners.map(|corner| match normals.is_empty() {
            true => format!("{}", corner + 1),
            false => format!("{0}//{0}", corner + 1),
        });
        writeln!(text, "f {}", corners.join(" ")).unwrap();
    }
    text.into_bytes()
}

/// The notices of the letters on a part in mm, or why it is refused.
fn marked(bytes: Vec<u8>, normals: NormalsChoice, limit: f64) -> Result<Vec<Notice>, Reason> {
    let mut settings = JobSettings::default();
    settings.part.unit = Some(LengthUnit::Millimetre);
    settings.part.up = Some(UpAxis::Z);
    settings.part.normals = normals;
    settings.correction.max_residual = limit;
    settings.placement.place = Some(isomark::geometry::space::ViewPoint::new(0.0, 0.0));
    let sku = "part".parse().unwrap();
    let pipeline = Pipeline::new(None);
    let drawing = PatternInput {
        name: "letters.dxf",
        bytes: include_bytes!("../../examples/patterns/letters.dxf"),
        previous: None,
    };
    let done = pipeline
        .learn(&sku, &PartFile::alone("part.obj", bytes), &settings.part)
        .and_then(|learned| pipeline.correct(&sku, &learned, drawing, &settings, false));
    match done {
        Ok(corrected) => Ok(corrected.report.notices),
        Err(PipelineError::Rejected(reason)) => Err(reason),
        Err(error) => panic!("{error}"),
    }
}

/// The same at the loosest limit that warns of the surface.
fn warned(bytes: &[u8], normals: NormalsChoice) -> Vec<Notice> {
    let is_warned = |notices: &Vec<Notice>| notices.iter().any(|notice| notice.code == "surface-loose");
    let limits = [1.0, 0.25, 0.06, 0.015, 0.004];
    let marked = limits.iter().map(|limit| marked(bytes.to_vec(), normals, *limit).unwrap());
    marked.into_iter().find(is_warned).unwrap()
}

fn text<'a>(notices: &'a [Notice], code: &str) -> &'a str {
    let notice = notices.iter().find(|notice| notice.code == code);
    notice.map(|notice| notice.message.as_str()).unwrap_or_else(|| panic!("no {code} in {notices:#?}"))
}

/// A sheet over x and y with heights at every so many mm.
fn sheet(step: f64, height: impl Fn(f64, f64) -> f64) -> TriMesh {
    let count = (30.0 / step) as i32;
    let width = u32::try_from(2 * count + 1).unwrap();
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    for row in -count..=count {
        for column in -count..=count {
            let (x, y) = (f64::from(column) * step, f64::from(row) * step);
            points.push(Point3::new(x, y, height(x, y)));
        }
    }
    for row in 0..width - 1 {
        for column in 0..width - 1 {
            let at = row * width + column;
            triangles.extend([[at, at + 1, at + width + 1], [at, at + width + 1, at + width]]);
        }
    }
    TriMesh::new(points, Vec::new(), triangles).unwrap()
}

#[test]
fn a_ridge_is_named_with_its_angle_and_not_taken_for_curvature() {
    let slope = 10f64.to_radians().tan();
    for step in [1.0, 5.0, 30.0] {
        let roof = sheet(step, |x, _| 10.0 - slope * x.abs());
        let notices = warned(&obj(&roof, &[]), NormalsChoice::Auto);
        let loose = text(&notices, "surface-loose");
        assert!(
            loose.contains("an edge or a ridge") && loose.contains("away from the edge"),
            "{step}: {loose}"
        );
        let angle: f64 =
            loose.split("an edge or a ridge of ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
        assert!((13.0..=21.0).contains(&angle), "{step}: {loose}");
        for notice in &notices {
            assert!(!notice.message.contains("curved in both directions"), "{step}: {}", notice.message);
        }
        let refused = marked(obj(&roof, &[]), NormalsChoice::Auto, 0.0005).unwrap_err();
        assert!(refused.code == "surface-not-met" && refused.what.contains("a ridge"), "{refused:?}");
    }
}

#[test]
fn coarse_facets_are_named_with_the_remedy_in_the_program_that_wrote_the_file() {
    let waist = obj(&Profile::waist(20.0, 20.0, 20.0, 24.0).revolved(30.0, 1.0, 22.5), &[]);
    for (comment, remedies) in [
        ("# Blender 4.2.1 LTS\n", ["apply the Subdivision modifier", "In Blender,"]),
        ("# FreeCAD v0.21\n", ["as STEP, which has no facets", "as glTF with its normals"]),
        ("", ["as STEP, which has no facets", "in Blender, apply the Subdivision modifier"]),
    ] {
        let bytes = [comment.as_bytes(), &waist].concat();
        let notices = marked(bytes, NormalsChoice::Auto, 5.0).unwrap();
        let text = text(&notices, "facets-coarse");
        assert!(remedies.iter().all(|remedy| text.contains(remedy)), "{comment}: {text}");
        assert_eq!(text.contains("Blender"), !comment.contains("FreeCAD"), "{comment}: {text}");
    }
}

#[test]
fn bumps_are_named_as_curved_both_ways() {
    let bumps = |x: f64, y: f64| 3.5 * (x / 4.0).sin() * (y / 4.0).sin();
    let notices = marked(obj(&shapes::graph(34.0, 0.5, bumps), &[]), NormalsChoice::Auto, 1.0).unwrap();
    let text = text(&notices, "stretch-remains");
    assert!(
        text.contains("curved in both directions") && text.contains("Make the drawing smaller"),
        "{text}"
    );
}

#[test]
fn noise_is_named_where_the_settings_keep_it() {
    let mut state = 7u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f64 / (1u64 << 24) as f64
    };
    // The sum of twelve even numbers is nearly normal.
    let mut normal = || (0..12).map(|_| random()).sum::<f64>() - 6.0;
    let clean = shapes::graph(34.0, 0.6, |x, y| -(x * x + y * y) / 120.0);
    let moved = clean.positions().iter().map(|at| at + Vector3::z() * (0.05 * normal()));
    let noisy = TriMesh::new(moved.collect(), Vec::new(), clean.triangles().to_vec()).unwrap();
    let notices = warned(&obj(&noisy, &[]), NormalsChoice::Estimate);
    for code in ["surface-loose", "stretch-remains"] {
        let text = text(&notices, code);
        assert!(text.contains("scatter by 0.04") || text.contains("scatter by 0.05"), "{text}");
        assert!(text.contains("normals = \"auto\"") && !text.contains("curved in both directions"), "{text}");
    }
    let smoothed = marked(obj(&noisy, &[]), NormalsChoice::Auto, 0.1).unwrap();
    assert!(smoothed.iter().any(|notice| notice.code == "mesh-noisy"));
    assert!(smoothed.iter().all(|notice| notice.code != "surface-loose" && notice.code != "stretch-remains"));
}

/// Smoothing rounds the edge of a noisy mesh; the drawing is judged on the mesh.
#[test]
fn an_edge_under_the_ink_of_a_noisy_mesh_is_reported() {
    let mut state = 11u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f64 / (1u64 << 24) as f64
    };
    let mut normal = || (0..12).map(|_| random()).sum::<f64>() - 6.0;
    let roof = sheet(0.6, |x, _| 10.0 - 0.36 * x.abs());
    let moved = roof.positions().iter().map(|at| at + Vector3::z() * (0.01 * normal()));
    let noisy = TriMesh::new(moved.collect(), Vec::new(), roof.triangles().to_vec()).unwrap();
    match marked(obj(&noisy, &[]), NormalsChoice::Auto, 0.1) {
        Err(reason) => assert_eq!(reason.code, "surface-not-met"),
        Ok(notices) => assert!(notices.iter().any(|notice| notice.code == "surface-loose"), "{notices:?}"),
    }
}

/// A can that lies oblique in its file, with coordinates to 0.01 mm, is exact in CAD and not noisy.
#[test]
fn rounded_coordinates_are_not_noise() {
    let can = shapes::graph(20.0, 0.5, |x, _| (40.0f64.powi(2) - x * x).sqrt());
    let turn = nalgebra::Rotation3::from_euler_angles(0.4, 0.3, 0.2);
    let rounded = can.positions().iter().map(|at| (turn * at).map(|value| (value * 100.0).round() / 100.0));
    let rounded = TriMesh::new(rounded.collect(), Vec::new(), can.triangles().to_vec()).unwrap();
    assert_eq!(read(&obj(&rounded, &[]), NormalsChoice::Auto).unwrap().facts.noise, None);
}

fn read(bytes: &[u8], normals: NormalsChoice) -> Result<mesh::PartReading, MeshReadError> {
    let options =
        MeshOptions::default().with_unit(LengthUnit::Millimetre).with_up(UpAxis::Z).with_normals(normals);
    mesh::read(bytes, MeshFormat::Obj, &options, &BTreeMap::new())
}

#[test]
fn meshes_without_a_clear_meaning_are_refused_with_the_place() {
    // Random normals.
    let dome = sheet(2.0, |x, y| 20.0 - (x * x + y * y) / 100.0);
    let mut state = 3u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f64 / (1u64 << 23) as f64 - 1.0
    };
    let normals: Vec<Vector3<f64>> =
        dome.positions().iter().map(|_| Vector3::new(random(), random(), random())).collect();
    let refused = marked(obj(&dome, &normals), NormalsChoice::Auto, 0.1).unwrap_err();
    assert_eq!(refused.code, "mesh-normals-wild");
    assert!(refused.place.coordinate.is_some() && refused.remedy.contains("estimate"), "{refused:?}");
    assert!(marked(obj(&dome, &normals), NormalsChoice::Estimate, 0.1).is_ok());
    // The same if all of them lead out of the part.
    let outward: Vec<Vector3<f64>> =
        normals.iter().map(|normal| Vector3::new(normal.x, normal.y, normal.z.abs())).collect();
    let refused = marked(obj(&dome, &outward), NormalsChoice::Auto, 0.1).unwrap_err();
    assert_eq!(refused.code, "mesh-normals-wild");
    // A Möbius strip.
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    const STEPS: u32 = 60;
    for step in 0..STEPS {
        let angle = TAU * f64::from(step) / f64::from(STEPS);
        for side in [-8.0, 8.0] {
            let reach = 30.0 + side * (angle / 2.0).cos();
            points.push(Point3::new(reach * angle.cos(), reach * angle.sin(), side * (angle / 2.0).sin()));
        }
    }
    for step in 0..STEPS {
        let [a, b] = [2 * step, 2 * step + 1];
        let [c, d] = if step + 1 < STEPS { [a + 2, b + 2] } else { [1, 0] };
        triangles.extend([[a, c, b], [b, c, d]]);
    }
    let strip = TriMesh::new(points, Vec::new(), triangles).unwrap();
    let refused = marked(obj(&strip, &[]), NormalsChoice::Auto, 0.1).unwrap_err();
    assert!(refused.code == "winding-contradicts" && refused.place.coordinate.is_some(), "{refused:?}");
    // Triangles without area.
    let text = b"v 0 0 0\nv 1 0 0\nv 2 0 0\nv 3 0 0\nf 1 2 3\nf 2 3 4\nf 1 1 2\n";
    assert!(matches!(read(text, NormalsChoice::Auto), Err(MeshReadError::NoTriangles { .. })));
}

/// Normally distributed numbers with a standard deviation of 1 (Box and Muller, A note on the generation of random normal deviates,
/// 1958).
fn normal_numbers() -> impl FnMut() -> f64 {
    let mut state = 11u64;
    let mut even = move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 40) as f64 + 0.5) / (1u64 << 24) as f64
    };
    move || (-2.0 * even().ln()).sqrt() * (TAU * even()).cos()
}

/// A cylinder with a radius of 40 mm along y.
fn arch(x: f64, _: f64) -> f64 {
    (1600.0 - x * x).sqrt() - 40.0
}

#[test]
fn normals_that_are_turned_are_named_with_their_angle_and_not_taken_for_coarse_facets() {
    let mesh = sheet(2.0, arch);
    let exact = |at: &Point3<f64>| Vector3::new(at.x, 0.0, at.z + 40.0) / 40.0;
    for lean in [0.0, 2.0, 4.0, 8.0] {
        let mut number = normal_numbers();
        let mut turned = |at: &Point3<f64>| {
            let off = Vector3::from_fn(|_, _| number() * f64::to_radians(lean));
            (exact(at) + off).normalize()
        };
        let normals: Vec<Vector3<f64>> = mesh.positions().iter().map(&mut turned).collect();
        let notices = marked(obj(&mesh, &normals), NormalsChoice::Auto, 1.0).unwrap();
        if lean == 0.0 {
            assert!(notices.iter().all(|notice| notice.code != "facets-coarse"), "{notices:#?}");
            continue;
        }
        let text = text(&notices, "facets-coarse");
        let found: f64 = text
            .split("the normals in the file lean by ")
            .nth(1)
            .unwrap()
            .split(' ')
            .next()
            .unwrap()
            .parse()
            .unwrap();
        assert!((found / lean - 1.0).abs() < 0.1, "{lean} deg: {text}");
        assert!(text.contains("Reset Vectors") && !text.contains("coarse"), "{text}");
        for notice in &notices {
            assert!(!notice.message.contains("too coarse"), "{lean} deg: {}", notice.message);
        }
    }
}

/// The scatter is less than the height of the arcs between neighbours, so that it is not smoothed.
#[test]
fn scatter_that_is_not_smoothed_is_named_and_not_taken_for_coarse_facets() {
    let whole = sheet(2.0, arch);
    let mut number = normal_numbers();
    let scattered = |at: &Point3<f64>| at + Vector3::from_fn(|_, _| 0.01 * number());
    let positions = whole.positions().iter().map(scattered).collect();
    let mesh = TriMesh::new(positions, Vec::new(), whole.triangles().to_vec()).unwrap();
    let notices = marked(obj(&mesh, &[]), NormalsChoice::Auto, 1.0).unwrap();
    let text = text(&notices, "facets-coarse");
    let found: f64 = text.split("scatter by ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((found / 0.01 - 1.0).abs() < 0.2, "{text}");
    assert!(text.contains("smooth the mesh") && !text.contains("coarse"), "{text}");
}

/// The CAD kernels that wrote these files compute their normals from the exact faces, however coarse the facets are.
#[test]
fn exact_normals_of_coarse_cad_exports_are_not_taken_for_turned() {
    for part in ["mandarin", "mouse", "can", "assembly"] {
        for name in ["build123d.glb", "occ8-coarse.glb", "fc020-coarse.glb"] {
            let path = format!("{}/tests/data/parts/{part}/{name}", env!("CARGO_MANIFEST_DIR"));
            let Ok(bytes) = fs_err::read(&path) else { continue };
            let reading =
                mesh::read(&bytes, MeshFormat::Glb, &MeshOptions::default(), &BTreeMap::new()).unwrap();
            assert_eq!(reading.facts.normals_lean_deg, None, "{part} {name}");
        }
    }
}
