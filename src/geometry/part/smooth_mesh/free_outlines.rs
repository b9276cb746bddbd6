//! Extruded faces with free outlines, for example the top of a key fob. Their facets run from rim to rim. The
//! sides of the facets are near the rulings but not along them.
//!
//! Seen along its rulings, such a face has all vertices on one plane curve, also where its rims run up and
//! down. At the rims, estimated normals would follow the small facets of a fillet. The long facets of the
//! face show the normals better.

use nalgebra::{Matrix2, Matrix3, Point3, Vector2, Vector3};

use super::SmoothMesh;
use super::curve_strip::CurveStrip;
use super::ends::{Surface, range};
use super::round::principal;
use crate::geometry::adjacency::{NONE, facet_normal, width};

/// One side of a facet from rim to rim is at least this many times as long as another side.
const LONG: f64 = 4.0;
/// One side of a facet near the end of an outline is at least this many times as long as another side.
const LONG_AT_END: f64 = 2.0;
/// Facets of a face turn by less than this from one to the next, rad.
const MOST_TURN: f64 = 0.6;
/// The long sides of facets of a face leave the direction of the first one by less than this, as a sine.
const ASKEW: f64 = 0.5;
/// The first long side of a face is at most this many times as long as the others.
const SHORTER: f64 = 5.0;
/// Facets of a face bend at most this many times as much as those before them, per mm of width. A fillet that
/// bends more is another face. Facets that turn by no more than [`NOTABLE_TURN`] are exempt.
const MORE_BENT: f64 = 15.0;
/// Facets that turn by at most this, rad, belong to a face however narrow they are.
const NOTABLE_TURN: f64 = 0.05;
/// Half of the turn of a face takes at least this share of its width.
const LEAST_OF_WIDTH: f64 = 0.12;
/// The normal of every facet of a face differs from the mean normal by at most the angle with this cosine.
const LEAST_FACING: f64 = 0.4;
/// A face has at least this many facets.
const LEAST_FACETS: usize = 6;
/// The normals of a face leave the plane across its rulings by at most this share of their turn in that
/// plane.
const LEAVES: f64 = 0.1;
/// Facets show rulings only if they turn by at least this, rad, root mean square.
const LEAST_TURN: f64 = 0.01;
/// The rims of a face vary along the rulings by at least this share of its length. Where they do not, only
/// the facets beyond the rims show whether the face is straight.
const FREE: f64 = 0.1;
/// The facets beyond the rims are narrower by at least this factor than those before them. Beyond a side
/// along the rulings they are at most this many times as wide.
const NARROWER: f64 = 2.0;
/// At most this share of the rims has facets beyond it that contradict [`NARROWER`].
const UNLIKE: f64 = 0.1;
/// A side is along the rulings if it differs from their direction by less than the angle with this cosine.
const ALONG: f64 = 0.9;
/// Arcs along a face leave its facets at most this many times as far as the arcs across it.
const FARTHER: f64 = 2.0;
/// Vertices are on one curve if they are off it by at most this share of the distance between the curve and
/// its chords.
const OF_BULGE: f64 = 0.2;
/// More than this share of the facets is on one curve.
const MOST: f64 = 0.8;
/// Facets that are not on the curve are removed in at most this many rounds.
const ROUNDS: usize = 5;
/// The direction of the rulings is found in this many steps.
const STEPS: usize = 3;
/// This many points on either side of a point show where the curve should be there.
const BESIDE: usize = 2;

/// The faces among triangles that are `open`, each with its axis and how far its slope may be off by what its facets hide, rad, root
/// mean square. Vertices may be off by `near`, mm.
pub(super) fn found<'a>(
    mesh: &'a SmoothMesh,
    is_open: &[bool],
    near: f64,
) -> Vec<(CurveStrip<'a>, Vector3<f64>, f32)> {
    let mut is_seen: Vec<bool> = is_open.iter().map(|is_open| !is_open).collect();
    let open = (0..is_seen.len()).filter(|&triangle| !is_seen[triangle]);
    let mut seeds: Vec<(usize, f64)> =
        open.filter_map(|triangle| Some((triangle, mesh.long_side(triangle, LONG)?.norm()))).collect();
    seeds.sort_by(|(_, one), (_, other)| other.total_cmp(one));
    let mut faces = Vec::new();
    for (seed, _) in seeds {
        if is_seen[seed] {
            continue;
        }
        let triangles = grown(mesh, seed, &mut is_seen);
        let Some(mut face) = Face::of(mesh, triangles) else { continue };
        if let Some(strip) = face.strip(near) {
            let doubt = face.hidden_slope(strip.largest_bulge());
            faces.push((strip, face.axis, doubt));
        }
    }
    faces
}

