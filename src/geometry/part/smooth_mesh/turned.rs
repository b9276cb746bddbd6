//! Normals of turned faces whose profile is a free curve, as of a bracelet, a bell or a vase.
//!
//! The vertices of a turned face are on rings: circles about one axis. Programs stagger the rings, so that a chord along the profile
//! skips every second one, and the facets round a vertex show little of the profile between them. All rings together are points of
//! one plane curve, and show its normals far better. It is used where its curvature changes evenly, and leaves less in doubt than the
//! facets do: where arcs begin, and where one is cut into a single facet, the facets know as much.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix4, Point3, Vector2, Vector3, Vector4};

use super::ends::{Surface, Surroundings, range};
use super::plane_curve::{Place, Profile, RingPlace};
use super::settling::Settling;
use super::{MOST_BEND, SmoothMesh};
use crate::geometry::adjacency::{NONE, Neighbours};
use crate::geometry::fork::Fork;
use crate::geometry::shape_fit::cross_directions;

/// A ring has so many vertices, at least, unless it is a single one on the axis: three define a circle, the others confirm it; …
const LEAST_ON_RING: usize = 6;
/// … and a turned face so many rings, …
const LEAST_RINGS: usize = 5;
/// … and so many facets: by chance, not all of so many are on rings.
const LEAST_TRIANGLES: usize = 40;
/// Rings with fewer than this share of the vertices of the largest one show nothing of the profile by themselves.
const SHORT_RING: f64 = 0.2;
/// Rings beside one of a profile, at most.
const MOST_BESIDE: usize = 12;
/// At most this share of the rings beside those of a profile is not of it.
const MOST_OF_OTHERS: f64 = 0.1;
/// Rings are cut into even sectors: the sides on both sides of a vertex differ by at most this share.
const EVEN: f64 = 1e-3;
/// The middle vertex of three on a ring leaves the line through the others by so many times what a vertex may be off, at least.
const LEAST_BULGE: f64 = 20.0;
/// Normals at three vertices of a ring pass the axis within this angle, as a sine, and their parts along it differ by at most the
/// second.
const MEETS_AXIS: f64 = 0.05;
const LIKE: f64 = 0.02;
/// In the steps in which an axis is fitted, vertices on a ring are apart by at most so many times what they may be off.
const APART: [f64; 3] = [20.0, 4.0, 2.0];
/// Axes that are tried for one face, and triangles whose vertices are looked at for axes, at most.
const MOST_AXES: usize = 8;
const MOST_STARTS: usize = 200;
/// Neighbours of a vertex that are looked at, at most.
const MOST_NEIGHBOURS: usize = 16;
/// Triangles are looked at so many times on average, at most.
const MOST_VISITS: usize = 16;
/// Meshes with more triangles are fine; a search would take long.
const MOST_TRIANGLES: usize = 300_000;
/// The profile is used at a ring where it leaves at most this share of the doubt of the facets there.
const BETTER: f64 = 0.5;
/// The error is that of the slope along the profile only: the mean over lines in all directions.
const OF_TURNED: f64 = std::f64::consts::FRAC_2_PI;
/// Axes that differ by less than this, as a sine and as a share of their distance, are tried once.
const SAME_AXIS: f64 = 0.01;
/// Known normals belong to the profile where they pass the axis within this, as a sine.
const EXACT: f64 = 1e-3;

/// The axis of a turned face.
#[derive(Clone, Copy)]
struct Axis {
    through: Point3<f64>,
    direction: Vector3<f64>,
}

impl Axis {
    /// That of the circle through three points.
    fn of_circle([one, middle, other]: [Point3<f64>; 3]) -> Option<Self> {
        let (to_one, to_other) = (one - middle, other - middle);
        let across = to_other.cross(&to_one);
        let to_center = (to_one * to_other.norm_squared() - to_other * to_one.norm_squared()).cross(&across);
        let through = middle + to_center / (2.0 * across.norm_squared());
        let direction = across.try_normalize(0.0)?;
        through.coords.amax().is_finite().then_some(Self { through, direction })
    }

    /// How far along the axis a point is, mm, and the vector from the axis to it, mm.
    fn split(&self, at: &Point3<f64>) -> (f64, Vector3<f64>) {
        let from = at - self.through;
        let along = from.dot(&self.direction);
        (along, from - self.direction * along)
    }

