//! Points, curves, surfaces and faces from records.

use std::collections::BTreeMap;

use nalgebra::{Point3, Unit, Vector3};

use super::error::{StepError, StepProblem};
use super::exchange::{Exchange, Parameters, Record, Value};
use crate::geometry::solid::bezier::Weighted;
use crate::geometry::solid::curve::{Curve, Spline, weighted};
use crate::geometry::solid::frame::Frame;
use crate::geometry::solid::surface::{Patches, Surface};
use crate::geometry::solid::{Edge, Face, LARGEST_GAP, Side};

/// Distance of the chords of a tessellation, mm.
pub(super) const COARSE: f64 = 0.01;
/// Largest number of control points of one surface.
const MAX_CONTROL: usize = 2_000_000;
/// Largest depth of curves and surfaces that refer to others.
const MAX_DEPTH: usize = 16;
/// Largest number of points of all edges of a shape.
const MAX_EDGE_POINTS: usize = 8_000_000;

/// The units of a representation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Units {
    /// Millimetres for each unit of length.
    pub(super) length: f64,
    /// Radians for each unit of angle.
    pub(super) angle: f64,
}

/// Reads the geometry of one representation.
pub(super) struct Geometry<'f, 'a> {
    file: &'f Exchange<'a>,
    units: Units,
    pub(super) edges: Vec<Edge>,
    pub(super) faces: Vec<Face>,
    /// The edges that were read, by the number of their record; `Err` with the kind of one that cannot be read.
    known: BTreeMap<u64, (u32, Result<(), String>)>,
    edge_points: usize,
    /// The faces named `mark`.
    pub(super) marks: Vec<u64>,
}

/// The way to a result that a kind of geometry that is not read may cut short.
type Read<T> = Result<T, StepError>;

impl<'f, 'a> Geometry<'f, 'a> {
    pub(super) fn new(file: &'f Exchange<'a>, units: Units) -> Self {
        Self {
            file,
            units,
            edges: Vec::new(),
            faces: Vec::new(),
            known: BTreeMap::new(),
            edge_points: 0,
            marks: Vec::new(),
        }
    }

    fn point_of(&self, record: &Record<'a>) -> Read<Point3<f64>> {
        let parameters = record.expect(self.file, &["CARTESIAN_POINT"])?;
        let numbers = parameters.numbers(1)?;
        let at = |index: usize| numbers.get(index).copied().unwrap_or(0.0) * self.units.length;
        if numbers.is_empty() || numbers.len() > 3 {
            return Err(
                parameters.error(StepProblem::WrongValue { index: 2, expected: "a list of three numbers" })
            );
        }
        Ok(Point3::new(at(0), at(1), at(2)))
    }

    pub(super) fn point(&self, parameters: &Parameters<'_, 'a>, index: usize) -> Read<Point3<f64>> {
        self.point_of(&parameters.follow(index)?)
    }

    fn points(&self, parameters: &Parameters<'_, 'a>, ids: &[u64]) -> Read<Vec<Point3<f64>>> {
        ids.iter().map(|id| self.point_of(&self.file.record(*id, parameters)?)).collect()
    }

    fn direction_of(&self, record: &Record<'a>) -> Read<Vector3<f64>> {
        let parameters = record.expect(self.file, &["DIRECTION"])?;
        let numbers = parameters.numbers(1)?;
        let at = |index: usize| numbers.get(index).copied().unwrap_or(0.0);
        let vector = Vector3::new(at(0), at(1), at(2));
        let length = vector.norm();
        (length.is_finite() && length > 1e-300)
            .then(|| vector / length)
            .ok_or_else(|| parameters.error(StepProblem::NoAxes))
    }

    pub(super) fn direction(
        &self,
        parameters: &Parameters<'_, 'a>,
        index: usize,
    ) -> Read<Option<Vector3<f64>>> {
        match parameters.value(index) {
            None | Some(Value::Unset | Value::Derived) => Ok(None),
            Some(_) => Ok(Some(self.direction_of(&parameters.follow(index)?)?)),
        }
    }

    /// A placement with its axes, mm.
    pub(super) fn frame(&self, record: &Record<'a>) -> Read<Frame> {
        let parameters = record.expect(self.file, &["AXIS2_PLACEMENT_3D"])?;
        let origin = self.point(&parameters, 1)?;
        let (z, x) = (self.direction(&parameters, 2)?, self.direction(&parameters, 3)?);
        Frame::new(origin, z, x).ok_or_else(|| parameters.error(StepProblem::NoAxes))
    }

