//! Normals of vertices that are on one cylinder or cone, as those of the round side of a can, a shaft, a cup, or a fillet along an
//! edge.
//!
//! The vertices of a tessellation are on the part. Those of a strip of facets that are on one cylinder, to within what files
//! state of them, and turn often enough, show its axis and radius far better than the facets round each of them: at rims, where a
//! fillet's vertices follow each other in uneven steps, estimates from few facets lean by a tenth of the turn and more. What follows
//! its ends confirms it (`ends`). Where a program cuts a hole into a mesh, the new vertices are on its facets (`plane_facets`), and
//! not on the part from which these were cut.

use nalgebra::{Point3, Vector3};

use super::chains;
use super::ends::{Straight, Surface, Surroundings, precision, rounding};
use super::plane_facets::PlaneFacets;
use super::rivals::{Others, apart, others};
use super::round::{Camber, Plane, Round};
use super::settling::Settling;
use super::{MOST_BEND, SmoothMesh};
use crate::geometry::adjacency::{NONE, WELD_DISTANCE, facet_normal, middle, sliver_side, width};
use crate::geometry::cone::Cone;
use crate::geometry::flats::{CHORD_OF_ROUND, MOST_IN_TURN};
use crate::geometry::fork::{Fork, found, look_ahead};
use crate::geometry::shape_fit::cross_directions;

/// Vertices at this many angles round the axis show a circle: three define it, and two confirm it.
pub(super) const LEAST_ANGLES: usize = 5;
/// Five vertices define a cylinder; by chance, five more are not on it.
pub(super) const LEAST_VERTICES: usize = 10;
/// Angles that differ by less than this, rad, are one.
pub(super) const SAME_ANGLE: f64 = 1e-3;
/// The facets of a cylinder leave it by at least so many times what a vertex may be off. Short pieces of any smooth curve are arcs;
/// on fine meshes, their normals are known well from the vertices round them, …
const LEAST_BULGE: f64 = 50.0;
/// … but not at the ends of long facets, of which one side is so many times as long as another: of those, this is enough.
const LONG: f64 = 4.0;
const LEAST_BULGE_OF_LONG: f64 = 10.0;
/// Long facets may leave it by only this share of that where so many on either side of the first are on one cylinder.
const FINER: f64 = 0.1;
const REACH_OF_FINER: usize = 16;
/// Half of the facets of a cylinder's strip leave it by that; where the estimated normals let one leave by less than this share of
/// it, no strip is looked for.
const ESTIMATED: f64 = 0.8;
/// The facets beside those of which a cylinder is fitted are on it within so many times what vertices may be off.
const NEARLY: f64 = 4.0;
/// Triangles from the first one on, on either side of it, on which a cylinder is looked for: where a fillet is narrower than the
/// first number, the second.
const REACHES: [usize; 2] = [4, 2];
/// Two rings of any turned part are on a cone. Beyond those of a cone, facets are on it, too, or at least so many times as narrow, as
/// those of a fillet.
const NARROWER: f64 = 2.0;
/// Strips to which a cone is fitted in vain, at most: there are so many on coarse turned parts and other nets of facets.
const MOST_VAIN_CONES: usize = 1_000;
/// Triangles of a strip that shows a cylinder, and a cone, at least: the four vertices of two are always on a cylinder, as those of two
/// facets of a fan.
const LEAST_OF_STRIP: [usize; 2] = [3, 4];
/// Points of which a cylinder is fitted, at most.
const MOST_POINTS: usize = 400;
/// Rounds in which a cylinder is fitted to the facets that it has gained.
const ROUNDS: usize = 8;
/// Triangles are looked at so many times on average, at most: nearly every facet of some surfaces begins a cylinder of its own.
const MOST_VISITS: usize = 8;
/// Meshes with more triangles are fine; a search would take long.
const MOST_TRIANGLES: usize = 300_000;
/// Facets on a cylinder leave it by at most so many times as far as those in the middle of the first ones. A flat side between two
/// lines of it, and the end of a can, have their vertices on it, too.
const FLAT: f64 = 2.5;
/// More than one facet: so many triangles of a strip that leave it farther are no flat side, if wide and narrow facets take turns as they
/// may on a round face ([`CHORD_OF_ROUND`], [`MOST_IN_TURN`]).
const MORE_THAN_ONE: usize = 3;
/// Single triangles with their vertices on it may leave it farther, and then facets that leave it as far, but for this share, are on it.
const SAME_BULGE: f64 = 0.01;
/// Vertices on the chords of a facet are at most so many times as far below the surface as a chord from one end of the facet to the other
/// round the axis: chords between vertices that do not face each other are a little longer than the facet is wide.
const DEEPEST_CHORD: f64 = 2.0;
/// The normals of facets on a cylinder lean along its lines by at most this, rad: by a few hundredths where its rims are cut
/// differently, by more beside a hole.
const LEAN: f64 = 0.6;
/// A triangle with less than this share of the area of the largest one in its plane may be of another surface.
const SMALL: f64 = 0.01;
/// A side of a twisted prism ends on helices, which are on a cylinder as well. It is told from facets of the cylinder by this share of
/// its triangles that have no other one beside them round the axis, and by what follows: facets turn by less than this share of what
/// those beside one of the cylinder do.
const SIDE_BY_SIDE: f64 = 0.9;
const CONTINUES_FLAT: f64 = 0.75;
/// A triangle is that of the cylinder where its normals differ from the cylinder's by less than this, rad.
const SAME_NORMAL: f64 = 1e-3;

/// The facets of a mesh that are on one cylinder or cone.
pub(super) struct Group {
    round: Round,
    /// Its vertices may be off by this, mm.
    near: f64,
    /// How far its facets may leave it, mm.
    most: f64,
    /// In the order in which they are found.
    triangles: Vec<usize>,
    /// Another one on which its vertices may be as well.
    rival: Option<Round>,
}

impl Group {
    /// Those of these triangles, whose vertices are on a cylinder within `near`, mm.
    pub(super) fn of(mesh: &SmoothMesh, round: Round, near: f64, triangles: Vec<usize>) -> Self {
        let most = triangles.iter().map(|&triangle| bulge_on(mesh, &round, triangle)).fold(0.0, f64::max);
        Self { round, near, most, triangles, rival: None }
    }

    /// The sides of its triangles with `estimated` normals that run along it without a bend, each with its triangle.
    fn straight_sides(&self, mesh: &SmoothMesh, estimated: &[bool]) -> Vec<(usize, [u32; 2])> {
        let is_straight = |ends: &[u32; 2]| {
            let [one, other] = ends.map(|end| self.round.outward(&mesh.positions[end as usize]));
            one.cross(&other).norm() < SAME_NORMAL
        };
        let sides = |&triangle: &usize| {
            let [a, b, c] = mesh.triangles[triangle];
            [[a, b], [b, c], [c, a]].map(|ends| (triangle, ends))
        };
        let is_open = |ends: &[u32; 2]| ends.iter().any(|&end| estimated[end as usize]);
        let sides = self.triangles.iter().flat_map(sides);
        sides.filter(|(_, ends)| is_open(ends) && is_straight(ends)).collect()
    }
}

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

