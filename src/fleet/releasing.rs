//! How the office releases settings, and what the stations do with them.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::Serialize;
use tokio_postgres::types::Type;

use super::address::Address;
use super::error::{FleetError, Needed};
use super::migrations;
use super::released_text::MOST_LINES;
use super::releases::LARGEST;
use super::session::{Session, run};
use crate::config::Sku;

/// Versions that a history lists.
const VERSIONS: i64 = 1000;
/// SKUs that are listed for each station, those first whose settings are not the released ones.
const SKUS: i64 = 500;
/// How long the comparison of all stations with all releases may take: 500,000 rows took 5 s on a busy computer.
const PATIENCE: Duration = Duration::from_secs(65);
/// The same for the server, which gives up first.
const PATIENCE_OF_SERVER: &str = "SET statement_timeout = '60s'";
/// Names of stations among which a mistyped one is searched.
const STATIONS: i64 = 1000;

/// Settings of a SKU to release, or to remove.
#[derive(Debug, Clone)]
pub struct NewRelease<'a> {
    /// The SKU.
    pub sku: &'a Sku,
    /// The text of its file, checked by the caller; `None` to remove what was released.
    pub settings: Option<&'a str>,
    /// The station that it is for; `None` for all.
    pub station: Option<&'a str>,
    /// The name of the person, beside the login.
    pub author: Option<&'a str>,
}

impl NewRelease<'_> {
    /// The largest text of settings, bytes.
    pub const LARGEST: usize = LARGEST;
    /// The most lines of settings.
    pub const MOST_LINES: usize = MOST_LINES;
    /// The longest name of a person, characters.
    pub const LONGEST_AUTHOR: usize = 100;
}

/// What became of a release.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Released {
    /// The version; `None` if there was nothing to remove.
    pub version: Option<i64>,
    /// Whether there is a new version: the same settings again make none.
    pub is_new: bool,
    /// What was released before for the same stations; empty for nothing.
    pub before: String,
}

/// The versions of the settings of a SKU, newest first.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Releases {
    /// [`Releases::SCHEMA`].
    pub schema: String,
    /// The SKU.
    pub sku: String,
    /// The versions, newest first.
    pub versions: Vec<ReleaseRow>,
}

impl Releases {
    /// Name and version of the JSON form; `plugins/README.md` states what is stable.
    pub const SCHEMA: &'static str = "isomark.releases/1";
}

/// One version of the settings of a SKU.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ReleaseRow {
    /// The version: one number for each release of the SKU.
    pub version: i64,
    /// The station that it is for; absent if it is for all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub station: Option<String>,
    /// Whether it removed the settings.
    pub removed: bool,
    /// Whether it is the newest for its stations.
    pub current: bool,
    /// When it was released, in universal time.
    pub at: String,
    /// The login that released it.
    pub login: String,
    /// The name that was given with it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub author: Option<String>,
    /// The hash of the settings; absent if they were removed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blake3: Option<String>,
    /// The stations that use it now.
    pub stations: Vec<String>,
}

/// What a station does with the settings that the office released for it.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct StationSettings {
    /// The station.
    pub station: String,
    /// How many SKUs have released settings for it.
    pub count: i64,
    /// For how many of them it uses the newest release.
    pub current: i64,
    /// The first SKUs, those first for which it does not.
    pub skus: Vec<SkuSettings>,
}

/// The settings of a SKU at a station.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SkuSettings {
    /// The SKU.
    pub sku: String,
    /// The newest release for the station.
    pub released: i64,
    /// The release that the station received last; absent if it received none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub version: Option<i64>,
    /// What it does with it.
    pub state: SkuSettingsState,
    /// Why it cannot use it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// What a station does with a release.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SkuSettingsState {
    /// It uses it.
    Current,
    /// It has not received it yet.
    Behind,
    /// It uses a local change of its file in place of it, as its settings allow.
    Local,
    /// The release cannot be used there.
    Refused,
}

impl SkuSettingsState {
    /// Its name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Current => "current",
            Self::Behind => "behind",
            Self::Local => "local",
            Self::Refused => "refused",
        }
    }
}

