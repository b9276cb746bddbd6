//! The hot folder: drops in, corrected drawings out, and a reason for everything that cannot be done.
//!
//! ```text
//! hot/ ──listing + events──▶ settle ──whole files──▶ job ──┬▶ import/<pattern's name>, original to archive/<sku>/
//!                                                          ├▶ rejected/, with <name>.reason.json and .reason.txt
//!                                                          └▶ stays in hot/: waits for its part, or for a folder
//! ```
//!
//! The listing of the folder is the truth, events only make it quick. A drop stays in the hot folder until its result
//! lies in the import folder; the journal remembers what cannot be taken back, so that after any interruption the job
//! goes on where it was and nothing is delivered twice.
//!
//! | room | holds |
//! |---|---|
//! | `seen` | what is there: [`names`], [`settle`], folders, the watcher, the drops |
//! | `jobs` | what is done, step by step, by threads that know one job each |
//! | `state` | what is remembered: the journal, the lock, [`status`], requests |
//! | `beamserver` | the marking software |
//! | `dispatcher` | the one thread that knows all drops and decides what is done next |

mod clock;
mod api;
mod error;
mod seen;
mod state;
mod beamserver;
mod jobs;
mod dispatcher;
mod pipeline_corrector;

pub use api::{
    Check, Companion, Completeness, Corrector, Delivery, DroppedFile, JobError, Mode, PartLearned, Pulse,
    ReadBack, Sketch, Tally, Waiting, WaitsFor,
};
pub use dispatcher::run;
pub use error::StationError;
pub use jobs::rejected::{AS_ITS_USER, count_rejected, is_rejected, return_rejected};
pub use pipeline_corrector::PipelineCorrector;
pub(crate) use seen::folders::lies_at;
pub use seen::names::{self, CURRENT_PART};
pub use seen::{StopSignal, settle};
pub use state::{Holder, Request, StationLock, status};
