//! The settings of one job, besides its part and its pattern. Lengths in mm, angles in rad.

use super::choices::{
    Aim, Align, Converter, DxfVersion, FieldOrigin, FloaterWeights, Losses, Method, OutsideMark, Slip,
    StrokesChoice, TilesAs, Vertices, Weighting,
};
use super::content::ContentSettings;
use super::fill::{FillSettings, FocusSettings};
use crate::formats::Pace;
use crate::formats::mesh::{LengthUnit, MeshOptions, NormalsChoice, UpAxis};
use crate::formats::pattern::{DrawingUnit, PatternOptions, RasterOptions, Space};
use crate::formats::pattern::{is_among, is_same_layer};
use crate::geometry::mapping::mapping_domain::{AsPrinted, MappingDomainOptions};
use crate::geometry::optics::{Fixture, Lens, ScanHead};
use crate::geometry::primitive::Primitive;
use crate::geometry::sensitivity::PoseUncertainty;
use crate::geometry::space::{Extents, Facing, FieldPoint, FlatPoint, MarkingFrame, View, ViewPoint};
use crate::geometry::surface::scan::Smoothing;
use nalgebra::Vector2;

/// All settings of one job; [`Default`] is used without any file or option.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct JobSettings {
    /// How the part's file is read and seen.
    pub part: PartSettings,
    /// How the pattern's file is read.
    pub pattern: PatternSettings,
    /// Where the pattern lands on the part.
    pub placement: Placement,
    /// How the drawing is bent.
    pub correction: CorrectionSettings,
    /// How contours are filled with lines.
    pub fill: FillSettings,
    /// Content that differs from product to product.
    pub content: ContentSettings,
    /// How a drawing is divided by height.
    pub focus: FocusSettings,
    /// Marks that go round the part, in tiles.
    pub rotary: Rotary,
    /// Where the part is under the laser.
    pub fixture: Fixture,
    /// How well that position is known; all zero where the settings state nothing.
    pub pose_uncertainty: PoseUncertainty,
    /// The lens and its limits.
    pub optics: Optics,
    /// The marking software's working area; `None` leaves the drawing's size unchecked.
    pub field: Option<Field>,
    /// The corrected file.
    pub output: Output,
}

impl JobSettings {
    /// The scan head: its axis is where the settings place it, else in the middle of the field, else at the marking software's
    /// zero.
    #[must_use]
    pub fn scan_head(&self) -> ScanHead {
        let middle = self.field.map_or(Vector2::zeros(), |field| field.extents().center());
        ScanHead { lens: self.optics.lens, axis: self.optics.axis.unwrap_or(middle.into()) }
    }
}

/// How the part's file is read and from which side it is seen.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct PartSettings {
    /// The side of the part that faces the laser.
    pub facing: Facing,
    /// Turn of the view about the laser's axis, counter-clockwise, rad.
    pub roll: f64,
    /// What `facing` and `roll` come from, and so whether a marking frame in the part's file replaces them.
    pub view_source: ViewSource,
    /// Unit of the file's numbers; `None` uses what the format and the producer suggest.
    pub unit: Option<LengthUnit>,
    /// Axis of the file that points up; `None` uses what the format and the producer suggest.
    pub up: Option<UpAxis>,
    /// What the surface between the vertices of a mesh follows.
    pub normals: NormalsChoice,
    /// The widest gap that is bridged, mm: a hole in a mesh where triangles are missing, or a gap between the points of a scan;
    /// `None` bridges one or two missing triangles, and a few missing points.
    pub bridge: Option<f64>,
    /// How noise is taken out of a scan, and of a mesh that is as noisy as one.
    pub smoothing: Smoothing,
    /// What converts a STEP part with a face that is not read and that the laser sees.
    pub converter: Converter,
    /// The cylinder or cone that the part is, in the laser's view; `None` takes the part from a file.
    pub primitive: Option<Primitive>,
}

