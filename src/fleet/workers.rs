//! The workers of a fleet, for a status.

use tokio_postgres::types::Type;

use super::error::FleetError;
use super::session::Session;
use crate::hotfolder::WorkerRow;

/// A worker without a sign of life for this time is silent, s.
const LONGEST_SILENCE: f64 = 45.0;
/// The most workers that are listed.
const WORKERS: i64 = 1000;

/// The workers, by name.
pub(super) async fn listed(session: &Session) -> Result<Vec<WorkerRow>, FleetError> {
    let rows = session
        .rows(
            "SELECT left(w.name, 300), extract(epoch FROM now() - w.beat)::float8, extract(epoch FROM now() - w.since)::float8, \
             left(w.program, 300), w.made, w.failed, \
             (SELECT left(r.sku, 300) FROM isomark.fit_request AS r WHERE r.worker = w.process AND r.state = 'taken' LIMIT 1) \
             FROM isomark.worker AS w ORDER BY w.name COLLATE \"C\", w.since LIMIT $1",
            &[(&WORKERS, Type::INT8)],
        )
        .await?;
    let mut workers = Vec::new();
    for row in &rows {
        let silent_for_s = row.try_get::<_, f64>(1)?.max(0.0);
        workers.push(WorkerRow {
            name: row.try_get(0)?,
            alive: silent_for_s <= LONGEST_SILENCE,
            silent_for_s,
            up_for_s: row.try_get::<_, f64>(2)?.max(0.0),
            program: row.try_get(3)?,
            made: row.try_get(4)?,
            failed: row.try_get(5)?,
            sku: row.try_get(6)?,
        });
    }
    Ok(workers)
}

/// How many parts wait for a worker.
pub(super) async fn waiting(session: &Session) -> Result<i64, FleetError> {
    let statement = "SELECT count(*) FROM isomark.fit_request WHERE state = 'waiting'";
    Ok(session.row(statement, &[]).await?.try_get(0)?)
}
