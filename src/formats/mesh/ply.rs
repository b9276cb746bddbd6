//! PLY, text and binary of both byte orders (Turk, The PLY polygon file format, 1994).
//!
//! Properties may have any order and type, and elements may be unknown, so every value is read as the header declares
//! it. A count is used only after checking that the file has enough bytes for it; crates do not make these checks. A
//! file with faces or strips of triangles is a mesh, one without is a scan.

use std::cmp::Ordering;

use nalgebra::{Point3, Vector3};

use super::clues::{Clues, stated_unit};
use super::error::{EmptyCause, VertexPlace};
use super::raw::is_infinite;
use super::text::{bad_line, first_bytes, no_number, number, without_mark, words};
use super::{MAX_POINTS, MAX_TRIANGLES, MeshFormat, MeshReadError, NormalsFound, RawPart, at_most};
use super::{normals, polygon};
use crate::formats::Pace;

/// Longest header, bytes.
const LONGEST_HEADER: usize = 1 << 16;
/// Largest number of corners of a face, more than any product has; triangulation takes up to the square of it.
const MAX_CORNERS: usize = 10_000;
/// The element of triangles that share corners with the one before, as Stanford's tools write it.
const STRIPS: &str = "tristrips";
const FORMAT: MeshFormat = MeshFormat::Ply;

/// Reads a part or a scan from a PLY file.
pub(super) fn read(bytes: &[u8], pace: Pace) -> Result<RawPart, MeshReadError> {
    let header = Header::of(bytes)?;
    header.check_length(bytes)?;
    let mut body = Body::new(&header, bytes);
    let mut found = Found::default();
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => found.vertices(element, &mut body)?,
            "face" => found.faces(element, &mut body)?,
            STRIPS => found.strips(element, &mut body)?,
            _ => body.skip(element)?,
        }
    }
    found.into_part(header, pace)
}

/// Checks whether all elements are there, as far as this is known without reading them.
pub(super) fn is_whole(bytes: &[u8]) -> Result<(), MeshReadError> {
    Header::of(bytes)?.check_length(bytes)
}

/// Whether its header announces no faces.
pub(super) fn is_scan(bytes: &[u8]) -> bool {
    let has_faces = |element: &Element| element.count > 0 && matches!(element.name.as_str(), "face" | STRIPS);
    Header::of(bytes).is_ok_and(|header| !header.elements.iter().any(has_faces))
}

/// How the values after the header are written.
#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

/// The type of a value.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

struct Property {
    name: String,
    kind: Kind,
    /// Type of the length, if it is a list.
    list: Option<Kind>,
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    comments: Vec<String>,
    /// Where the values begin.
    length: usize,
    lines: u64,
}