/// What a job's view of the part comes from.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub enum ViewSource {
    /// The station's settings for every part, or their defaults: a marking frame in the part's file replaces them.
    #[default]
    Station,
    /// `facing` that a person gave for this part.
    Sides,
    /// Only `roll` that a person gave for this part: it replaces a marking frame in the part's file, but names no side.
    Rolled,
    /// A marking frame of the settings.
    Frame(MarkingFrame),
    /// The marking frame in the part's file.
    FrameOfFile(MarkingFrame),
}

impl ViewSource {
    /// The marking frame, if the view comes from one.
    #[must_use]
    pub fn frame(&self) -> Option<&MarkingFrame> {
        match self {
            Self::Frame(frame) | Self::FrameOfFile(frame) => Some(frame),
            Self::Station | Self::Sides | Self::Rolled => None,
        }
    }
}

impl PartSettings {
    /// How the part's file is read with these settings, at this pace.
    #[must_use]
    pub fn mesh_options(&self, pace: Pace) -> MeshOptions {
        MeshOptions { unit: self.unit, up: self.up, normals: self.normals, bridge: self.bridge, pace }
    }

    /// These settings with the view of a marking frame of the settings.
    #[must_use]
    pub fn framed(&self, frame: MarkingFrame) -> Self {
        self.seen_by(&frame, ViewSource::Frame(frame))
    }

    /// These settings for a part whose file contains this marking frame: its view is used unless the settings for the part
    /// give another one.
    #[must_use]
    pub fn for_part_with(&self, of_file: Option<MarkingFrame>) -> Self {
        match of_file.filter(|_| self.leaves_view_to_file()) {
            Some(frame) => self.seen_by(&frame, ViewSource::FrameOfFile(frame)),
            None => self.clone(),
        }
    }

    /// The part as the laser sees it.
    #[must_use]
    pub fn view(&self) -> View {
        View::new(self.facing, self.roll)
    }

    /// Whether a marking frame in the part's file is used.
    #[must_use]
    pub fn leaves_view_to_file(&self) -> bool {
        let is_open = match self.view_source {
            ViewSource::Station | ViewSource::FrameOfFile(_) => true,
            ViewSource::Sides | ViewSource::Rolled | ViewSource::Frame(_) => false,
        };
        is_open && self.primitive.is_none()
    }

    fn seen_by(&self, frame: &MarkingFrame, view_source: ViewSource) -> Self {
        Self { facing: frame.facing(), roll: frame.roll(), view_source, ..self.clone() }
    }
}

impl Default for PartSettings {
    fn default() -> Self {
        Self {
            facing: Facing::TOP,
            roll: 0.0,
            view_source: ViewSource::Station,
            unit: None,
            up: None,
            normals: NormalsChoice::Auto,
            bridge: None,
            smoothing: Smoothing::Auto,
            converter: Converter::None,
            primitive: None,
        }
    }
}

/// How the pattern's file is read.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct PatternSettings {
    /// Unit of a drawing that names none; `None` uses mm, or inches where the file suggests them.
    pub unit_if_unitless: Option<DrawingUnit>,
    /// The ink layers, which are marked, compared without regard to case; `None` for all. Other layers are carried along.
    pub ink_layers: Option<Vec<String>>,
    /// What is marked of the strokes in an SVG drawing.
    pub strokes: StrokesChoice,
    /// Lines of a smaller width are marked as their centre lines, mm.
    pub hairline: f64,
    /// Which space of a DXF drawing is read.
    pub space: Space,
    /// Size and threshold of a drawing that is a picture, and the size of the page of an SVG drawing.
    pub picture: RasterOptions,
    /// Ends of loose pieces no farther apart are joined, mm; 0 joins nothing.
    pub joining_tolerance: f64,
    /// Length of lines on lines above which the report warns that they are marked twice, mm.
    pub overlap: f64,
    /// Keeps the drawing unchanged, with warnings in place of repairs.
    pub strict: bool,
    /// What is done when visible ink on an ink layer cannot be read.
    pub losses: Losses,
}

