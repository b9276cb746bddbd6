//! Facts and notices about an SVG drawing.

use std::collections::BTreeMap;

use nalgebra::Vector2;

use super::super::error::{EntityName, PatternReadError};
use super::super::facts::{LayerFacts, PatternFacts};
use super::super::findings::{content, counted, only_without_font, reasons};
use super::super::reading::Strokes;
use super::walk::{Drawn, Ground, LAYER_COLOR, Remarks};
use crate::geometry::pattern::{Path, Source};
use crate::geometry::space::Extents;
use crate::reason::Notice;

/// Strokes wider than this, mm, look clearly different as centre lines: a fine laser line is a tenth as wide.
const WIDE: f64 = 0.3;
/// What reaches less far beyond the page, mm, is rounding or half of a fine line along its edge.
const OFF_PAGE: f64 = 0.1;

pub(super) fn layers(drawn: &Drawn, paths: &[Path]) -> BTreeMap<String, LayerFacts> {
    let facts = |hidden: Option<&str>| LayerFacts {
        color: LAYER_COLOR.to_string(),
        paths: 0,
        hidden: hidden.map(str::to_owned),
    };
    let hidden = drawn.hidden_layers.iter().map(|name| (name.clone(), facts(Some("hidden"))));
    let mut layers: BTreeMap<String, LayerFacts> = hidden.collect();
    for name in &drawn.layers {
        layers.insert(name.clone(), facts(None));
    }
    for path in paths {
        if let Some(layer) = drawn.layers.get(path.layer).and_then(|name| layers.get_mut(name)) {
            layer.paths += 1;
        }
    }
    layers
}

/// The notice about what is beyond the page of this size, mm, where other programs show nothing.
pub(super) fn off_page_notice(paths: &[Path], size: Vector2<f64>) -> Option<Notice> {
    let page = Extents { min: Vector2::zeros(), max: size }.grown(OFF_PAGE);
    // Of each area and line, whether some of it is beyond the page, and whether all of it is.
    let mut shapes: BTreeMap<(Option<u32>, usize), (bool, bool)> = BTreeMap::new();
    let mut first = None;
    let mut reach = Extents::EMPTY;
    for (index, path) in paths.iter().enumerate() {
        let Extents { min, max } = path.shape.extents();
        let is_beyond = !(page.contains(min) && page.contains(max));
        let is_whole = (0..2).any(|axis| min[axis] > page.max[axis] || max[axis] < page.min[axis]);
        let shape = (path.region, path.region.map_or(index, |_| 0));
        let (some, all) = shapes.entry(shape).or_insert((false, true));
        *some |= is_beyond;
        *all &= is_whole;
        if is_beyond {
            first.get_or_insert(&path.source);
            reach.include(min);
            reach.include(max);
        }
    }
    let Source { entity, handle, .. } = first?;
    let beyond = shapes.values().filter(|(some, _)| *some).count();
    let whole = shapes.values().filter(|(_, all)| *all).count();
    let farthest = (reach.max - size).max().max(-reach.min.min());
    let message = format!(
        "{} beyond the page of {:.3} x {:.3} mm by up to {farthest:.3} mm ({whole} of them as a whole; first: {entity} {}). Programs \
         that show the drawing show nothing there, and isomark marks it. From the lower left corner of the page, it reaches from x \
         {:.3} to {:.3} mm and from y {:.3} to {:.3} mm. Delete what must not be marked, or enlarge the page to the drawing",
        counted(beyond, "shape or line reaches", "shapes or lines reach"),
        size.x,
        size.y,
        handle.as_deref().unwrap_or_default(),
        reach.min.x,
        reach.max.x,
        reach.min.y,
        reach.max.y,
    );
    Some(Notice::warning("svg-off-page", message))
}

