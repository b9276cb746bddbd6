//! The readers of 3MF, compressed glTF, PLY and SVG, compared with decompressing and looking at every byte once.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::hint::black_box;
use std::io::{Read, Write as _};
use std::path::Path;

use divan::{AllocProfiler, Bencher};
use isomark::formats::mesh::{MeshFormat, MeshOptions, read};
use isomark::formats::pattern::{self, PatternOptions};

#[global_allocator]
static ALLOCATOR: AllocProfiler = AllocProfiler::system();

/// Vertices along each side of the surface.
const SIDE: usize = 300;

fn main() {
    divan::main();
}

/// Corners and triangles of a wavy surface of 180,000 triangles.
fn surface() -> (Vec<[f64; 3]>, Vec<[usize; 3]>) {
    let at = |index: usize| {
        let (x, y) = ((index % SIDE) as f64 * 0.2, (index / SIDE) as f64 * 0.2);
        [x, y, (x / 9.0).sin() + (y / 7.0).cos()]
    };
    let cells = (0..SIDE * (SIDE - 1)).filter(|index| index % SIDE + 1 < SIDE);
    let triangles = cells.flat_map(|a| [[a, a + 1, a + SIDE + 1], [a, a + SIDE + 1, a + SIDE]]).collect();
    ((0..SIDE * SIDE).map(at).collect(), triangles)
}

fn model() -> String {
    let (points, triangles) = surface();
    let mut text = String::from("<model unit='millimeter'><resources><object id='1'><mesh><vertices>");
    // Writing into a String cannot fail.
    for [x, y, z] in points {
        let _ = write!(text, "<vertex x='{x:.5}' y='{y:.5}' z='{z:.5}'/>");
    }
    text += "</vertices><triangles>";
    for [a, b, c] in triangles {
        let _ = write!(text, "<triangle v1='{a}' v2='{b}' v3='{c}'/>");
    }
    text + "</triangles></mesh></object></resources><build><item objectid='1'/></build></model>"
}

/// The model and a ZIP archive of it.
fn package() -> std::io::Result<(Vec<u8>, Vec<u8>)> {
    let (name, content) = ("3D/3dmodel.model", model());
    let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(content.as_bytes())?;
    let data = encoder.finish()?;
    let mut crc = flate2::Crc::new();
    crc.update(content.as_bytes());
    let mut common = vec![20, 0, 0, 0, 8, 0, 0, 0, 0, 0];
    common.extend(crc.sum().to_le_bytes());
    common.extend((data.len() as u32).to_le_bytes());
    common.extend((content.len() as u32).to_le_bytes());
    common.extend([name.len() as u8, 0, 0, 0]);
    let mut archive = [b"PK\x03\x04", &common[..], name.as_bytes(), &data].concat();
    let directory = [b"PK\x01\x02\x14\0", &common[..], &[0; 14], name.as_bytes()].concat();
    let start = archive.len() as u32;
    archive.extend(&directory);
    archive.extend(b"PK\x05\x06\0\0\0\0\x01\0\x01\0");
    archive.extend((directory.len() as u32).to_le_bytes());
    archive.extend(start.to_le_bytes());
    archive.extend([0, 0]);
    Ok((data, archive))
}

fn part(bencher: Bencher<'_, '_>, bytes: &[u8], format: MeshFormat) {
    let (options, siblings) = (MeshOptions::default(), BTreeMap::new());
    bencher
        .counter(divan::counter::BytesCount::of_slice(bytes))
        .bench(|| read(black_box(bytes), format, &options, &siblings).map(|reading| reading.facts.triangles));
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn threemf(bencher: Bencher<'_, '_>) {
    let Ok((_, archive)) = package() else { return };
    part(bencher, &archive, MeshFormat::ThreeMf);
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn threemf_as_plain_bytes(bencher: Bencher<'_, '_>) {
    let Ok((data, _)) = package() else { return };
    bencher.bench(|| {
        let decoder = flate2::read::DeflateDecoder::new(black_box(&data[..]));
        let mut bytes = std::io::BufReader::new(decoder).bytes();
        bytes.try_fold(0u64, |sum, byte| byte.map(|byte| sum + u64::from(byte))).ok()
    });
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn ply(bencher: Bencher<'_, '_>) {
    let (points, triangles) = surface();
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        points.len(),
        triangles.len()
    );
    for [x, y, z] in points {
        let _ = writeln!(text, "{x:.5} {y:.5} {z:.5}");
    }
    for [a, b, c] in triangles {
        let _ = writeln!(text, "3 {a} {b} {c}");
    }
    part(bencher, text.as_bytes(), MeshFormat::Ply);
}

#[divan::bench(args = ["pack_meshopt.glb", "gt_draco.glb", "pack_quantized.glb"])]
fn compressed(bencher: Bencher<'_, '_>, name: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/parts/arch").join(name);
    if let Ok(bytes) = std::fs::read(path) {
        part(bencher, &bytes, MeshFormat::Glb);
    }
}

fn svg() -> String {
    let mut text = String::from(
        "<svg xmlns='http://www.w3.org/2000/svg' width='90mm' height='90mm' viewBox='0 0 90 90'>",
    );
    for ring in 0..200 {
        text += "<path fill='none' stroke='#000' d='M";
        for step in 0..500 {
            let (sin, cos) = (f64::from(step) * 0.0125).sin_cos();
            let radius = 20.0 + 0.1 * f64::from(ring);
            let _ = write!(text, "{:.4} {:.4} ", 45.0 + radius * cos, 45.0 + radius * sin);
        }
        text += "'/>";
    }
    text + "</svg>"
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn svg_paths(bencher: Bencher<'_, '_>) {
    let (text, options) = (svg(), PatternOptions::default());
    bencher.counter(divan::counter::BytesCount::of_str(&text)).bench(|| {
        pattern::read(black_box(text.as_bytes()), &options).map(|reading| reading.pattern.paths.len())
    });
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn svg_as_plain_bytes(bencher: Bencher<'_, '_>) {
    let text = svg();
    bencher.bench(|| black_box(text.as_bytes()).iter().map(|&byte| u64::from(byte)).sum::<u64>());
}
