//! Facets that are shaded flat although they may be cut from a smooth surface.
//!
//! Flat shading gives every facet the normal of its plane. Such normals do not show whether a part is round
//! or has flat sides. The facets do: on a round face, each turns from the last by about the same angle, and
//! all are about equally wide.

use nalgebra::{Point3, Vector3};

use super::adjacency::{NONE, facet_normal, least_width, opposite_sides, weld};
use super::flats::MOST_IN_TURN;
use super::mesh::TriMesh;
use super::polygons::{self, ROUNDED};
use super::rounding;
use super::smooth_mesh::{CREASE_ANGLE, NORMAL_TOLERANCE, TURN_OF_PRISM};

/// The normal of a facet differs from that of each of its triangles by at most this, rad (1.2°): a polygon
/// may be slightly bent.
const SAME_NORMAL: f64 = 0.021;
/// Rounding moves the corner of a triangle out of its plane by at most this many standard deviations of the
/// positions. The normals are those of the facets before rounding.
const BY_CHANCE: f64 = 5.0;
/// Two turns, or two widths, are alike if one is at most this many times the other.
const ALIKE: f64 = 1.5;
/// The two triangles of a bent quadrilateral turn by at most this, rad (10°).
const BENT: f64 = 0.175;
/// Share of the triangles whose normals may differ from their planes: slivers have no well-defined plane.
const SLIVERS: f64 = 0.01;

/// Facets that are shaded flat and continue one another as on a round face.
pub struct OpenFacets {
    /// For each vertex, whether it belongs to a body that is shaded flat throughout and has such facets.
    /// Empty if there is no such body, or if the mesh has no normals. Triangles that are connected by sides
    /// form one body.
    pub is_of_flat_body: Vec<bool>,
    /// How a smooth surface through the vertices would change the facets of these bodies. In a mesh without
    /// normals: of all facets.
    pub roundings: Vec<Rounding>,
    /// For each triangle that is such a facet of any other body, the angle by which it and the next ones
    /// turn, rad; 0 for other triangles. Empty if there are no such facets.
    pub turns: Vec<f32>,
    /// Whether normals differ within a triangle: the program that wrote them shades round faces smooth.
    pub has_smooth: bool,
}

/// A flat facet that a smooth surface rounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rounding {
    /// Angle to the next facet, rad.
    pub turn: f64,
    /// Height of the smooth surface above the facet, mm.
    pub bulge: f64,
}

impl Rounding {
    /// By what share an arc is longer than its chord.
    pub fn lengthening(&self) -> f64 {
        self.turn * self.turn / 24.0
    }
}

impl OpenFacets {
    /// Those of a mesh; `None` if there are none. In a mesh without normals, all facets are flat.
    pub fn of(mesh: &TriMesh) -> Option<Self> {
        let mut shading = Shading::of(mesh)?;
        let mut continuing = shading.continuing();
        if shading.join_bent(mesh, &continuing) {
            continuing = shading.continuing();
        }
        if continuing.is_empty() {
            return None;
        }
        let turns = shading.turns(&continuing);
        let all = || continuing.iter().map(Turn::rounding).collect();
        if mesh.normals().is_empty() {
            let (is_of_flat_body, turns) = (Vec::new(), Vec::new());
            return Some(Self { is_of_flat_body, roundings: all(), turns, has_smooth: false });
        }
        let bodies = shading.bodies();
        let count = bodies.iter().max().map_or(0, |last| *last as usize + 1);
        let mut found = vec![Body::default(); count];
        let mut body_of_facet = vec![0; shading.facets.len()];
        for ((&number, &face), turn) in bodies.iter().zip(&shading.faces).zip(&turns) {
            let body = &mut found[number as usize];
            body.triangles += 1;
            body.curved += usize::from(face == NONE);
            body.is_round |= *turn > 0.0;
            if let Some(of_facet) = body_of_facet.get_mut(face as usize) {
                *of_facet = number as usize;
            }
        }
        let is_flat: Vec<bool> = found.iter().map(Body::is_flat_and_round).collect();
        let mut is_of_flat_body = Vec::new();
        if is_flat.contains(&true) {
            is_of_flat_body.resize(mesh.positions().len(), false);
        }
        let mut open = vec![0.0; turns.len()];
        for (triangle, corners) in mesh.triangles().iter().enumerate() {
            if is_flat[bodies[triangle] as usize] {
                corners.iter().for_each(|&vertex| is_of_flat_body[vertex as usize] = true);
            } else if turns[triangle] > NORMAL_TOLERANCE {
                open[triangle] = turns[triangle] as f32;
            }
        }
        let of_flat = continuing.iter().filter(|turn| is_flat[body_of_facet[turn.facets[0] as usize]]);
        Some(Self {
            is_of_flat_body,
            roundings: of_flat.map(Turn::rounding).collect(),
            turns: if open.iter().any(|turn| *turn > 0.0) { open } else { Vec::new() },
            has_smooth: mesh.triangles().iter().any(|corners| is_smooth(mesh, corners)),
        })
    }
}

