//! MTEXT: paragraphs that are broken into lines, and formats that change within them.

use std::rc::Rc;

use nalgebra::{Matrix3, Vector3};

use super::super::super::content::{FoundField, Syntax, expand};
use super::super::super::error::PatternReadError;
use super::super::budget::Budget;
use super::super::colour::nearest_index;
use super::super::curves::{Placement, through};
use super::super::groups::{Groups, own};
use super::super::items::{Item, Reader};
use super::super::scan::{Pair, Scan};
use super::super::structure::{Record, RecordColor};
use super::codes::{Letter, RuleKind, Ruled, Token, tokens};
use super::{BLANK, Font, FontUses, LONGEST, Row, TOO_LONG, VERTICAL, by_precedence, sheared, without_text};
use crate::geometry::pattern::Color;

/// Distance of baselines for letters 1 high, at a line spacing of 1.
const LEADING: f64 = 5.0 / 3.0;
/// Directions of a text (72); others are that of its style.
const HORIZONTAL: i64 = 1;
const TOP_TO_BOTTOM: i64 = 3;
/// The background of a text has a colour.
const FILLED: i64 = 1;
/// The background of a text has the colour of the drawing window.
const FILLED_AS_WINDOW: i64 = 2;
/// A text has a frame, drawn where its background ends.
const FRAMED: i64 = 16;
/// The size of a text in another font is known to about this share of its height; a line so close to the rim may be beside the
/// background.
const UNSURE: f64 = 0.1;
/// Number of bytes of a text that are searched in a step of the budget.
const BYTES_SEARCHED: usize = 64;
/// Height of stacked letters relative to the others.
const STACKED: f64 = 0.7;
/// Default distance of tab stops, in heights of the text.
const TAB: f64 = 4.0;

/// The current format of letters.
#[derive(Clone)]
struct Format {
    font: Font,
    height: f64,
    width: f64,
    tracking: f64,
    oblique: f64,
    ruled: Ruled,
    align: u8,
    color: Option<RecordColor>,
}

