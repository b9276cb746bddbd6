//! The line of a settings file that is wrong, with carets under the place.

use std::io::IsTerminal;

use annotate_snippets::{AnnotationKind, Group, Level, Renderer, Snippet};

use crate::config::{ConfigError, Spot};
use crate::printable::on_one_line;

/// A line with a place in it.
#[derive(Debug)]
pub(super) struct MarkedLine {
    number: usize,
    before: String,
    marked: String,
    after: String,
}

impl MarkedLine {
    /// The line that an error is about, if it is about one.
    pub(super) fn of(error: &ConfigError) -> Option<Self> {
        let Spot::File { line, column, excerpt, .. } = error.spot()? else { return None };
        // A table that is missing has no place, and its error starts where the file starts.
        if matches!(error, ConfigError::Missing { .. }) && (*line, *column) == (1, 1) {
            return None;
        }
        let (before, rest) = excerpt.line.split_at_checked(excerpt.marked.start)?;
        let (marked, after) = rest.split_at_checked(excerpt.marked.len())?;
        let printable = |text: &str| on_one_line(&text.replace('\t', "    "));
        Some(Self {
            number: usize::try_from(*line).ok()?,
            before: printable(before),
            marked: printable(marked),
            after: printable(after),
        })
    }

    /// The line as it is drawn on standard error; in colour on a terminal.
    pub(super) fn for_standard_error(&self) -> String {
        let no_colour = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        let styled = std::io::stderr().is_terminal() && !no_colour;
        self.drawn(if styled { Renderer::styled() } else { Renderer::plain() })
    }

    fn drawn(&self, renderer: Renderer) -> String {
        let Self { number, before, marked, after } = self;
        let place = before.len()..before.len() + marked.len();
        let snippet = Snippet::source(format!("{before}{marked}{after}"))
            .line_start(*number)
            .annotation(AnnotationKind::Primary.span(place));
        renderer.render(&[Group::with_level(Level::ERROR).element(snippet)])
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::config::Station;

    fn drawn(text: &str) -> String {
        let error = Station::parse(Path::new("station.toml"), text).unwrap_err();
        MarkedLine::of(&error).map(|line| line.drawn(Renderer::plain())).unwrap_or_default()
    }

    #[test]
    fn carets_are_under_the_key_or_the_value_that_is_wrong() {
        let key = drawn("[station]\nname = \"a\"\n[folders]\nhot = \"hot\"\n  improt = \"import\"\n");
        assert_eq!(key, "  |\n5 |   improt = \"import\"\n  |   ^^^^^^");
        let value = drawn("[station]\nname = 5 # laser\n");
        assert_eq!(value, "  |\n2 | name = 5 # laser\n  |        ^");
        let end = drawn("[station]\nname = \n");
        assert_eq!(end, "  |\n2 | name = \n  |        ^");
        assert_eq!(drawn(""), "", "a missing table has no line");
    }

    /// Carets stand under what is seen, and nothing in the file moves the cursor.
    #[test]
    fn what_does_not_print_is_spelled_out_and_wide_letters_take_their_width() {
        let hidden = drawn("[station]\n\"na\u{202e}me\" = \t5\n");
        assert!(hidden.contains("\"na\\u{202e}me\" =     5") && hidden.is_ascii(), "{hidden}");
        let wide = drawn("[station]\n\"日本\" = 1 # é\n");
        assert_eq!(wide, "  |\n2 | \"日本\" = 1 # é\n  | ^^^^^^");
    }
}
