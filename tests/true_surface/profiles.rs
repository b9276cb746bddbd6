//! Extruded and revolved profiles of tangent arcs and other curves, tessellated as CAD programs do: every piece of the profile is cut
//! evenly, by its deviation and by its angle, and every border of a piece is a vertex.

use isomark::geometry::mesh::TriMesh;
use nalgebra::{Point3, Vector2, Vector3};

/// A piece of a profile in x and z, mm.
#[derive(Debug, Clone, Copy)]
pub(super) enum Piece {
    /// Centre, radius (negative where the profile is concave), and the angles from the z axis of the normals at both ends, rad.
    Arc([f64; 2], f64, [f64; 2]),
    /// Both ends.
    Line([[f64; 2]; 2]),
    /// Half axes, exponent, and x at both ends.
    Lame([f64; 2], f64, [f64; 2]),
    /// Coefficients of the powers of x from 0 to 4, and x at both ends.
    Quartic([f64; 5], [f64; 2]),
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
            Self::Quartic(factors, ends) => {
                let (mut z, mut slope, x) = (0.0, 0.0, between(ends));
                for factor in factors.into_iter().rev() {
                    (slope, z) = (slope * x + z, z * x + factor);
                }
                [Vector2::new(x, z), Vector2::new(-slope, 1.0).normalize()]
            }
        }
    }

    /// The shares at which the piece is cut, without the last; facets meet at `turn` at most, rad.
    fn cuts(&self, deviation: f64, turn: f64) -> Vec<f64> {
        let is_fine = |count: u32| {
            (0..count).all(|step| {
                // An S within a facet shows in its quarters.
                let at = |part: f64| self.at((f64::from(step) + part) / f64::from(count));
                let ([from, first], [to, _]) = (at(0.0), at(1.0));
                let along = (to - from).normalize();
                [0.25, 0.5, 0.75, 1.0].map(at).into_iter().all(|[point, normal]| {
                    (point - from).perp(&along).abs() <= deviation && first.dot(&normal) >= turn.cos() - 1e-9
                })
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
    pub(super) fn new(name: String, pieces: Vec<Piece>) -> Self {
        Self { name, pieces }
    }

    /// The profile moved along z so that it is at z = 0 in the middle.
    pub(super) fn levelled(mut self) -> Self {
        let down = self.height(0.0);
        for piece in &mut self.pieces {
            match piece {
                Piece::Arc(center, ..) => center[1] -= down,
                Piece::Line(ends) => ends.iter_mut().for_each(|end| end[1] -= down),
                Piece::Quartic(factors, _) => factors[0] -= down,
                // It has a fixed centre.
                Piece::Lame(..) => {}
            }
        }
        self
    }

    /// Points and normals at which the profile is cut, from left to right; facets meet at `turn` at most, rad.
    pub(super) fn cut(&self, deviation: f64, turn: f64) -> Vec<[Vector2<f64>; 2]> {
        let cuts = self.pieces.iter().flat_map(|piece| {
            piece.cuts(deviation, turn).into_iter().map(|share| piece.at(share)).collect::<Vec<_>>()
        });
        cuts.chain(self.pieces.last().map(|piece| piece.at(1.0))).collect()
    }

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

    /// A concave arc of radius `hollow` to both sides up to `angle`, degrees, then convex ones of radius `side` up to `half` mm.
    pub(super) fn waist(hollow: f64, side: f64, angle: f64, half: f64) -> Self {
        let turn = angle.to_radians();
        let center = [(hollow + side) * turn.sin(), hollow - (hollow + side) * turn.cos()];
        let last = ((half - center[0]) / side).min(0.97).asin();
        let pieces = vec![
            Piece::Arc([-center[0], center[1]], side, [-last, turn]),
            Piece::Arc([0.0, hollow], -hollow, [turn, -turn]),
            Piece::Arc(center, side, [-turn, last]),
        ];
        Self { name: format!("waist {hollow}/{side} {angle} deg"), pieces }
    }

    /// A neck, a concave arc, a shoulder of the same `radius` that turns by `angle`, degrees, and a body, along ±`half` mm.
    pub(super) fn bottle(radius: f64, angle: f64, half: f64) -> Self {
        let turn = angle.to_radians();
        let [reach, rise] = [radius * turn.sin(), radius * (1.0 - turn.cos())];
        let pieces = vec![
            Piece::Line([[-half, 0.0], [-2.0 * reach, 0.0]]),
            Piece::Arc([-2.0 * reach, -radius], radius, [0.0, turn]),
            Piece::Arc([0.0, radius - 2.0 * rise], -radius, [turn, 0.0]),
            Piece::Line([[0.0, -2.0 * rise], [half, -2.0 * rise]]),
        ];
        Self { name: format!("bottle {radius} {angle} deg"), pieces }
    }

    /// Two flat sides that meet at an edge beside the middle and slope by `slope` degrees on both sides of it.
    pub(super) fn ridge(slope: f64, half: f64) -> Self {
        let (top, fall) = (0.13, slope.to_radians().tan());
        let pieces = vec![
            Piece::Line([[-half, -(half + top) * fall], [top, 0.0]]),
            Piece::Line([[top, 0.0], [half, -(half - top) * fall]]),
        ];
        Self { name: format!("ridge {slope} deg"), pieces }
    }

    /// Profiles of turned products: waists, bottle necks, barrels.
    pub(super) fn revolved_ones() -> Vec<Self> {
        vec![
            Self::waist(20.0, 20.0, 20.0, 24.0),
            Self::waist(30.0, 12.0, 15.0, 24.0),
            Self::bottle(20.0, 25.0, 24.0),
            Self::bottle(30.0, 15.0, 24.0),
            Self::oval(60.0, 20.0, 10.0, 24.0),
            Self::oval(100.0, 30.0, 6.0, 24.0),
        ]
    }

    /// The profile along y turned about an axis that is parallel to y, `radius` mm below z = 0, without normals: 150 degrees of
    /// it, in facets that meet at `turn` degrees at most and deviate by at most `deviation` mm.
    pub(super) fn revolved(&self, radius: f64, deviation: f64, turn: f64) -> TriMesh {
        let turn = turn.to_radians();
        let points: Vec<_> = self.cut(deviation, turn).into_iter().map(|[at, _]| at).collect();
        let reach = 75f64.to_radians();
        let sector = turn.min(2.0 * (1.0 - deviation / radius).acos());
        let sectors = (2.0 * reach / sector).ceil() as u32;
        let width = sectors + 1;
        let positions = points.iter().flat_map(|at| {
            (0..=sectors).map(move |column| {
                let angle = reach * (2.0 * f64::from(column) / f64::from(sectors) - 1.0);
                let out = radius + at.y;
                Point3::new(out * angle.sin(), at.x, out * angle.cos() - radius)
            })
        });
        let rows = u32::try_from(points.len()).unwrap() - 1;
        let cells = (0..rows).flat_map(|row| (0..sectors).map(move |column| row * width + column));
        let triangles = cells.flat_map(|at| {
            let above = at + width;
            [[at, at + 1, above + 1], [at, above + 1, above]]
        });
        TriMesh::new(positions.collect(), Vec::new(), triangles.collect()).unwrap()
    }

    /// Whether each arc is cut at least once.
    pub(super) fn shows_its_arcs(&self, deviation: f64, turn: f64) -> bool {
        let arcs = self.pieces.iter().filter(|piece| matches!(piece, Piece::Arc(..)));
        arcs.into_iter().all(|arc| arc.cuts(deviation, turn.to_radians()).len() > 1)
    }

    /// The height of the [revolved](Self::revolved) profile.
    pub(super) fn revolved_height(&self, radius: f64, x: f64, y: f64) -> f64 {
        ((radius + self.height(y)).powi(2) - x * x).max(0.0).sqrt() - radius
    }

    pub(super) fn height(&self, x: f64) -> f64 {
        let ends = |piece: &Piece| [piece.at(0.0)[0], piece.at(1.0)[0]];
        let piece = self.pieces.iter().find(|piece| x <= ends(piece)[1].x);
        match *piece.or(self.pieces.last()).unwrap() {
            Piece::Arc([cx, cz], radius, _) => {
                cz + radius.signum() * (radius * radius - (x - cx).powi(2)).max(0.0).sqrt()
            }
            Piece::Line([from, to]) => from[1] + (to[1] - from[1]) * (x - from[0]) / (to[0] - from[0]),
            Piece::Lame([a, b], power, _) => b * (1.0 - (x / a).abs().powf(power)).max(0.0).powf(1.0 / power),
            Piece::Quartic(factors, _) => factors.into_iter().rev().fold(0.0, |sum, factor| sum * x + factor),
        }
    }

    /// The strip from y = −20 to 20 mm with exact normals, cut into rows along y. `is_merged`: facets share vertices.
    pub(super) fn strip(&self, deviation: f64, rows: u32, is_merged: bool) -> TriMesh {
        self.strip_turning(deviation, LARGEST_TURN, rows, is_merged)
    }

    /// The same with facets that meet at `turn` at most, rad.
    pub(super) fn strip_turning(&self, deviation: f64, turn: f64, rows: u32, is_merged: bool) -> TriMesh {
        let points = self.cut(deviation, turn);
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
