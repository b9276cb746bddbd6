//! Decides the unit and the up axis of a part file from the clues in it.
//!
//! What the file states comes first; it is checked against the usual sizes of products and the known behaviour of the
//! file's producer. Every decision has a reason and a notice: a note if it is certain, a warning if it is a guess or
//! contradicts the standard of the format.

use nalgebra::{Point3, Vector3};

use crate::reason::Notice;

use super::root_pose::RootPose;
use super::{Decision, LengthUnit, MeshFormat, MeshOptions, UpAxis};

/// Longest plausible diagonal of a part in metres; a part with longer ones is assumed to be in mm.
const LONGEST_IN_METRES: f64 = 5.0;
/// Shortest plausible diagonal of a part in mm; a part with shorter ones is assumed to be in metres.
const SHORTEST_IN_MM: f64 = 2.0;
/// Plausible longest sides of products on a marking table, mm.
const PLAUSIBLE_SIZE: std::ops::RangeInclusive<f64> = 1.0..=2000.0;
/// Length above which a notice mentions build123d's unit option, mm: ten times the size of a usual product.
const WORTH_A_LOOK: f64 = 500.0;

/// What isomark's own workbench calls itself, which converts parts of any size to metres (`plugins/freecad`).
const FREECAD_WORKBENCH: &str = "isomark workbench for FreeCAD";

/// What the file contains besides its coordinates.
#[derive(Debug, Clone)]
pub(super) struct Clues {
    pub(super) format: MeshFormat,
    /// glTF: the generator; STL: its header; others: the first comment.
    pub(super) producer: Option<String>,
    /// The unit that the file's comments state.
    pub(super) stated_unit: Option<LengthUnit>,
    /// The unit that the file states instead, if it is none that parts can have; the numbers are converted.
    pub(super) converted: Option<String>,
    pub(super) root_turn: RootTurn,
    /// The pose of the one node that all of an OpenCASCADE file hangs on.
    pub(super) root_pose: Option<RootPose>,
    pub(super) zeros: NormalZeros,
}

/// The rotation that all root nodes of a glTF scene have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RootTurn {
    /// +90° about X, from +Y to +Z: Blender's OBJ import leaves it on an object.
    UpToFront,
    /// -90° about X, from +Z to +Y: build123d and CadQuery set a Z-up part upright with it.
    FrontToUp,
    /// No rotation, another one, or different ones.
    Other,
}

/// Counts of signed zeros in an OpenCASCADE file's normals.
///
/// Reversing a face's normal (0, 0, 1) leaves (-0, -0, -1) in the file. If the writer converts the axes, it multiplies
/// by a matrix, and 0 · x + 0 · y + 1 · z + 0 · 0 is never -0 (OpenCASCADE, `RWMesh_CoordinateSystemConverter`). So a
/// negative zero shows that the axes were not converted and Z is still up, and a normal (0, -1, 0) without negative
/// zeros, of a bottom face, indicates a conversion.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct NormalZeros {
    negative: usize,
    clean_backward: usize,
}

impl NormalZeros {
    pub(super) fn count(&mut self, normal: [f32; 3]) {
        let is_negative_zero = |value: &f32| value.to_bits() == (-0.0f32).to_bits();
        let is_clean_zero = |value: &&f32| value.to_bits() == 0;
        self.negative += normal.iter().filter(|value| is_negative_zero(value)).count();
        let is_backward = normal.iter().any(|&value| value < -0.999);
        self.clean_backward += usize::from(is_backward && normal.iter().filter(is_clean_zero).count() == 2);
    }
}

/// Unit and axis with their reasons, and the notices about them.
pub(super) struct Verdict {
    pub(super) unit: Decision<LengthUnit>,
    pub(super) up: Decision<UpAxis>,
    pub(super) notices: Vec<Notice>,
}

/// What a decision is based on.
#[derive(Clone, Copy, PartialEq)]
enum Footing {
    /// The settings.
    Settings,
    /// The standard of the format, or the known behaviour of the producer.
    Certain,
    /// A guess, or a contradiction of the format's standard.
    Guess,
}

impl Clues {
    pub(super) fn new(format: MeshFormat, producer: Option<String>) -> Self {
        let zeros = NormalZeros::default();
        let root_turn = RootTurn::Other;
        Self { format, producer, stated_unit: None, converted: None, root_turn, root_pose: None, zeros }
    }

    pub(super) fn is_open_cascade(&self) -> bool {
        self.producer_contains("Open CASCADE")
    }

