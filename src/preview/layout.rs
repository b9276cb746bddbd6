//! The layout of the page.

use super::Preview;
use super::ink::{self, Line};
use super::page::{Anchor, DARK, FAINT, Page, PathData, QUIET, Type, number};
use super::relief::{Backdrop, PART, RESIDUAL, Relief, millimetres, round_step};
use super::stretch_scale::{StretchScale, color, last_color, range_text, round_percent};
use super::window::{INSET, MARGIN, PANEL_TOP, Window, inset_window, panel_window, rectangle};
use crate::geometry::space::Extents;
use crate::printable::on_one_line;

/// Width of the colour scale, mm.
const LEGEND_WIDTH: f64 = 52.0;
/// Length of an A4 page, mm.
const A4: f64 = 297.0;
/// Colour of the field's border.
const FIELD: &str = "#0f766e";

pub(super) const TITLE: Type = Type::new(4.2, DARK).bold();
pub(super) const HEADING: Type = Type::new(3.0, DARK).bold();
pub(super) const LABEL: Type = Type::new(2.3, QUIET);
const VALUE: Type = Type::new(2.3, DARK);
const TICK: Type = Type::new(1.9, QUIET);

/// Draws the panels of a drawing; `backdrop` is that of the preview's own part.
pub(super) fn svg_on(backdrop: &Backdrop, preview: &Preview) -> String {
    let before = ink::lines(&preview.before);
    let after = ink::lines(&preview.after);
    let colors = StretchScale::covering(ink::weighted(&before).chain(ink::weighted(&after)));
    let relief = backdrop.relief.as_ref();
    let field =
        preview.field.filter(|field| !field.is_empty() && field.size().iter().all(|side| side.is_finite()));
    let drawn = Extents::of(points(&before).chain(points(&after)));
    let part = relief.map(|relief| relief.extents);

    let left = panel_window(&drawn, part.as_ref());
    let [panel_width, panel_height] = left.paper_size();
    let right = Window { at: [MARGIN + panel_width + MARGIN, PANEL_TOP], ..left };
    let unrolled = ink::lines(&preview.unrolled);
    // Three panels in a row, if they fit on a landscape A4 page; otherwise the third one is below the first.
    let in_row = unrolled.is_empty() || 3.0 * panel_width + 4.0 * MARGIN <= A4;
    let columns = if in_row && !unrolled.is_empty() { 3.0 } else { 2.0 };
    let width = columns * panel_width + (columns + 1.0) * MARGIN;
    let third = unrolled_window(&unrolled, &left, in_row);

    let mut page = Page::default();
    page.add(format_args!("<defs>"));
    for window in [
        ("panel-window", &left),
        ("unrolled-window", &third),
        ("inset-window", &inset_window(&drawn, part.as_ref(), field.as_ref(), [0.0; 2])),
    ] {
        page.add(format_args!("<clipPath id=\"{}\">{}</clipPath>", window.0, window.1.rectangle()));
    }
    page.add(format_args!("{}</defs>", backdrop.definitions));
    // `preview.svg#after` shows this panel alone, as a thumbnail.
    let [x, y, width_of_panel, height_of_panel] =
        [right.at[0], right.at[1], panel_width, panel_height].map(number);
    page.add(format_args!("<view id=\"after\" viewBox=\"{x} {y} {width_of_panel} {height_of_panel}\"/>"));
    let title = on_one_line(&preview.title);
    page.text([MARGIN, 10.5], TITLE, &TITLE.shortened(&title, width - 2.0 * MARGIN));

    let thickness = line_width(&before, &drawn, left.scale);
    for (window, name, how, lines, range) in [
        (&left, "Before", "uncorrected, as the laser draws it", &before, preview.before_range),
        (&right, "After", "corrected, as the laser draws it", &after, preview.after_range),
    ] {
        heading(&mut page, window, name, how, &stretch_range(lines, range));
        page.add(format_args!("{}", window.opening("panel-window")));
        background(&mut page, window, relief.map(|_| PART), field.as_ref());
        if name == "After" {
            outline(&mut page, &before, thickness / window.scale);
        }
        colored(&mut page, lines, &colors, thickness / window.scale);
        page.add(format_args!("</g>"));
        frame(&mut page, window);
        scale_bar(&mut page, window);
    }

    if !unrolled.is_empty() {
        let how = "unrolled, seen along its normal";
        heading(&mut page, &third, "On the part", how, "what a person sees who turns the part");
        page.add(format_args!("{}", third.opening("unrolled-window")));
        colored(&mut page, &unrolled, &colors, thickness / third.scale);
        page.add(format_args!("</g>"));
        frame(&mut page, &third);
        scale_bar(&mut page, &third);
    }

    let foot = third.at[1].max(PANEL_TOP) + panel_height + 11.0;
    let inset = inset_window(&drawn, part.as_ref(), field.as_ref(), [MARGIN, foot]);
    let pattern = Extents::of(points(&before));
    let inset_end = draw_inset(&mut page, &inset, relief, preview.part_size, field.as_ref(), &pattern);
    let legend_at = [MARGIN + INSET[0] + MARGIN, foot];
    let is_unknown =
        ink::weighted(&before).chain(ink::weighted(&after)).any(|(_, stretch)| !stretch.is_finite());
    let legend_end = legend(&mut page, legend_at, &colors, is_unknown, relief);
    let summary_at = [legend_at[0] + LEGEND_WIDTH + 1.5 * MARGIN, foot];
    let summary_end = summary(&mut page, summary_at, width - MARGIN - summary_at[0], &preview.summary);
    let foot_height = (inset_end - foot).max(legend_end - foot).max(summary_end - foot);
    page.finished(&title, [width, (foot + foot_height + MARGIN - 2.0).ceil()])
}

