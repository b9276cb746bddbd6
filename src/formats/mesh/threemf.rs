//! 3MF (3MF Consortium, Core Specification 1.3 and Production Extension 1.1): a ZIP package of models in XML.
//!
//! The objects of the build are read with their components and transforms, in the unit that the file states and with +Z up,
//! as the format requires. XML is read as a stream: document types, and with them entities, are refused, and no other file
//! is opened.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::io::{self, BufReader, Read};
use std::str::FromStr;

use nalgebra::{Matrix4, Point3};
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use super::clues::Clues;
use super::error::{EmptyCause, VertexPlace};
use super::package::{Package, damaged, entry_name};
use super::raw::{MAX_TRIANGLES, QUICK_TRIANGLES, RawPart, at_most, bounds_ink, check_pace, hidden_notice};
use super::{LengthUnit, MeshFormat, MeshReadError, normals};
use crate::formats::Pace;
use crate::reason::Notice;

/// Largest number of models in a package.
const MAX_MODELS: usize = 1_000;
/// Largest number of objects and components that are placed.
const MAX_PLACED: usize = 100_000;
/// Largest number of components inside each other.
const MAX_DEPTH: usize = 64;
/// Largest number of triangles of a small file: any number of components can share an object.
const MAX_COPIES: usize = 2_000_000;
/// Bytes of text that a triangle takes at least, compressed.
const BYTES_OF_TRIANGLE: usize = 2;
/// Longest text between two tags, bytes.
const LONGEST_TEXT: usize = 16 << 20;
/// The model that a package without relations contains.
const USUAL_MODEL: &str = "3d/3dmodel.model";
/// Namespaces of extensions that change only the look, the division into files or the use of an object.
const HARMLESS: [&str; 5] = [
    "http://schemas.microsoft.com/3dmanufacturing/production/",
    "http://schemas.microsoft.com/3dmanufacturing/material/",
    "http://schemas.microsoft.com/3dmanufacturing/core/",
    "http://schemas.3mf.io/3dmanufacturing/trianglesets/",
    "http://schemas.slic3r.org/",
];

/// Reads a part from a 3MF package.
pub(super) fn read(bytes: &[u8], pace: Pace) -> Result<RawPart, MeshReadError> {
    let package = Package::open(bytes)?;
    let root = root_model(&package)?;
    let mut models = Models { pace, ..Models::default() };
    let mut waiting = VecDeque::from([root.clone()]);
    let mut seen = BTreeSet::from([root.clone()]);
    while let Some(path) = waiting.pop_front() {
        for other in models.read(&package, &path, path == root)? {
            if seen.insert(other.clone()) {
                at_most("models", seen.len(), MAX_MODELS)?;
                waiting.push_back(other);
            }
        }
    }
    models.into_part(bytes.len(), &root)
}

/// Checks whether the directory at the end of the package is there.
pub(super) fn is_whole(bytes: &[u8]) -> Result<(), MeshReadError> {
    Package::open(bytes).map(|_| ())
}

/// The name of the model that the package's relations name.
fn root_model(package: &Package<'_>) -> Result<String, MeshReadError> {
    let mut found = None;
    if package.names().any(|name| name == "_rels/.rels") {
        elements(package, "_rels/.rels", |tag| {
            if let Tag::Start("Relationship", element) = tag {
                let target = attribute(element, "Target")?;
                let is_model = attribute(element, "Type")?.is_some_and(|kind| kind.ends_with("/3dmodel"));
                found = found.take().or(target.filter(|_| is_model));
            }
            Ok(())
        })?;
    }
    let named = found.map(|target| entry_name(&target));
    let usual = || package.names().find(|name| *name == USUAL_MODEL).map(str::to_owned);
    let any = || package.names().find(|name| name.ends_with(".model")).map(str::to_owned);
    named.or_else(usual).or_else(any).ok_or_else(|| damaged("the package", "it contains no 3D model".into()))
}

