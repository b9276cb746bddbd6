//! Operations on folders: list, read a file that does not change meanwhile, move without overwriting.

use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use fs_err as fs;

use super::{Stamp, is_ignored};
use crate::files::{in_full, keep_new, named, temporary};

/// The largest file that is accepted, bytes: it is kept in memory, and fitting it needs a few times as much.
pub(crate) const LARGEST_DROP: u64 = 1 << 30;

/// How much of a file is copied at a time, bytes.
const COPY_BUFFER: usize = 1 << 16;

/// The kind of thing at a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Found {
    /// A file.
    File(Stamp),
    /// A folder.
    Folder,
    /// A link, a device or a pipe: never a drop.
    Other(Stamp),
}

/// The identity of a folder: a folder that was removed and created again has another one.
pub(crate) type Identity = u64;

/// What is at the path; `None` if nothing is.
pub(crate) fn look(path: &Path) -> io::Result<Option<Found>> {
    match fs::symlink_metadata(path) {
        Ok(metadata) if metadata.is_file() => Ok(Some(Found::File(stamp(&metadata)))),
        Ok(metadata) if metadata.is_dir() => Ok(Some(Found::Folder)),
        Ok(metadata) => Ok(Some(Found::Other(stamp(&metadata)))),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// Whether a file is at the path.
pub(crate) fn is_file(path: &Path) -> bool {
    matches!(look(path), Ok(Some(Found::File(_))))
}

/// The identity of the folder at the path, if there is one.
pub(crate) fn identity(folder: &Path) -> Option<Identity> {
    let metadata = fs::metadata(folder).ok()?;
    // The inode of a removed folder is soon used again; the creation time differs.
    metadata.is_dir().then(|| file_identity(&metadata) ^ creation(&metadata).rotate_left(32))
}

/// Whether the open file is still the one at the path.
pub(crate) fn is_still_at(file: &std::fs::File, path: &Path) -> bool {
    let identity = |metadata: &std::fs::Metadata| (file_identity(metadata), creation(metadata));
    matches!((file.metadata(), fs::metadata(path)), (Ok(ours), Ok(theirs)) if identity(&ours) == identity(&theirs))
}

fn stamp(metadata: &std::fs::Metadata) -> Stamp {
    Stamp { size: metadata.len(), modified: metadata.modified().ok(), identity: file_identity(metadata) }
}

#[cfg(unix)]
fn file_identity(metadata: &std::fs::Metadata) -> Identity {
    std::os::unix::fs::MetadataExt::ino(metadata)
}

#[cfg(not(unix))]
fn file_identity(metadata: &std::fs::Metadata) -> Identity {
    creation(metadata)
}

/// When the file was created, in nanoseconds; 0 where the file system does not report it.
fn creation(metadata: &std::fs::Metadata) -> u64 {
    let created = metadata.created().ok();
    let age = created.and_then(|created| created.duration_since(std::time::UNIX_EPOCH).ok());
    age.map_or(0, |age| age.as_nanos() as u64)
}

/// A listing of the hot folder: files and other things in it and in its SKU folders, without ignored names.
#[derive(Debug, Default)]
pub(crate) struct Listing {
    /// Paths and what is there, in the order in which they were written.
    pub(crate) drops: Vec<(PathBuf, Found)>,
    /// Folders inside SKU folders, which are not read.
    pub(crate) too_deep: Vec<PathBuf>,
    /// What could not be read; the rest of the listing is valid.
    pub(crate) unseen: Vec<io::Error>,
}

/// Lists the hot folder and the SKU folders in it.
pub(crate) fn list(hot: &Path) -> io::Result<Listing> {
    let mut listing = Listing::default();
    for (path, found) in entries(hot, &mut listing.unseen)? {
        if found == Found::Folder {
            list_sku_folder(&path, &mut listing);
        } else {
            listing.drops.push((path, found));
        }
    }
    let written = |found: &Found| match found {
        Found::File(stamp) | Found::Other(stamp) => stamp.modified,
        Found::Folder => None,
    };
    // A file with a time in the future must not be sorted after all new files.
    let now = SystemTime::now();
    let order = |found: &Found| written(found).map(|time| time.min(now));
    listing.drops.sort_by(|(a, x), (b, y)| order(x).cmp(&order(y)).then_with(|| a.cmp(b)));
    Ok(listing)
}

fn list_sku_folder(folder: &Path, listing: &mut Listing) {
    let entries = match entries(folder, &mut listing.unseen) {
        Ok(entries) => entries,
        // Removed since its parent was listed.
        Err(error) if error.kind() == ErrorKind::NotFound => return,
        Err(error) => return listing.unseen.push(error),
    };
    for (path, found) in entries {
        if found == Found::Folder {
            listing.too_deep.push(path);
        } else {
            listing.drops.push((path, found));
        }
    }
}

/// The entries of one folder, without ignored names; errors go to `unseen`.
pub(crate) fn entries(folder: &Path, unseen: &mut Vec<io::Error>) -> io::Result<Vec<(PathBuf, Found)>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if is_ignored(&entry.file_name().to_string_lossy()) {
            continue;
        }
        match look(&entry.path()) {
            Ok(Some(what)) => found.push((entry.path(), what)),
            Ok(None) => {}
            Err(error) => unseen.push(error),
        }
    }
    Ok(found)
}

