//! The fitted surface is the CAD surface, not its facets: coarse tessellations compared with closed forms.
//!
//! `cargo test --test true_surface -- --nocapture --test-threads 1` prints the table of all results.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic")]
#![allow(clippy::print_stdout, reason = "prints the table of results")]

mod bounds;
mod cambers;
mod decimated;
mod edges;
mod flat_shading;
mod exact_maps;
mod forms;
mod generated;
mod causes;
mod choice;
mod coarse;
mod holes;
mod noise;
mod profiles;
mod waves;
mod shading;
mod skins;
mod small_forms;
mod small_ink;
mod steep_scans;
mod sweep;
mod winding;

use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::space::{View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use nalgebra::Point3;

use self::forms::{ALL, Form, Normals};

/// Steeper surface is not marked: the cosine of the largest tilt.
const MARKED: f64 = 0.5;

fn fitted(form: &Form, sag: f64, normals: Normals) -> FittedSurface {
    let mesh = form.mesh(sag, normals);
    FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default()).unwrap()
}

/// The largest distance of the fitted surface from the form along its normal, mm, and its position, over the region
/// that can be marked and is `margins` (a share of the range of each parameter) away from the mesh's rims.
fn largest_miss(form: &Form, surface: &FittedSurface, margins: [f64; 2]) -> (f64, ViewPoint) {
    let mut worst = (0.0, ViewPoint::new(0.0, 0.0));
    for row in 0..=120 {
        for column in 0..=120 {
            let along = |side: usize, index: i32| {
                let [from, to] = form.range[side];
                let share = f64::from(index) / 120.0;
                from + (to - from) * (margins[side] + (1.0 - 2.0 * margins[side]) * share)
            };
            let (point, normal) = (form.at)(along(0, column), along(1, row));
            let at = ViewPoint::new(point.x, point.y);
            let miss = (surface.nurbs.height(at) - point.z).abs() * normal.z;
            if normal.z > MARKED && miss > worst.0 {
                worst = (miss, at);
            }
        }
    }
    worst
}

#[test]
fn coarse_tessellations_reproduce_the_original_surface() {
    let mut failures = Vec::new();
    for form in ALL {
        for normals in [Normals::Exact, Normals::Facets, Normals::Missing] {
            for (sag, limit) in [(0.02, 0.001), (0.1, 0.005), (0.5, 0.03)] {
                let surface = fitted(&form, sag, normals);
                // At a rim, normals can be estimated from one side only, so they are inaccurate there.
                let margins = match (normals, form.counts(sag)) {
                    (Normals::Exact, _) | (_, [_, 1]) => [0.01, 0.01],
                    (_, counts) => counts.map(|count| 1.0 / f64::from(count)),
                };
                let (miss, at) = largest_miss(&form, &surface, margins);
                let name = form.name;
                let verdict = if miss < limit { "" } else { " <<" };
                println!(
                    "{name:10} {normals:?} sag {sag:.2}: {miss:.5} mm at ({:.1}, {:.1}); residual {:.5} rms {:.5} spans {}{verdict}",
                    at.x,
                    at.y,
                    surface.residual.max,
                    surface.residual.rms,
                    surface.nurbs.knots().0.spans(),
                );
                if miss > limit {
                    failures.push(format!("{name} {normals:?} {sag}: {miss:.4} mm"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// A dome of radius 50 mm with a square outline of 40 mm, above a table at z = −20 mm.
fn dome_on_a_table() -> TriMesh {
    const CELLS: u32 = 80;
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    for (half, height) in [(40.0, (|_, _| -20.0) as fn(f64, f64) -> f64), (20.0, dome)] {
        let first = u32::try_from(points.len()).unwrap();
        for row in 0..=CELLS {
            for column in 0..=CELLS {
                let along = |index: u32| half * (2.0 * f64::from(index) / f64::from(CELLS) - 1.0);
                let (x, y) = (along(column), along(row));
                points.push(Point3::new(x, y, height(x, y)));
                if row > 0 && column > 0 {
                    let corner = first + row * (CELLS + 1) + column;
                    let below = corner - CELLS - 1;
                    triangles.extend([[below - 1, below, corner], [below - 1, corner, corner - 1]]);
                }
            }
        }
    }
    TriMesh::new(points, Vec::new(), triangles).unwrap()
}

fn dome(x: f64, y: f64) -> f64 {
    (2500.0 - x * x - y * y).sqrt() - 40.0
}

#[test]
fn a_fit_does_not_oscillate_near_a_cliff() {
    let surface =
        FittedSurface::of_part(&FacingPart::new(&dome_on_a_table(), &View::top()), &FitOptions::default())
            .unwrap();
    for step in 0..=36 {
        let (x, y) = (0.5 * f64::from(step), 0.3);
        let jet = surface.jet(ViewPoint::new(x, y));
        let height = dome(x, y);
        assert!((jet.height - height).abs() < 0.002, "{} mm off at x = {x} mm", jet.height - height);
        let slope = -x / (height + 40.0);
        assert!((jet.gradient.x - slope).abs() < 0.01, "slope {} for {slope} at x = {x} mm", jet.gradient.x);
    }
}
