//! Jobs for other lines in the database.

use std::time::Duration;

use serde::Serialize;
use tokio::time::timeout;
use tokio_postgres::Row;
use tokio_postgres::types::Type;

use super::address::Address;
use super::desk::Desk;
use super::error::{FleetError, Needed};
use super::migrations;
use super::session::{Session, run};
use crate::config::FleetSettings;
use crate::hotfolder::line::{
    Answer, Arriving, Claim, Inputs, JobNews, LineJob, Offered, Origin, check_name,
};
use crate::printable::on_one_line;
use crate::reason::Reason;

/// The slowest network over which inputs are sent, bytes in a second.
const SLOWEST: usize = 50_000;
/// How long the inputs of a job may take from the database.
const FETCH: Duration = Duration::from_secs(30);
/// How long the station may take to note a job; the server keeps it locked for longer.
const NOTING: Duration = Duration::from_secs(8);
/// The longest reason, characters.
const LONGEST_REASON: usize = 1500;
/// Jobs that a status lists: those that have not ended, and the last ones that have.
const OPEN_LISTED: i64 = 500;
const ENDED_LISTED: i64 = 20;

/// Notes from which queues the station takes jobs: its own, and those of its groups.
pub(super) async fn serve(session: &Session, settings: &FleetSettings) -> Result<(), FleetError> {
    let mut lines = settings.lines.clone();
    lines.push(settings.name.clone());
    let values: [(&(dyn tokio_postgres::types::ToSql + Sync), Type); 2] =
        [(&settings.name, Type::TEXT), (&lines, Type::TEXT_ARRAY)];
    session.rows("SELECT isomark.serve_lines($1, $2)", &values).await.map(drop)
}

/// Puts a job into the queue of its line, once; `station` is the sender, or the login is.
///
/// # Errors
/// When the database cannot be used, or the line may not have the job.
pub(super) async fn offer(
    session: &Session,
    station: Option<&str>,
    job: &LineJob,
) -> Result<(bool, Offered), FleetError> {
    if job.inputs.list.is_some() {
        must_be_one_station(session, &job.line).await?;
    }
    let Inputs { drawing, settings, list } = &job.inputs;
    let hash = job.inputs.hash();
    let patience = Duration::from_secs((job.inputs.bytes() / SLOWEST) as u64);
    let rows = session
        .rows_within(
            Session::ANSWER + patience,
            "SELECT is_new, inputs_blake3, is_served FROM isomark.offer_job($1, $2, $3, $4, $5, $6, $7, $8)",
            &[
                (&job.id, Type::TEXT),
                (&job.line, Type::TEXT),
                (&job.name, Type::TEXT),
                (&station, Type::TEXT),
                (&hash, Type::TEXT),
                (&drawing.as_slice(), Type::BYTEA),
                (&settings, Type::BYTEA),
                (&list, Type::BYTEA),
            ],
        )
        .await?;
    let row = rows.first().ok_or_else(|| FleetError::Answer("no answer to an offer".into()))?;
    let kept: &str = row.try_get(1)?;
    Ok((row.try_get(0)?, Offered::Kept { is_same: kept == hash, is_served: row.try_get(2)? }))
}

/// Refuses a line for a list if another station than the one of that name takes from it: each station counts its own serial numbers,
/// and two of them would give the same ones.
async fn must_be_one_station(session: &Session, line: &str) -> Result<(), FleetError> {
    let statement = "SELECT EXISTS (SELECT FROM isomark.line WHERE line = $1 AND station <> $1)";
    match session.row(statement, &[(&line, Type::TEXT)]).await?.try_get(0)? {
        true => Err(FleetError::ListForGroup { line: line.into() }),
        false => Ok(()),
    }
}

/// Does what is to do with jobs at the moment; takes at most one. Whether there may be more.
pub(super) async fn work(
    session: &Session,
    settings: &FleetSettings,
    desk: &Desk,
) -> Result<bool, FleetError> {
    check_open(session, settings, desk).await?;
    report_ends(session, settings, desk).await?;
    let Some(busy) = desk.may_take() else { return Ok(false) };
    take(session, settings, desk, &busy).await
}

