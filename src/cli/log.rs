//! The station's log: lines on standard error, and in a file of limited size.

use std::fs::File;
use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::sync::Mutex;

use fs_err as fs;
use tracing_subscriber::field::MakeExt;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt::FormatFields;
use tracing_subscriber::fmt::format::debug_fn;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{Layer, fmt as lines};

use super::progress::StandardError;
use crate::config::LogSettings;
use crate::hotfolder::is_still_at;
use crate::printable::on_one_line;

/// Lines for people on standard error and in the file, if there is one; `RUST_LOG` chooses others.
///
/// # Errors
/// When the file cannot be opened.
pub(super) fn start(file: Option<&LogSettings>) -> std::io::Result<()> {
    let chosen = std::env::var("RUST_LOG").ok().filter(|chosen| !chosen.is_empty());
    let filter = chosen
        .and_then(|chosen| chosen.parse().ok())
        .unwrap_or_else(|| Targets::new().with_target("isomark", LevelFilter::INFO));
    let set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    // A log that cannot be written (full disk, closed pipe) must not end the station.
    let to_people = lines::layer()
        .fmt_fields(one_line())
        .with_target(false)
        .with_ansi(std::io::stderr().is_terminal() && !set("NO_COLOR"))
        .with_writer(|| StandardError)
        .log_internal_errors(false);
    // The system's journal adds the time itself.
    let to_people = if set("JOURNAL_STREAM") { to_people.without_time().boxed() } else { to_people.boxed() };
    let to_file = file.map(RotatingFile::open).transpose()?.map(|file| {
        lines::layer()
            .fmt_fields(one_line())
            .with_target(false)
            .with_ansi(false)
            .with_writer(Mutex::new(file))
            .log_internal_errors(false)
    });
    // Only tests start a second log in one process; the first one is kept.
    let _ = tracing_subscriber::registry().with(filter).with(to_people).with(to_file).try_init();
    Ok(())
}

/// An event's message and values on one line, with what does not print spelled out, so a name cannot forge a line.
fn one_line() -> impl for<'w> FormatFields<'w> + 'static {
    debug_fn(|out, field, value| {
        let value = on_one_line(&format!("{value:?}"));
        match field.name() {
            "message" => write!(out, "{value}"),
            name => write!(out, "{name}={value}"),
        }
    })
    .delimited(" ")
}

/// A log file that is started again when it is full; older ones are `<file>.1`, `<file>.2` and so on.
struct RotatingFile {
    settings: LogSettings,
    /// Closed while files are renamed, which Windows refuses to do with an open one.
    file: Option<File>,
    size: u64,
    /// At this size the file is started again, bytes.
    full: u64,
}

impl RotatingFile {
    fn open(settings: &LogSettings) -> std::io::Result<Self> {
        let (settings, full) = (settings.clone(), settings.largest);
        let mut log = Self { settings, file: None, size: 0, full };
        log.reopen()?;
        Ok(log)
    }

    fn reopen(&mut self) -> std::io::Result<&mut File> {
        if let Some(folder) = self.settings.file.parent() {
            fs::create_dir_all(folder)?;
        }
        let file = fs::OpenOptions::new().create(true).append(true).open(&self.settings.file)?;
        self.size = file.metadata()?.len();
        Ok(self.file.insert(file.into_parts().0))
    }

    fn older(&self, number: usize) -> PathBuf {
        let mut name = self.settings.file.clone().into_os_string();
        name.push(format!(".{number}"));
        name.into()
    }

    /// A file that cannot be renamed, because an editor holds it, keeps growing: an older file is only removed for a newer
    /// one. The next attempt is made after as many bytes again.
    fn rotate(&mut self) {
        self.file = None;
        let aside = self.older(0);
        // A file that is there already was put aside when the others could not be renamed.
        let put_aside = if aside.exists() { Ok(()) } else { fs::rename(&self.settings.file, &aside) };
        self.full = match put_aside.and_then(|()| self.move_on()) {
            Ok(()) => self.settings.largest,
            Err(_) => self.size + self.settings.largest,
        };
    }

