//! From triangles to a smooth mesh: which facets continue each other, and the normals of the vertices that they share.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::arcs::{self, NEGLIGIBLE_BEND};
use super::cambers;
use super::chains::OF_TURNED;
use super::creases::{Facing, Steps, matters};
use super::cylinders;
use super::ends::{self, precision};
use super::hidden_arcs::{self, HiddenArc};
use super::long_sides;
use super::plane_polygons;
use super::round::Camber;
use super::sections::Facets;
use super::settling::Estimates;
use super::spheres;
use super::strips;
use super::turned;
use super::{
    CREASE_ANGLE, Crease, EXACT_NORMAL_TOLERANCE, MOST_BEND, NORMAL_TOLERANCE, SmoothMesh, TURN_OF_PRISM,
    TURN_OF_SHADED_PRISM,
};
use crate::geometry::adjacency::{
    NONE, Neighbours, WELD_DISTANCE, facet_normal, opposite_sides, sliver_side, spread, weld, width,
};
use crate::geometry::chord_normals::{Chord, are_of_smooth_curves};
use crate::geometry::disjoint_sets::DisjointSets;
use crate::geometry::flats;
use crate::geometry::fork::{Fork, InTurn, found, join, mapped};
use crate::geometry::mesh::TriMesh;
use crate::geometry::osculating_jet::{EstimatedNormal, NEGLIGIBLE_RISE, refined_normal};
use crate::geometry::rounding;
use crate::geometry::space::View;

/// The angle instead of [`CREASE_ANGLE`], rad, if the file's normals were averaged to look smooth and the
/// facets on both sides are about equally wide. Then the designer of an octagonal prism more likely intended
/// a round part. A narrow facet beside a wide one is a chamfer.
const SHADED_CREASE_ANGLE: f64 = 50.0 * std::f64::consts::PI / 180.0;
/// Facets are about equally wide if one is at most this many times as wide as the other.
const ABOUT_AS_WIDE: f64 = 1.5;

/// Tangent planes that meet at a smaller angle than this, rad, are one.
const SAME_PLANE: f64 = 0.02;
/// An edge that leaves its side further than this, as a cosine, is damage.
const LEAST_ALONG: f64 = 0.5;
/// Copies are looked for if at least this share of the facets continues nowhere.
const LEAST_ALONE: f64 = 0.01;
/// An edge that leaves its side by less than this, mm, is straight.
const LEAST_BEND: f64 = 1e-5;

/// The sides of this many triangles are looked at together, which limits the memory for what is found.
const BLOCK: usize = 1 << 16;

/// How two facets meet at a side.
#[derive(Clone, Copy, Default)]
enum Meeting {
    /// There are no two, or the other side has the answer.
    #[default]
    None,
    Smooth,
    /// Smooth by normals of the file that round an edge of the facets.
    Rounded,
    /// Smooth unless the steps beside it show an edge.
    Step,
    /// At an edge that normals of the file show.
    Edge,
    /// At an edge that the facets show.
    Sharp,
}

/// What is known of a mesh.
#[derive(Default)]
struct Known {
    /// Sides that are edges of the part, in ascending order.
    edges: Vec<Facing>,
    /// Facets without edges between them.
    cambers: Vec<Camber>,
}

impl Known {
    fn is_nothing(&self) -> bool {
        self.edges.is_empty() && self.cambers.is_empty()
    }
}

/// The mesh without triangles that have two corners at one place; `None` if there are none.
fn without_collapsed(mesh: &TriMesh) -> Option<TriMesh> {
    let is_kept = |&triangle: &[u32; 3]| {
        let [a, b, c] = mesh.corners(triangle);
        [b - a, c - b, a - c].iter().all(|side| side.norm_squared() >= WELD_DISTANCE * WELD_DISTANCE)
    };
    if mesh.triangles().iter().all(is_kept) {
        return None;
    }
    let is_kept: Vec<bool> = mesh.triangles().iter().map(is_kept).collect();
    is_kept.contains(&true).then(|| mesh.with_only(&is_kept))
}

/// The mesh without the triangles that are in it once more; `None` if there are no copies.
fn without_copies(mesh: &TriMesh) -> Option<TriMesh> {
    let places = places_of(mesh.triangles(), mesh.positions());
    let opposite = opposite_sides(&places);
    let sorted = |triangle: usize| {
        let mut corners = places[triangle];
        corners.sort_unstable();
        corners
    };
    // At a border, a side and its copy are two.
    let is_alone = |triangle: &usize| {
        let mut sides = opposite[3 * triangle..3 * triangle + 3].iter();
        sides.all(|&side| side == NONE || sorted(side as usize / 3) == sorted(*triangle))
    };
    let mut alone: Vec<_> =
        (0..places.len()).filter(is_alone).map(|triangle| (sorted(triangle), triangle)).collect();
    alone.sort_unstable();
    let copies: Vec<usize> =
        alone.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| pair[1].1).collect();
    if copies.is_empty() {
        return None;
    }
    let mut is_kept = vec![true; places.len()];
    copies.into_iter().for_each(|copy| is_kept[copy] = false);
    Some(mesh.with_only(&is_kept))
}

