use nalgebra::{Vector2, Vector3};

use super::*;
use crate::config::{
    BadRows, Converter, Field, FieldOrigin, IncidenceLimits, Losses, OutsideMark, SerialSettings,
    ShiftSettings, TilesAs,
};
use crate::formats::mesh::{LengthUnit, NormalsChoice, UpAxis};
use crate::formats::pattern::{DrawingUnit, Space};
use crate::geometry::sensitivity::PoseUncertainty;
use crate::geometry::space::{FlatPoint, MarkingFrame, ViewPoint};

/// The digits are those that Python's `struct.pack(">d", value).hex()` gives.
const EVERYTHING: &str = "\
part.facing 3fe3333333333333 bfe999999999999a 0000000000000000
part.roll_rad 3fb999999999999a
part.unit inch
part.up y
part.low_pass_mm 4004000000000000
part.diameters_and_length_mm 404e000000000000 4055400000000000 405e000000000000
part.axis 0000000000000000 3ff0000000000000 0000000000000000
pattern.unit_if_unitless in
pattern.ink_layers 2 7:cut 2:x 7:schr\u{e4}g
pattern.picture_width_mm 4044000000000000
pattern.picture_height_mm 4034000000000000
pattern.picture_threshold 3fd0000000000000
pattern.picture_inverted true
pattern.joining_mm 3fa999999999999a
pattern.strict true
pattern.strokes band
pattern.hairline_mm 3fb999999999999a
pattern.space paper 7:sheet a
placement.place_mm 4029000000000000 c008000000000000
placement.anchor_mm 3ff0000000000000 4000000000000000
placement.rotate_rad bfe0000000000000
placement.align axis
correction.method mapping-domain
correction.weighting uniform
correction.aim shapes
correction.floater_weights mean-value
correction.mapping_domain_grid 12
correction.mapping_domain_intervals 8
correction.mapping_domain_sample_step_mm 3ff0000000000000
correction.mapping_domain_simpson_weights_as_printed true
correction.mapping_domain_diagonal_sums_as_printed true
correction.mapping_domain_knot_vectors_as_printed true
correction.length_weight 4000000000000000
correction.angle_weight 3fe0000000000000
correction.tolerance_mm 3f747ae147ae147b
correction.vertices keep
fill.spacing_mm 3fa999999999999a
fill.angle_rad 3fe0000000000000
fill.second_angle_rad 4000000000000000
fill.border_mm 3fb999999999999a
fill.layers 1 4:text
content.code 2:dm data-matrix 11:{serial:06} 2 true true
content.serial 17
content.date 2026-11-23T14:05:00
content.shift 4:late
content.csv 3:LOT 2:A7
focus.steps layers
focus.step_mm 3ff8000000000000
focus.overlap_mm 3fc999999999999a
rotary.tiles 5
rotary.overlap_mm 3fe0000000000000
rotary.max_tile_rad 3ff8000000000000
rotary.reverse true
rotary.incidence_rad 3fc999999999999a 3fd3333333333333
rotary.focus_depth_mm 4008000000000000
rotary.field_mm 0000000000000000 0000000000000000 405b800000000000 4056800000000000
fixture.x_mm 3ff0000000000000
fixture.y_mm c04e000000000000
fixture.z_mm 4010000000000000
fixture.rotation_rad 3fc999999999999a
optics.lens_distances_mm 4064600000000000 4065800000000000
optics.axis_mm 404b800000000000 4046800000000000
output.dxf R12-lines
output.comments false
";

