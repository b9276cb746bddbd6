//! Names of layers.

/// Whether two names are the same layer's: DXF compares them without regard to case.
pub(crate) fn is_same_layer(one: &str, other: &str) -> bool {
    one.to_lowercase() == other.to_lowercase()
}
