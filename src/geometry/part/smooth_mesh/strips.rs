//! Normals and doubts of extruded strips, for example of the round side of an oval can, from the strip alone.
//!
//! All facets of an extruded strip contain one direction, that of its rulings. The facets beyond its ends
//! disturb what its vertices show of the plane curve across them: the vertices of a fillet follow each other
//! in uneven steps. If these facets confirm that the strip ends there (`ends`), it is estimated as if it had
//! no neighbours, and its normals are at right angles to its rulings.

use std::collections::{BTreeSet, VecDeque};

use nalgebra::{Point3, Vector3};

use super::curve_strip::CurveStrip;
use super::ends::{Ruled, Surface, Surroundings, precision, range};
use super::free_outlines;
use super::hidden_arcs::HiddenArc;
use super::settling::{Estimates, Settling};
use super::{MOST_SEARCHED, SmoothMesh};
use crate::geometry::adjacency::{NONE, Neighbours, facet_normal};
use crate::geometry::disjoint_sets::DisjointSets;
use crate::geometry::fork::{Fork, found, look_ahead};

/// Sides are parallel only if their ends are off by at most this many times the tolerance of a vertex
/// (`near`). [`CONTAINS`] limits their angle as well.
const OFF: f64 = 4.0;
/// Parallel sides lean by at most this from each other, rad. Facets contain the rulings if the angle between
/// their normals and the rulings differs from a right angle by less than this, rad.
const CONTAINS: f64 = 1e-3;
/// At least this many parallel rulings in a row show a strip. Any two facets that meet have one ruling, but
/// this many in a row are not parallel by chance.
const LEAST_RULINGS: usize = 5;
/// Facets that turn by less than this between two rulings, rad, show nothing: on fine meshes, neighbouring
/// sides are parallel.
const LEAST_TURN: f64 = 0.02;
/// Facets that turn by less than this, rad, are in one plane.
const COPLANAR: f64 = 1e-3;
/// At most this many facets are looked at on either side of a first ruling.
const MOST_STEPS: usize = 6 * LEAST_RULINGS;
/// At most this many facets are looked at for all rulings together.
const MOST_STEPS_IN_ALL: usize = 1_000_000;
/// At most this many triangles are looked at for all strips together. Strips of more triangles are fine, and
/// their neighbours are enough to estimate their normals well.
const MOST_VISITS: usize = 20_000;

/// Replaces estimated normals at the vertices of extruded strips; `is_round` are the triangles
/// whose normals are known. Returns the doubts of the slopes of the strips' triangles, rad; `hidden` are the arcs that edges
/// may be.
pub(super) fn settle(
    mesh: &mut SmoothMesh,
    estimates: &mut Estimates,
    is_round: &[bool],
    hidden: &[HiddenArc],
    fork: &dyn Fork,
) -> Vec<(usize, f32)> {
    let strips = certain_strips(mesh, &estimates.is_estimated, is_round, hidden, fork);
    if strips.is_empty() {
        return Vec::new();
    }
    let mut is_known = vec![false; mesh.positions.len()];
    for (corners, _) in mesh.triangles.iter().zip(is_round).filter(|(_, is_round)| **is_round) {
        corners.iter().for_each(|&vertex| is_known[vertex as usize] = true);
    }
    let mut settling = Settling::of(mesh, estimates);
    let mut doubts = Vec::new();
    for strip in strips {
        let normal = |_: &SmoothMesh, vertex: u32| {
            let is_open = is_known.get(vertex as usize) == Some(&false);
            let index = strip.vertices.binary_search(&vertex).ok().filter(|_| is_open)?;
            Some(strip.normals[index])
        };
        settling.set(&strip.triangles, &strip.at_edges, normal);
        doubts.extend(strip.triangles.into_iter().zip(strip.doubts));
    }
    doubts
}

/// What a strip shows by itself.
struct Settled {
    triangles: Vec<usize>,
    /// In ascending order, with their normals.
    vertices: Vec<u32>,
    normals: Vec<Vector3<f64>>,
    at_edges: Vec<u32>,
    /// For each triangle, rad.
    doubts: Vec<f32>,
}

