//! Corrects a drawing for a part and prints the report: `cargo run --release --example correct` writes the corrected
//! drawing and its preview to `target`.

#![allow(clippy::print_stdout, reason = "an example prints its results")]

use std::fs;

use isomark::{Corrector, Drawing, Part, Settings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let part = Part::open("examples/parts/mouse.glb")?;
    let drawing = Drawing::open("examples/patterns/letters.dxf")?;
    let settings = Settings::default();
    let surface = Corrector::new().fit(&part, &settings)?;
    let result = surface.correct(&drawing, &settings)?;
    fs::write("target/letters-on-mouse.dxf", result.dxf())?;
    fs::write("target/letters-on-mouse.svg", result.picture())?;
    println!("{}", result.report().summary());
    Ok(())
}