/// Opens a file for reading.
#[cfg(not(windows))]
pub(crate) fn open(path: &Path) -> io::Result<fs::File> {
    fs::File::open(path)
}

/// Opens a file for reading; Windows refuses this while another program has it open for writing, and vice versa.
#[cfg(windows)]
pub(crate) fn open(path: &Path) -> io::Result<fs::File> {
    const READ_AND_DELETE: u32 = 1 | 4;
    let mut options = fs::OpenOptions::new();
    fs::os::windows::fs::OpenOptionsExt::share_mode(options.read(true), READ_AND_DELETE);
    options.open(path)
}

/// Whether the file can be opened for reading: on Windows not while a program writes it.
pub(crate) fn can_be_read(path: &Path) -> bool {
    open(path).is_ok()
}

/// The content of a file and its stamp; `None` if it was changed, replaced or removed while it was read, or is larger
/// than [`LARGEST_DROP`].
pub(crate) fn read_whole(path: &Path) -> io::Result<Option<(Vec<u8>, Stamp)>> {
    let mut file = match open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
    };
    let before = stamp(&file.metadata()?);
    if before.size > LARGEST_DROP {
        return Ok(None);
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(before.size as usize + 1).map_err(|_| ErrorKind::OutOfMemory)?;
    // One byte more than expected shows that the file grew.
    (&mut file).take(before.size + 1).read_to_end(&mut bytes)?;
    let same = stamp(&file.metadata()?) == before && look(path)? == Some(Found::File(before));
    Ok((same && bytes.len() as u64 == before.size).then_some((bytes, before)))
}

/// Whether the file contains exactly these bytes.
pub(crate) fn has_content(path: &Path, bytes: &[u8]) -> bool {
    matches!(look(path), Ok(Some(Found::File(stamp))) if stamp.size == bytes.len() as u64)
        && matches!(read_whole(path), Ok(Some((content, _))) if content == bytes)
}

/// Whether the folder is on another computer, whose changes raise no events here.
#[cfg(target_os = "linux")]
pub(crate) fn is_on_network(folder: &Path) -> bool {
    let Ok(folder) = fs::canonicalize(folder) else { return false };
    let mounts = std::fs::read_to_string("/proc/self/mountinfo").unwrap_or_default();
    is_mounted_from_network(&folder, &mounts)
}

/// Whether the folder is on another computer: its full path is that of a share, also behind a drive letter.
#[cfg(not(target_os = "linux"))]
pub(crate) fn is_on_network(folder: &Path) -> bool {
    use std::path::Prefix::{UNC, VerbatimUNC};
    let full = fs::canonicalize(folder).unwrap_or_else(|_| folder.into());
    matches!(full.components().next(), Some(std::path::Component::Prefix(prefix))
        if matches!(prefix.kind(), UNC(..) | VerbatimUNC(..)))
}

