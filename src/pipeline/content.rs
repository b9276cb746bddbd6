//! Content that differs from product to product: checks the fields of a drawing, draws codes into their placeholders, and
//! measures them on the part.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::{Matrix2, Point3, Vector2};

use crate::config::{CodeSettings, ContentSettings, JobSettings, Placeholder};
use crate::formats::code::{self, Modules};
use crate::formats::pattern::{self, Content, FieldUse, FoundField, PatternFacts, filled, short};
use crate::geometry::mapping::LengthTrueMap;
use crate::geometry::pattern::{Affine, Path, Pattern, Segment, Shape, Source};
use crate::geometry::space::FlatPoint;
use crate::geometry::surface::fit::FittedSurface;
use crate::reason::{Notice, Place, Reason};
use crate::report::{CodeReport, ContentReport};

/// Most modules of all codes of a drawing.
const MOST_MODULES: usize = 2_000_000;
/// Sides and angles of a placeholder may differ from those of a rectangle by this share.
const SQUARENESS: f64 = 1e-3;
/// A cell that changes by more than this on the part may not be read.
const NOTABLE_DISTORTION: f64 = 10.0;
/// Most steps along a bar in which its width is measured.
const MOST_STEPS: usize = 50;
/// Most columns that a message names.
const MOST_COLUMNS: usize = 10;

/// A code in its placeholder.
#[derive(Debug, Clone)]
pub(super) struct PlacedCode {
    report: CodeReport,
    /// From modules, from the lower left of the code without its quiet zone, to mm of the drawing.
    frame: Affine,
    is_linear: bool,
}

/// Refuses a drawing with a field that has no value.
///
/// # Errors
/// The first such field, with its text, layer and handle.
pub(super) fn check_fields(facts: &PatternFacts, drawing: &str) -> Result<(), Reason> {
    match facts.fields.iter().find(|field| field.value.is_none()) {
        Some(field) => Err(without_value(field, drawing)),
        None => Ok(()),
    }
}

/// Where the values of fields come from.
#[derive(Debug, Clone, Copy)]
enum Values<'a> {
    /// From a row of the list with this name.
    Row(&'a str, &'a BTreeMap<String, String>),
    /// From settings or options, for the drawing with this name.
    Drawing(&'a str),
    /// From settings or options, for a code.
    Code,
}

fn without_value(FieldUse { field, why, entity, handle, layer, .. }: &FieldUse, drawing: &str) -> Reason {
    let item = handle.as_ref().map_or_else(|| entity.clone(), |handle| format!("{entity} {handle}"));
    no_value(field, why.as_deref(), Values::Drawing(drawing)).at(Place {
        item: Some(item),
        layer: Some(layer.clone()),
        ..Place::default()
    })
}

/// What to do about a column without a value.
fn remedy_for_column(column: &str, values: Values<'_>) -> String {
    let list = match values {
        Values::Row(list, row) if row.contains_key(column) => {
            return format!("Give a value for the column `{column}` in this row of {list}");
        }
        Values::Row(list, row) => {
            let instead =
                row.keys().next().map(|name| format!(", or change the field to `{{csv:{}}}`", short(name)));
            return format!("Name a column of {list} `{column}`{}", instead.unwrap_or_default());
        }
        Values::Drawing(name) => {
            name.rsplit_once('.').map(|(stem, _)| stem).filter(|stem| stem.contains('@'))
        }
        Values::Code => None,
    };
    let list = match list {
        Some(stem) => format!("drop {stem}.csv with a column `{column}` before the drawing"),
        None => {
            format!("drop a list with a column `{column}` before the drawing, {}", names_with_list(values))
        }
    };
    format!("In a station, {list}; on the command line, give `--content \"csv.{column}=VALUE\"`")
}

/// Names for a drawing and its list in a station: with an `@`, as a `.csv` file without it is a scan.
fn names_with_list(values: Values<'_>) -> String {
    let sku = match values {
        Values::Drawing(name) => name.split(['@', '.']).next().filter(|sku| !sku.is_empty()),
        Values::Row(..) | Values::Code => None,
    };
    let sku = sku.unwrap_or("can");
    format!("such as {sku}@label.csv for {sku}@label.dxf")
}