/// Whether the normals of a triangle differ.
fn is_smooth(mesh: &TriMesh, corners: &[u32; 3]) -> bool {
    let normals = corners.map(|vertex| mesh.normals()[vertex as usize]);
    let differ = |normal: &Vector3<f64>| (normal - normals[0]).norm() > ROUNDED;
    !normals.contains(&Vector3::zeros()) && normals.iter().any(differ)
}

#[derive(Clone, Default)]
struct Body {
    triangles: usize,
    /// Triangles with other normals than those of their planes.
    curved: usize,
    is_round: bool,
}

impl Body {
    fn is_flat_and_round(&self) -> bool {
        self.is_round && self.curved as f64 <= SLIVERS * self.triangles as f64
    }
}

/// For each triangle, whether it is shaded flat: its corners have the normal of its plane, whichever way round it runs, or of the
/// polygon that it was cut from. In a mesh without normals, all are.
fn are_flat(mesh: &TriMesh) -> Vec<bool> {
    let by_chance = BY_CHANCE * rounding::deviation(mesh.positions());
    let is_flat = |triangle: usize| {
        let (given, plane) = (given(mesh, triangle), plane(mesh, triangle));
        if given[0] == Vector3::zeros() || given.iter().any(|normal| (normal - given[0]).norm() >= ROUNDED) {
            return false;
        }
        let off =
            given.map(|normal| normal.dot(&plane).abs().min(1.0).acos()).into_iter().fold(0.0, f64::max);
        off <= SAME_NORMAL
            || off <= BENT && {
                let width = least_width(mesh.corners(mesh.triangles()[triangle]));
                width > 0.0 && (off - SAME_NORMAL) * width <= by_chance
            }
    };
    let mut are_flat: Vec<bool> = (0..mesh.triangles().len()).map(is_flat).collect();
    if !mesh.normals().is_empty() {
        let given = |triangle: usize| given(mesh, triangle);
        polygons::add_bent(&mut are_flat, mesh.positions(), mesh.triangles(), given);
    }
    are_flat
}

/// The normals at the corners of a triangle; those of its plane in a mesh without normals.
fn given(mesh: &TriMesh, triangle: usize) -> [Vector3<f64>; 3] {
    let normals = mesh.triangles()[triangle].map(|index| mesh.normals().get(index as usize).copied());
    normals.map(|normal| normal.unwrap_or_else(|| plane(mesh, triangle)))
}

/// The normal of a triangle's plane.
fn plane(mesh: &TriMesh, triangle: usize) -> Vector3<f64> {
    facet_normal(mesh.corners(mesh.triangles()[triangle]))
}

/// The flat facets of a mesh: triangles with one normal that continue one another in a plane.
struct Shading {
    opposite: Vec<u32>,
    /// For each triangle the number of its facet; [`NONE`] where it is not shaded flat.
    faces: Vec<u32>,
    facets: Vec<Facet>,
    has_normals: bool,
}

#[derive(Default)]
struct Facet {
    normal: Vector3<f64>,
    /// The sum over its triangles, weighted by their areas.
    middle: Vector3<f64>,
    area: f64,
    perimeter: f64,
}

impl Facet {
    /// Twice the width of a strip, the side of a square, mm.
    fn width(&self) -> f64 {
        4.0 * self.area / self.perimeter
    }

    fn middle(&self) -> Vector3<f64> {
        self.middle / self.area
    }
}

