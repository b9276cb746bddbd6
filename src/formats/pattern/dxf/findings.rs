//! Facts and notices about a DXF drawing: its producer, and what looks wrong.

use std::collections::BTreeMap;

use super::super::content::{FieldUse, FoundField};
use super::super::error::{EntityName, PatternReadError};
use super::super::facts::{LayerFacts, PatternFacts, Repair, RepairPlace, Skipped};
use super::super::findings::{MAX_PLACES, content, counted, only_without_font, reasons};
use super::super::reading::size_notice;
use super::super::units::DrawingUnit;
use super::PatternOptions;
use super::blocks::{HeavyLines, Looks};
use super::code_page::CodePage;
use super::items::Remarks;
use super::scan::Scan;
use super::structure::{LayerRecord, PointMode, Structure};
use crate::formats::pattern::Space;
use crate::geometry::pattern::{Layer, Path};
use crate::reason::Notice;

/// Differences in height below this, mm, are rounding.
const FLAT: f64 = 0.01;

/// The version of the format by name and tag.
pub(super) fn version(tag: &str) -> String {
    let name = match tag {
        "AC1006" => "R10",
        "AC1009" => "R12",
        "AC1012" => "R13",
        "AC1014" => "R14",
        "AC1015" => "R2000",
        "AC1018" => "R2004",
        "AC1021" => "R2007",
        "AC1024" => "R2010",
        "AC1027" => "R2013",
        "AC1032" => "R2018",
        "" => return "no version tag".into(),
        _ => return tag.into(),
    };
    format!("{name} ({tag})")
}

/// The program that wrote the file, by its comment or by typical details of its exporter.
pub(super) fn producer(structure: &Structure) -> Option<String> {
    let header = &structure.header;
    if let Some(comment) = structure.comments.iter().find(|comment| !comment.trim().is_empty()) {
        return Some(comment.trim().into());
    }
    if structure.has_ezdxf_entry {
        return Some("ezdxf".into());
    }
    if let Some(saved_by) = &header.saved_by {
        return Some(saved_by.clone());
    }
    // Four variables and this seed: the template of Inkscape's R14 export, which is always the same.
    let is_inkscape =
        header.version == "AC1014" && header.variables == 4 && header.handle_seed.as_deref() == Some("FFFF");
    is_inkscape.then(|| "Inkscape (recognised by its header)".into())
}

pub(super) fn histogram(structure: &Structure) -> BTreeMap<String, BTreeMap<String, usize>> {
    let mut counts: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for record in structure.drawn.iter().cloned().flatten().filter_map(|index| structure.entities.get(index))
    {
        let (kind, layer) = (structure.kind(record), structure.layer(record));
        // Looked up first, because most entities have a known type on a known layer and need no copy of the names.
        match counts.get_mut(kind).and_then(|layers| layers.get_mut(layer)) {
            Some(count) => *count += 1,
            None => {
                counts.entry(kind.into()).or_default().insert(layer.into(), 1);
            }
        }
    }
    counts
}

pub(super) fn layers(structure: &Structure, used: &[Layer], paths: &[Path]) -> BTreeMap<String, LayerFacts> {
    let hidden = |entry: &LayerRecord| match entry {
        LayerRecord { frozen: true, .. } => Some("frozen"),
        LayerRecord { off: true, .. } => Some("off"),
        LayerRecord { plotted: false, .. } => Some("not plotted"),
        _ => None,
    };
    let mut facts: BTreeMap<String, LayerFacts> = structure
        .layers
        .values()
        .map(|entry| {
            (
                entry.name.clone(),
                LayerFacts {
                    color: entry.color.to_string(),
                    paths: 0,
                    hidden: hidden(entry).map(str::to_owned),
                },
            )
        })
        .collect();
    let mut counts = vec![0; used.len()];
    paths.iter().for_each(|path| counts[path.layer] += 1);
    for (layer, count) in used.iter().zip(counts) {
        let known = facts.entry(layer.name.clone()).or_insert(LayerFacts {
            color: layer.color.to_string(),
            paths: 0,
            hidden: None,
        });
        known.paths = count;
    }
    facts
}

/// The first polylines with the extra first point of the old FreeCAD exporter.
pub(super) fn extra_points(structure: &Structure, scan: &Scan<'_>, remarks: &Remarks) -> Vec<RepairPlace> {
    let records = remarks.extra_vertices.iter().filter_map(|index| structure.entities.get(*index));
    let place = |record| {
        let EntityName { kind: entity, handle, layer } = structure.name(scan, record);
        RepairPlace { entity, handle, layer, at_mm: [0.0; 2], pieces: 1, gap_mm: None }
    };
    records.take(MAX_PLACES).map(place).collect()
}

