//! How a picture is read.

/// How pictures are read; drawings in other formats have a size and ink of their own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RasterOptions {
    /// Width of the whole picture, mm. Without it, what the height or else the file's resolution gives.
    pub width: Option<f64>,
    /// Height of the whole picture, mm. Without it, what the width or else the file's resolution gives.
    pub height: Option<f64>,
    /// Pixels darker than this are marked: 0 is black, 1 is white.
    pub threshold: f64,
    /// Marks the pixels that are lighter instead.
    pub inverted: bool,
}

impl Default for RasterOptions {
    fn default() -> Self {
        Self { width: None, height: None, threshold: 0.5, inverted: false }
    }
}