fn no_value(field: &str, why: Option<&str>, values: Values<'_>) -> Reason {
    let name = field.trim_matches(['{', '}']);
    let is_given = why.is_some_and(|why| !pattern::is_not_given(why));
    let remedy = match name.split(':').next().unwrap_or_default() {
        // The value cannot be shown as the field is written.
        "serial" if why.is_some_and(|why| why.contains("is not known")) => {
            "Write the field with a known format, such as {serial:06} for six digits or {serial} for any number".to_owned()
        }
        "serial" if is_given => {
            "Write the field with room for all numbers, such as {serial:08} for eight digits or {serial} for any number; or give smaller \
             numbers"
                .to_owned()
        }
        "date" if is_given => {
            "Write the field with a known format, such as {date:%d.%m.%Y} for 23.11.2026 or {date:%y%m%d} for 261123".to_owned()
        }
        "shift" | "sku" if is_given => "Write the field without a format".to_owned(),
        "sku" => "Correct the drawing for a SKU, with `isomark correct --sku`".to_owned(),
        "serial" => format!(
            "Give it with `isomark correct --content serial=17`, as `serial` under [content] in the settings beside the drawing, or with \
             `--list`; in a station, drop a list of the same name before the drawing, {}",
            names_with_list(values)
        ),
        "date" => "Give a known format, and the date with `isomark correct --date` or as `date` under [content]".to_owned(),
        "shift" => {
            "Give it with `isomark correct --content shift=NAME`, or as `shift` under [content], or `shifts` and a date"
                .to_owned()
        }
        "csv" => {
            remedy_for_column(name.split_once(':').map_or("COLUMN", |(_, column)| column), values)
        }
        _ => "Write the field without a format".to_owned(),
    };
    let remedy = match values {
        Values::Row(..) => remedy,
        Values::Drawing(_) | Values::Code => {
            format!("{remedy}. To mark the text itself, write `{{{field}}}`")
        }
    };
    Reason::new(
        "content-missing",
        format!("The field `{}` has no value: {}.", short(field), why.unwrap_or("none is given")),
        remedy,
    )
}

/// Checks the values of one product, from a row of `list`, for these fields and for the codes of the settings, without a
/// drawing.
///
/// # Errors
/// The first field without a value, or the first code that cannot be encoded.
pub fn check_values<'f>(
    fields: impl Iterator<Item = &'f str>,
    places: &BTreeSet<(String, Option<Arc<str>>)>,
    settings: &ContentSettings,
    values: &Content,
    list: &str,
) -> Result<(), Reason> {
    let row = Values::Row(list, &values.row);
    for field in fields {
        filled(field, values).map_err(|field| refused_field(&field, row))?;
    }
    let is_drawn = |code: &&CodeSettings| {
        places.iter().any(|(layer, block)| code.placeholder.is_at(layer, block.as_deref()))
    };
    for code in settings.codes.iter().filter(is_drawn) {
        encoded(code, values, row)?;
    }
    Ok(())
}

/// Checks the codes of settings whose content is the same for all products, without a drawing.
///
/// # Errors
/// The first code that cannot be encoded.
pub fn check_fixed_codes(settings: &ContentSettings) -> Result<(), Reason> {
    let nothing = Content::default();
    let is_fixed = |code: &&CodeSettings| filled(&code.content, &nothing).is_ok();
    settings
        .codes
        .iter()
        .filter(is_fixed)
        .try_for_each(|code| encoded(code, &nothing, Values::Code).map(drop))
}

/// Warns of the codes of settings that contain a text which is almost a field.
#[cfg(feature = "cli")]
pub(crate) fn misspelt_fields(settings: &ContentSettings) -> Vec<Notice> {
    settings.codes.iter().flat_map(misspelt).collect()
}

fn misspelt(code: &CodeSettings) -> Vec<Notice> {
    let place = format!("the content of the {} code on {}", code.kind, placeholder(code));
    pattern::misspelt_in(&code.content, &place)
}

fn refused_field(field: &FoundField, values: Values<'_>) -> Reason {
    no_value(&field.field, field.value.as_ref().err().map(String::as_str), values)
}

