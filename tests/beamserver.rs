//! The program delivers to a stand-in for BeamServer with the protocol of the OpenAPC manual (7.10): one ASCII command
//! per line, answered by a value, by `OK` or by `ERROR a b`; one client at a time; imported elements named after their
//! files; sizes in 1/10000 mm. It reads the imported drawings with its own code.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may fail loudly, its helpers too")]

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use fs_err as fs;

mod schemas;

/// A shallow trough.
const PART: &str =
    "v -20 -20 1\nv 0 -20 0\nv 20 -20 1\nv -20 20 1\nv 0 20 0\nv 20 20 1\nf 1 2 5 4\nf 2 3 6 5\n";
/// All commands that isomark may send; none of them starts or prepares marking.
const HARMLESS: [&str; 7] =
    ["CmdListName", "CmdListUID", "CmdImport", "CmdSelEntName", "CmdGetSizeX", "CmdGetSizeY", "CmdDeleteEnt"];

/// A drawing with a line of this length, mm, on one side of the trough, where nothing is bent.
fn drawing(length: f64) -> String {
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n0\nLINE\n8\nMARK\n\
         10\n5\n20\n0\n11\n5\n21\n{length}\n0\nLINE\n8\nMARK\n10\n5\n20\n0\n11\n9\n21\n0\n0\nENDSEC\n0\nEOF\n"
    )
}

/// A fault of the next command with a certain name.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    /// The command is refused.
    Error(u8, u8),
    /// The command is done, and then the connection ends without an answer.
    HangUp,
    /// The command is done, and the answer is delayed.
    Slow(Duration),
    /// The command is done, and this is the answer.
    Answers(&'static str),
    /// The answer never ends: one letter is sent every tenth of a second.
    Drips,
}

struct Element {
    id: u32,
    name: String,
    size: [f64; 2],
}

#[derive(Default)]
struct Project {
    elements: Vec<Element>,
    count: u32,
    selected: Option<usize>,
    received: Vec<String>,
    faults: Vec<(&'static str, Fault)>,
    /// The scale of the importer.
    scale: f64,
    /// The separator before the file name in the name of an imported element.
    separator: &'static str,
    /// Whether `OK` is sent before a value.
    answers_ok: bool,
    /// Whether every command is refused.
    refuses: bool,
}

impl Project {
    fn answer(&mut self, command: &str) -> String {
        let (verb, argument) = command.split_once(' ').unwrap_or((command, ""));
        let value = |text: String, answers_ok: bool| if answers_ok { format!("OK {text}") } else { text };
        let indexed = || argument.parse::<usize>().ok();
        let error = |first: u8| format!("ERROR {first} 0");
        let selected = |project: &Self, axis: usize| {
            let element = project.selected.and_then(|index| project.elements.get(index));
            element.map(|element| format!("{:.0}", element.size[axis] * 1e4))
        };
        match verb {
            "CmdListName" | "CmdListUID" => match indexed().and_then(|index| self.elements.get(index)) {
                Some(element) if verb == "CmdListName" => value(element.name.clone(), self.answers_ok),
                Some(element) => value(element.id.to_string(), self.answers_ok),
                None => error(7),
            },
            "CmdImport" => {
                let path = PathBuf::from(argument);
                let Ok(text) = fs::read_to_string(&path) else { return error(19) };
                self.count += 1;
                let name = format!("{}{}", self.separator, path.file_name().unwrap().to_str().unwrap());
                let size = extents(&text).map(|side| side * self.scale);
                self.elements.push(Element { id: 100 + self.count, name, size });
                "OK".into()
            }
            "CmdSelEntName" => {
                let named =
                    |element: &Element| format!("\\{}", element.name.trim_start_matches('\\')) == argument;
                self.selected = self.elements.iter().position(named);
                if self.selected.is_some() { "OK".into() } else { error(7) }
            }
            "CmdGetSizeX" => selected(self, 0).map_or(error(7), |size| value(size, self.answers_ok)),
            "CmdGetSizeY" => selected(self, 1).map_or(error(7), |size| value(size, self.answers_ok)),
            "CmdDeleteEnt" => {
                let before = self.elements.len();
                self.elements.retain(|element| element.id.to_string() != argument);
                self.selected = None;
                if self.elements.len() < before { "OK".into() } else { error(7) }
            }
            _ => error(16),
        }
    }
}

/// Width and height of the drawing's entities, read pair by pair.
fn extents(dxf: &str) -> [f64; 2] {
    let entities = dxf.split_once("ENTITIES").unwrap().1;
    let lines: Vec<&str> = entities.lines().skip(1).map(str::trim).collect();
    let side = |code: &str| {
        let values = lines.chunks_exact(2).filter(|pair| pair[0] == code).map(|pair| pair[1].parse::<f64>());
        let values: Vec<f64> = values.map(Result::unwrap).collect();
        let end = |pick: fn(f64, f64) -> f64| values.iter().copied().reduce(pick).unwrap();
        end(f64::max) - end(f64::min)
    };
    [side("10"), side("20")]
}

/// A server that runs until the test ends.
struct BeamServer {
    address: SocketAddr,
    project: Arc<Mutex<Project>>,
}

impl BeamServer {
    fn start() -> Self {
        Self::listen(TcpListener::bind("127.0.0.1:0").unwrap())
    }

