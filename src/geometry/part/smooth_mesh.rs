//! A mesh divided into smooth regions: where facets continue each other, a place has one vertex with one normal; at an
//! edge of the part, it has one vertex for each side.
//!
//! `joining` runs these steps in this order:
//!
//! | step | modules |
//! |---|---|
//! | which facets continue each other, and where edges are | `plane_polygons`, `plane_facets`, `sections`, `creases`, `ring_limits`, `hidden_arcs` |
//! | normals from the facets round a vertex | `arcs`, `long_sides`, `straightest` |
//! | normals from the face on which its vertices are | `round`, `round_group`, `ends`, `rivals`, `settling`, then `cylinders`, `spheres`, `caps`, `cambers`; `plane_curve`, `strips`, `curve_strip`, `free_outlines`; `rings`, `profile`, `turned` |
//! | what stays in doubt | `chains`, `exact_normals`, `scatter`, `slopes` |

mod joining;
mod plane_polygons;
mod plane_facets;
mod sections;
mod creases;
mod ring_limits;
mod hidden_arcs;

mod arcs;
mod long_sides;
mod straightest;

mod round;
mod round_group;
mod ends;
mod rivals;
mod settling;
mod cylinders;
mod spheres;
mod caps;
mod cambers;
mod plane_curve;
mod strips;
mod curve_strip;
mod free_outlines;
mod rings;
mod profile;
mod turned;

mod chains;
mod exact_normals;
mod scatter;
mod slopes;

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

use super::adjacency::{NONE, facet_normal};
use super::cone::Cone;
use super::curved_triangle::CurvedTriangle;

/// In files without normals, facets that meet at a larger angle than this, rad, are the two sides of an edge of the
/// part; smaller angles are edges only where they stand out from their neighbours (`creases`). In CAD tessellations
/// the angle between two facets of one face is up to 28.6° (0.5 rad); at chamfers it is 45°.
pub const CREASE_ANGLE: f64 = 40.0 * std::f64::consts::PI / 180.0;

/// Wide and narrow facets that take turns are the sides and the chamfered edges of a prism if they turn by
/// more than this, rad, although their vertices are on a cylinder. The facets of a cylinder with fewer than
/// 24 sides turn by more.
pub(super) const TURN_OF_PRISM: f64 = 15.0 * std::f64::consts::PI / 180.0 * (1.0 + 1e-3);

/// The same limit as for [`TURN_OF_PRISM`], rad, where the file shades the facets as if they were round.
const TURN_OF_SHADED_PRISM: f64 = 0.5;

/// Normals of the file at one place that differ by more than this, rad, belong to two sides of an edge of the part.
/// Exact normals of one face agree to 0.2°, Blender's merged ones to 1°.
pub const NORMAL_TOLERANCE: f64 = 4.0 * std::f64::consts::PI / 180.0;

/// The same for normals that a program computed on the exact faces of the part, to the rounding of its numbers: faces that meet at a
/// smaller angle are tangent.
const EXACT_NORMAL_TOLERANCE: f64 = 0.3 * std::f64::consts::PI / 180.0;

/// Meshes with more triangles are not searched for faces: they are fine, and a search would take long.
const MOST_SEARCHED: usize = 300_000;

/// Facets of one smooth face turn by less than this, rad, in any tessellation, also across a corner of both arcs of a sphere.
pub(super) const MOST_BEND: f64 = 0.75;

/// A facet turns notably along a direction if it turns by at least this share of its largest turn.
const NOTABLE_TURN: f64 = 0.3;

/// At most this many triangles of a flat side are searched for one beside which the part turns.
const MOST_OF_FLAT: usize = 16;

/// Normals that turn by less than this, rad, are those of a flat triangle.
const FLAT_TURN: f64 = 1e-6;

/// Triangles over shared vertices, in the frame of a view, mm.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SmoothMesh {
    /// Positions; a place on an edge of the part has one vertex for each smooth side.
    pub positions: Vec<Point3<f64>>,
    /// Unit normals, one for each vertex.
    pub normals: Vec<Vector3<f64>>,
    /// Three vertices each.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle, the number of its smooth region: the triangles that can be reached without crossing an edge
    /// of the part.
    pub regions: Vec<u32>,
    /// For each side of each triangle (side 3·t + k runs from corner k to the next), the neighbour's side that
    /// continues it; [`NONE`] at a border and at an edge of the part.
    pub(super) continued: Vec<u32>,
    /// For each triangle, how far the part may be from its curved patch, mm: where the normals round an edge of the
    /// facets, or contradict one another (`flats`); empty if there is no doubt.
    pub doubts: Vec<f64>,
    /// For each triangle, how far the slope of the part may be from that of its curved patch, rad (`slopes`); empty if all
    /// facets are small.
    pub slope_doubts: Vec<f32>,
    /// Whether the normals are those of the file, as far as it has them.
    pub(super) has_given_normals: bool,
    /// Standard deviation of the positions by the rounding of the file's numbers, mm.
    pub(super) rounding: f64,
    /// Edges of the part that only the facets or exact normals show: one entry for each of the two sides, in ascending order of
    /// the sides.
    pub(super) creases: Vec<Crease>,
    /// The triangles beside edges that may be corners of arcs (`hidden_arcs`), in ascending order, each with the unit direction of the edge.
    pub(super) beside_arcs: Vec<(u32, Vector3<f64>)>,
    /// The triangles that are facets of a cone, in ascending order, each with the cone, which is the part there: the curved patch is
    /// only near it.
    pub(super) cones: Vec<(u32, Cone)>,
}