/// Asks which open jobs are still the station's: a connection may have ended before it knew, and a person may have given them to
/// another one.
async fn check_open(session: &Session, settings: &FleetSettings, desk: &Desk) -> Result<(), FleetError> {
    let unchecked = desk.unchecked();
    if !unchecked.is_empty() {
        let ids: Vec<&str> = unchecked.iter().map(|((id, _), _)| id.as_str()).collect();
        let rows = session
            .rows(
                "SELECT id, attempt, station = $2 AND state <> 'waiting' FROM isomark.job WHERE id = ANY ($1)",
                &[(&ids, Type::TEXT_ARRAY), (&settings.name, Type::TEXT)],
            )
            .await?;
        let known: Vec<(String, i32, Option<bool>)> = rows
            .iter()
            .map(|row| Ok((row.try_get(0)?, row.try_get(1)?, row.try_get(2)?)))
            .collect::<Result<_, tokio_postgres::Error>>()?;
        for (claim, _) in unchecked {
            let its = known.iter().find(|(id, ..)| *id == claim.0);
            // Without a row, nobody else can take it: the database was made again.
            let is_ours =
                its.is_none_or(|(_, attempt, is_here)| *is_here == Some(true) && *attempt == claim.1);
            desk.is_checked(&claim);
            desk.note(if is_ours { JobNews::IsOurs(claim) } else { JobNews::IsNotOurs(claim) });
        }
    }
    Ok(())
}

async fn report_ends(session: &Session, settings: &FleetSettings, desk: &Desk) -> Result<(), FleetError> {
    for ended in desk.unreported() {
        let reason = ended.reason.as_deref().map(shortened);
        let noted = end(session, &settings.name, &ended.claim, ended.outcome, reason.as_deref()).await?;
        let (job, outcome, attempt) = (short_id(&ended.claim.0), ended.outcome, ended.claim.1);
        match noted {
            true => {}
            false if ended.may_be_marked() => tracing::warn!(
                "job {job} was {outcome} here in its attempt {attempt}, but it had already been handed to another attempt; it may be \
                 marked twice. Check with `isomark fleet status`"
            ),
            false => tracing::info!(
                "job {job} was {outcome} here in its attempt {attempt}, and was not marked here; another attempt has it"
            ),
        }
        desk.is_reported(&ended.claim);
    }
    Ok(())
}

async fn end(
    session: &Session,
    station: &str,
    (id, attempt): &Claim,
    outcome: &str,
    reason: Option<&str>,
) -> Result<bool, FleetError> {
    let row = session
        .row(
            "SELECT isomark.end_job($1, $2, $3, $4, $5)",
            &[
                (id, Type::TEXT),
                (&station, Type::TEXT),
                (attempt, Type::INT4),
                (&outcome, Type::TEXT),
                (&reason, Type::TEXT),
            ],
        )
        .await?;
    Ok(row.try_get(0)?)
}

/// Takes the next job, in one transaction that locks it. An error ends the connection, and with it the transaction.
async fn take(
    session: &Session,
    settings: &FleetSettings,
    desk: &Desk,
    busy: &[String],
) -> Result<bool, FleetError> {
    session.batch("BEGIN").await?;
    let limit = Inputs::LARGEST as i64;
    let rows = session
        .rows_within(
            FETCH,
            "SELECT id, attempt, left(name, 300), left(sender, 300), left(inputs_blake3, 100), \
             CASE WHEN is_small THEN drawing END, CASE WHEN is_small THEN settings END, CASE WHEN is_small THEN list END, \
             left(line, 300) \
             FROM isomark.next_job($1, $2) CROSS JOIN LATERAL (SELECT octet_length(drawing)::int8 + \
             coalesce(octet_length(settings), 0) + coalesce(octet_length(list), 0) <= $3 AS is_small) AS size",
            &[(&settings.name, Type::TEXT), (&busy, Type::TEXT_ARRAY), (&limit, Type::INT8)],
        )
        .await?;
    let Some(row) = rows.first() else {
        session.batch("ROLLBACK").await?;
        desk.found_nothing();
        return Ok(false);
    };
    let claim: Claim = (row.try_get(0)?, row.try_get(1)?);
    match arriving(row, &claim, &settings.name)? {
        Ok(job) => {
            let (name, sender) = (on_one_line(&job.name), on_one_line(&job.sender));
            let answered = timeout(NOTING, desk.ask(job)).await;
            if !matches!(answered, Ok(Ok(Answer::Kept))) {
                session.batch("ROLLBACK").await?;
                desk.is_busy(&claim.0);
                return Ok(true);
            }
            let is_ours = mark_taken(session, settings, &claim).await?;
            session.batch("COMMIT").await?;
            desk.is_checked(&claim);
            if is_ours {
                tracing::info!("took job {} of {sender}: {name}", short_id(&claim.0));
                desk.note(JobNews::IsOurs(claim));
            } else {
                desk.is_busy(&claim.0);
                desk.note(JobNews::IsNotOurs(claim));
            }
        }
        Err(what) => {
            tracing::warn!("refusing job {} of the fleet: {what}", on_one_line(short_id(&claim.0)));
            let is_refused = mark_taken(session, settings, &claim).await?
                && end(session, &settings.name, &claim, "rejected", Some(&shortened(&what))).await?;
            session.batch("COMMIT").await?;
            if !is_refused {
                desk.is_busy(&claim.0);
            }
        }
    }
    Ok(true)
}

