//! The places of all files after a job.
//!
//! ```text
//! import/<name>.dxf                       the corrected drawing, and never anything else
//! reports/<sku>/<name>.report.json        of the latest drawing or part with that name
//! reports/<sku>/<name>.list.json          of the latest list with that name
//! reports/<sku>/<name>.preview.svg        and .on-part.glb, .report.html, .frame.dxf
//! archive/<sku>/<name>                    originals; when a name is taken: archive/<sku>/(2)/<name> and so on
//! archive/<sku>/current-part.txt          which archived part the surface comes from
//! archive/<sku>/serial-numbers.json        the serial numbers that were marked
//! rejected/[<folder>/]<name>              as it was in the hot folder; when taken: rejected/(2)/<name> and so on
//! rejected/[<folder>/]<name>.reason.json  and .reason.txt
//! ```
//!
//! SKU folders have the SKU's name in lower case. Companions are beside their part. `isomark retry` moves a rejected drop
//! back into the hot folder.

use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::io;
use std::path::{Path, PathBuf};

use fs_err as fs;

use crate::config::{FolderPaths, Sku, Station, fold};
use crate::files::{
    read_if_there, sync_folder, write_all_or_not, write_new, write_whole, write_whole_or_not,
};
use crate::formats::pattern::{is_drawing, names_with_stem};
use crate::hotfolder::line::TAKEN_OVER;
use crate::hotfolder::seen::folders::{content_hash, copy_new, free_place, has_content, look, move_new};
use crate::hotfolder::seen::names::{CURRENT_PART, SIDECAR};
use crate::hotfolder::seen::{Filed, Found, Parking, Stamp, is_sidecar};
use crate::hotfolder::state::with_slashes;
use crate::printable::on_one_line;
use crate::reason::{Reason, quoted};

/// An original that is moved out of the hot folder.
pub(crate) struct Original<'a> {
    /// Where it is.
    pub(crate) path: &'a Path,
    pub(crate) content: Content<'a>,
    /// Files beside it that are moved with it.
    pub(crate) companions: &'a [Beside],
}

/// What is known about an original.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Content<'a> {
    /// The bytes that were read: they are filed even if somebody has changed or replaced the file since.
    Read(&'a [u8], Stamp),
    /// It was not read; it is the file with this stamp.
    Seen(Stamp),
    /// It cannot be read; the file at the path is moved, unchanged or not.
    Unknown,
}

/// A file beside an original that is moved with it.
#[derive(Debug, Clone)]
pub(crate) struct Beside {
    pub(crate) path: PathBuf,
    /// The file as it was seen; if it was written since, it stays in the hot folder.
    pub(crate) stamp: Stamp,
    /// The bytes that were read, if they are kept.
    pub(crate) bytes: Option<Vec<u8>>,
}

impl Beside {
    /// The file at the path as it is now; `None` if there is no file.
    pub(crate) fn at(path: &Path) -> Option<Self> {
        match look(path) {
            Ok(Some(Found::File(stamp))) => Some(Self { path: path.into(), stamp, bytes: None }),
            _ => None,
        }
    }

    /// Whether the file is unchanged since it was seen.
    pub(crate) fn is_unchanged(&self) -> bool {
        matches!(look(&self.path), Ok(found) if found == Some(Found::File(self.stamp)))
    }
}

