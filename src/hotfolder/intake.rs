//! Reading a drop: whole, with the files that travel along.

use std::path::{Path, PathBuf};

use super::filing::{Original, with_slashes};
use super::folders::{self, Found, LARGEST_DROP};
use super::job::{Companion, Completeness, Corrector, DroppedFile, JobError};
use super::names::{Meaning, meaning};
use super::outcome::{folder_trouble, guarded};
use super::settle::{Gap, Stamp, Verdict};
use super::worker::Worker;
use crate::files::is_plain;
use crate::formats::pattern::is_picture;
use crate::reason::Reason;

/// A drop as it was read.
pub(super) struct Read {
    pub(super) file: DroppedFile,
    pub(super) stamp: Stamp,
    /// Files beside it that travel along.
    pub(super) companions: Vec<PathBuf>,
    /// Files that it names and that are not there, without need.
    pub(super) absent: Vec<PathBuf>,
}

impl Read {
    pub(super) fn original<'a>(&'a self, path: &'a Path) -> Original<'a> {
        Original { path, content: Some((&self.file.bytes, self.stamp)), companions: &self.companions }
    }
}

impl<C: Corrector> Worker<'_, C> {
    /// Reads a drop; `None` when it is not whole yet, or changed or went meanwhile.
    pub(super) fn read(&mut self, path: &Path, name: Option<&str>) -> Result<Option<Read>, JobError> {
        let (now, times) = (self.now(), self.times());
        let Some(drop) = self.drops.get(path) else { return Ok(None) };
        let last_chance = match drop.settle.verdict(now, &times) {
            Verdict::Wait(_) => return Ok(None),
            Verdict::GiveUp(Gap::Content) => {
                let reason = drop.reason.clone().unwrap_or_else(cut_short);
                return Err(JobError::Rejected(reason));
            }
            Verdict::GiveUp(Gap::Companion) => true,
            Verdict::Read => false,
        };
        let (expected, own_name) = (drop.settle.stamp(), with_slashes(&drop.relative));
        let own_name = own_name.rsplit('/').next().unwrap_or_default();
        if expected.size > LARGEST_DROP {
            return Err(JobError::Rejected(too_large(expected.size)));
        }
        let content = folders::read_whole(path).map_err(|error| unreadable(&error))?;
        let Some((bytes, stamp)) = content.filter(|(_, stamp)| *stamp == expected) else {
            self.look_again(path);
            let unchanged = self.drops.get(path).is_some_and(|drop| drop.settle.stamp() == expected);
            return if unchanged { Err(JobError::Retry(unsteady())) } else { Ok(None) };
        };
        match guarded(|| Ok(self.corrector.completeness(own_name, &bytes)))? {
            Completeness::Whole { companions } => {
                let file = DroppedFile { name: name.unwrap_or(own_name).into(), path: path.into(), bytes };
                self.with_companions(file, stamp, &companions, last_chance)
            }
            Completeness::CutShort(reason) => {
                self.incomplete(path, Gap::Content, reason.in_file(own_name));
                Ok(None)
            }
        }
    }

    /// The file with those that travel along, once those it needs are there and whole.
    fn with_companions(
        &mut self,
        file: DroppedFile,
        stamp: Stamp,
        named: &[Companion],
        last_chance: bool,
    ) -> Result<Option<Read>, JobError> {
        let (mut companions, mut absent) = (Vec::new(), Vec::new());
        let mut missing: Option<(Reason, bool)> = None;
        for companion in named.iter().filter(|companion| is_plain(&companion.name)) {
            let path = file.path.with_file_name(&companion.name);
            let size = match folders::look(&path).map_err(folder_trouble)? {
                Some(Found::File(stamp)) => Some(stamp.size),
                _ => None,
            };
            let settling = self.drops.get(&path).is_some_and(|drop| {
                matches!(drop.settle.verdict(self.now(), &self.times()), Verdict::Wait(_))
            });
            match size {
                Some(size) if size > LARGEST_DROP => return Err(JobError::Rejected(too_large(size))),
                None if companion.needed => missing = Some((companion_missing(&file.name, companion), false)),
                None => absent.push(path),
                Some(size) if settling || (companion.needed && size < companion.bytes) => {
                    missing = Some((companion_short(&file.name, companion, size), settling));
                    companions.push(path);
                }
                Some(_) => companions.push(path),
            }
        }
        // A part or pattern that a part names is a drop of its own and does not go along; a picture is its texture.
        companions.retain(|path| {
            let name = path.file_name().unwrap_or_default();
            meaning(Path::new(name)) == Ok(Meaning::Companion) || is_picture(&name.to_string_lossy())
        });
        match missing {
            None => Ok(Some(Read { file, stamp, companions, absent })),
            Some((reason, false)) if last_chance => Err(JobError::Rejected(reason)),
            Some((reason, _)) => {
                if last_chance {
                    let now = self.now();
                    self.drops.get_mut(&file.path).into_iter().for_each(|drop| drop.settle.wait_anew(now));
                }
                self.incomplete(&file.path, Gap::Companion, reason);
                Ok(None)
            }
        }
    }

    /// Takes the file as it is now, or forgets it when it is gone.
    pub(super) fn look_again(&mut self, path: &Path) {
        let hot = self.folders().hot.clone();
        match folders::look(path) {
            Ok(Some(what)) => {
                self.see(&hot, path, what, false);
            }
            _ => self.drops.forget(path),
        }
    }

    fn incomplete(&mut self, path: &Path, gap: Gap, reason: Reason) {
        let Some(drop) = self.drops.get_mut(path) else { return };
        drop.settle.found_incomplete(gap);
        if drop.reason.as_ref() != Some(&reason) {
            tracing::info!("{} is not complete yet: {}", with_slashes(&drop.relative), reason.what);
            drop.reason = Some(reason);
        }
    }
}

fn unsteady() -> Reason {
    let what = "The file changed while it was read.";
    Reason::new("file-unsteady", what, "Nothing: it is read again.")
}

/// The file's own fault or its owner's, not that of a folder of the station.
fn unreadable(error: &std::io::Error) -> JobError {
    let what = format!("The file cannot be read: {error}.");
    let remedy = "Close the program that holds it, or let isomark read it; it is then read by itself.";
    JobError::Retry(Reason::new("file-unreadable", what, remedy))
}

fn too_large(size: u64) -> Reason {
    let reason = Reason::new(
        "file-too-large",
        "The file is too large to be handled.",
        "Export it with fewer triangles or lines.",
    );
    reason.with_number("size", size as f64, "bytes", Some(LARGEST_DROP as f64))
}

fn cut_short() -> Reason {
    Reason::new("cut-short", "The file ends too early.", "Export or copy it again.")
}

fn companion_missing(part: &str, companion: &Companion) -> Reason {
    let what = format!("{part} needs {}, which is not there.", companion.name);
    Reason::new("companion-missing", what, format!("Drop {} beside it.", companion.name))
}

fn companion_short(part: &str, companion: &Companion, size: u64) -> Reason {
    let what = format!("{part} needs {}, which is not whole.", companion.name);
    let reason = Reason::new("companion-short", what, format!("Copy {} again.", companion.name));
    reason.with_number("size", size as f64, "bytes", Some(companion.bytes as f64))
}
