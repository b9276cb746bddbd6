//! Unfolds inserts: every entity at its final place, with its final layer and colour.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::Vector3;

use super::super::error::{EntityName, PatternReadError};
use super::budget::{Budget, Cost};
use super::colour::is_white;
use super::curves::{Curve, Placement, vanishing};
use super::items::{Grid, Insert, Item, Reader, Remarks, WideLine};
use super::masks::Mask;
use super::scan::Scan;
use super::structure::{Appearance, LayerRecord, PointMode, Record, RecordColor, Structure};
use crate::formats::pattern::{PatternOptions, Skipped, Space, is_among};
use crate::geometry::pattern::{Color, Path, SAME_POINT, Shape, Source};
use crate::geometry::space::{Extents, FlatPoint};

/// Largest depth of nested blocks.
const MAX_DEPTH: usize = 32;
pub(super) const IN_PAPER_SPACE: &str = "it is in paper space, not in model space";
const IN_MODEL_SPACE: &str = "it is in model space, not on the sheet in paper space";
/// The reason for listing a text that is drawn itself.
const HIDES_LINES: &str = "only its letters would be marked, not its background, which hides lines behind it: trim these lines, or \
                           remove the background";
const ON_OTHER_SHEET: &str = "it is on another sheet in paper space";
/// Line weights up to this, mm, are those of any drawing: 0.25 is AutoCAD's default, and 0.35 the wide line of small ones.
const USUAL_WEIGHT: f64 = 0.35;
/// Largest coordinate, mm: ten kilometres.
pub(super) const MAX_COORDINATE: f64 = 1e7;

/// The drawing after unfolding, in file order.
#[derive(Default)]
pub(super) struct Unfolded {
    /// Paths with layers numbered by `layer_names`.
    pub(super) paths: Vec<Path>,
    pub(super) layer_names: Vec<String>,
    /// Lowest and highest z of the drawing, mm.
    pub(super) heights: Option<(f64, f64)>,
    pub(super) skipped: Vec<Skipped>,
    /// What looks different in the drawing program.
    pub(super) looks: Looks,
    /// Lines that are plotted much wider than a laser's line.
    pub(super) heavy: Option<HeavyLines>,
    /// Entities of the inventory that produced several strokes or a fill, such as texts and wide lines.
    pub(super) drawn: BTreeSet<usize>,
    /// Lines that are drawn without their width, because it is less than that of a beam.
    pub(super) hairlines: Found,
}

/// Number of entities of some kind, and the first of them.
pub(super) type Found = Option<(usize, EntityName)>;

/// Entities that look different in the drawing program.
#[derive(Default)]
pub(super) struct Looks {
    /// Lines with dashes or dots, which are read without gaps.
    pub(super) dashed: Found,
    /// Points that are shown as symbols.
    pub(super) symbols: Found,
    /// Filled areas and hatches, if the drawing shows no fills.
    pub(super) unfilled: Found,
    /// White fills, which hide what is below them.
    pub(super) white: Found,
    /// Hatches with a gradient.
    pub(super) gradients: Found,
    /// Partly transparent entities.
    pub(super) transparent: Found,
}

/// Lines with a large line weight, which are read as lines without a width.
pub(super) struct HeavyLines {
    pub(super) count: usize,
    pub(super) first: EntityName,
    /// The largest line weight, mm.
    pub(super) widest: f64,
}

