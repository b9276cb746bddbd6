//! Workers without a laser: they fit heavy parts for stations, which take back what is late and do it themselves.

use std::collections::BTreeMap;
use std::process::{Child, Command, Stdio};

use fs_err as fs;
use serde_json::Value;

use crate::desk::Desk;
use crate::kills::{Random, number};
use crate::proxy::Proxy;
use crate::server::{SECRET, Server, waits_for};
use crate::station::{Station, in_fleet, line, trough};
use crate::tables::{fleet, server_with_tables};

/// A scan of a shallow trough, rows and columns of points with noise of 0.03 mm; each `seed` gives another one.
fn scan(side: usize, seed: u64) -> String {
    let mut random = Random(seed);
    let mut text = String::new();
    for row in 0..side {
        for column in 0..side {
            let [x, y] = [column, row].map(|index| -20.0 + 40.0 * index as f64 / (side - 1) as f64);
            let noise = (random.below(6001) as f64 - 3000.0) * 1e-5;
            text += &format!("{x:.4} {y:.4} {:.5}\n", x * x / 400.0 + noise);
        }
    }
    text
}

/// A scan that takes long enough to be interrupted.
fn long_scan(seed: u64) -> String {
    scan(250, seed)
}

/// A mesh that is heavy by its size only: the same trough with a long comment.
fn heavy_mesh() -> String {
    format!("# {}\n{}", "x".repeat(4 << 20), trough(1.0))
}

/// A process that runs `isomark work`.
struct Worker {
    desk: Desk,
    running: Option<Child>,
    url: String,
    name: String,
}

impl Worker {
    fn of(name: &str, url: &str) -> Self {
        let desk = Desk::new();
        desk.write("password.txt", format!("{SECRET}\n"));
        let mut worker = Self { desk, running: None, url: url.into(), name: name.into() };
        worker.start();
        worker
    }

    fn start(&mut self) {
        let log = fs::OpenOptions::new().create(true).append(true).open(self.desk.path("log.txt")).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_isomark"))
            .args(["work", &self.url, "--name", &self.name, "--password-file", "password.txt"])
            .current_dir(self.desk.root())
            .env_remove("RUST_LOG")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log.into_parts().0)
            .spawn();
        self.running = Some(child.unwrap());
    }

    fn id(&self) -> u32 {
        self.running.as_ref().unwrap().id()
    }

    #[cfg(unix)]
    fn signal(&self, signal: &str) {
        let status = Command::new("kill").args([signal, &self.id().to_string()]).status().unwrap();
        assert!(status.success());
    }

    fn kill(&mut self) {
        let mut child = self.running.take().unwrap();
        child.kill().unwrap();
        child.wait().unwrap();
    }

    fn log(&self) -> String {
        fs::read_to_string(self.desk.path("log.txt")).unwrap_or_default()
    }

    fn logged(&self, words: &str) -> usize {
        self.log().lines().filter(|line| line.contains(words)).count()
    }

    #[track_caller]
    fn waits_for(&self, words: &str) {
        waits_for(words, || self.logged(words) > 0, || self.log());
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        if let Some(mut child) = self.running.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
        if !std::thread::panicking() {
            let log = self.log();
            assert!(!log.contains(SECRET) && !log.contains("panicked"), "{log}");
        }
    }
}

fn with_workers(url: &str) -> String {
    in_fleet(url) + "workers = true\n"
}

/// A server with a running station that asks workers.
fn one_station() -> Option<(Server, Desk, Station)> {
    let (server, desk) = server_with_tables()?;
    server.login("laser1", "station");
    server.login("cellar", "worker");
    let page = "[page]\naddress = \"127.0.0.1:0\"\n";
    let mut station = Station::new("laser1", &(with_workers(&server.url("laser1")) + page));
    station.start();
    station.waits_for_fleet(1);
    Some((server, desk, station))
}

fn worker(server: &Server, name: &str) -> Worker {
    let worker = Worker::of(name, &server.url("cellar"));
    worker.waits_for("fits parts for the fleet");
    worker
}