/// Alignment, indents and tab stops of a paragraph; lengths are in heights of the text.
#[derive(Debug, Clone, Default, PartialEq)]
struct Layout {
    align: Option<Align>,
    first: f64,
    left: f64,
    right: f64,
    /// Tab stops from left to right.
    tabs: Rc<[f64]>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Align {
    Left,
    Center,
    Right,
}

/// Items along the baseline from the origin, in units of the drawing.
struct Block {
    items: Vec<(Option<RecordColor>, Item)>,
    width: f64,
    height: f64,
    /// Vertical position in a higher line: 0 at its baseline, 1 in the middle, 2 at the top.
    align: u8,
}

/// An element of a line.
enum Cell {
    Block(Block),
    Blank { width: f64, height: f64 },
    Tab { height: f64 },
}

struct Paragraph {
    layout: Layout,
    cells: Vec<Cell>,
    /// Height of a line without letters.
    height: f64,
}

struct Line {
    items: Vec<(Option<RecordColor>, Item)>,
    height: f64,
}

/// What an MTEXT draws.
pub(in super::super) fn drawn(
    reader: &Reader<'_>,
    record: &Record,
    remarks: (&mut FontUses, &mut Vec<FoundField>),
    budget: &mut Budget,
) -> Result<Item, PatternReadError> {
    if columns(reader.scan, record) > 1 {
        return Ok(Item::Skipped("it has columns: explode it in the drawing program".into()));
    }
    set_out(reader, record, record.pairs(reader.scan), remarks, budget)
}

/// What an ATTRIB or ATTDEF with several lines draws, from the pairs of the MTEXT that is embedded in it.
pub(in super::super) fn embedded(
    reader: &Reader<'_>,
    record: &Record,
    pairs: &[Pair],
    remarks: (&mut FontUses, &mut Vec<FoundField>),
    budget: &mut Budget,
) -> Result<Item, PatternReadError> {
    let &Reader { scan, structure, .. } = reader;
    let flags = by_precedence(scan, structure, record).into_iter().filter(|pair| pair.code == 70);
    let flags = Groups::of(scan, structure, record, flags)?;
    match without_text(structure.kind(record), &flags, structure.header.attributes) {
        Some(item) => Ok(item),
        None => set_out(reader, record, pairs, remarks, budget),
    }
}

/// What the paragraphs with these pairs draw.
fn set_out(
    &Reader { scan, structure, content, .. }: &Reader<'_>,
    record: &Record,
    pairs: &[Pair],
    (uses, fields): (&mut FontUses, &mut Vec<FoundField>),
    budget: &mut Budget,
) -> Result<Item, PatternReadError> {
    let wanted = |code| {
        matches!(code, 10 | 20 | 30 | 11 | 21 | 31 | 40 | 41 | 44 | 45 | 50 | 71..=73 | 90 | 210 | 220 | 230)
    };
    let groups = Groups::read(scan, structure, record, pairs, wanted)?;
    let height = groups.or(40, 0.0);
    if !(height > 0.0) {
        return Ok(Item::DrawsNothing("its height is 0"));
    }
    let text = scan.whole_text(own(scan, pairs).filter(|pair| matches!(pair.code, 1 | 3)));
    if text.len() > LONGEST {
        return Ok(Item::Skipped(TOO_LONG.into()));
    }
    let (text, found) = expand(&text, Syntax::Paragraph, content);
    fields.extend(found);
    let style = scan.whole_text(own(scan, pairs).filter(|pair| pair.code == 7).last());
    let style = structure.style(&style);
    let format = Format {
        font: Font::of(style),
        height,
        width: style.map_or(1.0, |style| style.width),
        tracking: 1.0,
        oblique: style.map_or(0.0, |style| style.oblique),
        ruled: Ruled::default(),
        align: 0,
        color: None,
    };
    // For every code the text is searched for its end.
    if let Err(exceeded) = budget.work(text.matches('\\').count() * text.len() / BYTES_SEARCHED) {
        return Ok(Item::Skipped(exceeded.into()));
    }
    let paragraphs = match set(tokens(&text, scan.page_of_letters()), format, uses, budget) {
        Ok(paragraphs) => paragraphs,
        Err(why) => return Ok(Item::Skipped(why.into())),
    };

    let attachment = (groups.or(71, 1.0) as i64).clamp(1, 9) - 1;
    let align = [Align::Left, Align::Center, Align::Right][attachment as usize % 3];
    let box_width = groups.or(41, 0.0).max(0.0);
    let lines: Vec<(Line, f64, Align, Layout)> =
        paragraphs.into_iter().flat_map(|paragraph| broken(paragraph, box_width, height, align)).collect();
    let widest = lines.iter().map(|(_, width, ..)| *width).fold(0.0, f64::max);
    let box_width = if box_width > 0.0 { box_width } else { widest };

    let factor = groups.get(44).filter(|factor| *factor > 0.0).unwrap_or(1.0);
    let is_exact = groups.flags(73) == 2;
    let mut baseline = 0.0;
    let mut items = Vec::new();
    for (index, (line, width, align, layout)) in lines.into_iter().enumerate() {
        baseline -= match (index, is_exact) {
            (0, _) => line.height,
            (_, true) => LEADING * factor * height,
            (_, false) => LEADING * factor * line.height,
        };
        let (left, right) = (layout.left * height, box_width - layout.right * height);
        let start = match align {
            Align::Left => left,
            Align::Center => (left + right - width) / 2.0,
            Align::Right => right - width,
        };
        let shift = sheared(0.0, Vector3::new(start, baseline, 0.0));
        items.extend(line.items.into_iter().map(|(color, item)| (color, item.placed(&shift))));
    }
    if items.is_empty() {
        return Ok(Item::DrawsNothing(BLANK));
    }
    let is_vertical = match groups.flags(72) {
        HORIZONTAL => false,
        TOP_TO_BOTTOM => true,
        _ => style.is_some_and(|style| style.is_vertical),
    };
    if is_vertical {
        return Ok(Item::Skipped(VERTICAL.into()));
    }
    // The insertion point is a corner, the middle of a side or the centre of the text.
    let shift = Vector3::new(
        -box_width * [0.0, 0.5, 1.0][attachment as usize % 3],
        -baseline * [0.0, 0.5, 1.0][attachment as usize / 3],
        0.0,
    );
    let own = Placement { linear: axes(&groups), offset: groups.point(10) };
    let placement = own.after(&sheared(0.0, shift));
    let corners = |border: f64| {
        let (left, right) = (-border, box_width.max(widest) + border);
        let (low, high) = (baseline - border, border);
        [[left, low], [right, low], [right, high], [left, high]].map(|[x, y]| Vector3::new(x, y, 0.0))
    };
    let beyond = (groups.or(45, 1.5) - 1.0) * height;
    let flags = groups.flags(90);
    // The background surely reaches as far as this beyond the box of the text.
    let mask = (flags & (FILLED | FILLED_AS_WINDOW) != 0)
        .then(|| (None, Item::Mask(corners(beyond - UNSURE * height))));
    let frame = (flags & FRAMED != 0).then(|| (None, Item::Curve(through(&corners(beyond), true))));
    // The background is behind the letters.
    let items = mask.into_iter().chain(frame).chain(items);
    Ok(Item::Several(items.map(|(color, item)| (color, item.placed(&placement))).collect()))
}

/// The axes of the text in its space: from its direction (11) or its angle (50), the later of the two groups.
fn axes(groups: &Groups) -> Matrix3<f64> {
    let plane = groups.plane().linear;
    let last = groups.0.iter().rev().find(|group| matches!(group.0, 11 | 50)).map(|group| group.0);
    let normal = plane.column(2).into_owned();
    let along = (groups.point(11) - normal * normal.dot(&groups.point(11))).try_normalize(1e-12);
    let x = match along.filter(|_| last == Some(11)) {
        Some(along) => along,
        None => {
            let (sin, cos) = groups.or(50, 0.0).to_radians().sin_cos();
            plane * Vector3::new(cos, sin, 0.0)
        }
    };
    Matrix3::from_columns(&[x, normal.cross(&x), normal])
}

/// Number of columns: from R2018 on in an embedded object, before in the extended data of an application.
fn columns(scan: &Scan<'_>, record: &Record) -> i64 {
    let pairs = record.pairs(scan);
    let integer =
        |pair: Option<&Pair>| pair.and_then(|pair| scan.number(pair)).map_or(0, |number| number as i64);
    if let Some(start) = pairs.iter().position(|pair| pair.code == 101) {
        let inner = &pairs[start..];
        let kind = integer(inner.iter().find(|pair| pair.code == 71));
        return if kind == 0 { 1 } else { integer(inner.iter().find(|pair| pair.code == 72)) };
    }
    // Pairs of groups 1070: first the meaning (76 is the number of columns), then the value.
    let mut values = pairs
        .iter()
        .skip_while(|pair| !scan.is(pair, 1000, b"ACAD_MTEXT_COLUMN_INFO_BEGIN"))
        .filter(|pair| pair.code == 1070);
    while let (Some(meaning), Some(value)) = (values.next(), values.next()) {
        if integer(Some(meaning)) == 76 {
            return integer(Some(value));
        }
    }
    1
}

/// The text as paragraphs of cells.
///
/// # Errors
/// A sentence if no font has one of the letters, or if there are more letters than the budget allows.
fn set(
    tokens: Vec<Token>,
    format: Format,
    uses: &mut FontUses,
    budget: &mut Budget,
) -> Result<Vec<Paragraph>, String> {
    let mut format = format;
    let mut outer = Vec::new();
    let mut layout = Layout::default();
    let mut paragraphs = Vec::new();
    let mut cells = Vec::new();
    let mut word: Vec<Letter> = Vec::new();
    for token in tokens {
        if let Token::Letter(char) = token {
            Letter { char, ruled: format.ruled }.join(&mut word);
            continue;
        }
        format.finish(&mut word, &mut cells, uses, budget)?;
        match token {
            Token::Letter(_) => {}
            Token::Blank => {
                let blank = format.font.row(
                    &[Letter { char: ' ', ruled: format.ruled }],
                    format.tracking,
                    uses,
                    budget,
                )?;
                let width = blank.width * format.height * format.width;
                let height = format.height;
                if format.ruled == Ruled::default() {
                    cells.push(Cell::Blank { width, height });
                } else {
                    // An underlined or struck blank is drawn, so lines do not break there.
                    cells.push(format.cell(format.items(blank), width));
                }
            }
            Token::Tab => cells.push(Cell::Tab { height: format.height }),
            Token::Paragraph => {
                let cells = std::mem::take(&mut cells);
                paragraphs.push(Paragraph { layout: layout.clone(), cells, height: format.height });
            }
            Token::Open => outer.push(format.clone()),
            Token::Close => format = outer.pop().unwrap_or(format),
            Token::Stack(upper, lower, sign) => {
                cells.push(format.stacked(&upper, &lower, sign, uses, budget)?);
            }
            Token::Rule(kind, on) => match kind {
                RuleKind::Under => format.ruled.under = on,
                RuleKind::Over => format.ruled.over = on,
                RuleKind::Through => format.ruled.through = on,
            },
            Token::Height(size) => format.height = size.from(format.height),
            Token::Width(size) => format.width = size.from(format.width),
            Token::Tracking(size) => format.tracking = size.from(format.tracking),
            Token::Oblique(angle) => format.oblique = angle.to_radians(),
            Token::Align(align) => format.align = align,
            Token::Aci(aci) => {
                format.color = match aci {
                    0 => Some(RecordColor::ByBlock),
                    aci => Some(RecordColor::Own(u8::try_from(aci).map_or(Color::ByLayer, Color::Aci))),
                };
            }
            Token::Rgb(rgb) => {
                format.color = Some(RecordColor::Own(Color::Rgb { aci: nearest_index(rgb), rgb }))
            }
            Token::Font(name, is_family) if !name.is_empty() => format.font = Font::named(&name, is_family),
            Token::Font(..) => {}
            Token::Layout(text) => layout = layout.changed(&text),
        }
    }
    format.finish(&mut word, &mut cells, uses, budget)?;
    paragraphs.push(Paragraph { layout, cells, height: format.height });
    Ok(paragraphs)
}

impl Format {
    /// The items of a row, in units of the drawing.
    fn items(&self, row: Row) -> Vec<(Option<RecordColor>, Item)> {
        self.items_at(row, self.height, Vector3::zeros())
    }

