//! A drawing that was placed and mapped, as the pictures need it.

use std::sync::Arc;

use nalgebra::Point3;

use crate::config::Sku;
use crate::geometry::correction::Projection;
use crate::geometry::mapping::LengthTrueMap;
use crate::geometry::optics::{Fixture, ScanHead};
use crate::geometry::pattern::Pattern;
use crate::geometry::picture_mesh::PictureMesh;
use crate::geometry::space::{Extents, FlatPoint};
use crate::geometry::surface::fit::FittedSurface;
use crate::preview::PartSource;

/// A placed drawing and its map. The picture on the part is made from it, after the drawing was delivered.
#[derive(Debug, Clone, PartialEq)]
pub struct Marked {
    pub(super) sku: Sku,
    pub(super) drawing: String,
    /// The placed paths on ink layers.
    pub(super) ink: Pattern,
    /// The lines of its fill that pictures show.
    pub(super) fill: Pattern,
    pub(super) map: LengthTrueMap,
    pub(super) fixture: Fixture,
    pub(super) head: ScanHead,
    /// The surface round the drawing, if it has smaller spans there than that of the whole part.
    pub(super) surface: Option<Arc<FittedSurface>>,
    /// For each path of the corrected drawing, the points of the placed drawing that its points mark.
    pub(super) drawn: Vec<Vec<FlatPoint>>,
    /// Whether the mark goes round the part, which turns; then the ink is the drawing before it was divided.
    pub(super) is_round: bool,
    /// Length of all lines as drawn, mm.
    pub(super) length: f64,
    pub(super) drawn_range: Option<[f64; 2]>,
    pub(super) mark_range: [f64; 2],
}

impl Marked {
    /// Whether another drawing makes the same mark, under any file name.
    pub(super) fn is_same_mark(&self, other: &Self) -> bool {
        let Self {
            sku,
            drawing: _,
            ink,
            fill,
            map,
            fixture,
            head,
            // It follows from the part and the drawing.
            surface: _,
            drawn,
            is_round,
            length,
            drawn_range,
            mark_range,
        } = self;
        (sku, is_round, length, drawn_range, mark_range)
            == (&other.sku, &other.is_round, &other.length, &other.drawn_range, &other.mark_range)
            && (ink, fill, map, drawn) == (&other.ink, &other.fill, &other.map, &other.drawn)
            && (fixture, head) == (&other.fixture, &other.head)
    }

    /// The surface under the mark, given that of the whole part.
    pub(super) fn surface<'a>(&'a self, whole: &'a FittedSurface) -> &'a FittedSurface {
        self.surface.as_deref().unwrap_or(whole)
    }

    /// How the drawing comes onto this surface of the part.
    pub(super) fn projection<'a>(&'a self, surface: &'a FittedSurface) -> Projection<'a> {
        Projection { map: &self.map, surface, fixture: self.fixture, head: self.head }
    }

    /// The rectangle of the view with all corners of the drawing, as drawn and as mapped.
    pub(super) fn area(&self) -> Extents {
        let corners = self.ink.paths.iter().flat_map(|path| path.shape.flattened(1.0));
        Extents::of(corners.flat_map(|at| [at.coords(), self.map.point(at).coords()]))
    }
}

/// A part as it is under all drawings of one area.
#[derive(Debug)]
pub(super) struct DrawnPart {
    pub(super) source: PartSource,
    pub(super) mesh: Arc<PictureMesh>,
    pub(super) is_thinned: bool,
    pub(super) rims: Arc<Vec<Vec<Point3<f64>>>>,
    /// Whether it is drawn from all that can be known of the part: its mesh may still arrive from another station.
    pub(super) is_final: bool,
}
