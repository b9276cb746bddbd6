//! How noise is taken out of a scan.

/// How noise is taken out of a scan.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Smoothing {
    /// As much as generalised cross validation finds in the points themselves.
    #[default]
    Auto,
    /// Waves of this length are halved, shorter ones are taken out.
    LowPass {
        /// The wavelength, mm.
        wavelength: f64,
    },
    /// Not at all: the surface follows the points. Outliers are dropped nevertheless.
    None,
}

impl Smoothing {
    /// The wavelength of the thesis' filter, mm: a quarter of the Nyquist frequency of points 2 mm apart.
    pub const THESIS_WAVELENGTH: f64 = 16.0;

    pub(super) fn follows_the_points(self) -> bool {
        !matches!(self, Self::LowPass { .. })
    }
}
