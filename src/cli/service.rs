//! Notifications to a service manager such as systemd: the station is ready, is alive, is about to end. Only on Unix.

use std::time::{Duration, Instant};

use crate::hotfolder::Pulse;

/// The service manager, if it asked for notifications.
pub(super) struct ServiceManager {
    /// How often it needs to hear that the station is alive.
    interval: Option<Duration>,
    alive_at: Option<Instant>,
}

impl ServiceManager {
    /// The one that started this process.
    pub(super) fn of_this_process() -> Self {
        // Half of what is allowed, as sd_watchdog_enabled(3) advises.
        Self { interval: systemd::watchdog().map(|allowed| allowed / 2), alive_at: None }
    }

    /// Passes a pulse of the station on.
    pub(super) fn hear(&mut self, pulse: Pulse) {
        if pulse == Pulse::Alive {
            let is_due = |interval| self.alive_at.is_none_or(|at| at.elapsed() >= interval);
            if !self.interval.is_some_and(is_due) {
                return;
            }
            self.alive_at = Some(Instant::now());
        }
        systemd::notify(pulse);
    }
}

#[cfg(unix)]
mod systemd {
    use std::time::Duration;

    use sd_notify::NotifyState::{Ready, Status, Stopping, Watchdog};

    use crate::hotfolder::Pulse;

    pub(super) fn watchdog() -> Option<Duration> {
        sd_notify::watchdog_enabled()
    }

    pub(super) fn notify(pulse: Pulse) {
        // A manager that no longer listens does not stop the station.
        let _ = match pulse {
            Pulse::Ready => sd_notify::notify(&[Ready, Status("Takes drops")]),
            Pulse::Alive => sd_notify::notify(&[Watchdog]),
            Pulse::Stopping => sd_notify::notify(&[Stopping]),
        };
    }
}

#[cfg(not(unix))]
mod systemd {
    use std::time::Duration;

    use crate::hotfolder::Pulse;

    pub(super) fn watchdog() -> Option<Duration> {
        None
    }

    pub(super) fn notify(_: Pulse) {}
}
