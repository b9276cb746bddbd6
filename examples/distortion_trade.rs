//! The trade-off between errors on a part that is curved in both directions: draws the length and area errors of
//! letters against their angle error, for many weights of lengths and of angles, and for comparison the results of
//! other programs.
//!
//! ```text
//! cargo run --release --example distortion_trade -- examples/distortion_trade.svg
//! ```

use std::error::Error;
use std::fmt::Write;

use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::ink::Ink;
use isomark::geometry::mapping::isometric::IsometricOptions;
use isomark::geometry::mapping::quality;
use isomark::geometry::mapping::{LengthTrueMap, Method};
use isomark::geometry::pattern::{Affine, Pattern};
use isomark::geometry::shapes;
use isomark::geometry::space::{FlatPoint, View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};

/// A surface, the place of the letters on it, and the results of other programs.
struct Case {
    title: &'static str,
    height: fn(f64, f64) -> f64,
    place: FlatPoint,
    /// The pattern's neighbourhood flattened with libigl: LSCM, ARAP, SLIM.
    libraries: &'static [Trade],
    /// The best result of an earlier solver: ink-weighted, cells of 2 mm, shapes weighted over the whole box.
    earlier: Trade,
}

/// e_l in mm, e_a in mm² and the largest angle error over the inked squares in degrees.
#[derive(Clone, Copy)]
struct Trade {
    length: f64,
    area: f64,
    angle: f64,
}

const fn trade(length: f64, area: f64, angle: f64) -> Trade {
    Trade { length, area, angle }
}

const CASES: [Case; 3] = [
    Case {
        title: "sphere of radius 30 mm",
        height: shapes::sphere,
        place: FlatPoint::new(0.0, 0.0),
        libraries: &[],
        earlier: trade(0.198, 0.065, 0.79),
    },
    Case {
        title: "mandarin with ribs",
        height: shapes::mandarin,
        place: FlatPoint::new(0.0, 3.0),
        libraries: &[trade(0.91, 1.18, 0.6), trade(0.48, 0.84, 0.85), trade(0.48, 0.83, 0.84)],
        earlier: trade(0.125, 0.040, 0.51),
    },
    Case {
        title: "computer mouse",
        height: shapes::mouse,
        place: FlatPoint::new(0.0, 8.0),
        libraries: &[trade(0.50, 0.64, 0.7), trade(0.25, 0.38, 0.9), trade(0.26, 0.38, 0.9)],
        earlier: trade(0.041, 0.013, 0.17),
    },
];

/// Factors on the weights, over the whole range that the settings allow.
const FACTORS: [f64; 9] = [0.1, 0.2, 0.35, 0.6, 1.0, 1.7, 3.0, 5.5, 10.0];
/// Weights of shapes over the whole box, from more accurate lines to more accurate shapes.
const BOX_WEIGHTS: [f64; 11] = [0.02, 0.04, 0.08, 0.15, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0];

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "distortion_trade.svg".into());
    let letters = read(include_bytes!("patterns/letters.dxf"), &PatternOptions::default())?.pattern;
    let mut panels = Vec::new();
    for case in &CASES {
        let mesh = shapes::graph(28.5, 0.75, case.height);
        let surface = FittedSurface::of_part(&FacingPart::new(&mesh, &View::top()), &FitOptions::default())?;
        let center = letters.extents().center().into();
        let placed = letters.transformed(&Affine::rigid(center, 0.0, case.place));
        let reached = |options: IsometricOptions| case.reached(&surface, &placed, options);
        let mut panel = Panel {
            case,
            by_lengths: Vec::new(),
            by_angles: Vec::new(),
            on_box: Vec::new(),
            choice: reached(IsometricOptions::INK)?,
            uniform: reached(IsometricOptions::UNIFORM)?,
        };
        for factor in FACTORS {
            panel.by_lengths.push(reached(IsometricOptions::INK.emphasised(factor, 1.0))?);
            panel.by_angles.push(reached(IsometricOptions::INK.emphasised(1.0, factor))?);
        }
        let everywhere =
            IsometricOptions { angle_weight: 0.0, angle_limit: f64::INFINITY, ..IsometricOptions::INK };
        for box_weight in BOX_WEIGHTS {
            panel.on_box.push(reached(IsometricOptions { box_weight, ..everywhere })?);
        }
        panels.push(panel);
    }
    std::fs::write(&path, picture(&panels)?)?;
    Ok(())
}

