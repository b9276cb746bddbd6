//! The keys of the files, as serde sees them, and what they change in a [`JobSettings`].

use std::ops::Range;
use std::path::{Path, PathBuf};

use nalgebra::{Point3, Vector3};
use serde::Deserialize;
use toml::Spanned;

use super::choices::{
    Aim, Align, Converter, DxfVersion, FieldOrigin, FloaterWeights, Losses, Method, OutsideMark, PartShape,
    Slip, Smoothing, StrokesChoice, TilesAs, Vertices, Weighting, numbers, parse_axis, parse_facing,
};
use super::content_keys::{ContentKeys, SerialKeys};
use super::error::ConfigError;
use super::fill_keys::{FillKeys, FocusKeys};
use super::lens_table;
use super::settings::{Anchor, CorrectionSettings, Field, IncidenceLimits, JobSettings, Tiles, ViewSource};
use super::text::{Numbers, SettingsText};
use crate::formats::mesh::{LengthUnit, NormalsChoice, UpAxis};
use crate::formats::pattern::{DrawingUnit, Space};
use crate::geometry::mapping::mapping_domain::MappingDomainOptions;
use crate::geometry::optics::Lens;
use crate::geometry::primitive::{Form, Primitive};
use crate::geometry::space::{Extents, Facing, FieldPoint, FlatPoint, MarkingFrame, ViewPoint};
use crate::geometry::surface::scan;

/// Coordinates beyond this are outside of any station, mm; the unit is probably wrong.
const FARTHEST: f64 = 10_000.0;
/// Largest uncertainty of a part's position, mm, and of its turn, deg. Beyond them, effects are not proportional any more.
const FARTHEST_OFF: f64 = 10.0;
const MOST_TURNED: f64 = 10.0;

/// Widths of lines that may be marked as their centre lines, mm.
const HAIRLINE: std::ops::RangeInclusive<f64> = 0.0..=1.0;
/// Gaps that may be joined, mm.
const JOINING: std::ops::RangeInclusive<f64> = 0.0..=1.0;

/// Widths of gaps that may be bridged, mm.
const BRIDGE: std::ops::RangeInclusive<f64> = 0.0..=100.0;
/// Wavelengths of a low pass, mm.
const LOW_PASS: std::ops::RangeInclusive<f64> = 0.1..=1000.0;

