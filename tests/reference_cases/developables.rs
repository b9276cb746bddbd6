//! Developable surfaces: all lengths can be kept, and every method must keep them.

use std::f64::consts::TAU;

use isomark::geometry::mapping::Method;

use super::drawings::{letters, square};
use super::{Case, INK, MOST_STEPS, UNIFORM, case};

fn cylinder(x: f64, _y: f64) -> f64 {
    (900.0 - x * x).max(0.0).sqrt()
}

/// The axis is rotated by 30° from y.
fn turned_cylinder(x: f64, y: f64) -> f64 {
    let (sin, cos) = 30f64.to_radians().sin_cos();
    cylinder(x * cos + y * sin, 0.0)
}

/// The axis rises by 15° along y: x² + (z cos − y sin)² = R².
fn tilted_cylinder(x: f64, y: f64) -> f64 {
    let (sin, cos) = 15f64.to_radians().sin_cos();
    (y * sin + cylinder(x, 0.0)) / cos
}

/// The axis along y, the apex at y = −100 mm, half angle 0.3 rad.
fn cone(x: f64, y: f64) -> f64 {
    let radius = (y + 100.0) * 0.3f64.tan();
    (radius * radius - x * x).max(0.0).sqrt()
}

/// Waves of 25 mm length and ±1.5 mm height, 20° from x: radii of curvature down to 10.6 mm.
fn waves(x: f64, y: f64) -> f64 {
    let (sin, cos) = 20f64.to_radians().sin_cos();
    1.5 * (TAU / 25.0 * (x * cos + y * sin)).sin()
}

const CYLINDERS: [Case; 3] = [
    case("cylinder", cylinder, [0.0, 0.0]),
    case("turned cylinder", turned_cylinder, [1.0, 2.0]),
    case("tilted cylinder", tilted_cylinder, [2.0, -1.0]),
];
pub(crate) const CONE: Case = case("cone", cone, [0.0, 0.0]);
const WAVES: Case = case("waves", waves, [0.0, 0.0]);

#[test]
fn general_maps_keep_all_lengths_on_developable_surfaces() {
    for case in CYLINDERS.into_iter().chain([CONE, WAVES]) {
        let surface = case.surface(28.5);
        for (name, drawing) in [("letters", letters()), ("square", square())] {
            for (weighting, method) in [("uniform", UNIFORM), ("ink", INK)] {
                let found = case.judged(&surface, &drawing, &method);
                found.print(case.name, name, weighting);
                assert!(found.length_error() < 0.005, "{}: {found:?}", case.name);
                assert!(found.area_error() < 1e-4 * found.figures.area, "{}: {found:?}", case.name);
                assert!(
                    found.isometric().settled && found.isometric().iterations.len() <= MOST_STEPS,
                    "{found:?}"
                );
            }
        }
    }
}

#[test]
fn exact_maps_keep_lengths_five_times_as_well() {
    let methods = CYLINDERS.map(|case| (case, Method::Cylinder)).into_iter().chain([(CONE, Method::Cone)]);
    for (case, method) in methods {
        let found = case.judged(&case.surface(28.5), &letters(), &method);
        found.print(case.name, "letters", "exact");
        assert!(found.length_error() < 0.001, "{}: {found:?}", case.name);
    }
}