/// Replaces normals that are `estimated` by those of the cylinders and cones that their vertices show, and their `deviations` by 0;
/// those of cones are as exact as those of a file, and not estimated any more. At an edge that the facets beyond show, they get
/// vertices of their own. Vertices on their chords move onto them. `written` are the positions as the file states them, `cambers` are
/// known.
pub(super) fn settle(
    mesh: &mut SmoothMesh,
    written: &[Point3<f64>],
    cambers: &[Camber],
    estimated: &mut Vec<bool>,
    deviations: &mut Vec<f64>,
    fork: &dyn Fork,
) -> Rounds {
    let count = mesh.triangles.len();
    if count > MOST_TRIANGLES || !estimated.contains(&true) {
        return Rounds::default();
    }
    let near = precision(mesh);
    let mut is_known = vec![false; count];
    let rounding = rounding(written);
    let mut groups = groups_of(mesh, cambers, near.max(rounding), &mut is_known, fork);
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
    let mut settling = Settling::of(mesh, estimated, deviations);
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
            estimated.push(false);
            deviations.extend((!deviations.is_empty()).then_some(0.0));
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
                estimated[vertex as usize] = false;
                if let Some(deviation) = deviations.get_mut(vertex as usize) {
                    *deviation = 0.0;
                }
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

/// The cylinders of which the vertices, which may be off by `near`, mm, leave no doubt, each with those of its vertices that are at
/// edges, and whether it is hollow. Triangles of these are known (`is_known`) from then on.
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
    // Facets that leave a cylinder less far belong to the group of those that leave it farther, as the narrow ones round a hole.
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
    /// Whether the facets are a flat side that is twisted about the axis, and only its ends are on the group's cylinder or cone.
    ///
    /// No section across the axis shows more of it than one chord. Such a chord is a facet of the cylinder where it turns as little as
    /// those of a tessellation do, and the facets beyond its ends do not continue it as a flat side.
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

impl Straight for OnMesh<'_> {
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

/// Answers to one question about each of many things, which are forgotten at once.
struct Answers {
    /// For each thing twice the number of the question, and 1 more for yes.
    of: Vec<u32>,
    question: u32,
}

impl Answers {
    fn about(count: usize) -> Self {
        Self { of: vec![0; count], question: 0 }
    }

    fn forget(&mut self) {
        self.question += 1;
        if self.question > u32::MAX / 2 {
            *self = Self::about(self.of.len());
            self.question = 1;
        }
    }

    fn of(&self, thing: usize) -> Option<bool> {
        (self.of[thing] / 2 == self.question).then_some(self.of[thing] % 2 == 1)
    }

    fn note(&mut self, thing: usize, answer: bool) {
        self.of[thing] = 2 * self.question + u32::from(answer);
    }
}

/// What the search has seen of each triangle and plane facet.
struct Seen<'a> {
    /// Whether a group is certain of a triangle.
    is_known: &'a mut [bool],
    /// Whether a triangle was looked at for any group.
    is_tried: Vec<bool>,
    /// Whether a triangle is found for the present group.
    found: Answers,
    /// Whether a facet is on the present cylinder.
    facets: Answers,
}

impl<'a> Seen<'a> {
    fn of(mesh: &SmoothMesh, is_known: &'a mut [bool]) -> Self {
        let count = mesh.triangles.len();
        let (found, facets) = (Answers::about(count), Answers::about(count));
        Self { is_tried: is_known.to_vec(), is_known, found, facets }
    }
}

struct Search<'a> {
    mesh: &'a SmoothMesh,
    facets: &'a PlaneFacets,
    /// Vertices on a cylinder are this close to it, mm.
    near: f64,
    /// For each vertex, whether it may be on the chords of a cylinder.
    is_on_chord: Vec<bool>,
    /// How many triangles may still be looked at.
    visits: usize,
    /// How many cones may still be fitted in vain.
    vain_cones: usize,
    /// For each triangle, whether it is of a strip of a cone that does not end as one.
    is_coneless: Vec<bool>,
}

/// A strip across a side of a triangle and the cylinder that it shows.
struct Shown {
    strip: Vec<usize>,
    /// How far its facets leave the cylinder at least, mm.
    least_bulge: f64,
    cylinder: Option<Round>,
}