/// The tables that the station sets for all SKUs and a SKU file may override.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct JobKeys {
    pub(super) part: PartKeys,
    pub(super) pattern: PatternKeys,
    pub(super) placement: PlacementKeys,
    pub(super) correction: CorrectionKeys,
    pub(super) rotary: RotaryKeys,
    pub(super) fixture: FixtureKeys,
    pub(super) fill: FillKeys,
    pub(super) focus: FocusKeys,
    pub(super) content: ContentKeys,
    pub(super) serial: SerialKeys,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct PartKeys {
    facing: Option<Spanned<NameOr<Numbers<3>>>>,
    roll_deg: Option<Spanned<f64>>,
    frame: Option<Spanned<FrameKeys>>,
    unit: Option<Spanned<LengthUnit>>,
    up: Option<Spanned<UpAxis>>,
    normals: Option<Spanned<NormalsChoice>>,
    bridge_mm: Option<Spanned<f64>>,
    smoothing: Option<Spanned<Smoothing>>,
    converter: Option<Spanned<Converter>>,
    low_pass_mm: Option<Spanned<f64>>,
    shape: Option<Spanned<PartShape>>,
    diameter_mm: Option<Spanned<f64>>,
    end_diameter_mm: Option<Spanned<f64>>,
    length_mm: Option<Spanned<f64>>,
    axis: Option<Spanned<NameOr<Numbers<3>>>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct PatternKeys {
    unit_if_unitless: Option<DrawingUnit>,
    ink_layers: Option<Spanned<Vec<String>>>,
    width_mm: Option<Spanned<f64>>,
    height_mm: Option<Spanned<f64>>,
    threshold_percent: Option<Spanned<f64>>,
    invert: Option<bool>,
    joining_mm: Option<Spanned<f64>>,
    overlap_mm: Option<Spanned<f64>>,
    strict: Option<bool>,
    losses: Option<Losses>,
    strokes: Option<StrokesChoice>,
    hairline_mm: Option<Spanned<f64>>,
    space: Option<Spanned<String>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct PlacementKeys {
    place_mm: Option<Spanned<Numbers<2>>>,
    anchor: Option<Spanned<NameOr<Numbers<2>>>>,
    rotate_deg: Option<Spanned<f64>>,
    align: Option<Align>,
    outside_mark: Option<OutsideMark>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct CorrectionKeys {
    method: Option<Method>,
    weighting: Option<Weighting>,
    aim: Option<Aim>,
    floater_weights: Option<FloaterWeights>,
    mapping_domain_grid: Option<Spanned<usize>>,
    mapping_domain_intervals: Option<Spanned<usize>>,
    mapping_domain_as_printed: Option<Vec<Slip>>,
    length_weight: Option<Spanned<f64>>,
    angle_weight: Option<Spanned<f64>>,
    tolerance_mm: Option<Spanned<f64>>,
    vertices: Option<Vertices>,
    max_residual_mm: Option<Spanned<f64>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RotaryKeys {
    tiles: Option<Spanned<TilesKey>>,
    overlap_mm: Option<Spanned<f64>>,
    max_tile_deg: Option<Spanned<f64>>,
    #[serde(rename = "as")]
    written_as: Option<TilesAs>,
    reverse: Option<bool>,
}

/// A number of tiles, or how it is found.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected \"off\", \"auto\" or a number of tiles")]
enum TilesKey {
    Count(usize),
    Name(String),
}

impl RotaryKeys {
    fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        let rotary = &mut to.rotary;
        if let Some(tiles) = self.tiles {
            rotary.tiles = match tiles.get_ref() {
                TilesKey::Name(name) if name == "off" => Tiles::Off,
                TilesKey::Name(name) if name == "auto" => Tiles::Auto,
                TilesKey::Name(name) => {
                    return Err(ConfigError::UnknownChoice {
                        spot: text.spot(&tiles.span()),
                        given: name.clone(),
                        allowed: ["off", "auto", "N"].map(String::from).into(),
                    });
                }
                TilesKey::Count(count) => {
                    let count = Spanned::new(tiles.span(), *count);
                    Tiles::Count(text.count("rotary.tiles", &count, 1..=Tiles::MOST)?)
                }
            };
        }
        if let Some(overlap) = self.overlap_mm {
            rotary.overlap = text.number("rotary.overlap_mm", &overlap, 0.0..=10.0, "mm")?;
        }
        if let Some(widest) = self.max_tile_deg {
            let widest = text.number("rotary.max_tile_deg", &widest, 1.0..=178.0, "deg")?;
            rotary.max_tile = Some(widest.to_radians());
        }
        rotary.written_as = self.written_as.unwrap_or(rotary.written_as);
        rotary.is_reversed = self.reverse.unwrap_or(rotary.is_reversed);
        Ok(())
    }
}

/// A name in quotes, or numbers.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a name in quotes or a list of numbers in brackets")]
enum NameOr<T> {
    Name(String),
    Numbers(T),
}

/// A marking frame: a table, or its origin, z and x as text.
#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "expected a frame, such as { origin = [0, -36.5, 60], z = [0, -1, 0], x = [1, 0, 0] } or \"0,-36.5,60 0,-1,0 1,0,0\""
)]
enum FrameKeys {
    Text(String),
    Table(FrameTable),
}

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct FrameTable {
    origin: Numbers<3>,
    z: Numbers<3>,
    x: Option<Numbers<3>>,
}

impl FrameKeys {
    /// The numbers; `None` for a text with others.
    fn table(&self) -> Option<FrameTable> {
        match self {
            Self::Table(table) => Some(*table),
            Self::Text(text) => {
                let triples: Vec<[f64; 3]> = text.split_whitespace().map(numbers).collect::<Option<_>>()?;
                match triples[..] {
                    [origin, z] => Some(FrameTable { origin: Numbers(origin), z: Numbers(z), x: None }),
                    [origin, z, x] => {
                        Some(FrameTable { origin: Numbers(origin), z: Numbers(z), x: Some(Numbers(x)) })
                    }
                    _ => None,
                }
            }
        }
    }

    /// The frame. Without x, the drawing's x is to the right in the view of the side that z names.
    fn frame(given: &Spanned<Self>, text: &SettingsText) -> Result<MarkingFrame, ConfigError> {
        let wrong = |what: &str, remedy: &str| ConfigError::Contradiction {
            spot: text.spot(&given.span()),
            what: what.into(),
            remedy: remedy.into(),
        };
        let FrameTable { origin, z, x } = given.get_ref().table().ok_or_else(|| {
            wrong(
                "`part.frame` does not give a marking frame.",
                "Give origin, z and x, three numbers each, such as \"0,-36.5,60 0,-1,0 1,0,0\"; x may be left out.",
            )
        })?;
        let (Numbers(origin), Numbers(z)) = (origin, z);
        for value in origin {
            text.in_range("part.frame", value, &given.span(), -FARTHEST..=FARTHEST, "mm")?;
        }
        let origin = Point3::from(origin);
        let frame = match x {
            Some(Numbers(x)) => MarkingFrame::new(origin, z.into(), x.into()),
            None => Facing::towards(z.into()).map(|facing| MarkingFrame::upright(origin, facing)),
        };
        frame.ok_or_else(|| {
            wrong(
                "`part.frame` does not give two different directions.",
                "Give z, the direction to the laser, and x, the direction of the drawing's x, perpendicular to it, such as z = \
                 [0, -1, 0] and x = [1, 0, 0].",
            )
        })
    }
}

impl JobKeys {
    /// Changes what the file names and keeps the rest.
    pub(super) fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        self.part.apply(text, to)?;
        self.pattern.apply(text, to)?;
        self.placement.apply(text, to)?;
        self.correction.apply(text, to)?;
        self.rotary.apply(text, to)?;
        self.fixture.apply(text, to)?;
        self.fill.apply(text, to)?;
        self.focus.apply(text, to)?;
        self.content.apply(text, to)?;
        self.serial.apply(text, to)
    }
}

