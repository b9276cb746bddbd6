//! Figures of jobs for other lines and of shared fits on this machine; they are printed, and nothing is compared with them.
//!
//! `cargo test --test fleet job_load -- --ignored --nocapture`; a name behind `job_load` for one table, and the variables below
//! for other sizes.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Barrier};
use std::time::{Duration, Instant};

use fs_err as fs;
use isomark::cache::{Cache, CacheKey, Lookup, PartOrigin, SharedSurfaces};
use isomark::fleet::{Member, SkuFiles};
use isomark::geometry::picture_mesh::PictureMesh;
use isomark::hotfolder::line::Inputs;
use tokio_postgres::types::Type;

use crate::client::{Connected, Value};
use crate::kills::{Random, number};
use crate::server::{Server, waits_for};
use crate::station::{Station, in_fleet, line, trough};
use crate::tables::server_with_tables;

const PATIENCE: Duration = Duration::from_secs(60);

/// From sent to taken by the clock of the server, of the jobs that this condition selects.
fn latency(server: &Server, which: &str) -> String {
    server.sql(
        "isomark",
        &format!(
            "SELECT string_agg(round((1000 * p)::numeric, 1)::text, ', ') FROM unnest((SELECT percentile_cont(ARRAY[0.5, 0.99, 1]) \
             WITHIN GROUP (ORDER BY extract(epoch FROM taken - at)::float8) FROM isomark.job WHERE {which})) AS p"
        ),
    )
}

/// A station that does with the database what a real one does for jobs, and neither corrects nor writes files.
struct Simulated {
    database: Connected,
    name: String,
}

impl Simulated {
    fn new(server: &Server, index: u64) -> Self {
        let name = format!("laser{index}");
        let database = Connected::to(server.port, &name, PATIENCE).unwrap();
        let begin = format!(
            "SET search_path = pg_catalog, pg_temp; LISTEN isomark; \
             SELECT isomark.beat('{name}', 'p', 'isomark', true, 0, 0, 0, 0, 0, 0, NULL); \
             SELECT isomark.serve_lines('{name}', ARRAY['{name}'])"
        );
        database.batch(&begin).unwrap();
        Self { database, name }
    }

    fn send(&self, job: u64, line: u64, drawing: &[u8]) {
        let id = blake3::hash(&job.to_le_bytes()).to_hex().to_string();
        let hash = blake3::hash(drawing).to_hex().to_string();
        let rows = self.database.rows(
            "SELECT is_new, inputs_blake3, is_served FROM isomark.offer_job($1, $2, $3, $4, $5, $6, NULL, NULL)",
            &[
                (&id, Type::TEXT),
                (&format!("laser{line}"), Type::TEXT),
                (&format!("sku-{}@{job}.dxf", job % 10_000), Type::TEXT),
                (&self.name, Type::TEXT),
                (&hash, Type::TEXT),
                (&drawing, Type::BYTEA),
            ],
        );
        assert!(rows.unwrap()[0].get::<_, bool>(0));
    }

