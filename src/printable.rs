//! Names and messages for terminals, logs and pages: non-printing characters are escaped.
//!
//! The name of a file or a layer may contain any character. Without escaping, a control character could move the
//! cursor or colour the screen, a line break could forge a line, and a direction mark or a zero-width character could
//! make one name look like another.

/// The text on one line with every character visible: line breaks and other non-printing characters are escaped as
/// `\n`, `\u{1b}`.
///
/// ```
/// use isomark::printable::on_one_line;
/// assert_eq!(on_one_line("logo\u{202e}fxd.\n"), "logo\\u{202e}fxd.\\n");
/// ```
pub fn on_one_line(text: &str) -> String {
    escaped(text, is_nonprinting)
}

/// The same for a text of several lines: its line breaks are kept.
#[must_use]
pub fn on_lines(text: &str) -> String {
    escaped(text, |letter| letter != '\n' && is_nonprinting(letter))
}

fn escaped(text: &str, is_escaped: impl Fn(char) -> bool) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match is_escaped(letter) {
            true => out.extend(letter.escape_default()),
            false => out.push(letter),
        }
    }
    out
}

fn is_nonprinting(letter: char) -> bool {
    letter.is_control() || matches!(letter, '\u{2028}' | '\u{2029}') || is_invisible(letter)
}

/// Whether the character has neither shape nor width: joiners, direction marks, embeddings, overrides and isolates,
/// soft hyphens, tags, byte order marks (Unicode, chapter 23, "Special areas and format characters").
#[must_use]
pub fn is_invisible(letter: char) -> bool {
    matches!(
        letter,
        '\u{ad}'
            | '\u{61c}'
            | '\u{180e}'
            | '\u{200b}'..='\u{200f}'
            | '\u{202a}'..='\u{202e}'
            | '\u{2060}'..='\u{206f}'
            | '\u{feff}'
            | '\u{fff9}'..='\u{fffb}'
            | '\u{e0000}'..='\u{e007f}'
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nonprinting_characters_are_escaped_and_all_others_kept() {
        let printing = "Größe 日本 «x» C:\\laser\u{301} 🙂 50 %";
        assert_eq!(on_one_line(printing), printing);
        for letter in (0..0x20).chain(0x7f..0xa0).filter_map(char::from_u32) {
            assert!(on_one_line(&letter.to_string()).is_ascii(), "{letter:?}");
            assert!(!on_one_line(&letter.to_string()).contains(letter), "{letter:?}");
        }
        for letter in
            "\u{200b}\u{200d}\u{200e}\u{200f}\u{61c}\u{2028}\u{2029}\u{202a}\u{202e}\u{2066}\u{2069}\u{feff}"
                .chars()
        {
            assert_eq!(on_one_line(&letter.to_string()), format!("\\u{{{:x}}}", u32::from(letter)));
        }
        assert_eq!(on_lines("a\nb\r\u{1b}[2J\n"), "a\nb\\r\\u{1b}[2J\n");
    }
}
