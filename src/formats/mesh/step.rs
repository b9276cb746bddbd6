//! Parts in STEP files (ISO 10303-21 with AP203, AP214 or AP242): faces on exact surfaces, with units, placements and assemblies.

use std::collections::{BTreeMap, BTreeSet};

mod error;
mod exchange;
mod geometry;

pub use error::{StepError, StepProblem};

use nalgebra::Matrix4;

use super::clues::Clues;
use super::raw::{FrameNode, MAX_TRIANGLES, RawPart, at_most, check_pace};
use super::{LengthUnit, MeshFormat, MeshOptions, MeshReadError, NormalsFound};
use crate::geometry::solid::frame::{Frame, Placement};
use crate::geometry::solid::surface::Surface;
use crate::geometry::solid::tessellation::Tessellation;
use crate::geometry::solid::{Face, Solid};
use crate::reason::Notice;
use exchange::{Exchange, Record, check_beginning, text};
use geometry::{Geometry, Units};

/// Largest number of faces of a part, with those of repeated bodies.
const MAX_FACES: usize = 200_000;
/// Largest number of points along the edges of a part, with those of repeated bodies.
const MAX_POINTS: usize = 8_000_000;
/// Largest depth of assemblies.
const MAX_DEPTH: usize = 64;

/// A part in a STEP file.
#[derive(Debug, Clone, PartialEq)]
struct StepPart {
    /// Its faces, mm.
    solid: Solid,
    /// The name of each body.
    bodies: Vec<String>,
    /// For each face, whether it or its body is named `mark`.
    is_mark: Vec<bool>,
    /// The program that wrote the file, as the file names it.
    producer: Option<String>,
    /// Millimetres for each unit of length of the first representation with faces.
    unit: f64,
    /// The placements named `isomark`.
    frames: Vec<Frame>,
    /// Content that was skipped, such as `2 x GEOMETRIC_CURVE_SET`.
    skipped: Vec<String>,
    /// Other STEP files that contain shapes of an assembly.
    elsewhere: Vec<String>,
    /// The components of assemblies that have no placement.
    unplaced: Vec<String>,
}

/// Distance of the chords of the tessellation from the faces, mm.
const CHORD: f64 = 0.01;
/// Largest size of a file at a quick pace, bytes.
const QUICK_BYTES: usize = 4_000_000;
/// Faces that are not read, or files, that are named in a notice, at most.
const MAX_NAMED: usize = 5;
/// Bytes at the end of a complete file that contain its end mark.
const TAIL: usize = 512;

/// Whether a placement named `isomark` is in the file.
pub(super) fn has_frame(bytes: &[u8]) -> bool {
    let name = b"'isomark'";
    bytes.windows(name.len()).any(|window| window == name)
}

/// Checks whether the file has its end mark.
///
/// # Errors
/// If it has none.
pub(super) fn is_whole(bytes: &[u8]) -> Result<(), MeshReadError> {
    let tail = &bytes[bytes.len().saturating_sub(TAIL)..];
    let mark = b"END-ISO-10303-21";
    if tail.windows(mark.len()).any(|window| window == mark) {
        return Ok(());
    }
    check_beginning(bytes)?;
    let line = bytes.iter().filter(|byte| **byte == b'\n').count() as u64 + 1;
    Err(StepError { line, record: None, problem: StepProblem::CutOff }.into())
}

