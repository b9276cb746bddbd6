//! What lies where when a job is over.
//!
//! ```text
//! import/<name>.dxf                       the corrected drawing, nothing else ever
//! reports/<sku>/<name>.report.json        of the latest drawing or part of that name
//! reports/<sku>/<name>.preview.svg
//! archive/<sku>/<name>                    originals; when a name is taken: archive/<sku>/(2)/<name> and so on
//! archive/<sku>/current-part.txt          which archived part the surface comes from
//! rejected/[<folder>/]<name>              as it lay in the hot folder; when taken: rejected/(2)/<name> and so on
//! rejected/[<folder>/]<name>.reason.json  and .reason.txt
//! ```
//!
//! SKU folders bear the SKU's name in lower case. Companions lie beside their part. A rejected drop is tried again by
//! moving it back into the hot folder as it is.

use std::ffi::{OsStr, OsString};
use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;

use super::folders::{Found, free_place, has_content, look, move_new};
use super::names::{SIDECAR, is_sidecar};
use super::settle::Stamp;
use crate::config::{FolderPaths, Sku, Station};
use crate::files::{read_if_there, write_new, write_whole, write_whole_unsynced};
use crate::formats::pattern::is_drawing;
use crate::printable::on_one_line;
use crate::reason::Reason;

/// The file in a SKU's archive folder that holds the path of its part, relative to that folder, with `/`.
pub const CURRENT_PART: &str = "current-part.txt";

/// An original that leaves the hot folder.
pub(super) struct Original<'a> {
    /// Where it lies.
    pub(super) path: &'a Path,
    /// What was read of it, if it was: should somebody replace it meanwhile, these bytes are what is put away.
    pub(super) content: Option<(&'a [u8], Stamp)>,
    /// Files beside it that go along.
    pub(super) companions: &'a [PathBuf],
}

/// Makes the folders that belong to isomark. The import folder does not: made by mistake, under a mistyped name or
/// where a share is not mounted, it would swallow drawings.
pub(super) fn prepare(folders: &FolderPaths) -> Result<(), (&'static str, PathBuf, io::Error)> {
    let FolderPaths { hot, archive, rejected, cache, reports, state, import: _, skus: _ } = folders;
    let ours = [
        ("hot", hot),
        ("archive", archive),
        ("rejected", rejected),
        ("cache", cache),
        ("reports", reports),
        ("state", state),
    ];
    for (purpose, path) in ours {
        fs::create_dir_all(path).map_err(|error| (purpose, path.clone(), error))?;
    }
    Ok(())
}

/// Makes the folder of the SKU files if it is to lie beside the station file. Anywhere else it may be on a share that is
/// not there yet, and so may its files.
pub(super) fn prepare_skus(station: &Station) -> io::Result<()> {
    let skus = &station.folders.skus;
    if skus.parent() == station.file.parent() { fs::create_dir_all(skus) } else { Ok(()) }
}

/// The drawing of that name in the import folder.
pub(super) fn delivered_before(folders: &FolderPaths, name: &str) -> io::Result<Option<Vec<u8>>> {
    read_if_there(&folders.import.join(name))
}

/// The ending of a report.
pub(super) const REPORT: &str = "report.json";

/// Where a file named after a drop lies in the SKU's reports folder.
pub(super) fn report_path(folders: &FolderPaths, sku: &Sku, name: &str, ending: &str) -> PathBuf {
    folders.reports.join(sku.key()).join(format!("{name}.{ending}"))
}

/// The note of the archived part that the SKU's surface comes from.
pub(super) fn current_part_note(folders: &FolderPaths, sku: &Sku) -> PathBuf {
    folders.archive.join(sku.key()).join(CURRENT_PART)
}

/// Puts a file named after a drop into the SKU's reports folder. A power cut in the same moment may lose it.
pub(super) fn write_report(
    folders: &FolderPaths,
    sku: &Sku,
    name: &str,
    ending: &str,
    bytes: &[u8],
) -> io::Result<()> {
    let folder = folders.reports.join(sku.key());
    fs::create_dir_all(&folder)?;
    write_whole_unsynced(&folder, &format!("{name}.{ending}"), bytes)
}

