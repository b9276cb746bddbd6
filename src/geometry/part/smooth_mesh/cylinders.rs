//! Normals of vertices that are on one cylinder or cone, for example on the round side of a can, a shaft or a
//! cup, or on a fillet along an edge.
//!
//! The vertices of a tessellation are on the part. If the vertices of a strip of facets are on one cylinder,
//! to within the precision of the file, and the strip turns often enough, they show its axis and radius far
//! better than the facets round each vertex do. At rims, the vertices of a fillet follow each other in uneven
//! steps, and estimates from few facets lean by a tenth of the turn and more. The facets beyond the ends of
//! the strip confirm it (`ends`). Where a program cuts a hole into a mesh, the new vertices are on its facets
//! (`plane_facets`), and not on the part from which these were cut.

mod search;

use nalgebra::{Point3, Vector3};

use super::chains;
use super::ends::{Ruled, Surface, Surroundings, precision, rounding};
use super::rivals::{Others, apart, others};
use super::round::{Camber, Round};
use super::round_group::{FINER, Group, LONG, SAME_NORMAL, bulge_on};
use super::settling::{Estimates, Settling};
use super::{MOST_BEND, MOST_SEARCHED, SmoothMesh};
use crate::geometry::adjacency::{NONE, WELD_DISTANCE, facet_normal, middle};
use crate::geometry::cone::Cone;
use crate::geometry::fork::{Fork, found, look_ahead};
use search::{Search, Seen};

/// The facets of a cylinder leave it by at least this many times the tolerance of a vertex (`near`). Short
/// pieces of any smooth curve are arcs, and on fine meshes the vertices round the facets show their normals
/// well.
const LEAST_BULGE: f64 = 50.0;
/// The same limit at the ends of long facets, where the vertices round the facets do not show their normals
/// well.
const LEAST_BULGE_OF_LONG: f64 = 10.0;
/// A strip is searched for only where estimated normals let a facet leave its cylinder by at least this share
/// of the limit. Half of the facets of a strip must leave the cylinder by the limit itself.
const ESTIMATED: f64 = 0.8;
/// A cone is fitted in vain to at most this many strips: coarse turned parts and other nets of facets have many.
const MOST_VAIN_CONES: usize = 1_000;
/// At most this many looks for each triangle on average: nearly every facet of some surfaces begins a cylinder of its own.
const MOST_VISITS: usize = 8;
/// The side of a twisted prism ends on helices, which are on a cylinder as well. At least this share of its
/// triangles has no other triangle of the side beside it round the axis. [`CONTINUES_FLAT`] is a second sign.
const SIDE_BY_SIDE: f64 = 0.9;
/// Beyond the side of a twisted prism, facets turn by less than this share of the turn of facets beside one
/// of the cylinder.
const CONTINUES_FLAT: f64 = 0.75;

/// The triangles of cylinders and cones that have their normals.
#[derive(Default)]
pub(super) struct Rounds {
    /// For each triangle, whether it is of a cylinder; empty if there are no cylinders or cones.
    pub(super) is_cylinder: Vec<bool>,
    /// Triangles, each with its cone.
    on_cones: Vec<(usize, Cone)>,
    /// Triangles that may be of another surface as well: how far it is from theirs at most, mm, or 0 where only the
    /// slope is in doubt, and how far its slope, rad.
    pub(super) apart: Vec<(usize, f64, f64)>,
}

impl Rounds {
    /// The triangles of cones, in ascending order, each with its cone: patches with exact normals are on a cylinder, but only near a cone.
    /// Without those whose patch is farther from it than from its facet.
    pub(super) fn cones(&self, mesh: &SmoothMesh) -> Vec<(u32, Cone)> {
        let is_near = |(triangle, cone): &&(usize, Cone)| {
            let patch = mesh.patch(*triangle);
            let most = patch.largest_bulge() + WELD_DISTANCE;
            patch.grid().all(|(at, _)| cone.distance(&at).abs() <= most)
        };
        let near = self.on_cones.iter().filter(is_near);
        let mut cones: Vec<_> = near.map(|&(triangle, cone)| (triangle as u32, cone)).collect();
        cones.sort_by_key(|&(triangle, _)| triangle);
        cones
    }
}

