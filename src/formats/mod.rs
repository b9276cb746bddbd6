//! Bytes to values and back; the only place that names a format crate. Nothing here opens a file.

/// A limit on the time that reading may take.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Pace {
    /// A few tenths of a second. A file that needs more work is refused as soon as this is known.
    Quick,
    /// No limit.
    #[default]
    Any,
}

impl Pace {
    /// Whether this amount of work is allowed; [`Quick`](Self::Quick) allows at most `quick_limit`.
    #[must_use]
    pub fn allows(self, work: usize, quick_limit: usize) -> bool {
        self == Self::Any || work <= quick_limit
    }
}

pub mod mesh;
pub mod code;
pub mod list;
pub mod pattern;
pub mod surface;
pub mod scene;
pub mod measurements;