/// Releases settings to all stations or to one, or removes what was released.
///
/// # Errors
/// When the database cannot be used, the login may not release, or no station has the given name.
pub fn release(address: &Address, new: &NewRelease<'_>) -> Result<Released, FleetError> {
    run(Needed::Office, async {
        let session = Session::open::<()>(address, None).await?;
        migrations::check(&session).await?;
        if let Some(station) = new.station {
            must_exist(&session, station).await?;
        }
        let (key, name, station) = (new.sku.key(), new.sku.as_str(), new.station.unwrap_or_default());
        let body = new.settings.map(str::as_bytes);
        let hash = body.map(|body| blake3::hash(body).to_hex().to_string());
        let largest = LARGEST as i32;
        let before = session
            .rows(
                "SELECT CASE WHEN octet_length(r.body) <= $3 THEN r.body END FROM isomark.current_release AS c \
                 JOIN isomark.release AS r ON r.sku = c.sku AND r.version = c.version WHERE c.sku = $1 AND c.station = $2",
                &[(&key, Type::TEXT), (&station, Type::TEXT), (&largest, Type::INT4)],
            )
            .await?;
        let before: Option<&[u8]> = match before.first() {
            Some(row) => row.try_get(0)?,
            None => None,
        };
        let row = session
            .row(
                "SELECT version, is_new FROM isomark.release($1, $2, $3, $4, $5, $6)",
                &[
                    (&key, Type::TEXT),
                    (&name, Type::TEXT),
                    (&station, Type::TEXT),
                    (&body, Type::BYTEA),
                    (&hash, Type::TEXT),
                    (&new.author, Type::TEXT),
                ],
            )
            .await?;
        Ok(Released {
            version: row.try_get(0)?,
            is_new: row.try_get(1)?,
            before: String::from_utf8_lossy(before.unwrap_or_default()).into_owned(),
        })
    })
}

/// Refuses the name of a station that the fleet has never seen.
pub(super) async fn must_exist(session: &Session, station: &str) -> Result<(), FleetError> {
    let known =
        session.rows("SELECT 1 FROM isomark.station WHERE name = $1", &[(&station, Type::TEXT)]).await?;
    if !known.is_empty() {
        return Ok(());
    }
    let rows = session
        .rows(
            "SELECT left(name, 100) FROM isomark.station ORDER BY name COLLATE \"C\" LIMIT $1",
            &[(&STATIONS, Type::INT8)],
        )
        .await?;
    let known = rows.iter().map(|row| row.try_get(0)).collect::<Result<_, _>>()?;
    Err(FleetError::UnknownStation { name: station.into(), known })
}

/// The versions of the settings of a SKU.
///
/// # Errors
/// When the database cannot be used, or the login may not see them.
pub fn history(address: &Address, sku: &Sku) -> Result<Releases, FleetError> {
    run(Needed::AnyRole, async {
        let session = Session::open::<()>(address, None).await?;
        migrations::check(&session).await?;
        let rows = session
            .rows(
                "SELECT r.version, left(r.station, 300), r.blake3 IS NULL, \
                 EXISTS (SELECT FROM isomark.current_release AS c WHERE c.sku = r.sku AND c.version = r.version), \
                 to_char(r.at AT TIME ZONE 'UTC', 'YYYY-MM-DD\"T\"HH24:MI:SS\"Z\"'), r.login::text, left(r.author, 300), \
                 left(r.blake3, 100), ARRAY(SELECT h.station FROM isomark.station_release AS h \
                 WHERE h.sku = r.sku AND h.version = r.version AND h.state = 'used' ORDER BY h.station COLLATE \"C\") \
                 FROM isomark.release AS r WHERE r.sku = $1 ORDER BY r.version DESC LIMIT $2",
                &[(&sku.key(), Type::TEXT), (&VERSIONS, Type::INT8)],
            )
            .await?;
        let mut versions = Vec::new();
        for row in &rows {
            versions.push(ReleaseRow {
                version: row.try_get(0)?,
                station: Some(row.try_get::<_, String>(1)?).filter(|station| !station.is_empty()),
                removed: row.try_get(2)?,
                current: row.try_get(3)?,
                at: row.try_get(4)?,
                login: row.try_get(5)?,
                author: row.try_get(6)?,
                blake3: row.try_get(7)?,
                stations: row.try_get(8)?,
            });
        }
        Ok(Releases { schema: Releases::SCHEMA.into(), sku: sku.as_str().into(), versions })
    })
}

