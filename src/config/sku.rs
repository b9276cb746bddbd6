//! SKU names, checked once so that none leads out of the folders.

use std::cmp::Ordering;
use std::str::FromStr;

use unicode_normalization::UnicodeNormalization;

use crate::reason::Reason;

/// The name of a product.
///
/// It starts with a letter, a digit or `_`, contains no path separator, no `@` and nothing that some file system
/// forbids, and has at most 100 characters, so it is a plain file name everywhere. Two names that differ only in
/// case, or in how accents are composed, are the same SKU, because many file systems treat them as one name. The spelling is
/// kept for people; folders and comparisons use [`Sku::key`].
#[derive(Debug, Clone)]
pub struct Sku {
    name: String,
    key: String,
}

/// Why a text is not a SKU name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BadSku {
    /// Nothing is left before the extension or the `@`.
    #[error("the SKU name is empty")]
    Empty,
    /// More characters than file systems accept together with suffixes.
    #[error("the SKU name has {0} characters, more than {limit}", limit = Sku::LONGEST)]
    TooLong(usize),
    /// A first character that hides a file, looks like an option, or is used by isomark itself.
    #[error("the SKU name `{0}` does not start with a letter, a digit or `_`")]
    Start(String),
    /// A character that leads out of the folder or that some file system forbids.
    #[error("the SKU name `{name}` holds {character:?}")]
    Character {
        /// The name.
        name: String,
        /// The first forbidden character.
        character: char,
    },
    /// A dot or a space at the end, which Windows drops silently.
    #[error("the SKU name `{0}` ends in a dot or a space")]
    End(String),
    /// A device name of Windows, such as `CON` or `COM1`.
    #[error("the SKU name `{0}` is reserved by Windows")]
    Reserved(String),
}

impl Sku {
    /// The greatest number of characters in a name.
    pub const LONGEST: usize = 100;

    /// The name as it was first written.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.name
    }

    /// The name in lower case: equal for equal SKUs, and a safe file name.
    #[must_use]
    pub fn key(&self) -> &str {
        &self.key
    }
}

impl FromStr for Sku {
    type Err = BadSku;

    fn from_str(name: &str) -> Result<Self, BadSku> {
        let first = name.chars().next().ok_or(BadSku::Empty)?;
        let length = name.chars().count();
        if length > Self::LONGEST {
            return Err(BadSku::TooLong(length));
        }
        let forbidden = |c: &char| c.is_control() || r#"/\:*?"<>|@"#.contains(*c);
        if let Some(character) = name.chars().find(forbidden) {
            return Err(BadSku::Character { name: name.into(), character });
        }
        if !(first.is_alphanumeric() || first == '_') {
            return Err(BadSku::Start(name.into()));
        }
        if name.ends_with(['.', ' ']) {
            return Err(BadSku::End(name.into()));
        }
        if is_reserved_by_windows(name) {
            return Err(BadSku::Reserved(name.into()));
        }
        Ok(Self { key: fold(name), name: name.nfc().collect() })
    }
}

/// The name as file systems compare it that ignore case and how accents are composed: equal for names of the same file
/// there.
pub(crate) fn fold(name: &str) -> String {
    name.nfc().collect::<String>().to_lowercase()
}

/// Whether Windows opens a device under this name; it looks only at what precedes the first dot.
pub(crate) fn is_reserved_by_windows(name: &str) -> bool {
    let stem = name.split('.').next().unwrap_or(name).trim_end().to_uppercase();
    let numbered = |prefix: &str| {
        stem.strip_prefix(prefix).is_some_and(|rest| {
            let mut rest = rest.chars();
            matches!((rest.next(), rest.next()), (Some('0'..='9' | '¹' | '²' | '³'), None))
        })
    };
    ["CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"].contains(&stem.as_str())
        || numbered("COM")
        || numbered("LPT")
}

impl BadSku {
    /// The reason that people are shown.
    #[must_use]
    pub fn reason(&self) -> Reason {
        let remedy = "Rename it: a SKU starts with a letter, a digit or `_`, and has no / \\ : * ? \" < > | @, \
                      no dot or space at its end, at most 100 characters, and is not a Windows device name.";
        Reason::new("sku-name", format!("{self}."), remedy)
    }
}

impl std::fmt::Display for Sku {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(&self.name)
    }
}

impl PartialEq for Sku {
    fn eq(&self, other: &Self) -> bool {
        self.key == other.key
    }
}

impl Eq for Sku {}

impl PartialOrd for Sku {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Sku {
    fn cmp(&self, other: &Self) -> Ordering {
        self.key.cmp(&other.key)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_stay_in_their_folder() {
        for good in
            ["can-500", "Dose 5,0 l", "1.2.3", "_test", "çaydanlık", "COM", "COM10", "console", "a..b"]
        {
            assert_eq!(good.parse::<Sku>().unwrap().as_str(), good);
        }
        for (one, other) in [("CAN-500", "can-500"), ("T\u{fc}r", "t\u{75}\u{308}r")] {
            assert_eq!(one.parse::<Sku>().unwrap(), other.parse::<Sku>().unwrap());
        }
    }

    #[test]
    fn names_that_could_leave_it_or_vanish() {
        let long = "x".repeat(101);
        let bad = [
            "", ".", "..", "../x", "a/b", r"a\b", "C:", "a@b", "-x", "~x", "(2)", ".hidden", "x.", "x ",
            "con", "NUL.txt", "com1", "LPT9.a", "COM²", "a\0b", "a\nb", "what?", "*", &long,
        ];
        for name in bad {
            assert!(name.parse::<Sku>().is_err(), "{name:?}");
        }
    }
}
