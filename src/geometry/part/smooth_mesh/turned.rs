//! Normals of turned faces whose profile is a free curve, for example of a bracelet or a thermos flask.
//!
//! The vertices of a turned face are on rings: circles about one axis. Programs stagger the rings. A chord
//! along the profile then skips every second ring, and the facets round a vertex show little of the profile
//! between its ends. All rings together are points of one plane curve and show its normals far better. The
//! profile is used where its curvature changes evenly and where it leaves less doubt than the facets do.
//! Where arcs begin, and where an arc is cut into a single facet, the facets show as much.

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};

use super::chains::OF_TURNED;
use super::ends::{Surface, Surroundings};
use super::plane_curve::Place;
use super::profile::{Profile, RingPlace};
use super::rings::{Axis, LEAST_ON_RING, LEAST_RINGS, MOST_BESIDE, Rings, curves};
use super::settling::{Estimates, Settling};
use super::{MOST_SEARCHED, SmoothMesh};
use crate::geometry::adjacency::{NONE, Neighbours};
use crate::geometry::fork::Fork;

/// A turned face has at least this many facets: this many are not all on rings by chance.
const LEAST_TRIANGLES: usize = 40;
/// A ring with fewer than this share of the vertices of the largest ring shows nothing of the profile by
/// itself.
const SHORT_RING: f64 = 0.2;
/// Rings are cut into even sectors: the two sides at a vertex of a ring differ in length by at most this
/// share.
const EVEN: f64 = 1e-3;
/// The middle one of three vertices on a ring leaves the line through the others by at least this many times
/// the tolerance of a vertex (`near`).
const LEAST_BULGE: f64 = 20.0;
/// The normals at three vertices of a ring pass the axis within this angle, as a sine.
const MEETS_AXIS: f64 = 0.05;
/// The components along the axis of the unit normals at three vertices of a ring differ by less than this.
const LIKE: f64 = 0.02;
/// The steps in which an axis is fitted: in each, vertices on one ring are apart by at most this many times
/// the tolerance of a vertex (`near`).
const APART: [f64; 3] = [20.0, 4.0, 2.0];
/// At most this many axes are tried for one face.
const MOST_AXES: usize = 8;
/// Axes are searched at the vertices of at most this many triangles of one face.
const MOST_STARTS: usize = 200;
/// Axes are searched among at most this many neighbours of a vertex.
const MOST_NEIGHBOURS: usize = 16;
/// At most this many looks per triangle on average.
const MOST_VISITS: usize = 16;
/// The profile is used at a ring if its doubt is at most this share of the doubt of the facets there.
const BETTER: f64 = 0.5;
/// Known normals belong to the profile if they pass the axis within this angle, as a sine.
const EXACT: f64 = 1e-3;

/// A face that is turned about an axis.
pub(super) struct Turned<'a> {
    mesh: &'a SmoothMesh,
    axis: Axis,
    profile: Profile,
    /// In ascending order, with their places in the profile.
    vertices: Vec<(u32, Place)>,
    triangles: Vec<TurnedTriangle>,
}

/// A triangle of a turned face.
struct TurnedTriangle {
    triangle: usize,
    /// How far the slope of the part may be from that of its patch with the normals of the profile, rad.
    doubt: f32,
    /// The rings beside its corners.
    rings: [[usize; 2]; 3],
}

impl TurnedTriangle {
    fn rings(&self) -> impl Iterator<Item = usize> {
        self.rings.into_iter().flatten()
    }
}