    /// Whether the program knows the exact faces of the part, and shades those that are round smooth.
    pub(super) fn knows_faces(&self) -> bool {
        self.is_open_cascade() || self.producer_contains("FreeCAD")
    }

    pub(super) fn is_arch_export(&self) -> bool {
        self.producer_contains("FreeCAD") && self.producer_contains("Arch")
    }

    /// trimesh writes a part with the axes that it was read with, and the scale that its user chose.
    fn is_trimesh(&self) -> bool {
        self.producer_contains("trimesh")
    }

    fn producer_contains(&self, word: &str) -> bool {
        self.producer.as_ref().is_some_and(|producer| producer.contains(word))
    }

    /// Decides unit and axis of a part whose triangles have these corners, in the file's numbers.
    pub(super) fn judge(&self, corners: &Corners, options: &MeshOptions) -> Verdict {
        let diagonal = corners.size.norm();
        let (unit, unit_footing) = match options.unit {
            Some(unit) => (Decision::by_settings(unit), Footing::Settings),
            None => self.unit(diagonal),
        };
        let in_millimetres = unit.value == LengthUnit::Millimetre && diagonal > LONGEST_IN_METRES;
        let (up, up_footing) = match options.up {
            Some(up) => (Decision::by_settings(up), Footing::Settings),
            None => self.up(corners, in_millimetres),
        };
        let mut notices = Vec::new();
        notices.extend(notice(
            "unit-assumed",
            unit_footing,
            format!("the file's numbers are read as {} because {}", unit.value, unit.why),
            "if this is wrong, set `--part-unit`",
        ));
        notices.extend(notice(
            "axis-assumed",
            up_footing,
            format!(
                "the file's +{} axis is taken as up because {}",
                up.value.to_string().to_uppercase(),
                up.why
            ),
            "if the part then lies on its side, set `--part-up`",
        ));
        let longest = corners.size.max() * unit.value.in_mm();
        if !PLAUSIBLE_SIZE.contains(&longest) {
            let message = format!(
                "the part's longest side is {longest:.3} mm; products on a marking table measure {} to {} mm, so the \
                 unit may be wrong (`--part-unit`)",
                PLAUSIBLE_SIZE.start(),
                PLAUSIBLE_SIZE.end()
            );
            notices.push(Notice::warning("size-implausible", message));
        } else if self.may_be_build123d() && longest > WORTH_A_LOOK && unit_footing != Footing::Settings {
            let message = format!(
                "the part's longest side is {longest:.1} mm; if this is ten times too long, build123d exported it with \
                 its unit set to CM: export it again with unit MM, or set the part's unit to dm"
            );
            notices.push(Notice::note("size-unconfirmed", message));
        }
        Verdict { unit, up, notices }
    }

    fn may_be_build123d(&self) -> bool {
        self.is_open_cascade() && self.root_turn == RootTurn::FrontToUp
    }

    fn unit(&self, diagonal: f64) -> (Decision<LengthUnit>, Footing) {
        use LengthUnit::{Metre, Millimetre};
        let too_long = || {
            let who = match self.is_open_cascade() {
                true => "CadQuery and programs that state no unit to OpenCASCADE write such numbers",
                false => "Blender writes such numbers for a scene in mm, or for an OBJ imported in mm",
            };
            format!("a diagonal of {diagonal:.0} m is implausible and {diagonal:.0} mm is usual; {who}")
        };
        if matches!(self.format, MeshFormat::Gltf | MeshFormat::Glb) {
            if self.producer_contains(FREECAD_WORKBENCH) {
                return (
                    Decision::new(Metre, "isomark's workbench for FreeCAD writes metres"),
                    Footing::Certain,
                );
            }
            return match diagonal > LONGEST_IN_METRES {
                true => (Decision::new(Millimetre, too_long()), Footing::Guess),
                false => (Decision::new(Metre, "the glTF standard uses metres"), Footing::Certain),
            };
        }
        if let (Some(unit), Some(stated)) = (self.stated_unit, &self.converted) {
            let why = format!("the {} file states {stated}, and its numbers are converted", self.format);
            return (Decision::new(unit, why), Footing::Certain);
        }
        if let Some(unit) = self.stated_unit.filter(|_| self.format == MeshFormat::ThreeMf) {
            return (Decision::new(unit, "the 3MF file states it"), Footing::Certain);
        }
        if let Some(unit) = self.stated_unit.filter(|_| self.format == MeshFormat::Step) {
            return (Decision::new(unit, "the STEP file states it"), Footing::Certain);
        }
        if let Some(unit) = self.stated_unit {
            return (Decision::new(unit, "a comment in the file's header states it"), Footing::Certain);
        }
        if self.producer_contains("FreeCAD") {
            return (Decision::new(Millimetre, "FreeCAD writes OBJ in mm"), Footing::Certain);
        }
        if self.producer_contains("Blender") && self.format == MeshFormat::Obj {
            return match diagonal > LONGEST_IN_METRES {
                true => (Decision::new(Millimetre, too_long()), Footing::Guess),
                false => (Decision::new(Metre, "Blender writes OBJ in metres by default"), Footing::Certain),
            };
        }
        let format = self.format;
        let decision = match diagonal < SHORTEST_IN_MM {
            true => {
                let why = format!(
                    "{format} has no unit, and a diagonal of {diagonal:.3} mm is implausible while {diagonal:.3} m is \
                     usual"
                );
                Decision::new(Metre, why)
            }
            false => {
                Decision::new(Millimetre, format!("{format} has no unit, and {} write mm", self.writers()))
            }
        };
        (decision, Footing::Guess)
    }