/// Unfolds all entities that are drawn; `unit` is the length of one unit of the drawing, mm.
///
/// # Errors
/// When a number cannot be read, a block contains itself, the budget is exceeded, or a coordinate is too large.
pub(super) fn unfold(
    reader: &Reader<'_>,
    remarks: &mut Remarks,
    budget: &mut Budget,
    unit: f64,
    options: &PatternOptions,
) -> Result<Unfolded, PatternReadError> {
    let sheet = match &options.space {
        Space::Model => None,
        Space::Paper(name) => Some(reader.structure.sheet(name.as_deref())?),
    };
    let items = reader.block_items(remarks, budget)?;
    let held = budget.spent(Cost::Held);
    let mut unfolding = Unfolding {
        scan: reader.scan,
        structure: reader.structure,
        items: &items,
        result: Unfolded::default(),
        layer_numbers: BTreeMap::new(),
        listed: BTreeSet::new(),
        budget,
        regions: 0,
        open_blocks: Vec::new(),
        masks: Vec::new(),
        grids: BTreeMap::new(),
        hairline: options.hairline,
        ink_layers: options.ink_layers.as_deref(),
        is_paper: sheet.is_some(),
    };
    let ground = Context {
        placement: Placement::scaling(unit),
        layer: None,
        color: Color::Aci(7),
        appearance: Appearance::usual(),
        block: None,
    };
    // Entities outside blocks are needed only once, so they are read one by one to save memory.
    for index in reader.structure.drawn.iter().cloned().flatten() {
        if let Some(sheet) = &sheet
            && let Some(record) = reader.structure.entities.get(index)
            && !(record.in_paper_space && sheet.is_active)
        {
            let why = if record.in_paper_space { ON_OTHER_SHEET } else { IN_MODEL_SPACE };
            unfolding.leave_out(index, why);
            continue;
        }
        let item = reader.item(index, remarks, unfolding.budget)?;
        unfolding.entity(index, &item, &ground)?;
        unfolding.budget.release(held);
    }
    for (block, content) in reader.structure.paper_sheets() {
        let is_read = sheet.as_ref().is_some_and(|sheet| sheet.block == *block);
        for index in content.entities.clone() {
            match items.get(index) {
                Some(item) if is_read => unfolding.entity(index, item, &ground)?,
                _ => {
                    unfolding.leave_out(index, if sheet.is_some() { ON_OTHER_SHEET } else { IN_PAPER_SPACE })
                }
            }
        }
    }
    unfolding.list_masks()?;
    for index in remarks.gradients.iter().filter(|index| unfolding.result.drawn.contains(index)) {
        if let Some(record) = reader.structure.entities.get(*index) {
            let name = || reader.structure.name(reader.scan, record);
            count(&mut unfolding.result.looks.gradients, name);
        }
    }
    Ok(unfolding.result)
}

/// Where and how the content of a block is drawn.
struct Context {
    placement: Placement,
    /// The layer that replaces layer 0 inside a block.
    layer: Option<String>,
    /// The colour that replaces BYBLOCK.
    color: Color,
    /// What replaces BYBLOCK in the appearance of entities.
    appearance: Appearance,
    /// The block whose definition is drawn.
    block: Option<Arc<str>>,
}

/// What is missing in the pattern because an entity was skipped.
#[derive(Clone, Copy, PartialEq)]
enum Missing {
    /// Nothing, because it draws nothing.
    Nothing,
    /// Lines that the drawing does not show or plot, or construction lines.
    Hidden,
    /// Ink.
    Ink,
}

/// The layer for definition points of dimensions, which no program plots.
const NEVER_PLOTTED: &str = "DEFPOINTS";

/// Layer and colour of the paths of an entity.
#[derive(Clone, Copy)]
struct Look<'l> {
    layer: &'l str,
    color: Color,
    /// Whether the entity draws several strokes, see [`Source::is_stroke`].
    is_stroke: bool,
    block: Option<&'l Arc<str>>,
}

struct Unfolding<'u> {
    scan: &'u Scan<'u>,
    structure: &'u Structure,
    items: &'u [Item],
    result: Unfolded,
    layer_numbers: BTreeMap<String, usize>,
    /// Entities in blocks that are already listed as skipped, with layer and reason, as a block may be drawn many
    /// times.
    listed: BTreeSet<(usize, String, Cow<'static, str>)>,
    budget: &'u mut Budget,
    regions: u32,
    open_blocks: Vec<String>,
    masks: Vec<PlacedMask>,
    /// The rows and columns of inserts by their position in the inventory, for the attributes that follow them; only of several copies.
    grids: BTreeMap<usize, Grid>,
    /// Width below which lines are drawn without a width, mm.
    hairline: f64,
    /// The layers that are marked; all if none is named.
    ink_layers: Option<&'u [String]>,
    /// Whether a sheet in paper space is read.
    is_paper: bool,
}

