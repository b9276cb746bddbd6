//! Why a scan gives no surface.

use crate::geometry::normal_equations::SolveError;

/// Why a scan gives no surface.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ScanError {
    /// There are too few points.
    #[error("only {points} points of the scan face the laser; a surface needs {needed}")]
    TooFewPoints {
        /// Number of points.
        points: usize,
        /// Minimum number of points.
        needed: usize,
    },
    /// All points are in one place or in one line, as the laser sees them.
    #[error("all points of the scan are in a strip of {width:.1} x {length:.1} mm, as the laser sees them")]
    NoArea {
        /// Width of the strip, mm.
        width: f64,
        /// Its length, mm.
        length: f64,
    },
    /// No points are connected.
    #[error(
        "the {points} points of the scan form no surface: the height jumps between neighbouring points everywhere"
    )]
    NoSurface {
        /// Number of points.
        points: usize,
    },
    /// The equations could not be solved.
    #[error(transparent)]
    Solve(#[from] SolveError),
}
