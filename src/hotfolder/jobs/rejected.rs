//! Moves rejected drops back into the hot folder.

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use fs_err as fs;
use serde::Deserialize;

use super::filing;
use super::filing::REPORT;
use crate::config::{FolderPaths, fold};
use crate::files::make_folder;
use crate::hotfolder::line::TAKEN_OVER;
use crate::hotfolder::seen::folders::move_new;
use crate::hotfolder::seen::{Meaning, is_list, meaning};
use crate::hotfolder::state::{JournalPositions, with_slashes};
use crate::printable::on_one_line;
use crate::reason::Reason;

/// The suffix of the files with reasons.
pub(super) const REASON: &str = ".reason.json";
/// The remedy when the station's folders are not writable.
pub const AS_ITS_USER: &str =
    "Run the command as the user that runs the station; on Linux put `sudo -u isomark` before it.";

/// The needed content of a reason's file.
#[derive(Deserialize)]
struct RejectedDrop {
    drop: String,
    #[serde(default)]
    code: String,
}

/// Moves rejected drops back into the hot folder, with their companions, and removes their reasons: the drops in
/// `wanted`, by their names in the hot folder, or all. Drops whose job another station may have marked stay, unless it is forced.
/// Returns the drops that were moved, and why others were not.
///
/// # Errors
/// When the rejected folder cannot be read.
pub fn return_rejected(
    folders: &FolderPaths,
    wanted: Option<&[String]>,
    is_forced: bool,
) -> std::io::Result<(Vec<String>, Vec<Reason>)> {
    let mut reasons = Vec::new();
    collect(&folders.rejected, 0, &mut reasons)?;
    let order = JournalPositions::read(&folders.state)?;
    // Of a drop that was rejected several times, only the newest version is moved: an older one would replace it.
    let (mut newest, mut others) = (BTreeMap::new(), BTreeSet::new());
    for reason in reasons {
        let Ok(text) = fs::read(&reason) else { continue };
        let Ok(RejectedDrop { drop, code }) = serde_json::from_slice(&text) else { continue };
        if wanted.is_some_and(|wanted| !wanted.iter().any(|name| names(name, &drop))) {
            others.insert(drop);
            continue;
        }
        let line = reason.with_file_name(Path::new(&drop).file_name().unwrap_or_default());
        let line = order.rejected(&with_slashes(line.strip_prefix(&folders.rejected).unwrap_or(&line)));
        let this = (line, written(&reason), place_number(&reason), reason, code);
        let last = newest.entry(drop).or_insert_with(|| this.clone());
        *last = this.max(std::mem::take(last));
    }
    let (mut returned, mut trouble) = (Vec::new(), Vec::new());
    for (drop, (line, rejected_at, _, reason, code)) in newest {
        if code == TAKEN_OVER && !is_forced {
            trouble.push(elsewhere(&drop));
            continue;
        }
        if done_since(folders, &order, &drop, line, rejected_at) {
            let what = format!(
                "{drop} is not moved back: a newer drop of that name was processed after the rejection."
            );
            let remedy = format!(
                "Move it from {} yourself if it is to replace the newer one.",
                folders.rejected.display()
            );
            trouble.push(Reason::new("newer-done", what, remedy));
            continue;
        }
        match bring_back(folders, &reason, &drop) {
            Ok(()) => returned.push(drop),
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => {
                let what = format!("{drop} cannot be moved back: {error}.");
                let remedy = match error.kind() {
                    ErrorKind::PermissionDenied => AS_ITS_USER,
                    _ => "Wait until the file of its name in the hot folder is processed.",
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
                let what = format!("{name} was not rejected: it is in the hot folder.");
                Reason::new("not-rejected", what, "Leave out the name to try all waiting drops again.")
            } else {
                let what = format!("There is no rejected drop {name} in {rejected}.");
                let without_ending =
                    |drop: &&String| names(name, &with_slashes(&Path::new(drop).with_extension("")));
                let remedy = match others.iter().find(without_ending) {
                    Some(drop) => {
                        format!(
                            "Did you mean `{}`? Give the whole file name with its extension.",
                            on_one_line(drop)
                        )
                    }
                    None => {
                        "Give the name that the file had in the hot folder. `isomark status` lists what was rejected.".to_owned()
                    }
                };
                Reason::new("not-rejected", what, remedy)
            });
        }
    }
    Ok((returned, trouble))
}