/// The mount point of the folder's disk or share; `None` if the folder does not exist.
#[cfg(target_os = "linux")]
pub(crate) fn mount_of(folder: &Path) -> Option<PathBuf> {
    let folder = fs::canonicalize(folder).ok()?;
    let mounts = std::fs::read_to_string("/proc/self/mountinfo").ok()?;
    nearest_mount(&folder, &mounts).map(|(point, _)| point)
}

/// The number of the folder's device; `None` if the folder does not exist.
#[cfg(target_os = "linux")]
pub(crate) fn device_of(folder: &Path) -> Option<u64> {
    fs::metadata(folder).ok().map(|metadata| std::os::unix::fs::MetadataExt::dev(&metadata))
}

/// Not needed on other systems, where [`mount_of`] is `None`.
#[cfg(not(target_os = "linux"))]
pub(crate) fn device_of(_: &Path) -> Option<u64> {
    None
}

/// On other systems, the mount point of a share disappears with it, like a drive letter.
#[cfg(not(target_os = "linux"))]
pub(crate) fn mount_of(_: &Path) -> Option<PathBuf> {
    None
}

/// File systems whose files are changed by other computers, or by the host of a virtual machine, without an event.
#[cfg(target_os = "linux")]
const NETWORK_FILE_SYSTEMS: &[&str] = &[
    "nfs",
    "nfs4",
    "cifs",
    "smb3",
    "smbfs",
    "9p",
    "afs",
    "ceph",
    "glusterfs",
    "lustre",
    "ncpfs",
    "vboxsf",
    "vmhgfs",
    "prl_fs",
    "virtiofs",
    "drvfs",
    "davfs",
];

/// The mount point above the folder and the kind of its file system. `mounts` has the form of `/proc/self/mountinfo`:
/// the fifth word is the mount point, the word after ` - ` the file system.
#[cfg(target_os = "linux")]
fn nearest_mount<'a>(folder: &Path, mounts: &'a str) -> Option<(PathBuf, &'a str)> {
    let mut nearest: Option<(PathBuf, &str)> = None;
    for line in mounts.lines() {
        let Some((head, tail)) = line.split_once(" - ") else { continue };
        let (Some(point), Some(kind)) = (head.split(' ').nth(4), tail.split(' ').next()) else { continue };
        let point = PathBuf::from(point.replace("\\040", " "));
        // Of two mounts on one point, the later one covers the other.
        if folder.starts_with(&point) && nearest.as_ref().is_none_or(|(last, _)| point.starts_with(last)) {
            nearest = Some((point, kind));
        }
    }
    nearest
}

#[cfg(target_os = "linux")]
fn is_mounted_from_network(folder: &Path, mounts: &str) -> bool {
    let kind = nearest_mount(folder, mounts).map_or("", |(_, kind)| kind);
    let over_network = ["fuse.sshfs", "fuse.rclone", "fuse.smbnetfs", "fuse.glusterfs", "fuse.vmhgfs-fuse"];
    NETWORK_FILE_SYSTEMS.contains(&kind) || over_network.contains(&kind)
}

/// Moves a file, across file systems too, and never over another one.
///
/// # Errors
/// `AlreadyExists` when the name is taken.
pub(crate) fn move_new(from: &Path, to: &Path) -> io::Result<()> {
    let mut moving = tempfile::TempPath::try_from_path(in_full(from))?;
    // It is a designer's file, not a temporary one: a failed move must not remove it.
    moving.disable_cleanup(true);
    let Err(failed) = moving.persist_noclobber(in_full(to)) else { return stays_once(from, to) };
    match failed.error.kind() {
        ErrorKind::AlreadyExists | ErrorKind::NotFound => Err(named(failed.error, "cannot move to", to)),
        ErrorKind::CrossesDevices => move_by_copy(from, to),
        // Some network and memory-card file systems have no rename that never overwrites.
        _ if look(to)?.is_none() => match fs::rename(from, to) {
            Err(error) if error.kind() == ErrorKind::CrossesDevices => move_by_copy(from, to),
            renamed => renamed,
        },
        _ => Err(named(ErrorKind::AlreadyExists.into(), "cannot move to", to)),
    }
}

