//! What a person is told about a drawing: where it comes from, what was mended, what looks wrong.

use std::collections::BTreeMap;

use super::super::error::PatternReadError;
use super::super::facts::{LayerFacts, NotTaken, PatternFacts};
use super::super::size_notice;
use super::super::units::DrawingUnit;
use super::PatternOptions;
use super::entities::Remarks;
use super::structure::{LayerRecord, Structure};
use crate::geometry::contour::{Closing, Joining};
use crate::geometry::pattern::{Layer, Path, Shape};
use crate::geometry::space::Extents;
use crate::reason::Notice;

/// Differences in height below this, mm, are rounding.
const FLAT: f64 = 0.01;
/// Gaps below this, mm, are rounding and not worth a word.
const ROUNDING: f64 = 1e-6;

/// How reasons end where nothing is lost.
const HARMLESS: &str = "draws nothing";

/// The dialect by name and version tag.
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

/// The program that wrote the file, by its comment or by the habits of its exporter.
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
    // Four variables and this seed: the frame of Inkscape's R14 export, always the same.
    let is_inkscape =
        header.version == "AC1014" && header.variables == 4 && header.handle_seed.as_deref() == Some("FFFF");
    is_inkscape.then(|| "Inkscape (told by its header)".into())
}

pub(super) fn histogram(structure: &Structure) -> BTreeMap<String, BTreeMap<String, usize>> {
    let mut counts: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for record in structure.drawn.iter().cloned().flatten().filter_map(|index| structure.entities.get(index))
    {
        let (kind, layer) = (structure.kind(record), structure.layer(record));
        // Looked up first: most entities are of a known kind on a known layer, and need no copy of the names.
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

pub(super) fn repairs(joining: &Joining, remarks: &Remarks, tolerance: f64) -> Vec<Notice> {
    let mut repairs = Vec::new();
    if joining.joined_pieces > 0 {
        let message = format!(
            "{} loose pieces were joined to {} contours and {} open lines (ends within {tolerance} mm)",
            joining.joined_pieces, joining.contours, joining.chains
        );
        repairs.push(Notice::note("pieces-joined", message));
    }
    let closed: Vec<&Closing> = joining.closed.iter().filter(|closing| closing.gap > ROUNDING).collect();
    if let Some(widest) = widest(closed.iter().copied()) {
        let message = format!(
            "{} nearly closed paths were closed, the widest gap {:.6} mm ({})",
            closed.len(),
            widest.gap,
            name(&joining.paths[widest.path])
        );
        repairs.push(Notice::note("contours-closed", message));
    }
    if remarks.extra_vertices > 0 {
        let message = format!(
            "{} LWPOLYLINE lost a first point at (0, 0) that their point count does not include",
            remarks.extra_vertices
        );
        repairs.push(Notice::warning("extra-point-removed", message));
    }
    repairs
}

/// Notices about the size, which tells wrong units.
pub(super) fn size_notices(structure: &Structure, facts: &mut PatternFacts, options: &PatternOptions) {
    let [width, height] = facts.size;
    let size = format!("{width:.3} x {height:.3} mm");
    let is_unitless = DrawingUnit::from_insunits(structure.header.unit_code.unwrap_or(0)).is_none();
    let is_assumed = is_unitless && options.unit.is_none() && options.unit_if_unitless.is_none();
    let by_inkscape = facts.producer.as_deref().is_some_and(|producer| producer.starts_with("Inkscape"));
    if is_assumed && by_inkscape {
        let factor = DrawingUnit::Pixel96.in_mm() / facts.unit.in_mm();
        let message = format!(
            "Inkscape wrote no unit, so its numbers are most likely pixels: then the drawing is {:.3} x {:.3} mm, \
             not {size} (factor 25.4/96); set the unit for drawings without one to px, or give the document the \
             unit mm in Inkscape",
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
pub(super) fn drawing_notices(joining: &Joining, heights: Option<(f64, f64)>, facts: &mut PatternFacts) {
    if !facts.not_taken.is_empty() {
        let first: Vec<String> = facts
            .not_taken
            .iter()
            .take(3)
            .map(|left| format!("{} on layer {}: {}", left.entity, left.layer, left.why))
            .collect();
        let message = format!(
            "{} not marked ({})",
            counted(facts.not_taken.len(), "entity is", "entities are"),
            first.join("; ")
        );
        let is_loss = facts.not_taken.iter().any(|left| !left.why.ends_with(HARMLESS));
        let notice = if is_loss { Notice::warning } else { Notice::note };
        facts.notices.push(notice("not-taken", message));
    }
    let mut warn = |code: &str, message: String| facts.notices.push(Notice::warning(code, message));
    if let [first, ..] = joining.duplicates.as_slice() {
        let message = format!(
            "{} drawn twice in the same place and will be marked twice (first {})",
            counted(joining.duplicates.len(), "path is", "paths are"),
            name(&joining.paths[*first])
        );
        warn("drawn-twice", message);
    }
    if let Some(widest) = widest(joining.nearly_closed.iter()) {
        let message = format!(
            "{} open by a small gap, the widest {:.4} mm ({}); close them if they are meant as contours",
            counted(joining.nearly_closed.len(), "outline is", "outlines are"),
            widest.gap,
            name(&joining.paths[widest.path])
        );
        warn("nearly-closed", message);
    }
    if let Some((low, high)) = heights.filter(|(low, high)| high - low > FLAT) {
        let message = format!(
            "the drawing is not flat, it reaches from z = {low:.3} to z = {high:.3} mm; it is taken as seen from \
             above, so sloping lines come out shorter"
        );
        warn("not-flat", message);
    }
}

/// Notices about texts: how many there are, and which fonts stand in for others.
pub(super) fn text_notices(remarks: &Remarks, facts: &mut PatternFacts) {
    if remarks.texts.is_empty() {
        return;
    }
    let message = format!(
        "{} turned into the outlines or strokes of their letters",
        counted(remarks.texts.len(), "text was", "texts were")
    );
    facts.notices.push(Notice::note("texts-drawn", message));
    let mut uses: BTreeMap<_, usize> = BTreeMap::new();
    remarks.texts.values().flatten().for_each(|used| *uses.entry(used).or_default() += 1);
    for ((asked, used), count) in uses {
        let message = format!(
            "the font {asked} is not at hand: {} in {} instead, whose letters have other shapes and widths; convert \
             text to outlines in the drawing program if that matters",
            counted(count, "text is drawn", "texts are drawn"),
            used.name()
        );
        facts.notices.push(Notice::warning("font-replaced", message));
    }
}

/// The refusal of a drawing without paths, with the most likely cause.
pub(super) fn nothing_to_mark(structure: &Structure, not_taken: &[NotTaken]) -> PatternReadError {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for left in not_taken {
        *counts.entry(&left.entity).or_default() += 1;
    }
    let by_inkscape = producer(structure).is_some_and(|producer| producer.starts_with("Inkscape"));
    let remedy = if counts.is_empty() && by_inkscape {
        "Inkscape leaves out live text without a word: convert it with Path > Object to Path, then export again.".into()
    } else if counts.is_empty() {
        "Export the drawing with its curves; live text, Bezier curves and solids are left out by many exporters unless \
         they are converted to paths."
            .into()
    } else {
        let reasons: std::collections::BTreeSet<&str> =
            not_taken.iter().map(|left| left.why.as_str()).collect();
        let first: Vec<&str> = reasons.into_iter().take(3).collect();
        format!(
            "Make curves of it on a visible layer of the model; it was left out because {}.",
            first.join("; ")
        )
    };
    let found = if counts.is_empty() {
        "it holds no entity".into()
    } else {
        let parts: Vec<String> = counts.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
        format!("it holds only {}", parts.join(", "))
    };
    PatternReadError::NothingToMark { found, remedy }
}

fn widest<'c>(closings: impl Iterator<Item = &'c Closing>) -> Option<&'c Closing> {
    closings.max_by(|a, b| a.gap.total_cmp(&b.gap))
}

fn name(path: &Path) -> String {
    match &path.source.handle {
        Some(handle) => format!("{} {handle}", path.source.entity),
        None => path.source.entity.clone(),
    }
}
