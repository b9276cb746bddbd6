//! Curved triangles: a CAD tessellation has few, large facets, but its vertices and normals are those of the
//! exact surface.

use nalgebra::{Matrix2, Point3, Vector2, Vector3};

/// A normal that deviates further than this from its facet's, as a cosine, is damaged; the facet's normal is used
/// instead.
const MIN_AGREEMENT: f64 = 0.5;
/// When two handles share a turn, each gets at least this share of the mean: with less, the side would not be
/// an arc.
const MIN_SHARE: f64 = 0.25;
/// Ends that are less than this below the tangent planes, mm, give no information about the turn between them: along a
/// ruling both distances are only the rounding of the file's numbers.
const MIN_FALL: f64 = 1e-3;
/// How sharply sides along a ruling are distinguished from sides across it: the exponent of the weight in [`handle`].
const ALONG_POWER: i32 = 8;
/// A handle is bounded only if the normals at its ends are at most this far apart, squared, no unit.
const LITTLE_TURN: f64 = 0.2;
/// A handle is bounded only if the cosines between the normals and their facet are above this. Such normals
/// are certainly not damaged ([`MIN_AGREEMENT`]).
const AGREEMENT: f64 = 0.51;
/// A bounded handle leaves its side by at most this share of the distance between the end of the side and the
/// tangent plane.
const MOST_SHARE: f64 = 0.347;
/// A bounded handle is longer than a third of its side by at most this share of the side times the square of
/// the turn.
const LONGER: f64 = 1.0 / 15.0;
/// An uneven turn, as along a cone, moves a bounded handle by at most this share of its side.
const ALONG_TURN: f64 = 0.053;
/// Barycentric coordinates may be this far below 0, so that no node on the border of two triangles is missed.
const BORDER_TOLERANCE: f64 = 1e-6;
/// A triangle whose curved net stays this close to its facet, mm, is treated as flat.
const FLATNESS: f64 = 1e-7;
/// Within this distance of the point sought, mm, and with a step of at most this in the parameters, the last step follows the
/// tangent plane: what remains is about the square of the step.
const NEAR: [f64; 2] = [1e-6, 1e-3];
/// At this distance, mm, the point is met.
const MET: f64 = 1e-10;

/// Steps along a side of the grid on which a patch is compared with a surface.
const STEPS: u32 = 4;

/// A cubic patch through the corners of a triangle and perpendicular to their normals, in the frame of the view.
///
/// Vlachos, Peters, Boyd & Mitchell, Curved PN triangles, Symposium on Interactive 3D Graphics 2001, section 3;
/// with the edges' handles lengthened so that circular edges are circular.
#[derive(Debug, Clone)]
pub struct CurvedTriangle {
    corners: [Point3<f64>; 3],
    /// Control net minus the flat net: edge points 210, 120, 021, 012, 102, 201, then the middle 111.
    bulge: [Vector3<f64>; 7],
    largest_bulge: f64,
}

/// A curved triangle prepared to be met by the laser's axis at many points.
#[derive(Debug, Clone)]
pub struct SeenTriangle {
    /// The first corner of the facet, mm.
    corner: Point3<f64>,
    /// From there to the second and to the third.
    sides: [Vector3<f64>; 2],
    /// From steps in the view, mm, to those of the barycentric coordinates v and w of the flat facet.
    flat_inverse: Matrix2<f64>,
    /// Lower bounds of the flat facet's barycentric coordinates of all points that the patch covers, with the tolerance at the border.
    least: [f64; 3],
    flat: bool,
    patch: Cubic,
}

/// A triangular patch as a polynomial of the barycentric coordinates v and w of the second and third corner, mm.
#[derive(Debug, Clone)]
struct Cubic {
    /// The coefficients of 1, v, v², v³.
    along_v: [Vector3<f64>; 4],
    /// Those of w, vw, v²w.
    once_w: [Vector3<f64>; 3],
    /// Those of w², vw².
    twice_w: [Vector3<f64>; 2],
    /// That of w³.
    cube_w: Vector3<f64>,
}

/// Where the laser's axis through a grid node meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Height z, mm.
    pub height: f64,
    /// (∂z/∂x, ∂z/∂y), no unit; infinite for a wall.
    pub gradient: Vector2<f64>,
    /// Whether the curved patch was hit; otherwise only its flat facet was, next to a neighbour that bulges over it.
    pub on_patch: bool,
}

impl Hit {
    /// Tangent of the angle between surface normal and laser axis (infinite for a wall).
    pub fn steepness(&self) -> f64 {
        self.gradient.norm()
    }
}

