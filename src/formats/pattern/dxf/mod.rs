//! DXF, text and binary, from R12 to R2018.
//!
//! ```text
//! bytes ─scan─▶ group codes ─structure─▶ inventory ─entities─▶ items ─blocks─▶ paths ─repair─▶ pattern + facts
//! ```
//!
//! The scan finds all group codes and their positions. Every entity in the inventory becomes a path or is listed as
//! skipped.

pub(super) mod scan;
mod code_page;
mod structure;
mod curves;
mod splines;
mod groups;
mod items;
mod entities;
mod polylines;
mod bands;
mod hatch;
mod hatch_lines;
mod text;
mod masks;
mod blocks;
mod findings;
pub(super) mod space;
pub(super) mod write;
pub(super) mod readback;

use super::content::without_misspelt;
use super::error::PatternReadError;
use super::facts::PatternFacts;
use super::units::{UnitHints, decide};
use super::{PatternOptions, PatternReading, budget, colour, findings as shared};
use crate::geometry::contour;
use crate::geometry::pattern::{Color, Layer, Path, Pattern};
use budget::Budget;

/// Largest error of the approximation of splines of a degree above 3, mm: far below the accuracy of a laser.
const SPLINE_TOLERANCE: f64 = 1e-4;

#[cfg(test)]
mod tests;

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
    let mut scan = scan::scan(bytes)?;
    let structure = structure::structure(&mut scan, budget)?;
    let header = &structure.header;
    let hints = UnitHints { code: header.unit_code, measurement: header.measurement };
    let (unit, unit_why, unit_notice) = decide(hints, options.unit, options.unit_if_unitless);

    let mut remarks = items::Remarks { strict: options.strict, ..items::Remarks::default() };
    let tolerance = SPLINE_TOLERANCE / unit.in_mm();
    let reader =
        items::Reader { scan: &scan, structure: &structure, tolerance, content: options.content.as_ref() };
    let unfolded = blocks::unfold(&reader, &mut remarks, budget, unit.in_mm(), options)?;
    if unfolded.paths.is_empty() {
        return Err(findings::nothing_to_mark(&structure, &unfolded.skipped));
    }
    let (layers, paths) = in_table_order(&structure, unfolded.layer_names, unfolded.paths);
    let drawn = paths.len();
    let extra_points = findings::extra_points(&structure, &scan, &remarks);
    remarks.fields.retain(|index, _| unfolded.drawn.contains(index));
    let (fields, misspelt) =
        without_misspelt(findings::fields(&structure, &scan, std::mem::take(&mut remarks.fields)));
    // The group codes are not needed any more, and the repair takes the most memory.
    drop(scan);
    let repaired = match options.strict {
        true => contour::examine(paths),
        false => contour::repair(paths, options.joining_tolerance),
    };
    if repaired.paths.is_empty() {
        return Err(shared::only_without_length(drawn));
    }

    let extents = shared::extents(&repaired.paths);
    let mut facts = PatternFacts {
        producer: findings::producer(&structure),
        version: findings::version(&structure.header.version),
        unit,
        unit_why,
        size: extents.size().into(),
        extents: [extents.min.x, extents.min.y, extents.max.x, extents.max.y],
        entities: findings::histogram(&structure),
        layers: findings::layers(&structure, &layers, &repaired.paths),
        skipped: unfolded.skipped,
        repairs: match options.strict {
            true => Vec::new(),
            false => shared::repairs(&repaired, &layers, options.joining_tolerance)
                .into_iter()
                .chain(findings::extra_points_removed(&remarks, extra_points))
                .collect(),
        },
        notices: unit_notice.into_iter().chain(misspelt).collect(),
        fields,
        picture: None,
    };
    findings::size_notices(&structure, &mut facts, options);
    remarks.texts.retain(|index, _| unfolded.drawn.contains(index));
    remarks.wide.retain(|index| unfolded.drawn.contains(index));
    shared::text_notices(remarks.texts.values(), &mut facts);
    findings::look_notices(&structure, &remarks, &unfolded.looks, &mut facts);
    facts.notices.extend(shared::hairline_notice(unfolded.hairlines.as_ref(), options.hairline));
    facts.notices.extend(findings::heavy_notice(unfolded.heavy.as_ref()));
    shared::drawing_notices(&repaired, &mut facts);
    facts.notices.extend(findings::height_notice(unfolded.heights));
    if options.strict {
        shared::unrepaired_notices(&repaired, &mut facts);
        facts.notices.extend(findings::extra_points_notice(&remarks));
    }
    Ok(PatternReading { pattern: Pattern { layers, paths: repaired.paths }, facts })
}

/// The layers with paths in the order of the file's layer table; layers that it does not define are last.
fn in_table_order(
    structure: &structure::Structure,
    names: Vec<String>,
    mut paths: Vec<Path>,
) -> (Vec<Layer>, Vec<Path>) {
    let entry = |name: &String| structure.entry(name);
    let mut order: Vec<usize> = (0..names.len()).collect();
    order.sort_by_key(|number| entry(&names[*number]).map_or(usize::MAX, |entry| entry.order));
    let mut place = vec![0; names.len()];
    order.iter().enumerate().for_each(|(new, old)| place[*old] = new);
    paths.iter_mut().for_each(|path| path.layer = place[path.layer]);
    let layer = |number: &usize| Layer {
        name: names[*number].clone(),
        color: entry(&names[*number]).map_or(Color::Aci(7), |entry| entry.color),
    };
    (order.iter().map(layer).collect(), paths)
}