/// The keys of a settings file beside a pattern: none that change the part, the field or the laser.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct SidecarKeys {
    pattern: PatternKeys,
    placement: PlacementKeys,
    correction: SidecarCorrectionKeys,
    fill: FillKeys,
    rotary: RotaryKeys,
    content: ContentKeys,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct SidecarCorrectionKeys {
    method: Option<Method>,
}

impl SidecarKeys {
    pub(super) fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        self.pattern.apply(text, to)?;
        self.placement.apply(text, to)?;
        self.fill.apply(text, to)?;
        to.correction.method = self.correction.method.unwrap_or(to.correction.method);
        self.content.apply(text, to)?;
        self.rotary.apply(text, to)
    }
}

impl PartKeys {
    fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        to.part.primitive = self.primitive(text, to.part.primitive)?;
        if let (Some(primitive), Some(span)) = (to.part.primitive, self.way_of_a_mesh()) {
            return Err(ConfigError::Contradiction {
                spot: text.spot(&span),
                what: format!(
                    "The part is a {primitive} given by its sizes; no file is read or turned for it."
                ),
                remedy: "Give its direction as `axis`, and remove what is only for a file: `facing`, `roll_deg`, `frame`, `unit`, `up`, `normals`, `bridge_mm`, `smoothing`, `low_pass_mm`, `converter`."
                    .into(),
            });
        }
        if let Some(given) = &self.frame {
            let beside =
                self.facing.as_ref().map(Spanned::span).or(self.roll_deg.as_ref().map(Spanned::span));
            if let Some(span) = beside {
                return Err(ConfigError::Contradiction {
                    spot: text.spot(&span),
                    what: "`frame` gives the side that faces the laser, and so do `facing` and `roll_deg`."
                        .into(),
                    remedy: "Remove `facing` and `roll_deg`, or remove `frame`.".into(),
                });
            }
            to.part = to.part.framed(FrameKeys::frame(given, text)?);
        }
        if self.facing.is_some() || self.roll_deg.is_some() {
            // One of them in a SKU's file replaces a whole frame of the station.
            if to.part.view_source.frame().is_some() {
                (to.part.facing, to.part.roll) = (Facing::TOP, 0.0);
            }
            to.part.view_source = match to.part.view_source {
                _ if self.facing.is_some() => ViewSource::Sides,
                ViewSource::Sides => ViewSource::Sides,
                ViewSource::Station
                | ViewSource::Rolled
                | ViewSource::Frame(_)
                | ViewSource::FrameOfFile(_) => ViewSource::Rolled,
            };
        }
        if let Some(facing) = self.facing {
            to.part.facing = match facing.get_ref() {
                NameOr::Name(name) => parse_facing(name).ok(),
                NameOr::Numbers(Numbers(direction)) => Facing::towards(Vector3::from(*direction)),
            }
            .ok_or_else(|| ConfigError::Contradiction {
                spot: text.spot(&facing.span()),
                what: match facing.get_ref() {
                    NameOr::Name(name) => format!("`{name}` names no side of the part."),
                    NameOr::Numbers(_) => "`part.facing` names no side of the part.".into(),
                },
                remedy:
                    "Give \"+z\" (top), \"-z\" (bottom), \"+x\" (right), \"-x\" (left), \"+y\" (back), \"-y\" (front) or a \
                     direction such as [1, 0, 0.5]."
                        .into(),
            })?;
        }
        if let Some(roll) = self.roll_deg {
            to.part.roll = text.number("part.roll_deg", &roll, -360.0..=360.0, "deg")?.to_radians();
        }
        to.part.unit = self.unit.map(Spanned::into_inner).or(to.part.unit);
        to.part.up = self.up.map(Spanned::into_inner).or(to.part.up);
        to.part.converter = self.converter.map(Spanned::into_inner).unwrap_or(to.part.converter);
        to.part.normals = self.normals.map(Spanned::into_inner).unwrap_or(to.part.normals);
        if let Some(widest) = &self.bridge_mm {
            to.part.bridge = Some(text.number("part.bridge_mm", widest, BRIDGE, "mm")?);
        }
        let before = match to.part.smoothing {
            scan::Smoothing::LowPass { wavelength } => Some(wavelength),
            scan::Smoothing::Auto | scan::Smoothing::None => None,
        };
        let wavelength = match &self.low_pass_mm {
            Some(given) => Some(text.number("part.low_pass_mm", given, LOW_PASS, "mm")?),
            None => before,
        };
        match (self.smoothing, self.low_pass_mm) {
            (Some(smoothing), Some(given)) if *smoothing.get_ref() != Smoothing::LowPass => {
                return Err(ConfigError::Contradiction {
                    spot: text.spot(&given.span()),
                    what: format!(
                        "`part.low_pass_mm` has no effect with smoothing \"{}\".",
                        smoothing.get_ref()
                    ),
                    remedy: "Set `smoothing = \"low-pass\"`, or remove `low_pass_mm`.".into(),
                });
            }
            (Some(smoothing), _) => to.part.smoothing = smoothing.get_ref().with_wavelength(wavelength),
            (None, Some(_)) => to.part.smoothing = Smoothing::LowPass.with_wavelength(wavelength),
            (None, None) => {}
        }
        Ok(())
    }

    /// The place of a key that is only for a part from a file.
    fn way_of_a_mesh(&self) -> Option<Range<usize>> {
        let spans = [
            self.facing.as_ref().map(Spanned::span),
            self.roll_deg.as_ref().map(Spanned::span),
            self.frame.as_ref().map(Spanned::span),
            self.unit.as_ref().map(Spanned::span),
            self.up.as_ref().map(Spanned::span),
            self.normals.as_ref().map(Spanned::span),
            self.bridge_mm.as_ref().map(Spanned::span),
            self.smoothing.as_ref().map(Spanned::span),
            self.converter.as_ref().map(Spanned::span),
            self.low_pass_mm.as_ref().map(Spanned::span),
        ];
        spans.into_iter().flatten().next()
    }

    /// The cylinder or cone that the keys describe; sizes that are not given are those of `old`.
    fn primitive(
        &self,
        text: &SettingsText,
        old: Option<Primitive>,
    ) -> Result<Option<Primitive>, ConfigError> {
        let sizes = [&self.diameter_mm, &self.end_diameter_mm, &self.length_mm];
        let spans = sizes.iter().filter_map(|size| size.as_ref().map(Spanned::span));
        let mut spans = spans.chain(self.axis.as_ref().map(Spanned::span));
        let contradiction = |span: Range<usize>, what: &str, remedy: &str| {
            Err(ConfigError::Contradiction {
                spot: text.spot(&span),
                what: what.into(),
                remedy: remedy.into(),
            })
        };
        let inherited = old.map(|primitive| match primitive.form() {
            Form::Cylinder(_) => PartShape::Cylinder,
            Form::Cone(_) => PartShape::Cone,
        });
        let shape = self.shape.as_ref().map(|shape| *shape.get_ref()).or(inherited);
        let shape = match (shape, spans.next()) {
            (None | Some(PartShape::Mesh), None) => return Ok(None),
            (None | Some(PartShape::Mesh), Some(span)) => {
                return contradiction(
                    span,
                    "A part from a mesh has its sizes from the file.",
                    "Set `shape = \"cylinder\"` or `\"cone\"`, or remove the sizes.",
                );
            }
            (Some(shape), _) => shape,
        };
        // Sizes of another shape are not used.
        let old = old.filter(|_| inherited == Some(shape));
        let span = self.shape.as_ref().map_or(0..0, Spanned::span);
        let size = |index: usize, key: &str| match (sizes[index], old) {
            (Some(given), _) => text.number(&format!("part.{key}"), given, 0.1..=FARTHEST, "mm"),
            (None, Some(old)) => Ok(old.sizes()[index]),
            (None, None) => Err(ConfigError::Missing { spot: text.spot(&span), key: key.into() }),
        };
        let diameter = size(0, "diameter_mm")?;
        let end_diameter = match (shape, &self.end_diameter_mm) {
            (PartShape::Cone, _) => size(1, "end_diameter_mm")?,
            (_, None) => diameter,
            (_, Some(given)) => {
                return contradiction(
                    given.span(),
                    "A cylinder has one diameter.",
                    "Set `shape = \"cone\"`, or remove `end_diameter_mm`.",
                );
            }
        };
        if shape == PartShape::Cone && diameter == end_diameter {
            let what = "The two diameters of a cone must differ.";
            return contradiction(span, what, "Set `shape = \"cylinder\"`, or correct the diameters.");
        }
        let axis = match (&self.axis, old) {
            (Some(given), _) => match given.get_ref() {
                NameOr::Name(name) => parse_axis(name).ok(),
                NameOr::Numbers(Numbers(direction)) => Some(Vector3::from(*direction)),
            },
            (None, Some(old)) => Some(*old.axis()),
            (None, None) => Some(Vector3::y()),
        };
        let length = size(2, "length_mm")?;
        match axis.and_then(|axis| Primitive::new(diameter, end_diameter, length, axis)) {
            Some(primitive) => Ok(Some(primitive)),
            None => contradiction(
                self.axis.as_ref().map_or(span, Spanned::span),
                "`part.axis` names no direction across the laser's axis.",
                "Give \"x\", \"-x\", \"y\", \"-y\" or a direction in the laser's view such as [0, 1, -0.1].",
            ),
        }
    }
}

