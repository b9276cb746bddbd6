//! The newest state of the station as HTML, made once for all clients.

use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::rc::Rc;
use std::sync::Arc;
use std::task::Poll;
use std::time::{Duration, SystemTime};

use hyper::body::Bytes;
use serde_json::{Map, json};
use tokio::sync::{Notify, Semaphore, watch};
use tokio::task::spawn_blocking;
use tokio::time::{Instant, sleep, timeout};

use super::access::Access;
use super::content::{Content, Frame, InRejected, PIECES};
use super::news::{News, Seen};
use super::records;
use crate::hotfolder::jobs::rejected::rejected_among;

/// The page is made again after this time, because a station that hangs reports nothing.
const TICK: Duration = Duration::from_secs(5);
/// Time between two looks into the rejected folder while the page is open.
const LOOK: Duration = Duration::from_secs(10);
/// The shortest time between two of these looks.
const SHORTEST_LOOK: Duration = Duration::from_secs(1);
/// The page is treated as open for this time after its last request.
const VISIT: Duration = Duration::from_secs(60);
/// Streams of events at the same time.
const MAX_STREAMS: usize = 40;

/// What all connections share.
pub(super) struct Desk {
    pub(super) access: RefCell<Access>,
    pub(super) frame: Frame,
    /// Names this start of the station: its pages have other tokens than those of the last start.
    pub(super) version: String,
    pub(super) board: watch::Sender<Arc<Board>>,
    /// Memory for files that are being sent.
    pub(super) room: Arc<Semaphore>,
    /// The turns of those who read a file.
    pub(super) reading: Arc<Semaphore>,
    pub(super) streams: Arc<Semaphore>,
    /// One action at a time.
    pub(super) acting: Semaphore,
    rejected: RefCell<InRejected>,
    rejected_changed: Notify,
    look: Notify,
    visited: Cell<Instant>,
}

/// The page of one moment.
pub(super) struct Board {
    pub(super) content: Content,
    pub(super) station: String,
    /// The status that it shows; `None` before the first one.
    pub(super) seen: Option<Arc<Seen>>,
    /// The station has ended.
    pub(super) is_last: bool,
}

impl Desk {
    pub(super) fn new(access: Access) -> Rc<Self> {
        let version = access.secrets().name(&["version"]);
        let content = Content::starting();
        let board = Board { content, station: "isomark".into(), seen: None, is_last: false };
        Rc::new(Self {
            access: RefCell::new(access),
            frame: Frame::new(),
            version,
            board: watch::Sender::new(Arc::new(board)),
            room: Arc::new(Semaphore::new(records::UNITS)),
            reading: Arc::new(Semaphore::new(records::READING)),
            streams: Arc::new(Semaphore::new(MAX_STREAMS)),
            acting: Semaphore::new(1),
            rejected: RefCell::default(),
            rejected_changed: Notify::new(),
            look: Notify::new(),
            visited: Cell::new(Instant::now()),
        })
    }

    /// Somebody looks at the page.
    pub(super) fn visit(&self) {
        if self.visited.replace(Instant::now()).elapsed() > LOOK {
            self.look.notify_one();
        }
    }

    /// The rejected folder has changed.
    pub(super) fn look_again(&self) {
        self.look.notify_one();
    }

    /// The event for a client to which `sent` was sent last.
    pub(super) fn event(&self, sent: Option<&Board>, now: &Board) -> Bytes {
        let mut pieces = Map::new();
        for (index, (id, piece)) in PIECES.iter().zip(&now.content.pieces).enumerate() {
            if sent.and_then(|sent| sent.content.pieces.get(index)) != Some(piece) {
                pieces.insert((*id).to_owned(), piece.as_str().into());
            }
        }
        let json = json!({ "version": self.version, "title": now.content.title, "pieces": pieces });
        Bytes::from(format!("event: state\ndata: {json}\n\n"))
    }
}

/// Makes the page again whenever something changes, until the station ends.
pub(super) async fn keep(desk: Rc<Desk>, mut news: watch::Receiver<News>) {
    let mut listed = None;
    loop {
        let News { seen, has_ended } = news.borrow_and_update().clone();
        if let Some(seen) = &seen {
            let status = &seen.status;
            let runs = status.running && !has_ended;
            let state = status.clone().seen(runs, SystemTime::now()).state;
            let newest = status.rejections.first().cloned();
            if listed.replace(newest.clone()) != Some(newest) {
                desk.look_again();
            }
            let content = {
                let (access, rejected) = (desk.access.borrow(), desk.rejected.borrow());
                Content::of(status, state, &rejected, access.secrets())
            };
            let board = Board {
                content,
                station: status.station.clone(),
                seen: Some(Arc::clone(seen)),
                is_last: has_ended,
            };
            desk.board.send_replace(Arc::new(board));
        }
        if has_ended {
            return;
        }
        // Both may happen again at once; then the page is made again.
        let _ = timeout(TICK, either(news.changed(), desk.rejected_changed.notified())).await;
    }
}

/// Looks into the rejected folder, in a thread that may wait for a share.
pub(super) async fn look(desk: Rc<Desk>) {
    loop {
        let seen = desk.board.borrow().seen.clone();
        if let Some(seen) = seen {
            let look = move || {
                let drops: BTreeSet<&str> =
                    seen.status.rejections.iter().map(|rejection| rejection.drop.as_str()).collect();
                rejected_among(&seen.folders.rejected, &drops)
            };
            if let Ok(Ok((count, drops))) = spawn_blocking(look).await {
                let found = InRejected { count: Some(count), drops };
                if desk.rejected.replace_with(|_| found.clone()) != found {
                    desk.rejected_changed.notify_one();
                }
            }
            sleep(SHORTEST_LOOK).await;
        }
        while timeout(LOOK, desk.look.notified()).await.is_err() && desk.visited.get().elapsed() > VISIT {}
    }
}

/// The result of the one of two futures that ends first.
pub(super) enum Either<A, B> {
    One(A),
    Other(B),
}

pub(super) async fn either<A: Future, B: Future>(one: A, other: B) -> Either<A::Output, B::Output> {
    let (mut one, mut other) = (pin!(one), pin!(other));
    poll_fn(|cx| {
        if let Poll::Ready(output) = one.as_mut().poll(cx) {
            return Poll::Ready(Either::One(output));
        }
        other.as_mut().poll(cx).map(Either::Other)
    })
    .await
}
