//! Facts and notices about a drawing: its producer, what was repaired, and what looks wrong.

use std::collections::BTreeMap;

use super::super::error::{EntityName, PatternReadError};
use super::super::facts::{LayerFacts, PatternFacts, Repair, RepairPlace, Skipped};
use super::super::reading::size_notice;
use super::super::units::DrawingUnit;
use super::PatternOptions;
use super::code_page::CodePage;
use super::items::Remarks;
use super::scan::Scan;
use super::structure::{LayerRecord, Structure};
use crate::geometry::contour::{Finding, Repaired};
use crate::geometry::pattern::{Layer, Path, SAME_POINT, Shape};
use crate::geometry::space::Extents;
use crate::reason::Notice;

/// Differences in height below this, mm, are rounding.
const FLAT: f64 = 0.01;
/// Largest number of reasons for skipped entities in a summary.
const MAX_REASONS: usize = 3;

/// Largest number of places in the list of a repair; there may be millions.
const MAX_PLACES: usize = 1000;

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

pub(super) fn extents(paths: &[Path]) -> Extents {
    let mut all = Extents::EMPTY;
    for path in paths {
        if let Shape::Dot(point) = path.shape {
            all.include(point.coords());
        }
        for extents in path.shape.segments().iter().map(|segment| segment.extents()) {
            all.include(extents.min);
            all.include(extents.max);
        }
    }
    all
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

/// The repairs by kind, with their places.
pub(super) fn repairs(
    repaired: &Repaired,
    layers: &[Layer],
    remarks: &Remarks,
    extra_points: Vec<RepairPlace>,
    tolerance: f64,
) -> Vec<Repair> {
    let place = |found: &Finding| RepairPlace {
        entity: found.source.entity.clone(),
        handle: found.source.handle.clone(),
        layer: layers.get(found.layer).map(|layer| layer.name.clone()).unwrap_or_default(),
        at_mm: found.at.coords().into(),
        pieces: found.pieces,
        gap_mm: Some(found.gap).filter(|gap| *gap > 0.0),
    };
    let mut repairs = Vec::new();
    let mut add = |code: &str, message: String, found: &[&[Finding]]| {
        let places: Vec<RepairPlace> = found.iter().copied().flatten().take(MAX_PLACES).map(place).collect();
        if !places.is_empty() {
            let count = found.iter().map(|found| found.len()).sum();
            repairs.push(Repair { notice: Notice::note(code, message), count, places });
        }
    };
    let pieces = |found: &[Finding]| found.iter().map(|found| found.pieces).sum::<usize>();
    let message = format!(
        "{} loose pieces were joined to {} and {} (ends within {tolerance} mm)",
        pieces(&repaired.contours) + pieces(&repaired.chains),
        counted(repaired.contours.len(), "contour", "contours"),
        counted(repaired.chains.len(), "open line", "open lines"),
    );
    add("pieces-joined", message, &[&repaired.contours, &repaired.chains]);
    let closed: Vec<Finding> =
        repaired.closed.iter().filter(|found| found.gap > SAME_POINT).cloned().collect();
    if let Some(widest) = widest(&closed) {
        let message = format!(
            "{} closed; the widest gap was {:.6} mm ({})",
            counted(closed.len(), "nearly closed path was", "nearly closed paths were"),
            widest.gap,
            name(widest)
        );
        add("contours-closed", message, &[&closed]);
    }
    if let [first, ..] = repaired.duplicates.as_slice() {
        let message = format!(
            "{} drawn twice in the same place, and the copies were removed (first: {})",
            counted(repaired.duplicates.len(), "path was", "paths were"),
            name(first)
        );
        add("copies-removed", message, &[&repaired.duplicates]);
    }
    if let [first, ..] = repaired.without_length.as_slice() {
        let message = format!(
            "{} removed (first in {})",
            counted(
                pieces(&repaired.without_length),
                "piece without length was",
                "pieces without length were"
            ),
            name(first)
        );
        add("empty-pieces-removed", message, &[&repaired.without_length]);
    }
    if !remarks.extra_vertices.is_empty() {
        let message = format!(
            "a first point at (0, 0) that the point count does not include was removed from {}",
            counted(remarks.extra_vertices.len(), "LWPOLYLINE", "LWPOLYLINEs")
        );
        let notice = Notice::warning("extra-point-removed", message);
        repairs.push(Repair { notice, count: remarks.extra_vertices.len(), places: extra_points });
    }
    repairs
}

/// Warnings about problems that were not repaired because `strict` is set.
pub(super) fn unrepaired_notices(repaired: &Repaired, remarks: &Remarks, facts: &mut PatternFacts) {
    let mut warn = |code: &str, message: String| facts.notices.push(Notice::warning(code, message));
    if let [first, ..] = repaired.duplicates.as_slice() {
        let message = format!(
            "{} drawn twice in the same place and will be marked twice (first: {})",
            counted(repaired.duplicates.len(), "path is", "paths are"),
            name(first)
        );
        warn("drawn-twice", message);
    }
    if let [first, ..] = repaired.without_length.as_slice() {
        let pieces: usize = repaired.without_length.iter().map(|found| found.pieces).sum();
        let message =
            format!("{} no length (first in {})", counted(pieces, "piece has", "pieces have"), name(first));
        warn("without-length", message);
    }
    if !remarks.extra_vertices.is_empty() {
        let message = format!(
            "{} with a point at (0, 0) that the point count does not include",
            counted(remarks.extra_vertices.len(), "LWPOLYLINE begins", "LWPOLYLINEs begin")
        );
        warn("extra-point", message);
    }
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
    facts.notices.extend(size_notice(facts));
}

fn counted(count: usize, one: &str, more: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { more })
}

