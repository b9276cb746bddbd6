//! Normals where a wide facet continues in narrow ones, as a flat side continues in its fillet.
//!
//! An estimate from the facets round such a vertex leans towards the narrow facets, which would make the flat
//! side bulge over its whole width. The narrow side gives better information: on a smooth curve, the normals
//! at both ends of a short chord lean away from it by equal and opposite angles (exactly on circles, to third
//! order elsewhere), and at its far end all facets have similar widths.

use nalgebra::{Matrix3, Point3, Vector3};

use super::adjacency::{NONE, facet_normal, sliver_side, width as facet_width};
use super::chord_normals::{self, Chord};
use super::smooth_mesh::SmoothMesh;
use crate::geometry::fork::{Fork, mapped};

/// The corners of facets in one plane are at most this far from it, mm, because of rounding in files.
/// [`COPLANAR`] limits their angle.
const PLANE_DISTANCE: f64 = 5e-4;
/// Facets are in one plane only if the cosine of the angle between their normals is larger than this, because
/// of rounding in files. [`PLANE_DISTANCE`] limits their distance.
const COPLANAR: f64 = 0.9998;
/// Triangles that are bent by their normals by less than this, mm, are not changed.
const NEGLIGIBLE_BEND: f64 = 1e-3;
/// A vertex is uneven if one of its planes is this many times as wide as another. In files of rounded
/// numbers, the width is measured in the direction in which the one plane turns to the other.
const UNEVEN: f64 = 2.5;
/// The widest plane is less than this many times as wide as planes that are about as wide.
const LIKE: f64 = 1.5;
/// Rounding turns a narrow plane by at most this many times its standard deviation divided by the width of
/// the plane, rad.
const BY_CHANCE: f64 = 10.0;
/// Weight of the previous estimate relative to that of the nearest vertex.
const PRIOR: f64 = 1e-3;
/// If a normal deviates from that of its widest plane by less than this share of the turn of the narrow
/// facets, it is replaced by the normal of the plane: the difference is within the third-order error of the
/// chords.
const MIN_LEAN: f64 = 0.15;
/// The same limit for a plane of several triangles that is surrounded by narrow facets, if the plane would
/// bulge notably farther than these ([`BULGES_MORE`]). Tessellations turn by no less at wide chords of an arc
/// than at narrow ones, so that the normals of a round face would lean by half of the turn there.
const MIN_LEAN_OF_SURROUNDED: f64 = 0.35;
/// [`MIN_LEAN_OF_SURROUNDED`] applies if the plane would bulge more than this many times as far as the narrow
/// facets.
const BULGES_MORE: f64 = 1.5;
/// A plane that is surrounded by narrow facets is flat if its normal would make it bulge more than this many
/// times as far as these. The facets of a tessellation leave the part by about the same distance everywhere.
const IMPLAUSIBLE: f64 = 6.0;
/// Wide planes that take turns with narrow ones belong to a round face if the normals at both ends of the arc
/// over a wide one differ by at most this, rad. This is the angle over a side of a cylinder with 12 sides.
pub(super) const CHORD_OF_ROUND: f64 = 0.53;
/// Where wide and narrow planes of a round face take turns, a wide one is more than this many times as wide
/// as the next.
const IN_TURN: f64 = 1.5;
/// Where wide and narrow planes of a round face take turns, a wide one is at most this many times as wide as
/// the next. Beside wider flat sides, the narrow planes are fillets.
pub(super) const MOST_IN_TURN: f64 = 3.5;
/// The curvatures on both sides of a wide plane of a round face differ by at most this factor.
const OF_ONE_CURVE: f64 = 1.5;
/// A plane is surrounded by narrow planes if they are on at least this share of its boundary.
const SURROUNDED: f64 = 0.9;

/// Groups of coplanar triangles that continue each other.
pub(super) struct Planes {
    of_triangle: Vec<u32>,
    /// Four times the area over the perimeter, mm: the side of a square, twice the width of a strip.
    widths: Vec<f64>,
    normals: Vec<Vector3<f64>>,
    /// mm².
    areas: Vec<f64>,
    /// Whether a plane has more than one triangle.
    are_divided: Vec<bool>,
    /// Whether a plane consists only of slivers.
    are_slivers: Vec<bool>,
}

