//! Bytes to values and back; the only place that names a format crate. Nothing here opens a file.

pub mod mesh;
pub mod pattern;
pub mod surface;