    /// How far along the axis and from it a point is, mm.
    fn place(&self, at: &Point3<f64>) -> [f64; 2] {
        let (along, radial) = self.split(at);
        [along, radial.norm()]
    }

    /// The sine of the angle at which a normal at a point leaves the plane through the axis.
    fn misses(&self, at: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
        let out = self.split(at).1.try_normalize(0.0);
        out.map_or(0.0, |out| self.direction.cross(&out).dot(normal).abs())
    }

    /// The parts of a normal at a point along the axis and away from it.
    fn in_profile(&self, at: &Point3<f64>, normal: &Vector3<f64>) -> [f64; 2] {
        let out = self.split(at).1.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        [normal.dot(&self.direction), normal.dot(&out)]
    }

    /// The unit vector at a point with these parts along the axis and away from it.
    fn in_space(&self, at: &Point3<f64>, [along, out]: [f64; 2]) -> Vector3<f64> {
        let radial = self.split(at).1.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let vector = self.direction * along + radial * out;
        vector.try_normalize(0.0).unwrap_or(vector)
    }

    /// Whether another axis is about the same.
    fn is_like(&self, other: &Self) -> bool {
        let [_, apart] = self.place(&other.through);
        let size = (other.through - self.through).norm().max(1.0);
        self.direction.cross(&other.direction).norm() < SAME_AXIS && apart < SAME_AXIS * size
    }

    /// Moved to where points on rings are nearest to these (Gauss-Newton steps on the distances along and from the axis). Each point
    /// has the number of its ring.
    fn fitted(self, points: &[(usize, Point3<f64>)], rings: usize) -> Option<Self> {
        let (first, second) = cross_directions(&self.direction);
        // For each point the distances with their derivatives by two turns and two shifts of the axis.
        let rows = points.iter().map(|(ring, at)| {
            let (along, radial) = self.split(at);
            let radius = radial.norm();
            let out = radial.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
            let (one, two) = (out.dot(&first), out.dot(&second));
            let by_along = Vector4::new(radius * one, radius * two, 0.0, 0.0);
            let by_radius = -Vector4::new(one * along, two * along, one, two);
            (*ring, [(along, by_along), (radius, by_radius)])
        });
        let rows: Vec<_> = rows.collect();
        let mut means = vec![([(0.0, Vector4::zeros()); 2], 0.0); rings];
        for (ring, row) in &rows {
            let (sums, count) = &mut means[*ring];
            for ((sum, derivatives), (value, by)) in sums.iter_mut().zip(row) {
                *sum += value;
                *derivatives += by;
            }
            *count += 1.0;
        }
        let (mut matrix, mut right) = (Matrix4::zeros(), Vector4::zeros());
        for (ring, row) in &rows {
            let (sums, count) = &means[*ring];
            for ((sum, derivatives), (value, by)) in sums.iter().zip(row) {
                let (off, by) = (value - sum / count, by - derivatives / *count);
                matrix += by * by.transpose();
                right -= by * off;
            }
        }
        let step = matrix.cholesky()?.solve(&right);
        let direction = (self.direction + first * step.x + second * step.y).try_normalize(0.0)?;
        Some(Self { through: self.through + first * step.z + second * step.w, direction })
    }
}

/// The rings of some vertices about an axis.
struct Rings {
    /// For each vertex its ring, or [`NONE`].
    of_vertex: Vec<u32>,
    count: usize,
}

impl Rings {
    /// Those of vertices that are apart by at most `apart`, mm.
    fn about(axis: &Axis, points: &[Point3<f64>], apart: f64) -> Self {
        let places: Vec<[f64; 2]> = points.iter().map(|at| axis.place(at)).collect();
        let place = |vertex: u32, side: usize| places[vertex as usize][side];
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.sort_by(|&one, &other| place(one, 0).total_cmp(&place(other, 0)));
        let (mut of_vertex, mut count) = (vec![NONE; points.len()], 0);
        for level in order.chunk_by_mut(|&one, &other| place(other, 0) - place(one, 0) <= apart) {
            level.sort_by(|&one, &other| place(one, 1).total_cmp(&place(other, 1)));
            for ring in level.chunk_by(|&one, &other| place(other, 1) - place(one, 1) <= apart) {
                let is_narrow = [0, 1].into_iter().all(|side| {
                    let [low, high] = range(ring.iter().map(|&vertex| place(vertex, side)));
                    high - low <= 2.0 * apart
                });
                let is_pole = ring.len() == 1 && place(ring[0], 1) <= apart;
                if is_pole || is_narrow && ring.len() >= LEAST_ON_RING {
                    ring.iter().for_each(|&vertex| of_vertex[vertex as usize] = count);
                    count += 1;
                }
            }
        }
        Self { of_vertex, count: count as usize }
    }

