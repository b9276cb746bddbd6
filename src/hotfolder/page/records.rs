//! The files and actions behind the links and buttons of the page. A request names them by keys; paths and names come only
//! from the status of the station.

use std::fs::File;
use std::io::Read;
use std::sync::Arc;

use fs_err as fs;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::news::Seen;
use crate::config::{FolderPaths, Sku};
use crate::files::is_plain;
use crate::hotfolder::api::PictureKind;
use crate::hotfolder::jobs::filing::report_path;
use crate::hotfolder::jobs::rejected::{AS_ITS_USER, return_rejected};
use crate::hotfolder::state::Request;
use crate::hotfolder::state::status::Finished;
use crate::printable::on_one_line;
use crate::reason::Reason;

/// The largest file that is sent, bytes.
const LARGEST_FILE: u64 = 32 << 20;
/// Memory for files that are being sent is counted in units of this size, bytes.
const UNIT: u64 = 64 << 10;
/// All memory for files that are being sent: 128 MiB.
pub(super) const UNITS: usize = 2048;
/// Files that are read at the same time: fewer than the threads that wait for disks.
pub(super) const READING: usize = 2;

/// A delivered drawing with files in the reports folder.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Record {
    sku: Sku,
    drawing: String,
}

/// Why a file is not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NotSent {
    /// It was removed, or is no file in the reports folder.
    Missing,
    /// It is too large for the page.
    TooLarge,
    /// Other files are being sent.
    Busy,
}

impl Record {
    /// The record of a finished drop; `None` for a part. The status may have been read from a file, so its names are checked.
    pub(super) fn of(finished: &Finished) -> Option<Self> {
        let drawing = finished.drawing.clone().filter(|drawing| is_plain(drawing))?;
        Some(Self { sku: finished.sku.parse().ok()?, drawing })
    }

    /// Reads one of its files; `room` is the memory for all files.
    pub(super) fn read(
        &self,
        folders: &FolderPaths,
        kind: PictureKind,
        room: &Arc<Semaphore>,
    ) -> Result<(Vec<u8>, OwnedSemaphorePermit), NotSent> {
        let path = report_path(folders, &self.sku, &self.drawing, kind.ending());
        let missing = |_| NotSent::Missing;
        // A link may lead out of the folder.
        let (path, reports) =
            (fs::canonicalize(path).map_err(missing)?, fs::canonicalize(&folders.reports).map_err(missing)?);
        if !path.starts_with(reports) {
            return Err(NotSent::Missing);
        }
        // To open a pipe waits for its writer.
        if !fs::symlink_metadata(&path).map_err(missing)?.is_file() {
            return Err(NotSent::Missing);
        }
        let file = File::open(path).map_err(missing)?;
        let metadata = file.metadata().map_err(missing)?;
        if !metadata.is_file() {
            return Err(NotSent::Missing);
        }
        if metadata.len() > LARGEST_FILE {
            return Err(NotSent::TooLarge);
        }
        let units = metadata.len().div_ceil(UNIT).max(1) as u32;
        let permit = Arc::clone(room).try_acquire_many_owned(units).map_err(|_| NotSent::Busy)?;
        // Read as a whole and closed: Windows cannot replace a file that is open.
        let mut bytes = Vec::with_capacity(metadata.len() as usize);
        file.take(metadata.len()).read_to_end(&mut bytes).map_err(missing)?;
        Ok((bytes, permit))
    }
}

/// What a button of the page does.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Action {
    /// Tries all waiting drops again.
    TryWaiting,
    /// Moves a rejected drop back into the hot folder.
    Return(String),
    /// Delivers an uncertain drawing again.
    DeliverAgain(String),
}

/// What an action has done, and the word for it in addresses.
pub(super) struct Done {
    pub(super) word: &'static str,
    pub(super) text: String,
}

impl Action {
    /// The address that it is sent to.
    pub(super) fn path(&self) -> &'static str {
        match self {
            Self::TryWaiting | Self::Return(_) => "/retry",
            Self::DeliverAgain(_) => "/deliver-again",
        }
    }

    /// Does it, as `isomark retry` does.
    pub(super) fn perform(&self, seen: &Seen) -> Result<Done, Reason> {
        match self {
            Self::TryWaiting => {
                leave(&Request::Waiting, seen)?;
                Ok(Done { word: "waiting", text: "Everything that waits is tried again now.".into() })
            }
            Self::DeliverAgain(name) => {
                leave(&Request::Uncertain(Some(name.clone())), seen)?;
                let text = format!("{} is delivered again.", on_one_line(name));
                Ok(Done { word: "uncertain", text })
            }
            Self::Return(drop) => {
                let (returned, mut trouble) =
                    return_rejected(&seen.folders, Some(std::slice::from_ref(drop)), false)
                        .map_err(|error| environment(&error))?;
                match trouble.pop() {
                    Some(reason) if returned.is_empty() => Err(reason),
                    _ => {
                        let text = format!("{} is back in the hot folder.", on_one_line(drop));
                        tracing::info!(
                            "{} was put back into the hot folder from the page",
                            on_one_line(drop)
                        );
                        Ok(Done { word: "returned", text })
                    }
                }
            }
        }
    }
}

