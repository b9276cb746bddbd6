//! Bytes to values and back; the only place that names a format crate. Nothing here opens a file.

/// How long reading may take.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Pace {
    /// Some tenths of a second: what turns out to be more work is refused as soon as that shows.
    Quick,
    /// As long as it takes.
    #[default]
    Any,
}

impl Pace {
    /// Whether so much work may be done where a moment is enough for `moment` of it.
    pub fn allows(self, work: usize, moment: usize) -> bool {
        self == Self::Any || work <= moment
    }
}

pub mod mesh;
pub mod pattern;
pub mod surface;
