//! Triangles over the faces of a solid, for everything that needs a mesh: pictures, sides, rims and shadows. Their corners are on
//! the surfaces and have exact normals, and faces share the points of their edges.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector2, Vector3};
use spade::{ConstrainedDelaunayTriangulation, Triangulation};

use super::curve::chord_angle;
use super::surface::Surface;
use super::trimming::{Located, Locator, natural_limits};
use super::{Face, Solid};

/// Largest number of grid points inside one face.
const MAX_POINTS: f64 = 40_000.0;
/// Triangles are at most this much longer than wide, about.
const SLENDER: f64 = 8.0;
/// Grid points keep this share of the grid's step from the boundary.
const MARGIN: f64 = 0.25;

/// Triangles with a normal for each vertex.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tessellation {
    /// Vertices, mm.
    pub positions: Vec<Point3<f64>>,
    /// Unit normals out of the solid.
    pub normals: Vec<Vector3<f64>>,
    /// Three vertices each, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle, the number of its face.
    pub faces: Vec<u32>,
}

impl Tessellation {
    /// The triangles of all faces that can be read; chords are about `tolerance` mm from the surfaces.
    pub fn of(solid: &Solid, tolerance: f64) -> Self {
        let mut mesh = Self::default();
        for (index, face) in solid.faces.iter().enumerate() {
            if !matches!(face.surface, Surface::Unread(_)) {
                mesh.add(solid, index as u32, face, tolerance);
            }
        }
        mesh
    }

    fn add(&mut self, solid: &Solid, index: u32, face: &Face, tolerance: f64) {
        let Some(area) = Area::of(solid, face, tolerance) else { return };
        let mut plane = ConstrainedDelaunayTriangulation::<spade::Point2<f64>>::new();
        let mut places: Vec<Place> = Vec::new();
        let mut insert = |place: Place, plane: &mut ConstrainedDelaunayTriangulation<spade::Point2<f64>>| {
            let at = area.flat(place.at);
            let handle = plane.insert(spade::Point2::new(at.x, at.y)).ok()?;
            if handle.index() == places.len() {
                places.push(place);
            }
            Some(handle)
        };
        let mut sides = Vec::new();
        for [from, to] in &area.sides {
            let ends = (insert(*from, &mut plane), insert(*to, &mut plane));
            if let (Some(from), Some(to)) = ends
                && from != to
            {
                sides.push((from, to));
            }
        }
        for at in &area.inner {
            insert(Place { at: *at, point: None }, &mut plane);
        }
        for (from, to) in sides {
            if plane.can_add_constraint(from, to) {
                plane.add_constraint(from, to);
            }
        }
        let first = self.positions.len() as u32;
        for place in &places {
            let normal = face.surface.normal(place.at);
            self.positions.push(place.point.unwrap_or_else(|| face.surface.jet(place.at).point));
            self.normals.push(if face.is_same_sense { normal } else { -normal });
        }
        for triangle in plane.inner_faces() {
            let [a, b, c] = triangle.vertices().map(|vertex| vertex.fix().index());
            let [p, q, r] = [a, b, c].map(|corner| area.flat(places[corner].at));
            let longest = (q - p).norm_squared().max((r - q).norm_squared()).max((p - r).norm_squared());
            let middle = (places[a].at + places[b].at + places[c].at) / 3.0;
            if (q - p).perp(&(r - p)) > THIN * longest && face.trimming.contains(middle) {
                let corners = if face.is_same_sense { [a, b, c] } else { [a, c, b] };
                self.triangles.push(corners.map(|corner| first + corner as u32));
                self.faces.push(index);
            }
        }
    }
}

/// Places in the plane of the parameters are rounded to this, mm, so that those along a line are exactly on it.
const ROUNDED: f64 = 1e-8;
/// Triangles whose height is below this share of their length are rounding.
const THIN: f64 = 1e-8;

/// A vertex in the plane of the parameters; points of edges have their place in space.
#[derive(Debug, Clone, Copy)]
struct Place {
    at: Vector2<f64>,
    point: Option<Point3<f64>>,
}

/// The plane of a face's parameters, cut open where the surface is closed.
struct Area {
    sides: Vec<[Place; 2]>,
    inner: Vec<Vector2<f64>>,
    /// Millimetres for each unit of u and v.
    scale: Vector2<f64>,
    start: Vector2<f64>,
    periods: [Option<f64>; 2],
}

