//! The few things that are done to folders: list, read a steady file, move without overwriting.

use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use fs_err as fs;

use super::{Stamp, is_ignored};
use crate::files::{in_full, keep_new, named, temporary};

/// The largest file that is taken, bytes: it is held in memory, and fitting it takes a few times as much.
pub(crate) const LARGEST_DROP: u64 = 1 << 30;

/// How much of a file is copied at a time, bytes.
const COPY_BUFFER: usize = 1 << 16;

/// What lies at a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Found {
    /// A file.
    File(Stamp),
    /// A folder.
    Folder,
    /// A link, a device or a pipe: never a drop.
    Other(Stamp),
}

/// Which folder bears a path: a folder that was removed and made again is another one.
pub(crate) type Identity = u64;

/// What lies at the path; `None` when nothing does.
pub(crate) fn look(path: &Path) -> io::Result<Option<Found>> {
    match fs::symlink_metadata(path) {
        Ok(metadata) if metadata.is_file() => Ok(Some(Found::File(stamp(&metadata)))),
        Ok(metadata) if metadata.is_dir() => Ok(Some(Found::Folder)),
        Ok(metadata) => Ok(Some(Found::Other(stamp(&metadata)))),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// Whether a file lies at the path.
pub(crate) fn is_file(path: &Path) -> bool {
    matches!(look(path), Ok(Some(Found::File(_))))
}

/// The identity of the folder at the path, if there is one.
pub(crate) fn identity(folder: &Path) -> Option<Identity> {
    let metadata = fs::metadata(folder).ok()?;
    // The number of a removed folder is soon given to another one; the times of their making differ.
    metadata.is_dir().then(|| file_identity(&metadata) ^ creation(&metadata).rotate_left(32))
}

/// Whether the open file is still the one at the path.
pub(crate) fn lies_at(file: &std::fs::File, path: &Path) -> bool {
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

/// When the file was made, in nanoseconds; 0 where the file system does not tell.
fn creation(metadata: &std::fs::Metadata) -> u64 {
    let created = metadata.created().ok();
    let age = created.and_then(|created| created.duration_since(std::time::UNIX_EPOCH).ok());
    age.map_or(0, |age| age.as_nanos() as u64)
}

/// A listing of the hot folder: files and other things in it and in its SKU folders, without ignored names.
#[derive(Debug, Default)]
pub(crate) struct Listing {
    /// Paths and what lies there, in the order in which they were written.
    pub(crate) drops: Vec<(PathBuf, Found)>,
    /// Folders inside SKU folders, which nobody looks into.
    pub(crate) too_deep: Vec<PathBuf>,
    /// What could not be looked at; the rest of the listing is right all the same.
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
    // A clock that was ahead must not put an old file behind all that come.
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

/// What lies in one folder, without ignored names; what cannot be looked at goes to `unseen`.
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

/// Opens a file to read it.
#[cfg(not(windows))]
pub(crate) fn open(path: &Path) -> io::Result<fs::File> {
    fs::File::open(path)
}

/// Opens a file to read it, which Windows refuses as long as somebody has it open to write, and the other way round.
#[cfg(windows)]
pub(crate) fn open(path: &Path) -> io::Result<fs::File> {
    const READ_AND_DELETE: u32 = 1 | 4;
    let mut options = fs::OpenOptions::new();
    fs::os::windows::fs::OpenOptionsExt::share_mode(options.read(true), READ_AND_DELETE);
    options.open(path)
}

/// Whether the file can be opened to be read: on Windows not as long as somebody writes it.
pub(crate) fn can_be_read(path: &Path) -> bool {
    open(path).is_ok()
}

/// The content of a file and its stamp; `None` when it changed, was replaced or went while it was read, or is larger
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

/// Whether the file holds exactly these bytes.
pub(crate) fn has_content(path: &Path, bytes: &[u8]) -> bool {
    matches!(look(path), Ok(Some(Found::File(stamp))) if stamp.size == bytes.len() as u64)
        && matches!(read_whole(path), Ok(Some((content, _))) if content == bytes)
}

/// Whether the folder lies on another computer, whose files raise no events here.
#[cfg(target_os = "linux")]
pub(crate) fn is_on_network(folder: &Path) -> bool {
    let Ok(folder) = fs::canonicalize(folder) else { return false };
    let mounts = std::fs::read_to_string("/proc/self/mountinfo").unwrap_or_default();
    is_mounted_from_network(&folder, &mounts)
}

/// Whether the folder lies on another computer: its full name is that of a share, also behind a drive's letter.
#[cfg(not(target_os = "linux"))]
pub(crate) fn is_on_network(folder: &Path) -> bool {
    use std::path::Prefix::{UNC, VerbatimUNC};
    let full = fs::canonicalize(folder).unwrap_or_else(|_| folder.into());
    matches!(full.components().next(), Some(std::path::Component::Prefix(prefix))
        if matches!(prefix.kind(), UNC(..) | VerbatimUNC(..)))
}

/// Where the disk or share is mounted that the folder lies on; `None` for a folder that is not there.
#[cfg(target_os = "linux")]
pub(crate) fn mount_of(folder: &Path) -> Option<PathBuf> {
    let folder = fs::canonicalize(folder).ok()?;
    let mounts = std::fs::read_to_string("/proc/self/mountinfo").ok()?;
    nearest_mount(&folder, &mounts).map(|(point, _)| point)
}

/// The number of the device that the folder lies on; `None` for a folder that is not there.
#[cfg(target_os = "linux")]
pub(crate) fn device_of(folder: &Path) -> Option<u64> {
    fs::metadata(folder).ok().map(|metadata| std::os::unix::fs::MetadataExt::dev(&metadata))
}

/// Elsewhere nobody asks.
#[cfg(not(target_os = "linux"))]
pub(crate) fn device_of(_: &Path) -> Option<u64> {
    None
}

/// Elsewhere the mount point of a share goes with it, as a drive's letter does.
#[cfg(not(target_os = "linux"))]
pub(crate) fn mount_of(_: &Path) -> Option<PathBuf> {
    None
}

/// The file systems whose files other computers, or the host of a virtual machine, change behind the kernel's back.
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

/// The mount point above the folder and the kind of its file system. `mounts` has the form of `/proc/self/mountinfo`: the
/// fifth word is where, the one after ` - ` which file system.
#[cfg(target_os = "linux")]
fn nearest_mount<'a>(folder: &Path, mounts: &'a str) -> Option<(PathBuf, &'a str)> {
    let mut nearest: Option<(PathBuf, &str)> = None;
    for line in mounts.lines() {
        let Some((head, tail)) = line.split_once(" - ") else { continue };
        let (Some(point), Some(kind)) = (head.split(' ').nth(4), tail.split(' ').next()) else { continue };
        let point = PathBuf::from(point.replace("\\040", " "));
        // Of two on one point, the later lies on top.
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
    // It is a designer's file, not a temporary one: a failed move must leave it where it is.
    moving.disable_cleanup(true);
    let Err(failed) = moving.persist_noclobber(in_full(to)) else { return stays_once(from, to) };
    match failed.error.kind() {
        ErrorKind::AlreadyExists | ErrorKind::NotFound => Err(named(failed.error, "cannot move to", to)),
        ErrorKind::CrossesDevices => move_by_copy(from, to),
        // Some network and memory-card file systems know no rename that spares the target.
        _ if look(to)?.is_none() => match fs::rename(from, to) {
            Err(error) if error.kind() == ErrorKind::CrossesDevices => move_by_copy(from, to),
            renamed => renamed,
        },
        _ => Err(named(ErrorKind::AlreadyExists.into(), "cannot move to", to)),
    }
}

/// Where the file system cannot rename without overwriting, a file gets its new name and then loses the old one, if that
/// is allowed. With both it would be another drop for ever.
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

/// The other half of [`move_new`]: the original goes when its copy is safe. One that was written meanwhile is another drop
/// and stays.
fn move_by_copy(from: &Path, to: &Path) -> io::Result<()> {
    let (before, _) = copy_new(from, to)?;
    if look(from)? == Some(Found::File(before)) { fs::remove_file(from) } else { Ok(()) }
}

/// Copies a file, never over another one; returns what was copied: the stamp before and the hash of the content. When it
/// returns, the copy survives a power cut.
///
/// # Errors
/// `Unsupported` for what is no file: opening a pipe would wait for its writer for ever. `Interrupted` when the file changes
/// meanwhile; nothing is there then.
pub(crate) fn copy_new(from: &Path, to: &Path) -> io::Result<(Stamp, blake3::Hash)> {
    let before = match look(from)? {
        Some(Found::File(before)) => before,
        None => return Err(named(ErrorKind::NotFound.into(), "cannot copy", from)),
        Some(_) => {
            let words = "only a file can be moved to another disk";
            return Err(named(io::Error::new(ErrorKind::Unsupported, words), "cannot move", from));
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

/// The first of `folder`, `folder/(2)`, `folder/(3)` … in which no file bears one of the names; it is made if needed.
///
/// Numbers are on folders, not on files, because names say which SKU a file is for and which buffers belong to it: the
/// content of a numbered folder can be moved back as it is.
pub(crate) fn free_place(folder: &Path, names: &[impl AsRef<Path>]) -> io::Result<PathBuf> {
    let place = |number: u64| if number == 1 { folder.into() } else { folder.join(format!("({number})")) };
    let taken = |number: u64| -> io::Result<bool> {
        let place: PathBuf = place(number);
        names.iter().try_fold(false, |taken, name| Ok(taken || look(&place.join(name.as_ref()))?.is_some()))
    };
    // Numbers are taken from 1 on: double until one is free, then halve the gap.
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
    fn nothing_is_moved_over_anything() {
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

    /// Linux has a second file system in memory; where there is none, [`move_by_copy`] alone is tested.
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

    /// A number that is not reused shows the rest; where it is, only the time of making tells.
    #[test]
    fn a_folder_made_again_is_another_one() {
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
    fn a_folder_is_on_what_is_mounted_nearest_to_it() {
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
    fn what_is_being_written_is_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.obj");
        let writer = fs::File::create(&path).unwrap();
        assert!(read_whole(&path).is_err());
        drop(writer);
        assert!(read_whole(&path).unwrap().is_some());
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_not_opened_to_move_it() {
        let folder = tempfile::tempdir().unwrap();
        let (pipe, to) = (folder.path().join("x.dxf"), folder.path().join("y.dxf"));
        if !std::process::Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success()) {
            return;
        }
        assert_eq!(copy_new(&pipe, &to).unwrap_err().kind(), ErrorKind::Unsupported);
        assert!(matches!(look(&pipe), Ok(Some(Found::Other(_)))));
    }

    #[test]
    fn places_are_numbered_without_a_gap() {
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
