//! Small curved forms on wide flat parts, where the samples of the whole part are few. The truth are the formulas of the forms.

use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::space::{Extents, FlatPoint, View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use nalgebra::{Point3, Vector2};

use super::small_ink::{Judged, Part};

/// Facets of 4 degrees.
const FACET: f64 = std::f64::consts::PI / 45.0;

/// A square plate with a round rod of this radius along its middle, half sunk into it.
fn rod_on_plate(width: f64, radius: f64) -> TriMesh {
    let arc = (0..=45).map(|at| -radius * (f64::from(at) * FACET).cos());
    let columns: Vec<f64> = [-width / 2.0].into_iter().chain(arc).chain([width / 2.0]).collect();
    let height = |x: f64| (radius * radius - x * x).max(0.0).sqrt();
    let positions =
        columns.iter().flat_map(|&x| [-1.0, 1.0].map(|end| Point3::new(x, end * width / 2.0, height(x))));
    let triangles = (0..columns.len() as u32 - 1).flat_map(|column| {
        let corner = 2 * column;
        [[corner, corner + 2, corner + 3], [corner, corner + 3, corner + 1]]
    });
    TriMesh::new(positions.collect(), Vec::new(), triangles.collect()).unwrap()
}

/// A round plate with a cap of a ball of this radius in its middle, which meets it at 45 degrees.
fn cap_on_plate(width: f64, radius: f64) -> TriMesh {
    const SECTORS: u32 = 90;
    let rings = (1..=11).map(|ring| f64::from(ring) / 11.0 * std::f64::consts::FRAC_PI_4);
    let rings = rings.map(|angle| (radius * angle.sin(), radius * angle.cos()));
    let foot = radius * std::f64::consts::FRAC_PI_4.cos();
    let rings: Vec<(f64, f64)> = rings.chain([(width / 2.0, foot)]).collect();
    let mut positions = vec![Point3::new(0.0, 0.0, radius)];
    for (from_axis, z) in &rings {
        positions.extend((0..SECTORS).map(|sector| {
            let (sin, cos) = (f64::from(sector) * FACET).sin_cos();
            Point3::new(from_axis * cos, from_axis * sin, *z)
        }));
    }
    let at = |ring: u32, sector: u32| 1 + ring * SECTORS + sector % SECTORS;
    let mut triangles: Vec<[u32; 3]> =
        (0..SECTORS).map(|sector| [0, at(0, sector), at(0, sector + 1)]).collect();
    for ring in 1..rings.len() as u32 {
        for sector in 0..SECTORS {
            let corners =
                [at(ring - 1, sector), at(ring, sector), at(ring, sector + 1), at(ring - 1, sector + 1)];
            triangles.extend([[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]]);
        }
    }
    TriMesh::new(positions, Vec::new(), triangles).unwrap()
}

fn fitted(mesh: &TriMesh) -> FittedSurface {
    FittedSurface::of_part(&FacingPart::new(mesh, &View::top()), &FitOptions::default()).unwrap()
}

/// The surface round letters that are as wide as `across`, in the middle of the part.
fn round(mesh: &TriMesh, across: f64) -> FittedSurface {
    let half = Vector2::new(across / 2.0, across / 6.0);
    fitted(mesh).round(&Extents { min: -half, max: half }).expect("smaller spans on the form")
}

fn check(name: &str, part: &Part, across: f64, most: f64, failures: &mut Vec<String>) {
    let Some(Judged { after: [reported, truth], .. }) = part.judged(across, FlatPoint::new(0.0, 0.0), 0.0)
    else {
        failures.push(format!("{name}: not marked"));
        return;
    };
    let (reported, truth) = (reported.length_error, truth.length_error);
    println!("{name}: reported {reported:.4} mm, true {truth:.4} mm");
    // The least that letters are reported with is about 0.0005 mm; 0.01 mm are less than 0.1 % of their lines.
    if truth > most || reported > 2.0 * truth + 0.01 || truth > reported + 5e-4 {
        failures.push(format!("{name}: reported {reported:.4} mm, true {truth:.4} mm"));
    }
}

#[test]
fn rods_on_wide_plates_are_cylinders() {
    let mut failures = Vec::new();
    for (width, radius) in [(100.0, 3.0), (200.0, 3.0), (200.0, 5.0), (400.0, 5.0), (400.0, 10.0)] {
        let name = format!("rod of {radius} mm on {width} mm");
        let surface = round(&rod_on_plate(width, radius), 1.2 * radius);
        let height = move |x: f64, _: f64| (radius * radius - x * x).sqrt();
        check(&name, &Part::new(name.clone(), surface, height), 1.2 * radius, 0.005, &mut failures);
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn caps_on_wide_plates_are_round() {
    let mut failures = Vec::new();
    for (width, radius) in [(100.0, 5.0), (200.0, 5.0), (200.0, 8.0), (400.0, 6.0), (400.0, 15.0)] {
        let name = format!("cap of {radius} mm on {width} mm");
        let surface = round(&cap_on_plate(width, radius), 0.7 * radius);
        let height = move |x: f64, y: f64| (radius * radius - x * x - y * y).sqrt();
        check(&name, &Part::new(name.clone(), surface, height), 0.7 * radius, 0.02, &mut failures);
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// The spans of the plate are as they were, and beside the form there are no others.
#[test]
fn a_plate_beside_a_small_form_keeps_its_spans() {
    let surface = fitted(&cap_on_plate(200.0, 5.0));
    assert!(!surface.windows().is_empty() && surface.nurbs.knots().0.spans() == 72);
    let beside = |x: f64| {
        let (low, high) = (Vector2::new(x, -5.0), Vector2::new(x + 10.0, 5.0));
        surface.round(&Extents { min: low, max: high })
    };
    assert!(beside(40.0).is_none() && beside(-90.0).is_none());
    let near = beside(-2.0).unwrap();
    assert!(near.nurbs.knots().0.step() < 0.2 * surface.nurbs.knots().0.step());
    // It continues as the plate.
    let foot = 5.0 * std::f64::consts::FRAC_PI_4.cos();
    assert!((near.sampled_height(ViewPoint::new(9.5, 1.0)).unwrap() - foot).abs() < 1e-3);
}
