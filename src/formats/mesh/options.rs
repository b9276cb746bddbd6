//! Settings for reading a part file.

use super::{LengthUnit, UpAxis};
use crate::formats::Pace;

/// Settings for reading a part file; with `None` the reader decides from the file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct MeshOptions {
    /// Unit of the file's numbers.
    pub unit: Option<LengthUnit>,
    /// Axis of the file that points up.
    pub up: Option<UpAxis>,
    /// The time limit for reading and fitting.
    pub pace: Pace,
}

impl MeshOptions {
    /// The same with this unit of the file's numbers.
    #[must_use]
    pub fn with_unit(self, unit: LengthUnit) -> Self {
        Self { unit: Some(unit), ..self }
    }

    /// The same with this axis of the file pointing up.
    #[must_use]
    pub fn with_up(self, up: UpAxis) -> Self {
        Self { up: Some(up), ..self }
    }
}
