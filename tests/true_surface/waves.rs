//! Short waves on a large part are fitted as finely as on a small one, and what remains is reported.

use std::f64::consts::TAU;

use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::mapping::isometric::IsometricOptions;
use isomark::geometry::mapping::quality::{self, Distortion};
use isomark::geometry::mapping::{LengthTrueMap, Method};
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::pattern::Affine;
use isomark::geometry::shapes;
use isomark::geometry::space::{FlatPoint, View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use nalgebra::{Point3, Vector3};

/// Heights of waves so many mm long, 0.1 mm from trough to crest, along x on a wide dome.
fn waved(length: f64) -> impl Fn(f64, f64) -> f64 {
    move |x, y| 0.05 * (TAU * x / length).sin() - (x * x + y * y) / 800.0
}

/// The mesh of a part of a radius with vertices and normals on the surface, mm.
fn part(radius: f64, edge: f64, length: f64) -> TriMesh {
    let flat = shapes::graph(radius, edge, |_, _| 0.0);
    let height = waved(length);
    let positions = flat.positions().iter().map(|at| Point3::new(at.x, at.y, height(at.x, at.y)));
    let slope = |x: f64| 0.05 * TAU / length * (TAU * x / length).cos() - x / 400.0;
    let normals = flat.positions().iter().map(|at| Vector3::new(-slope(at.x), at.y / 400.0, 1.0));
    TriMesh::new(positions.collect(), normals.collect(), flat.triangles().to_vec()).unwrap()
}

/// What the letters leave, as reported and in truth.
fn judged(surface: &FittedSurface, height: impl Fn(f64, f64) -> f64) -> [Distortion; 2] {
    let bytes = include_bytes!("../../examples/patterns/letters.dxf");
    let pattern = read(bytes, &PatternOptions::default()).unwrap().pattern;
    let anchor = FlatPoint::new(0.0, 0.0);
    let pattern = pattern.transformed(&Affine::rigid(pattern.extents().center().into(), 0.0, anchor));
    let method = Method::Isometric(IsometricOptions::INK);
    let map = LengthTrueMap::find(surface, &pattern, |_| true, anchor, &method).unwrap();
    let ink = quality::sample(&pattern, |_| true);
    let reported = quality::measure(&ink, |at| map.point(at), |at| surface.sampled_height(at)).unwrap();
    let truth = |at: ViewPoint| Some(height(at.x, at.y));
    [reported, quality::measure(&ink, |at| map.point(at), truth).unwrap()]
}

#[test]
fn short_waves_on_a_large_part_are_fitted_and_reported() {
    for (length, edge) in [(2.0, 0.4), (3.0, 0.5)] {
        let [small, large] = [26.0, 100.0].map(|radius| {
            let mesh = part(radius, edge, length);
            let part = FacingPart::new(&mesh, &View::top());
            judged(&FittedSurface::of_part(&part, &FitOptions::default()).unwrap(), waved(length))
        });
        let [reported, truth] = &large;
        println!(
            "waves of {length} mm: small {:.3} (reported {:.3}), large {:.3} (reported {:.3}) mm",
            small[1].length_error, small[0].length_error, truth.length_error, reported.length_error
        );
        assert!(
            truth.length_error < 1.5 * small[1].length_error + 0.1,
            "{length} mm: {} mm for {} mm on a small part",
            truth.length_error,
            small[1].length_error
        );
        assert!(
            (0.75..1.5).contains(&(reported.length_error / truth.length_error)),
            "{length} mm: reported {} mm, true {} mm",
            reported.length_error,
            truth.length_error
        );
    }
}