impl Settled {
    fn along_curve(strip: &CurveStrip, axis: Vector3<f64>, at_edges: Vec<u32>, hidden: &[HiddenArc]) -> Self {
        let triangles = strip.triangles().to_vec();
        let (vertices, normals) = strip.normals();
        let mut doubts = strip.doubts();
        for arc in hidden.iter().filter(|arc| arc.edge.cross(&axis).norm() < CONTAINS) {
            if let Ok(index) = triangles.binary_search(&arc.triangle) {
                doubts[index] = doubts[index].max(arc.doubt as f32);
            }
        }
        Self { triangles, vertices, normals, at_edges, doubts }
    }
}

fn certain_strips(
    mesh: &SmoothMesh,
    estimated: &[bool],
    is_round: &[bool],
    hidden: &[HiddenArc],
    fork: &dyn Fork,
) -> Vec<Settled> {
    let count = mesh.triangles.len();
    if count > MOST_SEARCHED || !estimated.contains(&true) {
        return Vec::new();
    }
    let (mut surroundings, mut around) = (None, None);
    let search = Search { mesh, near: precision(mesh), steps: MOST_STEPS_IN_ALL, visits: MOST_VISITS };
    let mut curve_visits = MOST_VISITS;
    let is_estimated =
        |triangle: usize| mesh.triangles[triangle].iter().all(|&vertex| estimated[vertex as usize]);
    let open = found(fork, count, |triangle| {
        let is_open = mesh.triangles[triangle].iter().any(|&vertex| estimated[vertex as usize]);
        let is_round = is_round.get(triangle) == Some(&true);
        (!is_round && is_open && mesh.bulges(triangle)).then_some(triangle)
    });
    let mut strips = Vec::new();
    look_ahead(
        fork,
        &open,
        &mut (search, vec![false; count]),
        |(_, is_seen), triangle| !is_seen[triangle],
        |(search, _), triangle| search.ruling_at(triangle),
        |(search, is_seen), triangle, (ruling, steps)| {
            search.steps = search.steps.saturating_sub(steps);
            let found = ruling.map(|ruling| search.strip_at(triangle, ruling));
            if search.visits == 0 || search.steps == 0 {
                return false;
            }
            let Some((axis, triangles)) = found else { return true };
            triangles.iter().for_each(|&triangle| is_seen[triangle] = true);
            let surroundings = surroundings.get_or_insert_with(|| Surroundings::of(mesh, search.near, fork));
            // By itself already.
            if surroundings.ends(&triangles).is_empty() {
                return true;
            }
            let is_ruling = |side: usize| search.is_parallel(side, axis);
            let curved = CurveStrip::of(mesh, axis, &triangles, is_ruling, search.near, &mut curve_visits);
            if let Some(strip) = curved
                && strip.triangles().iter().all(|&triangle| is_estimated(triangle))
                && surroundings.confirm(&strip, &mut around)
            {
                strip.triangles().iter().for_each(|&triangle| is_seen[triangle] = true);
                strips.push(Settled::along_curve(&strip, axis, surroundings.at_edges(&strip), hidden));
                return true;
            }
            let (strip, estimates) = Strip::of(mesh, axis, triangles, estimated, is_round, fork);
            if !surroundings.confirm(&strip, &mut around) {
                return true;
            }
            // Across its rulings, the ends are confirmed.
            let own = |arc: &HiddenArc| {
                let triangle = strip.triangles.binary_search(&arc.triangle).ok()?;
                (arc.edge.cross(&axis).norm() < CONTAINS).then_some(HiddenArc { triangle, ..*arc })
            };
            let hidden: Vec<HiddenArc> = hidden.iter().filter_map(own).collect();
            let mut doubts = strip.alone.found_slope_doubts(&estimates, &hidden, fork);
            doubts.resize(strip.triangles.len(), 0.0);
            let at_edges = surroundings.at_edges(&strip);
            let Strip { triangles, vertices, alone, .. } = strip;
            strips.push(Settled { triangles, vertices, normals: alone.normals, at_edges, doubts });
            true
        },
    );
    let is_open = |triangle: usize| is_round.get(triangle) != Some(&true) && is_estimated(triangle);
    let mut is_open: Vec<bool> = (0..count).map(is_open).collect();
    strips.iter().flat_map(|strip| &strip.triangles).for_each(|&triangle| is_open[triangle] = false);
    for (strip, axis, doubt) in free_outlines::found(mesh, &is_open, precision(mesh)) {
        let surroundings = surroundings.get_or_insert_with(|| Surroundings::of(mesh, precision(mesh), fork));
        let mut settled = Settled::along_curve(&strip, axis, surroundings.at_edges(&strip), hidden);
        settled.doubts.iter_mut().for_each(|own| *own = own.hypot(doubt));
        strips.push(settled);
    }
    strips
}

