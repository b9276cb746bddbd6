//! Wavefront OBJ, polygons only (Alias|Wavefront, Advanced Visualizer manual, appendix B1).
//!
//! Read line by line, so that every complaint has its line. Material files are never opened.

use std::borrow::Cow;

use nalgebra::{Point3, Vector3};

use super::clues::Clues;
use super::error::{EmptyCause, VertexPlace};
use super::polygon;
use super::{LengthUnit, MOST_TRIANGLES, MeshFormat, MeshReadError, NormalsFound, RawPart, normals};
use super::{at_most, gltf};
use crate::reason::Notice;

/// No face of a product has more corners than this; cutting one into triangles takes up to the square of it.
const MOST_CORNERS: usize = 10_000;
/// Stands for the normal of a corner that has none.
const NO_NORMAL: u32 = u32::MAX;

/// Reads a part from an OBJ file.
pub(super) fn read(bytes: &[u8]) -> Result<RawPart, MeshReadError> {
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    // Only text is OBJ; a zero byte never is.
    if bytes.is_empty() || bytes[..bytes.len().min(4096)].contains(&0) {
        return Err(not_obj(bytes));
    }
    let mut content = Content::default();
    let mut lines = Lines::of(bytes);
    while let Some((line, text)) = lines.next_statement() {
        content.statement(line, &text).map_err(|error| match error {
            MeshReadError::BadLine { line, text, .. } if lines.is_cut() => {
                MeshReadError::CutLine { line, text }
            }
            other => other,
        })?;
    }
    if content.positions.is_empty() && content.unknown.is_some() {
        return Err(not_obj(bytes));
    }
    let ends_open = lines.is_cut();
    let mut part = content.into_part()?;
    if ends_open {
        let message =
            "the last line does not end with a line break; if the file was cut there, the last face is wrong";
        part.notices.push(Notice::warning("last-line-open", message));
    }
    Ok(part)
}

fn not_obj(bytes: &[u8]) -> MeshReadError {
    MeshReadError::NotThisFormat { format: MeshFormat::Obj, found: gltf::beginning(bytes) }
}

/// Statements with the number of their first line; a backslash at a line's end joins the next one.
struct Lines<'a> {
    rest: &'a [u8],
    line_break: u8,
    line: u64,
    ends_open: bool,
}

impl<'a> Lines<'a> {
    fn of(bytes: &'a [u8]) -> Self {
        let line_break = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
        Self { rest: bytes, line_break, line: 0, ends_open: false }
    }

    /// Whether the statement given last was the end of the file, without a line break.
    fn is_cut(&self) -> bool {
        self.ends_open
    }

    fn next_statement(&mut self) -> Option<(u64, Cow<'a, [u8]>)> {
        let mut statement = Cow::Borrowed(self.next_line()?);
        let first_line = self.line;
        while let Some(shorter) = statement.strip_suffix(b"\\") {
            let mut joined = shorter.to_vec();
            joined.push(b' ');
            let next = self.next_line().unwrap_or_default();
            joined.extend_from_slice(next);
            statement = Cow::Owned(joined);
        }
        Some((first_line, statement))
    }

    fn next_line(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        self.line += 1;
        let end = self.rest.iter().position(|&byte| byte == self.line_break);
        let (line, rest) = match end {
            Some(end) => (&self.rest[..end], &self.rest[end + 1..]),
            None => (self.rest, &[][..]),
        };
        self.rest = rest;
        let text = line.trim_ascii();
        self.ends_open = end.is_none() && !text.is_empty();
        Some(text)
    }
}

/// What was read so far.
#[derive(Default)]
struct Content {
    positions: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
    /// Vertex and normal of each face's corners, face after face.
    corners: Vec<[u32; 2]>,
    /// Number of corners of each face.
    arities: Vec<u32>,
    /// The highest vertex and normal that faces name, from 1, with the line.
    highest: [(i64, u64); 2],
    producer: Option<String>,
    stated_unit: Option<LengthUnit>,
    objects: Names,
    groups: Names,
    materials: Names,
    lines: usize,
    points: usize,
    free_forms: usize,
    /// The first statement that is no OBJ.
    unknown: Option<String>,
}

