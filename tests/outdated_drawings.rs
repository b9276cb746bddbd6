//! The text that is hashed to find out whether a delivered drawing is outdated changes exactly when the drawing
//! changes.

#![allow(clippy::unwrap_used, reason = "a test may fail loudly, its helpers too")]

use std::collections::BTreeMap;

use isomark::config::{
    Aim, Align, Anchor, DxfVersion, Field, FieldOrigin, FloaterWeights, JobSettings, Losses, Method,
    OutsideMark, Vertices, ViewSource, Weighting, canonical,
};
use isomark::formats::mesh::{LengthUnit, PartFile, UpAxis};
use isomark::formats::pattern::DrawingUnit;
use isomark::geometry::mapping::mapping_domain::AsPrinted;
use isomark::geometry::optics::Lens;
use isomark::geometry::primitive::Primitive;
use isomark::geometry::space::{Facing, FieldPoint, FlatPoint, MarkingFrame, ViewPoint};
use isomark::geometry::surface::scan::Smoothing;
use isomark::pipeline::{LearnedPart, PatternInput, Pipeline};
use nalgebra::Vector3;

/// Changes some settings.
type Setting = fn(&mut JobSettings);

/// A bowl that is not developable, mm, with heights from a formula.
fn part() -> String {
    let mut text = String::new();
    for row in -20..=20 {
        for column in -20..=20 {
            let (x, y) = (f64::from(column), f64::from(row));
            text += &format!("v {x} {y} {:.6}\n", 0.012 * x * x + 0.006 * y * y + 0.0004 * x * y);
        }
    }
    for row in 0..40 {
        for column in 0..40 {
            let first = row * 41 + column + 1;
            text += &format!("f {first} {} {} {}\n", first + 1, first + 42, first + 41);
        }
    }
    text
}

/// Points of a bowl with ripples.
fn scan() -> String {
    let mut text = String::new();
    for row in -40..=40 {
        for column in -40..=40 {
            let (x, y) = (f64::from(column) * 0.5, f64::from(row) * 0.5);
            text += &format!("{x} {y} {:.6}\n", 0.012 * x * x + 0.006 * y * y + 0.05 * (1.5 * x).sin());
        }
    }
    text
}

/// A drawing without a unit: two pieces that nearly meet on MARK, and a curve on CUT.
fn dxf() -> String {
    let line = |layer: &str, [x, y, to_x, to_y]: [f64; 4]| {
        format!("0\nLINE\n8\n{layer}\n10\n{x}\n20\n{y}\n11\n{to_x}\n21\n{to_y}\n")
    };
    let entities = [
        line("MARK", [-6.0, -5.0, 7.0, -4.0]),
        line("MARK", [7.01, -4.0, 7.0, 6.0]),
        "0\nCIRCLE\n8\nCUT\n10\n-1\n20\n2\n40\n4\n".into(),
    ];
    format!("0\nSECTION\n2\nENTITIES\n{}0\nENDSEC\n0\nEOF\n", entities.concat())
}