    /// Takes a job, checks it and ends it; `false` if there is none.
    fn take(&self) -> bool {
        let nothing: &[String] = &[];
        self.database.batch("BEGIN").unwrap();
        let found = self.database.rows(
            "SELECT id, attempt, drawing, inputs_blake3 FROM isomark.next_job($1, $2)",
            &[(&self.name, Type::TEXT), (&nothing, Type::TEXT_ARRAY)],
        );
        let found = found.unwrap();
        let Some(row) = found.first() else {
            self.database.batch("ROLLBACK").unwrap();
            return false;
        };
        let (id, attempt, drawing): (&str, i32, &[u8]) = (row.get(0), row.get(1), row.get(2));
        assert_eq!(blake3::hash(drawing).to_hex().as_str(), row.get::<_, &str>(3));
        let claim: [Value<'_>; 3] = [(&id, Type::TEXT), (&self.name, Type::TEXT), (&attempt, Type::INT4)];
        let taken = self.database.rows("SELECT isomark.take_job($1, $2, $3)", &claim).unwrap();
        self.database.batch("COMMIT").unwrap();
        let ended =
            self.database.rows("SELECT isomark.end_job($1, $2, $3, 'delivered', NULL)", &claim).unwrap();
        assert!(taken[0].get::<_, bool>(0) && ended[0].get::<_, bool>(0));
        true
    }
}

#[test]
#[ignore = "takes minutes, and only prints figures"]
fn figures_of_many_jobs() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let (stations, jobs, skus) =
        (number("ISOMARK_STATIONS", 50), number("ISOMARK_JOBS", 100_000), number("ISOMARK_SKUS", 10_000));
    // The part of the jobs that are sent at a steady rate, in a second.
    let (rate, steady) = (number("ISOMARK_RATE", 50), number("ISOMARK_STEADY", 3_000));
    server.sql(
        "isomark",
        &format!(
            "SELECT count(*) FROM generate_series(1, {skus}) AS n, LATERAL isomark.learned('sku-' || n, 'sku-' || n, 'part.obj', \
             lpad(to_hex(n), 64, '0'), false, 'office', 0)"
        ),
    );
    for index in 0..stations {
        server.login(&format!("laser{index}"), "station");
    }
    let size = || server.sql("postgres", "SELECT pg_size_pretty(pg_database_size('isomark'))");
    println!("database with {skus} SKUs: {}", size());
    let drawing = line(5.0).repeat(8);
    let (next, done) = (AtomicU64::new(0), AtomicU64::new(0));
    let all_there = Barrier::new(stations as usize);
    let all: Vec<Simulated> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..stations)
            .map(|index| {
                let (server, next, done, all_there) = (&server, &next, &done, &all_there);
                let drawing = drawing.as_bytes();
                scope.spawn(move || {
                    let mut station = Simulated::new(server, index);
                    let mut random = Random(index);
                    let own = format!("job {}", station.name);
                    // Nobody misses an announcement, and each sends in its turn.
                    all_there.wait();
                    let mut due = Instant::now() + Duration::from_millis(1000 * index / rate);
                    while done.load(Ordering::SeqCst) < steady {
                        if Instant::now() >= due && next.load(Ordering::SeqCst) < steady {
                            let job = next.fetch_add(1, Ordering::SeqCst);
                            station.send(job, random.below(stations as usize) as u64, drawing);
                            due += Duration::from_millis(1000 * stations / rate);
                        }
                        // Not zero: the connection reads only while somebody waits.
                        let pause = due.saturating_duration_since(Instant::now());
                        let pause = pause.clamp(Duration::from_millis(5), Duration::from_millis(200));
                        if station.database.hears(pause).contains(&own) {
                            while station.take() {
                                done.fetch_add(1, Ordering::SeqCst);
                            }
                        }
                    }
                    station
                })
            })
            .collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    println!(
        "{stations} simulated stations, {} jobs at {rate} a second: from sent to taken p50, p99, max = {} ms",
        done.load(Ordering::SeqCst),
        latency(&server, "true")
    );
    let (first, begun) = (next.load(Ordering::SeqCst), Instant::now());
    let last = server.sql("isomark", "SELECT max(number) FROM isomark.job");
    done.store(first, Ordering::SeqCst);
    std::thread::scope(|scope| {
        for (index, mut station) in all.into_iter().enumerate() {
            let (next, done, drawing) = (&next, &done, drawing.as_bytes());
            scope.spawn(move || {
                let mut random = Random(index as u64 + 1000);
                while done.load(Ordering::SeqCst) < jobs {
                    let job = next.fetch_add(1, Ordering::SeqCst);
                    let is_sent = job < jobs;
                    if is_sent {
                        station.send(job, random.below(stations as usize) as u64, drawing);
                    }
                    let mut has_taken = false;
                    while station.take() {
                        done.fetch_add(1, Ordering::SeqCst);
                        has_taken = true;
                    }
                    if !is_sent && !has_taken {
                        let _ = station.database.hears(Duration::from_millis(50));
                    }
                }
            });
        }
    });
    let seconds = begun.elapsed().as_secs_f64();
    println!(
        "then {} jobs as fast as they go: {seconds:.1} s, {:.0} jobs in a second; from sent to taken p50, p99, max = {} ms",
        jobs - first,
        (jobs - first) as f64 / seconds,
        latency(&server, &format!("number > {last}"))
    );
    let once = "SELECT count(*) FROM isomark.job WHERE outcome = 'delivered' AND attempt = 1";
    assert_eq!(server.sql("isomark", once), jobs.to_string());
    println!("database with {jobs} jobs that have ended: {}", size());
    server.sql("isomark", "VACUUM FULL isomark.job; ");
    server.sql("isomark", "VACUUM FULL isomark.job_inputs");
    println!("the same after VACUUM FULL: {}", size());
}

