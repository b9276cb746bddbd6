//! The facets beyond the ends of a surface of straight lines, along these lines; for example of a cylinder or
//! a cone.
//!
//! Two rings of vertices are also on a barrel or a ball. There, the facets beyond the rings are about as
//! long, and lean as far, as facets between them would.

use nalgebra::{Point3, Vector3};

use super::SmoothMesh;
use super::plane_facets::PlaneFacets;
use crate::geometry::adjacency::{NONE, Neighbours, facet_normal, sliver_side, width};
use crate::geometry::fork::Fork;
use crate::geometry::rounding;

/// Vertices on a surface are at most this far from it, mm. [`DIGITS`] applies instead where it allows more.
const ON: f64 = 1e-4;
/// Vertices on a surface are at most this share of their largest coordinate away from it, because files state
/// six to seven digits. [`ON`] applies instead where it allows more.
const DIGITS: f64 = 1e-6;
/// Programs that round coordinates round them to this, mm, or finer. Vertices that are rounded to a coarser
/// step are not exact enough.
const DECIMAL: f64 = 1e-3;
/// Facets beyond the end of a surface continue it straight if they lean along its lines by less than this,
/// rad.
const STRAIGHT: f64 = 1e-3;
/// A surface is at least this many times as long as the facets of a fillet at its end. Otherwise its facets
/// may be part of an arc of a profile, whose chords have about the same length.
const LONGER: f64 = 2.0;
/// Vertices on an arc that begins at a rim in the direction of the surface show the radius of the arc to
/// within this share. If the arc begins in another direction, as at the end of a crowned roller, they do not.
const SAME_RADIUS: f64 = 0.05;
/// A vertex beyond a rim is compared with the next one that is more than this many times as far beyond the
/// rim.
const NEXT: f64 = 1.3;
/// The facets of a cone beyond an edge lean alike if their leans differ by less than this, rad.
const IN_LINE: f64 = 0.01;
/// Where only one row of facets is beyond a rim, nothing shows how the profile continues. The surface is
/// straight if it is long enough: an arc as narrow as these facets would leave it more than this many times
/// as far as the arcs across its lines do.
const IMPLAUSIBLE: f64 = 12.0;
/// A surface is long if it is more than this many times as long as the facets beyond its edge. Beyond a long
/// surface, the facets need not lean alike, as on two cones, and the facets of one cone may be narrow.
const MUCH_LONGER: f64 = 4.0;
/// A tessellation may limit only the angle between facets. Then the chords of a profile may leave it farther
/// than the chords across the lines do, but both turn by the same angle from one to the next. If the profile
/// was cut in another way, the facets beyond a long surface lean by less than this share of that angle.
const GENTLE: f64 = 0.25;
/// Two rows of facets are on a cone if the difference of their leans is less than this share of the
/// difference on an arc.
const OF_ARC: f64 = 0.25;
/// The first vertices beyond a rim are on one arc if their radii differ by less than this share.
const SAME_ARC: f64 = 0.01;
/// Vertices show an arc if it would move them by more than this many times their tolerance (`near`), root
/// mean square.
const SHOWN: f64 = 2.0;
/// An arc that leans by less than this at its ends, rad, need not show in the vertices.
const SHOWN_SLOPE: f64 = 2e-3;
/// Lines are straight if every arc along the surface that the vertices do not show has at least this many
/// times the radius of the arcs across it. Otherwise the facets may be a few rings of the fine profile of a
/// turned part.
const STRAIGHTER: f64 = 50.0;
/// Along this share of a rim, something other than the end of the surface may seem to follow, because facets
/// are uneven there.
const UNLIKE: f64 = 0.1;
/// Facets beyond the end of a surface meet it at an edge if they would leave the arc of a fillet more than
/// this many times as far as the facets of the surface leave the surface. The chords of a tessellation leave
/// the part by about the same distance everywhere.
const FARTHER: f64 = 2.0;

/// How far the vertices of a mesh may be off, mm.
pub(super) fn precision(mesh: &SmoothMesh) -> f64 {
    precision_of(&mesh.positions)
}

/// The same of vertices at `positions`.
pub(super) fn precision_of(positions: &[Point3<f64>]) -> f64 {
    let largest = positions.iter().map(|at| at.coords.amax()).fold(0.0, f64::max);
    ON.max(DIGITS * largest)
}

