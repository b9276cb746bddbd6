//! What the settings say of a part file.

use super::{LengthUnit, UpAxis};
use crate::formats::Pace;

/// What the settings say of a part file; `None` leaves it to the file.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MeshOptions {
    /// Unit of the file's numbers.
    pub unit: Option<LengthUnit>,
    /// Axis of the file that points up.
    pub up: Option<UpAxis>,
    /// How long reading and fitting may take.
    pub pace: Pace,
}