/// One side of an edge of the part.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Crease {
    /// 3·t + k: from corner k of triangle t to the next.
    pub(super) side: u32,
    /// Unit directions of the edge at both ends of the side: where the tangent planes on its two sides meet.
    directions: [Vector3<f64>; 2],
    /// Whether the two sides of the part meet at more than [`NORMAL_TOLERANCE`] at an end.
    pub(super) is_sharp: bool,
}

impl SmoothMesh {
    /// For each vertex whether a side there has no continuation.
    fn rim(&self) -> Vec<bool> {
        let mut is_at_rim = vec![false; self.positions.len()];
        for (corners, continued) in self.triangles.iter().zip(self.continued.chunks_exact(3)) {
            for side in (0..3).filter(|&side| continued[side] == NONE) {
                is_at_rim[corners[side] as usize] = true;
                is_at_rim[corners[(side + 1) % 3] as usize] = true;
            }
        }
        is_at_rim
    }

    /// The corners of a triangle and their normals.
    #[inline]
    pub fn corners(&self, triangle: usize) -> ([Point3<f64>; 3], [Vector3<f64>; 3]) {
        let corners = self.triangles[triangle];
        (
            corners.map(|index| self.positions[index as usize]),
            corners.map(|index| self.normals[index as usize]),
        )
    }

    /// The patch over a triangle.
    pub(super) fn patch(&self, triangle: usize) -> CurvedTriangle {
        let (corners, normals) = self.corners(triangle);
        let mut edges = [None; 3];
        for crease in self.creases_of(triangle) {
            edges[crease.side as usize % 3] = Some(crease.directions);
        }
        let patch = CurvedTriangle::beside_edges(corners, normals, edges);
        if self.has_given_normals { patch.with_even_slopes(normals) } else { patch }
    }

    /// The cone of which a triangle is a facet, if it is of one.
    pub(super) fn cone_of(&self, triangle: usize) -> Option<&Cone> {
        let at = self.cones.binary_search_by_key(&(triangle as u32), |&(triangle, _)| triangle).ok()?;
        Some(&self.cones[at].1)
    }

    /// At least the largest bulge of the patch over a triangle, mm; infinite where the normals turn much.
    pub(super) fn most_bulge(&self, triangle: usize) -> f64 {
        if self.creases_of(triangle).next().is_some() {
            return self.patch(triangle).largest_bulge();
        }
        let (corners, normals) = self.corners(triangle);
        CurvedTriangle::most_bulge(corners, normals)
    }

    fn creases_of(&self, triangle: usize) -> impl Iterator<Item = &Crease> {
        let first = self.creases.partition_point(|crease| (crease.side as usize) < triangle * 3);
        self.creases[first..].iter().take_while(move |crease| crease.side as usize / 3 == triangle)
    }

    /// How far a triangle reaches along the directions in which its normals turn notably, mm: the width of a facet of a strip, the
    /// longer side of others.
    pub(super) fn reach_of_turn(&self, triangle: usize) -> f64 {
        let (corners, normals) = self.corners(triangle);
        let sides = [corners[1] - corners[0], corners[2] - corners[0], corners[2] - corners[1]];
        let longest = sides.iter().map(|side| side.norm()).fold(0.0, f64::max);
        let Some(along) = sides[0].try_normalize(0.0) else { return longest };
        let across = facet_normal(corners).cross(&along);
        let flat = |vector: Vector3<f64>| Vector2::new(vector.dot(&along), vector.dot(&across));
        let steps = Matrix2::from_columns(&[flat(sides[0]), flat(sides[1])]);
        let turns = Matrix2::from_columns(&[flat(normals[1] - normals[0]), flat(normals[2] - normals[0])]);
        let Some(bend) = steps.try_inverse().map(|inverse| turns * inverse) else { return longest };
        let eigen = (bend.transpose() * bend).symmetric_eigen();
        let along_axes = [0, 1].map(|axis| {
            let direction = eigen.eigenvectors.column(axis);
            let reach = sides.iter().map(|side| flat(*side).dot(&direction).abs()).fold(0.0, f64::max);
            (reach, reach * eigen.eigenvalues[axis].max(0.0).sqrt())
        });
        let most = along_axes[0].1.max(along_axes[1].1);
        if most < FLAT_TURN {
            return self.reach_between(triangle).unwrap_or(longest);
        }
        let turning = along_axes.iter().filter(|(_, turn)| *turn >= NOTABLE_TURN * most);
        turning.map(|(reach, _)| *reach).fold(0.0, f64::max)
    }

