//! The jobs: each is a sequence of steps, from reading a drop to filing its original.

mod task;
pub(crate) mod basis;
pub(crate) mod filing;
pub(crate) mod rejected;
mod retention;
mod intake;
mod resume;
mod delivery;
pub(crate) mod recovery;
mod restoring;
mod executor;
mod standing;
mod surfaces;
mod finish;
mod correct;
mod serials;
mod list;
mod hand_over;
mod outdated;

pub(crate) use basis::is_comparable;
pub(crate) use executor::Executor;
pub(crate) use outdated::{Recorrection, Reprocessing, Searched};
pub(crate) use retention::Keeper;
pub(crate) use task::{EarlyEnd, End, Outcome, Read, Task, Unfiled, Work};