/// The angle between two triangles that meet at a side, rad, and that for each mm of their mean width.
fn bend(mesh: &SmoothMesh, side: usize, other: usize) -> (f64, f64) {
    let [one, two] = [side, other].map(|side| mesh.corners(side / 3).0);
    let turn = facet_normal(one).angle(&facet_normal(two));
    (turn, 2.0 * turn / (width(one, side % 3) + width(two, other % 3)))
}

/// The long triangles that continue one across their long sides and run and bend as it does, in ascending order.
fn grown(mesh: &SmoothMesh, seed: usize, is_seen: &mut [bool]) -> Vec<usize> {
    let first = mesh.long_side(seed, LONG).unwrap_or_else(Vector3::zeros);
    let runs_along = |side: Vector3<f64>| side.cross(&first).norm() < ASKEW * side.norm() * first.norm();
    let beyond = |side: usize| {
        let [from, to] = mesh.ends(side);
        mesh.continuing(side).filter(|_| runs_along(to - from))
    };
    let bends =
        |side: usize| beyond(side).map(|other| bend(mesh, side, other)).filter(|(turn, _)| *turn < MOST_TURN);
    let mut most = (3 * seed..3 * seed + 3).filter_map(bends).map(|(_, bend)| bend).fold(0.0, f64::max);
    is_seen[seed] = true;
    let mut found = vec![seed];
    let mut next = 0;
    while next < found.len() {
        let here = found[next];
        next += 1;
        for side in 3 * here..3 * here + 3 {
            let Some(other) = beyond(side).filter(|other| !is_seen[other / 3]) else { continue };
            let (turn, bend) = bend(mesh, side, other);
            if turn > MOST_TURN || turn > NOTABLE_TURN && bend > MORE_BENT * most {
                continue;
            }
            let long = mesh.long_side(other / 3, LONG_AT_END);
            if long.is_some_and(|long| runs_along(long) && SHORTER * long.norm() > first.norm()) {
                is_seen[other / 3] = true;
                found.push(other / 3);
                most = most.max(bend);
            }
        }
    }
    found.sort_unstable();
    found
}

/// Facets from rim to rim.
struct Face<'a> {
    mesh: &'a SmoothMesh,
    /// In ascending order.
    triangles: Vec<usize>,
    /// The vertices in the order of the curve.
    vertices: Vec<u32>,
    axis: Vector3<f64>,
    /// How far it reaches along the axis, mm.
    own: f64,
}

impl<'a> Face<'a> {
    /// `None` if the triangles have no common direction, or their rims are across it.
    fn of(mesh: &'a SmoothMesh, triangles: Vec<usize>) -> Option<Self> {
        let mut face = Self { mesh, triangles, vertices: Vec::new(), axis: Vector3::zeros(), own: 0.0 };
        face.settle()?;
        face.bends_evenly().then_some(face)
    }

    /// Whether half of its turn is not in a small part of its width, as where a fillet is between two flat sides.
    fn bends_evenly(&self) -> bool {
        let mut bends: Vec<(f64, f64)> = Vec::new();
        for side in self.triangles.iter().flat_map(|&triangle| 3 * triangle..3 * triangle + 3) {
            let Some(other) = self.mesh.continuing(side).filter(|other| *other > side) else { continue };
            if self.triangles.binary_search(&(other / 3)).is_ok() {
                bends.push(bend(self.mesh, side, other));
            }
        }
        bends.sort_by(|(_, one), (_, other)| other.total_cmp(one));
        let width = |(turn, bend): &(f64, f64)| if *bend > 0.0 { turn / bend } else { 0.0 };
        let (whole, wide): (f64, f64) =
            (bends.iter().map(|(turn, _)| turn).sum(), bends.iter().map(width).sum());
        let (mut turned, mut passed) = (0.0, 0.0);
        for bend in &bends {
            if turned >= whole / 2.0 {
                break;
            }
            turned += bend.0;
            passed += width(bend);
        }
        passed >= LEAST_OF_WIDTH * wide
    }

