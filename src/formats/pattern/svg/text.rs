//! Texts as the outlines of their letters (SVG 1.1, chapter 10).

use std::borrow::Cow;
use std::rc::Rc;

use nalgebra::{Matrix2, Vector2};
use roxmltree::Node;

use super::super::content::{FoundField, Syntax, expand};
use super::super::error::PatternReadError;
use super::super::font::{
    ASCENDER, DESCENDER, FontUses, Glyph, Typeface, X_HEIGHT, composed, draws_nothing, missing_letters,
    substitute,
};
use super::document::attribute;
use super::style::{Anchor, Baseline, Decoration, LetterCase, Style, is_svg};
use super::walk::{Context, Missing, Walk, unread_length};
use crate::geometry::pattern::{Affine, Segment, Shape};
use crate::geometry::space::FlatPoint;

/// Largest number of letters of a text.
const LONGEST: usize = 50_000;
/// Deepest nesting of spans.
const MAX_DEPTH: usize = 32;
const FACE: Typeface = Typeface::Outline;

/// A letter with its properties, before it is placed.
struct Letter<'a, 'd> {
    node: Node<'a, 'd>,
    style: Rc<Style>,
    char: char,
    /// A new position: the text is aligned separately from here on.
    at: [Option<f64>; 2],
    shift: [f64; 2],
}

/// Lists of positions of an element, one for each of its letters.
struct Positions {
    at: [Vec<f64>; 2],
    shift: [Vec<f64>; 2],
    next: usize,
}

struct Reader<'w, 'a, 'd> {
    walk: &'w mut Walk<'a, 'd>,
    letters: Vec<Letter<'a, 'd>>,
    positions: Vec<Positions>,
    /// Why the text cannot be drawn.
    unread: Option<Cow<'static, str>>,
    fields: Vec<FoundField>,
    /// Whether a blank would follow another one.
    after_blank: bool,
}

/// Draws a text.
pub(super) fn draw<'a, 'd>(
    walk: &mut Walk<'a, 'd>,
    node: Node<'a, 'd>,
    context: &Context,
) -> Result<(), PatternReadError> {
    walk.count(node, context);
    let mut reader = Reader {
        walk,
        letters: Vec::new(),
        positions: Vec::new(),
        unread: None,
        fields: Vec::new(),
        after_blank: true,
    };
    reader.element(node, &Rc::new(context.style.clone()), context, 0)?;
    let Reader { mut letters, unread, fields, .. } = reader;
    if context.style.visible {
        let handle = walk.lines.handle(node);
        let layer = context.layer.clone();
        for field in fields {
            let field = field.of("text", Some(handle.clone()), &layer);
            // Copies of a text have one field.
            if !walk.drawn.fields.contains(&field) {
                walk.drawn.fields.push(field);
            }
        }
    }
    // A blank at the end is not shown, but would move a text that is aligned at its end.
    while letters.last().is_some_and(|letter| letter.char == ' ' && !letter.style.keeps_blanks) {
        letters.pop();
    }
    let missing = || missing_letters(FACE, letters.iter().map(|letter| letter.char)).map(Cow::Owned);
    if let Some(why) = unread.or_else(missing) {
        let missing = if context.style.visible { Missing::Ink } else { Missing::Hidden };
        walk.skip(node, &context.layer, why, missing);
        return Ok(());
    }
    if letters.iter().all(|letter| draws_nothing(letter.char)) {
        walk.skip(node, &context.layer, "it is blank".into(), Missing::Nothing);
        return Ok(());
    }
    let mut uses = FontUses::new();
    let mut bars: Vec<Bar<'_, '_>> = Vec::new();
    let mut pen = [0.0; 2];
    let mut rest = letters.as_slice();
    while let Some(first) = rest.first() {
        let end = rest.iter().skip(1).position(|letter| letter.at.iter().any(Option::is_some));
        let (chunk, later) = rest.split_at(end.map_or(rest.len(), |end| end + 1));
        rest = later;
        let row = set(chunk);
        // As in browsers, the spacing after the last letter is a part of the text.
        let widths = row.iter().map(|placed| placed.advance + placed.letter.shift[0]).sum::<f64>();
        for axis in 0..2 {
            pen[axis] = first.at[axis].unwrap_or(pen[axis]);
        }
        pen[0] -= match first.style.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => widths / 2.0,
            Anchor::End => widths,
        };
        for Placed { letter, glyph, advance } in row {
            for axis in 0..2 {
                pen[axis] += letter.shift[axis];
            }
            let scale = letter.style.font_size / FACE.em();
            let baseline = pen[1] + lift(&letter.style) * letter.style.font_size - letter.style.raised;
            Bar::along(&mut bars, letter, [pen[0], pen[0] + advance], baseline);
            if !glyph.shapes.is_empty() {
                let place = Affine {
                    linear: Matrix2::new(scale, 0.0, 0.0, -scale),
                    offset: Vector2::new(pen[0], baseline),
                };
                let shapes = glyph.shapes.iter().map(|shape| {
                    let segments: Vec<Segment> =
                        shape.segments().iter().map(|segment| segment.transformed(&place)).collect();
                    Shape::Closed(segments)
                });
                note_font(&letter.style, &mut uses);
                walk.draw(letter.node, shapes.collect(), &letter.style, context, true)?;
            }
            pen[0] += advance;
        }
    }
    for bar in bars {
        walk.draw(bar.node, vec![bar.shape()], &bar.style, context, true)?;
    }
    walk.drawn.remarks.texts.push(uses);
    Ok(())
}

