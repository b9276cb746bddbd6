//! Where the laser's axis meets the faces of a solid, computed on their exact surfaces.

use nalgebra::{Point2, Point3, Unit, Vector2, Vector3};

use super::bezier::{BezierPatch, Jet, projected};
use super::frame::Frame;
use super::round::RoundForm;
use super::surface::{Patches, Surface};
use super::trimming::Trimming;
use super::{Face, Solid};

/// A place this close to the boundary of a face, mm, is on the face if no other face covers it: two faces share the chords of
/// their edge, but not exactly the same side of them.
pub const RIM: f64 = 1e-3;
/// What is more than this below a place inside a face, mm, is hidden and is not a second skin.
pub const HIDDEN: f64 = 0.1;
/// Parts of a patch are divided down to this share of the part, where the surface folds back in the view.
const SMALLEST: f64 = 1.0 / 1024.0;
/// The angle by which the directions of u and v in the view must differ everywhere in a part of a patch, rad.
const APART: f64 = 0.05;
/// Largest number of parts of all patches of a face; the rest stays undivided.
const MAX_PARTS: usize = 100_000;
/// Where pieces of a surface are this small in the view, mm, and still fold back, they are met in their
/// middle: the surface is along the laser there.
const FOLD: f64 = 1e-6;
/// Largest number of divisions of a part for one ray.
const MAX_DIVISIONS: usize = 600;
/// Number of places along each side of the rectangle in which an unreadable face may be visible.
const PROBES: usize = 48;
/// The share of the way to the middle of the face by which places on its boundary are moved inwards.
const INWARD: f64 = 0.01;
/// Largest number of cylinders and cones that are kept.
const MAX_FORMS: usize = 1000;
/// Number of rows of the lists of parts and sides.
const ROWS: usize = 128;

/// Where the laser's axis meets a face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaceHit {
    /// Height, mm.
    pub height: f64,
    /// Unit normal out of the solid.
    pub normal: Vector3<f64>,
    /// Number of the face.
    pub face: u32,
    /// Whether it is inside the boundary, and not only within [`RIM`] of it.
    pub is_inside: bool,
}

/// A solid in the view, ready for rays along z.
#[derive(Debug, Clone)]
pub struct SeenSolid {
    faces: Vec<SeenFace>,
}

/// The part of a patch, and the place in it, at which Newton's method ended last.
#[derive(Debug, Clone, Copy, Default)]
pub struct Start(Option<(u32, [f64; 2])>);

/// A place at which the axis of the laser meets a surface.
struct Met {
    height: f64,
    parameters: Vector2<f64>,
    /// The surface's unit normal, if it is known.
    normal: Option<Vector3<f64>>,
}

impl Met {
    fn at(height: f64, parameters: Vector2<f64>) -> Self {
        Self { height, parameters, normal: None }
    }
}

/// A face in the view.
#[derive(Debug, Clone)]
pub struct SeenFace {
    id: u64,
    surface: Surface,
    trimming: std::sync::Arc<Trimming>,
    is_same_sense: bool,
    low: Vector2<f64>,
    high: Vector2<f64>,
    /// The lowest and highest point of its boundary, mm.
    heights: [f64; 2],
    parts: Lists<Part>,
    sides: Lists<[Point3<f64>; 2]>,
    rim: f64,
}

/// A part of a patch that the view shows only once, or that is small.
#[derive(Debug, Clone)]
struct Part {
    patch: BezierPatch,
    range: [[f64; 2]; 2],
    is_single: bool,
    low: Vector2<f64>,
    high: Vector2<f64>,
    /// No point of it is higher, mm.
    top: f64,
}

/// Things in lists by the rows of the view that they are in.
#[derive(Debug, Clone)]
struct Lists<T> {
    things: Vec<T>,
    rows: Vec<Vec<u32>>,
    start: f64,
    width: f64,
}