impl Turned<'_> {
    /// The unit normal of a vertex.
    fn normal(&self, vertex: u32, place: &Place) -> Vector3<f64> {
        self.axis.in_space(&self.mesh.positions[vertex as usize], place.normal_of_profile())
    }

    /// For each ring of the profile, whether that leaves less in doubt there than the facets do, whose doubts about the slope are
    /// `before`, rad.
    fn is_better(&self, before: &[f32]) -> Vec<bool> {
        let mut sums = vec![[0.0; 2]; self.profile.count()];
        for own in &self.triangles {
            let doubts = [own.doubt, before.get(own.triangle).copied().unwrap_or(0.0)];
            for ring in own.rings() {
                for (sum, doubt) in sums[ring].iter_mut().zip(doubts) {
                    *sum += f64::from(doubt).powi(2);
                }
            }
        }
        let sums = sums.into_iter().enumerate();
        sums.map(|(ring, [own, of_facets])| self.profile.is_smooth(ring) && own < BETTER * BETTER * of_facets)
            .collect()
    }

    /// What the profile shows at rings where it `is_better`; `is_open` are the vertices whose normals are not known.
    fn settled(
        &self,
        is_better: &[bool],
        is_open: &[bool],
        before: &[f32],
        surroundings: &Surroundings<'_>,
    ) -> SettledFace {
        let is_used =
            |place: &Place| self.profile.rings_beside(place).into_iter().all(|ring| is_better[ring]);
        let used = self.vertices.iter().filter(|(vertex, place)| is_open[*vertex as usize] && is_used(place));
        let doubt = |own: &TurnedTriangle| {
            let most = before.get(own.triangle).copied().unwrap_or(0.0);
            if own.rings().any(|ring| is_better[ring]) { own.doubt.min(most) } else { 0.0 }
        };
        let triangles: Vec<usize> = self.triangles.iter().map(|own| own.triangle).collect();
        SettledFace {
            vertices: used.map(|(vertex, place)| (*vertex, self.normal(*vertex, place))).collect(),
            at_edges: surroundings.at_edges(&OfFace { face: self, triangles: &triangles }),
            doubts: self.triangles.iter().map(doubt).collect(),
            triangles,
        }
    }
}

/// A turned face as a surface of its triangles.
struct OfFace<'a> {
    face: &'a Turned<'a>,
    triangles: &'a [usize],
}

impl Surface for OfFace<'_> {
    fn triangles(&self) -> &[usize] {
        self.triangles
    }

    fn outward(&self, side: usize) -> Vector3<f64> {
        let Turned { mesh, vertices, .. } = self.face;
        let corners = mesh.triangles[side / 3];
        let ends = [corners[side % 3], corners[(side % 3 + 1) % 3]].into_iter();
        let index = |end: u32| vertices.binary_search_by_key(&end, |(vertex, _)| *vertex).ok();
        let known = ends.filter_map(|end| index(end).map(|index| &vertices[index]));
        let sum: Vector3<f64> = known.map(|(vertex, place)| self.face.normal(*vertex, place)).sum();
        sum.try_normalize(0.0).unwrap_or(sum)
    }

    fn largest_bulge(&self) -> f64 {
        self.triangles.iter().map(|&triangle| self.face.mesh.bulge(triangle)).fold(0.0, f64::max)
    }
}

/// The normals and doubts that the profiles of turned faces give.
#[derive(Default)]
pub(super) struct Settled {
    /// The turned faces that were found.
    faces: Vec<SettledFace>,
}

struct SettledFace {
    triangles: Vec<usize>,
    /// In ascending order, with their normals.
    vertices: Vec<(u32, Vector3<f64>)>,
    at_edges: Vec<u32>,
    /// For each triangle, rad; 0 where the profile is not used.
    doubts: Vec<f32>,
}

/// The normals and doubts that the profiles of turned faces show where they leave less doubt than the facets
/// do; `before` has the doubts of the facets about the slope, rad. Vertices whose normals are not `estimated`
/// are known, and so are those of the triangles that are `is_known`. Vertices may be off by `near`, mm.
pub(super) fn found(
    mesh: &SmoothMesh,
    estimated: &[bool],
    is_known: &[bool],
    near: f64,
    before: impl FnOnce() -> Vec<f32>,
    fork: &dyn Fork,
) -> Settled {
    let mut is_open = estimated.to_vec();
    for (corners, _) in mesh.triangles.iter().zip(is_known).filter(|(_, is_known)| **is_known) {
        corners.iter().for_each(|&vertex| is_open[vertex as usize] = false);
    }
    let faces = Search::faces(mesh, &is_open, near);
    if faces.is_empty() {
        return Settled::default();
    }
    let before = before();
    let mut surroundings = None;
    let settled = faces.iter().filter_map(|face| {
        let is_better = face.is_better(&before);
        if !is_better.contains(&true) {
            return None;
        }
        let surroundings = surroundings.get_or_insert_with(|| Surroundings::of(mesh, near, fork));
        Some(face.settled(&is_better, &is_open, &before, surroundings))
    });
    Settled { faces: settled.collect() }
}

