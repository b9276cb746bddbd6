//! The sections of the page, in the order in which people need them.

use std::fmt::Write;

use serde_json::json;

use super::content::{PageContent, Plane};
use super::markup::{Markup, document};
use super::spots::{SpotLabel, Spots, ValueLabels, rounded, to_decimals};
use crate::formats::mesh::MeshFormat;
use crate::geometry::space::View;
use crate::preview::{OnPart, PartSource, PreviewPath, stretch_colors, stretch_range_text};
use crate::reason::{Notice, Severity};
use crate::report::{DistortionReport, FrameReport, FrameSource, MapReport, Report, SensitivityReport};

/// Room for notices, changes, and entities that are not marked, bytes: the rest is in the report in JSON.
const NOTICE_BYTES: usize = 9_000;
const CHANGE_BYTES: usize = 1_500;
const SKIPPED_BYTES: usize = 2_500;

pub(super) fn page(content: &PageContent<'_>) -> String {
    let PageContent { report, on_part, landmarks, .. } = content;
    let mut spots = Spots::default();
    let labels = spots.of_values(landmarks);
    let mut number = 0;
    let notices: Vec<(&Notice, Option<SpotLabel>)> = report
        .notices
        .iter()
        .map(|notice| {
            let label = spots.of_notice(number + 1, notice);
            number += usize::from(label.is_some());
            (notice, label)
        })
        .collect();

    let title = format!("{} on {}", report.pattern.file, report.sku);
    let mut body = Markup::default();
    header(&mut body, &title, report);
    body.raw("<main>\n<div class=\"first\">\n");
    picture(&mut body, content);
    values(&mut body, report, &labels);
    body.raw("</div>\n");
    shown(&mut body, content, &spots);
    body.section("flat", "Flat panels", |body| {
        body.raw(
            "<div class=\"wide\" role=\"group\" tabindex=\"0\" aria-label=\"The drawing on the part before and after the \
             correction, as the laser sees it\">\n",
        );
        // A part of another document has no XML declaration.
        let svg = content.panels.find("<svg").map_or("", |start| &content.panels[start..]);
        body.raw(svg).raw("</div>\n");
    });
    body.section("notices", "Notices", |body| notice_list(body, &notices));
    if let Some(changes) = &report.changes {
        body.section("changes", "Changes from the drawing that this one replaces", |body| {
            let _ = writeln!(
                body,
                "<p>{} of {} paths are unchanged; the older drawing has {}.</p>\n<ul>",
                changes.unchanged, changes.new_paths, changes.old_paths
            );
            let line = |body: &mut Markup, line: &String| {
                body.raw("<li>").text(line).raw("</li>\n");
            };
            body.bounded(&changes.lines, CHANGE_BYTES, line, |body, rest| left_out(body, "li", rest));
            body.raw("</ul>\n");
        });
    }
    body.section("read", "What was read and made", |body| inputs(body, report));
    body.raw("</main>\n");

    let view = [nalgebra::Vector3::x(), nalgebra::Vector3::y(), nalgebra::Vector3::z()];
    let view = view.map(|axis| <[f64; 3]>::from(on_part.view.part_vector(axis)).map(|value| value + 0.0));
    let mut scene = json!({ "view": view, "spots": spots.to_json() });
    let corners = |plane: &Plane| plane.corners.map(rounded);
    if let Some(field) = &landmarks.field {
        scene["field"] = json!(corners(field));
    }
    if let Some(planes) = &landmarks.focus {
        scene["focus"] = json!(planes.each_ref().map(corners));
    }
    document(&title, &body.finished(), &scene, content.glb)
}

/// Adds the number of items that are left out of a list.
fn left_out(body: &mut Markup, element: &str, rest: usize) {
    let _ = writeln!(body, "<{element}>and {rest} more: see the report in JSON</{element}>");
}