    /// Gives the file that was put aside, and those before it, the next numbers up to the first free one.
    fn move_on(&self) -> std::io::Result<()> {
        let keep = self.settings.keep;
        let free = (1..keep).find(|number| !self.older(*number).exists()).unwrap_or(keep);
        (0..free).rev().try_for_each(|number| fs::rename(self.older(number), self.older(number + 1)))
    }

    /// Closes a file that was removed or moved while it was open, so that the next line starts another.
    fn keep_in_place(&mut self) {
        if self.file.as_ref().is_some_and(|file| !is_still_at(file, &self.settings.file)) {
            (self.file, self.full) = (None, self.settings.largest);
        }
    }
}

impl Write for RotatingFile {
    fn write(&mut self, line: &[u8]) -> std::io::Result<usize> {
        self.keep_in_place();
        if self.size > 0 && self.size + line.len() as u64 > self.full {
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
    fn a_log_stays_small_and_loses_only_its_oldest_lines() {
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

    /// An older file is only removed for a newer one, whichever of them another program holds.
    #[test]
    fn a_file_that_cannot_be_renamed_costs_no_older_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = |ending: &str| folder.path().join(format!("station.log{ending}"));
        let text = |ending: &str| fs::read_to_string(path(ending)).unwrap_or_default();
        let settings = LogSettings { file: path(""), largest: 30, keep: 2 };
        fs::write(path(".1"), "older\n").unwrap();
        // Over a folder no file is renamed.
        fs::create_dir_all(path(".2").join("held")).unwrap();
        let mut log = RotatingFile::open(&settings).unwrap();
        let mut lines = (0..).map(|number| format!("line {number} of ten\n"));
        let mut all = String::new();
        let mut write = |log: &mut RotatingFile, count: usize| {
            for line in lines.by_ref().take(count) {
                log.write_all(line.as_bytes()).unwrap();
                all += &line;
            }
            all.clone()
        };
        let all = write(&mut log, 8);
        assert_eq!(text(".1"), "older\n");
        assert_eq!(text(".0") + &text(""), all);
        // It continues normally when the file is free.
        fs::remove_dir_all(path(".2")).unwrap();
        let all = write(&mut log, 6);
        assert_eq!(text(".0"), "");
        assert!(all.ends_with(&(text(".2") + &text(".1") + &text(""))) && !text(".2").is_empty());
    }

    #[cfg(windows)]
    #[test]
    fn a_log_that_an_editor_holds_grows_and_is_started_again_later() {
        use std::os::windows::fs::OpenOptionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = |ending: &str| folder.path().join(format!("station.log{ending}"));
        let settings = LogSettings { file: path(""), largest: 30, keep: 2 };
        for ending in [".1", ".2"] {
            fs::write(path(ending), ending).unwrap();
        }
        let mut log = RotatingFile::open(&settings).unwrap();
        // Others may read and write it, and not rename it.
        let held = std::fs::OpenOptions::new().read(true).share_mode(3).open(path("")).unwrap();
        for _ in 0..4 {
            log.write_all(b"line 0 of ten\n").unwrap();
        }
        assert_eq!([".1", ".2"].map(|ending| fs::read_to_string(path(ending)).unwrap()), [".1", ".2"]);
        drop(held);
        for _ in 0..2 {
            log.write_all(b"line 0 of ten\n").unwrap();
        }
        assert_eq!(fs::read_to_string(path(".2")).unwrap(), ".1");
    }

    /// Windows removes no folder with an open file in it.
    #[cfg(unix)]
    #[test]
    fn a_log_that_was_removed_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        let settings = LogSettings { file: folder.path().join("log/station.log"), largest: 300, keep: 2 };
        let mut log = RotatingFile::open(&settings).unwrap();
        log.write_all(b"before\n").unwrap();
        fs::remove_dir_all(folder.path().join("log")).unwrap();
        log.write_all(b"after\n").unwrap();
        assert_eq!(fs::read_to_string(&settings.file).unwrap(), "after\n");
    }
}