impl Settled {
    /// Replaces the normals that are estimated. The new normals are as exact as those of a file, and are not
    /// estimated any more.
    pub(super) fn settle(&self, mesh: &mut SmoothMesh, estimates: &mut Estimates) {
        let normal_of = |face: &SettledFace, vertex: u32| {
            let index = face.vertices.binary_search_by_key(&vertex, |(vertex, _)| *vertex).ok()?;
            Some(face.vertices[index].1)
        };
        let mut settling = Settling::of(mesh, estimates);
        let mut settled = Vec::new();
        for face in &self.faces {
            settled
                .extend(settling.set(&face.triangles, &face.at_edges, |_, vertex| normal_of(face, vertex)));
        }
        settled.into_iter().for_each(|vertex| estimates.set_known(vertex));
    }

    /// Adds what the profiles leave in doubt to the doubts about the slopes of the triangles, rad.
    pub(super) fn add_doubts(&self, slope_doubts: &mut Vec<f32>, count: usize) {
        if self.faces.is_empty() {
            return;
        }
        slope_doubts.resize(count, 0.0);
        for face in &self.faces {
            for (&triangle, doubt) in face.triangles.iter().zip(&face.doubts) {
                slope_doubts[triangle] = slope_doubts[triangle].hypot(*doubt);
            }
        }
    }
}

struct Search<'a> {
    mesh: &'a SmoothMesh,
    /// For each vertex, whether its normal is not known.
    is_open: &'a [bool],
    around: Neighbours,
    near: f64,
    /// How many triangles may still be looked at.
    visits: usize,
    /// For each triangle, the number of the last walk that reached it.
    last_walk: Vec<u32>,
    /// The number of walks so far.
    walk: u32,
    /// For each triangle and each vertex, its index in the last piece that has it.
    indices: [Vec<u32>; 2],
}

/// Triangles that can be reached from each other, and their vertices, both in ascending order.
struct Piece {
    triangles: Vec<usize>,
    vertices: Vec<u32>,
    /// For each triangle the indices of its vertices.
    corners: Vec<[u32; 3]>,
    /// mm.
    points: Vec<Point3<f64>>,
}

