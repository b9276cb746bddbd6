//! The page of a running station for browsers: what is done, what waits for what, what was rejected and why.
//!
//! ```text
//! dispatcher ──status──▶ News ──▶ Board: the page as HTML ──▶ GET /, and GET /events with what changes
//!                                   └─▶ records: pictures and reports of the listed drawings ──▶ GET /picture/…, /report/…
//! POST /retry, /deliver-again ──▶ state/requests, or rejected/ back into hot/, as `isomark retry` does it
//! ```
//!
//! | file | contains |
//! |---|---|
//! | `news` | the newest status, for the thread of the page |
//! | `access` | who may ask: host, origin, token, password |
//! | `socket` | one connection: its bytes and its time limits |
//! | `server` | all connections: how many, and which one is closed for a new one |
//! | `answers` | requests to answers |
//! | `board` | the newest state as HTML, for all clients |
//! | `content`, `fleet`, `pieces` | that HTML |
//! | `records` | the files and actions behind the links and buttons |
//! | `page.css`, `page.js` | style and script |
//!
//! The page never slows the station. It has a thread of its own, gets a copy of each status, and takes no lock that a job
//! needs. All numbers are bounded: connections, streams of events, bytes in memory, and the time of each answer. A client that
//! reads slowly skips to the newest state. Every connection serves one request, so that its limits are simple.
//!
//! A request names a file or an action only by a key, which the page made for it. So no path and no name ever comes from a
//! request.

mod news;
mod access;
mod socket;
mod server;
mod answers;
mod board;
mod pieces;
mod fleet;
mod content;
mod records;

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::runtime::Builder;
use tokio::sync::watch;
use tokio::task::LocalSet;
use tokio::time::timeout;

use crate::config::{FolderPaths, PageSettings, Station};
use crate::hotfolder::state::status::Status;
use crate::reason::Reason;

use access::Access;
use news::{News, Seen};

/// The pause between two attempts to open the page.
const PAUSE: Duration = Duration::from_secs(5);
/// Threads that read files and folders; there, a share that does not answer delays only the page.
const READERS: usize = 4;

/// Why the page could not be opened: its password cannot be read or is too short.
#[cfg(feature = "cli")]
pub(crate) fn page_trouble(page: &PageSettings) -> Option<Reason> {
    page.password.as_ref().and_then(access::password_trouble)
}

/// The page of a station, as the station uses it.
pub(crate) struct Page {
    settings: PageSettings,
    news: watch::Sender<News>,
    /// Why the page is not open.
    trouble: Mutex<Option<String>>,
}

/// Ends the page when it is dropped.
pub(crate) struct Ends<'p>(&'p Page);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.news.send_modify(|news| news.has_ended = true);
    }
}

impl Page {
    /// The page that the settings ask for.
    pub(crate) fn of(station: &Station) -> Option<Self> {
        let settings = station.page.clone()?;
        let trouble = Mutex::new(None);
        Some(Self { settings, news: watch::Sender::new(News::default()), trouble })
    }

    /// Ends the page when the returned guard is dropped.
    pub(crate) fn end_on_drop(&self) -> Ends<'_> {
        Ends(self)
    }

    /// Shows a status.
    pub(crate) fn publish(&self, status: Status, folders: &FolderPaths, state: &Path) {
        let seen = Arc::new(Seen { status, folders: folders.clone(), state: state.into() });
        self.news.send_modify(|news| news.seen = Some(seen));
    }

    /// Why the page is not open; `None` while it is.
    pub(crate) fn trouble(&self) -> Option<String> {
        self.lock_trouble().clone()
    }

    fn lock_trouble(&self) -> MutexGuard<'_, Option<String>> {
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Serves the page until the station ends.
    pub(crate) fn run(&self) {
        let runtime =
            Builder::new_current_thread().enable_io().enable_time().max_blocking_threads(READERS).build();
        let runtime = match runtime {
            Ok(runtime) => runtime,
            Err(error) => return self.complain(&unavailable(&self.settings, &error)),
        };
        LocalSet::new().block_on(&runtime, self.serve());
        // A reader that hangs on a share must not delay the end of the station.
        runtime.shutdown_background();
    }

    async fn serve(&self) {
        let mut news = self.news.subscribe();
        let (listener, access) = loop {
            match self.open() {
                Ok(opened) => break opened,
                Err(reason) => self.complain(&reason),
            }
            if timeout(PAUSE, news.wait_for(|news| news.has_ended)).await.is_ok() {
                return;
            }
        };
        *self.lock_trouble() = None;
        tracing::info!("the page of the station is at {}", access.shown_address());
        server::serve(listener, access, news).await;
    }

    /// Opens the port and reads the password.
    fn open(&self) -> Result<(tokio::net::TcpListener, Access), Reason> {
        let secrets = access::Secrets::new(self.settings.password.as_ref())?;
        let unavailable = |error| unavailable(&self.settings, &error);
        let listener = std::net::TcpListener::bind(self.settings.address).map_err(unavailable)?;
        listener.set_nonblocking(true).map_err(unavailable)?;
        let listener = tokio::net::TcpListener::from_std(listener).map_err(unavailable)?;
        let address = listener.local_addr().map_err(unavailable)?;
        Ok((listener, Access::new(address, self.settings.names.clone(), secrets)))
    }

    /// Reports once why the page cannot be opened.
    fn complain(&self, reason: &Reason) {
        let text = format!("{} The station works without its page.", reason.on_one_line());
        let mut trouble = self.lock_trouble();
        if trouble.as_ref() != Some(&text) {
            tracing::error!("{text}");
            *trouble = Some(text);
        }
    }
}

fn unavailable(settings: &PageSettings, error: &std::io::Error) -> Reason {
    let address = settings.address;
    let what = format!("The page cannot be opened at {address}: {error}.");
    let remedy = "Stop the program that uses this address, or give another port with `--page` or as `address` under [page]. isomark \
                  tries again.";
    Reason::new("page-address", what, remedy)
}