impl PatternKeys {
    fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        to.pattern.unit_if_unitless = self.unit_if_unitless.or(to.pattern.unit_if_unitless);
        if let Some(layers) = self.ink_layers {
            if layers.get_ref().is_empty() {
                return Err(ConfigError::Contradiction {
                    spot: text.spot(&layers.span()),
                    what: "`pattern.ink_layers` is empty, so nothing would be marked.".into(),
                    remedy: "Name at least one layer, or leave the key out to mark all.".into(),
                });
            }
            to.pattern.ink_layers = Some(layers.into_inner());
        }
        let picture = &mut to.pattern.picture;
        // One side in a SKU's file replaces both of the station's: the other one then follows from the picture.
        if self.width_mm.is_some() || self.height_mm.is_some() {
            let side = |key, given: Option<Spanned<f64>>| {
                given.map(|given| text.number(key, &given, 0.01..=FARTHEST, "mm")).transpose()
            };
            picture.width = side("pattern.width_mm", self.width_mm)?;
            picture.height = side("pattern.height_mm", self.height_mm)?;
        }
        if let Some(threshold) = self.threshold_percent {
            let range = 1.0..=99.0;
            picture.threshold = text.number("pattern.threshold_percent", &threshold, range, "%")? / 100.0;
        }
        picture.inverted = self.invert.unwrap_or(picture.inverted);
        if let Some(overlap) = self.overlap_mm {
            to.pattern.overlap = text.number("pattern.overlap_mm", &overlap, 0.0..=1e6, "mm")?;
        }
        if let Some(joining) = self.joining_mm {
            to.pattern.joining_tolerance = text.number("pattern.joining_mm", &joining, JOINING, "mm")?;
        }
        to.pattern.strict = self.strict.unwrap_or(to.pattern.strict);
        to.pattern.losses = self.losses.unwrap_or(to.pattern.losses);
        to.pattern.strokes = self.strokes.unwrap_or(to.pattern.strokes);
        if let Some(hairline) = self.hairline_mm {
            to.pattern.hairline = text.number("pattern.hairline_mm", &hairline, HAIRLINE, "mm")?;
        }
        if let Some(space) = self.space {
            to.pattern.space = space.get_ref().parse().map_err(|()| ConfigError::UnknownChoice {
                spot: text.spot(&space.span()),
                given: space.get_ref().clone(),
                allowed: Space::WORDS.map(String::from).into(),
            })?;
        }
        Ok(())
    }
}

