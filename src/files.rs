//! Whole files: written beside their target, flushed, renamed. Nobody ever sees a part of one.

use std::io::{self, ErrorKind, Write};
use std::path::{Component, Path};
#[cfg(feature = "station")]
use std::time::SystemTime;

use fs_err as fs;

/// What of a new file survives a power cut.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Flush {
    /// Nothing for certain; a file of that name may be there and empty.
    Nothing,
    /// Its content, if its name does.
    Content,
    /// Content and name.
    All,
}

/// Writes a file so that nobody ever sees a part of it, over an older one of the same name. When it returns, the file
/// survives a power cut.
///
/// # Errors
/// When the folder cannot be written to or the disk is full; the older file is then untouched.
pub fn write_whole(folder: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    write_over(folder, name, bytes, Flush::All)
}

/// Writes a file so that nobody ever sees a part of it, over an older one of the same name. After a power cut it is whole,
/// or the older file is there, or none.
///
/// # Errors
/// When the folder cannot be written to or the disk is full; the older file is then untouched.
pub fn write_whole_or_not(folder: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    write_over(folder, name, bytes, Flush::Content)
}

/// Writes a file as [`write_whole`] does, if `check` accepts what is read of the flushed file before it gets its name. The
/// inner error is that of `check`; the older file is then untouched.
///
/// # Errors
/// As [`write_whole`], and when the file cannot be read again.
pub fn write_whole_if<E>(
    folder: &Path,
    name: &str,
    bytes: &[u8],
    check: impl FnOnce(&[u8]) -> Result<(), E>,
) -> io::Result<Result<(), E>> {
    let file = written(folder, bytes, Flush::All)?;
    let unreadable = |error: io::Error| {
        let (name, error) = (folder.join(name), without_path(&error));
        io::Error::other(format!("what was written for {} cannot be read again: {error}", name.display()))
    };
    let read = std::fs::read(file.path()).map_err(unreadable)?;
    match check(&read) {
        Ok(()) => keep(file, folder, name, Flush::All).map(Ok),
        Err(refused) => Ok(Err(refused)),
    }
}

/// A temporary file with this content, flushed if that is asked for.
fn written(folder: &Path, bytes: &[u8], flush: Flush) -> io::Result<tempfile::NamedTempFile> {
    let mut file = temporary(folder)?;
    write_all(&mut file, bytes, folder)?;
    if flush != Flush::Nothing {
        file.as_file().sync_all()?;
    }
    Ok(file)
}

/// Gives a temporary file its name, over an older file.
fn keep(file: tempfile::NamedTempFile, folder: &Path, name: &str, flush: Flush) -> io::Result<()> {
    file.persist(in_full(&folder.join(name)))
        .map_err(|error| named(error.error, "cannot write", &folder.join(name)))?;
    if flush == Flush::All { sync_folder(folder) } else { Ok(()) }
}

/// Writes a file so that nobody ever sees a part of it, over an older one of the same name. A power cut may take it
/// away again: for what can be made anew.
///
/// # Errors
/// When the folder cannot be written to or the disk is full; the older file is then untouched.
pub fn write_whole_unsynced(folder: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    write_over(folder, name, bytes, Flush::Nothing)
}

fn write_over(folder: &Path, name: &str, bytes: &[u8], flush: Flush) -> io::Result<()> {
    keep(written(folder, bytes, flush)?, folder, name, flush)
}

/// Writes a new file and never over an older one, with the time of the last write that it is given where the file system
/// takes it. When it returns, the file survives a power cut.
///
/// # Errors
/// `AlreadyExists` when the name is taken; else as [`write_whole`].
#[cfg(feature = "station")]
pub(crate) fn write_new(path: &Path, bytes: &[u8], modified: Option<SystemTime>) -> io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut file = temporary(folder)?;
    write_all(&mut file, bytes, folder)?;
    keep_new(file, path, modified)
}

