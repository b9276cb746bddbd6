//! `isomark inspect`: what isomark reads in a file.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use nalgebra::Vector3;
use serde::Serialize;

use super::correct::{check_extension, has_ending};
use super::named_files::{apart, name_of, read_file, read_part, write_file};
use super::options::{MeaningArguments, ScanArguments};
use super::outcome::{Failure, Outcome, print, print_json};
use super::progress::ProgressLine;
use super::set::{
    SetArguments, add_options, refuse_options_of_other_formats, refuse_options_of_the_other,
    useless_to_an_inspection,
};
use crate::config::{IncidenceLimits, JobSettings, Losses, Overrides, PartSettings, parse_facing};
use crate::cores::Cores;
use crate::formats;
use crate::formats::Pace;
use crate::formats::mesh::{
    self, FaceKind, MeshFormat, NormalsFound, NormalsUsed, PartFacts, PartReading, Shape, SideFacts,
};
use crate::formats::pattern::{self, PatternFacts, PatternReadError, Skipped};
use crate::formats::surface::SurfaceFormat;
use crate::geometry::pattern::Pattern;
use crate::geometry::sides::{SIDES, Side, SideHeights};
use crate::geometry::space::View;
use crate::geometry::surface::fit::{FitOptions, FittedSurface};
use crate::pipeline::learning::unknown_part_format;
use crate::pipeline::{Progress, Step, surface_of};
use crate::preview::{HeightPicture, SidePicture, sides_svg};
use crate::printable::on_one_line;
use crate::reason::{Notice, Severity};
use crate::report_html::sides_html;

/// Lost and skipped entities are listed one by one up to this number each.
const MOST_LISTED: usize = 12;