impl Search<'_> {
    /// What the strips across the sides of a triangle show.
    fn shown_at(&self, triangle: usize) -> Vec<Shown> {
        let least_bulge = self.mesh.least_bulge(triangle, self.near);
        let long = self.mesh.long_side(triangle, LONG);
        let finer = long.map(|_| (REACH_OF_FINER, FINER * least_bulge));
        let reaches = REACHES.into_iter().map(|reach| (reach, least_bulge)).chain(finer);
        let tries = reaches.flat_map(|reach| [0, 1, 2].map(|side| (reach, side)));
        let shown = |((reach, least_bulge), side)| {
            let strip = self.strip(triangle, side, reach);
            let points = || self.some_points(&strip, None);
            let cylinder = (strip.len() >= LEAST_OF_STRIP[0])
                .then(|| Round::cylinder(&self.planes(&strip), points, self.near))
                .flatten();
            Shown { cylinder, strip, least_bulge }
        };
        tries.map(shown).collect()
    }

    /// The facets on the cylinder of a triangle, if one of the strips round it shows one.
    fn group_at(&mut self, triangle: usize, shown: Vec<Shown>, seen: &mut Seen<'_>) -> Option<Group> {
        shown.into_iter().find_map(|shown| {
            let mut group = self.start_at(&shown)?;
            for _ in 0..ROUNDS {
                let mut triangles = self.grown(&group, triangle, seen);
                triangles.iter().for_each(|&triangle| seen.is_tried[triangle] = true);
                self.visits = self.visits.saturating_sub(triangles.len());
                let points = self.some_points(&triangles, Some(&group.round));
                let round = group.round.fitted(&points, self.near);
                let bulges = triangles.iter().map(|&triangle| bulge_on(self.mesh, &round, triangle));
                let most = bulges.map(|bulge| bulge * (1.0 + SAME_BULGE)).fold(group.most, f64::max);
                let next = Group { round, most, triangles: Vec::new(), ..group };
                let mut facets_on = FacetsOn::of(self, &next, self.near, &mut seen.facets);
                triangles.retain(|&triangle| facets_on.has(triangle));
                if triangles.len() <= group.triangles.len() {
                    break;
                }
                group = Group { triangles, ..next };
            }
            (group.triangles.len() >= REACHES[1]).then_some(group)
        })
    }

    /// The cylinder or cone that a strip of a triangle shows, without facets.
    fn start_at(&mut self, shown: &Shown) -> Option<Group> {
        let round = self.round_of(shown)?;
        let mut bulges: Vec<f64> =
            shown.strip.iter().map(|&triangle| bulge_on(self.mesh, &round, triangle)).collect();
        bulges.sort_by(f64::total_cmp);
        let usual = bulges[bulges.len() / 2];
        let corners = self.mesh.corners(*shown.strip.first()?).0;
        let radius = round.distance_from_axis(corners.iter().find(|at| !round.is_at_apex(at, self.near))?);
        let most_of_round = radius * (1.0 - (CHORD_OF_ROUND / 2.0).cos());
        let wide = &bulges[bulges.partition_point(|&bulge| bulge <= FLAT * usual)..];
        let most = match wide.last() {
            Some(&widest)
                if wide.len() >= MORE_THAN_ONE
                    && widest <= most_of_round.min(MOST_IN_TURN.powi(2) * usual) =>
            {
                widest * (1.0 + SAME_BULGE)
            }
            _ => FLAT * usual,
        };
        (usual >= shown.least_bulge).then(|| Group {
            round,
            near: self.near,
            most,
            triangles: Vec::new(),
            rival: None,
        })
    }

    /// A triangle and some on both sides of it, along the direction of one of its sides.
    fn strip(&self, triangle: usize, along: usize, reach: usize) -> Vec<usize> {
        let direction = |side: usize| {
            let [from, to] = self.mesh.ends(side);
            (to - from).try_normalize(0.0).unwrap_or_else(Vector3::zeros)
        };
        let mut strip = vec![triangle];
        for first in [(along + 1) % 3, (along + 2) % 3] {
            let (mut leaves, mut course) = (3 * triangle + first, direction(3 * triangle + along));
            for _ in 0..reach {
                let entered = self.mesh.continued[leaves];
                if entered == NONE || strip.contains(&(entered as usize / 3)) {
                    break;
                }
                let (here, corner) = (entered as usize / 3, entered as usize % 3);
                strip.push(here);
                let [one, other] = [1, 2].map(|turn| 3 * here + (corner + turn) % 3);
                let follows = |side: usize| direction(side).dot(&course).abs();
                let (rim, next) = if follows(one) > follows(other) { (one, other) } else { (other, one) };
                (leaves, course) = (next, direction(rim));
            }
        }
        strip
    }

    fn planes(&self, strip: &[usize]) -> Vec<Plane> {
        let plane = |&triangle: &usize| {
            let corners = self.mesh.corners(triangle).0;
            Plane { normal: facet_normal(corners), at: middle(corners) }
        };
        strip.iter().map(plane).collect()
    }

    /// The cylinder on which the vertices of all triangles of a strip are, or the cone.
    fn round_of(&mut self, Shown { strip, cylinder, .. }: &Shown) -> Option<Round> {
        if cylinder.is_some()
            || strip.len() < LEAST_OF_STRIP[1]
            || self.vain_cones == 0
            || strip.iter().any(|&triangle| self.is_coneless[triangle])
        {
            return *cylinder;
        }
        let start = Round::start_of_cone(&self.planes(strip))?;
        let cone = Round::cone(start, &self.some_points(strip, None), self.near);
        if cone.is_some_and(|cone| self.ends_as_cone(strip, &cone)) {
            return cone;
        }
        self.vain_cones -= 1;
        if cone.is_some() {
            strip.iter().for_each(|&triangle| self.is_coneless[triangle] = true);
        }
        None
    }

    /// Whether the facets round a strip are as they may be on a cone and at its ends.
    fn ends_as_cone(&self, strip: &[usize], cone: &Round) -> bool {
        let corners = |triangle: usize| self.mesh.corners(triangle).0;
        let sides = strip.iter().flat_map(|&triangle| 3 * triangle..3 * triangle + 3);
        let mut ends = sides.filter(|&side| {
            let other = self.mesh.continued[side];
            other != NONE && !strip.contains(&(other as usize / 3))
        });
        ends.all(|side| {
            let other = self.mesh.continued[side] as usize;
            let beyond = corners(other / 3);
            cone.distance(&beyond[(other % 3 + 2) % 3]).abs() <= NEARLY * self.near
                || width(beyond, other % 3) * NARROWER < width(corners(side / 3), side % 3)
        })
    }

    /// The triangles on a cylinder that can be reached from one of them, with all others of their plane facets: a narrow part of a
    /// flat side may have its vertices on the cylinder, too.
    fn grown(&self, group: &Group, from: usize, seen: &mut Seen<'_>) -> Vec<usize> {
        let mut found = vec![from];
        seen.found.forget();
        seen.found.note(from, true);
        let mut facets_on = FacetsOn::of(self, group, NEARLY * self.near, &mut seen.facets);
        let mut next = 0;
        while next < found.len() {
            let here = found[next];
            next += 1;
            for side in 3 * here..3 * here + 3 {
                let other = self.mesh.continued[side];
                if other == NONE {
                    continue;
                }
                let there = other as usize / 3;
                if seen.found.of(there).is_some() || seen.is_known[there] || !facets_on.has(there) {
                    continue;
                }
                seen.found.note(there, true);
                found.push(there);
            }
        }
        found
    }

    /// The different vertices of some triangles without those on chords, evenly chosen if there are many. Those that are on the
    /// cylinder, if it is known, are not on chords.
    fn some_points(&self, triangles: &[usize], round: Option<&Round>) -> Vec<Point3<f64>> {
        let mut vertices: Vec<u32> =
            triangles.iter().flat_map(|&triangle| self.mesh.triangles[triangle]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        vertices.retain(|&vertex| {
            let at = &self.mesh.positions[vertex as usize];
            let is_near = round.is_some_and(|round| round.distance(at).abs() <= self.near);
            is_near || !self.is_on_chord[vertex as usize]
        });
        let step = vertices.len().div_ceil(MOST_POINTS).max(1);
        vertices.into_iter().step_by(step).map(|vertex| self.mesh.positions[vertex as usize]).collect()
    }

    /// Whether the vertices of a group show that it is a cylinder.
    fn turns_enough(&self, group: &Group) -> bool {
        let Group { round, triangles, .. } = group;
        let (first, second) = cross_directions(&round.axis());
        let points = self.some_points(triangles, Some(round));
        let mut angles: Vec<f64> = points
            .iter()
            .filter(|point| !round.is_at_apex(point, self.near))
            .map(|point| round.outward(point))
            .map(|outward| outward.dot(&second).atan2(outward.dot(&first)))
            .collect();
        angles.sort_by(f64::total_cmp);
        angles.dedup_by(|next, kept| *next - *kept < SAME_ANGLE);
        points.len() >= LEAST_VERTICES && angles.len() >= LEAST_ANGLES
    }
}

/// How far the sides of a triangle are from the cylinder at their middles, at most, mm.
pub(super) fn bulge_on(mesh: &SmoothMesh, round: &Round, triangle: usize) -> f64 {
    let [a, b, c] = mesh.corners(triangle).0;
    let middles = [[a, b], [b, c], [c, a]].map(|[from, to]| nalgebra::center(&from, &to));
    middles.map(|middle| round.distance(&middle).abs()).into_iter().fold(0.0, f64::max)
}

/// The plane facets that are on the cylinder of a group, as they are asked for.
struct FacetsOn<'a> {
    search: &'a Search<'a>,
    group: &'a Group,
    /// Vertices are this close to the cylinder, mm.
    near: f64,
    known: &'a mut Answers,
}

impl<'a> FacetsOn<'a> {
    fn of(search: &'a Search<'a>, group: &'a Group, near: f64, known: &'a mut Answers) -> Self {
        known.forget();
        Self { search, group, near, known }
    }

    /// Whether the facet of a triangle is on the cylinder, with this triangle.
    fn has(&mut self, triangle: usize) -> bool {
        let facet = self.search.facets.of_triangle(triangle) as usize;
        let is_on = self.known.of(facet).unwrap_or_else(|| {
            let is_on = self.is_on(triangle);
            self.known.note(facet, is_on);
            is_on
        });
        is_on && self.search.mesh.triangles[triangle].iter().all(|&vertex| self.place(vertex).is_some())
    }

    /// Whether a vertex is on the cylinder; otherwise it is on a chord. `None` if it is on neither: those are as far below the
    /// cylinder as chords may be.
    fn place(&self, vertex: u32) -> Option<bool> {
        let at = &self.search.mesh.positions[vertex as usize];
        let distance = self.group.round.distance(at);
        let is_on_chord =
            || self.search.is_on_chord[vertex as usize] && -self.group.most <= distance && distance < 0.0;
        let is_on = distance.abs() <= self.near;
        let has_place =
            self.group.round.distance_from_axis(at) > self.near || self.group.round.is_at_apex(at, self.near);
        (has_place && (is_on || is_on_chord())).then_some(is_on)
    }

