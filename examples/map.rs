//! Finds a length-true map from a drawing to a part and measures its accuracy: `cargo run --release --example map`.

#![allow(clippy::print_stdout, reason = "an example prints its results")]

use std::fs;

use isomark::formats::pattern::{self, PatternOptions};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::mapping::isometric::IsometricOptions;
use isomark::geometry::mapping::{LengthTrueMap, Method, quality};
use isomark::geometry::shapes;
use isomark::geometry::space::{FlatPoint, View};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let ball = shapes::graph(27.0, 0.75, shapes::sphere);
    let surface = FittedSurface::of_part(&FacingPart::new(&ball, &View::top()), &FitOptions::default())?;
    let letters =
        pattern::read(&fs::read("examples/patterns/letters.dxf")?, &PatternOptions::default())?.pattern;
    let ink = quality::sample(&letters, |_| true);
    for method in [Method::Plain, Method::Isometric(IsometricOptions::INK)] {
        let map = LengthTrueMap::find(&surface, &letters, |_| true, FlatPoint::new(0.0, 0.0), &method)?;
        println!(
            "(20, 0) mm in the drawing is mapped to {:?} in the view",
            map.point(FlatPoint::new(20.0, 0.0))
        );
        let found = quality::measure(&ink, |at| map.point(at), |at| surface.sampled_height(at));
        let found = found.map_err(|at| format!("the part ends at {at:?}"))?;
        println!("length of all lines {:.1} mm, length error {:.3} mm", found.length, found.length_error);
    }
    Ok(())
}
