//! Reads a drop completely, with the files that belong to it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::filing::Beside;
use super::{EarlyEnd, Outcome, Read};
use crate::files::is_plain;
use crate::formats::pattern::is_picture;
use crate::hotfolder::api::{Companion, Completeness, DroppedFile, JobError};
use crate::hotfolder::error::folder_trouble;
use crate::hotfolder::seen::{Found, Gap, LARGEST_DROP, Meaning, Stamp, folders, meaning};
use crate::reason::Reason;

/// The largest sidecar that is accepted, bytes.
const LARGEST_SIDECAR: u64 = 1 << 20;

/// A drop to be read.
pub(crate) struct Intake<'a> {
    pub(crate) path: &'a Path,
    /// Its name in its folder.
    pub(crate) own_name: &'a str,
    /// Its full name: a pattern is named after its SKU even if it was in a folder.
    pub(crate) name: &'a str,
    /// The file as it was seen last.
    pub(crate) stamp: Stamp,
    /// The file is rejected if it is incomplete now.
    pub(crate) last_chance: bool,
    /// Other drops that may still be written.
    pub(crate) settling: &'a BTreeSet<PathBuf>,
    /// The path of the settings beside a pattern, if it may have some.
    pub(crate) sidecar: Option<PathBuf>,
    /// The path of the list beside a pattern, if it may have one.
    pub(crate) list: Option<PathBuf>,
}

/// Reads a drop, if it is complete and was not changed or removed during the reading.
pub(crate) fn read(
    intake: &Intake,
    completeness: impl FnOnce(&str, &[u8]) -> Result<Completeness, JobError>,
) -> Result<Read, EarlyEnd> {
    if intake.stamp.size > LARGEST_DROP {
        return Err(JobError::Rejected(too_large(intake.stamp.size)).into());
    }
    let content = folders::read_whole(intake.path).map_err(|error| unreadable(&error))?;
    let Some((bytes, stamp)) = content.filter(|(_, stamp)| *stamp == intake.stamp) else {
        let unchanged =
            matches!(folders::look(intake.path), Ok(Some(Found::File(now))) if now == intake.stamp);
        return Err(if unchanged {
            JobError::Retry(unsteady()).into()
        } else {
            EarlyEnd::Outcome(Outcome::Changed)
        });
    };
    match completeness(intake.own_name, &bytes)? {
        Completeness::Whole { companions } => {
            let file = DroppedFile::alone(intake.name, bytes);
            with_companions(intake, file, stamp, &companions)
        }
        Completeness::CutShort(reason) => {
            let reason = reason.in_file(intake.own_name);
            Err(EarlyEnd::Outcome(Outcome::Incomplete { gap: Gap::Content, reason, arriving: false }))
        }
    }
}

/// Adds the companions to a file, once those that it needs are complete.
fn with_companions(
    intake: &Intake,
    mut file: DroppedFile,
    stamp: Stamp,
    named: &[Companion],
) -> Result<Read, EarlyEnd> {
    let (mut companions, mut absent) = (Vec::new(), Vec::new());
    let mut missing: Option<(Reason, bool)> = None;
    for companion in named.iter().filter(|companion| is_plain(&companion.name)) {
        let path = intake.path.with_file_name(&companion.name);
        let stamp = match folders::look(&path).map_err(folder_trouble)? {
            Some(Found::File(stamp)) => Some(stamp),
            _ => None,
        };
        let settling = intake.settling.contains(&path);
        match stamp {
            Some(Stamp { size, .. }) if size > LARGEST_DROP => {
                return Err(JobError::Rejected(too_large(size)).into());
            }
            None if companion.needed => missing = Some((companion_missing(&file.name, companion), false)),
            None => absent.push(path),
            Some(stamp) => {
                let is_short = stamp.size < companion.bytes || !folders::can_be_read(&path);
                if settling || (companion.needed && is_short) {
                    missing = Some((companion_short(&file.name, companion, stamp.size), settling));
                }
                companions.push(Beside { path, stamp, bytes: None });
            }
        }
    }
    // A part or pattern that this part names is a separate drop and stays; a picture is a texture of this part.
    companions.retain(|companion| {
        let name = companion.path.file_name().unwrap_or_default();
        meaning(Path::new(name)) == Ok(Meaning::Companion) || is_picture(&name.to_string_lossy())
    });
    let sidecar = match intake.sidecar.clone() {
        Some(path) if intake.settling.contains(&path) => {
            missing = Some((sidecar_settles(&path), true));
            None
        }
        Some(path) => read_sidecar(path)?,
        None => None,
    };
    let list = match intake.list.clone() {
        Some(path) if intake.settling.contains(&path) => {
            missing = Some((list_settles(&path), true));
            None
        }
        Some(path) => read_list(path)?,
        None => None,
    };
    match missing {
        None => {
            file.siblings = read_needed(intake.path, named)?;
            if needed(named).any(|companion| !file.siblings.contains_key(&companion.name)) {
                return Err(JobError::Retry(unsteady()).into());
            }
            let text = sidecar.as_ref().map(|(beside, text)| (beside.path.clone(), text.clone()));
            companions.extend(sidecar.map(|(beside, _)| beside));
            let rows =
                list.as_ref().map(|(name, beside)| (name.clone(), beside.bytes.clone().unwrap_or_default()));
            companions.extend(list.map(|(_, beside)| beside));
            Ok(Read { file, stamp, companions, absent, sidecar: text, list: rows })
        }
        Some((reason, false)) if intake.last_chance => Err(JobError::Rejected(reason).into()),
        Some((reason, _)) => {
            let gap = Gap::Companion;
            Err(EarlyEnd::Outcome(Outcome::Incomplete { gap, reason, arriving: intake.last_chance }))
        }
    }
}