    /// How far a flat triangle reaches, mm, along the direction in which the part may turn beside its flat
    /// side. This is the direction across the edge of a hidden arc, or along the turn to the neighbours of
    /// the nearest triangle of the flat side that has any. `None` if there are none.
    fn reach_between(&self, triangle: usize) -> Option<f64> {
        let corners = self.corners(triangle).0;
        let normal = facet_normal(corners);
        let turn = |side: usize| {
            let other = self.continued.get(side).copied().unwrap_or(NONE);
            let beyond = (other != NONE).then(|| facet_normal(self.corners(other as usize / 3).0));
            beyond.map_or(Vector3::zeros(), |beyond| beyond - normal * beyond.dot(&normal))
        };
        let direction_at = |triangle: usize| {
            let arc = self.beside_arcs.binary_search_by_key(&(triangle as u32), |&(beside, _)| beside);
            if let Ok(arc) = arc {
                return self.beside_arcs[arc].1.cross(&normal).try_normalize(FLAT_TURN);
            }
            let turns = [0, 1, 2].map(|side| turn(3 * triangle + side));
            let most = turns.into_iter().max_by(|one, other| one.norm().total_cmp(&other.norm()))?;
            most.try_normalize(FLAT_TURN)
        };
        let (mut flat, mut next) = (vec![triangle], 0);
        let direction = loop {
            let here = *flat.get(next)?;
            if let Some(direction) = direction_at(here) {
                break direction;
            }
            next += 1;
            let beyond = self.continued.get(3 * here..3 * here + 3).unwrap_or(&[]);
            for other in beyond.iter().filter(|&&other| other != NONE).map(|&other| other as usize / 3) {
                if flat.len() < MOST_OF_FLAT && !flat.contains(&other) {
                    flat.push(other);
                }
            }
        };
        let along = corners.map(|corner| corner.coords.dot(&direction));
        Some(along.into_iter().fold(f64::MIN, f64::max) - along.into_iter().fold(f64::MAX, f64::min))
    }

    /// The ends of a side, mm.
    pub(super) fn ends(&self, side: usize) -> [Point3<f64>; 2] {
        let corners = self.triangles[side / 3];
        [side % 3, (side % 3 + 1) % 3].map(|corner| self.positions[corners[corner] as usize])
    }

    /// The longest side of a triangle, mm, if it is more than `times` times as long as another side.
    fn long_side(&self, triangle: usize, times: f64) -> Option<Vector3<f64>> {
        let sides = [0, 1, 2].map(|side| {
            let [from, to] = self.ends(3 * triangle + side);
            to - from
        });
        let by_length = |one: &Vector3<f64>, other: &Vector3<f64>| one.norm().total_cmp(&other.norm());
        let longest = sides.into_iter().max_by(by_length)?;
        let shortest = sides.into_iter().min_by(by_length)?;
        (longest.norm() > times * shortest.norm()).then_some(longest)
    }

    /// Visits the vertices at the ends of each side; a side that another one continues only once.
    fn for_each_edge(&self, mut visit: impl FnMut([u32; 2])) {
        for (triangle, corners) in self.triangles.iter().enumerate() {
            for corner in 0..3 {
                let side = 3 * triangle + corner;
                let is_first = self.continued[side] as usize > side || self.continuing(side).is_none();
                if is_first {
                    visit([corners[corner], corners[(corner + 1) % 3]]);
                }
            }
        }
    }

    /// The side that continues one, if both have the same vertices: those of cylinders have their own at edges.
    fn continuing(&self, side: usize) -> Option<usize> {
        let other = self.continued[side];
        if other == NONE {
            return None;
        }
        let ends = |side: usize| {
            let corners = self.triangles[side / 3];
            let (one, other) = (corners[side % 3], corners[(side % 3 + 1) % 3]);
            (one.min(other), one.max(other))
        };
        let other = other as usize;
        (ends(side) == ends(other)).then_some(other)
    }
}