/// The text for the word of an action that was done.
pub(super) fn text_of(word: &str) -> Option<&'static str> {
    match word {
        "waiting" => Some("Everything that waits is tried again now."),
        "uncertain" => Some("The drawing is delivered again."),
        "returned" => Some("The drop is back in the hot folder."),
        _ => None,
    }
}

fn leave(request: &Request, seen: &Seen) -> Result<(), Reason> {
    request.leave(&seen.state).map_err(|error| environment(&error))
}

fn environment(error: &std::io::Error) -> Reason {
    let remedy = match error.kind() {
        std::io::ErrorKind::PermissionDenied => AS_ITS_USER,
        _ => "Check that the station's folders exist and have free space, then try again.",
    };
    Reason::new("environment", format!("{error}."), remedy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hotfolder::state::status::Status;

    fn folders(root: &std::path::Path) -> FolderPaths {
        let station = "[station]\nname = \"x\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 9\nheight_mm = 9\n";
        crate::config::Station::parse(&root.join("station.toml"), station).unwrap().folders
    }

    fn finished(sku: &str, drawing: &str) -> Finished {
        let json =
            serde_json::json!({"at": "", "drop": "x", "sku": sku, "drawing": drawing, "result": "delivered"});
        serde_json::from_value(json).unwrap()
    }

    #[test]
    fn only_files_of_the_reports_folder_are_read() {
        let root = tempfile::tempdir().unwrap();
        let folders = folders(root.path());
        let inside = folders.reports.join("can");
        std::fs::create_dir_all(inside.join("folder.dxf.preview.svg")).unwrap();
        std::fs::write(inside.join("can.dxf.preview.svg"), "<svg/>").unwrap();
        std::fs::write(root.path().join("secret.preview.svg"), "secret").unwrap();
        let room = Arc::new(Semaphore::new(UNITS));
        let read = |sku: &str, drawing: &str| {
            let record = Record::of(&finished(sku, drawing)).ok_or(NotSent::Missing)?;
            record.read(&folders, PictureKind::Preview, &room).map(|(bytes, _)| bytes)
        };
        assert_eq!(read("CAN", "can.dxf").unwrap(), b"<svg/>");
        let out = root.path().join("secret").display().to_string();
        for (sku, drawing) in [
            ("can", "../../secret"),
            ("..", "../secret"),
            ("can/..", "can.dxf"),
            ("can", ""),
            ("can", ".."),
            ("can", "."),
            ("can", "folder.dxf"),
            ("can", "none.dxf"),
            ("can", "can.dxf\0"),
            ("can", &out),
            ("can", "..\\..\\secret"),
        ] {
            assert_eq!(read(sku, drawing), Err(NotSent::Missing), "{sku} {drawing}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(
                root.path().join("secret.preview.svg"),
                inside.join("link.preview.svg"),
            )
            .unwrap();
            std::os::unix::fs::symlink(root.path(), folders.reports.join("out")).unwrap();
            assert_eq!(read("can", "link"), Err(NotSent::Missing));
            assert_eq!(read("out", "secret"), Err(NotSent::Missing));
        }
        assert_eq!(room.available_permits(), UNITS);
    }

    #[test]
    fn files_that_are_being_sent_have_bounded_memory() {
        let root = tempfile::tempdir().unwrap();
        let folders = folders(root.path());
        let inside = folders.reports.join("can");
        std::fs::create_dir_all(&inside).unwrap();
        let large = |name: &str, bytes| File::create(inside.join(name)).unwrap().set_len(bytes).unwrap();
        large("a.preview.svg", LARGEST_FILE);
        large("b.preview.svg", LARGEST_FILE + 1);
        let room = Arc::new(Semaphore::new(UNITS));
        let read = |drawing: &str| {
            Record::of(&finished("can", drawing)).unwrap().read(&folders, PictureKind::Preview, &room)
        };
        assert_eq!(read("b").unwrap_err(), NotSent::TooLarge);
        let held: Vec<_> = (0..4).map(|_| read("a").unwrap()).collect();
        assert_eq!(read("a").unwrap_err(), NotSent::Busy);
        drop(held);
        assert!(read("a").is_ok());
    }

    #[test]
    fn an_action_that_fails_gives_the_reason() {
        let root = tempfile::tempdir().unwrap();
        let status: Status = serde_json::from_value(serde_json::json!({
            "schema": "", "station": "", "running": true, "at": "", "since": "",
            "done": crate::hotfolder::state::status::Done::default(), "under_way": [], "rejections": [],
            "waiting": {"count": 0, "first": []}, "incomplete": {"count": 0, "first": []},
            "outdated": {"count": 0, "first": []},
        }))
        .unwrap();
        let seen = Seen { status, folders: folders(root.path()), state: root.path().join("state") };
        let reason = Action::Return("../x.dxf".into()).perform(&seen).err().unwrap();
        assert_eq!(reason.code, "not-rejected");
        std::fs::write(root.path().join("state"), "a file in the way").unwrap();
        let reason = Action::TryWaiting.perform(&seen).err().unwrap();
        assert_eq!(reason.code, "environment");
    }
}