impl CurvedTriangle {
    /// The patch over `corners` (mm) with their unit `normals`; a zero normal, or one more than 60° away from the
    /// facet's, is replaced by the facet's.
    pub fn new(corners: [Point3<f64>; 3], normals: [Vector3<f64>; 3]) -> Self {
        Self::beside_edges(corners, normals, [None; 3])
    }

    /// The patch of a triangle at edges of the part. `edges` gives, for each side (corner to next corner) that is an
    /// edge of the part, the unit directions of the edge at both ends. The patches on both sides of the edge then
    /// share it.
    pub fn beside_edges(
        corners: [Point3<f64>; 3],
        normals: [Vector3<f64>; 3],
        edges: [Option<[Vector3<f64>; 2]>; 3],
    ) -> Self {
        let [a, b, c] = corners;
        let facet = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        // Only the tangent plane is used, so the normals of an inside-out part are valid too.
        let normals =
            normals.map(|normal| if normal.dot(&facet).abs() < MIN_AGREEMENT { facet } else { normal });
        let edge = |from: usize, to: usize| {
            let side = if to == (from + 1) % 3 { from } else { to };
            match edges[side] {
                Some([first, last]) if side == from => {
                    edge_handle(corners[to] - corners[from], [first, last])
                }
                Some([first, last]) => edge_handle(corners[to] - corners[from], [-last, -first]),
                None => handle([corners[from], corners[to]], [normals[from], normals[to]]),
            }
        };
        let handles = [edge(0, 1), edge(1, 0), edge(1, 2), edge(2, 1), edge(2, 0), edge(0, 2)];
        let beside = [0, 1, 2].map(|side| {
            if edges[side].is_none() {
                return Vector3::zeros();
            }
            let next = (side + 1) % 3;
            let geodesic =
                |from: usize, to: usize| handle([corners[from], corners[to]], [normals[from], normals[to]]);
            handles[2 * side] + handles[2 * side + 1] - geodesic(side, next) - geodesic(next, side)
        });
        let middle = handles.iter().sum::<Vector3<f64>>() / 4.0 + middle_of_turns(corners, normals, beside);
        Self::of_net(
            corners,
            [handles[0], handles[1], handles[2], handles[3], handles[4], handles[5], middle],
        )
    }

    fn of_net(corners: [Point3<f64>; 3], bulge: [Vector3<f64>; 7]) -> Self {
        let largest_bulge = bulge.iter().map(Vector3::norm).fold(0.0, f64::max);
        Self { corners, bulge, largest_bulge }
    }

    /// The same patch with its middle where the slope across a side changes evenly along it, for `normals` that are known: errors of
    /// estimated ones bend the sides unevenly, too.
    pub(super) fn with_even_slopes(self, normals: [Vector3<f64>; 3]) -> Self {
        let Self { corners, mut bulge, .. } = self;
        let [a, b, c] = corners;
        let Some(facet) = (b - a).cross(&(c - a)).try_normalize(0.0) else { return self };
        // The normals of an inside-out part are valid, too.
        let normals = normals.map(|normal| if normal.dot(&facet) < 0.0 { -normal } else { normal });
        // By half of the difference between the heights of both handles of a side, mm. On cylinders, these
        // heights are equal along the mean of the normals.
        let uneven = [0, 1, 2].map(|side| {
            let normal = (normals[side] + normals[(side + 1) % 3]).try_normalize(0.0).unwrap_or(facet);
            (bulge[2 * side] - bulge[2 * side + 1]).dot(&normal) / 2.0
        });
        bulge[6] += facet * height_of_bends(corners, uneven);
        Self::of_net(corners, bulge)
    }