/// What each station should use, and what it does: `compared`, for the statements below. Nothing is sorted, because there may be
/// millions of rows. Removed settings matter as long as a station uses some.
const COMPARED: &str = "WITH wanted AS (SELECT s.name AS station, c.sku, c.version, c.blake3 IS NULL AS removed \
     FROM isomark.station AS s CROSS JOIN isomark.current_release AS c WHERE c.station = '' AND NOT EXISTS \
     (SELECT FROM isomark.current_release AS o WHERE o.station = s.name AND o.sku = c.sku AND o.blake3 IS NOT NULL) \
     UNION ALL SELECT c.station, c.sku, c.version, c.blake3 IS NULL FROM isomark.current_release AS c \
     JOIN isomark.station AS s ON s.name = c.station WHERE c.blake3 IS NOT NULL OR NOT EXISTS \
     (SELECT FROM isomark.current_release AS a WHERE a.station = '' AND a.sku = c.sku)), \
     compared AS (SELECT w.station, w.sku, w.version AS released, h.version, left(h.note, 500) AS note, CASE \
     WHEN h.version IS DISTINCT FROM w.version THEN 'behind' WHEN h.state = 'used' THEN 'current' ELSE h.state END AS state \
     FROM wanted AS w LEFT JOIN isomark.station_release AS h ON h.station = w.station AND h.sku = w.sku \
     WHERE NOT w.removed OR EXISTS (SELECT FROM isomark.release AS r \
     WHERE r.sku = h.sku AND r.version = h.version AND r.blake3 IS NOT NULL))";

/// What each station does with the releases for it. The last question of a session, because the server may take longer for it.
pub(super) async fn by_station(session: &Session) -> Result<Vec<StationSettings>, FleetError> {
    let counts = format!(
        "{COMPARED} SELECT station, count(*), count(*) FILTER (WHERE state = 'current') FROM compared GROUP BY station"
    );
    let mut stations: BTreeMap<String, StationSettings> = BTreeMap::new();
    session.batch(PATIENCE_OF_SERVER).await?;
    for row in &session.rows_within(PATIENCE, &counts, &[]).await? {
        let station: String = row.try_get(0)?;
        let (count, current) = (row.try_get(1)?, row.try_get(2)?);
        let settings = StationSettings { station: station.clone(), count, current, skus: Vec::new() };
        stations.insert(station, settings);
    }
    let listed = format!(
        "{COMPARED}, last AS (SELECT sku FROM isomark.current_release ORDER BY sku OFFSET $1 - 1 LIMIT 1), \
         placed AS (SELECT *, row_number() OVER (PARTITION BY station ORDER BY state = 'current', sku) AS place FROM compared \
         WHERE state <> 'current' OR NOT EXISTS (SELECT FROM last) OR sku <= (SELECT sku FROM last)) \
         SELECT station, left(sku, 300), released, version, state, note FROM placed WHERE place <= $1 ORDER BY station, place"
    );
    for row in &session.rows_within(PATIENCE, &listed, &[(&SKUS, Type::INT8)]).await? {
        let Some(settings) = stations.get_mut(row.try_get::<_, &str>(0)?) else { continue };
        settings.skus.push(SkuSettings {
            sku: row.try_get(1)?,
            released: row.try_get(2)?,
            version: row.try_get(3)?,
            state: match row.try_get(4)? {
                "current" => SkuSettingsState::Current,
                "local" => SkuSettingsState::Local,
                "refused" => SkuSettingsState::Refused,
                _ => SkuSettingsState::Behind,
            },
            note: row.try_get(5)?,
        });
    }
    Ok(stations.into_values().collect())
}