/// How far rounding may have moved vertices whose coordinates have three decimals, mm; 0 if they are rounded otherwise.
pub(super) fn rounding(positions: &[Point3<f64>]) -> f64 {
    let step = rounding::step(positions);
    if step == DECIMAL { 3f64.sqrt() * step / 2.0 } else { 0.0 }
}

/// A surface that a group of facets shows.
pub(super) trait Surface {
    /// The triangles of the group.
    fn triangles(&self) -> &[usize];

    /// The unit normal at the middle of a side of the group.
    fn outward(&self, side: usize) -> Vector3<f64>;

    /// How far the group's facets leave it at most, mm.
    fn largest_bulge(&self) -> f64;
}

/// A surface of straight lines that begin and end alike: parallel ones, or those of a cone.
pub(super) trait Ruled: Surface {
    /// The unit direction of the line that is nearest to a point.
    fn ruling(&self, at: &Point3<f64>) -> Vector3<f64>;

    /// How far along its line a point is, mm.
    fn along(&self, at: &Point3<f64>) -> f64 {
        at.coords.dot(&self.ruling(at))
    }

    /// How far a point beyond a side of the group is from it, mm, 0 or more.
    fn distance(&self, side: usize, at: &Point3<f64>) -> f64;

    /// How far its vertices would be from any of straight lines, root mean square, mm, if its lines were arcs of a curvature, rad/mm,
    /// instead; 0 where that is not known.
    fn shown_bend(&self, _curvature: f64) -> f64 {
        0.0
    }

    /// How far it may be off at a side of the group, mm, where its vertices do not show it better.
    fn doubt(&self, _side: usize) -> f64 {
        0.0
    }
}

/// A place beyond a rim, mm: along the lines of the surface, and towards or away from it.
#[derive(Clone, Copy)]
struct Beyond {
    past: f64,
    off: f64,
}

impl Beyond {
    fn distance(&self) -> f64 {
        self.past.hypot(self.off)
    }

    /// The angle of the chord from the rim, as a sine.
    fn lean(&self) -> f64 {
        self.off / self.distance()
    }

    /// The radius of the arc that begins at the rim in the direction of the surface, mm.
    fn radius(&self) -> f64 {
        self.distance().powi(2) / (2.0 * self.off)
    }

    /// Whether that is a given radius, to within a share of it and to where vertices may be off by `near`, mm.
    fn is_on_arc(&self, radius: f64, share: f64, near: f64) -> bool {
        (self.radius() / radius - 1.0).abs() < share + near / self.off
    }
}

/// How the facets of a surface turn across its lines.
#[derive(Clone, Copy)]
struct Across {
    /// How far they leave it, mm.
    bulge: f64,
    /// The angle between two of them, rad.
    turn: f64,
}

/// What follows a rim along the profile.
struct End {
    first: Beyond,
    next: Option<Beyond>,
    /// Of the facet at the rim, mm.
    width: f64,
    /// The length of the surface, mm.
    own: f64,
}

impl End {
    /// Whether it follows a surface of parallel lines: straight on, in a fillet, or at an edge. The
    /// alternative is an arc that leaves its facets as far as they leave the arcs `across` the lines. `arc`
    /// is the radius of an arc that begins at this rim, mm, if one does. Vertices may be off by `near`, mm.
    fn is_of_straight(&self, across: Across, arc: Option<f64>, near: f64) -> bool {
        let Self { first, next, width, own } = self;
        let Across { bulge, turn } = across;
        let lean = first.lean();
        if lean < STRAIGHT || arc.is_some_and(|arc| first.is_on_arc(arc, SAME_ARC, near)) {
            return true;
        }
        if width * LONGER > *own {
            return false;
        }
        let Some(next) = next else { return own * own * lean / (4.0 * width) > IMPLAUSIBLE * bulge };
        // Of one arc, the surface and the facet beyond it would be two chords.
        let leaves_arc = |times: f64| own * own * lean / (4.0 * (own + width)) > times * bulge;
        let is_long = width * MUCH_LONGER < *own;
        let uneven = (next.lean() - lean).abs();
        let is_of_cone = uneven + near / first.past < OF_ARC * lean * width / (own + width);
        if first.is_on_arc(next.radius(), SAME_RADIUS, near)
            || is_of_cone && leaves_arc(1.0)
            || is_long && lean < GENTLE * turn && leaves_arc(FARTHER)
        {
            return true;
        }
        let is_edge = width * lean / 4.0 > FARTHER * bulge;
        let is_too_long = is_long && leaves_arc(IMPLAUSIBLE);
        [is_edge, uneven < IN_LINE, is_too_long].into_iter().filter(|shown| *shown).count() >= 2
    }
}

