//! A worker: a process without a laser that fits parts for the stations of a fleet.
//!
//! ```text
//! request ──take, with lease and attempt──▶ Worker ──one thread──▶ fit
//!    ▲  sign of life, every 3 s ◀───────────┘                       │
//!    └── fit and end of the request in one transaction, if the attempt is still its own ◀──┘
//! ```

use std::mem::{Discriminant, discriminant};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use tokio::runtime::Builder;
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::time::{Instant, timeout, timeout_at};
use tokio_postgres::types::Type;

use super::address::Address;
use super::error::{FleetError, Needed};
use super::fits;
use super::migrations;
use super::session::{Heard, Session};
use crate::cache::{CacheKey, FitTask, KeptBytes};
use crate::config::{FleetSettings, Sku};
use crate::printable::on_one_line;

/// The time between two signs of life without and with work.
const BEAT: Duration = Duration::from_secs(10);
const KEEPING: Duration = Duration::from_secs(3);
/// The first pause after a failed connection; it doubles up to [`LONGEST_PAUSE`].
const FIRST_PAUSE: Duration = Duration::from_secs(1);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);
/// How long a worker that ends waits to give its request back.
const FAREWELL: Duration = Duration::from_secs(3);
/// How long the end of a worker waits for the thread.
const LONGEST_END: Duration = Duration::from_secs(5);
/// How long a part may take from the database.
const FETCH: Duration = Duration::from_secs(60);
/// The longest reason, characters.
const LONGEST_REASON: usize = 1500;
/// The channel of the database on which requests are announced.
const LISTEN: &str = "LISTEN isomark_work";

/// Fits a part for another computer: its SKU, the bytes of a [`FitTask`], the hash of the part, and the key of the surface. The error is
/// the reason why there is no such surface.
pub type Fitter = dyn Fn(&Sku, &[u8], &str, &str) -> Result<KeptBytes, String> + Send + Sync;

/// A worker of a fleet.
pub struct Worker {
    address: Address,
    name: String,
    process: String,
    fit: Arc<Fitter>,
    events: UnboundedSender<Event>,
    received: UnboundedReceiver<Event>,
    signs: SyncSender<Sign>,
    seen: Option<Receiver<Sign>>,
    /// What it fits at the moment.
    work: Option<Work>,
    made: i64,
    failed: i64,
    trouble: Option<Discriminant<FleetError>>,
}

/// What a worker wakes up for.
enum Event {
    Heard(Heard),
    /// The thread has made the fit of this attempt, or cannot.
    Done(i64, Result<KeptBytes, String>),
    End,
}

/// A request that the worker has taken.
struct Work {
    key: String,
    attempt: i64,
    sku: Sku,
    part: String,
    /// Whether it was taken back.
    is_lost: bool,
    /// The result, until the database has it.
    result: Option<Result<KeptBytes, String>>,
}

/// A request as the database gives it.
struct Taken {
    key: String,
    attempt: i64,
    sku: String,
    part: String,
    task_blake3: String,
}

/// Ends a worker.
#[derive(Clone)]
pub struct Ending {
    events: UnboundedSender<Event>,
    signs: SyncSender<Sign>,
}

/// What the program waits for while its worker runs.
enum Sign {
    /// The worker is to end.
    IsAsked,
    /// It has ended.
    HasEnded,
}

impl Ending {
    /// Gives the request of the worker back, and ends it.
    pub fn end(&self) {
        let _ = self.events.send(Event::End);
        let _ = self.signs.try_send(Sign::IsAsked);
    }
}

impl Worker {
    /// A worker with a name for people; nothing is connected yet.
    #[must_use]
    pub fn new(address: Address, name: &str, fit: Arc<Fitter>) -> Self {
        let (events, received) = unbounded_channel();
        let (signs, seen) = sync_channel(4);
        let name = on_one_line(name.trim()).chars().take(FleetSettings::LONGEST_NAME).collect::<String>();
        let name = if name.is_empty() { "worker".to_owned() } else { name };
        let process = super::process();
        Self {
            address,
            name,
            process,
            fit,
            events,
            received,
            signs,
            seen: Some(seen),
            work: None,
            made: 0,
            failed: 0,
            trouble: None,
        }
    }