/// The drawing that a station without a fleet delivers for this part.
fn drawing_alone(part: &str, content: &str) -> Vec<u8> {
    let mut alone = Station::new("alone", "");
    alone.start();
    deliver(&alone, part, content);
    fs::read(alone.path("import/trough.dxf")).unwrap()
}

fn drop_both(station: &Station, part: &str, content: &str) {
    station.drop_in(part, content);
    station.drop_in("trough.dxf", &line(9.0));
}

#[track_caller]
fn deliver(station: &Station, part: &str, content: &str) {
    drop_both(station, part, content);
    station.waits_for_file("import/trough.dxf");
}

/// The station has delivered what a station without a fleet delivers.
#[track_caller]
fn is_right(station: &Station, part: &str, content: &str) {
    station.waits_for_file("import/trough.dxf");
    let delivered = fs::read(station.path("import/trough.dxf")).unwrap();
    assert!(delivered == drawing_alone(part, content), "{}", station.log());
}

fn requests(server: &Server) -> String {
    server.sql(
        "isomark",
        "SELECT state, worker, attempt, left(reason, 200) FROM isomark.fit_request ORDER BY number",
    )
}

#[track_caller]
fn waits_for_state(server: &Server, state: &str, station: &Station) {
    let has_state = || requests(server).contains(state);
    waits_for(state, has_state, || format!("{}\n{}", requests(server), station.log()));
}

/// Who has made the fits of the fleet.
fn makers(server: &Server) -> String {
    server.sql("isomark", "SELECT string_agg(station, ' ' ORDER BY station) FROM isomark.fit")
}

fn status(server: &Server, desk: &Desk) -> Value {
    let output = fleet(desk, &["status", &server.url("owner"), "--json"]);
    assert_eq!(output.code, 0, "{}", output.err);
    serde_json::from_str(&output.out).unwrap()
}

#[test]
fn scans_and_heavy_meshes_are_fitted_by_a_worker_as_the_station_would() {
    let Some((server, desk, station)) = one_station() else { return };
    let worker = worker(&server, "cellar 1");
    for (part, content, made) in [("trough.xyz", scan(60, 1), 1), ("trough.obj", heavy_mesh(), 2)] {
        let _ = fs::remove_file(station.path("import/trough.dxf"));
        station.drop_in(part, &content);
        station.waits_for("the fit", |station| station.logged("a worker of the fleet fitted") == made);
        station.waits_for("the part", |station| station.logged("is now the part of SKU `trough`") == made);
        station.drop_in("trough.dxf", &line(9.0));
        is_right(&station, part, &content);
    }
    assert_eq!(makers(&server), "cellar 1 cellar 1");
    waits_for("no request", || requests(&server).is_empty(), || requests(&server));
    // A small mesh is fitted here.
    station.drop_in("trough.obj", &trough(1.5));
    station.waits_for("the part", |station| station.logged("is now the part of SKU `trough`") == 3);
    assert_eq!(worker.logged("fitted the part of trough"), 2, "{}", worker.log());
    let is_seen = || status(&server, &desk)["workers"][0]["made"] == 2;
    waits_for("the worker in the status", is_seen, || status(&server, &desk).to_string());
    let workers = status(&server, &desk)["workers"].clone();
    assert!(workers[0]["name"] == "cellar 1" && workers[0]["alive"] == true, "{workers}");
    let words = fleet(&desk, &["status", &server.url("owner")]).out;
    assert!(words.contains("cellar 1: alive; 2 made, 0 failed"), "{words}");
    // The station sees it, too, for its page.
    station.waits_for("the worker in its status", |station| {
        let worker = station.status()["fleet"]["workers"][0].clone();
        worker["name"] == "cellar 1" && worker["made"] == 2
    });
    let check = fleet(&desk, &["check", &server.url("cellar")]);
    assert!(check.code == 0 && check.out.contains("isomark_worker"), "{check:?}");
}

