//! Connections to the database as a login, for tests that do what a station does without its process.

use std::time::Duration;

use tokio::runtime::{Builder, Runtime};
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tokio::time::timeout;
use tokio_postgres::types::{ToSql, Type};
use tokio_postgres::{AsyncMessage, Client, Error, NoTls, Row};

use crate::server::SECRET;

/// A value of a statement with its type.
pub type Value<'a> = (&'a (dyn ToSql + Sync), Type);

/// An open connection. Dropping it closes its socket at once.
pub struct Connected {
    // Before the runtime, which drops the socket.
    client: Client,
    heard: UnboundedReceiver<String>,
    runtime: Runtime,
    patience: Duration,
}

impl Connected {
    /// Connects to a server or a proxy; `None` if it does not answer within this time, which also limits each statement.
    pub fn to(port: u16, login: &str, patience: Duration) -> Option<Self> {
        let runtime = Builder::new_current_thread().enable_io().enable_time().build().unwrap();
        let mut config = tokio_postgres::Config::new();
        config.host("127.0.0.1").port(port).user(login).password(SECRET).dbname("isomark");
        let (sender, heard) = unbounded_channel();
        let client = runtime.block_on(async {
            let (client, mut connection) = timeout(patience, config.connect(NoTls)).await.ok()?.ok()?;
            tokio::spawn(async move {
                while let Some(Ok(message)) =
                    std::future::poll_fn(|context| connection.poll_message(context)).await
                {
                    if let AsyncMessage::Notification(note) = message {
                        let _ = sender.send(note.payload().to_owned());
                    }
                }
            });
            Some(client)
        })?;
        let connected = Self { client, heard, runtime, patience };
        let limits = "SET statement_timeout = '5s'; SET idle_in_transaction_session_timeout = '5s'";
        connected.batch(limits)?;
        Some(connected)
    }

    /// The rows of a statement; `None` if the connection ended or the answer did not come, so that nobody knows what happened.
    pub fn rows(&self, statement: &str, values: &[Value<'_>]) -> Option<Vec<Row>> {
        let work = async { timeout(self.patience, self.client.query_typed(statement, values)).await };
        known(statement, self.runtime.block_on(work).ok()?)
    }

    /// Runs statements without values.
    pub fn batch(&self, statements: &str) -> Option<()> {
        let work = async { timeout(self.patience, self.client.batch_execute(statements)).await };
        known(statements, self.runtime.block_on(work).ok()?)
    }

    /// What the database announces next, and all that it has announced since; empty if that takes longer than this.
    pub fn hears(&mut self, limit: Duration) -> Vec<String> {
        let first = self.runtime.block_on(async { timeout(limit, self.heard.recv()).await });
        let mut all: Vec<String> = first.ok().flatten().into_iter().collect();
        while let Ok(more) = self.heard.try_recv() {
            all.push(more);
        }
        all
    }
}

/// The result, unless the connection ended. Everything else is a mistake of the test.
fn known<T>(statement: &str, result: Result<T, Error>) -> Option<T> {
    match result {
        Ok(value) => Some(value),
        Err(error) => {
            let code = error.code().map_or("57", |code| code.code());
            // The server ends, or gives up waiting.
            assert!(
                code.starts_with("57") || code.starts_with("08") || code == "25P03",
                "{statement}: {error:?}"
            );
            None
        }
    }
}