impl PlacementKeys {
    fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        if let Some(place) = self.place_mm {
            let [x, y] = text.numbers("placement.place_mm", &place, -FARTHEST..=FARTHEST, "mm")?;
            to.placement.place = Some(ViewPoint::new(x, y));
            to.placement.is_place_given = true;
        }
        if let Some(anchor) = self.anchor {
            let point = match anchor.get_ref() {
                NameOr::Name(name) => match (name.as_str(), numbers(name)) {
                    ("center", _) => Err(Anchor::Center),
                    ("origin", _) => Err(Anchor::Origin),
                    (_, Some(point)) => Ok(point),
                    (_, None) => {
                        return Err(ConfigError::UnknownChoice {
                            spot: text.spot(&anchor.span()),
                            given: name.clone(),
                            allowed: ["center", "origin", "X,Y"].map(String::from).into(),
                        });
                    }
                },
                NameOr::Numbers(Numbers(point)) => Ok(*point),
            };
            to.placement.anchor = match point {
                Err(named) => named,
                Ok(point) => {
                    let point = Spanned::new(anchor.span(), Numbers(point));
                    let [x, y] = text.numbers("placement.anchor", &point, -FARTHEST..=FARTHEST, "mm")?;
                    Anchor::At(FlatPoint::new(x, y))
                }
            };
        }
        if let Some(rotate) = self.rotate_deg {
            let range = -360.0..=360.0;
            to.placement.rotate = text.number("placement.rotate_deg", &rotate, range, "deg")?.to_radians();
        }
        to.placement.align = self.align.unwrap_or(to.placement.align);
        to.placement.outside_mark = self.outside_mark.unwrap_or(to.placement.outside_mark);
        Ok(())
    }
}

