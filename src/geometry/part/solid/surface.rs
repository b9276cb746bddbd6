//! The surfaces of faces: elementary ones in closed form, all others as rational Bézier patches, which they are exactly.

use std::f64::consts::{FRAC_PI_4, TAU};

use nalgebra::{Point3, Rotation3, Unit, Vector2, Vector3};

use super::bezier::{
    BezierPatch, Jet, SplineError, Weighted, check_knots, check_points, plain, projected, span_points, spans,
};
use super::curve::Spline;
use super::frame::{Frame, Placement};

/// A closest point has converged when its step is below this share of a patch.
const CONVERGED: f64 = 1e-14;
/// Largest number of steps to the closest point.
const MAX_STEPS: usize = 40;
/// Sides of a spline surface whose points agree to within this share of its size are one point, or one line.
const CLOSED: f64 = 1e-9;
/// Closest points start from at most this many parameters along a side of a patch.
const STARTS: usize = 7;
/// Closest points are searched for from this many of the nearest parameters.
const NEAR_STARTS: usize = 8;
/// Closest points are searched for from this many parameters all over the surface, if the nearest ones do not
/// lead closer than [`FAR_OFF`].
const FAR_STARTS: usize = 48;
/// [`FAR_STARTS`] are tried only if the nearest parameters lead to no point nearer than this, mm: edges may
/// be slightly off.
const FAR_OFF: f64 = 1e-3;
/// The golden ratio: its multiples are spread evenly over a circle.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// The surface of a face, unbounded or larger than the face, mm.
#[derive(Debug, Clone, PartialEq)]
pub enum Surface {
    /// The xy plane of a frame.
    Plane(Frame),
    /// A cylinder about the z axis of a frame, with its radius.
    Cylinder(Frame, f64),
    /// A cone about the z axis of a frame, with its radius at z = 0 and the tangent of its half angle, with which the
    /// radius grows along z.
    Cone(Frame, f64, f64),
    /// A sphere about the origin of a frame, with its radius.
    Sphere(Frame, f64),
    /// Bézier patches.
    Patches(Patches),
    /// A surface that cannot be read, by the name of its kind.
    Unread(String),
}

/// Bézier patches side by side in a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Patches {
    /// The patches; v runs fastest.
    patches: Vec<BezierPatch>,
    /// The parameters between them, along u and v.
    breaks: [Vec<f64>; 2],
    /// Whether the surface is at the same place at both ends of u and of v.
    closed: [bool; 2],
    /// Whether the sides u = first, u = last, v = first and v = last are a single point.
    poles: [[bool; 2]; 2],
}

impl Patches {
    /// The patches of a rational B-spline surface; `points` has v fastest.
    ///
    /// # Errors
    /// See [`SplineError`].
    pub fn new(
        degree: [usize; 2],
        knots: [&[f64]; 2],
        points: &[Weighted],
        count: [usize; 2],
    ) -> Result<Self, SplineError> {
        for axis in 0..2 {
            check_knots(degree[axis], knots[axis], count[axis])?;
        }
        check_points(points)?;
        let [in_u, in_v] = [0, 1].map(|axis| spans(degree[axis], knots[axis], count[axis]));
        let mut patches = Vec::with_capacity(in_u.len() * in_v.len());
        for &u in &in_u {
            for &v in &in_v {
                // First along v, for each row that the span in u needs.
                let rows: Vec<Vec<Weighted>> = (u - degree[0]..=u)
                    .map(|row| span_points(degree[1], knots[1], v, |index| points[row * count[1] + index]))
                    .collect();
                let mut patch = vec![Weighted::zeros(); (degree[0] + 1) * (degree[1] + 1)];
                for j in 0..=degree[1] {
                    let along = span_points(degree[0], knots[0], u, |index| rows[index + degree[0] - u][j]);
                    for (i, point) in along.into_iter().enumerate() {
                        patch[i * (degree[1] + 1) + j] = point;
                    }
                }
                patches.push(BezierPatch { degree, points: patch });
            }
        }
        let ends = |axis: usize, spans: &[usize]| -> Vec<f64> {
            let knots = knots[axis];
            spans.iter().map(|&span| knots[span]).chain([knots[count[axis]]]).collect()
        };
        Ok(Self::from_grid(patches, [ends(0, &in_u), ends(1, &in_v)]))
    }

