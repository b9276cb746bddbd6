//! The pass before the parser: every line is checked, so that errors have a line number, and written again in the
//! simplest form. Names, comments and skipped statements are collected on the way.

use std::borrow::Cow;
use std::collections::BTreeSet;

use crate::formats::mesh::clues::stated_unit;
use crate::formats::mesh::error::VertexPlace;
use crate::formats::mesh::raw::bounds_ink;
use crate::formats::mesh::text::{bad_line, beginning, no_number};
use crate::formats::mesh::{LengthUnit, MAX_TRIANGLES, MeshReadError, at_most};

use super::lines::Lines;

/// Largest number of corners of a face, more than any product has; triangulation takes up to the square of it.
pub(super) const MAX_CORNERS: usize = 10_000;

/// A checked file: its geometry as plain text, and its other content.
#[derive(Default)]
pub(super) struct Checked {
    /// Only lines `v x y z`, `vn x y z` and `f v v v` or `f v//vn v//vn v//vn`, with absolute indices. There are no
    /// names, so the parser makes one model of it.
    pub(super) text: Vec<u8>,
    pub(super) vertices: usize,
    pub(super) normals: usize,
    /// Number of corners of all faces.
    pub(super) corners: usize,
    /// Number of corners without a normal.
    pub(super) bare_corners: usize,
    /// Whether the last line has no line break.
    pub(super) ends_open: bool,
    pub(super) producer: Option<String>,
    pub(super) stated_unit: Option<LengthUnit>,
    pub(super) objects: Names,
    pub(super) groups: Names,
    pub(super) materials: Names,
    /// For each face, whether it is named `mark`; empty without such faces.
    pub(super) is_mark: Vec<bool>,
    /// Number of faces.
    pub(super) faces: usize,
    /// The first statement that is not known in OBJ.
    pub(super) unknown: Option<String>,
    /// Number of corners that name a normal which the file does not contain.
    pub(super) absent_normals: usize,
    /// The line of the first of them.
    pub(super) first_absent: u64,
    /// Index of the normal that bare corners are given, from 1.
    stand_in: Option<usize>,
    /// Number of normals in the file, once it is known.
    known_normals: Option<usize>,
    /// The highest vertex and normal index in faces, from 1, with the line.
    highest: [(i64, u64); 2],
    lines: usize,
    points: usize,
    free_forms: usize,
}

/// Names in the order in which faces first use them.
#[derive(Default)]
pub(super) struct Names {
    pub(super) used: Vec<String>,
    seen: BTreeSet<String>,
    /// Whether the current name bounds where ink may be.
    bounds_ink: bool,
    waiting: Option<String>,
}

impl Names {
    fn begin(&mut self, name: &[u8]) {
        let name = String::from_utf8_lossy(name).trim().to_owned();
        // A face may be in several groups.
        self.bounds_ink = bounds_ink(&name) || name.split_whitespace().any(bounds_ink);
        self.waiting = (!name.is_empty()).then_some(name);
    }

    fn use_now(&mut self) {
        if let Some(name) = self.waiting.take().filter(|name| self.seen.insert(name.clone())) {
            self.used.push(name);
        }
    }
}

/// The values of a statement without a comment after them.
fn without_comment(values: &[u8]) -> &[u8] {
    let comment = values.windows(2).position(|pair| pair[0].is_ascii_whitespace() && pair[1] == b'#');
    comment.map_or(values, |at| &values[..at])
}

impl Checked {
    /// Checks a file's lines.
    ///
    /// If only some corners have a normal, the others are given one of length zero, which is treated as none. Otherwise
    /// the parser would skip the missing normals, and its lists of normals and positions would no longer correspond. A
    /// corner that names a normal which does not exist is treated as one without a normal.
    ///
    /// # Errors
    /// The first line that is not valid, or that refers to a vertex that does not exist.
    pub(super) fn of(bytes: &[u8]) -> Result<Self, MeshReadError> {
        let mut found = Self::with_stand_in(bytes, None, None)?;
        // A face may precede its normals, so which of them exist is known only now.
        if found.highest[1].0 > found.normals as i64 {
            found = Self::with_stand_in(bytes, None, Some(found.normals))?;
        }
        if found.bare_corners == 0 || found.bare_corners == found.corners {
            return Ok(found);
        }
        let mut filled = Self::with_stand_in(bytes, Some(found.normals + 1), Some(found.normals))?;
        filled.text.extend_from_slice(b"vn 0 0 0\n");
        Ok(filled)
    }

    fn with_stand_in(
        bytes: &[u8],
        stand_in: Option<usize>,
        known_normals: Option<usize>,
    ) -> Result<Self, MeshReadError> {
        let text = Vec::with_capacity(bytes.len());
        let mut found = Self { text, stand_in, known_normals, ..Self::default() };
        let mut lines = Lines::of(bytes);
        while let Some((line, text)) = lines.next_statement() {
            found.statement(line, &text).map_err(|error| match error {
                MeshReadError::BadLine { line, text, .. } if lines.is_cut() => {
                    MeshReadError::CutLine { line, text }
                }
                other => other,
            })?;
        }
        found.ends_open = lines.is_cut();
        let (named, line) = found.highest[0];
        if named > found.vertices as i64 {
            return Err(out_of_range(named, line, found.vertices));
        }
        Ok(found)
    }