/// Replaces estimated normals by the normals of the cylinders and cones that their vertices show, and their
/// deviations by 0. Normals of cones are as exact as those of a file, and are not estimated any
/// more. At an edge that the facets beyond show, the cylinders and cones get vertices of their own. Vertices
/// on their chords move onto them. `written` are the positions as the file states them; `cambers` are known.
pub(super) fn settle(
    mesh: &mut SmoothMesh,
    written: &[Point3<f64>],
    cambers: &[Camber],
    estimates: &mut Estimates,
    fork: &dyn Fork,
) -> Rounds {
    let count = mesh.triangles.len();
    if count > MOST_SEARCHED || !estimates.is_estimated.contains(&true) {
        return Rounds::default();
    }
    let near = precision(mesh);
    let mut is_known = vec![false; count];
    let rounding = rounding(written);
    let mut groups = groups_of(mesh, cambers, near.max(rounding), &mut is_known, fork);
    let estimated = &estimates.is_estimated;
    groups.extend(certain_groups(mesh, estimated, near, &mut is_known, fork));
    // What rounding hides is looked for last: it asks for facets that leave the part farther.
    if rounding > near {
        groups.extend(certain_groups(mesh, estimated, rounding, &mut is_known, fork));
    }
    if groups.is_empty() {
        return Rounds::default();
    }
    // Seen before the vertices at their ends are set apart.
    let straight =
        groups.iter().flat_map(|(group, ..)| group.straight_sides(mesh, estimated)).collect::<Vec<_>>();
    let straight = chains::of_straight_sides(mesh, &straight);
    // A hole that is cut into a mesh has its vertices on the facets; those of the part are on the cylinder.
    for (group, ..) in &groups {
        for vertex in group.triangles.iter().flat_map(|&triangle| mesh.triangles[triangle]) {
            let at = &mut mesh.positions[vertex as usize];
            let off = group.round.distance(at);
            if off.abs() > group.near {
                *at -= group.round.outward(at) * off;
            }
        }
    }
    let mut settling = Settling::of(mesh, estimates);
    for (group, at_edges, is_hollow) in &groups {
        let way = if *is_hollow { -1.0 } else { 1.0 };
        let normal = |mesh: &SmoothMesh, vertex: u32| {
            let at = &mesh.positions[vertex as usize];
            (!group.round.is_at_apex(at, group.near)).then(|| group.round.outward(at) * way)
        };
        settling.set(&group.triangles, at_edges, normal);
    }
    // At its apex, a cone has as many normals as it has lines: each facet has that of the line in its middle.
    for (group, _, is_hollow) in &groups {
        let way = if *is_hollow { -1.0 } else { 1.0 };
        for &triangle in &group.triangles {
            let corners = mesh.corners(triangle).0;
            let Some(corner) = corners.iter().position(|at| group.round.is_at_apex(at, group.near)) else {
                continue;
            };
            mesh.triangles[triangle][corner] = mesh.positions.len() as u32;
            mesh.positions.push(corners[corner]);
            mesh.normals.push(group.round.outward(&middle(corners)) * way);
            estimates.push(false);
        }
    }
    let mut rounds = Rounds { is_cylinder: vec![false; count], on_cones: Vec::new(), apart: Vec::new() };
    rounds.apart.extend(straight.into_iter().map(|(triangle, slope)| (triangle, 0.0, slope)));
    for (group, ..) in &groups {
        for &triangle in &group.triangles {
            let (corners, normals) = mesh.corners(triangle);
            let ends = corners.iter().zip(normals);
            let is_known = ends
                .map(|(corner, normal)| {
                    group.round.is_at_apex(corner, group.near)
                        || normal.cross(&group.round.outward(corner)).norm() < SAME_NORMAL
                })
                .collect::<Vec<_>>();
            if let Some(rival) = &group.rival {
                let (height, slope) = apart(mesh, [&group.round, rival], triangle);
                rounds.apart.push((triangle, height, slope));
            }
            let Round::Cone(cone) = group.round else {
                rounds.is_cylinder[triangle] = !is_known.contains(&false);
                continue;
            };
            for (vertex, _) in
                mesh.triangles[triangle].into_iter().zip(&is_known).filter(|(_, known)| **known)
            {
                estimates.set_known(vertex);
            }
            if !is_known.contains(&false) {
                rounds.on_cones.push((triangle, cone));
            }
        }
    }
    rounds
}