impl CorrectionKeys {
    fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        let correction = &mut to.correction;
        correction.method = self.method.unwrap_or(correction.method);
        correction.weighting = self.weighting.unwrap_or(correction.weighting);
        correction.aim = self.aim.unwrap_or(correction.aim);
        correction.vertices = self.vertices.unwrap_or(correction.vertices);
        correction.floater_weights = self.floater_weights.unwrap_or(correction.floater_weights);
        let domain = &mut correction.mapping_domain;
        if let Some(grid) = self.mapping_domain_grid {
            domain.grid = text.count("correction.mapping_domain_grid", &grid, MappingDomainOptions::GRIDS)?;
        }
        if let Some(intervals) = self.mapping_domain_intervals {
            let key = "correction.mapping_domain_intervals";
            domain.intervals = text.count(key, &intervals, MappingDomainOptions::INTERVALS)?;
            if domain.intervals % 2 == 1 {
                return Err(ConfigError::Contradiction {
                    spot: text.spot(&intervals.span()),
                    what: format!(
                        "{} intervals are odd, and Simpson's rule needs an even number.",
                        domain.intervals
                    ),
                    remedy: "Give an even number; the thesis uses 50.".into(),
                });
            }
        }
        if let Some(slips) = self.mapping_domain_as_printed {
            domain.as_printed = slips.into_iter().collect();
        }
        if let Some(weight) = self.length_weight {
            let range = CorrectionSettings::WEIGHTS;
            correction.length_weight = text.number("correction.length_weight", &weight, range, "times")?;
        }
        if let Some(weight) = self.angle_weight {
            let range = CorrectionSettings::WEIGHTS;
            correction.angle_weight = text.number("correction.angle_weight", &weight, range, "times")?;
        }
        if let Some(tolerance) = self.tolerance_mm {
            correction.tolerance = text.number("correction.tolerance_mm", &tolerance, 0.0001..=1.0, "mm")?;
        }
        if let Some(limit) = self.max_residual_mm {
            correction.max_residual =
                text.number("correction.max_residual_mm", &limit, 0.0001..=10.0, "mm")?;
        }
        Ok(())
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FieldKeys {
    width_mm: Spanned<f64>,
    height_mm: Spanned<f64>,
    origin: Option<Spanned<NameOr<Numbers<2>>>>,
}

impl FieldKeys {
    pub(super) fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        to.field = Some(Field {
            width: text.number("field.width_mm", &self.width_mm, 1.0..=FARTHEST, "mm")?,
            height: text.number("field.height_mm", &self.height_mm, 1.0..=FARTHEST, "mm")?,
            origin: self.origin.map_or(Ok(FieldOrigin::default()), |origin| Self::origin(text, &origin))?,
        });
        Ok(())
    }

