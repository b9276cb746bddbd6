//! Names of layers.

use std::collections::BTreeSet;

/// Whether two names are the same layer's: DXF compares them without regard to case.
pub(crate) fn is_same_layer(one: &str, other: &str) -> bool {
    one.to_lowercase() == other.to_lowercase()
}

/// Whether a layer is one of those; `None` stands for all.
pub(crate) fn is_among(names: Option<&[String]>, layer: &str) -> bool {
    names.is_none_or(|names| names.iter().any(|name| is_same_layer(name, layer)))
}

/// `base`, or the first of `base-2`, `base-3` and so on that no layer has yet. `used` are the names of the others in lower case, to
/// which this one is added.
pub(crate) fn unused_name(base: &str, used: &mut BTreeSet<String>) -> String {
    let mut name = base.to_owned();
    let mut number = 2;
    while !used.insert(name.to_lowercase()) {
        name = format!("{base}-{number}");
        number += 1;
    }
    name
}