    /// The points on rings, each with the number of its ring.
    fn members(&self, points: &[Point3<f64>]) -> Vec<(usize, Point3<f64>)> {
        let on_rings = self.of_vertex.iter().zip(points).filter(|(ring, _)| **ring != NONE);
        on_rings.map(|(&ring, &at)| (ring as usize, at)).collect()
    }
}

impl RingPlace {
    fn of(axis: &Axis, mesh: &SmoothMesh, ring: &[u32]) -> Self {
        let count = ring.len() as f64;
        let places = || ring.iter().map(|&vertex| axis.place(&mesh.positions[vertex as usize]));
        let sum = places().fold([0.0; 2], |sum, place| [sum[0] + place[0], sum[1] + place[1]]);
        let at = sum.map(|sum| sum / count);
        let squares: f64 =
            places().map(|place| (place[0] - at[0]).powi(2) + (place[1] - at[1]).powi(2)).sum();
        Self { at, deviation: squares.sqrt() / count }
    }
}

/// A face that is turned about an axis.
pub(super) struct Turned<'a> {
    mesh: &'a SmoothMesh,
    axis: Axis,
    profile: Profile,
    /// The place of each vertex in the profile.
    places: BTreeMap<u32, Place>,
    /// In ascending order.
    triangles: Vec<usize>,
}

impl Turned<'_> {
    /// The unit normal of a vertex.
    fn normal(&self, vertex: u32, place: &Place) -> Vector3<f64> {
        self.axis.in_space(&self.mesh.positions[vertex as usize], place.normal_of_profile())
    }

    /// How far the slope of the part may be from that of a triangle's patch with the normals of the profile, rad, and the rings beside
    /// the places of its corners.
    fn doubt(&self, triangle: usize) -> (f32, impl Iterator<Item = usize>) {
        let places = self.mesh.triangles[triangle].map(|vertex| self.places.get(&vertex).copied());
        let doubt = match places {
            [Some(one), Some(two), Some(three)] => OF_TURNED as f32 * self.profile.doubt([one, two, three]),
            _ => 0.0,
        };
        let rings = places.into_iter().flatten().flat_map(|place| self.profile.rings_beside(&place));
        (doubt, rings)
    }

    /// For each ring of the profile, whether that leaves less in doubt there than the facets do, whose doubts about the slope are
    /// `before`, rad.
    fn is_better(&self, before: &[f32]) -> Vec<bool> {
        let mut sums = vec![[0.0; 2]; self.profile.count()];
        for &triangle in &self.triangles {
            let (own, rings) = self.doubt(triangle);
            let doubts = [own, before.get(triangle).copied().unwrap_or(0.0)];
            for ring in rings {
                for (sum, doubt) in sums[ring].iter_mut().zip(doubts) {
                    *sum += f64::from(doubt).powi(2);
                }
            }
        }
        let sums = sums.into_iter().enumerate();
        sums.map(|(ring, [own, of_facets])| self.profile.is_smooth(ring) && own < BETTER * BETTER * of_facets)
            .collect()
    }
}

impl Surface for Turned<'_> {
    fn triangles(&self) -> &[usize] {
        &self.triangles
    }

    fn outward(&self, side: usize) -> Vector3<f64> {
        let corners = self.mesh.triangles[side / 3];
        let ends = [corners[side % 3], corners[(side % 3 + 1) % 3]].into_iter();
        let known = ends.filter_map(|end| Some((end, self.places.get(&end)?)));
        let sum: Vector3<f64> = known.map(|(end, place)| self.normal(end, place)).sum();
        sum.try_normalize(0.0).unwrap_or(sum)
    }

    fn largest_bulge(&self) -> f64 {
        self.triangles.iter().map(|&triangle| self.mesh.bulge(triangle)).fold(0.0, f64::max)
    }
}