    /// The surface that a curve sweeps along a direction from `from` to `to` mm.
    pub fn extruded(profile: &Spline, direction: Vector3<f64>, from: f64, to: f64) -> Self {
        let patches = profile.curves.iter().map(|curve| {
            let ends = |point: &Weighted| {
                [from, to].map(|length| point + (direction * (length * point.w)).push(0.0))
            };
            let points = curve.points.iter().flat_map(ends).collect();
            BezierPatch { degree: [curve.points.len() - 1, 1], points }
        });
        Self::from_grid(patches.collect(), [profile.breaks.clone(), vec![from, to]])
    }

    /// The surface that a curve sweeps round an axis; u is the angle in quarter turns, v the parameter of the curve.
    pub fn revolved(profile: &Spline, origin: Point3<f64>, axis: Unit<Vector3<f64>>) -> Self {
        let cos = FRAC_PI_4.cos();
        let turned = |point: &Weighted, eighths: usize| -> Weighted {
            let from = point.xyz() - origin.coords * point.w;
            let along = *axis * from.dot(&axis);
            let turn = Rotation3::from_axis_angle(&axis, FRAC_PI_4 * eighths as f64);
            let round = if eighths == 8 { from - along } else { turn * (from - along) };
            // The middle point of an arc has the weight cos 45°, and is that much farther out.
            let weight = if eighths % 2 == 1 { cos } else { 1.0 };
            ((origin.coords * point.w + along) * weight + round).push(point.w * weight)
        };
        let mut patches = Vec::with_capacity(4 * profile.curves.len());
        for quarter in 0..4 {
            for curve in &profile.curves {
                let row =
                    |step: usize| curve.points.iter().map(move |point| turned(point, 2 * quarter + step));
                let points = (0..3).flat_map(row).collect();
                patches.push(BezierPatch { degree: [2, curve.points.len() - 1], points });
            }
        }
        Self::from_grid(patches, [(0..5).map(f64::from).collect(), profile.breaks.clone()])
    }

    /// The torus about the z axis of a frame. If its circle crosses the axis, only the outer part, or only the inner one.
    pub fn torus(frame: &Frame, major: f64, minor: f64, is_outer: bool) -> Self {
        let circle = Frame { origin: frame.point(major, 0.0, 0.0), x: frame.x, y: frame.z, z: -frame.y };
        let profile = match major > minor {
            true => Spline::arc(&circle, minor, 0.0, TAU),
            false => {
                let crossing = (-major / minor).acos();
                let (from, to) = if is_outer { (-crossing, crossing) } else { (crossing, TAU - crossing) };
                Spline::arc(&circle, minor, from, to)
            }
        };
        Self::revolved(&profile, frame.origin, Unit::new_unchecked(frame.z))
    }

    fn from_grid(patches: Vec<BezierPatch>, breaks: [Vec<f64>; 2]) -> Self {
        let mut grid = Self { patches, breaks, closed: [false; 2], poles: [[false; 2]; 2] };
        let points = || grid.patches.iter().flat_map(|patch| &patch.points).map(projected);
        let low = points().fold(Vector3::repeat(f64::INFINITY), |low, point| low.inf(&point.coords));
        let high = points().fold(Vector3::repeat(f64::NEG_INFINITY), |high, point| high.sup(&point.coords));
        let near = CLOSED * (high - low).norm() + 1e-12;
        for axis in 0..2 {
            let sides = [grid.side(axis, 0), grid.side(axis, 1)];
            let closed = sides[0].iter().zip(&sides[1]).all(|(a, b)| (a - b).norm() <= near);
            let poles =
                [0, 1].map(|end| sides[end].iter().all(|point| (point - sides[end][0]).norm() <= near));
            (grid.closed[axis], grid.poles[axis]) = (closed && !poles[0], poles);
        }
        grid
    }

