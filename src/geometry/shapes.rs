//! Surfaces given by formulas, and their meshes, mm: reference shapes for tests and benchmarks.

use nalgebra::{Point3, Vector2};

use crate::geometry::height_field::{HeightField, Node, STEEPEST_SURFACE};
use crate::geometry::mesh::TriMesh;

/// A sphere of radius 30 mm about the origin, z = √(900 − x² − y²).
pub fn sphere(x: f64, y: f64) -> f64 {
    (900.0 - x * x - y * y).max(0.0).sqrt()
}

/// A cylinder of radius 30 mm about the y axis.
pub fn cylinder(x: f64, _y: f64) -> f64 {
    (900.0 - x * x).max(0.0).sqrt()
}

/// A cone with its axis along y: 60 mm from the apex its radius is 18.6 mm (half angle 0.3 rad).
pub fn cone(x: f64, y: f64) -> f64 {
    let radius = (y + 60.0) * 0.3f64.tan();
    (radius * radius - x * x).max(0.0).sqrt()
}

/// A mandarin: a spheroid with ten ribs about its stem.
pub fn mandarin(x: f64, y: f64) -> f64 {
    let square = x * x + y * y;
    let (mut re, mut im) = (1.0, 0.0);
    for _ in 0..10 {
        (re, im) = (re * x - im * y, re * y + im * x);
    }
    22.5 * (1.0 - square / 900.0).max(0.0).sqrt() + 0.06 * re / (square.powi(5) + 14f64.powi(10))
}

/// The back of a computer mouse, 60 × 110 × 38 mm.
pub fn mouse(x: f64, y: f64) -> f64 {
    let y0 = y / 55.0;
    let across = x / (30.0 * (1.0 - 0.05 * y0 * y0));
    let along = y0 + (6.0 / 55.0) * (1.0 - y0 * y0);
    let inside =
        1.0 - 0.55 * across.powi(2) - 0.45 * across.powi(4) - 0.5 * along.powi(2) - 0.5 * along.powi(4);
    38.0 * inside.max(0.0).powf(0.45)
}

/// A saddle, z = (x² − y²)/60.
pub fn saddle(x: f64, y: f64) -> f64 {
    (x * x - y * y) / 60.0
}

/// Bumps of 1 mm every 25 mm, curved four times as strongly as [`sphere`], both ways.
pub fn bumps(x: f64, y: f64) -> f64 {
    let turn = std::f64::consts::TAU / 25.0;
    (turn * x).sin() * (turn * y).sin()
}

/// The top of a flat torus with a tube radius of 25 mm; its axis is at y = −45 mm, and its centre circle has a radius
/// of 45 mm. The outer side is domed, the inner side is a saddle.
pub fn torus(x: f64, y: f64) -> f64 {
    let beyond = x.hypot(y + 45.0) - 45.0;
    (625.0 - beyond * beyond).max(0.0).sqrt()
}

/// An ellipsoid with semi-axes of 45, 30 and 22 mm along x, y and z.
pub fn ellipsoid(x: f64, y: f64) -> f64 {
    22.0 * (1.0 - (x / 45.0).powi(2) - (y / 30.0).powi(2)).max(0.0).sqrt()
}

/// The height field of a whole part below the surface `height` that stands on a table at z = 0, over ± `half` mm in x
/// and y. Its heights are exact, with a grid step of `step` mm; outside the part the nodes are empty.
pub fn standing(half: [f64; 2], step: f64, height: impl Fn(f64, f64) -> f64) -> HeightField {
    let [columns, rows] = half.map(|half| (2.0 * half / step).round() as usize + 1);
    let node = |index: usize| {
        let (x, y) = ((index % columns) as f64 * step - half[0], (index / columns) as f64 * step - half[1]);
        let (z, h) = (height(x, y), 1e-4);
        let slope = (height(x + h, y) - z).hypot(height(x, y + h) - z) / h;
        if z <= 0.0 {
            Node::Empty
        } else if slope > STEEPEST_SURFACE.tan() {
            Node::Wall(z)
        } else {
            Node::Surface(z)
        }
    };
    let nodes = (0..columns * rows).map(node).collect();
    HeightField::new(-Vector2::from(half), step, columns, rows, nodes)
        .expect("a part larger than a step has a grid")
}

/// The graph of `height` over a disc of radius `radius` mm as a mesh without normals. In the plane, its triangles are
/// nearly equilateral with edges of about `edge` mm.
pub fn graph(radius: f64, edge: f64, height: impl Fn(f64, f64) -> f64) -> TriMesh {
    let row_step = edge * 0.75f64.sqrt();
    let rows = (radius / row_step).ceil() as i64;
    let columns = (radius / edge).ceil() as i64 + 1;
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    let width = (2 * columns + 1) as u32;
    for row in -rows..=rows {
        for column in -columns..=columns {
            let x = (column as f64 + if row % 2 == 0 { 0.0 } else { 0.5 }) * edge;
            let y = row as f64 * row_step;
            positions.push(Point3::new(x, y, height(x, y)));
        }
    }
    let inside = |index: u32| {
        let position: &Point3<f64> = &positions[index as usize];
        position.x.hypot(position.y) <= radius
    };
    for row in 0..2 * rows as u32 {
        for column in 0..width - 1 {
            let lower = row * width + column;
            let upper = lower + width;
            // Odd rows are shifted to the right by half an edge.
            let shifted = (row as i64 - rows) % 2 != 0;
            let pair = if shifted {
                [[lower, lower + 1, upper + 1], [lower, upper + 1, upper]]
            } else {
                [[lower, lower + 1, upper], [lower + 1, upper + 1, upper]]
            };
            triangles.extend(pair.into_iter().filter(|corners| corners.iter().all(|&index| inside(index))));
        }
    }
    TriMesh::new(positions, Vec::new(), triangles).expect("a disc larger than an edge has triangles")
}