fn header(body: &mut Markup, title: &str, report: &Report) {
    let after = &report.quality.after;
    body.raw("<header>\n<h1>").text(title).raw("</h1>\n<p class=\"lead\">");
    let warnings = warnings(report);
    let _ = match warnings {
        0 => write!(body, "<span class=\"chip good\">No warnings</span> "),
        1 => write!(body, "<a class=\"chip warn\" href=\"#h-notices\">1 warning</a> "),
        more => write!(body, "<a class=\"chip warn\" href=\"#h-notices\">{more} warnings</a> "),
    };
    let how = match report.map {
        MapReport::None => "The drawing was not corrected.".to_owned(),
        _ => format!("The drawing was corrected with the method {}.", report.map.method()),
    };
    let without = match &report.quality.before {
        Some(before) => format!("without the correction it would be {:.3} mm", before.length_error_mm),
        None => "without the correction, the drawing would not be completely on the part".to_owned(),
    };
    let text = format!(
        "{how} On the part, the length error of its {:.1} mm of lines is {:.3} mm; {without}.",
        after.length_mm, after.length_error_mm
    );
    body.text(&text).raw("</p>\n</header>\n");
}

fn warnings(report: &Report) -> usize {
    report.notices.iter().filter(|notice| notice.severity == Severity::Warning).count()
}

/// The 3-D view with its controls, and the canvas for paper.
fn picture(body: &mut Markup, content: &PageContent<'_>) {
    body.raw(
        "<section aria-labelledby=\"h-picture\">\n<h2 id=\"h-picture\" class=\"apart\">The mark on the part</h2>\n\
         <div class=\"box\">\n<p id=\"flat-only\">The 3-D view needs a browser with WebGL2 and scripts. All values and the \
         flat panels are below.</p>\n<div id=\"viewer\">\n<div id=\"stage\"><canvas id=\"view\" tabindex=\"0\" \
         role=\"application\" aria-roledescription=\"3-D view\" aria-label=\"The part with the mark. Arrow keys turn it, with \
         Shift they move it, plus and minus zoom. L: from the laser, A: at an angle, F: front, T: top, M: the mark, W: the \
         whole part.\"></canvas><canvas id=\"over\" aria-hidden=\"true\"></canvas>",
    );
    legend(body);
    body.raw("</div>\n<div class=\"tools\">");
    for (group, buttons) in [
        (
            "View",
            &[("angled", "At an angle"), ("laser", "From the laser"), ("front", "Front"), ("top", "Top")][..],
        ),
        ("Zoom", &[("whole", "Whole part"), ("mark", "Mark")]),
    ] {
        let _ = write!(body, "<div class=\"group\" role=\"group\" aria-label=\"{group}\">");
        for (name, label) in buttons {
            let _ = write!(body, "<button type=\"button\" data-view=\"{name}\">{label}</button>");
        }
        body.raw("</div>");
    }
    body.raw("</div>\n<div class=\"tools\" role=\"group\" aria-label=\"Show\">");
    let landmarks = content.landmarks;
    for (name, label, is_on, is_there) in [
        ("after", "After: corrected", true, true),
        ("before", "Before: uncorrected", false, true),
        ("stretch", "Stretch colours", false, true),
        ("part", "Part", true, true),
        ("field", "Field", false, landmarks.field.is_some()),
        ("focus", "Focus planes", false, landmarks.focus.is_some()),
        ("spots", "Places", false, true),
    ] {
        if is_there {
            let checked = if is_on { " checked" } else { "" };
            let _ =
                write!(body, "<label><input type=\"checkbox\" id=\"show-{name}\"{checked}> {label}</label>");
        }
    }
    body.raw(
        "</div>\n<p id=\"live\" class=\"apart\" role=\"status\"></p>\n</div>\n<canvas id=\"still\" role=\"img\" \
         aria-label=\"The part with the mark\"></canvas>\n</div>\n</section>\n",
    );
}