/// The least and the largest of some values.
pub(super) fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
}

/// The facets of a mesh round those of a surface.
pub(super) struct Surroundings<'a> {
    pub(super) mesh: &'a SmoothMesh,
    pub(super) facets: PlaneFacets,
    /// Vertices on a surface are this close to it, mm.
    pub(super) near: f64,
}

impl<'a> Surroundings<'a> {
    /// Vertices may be off by `near`, mm.
    pub(super) fn of(mesh: &'a SmoothMesh, near: f64, fork: &dyn Fork) -> Self {
        Self { mesh, facets: PlaneFacets::of(mesh, near, fork), near }
    }

    /// Whether the facets beyond the ends of a surface are consistent with it. The neighbours of the mesh's
    /// vertices are found for the first surface that has ends.
    pub(super) fn confirm(&self, surface: &impl Ruled, around: &mut Option<Neighbours>) -> bool {
        let ends = self.ends(surface.triangles());
        if ends.is_empty() {
            return true;
        }
        let all = || Neighbours::of(&self.mesh.triangles, self.mesh.positions.len());
        let around = around.get_or_insert_with(all);
        let corners = surface.triangles().iter().flat_map(|&triangle| self.mesh.corners(triangle).0);
        let rims = range(corners.map(|point| surface.along(&point)));
        let bulge = surface.largest_bulge();
        let own = rims[1] - rims[0];
        let curvature = self.largest_curvature(surface);
        if own * own * curvature < 8.0 * STRAIGHTER * self.near {
            return false;
        }
        // Ends that run along the lines, too, or rows of vertices between them, unless more facets are of the surface.
        let apex = |beyond: usize| self.mesh.corners(beyond / 3).0[(beyond % 3 + 2) % 3];
        let is_whole =
            || ends.iter().all(|&(side, beyond)| surface.distance(side, &apex(beyond)) > self.near);
        if is_whole() && surface.shown_bend(2.0 * SHOWN_SLOPE / own) > SHOWN * self.near {
            return true;
        }
        let across = Across { bulge, turn: (8.0 * bulge * curvature).sqrt() };
        // For each rim the sides with what follows them.
        let mut followed: [Vec<(End, usize)>; 2] = Default::default();
        for (side, beyond) in ends {
            let corners = self.mesh.corners(beyond / 3).0;
            let apex = self.mesh.triangles[beyond / 3][(beyond % 3 + 2) % 3];
            let place = |vertex: u32| self.beyond(surface, rims, side, vertex);
            let Some((first, rim)) = place(apex) else {
                let ruling = surface.ruling(&corners[0]);
                if facet_normal(corners).dot(&ruling).abs() < STRAIGHT || sliver_side(corners).is_some() {
                    continue;
                }
                return false;
            };
            let next = around.of_vertex(apex as usize).iter().filter_map(|&vertex| Some(place(vertex)?.0));
            let next = next.filter(|next| next.distance() > NEXT * first.distance());
            let next = next.max_by(|one, other| one.distance().total_cmp(&other.distance()));
            followed[rim].push((End { first, next, width: width(corners, beyond % 3), own }, side));
        }
        let (mut whole, mut unlike) = (0.0, 0.0);
        for ends in &followed {
            let arc = self.arc_beyond(surface, ends);
            for (end, side) in ends {
                let [from, to] = self.mesh.ends(*side);
                let length = (to - from).norm();
                whole += length;
                if !end.is_of_straight(across, arc, self.near + surface.doubt(*side)) {
                    unlike += length;
                }
            }
        }
        unlike <= UNLIKE * whole
    }

