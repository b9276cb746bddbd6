//! What people do with a fleet at a terminal: set it up, check it, look at it.

use std::time::{SystemTime, UNIX_EPOCH};

use serde::Serialize;
use tokio_postgres::Row;
use tokio_postgres::types::Type;

use super::address::Address;
use super::error::{FleetError, Needed};
use super::jobs::{self, Jobs};
use super::migrations;
use super::releasing::{self, StationSettings};
use super::session::{Session, Value, run};
use super::workers;
use crate::hotfolder::{StationRow, StationState, WorkerRow};

/// Name and version of the JSON form of a fleet's status; `plugins/README.md` states what is stable.
pub const SCHEMA: &str = "isomark.fleet/1";

/// A station without a sign of life for this time is silent, s.
const LONGEST_SILENCE: f64 = 45.0;
/// The difference between two clocks that `check` reports, s.
const CLOCKS: f64 = 5.0;
/// The role of stations.
const STATION: &str = "isomark_station";
/// The oldest version of PostgreSQL that is tested.
const OLDEST_SERVER: i32 = 150_000;
/// The most stations that are listed.
const STATIONS: i64 = 10_000;
/// The most stations that the page of a station lists.
const STATIONS_ON_PAGE: i64 = 200;

/// What [`init`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct Initialised {
    /// The version of the tables before; 0 for none.
    pub from: i32,
    /// The version now.
    pub to: i32,
}

/// One result of [`check`].
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Checked {
    /// What was checked, and what was found.
    pub what: String,
    /// What to do, if something is wrong.
    pub remedy: Option<String>,
}

/// The state of a fleet at one moment.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct FleetStatus {
    /// [`SCHEMA`].
    pub schema: String,
    /// The version of the tables.
    pub tables: i32,
    /// The stations, by name.
    pub stations: Vec<StationRow>,
    /// The fits that stations share.
    pub fits: SharedFits,
    /// What each station does with the settings that the office released; absent for a station without any.
    pub settings: Vec<StationSettings>,
    /// The jobs for other lines.
    pub jobs: Jobs,
    /// The workers, by name.
    pub workers: Vec<WorkerRow>,
    /// Parts that stations asked workers to fit and that no worker has.
    pub parts_waiting: i64,
}

/// The fits that the stations of a fleet share.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SharedFits {
    /// How many there are.
    pub count: i64,
    /// Their size with the meshes for pictures, bytes.
    pub bytes: i64,
}

/// Makes or upgrades the tables and rights of a fleet. Safe to run twice, and from two computers at the same time.
///
/// # Errors
/// When the database cannot be used, its tables are newer, or the login does not own it.
pub fn init(address: &Address) -> Result<Initialised, FleetError> {
    run(Needed::Owner, async {
        let session = Session::open::<()>(address, None).await?;
        let from = migrations::upgrade(&session).await?;
        Ok(Initialised { from, to: migrations::VERSION })
    })
}

/// Checks connection, server, tables, rights and clock, up to the first failure that makes the others pointless; and whether the login
/// may be the station of this name, if one is given.
///
/// # Errors
/// As [`status`], and with what was found before.
pub fn check(address: &Address, station: Option<&str>) -> (Vec<Checked>, Option<FleetError>) {
    let mut found = Vec::new();
    let needed = if station.is_some() { Needed::Station } else { Needed::AnyRole };
    let end = run(needed, checks(address, station, &mut found));
    (found, end.err())
}