    /// Whether the facet of a triangle is, but for small triangles in its plane, as those at the beginning of a fillet. Vertices on
    /// chords are between others round the axis, and no deeper than chords between these.
    fn is_on(&self, triangle: usize) -> bool {
        let Self { search: Search { mesh, facets, .. }, group: Group { round, most, .. }, .. } = self;
        let area = |triangle: usize| {
            let [a, b, c] = mesh.corners(triangle).0;
            (b - a).cross(&(c - a)).norm()
        };
        let largest = facets.with(triangle).next().unwrap_or(triangle);
        let around = round.axis().cross(&facet_normal(mesh.corners(largest).0));
        let mut on = [f64::INFINITY, f64::NEG_INFINITY];
        let mut chords = on;
        let (mut depth, mut radius) = (0.0f64, 0.0f64);
        for triangle in facets.with(triangle) {
            let corners = mesh.corners(triangle).0;
            let places = mesh.triangles[triangle].map(|vertex| self.place(vertex));
            if places.contains(&None) {
                if triangle != largest && area(triangle) < SMALL * area(largest) {
                    continue;
                }
                return false;
            }
            for (place, point) in places.iter().zip(&corners) {
                let range = if *place == Some(true) {
                    radius = radius.max(round.distance_from_axis(point));
                    &mut on
                } else {
                    depth = depth.max(-round.distance(point));
                    &mut chords
                };
                let at = around.dot(&point.coords);
                *range = [range[0].min(at), range[1].max(at)];
            }
            let on_line = if round.is_at_apex(&corners[0], self.near) { middle(corners) } else { corners[0] };
            let leans = facet_normal(corners).dot(&round.ruling(&on_line)).abs() >= LEAN;
            let leaves = bulge_on(mesh, round, triangle) > *most && facets.with(triangle).nth(1).is_some();
            if leaves || leans && sliver_side(corners).is_none() {
                return false;
            }
        }
        let half = (on[1] - on[0]) / (2.0 * around.norm());
        let sagitta = radius - (radius * radius - half * half).max(0.0).sqrt();
        on[0] <= chords[0]
            && chords[1] <= on[1]
            && (depth == 0.0 || depth <= DEEPEST_CHORD * sagitta + self.near)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::height_field::{FacingPart, Grid};
    use crate::geometry::mesh::TriMesh;
    use crate::geometry::space::{Facing, View};

    /// The strip between two rings about the z axis, each with its angles, rad, from the first to the last of them; the next vertex is
    /// taken on the ring that is behind.
    fn strip(
        positions: &mut Vec<Point3<f64>>,
        triangles: &mut Vec<[u32; 3]>,
        rings: [(f64, f64, &[f64]); 2],
    ) {
        let first = [0, 1].map(|ring: usize| {
            let (radius, height, angles) = rings[ring];
            let start = positions.len() as u32;
            positions.extend(
                angles.iter().map(|angle| Point3::new(radius * angle.cos(), radius * angle.sin(), height)),
            );
            start
        });
        let (low, high) = (rings[0].2, rings[1].2);
        let (mut i, mut j) = (0, 0);
        while i + 1 < low.len() || j + 1 < high.len() {
            let (one, other) = (first[0] + i as u32, first[1] + j as u32);
            if j + 1 == high.len() || (i + 1 < low.len() && low[i + 1] <= high[j + 1]) {
                triangles.push([one, one + 1, other]);
                i += 1;
            } else {
                triangles.push([one, other + 1, other]);
                j += 1;
            }
        }
    }

    fn uneven(count: usize, seed: u64) -> Vec<f64> {
        let mut state = seed;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
        };
        let inner = |index: usize| if index == 0 || index == count { 0.0 } else { 0.7 };
        (0..=count).map(|index| (index as f64 + inner(index) * random()) * 3.0 / count as f64).collect()
    }

