//! What the running station has recorded about jobs of others.

use std::collections::{BTreeMap, BTreeSet};

use crate::hotfolder::line::Claim;
use crate::hotfolder::state::DropId;

/// What is known about the jobs of others besides the journal.
#[derive(Default)]
pub(super) struct Arrivals {
    /// Jobs that are this station's, and whose names are taken.
    pub(super) confirmed: BTreeSet<Claim>,
    /// Drops whose jobs were taken over.
    pub(super) revoked: BTreeMap<DropId, Claim>,
    /// The leftovers of crashes were removed.
    pub(super) is_swept: bool,
}
