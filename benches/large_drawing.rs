//! A drawing of a million vertices: time and memory for reading, correcting and writing it, compared with only scanning
//! and printing its group codes.

use std::f64::consts::TAU;
use std::fmt::Write;
use std::hint::black_box;

use divan::{AllocProfiler, Bencher};
use isomark::config::{JobSettings, Sku};
use isomark::formats::mesh::PartFile;
use isomark::formats::pattern::{self, PatternOptions};
use isomark::pipeline::{LearnedPart, PatternInput, Pipeline};

#[global_allocator]
static ALLOCATOR: AllocProfiler = AllocProfiler::system();

const VERTICES: usize = 1_000_000;
const HEAD: &str = "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n\
                    0\nSECTION\n2\nENTITIES\n";
const TAIL: &str = "0\nENDSEC\n0\nEOF\n";
const KINDS: [&str; 2] = ["LWPOLYLINE", "LINE"];

fn main() {
    divan::main();
}

/// A hundred nested wavy closed curves, each as one LWPOLYLINE or as separate LINEs.
fn drawing(kind: &str) -> String {
    let per_curve = if kind == "LINE" { VERTICES / 200 } else { VERTICES / 100 };
    let mut text = HEAD.to_owned();
    for curve in 0..100 {
        let size = 0.4 + 0.006 * f64::from(curve);
        let point = |step: usize| {
            let angle = TAU * (step % per_curve) as f64 / per_curve as f64;
            let radius = size * (1.0 + 0.3 * (12.0 * angle).sin());
            [9.0 * radius * angle.cos(), 5.0 * size * angle.sin()]
        };
        // Writing into a String cannot fail.
        let _ = match kind {
            "LINE" => (0..per_curve).try_for_each(|step| {
                let ([x0, y0], [x1, y1]) = (point(step), point(step + 1));
                let handle = curve as usize * per_curve + step + 0x100;
                write!(
                    text,
                    "0\nLINE\n5\n{handle:X}\n8\nMARK\n10\n{x0:.6}\n20\n{y0:.6}\n11\n{x1:.6}\n21\n{y1:.6}\n"
                )
            }),
            _ => write!(text, "0\nLWPOLYLINE\n5\n{:X}\n8\nMARK\n90\n{per_curve}\n70\n1\n", curve + 0x100)
                .and_then(|()| {
                    (0..per_curve).try_for_each(|step| {
                        let [x, y] = point(step);
                        write!(text, "10\n{x:.6}\n20\n{y:.6}\n")
                    })
                }),
        };
    }
    text + TAIL
}

/// The minimum work of a program that reads and writes a drawing: parsing and printing group codes and numbers.
fn scanned_and_printed(drawing: &str) -> String {
    let mut out = String::new();
    let mut lines = drawing.lines();
    while let (Some(code), Some(value)) = (lines.next(), lines.next()) {
        let code: i32 = code.trim().parse().unwrap_or(-1);
        let _ = match value.parse::<f64>() {
            Ok(number) if (10..=59).contains(&code) => write!(out, "{code:>3}\n{number:.6}\n"),
            _ => write!(out, "{code:>3}\n{value}\n"),
        };
    }
    out
}

fn learned(pipeline: &Pipeline, sku: &Sku, settings: &JobSettings) -> LearnedPart {
    let part = PartFile::alone("mouse.glb", *include_bytes!("../examples/parts/mouse.glb"));
    pipeline.learn(sku, &part, &settings.part).expect("the mouse can be learned")
}

#[divan::bench(args = KINDS, sample_count = 5, sample_size = 1)]
fn floor_of_scan_and_print(bencher: Bencher, kind: &str) {
    let drawing = drawing(kind);
    bencher.bench_local(|| scanned_and_printed(black_box(&drawing)));
}

#[divan::bench(args = KINDS, sample_count = 5, sample_size = 1)]
fn read(bencher: Bencher, kind: &str) {
    let drawing = drawing(kind);
    bencher.bench_local(|| pattern::read(black_box(drawing.as_bytes()), &PatternOptions::default()));
}

#[divan::bench(args = KINDS, sample_count = 5, sample_size = 1)]
fn read_correct_and_write(bencher: Bencher, kind: &str) {
    let drawing = drawing(kind);
    let (pipeline, settings) = (Pipeline::new(None), JobSettings::default());
    let sku: Sku = "mouse".parse().expect("a SKU");
    let learned = learned(&pipeline, &sku, &settings);
    let input = PatternInput { name: "large.dxf", bytes: drawing.as_bytes(), previous: None };
    let correct = || pipeline.correct(&sku, black_box(&learned), input, &settings, false);
    for timing in correct().expect("the drawing fits the mouse").report.timings {
        eprintln!("  {kind}: {} {:.0} ms", timing.stage, timing.ms);
    }
    bencher.bench_local(correct);
}
