//! Facts and notices that drawings of every format have: their extents, what was repaired and what was skipped.

use std::collections::BTreeMap;

use super::error::{EntityName, PatternReadError};
use super::facts::{PatternFacts, Repair, RepairPlace, Skipped};
use super::font::{CONVERT_TO_OUTLINES, FontUses};
use crate::geometry::contour::{Finding, Repaired};
use crate::geometry::pattern::{Layer, Path, SAME_POINT, Shape};
use crate::geometry::space::Extents;
use crate::reason::Notice;

/// Largest number of reasons for skipped entities in a summary.
const MAX_REASONS: usize = 3;
/// Largest number of places in the list of a repair; there may be millions.
pub(super) const MAX_PLACES: usize = 1000;

/// The bounding rectangle of all paths, mm.
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

/// The notice about lines that are marked without their width, with their number and the first of them.
pub(super) fn hairline_notice(found: Option<&(usize, EntityName)>, hairline: f64) -> Option<Notice> {
    let (count, first) = found?;
    let message = format!(
        "{} narrower than {hairline} mm and marked once, along the centre line (first: {first}); to mark the width, set a \
         smaller `hairline_mm` under [pattern] (`--hairline`)",
        counted(*count, "line is", "lines are")
    );
    Some(Notice::note("hairlines-centred", message))
}

/// The repairs by kind, with their places.
pub(super) fn repairs(repaired: &Repaired, layers: &[Layer], tolerance: f64) -> Vec<Repair> {
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
    repairs
}

/// Warnings about problems that were not repaired because `strict` is set.
pub(super) fn unrepaired_notices(repaired: &Repaired, facts: &mut PatternFacts) {
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
}

/// A count with its noun.
pub(super) fn counted(count: usize, one: &str, more: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { more })
}

/// Notices about what is drawn.
pub(super) fn drawing_notices(repaired: &Repaired, facts: &mut PatternFacts) {
    if !facts.skipped.is_empty() {
        // Entities that draw nothing are mentioned only if nothing else is missing.
        let is_loss = facts.skipped.iter().any(|skipped| skipped.is_loss);
        let mut reported: Vec<&Skipped> =
            facts.skipped.iter().filter(|skipped| skipped.is_loss == is_loss).collect();
        reported.sort_by_key(|skipped| !skipped.is_ink);
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
        let shown = reported.iter().filter(|skipped| skipped.is_ink).count();
        let of_them = match shown {
            0 => String::new(),
            _ if shown == reported.len() => String::new(),
            _ => format!("; the drawing shows {shown} of them"),
        };
        let message = format!("{count} not marked{of_them} ({})", first.join("; "));
        let notice = if is_loss { Notice::warning } else { Notice::note };
        facts.notices.push(notice("not-taken", message));
    }
    let regions = repaired.paths.iter().filter_map(|path| path.region);
    let regions = regions.collect::<std::collections::BTreeSet<_>>().len();
    if regions > 0 {
        let message = format!(
            "{} written as outlines; to fill them evenly on the part, set `spacing_mm` under [fill] (`--fill 0.05`), otherwise hatch \
             them in the marking software",
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
    if let Some(widest) = widest(&repaired.nearly_closed) {
        let message = format!(
            "{} open by a small gap, at most {:.4} mm ({}); close them if they must be contours",
            counted(repaired.nearly_closed.len(), "outline is", "outlines are"),
            widest.gap,
            name(widest)
        );
        facts.notices.push(Notice::warning("nearly-closed", message));
    }
}

/// Notices about texts: how many there are, and which fonts were replaced.
pub(super) fn text_notices<'u>(texts: impl ExactSizeIterator<Item = &'u FontUses>, facts: &mut PatternFacts) {
    if texts.len() == 0 {
        return;
    }
    let message = format!(
        "{} converted to the outlines or strokes of the letters",
        counted(texts.len(), "text was", "texts were")
    );
    facts.notices.push(Notice::note("texts-drawn", message));
    let mut uses: BTreeMap<_, usize> = BTreeMap::new();
    texts.flatten().for_each(|used| *uses.entry(used).or_default() += 1);
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

/// What a drawing without paths contains instead.
pub(super) fn content(skipped: &[Skipped]) -> String {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for skipped in skipped {
        *counts.entry(&skipped.entity).or_default() += 1;
    }
    if counts.is_empty() {
        "it contains no entities".into()
    } else {
        let parts: Vec<String> = counts.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
        format!("it contains only {}", parts.join(", "))
    }
}

/// The error for a drawing that contains only texts whose letters are in no font; `None` for any other.
pub(super) fn only_without_font(skipped: &[Skipped]) -> Option<PatternReadError> {
    let lost = skipped.iter().filter(|skipped| skipped.is_loss);
    let whys: Option<std::collections::BTreeSet<&str>> =
        lost.map(|skipped| skipped.why.strip_suffix(CONVERT_TO_OUTLINES)).collect();
    let letters = match whys?.into_iter().collect::<Vec<_>>().as_slice() {
        [] => return None,
        [why] => why.strip_prefix("its ").unwrap_or(why).to_owned(),
        _ => "letters are in no available font".to_owned(),
    };
    Some(PatternReadError::NothingToMark {
        found: format!("{}, whose {letters}", content(skipped)),
        remedy: "Convert the text to outlines in the drawing program.".into(),
    })
}

/// The first reasons why entities were skipped, each with the first entity; lost ink comes first.
pub(super) fn reasons(skipped: &[Skipped]) -> String {
    let mut reasons: BTreeMap<(bool, &str), &Skipped> = BTreeMap::new();
    for one in skipped {
        reasons.entry((!one.is_ink, &one.why)).or_insert(one);
    }
    let named = |((_, why), one): ((bool, &str), &Skipped)| match &one.handle {
        Some(handle) => format!("{why} ({} {handle})", one.entity),
        None => format!("{why} ({})", one.entity),
    };
    let first: Vec<String> = reasons.into_iter().take(MAX_REASONS).map(named).collect();
    first.join("; ")
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
