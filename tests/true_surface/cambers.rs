//! Plates whose top is a shallow cylinder, as CAD kernels divide them: at their outline and at the rims of holes alone. The truth is the
//! cylinder.

use std::f64::consts::TAU;

use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::space::{View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use nalgebra::{Point3, Rotation3, Unit, Vector3};

use super::bounds::{SLACK, judged};

/// The outline of a plate counter-clockwise from its left end, mm.
#[derive(Debug, Clone, Copy)]
enum Outline {
    /// With these half axes.
    Ellipse(f64, f64),
    /// With this half length and radius.
    Stadium(f64, f64),
}

impl Outline {
    /// Its points, the lower and the upper ones from left to right, not in line across it.
    fn chains(self) -> [Vec<[f64; 2]>; 2] {
        const STEPS: u32 = 13;
        [-1.0, 1.0].map(|side| {
            let at = |step: u32| {
                let uneven = if step == 0 || step == STEPS { 0.0 } else { 0.15 * side };
                let angle = TAU / 2.0 * (f64::from(step) + uneven) / f64::from(STEPS);
                let (x, y) = (-angle.cos(), side * angle.sin());
                match self {
                    Self::Ellipse(a, b) => [a * x, b * y],
                    Self::Stadium(half, radius) => [radius * x + (half - radius) * x.signum(), radius * y],
                }
            };
            (0..=STEPS).map(at).collect()
        })
    }
}

/// How the top of a plate is divided.
#[derive(Debug, Clone, Copy)]
enum Division {
    /// In fans round both ends.
    Fans,
    /// In strips across it.
    Strips,
}

/// A position as a file with so many decimals states it, or one of single precision.
fn written(position: Point3<f64>, decimals: Option<i32>) -> Point3<f64> {
    let to = |value: f64| match decimals {
        Some(decimals) => (value * 10f64.powi(decimals)).round() / 10f64.powi(decimals),
        None => f64::from(value as f32),
    };
    position.map(to)
}

/// A plate with walls down to z = −12 mm, whose top has a height.
fn plate(
    outline: Outline,
    division: Division,
    decimals: Option<i32>,
    height: impl Fn(f64, f64) -> f64,
) -> TriMesh {
    let [lower, upper] = outline.chains();
    let last = lower.len() as u32 - 1;
    // The rim counter-clockwise from the left end.
    let rim: Vec<[f64; 2]> = lower.iter().chain(upper[1..last as usize].iter().rev()).copied().collect();
    let count = rim.len() as u32;
    let index = |side: usize, step: u32| if side == 0 { step } else { (count - step) % count };
    let mut triangles = Vec::new();
    match division {
        Division::Fans => {
            let middle = last / 2;
            for step in 1..last {
                let end = if step < middle { 0 } else { last };
                triangles.push([index(0, step), index(0, step + 1), end]);
                triangles.push([index(1, step + 1), index(1, step), end]);
            }
            triangles.retain(|&[a, b, c]| a != c && b != c);
            triangles.extend([[0, index(0, middle), last], [index(1, middle), 0, last]]);
        }
        Division::Strips => {
            let (mut low, mut high) = (0, 0);
            while low < last || high < last {
                let next = |chain: &[[f64; 2]], at: u32| {
                    chain.get(at as usize + 1).map_or(f64::INFINITY, |at| at[0])
                };
                if next(&lower, low) <= next(&upper, high) {
                    triangles.push([index(0, low), index(0, low + 1), index(1, high)]);
                    low += 1;
                } else {
                    triangles.push([index(0, low), index(1, high + 1), index(1, high)]);
                    high += 1;
                }
            }
            triangles.retain(|&[a, b, c]| a != b && b != c && a != c);
        }
    }
    for here in 0..count {
        let next = (here + 1) % count;
        triangles.extend([[here, count + here, count + next], [here, count + next, next]]);
    }
    let top = rim.iter().map(|&[x, y]| Point3::new(x, y, height(x, y)));
    let bottom = rim.iter().map(|&[x, y]| Point3::new(x, y, -12.0));
    let positions = top.chain(bottom).map(|at| written(at, decimals)).collect();
    TriMesh::new(positions, Vec::new(), triangles).unwrap()
}

/// A round plate with a hole in its middle and walls down to z = −12 mm, whose top has a height.
fn ring(radius: f64, hole: f64, height: impl Fn(f64, f64) -> f64) -> TriMesh {
    const STEPS: u32 = 28;
    let circle = |radius: f64, phase: f64| {
        (0..STEPS).map(move |step| {
            let angle = TAU * (f64::from(step) + phase) / f64::from(STEPS);
            [radius * angle.cos(), radius * angle.sin()]
        })
    };
    let circles = || circle(radius, 0.0).chain(circle(hole, 0.4));
    let top = circles().map(|[x, y]| Point3::new(x, y, height(x, y)));
    let bottom = circles().map(|[x, y]| Point3::new(x, y, -12.0));
    let positions = top.chain(bottom).map(|at| written(at, None)).collect();
    let mut triangles = Vec::new();
    for here in 0..STEPS {
        let next = (here + 1) % STEPS;
        triangles.extend([[here, next, STEPS + here], [next, STEPS + next, STEPS + here]]);
        let base = 2 * STEPS;
        triangles.extend([[here, base + here, base + next], [here, base + next, next]]);
        let [here, next] = [STEPS + here, STEPS + next];
        triangles.extend([[here, base + next, base + here], [here, next, base + next]]);
    }
    TriMesh::new(positions, Vec::new(), triangles).unwrap()
}

/// The reported and the true length error, mm.
fn errors(mesh: &TriMesh, height: impl Fn(f64, f64) -> f64) -> [f64; 2] {
    let surface = FittedSurface::of_part(&FacingPart::new(mesh, &View::top()), &FitOptions::default());
    judged(&surface.unwrap(), height).map(|of| of.length_error)
}

/// The height of a cylinder about an axis along x, or along y.
fn cylinder(radius: f64, is_hollow: bool, is_along_y: bool) -> impl Fn(f64, f64) -> f64 + Copy {
    move |x, y| {
        let across: f64 = if is_along_y { x } else { y };
        let sag = radius - (radius * radius - across * across).sqrt();
        if is_hollow { sag } else { -sag }
    }
}

/// Few facets meet at each chord, and an ellipse is nearly on another cylinder, which is hollow, and on cones.
#[test]
fn cambered_plates_with_round_outlines_are_round() {
    let mut failures = Vec::new();
    let ellipse = Outline::Ellipse(45.0, 25.0);
    for (outline, division) in [
        (ellipse, Division::Fans),
        (ellipse, Division::Strips),
        (Outline::Ellipse(30.0, 30.0), Division::Fans),
        (Outline::Ellipse(30.0, 30.0), Division::Strips),
        (Outline::Stadium(45.0, 25.0), Division::Fans),
        (Outline::Stadium(45.0, 25.0), Division::Strips),
    ] {
        for (radius, is_hollow, is_along_y) in [
            (150.0, false, false),
            (300.0, false, false),
            (300.0, false, true),
            (300.0, true, false),
            (1000.0, false, false),
        ] {
            let height = cylinder(radius, is_hollow, is_along_y);
            let name = format!(
                "{outline:?} in {division:?}, R {radius}, hollow: {is_hollow}, along y: {is_along_y}"
            );
            let [reported, truth] = errors(&plate(outline, division, None, height), height);
            println!("{name:74} {reported:8.4} {truth:8.4}");
            if truth > SLACK[0] || reported > 2.0 * SLACK[0] {
                failures.push(format!("{name}: {truth:.4} is reported as {reported:.4}"));
            }
        }
    }
    for radius in [150.0, 500.0] {
        let height = cylinder(radius, false, false);
        let mesh = ring(35.0, 4.0, height);
        let surface = FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default());
        let surface = surface.unwrap();
        for step in 0..100 {
            let (angle, from_middle) = (0.7 * f64::from(step), 6.0 + 0.25 * f64::from(step));
            let (x, y) = (from_middle * angle.cos(), from_middle * angle.sin());
            let off = (surface.nurbs.height(ViewPoint::new(x, y)) - height(x, y)).abs();
            if off > SLACK[0] {
                failures.push(format!("ring, R {radius}: {off:.4} mm off at ({x:.1}, {y:.1})"));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// With three decimals, the vertices of an ellipse or of a circle do not tell which of two cylinders they are on.
#[test]
fn what_rounding_leaves_open_of_a_camber_is_in_the_report() {
    let mut failures = Vec::new();
    for outline in [Outline::Ellipse(45.0, 25.0), Outline::Ellipse(30.0, 30.0), Outline::Stadium(45.0, 25.0)]
    {
        for division in [Division::Fans, Division::Strips] {
            for (radius, is_hollow) in [(300.0, false), (300.0, true), (800.0, false), (800.0, true)] {
                let height = cylinder(radius, is_hollow, false);
                let name = format!("{outline:?} in {division:?}, R {radius}, hollow: {is_hollow}");
                let [reported, truth] = errors(&plate(outline, division, Some(3), height), height);
                println!("{name:74} {reported:8.4} {truth:8.4}");
                if reported < truth - SLACK[0] {
                    failures.push(format!("{name}: {truth:.4} is reported as {reported:.4}"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

/// A plate of 80 by 50 mm on a sphere, in `cells` along each side, with exact normals; a fillet of 2 mm along both long sides is in
/// narrow facets.
fn on_sphere(radius: f64, cells: u32) -> TriMesh {
    const FILLET: f64 = 2.0;
    const STEPS: u32 = 4;
    let across = |row: u32| {
        if row < STEPS {
            (-25.0, -TAU / 4.0 * f64::from(STEPS - row) / f64::from(STEPS))
        } else if row > STEPS + cells {
            (25.0, TAU / 4.0 * f64::from(row - STEPS - cells) / f64::from(STEPS))
        } else {
            (50.0 * (f64::from(row - STEPS) / f64::from(cells) - 0.5), 0.0)
        }
    };
    let (mut positions, mut normals, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..=cells + 2 * STEPS {
        for column in 0..=cells {
            let x = 80.0 * (f64::from(column) / f64::from(cells) - 0.5);
            let (y, turn) = across(row);
            let top = Point3::new(x, y, (radius * radius - x * x - y * y).sqrt() - radius);
            let up = (top - Point3::new(0.0, 0.0, -radius)).normalize();
            // About the direction of the rim.
            let rim = Vector3::new(top.z + radius, 0.0, -x).normalize();
            let normal = Rotation3::from_axis_angle(&Unit::new_normalize(-rim), turn) * up;
            positions.push((top - up * FILLET + normal * FILLET).map(|value| f64::from(value as f32)));
            normals.push(normal.map(|value| f64::from(value as f32)));
            if row > 0 && column > 0 {
                let d = row * (cells + 1) + column;
                let b = d - cells - 1;
                triangles.extend([[b - 1, b, d], [b - 1, d, d - 1]]);
            }
        }
    }
    TriMesh::new(positions, normals, triangles).unwrap()
}

/// Exact normals are of one sphere, beside the narrow facets of a fillet and on long ones.
#[test]
fn exact_normals_of_a_sphere_leave_no_doubt_beside_a_fillet() {
    let mut failures = Vec::new();
    for radius in [150.0, 300.0, 1000.0, 5000.0] {
        for cells in [2, 4] {
            let height = |x: f64, y: f64| (radius * radius - x * x - y * y).sqrt() - radius;
            let [reported, truth] = errors(&on_sphere(radius, cells), height);
            println!("sphere of R {radius} in {cells} cells: {reported:8.4} {truth:8.4}");
            if reported < truth - SLACK[0] || reported > 1.2 * truth + SLACK[0] {
                failures.push(format!("R {radius}, {cells} cells: {truth:.4} is reported as {reported:.4}"));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}