/// Gives a temporary file its name, never over another file, and the time of its last write. When it returns, the file
/// survives a power cut.
///
/// # Errors
/// `AlreadyExists` when the name is taken.
#[cfg(feature = "station")]
pub(crate) fn keep_new(
    file: tempfile::NamedTempFile,
    path: &Path,
    modified: Option<SystemTime>,
) -> io::Result<()> {
    if let Some(modified) = modified {
        // The time is for people; a file system that cannot set it is no obstacle.
        let _ = file.as_file().set_modified(modified);
    }
    file.as_file().sync_all()?;
    file.persist_noclobber(in_full(path)).map_err(|error| named(error.error, "cannot write", path))?;
    sync_folder(path.parent().unwrap_or(Path::new("")))
}

/// How the names of files begin and end that are not whole yet; importers and this program itself ignore them.
pub(crate) const TEMPORARY_START: &str = ".isomark-";
pub(crate) const TEMPORARY_END: &str = ".part";

/// Writes a file, over an older one of the same name, so that file and name survive a power cut. Readable for everybody.
///
/// # Errors
/// When the folder cannot be written to or the disk is full; a part of the file may then be there.
pub fn write_flushed(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut options = fs::OpenOptions::new();
    options.create(true).truncate(true).write(true);
    let mut file = options.open(path)?;
    // Whatever the mask of the user that the station runs as: others import the file.
    #[cfg(unix)]
    file.set_permissions(std::os::unix::fs::PermissionsExt::from_mode(0o644))?;
    file.write_all(bytes)?;
    file.sync_all()?;
    sync_folder(path.parent().unwrap_or(Path::new("")))
}

/// A file whose name importers and this program itself ignore, readable for everybody.
pub(crate) fn temporary(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY_START).suffix(TEMPORARY_END);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o644));
    let place = in_full(&folder.join(TEMPORARY_START));
    builder
        .tempfile_in(place.parent().unwrap_or(folder))
        .map_err(|error| named(without_path(&error), "cannot write into", folder))
}

/// The path as Windows takes it at any length; some of its calls take 259 characters of others.
#[cfg(windows)]
pub(crate) fn in_full(path: &Path) -> std::path::PathBuf {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match (std::fs::canonicalize(folder), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path.into(),
    }
}

/// Elsewhere a path is taken as it is.
#[cfg(not(windows))]
pub(crate) fn in_full(path: &Path) -> std::path::PathBuf {
    path.into()
}

/// Writes into a temporary file.
fn write_all(file: &mut tempfile::NamedTempFile, bytes: &[u8], folder: &Path) -> io::Result<()> {
    file.as_file_mut().write_all(bytes).map_err(|error| named(error, "cannot write into", folder))
}

/// The error without the temporary file's name, which is another each time: the same trouble is to be told once.
fn without_path(error: &io::Error) -> io::Error {
    let words = error.to_string();
    io::Error::new(error.kind(), words.split(" at path ").next().unwrap_or_default())
}

/// Makes a rename in the folder survive a power cut, where the file system can.
#[cfg(unix)]
pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    use ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
    match fs::File::open(folder).and_then(|folder| folder.sync_all()) {
        Err(error) if !matches!(error.kind(), InvalidInput | PermissionDenied | Unsupported) => Err(error),
        _ => Ok(()),
    }
}

/// Windows writes the folder's entry through by itself.
#[cfg(not(unix))]
pub(crate) fn sync_folder(_: &Path) -> io::Result<()> {
    Ok(())
}

/// The content of a file; `None` when there is none.
///
/// # Errors
/// When it is there and cannot be read.
pub fn read_if_there(path: &Path) -> io::Result<Option<Vec<u8>>> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// The content of the file `name` beside the file at `path`, such as a buffer of a `.gltf`.
///
/// # Errors
/// `InvalidInput` when `name` leads into another folder ([`is_plain`]); else when the file cannot be read.
pub fn read_beside(path: &Path, name: &str) -> io::Result<Vec<u8>> {
    if !is_plain(name) {
        let words = format!("`{name}` does not name a file in the same folder");
        return Err(io::Error::new(ErrorKind::InvalidInput, words));
    }
    fs::read(path.with_file_name(name))
}

/// Whether the name names a file in the same folder, and nothing else.
pub fn is_plain(name: &str) -> bool {
    let mut components = Path::new(name).components();
    let single = matches!((components.next(), components.next()), (Some(Component::Normal(_)), None));
    single && !name.contains(['/', '\\', ':'])
}

