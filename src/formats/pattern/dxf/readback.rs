//! The second reader: compares a written file, as the `dxf` crate reads it, with the intended drawing.
//!
//! The crate shares no code with the writer, so an error is missed only if both are wrong in the same way. It reads
//! valid files; in others it may stop early without an error. So it is given only bytes with the writer's groups in the
//! writer's order, in which only coordinates, layers, colours, flags and the unit may differ.

use std::borrow::Cow;

use ::dxf::entities::{Entity, EntityType};
use ::dxf::enums::Units;

use super::write::{DxfProfile, plain_layer_names, write};
use crate::geometry::marking::{MarkingDrawing, MarkingPath, MarkingShape};
use crate::geometry::pattern::Color;
use crate::geometry::space::FieldPoint;
use crate::reason::{Place, Reason};

/// Largest error of a coordinate, mm: half of the last written decimal, and a little for rounding in f64.
const ROUNDING: f64 = 0.5e-6 + 1e-10;

/// Largest length of a number; the largest f64 with six decimals has 317 characters.
const LONGEST_NUMBER: usize = 320;
/// Largest length of a layer's name: 255 letters, each as `\U+XXXX`.
const LONGEST_NAME: usize = 255 * 7;
/// Number of letters of a group's value in messages.
const SHOWN: usize = 40;

/// A difference between a written file and the intended drawing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ReadbackError {
    /// A line differs from the one that is written for the drawing, or is missing: the file is cut off, or something
    /// was inserted, removed or changed.
    #[error("line {line} of the file is {found} instead of {meant}")]
    Line {
        /// The line, from 1.
        line: u64,
        /// The path that the line belongs to; for a line after the last path, the last path.
        path: Option<PathPlace>,
        /// The intended text.
        meant: String,
        /// The text that was found.
        found: String,
    },
    /// The second reader refuses the file.
    #[error("the second reader cannot read the file: {message}")]
    Unreadable {
        /// Its error message.
        message: String,
    },
    /// The file's unit is not mm.
    #[error("the unit of the file is {found} instead of mm")]
    Unit {
        /// The unit that was found.
        found: String,
    },
    /// A layer of the table has another name or colour, or is missing.
    #[error("layer {number} of the file {}", differing(found.as_deref(), meant))]
    Layer {
        /// Number of the layer in the drawing, from 1.
        number: usize,
        /// Its name and colour.
        meant: String,
        /// What was found; `None` if it is missing.
        found: Option<String>,
    },
    /// A path differs.
    #[error("{path} of the file {difference}")]
    Path {
        /// The path.
        path: PathPlace,
        /// What differs.
        difference: PathDifference,
    },
}

/// A path of the drawing, or one of its vertices.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PathPlace {
    /// Number of the path in drawing order, from 1.
    pub path: usize,
    /// Name of its layer in the file.
    pub layer: String,
    /// Number of the vertex in the path, from 1.
    pub vertex: Option<usize>,
}

/// A difference between an intended path and the path that was found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PathDifference {
    /// It is another kind of entity.
    #[error("is {found} instead of {meant}")]
    Kind {
        /// The intended kind, such as `LWPOLYLINE`.
        meant: &'static str,
        /// The kind that was found.
        found: &'static str,
    },
    /// It is on another layer.
    #[error("is on layer \"{found}\" instead of \"{meant}\"")]
    Layer {
        /// The intended layer.
        meant: String,
        /// The layer that was found.
        found: String,
    },
    /// It has another colour.
    #[error("has the colour {found} instead of {meant}")]
    Color {
        /// The intended colour.
        meant: String,
        /// The colour that was found.
        found: String,
    },
    /// It is closed but must be open, or the other way round.
    #[error("is {} instead of {}", closure(!meant), closure(*meant))]
    Closed {
        /// Whether it must be closed.
        meant: bool,
    },
    /// It has more or fewer vertices.
    #[error("has {found} vertices instead of {meant}")]
    Vertices {
        /// The intended number of vertices.
        meant: usize,
        /// The number of vertices that was found.
        found: usize,
    },
    /// A vertex is at another place.
    #[error("is at {} instead of {}", coordinates(*found), coordinates(*meant))]
    Vertex {
        /// Where it must be, mm.
        meant: [f64; 2],
        /// Where it was found, mm.
        found: [f64; 2],
    },
    /// It is missing.
    #[error("is missing")]
    Missing,
    /// It is not in the drawing.
    #[error("is not in the drawing")]
    Extra,
}