/// Where an original that is done goes in the SKU's archive folder; the folder is made.
pub(super) fn archive_place(
    folders: &FolderPaths,
    sku: &Sku,
    name: &str,
    original: &Original,
) -> io::Result<PathBuf> {
    let place = free_place(&folders.archive.join(sku.key()), &all_names(name.as_ref(), original))?;
    Ok(place.join(name))
}

/// A path in the SKU's archive folder, relative to it, with `/`.
pub(super) fn in_archive(folders: &FolderPaths, sku: &Sku, archived: &Path) -> String {
    with_slashes(archived.strip_prefix(folders.archive.join(sku.key())).unwrap_or(archived))
}

/// Removes an original whose copy lies in the archive, and lets its companions follow. What bears its name by now and
/// is not what was read is another drop and stays.
pub(super) fn remove_copied(folders: &FolderPaths, original: &Original, copy: &Path) -> io::Result<()> {
    match (look(original.path)?, original.content) {
        (Some(found), Some((_, stamp))) if found != Found::File(stamp) => {}
        (Some(_), _) => fs::remove_file(original.path)?,
        (None, _) => stays_gone(folders, original.path)?,
    }
    companions_follow(original, copy);
    Ok(())
}

/// Notes that the SKU's surface comes from this archived part.
pub(super) fn set_current_part(folders: &FolderPaths, sku: &Sku, archived: &Path) -> io::Result<()> {
    let folder = folders.archive.join(sku.key());
    write_whole(&folder, CURRENT_PART, format!("{}\n", in_archive(folders, sku, archived)).as_bytes())
}

/// The archived part that the SKU's surface comes from, if there is one.
pub(super) fn current_part(folders: &FolderPaths, sku: &Sku) -> Option<PathBuf> {
    let folder = folders.archive.join(sku.key());
    let relative = fs::read_to_string(folder.join(CURRENT_PART)).ok()?;
    let part = folder.join(relative.trim_end());
    matches!(look(&part), Ok(Some(Found::File(_)))).then_some(part)
}

/// Moves an original that cannot be done into the rejected folder, with the reason beside it. The reason is written
/// first, so that no rejected file is ever without one. `before` is told where it goes before it is moved there.
pub(super) fn reject(
    folders: &FolderPaths,
    relative: &Path,
    original: &Original,
    reason: &Reason,
    before: impl FnOnce(&Path) -> io::Result<()>,
) -> io::Result<PathBuf> {
    let folder = folders.rejected.join(relative.parent().unwrap_or(Path::new("")));
    let file_name = relative.file_name().unwrap_or_default();
    let name = file_name.to_string_lossy();
    let stem = shortened(&name);
    let mut names = all_names(file_name, original);
    // A list of points may bear the very name that the reason will get; it lies there with its own reason.
    names.extend(["json", "txt"].map(|ending| format!("{stem}.reason.{ending}.reason.json").into()));
    let place = free_place(&folder, &names)?;
    let drop = with_slashes(relative);
    let json = reason.to_json(Some(&drop))?;
    let text = format!(
        "{} was rejected.\n\n{reason}\n\nTo try again, mend the file and drop it again, or move it back as it is.\n",
        on_one_line(&drop)
    );
    write_whole(&place, &format!("{stem}.reason.json"), json.as_bytes())?;
    write_whole(&place, &format!("{stem}.reason.txt"), text.as_bytes())?;
    before(&place.join(file_name))?;
    put_away(folders, original, &place.join(file_name))?;
    Ok(place.join(file_name))
}

/// Moves one companion into the folder where its part went before.
pub(super) fn follow(companion: &Path, place: &Path) -> io::Result<()> {
    move_new(companion, &place.join(companion.file_name().unwrap_or_default()))
}