    fn frame_at(&self, parameters: &Parameters<'_, 'a>, index: usize) -> Read<Frame> {
        self.frame(&parameters.follow(index)?)
    }

    /// A positive length, mm.
    fn length(&self, parameters: &Parameters<'_, 'a>, index: usize, what: &'static str) -> Read<f64> {
        let value = parameters.number(index)?;
        let length = value * self.units.length;
        match length > 0.0 && length <= 1e9 {
            true => Ok(length),
            false => Err(parameters.error(StepProblem::WrongNumber { what, value: value.to_string() })),
        }
    }

    fn unread<T>(&self, record: &Record<'a>) -> Read<T> {
        Err(record.first(self.file).error(StepProblem::Unread { kind: record.kind().to_owned() }))
    }

    /// A curve, and whether it has the direction of the record.
    fn curve(&self, record: &Record<'a>, depth: usize) -> Read<(Curve, bool)> {
        let first = record.first(self.file);
        if depth > MAX_DEPTH {
            return Err(first.error(StepProblem::Cyclic));
        }
        if record.is("B_SPLINE_CURVE") || ends_with(record, "_CURVE", SPLINES) {
            return Ok((Curve::Spline(self.spline(record)?), true));
        }
        let curve = match record.kind() {
            "LINE" => {
                let vector = first.follow(2)?;
                let vector = vector.expect(self.file, &["VECTOR"])?;
                let direction = self.direction_of(&vector.follow(1)?)?;
                Curve::Line(self.point(&first, 1)?, direction)
            }
            "CIRCLE" => {
                let radius = self.length(&first, 2, "radius")?;
                Curve::Ellipse(self.frame_at(&first, 1)?, radius, radius)
            }
            "ELLIPSE" => {
                let (a, b) = (self.length(&first, 2, "semi-axis")?, self.length(&first, 3, "semi-axis")?);
                Curve::Ellipse(self.frame_at(&first, 1)?, a, b)
            }
            "PARABOLA" => Curve::Parabola(self.frame_at(&first, 1)?, self.length(&first, 2, "focal length")?),
            "HYPERBOLA" => {
                let (a, b) = (self.length(&first, 2, "semi-axis")?, self.length(&first, 3, "semi-axis")?);
                Curve::Hyperbola(self.frame_at(&first, 1)?, a, b)
            }
            "POLYLINE" => {
                let points = self.points(&first, &first.references(1)?)?;
                if points.len() < 2 {
                    return Err(first.error(StepProblem::WrongValue {
                        index: 2,
                        expected: "a list of two points or more",
                    }));
                }
                Curve::Polyline(points)
            }
            "SURFACE_CURVE" | "SEAM_CURVE" | "INTERSECTION_CURVE" | "BOUNDED_SURFACE_CURVE" => {
                return self.curve(&first.follow(1)?, depth + 1);
            }
            "TRIMMED_CURVE" => {
                let (curve, forward) = self.curve(&first.follow(1)?, depth + 1)?;
                return Ok((curve, forward == first.flag(4)?));
            }
            _ => return self.unread(record),
        };
        Ok((curve, true))
    }

    fn spline(&self, record: &Record<'a>) -> Read<Spline> {
        // In a record of several kinds each has its own parameters, without the name.
        let (own, shift) = match record.of(self.file, "B_SPLINE_CURVE") {
            Some(own) => (own, 0),
            None => (record.first(self.file), 1),
        };
        let degree = own.count(shift)?;
        let ids = own.references(shift + 1)?;
        self.check_control(&own, ids.len())?;
        let points = self.points(&own, &ids)?;
        let weights = self
            .weights(record, "RATIONAL_B_SPLINE_CURVE", points.len(), |parameters| parameters.numbers(0))?;
        let knots = match record.of(self.file, "B_SPLINE_CURVE_WITH_KNOTS") {
            Some(knots) => {
                let first = if record.is_complex() { 0 } else { 6 };
                full_knots(&knots, first, first + 1)?
            }
            None => implied_knots(record, degree, points.len()),
        };
        let points: Vec<Weighted> =
            points.into_iter().zip(weights).map(|(point, weight)| weighted(point, weight)).collect();
        Spline::new(degree, &knots, &points).map_err(|error| own.error(error.into()))
    }