/// What a model's stream consists of, with local names.
enum Tag<'t> {
    Start(&'t str, &'t BytesStart<'t>),
    Text(&'t str),
    End(&'t str),
}

/// Why an element cannot be used, as a clause about it.
type Problem = String;

/// Calls `each` for the elements of an entry, in their order.
fn elements(
    package: &Package<'_>,
    name: &str,
    mut each: impl FnMut(Tag<'_>) -> Result<(), Stop>,
) -> Result<(), MeshReadError> {
    let content = Guarded { content: package.entry(name)?, since_tag: 0 };
    let mut reader = Reader::from_reader(BufReader::with_capacity(1 << 16, content));
    let mut buffer = Vec::new();
    loop {
        buffer.clear();
        let at = reader.buffer_position();
        let bad = |problem: String| MeshReadError::Package { item: name.into(), byte: Some(at), problem };
        let event = reader.read_event_into(&mut buffer).map_err(|error| bad(error.to_string()))?;
        let result = match &event {
            Event::Start(element) => each(Tag::Start(element.local_name().into_inner(), element)),
            Event::Empty(element) => each(Tag::Start(element.local_name().into_inner(), element))
                .and_then(|()| each(Tag::End(element.local_name().into_inner()))),
            Event::End(element) => each(Tag::End(element.local_name().into_inner())),
            Event::Text(text) => each(Tag::Text(text)),
            Event::DocType(_) => {
                Err(Stop::Problem("it has a document type, which 3MF does not allow".into()))
            }
            Event::Eof => return Ok(()),
            _ => Ok(()),
        };
        result.map_err(|stop| match stop {
            Stop::Problem(problem) => bad(problem),
            Stop::Error(error) => error,
        })?;
    }
}

/// Why reading stops: a problem at this place, or an error with its own.
enum Stop {
    Problem(Problem),
    Error(MeshReadError),
}

impl From<Problem> for Stop {
    fn from(problem: Problem) -> Self {
        Self::Problem(problem)
    }
}

impl From<MeshReadError> for Stop {
    fn from(error: MeshReadError) -> Self {
        Self::Error(error)
    }
}

/// Fails at a tag or text that would fill the memory.
struct Guarded<R> {
    content: R,
    since_tag: usize,
}

impl<R: Read> Read for Guarded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.content.read(buffer)?;
        match buffer[..count].iter().rposition(|&byte| byte == b'>') {
            Some(at) => self.since_tag = count - at,
            None => self.since_tag += count,
        }
        if self.since_tag > LONGEST_TEXT {
            return Err(io::Error::other("a text without tags is longer than 16 MB"));
        }
        Ok(count)
    }
}

/// The value of an attribute by its local name.
fn attribute(element: &BytesStart<'_>, name: &str) -> Result<Option<String>, Problem> {
    for attribute in element.attributes().with_checks(false) {
        let attribute = attribute.map_err(|error| error.to_string())?;
        if attribute.key.local_name().into_inner() == name {
            let value =
                attribute.normalized_value(XmlVersion::Implicit1_0).map_err(|error| error.to_string())?;
            return Ok(Some(value.into_owned()));
        }
    }
    Ok(None)
}

fn needed(element: &BytesStart<'_>, name: &str) -> Result<String, Problem> {
    attribute(element, name)?.ok_or_else(|| format!("a {} has no {name}", element.local_name().into_inner()))
}

fn whole_number(element: &BytesStart<'_>, name: &str) -> Result<Option<u32>, Problem> {
    let number = |text: String| {
        let value = text.trim().parse();
        value.map_err(|_| format!("{name}=\"{}\" is not a whole number", beginning(&text)))
    };
    attribute(element, name)?.map(number).transpose()
}

fn beginning(text: &str) -> String {
    text.chars().take(40).collect()
}

/// The names of the numbers of a vertex or triangle, read in one pass.
fn numbers<T: FromStr + Copy + Default, const N: usize>(
    element: &BytesStart<'_>,
    names: [&str; N],
) -> Result<[T; N], Problem> {
    let (mut values, mut found) = ([T::default(); N], [false; N]);
    for attribute in element.attributes().with_checks(false) {
        let attribute = attribute.map_err(|error| error.to_string())?;
        let Some(at) = names.iter().position(|name| attribute.key.as_ref() == *name) else { continue };
        let text: &str = &attribute.value;
        let bad = |_| format!("{}=\"{}\" is not a number", names[at], beginning(text));
        values[at] = text.trim().parse().map_err(bad)?;
        found[at] = true;
    }
    match found.iter().position(|found| !found) {
        Some(at) => Err(format!("a {} has no {}", element.local_name().into_inner(), names[at])),
        None => Ok(values),
    }
}

/// A transform as 3MF writes it: four rows of three numbers, for row vectors.
fn transform(element: &BytesStart<'_>) -> Result<Matrix4<f64>, Problem> {
    let Some(text) = attribute(element, "transform")? else { return Ok(Matrix4::identity()) };
    let numbers: Vec<f64> = text.split_whitespace().map_while(|word| word.parse().ok()).collect();
    if numbers.len() != 12 || !numbers.iter().all(|number| number.is_finite()) {
        return Err(format!("transform=\"{}\" is not twelve numbers", beginning(&text)));
    }
    Ok(Matrix4::from_fn(|row, column| match (row, column) {
        (3, 3) => 1.0,
        (3, _) => 0.0,
        _ => numbers[3 * column + row],
    }))
}

/// An object by its model and number.
type Key = (String, u32);

/// A use of an object, in the build or as a component.
struct Placed {
    object: Key,
    transform: Matrix4<f64>,
}

#[derive(Default)]
struct Object {
    name: Option<String>,
    /// `support` and the like; such objects are not part of the product.
    is_support: bool,
    points: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// For each triangle, whether its material is named `mark`; empty if there is none.
    is_mark: Vec<bool>,
    components: Vec<Placed>,
    /// Material of triangles without one.
    material: (Option<u32>, Option<u32>),
}

/// All models of a package.
#[derive(Default)]
struct Models {
    pace: Pace,
    objects: BTreeMap<Key, Object>,
    build: Vec<Placed>,
    unit: Option<String>,
    producer: Option<String>,
    /// Names of the base materials by model, group and index.
    materials: BTreeMap<(String, u32), Vec<String>>,
    used_materials: BTreeSet<(String, u32, u32)>,
    skipped: BTreeMap<&'static str, usize>,
    /// Build items that are not printed.
    hidden: usize,
    triangles: usize,
}

impl Models {
    /// Reads a model; returns the names of other models that it refers to.
    fn read(
        &mut self,
        package: &Package<'_>,
        path: &str,
        is_root: bool,
    ) -> Result<Vec<String>, MeshReadError> {
        let mut model = Model {
            models: self,
            path,
            is_root,
            others: Vec::new(),
            object: None,
            group: None,
            in_application: false,
        };
        elements(package, path, |tag| model.tag(tag))?;
        Ok(model.others)
    }

    fn into_part(mut self, bytes: usize, root: &str) -> Result<RawPart, MeshReadError> {
        let (unit, scale) = unit_of(self.unit.as_deref(), root)?;
        let mut clues = Clues::new(MeshFormat::ThreeMf, self.producer.take());
        clues.stated_unit = Some(unit);
        clues.converted =
            self.unit.as_ref().filter(|_| scale != 1.0).map(|stated| format!("the unit {stated}"));
        let mut part = RawPart::new(clues);
        let mut build = std::mem::take(&mut self.build);
        if self.hidden > 0 {
            self.skipped.insert("hidden object", self.hidden);
            part.notices.extend(hidden_notice(self.hidden));
        } else if build.is_empty() {
            build = self.all_objects(root);
            if !build.is_empty() {
                let text = "the 3MF file has no build items; all its objects are read";
                part.notices.push(Notice::warning("build-empty", text));
            }
        }
        let limit = (bytes / BYTES_OF_TRIANGLE).clamp(MAX_COPIES, MAX_TRIANGLES);
        let mut placing = Placing {
            models: &self,
            part: &mut part,
            limit,
            placed: 0,
            above: Vec::new(),
            skipped: BTreeMap::new(),
        };
        for item in &build {
            placing.place(item, &Matrix4::identity())?;
        }
        for (what, count) in std::mem::take(&mut placing.skipped) {
            *self.skipped.entry(what).or_default() += count;
        }
        part.skipped = self.skipped.iter().map(|(what, count)| format!("{count} x {what}")).collect();
        if part.triangles.is_empty() {
            let cause = match part.skipped.is_empty() {
                true => EmptyCause::Nothing,
                false => EmptyCause::OnlyOthers(part.skipped),
            };
            return Err(MeshReadError::NoTriangles { cause });
        }
        part.materials = self.names_of_used_materials();
        for position in &mut part.positions {
            *position *= scale;
        }
        // Vertices repeated at the border of a face are merged.
        let (positions, triangles) = normals::weld(&part.positions, &part.triangles);
        (part.positions, part.triangles) = (positions, triangles);
        Ok(part)
    }

    /// Every object that is not a component of another one.
    fn all_objects(&self, root: &str) -> Vec<Placed> {
        let components: BTreeSet<&Key> = self
            .objects
            .values()
            .flat_map(|object| &object.components)
            .map(|placed| &placed.object)
            .collect();
        let own = self.objects.keys().filter(|key| key.0 == root && !components.contains(key));
        own.map(|key| Placed { object: key.clone(), transform: Matrix4::identity() }).collect()
    }

    fn names_of_used_materials(&self) -> Vec<String> {
        let name = |(path, group, index): &(String, u32, u32)| {
            self.materials.get(&(path.clone(), *group))?.get(*index as usize).cloned()
        };
        let mut names: Vec<String> = Vec::new();
        for name in self.used_materials.iter().filter_map(name) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }
}

/// The unit of the file, and the factor to it for units that parts cannot have.
fn unit_of(name: Option<&str>, root: &str) -> Result<(LengthUnit, f64), MeshReadError> {
    Ok(match name.unwrap_or("millimeter") {
        "micron" => (LengthUnit::Millimetre, 1e-3),
        "millimeter" => (LengthUnit::Millimetre, 1.0),
        "centimeter" => (LengthUnit::Centimetre, 1.0),
        "inch" => (LengthUnit::Inch, 1.0),
        "foot" => (LengthUnit::Inch, 12.0),
        "meter" => (LengthUnit::Metre, 1.0),
        other => return Err(damaged(root, format!("the unit \"{}\" is unknown", beginning(other)))),
    })
}

/// A model while it is read.
struct Model<'m> {
    models: &'m mut Models,
    path: &'m str,
    is_root: bool,
    /// Models that it refers to.
    others: Vec<String>,
    object: Option<(u32, Object)>,
    /// The group of base materials that is open.
    group: Option<u32>,
    in_application: bool,
}

