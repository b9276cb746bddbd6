//! Settings as text that stays the same from version to version: the keys of kept surfaces and the marks by which a
//! delivered drawing is recognised as outdated are hashes of it.
//!
//! ```text
//! placement.place_mm 4014000000000000 c000000000000000
//! pattern.ink_layers 2 3:cut 7:engrave
//! ```
//!
//! One line for each setting, in the order of this file: key with its unit, a space, the value. A setting is written only
//! where its value differs from the one written here beside it, so a new setting that changes nothing by default leaves
//! every text as it was. Those values are fixed here on purpose: if a default of the program changes, the drawings
//! change, and the text with them. Numbers are the 16 hexadecimal digits of their IEEE 754 double, lengths in mm, angles in rad;
//! names that people choose follow their length in bytes.
//!
//! Any other change to these texts makes stations deliver their archives again. If it is necessary, raise [`VERSION`] with it:
//! drawings that were delivered under an older form are then treated as up to date.

use std::fmt::Write;

use super::choices::{
    Aim, Align, Converter, DxfVersion, FloaterWeights, FocusSteps, Method, StrokesChoice, Vertices, Weighting,
};
use super::content::{CodeSettings, ContentSettings, Placeholder};
use super::fill::{FillSettings, FocusSettings};
use super::settings::{
    Anchor, CorrectionSettings, JobSettings, Optics, Output, PartSettings, PatternSettings, Placement,
    Rotary, Tiles, ViewSource,
};
use crate::formats::mesh::NormalsChoice;
use crate::formats::pattern::{RasterOptions, Space};
use crate::geometry::mapping::mapping_domain::{AsPrinted, MappingDomainOptions};
use crate::geometry::optics::{Fixture, Lens};
use crate::geometry::primitive::Primitive;
use crate::geometry::space::Facing;
use crate::geometry::surface::fit::FitOptions;
use crate::geometry::surface::scan::Smoothing;

/// The version of these texts. The first one was not written out.
pub const VERSION: u32 = 2;

/// What shapes the surface that is fitted to a part, besides the part itself.
#[must_use]
pub fn surface(settings: &PartSettings, fit: &FitOptions) -> String {
    let mut text = Text::default();
    text.part(settings);
    text.fit(fit);
    text.0
}

/// What shapes the surface of a part whose file contains a marking frame.
#[must_use]
pub fn surface_of_framed_part(settings: &PartSettings, fit: &FitOptions) -> String {
    let mut text = Text(surface(settings, fit));
    text.word("part.frame", settings.leaves_view_to_file().then_some("of-file"));
    text.0
}

/// What shapes a cylinder or cone that is given by its sizes.
#[must_use]
pub fn primitive(primitive: &Primitive) -> String {
    let mut text = Text::default();
    text.primitive(primitive);
    text.0
}

/// What shapes a corrected drawing, besides part and pattern. Settings that only decide whether there is a drawing, or only
/// change its report, are left out: the delivered drawing would be the same. The fit is left out like the program's version.
#[must_use]
pub fn drawing(settings: &JobSettings) -> String {
    let JobSettings {
        part,
        pattern,
        placement,
        correction,
        fill,
        content,
        focus,
        rotary,
        fixture,
        // It is reported.
        pose_uncertainty: _,
        optics,
        // Its size is only a limit; its middle is part of the lens' axis.
        field: _,
        output,
    } = settings;
    let mut text = Text::default();
    text.part(part);
    text.pattern(pattern);
    text.frame(part);
    text.placement(placement);
    text.correction(correction);
    text.fill(fill);
    text.content(content);
    text.focus(focus, optics);
    text.rotary(rotary, settings);
    text.fixture(fixture, &optics.lens);
    text.optics(optics, settings);
    text.output(output);
    text.0
}

#[derive(Default)]
struct Text(String);