/// The normals and doubts that the profiles of turned faces give.
#[derive(Default)]
pub(super) struct Settled {
    /// For each face, its triangles, …
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

/// What the profiles of turned faces show where they leave less in doubt than the facets do, whose doubts about the slope `before`
/// gives, rad. Vertices whose normals are not `estimated` are known, and so are those of the triangles that are `is_known`. Vertices may
/// be off by `near`, mm.
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
    let settled = faces.into_iter().filter_map(|face| {
        let is_better = face.is_better(&before);
        if !is_better.contains(&true) {
            return None;
        }
        let surroundings = surroundings.get_or_insert_with(|| Surroundings::of(mesh, near, fork));
        let is_used =
            |place: &Place| face.profile.rings_beside(place).into_iter().all(|ring| is_better[ring]);
        let used = face.places.iter().filter(|(vertex, place)| is_open[**vertex as usize] && is_used(place));
        let vertices = used.map(|(&vertex, place)| (vertex, face.normal(vertex, place)));
        let doubt = |&triangle: &usize| {
            let (doubt, mut rings) = face.doubt(triangle);
            let most = before.get(triangle).copied().unwrap_or(0.0);
            if rings.any(|ring| is_better[ring]) { doubt.min(most) } else { 0.0 }
        };
        Some(SettledFace {
            vertices: vertices.collect(),
            at_edges: surroundings.at_edges(&face),
            doubts: face.triangles.iter().map(doubt).collect(),
            triangles: face.triangles,
        })
    });
    Settled { faces: settled.collect() }
}

