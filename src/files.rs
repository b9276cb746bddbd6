//! Whole files: written beside their target, flushed, renamed. Nobody ever sees a part of one.

use std::io::{self, ErrorKind, Write};
use std::path::Path;

use fs_err as fs;

/// Writes a file so that nobody ever sees a part of it, over an older one of the same name. When it returns, the file
/// survives a power cut.
///
/// # Errors
/// When the folder cannot be written to or the disk is full; the older file is then untouched.
pub fn write_whole(folder: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    let mut file = temporary(folder)?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    file.persist(folder.join(name))
        .map_err(|error| named(error.error, "cannot write", &folder.join(name)))?;
    sync_folder(folder)
}

/// Writes a file so that nobody ever sees a part of it, over an older one of the same name. A power cut may take it
/// away again: for what can be made anew.
///
/// # Errors
/// When the folder cannot be written to or the disk is full; the older file is then untouched.
pub fn write_whole_unsynced(folder: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    let mut file = temporary(folder)?;
    file.write_all(bytes)?;
    file.persist(folder.join(name))
        .map_err(|error| named(error.error, "cannot write", &folder.join(name)))?;
    Ok(())
}

/// A file whose name importers and this program itself ignore, readable for everybody.
///
/// # Errors
/// When the folder cannot be written to.
pub fn temporary(folder: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".isomark-").suffix(".part");
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o644));
    builder.tempfile_in(folder).map_err(|error| named(error, "cannot write into", folder))
}

/// Makes a rename in the folder survive a power cut, where the file system can.
///
/// # Errors
/// When the disk fails.
#[cfg(unix)]
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    use ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
    match fs::File::open(folder).and_then(|folder| folder.sync_all()) {
        Err(error) if !matches!(error.kind(), InvalidInput | PermissionDenied | Unsupported) => Err(error),
        _ => Ok(()),
    }
}

/// Windows writes the folder's entry through by itself.
///
/// # Errors
/// Never.
#[cfg(not(unix))]
pub fn sync_folder(_: &Path) -> io::Result<()> {
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

/// The error with the path it happened at.
pub fn named(error: io::Error, verb: &str, path: &Path) -> io::Error {
    io::Error::new(error.kind(), format!("{verb} {}: {error}", path.display()))
}
