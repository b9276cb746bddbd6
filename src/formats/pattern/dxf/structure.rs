//! The inventory of the file: header, layers, blocks and entities, each entity with its position, layer and colour.
//!
//! Every entity in the inventory must become a path or be listed as skipped.

use std::collections::BTreeMap;
use std::ops::Range;

use super::budget::{Budget, Cost};
use super::code_page::CodePage;
use super::colour::nearest_index;
use super::scan::{EMBEDDED, Pair, Scan};
use crate::formats::pattern::DrawingUnit;
use crate::formats::pattern::error::{EntityName, PatternReadError};
use crate::geometry::pattern::Color;

/// The inventory of a drawing.
#[derive(Default)]
pub(super) struct Structure {
    pub(super) header: Header,
    /// Layers by their name in upper case, because names are not case-sensitive.
    pub(super) layers: BTreeMap<String, LayerRecord>,
    /// Number of entries of the layer table, to keep its order.
    pub(super) layer_count: usize,
    /// Blocks by their name in upper case.
    pub(super) blocks: BTreeMap<String, Block>,
    /// Text styles by their name in upper case.
    pub(super) styles: BTreeMap<String, TextStyle>,
    /// All entities in file order, including those of blocks.
    pub(super) entities: Vec<Record>,
    /// The ranges of `entities` that are drawn directly, not through a block.
    pub(super) drawn: Vec<Range<usize>>,
    /// Comments at the beginning of the file.
    pub(super) comments: Vec<String>,
    /// Number of block references that are clipped to a boundary.
    pub(super) clips: usize,
    /// Whether entities are drawn in another order than that of the file.
    pub(super) has_draw_order: bool,
    /// Whether a table entry has the name EZDXF.
    pub(super) has_ezdxf_entry: bool,
    kinds: Names,
    layer_names: Names,
    /// Names of the sheets in paper space, by the keys of their blocks.
    sheet_names: BTreeMap<String, String>,
    /// The units in which the sheets are plotted, by the keys of their blocks.
    sheet_units: BTreeMap<String, DrawingUnit>,
    /// Names of blocks by the handles of their table entries, until the sheets are known.
    block_handles: BTreeMap<String, String>,
}

/// The needed header variables.
#[derive(Default)]
pub(super) struct Header {
    pub(super) version: String,
    pub(super) unit_code: Option<i64>,
    pub(super) measurement: Option<i64>,
    pub(super) code_page: Option<String>,
    pub(super) saved_by: Option<String>,
    pub(super) handle_seed: Option<String>,
    /// `$PDMODE`: how points are shown.
    pub(super) points: PointMode,
    /// Whether fills and hatches are not shown (`$FILLMODE` is 0).
    pub(super) hides_fills: bool,
    /// `$ATTMODE`: which attributes are shown.
    pub(super) attributes: AttributeMode,
    /// Number of header variables.
    pub(super) variables: usize,
}

/// How a drawing shows points.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) enum PointMode {
    #[default]
    Dots,
    Hidden,
    /// As symbols; the value of `$PDMODE` is the sum of their parts.
    Symbols(i64),
}

/// Which attributes a drawing shows.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) enum AttributeMode {
    None,
    /// Those that are not invisible.
    #[default]
    Visible,
    All,
}

/// An entry of the layer table.
#[derive(Debug, Clone)]
pub(super) struct LayerRecord {
    pub(super) name: String,
    pub(super) color: Color,
    pub(super) order: usize,
    pub(super) frozen: bool,
    pub(super) off: bool,
    pub(super) plotted: bool,
    appearance: Appearance,
}

/// How an entity is shown in the drawing, apart from its colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Appearance {
    /// Whether its lines have dashes or dots.
    pub(super) is_dashed: bool,
    /// The width in which its lines are plotted, in 1/100 mm; below 0 for the program's default.
    line_weight: i16,
    /// 0 for transparent, 255 for opaque.
    alpha: u8,
}