/// Moves the original to `target` and its companions beside it, the original first: what may be left behind by an
/// interruption is a companion without a part, which does no harm.
pub(super) fn put_away(folders: &FolderPaths, original: &Original, target: &Path) -> io::Result<()> {
    match (original.content, look(original.path)?) {
        (Some((bytes, stamp)), Some(found)) if found != Found::File(stamp) => write_new(target, bytes)?,
        (Some((bytes, stamp)), Some(_)) => move_read(original.path, target, bytes, stamp)?,
        (None, Some(_)) => move_new(original.path, target)?,
        (Some((bytes, _)), None) => {
            stays_gone(folders, original.path)?;
            write_new(target, bytes)?;
        }
        (None, None) => {}
    }
    companions_follow(original, target);
    Ok(())
}

/// Moves the file that was read. A file that was renamed over it in the last moment is another drop: it goes back, and
/// what was read is put away instead.
fn move_read(path: &Path, target: &Path, bytes: &[u8], stamp: Stamp) -> io::Result<()> {
    move_new(path, target)?;
    if look(target)? == Some(Found::File(stamp)) || has_content(target, bytes) {
        return Ok(());
    }
    match move_new(target, path) {
        // It was replaced in its turn, as if by overwriting it.
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => fs::remove_file(target)?,
        moved => moved?,
    }
    write_new(target, bytes)
}

/// A drop that somebody took away is done with what was read of it; one that went with the whole hot folder comes back
/// with it and would be done twice.
///
/// # Errors
/// `NotFound` when the hot folder is gone, too; `Interrupted` when it is back.
fn stays_gone(folders: &FolderPaths, drop: &Path) -> io::Result<()> {
    let hot = &folders.hot;
    if !hot.is_dir() {
        let words = format!("the hot folder {} is gone, and the drop with it", hot.display());
        return Err(io::Error::new(io::ErrorKind::NotFound, words));
    }
    if look(drop)?.is_some() {
        let words = format!("the hot folder {} was gone for a moment", hot.display());
        return Err(io::Error::new(io::ErrorKind::Interrupted, words));
    }
    Ok(())
}

fn companions_follow(original: &Original, target: &Path) {
    for companion in original.companions {
        let to = target.with_file_name(name_beside(companion, target.file_name().unwrap_or_default()));
        let moved = match move_new(companion, &to) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && is_same(companion, &to) => {
                // It was copied to the archive's disk when the station was interrupted.
                fs::remove_file(companion)
            }
            moved => moved,
        };
        if let Err(error) =
            moved.or_else(|error| if error.kind() == io::ErrorKind::NotFound { Ok(()) } else { Err(error) })
        {
            tracing::warn!("{} stays in the hot folder: {error}", companion.display());
        }
    }
}

/// What a companion is called beside its original: settings bear the pattern's name, or they would not be found again.
fn name_beside(companion: &Path, original: &OsStr) -> OsString {
    if is_sidecar(companion) && is_drawing(&original.to_string_lossy()) {
        return Path::new(original).with_extension(SIDECAR).into_os_string();
    }
    companion.file_name().unwrap_or_default().to_owned()
}

fn is_same(a: &Path, b: &Path) -> bool {
    matches!(read_if_there(a), Ok(Some(bytes)) if has_content(b, &bytes))
}

/// The names that must be free where an original goes. Settings belong to each pattern of their stem that lies beside
/// them, so neither do others' lie there, nor does a pattern that those which travel along would be taken for.
fn all_names(name: &OsStr, original: &Original) -> Vec<OsString> {
    let companions = original.companions.iter().map(|companion| name_beside(companion, name));
    let mut names: Vec<OsString> = std::iter::once(name.to_owned()).chain(companions).collect();
    let text = name.to_string_lossy();
    if is_drawing(&text) {
        let sibling = |ending| Path::new(name).with_extension(ending).into_os_string();
        if names.contains(&sibling(SIDECAR)) {
            names.extend(["dxf", "DXF", "png", "PNG", "bmp", "BMP"].map(sibling));
        } else {
            names.push(sibling(SIDECAR));
        }
    }
    names
}

/// A name that leaves room for an ending: file systems take 255 bytes.
fn shortened(name: &str) -> &str {
    let end = (0..=name.len().min(230)).rev().find(|end| name.is_char_boundary(*end)).unwrap_or(0);
    &name[..end]
}

