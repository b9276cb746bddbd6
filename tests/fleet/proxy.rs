//! A network between a station and the database that the tests cut and hold up.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

const PASS: u8 = 0;
const HOLD: u8 = 1;
const CUT: u8 = 2;
const END: u8 = 3;

pub struct Proxy {
    pub port: u16,
    mode: Arc<AtomicU8>,
}

impl Proxy {
    pub fn to(port: u16) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let proxy = Self { port: listener.local_addr().unwrap().port(), mode: Arc::default() };
        let mode = proxy.mode.clone();
        std::thread::spawn(move || {
            for client in listener.incoming() {
                let Ok(client) = client else { continue };
                match mode.load(Ordering::SeqCst) {
                    END => return,
                    CUT => continue,
                    _ => {}
                }
                let Ok(server) = TcpStream::connect(("127.0.0.1", port)) else { continue };
                for (from, to) in [(&client, &server), (&server, &client)] {
                    let (from, to, mode) = (from.try_clone().unwrap(), to.try_clone().unwrap(), mode.clone());
                    std::thread::spawn(move || carry(from, to, &mode));
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

fn carry(mut from: TcpStream, mut to: TcpStream, mode: &AtomicU8) {
    from.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let mut bytes = [0; 1 << 16];
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
                if to.write_all(&bytes[..count]).is_err() {
                    break;
                }
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => break,
        }
    }
    let _ = from.shutdown(Shutdown::Both);
    let _ = to.shutdown(Shutdown::Both);
}
