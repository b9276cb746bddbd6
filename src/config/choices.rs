//! The closed choices of the settings, with the names people write; the command line uses the same names.

use std::str::FromStr;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::suggest::{listed, nearest};
use crate::formats::pattern::Strokes;
use crate::geometry::space::Facing;
use crate::geometry::surface::scan;

/// A name that is not one of the choices.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct UnknownChoice {
    /// What was to be chosen, such as `method`.
    pub what: &'static str,
    /// The name that was given.
    pub given: String,
    /// The names that are known.
    pub allowed: &'static [&'static str],
}

impl std::fmt::Display for UnknownChoice {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "{} `{}` is not known; choose {}", self.what, self.given, listed(self.allowed))?;
        match nearest(&self.given, self.allowed) {
            Some(name) => write!(out, " (did you mean `{name}`?)"),
            None => Ok(()),
        }
    }
}

impl std::error::Error for UnknownChoice {}

/// Defines an enum whose variants have one name each, for the files, the command line and the reports alike.
macro_rules! choices {
    ($(#[$about:meta])* $kind:ident, $what:literal { $($(#[$meta:meta])* $variant:ident = $name:literal,)+ }) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
        #[non_exhaustive]
        pub enum $kind {
            $($(#[$meta])* #[serde(rename = $name)] $variant,)+
        }

        impl $kind {
            /// All choices, in the order they are explained.
            pub const ALL: &'static [Self] = &[$(Self::$variant),+];
            /// Their names.
            pub const NAMES: &'static [&'static str] = &[$($name),+];

            /// The name people write.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }
        }

        impl FromStr for $kind {
            type Err = UnknownChoice;
            fn from_str(text: &str) -> Result<Self, UnknownChoice> {
                match text {
                    $($name => Ok(Self::$variant),)+
                    _ => Err(UnknownChoice { what: $what, given: text.into(), allowed: Self::NAMES }),
                }
            }
        }

        impl std::fmt::Display for $kind {
            fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                out.write_str(self.name())
            }
        }
    };
}

choices! {
    /// What a drawing is divided into where it is higher than the depth of focus.
    FocusSteps, "focus.steps" {
        /// It is not divided.
        #[default] Off = "off",
        /// Layers, one set for each height of focus.
        Layers = "layers",
    }
}

choices! {
    /// How the drawing is bent.
    Method, "method" {
        /// The exact cylinder or cone where the part is one within the residual, otherwise `isometric`.
        #[default]
        Auto = "auto",
        /// Any free form: the map whose metric is nearest to the drawing's.
        Isometric = "isometric",
        /// Exact unrolling of a cylinder.
        Cylinder = "cylinder",
        /// Exact unrolling of a cone.
        Cone = "cone",
        /// The thesis' own method, to compare with.
        MappingDomain = "mapping-domain",
        /// The part mapped to a square by convex combinations, to compare with.
        Floater = "floater",
        /// Plain projection, to show what happens without a correction.
        None = "none",
    }
}

choices! {
    /// What the drawing's x follows at its anchor.
    Align, "align" {
        /// The view: it is horizontal as the laser sees it, or as a marking frame gives it.
        #[default]
        View = "view",
        /// The axis of a cylinder or cone: it runs along the direction round the axis.
        Axis = "axis",
    }
}

choices! {
    /// How the tiles of a mark round the part are written.
    TilesAs, "as" {
        /// One file, with the layers of each tile named after its angle.
        #[default]
        Layers = "layers",
        /// One file for each tile, named after its angle; only with `isomark correct`.
        Files = "files",
    }
}

choices! {
    /// What is done with ink outside the faces of a part that are named `mark`.
    OutsideMark, "outside_mark" {
        /// The drawing is rejected.
        #[default]
        Refuse = "refuse",
        /// It is marked, and the report warns.
        Warn = "warn",
    }
}

choices! {
    /// What is done when rows of a list cannot be marked.
    BadRows, "bad_rows" {
        /// The whole list is refused before anything is written.
        #[default]
        Refuse = "refuse",
        /// These rows are named and left out, and the others are marked.
        Skip = "skip",
    }
}

choices! {
    /// What is done with a local change of settings that the office released.
    LocalSettings, "local_settings" {
        /// The change is kept beside the file, and the release is used.
        #[default]
        Refuse = "refuse",
        /// The change is used.
        Allow = "allow",
    }
}

choices! {
    /// How `floater` weights a vertex's neighbours.
    FloaterWeights, "floater weights" {
        /// All equally, as in the thesis.
        #[default]
        Uniform = "uniform",
        /// Mean value coordinates, which follow the part's angles.
        MeanValue = "mean-value",
    }
}

choices! {
    /// A slip of the thesis' printed algorithms that `mapping-domain` may keep.
    Slip, "slip" {
        /// Simpson's weights swapped (A.10 line 6).
        #[default]
        SimpsonWeights = "simpson-weights",
        /// Lengths added up along diagonals (3.4 lines 18 to 29).
        DiagonalSums = "diagonal-sums",
        /// Knots that differ from row to row and move (A.8).
        KnotVectors = "knot-vectors",
    }
}

choices! {
    /// Where the shape of the part comes from.
    PartShape, "shape" {
        /// A mesh in a file.
        #[default]
        Mesh = "mesh",
        /// A cylinder given by its sizes.
        Cylinder = "cylinder",
        /// A cone given by its sizes.
        Cone = "cone",
    }
}

choices! {
    /// Where `isometric` keeps lengths first.
    Weighting, "weighting" {
        /// On the lines and areas that are marked.
        #[default]
        Ink = "ink",
        /// Evenly over the pattern's rectangle.
        Uniform = "uniform",
    }
}

choices! {
    /// What `isometric` keeps first where lengths, areas and angles cannot all be kept.
    Aim, "aim" {
        /// All three.
        #[default]
        Balanced = "balanced",
        /// The lengths of lines; outlines that nothing fills are lines.
        Lengths = "lengths",
        /// The sizes of inked areas, and of cells that lines enclose.
        Areas = "areas",
        /// The angles of the ink.
        Shapes = "shapes",
    }
}

choices! {
    /// What is done with a drawing that shows ink which cannot be read.
    Losses, "losses" {
        /// It is rejected, with a list of what cannot be read.
        #[default]
        Refuse = "refuse",
        /// The rest is marked, and the report warns.
        Warn = "warn",
    }
}

choices! {
    /// What is marked of the strokes in an SVG drawing.
    StrokesChoice, "strokes" {
        /// Their centre lines.
        #[default]
        Center = "center",
        /// The bands that they cover.
        Band = "band",
    }
}

impl StrokesChoice {
    /// The same for the reader of drawings.
    #[must_use]
    pub fn strokes(self) -> Strokes {
        match self {
            Self::Center => Strokes::Center,
            Self::Band => Strokes::Band,
        }
    }
}

choices! {
    /// Which points of the drawing are carried over.
    Vertices, "vertices" {
        /// As many as the chord tolerance needs, and no more.
        #[default]
        Adaptive = "adaptive",
        /// Exactly the drawing's own, to compare with other tools.
        Keep = "keep",
    }
}

choices! {
    /// How noise is removed from a scan.
    Smoothing, "smoothing" {
        /// As much as the points need.
        #[default]
        Auto = "auto",
        /// Waves shorter than a set length are removed.
        LowPass = "low-pass",
        /// Not at all.
        None = "none",
    }
}

choices! {
    /// What converts a STEP part with a face that is not read and that the laser sees.
    Converter, "converter" {
        /// Nothing: the part is rejected.
        #[default]
        None = "none",
        /// FreeCAD, where it is installed.
        FreeCad = "freecad",
    }
}

impl Smoothing {
    /// The smoothing with the wavelength of the low pass, mm; without one, that of the thesis.
    #[must_use]
    pub fn with_wavelength(self, wavelength: Option<f64>) -> scan::Smoothing {
        match self {
            Self::Auto => scan::Smoothing::Auto,
            Self::None => scan::Smoothing::None,
            Self::LowPass => scan::Smoothing::LowPass {
                wavelength: wavelength.unwrap_or(scan::Smoothing::THESIS_WAVELENGTH),
            },
        }
    }
}

/// Where the marking field has its zero.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub enum FieldOrigin {
    /// In the middle.
    #[default]
    Center,
    /// In the lower left corner.
    Corner,
    /// At this point, mm from the lower left corner.
    At([f64; 2]),
}

