//! How a station asks workers for the surface of a heavy part, and takes it back.
//!
//! The thread of the job waits, the thread of the fleet works in the database:
//!
//! ```text
//! job ──Ask──▶ request ──NOTIFY──▶ worker ──▶ fit, and NOTIFY ──▶ fetched into the cache ──Kept──▶ job
//!  │                                 │
//!  └──Leave, and makes it itself ◀───┴── not taken, late, failed, or the database is away
//! ```

use std::collections::BTreeMap;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio_postgres::types::Type;

use super::error::FleetError;
use super::session::Session;
use crate::cache::{Cache, CacheKey, PartOrigin};
use crate::config::Sku;
use crate::printable::on_one_line;

/// How long a request may wait for a worker.
const TAKING: Duration = Duration::from_secs(2);
/// The network over which a request is sent within that time and one second for this many bytes.
const SENDING: usize = 16 << 20;
/// The longest time until the station looks at a request that a worker has.
const LOOK: Duration = Duration::from_secs(3);
/// How long the database may not answer to a look.
const SILENCE: Duration = Duration::from_secs(10);
/// How long a station waits for a worker at all.
const LONGEST: Duration = Duration::from_secs(120);
/// The slowest network over which parts are sent, bytes in a second.
const SLOWEST: usize = 50_000;

/// A fit that is asked for.
#[derive(Debug, Clone)]
pub(super) struct Wish {
    pub(super) cache: Cache,
    pub(super) sku: Sku,
    pub(super) part: PartOrigin,
}

/// What the thread of the fleet does with a request.
pub(super) enum Step {
    /// Asks for the fit; the bytes are the part with the settings of its fit.
    Ask(Vec<u8>),
    /// Looks at its state.
    Look,
    /// Does not wait for it any more.
    Leave,
}

/// What the job hears of its request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum News {
    /// No worker has it.
    Waits,
    /// A worker has it and gave a sign of life.
    IsTaken,
    /// The cache has the fit now.
    Kept,
    /// There will be none.
    Over,
}

/// What a step leaves to do.
pub(super) enum After {
    Nothing,
    /// The fleet has the fit.
    Fetch(Wish),
}

/// The requests that jobs of this station wait for.
#[derive(Default)]
pub(super) struct Asking {
    asked: Mutex<BTreeMap<CacheKey, Asked>>,
}

struct Asked {
    wish: Wish,
    news: SyncSender<News>,
    /// Whether the job was told that there will be none: notifications may come in pairs, and a person reads of it once.
    is_over: bool,
}

impl Asking {
    fn asked(&self) -> MutexGuard<'_, BTreeMap<CacheKey, Asked>> {
        self.asked.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks for a fit and waits for it in the thread of a job; returns whether the cache has it now. `order` gives a step to the
    /// thread of the fleet.
    pub(super) fn wait(
        &self,
        wish: Wish,
        key: &CacheKey,
        task: Vec<u8>,
        order: impl Fn(Step) -> bool,
    ) -> bool {
        // More news than this is not needed: the job looks again.
        let (news, heard) = sync_channel(16);
        {
            let mut asked = self.asked();
            if asked.contains_key(key) {
                // Another SKU has the same part.
                return false;
            }
            asked.insert(key.clone(), Asked { wish, news, is_over: false });
        }
        let sending = Duration::from_secs((task.len() / SENDING) as u64);
        let mut is_kept = false;
        if order(Step::Ask(task)) {
            let mut wait = Wait::begin(Instant::now(), TAKING + sending);
            while let Some(pause) = wait.pause(Instant::now()) {
                let event = match heard.recv_timeout(pause) {
                    Ok(News::Kept) => {
                        is_kept = true;
                        break;
                    }
                    Ok(News::Over) | Err(RecvTimeoutError::Disconnected) => break,
                    Ok(News::Waits) => Event::Waits,
                    Ok(News::IsTaken) => Event::IsTaken,
                    Err(RecvTimeoutError::Timeout) => {
                        if wait.is_taken {
                            order(Step::Look);
                        }
                        continue;
                    }
                };
                wait.hear(event, Instant::now());
            }
        }
        self.asked().remove(key);
        order(Step::Leave);
        is_kept
    }

    /// The key of a request of this station.
    pub(super) fn own(&self, key: &str) -> Option<CacheKey> {
        self.asked().keys().find(|known| known.as_str() == key).cloned()
    }

    /// The database is away: no job waits.
    pub(super) fn give_up(&self) {
        for (_, asked) in std::mem::take(&mut *self.asked()) {
            let _ = asked.news.try_send(News::Over);
        }
    }

    pub(super) fn tell(&self, key: &CacheKey, news: News) {
        if let Some(asked) = self.asked().get_mut(key) {
            let is_told = asked.news.try_send(news).is_ok();
            asked.is_over |= is_told && news == News::Over;
        }
    }

    /// What a job waits for that has not heard that there will be none.
    fn wish(&self, key: &CacheKey) -> Option<Wish> {
        self.asked().get(key).filter(|asked| !asked.is_over).map(|asked| asked.wish.clone())
    }

    /// Leaves what the station asked for in an earlier connection.
    pub(super) async fn leave_all(&self, session: &Session, station: &str) -> Result<(), FleetError> {
        let statement =
            "SELECT isomark.leave_fit(key, station) FROM isomark.fit_asker WHERE station = $1 LIMIT 10000";
        session.rows(statement, &[(&station, Type::TEXT)]).await.map(drop)
    }

