//! Drawings to be marked: DXF or picture bytes to a [`Pattern`] in mm and corrected drawings back to bytes.
//!
//! Read widely, write narrowly, drop nothing silently: what cannot be taken over is named in [`PatternFacts`].

mod dxf;
mod error;
mod facts;
mod picture;
mod units;

pub use dxf::write::{DxfProfile, losses, write};
pub use error::{EntityName, PatternReadError, Spot};
pub use facts::{LayerFacts, LostInk, NotTaken, PatternFacts, PictureFacts, Repair, RepairPlace};
pub use picture::PictureOptions;
pub use units::{DrawingUnit, UnknownUnit};

use super::Pace;
use crate::geometry::pattern::Pattern;
use crate::reason::Notice;
use picture::PictureFormat;

/// Drawings outside this range of sizes, mm, are rarely meant: markers' fields are smaller, and so are no marks.
const USUAL_SIZE: std::ops::RangeInclusive<f64> = 0.5..=1000.0;
/// Endings of drawings' names, in lower case.
const ENDINGS: [&str; 3] = ["dxf", "png", "bmp"];

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
    pub picture: PictureOptions,
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
            picture: PictureOptions::default(),
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

/// Reads a drawing: DXF, text or binary, or a PNG or BMP picture. The bytes decide, not the file's name.
///
/// # Errors
/// The bytes are no whole DXF file or picture, a number is unreadable, the drawing unfolds to too much, a picture has no
/// size, or nothing in it can be marked; or it takes longer than [`PatternOptions::pace`] allows.
pub fn read(bytes: &[u8], options: &PatternOptions) -> Result<PatternReading, PatternReadError> {
    match PictureFormat::of(bytes) {
        Some(format) => picture::read(bytes, format, options),
        None => dxf::read(bytes, options),
    }
}

/// Whether the bytes reach to the end that their format marks, that is, whether a writer has finished.
pub fn is_complete(bytes: &[u8]) -> bool {
    PictureFormat::of(bytes).map_or_else(|| dxf::scan::is_complete(bytes), |format| format.is_complete(bytes))
}

/// Whether a file of this name is a drawing, in capitals or not.
///
/// ```
/// use isomark::formats::pattern::is_drawing;
/// assert!(is_drawing("can@date.DXF") && is_drawing("can@logo.png") && !is_drawing("can.glb"));
/// ```
pub fn is_drawing(file_name: &str) -> bool {
    ending(file_name).is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
}

/// Whether a file of this name is a drawing that is given as a picture.
pub fn is_picture(file_name: &str) -> bool {
    ending(file_name).is_some_and(|ending| ENDINGS[1..].contains(&ending.as_str()))
}

fn ending(file_name: &str) -> Option<String> {
    file_name.rsplit_once('.').map(|(_, ending)| ending.to_ascii_lowercase())
}

/// A warning about a size that tells a wrong unit.
fn size_notice(facts: &PatternFacts) -> Option<Notice> {
    let [width, height] = facts.size;
    let message = format!(
        "the drawing is {width:.3} x {height:.3} mm, an unusual size; check its unit ({}: {}) and stray entities",
        facts.unit, facts.unit_why
    );
    (!USUAL_SIZE.contains(&width.max(height))).then(|| Notice::warning("size-unusual", message))
}