/// Every setting with another value than the usual one.
pub(crate) fn everything() -> JobSettings {
    JobSettings {
        part: PartSettings {
            facing: Facing::towards(Vector3::new(0.6, -0.8, 0.0)).unwrap(),
            roll: 0.1,
            view_source: ViewSource::Sides,
            unit: Some(LengthUnit::Inch),
            up: Some(UpAxis::Y),
            normals: NormalsChoice::Auto,
            bridge: None,
            smoothing: Smoothing::LowPass { wavelength: 2.5 },
            converter: Converter::None,
            primitive: Primitive::new(60.0, 85.0, 120.0, Vector3::y()),
        },
        pattern: PatternSettings {
            unit_if_unitless: Some(DrawingUnit::Inch),
            ink_layers: Some(vec!["Schr\u{c4}g".into(), "cut 2:x".into(), "schr\u{e4}g".into()]),
            picture: RasterOptions { width: Some(40.0), height: Some(20.0), threshold: 0.25, inverted: true },
            joining_tolerance: 0.05,
            overlap: 3.0,
            strict: true,
            losses: Losses::Warn,
            strokes: StrokesChoice::Band,
            hairline: 0.1,
            space: Space::Paper(Some("Sheet A".into())),
        },
        placement: Placement {
            place: Some(ViewPoint::new(12.5, -3.0)),
            is_place_given: true,
            anchor: Anchor::At(FlatPoint::new(1.0, 2.0)),
            rotate: -0.5,
            align: Align::Axis,
            outside_mark: OutsideMark::Warn,
        },
        correction: CorrectionSettings {
            method: Method::MappingDomain,
            weighting: Weighting::Uniform,
            aim: Aim::Shapes,
            floater_weights: FloaterWeights::MeanValue,
            mapping_domain: MappingDomainOptions {
                grid: 12,
                intervals: 8,
                sample_step: 1.0,
                as_printed: AsPrinted::EVERYTHING,
            },
            length_weight: 2.0,
            angle_weight: 0.5,
            tolerance: 0.005,
            vertices: Vertices::Keep,
            max_residual: 0.2,
        },
        fill: FillSettings {
            spacing: Some(0.05),
            angle: 0.5,
            second_angle: Some(2.0),
            border: 0.1,
            layers: Some(vec!["TEXT".into()]),
        },
        content: ContentSettings {
            values: crate::formats::pattern::Content {
                serial: Some(17),
                date: Some("2026-11-23T14:05".parse().unwrap()),
                row: [("LOT".to_owned(), "A7".to_owned())].into(),
                ..Default::default()
            },
            serial: SerialSettings { start: 5, step: 2, last: Some(99) },
            shifts: vec![ShiftSettings { name: "late".into(), from: 840 }],
            codes: vec![CodeSettings {
                placeholder: Placeholder::Layer("DM".into()),
                kind: crate::formats::code::Kind::DataMatrix,
                content: "{serial:06}".into(),
                quiet_zone: Some(2),
                is_inverted: true,
                is_rectangular: true,
            }],
            bad_rows: BadRows::Skip,
        },
        focus: FocusSettings { steps: FocusSteps::Layers, step: Some(1.5), overlap: 0.2 },
        rotary: Rotary {
            tiles: Tiles::Count(5),
            overlap: 0.5,
            max_tile: Some(1.5),
            written_as: TilesAs::Files,
            is_reversed: true,
        },
        fixture: Fixture { x: 1.0, y: -60.0, z: 4.0, rotation: 0.2 },
        pose_uncertainty: PoseUncertainty { sideways: 0.1, height: 0.2, turn: 0.01 },
        optics: Optics {
            lens_is_assumed: true,
            lens: Lens::Perspective { x: 163.0, y: 172.0 },
            axis: None,
            focus_depth: Some(3.0),
            spot: Some(0.05),
            shadow: 2.0,
            incidence: IncidenceLimits { note: 0.1, warn: 0.2, refuse: 0.3 },
        },
        field: Some(Field { width: 110.0, height: 90.0, origin: FieldOrigin::Corner }),
        output: Output { dxf: DxfVersion::R12Lines, comments: false },
    }
}

/// A change here makes every station deliver its whole archive again, if it is set up to correct what is outdated.
#[test]
fn the_text_of_every_setting_is_pinned() {
    assert_eq!(drawing(&JobSettings::default()), "");
    assert_eq!(drawing(&everything()), EVERYTHING);
    // The surface is shaped by the part's settings, and named anew by nothing else.
    let part = EVERYTHING.split("pattern.").next().unwrap();
    assert_eq!(surface(&everything().part, &FitOptions::default()), part);
    assert_eq!(surface(&PartSettings::default(), &FitOptions::default()), "");
    let mut fit = FitOptions::default();
    (fit.tolerance, fit.first_spans, fit.most_spans) = (0.003, 36, 128);
    assert_eq!(
        surface(&PartSettings::default(), &fit),
        "fit.tolerance_mm 3f689374bc6a7efa\nfit.first_spans 36\nfit.most_spans 128\n"
    );
    let sizes = part.split("part.low_pass_mm 4004000000000000\n").nth(1).unwrap();
    assert_eq!(primitive(&everything().part.primitive.unwrap()), sizes);
}

/// A new setting is a mistake of the compiler's here until it is written out, or left out with a reason.
#[test]
fn every_setting_is_named() {
    assert!(!include_str!("../canonical.rs").contains(".."), "a pattern that skips fields");
}