impl<'a> Search<'a> {
    fn faces(mesh: &'a SmoothMesh, is_open: &'a [bool], near: f64) -> Vec<Turned<'a>> {
        let count = mesh.triangles.len();
        if count > MOST_SEARCHED || !is_open.contains(&true) {
            return Vec::new();
        }
        let is_first = |triangle: usize| {
            mesh.triangles[triangle].iter().any(|&vertex| is_open[vertex as usize]) && mesh.bulges(triangle)
        };
        let mut is_seen = vec![false; count];
        let Some(first) = (0..count).find(|&triangle| is_first(triangle)) else { return Vec::new() };
        let around = Neighbours::of(&mesh.triangles, mesh.positions.len());
        let mut search = Search {
            mesh,
            is_open,
            around,
            near,
            visits: MOST_VISITS * count,
            last_walk: vec![0; count],
            walk: 0,
            indices: [vec![0; count], vec![0; mesh.positions.len()]],
        };
        let (mut faces, mut seed) = (Vec::new(), first);
        while seed < count && search.visits > 0 {
            if is_seen[seed] || !is_first(seed) {
                seed += 1;
                continue;
            }
            let reached = search.reachable(seed, |triangle| !is_seen[triangle]);
            reached.iter().for_each(|&triangle| is_seen[triangle] = true);
            if reached.len() < LEAST_TRIANGLES {
                continue;
            }
            let piece = search.piece(reached);
            let found = search.faces_in(&piece);
            if !found.is_empty() {
                // Others may be turned about another axis.
                piece.triangles.iter().for_each(|&triangle| is_seen[triangle] = false);
                seed = piece.triangles[0];
            }
            for face in found {
                face.triangles.iter().for_each(|own| is_seen[own.triangle] = true);
                faces.push(face);
            }
        }
        faces
    }

    /// The triangles that can be reached from one through others, in ascending order.
    fn reachable(&mut self, seed: usize, is_free: impl Fn(usize) -> bool) -> Vec<usize> {
        self.walk += 1;
        self.last_walk[seed] = self.walk;
        let mut found = vec![seed];
        let mut next = 0;
        while next < found.len() {
            let here = found[next];
            next += 1;
            for side in 3 * here..3 * here + 3 {
                let Some(there) = self.mesh.continuing(side).map(|other| other / 3) else { continue };
                if self.last_walk[there] != self.walk && is_free(there) {
                    self.last_walk[there] = self.walk;
                    found.push(there);
                }
            }
        }
        self.visits = self.visits.saturating_sub(found.len());
        found.sort_unstable();
        found
    }

    fn piece(&mut self, triangles: Vec<usize>) -> Piece {
        let [of_triangles, of_vertices] = &mut self.indices;
        for (index, &triangle) in triangles.iter().enumerate() {
            of_triangles[triangle] = index as u32;
        }
        let corners = || triangles.iter().map(|&triangle| self.mesh.triangles[triangle]);
        let mut vertices: Vec<u32> = corners().flatten().collect();
        vertices.sort_unstable();
        vertices.dedup();
        for (index, &vertex) in vertices.iter().enumerate() {
            of_vertices[vertex as usize] = index as u32;
        }
        Piece {
            corners: corners().map(|corners| corners.map(|vertex| of_vertices[vertex as usize])).collect(),
            points: vertices.iter().map(|&vertex| self.mesh.positions[vertex as usize]).collect(),
            triangles,
            vertices,
        }
    }

    /// Of the triangles of the last piece, the most that all are chosen and can be reached from each other, by their indices in
    /// ascending order.
    fn largest_of(&mut self, piece: &Piece, mut is_chosen: Vec<bool>) -> Vec<usize> {
        let mut largest = Vec::new();
        for seed in 0..is_chosen.len() {
            if !is_chosen[seed] {
                continue;
            }
            let of_triangles = std::mem::take(&mut self.indices[0]);
            let index = |triangle: usize| {
                let index = of_triangles[triangle] as usize;
                (piece.triangles.get(index) == Some(&triangle)).then_some(index)
            };
            let found = self.reachable(piece.triangles[seed], |triangle| {
                index(triangle).is_some_and(|index| is_chosen[index])
            });
            let found: Vec<usize> = found.into_iter().filter_map(index).collect();
            self.indices[0] = of_triangles;
            found.iter().for_each(|&index| is_chosen[index] = false);
            if found.len() > largest.len() {
                largest = found;
            }
        }
        largest
    }

    /// The faces of a piece that are turned about one axis.
    fn faces_in(&mut self, piece: &Piece) -> Vec<Turned<'a>> {
        let mut tried: Vec<Axis> = Vec::new();
        for &start in piece.triangles.iter().step_by(piece.triangles.len().div_ceil(MOST_STARTS)) {
            for vertex in self.mesh.triangles[start] {
                for axis in self.axes_at(vertex) {
                    if tried.iter().any(|other| other.is_like(&axis)) {
                        continue;
                    }
                    if tried.len() == MOST_AXES || self.visits == 0 {
                        return Vec::new();
                    }
                    tried.push(axis);
                    let faces = self.faces_about(axis, piece).unwrap_or_default();
                    if !faces.is_empty() {
                        return faces;
                    }
                }
            }
        }
        Vec::new()
    }

    /// The axes of the rings on which a vertex may be between two others.
    fn axes_at(&self, vertex: u32) -> Vec<Axis> {
        let here = self.mesh.positions[vertex as usize];
        let ring = self.around.of_vertex(vertex as usize);
        let ring = &ring[..ring.len().min(MOST_NEIGHBOURS)];
        let mut axes = Vec::new();
        for (index, &one) in ring.iter().enumerate() {
            for &other in &ring[..index] {
                let places = [one, vertex, other].map(|vertex| self.mesh.positions[vertex as usize]);
                let [to_one, to_other] = [places[0] - here, places[2] - here];
                let lengths = [to_one.norm(), to_other.norm()];
                if (lengths[0] - lengths[1]).abs() > EVEN * lengths[0] + self.near
                    || to_one.dot(&to_other) >= 0.0
                {
                    continue;
                }
                let bulge = (to_one + to_other).norm() / 2.0;
                if bulge < LEAST_BULGE * self.near {
                    continue;
                }
                let Some(axis) = Axis::of_circle(places) else { continue };
                let normals = [one, vertex, other].map(|vertex| self.mesh.normals[vertex as usize]);
                let is_met =
                    places.iter().zip(&normals).all(|(at, normal)| axis.misses(at, normal) < MEETS_AXIS);
                let along = normals.map(|normal| normal.dot(&axis.direction));
                if is_met && along.iter().all(|own| (own - along[1]).abs() < LIKE) {
                    axes.push(axis);
                }
            }
        }
        axes
    }

    /// The faces of a piece that are turned about an axis, one for each profile; `None` if there are no rings about it.
    fn faces_about(&mut self, mut axis: Axis, piece: &Piece) -> Option<Vec<Turned<'a>>> {
        self.visits = self.visits.saturating_sub(piece.triangles.len());
        let points = &piece.points;
        for apart in APART {
            let rings = Rings::about(&axis, points, apart * self.near);
            let members = rings.members(points);
            if rings.count < LEAST_RINGS || members.len() < LEAST_RINGS * LEAST_ON_RING {
                return None;
            }
            axis = axis.fitted(&members, rings.count)?;
        }
        let rings = Rings::about(&axis, points, APART[2] * self.near);
        let mut members: Vec<Vec<u32>> = vec![Vec::new(); rings.count];
        for (vertex, &ring) in (0..).zip(&rings.of_vertex).filter(|(_, ring)| **ring != NONE) {
            members[ring as usize].push(vertex);
        }
        // A few vertices are at one height by chance, or because the mesh is symmetric.
        let largest = members.iter().map(Vec::len).max()?;
        members.retain(|ring| ring.len() == 1 || ring.len() as f64 > SHORT_RING * largest as f64);
        let places: Vec<RingPlace> = members.iter().map(|ring| RingPlace::of(&axis, points, ring)).collect();
        let mut ring_of = vec![NONE; points.len()];
        for (ring, members) in (0..).zip(&members) {
            members.iter().for_each(|&vertex| ring_of[vertex as usize] = ring);
        }
        let mut beside = vec![BTreeSet::new(); places.len()];
        for corners in &piece.corners {
            let own = corners.map(|vertex| ring_of[vertex as usize]);
            for [one, other] in [[own[0], own[1]], [own[1], own[2]], [own[2], own[0]]] {
                if one != other && one != NONE && other != NONE {
                    beside[one as usize].insert(other as usize);
                    beside[other as usize].insert(one as usize);
                }
            }
        }
        // A hub that is joined to many rings is on no profile.
        let is_hub: Vec<bool> = beside.iter().map(|others| others.len() > MOST_BESIDE).collect();
        for (ring, others) in beside.iter_mut().enumerate() {
            others.retain(|other| !is_hub[ring] && !is_hub[*other]);
        }
        let at: Vec<[f64; 2]> = places.iter().map(|place| place.at).collect();
        let faces = curves(&at, &beside).into_iter().filter_map(|(order, is_closed)| {
            let members: Vec<&[u32]> = order.iter().map(|&ring| &members[ring][..]).collect();
            let rings: Vec<RingPlace> = order.iter().map(|&ring| places[ring]).collect();
            self.face_along(axis, piece, &members, &rings, is_closed)
        });
        Some(faces.collect())
    }

    /// The face of a piece about an axis whose profile runs through rings in their order, by the indices of their vertices and by their
    /// places.
    fn face_along(
        &mut self,
        axis: Axis,
        piece: &Piece,
        members: &[&[u32]],
        rings: &[RingPlace],
        is_closed: bool,
    ) -> Option<Turned<'a>> {
        let mesh = self.mesh;
        let is_pole = [0, rings.len() - 1].map(|end| members[end].len() == 1);
        let mut profile = Profile::through(rings, is_closed, is_pole)?;
        let vertex = |index: u32| piece.vertices[index as usize] as usize;
        let outward = |(ring, members): (usize, &&[u32])| {
            let vertex = vertex(members[0]);
            let own = axis.in_space(&mesh.positions[vertex], profile.at_ring(ring).normal_of_profile());
            own.dot(&mesh.normals[vertex])
        };
        if members.iter().enumerate().map(outward).sum::<f64>() < 0.0 {
            profile.turn_over();
        }
        let known = |members: &&[u32]| {
            let mut known =
                members.iter().map(|&index| vertex(index)).filter(|&vertex| !self.is_open[vertex]);
            known.find_map(|vertex| {
                let (at, normal) = (&mesh.positions[vertex], &mesh.normals[vertex]);
                (axis.misses(at, normal) < EXACT).then(|| axis.in_profile(at, normal))
            })
        };
        profile.set_known(&members.iter().map(known).collect::<Vec<_>>());
        let mut places: Vec<Option<Place>> = vec![None; piece.points.len()];
        for (ring, members) in members.iter().enumerate() {
            members.iter().for_each(|&index| places[index as usize] = Some(profile.at_ring(ring)));
        }
        self.place_others(&mut places, &axis, &profile, piece);
        let places_of = |corners: &[u32; 3]| {
            let [one, two, three] = corners.map(|index| places[index as usize]);
            Some([one?, two?, three?])
        };
        let is_placed = piece.corners.iter().map(|corners| places_of(corners).is_some()).collect();
        let of_face = self.largest_of(piece, is_placed);
        if of_face.len() < LEAST_TRIANGLES {
            return None;
        }
        let mut is_used = vec![false; places.len()];
        of_face
            .iter()
            .flat_map(|&index| piece.corners[index])
            .for_each(|index| is_used[index as usize] = true);
        let triangle = |index: usize| {
            let places = places_of(&piece.corners[index])?;
            Some(TurnedTriangle {
                triangle: piece.triangles[index],
                doubt: OF_TURNED as f32 * profile.doubt(places),
                rings: places.map(|place| profile.rings_beside(&place)),
            })
        };
        let triangles = of_face.into_iter().filter_map(triangle).collect();
        let used = piece.vertices.iter().zip(&places).zip(is_used).filter(|(_, is_used)| *is_used);
        let vertices = used.filter_map(|((&vertex, place), _)| Some((vertex, (*place)?))).collect();
        Some(Turned { mesh, axis, profile, vertices, triangles })
    }

    /// Finds the places of the vertices of a piece that are between rings, from triangle to triangle.
    fn place_others(&mut self, places: &mut [Option<Place>], axis: &Axis, profile: &Profile, piece: &Piece) {
        let mut front: Vec<&[u32; 3]> = piece.corners.iter().collect();
        loop {
            let mut is_done = true;
            front.retain(|corners| {
                let round: Vec<Place> = corners.iter().filter_map(|&index| places[index as usize]).collect();
                if round.is_empty() {
                    return true;
                }
                for index in corners.map(|index| index as usize) {
                    if places[index].is_none() {
                        places[index] = profile.place(&round, axis.place(&piece.points[index]), self.near);
                        is_done &= places[index].is_none();
                    }
                }
                false
            });
            self.visits = self.visits.saturating_sub(front.len());
            if is_done || self.visits == 0 {
                return;
            }
        }
    }
}

#[cfg(test)]
mod rounded_tests;
#[cfg(test)]
mod tests;
