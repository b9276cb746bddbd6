//! HTML text: escaping, the frame of the document, and its content security policy.

use std::fmt::Write;
use std::sync::LazyLock;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use crate::preview::escaped;

/// Largest size of a report without the panels and the GLB, bytes.
pub const MAX_FRAME: usize = 60_000;

const SCRIPT: &str = include_str!("viewer.js");
/// The script of all reports with a mark in three dimensions.
static COMPACT_SCRIPT: LazyLock<Allowed> = LazyLock::new(|| Allowed::of(SCRIPT));
/// The style of all reports.
static COMPACT_STYLE: LazyLock<Allowed> = LazyLock::new(|| Allowed::of(&[BASE_STYLE, STYLE].concat()));
/// The style of everything that isomark shows in browsers.
pub(crate) const BASE_STYLE: &str = include_str!("base.css");
const STYLE: &str = include_str!("report.css");
/// Longer texts from files are cut, characters: names and messages are shorter.
const LONGEST_TEXT: usize = 600;

/// An HTML document under construction.
#[derive(Default)]
pub(crate) struct Markup(String);

impl Markup {
    /// Adds markup as it is; it must not contain text from files.
    pub(crate) fn raw(&mut self, markup: &str) -> &mut Self {
        self.0.push_str(markup);
        self
    }

    /// Adds text, escaped.
    pub(crate) fn text(&mut self, text: &str) -> &mut Self {
        self.0.push_str(&safe(text));
        self
    }

    /// Adds text in a typewriter font.
    pub(crate) fn code(&mut self, text: &str) -> &mut Self {
        self.raw("<code>").text(text).raw("</code>")
    }

    /// Adds a heading of a section that is named `id`.
    pub(crate) fn section(&mut self, id: &str, heading: &str, content: impl FnOnce(&mut Self)) {
        let _ = writeln!(self.0, "<section aria-labelledby=\"h-{id}\">\n<h2 id=\"h-{id}\">{heading}</h2>");
        content(self);
        self.raw("</section>\n");
    }

    /// Adds a table of labels and values; empty values are left out.
    pub(super) fn table(&mut self, caption: &str, rows: &[(&str, String)]) {
        let _ = writeln!(self.0, "<table><caption>{caption}</caption><tbody>");
        for (label, value) in rows.iter().filter(|(_, value)| !value.is_empty()) {
            let _ = writeln!(self.0, "<tr><th scope=\"row\">{label}</th><td>{}</td></tr>", safe(value));
        }
        self.raw("</tbody></table>\n");
    }

    /// Adds items, each of them made by `item`, as long as they take at most `bytes` together; `rest` then states how many
    /// are left out.
    pub(super) fn bounded<T>(
        &mut self,
        items: &[T],
        bytes: usize,
        mut item: impl FnMut(&mut Self, &T),
        rest: impl FnOnce(&mut Self, usize),
    ) {
        let start = self.0.len();
        for (index, each) in items.iter().enumerate() {
            let before = self.0.len();
            item(self, each);
            if self.0.len() - start > bytes {
                self.0.truncate(before);
                rest(self, items.len() - index);
                return;
            }
        }
    }

    pub(crate) fn finished(self) -> String {
        self.0
    }
}

impl Write for Markup {
    fn write_str(&mut self, markup: &str) -> std::fmt::Result {
        self.0.push_str(markup);
        Ok(())
    }
}

/// Text from files for HTML content and attributes: escaped, and cut if it is very long.
pub(crate) fn safe(text: &str) -> String {
    match text.char_indices().nth(LONGEST_TEXT) {
        Some((end, _)) => escaped(&text[..end]) + "…",
        None => escaped(text),
    }
}

/// A script or style as it is in a document, and the hash by which its policy allows it.
struct Allowed {
    text: String,
    hash: String,
}

impl Allowed {
    fn of(source: &str) -> Self {
        let text = compact(source);
        Self { hash: hash(&text), text }
    }
}

