//! Commands that people may copy from what is printed.

use std::path::Path;

use crate::printable::on_one_line;
use crate::reason::quoted;

/// A command of this program on one line, as it can be typed here: with the program's name, or with the path by which it was
/// started.
pub(super) fn command(arguments: &[&str]) -> String {
    let program = std::env::args_os().next().filter(|name| !name.is_empty());
    let program = program.map_or_else(|| "isomark".to_owned(), |name| name.to_string_lossy().into_owned());
    let words = [program.as_str()].into_iter().chain(arguments.iter().copied());
    // A name with line breaks or marks of direction can only be shown, not typed.
    on_one_line(&words.map(quoted).collect::<Vec<_>>().join(" "))
}

/// A path as an argument of a command; one that looks like an option comes with its folder.
pub(super) fn path(path: &Path) -> String {
    let path = path.display().to_string();
    if path.starts_with('-') { format!(".{}{path}", std::path::MAIN_SEPARATOR) } else { path }
}