impl<T> Lists<T> {
    fn new(things: Vec<T>, range: impl Fn(&T) -> [f64; 2]) -> Self {
        let ends = things.iter().map(&range);
        let [low, high] = ends
            .fold([f64::INFINITY, f64::NEG_INFINITY], |all, one| [all[0].min(one[0]), all[1].max(one[1])]);
        let width = ((high - low) / ROWS as f64).max(1e-12);
        let mut rows = vec![Vec::new(); ROWS];
        for (index, thing) in things.iter().enumerate() {
            let number = |value: f64| (((value - low) / width) as usize).min(ROWS - 1);
            let [from, to] = range(thing);
            rows[number(from)..=number(to)].iter_mut().for_each(|row: &mut Vec<u32>| row.push(index as u32));
        }
        Self { things, rows, start: low, width }
    }

    /// What is within `near` of a place, with its number in the list.
    fn at(&self, value: f64, near: f64) -> impl Iterator<Item = (u32, &T)> {
        let number = |value: f64| (value - self.start) / self.width;
        let outside = !(number(value + near) >= 0.0 && number(value - near) <= ROWS as f64);
        let first = (number(value - near).max(0.0) as usize).min(ROWS - 1);
        let last = (number(value + near).max(0.0) as usize).min(ROWS - 1);
        let rows = if outside { &[] } else { &self.rows[first..=last] };
        rows.iter().flatten().map(|&index| (index, &self.things[index as usize]))
    }
}

impl SeenSolid {
    /// A solid that is already in the frame of the view: x to the right, y up, z to the laser.
    pub fn new(solid: &Solid) -> Self {
        let size = solid.size();
        let faces = solid.faces.iter().map(|face| SeenFace::new(solid, face, size)).collect();
        Self { faces }
    }

    /// Its faces.
    pub fn faces(&self) -> &[SeenFace] {
        &self.faces
    }

    /// The bounding rectangle of its faces in the view: lower left and upper right, mm.
    pub fn bounds(&self) -> [Vector2<f64>; 2] {
        let empty = [Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY)];
        self.faces.iter().fold(empty, |all, face| [all[0].inf(&face.low), all[1].sup(&face.high)])
    }

    /// The first face that cannot be read and that the laser sees: at a place inside its outline, or just inside its boundary,
    /// no other face is above all of its boundary.
    pub fn unread(&self) -> Option<&SeenFace> {
        let is_seen = |face: &&SeenFace| {
            let size = face.high - face.low;
            let share = |step: usize| (step as f64 + 0.5) / PROBES as f64;
            let grid = (0..PROBES * PROBES).map(|index| {
                face.low + Vector2::new(size.x * share(index % PROBES), size.y * share(index / PROBES))
            });
            let inner = grid.filter(|at| face.outlines(*at));
            let middle = (face.low + face.high) / 2.0;
            let sides = &face.sides.things;
            let border = sides.iter().step_by(sides.len() / (4 * PROBES) + 1);
            let border = border.map(|[from, _]| from.coords.xy() + (middle - from.coords.xy()) * INWARD);
            let is_open = |at: Vector2<f64>| self.first(at).is_none_or(|hit| hit.height < face.heights[1]);
            sides.is_empty() || inner.chain(border).any(is_open)
        };
        self.faces.iter().filter(|face| face.unread().is_some()).find(is_seen)
    }

    /// The cylinders and cones of which the laser may see a face, in the frame of the view.
    pub fn round_forms(&self) -> Vec<RoundForm> {
        let mut forms: Vec<RoundForm> = Vec::new();
        for face in &self.faces {
            let form = match &face.surface {
                Surface::Cylinder(frame, radius) => {
                    let axis = Unit::new_normalize(frame.z);
                    RoundForm::Cylinder { center: frame.origin, axis, radius: *radius }
                }
                Surface::Cone(frame, radius, tangent) => {
                    let apex = frame.point(0.0, 0.0, -radius / tangent);
                    // The nappe on which the face is.
                    let [low, high] = face.trimming.bounds();
                    let side = if (low.y + high.y) / 2.0 < -radius / tangent { -frame.z } else { frame.z };
                    RoundForm::Cone {
                        apex,
                        axis: Unit::new_normalize(side),
                        half_angle: tangent.abs().atan(),
                    }
                }
                _ => continue,
            };
            if !forms.contains(&form) && forms.len() < MAX_FORMS {
                forms.push(form);
            }
        }
        forms
    }

    /// What the laser meets first at a place of the view.
    pub fn first(&self, at: Vector2<f64>) -> Option<FaceHit> {
        let mut hits = Vec::new();
        for (index, face) in self.faces.iter().enumerate() {
            if face.may_cover(at) {
                face.hits(index as u32, at, &mut Start::default(), &mut hits);
            }
        }
        first_of(&hits)
    }

    /// The numbers of its faces, the highest boundary first: those hide the others.
    pub fn from_top(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.faces.len()).collect();
        order.sort_by(|&one, &other| self.faces[other].heights[1].total_cmp(&self.faces[one].heights[1]));
        order
    }
}

