//! What entities draw, and what is at hand while they are read.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;

use super::curves::{Curve, Placement};
use super::scan::Scan;
use super::structure::{RecordColor, Structure};
use super::text::font::FontUses;

/// What an entity draws.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Item {
    /// A single spot.
    Dot(Vector3<f64>),
    /// A line or contour.
    Curve(Curve),
    /// Contours that bound one filled region.
    Fill(Vec<Curve>),
    /// Dots, curves and fills, some in colours of their own.
    Several(Vec<(Option<RecordColor>, Item)>),
    /// A block.
    Insert(Box<Insert>),
    /// What attributes of a block are to look like; draws nothing itself.
    Template,
    /// Nothing, as it would anywhere, with the reason.
    DrawsNothing(&'static str),
    /// Nothing here, although it draws lines that are an aid and no ink, with the reason.
    Construction(&'static str),
    /// Nothing here, although it draws ink, with the reason.
    Skipped(Cow<'static, str>),
}

impl Item {
    /// The item where the placement puts it.
    pub(super) fn placed(self, placement: &Placement) -> Self {
        let placed = |contour: Curve| contour.placed(placement);
        match self {
            Self::Dot(point) => Self::Dot(placement.point(point)),
            Self::Curve(curve) => Self::Curve(placed(curve)),
            Self::Fill(contours) => Self::Fill(contours.into_iter().map(placed).collect()),
            Self::Several(items) => Self::Several(
                items.into_iter().map(|(color, item)| (color, item.placed(placement))).collect(),
            ),
            Self::Insert(mut insert) => {
                insert.placement = placement.after(&insert.placement);
                Self::Insert(insert)
            }
            Self::Template | Self::DrawsNothing(_) | Self::Construction(_) | Self::Skipped(_) => self,
        }
    }
}

/// A block put somewhere, once or in rows and columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Insert {
    pub(super) block: String,
    /// From the block's space, base point at the origin, to the space that holds the insert.
    pub(super) placement: Placement,
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) column_step: Vector3<f64>,
    pub(super) row_step: Vector3<f64>,
}

/// What is read beside the curves themselves.
#[derive(Default)]
pub(super) struct Remarks {
    /// Texts by their position in the inventory, with the fonts that stand in for those they ask for.
    pub(super) texts: BTreeMap<usize, FontUses>,
    /// Whether entities are left as they are.
    pub(super) strict: bool,
    /// Polylines with a width, by their position in the inventory.
    pub(super) wide: BTreeSet<usize>,
    /// Polylines with the point that the old FreeCAD exporter puts in front, by their position in the inventory; it is
    /// taken out unless the drawing is read strictly.
    pub(super) extra_vertices: Vec<usize>,
}

/// Reads entities. Pieces of splines of high degree stay within `tolerance`, in units of the drawing.
pub(super) struct Reader<'r> {
    pub(super) scan: &'r Scan<'r>,
    pub(super) structure: &'r Structure,
    pub(super) tolerance: f64,
}