impl Text {
    fn part(&mut self, settings: &PartSettings) {
        let PartSettings {
            facing,
            roll,
            // The directions of a frame are `facing` and `roll`. Whether the one in the part's file is used is part of the
            // surface's key and of the part's identity; the origin of the settings' one is written with the placement.
            view_source: _,
            unit,
            up,
            normals,
            bridge,
            smoothing,
            converter,
            primitive,
        } = settings;
        if *facing != Facing::TOP {
            self.numbers("part.facing", facing.direction().into());
        }
        self.number("part.roll_rad", *roll, 0.0);
        self.word("part.unit", unit.map(|unit| unit.to_string()));
        self.word("part.up", up.map(|up| up.to_string()));
        self.word("part.normals", (*normals != NormalsChoice::Auto).then_some(normals));
        self.optional("part.bridge_mm", *bridge);
        match smoothing {
            Smoothing::Auto => {}
            Smoothing::LowPass { wavelength } => self.numbers("part.low_pass_mm", [*wavelength]),
            Smoothing::None => self.word("part.smoothing", Some("none")),
        }
        self.word("part.converter", (*converter != Converter::None).then_some(converter));
        if let Some(primitive) = primitive {
            self.primitive(primitive);
        }
    }

    fn primitive(&mut self, primitive: &Primitive) {
        self.numbers("part.diameters_and_length_mm", primitive.sizes());
        self.numbers("part.axis", (*primitive.axis()).into());
    }

    fn fit(&mut self, options: &FitOptions) {
        let (tolerance, first_spans, most_spans) = options.values();
        self.number("fit.tolerance_mm", tolerance, 0.002);
        self.count("fit.first_spans", first_spans, 72);
        self.count("fit.most_spans", most_spans, 256);
    }

    fn pattern(&mut self, settings: &PatternSettings) {
        let PatternSettings {
            unit_if_unitless,
            ink_layers,
            picture,
            joining_tolerance,
            // It makes the report warn.
            overlap: _,
            strict,
            // It decides whether there is a drawing.
            losses: _,
            strokes,
            hairline,
            space,
        } = settings;
        self.word("pattern.unit_if_unitless", unit_if_unitless.map(|unit| unit.to_string()));
        self.layers("pattern.ink_layers", ink_layers.as_ref());
        let RasterOptions { width, height, threshold, inverted } = picture;
        self.optional("pattern.picture_width_mm", *width);
        self.optional("pattern.picture_height_mm", *height);
        self.number("pattern.picture_threshold", *threshold, 0.5);
        self.flag("pattern.picture_inverted", *inverted, false);
        self.number("pattern.joining_mm", *joining_tolerance, 0.002);
        self.flag("pattern.strict", *strict, false);
        self.word("pattern.strokes", (*strokes != StrokesChoice::Center).then_some(strokes));
        self.number("pattern.hairline_mm", *hairline, 0.05);
        let space = match space {
            Space::Model => None,
            Space::Paper(None) => Some("paper".to_owned()),
            // Sheets are compared without regard to case.
            Space::Paper(Some(name)) => {
                Some(format!("paper {}:{}", name.to_lowercase().len(), name.to_lowercase()))
            }
        };
        self.word("pattern.space", space);
    }

    fn layers(&mut self, key: &str, names: Option<&Vec<String>>) {
        let Some(names) = names else { return };
        // Layers are compared without regard to case, and in any order.
        let mut names: Vec<String> = names.iter().map(|name| name.to_lowercase()).collect();
        names.sort();
        names.dedup();
        let counted: String = names.iter().map(|name| format!(" {}:{name}", name.len())).collect();
        self.word(key, Some(format!("{}{counted}", names.len())));
    }

    fn frame(&mut self, settings: &PartSettings) {
        if let ViewSource::Frame(frame) = &settings.view_source {
            // How far the origin is from the laser changes nothing.
            self.numbers("part.frame_place_mm", frame.place().coords().into());
        }
    }

    fn placement(&mut self, settings: &Placement) {
        let Placement {
            place,
            // It takes effect only with a frame in the part's file, and is then part of the part's identity.
            is_place_given: _,
            anchor,
            rotate,
            align,
            // It decides whether there is a drawing.
            outside_mark: _,
        } = settings;
        if let Some(place) = place {
            self.numbers("placement.place_mm", place.coords().into());
        }
        match anchor {
            Anchor::Center => {}
            Anchor::Origin => self.word("placement.anchor", Some("origin")),
            Anchor::At(point) => self.numbers("placement.anchor_mm", point.coords().into()),
        }
        self.number("placement.rotate_rad", *rotate, 0.0);
        self.word("placement.align", (*align != Align::View).then_some(align));
    }