/// The vertices with estimated normals.
pub(super) struct Estimated<'a> {
    /// All of them.
    pub(super) all: &'a [bool],
    /// Those of which nothing better is known (`smooth_mesh::arcs`).
    pub(super) open: &'a [bool],
    /// Those that stand at right angles to a straight side (`smooth_mesh::long_sides`).
    pub(super) straight: &'a [bool],
}

/// Corrects normals that are estimated and open at vertices of the `planes` of bent triangles ([`round_bent_ones`]) where
/// facets of very different width continue each other. Those beside a straight side change only if they belong to a flat side:
/// narrow facets with irregular corners would turn them away from it. Returns for each triangle how far the part may be from its
/// curved patch, mm: where the file's normals contradict those derived from the narrow facets. Empty if there is no
/// contradiction.
///
/// The derived normal meets the chords to the surrounding vertices at the same angles as the normals at their other
/// ends, in the least-squares sense, with more weight on short chords. A vertex without a neighbour among even
/// vertices gets the normal of its widest plane, if that plane has more than one triangle.
pub(super) fn lead_across(mesh: &mut SmoothMesh, estimated: &Estimated<'_>, planes: &Planes) -> Vec<f64> {
    let is_open = estimated.open;
    let spans = Spans::of(mesh, planes);
    let uneven: Vec<usize> =
        spans.all().filter_map(|(vertex, span)| span.is_uneven.then_some(vertex)).collect();
    if uneven.is_empty() {
        return Vec::new();
    }
    // At a border or within a single plane, a normal is known from one side only.
    let mut is_known = vec![false; mesh.positions.len()];
    spans.all().for_each(|(vertex, span)| is_known[vertex] = span.turn > 0.0 && !span.is_uneven);
    for side in (0..mesh.continued.len()).filter(|&side| mesh.continued[side] == NONE) {
        let corners = mesh.triangles[side / 3];
        (is_known[corners[side % 3] as usize], is_known[corners[(side + 1) % 3] as usize]) = (false, false);
    }
    let sides = sides_of(mesh, &uneven);
    let known_round = |vertex: usize| {
        let first = sides.partition_point(|side| (side[0] as usize) < vertex);
        let around = sides[first..].iter().take_while(move |side| side[0] as usize == vertex);
        around.map(|side| side[1] as usize).filter(|&other| is_known[other])
    };
    let known = |&vertex: &usize| {
        if estimated.all[vertex] && !is_open[vertex] {
            return Some(mesh.normals[vertex]);
        }
        derived_normal(&mesh.positions, &mesh.normals, vertex, known_round(vertex))
    };
    let derived: Vec<Option<Vector3<f64>>> = uneven.iter().map(known).collect();
    let mut deviations = vec![0.0f64; mesh.positions.len()];
    let mut is_flat = vec![false; planes.normals.len()];
    let is_surrounded = planes.are_surrounded(mesh);
    let mut are_round: Option<Vec<bool>> = None;
    for (&vertex, derived) in uneven.iter().zip(derived) {
        let Some(span) = spans.of_vertex(vertex) else { continue };
        let widest = span.widest as usize;
        if derived.is_none()
            && planes.are_divided[widest]
            && are_round.get_or_insert_with(|| planes.are_round(mesh))[widest]
        {
            continue;
        }
        let flat = span.flat(planes);
        let leaning = derived.filter(|derived| {
            let angle = derived.angle(&flat);
            let bulges = |times: f64| angle * span.width > times * span.turn * span.narrowest;
            let is_flat =
                || bulges(IMPLAUSIBLE) || angle < MIN_LEAN_OF_SURROUNDED * span.turn && bulges(BULGES_MORE);
            angle >= MIN_LEAN * span.turn
                && !(planes.are_divided[widest] && is_surrounded[widest] && is_flat())
        });
        // A face of several triangles can be flat. A single triangle may be a long chord of a curved surface, unless
        // the derived normal shows that it is flat.
        if !planes.are_divided[widest] && (derived.is_none() || leaning.is_some()) {
            continue;
        }
        // Of the two triangles of a bent quadrilateral, as in the flat side of a twisted prism, neither is the side.
        if leaning.is_none()
            && estimated.straight[vertex]
            && span.like.is_some()
            && !planes.are_divided[widest]
        {
            continue;
        }
        is_flat[widest] |= leaning.is_none();
        let normal = leaning.unwrap_or(flat);
        if is_open[vertex] {
            if leaning.is_none() || !estimated.straight[vertex] {
                mesh.normals[vertex] = normal;
            }
        } else if !estimated.all[vertex]
            && derived.is_some()
            && !fits_chords(&mesh.positions, &mesh.normals, vertex, known_round(vertex))
        {
            deviations[vertex] = mesh.normals[vertex].angle(&normal);
        }
    }
    // A vertex inside a flat side gets the normal of that side: the far ends of its chords give no information.
    for (vertex, span) in spans.all() {
        if is_open[vertex] && span.turn == 0.0 && is_flat[span.widest as usize] {
            mesh.normals[vertex] = planes.normals[span.widest as usize];
        }
    }
    if deviations.iter().all(|angle| *angle == 0.0) {
        return Vec::new();
    }
    let doubt = |triangle: usize| {
        let plane = planes.of_triangle[triangle];
        if plane == NONE {
            return 0.0;
        }
        let width = planes.widths[plane as usize];
        let bulges = mesh.triangles[triangle].map(|vertex| deviations[vertex as usize] * width / 4.0);
        bulges.into_iter().fold(0.0, f64::max)
    };
    (0..mesh.triangles.len()).map(doubt).collect()
}

