//! Why a scan gives no surface.

use crate::geometry::normal_equations::SolveError;

/// Why a scan gives no surface.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ScanError {
    /// There are too few points.
    #[error("the scan has {points} points that face the laser; a surface needs {needed}")]
    TooFewPoints {
        /// Number of points.
        points: usize,
        /// Fewest points of a surface.
        needed: usize,
    },
    /// The points lie in one place or in one line as the laser sees them.
    #[error("the points lie in a strip of {width} x {length} mm as the laser sees them")]
    NoArea {
        /// Width of the strip, mm.
        width: f64,
        /// Its length, mm.
        length: f64,
    },
    /// No points hang together.
    #[error("the {points} points of the scan form no surface: neighbours jump in height everywhere")]
    NoSurface {
        /// Number of points.
        points: usize,
    },
    /// The equations could not be solved.
    #[error(transparent)]
    Solve(#[from] SolveError),
}