impl Case {
    fn reached(
        &self,
        surface: &FittedSurface,
        placed: &Pattern,
        options: IsometricOptions,
    ) -> Result<Trade, Box<dyn Error>> {
        let map = LengthTrueMap::find(surface, placed, |_| true, self.place, &Method::Isometric(options))?;
        let ink = quality::sample(placed, |_| true);
        let squares = Ink { pieces: Vec::new(), ..ink.clone() };
        let measure = |ink: &Ink| {
            let height = |at: ViewPoint| Some((self.height)(at.x, at.y));
            quality::measure(ink, |at| map.point(at), height).map_err(|at| format!("no surface at {at:?}"))
        };
        let (all, over_squares) = (measure(&ink)?, measure(&squares)?);
        Ok(trade(all.length_error, all.area_error, over_squares.max_angle_error.to_degrees()))
    }
}

/// One of the errors of a trade.
type ErrorOf = fn(&Trade) -> f64;

struct Panel<'a> {
    case: &'a Case,
    by_lengths: Vec<Trade>,
    by_angles: Vec<Trade>,
    on_box: Vec<Trade>,
    choice: Trade,
    uniform: Trade,
}

const PANEL: [f64; 2] = [270.0, 230.0];
const GAP: [f64; 2] = [46.0, 42.0];
const CORNER: [f64; 2] = [66.0, 92.0];
const INK: &str = "#0b6e75";
const LENGTHS: &str = "#d19a00";
const BOX: &str = "#9aa4ad";
const EARLIER: &str = "#c8641b";
const LIBRARY: &str = "#8b3a62";

/// A logarithmic scale.
struct Scale {
    from: f64,
    to: f64,
    start: f64,
    length: f64,
}

impl Scale {
    fn at(&self, value: f64) -> f64 {
        self.start + self.length * (value / self.from).ln() / (self.to / self.from).ln()
    }

    fn ticks(&self) -> impl Iterator<Item = f64> {
        let (from, to) = (self.from * 0.999, self.to * 1.001);
        let decades = (-3..3).flat_map(|power| [1.0, 2.0, 5.0].map(|first| first * 10f64.powi(power)));
        decades.filter(move |tick| (from..=to).contains(tick))
    }
}

fn picture(panels: &[Panel<'_>]) -> Result<String, std::fmt::Error> {
    let width = CORNER[0] + 3.0 * PANEL[0] + 2.0 * GAP[0] + 24.0;
    let height = CORNER[1] + 2.0 * PANEL[1] + GAP[1] + 122.0;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"DejaVu Sans, Verdana, \
         sans-serif\" font-size=\"11\" fill=\"#26323a\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n\
         <text x=\"{x}\" y=\"30\" font-size=\"18\" font-weight=\"bold\">The trade-off of errors on a part curved in both directions</text>\n\
         <text x=\"{x}\" y=\"50\" font-size=\"12\" fill=\"#5b6770\">Letters of 39 × 13 mm, 182 mm of outlines and 127 mm² of ink. \
         The lower left corner is best.</text>\n",
        x = CORNER[0]
    );
    for (column, panel) in panels.iter().enumerate() {
        let left = CORNER[0] + column as f64 * (PANEL[0] + GAP[0]);
        writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\" font-size=\"13\" font-weight=\"bold\">{}</text>",
            left + PANEL[0] / 2.0,
            CORNER[1] - 12.0,
            panel.case.title
        )?;
        let rows: [(&str, [f64; 2], ErrorOf); 2] = [
            ("length error e_l, mm", [0.01, 1.5], |trade| trade.length),
            ("area error e_a, mm²", [0.001, 2.0], |trade| trade.area),
        ];
        for (row, (title, [from, to], error_of)) in rows.into_iter().enumerate() {
            let top = CORNER[1] + row as f64 * (PANEL[1] + GAP[1]);
            let across = Scale { from: 0.02, to: 3.0, start: left, length: PANEL[0] };
            let up = Scale { from, to, start: top + PANEL[1], length: -PANEL[1] };
            axes(&mut svg, &across, &up, if column == 0 { title } else { "" }, row == 1)?;
            marks(&mut svg, panel, &across, &up, error_of)?;
        }
    }
    legend(&mut svg, height - 58.0)?;
    svg.push_str("</svg>\n");
    Ok(svg)
}

