//! The hot folder: drops in, corrected drawings out, and a reason for everything that cannot be done.
//!
//! ```text
//! hot/ ──listing + events──▶ settle ──whole files──▶ job ──┬▶ import/<pattern's name>, original to archive/<sku>/
//!                                                          ├▶ rejected/, with <name>.reason.json and .reason.txt
//!                                                          └▶ stays in hot/: waits for its part, or for a folder
//! ```
//!
//! The listing of the folder is the truth, events only make it quick. A drop stays in the hot folder until its result
//! lies in the import folder; `journal` remembers what cannot be taken back, so that after any interruption the job
//! goes on where it was and nothing is delivered twice.
//!
//! What a file name means is said in [`names`], when a file is whole in [`settle`], what a job needs from the rest of
//! the program in [`Corrector`], what lies where afterwards in `filing`, what a writer may still change in `parked`, who
//! does what when in `worker` and `executor`.

pub mod names;
pub mod settle;
mod clock;
mod holder;
mod lock;
mod job;
mod watcher;
mod folders;
mod parked;
mod filing;
mod drop_id;
mod journal;
mod resume;
mod basis;
mod drops;
mod error;
mod task;
mod intake;
mod delivery;
mod recovery;
mod beamserver;
mod executor;
mod reprocess;
mod requests;
mod rejected;
mod retention;
mod shares;
mod worker;
pub mod status;
mod corrector;

pub use corrector::PipelineCorrector;
pub use error::StationError;
pub(crate) use folders::lies_at;
pub use holder::Holder;
pub use job::{
    Check, Companion, Completeness, Corrector, Delivery, DroppedFile, JobError, Mode, PartLearned, Pulse,
    ReadBack, Sketch, Tally, Waiting, WaitsFor,
};
pub use lock::StationLock;
pub use names::CURRENT_PART;
pub use rejected::{AS_ITS_USER, count_rejected, is_rejected, return_rejected};
pub use requests::Request;
pub use watcher::StopSignal;
pub use worker::run;