/// The background of a text at its final place.
struct PlacedMask {
    mask: Mask,
    /// Number of paths before it in the file.
    before: usize,
    /// The text in the inventory, and its final layer.
    text: (usize, String),
}

impl<'u> Unfolding<'u> {
    /// Lists an entity of the space or of a sheet that is not read.
    fn leave_out(&mut self, index: usize, why: &'static str) {
        let Some(record) = self.structure.entities.get(index) else { return };
        let missing = match self.structure.kind(record) {
            "VIEWPORT" => Missing::Nothing,
            _ => Missing::Hidden,
        };
        self.skip(index, record, self.structure.layer(record), why.into(), missing);
    }

    /// Whether a line is too narrow to be marked in its width.
    fn is_hairline(&self, line: &WideLine, context: &Context) -> bool {
        line.width * context.placement.largest_scale() < self.hairline
    }

    fn entity(&mut self, index: usize, item: &Item, context: &Context) -> Result<(), PatternReadError> {
        let structure = self.structure;
        let Some(record) = structure.entities.get(index) else { return Ok(()) };
        self.spend(Cost::Unfolded, 1, record)?;
        let of_insert;
        let mut context = context;
        let mut grid = Grid::single();
        if let Some((number, insert)) = record
            .insert
            .map(|number| number as usize)
            .and_then(|number| Some((number, structure.entities.get(number)?)))
        {
            let (layer, entry) = layer_of(structure, insert, context);
            if why_hidden(insert, entry, true, self.is_paper).is_some() {
                let why = "the block that it belongs to is hidden";
                self.skip(index, record, layer, why.into(), Missing::Hidden);
                return Ok(());
            }
            // An attribute belongs to the insert, not to the definition of its block.
            of_insert = self.inside(insert, context, context.placement, (layer, context.block.clone()));
            context = &of_insert;
            grid = self.grids.get(&number).copied().unwrap_or(grid);
        }
        let (layer, entry) = layer_of(structure, record, context);
        let is_insert = matches!(item, Item::Insert(_));
        if let Some(why) = why_hidden(record, entry, is_insert, self.is_paper) {
            // The definition points of dimensions are not ink.
            let is_aid = layer.eq_ignore_ascii_case(NEVER_PLOTTED);
            let missing = if is_aid { Missing::Nothing } else { Missing::Hidden };
            self.skip(index, record, layer, why.into(), missing);
            return Ok(());
        }
        let color = own_color(record, context);
        let is_hairline = matches!(item, Item::Wide(line) if self.is_hairline(line, context));
        let name = || structure.name(self.scan, record);
        if is_hairline {
            count(&mut self.result.hairlines, name);
        }
        let appearance = record.appearance(entry, context.appearance);
        if matches!(item, Item::Curve(_) | Item::Wide(_)) && appearance.is_dashed {
            count(&mut self.result.looks.dashed, name);
        }
        if matches!((item, structure.header.points), (Item::Dot(_), PointMode::Symbols(_))) {
            count(&mut self.result.looks.symbols, name);
        }
        let is_hatch = matches!(structure.kind(record), "HATCH" | "MPOLYGON");
        let is_fill = match item {
            Item::Fill(_) => true,
            Item::Wide(_) => !is_hairline,
            _ => false,
        };
        if structure.header.hides_fills && (is_fill || is_hatch && matches!(item, Item::Several(_))) {
            count(&mut self.result.looks.unfilled, name);
        }
        let final_color = match color {
            Color::ByLayer => entry.map_or(Color::Aci(7), |entry| entry.color),
            own => own,
        };
        if is_fill && is_white(final_color) && is_among(self.ink_layers, layer) {
            count(&mut self.result.looks.white, name);
        }
        let is_drawn =
            is_fill || matches!(item, Item::Dot(_) | Item::Curve(_) | Item::Wide(_) | Item::Several(_));
        if is_drawn && appearance.is_transparent() && is_among(self.ink_layers, layer) {
            count(&mut self.result.looks.transparent, name);
        }
        if let (Item::Curve(_), Some(weight)) = (item, appearance.line_weight().filter(|w| *w > USUAL_WEIGHT))
            && is_among(self.ink_layers, layer)
        {
            let first = || HeavyLines { count: 0, first: name(), widest: 0.0 };
            let heavy = self.result.heavy.get_or_insert_with(first);
            heavy.count += 1;
            heavy.widest = heavy.widest.max(weight);
        }
        if !is_hairline && matches!(item, Item::Several(_) | Item::Fill(_) | Item::Wide(_)) {
            self.result.drawn.insert(index);
        }
        if let Item::Insert(insert) = item {
            // If the block is missing, the layers of its content are unknown; this layer is assumed.
            let missing = match why_hidden(record, entry, false, self.is_paper) {
                Some(_) => Missing::Hidden,
                None => Missing::Ink,
            };
            if insert.grid.copies() > 1 {
                self.grids.insert(index, insert.grid);
            }
            return self.insert(index, record, insert, context, (layer, missing));
        }
        let look = Look { layer, color, is_stroke: false, block: context.block.as_ref() };
        let before = self.spent();
        self.item(index, record, item, context, look)?;
        // What is not drawn is listed once.
        let is_drawn =
            !matches!(item, Item::Template | Item::DrawsNothing(_) | Item::Unseen(_) | Item::Skipped(_));
        let copies = if is_drawn { grid.copies() } else { 1 };
        if copies > 1 {
            self.check_copies(before, copies, record)?;
        }
        for copy in 1..copies {
            self.spend(Cost::Unfolded, 1, record)?;
            let shift = Placement { offset: grid.shift(copy), ..Placement::scaling(1.0) };
            let inner = Context {
                placement: context.placement.after(&shift),
                layer: context.layer.clone(),
                block: context.block.clone(),
                ..*context
            };
            self.item(index, record, item, &inner, look)?;
        }
        Ok(())
    }

