//! A real station of a fleet.

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use fs_err as fs;
use serde_json::Value;

use crate::desk::Desk;
use crate::server::{SECRET, waits_for};

/// A shallow trough of this depth.
pub fn trough(depth: f64) -> String {
    format!(
        "v -20 -20 {depth}\nv 0 -20 0\nv 20 -20 {depth}\nv -20 20 {depth}\nv 0 20 0\nv 20 20 {depth}\nf 1 2 5 4\nf 2 3 6 5\n"
    )
}

/// A drawing of one line of this length.
pub fn line(length: f64) -> String {
    format!(
        "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n0\nLINE\n8\nMARK\n10\n0\n20\n0\n\
         11\n{length}\n21\n0\n0\nENDSEC\n0\nEOF\n"
    )
}

pub struct Station {
    pub desk: Desk,
    running: Option<Child>,
}

impl Station {
    /// A station with further settings; it is not started.
    pub fn new(name: &str, settings: &str) -> Self {
        let desk = Desk::new();
        for folder in ["hot", "import"] {
            fs::create_dir(desk.path(folder)).unwrap();
        }
        desk.write("password.txt", format!("{SECRET}\n"));
        let station = Self { desk, running: None };
        station.set(name, settings);
        station
    }

    /// A running station of the fleet at this URL.
    pub fn of(name: &str, url: &str) -> Self {
        let mut station = Self::new(name, &in_fleet(url));
        station.start();
        station
    }

    pub fn set(&self, name: &str, settings: &str) {
        self.desk.write(
            "station.toml",
            format!(
                "[station]\nname = \"{name}\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 100\n\
                 height_mm = 100\n[watch]\nsettle_ms = 50\nopen_ended_s = 0\nrescan_s = 1\nincomplete_s = 2\n{settings}"
            ),
        );
    }

    pub fn start(&mut self) {
        let log = fs::OpenOptions::new().create(true).append(true).open(self.desk.path("log.txt")).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_isomark"))
            .args(["watch", "station.toml"])
            .current_dir(self.desk.root())
            .env_remove("RUST_LOG")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log.into_parts().0)
            .spawn();
        self.running = Some(child.unwrap());
    }

    pub fn kill(&mut self) {
        let mut child = self.running.take().unwrap();
        child.kill().unwrap();
        child.wait().unwrap();
    }

    /// The number of its process.
    pub fn process(&self) -> u32 {
        self.running.as_ref().unwrap().id()
    }

    /// Ends it as a service manager does.
    #[cfg(unix)]
    pub fn stop(&mut self) {
        let mut child = self.running.take().unwrap();
        let status = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
        assert!(status.success());
        assert!(child.wait().unwrap().success(), "{}", self.log());
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.desk.path(name)
    }

    pub fn log(&self) -> String {
        fs::read_to_string(self.path("log.txt")).unwrap_or_default()
    }

    /// The lines of the log with these words.
    pub fn logged(&self, words: &str) -> usize {
        self.log().lines().filter(|line| line.contains(words)).count()
    }

    pub fn drop_in(&self, name: &str, content: &str) {
        self.desk.write(&format!("new-{name}"), content);
        fs::rename(self.path(&format!("new-{name}")), self.path("hot").join(name)).unwrap();
    }

    #[track_caller]
    pub fn waits_for(&self, what: &str, condition: impl Fn(&Self) -> bool) {
        waits_for(what, || condition(self), || self.log());
    }

    #[track_caller]
    pub fn waits_for_file(&self, name: &str) {
        self.waits_for(name, |station| station.path(name).exists());
    }

    /// Waits until it has connected as often as this.
    #[track_caller]
    pub fn waits_for_fleet(&self, times: usize) {
        self.waits_for("the fleet", |station| station.logged("the fleet at ") >= times);
    }

    pub fn status(&self) -> Value {
        let bytes = fs::read(self.path("state/status.json")).unwrap_or_default();
        serde_json::from_slice(&bytes).unwrap_or_default()
    }

    /// The problems that the status lists, as text.
    pub fn troubles(&self) -> String {
        self.status()["troubles"].to_string()
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        if let Some(mut child) = self.running.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
        let (log, status) = (self.log(), self.status().to_string());
        if !std::thread::panicking() {
            assert!(!log.contains(SECRET) && !status.contains(SECRET), "the password was shown");
            assert!(!log.contains("panicked") && !log.contains("internal error"), "{log}");
        }
    }
}

/// The settings of a station of a fleet.
pub fn in_fleet(url: &str) -> String {
    format!("[fleet]\nurl = \"{url}\"\npassword_file = \"password.txt\"\n")
}