impl Kind {
    fn of(word: &[u8]) -> Option<Self> {
        Some(match word {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The value of the first bytes, as many as the type has, in little-endian order.
    fn value(self, bytes: [u8; 8]) -> f64 {
        let [a, b, c, d, ..] = bytes;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(bytes),
        }
    }
}

impl Header {
    fn of(bytes: &[u8]) -> Result<Self, MeshReadError> {
        let skipped = bytes.len() - without_mark(bytes).len();
        let not_ply = || MeshReadError::NotThisFormat { format: FORMAT, found: first_bytes(bytes) };
        let text = &bytes[skipped..bytes.len().min(skipped + LONGEST_HEADER)];
        if !(text.starts_with(b"ply\n") || text.starts_with(b"ply\r")) {
            return Err(not_ply());
        }
        let mut header = Self {
            encoding: Encoding::Text,
            elements: Vec::new(),
            comments: Vec::new(),
            length: 0,
            lines: 0,
        };
        let mut encoding = None;
        let mut rest = text;
        loop {
            let Some(end) = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r')) else {
                let problem = "it has no end_header".into();
                let line = header.lines + 1;
                return Err(if bytes.len() < LONGEST_HEADER {
                    MeshReadError::CutLine { line, text: super::text::beginning(rest) }
                } else {
                    MeshReadError::BadHeader { format: FORMAT, line, problem }
                });
            };
            let line = &rest[..end];
            let ends = if rest[end..].starts_with(b"\r\n") { 2 } else { 1 };
            rest = &rest[end + ends..];
            header.lines += 1;
            if line.trim_ascii() == b"end_header" {
                break;
            }
            header.line(line, &mut encoding)?;
        }
        header.length = skipped + text.len() - rest.len();
        header.encoding = encoding.ok_or_else(|| header.bad("it has no format line"))?;
        Ok(header)
    }

    fn bad(&self, problem: impl Into<String>) -> MeshReadError {
        MeshReadError::BadHeader { format: FORMAT, line: self.lines, problem: problem.into() }
    }

    fn line(&mut self, line: &[u8], encoding: &mut Option<Encoding>) -> Result<(), MeshReadError> {
        let text = |word: &[u8]| String::from_utf8_lossy(word).into_owned();
        let words: Vec<&[u8]> = words(line).collect();
        match words[..] {
            [b"format", name, ..] => {
                *encoding = Some(match name {
                    b"ascii" => Encoding::Text,
                    b"binary_little_endian" => Encoding::LittleEndian,
                    b"binary_big_endian" => Encoding::BigEndian,
                    _ => return Err(self.bad(format!("the format {} is unknown", text(name)))),
                });
            }
            [b"element", name, count] => {
                let count = std::str::from_utf8(count).ok().and_then(|count| count.parse().ok());
                let count = count.ok_or_else(|| self.bad("the number of elements is not a whole number"))?;
                self.elements.push(Element { name: text(name), count, properties: Vec::new() });
            }
            [b"property", b"list", count, kind, name] => {
                let list = Kind::of(count).filter(|kind| !matches!(kind, Kind::F32 | Kind::F64));
                self.property(
                    name,
                    kind,
                    Some(list.ok_or_else(|| self.bad("the length of a list does not have an integer type"))?),
                )?;
            }
            [b"property", kind, name] => self.property(name, kind, None)?,
            [b"comment" | b"obj_info", ..] => {
                let line = text(line.trim_ascii());
                let (_, comment) = line.split_once(|letter: char| letter.is_whitespace()).unwrap_or_default();
                self.comments.push(comment.trim().chars().take(120).collect());
            }
            [] | [b"ply"] => {}
            _ => return Err(self.bad("this line is unknown in a PLY header")),
        }
        Ok(())
    }

    fn property(&mut self, name: &[u8], kind: &[u8], list: Option<Kind>) -> Result<(), MeshReadError> {
        let word = String::from_utf8_lossy(kind).into_owned();
        let kind = Kind::of(kind).ok_or_else(|| self.bad(format!("the type {word} is unknown")))?;
        let outside = self.bad("there is a property before the first element");
        let element = self.elements.last_mut().ok_or(outside)?;
        element.properties.push(Property { name: String::from_utf8_lossy(name).into_owned(), kind, list });
        Ok(())
    }

    /// Refuses a file that is shorter than the smallest size of its elements; lists may be empty.
    fn check_length(&self, bytes: &[u8]) -> Result<(), MeshReadError> {
        let least = |property: &Property| match self.encoding {
            // A digit and a blank.
            Encoding::Text => 2,
            _ => property.list.unwrap_or(property.kind).bytes() as u64,
        };
        let element = |element: &Element| {
            element.properties.iter().map(least).sum::<u64>().saturating_mul(element.count)
        };
        let needed = self.elements.iter().map(element).fold(0u64, u64::saturating_add);
        let declared = needed.saturating_add(self.length as u64);
        let actual = bytes.len() as u64;
        // The blank after the last value may be missing.
        if actual.saturating_add(u64::from(self.encoding == Encoding::Text)) < declared {
            return Err(match self.encoding {
                Encoding::Text => self.cut_short(bytes),
                _ => MeshReadError::Truncated { format: FORMAT, declared, actual },
            });
        }
        Ok(())
    }

    fn cut_short(&self, bytes: &[u8]) -> MeshReadError {
        let declared = self.entries_with_values();
        let actual = self.lines_of_entries(&bytes[self.length..]).min(declared);
        MeshReadError::CutShort { format: FORMAT, what: "lines of elements".into(), declared, actual }
    }

    /// Number of entries of all elements that have properties.
    fn entries_with_values(&self) -> u64 {
        let with_values = self.elements.iter().filter(|element| !element.properties.is_empty());
        with_values.map(|element| element.count).fold(0u64, u64::saturating_add)
    }

    /// Number of lines of a text's body that are not empty.
    fn lines_of_entries(&self, body: &[u8]) -> u64 {
        super::text::lines(body).filter(|(_, line)| !line.is_empty()).count() as u64
    }
}

/// The values after the header, one after the other.
struct Body<'a> {
    encoding: Encoding,
    header: &'a Header,
    file: &'a [u8],
    rest: &'a [u8],
    line: u64,
    line_break: u8,
    rows: Rows,
}

