//! The sides of a part as a page: where a drawing fits on each of them.

use std::fmt::Write;

use super::markup::{Markup, flat_document};
use crate::formats::mesh::SideFacts;

/// The sides of a part as an HTML document: a table for people and programs that read aloud, and the picture `svg`.
#[must_use]
pub fn sides_html(title: &str, sides: &[SideFacts], svg: &str) -> String {
    let mut body = Markup::default();
    body.raw("<header>\n<h1>").text(title).raw("</h1>\n</header>\n<main>\n");
    body.section("sides", "Where a drawing fits", |body| {
        body.raw(
            "<div class=\"wide\" role=\"group\" tabindex=\"0\" aria-label=\"Sides of the part\">\n<table><caption>Sides of the \
             part, as the laser sees them</caption><thead><tr><th scope=\"col\">Side</th><th scope=\"col\">Shape</th><th \
             scope=\"col\">Can be marked, mm²</th><th scope=\"col\">Fits, mm</th><th scope=\"col\">Options</th></tr></thead><tbody>\n",
        );
        for side in sides {
            let shape = if side.curved { "curved" } else { "flat" };
            let meant = if side.meant { ", probably meant" } else { "" };
            body.raw("<tr><th scope=\"row\">").text(&side.side);
            let _ = write!(body, "</th><td>{shape}{meant}</td><td>{:.0}</td><td>", side.area_mm2);
            if let (Some([left, bottom, right, top]), Some([x, y])) = (side.rectangle_mm, side.place_mm) {
                let _ = write!(body, "{:.1} × {:.1}</td><td>", right - left, top - bottom);
                body.code(&format!("--facing={} --place {},{}", side.side, tenth(x), tenth(y)));
            } else {
                body.raw("nothing</td><td>");
            }
            body.raw("</td></tr>\n");
        }
        body.raw("</tbody></table>\n</div>\n");
    });
    body.section("picture", "Picture", |body| {
        body.raw("<div class=\"wide\" role=\"group\" tabindex=\"0\" aria-label=\"Picture of the sides\">\n");
        // A part of another document has no XML declaration.
        body.raw(svg.find("<svg").map_or("", |start| &svg[start..])).raw("</div>\n");
    });
    body.raw("</main>\n");
    flat_document(title, &body.finished())
}

/// A coordinate to a tenth of a millimetre, as `--place` takes it.
fn tenth(value: f64) -> f64 {
    (value * 10.0).round() / 10.0 + 0.0
}