impl Appearance {
    /// That of an entity outside any block if neither it nor its layer states another one.
    pub(super) fn usual() -> Self {
        Self { is_dashed: false, line_weight: -3, alpha: 255 }
    }

    pub(super) fn is_transparent(&self) -> bool {
        self.alpha < 255
    }

    /// The width in which lines are plotted, mm; `None` for the program's default.
    pub(super) fn line_weight(&self) -> Option<f64> {
        (self.line_weight >= 0).then(|| f64::from(self.line_weight) / 100.0)
    }
}

/// A property as an entity gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Given<T> {
    ByLayer,
    ByBlock,
    Own(T),
}

impl<T> Given<T> {
    fn from(self, of_layer: T, of_block: T) -> T {
        match self {
            Self::ByLayer => of_layer,
            Self::ByBlock => of_block,
            Self::Own(own) => own,
        }
    }
}

/// An entry of the text style table.
#[derive(Debug, Clone)]
pub(super) struct TextStyle {
    /// The font's file name.
    pub(super) file: String,
    /// The family of a TrueType font, with its weight and slant.
    pub(super) family: Option<String>,
    /// Width factor of the letters.
    pub(super) width: f64,
    /// Slant of the letters, rad.
    pub(super) oblique: f64,
    /// Whether letters are below each other.
    pub(super) is_vertical: bool,
}

/// A block definition.
#[derive(Debug, Clone, Default)]
pub(super) struct Block {
    pub(super) name: String,
    pub(super) base: [f64; 3],
    /// Whether it is a reference to another file.
    pub(super) external: bool,
    /// The range of its entities in [`Structure::entities`].
    pub(super) entities: Range<usize>,
}

/// A sheet in paper space.
#[derive(Debug, Clone)]
pub(super) struct Sheet {
    /// The key of its block.
    pub(super) block: String,
    /// Whether entities outside blocks that are marked as in paper space belong to it.
    pub(super) is_active: bool,
}

/// One entity of the file.
#[derive(Debug, Clone)]
pub(super) struct Record {
    kind: u32,
    layer: u32,
    /// Its pairs, including those of its vertices.
    first: u32,
    last: u32,
    handle: Option<u32>,
    /// The index in [`Structure::entities`] of the insert whose attribute it is.
    pub(super) insert: Option<u32>,
    pub(super) color: RecordColor,
    pub(super) in_paper_space: bool,
    pub(super) hidden: bool,
    /// Whether its line type has dashes or dots.
    is_dashed: Given<bool>,
    /// The width in which it is plotted, in 1/100 mm; below 0 for the program's default.
    line_weight: Given<i16>,
    /// 0 for transparent, 255 for opaque.
    alpha: Given<u8>,
}

/// A colour as the entity gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum RecordColor {
    ByBlock,
    Own(Color),
}

/// Names by number, each stored once.
#[derive(Default)]
struct Names {
    names: Vec<String>,
    /// Numbers by the names as the file writes them.
    numbers: BTreeMap<Vec<u8>, u32>,
}

impl Names {
    fn number(&mut self, scan: &Scan<'_>, raw: &[u8]) -> u32 {
        if let Some(number) = self.numbers.get(raw) {
            return *number;
        }
        let next = self.names.len() as u32;
        self.names.push(scan.decoded(raw));
        self.numbers.insert(raw.into(), next);
        next
    }

    fn name(&self, number: u32) -> &str {
        self.names.get(number as usize).map_or("", String::as_str)
    }
}

impl Structure {
    /// The blocks with the layouts in paper space, except the active one.
    pub(super) fn paper_sheets(&self) -> impl Iterator<Item = (&String, &Block)> {
        let is_sheet =
            |name: &str| ["*PAPER_SPACE", "$PAPER_SPACE"].iter().any(|sheet| name.starts_with(sheet));
        self.blocks.iter().filter(move |(name, _)| is_sheet(name))
    }