impl SmoothMesh {
    /// The mesh as `view` shows it. Two triangles continue each other across a shared side if the file's
    /// normals agree at both of its ends to within [`NORMAL_TOLERANCE`]. Without normals, they continue each
    /// other if their facets meet at less than [`CREASE_ANGLE`], run the same way round (see
    /// [`winding`](crate::geometry::winding)), and the steps beside them show that they are facets of a
    /// curved face (`creases`).
    ///
    /// Normals that the file does not have are estimated in these steps:
    ///
    /// - from the facets round a vertex, weighted by sin(angle) / (product of edge lengths), which is exact
    ///   on spheres (Max, Weights for computing vertex normals from facet normals, Journal of Graphics Tools
    ///   4(2), 1999);
    /// - from the cubics through the vertices round it (`osculating_jet`), because on other surfaces the
    ///   first step is right only where the vertices are placed symmetrically;
    /// - where arcs of different radii meet, from these arcs (`arcs`);
    /// - at right angles to long, straight sides (`long_sides`);
    /// - where a wide facet continues in narrow ones, as a flat side in its fillet, from the narrow ones
    ///   (`flats`).
    ///
    /// The normals of cylinders and extruded strips are estimated without the facets beyond their ends
    /// (`cylinders`, `strips`, `plane_curve`, `free_outlines`). Those of balls follow from all their vertices
    /// (`spheres`), and so do those of shallow cylinders (`cambers`). Normals that only shade
    /// ([`TriMesh::normals_only_shade`]) are used only to find edges. Where the file has no normals, the
    /// estimates do not depend on how plane polygons were cut (`plane_polygons`). A mesh that consists of its
    /// facets ([`TriMesh::is_facetted`]) continues nowhere.
    pub fn new(mesh: &TriMesh, view: &View) -> Self {
        Self::with_fork(mesh, view, &InTurn)
    }

    /// [`SmoothMesh::new`], of which `fork` may do halves at once.
    pub fn with_fork(mesh: &TriMesh, view: &View, fork: &dyn Fork) -> Self {
        if mesh.is_facetted() {
            return Self::of_facets(mesh, view);
        }
        Self::with_known(mesh, view, &Known::default(), fork)
    }

