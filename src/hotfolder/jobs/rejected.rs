//! The way back from the rejected folder into the hot folder.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use fs_err as fs;
use serde::Deserialize;

use super::filing;
use super::filing::REPORT;
use crate::config::FolderPaths;
use crate::files::make_folder;
use crate::hotfolder::seen::folders::move_new;
use crate::hotfolder::seen::{Meaning, meaning};
use crate::hotfolder::state::{JournalPositions, with_slashes};
use crate::printable::on_one_line;
use crate::reason::Reason;

/// How the names of the files with reasons end.
pub(super) const REASON: &str = ".reason.json";
/// What to do when the station's folders may not be written.
pub const AS_ITS_USER: &str =
    "Do it as the user that runs the station, on Linux with `sudo -u isomark` before the command.";

/// What is needed of a reason's file.
#[derive(Deserialize)]
struct RejectedDrop {
    drop: String,
}

/// Moves rejected drops back into the hot folder, with the companions that lie beside them, and removes their reasons:
/// those named as they were in the hot folder, or all. Returns what is back, and why others are not.
///
/// # Errors
/// When the rejected folder cannot be read.
pub fn return_rejected(
    folders: &FolderPaths,
    wanted: Option<&[String]>,
) -> std::io::Result<(Vec<String>, Vec<Reason>)> {
    let mut reasons = Vec::new();
    collect(&folders.rejected, 0, &mut reasons)?;
    let order = JournalPositions::read(&folders.state)?;
    // Of a drop that was rejected several times the newest counts; an older one would undo it.
    let mut newest = BTreeMap::new();
    for reason in reasons {
        let Ok(text) = fs::read(&reason) else { continue };
        let Ok(RejectedDrop { drop }) = serde_json::from_slice(&text) else { continue };
        if wanted.is_some_and(|wanted| !wanted.iter().any(|name| names(name, &drop))) {
            continue;
        }
        let line = reason.with_file_name(Path::new(&drop).file_name().unwrap_or_default());
        let line = order.rejected(&with_slashes(line.strip_prefix(&folders.rejected).unwrap_or(&line)));
        let this = (line, written(&reason), place_number(&reason), reason);
        let last = newest.entry(drop).or_insert_with(|| this.clone());
        *last = this.max(std::mem::take(last));
    }
    let (mut returned, mut trouble) = (Vec::new(), Vec::new());
    for (drop, (line, rejected_at, _, reason)) in newest {
        if done_since(folders, &order, &drop, line, rejected_at) {
            let what =
                format!("{drop} is not put back: a newer one of that name was done since it was rejected.");
            let remedy =
                format!("Move it from {} yourself if it shall replace that.", folders.rejected.display());
            trouble.push(Reason::new("newer-done", what, remedy));
            continue;
        }
        match bring_back(folders, &reason, &drop) {
            Ok(()) => returned.push(drop),
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => {
                let what = format!("{drop} cannot be put back: {error}.");
                let remedy = match error.kind() {
                    ErrorKind::PermissionDenied => AS_ITS_USER,
                    _ => "Let what lies in the hot folder under its name be done first.",
                };
                trouble.push(Reason::new("not-returned", what, remedy));
            }
        }
    }
    for name in
        wanted.unwrap_or_default().iter().filter(|name| !returned.iter().any(|drop| names(name, drop)))
    {
        if trouble.is_empty() {
            let rejected = folders.rejected.display();
            trouble.push(if folders.hot.join(name).is_file() {
                let what = format!("{name} was not rejected: it lies in the hot folder.");
                Reason::new("not-rejected", what, "Try all that waits at once: leave out its name.")
            } else {
                let what = format!("No drop {name} lies in {rejected}.");
                let remedy = "Name it as it was named in the hot folder; its .reason.txt begins with that.";
                Reason::new("not-rejected", what, remedy)
            });
        }
    }
    Ok((returned, trouble))
}

/// Whether somebody who typed `name` means the drop: as it was named, or as a terminal shows it.
fn names(name: &str, drop: &str) -> bool {
    name == drop || name == on_one_line(drop)
}

/// How many rejected drops lie in the folder.
///
/// # Errors
/// When it cannot be read.
pub fn count_rejected(folder: &Path) -> std::io::Result<usize> {
    let mut reasons = Vec::new();
    collect(folder, 0, &mut reasons)?;
    Ok(reasons.len())
}

