//! The page: SVG elements with fixed number formatting, so that equal previews have equal bytes.

use std::fmt::{Arguments, Write};

use crate::printable::on_one_line;

/// Colour of headings and correct lengths.
pub(super) const DARK: &str = "#111827";
/// Colour of explanations.
pub(super) const QUIET: &str = "#5b6472";
/// Colour of frames and rules.
pub(super) const FAINT: &str = "#b4bcc8";

/// An SVG document under construction; lengths in mm of paper, y downwards.
#[derive(Default)]
pub(super) struct Page {
    body: String,
}

/// The style of a text.
#[derive(Clone, Copy)]
pub(super) struct Type {
    /// Height of the font, mm.
    pub(super) size: f64,
    pub(super) color: &'static str,
    pub(super) bold: bool,
    pub(super) anchor: Anchor,
}

/// The point of the text that is at its position.
#[derive(Clone, Copy)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

impl Type {
    pub(super) const fn new(size: f64, color: &'static str) -> Self {
        Self { size, color, bold: false, anchor: Anchor::Start }
    }

    pub(super) const fn bold(self) -> Self {
        Self { bold: true, ..self }
    }

    pub(super) const fn anchored(self, anchor: Anchor) -> Self {
        Self { anchor, ..self }
    }

    /// An upper bound of the text's width, mm: that of a wide sans-serif, because the viewer's font is not known.
    pub(super) fn width(&self, text: &str) -> f64 {
        let per_letter = if self.bold { 0.66 } else { 0.58 };
        text.chars().count() as f64 * per_letter * self.size
    }

    /// The text, shortened with an ellipsis if it is wider than `width` mm.
    pub(super) fn shortened(&self, text: &str, width: f64) -> String {
        if self.width(text) <= width {
            return text.to_owned();
        }
        let letters = (width / self.width("n")).floor().max(1.0) as usize;
        text.chars().take(letters - 1).chain(['…']).collect()
    }

    /// The text in lines of at most `width` mm, broken between words; what is in brackets, such as coordinates, stays together.
    pub(super) fn wrapped(&self, text: &str, width: f64) -> Vec<String> {
        let mut lines: Vec<String> = Vec::new();
        for word in words(text) {
            match lines.last_mut() {
                Some(line) if self.width(line) + self.width(&word) + self.width(" ") <= width => {
                    line.push(' ');
                    line.push_str(&word);
                }
                _ => lines.push(self.shortened(&word, width)),
            }
        }
        lines
    }
}

/// The words of a text; words in brackets are one.
fn words(text: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match words.last_mut() {
            Some(open) if open.matches('(').count() > open.matches(')').count() => {
                open.push(' ');
                open.push_str(word);
            }
            _ => words.push(word.to_owned()),
        }
    }
    words
}

impl Page {
    /// Adds an element without escaping.
    pub(super) fn add(&mut self, element: Arguments<'_>) {
        // Writing into a String cannot fail.
        let _ = writeln!(self.body, "{element}");
    }

    /// Adds text with its baseline at (x, y), anchored as the style says.
    pub(super) fn text(&mut self, at: [f64; 2], style: Type, text: &str) {
        let weight = if style.bold { " font-weight=\"bold\"" } else { "" };
        let anchor = match style.anchor {
            Anchor::Start => "",
            Anchor::Middle => " text-anchor=\"middle\"",
            Anchor::End => " text-anchor=\"end\"",
        };
        self.add(format_args!(
            "<text x=\"{}\" y=\"{}\" font-size=\"{}\" fill=\"{}\"{weight}{anchor}>{}</text>",
            number(at[0]),
            number(at[1]),
            number(style.size),
            style.color,
            escaped(text)
        ));
    }

    /// Adds a straight line, `width` mm thick.
    pub(super) fn line(&mut self, from: [f64; 2], to: [f64; 2], color: &str, width: f64) {
        self.add(format_args!(
            "<path d=\"M{} {}L{} {}\" stroke=\"{color}\" stroke-width=\"{}\"/>",
            number(from[0]),
            number(from[1]),
            number(to[0]),
            number(to[1]),
            number(width)
        ));
    }

    /// Adds a rectangle with its upper left corner at `at`; `paint` contains its fill and stroke attributes.
    pub(super) fn rect(&mut self, at: [f64; 2], size: [f64; 2], paint: &str) {
        self.add(format_args!(
            "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" {paint}/>",
            number(at[0]),
            number(at[1]),
            number(size[0]),
            number(size[1])
        ));
    }

    /// The finished document of the given size: one user unit is one mm, and it prints at that size.
    pub(super) fn finished(self, title: &str, size: [f64; 2]) -> String {
        let [width, height] = size.map(number);
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
             <svg xmlns=\"http://www.w3.org/2000/svg\" xmlns:xlink=\"http://www.w3.org/1999/xlink\" \
             width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"sans-serif\" fill=\"none\" stroke-linecap=\"round\" stroke-linejoin=\"round\">\n\
             <title>{}</title>\n<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n{}</svg>\n",
            escaped(title),
            self.body
        )
    }
}