/// The plane of a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlaneOf {
    /// mm².
    pub(super) area: f64,
    /// Whether it can be one polygon that was divided into triangles: then it has no vertex inside, unlike a
    /// fan with its middle.
    pub(super) is_polygon: bool,
    /// Whether all its triangles meet at a vertex inside.
    pub(super) is_fan: bool,
}

/// For each triangle, its plane.
pub(super) fn planes_of(mesh: &SmoothMesh) -> Vec<PlaneOf> {
    let planes = Planes::of(mesh, |_| true);
    let mut triangles = vec![0usize; planes.normals.len()];
    let mut sides = triangles.clone();
    let mut shared: Vec<Vec<u32>> = vec![Vec::new(); planes.normals.len()];
    for (triangle, &plane) in planes.of_triangle.iter().enumerate() {
        let corners = mesh.triangles[triangle];
        match triangles[plane as usize] {
            0 => shared[plane as usize] = corners.to_vec(),
            _ => shared[plane as usize].retain(|corner| corners.contains(corner)),
        }
        triangles[plane as usize] += 1;
        let is_beyond =
            |side: &&u32| planes.of_triangle.get(**side as usize / 3).is_none_or(|other| *other != plane);
        sides[plane as usize] +=
            mesh.continued[3 * triangle..3 * triangle + 3].iter().filter(is_beyond).count();
    }
    // A polygon without a vertex inside has two triangles fewer than sides.
    let of_plane = |&plane: &u32| {
        let is_polygon = triangles[plane as usize] + 2 == sides[plane as usize];
        let is_fan = !is_polygon && !shared[plane as usize].is_empty();
        PlaneOf { area: planes.areas[plane as usize], is_polygon, is_fan }
    };
    planes.of_triangle.iter().map(of_plane).collect()
}

/// What is beside a plane.
#[derive(Debug, Clone, Copy, Default)]
struct Beside {
    /// Different planes.
    planes: [Option<u32>; 2],
    has_others: bool,
}

impl Beside {
    fn include(&mut self, plane: u32, is_chosen: bool) {
        self.has_others |= !is_chosen;
        let [first, second] = &mut self.planes;
        if *first.get_or_insert(plane) != plane {
            *second = Some(plane);
        }
    }

    /// Whether there are at least two planes, all of them chosen.
    fn are_two(&self) -> bool {
        self.planes[1].is_some() && !self.has_others
    }
}

/// The planes that meet at a vertex.
struct Span {
    narrowest: f64,
    width: f64,
    /// The widest plane.
    widest: u32,
    /// The largest angle between it and another plane, rad.
    turn: f64,
    /// Whether another plane is much narrower, see [`UNEVEN`].
    is_uneven: bool,
    /// The widest other plane that is about as wide, see [`LIKE`].
    like: Option<u32>,
}

