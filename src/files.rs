//! Atomic files: written to a temporary file in the same folder, flushed, renamed. No reader ever sees an incomplete
//! file.

use std::io::{self, ErrorKind, Write};
use std::path::{Component, Path};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use fs_err as fs;

/// What survives a power cut after a file is written.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Flush {
    /// Nothing is certain; the file may exist and be empty.
    Nothing,
    /// The content is complete if the file exists under its name.
    Content,
    /// Content and name survive.
    All,
}

/// Writes a file atomically, replacing an older one of the same name. When this returns, the file survives a power cut.
///
/// # Errors
/// When the folder cannot be written to or the disk is full; the older file is then unchanged.
pub fn write_whole(folder: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    write_over(folder, name, bytes, Flush::All)
}

/// Writes a file atomically, replacing an older one of the same name. After a power cut, there is the complete new
/// file, the older file, or no file.
///
/// # Errors
/// When the folder cannot be written to or the disk is full; the older file is then unchanged.
pub fn write_whole_or_not(folder: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    write_over(folder, name, bytes, Flush::Content)
}

/// Writes a file as [`write_whole`] does, but only if `check` accepts the content read back from the flushed file
/// before the rename. The inner error is that of `check`; the older file is then unchanged.
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
        io::Error::other(format!("cannot read back the file written for {}: {error}", name.display()))
    };
    let read = std::fs::read(file.path()).map_err(unreadable)?;
    match check(&read) {
        Ok(()) => keep(file, folder, name, Flush::All).map(Ok),
        Err(rejected) => Ok(Err(rejected)),
    }
}

/// A temporary file with this content, flushed unless `flush` is [`Flush::Nothing`].
fn written(folder: &Path, bytes: &[u8], flush: Flush) -> io::Result<tempfile::NamedTempFile> {
    let mut file = temporary(folder)?;
    write_all(&mut file, bytes, folder)?;
    if flush != Flush::Nothing {
        file.as_file().sync_all()?;
    }
    Ok(file)
}

/// Renames a temporary file, replacing an older file.
fn keep(file: tempfile::NamedTempFile, folder: &Path, name: &str, flush: Flush) -> io::Result<()> {
    persist_over(file, &folder.join(name))?;
    if flush == Flush::All { sync_folder(folder) } else { Ok(()) }
}

/// Renames a temporary file, replacing an older file, without flushing the folder.
///
/// # Errors
/// When the folder cannot be written to, or Windows does not replace the older file because another program keeps it open.
pub(crate) fn persist_over(mut file: tempfile::NamedTempFile, path: &Path) -> io::Result<()> {
    let (place, mut reader) = (in_full(path), Reader::default());
    while let Err(failed) = file.persist(&place) {
        if !reader.may_finish(&failed.error) {
            return Err(named(failed.error, "cannot write", path));
        }
        file = failed.file;
    }
    Ok(())
}

/// Renames a file in a folder that can be written to, replacing an older file.
///
/// # Errors
/// When the folder cannot be written to; `ResourceBusy` when another program keeps the older file open and Windows therefore does not
/// replace it.
#[cfg(feature = "station")]
pub(crate) fn rename_over(from: &Path, to: &Path) -> io::Result<()> {
    let mut reader = Reader::default();
    while let Err(error) = std::fs::rename(from, to) {
        if !reader.may_finish(&error) {
            let kind = if is_held_open(to) { ErrorKind::ResourceBusy } else { error.kind() };
            return Err(named(io::Error::new(kind, error.to_string()), "cannot write", to));
        }
    }
    Ok(())
}

/// Whether another program has a file open in a way in which Windows neither replaces nor removes it.
#[cfg(all(feature = "station", windows))]
fn is_held_open(path: &Path) -> bool {
    use std::os::windows::fs::OpenOptionsExt;
    /// The right to remove a file, and what others may do meanwhile: read, write and remove it.
    const DELETE: u32 = 0x0001_0000;
    const SHARED: u32 = 7;
    let opened = std::fs::OpenOptions::new().access_mode(DELETE).share_mode(SHARED).open(in_full(path));
    opened.is_err_and(|error| error.raw_os_error() == Some(SHARING_VIOLATION))
}