/// The data of an SVG path: relative steps in thousandths of a user unit, without accumulated rounding errors.
#[derive(Default)]
pub(super) struct PathData {
    text: String,
    pen: Option<[i64; 2]>,
}

impl PathData {
    /// Draws through the points of the drawing (mm, y upwards).
    pub(super) fn polyline(&mut self, points: &[[f64; 2]]) {
        let mut points = points.iter().map(|[x, y]| [thousandths(*x), thousandths(-*y)]);
        let Some(first) = points.next() else { return };
        self.step('m', first);
        let mut drawn = false;
        for point in points {
            if self.pen != Some(point) {
                self.step('l', point);
                drawn = true;
            }
        }
        if !drawn {
            // A line without length is drawn as a round spot.
            self.text.push_str("h0");
        }
    }

    /// Draws a closed polygon through the points of the drawing (mm, y upwards).
    pub(super) fn polygon(&mut self, points: &[[f64; 2]]) {
        let Some(first) = points.first() else { return };
        self.polyline(points);
        self.text.push('z');
        self.pen = Some([thousandths(first[0]), thousandths(-first[1])]);
    }

    /// Whether nothing was drawn.
    pub(super) fn is_empty(&self) -> bool {
        self.text.is_empty()
    }

    /// The value of the `d` attribute.
    pub(super) fn text(&self) -> &str {
        &self.text
    }

    fn step(&mut self, command: char, point: [i64; 2]) {
        let [from_x, from_y] = self.pen.unwrap_or_default();
        self.text.push(command);
        push_thousandths(&mut self.text, point[0] - from_x);
        if point[1] >= from_y {
            self.text.push(' ');
        }
        push_thousandths(&mut self.text, point[1] - from_y);
        self.pen = Some(point);
    }
}

/// A number with at most three decimals.
pub(super) fn number(value: f64) -> String {
    let mut text = String::new();
    push_thousandths(&mut text, thousandths(value));
    text
}

/// Text escaped for XML content and attributes; non-printing characters are escaped, and characters that XML does not
/// allow are omitted.
pub(crate) fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in on_one_line(text).chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            '\u{fffe}' | '\u{ffff}' => {}
            other => escaped.push(other),
        }
    }
    escaped
}

fn thousandths(value: f64) -> i64 {
    (value * 1000.0).round() as i64
}

fn push_thousandths(text: &mut String, thousandths: i64) {
    if thousandths < 0 {
        text.push('-');
    }
    let magnitude = thousandths.unsigned_abs();
    let (whole, mut rest) = (magnitude / 1000, magnitude % 1000);
    if whole > 0 || rest == 0 {
        // Writing into a String cannot fail.
        let _ = write!(text, "{whole}");
    }
    if rest > 0 {
        text.push('.');
    }
    let mut place = 100;
    while rest > 0 {
        text.push(char::from(b'0' + (rest / place) as u8));
        (rest, place) = (rest % place, place / 10);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_never_negative_zero() {
        let cases =
            [(0.0, "0"), (-0.0001, "0"), (12.0, "12"), (-0.25, "-.25"), (7.12345, "7.123"), (100.1, "100.1")];
        for (value, text) in cases {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn path_data_has_no_accumulated_rounding_errors() {
        let mut data = PathData::default();
        data.polygon(&[[0.0, 0.0], [1.0 / 3.0, 0.0], [2.0 / 3.0, -0.5]]);
        data.polyline(&[[1.0, 1.0], [1.0, 1.0]]);
        assert_eq!(data.text(), "m0 0l.333 0l.334 .5zm1-1h0");
    }

    #[test]
    fn markup_in_names_is_escaped() {
        assert_eq!(escaped("a<b> & \"c\" d's"), "a&lt;b&gt; &amp; &quot;c&quot; d&#39;s");
        assert_eq!(escaped("a\u{1}\n\u{202e}b\u{ffff}"), "a\\u{1}\\n\\u{202e}b");
    }

    #[test]
    fn long_text_is_wrapped_between_words() {
        let style = Type::new(2.0, DARK);
        assert_eq!(style.wrapped("one two three", style.width("one two")), ["one two", "three"]);
        let pair = "at (-2.3, 54.6) mm";
        assert_eq!(style.wrapped(pair, style.width("at (-2.3,")), ["at", "(-2.3, 5…", "mm"]);
        assert_eq!(style.wrapped(pair, style.width("(-2.3, 54.6)")), ["at", "(-2.3, 54.6)", "mm"]);
        assert_eq!(style.shortened("abcdefgh", style.width("abcd")), "abc…");
    }
}
