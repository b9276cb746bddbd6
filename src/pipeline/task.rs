//! Fitting a part for another computer.

use super::learning::identified;
use super::{Pipeline, PipelineError};
use crate::cache::{FitTask, KeptBytes};
use crate::config::Sku;

impl Pipeline {
    /// Fits the part of a [`FitTask`] in its form as bytes, and gives the surface as bytes for the other computer's cache. That one
    /// expects a part with the hash `part` and the surface with this `key` of its cache. Neither a cache nor other stations are used.
    ///
    /// # Errors
    /// Why there is no such surface.
    pub fn fit_task(&self, sku: &Sku, task: &[u8], part: &str, key: &str) -> Result<KeptBytes, String> {
        let task = FitTask::from_bytes(task)?;
        let (origin, _) = identified(&task.part);
        if origin.blake3 != part {
            return Err("its part is another one".into());
        }
        let alone = Self { cache: None, fit: self.fit, ..Self::new(None) };
        if alone.key_of(&task.part, origin, &task.settings).is_none_or(|made| made.as_str() != key) {
            return Err("its fit has another key here".into());
        }
        let learned = alone.learn(sku, &task.part, &task.settings).map_err(|error| match error {
            PipelineError::Rejected(reason) => reason.what,
            error => error.to_string(),
        })?;
        KeptBytes::of(&learned.kept, learned.mesh.as_ref()).map_err(|error| error.to_string())
    }
}
