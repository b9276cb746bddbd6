//! Histories of what several stations ask of the database, recorded while connections are cut and the server is killed, and
//! checked for linearisability: each operation takes effect at one moment between its call and its answer.
//!
//! The checker is that of `todc-utils`: the algorithm of Wing and Gong, as improved by Lowe ("Testing for linearizability",
//! 2017). `ISOMARK_HISTORIES=20 ISOMARK_SEED=7 cargo test --test fleet histories -- --nocapture` records as many runs as given,
//! and prints the counts.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use todc_utils::Action::{Call, Response};
use todc_utils::{History, Specification, WGLChecker};
use tokio_postgres::types::Type;

use crate::client::Connected;
use crate::kills::{Random, number};
use crate::proxy::Proxy;
use crate::server::{SECRET, Server, waits_for};
use crate::tables::server_with_tables;

const STATIONS: usize = 6;
/// How often a run is disturbed.
const DISTURBANCES: usize = 6;
const PATIENCE: Duration = Duration::from_secs(1);

/// An operation that was recorded.
#[derive(Debug, Clone)]
struct Recorded<T> {
    called: u64,
    /// `None` if the answer did not come: it may have taken effect, or do so later, or never.
    answered: Option<u64>,
    operation: T,
}

/// Records operations of all threads of a run, under the number of their object.
struct Recorder<T> {
    /// The one clock of a run: it counts calls and answers.
    clock: AtomicU64,
    operations: Mutex<BTreeMap<u64, Vec<Recorded<T>>>>,
}

impl<T> Recorder<T> {
    fn new() -> Self {
        Self { clock: AtomicU64::new(0), operations: Mutex::default() }
    }

    fn now(&self) -> u64 {
        self.clock.fetch_add(1, Ordering::SeqCst)
    }

    /// Notes an operation that has just ended, or whose answer did not come.
    fn note(&self, object: u64, called: u64, has_answer: bool, operation: T) {
        let answered = has_answer.then(|| self.now());
        let recorded = Recorded { called, answered, operation };
        self.operations.lock().unwrap().entry(object).or_default().push(recorded);
    }
}

/// Whether there is an order of the operations, one at a time, that explains all answers. An operation without an answer ends
/// after all others: an effect that nobody has seen may also be the last one.
fn is_linearizable<S: Specification>(operations: &[Recorded<S::Operation>]) -> bool {
    let mut events = Vec::new();
    for (index, recorded) in operations.iter().enumerate() {
        events.push((recorded.called, index, Call(recorded.operation.clone())));
        let answered = recorded.answered.unwrap_or(u64::MAX);
        events.push((answered, index, Response(recorded.operation.clone())));
    }
    events.sort_by_key(|(at, ..)| *at);
    let events = events.into_iter().map(|(_, index, event)| (index, event)).collect();
    WGLChecker::<S>::is_linearizable(History::from_actions(events))
}

/// The current part of a SKU, with its version.
struct CurrentPart;

#[derive(Debug, Clone)]
enum PartOperation {
    /// A station learns a part. The answer: whether it is the current one, and the current one with its version.
    Learn(u64, Option<(bool, i64, u64)>),
    /// The version and the part that a station sees; version 0 if there is none.
    Read(i64, u64),
}

impl Specification for CurrentPart {
    type State = (i64, u64);
    type Operation = PartOperation;

    fn init() -> Self::State {
        (0, 0)
    }

    fn apply(operation: &Self::Operation, state: &Self::State) -> (bool, Self::State) {
        let next = state.0 + 1;
        match *operation {
            PartOperation::Learn(part, None) => (true, (next, part)),
            PartOperation::Learn(part, Some((true, version, current))) => {
                ((version, current) == (next, part), (next, part))
            }
            // Another station learned a later one at the same moment.
            PartOperation::Learn(_, Some((false, version, current))) => {
                ((version, current) == *state, *state)
            }
            PartOperation::Read(version, part) => ((version, part) == *state, *state),
        }
    }
}

