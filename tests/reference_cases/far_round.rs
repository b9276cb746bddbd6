//! Drawings that extend far round the part: up to slopes of 60°, and beyond the region that can be marked.

use isomark::geometry::mapping::isometric::IsometricError;
use isomark::geometry::mapping::{LengthTrueMap, MapError, Method, quality};
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::pattern::{Affine, Pattern};
use isomark::geometry::shapes;
use isomark::geometry::space::FlatPoint;
use nalgebra::{Matrix2, Point3, Vector2};

use super::drawings::{disc, grid, letters};
use super::{
    CYLINDER, Case, INK, MANDARIN, MOST_STEPS, MOST_STEPS_OF_AREAS, MOUSE, SPHERE, UNIFORM, case, fitted,
};

/// A tube along y, 40 mm long, from −85° to 85°, with edges of 0.75 mm and a radius of 30 mm.
fn tube() -> TriMesh {
    let (columns, rows) = (119, 54);
    let node = |index: u32| {
        let angle = 85f64.to_radians() * (2.0 * f64::from(index % (columns + 1)) / f64::from(columns) - 1.0);
        let y = 40.0 * f64::from(index / (columns + 1)) / f64::from(rows) - 20.0;
        Point3::new(30.0 * angle.sin(), y, 30.0 * angle.cos())
    };
    let mut triangles = Vec::new();
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let lower = row * (columns + 1) + column;
        let upper = lower + columns + 1;
        triangles.extend([[lower, lower + 1, upper], [lower + 1, upper + 1, upper]]);
    }
    TriMesh::new((0..(columns + 1) * (rows + 1)).map(node).collect(), Vec::new(), triangles).unwrap()
}

fn turned(drawing: &Pattern, degrees: f64) -> Pattern {
    let origin = FlatPoint::new(0.0, 0.0);
    drawing.transformed(&Affine::rigid(origin, degrees.to_radians(), origin))
}

/// A filled disc, mm across.
fn disc_of(width: f64) -> Pattern {
    disc().transformed(&Affine { linear: Matrix2::identity() * (width / 30.0), offset: Vector2::zeros() })
}

#[test]
fn lines_wrap_120_degrees_of_a_cylinder_by_every_method() {
    // 1.3 m of lines; 0.002 mm of the error is due to the pieces of 0.25 mm, which are chords.
    let surface = fitted(&tube());
    for (name, method) in [("uniform", UNIFORM), ("ink", INK), ("exact", Method::Cylinder)] {
        let found = CYLINDER.judged(&surface, &grid(62.4, 13.0), &method);
        found.print("120° round", "grid", name);
        assert!(found.length_error() < 0.005 && found.figures.max_stretch < 5e-4, "{found:?}");
    }
}

#[test]
fn results_on_a_sphere_are_the_same_everywhere_up_to_slopes_of_60_degrees() {
    let surface = SPHERE.surface(29.5);
    for method in [UNIFORM, INK] {
        let middle = SPHERE.judged(&surface, &letters(), &method);
        // At x = 12 mm the last letter ends where the slope is 61°. The bounding box of the letters does not change.
        for (place, degrees) in
            [([12.0, 0.0], 0.0), ([0.0, -15.0], 0.0), ([-9.0, 7.0], 180.0), ([0.0, 10.0], 90.0)]
        {
            let found =
                case("sphere", shapes::sphere, place).judged(&surface, &turned(&letters(), degrees), &method);
            // The cells of the map and of the surface are at other places under the letters.
            let near = |found: f64, middle: f64| (found / middle - 1.0).abs() < 0.05;
            // With ink weights, the rounds end before the last percents of the smallest error.
            let no_worse = |found: f64, middle: f64| found / middle < 1.1;
            assert!(near(found.length_error(), middle.length_error()), "{place:?}: {found:?}, {middle:?}");
            assert!(no_worse(found.area_error(), middle.area_error()), "{place:?}: {found:?}, {middle:?}");
            assert!(near(found.angle(), middle.angle()), "{place:?}: {found:?}, {middle:?}");
            assert!(
                found.isometric().settled && found.isometric().iterations.len() <= MOST_STEPS,
                "{found:?}"
            );
        }
    }
}