impl Default for PatternSettings {
    fn default() -> Self {
        let PatternOptions { unit_if_unitless, picture, joining_tolerance, strict, hairline, space, .. } =
            PatternOptions::default();
        let (losses, strokes) = (Losses::default(), StrokesChoice::default());
        Self {
            unit_if_unitless,
            ink_layers: None,
            strokes,
            hairline,
            space,
            picture,
            joining_tolerance,
            overlap: 0.1,
            strict,
            losses,
        }
    }
}

impl PatternSettings {
    /// The options of the reader of drawings.
    #[must_use]
    pub fn options(&self) -> PatternOptions {
        PatternOptions {
            unit_if_unitless: self.unit_if_unitless,
            unit: None,
            joining_tolerance: self.joining_tolerance,
            strict: self.strict,
            strokes: self.strokes.strokes(),
            hairline: self.hairline,
            space: self.space.clone(),
            picture: self.picture,
            content: None,
            ink_layers: self.ink_layers.clone(),
            pace: Pace::Any,
        }
    }

    /// Whether the layer is an ink layer.
    #[must_use]
    pub fn counts_as_ink(&self, layer: &str) -> bool {
        is_among(self.ink_layers.as_deref(), layer)
    }

    /// The ink layers that are not among the given ones.
    pub fn ink_layers_missing_in(&self, layers: &[&str]) -> Vec<&str> {
        let is_missing = |name: &&str| !layers.iter().any(|layer| is_same_layer(name, layer));
        self.ink_layers.iter().flatten().map(String::as_str).filter(is_missing).collect()
    }
}

/// Where the pattern lands on the part.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct Placement {
    /// Where the anchor is placed, mm; `None` for where it was drawn. With a marking frame it is measured from the frame's
    /// origin along its x and y, and `None` is the origin itself.
    pub place: Option<ViewPoint>,
    /// Whether `place` was given for this part or drawing, so that it is measured from a marking frame in the part's file. The
    /// station's place for every part is not used with such a frame.
    pub is_place_given: bool,
    /// The point of the drawing that is placed and turned about.
    pub anchor: Anchor,
    /// Turn of the drawing about its anchor, counter-clockwise, rad.
    pub rotate: f64,
    /// The direction from which `rotate` turns it.
    pub align: Align,
    /// What is done with ink outside the faces named `mark`.
    pub outside_mark: OutsideMark,
}

/// The point of the drawing that is placed and turned about.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub enum Anchor {
    /// The centre of the drawing's extents.
    #[default]
    Center,
    /// The drawing's origin.
    Origin,
    /// A point of the drawing, mm.
    At(FlatPoint),
}

/// How the drawing is bent, and how exactly.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct CorrectionSettings {
    /// The method.
    pub method: Method,
    /// Where lengths are kept first.
    pub weighting: Weighting,
    /// What is kept first under [`Weighting::Ink`].
    pub aim: Aim,
    /// How `floater` weights a vertex's neighbours.
    pub floater_weights: FloaterWeights,
    /// How fine `mapping-domain` is.
    pub mapping_domain: MappingDomainOptions,
    /// Factor on the weight that the aim gives to the lengths of lines; 1 is usual.
    pub length_weight: f64,
    /// The same for angles.
    pub angle_weight: f64,
    /// Greatest distance between the corrected polyline and the true curve, mm.
    pub tolerance: f64,
    /// Which points of the drawing are carried over.
    pub vertices: Vertices,
    /// Greatest distance between the part and the fitted surface, mm; above it the part is refused.
    pub max_residual: f64,
}

impl CorrectionSettings {
    /// The range of [`Self::length_weight`] and [`Self::angle_weight`].
    pub const WEIGHTS: std::ops::RangeInclusive<f64> = 0.1..=10.0;
}

impl Default for CorrectionSettings {
    fn default() -> Self {
        Self {
            method: Method::default(),
            weighting: Weighting::default(),
            aim: Aim::default(),
            floater_weights: FloaterWeights::default(),
            mapping_domain: MappingDomainOptions::THESIS,
            length_weight: 1.0,
            angle_weight: 1.0,
            tolerance: 0.01,
            vertices: Vertices::default(),
            max_residual: 0.1,
        }
    }
}