    fn check_control(&self, parameters: &Parameters<'_, 'a>, count: usize) -> Read<()> {
        if count > MAX_CONTROL {
            return Err(
                parameters.error(StepProblem::TooLarge { what: "control points", limit: MAX_CONTROL as u64 })
            );
        }
        Ok(())
    }

    fn weights(
        &self,
        record: &Record<'a>,
        kind: &'static str,
        count: usize,
        read: impl Fn(&Parameters<'_, 'a>) -> Read<Vec<f64>>,
    ) -> Read<Vec<f64>> {
        let Some(parameters) = record.of(self.file, kind) else { return Ok(vec![1.0; count]) };
        let weights = read(&parameters)?;
        if weights.len() != count {
            return Err(parameters
                .error(StepProblem::WrongValue { index: 1, expected: "one weight for each control point" }));
        }
        Ok(weights)
    }

    /// The surface of a face whose loops go through these points.
    fn surface(&self, record: &Record<'a>, around: &[Point3<f64>], depth: usize) -> Read<Surface> {
        let first = record.first(self.file);
        if depth > MAX_DEPTH {
            return Err(first.error(StepProblem::Cyclic));
        }
        if record.is("B_SPLINE_SURFACE") || ends_with(record, "_SURFACE", SPLINES) {
            return Ok(Surface::Patches(self.patches(record)?));
        }
        let frame = || self.frame_at(&first, 1);
        match record.kind() {
            "PLANE" => Ok(Surface::Plane(frame()?)),
            "CYLINDRICAL_SURFACE" => Ok(Surface::Cylinder(frame()?, self.length(&first, 2, "radius")?)),
            "CONICAL_SURFACE" => {
                let radius = first.number(2)? * self.units.length;
                let angle = first.number(3)? * self.units.angle;
                if !(0.0..=1e9).contains(&radius) {
                    return Err(
                        first.error(StepProblem::WrongNumber { what: "radius", value: radius.to_string() })
                    );
                }
                if !(angle.abs() > 1e-9 && angle.abs() < std::f64::consts::FRAC_PI_2 - 1e-6) {
                    return Err(first
                        .error(StepProblem::WrongNumber { what: "half angle", value: angle.to_string() }));
                }
                Ok(Surface::Cone(frame()?, radius, angle.tan()))
            }
            "SPHERICAL_SURFACE" => Ok(Surface::Sphere(frame()?, self.length(&first, 2, "radius")?)),
            "TOROIDAL_SURFACE" | "DEGENERATE_TOROIDAL_SURFACE" => {
                let (major, minor) =
                    (first.number(2)? * self.units.length, self.length(&first, 3, "radius")?);
                if !(0.0..=1e9).contains(&major) {
                    return Err(
                        first.error(StepProblem::WrongNumber { what: "radius", value: major.to_string() })
                    );
                }
                let frame = frame()?;
                let is_outer = match first.value(4) {
                    Some(Value::Name(_)) => Some(first.flag(4)?),
                    _ => None,
                };
                let is_outer = is_outer.unwrap_or_else(|| {
                    let misfit = |sign: f64| -> f64 {
                        let miss = |point: &Point3<f64>| {
                            let local = frame.local(point);
                            ((local.x.hypot(local.y) - sign * major).hypot(local.z) - minor).abs()
                        };
                        around.iter().map(miss).sum()
                    };
                    misfit(1.0) <= misfit(-1.0)
                });
                Ok(Surface::Patches(Patches::torus(&frame, major, minor, is_outer)))
            }
            "SURFACE_OF_LINEAR_EXTRUSION" => {
                let (profile, _) = self.curve(&first.follow(1)?, depth + 1)?;
                let vector = first.follow(2)?;
                let vector = vector.expect(self.file, &["VECTOR"])?;
                let direction = self.direction_of(&vector.follow(1)?)?;
                let reach = reach(&profile, around, None);
                let Some(profile) = profile.as_spline(reach) else { return self.unread(record) };
                let along = |point: &Point3<f64>| point.coords.dot(&direction);
                let of_profile = range(
                    profile
                        .curves
                        .iter()
                        .flat_map(|curve| &curve.points)
                        .map(|point| along(&Point3::from(point.xyz() / point.w))),
                );
                let of_face = range(around.iter().map(along));
                let (from, to) = (of_face[0] - of_profile[1], of_face[1] - of_profile[0]);
                if !(from.is_finite() && to > from) {
                    return self.unread(record);
                }
                Ok(Surface::Patches(Patches::extruded(&profile, direction, from, to)))
            }
            "SURFACE_OF_REVOLUTION" => {
                let (profile, _) = self.curve(&first.follow(1)?, depth + 1)?;
                let axis = first.follow(2)?;
                let axis = axis.expect(self.file, &["AXIS1_PLACEMENT"])?;
                let origin = self.point(&axis, 1)?;
                let direction = self.direction(&axis, 2)?.unwrap_or_else(Vector3::z);
                let reach = reach(&profile, around, Some(origin));
                let axis = Unit::new_unchecked(direction);
                let profile = profile.as_spline(reach);
                let Some(profile) = profile.and_then(|profile| profile.one_side(origin, axis, around)) else {
                    return self.unread(record);
                };
                Ok(Surface::Patches(Patches::revolved(&profile, origin, axis)))
            }
            "RECTANGULAR_TRIMMED_SURFACE" | "CURVE_BOUNDED_SURFACE" => {
                self.surface(&first.follow(1)?, around, depth + 1)
            }
            _ => self.unread(record),
        }
    }