fn differing(found: Option<&str>, meant: &str) -> String {
    found.map_or_else(|| format!("is missing: {meant}"), |found| format!("is {found} instead of {meant}"))
}

/// A place in mm, with at most one digit more than in the file.
fn coordinates(place: [f64; 2]) -> String {
    let [x, y] = place.map(|value| (value * 1e7).round() / 1e7);
    format!("({x}, {y}) mm")
}

fn closure(closed: bool) -> &'static str {
    if closed { "closed" } else { "open" }
}

impl std::fmt::Display for PathPlace {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.vertex {
            Some(vertex) => write!(out, "vertex {vertex} of path {} on layer \"{}\"", self.path, self.layer),
            None => write!(out, "path {} on layer \"{}\"", self.path, self.layer),
        }
    }
}

impl ReadbackError {
    /// The difference as a reason: code, sentence, place, number and remedy.
    #[must_use]
    pub fn reason(&self) -> Reason {
        let what = format!("The written file does not match the corrected drawing: {self}.");
        let remedy = "Check the disk, the network and the memory of this computer, then try again. If the same drawing \
                      is refused again, it is a fault of isomark: keep the drawing and report it.";
        let mut reason = Reason::new("readback-differs", what, remedy);
        let (path, line) = match self {
            Self::Line { path, line, .. } => (path.as_ref(), Some(*line)),
            Self::Path { path, .. } => (Some(path), None),
            Self::Unreadable { .. } | Self::Unit { .. } | Self::Layer { .. } => (None, None),
        };
        let item = path.map(|place| match place.vertex {
            Some(vertex) => format!("path {}, vertex {vertex}", place.path),
            None => format!("path {}", place.path),
        });
        reason =
            reason.at(Place { line, item, layer: path.map(|place| place.layer.clone()), ..Place::default() });
        match self {
            Self::Path { difference: PathDifference::Vertex { meant, found }, .. } => {
                let distance = (found[0] - meant[0]).hypot(found[1] - meant[1]);
                reason.with_number("distance", distance, "mm", Some(ROUNDING))
            }
            _ => reason,
        }
    }
}

/// Reads `file`, which [`write()`] wrote for `drawing`, with a second reader, and compares it with the drawing: kind,
/// layer, colour and closure of every path, every vertex (within half of its sixth decimal), their order, the layers
/// and the unit. Bytes that no reader uses must be unchanged, too.
///
/// Time and memory depend on the size of the drawing, not on the bytes.
///
/// # Errors
/// The first difference, with its place.
pub fn read_back(file: &[u8], drawing: &MarkingDrawing, profile: DxfProfile) -> Result<(), ReadbackError> {
    let names = plain_layer_names(&drawing.layers, profile);
    let written = write(drawing, profile);
    let is_altered = file != written;
    let same_lines = |may_differ| {
        same_lines(file, &written, may_differ, |entity| {
            meant_entities(drawing, profile, &names).nth(entity).map(|meant| meant.place(None))
        })
    };
    if is_altered {
        same_lines(true)?;
    }
    same_content(&second_reading(file)?, drawing, profile, &names)?;
    // Finds changes without effect, such as additional zeros after a number.
    if is_altered { same_lines(false) } else { Ok(()) }
}

/// The work of [`read_back`] for a drawing, in vertices of a long R2000 polyline, each about 0.5 µs
/// (`benches/stages.rs`). It is proportional to the groups in the file: such a vertex has two, a vertex in R12 five, an
/// entity or a single line eight.
#[must_use]
pub fn readback_work(drawing: &MarkingDrawing, profile: DxfProfile) -> usize {
    let groups = drawing.paths.iter().map(|path| match (path.shape.points().len(), profile) {
        (vertices, DxfProfile::R2000) => 8 + 2 * vertices,
        (vertices, DxfProfile::R12) => 8 + 5 * vertices,
        (vertices, DxfProfile::R12Lines) => 8 * vertices,
    });
    groups.sum::<usize>() / 2
}