/// A side between two facets.
struct Turn {
    facets: [u32; 2],
    /// Of the second one.
    width: f64,
    /// Whether one is much wider than the other.
    is_uneven: bool,
    /// rad.
    angle: f64,
    /// The turn of an arc over the wider facet as a share of the angle.
    of_wider: f64,
    /// Height of an arc over the wider facet that goes on to turn like that, mm.
    bulge: f64,
    is_convex: bool,
}

impl Turn {
    fn rounding(&self) -> Rounding {
        Rounding { turn: self.of_wider * self.angle, bulge: self.bulge }
    }

    fn goes_on_in(&self, other: &Self) -> bool {
        self.facets[1] != other.facets[1]
            && self.is_convex == other.is_convex
            && are_alike(self.angle, other.angle)
            && self.is_uneven == other.is_uneven
            && (!self.is_uneven || are_alike(self.width, other.width))
    }
}

impl Shading {
    /// `None` where no triangle is shaded flat.
    fn of(mesh: &TriMesh) -> Option<Self> {
        let given = |triangle: usize| given(mesh, triangle);
        let count = mesh.triangles().len();
        let are_flat = are_flat(mesh);
        if !are_flat.contains(&true) {
            return None;
        }
        let welded = weld(mesh.positions());
        let places: Vec<[u32; 3]> =
            mesh.triangles().iter().map(|corners| corners.map(|index| welded[index as usize])).collect();
        let opposite = opposite_sides(&places);
        let mut shading = Self {
            opposite,
            faces: vec![NONE; count],
            facets: Vec::new(),
            has_normals: !mesh.normals().is_empty(),
        };
        let mut front = Vec::new();
        for seed in 0..count {
            if !are_flat[seed] || shading.faces[seed] != NONE {
                continue;
            }
            let number = shading.facets.len() as u32;
            let normal = given(seed)[0];
            let mut facet = Facet { normal, ..Facet::default() };
            shading.faces[seed] = number;
            front.push(seed);
            while let Some(triangle) = front.pop() {
                let points = mesh.corners(mesh.triangles()[triangle]);
                let area = area(points);
                facet.area += area;
                facet.middle += points.iter().map(|point| point.coords).sum::<Vector3<f64>>() * (area / 3.0);
                for side in 0..3 {
                    let other = shading.opposite[3 * triangle + side] as usize / 3;
                    let continues = are_flat.get(other) == Some(&true)
                        && given(other)[0].dot(&normal) >= SAME_NORMAL.cos();
                    if !continues {
                        facet.perimeter += (points[(side + 1) % 3] - points[side]).norm();
                    } else if shading.faces[other] == NONE {
                        shading.faces[other] = number;
                        front.push(other);
                    }
                }
            }
            shading.facets.push(facet);
        }
        Some(shading)
    }

    /// For each triangle, the number of the body that it belongs to.
    fn bodies(&self) -> Vec<u32> {
        let (mut bodies, mut next, mut front) = (vec![NONE; self.faces.len()], 0, Vec::new());
        for seed in 0..bodies.len() {
            if bodies[seed] != NONE {
                continue;
            }
            bodies[seed] = next;
            front.push(seed);
            while let Some(triangle) = front.pop() {
                for &side in &self.opposite[3 * triangle..3 * triangle + 3] {
                    let other = side as usize / 3;
                    if side != NONE && bodies[other] == NONE {
                        bodies[other] = next;
                        front.push(other);
                    }
                }
            }
            next += 1;
        }
        bodies
    }

    /// For each triangle, the largest angle by which its facet turns to one that continues it, rad; 0 if there is none.
    fn turns(&self, continuing: &[Turn]) -> Vec<f64> {
        let mut largest = vec![0.0f64; self.facets.len()];
        for Turn { facets, angle, .. } in continuing {
            // The last facet of a face has one neighbour that is like it.
            for &facet in facets {
                largest[facet as usize] = largest[facet as usize].max(*angle);
            }
        }
        self.faces.iter().map(|&face| largest.get(face as usize).copied().unwrap_or(0.0)).collect()
    }

    /// The turns that go on at another side of their first facet.
    fn continuing(&self) -> Vec<Turn> {
        let mut turns: Vec<Turn> = (0..self.opposite.len()).filter_map(|side| self.turn(side)).collect();
        turns.sort_by_key(|turn| turn.facets);
        let goes_on: Vec<bool> = turns
            .chunk_by(|one, other| one.facets[0] == other.facets[0])
            .flat_map(|around| around.iter().map(|turn| around.iter().any(|other| turn.goes_on_in(other))))
            .collect();
        turns.into_iter().zip(goes_on).filter(|(_, goes_on)| *goes_on).map(|(turn, _)| turn).collect()
    }