pub(super) fn needed(named: &[Companion]) -> impl Iterator<Item = &Companion> {
    named.iter().filter(|companion| companion.needed && is_plain(&companion.name))
}

/// The contents of the files that the part at this path needs, by their names; missing files are left out.
pub(crate) fn read_needed(part: &Path, named: &[Companion]) -> Result<BTreeMap<String, Vec<u8>>, JobError> {
    let mut siblings = BTreeMap::new();
    for Companion { name, .. } in needed(named) {
        let path = part.with_file_name(name);
        match folders::read_whole(&path).map_err(|error| unreadable(&error))? {
            Some((bytes, _)) => drop(siblings.insert(name.clone(), bytes)),
            None if path.exists() => return Err(JobError::Retry(unsteady())),
            None => {}
        }
    }
    Ok(siblings)
}

fn read_sidecar(path: PathBuf) -> Result<Option<(Beside, String)>, JobError> {
    match folders::look(&path).map_err(folder_trouble)? {
        Some(Found::File(stamp)) if stamp.size > LARGEST_SIDECAR => {
            let what = "The settings file beside the drawing is too large.";
            let remedy = "Keep only the settings that the drawing needs.";
            let reason = Reason::new("sidecar-too-large", what, remedy);
            let (size, limit) = (stamp.size as f64, LARGEST_SIDECAR as f64);
            Err(JobError::Rejected(reason.with_number("size", size, "bytes", Some(limit))))
        }
        Some(Found::File(_)) => {
            let Some((bytes, stamp)) = folders::read_whole(&path).map_err(|error| unreadable(&error))? else {
                return Err(JobError::Retry(unsteady()));
            };
            let text = String::from_utf8(bytes.clone()).map_err(|_| {
                let what = "The settings file beside the drawing is not UTF-8 text.";
                let reason = Reason::new("settings-unreadable", what, "Save the file as UTF-8.");
                JobError::Rejected(reason.in_file(path.file_name().unwrap_or_default().to_string_lossy()))
            })?;
            Ok(Some((Beside { path, stamp, bytes: Some(bytes) }, text)))
        }
        Some(Found::Folder | Found::Other(_)) => {
            let what = "The settings beside the drawing are a folder or a link, not a file.";
            let reason = Reason::new("sidecar-no-file", what, "Replace it with a file, or remove it.");
            Err(JobError::Rejected(reason.in_file(path.file_name().unwrap_or_default().to_string_lossy())))
        }
        None => Ok(None),
    }
}

fn read_list(path: PathBuf) -> Result<Option<(String, Beside)>, JobError> {
    match folders::look(&path).map_err(folder_trouble)? {
        Some(Found::File(stamp)) if stamp.size > LARGEST_DROP => {
            Err(JobError::Rejected(too_large(stamp.size)))
        }
        Some(Found::File(_)) => {
            let Some((bytes, stamp)) = folders::read_whole(&path).map_err(|error| unreadable(&error))? else {
                return Err(JobError::Retry(unsteady()));
            };
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            Ok(Some((name, Beside { path, stamp, bytes: Some(bytes) })))
        }
        Some(Found::Folder | Found::Other(_)) | None => Ok(None),
    }
}

fn unsteady() -> Reason {
    let what = "The file changed while it was read.";
    Reason::new("file-unsteady", what, "Wait: isomark reads it again.")
}

/// The error for a dropped file that cannot be read; the station's folders are not the cause.
fn unreadable(error: &std::io::Error) -> JobError {
    let what = format!("The file cannot be read: {error}.");
    let remedy =
        "Close the program that has it open, or give isomark read access; isomark then reads it by itself.";
    JobError::Retry(Reason::new("file-unreadable", what, remedy))
}

fn too_large(size: u64) -> Reason {
    let reason =
        Reason::new("file-too-large", "The file is too large.", "Export it with fewer triangles or lines.");
    reason.with_number("size", size as f64, "bytes", Some(LARGEST_DROP as f64))
}

fn companion_missing(part: &str, companion: &Companion) -> Reason {
    let what = format!("{part} needs {}, which is missing.", companion.name);
    Reason::new(
        "companion-missing",
        what,
        format!(
            "Drop {} into the same folder. If the part was rejected, drop both together.",
            companion.name
        ),
    )
}

fn companion_short(part: &str, companion: &Companion, size: u64) -> Reason {
    let what = format!("{part} needs {}, which is incomplete.", companion.name);
    let reason = Reason::new("companion-short", what, format!("Copy {} again.", companion.name));
    reason.with_number("size", size as f64, "bytes", Some(companion.bytes as f64))
}

fn list_settles(list: &Path) -> Reason {
    let name = list.file_name().unwrap_or_default().to_string_lossy();
    let what = format!("A program may still write its list {name}.");
    Reason::new("sidecar-settling", what, "Wait: isomark reads it again.")
}

fn sidecar_settles(settings: &Path) -> Reason {
    let name = settings.file_name().unwrap_or_default().to_string_lossy();
    let what = format!("A program may still write its settings {name}.");
    Reason::new("sidecar-settling", what, "Wait: isomark reads them again.")
}