/// Reads a STEP file as a part.
///
/// # Errors
/// See [`StepError`], and when the part takes too long for the pace.
pub(super) fn read(bytes: &[u8], options: &MeshOptions) -> Result<RawPart, MeshReadError> {
    check_pace(options.pace, bytes.len(), QUICK_BYTES)?;
    let part = read_part(bytes, options.unit.map(LengthUnit::in_mm))?;
    let mesh = Tessellation::of(&part.solid, CHORD);
    at_most("triangles", mesh.triangles.len(), MAX_TRIANGLES)?;
    let mut clues = Clues::new(MeshFormat::Step, part.producer);
    let unit = UNITS.into_iter().find(|unit| (unit.in_mm() / part.unit - 1.0).abs() < 1e-9);
    clues.stated_unit = Some(unit.unwrap_or(LengthUnit::Millimetre));
    clues.converted = unit.is_none().then(|| format!("a unit of {} mm", part.unit));
    // The positions are in the unit that the facts give; units without a name are converted to mm.
    let scale = options.unit.or(clues.stated_unit).map_or(1.0, LengthUnit::in_mm);
    let mut raw = RawPart::new(clues);
    raw.positions = mesh.positions.into_iter().map(|position| position / scale).collect();
    raw.normals = mesh.normals;
    raw.triangles = mesh.triangles;
    raw.normals_found = NormalsFound::Smooth;
    if part.is_mark.contains(&true) {
        raw.is_mark = mesh.faces.iter().map(|face| part.is_mark[*face as usize]).collect();
    }
    raw.frames = part.frames.iter().map(|frame| frame_node(frame, scale)).collect();
    raw.bodies = part.bodies.into_iter().filter(|name| !name.trim().is_empty()).collect();
    raw.skipped = part.skipped;
    raw.notices.extend(unread_notice(&part.solid));
    raw.notices.extend(elsewhere_notice(&part.elsewhere));
    raw.notices.extend(unplaced_notice(&part.unplaced));
    raw.solid = Some(part.solid);
    Ok(raw)
}

/// The units that facts can name.
const UNITS: [LengthUnit; 5] = [
    LengthUnit::Millimetre,
    LengthUnit::Centimetre,
    LengthUnit::Decimetre,
    LengthUnit::Metre,
    LengthUnit::Inch,
];

fn frame_node(frame: &Frame, scale: f64) -> FrameNode {
    let mut transform = Matrix4::identity();
    for (column, axis) in [frame.x, frame.y, frame.z].into_iter().enumerate() {
        transform.fixed_view_mut::<3, 1>(0, column).copy_from(&axis);
    }
    transform.fixed_view_mut::<3, 1>(0, 3).copy_from(&(frame.origin.coords / scale));
    FrameNode { is_exact: true, transform }
}

/// Names the faces that are not read.
fn unread_notice(solid: &Solid) -> Option<Notice> {
    let unread: Vec<String> = solid
        .faces
        .iter()
        .filter_map(|face| match &face.surface {
            Surface::Unread(kind) => Some(format!("#{} ({kind})", face.id)),
            _ => None,
        })
        .collect();
    let count = unread.len();
    (count > 0).then(|| {
        let message = format!(
            "{count} faces cannot be read: {}; a side on which the laser sees one of them is refused",
            listed(&unread)
        );
        Notice::warning("step-face-unread", message)
    })
}

/// Names the files of components that are missing here.
fn elsewhere_notice(files: &[String]) -> Option<Notice> {
    (!files.is_empty()).then(|| {
        let message = format!(
            "the assembly has components in other files, which are not read: {}; if the laser meets one of them, \
             export the assembly as one STEP file",
            listed(files)
        );
        Notice::warning("step-files-missing", message)
    })
}

/// Names the components of assemblies without a placement.
fn unplaced_notice(components: &[String]) -> Option<Notice> {
    let message = match components {
        [] => return None,
        [component] => format!(
            "the component {component} has no placement in its assembly and is read where it was modelled"
        ),
        _ => format!(
            "{} components have no placement in their assemblies and are read where they were modelled: {}",
            components.len(),
            listed(components)
        ),
    };
    Some(Notice::warning("step-placement-missing", message))
}

/// The first names, for messages.
fn listed(names: &[String]) -> String {
    let more = if names.len() > MAX_NAMED { " and more" } else { "" };
    let first: Vec<&str> = names.iter().take(MAX_NAMED).map(String::as_str).collect();
    format!("{}{more}", first.join(", "))
}

/// Reads a STEP file; `length` is the unit of its lengths, mm, if it is not the one that the file gives.
///
/// # Errors
/// See [`StepError`].
fn read_part(bytes: &[u8], length: Option<f64>) -> Result<StepPart, StepError> {
    let file = Exchange::new(bytes)?;
    Reader::new(&file, length)?.read()
}

/// A shape with the names of its bodies.
#[derive(Debug, Clone, Default)]
struct Shape {
    solid: Solid,
    bodies: Vec<String>,
    is_mark: Vec<bool>,
    frames: Vec<Frame>,
}

