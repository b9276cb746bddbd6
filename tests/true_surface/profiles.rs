//! Extruded profiles of tangent arcs and other curves, tessellated as CAD programs do: every piece of the profile is cut
//! evenly, by its deviation and by its angle, and every border of a piece is a vertex.

use isomark::geometry::mesh::TriMesh;
use nalgebra::{Point3, Vector2, Vector3};

/// A piece of a profile in x and z, mm.
#[derive(Debug, Clone, Copy)]
pub(super) enum Piece {
    /// Centre, radius, and the angles from the z axis at both ends, rad.
    Arc([f64; 2], f64, [f64; 2]),
    /// Both ends.
    Line([[f64; 2]; 2]),
    /// Half axes, exponent, and x at both ends.
    Lame([f64; 2], f64, [f64; 2]),
}

/// The largest angle between two facets of one piece, rad, as in OpenCASCADE.
const LARGEST_TURN: f64 = 0.5;

impl Piece {
    /// Point and unit normal at a share of the piece.
    fn at(&self, share: f64) -> [Vector2<f64>; 2] {
        let between = |[from, to]: [f64; 2]| from + (to - from) * share;
        match *self {
            Self::Arc(center, radius, angles) => {
                let normal = Vector2::new(between(angles).sin(), between(angles).cos());
                [Vector2::from(center) + normal * radius, normal]
            }
            Self::Line([from, to]) => {
                let along = Vector2::from(to) - Vector2::from(from);
                [Vector2::from(from) + along * share, Vector2::new(-along.y, along.x).normalize()]
            }
            Self::Lame([a, b], power, ends) => {
                let x = between(ends);
                let z = b * (1.0 - (x / a).abs().powf(power)).powf(1.0 / power);
                let by =
                    |value: f64, half: f64| (value / half).abs().powf(power - 1.0) * value.signum() / half;
                [Vector2::new(x, z), Vector2::new(by(x, a), by(z, b)).normalize()]
            }
        }
    }

    /// The shares at which the piece is cut, without the last.
    fn cuts(&self, deviation: f64) -> Vec<f64> {
        let is_fine = |count: u32| {
            (0..count).all(|step| {
                let at = |part: f64| self.at((f64::from(step) + part) / f64::from(count));
                let ([from, first], [to, last], [middle, _]) = (at(0.0), at(1.0), at(0.5));
                let along = (to - from).normalize();
                (middle - from).perp(&along).abs() <= deviation && first.dot(&last) >= LARGEST_TURN.cos()
            })
        };
        let count = (1..1000).find(|&count| is_fine(count)).unwrap();
        (0..count).map(|step| f64::from(step) / f64::from(count)).collect()
    }
}

/// Pieces from left to right that continue each other tangentially.
#[derive(Debug, Clone)]
pub(super) struct Profile {
    pub(super) name: String,
    pieces: Vec<Piece>,
}

impl Profile {
    /// A crown of radius `top` to both sides up to `angle`, degrees, then radius `side` up to `half` mm from the middle.
    pub(super) fn oval(top: f64, side: f64, angle: f64, half: f64) -> Self {
        let turn = angle.to_radians();
        let center = [(top - side) * turn.sin(), (top - side) * turn.cos() - top];
        let last = ((half - center[0]) / side).min(0.97).asin();
        let pieces = vec![
            Piece::Arc([-center[0], center[1]], side, [-last, -turn]),
            Piece::Arc([0.0, -top], top, [-turn, turn]),
            Piece::Arc(center, side, [turn, last]),
        ];
        Self { name: format!("oval {top}/{side} {angle} deg"), pieces }
    }

    /// A flat side ±`flat` mm wide between fillets, and sloping flat sides of `slope` degrees.
    pub(super) fn filleted(flat: f64, radius: f64, slope: f64, half: f64) -> Self {
        let turn = slope.to_radians();
        let foot = [flat + radius * turn.sin(), radius * turn.cos() - radius];
        let end = [half, foot[1] - (half - foot[0]) * turn.tan()];
        let pieces = vec![
            Piece::Line([[-end[0], end[1]], [-foot[0], foot[1]]]),
            Piece::Arc([-flat, -radius], radius, [-turn, 0.0]),
            Piece::Line([[-flat, 0.0], [flat, 0.0]]),
            Piece::Arc([flat, -radius], radius, [0.0, turn]),
            Piece::Line([foot, end]),
        ];
        Self { name: format!("flat {flat} fillet {radius}, {slope} deg"), pieces }
    }