    fn items_at(&self, row: Row, height: f64, at: Vector3<f64>) -> Vec<(Option<RecordColor>, Item)> {
        let scale = Matrix3::from_diagonal(&Vector3::new(height * self.width, height, 1.0));
        let placement =
            Placement { linear: scale, offset: at }.after(&sheared(self.oblique, Vector3::zeros()));
        row.items.into_iter().map(|item| (self.color, item.placed(&placement))).collect()
    }

    /// Adds a cell with the letters of a word.
    fn finish(
        &self,
        word: &mut Vec<Letter>,
        cells: &mut Vec<Cell>,
        uses: &mut FontUses,
        budget: &mut Budget,
    ) -> Result<(), String> {
        if word.is_empty() {
            return Ok(());
        }
        let row = self.font.row(&std::mem::take(word), self.tracking, uses, budget)?;
        let width = row.width * self.height * self.width;
        cells.push(self.cell(self.items(row), width));
        Ok(())
    }

    fn cell(&self, items: Vec<(Option<RecordColor>, Item)>, width: f64) -> Cell {
        Cell::Block(Block { items, width, height: self.height, align: self.align })
    }

    /// Two stacked rows, or two rows side by side with a slanted line between them.
    fn stacked(
        &self,
        upper: &str,
        lower: &str,
        sign: char,
        uses: &mut FontUses,
        budget: &mut Budget,
    ) -> Result<Cell, String> {
        let mut row = |text: &str| {
            let mut letters = Vec::new();
            text.chars().for_each(|char| Letter { char, ruled: Ruled::default() }.join(&mut letters));
            self.font.row(&letters, self.tracking, uses, budget)
        };
        let (upper, lower) = (row(upper)?, row(lower)?);
        let small = self.height * STACKED;
        let (above, below) = (upper.width * small * self.width, lower.width * small * self.width);
        let (mut upper_at, mut lower_at) = (Vector3::zeros(), Vector3::zeros());
        let mut width = above.max(below);
        let mut line = None;
        match sign {
            '/' => {
                (upper_at, lower_at) = (
                    Vector3::new((width - above) / 2.0, 0.7 * self.height, 0.0),
                    Vector3::new((width - below) / 2.0, 0.3 * self.height - small, 0.0),
                );
                let middle = 0.5 * self.height;
                line = Some([Vector3::new(0.0, middle, 0.0), Vector3::new(width, middle, 0.0)]);
            }
            '#' => {
                let gap = 0.3 * self.height;
                upper_at.y = self.height - small;
                lower_at.x = above + gap;
                width = above + gap + below;
                let (low, high) =
                    (Vector3::new(above, 0.0, 0.0), Vector3::new(above + gap, self.height, 0.0));
                line = Some([low, high]);
            }
            _ => {
                upper_at.y = 0.6 * self.height;
                lower_at.y = 0.3 * self.height - small;
            }
        }
        let mut items = self.items_at(upper, small, upper_at);
        items.extend(self.items_at(lower, small, lower_at));
        items.extend(line.map(|ends| (self.color, Item::Curve(through(&ends, false)))));
        Ok(self.cell(items, width))
    }
}

impl Layout {
    /// The layout after a `\p` code: `i`, `l` and `r` are indents, `q` the alignment, `t` tab stops.
    fn changed(mut self, text: &str) -> Self {
        let mut tabs: Option<Vec<f64>> = None;
        for part in text.split(',') {
            let mut rest = part.trim();
            // `x` only marks values that were set by hand.
            rest = rest.strip_prefix('x').unwrap_or(rest);
            let Some(key) = rest.chars().next() else { continue };
            let number = |text: &str| text.parse::<f64>().ok().filter(|number| number.is_finite());
            let value = number(rest.get(key.len_utf8()..).unwrap_or_default());
            match (key, value) {
                ('i', value) => self.first = value.unwrap_or(0.0),
                ('l', value) => self.left = value.unwrap_or(0.0),
                ('r', Some(value)) if tabs.is_none() => self.right = value,
                ('q', _) => {
                    self.align = match rest.get(1..) {
                        Some("l") => Some(Align::Left),
                        Some("c") => Some(Align::Center),
                        Some("r") => Some(Align::Right),
                        _ => None,
                    };
                }
                ('t', value) => tabs = Some(value.into_iter().collect()),
                _ => {
                    if let Some(tabs) = &mut tabs {
                        tabs.extend(number(rest.trim_start_matches(['c', 'r'])));
                    }
                }
            }
        }
        if let Some(mut tabs) = tabs {
            tabs.sort_by(f64::total_cmp);
            self.tabs = tabs.into();
        }
        self
    }
}

/// The lines of a paragraph with their widths, broken at blanks to fit into `box_width`, unless it is 0.
fn broken(paragraph: Paragraph, box_width: f64, unit: f64, align: Align) -> Vec<(Line, f64, Align, Layout)> {
    let Paragraph { layout, cells, height: blank } = paragraph;
    let align = layout.align.unwrap_or(align);
    let limit = if box_width > 0.0 { box_width - (layout.left + layout.right) * unit } else { f64::INFINITY };
    let mut lines = Vec::new();
    // `width` is the end of the last word, `pen` the end of the blanks after it.
    let (mut width, mut pen, mut height) = (0.0f64, layout.first * unit, 0.0f64);
    let mut blocks: Vec<(Block, f64)> = Vec::new();
    let mut cells = cells.into_iter().peekable();
    let finish = |blocks: &mut Vec<(Block, f64)>, width: f64, height: f64| {
        let height = if height > 0.0 { height } else { blank };
        let items = blocks.drain(..).flat_map(|(block, at)| {
            let lift = (height - block.height) * [0.0, 0.5, 1.0][usize::from(block.align.min(2))];
            let shift = sheared(0.0, Vector3::new(at, lift, 0.0));
            block.items.into_iter().map(move |(color, item)| (color, item.placed(&shift)))
        });
        (Line { items: items.collect(), height }, width, align, layout.clone())
    };
    while let Some(cell) = cells.next() {
        match cell {
            Cell::Blank { width: blank, height: own } => {
                height = height.max(own);
                pen += blank;
            }
            Cell::Tab { height: own } => {
                height = height.max(own);
                let passed = layout.tabs.partition_point(|stop| stop * unit <= pen + 1e-9);
                let set = layout.tabs.get(passed).map(|stop| stop * unit);
                pen = set.unwrap_or_else(|| ((pen / (TAB * unit)).floor() + 1.0) * TAB * unit);
            }
            Cell::Block(first) => {
                // A word may consist of several blocks in different formats.
                let mut word = vec![first];
                while let Some(Cell::Block(block)) = cells.next_if(|cell| matches!(cell, Cell::Block(_))) {
                    word.push(block);
                }
                let needed: f64 = word.iter().map(|block| block.width).sum();
                if pen + needed > limit * (1.0 + 1e-9) && !blocks.is_empty() {
                    lines.push(finish(&mut blocks, width, height));
                    (pen, height) = (0.0, 0.0);
                }
                for block in word {
                    height = height.max(block.height);
                    let at = pen;
                    pen += block.width;
                    blocks.push((block, at));
                }
                width = pen;
            }
        }
    }
    lines.push(finish(&mut blocks, width, height));
    lines
}