/// Other systems replace files that are open.
#[cfg(all(feature = "station", not(windows)))]
fn is_held_open(_path: &Path) -> bool {
    false
}

/// What Windows answers where another program has a file open, or a part of it locked.
const SHARING_VIOLATION: i32 = 32;
const LOCK_VIOLATION: i32 = 33;

/// Somebody who reads a file that is to be replaced or renamed, such as an importer or a virus scanner: meanwhile, Windows denies it.
#[derive(Default)]
struct Reader {
    /// How often it was waited for.
    waits: u32,
}

impl Reader {
    /// Waits a moment if this may be why the file could not be replaced, for half a second in all.
    fn may_finish(&mut self, error: &io::Error) -> bool {
        let is_of_reader = error.kind() == ErrorKind::PermissionDenied
            || [SHARING_VIOLATION, LOCK_VIOLATION].map(Some).contains(&error.raw_os_error());
        let may_read = cfg!(windows) && is_of_reader && self.waits < 20;
        if may_read {
            self.waits += 1;
            std::thread::sleep(Duration::from_millis(25));
        }
        may_read
    }
}

/// Writes a file atomically, replacing an older one of the same name, without flushing it: for files that can be made
/// again after a power cut.
///
/// # Errors
/// When the folder cannot be written to or the disk is full; the older file is then unchanged.
pub fn write_whole_unsynced(folder: &Path, name: &str, bytes: &[u8]) -> io::Result<()> {
    write_over(folder, name, bytes, Flush::Nothing)
}

/// Writes files of these names atomically into a folder, each as [`write_whole_or_not`] does. They are flushed at the same time:
/// a file system writes the flushes that wait for it together.
///
/// # Errors
/// When the folder cannot be written to or the disk is full; each older file is then unchanged, or replaced by its new one.
#[cfg(feature = "station")]
pub(crate) fn write_all_or_not(folder: &Path, files: &[(String, &[u8])]) -> io::Result<()> {
    let new = files.iter().map(|(_, bytes)| written(folder, bytes, Flush::Nothing));
    let new: Vec<_> = new.collect::<io::Result<_>>()?;
    flush_together(&new)?;
    for (file, (name, _)) in new.into_iter().zip(files) {
        keep(file, folder, name, Flush::Content)?;
    }
    Ok(())
}

/// Flushes temporary files at the same time, each in a thread; those for which there is no thread one after the other.
#[cfg(feature = "station")]
fn flush_together(files: &[tempfile::NamedTempFile]) -> io::Result<()> {
    let Some((last, others)) = files.split_last() else { return Ok(()) };
    std::thread::scope(|scope| {
        let mut begun = Vec::new();
        for file in others.iter().map(tempfile::NamedTempFile::as_file) {
            begun.push((file, std::thread::Builder::new().spawn_scoped(scope, || file.sync_all())));
        }
        let mut result = last.as_file().sync_all();
        for (file, thread) in begun {
            let flushed = match thread {
                Ok(thread) => thread.join().unwrap_or_else(|_| Err(ErrorKind::Other.into())),
                Err(_) => file.sync_all(),
            };
            result = result.and(flushed);
        }
        result
    })
}

fn write_over(folder: &Path, name: &str, bytes: &[u8], flush: Flush) -> io::Result<()> {
    keep(written(folder, bytes, flush)?, folder, name, flush)
}

/// Writes a new file, never replacing an older one, and sets its modification time where the file system supports it.
/// When this returns, the file survives a power cut.
///
/// # Errors
/// `AlreadyExists` if a file of this name exists; otherwise as [`write_whole`].
#[cfg(feature = "station")]
pub(crate) fn write_new(path: &Path, bytes: &[u8], modified: Option<SystemTime>) -> io::Result<()> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut file = temporary(folder)?;
    write_all(&mut file, bytes, folder)?;
    keep_new(file, path, modified)
}

/// Renames a temporary file, never replacing another file, and sets its modification time. When this returns, the file
/// survives a power cut.
///
/// # Errors
/// `AlreadyExists` if a file of this name exists.
#[cfg(feature = "station")]
pub(crate) fn keep_new(
    file: tempfile::NamedTempFile,
    path: &Path,
    modified: Option<SystemTime>,
) -> io::Result<()> {
    if let Some(modified) = modified {
        // The time is only for people, so it does not matter if the file system cannot set it.
        let _ = file.as_file().set_modified(modified);
    }
    file.as_file().sync_all()?;
    file.persist_noclobber(in_full(path)).map_err(|error| named(error.error, "cannot write", path))?;
    sync_folder(path.parent().unwrap_or(Path::new("")))
}

