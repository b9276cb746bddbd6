//! All connections of the page. Their number is bounded: for a new one, the oldest one that has sent no complete request is
//! closed.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::rc::Rc;
use std::time::Duration;

use hyper::server::conn::http1;
use hyper::service::service_fn;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::{AbortHandle, spawn_local};
use tokio::time::sleep;

use super::access::Access;
use super::answers::{self, Client};
use super::board::{self, Desk, Either, either};
use super::news::News;
use super::socket::{Limits, Socket, within};

/// Connections at the same time. The streams of events are fewer.
const MAX_CONNECTIONS: usize = 64;
/// How long a client may take for its request.
const REQUEST: Duration = Duration::from_secs(5);
/// The largest request without its body, bytes.
const LARGEST_REQUEST: usize = 16 << 10;
const MAX_HEADERS: usize = 64;
/// The pause after a connection could not be accepted: the system may have too many open files.
const PAUSE: Duration = Duration::from_millis(100);
/// How long the clients have for the last event.
const GRACE: Duration = Duration::from_millis(300);

/// The open connections, by the order of their arrival.
type Table = Rc<RefCell<BTreeMap<u64, Connection>>>;

struct Connection {
    limits: Rc<Limits>,
    task: AbortHandle,
}

/// Removes a connection from the table when it is dropped: its task may end or be aborted.
struct Entry {
    table: Table,
    number: u64,
}

impl Drop for Entry {
    fn drop(&mut self) {
        self.table.borrow_mut().remove(&self.number);
    }
}

/// Serves the page until the station ends.
pub(super) async fn serve(listener: TcpListener, access: Access, mut news: watch::Receiver<News>) {
    let desk = Desk::new(access);
    spawn_local(board::keep(Rc::clone(&desk), news.clone()));
    spawn_local(board::look(Rc::clone(&desk)));
    let table = Table::default();
    let mut number = 0;
    loop {
        match either(listener.accept(), news.wait_for(|news| news.has_ended)).await {
            Either::One(Ok((stream, sender))) => {
                number += 1;
                if make_room(&table) {
                    open(&desk, &table, number, stream, sender);
                }
            }
            Either::One(Err(_)) => sleep(PAUSE).await,
            Either::Other(_) => break,
        }
    }
    drop(listener);
    for _ in 0..10 {
        if table.borrow().is_empty() {
            return;
        }
        sleep(GRACE / 10).await;
    }
}

/// Closes the oldest connection without a complete request, if there are too many; `false` if all have one.
fn make_room(table: &Table) -> bool {
    let table = table.borrow();
    if table.len() < MAX_CONNECTIONS {
        return true;
    }
    let idle =
        table.values().find(|connection| !connection.limits.has_asked() && !connection.task.is_finished());
    idle.map(|connection| connection.task.abort()).is_some()
}

fn open(desk: &Rc<Desk>, table: &Table, number: u64, stream: TcpStream, sender: SocketAddr) {
    // Without it, the last bytes of each event wait for the confirmation of the others.
    let _ = stream.set_nodelay(true);
    let Ok(local) = stream.local_addr() else { return };
    let limits = Limits::new(REQUEST);
    let client = Client { sender: sender.ip(), local, limits: Rc::clone(&limits) };
    let (desk, entry) = (Rc::clone(desk), Entry { table: Rc::clone(table), number });
    let task = spawn_local(async move {
        let _entry = entry;
        let service = service_fn(|request| answers::answer(Rc::clone(&desk), client.clone(), request));
        let mut builder = http1::Builder::new();
        builder
            .keep_alive(false)
            .header_read_timeout(None)
            .max_buf_size(LARGEST_REQUEST)
            .max_headers(MAX_HEADERS);
        let connection = builder.serve_connection(Socket::new(stream, Rc::clone(&client.limits)), service);
        // A client that breaks the protocol or goes away is no error of the station.
        let _ = within(&client.limits, connection).await;
    });
    table.borrow_mut().insert(number, Connection { limits, task: task.abort_handle() });
}
