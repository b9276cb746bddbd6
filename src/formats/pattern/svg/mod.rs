//! SVG: the static drawings of SVG 1.1, and what drawing programs write of SVG 2.
//!
//! ```text
//! bytes ─document─▶ XML ─style─▶ elements ─walk─▶ shapes ─area─▶ paths in mm ─repair─▶ pattern + facts
//! ```
//!
//! Every element that draws something becomes paths or is listed as skipped. Arcs, circles and ellipses stay exact.

mod clip;
mod css;
mod document;
mod length;
mod outline;
mod style;
mod area;
mod stroke;
mod page;
mod place;
mod selector;
mod syntax;
mod text;
mod variables;
mod walk;
mod findings;

pub(super) use document::{is_complete, is_svg};

use nalgebra::Vector2;

use super::budget::Budget;
use super::content::without_misspelt;
use super::error::{PatternReadError, Spot};
use super::facts::PatternFacts;
use super::findings as shared;
use super::reading::{PatternOptions, PatternReading, size_notice};
use crate::geometry::contour;
use crate::geometry::pattern::{Layer, Pattern};
use document::{Lines, attribute};
use style::{Sheets, Style};
use walk::{LAYER_COLOR, NO_LAYER, Walk};

pub(super) fn read(bytes: &[u8], options: &PatternOptions) -> Result<PatternReading, PatternReadError> {
    let mut budget = Budget::new(options.pace);
    let reading = read_within(&mut budget, bytes, options);
    if budget.takes_long() { Err(PatternReadError::TakesLong) } else { reading }
}

fn read_within(
    budget: &mut Budget,
    bytes: &[u8],
    options: &PatternOptions,
) -> Result<PatternReading, PatternReadError> {
    let text = document::decoded(bytes);
    let document = document::parsed(bytes, &text)?;
    let root = document.root_element();
    let producer = page::producer(&document);
    let sheets = Sheets::of(&document);
    let lines = Lines::of(&text);
    let style = sheets
        .style(root, &Style::default(), Vector2::zeros())
        .map_err(|too_many| too_many.at(lines.name(root, NO_LAYER)))?;
    let page = page::page(root, &style, producer.as_deref(), options).map_err(
        |page::Unread { what, text, why }| PatternReadError::SvgSize {
            spot: Spot::Line(lines.line(root)),
            what,
            text,
            why,
        },
    )?;
    let imports = findings::imports_notice(sheets.imports());

    let mut walk = Walk::new(root, sheets, lines, budget, options.strokes, page.pixel, text::draw);
    walk.hairline = options.hairline;
    walk.content = options.content.as_ref();
    walk.shown = Some(page.shown).filter(|_| !options.strict);
    walk.root(root, page.to_mm, page.viewport)?;
    let mut drawn = walk.drawn;
    if drawn.paths.is_empty() {
        return Err(findings::nothing_to_mark(&drawn));
    }
    let layers: Vec<Layer> =
        drawn.layers.iter().map(|name| Layer { name: name.clone(), color: LAYER_COLOR }).collect();
    let paths = std::mem::take(&mut drawn.paths);
    let off_page = page.size.and_then(|size| findings::off_page_notice(&paths, size));
    let count = paths.len();
    let repaired = match options.strict {
        true => contour::examine(paths),
        false => contour::repair(paths, options.joining_tolerance),
    };
    if repaired.paths.is_empty() {
        return Err(shared::only_without_length(count));
    }

    let extents = shared::extents(&repaired.paths);
    let version = attribute(root, "version").map_or("SVG".into(), |version| format!("SVG {version}"));
    let (fields, misspelt) = without_misspelt(std::mem::take(&mut drawn.fields));
    let mut facts = PatternFacts {
        producer,
        version: version.chars().take(20).collect(),
        unit: page.unit,
        unit_why: page.why,
        size: extents.size().into(),
        extents: [extents.min.x, extents.min.y, extents.max.x, extents.max.y],
        layers: findings::layers(&drawn, &repaired.paths),
        entities: drawn.entities,
        skipped: drawn.skipped,
        repairs: match options.strict {
            true => Vec::new(),
            false => shared::repairs(&repaired, &layers, options.joining_tolerance),
        },
        notices: page.notices.into_iter().chain(misspelt).collect(),
        fields,
        picture: None,
    };
    facts.notices.extend(size_notice(&facts));
    facts.notices.extend(imports);
    facts.notices.extend(off_page);
    shared::text_notices(drawn.remarks.texts.iter(), &mut facts);
    findings::look_notices(&drawn.remarks, options.strokes, &mut facts);
    facts.notices.extend(shared::hairline_notice(drawn.remarks.hairlines.as_ref(), options.hairline));
    shared::drawing_notices(&repaired, &mut facts);
    if options.strict {
        shared::unrepaired_notices(&repaired, &mut facts);
    }
    Ok(PatternReading { pattern: Pattern { layers, paths: repaired.paths }, facts })
}
