//! The program delivers to a stand-in for BeamServer, which speaks the protocol as the OpenAPC manual (7.10) documents it:
//! one ASCII command a line, answered by a value, by `OK` or by `ERROR a b`, one client at a time, an imported element
//! named after its file, sizes in 1/10000 mm. It reads the drawings it imports by itself.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may fail loudly, its helpers too")]

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use fs_err as fs;

/// A shallow trough.
const PART: &str =
    "v -20 -20 1\nv 0 -20 0\nv 20 -20 1\nv -20 20 1\nv 0 20 0\nv 20 20 1\nf 1 2 5 4\nf 2 3 6 5\n";
/// All that isomark may ask; whatever starts or prepares marking is not among it.
const HARMLESS: [&str; 7] =
    ["CmdListName", "CmdListUID", "CmdImport", "CmdSelEntName", "CmdGetSizeX", "CmdGetSizeY", "CmdDeleteEnt"];

/// A drawing with a line of this length, mm, at the trough's edge, where nothing is bent.
fn drawing(length: f64) -> String {
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n0\nLINE\n8\nMARK\n\
         10\n5\n20\n0\n11\n5\n21\n{length}\n0\nLINE\n8\nMARK\n10\n5\n20\n0\n11\n9\n21\n0\n0\nENDSEC\n0\nEOF\n"
    )
}