fn second_reading(file: &[u8]) -> Result<::dxf::Drawing, ReadbackError> {
    ::dxf::Drawing::load(&mut &*file)
        .map_err(|error| ReadbackError::Unreadable { message: error.to_string() })
}

/// Compares the lines of the file with the written ones. With `may_differ`, values that are compared later may differ,
/// if the second reader can read them.
fn same_lines(
    file: &[u8],
    written: &[u8],
    may_differ: bool,
    path_of: impl Fn(usize) -> Option<PathPlace>,
) -> Result<(), ReadbackError> {
    let mut lines = file.split_inclusive(|&byte| byte == b'\n');
    let mut written_lines = written.split_inclusive(|&byte| byte == b'\n');
    let mut at = Position::default();
    let (mut line, mut code) = (0, "");
    loop {
        let (found, meant) = (lines.next(), written_lines.next());
        line += 1;
        let text = meant.map_or("", |meant| std::str::from_utf8(meant).unwrap_or("").trim());
        let is_value = line % 2 == 0;
        if is_value {
            at.enter(code, text);
        } else {
            code = text;
        }
        let is_same = match (found, meant) {
            (None, None) => return Ok(()),
            (Some(found), Some(meant)) => {
                found == meant || may_differ && is_value && at.is_compared(code) && is_readable(code, found)
            }
            _ => false,
        };
        if !is_same {
            if !is_value && code != "0" {
                at.enter(code, "");
            }
            return Err(ReadbackError::Line {
                line,
                path: at.entity.and_then(path_of).map(|path| PathPlace { vertex: at.vertex, ..path }),
                meant: shown(meant),
                found: shown(found),
            });
        }
    }
}

/// The position of a line in the intended file.
#[derive(Default)]
struct Position<'m> {
    section: &'m str,
    /// The last value of group 0 or 9.
    head: &'m str,
    /// Number of the entity, from 0.
    entity: Option<usize>,
    /// Number of the vertex in its entity, from 1.
    vertex: Option<usize>,
}

impl<'m> Position<'m> {
    fn enter(&mut self, code: &str, value: &'m str) {
        match (code, value) {
            ("0", "VERTEX") => {
                (self.head, self.vertex) = (value, Some(self.vertex.map_or(1, |last| last + 1)))
            }
            ("0" | "9", _) => {
                if self.section == "ENTITIES" && !matches!(value, "SEQEND" | "ENDSEC") {
                    self.entity = Some(self.entity.map_or(0, |last| last + 1));
                    self.vertex = None;
                }
                self.head = value;
            }
            ("2", _) if self.head == "SECTION" => *self = Self { section: value, ..Self::default() },
            // The first point of a POLYLINE is not a vertex, and a VERTEX is already counted.
            ("10" | "11", _) if self.entity.is_some() && !matches!(self.head, "POLYLINE" | "VERTEX") => {
                self.vertex = Some(self.vertex.map_or(1, |last| last + 1));
            }
            _ => {}
        }
    }

    /// Whether the value of this group is compared with the drawing.
    fn is_compared(&self, code: &str) -> bool {
        match (self.section, self.head, code) {
            ("HEADER", head, code) => (head, code) == ("$INSUNITS", "70"),
            ("ENTITIES", "POLYLINE", "10" | "20") | ("ENTITIES", "VERTEX", "8") => false,
            ("ENTITIES", _, code) => matches!(code, "8" | "10" | "11" | "20" | "21" | "62" | "70" | "420"),
            _ => false,
        }
    }
}

/// Whether the second reader can read the value of such a group, with its line end.
fn is_readable(code: &str, line: &[u8]) -> bool {
    let Some(value) = line.strip_suffix(b"\r\n").and_then(|value| std::str::from_utf8(value).ok()) else {
        return false;
    };
    match code {
        "8" => value.len() <= LONGEST_NAME && value.bytes().all(|byte| matches!(byte, b' '..=b'~')),
        "62" | "70" => value.parse::<i16>().is_ok(),
        "420" => value.parse::<i32>().is_ok(),
        _ => {
            let digits = value.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'.' | b'-'));
            digits && value.len() <= LONGEST_NUMBER && value.parse::<f64>().is_ok_and(f64::is_finite)
        }
    }
}

