//! What `calibrate` and `register` have in common: the settings that they find, printed and entered into a file.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use super::named_files::{file_trouble, write_file};
use super::outcome::{Exit, Failure, Outcome, shown};
use crate::config::{ConfigError, NewValue, edited};
use crate::printable::on_one_line;
use crate::reason::{Notice, Reason, Severity};

/// A key of a table with its new value.
pub(super) type Change = (&'static str, NewValue);

/// Enters the changes into a settings file, if `check` accepts the text. A file that does not exist is made.
pub(super) fn write(
    file: &Path,
    table: &str,
    changes: &[Change],
    check: impl FnOnce(&str) -> Result<(), ConfigError>,
) -> Outcome {
    let bytes = crate::files::read_if_there(file).map_err(|error| file_trouble("read", file, &error))?;
    let old = String::from_utf8_lossy(bytes.as_deref().unwrap_or_default()).into_owned();
    let new = edited(&old, table, changes).map_err(|what| {
        let reason = Reason::new("usage", what, "Correct the file, or enter the lines by hand.");
        Failure::new(Exit::Usage, reason.in_file(file.display().to_string()))
    })?;
    check(&new)?;
    if new == old { Ok(()) } else { write_file(file, new.as_bytes()) }
}

/// The name of a file for a settings file: relative to it if it is in the same folder or below, otherwise complete.
pub(super) fn beside(settings: &Path, file: &Path) -> Result<String, Failure> {
    let full = |path: &Path| std::path::absolute(path).map_err(|error| Failure::environment(&error));
    let file: PathBuf = full(file)?;
    let folder = full(settings)?;
    let name = folder.parent().and_then(|folder| file.strip_prefix(folder).ok()).unwrap_or(&file);
    name.to_str().map(|name| name.replace('\\', "/")).ok_or_else(|| {
        Failure::usage(
            format!("{} cannot be written into settings.", shown(name)),
            "Choose a name in Unicode.",
        )
    })
}

/// Adds the notices for people.
pub(super) fn add_notices(text: &mut String, notices: &[Notice]) {
    for notice in notices {
        let kind = if notice.severity == Severity::Warning { "warning" } else { "note" };
        let _ = writeln!(text, "\n  {kind}: {} [{}]", on_one_line(&notice.message), notice.code);
    }
}

/// Adds the lines for the settings file, or states that they were written into it.
pub(super) fn add_lines(text: &mut String, written: Option<&Path>, table: &str, lines: &[String]) {
    let head = match written {
        Some(file) => format!("Written into {}:", shown(file)),
        None => "Lines for the settings (`--write` enters them):".to_owned(),
    };
    let _ = write!(text, "\n{head}\n\n[{table}]\n{}\n", lines.join("\n"));
}