/// What goes wrong with the next command of this name.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    /// It is refused.
    Error(u8, u8),
    /// It is done, and then the connection ends without an answer.
    HangUp,
    /// It is done, and the answer takes its time.
    Slow(Duration),
    /// It is done, and this is answered.
    Says(&'static str),
    /// The answer never ends: a letter comes each tenth of a second.
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
    heard: Vec<String>,
    faults: Vec<(&'static str, Fault)>,
    /// How large the importer draws.
    scale: f64,
    /// How imported elements are named: separator and file name.
    separator: &'static str,
    /// Whether values follow an `OK`.
    says_ok: bool,
    /// Whether it refuses everything.
    refuses: bool,
}

impl Project {
    fn answer(&mut self, command: &str) -> String {
        let (verb, argument) = command.split_once(' ').unwrap_or((command, ""));
        let value = |text: String, says_ok: bool| if says_ok { format!("OK {text}") } else { text };
        let indexed = || argument.parse::<usize>().ok();
        let error = |first: u8| format!("ERROR {first} 0");
        let selected = |project: &Self, axis: usize| {
            let element = project.selected.and_then(|index| project.elements.get(index));
            element.map(|element| format!("{:.0}", element.size[axis] * 1e4))
        };
        match verb {
            "CmdListName" | "CmdListUID" => match indexed().and_then(|index| self.elements.get(index)) {
                Some(element) if verb == "CmdListName" => value(element.name.clone(), self.says_ok),
                Some(element) => value(element.id.to_string(), self.says_ok),
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
            "CmdGetSizeX" => selected(self, 0).map_or(error(7), |size| value(size, self.says_ok)),
            "CmdGetSizeY" => selected(self, 1).map_or(error(7), |size| value(size, self.says_ok)),
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

/// Width and height of what lies in the drawing's entities, read pair by pair.
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
        // One client after the other: whoever connects meanwhile is not answered.
        std::thread::spawn(move || listener.incoming().flatten().for_each(|client| serve(&client, &shared)));
        Self { address, project }
    }

    fn project(&self) -> MutexGuard<'_, Project> {
        self.project.lock().unwrap()
    }

    fn holds(&self) -> Vec<String> {
        self.project().elements.iter().map(|element| element.name.clone()).collect()
    }

    fn heard(&self, verb: &str) -> usize {
        self.project().heard.iter().filter(|command| command.starts_with(verb)).count()
    }
}

impl Drop for BeamServer {
    fn drop(&mut self) {
        for command in &self.project().heard {
            let verb = command.split(' ').next().unwrap();
            assert!(HARMLESS.contains(&verb) || std::thread::panicking(), "isomark said {command}");
        }
    }
}

fn serve(client: &TcpStream, project: &Mutex<Project>) {
    let mut lines = BufReader::new(client).lines();
    while let Some(Ok(command)) = lines.next() {
        let verb = command.split(' ').next().unwrap().to_owned();
        let mut project = project.lock().unwrap();
        project.heard.push(command.clone());
        let fault = project.faults.iter().position(|(name, _)| *name == verb);
        let fault = fault.map(|index| project.faults.remove(index).1);
        let answer = match fault {
            Some(Fault::Error(first, second)) => format!("ERROR {first} {second}"),
            _ if project.refuses => "ERROR 11 0".into(),
            Some(Fault::Says(words)) => {
                project.answer(&command);
                words.into()
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
        // It speaks Latin-1, as far as it speaks of what operators have named.
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

    /// Turns the drawings of the part.
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

    /// Handles what lies there; what it said to people.
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
    }
}

#[test]
fn a_drawing_is_imported_verified_and_replaces_the_older_one() {
    for (separator, says_ok) in [("\\", false), ("\\", true), ("", false)] {
        let server = BeamServer::start();
        {
            let mut project = server.project();
            (project.separator, project.says_ok) = (separator, says_ok);
            project.elements.push(Element { id: 3, name: "\\Fläche".into(), size: [90.0, 90.0] });
        }
        let station = Station::new(server.address);
        station.drop("trough.obj", PART);
        station.drop("trough@a  b.dxf", &drawing(9.0));
        let said = station.once();
        assert!(said.starts_with("1 delivered") && said.contains("imported into BeamConstruct, "), "{said}");
        assert_eq!(server.holds(), ["\\Fläche".to_owned(), format!("{separator}trough@a  b.dxf")]);
        assert!((server.project().elements[1].size[1] - 9.0).abs() < 1e-3);
        assert!(station.path("import/trough@a  b.dxf").exists());
        // Another version replaces it; the same again is nothing new.
        station.drop("trough@a  b.dxf", &drawing(7.0));
        let said = station.once();
        assert!(said.contains("in place of the older one, "), "{said}");
        assert_eq!(server.holds().len(), 2);
        assert!((server.project().elements[1].size[1] - 7.0).abs() < 1e-3);
        station.drop("trough@a  b.dxf", &drawing(7.0));
        let said = station.once();
        assert!(said.contains("already delivered"), "{said}");
        // The second one was tried before the first one went.
        assert_eq!(server.heard("CmdImport"), 3);
    }
}

#[test]
fn a_drawing_that_is_not_drawn_in_true_size_is_taken_back() {
    let server = BeamServer::start();
    server.project().scale = 25.4;
    let station = Station::new(server.address);
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    let said = station.once();
    assert!(said.contains("1 rejected"), "{said}");
    let reason = fs::read_to_string(station.path("rejected/trough.dxf.reason.txt")).unwrap();
    assert!(reason.contains("unit mm, no scaling"), "{reason}");
    assert_eq!((server.holds().len(), fs::read_dir(station.path("import")).unwrap().count()), (0, 0));
}

/// Tried again and again, such an import would pile up copies.
#[test]
fn an_element_of_another_name_is_not_imported_twice() {
    let server = BeamServer::start();
    server.project().separator = "dxf-import-of-";
    let station = Station::new(server.address);
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    assert!(station.once().contains("1 rejected"));
    assert!(station.once().starts_with("0 delivered"));
    assert_eq!((server.heard("CmdImport"), server.holds().len()), (1, 1));
}

#[test]
fn a_server_that_comes_late_refuses_is_slow_or_hangs_up_gets_each_drawing_once() {
    // A port that nobody listens on until later.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    let mut station = Station::new(address);
    station.start();
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    station.waits_for("a complaint", || station.log().contains("cannot be reached"));
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
fn another_client_is_waited_for() {
    let server = BeamServer::start();
    let mut other = TcpStream::connect(server.address).unwrap();
    other.write_all(b"CmdListName 0\n").unwrap();
    BufReader::new(&other).read_line(&mut String::new()).unwrap();
    let mut station = Station::new(server.address);
    station.start();
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    station.waits_for("a complaint", || station.log().contains("end other programs that talk to it"));
    assert!(station.log().contains("gave no answer to `CmdListName 0`: nothing came within 0.5 s"));
    assert_eq!(server.holds().len(), 0);
    drop(other);
    station.waits_until_filed("trough.dxf");
    assert_eq!(server.holds().len(), 1);
}

/// An answer takes as long as all of it takes.
#[test]
fn a_server_that_drips_holds_no_drawing_for_ever() {
    let server = BeamServer::start();
    server.project().faults.push(("CmdListName", Fault::Drips));
    let mut station = Station::new(server.address);
    station.start();
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    station.waits_for("a complaint", || {
        station.log().contains("gave no answer to `CmdListName 0`: no whole line came within 0.5 s")
    });
    station.waits_until_filed("trough.dxf");
    assert_eq!(server.holds().len(), 1);
}

/// The drawing lies in the import folder, and the next start imports it.
#[cfg(unix)]
#[test]
fn a_station_that_is_to_stop_leaves_a_server_that_does_not_answer() {
    for fault in [Fault::Drips, Fault::Slow(Duration::from_secs(3600))] {
        let server = BeamServer::start();
        server.project().faults.push(("CmdImport", fault));
        let mut station = Station::new(server.address);
        station.set("answer_s = 0.5", "answer_s = 3600");
        station.start();
        station.drop("trough.obj", PART);
        station.drop("trough.dxf", &drawing(9.0));
        station.waits_for("the talk", || server.heard("CmdImport") == 1);
        let program = station.program.as_mut().unwrap();
        let status = Command::new("kill").args(["-TERM", &program.id().to_string()]).status().unwrap();
        assert!(status.success());
        let started = Instant::now();
        while program.try_wait().unwrap().is_none() {
            assert!(started.elapsed() < Duration::from_secs(30), "it does not stop");
            std::thread::sleep(Duration::from_millis(5));
        }
        assert!(station.path("import/trough.dxf").exists() && station.path("hot/trough.dxf").exists());
        // One that drips comes to its senses when its client has gone; the other never does.
        if fault == Fault::Drips {
            station.start();
            station.waits_until_filed("trough.dxf");
            assert_eq!(server.holds(), ["\\trough.dxf"]);
        }
    }
}

#[test]
fn a_server_that_answers_nonsense_leaves_the_drawing_waiting() {
    let server = BeamServer::start();
    let mut station = Station::new(server.address);
    station.start();
    station.drop("trough.obj", PART);
    for (number, (verb, words)) in [
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
        server.project().faults.push((verb, Fault::Says(words)));
        let name = format!("trough@{number}.dxf");
        station.drop(&name, &drawing(5.0 + number as f64 / 2.0));
        station.waits_until_filed(&name);
        assert!(server.project().faults.is_empty());
        assert_eq!(server.holds().iter().filter(|held| held.ends_with(&name)).count(), 1, "{name}");
    }
    assert!(station.log().contains("waits: BeamServer answered"), "{}", station.log());
    assert_eq!(fs::read_dir(station.path("rejected")).unwrap().count(), 0);
}

/// Without its size, an element must not be marked.
#[test]
fn a_drawing_that_was_not_verified_leaves_no_element() {
    for fault in [Fault::Says("NaN"), Fault::Error(11, 0), Fault::Slow(Duration::from_secs(1))] {
        let server = BeamServer::start();
        let mut station = Station::new(server.address);
        server.project().faults.push(("CmdGetSizeX", fault));
        station.start();
        station.drop("trough.obj", PART);
        station.drop("trough.dxf", &drawing(9.0));
        station.waits_until_filed("trough.dxf");
        // It was removed, and imported again later: nothing was there to be replaced.
        assert_eq!((server.holds(), server.heard("CmdImport")), (vec!["\\trough.dxf".to_owned()], 2));
        assert_eq!(server.heard("CmdDeleteEnt"), 1, "{}", station.log());
    }
}

#[cfg(unix)]
#[test]
fn a_station_that_is_to_stop_leaves_no_element_that_was_not_verified() {
    let server = BeamServer::start();
    server.project().faults.push(("CmdGetSizeX", Fault::Slow(Duration::from_secs(3))));
    let mut station = Station::new(server.address);
    station.set("answer_s = 0.5", "answer_s = 3600");
    station.start();
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    station.waits_for("the talk", || server.heard("CmdGetSizeX") == 1);
    let program = station.program.as_mut().unwrap();
    let status = Command::new("kill").args(["-TERM", &program.id().to_string()]).status().unwrap();
    assert!(status.success() && program.wait().is_ok());
    station.waits_for("the removal", || server.holds().is_empty());
    assert!(station.path("hot/trough.dxf").exists());
}

/// Whatever else listens there.
#[test]
fn a_server_of_another_kind_is_no_fault_of_the_drawing() {
    for answers in [|_: &str| "banana\n".to_owned(), |heard: &str| heard.to_owned(), |_: &str| "OK\n".into()]
    {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let station = Station::new(listener.local_addr().unwrap());
        std::thread::spawn(move || {
            for client in listener.incoming().flatten() {
                let (mut heard, mut writer) = (BufReader::new(&client), &client);
                let mut line = String::new();
                while heard.read_line(&mut line).is_ok_and(|read| read > 0) {
                    if writer.write_all(answers(&line).as_bytes()).is_err() {
                        break;
                    }
                    line.clear();
                }
            }
        });
        station.drop("trough.obj", PART);
        station.drop("trough.dxf", &drawing(9.0));
        let said = station.once();
        assert!(said.contains("0 rejected, 1 waiting") && said.contains("BeamServer"), "{said}");
        assert!(station.path("hot/trough.dxf").exists());
    }
}

/// What was delivered by folder, or went with an older project, is not in BeamConstruct, whatever lies in `import`.
#[test]
fn the_same_drawing_again_is_imported_if_it_is_not_there() {
    for repeat in ["if-gone", "never"] {
        let server = BeamServer::start();
        let station = Station::new(server.address);
        station.set("kind = \"beamserver\"", &format!("kind = \"folder\"\nrepeat = \"{repeat}\""));
        station.drop("trough.obj", PART);
        let drops = |imports: usize| {
            station.drop("trough.dxf", &drawing(9.0));
            let said = station.once();
            assert_eq!(
                (server.heard("CmdImport"), server.holds().len()),
                (imports, imports.min(1)),
                "{said}"
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
fn a_drawing_of_wrong_size_leaves_the_one_before_it() {
    let server = BeamServer::start();
    let station = Station::new(server.address);
    station.drop("trough.obj", PART);
    station.drop("trough.dxf", &drawing(9.0));
    station.once();
    let first = station.imported();
    server.project().scale = 25.4;
    station.drop("trough.dxf", &drawing(7.0));
    let said = station.once();
    assert!(said.contains("1 rejected"), "{said}");
    let reason = fs::read_to_string(station.path("rejected/trough.dxf.reason.txt")).unwrap();
    assert!(reason.contains("shows trough.dxf "), "{reason}");
    assert_eq!(server.holds(), ["\\trough.dxf"]);
    assert_eq!(server.project().elements[0].id, 101);
    assert_eq!(fs::read_dir(station.path("import")).unwrap().count(), 1);
    assert_eq!(station.imported(), first);
    // The station knows that, too.
    station.drop("trough.dxf", &drawing(9.0));
    let said = station.once();
    assert!(said.contains("lies in import unchanged") && said.contains("is in BeamConstruct"), "{said}");
    assert_eq!(server.project().elements[0].id, 101);
}

#[test]
fn a_silent_server_holds_up_one_drawing_and_no_part() {
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
        station.log().contains("BeamServer is at another drawing")
    });
    assert_eq!(server.heard("CmdListName"), 1);
}

/// BeamServer may be away for long while drawings are corrected again, and the station be restarted meanwhile.
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
        station.waits_for("a complaint", || station.log().contains("is not corrected again yet"));
        // Listings close what was interrupted.
        let heard = server.project().heard.len();
        station.command(&["retry", "station.toml"]).output().unwrap();
        station.waits_for("another try", || server.project().heard.len() > heard);
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
            // It is outdated still, and the next start tries it again.
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

/// However the station ends between import and archive, BeamConstruct holds the drawing once in the end.
#[test]
fn a_station_that_is_killed_around_the_import_goes_on() {
    let server = BeamServer::start();
    let mut station = Station::new(server.address);
    station.drop("trough.obj", PART);
    for (number, verb) in ["CmdListName", "CmdImport", "CmdSelEntName", "CmdGetSizeY"].into_iter().enumerate()
    {
        let name = format!("trough@{number}.dxf");
        let heard = server.heard(verb);
        server.project().faults.push((verb, Fault::Slow(Duration::from_millis(300))));
        station.start();
        station.drop(&name, &drawing(9.0));
        station.waits_for(verb, || server.heard(verb) > heard);
        station.kill();
        if verb == "CmdImport" {
            // Who tidies up by hand meanwhile only causes another delivery.
            fs::remove_file(station.path("import").join(&name)).unwrap();
        }
        station.start();
        station.waits_until_filed(&name);
        station.kill();
        assert_eq!(server.holds().iter().filter(|held| held.ends_with(&name)).count(), 1, "{name}");
    }
}