/// Why a drop is not moved back whose job was given to another station.
fn elsewhere(drop: &str) -> Reason {
    let what = format!(
        "{} is not moved back: its job was given to another station, which may have marked it.",
        on_one_line(drop)
    );
    let remedy = "See `isomark fleet status` for where the job is. If no other station marks it, name the drop and add `--force`.";
    Reason::new("marked-elsewhere", what, remedy)
}

/// Whether a typed `name` is that of the drop: its real name, or the form that a terminal shows.
fn names(name: &str, drop: &str) -> bool {
    // Windows also takes another spelling and backslashes.
    let is_alike = || cfg!(windows) && fold(&name.replace('\\', "/")) == fold(drop);
    name == drop || name == on_one_line(drop) || is_alike()
}

/// The number of rejected drops in the folder.
///
/// # Errors
/// When it cannot be read.
pub fn count_rejected(folder: &Path) -> std::io::Result<usize> {
    let mut reasons = Vec::new();
    collect(folder, 0, &mut reasons)?;
    Ok(reasons.len())
}

/// The number of rejected drops in the folder, and those of `drops` that are among them, by their names in the hot folder.
///
/// # Errors
/// When it cannot be read.
#[cfg(feature = "page")]
pub(crate) fn rejected_among(
    folder: &Path,
    drops: &BTreeSet<&str>,
) -> std::io::Result<(usize, BTreeSet<String>)> {
    let mut reasons = Vec::new();
    collect(folder, 0, &mut reasons)?;
    let file_name = |drop: &&str| {
        let name = drop.rsplit('/').next().unwrap_or(drop);
        format!("{}{REASON}", filing::shortened(name))
    };
    // Only these are read: the folder may contain very many.
    let expected: BTreeSet<String> = drops.iter().map(file_name).collect();
    let is_expected = |reason: &&PathBuf| {
        reason.file_name().is_some_and(|name| expected.contains(&*name.to_string_lossy()))
    };
    let drop = |reason: &PathBuf| serde_json::from_slice::<RejectedDrop>(&fs::read(reason).ok()?).ok();
    let found = reasons.iter().filter(is_expected).filter_map(drop).map(|rejected| rejected.drop);
    Ok((reasons.len(), found.filter(|drop| drops.contains(drop.as_str())).collect()))
}

/// Whether the folder contains a rejected drop of this name; files that cannot be read are ignored.
pub fn is_rejected(folder: &Path, name: &str) -> bool {
    let mut reasons = Vec::new();
    let drop = |reason: &PathBuf| serde_json::from_slice::<RejectedDrop>(&fs::read(reason).ok()?).ok();
    collect(folder, 0, &mut reasons).is_ok()
        && reasons.iter().filter_map(drop).any(|rejected| names(name, &rejected.drop))
}

/// Collects the files with reasons. They are up to two folders deep: a SKU's folder, and a numbered one in it.
fn collect(folder: &Path, depth: usize, reasons: &mut Vec<PathBuf>) -> std::io::Result<()> {
    let entries = match fs::read_dir(folder) {
        // A station that never ran has no rejected folder.
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        entries => entries?,
    };
    for entry in entries {
        let entry = entry?;
        // Links are not followed: they may lead out of the folder.
        let (path, kind) = (entry.path(), entry.file_type()?);
        if kind.is_dir() && depth < 2 {
            collect(&path, depth + 1, reasons)?;
        } else if kind.is_file() && path.to_string_lossy().ends_with(REASON) {
            reasons.push(path);
        }
    }
    Ok(())
}

