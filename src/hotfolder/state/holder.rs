//! The process that runs a station, recorded in a file for other processes.

use std::fmt::{Display, Formatter};
use std::path::Path;

use crate::files::{read_if_there, write_whole_unsynced};
use crate::hotfolder::clock;

const HOLDER: &str = "station.toml";

/// The process that runs a station.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Holder {
    /// The station's name.
    pub station: String,
    /// The number of its process.
    pub process: u32,
    /// The machine that it runs on; empty if unknown.
    pub machine: String,
    /// When it was started, in universal time.
    pub since: String,
}

impl Holder {
    /// This process, which runs the station with this name from now on.
    pub(crate) fn this_process(station: &str) -> Self {
        let (process, since) = (std::process::id(), clock::now());
        Self { station: station.into(), process, machine: machine(), since }
    }

    /// A process whose file cannot be read.
    pub(crate) fn unknown() -> Self {
        Self { station: "a station".into(), process: 0, machine: String::new(), since: String::new() }
    }

    /// Writes the file in the state folder.
    pub(crate) fn write(&self, state: &Path) -> std::io::Result<()> {
        write_whole_unsynced(state, HOLDER, self.to_lines().as_bytes())
    }

    /// Reads the file in the state folder.
    pub(crate) fn read(state: &Path) -> Option<Self> {
        let bytes = read_if_there(&state.join(HOLDER)).ok()??;
        Self::from_lines(&String::from_utf8_lossy(&bytes))
    }

    fn to_lines(&self) -> String {
        let quoted = |text: &str| text.replace(['"', '\\'], "'");
        format!(
            "station = \"{}\"\nprocess = {}\nmachine = \"{}\"\nsince = {}\n",
            quoted(&self.station),
            self.process,
            quoted(&self.machine),
            self.since
        )
    }

    /// `None` for a file that [`Holder::to_lines`] did not write.
    fn from_lines(text: &str) -> Option<Self> {
        let value = |key: &str| {
            let line = text.lines().find_map(|line| line.strip_prefix(key)?.trim_start().strip_prefix('='));
            line.map(|value| value.trim().trim_matches('"').to_owned())
        };
        Some(Self {
            station: value("station")?,
            process: value("process")?.parse().ok()?,
            machine: value("machine")?,
            since: value("since")?,
        })
    }
}

impl Display for Holder {
    fn fmt(&self, out: &mut Formatter<'_>) -> std::fmt::Result {
        write!(out, "process {}", self.process)?;
        if !self.machine.is_empty() {
            write!(out, " on {}", self.machine)?;
        }
        write!(out, " as \"{}\" since {}", self.station, self.since)
    }
}

/// The machine's name, on systems that keep it in a file; empty elsewhere.
fn machine() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    name.trim().to_owned()
}