/// Start and end of the names of incomplete files; importers and this program ignore them.
pub(crate) const TEMPORARY_START: &str = ".isomark-";
pub(crate) const TEMPORARY_END: &str = ".part";

/// Writes a file in place, replacing an older one of the same name; file and name survive a power cut. Readable for
/// everybody.
///
/// # Errors
/// When the folder cannot be written to or the disk is full; the file may then be incomplete.
pub fn write_flushed(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut options = fs::OpenOptions::new();
    options.create(true).truncate(true).write(true);
    let mut file = options.open(path)?;
    // Independent of the umask of the station's user, because another user imports the file.
    #[cfg(unix)]
    file.set_permissions(std::os::unix::fs::PermissionsExt::from_mode(0o644))?;
    file.write_all(bytes)?;
    file.sync_all()?;
    sync_folder(path.parent().unwrap_or(Path::new("")))
}

/// A temporary file that is readable for everybody; importers and this program ignore its name.
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

/// The path in the form that Windows accepts at any length; in other forms, some calls accept only 259 characters.
#[cfg(windows)]
pub(crate) fn in_full(path: &Path) -> std::path::PathBuf {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match (std::fs::canonicalize(folder), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path.into(),
    }
}

/// Other systems accept the path unchanged.
#[cfg(not(windows))]
pub(crate) fn in_full(path: &Path) -> std::path::PathBuf {
    path.into()
}

/// Writes into a temporary file.
fn write_all(file: &mut tempfile::NamedTempFile, bytes: &[u8], folder: &Path) -> io::Result<()> {
    file.as_file_mut().write_all(bytes).map_err(|error| named(error, "cannot write into", folder))
}

/// The error without the temporary file's name. The name changes each time, but the same error must be reported only
/// once.
fn without_path(error: &io::Error) -> io::Error {
    let text = error.to_string();
    io::Error::new(error.kind(), text.split(" at path ").next().unwrap_or_default())
}

/// Makes a rename in the folder survive a power cut, where the file system supports it.
#[cfg(unix)]
pub(crate) fn sync_folder(folder: &Path) -> io::Result<()> {
    use ErrorKind::{InvalidInput, PermissionDenied, Unsupported};
    match fs::File::open(folder).and_then(|folder| folder.sync_all()) {
        Err(error) if !matches!(error.kind(), InvalidInput | PermissionDenied | Unsupported) => Err(error),
        _ => Ok(()),
    }
}

/// Windows writes the folder's entry to the disk itself.
#[cfg(not(unix))]
pub(crate) fn sync_folder(_: &Path) -> io::Result<()> {
    Ok(())
}