    /// The same, of which something is known.
    fn with_known(mesh: &TriMesh, view: &View, known: &Known, fork: &dyn Fork) -> Self {
        let positions: Vec<_> = mesh.positions().iter().map(|&position| view.point(position)).collect();
        let given: Vec<_> = mesh.normals().iter().map(|&normal| view.vector(normal)).collect();
        let mut places = places_of(mesh.triangles(), &positions);
        let mut opposite = opposite_sides(&places);
        let is_open =
            |vertex: u32| given.get(vertex as usize).is_none_or(|normal| *normal == Vector3::zeros());
        let (read, links) = (mesh.triangles(), (&mut places[..], &mut opposite[..]));
        let divided = plane_polygons::divided_evenly(read, &positions, links, is_open, fork);
        let corners = divided.as_deref().unwrap_or(read);
        let points = |triangle: usize| corners[triangle].map(|index| positions[index as usize]);
        let facet = |triangle: usize| {
            let Some(side) = sliver_side(points(triangle)) else { return facet_normal(points(triangle)) };
            // A sliver has no direction of its own; it belongs to the facet along its longest side.
            let neighbour = opposite[triangle * 3 + side];
            facet_normal(points(if neighbour == NONE { triangle } else { neighbour as usize / 3 }))
        };
        let given_normal = |corner: usize| {
            given.get(corners[corner / 3][corner % 3] as usize).copied().unwrap_or_else(Vector3::zeros)
        };
        let only_shades = mesh.normals_only_shade();
        let tolerance = if mesh.has_exact_normals() { EXACT_NORMAL_TOLERANCE } else { NORMAL_TOLERANCE };
        let same_normal = tolerance.cos();

        let mut vertex_sets = DisjointSets::new(places.len() * 3);
        let mut region_sets = DisjointSets::new(places.len());
        let (mut rounded, mut edges, mut steps) = (Vec::new(), Vec::new(), Vec::new());
        let mut sharp = Vec::new();
        // The corners at the ends of two sides that face each other, those at one place together.
        let facing_corners = |side: usize, other: usize| {
            let (here, there) = (side / 3, other / 3);
            let ends = [side, here * 3 + (side + 1 - here * 3) % 3];
            let facing = [other, there * 3 + (other + 1 - there * 3) % 3];
            let place = |corner: usize| places[corner / 3][corner % 3];
            // Neighbours that are wound alike run along their common side in opposite directions.
            let wound_alike = place(ends[0]) != place(other);
            let facing = if wound_alike { [facing[1], facing[0]] } else { facing };
            ([(ends[0], facing[0]), (ends[1], facing[1])], wound_alike)
        };
        // `facet_here` is the normal of its facet, if that is known.
        let meeting = |side: usize, facet_here: &mut Option<Vector3<f64>>| {
            let other = opposite[side] as usize;
            // Each pair once; NONE is larger than any side.
            if opposite[side] == NONE || other < side {
                return Meeting::None;
            }
            if known.edges.binary_search(&[side as u32, opposite[side]]).is_ok() {
                return Meeting::Sharp;
            }
            let (here, there) = (side / 3, other / 3);
            let (pairs, wound_alike) = facing_corners(side, other);
            let normal = &given_normal;
            let is_given =
                |&(a, b): &(usize, usize)| normal(a) != Vector3::zeros() && normal(b) != Vector3::zeros();
            let have_normals = pairs.iter().all(is_given);
            let agree = || pairs.iter().all(|&(a, b)| normal(a).dot(&normal(b)) >= same_normal);
            let mut meet = || {
                let cosine = facet_here.get_or_insert_with(|| facet(here)).dot(&facet(there));
                if wound_alike { cosine } else { -cosine }
            };
            if !have_normals || only_shades {
                let cosine = meet();
                let is_round = have_normals && {
                    let [one, next] = [width(points(here), side % 3), width(points(there), other % 3)];
                    one <= ABOUT_AS_WIDE * next && next <= ABOUT_AS_WIDE * one
                };
                let angle = if is_round { SHADED_CREASE_ANGLE } else { CREASE_ANGLE };
                // Estimates over facets that run in opposite ways would cancel out.
                let is_smooth = wound_alike && cosine >= angle.cos() && (!have_normals || agree());
                if !is_smooth {
                    return Meeting::Sharp;
                }
                if matters(cosine, || [points(here), points(there)], side % 3) {
                    return Meeting::Step;
                }
            } else if !agree() {
                return Meeting::Edge;
            }
            let meets_flatly = || meet_within(points(here), points(there), SHADED_CREASE_ANGLE);
            if have_normals && !meets_flatly() && meet() < SHADED_CREASE_ANGLE.cos() {
                Meeting::Rounded
            } else {
                Meeting::Smooth
            }
        };
        for first in (0..places.len()).step_by(BLOCK) {
            let meetings = mapped(fork, BLOCK.min(places.len() - first), |triangle| {
                let mut facet_here = None;
                [0, 1, 2].map(|side| meeting(3 * (first + triangle) + side, &mut facet_here))
            });
            for (side, &meeting) in (3 * first..).zip(meetings.as_flattened()) {
                let facing = [side as u32, opposite[side]];
                match meeting {
                    Meeting::None => continue,
                    Meeting::Step => steps.push(facing),
                    Meeting::Sharp => sharp.push(facing),
                    Meeting::Edge => edges.push(facing),
                    Meeting::Rounded => rounded.push(facing),
                    Meeting::Smooth => {}
                }
                if matches!(meeting, Meeting::Smooth | Meeting::Rounded) {
                    let other = opposite[side] as usize;
                    facing_corners(side, other).0.iter().for_each(|&(a, b)| vertex_sets.join(a, b));
                    region_sets.join(side / 3, other / 3);
                }
            }
        }
        cut(&mut opposite, &edges);
        cut(&mut opposite, &sharp);
        let facets = Facets { positions: &positions, triangles: corners, continued: &opposite };
        let turn_of_prism = if only_shades { TURN_OF_SHADED_PRISM } else { TURN_OF_PRISM };
        let rounding = rounding::deviation(mesh.positions());
        let steps_between =
            Steps { facets, places: &places, steps: &steps, edges: &sharp, turn_of_prism, rounding };
        let mut creases = steps_between.creases(fork);
        creases.retain(|&crease| !known.cambers.iter().any(|camber| camber.has(crease)));
        let facets = Facets { positions: &positions, triangles: corners, continued: &opposite };
        let hidden = hidden_arcs::found(&facets, &creases);
        cut(&mut opposite, &creases);
        for &[side, other] in steps.iter().filter(|step| opposite[step[0] as usize] != NONE) {
            let (pairs, _) = facing_corners(side as usize, other as usize);
            pairs.iter().for_each(|&(a, b)| vertex_sets.join(a, b));
            region_sets.join(side as usize / 3, other as usize / 3);
        }

        // Other normals of a file show less well where an edge runs.
        let exact = if mesh.has_exact_normals() { &edges[..] } else { &[] };
        let beside = creases.iter().chain(&sharp).chain(exact);
        let beside = beside.map(|&[side, other]| facing_corners(side as usize, other as usize).0);
        let beside: Vec<[(usize, usize); 2]> = beside.collect();
        // Large meshes need much memory here: what is read once is dropped.
        drop(places);
        let (vertices, count) = vertex_sets.numbered();
        let triangles: Vec<[u32; 3]> = vertices.as_chunks().0.to_vec();
        drop(vertices);
        let vertices = || triangles.iter().zip(corners).flat_map(|(own, given)| own.iter().zip(given));
        let mut shared = vec![Point3::origin(); count];
        vertices().for_each(|(&own, &given)| shared[own as usize] = positions[given as usize]);
        drop(positions);
        let mut normals = vec![Vector3::zeros(); count];
        let has_given_normals = !only_shades && !given.is_empty();
        if has_given_normals {
            vertices().for_each(|(&own, &vertex)| normals[own as usize] += given[vertex as usize]);
        }
        drop(given);
        let mut smooth = Self {
            positions: shared,
            normals,
            triangles,
            regions: region_sets.numbered().0,
            continued: opposite,
            doubts: Vec::new(),
            slope_doubts: Vec::new(),
            has_given_normals,
            rounding,
            creases: Vec::new(),
            beside_arcs: hidden_arcs::directions(&hidden),
            cones: Vec::new(),
        };
        let mut estimates = smooth.complete_normals(fork);
        let double_bends = smooth.double_bends(&hidden, &estimates.is_estimated);
        let cambers = &known.cambers;
        let written = mesh.positions();
        let rounds = cylinders::settle(&mut smooth, written, cambers, &mut estimates, fork);
        let is_round = &rounds.is_cylinder;
        let edges = spheres::settle(&mut smooth, &mut estimates, is_round, fork);
        // Flat sides that are cut from spheres are only known together with these, and cambers only where they are not.
        if known.is_nothing() {
            let (creases, estimated) = (&creases, &estimates.is_estimated);
            let cambers =
                cambers::found(&smooth, &cambers::Shown { creases, estimated, is_round, written }, fork);
            let known = Known { edges, cambers };
            if !known.is_nothing() {
                return Self::with_known(mesh, view, &known, fork);
            }
        }
        smooth.trust(is_round);
        let round = smooth.triangles.iter().zip(is_round).filter(|(_, is_round)| **is_round);
        round.for_each(|(corners, _)| corners.iter().for_each(|&vertex| estimates.trust(vertex)));
        let of_strips = strips::settle(&mut smooth, &mut estimates, is_round, &hidden, fork);
        let near = precision(&smooth).max(ends::rounding(mesh.positions()));
        let before = || smooth.found_slope_doubts(&estimates, &hidden, fork);
        let of_turned = turned::found(&smooth, &estimates.is_estimated, is_round, near, before, fork);
        of_turned.settle(&mut smooth, &mut estimates);
        smooth.creases = smooth.edges_between(beside, is_round);
        smooth.doubt_rounded(&rounded);
        smooth.slope_doubts = smooth.found_slope_doubts(&estimates, &hidden, fork);
        smooth.replace_slope_doubts(of_strips);
        smooth.cones = rounds.cones(&smooth);
        let of_cone = |triangle: usize| double_bends.get(&triangle).map_or(0.0, |doubt| OF_TURNED * doubt);
        let of_cones = smooth.cones.iter().map(|&(triangle, _)| triangle as usize);
        let of_cones = of_cones.map(|triangle| (triangle, of_cone(triangle) as f32)).collect();
        smooth.replace_slope_doubts(of_cones);
        of_turned.add_doubts(&mut smooth.slope_doubts, smooth.triangles.len());
        smooth.doubt_flat_shading(mesh);
        smooth.trust(is_round);
        if !only_shades {
            smooth.trust_exact_normals(&estimates.is_estimated, near, fork);
        }
        smooth.doubt_rivals(&rounds.apart);
        smooth
    }