/// The content and the modules of a code.
fn encoded(settings: &CodeSettings, values: &Content, from: Values<'_>) -> Result<(String, Modules), Reason> {
    let at = || Place {
        item: Some("content.codes".into()),
        layer: match &settings.placeholder {
            Placeholder::Layer(layer) => Some(layer.clone()),
            _ => None,
        },
        ..Place::default()
    };
    let content = filled(&settings.content, values).map_err(|field| refused_field(&field, from).at(at()))?;
    let modules = code::encode(settings.kind, &content, settings.is_rectangular).map_err(|error| {
        Reason::new(
            "code-content",
            format!("The {} code of `{}` cannot be made: {error}.", settings.kind, short(&content)),
            "Shorten or correct `content` of this code (`codes` under [content]), or choose another `kind`.",
        )
        .at(at())
    })?;
    Ok((content, modules))
}

/// What a drawing has that depends on the product.
#[derive(Debug, Default)]
#[non_exhaustive]
pub struct Variable {
    /// The fields in its texts.
    pub fields: Vec<String>,
    /// The layers and blocks of its paths.
    pub places: BTreeSet<(String, Option<Arc<str>>)>,
}

/// What a drawing has that depends on the product, under these settings.
///
/// # Errors
/// When the drawing cannot be read.
pub fn variable(bytes: &[u8], settings: &JobSettings) -> Result<Variable, Reason> {
    let content = Some(settings.content.values.clone());
    let options = pattern::PatternOptions { content, ..settings.pattern.options() };
    let reading = pattern::read(bytes, &options).map_err(|error| error.reason())?;
    let layers = &reading.pattern.layers;
    let place = |path: &Path| Some((layers.get(path.layer)?.name.clone(), path.source.block.clone()));
    Ok(Variable {
        places: reading.pattern.paths.iter().filter_map(place).collect(),
        fields: reading.facts.fields.into_iter().map(|field| field.field).collect(),
    })
}

/// Replaces the rectangles on the layers of codes by the outlines of their inked cells.
///
/// # Errors
/// When a code cannot be encoded, a path on such a layer is not a rectangle, or there are too many codes.
pub(super) fn draw_codes(
    pattern: &mut Pattern,
    settings: &ContentSettings,
    notices: &mut Vec<Notice>,
) -> Result<Vec<PlacedCode>, Reason> {
    let mut placed = Vec::new();
    let mut region = pattern.paths.iter().filter_map(|path| path.region).max().map_or(0, |last| last + 1);
    let mut budget = MOST_MODULES;
    for code in &settings.codes {
        let is_of_code = |path: &Path| {
            let layer = pattern.layers.get(path.layer).map_or("", |layer| layer.name.as_str());
            code.placeholder.is_at(layer, path.source.block.as_deref())
        };
        if !pattern.paths.iter().any(is_of_code) {
            let message = match &code.placeholder {
                Placeholder::Layer(layer) => {
                    let layers: Vec<&str> = pattern.layers.iter().map(|layer| layer.name.as_str()).collect();
                    format!(
                        "the drawing has nothing on the layer {layer}; its layers are {}",
                        layers.join(", ")
                    )
                }
                Placeholder::Block(block) => format!("the drawing has no insert of the block {block}"),
            };
            let message = format!("no {} code is marked: {message}", code.kind);
            notices.push(Notice::warning("code-layer-missing", message));
            continue;
        }
        let (content, modules) = encoded(code, &settings.values, Values::Code)?;
        notices.extend(misspelt(code));
        let mut paths = Vec::with_capacity(pattern.paths.len());
        for path in &pattern.paths {
            if !is_of_code(path) {
                paths.push(path.clone());
                continue;
            }
            let layer = pattern.layers.get(path.layer).map_or("", |layer| layer.name.as_str());
            let rectangle = Rectangle::of(&path.shape).ok_or_else(|| not_a_rectangle(path, layer, code))?;
            let [columns, rows] = modules.size();
            budget = budget.checked_sub(columns * rows).ok_or_else(too_many)?;
            let one = one_code(&rectangle, (path, layer), code, &content, &modules, region, &mut paths);
            region = region.saturating_add(1);
            placed.push(one);
        }
        pattern.paths = paths;
    }
    Ok(placed)
}