/// The hit that the laser meets first. One on the rim of a face gives way to one inside another face that is as near as the
/// rim is wide.
pub fn first_of(hits: &[FaceHit]) -> Option<FaceHit> {
    let highest = |hits: &mut dyn Iterator<Item = &FaceHit>| {
        hits.copied().max_by(|a, b| a.height.total_cmp(&b.height).then(b.face.cmp(&a.face)))
    };
    let first = highest(&mut hits.iter())?;
    if first.is_inside {
        return Some(first);
    }
    let steepness = |hit: &FaceHit| hit.normal.xy().norm() / hit.normal.z.abs().max(1e-3);
    let inside = highest(&mut hits.iter().filter(|hit| hit.is_inside));
    let near =
        |hit: &FaceHit| first.height - hit.height < RIM * 4.0 * (1.0 + steepness(&first) + steepness(hit));
    Some(inside.filter(near).unwrap_or(first))
}

/// Below this height, mm, the places inside faces hide everything.
fn hidden_below(hits: &[FaceHit]) -> f64 {
    let inside = hits.iter().filter(|hit| hit.is_inside).map(|hit| hit.height - HIDDEN);
    inside.fold(f64::NEG_INFINITY, f64::max)
}

impl SeenFace {
    fn new(solid: &Solid, face: &Face, size: f64) -> Self {
        let lines = || face.sides().map(|side| &solid.edges[side.edge as usize].points);
        let pairs = lines().flat_map(|line| line.windows(2)).map(|pair| [pair[0], pair[1]]);
        let sides = Lists::new(pairs.collect(), |[a, b]| [a.y.min(b.y), a.y.max(b.y)]);
        let points = || lines().flatten();
        let fold = |start: f64, pick: fn(f64, f64) -> f64| points().map(|point| point.z).fold(start, pick);
        let heights = [fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max)];
        let mut low = points().fold(Vector2::repeat(f64::INFINITY), |low, point| low.inf(&point.coords.xy()));
        let mut high =
            points().fold(Vector2::repeat(f64::NEG_INFINITY), |high, point| high.sup(&point.coords.xy()));
        let mut parts = Vec::new();
        if let Surface::Patches(patches) = &face.surface {
            parts = parts_of(patches, &face.trimming, size * SMALLEST);
            // The higher ones hide the others.
            parts.sort_by(|one, other| other.top.total_cmp(&one.top));
        }
        let parts = Lists::new(parts, |part: &Part| [part.low.y, part.high.y]);
        if let Some([from, to]) = reach(&face.surface, &face.trimming, &parts.things) {
            (low, high) = (from, to);
        }
        let rim = RIM + face.gap;
        Self {
            id: face.id,
            surface: face.surface.clone(),
            trimming: face.trimming.clone(),
            is_same_sense: face.is_same_sense,
            low: low.add_scalar(-rim),
            high: high.add_scalar(rim),
            heights,
            parts,
            sides,
            rim,
        }
    }

    /// The number of its record in the file.
    pub fn id(&self) -> u64 {
        self.id
    }

    /// The kind of the surface, if it cannot be read.
    pub fn unread(&self) -> Option<&str> {
        match &self.surface {
            Surface::Unread(kind) => Some(kind),
            _ => None,
        }
    }

    /// A rectangle of the view outside which the face is not: lower left and upper right, mm.
    pub fn bounds(&self) -> [Vector2<f64>; 2] {
        [self.low, self.high]
    }

    /// The lowest and highest point of its boundary, mm.
    pub fn heights(&self) -> [f64; 2] {
        self.heights
    }

    /// Whether a place of the view is in its rectangle.
    pub fn may_cover(&self, at: Vector2<f64>) -> bool {
        at.x >= self.low.x && at.x <= self.high.x && at.y >= self.low.y && at.y <= self.high.y
    }

    /// Adds the places at which the axis of the laser through `at` meets the face, except for those that the
    /// other hits hide. `start` is the last such place, which is near along a line.
    pub fn hits(&self, index: u32, at: Vector2<f64>, start: &mut Start, hits: &mut Vec<FaceHit>) {
        let mut add = |met: Met| self.add(index, at, met, true, hits);
        match &self.surface {
            Surface::Plane(frame) => {
                if frame.z.z.abs() > 1e-12 {
                    let from = Point3::new(at.x, at.y, 0.0) - frame.origin;
                    let height = -from.dot(&frame.z) / frame.z.z;
                    let local = frame.local(&Point3::new(at.x, at.y, height));
                    add(Met::at(height, local.xy()));
                }
            }
            Surface::Cylinder(frame, radius) => {
                for (height, local) in quadric(frame, at, [1.0, 1.0, 0.0], 0.0, radius * radius) {
                    add(Met::at(height, Vector2::new(local.y.atan2(local.x), local.z)));
                }
            }
            Surface::Sphere(frame, radius) => {
                for (height, local) in quadric(frame, at, [1.0, 1.0, 1.0], 0.0, radius * radius) {
                    let up = local.z.atan2(local.x.hypot(local.y));
                    add(Met::at(height, Vector2::new(local.y.atan2(local.x), up)));
                }
            }
            Surface::Cone(frame, radius, tangent) => {
                // x² + y² − (t·z)² − 2·r·t·z = r².
                let linear = -2.0 * radius * tangent;
                let found = quadric(frame, at, [1.0, 1.0, -tangent * tangent], linear, radius * radius);
                for (height, local) in found {
                    let side = if radius + tangent * local.z < 0.0 { -1.0 } else { 1.0 };
                    add(Met::at(height, Vector2::new((local.y * side).atan2(local.x * side), local.z)));
                }
            }
            Surface::Patches(patches) => {
                let domain = patches.domain();
                for (number, part) in self.parts.at(at.y, self.rim) {
                    if part.top >= hidden_below(hits) {
                        let mut near = start.0.filter(|(of, _)| *of == number).map(|(_, place)| place);
                        let mut add = |met: Met, is_inside: bool| self.add(index, at, met, is_inside, hits);
                        part.meet(at, self.rim, domain, &mut near, &mut add);
                        if let Some(place) = near {
                            *start = Start(Some((number, place)));
                        }
                    }
                }
            }
            Surface::Unread(_) => {}
        }
    }

    /// Adds a place at which the axis meets the surface, if it is on the face and not hidden.
    fn add(&self, index: u32, at: Vector2<f64>, met: Met, may_be_inside: bool, hits: &mut Vec<FaceHit>) {
        let Met { height, parameters, normal } = met;
        if !height.is_finite() || height < hidden_below(hits) {
            return;
        }
        let is_inside = may_be_inside && self.trimming.contains(parameters);
        if is_inside || self.is_on_rim(Point3::new(at.x, at.y, height)) {
            let normal = normal.unwrap_or_else(|| self.surface.normal(parameters));
            let normal = if self.is_same_sense { normal } else { -normal };
            hits.push(FaceHit { height, normal, face: index, is_inside });
        }
    }

    /// Whether a place is inside the outline of the boundary in the view.
    fn outlines(&self, at: Vector2<f64>) -> bool {
        let crosses = |(_, [a, b]): &(u32, &[Point3<f64>; 2])| {
            (a.y <= at.y) != (b.y <= at.y) && a.x + (b.x - a.x) * (at.y - a.y) / (b.y - a.y) > at.x
        };
        self.sides.at(at.y, 0.0).filter(crosses).count() % 2 == 1
    }

    fn is_on_rim(&self, at: Point3<f64>) -> bool {
        self.sides.at(at.y, self.rim).any(|(_, [a, b])| {
            let along = b - a;
            let square = along.norm_squared();
            let share = if square > 0.0 { ((at - a).dot(&along) / square).clamp(0.0, 1.0) } else { 0.0 };
            (a + along * share - at).norm_squared() <= self.rim * self.rim
        })
    }
}