    /// The control points of the side at the first or last u or v.
    fn side(&self, axis: usize, end: usize) -> Vec<Point3<f64>> {
        let (columns, rows) = (self.breaks[0].len() - 1, self.breaks[1].len() - 1);
        let mut points = Vec::new();
        for along in 0..if axis == 0 { rows } else { columns } {
            let patch = match axis {
                0 => &self.patches[(if end == 0 { 0 } else { columns - 1 }) * rows + along],
                _ => &self.patches[along * rows + if end == 0 { 0 } else { rows - 1 }],
            };
            let last = patch.degree[axis];
            for index in 0..=patch.degree[1 - axis] {
                let at = if end == 0 { 0 } else { last };
                let point = if axis == 0 { patch.control(at, index) } else { patch.control(index, at) };
                points.push(projected(point));
            }
        }
        points
    }

    /// The patches with the rectangle of the parameters that each covers: from and to along u and v.
    pub fn cells(&self) -> impl Iterator<Item = (&BezierPatch, [[f64; 2]; 2])> {
        let rows = self.breaks[1].len() - 1;
        self.patches.iter().enumerate().map(move |(index, patch)| {
            let (i, j) = (index / rows, index % rows);
            let [u, v] = &self.breaks;
            (patch, [[u[i], u[i + 1]], [v[j], v[j + 1]]])
        })
    }

    /// The first and last u, and the first and last v.
    pub fn domain(&self) -> [[f64; 2]; 2] {
        [0, 1].map(|axis: usize| [self.breaks[axis][0], self.breaks[axis][self.breaks[axis].len() - 1]])
    }

    /// Whether the surface is at the same place at both ends of u and of v.
    pub fn closed(&self) -> [bool; 2] {
        self.closed
    }

    /// Whether the first and the last side along u and v are single points.
    pub fn poles(&self) -> [[bool; 2]; 2] {
        self.poles
    }

    fn local(&self, axis: usize, value: f64) -> (usize, f64) {
        let breaks = &self.breaks[axis];
        let index = breaks.partition_point(|&start| start <= value).clamp(1, breaks.len() - 1) - 1;
        (index, (value - breaks[index]) / (breaks[index + 1] - breaks[index]))
    }

    /// Point and derivatives at a parameter; outside the domain the last patch is continued.
    pub fn jet(&self, at: Vector2<f64>) -> Jet {
        let ((i, u), (j, v)) = (self.local(0, at.x), self.local(1, at.y));
        let jet = self.patches[i * (self.breaks[1].len() - 1) + j].jet(u, v);
        let width = |axis: usize, index: usize| self.breaks[axis][index + 1] - self.breaks[axis][index];
        Jet { by_u: jet.by_u / width(0, i), by_v: jet.by_v / width(1, j), ..jet }
    }