choices! {
    /// The version of the corrected DXF.
    DxfVersion, "DXF version" {
        /// LWPOLYLINE, read by all current programs.
        #[default]
        R2000 = "R2000",
        /// POLYLINE, for old importers.
        R12 = "R12",
        /// Every piece as a separate LINE, for importers that read nothing else.
        R12Lines = "R12-lines",
    }
}

choices! {
    /// How new files in the hot folder are noticed between two listings.
    Backend, "backend" {
        /// Native on local disks, by listing on network shares.
        #[default]
        Auto = "auto",
        /// By the operating system's events: at once, on local disks.
        Native = "native",
        /// By listing alone: for network shares, which send no events for files of other computers.
        Poll = "poll",
    }
}

choices! {
    /// How a corrected drawing reaches the marking software.
    DeliveryKind, "delivery" {
        /// It is put into the import folder.
        #[default]
        Folder = "folder",
        /// It is put there, and BeamServer imports it.
        Beamserver = "beamserver",
    }
}

choices! {
    /// What is done with a drawing that was delivered before, from the same part and settings.
    Repeat, "repeat" {
        /// It is not delivered again, even if the importer removed the result.
        Never = "never",
        /// It is delivered again if the result is no longer in the import folder.
        #[default]
        IfGone = "if-gone",
        /// It is delivered again, and replaces the result that is there.
        Always = "always",
    }
}