async fn mark_taken(session: &Session, settings: &FleetSettings, claim: &Claim) -> Result<bool, FleetError> {
    let row = session
        .row(
            "SELECT isomark.take_job($1, $2, $3)",
            &[(&claim.0, Type::TEXT), (&settings.name, Type::TEXT), (&claim.1, Type::INT4)],
        )
        .await?;
    Ok(row.try_get(0)?)
}

/// The job of a row for this station, or why it is refused: the row comes from another computer.
fn arriving(row: &Row, claim: &Claim, station: &str) -> Result<Result<Arriving, String>, FleetError> {
    let text = |column: usize| row.try_get::<_, Option<&str>>(column).map(Option::unwrap_or_default);
    let (name, sender, hash) = (text(2)?.to_owned(), text(3)?.to_owned(), text(4)?);
    let (drawing, settings, list): (Option<Vec<u8>>, _, _) =
        (row.try_get(5)?, row.try_get(6)?, row.try_get(7)?);
    let line: &str = row.try_get(8)?;
    let is_hash =
        |text: &str| text.len() == 64 && text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'));
    if !is_hash(&claim.0) || claim.1 < 1 {
        return Ok(Err("its number is not valid".into()));
    }
    if let Err(reason) = check_name(&name) {
        return Ok(Err(reason.what));
    }
    let Some(drawing) = drawing else {
        return Ok(Err(format!("its inputs are missing, or larger than {} bytes", Inputs::LARGEST)));
    };
    let inputs = Inputs { drawing, settings, list };
    if inputs.hash() != hash {
        return Ok(Err("its content does not match its hash".into()));
    }
    // The line may be a group only since it was sent.
    if inputs.list.is_some() && line != station {
        let Reason { what, remedy, .. } = FleetError::ListForGroup { line: line.into() }.reason();
        return Ok(Err(format!("{what} {remedy}")));
    }
    Ok(Ok(Arriving { id: claim.0.clone(), attempt: claim.1, name, sender, inputs }))
}

/// The start of the identity of a job, which tells jobs apart for a person.
pub(crate) fn short_id(id: &str) -> &str {
    id.get(..12).unwrap_or(id)
}

fn shortened(text: &str) -> String {
    on_one_line(text).chars().take(LONGEST_REASON).collect()
}

/// The jobs for other lines.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Jobs {
    /// How many wait in the queues.
    pub waiting: i64,
    /// How many a station has taken and not ended.
    pub taken: i64,
    /// At most 500 that have not ended, the oldest first, and then the last 20 that have, the newest first.
    pub listed: Vec<JobRow>,
}

/// A job for another line.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct JobRow {
    /// Its identity.
    pub id: String,
    /// The line that it is for: a station or a group.
    pub line: String,
    /// The name of the drawing.
    pub name: String,
    /// The station that sent it, or the login of a person.
    pub sender: String,
    /// `waiting`, `taken` or `ended`.
    pub state: String,
    /// The time since it was sent, s.
    pub age_s: f64,
    /// How often it was taken.
    pub attempt: i32,
    /// The station that took it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub station: Option<String>,
    /// `delivered`, `uncertain`, `listed` (divided into the rows of its list), `removed` or `rejected`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outcome: Option<String>,
    /// Why it waits or was not delivered.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// The jobs for a status.
pub(super) async fn listed(session: &Session) -> Result<Jobs, FleetError> {
    let row = session
        .row(
            "SELECT count(*) FILTER (WHERE state = 'waiting'), count(*) FILTER (WHERE state = 'taken') \
             FROM isomark.job WHERE state <> 'ended'",
            &[],
        )
        .await?;
    let columns = "j.id, left(j.line, 300), left(j.name, 300), left(j.sender, 300), j.state, \
         extract(epoch FROM now() - j.at)::float8, j.attempt, left(j.station, 300), j.outcome, left(j.reason, 2000), \
         NOT EXISTS (SELECT FROM isomark.line AS l WHERE l.line = j.line)";
    let statement = format!(
        "(SELECT {columns} FROM isomark.job AS j WHERE state <> 'ended' ORDER BY number LIMIT $1) UNION ALL \
         (SELECT {columns} FROM isomark.job AS j WHERE state = 'ended' ORDER BY ended DESC, number LIMIT $2)"
    );
    let rows = session.rows(&statement, &[(&OPEN_LISTED, Type::INT8), (&ENDED_LISTED, Type::INT8)]).await?;
    let listed = rows.iter().map(job).collect::<Result<_, _>>()?;
    Ok(Jobs { waiting: row.try_get(0)?, taken: row.try_get(1)?, listed })
}

