//! What a part file shows about its unit and its up axis, and what is decided from it.
//!
//! The file's word counts first; it is held against the sizes products have and against what its producer is known to
//! do. Every decision comes with its reason, and with a notice: a note where it is certain, a warning where it is a
//! guess or goes against the file's own standard.

use nalgebra::{Point3, Vector3};

use crate::reason::Notice;

use super::{Decision, LengthUnit, MeshFormat, MeshOptions, UpAxis};

/// A part with a longer diagonal in metres than this is taken to be in mm, m.
const LONGEST_IN_METRES: f64 = 5.0;
/// A part with a shorter diagonal in mm than this is taken to be in metres, mm.
const SHORTEST_IN_MM: f64 = 2.0;
/// Longest sides that products on a marking table have, mm.
const PLAUSIBLE_SIZE: std::ops::RangeInclusive<f64> = 1.0..=2000.0;
/// From this length on, build123d's unit option is worth a word, mm: ten times the size of a usual product.
const WORTH_A_LOOK: f64 = 500.0;

/// What the file shows beside its numbers.
#[derive(Debug, Clone)]
pub(super) struct Clues {
    pub(super) format: MeshFormat,
    /// glTF: the generator; STL: its header; others: the first comment.
    pub(super) producer: Option<String>,
    /// A unit that the file's comments name.
    pub(super) stated_unit: Option<LengthUnit>,
    pub(super) root_turn: RootTurn,
    pub(super) zeros: NormalZeros,
}

/// The turn that all roots of a glTF scene share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RootTurn {
    /// +90° about X: what Blender's OBJ import leaves on an object. +Y goes to +Z.
    UpToFront,
    /// -90° about X: how build123d and CadQuery stand a Z-up part upright. +Z goes to +Y.
    FrontToUp,
    /// No turn, another one, or several.
    Other,
}

/// Signs of the zeros in an OpenCASCADE file's normals.
///
/// Reversing a face's normal (0, 0, 1) leaves (-0, -0, -1) in the file. Where the writer converts axes, it multiplies
/// by a matrix, and 0 · x + 0 · y + 1 · z + 0 · 0 is never -0 (OpenCASCADE, `RWMesh_CoordinateSystemConverter`). So a
/// negative zero shows that the axes were not converted and Z is still up, and a clean normal (0, -1, 0) of a face
/// below speaks for a conversion.
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

/// Unit and axis with their reasons, and what is to be said about them.
pub(super) struct Verdict {
    pub(super) unit: Decision<LengthUnit>,
    pub(super) up: Decision<UpAxis>,
    pub(super) notices: Vec<Notice>,
}

/// How much a decision rests on.
#[derive(Clone, Copy, PartialEq)]
enum Footing {
    /// A person said so.
    Settings,
    /// The file's standard, or its producer's known habit.
    Certain,
    /// A guess, or against the file's own standard.
    Guess,
}

impl Clues {
    pub(super) fn new(format: MeshFormat, producer: Option<String>) -> Self {
        let zeros = NormalZeros::default();
        Self { format, producer, stated_unit: None, root_turn: RootTurn::Other, zeros }
    }

    pub(super) fn is_open_cascade(&self) -> bool {
        self.producer_says("Open CASCADE")
    }

    pub(super) fn is_arch_export(&self) -> bool {
        self.producer_says("FreeCAD") && self.producer_says("Arch")
    }

    fn producer_says(&self, word: &str) -> bool {
        self.producer.as_ref().is_some_and(|producer| producer.contains(word))
    }

