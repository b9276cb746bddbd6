//! The tables of the database, in numbered steps that only go forward.
//!
//! All missing steps run in one transaction under an advisory lock, so two computers that upgrade at the same time do so one
//! after the other, and an interrupted upgrade changes nothing. Each step is recorded with its hash: a step that was released
//! never changes.

use tokio_postgres::types::Type;

use super::error::FleetError;
use super::session::Session;

/// The steps, in order; the number of the first one is 1.
const MIGRATIONS: &[(&str, &str)] = &[
    ("stations", include_str!("migrations/0001_stations.sql")),
    ("fits", include_str!("migrations/0002_fits.sql")),
    ("releases", include_str!("migrations/0003_releases.sql")),
    ("jobs", include_str!("migrations/0004_jobs.sql")),
    ("workers", include_str!("migrations/0005_workers.sql")),
    ("removal", include_str!("migrations/0006_removal.sql")),
    ("waiting jobs", include_str!("migrations/0007_waiting_jobs.sql")),
];
const ROLES: &str = include_str!("roles.sql");
/// The key of the advisory lock: "isomark" in ASCII.
const LOCK: i64 = 0x69_73_6f_6d_61_72_6b;

/// The version of the tables that this program makes.
pub(super) const VERSION: i32 = MIGRATIONS.len() as i32;

/// Makes or upgrades the tables; returns their version before.
pub(super) async fn upgrade(session: &Session) -> Result<i32, FleetError> {
    session.batch("BEGIN").await?;
    let upgraded = within_transaction(session).await;
    let end = session.batch(if upgraded.is_ok() { "COMMIT" } else { "ROLLBACK" }).await;
    let found = upgraded?;
    end?;
    Ok(found)
}

async fn within_transaction(session: &Session) -> Result<i32, FleetError> {
    session.rows("SELECT pg_advisory_xact_lock($1)", &[(&LOCK, Type::INT8)]).await?;
    session
        .batch(
            "CREATE SCHEMA IF NOT EXISTS isomark; \
             CREATE TABLE IF NOT EXISTS isomark.migration (number integer PRIMARY KEY, name text NOT NULL, \
             blake3 text NOT NULL, program text NOT NULL, at timestamptz NOT NULL DEFAULT now())",
        )
        .await?;
    let found = found(session).await?;
    compare(&found)?;
    for (index, (name, text)) in MIGRATIONS.iter().enumerate().skip(found.len()) {
        session.batch(text).await?;
        let (number, program) = (index as i32 + 1, super::program());
        session
            .rows(
                "INSERT INTO isomark.migration (number, name, blake3, program) VALUES ($1, $2, $3, $4)",
                &[
                    (&number, Type::INT4),
                    (name, Type::TEXT),
                    (&hash_of(text), Type::TEXT),
                    (&program, Type::TEXT),
                ],
            )
            .await?;
    }
    session.batch(ROLES).await?;
    Ok(found.len() as i32)
}

/// Checks that the tables are those of this program.
pub(super) async fn check(session: &Session) -> Result<(), FleetError> {
    let has_tables = session.row("SELECT to_regclass('isomark.migration') IS NOT NULL", &[]).await?;
    let is_there: bool = has_tables.try_get(0)?;
    let found = if is_there { found(session).await? } else { Vec::new() };
    compare(&found)?;
    match found.len() as i32 {
        found if found < VERSION => Err(FleetError::Older { found, needed: VERSION }),
        _ => Ok(()),
    }
}

/// The hashes of the steps that the database has.
async fn found(session: &Session) -> Result<Vec<String>, FleetError> {
    let rows =
        session.rows("SELECT number, blake3 FROM isomark.migration ORDER BY number LIMIT 10000", &[]).await?;
    let mut found = Vec::new();
    for row in rows {
        let number: i32 = row.try_get(0)?;
        found.push(row.try_get(1)?);
        if number != found.len() as i32 {
            return Err(FleetError::Foreign(number));
        }
    }
    Ok(found)
}

fn compare(found: &[String]) -> Result<(), FleetError> {
    if found.len() as i32 > VERSION {
        return Err(FleetError::Newer { found: found.len() as i32, known: VERSION });
    }
    let differs = found.iter().zip(MIGRATIONS).position(|(found, (_, text))| *found != hash_of(text));
    differs.map_or(Ok(()), |index| Err(FleetError::Foreign(index as i32 + 1)))
}

/// The hash of a step; a checkout on Windows may have other line ends.
fn hash_of(text: &str) -> String {
    blake3::hash(text.replace("\r\n", "\n").as_bytes()).to_hex().to_string()
}