/// A job for another line, and who has taken it. Each job is checked alone: a system is linearisable if each of its objects is.
struct Job;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum JobState {
    Absent,
    /// How often it was taken.
    Waiting(i32),
    Taken(i32, usize),
    Ended(i32, usize),
}

/// Each with its answer: whether it changed something, or had done so before.
#[derive(Debug, Clone)]
enum JobOperation {
    Offer(Option<bool>),
    Take(i32, usize, Option<bool>),
    End(i32, usize, Option<bool>),
    TakeOver(Option<bool>),
    Read(JobState),
}

impl Specification for Job {
    type State = JobState;
    type Operation = JobOperation;

    fn init() -> Self::State {
        JobState::Absent
    }

    fn apply(operation: &Self::Operation, state: &Self::State) -> (bool, Self::State) {
        use JobState::{Absent, Ended, Taken, Waiting};
        let (answer, changed) = match *operation {
            JobOperation::Read(seen) => return (seen == *state, *state),
            JobOperation::Offer(answer) => (answer, (*state == Absent).then_some(Waiting(0))),
            JobOperation::Take(attempt, station, answer) => {
                (answer, (*state == Waiting(attempt - 1)).then_some(Taken(attempt, station)))
            }
            JobOperation::End(attempt, station, answer) => {
                let is_its = [Taken(attempt, station), Ended(attempt, station)].contains(state);
                (answer, is_its.then_some(Ended(attempt, station)))
            }
            JobOperation::TakeOver(answer) => match *state {
                Taken(attempt, _) => (answer, Some(Waiting(attempt))),
                _ => (answer, None),
            },
        };
        (answer.is_none_or(|answer| answer == changed.is_some()), changed.unwrap_or(*state))
    }
}

/// Several stations, each behind its own network.
struct Plant {
    server: Server,
    proxies: Vec<Proxy>,
}

impl Plant {
    fn new() -> Option<Self> {
        let (server, _desk) = server_with_tables()?;
        for index in 0..STATIONS {
            let name = format!("laser{index}");
            server.login(&name, "station");
            let begin =
                format!("SELECT isomark.beat('{name}', 'p', 'isomark', true, 0, 0, 0, 0, 0, 0, NULL)");
            let output = server.sql_as(&name, SECRET, "isomark", &begin);
            assert!(output.status.success(), "{output:?}");
        }
        let proxies = (0..STATIONS).map(|_| Proxy::to(server.port)).collect();
        Some(Self { server, proxies })
    }

    /// From now on all stations take jobs of this line, and of no other.
    fn serve(&self, line: &str) {
        for index in 0..STATIONS {
            let name = format!("laser{index}");
            let serve = format!("SELECT isomark.serve_lines('{name}', ARRAY['{line}'])");
            let output = self.server.sql_as(&name, SECRET, "isomark", &serve);
            assert!(output.status.success(), "{output:?}");
        }
    }

    /// A connection that nothing disturbs.
    fn direct(&self) -> Connected {
        Connected::to(self.server.port, "laser0", Duration::from_secs(30)).unwrap()
    }