impl Area {
    fn of(solid: &Solid, face: &Face, tolerance: f64) -> Option<Self> {
        let locator = Locator::new(&face.surface, 1e-6);
        let mut lines: Vec<Vec<(Located, Point3<f64>)>> = Vec::new();
        for side in face.sides() {
            let points = &solid.edges[side.edge as usize].coarse;
            let mut previous = None;
            let mut line = Vec::new();
            for point in points {
                let located = locator.find(point, previous.as_ref());
                previous = Some(located);
                line.push((located, *point));
            }
            lines.push(line);
        }
        let periods = face.surface.periods();
        let first =
            lines.iter().flatten().find(|(located, _)| located.any.is_none()).map(|(located, _)| located.at);
        let natural = natural_limits(&face.surface);
        let mut start = Vector2::zeros();
        for axis in 0..2 {
            if let Some(period) = periods[axis] {
                let free = middle_of_gap(face.trimming.segments(), axis, period);
                start[axis] = free.or(first.map(|first| first[axis])).unwrap_or(natural[axis][0]);
            }
        }
        let mut area =
            Self { sides: Vec::new(), inner: Vec::new(), scale: Vector2::repeat(1.0), start, periods };
        for line in &lines {
            for pair in line.windows(2) {
                area.add_side(pair[0], pair[1]);
            }
        }
        let [low, high] = face.trimming.bounds();
        let mut limits = [[0.0; 2]; 2];
        for axis in 0..2 {
            limits[axis] = match periods[axis] {
                Some(period) => [start[axis], start[axis] + period],
                None => {
                    let bounded = |value: f64, other: f64| if value.is_finite() { value } else { other };
                    let (mut from, mut to) =
                        (bounded(low[axis], natural[axis][0]), bounded(high[axis], natural[axis][1]));
                    if reaches_poles(&face.surface, axis) {
                        (from, to) = (natural[axis][0], natural[axis][1]);
                    }
                    if let (Surface::Cone(_, radius, tangent), 1) = (&face.surface, axis) {
                        let apex = -radius / tangent;
                        // The apex may be inside the face.
                        if face.trimming.contains(Vector2::new(
                            start.x,
                            apex + (to - apex) * 1e-6 * (from - apex).signum(),
                        )) {
                            (from, to) = (from.min(apex), to.max(apex));
                        }
                    }
                    [from, to]
                }
            };
            if !(limits[axis][0].is_finite() && limits[axis][1] >= limits[axis][0]) {
                return None;
            }
        }
        area.fill(face, limits, tolerance);
        (!area.sides.is_empty() || !area.inner.is_empty()).then_some(area)
    }

    /// A place of the plane, mm.
    fn flat(&self, at: Vector2<f64>) -> Vector2<f64> {
        (at - self.start).component_mul(&self.scale).map(|value| (value / ROUNDED).round() * ROUNDED)
    }

    /// Adds a piece of the boundary, cut where it leaves the plane.
    fn add_side(&mut self, (from, start): (Located, Point3<f64>), (to, end): (Located, Point3<f64>)) {
        let (mut a, mut b) = (from.at, to.at);
        match (from.any, to.any) {
            (Some(_), Some(_)) => return,
            (Some(axis), None) => a[axis] = b[axis],
            (None, Some(axis)) => b[axis] = a[axis],
            (None, None) => {}
        }
        let (mut shift, mut cut) = (Vector2::zeros(), None);
        for axis in 0..2 {
            let Some(period) = self.periods[axis] else { continue };
            b[axis] -= ((b[axis] - a[axis]) / period).round() * period;
            let near = 1e-9 * period;
            let (low, high) = (self.start[axis], self.start[axis] + period);
            let turns = ((a[axis].min(b[axis]) + near - low) / period).floor() * period;
            (a[axis], b[axis]) = (a[axis] - turns, b[axis] - turns);
            for value in [&mut a[axis], &mut b[axis]] {
                if (*value - low).abs() < near {
                    *value = low;
                } else if (*value - high).abs() < near {
                    *value = high;
                }
            }
            if a[axis].max(b[axis]) > high && cut.is_none() {
                cut = Some((high - a[axis]) / (b[axis] - a[axis]));
                shift[axis] = -period;
            }
        }
        let place = |at: Vector2<f64>, point: Point3<f64>| Place { at, point: Some(point) };
        match cut {
            None => self.sides.push([place(a, start), place(b, end)]),
            Some(share) => {
                let (middle, point) = (a + (b - a) * share, start + (end - start) * share);
                // The end that is beyond the cut is moved back.
                let axis = usize::from(shift.x == 0.0);
                let (of_a, of_b) =
                    if a[axis] > b[axis] { (shift, Vector2::zeros()) } else { (Vector2::zeros(), shift) };
                self.sides.push([place(a + of_a, start), place(middle + of_a, point)]);
                self.sides.push([place(middle + of_b, point), place(b + of_b, end)]);
            }
        }
    }

