//! The two fonts included in isomark, and the choice of the one that replaces a font of a drawing.
//!
//! DejaVu Sans gives outlines, as TrueType fonts do; Hershey's Simplex Roman gives single strokes, as AutoCAD's SHX
//! fonts do. `fonts/` at the root of the project holds both with their licences and the script that made them.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;
use std::sync::LazyLock;

use ttf_parser::gpos::{PairAdjustment, PositioningSubtable};
use ttf_parser::gsub::SubstitutionSubtable;
use ttf_parser::{Face, GlyphId, OutlineBuilder};
use unicode_normalization::char::compose;

use crate::geometry::pattern::{Segment, Shape};
use crate::geometry::space::FlatPoint;
use crate::printable::is_invisible;

const OUTLINES: &[u8] = include_bytes!("../../../fonts/DejaVuSans-subset.ttf");
const STROKES: &str = include_str!("../../../fonts/hershey-simplex.txt");

/// Height of a capital of the stroke font, in its units.
const STROKE_CAPITAL: f64 = 21.0;

/// Heights of the outline font in ems: of its tables `hhea`, and of an `x`.
pub(super) const ASCENDER: f64 = 1901.0 / 2048.0;
pub(super) const DESCENDER: f64 = 483.0 / 2048.0;
pub(super) const X_HEIGHT: f64 = 1120.0 / 2048.0;

/// A font that a drawing names, and the one that was used instead.
pub(super) type FontUse = (Rc<str>, Typeface);

/// The replaced fonts of a text.
pub(super) type FontUses = BTreeSet<FontUse>;

/// A font that is included in isomark.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Typeface {
    Outline,
    Stroke,
}

/// The shape of a letter; capitals are 1 high, the baseline is y = 0, the letter begins at x = 0.
#[derive(Debug, Clone, Default)]
pub(super) struct Glyph {
    /// Advance width: from the beginning of the letter to that of the next one.
    pub(super) advance: f64,
    pub(super) shapes: Vec<Shape>,
}

/// A glyph in a line of text.
#[derive(Debug, Clone)]
pub(super) struct Set {
    /// Its advance includes the kerning towards the next glyph.
    pub(super) glyph: Glyph,
    /// Number of letters that it stands for.
    pub(super) letters: usize,
}

impl Typeface {
    /// The font's name for messages.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Outline => "DejaVu Sans",
            Self::Stroke => "Hershey Simplex (single strokes)",
        }
    }

    /// How far `p` reaches below the baseline, for capitals 1 high.
    pub(super) fn descender(self) -> f64 {
        match self {
            Self::Outline => 426.0 / 1493.0,
            Self::Stroke => 7.0 / STROKE_CAPITAL,
        }
    }

    /// The size of an em, for capitals 1 high; sizes of fonts are usually given in em.
    pub(super) fn em(self) -> f64 {
        match self {
            Self::Outline => FACE.as_ref().map_or(2048.0, |face| f64::from(face.units_per_em())) / *CAPITAL,
            Self::Stroke => 4.0 / 3.0,
        }
    }

    /// The letter's shape; `None` if the font does not have it. Invisible letters have none and take no room, although a font may draw
    /// them: soft hyphens as hyphens.
    pub(super) fn glyph(self, letter: char) -> Option<Glyph> {
        match self {
            _ if is_invisible(letter) => Some(Glyph::default()),
            Self::Outline => outline(letter),
            Self::Stroke => STROKE_GLYPHS.get(&letter).cloned(),
        }
    }

    /// Letters side by side, as programs that show text set them: with the font's kerning if it is on, and with its ligatures. Each
    /// letter states whether it may be joined to the one before it. Blanks that the font does not have are as wide as a space; other
    /// letters that it does not have take no room.
    pub(super) fn set(self, letters: &[(char, bool)], is_kerned: bool) -> Vec<Set> {
        let ids: Vec<Option<GlyphId>> = letters.iter().map(|(letter, _)| self.id(*letter)).collect();
        let mut set: Vec<Set> = Vec::with_capacity(letters.len());
        let mut before = None;
        let mut at = 0;
        while let Some((letter, _)) = letters.get(at) {
            let joined = letters[at + 1..].iter().take_while(|(_, is_joined)| *is_joined).count();
            let ligature = ligature(&ids[at..=at + joined]);
            let (id, count) = ligature.map_or((ids[at], 1), |(id, count)| (Some(id), count));
            let glyph = match ligature {
                Some((id, _)) => outline_of(id),
                None => self.glyph(*letter).or_else(|| self.glyph(' ').filter(|_| letter.is_whitespace())),
            };
            if let (true, Some(last), Some(left), Some(right)) = (is_kerned, set.last_mut(), before, id) {
                last.glyph.advance += kerning(left, right);
            }
            set.push(Set { glyph: glyph.unwrap_or_default(), letters: count });
            before = id;
            at += count;
        }
        set
    }

    /// The glyph of a letter in tables of kerning and ligatures.
    fn id(self, letter: char) -> Option<GlyphId> {
        let face = FACE.as_ref().filter(|_| self == Self::Outline && !is_invisible(letter))?;
        face.glyph_index(letter)
    }
}