impl Span {
    /// The normal of the flat side at the vertex: that of its widest plane, or between two flat sides that turn by less than the error of
    /// a normal that the narrow facets lead to, the mean of both.
    fn flat(&self, planes: &Planes) -> Vector3<f64> {
        let normal = planes.normals[self.widest as usize];
        let is_flat = |plane: &u32| planes.are_divided[*plane as usize];
        let like = self.like.filter(|like| is_flat(like) && is_flat(&self.widest));
        let other = like.map(|like| planes.normals[like as usize]);
        let other = other.filter(|other| other.angle(&normal) < MIN_LEAN_OF_SURROUNDED * self.turn);
        other.map_or(normal, |other| (normal + other).normalize())
    }
}

/// The spans of the vertices of planes.
struct Spans {
    /// For each vertex of the mesh the number of its span, from 1 on; 0 where there is none.
    numbers: Vec<u32>,
    spans: Vec<Span>,
}

impl Spans {
    fn of(mesh: &SmoothMesh, planes: &Planes) -> Self {
        let corners = || {
            let triangles = mesh.triangles.iter().zip(&planes.of_triangle);
            let wide =
                triangles.filter(|(_, plane)| **plane != NONE && !planes.are_slivers[**plane as usize]);
            wide.flat_map(|(corners, &plane)| corners.iter().map(move |&vertex| (vertex as usize, plane)))
        };
        let mut numbers = vec![0u32; mesh.positions.len()];
        let mut spans: Vec<Span> = Vec::new();
        for (vertex, plane) in corners() {
            let width = planes.widths[plane as usize];
            if numbers[vertex] == 0 {
                spans.push(Span {
                    narrowest: width,
                    width,
                    widest: plane,
                    turn: 0.0,
                    is_uneven: false,
                    like: None,
                });
                numbers[vertex] = spans.len() as u32;
                continue;
            }
            let span = &mut spans[numbers[vertex] as usize - 1];
            span.narrowest = span.narrowest.min(width);
            if width > span.width {
                (span.width, span.widest) = (width, plane);
            }
        }
        let mut uneven: Vec<(u32, [u32; 2])> = Vec::new();
        for (vertex, plane) in corners() {
            let number = numbers[vertex] - 1;
            let span = &mut spans[number as usize];
            if plane != span.widest {
                let angle = planes.normals[plane as usize].angle(&planes.normals[span.widest as usize]);
                span.turn = span.turn.max(angle);
                let width = |plane: u32| planes.widths[plane as usize];
                if span.width < LIKE * width(plane) && span.like.is_none_or(|like| width(plane) > width(like))
                {
                    span.like = Some(plane);
                }
                // Without rounding, facets in one plane are one facet.
                if mesh.rounding == 0.0 {
                    span.is_uneven = span.width > UNEVEN * span.narrowest;
                    continue;
                }
                // The width of a strip is half of what is compared.
                let bend = angle * span.width / 16.0;
                if span.width > UNEVEN * planes.widths[plane as usize] && bend > NEGLIGIBLE_BEND {
                    uneven.push((number, [span.widest, plane]));
                }
            }
        }
        let spreads = Spreads::of(mesh, planes, uneven.iter().flat_map(|(_, pair)| *pair));
        for (number, pair) in uneven {
            let span = &mut spans[number as usize];
            span.is_uneven = span.is_uneven || spreads.are_uneven(pair);
        }
        Self { numbers, spans }
    }

    fn of_vertex(&self, vertex: usize) -> Option<&Span> {
        self.spans.get((self.numbers[vertex] as usize).checked_sub(1)?)
    }

    /// In the order of the vertices.
    fn all(&self) -> impl Iterator<Item = (usize, &Span)> {
        (0..self.numbers.len()).filter_map(|vertex| Some((vertex, self.of_vertex(vertex)?)))
    }
}

/// How far a plane spreads in each direction.
#[derive(Default)]
struct Spread {
    /// mm².
    area: f64,
    /// Of the first corner, mm.
    origin: Vector3<f64>,
    /// Integrals over the plane of the offset from the origin, mm³, and of its products, mm⁴.
    offsets: Vector3<f64>,
    products: Matrix3<f64>,
}

impl Spread {
    fn add(&mut self, corners: [Point3<f64>; 3]) {
        if self.area == 0.0 {
            self.origin = corners[0].coords;
        }
        let [a, b, c] = corners.map(|corner| corner.coords - self.origin);
        let (area, sum) = ((b - a).cross(&(c - a)).norm() / 2.0, a + b + c);
        self.area += area;
        self.offsets += sum * (area / 3.0);
        let square = |of: Vector3<f64>| of * of.transpose();
        self.products += (square(a) + square(b) + square(c) + square(sum)) * (area / 12.0);
    }