    /// A flat side ±`flat` mm wide that runs into arcs.
    pub(super) fn stadium(flat: f64, radius: f64, half: f64) -> Self {
        let turn = ((half - flat) / radius).min(0.97).asin();
        let pieces = vec![
            Piece::Arc([-flat, -radius], radius, [-turn, 0.0]),
            Piece::Line([[-flat, 0.0], [flat, 0.0]]),
            Piece::Arc([flat, -radius], radius, [0.0, turn]),
        ];
        Self { name: format!("stadium {flat}/{radius}"), pieces }
    }

    /// Part of an ellipse (`power` 2) or of a squircle (4).
    pub(super) fn lame(axes: [f64; 2], power: f64, half: f64) -> Self {
        let name = format!("lame {}/{} power {power}", axes[0], axes[1]);
        Self { name, pieces: vec![Piece::Lame(axes, power, [-half, half])] }
    }

    /// Profiles of products: ovals, bottles, boxes with fillets.
    pub(super) fn all() -> Vec<Self> {
        vec![
            Self::oval(60.0, 12.0, 14.0, 24.0),
            Self::oval(40.0, 15.0, 20.0, 24.0),
            Self::oval(100.0, 30.0, 6.0, 24.0),
            Self::oval(200.0, 20.0, 4.0, 24.0),
            Self::oval(150.0, 30.0, 6.0, 24.0),
            Self::filleted(5.0, 6.0, 30.0, 22.0),
            Self::filleted(8.0, 20.0, 25.0, 24.0),
            Self::stadium(8.0, 18.0, 24.0),
            Self::stadium(3.0, 25.0, 24.0),
            Self::lame([40.0, 22.0], 2.0, 24.0),
            Self::lame([25.0, 25.0], 4.0, 20.0),
        ]
    }

    pub(super) fn height(&self, x: f64) -> f64 {
        let ends = |piece: &Piece| [piece.at(0.0)[0], piece.at(1.0)[0]];
        let piece = self.pieces.iter().find(|piece| x <= ends(piece)[1].x);
        match *piece.or(self.pieces.last()).unwrap() {
            Piece::Arc([cx, cz], radius, _) => cz + (radius * radius - (x - cx).powi(2)).max(0.0).sqrt(),
            Piece::Line([from, to]) => from[1] + (to[1] - from[1]) * (x - from[0]) / (to[0] - from[0]),
            Piece::Lame([a, b], power, _) => b * (1.0 - (x / a).abs().powf(power)).max(0.0).powf(1.0 / power),
        }
    }

    /// The strip from y = −20 to 20 mm with exact normals, cut into rows along y. `is_merged`: facets share vertices.
    pub(super) fn strip(&self, deviation: f64, rows: u32, is_merged: bool) -> TriMesh {
        let cuts = self.pieces.iter().flat_map(|piece| {
            piece.cuts(deviation).into_iter().map(|share| piece.at(share)).collect::<Vec<_>>()
        });
        let points: Vec<_> = cuts.chain(self.pieces.last().map(|piece| piece.at(1.0))).collect();
        let count = u32::try_from(points.len()).unwrap();
        let nodes = (0..=rows).flat_map(|row| {
            let y = -20.0 + 40.0 * f64::from(row) / f64::from(rows);
            points
                .iter()
                .map(move |[at, normal]| (Point3::new(at.x, y, at.y), Vector3::new(normal.x, 0.0, normal.y)))
        });
        let (positions, normals): (Vec<_>, Vec<_>) = nodes.unzip();
        let cells = (0..rows).flat_map(|row| (0..count - 1).map(move |column| row * count + column));
        let triangles = cells.flat_map(|at| {
            let above = at + count;
            [[at, at + 1, above + 1], [at, above + 1, above]]
        });
        let triangles: Vec<[u32; 3]> = triangles.collect();
        if is_merged {
            return TriMesh::new(positions, normals, triangles).unwrap();
        }
        let corners = || triangles.iter().flatten().map(|&corner| corner as usize);
        let alone = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let positions = corners().map(|corner| positions[corner]).collect();
        TriMesh::new(positions, corners().map(|corner| normals[corner]).collect(), alone).unwrap()
    }
}