/// How far the baseline is below the text's position, in ems. Fonts have no table of these lines; they are where Chromium
/// draws them.
fn lift(style: &Style) -> f64 {
    match style.baseline {
        Baseline::Alphabetic => 0.0,
        Baseline::Middle => X_HEIGHT / 2.0,
        Baseline::Central => (ASCENDER - DESCENDER) / 2.0,
        Baseline::Mathematical => ASCENDER / 2.0,
        Baseline::Hanging => ASCENDER * 0.8,
        Baseline::Above => ASCENDER,
        Baseline::Below => -DESCENDER,
    }
}

/// Thickness of a line along letters, in ems.
const BAR: f64 = 0.1;

/// A line along letters.
struct Bar<'a, 'd> {
    node: Node<'a, 'd>,
    kind: Decoration,
    style: Rc<Style>,
    along: [f64; 2],
    baseline: f64,
}

impl<'a, 'd> Bar<'a, 'd> {
    /// Adds the lines of a letter to those of the letters before it.
    fn along(bars: &mut Vec<Self>, letter: &Letter<'a, 'd>, along: [f64; 2], baseline: f64) {
        for (kind, style) in letter.style.decorations.iter() {
            let before = bars.iter_mut().rev().find(|bar| {
                bar.kind == *kind
                    && Rc::ptr_eq(&bar.style, style)
                    && bar.baseline == baseline
                    && bar.along[1] == along[0]
            });
            match before {
                Some(bar) => bar.along[1] = along[1],
                None => {
                    bars.push(Self { node: letter.node, kind: *kind, style: style.clone(), along, baseline })
                }
            }
        }
    }

    /// Chromium takes only the ascender from the font, not its lines in the tables `post` and `OS/2`.
    fn shape(&self) -> Shape {
        let bottom = match self.kind {
            Decoration::Underline => -BAR * 1.5,
            Decoration::Overline => ASCENDER,
            Decoration::LineThrough => ASCENDER / 3.0 - BAR / 2.0,
        };
        let em = self.style.font_size;
        let ([left, right], bottom) = (self.along, self.baseline - bottom * em);
        let top = bottom - BAR * em;
        let corners =
            [[left, top], [right, top], [right, bottom], [left, bottom]].map(|[x, y]| FlatPoint::new(x, y));
        let ends = corners.iter().zip(corners.iter().cycle().skip(1));
        Shape::Closed(ends.map(|(from, to)| Segment::Line { from: *from, to: *to }).collect())
    }
}