#[test]
#[ignore = "takes minutes, and only prints figures"]
fn figures_of_an_idle_fleet() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let (count, jobs) = (number("ISOMARK_STATIONS", 20), number("ISOMARK_JOBS", 500));
    let mut stations: Vec<Station> = (0..count)
        .map(|index| {
            let name = format!("laser{index}");
            server.login(&name, "station");
            let station = Station::new(&name, &in_fleet(&server.url(&name)));
            // As it is by default: one listing in 5 s.
            let file = station.path("station.toml");
            let text = fs::read_to_string(&file).unwrap().replace("rescan_s = 1\n", "");
            fs::write(&file, text).unwrap();
            station
        })
        .collect();
    for station in &mut stations {
        station.start();
        station.waits_for_fleet(1);
    }
    stations[0].drop_in("trough.obj", &trough(1.0));
    stations[0].waits_for("the part", |station| station.logged("is now the part of") == 1);
    server.login("sender", "station");
    let sender = Connected::to(server.port, "sender", PATIENCE).unwrap();
    sender.batch("SELECT isomark.beat('sender', 'p', 'isomark', true, 0, 0, 0, 0, 0, 0, NULL)").unwrap();
    let sender = Simulated { database: sender, name: "sender".into() };
    std::thread::sleep(Duration::from_secs(5));
    let mut random = Random(1);
    for job in 0..jobs {
        send_real(&sender, job, random.below(count as usize) as u64);
        std::thread::sleep(Duration::from_millis(100));
    }
    let ended = || server.sql("isomark", "SELECT count(*) FROM isomark.job WHERE outcome = 'delivered'");
    waits_for("all jobs", || ended() == jobs.to_string(), ended);
    println!(
        "{count} stations, {jobs} jobs at 10 a second: from sent to taken p50, p99, max = {} ms",
        latency(&server, "true")
    );
    println!(
        "from sent to the end of delivered jobs p50, p99, max = {} ms",
        server.sql(
            "isomark",
            "SELECT string_agg(round((1000 * p)::numeric, 1)::text, ', ') FROM unnest((SELECT percentile_cont(ARRAY[0.5, 0.99, 1]) \
             WITHIN GROUP (ORDER BY extract(epoch FROM ended - at)::float8) FROM isomark.job)) AS p"
        )
    );
}

/// Sends a job that a real station can do.
fn send_real(sender: &Simulated, job: u64, at: u64) {
    let drawing = line(5.0 + job as f64 * 1e-3);
    let inputs = Inputs { drawing: drawing.into_bytes(), settings: None, list: None };
    let hash = inputs.hash();
    let id = blake3::hash(&job.to_le_bytes()).to_hex().to_string();
    let rows = sender.database.rows(
        "SELECT is_new FROM isomark.offer_job($1, $2, $3, 'sender', $4, $5, NULL, NULL)",
        &[
            (&id, Type::TEXT),
            (&format!("laser{at}"), Type::TEXT),
            (&format!("trough@{job}.dxf"), Type::TEXT),
            (&hash, Type::TEXT),
            (&inputs.drawing, Type::BYTEA),
        ],
    );
    assert!(rows.unwrap()[0].get::<_, bool>(0));
}

/// A mesh for pictures of so many by so many vertices.
fn large_mesh(points: u32) -> PictureMesh {
    let all = || (0..points).flat_map(|row| (0..points).map(move |column| [column as f32, row as f32, 0.0]));
    let cells = (1..points).flat_map(|row| (1..points).map(move |column| (row * points + column, points)));
    let triangles = cells.flat_map(|(at, points)| {
        let below = at - points;
        [[below - 1, below, at], [below - 1, at, at - 1]]
    });
    let normals = all().map(|_| [0.0, 0.0, 1.0]);
    PictureMesh::new(all().collect(), normals.collect(), triangles.collect(), 1).unwrap()
}

