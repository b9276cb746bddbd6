//! Fits and current parts in the database.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use tokio_postgres::Row;
use tokio_postgres::types::Type;

use super::error::FleetError;
use super::outbox;
use super::session::Session;
use crate::cache::{Cache, CacheKey, CurrentPart, KeptBytes, PartOrder, PartOrigin};
use crate::config::Sku;
use crate::files::is_plain;

/// The largest body of a fit, and the largest mesh for pictures, bytes.
const LARGEST: i32 = 64 << 20;
/// How long a fit may take from the database.
const FETCH: Duration = Duration::from_secs(30);
/// The slowest network over which fits are sent, bytes in a second.
const SLOWEST: usize = 50_000;
/// Rows of current parts that are read at a time.
const PAGE: i64 = 500;
/// The longest file name, characters.
const LONGEST_NAME: usize = 255;

const PART: &str = "left(name, 300), version, left(file, 300), left(blake3, 100), has_frame, left(station, 300), \
                    extract(epoch FROM clock_timestamp() - learned)::float8, (1000000 * extract(epoch FROM at))::int8, \
                    coalesce((SELECT (1000000 * extract(epoch FROM m.at))::int8 FROM isomark.migration AS m WHERE m.number = 1), 0)";

/// The current part of a SKU, as the fleet has it.
#[derive(Debug, Clone)]
pub(super) struct SharedPart {
    pub(super) sku: Sku,
    pub(super) part: CurrentPart,
    /// The station that learned it.
    pub(super) station: String,
}

/// What became of a fit that a station asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Fetched {
    /// The cache has it now.
    Kept,
    /// The fleet does not have it.
    Absent,
    /// The fleet has it, and it cannot be used.
    Wrong(String),
}

/// Takes a fit into the cache, if its content is what its hash and its part require.
pub(super) async fn fetch(
    session: &Session,
    cache: &Cache,
    sku: &Sku,
    key: &CacheKey,
    part: &PartOrigin,
) -> Result<Fetched, FleetError> {
    let rows = session
        .rows_within(
            FETCH,
            "SELECT CASE WHEN octet_length(body) <= $2 THEN body END, left(encode(body_blake3, 'hex'), 100), \
             CASE WHEN octet_length(mesh) <= $2 THEN mesh END, left(encode(mesh_blake3, 'hex'), 100) \
             FROM isomark.fit WHERE key = $1",
            &[(&key.as_str(), Type::TEXT), (&LARGEST, Type::INT4)],
        )
        .await?;
    let Some(row) = rows.first() else { return Ok(Fetched::Absent) };
    let (body, its_hash): (Option<&[u8]>, &str) = (row.try_get(0)?, row.try_get(1)?);
    let (mesh, mesh_hash): (Option<&[u8]>, Option<&str>) = (row.try_get(2)?, row.try_get(3)?);
    let has = |bytes: &[u8], hash: &str| *blake3::hash(bytes).to_hex() == *hash;
    let Some(body) = body else { return Ok(Fetched::Wrong(format!("it is larger than {LARGEST} bytes"))) };
    if !has(body, its_hash) {
        return Ok(Fetched::Wrong("its content does not match its hash".into()));
    }
    // A picture can do without its mesh.
    let mesh = mesh.filter(|mesh| mesh_hash.is_some_and(|hash| has(mesh, hash)));
    // The bytes come from another computer.
    let taken = catch_unwind(AssertUnwindSafe(|| cache.take_in(sku, key, part, body, mesh)));
    match taken {
        Ok(Ok(Ok(()))) => {}
        Ok(Ok(Err(what))) => return Ok(Fetched::Wrong(what)),
        Ok(Err(error)) => return Ok(Fetched::Wrong(format!("the cache cannot keep it: {error}"))),
        Err(_) => return Ok(Fetched::Wrong("its content is invalid".into())),
    }
    Ok(Fetched::Kept)
}

/// Notes that a fit was used, once a day.
pub(super) async fn note_use(session: &Session, key: &CacheKey) -> Result<(), FleetError> {
    let statement = "UPDATE isomark.fit SET used = now() WHERE key = $1 AND used < now() - interval '1 day'";
    session.rows(statement, &[(&key.as_str(), Type::TEXT)]).await.map(drop)
}

/// Which of these keys the fleet has no fit for.
pub(super) async fn absent(session: &Session, keys: &[&str]) -> Result<Vec<String>, FleetError> {
    if keys.is_empty() {
        return Ok(Vec::new());
    }
    let statement = "SELECT key FROM unnest($1) AS given (key) WHERE NOT EXISTS (SELECT FROM isomark.fit AS f WHERE f.key = given.key)";
    let rows = session.rows(statement, &[(&keys, Type::TEXT_ARRAY)]).await?;
    Ok(rows.iter().map(|row| row.try_get(0)).collect::<Result<_, _>>()?)
}

/// Sends a fit of the cache; one that is there stays as it is. Does nothing if the cache has lost it.
pub(super) async fn send(
    session: &Session,
    cache: &Cache,
    station: &str,
    sku: &Sku,
    key: &CacheKey,
    part: &PartOrigin,
) -> Result<(), FleetError> {
    let statement = "SELECT EXISTS (SELECT FROM isomark.fit WHERE key = $1)";
    if session.row(statement, &[(&key.as_str(), Type::TEXT)]).await?.try_get(0)? {
        return Ok(());
    }
    let Ok(Some(bytes)) = cache.bytes(sku, key) else { return Ok(()) };
    if let Some(size) = too_large(&bytes) {
        tracing::info!("the surface of {sku} stays at this station: it has {size} bytes");
        return Ok(());
    }
    write(session, station, sku, key.as_str(), &part.blake3, &bytes).await
}

