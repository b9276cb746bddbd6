//! Options for reading a drawing, and the result.

use std::str::FromStr;

use super::super::Pace;
use super::content::Content;
use super::facts::PatternFacts;
use super::raster::options::RasterOptions;
use super::units::DrawingUnit;
use crate::geometry::pattern::Pattern;
use crate::reason::Notice;

/// Usual sizes of drawings, mm: few marking fields are larger, and few marks are smaller.
const USUAL_SIZE: std::ops::RangeInclusive<f64> = 0.5..=1000.0;

/// What is marked of the strokes in an SVG drawing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Strokes {
    /// Their centre lines.
    #[default]
    Center,
    /// The bands that they cover, in their width.
    Band,
}

/// Which space of a DXF drawing is read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Space {
    /// Model space.
    #[default]
    Model,
    /// A sheet in paper space: the one of this name, or without a name the only one with content.
    Paper(Option<String>),
}

impl Space {
    /// The words for it, where `NAME` is the name of a sheet.
    pub const WORDS: [&str; 3] = ["model", "paper", "paper:NAME"];
}

impl FromStr for Space {
    type Err = ();

    fn from_str(word: &str) -> Result<Self, ()> {
        match word.split_once(':') {
            None if word == "model" => Ok(Self::Model),
            None if word == "paper" => Ok(Self::Paper(None)),
            Some(("paper", name)) if !name.trim().is_empty() => Ok(Self::Paper(Some(name.trim().to_owned()))),
            _ => Err(()),
        }
    }
}

/// Options for reading a drawing.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct PatternOptions {
    /// Unit of drawings whose header states none. If this is none too: inches if `$MEASUREMENT` is imperial, else mm.
    pub unit_if_unitless: Option<DrawingUnit>,
    /// Unit of every drawing; it overrides the header. Default none.
    pub unit: Option<DrawingUnit>,
    /// Largest gap between the ends of loose pieces that is joined, mm; 0 joins nothing. Default 0.002: a hundred times
    /// the rounding of exporters and a tenth of a fine laser spot.
    pub joining_tolerance: f64,
    /// Leaves the drawing unchanged: nothing is joined, closed or removed; warnings name what would be. Default no.
    pub strict: bool,
    /// What is marked of the strokes in an SVG drawing. Default the centre lines.
    pub strokes: Strokes,
    /// Polylines of a DXF, and strokes that are marked as bands, become their centre lines below this width, mm. Default 0.05,
    /// the width of a fine beam: two edges closer together are marked as one line, twice.
    pub hairline: f64,
    /// Which space of a DXF drawing is read. Default model space.
    pub space: Space,
    /// Options for reading a picture; the size applies to the page of an SVG drawing, too.
    pub picture: RasterOptions,
    /// The values of fields in texts, such as `{serial}`. Default none: the text of a field is drawn as it is.
    pub content: Option<Content>,
    /// The layers that are marked: notices of line weights, white fills and transparency leave out others. Default all.
    pub ink_layers: Option<Vec<String>>,
    /// The time limit for reading. Default none.
    pub pace: Pace,
}

impl Default for PatternOptions {
    fn default() -> Self {
        Self {
            unit_if_unitless: None,
            unit: None,
            joining_tolerance: 0.002,
            strict: false,
            strokes: Strokes::Center,
            hairline: 0.05,
            space: Space::Model,
            picture: RasterOptions::default(),
            content: None,
            ink_layers: None,
            pace: Pace::Any,
        }
    }
}

impl PatternOptions {
    /// The same, read strictly or not.
    #[must_use]
    pub fn strictly(self, strict: bool) -> Self {
        Self { strict, ..self }
    }

    /// The same with this way of reading a picture.
    #[must_use]
    pub fn with_picture(self, picture: RasterOptions) -> Self {
        Self { picture, ..self }
    }

    /// The same with this way of marking strokes.
    #[must_use]
    pub fn with_strokes(self, strokes: Strokes) -> Self {
        Self { strokes, ..self }
    }

    /// The same with this width below which lines have no width, mm.
    #[must_use]
    pub fn with_hairline(self, hairline: f64) -> Self {
        Self { hairline, ..self }
    }

    /// The same with this space of a DXF drawing.
    #[must_use]
    pub fn with_space(self, space: Space) -> Self {
        Self { space, ..self }
    }

    /// The same with this distance below which ends are joined, mm.
    #[must_use]
    pub fn with_joining_tolerance(self, joining_tolerance: f64) -> Self {
        Self { joining_tolerance, ..self }
    }
}

/// A drawing with the facts about its file.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct PatternReading {
    /// The drawing, mm.
    pub pattern: Pattern,
    /// What the file states, and what was assumed, repaired and skipped.
    pub facts: PatternFacts,
}

/// A warning about a size that indicates a wrong unit.
pub(super) fn size_notice(facts: &PatternFacts) -> Option<Notice> {
    let [width, height] = facts.size;
    let message = format!(
        "the drawing is {width:.3} x {height:.3} mm, an unusual size; check its unit ({}: {}), and look for stray \
         entities",
        facts.unit, facts.unit_why
    );
    (!USUAL_SIZE.contains(&width.max(height))).then(|| Notice::warning("size-unusual", message))
}