    fn item(
        &mut self,
        index: usize,
        record: &Record,
        item: &Item,
        context: &Context,
        look: Look<'_>,
    ) -> Result<(), PatternReadError> {
        let placed = |curve: &Curve| -> Vec<_> {
            curve.segments.iter().map(|segment| segment.placed(&context.placement)).collect()
        };
        match item {
            Item::Insert(_) => {}
            Item::DrawsNothing(why) => {
                self.skip(index, record, look.layer, (*why).into(), Missing::Nothing);
            }
            Item::Unseen(why) => {
                self.skip(index, record, look.layer, (*why).into(), Missing::Hidden);
            }
            Item::Skipped(why) => self.skip(index, record, look.layer, why.clone(), Missing::Ink),
            // In a block it is only the template for the attributes of the inserts, which are separate texts.
            Item::Template if !self.open_blocks.is_empty() => {}
            Item::Template => {
                let why = "it is the template of an attribute: replace it with a text";
                self.skip(index, record, look.layer, why.into(), Missing::Hidden);
            }
            Item::Several(items) => {
                for (own, item) in items {
                    let color = match own {
                        Some(RecordColor::ByBlock) => context.color,
                        Some(RecordColor::Own(own)) => *own,
                        None => look.color,
                    };
                    self.item(index, record, item, context, Look { color, is_stroke: true, ..look })?;
                }
            }
            Item::Dot(point) => {
                self.spend(Cost::Drawn, 1, record)?;
                let point = context.placement.point(*point);
                self.check_reach(point.amax(), record)?;
                self.include_height(point.z);
                let shape = Shape::Dot(FlatPoint::new(point.x, point.y));
                self.push(shape, None, look, record);
            }
            Item::Mask(corners) => {
                let corners = corners.map(|corner| context.placement.point(corner));
                self.check_reach(corners.iter().map(|corner| corner.amax()).fold(0.0, f64::max), record)?;
                let mask = Mask::new(corners.map(|corner| FlatPoint::new(corner.x, corner.y)));
                let (before, text) = (self.result.paths.len(), (index, look.layer.to_owned()));
                self.masks.extend(mask.map(|mask| PlacedMask { mask, before, text }));
            }
            Item::Curve(curve) => {
                let segments = placed(curve);
                if matches!(self.structure.kind(record), "ARC" | "CIRCLE" | "ELLIPSE")
                    && let Some((radius, turn)) = vanishing(&segments, SAME_POINT)
                {
                    let why = format!(
                        "it draws nothing, with a radius of {radius:.7} mm and an angle of {:.7} deg: delete it, or \
                         draw it again, as a circle if it must be a full turn",
                        turn.to_degrees()
                    );
                    self.skip(index, record, look.layer, why.into(), Missing::Ink);
                    return Ok(());
                }
                let shape = self.shape(&segments, curve.closed, record)?;
                self.push(shape, None, look, record);
            }
            Item::Wide(line) if self.is_hairline(line, context) => {
                let shape = self.shape(&placed(&line.centre), line.centre.closed, record)?;
                self.push(shape, None, look, record);
            }
            Item::Wide(line) => self.fill(&line.area, context, look, record)?,
            Item::Fill(contours) => self.fill(contours, context, look, record)?,
        }
        Ok(())
    }

