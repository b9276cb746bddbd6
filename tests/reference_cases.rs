//! The maps against the reference cases: surfaces with a formula, judged on the formula and not on our fit.
//!
//! The figures to reach come from independent computations (numpy, libigl, CGAL) on the same cases: letters of
//! 39 × 13 mm, meshes with edges of 0.75 mm without normals, e_l over pieces of at most 0.25 mm, e_a over squares of
//! 0.2 mm, the largest angular distortion over both.

#![allow(clippy::unwrap_used, reason = "helpers of tests may panic")]

use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::height_field::FacingPart;
use isomark::geometry::ink::Ink;
use isomark::geometry::mapping::isometric::IsometricOptions;
use isomark::geometry::mapping::quality::{self, Distortion};
use isomark::geometry::mapping::{LengthTrueMap, Method};
use isomark::geometry::pattern::{Affine, Pattern};
use isomark::geometry::shapes;
use isomark::geometry::space::{FlatPoint, View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};

type Height = fn(f64, f64) -> f64;

const SPHERE: (Height, [f64; 2]) = (shapes::sphere, [0.0, 0.0]);
const MANDARIN: (Height, [f64; 2]) = (shapes::mandarin, [0.0, 3.0]);
const MOUSE: (Height, [f64; 2]) = (shapes::mouse, [0.0, 8.0]);
const CYLINDER: (Height, [f64; 2]) = (shapes::cylinder, [0.0, 0.0]);
const CONE: (Height, [f64; 2]) = (shapes::cone, [0.0, 0.0]);

fn letters(at: FlatPoint) -> Pattern {
    let bytes = include_bytes!("../examples/patterns/letters.dxf");
    let pattern = read(bytes, &PatternOptions::default()).unwrap().pattern;
    pattern.transformed(&Affine::rigid(pattern.extents().center().into(), 0.0, at))
}

/// The figures on the true surface, and the map.
fn judged((height, [x, y]): (Height, [f64; 2]), method: Method) -> (Distortion, LengthTrueMap) {
    let mesh = shapes::graph(28.5, 0.75, height);
    let surface =
        FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default()).unwrap();
    let anchor = FlatPoint::new(x, y);
    let pattern = letters(anchor);
    let map = LengthTrueMap::find(&surface, &pattern, |_| true, anchor, &method).unwrap();
    let ink = Ink::sample(&pattern, |_| true, quality::PIECE, quality::SQUARE);
    let figures =
        quality::measure(&ink, |at| map.point(at), |at: ViewPoint| Some(height(at.x, at.y))).unwrap();
    (figures, map)
}

#[test]
fn the_yardstick_measures_plain_projection_as_the_reference_does() {
    // e_l, e_a and angle of the uncorrected letters.
    for (case, [length, area, angle]) in
        [(SPHERE, [9.03, 13.3, f64::NAN]), (MANDARIN, [5.45, 8.21, 12.5]), (MOUSE, [6.83, 10.0, 17.2])]
    {
        let (found, _) = judged(case, Method::Plain);
        assert!((found.length_error / length - 1.0).abs() < 0.005, "{found:?}");
        assert!((found.area_error / area - 1.0).abs() < 0.005, "{found:?}");
        // The reference looks at squares only, here the outlines round them count too.
        let degrees = found.largest_angle_error.to_degrees();
        assert!(angle.is_nan() || (degrees >= angle - 0.05 && degrees < angle * 1.03), "{degrees} deg");
    }
}

#[test]
fn uniform_weighting_reaches_the_floor_within_five_percent() {
    let method = Method::Isometric(IsometricOptions::UNIFORM);
    for (case, [length, area, angle]) in
        [(SPHERE, [0.56, 0.40, 1.05]), (MANDARIN, [0.35, 0.24, 0.66]), (MOUSE, [0.111, 0.079, 0.20])]
    {
        let (found, _) = judged(case, method);
        assert!(found.length_error < length * 1.05, "{found:?}");
        assert!(found.area_error < area * 1.05, "{found:?}");
        assert!(found.largest_angle_error.to_degrees() < angle * 1.07, "{found:?}");
    }
}

#[test]
fn ink_weighting_beats_the_reference_in_lengths_areas_and_angles_together() {
    // The rows for cells of 2 mm; those for 3.25 mm (0.242 / 0.095 / 1.02°, …) lie above them.
    let method = Method::Isometric(IsometricOptions::INK);
    for (case, [length, area], angle) in
        [(SPHERE, [0.198, 0.065], 1.02), (MANDARIN, [0.125, 0.040], 0.60), (MOUSE, [0.041, 0.013], 0.18)]
    {
        let (found, map) = judged(case, method);
        assert!(found.length_error <= length, "{found:?}");
        assert!(found.area_error <= area, "{found:?}");
        assert!(found.largest_angle_error.to_degrees() <= angle, "{found:?}");
        let anchor = FlatPoint::new(case.1[0], case.1[1]);
        assert!((map.point(anchor).coords() - anchor.coords()).norm() < 1e-6, "the anchor stays");
        let LengthTrueMap::Isometric(map) = map else { panic!("an isometric map") };
        assert!(map.iterations.len() <= 6, "{:?}", map.iterations);
    }
}

#[test]
fn on_a_cylinder_the_exact_map_is_chosen_and_is_exact() {
    let automatic =
        Method::Auto { exact_tolerance: Method::EXACT_TOLERANCE, otherwise: IsometricOptions::INK };
    let (found, map) = judged(CYLINDER, automatic);
    assert!(matches!(map, LengthTrueMap::Cylinder(..)));
    assert!(found.length_error <= 0.001 && found.area_error <= 0.001, "{found:?}");
    let (found, _) = judged(CYLINDER, Method::Isometric(IsometricOptions::INK));
    assert!(found.length_error <= 0.01, "{found:?}");
}

#[test]
fn on_a_cone_the_exact_map_is_chosen_and_is_exact() {
    // 39 mm of letters on a radius of 19 mm reach 58° round it; the mesh ends a little beyond.
    let automatic =
        Method::Auto { exact_tolerance: Method::EXACT_TOLERANCE, otherwise: IsometricOptions::INK };
    let (found, map) = judged(CONE, automatic);
    let LengthTrueMap::Cone(map, _) = map else { panic!("a cone, not {map:?}") };
    assert!((map.cone.half_angle - 0.3).abs() < 1e-4, "{:?}", map.cone);
    assert!(found.length_error <= 0.005 && found.area_error <= 0.005, "{found:?}");
}

#[test]
fn free_forms_are_not_taken_for_cylinders() {
    let automatic =
        Method::Auto { exact_tolerance: Method::EXACT_TOLERANCE, otherwise: IsometricOptions::INK };
    for case in [SPHERE, MANDARIN, MOUSE] {
        let (_, map) = judged(case, automatic);
        assert!(matches!(map, LengthTrueMap::Isometric(_)));
    }
}
