//! Gives access to BeamServer, which serves one client at a time.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::client::SessionError;
use crate::hotfolder::api::JobError;
use crate::hotfolder::seen::StopSignal;
use crate::reason::Reason;

/// How long a thread waits for its turn while another session is running.
const PATIENCE: Duration = Duration::from_secs(2);
/// The pause before the next session with a server that did not answer.
const REST: Duration = Duration::from_secs(2);

/// Lets one thread at a time use BeamServer. If the server does not answer, other drawings fail at once, so that their
/// threads can do other jobs.
pub(crate) struct Gate {
    state: Mutex<GateState>,
    free: Condvar,
    /// A station that is stopping does not wait for a slow server.
    stop: StopSignal,
}

#[derive(Default)]
struct GateState {
    /// When the current session started.
    busy_since: Option<Instant>,
    /// Why the last session failed, and when the next one may start.
    silent: Option<(Reason, Instant)>,
}

impl Gate {
    pub(crate) fn new(stop: StopSignal) -> Self {
        Self { state: Mutex::default(), free: Condvar::new(), stop }
    }

    fn state(&self) -> MutexGuard<'_, GateState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs a session with BeamServer when no other one is running.
    ///
    /// # Errors
    /// [`JobError::Retry`] when another session takes too long; otherwise the error of `session`.
    pub(crate) fn exclusive<T>(
        &self,
        session: impl FnOnce(&StopSignal) -> Result<T, SessionError>,
    ) -> Result<T, JobError> {
        let _turn = self.turn()?;
        let result = session(&self.stop);
        self.state().silent = match &result {
            Err(SessionError::Server(reason)) => Some((reason.clone(), Instant::now() + REST)),
            _ => None,
        };
        result.map_err(|error| match error {
            SessionError::Server(reason) => JobError::Retry(reason),
            SessionError::Job(error) => error,
        })
    }

    fn turn(&self) -> Result<Pass<'_>, JobError> {
        let mut state = self.state();
        loop {
            let now = Instant::now();
            if let Some((reason, until)) = &state.silent
                && (state.busy_since.is_some() || now < *until)
            {
                return Err(JobError::Retry(reason.clone()));
            }
            let Some(since) = state.busy_since else { break };
            let left = PATIENCE.saturating_sub(now.duration_since(since));
            if left.is_zero() {
                let what = "BeamServer is busy with another drawing.";
                return Err(JobError::Retry(Reason::new(
                    "beamserver-busy",
                    what,
                    "Wait: isomark tries again.",
                )));
            }
            state = self.free.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        state.busy_since = Some(Instant::now());
        Ok(Pass(self))
    }
}

/// Permission for one session; dropping it ends the turn.
struct Pass<'a>(&'a Gate);

impl Drop for Pass<'_> {
    fn drop(&mut self) {
        self.0.state().busy_since = None;
        self.0.free.notify_one();
    }
}
