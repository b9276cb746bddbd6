//! What a service manager is told: that the station is ready, alive, about to end. On Linux by the protocol of
//! `sd_notify(3)`; elsewhere nobody asks.

use std::time::{Duration, Instant};

use crate::hotfolder::Pulse;

/// The service manager's ear, if there is one.
pub(super) struct ServiceManager {
    ear: ear::Ear,
    /// How often it wants to hear that the station is alive.
    interval: Option<Duration>,
    told: Option<Instant>,
}

impl ServiceManager {
    /// The one that started this process.
    pub(super) fn of_this_process() -> Self {
        let variable = |name: &str| std::env::var(name).ok();
        let for_us = variable("WATCHDOG_PID").is_none_or(|pid| pid == std::process::id().to_string());
        let interval = variable("WATCHDOG_USEC").filter(|_| for_us).and_then(|text| text.parse().ok());
        // Half of what is allowed, as sd_watchdog_enabled(3) advises.
        Self {
            ear: ear::Ear::find(),
            interval: interval.map(|us: u64| Duration::from_micros(us / 2)),
            told: None,
        }
    }

    /// Passes on what the station tells.
    pub(super) fn hear(&mut self, pulse: Pulse) {
        match pulse {
            Pulse::Ready => self.ear.tell("READY=1\nSTATUS=Takes drops"),
            Pulse::Stopping => self.ear.tell("STOPPING=1"),
            Pulse::Alive => {
                let due = |interval| self.told.is_none_or(|told| told.elapsed() >= interval);
                if self.interval.is_some_and(due) {
                    self.ear.tell("WATCHDOG=1");
                    self.told = Some(Instant::now());
                }
            }
        }
    }
}

#[cfg(target_os = "linux")]
mod ear {
    use std::os::linux::net::SocketAddrExt;
    use std::os::unix::ffi::OsStrExt;
    use std::os::unix::net::{SocketAddr, UnixDatagram};

    pub(super) struct Ear(Option<(UnixDatagram, SocketAddr)>);

    impl Ear {
        pub(super) fn find() -> Self {
            let found = std::env::var_os("NOTIFY_SOCKET").and_then(|name| {
                let address = match name.as_bytes() {
                    [b'@', name @ ..] => SocketAddr::from_abstract_name(name).ok()?,
                    _ => SocketAddr::from_pathname(&name).ok()?,
                };
                let socket = UnixDatagram::unbound().ok()?;
                socket.set_nonblocking(true).ok()?;
                Some((socket, address))
            });
            Self(found)
        }

        /// Nobody may be listening any more; that is no trouble of the station's.
        pub(super) fn tell(&self, words: &str) {
            if let Some((socket, address)) = &self.0 {
                let _ = socket.send_to_addr(words.as_bytes(), address);
            }
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod ear {
    pub(super) struct Ear;

    impl Ear {
        pub(super) fn find() -> Self {
            Self
        }

        pub(super) fn tell(&self, _: &str) {}
    }
}