    /// Lets each station do one thing after the other, `None` if its connection ended, while networks are cut and held up and
    /// the server is killed.
    fn runs(
        &self,
        random: &mut Random,
        one_thing: impl Fn(&Connected, usize, &mut Random) -> Option<()> + Sync,
    ) {
        let (ends, done) = (AtomicBool::new(false), AtomicU64::new(0));
        std::thread::scope(|scope| {
            for (index, proxy) in self.proxies.iter().enumerate() {
                let (ends, done, one_thing) = (&ends, &done, &one_thing);
                let mut random = Random(random.below(usize::MAX) as u64);
                scope.spawn(move || {
                    let mut connected = None;
                    while !ends.load(Ordering::SeqCst) {
                        let pause = Duration::from_micros(500 * random.below(12) as u64);
                        std::thread::sleep(pause);
                        let name = format!("laser{index}");
                        connected = connected.or_else(|| Connected::to(proxy.port, &name, PATIENCE));
                        let Some(database) = &connected else { continue };
                        match one_thing(database, index, &mut random) {
                            Some(()) => drop(done.fetch_add(1, Ordering::SeqCst)),
                            None => connected = None,
                        }
                    }
                });
            }
            let works = |count: usize| {
                let until = done.load(Ordering::SeqCst) + count as u64;
                waits_for("the stations", || done.load(Ordering::SeqCst) >= until, String::new);
            };
            for turn in 0..DISTURBANCES {
                works(40 + random.below(80));
                let proxy = &self.proxies[random.below(STATIONS)];
                match (turn, random.below(3)) {
                    (1, _) | (2.., 2) => {
                        self.server.cut();
                        self.server.run();
                    }
                    (0, _) | (_, 0) => proxy.cut(),
                    _ => proxy.hold(),
                }
                std::thread::sleep(Duration::from_millis(random.below(200) as u64));
                proxy.pass();
            }
            works(40);
            ends.store(true, Ordering::SeqCst);
        });
    }
}

fn read_part(database: &Connected, sku: &str) -> Option<(i64, u64)> {
    let rows = database
        .rows("SELECT version, blake3 FROM isomark.current_part WHERE sku = $1", &[(&sku, Type::TEXT)])?;
    Some(rows.first().map_or((0, 0), |row| (row.get(0), part_of(row.get(1)))))
}

fn part_of(hash: &str) -> u64 {
    u64::from_str_radix(&hash[48..], 16).unwrap()
}

#[test]
fn recorded_histories_of_current_parts_are_linearizable() {
    const SKUS: u64 = 2;
    let Some(plant) = Plant::new() else { return };
    let (runs, seed) = (number("ISOMARK_HISTORIES", 2), number("ISOMARK_SEED", 1));
    println!("seed {seed}");
    let mut random = Random(seed);
    let parts = AtomicU64::new(1);
    let (mut learned, mut gave_way, mut read, mut unknown) = (0, 0, 0, 0);
    for run in 0..runs {
        let recorder = Recorder::new();
        plant.runs(&mut random, |database, station, random| {
            let sku = random.below(SKUS as usize) as u64;
            let (key, station) = (format!("part-{run}-{sku}"), format!("laser{station}"));
            let is_read = random.below(3) > 0;
            let part = parts.fetch_add(1, Ordering::SeqCst);
            let called = recorder.now();
            if is_read {
                // One without an answer says nothing.
                let (version, part) = read_part(database, &key)?;
                recorder.note(sku, called, true, PartOperation::Read(version, part));
                return Some(());
            }
            let rows = database.rows(
                "SELECT is_current, version, blake3 FROM isomark.learned($1, $1, 'part.obj', $2, false, $3, 0)",
                &[(&key, Type::TEXT), (&format!("{part:064x}"), Type::TEXT), (&station, Type::TEXT)],
            );
            let answer = rows.map(|rows| (rows[0].get(0), rows[0].get(1), part_of(rows[0].get(2))));
            recorder.note(sku, called, answer.is_some(), PartOperation::Learn(part, answer));
            answer.map(drop)
        });
        let database = plant.direct();
        for sku in 0..SKUS {
            let key = format!("part-{run}-{sku}");
            for _ in 0..2 {
                let called = recorder.now();
                let (version, part) = read_part(&database, &key).unwrap();
                recorder.note(sku, called, true, PartOperation::Read(version, part));
            }
        }
        for (sku, mut operations) in recorder.operations.into_inner().unwrap() {
            for recorded in &operations {
                match recorded.operation {
                    PartOperation::Learn(_, Some((true, ..))) => learned += 1,
                    PartOperation::Learn(_, Some((false, ..))) => gave_way += 1,
                    PartOperation::Learn(_, None) => unknown += 1,
                    PartOperation::Read(..) => read += 1,
                }
            }
            assert!(is_linearizable::<CurrentPart>(&operations), "seed {seed}, run {run}: {operations:#?}");
            // The same history, with a last look at the part before.
            let rows = database
                .rows(
                    "SELECT version, blake3 FROM isomark.part_version WHERE sku = $1 ORDER BY version DESC OFFSET 1 LIMIT 1",
                    &[(&format!("part-{run}-{sku}"), Type::TEXT)],
                )
                .unwrap();
            operations.last_mut().unwrap().operation =
                PartOperation::Read(rows[0].get(0), part_of(rows[0].get(1)));
            assert!(
                !is_linearizable::<CurrentPart>(&operations),
                "seed {seed}, run {run}: an old part is found"
            );
        }
    }
    println!(
        "{runs} runs: {learned} parts fitted, {gave_way} gave way, {unknown} without an answer, {read} reads"
    );
    assert!(learned > 20 && read > 50, "the stations did too little");
}

