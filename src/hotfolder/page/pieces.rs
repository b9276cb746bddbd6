//! Small pieces of the page that several sections use.

use std::fmt::Write;

use crate::printable::on_one_line;
use crate::report_html::{Markup, safe};

/// The heading of a section.
pub(super) fn heading(body: &mut Markup, id: &str, text: &str) {
    let _ = writeln!(body, "<h2 id=\"h-{id}\" tabindex=\"-1\">{text}</h2>");
}

/// A time; the script shows it in the time zone of the browser.
pub(super) fn time(body: &mut Markup, at: &str) {
    let shown = on_one_line(at).replace('T', " ").replace('Z', " UTC");
    let _ = write!(body, "<time datetime=\"{}\">{}</time>", safe(at), safe(&shown));
}

/// How many entries of a list are left out.
pub(super) fn more(body: &mut Markup, count: usize, listed: usize) {
    let rest = count.saturating_sub(listed);
    if rest > 0 {
        let _ = writeln!(body, "<p class=\"quiet\">and {rest} more</p>");
    }
}