impl FromIterator<Slip> for AsPrinted {
    fn from_iter<Slips: IntoIterator<Item = Slip>>(slips: Slips) -> Self {
        slips.into_iter().fold(Self::NOTHING, |kept, slip| match slip {
            Slip::SimpsonWeights => Self { simpson_weights: true, ..kept },
            Slip::DiagonalSums => Self { diagonal_sums: true, ..kept },
            Slip::KnotVectors => Self { knot_vectors: true, ..kept },
        })
    }
}

/// Marks that go round a cylinder or cone: the part turns about its axis between tiles.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct Rotary {
    /// Whether a drawing is divided into tiles.
    pub tiles: Tiles,
    /// How far two tiles overlap where a contour is cut, mm on the part.
    pub overlap: f64,
    /// The widest tile, rad about the axis; `None` for what incidence, focus and field allow.
    pub max_tile: Option<f64>,
    /// How the tiles are written.
    pub written_as: TilesAs,
    /// Whether the angles of the rotary axis grow in the other direction.
    pub is_reversed: bool,
}

/// The number of tiles.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Tiles {
    /// The part does not turn.
    #[default]
    Off,
    /// As few as possible.
    Auto,
    /// This many.
    Count(usize),
}

impl Tiles {
    /// The largest number of tiles that a person may ask for.
    pub const MOST: usize = 360;
}

/// The lens and the limits of what it can mark.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Optics {
    /// How the lens projects.
    pub lens: Lens,
    /// Whether nobody stated the lens, so that a telecentric one is assumed.
    pub lens_is_assumed: bool,
    /// Where the lens' axis meets the field; `None` for the middle of the field.
    pub axis: Option<FieldPoint>,
    /// Whole range of heights that is in focus, mm; `None` leaves it unchecked.
    pub focus_depth: Option<f64>,
    /// Width of a marked line, mm; `None` leaves the distances of lines unchecked.
    pub spot: Option<f64>,
    /// How far another part of the body may rise into the beam before ink is refused as hidden, mm.
    pub shadow: f64,
    /// Limits of the angle between the beam and the surface's normal.
    pub incidence: IncidenceLimits,
}

impl Default for Optics {
    fn default() -> Self {
        Self {
            lens: Lens::default(),
            lens_is_assumed: true,
            axis: None,
            focus_depth: None,
            spot: None,
            shadow: 0.1,
            incidence: IncidenceLimits::default(),
        }
    }
}

/// Limits of the angle between the beam and the surface's normal, rad, in rising order.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct IncidenceLimits {
    /// Above it the report notes the angle.
    pub note: f64,
    /// Above it the report warns.
    pub warn: f64,
    /// Above it the job is refused.
    pub refuse: f64,
}

impl Default for IncidenceLimits {
    fn default() -> Self {
        Self { note: 11f64.to_radians(), warn: 30f64.to_radians(), refuse: 60f64.to_radians() }
    }
}

/// The marking software's working area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Extent in x, mm.
    pub width: f64,
    /// Extent in y, mm.
    pub height: f64,
    /// Where its zero is.
    pub origin: FieldOrigin,
}

impl Field {
    /// The area in field coordinates, mm.
    #[must_use]
    pub fn extents(&self) -> Extents {
        let size = Vector2::new(self.width, self.height);
        match self.origin {
            FieldOrigin::Center => Extents { min: -size / 2.0, max: size / 2.0 },
            FieldOrigin::Corner => Extents { min: Vector2::zeros(), max: size },
            FieldOrigin::At(zero) => Extents { min: -Vector2::from(zero), max: size - Vector2::from(zero) },
        }
    }
}

/// How the corrected file is written.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Output {
    /// Its DXF version.
    pub dxf: DxfVersion,
    /// Whether comments (group code 999) name the program and the SKU.
    pub comments: bool,
}

impl Default for Output {
    fn default() -> Self {
        Self { dxf: DxfVersion::default(), comments: true }
    }
}