    fn up(&self, corners: &Corners, in_millimetres: bool) -> (Decision<UpAxis>, Footing) {
        match self.format {
            MeshFormat::Gltf | MeshFormat::Glb => self.up_of_gltf(in_millimetres),
            MeshFormat::Obj => self.up_of_obj(corners, in_millimetres),
            MeshFormat::ThreeMf => (Decision::new(UpAxis::Z, "the 3MF standard has Z up"), Footing::Certain),
            MeshFormat::Step => {
                (Decision::new(UpAxis::Z, "CAD programs write STEP with Z up"), Footing::Certain)
            }
            MeshFormat::Stl | MeshFormat::Ply | MeshFormat::Xyz => {
                let why = format!("{} has no up axis, and {} write Z up", self.format, self.writers());
                (Decision::new(UpAxis::Z, why), Footing::Guess)
            }
        }
    }

    /// The programs that usually write the format.
    fn writers(&self) -> &'static str {
        match self.format {
            MeshFormat::Ply | MeshFormat::Xyz => "scanners",
            _ => "CAD programs",
        }
    }

    fn up_of_gltf(&self, in_millimetres: bool) -> (Decision<UpAxis>, Footing) {
        if self.producer_contains("Blender") && in_millimetres && self.root_turn == RootTurn::UpToFront {
            let why = "the numbers are mm and every object is rotated by 90° about X, as when Blender imports an OBJ \
                       in mm with Z up as if Y were up; the glTF standard has Y up";
            return (Decision::new(UpAxis::Z, why), Footing::Guess);
        }
        if !self.is_open_cascade() {
            if self.is_trimesh() {
                let why = "the glTF standard has Y up; but trimesh keeps the axes of the part that it was given, such as \
                           Z up of an STL or a STEP file, and nothing in this file shows which they are";
                return (Decision::new(UpAxis::Y, why), Footing::Guess);
            }
            // Blender always converts the axes; other programs that do not convert the unit may not convert the axes.
            return if in_millimetres && !self.producer_contains("Blender") {
                let why = "the glTF standard has Y up; but as the numbers are not metres, the program may have kept \
                           another axis as well";
                (Decision::new(UpAxis::Y, why), Footing::Guess)
            } else {
                (Decision::new(UpAxis::Y, "the glTF standard has Y up"), Footing::Certain)
            };
        }
        if self.root_turn == RootTurn::FrontToUp {
            let why = "the glTF standard has Y up, and the root node is rotated accordingly";
            return (Decision::new(UpAxis::Y, why), Footing::Certain);
        }
        if self.is_turned_with_location() {
            let why = "the root node is rotated as CadQuery and build123d do with a part that has a rotation of its own, \
                       and the part is put back to where CAD has it; the glTF standard has Y up, and shows such a part \
                       tilted";
            return (Decision::new(UpAxis::Y, why), Footing::Guess);
        }
        if self.zeros.negative > 0 {
            let why = "OpenCASCADE wrote it without converting the axes (its normals still have negative zeros, and no \
                       node sets the part upright), so Z is up as in CAD; the glTF standard has Y up";
            return (Decision::new(UpAxis::Z, why), Footing::Guess);
        }
        if self.zeros.clean_backward > 0 {
            let why = "the glTF standard has Y up, and OpenCASCADE converted the axes";
            return (Decision::new(UpAxis::Y, why), Footing::Certain);
        }
        let why = "the glTF standard has Y up; OpenCASCADE programs that do not convert the axes write Z up, and \
                   nothing in this file shows which is the case";
        (Decision::new(UpAxis::Y, why), Footing::Guess)
    }

    /// The pose that spoils the location of the part, if the part is read with this axis up.
    pub(super) fn misplaced(&self, up: UpAxis) -> Option<RootPose> {
        let pose = self.root_pose.filter(|_| up == UpAxis::Y)?;
        let is_moved = pose.sets_upright() && pose.is_moved() && !self.is_converted();
        (is_moved || self.is_turned_with_location()).then_some(pose)
    }

    /// Whether the normals show that OpenCASCADE converted the vertices, so that nodes are rotated as in CAD only.
    fn is_converted(&self) -> bool {
        self.zeros.negative == 0 && self.zeros.clean_backward > 0
    }

    /// Whether the root node has the rotation of the part's own location besides that from +Z to +Y.
    fn is_turned_with_location(&self) -> bool {
        let Some(pose) = self.root_pose.filter(|pose| !pose.sets_upright() && !pose.keeps_z()) else {
            return false;
        };
        self.zeros.negative > 0 || !self.is_converted() && pose.sets_a_turned_part_upright()
    }

    fn up_of_obj(&self, corners: &Corners, in_millimetres: bool) -> (Decision<UpAxis>, Footing) {
        if self.producer_contains("FreeCAD") {
            return (Decision::new(UpAxis::Z, "FreeCAD writes OBJ with Z up"), Footing::Certain);
        }
        if !self.producer_contains("Blender") {
            let why = "OBJ has no up axis, and CAD programs write Z up";
            return (Decision::new(UpAxis::Z, why), Footing::Guess);
        }
        if !in_millimetres {
            return (Decision::new(UpAxis::Y, "Blender writes OBJ with Y up by default"), Footing::Certain);
        }
        // Blender with mm: a scene in mm (Y up), or an imported part in mm with Z up, or an export with Z chosen as up.
        // The rotation at import and back at export leaves rounding errors in y and z only.
        let decision = if corners.is_turned_back {
            let why = "the numbers are mm, and rounding errors in y and z show that Blender rotated the part by 90° \
                       about X and back: it imported an OBJ with Z up";
            Decision::new(UpAxis::Z, why)
        } else if corners.stands_on(2) && !corners.stands_on(1) {
            let why = "the numbers are mm, and the part stands on the plane z = 0 but not on y = 0";
            Decision::new(UpAxis::Z, why)
        } else {
            Decision::new(UpAxis::Y, "Blender writes OBJ with Y up by default")
        };
        (decision, Footing::Guess)
    }
}