fn job(row: &Row) -> Result<JobRow, tokio_postgres::Error> {
    let (state, is_unserved): (String, bool) = (row.try_get(4)?, row.try_get(10)?);
    let unserved = || "No station of the fleet takes jobs for this line.".to_owned();
    Ok(JobRow {
        id: row.try_get(0)?,
        line: row.try_get(1)?,
        name: row.try_get(2)?,
        sender: row.try_get(3)?,
        reason: row.try_get::<_, Option<String>>(9)?.or((state == "waiting" && is_unserved).then(unserved)),
        state,
        age_s: row.try_get::<_, f64>(5)?.max(0.0),
        attempt: row.try_get(6)?,
        station: row.try_get(7)?,
        outcome: row.try_get(8)?,
    })
}

/// A drawing that a person sends.
#[derive(Debug, Clone)]
pub struct Sending {
    /// The name of the drawing.
    pub name: String,
    /// When it was written, or sent again.
    pub at: Option<std::time::SystemTime>,
    /// What is sent.
    pub inputs: Inputs,
}

/// A drawing that was sent.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Sent {
    /// The identity of the job.
    pub id: String,
    /// Whether it was not sent before.
    pub is_new: bool,
    /// Whether any station takes jobs for its line.
    pub is_served: bool,
}

/// Sends drawings to a line, each once; `station` is the sender, or the login is.
///
/// # Errors
/// When the database cannot be used, the login may not send jobs, or a drawing has a list and the line is a group; then nothing is
/// sent. The drawings before any other error are sent.
pub fn send(
    address: &Address,
    station: Option<&str>,
    line: &str,
    drawings: Vec<Sending>,
    mut sent: impl FnMut(&str, Sent),
) -> Result<(), FleetError> {
    let needed = if station.is_some() { Needed::Station } else { Needed::StationOrOffice };
    run(needed, async {
        let session = Session::open::<()>(address, None).await?;
        migrations::check(&session).await?;
        if drawings.iter().any(|drawing| drawing.inputs.list.is_some()) {
            must_be_one_station(&session, line).await?;
        }
        let login = session.row("SELECT session_user::text", &[]).await?;
        let login: String = login.try_get(0)?;
        for Sending { name, at, inputs } in drawings {
            let origin = Origin { sender: station.unwrap_or(&login), drop: &name, at };
            let job = LineJob::new(line, &name, origin, inputs);
            let (is_new, offered) = offer(&session, station, &job).await?;
            let is_served = matches!(offered, Offered::Kept { is_served: true, .. });
            sent(&name, Sent { id: job.id, is_new, is_served });
        }
        Ok(())
    })
}

/// A job that [`take_over`] found.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct TakenOver {
    /// Its identity.
    pub id: String,
    /// The name of the drawing.
    pub name: String,
    /// The station that had taken it; `None` if none had.
    pub station: Option<String>,
    /// The line in whose queue it is now, or was sent to.
    pub line: String,
    /// What became of it.
    pub outcome: TakeOver,
    /// Whether any station takes jobs for the line that it is for now.
    pub is_served: bool,
}

/// What became of a job that [`take_over`] found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum TakeOver {
    /// It is in the queue.
    Moved,
    /// It waits in its queue, and no other line was given.
    Waits,
    /// It stays with its station, which is alive.
    StationAlive,
    /// It has a list and stays, because the line is a group.
    ListForGroup,
}

/// Puts jobs into a queue: the job with this identity or its first 8 digits at least, or all that a station has taken. Those of a
/// station that is alive stay, unless it is forced. A job that nobody has taken goes to the given line.
///
/// # Errors
/// When the database cannot be used, or the login may not do that.
pub fn take_over(
    address: &Address,
    target: &str,
    line: Option<&str>,
    is_forced: bool,
) -> Result<Vec<TakenOver>, FleetError> {
    run(Needed::StationOrOffice, async {
        let session = Session::open::<()>(address, None).await?;
        migrations::check(&session).await?;
        let rows = session
            .rows(
                "SELECT id, name, station, line, outcome, is_served FROM isomark.take_over($1, $2, $3)",
                &[(&target, Type::TEXT), (&line, Type::TEXT), (&is_forced, Type::BOOL)],
            )
            .await?;
        let found = |row: &Row| -> Result<TakenOver, tokio_postgres::Error> {
            Ok(TakenOver {
                id: row.try_get(0)?,
                name: row.try_get(1)?,
                station: row.try_get(2)?,
                line: row.try_get(3)?,
                outcome: match row.try_get(4)? {
                    "moved" => TakeOver::Moved,
                    "waits" => TakeOver::Waits,
                    "list" => TakeOver::ListForGroup,
                    _ => TakeOver::StationAlive,
                },
                is_served: row.try_get(5)?,
            })
        };
        Ok(rows.iter().map(found).collect::<Result<_, _>>()?)
    })
}