    /// At least the [largest bulge](Self::largest_bulge) of the patch over `corners` (mm) with their unit
    /// `normals`, without its roots; infinite where the normals turn much.
    ///
    /// The distance of a handle from its side has three parts: its excess over a third of the side; its share
    /// of the distance between the side and the tangent plane; and its change along the turn, which is
    /// largest where the turn makes an angle of 76° with the side.
    pub(super) fn most_bulge(corners: [Point3<f64>; 3], normals: [Vector3<f64>; 3]) -> f64 {
        let [a, b, c] = corners;
        let facet = (b - a).cross(&(c - a));
        let least = AGREEMENT * AGREEMENT * facet.norm_squared();
        if !normals.iter().all(|normal| normal.dot(&facet).powi(2) > least) {
            return f64::INFINITY;
        }
        let (mut longest, mut turn, mut lean, mut uneven, mut unlike) =
            (0.0f64, 0.0f64, 0.0f64, 0.0f64, 0.0f64);
        for from in 0..3 {
            let to = (from + 1) % 3;
            let along = corners[to] - corners[from];
            let falls = [-along.dot(&normals[from]), along.dot(&normals[to])];
            longest = longest.max(along.norm_squared());
            turn = turn.max((normals[to] - normals[from]).norm_squared());
            lean = lean.max(falls[0].abs()).max(falls[1].abs());
            unlike = unlike.max((falls[1] - falls[0]).abs());
            if falls[0] * falls[1] > 0.0 && falls[0].abs().min(falls[1].abs()) > MIN_FALL {
                uneven = uneven.max(((falls[1] - falls[0]) / (falls[1] + falls[0])).abs());
            }
        }
        if turn > LITTLE_TURN {
            return f64::INFINITY;
        }
        let changed = longest.sqrt() * uneven * ALONG_TURN;
        let handle = longest.sqrt() * turn * LONGER + changed + lean * MOST_SHARE;
        // Half of the difference between the heights of two handles above the facet. The distances of the
        // sides from the tangent planes differ, and the planes differ.
        let bend = changed + (unlike + lean * turn.sqrt()) * MOST_SHARE / 2.0;
        // The middle point is a quarter of the sum of six handles, and what the turns add: of two medians, at most twice as long and
        // with twice the turn of a side. Uneven bends add two and a half of theirs, and one and a quarter beside an obtuse angle.
        1.5 * handle + 3.75 * bend + longest.sqrt() * turn * (1.0 / 11.5 + turn.sqrt() / 15.5) + FLATNESS
    }

    /// Distance by which the patch can leave its facet, mm.
    pub fn largest_bulge(&self) -> f64 {
        self.largest_bulge
    }

    /// Points of the patch, mm, with its unit normals there, on a grid of [`STEPS`] steps along each side; a normal is zero where
    /// the patch is degenerate.
    pub(super) fn grid(&self) -> impl Iterator<Item = (Point3<f64>, Vector3<f64>)> + use<> {
        let patch = Cubic::of(self);
        let places = (0..=STEPS).flat_map(|row| (0..=STEPS - row).map(move |column| [row, column]));
        places.map(move |place| {
            let [v, w] = place.map(|index| f64::from(index) / f64::from(STEPS));
            let (point, normal) = patch.point_and_normal(v, w);
            (point.into(), normal)
        })
    }

    /// For each side (the first from the first corner to the second) the unit normals at its middle and at one of the `shares` of it;
    /// zero where the patch is degenerate.
    pub(super) fn normals_beside(&self, shares: [f64; 3]) -> [[Vector3<f64>; 2]; 3] {
        let patch = Cubic::of(self);
        [0, 1, 2].map(|side| {
            [0.5, shares[side]].map(|share| {
                let [v, w] = [[share, 0.0], [1.0 - share, share], [0.0, 1.0 - share]][side];
                patch.point_and_normal(v, w).1
            })
        })
    }

    /// The triangle as the laser sees it; `None` if its facet is a wall.
    pub fn seen(&self) -> Option<SeenTriangle> {
        let [a, b, c] = self.corners;
        let (ab, ac) = (b - a, c - a);
        let flat_inverse = Matrix2::new(ab.x, ac.x, ab.y, ac.y).try_inverse()?;
        // The weights of the bulge's control points are between 0 and 1, and so is their sum.
        let (mut least, mut most) = ([0.0f64; 3], 0.0f64);
        for step in &self.bulge {
            let moved = flat_inverse * step.xy();
            for (least, moved) in least.iter_mut().zip([-moved.x - moved.y, moved.x, moved.y]) {
                *least = least.min(moved);
                most = most.max(moved.abs());
            }
        }
        // Beside the border, within its tolerance, the weights are a little beyond these bounds.
        let least = least.map(|least| least - 10.0 * BORDER_TOLERANCE * (1.0 + most));
        let flat = self.largest_bulge < FLATNESS;
        Some(SeenTriangle { corner: a, sides: [ab, ac], flat_inverse, least, flat, patch: Cubic::of(self) })
    }

    /// The height of the triangle at a point of the view, if the triangle covers that point.
    pub fn hit(&self, at: Vector2<f64>) -> Option<Hit> {
        self.seen()?.hit(at)
    }
}

