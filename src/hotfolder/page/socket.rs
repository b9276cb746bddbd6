//! One connection: its bytes for the HTTP library, and its time limits.

use std::cell::Cell;
use std::future::{Future, poll_fn};
use std::io;
use std::pin::{Pin, pin};
use std::rc::Rc;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use hyper::rt::{Read, ReadBufCursor, Write};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::{Instant, sleep_until};

/// How long a client may take no bytes that are waiting for it.
const LONGEST_STALL: Duration = Duration::from_secs(10);

/// A connection to a client.
pub(super) struct Socket {
    stream: TcpStream,
    limits: Rc<Limits>,
}

/// The time limits of a connection.
pub(super) struct Limits {
    /// When it is closed; `None` for a stream of events.
    end: Cell<Option<Instant>>,
    /// Since when the client takes no bytes.
    stalled: Cell<Option<Instant>>,
    /// Whether its request is complete.
    has_asked: Cell<bool>,
}

impl Limits {
    /// The limits of a new connection, which has this time for its request.
    pub(super) fn new(request: Duration) -> Rc<Self> {
        let end = Cell::new(Some(Instant::now() + request));
        Rc::new(Self { end, stalled: Cell::new(None), has_asked: Cell::new(false) })
    }

    pub(super) fn has_asked(&self) -> bool {
        self.has_asked.get()
    }

    /// The request is complete; the rest may take this time, or any time for a stream of events.
    pub(super) fn allow(&self, rest: Option<Duration>) {
        self.has_asked.set(true);
        self.end.set(rest.map(|rest| Instant::now() + rest));
    }

    fn due(&self) -> Option<Instant> {
        let stalled = self.stalled.get().map(|since| since + LONGEST_STALL);
        self.end.get().into_iter().chain(stalled).min()
    }
}

/// Runs a connection to its end, or until a limit is reached.
pub(super) async fn within<F: Future>(limits: &Limits, connection: F) -> Option<F::Output> {
    let mut connection = pin!(connection);
    let mut alarm = pin!(sleep_until(Instant::now()));
    poll_fn(|cx| {
        if let Poll::Ready(output) = connection.as_mut().poll(cx) {
            return Poll::Ready(Some(output));
        }
        // The limits changed with what the connection did just now.
        let Some(due) = limits.due() else { return Poll::Pending };
        if alarm.deadline() != due {
            alarm.as_mut().reset(due);
        }
        alarm.as_mut().poll(cx).map(|()| None)
    })
    .await
}

impl Socket {
    pub(super) fn new(stream: TcpStream, limits: Rc<Limits>) -> Self {
        Self { stream, limits }
    }

    /// Notes whether the client takes bytes.
    fn noted<T>(&self, written: Poll<T>) -> Poll<T> {
        match &written {
            Poll::Pending if self.limits.stalled.get().is_some() => {}
            Poll::Pending => self.limits.stalled.set(Some(Instant::now())),
            Poll::Ready(_) => self.limits.stalled.set(None),
        }
        written
    }
}

impl Read for Socket {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        mut into: ReadBufCursor<'_>,
    ) -> Poll<io::Result<()>> {
        // Copied, because only unsafe code could read into the buffer itself.
        let mut bytes = [0; 2048];
        let size = into.remaining().min(bytes.len());
        let mut buffer = ReadBuf::new(&mut bytes[..size]);
        ready!(Pin::new(&mut self.stream).poll_read(cx, &mut buffer))?;
        into.put_slice(buffer.filled());
        Poll::Ready(Ok(()))
    }
}

impl Write for Socket {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(cx, bytes);
        self.noted(written)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(cx, bytes);
        self.noted(written)
    }
}