    fn correction(&mut self, settings: &CorrectionSettings) {
        let CorrectionSettings {
            method,
            weighting,
            aim,
            floater_weights,
            mapping_domain,
            length_weight,
            angle_weight,
            tolerance,
            vertices,
            // It decides whether there is a drawing.
            max_residual: _,
        } = settings;
        self.word("correction.method", (*method != Method::Auto).then_some(method));
        self.word("correction.weighting", (*weighting != Weighting::Ink).then_some(weighting));
        self.word("correction.aim", (*aim != Aim::Balanced).then_some(aim));
        let is_given = *floater_weights != FloaterWeights::Uniform;
        self.word("correction.floater_weights", is_given.then_some(floater_weights));
        self.mapping_domain(mapping_domain);
        self.number("correction.length_weight", *length_weight, 1.0);
        self.number("correction.angle_weight", *angle_weight, 1.0);
        self.number("correction.tolerance_mm", *tolerance, 0.01);
        self.word("correction.vertices", (*vertices != Vertices::Adaptive).then_some(vertices));
    }

    /// Only a mark round the part depends on the limits of the laser: they decide how it is divided.
    fn rotary(&mut self, rotary: &Rotary, settings: &JobSettings) {
        let Rotary {
            tiles,
            overlap,
            max_tile,
            // A station delivers layers.
            written_as: _,
            is_reversed,
        } = rotary;
        match tiles {
            Tiles::Off => return,
            Tiles::Auto => self.word("rotary.tiles", Some("auto")),
            Tiles::Count(count) => self.word("rotary.tiles", Some(count)),
        }
        self.number("rotary.overlap_mm", *overlap, 0.0);
        self.optional("rotary.max_tile_rad", *max_tile);
        self.flag("rotary.reverse", *is_reversed, false);
        let incidence = &settings.optics.incidence;
        self.numbers("rotary.incidence_rad", [incidence.warn, incidence.refuse]);
        self.optional("rotary.focus_depth_mm", settings.optics.focus_depth);
        if let Some(field) = settings.field.map(|field| field.extents()) {
            self.numbers("rotary.field_mm", [field.min.x, field.min.y, field.max.x, field.max.y]);
        }
    }

    fn mapping_domain(&mut self, options: &MappingDomainOptions) {
        let MappingDomainOptions { grid, intervals, sample_step, as_printed } = options;
        self.count("correction.mapping_domain_grid", *grid, 30);
        self.count("correction.mapping_domain_intervals", *intervals, 50);
        self.number("correction.mapping_domain_sample_step_mm", *sample_step, 2.0);
        let AsPrinted { simpson_weights, diagonal_sums, knot_vectors } = as_printed;
        self.flag("correction.mapping_domain_simpson_weights_as_printed", *simpson_weights, false);
        self.flag("correction.mapping_domain_diagonal_sums_as_printed", *diagonal_sums, false);
        self.flag("correction.mapping_domain_knot_vectors_as_printed", *knot_vectors, false);
    }

    fn fill(&mut self, settings: &FillSettings) {
        let FillSettings { spacing, angle, second_angle, border, layers } = settings;
        // Without a spacing, the others change nothing.
        let Some(spacing) = spacing else { return };
        self.numbers("fill.spacing_mm", [*spacing]);
        self.number("fill.angle_rad", *angle, 0.0);
        self.optional("fill.second_angle_rad", *second_angle);
        self.number("fill.border_mm", *border, 0.0);
        self.layers("fill.layers", layers.as_ref());
    }