/// Names in the order in which faces first use them.
#[derive(Default)]
struct Names {
    used: Vec<String>,
    seen: std::collections::BTreeSet<String>,
    waiting: Option<String>,
}

impl Names {
    fn begin(&mut self, name: &[u8]) {
        let name = String::from_utf8_lossy(name).trim().to_owned();
        self.waiting = (!name.is_empty()).then_some(name);
    }

    fn use_now(&mut self) {
        if let Some(name) = self.waiting.take().filter(|name| self.seen.insert(name.clone())) {
            self.used.push(name);
        }
    }
}

impl Content {
    fn statement(&mut self, line: u64, text: &[u8]) -> Result<(), MeshReadError> {
        let keyword_end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        let (keyword, values) = text.split_at(keyword_end);
        let bad = |problem| MeshReadError::BadLine { line, text: beginning(text), problem };
        match keyword {
            b"v" => {
                let position = triple(values).map_err(bad)?;
                if !position.iter().all(|coordinate| coordinate.is_finite()) {
                    let vertex = VertexPlace::Obj { line };
                    return Err(MeshReadError::NotFinite { vertex, coordinate: position });
                }
                self.positions.push(Point3::from(position));
            }
            b"vn" => self.normals.push(Vector3::from(triple(values).map_err(bad)?)),
            b"f" | b"fo" => self.face(line, values, &bad)?,
            b"o" => self.objects.begin(values),
            b"g" => self.groups.begin(values),
            b"usemtl" => self.materials.begin(values),
            b"l" => self.lines += 1,
            b"p" => self.points += 1,
            b"curv" | b"curv2" | b"surf" => self.free_forms += 1,
            b"" | b"vt" | b"vp" | b"s" | b"mtllib" | b"usemap" | b"maplib" | b"mg" | b"lod" | b"bevel"
            | b"c_interp" | b"d_interp" | b"shadow_obj" | b"trace_obj" | b"cstype" | b"deg" | b"bmat"
            | b"step" | b"parm" | b"trim" | b"hole" | b"scrv" | b"sp" | b"con" | b"end" | b"ctech"
            | b"stech" => {}
            _ if keyword.starts_with(b"#") => self.comment(text),
            _ => {
                self.unknown.get_or_insert_with(|| beginning(text));
            }
        }
        Ok(())
    }

    /// The first comment names the producer; any comment before the first vertex may name the unit.
    fn comment(&mut self, text: &[u8]) {
        if !self.positions.is_empty() {
            return;
        }
        let text = String::from_utf8_lossy(text);
        let text = text.trim_start_matches('#').trim();
        if self.producer.is_none() && !text.is_empty() {
            self.producer = Some(text.chars().take(120).collect());
        }
        let mut words = text.split(|letter: char| !letter.is_ascii_alphabetic()).map(str::to_ascii_lowercase);
        if words.any(|word| word == "unit" || word == "units") {
            self.stated_unit = self.stated_unit.or(words.find_map(|word| unit_word(&word)));
        }
    }

