//! Disks that fill up or may not be written any more, and folders that vanish and come back: what was dropped waits,
//! says so, and is delivered once when all is well again. An importer takes every drawing away at once, so that a
//! second delivery cannot hide. Only Linux lets a test mount a small disk, and only for an administrator.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use fs_err as fs;

use super::{PART, SETTINGS, Station, drawing, line};

const DROPS: usize = 20;

/// A disk of 128 kB in memory, for as long as this lives.
struct Disk(PathBuf);

impl Disk {
    /// Mounts it on the folder; `None`, and a word about it, where that is not permitted.
    fn on(folder: &Path) -> Option<Self> {
        fs::create_dir_all(folder).unwrap();
        let words = ["-t", "tmpfs", "-o", "size=128k,mode=755", "isomark-test"];
        let output = Command::new("mount").args(words).arg(folder).stdin(Stdio::null()).output();
        match output {
            Ok(output) if output.status.success() => Some(Self(folder.into())),
            refused => {
                let why = refused.map_or_else(
                    |error| error.to_string(),
                    |output| String::from_utf8_lossy(&output.stderr).trim().to_owned(),
                );
                // Not by `eprintln!`, which is only shown when a test fails.
                let words =
                    format!("SKIPPED: no small disk can be mounted here, nothing was tried on one ({why})\n");
                std::io::stderr().write_all(words.as_bytes()).unwrap();
                None
            }
        }
    }

    /// Takes all space that is left.
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
        // Lazily: the station may still be using it when a test fails.
        let _ = Command::new("umount").arg("-l").arg(&self.0).status();
    }
}

/// A station under trial, with its importer.
struct Trial {
    station: Station,
    taken: BTreeMap<String, Vec<u8>>,
}

impl Trial {
    /// It runs and knows the part.
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

    /// Takes every drawing out of the import folder, and sees that it comes for the first time.
    fn import(&mut self) {
        for entry in fs::read_dir(self.station.path("import")).into_iter().flatten().flatten() {
            let name = entry.file_name().into_string().unwrap();
            if !name.ends_with(".dxf") {
                continue;
            }
            let bytes = fs::read(entry.path()).unwrap();
            // A disk that may not be written keeps it.
            if std::fs::remove_file(entry.path()).is_ok() {
                let before = self.taken.insert(name.clone(), bytes);
                assert!(before.is_none(), "{name} came twice: {}", self.log());
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

    /// All is well again: everything is delivered, once and with the right bytes, and filed, and stays so.
    fn ends_well(mut self) {
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
                "{name} is another drawing"
            );
            let archived = fs::read(self.station.path("archive/trough").join(name)).unwrap();
            assert!(archived == fs::read(healthy.path("archive/trough").join(name)).unwrap(), "{name}");
        }
        // Whatever the trouble left in the journal, the next start delivers nothing again.
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

/// Some drawings fit, one of them not quite.
#[test]
fn drawings_wait_for_space_in_the_import_folder() {
    let station = Station::new();
    let Some(disk) = Disk::on(&station.path("import")) else { return };
    let mut trial = Trial::new(station);
    disk.fill();
    trial.drop_all();
    trial
        .waits_for("a word", |trial| trial.log().contains("trough@00.dxf waits: A folder of the station is"));
    assert!(trial.log().contains("No space left on device"), "{}", trial.log());
    trial.waits_for("a status", |trial| {
        let words = trial.station.status();
        words.contains("waiting: ") && words.contains("has space; the job then goes on by itself")
    });
    assert_eq!((trial.taken.len(), trial.in_hot()), (0, DROPS));
    let left: Vec<_> = fs::read_dir(trial.station.path("import")).unwrap().flatten().collect();
    assert_eq!(left.len(), 1, "only the filler: {left:?}");
    disk.free();
    trial.ends_well();
}

/// The journal comes first: what cannot be noted is not delivered.
#[test]
fn drawings_wait_for_space_in_the_state_folder() {
    let station = Station::new();
    let Some(disk) = Disk::on(&station.path("state")) else { return };
    let mut trial = Trial::new(station);
    disk.fill();
    trial.drop_all();
    trial.waits_for("a word", |trial| trial.log().contains("dxf waits: A folder of the station is"));
    assert!(trial.log().contains("No space left on device"), "{}", trial.log());
    trial.import();
    // The last block of the journal takes a few lines more.
    assert!(trial.taken.len() < DROPS, "{:?}", trial.taken.keys());
    trial.kill();
    disk.free();
    trial.start();
    trial.ends_well();
}

#[test]
fn drawings_that_are_delivered_wait_for_space_in_the_archive() {
    let station = Station::new();
    let Some(disk) = Disk::on(&station.path("archive")) else { return };
    let mut trial = Trial::new(station);
    disk.fill();
    trial.drop_all();
    trial.waits_for("the drawings", |trial| trial.taken.len() == DROPS);
    trial
        .waits_for("a word", |trial| trial.log().contains("trough@19.dxf waits: A folder of the station is"));
    assert_eq!(trial.in_hot(), DROPS);
    disk.free();
    trial.ends_well();
}

#[test]
fn drawings_wait_for_an_import_folder_that_may_be_written() {
    let station = Station::new();
    let Some(disk) = Disk::on(&station.path("import")) else { return };
    let mut trial = Trial::new(station);
    disk.remount("ro");
    trial.drop_all();
    trial
        .waits_for("a word", |trial| trial.log().contains("trough@00.dxf waits: A folder of the station is"));
    assert!(trial.log().contains("Read-only file system"), "{}", trial.log());
    assert_eq!((trial.taken.len(), trial.in_hot()), (0, DROPS));
    disk.remount("rw");
    trial.ends_well();
}

/// The mount point of a share that went looks like an empty import folder, also to a station that starts then.
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
    let told = |trial: &Trial| trial.log().matches("trough@00.dxf waits: The import folder ").count();
    trial.waits_for("a word", |trial| told(trial) == 1);
    trial.kill();
    trial.start();
    trial.waits_for("a word", |trial| told(trial) == 2);
    let words = trial.station.status();
    assert!(words.contains("trouble: ") && words.contains("is not mounted at"), "{words}");
    assert_eq!((fs::read_dir(&point).unwrap().count(), trial.in_hot()), (0, DROPS));
    let Some(_disk) = Disk::on(&point) else { return };
    trial.ends_well();
}

/// As a share does that is lost and found, again and again, in the middle of the work.
#[test]
fn drawings_survive_folders_that_vanish_and_come_back() {
    for (folder, gone, back) in
        [("import", "does not exist", "delivered"), ("hot", "waiting for it to come back", "is back")]
    {
        let mut trial = Trial::new(Station::new());
        let (there, away) = (trial.station.path(folder), trial.station.path("elsewhere/away"));
        trial.drop_all();
        for _ in 0..3 {
            let before = trial.taken.len();
            trial.waits_for("a drawing", |trial| trial.taken.len() > before);
            let told = |trial: &Trial, words: &str| trial.log().matches(words).count();
            let (times_gone, times_back) = (told(&trial, gone), told(&trial, back));
            fs::rename(&there, &away).unwrap();
            trial.waits_for("a word", |trial| told(trial, gone) > times_gone);
            fs::rename(&away, &there).unwrap();
            trial.waits_for("a word", |trial| told(trial, back) > times_back);
        }
        trial.ends_well();
    }
}