struct Search<'a> {
    mesh: &'a SmoothMesh,
    /// Vertices are off by at most this, mm.
    near: f64,
    /// How many facets may still be looked at for rulings.
    steps: usize,
    /// How many triangles may still be looked at for strips.
    visits: usize,
}

impl Search<'_> {
    /// The direction of a ruling beside a triangle, if there is one, and the number of facets that were looked at.
    fn ruling_at(&self, triangle: usize) -> (Option<Vector3<f64>>, usize) {
        let mut steps = 0;
        let ruling = (3 * triangle..3 * triangle + 3).find_map(|side| {
            let direction = self.direction(side)?;
            (self.rulings_round(side, direction, &mut steps) >= LEAST_RULINGS).then_some(direction)
        });
        (ruling, steps)
    }

    /// The mean direction of the rulings and the triangles, in ascending order, of the strip of a triangle.
    fn strip_at(&mut self, triangle: usize, ruling: Vector3<f64>) -> (Vector3<f64>, Vec<usize>) {
        let found = self.grown(triangle, ruling);
        let axis = self.mean_ruling(&found, ruling);
        let mut triangles = self.grown(triangle, axis);
        triangles.sort_unstable();
        self.trim(&mut triangles, axis);
        (axis, triangles)
    }

    /// Removes the triangles, given in ascending order, that reach farther along the rulings than any of
    /// these: a facet of a fillet may continue one of the strip by chance. A needle of a plane polygon is not
    /// a facet of the strip if most of it reaches farther.
    fn trim(&self, triangles: &mut Vec<usize>, axis: Vector3<f64>) {
        let along = |point: &Point3<f64>| point.coords.dot(&axis);
        let sides = triangles.iter().flat_map(|&triangle| 3 * triangle..3 * triangle + 3);
        let rulings = sides.filter(|&side| self.is_parallel(side, axis));
        let [low, high] = range(rulings.flat_map(|side| self.mesh.ends(side)).map(|end| along(&end)));
        let is_within = |&triangle: &usize| {
            let corners = self.mesh.corners(triangle).0;
            corners.iter().all(|end| (low - self.near..=high + self.near).contains(&along(end)))
        };
        if triangles.iter().all(is_within) {
            return;
        }
        let mut planes = DisjointSets::new(triangles.len());
        for (index, &triangle) in triangles.iter().enumerate() {
            for other in (3 * triangle..3 * triangle + 3).filter_map(|side| self.mesh.continuing(side)) {
                let Ok(there) = triangles.binary_search(&(other / 3)) else { continue };
                if there > index && self.normal(triangle).cross(&self.normal(other / 3)).norm() < COPLANAR {
                    planes.join(index, there);
                }
            }
        }
        let (of_plane, count) = planes.numbered();
        let mut within = vec![0.0; count];
        for (triangle, &plane) in triangles.iter().zip(&of_plane) {
            let [a, b, c] = self.mesh.corners(*triangle).0;
            let area = (b - a).cross(&(c - a)).norm();
            within[plane as usize] += if is_within(triangle) { area } else { -area };
        }
        let mut planes = of_plane.into_iter();
        triangles.retain(|triangle| {
            planes.next().is_some_and(|plane| is_within(triangle) && within[plane as usize] > 0.0)
        });
    }

    fn direction(&self, side: usize) -> Option<Vector3<f64>> {
        let [from, to] = self.mesh.ends(side);
        (to - from).try_normalize(0.0)
    }

    fn is_parallel(&self, side: usize, direction: Vector3<f64>) -> bool {
        let [from, to] = self.mesh.ends(side);
        let chord = to - from;
        let off = chord.cross(&direction).norm_squared();
        off <= (OFF * self.near).powi(2) && off <= CONTAINS.powi(2) * chord.norm_squared()
    }

    /// The number of parallel sides in a row, from a first one on, between which the facets turn; no more than are needed. The
    /// facets that are looked at are added to `steps`.
    fn rulings_round(&self, first: usize, direction: Vector3<f64>, steps: &mut usize) -> usize {
        let entered = self.mesh.continued[first];
        if entered == NONE {
            return 0;
        }
        let mut count = 1;
        for start in [first, entered as usize] {
            let (mut side, mut last) = (start, self.normal(start / 3));
            for _ in 0..MOST_STEPS {
                *steps += 1;
                // A facet between two rulings is divided by its diagonal.
                let others = [1, 2].map(|turn| side / 3 * 3 + (side % 3 + turn) % 3);
                let next = others.into_iter().find(|&other| {
                    let beyond = self.mesh.continued[other] as usize;
                    self.mesh.continued[other] != NONE
                        && (self.is_parallel(other, direction)
                            || (0..3).any(|turn| self.is_parallel(beyond / 3 * 3 + turn, direction)))
                });
                let Some(next) = next else { break };
                side = self.mesh.continued[next] as usize;
                let normal = self.normal(side / 3);
                if self.is_parallel(side, direction) && normal.cross(&last).norm() > LEAST_TURN {
                    count += 1;
                    last = normal;
                }
                if count >= LEAST_RULINGS {
                    return count;
                }
            }
        }
        count
    }

    fn normal(&self, triangle: usize) -> Vector3<f64> {
        facet_normal(self.mesh.corners(triangle).0)
    }

    /// The triangles that contain a direction and can be reached from one of them through others.
    fn grown(&mut self, from: usize, direction: Vector3<f64>) -> Vec<usize> {
        let mesh = self.mesh;
        let mut is_found = BTreeSet::from([from]);
        let mut front = VecDeque::from([from]);
        let mut found = Vec::new();
        while let Some(here) = front.pop_front() {
            found.push(here);
            for side in 3 * here..3 * here + 3 {
                let Some(other) = mesh.continuing(side) else { continue };
                let there = other / 3;
                if self.visits == 0 || is_found.contains(&there) {
                    continue;
                }
                self.visits -= 1;
                if self.contains(there, direction, self.normal(here)) {
                    is_found.insert(there);
                    front.push_back(there);
                }
            }
        }
        found
    }

    /// Whether a triangle belongs to a strip; `beside` is the normal of a triangle of the strip beside it.
    fn contains(&self, triangle: usize, direction: Vector3<f64>, beside: Vector3<f64>) -> bool {
        let normal = self.normal(triangle);
        normal.dot(&direction).abs() < CONTAINS
            && (normal.cross(&beside).norm() < COPLANAR
                || (0..3).any(|side| self.is_parallel(3 * triangle + side, direction)))
    }

    /// The mean direction of the sides of some triangles that are parallel to one.
    fn mean_ruling(&self, triangles: &[usize], direction: Vector3<f64>) -> Vector3<f64> {
        let sides = triangles.iter().flat_map(|&triangle| 3 * triangle..3 * triangle + 3);
        let rulings = sides.filter(|&side| self.is_parallel(side, direction));
        let sum: Vector3<f64> = rulings
            .map(|side| {
                let [from, to] = self.mesh.ends(side);
                (to - from) * (to - from).dot(&direction).signum()
            })
            .sum();
        sum.try_normalize(0.0).unwrap_or(direction)
    }
}

