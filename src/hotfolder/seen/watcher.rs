//! Events from the hot folder and requests to stop, on one channel. Events are hints: losing one only costs time.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::sync::{Arc, Mutex, PoisonError};

use notify::event::{AccessKind, AccessMode, EventKind, ModifyKind, RenameMode};
use notify::{RecommendedWatcher, RecursiveMode, Watcher as _};

use super::Identity;
use super::folders::identity;
use crate::config::Backend;
use crate::hotfolder::jobs::End;

/// A message that wakes the station.
pub(crate) enum Message {
    /// A signal from outside.
    Signal(Signal),
    /// The job on this drop has ended.
    Finished(PathBuf, Box<End>),
}

/// A signal from outside.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Signal {
    /// Something happened to this path.
    Touched(PathBuf),
    /// A program writes to this file; sent only on systems that also report when the file is closed.
    Written(PathBuf),
    /// A writer closed this file.
    Closed(PathBuf),
    /// A file was renamed to this path.
    Renamed(PathBuf),
    /// Events were lost, so the folder must be listed.
    Overflow,
    /// The fleet has news.
    News,
    /// The station is to stop.
    Stop,
}

/// Stops a running station: clone it, hand one to [`run`](crate::hotfolder::run), and raise the other from anywhere.
#[derive(Debug, Clone, Default)]
pub struct StopSignal {
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    raised: AtomicBool,
    station: Mutex<Option<SyncSender<Message>>>,
}

impl StopSignal {
    /// Asks the station to stop after the current jobs.
    pub fn raise(&self) {
        self.shared.raised.store(true, Ordering::SeqCst);
        let station = self.shared.station.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(station) = station.as_ref() {
            // If this fails, the station has ended, or it has many messages and checks the flag soon.
            let _ = station.try_send(Message::Signal(Signal::Stop));
        }
    }

    /// Whether the station was asked to stop.
    pub fn is_raised(&self) -> bool {
        self.shared.raised.load(Ordering::SeqCst)
    }

    /// Lets the signal wake the station that listens on the other end of the channel.
    pub(crate) fn connect(&self, station: SyncSender<Message>) {
        *self.shared.station.lock().unwrap_or_else(PoisonError::into_inner) = Some(station);
    }
}

/// Watches one folder, until that folder is removed or replaced.
pub(crate) struct Watcher {
    sender: SyncSender<Message>,
    /// There were more events than the channel can hold.
    lost: Arc<AtomicBool>,
    watched: Option<Watched>,
    /// The last logged error of a watch that could not be set up.
    complaint: Option<String>,
}

struct Watched {
    folder: PathBuf,
    identity: Identity,
    /// Dropping it ends the watch.
    _events: RecommendedWatcher,
}

impl Watcher {
    pub(crate) fn new(sender: SyncSender<Message>) -> Self {
        Self { sender, lost: Arc::default(), watched: None, complaint: None }
    }

    /// Whether events were lost since the last call, so that the folder must be listed.
    pub(crate) fn lost_events(&self) -> bool {
        self.lost.swap(false, Ordering::SeqCst)
    }

    /// Watches the folder that is at this path now: a watch on a folder that was removed or replaced never reports an
    /// event again. Returns whether the folder exists.
    pub(crate) fn follow(&mut self, folder: &Path, backend: Backend) -> bool {
        let Some(now) = identity(folder) else {
            self.watched = None;
            return false;
        };
        let is_current = |watched: &Watched| watched.folder == folder && watched.identity == now;
        if backend == Backend::Poll {
            self.watched = None;
        } else if !self.watched.as_ref().is_some_and(is_current) {
            self.watched = None;
            match watch(folder, self.sender.clone(), self.lost.clone()) {
                Ok(events) => {
                    self.watched = Some(Watched { folder: folder.into(), identity: now, _events: events });
                    self.complaint = None;
                }
                Err(error) => self.complain(&error.to_string()),
            }
        }
        true
    }

    fn complain(&mut self, error: &str) {
        if self.complaint.as_deref() != Some(error) {
            tracing::warn!("the system reports no events for the hot folder ({error}); listing it instead");
            self.complaint = Some(error.into());
        }
    }
}

fn watch(
    folder: &Path,
    sender: SyncSender<Message>,
    lost: Arc<AtomicBool>,
) -> notify::Result<RecommendedWatcher> {
    // Events contain absolute paths; the station identifies its drops by the folder's path in the settings.
    let (absolute, spelled) = (std::path::absolute(folder)?, folder.to_path_buf());
    let watched = absolute.clone();
    // The handler only sends, and never waits: with a slow handler, the system's queue overflows.
    let handler = move |event| {
        signals(event, |signal| {
            let message = Message::Signal(signal.respelled(&absolute, &spelled));
            if matches!(sender.try_send(message), Err(TrySendError::Full(_))) {
                lost.store(true, Ordering::SeqCst);
            }
        });
    };
    let config = notify::Config::default().with_follow_symlinks(false);
    let mut watcher = RecommendedWatcher::new(handler, config)?;
    watcher.watch(&watched, RecursiveMode::Recursive)?;
    Ok(watcher)
}