/// A glyph that is drawn for a letter, or for a letter and those after it.
struct Placed<'l, 'a, 'd> {
    letter: &'l Letter<'a, 'd>,
    glyph: Glyph,
    /// From the beginning of the letter to that of the next one, user units.
    advance: f64,
}

/// The glyphs of letters that are aligned together.
fn set<'l, 'a, 'd>(letters: &'l [Letter<'a, 'd>]) -> Vec<Placed<'l, 'a, 'd>> {
    let mut row = Vec::with_capacity(letters.len());
    for run in letters.chunk_by(|before, letter| has_same_font(&before.style, &letter.style)) {
        let Some(first) = run.first() else { continue };
        let is_joined = |index: usize| {
            index > 0
                && run[index].shift == [0.0; 2]
                && std::ptr::eq(&*run[index].style, &*run[index - 1].style)
        };
        let may_join = first.style.has_ligatures && first.style.letter_spacing == 0.0;
        let chars: Vec<(char, bool)> = run
            .iter()
            .enumerate()
            .map(|(index, letter)| (letter.char, may_join && is_joined(index)))
            .collect();
        let mut at = 0;
        for one in FACE.set(&chars, first.style.is_kerned) {
            let letter = &run[at];
            let own = one.glyph.advance * letter.style.font_size / FACE.em();
            row.push(Placed { letter, glyph: one.glyph, advance: own + spacing(letter) });
            at += one.letters;
        }
    }
    row
}

/// Whether letters with these styles are set as one word, although one of them may have another colour.
fn has_same_font(one: &Style, other: &Style) -> bool {
    let font = |style: &Style| {
        (
            (style.font_size, style.letter_spacing, style.is_bold, style.is_italic),
            (style.is_kerned, style.has_ligatures),
        )
    };
    font(one) == font(other) && one.font_family == other.font_family && one.stretch == other.stretch
}

/// The room after a letter, beside that of the font.
fn spacing(letter: &Letter<'_, '_>) -> f64 {
    let between_words = if matches!(letter.char, ' ' | '\u{a0}') { letter.style.word_spacing } else { 0.0 };
    letter.style.letter_spacing + between_words
}

fn note_font(style: &Style, uses: &mut FontUses) {
    let first = style.font_family.split(',').next().unwrap_or_default();
    let family = first.trim().trim_matches(['"', '\'']).trim();
    let mut asked: String = family.chars().take(100).collect();
    for (is_set, word) in [(style.is_bold, " bold"), (style.is_italic, " italic")] {
        if is_set {
            asked += word;
        }
    }
    if !style.stretch.is_empty() {
        asked.push(' ');
        asked.extend(style.stretch.chars().take(30));
    }
    let (face, is_exact) = substitute(&asked, true);
    debug_assert_eq!(face, FACE);
    if !is_exact {
        uses.insert((asked.into(), FACE));
    }
}

