//! TEXT, MTEXT and ATTRIB as the outlines or strokes of their letters.
//!
//! Heights are those of capitals, as in AutoCAD; the advance widths are those of the font that is used.

mod codes;
pub(super) mod paragraphs;
#[cfg(test)]
mod tests;

use std::rc::Rc;

use nalgebra::{Matrix3, Vector3};

use self::codes::{Letter, Ruled, letters};
use super::super::content::{FoundField, Syntax, expand};
use super::super::error::PatternReadError;
use super::super::font::{FontUses, Typeface, draws_nothing, missing_letters, substitute};
use super::budget::{Budget, Exceeded};
use super::curves::{Curve, Placement, through};
use super::groups::{Groups, own};
use super::items::{Item, Reader};
use super::scan::{Pair, Scan};
use super::structure::{AttributeMode, Record, Structure, TextStyle};

/// Lines under, over and through letters, for capitals 1 high: heights above the baseline and thickness.
const UNDER: f64 = -0.2;
const OVER: f64 = 1.2;
const THROUGH: f64 = 0.5;
const THICKNESS: f64 = 0.08;

/// The reason for skipping texts of blanks; no ink is lost.
const BLANK: &str = "it is blank";

/// The reason for skipping texts whose letters are below each other.
const VERTICAL: &str = "it is written vertically: convert it to outlines in the drawing program";

/// Longest text, bytes.
const LONGEST: usize = 50_000;
/// Number of letters of a font's name in messages.
const LONGEST_NAME: usize = 100;
/// The reason for skipping longer texts.
const TOO_LONG: &str =
    "it has more than 50000 letters: split it, or convert it to outlines in the drawing program";

/// What a TEXT, ATTRIB or ATTDEF draws.
pub(super) fn single_line(
    &Reader { scan, structure, content, .. }: &Reader<'_>,
    record: &Record,
    (uses, fields): (&mut FontUses, &mut Vec<FoundField>),
    budget: &mut Budget,
) -> Result<Item, PatternReadError> {
    let kind = structure.kind(record);
    let wanted =
        |code| matches!(code, 10 | 20 | 30 | 11 | 21 | 31 | 40 | 41 | 50 | 51 | 70..=74 | 210 | 220 | 230);
    let pairs = by_precedence(scan, structure, record);
    let numbers = pairs.iter().copied().filter(|pair| wanted(pair.code));
    let groups = Groups::of(scan, structure, record, numbers)?;
    if let Some(item) = without_text(kind, &groups, structure.header.attributes) {
        return Ok(item);
    }
    let string = |code| scan.whole_text(pairs.iter().copied().rfind(|pair| pair.code == code));
    let text = string(1);
    if text.len() > LONGEST {
        return Ok(Item::Skipped(TOO_LONG.into()));
    }
    let (text, found) = expand(&text, Syntax::Line, content);
    fields.extend(found);
    let letters = letters(&text, scan.page_of_letters());
    let style = structure.style(&string(7));
    let font = Font::of(style);
    let row = match font.row(&letters, 1.0, uses, budget) {
        Ok(row) => row,
        Err(why) => return Ok(Item::Skipped(why.into())),
    };
    if row.items.is_empty() {
        return Ok(Item::DrawsNothing(BLANK));
    }
    let height = groups.or(40, 0.0);
    if !(height > 0.0) {
        return Ok(Item::DrawsNothing("its height is 0"));
    }
    if style.is_some_and(|style| style.is_vertical) {
        return Ok(Item::Skipped(VERTICAL.into()));
    }
    let vertical = groups.flags(if kind == "TEXT" { 73 } else { 74 });
    let horizontal = groups.flags(72);
    let (first, second) = (groups.point(10), groups.point(11));
    let span = (second - first).xy();
    let stretched = matches!(horizontal, 3 | 5) && row.width > 0.0 && span.norm() > 0.0;

    let (mut x, mut y) = (height * groups.or(41, 1.0), height);
    let mut angle = groups.or(50, 0.0).to_radians();
    if stretched {
        // "Aligned" (3) keeps the letters' proportions, "fit" (5) keeps their height.
        let factor = span.norm() / (row.width * x);
        (x, y) = (x * factor, if horizontal == 3 { y * factor } else { y });
        angle = span.y.atan2(span.x);
    }
    let mirrored = groups.flags(71);
    x *= if mirrored & 2 != 0 { -1.0 } else { 1.0 };
    y *= if mirrored & 4 != 0 { -1.0 } else { 1.0 };
    let share = match horizontal {
        1 | 4 => 0.5,
        2 => 1.0,
        _ => 0.0,
    };
    let descender = row.face.descender();
    let lift = match (horizontal, vertical) {
        // "Middle" is the middle of capitals and descenders together.
        (4, _) => (1.0 - descender) / 2.0,
        (0..=2, 1) => -descender,
        (0..=2, 2) => 0.5,
        (0..=2, 3) => 1.0,
        _ => 0.0,
    };
    let is_at_first = stretched || matches!(horizontal, 3 | 5) || (horizontal, vertical) == (0, 0);
    let slant = groups.or(51, 0.0).to_radians();
    let at = if is_at_first { first } else { second };
    let turn = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), angle);
    let own =
        Placement { linear: turn.matrix() * Matrix3::from_diagonal(&Vector3::new(x, y, 1.0)), offset: at };
    let letters = sheared(slant, Vector3::new(-row.width * share, -lift, 0.0));
    Ok(row.placed(&groups.plane().after(&own).after(&letters)))
}

