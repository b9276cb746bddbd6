//! Disks that are full or read-only, and folders that disappear and return: drops wait, the station reports it, and
//! each drawing is delivered once when the problem is resolved. An importer takes every drawing away at once, so that a
//! second delivery is noticed. Only Linux lets a test mount a small disk, and only as administrator.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use fs_err as fs;

use super::{PART, SETTINGS, Station, drawing, line};

const DROPS: usize = 20;

/// A disk in memory, unmounted when this is dropped.
struct Disk(PathBuf);

impl Disk {
    /// Mounts a disk of 128 kB on the folder; `None`, with a printed note, where that is not permitted.
    fn on(folder: &Path) -> Option<Self> {
        Self::of_size("128k", folder)
    }

    fn of_size(size: &str, folder: &Path) -> Option<Self> {
        fs::create_dir_all(folder).unwrap();
        let arguments = ["-t", "tmpfs", "-o", &format!("size={size},mode=755"), "isomark-test"];
        let output = Command::new("mount").args(arguments).arg(folder).stdin(Stdio::null()).output();
        match output {
            Ok(output) if output.status.success() => Some(Self(folder.into())),
            refused => {
                let why = refused.map_or_else(
                    |error| error.to_string(),
                    |output| String::from_utf8_lossy(&output.stderr).trim().to_owned(),
                );
                // `eprintln!` is only shown when a test fails.
                let note =
                    format!("SKIPPED: no small disk can be mounted here, so it was not tested ({why})\n");
                std::io::stderr().write_all(note.as_bytes()).unwrap();
                None
            }
        }
    }

    /// Fills the disk completely.
    fn fill(&self) {
        let mut file = fs::File::create(self.filler()).unwrap();
        let error = loop {
            if let Err(error) = file.write_all(&[0; 512]) {
                break error;
            }
        };
        assert_eq!(error.kind(), ErrorKind::StorageFull);
    }

    fn free(&self) {
        fs::remove_file(self.filler()).unwrap();
    }

    fn filler(&self) -> PathBuf {
        self.0.join("filler")
    }

    fn remount(&self, how: &str) {
        let status = Command::new("mount").args(["-o", &format!("remount,{how}")]).arg(&self.0).status();
        assert!(status.unwrap().success());
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        // The station may still use the disk when a test fails, so the unmount is lazy.
        let _ = Command::new("umount").arg("-l").arg(&self.0).status();
    }
}

/// A station under test, with its importer.
struct Trial {
    station: Station,
    taken: BTreeMap<String, Vec<u8>>,
}

impl Trial {
    /// A running station that has learned the part.
    fn new(station: Station) -> Self {
        let settings = SETTINGS.replace("settle_ms = 20000", "settle_ms = 100");
        fs::write(station.path("station.toml"), settings).unwrap();
        let mut trial = Self { station, taken: BTreeMap::new() };
        trial.start();
        trial.station.rename_into("trough.obj", PART.as_bytes());
        trial.waits_for("the part", |trial| trial.station.path("archive/trough/trough.obj").exists());
        trial
    }

    fn start(&mut self) {
        let log =
            fs::OpenOptions::new().create(true).append(true).open(self.station.path("log.txt")).unwrap();
        let mut command = self.station.command(&["watch", "station.toml"]);
        self.station.start(command.stderr(log.into_parts().0));
        self.waits_for("a listing", |trial| {
            fs::read_to_string(trial.station.path("state/status.json"))
                .is_ok_and(|text| text.contains("\"running\": true"))
        });
    }

    fn kill(&mut self) {
        let mut program = self.station.program.take().unwrap();
        program.kill().unwrap();
        program.wait().unwrap();
    }

    fn drop_all(&self) {
        for number in 0..DROPS {
            self.station.rename_into(&name(number), square(number).as_bytes());
        }
    }

    fn log(&self) -> String {
        fs::read_to_string(self.station.path("log.txt")).unwrap_or_default()
    }

    /// Takes every drawing out of the import folder, and checks that it was not delivered before.
    fn import(&mut self) {
        for entry in fs::read_dir(self.station.path("import")).into_iter().flatten().flatten() {
            let name = entry.file_name().into_string().unwrap();
            if !name.ends_with(".dxf") {
                continue;
            }
            let bytes = fs::read(entry.path()).unwrap();
            // On a read-only disk it stays.
            if std::fs::remove_file(entry.path()).is_ok() {
                let before = self.taken.insert(name.clone(), bytes);
                assert!(before.is_none(), "{name} was delivered twice: {}", self.log());
            }
        }
    }