impl SeenTriangle {
    /// The height of the triangle at a point of the view, if the triangle covers that point.
    pub fn hit(&self, at: Vector2<f64>) -> Option<Hit> {
        let [ab, ac] = self.sides;
        let start = self.flat_inverse * (at - self.corner.coords.xy());
        let flat = [1.0 - start.x - start.y, start.x, start.y];
        if flat.iter().zip(&self.least).any(|(own, least)| own < least) {
            return None;
        }
        let inside = |v: f64, w: f64| v.min(w).min(1.0 - v - w) >= -BORDER_TOLERANCE;
        let flat_hit = || {
            inside(start.x, start.y).then(|| Hit {
                height: (self.corner + ab * start.x + ac * start.y).z,
                gradient: gradient(&ab.cross(&ac)),
                on_patch: self.flat,
            })
        };
        if self.flat {
            return flat_hit();
        }
        // Newton's method on (x, y): the patch is nearly flat, so a few steps reach the last digits.
        let mut parameter = start;
        for _ in 0..12 {
            let (point, by_v, by_w) = self.patch.at(parameter.x, parameter.y);
            let miss = at - point.xy();
            // At a corner the patch may be exactly along the laser: no step leads on, and none is needed.
            let step = if miss.norm() < MET {
                Vector2::zeros()
            } else {
                let Some(inverse) = Matrix2::new(by_v.x, by_w.x, by_v.y, by_w.y).try_inverse() else { break };
                inverse * miss
            };
            if miss.norm() < NEAR[0] && step.norm() < NEAR[1] {
                let end = parameter + step;
                if !inside(end.x, end.y) {
                    break;
                }
                let height = point.z + by_v.z * step.x + by_w.z * step.y;
                return Some(Hit { height, gradient: gradient(&by_v.cross(&by_w)), on_patch: true });
            }
            if !(step.norm() < 1.0) {
                break;
            }
            parameter += step;
        }
        flat_hit()
    }
}

impl Cubic {
    /// The patch over a triangle: the facet and the Bernstein polynomials 3u²v, 3uv², 3v²w, 3vw², 3uw², 3u²w, 6uvw of its bulge
    /// with u = 1 − v − w, multiplied out.
    fn of(triangle: &CurvedTriangle) -> Self {
        let [a, b, c] = triangle.corners;
        let [uuv, uvv, vvw, vww, uww, uuw, uvw] = triangle.bulge.map(|step| step * 3.0);
        let uvw = uvw * 2.0;
        Self {
            along_v: [a.coords, b - a + uuv, uvv - uuv * 2.0, uuv - uvv],
            once_w: [c - a + uuw, uvw - (uuv + uuw) * 2.0, uuv * 2.0 - uvv + vvw + uuw - uvw],
            twice_w: [uww - uuw * 2.0, uuv + vww - uww + uuw * 2.0 - uvw],
            cube_w: uuw - uww,
        }
    }

    /// The point, mm, and the unit normal; zero where the patch is degenerate.
    fn point_and_normal(&self, v: f64, w: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (point, by_v, by_w) = self.at(v, w);
        (point, by_v.cross(&by_w).try_normalize(0.0).unwrap_or_else(Vector3::zeros))
    }

    /// The point, mm, and its derivatives by v and w.
    #[inline]
    fn at(&self, v: f64, w: f64) -> (Vector3<f64>, Vector3<f64>, Vector3<f64>) {
        let ([v0, v1, v2, v3], [w0, w1, w2], [ww0, ww1]) = (self.along_v, self.once_w, self.twice_w);
        let (once, twice) = (w0 + (w1 + w2 * v) * v, ww0 + ww1 * v);
        let point = v0 + (v1 + (v2 + v3 * v) * v) * v + (once + (twice + self.cube_w * w) * w) * w;
        let by_v = v1 + (v2 * 2.0 + v3 * (3.0 * v)) * v + (w1 + w2 * (2.0 * v) + ww1 * w) * w;
        let by_w = once + (twice * 2.0 + self.cube_w * (3.0 * w)) * w;
        (point, by_v, by_w)
    }
}