/// Creates the folders that belong to isomark. The import folder is never created: under a mistyped name, or where a
/// share is not mounted, drawings would be delivered to a folder that nobody reads.
pub(crate) fn prepare(folders: &FolderPaths) -> Result<(), (&'static str, PathBuf, io::Error)> {
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

/// Creates the folder of the SKU files if its place is beside the station file. Anywhere else it may be on a share that
/// is not mounted yet.
pub(crate) fn prepare_skus(station: &Station) -> io::Result<()> {
    let skus = &station.folders.skus;
    if skus.parent() == station.file.parent() { fs::create_dir_all(skus) } else { Ok(()) }
}

/// The drawing with that name in the import folder.
pub(crate) fn delivered_before(folders: &FolderPaths, name: &str) -> io::Result<Option<Vec<u8>>> {
    read_if_there(&folders.import.join(name))
}

/// The suffix of a report's name.
pub(crate) const REPORT: &str = "report.json";

/// The suffix of the name of a list's report.
pub(crate) const LIST_REPORT: &str = "list.json";

/// The path of a file named after a drop in the SKU's reports folder.
pub(crate) fn report_path(folders: &FolderPaths, sku: &Sku, name: &str, ending: &str) -> PathBuf {
    folders.reports.join(sku.key()).join(format!("{name}.{ending}"))
}

/// The path of the note that names the archived part of the SKU's surface.
pub(crate) fn current_part_note(folders: &FolderPaths, sku: &Sku) -> PathBuf {
    folders.archive.join(sku.key()).join(CURRENT_PART)
}

/// The hash of the result of a drawing, from the report of its newest delivery; `None` without one.
pub(crate) fn reported_result(folders: &FolderPaths, sku: &Sku, pattern: &str) -> Option<String> {
    let bytes = read_if_there(&report_path(folders, sku, pattern, REPORT)).ok().flatten()?;
    let report: serde_json::Value = serde_json::from_slice(&bytes).ok()?;
    report["output"]["blake3"].as_str().map(str::to_owned)
}

/// Writes a file named after a drop into the SKU's reports folder. A power cut at that moment may lose the file, but
/// never leaves an incomplete one.
pub(crate) fn write_report(
    folders: &FolderPaths,
    sku: &Sku,
    name: &str,
    ending: &str,
    bytes: &[u8],
) -> io::Result<()> {
    let folder = folders.reports.join(sku.key());
    fs::create_dir_all(&folder)?;
    write_whole_or_not(&folder, &format!("{name}.{ending}"), bytes)
}

/// Writes several such files at once.
pub(crate) fn write_reports(
    folders: &FolderPaths,
    sku: &Sku,
    name: &str,
    files: &[(&str, &[u8])],
) -> io::Result<()> {
    let folder = folders.reports.join(sku.key());
    fs::create_dir_all(&folder)?;
    let named: Vec<(String, &[u8])> =
        files.iter().map(|(ending, bytes)| (format!("{name}.{ending}"), *bytes)).collect();
    write_all_or_not(&folder, &named)
}

/// The place of an original in the SKU's archive folder; the folder is created.
pub(crate) fn archive_place(
    folders: &FolderPaths,
    sku: &Sku,
    name: &str,
    original: &Original,
) -> io::Result<PathBuf> {
    let place = free_place(&folders.archive.join(sku.key()), &all_names(name.as_ref(), original))?;
    Ok(place.join(name))
}

/// A path in the SKU's archive folder, relative to it, with `/`.
pub(crate) fn in_archive(folders: &FolderPaths, sku: &Sku, archived: &Path) -> String {
    with_slashes(archived.strip_prefix(folders.archive.join(sku.key())).unwrap_or(archived))
}

/// Removes an original from the hot folder whose copy is in the archive, and files its companions. If a different file
/// has its name now, that is another drop and stays.
pub(crate) fn remove_copied(
    folders: &FolderPaths,
    parking: &Parking,
    original: &Original,
    copy: &Path,
) -> io::Result<()> {
    let filed = match original.content {
        Content::Read(bytes, stamp) => Some(Filed { stamp, hash: blake3::hash(bytes) }),
        Content::Seen(_) | Content::Unknown => None,
    };
    match (look(original.path)?, filed) {
        (Some(_), Some(filed)) => parking.take_out(folders, original.path, &filed)?,
        (Some(_), None) => {}
        (None, _) => parking.check_removed(folders, original.path)?,
    }
    companions_follow(folders, parking, original, copy);
    Ok(())
}

/// Notes that the SKU's surface comes from this archived part.
pub(crate) fn set_current_part(folders: &FolderPaths, sku: &Sku, archived: &Path) -> io::Result<()> {
    let folder = folders.archive.join(sku.key());
    write_whole(&folder, CURRENT_PART, format!("{}\n", in_archive(folders, sku, archived)).as_bytes())
}

/// The path of the archived part that the SKU's surface comes from, from the note; `None` without a note.
///
/// # Errors
/// When the note cannot be read.
pub(crate) fn noted_part(folders: &FolderPaths, sku: &Sku) -> io::Result<Option<PathBuf>> {
    let note = current_part_note(folders, sku);
    let Some(bytes) = read_if_there(&note)? else { return Ok(None) };
    let text = String::from_utf8(bytes).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))?;
    Ok(Some(note.with_file_name(text.trim_end())))
}