/// The colours of the stretch; the viewer adds the limits.
fn legend(body: &mut Markup) {
    body.raw(
        "<div id=\"legend\" hidden><svg viewBox=\"0 0 21 1\" preserveAspectRatio=\"none\" role=\"img\" \
         aria-label=\"Colours of the stretch: blue is too short, dark is true, orange is too long\">",
    );
    for (step, color) in stretch_colors().enumerate() {
        let _ = write!(body, "<path d=\"M{step} 0h1.02v1h-1.02z\" fill=\"{color}\"/>");
    }
    body.raw("</svg><span><span id=\"least\">too short</span><span>true</span><span id=\"most\">too long</span></span></div>");
}

fn show_button(body: &mut Markup, label: Option<&SpotLabel>) {
    if let Some(SpotLabel { index, label }) = label {
        let _ = write!(body, "<button type=\"button\" data-spot=\"{index}\">Show place {label}</button>");
    }
}

/// A value that a person needs first.
struct Value<'a> {
    name: &'a str,
    before: Option<String>,
    now: String,
    unit: &'a str,
    note: String,
    place: Option<&'a SpotLabel>,
}

fn values(body: &mut Markup, report: &Report, labels: &ValueLabels) {
    let (after, exposure) = (&report.quality.after, &report.exposure);
    let before = |digits: usize, value: &dyn Fn(&DistortionReport) -> f64| {
        report.quality.before.as_ref().map(|before| format!("{:.digits$}", value(before)))
    };
    let notes = report.notices.len() - warnings(report);
    let mut values = vec![
        Value {
            name: "Length error",
            before: before(3, &|quality| quality.length_error_mm),
            now: format!("{:.3}", after.length_error_mm),
            unit: "mm",
            note: format!("on {:.1} mm of lines", after.length_mm),
            place: None,
        },
        Value {
            name: "Largest stretch",
            before: before(2, &|quality| quality.max_stretch * 100.0),
            now: format!("{:.2}", after.max_stretch * 100.0),
            unit: "%",
            note: "of the length of a piece of a line".to_owned(),
            place: labels.stretch.as_ref(),
        },
        Value {
            name: "Largest angle error",
            before: before(2, &|quality| quality.max_angle_error_deg),
            now: format!("{:.2}", after.max_angle_error_deg),
            unit: "°",
            note: "between lines of the drawing".to_owned(),
            place: None,
        },
        Value {
            name: "Incidence",
            before: None,
            now: format!("{:.1}", exposure.incidence_deg),
            unit: "°",
            note: "largest angle between beam and surface normal".to_owned(),
            place: labels.incidence.as_ref(),
        },
        Value {
            name: "Best focus at z",
            before: None,
            now: format!("{:.2}", exposure.best_focus_mm),
            unit: "mm",
            note: format!("the ink spans {:.2} mm of height", exposure.height_mm[1] - exposure.height_mm[0]),
            place: None,
        },
        Value {
            name: "Surface residual",
            before: None,
            now: format!("{:.4}", report.part.residual.under_ink_mm),
            unit: "mm",
            note: "largest distance between fit and part under the ink".to_owned(),
            place: labels.residual.as_ref(),
        },
    ];
    let sideways = report.sensitivity.as_ref().and_then(SensitivityReport::sideways);
    values.extend(sideways.map(|effect| Value {
        name: "Misplaced by 0.1 mm",
        before: None,
        now: format!("{:.3}", effect.length_mm),
        unit: "mm",
        note: format!("of length, and the mark moves by {:.2} mm on the part", effect.moved_mm),
        place: None,
    }));
    let expected = report.sensitivity.as_ref().and_then(|sensitivity| sensitivity.expected);
    values.extend(expected.map(|effect| Value {
        name: "Error to expect",
        before: None,
        now: format!("{:.3}", effect.length_mm),
        unit: "mm",
        note: format!(
            "of length and {:.2} mm of position, from the uncertainty of the fixture",
            effect.moved_mm
        ),
        place: None,
    }));
    values.push(Value {
        name: "Warnings",
        before: None,
        now: warnings(report).to_string(),
        unit: "",
        note: format!("and {notes} {}", if notes == 1 { "note" } else { "notes" }),
        place: None,
    });
    if after.area_mm2 > 0.0 {
        values.insert(
            1,
            Value {
                name: "Area error",
                before: before(3, &|quality| quality.area_error_mm2),
                now: format!("{:.3}", after.area_error_mm2),
                unit: "mm²",
                note: format!("on {:.1} mm² of ink", after.area_mm2),
                place: None,
            },
        );
    }
    body.raw(
        "<section aria-labelledby=\"h-values\">\n<h2 id=\"h-values\" class=\"apart\">Main values</h2>\n<dl class=\"values\">\n",
    );
    for Value { name, before, now, unit, note, place } in values {
        let _ = write!(body, "<div><dt>{name}</dt><dd><div><span class=\"number\">");
        if let Some(before) = before {
            let _ =
                write!(body, "<span class=\"was\">{before} <span aria-label=\"becomes\">→</span> </span>");
        }
        let _ = write!(
            body,
            "{now}</span> <span class=\"unit\">{unit}</span> <span class=\"note\">{note}</span></div>"
        );
        show_button(body, place);
        body.raw("</dd></div>\n");
    }
    body.raw("</dl>\n</section>\n");
}