/// How the entries of a text are divided into lines.
#[derive(Clone, Copy, PartialEq)]
enum Rows {
    /// Several entries share a line, or the file is binary.
    Shared,
    /// Every entry begins a line, and may continue in further lines.
    Begun,
    /// Every entry is one line.
    Whole,
}

impl<'a> Body<'a> {
    fn new(header: &'a Header, file: &'a [u8]) -> Self {
        let rest = &file[header.length..];
        let line_break = if rest.contains(&b'\n') { b'\n' } else { b'\r' };
        let rows = match header.encoding {
            Encoding::Text => match header.lines_of_entries(rest).cmp(&header.entries_with_values()) {
                Ordering::Less => Rows::Shared,
                Ordering::Equal => Rows::Whole,
                Ordering::Greater => Rows::Begun,
            },
            Encoding::LittleEndian | Encoding::BigEndian => Rows::Shared,
        };
        Self { encoding: header.encoding, header, file, rest, line: header.lines + 1, line_break, rows }
    }

    /// Reads one entry of an element; in a text with one entry per line, the line must contain as many values as the
    /// header declares. Otherwise its values would shift all following entries.
    fn row<T>(
        &mut self,
        read: impl FnOnce(&mut Self) -> Result<T, MeshReadError>,
    ) -> Result<T, MeshReadError> {
        if self.rows == Rows::Shared {
            return read(self);
        }
        self.skip_blanks();
        let (line, start) = (self.line, self.rest);
        let row = read(self)?;
        let end = |rest: &[u8]| rest.iter().position(|&byte| byte == self.line_break).unwrap_or(rest.len());
        let text = &start[..end(start)];
        if self.rows == Rows::Whole && self.line > line {
            return Err(bad_line(line, text, "it has fewer values than the header declares"));
        }
        let after = &self.rest[..end(self.rest)];
        if !after.trim_ascii().is_empty() {
            let text = if self.line > line { after } else { text };
            let problem = "it has more values than the header declares";
            return Err(bad_line(self.line, text.trim_ascii(), problem));
        }
        Ok(row)
    }

    fn skip_blanks(&mut self) {
        let blanks = self.rest.iter().take_while(|byte| byte.is_ascii_whitespace()).count();
        self.line += self.rest[..blanks].iter().filter(|byte| **byte == self.line_break).count() as u64;
        self.rest = &self.rest[blanks..];
    }

    fn next(&mut self, kind: Kind) -> Result<f64, MeshReadError> {
        if self.encoding == Encoding::Text {
            return self.next_word();
        }
        let Some((value, rest)) = self.rest.split_at_checked(kind.bytes()) else {
            let actual = self.file.len() as u64;
            return Err(MeshReadError::Truncated { format: FORMAT, declared: actual + 1, actual });
        };
        self.rest = rest;
        let mut bytes = [0; 8];
        bytes[..value.len()].copy_from_slice(value);
        if self.encoding == Encoding::BigEndian {
            bytes[..value.len()].reverse();
        }
        Ok(kind.value(bytes))
    }