    /// Finds the axis, the order of the vertices and the length.
    fn settle(&mut self) -> Option<()> {
        let Self { mesh, triangles, .. } = self;
        if triangles.len() < LEAST_FACETS {
            return None;
        }
        let across = |&triangle: &usize| {
            let [a, b, c] = mesh.corners(triangle).0;
            (b - a).cross(&(c - a))
        };
        let middle = triangles.iter().map(across).sum::<Vector3<f64>>().try_normalize(0.0)?;
        let (mut spread, mut area) = (Matrix3::zeros(), 0.0);
        for across in triangles.iter().map(across) {
            let Some(normal) = across.try_normalize(0.0) else { continue };
            if normal.dot(&middle) < LEAST_FACING {
                return None;
            }
            spread += normal * normal.transpose() * across.norm();
            area += across.norm();
        }
        let ([off, turn, _], axis) = principal(spread / area, LEAVES)?;
        if turn < LEAST_TURN || off > LEAVES * turn {
            return None;
        }
        self.axis = *axis;
        self.vertices = triangles.iter().flat_map(|&triangle| mesh.triangles[triangle]).collect();
        self.vertices.sort_unstable();
        self.vertices.dedup();
        for _ in 0..STEPS {
            self.order(&middle);
            self.turn_axis()?;
        }
        self.order(&middle);
        let [low, high] = self.range_along(|_| true);
        self.own = high - low;
        let halves = [low, high].map(|end| {
            let [from, to] = self.range_along(|along| (along - end).abs() < self.own / 2.0);
            to - from
        });
        (halves[0] + halves[1] > FREE * self.own).then_some(())
    }

    fn at(&self, vertex: u32) -> Point3<f64> {
        self.mesh.positions[vertex as usize]
    }

    fn along(&self, vertex: u32) -> f64 {
        self.at(vertex).coords.dot(&self.axis)
    }

    fn range_along(&self, is_chosen: impl Fn(f64) -> bool) -> [f64; 2] {
        range(self.vertices.iter().map(|&vertex| self.along(vertex)).filter(|along| is_chosen(*along)))
    }

