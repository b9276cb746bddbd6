//! Quoting for commands that isomark prints and people copy into a shell.

/// The word, quoted for the shell of the operating system.
pub(crate) fn quoted(word: &str) -> String {
    if cfg!(windows) { quoted_for_windows(word) } else { quoted_for_posix(word) }
}

/// For the command prompt and PowerShell. Windows file names cannot contain a quotation mark.
fn quoted_for_windows(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || r"\/:._-+~".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) { word.to_owned() } else { format!("\"{word}\"") }
}

/// For POSIX shells (IEEE 1003.1, 2.2.2): between single quotes, every character except the closing quote is literal.
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
    fn words_with_special_characters_are_quoted() {
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

    /// Checked with the real shell.
    #[cfg(unix)]
    #[test]
    fn the_shell_returns_a_quoted_word_unchanged() {
        for word in
            ["line 1", "L'1", "a&b;c|d", "$HOME `id` \\", "~", "*", "two\nlines", "#x", "!1", "\"", "é"]
        {
            let script = format!("printf %s {}", quoted(word));
            let output = std::process::Command::new("sh").args(["-c", &script]).output().unwrap();
            assert_eq!(String::from_utf8(output.stdout).unwrap(), word);
        }
    }
}