    fn patches(&self, record: &Record<'a>) -> Read<Patches> {
        let (own, shift) = match record.of(self.file, "B_SPLINE_SURFACE") {
            Some(own) => (own, 0),
            None => (record.first(self.file), 1),
        };
        let degree = [own.count(shift)?, own.count(shift + 1)?];
        let rows = own.list(shift + 2)?;
        let mut points = Vec::new();
        let mut columns = None;
        for row in rows {
            let Value::List(row) = row else {
                return Err(own.error(StepProblem::WrongValue {
                    index: shift + 3,
                    expected: "a list of lists of points",
                }));
            };
            if *columns.get_or_insert(row.len()) != row.len() {
                return Err(own.error(StepProblem::WrongValue {
                    index: shift + 3,
                    expected: "a list of lists of the same length",
                }));
            }
            self.check_control(&own, points.len() + row.len())?;
            for value in row {
                let Value::Reference(id) = value else {
                    return Err(own.error(StepProblem::WrongValue {
                        index: shift + 3,
                        expected: "a list of lists of points",
                    }));
                };
                points.push(self.point_of(&self.file.record(*id, &own)?)?);
            }
        }
        let count = [rows.len(), columns.unwrap_or(0)];
        let flat = |parameters: &Parameters<'_, 'a>| -> Read<Vec<f64>> {
            let mut all = Vec::new();
            for row in parameters.list(0)? {
                let Value::List(row) = row else {
                    return Err(parameters.error(StepProblem::WrongValue {
                        index: 1,
                        expected: "a list of lists of numbers",
                    }));
                };
                for value in row {
                    let Value::Number(number) = value else {
                        return Err(parameters.error(StepProblem::WrongValue {
                            index: 1,
                            expected: "a list of lists of numbers",
                        }));
                    };
                    all.push(*number);
                }
            }
            Ok(all)
        };
        let weights = self.weights(record, "RATIONAL_B_SPLINE_SURFACE", points.len(), flat)?;
        let knots = match record.of(self.file, "B_SPLINE_SURFACE_WITH_KNOTS") {
            Some(knots) => {
                let first = if record.is_complex() { 0 } else { 8 };
                [full_knots(&knots, first, first + 2)?, full_knots(&knots, first + 1, first + 3)?]
            }
            None => [0, 1].map(|axis| implied_knots(record, degree[axis], count[axis])),
        };
        let points: Vec<Weighted> =
            points.into_iter().zip(weights).map(|(point, weight)| weighted(point, weight)).collect();
        Patches::new(degree, [&knots[0], &knots[1]], &points, count).map_err(|error| own.error(error.into()))
    }

    /// Reads the faces of a shell, for a body with this number; `reversed` is whether its inside is its outside.
    pub(super) fn shell(&mut self, record: &Record<'a>, body: u32, reversed: bool, depth: usize) -> Read<()> {
        if depth > MAX_DEPTH {
            return Err(record.first(self.file).error(StepProblem::Cyclic));
        }
        if record.is("ORIENTED_CLOSED_SHELL") || record.is("ORIENTED_OPEN_SHELL") {
            let parameters = record.first(self.file);
            let reversed = reversed == parameters.flag(3)?;
            return self.shell(&parameters.follow(2)?, body, reversed, depth + 1);
        }
        let kinds = ["CLOSED_SHELL", "OPEN_SHELL", "CONNECTED_FACE_SET"];
        let parameters = record.expect(self.file, &kinds)?;
        for id in parameters.references(1)? {
            let face = self.file.record(id, &parameters)?;
            self.face(&face, body, reversed, depth + 1)?;
        }
        Ok(())
    }

