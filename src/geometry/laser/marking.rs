//! The corrected drawing: points in field coordinates, ready for the marking software.

use crate::geometry::pattern::{Color, Layer};
use crate::geometry::space::{Extents, FieldPoint};

/// The drawing for the marking software, in field coordinates (mm).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MarkingDrawing {
    /// The layers that paths refer to by index.
    pub layers: Vec<Layer>,
    /// Everything to be marked, in drawing order.
    pub paths: Vec<MarkingPath>,
    /// Comment lines at the start of the file; they are not marked.
    pub comments: Vec<String>,
}

/// One connected thing to mark.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkingPath {
    /// Index into [`MarkingDrawing::layers`].
    pub layer: usize,
    /// The path's own colour.
    pub color: Color,
    /// What is drawn.
    pub shape: MarkingShape,
}

/// What a path draws, with straight lines from point to point; all coordinates are finite.
#[derive(Debug, Clone, PartialEq)]
pub enum MarkingShape {
    /// A single spot.
    Dot(FieldPoint),
    /// A line with two ends.
    Open(Vec<FieldPoint>),
    /// A contour; its last point is joined to its first, which is not repeated.
    Closed(Vec<FieldPoint>),
}

impl MarkingShape {
    /// The points in drawing order.
    pub fn points(&self) -> &[FieldPoint] {
        match self {
            Self::Dot(point) => std::slice::from_ref(point),
            Self::Open(points) | Self::Closed(points) => points,
        }
    }
}

impl MarkingDrawing {
    /// The bounding rectangle of everything drawn, mm; empty for an empty drawing.
    pub fn extents(&self) -> Extents {
        let points = self.paths.iter().flat_map(|path| path.shape.points());
        Extents::of(points.map(|point| point.coords()))
    }
}