    fn smooth(positions: Vec<Point3<f64>>, triangles: Vec<[u32; 3]>) -> SmoothMesh {
        SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top())
    }

    #[test]
    fn normals_of_a_can_are_exact_however_unevenly_its_rims_are_cut() {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let (low, high) = (uneven(20, 3), uneven(23, 8));
        strip(&mut positions, &mut triangles, [(33.0, 0.0, &low), (33.0, 60.0, &high)]);
        // A fillet at one rim.
        for step in 0..4 {
            let at = |step: usize| {
                let angle = step as f64 / 4.0 * std::f64::consts::FRAC_PI_2;
                (32.0 + angle.cos(), 60.0 + angle.sin(), high.as_slice())
            };
            strip(&mut positions, &mut triangles, [at(step), at(step + 1)]);
        }
        let can = smooth(positions, triangles);
        let mut found = 0;
        for (at, normal) in can.positions.iter().zip(&can.normals) {
            if (at.coords.xy().norm() - 33.0).abs() < 1e-9 {
                let radial = Vector3::new(at.x, at.y, 0.0).normalize();
                assert!((normal - radial).norm() < 1e-6, "{at}: {normal:?}");
                found += 1;
            }
        }
        assert!(found >= 45, "{found}");
    }

    /// A filleted can of this radius: the length between the fillets, mm, their radius and the number of their chords, and the
    /// steps round it. The rings of the fillets are cut at other angles than the rims.
    fn filleted_can(radius: f64, between: f64, fillet: f64, chords: usize, steps: usize) -> SmoothMesh {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let even: Vec<f64> = (0..=steps).map(|step| 3.0 * step as f64 / steps as f64).collect();
        let half = between / 2.0;
        strip(&mut positions, &mut triangles, [(radius, -half, &even), (radius, half, &even)]);
        let rings: Vec<Vec<f64>> = (0..=chords)
            .map(|ring| if ring == 0 { even.clone() } else { uneven(steps + ring, 7 * ring as u64) })
            .collect();
        for end in [-1.0, 1.0] {
            let at = |ring: usize| {
                let angle = ring as f64 / chords as f64 * std::f64::consts::FRAC_PI_2;
                let height = end * (half + fillet * angle.sin());
                (radius - fillet + fillet * angle.cos(), height, rings[ring].as_slice())
            };
            for ring in 0..chords {
                let [near, far] = [at(ring), at(ring + 1)];
                let rings = if end > 0.0 { [near, far] } else { [far, near] };
                strip(&mut positions, &mut triangles, rings);
            }
        }
        smooth(positions, triangles)
    }

    #[test]
    fn filleted_cans_are_known_from_their_vertices() {
        // As CAD programs cut them: fillets in fine and in few chords, short cans, cans that are cut finely round the axis.
        let cans = [
            (20.0, 58.0, 1.0, 9, 23),
            (58.0, 20.0, 3.0, 16, 36),
            (33.0, 40.0, 0.5, 2, 62),
            (20.0, 60.0, 3.0, 4, 70),
        ];
        for (radius, between, fillet, chords, steps) in cans {
            let can = filleted_can(radius, between, fillet, chords, steps);
            let mut found = 0;
            for (triangle, corners) in can.triangles.iter().enumerate() {
                let is_on = |&vertex: &u32| {
                    let at = can.positions[vertex as usize];
                    (at.coords.xy().norm() - radius).abs() < 1e-9
                };
                if !corners.iter().all(is_on) {
                    continue;
                }
                found += 1;
                for &vertex in corners {
                    let (at, normal) = (can.positions[vertex as usize], can.normals[vertex as usize]);
                    let radial = Vector3::new(at.x, at.y, 0.0).normalize();
                    assert!((normal - radial).norm() < 1e-6, "R {radius}, fillet {fillet}, {at}: {normal:?}");
                }
                let doubt = can.slope_doubts.get(triangle).copied().unwrap_or(0.0);
                assert_eq!(doubt, 0.0, "R {radius}, fillet {fillet}");
            }
            assert_eq!(found, 2 * steps, "R {radius}, fillet {fillet}");
        }
    }

    /// The largest angle between the normals in the middle of a mesh and those of a twisted prism, rad, and the number of these. The prism has
    /// a square section with sides from corner to corner of so many mm, and fillets; it turns by `twist`, rad, over 80 mm, in rows. The
    /// section of a `corner` of 0 mm is a circle.
    fn lean_of_twisted(corner: f64, fillet: f64, chords: u32, twist: f64, rows: u32) -> (f64, usize) {
        let (height, quarter) = (80.0, std::f64::consts::FRAC_PI_2);
        let section = (0..4).flat_map(|side| {
            let last = if corner > 0.0 { chords } else { chords - 1 };
            (0..=last).map(move |step| {
                let middle = quarter * (f64::from(side) + 0.5);
                let out = quarter * (f64::from(side) + f64::from(step) / f64::from(chords));
                let center =
                    Vector3::new(middle.cos(), middle.sin(), 0.0) * (corner * std::f64::consts::SQRT_2);
                let normal = Vector3::new(out.cos(), out.sin(), 0.0);
                [center + normal * fillet, normal]
            })
        });
        let section: Vec<_> = section.collect();
        let count = section.len() as u32;
        let exact = |row: u32, own: &[Vector3<f64>; 2]| {
            let share = f64::from(row) / f64::from(rows);
            let rotation = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), twist * share);
            let [at, normal] = own.map(|vector| rotation * vector);
            // Both the section and the line through a point of it are on the side.
            let line = Vector3::z() * (height / twist) + Vector3::z().cross(&at);
            (
                Point3::from(at + Vector3::z() * (height * share)),
                Vector3::z().cross(&normal).cross(&line).normalize(),
            )
        };
        let vertices = (0..=rows).flat_map(|row| section.iter().map(move |own| exact(row, own)));
        let (positions, normals): (Vec<_>, Vec<_>) = vertices.unzip();
        let cells =
            (0..rows).flat_map(|row| (0..count).map(move |step| (row * count, step, (step + 1) % count)));
        let triangles = cells.flat_map(|(row, step, next)| {
            let [a, b, c, d] = [row + step, row + next, row + count + next, row + count + step];
            [[a, b, c], [a, c, d]]
        });
        let found = smooth(positions.clone(), triangles.collect());
        let mut most = (0.0, 0);
        for (at, normal) in found.positions.iter().zip(&found.normals) {
            let is_inside = (0.25 * height..0.75 * height).contains(&at.z);
            if let Some(index) = positions.iter().position(|own| is_inside && own == at) {
                most = (f64::max(most.0, normal.angle(&normals[index])), most.1 + 1);
            }
        }
        most
    }

    #[test]
    fn a_twisted_flat_side_is_no_cylinder_although_its_ends_are_on_one() {
        for (corner, fillet, chords, twist, rows) in [
            (18.0, 4.0, 8, 60.0, 40),
            (12.0, 10.0, 25, 60.0, 40),
            (12.0, 10.0, 16, 60.0, 80),
            (12.0, 10.0, 6, 30.0, 20),
        ] {
            let (lean, count) = lean_of_twisted(corner, fillet, chords, f64::to_radians(twist), rows);
            let name = format!("{corner} mm, fillet of {fillet} mm, {twist} deg in {rows} rows");
            assert!(
                lean < 0.02 && count as u32 >= 4 * chords * (rows / 2 - 1),
                "{name}: {lean} rad of {count}"
            );
        }
        let (lean, count) = lean_of_twisted(0.0, 22.0, 6, 1.0, 40);
        assert!(lean < 1e-6 && count > 24 * 19, "circle: {lean} rad of {count}");
    }

    /// The largest angle between the normals of vertices on the cone with this radius at a height of 0 and this slope of its side,
    /// and those of the cone, rad, and the number of such vertices.
    fn largest_lean(mesh: &SmoothMesh, radius: f64, slope: f64) -> (f64, usize) {
        let vertices = mesh.positions.iter().zip(&mesh.normals);
        let leans = vertices.filter_map(|(at, normal)| {
            let across = at.coords.xy();
            let exact = Vector3::new(across.x, across.y, slope * across.norm());
            let is_on = (across.norm() - (radius - slope * at.z)).abs() < 1e-6;
            is_on.then(|| normal.angle(&exact))
        });
        leans.fold((0.0, 0), |(most, count), lean| (most.max(lean), count + 1))
    }

    #[test]
    fn normals_of_a_cone_are_exact_however_unevenly_its_rings_are_cut() {
        for (radius, slope, between) in
            [(33.0, 0.3, &[60.0][..]), (40.0, -0.1, &[30.0, 60.0]), (30.0, 1.0, &[18.0])]
        {
            let (mut positions, mut triangles) = (Vec::new(), Vec::new());
            let (mut low, mut from) = (uneven(19, 3), 0.0);
            for (row, &to) in between.iter().enumerate() {
                let high = uneven(21 + row, 8 + row as u64);
                let rings = [(radius, from, low.as_slice()), (radius, to, &high)];
                strip(
                    &mut positions,
                    &mut triangles,
                    rings.map(|(radius, z, cut)| (radius - slope * z, z, cut)),
                );
                (low, from) = (high, to);
            }
            let (most, count) = largest_lean(&smooth(positions, triangles), radius, slope);
            assert!(most < 1e-6 && count >= 40, "slope {slope}: {most} rad at {count} vertices");
        }
    }

    /// A cone of one strip of `count` sectors between two rings about the z axis, or a fan to its tip if the upper radius is 0, and its
    /// ends, as programs of solid geometry export it: all coordinates have six digits. The upper ring is turned by a share of a sector.
    /// `first` is the corner with which the triangles of the side begin.
    fn closed_cone([low, high]: [f64; 2], height: f64, count: u32, turned: f64, first: usize) -> SmoothMesh {
        let ring = |radius: f64, z: f64, turned: f64| {
            (0..count).map(move |step| {
                let angle = std::f64::consts::TAU * (f64::from(step) + turned) / f64::from(count);
                let digits = |value: f64| format!("{value:.5e}").parse::<f64>().unwrap();
                Point3::new(digits(radius * angle.cos()), digits(radius * angle.sin()), z)
            })
        };
        let is_fan = high == 0.0;
        let tips = if is_fan { 1 } else { count };
        let upper = ring(high, height, turned).take(tips as usize);
        let positions = ring(low, 0.0, 0.0).chain(upper).collect();
        let mut triangles = Vec::new();
        for step in 0..count {
            let next = (step + 1) % count;
            let rotated = |mut corners: [u32; 3]| {
                corners.rotate_left(first);
                corners
            };
            triangles.push(rotated([step, next, count + step % tips]));
            if !is_fan {
                triangles.push(rotated([next, count + next, count + step]));
            }
            if step > 1 {
                triangles.push([0, step, step - 1]);
                if !is_fan {
                    triangles.push([count, count + step - 1, count + step]);
                }
            }
        }
        smooth(positions, triangles)
    }

    #[test]
    fn a_cone_whose_upper_ring_is_near_its_tip_is_no_cylinder() {
        // Every second facet is narrower than a sliver.
        for (count, high) in [(48, 0.01), (48, 0.02), (64, 0.02), (64, 0.05), (100, 0.05), (100, 0.07)] {
            for turned in [0.0, 0.5] {
                let cone = closed_cone([20.0, high], 60.0, count, turned, 0);
                let slope = (20.0 - high) / 60.0;
                for triangle in 0..cone.triangles.len() {
                    let (corners, normals) = cone.corners(triangle);
                    if corners.iter().all(|at| at.z == corners[0].z) {
                        continue;
                    }
                    for (at, normal) in corners.iter().zip(normals) {
                        let name = format!("{count} sectors to {high} mm, turned by {turned}, {at}");
                        let across = at.coords.xy();
                        let off = across.norm() - (20.0 - slope * at.z);
                        assert!(off.abs() < 1e-3, "{name}: off by {off} mm");
                        let exact = Vector3::new(across.x, across.y, slope * across.norm());
                        let lean = normal.angle(&exact);
                        assert!(turned > 0.0 || lean < 1e-4, "{name}: {lean} rad");
                    }
                }
            }
        }
    }

    #[test]
    fn cones_are_known_from_the_ring_at_their_foot_and_their_tip() {
        // Steep, at right angles, flat, and to a ring about as small as what is welded.
        for (low, high, height) in
            [(20.0, 0.0, 60.0), (20.0, 0.0, 20.0), (30.0, 0.0, 6.0), (20.0, 0.03, 60.0), (20.0, 8.0, 60.0)]
        {
            for (count, first) in
                [24, 33, 48, 100].into_iter().flat_map(|count| [0, 1, 2].map(|first| (count, first)))
            {
                let name =
                    format!("{count} sectors from {low} to {high} mm over {height} mm, corner {first}");
                let cone = closed_cone([low, high], height, count, 0.0, first);
                let sides = count * if high > 0.0 { 2 } else { 1 };
                assert_eq!(cone.cones.len(), sides as usize, "{name}");
                let half_angle = ((low - high) / height).atan();
                for (triangle, found) in &cone.cones {
                    assert!((found.half_angle - half_angle).abs() < 1e-5, "{name}: {}", found.half_angle);
                    assert!((found.axis.z.abs() - 1.0).abs() < 1e-9, "{name}");
                    let doubt = cone.slope_doubts.get(*triangle as usize).copied().unwrap_or(0.0);
                    assert_eq!(doubt, 0.0, "{name}");
                }
            }
        }
    }

    #[test]
    fn a_cone_is_met_where_it_is_and_not_where_its_patches_are() {
        // Seen along its axis and across it.
        for (facing, steep) in
            [(Vector3::z(), 20.0), (Vector3::x(), 60.0), (Vector3::new(0.6, 0.0, 0.8), 30.0)]
        {
            let view = View::new(Facing::towards(facing).unwrap(), 0.0);
            let mesh = {
                let cone = closed_cone([20.0, 0.0], steep, 24, 0.0, 0);
                TriMesh::new(cone.positions, Vec::new(), cone.triangles).unwrap()
            };
            let exact = Cone {
                apex: view.point(Point3::new(0.0, 0.0, steep)),
                axis: nalgebra::Unit::new_normalize(view.vector(-Vector3::z())),
                half_angle: (20.0f64 / steep).atan(),
            };
            let part = FacingPart::new(&mesh, &view);
            let samples = part.sample(&Grid::over(&part.extents(), 0.7));
            let mut count = 0;
            for (column, row, height) in samples.field.surface_nodes() {
                let at = samples.field.position(column, row);
                let point = Point3::new(at.x, at.y, height);
                // The foot is seen, too, from some sides.
                let is_on_foot = (exact.split(&point).0 - steep).abs() < 0.3;
                if !is_on_foot {
                    assert!(
                        exact.distance(&point).abs() < 2e-4,
                        "{facing}, {at:?}: {}",
                        exact.distance(&point)
                    );
                    count += 1;
                }
            }
            assert!(count > 500, "{count}");
        }
    }

    #[test]
    fn a_cone_and_a_cylinder_are_known_from_coordinates_with_three_decimals() {
        for slope in [0.2, 0.0] {
            let (mut positions, mut triangles) = (Vec::new(), Vec::new());
            let (low, high) = (uneven(15, 3), uneven(18, 8));
            let rings = [(33.0, 0.0, low.as_slice()), (33.0 - slope * 60.0, 60.0, &high)];
            strip(&mut positions, &mut triangles, rings);
            positions.iter_mut().for_each(|at| *at = at.map(|value| (value * 1e3).round() / 1e3));
            let round = smooth(positions, triangles);
            let leans = round.positions.iter().zip(&round.normals).map(|(at, normal)| {
                let across = at.coords.xy();
                normal.angle(&Vector3::new(across.x, across.y, slope * across.norm()))
            });
            // Half a micrometre at either end of 60 mm, or over 33 mm round the axis.
            let most = leans.fold(0.0, f64::max);
            assert!(most < 1e-4, "slope {slope}: {most} rad");
        }
    }

    #[test]
    fn rings_of_a_vase_are_no_cones() {
        // Each row of facets between two rings is on a cone. The profile is an arc of 80 mm about a point beside the axis.
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let ring = |step: i32| {
            let tilt = 0.12 * f64::from(step);
            (80.0 * tilt.cos() - 50.0, 80.0 * tilt.sin())
        };
        let angles: Vec<f64> = (0..=20).map(|step| f64::from(step) * 0.15).collect();
        for step in 0..5 {
            let rings = [ring(step), ring(step + 1)].map(|(radius, z)| (radius, z, angles.as_slice()));
            strip(&mut positions, &mut triangles, rings);
        }
        let vase = smooth(positions, triangles);
        for (at, normal) in vase.positions.iter().zip(&vase.normals) {
            let across = at.coords.xy();
            let is_inside = (9.0..40.0).contains(&at.z) && (0.4..2.6).contains(&at.y.atan2(at.x));
            let out = across * (1.0 + 50.0 / across.norm());
            let exact = Vector3::new(out.x, out.y, at.z);
            assert!(!is_inside || normal.angle(&exact) < 0.01, "{at}: {normal:?} for {exact:?}");
        }
    }

    #[test]
    fn the_crown_of_a_roller_between_fillets_is_no_cylinder() {
        // Turned on a lathe: a crown in one chord, which begins its fillets in another direction than a cylinder would.
        for (profile, fillet, steps) in [(28.0, 3.0, 15), (28.0, 3.0, 30), (60.0, 4.0, 18), (60.0, 4.0, 24)] {
            let turn = std::f64::consts::TAU / f64::from(steps);
            let angles: Vec<f64> = (0..=steps / 2).map(|step| f64::from(step) * turn).collect();
            let (end, radius) = (turn / 2.0, 30.0);
            let chords = ((std::f64::consts::FRAC_PI_2 - end) / turn).round().max(2.0) as i32;
            let ring = |index: i32| {
                let beyond =
                    f64::from(index.abs() - 1) * (std::f64::consts::FRAC_PI_2 - end) / f64::from(chords);
                let (center, middle) = (radius - profile, (profile - fillet) * end.sin());
                let across = center + (profile - fillet) * end.cos() + fillet * (end + beyond).cos();
                let height = middle + fillet * (end + beyond).sin();
                (across, f64::from(index.signum()) * height, angles.as_slice())
            };
            let (mut positions, mut triangles) = (Vec::new(), Vec::new());
            let indices = (-chords - 1..=-1).chain(1..=chords + 1);
            for (low, high) in indices.clone().zip(indices.skip(1)) {
                strip(&mut positions, &mut triangles, [ring(low), ring(high)]);
            }
            let roller = smooth(positions, triangles);
            let limit = (profile * end.sin()).abs() + 1e-9;
            for triangle in 0..roller.triangles.len() {
                let (corners, normals) = roller.corners(triangle);
                if corners.iter().all(|at| at.z.abs() < limit) {
                    let leans = normals.iter().any(|normal| normal.z.abs() > 1e-3);
                    assert!(leans, "{steps} steps, crown of {profile}: {normals:?}");
                }
            }
        }
    }

    /// Whether all normals of triangles on a cylinder about the z axis are at right angles to it, of which there are `count`.
    fn assert_upright(mesh: &SmoothMesh, radius: f64, count: usize, name: &str) {
        let mut found = 0;
        for triangle in 0..mesh.triangles.len() {
            let (corners, normals) = mesh.corners(triangle);
            if corners.iter().all(|at| (at.coords.xy().norm() - radius).abs() < 1e-9) {
                found += 1;
                assert!(normals.iter().all(|normal| normal.z.abs() < 1e-6), "{name}: {normals:?}");
            }
        }
        assert_eq!(found, count, "{name}");
    }

    #[test]
    fn a_long_body_between_cones_is_a_cylinder() {
        // Rings with radius and height. The cones of pens follow one another, are cut into narrow rows, or lean gently.
        let rows = |row: i32| (6.0 - 0.01 * f64::from(row), 40.0 + 0.625 * f64::from(row));
        let narrow_rows: Vec<_> = [(6.0, -50.0)].into_iter().chain((0..=8).map(rows)).collect();
        let two_cones = vec![(1.8, -75.0), (4.8, -55.0), (6.0, -50.0), (6.0, 40.0), (5.0, 45.0)];
        let gentle = vec![(1.8, -75.0), (4.8, -55.0), (6.0, -50.0), (6.0, 40.0), (5.7, 60.0), (4.2, 70.0)];
        let wide_rows = |row: i32| (30.0 - 0.043 * f64::from(row), 19.0 + 4.2 * f64::from(row));
        let barely: Vec<_> = [(30.0, -19.0)].into_iter().chain((0..=4).map(wide_rows)).collect();
        for (name, rings, step) in [
            ("narrow rows", narrow_rows, 0.05),
            ("two cones", two_cones, 0.2),
            ("gentle", gentle, 0.24),
            ("barely leaning", barely, 0.115),
        ] {
            let angles: Vec<f64> = (0..=24).map(|index| f64::from(index) * step).collect();
            let (mut positions, mut triangles) = (Vec::new(), Vec::new());
            for pair in rings.windows(2) {
                let ends = [pair[0], pair[1]].map(|(radius, z)| (radius, z, angles.as_slice()));
                strip(&mut positions, &mut triangles, ends);
            }
            let radius = rings.iter().map(|ring| ring.0).fold(0.0, f64::max);
            assert_upright(&smooth(positions, triangles), radius, 48, name);
        }
    }

    /// A cylinder of a radius about the z axis that spans 0.5 rad, in facets of a width, mm, from rim to rim. The rims run up and down, their
    /// vertices do not face each other, and rows of a fillet begin at them. Every fourth facet is so much wider.
    fn between_free_rims(radius: f64, facet: f64, wider: f64) -> SmoothMesh {
        let count = (0.5 * radius / facet) as u32;
        let angle = |step: f64| 0.5 * step / f64::from(count);
        let rim = |side: f64, step: f64| {
            let angle = angle(step);
            // Not an ellipse: on one, a cylinder of another radius with bent lines would have the same rim.
            side * (9.0 + 3.0 * (16.0 * angle).sin() + 12.0 * angle)
        };
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for (row, side) in [(2, -1.0), (1, -1.0), (0, -1.0), (0, 1.0), (1, 1.0), (2, 1.0)] {
            for step in 0..=count {
                // The far rim is cut elsewhere.
                let inner = step > 0 && step < count && side > 0.0;
                let widened = if step % 4 == 2 && step < count { wider } else { 0.0 };
                let step = f64::from(step) + widened + if inner { 0.3 * (1.0 - wider) } else { 0.0 };
                let turn = 0.2 * f64::from(row);
                let from_axis = radius - 2.0 * (1.0 - f64::cos(turn));
                let z = rim(side, step) + side * 2.0 * turn.sin();
                positions.push(Point3::new(from_axis * angle(step).cos(), from_axis * angle(step).sin(), z));
            }
        }
        for low in (0..5).flat_map(|row| (0..count).map(move |step| row * (count + 1) + step)) {
            let high = low + count + 1;
            triangles.extend([[low, low + 1, high + 1], [low, high + 1, high]]);
        }
        smooth(positions, triangles)
    }

    #[test]
    fn a_face_with_a_free_outline_is_a_cylinder() {
        for (radius, facet, wider, count) in
            [(40.0, 2.0, 0.0, 20), (150.0, 0.8, 0.0, 186), (60.0, 1.5, 0.75, 40)]
        {
            let name = format!("radius {radius}");
            assert_upright(&between_free_rims(radius, facet, wider), radius, count, &name);
        }
    }

    #[test]
    fn a_short_body_is_a_cylinder_where_one_arc_begins_at_its_rim() {
        // The vertices beyond the rim are on an arc of 315 mm that begins there, at different heights; an arc of 40 mm follows.
        const STEPS: u32 = 20;
        let on_arc = |z: f64| 30.0 - (315.0 - (315.0f64 * 315.0 - z * z).sqrt());
        let rows = [
            |_: u32| (30.0, -22.0),
            |_: u32| (30.0, 0.0),
            |step: u32| (0.0, [3.0, 6.5, 13.0][step as usize % 3]),
            |_: u32| (26.5, 24.0),
        ];
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for row in rows {
            for step in 0..=STEPS {
                let (radius, z) = row(step);
                let radius = if radius == 0.0 { on_arc(z) } else { radius };
                let angle = 0.15 * f64::from(step);
                positions.push(Point3::new(radius * angle.cos(), radius * angle.sin(), z));
            }
        }
        for low in (0..3).flat_map(|row| (0..STEPS).map(move |step| row * (STEPS + 1) + step)) {
            let high = low + STEPS + 1;
            triangles.extend([[low, low + 1, high + 1], [low, high + 1, high]]);
        }
        assert_upright(&smooth(positions, triangles), 30.0, 40, "short body");
    }

    #[test]
    fn at_an_edge_the_chamfer_keeps_its_own_normals() {
        // A can with a chamfer of 20 degrees, 4 mm long, which its own facets show to be straight.
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let angles: Vec<f64> = (0..=60).map(|step| f64::from(step) * 0.05).collect();
        let tilt = 20.0f64.to_radians();
        let end = (30.0 - 4.0 * tilt.sin(), 25.0 + 4.0 * tilt.cos(), angles.as_slice());
        strip(&mut positions, &mut triangles, [(30.0, -25.0, &angles), (30.0, 25.0, &angles)]);
        strip(&mut positions, &mut triangles, [(30.0, 25.0, &angles), end]);
        let can = smooth(positions, triangles);
        for triangle in 0..can.triangles.len() {
            let (corners, normals) = can.corners(triangle);
            if corners.iter().any(|at| at.z > 25.1) {
                let facet = facet_normal(corners);
                assert!(normals.iter().all(|normal| normal.dot(&facet) > 0.99), "{normals:?} for {facet:?}");
            } else {
                assert!(normals.iter().all(|normal| normal.z.abs() < 1e-6), "{normals:?}");
            }
        }
    }

    #[test]
    fn a_flat_side_between_two_lines_of_a_shaft_stays_flat() {
        const RADIUS: f64 = 12.0;
        // The angles of the facets and of the flat side, rad; rounded as FreeCAD writes STL files.
        for (step, flat, length, is_rounded) in [
            (0.15, 1.2, 30.0, false),
            (0.1, 0.4, 30.0, false),
            (0.23, 0.45, 5.0, false),
            (0.08, 0.63, 36.0, true),
            (0.14, 0.9, 20.0, true),
            (0.25, 0.4, 36.0, true),
        ] {
            let angles: Vec<f64> = (0..20)
                .map(|index| f64::from(index) * step + if index > 8 { flat - step } else { 0.0 })
                .collect();
            let (mut positions, mut triangles) = (Vec::new(), Vec::new());
            strip(&mut positions, &mut triangles, [(RADIUS, 0.0, &angles), (RADIUS, length, &angles)]);
            if is_rounded {
                positions.iter_mut().for_each(|at| *at = at.map(|value| (value * 1e3).round() / 1e3));
            }
            // Half a micrometre at either edge of a facet, and normals of a cylinder that its facets show only so well.
            let [limit, limit_round] = if is_rounded { [1e-3, 0.03] } else { [1e-6; 2] };
            let shaft = smooth(positions, triangles);
            let mut found = 0;
            for triangle in 0..shaft.triangles.len() {
                let (corners, normals) = shaft.corners(triangle);
                let facet = facet_normal(corners);
                let is_of_flat = facet.dot(&corners[0].coords).abs() < RADIUS * (0.45 * flat).cos();
                found += usize::from(is_of_flat);
                for (corner, normal) in corners.iter().zip(normals) {
                    let radial = Vector3::new(corner.x, corner.y, 0.0).normalize();
                    let (exact, limit) = if is_of_flat { (facet, limit) } else { (radial, limit_round) };
                    let lean = normal.cross(&exact).norm();
                    assert!(lean < limit, "step {step}, flat side {flat}, {corner}: {lean} rad");
                }
            }
            assert_eq!(found, 2, "step {step}, flat side {flat}");
        }
    }

    #[test]
    fn a_ball_without_its_middle_ring_has_no_edges() {
        // Its middle row of facets is twice as high as the others, and its rings are as far from one another as on a cylinder.
        const ROWS: i32 = 16;
        let step = std::f64::consts::PI / f64::from(ROWS);
        let angles: Vec<f64> = (0..=10).map(|index| f64::from(index) * 2.0 * step).collect();
        let rings: Vec<(f64, f64)> = (-5..=5)
            .filter(|&ring| ring != 0)
            .map(|ring| (20.0 * (f64::from(ring) * step).cos(), 20.0 * (f64::from(ring) * step).sin()))
            .collect();
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for rows in rings.windows(2) {
            let rings = [0, 1].map(|ring: usize| (rows[ring].0, rows[ring].1, angles.as_slice()));
            strip(&mut positions, &mut triangles, rings);
        }
        let ball = smooth(positions, triangles);
        assert_eq!(ball.regions.iter().max(), Some(&0));
        let is_inside = |at: &Point3<f64>| at.z.abs() < 10.0 && (0.5..3.2).contains(&at.y.atan2(at.x));
        for (at, normal) in ball.positions.iter().zip(&ball.normals).filter(|(at, _)| is_inside(at)) {
            let lean = normal.angle(&at.coords);
            assert!(lean < 0.02, "{at}: {lean} rad");
        }
    }

    #[test]
    fn two_equal_rings_of_a_barrel_are_no_cylinder() {
        // Rings at even steps of a profile of R = 100 mm: the middle strip is on a cylinder.
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let angles: Vec<f64> = (0..=20).map(|step| f64::from(step) * 0.15).collect();
        let ring = |step: i32| {
            let tilt = (f64::from(step) - 0.5) * 0.1;
            (100.0 * tilt.cos() - 70.0, 100.0 * tilt.sin(), angles.as_slice())
        };
        for step in -3..4 {
            strip(&mut positions, &mut triangles, [ring(step), ring(step + 1)]);
        }
        let barrel = smooth(positions, triangles);
        for (at, normal) in barrel.positions.iter().zip(&barrel.normals) {
            let across = at.coords.xy().norm();
            let exact = Vector3::new(at.x / across * (across + 70.0), at.y / across * (across + 70.0), at.z)
                .normalize();
            let is_inside = at.z.abs() < 20.0 && (0.4..2.6).contains(&at.y.atan2(at.x));
            assert!(!is_inside || (normal - exact).norm() < 0.01, "{at}: {normal:?} for {exact:?}");
        }
    }

    #[test]
    fn a_hole_that_is_cut_into_the_facets_of_a_shaft_leaves_its_cylinder() {
        const FACETS: u32 = 20;
        const CUT: u32 = 10;
        let at = |step: u32, z: f64| {
            let angle = f64::from(step) * 0.15;
            Point3::new(20.0 * angle.cos(), 20.0 * angle.sin(), z)
        };
        let mut positions: Vec<_> = (0..=FACETS).flat_map(|step| [at(step, 0.0), at(step, 50.0)]).collect();
        let mut triangles = Vec::new();
        for step in (0..FACETS).filter(|step| *step != CUT) {
            let [a, b, c, d] = [2 * step, 2 * step + 2, 2 * step + 3, 2 * step + 1];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        let facet = [2 * CUT, 2 * CUT + 2, 2 * CUT + 3, 2 * CUT + 1];
        let hole = [(0.3, 20.0), (0.7, 20.0), (0.7, 24.0), (0.3, 24.0)].map(|(share, z)| {
            positions.push(at(CUT, z) + (at(CUT + 1, z) - at(CUT, z)) * share);
            positions.len() as u32 - 1
        });
        for side in 0..4 {
            let next = (side + 1) % 4;
            triangles.push([facet[side], facet[next], hole[next]]);
            triangles.push([facet[side], hole[next], hole[side]]);
        }
        let shaft = smooth(positions, triangles);
        for (at, normal) in shaft.positions.iter().zip(&shaft.normals) {
            let across = Vector3::new(at.x, at.y, 0.0);
            assert!((across.norm() - 20.0).abs() < 1e-6, "{at}");
            assert!((normal - across.normalize()).norm() < 1e-6, "{at}: {normal:?}");
        }
    }

    #[test]
    fn a_sliver_of_a_flat_side_beside_a_fillet_stays_flat() {
        // Programs with polygons for circles let a flat side run into a fillet by one of its facets.
        const STEP: f64 = 0.1;
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for step in 0..=15 {
            let angle = (f64::from(step) + 0.5) * STEP;
            let [x, z] = [3.0 * angle.sin(), 3.0 * angle.cos()];
            positions.extend([Point3::new(x, 0.0, z), Point3::new(x, 50.0, z)]);
        }
        for step in 0..15 {
            let [a, b, c, d] = [2 * step, 2 * step + 2, 2 * step + 3, 2 * step + 1];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        let edge = positions[0];
        let beside = positions.len() as u32;
        positions.extend(
            [(-40.0, 0.0), (-40.0, 50.0), (edge.x - 1e-3, 0.0)].map(|(x, y)| Point3::new(x, y, edge.z)),
        );
        triangles.extend([[beside + 2, 0, 1], [beside, beside + 2, 1], [beside, 1, beside + 1]]);
        let bar = smooth(positions, triangles);
        for triangle in 0..bar.triangles.len() {
            let (corners, normals) = bar.corners(triangle);
            let is_sliver = corners.iter().all(|at| at.x > 0.0);
            if !is_sliver && corners.iter().all(|at| (at.z - edge.z).abs() < 1e-9) {
                assert!(normals.iter().all(|normal| normal.z.abs() > 1.0 - 1e-6), "{corners:?}: {normals:?}");
            }
        }
    }
}