    fn listen(listener: TcpListener) -> Self {
        let address = listener.local_addr().unwrap();
        let project = Arc::new(Mutex::new(Project { scale: 1.0, separator: "\\", ..Project::default() }));
        let shared = project.clone();
        // It serves one client at a time; others are connected but get no answer.
        std::thread::spawn(move || listener.incoming().flatten().for_each(|client| serve(&client, &shared)));
        Self { address, project }
    }

    fn project(&self) -> MutexGuard<'_, Project> {
        self.project.lock().unwrap()
    }

    fn holds(&self) -> Vec<String> {
        self.project().elements.iter().map(|element| element.name.clone()).collect()
    }

    fn received(&self, verb: &str) -> usize {
        self.project().received.iter().filter(|command| command.starts_with(verb)).count()
    }
}

impl Drop for BeamServer {
    fn drop(&mut self) {
        for command in &self.project().received {
            let verb = command.split(' ').next().unwrap();
            assert!(HARMLESS.contains(&verb) || std::thread::panicking(), "isomark sent {command}");
        }
    }
}

fn serve(client: &TcpStream, project: &Mutex<Project>) {
    let mut lines = BufReader::new(client).lines();
    while let Some(Ok(command)) = lines.next() {
        let verb = command.split(' ').next().unwrap().to_owned();
        let mut project = project.lock().unwrap();
        project.received.push(command.clone());
        let fault = project.faults.iter().position(|(name, _)| *name == verb);
        let fault = fault.map(|index| project.faults.remove(index).1);
        let answer = match fault {
            Some(Fault::Error(first, second)) => format!("ERROR {first} {second}"),
            _ if project.refuses => "ERROR 11 0".into(),
            Some(Fault::Answers(text)) => {
                project.answer(&command);
                text.into()
            }
            _ => project.answer(&command),
        };
        drop(project);
        match fault {
            Some(Fault::HangUp) => return,
            Some(Fault::Slow(pause)) => std::thread::sleep(pause),
            _ => {}
        }
        let mut client = client;
        if fault == Some(Fault::Drips) {
            while client.write_all(b"O").is_ok() {
                std::thread::sleep(Duration::from_millis(100));
            }
            return;
        }
        // The names that operators give to elements are sent in Latin-1.
        let bytes: Vec<u8> = format!("{answer}\n").chars().map(|letter| letter as u8).collect();
        if client.write_all(&bytes).is_err() {
            return;
        }
    }
}

struct Station {
    folder: tempfile::TempDir,
    program: Option<Child>,
}