choices! {
    /// What is done with delivered drawings whose part or settings changed.
    Outdated, "outdated" {
        /// They are listed in the status.
        #[default]
        Mark = "mark",
        /// They are corrected again from the archive and delivered.
        Correct = "correct",
    }
}

const AXES: &[&str] = &["x", "-x", "y", "-y", "X,Y,Z"];
const FACINGS: &[&str] = &["+z", "-z", "+x", "-x", "+y", "-y", "X,Y,Z"];

/// The side of the part that faces the laser, from `+z`, `-x` … or a direction `X,Y,Z` in the part frame.
///
/// # Errors
/// When the text is neither, or the direction has no length.
pub fn parse_facing(text: &str) -> Result<Facing, UnknownChoice> {
    let direction = match text.trim() {
        "+z" | "z" => Vector3::z(),
        "-z" => -Vector3::z(),
        "+x" | "x" => Vector3::x(),
        "-x" => -Vector3::x(),
        "+y" | "y" => Vector3::y(),
        "-y" => -Vector3::y(),
        other => numbers(other).unwrap_or([0.0; 3]).into(),
    };
    Facing::towards(direction).ok_or(UnknownChoice { what: "facing", given: text.into(), allowed: FACINGS })
}

/// As many numbers as are asked for, with commas between them.
pub(super) fn numbers<const COUNT: usize>(text: &str) -> Option<[f64; COUNT]> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

/// The direction of a cylinder's or cone's axis as the laser sees it, from `x`, `-y` … or `X,Y,Z`.
///
/// # Errors
/// When the text is neither, or the direction has no length.
pub fn parse_axis(text: &str) -> Result<Vector3<f64>, UnknownChoice> {
    let unknown = || UnknownChoice { what: "axis", given: text.into(), allowed: AXES };
    let direction = parse_facing(text).map_err(|_| unknown())?.direction();
    if direction.xy().norm() < 1e-3 { Err(unknown()) } else { Ok(direction) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_back_from_every_choice() {
        for name in Method::NAMES {
            assert_eq!(name.parse::<Method>().unwrap().to_string(), *name);
        }
        let error = "isometrc".parse::<Method>().unwrap_err();
        assert!(error.to_string().contains("did you mean `isometric`?"), "{error}");
    }

    #[test]
    fn a_facing_is_a_side_or_a_direction() {
        assert_eq!(parse_facing("-y").unwrap().direction(), -Vector3::y());
        assert_eq!(parse_facing("0, 0, 2").unwrap(), Facing::TOP);
        for wrong in ["", "up", "0,0,0", "1,2", "1,2,3,4", "1,,3", "nan,0,0"] {
            assert!(parse_facing(wrong).is_err(), "{wrong}");
        }
    }
}