/// The groups of known cylinders, each with those of its vertices that are at edges, and whether it is hollow. Triangles of these are
/// known (`is_known`) from then on.
fn groups_of(
    mesh: &SmoothMesh,
    cambers: &[Camber],
    near: f64,
    is_known: &mut [bool],
    fork: &dyn Fork,
) -> Vec<(Group, Vec<u32>, bool)> {
    if cambers.is_empty() {
        return Vec::new();
    }
    let surroundings = Surroundings::of(mesh, near, fork);
    let of_camber = |camber: &Camber| {
        let mut group = Group::of(mesh, camber.cylinder, near, camber.triangles.clone());
        group.rival = camber.rival;
        group.triangles.iter().for_each(|&triangle| is_known[triangle] = true);
        let at_edges = surroundings.at_edges(&OnMesh { mesh, group: &group });
        let is_hollow = mesh.is_hollow(&group);
        (group, at_edges, is_hollow)
    };
    cambers.iter().map(of_camber).collect()
}

/// The cylinders that are certain from their vertices, which may be off by `near`, mm. Each comes with its
/// vertices at edges, and with whether it is hollow. Its triangles are known (`is_known`) from then on.
fn certain_groups(
    mesh: &SmoothMesh,
    estimated: &[bool],
    near: f64,
    is_known: &mut [bool],
    fork: &dyn Fork,
) -> Vec<(Group, Vec<u32>, bool)> {
    let is_open = |triangle: usize| {
        !is_known[triangle] && mesh.triangles[triangle].iter().any(|&vertex| estimated[vertex as usize])
    };
    let mut seeds: Vec<(usize, f64)> = found(fork, mesh.triangles.len(), |triangle| {
        let bulge = if is_open(triangle) { mesh.bulge(triangle) } else { return None };
        let share = if mesh.long_side(triangle, LONG).is_some() { FINER } else { 1.0 };
        (bulge >= ESTIMATED * share * mesh.least_bulge(triangle, near)).then_some((triangle, bulge))
    });
    if seeds.is_empty() {
        return Vec::new();
    }
    // Facets that leave a cylinder by less belong to the group of those that leave it farther, for example
    // narrow ones round a hole.
    seeds.sort_by(|(_, one), (_, other)| other.total_cmp(one));
    let seeds: Vec<usize> = seeds.into_iter().map(|(triangle, _)| triangle).collect();
    let surroundings = Surroundings::of(mesh, near, fork);
    let is_on_chord = surroundings.facets.only_one(mesh);
    let visits = MOST_VISITS * mesh.triangles.len();
    let (vain_cones, is_coneless) = (MOST_VAIN_CONES, vec![false; mesh.triangles.len()]);
    let facets = &surroundings.facets;
    let search = Search { mesh, facets, near, is_on_chord, visits, vain_cones, is_coneless };
    let (mut groups, mut around) = (Vec::new(), None);
    look_ahead(
        fork,
        &seeds,
        &mut (search, Seen::of(mesh, is_known)),
        |(_, seen), triangle| !seen.is_tried[triangle],
        |(search, _), triangle| search.shown_at(triangle),
        |(search, seen), triangle, shown| {
            if search.visits == 0 {
                return false;
            }
            let Some(mut group) = search.group_at(triangle, shown, seen) else { return true };
            if !search.turns_enough(&group) {
                return true;
            }
            match others(mesh, &group.round, &group.triangles, near) {
                Others::None => {}
                Others::Perhaps(rival) => group.rival = Some(rival),
                // What the vertices show instead is found with the cambers.
                Others::Instead => return true,
            }
            let on_mesh = OnMesh { mesh, group: &group };
            if !on_mesh.is_twisted_side() && surroundings.confirm(&on_mesh, &mut around) {
                group.triangles.iter().for_each(|&triangle| seen.is_known[triangle] = true);
                let (at_edges, is_hollow) = (surroundings.at_edges(&on_mesh), mesh.is_hollow(&group));
                groups.push((group, at_edges, is_hollow));
            }
            true
        },
    );
    groups
}

impl SmoothMesh {
    /// How far the facets round a triangle must leave the cylinder on which they are, mm, if vertices may be off by `near`, mm.
    fn least_bulge(&self, triangle: usize, near: f64) -> f64 {
        near * if self.long_side(triangle, LONG).is_some() { LEAST_BULGE_OF_LONG } else { LEAST_BULGE }
    }