/// The archived part that the SKU's surface comes from, if the file exists.
pub(crate) fn current_part(folders: &FolderPaths, sku: &Sku) -> Option<PathBuf> {
    let part = noted_part(folders, sku).ok()??;
    matches!(look(&part), Ok(Some(Found::File(_)))).then_some(part)
}

/// The keys of the SKUs that have an archived part or a settings file, sorted. A folder that cannot be listed has none.
pub(crate) fn known_skus(folders: &FolderPaths) -> BTreeSet<String> {
    let names = |folder: &Path| -> Vec<PathBuf> {
        fs::read_dir(folder)
            .map(|entries| entries.flatten().map(|entry| entry.path()).collect())
            .unwrap_or_default()
    };
    let archived = names(&folders.archive).into_iter().filter(|folder| folder.join(CURRENT_PART).is_file());
    let configured = names(&folders.skus)
        .into_iter()
        .filter(|file| file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")));
    let archived = archived.filter_map(|folder| Some(folder.file_name()?.to_str()?.to_owned()));
    let configured = configured.filter_map(|file| Some(fold(file.file_stem()?.to_str()?)));
    archived.chain(configured).collect()
}

/// Moves an original that cannot be processed into the rejected folder, with the reason beside it. The reason is
/// written first, so that every rejected file has one; it names the `station`'s file. `before` is called with the new
/// path before the file is moved.
pub(crate) fn reject(
    station: &Path,
    folders: &FolderPaths,
    parking: &Parking,
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
    // A point list may have exactly the name that the reason will get; it is there with its own reason.
    names.extend(["json", "txt"].map(|ending| format!("{stem}.reason.{ending}.reason.json").into()));
    let place = match free_place(&folder, &names)? {
        // After an interruption, the copy is there, and the original still in the hot folder.
        free if holds_copy(&place_before(&folder, &free).join(file_name), original) => {
            place_before(&folder, &free)
        }
        free => free,
    };
    let drop = with_slashes(relative);
    let json = reason.to_json(Some(&drop))?;
    let text = reason_text(station, file_name, &on_one_line(&drop), original, reason);
    write_whole(&place, &format!("{stem}.reason.json"), json.as_bytes())?;
    write_whole(&place, &format!("{stem}.reason.txt"), text.as_bytes())?;
    before(&place.join(file_name))?;
    if let Err(error) = put_away(folders, parking, original, &place.join(file_name)) {
        // The original was replaced by another file, which the reason does not describe.
        if error.kind() == io::ErrorKind::Interrupted {
            for ending in ["json", "txt"] {
                fs::remove_file(place.join(format!("{stem}.reason.{ending}")))?;
            }
        }
        return Err(error);
    }
    Ok(place.join(file_name))
}

/// The name of the file with the reason beside a rejected drop of this name.
pub(crate) fn reason_name(name: &str) -> String {
    format!("{}.reason.json", shortened(name))
}

/// The text beside a rejected original: the reason, and how to try again.
fn reason_text(
    station: &Path,
    file_name: &OsStr,
    drop: &str,
    original: &Original,
    reason: &Reason,
) -> String {
    let beside = original.companions.iter().map(|companion| name_beside(&companion.path, file_name));
    let settings: String = beside
        .filter(|name| is_sidecar(Path::new(name)) && is_drawing(&file_name.to_string_lossy()))
        .map(|name| {
            format!("Its settings, {}, are beside this file.\n", on_one_line(&name.to_string_lossy()))
        })
        .collect();
    let again = match reason.code.as_str() {
        // It may be marked at another station.
        TAKEN_OVER => String::new(),
        _ => format!("To try again: {}\n", next_step(station, drop, original, reason)),
    };
    let text = format!("{drop} was rejected.\n\n{}\n\n{settings}{again}", reason.to_text());
    text.trim_end().to_owned() + "\n"
}

/// What to do after a rejection, as a sentence or two.
fn next_step(station: &Path, drop: &str, original: &Original, reason: &Reason) -> String {
    if reason.code == "unknown-kind" {
        return "drop a file of another format.".to_owned();
    }
    // The reason is read later, in another folder.
    let station = std::path::absolute(station).unwrap_or_else(|_| station.into());
    let [station, name] = [&*station.to_string_lossy(), drop].map(quoted);
    let retry = on_one_line(&format!("run `isomark retry {station} {name}`"));
    let wrong = reason.place.file.as_deref().map(Path::new).filter(|file| is_sidecar(file));
    let Some(wrong) = wrong else {
        return format!(
            "correct {drop} and drop it again. If only settings were wrong, correct them and {retry}."
        );
    };
    let is_beside =
        original.companions.iter().any(|companion| companion.path.file_name() == wrong.file_name());
    let shown = match wrong.file_name().filter(|_| is_beside) {
        Some(name) => format!("{} in this folder", name.to_string_lossy()),
        None => wrong.display().to_string(),
    };
    format!("correct {}, then {retry}.", on_one_line(&shown))
}

/// The place before a free one: the folder itself, or the previous numbered folder in it.
fn place_before(folder: &Path, free: &Path) -> PathBuf {
    let name = free.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let number = name.strip_prefix('(').and_then(|rest| rest.strip_suffix(')'));
    match number.and_then(|number| number.parse::<u64>().ok()).filter(|_| free != folder) {
        Some(number) if number > 2 => folder.join(format!("({})", number - 1)),
        _ => folder.into(),
    }
}

/// Whether there is a copy of exactly this original: with the same content and the same time of the last write.
fn holds_copy(copy: &Path, original: &Original) -> bool {
    let modified = match look(copy) {
        Ok(Some(Found::File(stamp))) => stamp.modified,
        _ => None,
    };
    match original.content {
        Content::Read(bytes, stamp) => {
            modified.is_some() && modified == stamp.modified && has_content(copy, bytes)
        }
        Content::Seen(stamp) => {
            modified.is_some() && modified == stamp.modified && is_same(original.path, copy)
        }
        Content::Unknown => false,
    }
}

/// Moves one companion into the folder of its part, which was moved before.
pub(crate) fn follow(
    folders: &FolderPaths,
    parking: &Parking,
    companion: &Path,
    place: &Path,
) -> io::Result<()> {
    let Some(companion) = Beside::at(companion) else { return Err(io::ErrorKind::NotFound.into()) };
    let name = companion.path.file_name().unwrap_or_default().to_owned();
    go_along(folders, parking, &companion, &place.join(name))
}

/// Files the original at `target` and its companions beside it. The original is first: an interruption may then only
/// leave a companion without a part, which does no harm. The filed original survives a power cut.
pub(crate) fn put_away(
    folders: &FolderPaths,
    parking: &Parking,
    original: &Original,
    target: &Path,
) -> io::Result<()> {
    let found = look(original.path)?;
    let filed = match original.content {
        Content::Read(bytes, stamp) => {
            if found.is_none() {
                parking.check_removed(folders, original.path)?;
            }
            if !holds_copy(target, original) {
                write_new(target, bytes, stamp.modified)?;
            }
            Some(Filed { stamp, hash: blake3::hash(bytes) })
        }
        Content::Seen(stamp) if holds_copy(target, original) => {
            Some(Filed { stamp, hash: content_hash(target)? })
        }
        Content::Seen(seen) if found.is_some() => {
            let (stamp, hash) = copy_new(original.path, target)?;
            if stamp != seen {
                fs::remove_file(target)?;
                let message = format!("{} was written again", original.path.display());
                return Err(io::Error::new(io::ErrorKind::Interrupted, message));
            }
            Some(Filed { stamp, hash })
        }
        Content::Unknown if found.is_some() => {
            move_new(original.path, target)?;
            flush(target)?;
            None
        }
        Content::Seen(_) | Content::Unknown => None,
    };
    if let Some(filed) = filed {
        parking.take_out(folders, original.path, &filed)?;
    }
    companions_follow(folders, parking, original, target);
    Ok(())
}

/// Makes a moved file survive a power cut, if it can be opened.
fn flush(file: &Path) -> io::Result<()> {
    if let Ok(Some(Found::File(_))) = look(file) {
        // Windows flushes only files that are open for writing.
        let opened = fs::OpenOptions::new().read(true).write(cfg!(windows)).open(file);
        // The file may have been rejected because it cannot be read.
        if let Ok(opened) = opened {
            opened.sync_all()?;
        }
    }
    sync_folder(file.parent().unwrap_or(Path::new("")))
}

fn companions_follow(folders: &FolderPaths, parking: &Parking, original: &Original, target: &Path) {
    for companion in original.companions {
        let name = name_beside(&companion.path, target.file_name().unwrap_or_default());
        match go_along(folders, parking, companion, &target.with_file_name(name)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                tracing::warn!("{} remains in the hot folder: {error}", companion.path.display());
            }
            _ => {}
        }
    }
}