    /// The contours of one filled region.
    fn fill(
        &mut self,
        contours: &[Curve],
        context: &Context,
        look: Look<'_>,
        record: &Record,
    ) -> Result<(), PatternReadError> {
        self.regions += 1;
        for contour in contours {
            let segments: Vec<_> =
                contour.segments.iter().map(|segment| segment.placed(&context.placement)).collect();
            let shape = self.shape(&segments, true, record)?;
            self.push(shape, Some(self.regions), look, record);
        }
        Ok(())
    }

    fn insert(
        &mut self,
        index: usize,
        record: &Record,
        insert: &Insert,
        context: &Context,
        (layer, missing): (&str, Missing),
    ) -> Result<(), PatternReadError> {
        let structure = self.structure;
        let key = insert.block.to_uppercase();
        let Some(block) = structure.blocks.get(&key) else {
            let why = format!("its block {} is not defined in the file", insert.block);
            self.skip(index, record, layer, why.into(), missing);
            return Ok(());
        };
        if block.external {
            let why = "it is a reference to another file: bind the reference before exporting";
            self.skip(index, record, layer, why.into(), missing);
            return Ok(());
        }
        if self.open_blocks.contains(&key) {
            let entity = structure.name(self.scan, record);
            return Err(PatternReadError::RecursiveBlock { block: block.name.clone(), entity });
        }
        if self.open_blocks.len() == MAX_DEPTH {
            return Err(self.too_many("levels of nested blocks", MAX_DEPTH, record));
        }
        let copies = insert.grid.copies();
        self.check_cost(Cost::Copies, copies, record)?;
        self.open_blocks.push(key);
        let name: Arc<str> = block.name.as_str().into();
        let base = Placement {
            linear: nalgebra::Matrix3::identity(),
            offset: -Vector3::new(block.base[0], block.base[1], block.base[2]),
        };
        let before = self.spent();
        for copy in 0..copies {
            let mut placement = insert.placement;
            placement.offset += insert.grid.shift(copy);
            let placement = context.placement.after(&placement.after(&base));
            let inner = self.inside(record, context, placement, (layer, Some(name.clone())));
            // Empty blocks are counted, too, because a large array of them would take very long.
            self.spend(Cost::Copies, 1, record)?;
            let items = self.items;
            for inside in block.entities.clone() {
                if let Some(item) = items.get(inside) {
                    self.entity(inside, item, &inner)?;
                }
            }
            if copy == 0 {
                self.check_copies(before, copies, record)?;
            }
        }
        self.open_blocks.pop();
        Ok(())
    }