    /// What ends this worker.
    #[must_use]
    pub fn ending(&self) -> Ending {
        Ending { events: self.events.clone(), signs: self.signs.clone() }
    }

    /// Fits parts until it is ended. While the database is away, it tries again.
    ///
    /// # Errors
    /// When the system gives no thread or network.
    pub fn run(mut self) -> Result<(), FleetError> {
        let Some(seen) = self.seen.take() else { return Ok(()) };
        let failed = |error: std::io::Error| FleetError::Away(error.to_string());
        let runtime = Builder::new_current_thread().enable_io().enable_time().max_blocking_threads(1).build();
        let runtime = runtime.map_err(failed)?;
        let worker = std::thread::Builder::new().name("fleet".into()).spawn(move || {
            let ended = catch_unwind(AssertUnwindSafe(|| runtime.block_on(self.take_part())));
            if ended.is_err() {
                tracing::error!("an internal error ended the worker. Start it again and report this");
            }
            // The look-up of a name may take long.
            runtime.shutdown_background();
            let _ = self.signs.try_send(Sign::HasEnded);
        });
        worker.map_err(failed)?;
        if let Ok(Sign::IsAsked) = seen.recv() {
            // A server that does not answer holds it up. Without a farewell, the station takes its request back.
            let _ = seen.recv_timeout(LONGEST_END);
        }
        Ok(())
    }

    async fn take_part(&mut self) {
        let mut pause = FIRST_PAUSE;
        loop {
            let error = match self.connected(&mut pause).await {
                Ok(()) => return,
                Err(error) => error.needing(Needed::Worker),
            };
            let kind = discriminant(&error);
            if self.trouble.replace(kind) != Some(kind) {
                tracing::warn!("{} The worker tries again.", error.reason().on_one_line());
            }
            let again = Instant::now() + pause;
            pause = (pause * 2).min(LONGEST_PAUSE);
            while let Ok(event) = timeout_at(again, self.received.recv()).await {
                match event {
                    Some(Event::End) | None => return,
                    Some(Event::Done(attempt, result)) => self.note_result(attempt, result),
                    Some(Event::Heard(_)) => {}
                }
            }
        }
    }

    /// One connection; ends without an error when the worker ends.
    async fn connected(&mut self, pause: &mut Duration) -> Result<(), FleetError> {
        let session = Session::open(&self.address, Some((self.events.clone(), Event::Heard))).await?;
        migrations::check(&session).await?;
        // Before it looks: no request is missed.
        session.batch(LISTEN).await?;
        self.beat(&session, true).await?;
        self.keep(&session).await?;
        *pause = FIRST_PAUSE;
        self.trouble = None;
        tracing::info!("{} fits parts for the fleet at {}", self.name, self.address);
        let (mut beaten, mut kept) = (Instant::now(), Instant::now());
        loop {
            self.end_work(&session).await?;
            while self.work.is_none() && self.take(&session).await? {
                kept = Instant::now();
            }
            let due = if self.work.is_some() { (kept + KEEPING).min(beaten + BEAT) } else { beaten + BEAT };
            match timeout_at(due, self.received.recv()).await {
                Err(_) => {}
                // There may be a request.
                Ok(Some(Event::Heard(Heard::Notified(_)))) => {}
                Ok(Some(Event::Heard(Heard::Closed(error)))) => return Err(error),
                Ok(Some(Event::Done(attempt, result))) => self.note_result(attempt, result),
                Ok(Some(Event::End) | None) => {
                    let _ = timeout(FAREWELL, self.say_farewell(&session)).await;
                    return Ok(());
                }
            }
            let now = Instant::now();
            if now >= kept + KEEPING {
                self.keep(&session).await?;
                kept = now;
            }
            if now >= beaten + BEAT {
                self.beat(&session, true).await?;
                beaten = now;
            }
        }
    }