#[derive(Debug, Args)]
pub(super) struct InspectArguments {
    /// A part (.step, .glb, .gltf, .obj, .stl, .ply, .3mf), a scan (.ply, .xyz, .csv, .txt) or a drawing (.dxf, .svg, .png, .bmp).
    file: PathBuf,
    #[command(flatten)]
    meaning: MeaningArguments,
    /// The side of the part that faces the laser: +z (default), -z, +x, -x, +y, -y or a direction X,Y,Z.
    #[arg(long, value_name = "SIDE", allow_hyphen_values = true)]
    facing: Option<String>,
    #[command(flatten)]
    scan: ScanArguments,
    /// Writes the surface that is fitted to this side, in the frame of the part's file: .step (the spline) or .obj (triangles).
    #[arg(long, value_name = "FILE")]
    surface: Option<PathBuf>,
    /// Draws the side that `--facing` names, or all six, with axes, sizes and the place where a drawing fits, as a picture
    /// (.svg) or as a page with a table (.html).
    #[arg(long, value_name = "FILE.svg|html")]
    preview: Option<PathBuf>,
    #[command(flatten)]
    set: SetArguments,
    /// Prints what was found as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Serialize)]
#[serde(tag = "schema")]
enum Inspection {
    #[serde(rename = "isomark.part/1")]
    Part(PartFacts),
    #[serde(rename = "isomark.pattern/1")]
    Pattern(PatternFacts),
}

pub(super) fn run(arguments: &InspectArguments) -> Outcome {
    let written = [("--surface", &arguments.surface), ("--preview", &arguments.preview)];
    let written: Vec<(&str, &Path)> =
        written.into_iter().filter_map(|(option, file)| Some((option, file.as_deref()?))).collect();
    apart(&[&arguments.file], &written)?;
    let preview = arguments.preview.as_ref();
    check_extension("--preview", preview, &["svg", "html"], "an SVG picture or an HTML page")?;
    let mut overrides = Overrides::default();
    arguments.meaning.add_to(&mut overrides)?;
    arguments.scan.add_to(&mut overrides)?;
    add_options(&mut overrides, &[("--facing", "part.facing", arguments.facing.as_ref())])?;
    arguments.set.add_to(&mut overrides, useless_to_an_inspection)?;
    let settings = JobSettings::default().with_overrides(&overrides)?;
    let name = name_of(&arguments.file)?;
    let progress = ProgressLine::start();
    let observe = progress.observer();
    let at = |step| observe(Progress::At { file: &name, step });
    at(Step::Read);
    let (inspection, text) = match MeshFormat::from_name(&name) {
        Some(format) => {
            refuse_options_of_the_other(&overrides, &name, true)?;
            let options = settings.part.mesh_options(Pace::default());
            let part = read_part(&arguments.file)?;
            let mut reading = mesh::read(&part.bytes, format, &options, &part.siblings)
                .map_err(|error| Failure::rejected(error.reason().in_file(&name)))?;
            let is_asked = arguments.surface.is_some() || overrides.has("part.facing");
            let fitted = if is_asked || matches!(reading.shape, Shape::Scan(_)) {
                at(Step::Fit);
                fit(arguments, &settings.part, &name, &mut reading)?
            } else {
                None
            };
            if let Some(mesh) = reading.shape.mesh() {
                let limit = IncidenceLimits::default().refuse;
                let sides = Side::all(mesh, limit, &Cores);
                reading.facts.sides = SideFacts::of_all(&sides);
                let named = overrides
                    .has("part.facing")
                    .then(|| (facing_name(&settings.part), Side::seen(mesh, &settings.part.view(), limit)));
                // A direction between the axes is one more side.
                if let Some((name, side)) = &named
                    && reading.facts.sides.iter().all(|other| other.side != *name)
                {
                    reading.facts.sides.push(SideFacts::of(name.clone(), side));
                }
                if let Some(preview) = &arguments.preview {
                    draw_sides(preview, &name, &reading.facts, sides, named, &settings.part)?;
                }
            } else if arguments.preview.is_some() {
                return Err(Failure::usage(
                    format!("\"{name}\" is a scan, and `--preview` draws the sides of a mesh."),
                    "Leave out `--preview`; `isomark correct --preview` draws a scan with a drawing.",
                ));
            }
            let mut text = part_text(&name, &reading.facts);
            side_lines(&mut text, &reading.facts, overrides.has("part.facing"));
            if let Some(surface) = &fitted {
                surface_line(&mut text, surface);
                if let Some(written) = &arguments.surface {
                    line(&mut text, "written", &written.display().to_string());
                }
            }
            // Unit and axis have lines of their own, with the reason.
            let is_shown_above = |notice: &&Notice| {
                notice.severity == Severity::Note
                    && ["unit-assumed", "axis-assumed"].contains(&notice.code.as_str())
            };
            notices(&mut text, reading.facts.notices.iter().filter(|notice| !is_shown_above(notice)));
            (Inspection::Part(reading.facts), text)
        }
        None if arguments.surface.is_some() => {
            return Err(Failure::usage(
                format!("\"{name}\" is not a part, so it has no surface to write."),
                "Name the part, or leave out `--surface`.",
            ));
        }
        None if arguments.preview.is_some() => {
            return Err(Failure::usage(
                format!("\"{name}\" is not a part, so it has no sides to draw."),
                "Name the part, or leave out `--preview`.",
            ));
        }
        None => {
            let settings = settings.pattern;
            let bytes = read_file(&arguments.file)?;
            refuse_options_of_other_formats(&overrides, &name, &bytes)?;
            let mut reading = pattern::read(&bytes, &settings.options()).map_err(|error| match error {
                // A drawing is recognised by its bytes, not by its name.
                PatternReadError::NotDxf { .. } if mesh::is_unread_part(&name) => {
                    Failure::rejected(unknown_part_format(&name))
                }
                error => Failure::rejected(error.reason_for(&name)),
            })?;
            refuse_options_of_the_other(&overrides, &name, false)?;
            let lost = lost_ink(&reading.facts).filter(|_| settings.losses == Losses::Refuse);
            reading.facts.notices.extend(lost);
            let text = pattern_text(&name, &reading.facts, &reading.pattern);
            (Inspection::Pattern(reading.facts), text)
        }
    };
    drop(progress);
    if arguments.json {
        let json =
            serde_json::to_string_pretty(&inspection).map_err(|error| Failure::environment(&error.into()))?;
        print_json(&(json + "\n"));
    } else {
        print(&text);
    }
    Ok(())
}

/// Warns that jobs refuse the drawing if the lost entities are on ink layers.
fn lost_ink(facts: &PatternFacts) -> Option<Notice> {
    let lost = facts.lost_ink(|_| true);
    (!lost.0.is_empty()).then(|| {
        let message = format!(
            "visible ink is lost, so `correct` and `watch` reject the drawing unless `losses` is \"warn\" or its layers \
             are not ink layers: {lost}"
        );
        Notice::warning("ink-lost", message)
    })
}

/// Fits the side that faces the laser and writes the surface if `--surface` asks for it. Without `--surface`, a part that
/// cannot be fitted gives a notice, because the content of the file is still of use.
fn fit(
    arguments: &InspectArguments,
    settings: &PartSettings,
    name: &str,
    reading: &mut PartReading,
) -> Result<Option<FittedSurface>, Failure> {
    let target = arguments.surface.as_deref().map(surface_file).transpose()?;
    let fitted = surface_of(&reading.shape, &mut reading.facts, settings, &FitOptions::default());
    match (fitted, target) {
        (Ok(surface), Some((path, format))) => {
            let settings = settings.for_part_with(reading.facts.marking_frame());
            let view = View::new(settings.facing, settings.roll);
            write_file(path, &formats::surface::write(&surface, &view, name, format))?;
            Ok(Some(surface))
        }
        (Ok(surface), None) => Ok(Some(surface)),
        (Err(reason), Some(_)) => Err(Failure::rejected(reason.in_file(name))),
        (Err(reason), None) => {
            let message = format!("{} {}", reason.what, reason.remedy);
            reading.facts.notices.push(Notice::warning(&reason.code, message));
            Ok(None)
        }
    }
}

/// The file that the surface is written to, with the format of its ending.
fn surface_file(path: &Path) -> Result<(&Path, SurfaceFormat), Failure> {
    let name = name_of(path)?;
    let format = SurfaceFormat::from_name(&name).ok_or_else(|| {
        Failure::usage(
            format!("The extension of \"{name}\" is not that of a format of surfaces."),
            format!("Give the file the extension {}.", SurfaceFormat::ENDINGS),
        )
    })?;
    Ok((path, format))
}

fn line(text: &mut String, label: &str, value: &str) {
    let _ = writeln!(text, "  {label:<10} {}", on_one_line(value));
}

fn part_text(name: &str, facts: &PartFacts) -> String {
    let mut text = format!("{}: part\n", on_one_line(name));
    let [x, y, z] = facts.size;
    line(&mut text, "size", &format!("{x:.2} x {y:.2} x {z:.2} mm (x, y, z; z up)"));
    line(&mut text, "unit", &format!("{}, because {}", facts.unit.value, facts.unit.why));
    line(&mut text, "up", &format!("{}, because {}", facts.up.value, facts.up.why));
    line(&mut text, "format", &facts.format.map_or("none".to_owned(), |format| format.to_string()));
    line(&mut text, "producer", facts.producer.as_deref().unwrap_or("not named"));
    if let Some(frame) = &facts.frame {
        let direction = |[x, y, z]: [f64; 3]| format!("({x:.3}, {y:.3}, {z:.3})");
        let [x, y, z] = frame.origin_mm;
        let said = format!(
            "origin ({x:.2}, {y:.2}, {z:.2}) mm, z to the laser {}, x of the drawing {}; node `isomark`",
            direction(frame.z),
            direction(frame.x)
        );
        line(&mut text, "frame", &said);
    }
    if let Some(area) = facts.mark_area_mm2 {
        line(&mut text, "mark", &format!("faces named `mark`, {area:.1} mm2: ink may be only there"));
    }
    match facts.triangles {
        0 => {
            line(&mut text, "scan", &format!("{} points", facts.vertices));
            scan_lines(&mut text, facts);
        }
        triangles => mesh_lines(&mut text, facts, triangles),
    }
    for (label, names) in
        [("bodies", &facts.bodies), ("materials", &facts.materials), ("skipped", &facts.skipped)]
    {
        if !names.is_empty() {
            line(&mut text, label, &names.join(", "));
        }
    }
    text
}

/// Draws the side that is `named`, or all `sides`.
fn draw_sides(
    file: &Path,
    part: &str,
    facts: &PartFacts,
    sides: Vec<Side>,
    named: Option<(String, Side)>,
    settings: &PartSettings,
) -> Outcome {
    let pictures: Vec<SidePicture> = match named {
        None => {
            let both = facts.sides.iter().zip(sides);
            let view = |facts: &SideFacts| parse_facing(&facts.side).map(|facing| View::new(facing, 0.0));
            both.filter_map(|(facts, side)| {
                let remark = if facts.meant { ", probably meant" } else { "" };
                Some(side_picture(&facts.side, &view(facts).ok()?, side, remark))
            })
            .collect()
        }
        Some((name, side)) => vec![side_picture(&name, &settings.view(), side, "")],
    };
    let title = format!("{part} · sides of the part");
    let svg = sides_svg(&title, &pictures);
    match has_ending(file, "html") {
        true => write_file(file, sides_html(&title, &facts.sides, &svg).as_bytes()),
        false => write_file(file, svg.as_bytes()),
    }
}

/// The side that the laser sees, as `--facing` takes it.
fn facing_name(settings: &PartSettings) -> String {
    let direction = settings.facing.direction();
    match SIDES.iter().find(|(_, side)| *side == direction) {
        Some((name, _)) => (*name).to_owned(),
        None => format!("{:.4},{:.4},{:.4}", direction.x, direction.y, direction.z),
    }
}

fn side_picture(name: &str, view: &View, side: Side, remark: &str) -> SidePicture {
    let axis = |direction: Vector3<f64>| {
        let named = SIDES.iter().find(|(_, side)| (side - direction).norm() < 1e-9);
        named.map_or_else(
            || format!("({:.2}, {:.2}, {:.2})", direction.x, direction.y, direction.z),
            |(name, _)| (*name).to_owned(),
        )
    };
    let [right, up] = [Vector3::x(), Vector3::y()].map(|direction| axis(view.part_vector(direction)));
    let kind = if side.is_curved { "curved" } else { "flat" };
    let (size, low, high) = (side.extents.size(), side.extents.min, side.extents.max);
    let fits = match &side.rectangle {
        Some(fits) => {
            let [x, y]: [f64; 2] = fits.center().into();
            let size = fits.size();
            let about = about(side.is_curved);
            format!("fits {about}{:.1} × {:.1} mm at --place {}", size.x, size.y, place(x, y))
        }
        None => "nothing can be marked on this side".to_owned(),
    };
    let SideHeights { origin, step, columns, rows, heights } = side.heights;
    SidePicture {
        heading: format!("--facing={name}"),
        remarks: vec![
            format!("{kind}, {:.0} mm² can be marked{remark}", side.area),
            format!("to the right {right} of the part, upwards {up}"),
            format!(
                "{:.1} × {:.1} mm: x {:.1} to {:.1}, y {:.1} to {:.1}",
                size.x, size.y, low.x, high.x, low.y, high.y
            ),
            fits,
        ],
        part_outline: HeightPicture {
            origin: origin.into(),
            step,
            columns,
            rows,
            heights,
            ..HeightPicture::default()
        },
        extents: side.extents,
        rectangle: side.rectangle,
    }
}

/// What fits is measured in the view. On a curved side a drawing is larger than it is there, and not a rectangle.
fn about(is_curved: bool) -> &'static str {
    if is_curved { "about " } else { "" }
}

