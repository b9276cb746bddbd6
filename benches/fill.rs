//! The time of a fill: ten square centimetres with 100 lines per millimetre, which are 100 m of lines, and letters with a usual
//! spacing, on parts whose surface is known.

use std::hint::black_box;

use divan::Bencher;
use isomark::config::{JobSettings, Sku};
use isomark::formats::mesh::PartFile;
use isomark::pipeline::{PatternInput, Pipeline};

const SQUARE: &str = "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n\
                      0\nSECTION\n2\nENTITIES\n0\nLWPOLYLINE\n8\nMARK\n90\n4\n70\n1\n10\n0\n20\n0\n10\n40\n20\n0\n\
                      10\n40\n20\n25\n10\n0\n20\n25\n0\nENDSEC\n0\nEOF\n";
const LETTERS: &[u8] = include_bytes!("../examples/patterns/letters.dxf");
const MOUSE: &[u8] = include_bytes!("../examples/parts/mouse.glb");
const CAN: &[u8] = include_bytes!("../examples/parts/can.glb");

fn main() {
    divan::main();
}

fn correct(bencher: Bencher<'_, '_>, part: (&str, &[u8]), drawing: &[u8], settings: &str) {
    let sku: Sku = "bench".parse().expect("a valid name");
    let settings =
        JobSettings::default().overridden_by("bench.toml".as_ref(), settings).expect("the sample is valid");
    let pipeline = Pipeline::new(None);
    let learned = pipeline
        .learn(&sku, &PartFile::alone(part.0, part.1.to_vec()), &settings.part)
        .expect("the sample is valid");
    let input = PatternInput { name: "drawing.dxf", bytes: drawing, previous: None };
    bencher.bench_local(|| {
        let corrected = pipeline
            .correct(&sku, &learned, black_box(input), &settings, false)
            .expect("the sample is valid");
        black_box(corrected.dxf.len())
    });
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn a_hundred_metres_on_the_mouse(bencher: Bencher<'_, '_>) {
    let settings = "placement.place_mm = [0, 0]\nfill.spacing_mm = 0.01\nfill.angle_deg = 30\n";
    correct(bencher, ("mouse.glb", MOUSE), SQUARE.as_bytes(), settings);
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn a_hundred_metres_on_the_can(bencher: Bencher<'_, '_>) {
    let settings =
        "part.facing = \"-y\"\nplacement.place_mm = [0, 60]\nfill.spacing_mm = 0.01\nfill.angle_deg = 30\n";
    correct(bencher, ("can.glb", CAN), SQUARE.as_bytes(), settings);
}

#[divan::bench(args = [0.0, 0.05], sample_count = 20, sample_size = 1)]
fn letters_on_the_mouse(bencher: Bencher<'_, '_>, spacing: f64) {
    let settings = format!("placement.place_mm = [0, 8]\nfill.spacing_mm = {spacing}\n");
    correct(bencher, ("mouse.glb", MOUSE), LETTERS, &settings);
}