/// The size of a fit, bytes, if it is more than the fleet keeps.
pub(super) fn too_large(bytes: &KeptBytes) -> Option<usize> {
    Some(bytes.fit.len()).filter(|size| *size > LARGEST as usize)
}

/// Adds the fit of the part with this hash; one that is there stays as it is.
pub(super) async fn write(
    session: &Session,
    station: &str,
    sku: &Sku,
    key: &str,
    part_blake3: &str,
    bytes: &KeptBytes,
) -> Result<(), FleetError> {
    let body = &bytes.fit;
    let mesh = bytes.mesh.as_ref().filter(|mesh| mesh.len() <= LARGEST as usize);
    let hash = |bytes: &[u8]| blake3::hash(bytes).as_bytes().to_vec();
    let (body_hash, mesh_hash) = (hash(body), mesh.map(|mesh| hash(mesh)));
    let patience = Duration::from_secs(((body.len() + mesh.map_or(0, Vec::len)) / SLOWEST) as u64);
    session
        .rows_within(
            Session::ANSWER + patience,
            "INSERT INTO isomark.fit (key, sku, part, body, body_blake3, mesh, mesh_blake3, station) \
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8) ON CONFLICT DO NOTHING",
            &[
                (&key, Type::TEXT),
                (&sku.key(), Type::TEXT),
                (&part_blake3, Type::TEXT),
                (body, Type::BYTEA),
                (&body_hash, Type::BYTEA),
                (&mesh, Type::BYTEA),
                (&mesh_hash, Type::BYTEA),
                (&station, Type::TEXT),
            ],
        )
        .await
        .map(drop)
}

/// Announces a part that was learned `age` ago. Gives whether it is the current one now.
pub(super) async fn announce(
    session: &Session,
    station: &str,
    sku: &Sku,
    part: &CurrentPart,
    age: Duration,
) -> Result<bool, FleetError> {
    let row = session
        .row(
            "SELECT is_current FROM isomark.learned($1, $2, $3, $4, $5, $6, $7)",
            &[
                (&sku.key(), Type::TEXT),
                (&sku.as_str(), Type::TEXT),
                (&part.origin.file, Type::TEXT),
                (&part.origin.blake3, Type::TEXT),
                (&part.has_frame, Type::BOOL),
                (&station, Type::TEXT),
                (&age.as_secs_f64(), Type::FLOAT8),
            ],
        )
        .await?;
    Ok(row.try_get(0)?)
}

/// The current part of a SKU by its key; `None` if there is none that can be used.
pub(super) async fn current(session: &Session, sku_key: &str) -> Result<Option<SharedPart>, FleetError> {
    let statement = format!("SELECT {PART} FROM isomark.current_part WHERE sku = $1");
    let rows = session.rows(&statement, &[(&sku_key, Type::TEXT)]).await?;
    rows.first().map_or(Ok(None), shared_part)
}

/// The next current parts in the order of their SKUs, and the last key that was read; `None` at the end.
pub(super) async fn page_of_parts(
    session: &Session,
    after: &str,
) -> Result<(Vec<SharedPart>, Option<String>), FleetError> {
    let statement = format!(
        "SELECT {PART}, left(sku, 300) FROM isomark.current_part WHERE sku > $1 ORDER BY sku LIMIT $2"
    );
    let rows = session.rows(&statement, &[(&after, Type::TEXT), (&PAGE, Type::INT8)]).await?;
    let mut parts = Vec::new();
    for row in &rows {
        parts.extend(shared_part(row)?);
    }
    let last = rows.last().map(|row| row.try_get(9)).transpose()?;
    Ok((parts, last))
}

/// A row as a part; `None` for values that no station writes.
fn shared_part(row: &Row) -> Result<Option<SharedPart>, FleetError> {
    let (name, version, file): (&str, i64, &str) = (row.try_get(0)?, row.try_get(1)?, row.try_get(2)?);
    let (blake3, has_frame): (&str, bool) = (row.try_get(3)?, row.try_get(4)?);
    let (station, age_s): (&str, f64) = (row.try_get(5)?, row.try_get(6)?);
    let is_hash = blake3.len() == 64 && blake3.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'));
    let is_name =
        is_plain(file) && file.chars().count() <= LONGEST_NAME && !file.chars().any(char::is_control);
    let (Ok(sku), true, true) = (name.parse::<Sku>(), is_hash, is_name) else {
        tracing::warn!("ignoring a part in the fleet whose row is invalid");
        return Ok(None);
    };
    let origin = PartOrigin { file: file.into(), blake3: blake3.into() };
    let age = Duration::try_from_secs_f64(age_s).unwrap_or_default();
    let order = PartOrder {
        fleet_us: row.try_get(8)?,
        version,
        announced_us: row.try_get(7)?,
        learned_ms: outbox::moment(age),
    };
    let part = CurrentPart::new(origin, has_frame).in_order(order);
    Ok(Some(SharedPart { sku, part, station: station.into() }))
}