/// A place as `--place` takes it, to a tenth of a millimetre.
fn place(x: f64, y: f64) -> String {
    let tenth = |value: f64| (value * 10.0).round() / 10.0 + 0.0;
    format!("{},{}", tenth(x), tenth(y))
}

/// The sides of the part, and which one is probably meant; `is_named` if a side was given.
fn side_lines(text: &mut String, facts: &PartFacts, is_named: bool) {
    for side in &facts.sides {
        let kind = if side.curved { "curved" } else { "flat" };
        let [left, bottom, right, top] = side.extents_mm;
        let fits = match (side.rectangle_mm, side.place_mm) {
            (Some([left, bottom, right, top]), Some([x, y])) => format!(
                "; fits {}{:.1} x {:.1} mm at --facing={} --place {}",
                about(side.curved),
                right - left,
                top - bottom,
                side.side,
                place(x, y)
            ),
            _ => String::new(),
        };
        let said = format!(
            "{kind}, {:.0} mm2 can be marked; {:.1} x {:.1} mm{fits}",
            side.area_mm2,
            right - left,
            top - bottom
        );
        line(text, &format!("side {}", side.side), &said);
    }
    let meant: Vec<&SideFacts> = facts.sides.iter().filter(|side| side.meant).collect();
    let Some(first) = meant.first().filter(|_| !is_named && facts.frame.is_none()) else { return };
    let names: Vec<&str> = meant.iter().map(|side| side.side.as_str()).collect();
    let top = facts.sides.iter().find(|side| side.side == "+z" && !side.meant);
    let instead = match top {
        Some(top) if !top.curved && first.curved => {
            "; without `--facing` the laser looks at the flat side +z".to_owned()
        }
        Some(_) => "; without `--facing` the laser looks at +z".to_owned(),
        None => String::new(),
    };
    let kind = if first.curved { "the largest curved side" } else { "the largest side" };
    line(text, "to mark", &format!("probably side {}, {kind}{instead}", names.join(" or ")));
}