    /// The sheet of this name, or the only one with content.
    ///
    /// # Errors
    /// When no sheet with content has this name, or without a name several have content, or none.
    pub(super) fn sheet(&self, asked: Option<&str>) -> Result<Sheet, PatternReadError> {
        let draws = |record: &Record| self.kind(record) != "VIEWPORT";
        let active = self.drawn.iter().cloned().flatten().filter_map(|index| self.entities.get(index));
        let is_active_drawn = active.filter(|record| record.in_paper_space).any(draws);
        let mut sheets: Vec<(String, Sheet)> = Vec::new();
        for (block, content) in self.paper_sheets() {
            let is_active = matches!(block.as_str(), "*PAPER_SPACE" | "$PAPER_SPACE");
            let is_drawn = self.entities.get(content.entities.clone()).unwrap_or_default().iter().any(draws);
            if is_drawn || (is_active && is_active_drawn) {
                let name = self.sheet_names.get(block).unwrap_or(&content.name).clone();
                sheets.push((name, Sheet { block: block.clone(), is_active }));
            }
        }
        // R12 may have no block for paper space.
        if is_active_drawn && !sheets.iter().any(|(_, sheet)| sheet.is_active) {
            sheets.push(("*Paper_Space".into(), Sheet { block: String::new(), is_active: true }));
        }
        let is_asked = |name: &str| asked.is_none_or(|asked| asked.to_uppercase() == name.to_uppercase());
        let mut fitting = sheets.iter().filter(|(name, _)| is_asked(name));
        match (fitting.next(), fitting.next()) {
            (Some((_, sheet)), None) => Ok(sheet.clone()),
            _ => Err(PatternReadError::UnclearSheet {
                asked: asked.map(str::to_owned),
                sheets: sheets.into_iter().map(|(name, _)| name).collect(),
            }),
        }
    }

    /// The unit in which a sheet is plotted, if the file states it.
    pub(super) fn sheet_unit(&self, sheet: &Sheet) -> Option<DrawingUnit> {
        self.sheet_units.get(&sheet.block).copied()
    }

    /// The text style of this name, by default `Standard`.
    pub(super) fn style(&self, name: &str) -> Option<&TextStyle> {
        self.styles.get(&if name.is_empty() { "STANDARD".into() } else { name.to_uppercase() })
    }

    /// The entry of the layer table with this name, in upper or lower case.
    pub(super) fn entry(&self, layer: &str) -> Option<&LayerRecord> {
        self.layers.get(layer).or_else(|| self.layers.get(&layer.to_uppercase()))
    }

    pub(super) fn kind(&self, record: &Record) -> &str {
        self.kinds.name(record.kind)
    }

    pub(super) fn layer(&self, record: &Record) -> &str {
        self.layer_names.name(record.layer)
    }

    pub(super) fn handle(&self, scan: &Scan<'_>, record: &Record) -> Option<String> {
        record.handle.and_then(|pair| scan.pairs.get(pair as usize)).map(|pair| scan.text(pair))
    }

    pub(super) fn name(&self, scan: &Scan<'_>, record: &Record) -> EntityName {
        let (kind, layer) = (self.kind(record).into(), self.layer(record).into());
        EntityName { kind, handle: self.handle(scan, record), layer }
    }
}

impl Record {
    /// How the entity is shown on this layer, in an insert that is shown as `of_block`.
    pub(super) fn appearance(&self, layer: Option<&LayerRecord>, of_block: Appearance) -> Appearance {
        let of_layer = layer.map_or(Appearance::usual(), |layer| layer.appearance);
        Appearance {
            is_dashed: self.is_dashed.from(of_layer.is_dashed, of_block.is_dashed),
            line_weight: self.line_weight.from(of_layer.line_weight, of_block.line_weight),
            alpha: self.alpha.from(of_layer.alpha, of_block.alpha),
        }
    }

    /// The pairs of the entity; the first one is its type.
    pub(super) fn pairs<'s>(&self, scan: &'s Scan<'_>) -> &'s [Pair] {
        scan.pairs.get(self.first as usize..self.last as usize).unwrap_or_default()
    }
}

