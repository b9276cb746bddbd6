//! The tables 6.1, 6.2 and C.1 of the thesis that describes `mapping-domain` and `floater` (Chuang, Shape correction
//! for laser marking, 2023), with its values and ours side by side.
//!
//! ```text
//! cargo run --release --example thesis_tables
//! ```
//!
//! The thesis uses scans of a mandarin and a mouse and pictures of 39 × 13 mm that are not published. Here letters of
//! that size are placed on a mandarin and a mouse given by formulas, so trends and orders of magnitude can be
//! compared, but not digits. The times of the thesis are from another program on another computer. `as printed` keeps
//! the errors of the thesis that change the result, `corrected` keeps none.

#![allow(clippy::print_stdout, reason = "the example prints tables")]

use std::error::Error;
use std::time::Instant;

use isomark::formats::pattern::{PatternOptions, read};
use isomark::geometry::ink::Ink;
use isomark::geometry::mapping::floater::FloaterWeights;
use isomark::geometry::mapping::isometric::IsometricOptions;
use isomark::geometry::mapping::mapping_domain::{AsPrinted, MappingDomainOptions};
use isomark::geometry::mapping::{LengthTrueMap, Method, quality};
use isomark::geometry::pattern::{Affine, Pattern};
use isomark::geometry::shapes;
use isomark::geometry::space::FlatPoint;
use isomark::geometry::surface::fit::FittedSurface;

/// Time in s, e_l in mm and e_a in mm², as printed in the thesis.
type Printed = [f64; 3];

/// Table 6.1: the mandarin with 10 × 10, 20 × 20 … 100 × 100 points in the mapping domain and 50 subintervals.
const MANDARIN: [Printed; 10] = [
    [7.83, 3.81, 1.05],
    [22.97, 3.37, 1.02],
    [48.13, 3.29, 0.99],
    [82.75, 3.21, 0.99],
    [131.35, 3.21, 1.01],
    [183.06, 3.21, 1.00],
    [249.78, 3.20, 1.00],
    [324.53, 3.19, 1.00],
    [438.86, 3.19, 1.00],
    [506.75, 3.19, 1.00],
];
const MANDARIN_PARAMETRISED: Printed = [135.23, 38.68, 41.02];

/// Table 6.2: the same for the mouse.
const MOUSE: [Printed; 10] = [
    [23.02, 6.32, 1.86],
    [42.26, 5.84, 2.40],
    [74.55, 5.42, 2.17],
    [117.48, 5.51, 2.34],
    [175.25, 5.29, 2.18],
    [250.654, 5.29, 2.18],
    [342.22, 5.40, 2.25],
    [435.24, 5.20, 2.12],
    [549.85, 5.25, 2.13],
    [665.32, 5.29, 2.22],
];
const MOUSE_PARAMETRISED: Printed = [1273.23, 48.29, 54.21];

/// Table C.1: e_l and e_a for the mandarin with 10 × 10 points and 10, 20 … 100 subintervals of Simpson's rule. Its
/// column of times repeats e_l and is omitted.
const SUBINTERVALS: [[f64; 2]; 10] = [
    [11.58, 10.25],
    [6.49, 4.12],
    [4.93, 2.31],
    [4.21, 1.48],
    [3.81, 1.05],
    [3.57, 0.83],
    [3.41, 0.70],
    [3.31, 0.483],
    [3.24, 0.48],
    [3.21, 0.48],
];

fn main() -> Result<(), Box<dyn Error>> {
    let mandarin = Case::new(shapes::mandarin, [30.0, 30.0], [0.0, 3.0])?;
    let mouse = Case::new(shapes::mouse, [30.0, 55.0], [0.0, 8.0])?;
    comparison("6.1", "mandarin", &mandarin, &MANDARIN, &MANDARIN_PARAMETRISED)?;
    comparison("6.2", "mouse", &mouse, &MOUSE, &MOUSE_PARAMETRISED)?;
    subintervals(&mandarin)
}

/// Letters on a part.
struct Case {
    height: fn(f64, f64) -> f64,
    surface: FittedSurface,
    letters: Pattern,
    ink: Ink,
    place: FlatPoint,
}

/// The result of a method.
struct Reached {
    seconds: f64,
    length_error: f64,
    area_error: f64,
}

impl Case {
    /// The part over ± `half` mm, with the letters' middle at `place`, mm.
    fn new(height: fn(f64, f64) -> f64, half: [f64; 2], place: [f64; 2]) -> Result<Self, Box<dyn Error>> {
        let place = FlatPoint::new(place[0], place[1]);
        let drawing = read(include_bytes!("patterns/letters.dxf"), &PatternOptions::default())?.pattern;
        let middle = drawing.extents().center().into();
        let letters = drawing.transformed(&Affine::rigid(middle, 0.0, place));
        let ink = quality::sample(&letters, |_| true);
        let surface = FittedSurface::of_field(shapes::standing(half, 0.5, height))?;
        Ok(Self { height, surface, letters, ink, place })
    }

