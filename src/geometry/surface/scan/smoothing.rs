//! How noise is removed from a scan.

/// How noise is removed from a scan.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Smoothing {
    /// Generalised cross-validation determines the smoothing from the points.
    #[default]
    Auto,
    /// Waves of this length are halved, shorter ones are removed.
    LowPass {
        /// The wavelength, mm.
        wavelength: f64,
    },
    /// No smoothing: the surface follows the points. Outliers are still dropped.
    None,
}

impl Smoothing {
    /// The wavelength of the thesis' filter, mm: a quarter of the Nyquist frequency of points 2 mm apart.
    pub const THESIS_WAVELENGTH: f64 = 16.0;

    pub(super) fn follows_the_points(self) -> bool {
        !matches!(self, Self::LowPass { .. })
    }
}