/// Notices about what is drawn.
pub(super) fn drawing_notices(repaired: &Repaired, heights: Option<(f64, f64)>, facts: &mut PatternFacts) {
    if !facts.skipped.is_empty() {
        // Entities that draw nothing are mentioned only if nothing else is missing.
        let is_loss = facts.skipped.iter().any(|skipped| skipped.is_loss);
        let reported: Vec<&Skipped> =
            facts.skipped.iter().filter(|skipped| skipped.is_loss == is_loss).collect();
        let mut reasons: Vec<(&str, &str, &str)> = Vec::new();
        for skipped in &reported {
            let reason = (skipped.entity.as_str(), skipped.layer.as_str(), skipped.why.as_ref());
            if reasons.len() <= MAX_REASONS && !reasons.contains(&reason) {
                reasons.push(reason);
            }
        }
        let mut first: Vec<String> = reasons
            .iter()
            .take(MAX_REASONS)
            .map(|(entity, layer, why)| format!("{entity} on layer {layer}: {why}"))
            .collect();
        if reasons.len() > MAX_REASONS {
            first.push("and others".into());
        }
        let count = counted(reported.len(), "entity is", "entities are");
        let message = format!("{count} not marked ({})", first.join("; "));
        let notice = if is_loss { Notice::warning } else { Notice::note };
        facts.notices.push(notice("not-taken", message));
    }
    let regions = repaired.paths.iter().filter_map(|path| path.region);
    let regions = regions.collect::<std::collections::BTreeSet<_>>().len();
    if regions > 0 {
        let message = format!(
            "{} written as outlines; to fill them, switch on filling in the marking software",
            counted(regions, "filled area is", "filled areas are")
        );
        facts.notices.push(Notice::note("fills-outlined", message));
    }
    if repaired.ambiguous_ends > 0 {
        let message = format!(
            "{} not joined, because more than two ends meet at one place",
            counted(repaired.ambiguous_ends, "line end is", "line ends are")
        );
        facts.notices.push(Notice::note("ends-not-joined", message));
    }
    let mut warn = |code: &str, message: String| facts.notices.push(Notice::warning(code, message));
    if let Some(widest) = widest(&repaired.nearly_closed) {
        let message = format!(
            "{} open by a small gap, at most {:.4} mm ({}); close them if they must be contours",
            counted(repaired.nearly_closed.len(), "outline is", "outlines are"),
            widest.gap,
            name(widest)
        );
        warn("nearly-closed", message);
    }
    if let Some((low, high)) = heights.filter(|(low, high)| high - low > FLAT) {
        let message = format!(
            "the drawing is not flat, it extends from z = {low:.3} to z = {high:.3} mm; it is projected from above, \
             so sloping lines become shorter"
        );
        warn("not-flat", message);
    }
}