/// The state that a row gives.
fn read_job(database: &Connected, id: &str) -> Option<JobState> {
    let statement = "SELECT state, attempt, station FROM isomark.job WHERE id = $1";
    let rows = database.rows(statement, &[(&id, Type::TEXT)])?;
    let Some(row) = rows.first() else { return Some(JobState::Absent) };
    let attempt = row.get(1);
    let station = row.get::<_, Option<&str>>(2).map_or(0, |name| name["laser".len()..].parse().unwrap());
    Some(match row.get(0) {
        "waiting" => JobState::Waiting(attempt),
        "taken" => JobState::Taken(attempt, station),
        _ => JobState::Ended(attempt, station),
    })
}

/// What the stations of a run know of its jobs.
struct Jobs<'a> {
    /// The queue of this run: jobs that an earlier one left are not taken.
    line: String,
    first: u64,
    offered: AtomicU64,
    /// Jobs that a station took or ended, also long ago: job, attempt, station.
    claims: Mutex<Vec<(u64, i32, usize)>>,
    recorder: &'a Recorder<JobOperation>,
}

impl Jobs<'_> {
    fn one_thing(&self, database: &Connected, station: usize, random: &mut Random) -> Option<()> {
        let offered = self.offered.load(Ordering::SeqCst);
        let job = self.first + random.below(offered.max(1) as usize) as u64;
        match random.below(10) {
            0 | 1 => {
                // A job is sent by its sender only; one that is offered again changes nothing.
                let is_again = random.below(4) == 0;
                let job =
                    if is_again { job } else { self.first + self.offered.fetch_add(1, Ordering::SeqCst) };
                self.offer(database, station, job)
            }
            2 | 3 => self.take(database, station, random),
            4..=6 => {
                let claim = {
                    let claims = self.claims.lock().unwrap();
                    let its: Vec<_> = claims.iter().filter(|(.., of)| *of == station).collect();
                    (!its.is_empty()).then(|| *its[random.below(its.len())])
                };
                claim.map_or(Some(()), |(job, attempt, _)| self.end(database, station, job, attempt))
            }
            7 => self.take_over(database, job),
            _ => self.read(database, job),
        }
    }

    fn offer(&self, database: &Connected, station: usize, job: u64) -> Option<()> {
        let (hash, drawing) = ("ab".repeat(32), b"x".as_slice());
        let called = self.recorder.now();
        let rows = database.rows(
            "SELECT is_new FROM isomark.offer_job($1, $2, 'a.dxf', $3, $4, $5, NULL, NULL)",
            &[
                (&format!("{job:064x}"), Type::TEXT),
                (&self.line, Type::TEXT),
                (&format!("laser{station}"), Type::TEXT),
                (&hash, Type::TEXT),
                (&drawing, Type::BYTEA),
            ],
        );
        let answer = rows.map(|rows| rows[0].get(0));
        self.recorder.note(job, called, answer.is_some(), JobOperation::Offer(answer));
        answer.map(drop)
    }

    /// As a station does it, in one transaction. That it found nothing is not recorded: it skips jobs that another station is
    /// about to take and may leave.
    fn take(&self, database: &Connected, station: usize, random: &mut Random) -> Option<()> {
        let name = format!("laser{station}");
        let called = self.recorder.now();
        database.batch("BEGIN")?;
        let nothing: &[String] = &[];
        let found = database.rows(
            "SELECT id, attempt FROM isomark.next_job($1, $2)",
            &[(&name, Type::TEXT), (&nothing, Type::TEXT_ARRAY)],
        )?;
        let Some(row) = found.first() else { return database.batch("ROLLBACK") };
        let (id, attempt): (&str, i32) = (row.get(0), row.get(1));
        let job = part_of(id);
        std::thread::sleep(Duration::from_millis(random.below(8) as u64));
        let rows = database.rows(
            "SELECT isomark.take_job($1, $2, $3)",
            &[(&id, Type::TEXT), (&name, Type::TEXT), (&attempt, Type::INT4)],
        )?;
        let is_taken: bool = rows[0].get(0);
        let is_known = database.batch("COMMIT").is_some();
        // Whether or not it is known: a station that asks again ends what is its own.
        self.claims.lock().unwrap().push((job, attempt, station));
        let operation = JobOperation::Take(attempt, station, is_known.then_some(is_taken));
        self.recorder.note(job, called, is_known, operation);
        is_known.then_some(())
    }

    fn end(&self, database: &Connected, station: usize, job: u64, attempt: i32) -> Option<()> {
        let called = self.recorder.now();
        let rows = database.rows(
            "SELECT isomark.end_job($1, $2, $3, 'delivered', NULL)",
            &[
                (&format!("{job:064x}"), Type::TEXT),
                (&format!("laser{station}"), Type::TEXT),
                (&attempt, Type::INT4),
            ],
        );
        let answer = rows.map(|rows| rows[0].get(0));
        self.recorder.note(job, called, answer.is_some(), JobOperation::End(attempt, station, answer));
        answer.map(drop)
    }

    fn take_over(&self, database: &Connected, job: u64) -> Option<()> {
        let called = self.recorder.now();
        let rows = database.rows(
            "SELECT outcome = 'moved' FROM isomark.take_over($1, NULL, true)",
            &[(&format!("{job:064x}"), Type::TEXT)],
        );
        let answer = rows.map(|rows| rows.first().is_some_and(|row| row.get(0)));
        self.recorder.note(job, called, answer.is_some(), JobOperation::TakeOver(answer));
        answer.map(drop)
    }

    fn read(&self, database: &Connected, job: u64) -> Option<()> {
        let called = self.recorder.now();
        let state = read_job(database, &format!("{job:064x}"))?;
        self.recorder.note(job, called, true, JobOperation::Read(state));
        Some(())
    }
}

