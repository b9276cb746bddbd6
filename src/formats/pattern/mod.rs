//! Drawings to be marked: DXF bytes to a [`Pattern`] in mm and corrected drawings back to bytes.
//!
//! Read widely, write narrowly, drop nothing silently: what cannot be taken over is named in [`PatternFacts`].

mod dxf;
mod error;
mod facts;
mod units;

pub use dxf::scan::is_complete;
pub use dxf::write::{DxfProfile, write};
pub use error::{EntityName, PatternReadError, Spot};
pub use facts::{LayerFacts, NotTaken, PatternFacts};
pub use units::{DrawingUnit, UnknownUnit};

use crate::geometry::pattern::Pattern;

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
}

impl Default for PatternOptions {
    fn default() -> Self {
        Self { unit_if_unitless: None, unit: None, joining_tolerance: 0.002 }
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

/// Reads a DXF drawing, text or binary.
///
/// # Errors
/// The bytes are no whole DXF file, a number is unreadable, the drawing unfolds to too much, or nothing in it can be
/// marked.
pub fn read(bytes: &[u8], options: &PatternOptions) -> Result<PatternReading, PatternReadError> {
    dxf::read(bytes, options)
}