/// The included font for a font file or family in a drawing, such as `txt`, `romans.shx`, `arial.ttf` or `Arial Bold`,
/// and whether it is exactly that font.
///
/// Names of SHX files and names without an ending are single-stroke fonts, all others are outline fonts.
pub(super) fn substitute(asked: &str, is_family: bool) -> (Typeface, bool) {
    let file = asked.rsplit(['/', '\\']).next().unwrap_or_default().to_lowercase();
    let (stem, ending) = file.rsplit_once('.').unwrap_or((&file, ""));
    match (is_family, ending) {
        (false, "" | "shx" | "shp") => (Typeface::Stroke, false),
        _ => {
            (Typeface::Outline, matches!(if is_family { &file } else { stem }, "dejavu sans" | "dejavusans"))
        }
    }
}

/// The one letter that a letter and an accent behind it are, such as `Ä` for `A` and U+0308, as some programs write it.
pub(super) fn composed(letter: char, accent: char) -> Option<char> {
    compose(letter, accent)
}

/// Whether a letter needs no shape: blanks of all widths, joiners and direction marks.
pub(super) fn draws_nothing(letter: char) -> bool {
    letter.is_whitespace() || is_invisible(letter)
}

/// What to do about letters that no font has, at the end of the sentence about them.
pub(super) const CONVERT_TO_OUTLINES: &str = ": convert the text to outlines in the drawing program";

/// A sentence about the letters that a font does not have; `None` if it has all of them.
pub(super) fn missing_letters(face: Typeface, letters: impl Iterator<Item = char>) -> Option<String> {
    let mut seen = BTreeSet::new();
    let missing = letters.filter(|letter| face.glyph(*letter).is_none() && !draws_nothing(*letter));
    let missing: String = missing.filter(|letter| seen.insert(*letter)).take(12).collect();
    match missing.chars().count() {
        0 => None,
        1 => Some(format!("its letter {missing} is in no available font{CONVERT_TO_OUTLINES}")),
        _ => Some(format!("its letters {missing} are in no available font{CONVERT_TO_OUTLINES}")),
    }
}

static FACE: LazyLock<Option<Face<'static>>> = LazyLock::new(|| Face::parse(OUTLINES, 0).ok());

/// Height of the capital X of the outline font, in its units.
static CAPITAL: LazyLock<f64> = LazyLock::new(|| {
    let face = FACE.as_ref();
    let capital = face.and_then(|face| face.glyph_bounding_box(face.glyph_index('X')?));
    capital.map_or(1493.0, |bounds| f64::from(bounds.y_max))
});

fn outline(letter: char) -> Option<Glyph> {
    outline_of(FACE.as_ref()?.glyph_index(letter)?)
}

fn outline_of(id: GlyphId) -> Option<Glyph> {
    let face = FACE.as_ref()?;
    let scale = 1.0 / *CAPITAL;
    let mut pen = Pen { scale, at: FlatPoint::new(0.0, 0.0), contours: Vec::new() };
    face.outline_glyph(id, &mut pen);
    let contours = pen.contours.into_iter().filter(|contour| contour.len() > 1);
    let shapes = contours.map(|mut contour| {
        contour.shrink_to_fit();
        Shape::Closed(contour)
    });
    Some(Glyph { advance: f64::from(face.glyph_hor_advance(id)?) * scale, shapes: shapes.collect() })
}

/// The glyph that stands for the first of these, and for how many; the subset of the font has no other substitutions.
fn ligature(ids: &[Option<GlyphId>]) -> Option<(GlyphId, usize)> {
    let (first, rest) = ids.split_first()?;
    let tables = FACE.as_ref()?.tables().gsub?;
    let subtables = tables.lookups.into_iter().flat_map(|lookup| lookup.subtables.into_iter());
    let ligatures = subtables.filter_map(|subtable| match subtable {
        SubstitutionSubtable::Ligature(table) => table.ligature_sets.get(table.coverage.get((*first)?)?),
        _ => None,
    });
    // A font lists the longest ones first.
    let fits = |components: ttf_parser::LazyArray16<'_, GlyphId>| {
        components.into_iter().enumerate().all(|(index, id)| rest.get(index) == Some(&Some(id)))
    };
    let found = ligatures.flatten().find(|ligature| fits(ligature.components))?;
    Some((found.glyph, 1 + usize::from(found.components.len())))
}