fn axes(svg: &mut String, across: &Scale, up: &Scale, title: &str, named: bool) -> std::fmt::Result {
    let (left, bottom) = (across.start, up.start);
    let (right, top) = (left + across.length, bottom + up.length);
    for tick in across.ticks() {
        let x = across.at(tick);
        writeln!(svg, "<path d=\"M{x:.1} {top:.1}V{bottom:.1}\" stroke=\"#e6eaed\"/>")?;
        writeln!(svg, "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{tick}°</text>", bottom + 15.0)?;
    }
    for tick in up.ticks() {
        let y = up.at(tick);
        writeln!(svg, "<path d=\"M{left:.1} {y:.1}H{right:.1}\" stroke=\"#e6eaed\"/>")?;
        writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{tick}</text>",
            left - 6.0,
            y + 4.0
        )?;
    }
    writeln!(
        svg,
        "<rect x=\"{left}\" y=\"{top}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#b6c0c7\"/>",
        right - left,
        bottom - top
    )?;
    if named {
        let middle = (left + right) / 2.0;
        writeln!(
            svg,
            "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">largest angle error</text>",
            bottom + 33.0
        )?;
    }
    let (x, y) = (left - 48.0, (top + bottom) / 2.0);
    writeln!(svg, "<text transform=\"translate({x} {y}) rotate(-90)\" text-anchor=\"middle\">{title}</text>")
}

fn marks(
    svg: &mut String,
    panel: &Panel<'_>,
    across: &Scale,
    up: &Scale,
    error_of: ErrorOf,
) -> std::fmt::Result {
    let place = |trade: &Trade| (across.at(trade.angle), up.at(error_of(trade)));
    let within = |trade: &&Trade| {
        let value = error_of(trade);
        across.from <= trade.angle && trade.angle <= across.to && up.from <= value && value <= up.to
    };
    for (line, color) in [(&panel.on_box, BOX), (&panel.by_lengths, LENGTHS), (&panel.by_angles, INK)] {
        let points: Vec<(f64, f64)> = line.iter().filter(within).map(place).collect();
        let path: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"2\" stroke-linejoin=\"round\"/>",
            path.join(" ")
        )?;
        for (x, y) in points {
            writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.4\" fill=\"{color}\"/>")?;
        }
    }
    let (x, y) = place(&panel.uniform);
    writeln!(svg, "{}", ring(x, y))?;
    for library in panel.case.libraries.iter().filter(within) {
        let (x, y) = place(library);
        writeln!(svg, "{}", cross(x, y))?;
    }
    let (x, y) = place(&panel.case.earlier);
    writeln!(svg, "{}", diamond(x, y))?;
    let (x, y) = place(&panel.choice);
    writeln!(svg, "{}", disc(x, y))
}

fn ring(x: f64, y: f64) -> String {
    format!(
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"#ffffff\" stroke=\"#26323a\" stroke-width=\"2\"/>"
    )
}

fn disc(x: f64, y: f64) -> String {
    format!(
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"6.5\" fill=\"{INK}\" stroke=\"#ffffff\" stroke-width=\"2\"/>"
    )
}

fn diamond(x: f64, y: f64) -> String {
    format!(
        "<path d=\"M{x:.1} {y:.1}m0 -6.5l6.5 6.5l-6.5 6.5l-6.5 -6.5z\" fill=\"{EARLIER}\" stroke=\"#ffffff\"/>"
    )
}

fn cross(x: f64, y: f64) -> String {
    format!("<path d=\"M{x:.1} {y:.1}m-4 -4l8 8m0 -8l-8 8\" stroke=\"{LIBRARY}\" stroke-width=\"2.2\"/>")
}

fn line(x: f64, y: f64, color: &str) -> String {
    format!(
        "<path d=\"M{} {y}h18\" stroke=\"{color}\" stroke-width=\"2\"/><circle cx=\"{x}\" cy=\"{y}\" r=\"2.4\" fill=\"{color}\"/>",
        x - 9.0
    )
}

fn legend(svg: &mut String, y: f64) -> std::fmt::Result {
    let x = CORNER[0] + 10.0;
    let columns = [x, x + 300.0, x + 600.0];
    let entries = [
        (0, disc as fn(f64, f64) -> String, "isomark, weighting “ink”"),
        (0, |x, y| line(x, y, INK), "with angle weights from 0.1 to 10"),
        (0, |x, y| line(x, y, LENGTHS), "with length weights from 0.1 to 10"),
        (1, ring, "isomark, weighting “uniform”"),
        (1, |x, y| line(x, y, BOX), "shapes kept over the whole box"),
        (2, diamond, "an earlier ink-weighted solver, cells of 2 mm"),
        (2, cross, "libigl: LSCM, ARAP, SLIM"),
    ];
    let mut rows = [0.0; 3];
    for (column, mark, text) in entries {
        let (x, y) = (columns[column], y + 20.0 * rows[column]);
        rows[column] += 1.0;
        writeln!(svg, "{}<text x=\"{}\" y=\"{}\">{text}</text>", mark(x, y), x + 16.0, y + 4.0)?;
    }
    Ok(())
}