/// A relative path as people and machines are told it.
pub(super) fn with_slashes(relative: &Path) -> String {
    let parts: Vec<_> = relative.components().map(|part| part.as_os_str().to_string_lossy()).collect();
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::super::folders::read_whole;
    use super::*;

    fn folders_in(folder: &Path) -> FolderPaths {
        let [hot, import, archive, rejected, cache, reports, skus, state] =
            ["hot", "import", "archive", "rejected", "cache", "reports", "skus", "state"]
                .map(|name| folder.join(name));
        FolderPaths { hot, import, archive, rejected, cache, reports, skus, state }
    }

    #[test]
    fn no_original_comes_to_lie_beside_the_settings_of_another() {
        let folder = tempfile::tempdir().unwrap();
        let folders = folders_in(folder.path());
        let sku = "can".parse().unwrap();
        let place = |name: &str, companions: &[PathBuf]| {
            let original = Original { path: Path::new(name), content: None, companions };
            let place = archive_place(&folders, &sku, name, &original).unwrap();
            in_archive(&folders, &sku, &place)
        };
        let put = |name: &str| fs::write(folders.archive.join("can").join(name), "").unwrap();
        assert_eq!(place("can@a.dxf", &["can@a.toml".into()]), "can@a.dxf");
        put("can@a.dxf");
        put("can@a.toml");
        assert_eq!(place("can@a.png", &[]), "(2)/can@a.png");
        put("can@b.png");
        assert_eq!(place("can@b.dxf", &[]), "can@b.dxf");
        assert_eq!(place("can@b.dxf", &["can@b.toml".into()]), "(2)/can@b.dxf");
        assert_eq!(place("can.glb", &[]), "can.glb");
    }

    #[test]
    fn a_reason_is_never_written_over_a_rejected_scan_of_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let folders = folders_in(folder.path());
        fs::create_dir_all(&folders.hot).unwrap();
        let reason = Reason::new("asked", "As asked.", "Ask for something else.");
        let reject_drop = |name: &str| {
            let path = folders.hot.join(name);
            fs::write(&path, name).unwrap();
            let original = Original { path: &path, content: None, companions: &[] };
            reject(&folders, Path::new(name), &original, &reason, |_| Ok(())).unwrap()
        };
        let scan = reject_drop("can.glb.reason.txt");
        let part = reject_drop("can.glb");
        assert_eq!(fs::read_to_string(scan).unwrap(), "can.glb.reason.txt");
        assert_eq!(part, folders.rejected.join("(2)/can.glb"));
    }

    #[test]
    fn a_drop_that_took_the_name_of_one_that_is_done_stays() {
        let folder = tempfile::tempdir().unwrap();
        let folders = folders_in(folder.path());
        let path = folders.hot.join("can.dxf");
        let [hot, archive] = [&folders.hot, &folders.archive];
        fs::create_dir_all(hot).unwrap();
        fs::create_dir_all(archive).unwrap();
        let content = |path: &Path| fs::read_to_string(path).unwrap();
        let drop = |text: &str| {
            fs::write(hot.join("new"), text).unwrap();
            fs::rename(hot.join("new"), &path).unwrap();
        };
        drop("first");
        let (bytes, stamp) = read_whole(&path).unwrap().unwrap();
        let original = Original { path: &path, content: Some((&bytes, stamp)), companions: &[] };
        drop("second");

        // Its copy lies in an archive on another disk.
        remove_copied(&folders, &original, &archive.join("can.dxf")).unwrap();
        assert_eq!(content(&path), "second");

        // It was replaced before it was moved, and between the look and the move.
        put_away(&folders, &original, &archive.join("before")).unwrap();
        move_read(&path, &archive.join("between"), &bytes, stamp).unwrap();
        assert_eq!(content(&path), "second");
        for place in ["before", "between"] {
            assert_eq!(content(&archive.join(place)), "first", "{place}");
        }

        let (bytes, stamp) = read_whole(&path).unwrap().unwrap();
        let original = Original { path: &path, content: Some((&bytes, stamp)), companions: &[] };
        remove_copied(&folders, &original, &archive.join("copy")).unwrap();
        assert!(!path.exists());
    }
}