    /// The triangles with `estimated` normals that may be of S-shaped curves, with the errors of their slopes if they are, rad, root mean
    /// square: a cone between two curves may be the long chord of their profile.
    fn double_bends(&self, hidden: &[HiddenArc], estimated: &[bool]) -> BTreeMap<usize, f64> {
        let mut bends = BTreeMap::new();
        for arc in hidden.iter().filter(|arc| arc.is_double_bend) {
            if self.triangles[arc.triangle].iter().any(|&vertex| estimated[vertex as usize]) {
                let doubt: &mut f64 = bends.entry(arc.triangle).or_default();
                *doubt = doubt.max(arc.doubt);
            }
        }
        bends
    }

    /// Doubts the slopes of facets that are shaded flat but may belong to a round face, where the rest of
    /// their body is shaded smooth. The slope of an arc differs from that of its chord by up to half the
    /// angle between two chords.
    fn doubt_flat_shading(&mut self, mesh: &TriMesh) {
        let turns = mesh.open_turns();
        self.slope_doubts.resize(turns.len().max(self.slope_doubts.len()), 0.0);
        for (doubt, turn) in self.slope_doubts.iter_mut().zip(turns) {
            *doubt = doubt.max(turn / 12f32.sqrt());
        }
    }

    /// Doubts triangles whose vertices may be on another surface as well, which is so far from theirs, mm and rad.
    fn doubt_rivals(&mut self, apart: &[(usize, f64, f64)]) {
        if apart.is_empty() {
            return;
        }
        self.doubts.resize(self.triangles.len(), 0.0);
        self.slope_doubts.resize(self.triangles.len(), 0.0);
        for &(triangle, height, slope) in apart {
            self.doubts[triangle] = self.doubts[triangle].max(height);
            self.slope_doubts[triangle] = self.slope_doubts[triangle].max(slope as f32);
        }
    }