    fn fill(&mut self, face: &Face, limits: [[f64; 2]; 2], tolerance: f64) {
        let [us, vs] = lines(&face.surface, limits, tolerance);
        let middle = Vector2::new(limits[0][0] + limits[0][1], limits[1][0] + limits[1][1]) / 2.0;
        let mut scale = Vector2::zeros();
        for share in [[0.0, 0.0], [0.3, 0.2], [-0.3, 0.3], [0.2, -0.4], [-0.4, -0.2]] {
            let at = middle
                + Vector2::new(
                    (limits[0][1] - limits[0][0]) * share[0],
                    (limits[1][1] - limits[1][0]) * share[1],
                );
            let jet = face.surface.jet(at);
            scale += Vector2::new(jet.by_u.norm(), jet.by_v.norm()) / 5.0;
        }
        self.scale = scale.map(|value| if value > 1e-9 && value.is_finite() { value } else { 1.0 });
        let step = |all: &[f64], index: usize| {
            let (low, high) = (all[index.saturating_sub(1)], all[(index + 1).min(all.len() - 1)]);
            (high - low) / 2.0
        };
        for (i, &u) in us.iter().enumerate() {
            for (j, &v) in vs.iter().enumerate() {
                let at = Vector2::new(u, v);
                let is_cut = |axis: usize, value: f64| {
                    self.periods[axis].is_some() && (value == limits[axis][0] || value == limits[axis][1])
                };
                let on_border =
                    |axis: usize, value: f64| value == limits[axis][0] || value == limits[axis][1];
                let cut = [is_cut(0, u), is_cut(1, v)];
                let is_end = |axis: usize, value: f64| on_border(axis, value) && !cut[axis];
                let pole =
                    |axis: usize, value: f64| on_border(axis, value) && is_pole(&face.surface, axis, value);
                let near = Vector2::new(step(&us, i), step(&vs, j)) * MARGIN;
                if is_end(0, u) && !pole(0, u) || is_end(1, v) && !pole(1, v) {
                    continue;
                }
                // At an end, the place just inside decides.
                let inward = at + (middle - at) * 1e-9;
                if face.trimming.contains(inward) && !face.trimming.is_near(at, near) {
                    self.inner.push(at);
                }
            }
        }
    }
}

fn reaches_poles(surface: &Surface, axis: usize) -> bool {
    match surface {
        Surface::Sphere(..) => axis == 1,
        Surface::Patches(patches) => patches.poles()[axis] != [false; 2] || patches.closed()[1 - axis],
        _ => false,
    }
}

/// The middle of the largest range of a periodic parameter without a boundary; `None` if there is no such
/// range, or no boundary.
fn middle_of_gap(segments: &[[Vector2<f64>; 2]], axis: usize, period: f64) -> Option<f64> {
    let mut ranges: Vec<[f64; 2]> = segments
        .iter()
        .map(|[a, b]| {
            let (from, to) = (a[axis].min(b[axis]), a[axis].max(b[axis]));
            let low = from.rem_euclid(period);
            [low, low + to - from]
        })
        .collect();
    ranges.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let first = ranges.first()?[0];
    let mut reached = ranges.iter().map(|range| range[1] - period).fold(f64::NEG_INFINITY, f64::max);
    let mut best: Option<[f64; 2]> = None;
    for [from, to] in ranges.into_iter().chain([[first + period; 2]]) {
        if from > reached && best.is_none_or(|[low, high]| from - reached > high - low) {
            best = Some([reached, from]);
        }
        reached = reached.max(to);
    }
    best.filter(|[low, high]| high - low > 1e-4 * period).map(|[low, high]| (low + high) / 2.0)
}