    /// Whether the facets of a group face its axis.
    fn is_hollow(&self, group: &Group) -> bool {
        let outward = |&triangle: &usize| {
            let corners = self.corners(triangle).0;
            facet_normal(corners).dot(&group.round.outward(&middle(corners)))
        };
        group.triangles.iter().map(outward).sum::<f64>() < 0.0
    }
}

/// A group with its mesh.
pub(super) struct OnMesh<'a> {
    pub(super) mesh: &'a SmoothMesh,
    pub(super) group: &'a Group,
}

impl OnMesh<'_> {
    /// Whether the facets are a flat side that is twisted about the axis, and only its ends are on the
    /// group's cylinder or cone.
    ///
    /// Every section across the axis shows only one chord of such a side. The chord is a facet of the
    /// cylinder if it turns as little as the chords of a tessellation, and if the facets beyond its ends do
    /// not continue it as a flat side.
    fn is_twisted_side(&self) -> bool {
        let Self { mesh, group: Group { round, triangles, near, .. } } = self;
        let mut members = triangles.clone();
        members.sort_unstable();
        let around = |side: usize| {
            let ends = mesh.ends(side);
            if ends.iter().any(|end| round.is_at_apex(end, *near)) {
                return 0.0;
            }
            let [one, other] = ends.map(|end| round.outward(&end));
            one.angle(&other)
        };
        let (mut alone, mut whole, mut widths) = (0usize, 0.0, 0.0);
        let (mut continued, mut turns, mut of_cylinder) = (0.0, 0.0, 0.0);
        for &triangle in triangles {
            let sides = [0, 1, 2].map(|side| (3 * triangle + side, around(3 * triangle + side)));
            let by_angle = |one: &&(usize, f64), other: &&(usize, f64)| one.1.total_cmp(&other.1);
            let (Some(&(side, _)), Some(&(_, width))) =
                (sides.iter().min_by(by_angle), sides.iter().max_by(by_angle))
            else {
                continue;
            };
            let beyond = mesh.continued[side];
            if beyond != NONE && members.binary_search(&(beyond as usize / 3)).is_ok() {
                continue;
            }
            let [from, to] = mesh.ends(side);
            let length = (to - from).norm();
            alone += 1;
            whole += length;
            widths += length * width;
            if beyond != NONE {
                let [here, there] =
                    [triangle, beyond as usize / 3].map(|triangle| facet_normal(mesh.corners(triangle).0));
                continued += length;
                turns += length * here.angle(&there);
                of_cylinder += length * width / 2.0;
            }
        }
        (alone as f64) >= SIDE_BY_SIDE * triangles.len() as f64
            && (widths > MOST_BEND * whole || 2.0 * continued > whole && turns < CONTINUES_FLAT * of_cylinder)
    }
}

impl Surface for OnMesh<'_> {
    fn triangles(&self) -> &[usize] {
        &self.group.triangles
    }

    fn outward(&self, side: usize) -> Vector3<f64> {
        let [from, to] = self.mesh.ends(side);
        self.group.round.outward(&nalgebra::center(&from, &to))
    }

    fn largest_bulge(&self) -> f64 {
        let bulges = self.group.triangles.iter();
        bulges.map(|&triangle| bulge_on(self.mesh, &self.group.round, triangle)).fold(0.0, f64::max)
    }
}

impl Ruled for OnMesh<'_> {
    fn ruling(&self, at: &Point3<f64>) -> Vector3<f64> {
        self.group.round.ruling(at)
    }

    fn along(&self, at: &Point3<f64>) -> f64 {
        self.group.round.along(at)
    }

    fn distance(&self, _: usize, at: &Point3<f64>) -> f64 {
        self.group.round.distance(at).abs()
    }

    fn shown_bend(&self, curvature: f64) -> f64 {
        let Group { round, triangles, near, .. } = self.group;
        let mut points: Vec<Point3<f64>> =
            triangles.iter().flat_map(|&triangle| self.mesh.corners(triangle).0).collect();
        points.retain(|point| round.distance(point).abs() <= *near);
        round.shown_bend(&points, curvature)
    }
}

#[cfg(test)]
mod tests;
