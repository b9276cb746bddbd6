//! The program as a station in a difficult environment: folders fail, inputs are unreasonable, and the station
//! continues.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may fail loudly, its helpers too")]

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

use fs_err as fs;

#[cfg(target_os = "linux")]
mod disks;
#[cfg(target_os = "linux")]
mod flushes;
#[path = "../schemas/mod.rs"]
mod schemas;
mod together;

const SETTINGS: &str = "[station]\nname = \"test\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\n\
                        width_mm = 100\nheight_mm = 100\n[watch]\nsettle_ms = 20000\nrescan_s = 0.2\n";
/// A shallow trough and a square on it.
const PART: &str = "v -20 -20 1\nv 0 -20 0\nv 20 -20 1\nv -20 20 1\nv 0 20 0\nv 20 20 1\n\
                    f 1 2 5 4\nf 2 3 6 5\n";

struct Station {
    folder: tempfile::TempDir,
    program: Option<Child>,
}

impl Station {
    fn new() -> Self {
        let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        for name in ["hot", "import", "elsewhere"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        fs::write(folder.path().join("station.toml"), SETTINGS).unwrap();
        Self { folder, program: None }
    }

    fn path(&self, relative: &str) -> PathBuf {
        self.folder.path().join(relative)
    }

    /// The program, with the station's folder as its working folder.
    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_isomark"));
        command.current_dir(self.folder.path()).args(arguments);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command
    }

    fn start(&mut self, command: &mut Command) {
        self.program = Some(command.spawn().unwrap());
        self.waits_for("the archive folder", |station| station.path("archive").is_dir());
    }

    /// Makes the files in the hot folder look as if they were dropped long ago.
    fn make_old(&self) {
        for entry in fs::read_dir(self.path("hot")).unwrap() {
            let path = entry.unwrap().path();
            if let Ok(file) = fs::OpenOptions::new().write(true).open(path) {
                file.file().set_modified(SystemTime::now() - Duration::from_secs(3600)).unwrap();
            }
        }
    }

    /// Processes files that were dropped long before the start; returns the printed text.
    fn once(&self) -> String {
        self.make_old();
        let output = self.command(&["watch", "station.toml", "--once"]).stdout(Stdio::piped()).output();
        let output = output.unwrap();
        let printed = String::from_utf8(output.stdout.clone()).unwrap();
        let code = match () {
            () if !printed.contains(" 0 rejected") => 1,
            () if printed.contains("The import folder ") => 3,
            () => 0,
        };
        assert_eq!(output.status.code(), Some(code), "{output:?}");
        printed
    }

    /// The output of `isomark status`.
    #[cfg(target_os = "linux")]
    fn status(&self) -> String {
        let output = self.command(&["status", "station.toml"]).stdout(Stdio::piped()).output().unwrap();
        String::from_utf8(output.stdout).unwrap()
    }

    fn rename_into(&self, name: &str, bytes: &[u8]) {
        let elsewhere = self.path("elsewhere/file");
        fs::write(&elsewhere, bytes).unwrap();
        fs::rename(elsewhere, self.path("hot").join(name)).unwrap();
    }