    /// How many times as far the plane spreads in a direction as in that in which it is narrowest, root mean square.
    fn along(&self, direction: Vector3<f64>) -> f64 {
        let middle = self.offsets / self.area;
        let variances = self.products / self.area - middle * middle.transpose();
        // In its plane; the third variance is that of rounding.
        let half = variances.trace() / 2.0;
        let square = (4.0 * half * half - variances.norm_squared()) / 2.0;
        let least = half - (half * half - square).max(0.0).sqrt();
        let here = direction.dot(&(variances * direction)) / direction.norm_squared();
        (here / least).max(1.0).sqrt()
    }
}

/// The spreads of planes.
struct Spreads<'a> {
    mesh: &'a SmoothMesh,
    planes: &'a Planes,
    /// For each plane the number of its spread; [`NONE`] where there is none.
    numbers: Vec<u32>,
    spreads: Vec<Spread>,
}

impl<'a> Spreads<'a> {
    /// Those of the `chosen` planes.
    fn of(mesh: &'a SmoothMesh, planes: &'a Planes, chosen: impl Iterator<Item = u32>) -> Self {
        let (mut numbers, mut spreads) = (Vec::new(), Vec::new());
        for plane in chosen {
            numbers.resize(planes.normals.len(), NONE);
            if numbers[plane as usize] == NONE {
                numbers[plane as usize] = spreads.len() as u32;
                spreads.push(Spread::default());
            }
        }
        let mut found = Self { mesh, planes, numbers, spreads };
        if !found.spreads.is_empty() {
            for (triangle, &plane) in planes.of_triangle.iter().enumerate() {
                let number = found.numbers.get(plane as usize).copied().unwrap_or(NONE);
                if let Some(spread) = found.spreads.get_mut(number as usize) {
                    spread.add(mesh.corners(triangle).0);
                }
            }
        }
        found
    }

    /// Whether a wide plane and a narrow one beside it are wide and narrow in the direction in which the wide
    /// one turns to the narrow one, and rounding does not explain this turn. The narrow facets of a turned
    /// part with a fine profile are as wide as others round its axis.
    fn are_uneven(&self, [wide, narrow]: [u32; 2]) -> bool {
        let normals = [wide, narrow].map(|plane| self.planes.normals[plane as usize]);
        let turn = normals[1] - normals[0];
        let width = |plane: u32, normal: Vector3<f64>| {
            let spread = &self.spreads[self.numbers[plane as usize] as usize];
            self.planes.widths[plane as usize] * spread.along(turn - normal * normal.dot(&turn))
        };
        let narrow = width(narrow, normals[1]);
        width(wide, normals[0]) > UNEVEN * narrow && turn.norm() * narrow > BY_CHANCE * self.mesh.rounding
    }
}

/// Each of the `vertices` (ascending) with each vertex that shares a side with it, in order.
fn sides_of(mesh: &SmoothMesh, vertices: &[usize]) -> Vec<[u32; 2]> {
    let mut is_included = vec![false; mesh.positions.len()];
    vertices.iter().for_each(|&vertex| is_included[vertex] = true);
    let mut sides = Vec::new();
    for &[a, b, c] in &mesh.triangles {
        let around = [[a, b], [a, c], [b, c], [b, a], [c, a], [c, b]];
        sides.extend(around.into_iter().filter(|side| is_included[side[0] as usize]));
    }
    sides.sort_unstable();
    sides.dedup();
    sides
}

/// The normal at a vertex, derived from the normals of the `known` vertices round it; `None` if there are none.
pub(super) fn derived_normal(
    positions: &[Point3<f64>],
    normals: &[Vector3<f64>],
    vertex: usize,
    known: impl Iterator<Item = usize>,
) -> Option<Vector3<f64>> {
    let before = normals[vertex];
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    let mut heaviest = 0.0f64;
    for other in known {
        let chord = positions[other] - positions[vertex];
        let length = chord.norm();
        if !(length > 0.0) {
            continue;
        }
        let along = chord / length;
        // The error of a chord's condition grows with the square of its length.
        let weight = length.powi(-4);
        heaviest = heaviest.max(weight);
        matrix += along * along.transpose() * weight;
        right -= along * (along.dot(&normals[other]) * weight);
    }
    if heaviest == 0.0 {
        return None;
    }
    let prior = PRIOR * heaviest;
    let normal = (matrix + Matrix3::identity() * prior).cholesky()?.solve(&(right + before * prior));
    normal.try_normalize(0.0)
}