/// A strip as a mesh by itself.
struct Strip<'a> {
    mesh: &'a SmoothMesh,
    axis: Vector3<f64>,
    /// In ascending order.
    triangles: Vec<usize>,
    /// Those of the strip's own vertices in the mesh, in ascending order.
    vertices: Vec<u32>,
    alone: SmoothMesh,
    around: Neighbours,
}

impl<'a> Strip<'a> {
    /// With the normals that it shows by itself; for each of its vertices, whether the normal is estimated and its deviation, rad.
    fn of(
        mesh: &'a SmoothMesh,
        axis: Vector3<f64>,
        triangles: Vec<usize>,
        estimated: &[bool],
        is_round: &[bool],
        fork: &dyn Fork,
    ) -> (Self, Estimates) {
        let mut vertices: Vec<u32> =
            triangles.iter().flat_map(|&triangle| mesh.triangles[triangle]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let index = |vertex: u32| vertices.binary_search(&vertex).unwrap_or_default();
        let mut is_known: Vec<bool> = vertices.iter().map(|&vertex| !estimated[vertex as usize]).collect();
        for &triangle in triangles.iter().filter(|&&triangle| is_round.get(triangle) == Some(&true)) {
            mesh.triangles[triangle].iter().for_each(|&vertex| is_known[index(vertex)] = true);
        }
        let normal = |(&vertex, &is_known): (&u32, &bool)| match is_known {
            true => mesh.normals[vertex as usize],
            false => Vector3::zeros(),
        };
        let continued = |side: usize| {
            let other = mesh.continuing(side)?;
            let triangle = triangles.binary_search(&(other / 3)).ok()?;
            Some((3 * triangle + other % 3) as u32)
        };
        let sides = triangles.iter().flat_map(|&triangle| 3 * triangle..3 * triangle + 3);
        let mut alone = SmoothMesh {
            positions: vertices.iter().map(|&vertex| mesh.positions[vertex as usize]).collect(),
            normals: vertices.iter().zip(&is_known).map(normal).collect(),
            triangles: triangles
                .iter()
                .map(|&triangle| mesh.triangles[triangle].map(|vertex| index(vertex) as u32))
                .collect(),
            regions: vec![0; triangles.len()],
            continued: sides.map(|side| continued(side).unwrap_or(NONE)).collect(),
            rounding: mesh.rounding,
            ..SmoothMesh::default()
        };
        let estimates = alone.complete_normals(fork);
        for normal in alone
            .normals
            .iter_mut()
            .zip(&estimates.is_estimated)
            .filter_map(|(normal, missing)| missing.then_some(normal))
        {
            let across = *normal - axis * normal.dot(&axis);
            *normal = across.try_normalize(0.0).unwrap_or(*normal);
        }
        let around = Neighbours::of(&alone.triangles, alone.positions.len());
        (Self { mesh, axis, triangles, vertices, alone, around }, estimates)
    }

    /// The vertices of the strip at the ends of a side of the mesh.
    fn ends_of(&self, side: usize) -> impl Iterator<Item = u32> {
        let corners = self.mesh.triangles[side / 3];
        let ends = [corners[side % 3], corners[(side % 3 + 1) % 3]];
        ends.map(|end| self.vertices.binary_search(&end).ok().map(|index| index as u32)).into_iter().flatten()
    }

    /// The distance of a point from the plane curve over the chord between two vertices, mm, and how far it is beyond the ends of
    /// the chord; `None` for a ruling.
    fn distance_from(&self, [one, other]: [u32; 2], at: &Point3<f64>) -> Option<(f64, f64)> {
        let across = |vector: Vector3<f64>| vector - self.axis * vector.dot(&self.axis);
        let position = |vertex: u32| self.alone.positions[vertex as usize];
        let chord = across(position(other) - position(one));
        let length = chord.norm();
        let along = chord.try_normalize(CONTAINS * (position(other) - position(one)).norm())?;
        let up = self.axis.cross(&along);
        let step = at - position(one);
        let share = step.dot(&along) / length;
        // The slopes of the curve at both ends, over the share of the chord.
        let [first, last] = [one, other].map(|vertex| {
            let normal = self.alone.normals[vertex as usize];
            -length * normal.dot(&along) / normal.dot(&up)
        });
        let height = share * (1.0 - share).powi(2) * first - share.powi(2) * (1.0 - share) * last;
        let beyond = (-share).max(share - 1.0).max(0.0) * length;
        height.is_finite().then(|| ((step.dot(&up) - height).abs(), beyond))
    }
}

impl Surface for Strip<'_> {
    fn triangles(&self) -> &[usize] {
        &self.triangles
    }