/// Removes the old name, where the file system could only add the new name to the file: with both names, the file would
/// always be a new drop. If removing fails, the new name is removed again.
#[cfg(unix)]
fn stays_once(from: &Path, to: &Path) -> io::Result<()> {
    let is_one = |a: &Path, b: &Path| -> io::Result<bool> {
        let [a, b] = [look(a)?, look(b)?];
        Ok(matches!((a, b), (Some(Found::File(a)), Some(Found::File(b))) if a.identity == b.identity))
    };
    if !is_one(from, to)? {
        return Ok(());
    }
    fs::remove_file(from).inspect_err(|_| drop(fs::remove_file(to)))
}

/// Windows renames in one step.
#[cfg(not(unix))]
fn stays_once(_: &Path, _: &Path) -> io::Result<()> {
    Ok(())
}

/// Moves a file to another file system: the original is removed when its copy is complete. If it was written meanwhile,
/// it is another drop and stays.
fn move_by_copy(from: &Path, to: &Path) -> io::Result<()> {
    let (before, _) = copy_new(from, to)?;
    if look(from)? == Some(Found::File(before)) { fs::remove_file(from) } else { Ok(()) }
}

/// Copies a file, never over another one; returns the stamp of the original and the hash of the content. The copy
/// survives a power cut.
///
/// # Errors
/// `Unsupported` for anything except a file: opening a pipe could wait for its writer without end. `Interrupted` when
/// the file changes meanwhile; then there is no copy.
pub(crate) fn copy_new(from: &Path, to: &Path) -> io::Result<(Stamp, blake3::Hash)> {
    let before = match look(from)? {
        Some(Found::File(before)) => before,
        None => return Err(named(ErrorKind::NotFound.into(), "cannot copy", from)),
        Some(_) => {
            let message = "only a file can be moved to another disk";
            return Err(named(io::Error::new(ErrorKind::Unsupported, message), "cannot move", from));
        }
    };
    let mut original = open(from)?;
    let mut copy = temporary(to.parent().unwrap_or(Path::new("")))?;
    let (mut hasher, mut buffer) = (blake3::Hasher::new(), vec![0; COPY_BUFFER]);
    loop {
        let read = original.read(&mut buffer)?;
        if read == 0 {
            break;
        }
        hasher.update(&buffer[..read]);
        copy.as_file_mut().write_all(&buffer[..read]).map_err(|error| named(error, "cannot copy to", to))?;
    }
    if stamp(&original.metadata()?) != before || look(from)? != Some(Found::File(before)) {
        return Err(named(ErrorKind::Interrupted.into(), "cannot copy", from));
    }
    keep_new(copy, to, before.modified)?;
    Ok((before, hasher.finalize()))
}

/// The hash of a file's content.
pub(crate) fn content_hash(path: &Path) -> io::Result<blake3::Hash> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(open(path)?)?;
    Ok(hasher.finalize())
}