    fn face(&mut self, record: &Record<'a>, body: u32, reversed: bool, depth: usize) -> Read<()> {
        if depth > MAX_DEPTH {
            return Err(record.first(self.file).error(StepProblem::Cyclic));
        }
        if record.is("ORIENTED_FACE") {
            let parameters = record.first(self.file);
            let reversed = reversed == parameters.flag(3)?;
            return self.face(&parameters.follow(2)?, body, reversed, depth + 1);
        }
        let parameters = record.expect(self.file, &["ADVANCED_FACE", "FACE_SURFACE"])?;
        if parameters.text(0).trim() == "mark" {
            self.marks.push(record.id);
        }
        let mut loops = Vec::new();
        let mut unread: Option<String> = None;
        for id in parameters.references(1)? {
            let bound = self.file.record(id, &parameters)?;
            let bound = bound.expect(self.file, &["FACE_BOUND", "FACE_OUTER_BOUND"])?;
            let forward = bound.flag(2)?;
            let inner = bound.follow(1)?;
            let (mut sides, problem) = self.bound(&inner)?;
            unread = unread.or(problem);
            if !forward {
                sides.reverse();
                sides.iter_mut().for_each(|side| side.forward = !side.forward);
            }
            loops.push(sides);
        }
        let around: Vec<Point3<f64>> =
            loops.iter().flatten().flat_map(|side| &self.edges[side.edge as usize].coarse).copied().collect();
        let surface = match unread {
            Some(kind) => Surface::Unread(kind),
            None => match self.surface(&parameters.follow(2)?, &around, 0) {
                Err(StepError { problem: StepProblem::Unread { kind }, .. }) => Surface::Unread(kind),
                surface => surface?,
            },
        };
        let kind = match &surface {
            Surface::Unread(kind) => format!("{kind} (not read)"),
            _ => kind_of(&parameters.follow(2)?),
        };
        let mut face = Face::new(record.id, body, surface, parameters.flag(3)?, loops, &self.edges);
        if face.gap > LARGEST_GAP && !matches!(face.surface, Surface::Unread(_)) {
            face.surface =
                Surface::Unread(format!("face whose edges are {:.3} mm away from its surface", face.gap));
        }
        face.kind = kind;
        face.is_same_sense ^= reversed;
        self.faces.push(face);
        Ok(())
    }

    /// The sides of a loop, and the kind of a curve that is not read.
    fn bound(&mut self, record: &Record<'a>) -> Read<(Vec<Side>, Option<String>)> {
        let mut unread = None;
        let mut sides = Vec::new();
        let parameters = record.expect(self.file, &["EDGE_LOOP", "POLY_LOOP", "VERTEX_LOOP"])?;
        if record.is("VERTEX_LOOP") {
            return Ok((sides, None));
        }
        if record.is("POLY_LOOP") {
            let points = self.points(&parameters, &parameters.references(1)?)?;
            for (index, point) in points.iter().enumerate() {
                let line = vec![*point, points[(index + 1) % points.len()]];
                sides.push(Side { edge: self.edges.len() as u32, forward: true });
                self.edges.push(Edge { points: line.clone(), coarse: line });
            }
            return Ok((sides, None));
        }
        for id in parameters.references(1)? {
            let oriented = self.file.record(id, &parameters)?;
            let oriented = oriented.expect(self.file, &["ORIENTED_EDGE"])?;
            let edge = oriented.follow(3)?;
            let (edge, problem) = self.edge(&edge)?;
            unread = unread.or(problem.err());
            sides.push(Side { edge, forward: oriented.flag(4)? });
        }
        Ok((sides, unread))
    }