    fn content(&mut self, settings: &ContentSettings) {
        let ContentSettings {
            values,
            // They give the serial number and the rows of a list.
            serial: _,
            bad_rows: _,
            // They give the shift of a date.
            shifts: _,
            codes,
        } = settings;
        for code in codes {
            let CodeSettings { placeholder, kind, content, quiet_zone, is_inverted, is_rectangular } = code;
            let (key, place) = match placeholder {
                Placeholder::Layer(name) => ("content.code", name),
                Placeholder::Block(name) => ("content.code_in_block", name),
            };
            let texts = [place.to_lowercase(), content.clone()].map(|text| format!("{}:{text}", text.len()));
            let quiet = quiet_zone.unwrap_or(kind.quiet_zone());
            let line = format!("{} {kind} {} {quiet} {is_inverted} {is_rectangular}", texts[0], texts[1]);
            self.word(key, Some(line));
        }
        self.word("content.serial", values.serial);
        self.word("content.date", values.date);
        let shift = || settings.values_of("").shift;
        self.word("content.shift", shift().map(|shift| format!("{}:{shift}", shift.len())));
        for (column, value) in &values.row {
            self.word("content.csv", Some(format!("{}:{column} {}:{value}", column.len(), value.len())));
        }
    }

    fn focus(&mut self, settings: &FocusSettings, optics: &Optics) {
        let FocusSettings { steps, step, overlap } = settings;
        if *steps == FocusSteps::Off {
            return;
        }
        self.word("focus.steps", Some(steps));
        self.optional("focus.step_mm", step.or(optics.focus_depth));
        self.number("focus.overlap_mm", *overlap, 0.0);
    }

    fn fixture(&mut self, fixture: &Fixture, lens: &Lens) {
        let Fixture { x, y, z, rotation } = fixture;
        self.number("fixture.x_mm", *x, 0.0);
        self.number("fixture.y_mm", *y, 0.0);
        // Under a telecentric lens height has no effect.
        if *lens != Lens::Telecentric {
            self.number("fixture.z_mm", *z, 0.0);
        }
        self.number("fixture.rotation_rad", *rotation, 0.0);
    }

    fn optics(&mut self, optics: &Optics, settings: &JobSettings) {
        let Optics {
            lens,
            // It makes the report note.
            lens_is_assumed: _,
            // The scan head gives it, perhaps as the middle of the field.
            axis: _,
            // It makes the report warn, and is the usual height of a step of focus.
            focus_depth: _,
            // It makes the report warn.
            spot: _,
            // It decides whether there is a drawing.
            shadow: _,
            // They make the report note or warn, or decide whether there is a drawing.
            incidence: _,
        } = optics;
        match lens {
            Lens::Telecentric => {}
            Lens::Perspective { x, y } => {
                self.numbers("optics.lens_distances_mm", [*x, *y]);
                self.numbers("optics.axis_mm", settings.scan_head().axis.coords().into());
            }
            Lens::Measured(lens) => {
                self.word("optics.lens_table", Some(format!("{:016x}", lens.fingerprint())));
            }
        }
    }

    fn output(&mut self, output: &Output) {
        let Output { dxf, comments } = output;
        self.word("output.dxf", (*dxf != DxfVersion::R2000).then_some(dxf));
        self.flag("output.comments", *comments, true);
    }

    /// A line, where there is a value.
    fn word(&mut self, key: &str, value: Option<impl std::fmt::Display>) {
        if let Some(value) = value {
            let _ = writeln!(self.0, "{key} {value}");
        }
    }

    fn flag(&mut self, key: &str, value: bool, usual: bool) {
        self.word(key, (value != usual).then_some(value));
    }

    fn count(&mut self, key: &str, value: usize, usual: usize) {
        self.word(key, (value != usual).then_some(value));
    }

    fn number(&mut self, key: &str, value: f64, usual: f64) {
        self.optional(key, (value != usual).then_some(value));
    }

    fn optional(&mut self, key: &str, value: Option<f64>) {
        if let Some(value) = value {
            self.numbers(key, [value]);
        }
    }

    fn numbers<const COUNT: usize>(&mut self, key: &str, values: [f64; COUNT]) {
        // The sum turns minus zero into zero, which is the same place.
        let digits = values.map(|value| format!("{:016x}", (value + 0.0).to_bits()));
        self.word(key, Some(digits.join(" ")));
    }
}

#[cfg(test)]
pub(crate) mod tests;
