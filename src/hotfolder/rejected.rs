//! The way back from the rejected folder into the hot folder.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use fs_err as fs;
use serde::Deserialize;

use super::folders::move_new;
use super::names::{Meaning, meaning};
use crate::config::FolderPaths;
use crate::reason::Reason;

const REASON: &str = ".reason.json";

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
    reasons.sort();
    let (mut returned, mut trouble) = (Vec::new(), Vec::new());
    for reason in reasons {
        let Ok(text) = fs::read(&reason) else { continue };
        let Ok(RejectedDrop { drop }) = serde_json::from_slice(&text) else { continue };
        if wanted.is_some_and(|wanted| !wanted.contains(&drop)) || returned.contains(&drop) {
            continue;
        }
        match bring_back(folders, &reason, &drop) {
            Ok(()) => returned.push(drop),
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => {
                let what = format!("{drop} cannot be put back: {error}.");
                let remedy = "Let what lies in the hot folder under its name be done first.";
                trouble.push(Reason::new("not-returned", what, remedy));
            }
        }
    }
    for name in wanted.unwrap_or_default().iter().filter(|name| !returned.contains(name)) {
        if trouble.is_empty() {
            let what = format!("No drop {name} lies in {}.", folders.rejected.display());
            let remedy = "Name it as it was named in the hot folder; its .reason.txt begins with that.";
            trouble.push(Reason::new("not-rejected", what, remedy));
        }
    }
    Ok((returned, trouble))
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
        fs::create_dir_all(folder)?;
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