    /// Replaces the doubts of the slopes of some triangles.
    fn replace_slope_doubts(&mut self, doubts: Vec<(usize, f32)>) {
        if !doubts.is_empty() {
            self.slope_doubts.resize(self.triangles.len(), 0.0);
        }
        doubts.into_iter().for_each(|(triangle, doubt)| self.slope_doubts[triangle] = doubt);
    }

    /// Leaves no doubt about the triangles that are on a cylinder.
    fn trust(&mut self, is_round: &[bool]) {
        for triangle in (0..is_round.len()).filter(|&triangle| is_round[triangle]) {
            if let Some(doubt) = self.doubts.get_mut(triangle) {
                *doubt = 0.0;
            }
            if let Some(doubt) = self.slope_doubts.get_mut(triangle) {
                *doubt = 0.0;
            }
        }
    }

    /// The same for a mesh in which triangles may be more than once, or have two corners at one place. A copied part has no side
    /// that exactly two triangles share, so every facet would be by itself.
    pub fn of_single(mesh: &TriMesh, view: &View, fork: &dyn Fork) -> Self {
        let whole = if mesh.is_facetted() { None } else { without_collapsed(mesh) };
        let mesh = whole.as_ref().unwrap_or(mesh);
        let smooth = Self::with_fork(mesh, view, fork);
        let alone = smooth.continued.chunks_exact(3).filter(|sides| sides.iter().all(|&side| side == NONE));
        if mesh.is_facetted() || (alone.count() as f64) < LEAST_ALONE * smooth.triangles.len() as f64 {
            return smooth;
        }
        match without_copies(mesh) {
            Some(single) => Self::with_fork(&single, view, fork),
            None => smooth,
        }
    }

    /// Every facet flat and by itself.
    fn of_facets(mesh: &TriMesh, view: &View) -> Self {
        let facets = mesh.triangles().iter().map(|&corners| mesh.corners(corners).map(|at| view.point(at)));
        let facets: Vec<[Point3<f64>; 3]> = facets.collect();
        let count = facets.len() as u32;
        Self {
            positions: facets.iter().flatten().copied().collect(),
            normals: facets.iter().flat_map(|&facet| [facet_normal(facet); 3]).collect(),
            triangles: (0..count).map(|facet| [3 * facet, 3 * facet + 1, 3 * facet + 2]).collect(),
            regions: (0..count).collect(),
            continued: vec![NONE; facets.len() * 3],
            doubts: Vec::new(),
            slope_doubts: Vec::new(),
            has_given_normals: false,
            rounding: 0.0,
            creases: Vec::new(),
            beside_arcs: Vec::new(),
            cones: Vec::new(),
        }
    }

