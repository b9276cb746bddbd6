//! The identity of a job: the place of its original.

use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::config::Sku;

/// The prefix of archived originals.
const ARCHIVE: &str = "archive:";

/// The place of a job's original; written as text by [`fmt::Display`].
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub(crate) enum DropId {
    /// In the hot folder: its path there, with `/`.
    Hot(String),
    /// In the archive, to be corrected again: the key of its SKU, and its path in the SKU's folder, with `/`.
    Archived { sku: String, place: String },
}

impl DropId {
    /// A drop, by its path in the hot folder.
    pub(crate) fn hot(relative: &Path) -> Self {
        Self::Hot(with_slashes(relative))
    }

    /// An original in the SKU's folder of the archive.
    pub(crate) fn archived(sku: &Sku, place: &str) -> Self {
        Self::Archived { sku: sku.key().into(), place: place.into() }
    }

    pub(crate) fn is_archived(&self) -> bool {
        matches!(self, Self::Archived { .. })
    }

    /// The name of the file.
    pub(crate) fn file_name(&self) -> &str {
        let (Self::Hot(path) | Self::Archived { place: path, .. }) = self;
        path.rsplit('/').next().unwrap_or(path)
    }
}

impl fmt::Display for DropId {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hot(path) => out.write_str(path),
            Self::Archived { sku, place } => write!(out, "{ARCHIVE}{sku}/{place}"),
        }
    }
}

impl From<String> for DropId {
    fn from(text: String) -> Self {
        match text.strip_prefix(ARCHIVE).and_then(|place| place.split_once('/')) {
            Some((sku, place)) => Self::Archived { sku: sku.into(), place: place.into() },
            None => Self::Hot(text),
        }
    }
}

impl From<DropId> for String {
    fn from(drop: DropId) -> Self {
        drop.to_string()
    }
}

/// A relative path with `/`, in the form used in messages and files.
pub(crate) fn with_slashes(relative: &Path) -> String {
    let parts: Vec<_> = relative.components().map(|part| part.as_os_str().to_string_lossy()).collect();
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drop_id_survives_writing_and_reading() {
        let sku: Sku = "Can 5".parse().unwrap();
        for (drop, text, name) in [
            (DropId::hot(Path::new("can@a.dxf")), "can@a.dxf", "can@a.dxf"),
            (DropId::hot(&Path::new("can").join("a.dxf")), "can/a.dxf", "a.dxf"),
            (DropId::archived(&sku, "can 5.dxf"), "archive:can 5/can 5.dxf", "can 5.dxf"),
            (DropId::archived(&sku, "(2)/can 5.dxf"), "archive:can 5/(2)/can 5.dxf", "can 5.dxf"),
        ] {
            assert_eq!((drop.to_string().as_str(), drop.file_name()), (text, name));
            assert_eq!(DropId::from(text.to_owned()), drop);
        }
    }
}
