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
//!
//! # A drop in memory
//!
//! The dispatcher owns every drop and moves it from state to state; `settle` and `Drops::ready` only say what is due, and
//! a job only returns its outcome.
//!
//! ```text
//!  listed, heard of ──▶ Verdict::Wait ──its time comes, or a change is seen──▶ Verdict::Read, or Verdict::GiveUp
//!                           ▲                                                       │ Block::Free, and a thread is free
//!   changed, or lacks       │                                                       ▼
//!   something: Block::Free  └───────────────────────────────────────────────── at work: one thread, one Task
//!                                                                                   │ Outcome
//!   Block::Until, UnknownSku, PartUnderWay, Unclaimed ◀──── not now ────────────────┤
//!        └── until what it waits for comes, then Block::Free                        ▼
//!                                                                              done: forgotten
//! ```
//!
//! | a drop is | until |
//! |---|---|
//! | `Block::Free` | it is due; then a thread takes it |
//! | `Block::Until` | the pause is over: an `Obstacle` is in the way, which is `Obstacle::RefusedPart`, `Obstacle::NoImportFolder`, `Obstacle::SettingsBeingSaved` or `Obstacle::Other` |
//! | `Block::UnknownSku` | its SKU has a surface |
//! | `Block::PartUnderWay` | no part of its SKU lies in the hot folder |
//! | `Block::Unclaimed` | a part or pattern takes it along |
//!
//! | a job ends with | and its drop |
//! |---|---|
//! | `Outcome::Learned`, `Outcome::Delivered`, `Outcome::Uncertain`, `Outcome::Repeated`, `Outcome::Rejected` | is done |
//! | `Outcome::Changed` | is looked at again, as it is now |
//! | `Outcome::Incomplete` | is `Block::Free` and settles again |
//! | `Outcome::TakesLong` | is `Block::Free` and waits for its turn among the large ones |
//! | `Outcome::NoSurface` | is `Block::UnknownSku` |
//! | `Outcome::PartCame` | is `Block::PartUnderWay` |
//! | `Outcome::PartRefused`, `Outcome::NoImportFolder`, `Outcome::Retry` | is `Block::Until` |
//! | `Outcome::Stop` | stays, and the station ends |
//!
//! # A job on the disk
//!
//! The journal's lines are its steps, written by the job that takes them; between two of them the program may end.
//!
//! ```text
//!              delivering                  delivered                filing                done, learned
//!  nothing ──────────────▶ Stage::Renaming ─────────▶ Stage::Delivered ────▶ Stage::Filing ──────────▶ nothing
//!     │                        │ cancelled               │ cancelled             ▲
//!     │                        ▼                         ▼                       │
//!     │                     nothing                   nothing                    │
//!     └───────── a part, or a drawing that is not delivered again ───────────────┘
//! ```
//!
//! | at | the disk holds |
//! |---|---|
//! | `Stage::Renaming` | the drawing, checked and flushed in the import folder under a temporary name, or already under its own |
//! | `Stage::Delivered` | the drawing in the import folder, unless an importer took it; the original in the hot folder |
//! | `Stage::Filing` | the original in the hot folder, or in the archive, or in both; the report is written |
//!
//! # After an interruption
//!
//! One pure function, `after_a_crash`, decides from the stage and from what is found how a job goes on. It is asked by the
//! job itself when its drop is still there, and by the listing when the drop is gone.
//!
//! | it answers | which means |
//! |---|---|
//! | `Resume::Wait` | a folder is another one than it was: nothing is done yet |
//! | `Resume::Redo` | not delivered: the job is cancelled, and a drop that is there is done from its start |
//! | `Resume::Finish` | delivered: what follows is done |
//! | `Resume::Refile` | a part: it is learned again, and its original filed where it was to go |
//! | `Resume::NoteDrawing`, `Resume::NotePart` | all was done but the last line |

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

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    /// The variants of an enum, as its source has them.
    fn variants(source: &str, name: &str) -> BTreeSet<String> {
        let body = source.split_once(&format!("enum {name} {{\n")).unwrap().1.split_once("\n}").unwrap().0;
        let lines = body.lines().filter_map(|line| line.strip_prefix("    "));
        let words = lines.filter(|line| line.starts_with(|first: char| first.is_ascii_uppercase()));
        words.map(|line| line.split(|c: char| !c.is_alphanumeric()).next().unwrap().to_owned()).collect()
    }

    #[test]
    fn the_page_names_every_state_and_no_other() {
        let source = include_str!("mod.rs");
        let page: String = source.lines().filter_map(|line| line.strip_prefix("//!")).collect();
        for (source, name) in [
            (include_str!("seen/settle.rs"), "Verdict"),
            (include_str!("seen/drops.rs"), "Block"),
            (include_str!("seen/drops.rs"), "Obstacle"),
            (include_str!("jobs/task.rs"), "Outcome"),
            (include_str!("state/journal/stage.rs"), "Stage"),
            (include_str!("jobs/resume.rs"), "Resume"),
        ] {
            let prefix = format!("{name}::");
            let named = page.split(&prefix).skip(1);
            let named =
                named.map(|rest| rest.split(|c: char| !c.is_alphanumeric()).next().unwrap().to_owned());
            assert_eq!(named.collect::<BTreeSet<_>>(), variants(source, name), "{name}");
        }
    }
}