impl Station {
    fn new(address: SocketAddr) -> Self {
        let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        for name in ["hot", "import", "elsewhere"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        let settings = format!(
            "[station]\nname = \"test\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 100\n\
             height_mm = 100\n[watch]\nsettle_ms = 30\nopen_ended_s = 0\nrescan_s = 0.2\n[delivery]\nkind = \"beamserver\"\n\
             address = \"{address}\"\nanswer_s = 0.5\n"
        );
        fs::write(folder.path().join("station.toml"), settings).unwrap();
        Self { folder, program: None }
    }

    fn path(&self, relative: &str) -> PathBuf {
        self.folder.path().join(relative)
    }

    /// Changes the station's settings.
    fn set(&self, old: &str, new: &str) {
        let path = self.path("station.toml");
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(old));
        fs::write(path, text.replace(old, new)).unwrap();
    }

    /// Sets the rotation of the drawings for the part.
    fn turn(&self, degrees: u32) {
        fs::create_dir_all(self.path("skus")).unwrap();
        fs::write(self.path("skus/trough.toml"), format!("[placement]\nrotate_deg = {degrees}\n")).unwrap();
    }

    fn imported(&self) -> String {
        fs::read_to_string(self.path("import/trough.dxf")).unwrap()
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_isomark"));
        command.current_dir(self.folder.path()).args(arguments).stdin(Stdio::null());
        command
    }

    fn start(&mut self) {
        let log = fs::OpenOptions::new().create(true).append(true).open(self.path("log.txt")).unwrap();
        let mut command = self.command(&["watch", "station.toml"]);
        self.program = Some(command.stdout(Stdio::null()).stderr(log.into_parts().0).spawn().unwrap());
    }

    fn kill(&mut self) {
        if let Some(mut program) = self.program.take() {
            let _ = program.kill();
            let _ = program.wait();
        }
    }

    /// Processes the hot folder once; returns everything that was printed.
    fn once(&self) -> String {
        let output = self.command(&["watch", "station.toml", "--once"]).output().unwrap();
        String::from_utf8(output.stdout).unwrap() + &String::from_utf8(output.stderr).unwrap()
    }

    fn drop(&self, name: &str, text: &str) {
        fs::write(self.path("elsewhere/file"), text).unwrap();
        fs::rename(self.path("elsewhere/file"), self.path("hot").join(name)).unwrap();
    }

    fn log(&self) -> String {
        fs::read_to_string(self.path("log.txt")).unwrap_or_default()
    }