impl Settled {
    /// Replaces the normals that are `estimated`, and their `deviations` by 0: they are as exact as those of a file, and not estimated
    /// any more.
    pub(super) fn settle(&self, mesh: &mut SmoothMesh, estimated: &mut Vec<bool>, deviations: &mut Vec<f64>) {
        let normal_of = |face: &SettledFace, vertex: u32| {
            let index = face.vertices.binary_search_by_key(&vertex, |(vertex, _)| *vertex).ok()?;
            Some(face.vertices[index].1)
        };
        let mut settling = Settling::of(mesh, estimated, deviations);
        let mut settled = Vec::new();
        for face in &self.faces {
            settled
                .extend(settling.set(&face.triangles, &face.at_edges, |_, vertex| normal_of(face, vertex)));
        }
        for vertex in settled {
            estimated[vertex as usize] = false;
            if let Some(deviation) = deviations.get_mut(vertex as usize) {
                *deviation = 0.0;
            }
        }
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
    /// For each triangle the last walk that reached it, …
    last_walk: Vec<u32>,
    /// … of so many.
    walk: u32,
}

impl<'a> Search<'a> {
    fn faces(mesh: &'a SmoothMesh, is_open: &'a [bool], near: f64) -> Vec<Turned<'a>> {
        let count = mesh.triangles.len();
        if count > MOST_TRIANGLES || !is_open.contains(&true) {
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
        };
        let (mut faces, mut seed) = (Vec::new(), first);
        while seed < count && search.visits > 0 {
            if is_seen[seed] || !is_first(seed) {
                seed += 1;
                continue;
            }
            let part = search.reachable(seed, |triangle| !is_seen[triangle]);
            part.iter().for_each(|&triangle| is_seen[triangle] = true);
            let found = search.faces_in(&part);
            if !found.is_empty() {
                // Others may be turned about another axis.
                part.iter().for_each(|&triangle| is_seen[triangle] = false);
                seed = first;
            }
            for face in found {
                face.triangles.iter().for_each(|&triangle| is_seen[triangle] = true);
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

    /// Of some triangles, the most of which all are of a kind and can be reached from each other, in ascending order.
    fn largest_of(&mut self, part: &[usize], is_of_kind: impl Fn(usize) -> bool) -> Vec<usize> {
        let mut is_seen: Vec<bool> = part.iter().map(|&triangle| !is_of_kind(triangle)).collect();
        let mut largest = Vec::new();
        for (index, &seed) in part.iter().enumerate() {
            if is_seen[index] {
                continue;
            }
            let found = self
                .reachable(seed, |triangle| part.binary_search(&triangle).is_ok_and(|index| !is_seen[index]));
            let own = found.iter().filter_map(|triangle| part.binary_search(triangle).ok());
            own.for_each(|index| is_seen[index] = true);
            if found.len() > largest.len() {
                largest = found;
            }
        }
        largest
    }

    /// The faces among some triangles that are turned about one axis.
    fn faces_in(&mut self, part: &[usize]) -> Vec<Turned<'a>> {
        if part.len() < LEAST_TRIANGLES {
            return Vec::new();
        }
        let mut vertices: Vec<u32> =
            part.iter().flat_map(|&triangle| self.mesh.triangles[triangle]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let mut tried: Vec<Axis> = Vec::new();
        for &start in part.iter().step_by(part.len().div_ceil(MOST_STARTS)) {
            for vertex in self.mesh.triangles[start] {
                for axis in self.axes_at(vertex) {
                    if tried.iter().any(|other| other.is_like(&axis)) {
                        continue;
                    }
                    if tried.len() == MOST_AXES || self.visits == 0 {
                        return Vec::new();
                    }
                    tried.push(axis);
                    let faces = self.faces_about(axis, part, &vertices).unwrap_or_default();
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

    /// The faces among some triangles with these vertices that are turned about an axis, one for each profile; `None` if there are no
    /// rings about it.
    fn faces_about(&mut self, mut axis: Axis, part: &[usize], vertices: &[u32]) -> Option<Vec<Turned<'a>>> {
        let mesh = self.mesh;
        self.visits = self.visits.saturating_sub(part.len());
        let points: Vec<Point3<f64>> =
            vertices.iter().map(|&vertex| mesh.positions[vertex as usize]).collect();
        for apart in APART {
            let rings = Rings::about(&axis, &points, apart * self.near);
            let members = rings.members(&points);
            if rings.count < LEAST_RINGS || members.len() < LEAST_RINGS * LEAST_ON_RING {
                return None;
            }
            axis = axis.fitted(&members, rings.count)?;
        }
        let rings = Rings::about(&axis, &points, APART[2] * self.near);
        let mut members: Vec<Vec<u32>> = vec![Vec::new(); rings.count];
        for (&vertex, &ring) in vertices.iter().zip(&rings.of_vertex).filter(|(_, ring)| **ring != NONE) {
            members[ring as usize].push(vertex);
        }
        // A few vertices are at one height by chance, or because the mesh is symmetric.
        let largest = members.iter().map(Vec::len).max()?;
        members.retain(|ring| ring.len() == 1 || ring.len() as f64 > SHORT_RING * largest as f64);
        let places: Vec<RingPlace> = members.iter().map(|ring| RingPlace::of(&axis, mesh, ring)).collect();
        let ring_of: BTreeMap<u32, usize> = members
            .iter()
            .enumerate()
            .flat_map(|(ring, members)| members.iter().map(move |&vertex| (vertex, ring)))
            .collect();
        let mut beside = vec![BTreeSet::new(); places.len()];
        for &triangle in part {
            let own = mesh.triangles[triangle].map(|vertex| ring_of.get(&vertex));
            for pair in [[own[0], own[1]], [own[1], own[2]], [own[2], own[0]]] {
                if let [Some(&one), Some(&other)] = pair
                    && one != other
                {
                    beside[one].insert(other);
                    beside[other].insert(one);
                }
            }
        }
        // A hub that is joined to many rings is on no profile.
        let is_hub: Vec<bool> = beside.iter().map(|others| others.len() > MOST_BESIDE).collect();
        for (ring, others) in beside.iter_mut().enumerate() {
            others.retain(|other| !is_hub[ring] && !is_hub[*other]);
        }
        let points: Vec<[f64; 2]> = places.iter().map(|place| place.at).collect();
        let curves = curves(&points, &beside);
        let faces = curves.into_iter().filter_map(|(order, is_closed)| {
            let members: Vec<&[u32]> = order.iter().map(|&ring| &members[ring][..]).collect();
            let rings: Vec<RingPlace> = order.iter().map(|&ring| places[ring]).collect();
            self.face_along(axis, part, &members, &rings, is_closed)
        });
        Some(faces.collect())
    }

    /// The face among some triangles about an axis whose profile runs through rings in their order, by their vertices and places.
    fn face_along(
        &mut self,
        axis: Axis,
        part: &[usize],
        members: &[&[u32]],
        rings: &[RingPlace],
        is_closed: bool,
    ) -> Option<Turned<'a>> {
        let mesh = self.mesh;
        let is_pole = [0, rings.len() - 1].map(|end| members[end].len() == 1);
        let known = |vertices: &[u32]| {
            let mut known = vertices.iter().filter(|&&vertex| !self.is_open[vertex as usize]);
            let in_space = |&&vertex: &&u32| {
                let (at, normal) = (&mesh.positions[vertex as usize], &mesh.normals[vertex as usize]);
                (axis.misses(at, normal) < EXACT).then(|| axis.in_profile(at, normal))
            };
            known.find_map(|vertex| in_space(&vertex))
        };
        let known: Vec<Option<[f64; 2]>> = members.iter().map(|vertices| known(vertices)).collect();
        let mut profile = Profile::through(rings, is_closed, is_pole)?;
        let outward: f64 = members
            .iter()
            .enumerate()
            .map(|(ring, vertices)| {
                let vertex = vertices[0] as usize;
                let own = axis.in_space(&mesh.positions[vertex], profile.at_ring(ring).normal_of_profile());
                own.dot(&mesh.normals[vertex])
            })
            .sum();
        if outward < 0.0 {
            profile.turn_over();
        }
        profile.set_known(&known);
        let mut places: BTreeMap<u32, Place> = BTreeMap::new();
        for (ring, vertices) in members.iter().enumerate() {
            places.extend(vertices.iter().map(|&vertex| (vertex, profile.at_ring(ring))));
        }
        // Vertices between rings.
        let mut front: Vec<usize> = part.to_vec();
        loop {
            let before = places.len();
            front.retain(|&triangle| {
                let corners = mesh.triangles[triangle];
                let round: Vec<Place> =
                    corners.iter().filter_map(|vertex| places.get(vertex).copied()).collect();
                if round.is_empty() {
                    return true;
                }
                for vertex in
                    corners.into_iter().filter(|vertex| !places.contains_key(vertex)).collect::<Vec<_>>()
                {
                    let at = axis.place(&mesh.positions[vertex as usize]);
                    if let Some(place) = profile.place(&round, at, self.near) {
                        places.insert(vertex, place);
                    }
                }
                false
            });
            self.visits = self.visits.saturating_sub(front.len());
            if places.len() == before || self.visits == 0 {
                break;
            }
        }
        let is_placed =
            |triangle: usize| mesh.triangles[triangle].iter().all(|vertex| places.contains_key(vertex));
        let triangles = self.largest_of(part, is_placed);
        if triangles.len() < LEAST_TRIANGLES {
            return None;
        }
        let mut is_used: Vec<u32> = triangles.iter().flat_map(|&triangle| mesh.triangles[triangle]).collect();
        is_used.sort_unstable();
        places.retain(|vertex, _| is_used.binary_search(vertex).is_ok());
        Some(Turned { mesh, axis, profile, places, triangles })
    }
}

/// The pieces of a curve through points between places where it bends by more than [`MOST_BEND`] from one chord to the next.
fn smooth_pieces(points: &[[f64; 2]], mut order: Vec<usize>, is_closed: bool) -> Vec<(Vec<usize>, bool)> {
    let is_corner = |order: &[usize], at: usize| {
        let count = order.len();
        let [before, here, after] = [at + count - 1, at, at + 1].map(|at| points[order[at % count]]);
        let chord = |from: [f64; 2], to: [f64; 2]| Vector2::new(to[0] - from[0], to[1] - from[1]);
        chord(before, here).angle(&chord(here, after)) > MOST_BEND
    };
    if is_closed {
        let Some(corner) = (0..order.len()).find(|&at| is_corner(&order, at)) else {
            return vec![(order, true)];
        };
        order.rotate_left(corner);
        order.push(order[0]);
    }
    let mut pieces = Vec::new();
    let mut first = 0;
    for at in 1..order.len() {
        if at + 1 == order.len() || is_corner(&order, at) {
            pieces.push((order[first..=at].to_vec(), false));
            first = at;
        }
    }
    pieces
}

/// The curves on which points are that follow each other, each in its order, and whether it is closed. Of the points `beside` one and
/// beside these, those follow it to which no other is nearer than both are to each other (Toussaint, The relative neighbourhood graph of
/// a finite planar set, 1980). Where more than two follow, they are on no curve.
fn curves(points: &[[f64; 2]], beside: &[BTreeSet<usize>]) -> Vec<(Vec<usize>, bool)> {
    let apart = |one: usize, other: usize| {
        (points[one][0] - points[other][0]).hypot(points[one][1] - points[other][1])
    };
    let near: Vec<BTreeSet<usize>> = (0..points.len())
        .map(|one| {
            let second = beside[one].iter().flat_map(|&other| beside[other].iter().copied());
            beside[one].iter().copied().chain(second).filter(|other| *other != one).collect()
        })
        .collect();
    let next: Vec<Vec<usize>> = (0..points.len())
        .map(|one| {
            let is_next = |&other: &usize| {
                let length = apart(one, other);
                let is_between = |&point: &usize| apart(one, point) < length && apart(point, other) < length;
                !near[one].iter().chain(&near[other]).any(is_between)
            };
            near[one].iter().copied().filter(is_next).collect()
        })
        .collect();
    let mut is_seen = vec![false; points.len()];
    let mut curves = Vec::new();
    // Those with ends first; the others are closed.
    for ends in [1, 2] {
        for first in 0..points.len() {
            if is_seen[first] || next[first].len() != ends {
                continue;
            }
            is_seen[first] = true;
            let (mut order, mut here) = (vec![first], next[first][0]);
            while !is_seen[here] && next[here].len() <= 2 {
                is_seen[here] = true;
                order.push(here);
                let onward =
                    next[here].iter().copied().find(|&point| !is_seen[point] && next[point].len() <= 2);
                here = onward.unwrap_or(here);
            }
            let own: BTreeSet<usize> = order.iter().copied().collect();
            let others = order.iter().flat_map(|&point| &beside[point]);
            let of_other_curves = others.clone().filter(|other| !own.contains(other)).count();
            if of_other_curves as f64 <= MOST_OF_OTHERS * others.count() as f64 {
                let is_closed = ends == 2 && next[here].contains(&first);
                let pieces = smooth_pieces(points, order, is_closed).into_iter();
                curves.extend(pieces.filter(|(order, _)| order.len() >= LEAST_RINGS));
            }
        }
    }
    curves
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::*;
    use crate::geometry::fork::InTurn;
    use crate::geometry::mesh::TriMesh;
    use crate::geometry::space::{Facing, View};

    const SECTORS: u32 = 36;

    /// A face turned about the y axis with these rings of [along the axis, radius]: vertices of every second ring are between those of
    /// the others, as programs set them, so that sides along the profile skip a ring.
    fn staggered(rings: &[[f64; 2]]) -> TriMesh {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for (number, &[along, radius]) in rings.iter().enumerate() {
            for sector in 0..SECTORS {
                let angle = TAU * (f64::from(sector) + (number % 2) as f64 / 2.0) / f64::from(SECTORS);
                positions.push(Point3::new(radius * angle.sin(), along, radius * angle.cos()));
            }
        }
        for first in (0..rings.len() as u32 - 2).step_by(2) {
            for sector in 0..SECTORS {
                let next = (sector + 1) % SECTORS;
                let at = |ring: u32, sector: u32| (first + ring) * SECTORS + sector;
                let around = [at(0, sector), at(2, sector), at(2, next), at(0, next)];
                triangles.extend((0..4).map(|side| [at(1, sector), around[side], around[(side + 1) % 4]]));
            }
        }
        TriMesh::new(positions, Vec::new(), triangles).unwrap()
    }

    /// The rings of a bracelet with an elliptic profile, cut unevenly, and its normal there.
    fn bracelet(count: usize) -> Vec<[f64; 2]> {
        let angle = |ring: usize| {
            0.12 * PI + 0.76 * PI * (ring as f64 + 0.3 * (2.1 * ring as f64).sin()) / (count as f64 - 1.0)
        };
        (0..count).map(|ring| [7.2 * angle(ring).cos(), 32.75 + 1.7 * angle(ring).sin()]).collect()
    }

    fn normal_of_bracelet(at: &Point3<f64>) -> Vector3<f64> {
        let radius = at.x.hypot(at.z);
        let out = (radius - 32.75) / (1.7 * 1.7);
        Vector3::new(out * at.x / radius, at.y / (7.2 * 7.2), out * at.z / radius).normalize()
    }

    #[test]
    fn the_rings_of_a_bracelet_show_its_profile() {
        let mesh = SmoothMesh::new(&staggered(&bracelet(17)), &View::top());
        let (mut error, mut largest_doubt): (f64, f32) = (0.0, 0.0);
        for triangle in 0..mesh.triangles.len() {
            let (corners, normals) = mesh.corners(triangle);
            if corners.iter().any(|at| at.y.abs() > 4.0 || at.z < 10.0) {
                continue;
            }
            for (at, normal) in corners.iter().zip(normals) {
                error = error.max(normal.angle(&normal_of_bracelet(at)));
            }
            largest_doubt = largest_doubt.max(mesh.slope_doubts[triangle]);
        }
        // The profile turns by 0.1 rad from one ring to the next.
        assert!(error < 0.002, "{error} rad");
        assert!(
            (0.5 * error..0.01).contains(&f64::from(largest_doubt)),
            "{largest_doubt} rad for {error} rad"
        );
    }

    #[test]
    fn faces_are_turned_about_any_axis() {
        let oblique = Facing::towards(Vector3::new(0.3, 0.8, 0.5)).unwrap();
        for view in [View::top(), View::new(oblique, 0.4)] {
            let mesh = SmoothMesh::new(&staggered(&bracelet(17)), &view);
            let estimated = vec![true; mesh.positions.len()];
            let faces = Search::faces(&mesh, &estimated, 1e-4);
            assert_eq!(faces.len(), 1);
            assert_eq!(faces[0].triangles.len(), mesh.triangles.len());
            let axis = view.vector(Vector3::y());
            assert!(faces[0].axis.direction.cross(&axis).norm() < 1e-6);
        }
    }

    #[test]
    fn vertices_near_the_first_ring_of_a_closed_profile_are_beside_its_rings() {
        const COUNT: usize = 24;
        let ring = |at: f64| {
            let angle = TAU * at / COUNT as f64;
            [7.2 * angle.cos(), 32.75 + 1.7 * angle.sin()]
        };
        let rings: Vec<RingPlace> =
            (0..COUNT).map(|number| RingPlace { at: ring(number as f64), deviation: 0.0 }).collect();
        let profile = Profile::through(&rings, true, [false; 2]).unwrap();
        let mut count = 0;
        for number in 0..COUNT {
            for step in [-1e-3, -1e-5, 0.0, 1e-5, 1e-3] {
                let [along, radius] = ring(number as f64 + step);
                let off = 1.0 + 1e-5;
                let at = [along * off, 32.75 + (radius - 32.75) * off];
                let Some(place) = profile.place(&[profile.at_ring(number)], at, 1e-3) else { continue };
                let before = (number + COUNT - 1) % COUNT;
                let near = [before, number, (number + 1) % COUNT];
                assert!(
                    profile.rings_beside(&place).iter().all(|ring| near.contains(ring)),
                    "{number} {step}"
                );
                count += 1;
            }
        }
        assert_eq!(count, 5 * COUNT);
    }

    #[test]
    fn a_square_cushion_is_not_turned() {
        const STEPS: i32 = 12;
        let height = |x: f64, y: f64| 12.0 - (x.powi(4) + y.powi(4)) / 5e3;
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for row in -STEPS..=STEPS {
            for column in -STEPS..=STEPS {
                let (x, y) = (f64::from(column), f64::from(row));
                positions.push(Point3::new(x, y, height(x, y)));
                if row > -STEPS && column > -STEPS {
                    let d = positions.len() as u32 - 1;
                    let [a, b, c] = [d - 2 * STEPS as u32 - 2, d - 2 * STEPS as u32 - 1, d - 1];
                    triangles.extend([[a, b, d], [a, d, c]]);
                }
            }
        }
        let mesh = SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top());
        let estimated = vec![true; mesh.positions.len()];
        assert!(Search::faces(&mesh, &estimated, 1e-4).is_empty());
    }

    #[test]
    fn where_the_facets_show_as_much_nothing_changes() {
        let mut mesh = SmoothMesh::new(&staggered(&bracelet(17)), &View::top());
        let before = mesh.clone();
        let mut estimated = vec![true; mesh.positions.len()];
        let without_doubt = || vec![0.0; before.triangles.len()];
        let found = found(&before, &estimated, &[], 1e-4, without_doubt, &InTurn);
        found.settle(&mut mesh, &mut estimated, &mut Vec::new());
        assert_eq!(mesh, before);
        assert!(!estimated.contains(&false));
    }
}
