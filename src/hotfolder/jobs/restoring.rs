//! Lets only one thread at a time restore the surface of a SKU, while others correct its drawings.

use std::collections::BTreeSet;
use std::sync::{Condvar, Mutex, PoisonError};

use crate::config::Sku;
use crate::formats::Pace;
use crate::hotfolder::api::JobError;

/// The SKUs whose surface a thread is restoring.
#[derive(Default)]
pub(super) struct Restoring {
    skus: Mutex<BTreeSet<Sku>>,
    over: Condvar,
}

/// The right to restore the surface of the SKU, until it is dropped.
pub(super) struct Claim<'r> {
    restoring: &'r Restoring,
    sku: &'r Sku,
}

impl Restoring {
    /// Waits until no other thread restores the surface of the SKU.
    ///
    /// # Errors
    /// [`JobError::TakesLong`] for a quick job that would have to wait: it must not block a thread.
    pub(super) fn claim<'r>(&'r self, sku: &'r Sku, pace: Pace) -> Result<Claim<'r>, JobError> {
        let skus = self.skus.lock().unwrap_or_else(PoisonError::into_inner);
        if pace == Pace::Quick && skus.contains(sku) {
            return Err(JobError::TakesLong);
        }
        let is_claimed = |skus: &mut BTreeSet<Sku>| skus.contains(sku);
        self.over.wait_while(skus, is_claimed).unwrap_or_else(PoisonError::into_inner).insert(sku.clone());
        Ok(Claim { restoring: self, sku })
    }
}

impl Drop for Claim<'_> {
    fn drop(&mut self) {
        self.restoring.skus.lock().unwrap_or_else(PoisonError::into_inner).remove(self.sku);
        self.restoring.over.notify_all();
    }
}