    fn statement(&mut self, line: u64, text: &[u8]) -> Result<(), MeshReadError> {
        let keyword_end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        let (keyword, values) = text.split_at(keyword_end);
        // Names may contain the sign, numbers do not.
        let numbers = without_comment(values);
        let bad = |problem| bad_line(line, text, problem);
        match keyword {
            b"v" => {
                let coordinate = self.triple(keyword, numbers).map_err(bad)?;
                if !coordinate.iter().all(|value| value.is_finite()) {
                    return Err(MeshReadError::NotFinite { vertex: VertexPlace::Obj { line }, coordinate });
                }
                self.vertices += 1;
            }
            b"vn" => {
                self.triple(keyword, numbers).map_err(bad)?;
                self.normals += 1;
            }
            b"f" | b"fo" => self.face(line, numbers, &bad)?,
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

    /// The first comment names the producer; any comment before the first vertex may state the unit.
    fn comment(&mut self, text: &[u8]) {
        if self.vertices > 0 {
            return;
        }
        let text = String::from_utf8_lossy(text);
        let text = text.trim_start_matches('#').trim();
        if self.producer.is_none() && !text.is_empty() {
            self.producer = Some(text.chars().take(120).collect());
        }
        self.stated_unit = self.stated_unit.or_else(|| stated_unit(text));
    }

    /// Reads three numbers; a fourth is a weight and the fourth to sixth are a colour, which do not move a corner.
    fn triple(&mut self, keyword: &[u8], values: &[u8]) -> Result<[f64; 3], Cow<'static, str>> {
        let mut numbers = words(values);
        let mut triple = [0.0; 3];
        self.text.extend_from_slice(keyword);
        for number in &mut triple {
            let word = numbers.next().ok_or(Cow::from("three numbers are needed"))?;
            let parsed = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
            *number = parsed.ok_or_else(|| no_number(word))?;
            self.text.push(b' ');
            self.text.extend_from_slice(word);
        }
        self.text.push(b'\n');
        Ok(triple)
    }

    fn face(
        &mut self,
        line: u64,
        values: &[u8],
        bad: &dyn Fn(Cow<'static, str>) -> MeshReadError,
    ) -> Result<(), MeshReadError> {
        let mut arity = 0;
        self.text.push(b'f');
        for corner in words(values) {
            let mut numbers = corner.split(|&byte| byte == b'/');
            self.text.push(b' ');
            let vertex = numbers.next().unwrap_or_default();
            let vertex = whole_number(vertex).ok_or_else(|| bad("a vertex index is not a number".into()))?;
            let vertex = self.vertex(vertex, line)?;
            self.text.extend_from_slice(vertex.to_string().as_bytes());
            let normal = match numbers.nth(1).filter(|normal| !normal.is_empty()) {
                Some(normal) => {
                    let normal =
                        whole_number(normal).ok_or_else(|| bad("a normal index is not a number".into()))?;
                    self.normal(normal, line)
                }
                None => None,
            };
            if normal.is_none() {
                self.bare_corners += 1;
            }
            if let Some(normal) = normal.or(self.stand_in.map(|normal| normal as i64)) {
                self.text.extend_from_slice(format!("//{normal}").as_bytes());
            }
            arity += 1;
        }
        self.text.push(b'\n');
        if arity < 3 {
            return Err(bad("a face needs at least three corners".into()));
        }
        at_most("corners in one face", arity, MAX_CORNERS)?;
        self.corners += arity;
        at_most("face corners", self.corners, 3 * MAX_TRIANGLES)?;
        self.objects.use_now();
        self.groups.use_now();
        self.materials.use_now();
        let is_mark = [&self.objects, &self.groups, &self.materials].iter().any(|names| names.bounds_ink);
        if is_mark || !self.is_mark.is_empty() {
            self.is_mark.resize(self.faces, false);
            self.is_mark.push(is_mark);
        }
        self.faces += 1;
        Ok(())
    }

    /// The index of a vertex from 1; `named` counts backwards if it is negative.
    fn vertex(&mut self, named: i64, line: u64) -> Result<i64, MeshReadError> {
        let absolute = absolute(named, self.vertices);
        if absolute < 1 || absolute >= i64::from(u32::MAX) {
            return Err(out_of_range(named, line, self.vertices));
        }
        // A face may precede its vertices, so whether they exist is checked at the end.
        if absolute > self.highest[0].0 {
            self.highest[0] = (absolute, line);
        }
        Ok(absolute)
    }

    /// The index of a normal from 1, unless the file does not contain it; `named` counts backwards if it is negative.
    fn normal(&mut self, named: i64, line: u64) -> Option<i64> {
        let absolute = absolute(named, self.normals);
        let limit = self.known_normals.map_or(i64::from(u32::MAX) - 1, |count| count as i64);
        if !(1..=limit).contains(&absolute) {
            if self.absent_normals == 0 {
                self.first_absent = line;
            }
            self.absent_normals += 1;
            return None;
        }
        if absolute > self.highest[1].0 {
            self.highest[1] = (absolute, line);
        }
        Some(absolute)
    }

    /// What the file contains besides faces, with counts.
    pub(super) fn skipped(&self) -> Vec<String> {
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
}

/// An index that counts from 1, or backwards from the last of `count` if it is negative.
fn absolute(named: i64, count: usize) -> i64 {
    if named < 0 { count as i64 + 1 + named } else { named }
}

fn out_of_range(index: i64, line: u64, count: usize) -> MeshReadError {
    MeshReadError::IndexOutOfRange { face: VertexPlace::Obj { line }, kind: "vertex", index, count }
}

fn words(values: &[u8]) -> impl Iterator<Item = &[u8]> {
    values.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
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