/// Where the axis of the laser meets the surface a·x² + b·y² + c·z² + linear·z = constant of a frame.
fn quadric(
    frame: &Frame,
    at: Vector2<f64>,
    squares: [f64; 3],
    linear: f64,
    constant: f64,
) -> impl Iterator<Item = (f64, Vector3<f64>)> {
    // Measured from the height of the frame's origin, for the sake of rounding.
    let from = frame.local(&Point3::new(at.x, at.y, frame.origin.z));
    let step = frame.local_vector(&Vector3::z());
    let sum = |one: &Vector3<f64>, other: &Vector3<f64>| {
        squares[0] * one.x * other.x + squares[1] * one.y * other.y + squares[2] * one.z * other.z
    };
    let a = sum(&step, &step);
    let half_b = sum(&from, &step) + linear * step.z / 2.0;
    let c = sum(&from, &from) + linear * from.z - constant;
    let root = half_b * half_b - a * c;
    let mut heights = [f64::NAN; 2];
    if a.abs() <= 1e-14 {
        if half_b.abs() > 1e-14 {
            heights[0] = -c / (2.0 * half_b);
        }
    } else if root >= 0.0 {
        let q = -(half_b + half_b.signum() * root.sqrt());
        heights = if q == 0.0 { [0.0, f64::NAN] } else { [q / a, c / q] };
    }
    let base = frame.origin.z;
    heights
        .into_iter()
        .filter(|height| height.is_finite())
        .map(move |height| (base + height, from + step * height))
}