    /// Finds the map and measures it on the part's formula.
    fn reached(&self, method: Method) -> Result<Reached, Box<dyn Error>> {
        let start = Instant::now();
        let map = LengthTrueMap::find(&self.surface, &self.letters, |_| true, self.place, &method)?;
        let seconds = start.elapsed().as_secs_f64();
        let found = quality::measure(&self.ink, |at| map.point(at), |at| Some((self.height)(at.x, at.y)))
            .map_err(|at| format!("no height at ({}, {}) mm", at.x, at.y))?;
        Ok(Reached { seconds, length_error: found.length_error, area_error: found.area_error })
    }
}

fn mapping_domain(grid: usize, intervals: usize, as_printed: AsPrinted) -> Method {
    Method::MappingDomain(MappingDomainOptions {
        grid,
        intervals,
        as_printed,
        ..MappingDomainOptions::THESIS
    })
}

impl std::fmt::Display for Reached {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { seconds, length_error, area_error } = self;
        write!(out, "  |{seconds:8.3}{length_error:8.3}{area_error:8.3}")
    }
}

fn thesis([seconds, length_error, area_error]: &Printed) -> String {
    format!("  |{seconds:8.2}{length_error:8.2}{area_error:8.2}")
}

/// Tables 6.1 and 6.2.
fn comparison(
    number: &str,
    part: &str,
    case: &Case,
    printed: &[Printed; 10],
    parametrised: &Printed,
) -> Result<(), Box<dyn Error>> {
    let nothing = " ".repeat(26);
    println!("Table {number}: letters on the {part}, 50 subintervals; time in s, e_l in mm, e_a in mm2\n");
    let heads = "  |    time     e_l     e_a";
    println!("{:32}  |{:24}  |{:24}  |  ours, corrected", "", "  the thesis", "  ours, as printed");
    println!("{:32}{heads}{heads}{heads}", "");
    for (row, values) in printed.iter().enumerate() {
        let grid = 10 * (row + 1);
        let as_printed = case.reached(mapping_domain(grid, 50, AsPrinted::EVERYTHING))?;
        let corrected = case.reached(mapping_domain(grid, 50, AsPrinted::NOTHING))?;
        let label = format!("mapping-domain, {grid} x {grid} points");
        println!("{label:32}{}{as_printed}{corrected}", thesis(values));
    }
    let [uniform, mean_value] = [FloaterWeights::Uniform, FloaterWeights::MeanValue].map(Method::Floater);
    println!("{:32}{}{}", "floater, uniform weights", thesis(parametrised), case.reached(uniform)?);
    for (label, method) in [
        ("floater, mean value weights", mean_value),
        ("isometric, uniform", Method::Isometric(IsometricOptions::UNIFORM)),
        ("isometric, ink", Method::Isometric(IsometricOptions::INK)),
        ("none", Method::Plain),
    ] {
        println!("{label:32}  |{:24}{nothing}{}", "", case.reached(method)?);
    }
    println!();
    Ok(())
}

/// Table C.1. Swapped weights make every length too short by 2/(3s); times the drawing's length, this is the error in
/// mm.
fn subintervals(case: &Case) -> Result<(), Box<dyn Error>> {
    println!("Table C.1: letters on the mandarin, 10 x 10 points; e_l in mm, e_a in mm2\n");
    let heads = "  |     e_l     e_a";
    println!(
        "{:16}  |{:16}  |{:16}  |{:16}  |   2/3s of",
        "", "  the thesis", " ours, as printed", " correct weights"
    );
    println!("{:16}{heads}{heads}{heads}  |the lines", "subintervals");
    for (row, [length_error, area_error]) in SUBINTERVALS.into_iter().enumerate() {
        let intervals = 10 * (row + 1);
        let correct_weights = AsPrinted { simpson_weights: false, ..AsPrinted::EVERYTHING };
        let [as_printed, correct] = [AsPrinted::EVERYTHING, correct_weights].map(|kept| {
            case.reached(mapping_domain(10, intervals, kept))
                .map(|found| format!("  |{:8.3}{:8.3}", found.length_error, found.area_error))
        });
        let short = case.ink.length() * 2.0 / (3 * intervals) as f64;
        println!(
            "{intervals:<16}  |{length_error:8.2}{area_error:8.2}{}{}  |{short:9.3}",
            as_printed?, correct?
        );
    }
    Ok(())
}