/// The lines above a panel: what it shows, how, and a remark.
fn heading(page: &mut Page, window: &Window, name: &str, how: &str, remark: &str) {
    let [left, top] = window.at;
    page.text([left, top - 7.5], HEADING, name);
    page.text([left + HEADING.width(name) + 1.5, top - 7.5], VALUE, how);
    page.text([left, top - 3.0], LABEL, remark);
}

/// The window of the unrolled mark, as large and at the same scale as that of the first panel: beside the second panel, or
/// below the first.
fn unrolled_window(lines: &[Line], first: &Window, in_row: bool) -> Window {
    let [width, height] = first.paper_size();
    let drawn = Extents::of(points(lines));
    let middle = if drawn.is_empty() { first.shown.center() } else { drawn.center() };
    let half = first.shown.size() / 2.0;
    let shown = Extents { min: middle - half, max: middle + half };
    let at = match (lines.is_empty(), in_row) {
        (true, _) => first.at,
        (_, true) => [first.at[0] + 2.0 * (width + MARGIN), first.at[1]],
        (_, false) => [first.at[0], first.at[1] + height + 22.0],
    };
    Window { shown, at, scale: first.scale }
}

/// Part, field and axes, in coordinates of the view; `part` is the name of the drawn part.
pub(super) fn background(page: &mut Page, window: &Window, part: Option<&str>, field: Option<&Extents>) {
    let hair = 0.12 / window.scale;
    if let Some(part) = part {
        page.add(format_args!("<use xlink:href=\"#{part}\" stroke-width=\"{}\"/>", number(hair)));
    }
    if let Some(field) = field {
        let paint = format!(
            "stroke=\"{FIELD}\" stroke-width=\"{}\" stroke-dasharray=\"{} {}\"",
            number(0.25 / window.scale),
            number(2.0 / window.scale),
            number(1.2 / window.scale)
        );
        page.add(format_args!("{}", rectangle(field, &paint)));
    }
    let Extents { min, max } = window.shown;
    page.add(format_args!(
        "<path stroke=\"#64748b\" stroke-opacity=\".7\" stroke-width=\"{}\" stroke-dasharray=\"{} {}\" \
         d=\"M{} 0H{}M0 {}V{}\"/>",
        number(hair),
        number(1.6 / window.scale),
        number(0.9 / window.scale),
        number(min.x),
        number(max.x),
        number(-max.y),
        number(-min.y)
    ));
}

/// The original lines, thin and grey, to show the shift.
fn outline(page: &mut Page, lines: &[Line], thickness: f64) {
    let data = ink::outline(lines);
    page.add(format_args!(
        "<path stroke=\"#7c8798\" stroke-width=\"{}\" d=\"{}\"/>",
        number(0.4 * thickness),
        data.text()
    ));
}

/// The lines in the colours of their stretch.
fn colored(page: &mut Page, lines: &[Line], colors: &StretchScale, thickness: f64) {
    let runs = ink::runs(lines, colors);
    page.add(format_args!("<g stroke-width=\"{}\">", number(thickness)));
    for shade in StretchScale::drawing_order() {
        if let Some(data) = runs.get(&shade).map(PathData::text) {
            page.add(format_args!("<path stroke=\"{}\" d=\"{data}\"/>", color(shade)));
        }
    }
    page.add(format_args!("</g>"));
}