#[test]
#[ignore = "only prints figures"]
fn figures_of_a_large_fit() {
    let Some((server, _desk)) = server_with_tables() else { return };
    let (points, times) = (number("ISOMARK_POINTS", 400) as u32, number("ISOMARK_TIMES", 40));
    for name in ["laser1", "laser2"] {
        server.login(name, "station");
    }
    let one = Station::of("laser1", &server.url("laser1"));
    one.waits_for_fleet(1);
    one.drop_in("trough.obj", &trough(1.0));
    one.waits_for("the part", |one| one.logged("is now the part of") == 1);
    let there = || server.sql("isomark", "SELECT key || ' ' || part FROM isomark.fit");
    waits_for("the fit", || !there().is_empty(), || one.log());
    let row = there();
    let fields: Vec<&str> = row.split(' ').collect();
    // No part makes so large a fit: its mesh for pictures is replaced by a larger one.
    let key: CacheKey = serde_json::from_value(fields[0].into()).unwrap();
    let sku = "trough".parse().unwrap();
    let Ok(Lookup::Hit(kept)) = Cache::new(one.path("cache")).get(&sku, &key) else { panic!("no surface") };
    let larger = Cache::new(one.path("larger"));
    larger.keep(&sku, &key, &kept, Some(&large_mesh(points))).unwrap();
    let mesh = larger.bytes(&sku, &key).unwrap().unwrap().mesh.unwrap();
    let owner = Connected::to(server.port, "owner", PATIENCE).unwrap();
    let hash = blake3::hash(&mesh).as_bytes().to_vec();
    let change = "UPDATE isomark.fit SET mesh = $1, mesh_blake3 = $2";
    owner.rows(change, &[(&mesh, Type::BYTEA), (&hash, Type::BYTEA)]).unwrap();
    println!("a fit of {} bytes", server.sql("isomark", "SELECT bytes FROM isomark.fit"));
    // The part of another station in the fleet, in this process.
    let two = Station::new("laser2", &in_fleet(&server.url("laser2")));
    let settings = isomark::config::Station::load(&two.path("station.toml")).unwrap();
    let fleet = settings.fleet.clone().unwrap();
    let files = Arc::new(SkuFiles::new(&fleet, &settings));
    let member = Arc::new(Member::new(fleet, &settings.folders, files));
    let _running = member.start();
    let part: PartOrigin =
        serde_json::from_value(serde_json::json!({ "file": "trough.obj", "blake3": fields[1] })).unwrap();
    let cache = Cache::new(two.path("cache"));
    waits_for("the connection", || member.fetch(&cache, &sku, &key, &part), String::new);
    let mut all: Vec<f64> = (0..times)
        .map(|_| {
            fs::remove_dir_all(two.path("cache")).unwrap();
            let started = Instant::now();
            assert!(member.fetch(&cache, &sku, &key, &part));
            1e3 * started.elapsed().as_secs_f64()
        })
        .collect();
    all.sort_by(f64::total_cmp);
    println!(
        "fetched, checked and kept in the cache: median {:.1} ms, at most {:.1} ms ({times} times)",
        all[all.len() / 2],
        all[all.len() - 1]
    );
}

/// What a process has used: memory in MB, threads, processor time in ms.
#[cfg(target_os = "linux")]
fn used(process: u32) -> (f64, u64, u64) {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap();
    let field = |name: &str| -> u64 {
        let line = status.lines().find(|line| line.starts_with(name)).unwrap();
        line.split_whitespace().nth(1).unwrap().parse().unwrap()
    };
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
    let times: Vec<u64> = stat
        .rsplit(')')
        .next()
        .unwrap()
        .split_whitespace()
        .skip(11)
        .take(2)
        .map(|time| time.parse().unwrap())
        .collect();
    // In hundredths of a second.
    (field("VmRSS:") as f64 / 1024.0, field("Threads:"), 10 * (times[0] + times[1]))
}

#[cfg(target_os = "linux")]
#[test]
#[ignore = "takes a minute, and only prints figures"]
fn figures_of_a_station_without_a_fleet() {
    let Some((server, _desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    let mut alone = Station::new("alone", "");
    alone.start();
    let member = Station::of("laser1", &server.url("laser1"));
    member.waits_for_fleet(1);
    std::thread::sleep(Duration::from_secs(10));
    for (what, station) in [("without a fleet", &alone), ("in a fleet", &member)] {
        let before = used(station.process());
        std::thread::sleep(Duration::from_secs(30));
        let after = used(station.process());
        let sockets = fs::read_dir(format!("/proc/{}/fd", station.process())).unwrap();
        let sockets = sockets
            .filter(|file| {
                let target = fs::read_link(file.as_ref().unwrap().path()).unwrap_or_default();
                target.to_string_lossy().starts_with("socket:")
            })
            .count();
        println!(
            "an idle station {what}: {:.1} MB of memory, {} threads, {sockets} sockets, {} ms of processor time in 30 s",
            after.0,
            after.1,
            after.2 - before.2
        );
    }
}