/// Copies a companion to its place and removes it from the hot folder, unless it was written since it was seen.
fn go_along(folders: &FolderPaths, parking: &Parking, companion: &Beside, to: &Path) -> io::Result<()> {
    let path = &companion.path;
    let copied = match &companion.bytes {
        // It was copied before the station was interrupted.
        Some(bytes) if has_content(to, bytes) => Ok(blake3::hash(bytes)),
        Some(bytes) => write_new(to, bytes, companion.stamp.modified).map(|()| blake3::hash(bytes)),
        None if !companion.is_unchanged() && look(path)?.is_some() => {
            let message = "it was written again while its part was read";
            return Err(io::Error::new(io::ErrorKind::Interrupted, message));
        }
        None => copy_new(path, to).map(|(_, hash)| hash),
    };
    let hash = match copied {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists && is_same(path, to) => {
            content_hash(path)?
        }
        copied => copied?,
    };
    parking.take_out(folders, path, &Filed { stamp: companion.stamp, hash })
}

/// The name of a companion beside its original: settings get the pattern's name, so that they are found again.
fn name_beside(companion: &Path, original: &OsStr) -> OsString {
    if is_sidecar(companion) && is_drawing(&original.to_string_lossy()) {
        return Path::new(original).with_extension(SIDECAR).into_os_string();
    }
    companion.file_name().unwrap_or_default().to_owned()
}