fn placeholder(code: &CodeSettings) -> String {
    match &code.placeholder {
        Placeholder::Layer(layer) => format!("layer {layer}"),
        Placeholder::Block(block) => format!("block {block}"),
    }
}

fn too_many() -> Reason {
    Reason::new(
        "code-too-many",
        "The codes of the drawing have more modules than can be marked.",
        "Draw fewer placeholders, or shorten the content of the codes.",
    )
    .with_number("modules", MOST_MODULES as f64, "", Some(MOST_MODULES as f64))
}

fn not_a_rectangle(path: &Path, layer: &str, code: &CodeSettings) -> Reason {
    let Source { entity, handle, .. } = &path.source;
    let item = handle.as_ref().map_or_else(|| entity.clone(), |handle| format!("{entity} {handle}"));
    let (what, remedy) = match &code.placeholder {
        Placeholder::Block(block) => (
            format!(
                "The block {block} is the placeholder of a code, and a path in it is not a closed rectangle."
            ),
            "Draw only closed rectangles in this block, one for each code. Attributes of the block are drawn as texts.",
        ),
        Placeholder::Layer(name) => (
            format!(
                "The layer {name} is for placeholders of codes, and a path on it is not a closed rectangle."
            ),
            "Draw one closed rectangle for each code on this layer, and everything else on other layers.",
        ),
    };
    Reason::new("code-placeholder", what, remedy).at(Place {
        item: Some(item),
        layer: Some(layer.into()),
        ..Place::default()
    })
}

/// A placeholder: its lower left corner as the code is read, and its sides, mm.
struct Rectangle {
    corner: Vector2<f64>,
    sides: [Vector2<f64>; 2],
}

impl Rectangle {
    /// The rectangle that a path draws, with sides in any direction; `None` for another shape.
    fn of(shape: &Shape) -> Option<Self> {
        let Shape::Closed(segments) = shape else { return None };
        let mut corners: Vec<Vector2<f64>> = Vec::new();
        let mut ends = Vec::with_capacity(segments.len());
        for segment in segments {
            let Segment::Line { from, to } = segment else { return None };
            ends.push((from.coords(), to.coords()));
        }
        // Points on a straight side are no corners.
        for (index, (from, to)) in ends.iter().enumerate() {
            let (before, _) = ends[(index + ends.len() - 1) % ends.len()];
            let (one, other) = (from - before, to - from);
            if one.perp(&other).abs() > SQUARENESS * one.norm() * other.norm() {
                corners.push(*from);
            }
        }
        let [a, b, c, d] = corners[..] else { return None };
        let (u, v) = (b - a, d - a);
        let tolerance = SQUARENESS * u.norm().min(v.norm());
        let is_rectangle = u.norm() > 0.0
            && v.norm() > 0.0
            && (a + c - b - d).norm() <= tolerance
            && u.dot(&v).abs() <= SQUARENESS * u.norm() * v.norm();
        is_rectangle.then_some(())?;
        Some(Self { corner: a, sides: [u, v] })
    }

    /// The same with its first side along the code: the longer one if `is_long`, otherwise the one that is nearest to the
    /// drawing's x. It points to the right, or upwards.
    fn oriented(&self, is_long: bool) -> Self {
        let [u, v] = self.sides;
        let first_is_longer = u.norm() >= v.norm();
        let first_is_nearer = u.x.abs() * v.norm() >= v.x.abs() * u.norm() * (1.0 - SQUARENESS);
        let (mut along, mut across) = match if is_long { first_is_longer } else { first_is_nearer } {
            true => (u, v),
            false => (v, u),
        };
        let mut corner = self.corner;
        if along.x < -SQUARENESS * along.norm() || along.x.abs() <= SQUARENESS * along.norm() && along.y < 0.0
        {
            corner += along;
            along = -along;
        }
        if along.perp(&across) < 0.0 {
            corner += across;
            across = -across;
        }
        Self { corner, sides: [along, across] }
    }
}

