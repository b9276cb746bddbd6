//! The files and folders that the command line names.

use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use super::outcome::{Exit, Failure, Outcome, tell};
use crate::cache::Cache;
use crate::config::{Station, is_reserved_by_windows};
use crate::formats::mesh::PartFile;
use crate::hotfolder::{UsedFolder, known_share_is_there};
use crate::reason::Reason;

/// The content of a file that the user named.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, Failure> {
    std::fs::read(path).map_err(|error| file_trouble("read", path, &error))
}

/// Writes a file that the user named, completely or not at all; into a device or pipe of that name.
pub(super) fn write_file(path: &Path, bytes: &[u8]) -> Outcome {
    write_with(path, |folder, name| match is_device(path) {
        true => write_into(path, bytes),
        false => crate::files::write_whole(folder, name, bytes),
    })
}

/// The same, if `check` accepts the flushed file, read again before it gets its name.
pub(super) fn write_file_if(
    path: &Path,
    bytes: &[u8],
    check: impl FnOnce(&[u8]) -> Result<(), Reason>,
) -> Outcome {
    let mut checked = Ok(());
    write_with(path, |folder, name| {
        if is_device(path) {
            // What a device was given cannot be read again.
            checked = check(bytes);
            return if checked.is_ok() { write_into(path, bytes) } else { Ok(()) };
        }
        checked = crate::files::write_whole_if(folder, name, bytes, check)?;
        Ok(())
    })?;
    checked.map_err(|reason| Failure::rejected(reason.in_file(path.display().to_string())))
}

/// Whether there is a device, a pipe or a socket at a path, such as `/dev/null`, or a link that the system made, such as
/// `/dev/stdout`: a file with its name would replace it. On Windows, `NUL` is one in every folder.
pub(super) fn is_device(path: &Path) -> bool {
    let is_of_system = ["/dev", "/proc"].iter().any(|folder| path.starts_with(folder)) && path.is_symlink();
    let is_null = cfg!(windows) && path.file_name().is_some_and(|name| name.eq_ignore_ascii_case("nul"));
    is_of_system || is_null || path.metadata().is_ok_and(|found| !found.is_file() && !found.is_dir())
}

/// Refuses files beside a drawing that is written into a device.
pub(super) fn can_have_files_beside(out: &Path) -> Outcome {
    if !is_device(out) {
        return Ok(());
    }
    Err(Failure::usage(
        format!("Files are to be written beside {}, which is a device or a pipe.", out.display()),
        "Give `--out` the name of a file.",
    ))
}

/// Appends, because the output of the command may be redirected to the end of a file.
fn write_into(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    std::fs::OpenOptions::new().append(true).open(path)?.write_all(bytes)
}

fn write_with(path: &Path, write: impl FnOnce(&Path, &str) -> std::io::Result<()>) -> Outcome {
    let (folder, name) = (folder_of(path), name_of(path)?);
    if path.is_dir() {
        return Err(file_trouble("write", path, &ErrorKind::IsADirectory.into()));
    }
    if cfg!(windows) && is_reserved_by_windows(&name) && !is_device(path) {
        return Err(Failure::usage(
            format!("Windows reserves the name {name} for a device."),
            "Give the file another name.",
        ));
    }
    write(folder, &name).map_err(|error| file_trouble("write", path, &error))
}

/// Refuses to overwrite a file that is read, or to write two results into one file. Each file comes with its option.
pub(super) fn apart(read: &[&Path], written: &[(&str, &Path)]) -> Outcome {
    let same = |one: &Path, two: &Path| {
        one == two || matches!((one.canonicalize(), two.canonicalize()), (Ok(one), Ok(two)) if one == two)
    };
    for (index, (option, file)) in written.iter().enumerate() {
        if read.iter().any(|read| same(read, file)) {
            return Err(Failure::usage(
                format!("`{option}` names {}, which is also read and would be lost.", file.display()),
                format!("Give `{option}` another name."),
            ));
        }
        if let Some((other, _)) = written[..index].iter().find(|(_, other)| same(other, file)) {
            return Err(Failure::usage(
                format!("`{other}` and `{option}` name the same file, {}.", file.display()),
                "Give each of them another name.",
            ));
        }
    }
    Ok(())
}