impl Model<'_> {
    fn tag(&mut self, tag: Tag<'_>) -> Result<(), Stop> {
        match tag {
            Tag::Start(name, element) => self.start(name, element),
            Tag::Text(text) => {
                if self.in_application {
                    self.models.producer = Some(text.trim().chars().take(120).collect());
                }
                Ok(())
            }
            Tag::End(name) => {
                match name {
                    "object" => self.end_object(),
                    "basematerials" => self.group = None,
                    "metadata" => self.in_application = false,
                    _ => {}
                }
                Ok(())
            }
        }
    }

    fn start(&mut self, name: &str, element: &BytesStart<'_>) -> Result<(), Stop> {
        match (name, &mut self.object) {
            ("vertex", Some((_, object))) => {
                let [x, y, z] = numbers(element, ["x", "y", "z"])?;
                if ![x, y, z].iter().all(|value: &f64| value.is_finite()) {
                    let vertex = VertexPlace::Numbered { what: "vertex", number: object.points.len() };
                    return Err(MeshReadError::NotFinite { vertex, coordinate: [x, y, z] }.into());
                }
                at_most("vertices", object.points.len() + 1, 3 * MAX_TRIANGLES)?;
                object.points.push(Point3::new(x, y, z));
            }
            ("triangle", Some(_)) => self.triangle(element)?,
            ("component", Some(_)) => {
                let placed = self.placed(element)?;
                if let Some((_, object)) = &mut self.object {
                    object.components.push(placed);
                }
            }
            ("beamlattice", Some(_)) => self.skip("lattice of beams"),
            ("slicestack", _) => self.skip("stack of slices"),
            ("displacementmesh", Some(_)) => self.skip("displaced mesh"),
            ("object", None) => {
                let id = whole_number(element, "id")?.ok_or_else(|| Problem::from("an object has no id"))?;
                let kind = attribute(element, "type")?;
                let object = Object {
                    name: attribute(element, "name")?.filter(|name| !name.trim().is_empty()),
                    is_support: matches!(kind.as_deref(), Some("support" | "solidsupport")),
                    material: (whole_number(element, "pid")?, whole_number(element, "pindex")?),
                    ..Object::default()
                };
                self.object = Some((id, object));
            }
            ("object", Some(_)) => return Err(Problem::from("an object is inside another object").into()),
            ("item", None) if self.is_root => {
                let placed = self.placed(element)?;
                at_most("build items", self.models.build.len() + 1, MAX_PLACED)?;
                let printable = attribute(element, "printable")?;
                if matches!(printable.as_deref().map(str::trim), Some("0" | "false")) {
                    self.models.hidden += 1;
                } else {
                    self.models.build.push(placed);
                }
            }
            ("model", None) => self.model(element)?,
            ("basematerials", None) => self.group = whole_number(element, "id")?,
            ("base", None) => {
                if let Some(group) = self.group {
                    let name = attribute(element, "name")?.unwrap_or_default();
                    self.models.materials.entry((self.path.to_owned(), group)).or_default().push(name);
                }
            }
            ("metadata", None) if self.is_root => {
                self.in_application = attribute(element, "name")?.as_deref() == Some("Application");
            }
            _ => {}
        }
        Ok(())
    }

    fn skip(&mut self, what: &'static str) {
        *self.models.skipped.entry(what).or_default() += 1;
    }

    fn model(&mut self, element: &BytesStart<'_>) -> Result<(), Stop> {
        if self.is_root {
            self.models.unit = attribute(element, "unit")?;
        }
        let required = attribute(element, "requiredextensions")?.unwrap_or_default();
        for prefix in required.split_whitespace() {
            let namespace = element.attributes().with_checks(false).flatten().find_map(|attribute| {
                (attribute.key.as_ref().strip_prefix("xmlns:") == Some(prefix))
                    .then(|| attribute.value.to_string())
            });
            let name = namespace.unwrap_or_else(|| prefix.to_owned());
            if !HARMLESS.iter().any(|known| name.starts_with(known)) {
                return Err(MeshReadError::UnsupportedExtension { name }.into());
            }
        }
        Ok(())
    }

    /// The object and the transform of a build item or component.
    fn placed(&mut self, element: &BytesStart<'_>) -> Result<Placed, Problem> {
        let id: String = needed(element, "objectid")?;
        let id = id
            .trim()
            .parse()
            .map_err(|_| format!("objectid=\"{}\" is not a whole number", beginning(&id)))?;
        let path = match attribute(element, "path")? {
            Some(path) => {
                let path = entry_name(&path);
                if !self.others.contains(&path) {
                    self.others.push(path.clone());
                }
                path
            }
            None => self.path.to_owned(),
        };
        Ok(Placed { object: (path, id), transform: transform(element)? })
    }

    fn triangle(&mut self, element: &BytesStart<'_>) -> Result<(), Stop> {
        let corners: [u32; 3] = numbers(element, ["v1", "v2", "v3"])?;
        let Some((_, object)) = &mut self.object else { return Ok(()) };
        self.models.triangles += 1;
        at_most("triangles", self.models.triangles, MAX_TRIANGLES)?;
        check_pace(self.models.pace, self.models.triangles, QUICK_TRIANGLES)?;
        let group = whole_number(element, "pid")?.or(object.material.0);
        let index = whole_number(element, "p1")?.or(object.material.1);
        let mut is_mark = false;
        if let (Some(group), Some(index)) = (group, index) {
            let names = self.models.materials.get(&(self.path.to_owned(), group));
            is_mark = names.and_then(|names| names.get(index as usize)).is_some_and(|name| bounds_ink(name));
            if names.is_some() {
                self.models.used_materials.insert((self.path.to_owned(), group, index));
            }
        }
        if is_mark || !object.is_mark.is_empty() {
            object.is_mark.resize(object.triangles.len(), false);
            object.is_mark.push(is_mark);
        }
        object.triangles.push(corners);
        Ok(())
    }

    fn end_object(&mut self) {
        if let Some((id, object)) = self.object.take() {
            self.models.objects.insert((self.path.to_owned(), id), object);
        }
    }
}

