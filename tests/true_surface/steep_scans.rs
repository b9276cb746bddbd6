//! Scans of whole parts with steep sides and undersides, where most points are not on the marked side.

use std::fmt::Write as _;

use isomark::formats::mesh::MeshFormat;
use nalgebra::Vector3;

use super::bounds::{judged, surface_in};

/// Random numbers that are the same everywhere.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Box & Muller, in three directions.
    fn normal(&mut self) -> Vector3<f64> {
        let mut one =
            || (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos();
        Vector3::new(one(), one(), one())
    }
}

/// Convex bodies about the origin, mm.
#[derive(Debug, Clone, Copy)]
enum Body {
    /// Half axes and exponent.
    Superellipsoid([f64; 3], f64),
    /// A cylinder about the y axis with hemispheres: radius, and half the distance of their centres.
    Capsule(f64, f64),
    /// Half sizes, and the radius of all edges.
    Block([f64; 3], f64),
}

/// How the points are distributed.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// In random directions from the middle: denser where the surface is near.
    Directions,
    /// Random, as many on every area.
    Even,
    /// Lattices from above, from below, and from four sides, merged.
    Views,
    /// Sections across the part, with dense points.
    Swept,
    /// Equal steps of the angle about the z axis and of the elevation.
    Turntable,
}

const KINDS: [Kind; 5] = [Kind::Directions, Kind::Even, Kind::Views, Kind::Swept, Kind::Turntable];
const BODIES: [Body; 3] = [
    Body::Superellipsoid([30.0, 55.0, 38.0], 4.0),
    Body::Capsule(25.0, 30.0),
    Body::Block([30.0, 40.0, 25.0], 8.0),
];
const STEP: f64 = 1.4;
const NOISE: f64 = 0.02;

impl Body {
    fn size(&self) -> [f64; 3] {
        match *self {
            Self::Superellipsoid(size, _) | Self::Block(size, _) => size,
            Self::Capsule(radius, half) => [radius, half + radius, radius],
        }
    }

    /// The distance from the outside in some unit: negative inside.
    fn level(&self, at: Vector3<f64>) -> f64 {
        match *self {
            Self::Superellipsoid(size, power) => {
                at.iter().zip(size).map(|(at, half)| (at / half).abs().powf(power)).sum::<f64>() - 1.0
            }
            Self::Capsule(radius, half) => {
                Vector3::new(at.x, at.y - at.y.clamp(-half, half), at.z).norm() - radius
            }
            Self::Block(size, radius) => {
                let inner = size.map(|half| half - radius);
                let beyond = Vector3::from_fn(|axis, _| at[axis] - at[axis].clamp(-inner[axis], inner[axis]));
                beyond.norm() - radius
            }
        }
    }

    fn height(&self, x: f64, y: f64) -> f64 {
        match *self {
            Self::Superellipsoid([a, b, c], power) => {
                let left = 1.0 - (x / a).abs().powf(power) - (y / b).abs().powf(power);
                c * left.max(0.0).powf(1.0 / power)
            }
            Self::Capsule(radius, half) => {
                let beyond = (y.abs() - half).max(0.0);
                (radius * radius - x * x - beyond * beyond).max(0.0).sqrt()
            }
            Self::Block([a, b, c], radius) => {
                let [across, along] = [x.abs() - a + radius, y.abs() - b + radius].map(|by| by.max(0.0));
                c - radius + (radius * radius - across * across - along * along).max(0.0).sqrt()
            }
        }
    }

    /// Where a ray from inside leaves the body; `None` from outside.
    fn leave(&self, from: Vector3<f64>, direction: Vector3<f64>) -> Option<Vector3<f64>> {
        let (mut near, mut far) = (0.0, 200.0);
        if self.level(from) > 0.0 {
            return None;
        }
        for _ in 0..50 {
            let middle = (near + far) / 2.0;
            if self.level(from + direction * middle) < 0.0 { near = middle } else { far = middle }
        }
        Some(from + direction * near)
    }

    fn normal(&self, at: Vector3<f64>) -> Vector3<f64> {
        let by = |axis: usize| {
            let step = Vector3::ith(axis, 1e-5);
            self.level(at + step) - self.level(at - step)
        };
        Vector3::new(by(0), by(1), by(2)).normalize()
    }