/// The table that states what the picture shows.
fn shown(body: &mut Markup, content: &PageContent<'_>, spots: &Spots) {
    let PageContent { report, on_part, landmarks, .. } = content;
    let mut rows = vec![("Part", part_text(report, on_part))];
    let extents = |paths: &[PreviewPath<3>]| {
        let points = || paths.iter().flat_map(|path| &path.points);
        let axis = |axis: usize, name: &str| {
            let least = points().map(|point| point[axis]).fold(f64::INFINITY, f64::min);
            let most = points().map(|point| point[axis]).fold(f64::NEG_INFINITY, f64::max);
            let [least, most, _] = rounded([least, most, 0.0]);
            format!("{name} {least:.1} to {most:.1}")
        };
        match points().next() {
            Some(_) => format!("at {}, {}, {} mm of the part", axis(0, "x"), axis(1, "y"), axis(2, "z")),
            None => "nothing".to_owned(),
        }
    };
    let filled = match &on_part.ink {
        Some(ink) if !ink.triangles.is_empty() => ", with filled areas",
        Some(_) => "",
        None => "; its filled areas are too many to be shown",
    };
    rows.push((
        "After: corrected",
        format!(
            "{} lines{filled}, {}; {}",
            on_part.mark.len(),
            extents(&on_part.mark),
            stretch_range_text(on_part.mark_range)
        ),
    ));
    rows.push((
        "Before: uncorrected",
        format!(
            "{} lines where the drawing would land, {}; {}",
            on_part.drawn.len(),
            extents(&on_part.drawn),
            stretch_range_text(on_part.drawn_range)
        ),
    ));
    rows.push(("Outline", "the border of the surface that the laser sees".to_owned()));
    rows.push(("Laser", laser_text(&on_part.view)));
    if let Some(field) = &landmarks.field {
        let [width, height] = field.size;
        let text = format!(
            "{width:.1} × {height:.1} mm, shown at the best focus, z = {:.2} mm of the laser",
            field.height
        );
        rows.push(("Field", text));
    }
    if let Some([low, high]) = &landmarks.focus {
        let text = format!("from z = {:.2} mm to z = {:.2} mm of the laser", low.height, high.height);
        rows.push(("Focus planes", text));
    }
    body.raw("<details id=\"what\"><summary>What the picture shows</summary>\n");
    body.table("What the picture shows", &rows);
    let places: Vec<String> = spots.lines().map(|(label, place)| format!("{label} {place}")).collect();
    if !places.is_empty() {
        let list = places[..places.len().min(20)].join("; ");
        let more = places.len().saturating_sub(20);
        let more = if more > 0 { format!("; and {more} more") } else { String::new() };
        body.raw("<p>Places in the frame of the part: ").text(&format!("{list}{more}")).raw("</p>\n");
    }
    body.raw("</details>\n");
}