    fn waits_for(&self, what: &str, condition: impl Fn() -> bool) {
        let started = Instant::now();
        while !condition() {
            assert!(started.elapsed() < Duration::from_secs(30), "{what}: {}", self.log());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn waits_until_filed(&self, name: &str) {
        let (hot, archived) = (self.path("hot").join(name), self.path("archive/trough").join(name));
        self.waits_for("the original in the archive", || archived.exists() && !hot.exists());
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        self.kill();
        schemas::check_below(self.folder.path());
    }
}

#[test]
fn a_drawing_is_imported_verified_and_replaces_the_older_one() {
    for (separator, answers_ok) in [("\\", false), ("\\", true), ("", false)] {
        let server = BeamServer::start();
        {
            let mut project = server.project();
            (project.separator, project.answers_ok) = (separator, answers_ok);
            project.elements.push(Element { id: 3, name: "\\Fläche".into(), size: [90.0, 90.0] });
        }
        let station = Station::new(server.address);
        station.drop("trough.obj", PART);
        station.drop("trough@a  b.dxf", &drawing(9.0));
        let output = station.once();
        assert!(
            output.starts_with("1 delivered") && output.contains("imported into BeamConstruct, "),
            "{output}"
        );
        assert_eq!(server.holds(), ["\\Fläche".to_owned(), format!("{separator}trough@a  b.dxf")]);
        assert!((server.project().elements[1].size[1] - 9.0).abs() < 1e-3);
        assert!(station.path("import/trough@a  b.dxf").exists());
        // Another version replaces it; the same drawing again is not imported.
        station.drop("trough@a  b.dxf", &drawing(7.0));
        let output = station.once();
        assert!(output.contains("replacing the older one, size checked: "), "{output}");
        assert_eq!(server.holds().len(), 2);
        assert!((server.project().elements[1].size[1] - 7.0).abs() < 1e-3);
        station.drop("trough@a  b.dxf", &drawing(7.0));
        let output = station.once();
        assert!(output.contains("already delivered"), "{output}");
        // The second version was imported as a trial before the first one was removed.
        assert_eq!(server.received("CmdImport"), 3);
    }
}

#[test]
fn a_drawing_that_is_not_imported_in_true_size_is_removed() {
    let server = BeamServer::start();
    server.project().scale = 25.4;
    let station = Station::new(server.address);
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    let output = station.once();
    assert!(output.contains("1 rejected"), "{output}");
    let reason = fs::read_to_string(station.path("rejected/trough.dxf.reason.txt")).unwrap();
    assert!(reason.contains("unit mm, no scaling"), "{reason}");
    assert_eq!((server.holds().len(), fs::read_dir(station.path("import")).unwrap().count()), (0, 0));
}

/// Further attempts would only create more copies.
#[test]
fn an_element_with_an_unexpected_name_is_not_imported_twice() {
    let server = BeamServer::start();
    server.project().separator = "dxf-import-of-";
    let station = Station::new(server.address);
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    assert!(station.once().contains("1 rejected"));
    assert!(station.once().starts_with("0 delivered"));
    assert_eq!((server.received("CmdImport"), server.holds().len()), (1, 1));
}

#[test]
fn an_unreliable_server_gets_each_drawing_once() {
    // A port on which no server listens until later.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    let mut station = Station::new(address);
    station.start();
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    station.waits_for("a warning", || station.log().contains("cannot be reached"));
    let status = || station.command(&["status", "station.toml", "--json"]).output().unwrap().stdout;
    station.waits_for("a status", || String::from_utf8(status()).unwrap().contains("beamserver-unreachable"));
    let server = BeamServer::listen(TcpListener::bind(address).unwrap());
    station.waits_until_filed("trough.dxf");
    for (number, fault) in [
        ("CmdImport", Fault::Error(11, 0)),
        ("CmdImport", Fault::Error(19, 2)),
        ("CmdImport", Fault::HangUp),
        ("CmdImport", Fault::Slow(Duration::from_millis(700))),
        ("CmdListName", Fault::HangUp),
        ("CmdGetSizeY", Fault::HangUp),
        ("CmdGetSizeX", Fault::Slow(Duration::from_millis(200))),
    ]
    .into_iter()
    .enumerate()
    {
        server.project().faults.push(fault);
        let name = format!("trough@{number}.dxf");
        station.drop(&name, &drawing(5.0 + number as f64 / 2.0));
        station.waits_until_filed(&name);
        assert!(server.project().faults.is_empty());
        assert_eq!(server.holds().iter().filter(|held| held.ends_with(&name)).count(), 1, "{name}");
    }
    assert_eq!(server.holds().len(), 8);
}

#[test]
fn the_station_waits_for_another_client() {
    let server = BeamServer::start();
    let mut other = TcpStream::connect(server.address).unwrap();
    other.write_all(b"CmdListName 0\n").unwrap();
    BufReader::new(&other).read_line(&mut String::new()).unwrap();
    let mut station = Station::new(server.address);
    station.start();
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    station
        .waits_for("a warning", || station.log().contains("close other programs that are connected to it"));
    assert!(station.log().contains("did not answer `CmdListName 0`: nothing arrived within 0.5 s"));
    assert_eq!(server.holds().len(), 0);
    drop(other);
    station.waits_until_filed("trough.dxf");
    assert_eq!(server.holds().len(), 1);
}

/// The time limit is for the complete answer.
#[test]
fn a_server_that_sends_single_letters_does_not_block_a_drawing() {
    let server = BeamServer::start();
    server.project().faults.push(("CmdListName", Fault::Drips));
    let mut station = Station::new(server.address);
    station.start();
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    station.waits_for("a warning", || {
        station.log().contains("did not answer `CmdListName 0`: no complete line arrived within 0.5 s")
    });
    station.waits_until_filed("trough.dxf");
    assert_eq!(server.holds().len(), 1);
}

/// The drawing stays in the import folder, and the next start imports it.
#[cfg(unix)]
#[test]
fn a_stopping_station_does_not_wait_for_a_silent_server() {
    for fault in [Fault::Drips, Fault::Slow(Duration::from_secs(3600))] {
        let server = BeamServer::start();
        server.project().faults.push(("CmdImport", fault));
        let mut station = Station::new(server.address);
        station.set("answer_s = 0.5", "answer_s = 3600");
        station.start();
        station.drop("trough.obj", PART);
        station.drop("trough.dxf", &drawing(9.0));
        station.waits_for("the command", || server.received("CmdImport") == 1);
        let program = station.program.as_mut().unwrap();
        let status = Command::new("kill").args(["-TERM", &program.id().to_string()]).status().unwrap();
        assert!(status.success());
        let started = Instant::now();
        while program.try_wait().unwrap().is_none() {
            assert!(started.elapsed() < Duration::from_secs(30), "it does not stop");
            std::thread::sleep(Duration::from_millis(5));
        }
        assert!(station.path("import/trough.dxf").exists() && station.path("hot/trough.dxf").exists());
        // The server that sends single letters works again when its client disconnects; the other one never does.
        if fault == Fault::Drips {
            station.start();
            station.waits_until_filed("trough.dxf");
            assert_eq!(server.holds(), ["\\trough.dxf"]);
        }
    }
}

#[test]
fn a_drawing_waits_while_the_server_sends_invalid_answers() {
    let server = BeamServer::start();
    let mut station = Station::new(server.address);
    station.start();
    station.drop("trough.obj", PART);
    for (number, (verb, answer)) in [
        ("CmdListName", "\u{1}\u{2}\u{3}"),
        ("CmdListName", "ERROR banana"),
        ("CmdImport", "banana"),
        ("CmdListUID", ""),
        ("CmdListUID", "no number at all"),
        ("CmdSelEntName", "12"),
        ("CmdGetSizeX", "NaN"),
        ("CmdGetSizeX", "-90000"),
        ("CmdGetSizeY", "inf"),
        ("CmdGetSizeY", "HTTP/1.1 400 Bad Request"),
    ]
    .into_iter()
    .enumerate()
    {
        server.project().faults.push((verb, Fault::Answers(answer)));
        let name = format!("trough@{number}.dxf");
        station.drop(&name, &drawing(5.0 + number as f64 / 2.0));
        station.waits_until_filed(&name);
        assert!(server.project().faults.is_empty());
        assert_eq!(server.holds().iter().filter(|held| held.ends_with(&name)).count(), 1, "{name}");
    }
    assert!(station.log().contains("waits: BeamServer answered"), "{}", station.log());
    assert_eq!(fs::read_dir(station.path("rejected")).unwrap().count(), 0);
}

/// An element of unknown size must not be marked.
#[test]
fn a_drawing_that_was_not_verified_leaves_no_element() {
    for fault in [Fault::Answers("NaN"), Fault::Error(11, 0), Fault::Slow(Duration::from_secs(1))] {
        let server = BeamServer::start();
        let mut station = Station::new(server.address);
        server.project().faults.push(("CmdGetSizeX", fault));
        station.start();
        station.drop("trough.obj", PART);
        station.drop("trough.dxf", &drawing(9.0));
        station.waits_until_filed("trough.dxf");
        // It was removed and imported again later, as a new element.
        assert_eq!((server.holds(), server.received("CmdImport")), (vec!["\\trough.dxf".to_owned()], 2));
        assert_eq!(server.received("CmdDeleteEnt"), 1, "{}", station.log());
    }
}

#[cfg(unix)]
#[test]
fn a_stopping_station_leaves_no_unverified_element() {
    let server = BeamServer::start();
    server.project().faults.push(("CmdGetSizeX", Fault::Slow(Duration::from_secs(3))));
    let mut station = Station::new(server.address);
    station.set("answer_s = 0.5", "answer_s = 3600");
    station.start();
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    station.waits_for("the command", || server.received("CmdGetSizeX") == 1);
    let program = station.program.as_mut().unwrap();
    let status = Command::new("kill").args(["-TERM", &program.id().to_string()]).status().unwrap();
    assert!(status.success() && program.wait().is_ok());
    station.waits_for("the removal", || server.holds().is_empty());
    assert!(station.path("hot/trough.dxf").exists());
}

/// Another kind of server may listen at the address.
#[test]
fn a_wrong_server_does_not_reject_the_drawing() {
    for answers in
        [|_: &str| "banana\n".to_owned(), |received: &str| received.to_owned(), |_: &str| "OK\n".into()]
    {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let station = Station::new(listener.local_addr().unwrap());
        std::thread::spawn(move || {
            for client in listener.incoming().flatten() {
                let (mut received, mut writer) = (BufReader::new(&client), &client);
                let mut line = String::new();
                while received.read_line(&mut line).is_ok_and(|read| read > 0) {
                    if writer.write_all(answers(&line).as_bytes()).is_err() {
                        break;
                    }
                    line.clear();
                }
            }
        });
        station.drop("trough.obj", PART);
        station.drop("trough.dxf", &drawing(9.0));
        let output = station.once();
        assert!(output.contains("0 rejected, 1 waiting") && output.contains("BeamServer"), "{output}");
        assert!(station.path("hot/trough.dxf").exists());
    }
}

/// A drawing that was delivered with `kind = "folder"`, or belongs to an older project, is not in BeamConstruct, even
/// if it is in `import`.
#[test]
fn the_same_drawing_is_imported_again_if_it_is_missing() {
    for repeat in ["if-gone", "never"] {
        let server = BeamServer::start();
        let station = Station::new(server.address);
        station.set("kind = \"beamserver\"", &format!("kind = \"folder\"\nrepeat = \"{repeat}\""));
        station.drop("trough.obj", PART);
        let drops = |imports: usize| {
            station.drop("trough.dxf", &drawing(9.0));
            let output = station.once();
            assert_eq!(
                (server.received("CmdImport"), server.holds().len()),
                (imports, imports.min(1)),
                "{output}"
            );
        };
        drops(0);
        station.set("kind = \"folder\"", "kind = \"beamserver\"");
        drops(1);
        drops(1);
        if repeat != "never" {
            server.project().elements.clear();
            drops(2);
        }
    }
}

#[test]
fn a_drawing_with_a_wrong_size_does_not_replace_the_older_one() {
    let server = BeamServer::start();
    let station = Station::new(server.address);
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    station.once();
    let first = station.imported();
    server.project().scale = 25.4;
    station.drop("trough.dxf", &drawing(7.0));
    let output = station.once();
    assert!(output.contains("1 rejected"), "{output}");
    let reason = fs::read_to_string(station.path("rejected/trough.dxf.reason.txt")).unwrap();
    assert!(reason.contains("BeamConstruct imported trough.dxf with a size of "), "{reason}");
    assert_eq!(server.holds(), ["\\trough.dxf"]);
    assert_eq!(server.project().elements[0].id, 101);
    assert_eq!(fs::read_dir(station.path("import")).unwrap().count(), 1);
    assert_eq!(station.imported(), first);
    // The station knows that the older one is delivered.
    station.drop("trough.dxf", &drawing(9.0));
    let output = station.once();
    assert!(
        output.contains("is unchanged in import") && output.contains("is already in BeamConstruct"),
        "{output}"
    );
    assert_eq!(server.project().elements[0].id, 101);
}

#[test]
fn a_silent_server_delays_one_drawing_and_no_part() {
    let server = BeamServer::start();
    let mut station = Station::new(server.address);
    station.set("answer_s = 0.5", "answer_s = 90");
    station.set("[watch]", "[watch]\njobs = 2");
    server.project().faults.push(("CmdListName", Fault::Slow(Duration::from_secs(90))));
    station.start();
    for sku in ["trough", "gutter"] {
        station.drop(&format!("{sku}.obj"), PART);
        station.drop(&format!("{sku}.dxf"), &drawing(9.0));
    }
    let both = || ["trough", "gutter"].iter().all(|sku| station.path(&format!("import/{sku}.dxf")).exists());
    station.waits_for("both drawings in the import folder", both);
    station.drop("tub.obj", PART);
    station.waits_for("a part", || station.path("archive/tub/tub.obj").exists());
    station.waits_for("the other drawing to wait", || {
        station.log().contains("BeamServer is busy with another drawing")
    });
    assert_eq!(server.received("CmdListName"), 1);
}

/// BeamServer may be unavailable for a long time while drawings are corrected again, and the station may be restarted
/// meanwhile.
#[test]
fn a_drawing_that_is_corrected_again_waits_for_the_server() {
    for (restarts, scale) in [(false, 1.0), (true, 1.0), (true, 25.4)] {
        let server = BeamServer::start();
        let mut station = Station::new(server.address);
        station.set("kind = \"beamserver\"", "kind = \"beamserver\"\noutdated = \"correct\"");
        station.start();
        station.drop("trough.obj", PART);
        station.drop("trough.dxf", &drawing(9.0));
        station.waits_until_filed("trough.dxf");
        let first = station.imported();
        server.project().refuses = true;
        station.turn(90);
        station.waits_for("the other drawing", || station.imported() != first);
        station.waits_for("a warning", || {
            station.log().contains("cannot correct trough.dxf of trough again yet")
        });
        // A request to retry ends the pause.
        let received = server.project().received.len();
        station.command(&["retry", "station.toml"]).output().unwrap();
        station.waits_for("another try", || server.project().received.len() > received);
        if restarts {
            station.kill();
        }
        {
            let mut project = server.project();
            (project.refuses, project.scale) = (false, scale);
        }
        if restarts {
            station.start();
        } else {
            station.command(&["retry", "station.toml"]).output().unwrap();
        }
        if scale != 1.0 {
            station.waits_for("a refusal", || station.log().contains("cannot be corrected again"));
            assert_eq!((server.holds().len(), server.project().elements[0].id), (1, 101));
            assert_eq!(station.imported(), first);
            // It is still outdated, and the next start tries again.
            station.kill();
            server.project().scale = 1.0;
            station.start();
        }
        station.waits_for("the new drawing in BeamConstruct", || {
            let project = server.project();
            project.elements.len() == 1 && project.elements[0].id != 101
        });
        let [expected, found] = [extents(&station.imported()), server.project().elements[0].size];
        assert!(station.imported() != first && expected == found, "{expected:?} {found:?}");
    }
}

/// If the station is killed at any moment between import and archive, BeamConstruct contains the drawing once in the
/// end.
#[test]
fn a_station_killed_around_the_import_continues() {
    let server = BeamServer::start();
    let mut station = Station::new(server.address);
    station.drop("trough.obj", PART);
    for (number, verb) in ["CmdListName", "CmdImport", "CmdSelEntName", "CmdGetSizeY"].into_iter().enumerate()
    {
        let name = format!("trough@{number}.dxf");
        let received = server.received(verb);
        server.project().faults.push((verb, Fault::Slow(Duration::from_millis(300))));
        station.start();
        station.drop(&name, &drawing(9.0));
        station.waits_for(verb, || server.received(verb) > received);
        station.kill();
        if verb == "CmdImport" {
            // Removing the drawing by hand only causes another delivery.
            fs::remove_file(station.path("import").join(&name)).unwrap();
        }
        station.start();
        station.waits_until_filed(&name);
        station.kill();
        assert_eq!(server.holds().iter().filter(|held| held.ends_with(&name)).count(), 1, "{name}");
    }
}
