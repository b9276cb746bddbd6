//! Drawings to be marked: DXF bytes to a [`Pattern`](crate::geometry::pattern::Pattern) in mm and back.
//!
//! Read widely, write narrowly, drop nothing silently: what cannot be taken over is named in [`PatternFacts`].

mod dxf;

pub use dxf::write::{DxfProfile, write};