#[test]
fn a_few_steps_are_enough_at_any_place_and_rotation() {
    let saddle = case("saddle", shapes::saddle, [0.0, 0.0]);
    let bumps = case("bumps", shapes::bumps, [0.0, 0.0]);
    for Case { name, height, place: [x, y] } in [MANDARIN, MOUSE, saddle, bumps] {
        let surface = case(name, height, [x, y]).surface(31.0);
        for ([right, up], degrees) in [([4.0, -3.0], 0.0), ([-2.0, 1.0], 37.0), ([3.0, -2.0], -70.0)] {
            let here = case(name, height, [x + right, y + up]);
            let uniform = here.judged(&surface, &turned(&letters(), degrees), &UNIFORM);
            let inked = here.judged(&surface, &turned(&letters(), degrees), &INK);
            assert!(inked.length_error() < uniform.length_error(), "{name}: {inked:?}, uniform {uniform:?}");
            for found in [&uniform, &inked] {
                let map = found.isometric();
                assert!(
                    map.settled && map.iterations.len() <= MOST_STEPS,
                    "{name} {degrees}°: {:?}",
                    map.iterations
                );
            }
        }
    }
}

#[test]
fn a_disc_can_cover_most_of_the_visible_side_of_a_mandarin() {
    let surface = MANDARIN.surface(29.5);
    for width in [40.0, 48.0, 54.0] {
        let uniform = MANDARIN.judged(&surface, &disc_of(width), &UNIFORM);
        let inked = MANDARIN.judged(&surface, &disc_of(width), &INK);
        let plain = MANDARIN.judged(&surface, &disc_of(width), &Method::Plain);
        for (found, name) in [(&uniform, "uniform"), (&inked, "ink")] {
            found.print("mandarin", &format!("disc {width}"), name);
            let map = found.isometric();
            assert!(
                map.settled && map.iterations.len() <= MOST_STEPS_OF_AREAS,
                "{width}: {:?}",
                map.iterations
            );
        }
        assert!(inked.length_error() < uniform.length_error(), "{width}: {inked:?}, uniform {uniform:?}");
        assert!(inked.area_error() < 0.8 * uniform.area_error(), "{width}: {inked:?}, uniform {uniform:?}");
        assert!(uniform.area_error() < 0.5 * plain.area_error(), "{width}: {uniform:?}, plain {plain:?}");
    }
}

#[test]
fn a_drawing_beyond_the_horizon_is_rejected_with_the_place() {
    for (case, drawing) in
        [(MANDARIN, grid(78.0, 26.0)), (SPHERE, grid(117.0, 13.0)), (SPHERE, disc_of(90.0))]
    {
        let surface = case.surface(28.5);
        for method in [UNIFORM, INK] {
            let placed = case.placed(&drawing);
            let found = LengthTrueMap::find(&surface, &placed, |_| true, case.anchor(), &method);
            match found {
                // If the search converges on the extrapolated surface beyond the rim, the measurement finds no part.
                Ok(map) => {
                    let ink = quality::sample(&placed, |_| true);
                    let off = quality::measure(&ink, |at| map.point(at), |at| surface.sampled_height(at));
                    assert!(off.unwrap_err().coords().norm() > 20.0, "{}", case.name);
                }
                Err(MapError::Isometric(IsometricError::Folded { at })) => {
                    assert!(at.coords().norm() > 15.0 && at.coords().norm() < 60.0, "{at:?}");
                }
                Err(MapError::Isometric(IsometricError::NotConverged { iterations })) => {
                    assert!(iterations.len() > 20 && iterations.len() < 30, "{iterations:?}");
                }
                Err(other) => panic!("{}: {other:?}", case.name),
            }
        }
    }
}