#[test]
fn recorded_histories_of_jobs_are_linearizable() {
    let Some(plant) = Plant::new() else { return };
    let (runs, seed) = (number("ISOMARK_HISTORIES", 2), number("ISOMARK_SEED", 1));
    println!("seed {seed}");
    let mut random = Random(seed);
    let (mut jobs_of_all, mut taken, mut stale, mut unknown, mut all) = (0, 0, 0, 0, 0);
    for run in 0..runs {
        let recorder = Recorder::new();
        let jobs = Jobs {
            line: format!("cups-{run}"),
            first: (run + 1) << 32,
            offered: AtomicU64::new(0),
            claims: Mutex::default(),
            recorder: &recorder,
        };
        plant.serve(&jobs.line);
        plant.runs(&mut random, |database, station, random| jobs.one_thing(database, station, random));
        let (first, offered) = (jobs.first, jobs.offered.load(Ordering::SeqCst));
        let database = plant.direct();
        for job in first..first + offered {
            jobs.read(&database, job).unwrap();
        }
        for (job, mut operations) in recorder.operations.into_inner().unwrap() {
            let is_taken = |recorded: &&Recorded<JobOperation>| {
                matches!(recorded.operation, JobOperation::Take(_, _, Some(true)))
            };
            jobs_of_all += 1;
            all += operations.len();
            taken += operations.iter().filter(is_taken).count();
            unknown += operations.iter().filter(|recorded| recorded.answered.is_none()).count();
            stale += operations
                .iter()
                .filter(|recorded| matches!(recorded.operation, JobOperation::End(_, _, Some(false))))
                .count();
            assert!(
                is_linearizable::<Job>(&operations),
                "seed {seed}, run {run}, job {job}: {operations:#?}"
            );
            // The same history, with another station that has taken the job in the same attempt.
            let Some(JobOperation::Take(attempt, station, _)) =
                operations.iter().find(is_taken).map(|recorded| recorded.operation.clone())
            else {
                continue;
            };
            let again = JobOperation::Take(attempt, station + 1, Some(true));
            operations.push(Recorded {
                called: u64::MAX - 2,
                answered: Some(u64::MAX - 1),
                operation: again,
            });
            assert!(
                !is_linearizable::<Job>(&operations),
                "seed {seed}, run {run}, job {job}: taken twice is found"
            );
        }
    }
    println!(
        "{runs} runs: {jobs_of_all} jobs, {all} operations, {unknown} of them without an answer, {taken} times taken, {stale} late \
         ends refused"
    );
    assert!(taken > 10, "the stations did too little");
}