#[test]
fn without_a_worker_or_with_one_of_another_version_the_station_asks_nobody() {
    let Some((server, _desk, station)) = one_station() else { return };
    server.sql_as(
        "cellar",
        SECRET,
        "isomark",
        "SELECT isomark.beat_of_worker('p', 'other', 'isomark 9', 'isomark 9 with fits of version 99', true, 0, 0)",
    );
    deliver(&station, "trough.xyz", &scan(60, 1));
    assert_eq!(server.sql("isomark", "SELECT is_called FROM isomark.fit_attempt"), "f");
    assert_eq!(station.logged("worker"), 0, "{}", station.log());
}

#[test]
fn a_station_whose_settings_do_not_ask_for_workers_fits_itself() {
    let Some((server, _desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    server.login("cellar", "worker");
    let worker = worker(&server, "cellar");
    let station = Station::of("laser1", &server.url("laser1"));
    station.waits_for_fleet(1);
    deliver(&station, "trough.xyz", &scan(60, 1));
    assert_eq!(worker.logged("fits the part"), 0, "{}", worker.log());
}

#[test]
fn stations_that_need_the_same_fit_wait_for_one_request() {
    let Some((server, _desk, one)) = one_station() else { return };
    server.login("laser2", "station");
    let mut two = Station::new("laser2", &with_workers(&server.url("laser2")));
    two.start();
    two.waits_for_fleet(1);
    let worker = worker(&server, "cellar");
    let scan = long_scan(2);
    drop_both(&one, "trough.xyz", &scan);
    waits_for_state(&server, "taken", &one);
    drop_both(&two, "trough.xyz", &scan);
    let both = || server.sql("isomark", "SELECT count(*) FROM isomark.fit_asker") == "2";
    waits_for("two stations that wait", both, || worker.log());
    for station in [&one, &two] {
        station.waits_for_file("import/trough.dxf");
        assert_eq!(station.logged("a worker of the fleet fitted"), 1, "{}", station.log());
    }
    let drawing = |station: &Station| fs::read(station.path("import/trough.dxf")).unwrap();
    assert!(drawing(&one) == drawing(&two));
    assert_eq!(worker.logged("fits the part of trough"), 1, "{}", worker.log());
    waits_for("no request", || requests(&server).is_empty(), || requests(&server));
}

#[test]
fn a_killed_worker_is_late_and_the_station_fits_the_part() {
    let Some((server, _desk, station)) = one_station() else { return };
    let mut worker = worker(&server, "cellar");
    let scan = long_scan(3);
    drop_both(&station, "trough.xyz", &scan);
    waits_for_state(&server, "taken", &station);
    worker.kill();
    is_right(&station, "trough.xyz", &scan);
    assert_eq!(station.logged("is late: it is fitted here"), 1, "{}", station.log());
    waits_for("the fit", || makers(&server) == "laser1", || makers(&server));
    assert_eq!(requests(&server), "");
}

#[cfg(unix)]
#[test]
fn a_stopped_worker_that_goes_on_late_changes_nothing() {
    let Some((server, _desk, station)) = one_station() else { return };
    let worker = worker(&server, "cellar");
    let scan = long_scan(4);
    drop_both(&station, "trough.xyz", &scan);
    waits_for_state(&server, "taken", &station);
    worker.signal("-STOP");
    is_right(&station, "trough.xyz", &scan);
    waits_for("the fit", || makers(&server) == "laser1", || makers(&server));
    // The fleet loses the fit, and a station waits for it again: the number of the late attempt is not used twice.
    let key = server.sql("isomark", "DELETE FROM isomark.fit RETURNING key");
    let attempt = server.sql("isomark", "SELECT last_value FROM isomark.fit_attempt");
    let again = format!(
        "SELECT isomark.ask_for_fit('{key}', 'laser1', 'another version', 'trough', repeat('a', 64), 'x', repeat('b', 64))"
    );
    assert!(server.sql_as("laser1", SECRET, "isomark", &again).status.success());
    worker.signal("-CONT");
    worker.waits_for("its fit is not used");
    assert_eq!(worker.logged("fitted the part"), 0, "{}", worker.log());
    assert_eq!(server.sql("isomark", "SELECT count(*) FROM isomark.fit"), "0");
    let state = server.sql("isomark", &format!("SELECT state, attempt > {attempt} FROM isomark.fit_request"));
    assert_eq!(state, "waiting|t");
}

#[cfg(unix)]
#[test]
fn a_worker_that_is_ended_gives_its_request_to_the_next_one() {
    let Some((server, desk, station)) = one_station() else { return };
    let mut first = worker(&server, "first");
    let scan = long_scan(5);
    drop_both(&station, "trough.xyz", &scan);
    waits_for_state(&server, "taken", &station);
    let second = worker(&server, "second");
    first.signal("-TERM");
    assert!(first.running.take().unwrap().wait().unwrap().success(), "{}", first.log());
    assert_eq!(first.logged("gave the part of trough back"), 1, "{}", first.log());
    is_right(&station, "trough.xyz", &scan);
    assert_eq!(makers(&server), "second", "{}{}", second.log(), station.log());
    let workers = status(&server, &desk)["workers"].clone();
    assert_eq!(workers.as_array().unwrap().len(), 1, "{workers}");
}

#[test]
fn with_the_database_stopped_in_the_middle_the_station_fits_the_part() {
    let Some((server, _desk, station)) = one_station() else { return };
    let worker = worker(&server, "cellar");
    let scan = long_scan(6);
    drop_both(&station, "trough.xyz", &scan);
    waits_for_state(&server, "taken", &station);
    server.cut();
    is_right(&station, "trough.xyz", &scan);
    server.run();
    station.waits_for_fleet(2);
    waits_for("the worker again", || worker.logged("fits parts for the fleet") == 2, || worker.log());
    waits_for("the fit", || !makers(&server).is_empty(), || station.log());
    // What the station asked for before is left, and both work together again.
    waits_for("no request", || requests(&server).is_empty(), || requests(&server));
    station.drop_in("trough.xyz", &scan_of_another_part());
    station.waits_for("the worker", |station| station.logged("a worker of the fleet fitted") == 1);
}

fn scan_of_another_part() -> String {
    scan(60, 77)
}

/// Nothing answers, and nothing is closed.
#[test]
fn with_a_network_that_hangs_in_the_middle_the_station_fits_the_part() {
    let Some((server, _desk)) = server_with_tables() else { return };
    server.login("laser1", "station");
    server.login("cellar", "worker");
    let proxy = Proxy::to(server.port);
    let mut station = Station::new("laser1", &with_workers(&proxy.url("laser1")));
    station.start();
    station.waits_for_fleet(1);
    let _worker = worker(&server, "cellar");
    let scan = long_scan(7);
    drop_both(&station, "trough.xyz", &scan);
    waits_for_state(&server, "taken", &station);
    proxy.hold();
    is_right(&station, "trough.xyz", &scan);
    proxy.pass();
}

#[cfg(unix)]
#[test]
fn a_worker_ends_also_while_the_server_hangs() {
    let Some((server, _desk, _station)) = one_station() else { return };
    let proxy = Proxy::to(server.port);
    let mut worker = Worker::of("cellar", &proxy.url("cellar"));
    worker.waits_for("fits parts for the fleet");
    proxy.hold();
    worker.signal("-TERM");
    let mut child = worker.running.take().unwrap();
    waits_for("its end", || child.try_wait().unwrap().is_some(), || worker.log());
    assert!(child.wait().unwrap().success(), "{}", worker.log());
}

/// A program with the rights of a worker takes the request and answers with something else.
#[test]
fn a_wrong_answer_is_reported_once_and_the_station_fits_the_part() {
    let Some((server, _desk, station)) = one_station() else { return };
    let real = worker(&server, "real");
    let maker = server.sql("isomark", "SELECT maker FROM isomark.worker");
    drop(real);
    let hostile = |text: &str| {
        let output = server.sql_as("cellar", SECRET, "isomark", text);
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).unwrap().trim().to_owned()
    };
    hostile(&format!("SELECT isomark.beat_of_worker('p', 'hostile', 'isomark', '{maker}', true, 0, 0)"));
    server.sql("isomark", "DELETE FROM isomark.worker WHERE process <> 'p'");
    let scan = scan(60, 8);
    drop_both(&station, "trough.xyz", &scan);
    waits_for_state(&server, "waiting", &station);
    hostile(
        "WITH taken AS (SELECT * FROM isomark.take_request('p')), ended AS (SELECT t.*, isomark.end_request(key, 'p', attempt, NULL) \
         FROM taken t) INSERT INTO isomark.fit (key, sku, part, body, body_blake3, station) \
         SELECT key, sku, part, 'x', decode(repeat('00', 32), 'hex'), 'hostile' FROM ended",
    );
    is_right(&station, "trough.xyz", &scan);
    assert_eq!(station.logged("its content does not match its hash"), 1, "{}", station.log());
    assert_eq!(station.logged("a worker of the fleet fitted"), 0, "{}", station.log());
}

/// All are values that a hostile or broken program could write.
#[test]
fn a_worker_refuses_wrong_requests_and_goes_on() {
    let Some((server, _desk, station)) = one_station() else { return };
    for constraint in ["task", "sku"] {
        let name = format!("fit_request_{constraint}_check");
        server.sql("isomark", &format!("ALTER TABLE isomark.fit_request DROP CONSTRAINT {name}"));
    }
    let worker = worker(&server, "cellar");
    let maker = server.sql("isomark", "SELECT maker FROM isomark.worker");
    let hash = |bytes: &[u8]| blake3::hash(bytes).to_hex().to_string();
    let of_x = hash(b"x");
    let rows: [(&str, &str, &str, &str, &str, &str); 6] = [
        ("1", &maker, "a", "'x'", &hash(b"y"), "its content does not match its hash"),
        ("2", &maker, "a", "'x'", &of_x, "it is truncated"),
        ("3", &maker, "../../a", "'x'", &of_x, "its SKU is not a name"),
        ("4", &maker, "a", "NULL", &of_x, "it is missing"),
        ("5", &maker, "a", "convert_to(repeat('x', 400000000), 'LATIN1')", &of_x, "larger than"),
        ("6", "isomark 9 with fits of version 99", "a", "'x'", &of_x, "waiting"),
    ];
    for (key, maker, sku, task, task_hash, _) in &rows {
        server.sql(
            "isomark",
            &format!(
                "INSERT INTO isomark.fit_request (key, maker, sku, part, task, task_blake3, attempt) VALUES \
                 (repeat('{key}', 32), '{maker}', '{sku}', repeat('a', 64), {task}, '{task_hash}', nextval('isomark.fit_attempt'))"
            ),
        );
    }
    server
        .sql("isomark", "SELECT pg_notify('isomark_work', repeat('x', 7000)), pg_notify('isomark_work', '')");
    for (key, _, _, _, _, words) in &rows {
        let state = || {
            let state =
                format!("SELECT state, reason FROM isomark.fit_request WHERE key = repeat('{key}', 32)");
            server.sql("isomark", &state)
        };
        waits_for(words, || state().contains(words), || format!("{}{}", state(), worker.log()));
    }
    // It did not read the large one into its memory.
    if let Ok(memory) = fs::read_to_string(format!("/proc/{}/status", worker.id())) {
        let peak = memory.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
        let peak: u64 = peak.trim().trim_end_matches(" kB").parse().unwrap();
        assert!(peak < 300_000, "{peak} kB");
    }
    // A part that is not the one of the row, under a key that is not its own.
    let scan = scan(60, 9);
    drop_both(&station, "trough.xyz", &scan);
    station.waits_for("the worker", |station| station.logged("a worker of the fleet fitted") == 1);
    is_right(&station, "trough.xyz", &scan);
}

/// What a part that cannot be fitted is rejected with does not depend on workers.
#[test]
fn a_part_that_a_worker_cannot_fit_is_rejected_by_the_station_with_its_reason() {
    let Some((server, desk, station)) = one_station() else { return };
    let worker = worker(&server, "cellar");
    let flat = "0 0 0\n1 0 0\n2 0 0\n0 1 0\n";
    station.drop_in("trough.xyz", flat);
    station.waits_for("the rejection", |station| station.status()["done"]["rejected"] == 1);
    worker.waits_for("cannot be fitted");
    assert_eq!(station.logged("a worker could not fit the part"), 1, "{}", station.log());
    let mut alone = Station::new("alone", "");
    alone.start();
    alone.drop_in("trough.xyz", flat);
    alone.waits_for("the rejection", |alone| alone.status()["done"]["rejected"] == 1);
    let reason = |station: &Station| station.status()["rejections"][0]["reason"].clone();
    assert!(!reason(&alone).is_null());
    assert_eq!(reason(&station), reason(&alone));
    let failed = || status(&server, &desk)["workers"][0]["failed"] == 1;
    waits_for("the worker in the status", failed, || status(&server, &desk).to_string());
}

#[test]
fn roles_have_only_their_rights_on_requests() {
    let Some((server, desk)) = server_with_tables() else { return };
    let roles = ["station", "worker", "office", "viewer"];
    for role in roles {
        server.login(&format!("the_{role}"), role);
    }
    server.sql_as(
        "the_station",
        SECRET,
        "isomark",
        "SELECT isomark.beat('the_station', 'p', 'isomark', true, 0, 0, 0, 0, 0, 0, NULL)",
    );
    let beat = "SELECT isomark.beat_of_worker('p', 'w', 'isomark', 'm', true, 0, 0)";
    server.sql_as("the_worker", SECRET, "isomark", beat);
    let key = "a".repeat(32);
    let ask = format!(
        "SELECT isomark.ask_for_fit('{key}', 'the_station', 'm', 's', repeat('a', 64), 'x', repeat('b', 64))"
    );
    let rights: &[(&str, &[&str])] = &[
        (beat, &["worker"]),
        (&format!("SELECT isomark.join_fit('{key}', 'the_station', 'm')"), &["station"]),
        (&ask, &["station"]),
        ("SELECT * FROM isomark.take_request('p')", &["worker"]),
        (&format!("SELECT isomark.keep_request('{key}', 'p', 1)"), &["worker"]),
        (&format!("SELECT isomark.return_request('{key}', 'p', 1)"), &["worker"]),
        (&format!("SELECT isomark.end_request('{key}', 'p', 1, 'x')"), &["worker"]),
        ("SELECT task FROM isomark.fit_request", &["worker"]),
        ("SELECT key, state, attempt FROM isomark.fit_request", &roles),
        ("SELECT * FROM isomark.worker", &roles),
        ("SELECT * FROM isomark.fit_asker", &roles),
        (&format!("SELECT isomark.leave_fit('{key}', 'the_station')"), &["station"]),
        ("UPDATE isomark.fit_request SET state = 'made'", &[]),
        ("DELETE FROM isomark.fit_request", &[]),
        ("INSERT INTO isomark.fit_asker VALUES ('a', 'b')", &[]),
        ("DELETE FROM isomark.worker", &[]),
        ("SELECT nextval('isomark.fit_attempt')", &[]),
        ("SELECT isomark.check_worker('p')", &[]),
    ];
    for (statement, may) in rights {
        for role in roles {
            let output = server.sql_as(&format!("the_{role}"), SECRET, "isomark", statement);
            let wrong = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.success(), may.contains(&role), "{role}: {statement}: {wrong}");
        }
    }
    for role in roles {
        let status = fleet(&desk, &["status", &server.url(&format!("the_{role}"))]);
        assert!(status.code == 0 && status.out.contains("  w: alive"), "{role}: {status:?}");
    }
    // A worker belongs to its login, and so does a station.
    server.login("another", "worker");
    let output = server.sql_as("another", SECRET, "isomark", "SELECT * FROM isomark.take_request('p')");
    assert!(String::from_utf8_lossy(&output.stderr).contains("does not belong to the login"), "{output:?}");
    server.login("laser2", "station");
    let output = server.sql_as("laser2", SECRET, "isomark", &ask);
    assert!(String::from_utf8_lossy(&output.stderr).contains("does not belong to the login"), "{output:?}");
}

