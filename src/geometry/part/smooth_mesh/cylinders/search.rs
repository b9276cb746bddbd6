//! The search for the facets of a cylinder or cone from one triangle on.

use nalgebra::{Point3, Vector3};

use crate::geometry::adjacency::{NONE, facet_normal, middle, sliver_side, width};
use crate::geometry::flats::{CHORD_OF_ROUND, MOST_IN_TURN};
use crate::geometry::shape_fit::cross_directions;
use crate::geometry::smooth_mesh::SmoothMesh;
use crate::geometry::smooth_mesh::plane_facets::PlaneFacets;
use crate::geometry::smooth_mesh::round::{Plane, Round};
use crate::geometry::smooth_mesh::round_group::{
    FINER, Group, LEAST_ANGLES, LEAST_VERTICES, LONG, SAME_ANGLE, bulge_on,
};

/// Long facets may leave their cylinder by less (`FINER`) where this many triangles on either side of the first are on one cylinder.
const REACH_OF_FINER: usize = 16;
/// Facets beside those to which a cylinder is fitted are on it within this many times what vertices may be off.
const NEARLY: f64 = 4.0;
/// A cylinder is searched for on this many triangles on either side of the first one. The second number is
/// for narrow fillets.
const REACHES: [usize; 2] = [4, 2];
/// Two rings of any turned part are on a cone. Facets beyond the rings of a real cone are on it, too, or they
/// are narrower by at least this factor, as the facets of a fillet are.
const NARROWER: f64 = 2.0;
/// A strip has at least this many triangles to show a cylinder, and to show a cone: the four vertices of two triangles are always on
/// a cylinder, as in a fan.
const LEAST_OF_STRIP: [usize; 2] = [3, 4];
/// A cylinder is fitted to at most this many points.
const MOST_POINTS: usize = 400;
/// A cylinder is fitted this many times to the facets that it has gained.
const ROUNDS: usize = 8;
/// Facets on a cylinder leave it by at most this many times as far as those in the middle of the first strip. A flat side between two
/// lines of the cylinder, and the end of a can, have their vertices on it, too.
const FLAT: f64 = 2.5;
/// Where wide and narrow facets take turns as they may on a round face ([`CHORD_OF_ROUND`], [`MOST_IN_TURN`]), this many triangles of
/// a strip that leave the cylinder farther are more than one facet, and so no flat side.
const MORE_THAN_ONE: usize = 3;
/// Single triangles with their vertices on the cylinder may leave it farther. Then facets that leave it as far, to within this share,
/// are on it.
const SAME_BULGE: f64 = 0.01;
/// Vertices on the chords of a facet are at most this many times as far below the surface as the chord from one end of the facet to the
/// other round the axis: chords between vertices that do not face each other are a little longer than the facet is wide.
const DEEPEST_CHORD: f64 = 2.0;
/// The normals of facets on a cylinder lean along its lines by at most this, rad: by a few hundredths where its rims are cut
/// differently, by more beside a hole.
const LEAN: f64 = 0.6;
/// A triangle with less than this share of the area of the largest one in its plane may be of another surface.
const SMALL: f64 = 0.01;

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
pub(super) struct Seen<'a> {
    /// Whether a group is certain of a triangle.
    pub(super) is_known: &'a mut [bool],
    /// Whether a triangle was looked at for any group.
    pub(super) is_tried: Vec<bool>,
    /// Whether a triangle is found for the present group.
    found: Answers,
    /// Whether a facet is on the present cylinder.
    facets: Answers,
}

impl<'a> Seen<'a> {
    pub(super) fn of(mesh: &SmoothMesh, is_known: &'a mut [bool]) -> Self {
        let count = mesh.triangles.len();
        let (found, facets) = (Answers::about(count), Answers::about(count));
        Self { is_tried: is_known.to_vec(), is_known, found, facets }
    }
}

/// The search on one mesh.
pub(super) struct Search<'a> {
    pub(super) mesh: &'a SmoothMesh,
    pub(super) facets: &'a PlaneFacets,
    /// Vertices on a cylinder are this close to it, mm.
    pub(super) near: f64,
    /// For each vertex, whether it may be on the chords of a cylinder.
    pub(super) is_on_chord: Vec<bool>,
    /// How many triangles may still be looked at.
    pub(super) visits: usize,
    /// How many cones may still be fitted in vain.
    pub(super) vain_cones: usize,
    /// For each triangle, whether it is of a strip of a cone that does not end as one.
    pub(super) is_coneless: Vec<bool>,
}

/// A strip across a side of a triangle and the cylinder that it shows.
pub(super) struct Shown {
    strip: Vec<usize>,
    /// How far its facets leave the cylinder at least, mm.
    least_bulge: f64,
    cylinder: Option<Round>,
}

impl Search<'_> {
    /// What the strips across the sides of a triangle show.
    pub(super) fn shown_at(&self, triangle: usize) -> Vec<Shown> {
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
    pub(super) fn group_at(
        &mut self,
        triangle: usize,
        shown: Vec<Shown>,
        seen: &mut Seen<'_>,
    ) -> Option<Group> {
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
    pub(super) fn turns_enough(&self, group: &Group) -> bool {
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

    /// Whether the facet of a triangle is on it, except for small triangles in its plane, as at the beginning
    /// of a fillet. Vertices on chords are between others round the axis, and no deeper than chords between
    /// these.
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