/// A line for messages.
fn shown(line: Option<&[u8]>) -> String {
    let Some(line) = line else { return "the end of the file".into() };
    let text = String::from_utf8_lossy(&line[..line.len().min(4 * SHOWN)]);
    let text: String = text.trim().chars().take(SHOWN).collect();
    format!("\"{}\"", text.escape_debug())
}

/// An intended entity.
struct Meant<'d> {
    /// Number of its path, from 0.
    path: usize,
    kind: &'static str,
    layer: &'d str,
    color: Color,
    closed: bool,
    /// Number of its first vertex in the path, from 0.
    first: usize,
    /// Number of vertices in the path.
    of: usize,
    points: Cow<'d, [FieldPoint]>,
}

impl Meant<'_> {
    fn place(&self, vertex: Option<usize>) -> PathPlace {
        PathPlace {
            path: self.path + 1,
            layer: self.layer.to_owned(),
            vertex: vertex.map(|vertex| (self.first + vertex) % self.of + 1),
        }
    }
}

/// All entities that must be in the file, in order.
fn meant_entities<'d>(
    drawing: &'d MarkingDrawing,
    profile: DxfProfile,
    names: &'d [String],
) -> impl Iterator<Item = Meant<'d>> {
    let pieces = move |(path, MarkingPath { layer, color, shape }): (usize, &'d MarkingPath)| {
        let points = shape.points();
        let layer = names.get(*layer).map_or("0", String::as_str);
        let is_contour = matches!(shape, MarkingShape::Closed(_));
        let (kind, count) = match (points.len(), profile) {
            (0, _) => ("", 0),
            (1, _) => ("POINT", 1),
            (_, DxfProfile::R2000) => ("LWPOLYLINE", 1),
            (_, DxfProfile::R12) => ("POLYLINE", 1),
            (of, DxfProfile::R12Lines) => ("LINE", if is_contour { of } else { of - 1 }),
        };
        (0..count).map(move |first| Meant {
            path,
            kind,
            layer,
            color: *color,
            closed: is_contour && matches!(kind, "LWPOLYLINE" | "POLYLINE"),
            first,
            of: points.len(),
            points: match kind {
                "LINE" => Cow::Owned(vec![points[first], points[(first + 1) % points.len()]]),
                _ => Cow::Borrowed(points),
            },
        })
    };
    drawing.paths.iter().enumerate().flat_map(pieces)
}

/// Compares the content that the second reader found with the drawing.
fn same_content(
    read: &::dxf::Drawing,
    drawing: &MarkingDrawing,
    profile: DxfProfile,
    names: &[String],
) -> Result<(), ReadbackError> {
    // Before R2000 a file has no unit.
    if profile == DxfProfile::R2000 && read.header.default_drawing_units != Units::Millimeters {
        return Err(ReadbackError::Unit { found: format!("{:?}", read.header.default_drawing_units) });
    }
    same_layers(read, drawing, names)?;
    let mut found = read.entities();
    let mut paths = 0;
    for meant in meant_entities(drawing, profile, names) {
        let Some(found) = found.next() else {
            return Err(ReadbackError::Path { path: meant.place(None), difference: PathDifference::Missing });
        };
        same_path(&meant, found, profile)?;
        paths = meant.path + 1;
    }
    match found.next() {
        None => Ok(()),
        Some(extra) => Err(ReadbackError::Path {
            path: PathPlace { path: paths + 1, layer: extra.common.layer.clone(), vertex: None },
            difference: PathDifference::Extra,
        }),
    }
}

fn same_layers(
    read: &::dxf::Drawing,
    drawing: &MarkingDrawing,
    names: &[String],
) -> Result<(), ReadbackError> {
    // Layer 0 is in every file, even if the drawing has none.
    let own = |layer: &&::dxf::tables::Layer| layer.name != "0" || names.iter().any(|name| name == "0");
    let mut found = read.layers().filter(own);
    for (index, (layer, name)) in drawing.layers.iter().zip(names).enumerate() {
        let meant = format!("\"{name}\" in colour {}", index_of(layer.color).unwrap_or(7));
        let found = found
            .next()
            .map(|found| format!("\"{}\" in colour {}", found.name, found.color.index().unwrap_or(0)));
        if found.as_ref() != Some(&meant) {
            return Err(ReadbackError::Layer { number: index + 1, meant, found });
        }
    }
    Ok(())
}