/// A slant by an angle, then a translation. A slant of nearly a right angle or more is ignored.
fn sheared(slant: f64, offset: Vector3<f64>) -> Placement {
    let mut linear = Matrix3::identity();
    if slant.abs() < 1.48 {
        linear[(0, 1)] = slant.tan();
    }
    Placement { linear, offset }
}

/// What an ATTRIB or ATTDEF with these numbers is if its text is not drawn; `None` if it is, as that of a TEXT.
fn without_text(kind: &str, groups: &Groups, shown: AttributeMode) -> Option<Item> {
    let flags = groups.flags(70);
    match kind {
        "TEXT" => None,
        _ if flags & 1 != 0 && shown != AttributeMode::All => Some(Item::DrawsNothing("it is invisible")),
        // The text that a user fills in is an ATTRIB; only a constant text is drawn by its definition.
        "ATTDEF" if flags & 2 == 0 => Some(Item::Template),
        _ if shown == AttributeMode::None => Some(Item::Unseen(
            "the drawing shows no attributes ($ATTMODE is 0): set it to 1 to mark visible ones",
        )),
        _ => None,
    }
}

/// The pairs of a text so that the last one of a group code is valid: those of the attribute, if it is one, before
/// those of the text.
///
/// An ATTRIB repeats groups of the text in its own subclass, and the DXF Reference documents some of them only there.
/// From R2018 on, 71 and 72 in it are the type of the attribute and an unknown number. An AcDbXrecord has a position
/// and a scale of its own.
fn by_precedence<'p>(scan: &'p Scan<'_>, structure: &Structure, record: &Record) -> Vec<&'p Pair> {
    let has_type = structure.header.version.as_str() >= "AC1032";
    let (mut of_attribute, mut of_text) = (Vec::new(), Vec::new());
    let mut class: &[u8] = b"";
    for pair in own(scan, record.pairs(scan)) {
        match (class, pair.code) {
            (_, 100) => class = scan.raw(pair),
            (b"AcDbXrecord", _) => {}
            (b"AcDbAttribute" | b"AcDbAttributeDefinition", 71 | 72) if has_type => {}
            (b"AcDbAttribute" | b"AcDbAttributeDefinition", _) => of_attribute.push(pair),
            _ => of_text.push(pair),
        }
    }
    of_attribute.append(&mut of_text);
    of_attribute
}

/// A font as a drawing names it.
#[derive(Debug, Clone, PartialEq)]
struct Font {
    asked: Rc<str>,
    face: Typeface,
    is_exact: bool,
}

impl Font {
    fn named(asked: &str, is_family: bool) -> Self {
        let (face, is_exact) = substitute(asked, is_family);
        let asked = asked.chars().take(LONGEST_NAME).collect::<String>().into();
        Self { asked, face, is_exact }
    }