    fn next_word(&mut self) -> Result<f64, MeshReadError> {
        self.skip_blanks();
        if self.rest.is_empty() {
            return Err(self.header.cut_short(self.file));
        }
        let end = self.rest.iter().position(u8::is_ascii_whitespace).unwrap_or(self.rest.len());
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest;
        number(word).ok_or_else(|| bad_line(self.line, word, no_number(word)))
    }

    /// The number of values of a list; the file must have enough bytes for them.
    fn list_length(&mut self, count: Kind, item: Kind) -> Result<usize, MeshReadError> {
        let length = self.next(count)?;
        if !(length >= 0.0 && length == length.trunc()) {
            return Err(self.header.bad("the length of a list is not a whole number"));
        }
        let bytes = if self.encoding == Encoding::Text { 1 } else { item.bytes() as u64 };
        let needed = (length as u64).saturating_mul(bytes);
        if needed > self.rest.len() as u64 {
            let actual = self.file.len() as u64;
            let declared = (actual - self.rest.len() as u64).saturating_add(needed);
            return Err(MeshReadError::Truncated { format: FORMAT, declared, actual });
        }
        Ok(length as usize)
    }

    /// Skips an element that is not needed.
    fn skip(&mut self, element: &Element) -> Result<(), MeshReadError> {
        if element.properties.is_empty() {
            return Ok(());
        }
        for _ in 0..element.count {
            self.row(|body| element.properties.iter().try_for_each(|property| body.skip_property(property)))?;
        }
        Ok(())
    }

    fn skip_property(&mut self, property: &Property) -> Result<(), MeshReadError> {
        let values = match property.list {
            Some(count) => self.list_length(count, property.kind)?,
            None => 1,
        };
        (0..values).try_for_each(|_| self.next(property.kind).map(|_| ()))
    }
}

/// What was read so far.
#[derive(Default)]
struct Found {
    points: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
    /// Line or number, and coordinates, of the first point that is not finite.
    broken: Option<(VertexPlace, [f64; 3])>,
    /// Place of the first point at infinity.
    infinite: Option<VertexPlace>,
    /// Corners of all faces, one after the other.
    corners: Vec<u32>,
    /// Number of corners of each face.
    arities: Vec<u32>,
}

impl Found {
    fn vertices(&mut self, element: &Element, body: &mut Body<'_>) -> Result<(), MeshReadError> {
        at_most(
            "vertices",
            usize::try_from(element.count).unwrap_or(usize::MAX),
            MAX_POINTS.max(3 * MAX_TRIANGLES),
        )?;
        // The index of each property in x, y, z, nx, ny, nz.
        let place = |property: &Property| {
            let names = ["x", "y", "z", "nx", "ny", "nz"];
            names
                .iter()
                .position(|name| property.name.eq_ignore_ascii_case(name))
                .filter(|_| property.list.is_none())
        };
        let places: Vec<Option<usize>> = element.properties.iter().map(place).collect();
        if let Some(missing) = (0..3).find(|axis| !places.contains(&Some(*axis))) {
            let name = ["x", "y", "z"][missing];
            return Err(body.header.bad(format!("its vertices have no property {name}")));
        }
        let with_normals = (3..6).all(|axis| places.contains(&Some(axis)));
        self.points.reserve_exact(element.count as usize);
        for index in 0..element.count as usize {
            let mut values = [0.0; 6];
            body.row(|body| {
                for (property, place) in element.properties.iter().zip(&places) {
                    match place {
                        Some(place) => values[*place] = body.next(property.kind)?,
                        None => body.skip_property(property)?,
                    }
                }
                Ok(())
            })?;
            let [x, y, z, ..] = values;
            if ![x, y, z].iter().all(|value| value.is_finite()) {
                let place = || match body.encoding {
                    Encoding::Text => VertexPlace::Obj { line: body.line },
                    _ => VertexPlace::Numbered { what: "vertex", number: index },
                };
                self.broken.get_or_insert_with(|| (place(), [x, y, z]));
                if is_infinite(&Point3::new(x, y, z)) {
                    self.infinite.get_or_insert_with(place);
                }
            }
            self.points.push(Point3::new(x, y, z));
            if with_normals {
                self.normals.push(Vector3::new(values[3], values[4], values[5]));
            }
        }
        Ok(())
    }

