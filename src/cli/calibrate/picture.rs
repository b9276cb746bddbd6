//! The residuals of a calibration as a picture: one panel for each plate, the crosses at their places in the field, and an
//! arrow from each to where it was measured, drawn larger than it is.

use std::fmt::Write;

use nalgebra::Vector2;

use crate::geometry::space::Extents;

/// A cross in the picture.
pub(super) struct Arrow {
    pub(super) name: String,
    pub(super) z: f64,
    pub(super) at: Vector2<f64>,
    /// Measured minus fitted, mm.
    pub(super) residual: Vector2<f64>,
    /// Whether a value of it was left out.
    pub(super) is_left_out: bool,
}

/// Width of a panel, in units of the picture.
const PANEL: f64 = 420.0;
/// Space round a panel.
const MARGIN: f64 = 40.0;
/// Space for the heading.
const HEAD: f64 = 70.0;

/// The picture. `title` and `lines` stand above the panels.
pub(super) fn svg(title: &str, line: &str, field: &Extents, arrows: &[Arrow]) -> String {
    let mut heights: Vec<f64> = arrows.iter().map(|arrow| arrow.z).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    let scale = PANEL / field.size().x;
    let panel_height = field.size().y * scale;
    let sound = arrows.iter().filter(|arrow| !arrow.is_left_out).map(|arrow| arrow.residual.norm());
    let longest = sound.fold(0.0f64, f64::max).max(1e-4);
    // The longest sound arrow takes about an eighth of the panel, at a magnification of 1, 2 or 5 times a power of ten.
    let wished = PANEL / 8.0 / (longest * scale);
    let power = 10f64.powf(wished.log10().floor());
    let times =
        [5.0, 2.0, 1.0].into_iter().map(|step| step * power).find(|step| *step <= wished).unwrap_or(power);
    let width = MARGIN + heights.len().max(1) as f64 * (PANEL + MARGIN);
    let height = HEAD + panel_height + MARGIN;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" height=\"{height:.0}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n\
         <text x=\"{MARGIN}\" y=\"24\" font-size=\"16\">{}</text>\n<text x=\"{MARGIN}\" y=\"44\">{}; arrows {times:.0} times as long, red: left out and shortened</text>\n",
        crate::preview::escaped(title),
        crate::preview::escaped(line)
    );
    for (index, z) in heights.iter().enumerate() {
        let left = MARGIN + index as f64 * (PANEL + MARGIN);
        let place = |at: Vector2<f64>| {
            let from = at - field.min;
            (left + from.x * scale, HEAD + panel_height - from.y * scale)
        };
        let _ = writeln!(
            svg,
            "<text x=\"{left:.1}\" y=\"{:.1}\">plate at {z} mm</text>\n<rect x=\"{left:.1}\" y=\"{HEAD}\" width=\"{PANEL}\" \
             height=\"{panel_height:.1}\" fill=\"none\" stroke=\"#999\"/>",
            HEAD - 6.0
        );
        for arrow in arrows.iter().filter(|arrow| arrow.z == *z) {
            let (x, y) = place(arrow.at);
            let color = if arrow.is_left_out { "#c00" } else { "#06c" };
            let _ = writeln!(
                svg,
                "<path d=\"M{:.1} {y:.1}H{:.1}M{x:.1} {:.1}V{:.1}\" stroke=\"#aaa\"/><text x=\"{:.1}\" y=\"{:.1}\" fill=\"#666\">{}</text>",
                x - 6.0,
                x + 6.0,
                y - 6.0,
                y + 6.0,
                x + 5.0,
                y - 7.0,
                crate::preview::escaped(&arrow.name)
            );
            if !arrow.residual.iter().all(|value| value.is_finite()) {
                continue;
            }
            // A value that was left out may be far away; its arrow ends at the border of the panel.
            let step = arrow.residual * (times * scale);
            let step = step * (PANEL / 4.0 / step.norm().max(1e-9)).min(1.0);
            let (to_x, to_y) = (x + step.x, y - step.y);
            let along = step.try_normalize(1e-9).unwrap_or_default() * 5.0;
            let across = Vector2::new(-along.y, along.x) * 0.5;
            let wing = |side: f64| (to_x - along.x + side * across.x, to_y + along.y - side * across.y);
            let ((a, b), (c, d)) = (wing(1.0), wing(-1.0));
            let _ = writeln!(
                svg,
                "<path d=\"M{x:.1} {y:.1}L{to_x:.1} {to_y:.1}M{a:.1} {b:.1}L{to_x:.1} {to_y:.1}L{c:.1} {d:.1}\" stroke=\"{color}\" \
                 stroke-width=\"1.5\" fill=\"none\"/>"
            );
        }
    }
    svg + "</svg>\n"
}
