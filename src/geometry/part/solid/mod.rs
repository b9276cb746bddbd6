//! Solids as CAD programs describe them: faces on exact surfaces, bounded by edges.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use self::curve::Curve;
use self::frame::Placement;
use self::surface::Surface;
use self::trimming::{Located, Locator, Trimming};

pub mod bezier;
pub mod curve;
mod profile;
pub mod frame;
pub mod rays;
pub mod round;
pub mod surface;
pub mod tessellation;
pub mod trimming;

/// A chord of an edge is at most this far from it, mm.
pub const CHORD: f64 = 2e-4;
/// A face whose edges are farther from its surface than this, mm, contradicts itself.
pub const LARGEST_GAP: f64 = 0.1;

/// Faces with the edges between them, mm.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Solid {
    /// The edges.
    pub edges: Vec<Edge>,
    /// The faces.
    pub faces: Vec<Face>,
}

/// An edge between faces.
#[derive(Debug, Clone, PartialEq)]
pub struct Edge {
    /// Points along it, close enough that no chord is farther from it than [`CHORD`].
    pub points: Vec<Point3<f64>>,
    /// Fewer points along it, for pictures.
    pub coarse: Vec<Point3<f64>>,
}

impl Edge {
    /// The edge along a curve from `start` to `end`; `forward` is whether it has the direction of the curve, `coarse` the
    /// distance of the chords for pictures, mm.
    pub fn along(curve: &Curve, start: Point3<f64>, end: Point3<f64>, forward: bool, coarse: f64) -> Self {
        let between = |tolerance: f64| curve.between(start, end, forward, tolerance);
        Self { points: between(CHORD), coarse: between(coarse) }
    }
}

/// An edge as a side of a face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Side {
    /// Number of the edge.
    pub edge: u32,
    /// Whether it is followed from its first point to its last.
    pub forward: bool,
}

/// A face.
#[derive(Debug, Clone, PartialEq)]
pub struct Face {
    /// The number of its record in the file.
    pub id: u64,
    /// Number of its body.
    pub body: u32,
    /// What its surface is, for people.
    pub kind: String,
    /// Its surface.
    pub surface: Surface,
    /// Whether its normal is that of its surface.
    pub is_same_sense: bool,
    /// Its loops; the face is on their left, seen from outside.
    pub loops: Vec<Vec<Side>>,
    /// Its boundary in the plane of the surface's parameters.
    pub trimming: Arc<Trimming>,
    /// How far its edges are from its surface, mm, at most.
    pub gap: f64,
}

impl Face {
    /// The face of a surface inside these loops. An edge that bounds it on both sides is not a boundary.
    pub fn new(
        id: u64,
        body: u32,
        surface: Surface,
        is_same_sense: bool,
        loops: Vec<Vec<Side>>,
        edges: &[Edge],
    ) -> Self {
        let mut face = Self {
            id,
            body,
            kind: String::new(),
            surface,
            is_same_sense,
            loops,
            trimming: Arc::new(Trimming::new(&Surface::Unread(String::new()), Vec::new(), true)),
            gap: 0.0,
        };
        let (trimming, gap) = face.trim(|side| &edges[side.edge as usize].points);
        (face.trimming, face.gap) = (Arc::new(trimming), gap);
        face
    }

    /// The sides that bound the face: without those that are followed in both directions.
    pub fn sides(&self) -> impl Iterator<Item = Side> {
        let mut sides: Vec<Side> = self.loops.iter().flatten().copied().collect();
        sides.sort_by_key(|side| (side.edge, side.forward));
        let mut kept: Vec<Side> = Vec::with_capacity(sides.len());
        for side in sides {
            match kept.last() {
                Some(last) if last.edge == side.edge && last.forward != side.forward => {
                    kept.pop();
                }
                _ => kept.push(side),
            }
        }
        kept.into_iter()
    }

    fn trim<'a>(&self, points_of: impl Fn(Side) -> &'a [Point3<f64>]) -> (Trimming, f64) {
        let locator = Locator::new(&self.surface, 1e-6);
        let mut segments = Vec::new();
        let mut gap = 0.0f64;
        // A point of two sides must have the same parameters in both.
        let mut corners: Vec<(Point3<f64>, Located)> = Vec::new();
        for side in self.sides() {
            let points = points_of(side);
            let mut previous: Option<Located> = None;
            let mut line = Vec::with_capacity(points.len());
            for (index, point) in points.iter().enumerate() {
                let is_end = index == 0 || index + 1 == points.len();
                let known = corners.iter().find(|(at, _)| is_end && at == point).map(|(_, located)| *located);
                let located = known.unwrap_or_else(|| locator.find(point, previous.as_ref()));
                if is_end && known.is_none() {
                    corners.push((*point, located));
                }
                gap = gap.max(located.distance);
                line.push(located);
                previous = Some(located);
            }
            if !side.forward {
                line.reverse();
            }
            segments.extend(line.windows(2).map(|pair| [pair[0], pair[1]]));
        }
        (Trimming::new(&self.surface, segments, self.is_same_sense), gap)
    }
}

impl Solid {
    /// The solid after a move.
    pub fn placed(&self, placement: &Placement) -> Self {
        let moved = |points: &[Point3<f64>]| points.iter().map(|point| placement.point(point)).collect();
        let edge = |edge: &Edge| Edge { points: moved(&edge.points), coarse: moved(&edge.coarse) };
        let face = |face: &Face| Face { surface: face.surface.placed(placement), ..face.clone() };
        Self { edges: self.edges.iter().map(edge).collect(), faces: self.faces.iter().map(face).collect() }
    }

    /// Adds the edges and faces of another solid; its bodies get numbers from `body` on.
    pub fn add(&mut self, other: Self, body: u32) {
        let first = self.edges.len() as u32;
        self.edges.extend(other.edges);
        self.faces.extend(other.faces.into_iter().map(|mut face| {
            face.loops.iter_mut().flatten().for_each(|side| side.edge += first);
            face.body += body;
            face
        }));
    }

    /// The diagonal of the box round its edges, mm.
    pub fn size(&self) -> f64 {
        let points = || self.edges.iter().flat_map(|edge| &edge.coarse);
        let low = points().fold(Vector3::repeat(f64::INFINITY), |low, point| low.inf(&point.coords));
        let high = points().fold(Vector3::repeat(f64::NEG_INFINITY), |high, point| high.sup(&point.coords));
        let size = (high - low).norm();
        if size.is_finite() { size.max(1e-6) } else { 1.0 }
    }
}
