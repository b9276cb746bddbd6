//! Recognition of cylinders: real exports of a cylinder are recognised, a part that only resembles one is not.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path as FilePath;

use isomark::formats::mesh::{self, MeshFormat, MeshOptions};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::mapping::isometric::IsometricOptions;
use isomark::geometry::mapping::{LengthTrueMap, Method, quality};
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::pattern::{Color, Layer, Path, Pattern, Segment, Shape, Source};
use isomark::geometry::shapes;
use isomark::geometry::space::{Facing, FlatPoint, View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use nalgebra::{Point3, Vector3};

const AUTOMATIC: Method =
    Method::Auto { exact_tolerance: Method::EXACT_TOLERANCE, otherwise: IsometricOptions::INK };

/// Five lines across, 39 mm long and 3 mm apart.
fn lines(middle: FlatPoint) -> Pattern {
    lines_of(39.0, 3.0, middle)
}

/// Five lines across.
fn lines_of(length: f64, apart: f64, middle: FlatPoint) -> Pattern {
    let line = |row: i32| {
        let y = middle.y + apart * f64::from(row);
        let ends = [-length / 2.0, length / 2.0].map(|x| FlatPoint::new(middle.x + x, y));
        Path {
            layer: 0,
            color: Color::ByLayer,
            shape: Shape::Open(vec![Segment::Line { from: ends[0], to: ends[1] }]),
            region: None,
            source: Source::default(),
        }
    };
    let layers = vec![Layer { name: "MARK".into(), color: Color::Aci(7) }];
    Pattern { layers, paths: (-2..=2).map(line).collect() }
}

#[test]
fn every_export_of_a_can_is_recognised_as_a_cylinder() {
    let folder = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/parts/can");
    for name in [
        "bl34-from-glb.obj",
        "bl52-from-glb.glb",
        "bl52-from-obj.glb",
        "build123d.glb",
        "fc020-arch.obj",
        "fc020-coarse-mesh.obj",
        "fc020-coarse.glb",
        "fc020-fine-mesh.obj",
        "fc020-fine.glb",
        "fc020-gui.glb",
        "occ8-coarse.glb",
        "occ8-fine-merged.glb",
    ] {
        let bytes = std::fs::read(folder.join(name)).unwrap();
        let format = MeshFormat::from_name(name).unwrap();
        let reading = mesh::read(&bytes, format, &MeshOptions::default(), &BTreeMap::new()).unwrap();
        let view = View::new(Facing::towards(Vector3::x()).unwrap(), 0.0);
        let facing = FacingPart::new(reading.shape.mesh().unwrap(), &view);
        let surface = FittedSurface::of_part(&facing, &FitOptions::default()).unwrap();
        let middle = FlatPoint::new(0.0, 56.0);
        let map = LengthTrueMap::find(&surface, &lines(middle), |_| true, middle, &AUTOMATIC).unwrap();
        let LengthTrueMap::Cylinder(_, fit) = map else { panic!("{name}: {:?}", map.fit_residual()) };
        println!("{name:24} radius {:.4} mm, residual {:.5} mm", fit.cylinder.radius, fit.residual);
        // The modelled radius is 33 mm; the vertices of the meshes are 32-bit floats in metres.
        assert!((fit.cylinder.radius - 33.0).abs() < 0.01 && fit.residual < 0.002, "{name}: {fit:?}");
    }
}

/// Round a hole or a boss, facets are narrow and irregular.
#[test]
fn shafts_with_a_hole_or_a_boss_are_recognised_as_cylinders() {
    let folder = FilePath::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/parts/shaded");
    for (name, radius) in [("occ-shaft-hole.stl", 22.4), ("occ-shaft-boss.stl", 25.2)] {
        let bytes = std::fs::read(folder.join(name)).unwrap();
        let reading = mesh::read(&bytes, MeshFormat::Stl, &MeshOptions::default(), &BTreeMap::new()).unwrap();
        let facing = FacingPart::new(reading.shape.mesh().unwrap(), &View::top());
        let surface = FittedSurface::of_part(&facing, &FitOptions::default()).unwrap();
        // Between the hole, or the boss, and the other end.
        let middle = FlatPoint::new(-6.0, 0.0);
        let map = LengthTrueMap::find(&surface, &lines(middle), |_| true, middle, &AUTOMATIC).unwrap();
        let LengthTrueMap::Cylinder(_, fit) = map else { panic!("{name}: {:?}", map.fit_residual()) };
        assert!((fit.cylinder.radius - radius).abs() < 0.001 && fit.residual < 0.001, "{name}: {fit:?}");
        assert!(surface.uncertainty(middle.coords().into()).slope < 0.001, "{name}");
    }
}

/// A solid about the x axis through rings, each at an x with a radius, mm, of which 0 is a point, as programs of solid geometry
/// export it: each coordinate has six digits.
fn turned(profile: &[[f64; 2]], sectors: u32) -> TriMesh {
    let (mut positions, mut rings) = (Vec::new(), Vec::new());
    for &[x, radius] in profile {
        let first = positions.len() as u32;
        let count = if radius > 0.0 { sectors } else { 1 };
        rings.push(move |step: u32| first + step % count);
        positions.extend((0..count).map(|step| {
            let angle = TAU * f64::from(step) / f64::from(sectors);
            let digits = |value: f64| format!("{value:.5e}").parse::<f64>().unwrap();
            Point3::new(x, digits(radius * angle.cos()), digits(radius * angle.sin()))
        }));
    }
    let ends = [rings[0], rings[rings.len() - 1]];
    let mut triangles = Vec::new();
    for step in 0..sectors {
        for pair in rings.windows(2) {
            let [low, high] = [pair[0], pair[1]];
            triangles.push([low(step + 1), high(step), low(step)]);
            triangles.push([low(step + 1), high(step + 1), high(step)]);
        }
        if step > 1 {
            triangles.push([ends[0](0), ends[0](step), ends[0](step - 1)]);
            triangles.push([ends[1](0), ends[1](step - 1), ends[1](step)]);
        }
    }
    triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    TriMesh::new(positions, Vec::new(), triangles).unwrap()
}

/// The rim of a tip with this radius, mm, has facets so narrow that six digits of the other ring do not show which of their sides is
/// the longest.
fn is_too_fine(tip: f64, sectors: u32) -> bool {
    tip > 0.0 && TAU * tip / f64::from(sectors) < 1.5e-3
}

/// Near the tip, the facets are narrower than what shows a plane.
#[test]
fn cones_are_recognised_however_near_they_come_to_a_point() {
    for tip in [0.0, 0.02, 0.05, 0.5, 2.0] {
        for sectors in [24, 33, 48, 64, 100] {
            if is_too_fine(tip, sectors) {
                continue;
            }
            let name = format!("{sectors} sectors to {tip} mm");
            let mesh = turned(&[[0.0, 20.0], [60.0, tip]], sectors);
            let facing = FacingPart::new(&mesh, &View::top());
            let surface = FittedSurface::of_part(&facing, &FitOptions::default()).unwrap();
            let middle = FlatPoint::new(22.0, 0.0);
            let drawing = lines_of(20.0, 2.5, middle);
            let map = LengthTrueMap::find(&surface, &drawing, |_| true, middle, &AUTOMATIC).unwrap();
            let LengthTrueMap::Cone(_, fit) = map else { panic!("{name}: {:?}", map.fit_residual()) };
            let half_angle = ((20.0 - tip) / 60.0).atan();
            assert!(
                (fit.cone.half_angle - half_angle).abs() < 1e-5 && fit.residual < 0.001,
                "{name}: {fit:?}"
            );
            assert!(surface.uncertainty(middle.coords().into()).slope < 0.001, "{name}");
            let exact = |at: ViewPoint| {
                let radius = 20.0 - (20.0 - tip) * at.x / 60.0;
                Some((radius * radius - at.y * at.y).sqrt())
            };
            let ink = quality::sample(&drawing, |_| true);
            let figures = quality::measure(&ink, |at| map.point(at), exact).unwrap();
            assert!(figures.length_error < 0.002, "{name}: {} mm", figures.length_error);
        }
    }
}

/// Bullets, pencils and bottles with a shoulder, with few facets round them: the edge between cylinder and cone turns by less than the
/// angle at which facets meet on some smooth parts.
#[test]
fn cylinders_that_end_in_cones_are_recognised_beside_their_edge() {
    let mut failures = Vec::new();
    for [radius, body, shoulder] in
        [[20.0, 30.0, 30.0], [20.0, 40.0, 50.0], [10.0, 60.0, 25.0], [4.0, 60.0, 15.0], [15.0, 20.0, 60.0]]
    {
        for tip in [0.0, 0.01, 0.1, 1.0] {
            for sectors in [16, 24, 30, 36, 48, 64] {
                if is_too_fine(tip, sectors) {
                    continue;
                }
                let mesh = turned(&[[0.0, radius], [body, radius], [body + shoulder, tip]], sectors);
                let facing = FacingPart::new(&mesh, &View::top());
                let surface = FittedSurface::of_part(&facing, &FitOptions::default()).unwrap();
                let radius_at = |x: f64| radius - (radius - tip) * (x - body).max(0.0) / shoulder;
                for x in [body / 2.0, body + shoulder / 3.0] {
                    let middle = FlatPoint::new(x, 0.0);
                    let drawing = lines_of(shoulder / 3.0, radius / 8.0, middle);
                    let found = LengthTrueMap::find(&surface, &drawing, |_| true, middle, &AUTOMATIC);
                    let left = found.as_ref().ok().filter(|map| map.fit_residual().is_some()).map(|map| {
                        let exact = |at: ViewPoint| Some((radius_at(at.x).powi(2) - at.y * at.y).sqrt());
                        let ink = quality::sample(&drawing, |_| true);
                        quality::measure(&ink, |at| map.point(at), exact).unwrap().length_error
                    });
                    let slope = surface.uncertainty(middle.coords().into()).slope;
                    if !(left.is_some_and(|left| left < 0.004) && slope < 0.001) {
                        failures.push(format!(
                            "{radius} x {body} + {shoulder} mm to {tip} mm, {sectors} sectors, at {x:.1}: {left:?}, {slope}"
                        ));
                    }
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// The upper half of the cross section of a tube deformed by three rollers: r = 30 mm + 0.2 mm · cos 3θ.
fn pressed(x: f64, _y: f64) -> f64 {
    let radius = |turn: f64| 30.0 + 0.2 * (3.0 * turn).cos();
    let turn = (0..60).fold(0.0, |turn: f64, _| (x / radius(turn)).clamp(-1.0, 1.0).asin());
    radius(turn) * turn.cos()
}

#[test]
fn a_part_that_is_not_quite_a_cylinder_is_mapped_as_a_free_form() {
    let mesh = shapes::graph(26.0, 0.75, pressed);
    let surface =
        FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default()).unwrap();
    let (drawing, middle) = (lines(FlatPoint::new(0.0, 0.0)), FlatPoint::new(0.0, 0.0));
    let ink = quality::sample(&drawing, |_| true);
    let found = |method: &Method| {
        let map = LengthTrueMap::find(&surface, &drawing, |_| true, middle, method).unwrap();
        let figures = quality::measure(&ink, |at| map.point(at), |at| Some(pressed(at.x, at.y))).unwrap();
        (map.fit_residual(), figures.length_error)
    };
    let (residual, forced) = found(&Method::Cylinder);
    let (exact, automatic) = found(&AUTOMATIC);
    println!("cylinder: residual {residual:?} mm, e_l {forced:.4} mm; automatic: e_l {automatic:.4} mm");
    assert!(residual.unwrap() < 0.02, "{residual:?}");
    assert_eq!(exact, None);
    assert!(automatic < forced / 4.0, "{automatic} mm, {forced} mm");
}