    async fn beat(&self, session: &Session, runs: bool) -> Result<(), FleetError> {
        let (program, maker) = (super::program(), CacheKey::maker());
        session
            .rows(
                "SELECT isomark.beat_of_worker($1, $2, $3, $4, $5, $6, $7)",
                &[
                    (&self.process, Type::TEXT),
                    (&self.name, Type::TEXT),
                    (&program, Type::TEXT),
                    (&maker, Type::TEXT),
                    (&runs, Type::BOOL),
                    (&self.made, Type::INT8),
                    (&self.failed, Type::INT8),
                ],
            )
            .await
            .map(drop)
    }

    /// Gives a sign of life for the request.
    async fn keep(&mut self, session: &Session) -> Result<(), FleetError> {
        let Some(work) = self.work.as_mut().filter(|work| !work.is_lost) else { return Ok(()) };
        let statement = "SELECT isomark.keep_request($1, $2, $3)";
        if !own(session, statement, &work.key, &self.process, work.attempt).await? {
            work.is_lost = true;
            tracing::info!("the request for the part of {} was withdrawn: its fit is not used", work.sku);
        }
        Ok(())
    }

    /// Takes a request, and begins with it. Whether there was one.
    async fn take(&mut self, session: &Session) -> Result<bool, FleetError> {
        let statement =
            "SELECT key, attempt, left(sku, 300), part, task_blake3 FROM isomark.take_request($1)";
        let rows = session.rows(statement, &[(&self.process, Type::TEXT)]).await?;
        let Some(row) = rows.first() else { return Ok(false) };
        let taken = Taken {
            key: row.try_get(0)?,
            attempt: row.try_get(1)?,
            sku: row.try_get(2)?,
            part: row.try_get(3)?,
            task_blake3: row.try_get(4)?,
        };
        let largest = FitTask::LARGEST as i32;
        let rows = session
            .rows_within(
                FETCH,
                "SELECT CASE WHEN octet_length(task) <= $3 THEN task END FROM isomark.fit_request WHERE key = $1 AND attempt = $2",
                &[(&taken.key, Type::TEXT), (&taken.attempt, Type::INT8), (&largest, Type::INT4)],
            )
            .await?;
        // It was taken back already.
        let Some(row) = rows.first() else { return Ok(true) };
        let task: Option<Vec<u8>> = row.try_get(0)?;
        if let Err(what) = self.begin(&taken, task) {
            tracing::warn!("refusing a request of the fleet: {what}");
            self.failed += 1;
            self.end_failed(session, &taken.key, taken.attempt, &what).await?;
        }
        Ok(true)
    }

    /// Begins to fit in a thread, or gives the reason why not: the row comes from another computer.
    fn begin(&mut self, taken: &Taken, task: Option<Vec<u8>>) -> Result<(), String> {
        let task = task.ok_or_else(|| format!("it is missing, or larger than {} bytes", FitTask::LARGEST))?;
        if *blake3::hash(&task).to_hex() != *taken.task_blake3 {
            return Err("its content does not match its hash".into());
        }
        let sku = taken.sku.parse::<Sku>().map_err(|_| "its SKU is not a name of a SKU".to_owned())?;
        let Taken { key, attempt, part, .. } = taken;
        let (fit, events) = (self.fit.clone(), self.events.clone());
        let of_thread = (sku.clone(), key.clone(), part.clone(), *attempt);
        let started = std::thread::Builder::new().name("fit".into()).spawn(move || {
            let (sku, key, part, attempt) = of_thread;
            // One bad part does not end the worker.
            let made = catch_unwind(AssertUnwindSafe(|| fit(&sku, &task, &part, &key)));
            let made = made.unwrap_or_else(|_| Err("an internal error stopped it".into()));
            let _ = events.send(Event::Done(attempt, made));
        });
        started.map_err(|error| format!("no thread: {error}"))?;
        tracing::info!("fits the part of {sku}");
        self.work = Some(Work {
            key: key.clone(),
            attempt: *attempt,
            sku,
            part: part.clone(),
            is_lost: false,
            result: None,
        });
        Ok(())
    }