/// The rectangle of the view in which a face can be; `None` if that is the one of its boundary.
fn reach(surface: &Surface, trimming: &Trimming, parts: &[Part]) -> Option<[Vector2<f64>; 2]> {
    let [low, high] = trimming.bounds();
    let circle = |frame: &Frame, along: f64, radius: f64| {
        let middle = frame.point(0.0, 0.0, along).coords.xy();
        let half = Vector2::new(frame.x.x.hypot(frame.y.x), frame.x.y.hypot(frame.y.y)) * radius.abs();
        [middle - half, middle + half]
    };
    let both = |[a, b]: [Vector2<f64>; 2], [c, d]: [Vector2<f64>; 2]| Some([a.inf(&c), b.sup(&d)]);
    match surface {
        Surface::Plane(_) | Surface::Unread(_) => None,
        Surface::Cylinder(frame, radius) if low.y.is_finite() => {
            both(circle(frame, low.y, *radius), circle(frame, high.y, *radius))
        }
        Surface::Cone(frame, radius, tangent) if low.y.is_finite() => {
            let at = |along: f64| circle(frame, along, radius + tangent * along);
            let ends = both(at(low.y), at(high.y));
            // The apex may be inside the face.
            let apex = if *tangent == 0.0 { low.y } else { -radius / tangent };
            ends.and_then(|ends| both(ends, circle(frame, apex, 0.0)))
        }
        Surface::Sphere(frame, radius) => {
            let middle = frame.origin.coords.xy();
            Some([middle.add_scalar(-radius), middle.add_scalar(*radius)])
        }
        Surface::Patches(_) => {
            parts.iter().map(|part| [part.low, part.high]).reduce(|[a, b], [c, d]| [a.inf(&c), b.sup(&d)])
        }
        Surface::Cylinder(..) | Surface::Cone(..) => None,
    }
}