    /// The font of a text style.
    fn of(style: Option<&TextStyle>) -> Self {
        match style {
            Some(TextStyle { family: Some(family), .. }) => Self::named(family, true),
            Some(style) => Self::named(&style.file, false),
            None => Self::named("txt", false),
        }
    }

    /// Letters in a row, in the substitute of this font, or in the outline font if the substitute lacks a letter.
    /// `tracking` is a factor of the letters' advance widths.
    ///
    /// # Errors
    /// A sentence if no font has one of the letters, or if there are more letters than the budget allows.
    fn row(
        &self,
        letters: &[Letter],
        tracking: f64,
        uses: &mut FontUses,
        budget: &mut Budget,
    ) -> Result<Row, String> {
        let lacks = |face: Typeface, letter: char| face.glyph(letter).is_none() && !draws_nothing(letter);
        let face = match letters.iter().any(|letter| lacks(self.face, letter.char)) {
            true => Typeface::Outline,
            false => self.face,
        };
        if let Some(why) = missing_letters(face, letters.iter().map(|letter| letter.char)) {
            return Err(why);
        }
        if !(self.is_exact && face == self.face) && letters.iter().any(|letter| !letter.char.is_whitespace())
        {
            uses.insert((self.asked.clone(), face));
        }
        Ok(Row::new(letters, face, tracking, budget)?)
    }
}

/// Letters along the baseline from the origin, with capitals 1 high.
struct Row {
    items: Vec<Item>,
    width: f64,
    face: Typeface,
}

impl Row {
    fn new(letters: &[Letter], face: Typeface, tracking: f64, budget: &mut Budget) -> Result<Self, Exceeded> {
        let mut row = Self { items: Vec::new(), width: 0.0, face };
        let mut starts = Vec::with_capacity(letters.len() + 1);
        for letter in letters {
            starts.push(row.width);
            let blank = || face.glyph(' ').filter(|_| letter.char.is_whitespace());
            let Some(glyph) = face.glyph(letter.char).or_else(blank) else { continue };
            budget.hold(glyph.shapes.iter().map(|shape| shape.segments().len()).sum())?;
            let shift = sheared(0.0, Vector3::new(row.width, 0.0, 0.0));
            let curves: Vec<Curve> =
                glyph.shapes.iter().map(|shape| Curve::of(shape).placed(&shift)).collect();
            match face {
                Typeface::Outline if curves.is_empty() => {}
                Typeface::Outline => row.items.push(Item::Fill(curves)),
                Typeface::Stroke => row.items.extend(curves.into_iter().map(Item::Curve)),
            }
            row.width += glyph.advance * tracking;
        }
        starts.push(row.width);
        let rules: [fn(&Ruled) -> bool; 3] = [|ruled| ruled.under, |ruled| ruled.over, |ruled| ruled.through];
        for (height, is_ruled) in [UNDER, OVER, THROUGH].into_iter().zip(rules) {
            let mut index = 0;
            for run in letters.chunk_by(|a, b| is_ruled(&a.ruled) == is_ruled(&b.ruled)) {
                let (from, to) = (starts[index], starts[index + run.len()]);
                index += run.len();
                if run.first().is_some_and(|letter| is_ruled(&letter.ruled)) {
                    budget.hold(4)?;
                    row.items.push(rule(face, from, to, height));
                }
            }
        }
        Ok(row)
    }

    fn placed(self, placement: &Placement) -> Item {
        Item::Several(self.items.into_iter().map(|item| (None, item.placed(placement))).collect())
    }
}

/// A line along a row: a stroke, or a thin rectangle with an outline font.
fn rule(face: Typeface, from: f64, to: f64, height: f64) -> Item {
    let at = |x, y| Vector3::new(x, y, 0.0);
    match face {
        Typeface::Stroke => Item::Curve(through(&[at(from, height), at(to, height)], false)),
        Typeface::Outline => {
            let (low, high) = (height - THICKNESS / 2.0, height + THICKNESS / 2.0);
            Item::Fill(vec![through(&[at(from, low), at(to, low), at(to, high), at(from, high)], true)])
        }
    }
}