    /// The context that an insert gives to its content and its attributes.
    fn inside(
        &self,
        insert: &Record,
        context: &Context,
        placement: Placement,
        (layer, block): (&str, Option<Arc<str>>),
    ) -> Context {
        let entry = self.structure.entry(layer);
        let color = match own_color(insert, context) {
            Color::ByLayer => entry.map_or(Color::Aci(7), |entry| entry.color),
            own => own,
        };
        let appearance = insert.appearance(entry, context.appearance);
        Context { placement, layer: Some(layer.to_owned()), color, appearance, block }
    }

    fn shape(
        &mut self,
        segments: &[super::curves::SpaceSegment],
        closed: bool,
        record: &Record,
    ) -> Result<Shape, PatternReadError> {
        self.spend(Cost::Drawn, segments.len().max(1), record)?;
        for segment in segments {
            self.check_reach(segment.reach(), record)?;
            segment.heights().into_iter().for_each(|z| self.include_height(z));
        }
        let flat = segments.iter().map(super::curves::SpaceSegment::seen_from_above).collect();
        Ok(if closed { Shape::Closed(flat) } else { Shape::Open(flat) })
    }

    /// Lists the texts whose backgrounds hide lines that would be marked.
    fn list_masks(&mut self) -> Result<(), PatternReadError> {
        let masks = std::mem::take(&mut self.masks);
        if masks.is_empty() {
            return Ok(());
        }
        let structure = self.structure;
        let extents: Vec<Extents> = self.result.paths.iter().map(|path| path.shape.extents()).collect();
        let is_ink: Vec<bool> =
            self.result.layer_names.iter().map(|layer| is_among(self.ink_layers, layer)).collect();
        for PlacedMask { mask, before, text: (index, layer) } in masks {
            let Some(record) = structure.entities.get(index) else { continue };
            // In another order than that of the file, everything may be behind the text but the text itself.
            let before = if structure.has_draw_order { self.result.paths.len() } else { before };
            let own = structure.handle(self.scan, record);
            self.spend(Cost::Steps, before, record)?;
            let behind = self.result.paths.iter().zip(&extents).take(before).filter(|(path, _)| {
                is_ink.get(path.layer) == Some(&true) && (own.is_none() || path.source.handle != own)
            });
            if mask.hides(behind) && self.listed.insert((index, layer.clone(), HIDES_LINES.into())) {
                self.skip(index, record, &layer, HIDES_LINES.into(), Missing::Ink);
            }
        }
        Ok(())
    }

    fn spend(&mut self, cost: Cost, count: usize, record: &Record) -> Result<(), PatternReadError> {
        let spent = self.budget.spend(cost, count);
        spent.map_err(|_| cost.too_many(self.structure.name(self.scan, record)))
    }

    fn spent(&self) -> [(Cost, usize); 3] {
        [Cost::Unfolded, Cost::Copies, Cost::Drawn].map(|cost| (cost, self.budget.spent(cost)))
    }

    /// All copies spend as much as the first one, so too many are refused before they are created.
    fn check_copies(
        &mut self,
        before: [(Cost, usize); 3],
        copies: usize,
        record: &Record,
    ) -> Result<(), PatternReadError> {
        for (cost, before) in before {
            let of_one = self.budget.spent(cost) - before;
            self.check_cost(cost, of_one.saturating_mul(copies - 1), record)?;
        }
        Ok(())
    }

    fn check_cost(&mut self, cost: Cost, count: usize, record: &Record) -> Result<(), PatternReadError> {
        let checked = self.budget.check(cost, count);
        checked.map_err(|_| cost.too_many(self.structure.name(self.scan, record)))
    }