fn part_text(report: &Report, on_part: &OnPart) -> String {
    let [x, y, z] = report.part.facts.size;
    let (shown, of_source) = (on_part.part.triangles().len(), on_part.part.source_triangles());
    // Facets under the drawing are divided for the picture.
    let is_divided = shown > of_source;
    let what = match on_part.part_source {
        PartSource::File if report.part.facts.format == Some(MeshFormat::Step) => {
            format!("the faces of its file, shown with {shown} triangles")
        }
        PartSource::File if shown < of_source => {
            format!("{shown} triangles, thinned for the picture from {of_source}")
        }
        PartSource::File if is_divided => {
            format!(
                "the {of_source} triangles of its file, divided under the drawing into {shown} for the picture"
            )
        }
        PartSource::File => format!("the {shown} triangles of its file"),
        PartSource::Heights => "the side that faces the laser, as it was sampled".to_owned(),
        PartSource::Sizes => "drawn from its sizes".to_owned(),
    };
    format!("{x:.1} × {y:.1} × {z:.1} mm, {what}")
}

fn laser_text(view: &View) -> String {
    let [x, y, z] = rounded(view.part_vector(nalgebra::Vector3::z()).into());
    format!("an arrow shows the beam; the laser is in the direction ({x:.3}, {y:.3}, {z:.3}) of the part")
}

fn notice_list(body: &mut Markup, notices: &[(&Notice, Option<SpotLabel>)]) {
    if notices.is_empty() {
        body.raw("<p>None.</p>\n");
        return;
    }
    body.raw("<ol class=\"notices\">\n");
    let item = |body: &mut Markup, (notice, label): &(&Notice, Option<SpotLabel>)| {
        let chip = match notice.severity {
            Severity::Warning => "<span class=\"chip warn\">Warning</span>",
            Severity::Note => "<span class=\"chip\">Note</span>",
        };
        body.raw("<li>")
            .raw(chip)
            .raw("<span>")
            .text(&notice.message)
            .raw(" ")
            .code(&notice.code)
            .raw("</span>");
        show_button(body, label.as_ref());
        body.raw("</li>\n");
    };
    body.bounded(notices, NOTICE_BYTES, item, |body, rest| left_out(body, "li", rest));
    body.raw("</ol>\n<p class=\"quiet\">").code("isomark explain CODE").raw(" explains a code.</p>\n");
}