/// The names in the text are those that people write, which must not change either.
#[test]
fn the_names_in_the_text_are_pinned() {
    let methods = ["auto", "isometric", "cylinder", "cone", "mapping-domain", "floater", "none"];
    assert_eq!(Method::NAMES, methods);
    assert_eq!(Align::NAMES, ["view", "axis"]);
    assert_eq!(Weighting::NAMES, ["ink", "uniform"]);
    assert_eq!(Aim::NAMES, ["balanced", "lengths", "areas", "shapes"]);
    assert_eq!(FloaterWeights::NAMES, ["uniform", "mean-value"]);
    assert_eq!(Vertices::NAMES, ["adaptive", "keep"]);
    assert_eq!(DxfVersion::NAMES, ["R2000", "R12", "R12-lines"]);
    let line = |change: fn(&mut JobSettings, &str), word: &str| {
        let mut settings = JobSettings::default();
        change(&mut settings, word);
        drawing(&settings)
    };
    for unit in ["mm", "cm", "dm", "m", "inch"] {
        let text = line(|settings, word| settings.part.unit = Some(word.parse().unwrap()), unit);
        assert_eq!(text, format!("part.unit {unit}\n"));
    }
    for up in ["y", "z"] {
        let text = line(|settings, word| settings.part.up = Some(word.parse().unwrap()), up);
        assert_eq!(text, format!("part.up {up}\n"));
    }
    for normals in ["file", "facets", "estimate"] {
        let text = line(|settings, word| settings.part.normals = word.parse().unwrap(), normals);
        assert_eq!(text, format!("part.normals {normals}\n"));
    }
    let text = line(|settings, _| settings.part.bridge = Some(3.5), "");
    assert_eq!(text, "part.bridge_mm 400c000000000000\n");
    let units = ["nm", "um", "mm", "cm", "dm", "m", "km", "uin", "mil", "in", "ft", "yd", "mi", "px", "pt"];
    for unit in units {
        let text =
            line(|settings, word| settings.pattern.unit_if_unitless = Some(word.parse().unwrap()), unit);
        assert_eq!(text, format!("pattern.unit_if_unitless {unit}\n"));
    }
    let frame = |settings: &mut JobSettings, _: &str| {
        let origin = nalgebra::Point3::new(0.0, -36.5, 60.0);
        let facing = Facing::towards(-Vector3::y()).unwrap();
        settings.part = settings.part.framed(MarkingFrame::upright(origin, facing));
    };
    let text = "part.facing 0000000000000000 bff0000000000000 0000000000000000\n\
                part.frame_place_mm 0000000000000000 404e000000000000\n";
    assert_eq!(line(frame, ""), text);
    let text = line(|settings, _| settings.part.smoothing = Smoothing::None, "");
    assert_eq!(text, "part.smoothing none\n");
    let text = line(|settings, _| settings.part.converter = Converter::FreeCad, "");
    assert_eq!(text, "part.converter freecad\n");
    let text = line(|settings, _| settings.placement.anchor = Anchor::Origin, "");
    assert_eq!(text, "placement.anchor origin\n");
    let text = line(|settings, _| settings.pattern.ink_layers = Some(Vec::new()), "");
    assert_eq!(text, "pattern.ink_layers 0\n");
}

#[test]
fn what_is_the_same_has_one_text() {
    let mut settings = everything();
    settings.pattern.ink_layers = Some(vec!["CUT 2:X".into(), "SCHR\u{c4}G".into()]);
    // The middle of a field of this size, seen from its corner. Only a mark in tiles depends on the field itself.
    settings.field = None;
    settings.rotary = Rotary::default();
    settings.optics.axis = Some(Vector2::new(55.0, 45.0).into());
    let lines = EVERYTHING.lines().filter(|line| !line.starts_with("rotary."));
    assert_eq!(drawing(&settings), lines.map(|line| format!("{line}\n")).collect::<String>());
    let mut settings = JobSettings::default();
    settings.placement.rotate = -0.0;
    settings.fixture.x = -0.0;
    assert_eq!(drawing(&settings), "");
    settings.placement.place = Some(ViewPoint::new(-0.0, 0.0));
    assert_eq!(drawing(&settings), "placement.place_mm 0000000000000000 0000000000000000\n");
}

/// A name of a layer may be anything.
#[test]
fn different_layers_have_different_texts() {
    let text = |names: &[&str]| {
        let mut settings = JobSettings::default();
        settings.pattern.ink_layers = Some(names.iter().map(|name| name.to_string()).collect());
        drawing(&settings)
    };
    let layers: [&[&str]; 8] =
        [&[], &[""], &["a b"], &["a", "b"], &["a", "1:b"], &["a 1:b"], &["a\n"], &["a\npattern.strict true"]];
    for (index, one) in layers.iter().enumerate() {
        for other in &layers[..index] {
            assert_ne!(text(one), text(other), "{one:?} {other:?}");
        }
    }
}