    fn face(
        &mut self,
        line: u64,
        values: &[u8],
        bad: &dyn Fn(&'static str) -> MeshReadError,
    ) -> Result<(), MeshReadError> {
        let before = self.corners.len();
        for corner in words(values) {
            let mut numbers = corner.split(|&byte| byte == b'/');
            let vertex = numbers.next().and_then(whole_number).ok_or_else(|| bad("a corner is no number"))?;
            let normal = match numbers.nth(1) {
                Some(normal) if !normal.is_empty() => {
                    Some(whole_number(normal).ok_or_else(|| bad("a normal is no number"))?)
                }
                _ => None,
            };
            let vertex = self.resolve(0, vertex, line)?;
            let normal = normal.map_or(Ok(NO_NORMAL), |normal| self.resolve(1, normal, line))?;
            self.corners.push([vertex, normal]);
        }
        let arity = self.corners.len() - before;
        if arity < 3 {
            return Err(bad("a face needs three corners"));
        }
        at_most("corners in one face", arity, MOST_CORNERS)?;
        at_most("corners of faces", self.corners.len(), 3 * MOST_TRIANGLES)?;
        self.arities.push(arity as u32);
        self.objects.use_now();
        self.groups.use_now();
        self.materials.use_now();
        Ok(())
    }

    /// An index from 0 for a vertex (`kind` 0) or normal (`kind` 1) named from 1, or from the end with a minus.
    fn resolve(&mut self, kind: usize, named: i64, line: u64) -> Result<u32, MeshReadError> {
        let count = [self.positions.len(), self.normals.len()][kind];
        let absolute = if named < 0 { count as i64 + 1 + named } else { named };
        if absolute < 1 || absolute >= i64::from(NO_NORMAL) {
            return Err(out_of_range(kind, named, line, count));
        }
        // A face may stand before its vertices; whether they came is seen at the end.
        if absolute > self.highest[kind].0 {
            self.highest[kind] = (absolute, line);
        }
        Ok((absolute - 1) as u32)
    }

    fn into_part(mut self) -> Result<RawPart, MeshReadError> {
        for (kind, count) in [self.positions.len(), self.normals.len()].into_iter().enumerate() {
            let (named, line) = self.highest[kind];
            if named > count as i64 {
                return Err(out_of_range(kind, named, line, count));
            }
        }
        let mut clues = Clues::new(MeshFormat::Obj, self.producer.take());
        clues.stated_unit = self.stated_unit;
        let mut part = RawPart::new(clues);
        part.not_taken = self.not_taken();
        let (triangles, corner_normals) = self.triangles();
        if triangles.is_empty() {
            let cause = if !part.not_taken.is_empty() {
                EmptyCause::OnlyOthers(part.not_taken)
            } else if part.clues.is_arch_export() {
                EmptyCause::ArchContainer
            } else {
                EmptyCause::Nothing
            };
            return Err(MeshReadError::NoTriangles { cause });
        }
        let normal_at = |triangle: usize, corner: usize| {
            let index: u32 = corner_normals[triangle][corner];
            self.normals.get(index as usize).copied().unwrap_or_else(Vector3::zeros)
        };
        if corner_normals.iter().flatten().all(|&normal| normal == NO_NORMAL) {
            part.normals_found = NormalsFound::None;
            (part.positions, part.triangles) = (self.positions, triangles);
        } else if let Some(welded) = normals::weld_facets(&self.positions, &triangles, normal_at) {
            part.normals_found = NormalsFound::FacetsOnly;
            (part.positions, part.triangles) = welded;
        } else {
            part.normals_found = NormalsFound::Smooth;
            split_by_normal(&mut part, &self.positions, &self.normals, &triangles, &corner_normals);
        }
        part.bodies = if self.objects.used.is_empty() { self.groups.used } else { self.objects.used };
        part.materials = self.materials.used;
        Ok(part)
    }

    fn not_taken(&self) -> Vec<String> {
        let counted = [
            (self.lines, "line (l)"),
            (self.points, "set of points (p)"),
            (self.free_forms, "free-form curve or surface"),
        ];
        let counted = counted.iter().filter(|(count, _)| *count > 0);
        let mut names: Vec<String> = counted.map(|(count, what)| format!("{count} x {what}")).collect();
        names.extend(self.unknown.as_ref().map(|text| format!("unknown statements such as \"{text}\"")));
        names
    }

    /// Vertices and normals of all triangles.
    fn triangles(&self) -> (Vec<[u32; 3]>, Vec<[u32; 3]>) {
        let count = self.corners.len() - 2 * self.arities.len();
        let (mut vertices, mut corner_normals) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let mut outline = Vec::new();
        let mut rest = &self.corners[..];
        for &arity in &self.arities {
            let (face, others) = rest.split_at(arity as usize);
            rest = others;
            let mut push = |corners: [usize; 3]| {
                vertices.push(corners.map(|corner| face[corner][0]));
                corner_normals.push(corners.map(|corner| face[corner][1]));
            };
            if arity == 3 {
                push([0, 1, 2]);
                continue;
            }
            outline.clear();
            outline.extend(face.iter().map(|&[vertex, _]| self.positions[vertex as usize]));
            polygon::triangulate(&outline, push);
        }
        (vertices, corner_normals)
    }
}

/// Makes one vertex of every pair of position and normal that a corner names.
fn split_by_normal(
    part: &mut RawPart,
    positions: &[Point3<f64>],
    normals: &[Vector3<f64>],
    triangles: &[[u32; 3]],
    corner_normals: &[[u32; 3]],
) {
    const END: u32 = u32::MAX;
    // For each position a chain of the vertices made of it: (normal, next vertex of the chain).
    let mut first = vec![END; positions.len()];
    let mut chain: Vec<(u32, u32)> = Vec::with_capacity(positions.len());
    part.triangles = triangles
        .iter()
        .zip(corner_normals)
        .map(|(corners, normals_of)| {
            [0, 1, 2].map(|corner| {
                let (position, normal) = (corners[corner] as usize, normals_of[corner]);
                let mut vertex = first[position];
                while vertex != END && chain[vertex as usize].0 != normal {
                    vertex = chain[vertex as usize].1;
                }
                if vertex == END {
                    vertex = chain.len() as u32;
                    chain.push((normal, std::mem::replace(&mut first[position], vertex)));
                    part.positions.push(positions[position]);
                    let normal = normals.get(normal as usize).copied();
                    part.normals.push(normal.unwrap_or_else(Vector3::zeros));
                }
                vertex
            })
        })
        .collect();
}

fn out_of_range(kind: usize, index: i64, line: u64, count: usize) -> MeshReadError {
    let kind = ["vertex", "normal"][kind];
    MeshReadError::IndexOutOfRange { face: VertexPlace::Obj { line }, kind, index, count }
}

fn words(values: &[u8]) -> impl Iterator<Item = &[u8]> {
    values.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

fn triple(values: &[u8]) -> Result<[f64; 3], &'static str> {
    let mut numbers = words(values).map(|word| std::str::from_utf8(word).ok()?.parse::<f64>().ok());
    let mut next = || numbers.next().ok_or("three numbers are needed")?.ok_or("a number cannot be read");
    Ok([next()?, next()?, next()?])
}

fn whole_number(word: &[u8]) -> Option<i64> {
    let (sign, digits) = match word.strip_prefix(b"-") {
        Some(digits) => (-1, digits),
        None => (1, word),
    };
    // 18 digits fit without overflow; no index needs more.
    let fits = (1..=18).contains(&digits.len()) && digits.iter().all(u8::is_ascii_digit);
    fits.then(|| sign * digits.iter().fold(0, |value, digit| value * 10 + i64::from(digit - b'0')))
}

fn unit_word(word: &str) -> Option<LengthUnit> {
    match word {
        "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => Some(LengthUnit::Millimetre),
        "cm" | "centimeter" | "centimeters" | "centimetre" | "centimetres" => Some(LengthUnit::Centimetre),
        "m" | "meter" | "meters" | "metre" | "metres" => Some(LengthUnit::Metre),
        // Not "in", which stands before the unit in most sentences.
        "inch" | "inches" => Some(LengthUnit::Inch),
        _ => None,
    }
}

fn beginning(text: &[u8]) -> String {
    String::from_utf8_lossy(&text[..text.len().min(60)]).into_owned()
}

#[cfg(test)]
mod tests;
