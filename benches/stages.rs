//! Each stage of the pipeline on the mouse of the reference cases, with minimum times for comparison.

use std::collections::BTreeMap;
use std::hint::black_box;

use divan::Bencher;
use isomark::cache::Cache;
use isomark::config::{JobSettings, Sku};
use isomark::cores::Cores;
use isomark::formats::mesh::{self, MeshFormat, MeshOptions, PartFile};
use isomark::formats::pattern::{self, DxfProfile, PatternOptions};
use isomark::geometry::correction::{Projection, Subdivision};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::height_field::Grid;
use isomark::geometry::mapping::isometric::IsometricOptions;
use isomark::geometry::mapping::{LengthTrueMap, Method, quality};
use isomark::geometry::marking::{MarkingDrawing, MarkingPath, MarkingShape};
use isomark::geometry::mesh::TriMesh;
use isomark::geometry::optics::{Fixture, ScanHead};
use isomark::geometry::pattern::{Affine, Color, Layer, Pattern};
use isomark::geometry::shapes;
use isomark::geometry::space::{FieldPoint, FlatPoint, View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use isomark::pipeline::{PatternInput, Pipeline};

const LETTERS: &[u8] = include_bytes!("../examples/patterns/letters.dxf");
/// Read when it is needed: packages of the crate leave out the tests.
const STEP: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/parts/mandarin/part.step");
const ANCHOR: FlatPoint = FlatPoint::new(0.0, 8.0);

fn main() {
    divan::main();
}

/// The mouse with edges of `edge` mm: 0.75 mm gives 13,000 triangles, 0.27 mm about 100,000.
fn mesh(edge: f64) -> TriMesh {
    shapes::graph(32.0, edge, shapes::mouse)
}

fn surface() -> FittedSurface {
    let part = FacingPart::new(&mesh(0.75), &View::top());
    FittedSurface::of_part(&part, &FitOptions::default()).expect("the mouse has a surface")
}

fn letters() -> Pattern {
    let pattern =
        pattern::read(LETTERS, &PatternOptions::default()).expect("the letters are a drawing").pattern;
    let center = pattern.extents().center().into();
    pattern.transformed(&Affine::rigid(center, 0.0, ANCHOR))
}

fn map(surface: &FittedSurface, pattern: &Pattern, options: IsometricOptions) -> LengthTrueMap {
    LengthTrueMap::find(surface, pattern, |_| true, ANCHOR, &Method::Isometric(options))
        .expect("there is a map")
}

#[divan::bench(args = [0.75, 0.27])]
fn sample_and_fit(bencher: Bencher, edge: f64) {
    let mesh = mesh(edge);
    bencher.bench(|| {
        let part = FacingPart::new(black_box(&mesh), &View::top());
        FittedSurface::of_part(&part, &FitOptions::default())
    });
}

#[divan::bench(args = [0.75, 0.27])]
fn sample_and_fit_on_all_cores(bencher: Bencher, edge: f64) {
    let mesh = mesh(edge);
    bencher.bench(|| {
        let part = FacingPart::with_fork(black_box(&mesh), &View::top(), &Cores);
        FittedSurface::of_part(&part, &FitOptions::default())
    });
}

#[divan::bench(args = [0.75, 0.27])]
fn sample_only(bencher: Bencher, edge: f64) {
    let mesh = mesh(edge);
    bencher.bench(|| {
        let part = FacingPart::new(black_box(&mesh), &View::top());
        part.sample(&Grid::over(&part.extents(), 0.75))
    });
}

/// The minimum work of a pattern reader: visiting every byte of the file.
#[divan::bench]
fn floor_of_read_pattern(bencher: Bencher) {
    bencher.bench(|| black_box(LETTERS).iter().filter(|byte| **byte == b'\n').count());
}

#[divan::bench]
fn read_pattern(bencher: Bencher) {
    bencher.bench(|| pattern::read(black_box(LETTERS), &PatternOptions::default()));
}

#[divan::bench]
fn floor_of_read_step(bencher: Bencher) {
    let step = std::fs::read(STEP).expect("the sample of the tests is there");
    bencher.bench(|| black_box(&step).iter().filter(|byte| **byte == b';').count());
}

#[divan::bench]
fn read_step(bencher: Bencher) {
    let (step, options) =
        (std::fs::read(STEP).expect("the sample of the tests is there"), MeshOptions::default());
    bencher.bench(|| mesh::read(black_box(&step), MeshFormat::Step, &options, &BTreeMap::new()));
}

#[divan::bench(args = ["ink", "uniform"])]
fn map_letters(bencher: Bencher, weighting: &str) {
    let options = if weighting == "ink" { IsometricOptions::INK } else { IsometricOptions::UNIFORM };
    let (surface, pattern) = (surface(), letters());
    bencher.bench(|| map(black_box(&surface), black_box(&pattern), options));
}

#[divan::bench]
fn bend_and_write(bencher: Bencher) {
    let (surface, pattern) = (surface(), letters());
    let map = map(&surface, &pattern, IsometricOptions::INK);
    bencher.bench(|| {
        let projection = Projection {
            map: &map,
            surface: &surface,
            fixture: Fixture::default(),
            head: ScanHead::TELECENTRIC,
        };
        let drawing = projection.bend(black_box(&pattern), 0.01, Subdivision::Adaptive);
        drawing.map(|bent| pattern::write(&bent.drawing, DxfProfile::R2000))
    });
}

#[divan::bench]
fn measure(bencher: Bencher) {
    let (surface, pattern) = (surface(), letters());
    let map = map(&surface, &pattern, IsometricOptions::INK);
    let ink = quality::sample(&pattern, |_| true);
    bencher.bench(|| {
        quality::measure(black_box(&ink), |at| map.point(at), |at: ViewPoint| surface.sampled_height(at))
    });
}

/// A complete correction with the files in memory and the surface in the cache on disk.
#[divan::bench]
fn correct_with_cached_surface(bencher: Bencher) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let pipeline = Pipeline::new(Some(Cache::new(folder.path())));
    let sku: Sku = "mouse".parse().expect("a SKU");
    let mut settings = JobSettings::default();
    settings.placement.place = Some(ViewPoint::new(ANCHOR.x, ANCHOR.y));
    let part = PartFile::alone("mouse.glb", *include_bytes!("../examples/parts/mouse.glb"));
    pipeline.learn(&sku, &part, &settings.part).expect("the mouse can be learned");
    bencher.bench(|| {
        let learned = pipeline
            .recall(&sku, &settings.part, &mut Vec::new())
            .expect("the cache works")
            .expect("the mouse is known");
        let input = PatternInput { name: "letters.dxf", bytes: LETTERS, previous: None };
        pipeline.correct(&sku, &learned, input, &settings, false)
    });
}

/// A drawing with paths of `each` vertices, read back by the second reader.
#[divan::bench(args = [(100usize, 1_000usize), (100, 10_000), (100, 100_000), (1, 10_000), (2, 10_000)], consts = [0, 1, 2])]
fn read_back<const PROFILE: usize>(bencher: Bencher, (each, vertices): (usize, usize)) {
    let profile = [DxfProfile::R2000, DxfProfile::R12, DxfProfile::R12Lines][PROFILE];
    let path = |number: usize| MarkingPath {
        layer: 0,
        color: Color::ByLayer,
        shape: MarkingShape::Open(
            (0..each).map(|at| FieldPoint::new(0.123_457 * at as f64, -0.1 * number as f64 / 3.0)).collect(),
        ),
    };
    let drawing = MarkingDrawing {
        layers: vec![Layer { name: "MARK".into(), color: Color::Aci(7) }],
        paths: (0..vertices / each).map(path).collect(),
        comments: Vec::new(),
    };
    let file = pattern::write(&drawing, profile);
    bencher.bench(|| pattern::read_back(black_box(&file), &drawing, profile));
}