    fn check_reach(&self, reach: f64, record: &Record) -> Result<(), PatternReadError> {
        if reach <= MAX_COORDINATE {
            return Ok(());
        }
        let entity = self.structure.name(self.scan, record);
        Err(PatternReadError::OutOfRange { entity, reach, limit: MAX_COORDINATE })
    }

    fn include_height(&mut self, z: f64) {
        let (low, high) = self.result.heights.unwrap_or((z, z));
        self.result.heights = Some((low.min(z), high.max(z)));
    }

    fn push(
        &mut self,
        shape: Shape,
        region: Option<u32>,
        Look { layer, color, is_stroke, block }: Look<'_>,
        record: &Record,
    ) {
        let names = &mut self.result.layer_names;
        let layer = match self.layer_numbers.get(layer) {
            Some(number) => *number,
            None => {
                names.push(layer.to_owned());
                self.layer_numbers.insert(layer.to_owned(), names.len() - 1);
                names.len() - 1
            }
        };
        let entity = self.structure.kind(record).to_owned();
        let handle = self.structure.handle(self.scan, record);
        let source = Source { entity, handle, is_stroke, block: block.cloned() };
        self.result.paths.push(Path { layer, color, shape, region, source });
    }

    fn skip(&mut self, index: usize, record: &Record, layer: &str, why: Cow<'static, str>, missing: Missing) {
        if self.open_blocks.is_empty() || self.listed.insert((index, layer.to_owned(), why.clone())) {
            let is_aid = layer.eq_ignore_ascii_case(NEVER_PLOTTED);
            self.result.skipped.push(Skipped {
                entity: self.structure.kind(record).into(),
                handle: self.structure.handle(self.scan, record),
                layer: layer.to_owned(),
                why,
                is_loss: missing != Missing::Nothing,
                is_ink: missing == Missing::Ink && !is_aid,
            });
        }
    }

    fn too_many(&self, what: &'static str, limit: usize, record: &Record) -> PatternReadError {
        PatternReadError::TooMany { what, limit, entity: Some(self.structure.name(self.scan, record)) }
    }
}

fn count(found: &mut Found, name: impl FnOnce() -> EntityName) {
    found.get_or_insert_with(|| (0, name())).0 += 1;
}

/// The final layer of an entity, and its entry in the layer table.
fn layer_of<'l>(
    structure: &'l Structure,
    record: &Record,
    context: &'l Context,
) -> (&'l str, Option<&'l LayerRecord>) {
    let layer = match (structure.layer(record), &context.layer) {
        ("0", Some(outer)) => outer,
        (own, _) => own,
    };
    let entry = structure.entry(layer);
    (entry.map_or(layer, |entry| &entry.name), entry)
}

/// The colour of an entity. BYLAYER refers to the final layer of the entity.
fn own_color(record: &Record, context: &Context) -> Color {
    match record.color {
        RecordColor::ByBlock => context.color,
        RecordColor::Own(color) => color,
    }
}

/// Why a valid entity is not marked. Of the states of its layer only "frozen" hides an insert, because its content may
/// be on other layers.
fn why_hidden(
    record: &Record,
    layer: Option<&LayerRecord>,
    is_insert: bool,
    is_paper: bool,
) -> Option<&'static str> {
    let of_layer = |state: fn(&LayerRecord) -> bool| layer.is_some_and(state);
    if record.in_paper_space && !is_paper {
        Some(IN_PAPER_SPACE)
    } else if record.hidden {
        Some("it is invisible")
    } else if of_layer(|layer| layer.frozen) {
        Some("its layer is frozen")
    } else if is_insert {
        None
    } else if of_layer(|layer| layer.off) {
        Some("its layer is off")
    } else if of_layer(|layer| !layer.plotted) {
        Some("its layer is not plotted")
    } else {
        None
    }
}