/// Makes the inventory, and sets the code page of the scan before any name is read.
///
/// # Errors
/// When there are more entities than the budget allows.
pub(super) fn structure(scan: &mut Scan<'_>, budget: &mut Budget) -> Result<Structure, PatternReadError> {
    let mut found = Structure { header: header(scan), ..Structure::default() };
    scan.code_page = code_page(&found.header);
    let scan: &Scan<'_> = scan;
    let mut section: &[u8] = b"";
    let mut block: Option<Block> = None;
    // The type of the last entity, whose parts may follow as separate entities, and the last insert.
    let mut parent: Option<&[u8]> = None;
    let mut insert = None;
    let mut end = 0;
    // Every item begins with group code 0; there may be comments before the first one.
    for pairs in scan.pairs.chunk_by(|_, next| next.code != 0) {
        let item = end..end + pairs.len();
        end = item.end;
        if pairs[0].code != 0 {
            let comments = pairs.iter().filter(|pair| pair.code == 999);
            found.comments = comments.take(20).map(|pair| scan.text(pair)).collect();
            continue;
        }
        let keyword = scan.raw(&pairs[0]);
        match (section, keyword) {
            // The entity SECTION, a plane that cuts a solid, has no name (2) here.
            (_, b"SECTION") if pairs.get(1).is_some_and(|pair| pair.code == 2) => {
                section = scan.raw(&pairs[1]);
                finish_block(&mut found, block.take());
                parent = None;
            }
            (_, b"ENDSEC") => {
                section = b"";
                finish_block(&mut found, block.take());
            }
            (b"TABLES", b"LAYER") => layer(scan, pairs, &mut found),
            (b"TABLES", b"STYLE" | b"DIMSTYLE" | b"APPID" | b"BLOCK_RECORD") => {
                found.has_ezdxf_entry |= pairs.iter().any(|pair| scan.is(pair, 2, b"EZDXF"));
                match keyword {
                    b"STYLE" => style(scan, pairs, &mut found),
                    b"BLOCK_RECORD" => block_record(scan, pairs, &mut found),
                    _ => {}
                }
            }
            (b"OBJECTS", b"SPATIAL_FILTER") => found.clips += 1,
            // A table without entries changes nothing.
            (b"OBJECTS", b"SORTENTSTABLE") => {
                found.has_draw_order |= pairs.iter().any(|pair| pair.code == 331);
            }
            (b"OBJECTS", b"LAYOUT") => layout(scan, pairs, &mut found),
            (b"BLOCKS", b"BLOCK") => {
                finish_block(&mut found, block.take());
                block = Some(block_head(scan, pairs, found.entities.len()));
                parent = None;
            }
            (b"BLOCKS", b"ENDBLK") => finish_block(&mut found, block.take()),
            (b"BLOCKS", _) if block.is_none() => {}
            (b"BLOCKS" | b"ENTITIES", kind) => {
                let is_part = matches!(
                    (parent, kind),
                    (Some(b"POLYLINE"), b"VERTEX" | b"SEQEND") | (Some(b"INSERT" | b"ATTRIB"), b"SEQEND")
                );
                if is_part {
                    if kind == b"SEQEND" {
                        parent = None;
                    } else if let Some(record) = found.entities.last_mut() {
                        record.last = item.end as u32;
                    }
                    continue;
                }
                let follows_insert = matches!(parent, Some(b"INSERT" | b"ATTRIB"));
                parent = Some(kind);
                let mut record = record(scan, item.clone(), &mut found);
                match kind {
                    b"INSERT" => insert = Some(found.entities.len() as u32),
                    b"ATTRIB" if follows_insert => record.insert = insert,
                    _ => {}
                }
                let listed = budget.spend(Cost::Listed, 1);
                listed.map_err(|_| Cost::Listed.too_many(found.name(scan, &record)))?;
                found.entities.push(record);
                if section == b"ENTITIES" {
                    let last = found.entities.len();
                    match found.drawn.last_mut() {
                        Some(range) if range.end == last - 1 => range.end = last,
                        _ => found.drawn.push(last - 1..last),
                    }
                }
            }
            _ => {}
        }
    }
    finish_block(&mut found, block.take());
    Ok(found)
}