impl Signal {
    /// The same signal, with `from` at the start of its path replaced by `to`.
    fn respelled(self, from: &Path, to: &Path) -> Self {
        let respell = |path: PathBuf| match path.strip_prefix(from) {
            Ok(rest) if rest.as_os_str().is_empty() => to.to_path_buf(),
            Ok(rest) => to.join(rest),
            Err(_) => path,
        };
        match self {
            Self::Touched(path) => Self::Touched(respell(path)),
            Self::Written(path) => Self::Written(respell(path)),
            Self::Closed(path) => Self::Closed(respell(path)),
            Self::Renamed(path) => Self::Renamed(respell(path)),
            other => other,
        }
    }
}

/// Translates an event of the system into signals.
fn signals(event: notify::Result<notify::Event>, mut send: impl FnMut(Signal)) {
    let Ok(event) = event else { return send(Signal::Overflow) };
    if event.need_rescan() {
        return send(Signal::Overflow);
    }
    let mut paths = event.paths.into_iter();
    match event.kind {
        EventKind::Access(AccessKind::Close(AccessMode::Write)) => {
            paths.for_each(|path| send(Signal::Closed(path)));
        }
        EventKind::Modify(ModifyKind::Name(RenameMode::To)) => {
            paths.for_each(|path| send(Signal::Renamed(path)));
        }
        EventKind::Modify(ModifyKind::Name(RenameMode::Both)) => {
            paths.next().into_iter().for_each(|from| send(Signal::Touched(from)));
            paths.for_each(|to| send(Signal::Renamed(to)));
        }
        EventKind::Modify(ModifyKind::Data(_)) if cfg!(target_os = "linux") => {
            paths.for_each(|path| send(Signal::Written(path)));
        }
        EventKind::Access(_) => {}
        _ => paths.for_each(|path| send(Signal::Touched(path))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use notify::event::{CreateKind, DataChange, Flag};

    fn signals_of(event: notify::Event) -> Vec<Signal> {
        let mut all = Vec::new();
        signals(Ok(event), |signal| all.push(signal));
        all
    }

    #[test]
    fn events_become_hints() {
        let event = |kind: EventKind| notify::Event::new(kind).add_path("a".into());
        let close = EventKind::Access(AccessKind::Close(AccessMode::Write));
        let renamed = |mode| EventKind::Modify(ModifyKind::Name(mode));
        let touched = |path: &str| Signal::Touched(path.into());
        let renamed_to = |path: &str| Signal::Renamed(path.into());

        assert_eq!(signals_of(event(close)), [Signal::Closed("a".into())]);
        assert_eq!(signals_of(event(renamed(RenameMode::To))), [renamed_to("a")]);
        assert_eq!(signals_of(event(renamed(RenameMode::From))), [touched("a")]);
        let both = event(renamed(RenameMode::Both)).add_path("b".into());
        assert_eq!(signals_of(both), [touched("a"), renamed_to("b")]);
        assert_eq!(signals_of(event(EventKind::Create(CreateKind::File))), [touched("a")]);
        // Other systems do not report when a file is closed.
        let written = if cfg!(target_os = "linux") { Signal::Written("a".into()) } else { touched("a") };
        assert_eq!(signals_of(event(EventKind::Modify(ModifyKind::Data(DataChange::Any)))), [written]);
        assert_eq!(signals_of(event(EventKind::Access(AccessKind::Open(AccessMode::Any)))), []);
        assert_eq!(
            signals_of(notify::Event::new(EventKind::Other).set_flag(Flag::Rescan)),
            [Signal::Overflow]
        );
        let mut all = Vec::new();
        signals(Err(notify::Error::generic("lost")), |signal| all.push(signal));
        assert_eq!(all, [Signal::Overflow]);
    }

    #[test]
    fn signals_use_the_path_of_the_settings() {
        let (from, to) = (Path::new("/srv/laser/hot"), Path::new("hot"));
        let closed = |path: &str| Signal::Closed(path.into());
        assert_eq!(closed("/srv/laser/hot/can.dxf").respelled(from, to), closed("hot/can.dxf"));
        assert_eq!(closed("/srv/laser/hot").respelled(from, to), closed("hot"));
        assert_eq!(closed("/srv/other/can.dxf").respelled(from, to), closed("/srv/other/can.dxf"));
    }
}
