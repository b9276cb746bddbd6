//! Names and messages as a terminal, a log and a page may show them: what does not print is spelled out.
//!
//! A file's name and a layer's name may hold anything. Written as it is, a control character moves the cursor or colours
//! the screen, a line break forges a line, and a character of direction or of no width makes one name look like another.

/// The text on one line, every character in it visible: line breaks and all others that do not print as `\u{1b}`, `\n`.
///
/// ```
/// use isomark::printable::on_one_line;
/// assert_eq!(on_one_line("logo\u{202e}fxd.\n"), "logo\\u{202e}fxd.\\n");
/// ```
pub fn on_one_line(text: &str) -> String {
    spelled(text, does_not_print)
}

/// The same for a text of several lines, whose own line breaks stay.
pub fn on_lines(text: &str) -> String {
    spelled(text, |letter| letter != '\n' && does_not_print(letter))
}

fn spelled(text: &str, is_spelled: impl Fn(char) -> bool) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match is_spelled(letter) {
            true => out.extend(letter.escape_default()),
            false => out.push(letter),
        }
    }
    out
}

fn does_not_print(letter: char) -> bool {
    letter.is_control() || matches!(letter, '\u{2028}' | '\u{2029}') || is_invisible(letter)
}

/// Whether the letter has neither shape nor width: joiners, marks, embeddings, overrides and isolates of direction, soft
/// hyphens, tags, byte order marks (Unicode, chapter 23, "Special areas and format characters").
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
    fn what_does_not_print_is_spelled_out_and_the_rest_stays() {
        let sound = "Größe 日本 «x» C:\\laser\u{301} 🙂 50 %";
        assert_eq!(on_one_line(sound), sound);
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
