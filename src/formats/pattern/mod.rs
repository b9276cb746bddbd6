//! Drawings to be marked: DXF or picture bytes to a [`Pattern`](crate::geometry::pattern::Pattern) in mm and corrected
//! drawings back to bytes.
//!
//! Read widely, write narrowly, drop nothing silently: what cannot be taken over is named in [`PatternFacts`].

mod dxf;
mod error;
mod facts;
mod raster;
mod reading;
mod units;

pub use dxf::readback::{PathDifference, PathPlace, ReadbackError, read_back, readback_work};
pub use dxf::write::{DxfProfile, losses, write};
pub use error::{EntityName, PatternReadError, Spot};
pub use facts::{LayerFacts, LostInk, PatternFacts, RasterFacts, Repair, RepairPlace, Skipped};
pub use raster::RasterOptions;
pub use reading::{PatternOptions, PatternReading};
pub use units::{DrawingUnit, UnknownUnit};

use raster::RasterFormat;

/// Endings of drawings' names, in lower case.
const ENDINGS: [&str; 3] = ["dxf", "png", "bmp"];

/// Reads a drawing: DXF, text or binary, or a PNG or BMP picture. The bytes decide, not the file's name.
///
/// # Errors
/// The bytes are no whole DXF file or picture, a number is unreadable, the drawing unfolds to too much, a picture has no
/// size, or nothing in it can be marked; or it takes longer than [`PatternOptions::pace`] allows.
pub fn read(bytes: &[u8], options: &PatternOptions) -> Result<PatternReading, PatternReadError> {
    match RasterFormat::of(bytes) {
        Some(format) => raster::read(bytes, format, options),
        None => dxf::read(bytes, options),
    }
}

/// Whether the bytes reach to the end that their format marks, that is, whether a writer has finished.
pub fn is_complete(bytes: &[u8]) -> bool {
    RasterFormat::of(bytes).map_or_else(|| dxf::scan::is_complete(bytes), |format| format.is_complete(bytes))
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
