//! How a drawing is read, and what comes of it.

use super::super::Pace;
use super::facts::PatternFacts;
use super::raster::options::RasterOptions;
use super::units::DrawingUnit;
use crate::geometry::pattern::Pattern;
use crate::reason::Notice;

/// Drawings outside this range of sizes, mm, are rarely meant: markers' fields are smaller, and so are no marks.
const USUAL_SIZE: std::ops::RangeInclusive<f64> = 0.5..=1000.0;

/// How a drawing is read.
#[derive(Debug, Clone, PartialEq)]
pub struct PatternOptions {
    /// Unit of drawings whose header names none; without it mm, or inches if `$MEASUREMENT` says imperial.
    pub unit_if_unitless: Option<DrawingUnit>,
    /// Unit of every drawing, whatever its header says. Default none.
    pub unit: Option<DrawingUnit>,
    /// Ends of loose pieces no farther apart are joined, mm. Default 0.002: a hundred times the rounding of exporters
    /// and a tenth of a fine laser spot. 0 joins nothing.
    pub joining_tolerance: f64,
    /// Leaves the drawing as it is: nothing is joined, closed or taken out, and what would be is warned of. Default no.
    pub strict: bool,
    /// How a picture is read.
    pub picture: RasterOptions,
    /// How long reading may take. Default as long as it takes.
    pub pace: Pace,
}

impl Default for PatternOptions {
    fn default() -> Self {
        Self {
            unit_if_unitless: None,
            unit: None,
            joining_tolerance: 0.002,
            strict: false,
            picture: RasterOptions::default(),
            pace: Pace::Any,
        }
    }
}

/// A drawing and what was found on the way.
#[derive(Debug, Clone, PartialEq)]
pub struct PatternReading {
    /// The drawing, mm.
    pub pattern: Pattern,
    /// What the file says, what was assumed, repaired and left out.
    pub facts: PatternFacts,
}

/// A warning about a size that tells a wrong unit.
pub(super) fn size_notice(facts: &PatternFacts) -> Option<Notice> {
    let [width, height] = facts.size;
    let message = format!(
        "the drawing is {width:.3} x {height:.3} mm, an unusual size; check its unit ({}: {}) and stray entities",
        facts.unit, facts.unit_why
    );
    (!USUAL_SIZE.contains(&width.max(height))).then(|| Notice::warning("size-unusual", message))
}