/// The unit that a comment states: as in `units: mm`, or right after the word, as in `units mm`.
pub(super) fn stated_unit(comment: &str) -> Option<LengthUnit> {
    after_unit(comment).find_map(|(is_assigned, words)| {
        let links_at_most = words.len().checked_sub(1)?;
        let links = words[..links_at_most].iter().take_while(|word| LINKS.contains(&word.as_str())).count();
        let word = words.get(links)?;
        // A single letter after the word may be a name, as in "unit M".
        unit_word(word)
            .filter(|_| is_assigned || links > 0 || word.len() > 1)
            .or_else(|| (is_assigned && is_inch(word) && words.len() == 1).then_some(LengthUnit::Inch))
    })
}

/// The unit that a name states, which it only does as in `units: mm` or `UNIT=mm`.
pub(super) fn stated_unit_in_name(name: &str) -> Option<LengthUnit> {
    after_unit(name).filter(|(is_assigned, _)| *is_assigned).find_map(|(_, words)| unit_word(words.first()?))
}

/// Words between `unit` and the unit, as in `units are mm`.
const LINKS: [&str; 3] = ["in", "is", "are"];
/// Largest number of words that are examined after `unit`.
const WORDS_AFTER_UNIT: usize = 3;

/// For each word `unit` or `units`, whether a sign of assignment follows it, and the words after it, in lower case; a number is a
/// word, too.
fn after_unit(text: &str) -> impl Iterator<Item = (bool, Vec<String>)> {
    let text = text.to_ascii_lowercase();
    let places: Vec<usize> = text.match_indices("unit").map(|(at, _)| at).collect();
    places.into_iter().filter_map(move |at| {
        if text[..at].ends_with(|letter: char| letter.is_alphanumeric()) {
            return None;
        }
        let rest = &text[at + "unit".len()..];
        let rest = rest.strip_prefix('s').unwrap_or(rest);
        if rest.starts_with(|letter: char| letter.is_alphanumeric()) {
            return None;
        }
        let rest = rest.trim_start_matches([' ', '\t', '"', '\'']);
        let is_assigned = rest.starts_with([':', '=', '(', '[']);
        let words = rest.split(|letter: char| !letter.is_alphanumeric()).filter(|word| !word.is_empty());
        Some((is_assigned, words.take(WORDS_AFTER_UNIT).map(str::to_owned).collect()))
    })
}