    fn origin(text: &SettingsText, given: &Spanned<NameOr<Numbers<2>>>) -> Result<FieldOrigin, ConfigError> {
        let point = match given.get_ref() {
            NameOr::Name(name) => match (name.as_str(), numbers(name)) {
                ("center", _) => return Ok(FieldOrigin::Center),
                ("corner", _) => return Ok(FieldOrigin::Corner),
                (_, Some(point)) => point,
                (_, None) => {
                    return Err(ConfigError::UnknownChoice {
                        spot: text.spot(&given.span()),
                        given: name.clone(),
                        allowed: ["center", "corner", "X,Y"].map(String::from).into(),
                    });
                }
            },
            NameOr::Numbers(Numbers(point)) => *point,
        };
        let point = Spanned::new(given.span(), Numbers(point));
        text.numbers("field.origin", &point, -FARTHEST..=FARTHEST, "mm").map(FieldOrigin::At)
    }
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct FixtureKeys {
    x_mm: Option<Spanned<f64>>,
    y_mm: Option<Spanned<f64>>,
    z_mm: Option<Spanned<f64>>,
    rotation_deg: Option<Spanned<f64>>,
    uncertainty_mm: Option<Spanned<f64>>,
    uncertainty_z_mm: Option<Spanned<f64>>,
    uncertainty_deg: Option<Spanned<f64>>,
}

impl FixtureKeys {
    fn apply(self, text: &SettingsText, to: &mut JobSettings) -> Result<(), ConfigError> {
        let fixture = &mut to.fixture;
        for (key, given, to) in [
            ("fixture.x_mm", self.x_mm, &mut fixture.x),
            ("fixture.y_mm", self.y_mm, &mut fixture.y),
            ("fixture.z_mm", self.z_mm, &mut fixture.z),
        ] {
            if let Some(given) = given {
                *to = text.number(key, &given, -FARTHEST..=FARTHEST, "mm")?;
            }
        }
        if let Some(rotation) = self.rotation_deg {
            let range = -360.0..=360.0;
            fixture.rotation = text.number("fixture.rotation_deg", &rotation, range, "deg")?.to_radians();
        }
        let mut known = to.pose_uncertainty;
        if let Some(sideways) = self.uncertainty_mm {
            known.sideways = text.number("fixture.uncertainty_mm", &sideways, 0.0..=FARTHEST_OFF, "mm")?;
            known.height = known.sideways;
        }
        if let Some(height) = self.uncertainty_z_mm {
            known.height = text.number("fixture.uncertainty_z_mm", &height, 0.0..=FARTHEST_OFF, "mm")?;
        }
        if let Some(turn) = self.uncertainty_deg {
            known.turn =
                text.number("fixture.uncertainty_deg", &turn, 0.0..=MOST_TURNED, "deg")?.to_radians();
        }
        to.pose_uncertainty = known;
        Ok(())
    }
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct OpticsKeys {
    kind: Option<Spanned<LensKind>>,
    lens_distance_x_mm: Option<Spanned<f64>>,
    lens_distance_y_mm: Option<Spanned<f64>>,
    axis_mm: Option<Spanned<Numbers<2>>>,
    table: Option<Spanned<PathBuf>>,
    focus_depth_mm: Option<Spanned<f64>>,
    spot_mm: Option<Spanned<f64>>,
    shadow_mm: Option<Spanned<f64>>,
    incidence_note_deg: Option<Spanned<f64>>,
    incidence_warn_deg: Option<Spanned<f64>>,
    incidence_refuse_deg: Option<Spanned<f64>>,
}

#[derive(Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum LensKind {
    Telecentric,
    Perspective,
}

impl OpticsKeys {
    /// The file of the lens table.
    pub(super) fn table(&self) -> Option<&Spanned<PathBuf>> {
        self.table.as_ref()
    }

    /// `table` is the file of the lens table.
    pub(super) fn apply(
        self,
        text: &SettingsText,
        table: Option<&Path>,
        to: &mut JobSettings,
    ) -> Result<(), ConfigError> {
        to.optics.lens = match (&self.table, table) {
            (Some(given), Some(table)) => self.measured_lens(text, given, table)?,
            _ => self.lens(text)?,
        };
        to.optics.lens_is_assumed = self.table.is_none() && self.kind.is_none();
        to.optics.axis = self.axis(text, to.optics.lens, to.field)?;
        if let Some(depth) = &self.focus_depth_mm {
            to.optics.focus_depth = Some(text.number("optics.focus_depth_mm", depth, 0.01..=1000.0, "mm")?);
        }
        if let Some(spot) = &self.spot_mm {
            to.optics.spot = Some(text.number("optics.spot_mm", spot, 0.001..=10.0, "mm")?);
        }
        if let Some(shadow) = &self.shadow_mm {
            to.optics.shadow = text.number("optics.shadow_mm", shadow, 0.0..=1000.0, "mm")?;
        }
        to.optics.incidence = self.incidence(text, to.optics.incidence)?;
        Ok(())
    }

    fn measured_lens(
        &self,
        text: &SettingsText,
        given: &Spanned<PathBuf>,
        table: &Path,
    ) -> Result<Lens, ConfigError> {
        let others = [
            self.kind.as_ref().map(Spanned::span),
            self.lens_distance_x_mm.as_ref().map(Spanned::span),
            self.lens_distance_y_mm.as_ref().map(Spanned::span),
            self.axis_mm.as_ref().map(Spanned::span),
        ];
        let contradiction = |span: &Range<usize>, what, remedy| ConfigError::Contradiction {
            spot: text.spot(span),
            what,
            remedy,
        };
        if let Some(span) = others.into_iter().flatten().next() {
            return Err(contradiction(
                &span,
                "The lens is given both by a table and by other settings.".into(),
                "Remove `kind`, `axis_mm` and the lens distances, or remove `table`.".into(),
            ));
        }
        lens_table::load(table).map_err(|bad| contradiction(&given.span(), bad.what, bad.remedy))
    }