/// A history of operations that follow each other, or of which each begins before the one before it has ended.
fn history<T>(operations: Vec<T>, overlap: bool) -> Vec<Recorded<T>> {
    let at = |index: usize| {
        if overlap { (index as u64, 100 + index as u64) } else { (2 * index as u64, 2 * index as u64 + 1) }
    };
    operations
        .into_iter()
        .enumerate()
        .map(|(index, operation)| Recorded { called: at(index).0, answered: Some(at(index).1), operation })
        .collect()
}

#[test]
fn wrong_histories_are_found() {
    use PartOperation::{Learn, Read};
    let parts = |operations, overlap| is_linearizable::<CurrentPart>(&history(operations, overlap));
    let in_order =
        || vec![Learn(7, Some((true, 1, 7))), Read(1, 7), Learn(8, Some((true, 2, 8))), Read(2, 8)];
    assert!(parts(in_order(), false));
    let mut backwards = in_order();
    backwards.push(Read(1, 7));
    assert!(!parts(backwards.clone(), false));
    // At the same time, the old part may still be seen.
    assert!(parts(backwards, true));
    let one_version_for_two = vec![Learn(7, Some((true, 1, 7))), Learn(8, Some((true, 1, 8)))];
    assert!(!parts(one_version_for_two, true));
    // Without an answer it has happened for all or for none.
    let mut lost = history(vec![Learn(7, None), Read(0, 0), Read(1, 7)], false);
    lost[0].answered = None;
    assert!(is_linearizable::<CurrentPart>(&lost));
    lost.push(Recorded { called: 50, answered: Some(51), operation: Read(0, 0) });
    assert!(!is_linearizable::<CurrentPart>(&lost));

    use JobOperation::{End, Offer, Take, TakeOver};
    let jobs = |operations, overlap| is_linearizable::<Job>(&history(operations, overlap));
    let offered = Offer(Some(true));
    assert!(
        !jobs(vec![offered.clone(), Take(1, 0, Some(true)), Take(1, 1, Some(true))], true),
        "taken twice"
    );
    let late = |noted| {
        vec![
            offered.clone(),
            Take(1, 0, Some(true)),
            TakeOver(Some(true)),
            Take(2, 1, Some(true)),
            End(1, 0, Some(noted)),
            JobOperation::Read(JobState::Taken(2, 1)),
        ]
    };
    assert!(jobs(late(false), false));
    assert!(!jobs(late(true), false), "ended by a station that had lost it");
}
