//! Words of commands that people copy from what is printed.

/// A word as the shell of the system takes it.
pub(crate) fn quoted(word: &str) -> String {
    if cfg!(windows) { quoted_for_windows(word) } else { quoted_for_posix(word) }
}

/// For the command prompt and PowerShell: no file name holds the quotation mark.
fn quoted_for_windows(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || r"\/:._-+~".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) { word.to_owned() } else { format!("\"{word}\"") }
}

/// For the shell of POSIX (IEEE 1003.1, 2.2.2): between single quotes nothing has a meaning but their end.
fn quoted_for_posix(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "/:._-+=@%,".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_with_a_meaning_to_the_shell_are_quoted() {
        for (word, posix, windows) in [
            ("line1/station.toml", "line1/station.toml", "line1/station.toml"),
            ("line 1/station.toml", "'line 1/station.toml'", "\"line 1/station.toml\""),
            ("L'1", r"'L'\''1'", "\"L'1\""),
            ("a&b", "'a&b'", "\"a&b\""),
            ("$HOME", "'$HOME'", "\"$HOME\""),
            ("~x", "'~x'", "~x"),
            (r"C:\l1\s.toml", r"'C:\l1\s.toml'", r"C:\l1\s.toml"),
            ("", "''", "\"\""),
        ] {
            assert_eq!((&*quoted_for_posix(word), &*quoted_for_windows(word)), (posix, windows));
        }
    }

    /// The shell itself is the judge.
    #[cfg(unix)]
    #[test]
    fn the_shell_takes_a_quoted_word_for_what_it_is() {
        for word in
            ["line 1", "L'1", "a&b;c|d", "$HOME `id` \\", "~", "*", "two\nlines", "#x", "!1", "\"", "é"]
        {
            let script = format!("printf %s {}", quoted(word));
            let said = std::process::Command::new("sh").args(["-c", &script]).output().unwrap();
            assert_eq!(String::from_utf8(said.stdout).unwrap(), word);
        }
    }
}
