//! Facts and notices about an SVG drawing.

use std::collections::BTreeMap;

use super::super::error::{EntityName, PatternReadError};
use super::super::facts::{LayerFacts, PatternFacts};
use super::super::findings::{content, counted, only_without_font, reasons};
use super::super::reading::Strokes;
use super::walk::{Drawn, Ground, LAYER_COLOR, Remarks};
use crate::geometry::pattern::Path;
use crate::reason::Notice;

/// Strokes wider than this, mm, look clearly different as centre lines: a fine laser line is a tenth as wide.
const WIDE: f64 = 0.3;

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