fn surface_line(text: &mut String, surface: &FittedSurface) {
    let residual = &surface.residual;
    let (across, upwards) = surface.nurbs.knots();
    let text_of_line = format!(
        "{} x {} spans, within {:.4} mm (95 %); largest {:.4} mm at ({:.1}, {:.1}) mm of the view, usually at the rim",
        across.spans(),
        upwards.spans(),
        residual.p95,
        residual.max,
        residual.at.x,
        residual.at.y
    );
    line(text, "fit", &text_of_line);
}

fn mesh_lines(text: &mut String, facts: &PartFacts, triangles: usize) {
    if !facts.faces.is_empty() {
        let faces = facts.faces.iter().map(|FaceKind { kind, count, .. }| format!("{count} x {kind}"));
        line(text, "faces", &format!("{}, marked exactly", faces.collect::<Vec<_>>().join(", ")));
        line(text, "mesh", &format!("{triangles} triangles for pictures"));
        return;
    }
    line(text, "mesh", &format!("{triangles} triangles, {} vertices", facts.vertices));
    let found = match facts.normals {
        NormalsFound::Smooth => "follow the surface",
        NormalsFound::FacetsOnly => "only repeat the facets",
        NormalsFound::Averaged => "average the facets, as smooth shading does",
        NormalsFound::None => "none",
    };
    let used = match facts.normals_used {
        Some(NormalsUsed::Estimated) if facts.normals == NormalsFound::None => {
            "; they are estimated from the mesh".into()
        }
        Some(NormalsUsed::Estimated) => "; better ones are estimated from the mesh".into(),
        Some(NormalsUsed::Mixed) => format!(
            "; of {} vertices {} have none, which are estimated from the mesh",
            facts.vertices, facts.normals_missing
        ),
        Some(NormalsUsed::Facets) => "; the flat facets are marked".into(),
        Some(NormalsUsed::Smoothed) => "; the vertices are smoothed as a scan".into(),
        Some(NormalsUsed::File) | None => String::new(),
    };
    line(text, "normals", &format!("{found}{used}"));
    if let Some(noise) = &facts.noise {
        let said = format!(
            "{:.4} mm at vertices {:.2} mm apart; it turns normals by about {:.1} deg",
            noise.noise_mm, noise.spacing_mm, noise.normals_off_deg
        );
        line(text, "noise", &said);
    }
    scan_lines(text, facts);
}