    fn lens(&self, text: &SettingsText) -> Result<Lens, ConfigError> {
        let kind = self.kind.as_ref().map_or(LensKind::Telecentric, |kind| *kind.get_ref());
        let distance = |key, given: &Spanned<f64>| text.number(key, given, 10.0..=FARTHEST, "mm");
        match (kind, &self.lens_distance_x_mm, &self.lens_distance_y_mm) {
            (LensKind::Telecentric, None, None) => Ok(Lens::Telecentric),
            (LensKind::Perspective, Some(x), Some(y)) => Ok(Lens::Perspective {
                x: distance("optics.lens_distance_x_mm", x)?,
                y: distance("optics.lens_distance_y_mm", y)?,
            }),
            (LensKind::Telecentric, Some(given), _) | (LensKind::Telecentric, None, Some(given)) => {
                Err(ConfigError::Contradiction {
                    spot: text.spot(&given.span()),
                    what: "A telecentric lens has no lens distance.".into(),
                    remedy: "Set `kind = \"perspective\"`, or remove the lens distances.".into(),
                })
            }
            (LensKind::Perspective, x, _) => Err(ConfigError::Missing {
                spot: text.spot(&self.kind.as_ref().map_or(0..0, Spanned::span)),
                key: if x.is_none() { "lens_distance_x_mm" } else { "lens_distance_y_mm" }.into(),
            }),
        }
    }

    fn axis(
        &self,
        text: &SettingsText,
        lens: Lens,
        field: Option<Field>,
    ) -> Result<Option<FieldPoint>, ConfigError> {
        let Some(given) = &self.axis_mm else { return Ok(None) };
        if lens == Lens::Telecentric {
            return Err(ConfigError::Contradiction {
                spot: text.spot(&given.span()),
                what: "The axis of a telecentric lens has no effect.".into(),
                remedy: "Set `kind = \"perspective\"`, or remove `axis_mm`.".into(),
            });
        }
        let [x, y] = text.numbers("optics.axis_mm", given, -FARTHEST..=FARTHEST, "mm")?;
        let axis = FieldPoint::new(x, y);
        // The field may be a part of what the lens covers.
        let is_far = |field: &Extents| !field.scaled(2.0).contains(axis.coords());
        if let Some(field) = field.map(|field| field.extents()).filter(is_far) {
            return Err(ConfigError::Contradiction {
                spot: text.spot(&given.span()),
                what: format!(
                    "The lens axis ({x}, {y}) mm is far outside the field, which is from ({}, {}) to ({}, {}) mm: a lens is over its \
                     field.",
                    field.min.x, field.min.y, field.max.x, field.max.y
                ),
                remedy: "Give the axis in the coordinates of the field, as `isomark calibrate lens` finds it, or remove `axis_mm` for the \
                         middle of the field."
                    .into(),
            });
        }
        Ok(Some(axis))
    }

    fn incidence(
        &self,
        text: &SettingsText,
        default: IncidenceLimits,
    ) -> Result<IncidenceLimits, ConfigError> {
        let limit = |key, given: &Option<Spanned<f64>>, default: f64| match given {
            Some(given) => Ok(text.number(key, given, 0.0..=89.0, "deg")?.to_radians()),
            None => Ok(default),
        };
        let limits = IncidenceLimits {
            note: limit("optics.incidence_note_deg", &self.incidence_note_deg, default.note)?,
            warn: limit("optics.incidence_warn_deg", &self.incidence_warn_deg, default.warn)?,
            refuse: limit("optics.incidence_refuse_deg", &self.incidence_refuse_deg, default.refuse)?,
        };
        if limits.note <= limits.warn && limits.warn <= limits.refuse {
            return Ok(limits);
        }
        let given = [&self.incidence_note_deg, &self.incidence_warn_deg, &self.incidence_refuse_deg];
        let first = given.into_iter().flatten().next();
        Err(ConfigError::Contradiction {
            spot: text.spot(&first.map_or(0..0, Spanned::span)),
            what: format!(
                "The incidence limits note {:.1}, warn {:.1}, refuse {:.1} deg are not in rising order.",
                limits.note.to_degrees(),
                limits.warn.to_degrees(),
                limits.refuse.to_degrees()
            ),
            remedy: "Order them: note, warn, refuse, each at least as large as the one before.".into(),
        })
    }
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct OutputKeys {
    dxf: Option<DxfVersion>,
    comments: Option<bool>,
}

impl OutputKeys {
    pub(super) fn apply(self, to: &mut JobSettings) {
        to.output.dxf = self.dxf.unwrap_or(to.output.dxf);
        to.output.comments = self.comments.unwrap_or(to.output.comments);
    }
}