    fn edge(&mut self, record: &Record<'a>) -> Read<(u32, Result<(), String>)> {
        if let Some(known) = self.known.get(&record.id) {
            return Ok(known.clone());
        }
        let parameters = record.expect(self.file, &["EDGE_CURVE"])?;
        let vertex = |index: usize| -> Read<Point3<f64>> {
            let vertex = parameters.follow(index)?;
            let vertex = vertex.expect(self.file, &["VERTEX_POINT"])?;
            self.point(&vertex, 1)
        };
        let (start, end) = (vertex(1)?, vertex(2)?);
        let forward = parameters.flag(4)?;
        let (edge, state) = match self.curve(&parameters.follow(3)?, 0) {
            Ok((curve, along)) => (Edge::along(&curve, start, end, forward == along, COARSE), Ok(())),
            Err(StepError { problem: StepProblem::Unread { kind }, .. }) => {
                (Edge { points: vec![start, end], coarse: vec![start, end] }, Err(kind))
            }
            Err(error) => return Err(error),
        };
        self.edge_points += edge.points.len();
        if self.edge_points > MAX_EDGE_POINTS {
            return Err(parameters
                .error(StepProblem::TooLarge { what: "points along edges", limit: MAX_EDGE_POINTS as u64 }));
        }
        let found = (self.edges.len() as u32, state);
        self.edges.push(edge);
        self.known.insert(record.id, found.clone());
        Ok(found)
    }
}

/// The kind of a surface as people name it.
fn kind_of(record: &Record<'_>) -> String {
    match record.kind() {
        "PLANE" => "plane",
        "CYLINDRICAL_SURFACE" => "cylinder",
        "CONICAL_SURFACE" => "cone",
        "SPHERICAL_SURFACE" => "sphere",
        "TOROIDAL_SURFACE" | "DEGENERATE_TOROIDAL_SURFACE" => "torus",
        "SURFACE_OF_LINEAR_EXTRUSION" => "extrusion",
        "SURFACE_OF_REVOLUTION" => "revolution",
        _ => "B-spline",
    }
    .to_owned()
}

/// The beginnings of the names of splines whose knots follow from their kind, or are given.
const SPLINES: &[&str] = &[
    "B_SPLINE",
    "BEZIER",
    "QUASI_UNIFORM",
    "UNIFORM",
    "B_SPLINE_CURVE_WITH_KNOTS",
    "B_SPLINE_SURFACE_WITH_KNOTS",
];

fn ends_with(record: &Record<'_>, end: &str, starts: &[&str]) -> bool {
    let kind = record.kind();
    starts.iter().any(|start| kind == *start && kind.contains(end) || kind.strip_prefix(start) == Some(end))
}

/// The knots with their multiplicities, which are the parameters at `times` and `values`.
fn full_knots(parameters: &Parameters<'_, '_>, times: usize, values: usize) -> Read<Vec<f64>> {
    let (counts, knots) = (parameters.numbers(times)?, parameters.numbers(values)?);
    let wrong = || parameters.error(StepProblem::Spline(crate::geometry::solid::bezier::SplineError::Knots));
    let total: f64 = counts.iter().sum();
    if counts.len() != knots.len()
        || !counts.iter().all(|count| *count >= 1.0 && count.fract() == 0.0)
        || total > MAX_CONTROL as f64
    {
        return Err(wrong());
    }
    Ok(counts
        .iter()
        .zip(&knots)
        .flat_map(|(count, knot)| std::iter::repeat_n(*knot, *count as usize))
        .collect())
}

/// The knots that the kind of a spline implies.
fn implied_knots(record: &Record<'_>, degree: usize, count: usize) -> Vec<f64> {
    let kinds = |kind: &str| record.is(&format!("{kind}_CURVE")) || record.is(&format!("{kind}_SURFACE"));
    if degree == 0 || count <= degree {
        return Vec::new();
    }
    if kinds("UNIFORM") {
        return (0..count + degree + 1).map(|index| index as f64 - degree as f64).collect();
    }
    let (inner, times) = match kinds("BEZIER") {
        true => ((count - 1) / degree, degree),
        false => (count - degree, 1),
    };
    let mut knots = vec![0.0; degree + 1];
    for index in 1..inner {
        knots.extend(std::iter::repeat_n(index as f64, times));
    }
    knots.extend(std::iter::repeat_n(inner as f64, degree + 1));
    knots
}

/// How far an unbounded profile must reach from its point so that it covers a face, mm; `origin` is on the axis of a revolution.
fn reach(profile: &Curve, around: &[Point3<f64>], origin: Option<Point3<f64>>) -> f64 {
    let middle = match profile {
        Curve::Line(point, _) => *point,
        Curve::Parabola(frame, _) => frame.origin,
        _ => return 0.0,
    };
    let farthest = |from: Point3<f64>| around.iter().map(|point| (point - from).norm()).fold(1.0, f64::max);
    match origin {
        None => farthest(middle),
        Some(origin) => farthest(origin) + (middle - origin).norm(),
    }
}

fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
}