/// Notices about texts: how many there are, and which fonts were replaced.
pub(super) fn text_notices(remarks: &Remarks, facts: &mut PatternFacts) {
    if remarks.texts.is_empty() {
        return;
    }
    let message = format!(
        "{} converted to the outlines or strokes of the letters",
        counted(remarks.texts.len(), "text was", "texts were")
    );
    facts.notices.push(Notice::note("texts-drawn", message));
    let mut uses: BTreeMap<_, usize> = BTreeMap::new();
    remarks.texts.values().flatten().for_each(|used| *uses.entry(used).or_default() += 1);
    for ((asked, used), count) in uses {
        let message = format!(
            "the font {asked} is not available: {} in {} instead, whose letters have other shapes and widths; if that \
             matters, convert the text to outlines in the drawing program",
            counted(count, "text is drawn", "texts are drawn"),
            used.name()
        );
        facts.notices.push(Notice::warning("font-replaced", message));
    }
}

/// Notices about lines that look different in the drawing program: wide, dashed or clipped.
pub(super) fn look_notices(
    structure: &Structure,
    remarks: &Remarks,
    dashed: Option<&(usize, EntityName)>,
    facts: &mut PatternFacts,
) {
    if !remarks.wide.is_empty() {
        let message = format!(
            "{} drawn as filled outlines; to mark a single line, set the width to 0",
            counted(remarks.wide.len(), "polyline with a width is", "polylines with a width are")
        );
        facts.notices.push(Notice::note("wide-lines", message));
    }
    if let Some((count, first)) = dashed {
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
    if let Some(page) = header.code_page.as_ref().filter(|page| {
        header.version.as_str() < "AC1021" && CodePage::named(page).is_none() && page.as_str() != "ascii"
    }) {
        let message = format!(
            "the code page {page} is unknown: letters outside ASCII are read as UTF-8 or Windows-1252"
        );
        facts.notices.push(Notice::warning("code-page-unknown", message));
    }
}

/// The error for a drawing without paths, with the most likely cause.
pub(super) fn nothing_to_mark(structure: &Structure, skipped: &[Skipped]) -> PatternReadError {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for skipped in skipped {
        *counts.entry(&skipped.entity).or_default() += 1;
    }
    let by_inkscape = producer(structure).is_some_and(|producer| producer.starts_with("Inkscape"));
    let remedy = if counts.is_empty() && by_inkscape {
        "Convert live text with Path > Object to Path and export again: Inkscape skips it without a warning."
            .into()
    } else if counts.is_empty() {
        "Convert live text, Bezier curves and solids to paths and export again: many exporters skip them."
            .into()
    } else {
        let reasons: std::collections::BTreeSet<&str> =
            skipped.iter().map(|skipped| skipped.why.as_ref()).collect();
        let first: Vec<&str> = reasons.into_iter().take(3).collect();
        format!(
            "Draw it as curves on a visible layer in model space; it was skipped because {}.",
            first.join("; ")
        )
    };
    let found = if counts.is_empty() {
        "it contains no entities".into()
    } else {
        let parts: Vec<String> = counts.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
        format!("it contains only {}", parts.join(", "))
    };
    PatternReadError::NothingToMark { found, remedy }
}

/// The error for a drawing in which nothing has a length.
pub(super) fn only_without_length(paths: usize) -> PatternReadError {
    PatternReadError::NothingToMark {
        found: format!("it contains only {} without length", counted(paths, "curve", "curves")),
        remedy: "Check the drawing's unit and size; draw dots to be marked as POINT entities.".into(),
    }
}

fn widest(found: &[Finding]) -> Option<&Finding> {
    found.iter().max_by(|a, b| a.gap.total_cmp(&b.gap))
}

fn name(found: &Finding) -> String {
    match &found.source.handle {
        Some(handle) => format!("{} {handle}", found.source.entity),
        None => found.source.entity.clone(),
    }
}