/// Whether a rejected drop lies in the folder that is meant by this name; what cannot be read is none.
pub fn is_rejected(folder: &Path, name: &str) -> bool {
    let mut reasons = Vec::new();
    let drop = |reason: &PathBuf| serde_json::from_slice::<RejectedDrop>(&fs::read(reason).ok()?).ok();
    collect(folder, 0, &mut reasons).is_ok()
        && reasons.iter().filter_map(drop).any(|rejected| names(name, &rejected.drop))
}

/// Reasons lie up to two folders deep: a SKU's, and a numbered one in it.
fn collect(folder: &Path, depth: usize, reasons: &mut Vec<PathBuf>) -> std::io::Result<()> {
    let entries = match fs::read_dir(folder) {
        // A station that never ran rejected nothing.
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        entries => entries?,
    };
    for entry in entries {
        let path = entry?.path();
        if path.is_dir() && depth < 2 {
            collect(&path, depth + 1, reasons)?;
        } else if path.to_string_lossy().ends_with(REASON) {
            reasons.push(path);
        }
    }
    Ok(())
}

/// When the file was written; nothing where that cannot be told.
fn written(file: &Path) -> Option<SystemTime> {
    fs::metadata(file).and_then(|metadata| metadata.modified()).ok()
}

/// The number of the folder `(2)`, `(3)` … that a rejected drop lies in, 1 without one.
fn place_number(file: &Path) -> u64 {
    let folder = file.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
    let number = folder.strip_prefix('(').and_then(|rest| rest.strip_suffix(')'));
    number.and_then(|number| number.parse().ok()).unwrap_or(1)
}

/// Whether a drop of that name was done since it was rejected: the journal tells it by its lines; where it was written
/// anew without the rejection, the report, or the note of the SKU's part, is newer.
fn done_since(
    folders: &FolderPaths,
    order: &JournalPositions,
    drop: &str,
    rejected: Option<usize>,
    rejected_at: Option<SystemTime>,
) -> bool {
    let (done, told) = match meaning(Path::new(drop)) {
        Ok(Meaning::Pattern { sku, name }) => {
            (order.delivered(&name), filing::report_path(folders, &sku, &name, REPORT))
        }
        Ok(Meaning::Part(sku)) => (order.learned(&sku), filing::current_part_note(folders, &sku)),
        Ok(Meaning::Companion) | Err(_) => return false,
    };
    match rejected {
        Some(rejected) => done.is_some_and(|done| done > rejected),
        None => written(&told).is_some_and(|done| Some(done) > rejected_at),
    }
}

/// The place of the rejected drop that a reason's file is about; `None` if it is about none.
pub(super) fn drop_of(reason: &Path) -> Option<PathBuf> {
    let RejectedDrop { drop } = serde_json::from_slice(&fs::read(reason).ok()?).ok()?;
    Some(reason.with_file_name(Path::new(&drop).file_name()?))
}

/// The companions beside a rejected drop; none of one that cannot be read.
pub(super) fn companions_of(rejected: &Path) -> Vec<PathBuf> {
    fs::read(rejected).map(|bytes| companions(rejected, &bytes)).unwrap_or_default()
}

fn bring_back(folders: &FolderPaths, reason: &Path, drop: &str) -> std::io::Result<()> {
    // What stands in the file is not to lead out of the hot folder.
    let relative = Path::new(drop);
    let plain = relative.components().all(|part| matches!(part, std::path::Component::Normal(_)));
    let Some(name) = relative.file_name().filter(|_| plain) else {
        return Err(ErrorKind::InvalidInput.into());
    };
    let rejected = reason.with_file_name(name);
    let target = folders.hot.join(relative);
    if let Some(folder) = target.parent() {
        fs::create_dir_all(&folders.hot)?;
        make_folder(folder)?;
    }
    let bytes = fs::read(&rejected)?;
    for companion in companions(&rejected, &bytes) {
        match move_new(&companion, &target.with_file_name(companion.file_name().unwrap_or_default())) {
            Err(error) if error.kind() != ErrorKind::AlreadyExists => return Err(error),
            _ => {}
        }
    }
    move_new(&rejected, &target)?;
    for ending in ["json", "txt"] {
        match fs::remove_file(reason.with_extension(ending)) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(())
}

/// Companions beside a rejected drop that bear its name or are named in it.
fn companions(rejected: &Path, bytes: &[u8]) -> Vec<PathBuf> {
    let folder = rejected.parent().unwrap_or(Path::new(""));
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let belongs = |path: &PathBuf| {
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else { return false };
        let named = || bytes.windows(name.len()).any(|window| window == name.as_bytes());
        meaning(Path::new(name)) == Ok(Meaning::Companion)
            && (path.file_stem() == rejected.file_stem() || named())
    };
    entries.filter(|path| path.is_file()).filter(belongs).collect()
}