fn scan_lines(text: &mut String, facts: &PartFacts) {
    let Some(scan) = &facts.scan else { return };
    line(text, "used", &format!("{} ({} hidden, {} outliers)", scan.used, scan.hidden, scan.dropped));
    line(text, "spacing", &format!("{:.3} mm, sampled every {:.3} mm", scan.spacing_mm, scan.grid_step_mm));
    for (surface, number) in scan.surfaces.iter().zip(1..) {
        let label = if scan.surfaces.len() == 1 { "surface".to_owned() } else { format!("surface {number}") };
        let ([left, bottom, right, top], [low, high]) = (surface.extents_mm, surface.heights_mm);
        let smoothing = match surface.wavelength_mm {
            Some(wavelength) => format!("smoothing {wavelength:.1} mm"),
            None => "not smoothed".into(),
        };
        let text_of_line = format!(
            "{} points, noise {:.4} mm, {smoothing}; x {left:.1} to {right:.1}, y {bottom:.1} to {top:.1}, z {low:.2} to \
             {high:.2} mm",
            surface.points, surface.noise_mm
        );
        line(text, &label, &text_of_line);
    }
}

fn pattern_text(name: &str, facts: &PatternFacts, pattern: &Pattern) -> String {
    let mut text = format!("{}: drawing\n", on_one_line(name));
    let [width, height] = facts.size;
    let [left, bottom, right, top] = facts.extents;
    line(&mut text, "size", &format!("{width:.2} x {height:.2} mm"));
    line(&mut text, "extents", &format!("x {left:.2} to {right:.2}, y {bottom:.2} to {top:.2} mm"));
    line(&mut text, "unit", &format!("{}, because {}", facts.unit, facts.unit_why));
    if let Some(picture) = &facts.picture {
        let ([columns, rows], [width, height]) = (picture.pixels, picture.size);
        line(&mut text, "picture", &format!("{columns} x {rows} pixels on {width:.2} x {height:.2} mm"));
        let side = if picture.inverted { "lighter" } else { "darker" };
        line(&mut text, "marked", &format!("pixels {side} than {:.0} %", picture.threshold_percent));
    }
    line(&mut text, "version", &facts.version);
    line(&mut text, "producer", facts.producer.as_deref().unwrap_or("not named"));
    let contours = pattern.paths.iter().filter(|path| path.is_contour()).count();
    let plural = if pattern.paths.len() == 1 { "" } else { "s" };
    line(&mut text, "to mark", &format!("{} path{plural}, {contours} of them closed", pattern.paths.len()));
    let marked: Vec<(&String, usize)> = facts
        .layers
        .iter()
        .filter(|(_, found)| found.paths > 0)
        .map(|(layer, found)| (layer, found.paths))
        .collect();
    if marked.len() > 1 {
        line(&mut text, "", &by_layer(marked.into_iter()));
    }
    for (index, (entity, layers)) in facts.entities.iter().enumerate() {
        let label = if index == 0 { "contains" } else { "" };
        let counts = by_layer(layers.iter().map(|(layer, count)| (layer, *count)));
        line(&mut text, label, &format!("{entity}: {counts}"));
    }
    for (layer, found) in facts.layers.iter().filter(|(_, found)| found.hidden.is_some()) {
        line(
            &mut text,
            "hidden",
            &format!("layer {layer} is {}", found.hidden.as_deref().unwrap_or_default()),
        );
    }
    let (lost, skipped): (Vec<&Skipped>, Vec<&Skipped>) = facts.skipped.iter().partition(|left| left.is_ink);
    for (label, entities) in [("LOST", lost), ("skipped", skipped)] {
        for left in entities.iter().take(MOST_LISTED) {
            let handle = left.handle.as_deref().unwrap_or("without handle");
            line(
                &mut text,
                label,
                &format!("{} {handle} on layer {}: {}", left.entity, left.layer, left.why),
            );
        }
        if entities.len() > MOST_LISTED {
            line(&mut text, label, &format!("and {} more; --json lists all", entities.len() - MOST_LISTED));
        }
    }
    for repair in &facts.repairs {
        line(&mut text, "repaired", &repair.notice.message);
    }
    notices(&mut text, facts.notices.iter());
    text
}

fn by_layer<'l>(counts: impl Iterator<Item = (&'l String, usize)>) -> String {
    counts.map(|(layer, count)| format!("{count} on {layer}")).collect::<Vec<_>>().join(", ")
}

fn notices<'a>(text: &mut String, notices: impl Iterator<Item = &'a Notice>) {
    for notice in notices {
        let label = match notice.severity {
            Severity::Note => "note",
            Severity::Warning => "WARNING",
        };
        line(text, label, &notice.message);
    }
}
