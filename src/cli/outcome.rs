//! How a command ends, and what it prints.

use std::io::{ErrorKind, Write};
use std::path::Path;

use super::marked_line::MarkedLine;
use super::progress::in_place_of_line;
use crate::config::ConfigError;
use crate::pipeline::PipelineError;
use crate::printable::{on_lines, on_one_line};
use crate::reason::Reason;

/// The exit code of the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// Done.
    Done = 0,
    /// The input was rejected.
    Rejected = 1,
    /// The command line or the settings are wrong.
    Usage = 2,
    /// The environment failed: disk, permission.
    Environment = 3,
}

/// Why a command ended without its result.
#[derive(Debug)]
pub(super) struct Failure {
    pub(super) exit: Exit,
    pub(super) reason: Reason,
    /// The line of a settings file that is wrong, as it is drawn for people.
    line: Option<MarkedLine>,
}

pub(super) type Outcome = Result<(), Failure>;

impl Failure {
    pub(super) fn new(exit: Exit, reason: Reason) -> Self {
        Self { exit, reason, line: None }
    }

    pub(super) fn rejected(reason: Reason) -> Self {
        Self::new(Exit::Rejected, reason)
    }

    /// Writes the failure to people on standard error.
    pub(super) fn tell(&self) {
        tell(&format!("isomark: {}", self.reason.to_text()));
        if let Some(line) = &self.line {
            tell_drawn(&line.for_standard_error());
        }
    }

    pub(super) fn usage(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::new(Exit::Usage, Reason::new("usage", what, remedy))
    }

    pub(super) fn environment(error: &std::io::Error) -> Self {
        let remedy = "Check that the file or folder exists, that it may be read or written, and that the disk is not full.";
        Self::new(Exit::Environment, Reason::new("environment", format!("{error}."), remedy))
    }
}

impl From<ConfigError> for Failure {
    /// A file that does not exist, or cannot be settings, is a mistake of the command line: trying again does not help.
    fn from(error: ConfigError) -> Self {
        use ErrorKind::{InvalidData, IsADirectory, NotADirectory, NotFound};
        let wrong = |kind| matches!(kind, NotFound | InvalidData | IsADirectory | NotADirectory);
        let exit = match &error {
            ConfigError::Unreadable { file, source } if !wrong(source.kind()) && !file.is_dir() => {
                Exit::Environment
            }
            ConfigError::NoSkuFiles { source, .. } if !wrong(source.kind()) => Exit::Environment,
            _ => Exit::Usage,
        };
        Self { exit, reason: error.reason(), line: MarkedLine::of(&error) }
    }
}

impl From<PipelineError> for Failure {
    fn from(error: PipelineError) -> Self {
        match error {
            PipelineError::Rejected(reason) => Self::rejected(reason),
            // A single job has all the time it needs.
            error @ PipelineError::TakesLong => {
                Self::rejected(Reason::new("takes-long", format!("{error}."), "Try again."))
            }
            PipelineError::Environment(error) => Self::environment(&error),
        }
    }
}

/// Writes to people on standard output; a closed one is no error. Names from files must already be on one line
/// ([`on_one_line`], [`shown`]); all other characters that do not print are spelled out here.
pub(super) fn print(text: &str) {
    write_out(&on_lines(text));
}

/// Writes a document for programs to standard output, unchanged; a closed one is no error.
pub(super) fn print_json(text: &str) {
    write_out(text);
}

fn write_out(text: &str) {
    let mut out = std::io::stdout().lock();
    let _ = in_place_of_line(|| out.write_all(text.as_bytes()).and_then(|()| out.flush()));
}

/// Writes a line to people on standard error, with what does not print spelled out as in [`print()`]; a closed one is no
/// error.
pub(super) fn tell(text: &str) {
    tell_drawn(&on_lines(text));
}

/// Writes to people on standard error what is drawn for a terminal, with its colours.
fn tell_drawn(text: &str) {
    let _ = in_place_of_line(|| writeln!(std::io::stderr().lock(), "{text}"));
}

/// A path as people are shown it.
pub(super) fn shown(path: &Path) -> String {
    on_one_line(&path.display().to_string())
}
