//! Reads drawings, DXF, SVG or pictures, as a [`Pattern`](crate::geometry::pattern::Pattern) in mm, and writes corrected
//! drawings as DXF.
//!
//! The reader accepts many forms of DXF, the writer uses few. Nothing is dropped silently: [`PatternFacts`] lists
//! everything that was skipped.

mod budget;
mod colour;
mod content;
mod dxf;
mod error;
mod facts;
mod findings;
mod font;
mod layer_names;
mod raster;
mod reading;
mod svg;
mod units;

pub use content::{Content, FieldUse, FoundField, Moment, filled};
pub(crate) use content::{is_not_given, misspelt_in, short};
pub use dxf::readback::{PathDifference, PathPlace, ReadbackError, read_back, readback_work};
pub use dxf::space::{write_points, write_space};
pub use dxf::write::{DxfProfile, losses, write};
pub use error::{EntityName, PatternReadError, Spot};
pub use facts::{LayerFacts, LostInk, PatternFacts, RasterFacts, Repair, RepairPlace, Skipped};
pub(crate) use layer_names::{is_among, is_same_layer, unused_name};
pub use raster::RasterOptions;
pub use reading::{PatternOptions, PatternReading, Space, Strokes};
pub use units::{DrawingUnit, UnknownUnit};

use raster::RasterFormat;

/// File name endings of drawings, in lower case.
const ENDINGS: [&str; 4] = ["dxf", "svg", "png", "bmp"];
/// Those of pictures.
const PICTURES: [&str; 2] = ["png", "bmp"];

/// Reads a drawing: DXF, text or binary, SVG, or a PNG or BMP picture. The bytes decide, not the file's name.
///
/// # Errors
/// When the file is not a complete DXF file, SVG file or picture, a number cannot be read, the drawing is too large, a picture
/// has no size, there is nothing to mark, or reading takes longer than [`PatternOptions::pace`] allows.
pub fn read(bytes: &[u8], options: &PatternOptions) -> Result<PatternReading, PatternReadError> {
    match RasterFormat::of(bytes) {
        Some(format) => raster::read(bytes, format, options),
        None if svg::is_svg(bytes) => svg::read(bytes, options),
        None => dxf::read(bytes, options),
    }
}

/// Whether the bytes begin as a DXF file does, text or binary; the rest is not read.
#[must_use]
pub fn is_dxf(bytes: &[u8]) -> bool {
    dxf::scan::begins_a_file(bytes)
}

/// Whether the bytes begin as an SVG file does; the rest is not read.
#[must_use]
pub fn is_svg(bytes: &[u8]) -> bool {
    RasterFormat::of(bytes).is_none() && svg::is_svg(bytes)
}

/// Whether the bytes are complete up to the end mark of their format, so that the file is fully written.
#[must_use]
pub fn is_complete(bytes: &[u8]) -> bool {
    match RasterFormat::of(bytes) {
        Some(format) => format.is_complete(bytes),
        None if svg::is_svg(bytes) => svg::is_complete(bytes),
        None => dxf::scan::is_complete(bytes),
    }
}

/// Whether a file of this name is a drawing; the ending may be in upper or lower case.
///
/// ```
/// use isomark::formats::pattern::is_drawing;
/// assert!(is_drawing("can@date.DXF") && is_drawing("can@logo.png") && !is_drawing("can.glb"));
/// ```
#[must_use]
pub fn is_drawing(file_name: &str) -> bool {
    ending(file_name).is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
}

/// The names of drawings with this stem, in the usual spellings of their endings.
pub fn names_with_stem(stem: &str) -> impl Iterator<Item = String> {
    ENDINGS.into_iter().flat_map(move |ending| {
        [ending.to_owned(), ending.to_ascii_uppercase()].map(|ending| format!("{stem}.{ending}"))
    })
}

/// Whether a file of this name is a picture of pixels.
#[must_use]
pub fn is_picture(file_name: &str) -> bool {
    ending(file_name).is_some_and(|ending| PICTURES.contains(&ending.as_str()))
}

fn ending(file_name: &str) -> Option<String> {
    file_name.rsplit_once('.').map(|(_, ending)| ending.to_ascii_lowercase())
}