    fn waits_for(&mut self, what: &str, condition: impl Fn(&Self) -> bool) {
        let started = Instant::now();
        while !condition(self) {
            let ended = self.program.as_mut().and_then(|program| program.try_wait().unwrap());
            assert!(ended.is_none(), "the program ended: {ended:?}");
            assert!(started.elapsed() < Duration::from_secs(60), "{what}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn reason(&self, name: &str) -> String {
        let path = self.path("rejected").join(format!("{name}.reason.json"));
        let reason = schemas::document(fs::read(path).unwrap());
        reason["code"].as_str().unwrap().to_owned()
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        if let Some(mut program) = self.program.take() {
            let _ = program.kill();
            let _ = program.wait();
        }
        schemas::check_below(self.folder.path());
    }
}

fn drawing(entities: &str) -> String {
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n{entities}0\nENDSEC\n0\nEOF\n"
    )
}

fn line(from: [f64; 2], to: [f64; 2]) -> String {
    format!("0\nLINE\n8\nMARK\n10\n{}\n20\n{}\n11\n{}\n21\n{}\n", from[0], from[1], to[0], to[1])
}

#[cfg(target_os = "linux")]
fn exists(path: &std::path::Path) -> bool {
    path.exists()
}

/// Only Linux reports that a file is complete; the settle time of these stations is longer than the test waits.
#[cfg(target_os = "linux")]
#[test]
fn events_are_used_with_a_relative_path_of_the_station_file() {
    let mut station = Station::new();
    let mut command = station.command(&["watch", "station.toml"]);
    station.start(&mut command);
    station.waits_for("the start of the watch", |station| exists(&station.path("reports")));
    std::thread::sleep(Duration::from_millis(300));
    let started = Instant::now();
    station.rename_into("trough.obj", PART.as_bytes());
    station.rename_into("trough.dxf", drawing(&line([-5.0, 0.0], [5.0, 0.0])).as_bytes());
    station.waits_for("the result", |station| exists(&station.path("import/trough.dxf")));
    assert!(started.elapsed() < Duration::from_secs(15));
}

#[cfg(target_os = "linux")]
#[test]
fn a_log_on_a_full_disk_stops_nothing() {
    let mut station = Station::new();
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let mut command = station.command(&["watch", "station.toml"]);
    station.start(command.stderr(full.into_parts().0));
    station.waits_for("the start of the watch", |station| exists(&station.path("reports")));
    std::thread::sleep(Duration::from_millis(300));
    station.rename_into("trough.stl", b"solid");
    station.waits_for("the rejection", |station| exists(&station.path("rejected/trough.stl")));
}

#[test]
fn an_unreasonable_file_is_refused_and_the_station_continues() {
    let station = Station::new();
    fs::write(station.path("hot/trough.obj"), PART).unwrap();
    fs::write(station.path("hot/trough.dxf"), drawing(&line([-5.0, 0.0], [5.0, 0.0]))).unwrap();
    // A drawing in map coordinates; sampling it would take gigabytes.
    let far: String = (0..50).map(|i| line([0.0, 0.0], [1e6, f64::from(i)])).collect();
    fs::write(station.path("hot/trough@far.dxf"), drawing(&far)).unwrap();
    let scribble: String = (0..140_000).map(|i| line([-18.0, 0.0], [18.0, 1e-5 * f64::from(i)])).collect();
    fs::write(station.path("hot/trough@scribble.dxf"), drawing(&scribble)).unwrap();
    let sparse = cfg!(unix);
    if sparse {
        // It takes no space on the disk, but would need all memory.
        fs::File::create(station.path("hot/vast.glb")).unwrap().set_len(1 << 40).unwrap();
    }
    let printed = station.once();
    let rejected = if sparse { 3 } else { 2 };
    assert!(printed.starts_with(&format!("1 delivered, 1 part fitted, {rejected} rejected")), "{printed}");
    assert_eq!(station.reason("trough@far.dxf"), "off-surface");
    assert_eq!(station.reason("trough@scribble.dxf"), "too-much-ink");
    if sparse {
        assert_eq!(station.reason("vast.glb"), "file-too-large");
    }
}

/// A file whose name is not valid text can be rejected more than once.
#[cfg(target_os = "linux")]
#[test]
fn a_name_that_is_not_valid_text_is_rejected_each_time() {
    use std::os::unix::ffi::OsStrExt;
    let station = Station::new();
    for round in ["", "(2)"] {
        let name = std::ffi::OsStr::from_bytes(b"bad\xff.dxf");
        fs::write(station.path("hot").join(name), "x").unwrap();
        assert!(station.once().contains("1 rejected, 0 waiting"));
        assert!(station.path("rejected").join(round).join(name).exists());
    }
}

/// It states that it takes drops only when it does.
#[test]
fn a_second_station_on_the_hot_folder_never_states_that_it_takes_drops() {
    let mut station = Station::new();
    let mut command = station.command(&["watch", "station.toml"]);
    station.start(&mut command);
    // A station writes its status after it has locked its hot folder.
    station.waits_for("a status", |station| station.path("state/status.json").exists());
    fs::write(station.path("other.toml"), SETTINGS.replace("[folders]\n", "[folders]\nstate = \"other\"\n"))
        .unwrap();
    let output = station.command(&["watch", "other.toml"]).stderr(Stdio::piped()).output().unwrap();
    let log = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(3), "{log}");
    assert!(log.contains("Another station already uses the hot folder"), "{log}");
    assert!(!log.contains("takes drops"), "{log}");
}

#[test]
fn a_missing_import_folder_is_named() {
    let station = Station::new();
    fs::remove_dir(station.path("import")).unwrap();
    fs::write(station.path("hot/trough.obj"), PART).unwrap();
    fs::write(station.path("hot/trough.dxf"), drawing(&line([-5.0, 0.0], [5.0, 0.0]))).unwrap();
    let printed = station.once();
    assert!(printed.contains("0 rejected, 1 waiting"), "{printed}");
    assert!(printed.contains("The import folder ") && printed.contains(" does not exist."), "{printed}");
    fs::create_dir(station.path("import")).unwrap();
    assert!(station.once().starts_with("1 delivered"));
}

/// Half an OBJ looks complete, and `--once` does not see its writer close it: the file must stay unchanged for a while.
#[cfg(unix)]
#[test]
fn a_stalled_copy_is_not_processed_by_once() {
    use std::io::Write;
    let station = Station::new();
    let settings = SETTINGS.replace("settle_ms = 20000", "settle_ms = 50\nopen_ended_s = 3");
    fs::write(station.path("station.toml"), settings).unwrap();
    let (first, rest) = PART.split_at(PART.find("f 2").unwrap());
    let mut writer = fs::File::create(station.path("hot/trough.obj")).unwrap();
    writer.write_all(first.as_bytes()).unwrap();
    let mut program = station.command(&["watch", "station.toml", "--once"]).spawn().unwrap();
    std::thread::sleep(Duration::from_millis(1500));
    writer.write_all(rest.as_bytes()).unwrap();
    drop(writer);
    assert!(program.wait().unwrap().success());
    assert_eq!(fs::read_to_string(station.path("archive/trough/trough.obj")).unwrap(), PART);
}

/// A SKU folder that cannot be read hides only its own files.
#[cfg(unix)]
#[test]
fn an_unreadable_folder_does_not_stop_the_listing() {
    use std::os::unix::fs::PermissionsExt;
    let station = Station::new();
    let closed = station.path("hot/closed");
    fs::create_dir(&closed).unwrap();
    fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o000)).unwrap();
    fs::write(station.path("hot/trough.iges"), "S 1").unwrap();
    assert!(station.once().contains("1 rejected"));
    fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o755)).unwrap();
}