/// When the file was written; `None` where that is unknown.
fn written(file: &Path) -> Option<SystemTime> {
    fs::metadata(file).and_then(|metadata| metadata.modified()).ok()
}

/// The number of the folder `(2)`, `(3)` … of a rejected drop; 1 if it is in no such folder.
fn place_number(file: &Path) -> u64 {
    let folder = file.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
    let number = folder.strip_prefix('(').and_then(|rest| rest.strip_suffix(')'));
    number.and_then(|number| number.parse().ok()).unwrap_or(1)
}

/// Whether a drop of that name was processed after the rejection. The order of the journal's lines decides. If the
/// journal no longer contains the rejection, the time of the report, or of the note of the SKU's part, decides.
fn done_since(
    folders: &FolderPaths,
    order: &JournalPositions,
    drop: &str,
    rejected: Option<usize>,
    rejected_at: Option<SystemTime>,
) -> bool {
    let (done, record) = match meaning(Path::new(drop)) {
        Ok(Meaning::Pattern { sku, name }) => {
            (order.delivered(&name), filing::report_path(folders, &sku, &name, REPORT))
        }
        Ok(Meaning::Part(sku)) => (order.learned(&sku), filing::current_part_note(folders, &sku)),
        Ok(Meaning::Companion) | Err(_) => return false,
    };
    match rejected {
        Some(rejected) => done.is_some_and(|done| done > rejected),
        None => written(&record).is_some_and(|done| Some(done) > rejected_at),
    }
}

/// The path of the rejected drop that a reason's file describes; `None` if it describes none.
pub(super) fn drop_of(reason: &Path) -> Option<PathBuf> {
    let RejectedDrop { drop, .. } = serde_json::from_slice(&fs::read(reason).ok()?).ok()?;
    Some(reason.with_file_name(Path::new(&drop).file_name()?))
}

/// The companions beside a rejected drop; empty for a drop that cannot be read.
pub(super) fn companions_of(rejected: &Path) -> Vec<PathBuf> {
    content_of(rejected).map(|bytes| companions(rejected, &bytes)).unwrap_or_default()
}

/// The content of a rejected drop; empty for a pipe or a device, which would never end or wait for a writer.
fn content_of(rejected: &Path) -> std::io::Result<Vec<u8>> {
    let is_pipe = rejected.metadata().is_ok_and(|found| !found.is_file() && !found.is_dir());
    if is_pipe { Ok(Vec::new()) } else { fs::read(rejected) }
}

fn bring_back(folders: &FolderPaths, reason: &Path, drop: &str) -> std::io::Result<()> {
    // The path in the file must not lead out of the hot folder.
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
    let bytes = content_of(&rejected)?;
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

/// Whether `<sku>@<name>.csv` is the list of the drawing `<name>` of the SKU's folder.
fn is_list_of(list: &Path, drawing: &Path) -> bool {
    let stem = |path: &Path| path.file_stem().map(|stem| fold(&stem.to_string_lossy())).unwrap_or_default();
    is_list(list) && stem(list).split_once('@').is_some_and(|(_, name)| name == stem(drawing))
}

/// The companions beside a rejected drop: files with its name, and files that it names.
fn companions(rejected: &Path, bytes: &[u8]) -> Vec<PathBuf> {
    let folder = rejected.parent().unwrap_or(Path::new(""));
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let belongs = |path: &PathBuf| {
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else { return false };
        let named = || bytes.windows(name.len()).any(|window| window == name.as_bytes());
        meaning(Path::new(name)) == Ok(Meaning::Companion)
            && (path.file_stem() == rejected.file_stem() || is_list_of(path, rejected) || named())
    };
    entries.filter(|path| path.is_file()).filter(belongs).collect()
}