/// Notices about what looks different on paper or screen.
pub(super) fn look_notices(remarks: &Remarks, strokes: Strokes, facts: &mut PatternFacts) {
    let mut add = |notice: Notice| facts.notices.push(notice);
    if let (Some((width, widest)), Strokes::Center) = (&remarks.widest, strokes) {
        let message = format!(
            "{} marked along the centre line; the widest is {width:.3} mm ({widest}); to mark strokes at their full width, give \
             `--strokes band` (`strokes` under [pattern])",
            counted(remarks.strokes, "stroke is", "strokes are"),
        );
        add(if *width > WIDE {
            Notice::warning("svg-strokes", message)
        } else {
            Notice::note("svg-strokes", message)
        });
    }
    let named = |found: &Option<(usize, EntityName)>, one: &str, more: &str| {
        found.as_ref().map(|(count, first)| (counted(*count, one, more), first.to_string()))
    };
    if let Some(Ground { name, is_lowest }) = &remarks.ground {
        let message = format!(
            "the white {name} covers the whole page: it is its ground and is not marked. To mark it, give it another colour"
        );
        add(match is_lowest {
            true => Notice::note("svg-ground", message),
            false => Notice::warning(
                "svg-ground",
                format!(
                    "{message}. Something below it is not marked either: check that it is no part of the drawing"
                ),
            ),
        });
    }
    if let Some((count, first)) = named(&remarks.white, "shape is", "shapes are") {
        let message = format!(
            "{count} white but marked like all others (first: {first}); if white is the colour of the ground, delete \
             these shapes, or cut what they cover"
        );
        add(Notice::warning("svg-white", message));
    }
    if let Some((count, first)) = named(&remarks.servers, "shape has", "shapes have") {
        let message = format!(
            "{count} a gradient or pattern as colour (first: {first}); the whole area is marked, without shades"
        );
        add(Notice::warning("svg-shades", message));
    }
    if let Some((count, first)) = named(&remarks.transparent, "shape is", "shapes are") {
        let message = format!("{count} partly transparent but marked like all others (first: {first})");
        add(Notice::note("svg-transparent", message));
    }
    if let Some((count, first)) = named(&remarks.cut, "shape or line is", "shapes or lines are") {
        let message = format!(
            "{count} cut by clip paths or the edges of nested drawings (first: {first}); cut curves become short lines within 0.0005 mm"
        );
        add(Notice::note("svg-clipped", message));
    }
    if let Some((count, first)) = named(&remarks.undashed, "line has", "lines have") {
        let message = format!(
            "{count} too many dashes and is marked without gaps (first: {first}); to mark the gaps, convert the dashes \
             to paths in the drawing program"
        );
        add(Notice::warning("dashed-whole", message));
    }
}

/// The notice about style sheets in other files.
pub(super) fn imports_notice(imports: &[String]) -> Option<Notice> {
    let message = format!(
        "{} not read (first: {}); if one of them hides or changes what is marked, export the drawing as plain SVG",
        counted(imports.len(), "style sheet in another file is", "style sheets in other files are"),
        imports.first()?
    );
    Some(Notice::warning("svg-style", message))
}

/// The error for a drawing without paths, with the most likely cause.
pub(super) fn nothing_to_mark(Drawn { skipped, remarks, .. }: &Drawn) -> PatternReadError {
    if let (Some(_), []) = (&remarks.ground, skipped.as_slice()) {
        return PatternReadError::NothingToMark {
            found: "it contains only the white ground of the page".into(),
            remedy: "To mark a rectangle over the whole page, give it another colour.".into(),
        };
    }
    if let Some(error) = only_without_font(skipped) {
        return error;
    }
    let remedy = match skipped.is_empty() {
        true => {
            "Check that this is the right file; draw what is to be marked as paths, shapes or text.".into()
        }
        false => format!(
            "Draw it as paths, shapes or text that are visible; it was skipped because {}.",
            reasons(skipped)
        ),
    };
    PatternReadError::NothingToMark { found: content(skipped), remedy }
}