/// The border of a panel with its rulers, and the names of the axes.
pub(super) fn frame(page: &mut Page, window: &Window) {
    let [width, height] = window.paper_size();
    page.rect(window.at, [width, height], &format!("stroke=\"{FAINT}\" stroke-width=\".2\""));
    let step = round_step(8.0 / window.scale);
    let Extents { min, max } = window.shown;
    let bottom = window.at[1] + height;
    for tick in ticks(min.x, max.x, step) {
        let [x, _] = window.place(tick, 0.0);
        page.line([x, bottom], [x, bottom + 0.9], FAINT, 0.2);
        page.text([x, bottom + 3.2], TICK.anchored(Anchor::Middle), &signed(tick));
    }
    for tick in ticks(min.y, max.y, step) {
        let [_, y] = window.place(0.0, tick);
        page.line([window.at[0] - 0.9, y], [window.at[0], y], FAINT, 0.2);
        page.text([window.at[0] - 1.3, y + 0.65], TICK.anchored(Anchor::End), &signed(tick));
    }
    let [x, y] = window.place(0.0, 0.0);
    if min.y <= 0.0 && max.y >= 0.0 {
        page.text([window.at[0] + width - 1.0, y - 0.8], TICK.anchored(Anchor::End), "x");
    }
    if min.x <= 0.0 && max.x >= 0.0 {
        page.text([x + 0.8, window.at[1] + 2.4], TICK, "y");
    }
}

/// Multiples of `step` inside the range, at most 100.
fn ticks(min: f64, max: f64, step: f64) -> impl Iterator<Item = f64> {
    let (first, last) = ((min / step).ceil() as i64, (max / step).floor() as i64);
    (first..=last).take(100).map(move |index| index as f64 * step)
}

fn signed(value: f64) -> String {
    let text = millimetres(value.abs());
    let text = text.trim_end_matches(" mm");
    if value < 0.0 { format!("−{text}") } else { text.to_owned() }
}

/// A bar of round length in the lower left corner.
pub(super) fn scale_bar(page: &mut Page, window: &Window) {
    let shown = round_step(7.0 / window.scale);
    let length = shown * window.scale;
    let text = format!("{} · {}", millimetres(shown), window.scale_name());
    let [left, bottom] = [window.at[0] + 2.0, window.at[1] + window.paper_size()[1] - 2.0];
    let width = length + 1.5 + LABEL.width(&text) * 0.9;
    page.rect(
        [left - 1.0, bottom - 2.6],
        [width + 1.5, 3.6],
        "fill=\"#ffffff\" fill-opacity=\".8\" rx=\".6\"",
    );
    page.rect([left, bottom - 1.4], [length, 0.8], &format!("fill=\"{DARK}\""));
    page.text([left + length + 1.2, bottom - 0.2], VALUE, &text);
}

/// The whole part with the bounding rectangle of the pattern; returns its lower edge.
fn draw_inset(
    page: &mut Page,
    window: &Window,
    relief: Option<&Relief>,
    part_size: Option<[f64; 2]>,
    field: Option<&Extents>,
    pattern: &Extents,
) -> f64 {
    page.add(format_args!("{}", window.opening("inset-window")));
    background(page, window, relief.map(|_| PART), field);
    if !pattern.is_empty() {
        let width = number(0.35 / window.scale);
        let paint =
            format!("fill=\"#ffffff\" fill-opacity=\".6\" stroke=\"{DARK}\" stroke-width=\"{width}\"");
        page.add(format_args!("{}", rectangle(pattern, &paint)));
    }
    page.add(format_args!("</g>"));
    let mut y = window.at[1] + window.paper_size()[1] + 0.3;
    let part = match part_size {
        Some(size) => ("part", Some(size.into()), QUIET),
        None => ("part ≈", relief.map(|relief| relief.extents.size()), QUIET),
    };
    let named = [
        part,
        ("pattern", Some(pattern.size()).filter(|_| !pattern.is_empty()), DARK),
        ("field", field.map(Extents::size), FIELD),
    ];
    for (name, size, color) in named {
        if let Some(size) = size {
            // Below a centimetre, tenths of a millimetre matter.
            let side =
                |length: f64| if size.max() < 10.0 { format!("{length:.1}") } else { format!("{length:.0}") };
            y += 2.8;
            page.text(
                [window.at[0], y],
                Type::new(TICK.size, color),
                &format!("{name} {} × {} mm", side(size.x), side(size.y)),
            );
        }
    }
    y
}