    /// Joins the two triangles of each bent quadrilateral to one facet, where neither is one of the `continuing` ones; whether
    /// there are any. The side of a twisted prism is a row of such quadrilaterals: only both triangles together meet the sides
    /// before and behind.
    fn join_bent(&mut self, mesh: &TriMesh, continuing: &[Turn]) -> bool {
        let mut is_alone = vec![0; self.facets.len()];
        for &face in &self.faces {
            if let Some(count) = is_alone.get_mut(face as usize) {
                *count += 1;
            }
        }
        let mut is_alone: Vec<bool> = is_alone.into_iter().map(|triangles| triangles == 1).collect();
        continuing.iter().flat_map(|turn| turn.facets).for_each(|facet| is_alone[facet as usize] = false);
        let mut has_joined = false;
        for triangle in 0..self.faces.len() {
            let face = self.faces[triangle] as usize;
            if is_alone.get(face) != Some(&true) {
                continue;
            }
            let Some((other, shared)) = self.rest_of_quadrilateral(mesh, triangle) else { continue };
            let of_other = self.faces[other] as usize;
            if is_alone.get(of_other) != Some(&true) {
                continue;
            }
            let [one, two] = [face, of_other].map(|facet| &self.facets[facet]);
            if one.normal.angle(&two.normal) > BENT {
                continue;
            }
            let normal = one.normal * one.area + two.normal * two.area;
            let joined = Facet {
                normal: normal.try_normalize(0.0).unwrap_or(one.normal),
                middle: one.middle + two.middle,
                area: one.area + two.area,
                perimeter: one.perimeter + two.perimeter - 2.0 * shared,
            };
            self.facets[face] = joined;
            self.faces[other] = face as u32;
            (is_alone[face], is_alone[of_other]) = (false, false);
            has_joined = true;
        }
        has_joined
    }

    /// The triangle that makes a quadrilateral with opposite sides of about the same length with this one, and the length of the
    /// side between them, mm, which is the longest of both.
    fn rest_of_quadrilateral(&self, mesh: &TriMesh, triangle: usize) -> Option<(usize, f64)> {
        let sides = |triangle: usize| {
            let points = mesh.corners(mesh.triangles()[triangle]);
            [0, 1, 2].map(|side| (points[(side + 1) % 3] - points[side]).norm())
        };
        let longest = |sides: &[f64; 3]| {
            (0..3).fold(0, |most, side| if sides[side] > sides[most] { side } else { most })
        };
        let own = sides(triangle);
        let side = longest(&own);
        let opposite = self.opposite[3 * triangle + side] as usize;
        let other = opposite / 3;
        self.faces.get(other)?;
        let rest = sides(other);
        let are_opposite_alike =
            (1..3).all(|next| are_alike(own[(side + next) % 3], rest[(opposite + next) % 3]));
        (longest(&rest) == opposite % 3 && are_opposite_alike).then_some((other, own[side]))
    }

    /// The turn across a side, if the facets on both sides could be of one round face.
    fn turn(&self, side: usize) -> Option<Turn> {
        let facets = [self.faces[side / 3], *self.faces.get(self.opposite[side] as usize / 3)?];
        let [one, other] = facets.map(|facet| self.facets.get(facet as usize));
        let (one, other) = (one?, other?);
        let angle = one.normal.angle(&other.normal);
        let widths = [one.width(), other.width()];
        let [narrow, wide] = [widths[0].min(widths[1]), widths[0].max(widths[1])];
        let is_uneven = !are_alike(narrow, wide);
        let could_be_round = match is_uneven {
            false => (SAME_NORMAL..=CREASE_ANGLE).contains(&angle),
            // In a mesh without normals, those of two widths may take turns.
            true => {
                let is_of_round =
                    (SAME_NORMAL..=TURN_OF_PRISM).contains(&angle) && wide <= MOST_IN_TURN * narrow;
                is_of_round && !self.has_normals
            }
        };
        let step = other.middle() - one.middle();
        // The arc over one of uneven facets turns by its share of the angle.
        let of_wider = if is_uneven { 2.0 * wide / (wide + narrow) } else { 1.0 };
        // The arc is in the plane of both normals; along a strip, facets may be far from each other.
        let axis = one.normal.cross(&other.normal).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let chord = (step - axis * axis.dot(&step)).norm();
        let (bulge, is_convex) = (of_wider.powi(2) * chord * angle / 8.0, one.normal.dot(&step) < 0.0);
        let turn = Turn { facets, width: widths[1], is_uneven, angle, of_wider, bulge, is_convex };
        (could_be_round && facets[0] != facets[1]).then_some(turn)
    }
}

