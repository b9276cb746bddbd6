//! Whose turn it is: BeamServer talks to one client at a time.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::client::TalkError;
use crate::hotfolder::api::JobError;
use crate::hotfolder::seen::StopSignal;
use crate::reason::Reason;

/// How long somebody who waits for his turn goes on waiting for one and the same other.
const PATIENCE: Duration = Duration::from_secs(2);
/// How long nobody tries to talk to a server that did not answer.
const REST: Duration = Duration::from_secs(2);

/// Who talks to BeamServer when: it knows one client. A drawing that would have to wait for a server that does not
/// answer is told so at once, so that its thread can do something else.
pub(crate) struct Gate {
    state: Mutex<GateState>,
    free: Condvar,
    /// A station that is to stop does not wait for a server that answers slowly.
    stop: StopSignal,
}

#[derive(Default)]
struct GateState {
    /// Since when somebody talks to it.
    busy_since: Option<Instant>,
    /// Why nobody could the last time, and until when nobody tries again.
    silent: Option<(Reason, Instant)>,
}

impl Gate {
    pub(crate) fn new(stop: StopSignal) -> Self {
        Self { state: Mutex::default(), free: Condvar::new(), stop }
    }

    fn state(&self) -> MutexGuard<'_, GateState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Talks to BeamServer when it is one's turn.
    ///
    /// # Errors
    /// To be tried again when the turn does not come soon; else what `talk` says.
    pub(crate) fn exclusive<T>(
        &self,
        talk: impl FnOnce(&StopSignal) -> Result<T, TalkError>,
    ) -> Result<T, JobError> {
        let _turn = self.turn()?;
        let said = talk(&self.stop);
        self.state().silent = match &said {
            Err(TalkError::Ill(reason)) => Some((reason.clone(), Instant::now() + REST)),
            _ => None,
        };
        said.map_err(|error| match error {
            TalkError::Ill(reason) => JobError::Retry(reason),
            TalkError::Job(error) => error,
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
                let what = "BeamServer is at another drawing.";
                return Err(JobError::Retry(Reason::new(
                    "beamserver-busy",
                    what,
                    "Nothing: it is tried again.",
                )));
            }
            state = self.free.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        state.busy_since = Some(Instant::now());
        Ok(Pass(self))
    }
}

/// Somebody's turn, until it is dropped.
struct Pass<'a>(&'a Gate);

impl Drop for Pass<'_> {
    fn drop(&mut self) {
        self.0.state().busy_since = None;
        self.0.free.notify_one();
    }
}