/// Draws one code and returns its place.
fn one_code(
    rectangle: &Rectangle,
    (path, layer): (&Path, &str),
    settings: &CodeSettings,
    content: &str,
    modules: &Modules,
    region: u32,
    paths: &mut Vec<Path>,
) -> PlacedCode {
    let is_linear = settings.kind.is_linear();
    let [columns, rows] = modules.size();
    let Rectangle { corner, sides: [along, across] } =
        rectangle.oriented(is_linear || settings.is_rectangular);
    let quiet = settings.quiet_zone.unwrap_or(settings.kind.quiet_zone());
    let margin = [quiet, if is_linear { 0 } else { quiet }];
    let (width, height) = (along.norm(), across.norm());
    let whole = [columns + 2 * margin[0], rows + 2 * margin[1]].map(|count| count as f64);
    let (cell_x, cell_y) = match is_linear {
        true => (width / whole[0], height),
        false => {
            let cell = (width / whole[0]).min(height / whole[1]);
            (cell, cell)
        }
    };
    let (x, y) = (along / width, across / height);
    let middle = corner + (along + across) / 2.0;
    let size = Vector2::new(columns as f64 * cell_x, rows as f64 * cell_y);
    let frame = Affine {
        linear: Matrix2::from_columns(&[x * cell_x, y * cell_y]),
        offset: middle - x * (size.x / 2.0) - y * (size.y / 2.0),
    };
    let (drawn, shift) = match settings.is_inverted {
        true => (modules.with_margin(margin).inverted(), margin.map(|count| count as f64)),
        false => (modules.clone(), [0.0; 2]),
    };
    for corners in code::outlines(&drawn) {
        let point = |[column, row]: [usize; 2]| {
            frame.point(FlatPoint::new(column as f64 - shift[0], row as f64 - shift[1]))
        };
        let next = corners.iter().cycle().skip(1);
        let sides =
            corners.iter().zip(next).map(|(from, to)| Segment::Line { from: point(*from), to: point(*to) });
        paths.push(Path {
            layer: path.layer,
            color: path.color,
            shape: Shape::Closed(sides.collect()),
            region: Some(region),
            source: Source { is_stroke: true, ..path.source.clone() },
        });
    }
    let report = CodeReport {
        kind: settings.kind,
        content: content.to_owned(),
        layer: layer.into(),
        block: match &settings.placeholder {
            Placeholder::Block(block) => Some(block.clone()),
            Placeholder::Layer(_) => None,
        },
        handle: path.source.handle.clone(),
        modules: [columns, rows],
        quiet_zone: quiet,
        inverted: settings.is_inverted,
        cell_mm: cell_x,
        cell_on_part_mm: None,
        max_distortion_percent: None,
    };
    PlacedCode { report, frame, is_linear }
}

/// The part on which codes are measured.
#[derive(Debug, Clone, Copy)]
pub(super) enum OnPart<'a> {
    /// The side that faces the laser.
    Side(&'a LengthTrueMap, &'a FittedSurface),
    /// All of a part that turns.
    Round(&'a LengthTrueMap),
}

impl OnPart<'_> {
    /// Where a point of the placed drawing is on the part; `None` beside it.
    fn point(self, at: FlatPoint) -> Option<Point3<f64>> {
        match self {
            Self::Side(map, surface) => {
                let at = map.point(at);
                Some(Point3::new(at.x, at.y, surface.sampled_height(at)?))
            }
            Self::Round(map) => map.point_round(at),
        }
    }
}