/// Notices about the size, which can indicate a wrong unit.
pub(super) fn size_notices(structure: &Structure, facts: &mut PatternFacts, options: &PatternOptions) {
    let [width, height] = facts.size;
    let size = format!("{width:.3} x {height:.3} mm");
    let is_unitless = DrawingUnit::from_insunits(structure.header.unit_code.unwrap_or(0)).is_none();
    let is_assumed = is_unitless && options.unit.is_none() && options.unit_if_unitless.is_none();
    let by_inkscape = facts.producer.as_deref().is_some_and(|producer| producer.starts_with("Inkscape"));
    if is_assumed && by_inkscape {
        let factor = DrawingUnit::Pixel96.in_mm() / facts.unit.in_mm();
        let message = format!(
            "Inkscape wrote no unit, so the numbers are most likely pixels; then the drawing is {:.3} x {:.3} mm, not \
             {size} (factor 25.4/96). Set the unit for drawings without a unit to px, or set the document's unit to mm \
             in Inkscape",
            width * factor,
            height * factor
        );
        facts.notices.push(Notice::warning("unit-pixels", message));
    }
    facts.notices.extend(sheet_notice(structure, facts, options));
    facts.notices.extend(size_notice(facts));
}

/// A sheet is usually drawn in the unit in which it is plotted, which may be another one than that of the model.
fn sheet_notice(structure: &Structure, facts: &PatternFacts, options: &PatternOptions) -> Option<Notice> {
    let Space::Paper(name) = &options.space else { return None };
    let sheet = structure.sheet(name.as_deref()).ok()?;
    let plotted = structure.sheet_unit(&sheet)?;
    if options.unit.is_some() || plotted == facts.unit {
        return None;
    }
    let size = format!("{:.3} x {:.3} mm", facts.size[0], facts.size[1]);
    let [width, height] = facts.size.map(|side| side * plotted.in_mm() / facts.unit.in_mm());
    let message = format!(
        "the sheet is plotted in {plotted}, and the file's unit is {}: if the sheet is drawn in {plotted}, it is {width:.3} x {height:.3} \
         mm, not {size}. Check the size",
        facts.unit
    );
    Some(Notice::warning("sheet-unit", message))
}

/// The repair of extra first points by the old FreeCAD exporter.
pub(super) fn extra_points_removed(remarks: &Remarks, extra_points: Vec<RepairPlace>) -> Option<Repair> {
    if remarks.extra_vertices.is_empty() {
        return None;
    }
    let message = format!(
        "a first point at (0, 0) that the point count does not include was removed from {}",
        counted(remarks.extra_vertices.len(), "LWPOLYLINE", "LWPOLYLINEs")
    );
    let notice = Notice::warning("extra-point-removed", message);
    Some(Repair { notice, count: remarks.extra_vertices.len(), places: extra_points })
}

/// A warning about extra first points that were not removed because `strict` is set.
pub(super) fn extra_points_notice(remarks: &Remarks) -> Option<Notice> {
    let message = format!(
        "{} with a point at (0, 0) that the point count does not include",
        counted(remarks.extra_vertices.len(), "LWPOLYLINE begins", "LWPOLYLINEs begin")
    );
    (!remarks.extra_vertices.is_empty()).then(|| Notice::warning("extra-point", message))
}

/// A warning about a drawing that is not flat.
pub(super) fn height_notice(heights: Option<(f64, f64)>) -> Option<Notice> {
    let (low, high) = heights.filter(|(low, high)| high - low > FLAT)?;
    let message = format!(
        "the drawing is not flat, it extends from z = {low:.3} to z = {high:.3} mm; it is projected from above, so \
         sloping lines become shorter"
    );
    Some(Notice::warning("not-flat", message))
}