/// Makes a folder for whoever owns the one it lies in, if it is not there: what an administrator's command makes must not
/// stand in the way of the user that runs the station.
///
/// # Errors
/// When it cannot be made.
#[cfg(feature = "station")]
pub(crate) fn make_folder(folder: &Path) -> io::Result<()> {
    match fs::create_dir(folder) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => return Ok(()),
        made => made?,
    }
    #[cfg(unix)]
    if let Some(owner) = folder.parent().and_then(|parent| fs::metadata(parent).ok()) {
        use std::os::unix::fs::{MetadataExt, chown};
        // Only an administrator may, and only an administrator has to.
        let _ = chown(folder, Some(owner.uid()), Some(owner.gid()));
    }
    Ok(())
}

/// The error with the path it happened at.
pub(crate) fn named(error: io::Error, verb: &str, path: &Path) -> io::Error {
    io::Error::new(error.kind(), format!("{verb} {}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_written_over_the_old_one_and_readable_for_others() {
        let folder = tempfile::tempdir().unwrap();
        for content in ["first", "second"] {
            write_whole(folder.path(), "x.dxf", content.as_bytes()).unwrap();
            assert_eq!(fs::read(folder.path().join("x.dxf")).unwrap(), content.as_bytes());
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode = fs::metadata(folder.path().join("x.dxf")).unwrap().permissions().mode();
            assert_eq!(mode & 0o444, 0o444);
        }
    }

    #[test]
    fn a_file_that_is_refused_leaves_the_older_one_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let write = |content: &str, word: &str| {
            let check = |read: &[u8]| if read == word.as_bytes() { Ok(()) } else { Err(read.to_vec()) };
            write_whole_if(folder.path(), "x.dxf", content.as_bytes(), check).unwrap()
        };
        assert_eq!(write("first", "first"), Ok(()));
        assert_eq!(write("second", "other"), Err(b"second".to_vec()));
        assert_eq!(fs::read(folder.path().join("x.dxf")).unwrap(), b"first");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn a_folder_that_an_administrator_makes_belongs_to_whom_it_is_made_for() {
        use std::os::unix::fs::{MetadataExt, chown};
        let folder = tempfile::tempdir().unwrap();
        // Nobody else may give a folder away.
        let given_away = chown(folder.path(), Some(12_345), Some(12_345)).is_ok();
        let made = folder.path().join("requests");
        for _ in 0..2 {
            make_folder(&made).unwrap();
        }
        let [outer, inner] = [folder.path(), &made].map(|path| fs::metadata(path).unwrap());
        assert_eq!((inner.uid(), inner.gid()), (outer.uid(), outer.gid()));
        assert!(!given_away || inner.uid() == 12_345);
    }

    /// Whoever tries again tells only what is new.
    #[test]
    fn the_same_trouble_is_told_in_the_same_words() {
        let folder = tempfile::tempdir().unwrap();
        let gone = folder.path().join("gone");
        let trouble = || write_whole(&gone, "x.dxf", b"x").unwrap_err();
        assert_eq!(trouble().kind(), ErrorKind::NotFound);
        assert_eq!(trouble().to_string(), trouble().to_string());
        assert!(trouble().to_string().contains("os error"), "{}", trouble());
    }

    #[test]
    fn a_new_file_is_never_written_over_an_old_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.dxf");
        write_new(&path, b"first", None).unwrap();
        assert_eq!(write_new(&path, b"second", None).unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!(read_if_there(&path).unwrap().unwrap(), b"first");
    }

    #[test]
    fn only_plain_names_are_read_beside_a_file() {
        let folder = tempfile::tempdir().unwrap();
        write_whole_unsynced(folder.path(), "can.bin", b"x").unwrap();
        let part = folder.path().join("can.gltf");
        assert_eq!(read_beside(&part, "can.bin").unwrap(), b"x");
        assert!(is_plain("can.bin"));
        for name in ["", ".", "..", "../can.bin", "a/b.bin", r"a\b.bin", "C:x.bin", "/etc/passwd"] {
            assert!(!is_plain(name), "{name}");
            assert_eq!(read_beside(&part, name).unwrap_err().kind(), ErrorKind::InvalidInput);
        }
    }
}