/// Workers, the station and the server are killed at random while scans and their drawings are dropped; afterwards each drawing was
/// delivered once, with the bytes of a station alone, and no request is left.
///
/// `ISOMARK_KILLS=200 ISOMARK_SEED=7 cargo test --test fleet killed_workers -- --nocapture` kills as often as given.
#[test]
fn killed_workers_stations_and_servers_deliver_each_drawing_once_and_right() {
    let Some((server, _desk, mut station)) = one_station() else { return };
    let (kills, seed) = (number("ISOMARK_KILLS", 8), number("ISOMARK_SEED", 1));
    println!("seed {seed}");
    let mut random = Random(seed);
    let proxy = Proxy::to(server.port);
    let mut workers = [0, 1].map(|index| Worker::of(&format!("worker{index}"), &proxy.url("cellar")));
    let mut alone = Station::new("alone", "");
    alone.start();
    let mut counts = [0; 4];
    let mut delivered: BTreeMap<String, usize> = BTreeMap::new();
    let mut skus = Vec::new();
    for kill in 0..kills {
        // Few scans wait at a time, because each wait has a limit.
        waits_for(
            "the drawings before",
            || {
                collect(&station, &alone, &mut delivered);
                skus.len() < delivered.len() + 3
            },
            || format!("{}\n{}", requests(&server), station.log()),
        );
        let sku = format!("s{kill}");
        let content = scan(60 + random.below(100), seed.wrapping_mul(1000) + kill);
        for place in [&station, &alone] {
            place.drop_in(&format!("{sku}.xyz"), &content);
            place.drop_in(&format!("{sku}.dxf"), &line(9.0));
        }
        skus.push(sku);
        // Between any two steps: after a random number of looks at files.
        for _ in 0..random.below(20_000) {
            let _ = fs::read_dir(station.path("state"));
            std::thread::yield_now();
        }
        let victim = random.below(2);
        match random.below(8) {
            0..=3 => {
                counts[0] += 1;
                workers[victim].kill();
                workers[victim].start();
            }
            4 | 5 => {
                counts[1] += 1;
                station.kill();
                station.start();
            }
            6 => {
                counts[2] += 1;
                server.cut();
                server.run();
            }
            _ => {
                counts[3] += 1;
                proxy.cut();
            }
        }
        if kill % 2 == 1 {
            proxy.pass();
        }
        collect(&station, &alone, &mut delivered);
    }
    proxy.pass();
    let state = || format!("{}\n{}", requests(&server), station.log());
    waits_for(
        "all drawings",
        || {
            collect(&station, &alone, &mut delivered);
            delivered.len() == skus.len()
        },
        state,
    );
    waits_for("an empty hot folder", || fs::read_dir(station.path("hot")).unwrap().next().is_none(), state);
    collect(&station, &alone, &mut delivered);
    assert!(delivered.values().all(|times| *times == 1), "{delivered:?}");
    waits_for("no request", || requests(&server).is_empty(), state);
    let by_workers = station.logged("a worker of the fleet fitted");
    let [killed, stations, servers, cuts] = counts;
    println!(
        "{} scans, {by_workers} fitted by workers; {killed} workers, {stations} stations, {servers} servers killed, {cuts} cuts",
        skus.len()
    );
}

/// Takes the drawings that both have delivered, as an importer does, and compares them.
fn collect(station: &Station, alone: &Station, delivered: &mut BTreeMap<String, usize>) {
    for file in fs::read_dir(station.path("import")).unwrap() {
        let name = file.unwrap().file_name().into_string().unwrap();
        let of_both = [station, alone].map(|place| place.path("import").join(&name));
        if name.starts_with('.') || !of_both[1].exists() {
            continue;
        }
        let [ours, theirs] = of_both.each_ref().map(|path| fs::read(path).unwrap());
        assert!(ours == theirs, "{name}: {}", station.log());
        fs::remove_file(&of_both[0]).unwrap();
        *delivered.entry(name).or_default() += 1;
    }
}