impl Shape {
    fn add(&mut self, other: Self) {
        self.solid.add(other.solid, self.bodies.len() as u32);
        self.bodies.extend(other.bodies);
        self.is_mark.extend(other.is_mark);
        self.frames.extend(other.frames);
    }

    fn placed(&self, placement: &Placement) -> Self {
        let frames = self.frames.iter().map(|frame| placement.frame(frame)).collect();
        Self { solid: self.solid.placed(placement), frames, ..self.clone() }
    }
}

/// An occurrence of a product in an assembly.
#[derive(Debug, Clone, Copy)]
struct Occurrence {
    id: u64,
    child: u64,
}

struct Reader<'f, 'a> {
    file: &'f Exchange<'a>,
    /// The unit of length that the settings give, mm.
    length: Option<f64>,
    /// The representations of each product definition.
    shapes: BTreeMap<u64, BTreeSet<u64>>,
    /// Representations that describe the same shape.
    same: BTreeMap<u64, BTreeSet<u64>>,
    /// The occurrences in each product definition.
    children: BTreeMap<u64, Vec<Occurrence>>,
    /// The relation that places an occurrence.
    placing: BTreeMap<u64, u64>,
    /// The relations of representations with a transformation, without an occurrence: the parent's, with relation and child.
    loose: BTreeMap<u64, Vec<(u64, u64)>>,
    representations: Vec<u64>,
    done: BTreeMap<u64, Shape>,
    open: BTreeSet<u64>,
    faces: usize,
    points: usize,
    unit: Option<f64>,
    skipped: BTreeMap<String, usize>,
    elsewhere: BTreeSet<String>,
    unplaced: Vec<String>,
    /// The products whose own representations contain the shapes of all their occurrences.
    mapped: BTreeSet<u64>,
}

impl<'f, 'a> Reader<'f, 'a> {
    fn new(file: &'f Exchange<'a>, length: Option<f64>) -> Result<Self, StepError> {
        let mut reader = Self {
            file,
            length,
            shapes: BTreeMap::new(),
            same: BTreeMap::new(),
            children: BTreeMap::new(),
            placing: BTreeMap::new(),
            loose: BTreeMap::new(),
            representations: Vec::new(),
            done: BTreeMap::new(),
            open: BTreeSet::new(),
            faces: 0,
            points: 0,
            unit: None,
            skipped: BTreeMap::new(),
            elsewhere: BTreeSet::new(),
            unplaced: Vec::new(),
            mapped: BTreeSet::new(),
        };
        let mut relations = Vec::new();
        let mut placed = BTreeSet::new();
        for (id, kind) in file.kinds() {
            match kind {
                "SHAPE_DEFINITION_REPRESENTATION" => reader.note_definition(id)?,
                "NEXT_ASSEMBLY_USAGE_OCCURRENCE" => reader.note_occurrence(id)?,
                "CONTEXT_DEPENDENT_SHAPE_REPRESENTATION" => placed.extend(reader.note_placing(id)?),
                "SHAPE_REPRESENTATION_RELATIONSHIP" | "REPRESENTATION_RELATIONSHIP" | "(" => {
                    relations.push(id)
                }
                "DOCUMENT_FILE" => reader.note_file(id)?,
                _ if kind.ends_with("SHAPE_REPRESENTATION") => reader.representations.push(id),
                _ => {}
            }
        }
        for id in relations {
            reader.note_relation(id, placed.contains(&id))?;
        }
        Ok(reader)
    }