/// When a file was written, ms since 1970 by the clock of the computer that wrote it; `None` if it does not exist.
pub(crate) fn written_at_ms(path: &Path) -> io::Result<Option<u64>> {
    match fs::metadata(path) {
        Ok(metadata) => metadata.modified().map(|at| Some(ms_since_1970(at))),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// This moment by the clock of this computer, ms since 1970.
pub(crate) fn now_ms() -> u64 {
    ms_since_1970(SystemTime::now())
}

/// A moment of the calendar, ms since 1970; 0 before.
pub(crate) fn ms_since_1970(at: SystemTime) -> u64 {
    let since = at.duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}

/// The content of a file; `None` if it does not exist.
///
/// # Errors
/// When the file exists and cannot be read.
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
/// `InvalidInput` if `name` is not a plain file name ([`is_plain`]), or when the file cannot be read.
pub fn read_beside(path: &Path, name: &str) -> io::Result<Vec<u8>> {
    if !is_plain(name) {
        let text = format!("`{name}` does not name a file in the same folder");
        return Err(io::Error::new(ErrorKind::InvalidInput, text));
    }
    fs::read(path.with_file_name(name))
}

/// Whether the name is a plain file name, without a path.
pub fn is_plain(name: &str) -> bool {
    let mut components = Path::new(name).components();
    let single = matches!((components.next(), components.next()), (Some(Component::Normal(_)), None));
    single && !name.contains(['/', '\\', ':'])
}

/// Creates a folder, if it does not exist, with the owner of its parent folder: a folder that an administrator's
/// command creates must stay writable for the user that runs the station.
///
/// # Errors
/// When it cannot be created.
#[cfg(feature = "station")]
pub(crate) fn make_folder(folder: &Path) -> io::Result<()> {
    match fs::create_dir(folder) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => return Ok(()),
        made => made?,
    }
    #[cfg(unix)]
    if let Some(owner) = folder.parent().and_then(|parent| fs::metadata(parent).ok()) {
        use std::os::unix::fs::{MetadataExt, chown};
        // Only an administrator may do this, and only for an administrator is it needed.
        let _ = chown(folder, Some(owner.uid()), Some(owner.gid()));
    }
    Ok(())
}

/// The error with the path at which it occurred.
pub(crate) fn named(error: io::Error, verb: &str, path: &Path) -> io::Error {
    io::Error::new(error.kind(), format!("{verb} {}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_replaces_the_old_one_and_is_readable_for_others() {
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

    /// Other systems replace files that are open.
    #[cfg(windows)]
    #[test]
    fn a_file_is_replaced_when_its_reader_has_finished() {
        use std::os::windows::fs::OpenOptionsExt;
        const SHARED_FOR_READING: u32 = 1;
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("x.dxf");
        let read_for = |time: Duration| {
            let file = std::fs::OpenOptions::new().read(true).share_mode(SHARED_FOR_READING).open(&place);
            let file = file.unwrap();
            std::thread::spawn(move || {
                std::thread::sleep(time);
                drop(file);
            })
        };
        write_whole(folder.path(), "x.dxf", b"first").unwrap();
        let reader = read_for(Duration::from_millis(100));
        write_whole(folder.path(), "x.dxf", b"second").unwrap();
        reader.join().unwrap();
        assert_eq!(fs::read(&place).unwrap(), b"second");
        #[cfg(feature = "station")]
        {
            let new = folder.path().join("new");
            fs::write(&new, b"third").unwrap();
            let reader = read_for(Duration::from_secs(2));
            assert_eq!(rename_over(&new, &place).unwrap_err().kind(), ErrorKind::ResourceBusy);
            reader.join().unwrap();
            rename_over(&new, &place).unwrap();
            assert_eq!(fs::read(&place).unwrap(), b"third");
        }
    }

    #[test]
    fn a_rejected_file_leaves_the_older_one_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let write = |content: &str, expected: &str| {
            let check = |read: &[u8]| if read == expected.as_bytes() { Ok(()) } else { Err(read.to_vec()) };
            write_whole_if(folder.path(), "x.dxf", content.as_bytes(), check).unwrap()
        };
        assert_eq!(write("first", "first"), Ok(()));
        assert_eq!(write("second", "other"), Err(b"second".to_vec()));
        assert_eq!(fs::read(folder.path().join("x.dxf")).unwrap(), b"first");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn a_new_folder_has_the_owner_of_its_parent() {
        use std::os::unix::fs::{MetadataExt, chown};
        let folder = tempfile::tempdir().unwrap();
        // Only an administrator can change the owner.
        let is_administrator = chown(folder.path(), Some(12_345), Some(12_345)).is_ok();
        let made = folder.path().join("requests");
        for _ in 0..2 {
            make_folder(&made).unwrap();
        }
        let [outer, inner] = [folder.path(), &made].map(|path| fs::metadata(path).unwrap());
        assert_eq!((inner.uid(), inner.gid()), (outer.uid(), outer.gid()));
        assert!(!is_administrator || inner.uid() == 12_345);
    }

    /// A station that tries again reports an error only if its text is new.
    #[test]
    fn the_same_error_has_the_same_text() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("missing");
        let error = || write_whole(&missing, "x.dxf", b"x").unwrap_err();
        assert_eq!(error().kind(), ErrorKind::NotFound);
        assert_eq!(error().to_string(), error().to_string());
        assert!(error().to_string().contains("os error"), "{}", error());
    }

    #[test]
    fn a_new_file_never_replaces_an_old_one() {
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
