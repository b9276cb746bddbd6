//! The section of the view that a panel shows, and its scale.

use super::page::number;
use crate::geometry::space::Extents;

/// Blank border of the page and gap between its blocks, mm.
pub(super) const MARGIN: f64 = 8.0;
/// Upper edge of the panels, mm.
pub(super) const PANEL_TOP: f64 = 26.0;
/// Largest width and height of the inset, mm.
pub(super) const INSET: [f64; 2] = [34.0, 40.0];
/// Panels are at least this wide, mm, so that there is room for the text below them.
const PANEL_WIDTH: f64 = 78.0;
/// Minimum height of a panel as a share of its width.
const PANEL_ASPECT: f64 = 0.5;
/// Panels with longer sides in this range, mm, are drawn in true size; two of them fit on a landscape A4 page.
const TRUE_SIZE: std::ops::RangeInclusive<f64> = 32.0..=130.0;

/// A window: the section of the view that is shown, and its place on the page.
pub(super) struct Window {
    /// The section shown, mm of the view.
    pub(super) shown: Extents,
    /// Upper left corner on the page, mm.
    pub(super) at: [f64; 2],
    /// Millimetres of paper for each millimetre of the view.
    pub(super) scale: f64,
}

impl Window {
    pub(super) fn paper_size(&self) -> [f64; 2] {
        let size = self.shown.size() * self.scale;
        [size.x, size.y]
    }

    /// A point of the view on the page.
    pub(super) fn place(&self, x: f64, y: f64) -> [f64; 2] {
        [self.at[0] + (x - self.shown.min.x) * self.scale, self.at[1] + (self.shown.max.y - y) * self.scale]
    }

    /// The window's rectangle in coordinates of the view, y negated.
    pub(super) fn rectangle(&self) -> String {
        rectangle(&self.shown, "")
    }

    /// Opens a group in coordinates of the view (mm, y negated) that is clipped to the window.
    pub(super) fn opening(&self, clip: &str) -> String {
        let [x, y] = self.place(0.0, 0.0).map(number);
        format!("<g transform=\"translate({x} {y}) scale({:.6})\" clip-path=\"url(#{clip})\">", self.scale)
    }

    /// The scale as text.
    pub(super) fn scale_name(&self) -> String {
        let ratio = |a: f64, b: f64| format!("scale {} : {}", number(a), number(b));
        if self.scale >= 1.0 { ratio(self.scale, 1.0) } else { ratio(1.0, 1.0 / self.scale) }
    }
}

/// The window of a panel: the drawing with a margin, at a standard scale.
pub(super) fn panel_window(drawn: &Extents, part: Option<&Extents>) -> Window {
    let fallback = || part.copied().unwrap_or(Extents::of([[-20.0, -10.0].into(), [20.0, 10.0].into()]));
    let crop = if drawn.is_empty() { fallback() } else { *drawn };
    let longer = crop.size().max().max(0.5);
    let crop = crop.grown(0.14 * longer);
    let longer = crop.size().max();
    let scale = if TRUE_SIZE.contains(&longer) { 1.0 } else { standard_scale(*TRUE_SIZE.end() / longer) };
    let width = (crop.size().x * scale).max(PANEL_WIDTH).ceil();
    let height = (crop.size().y * scale).max(PANEL_ASPECT * width).ceil();
    let half = nalgebra::Vector2::new(width, height) / (2.0 * scale);
    let shown = Extents { min: crop.center() - half, max: crop.center() + half };
    Window { shown, at: [MARGIN, PANEL_TOP], scale }
}

/// The window of the inset: the whole part, and the field unless the part would be too small in it.
pub(super) fn inset_window(
    drawn: &Extents,
    part: Option<&Extents>,
    field: Option<&Extents>,
    at: [f64; 2],
) -> Window {
    let mut whole = *drawn;
    for corner in part.iter().flat_map(|part| [part.min, part.max]) {
        whole.include(corner);
    }
    if whole.is_empty() {
        whole = Extents::of([[-20.0, -20.0].into(), [20.0, 20.0].into()]);
    }
    let size = whole.size().max();
    if let Some(field) = field.filter(|field| field.size().max() <= 2.5 * size) {
        [field.min, field.max].into_iter().for_each(|corner| whole.include(corner));
    }
    let whole = whole.grown(0.04 * whole.size().max().max(1.0));
    let scale = (INSET[0] / whole.size().x).min(INSET[1] / whole.size().y);
    Window { shown: whole, at, scale }
}

/// The largest of 1, 2, 5 times a power of ten that is at most `scale`.
fn standard_scale(scale: f64) -> f64 {
    let decade = 10f64.powf(scale.log10().floor());
    [5.0, 2.0]
        .map(|round| round * decade)
        .into_iter()
        .find(|known| *known <= scale * (1.0 + 1e-9))
        .unwrap_or(decade)
}

/// A rectangle of the view in its coordinates, y negated.
pub(super) fn rectangle(extents: &Extents, paint: &str) -> String {
    let size = extents.size();
    format!(
        "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" {paint}/>",
        number(extents.min.x),
        number(-extents.max.y),
        number(size.x),
        number(size.y)
    )
}