    fn area(&self) -> f64 {
        let [a, b, c] = self.size();
        7.0 * (a * b + b * c + c * a)
    }

    fn points(&self, kind: Kind) -> Vec<Vector3<f64>> {
        let mut random = Random(5);
        let size = self.size();
        let middle = Vector3::zeros();
        let mut points = Vec::new();
        match kind {
            Kind::Directions | Kind::Even => {
                let longest = size.into_iter().fold(0.0, f64::max);
                while (points.len() as f64) < self.area() / (STEP * STEP) {
                    let direction = random.normal().normalize();
                    let at = self.leave(middle, direction).unwrap();
                    let area = at.norm_squared() / self.normal(at).dot(&direction);
                    if kind == Kind::Directions || random.uniform() * 6.0 * longest * longest < area {
                        points.push(at);
                    }
                }
            }
            Kind::Views => {
                for (axis, right, up) in [(0, 1, 2), (1, 0, 2), (2, 0, 1)] {
                    let [columns, rows] = [right, up].map(|axis| (size[axis] / STEP) as i32);
                    for column in -columns..=columns {
                        for (row, sign) in (-rows..=rows).flat_map(|row| [(row, 1.0), (row, -1.0)]) {
                            let from = Vector3::ith(right, STEP * (f64::from(column) + 0.3))
                                + Vector3::ith(up, STEP * f64::from(row));
                            let seen = self.leave(from, Vector3::ith(axis, sign));
                            points.extend(seen.filter(|at| self.normal(*at)[axis].abs() > 0.45));
                        }
                    }
                }
            }
            Kind::Swept => {
                let sections = (size[1] / STEP) as i32;
                for section in -sections..=sections {
                    let from = Vector3::new(0.0, STEP * f64::from(section), 0.0);
                    let mut last = Vector3::repeat(1e3);
                    for angle in (0..2000).map(|step| std::f64::consts::TAU * f64::from(step) / 2000.0) {
                        let at = self.leave(from, Vector3::new(angle.cos(), 0.0, angle.sin()));
                        if let Some(at) = at.filter(|at| (at - last).norm() > STEP / 5.0) {
                            points.push(at);
                            last = at;
                        }
                    }
                }
            }
            Kind::Turntable => {
                let steps = (std::f64::consts::TAU * size[0].max(size[1]) / STEP) as i32;
                for turn in 0..steps {
                    let angle = std::f64::consts::TAU * f64::from(turn) / f64::from(steps);
                    for climb in -steps / 4..=steps / 4 {
                        let tilt = std::f64::consts::TAU * f64::from(climb) / f64::from(steps);
                        let flat = tilt.cos();
                        let direction = Vector3::new(angle.cos() * flat, angle.sin() * flat, tilt.sin());
                        points.push(self.leave(middle, direction).unwrap());
                    }
                }
            }
        }
        points.into_iter().map(|at| at + random.normal() * NOISE).collect()
    }
}

#[test]
fn scans_of_parts_with_steep_sides_are_marked_truly() {
    let mut failures = Vec::new();
    for (index, kind) in KINDS.into_iter().enumerate() {
        for is_whole in [true, false] {
            let body = BODIES[(index + usize::from(is_whole)) % BODIES.len()];
            let mut text = String::new();
            for at in body.points(kind).into_iter().filter(|at| is_whole || at.z > 0.0) {
                writeln!(text, "{:.4} {:.4} {:.4}", at.x, at.y, at.z).unwrap();
            }
            let surface = surface_in(&text, MeshFormat::Xyz);
            let [reported, truth] = judged(&surface, |x, y| body.height(x, y));
            let part = format!("{body:?} {kind:?} {}", if is_whole { "whole" } else { "upper half" });
            println!(
                "{part:60} e_l {:.3} {:.3} stretch {:.4} {:.4}",
                reported.length_error, truth.length_error, reported.max_stretch, truth.max_stretch
            );
            // The letters are 182 mm long.
            if truth.length_error > 0.4
                || reported.length_error < truth.length_error
                || reported.length_error > 1.0
                || reported.max_stretch < 0.9 * truth.max_stretch
            {
                failures.push(format!(
                    "{part}: {} mm, reported as {} mm",
                    truth.length_error, reported.length_error
                ));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}