impl<'a, 'd> Reader<'_, 'a, 'd> {
    fn element(
        &mut self,
        node: Node<'a, 'd>,
        style: &Rc<Style>,
        context: &Context,
        depth: usize,
    ) -> Result<(), PatternReadError> {
        if depth > MAX_DEPTH {
            self.unread = Some("its spans are nested too deeply: convert it to paths".into());
            return Ok(());
        }
        if style.is_vertical {
            self.unread =
                Some("it is written vertically: convert it to paths (Path > Object to Path)".into());
        }
        if style.is_right_to_left {
            self.unread =
                Some("it is written from right to left: convert it to paths (Path > Object to Path)".into());
        }
        if style.letter_case == LetterCase::Unread {
            self.unread =
                Some("its letters are changed to capitals: write capitals, or convert it to paths".into());
        }
        if let Some(turned) = attribute(node, "rotate")
            && turned.split([',', ' ']).any(|angle| angle.parse::<f64>().is_ok_and(|angle| angle != 0.0))
        {
            self.unread = Some("its letters are rotated one by one: convert it to paths".into());
        }
        if attribute(node, "textLength").is_some() {
            self.unread = Some("it is stretched to a length (textLength): convert it to paths".into());
        }
        let viewport = context.viewport;
        let mut list = |name: &str, whole: f64| -> Vec<f64> {
            let text = attribute(node, name).unwrap_or_default();
            let lengths = text.split(|letter: char| letter.is_whitespace() || letter == ',');
            let lengths = lengths.filter(|length| !length.is_empty()).take(LONGEST);
            let read =
                lengths.map(|length| style.length(length, whole).ok_or_else(|| unread_length(name, length)));
            read.collect::<Result<_, _>>().unwrap_or_else(|why| {
                self.unread = Some(why.into());
                Vec::new()
            })
        };
        let at = [list("x", viewport.x), list("y", viewport.y)];
        let shift = [list("dx", viewport.x), list("dy", viewport.y)];
        self.positions.push(Positions { at, shift, next: 0 });
        if let Some(why) = style.unread_text().or(style.unread_own()) {
            self.unread = Some(why.to_owned().into());
        }
        for child in node.children() {
            if child.is_text() {
                self.text(child.text().unwrap_or_default(), node, style);
            } else if is_svg(child) {
                let own = self.walk.style(child, &context.with_style(style))?;
                match child.tag_name().name() {
                    "tspan" | "a" if own.displayed => {
                        if own.opacity == 0.0 {
                            self.unread =
                                Some("a part of it is fully transparent (opacity): delete that part".into());
                        }
                        self.element(child, &Rc::new(own), context, depth + 1)?
                    }
                    "textPath" | "tref" | "altGlyph" if own.displayed => {
                        self.unread =
                            Some("it follows a path or refers to another text: convert it to paths".into());
                    }
                    _ => {}
                }
            }
        }
        self.positions.pop();
        Ok(())
    }

    fn text(&mut self, text: &str, node: Node<'a, 'd>, style: &Rc<Style>) {
        let (text, found) = expand(text, Syntax::Plain, self.walk.content);
        self.fields.extend(found);
        let text = match style.letter_case {
            LetterCase::Upper => text.to_uppercase(),
            LetterCase::Lower => text.to_lowercase(),
            LetterCase::AsWritten | LetterCase::Unread => text,
        };
        for char in text.chars() {
            let char = match char {
                '\n' | '\r' if !style.keeps_blanks => {
                    // Line breaks are blanks between words; at the beginning they are dropped below.
                    ' '
                }
                '\n' | '\r' | '\t' => ' ',
                other => other,
            };
            if char == ' ' && self.after_blank && !style.keeps_blanks {
                continue;
            }
            self.after_blank = char == ' ';
            if self.letters.len() == LONGEST {
                self.unread = Some("it has more than 50000 letters: split it, or convert it to paths".into());
                return;
            }
            let mut letter = Letter { node, style: style.clone(), char, at: [None; 2], shift: [0.0; 2] };
            for axis in 0..2 {
                let of = |lists: fn(&Positions) -> &[Vec<f64>; 2]| {
                    let innermost = self.positions.iter().rev();
                    innermost
                        .filter_map(|positions| lists(positions)[axis].get(positions.next))
                        .next()
                        .copied()
                };
                letter.at[axis] = of(|positions| &positions.at);
                letter.shift[axis] = of(|positions| &positions.shift).unwrap_or(0.0);
            }
            self.positions.iter_mut().for_each(|positions| positions.next += 1);
            if let Some(last) = self.letters.last_mut()
                && let Some(char) = composed(last.char, char)
            {
                // An accent has no place of its own.
                last.char = char;
                continue;
            }
            self.letters.push(letter);
        }
    }
}
