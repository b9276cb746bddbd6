//! The preview as a picture: its panels, or the tiles of a mark that goes round the part.

use super::relief::Backdrop;
use super::{Preview, layout, tiles};

/// Draws the preview: the pattern before and after the correction as the laser draws it, the mark unrolled from the part, an
/// inset of the whole part, a legend and the summary.
///
/// One user unit is one mm of paper. A pattern between a coin and a hand in size is drawn in true size, smaller and
/// larger ones at the scale that the picture states. Coordinates and stretches that are not finite are skipped. If
/// there are more segments than a screen can resolve, they are joined, so that the text stays within a few megabytes.
#[must_use]
pub fn svg(preview: &Preview) -> String {
    svg_on(&Backdrop::of(&preview.part_outline), preview)
}

/// The same as [`svg`] for many drawings on one part: `backdrop` is that of the preview's own
/// [`part_outline`](Preview::part_outline), and drawing it takes most of the time.
#[must_use]
pub fn svg_on(backdrop: &Backdrop, preview: &Preview) -> String {
    match &preview.tiles {
        Some(picture) => tiles::svg(preview, picture),
        None => layout::svg_on(backdrop, preview),
    }
}