fn is_same(a: &Path, b: &Path) -> bool {
    matches!((content_hash(a), content_hash(b)), (Ok(a), Ok(b)) if a == b)
}

/// The names that must be free at the place of an original. Settings belong to every pattern with their stem in the
/// same folder. So the place must contain no settings of another pattern, and no pattern that these settings would
/// belong to.
fn all_names(name: &OsStr, original: &Original) -> Vec<OsString> {
    let companions = original.companions.iter().map(|companion| name_beside(&companion.path, name));
    let mut names: Vec<OsString> = std::iter::once(name.to_owned()).chain(companions).collect();
    let text = name.to_string_lossy();
    if is_drawing(&text) {
        let sibling = |ending| Path::new(name).with_extension(ending).into_os_string();
        if names.contains(&sibling(SIDECAR)) {
            let stem = Path::new(name).file_stem().unwrap_or_default().to_string_lossy();
            names.extend(names_with_stem(&stem).map(OsString::from));
        } else {
            names.push(sibling(SIDECAR));
        }
    }
    names
}

/// A name that leaves room for a suffix: file systems allow 255 bytes.
pub(super) fn shortened(name: &str) -> &str {
    let end = (0..=name.len().min(230)).rev().find(|end| name.is_char_boundary(*end)).unwrap_or(0);
    &name[..end]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hotfolder::seen::folders::read_whole;

    fn folders_in(folder: &Path) -> FolderPaths {
        let [hot, import, archive, rejected, cache, reports, skus, state] =
            ["hot", "import", "archive", "rejected", "cache", "reports", "skus", "state"]
                .map(|name| folder.join(name));
        FolderPaths { hot, import, archive, rejected, cache, reports, skus, state }
    }

    #[test]
    fn no_original_is_filed_beside_the_settings_of_another() {
        let folder = tempfile::tempdir().unwrap();
        let folders = folders_in(folder.path());
        let sku = "can".parse().unwrap();
        let stamp = Stamp { size: 0, modified: None, identity: 0 };
        let beside = |name: &str| Beside { path: name.into(), stamp, bytes: None };
        let place = |name: &str, companions: &[Beside]| {
            let original = Original { path: Path::new(name), content: Content::Unknown, companions };
            let place = archive_place(&folders, &sku, name, &original).unwrap();
            in_archive(&folders, &sku, &place)
        };
        let put = |name: &str| fs::write(folders.archive.join("can").join(name), "").unwrap();
        assert_eq!(place("can@a.dxf", &[beside("can@a.toml")]), "can@a.dxf");
        put("can@a.dxf");
        put("can@a.toml");
        assert_eq!(place("can@a.png", &[]), "(2)/can@a.png");
        put("can@b.png");
        assert_eq!(place("can@b.dxf", &[]), "can@b.dxf");
        assert_eq!(place("can@b.dxf", &[beside("can@b.toml")]), "(2)/can@b.dxf");
        assert_eq!(place("can.glb", &[]), "can.glb");
    }

    const STATION: &str = "station.toml";

    #[test]
    fn the_reason_names_the_file_to_correct_and_the_command() {
        let folder = tempfile::tempdir().unwrap();
        let folders = folders_in(folder.path());
        fs::create_dir_all(&folders.hot).unwrap();
        let station = std::path::absolute(STATION).unwrap();
        let [station, name] = [&*station.to_string_lossy(), "can@1.dxf"].map(quoted);
        let retry = format!("run `isomark retry {station} {name}`.");
        let beside = folders.hot.join("can@1.toml").display().to_string();
        for (code, file, step) in [
            (
                "asked",
                "can@1.dxf",
                format!(
                    "correct can@1.dxf and drop it again. If only settings were wrong, correct them and {retry}"
                ),
            ),
            ("asked", &beside, format!("correct can@1.toml in this folder, then {retry}")),
            ("asked", "skus/can.toml", format!("correct skus/can.toml, then {retry}")),
            ("unknown-kind", "can@1.dxf", "drop a file of another format.".to_owned()),
        ] {
            let path = folders.hot.join("can@1.dxf");
            fs::write(&path, "drawing").unwrap();
            fs::write(&beside, "settings").unwrap();
            let settings = [Beside::at(Path::new(&beside)).unwrap()];
            let original = Original { path: &path, content: Content::Unknown, companions: &settings };
            let reason = Reason::new(code, "As asked.", "Ask for something else.").in_file(file);
            let place = reject(
                STATION.as_ref(),
                &folders,
                &Parking::default(),
                Path::new("can@1.dxf"),
                &original,
                &reason,
                |_| Ok(()),
            );
            let text = fs::read_to_string(place.unwrap().with_file_name("can@1.dxf.reason.txt")).unwrap();
            assert!(text.ends_with(&format!("To try again: {step}\n")), "{text}");
        }
    }

    #[test]
    fn a_reason_never_overwrites_a_rejected_scan_of_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let folders = folders_in(folder.path());
        fs::create_dir_all(&folders.hot).unwrap();
        let reason = Reason::new("asked", "As asked.", "Ask for something else.");
        let reject_drop = |name: &str| {
            let path = folders.hot.join(name);
            fs::write(&path, name).unwrap();
            let original = Original { path: &path, content: Content::Unknown, companions: &[] };
            reject(
                STATION.as_ref(),
                &folders,
                &Parking::default(),
                Path::new(name),
                &original,
                &reason,
                |_| Ok(()),
            )
            .unwrap()
        };
        let scan = reject_drop("can.glb.reason.txt");
        let part = reject_drop("can.glb");
        assert_eq!(fs::read_to_string(scan).unwrap(), "can.glb.reason.txt");
        assert_eq!(part, folders.rejected.join("(2)/can.glb"));
    }

    #[test]
    fn a_new_drop_with_the_name_of_a_processed_one_stays() {
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
        let parking = Parking::default();
        let (bytes, stamp) = read_whole(&path).unwrap().unwrap();
        let original = Original { path: &path, content: Content::Read(&bytes, stamp), companions: &[] };
        drop("second");

        // Its copy is in the archive, or is still to be made.
        remove_copied(&folders, &parking, &original, &archive.join("can.dxf")).unwrap();
        put_away(&folders, &parking, &original, &archive.join("before")).unwrap();
        assert_eq!((content(&path), content(&archive.join("before"))), ("second".into(), "first".into()));

        let (bytes, stamp) = read_whole(&path).unwrap().unwrap();
        let original = Original { path: &path, content: Content::Read(&bytes, stamp), companions: &[] };
        remove_copied(&folders, &parking, &original, &archive.join("copy")).unwrap();
        assert!(!path.exists());
    }

    #[test]
    fn a_file_written_since_it_was_seen_is_not_rejected() {
        let folder = tempfile::tempdir().unwrap();
        let folders = folders_in(folder.path());
        fs::create_dir_all(&folders.hot).unwrap();
        let path = folders.hot.join("can.dxf");
        fs::write(&path, "first").unwrap();
        let Some(Found::File(stamp)) = look(&path).unwrap() else { panic!("a file") };
        fs::write(&path, "another").unwrap();
        let original = Original { path: &path, content: Content::Seen(stamp), companions: &[] };
        let reason = Reason::new("asked", "As asked.", "Ask for something else.");
        let parking = Parking::default();
        let rejected = reject(
            STATION.as_ref(),
            &folders,
            &parking,
            Path::new("can.dxf"),
            &original,
            &reason,
            |_| Ok(()),
        );
        assert_eq!(rejected.unwrap_err().kind(), io::ErrorKind::Interrupted);
        assert_eq!(fs::read_to_string(&path).unwrap(), "another");
        assert_eq!(fs::read_dir(&folders.rejected).unwrap().count(), 0);
    }

    /// The files from the interrupted rejection are used: a drop is rejected once.
    #[test]
    fn an_interrupted_rejection_continues_where_it_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let folders = folders_in(folder.path());
        fs::create_dir_all(&folders.hot).unwrap();
        let path = folders.hot.join("can.dxf");
        let reason = Reason::new("asked", "As asked.", "Ask for something else.");
        let reject_drop = || {
            let (bytes, stamp) = read_whole(&path).unwrap().unwrap();
            let original = Original { path: &path, content: Content::Read(&bytes, stamp), companions: &[] };
            reject(
                STATION.as_ref(),
                &folders,
                &Parking::default(),
                Path::new("can.dxf"),
                &original,
                &reason,
                |_| Ok(()),
            )
            .unwrap()
        };
        for (round, place) in ["can.dxf", "(2)/can.dxf", "(3)/can.dxf"].into_iter().enumerate() {
            fs::write(&path, format!("{round}")).unwrap();
            let time = std::time::UNIX_EPOCH + std::time::Duration::from_secs(1_767_225_600 + round as u64);
            fs::File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
            assert_eq!(reject_drop(), folders.rejected.join(place));
            assert!(!path.exists());
            // As if the rejection had been interrupted before it removed the file.
            fs::copy(folders.rejected.join(place), &path).unwrap();
            fs::File::options().write(true).open(&path).unwrap().set_modified(time).unwrap();
            assert_eq!(reject_drop(), folders.rejected.join(place));
        }
    }
}