/// A picture of 8 x 8 pixels, 24 bit: grey steps with a dark square.
fn bmp() -> Vec<u8> {
    let size = 54 + 8 * 24;
    let mut bytes = b"BM".to_vec();
    for word in [size, 0, 54, 40, 8, 8, 1 | 24 << 16, 0, 8 * 24, 0, 0, 0, 0] {
        bytes.extend((word as u32).to_le_bytes());
    }
    for row in 0..8 {
        for column in 0..8 {
            let is_dark = (2..6).contains(&row) && (2..5).contains(&column);
            let value = if is_dark { 10 } else { 130 + 15 * column };
            bytes.extend([value as u8; 3]);
        }
    }
    bytes
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Pattern {
    Dxf,
    Picture,
}

/// Corrects drawings for the part, and keeps its surfaces.
struct Bench {
    pipeline: Pipeline,
    surfaces: BTreeMap<(bool, String), LearnedPart>,
}

impl Bench {
    fn drawing(&mut self, settings: &JobSettings, pattern: Pattern) -> Vec<u8> {
        let sku = "bowl".parse().unwrap();
        let is_scan = settings.part.smoothing != Smoothing::Auto;
        let surface = self.surfaces.entry((is_scan, format!("{:?}", settings.part))).or_insert_with(|| {
            if settings.part.primitive.is_some() {
                let known = Pipeline::new(None).recall(&sku, &settings.part, &mut Vec::new());
                return known.unwrap().unwrap();
            }
            let part = match is_scan {
                true => PartFile::alone("bowl.xyz", scan()),
                false => PartFile::alone("bowl.obj", part()),
            };
            self.pipeline.learn(&sku, &part, &settings.part).unwrap()
        });
        let (name, bytes) = match pattern {
            Pattern::Dxf => ("logo.dxf", dxf().into_bytes()),
            Pattern::Picture => ("logo.bmp", bmp()),
        };
        let input = PatternInput { name, bytes: &bytes, previous: None };
        self.pipeline.correct(&sku, surface, input, settings, false).unwrap().dxf
    }
}

fn usual(settings: &mut JobSettings) {
    settings.part.unit = Some(LengthUnit::Millimetre);
    settings.part.up = Some(UpAxis::Z);
    // The drawing must not depend on guesses of a reader.
    settings.pattern.unit_if_unitless = Some(DrawingUnit::Millimetre);
    settings.correction.tolerance = 0.02;
}

fn perspective(settings: &mut JobSettings) {
    settings.optics.lens = Lens::Perspective { x: 163.0, y: 172.0 };
}

fn in_a_field(settings: &mut JobSettings, width: f64, height: f64, origin: FieldOrigin) {
    settings.field = Some(Field { width, height, origin });
}

fn at_a_corner(settings: &mut JobSettings) {
    perspective(settings);
    in_a_field(settings, 110.0, 90.0, FieldOrigin::Corner);
    (settings.fixture.x, settings.fixture.y) = (50.0, 40.0);
}

/// Gives the part's top a marking frame with this origin.
fn framed(settings: &mut JobSettings, origin: [f64; 3]) {
    settings.part = settings.part.framed(MarkingFrame::upright(origin.into(), Facing::TOP));
}

fn nothing(_: &mut JobSettings) {}

#[test]
fn the_hashed_text_changes_exactly_when_the_drawing_changes() {
    use Pattern::{Dxf, Picture};
    let picture: Setting = |s| s.pattern.picture.width = Some(12.0);
    let mapping: Setting = |s| {
        s.correction.method = Method::MappingDomain;
        let domain = &mut s.correction.mapping_domain;
        (domain.grid, domain.intervals) = (6, 4);
    };
    let finer_mapping: Setting = |s| {
        s.correction.method = Method::MappingDomain;
        let domain = &mut s.correction.mapping_domain;
        (domain.grid, domain.intervals) = (20, 4);
    };
    let floater: Setting = |s| s.correction.method = Method::Floater;
    let different: Vec<(&str, Pattern, Setting, Setting)> = vec![
        ("facing", Dxf, nothing, |s| {
            s.part.facing = Facing::towards(Vector3::new(0.1, 0.0, 1.0)).unwrap();
        }),
        ("roll", Dxf, nothing, |s| s.part.roll = 0.3),
        ("frame", Dxf, nothing, |s| framed(s, [1.0, -2.0, 5.0])),
        ("frame's place", Dxf, |s| framed(s, [1.0, -2.0, 5.0]), |s| framed(s, [1.0, -1.0, 5.0])),
        ("unit", Dxf, |s| s.placement.rotate = 0.1, |s| s.part.unit = Some(LengthUnit::Centimetre)),
        (
            "smoothing",
            Dxf,
            |s| s.part.smoothing = Smoothing::None,
            |s| {
                s.part.smoothing = Smoothing::LowPass { wavelength: 8.0 };
            },
        ),
        (
            "primitive",
            Dxf,
            |s| s.part.primitive = Primitive::new(60.0, 60.0, 90.0, Vector3::y()),
            |s| {
                s.part.primitive = Primitive::new(60.0, 62.0, 90.0, Vector3::y());
            },
        ),
        (
            "axis",
            Dxf,
            |s| s.part.primitive = Primitive::new(60.0, 60.0, 90.0, Vector3::y()),
            |s| {
                s.part.primitive = Primitive::new(60.0, 60.0, 90.0, Vector3::new(0.2, 1.0, 0.0));
            },
        ),
        ("unit_if_unitless", Dxf, nothing, |s| s.pattern.unit_if_unitless = Some(DrawingUnit::Pixel96)),
        ("ink_layers", Dxf, nothing, |s| s.pattern.ink_layers = Some(vec!["CUT".into()])),
        ("joining_tolerance", Dxf, nothing, |s| s.pattern.joining_tolerance = 0.05),
        ("strict", Dxf, |s| s.pattern.joining_tolerance = 0.05, |s| s.pattern.strict = true),
        ("picture.width", Picture, picture, |s| s.pattern.picture.width = Some(13.0)),
        ("picture.height", Picture, picture, |s| s.pattern.picture.height = Some(9.0)),
        ("picture.threshold", Picture, picture, |s| s.pattern.picture.threshold = 0.6),
        ("picture.inverted", Picture, picture, |s| s.pattern.picture.inverted = true),
        ("place", Dxf, nothing, |s| s.placement.place = Some(ViewPoint::new(1.0, -2.0))),
        ("anchor", Dxf, |s| s.placement.rotate = 0.5, |s| s.placement.anchor = Anchor::Origin),
        (
            "anchor at",
            Dxf,
            |s| s.placement.rotate = 0.5,
            |s| {
                s.placement.anchor = Anchor::At(FlatPoint::new(2.0, 1.0));
            },
        ),
        ("rotate", Dxf, nothing, |s| s.placement.rotate = 0.5),
        (
            "align",
            Dxf,
            |s| s.part.primitive = Primitive::new(60.0, 60.0, 90.0, Vector3::new(0.2, 1.0, 0.0)),
            |s| s.placement.align = Align::Axis,
        ),
        ("method", Dxf, nothing, |s| s.correction.method = Method::None),
        ("weighting", Dxf, nothing, |s| s.correction.weighting = Weighting::Uniform),
        ("aim", Dxf, nothing, |s| s.correction.aim = Aim::Shapes),
        ("length_weight", Dxf, nothing, |s| s.correction.length_weight = 4.0),
        ("angle_weight", Dxf, nothing, |s| s.correction.angle_weight = 4.0),
        ("floater_weights", Dxf, floater, |s| s.correction.floater_weights = FloaterWeights::MeanValue),
        ("grid", Dxf, mapping, |s| s.correction.mapping_domain.grid = 7),
        ("intervals", Dxf, mapping, |s| s.correction.mapping_domain.intervals = 2),
        ("sample_step", Dxf, mapping, |s| s.correction.mapping_domain.sample_step = 3.0),
        ("simpson_weights", Dxf, mapping, |s| s.correction.mapping_domain.as_printed = AsPrinted::SIMPSON),
        ("diagonal_sums", Dxf, finer_mapping, |s| {
            s.correction.mapping_domain.as_printed.diagonal_sums = true;
        }),
        ("knot_vectors", Dxf, mapping, |s| s.correction.mapping_domain.as_printed.knot_vectors = true),
        ("tolerance", Dxf, nothing, |s| s.correction.tolerance = 0.005),
        ("vertices", Dxf, nothing, |s| s.correction.vertices = Vertices::Keep),
        ("fixture.x", Dxf, nothing, |s| s.fixture.x = 1.0),
        ("fixture.y", Dxf, nothing, |s| s.fixture.y = 1.0),
        ("fixture.z", Dxf, perspective, |s| s.fixture.z = 1.0),
        ("fixture.rotation", Dxf, nothing, |s| s.fixture.rotation = 0.4),
        ("lens", Dxf, nothing, perspective),
        ("lens y", Dxf, perspective, |s| s.optics.lens = Lens::Perspective { x: 163.0, y: 180.0 }),
        ("axis_mm", Dxf, perspective, |s| s.optics.axis = Some(FieldPoint::new(5.0, 0.0))),
        ("centre of the field", Dxf, at_a_corner, |s| in_a_field(s, 114.0, 90.0, FieldOrigin::Corner)),
        ("dxf", Dxf, nothing, |s| s.output.dxf = DxfVersion::R12),
        ("comments", Dxf, nothing, |s| s.output.comments = false),
    ];
    let same: Vec<(&str, Pattern, Setting, Setting)> = vec![
        ("losses", Dxf, nothing, |s| s.pattern.losses = Losses::Warn),
        ("outside_mark", Dxf, nothing, |s| s.placement.outside_mark = OutsideMark::Warn),
        ("max_residual", Dxf, nothing, |s| s.correction.max_residual = 0.3),
        ("focus_depth", Dxf, nothing, |s| s.optics.focus_depth = Some(0.1)),
        ("incidence", Dxf, nothing, |s| {
            let limits = &mut s.optics.incidence;
            (limits.note, limits.warn, limits.refuse) = (0.01, 0.02, 1.3);
        }),
        ("field", Dxf, nothing, |s| in_a_field(s, 110.0, 90.0, FieldOrigin::Center)),
        ("field under a lens", Dxf, perspective, |s| in_a_field(s, 110.0, 90.0, FieldOrigin::Center)),
        ("fixture.z under a telecentric lens", Dxf, nothing, |s| s.fixture.z = 3.0),
        ("whether the lens is stated", Dxf, nothing, |s| s.optics.lens_is_assumed = false),
        ("axis of a telecentric lens", Dxf, nothing, |s| s.optics.axis = Some(FieldPoint::new(5.0, 0.0))),
        (
            "order and case of layers",
            Dxf,
            |s| s.pattern.ink_layers = Some(vec!["mark".into(), "cut".into()]),
            |s| {
                s.pattern.ink_layers = Some(vec!["CUT".into(), "Mark".into()]);
            },
        ),
        ("depth of a frame", Dxf, |s| framed(s, [1.0, -2.0, 5.0]), |s| framed(s, [1.0, -2.0, 9.0])),
        ("where sides come from", Dxf, nothing, |s| s.part.view_source = ViewSource::Sides),
        ("where a place comes from", Dxf, nothing, |s| s.placement.is_place_given = true),
        ("facing of the same direction", Dxf, nothing, |s| {
            s.part.facing = Facing::towards(Vector3::new(0.0, -0.0, 3.0)).unwrap();
        }),
    ];
    let mut bench = Bench { pipeline: Pipeline::new(None), surfaces: BTreeMap::new() };
    let mut wrong = Vec::new();
    for (cases, differ) in [(different, true), (same, false)] {
        for (name, pattern, before, change) in cases {
            let mut first = JobSettings::default();
            usual(&mut first);
            before(&mut first);
            let mut second = first.clone();
            change(&mut second);
            let drawings = [&first, &second].map(|settings| bench.drawing(settings, pattern));
            let texts = [&first, &second].map(canonical::drawing);
            if (drawings[0] != drawings[1], texts[0] != texts[1]) != (differ, differ) {
                wrong.push((name, drawings[0] != drawings[1], texts));
            }
        }
    }
    assert!(wrong.is_empty(), "(setting, whether the drawing differs, the texts): {wrong:#?}");
}