/// Notices about what looks different in the drawing program: wide, dashed or clipped lines, symbols and fills.
pub(super) fn look_notices(
    structure: &Structure,
    remarks: &Remarks,
    looks: &Looks,
    facts: &mut PatternFacts,
) {
    if !remarks.wide.is_empty() {
        let message = format!(
            "{} drawn as filled outlines; to mark a single line, set the width to 0",
            counted(remarks.wide.len(), "polyline with a width is", "polylines with a width are")
        );
        facts.notices.push(Notice::note("wide-lines", message));
    }
    if let Some((count, first)) = &looks.dashed {
        let message = format!(
            "{} dashes or dots in the drawing but marked without gaps (first: {first}); to mark the gaps, explode the \
             line type in the drawing program",
            counted(*count, "line is shown as", "lines are shown as")
        );
        facts.notices.push(Notice::warning("dashed-whole", message));
    }
    if structure.clips > 0 {
        let message = format!(
            "{} clipped in the drawing (XCLIP) but marked completely; explode and trim the parts that must not be \
             marked",
            counted(structure.clips, "block reference is", "block references are")
        );
        facts.notices.push(Notice::warning("clipped-whole", message));
    }
    let header = &structure.header;
    if let (Some((count, first)), PointMode::Symbols(mode)) = (&looks.symbols, header.points) {
        let message = format!(
            "{} as a symbol in the drawing ($PDMODE is {mode}) but marked as a dot (first: {first}); to mark symbols, draw them as lines \
             or blocks",
            counted(*count, "point is shown", "points are shown")
        );
        facts.notices.push(Notice::warning("point-symbols", message));
    }
    if let Some((count, first)) = &looks.unfilled {
        let message = format!(
            "{} marked as in any drawing, although this drawing shows no fills ($FILLMODE is 0; first: {first}); delete those that must \
             not be marked",
            counted(*count, "filled area or hatch is", "filled areas or hatches are"),
        );
        facts.notices.push(Notice::warning("fills-not-shown", message));
    }
    if let Some((count, first)) = &looks.white {
        let message = format!(
            "{} white but marked like all others (first: {first}); if white hides what is below it in the drawing, delete these areas, and \
             trim what they cover",
            counted(*count, "filled area is", "filled areas are")
        );
        facts.notices.push(Notice::warning("white-fills", message));
    }
    if let Some((count, first)) = &looks.gradients {
        let message = format!(
            "{} a gradient (first: {first}); the whole area is marked, without shades",
            counted(*count, "hatch has", "hatches have")
        );
        facts.notices.push(Notice::warning("gradients-whole", message));
    }
    if let Some((count, first)) = &looks.transparent {
        let message = format!(
            "{} partly transparent but marked like all others (first: {first})",
            counted(*count, "entity is", "entities are")
        );
        facts.notices.push(Notice::note("transparent-whole", message));
    }
    if let Some(page) = header.code_page.as_ref().filter(|page| {
        header.version.as_str() < "AC1021" && CodePage::named(page).is_none() && page.as_str() != "ascii"
    }) {
        let message = format!(
            "the code page {page} is unknown: letters outside ASCII are read as UTF-8 or Windows-1252"
        );
        facts.notices.push(Notice::warning("code-page-unknown", message));
    }
}

/// A note about lines that are plotted much wider than they are marked.
pub(super) fn heavy_notice(heavy: Option<&HeavyLines>) -> Option<Notice> {
    let HeavyLines { count, first, widest } = heavy?;
    let message = format!(
        "{} a line weight of up to {widest:.2} mm; each is marked once, along its centre line (first: {first} on layer {}); to mark the width, give \
         the polyline a global width, or draw its outline",
        counted(*count, "line has", "lines have"),
        first.layer
    );
    Some(Notice::note("line-weight-unused", message))
}

/// The error for a drawing without paths, with the most likely cause.
pub(super) fn nothing_to_mark(structure: &Structure, skipped: &[Skipped]) -> PatternReadError {
    if let Some(error) = only_without_font(skipped) {
        return error;
    }
    let by_inkscape = producer(structure).is_some_and(|producer| producer.starts_with("Inkscape"));
    let remedy = if skipped.is_empty() && by_inkscape {
        "Convert live text with Path > Object to Path and export again: Inkscape skips it without a warning."
            .into()
    } else if skipped.is_empty() {
        "Convert live text, Bezier curves and solids to paths and export again: many exporters skip them."
            .into()
    } else {
        let sheet = match skipped.iter().any(|skipped| skipped.why == super::blocks::IN_PAPER_SPACE) {
            true => {
                "Set `--space paper` (`space = \"paper\"` under [pattern]) to mark the sheet in paper space, or draw it"
            }
            false => "Draw it",
        };
        format!(
            "{sheet} as curves on a visible layer in model space; it was skipped because {}.",
            reasons(skipped)
        )
    };
    PatternReadError::NothingToMark { found: content(skipped), remedy }
}

/// The fields in texts, in the order of the file.
pub(super) fn fields(
    structure: &Structure,
    scan: &Scan<'_>,
    found: BTreeMap<usize, Vec<FoundField>>,
) -> Vec<FieldUse> {
    let of = |(index, found): (usize, Vec<FoundField>)| {
        let record = structure.entities.get(index)?;
        let (kind, layer) = (structure.kind(record), structure.layer(record));
        let handle = structure.handle(scan, record);
        Some(found.into_iter().map(move |field| field.of(kind, handle.clone(), layer)))
    };
    found.into_iter().filter_map(of).flatten().collect()
}

#[cfg(test)]
mod tests;