    fn faces(&mut self, element: &Element, body: &mut Body<'_>) -> Result<(), MeshReadError> {
        at_most("faces", usize::try_from(element.count).unwrap_or(usize::MAX), MAX_TRIANGLES)?;
        self.rows_of(element, body, "its faces have no list property vertex_indices", Self::face)
    }

    /// Strips of triangles: every corner after the second makes a triangle with the two before it, and -1 begins a new
    /// strip.
    fn strips(&mut self, element: &Element, body: &mut Body<'_>) -> Result<(), MeshReadError> {
        self.rows_of(element, body, "its strips have no list property vertex_indices", Self::strip)
    }

    /// Reads each row of an element with `read`, which reads the list of its corners; the types are those of the list's
    /// length and of its items.
    fn rows_of(
        &mut self,
        element: &Element,
        body: &mut Body<'_>,
        missing: &str,
        read: impl Fn(&mut Self, Kind, Kind, &mut Body<'_>) -> Result<(), MeshReadError>,
    ) -> Result<(), MeshReadError> {
        let is_corners = |property: &Property| {
            property.list.is_some() && matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
        };
        if element.count > 0 && !element.properties.iter().any(is_corners) {
            return Err(body.header.bad(missing));
        }
        if element.properties.is_empty() {
            return Ok(());
        }
        for _ in 0..element.count {
            body.row(|body| {
                element.properties.iter().try_for_each(|property| {
                    match property.list.filter(|_| is_corners(property)) {
                        Some(count) => read(self, count, property.kind, body),
                        None => body.skip_property(property),
                    }
                })
            })?;
        }
        Ok(())
    }

    fn face(&mut self, count: Kind, kind: Kind, body: &mut Body<'_>) -> Result<(), MeshReadError> {
        let arity = body.list_length(count, kind)?;
        at_most("corners in one face", arity, MAX_CORNERS)?;
        at_most("face corners", self.corners.len() + arity, 3 * MAX_TRIANGLES)?;
        for _ in 0..arity {
            let index = self.corner(body.next(kind)?)?;
            self.corners.push(index);
        }
        self.arities.push(arity as u32);
        Ok(())
    }

    fn strip(&mut self, count: Kind, kind: Kind, body: &mut Body<'_>) -> Result<(), MeshReadError> {
        let length = body.list_length(count, kind)?;
        at_most("corners in one strip", length, 3 * MAX_TRIANGLES)?;
        let (mut before, mut is_turned): ([Option<u32>; 2], bool) = ([None; 2], false);
        for _ in 0..length {
            let index = body.next(kind)?;
            if index == -1.0 || index == f64::from(u32::MAX) {
                (before, is_turned) = ([None; 2], false);
                continue;
            }
            let third = self.corner(index)?;
            if let [Some(first), Some(second)] = before {
                // A corner that is repeated joins two strips by triangles without an area.
                if first != second && second != third && third != first {
                    at_most("face corners", self.corners.len() + 3, 3 * MAX_TRIANGLES)?;
                    let [first, second] = if is_turned { [second, first] } else { [first, second] };
                    self.corners.extend([first, second, third]);
                    self.arities.push(3);
                }
                is_turned = !is_turned;
            }
            before = [before[1], Some(third)];
        }
        Ok(())
    }

    /// The index of a vertex. Vertices may follow the faces, so whether it exists is checked at the end.
    fn corner(&self, index: f64) -> Result<u32, MeshReadError> {
        if index >= 0.0 && index < f64::from(u32::MAX) && index == index.trunc() {
            return Ok(index as u32);
        }
        let face = VertexPlace::Numbered { what: "face", number: self.arities.len() };
        let count = self.points.len();
        Err(MeshReadError::IndexOutOfRange { face, kind: "vertex", index: index as i64, count })
    }

    fn into_part(self, header: Header, pace: Pace) -> Result<RawPart, MeshReadError> {
        let mut clues = Clues::new(FORMAT, header.comments.first().cloned());
        clues.stated_unit = header.comments.iter().find_map(|comment| stated_unit(comment));
        let mut part = RawPart::new(clues);
        let others = header
            .elements
            .iter()
            .filter(|element| !matches!(element.name.as_str(), "vertex" | "face" | STRIPS));
        part.skipped = others.map(|element| format!("{} x {}", element.count, element.name)).collect();
        if self.arities.is_empty() {
            if self.points.is_empty() && !part.skipped.is_empty() {
                return Err(MeshReadError::NoTriangles { cause: EmptyCause::OnlyOthers(part.skipped) });
            }
            at_most("points", self.points.len(), MAX_POINTS)?;
            self.into_scan(&mut part);
            return Ok(part);
        }
        if let Some((vertex, coordinate)) = self.broken {
            return Err(MeshReadError::NotFinite { vertex, coordinate });
        }
        self.into_mesh(&mut part, pace)?;
        Ok(part)
    }

    /// The points that were measured, with their normals.
    fn into_scan(mut self, part: &mut RawPart) {
        if self.broken.is_some() {
            let is_point = |point: &Point3<f64>| point.iter().all(|value| value.is_finite());
            part.infinite = self
                .infinite
                .map(|first| (self.points.iter().filter(|point| is_infinite(point)).count(), first));
            let all = self.points.len();
            let mut kept = self.points.iter().map(is_point);
            self.normals.retain(|_| kept.next().unwrap_or(true));
            self.points.retain(is_point);
            let infinite = part.infinite.as_ref().map_or(0, |(count, _)| *count);
            part.missing = all - self.points.len() - infinite;
        }
        part.set_scan(self.points, self.normals);
    }

    fn into_mesh(self, part: &mut RawPart, pace: Pace) -> Result<(), MeshReadError> {
        let (mut triangles, mut outline, mut rest) = (Vec::new(), Vec::new(), &self.corners[..]);
        let mut cutter = polygon::Cutter::new(pace);
        for (number, &arity) in self.arities.iter().enumerate() {
            let (face, others) = rest.split_at(arity as usize);
            rest = others;
            if let Some(&index) = face.iter().find(|&&index| index as usize >= self.points.len()) {
                let face = VertexPlace::Numbered { what: "face", number };
                let (index, count) = (i64::from(index), self.points.len());
                return Err(MeshReadError::IndexOutOfRange { face, kind: "vertex", index, count });
            }
            match *face {
                [a, b, c] => triangles.push([a, b, c]),
                [] | [_] | [_, _] => {}
                _ => {
                    outline.clear();
                    outline.extend(face.iter().map(|&vertex| self.points[vertex as usize]));
                    cutter.cut(&outline, |corners| triangles.push(corners.map(|corner| face[corner])))?;
                }
            }
        }
        let normal = |triangle: usize, corner: usize| {
            let index: u32 = triangles[triangle][corner];
            self.normals[index as usize]
        };
        if self.normals.is_empty() {
            part.normals_found = NormalsFound::None;
            // Without normals, vertices repeated at the border of a face are merged.
            (part.positions, part.triangles) = normals::weld(&self.points, &triangles);
        } else if let Some(welded) = normals::weld_facets(&self.points, &triangles, normal) {
            part.normals_found = NormalsFound::FacetsOnly;
            (part.positions, part.triangles) = welded;
        } else {
            part.normals_found = NormalsFound::Smooth;
            (part.positions, part.normals, part.triangles) = (self.points, self.normals, triangles);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