    /// Does a step in the database.
    pub(super) async fn step(
        &self,
        session: &Session,
        station: &str,
        key: &CacheKey,
        step: Step,
    ) -> Result<After, FleetError> {
        match step {
            Step::Ask(task) => match self.wish(key) {
                Some(wish) => self.ask(session, station, key, wish, task).await,
                None => Ok(After::Nothing),
            },
            Step::Look => match self.wish(key) {
                Some(wish) => self.look(session, key, wish).await,
                None => Ok(After::Nothing),
            },
            // The next job may wait for it already.
            Step::Leave if self.wish(key).is_some() => Ok(After::Nothing),
            Step::Leave => {
                let values = [(&key.as_str() as _, Type::TEXT), (&station as _, Type::TEXT)];
                session.rows("SELECT isomark.leave_fit($1, $2)", &values).await?;
                Ok(After::Nothing)
            }
        }
    }

    async fn ask(
        &self,
        session: &Session,
        station: &str,
        key: &CacheKey,
        wish: Wish,
        task: Vec<u8>,
    ) -> Result<After, FleetError> {
        let maker = CacheKey::maker();
        let row = session
            .row(
                "SELECT isomark.join_fit($1, $2, $3)",
                &[(&key.as_str(), Type::TEXT), (&station, Type::TEXT), (&maker, Type::TEXT)],
            )
            .await?;
        match row.try_get(0)? {
            "there" => Ok(After::Fetch(wish)),
            "asked" => self.look(session, key, wish).await,
            "ask" => {
                let patience = Duration::from_secs((task.len() / SLOWEST) as u64);
                let task_blake3 = blake3::hash(&task).to_hex().to_string();
                session
                    .rows_within(
                        Session::ANSWER + patience,
                        "SELECT isomark.ask_for_fit($1, $2, $3, $4, $5, $6, $7)",
                        &[
                            (&key.as_str(), Type::TEXT),
                            (&station, Type::TEXT),
                            (&maker, Type::TEXT),
                            (&wish.sku.as_str(), Type::TEXT),
                            (&wish.part.blake3, Type::TEXT),
                            (&task, Type::BYTEA),
                            (&task_blake3, Type::TEXT),
                        ],
                    )
                    .await?;
                Ok(After::Nothing)
            }
            _ => {
                self.tell(key, News::Over);
                Ok(After::Nothing)
            }
        }
    }

    async fn look(&self, session: &Session, key: &CacheKey, wish: Wish) -> Result<After, FleetError> {
        let rows = session
            .rows(
                "SELECT state, coalesce(lease < now(), false), left(reason, 500) FROM isomark.fit_request WHERE key = $1",
                &[(&key.as_str(), Type::TEXT)],
            )
            .await?;
        let Some(row) = rows.first() else {
            self.tell(key, News::Over);
            return Ok(After::Nothing);
        };
        let (state, is_late): (&str, bool) = (row.try_get(0)?, row.try_get(1)?);
        match state {
            "made" => return Ok(After::Fetch(wish)),
            "waiting" => self.tell(key, News::Waits),
            "taken" if !is_late => self.tell(key, News::IsTaken),
            "taken" => {
                tracing::warn!("the worker with the part of {} is late: it is fitted here", wish.sku);
                self.tell(key, News::Over);
            }
            _ => {
                let reason: Option<&str> = row.try_get(2)?;
                let reason = on_one_line(reason.unwrap_or("no reason was given"));
                tracing::info!(
                    "a worker could not fit the part of {}, which is fitted here: {reason}",
                    wish.sku
                );
                self.tell(key, News::Over);
            }
        }
        Ok(After::Nothing)
    }
}

enum Event {
    Waits,
    IsTaken,
}

/// How long a job still waits.
struct Wait {
    is_taken: bool,
    /// When it stops waiting, unless it hears something.
    until: Instant,
    /// When it stops in any case.
    end: Instant,
}

impl Wait {
    fn begin(now: Instant, taking: Duration) -> Self {
        Self { is_taken: false, until: now + taking, end: now + LONGEST }
    }

    /// The time until it looks again; `None` if it does not wait any more.
    fn pause(&self, now: Instant) -> Option<Duration> {
        let left = self.until.min(self.end).saturating_duration_since(now);
        let pause = if self.is_taken { left.min(LOOK) } else { left };
        (!left.is_zero()).then_some(pause)
    }

    fn hear(&mut self, event: Event, now: Instant) {
        match event {
            Event::IsTaken => {
                self.is_taken = true;
                self.until = now + SILENCE;
            }
            Event::Waits if self.is_taken => {
                self.is_taken = false;
                self.until = now + TAKING;
            }
            Event::Waits => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_waits_two_seconds_for_a_worker_and_while_it_gives_signs_of_life_up_to_the_end() {
        let start = Instant::now();
        let at = |seconds: f64| start + Duration::from_secs_f64(seconds);
        let mut wait = Wait::begin(start, TAKING);
        wait.hear(Event::Waits, at(1.0));
        assert_eq!(wait.pause(at(1.5)), Some(Duration::from_millis(500)));
        assert_eq!(wait.pause(at(2.0)), None);
        wait.hear(Event::IsTaken, at(1.9));
        assert_eq!(wait.pause(at(1.9)), Some(LOOK));
        assert_eq!(wait.pause(at(11.0)), Some(Duration::from_millis(900)));
        assert_eq!(wait.pause(at(11.9)), None);
        // The worker ended and gave it back.
        wait.hear(Event::Waits, at(5.0));
        wait.hear(Event::Waits, at(6.0));
        assert_eq!(wait.pause(at(7.0)), None);
        for second in 0..200 {
            wait.hear(Event::IsTaken, at(f64::from(second)));
            assert_eq!(wait.pause(at(f64::from(second))).is_some(), second < 120, "{second} s");
        }
    }
}