/// Whether the normal at a vertex is one of a smooth surface, judged by its chords to the `known` vertices round it with the
/// weights of [`derived_normal`].
fn fits_chords(
    positions: &[Point3<f64>],
    normals: &[Vector3<f64>],
    vertex: usize,
    known: impl Iterator<Item = usize>,
) -> bool {
    let chords = known.map(|other| {
        let ends = [vertex, other];
        let chord = Chord { ends: ends.map(|end| positions[end]), normals: ends.map(|end| normals[end]) };
        (chord, chord.length().powi(-4))
    });
    chord_normals::are_of_smooth_curves(chords)
}

impl Planes {
    /// Whether nearly all neighbours of each plane are much narrower than it; a strip of a cylinder has others like it.
    fn are_surrounded(&self, mesh: &SmoothMesh) -> Vec<bool> {
        let mut boundaries = vec![[0.0; 2]; self.normals.len()];
        for side in 0..mesh.continued.len() {
            let (plane, other) = (self.of_triangle[side / 3], mesh.continued[side]);
            if plane == NONE || other == NONE {
                continue;
            }
            let other = self.of_triangle[other as usize / 3];
            if other != plane {
                let [from, to] = mesh.ends(side);
                let length = (to - from).norm();
                let is_narrow =
                    other != NONE && self.widths[plane as usize] > UNEVEN * self.widths[other as usize];
                boundaries[plane as usize][0] += length;
                boundaries[plane as usize][1] += if is_narrow { length } else { 0.0 };
            }
        }
        boundaries.into_iter().map(|[whole, narrow]| narrow > SURROUNDED * whole).collect()
    }

    /// Whether each plane may be a chord of a round face with wide and narrow chords in turn: beyond each of its narrow neighbours there
    /// is another wide one, not many times as wide, and all turn the same way, by little and as one curve does.
    fn are_round(&self, mesh: &SmoothMesh) -> Vec<bool> {
        let pair = |side: usize| {
            let other = mesh.continued[side];
            let [plane, beyond] = [side, other as usize].map(|side| self.of_triangle.get(side / 3).copied());
            let [plane, beyond] = [plane?, beyond?];
            (plane != NONE && plane != beyond).then_some((other as usize, [plane, beyond]))
        };
        let pairs = || (0..mesh.continued.len()).filter_map(pair);
        let is_wider = |[plane, other]: [u32; 2]| {
            other != NONE && self.widths[plane as usize] > IN_TURN * self.widths[other as usize]
        };
        let mut wider = vec![Beside::default(); self.normals.len()];
        for (_, [plane, other]) in pairs() {
            let is_other_wider = other != NONE && is_wider([other, plane]);
            wider[plane as usize].include(other, is_other_wider);
        }
        let mut narrower = vec![Beside::default(); self.normals.len()];
        let mut ways = vec![[false; 2]; self.normals.len()];
        let mut curvatures = vec![[f64::INFINITY, 0.0f64]; self.normals.len()];
        for (side, [plane, other]) in pairs() {
            let here = plane as usize;
            if !is_wider([plane, other]) {
                narrower[here].include(other, false);
                continue;
            }
            let [width, narrow] = [plane, other].map(|plane| self.widths[plane as usize]);
            let turn = self.normals[here].angle(&self.normals[other as usize]);
            let turns_little = 2.0 * turn * width <= CHORD_OF_ROUND * (width + narrow);
            let corners = mesh.corners(side / 3).0;
            let height = facet_width(corners, side % 3);
            let opposite = mesh.continued[side] as usize;
            let is_like = facet_width(mesh.corners(opposite / 3).0, opposite % 3) <= MOST_IN_TURN * height;
            narrower[here].include(other, turns_little && is_like && wider[other as usize].are_two());
            let [low, high] = &mut curvatures[here];
            (*low, *high) = (low.min(turn / (width + narrow)), high.max(turn / (width + narrow)));
            let [corner, _, far] = [0, 1, 2].map(|turn| corners[(side % 3 + turn) % 3]);
            ways[here][usize::from(self.normals[here].dot(&(far - corner)) > 0.0)] = true;
        }
        let is_round = |plane: usize| {
            let [low, high] = curvatures[plane];
            narrower[plane].are_two() && ways[plane] != [true; 2] && high <= OF_ONE_CURVE * low
        };
        (0..self.normals.len()).map(is_round).collect()
    }

