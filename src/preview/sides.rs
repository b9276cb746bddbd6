//! The sides of a part, each with its axes, its extents and the place where a drawing fits.

use super::HeightPicture;
use super::layout::{background, frame, scale_bar};
use super::page::{DARK, Page, QUIET, Type, number};
use super::relief::Backdrop;
use super::window::{MARGIN, Window, rectangle};
use crate::geometry::space::Extents;
use crate::printable::on_one_line;

/// A side of a part. All lengths are in mm of its view, x to the right and y up as the laser sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct SidePicture {
    /// Heading, such as `--facing=-y`.
    pub heading: String,
    /// Remarks below the heading, one a line.
    pub remarks: Vec<String>,
    /// The part as the laser sees it.
    pub part_outline: HeightPicture,
    /// The bounding rectangle of the part.
    pub extents: Extents,
    /// The largest rectangle in which a drawing fits.
    pub rectangle: Option<Extents>,
}

/// Largest width and height of a panel, mm.
const PANEL: f64 = 84.0;
/// Largest width and height of the panel of a single side, mm.
const SINGLE_PANEL: f64 = 150.0;
/// Panels in a row.
const IN_ROW: usize = 3;
/// Upper edge of the first panel's heading, mm.
const TOP: f64 = 18.0;
/// Height of a line of remarks, mm.
const LINE: f64 = 3.6;
/// Space below a panel for its rulers, mm.
const RULERS: f64 = 9.0;
/// Colour of the rectangle in which a drawing fits.
const FITS: &str = "#15803d";

const TITLE: Type = Type::new(4.2, DARK).bold();
const HEADING: Type = Type::new(3.0, DARK).bold();
const REMARK: Type = Type::new(2.3, QUIET);

/// Draws the sides, three in a row; the same sides give the same bytes.
#[must_use]
pub fn sides_svg(title: &str, sides: &[SidePicture]) -> String {
    let largest = if sides.len() == 1 { SINGLE_PANEL } else { PANEL };
    let longest = sides.iter().map(|side| side.extents.size().max()).fold(0.0, f64::max);
    // All sides have one scale, so that their sizes can be compared.
    let scale = largest / (longest * 1.16).max(1e-6);
    let text_height = |side: &SidePicture| HEADING.size + 1.5 + LINE * side.remarks.len() as f64;
    let mut page = Page::default();
    let title = on_one_line(title);
    let width = MARGIN + sides.len().clamp(1, IN_ROW) as f64 * (largest + MARGIN);
    page.text([MARGIN, 10.5], TITLE, &TITLE.shortened(&title, width - 2.0 * MARGIN));
    let mut top = TOP;
    for (first, row) in sides.chunks(IN_ROW).enumerate() {
        let above = row.iter().map(text_height).fold(0.0, f64::max);
        let mut bottom = top;
        for (column, side) in row.iter().enumerate() {
            let at = [MARGIN + column as f64 * (largest + MARGIN), top + above];
            let shown = side.extents.grown(0.08 * longest);
            let window = Window { shown, at, scale };
            let id = format!("side{}", first * IN_ROW + column + 1);
            draw_side(&mut page, side, &window, &id, top, largest);
            bottom = bottom.max(at[1] + window.paper_size()[1] + RULERS);
        }
        top = bottom + MARGIN / 2.0;
    }
    page.finished(&title, [width, (top + MARGIN / 2.0).ceil()])
}

fn draw_side(page: &mut Page, side: &SidePicture, window: &Window, id: &str, top: f64, width: f64) {
    let left = window.at[0];
    page.text([left, top + HEADING.size], HEADING, &HEADING.shortened(&side.heading, width));
    for (line, remark) in side.remarks.iter().enumerate() {
        let y = top + HEADING.size + LINE * (line as f64 + 1.0) + 0.4;
        page.text([left, y], REMARK, &REMARK.shortened(remark, width));
    }
    let backdrop = Backdrop::named(&side.part_outline, id);
    let clip = format!("{id}-window");
    page.add(format_args!("<defs>"));
    page.add(format_args!("<clipPath id=\"{clip}\">{}</clipPath>", window.rectangle()));
    page.add(format_args!("{}</defs>", backdrop.definitions));
    page.add(format_args!("{}", window.opening(&clip)));
    background(page, window, backdrop.relief.is_some().then_some(id), None);
    if let Some(fits) = &side.rectangle {
        let paint = format!(
            "fill=\"{FITS}\" fill-opacity=\".08\" stroke=\"{FITS}\" stroke-width=\"{}\"",
            number(0.4 / window.scale)
        );
        page.add(format_args!("{}", rectangle(fits, &paint)));
    }
    page.add(format_args!("</g>"));
    if let Some(fits) = &side.rectangle {
        let [x, y] = window.place(fits.center().x, fits.center().y);
        page.line([x - 1.5, y], [x + 1.5, y], FITS, 0.3);
        page.line([x, y - 1.5], [x, y + 1.5], FITS, 0.3);
    }
    frame(page, window);
    scale_bar(page, window);
}