/// How much further apart than their advances two glyphs are, for capitals 1 high.
fn kerning(left: GlyphId, right: GlyphId) -> f64 {
    let Some(tables) = FACE.as_ref().and_then(|face| face.tables().gpos) else { return 0.0 };
    let subtables = tables.lookups.into_iter().flat_map(|lookup| lookup.subtables.into_iter());
    let pairs = subtables.filter_map(|subtable| match subtable {
        PositioningSubtable::Pair(PairAdjustment::Format1 { coverage, sets }) => {
            sets.get(coverage.get(left)?)?.get(right)
        }
        PositioningSubtable::Pair(PairAdjustment::Format2 { coverage, classes: (first, second), matrix }) => {
            coverage.get(left).and_then(|_| matrix.get((first.get(left), second.get(right))))
        }
        _ => None,
    });
    pairs.map(|(left, _)| f64::from(left.x_advance) / *CAPITAL).sum()
}

/// Collects the contours of an outline.
struct Pen {
    scale: f64,
    at: FlatPoint,
    contours: Vec<Vec<Segment>>,
}

impl Pen {
    fn point(&self, x: f32, y: f32) -> FlatPoint {
        FlatPoint::new(f64::from(x) * self.scale, f64::from(y) * self.scale)
    }

    fn push(&mut self, segment: Segment) {
        self.at = segment.end();
        if let Some(contour) = self.contours.last_mut() {
            contour.push(segment);
        }
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        self.at = self.point(x, y);
        self.contours.push(Vec::new());
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let to = self.point(x, y);
        if to != self.at {
            self.push(Segment::Line { from: self.at, to });
        }
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        // Raised to degree 3.
        let (control, to) = (self.point(x1, y1), self.point(x, y));
        let third = |end: FlatPoint| ((end.coords() + control.coords() * 2.0) / 3.0).into();
        let points = [self.at, third(self.at), third(to), to];
        self.push(Segment::Bezier { points, weights: [1.0; 4] });
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let points = [self.at, self.point(x1, y1), self.point(x2, y2), self.point(x, y)];
        self.push(Segment::Bezier { points, weights: [1.0; 4] });
    }

    fn close(&mut self) {
        let start = self.contours.last().and_then(|contour| contour.first()).map(Segment::start);
        if let Some(to) = start.filter(|start| *start != self.at) {
            self.push(Segment::Line { from: self.at, to });
        }
    }
}

/// The letters of the stroke font. Every line of its file is one letter: code point; advance; strokes of points.
static STROKE_GLYPHS: LazyLock<BTreeMap<char, Glyph>> =
    LazyLock::new(|| STROKES.lines().filter_map(stroke_glyph).collect());

