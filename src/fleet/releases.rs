//! Released settings in the database.

use std::collections::BTreeMap;

use tokio_postgres::Row;
use tokio_postgres::types::Type;

use super::error::FleetError;
use super::released_text::MOST_LINES;
use super::session::Session;
use super::sku_files::{Release, Report};
use crate::config::Sku;

/// The largest settings that are released, bytes.
pub(super) const LARGEST: usize = 1 << 20;
/// Rows of the list that are read at a time.
const PAGE: i64 = 500;

/// Which one of two releases of a SKU a station uses: its own one. If both were removed, the newer row states that.
const ORDER: &str = "c.sku, c.blake3 IS NULL, c.blake3 IS NOT NULL AND c.station = '', c.version DESC";

/// A row of the list of releases for a station.
#[derive(Debug, Clone)]
pub(super) struct Listed {
    /// The key of the SKU.
    pub(super) sku: String,
    pub(super) version: i64,
    /// The hash of the settings; `None` if they were removed.
    pub(super) blake3: Option<String>,
    /// What the station reported last: version and state.
    pub(super) reported: Option<(i64, String)>,
}

/// A release as a station gets it; or why its row cannot be used.
pub(super) type Received = Result<Release, (String, i64, String)>;

/// The next releases for a station in the order of their SKUs. One for the station is used in place of one for all.
pub(super) async fn page(session: &Session, station: &str, after: &str) -> Result<Vec<Listed>, FleetError> {
    let rows = session
        .rows(
            &format!(
            "SELECT DISTINCT ON (c.sku) left(c.sku, 300), c.version, left(c.blake3, 100), h.version, left(h.state, 100) \
             FROM isomark.current_release AS c \
             LEFT JOIN isomark.station_release AS h ON h.station = $1 AND h.sku = c.sku \
             WHERE c.station IN ('', $1) AND c.sku > $2 ORDER BY {ORDER} LIMIT $3"
            ),
            &[(&station, Type::TEXT), (&after, Type::TEXT), (&PAGE, Type::INT8)],
        )
        .await?;
    let listed = |row: &Row| -> Result<Listed, FleetError> {
        let (version, state): (Option<i64>, Option<String>) = (row.try_get(3)?, row.try_get(4)?);
        Ok(Listed {
            sku: row.try_get(0)?,
            version: row.try_get(1)?,
            blake3: row.try_get(2)?,
            reported: version.zip(state),
        })
    };
    rows.iter().map(listed).collect()
}

/// The releases of these SKUs for a station.
pub(super) async fn fetch(
    session: &Session,
    station: &str,
    skus: &[String],
) -> Result<Vec<Received>, FleetError> {
    let largest = LARGEST as i32;
    let rows = session
        .rows(
            &format!(
            "SELECT DISTINCT ON (c.sku) left(c.sku, 300), c.version, r.body IS NULL, \
             CASE WHEN octet_length(r.body) <= $3 THEN r.body END, left(r.blake3, 100), left(r.name, 300), left(r.station, 300), \
             left(r.author, 300), r.login::text, to_char(r.at AT TIME ZONE 'UTC', 'YYYY-MM-DD\"T\"HH24:MI:SS\"Z\"') \
             FROM isomark.current_release AS c JOIN isomark.release AS r ON r.sku = c.sku AND r.version = c.version \
             WHERE c.station IN ('', $1) AND c.sku = ANY ($2) ORDER BY {ORDER}"
            ),
            &[(&station, Type::TEXT), (&skus, Type::TEXT_ARRAY), (&largest, Type::INT4)],
        )
        .await?;
    rows.iter().map(received).collect()
}

fn received(row: &Row) -> Result<Received, FleetError> {
    let (key, version): (String, i64) = (row.try_get(0)?, row.try_get(1)?);
    let (is_removed, body): (bool, Option<&[u8]>) = (row.try_get(2)?, row.try_get(3)?);
    let (blake3, name, scope): (Option<&str>, &str, &str) =
        (row.try_get(4)?, row.try_get(5)?, row.try_get(6)?);
    let (author, login, at): (Option<&str>, &str, &str) = (row.try_get(7)?, row.try_get(8)?, row.try_get(9)?);
    let checked = || -> Result<Release, String> {
        let sku: Sku = name.parse().map_err(|error: crate::config::BadSku| error.to_string())?;
        if sku.key() != key {
            return Err("its row is of another SKU".into());
        }
        let settings = match (is_removed, body) {
            (true, _) => None,
            (false, None) => return Err(format!("it is larger than {LARGEST} bytes")),
            (false, Some(body)) if Some(&*blake3::hash(body).to_hex()) != blake3 => {
                return Err("its content does not match its hash".into());
            }
            (false, Some(body)) => match std::str::from_utf8(body) {
                Ok(text) if text.lines().count() > MOST_LINES => {
                    return Err(format!("it has more than {MOST_LINES} lines"));
                }
                Ok(text) => Some(text.to_owned()),
                Err(_) => return Err("it is not UTF-8 text".into()),
            },
        };
        let about = about(&sku, version, scope, settings.is_none(), &by(author, login), at);
        Ok(Release { sku, version, about, settings })
    };
    Ok(checked().map_err(|why| (key.clone(), version, why)))
}

/// Who released something.
pub(super) fn by(author: Option<&str>, login: &str) -> String {
    match author {
        Some(author) => format!("{author} ({login})"),
        None => login.to_owned(),
    }
}

fn about(sku: &Sku, version: i64, scope: &str, is_removed: bool, by: &str, at: &str) -> String {
    let stations = if scope.is_empty() { "all stations".to_owned() } else { format!("the station {scope}") };
    let verb = if is_removed { "removed" } else { "released" };
    format!("version {version} of {sku} for {stations}, {verb} by {by} at {at}")
}

/// Notes what a station does with releases, by the keys of their SKUs.
pub(super) async fn report(
    session: &Session,
    station: &str,
    reports: &BTreeMap<String, Report>,
) -> Result<(), FleetError> {
    let skus: Vec<&str> = reports.keys().map(String::as_str).collect();
    let versions: Vec<i64> = reports.values().map(|report| report.version).collect();
    let states: Vec<&str> = reports.values().map(|report| report.state.name()).collect();
    let notes: Vec<Option<&str>> = reports.values().map(|report| report.note.as_deref()).collect();
    let values = [
        (&station as _, Type::TEXT),
        (&skus as _, Type::TEXT_ARRAY),
        (&versions as _, Type::INT8_ARRAY),
        (&states as _, Type::TEXT_ARRAY),
        (&notes as _, Type::TEXT_ARRAY),
    ];
    session.rows("SELECT isomark.received($1, $2, $3, $4, $5)", &values).await.map(drop)
}