/// What the report states about content: the values, if the drawing uses any, and its codes as they are on the part. `motion`
/// places the drawing; without a map the codes are not measured.
pub(super) fn report(
    codes: &[PlacedCode],
    facts: &PatternFacts,
    motion: &Affine,
    on_part: OnPart<'_>,
    settings: &JobSettings,
    notices: &mut Vec<Notice>,
) -> Option<ContentReport> {
    notices.extend(unused(facts, &settings.content));
    if codes.is_empty() && facts.fields.is_empty() {
        return None;
    }
    let measured = |code: &PlacedCode| {
        let mut report = code.report.clone();
        if let Some((sides, distortion)) = measured(code, motion, on_part) {
            report.cell_on_part_mm = Some(sides);
            report.max_distortion_percent = Some(distortion * 100.0);
        }
        report
    };
    let reports: Vec<CodeReport> = codes.iter().map(measured).collect();
    for code in &reports {
        let name = format!("the {} code `{}` on layer {}", code.kind, short(&code.content), code.layer);
        if let Some(distortion) = code.max_distortion_percent.filter(|percent| *percent > NOTABLE_DISTORTION)
        {
            let message = format!(
                "cells of {name} change by up to {distortion:.1} % on the part: readers may not decode it; make it smaller, or \
                 place it where the part is flatter"
            );
            notices.push(Notice::warning("code-distorted", message));
        }
        let smallest = code.cell_on_part_mm.map_or(code.cell_mm, |[smallest, _]| smallest);
        if let Some(spot) = settings.optics.spot.filter(|spot| smallest < *spot) {
            let message = format!(
                "cells of {name} are {smallest:.3} mm wide, and the laser's spot is {spot} mm: they run together; draw a larger \
                 placeholder or shorten the content"
            );
            notices.push(Notice::warning("code-finer-than-spot", message));
        }
        if settings.fill.spacing.is_none() || !settings.fill.includes(&code.layer) {
            let message = format!(
                "{name} is marked as the outlines of its cells: fill it with `[fill]` (`--fill`), or with a hatch of the marking \
                 software"
            );
            notices.push(Notice::note("code-outlines", message));
        }
    }
    Some(ContentReport::new(&settings.content.values, reports))
}

/// Warns of a serial number and of values of columns if the drawing marks none of them. A list may have more columns than a drawing
/// uses.
fn unused(facts: &PatternFacts, settings: &ContentSettings) -> Option<Notice> {
    let values = &settings.values;
    let texts = facts.fields.iter().map(|field| &field.field);
    let mut texts = texts.chain(settings.codes.iter().map(|code| &code.content));
    let is_used = texts.any(|text| text.contains("{serial") || text.contains("{csv:"));
    let serial = values.serial.map(|_| "a serial number".to_owned());
    let columns: Vec<&str> = values.row.keys().take(MOST_COLUMNS).map(String::as_str).collect();
    let columns = columns.first().map(|_| format!("values of {}", columns.join(", ")));
    let given: Vec<String> = serial.into_iter().chain(columns).collect();
    (!is_used && !given.is_empty()).then(|| {
        let message = format!(
            "given, but not marked: {}. The drawing has no field such as {{serial}} or {{csv:COLUMN}} for it; add the field, or leave \
             the value out",
            given.join(" and ")
        );
        Notice::warning("content-unused", message)
    })
}

/// Smallest and largest side of a cell on the part, mm, and the largest change of a side or diagonal as a share; `None` beside
/// the part.
fn measured(code: &PlacedCode, motion: &Affine, on_part: OnPart<'_>) -> Option<([f64; 2], f64)> {
    let frame = motion.after(&code.frame);
    let [columns, rows] = code.report.modules;
    let (width, height) = (frame.linear.column(0).norm(), frame.linear.column(1).norm());
    // A bar is measured in steps about as high as it is wide.
    let parts = if code.is_linear { ((height / width) as usize).clamp(1, MOST_STEPS) } else { 1 };
    let step = height / parts as f64;
    let point = |column: usize, row: usize| {
        on_part.point(frame.point(FlatPoint::new(column as f64, row as f64 / parts as f64)))
    };
    let row_of = |row: usize| (0..=columns).map(|column| point(column, row)).collect::<Option<Vec<_>>>();
    let (mut sides, mut worst) = ([f64::INFINITY, 0.0f64], 0.0f64);
    let mut note = |one: &Point3<f64>, other: &Point3<f64>, drawn: f64, is_side: bool| {
        let length = (one - other).norm();
        worst = worst.max((length / drawn - 1.0).abs());
        if is_side {
            sides = [sides[0].min(length), sides[1].max(length)];
        }
    };
    let mut below = row_of(0)?;
    for row in 0..=rows * parts {
        for ends in below.windows(2) {
            note(&ends[0], &ends[1], width, true);
        }
        if row == rows * parts {
            break;
        }
        let above = row_of(row + 1)?;
        for column in 0..=columns {
            note(&below[column], &above[column], step, !code.is_linear);
            if column < columns {
                let diagonal = width.hypot(step);
                note(&below[column], &above[column + 1], diagonal, false);
                note(&below[column + 1], &above[column], diagonal, false);
            }
        }
        below = above;
    }
    Some((sides, worst))
}
