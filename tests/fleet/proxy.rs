//! A network between a station and the database that the tests cut and hold up.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

const PASS: u8 = 0;
const HOLD: u8 = 1;
const CUT: u8 = 2;
const END: u8 = 3;

pub struct Proxy {
    pub port: u16,
    mode: Arc<AtomicU8>,
    /// How long each answer of the server takes, ms.
    latency: Arc<AtomicU64>,
}

impl Proxy {
    pub fn to(port: u16) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let proxy = Self {
            port: listener.local_addr().unwrap().port(),
            mode: Arc::default(),
            latency: Arc::default(),
        };
        let (mode, latency) = (proxy.mode.clone(), proxy.latency.clone());
        std::thread::spawn(move || {
            for client in listener.incoming() {
                let Ok(client) = client else { continue };
                match mode.load(Ordering::SeqCst) {
                    END => return,
                    CUT => continue,
                    _ => {}
                }
                let Ok(server) = TcpStream::connect(("127.0.0.1", port)) else { continue };
                let at_once = Arc::<AtomicU64>::default();
                for (from, to, latency) in [(&client, &server, &at_once), (&server, &client, &latency)] {
                    let (from, to) = (from.try_clone().unwrap(), to.try_clone().unwrap());
                    let (mode, latency) = (mode.clone(), latency.clone());
                    std::thread::spawn(move || carry(from, to, &mode, &latency));
                }
            }
        });
        proxy
    }

    /// Lets everything through.
    pub fn pass(&self) {
        self.mode.store(PASS, Ordering::SeqCst);
    }

    /// Keeps all connections open and lets nothing through, as a server that hangs.
    pub fn hold(&self) {
        self.mode.store(HOLD, Ordering::SeqCst);
    }

    /// Closes all connections, and refuses others.
    pub fn cut(&self) {
        self.mode.store(CUT, Ordering::SeqCst);
    }

    /// From now on each answer of the server takes this long, however much it is.
    pub fn delay(&self, latency: Duration) {
        self.latency.store(latency.as_millis() as u64, Ordering::SeqCst);
    }

    pub fn url(&self, login: &str) -> String {
        format!("postgresql://{login}@127.0.0.1:{}/isomark", self.port)
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        self.mode.store(END, Ordering::SeqCst);
        let _ = TcpStream::connect(("127.0.0.1", self.port));
    }
}

fn carry(mut from: TcpStream, to: TcpStream, mode: &AtomicU8, latency: &AtomicU64) {
    from.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let mut bytes = [0; 1 << 16];
    let (sender, under_way) = channel::<(Instant, Vec<u8>)>();
    let mut target = to.try_clone().unwrap();
    let late = std::thread::spawn(move || {
        for (due, bytes) in under_way {
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            if target.write_all(&bytes).is_err() {
                return;
            }
        }
    });
    loop {
        match mode.load(Ordering::SeqCst) {
            PASS => {}
            HOLD => {
                std::thread::sleep(Duration::from_millis(20));
                continue;
            }
            _ => break,
        }
        match from.read(&mut bytes) {
            Ok(0) => break,
            Ok(count) => {
                let due = Instant::now() + Duration::from_millis(latency.load(Ordering::SeqCst));
                if sender.send((due, bytes[..count].to_vec())).is_err() {
                    break;
                }
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => break,
        }
    }
    drop(sender);
    if mode.load(Ordering::SeqCst) == PASS {
        let _ = late.join();
    }
    let _ = from.shutdown(Shutdown::Both);
    let _ = to.shutdown(Shutdown::Both);
}