fn inputs(body: &mut Markup, report: &Report) {
    let (part, pattern, output) = (&report.part, &report.pattern, &report.output);
    let facts = &part.facts;
    let [x, y, z] = facts.size;
    let optional = |text: &Option<String>| text.clone().unwrap_or_default();
    let mut size = format!("{x:.2} × {y:.2} × {z:.2} mm");
    if facts.triangles > 0 {
        let _ = write!(size, ", {} triangles", facts.triangles);
    }
    body.table(
        "Part",
        &[
            ("File", part.origin.file.clone()),
            ("BLAKE3", part.origin.blake3.clone()),
            ("Format", facts.format.map(|format| format.to_string()).unwrap_or_default()),
            ("Written by", optional(&facts.producer)),
            ("Unit", format!("{}: {}", facts.unit.value, facts.unit.why)),
            ("Up", format!("{}: {}", facts.up.value, facts.up.why)),
            ("Size", size),
            ("Bodies", facts.bodies.join(", ")),
            (
                "Surface",
                format!(
                    "{} × {} control points, residual {:.4} mm rms, at most {:.4} mm",
                    part.control_points[0],
                    part.control_points[1],
                    part.residual.rms_mm,
                    part.residual.max_mm
                ),
            ),
        ],
    );
    let facts = &pattern.facts;
    let kinds =
        facts.entities.iter().map(|(kind, layers)| format!("{} {kind}", layers.values().sum::<usize>()));
    body.table(
        "Drawing",
        &[
            ("File", pattern.file.clone()),
            ("BLAKE3", pattern.blake3.clone()),
            ("Version", facts.version.clone()),
            ("Written by", optional(&facts.producer)),
            ("Unit", format!("{}: {}", facts.unit, facts.unit_why)),
            ("Size", format!("{:.2} × {:.2} mm", facts.size[0], facts.size[1])),
            ("Paths", format!("{}, of these {} contours", pattern.paths, pattern.contours)),
            ("Entities", kinds.collect::<Vec<_>>().join(", ")),
            ("Ink layers", pattern.ink_layers.as_ref().map_or("all".to_owned(), |layers| layers.join(", "))),
        ],
    );
    let placement = &report.placement;
    let point = |point: [f64; 3]| {
        let [x, y, z] = rounded(point);
        format!("({x:.3}, {y:.3}, {z:.3})")
    };
    let [ax, ay] = to_decimals(placement.anchor_mm, 2);
    let [px, py] = to_decimals(placement.place_mm, 2);
    let [roll, rotate] = to_decimals([placement.roll_deg, placement.rotate_deg], 2);
    let frame = placement.frame.as_ref().map(|FrameReport { source, frame }| {
        let source = match source {
            FrameSource::Settings => "the settings",
            FrameSource::Part => "the part's file",
        };
        let [origin, z, x] = [frame.origin_mm, frame.z, frame.x].map(point);
        format!("from {source}: origin {origin} mm of the part, z {z}, x {x}")
    });
    let settings = [
        Some(("Faces the laser", format!("{} of the part, roll {roll:.2}°", point(placement.facing)))),
        frame.map(|frame| ("Marking frame", frame)),
        Some((
            "Place",
            format!(
                "the drawing's ({ax:.2}, {ay:.2}) mm at ({px:.2}, {py:.2}) mm of the view, turned by {rotate:.2}°"
            ),
        )),
        Some(("Method", method_text(&report.map))),
    ];
    body.table("Settings", &settings.into_iter().flatten().collect::<Vec<_>>());
    let [left, bottom, right, top] = output.extents_mm;
    body.table(
        "Corrected drawing",
        &[
            (
                "DXF",
                format!(
                    "{}, {} paths, {} vertices, {} bytes",
                    output.dxf, output.paths, output.vertices, output.bytes
                ),
            ),
            (
                "In the field",
                format!(
                    "{:.2} × {:.2} mm: x {left:.2} to {right:.2}, y {bottom:.2} to {top:.2}",
                    right - left,
                    top - bottom
                ),
            ),
            ("BLAKE3", output.blake3.clone()),
            (
                "Read back",
                if output.read_back {
                    "a second reader found the intended drawing"
                } else {
                    "not checked by a second reader"
                }
                .to_owned(),
            ),
            ("Program", report.program.clone()),
        ],
    );
    let skipped = &pattern.facts.skipped;
    if !skipped.is_empty() {
        body.raw("<details><summary>Not marked: ")
            .raw(&skipped.len().to_string())
            .raw(" entities</summary>\n<ul>\n");
        let item = |body: &mut Markup, skipped: &crate::formats::pattern::Skipped| {
            let handle = skipped.handle.as_deref().unwrap_or_default();
            let text = format!("{} {handle} on layer {}: {}", skipped.entity, skipped.layer, skipped.why);
            body.raw("<li>").text(&text).raw("</li>\n");
        };
        body.bounded(skipped, SKIPPED_BYTES, item, |body, rest| left_out(body, "li", rest));
        body.raw("</ul></details>\n");
    }
}

fn method_text(map: &MapReport) -> String {
    match map {
        MapReport::Isometric { weights, .. } => format!(
            "isometric, weighting {}, aim {}, length weight {}, angle weight {}",
            weights.weighting, weights.aim, weights.length_weight, weights.angle_weight
        ),
        MapReport::Cylinder { radius_mm, .. } => format!("cylinder, radius {radius_mm:.3} mm"),
        MapReport::Cone { half_angle_deg, .. } => {
            format!("cone, {half_angle_deg:.3}° between axis and generators")
        }
        other => other.method().to_owned(),
    }
}
