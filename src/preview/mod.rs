//! The pictures of a job: the part as the laser sees it, and on it the lines before and after the correction.
//!
//! [`glb`] writes the part and the mark in three dimensions, [`svg`] a flat preview.
//! [`svg`] turns values into text; it opens no file and measures nothing. Panels show the pattern
//! as the laser draws it, before and after, and the mark unrolled from the part; an inset shows the whole part, and colours
//! show how much longer or shorter each line is on the part than in the drawing. The same preview gives the same bytes.
//!
//! ```
//! use isomark::preview::{HeightPicture, Preview, PreviewPath, svg};
//!
//! let line = PreviewPath { points: vec![[0.0, 0.0], [20.0, 0.0]], closed: false, stretch: vec![0.08] };
//! let preview = Preview { title: "can · date.dxf".into(), before: vec![line], ..Preview::default() };
//! assert!(svg(&preview).contains("+8.0 %"));
//! ```

mod draw;
mod layout;
mod window;
mod page;
mod stretch_scale;
mod ink;
mod relief;
mod on_part;
mod sides;
mod tiles;

use std::sync::Arc;

use crate::geometry::space::Extents;

pub use draw::{svg, svg_on};
pub use on_part::{INK_LIFT, InkMesh, LIFT, ON_PART_SCHEMA, OnPart, PartSource, glb};
pub(crate) use page::escaped;
pub use relief::Backdrop;
pub use sides::{SidePicture, sides_svg};
pub(crate) use stretch_scale::{colors as stretch_colors, range_text as stretch_range_text};
pub use tiles::{TilePicture, TilesPicture};

/// The content of the picture. All lengths are in mm of the view, x to the right and y up as the laser sees it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Preview {
    /// Heading, such as `mouse · date.dxf · isometric`.
    pub title: String,
    /// The part as the laser sees it.
    pub part_outline: Arc<HeightPicture>,
    /// The lines without a correction.
    pub before: Vec<PreviewPath>,
    /// The corrected lines, with the remaining stretch.
    pub after: Vec<PreviewPath>,
    /// The corrected lines on the part, unrolled about the drawing's anchor: what a person sees who looks at the mark along
    /// the normal of the part. Empty if this is not known.
    pub unrolled: Vec<PreviewPath>,
    /// Width and height of the part in the view, mm, if they are known exactly.
    pub part_size: Option<[f64; 2]>,
    /// Smallest and largest measured stretch of the lines without a correction; if absent, that of the shown segments.
    pub before_range: Option<[f64; 2]>,
    /// Smallest and largest measured stretch of the corrected lines; if absent, that of the shown segments.
    pub after_range: Option<[f64; 2]>,
    /// The working area, if it is known.
    pub field: Option<Extents>,
    /// Rows of the table at the bottom: label and text, such as `length error` and `6.83 mm → 0.05 mm`.
    pub summary: Vec<(String, String)>,
    /// The tiles of a mark that goes round the part; they are then shown instead of the panels before and after.
    pub tiles: Option<TilesPicture>,
}

/// Heights of the part on a square grid, for the background of the picture. About 200 nodes along the longer side
/// give a smooth rim; more are thinned.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HeightPicture {
    /// The node of column 0 and row 0, mm.
    pub origin: [f64; 2],
    /// Distance between neighbouring nodes, mm.
    pub step: f64,
    /// Nodes along x.
    pub columns: usize,
    /// Nodes along y.
    pub rows: usize,
    /// Height of each node towards the laser, mm, row by row from the lowest y; `None` where there is no surface.
    pub heights: Vec<Option<f64>>,
    /// Signed residual of the fitted surface at each node, mm, in the order of the heights; empty if not known.
    pub residuals: Vec<f64>,
    /// Residuals beyond this are shown, mm.
    pub residual_limit: f64,
}

/// A line of the picture: in the view (two coordinates), or on the part (three).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PreviewPath<const AXES: usize = 2> {
    /// Its points, mm; a single one is a dot, and a contour does not repeat the first.
    pub points: Vec<[f64; AXES]>,
    /// Whether the line returns to its first point.
    pub closed: bool,
    /// Stretch of each segment: length on the part divided by length in the drawing, minus 1. Segments without a finite
    /// stretch are shown as not measured.
    pub stretch: Vec<f64>,
}

/// The cell of a square grid that contains a point, for joining points that a picture cannot resolve.
fn grid_cell<const AXES: usize>(point: [f64; AXES], size: f64) -> [i64; AXES] {
    point.map(|coordinate| (coordinate / size).floor() as i64)
}
