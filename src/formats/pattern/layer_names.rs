//! Names of layers.

/// Whether two names are the same layer's: DXF compares them without regard to case.
pub(crate) fn is_same_layer(one: &str, other: &str) -> bool {
    one.to_lowercase() == other.to_lowercase()
}

/// Whether a layer is one of those; `None` stands for all.
pub(crate) fn is_among(names: Option<&[String]>, layer: &str) -> bool {
    names.is_none_or(|names| names.iter().any(|name| is_same_layer(name, layer)))
}