/// The control point next to the first of two `ends`, minus that of the straight side.
fn handle(ends: [Point3<f64>; 2], normals: [Vector3<f64>; 2]) -> Vector3<f64> {
    let along = ends[1] - ends[0];
    let mut tangent = along - normals[0] * along.dot(&normals[0]);
    // How far each end is below the tangent plane of the other.
    let falls = [-along.dot(&normals[0]), along.dot(&normals[1])];
    let turn = normals[1] - normals[0] * normals[0].dot(&normals[1]);
    if falls[0] * falls[1] > 0.0 && falls[0].abs().min(falls[1].abs()) > MIN_FALL {
        // Along a cone the radius changes from end to end: the component of the handle along the turn is longer where
        // the surface is flatter. A side in the direction of the turn itself gives no information about a second
        // radius.
        let across = tangent.dot(&turn).powi(2) / (tangent.norm_squared() * turn.norm_squared());
        let share = (2.0 * falls[1] / (falls[0] + falls[1])).clamp(MIN_SHARE, 2.0 - MIN_SHARE);
        let change = (share - 1.0) * (1.0 - across).powi(ALONG_POWER);
        tangent += turn * (tangent.dot(&turn) / turn.norm_squared() * change);
    }
    tangent * arc_share(normals) - along / 3.0
}

/// The direction, not of unit length, of the curve that is a side of all patches between two `ends` with these unit `normals`, at a
/// share of it.
pub(super) fn direction_between(
    ends: [Point3<f64>; 2],
    normals: [Vector3<f64>; 2],
    share: f64,
) -> Vector3<f64> {
    let third = (ends[1] - ends[0]) / 3.0;
    let [first, last] = [handle(ends, normals), handle([ends[1], ends[0]], [normals[1], normals[0]])];
    let rest = 1.0 - share;
    (third + first) * (rest * rest)
        + (third + last - first) * (2.0 * rest * share)
        + (third - last) * (share * share)
}

/// The handle for an edge of the part whose directions at both ends are known.
fn edge_handle(along: Vector3<f64>, directions: [Vector3<f64>; 2]) -> Vector3<f64> {
    directions[0] * (along.dot(&directions[0]) * arc_share(directions)) - along / 3.0
}

/// What the middle point of a patch is beyond that of quadratics, mm: b111 = E + (E − V)/2 + this, where the means E of the handles
/// and V of the corners are those of Vlachos et al.
///
/// A cubic has one coefficient that its sides do not show, the third derivative along the three medians. In the chart of the
/// geodesics from the middle, a surface with the shape operator S and the second fundamental form II is u − II(u, u)·S u/6 in the
/// tangent plane and II(u, u)/2 − II(u, u)·|S u|²/24 along the normal, where II changes little. Circular sides move u along the surface
/// by a twenty-fourth of II(u, u)·S u, which leaves −II(u, u)·S u/8 and no fourth power; geodesics that are sides bend towards the
/// middle where the Gaussian curvature is not 0. The three terms are what both and the chart give for the medians. Cylinders become
/// exact but for the sixth power of the turn, spheres and tori several times better.
///
/// `beside` is twice the mean by which the handles of each side leave those of a geodesic, mm.
fn middle_of_turns(
    corners: [Point3<f64>; 3],
    normals: [Vector3<f64>; 3],
    beside: [Vector3<f64>; 3],
) -> Vector3<f64> {
    let Some(normal) = (normals[0] + normals[1] + normals[2]).try_normalize(0.0) else {
        return Vector3::zeros();
    };
    let turns = [0, 1, 2].map(|side| normals[(side + 1) % 3] - normals[side]);
    // An arc is longer than its chord by a twenty-fourth of the square of its turn.
    let longer = turns.map(|turn| 1.0 + turn.norm_squared() / 24.0);
    let sides = [0, 1, 2].map(|side| (corners[(side + 1) % 3] - corners[side]) * longer[side]);
    let turns = [0, 1, 2].map(|side| turns[side] * longer[side]);
    // Three times the step from the middle to a corner, and the turn of the normal along it.
    let median = |of: [Vector3<f64>; 3], side: usize| of[(side + 1) % 3] - of[(side + 2) % 3];
    let medians = [0, 1, 2].map(|side| (median(sides, side), median(turns, side)));
    let (mut tangential, mut along_normal) = (Vector3::zeros(), 0.0);
    let turned_area = normal.dot(&turns[0].cross(&turns[1]));
    for side in 0..3 {
        let [(first, first_turn), (second, second_turn), (_, third_turn)] =
            [side, (side + 1) % 3, (side + 2) % 3].map(|index| medians[index]);
        tangential -= third_turn * (first_turn.dot(&second) + second_turn.dot(&first)) / 576.0;
        along_normal += turns[side].dot(&sides[side]) * turns[side].norm_squared() / 576.0;
        // The median of this index ends at the corner that faces the side.
        along_normal -= first_turn.dot(&sides[side].cross(&normal)) * turned_area / 108.0;
        along_normal -= first_turn.dot(&beside[side]) / 8.0;
    }
    tangential + normal * (along_normal - normal.dot(&tangential))
}