    fn note_result(&mut self, attempt: i64, result: Result<KeptBytes, String>) {
        if let Some(work) = self.work.as_mut().filter(|work| work.attempt == attempt) {
            work.result = Some(result);
        }
    }

    /// Sends the result, if there is one. After an error of the connection it is sent again; then the database may have it already.
    async fn end_work(&mut self, session: &Session) -> Result<(), FleetError> {
        let Some(work) = self.work.as_ref().filter(|work| work.result.is_some()) else { return Ok(()) };
        let (key, attempt, sku) = (&work.key, work.attempt, work.sku.clone());
        let is_own = match &work.result {
            _ if work.is_lost => false,
            None => false,
            Some(Err(what)) => {
                tracing::info!("the part of {sku} cannot be fitted: {}", on_one_line(what));
                self.end_failed(session, key, attempt, what).await?
            }
            Some(Ok(bytes)) => match self.end_made(session, work, bytes).await {
                Err(error) if error.is_final() => {
                    session.batch("ROLLBACK").await?;
                    self.end_failed(session, key, attempt, &error.to_string()).await?
                }
                ended => ended?,
            },
        };
        let (is_made, was_lost) = (matches!(work.result, Some(Ok(_))), work.is_lost);
        self.work = None;
        match (is_own, is_made) {
            (true, true) => {
                self.made += 1;
                tracing::info!("fitted the part of {sku}");
            }
            (true, false) => self.failed += 1,
            (false, _) if was_lost => {}
            (false, _) => {
                tracing::info!("the request for the part of {sku} was withdrawn: its fit is not used")
            }
        }
        Ok(())
    }

    /// Adds the fit and ends its request, both or neither. Whether the request was still its own.
    async fn end_made(&self, session: &Session, work: &Work, bytes: &KeptBytes) -> Result<bool, FleetError> {
        if let Some(size) = fits::too_large(bytes) {
            let what = format!("the surface has {size} bytes, which is more than the fleet keeps");
            return self.end_failed(session, &work.key, work.attempt, &what).await;
        }
        let (key, attempt) = (&work.key, work.attempt);
        let statement = "SELECT isomark.keep_request($1, $2, $3)";
        if !own(session, statement, key, &self.process, attempt).await? {
            return Ok(false);
        }
        session.batch("BEGIN").await?;
        fits::write(session, &self.name, &work.sku, key, &work.part, bytes).await?;
        // Only now, so that the station can take it back while the fit is on its way.
        let statement = "SELECT isomark.end_request($1, $2, $3, NULL)";
        let is_own = own(session, statement, key, &self.process, attempt).await?;
        session.batch(if is_own { "COMMIT" } else { "ROLLBACK" }).await?;
        Ok(is_own)
    }

    async fn end_failed(
        &self,
        session: &Session,
        key: &str,
        attempt: i64,
        what: &str,
    ) -> Result<bool, FleetError> {
        let reason: String = on_one_line(what).chars().take(LONGEST_REASON).collect();
        let row = session
            .row(
                "SELECT isomark.end_request($1, $2, $3, $4)",
                &[
                    (&key, Type::TEXT),
                    (&self.process, Type::TEXT),
                    (&attempt, Type::INT8),
                    (&reason, Type::TEXT),
                ],
            )
            .await?;
        Ok(row.try_get(0)?)
    }

    /// Gives the request back; without that, the station takes it back when the lease runs out.
    async fn say_farewell(&self, session: &Session) -> Result<(), FleetError> {
        if let Some(work) = &self.work {
            let statement = "SELECT isomark.return_request($1, $2, $3)";
            if own(session, statement, &work.key, &self.process, work.attempt).await? {
                tracing::info!("gave the part of {} back", work.sku);
            }
        }
        self.beat(session, false).await
    }
}

/// Asks a function whether a request is still the worker's.
async fn own(
    session: &Session,
    statement: &str,
    key: &str,
    process: &str,
    attempt: i64,
) -> Result<bool, FleetError> {
    let values = [(&key as _, Type::TEXT), (&process as _, Type::TEXT), (&attempt as _, Type::INT8)];
    Ok(session.row(statement, &values).await?.try_get(0)?)
}
