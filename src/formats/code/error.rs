//! Why there is no code of a content.

/// The separator of elements in GS1 codes.
pub(super) const SEPARATOR: u8 = 0x1d;

/// Why there is no code of a content.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CodeError {
    /// The content is empty.
    #[error("its content is empty")]
    Empty,
    /// The content is longer than the code holds.
    #[error("its content of {bytes} bytes is longer than a {kind} code holds")]
    TooLong {
        /// Its length, bytes.
        bytes: usize,
        /// The kind of code.
        kind: &'static str,
    },
    /// The code has no such character.
    #[error("a {kind} code has no character {character:?}")]
    Character {
        /// The character.
        character: char,
        /// The kind of code.
        kind: &'static str,
    },
    /// The content is not a row of GS1 elements.
    #[error("{0}")]
    Gs1(String),
}