/// How much higher than that of quadratics the middle point of a patch is, mm, where its sides bend unevenly: where each is higher by
/// the `uneven` height at its first handle than in their mean, and as much lower at its last one.
///
/// The slope across a side changes evenly from one end of it to the other, as in the reduced triangle of Clough & Tocher (Ciarlet, The
/// Finite Element Method for Elliptic Problems, 1978, section 6.1). Each side asks for a middle point of its own, and counts by the
/// square of the slope across it that another one would add. The narrower a patch between long sides is, the closer it follows an
/// extruded curve of the third degree; without this, it would fold. A wide one is about as far from it as that of quadratics.
fn height_of_bends(corners: [Point3<f64>; 3], uneven: [f64; 3]) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for side in 0..3 {
        let (next, last) = ((side + 1) % 3, (side + 2) % 3);
        let (along, to) = (corners[next] - corners[side], corners[last] - corners[side]);
        let squared = along.norm_squared();
        if squared > 0.0 {
            let weight = squared * squared.sqrt();
            let foot = to.dot(&along) / squared;
            sum += weight * ((1.5 - 3.0 * foot) * uneven[side] + (uneven[next] - uneven[last]) / 2.0);
            weights += weight;
        }
    }
    if weights > 0.0 { sum / weights } else { 0.0 }
}

/// Handle length as a share of the projected side. It makes an edge of constant curvature, as on cylinders, cones and
/// spheres, nearly a circular arc; the paper's handles are shorter. A straight edge stays straight. The turn of the
/// edge is the angle between the normals, or the directions, at its ends.
fn arc_share(ends: [Vector3<f64>; 2]) -> f64 {
    let half_turn = (ends[0].dot(&ends[1]).clamp(0.0, 1.0) / 2.0 + 0.5).sqrt();
    2.0 / (3.0 * (1.0 + half_turn) * half_turn)
}

