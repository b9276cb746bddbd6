//! What entities draw, and the data for reading them.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;

use super::super::content::{Content, FoundField};
use super::super::font::FontUses;
use super::curves::{Curve, Placement};
use super::scan::Scan;
use super::structure::{RecordColor, Structure};

/// What an entity draws.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Item {
    /// A single spot.
    Dot(Vector3<f64>),
    /// A background that hides what is drawn before it: the corners of a rectangle in circular order.
    Mask([Vector3<f64>; 4]),
    /// A line or contour.
    Curve(Curve),
    /// Contours that bound one filled region.
    Fill(Vec<Curve>),
    /// A line with a width: the line, the contours of the area that it covers, and its largest width.
    Wide(Box<WideLine>),
    /// Dots, curves and fills; some have another colour than the entity.
    Several(Vec<(Option<RecordColor>, Item)>),
    /// A block.
    Insert(Box<Insert>),
    /// The template of a block's attributes; it draws nothing.
    Template,
    /// An entity that draws nothing in any program, with the reason.
    DrawsNothing(&'static str),
    /// Skipped construction lines and what the drawing does not show, which are not ink, with the reason.
    Unseen(&'static str),
    /// Skipped ink, with the reason.
    Skipped(Cow<'static, str>),
}

impl Item {
    /// The item, transformed by the placement.
    pub(super) fn placed(self, placement: &Placement) -> Self {
        let placed = |contour: Curve| contour.placed(placement);
        match self {
            Self::Dot(point) => Self::Dot(placement.point(point)),
            Self::Mask(corners) => Self::Mask(corners.map(|corner| placement.point(corner))),
            Self::Curve(curve) => Self::Curve(placed(curve)),
            Self::Fill(contours) => Self::Fill(contours.into_iter().map(placed).collect()),
            Self::Wide(line) => Self::Wide(Box::new(WideLine {
                centre: placed(line.centre),
                area: line.area.into_iter().map(placed).collect(),
                width: line.width * placement.largest_scale(),
            })),
            Self::Several(items) => Self::Several(
                items.into_iter().map(|(color, item)| (color, item.placed(placement))).collect(),
            ),
            Self::Insert(mut insert) => {
                insert.placement = placement.after(&insert.placement);
                Self::Insert(insert)
            }
            Self::Template | Self::DrawsNothing(_) | Self::Unseen(_) | Self::Skipped(_) => self,
        }
    }
}

/// A line with a width.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct WideLine {
    pub(super) centre: Curve,
    /// The contours of the area that it covers.
    pub(super) area: Vec<Curve>,
    /// The largest width.
    pub(super) width: f64,
}

/// A reference to a block, once or in rows and columns.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Insert {
    pub(super) block: String,
    /// From the block's space, with the base point at the origin, to the space that contains the insert.
    pub(super) placement: Placement,
    pub(super) grid: Grid,
}

/// The copies of a block reference and its attributes, in rows and columns; the steps are in the space that contains the insert.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) column_step: Vector3<f64>,
    pub(super) row_step: Vector3<f64>,
}

impl Grid {
    /// A single copy.
    pub(super) fn single() -> Self {
        Self { columns: 1, rows: 1, column_step: Vector3::zeros(), row_step: Vector3::zeros() }
    }

    /// Number of copies.
    pub(super) fn copies(&self) -> usize {
        self.columns.saturating_mul(self.rows)
    }

    /// The distance of a copy from the first one, by its number from 0, row by row.
    pub(super) fn shift(&self, copy: usize) -> Vector3<f64> {
        let (row, column) = (copy / self.columns, copy % self.columns);
        self.column_step * column as f64 + self.row_step * row as f64
    }
}

/// What was noticed while reading entities, for notices.
#[derive(Default)]
pub(super) struct Remarks {
    /// Texts by their position in the inventory, with the fonts that replace missing ones.
    pub(super) texts: BTreeMap<usize, FontUses>,
    /// Fields in texts by the position of the text in the inventory.
    pub(super) fields: BTreeMap<usize, Vec<FoundField>>,
    /// Whether entities are read without repairs.
    pub(super) strict: bool,
    /// Hatches with a gradient, by their position in the inventory.
    pub(super) gradients: BTreeSet<usize>,
    /// Polylines with a width, by their position in the inventory.
    pub(super) wide: BTreeSet<usize>,
    /// Polylines with the extra first point of the old FreeCAD exporter, by their position in the inventory. The point
    /// is removed unless `strict` is set.
    pub(super) extra_vertices: Vec<usize>,
}

/// Reads entities. Splines of high degree are approximated within `tolerance`, in units of the drawing.
pub(super) struct Reader<'r> {
    pub(super) scan: &'r Scan<'r>,
    pub(super) structure: &'r Structure,
    pub(super) tolerance: f64,
    /// The values of fields in texts.
    pub(super) content: Option<&'r Content>,
}
