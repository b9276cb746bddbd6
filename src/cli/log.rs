//! What a station says, as lines: on standard error, and in a file that is kept small.

use std::fs::File;
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::sync::Mutex;

use fs_err as fs;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer, fmt as lines};

use crate::config::LogSettings;

/// Lines for people on standard error and in the file, if there is one; `RUST_LOG` chooses others.
///
/// # Errors
/// When the file cannot be opened.
pub(super) fn start(file: Option<&LogSettings>) -> std::io::Result<()> {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("isomark=info"));
    let set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    // A log that cannot be written (its disk is full, its reader went) must not end the station.
    let to_people = lines::layer()
        .with_target(false)
        .with_ansi(std::io::stderr().is_terminal() && !set("NO_COLOR"))
        .with_writer(std::io::stderr)
        .log_internal_errors(false);
    // The system's journal has a clock of its own.
    let to_people = if set("JOURNAL_STREAM") { to_people.without_time().boxed() } else { to_people.boxed() };
    let to_file = file.map(RotatingFile::open).transpose()?.map(|file| {
        lines::layer()
            .with_target(false)
            .with_ansi(false)
            .with_writer(Mutex::new(file))
            .log_internal_errors(false)
    });
    // A second log in one process is a test's; the first one goes on.
    let _ = tracing_subscriber::registry().with(filter).with(to_people).with(to_file).try_init();
    Ok(())
}

/// A log file that is begun anew when it has become large; older ones are `<file>.1`, `<file>.2` and so on.
struct RotatingFile {
    settings: LogSettings,
    /// Closed while files are renamed, which Windows refuses to do with an open one.
    file: Option<File>,
    size: u64,
}

impl RotatingFile {
    fn open(settings: &LogSettings) -> std::io::Result<Self> {
        if let Some(folder) = settings.file.parent() {
            fs::create_dir_all(folder)?;
        }
        let mut log = Self { settings: settings.clone(), file: None, size: 0 };
        log.reopen()?;
        Ok(log)
    }

    fn reopen(&mut self) -> std::io::Result<&mut File> {
        let file = fs::OpenOptions::new().create(true).append(true).open(&self.settings.file)?;
        self.size = file.metadata()?.len();
        Ok(self.file.insert(file.into_parts().0))
    }

    fn older(&self, number: usize) -> PathBuf {
        let mut name = self.settings.file.clone().into_os_string();
        name.push(format!(".{number}"));
        name.into()
    }

    /// A file that cannot be renamed goes on growing; that is better than losing lines.
    fn rotate(&mut self) {
        self.file = None;
        for number in (1..self.settings.keep).rev() {
            let _ = fs::rename(self.older(number), self.older(number + 1));
        }
        let _ = fs::rename(&self.settings.file, self.older(1));
    }
}

impl Write for RotatingFile {
    fn write(&mut self, line: &[u8]) -> std::io::Result<usize> {
        if self.size > 0 && self.size + line.len() as u64 > self.settings.largest {
            self.rotate();
        }
        let file = match &mut self.file {
            Some(file) => file,
            None => self.reopen()?,
        };
        file.write_all(line)?;
        self.size += line.len() as u64;
        Ok(line.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_stays_small_and_loses_only_what_is_oldest() {
        let folder = tempfile::tempdir().unwrap();
        let settings = LogSettings { file: folder.path().join("log/station.log"), largest: 30, keep: 2 };
        let mut log = RotatingFile::open(&settings).unwrap();
        for number in 0..10 {
            log.write_all(format!("line {number} of ten\n").as_bytes()).unwrap();
        }
        drop(log);
        // Two lines of 14 bytes in each file, over a restart, too.
        RotatingFile::open(&settings).unwrap().write_all(b"line 10 of ten\n").unwrap();
        let text = |ending: &str| {
            fs::read_to_string(folder.path().join(format!("log/station.log{ending}"))).unwrap_or_default()
        };
        assert_eq!(text(""), "line 10 of ten\n");
        assert_eq!(text(".1"), "line 8 of ten\nline 9 of ten\n");
        assert_eq!(text(".2"), "line 6 of ten\nline 7 of ten\n");
        assert_eq!(text(".3"), "");
    }
}
