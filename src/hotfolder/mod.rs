//! The hot folder: drops go in, corrected drawings come out, and every drop that cannot be processed gets a reason.
//!
//! ```text
//! hot/ ──listing + events──▶ settle ──whole files──▶ job ──┬▶ import/<pattern's name>, original to archive/<sku>/
//!                                                          ├▶ rejected/, with <name>.reason.json and .reason.txt
//!                                                          └▶ stays in hot/, waiting for its part or for a folder
//! ```
//!
//! The listing of the folder decides; events only make the station react faster. A drop stays in the hot folder until
//! its result is in the import folder. The journal records the steps that cannot be undone, so after any interruption
//! the job continues where it stopped and nothing is delivered twice.
//!
//! | module | contains |
//! |---|---|
//! | `seen` | what is in the folders: [`names`], [`settle`], folders, the watcher, the drops |
//! | `jobs` | the work, step by step, in threads that know one job each |
//! | `state` | what the station remembers: the journal, the lock, [`status`], requests |
//! | `beamserver` | the client of the marking software |
//! | `page` | the page for browsers; a thread with a copy of each status |
//! | `dispatcher` | the one thread that knows all drops and decides what is processed next |
//!
//! # A drop in memory
//!
//! The dispatcher owns every drop and moves it from state to state. `settle` and `Drops::ready` only report what is
//! due, and a job only returns its outcome.
//!
//! ```text
//!  listed, or an event ─▶ Verdict::Wait ──its time is over, or it changes──▶ Verdict::Read, or Verdict::GiveUp
//!                           ▲                                                       │ Block::Free, and a thread is free
//!   changed, or             │                                                       ▼
//!   incomplete: Block::Free └───────────────────────────────────────────────── at work: one thread, one Task
//!                                                                                   │ Outcome
//!   Block::Until, UnknownSku, PartUnderWay, Unclaimed ◀──── not now ────────────────┤
//!        └── until the obstacle is removed, then Block::Free                        ▼
//!                                                                              done: forgotten
//! ```
//!
//! | a drop is | until |
//! |---|---|
//! | `Block::Free` | it is due; then a thread takes it |
//! | `Block::Until` | the pause after an `Obstacle` is over: `Obstacle::RefusedPart`, `Obstacle::NoImportFolder`, `Obstacle::SettingsBeingSaved` or `Obstacle::Other` |
//! | `Block::UnknownSku` | its SKU has a surface |
//! | `Block::PartUnderWay` | no part of its SKU is in the hot folder |
//! | `Block::Unclaimed` | a part or pattern takes it along |
//!
//! | a job ends with | and its drop |
//! |---|---|
//! | `Outcome::Learned`, `Outcome::Delivered`, `Outcome::Unchanged`, `Outcome::Resumed`, `Outcome::Uncertain`, `Outcome::Repeated`, `Outcome::Listed`, `Outcome::HandedOver`, `Outcome::Rejected` | is done |
//! | `Outcome::PicturesDue` | stays at work without a thread: the drawing is delivered, and pictures are drawn when no other drop can start |
//! | `Outcome::Restored` | is the part in the archive, which stays there: delivered drawings of its SKU are checked |
//! | `Outcome::Changed` | is checked again as a new file |
//! | `Outcome::Incomplete` | is `Block::Free` and settles again |
//! | `Outcome::TakesLong` | is `Block::Free` and waits for its turn among the large jobs |
//! | `Outcome::NoSurface` | is `Block::UnknownSku` |
//! | `Outcome::PartArrived` | is `Block::PartUnderWay` |
//! | `Outcome::PartRefused`, `Outcome::NoImportFolder`, `Outcome::Retry` | is `Block::Until` |
//! | `Outcome::Stop` | stays, and the station ends |
//!
//! # A job on the disk
//!
//! Each line of the journal is one step, written by the job that takes the step. The program may end between any two
//! steps.
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
//! | `Stage::Renaming` | the drawing, checked and flushed in the import folder, under a temporary name or already under its final name |
//! | `Stage::Delivered` | the drawing in the import folder, unless an importer took it; the original in the hot folder; perhaps the report, without its pictures |
//! | `Stage::Filing` | the original in the hot folder, in the archive, or in both; report and pictures are written |
//!
//! # Pictures
//!
//! While drops wait for a thread, a job delivers its drawing, writes the report, removes the pictures of an older drawing of that
//! name, and pauses. It is continued when no other drop can start, at the latest after half a minute, and before the station ends;
//! the number of paused jobs and the size of their drawings are limited. On the disk, a paused job is one that was interrupted at
//! `Stage::Delivered`: after a crash, its drawing is made again for report and pictures, and not delivered again.
//!
//! # A list of products
//!
//! A drawing with a list beside it is not corrected itself: a job divides it into one drop for each row, the drawing with the
//! row's values in its settings, and these are corrected like all others. The journal makes each row exactly one drop:
//!
//! ```text
//!         listing                   naming                                filing, listed
//!  nothing ─────▶ numbers reserved ──────▶ first drawings get their names ─────────────▶ nothing
//!                        ▲   hidden drawings flushed  │
//!                        └────── more rows ───────────┘
//! ```
//!
//! The reserved numbers are also noted in the archive before the first drawing gets its name, for the case that the journal is lost.
//! After a crash, a row whose `naming` is noted still has its hidden drawing, which then gets its name, or had it already. All other
//! rows are written again, with the same numbers and the same date.
//!
//! # A job for another line
//!
//! A drawing that a rule names is not corrected here: it goes into the queue of its line in the fleet, and one station of that line
//! takes it into its own hot folder. There it is a drop like all others. Between the two, the database decides which station has it.
//!
//! ```text
//! sender:  offering ──▶ in the queue, once ──▶ filing ──▶ handed-over
//! taker:   locked in the queue ──▶ hidden files flushed ──▶ arriving ──▶ taken in the queue ──▶ arrived ──▶ the files get their names
//! ```
//!
//! A hidden job becomes a drop only after the station knows that the queue has it as taken by this station, in this attempt. After a crash
//! or a cut it asks; if another station has the job, the hidden files are removed.
//!
//! # After an interruption
//!
//! One pure function, `after_a_crash`, decides how a job continues, from its stage and the files that are found. The
//! job itself calls it when its drop is still there, the listing when the drop was removed.
//!
//! | result | meaning |
//! |---|---|
//! | `Resume::Wait` | a folder was replaced by a different one: nothing is done yet |
//! | `Resume::Redo` | not delivered: the job is cancelled, and a drop that is still there is processed from the start |
//! | `Resume::Finish` | delivered: the remaining steps are done |
//! | `Resume::Refile` | a part: it is learned again, and its original is filed at the planned place |
//! | `Resume::NoteDrawing`, `Resume::NotePart` | everything is done except the last line |

