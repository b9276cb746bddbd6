//! Recognition of cylinders: real exports of a cylinder are recognised, a part that only resembles one is not.

use std::collections::BTreeMap;
use std::path::Path as FilePath;

use isomark::formats::mesh::{self, MeshFormat, MeshOptions};
use isomark::geometry::height_field::FacingPart;
use isomark::geometry::ink::Ink;
use isomark::geometry::mapping::isometric::IsometricOptions;
use isomark::geometry::mapping::{LengthTrueMap, Method, quality};
use isomark::geometry::pattern::{Color, Layer, Path, Pattern, Segment, Shape, Source};
use isomark::geometry::shapes;
use isomark::geometry::space::{Facing, FlatPoint, View};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use nalgebra::Vector3;

const AUTOMATIC: Method =
    Method::Auto { exact_tolerance: Method::EXACT_TOLERANCE, otherwise: IsometricOptions::INK };

/// Five lines across, 39 mm long and 3 mm apart.
fn lines(middle: FlatPoint) -> Pattern {
    let line = |row: i32| {
        let y = middle.y + 3.0 * f64::from(row);
        let ends = [-19.5, 19.5].map(|x| FlatPoint::new(middle.x + x, y));
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
    let ink = Ink::sample(&drawing, |_| true, quality::PIECE, quality::SQUARE);
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