fn area([a, b, c]: [Point3<f64>; 3]) -> f64 {
    (b - a).cross(&(c - a)).norm() / 2.0
}

fn are_alike(one: f64, other: f64) -> bool {
    one <= ALIKE * other && other <= ALIKE * one
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// The facets of a cylinder with these widths in turn, rad, 60 mm long, each further along the axis than the one before by a `lead`,
    /// mm, without the last one and the ends.
    fn strip(radius: f64, widths: [f64; 2], lead: f64) -> TriMesh {
        let pairs = (TAU / (widths[0] + widths[1])).round() as u32;
        let angle = |index: u32| {
            let (pairs, own) = (index / 2, index % 2);
            f64::from(pairs) * (widths[0] + widths[1]) + f64::from(own) * widths[0]
        };
        let at = |index: u32, y: f64| {
            Point3::new(radius * angle(index).sin(), y + lead * f64::from(index), radius * angle(index).cos())
        };
        let positions = (0..2 * pairs).flat_map(|index| [-30.0, 30.0].map(|y| at(index, y))).collect();
        let triangles = (0..2 * pairs - 1).flat_map(|index| {
            let (here, next) = (2 * index, 2 * (index + 1));
            [[here, here + 1, next + 1], [here, next + 1, next]]
        });
        TriMesh::new(positions, Vec::new(), triangles.collect()).unwrap()
    }

    /// A bent strip of narrow facets, each with its normal, and its numbers rounded to 1 µm, as those of a file in metres.
    #[test]
    fn narrow_facets_are_flat_where_rounding_tilts_them() {
        let strip = strip(20.0, [0.0005; 2], 0.0);
        let (mut positions, mut normals) = (Vec::new(), Vec::new());
        for &triangle in strip.triangles() {
            let corners = strip.corners(triangle);
            normals.extend([facet_normal(corners); 3]);
            positions
                .extend(corners.map(|at| Point3::from(at.coords.map(|along| (along * 1e3).round() / 1e3))));
        }
        let triangles: Vec<[u32; 3]> =
            (0..positions.len() as u32 / 3).map(|first| [0, 1, 2].map(|turn| 3 * first + turn)).collect();
        let tilted = TriMesh::new(positions, normals, triangles).unwrap();
        let off =
            |triangle: usize| plane(&tilted, triangle).dot(&given(&tilted, triangle)[0]) < SAME_NORMAL.cos();
        assert!((0..tilted.triangles().len()).any(off));
        assert!(are_flat(&tilted).iter().all(|is_flat| *is_flat));
    }

    #[test]
    fn facets_of_two_widths_in_turn_may_be_round() {
        for (degrees, lead) in [[15.0, 5.0], [12.0, 4.0], [10.0, 10.0], [5.0, 15.0]]
            .into_iter()
            .flat_map(|degrees| [(degrees, 0.0), (degrees, 10.0)])
        {
            let widths = degrees.map(f64::to_radians);
            let open = OpenFacets::of(&strip(30.0, widths, lead)).unwrap();
            let most = open.roundings.iter().map(|rounding| rounding.bulge).fold(0.0, f64::max);
            let sagitta = 30.0 * (1.0 - (widths[0].max(widths[1]) / 2.0).cos());
            assert!((most / sagitta - 1.0).abs() < 0.05, "{degrees:?}, {lead} mm: {most} for {sagitta}");
        }
        // A prism with chamfered edges, and flat sides with narrow fillets.
        for degrees in [[44.0, 16.0], [22.0, 2.0]] {
            assert!(OpenFacets::of(&strip(30.0, degrees.map(f64::to_radians), 0.0)).is_none(), "{degrees:?}");
        }
    }
}
