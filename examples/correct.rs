//! A part and a drawing in, a corrected drawing and its report out: `cargo run --release --example correct` writes both to `target`.

#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use std::fs;

use isomark::config::JobSettings;
use isomark::formats::mesh::PartFile;
use isomark::pipeline::{PatternInput, Pipeline};
use isomark::preview::svg;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (part, drawing) = (fs::read("examples/parts/mouse.glb")?, fs::read("examples/patterns/letters.dxf")?);
    let (sku, settings) = ("mouse".parse()?, JobSettings::default());
    let pipeline = Pipeline::new(None);
    let learned = pipeline.learn(&sku, &PartFile::alone("mouse.glb", part), &settings.part)?;
    let input = PatternInput { name: "letters.dxf", bytes: &drawing, previous: None };
    let corrected = pipeline.correct(&sku, &learned, input, &settings, true)?;
    fs::write("target/letters-on-mouse.dxf", &corrected.dxf)?;
    fs::write("target/letters-on-mouse.svg", svg(&corrected.preview.unwrap_or_default()))?;
    println!("{}", corrected.report.summary());
    Ok(())
}