/// Whether a word that can only be a unit means inches; elsewhere it is usually the preposition, as in "units in mm".
pub(super) fn is_inch(word: &str) -> bool {
    word == "in"
}

/// The unit that a word names.
pub(super) fn unit_word(word: &str) -> Option<LengthUnit> {
    match word {
        "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => Some(LengthUnit::Millimetre),
        "cm" | "centimeter" | "centimeters" | "centimetre" | "centimetres" => Some(LengthUnit::Centimetre),
        "m" | "meter" | "meters" | "metre" | "metres" => Some(LengthUnit::Metre),
        // For "in" see `is_inch`.
        "inch" | "inches" => Some(LengthUnit::Inch),
        _ => None,
    }
}

fn notice(code: &str, footing: Footing, message: String, remedy: &str) -> Option<Notice> {
    match footing {
        Footing::Settings => None,
        Footing::Certain => Some(Notice::note(code, message)),
        Footing::Guess => Some(Notice::warning(code, format!("{message}; {remedy}"))),
    }
}

/// The extents of a part's triangles in the file's numbers.
pub(super) struct Corners {
    min: Vector3<f64>,
    size: Vector3<f64>,
    /// Whether y and z have the rounding errors that Blender leaves when it rotates a part by 90° about X and back.
    is_turned_back: bool,
}

impl Corners {
    pub(super) fn of(positions: &[Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        let mut corners =
            Self::of_points(triangles.iter().flatten().map(|&index| &positions[index as usize]));
        corners.is_turned_back = is_turned_back(positions, corners.size.norm() * LARGEST_DUST);
        corners
    }

    /// The extents of points without triangles.
    pub(super) fn of_points<'a>(points: impl IntoIterator<Item = &'a Point3<f64>>) -> Self {
        let mut min = Vector3::repeat(f64::INFINITY);
        let mut max = Vector3::repeat(f64::NEG_INFINITY);
        for point in points {
            min = min.inf(&point.coords);
            max = max.sup(&point.coords);
        }
        Self { min, size: max - min, is_turned_back: false }
    }

    fn stands_on(&self, axis: usize) -> bool {
        self.min[axis].abs() <= 0.01 * self.size[axis]
    }
}

/// Rounding errors are at most this share of the size of the part.
const LARGEST_DUST: f64 = 2e-7;
/// What Blender's rotation by 90° and back adds to y for each unit of z, and takes from z for each unit of y, measured in Blender 4.5:
/// nearly twice the cosine of 90° in single precision.
const OF_A_TURN: f64 = 7.9e-8;
/// OBJ files of Blender have six decimals.
const DECIMALS: f64 = 1e-6;

/// Whether the coordinates that would be zero are what this rotation leaves of them. Rounding errors that a modifier leaves, as at the
/// middle of a subdivided part, are in any axis and do not grow with the other coordinate.
fn is_turned_back(positions: &[Point3<f64>], largest_dust: f64) -> bool {
    let is_dust = |value: f64| value != 0.0 && value.abs() <= largest_dust;
    if positions.iter().any(|position| is_dust(position.x)) {
        return false;
    }
    let pairs = positions.iter().flat_map(|position| [(position.y, position.z), (position.z, -position.y)]);
    let (mut left, mut otherwise) = (0, 0);
    for (value, other) in pairs.filter(|(value, _)| value.abs() <= largest_dust) {
        let turned = OF_A_TURN * other;
        let is_near = (value - turned).abs() <= 0.6 * DECIMALS + 0.5 * turned.abs();
        let is_missing = value == 0.0 && turned.abs() >= 0.75 * DECIMALS;
        left += usize::from(is_near && value != 0.0);
        otherwise += usize::from(!is_near || is_missing);
    }
    left > 10 * otherwise
}

#[cfg(test)]
mod tests;