/// Whether the surface is a single point where this parameter is at this limit.
fn is_pole(surface: &Surface, axis: usize, value: f64) -> bool {
    match surface {
        Surface::Sphere(..) => axis == 1,
        Surface::Cone(_, radius, tangent) => {
            axis == 1 && (radius + tangent * value).abs() < 1e-9 * (1.0 + radius.abs())
        }
        Surface::Patches(patches) => {
            let [from, to] = patches.domain()[axis];
            patches.poles()[axis][0] && value == from || patches.poles()[axis][1] && value == to
        }
        _ => false,
    }
}

/// The values of u and v of a grid over a face.
fn lines(surface: &Surface, limits: [[f64; 2]; 2], tolerance: f64) -> [Vec<f64>; 2] {
    let even = |[from, to]: [f64; 2], step: f64| -> Vec<f64> {
        let count = ((to - from) / step).ceil().clamp(1.0, 400.0);
        (0..=count as usize)
            .map(|index| if index as f64 == count { to } else { from + (to - from) * index as f64 / count })
            .collect()
    };
    let slender =
        |[from, to]: [f64; 2], length: f64| even([from, to], (SLENDER * length).max((to - from) / 64.0));
    match surface {
        Surface::Plane(_) | Surface::Unread(_) => [limits[0].to_vec(), limits[1].to_vec()],
        Surface::Cylinder(_, radius) => {
            let angle = chord_angle(*radius, tolerance);
            [even(limits[0], angle), slender(limits[1], radius * angle)]
        }
        Surface::Cone(_, radius, tangent) => {
            let largest =
                (radius + tangent * limits[1][0]).abs().max((radius + tangent * limits[1][1]).abs());
            let angle = chord_angle(largest, tolerance);
            [even(limits[0], angle), slender(limits[1], largest * angle)]
        }
        Surface::Sphere(_, radius) => {
            let angle = chord_angle(*radius, tolerance);
            let angle = angle.max(TAU / 200.0);
            [even(limits[0], angle), even(limits[1], angle)]
        }
        Surface::Patches(patches) => {
            let mut steps = [Vec::new(), Vec::new()];
            for (patch, range) in patches.cells() {
                for (axis, steps) in steps.iter_mut().enumerate() {
                    let from = range[axis][0];
                    let count = patch_steps(patch, axis, tolerance);
                    match steps.iter_mut().find(|(start, _, _): &&mut (f64, f64, f64)| *start == from) {
                        Some((_, _, most)) => *most = count.max(*most),
                        None => steps.push((from, range[axis][1], count)),
                    }
                }
            }
            let total: f64 =
                steps.iter().map(|steps| steps.iter().map(|(_, _, count)| count).sum::<f64>()).product();
            let thin = (total / MAX_POINTS).sqrt().max(1.0);
            [0, 1].map(|axis| {
                let mut values: Vec<f64> = Vec::new();
                for (from, to, count) in &steps[axis] {
                    let count = (count / thin).ceil().max(1.0) as usize;
                    values.extend((0..count).map(|index| from + (to - from) * index as f64 / count as f64));
                }
                let [from, to] = limits[axis];
                let period = surface.periods()[axis];
                let mut values: Vec<f64> = match period {
                    Some(period) => {
                        values.iter().map(|value| from + (value - from).rem_euclid(period)).collect()
                    }
                    None => values,
                };
                values.retain(|value| *value > from && *value < to);
                values.extend([from, to]);
                values.sort_by(f64::total_cmp);
                values.dedup();
                values
            })
        }
    }
}

/// The number of chords along an axis of a patch.
fn patch_steps(patch: &super::bezier::BezierPatch, axis: usize, tolerance: f64) -> f64 {
    let [p, q] = patch.degree;
    let degree = patch.degree[axis];
    let mut bend = 0.0f64;
    for i in 0..=p {
        for j in 0..=q {
            let at = |step: usize| {
                let (i, j) = if axis == 0 { (i + step, j) } else { (i, j + step) };
                super::bezier::projected(patch.control(i, j))
            };
            let index = if axis == 0 { i } else { j };
            if index + 2 <= degree {
                bend = bend.max((at(2) - at(1) - (at(1) - at(0))).norm());
            }
        }
    }
    let factor = (degree * degree.saturating_sub(1)) as f64 / 8.0;
    (factor * bend / tolerance).sqrt().ceil().clamp(1.0, 64.0)
}