/// A file that the user named cannot be read or written.
pub(super) fn file_trouble(verb: &str, path: &Path, error: &std::io::Error) -> Failure {
    let (file, folder) = (path.display(), folder_of(path).display());
    let (what, remedy) = match error.kind() {
        // The shells of other systems replace it.
        ErrorKind::NotFound | ErrorKind::InvalidFilename | ErrorKind::InvalidInput
            if verb == "read" && path.to_string_lossy().contains(['*', '?']) =>
        {
            (
                format!("There is no file {file}: isomark does not replace * and ? in names."),
                "Name each file; with several drawings, run the command once for each, or drop them into a hot folder.".to_owned(),
            )
        }
        ErrorKind::NotFound if verb == "read" => {
            (format!("There is no file {file}."), "Check its name and its folder.".to_owned())
        }
        ErrorKind::NotFound => (
            format!("There is no folder {folder} to write {file} into."),
            "Make the folder, or name another one.".to_owned(),
        ),
        _ if path.is_dir() => (
            format!("The path {file} is a folder; a file is needed."),
            format!("Name a file, such as {}.", path.join("name.dxf").display()),
        ),
        ErrorKind::PermissionDenied => (
            format!("The file {file} may not be {}.", if verb == "read" { "read" } else { "written" }),
            format!("Give yourself the right to {verb} in the folder {folder}, or choose another folder."),
        ),
        _ => (
            format!("Cannot {verb} {file}: {error}."),
            "Check the disk, its free space and its connection, then try again.".to_owned(),
        ),
    };
    Failure::new(Exit::Environment, Reason::new("environment", what, remedy).in_file(file.to_string()))
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

pub(super) fn name_of(path: &Path) -> Result<String, Failure> {
    match path.file_name().and_then(|name| name.to_str()) {
        Some(name) => Ok(name.to_owned()),
        None => Err(Failure::usage(format!("{} is not a file name.", path.display()), "Name a file.")),
    }
}

/// A part with the files beside it that it needs.
pub(super) fn read_part(path: &Path) -> Result<PartFile, Failure> {
    let name = name_of(path)?;
    let read = |buffer: &str| crate::files::read_beside(path, buffer);
    PartFile::with_buffers(name.clone(), read_file(path)?, read)
        .map_err(|error| Failure::rejected(error.reason().in_file(name)))
}

/// The station's settings, if one is named.
pub(super) fn station(file: Option<&Path>) -> Result<Option<Station>, Failure> {
    Ok(file.map(Station::load).transpose()?)
}

/// Checks that a folder of the station is not the empty mount point of a share that the station uses: there, SKUs and surfaces would
/// seem to be removed.
pub(super) fn share_is_there(station: &Station, used: UsedFolder) -> Outcome {
    known_share_is_there(&station.folders, used).map_err(|missing| Failure::new(Exit::Environment, missing))
}

/// The cache to use: the named folder, else the station's, else the user's own.
pub(super) fn cache_of(named: Option<&Path>, station: Option<&Station>) -> Result<Cache, Failure> {
    known_cache(named, station).ok_or_else(|| {
        Failure::usage(
            "No folder is known for fitted surfaces.",
            "Name it with `--cache`, or a station with `--station`.",
        )
    })
}

/// Like [`cache_of`]; `None` if the environment names no folder of the user, as for some services.
pub(super) fn known_cache(named: Option<&Path>, station: Option<&Station>) -> Option<Cache> {
    if let Some(folder) = named {
        return Some(Cache::new(folder));
    }
    if let Some(station) = station {
        return Some(Cache::new(&station.folders.cache));
    }
    let variable = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let user = if cfg!(windows) {
        variable("LOCALAPPDATA")
    } else {
        variable("XDG_CACHE_HOME").or_else(|| variable("HOME").map(|home| home.join(".cache")))
    };
    user.map(|folder| Cache::new(folder.join("isomark")))
}

/// The name of a result beside the corrected drawing, with this text in place of `.dxf`.
pub(super) fn beside(out: &Path, ending: &str) -> PathBuf {
    let stem = out.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    out.with_file_name(format!("{stem}.{ending}"))
}

/// Most files of earlier marks that are named.
const MOST_STALE: usize = 20;

/// Warns of drawings beside the corrected one that are named like parts of it, but are not among its `files`: they may be
/// of an earlier mark. `letter` begins the names of such parts, before a number with its sign.
pub(super) fn tell_of_others(out: &Path, letter: char, files: &[PathBuf]) {
    let start = beside(out, &letter.to_string());
    let start = start.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let is_part = |name: &str| {
        let number = name.strip_prefix(&start).and_then(|rest| rest.strip_suffix(".dxf"));
        number.is_some_and(|number| number.starts_with(['+', '-']) && number.parse::<f64>().is_ok())
    };
    let is_written =
        |name: &str| files.iter().any(|file| file.file_name().is_some_and(|known| known == name));
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tell_of_stale(folder, |name| is_part(name) && !is_written(name));
}

/// Warns of the files of a folder whose names are those of an earlier mark.
pub(super) fn tell_of_stale(folder: &Path, is_stale: impl Fn(&str) -> bool) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    let mut stale: Vec<String> = names.filter(|name| is_stale(name)).collect();
    stale.sort();
    if stale.is_empty() {
        return;
    }
    let more = match stale.len().saturating_sub(MOST_STALE) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    stale.truncate(MOST_STALE);
    tell(&format!(
        "isomark: warning: not part of this mark, perhaps of an earlier one: {}{more}; remove what is not to be marked",
        stale.join(", ")
    ));
}