/// The index of a colour in the file; `None` for BYLAYER.
fn index_of(color: Color) -> Option<u8> {
    match color {
        Color::ByLayer => None,
        // 0 is BYBLOCK, but there are no blocks: it is written as the default, 7.
        Color::Aci(0) | Color::Rgb { aci: 0, .. } => Some(7),
        Color::Aci(aci) | Color::Rgb { aci, .. } => Some(aci),
    }
}

fn same_path(meant: &Meant<'_>, entity: &Entity, profile: DxfProfile) -> Result<(), ReadbackError> {
    let differs = |vertex, difference| Err(ReadbackError::Path { path: meant.place(vertex), difference });
    let found = Found::of(entity);
    if found.kind != meant.kind {
        return differs(None, PathDifference::Kind { meant: meant.kind, found: found.kind });
    }
    if entity.common.layer != meant.layer {
        let (meant, found) = (meant.layer.to_owned(), entity.common.layer.clone());
        return differs(None, PathDifference::Layer { meant, found });
    }
    let rgb = match meant.color {
        Color::Rgb { rgb: [red, green, blue], .. } if profile == DxfProfile::R2000 => {
            u32::from_be_bytes([0, red, green, blue])
        }
        _ => 0,
    };
    let colors = (color_name(index_of(meant.color), i64::from(rgb)), found.color);
    if colors.0 != colors.1 {
        return differs(None, PathDifference::Color { meant: colors.0, found: colors.1 });
    }
    if found.closed != meant.closed {
        return differs(None, PathDifference::Closed { meant: meant.closed });
    }
    for (vertex, (&point, &found)) in meant.points.iter().zip(&found.points).enumerate() {
        let meant = [point.x, point.y];
        let is_there = |axis: usize| {
            (found[axis] - meant[axis]).abs() <= ROUNDING + meant[axis].abs() * 4.0 * f64::EPSILON
        };
        if !(is_there(0) && is_there(1)) {
            return differs(Some(vertex), PathDifference::Vertex { meant, found });
        }
    }
    match (meant.points.len(), found.points.len()) {
        (meant, found) if meant == found => Ok(()),
        (meant, found) => differs(None, PathDifference::Vertices { meant, found }),
    }
}

/// An entity as the second reader found it.
struct Found {
    kind: &'static str,
    color: String,
    closed: bool,
    points: Vec<[f64; 2]>,
}

impl Found {
    fn of(entity: &Entity) -> Self {
        let (kind, closed, points) = match &entity.specific {
            EntityType::LwPolyline(line) => {
                ("LWPOLYLINE", line.flags == 1, line.vertices.iter().map(|v| [v.x, v.y]).collect())
            }
            EntityType::Polyline(line) => {
                let points = line.vertices().map(|vertex| [vertex.location.x, vertex.location.y]);
                ("POLYLINE", line.flags == 1, points.collect())
            }
            EntityType::Line(line) => ("LINE", false, vec![[line.p1.x, line.p1.y], [line.p2.x, line.p2.y]]),
            EntityType::ModelPoint(point) => ("POINT", false, vec![[point.location.x, point.location.y]]),
            _ => ("another kind of entity", false, Vec::new()),
        };
        let common = &entity.common;
        let index = if common.color.is_by_layer() { None } else { Some(common.color.index().unwrap_or(0)) };
        Self { kind, color: color_name(index, i64::from(common.color_24_bit)), closed, points }
    }
}

/// A colour for messages; the second reader does not distinguish between true colour 0 (black) and no true colour.
fn color_name(index: Option<u8>, rgb: i64) -> String {
    let index = index.map_or_else(|| "of the layer".to_owned(), |index| index.to_string());
    if rgb == 0 { index } else { format!("{index} #{rgb:06x}") }
}

#[cfg(test)]
mod tests;
