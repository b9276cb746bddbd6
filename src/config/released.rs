//! Settings of SKUs that are released elsewhere and written into the SKU files of a station.

use std::fmt::Debug;
use std::path::Path;

use super::sku::Sku;

/// Released settings of SKUs, and what a station uses when somebody changes one of their files.
pub trait ReleasedSettings: Debug + Send + Sync {
    /// Whether the text of a SKU's file was written completely, so that nobody is still writing it.
    fn is_whole(&self, text: &str) -> bool;

    /// The text that is used in place of the one in the SKU's file, if that must not be used. `found` is the file with its text;
    /// `None` if there is no file.
    fn instead(&self, sku: &Sku, found: Option<(&Path, &str)>) -> Option<String>;
}
