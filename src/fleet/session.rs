//! One connection to the database, in which every wait has a limit.

use std::future::{Future, poll_fn};
use std::time::Duration;

use tokio::runtime::Builder;
use tokio::sync::mpsc::UnboundedSender;
use tokio::task::JoinHandle;
use tokio::time::timeout;
use tokio_postgres::types::{ToSql, Type};
use tokio_postgres::{AsyncMessage, Client, Row};

use super::address::Address;
use super::error::{FleetError, Needed};
use super::tls::Verified;

/// How long to wait for a connection, with encryption and login: some ten messages, each of which may take two seconds.
const LOGIN: Duration = Duration::from_secs(30);
/// What every session sets. The server gives up before the program does, so that nothing keeps its locks.
const LIMITS: &str = "SET statement_timeout = '12s'; SET lock_timeout = '8s'; \
                      SET idle_in_transaction_session_timeout = '20s'; SET search_path = pg_catalog, pg_temp";

/// A value of a statement with its type.
pub(super) type Value<'a> = (&'a (dyn ToSql + Sync), Type);

/// What a session hears without a question.
#[derive(Debug)]
pub(super) enum Heard {
    /// A notification, with its text.
    Notified(String),
    /// The connection ended.
    Closed(FleetError),
}

/// Where a session sends what it hears, and as what.
pub(super) type Listener<T> = (UnboundedSender<T>, fn(Heard) -> T);

/// A connection to the database.
pub(super) struct Session {
    client: Client,
    driver: JoinHandle<()>,
}

impl Drop for Session {
    fn drop(&mut self) {
        // A server that does not answer would keep the task forever.
        self.driver.abort();
    }
}

impl Session {
    /// How long to wait for the answer to a statement. The server ends a statement earlier.
    pub(super) const ANSWER: Duration = Duration::from_secs(15);

    /// Connects; `heard` gets what the server sends without a question.
    pub(super) async fn open<T: Send + 'static>(
        address: &Address,
        heard: Option<Listener<T>>,
    ) -> Result<Self, FleetError> {
        let config = address.with_password()?;
        let verified = Verified::new(address)?;
        let connected = timeout(LOGIN, config.connect(verified)).await;
        let (client, mut connection) =
            connected.map_err(|_| FleetError::Away(format!("no login within {} s", LOGIN.as_secs())))??;
        let driver = tokio::spawn(async move {
            loop {
                let message = poll_fn(|context| connection.poll_message(context)).await;
                let heard_now = match message {
                    Some(Ok(AsyncMessage::Notification(note))) => Heard::Notified(note.payload().to_owned()),
                    Some(Ok(_)) => continue,
                    Some(Err(error)) => Heard::Closed(error.into()),
                    None => Heard::Closed(FleetError::Away("the connection was closed".into())),
                };
                let has_ended = matches!(heard_now, Heard::Closed(_));
                if let Some((sender, made)) = &heard {
                    let _ = sender.send(made(heard_now));
                }
                if has_ended {
                    return;
                }
            }
        });
        let session = Self { client, driver };
        session.batch(LIMITS).await?;
        Ok(session)
    }

    /// Runs statements without values.
    pub(super) async fn batch(&self, statements: &str) -> Result<(), FleetError> {
        within(Self::ANSWER, self.client.batch_execute(statements)).await
    }

    /// Runs a statement and gives its rows.
    pub(super) async fn rows(&self, statement: &str, values: &[Value<'_>]) -> Result<Vec<Row>, FleetError> {
        self.rows_within(Self::ANSWER, statement, values).await
    }

    /// The same with another limit, for large values.
    pub(super) async fn rows_within(
        &self,
        limit: Duration,
        statement: &str,
        values: &[Value<'_>],
    ) -> Result<Vec<Row>, FleetError> {
        within(limit, self.client.query_typed(statement, values)).await
    }

    /// Runs a statement that gives one row.
    pub(super) async fn row(&self, statement: &str, values: &[Value<'_>]) -> Result<Row, FleetError> {
        within(Self::ANSWER, self.client.query_typed_one(statement, values)).await
    }
}

/// Runs work with the database to its end, in a command that needs these rights.
pub(super) fn run<T>(
    needed: Needed,
    work: impl Future<Output = Result<T, FleetError>>,
) -> Result<T, FleetError> {
    let runtime = Builder::new_current_thread().enable_io().enable_time().build();
    let runtime = runtime.map_err(|error| FleetError::Away(error.to_string()))?;
    runtime.block_on(work).map_err(|error| error.needing(needed))
}

async fn within<T>(
    limit: Duration,
    work: impl Future<Output = Result<T, tokio_postgres::Error>>,
) -> Result<T, FleetError> {
    match timeout(limit, work).await {
        Ok(done) => Ok(done?),
        Err(_) => Err(FleetError::Away(format!("no answer within {} s", limit.as_secs()))),
    }
}