    /// Orders the vertices so that the outside of the curve is the outside of the facets. `middle` is the
    /// mean normal of the facets.
    fn order(&mut self, middle: &Vector3<f64>) {
        let ahead = self.axis.cross(middle);
        let mut places: Vec<(f64, u32)> =
            self.vertices.iter().map(|&vertex| (self.at(vertex).coords.dot(&ahead), vertex)).collect();
        places.sort_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)));
        self.vertices = places.into_iter().map(|(_, vertex)| vertex).collect();
    }

    /// For each vertex: how far it is, seen along the axis, from the cubic through the vertices beside it,
    /// mm, and by how much a turn of the axis reduces this distance, mm/rad. The axis turns towards the end
    /// of the curve, and away from the part. Both values are divided by the root of the sum of the squared
    /// weights of the vertices.
    fn offs(&self) -> Vec<(u32, f64, Vector2<f64>)> {
        let points = self.points();
        let mut places = vec![0.0; points.len()];
        for index in 1..points.len() {
            places[index] = places[index - 1] + (points[index] - points[index - 1]).norm();
        }
        let Some([ahead, up]) = self.directions() else { return Vec::new() };
        let off = |own: usize| {
            let others = || (own - BESIDE..=own + BESIDE).filter(|other| *other != own);
            // Where points nearly coincide, some have a large weight.
            let count = |other: usize| {
                let rest = others().filter(|rest| *rest != other);
                rest.map(|rest| (places[own] - places[rest]) / (places[other] - places[rest]))
                    .product::<f64>()
            };
            let sum = others().map(|other| points[other].coords * count(other)).sum::<Vector3<f64>>();
            let along = others().map(|other| self.along(self.vertices[other]) * count(other)).sum::<f64>();
            let size = (1.0 + others().map(|other| count(other).powi(2)).sum::<f64>()).sqrt();
            let normal = (points[own + 1] - points[own - 1]).cross(&self.axis).try_normalize(0.0)?;
            let by_turn = Vector2::new(normal.dot(&ahead), normal.dot(&up));
            let row = by_turn * (self.along(self.vertices[own]) - along) / size;
            let distance = (points[own].coords - sum).dot(&normal) / size;
            (distance + row.x + row.y).is_finite().then_some((self.vertices[own], distance, row))
        };
        (BESIDE..points.len().saturating_sub(BESIDE)).filter_map(off).collect()
    }

    /// The vertices as seen along the axis.
    fn points(&self) -> Vec<Point3<f64>> {
        let flat = |&vertex: &u32| self.at(vertex) - self.axis * self.along(vertex);
        self.vertices.iter().map(flat).collect()
    }

    /// From one end of the curve to the other, and away from the part; unit vectors.
    fn directions(&self) -> Option<[Vector3<f64>; 2]> {
        let [first, .., last] = &self.vertices[..] else { return None };
        let chord = self.at(*last) - self.at(*first);
        let ahead = (chord - self.axis * chord.dot(&self.axis)).try_normalize(0.0)?;
        Some([ahead, ahead.cross(&self.axis)])
    }

    /// Turns the axis so that the vertices are nearest to where those beside them show that they are.
    fn turn_axis(&mut self) -> Option<()> {
        let (mut matrix, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for (_, distance, row) in self.offs() {
            matrix += row * row.transpose();
            right += row * distance;
        }
        let step = matrix.cholesky()?.solve(&right);
        let [ahead, up] = self.directions()?;
        self.axis = (self.axis + ahead * step.x + up * step.y).try_normalize(0.0)?;
        Some(())
    }

    /// How far the curve leaves its chords, mm. If vertices are not on one curve, a curve through all of them
    /// zigzags; the middles of its chords do not.
    fn bulge(&self) -> f64 {
        let points = self.points();
        let middles: Vec<Point3<f64>> =
            points.windows(2).map(|pair| nalgebra::center(&pair[0], &pair[1])).collect();
        let bulges = middles.windows(3).map(|of| {
            let [one, other] = [of[1] - of[0], of[2] - of[1]];
            one.angle(&other) * one.norm().max(other.norm()) / 8.0
        });
        bulges.fold(0.0, f64::max)
    }

    /// The strip of the face, without facets whose vertices are not on one curve with most others, if it ends as one.
    fn strip(&mut self, near: f64) -> Option<CurveStrip<'a>> {
        let all = self.triangles.len();
        for _ in 0..ROUNDS {
            let Self { mesh, axis, triangles, vertices, .. } = &*self;
            let most = near.max(OF_BULGE * self.bulge());
            let offs = self.offs().into_iter().filter(|(_, off, _)| off.abs() > most);
            let mut off: Vec<u32> = offs.map(|(vertex, ..)| vertex).collect();
            if off.is_empty() {
                let strip = CurveStrip::of_all(mesh, *axis, triangles, vertices);
                return strip.filter(|_| self.ends_as_face());
            }
            off.sort_unstable();
            let is_off = |vertex: &u32| off.binary_search(vertex).is_ok();
            self.triangles.retain(|&triangle| !mesh.triangles[triangle].iter().any(is_off));
            if self.triangles.len() as f64 <= MOST * all as f64 {
                return None;
            }
            self.settle()?;
        }
        None
    }

    /// Whether the facets beyond its rims are those of something smaller, as a fillet.
    fn ends_as_face(&self) -> bool {
        let (mut rim, mut unlike) = (0.0, 0.0);
        for side in self.triangles.iter().flat_map(|&triangle| 3 * triangle..3 * triangle + 3) {
            let other = self.mesh.continued[side];
            if other == NONE || self.triangles.binary_search(&(other as usize / 3)).is_ok() {
                continue;
            }
            let [from, to] = self.mesh.ends(side);
            let length = (to - from).norm();
            rim += length;
            let reach = |side: usize| width(self.mesh.corners(side / 3).0, side % 3);
            let [here, beyond] = [side, other as usize].map(reach);
            let is_along = (to - from).dot(&self.axis).abs() > ALONG * length;
            // Beside the last facets of a face, there are others of its end, or narrow ones.
            let times = if is_along { 1.0 / NARROWER } else { NARROWER };
            if beyond * times > here {
                unlike += length;
            }
        }
        unlike <= UNLIKE * rim
    }

    /// How far the slope may be off, rad, root mean square, if the rulings are arcs that leave the facets farther than the curve across
    /// them: where both rims are alike, they do not show these.
    fn hidden_slope(&self, bulge: f64) -> f32 {
        (4.0 * FARTHER * bulge / self.own / 3f64.sqrt()) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::mesh::TriMesh;
    use crate::geometry::space::View;

    /// The top of a round part, 30 mm wide, with facets from rim to rim and rows of a fillet beyond; heights are those over a place. The
    /// rulings run along y.
    fn round_top(height: impl Fn(f64, f64) -> f64) -> SmoothMesh {
        const COUNT: u32 = 16;
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for (row, side) in [(2, -1.0), (1, -1.0), (0, -1.0), (0, 1.0), (1, 1.0), (2, 1.0)] {
            for step in 0..=COUNT {
                // The far rim is cut elsewhere.
                let shift = if side > 0.0 && step > 0 && step < COUNT { 0.03 } else { 0.0 };
                let angle = 0.3 + (std::f64::consts::PI - 0.6) * f64::from(step) / f64::from(COUNT) + shift;
                let (x, y) = (15.0 * angle.cos(), 15.0 * angle.sin() * side);
                let turn = 0.3 * f64::from(row);
                let out = 1.0 + 1.5 * turn.sin() / 15.0;
                positions.push(Point3::new(x * out, y * out, height(x, y) - 1.5 * (1.0 - turn.cos())));
            }
        }
        for low in (0..5).flat_map(|row| (0..COUNT).map(move |step| row * (COUNT + 1) + step)) {
            let high = low + COUNT + 1;
            triangles.extend([[low, high + 1, low + 1], [low, high, high + 1]]);
        }
        SmoothMesh::new(&TriMesh::new(positions, Vec::new(), triangles).unwrap(), &View::top())
    }

    /// Of the facets between the rims.
    fn found_faces(mesh: &SmoothMesh) -> usize {
        found(mesh, &vec![true; mesh.triangles.len()], 1e-4).len()
    }

    #[test]
    fn an_extruded_top_with_a_round_outline_has_the_normals_of_its_curve() {
        // No arc: the curvature grows from one side to the other.
        let height = |x: f64| -x * x / 120.0 - x * x * x / 9000.0;
        let top = round_top(|x, _| height(x));
        let mut largest = 0.0f64;
        let mut count = 0;
        for triangle in 0..top.triangles.len() {
            let (corners, normals) = top.corners(triangle);
            if !corners.iter().all(|at| (at.coords.xy().norm() - 15.0).abs() < 1e-9) {
                continue;
            }
            count += 1;
            for (at, normal) in corners.iter().zip(normals) {
                let slope = -at.x / 60.0 - at.x * at.x / 3000.0;
                let exact = Vector3::new(-slope, 0.0, 1.0).normalize();
                largest = largest.max(exact.cross(&normal).norm());
            }
        }
        assert_eq!(count, 32);
        // A facet turns by 0.03 rad, and the first one of the fillet leans by 0.15 rad.
        assert!(largest < 2e-3, "{largest}");
    }

    #[test]
    fn a_top_that_bends_more_at_one_end_is_no_extruded_face() {
        assert_eq!(found_faces(&round_top(|x, _| -x * x / 120.0 - x * x * x / 9000.0)), 1);
        assert_eq!(found_faces(&round_top(|x, y| -x * x / 120.0 - y * x * x / 6000.0)), 0);
    }

    #[test]
    fn flat_sides_with_a_fillet_between_them_are_no_extruded_face() {
        let corner = |x: f64| if x.abs() < 1.0 { -x * x / 4.0 } else { 0.25 - x.abs() / 2.0 };
        assert_eq!(found_faces(&round_top(|x, _| corner(x))), 0);
    }
}