/// The parts of the patches that can contain a piece of the face.
fn parts_of(patches: &Patches, trimming: &Trimming, smallest: f64) -> Vec<Part> {
    let [low, high] = trimming.bounds();
    let periods = [0, 1].map(|axis| patches.closed()[axis]);
    let mut parts = Vec::new();
    let mut open: Vec<(BezierPatch, [[f64; 2]; 2], u32)> = patches
        .cells()
        .filter(|(_, range)| {
            (0..2).all(|axis| {
                let margin = 1e-6 * (range[axis][1] - range[axis][0]);
                // Across a pole, and round a closed surface, the face is not limited by its boundary.
                let free = periods[axis]
                    || patches.poles().iter().flatten().any(|is_pole| *is_pole)
                    || !low[axis].is_finite();
                free || range[axis][1] >= low[axis] - margin && range[axis][0] <= high[axis] + margin
            })
        })
        .map(|(patch, range)| (patch.clone(), range, 0))
        .collect();
    while let Some((patch, range, depth)) = open.pop() {
        let points: Vec<Point2<f64>> = patch.points.iter().map(|point| projected(point).xy()).collect();
        let from = points.iter().fold(Vector2::repeat(f64::INFINITY), |low, point| low.inf(&point.coords));
        let to =
            points.iter().fold(Vector2::repeat(f64::NEG_INFINITY), |high, point| high.sup(&point.coords));
        let is_single = is_single(&patch, &points);
        if is_single || depth >= 40 || (to - from).amax() <= smallest || parts.len() + open.len() >= MAX_PARTS
        {
            let top = patch.points.iter().map(|point| projected(point).z).fold(f64::NEG_INFINITY, f64::max);
            parts.push(Part { patch, range, is_single, low: from, high: to, top });
            continue;
        }
        let axis = longer_axis(&patch, &points);
        let [low, high] = range[axis];
        let [first, second] = patch.halves(axis);
        let middle = (low + high) / 2.0;
        let with = |side: [f64; 2]| {
            let mut range = range;
            range[axis] = side;
            range
        };
        open.push((second, with([middle, high]), depth + 1));
        open.push((first, with([low, middle]), depth + 1));
    }
    parts
}

/// The axis along which the control net is longer in the view.
fn longer_axis(patch: &BezierPatch, points: &[Point2<f64>]) -> usize {
    let [p, q] = patch.degree;
    let at = |i: usize, j: usize| points[i * (q + 1) + j];
    let along_u =
        (0..=q).map(|j| (0..p).map(|i| (at(i + 1, j) - at(i, j)).norm()).sum::<f64>()).fold(0.0, f64::max);
    let along_v =
        (0..=p).map(|i| (0..q).map(|j| (at(i, j + 1) - at(i, j)).norm()).sum::<f64>()).fold(0.0, f64::max);
    usize::from(along_v > along_u)
}

/// Whether the view shows every place of the patch once: all directions of u differ from all of v, in the same sense. The
/// derivatives are positive sums of these differences, so no two places of the patch can coincide.
fn is_single(patch: &BezierPatch, points: &[Point2<f64>]) -> bool {
    let [p, q] = patch.degree;
    let at = |i: usize, j: usize| points[i * (q + 1) + j];
    let along_u = || (0..p).flat_map(|i| (0..=q).map(move |j| (i, j))).map(|(i, j)| at(i + 1, j) - at(i, j));
    let along_v = || (0..=p).flat_map(|i| (0..q).map(move |j| (i, j))).map(|(i, j)| at(i, j + 1) - at(i, j));
    let mean: Vector2<f64> = along_u().sum();
    // Most that fail do so here, at a fold: all of v must be on one side of u.
    let [is_left, is_right] = [1.0, -1.0].map(|way| along_v().any(|step| way * mean.perp(&step) > 0.0));
    if is_left == is_right {
        return false;
    }
    let angle =
        |step: Vector2<f64>| (step != Vector2::zeros()).then(|| mean.perp(&step).atan2(mean.dot(&step)));
    let (Some([u_low, u_high]), Some([v_low, v_high])) =
        (range_of(along_u().map(angle)), range_of(along_v().map(angle)))
    else {
        return false;
    };
    let half_turn = std::f64::consts::PI;
    let one_way = v_low >= u_high + APART && v_high <= u_low + half_turn - APART;
    let other_way = v_high <= u_low - APART && v_low >= u_high - half_turn + APART;
    u_high - u_low < 2.0 && v_high - v_low < 2.0 && (one_way || other_way)
}