/// The colour scale with its numbers; returns its lower edge.
fn legend(
    page: &mut Page,
    at: [f64; 2],
    colors: &StretchScale,
    is_unknown: bool,
    relief: Option<&Relief>,
) -> f64 {
    let [x, y] = at;
    page.text([x, y + 2.3], HEADING, "Length on the part");
    let swatch = LEGEND_WIDTH / StretchScale::steps().count() as f64;
    for (index, step) in StretchScale::steps().enumerate() {
        // A small overlap prevents gaps between two colours.
        let size = [swatch + 0.05, 3.2];
        page.rect([x + index as f64 * swatch, y + 5.2], size, &format!("fill=\"{}\"", color(Some(step))));
    }
    for (place, word) in [(0.0, "too short"), (0.5, "correct"), (1.0, "too long")] {
        page.text([x + place * LEGEND_WIDTH, y + 14.0], LABEL.anchored(anchor_at(place)), word);
    }
    for (place, share) in [(0.0, -1.0), (0.25, -0.5), (0.5, 0.0), (0.75, 0.5), (1.0, 1.0)] {
        let middle = x + place * LEGEND_WIDTH;
        page.line([middle, y + 8.4], [middle, y + 9.2], FAINT, 0.2);
        let number = round_percent(share * colors.limit);
        page.text([middle, y + 11.3], TICK.anchored(anchor_at(place)), &number);
    }
    let mut line = y + 14.0;
    let mut note = |page: &mut Page, color: &str, width: f64, text: &str| {
        line += 3.9;
        page.line([x, line - 0.8], [x + 4.0, line - 0.8], color, width);
        page.text([x + 5.5, line], LABEL, text);
    };
    if colors.exceeded {
        let text = format!("stretch beyond {}", round_percent(colors.limit).replace('+', "±"));
        note(page, &last_color(), 0.5, &text);
    }
    if is_unknown {
        note(page, &color(None), 0.5, "no surface measured");
    }
    note(page, "#7c8798", 0.15, "original drawing");
    if let Some(relief) = relief.filter(|relief| !relief.contours.is_empty()) {
        note(page, "#b9c0cb", 0.15, &format!("contour lines every {}", millimetres(relief.contour_step)));
    }
    if let Some(relief) = relief.filter(|relief| !relief.residual.is_empty()) {
        let text = format!("residual of the surface > {}", millimetres(relief.residual_limit));
        note(page, RESIDUAL, 1.2, &text);
    }
    line + 1.5
}

/// The anchor that keeps text within the ends of the scale.
fn anchor_at(place: f64) -> Anchor {
    match place {
        0.0 => Anchor::Start,
        1.0 => Anchor::End,
        _ => Anchor::Middle,
    }
}

/// The table of the summary; returns its lower edge.
pub(super) fn summary(page: &mut Page, at: [f64; 2], width: f64, rows: &[(String, String)]) -> f64 {
    let [x, mut y] = at;
    y += 2.3;
    for (label, text) in rows {
        let fits = LABEL.width(label) + VALUE.width(text) + 2.0 <= width;
        page.text([x, y], LABEL, &LABEL.shortened(label, width));
        let lines = if fits { vec![text.clone()] } else { VALUE.wrapped(text, width) };
        for (index, line) in lines.iter().enumerate() {
            if !fits || index > 0 {
                y += 3.3;
            }
            page.text([x + width, y], VALUE.anchored(Anchor::End), line);
        }
        page.line([x, y + 1.3], [x + width, y + 1.3], "#e2e6ec", 0.15);
        y += 4.6;
    }
    y - 3.0
}

/// The smallest and largest stretch as text: as measured, or of the lines themselves.
fn stretch_range(lines: &[Line], measured: Option<[f64; 2]>) -> String {
    let of_lines = || {
        let stretches =
            ink::weighted(lines).map(|(_, stretch)| stretch).filter(|stretch| stretch.is_finite());
        stretches.fold([f64::INFINITY, f64::NEG_INFINITY], |[min, max], stretch| {
            [min.min(stretch), max.max(stretch)]
        })
    };
    match lines {
        [] => "nothing drawn".to_owned(),
        _ => range_text(Some(measured.unwrap_or_else(of_lines))),
    }
}

/// Thickness of the lines on paper, mm: thinner if they are so close that they would merge.
fn line_width(lines: &[Line], drawn: &Extents, scale: f64) -> f64 {
    let length: f64 = ink::weighted(lines).map(|(length, _)| length).sum::<f64>() * scale;
    let area = drawn.size().x * drawn.size().y * scale * scale;
    if length > 0.0 { (0.3 * area / length).clamp(0.06, 0.34) } else { 0.34 }
}

fn points(lines: &[Line]) -> impl Iterator<Item = nalgebra::Vector2<f64>> {
    lines.iter().flat_map(|line| line.points.iter().map(|point| (*point).into()))
}