fn header(scan: &Scan<'_>) -> Header {
    let mut header = Header::default();
    let start = scan.pairs.iter().position(|pair| scan.is(pair, 2, b"HEADER"));
    let Some(start) = start else { return header };
    let mut variable: &[u8] = b"";
    for pair in scan.pairs[start + 1..].iter().take_while(|pair| pair.code != 0) {
        let integer = || scan.number(pair).map(|number| number as i64);
        match (pair.code, variable) {
            (9, _) => {
                variable = scan.raw(pair);
                header.variables += 1;
            }
            (1, b"$ACADVER") => header.version = scan.text(pair),
            (70, b"$INSUNITS") => header.unit_code = integer(),
            (70, b"$MEASUREMENT") => header.measurement = integer(),
            (3, b"$DWGCODEPAGE") => header.code_page = Some(scan.text(pair)),
            (1, b"$LASTSAVEDBY") => header.saved_by = Some(scan.text(pair)).filter(|name| !name.is_empty()),
            (70, b"$PDMODE") => {
                header.points = match integer() {
                    None | Some(0) => PointMode::Dots,
                    Some(1) => PointMode::Hidden,
                    Some(symbol) => PointMode::Symbols(symbol),
                };
            }
            (70, b"$FILLMODE") => header.hides_fills = integer() == Some(0),
            (70, b"$ATTMODE") => {
                header.attributes = match integer() {
                    Some(0) => AttributeMode::None,
                    Some(2) => AttributeMode::All,
                    _ => AttributeMode::Visible,
                };
            }
            (5, b"$HANDSEED") => header.handle_seed = Some(scan.text(pair)),
            _ => {}
        }
    }
    header
}

/// The code page of texts and names: UTF-8 from R2007 on, before that the one in the header.
fn code_page(header: &Header) -> Option<CodePage> {
    if header.version.as_str() >= "AC1021" {
        return Some(CodePage::UTF_8);
    }
    CodePage::named(header.code_page.as_ref()?)
}

fn layer(scan: &Scan<'_>, pairs: &[Pair], found: &mut Structure) {
    let mut layer = LayerRecord {
        name: String::new(),
        color: Color::Aci(7),
        order: found.layer_count,
        frozen: false,
        off: false,
        plotted: true,
        appearance: Appearance::usual(),
    };
    let (mut aci, mut rgb) = (None, None);
    for pair in pairs.iter().take_while(|pair| pair.code < 1000) {
        let integer = || scan.number(pair).unwrap_or(0.0) as i64;
        match pair.code {
            2 => layer.name = scan.text(pair),
            62 => {
                layer.off = integer() < 0;
                aci = Some(integer().unsigned_abs());
            }
            70 => layer.frozen = integer() & 1 == 1,
            6 => layer.appearance.is_dashed = is_dashed(scan.raw(pair)) == Given::Own(true),
            290 => layer.plotted = integer() != 0,
            370 => layer.appearance.line_weight = line_weight(scan, pair).from(-3, -3),
            420 => rgb = Some(rgb_of(integer())),
            _ => {}
        }
    }
    let mut data = pairs.iter().skip_while(|pair| !scan.is(pair, 1001, b"AcCmTransparency")).skip(1);
    if let Some(pair) = data.next().filter(|pair| pair.code == 1071) {
        layer.appearance.alpha = alpha(scan, pair).from(255, 255);
    }
    // AutoCAD never plots this layer, even if its entry is marked as plotted.
    layer.plotted &= !layer.name.eq_ignore_ascii_case("DEFPOINTS");
    if let Color::Aci(_) | Color::Rgb { .. } = own_color(aci, rgb) {
        layer.color = own_color(aci, rgb);
    }
    found.layer_count += 1;
    found.layers.entry(layer.name.to_uppercase()).or_insert(layer);
}

