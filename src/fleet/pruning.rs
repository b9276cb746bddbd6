//! What the office removes from a fleet: fits that nobody uses, jobs that ended long ago, and stations that are gone.

use tokio_postgres::types::Type;

use super::address::Address;
use super::error::{FleetError, Needed};
use super::migrations;
use super::office::{self, SharedFits};
use super::releasing;
use super::session::{Session, Value, run};

/// Fits that are removed at a time, so that stations get to work in between.
const FITS: i64 = 200;
/// The same for jobs, whose rows are small.
const JOBS: i64 = 5_000;

/// What [`prune`] removes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Prune {
    /// Fits that were not used for this number of days, unless they are of a current part. Stations make fits again.
    pub unused_days: Option<f64>,
    /// The fits that were used longest ago and are not of a current part, until all together have this size, bytes.
    pub max_bytes: Option<i64>,
    /// The fit with this key.
    pub key: Option<String>,
    /// Jobs that ended this number of days ago.
    pub ended_days: Option<f64>,
    /// The station with this name, which another login may use then.
    pub station: Option<String>,
}

/// What [`prune`] removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Pruned {
    /// The number of fits.
    pub fits: i64,
    /// The fits that are left.
    pub left: SharedFits,
    /// The number of jobs.
    pub jobs: i64,
    /// Whether a station was removed.
    pub station: bool,
}

/// Removes what is given.
///
/// # Errors
/// When the database cannot be used, the login may not remove that, the fit is unknown, or the station is unknown, alive or has jobs
/// that have not ended.
pub fn prune(address: &Address, prune: &Prune) -> Result<Pruned, FleetError> {
    run(Needed::Office, async {
        let session = Session::open::<()>(address, None).await?;
        migrations::check(&session).await?;
        if let Some(station) = &prune.station {
            forget_station(&session, station).await?;
        }
        if let Some(key) = &prune.key {
            let statement = "SELECT EXISTS (SELECT FROM isomark.fit WHERE key = $1)";
            if !session.row(statement, &[(key, Type::TEXT)]).await?.try_get(0)? {
                return Err(FleetError::UnknownFit { key: key.clone() });
            }
        }
        let mut fits = 0;
        if prune.unused_days.is_some() || prune.max_bytes.is_some() || prune.key.is_some() {
            fits = remove_fits(&session, prune).await?;
        }
        let mut jobs = 0;
        if let Some(days) = prune.ended_days {
            let statement = "WITH chosen AS (SELECT id FROM isomark.job WHERE state = 'ended' \
                 AND ended <= now() - make_interval(secs => $1 * 86400) ORDER BY ended LIMIT $2), \
                 removed AS (DELETE FROM isomark.job WHERE id IN (SELECT id FROM chosen) AND state = 'ended' RETURNING 1) \
                 SELECT count(*) FROM removed";
            jobs = repeat(&session, statement, &[(&limited(days), Type::FLOAT8)], JOBS).await?;
        }
        let left = office::fits(&session).await?;
        Ok(Pruned { fits, left, jobs, station: prune.station.is_some() })
    })
}

fn limited(days: f64) -> f64 {
    days.clamp(0.0, 1e6)
}

async fn remove_fits(session: &Session, prune: &Prune) -> Result<i64, FleetError> {
    // Fits of current parts are the last to be removed, and stay: a station that does not have one needs it for its drawings.
    let statement = "WITH of_parts AS (SELECT key, used, bytes, EXISTS \
         (SELECT FROM isomark.current_part AS c WHERE c.blake3 = f.part) AS is_current FROM isomark.fit AS f), \
         listed AS (SELECT key, used, is_current, sum(bytes) OVER (ORDER BY is_current DESC, used DESC, key) AS newer_bytes \
         FROM of_parts), \
         chosen AS (SELECT key FROM listed WHERE key = $3 OR (NOT is_current AND (newer_bytes > $2 \
         OR used <= now() - make_interval(secs => $1 * 86400))) ORDER BY used, key LIMIT $4), \
         removed AS (DELETE FROM isomark.fit WHERE key IN (SELECT key FROM chosen) RETURNING 1) \
         SELECT count(*) FROM removed";
    let days = prune.unused_days.map(limited);
    let values: [Value<'_>; 3] =
        [(&days, Type::FLOAT8), (&prune.max_bytes, Type::INT8), (&prune.key, Type::TEXT)];
    repeat(session, statement, &values, FITS).await
}

/// Repeats a statement until it removes fewer rows than it may, which is its last value. Gives how many it removed.
async fn repeat(
    session: &Session,
    statement: &str,
    values: &[Value<'_>],
    at_a_time: i64,
) -> Result<i64, FleetError> {
    let mut values = values.to_vec();
    values.push((&at_a_time, Type::INT8));
    let mut removed = 0;
    loop {
        let some: i64 = session.row(statement, &values).await?.try_get(0)?;
        removed += some;
        if some < at_a_time {
            return Ok(removed);
        }
    }
}

async fn forget_station(session: &Session, name: &str) -> Result<(), FleetError> {
    releasing::must_exist(session, name).await?;
    let row =
        session.row("SELECT is_alive, jobs FROM isomark.forget_station($1)", &[(&name, Type::TEXT)]).await?;
    let (is_alive, jobs): (bool, i64) = (row.try_get(0)?, row.try_get(1)?);
    match (is_alive, jobs) {
        (false, 0) => Ok(()),
        _ => Err(FleetError::StationInUse { name: name.into(), jobs }),
    }
}
