//! Options for reading a picture.

/// Options for reading a picture; drawings in other formats do not need them.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct RasterOptions {
    /// Width of the whole picture or page, mm. Without it, the width follows from the height or else from the file's
    /// resolution.
    pub width: Option<f64>,
    /// Height of the whole picture or page, mm. Without it, the height follows from the width or else from the file's
    /// resolution.
    pub height: Option<f64>,
    /// Pixels darker than this are marked: 0 is black, 1 is white.
    pub threshold: f64,
    /// Marks the lighter pixels instead.
    pub inverted: bool,
}

impl Default for RasterOptions {
    fn default() -> Self {
        Self { width: None, height: None, threshold: 0.5, inverted: false }
    }
}

impl RasterOptions {
    /// The same with this width of the whole picture, mm.
    #[must_use]
    pub fn with_width(self, width: f64) -> Self {
        Self { width: Some(width), ..self }
    }

    /// The same with this height of the whole picture, mm.
    #[must_use]
    pub fn with_height(self, height: f64) -> Self {
        Self { height: Some(height), ..self }
    }
}