/// The document with this title and body. `scene` is JSON, and `glb` the mark on the part.
pub(super) fn document(title: &str, body: &str, scene: &serde_json::Value, glb: &[u8]) -> String {
    let Allowed { text: script, hash } = &*COMPACT_SCRIPT;
    // In a script element, `<` could begin its end; in JSON it may be escaped everywhere.
    let scene = scene.to_string().replace('<', "\\u003c");
    let scripts = format!(
        "<script type=\"application/json\" id=\"scene\">{scene}</script>\n\
         <script type=\"application/octet-stream\" id=\"mark-on-part\">{}</script>\n<script>{script}</script>\n",
        STANDARD.encode(glb),
    );
    framed(title, &format!("script-src '{hash}'; "), body, &scripts)
}

/// The document with this title and body, without a script.
pub(super) fn flat_document(title: &str, body: &str) -> String {
    framed(title, "", body, "")
}

/// A document whose policy also contains `policy`, and whose body ends with `scripts`.
fn framed(title: &str, policy: &str, body: &str, scripts: &str) -> String {
    let Allowed { text: style, hash } = &*COMPACT_STYLE;
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; {policy}style-src '{hash}'; \
         img-src data:; base-uri 'none'; form-action 'none'\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<meta name=\"referrer\" content=\"no-referrer\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>{}</title>\n<style>{style}</style>\n</head>\n<body>\n{body}\
         {scripts}</body>\n</html>\n",
        safe(title),
    )
}

/// The hash by which a content security policy allows a script or style (W3C, CSP level 3, section 8.3).
pub(crate) fn hash(text: &str) -> String {
    format!("sha256-{}", STANDARD.encode(hmac_sha256::Hash::hash(text.as_bytes())))
}

/// A script or style without indentation, empty lines and lines of comment. Browsers hash line feeds only, so carriage
/// returns of a checkout on Windows are removed, too.
pub(crate) fn compact(text: &str) -> String {
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with("//"));
    lines.collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_that_of_the_policy() {
        // The example of W3C, CSP level 2, section 7.17.5.
        assert_eq!(hash("alert('Hello, world.');"), "sha256-qznLcsROx4GACP2dm0UCKCzCG+HiZ1guq6ZZDob/Tng=");
    }

    #[test]
    fn text_from_files_cannot_leave_its_element() {
        let mut markup = Markup::default();
        markup.text("</script><img src=x onerror=\"alert('1')\">&\u{202e}");
        assert_eq!(
            markup.finished(),
            "&lt;/script&gt;&lt;img src=x onerror=&quot;alert(&#39;1&#39;)&quot;&gt;&amp;\\u{202e}"
        );
        let scene = serde_json::json!({ "label": "</script><!--<script>" });
        let document = document("</title><b>", "", &scene, b"");
        assert_eq!(document.matches("</script").count(), 3);
        assert!(!document.contains("<!--") && !document.contains("<b>"));
    }

    #[test]
    fn script_and_style_contain_nothing_that_ends_them() {
        for text in [SCRIPT, BASE_STYLE, STYLE] {
            let compact = compact(text).to_lowercase();
            assert!(["</script", "</style", "<!--"].iter().all(|end| !compact.contains(end)));
        }
    }

    #[test]
    fn long_lists_are_cut_and_state_what_is_left_out() {
        let mut markup = Markup::default();
        let item = |markup: &mut Markup, item: &&str| {
            markup.raw(item);
        };
        markup.bounded(&["12345"; 10], 22, item, |markup, rest| {
            markup.raw(&format!("+{rest}"));
        });
        assert_eq!(markup.finished(), "12345123451234512345+6");
        assert!(safe(&"é".repeat(5000)).chars().count() < 700);
    }

    #[test]
    fn a_checkout_with_other_line_ends_gives_the_same_script() {
        assert_eq!(compact("  a;\r\n\r\n  // b\r\n  c;\r\n"), compact("a;\nc;\n"));
    }
}