fn gradient(normal: &Vector3<f64>) -> Vector2<f64> {
    if normal.z == 0.0 { Vector2::new(f64::INFINITY, 0.0) } else { -normal.xy() / normal.z }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_facet_of_a_coarse_cylinder_reproduces_the_cylinder() {
        // 0.5 rad per facet, as in FreeCAD's coarse tessellation of a can of radius 33 mm: a sagitta of 1.03 mm.
        let on_cylinder = |angle: f64, y: f64| {
            let normal = Vector3::new(angle.sin(), 0.0, angle.cos());
            (Point3::from(normal * 33.0 + Vector3::new(0.0, y, 0.0)), normal)
        };
        let corners = [on_cylinder(-0.1, 0.0), on_cylinder(0.4, 0.0), on_cylinder(-0.1, 100.0)];
        let patch = CurvedTriangle::new(corners.map(|c| c.0), corners.map(|c| c.1));
        for (x, y) in [(0.0, 10.0), (5.0, 20.0), (10.0, 4.0), (-3.0, 95.0)] {
            let hit = patch.hit(Vector2::new(x, y)).unwrap();
            let miss = hit.height - (33.0f64 * 33.0 - x * x).sqrt();
            assert!(hit.on_patch && miss.abs() < 0.0015, "({x}, {y}): {miss} mm");
        }
    }

    /// The largest distance, mm, of a patch over corners with `point_and_normal` at these places from a surface.
    fn largest_miss(
        places: [[f64; 2]; 3],
        edges: [Option<[Vector3<f64>; 2]>; 3],
        point_and_normal: impl Fn([f64; 2]) -> (Vector3<f64>, Vector3<f64>),
        distance: impl Fn(Point3<f64>) -> f64,
    ) -> f64 {
        let corners = places.map(point_and_normal);
        let patch = CurvedTriangle::beside_edges(corners.map(|c| c.0.into()), corners.map(|c| c.1), edges);
        patch.grid().map(|(point, _)| distance(point).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn slanted_facets_of_eight_sides_reproduce_a_cylinder() {
        let on_cylinder = |[angle, y]: [f64; 2]| {
            let normal = Vector3::new(angle.sin(), 0.0, angle.cos());
            (normal * 20.0 + Vector3::new(0.0, y, 0.0), normal)
        };
        let turn = std::f64::consts::FRAC_PI_4;
        for third in [0.0, 0.2, 0.5, 1.0] {
            let places = [[0.0, 0.0], [turn, 3.0], [third * turn, 12.0]];
            let miss = largest_miss(places, [None; 3], on_cylinder, |point| point.x.hypot(point.z) - 20.0);
            // Without the turns of the normals the miss is up to 0.0072 mm.
            assert!(miss < 7e-4, "{third}: {miss} mm");
        }
    }

    #[test]
    fn facets_that_turn_both_ways_are_round_in_their_middle() {
        let places = [[0.0, 0.0], [12.0, 1.0], [5.0, 9.0]];
        let on_sphere = |[x, y]: [f64; 2]| {
            let point = Vector3::new(x, y, (20.0f64 * 20.0 - x * x - y * y).sqrt());
            (point, point / 20.0)
        };
        let on_torus = |[around, along]: [f64; 2]| {
            let (small, large) = (around / 20.0, along / 60.0);
            let outwards = Vector3::new(0.0, large.sin(), large.cos());
            let normal = outwards * small.cos() + Vector3::x() * small.sin();
            (outwards * 60.0 + normal * 20.0, normal)
        };
        let sphere = largest_miss(places, [None; 3], on_sphere, |point| point.coords.norm() - 20.0);
        let torus = largest_miss(places, [None; 3], on_torus, |point| {
            (point.y.hypot(point.z) - 60.0).hypot(point.x) - 20.0
        });
        // Without the turns of the normals 0.0199 and 0.0050 mm.
        assert!(sphere < 3e-3 && torus < 2e-3, "{sphere} {torus} mm");
    }

    #[test]
    fn a_border_that_is_no_geodesic_leaves_the_middle_round() {
        // A ball of 20 mm that ends at a plane: the border is a circle of 16 mm.
        let on_ball = |[angle, z]: [f64; 2]| {
            let radius = (20.0f64 * 20.0 - z * z).sqrt();
            let point = Vector3::new(radius * angle.cos(), radius * angle.sin(), z);
            (point, point / 20.0)
        };
        let along = |angle: f64| Vector3::new(-angle.sin(), angle.cos(), 0.0);
        let places = [[-0.3, 12.0], [0.3, 12.0], [0.1, 18.0]];
        let border = Some([along(-0.3), along(0.3)]);
        // Without the turns of the normals 0.038 mm, as if the border was a geodesic 0.027 mm.
        let miss = largest_miss(places, [border, None, None], on_ball, |point| point.coords.norm() - 20.0);
        assert!(miss < 5e-3, "{miss} mm");
    }

    #[test]
    fn the_polynomial_of_a_patch_is_its_bezier_form() {
        let corners = [[0.0, 0.0, 1.0], [7.0, 1.0, 0.4], [2.0, 5.0, 0.1]].map(Point3::from);
        let normals =
            [[-0.2, 0.1, 1.0], [0.3, 0.2, 1.0], [0.1, 0.4, 1.0]].map(|n| Vector3::from(n).normalize());
        let patch = CurvedTriangle::new(corners, normals);
        let cubic = Cubic::of(&patch);
        let bezier = |v: f64, w: f64| {
            let u = 1.0 - v - w;
            let flat = corners[0].coords * u + corners[1].coords * v + corners[2].coords * w;
            let weights = [u * u * v, u * v * v, v * v * w, v * w * w, u * w * w, u * u * w, 2.0 * u * v * w];
            patch.bulge.iter().zip(weights).fold(flat, |sum, (step, weight)| sum + step * (3.0 * weight))
        };
        for (v, w) in [(0.2, 0.3), (0.0, 0.0), (0.9, 0.05), (-0.1, 0.4)] {
            let (point, by_v, by_w) = cubic.at(v, w);
            assert!((point - bezier(v, w)).norm() < 1e-13);
            let h = 1e-5;
            assert!((by_v - (bezier(v + h, w) - bezier(v - h, w)) / (2.0 * h)).norm() < 1e-8);
            assert!((by_w - (bezier(v, w + h) - bezier(v, w - h)) / (2.0 * h)).norm() < 1e-8);
        }
    }

    #[test]
    fn no_place_of_a_patch_is_rejected() {
        let corners = [[0.0, 0.0, 1.0], [7.0, 1.0, 0.4], [2.0, 5.0, 0.1]].map(Point3::from);
        // Its sides bulge outwards and inwards in the view.
        let normals =
            [[-0.5, 0.3, 1.0], [0.5, -0.4, 1.0], [0.1, 0.6, 1.0]].map(|n| Vector3::from(n).normalize());
        let patch = CurvedTriangle::new(corners, normals);
        let cubic = Cubic::of(&patch);
        let seen = patch.seen().unwrap();
        for row in 0..=20 {
            for column in 0..=20 - row {
                let (point, _, _) = cubic.at(f64::from(column) / 20.0, f64::from(row) / 20.0);
                let hit = seen.hit(point.xy()).unwrap();
                assert!(
                    hit.on_patch && (hit.height - point.z).abs() < 1e-9,
                    "{row} {column}: {hit:?} {point}"
                );
            }
        }
    }

    /// An extruded curve that bends one way at one end and the other way at the other, in facets that are far longer than wide.
    #[test]
    fn narrow_facets_of_a_curve_of_the_third_degree_do_not_fold() {
        let height = |x: f64| 2e-4 * x * x * x - 3e-3 * x * x;
        let on_curve = |x: f64, y: f64| {
            let slope = 6e-4 * x * x - 6e-3 * x;
            (Point3::new(x, y, height(x)), Vector3::new(-slope, 0.0, 1.0).normalize())
        };
        for width in [1.0, 0.1] {
            for corners in [
                [[0.0, 0.0], [10.0, 0.0], [10.0, width]],
                [[0.0, 0.0], [10.0, 0.0], [4.0, width]],
                [[0.0, 0.0], [10.0, 3.0], [10.0, 3.0 + width]],
            ] {
                let corners = corners.map(|[x, y]| on_curve(x, y));
                for facing in [1.0, -1.0] {
                    let normals = corners.map(|corner| corner.1 * facing);
                    let patch = CurvedTriangle::new(corners.map(|corner| corner.0), normals);
                    let (mut off, mut tilt) = (0.0f64, 0.0f64);
                    for (point, normal) in patch.with_even_slopes(normals).grid() {
                        off = off.max((point.z - height(point.x)).abs());
                        tilt = tilt.max(normal.angle(&on_curve(point.x, point.y).1));
                    }
                    assert!(off < 1e-4 && tilt < 1e-3, "{width} mm, {facing}: {off} mm, {tilt} rad");
                }
            }
        }
    }

    #[test]
    fn a_corner_at_the_horizon_is_a_wall() {
        // A facet of 45 degrees that ends at the horizon of a cylinder of radius 20 mm.
        let on_cylinder = |angle: f64, y: f64| {
            let normal = Vector3::new(angle.sin(), 0.0, angle.cos());
            (Point3::from(normal * 20.0 + Vector3::new(0.0, y, 0.0)), normal)
        };
        let corners = [(1.0, 0.0), (0.5, 0.0), (0.5, 30.0)]
            .map(|(quarters, y)| on_cylinder(quarters * std::f64::consts::FRAC_PI_2, y));
        let horizon = (Point3::new(20.0, 0.0, 0.0), Vector3::x());
        let patch = CurvedTriangle::new(
            [horizon.0, corners[1].0, corners[2].0],
            [horizon.1, corners[1].1, corners[2].1],
        );
        let hit = patch.hit(Vector2::new(20.0, 0.0)).unwrap();
        assert!(hit.on_patch && hit.steepness() > 1e6, "{hit:?}");
    }

    #[test]
    fn no_patch_leaves_its_facet_by_more_than_the_bound() {
        let mut state = 3u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / (1u64 << 23) as f64 - 1.0
        };
        let mut bounded = 0;
        for _ in 0..100_000 {
            let turn = 0.4 * random();
            let corners = [(); 3].map(|()| Point3::new(random(), random(), 0.3 * random()));
            let facet = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])).normalize();
            let normals =
                [(); 3].map(|()| (facet + Vector3::new(random(), random(), random()) * turn).normalize());
            let bound = CurvedTriangle::most_bulge(corners, normals);
            let patch = CurvedTriangle::new(corners, normals);
            for bulge in [patch.largest_bulge(), patch.with_even_slopes(normals).largest_bulge()] {
                assert!(bulge <= bound, "{corners:?} {normals:?}: {bulge} > {bound}");
            }
            bounded += usize::from(bound.is_finite());
        }
        assert!(bounded > 50_000, "{bounded}");
    }

    #[test]
    fn damaged_normals_leave_the_facet_flat() {
        let corners = [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]].map(Point3::from);
        let patch = CurvedTriangle::new(corners, [Vector3::x(), Vector3::zeros(), Vector3::z()]);
        let hit = patch.hit(Vector2::new(0.2, 0.3)).unwrap();
        assert_eq!((hit.height, hit.steepness(), hit.on_patch), (1.0, 0.0, true));
        assert_eq!(patch.hit(Vector2::new(0.8, 0.3)), None);
    }
}