    fn outward(&self, side: usize) -> Vector3<f64> {
        let sum: Vector3<f64> = self.ends_of(side).map(|vertex| self.alone.normals[vertex as usize]).sum();
        sum.try_normalize(0.0).unwrap_or(sum)
    }

    fn largest_bulge(&self) -> f64 {
        (0..self.alone.triangles.len()).map(|triangle| self.alone.bulge(triangle)).fold(0.0, f64::max)
    }
}

impl Ruled for Strip<'_> {
    fn ruling(&self, _: &Point3<f64>) -> Vector3<f64> {
        self.axis
    }

    fn distance(&self, side: usize, at: &Point3<f64>) -> f64 {
        let ring = |vertex: u32| self.around.of_vertex(vertex as usize).iter().copied();
        let mut near: Vec<u32> = self.ends_of(side).flat_map(|end| ring(end).flat_map(ring)).collect();
        near.sort_unstable();
        near.dedup();
        let chords = near.into_iter().flat_map(|vertex| ring(vertex).map(move |other| [vertex, other]));
        let distances = chords.filter_map(|chord| self.distance_from(chord, at));
        let squared = |(distance, beside): &(f64, f64)| distance * distance + beside * beside;
        let nearest = distances.min_by(|one, other| squared(one).total_cmp(&squared(other)));
        nearest.map_or(0.0, |(distance, _)| distance)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::geometry::mesh::TriMesh;
    use crate::geometry::space::View;

    const HALF_AXES: [f64; 2] = [30.0, 16.0];

    /// A ring at a height, of the ellipse or of its parallel curve so far inside.
    struct Ring {
        angles: Vec<f64>,
        inside: f64,
        height: f64,
    }

    impl Ring {
        fn at(&self, angle: f64) -> Point3<f64> {
            let [a, b] = HALF_AXES;
            let on = Point3::new(a * angle.cos(), b * angle.sin(), self.height);
            on - normal_of_ellipse(&on) * self.inside
        }
    }

    fn normal_of_ellipse(at: &Point3<f64>) -> Vector3<f64> {
        let [a, b] = HALF_AXES;
        Vector3::new(at.x / (a * a), at.y / (b * b), 0.0).normalize()
    }

    /// The facets between rings, from the lowest to the highest.
    fn between(rings: &[Ring]) -> SmoothMesh {
        let (mut positions, mut triangles, mut starts) = (Vec::new(), Vec::new(), Vec::new());
        for ring in rings {
            starts.push(positions.len() as u32);
            positions.extend(ring.angles.iter().map(|&angle| ring.at(angle)));
        }
        for (pair, start) in rings.windows(2).zip(starts.windows(2)) {
            let (low, high) = (&pair[0].angles, &pair[1].angles);
            let (mut i, mut j) = (0, 0);
            while i + 1 < low.len() || j + 1 < high.len() {
                let (one, other) = (start[0] + i as u32, start[1] + j as u32);
                if j + 1 == high.len() || (i + 1 < low.len() && low[i + 1] <= high[j + 1]) {
                    triangles.push([one, one + 1, other]);
                    i += 1;
                } else {
                    triangles.push([one, other + 1, other]);
                    j += 1;
                }
            }
        }
        let all = TriMesh::new(positions, Vec::new(), triangles).unwrap();
        SmoothMesh::new(&all, &View::top())
    }

    fn even(steps: usize) -> Vec<f64> {
        (0..=steps).map(|step| 3.0 * step as f64 / steps as f64).collect()
    }

    /// As even steps, but for the inner ones, which are moved by up to a third of a step.
    fn uneven(steps: usize, seed: usize) -> Vec<f64> {
        let moved = |step: usize| {
            let by = ((step * 7 + seed * 5) % 11) as f64 / 11.0 - 0.5;
            if step == 0 || step == steps { 0.0 } else { 0.66 * by }
        };
        (0..=steps).map(|step| 3.0 * (step as f64 + moved(step)) / steps as f64).collect()
    }

    /// An oval can with fillets, whose rings are cut at other angles than the rims of its side.
    fn filleted(fillet: f64, chords: usize, steps: usize) -> SmoothMesh {
        let of_fillet = |end: f64| {
            (1..=chords).map(move |ring| {
                let turn = ring as f64 / chords as f64 * std::f64::consts::FRAC_PI_2;
                let (inside, height) = (fillet * (1.0 - turn.cos()), end * (25.0 + fillet * turn.sin()));
                Ring { angles: uneven(steps + ring, ring), inside, height }
            })
        };
        let mut rings: Vec<Ring> = of_fillet(-1.0).collect();
        rings.reverse();
        let rim = |height: f64| Ring { angles: even(steps), inside: 0.0, height };
        rings.push(rim(-25.0));
        rings.push(rim(25.0));
        rings.extend(of_fillet(1.0));
        between(&rings)
    }

    /// The largest angle between the normals of the side and those of the ellipse, rad, and the largest doubt there.
    fn errors(can: &SmoothMesh) -> [f64; 2] {
        let (mut error, mut doubt, mut count) = (0.0f64, 0.0f64, 0);
        for triangle in 0..can.triangles.len() {
            let (corners, normals) = can.corners(triangle);
            if corners.iter().any(|at| at.z.abs() > 25.0 + 1e-9) {
                continue;
            }
            count += 1;
            doubt = doubt.max(can.slope_doubts.get(triangle).copied().unwrap_or(0.0).into());
            for (at, normal) in corners.iter().zip(normals) {
                assert!(normal.z.abs() < 1e-6, "{at}: {normal:?}");
                // At the two ends of the arc, the vertices are on one side only.
                if (0.3..2.7).contains(&(at.y / HALF_AXES[1]).atan2(at.x / HALF_AXES[0])) {
                    error = error.max(normal.angle(&normal_of_ellipse(at)));
                }
            }
        }
        assert!(count > 0);
        [error, doubt]
    }

    #[test]
    fn fillets_do_not_disturb_the_side_of_an_oval() {
        for (fillet, chords, steps) in [(0.5, 3, 40), (1.0, 4, 30), (2.0, 8, 60), (4.0, 6, 30)] {
            let alone =
                between(&[-25.0, 25.0].map(|height| Ring { angles: even(steps), inside: 0.0, height }));
            let ([error, doubt], by_itself) = (errors(&filleted(fillet, chords, steps)), errors(&alone));
            let turn = 3.0 / steps as f64 * HALF_AXES[0] / HALF_AXES[1];
            assert!(error < 0.05 * turn, "fillet {fillet}, {steps} steps: {error} rad");
            assert!(
                doubt <= by_itself[1] + 1e-6,
                "fillet {fillet}, {steps} steps: {doubt} rad, {by_itself:?}"
            );
        }
    }

    #[test]
    fn rows_inside_the_side_of_an_oval_show_more_of_its_curve() {
        // Programs divide a face as a grid, and its rims at other places; a fillet follows, or an end with an edge.
        for (fillet, columns, rim) in [(0.0, 24, 62), (1.0, 24, 62), (3.0, 30, 77), (1.0, 40, 100)] {
            let row = |height: f64| Ring { angles: even(columns), inside: 0.0, height };
            let rim_at = |height: f64| Ring { angles: uneven(rim, 4), inside: 0.0, height };
            let of_fillet = |end: f64| {
                (1..=if fillet > 0.0 { 5 } else { 0 }).map(move |ring| {
                    let turn = f64::from(ring) / 5.0 * std::f64::consts::FRAC_PI_2;
                    let (inside, height) = (fillet * (1.0 - turn.cos()), end * (25.0 + fillet * turn.sin()));
                    Ring { angles: uneven(rim + ring as usize, ring as usize), inside, height }
                })
            };
            let mut rings: Vec<Ring> = of_fillet(-1.0).collect();
            rings.reverse();
            rings.push(rim_at(-25.0));
            rings.extend([-21.0, -14.0, -7.0, 0.0, 7.0, 14.0, 21.0].map(row));
            rings.push(rim_at(25.0));
            rings.extend(of_fillet(1.0));
            let [error, doubt] = errors(&between(&rings));
            let turn = 3.0 / columns as f64 * HALF_AXES[0] / HALF_AXES[1];
            assert!(error < 0.02 * turn, "fillet {fillet}, {columns} columns: {error} rad");
            assert!(
                (error..0.25 * turn).contains(&doubt),
                "fillet {fillet}, {columns} columns: {doubt} rad, {error}"
            );
        }
    }

    #[test]
    fn the_first_facets_of_a_fine_fillet_stay_those_of_the_fillet() {
        const CHORDS: usize = 24;
        let fillet = 2.0;
        let of_fillet = |end: f64| {
            (1..=CHORDS).map(move |ring| {
                let turn = ring as f64 / CHORDS as f64 * std::f64::consts::FRAC_PI_2;
                let (inside, height) = (fillet * (1.0 - turn.cos()), end * (25.0 + fillet * turn.sin()));
                Ring { angles: uneven(30 + ring, ring), inside, height }
            })
        };
        let mut rings: Vec<Ring> = of_fillet(-1.0).collect();
        rings.reverse();
        let rows = [-25.0, -15.0, -5.0, 5.0, 15.0, 25.0];
        rings.extend(rows.map(|height| Ring { angles: even(30), inside: 0.0, height }));
        rings.extend(of_fillet(1.0));
        let can = between(&rings);
        let turn = std::f64::consts::FRAC_PI_2 / CHORDS as f64;
        let mut count = 0;
        for (at, normal) in can.positions.iter().zip(&can.normals) {
            if (at.z.abs() - 25.0 - fillet * turn.sin()).abs() < 1e-9 && (-25.0..25.0).contains(&at.x) {
                assert!(normal.z.abs() > 0.5 * turn.sin(), "{at}: {normal:?}");
                count += 1;
            }
        }
        assert!(count > 20, "{count}");
    }

    #[test]
    fn rows_of_an_oval_barrel_are_no_strips() {
        // The two rings beside the middle are equal: all sides between them are parallel.
        let bulge = |height: f64| 90.0 - (90.0f64.powi(2) - height * height).sqrt();
        let heights = [-17.5, -12.5, -7.5, -2.5, 2.5, 7.5, 12.5, 17.5];
        let barrel = between(&heights.map(|height| Ring { angles: even(40), inside: bulge(height), height }));
        let mut leans = 0;
        for (at, normal) in barrel.positions.iter().zip(&barrel.normals) {
            if at.z.abs() < 3.0 && (-15.0..15.0).contains(&at.x) {
                // The lean of a parallel curve is that of its profile.
                let exact = at.z / 90.0;
                assert!((normal.z - exact).abs() < 0.25 * exact.abs(), "{at}: {normal:?} for {exact}");
                leans += 1;
            }
        }
        assert!(leans > 10);
    }

    /// A disc with a tangent fillet, whose polygon is cut into needles from one vertex: some of them reach no farther along the rows of
    /// the fillet than these do.
    #[test]
    fn needles_of_a_polygon_are_of_no_strip() {
        const SECTORS: u32 = 100;
        let step = 2.0 * PI / f64::from(SECTORS);
        let rows = (0..=10).map(|row| (step * f64::from(row)).sin_cos());
        let place = |(sin, cos): (f64, f64)| {
            (0..SECTORS).map(move |sector| {
                let (y, x) = (step * f64::from(sector)).sin_cos();
                Point3::new((20.0 + 2.0 * sin) * x, (20.0 + 2.0 * sin) * y, 2.0 * cos - 2.0)
            })
        };
        let positions: Vec<Point3<f64>> = rows.flat_map(place).collect();
        let cells = (0..10 * SECTORS).map(|own| (own, own / SECTORS * SECTORS + (own + 1) % SECTORS));
        let fillet = cells.flat_map(|(a, b)| [[a, a + SECTORS, b + SECTORS], [a, b + SECTORS, b]]);
        let triangles = fillet.chain((2..SECTORS).map(|sector| [0, sector - 1, sector])).collect();
        let part = SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top());
        let is_of_disc = |triangle: &usize| part.corners(*triangle).0.iter().all(|at| at.z == 0.0);
        let disc: Vec<usize> = (0..part.triangles.len()).filter(is_of_disc).collect();
        assert_eq!(disc.len(), SECTORS as usize - 2);
        for triangle in disc {
            for normal in part.corners(triangle).1 {
                assert!(normal.xy().norm() < 1e-9, "{triangle}: {normal:?}");
            }
        }
    }
}