async fn checks(
    address: &Address,
    station: Option<&str>,
    found: &mut Vec<Checked>,
) -> Result<(), FleetError> {
    let mut note = |what: String, remedy: Option<&str>| {
        found.push(Checked { what, remedy: remedy.map(str::to_owned) });
    };
    let session = Session::open::<()>(address, None).await?;
    let how = if address.is_encrypted() { "encrypted, server verified" } else { "not encrypted" };
    note(format!("connected to {address}: {how}"), None);
    let row = session
        .row(
            "SELECT current_setting('server_version_num')::int4, current_setting('server_version'), \
             session_user::text, extract(epoch FROM clock_timestamp())::float8, pg_is_in_recovery()",
            &[],
        )
        .await?;
    let version: i32 = row.try_get(0)?;
    let shown: String = row.try_get(1)?;
    note(
        format!("PostgreSQL {shown}"),
        (version < OLDEST_SERVER)
            .then_some("isomark is tested with PostgreSQL 15 and later: update the server."),
    );
    let theirs: f64 = row.try_get(3)?;
    let ours = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64());
    let apart = (ours - theirs).abs();
    note(
        format!("the clocks of the server and of this computer differ by {apart:.1} s"),
        (apart > CLOCKS).then_some("Set both clocks by the same time server."),
    );
    if row.try_get(4)? {
        note("the server is a copy that only reads".into(), Some("Give the address of the main server."));
    }
    migrations::check(&session).await?;
    note(format!("tables of version {}", migrations::VERSION), None);
    let login: String = row.try_get(2)?;
    let roles = session
        .rows(
            "SELECT rolname::text FROM pg_roles WHERE rolname IN \
             ('isomark_station', 'isomark_worker', 'isomark_office', 'isomark_viewer') \
             AND pg_has_role(session_user, oid, 'MEMBER') ORDER BY 1",
            &[],
        )
        .await?;
    let roles: Vec<String> = roles.iter().map(|row| row.try_get(0)).collect::<Result<_, _>>()?;
    let needed = if station.is_some() { Needed::Station } else { Needed::AnyRole };
    match (roles.is_empty(), station) {
        (true, _) => note(format!("{login} has no role of the fleet"), Some(&needed.remedy())),
        (false, Some(_)) if !roles.iter().any(|role| role == STATION) => note(
            format!("{login} has the rights of {}, not those of {STATION}", roles.join(", ")),
            Some(&needed.remedy()),
        ),
        (false, _) => note(format!("{login} has the rights of {}", roles.join(", ")), None),
    }
    if let Some(station) = station {
        let owner = session
            .rows("SELECT login::text FROM isomark.station WHERE name = $1", &[(&station, Type::TEXT)])
            .await?;
        let owner = owner.first().map(|row| row.try_get::<_, String>(0)).transpose()?;
        match owner.filter(|owner| *owner != login) {
            Some(owner) => note(
                format!("the station name \"{station}\" belongs to the login {owner}"),
                Some(&FleetError::NameOfAnother(String::new()).reason().remedy),
            ),
            None => note(format!("{login} may use the station name \"{station}\""), None),
        }
    }
    Ok(())
}

/// The state of all stations.
///
/// # Errors
/// When the database cannot be used, or its tables are not those of this program.
pub fn status(address: &Address) -> Result<FleetStatus, FleetError> {
    run(Needed::AnyRole, async {
        let session = Session::open::<()>(address, None).await?;
        migrations::check(&session).await?;
        let by_name = "ORDER BY name COLLATE \"C\" LIMIT $1";
        let stations = stations(&session, by_name, &[(&STATIONS, Type::INT8)]).await?;
        Ok(FleetStatus {
            schema: SCHEMA.into(),
            tables: migrations::VERSION,
            stations,
            fits: fits(&session).await?,
            settings: releasing::by_station(&session).await?,
            jobs: jobs::listed(&session).await?,
            workers: workers::listed(&session).await?,
            parts_waiting: workers::waiting(&session).await?,
        })
    })
}

async fn stations(
    session: &Session,
    which: &str,
    values: &[Value<'_>],
) -> Result<Vec<StationRow>, FleetError> {
    let statement = format!(
        "SELECT name, runs, extract(epoch FROM now() - beat)::float8, extract(epoch FROM now() - since)::float8, \
         program, waiting, delivered, learned, rejected, outdated, uncertain, trouble FROM isomark.station {which}"
    );
    let rows = session.rows(&statement, values).await?;
    Ok(rows.iter().map(station).collect::<Result<_, _>>()?)
}

/// How many stations there are, and the first ones, those first that need somebody.
pub(super) async fn stations_for_page(session: &Session) -> Result<(u64, Vec<StationRow>), FleetError> {
    let which = "ORDER BY runs AND beat >= now() - make_interval(secs => $1), trouble IS NULL, name COLLATE \"C\" LIMIT $2";
    let values = [(&LONGEST_SILENCE as _, Type::FLOAT8), (&STATIONS_ON_PAGE as _, Type::INT8)];
    let first = stations(session, which, &values).await?;
    let count = session.row("SELECT count(*) FROM isomark.station", &[]).await?.try_get::<_, i64>(0)?;
    Ok((u64::try_from(count).unwrap_or(0), first))
}

pub(super) async fn fits(session: &Session) -> Result<SharedFits, FleetError> {
    let row = session.row("SELECT count(bytes), coalesce(sum(bytes), 0)::int8 FROM isomark.fit", &[]).await?;
    Ok(SharedFits { count: row.try_get(0)?, bytes: row.try_get(1)? })
}

fn station(row: &Row) -> Result<StationRow, tokio_postgres::Error> {
    let (runs, silent_for_s): (bool, f64) = (row.try_get(1)?, row.try_get(2)?);
    Ok(StationRow {
        name: row.try_get(0)?,
        state: match runs {
            false => StationState::Stopped,
            true if silent_for_s > LONGEST_SILENCE => StationState::Silent,
            true => StationState::Alive,
        },
        silent_for_s: silent_for_s.max(0.0),
        up_for_s: row.try_get::<_, f64>(3)?.max(0.0),
        program: row.try_get(4)?,
        waiting: row.try_get(5)?,
        delivered: row.try_get(6)?,
        learned: row.try_get(7)?,
        rejected: row.try_get(8)?,
        outdated: row.try_get(9)?,
        uncertain: row.try_get(10)?,
        trouble: row.try_get(11)?,
    })
}