fn style(scan: &Scan<'_>, pairs: &[Pair], found: &mut Structure) {
    let mut style =
        TextStyle { file: String::new(), family: None, width: 1.0, oblique: 0.0, is_vertical: false };
    let (mut name, mut marks) = (String::new(), 0);
    let mut application: &[u8] = b"";
    for pair in pairs {
        let number = || scan.number(pair).unwrap_or(0.0);
        let is_font = application.eq_ignore_ascii_case(b"ACAD");
        match pair.code {
            1001 => application = scan.raw(pair),
            2 => name = scan.text(pair),
            3 => style.file = scan.text(pair),
            70 => style.is_vertical = number() as i64 & 4 != 0,
            41 if number() > 0.0 => style.width = number(),
            50 => style.oblique = number().to_radians(),
            // In the data of the application ACAD: the family of a TrueType font, and bits for bold and italic.
            1000 if is_font => style.family = Some(scan.text(pair)).filter(|family| !family.is_empty()),
            1071 if is_font => marks = number() as i64,
            _ => {}
        }
    }
    if let Some(family) = &mut style.family {
        for (bit, word) in [(0x200_0000, " Bold"), (0x100_0000, " Italic")] {
            if marks & bit != 0 {
                *family += word;
            }
        }
    }
    found.styles.entry(name.to_uppercase()).or_insert(style);
}

fn block_record(scan: &Scan<'_>, pairs: &[Pair], found: &mut Structure) {
    let text = |code: i32| pairs.iter().find(|pair| pair.code == code).map(|pair| scan.text(pair));
    if let (Some(handle), Some(name)) = (text(5), text(2)) {
        found.block_handles.insert(handle.to_uppercase(), name.to_uppercase());
    }
}

/// The name of a layout and the block with its content.
fn layout(scan: &Scan<'_>, pairs: &[Pair], found: &mut Structure) {
    let start = pairs.iter().position(|pair| scan.is(pair, 100, b"AcDbLayout"));
    let own = start.map_or(pairs, |start| &pairs[start..]);
    let text = |code: i32| own.iter().find(|pair| pair.code == code).map(|pair| scan.text(pair));
    let block = text(330).and_then(|handle| found.block_handles.get(&handle.to_uppercase()));
    let Some(block) = block.cloned() else { return };
    // Of the settings for plotting, in front: 0 is inches, 1 millimetres.
    let plotting = start.map_or(&[][..], |start| &pairs[..start]);
    let unit = plotting.iter().find(|pair| pair.code == 72).map(|pair| scan.text(pair));
    let unit = match unit.as_deref().map(str::trim) {
        Some("0") => Some(DrawingUnit::Inch),
        Some("1") => Some(DrawingUnit::Millimetre),
        _ => None,
    };
    if let Some(unit) = unit {
        found.sheet_units.insert(block.clone(), unit);
    }
    if let Some(name) = text(1) {
        found.sheet_names.insert(block, name);
    }
}

/// Whether lines of this type have gaps.
fn is_dashed(line_type: &[u8]) -> Given<bool> {
    let is = |name: &[u8]| line_type.eq_ignore_ascii_case(name);
    match line_type {
        _ if is(b"BYLAYER") || is(b"") => Given::ByLayer,
        _ if is(b"BYBLOCK") => Given::ByBlock,
        _ => Given::Own(!is(b"CONTINUOUS")),
    }
}

/// A line weight in 1/100 mm.
fn line_weight(scan: &Scan<'_>, pair: &Pair) -> Given<i16> {
    match scan.number(pair).map(|number| number as i16) {
        None | Some(-1) => Given::ByLayer,
        Some(-2) => Given::ByBlock,
        Some(weight) => Given::Own(weight),
    }
}