mod clock;
pub mod line;
mod fleet;
mod api;
mod error;
mod seen;
mod state;
mod beamserver;
mod jobs;
#[cfg(feature = "page")]
mod page;
#[cfg(not(feature = "page"))]
#[path = "no_page.rs"]
mod page;
mod dispatcher;
mod pipeline_corrector;

pub use api::{
    Check, Companion, Completeness, Corrector, Delivery, DroppedFile, JobError, Mode, PartLearned, PartNow,
    PictureKind, Pulse, ReadBack, Sketch, Tally, Waiting, WaitsFor,
};
#[cfg(feature = "fleet")]
pub(crate) use clock::now as timestamp_now;
pub use dispatcher::run;
pub use error::StationError;
pub use fleet::{Figures, Fleet, FleetSeen, StationRow, StationState, WorkerRow};
pub use jobs::rejected::{AS_ITS_USER, count_rejected, is_rejected, return_rejected};
#[cfg(feature = "cli")]
pub(crate) use page::page_trouble;
pub use pipeline_corrector::PipelineCorrector;
#[cfg(feature = "cli")]
pub(crate) use seen::folders::is_still_at;
pub use seen::names::{self, CURRENT_PART};
pub use seen::{StopSignal, settle};
pub use state::{Holder, Request, StationLock, status};
#[cfg(feature = "cli")]
pub(crate) use state::{UsedFolder, is_hot_folder_held, known_share_is_there};

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    /// The names of an enum's variants, from its source.
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