    /// The parameter whose point is nearest to `at`, found from `guess`, or from everywhere, and its distance, mm.
    pub fn nearest(
        &self,
        at: &Point3<f64>,
        guess: Option<Vector2<f64>>,
        starts: &[(Vector2<f64>, Point3<f64>)],
        enough: f64,
    ) -> (Vector2<f64>, f64) {
        let mut best = (Vector2::zeros(), f64::INFINITY);
        if let Some(guess) = guess {
            best = self.descend(at, guess);
            if best.1 <= enough {
                return best;
            }
        }
        let mut order: Vec<(f64, usize)> = starts
            .iter()
            .enumerate()
            .map(|(index, (_, point))| ((point - at).norm_squared(), index))
            .collect();
        let count = order.len().min(NEAR_STARTS);
        if count > 0 {
            order.select_nth_unstable_by(count - 1, |a, b| a.0.total_cmp(&b.0));
            order.truncate(count);
            order.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        let mut try_from = |index: usize, enough: f64| {
            if best.1 > enough {
                let found = self.descend(at, starts[index].0);
                if found.1 < best.1 {
                    best = found;
                }
            }
        };
        order.into_iter().for_each(|(_, index)| try_from(index, enough));
        // The nearest starts may all be on the other side of a thin part.
        let far = (1..=FAR_STARTS).map(|number| (number as f64 * GOLDEN).fract() * starts.len() as f64);
        far.filter(|_| !starts.is_empty()).for_each(|index| try_from(index as usize, enough.max(FAR_OFF)));
        best
    }

    /// Parameters all over the surface with their points.
    pub fn starts(&self) -> Vec<(Vector2<f64>, Point3<f64>)> {
        let mut starts = Vec::new();
        let most = (200_000 / self.patches.len().max(1)).max(1);
        for (patch, [u, v]) in self.cells() {
            let [p, q] = patch.degree.map(|degree| (degree + 2).min(STARTS));
            let (p, q) = if p * q > most { (1, 1) } else { (p, q) };
            for i in 0..p {
                for j in 0..q {
                    let (s, t) = ((i as f64 + 0.5) / p as f64, (j as f64 + 0.5) / q as f64);
                    let place = Vector2::new(u[0] + (u[1] - u[0]) * s, v[0] + (v[1] - v[0]) * t);
                    starts.push((place, patch.jet(s, t).point));
                }
            }
        }
        starts
    }

    /// Gauss–Newton steps to the closest point, damped, within the domain.
    fn descend(&self, at: &Point3<f64>, start: Vector2<f64>) -> (Vector2<f64>, f64) {
        let domain = self.domain();
        let size = Vector2::new(domain[0][1] - domain[0][0], domain[1][1] - domain[1][0]);
        let inside = |mut place: Vector2<f64>| {
            for axis in 0..2 {
                let [from, to] = domain[axis];
                place[axis] = match self.closed[axis] {
                    true if place[axis] < from || place[axis] > to => {
                        from + (place[axis] - from).rem_euclid(to - from)
                    }
                    _ => place[axis].clamp(from, to),
                };
            }
            place
        };
        let mut place = inside(start);
        let mut jet = self.jet(place);
        let mut damping = 0.0;
        for _ in 0..MAX_STEPS {
            let miss = at - jet.point;
            let (uu, uv, vv) = (jet.by_u.norm_squared(), jet.by_u.dot(&jet.by_v), jet.by_v.norm_squared());
            let (right_u, right_v) = (miss.dot(&jet.by_u), miss.dot(&jet.by_v));
            // At a limit of the domain, only the other parameter moves.
            let stuck = |axis: usize, pull: f64| {
                !self.closed[axis]
                    && (place[axis] <= domain[axis][0] && pull < 0.0
                        || place[axis] >= domain[axis][1] && pull > 0.0)
            };
            let step = match (stuck(0, right_u), stuck(1, right_v)) {
                (true, true) => break,
                (true, false) if vv > 0.0 => Vector2::new(0.0, right_v / (vv * (1.0 + damping))),
                (false, true) if uu > 0.0 => Vector2::new(right_u / (uu * (1.0 + damping)), 0.0),
                _ => {
                    let (a, d) = (uu * (1.0 + damping) + 1e-300, vv * (1.0 + damping) + 1e-300);
                    let determinant = a * d - uv * uv;
                    if determinant > 1e-12 * a * d {
                        Vector2::new(right_u * d - right_v * uv, right_v * a - right_u * uv) / determinant
                    } else {
                        Vector2::new(right_u / (2.0 * a), right_v / (2.0 * d))
                    }
                }
            };
            let next = inside(place + step);
            let next_jet = self.jet(next);
            if !((at - next_jet.point).norm() <= miss.norm()) {
                damping = if damping == 0.0 { 1e-3 } else { damping * 8.0 };
                if damping > 1e9 {
                    break;
                }
                continue;
            }
            damping *= 0.1;
            let moved = step.component_div(&size).amax();
            (place, jet) = (next, next_jet);
            if moved < CONVERGED {
                break;
            }
        }
        (place, (at - jet.point).norm())
    }

    fn placed(&self, placement: &Placement) -> Self {
        let mut moved = self.clone();
        for point in moved.patches.iter_mut().flat_map(|patch| &mut patch.points) {
            let at = placement.point(&projected(point));
            *point = plain(at) * point.w;
        }
        moved
    }
}

impl Surface {
    /// The surface after a move.
    pub fn placed(&self, placement: &Placement) -> Self {
        match self {
            Self::Plane(frame) => Self::Plane(placement.frame(frame)),
            Self::Cylinder(frame, radius) => Self::Cylinder(placement.frame(frame), *radius),
            Self::Cone(frame, radius, tangent) => Self::Cone(placement.frame(frame), *radius, *tangent),
            Self::Sphere(frame, radius) => Self::Sphere(placement.frame(frame), *radius),
            Self::Patches(patches) => Self::Patches(patches.placed(placement)),
            Self::Unread(kind) => Self::Unread(kind.clone()),
        }
    }