fn stroke_glyph(line: &str) -> Option<(char, Glyph)> {
    let mut fields = line.split(';');
    let letter = u32::from_str_radix(fields.next()?, 16).ok().and_then(char::from_u32)?;
    let advance = fields.next()?.parse::<f64>().ok()? / STROKE_CAPITAL;
    let point = |pair: &str| -> Option<FlatPoint> {
        let (x, y) = pair.split_once(',')?;
        Some(FlatPoint::new(x.parse::<f64>().ok()? / STROKE_CAPITAL, y.parse::<f64>().ok()? / STROKE_CAPITAL))
    };
    let shapes = fields.map(|stroke| {
        let points: Vec<FlatPoint> = stroke.split(' ').filter_map(point).collect();
        let ends = points.iter().zip(points.iter().skip(1));
        let lines = ends.map(|(from, to)| Segment::Line { from: *from, to: *to }).collect();
        let closed = points.len() > 2 && points.first() == points.last();
        if closed { Shape::Closed(lines) } else { Shape::Open(lines) }
    });
    Some((letter, Glyph { advance, shapes: shapes.collect() }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_fonts_have_the_letters_of_european_labels() {
        for face in [Typeface::Outline, Typeface::Stroke] {
            for letter in (' '..='~').chain("ÄÖÜäöüßØø°±µ×·éèêñçşžłÅ€²³–".chars().filter(|letter| {
                // Hershey has no L with stroke; words with it are drawn in the outline font.
                face == Typeface::Outline || *letter != 'ł'
            })) {
                assert!(face.glyph(letter).is_some_and(|glyph| glyph.advance > 0.0), "{face:?}: {letter}");
            }
        }
        assert!(Typeface::Outline.glyph('株').is_none() && Typeface::Outline.glyph('Ж').is_some());
    }

    /// Unicode Standard Annex #15: macOS writes accents behind their letters.
    #[test]
    fn accents_behind_letters_are_part_of_them() {
        assert_eq!(
            [('A', '\u{308}'), ('c', '\u{327}'), ('a', '\u{301}')]
                .map(|(letter, accent)| composed(letter, accent)),
            [Some('Ä'), Some('ç'), Some('á')]
        );
        assert_eq!(composed('A', 'B'), None);
    }

    /// The default-ignorable code points of Unicode.
    #[test]
    fn invisible_letters_are_not_drawn_and_take_no_room() {
        for face in [Typeface::Outline, Typeface::Stroke] {
            for letter in ['\u{ad}', '\u{200b}', '\u{200d}', '\u{200f}', '\u{2060}', '\u{feff}'] {
                let glyph = face.glyph(letter).unwrap();
                assert!(glyph.shapes.is_empty() && glyph.advance == 0.0, "{face:?}: {letter:?}");
            }
        }
    }

    /// The values are in the tables GPOS and GSUB of DejaVu Sans 2.37, as fontTools prints them.
    #[test]
    fn letters_are_kerned_and_joined_as_the_font_states() {
        let width = |text: &str, is_kerned: bool| {
            let letters: Vec<(char, bool)> = text.chars().map(|letter| (letter, true)).collect();
            let set = Typeface::Outline.set(&letters, is_kerned);
            (set.len(), (set.iter().map(|one| one.glyph.advance).sum::<f64>() * 1493.0).round())
        };
        for (text, glyphs, unkerned, kerned) in [
            ("AVATAR To We.", 13, 16020, 14972),
            ("office", 4, 5619, 5619),
            ("flow", 3, 4218, 4218),
            ("affluent", 6, 7894, 7894),
            ("Tfi", 2, 2541, 2541),
            ("HAMBURG", 7, 10622, 10622),
            ("Lj", 2, 1710, 1710),
            ("Привет, Яр", 10, 11856, 11856),
        ] {
            assert_eq!(width(text, false), (glyphs, f64::from(unkerned)), "{text}");
            assert_eq!(width(text, true), (glyphs, f64::from(kerned)), "{text}");
        }
        assert_eq!(Typeface::Outline.set(&[('f', false), ('i', false)], true).len(), 2);
        let stroke = Typeface::Stroke.set(&[('A', false), ('V', true)], true);
        assert_eq!(stroke[0].glyph.advance, Typeface::Stroke.glyph('A').unwrap().advance);
    }

    #[test]
    fn heights_are_those_of_the_font() {
        let face = FACE.as_ref().unwrap();
        let em = f64::from(face.units_per_em());
        assert_eq!(ASCENDER * em, f64::from(face.ascender()));
        assert_eq!(DESCENDER * em, -f64::from(face.descender()));
        let x = face.glyph_bounding_box(face.glyph_index('x').unwrap()).unwrap();
        assert_eq!(X_HEIGHT * em, f64::from(x.y_max));
    }

    #[test]
    fn capitals_are_one_high() {
        for face in [Typeface::Outline, Typeface::Stroke] {
            let glyph = face.glyph('X').unwrap();
            let segments = glyph.shapes.iter().flat_map(Shape::segments);
            let ends = segments.flat_map(|segment| [segment.start().y, segment.end().y]);
            let (low, high) = ends.fold((0.0f64, 0.0f64), |(low, high), y| (low.min(y), high.max(y)));
            assert!(low.abs() < 1e-12 && (high - 1.0).abs() < 1e-12, "{face:?}: {low} to {high}");
        }
    }

    #[test]
    fn substitutes_are_outlines_for_truetype_and_strokes_for_shx() {
        assert_eq!(substitute("txt", false), (Typeface::Stroke, false));
        assert_eq!(substitute("C:\\fonts\\romans.SHX", false), (Typeface::Stroke, false));
        assert_eq!(substitute("arial.ttf", false), (Typeface::Outline, false));
        assert_eq!(substitute("Arial", true), (Typeface::Outline, false));
        assert_eq!(substitute("DejaVuSans.ttf", false), (Typeface::Outline, true));
        assert_eq!(substitute("DejaVu Sans", true), (Typeface::Outline, true));
    }
}