    /// Makes the summed normals unit vectors, and estimates a normal where there is none. Returns the
    /// estimates; those that only the facets round the vertex show have no deviation.
    pub(super) fn complete_normals(&mut self, fork: &dyn Fork) -> Estimates {
        let is_missing: Vec<bool> = self.normals.iter().map(|normal| *normal == Vector3::zeros()).collect();
        if is_missing.contains(&true) {
            for triangle in &self.triangles {
                for corner in 0..3 {
                    let vertex = triangle[corner] as usize;
                    let [here, one, two] =
                        [0, 1, 2].map(|turn| self.positions[triangle[(corner + turn) % 3] as usize]);
                    let (first, second) = (one - here, two - here);
                    let lengths = first.norm_squared() * second.norm_squared();
                    if is_missing[vertex] && lengths > 0.0 {
                        self.normals[vertex] += first.cross(&second) / lengths;
                    }
                }
            }
        }
        for normal in &mut self.normals {
            *normal = normal.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        }
        // Where arcs meet, normals are known better than from what follows.
        let mut is_open = is_missing.clone();
        let mut refined: Vec<(u32, EstimatedNormal)> = Vec::new();
        if is_missing.contains(&true) {
            let mut is_near = self.at_bent_edges();
            let bent = (0..is_near.len()).filter(|&vertex| is_near[vertex] && is_missing[vertex]);
            let bent: Vec<u32> = bent.map(|vertex| vertex as u32).collect();
            spread(&mut is_near, &self.triangles, 1);
            let around = Neighbours::of_chosen(&self.triangles, &is_near);
            let refine = |vertex: u32| {
                let normal =
                    refined_normal(&self.positions, &self.normals, &around, vertex as usize, self.rounding);
                (vertex, normal)
            };
            refined = found(fork, bent.len(), |index| Some(refine(bent[index])));
            for vertex in arcs::join(self, &refined, &is_missing, &around) {
                is_open[vertex as usize] = false;
            }
        }
        if let Some(chosen) = flats::round_bent_ones(self, fork) {
            let is_any_missing = is_missing.contains(&true);
            let ends_of_straight_sides = || match is_any_missing {
                true => long_sides::ends_of_straight_sides(self, &is_open, &chosen, fork),
                false => Vec::new(),
            };
            // Planes do not depend on normals.
            let planes = || flats::Planes::of(self, |triangle| chosen[triangle]);
            let (ends, planes) = join(fork, ends_of_straight_sides, planes);
            let mut is_straight = vec![false; self.normals.len()];
            for vertex in long_sides::straighten(self, ends) {
                is_straight[vertex as usize] = true;
            }
            let estimated = flats::Estimated { all: &is_missing, open: &is_open, straight: &is_straight };
            self.doubts = flats::lead_across(self, &estimated, &planes);
        }
        // What has replaced an estimate is known from the arcs or flat sides that it belongs to.
        let mut deviations = vec![0.0; if is_missing.contains(&true) { self.normals.len() } else { 0 }];
        for (vertex, estimate) in refined {
            if self.normals[vertex as usize] == estimate.normal {
                deviations[vertex as usize] = estimate.deviation;
            }
        }
        Estimates::new(is_missing, deviations)
    }

    /// For each vertex whether its normal and that at the other end of an edge bend this notably: where they do not, estimates from
    /// the facets round them are not changed.
    fn at_bent_edges(&self) -> Vec<bool> {
        let mut is_bent = vec![false; self.positions.len()];
        let least = 8.0 * NEGLIGIBLE_RISE.min(NEGLIGIBLE_BEND) * (1.0 - 1e-9);
        self.for_each_edge(|ends| {
            let [one, other] = ends.map(|end| end as usize);
            let chord = self.positions[other] - self.positions[one];
            let normals = [self.normals[one], self.normals[other]];
            let turn = (normals[1] - normals[0]).norm_squared();
            if turn * chord.norm_squared() > least * least
                || (normals[0] + normals[1]).dot(&chord).abs() > least
            {
                (is_bent[one], is_bent[other]) = (true, true);
            }
        });
        is_bent
    }

    /// Both sides of each edge of the part that is curved or may end within a smooth side, with the corners
    /// that face each other at both ends. On a cylinder (`is_round`) these follow from the edge, and not from
    /// the facets beyond.
    fn edges_between(&self, edges: Vec<[(usize, usize); 2]>, is_round: &[bool]) -> Vec<Crease> {
        let is_round = |crease: &Crease| is_round.get(crease.side as usize / 3) == Some(&true);
        let vertex = |corner: usize| self.triangles[corner / 3][corner % 3] as usize;
        let normals = |(one, other): (usize, usize)| [one, other].map(|corner| self.normals[vertex(corner)]);
        let mut creases = Vec::new();
        for ends in edges {
            let [from, to] = ends.map(|end| self.positions[vertex(end.0)]);
            let (along, normals) = (to - from, ends.map(normals));
            let directions = normals.map(|normals| edge_direction(normals, along));
            let is_sharp = normals.iter().any(|[one, other]| one.dot(other) < NORMAL_TOLERANCE.cos());
            let ends_within = self.regions[ends[0].0 / 3] == self.regions[ends[0].1 / 3];
            let is_straight =
                directions.iter().all(|direction| direction.cross(&along).norm() < 4.0 * LEAST_BEND);
            if is_straight && !ends_within {
                continue;
            }
            // Each side runs from one of its two corners to the next.
            let side = |one: usize, other: usize| match (one % 3 + 1) % 3 == other % 3 {
                true => Crease { side: one as u32, directions, is_sharp },
                false => {
                    let directions = [-directions[1], -directions[0]];
                    Crease { side: other as u32, directions, is_sharp }
                }
            };
            let [first, last] = ends;
            let sides = [side(first.0, last.0), side(first.1, last.1)];
            let are_round = sides.each_ref().map(is_round);
            let follows = |index: &usize| are_round[*index] && !are_round[1 - *index];
            creases.extend((0..2).filter(|index| !follows(index)).map(|index| sides[index].clone()));
        }
        creases.sort_unstable_by_key(|crease| crease.side);
        creases
    }