    fn waits_for(&mut self, what: &str, condition: impl Fn(&Self) -> bool) {
        let started = std::time::Instant::now();
        loop {
            self.import();
            if condition(self) {
                return;
            }
            assert!(started.elapsed() < std::time::Duration::from_secs(60), "{what}: {}", self.log());
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    }

    fn in_hot(&self) -> usize {
        fs::read_dir(self.station.path("hot")).map_or(0, |entries| entries.count())
    }

    /// Checks that all drawings are delivered once, with the right bytes, and filed, and that a restart delivers
    /// nothing.
    fn check_end(mut self) {
        self.waits_for("all drawings", |trial| trial.taken.len() == DROPS && trial.in_hot() == 0);
        let healthy = Station::new();
        fs::write(healthy.path("hot/trough.obj"), PART).unwrap();
        for number in 0..DROPS {
            fs::write(healthy.path("hot").join(name(number)), square(number)).unwrap();
        }
        assert!(healthy.once().starts_with(&format!("{DROPS} delivered")));
        for (name, bytes) in &self.taken {
            assert!(
                fs::read(healthy.path("import").join(name)).unwrap() == *bytes,
                "{name} is a different drawing"
            );
            let archived = fs::read(self.station.path("archive/trough").join(name)).unwrap();
            assert!(archived == fs::read(healthy.path("archive/trough").join(name)).unwrap(), "{name}");
        }
        // The next start delivers nothing again.
        self.kill();
        self.start();
        self.station.rename_into("end.pdf", b"%PDF");
        self.waits_for("the end", |trial| trial.station.path("rejected/end.pdf").exists());
        self.import();
        let left: Vec<_> = fs::read_dir(self.station.path("import")).unwrap().flatten().collect();
        assert!(left.is_empty(), "{left:?}");
    }
}

fn name(number: usize) -> String {
    format!("trough@{number:02}.dxf")
}

fn square(number: usize) -> String {
    let end = 3.0 + number as f64 * 0.1;
    drawing(&(line([-5.0, 0.0], [end, 0.0]) + &line([end, 0.0], [end, 4.0])))
}

/// Several drawings fit on the disk, and the last one of them only partly.
#[test]
fn drawings_wait_for_space_in_the_import_folder() {
    let station = Station::new();
    let Some(disk) = Disk::on(&station.path("import")) else { return };
    let mut trial = Trial::new(station);
    disk.fill();
    trial.drop_all();
    trial.waits_for("a warning", |trial| {
        trial.log().contains("trough@00.dxf waits: A folder of the station is")
    });
    assert!(trial.log().contains("No space left on device"), "{}", trial.log());
    trial.waits_for("a status", |trial| {
        let status = trial.station.status();
        status.contains("waiting: ") && status.contains("free space; the job then continues by itself")
    });
    assert_eq!((trial.taken.len(), trial.in_hot()), (0, DROPS));
    // While it tries again, a part of a drawing is there as well.
    trial.waits_for("nothing but the filler", |trial| {
        fs::read_dir(trial.station.path("import")).unwrap().count() == 1
    });
    disk.free();
    trial.check_end();
}

/// The journal is written first: without its line, a drawing is not delivered.
#[test]
fn drawings_wait_for_space_in_the_state_folder() {
    let station = Station::new();
    let Some(disk) = Disk::on(&station.path("state")) else { return };
    let mut trial = Trial::new(station);
    disk.fill();
    trial.drop_all();
    trial.waits_for("a warning", |trial| trial.log().contains("dxf waits: A folder of the station is"));
    assert!(trial.log().contains("No space left on device"), "{}", trial.log());
    trial.import();
    // The last block of the journal has room for a few more lines.
    assert!(trial.taken.len() < DROPS, "{:?}", trial.taken.keys());
    trial.kill();
    disk.free();
    trial.start();
    trial.check_end();
}

#[test]
fn delivered_drawings_wait_for_space_in_the_archive() {
    let station = Station::new();
    let Some(disk) = Disk::on(&station.path("archive")) else { return };
    let mut trial = Trial::new(station);
    disk.fill();
    trial.drop_all();
    trial.waits_for("the drawings", |trial| trial.taken.len() == DROPS);
    trial.waits_for("a warning", |trial| {
        trial.log().contains("trough@19.dxf waits: A folder of the station is")
    });
    assert_eq!(trial.in_hot(), DROPS);
    disk.free();
    trial.check_end();
}

#[test]
fn drawings_wait_for_a_writable_import_folder() {
    let station = Station::new();
    let Some(disk) = Disk::on(&station.path("import")) else { return };
    let mut trial = Trial::new(station);
    disk.remount("ro");
    trial.drop_all();
    trial.waits_for("a warning", |trial| {
        trial.log().contains("trough@00.dxf waits: A folder of the station is")
    });
    assert!(trial.log().contains("Read-only file system"), "{}", trial.log());
    assert_eq!((trial.taken.len(), trial.in_hot()), (0, DROPS));
    disk.remount("rw");
    trial.check_end();
}

/// The mount point of a disconnected share looks like an empty import folder, also to a station that starts later.
#[test]
fn drawings_wait_for_the_share_with_the_import_folder() {
    let station = Station::new();
    let Some(disk) = Disk::on(&station.path("import")) else { return };
    let mut trial = Trial::new(station);
    trial.station.rename_into("trough@first.dxf", square(0).as_bytes());
    trial.waits_for("a drawing", |trial| trial.taken.len() == 1);
    trial.waits_for("its original in the archive", |trial| trial.in_hot() == 0);
    trial.taken.clear();
    let point = disk.0.clone();
    drop(disk);
    trial.drop_all();
    let warnings = |trial: &Trial| trial.log().matches("trough@00.dxf waits: The import folder ").count();
    trial.waits_for("a warning", |trial| warnings(trial) == 1);
    trial.kill();
    trial.start();
    trial.waits_for("a warning", |trial| warnings(trial) == 2);
    let status = trial.station.status();
    assert!(status.contains("problem: ") && status.contains("is not mounted at"), "{status}");
    assert_eq!((fs::read_dir(&point).unwrap().count(), trial.in_hot()), (0, DROPS));
    let Some(_disk) = Disk::on(&point) else { return };
    trial.check_end();
}

/// In the mount point of a disconnected share, the settings of a SKU seem to be removed, and so does the part that another
/// station fitted last: also to a station that starts later.
#[test]
fn drawings_wait_for_the_share_with_their_settings_or_surfaces() {
    for folder in ["skus", "cache"] {
        let station = Station::new();
        let point = station.path(folder);
        let Some(disk) = Disk::of_size("8m", &point) else { return };
        fs::create_dir_all(station.path("skus")).unwrap();
        let settings = station.path("skus/trough.toml");
        // The middle of the drawing is at x = -1 mm where it was drawn.
        let place = "[placement]\nplace_mm = [9, 0]\n";
        fs::write(&settings, place).unwrap();
        let mut trial = Trial::new(station);
        drop(disk);
        trial.station.rename_into("trough@a.dxf", square(0).as_bytes());
        let warning = format!("trough@a.dxf waits: The {folder} folder ");
        let warnings = |trial: &Trial| trial.log().matches(&warning).count();
        trial.waits_for("a warning", |trial| warnings(trial) == 1);
        trial.kill();
        trial.start();
        trial.waits_for("a warning", |trial| warnings(trial) == 2);
        let listings = |trial: &Trial| trial.station.status().contains("is not mounted at");
        trial.waits_for("a problem in the status", listings);
        assert_eq!((trial.taken.len(), trial.in_hot()), (0, 1), "{folder}");
        assert!(!trial.log().contains("using the changed settings"), "{}", trial.log());
        let Some(_disk) = Disk::of_size("8m", &point) else { return };
        fs::write(&settings, place).unwrap();
        trial.waits_for("the drawing", |trial| trial.taken.len() == 1);
        let text = String::from_utf8(trial.taken["trough@a.dxf"].clone()).unwrap();
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        let of_entities = lines.iter().position(|line| *line == "ENTITIES").unwrap();
        let pairs = lines[of_entities..].windows(3).filter(|lines| lines[0] == "10" && lines[2] == "20");
        let x: Vec<f64> = pairs.map(|lines| lines[1].parse().unwrap()).collect();
        assert!(!x.is_empty() && x.iter().all(|x| (4.0..14.0).contains(x)), "{folder}: {x:?}");
    }
}

/// Like a share that is disconnected and connected again several times during the work.
#[test]
fn drawings_survive_folders_that_disappear_and_return() {
    for (folder, missing, available) in [
        ("import", "does not exist", "delivered"),
        ("hot", "available; waiting for it", "is available again"),
    ] {
        let mut trial = Trial::new(Station::new());
        let (there, away) = (trial.station.path(folder), trial.station.path("elsewhere/away"));
        trial.drop_all();
        for _ in 0..3 {
            let before = trial.taken.len();
            trial.waits_for("a drawing", |trial| trial.taken.len() > before);
            let count = |trial: &Trial, text: &str| trial.log().matches(text).count();
            let (times_missing, times_available) = (count(&trial, missing), count(&trial, available));
            fs::rename(&there, &away).unwrap();
            trial.waits_for("a warning", |trial| count(trial, missing) > times_missing);
            fs::rename(&away, &there).unwrap();
            trial.waits_for("a message", |trial| count(trial, available) > times_available);
        }
        trial.check_end();
    }
}