    /// Decides about a part whose triangles have these corners, in the file's numbers.
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
            format!("the file's numbers are taken as {} because {}", unit.value, unit.why),
            "`--part-unit` says otherwise if this is wrong",
        ));
        notices.extend(notice(
            "axis-assumed",
            up_footing,
            format!(
                "the file's +{} axis is taken as up because {}",
                up.value.to_string().to_uppercase(),
                up.why
            ),
            "`--part-up` says otherwise if the part lies on its side",
        ));
        let longest = corners.size.max() * unit.value.in_mm();
        if !PLAUSIBLE_SIZE.contains(&longest) {
            let message = format!(
                "the part's longest side is {longest:.3} mm; products on a marking table have {} to {} mm, so the unit \
                 may be wrong (`--part-unit`)",
                PLAUSIBLE_SIZE.start(),
                PLAUSIBLE_SIZE.end()
            );
            notices.push(Notice::warning("size-implausible", message));
        } else if self.may_be_build123d() && longest > WORTH_A_LOOK && unit_footing != Footing::Settings {
            let message = format!(
                "the part's longest side is {longest:.1} mm; if that is ten times too long, it was exported by build123d \
                 with its unit set to CM: export it again with unit MM, or set the part's unit to dm"
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
            format!(
                "a part with a diagonal of {diagonal:.0} m is implausible and one of {diagonal:.0} mm is usual; Blender \
                 writes a scene in mm, or an OBJ imported in mm, this way"
            )
        };
        if matches!(self.format, MeshFormat::Gltf | MeshFormat::Glb) {
            return match diagonal > LONGEST_IN_METRES {
                true => (Decision::new(Millimetre, too_long()), Footing::Guess),
                false => (Decision::new(Metre, "glTF numbers are metres by its standard"), Footing::Certain),
            };
        }
        if let Some(unit) = self.stated_unit {
            return (Decision::new(unit, "a comment at the file's head says so"), Footing::Certain);
        }
        if self.producer_says("FreeCAD") {
            return (Decision::new(Millimetre, "FreeCAD writes OBJ in mm"), Footing::Certain);
        }
        if self.producer_says("Blender") && self.format == MeshFormat::Obj {
            return match diagonal > LONGEST_IN_METRES {
                true => (Decision::new(Millimetre, too_long()), Footing::Guess),
                false => (Decision::new(Metre, "Blender writes OBJ in metres by default"), Footing::Certain),
            };
        }
        let format = self.format;
        let decision = match diagonal < SHORTEST_IN_MM {
            true => {
                let why = format!(
                    "{format} has no unit, and a part with a diagonal of {diagonal:.3} mm is implausible while one of \
                     {diagonal:.3} m is usual"
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
            MeshFormat::Stl | MeshFormat::Ply | MeshFormat::Xyz => {
                let why = format!("{} has no up axis, and {} write Z up", self.format, self.writers());
                (Decision::new(UpAxis::Z, why), Footing::Guess)
            }
        }
    }

    /// The programs that mostly write the format.
    fn writers(&self) -> &'static str {
        match self.format {
            MeshFormat::Ply | MeshFormat::Xyz => "scanners",
            _ => "CAD programs",
        }
    }

    fn up_of_gltf(&self, in_millimetres: bool) -> (Decision<UpAxis>, Footing) {
        if self.producer_says("Blender") && in_millimetres && self.root_turn == RootTurn::UpToFront {
            let why = "the numbers are mm and every object is turned by 90° about X, as Blender leaves an OBJ in mm with \
                       Z up when it is imported with Y up; glTF itself would have Y up";
            return (Decision::new(UpAxis::Z, why), Footing::Guess);
        }
        if !self.is_open_cascade() {
            // Blender turns the axes whatever the unit; others that leave the unit may leave the axes as well.
            return if in_millimetres && !self.producer_says("Blender") {
                let why = "glTF has Y up by its standard; but as its numbers are no metres, the program may have kept \
                           another axis as well";
                (Decision::new(UpAxis::Y, why), Footing::Guess)
            } else {
                (Decision::new(UpAxis::Y, "glTF has Y up by its standard"), Footing::Certain)
            };
        }
        if self.root_turn == RootTurn::FrontToUp {
            let why = "glTF has Y up by its standard, and the root is turned accordingly";
            return (Decision::new(UpAxis::Y, why), Footing::Certain);
        }
        if self.zeros.negative > 0 {
            let why = "OpenCASCADE wrote it without converting axes (its normals still have negative zeros), so Z is up \
                       as in CAD; glTF itself would have Y up";
            return (Decision::new(UpAxis::Z, why), Footing::Guess);
        }
        if self.zeros.clean_backward > 0 {
            let why = "glTF has Y up by its standard, and OpenCASCADE converted the axes (its normals have no negative \
                       zeros)";
            return (Decision::new(UpAxis::Y, why), Footing::Certain);
        }
        let why = "glTF has Y up by its standard; OpenCASCADE programs that do not convert axes write Z up, and this file \
                   does not show which it is";
        (Decision::new(UpAxis::Y, why), Footing::Guess)
    }

    fn up_of_obj(&self, corners: &Corners, in_millimetres: bool) -> (Decision<UpAxis>, Footing) {
        if self.producer_says("FreeCAD") {
            return (Decision::new(UpAxis::Z, "FreeCAD writes OBJ with Z up"), Footing::Certain);
        }
        if !self.producer_says("Blender") {
            let why = "OBJ has no up axis, and CAD programs write Z up";
            return (Decision::new(UpAxis::Z, why), Footing::Guess);
        }
        if !in_millimetres {
            return (Decision::new(UpAxis::Y, "Blender writes OBJ with Y up by default"), Footing::Certain);
        }
        // Blender with mm: either a scene in mm (Y up), or a part in mm with Z up that only passed through, or an export
        // with Z chosen as up. The turn there and back leaves rounding in y and z only.
        let decision = if corners.has_dust_of_a_turn_about_x() {
            let why = "the numbers are mm, and rounding in y and z shows that Blender turned the part by 90° about X and \
                       back: an OBJ with Z up passed through";
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

/// The unit that a comment states, as in `units: mm`.
pub(super) fn stated_unit(comment: &str) -> Option<LengthUnit> {
    let mut words = comment.split(|letter: char| !letter.is_ascii_alphabetic()).map(str::to_ascii_lowercase);
    words
        .any(|word| word == "unit" || word == "units")
        .then(|| words.find_map(|word| unit_word(&word)))
        .flatten()
}

/// The unit that a word stands for.
pub(super) fn unit_word(word: &str) -> Option<LengthUnit> {
    match word {
        "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => Some(LengthUnit::Millimetre),
        "cm" | "centimeter" | "centimeters" | "centimetre" | "centimetres" => Some(LengthUnit::Centimetre),
        "m" | "meter" | "meters" | "metre" | "metres" => Some(LengthUnit::Metre),
        // Not "in", which stands before the unit in most sentences.
        "inch" | "inches" => Some(LengthUnit::Inch),
        _ => None,
    }
}

fn notice(code: &str, footing: Footing, message: String, otherwise: &str) -> Option<Notice> {
    match footing {
        Footing::Settings => None,
        Footing::Certain => Some(Notice::note(code, message)),
        Footing::Guess => Some(Notice::warning(code, format!("{message}; {otherwise}"))),
    }
}

/// The corners of a part's triangles as numbers of the file, summed up.
pub(super) struct Corners {
    min: Vector3<f64>,
    size: Vector3<f64>,
    /// For each axis, how many coordinates are as small as what a turn in single precision leaves of zero.
    dust: [usize; 3],
}

impl Corners {
    pub(super) fn of(positions: &[Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        let mut corners =
            Self::of_points(triangles.iter().flatten().map(|&index| &positions[index as usize]));
        // cos 90° is 4.4e-8 in single precision; OBJ files then have six decimals.
        let largest_dust = corners.size.norm() * 2e-7;
        let is_dust = |value: f64| value != 0.0 && value.abs() <= largest_dust;
        corners.dust =
            [0, 1, 2].map(|axis| positions.iter().filter(|position| is_dust(position[axis])).count());
        corners
    }

    /// The same of points without triangles.
    pub(super) fn of_points<'a>(points: impl IntoIterator<Item = &'a Point3<f64>>) -> Self {
        let mut min = Vector3::repeat(f64::INFINITY);
        let mut max = Vector3::repeat(f64::NEG_INFINITY);
        for point in points {
            min = min.inf(&point.coords);
            max = max.sup(&point.coords);
        }
        Self { min, size: max - min, dust: [0; 3] }
    }

    fn stands_on(&self, axis: usize) -> bool {
        self.min[axis].abs() <= 0.01 * self.size[axis]
    }

    fn has_dust_of_a_turn_about_x(&self) -> bool {
        self.dust[0] == 0 && self.dust[1] + self.dust[2] > 0
    }
}

#[cfg(test)]
mod tests;
