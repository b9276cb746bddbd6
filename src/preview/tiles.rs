//! The picture of a mark in tiles: the unrolled drawing with the tiles, and each tile as the laser draws it.

use nalgebra::Vector2;

use super::Preview;
use super::layout::{HEADING, LABEL, TITLE, summary};
use super::page::{Anchor, DARK, FAINT, Page, PathData, number};
use super::window::MARGIN;
use crate::geometry::space::Extents;
use crate::printable::on_one_line;

/// The content of the picture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TilesPicture {
    /// The lines of the drawing, unrolled, mm.
    pub drawn: Vec<Vec<[f64; 2]>>,
    /// The tiles, in the order of their angles.
    pub tiles: Vec<TilePicture>,
}

/// A tile of the picture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TilePicture {
    /// Its angle as text.
    pub name: String,
    /// Its incidence angle and its length of ink as text.
    pub about: String,
    /// The corners of its area in the unrolled drawing, mm.
    pub band: Vec<[f64; 2]>,
    /// Its lines in the field, mm.
    pub marked: Vec<Vec<[f64; 2]>>,
}

/// Width of the unrolled drawing, mm of paper.
const WIDTH: f64 = 260.0;
/// Largest height of the unrolled drawing, mm of paper.
const HEIGHT: f64 = 130.0;
/// Largest number of tiles in a row, and their gap, mm of paper.
const IN_ROW: usize = 6;
const GAP: f64 = 4.0;
/// Colours of neighbouring tiles.
const BANDS: [&str; 2] = ["#dbeafe", "#fef3c7"];

/// A section of a drawing on the page.
struct Section {
    shown: Extents,
    at: [f64; 2],
    scale: f64,
}

impl Section {
    /// All points, scaled into a box of the page.
    fn fitted<'a>(points: impl Iterator<Item = &'a [f64; 2]>, at: [f64; 2], size: [f64; 2]) -> Self {
        let finite = points.filter(|point| point.iter().all(|value| value.is_finite()));
        let shown = Extents::of(finite.map(|point| Vector2::from(*point)));
        let shown = if shown.is_empty() { Extents::of([Vector2::zeros()]) } else { shown }.grown_to(1e-3);
        let scale = (size[0] / shown.size().x).min(size[1] / shown.size().y);
        Self { shown, at, scale }
    }

    fn height(&self) -> f64 {
        self.shown.size().y * self.scale
    }

    fn width(&self) -> f64 {
        self.shown.size().x * self.scale
    }

    /// A point of the page, with y upwards from its top edge, which is what [`PathData`] needs.
    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [
            self.at[0] + (x - self.shown.min.x) * self.scale,
            -(self.at[1] + (self.shown.max.y - y) * self.scale),
        ]
    }

    fn path(&self, lines: &[Vec<[f64; 2]>]) -> PathData {
        let mut data = PathData::default();
        for line in lines {
            let points: Vec<[f64; 2]> = line.iter().map(|point| self.place(*point)).collect();
            if points.iter().flatten().all(|value| value.is_finite()) {
                data.polyline(&points);
            }
        }
        data
    }
}

fn stroke(page: &mut Page, data: &PathData, color: &str, width: f64) {
    if !data.is_empty() {
        page.add(format_args!(
            "<path d=\"{}\" stroke=\"{color}\" stroke-width=\"{}\"/>",
            data.text(),
            number(width)
        ));
    }
}

/// Draws the tiles.
pub(super) fn svg(preview: &Preview, picture: &TilesPicture) -> String {
    let mut page = Page::default();
    let width = WIDTH + 2.0 * MARGIN;
    let title = on_one_line(&preview.title);
    page.text([MARGIN, 10.5], TITLE, &TITLE.shortened(&title, WIDTH));
    page.text([MARGIN, 17.5], HEADING, "Unrolled, with the angle of the rotary axis for each tile");

    let bands = picture.tiles.iter().flat_map(|tile| &tile.band);
    let section =
        Section::fitted(bands.chain(picture.drawn.iter().flatten()), [MARGIN, 24.0], [WIDTH, HEIGHT]);
    for (tile, color) in picture.tiles.iter().zip(BANDS.iter().cycle()) {
        let mut band = PathData::default();
        let corners: Vec<[f64; 2]> = tile.band.iter().map(|point| section.place(*point)).collect();
        band.polygon(&corners);
        page.add(format_args!(
            "<path d=\"{}\" fill=\"{color}\" stroke=\"{FAINT}\" stroke-width=\"0.2\"/>",
            band.text()
        ));
        let area = Extents::of(corners.iter().map(|point| Vector2::from(*point)));
        if area.size().x >= LABEL.width(&tile.name) {
            page.text([area.center().x, -area.max.y - 1.0], LABEL.anchored(Anchor::Middle), &tile.name);
        }
    }
    stroke(&mut page, &section.path(&picture.drawn), DARK, 0.25);

    let mut top = section.at[1] + section.height() + 10.0;
    page.text(
        [MARGIN, top],
        HEADING,
        "Each tile in the field, as the laser draws it: angle; largest incidence, length of its lines",
    );
    let columns = picture.tiles.len().clamp(1, IN_ROW);
    let side = (WIDTH - GAP * (columns as f64 - 1.0)) / columns as f64;
    let side = side.min(80.0);
    // All tiles have one scale.
    let largest = picture.tiles.iter().map(|tile| {
        let section = Section::fitted(tile.marked.iter().flatten(), [0.0; 2], [side, side]);
        section.scale
    });
    let scale = largest.fold(f64::INFINITY, f64::min);
    for row in picture.tiles.chunks(columns) {
        let mut lowest = top;
        for (column, tile) in row.iter().enumerate() {
            let at = [MARGIN + column as f64 * (side + GAP), top + 9.5];
            page.text([at[0], top + 4.5], LABEL.bold(), &tile.name);
            page.text([at[0], top + 7.8], LABEL, &tile.about);
            let section =
                Section { scale, ..Section::fitted(tile.marked.iter().flatten(), at, [side, side]) };
            page.rect(
                at,
                [section.width(), section.height()],
                &format!("stroke=\"{FAINT}\" stroke-width=\"0.15\""),
            );
            stroke(&mut page, &section.path(&tile.marked), DARK, 0.2);
            lowest = lowest.max(at[1] + section.height());
        }
        top = lowest + 2.0;
    }
    let end = summary(&mut page, [MARGIN, top + 6.0], WIDTH, &preview.summary);
    page.finished(&title, [width, end + MARGIN])
}