/// Puts the objects of the build into a part.
struct Placing<'p> {
    models: &'p Models,
    part: &'p mut RawPart,
    limit: usize,
    placed: usize,
    /// The objects that contain the current one.
    above: Vec<Key>,
    skipped: BTreeMap<&'static str, usize>,
}

impl Placing<'_> {
    fn place(&mut self, placed: &Placed, outer: &Matrix4<f64>) -> Result<(), MeshReadError> {
        let (path, id) = &placed.object;
        let name = || format!("object {id}");
        let Some(object) = self.models.objects.get(&placed.object) else {
            return Err(damaged(path, format!("{} does not exist", name())));
        };
        if self.above.contains(&placed.object) || self.above.len() >= MAX_DEPTH {
            return Err(damaged(
                path,
                format!("{} contains itself, or over {MAX_DEPTH} components inside each other", name()),
            ));
        }
        self.placed += 1;
        at_most("components", self.placed, MAX_PLACED)?;
        if object.is_support {
            *self.skipped.entry("support").or_default() += 1;
            return Ok(());
        }
        let transform = outer * placed.transform;
        if !transform.iter().all(|value| value.is_finite()) {
            return Err(MeshReadError::BadTransform { node: name() });
        }
        self.mesh(object, id, &transform)?;
        self.above.push(placed.object.clone());
        for component in &object.components {
            self.place(component, &transform)?;
        }
        self.above.pop();
        Ok(())
    }

    fn mesh(&mut self, object: &Object, id: &u32, transform: &Matrix4<f64>) -> Result<(), MeshReadError> {
        if object.triangles.is_empty() {
            return Ok(());
        }
        let part = &mut *self.part;
        let count = part.triangles.len() + object.triangles.len();
        at_most("triangles", count, self.limit)?;
        at_most("vertices", part.positions.len() + object.points.len(), 3 * self.limit)?;
        check_pace(self.models.pace, count, QUICK_TRIANGLES)?;
        let beyond = |corner: &&u32| **corner as usize >= object.points.len();
        for (number, corners) in object.triangles.iter().enumerate() {
            if let Some(&index) = corners.iter().find(beyond) {
                return Err(MeshReadError::IndexOutOfRange {
                    face: VertexPlace::Numbered { what: "triangle", number },
                    kind: "vertex",
                    index: i64::from(index),
                    count: object.points.len(),
                });
            }
        }
        let is_mirrored = transform.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        let first = part.positions.len() as u32;
        part.positions.extend(object.points.iter().map(|point| transform.transform_point(point)));
        let before = part.triangles.len();
        part.triangles.extend(object.triangles.iter().map(|&[a, b, c]| {
            let corners = if is_mirrored { [a, c, b] } else { [a, b, c] };
            corners.map(|corner| first + corner)
        }));
        let is_mark = object.name.as_deref().is_some_and(bounds_ink);
        if is_mark || !object.is_mark.is_empty() || !part.is_mark.is_empty() {
            part.is_mark.resize(before, false);
            part.is_mark.extend(&object.is_mark);
            part.is_mark.resize(count, is_mark);
            if is_mark {
                part.is_mark[before..].fill(true);
            }
        }
        part.bodies.push(object.name.clone().unwrap_or_else(|| format!("object {id}")));
        Ok(())
    }
}

#[cfg(test)]
mod tests;