    /// Doubts the whole bulge of each triangle at a side that normals of the file round, and limits every
    /// doubt to the bulge: the facets themselves belong to the part. If a steep facet continues a facet of a
    /// smooth face, only its bulge across the side is in doubt.
    fn doubt_rounded(&mut self, sides: &[Facing]) {
        let mut is_rounded = vec![false; self.positions.len()];
        let mut across: Vec<(u32, f64)> = Vec::new();
        for facing in sides {
            // Long and low facets tilt more than their normals turn: as far as their long sides are below the part.
            if facing.iter().all(|&side| self.is_of_smooth_face(side as usize / 3)) {
                continue;
            }
            for &side in facing {
                let (triangle, first) = (side as usize / 3, side as usize % 3);
                [first, (first + 1) % 3]
                    .iter()
                    .for_each(|&corner| is_rounded[self.triangles[triangle][corner] as usize] = true);
                across.push((triangle as u32, self.bulge_across(side as usize)));
            }
        }
        if across.is_empty() && self.doubts.is_empty() {
            return;
        }
        self.doubts.resize(self.triangles.len(), 0.0);
        for (triangle, bulge) in across {
            let doubt = &mut self.doubts[triangle as usize];
            *doubt = doubt.max(bulge);
        }
        for triangle in 0..self.triangles.len() {
            let is_rounded = self.triangles[triangle].iter().any(|&vertex| is_rounded[vertex as usize])
                && !self.is_of_smooth_face(triangle);
            if is_rounded || self.doubts[triangle] > 0.0 {
                let bulge = self.patch(triangle).largest_bulge();
                self.doubts[triangle] = if is_rounded { bulge } else { self.doubts[triangle].min(bulge) };
            }
        }
    }

    /// Whether the normals of a triangle could be those of one facet of a smooth face.
    fn is_of_smooth_face(&self, triangle: usize) -> bool {
        let (corners, normals) = self.corners(triangle);
        let chords = [[0, 1], [1, 2], [2, 0]]
            .map(|ends| Chord { ends: ends.map(|end| corners[end]), normals: ends.map(|end| normals[end]) });
        chords.iter().all(|chord| chord.turn() < MOST_BEND)
            && are_of_smooth_curves(chords.into_iter().map(|chord| (chord, 1.0)))
    }

    /// How far the normals at the ends of a side make its triangle bulge at right angles to it, mm.
    fn bulge_across(&self, side: usize) -> f64 {
        let (corners, normals) = self.corners(side / 3);
        let [from, to] = [side % 3, (side % 3 + 1) % 3];
        let normal_lean = |end: usize| {
            // A curved edge of a face leaves its chord towards the normal.
            let chord = corners[to] - corners[from];
            let along = chord - normals[end] * normals[end].dot(&chord);
            let across = facet_normal(corners).cross(&along);
            across.try_normalize(0.0).map_or(0.0, |across| normals[end].dot(&across).abs())
        };
        normal_lean(from).max(normal_lean(to)) * width(corners, side % 3) / 4.0
    }
}

/// The unit direction in which two tangent planes meet, along a side of the mesh; where they are one, that of the side within it.
fn edge_direction([one, other]: [Vector3<f64>; 2], along: Vector3<f64>) -> Vector3<f64> {
    let meet = one.cross(&other);
    let within = |normal: Vector3<f64>| along - normal * along.dot(&normal);
    let direction = match meet.norm() {
        angle if angle > SAME_PLANE => meet * meet.dot(&along).signum(),
        _ => within((one + other).try_normalize(0.0).unwrap_or(one)),
    };
    let straight = along.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
    match direction.try_normalize(0.0) {
        Some(direction) if direction.dot(&straight) > LEAST_ALONG => direction,
        _ => straight,
    }
}

/// For each triangle the places of its corners.
fn places_of(triangles: &[[u32; 3]], positions: &[Point3<f64>]) -> Vec<[u32; 3]> {
    let welded = weld(positions);
    triangles.iter().map(|corners| corners.map(|vertex| welded[vertex as usize])).collect()
}

/// Parts what continues across the `edges`.
fn cut(continued: &mut [u32], edges: &[Facing]) {
    edges.iter().flatten().for_each(|&side| continued[side as usize] = NONE);
}