    fn record(&self, id: u64) -> Result<Option<Record<'a>>, StepError> {
        self.file.find(id)
    }

    fn note_definition(&mut self, id: u64) -> Result<(), StepError> {
        let Some(record) = self.record(id)? else { return Ok(()) };
        let parameters = record.first(self.file);
        let property = parameters.follow(0)?;
        if !property.is("PRODUCT_DEFINITION_SHAPE") {
            return Ok(());
        }
        let definition = property.first(self.file).follow(2)?;
        if definition.is("PRODUCT_DEFINITION")
            || definition.is("PRODUCT_DEFINITION_WITH_ASSOCIATED_DOCUMENTS")
        {
            self.shapes.entry(definition.id).or_default().insert(parameters.reference(1)?);
        }
        Ok(())
    }

    /// Notes a file of a component; documents of other kinds have no shapes.
    fn note_file(&mut self, id: u64) -> Result<(), StepError> {
        let Some(record) = self.record(id)? else { return Ok(()) };
        let name: String = record.first(self.file).text(0).trim().chars().take(100).collect();
        let lower = name.to_ascii_lowercase();
        if [".stp", ".step", ".p21"].iter().any(|ending| lower.ends_with(ending)) {
            self.elsewhere.insert(name);
        }
        Ok(())
    }

    fn note_occurrence(&mut self, id: u64) -> Result<(), StepError> {
        let Some(record) = self.record(id)? else { return Ok(()) };
        let parameters = record.first(self.file);
        let (parent, child) = (parameters.reference(3)?, parameters.reference(4)?);
        self.children.entry(parent).or_default().push(Occurrence { id, child });
        Ok(())
    }

    /// Notes the relation that places an occurrence, and returns it.
    fn note_placing(&mut self, id: u64) -> Result<Option<u64>, StepError> {
        let Some(record) = self.record(id)? else { return Ok(None) };
        let parameters = record.first(self.file);
        let relation = parameters.reference(0)?;
        let shape = parameters.follow(1)?;
        let occurrence = shape.first(self.file).reference(2)?;
        self.placing.insert(occurrence, relation);
        Ok(Some(relation))
    }

    fn note_relation(&mut self, id: u64, places: bool) -> Result<(), StepError> {
        let Some(record) = self.record(id)? else { return Ok(()) };
        if places {
            return Ok(());
        }
        let own = ["REPRESENTATION_RELATIONSHIP", "SHAPE_REPRESENTATION_RELATIONSHIP"];
        let Some(parameters) =
            own.iter().find_map(|kind| record.of(self.file, kind).filter(|found| found.value(3).is_some()))
        else {
            return Ok(());
        };
        let (one, other) = (parameters.reference(2)?, parameters.reference(3)?);
        if record.is("REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION") {
            self.loose.entry(other).or_default().push((id, one));
        } else {
            self.same.entry(one).or_default().insert(other);
            self.same.entry(other).or_default().insert(one);
        }
        Ok(())
    }

    fn read(mut self) -> Result<StepPart, StepError> {
        let children: BTreeSet<u64> =
            self.children.values().flatten().map(|occurrence| occurrence.child).collect();
        let all: BTreeSet<u64> = self.shapes.keys().chain(self.children.keys()).copied().collect();
        let mut roots: Vec<u64> =
            all.iter().copied().filter(|definition| !children.contains(definition)).collect();
        if roots.is_empty() {
            // A ring of products contains itself, which is found on the way.
            roots.extend(all.first());
        }
        let mut whole = Shape::default();
        for root in roots {
            let shape = self.product(root, 0)?;
            self.count(&shape.solid, root)?;
            whole.add(shape);
        }
        if whole.solid.faces.is_empty() {
            // Without products, every shape is meant.
            for id in self.representations.clone() {
                let shape = self.representation(id, 0)?;
                whole.add(shape);
            }
        }
        let skipped: Vec<String> =
            self.skipped.iter().map(|(kind, count)| format!("{count} x {kind}")).collect();
        let elsewhere: Vec<String> = std::mem::take(&mut self.elsewhere).into_iter().collect();
        if whole.solid.faces.is_empty() {
            let problem = match elsewhere.is_empty() {
                true => StepProblem::NoFaces { found: skipped },
                false => StepProblem::Elsewhere { files: listed(&elsewhere) },
            };
            return Err(self.file.error(0, None, problem));
        }
        let unread = |face: &Face| match &face.surface {
            Surface::Unread(kind) => Some((face.id, kind.clone())),
            _ => None,
        };
        let unread: Vec<(u64, String)> = whole.solid.faces.iter().filter_map(unread).collect();
        if unread.len() == whole.solid.faces.len()
            && let Some((id, kind)) = unread.into_iter().next()
        {
            return Err(self.error_in(id, StepProblem::Unread { kind })?);
        }
        let names = self.file.header("FILE_NAME");
        let named = |index: usize| text(names.and_then(|values| values.get(index))).trim().to_owned();
        let producer =
            [5, 4].map(named).into_iter().filter(|name| !name.is_empty()).collect::<Vec<_>>().join(", ");
        Ok(StepPart {
            solid: whole.solid,
            bodies: whole.bodies,
            is_mark: whole.is_mark,
            producer: (!producer.is_empty()).then_some(producer),
            unit: self.unit.unwrap_or(1.0),
            frames: whole.frames,
            skipped,
            elsewhere,
            unplaced: self.unplaced,
        })
    }

    /// Limits what repeated bodies need: every copy counts.
    fn count(&mut self, solid: &Solid, id: u64) -> Result<(), StepError> {
        self.faces += solid.faces.len();
        self.points += solid.edges.iter().map(|edge| edge.points.len() + edge.coarse.len()).sum::<usize>();
        let problem = if self.faces > MAX_FACES {
            StepProblem::TooLarge { what: "faces", limit: MAX_FACES as u64 }
        } else if self.points > MAX_POINTS {
            StepProblem::TooLarge { what: "points along edges", limit: MAX_POINTS as u64 }
        } else {
            return Ok(());
        };
        Err(self.error_in(id, problem)?)
    }

    fn enter(&mut self, id: u64, depth: usize) -> Result<(), StepError> {
        let problem = match depth > MAX_DEPTH {
            true => StepProblem::Nested { limit: MAX_DEPTH },
            false if self.open.insert(id) => return Ok(()),
            false => StepProblem::Cyclic,
        };
        Err(self.error_in(id, problem)?)
    }

    /// An error in a record.
    fn error_in(&self, id: u64, problem: StepProblem) -> Result<StepError, StepError> {
        Ok(match self.record(id)? {
            Some(record) => record.first(self.file).error(problem),
            None => self.file.error(0, Some(id), problem),
        })
    }

    /// The shape of a product with those of its occurrences.
    fn product(&mut self, definition: u64, depth: usize) -> Result<Shape, StepError> {
        if let Some(done) = self.done.get(&definition) {
            return Ok(done.clone());
        }
        self.enter(definition, depth)?;
        let name = self.product_name(definition)?;
        let mut shape = Shape::default();
        let own_representations = self.all_same(&self.shapes.get(&definition).cloned().unwrap_or_default());
        for id in own_representations.iter().copied() {
            let mut own = self.representation(id, depth + 1)?;
            own.bodies.iter_mut().filter(|body| body.is_empty()).for_each(|body| body.clone_from(&name));
            shape.add(own);
        }
        let occurrences = self.children.get(&definition).cloned().unwrap_or_default();
        let mut there = match occurrences.is_empty() {
            true => BTreeMap::new(),
            false => self.there(&own_representations)?,
        };
        let mut is_mapped = true;
        for occurrence in occurrences {
            let child = self.product(occurrence.child, depth + 1)?;
            let placement = match self.placing.get(&occurrence.id) {
                Some(relation) => self.occurrence_placement(occurrence, *relation)?,
                None if self.take(occurrence, &mut there) => continue,
                None => {
                    if !child.solid.faces.is_empty() {
                        let name = self.product_name(occurrence.child)?;
                        let number = format!("#{}", occurrence.child);
                        self.unplaced.push(if name.trim().is_empty() { number } else { name });
                    }
                    Placement::identity()
                }
            };
            is_mapped = false;
            self.count(&child.solid, occurrence.id)?;
            shape.add(child.placed(&placement));
        }
        self.open.remove(&definition);
        self.done.insert(definition, shape.clone());
        if is_mapped {
            self.mapped.insert(definition);
        }
        Ok(shape)
    }

    /// How often an assembly's own representations contain others: themselves once, and those that they map or place.
    fn there(&self, representations: &BTreeSet<u64>) -> Result<BTreeMap<u64, usize>, StepError> {
        let mut there: BTreeMap<u64, usize> = BTreeMap::new();
        for id in representations {
            *there.entry(*id).or_default() += 1;
            for (_, child) in self.loose.get(id).into_iter().flatten() {
                *there.entry(*child).or_default() += 1;
            }
            let Some(record) = self.record(*id)? else { continue };
            let parameters = record.first(self.file);
            for item in parameters.references(1)? {
                let item = self.file.record(item, &parameters)?;
                if item.is("MAPPED_ITEM") {
                    let map = item.first(self.file).follow(1)?;
                    *there.entry(map.first(self.file).reference(1)?).or_default() += 1;
                }
            }
        }
        Ok(there)
    }

    /// Takes the shape of an occurrence from those that are already `there` in the assembly's own representations; returns whether it
    /// is one of them. Instead of a relation that places it, an occurrence can have an item that maps it.
    fn take(&self, occurrence: Occurrence, there: &mut BTreeMap<u64, usize>) -> bool {
        let own = self.all_same(&self.shapes.get(&occurrence.child).cloned().unwrap_or_default());
        let has_faces = |id: &u64| self.done.get(id).is_some_and(|shape| !shape.solid.faces.is_empty());
        let found = own.iter().find(|id| there.get(id).is_some_and(|left| *left > 0) && has_faces(id));
        let Some(left) =
            found.filter(|_| self.mapped.contains(&occurrence.child)).and_then(|id| there.get_mut(id))
        else {
            return false;
        };
        *left -= 1;
        true
    }

    fn product_name(&self, definition: u64) -> Result<String, StepError> {
        let Some(record) = self.record(definition)? else { return Ok(String::new()) };
        let formation = record.first(self.file).follow(2)?;
        let product = formation.first(self.file).follow(2)?;
        let parameters = product.first(self.file);
        let name = parameters.text(1);
        Ok(if name.trim().is_empty() { parameters.text(0) } else { name })
    }

    /// The representations and all that describe the same shapes.
    fn all_same(&self, first: &BTreeSet<u64>) -> BTreeSet<u64> {
        let mut found = first.clone();
        let mut open: Vec<u64> = found.iter().copied().collect();
        while let Some(id) = open.pop() {
            for other in self.same.get(&id).into_iter().flatten() {
                if found.insert(*other) {
                    open.push(*other);
                }
            }
        }
        found
    }

    fn occurrence_placement(&self, occurrence: Occurrence, relation: u64) -> Result<Placement, StepError> {
        let Some(record) = self.record(relation)? else {
            return Err(self.file.error(0, Some(relation), StepProblem::Missing { target: relation }));
        };
        let of_child = self.all_same(&self.shapes.get(&occurrence.child).cloned().unwrap_or_default());
        self.relation_placement(&record, |first| of_child.contains(&first))
    }

    /// The placement of a relation with a transformation; `is_child` is whether a representation is the one that is placed.
    fn relation_placement(
        &self,
        record: &Record<'a>,
        is_child: impl Fn(u64) -> bool,
    ) -> Result<Placement, StepError> {
        let own = ["REPRESENTATION_RELATIONSHIP", "SHAPE_REPRESENTATION_RELATIONSHIP"];
        let Some(relation) =
            own.iter().find_map(|kind| record.of(self.file, kind).filter(|found| found.value(3).is_some()))
        else {
            return Ok(Placement::identity());
        };
        let Some(transformation) = record.of(self.file, "REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION")
        else {
            return Ok(Placement::identity());
        };
        let (one, other) = (relation.reference(2)?, relation.reference(3)?);
        // In a record of several kinds the transformation is the only parameter, otherwise it is behind those of the relation.
        let operator = transformation.follow(if transformation.value(4).is_some() { 4 } else { 0 })?;
        let (one_units, other_units) = (self.units(one)?, self.units(other)?);
        let parameters = operator.first(self.file);
        if operator.is("ITEM_DEFINED_TRANSFORMATION") {
            let from = Geometry::new(self.file, one_units).frame(&parameters.follow(2)?)?;
            let to = Geometry::new(self.file, other_units).frame(&parameters.follow(3)?)?;
            return Ok(match !is_child(one) && is_child(other) {
                true => Placement::between(&to, &from),
                false => Placement::between(&from, &to),
            });
        }
        self.operator(&operator, other_units)
    }

    /// A CARTESIAN_TRANSFORMATION_OPERATOR_3D.
    fn operator(&self, record: &Record<'a>, units: Units) -> Result<Placement, StepError> {
        let parameters = record.expect(self.file, &["CARTESIAN_TRANSFORMATION_OPERATOR_3D"])?;
        if record.is_complex() {
            return Err(parameters.error(StepProblem::Unread { kind: record.kind().to_owned() }));
        }
        // Name and description of the functionally defined transformation, then the axes.
        let first = if parameters.value(6).is_some() { 2 } else { 1 };
        let geometry = Geometry::new(self.file, units);
        let axis = |index: usize| geometry.direction(&parameters, index);
        let (x, y, z) = (axis(first)?, axis(first + 1)?, axis(first + 4)?);
        let origin = geometry.point(&parameters, first + 2)?;
        let scale = match parameters.value(first + 3) {
            Some(exchange::Value::Number(scale)) => *scale,
            _ => 1.0,
        };
        let frame = Frame::new(origin, z, x).ok_or_else(|| parameters.error(StepProblem::NoAxes))?;
        let mirrored = y.is_some_and(|y| y.dot(&frame.y) < 0.0);
        if (scale - 1.0).abs() > 1e-9 || mirrored {
            return Err(parameters.error(StepProblem::Scaled));
        }
        Ok(Placement::between(&Frame::identity(), &frame))
    }

    /// The shape of a representation with those that it maps.
    fn representation(&mut self, id: u64, depth: usize) -> Result<Shape, StepError> {
        if let Some(done) = self.done.get(&id) {
            return Ok(done.clone());
        }
        let Some(record) = self.record(id)? else {
            return Err(self.file.error(0, Some(id), StepProblem::Missing { target: id }));
        };
        self.enter(id, depth)?;
        let parameters = record.first(self.file);
        let units = self.units(id)?;
        let mut geometry = Geometry::new(self.file, units);
        let mut shape = Shape::default();
        let mut mapped = Vec::new();
        for item in parameters.references(1)? {
            let item = self.file.record(item, &parameters)?;
            let own = item.first(self.file);
            let body = shape.bodies.len() as u32;
            match item.kind() {
                "MANIFOLD_SOLID_BREP" | "FACETED_BREP" => geometry.shell(&own.follow(1)?, body, false, 0)?,
                "BREP_WITH_VOIDS" => {
                    geometry.shell(&own.follow(1)?, body, false, 0)?;
                    for void in own.references(2)? {
                        geometry.shell(&self.file.record(void, &own)?, body, false, 0)?;
                    }
                }
                "SHELL_BASED_SURFACE_MODEL" | "FACE_BASED_SURFACE_MODEL" => {
                    for shell in own.references(1)? {
                        geometry.shell(&self.file.record(shell, &own)?, body, false, 0)?;
                    }
                }
                "MAPPED_ITEM" => {
                    mapped.push(item);
                    continue;
                }
                "AXIS2_PLACEMENT_3D" => {
                    if own.text(0).trim() == "isomark" {
                        shape.frames.push(geometry.frame(&item)?);
                    }
                    continue;
                }
                kind => {
                    *self.skipped.entry(kind.to_owned()).or_default() += 1;
                    continue;
                }
            }
            shape.bodies.push(own.text(0));
        }
        let count = geometry.faces.len();
        if count > 0 {
            self.unit.get_or_insert(units.length);
        }
        let named = |body: u32| shape.bodies.get(body as usize).is_some_and(|name| name.trim() == "mark");
        shape.is_mark =
            geometry.faces.iter().map(|face| geometry.marks.contains(&face.id) || named(face.body)).collect();
        shape.solid = Solid { edges: geometry.edges, faces: geometry.faces };
        self.count(&shape.solid, id)?;
        for item in mapped {
            let part = self.mapped(&item, units, depth)?;
            self.count(&part.solid, item.id)?;
            shape.add(part);
        }
        for (relation, child) in self.loose.get(&id).cloned().unwrap_or_default() {
            let part = self.representation(child, depth + 1)?;
            let Some(record) = self.record(relation)? else { continue };
            let placement = self.relation_placement(&record, |first| first == child)?;
            self.count(&part.solid, relation)?;
            shape.add(part.placed(&placement));
        }
        self.open.remove(&id);
        self.done.insert(id, shape.clone());
        Ok(shape)
    }

    fn mapped(&mut self, item: &Record<'a>, units: Units, depth: usize) -> Result<Shape, StepError> {
        let parameters = item.first(self.file);
        let map = parameters.follow(1)?;
        let map = map.expect(self.file, &["REPRESENTATION_MAP"])?;
        let source = map.reference(1)?;
        let part = self.representation(source, depth + 1)?;
        let from = Geometry::new(self.file, self.units(source)?).frame(&map.follow(0)?)?;
        let target = parameters.follow(2)?;
        let placement = match target.is("CARTESIAN_TRANSFORMATION_OPERATOR_3D") {
            true => self.operator(&target, units)?.after(&Placement::between(&from, &Frame::identity())),
            false => Placement::between(&from, &Geometry::new(self.file, units).frame(&target)?),
        };
        Ok(part.placed(&placement))
    }

    /// The units of a representation.
    fn units(&self, representation: u64) -> Result<Units, StepError> {
        let units = self.stated_units(representation)?;
        Ok(Units { length: self.length.unwrap_or(units.length), ..units })
    }

    fn stated_units(&self, representation: u64) -> Result<Units, StepError> {
        let mut units = Units { length: 1.0, angle: 1.0 };
        let Some(record) = self.record(representation)? else { return Ok(units) };
        let parameters = record.first(self.file);
        let Some(context) = parameters.optional(2)? else { return Ok(units) };
        let context = self.file.record(context, &parameters)?;
        let Some(assigned) = context.of(self.file, "GLOBAL_UNIT_ASSIGNED_CONTEXT") else { return Ok(units) };
        // Alone, the record has the identifier and the type of the context before its units.
        let index = if context.is_complex() { 0 } else { 2 };
        for id in assigned.references(index)? {
            let unit = self.file.record(id, &assigned)?;
            if unit.is("LENGTH_UNIT") {
                units.length = self.unit(&unit, 0)? * 1000.0;
            } else if unit.is("PLANE_ANGLE_UNIT") {
                units.angle = self.unit(&unit, 0)?;
            }
        }
        let valid = |value: f64| value.is_finite() && value > 1e-12 && value < 1e12;
        if !(valid(units.length) && valid(units.angle)) {
            return Err(
                assigned.error(StepProblem::WrongNumber { what: "unit", value: units.length.to_string() })
            );
        }
        Ok(units)
    }

    /// The value of a unit in metres or radians.
    fn unit(&self, record: &Record<'a>, depth: usize) -> Result<f64, StepError> {
        if depth > 8 {
            return Err(record.first(self.file).error(StepProblem::Cyclic));
        }
        if let Some(unit) = record.of(self.file, "SI_UNIT") {
            // The prefix and the name are the last two parameters.
            let first = if unit.value(2).is_some() { 1 } else { 0 };
            let prefix = match unit.name(first) {
                None => 1.0,
                Some("EXA") => 1e18,
                Some("PETA") => 1e15,
                Some("TERA") => 1e12,
                Some("GIGA") => 1e9,
                Some("MEGA") => 1e6,
                Some("KILO") => 1e3,
                Some("HECTO") => 1e2,
                Some("DECA") => 1e1,
                Some("DECI") => 1e-1,
                Some("CENTI") => 1e-2,
                Some("MILLI") => 1e-3,
                Some("MICRO") => 1e-6,
                Some("NANO") => 1e-9,
                Some("PICO") => 1e-12,
                Some(name) => return Err(unit.error(StepProblem::Unit { name: name.to_owned() })),
            };
            return match unit.name(first + 1) {
                Some("METRE" | "RADIAN") => Ok(prefix),
                name => {
                    Err(unit.error(StepProblem::Unit { name: name.unwrap_or("without a name").to_owned() }))
                }
            };
        }
        if let Some(unit) = record.of(self.file, "CONVERSION_BASED_UNIT") {
            let index = if unit.value(2).is_some() { 2 } else { 1 };
            let measure = unit.follow(index)?;
            let measure = measure.first(self.file);
            let base = measure.follow(1)?;
            return Ok(measure.number(0)? * self.unit(&base, depth + 1)?);
        }
        let first = record.first(self.file);
        Err(first.error(StepProblem::Unit { name: record.kind().to_owned() }))
    }
}