/// The first of `folder`, `folder/(2)`, `folder/(3)` … in which none of the names is taken; it is created if needed.
///
/// The numbers are in the names of folders, not of files, because a file's name determines its SKU and its buffers. So
/// the content of a numbered folder can be moved back unchanged.
pub(crate) fn free_place(folder: &Path, names: &[impl AsRef<Path>]) -> io::Result<PathBuf> {
    let place = |number: u64| if number == 1 { folder.into() } else { folder.join(format!("({number})")) };
    let taken = |number: u64| -> io::Result<bool> {
        let place: PathBuf = place(number);
        names.iter().try_fold(false, |taken, name| Ok(taken || look(&place.join(name.as_ref()))?.is_some()))
    };
    // Numbers are used without gaps from 1 on: double until one is free, then bisect.
    let mut free = 1;
    while taken(free)? {
        free *= 2;
    }
    let mut last_taken = free / 2;
    while last_taken + 1 < free {
        let middle = (last_taken + free) / 2;
        if taken(middle)? {
            last_taken = middle;
        } else {
            free = middle;
        }
    }
    fs::create_dir_all(place(free))?;
    Ok(place(free))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moving_never_overwrites_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        fs::write(&a, "a").unwrap();
        fs::write(&b, "b").unwrap();
        assert_eq!(move_new(&a, &b).unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!(move_by_copy(&a, &b).unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!((fs::read(&a).unwrap(), fs::read(&b).unwrap()), (b"a".to_vec(), b"b".to_vec()));
        move_new(&a, &folder.path().join("c")).unwrap();
        move_by_copy(&b, &folder.path().join("d")).unwrap();
        let names: Vec<_> =
            entries(folder.path(), &mut Vec::new()).unwrap().into_iter().map(|(path, _)| path).collect();
        assert_eq!(names.len(), 2, "{names:?}");
        assert_eq!(fs::read(folder.path().join("d")).unwrap(), b"b");
    }

    /// Linux usually has a second file system in memory; without it, this test is skipped.
    #[cfg(target_os = "linux")]
    #[test]
    fn files_move_across_file_systems() {
        let (Ok(here), Ok(there)) = (tempfile::tempdir(), tempfile::tempdir_in("/dev/shm")) else { return };
        let (from, to) = (here.path().join("a"), there.path().join("a"));
        fs::write(&from, "a").unwrap();
        let modified = fs::metadata(&from).unwrap().modified().unwrap();
        move_new(&from, &to).unwrap();
        assert!(!from.exists());
        assert_eq!(fs::metadata(&to).unwrap().modified().unwrap(), modified);
        fs::write(&from, "b").unwrap();
        assert_eq!(move_new(&from, &to).unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!((fs::read(&from).unwrap(), fs::read(&to).unwrap()), (b"b".to_vec(), b"a".to_vec()));
    }

    /// Where inodes are used again, only the creation time distinguishes the folders.
    #[test]
    fn a_folder_created_again_has_another_identity() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("hot");
        fs::create_dir(&folder).unwrap();
        let (first, metadata) = (identity(&folder), fs::metadata(&folder).unwrap());
        assert_eq!(identity(&folder), first);
        if metadata.created().is_ok() {
            fs::remove_dir(&folder).unwrap();
            std::thread::sleep(std::time::Duration::from_millis(20));
            fs::create_dir(&folder).unwrap();
            assert_ne!(identity(&folder), first);
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_folder_is_on_the_nearest_mount() {
        let mounts = "22 1 8:1 / / rw,relatime shared:1 - ext4 /dev/sda1 rw\n\
                      31 22 0:45 / /mnt/laser\\040one rw - nfs4 server:/share rw\n\
                      32 31 0:46 / /mnt/laser\\040one/local rw shared:3 - tmpfs tmpfs rw\n";
        for (folder, expected) in [
            ("/home/hot", false),
            ("/mnt/laser", false),
            ("/mnt/laser one/hot", true),
            ("/mnt/laser one/local/hot", false),
        ] {
            assert_eq!(is_mounted_from_network(Path::new(folder), mounts), expected, "{folder}");
        }
        assert!(!is_on_network(Path::new("/proc")));
    }

    #[cfg(windows)]
    #[test]
    fn a_file_that_is_being_written_is_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.obj");
        let writer = fs::File::create(&path).unwrap();
        assert!(read_whole(&path).is_err());
        drop(writer);
        assert!(read_whole(&path).unwrap().is_some());
    }

    #[cfg(unix)]
    #[test]
    fn moving_a_pipe_does_not_open_it() {
        let folder = tempfile::tempdir().unwrap();
        let (pipe, to) = (folder.path().join("x.dxf"), folder.path().join("y.dxf"));
        if !std::process::Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success()) {
            return;
        }
        assert_eq!(copy_new(&pipe, &to).unwrap_err().kind(), ErrorKind::Unsupported);
        assert!(matches!(look(&pipe), Ok(Some(Found::Other(_)))));
    }

    #[test]
    fn places_are_numbered_without_gaps() {
        let folder = tempfile::tempdir().unwrap();
        for number in 1..=9 {
            let place = free_place(folder.path(), &["x", "y"]).unwrap();
            let expected = if number == 1 { String::new() } else { format!("({number})") };
            assert_eq!(place, folder.path().join(expected));
            fs::write(place.join(if number % 2 == 0 { "x" } else { "y" }), "").unwrap();
        }
        assert_eq!(free_place(folder.path(), &["z"]).unwrap(), folder.path());
    }
}
