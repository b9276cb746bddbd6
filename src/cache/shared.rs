//! What a cache shares with those of other stations.

use std::fmt;
use std::io;
use std::sync::Arc;

use super::{Cache, CacheKey, CurrentPart, PartOrigin};
use crate::config::Sku;

/// Surfaces and current parts that stations share. Only [`fetch`](Self::fetch) and [`have_made`](Self::have_made) wait, and
/// only for a limited time.
pub trait SharedSurfaces: Send + Sync {
    /// Takes the surface of a part from others into the cache; returns whether the cache has it now.
    fn fetch(&self, cache: &Cache, sku: &Sku, key: &CacheKey, part: &PartOrigin) -> bool;

    /// Asks for the same without waiting.
    fn wish(&self, cache: &Cache, sku: &Sku, key: &CacheKey, part: &PartOrigin);

    /// Has others make the surface of a part; `task` is what they need ([`FitTask`](super::FitTask)). Returns whether the cache has
    /// it now; otherwise it is to be made here.
    fn have_made(
        &self,
        cache: &Cache,
        sku: &Sku,
        key: &CacheKey,
        part: &PartOrigin,
        task: &dyn Fn() -> Option<Vec<u8>>,
    ) -> bool;

    /// Offers a surface that the cache has.
    fn offer(&self, sku: &Sku, key: &CacheKey, part: &PartOrigin);

    /// Makes a learned part the SKU's current one in the cache, and announces it.
    ///
    /// # Errors
    /// When the announcement cannot be kept for later, or the cache cannot be written to.
    fn make_current(&self, cache: &Cache, sku: &Sku, part: &CurrentPart) -> io::Result<()>;
}

/// The others that a pipeline shares its surfaces with, if any.
#[derive(Clone, Default)]
pub(crate) struct Shared(pub(crate) Option<Arc<dyn SharedSurfaces>>);

impl fmt::Debug for Shared {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(if self.0.is_some() { "Shared" } else { "Alone" })
    }
}