    /// After how much of u and v the surface is at the same place again.
    pub fn periods(&self) -> [Option<f64>; 2] {
        match self {
            Self::Plane(_) | Self::Unread(_) => [None; 2],
            Self::Cylinder(..) | Self::Cone(..) | Self::Sphere(..) => [Some(TAU), None],
            Self::Patches(patches) => {
                let (closed, domain) = (patches.closed(), patches.domain());
                [0, 1].map(|axis| closed[axis].then(|| domain[axis][1] - domain[axis][0]))
            }
        }
    }

    /// The point and the derivatives at a parameter; for a surface that cannot be read, the origin.
    pub fn jet(&self, at: Vector2<f64>) -> Jet {
        let (sin, cos) = at.x.sin_cos();
        match self {
            Self::Plane(frame) => Jet { point: frame.point(at.x, at.y, 0.0), by_u: frame.x, by_v: frame.y },
            Self::Cylinder(frame, radius) => Jet {
                point: frame.point(radius * cos, radius * sin, at.y),
                by_u: frame.vector(-radius * sin, radius * cos, 0.0),
                by_v: frame.z,
            },
            Self::Cone(frame, radius, tangent) => {
                let here = radius + tangent * at.y;
                Jet {
                    point: frame.point(here * cos, here * sin, at.y),
                    by_u: frame.vector(-here * sin, here * cos, 0.0),
                    by_v: frame.vector(tangent * cos, tangent * sin, 1.0),
                }
            }
            Self::Sphere(frame, radius) => {
                let (high, flat) = at.y.sin_cos();
                Jet {
                    point: frame.point(radius * flat * cos, radius * flat * sin, radius * high),
                    by_u: frame.vector(-radius * flat * sin, radius * flat * cos, 0.0),
                    by_v: frame.vector(-radius * high * cos, -radius * high * sin, radius * flat),
                }
            }
            Self::Patches(patches) => patches.jet(at),
            Self::Unread(_) => {
                Jet { point: Point3::origin(), by_u: Vector3::zeros(), by_v: Vector3::zeros() }
            }
        }
    }

    /// The unit normal in the sense of the parameters, ∂u × ∂v; at a pole that of a place close to it.
    pub fn normal(&self, at: Vector2<f64>) -> Vector3<f64> {
        match self {
            Self::Plane(frame) => frame.z,
            Self::Cylinder(frame, _) => frame.vector(at.x.cos(), at.x.sin(), 0.0),
            Self::Cone(frame, radius, tangent) => {
                let side = if radius + tangent * at.y < 0.0 { -1.0 } else { 1.0 };
                frame.vector(at.x.cos() * side, at.x.sin() * side, -tangent * side).normalize()
            }
            Self::Sphere(frame, _) => {
                frame.vector(at.y.cos() * at.x.cos(), at.y.cos() * at.x.sin(), at.y.sin())
            }
            Self::Patches(patches) => {
                let domain = patches.domain();
                let middle = Vector2::new(domain[0][0] + domain[0][1], domain[1][0] + domain[1][1]) / 2.0;
                for share in [0.0, 1e-7, 1e-5, 1e-3] {
                    let jet = patches.jet(at + (middle - at) * share);
                    let normal = jet.by_u.cross(&jet.by_v);
                    let size = jet.by_u.norm() * jet.by_v.norm();
                    if normal.norm() > 1e-9 * size && size > 0.0 {
                        return normal.normalize();
                    }
                }
                Vector3::zeros()
            }
            Self::Unread(_) => Vector3::zeros(),
        }
    }
}