    /// The radius of an arc that begins at a rim in the direction of the surface, mm: most first vertices beyond the rim are on it,
    /// at different distances. A rim is across the lines.
    fn arc_beyond(&self, surface: &impl Ruled, ends: &[(End, usize)]) -> Option<f64> {
        let along = ends.iter().flat_map(|(_, side)| self.mesh.ends(*side)).map(|at| surface.along(&at));
        let [low, high] = range(along);
        if high - low > self.near {
            return None;
        }
        let firsts =
            ends.iter().map(|(end, _)| end.first).filter(|first| self.near < SAME_RADIUS * first.off);
        let mut firsts: Vec<Beyond> = firsts.collect();
        firsts.sort_by(|one, other| one.radius().total_cmp(&other.radius()));
        let arc = firsts.get(firsts.len() / 2)?.radius();
        let on_arc = || firsts.iter().filter(|first| first.is_on_arc(arc, SAME_ARC, self.near));
        let [nearest, farthest] = range(on_arc().map(Beyond::distance));
        (2 * on_arc().count() > firsts.len() && farthest > NEXT * nearest).then_some(arc)
    }

    /// By how much the normals of a surface turn across its lines at most, rad/mm.
    fn largest_curvature(&self, surface: &impl Ruled) -> f64 {
        let sides = surface.triangles().iter().flat_map(|&triangle| 3 * triangle..3 * triangle + 3);
        let curvature = |side: usize| {
            let [from, to] = self.mesh.ends(side);
            let width = (to - from).cross(&surface.ruling(&from)).norm();
            let corners = self.mesh.triangles[side / 3];
            let [one, other] =
                [side % 3, (side % 3 + 1) % 3].map(|corner| self.mesh.normals[corners[corner] as usize]);
            (2.0 * width > (to - from).norm()).then(|| (other - one).norm() / width)
        };
        sides.filter_map(curvature).fold(0.0, f64::max)
    }

    /// Where a vertex is beyond the rims of a surface, and beyond which of them, if it is.
    fn beyond(
        &self,
        surface: &impl Ruled,
        [low, high]: [f64; 2],
        side: usize,
        vertex: u32,
    ) -> Option<(Beyond, usize)> {
        let at = self.mesh.positions[vertex as usize];
        let along = surface.along(&at);
        let past = (along - high).max(low - along);
        let rim = usize::from(along > high);
        (past > self.near).then(|| (Beyond { past, off: surface.distance(side, &at) }, rim))
    }

    /// The vertices of a surface at an edge to facets beyond it, for example to a flat side that is cut into
    /// a shaft. Facets of an arc or flat side that continues the surface would leave it no farther than its
    /// own facets do. In ascending order.
    pub(super) fn at_edges(&self, surface: &impl Surface) -> Vec<u32> {
        let bulge = surface.largest_bulge();
        let is_edge = |&(side, beyond): &(usize, usize)| {
            let corners = self.mesh.corners(beyond / 3).0;
            let [from, to] = self.mesh.ends(side);
            let lean = facet_normal(corners).cross(&surface.outward(side)).norm();
            lean > STRAIGHT
                && self.facets.reach(self.mesh, beyond / 3, [from, to]) * lean / 4.0 > FARTHER * bulge
        };
        let edges = self.ends(surface.triangles()).into_iter().filter(is_edge);
        let mut vertices: Vec<u32> = edges
            .flat_map(|(side, _)| {
                let corners = self.mesh.triangles[side / 3];
                [corners[side % 3], corners[(side % 3 + 1) % 3]]
            })
            .collect();
        vertices.sort_unstable();
        vertices.dedup();
        vertices
    }

    /// The sides of triangles that others continue, with the sides of these.
    pub(super) fn ends(&self, triangles: &[usize]) -> Vec<(usize, usize)> {
        let mut members = triangles.to_vec();
        members.sort_unstable();
        let sides = triangles.iter().flat_map(|&triangle| 3 * triangle..3 * triangle + 3);
        let continued = sides.map(|side| (side, self.mesh.continued[side]));
        let beyond = continued
            .filter(|&(_, other)| other != NONE && members.binary_search(&(other as usize / 3)).is_err());
        beyond.map(|(side, other)| (side, other as usize)).collect()
    }
}