/// Whether a place is beside the control net, seen along one of its sides: then it is beside the patch.
fn is_beside(patch: &BezierPatch, points: &[Point2<f64>], at: Vector2<f64>) -> bool {
    let [p, q] = patch.degree;
    let (first, last) = (points[0], points[points.len() - 1]);
    let corners =
        [points[p * (q + 1)] - first, last - points[q], points[q] - first, last - points[p * (q + 1)]];
    corners.iter().any(|side| {
        let size = side.norm();
        let across = |point: Vector2<f64>| side.perp(&(point - first.coords));
        let here = across(at);
        let margin = 1e-12 * (size + 1.0) * size;
        size > 0.0
            && (points.iter().all(|point| across(point.coords) > here + margin)
                || points.iter().all(|point| across(point.coords) < here - margin))
    })
}

/// The smallest and the largest value; `None` if one is missing.
fn range_of(mut values: impl Iterator<Item = Option<f64>>) -> Option<[f64; 2]> {
    values.try_fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
        value.map(|value| [low.min(value), high.max(value)])
    })
}

impl Part {
    /// Calls `add` with every place at which the axis of the laser meets the part, and with whether it is
    /// inside the part and not only within `rim` of it. `near` is a guess at its place in the part; the place
    /// that is found replaces it.
    fn meet(
        &self,
        at: Vector2<f64>,
        rim: f64,
        domain: [[f64; 2]; 2],
        near: &mut Option<[f64; 2]>,
        add: &mut impl FnMut(Met, bool),
    ) {
        let is_near = |low: &Vector2<f64>, high: &Vector2<f64>, margin: f64| {
            at.x >= low.x - margin
                && at.x <= high.x + margin
                && at.y >= low.y - margin
                && at.y <= high.y + margin
        };
        if !is_near(&self.low, &self.high, rim) {
            return;
        }
        let parameters = |s: f64, t: f64| {
            let [u, v] = self.range;
            Vector2::new(u[0] + (u[1] - u[0]) * s, v[0] + (v[1] - v[0]) * t)
        };
        // The continuation of the patch may pass here a second time; only a place inside counts.
        let is_inside = |place: &[f64; 2]| place.iter().all(|value| (0.0..=1.0).contains(value));
        let first = near.take().and_then(|start| newton(&self.patch, at, start));
        let first = first.filter(|(place, _)| is_inside(place));
        if self.is_single
            && let Some(([s, t], jet)) = first.or_else(|| newton(&self.patch, at, [0.5; 2]))
        {
            let (s_in, t_in) = (s.clamp(0.0, 1.0), t.clamp(0.0, 1.0));
            if (s - s_in).abs() <= 1e-9 && (t - t_in).abs() <= 1e-9 {
                *near = Some([s_in, t_in]);
                let (height, normal) = (jet.point.z, unit_normal(&jet));
                add(Met { height, parameters: parameters(s_in, t_in), normal }, true);
                return;
            }
            // Just beyond an end of the surface, its end is met.
            let [u, v] = self.range;
            let ends = [
                s < 0.0 && u[0] == domain[0][0],
                s > 1.0 && u[1] == domain[0][1],
                t < 0.0 && v[0] == domain[1][0],
                t > 1.0 && v[1] == domain[1][1],
            ];
            if ends.contains(&true) {
                let end = self.patch.jet(s_in, t_in).point;
                if (end.coords.xy() - at).norm() <= rim {
                    add(Met::at(end.z, parameters(s_in, t_in)), false);
                }
            }
            return;
        }
        if self.is_single {
            let points: Vec<Point2<f64>> =
                self.patch.points.iter().map(|point| projected(point).xy()).collect();
            if is_beside(&self.patch, &points, at) {
                return;
            }
        }
        // A fold of the surface in the view, or a place far beyond the part: divided until the view shows each piece once.
        let mut open = vec![(self.patch.clone(), [[0.0, 1.0], [0.0, 1.0]])];
        let mut found: Vec<f64> = Vec::new();
        for _ in 0..MAX_DIVISIONS {
            let Some((patch, [s, t])) = open.pop() else { break };
            let points: Vec<Point2<f64>> = patch.points.iter().map(|point| projected(point).xy()).collect();
            let low = points.iter().fold(Vector2::repeat(f64::INFINITY), |low, point| low.inf(&point.coords));
            let high =
                points.iter().fold(Vector2::repeat(f64::NEG_INFINITY), |high, point| high.sup(&point.coords));
            if !is_near(&low, &high, 1e-12) || is_beside(&patch, &points, at) {
                continue;
            }
            let mut take = |inner: [f64; 2]| {
                let place = [s[0] + (s[1] - s[0]) * inner[0], t[0] + (t[1] - t[0]) * inner[1]];
                let height = patch.jet(inner[0], inner[1]).point.z;
                if found.iter().all(|known| (known - height).abs() > 1e-7) {
                    found.push(height);
                    add(Met::at(height, parameters(place[0], place[1])), true);
                }
            };
            if is_single(&patch, &points)
                && let Some(([a, b], _)) = newton(&patch, at, [0.5; 2])
            {
                if a > -1e-9 && a < 1.0 + 1e-9 && b > -1e-9 && b < 1.0 + 1e-9 {
                    take([a.clamp(0.0, 1.0), b.clamp(0.0, 1.0)]);
                }
                continue;
            }
            if (high - low).amax() < FOLD {
                take([0.5, 0.5]);
                continue;
            }
            let axis = longer_axis(&patch, &points);
            let [first, second] = patch.halves(axis);
            let (low, high) = if axis == 0 { (s[0], s[1]) } else { (t[0], t[1]) };
            let middle = (low + high) / 2.0;
            let with = |side: [f64; 2]| if axis == 0 { [side, t] } else { [s, side] };
            open.push((first, with([low, middle])));
            open.push((second, with([middle, high])));
        }
    }
}

