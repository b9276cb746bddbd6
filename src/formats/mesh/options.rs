//! Settings for reading a part file.

use super::{LengthUnit, UpAxis};
use crate::formats::Pace;

/// Settings for reading a part file; with `None` the reader decides from the file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MeshOptions {
    /// Unit of the file's numbers.
    pub unit: Option<LengthUnit>,
    /// Axis of the file that points up.
    pub up: Option<UpAxis>,
    /// The time limit for reading and fitting.
    pub pace: Pace,
}