/// An opacity: the highest byte of the number states whether it is that of the layer, of the block, or the lowest byte.
fn alpha(scan: &Scan<'_>, pair: &Pair) -> Given<u8> {
    let [.., by, _, _, alpha] = (scan.number(pair).unwrap_or(0.0) as i64).to_be_bytes();
    match by {
        0 => Given::ByLayer,
        1 => Given::ByBlock,
        _ => Given::Own(alpha),
    }
}

fn rgb_of(value: i64) -> [u8; 3] {
    let [_, _, _, _, _, red, green, blue] = value.to_be_bytes();
    [red, green, blue]
}

fn own_color(aci: Option<u64>, rgb: Option<[u8; 3]>) -> Color {
    let index = aci.and_then(|aci| u8::try_from(aci).ok()).filter(|aci| *aci > 0);
    match (index, rgb) {
        (index, Some(rgb)) => Color::Rgb { aci: index.unwrap_or_else(|| nearest_index(rgb)), rgb },
        (Some(aci), None) => Color::Aci(aci),
        (None, None) => Color::ByLayer,
    }
}

fn block_head(scan: &Scan<'_>, pairs: &[Pair], first: usize) -> Block {
    let mut block = Block { entities: first..first, ..Block::default() };
    for pair in pairs.iter().take_while(|pair| pair.code < 1000) {
        match pair.code {
            2 => block.name = scan.text(pair),
            10 | 20 | 30 => block.base[pair.code as usize / 10 - 1] = scan.number(pair).unwrap_or(0.0),
            70 => block.external = scan.number(pair).unwrap_or(0.0) as i64 & (4 | 8) != 0,
            _ => {}
        }
    }
    block
}

fn finish_block(found: &mut Structure, block: Option<Block>) {
    if let Some(mut block) = block {
        block.entities.end = found.entities.len();
        found.blocks.entry(block.name.to_uppercase()).or_insert(block);
    }
}

fn record(scan: &Scan<'_>, item: Range<usize>, found: &mut Structure) -> Record {
    let mut layer = None;
    let (mut aci, mut rgb, mut by_block) = (None, None, false);
    let mut record = Record {
        kind: 0,
        layer: 0,
        first: item.start as u32,
        last: item.end as u32,
        handle: None,
        insert: None,
        color: RecordColor::Own(Color::ByLayer),
        in_paper_space: false,
        hidden: false,
        is_dashed: Given::ByLayer,
        line_weight: Given::ByLayer,
        alpha: Given::ByLayer,
    };
    // Groups in braces belong to other programs, and so does everything after the first application name (1001). In an
    // embedded object the codes have other meanings.
    let mut in_braces = false;
    for (index, pair) in item.clone().zip(&scan.pairs[item.clone()]) {
        let flag = || scan.number(pair).is_some_and(|number| number != 0.0);
        match pair.code {
            EMBEDDED | 1000.. => break,
            102 => in_braces = scan.raw(pair).starts_with(b"{"),
            _ if in_braces => {}
            5 if record.handle.is_none() => record.handle = Some(index as u32),
            6 => record.is_dashed = is_dashed(scan.raw(pair)),
            8 => layer = Some(scan.raw(pair)),
            60 => record.hidden = flag(),
            62 => {
                let index = scan.number(pair).unwrap_or(256.0) as i64;
                by_block = index == 0;
                aci = Some(index.unsigned_abs());
            }
            67 => record.in_paper_space = flag(),
            370 => record.line_weight = line_weight(scan, pair),
            420 => rgb = Some(rgb_of(scan.number(pair).unwrap_or(0.0) as i64)),
            440 => record.alpha = alpha(scan, pair),
            _ => {}
        }
    }
    record.kind = found.kinds.number(scan, scan.raw(&scan.pairs[item.start]));
    record.layer = found.layer_names.number(scan, layer.unwrap_or(b"0"));
    record.color = match own_color(aci, rgb) {
        Color::ByLayer if by_block => RecordColor::ByBlock,
        color => RecordColor::Own(color),
    };
    record
}