/// The unit normal of a patch; `None` where it is degenerate.
fn unit_normal(jet: &Jet) -> Option<Vector3<f64>> {
    let normal = jet.by_u.cross(&jet.by_v);
    (normal.norm() > 1e-6 * jet.by_u.norm() * jet.by_v.norm()).then(|| normal.normalize())
}

/// The parameters at which a patch is at this place of the view, found from `start`, and the patch there; `None` if the steps do not
/// converge.
fn newton(patch: &BezierPatch, at: Vector2<f64>, start: [f64; 2]) -> Option<([f64; 2], Jet)> {
    let [mut s, mut t] = start;
    let mut beyond = 0;
    for _ in 0..40 {
        let mut jet = patch.jet(s, t);
        let miss = at - jet.point.coords.xy();
        let (by_u, by_v) = (jet.by_u.xy(), jet.by_v.xy());
        let determinant = by_u.perp(&by_v);
        let step = Vector2::new(miss.perp(&by_v), by_u.perp(&miss)) / determinant;
        if !(step.x.is_finite() && step.y.is_finite()) {
            return None;
        }
        let size = step.amax();
        let step = if size > 0.7 { step * (0.7 / size) } else { step };
        (s, t) = ((s + step.x).clamp(-0.5, 1.5), (t + step.y).clamp(-0.5, 1.5));
        // The error that remains is about the square of the last step.
        if size < 1e-8 {
            jet.point += jet.by_u * step.x + jet.by_v * step.y;
            return Some(([s, t], jet));
        }
        // Beyond the patch there is nothing to find precisely.
        beyond = if [s, t].iter().any(|value| *value <= -0.5 || *value >= 1.5) { beyond + 1 } else { 0 };
        if beyond > 6 {
            return None;
        }
    }
    let jet = patch.jet(s, t);
    let miss = (jet.point.coords.xy() - at).norm();
    (miss < 1e-10).then_some(([s, t], jet))
}