    /// The planes of the `chosen` triangles; other triangles belong to one of these planes or to none.
    pub(super) fn of(mesh: &SmoothMesh, chosen: impl Fn(usize) -> bool) -> Self {
        let corners = |triangle: usize| mesh.triangles[triangle].map(|index| mesh.positions[index as usize]);
        let area = |triangle: usize| {
            let [a, b, c] = corners(triangle);
            (b - a).cross(&(c - a)).norm() / 2.0
        };
        // The largest triangle first: its plane is the most accurate.
        let mut seeds: Vec<(f64, usize)> = (0..mesh.triangles.len())
            .filter(|&index| chosen(index))
            .map(|index| (area(index), index))
            .collect();
        seeds.sort_unstable_by(|one, other| other.0.total_cmp(&one.0).then(one.1.cmp(&other.1)));
        let mut of_triangle = vec![NONE; mesh.triangles.len()];
        let (mut widths, mut normals) = (Vec::new(), Vec::new());
        let (mut areas, mut are_divided, mut are_slivers, mut front) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (_, seed) in seeds {
            if of_triangle[seed] != NONE {
                continue;
            }
            let plane = normals.len() as u32;
            let (start, normal) = (corners(seed)[0], facet_normal(corners(seed)));
            let (mut total, mut perimeter, mut count) = (0.0, 0.0, 0usize);
            of_triangle[seed] = plane;
            front.push(seed);
            while let Some(triangle) = front.pop() {
                let points = corners(triangle);
                count += 1;
                total += area(triangle);
                for side in 0..3 {
                    let length = (points[(side + 1) % 3] - points[side]).norm();
                    let other = mesh.continued[triangle * 3 + side];
                    if other == NONE {
                        perimeter += length;
                        continue;
                    }
                    let other = other as usize / 3;
                    let is_same = of_triangle[other] == plane;
                    if is_same {
                        continue;
                    }
                    let is_in_plane =
                        |point: &Point3<f64>| (point - start).dot(&normal).abs() < PLANE_DISTANCE;
                    let points = corners(other);
                    if of_triangle[other] == NONE
                        && points.iter().all(is_in_plane)
                        && (facet_normal(points).dot(&normal) > COPLANAR || sliver_side(points).is_some())
                    {
                        of_triangle[other] = plane;
                        front.push(other);
                    } else {
                        perimeter += length;
                    }
                }
            }
            widths.push(if perimeter > 0.0 { 4.0 * total / perimeter } else { f64::INFINITY });
            normals.push(normal);
            areas.push(total);
            are_divided.push(count > 1);
            // The seed is the largest triangle of the plane.
            are_slivers.push(sliver_side(corners(seed)).is_some());
        }
        Self { of_triangle, widths, normals, areas, are_divided, are_slivers }
    }
}

/// For each triangle, whether it is bent by its normals by more than [`NEGLIGIBLE_BEND`] or within two vertices of
/// such a triangle; `None` if there is none.
pub(super) fn round_bent_ones(mesh: &SmoothMesh, fork: &dyn Fork) -> Option<Vec<bool>> {
    let bends = |triangle: usize| {
        let (points, normals) = mesh.corners(triangle);
        (0..3).any(|corner| {
            let off = |other: usize| (points[other] - points[corner]).dot(&normals[corner]).abs();
            off((corner + 1) % 3).max(off((corner + 2) % 3)) > 4.0 * NEGLIGIBLE_BEND
        })
    };
    let mut chosen = mapped(fork, mesh.triangles.len(), bends);
    if !chosen.contains(&true) {
        return None;
    }
    for _ in 0..2 {
        let mut is_near = vec![false; mesh.positions.len()];
        for (corners, _) in mesh.triangles.iter().zip(&chosen).filter(|(_, chosen)| **chosen) {
            corners.iter().for_each(|&vertex| is_near[vertex as usize] = true);
        }
        for (corners, chosen) in mesh.triangles.iter().zip(&mut chosen) {
            *chosen |= corners.iter().any(|&vertex| is_near[vertex as usize]);
        }
    }
    Some(chosen)
}