/// Whether two facets that are wound alike meet at less than an angle below 90°, rad, without a root for each.
fn meet_within(one: [Point3<f64>; 3], other: [Point3<f64>; 3], angle: f64) -> bool {
    let across = |[a, b, c]: [Point3<f64>; 3]| (b - a).cross(&(c - a));
    let (one, other) = (across(one), across(other));
    let cosine = one.dot(&other);
    cosine > 0.0 && cosine * cosine >= angle.cos().powi(2) * one.norm_squared() * other.norm_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn smooth(
        positions: Vec<Point3<f64>>,
        normals: Vec<Vector3<f64>>,
        triangles: Vec<[u32; 3]>,
    ) -> SmoothMesh {
        SmoothMesh::new(&TriMesh::new(positions, normals, triangles).unwrap(), &View::top())
    }

    /// The sides of an n-sided prism of radius 1 and height 1; every facet has vertices of its own.
    fn prism(sides: usize) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let rim = |side: usize, z: f64| {
            let angle = side as f64 / sides as f64 * std::f64::consts::TAU;
            Point3::new(angle.cos(), angle.sin(), z)
        };
        for side in 0..sides {
            let first = positions.len() as u32;
            positions.extend([rim(side, 0.0), rim(side + 1, 0.0), rim(side + 1, 1.0), rim(side, 1.0)]);
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
        (positions, triangles)
    }

    #[test]
    fn a_fine_prism_is_a_cylinder_and_a_coarse_one_has_edges() {
        let (positions, triangles) = prism(16);
        let round = smooth(positions, Vec::new(), triangles);
        assert_eq!((round.positions.len(), round.regions.iter().max()), (32, Some(&0)));
        for (position, normal) in round.positions.iter().zip(&round.normals) {
            // Both quadrangles at a vertex look alike, but for their diagonals.
            let radial = position.coords.xy().normalize();
            assert!((normal.xy() - radial).norm() < 1e-3 && normal.z.abs() < 1e-3, "{normal:?}");
        }
        let (positions, triangles) = prism(6);
        let edged = smooth(positions, Vec::new(), triangles);
        assert_eq!((edged.positions.len(), edged.regions.iter().max()), (24, Some(&5)));
        for triangle in 0..edged.triangles.len() {
            let (corners, normals) = edged.corners(triangle);
            assert!(normals.iter().all(|normal| (normal - facet_normal(corners)).norm() < 1e-12));
        }
    }

    #[test]
    fn normals_of_the_file_tell_edges_however_flat() {
        let (positions, triangles) = prism(16);
        let facets = |positions: &[Point3<f64>], corners: &[u32; 3]| {
            facet_normal(corners.map(|index| positions[index as usize]))
        };
        // Four vertices to a facet, of two triangles.
        let normals: Vec<_> =
            (0..positions.len()).map(|vertex| facets(&positions, &triangles[vertex / 4 * 2])).collect();
        let edged = smooth(positions.clone(), normals, triangles.clone());
        assert_eq!(edged.regions.iter().max(), Some(&15));
        let radial = positions.iter().map(|at| Vector3::new(at.x, at.y, 0.0)).collect();
        let round = smooth(positions, radial, triangles);
        assert_eq!((round.positions.len(), round.regions.iter().max()), (32, Some(&0)));
    }

    #[test]
    fn the_normal_of_an_uneven_fan_on_a_sphere_is_that_of_the_sphere() {
        let mut positions = vec![Point3::new(0.0, 0.0, 5.0)];
        for (azimuth, polar) in [(0.0, 0.2), (1.1, 0.12), (2.9, 0.25), (3.6, 0.1), (5.0, 0.18)] {
            let (sin, cos) = f64::sin_cos(polar);
            positions.push(Point3::new(sin * f64::cos(azimuth), sin * f64::sin(azimuth), cos) * 5.0);
        }
        let triangles = vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [0, 5, 1]];
        let fan = smooth(positions, Vec::new(), triangles);
        assert!((fan.normals[0] - Vector3::z()).norm() < 1e-3, "{:?}", fan.normals[0]);
    }

    #[test]
    fn normals_of_a_quadric_are_found_where_its_vertices_lie_at_random() {
        let height = |x: f64, y: f64| 0.02 * x * x - 0.01 * y * y + 0.015 * x * y;
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
        };
        for row in 0..9 {
            for column in 0..9 {
                let (x, y) =
                    (f64::from(column) * 2.0 - 8.0 + random(), f64::from(row) * 2.0 - 8.0 + random());
                positions.push(Point3::new(x, y, height(x, y)));
                if row > 0 && column > 0 {
                    let upper = (row * 9 + column) as u32;
                    triangles.extend([[upper - 10, upper - 9, upper], [upper - 10, upper, upper - 1]]);
                }
            }
        }
        let quadric = smooth(positions, Vec::new(), triangles);
        for (at, normal) in quadric.positions.iter().zip(&quadric.normals) {
            let slope = [0.04 * at.x + 0.015 * at.y, -0.02 * at.y + 0.015 * at.x];
            let exact = Vector3::new(-slope[0], -slope[1], 1.0).normalize();
            // At the rim the vertices lie on one side only.
            let limit = if at.x.abs().max(at.y.abs()) < 6.0 { 0.002 } else { 0.06 };
            assert!((normal - exact).norm() < limit, "{at:?}: {normal:?} for {exact:?}");
        }
    }
}
