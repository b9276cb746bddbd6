//! The time from a row of a list to its corrected drawing on the disk: letters of 39 x 13 mm with a serial number and a Data
//! Matrix on the mouse, whose surface is kept.
//!
//! `cargo bench --bench job_list` prints the products per second and the median, 99th percentile and maximum.

use std::time::Instant;

use isomark::cache::Cache;
use isomark::config::{JobSettings, Sku};
use isomark::files::write_whole;
use isomark::formats::list::List;
use isomark::formats::mesh::PartFile;
use isomark::pipeline::{PatternInput, Pipeline};

const ROWS: u64 = 500;
const LETTERS: &str = include_str!("../examples/patterns/letters.dxf");
const MOUSE: &[u8] = include_bytes!("../examples/parts/mouse.glb");
const SETTINGS: &str = "placement.place_mm = [0, 8]\n[content]\n\
                        codes = [{ layer = \"DM\", kind = \"data-matrix\", content = \"{csv:LOT} {serial:06}\" }]\n";
/// A serial number and a placeholder below the letters.
const MORE: &str = "  0\nTEXT\n  8\nMARK\n 10\n-15\n 20\n-12\n 40\n3\n  1\nNo {serial:06}\n  0\nLWPOLYLINE\n  8\nDM\n 90\n4\n 70\n1\n \
                    10\n10\n 20\n-18\n 10\n20\n 20\n-18\n 10\n20\n 20\n-8\n 10\n10\n 20\n-8\n";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // `cargo test --benches` only checks that it starts.
    if !std::env::args().any(|argument| argument == "--bench") {
        return Ok(());
    }
    let (head, entities) = LETTERS.split_once("ENTITIES\n").ok_or("the sample has entities")?;
    let drawing = format!("{head}ENTITIES\n{MORE}{entities}");
    let list = (0..ROWS).fold("LOT\n".to_owned(), |list, row| list + &format!("A{row}\n"));
    let folder = tempfile::tempdir()?;
    let sku: Sku = "mouse".parse()?;
    let settings = JobSettings::default().overridden_by("bench.toml".as_ref(), SETTINGS)?;
    let pipeline = Pipeline::new(Some(Cache::new(folder.path().join("cache"))));
    let learned = pipeline.learn(&sku, &PartFile::alone("mouse.glb", MOUSE.to_vec()), &settings.part)?;
    let start = Instant::now();
    let mut times = Vec::new();
    for row in List::new(list.as_bytes())? {
        let began = Instant::now();
        let row = row?;
        let mut settings = settings.clone();
        settings.content.values.serial = Some(row.number);
        settings.content.values.row = row.values;
        let input = PatternInput { name: "letters.dxf", bytes: drawing.as_bytes(), previous: None };
        let corrected = pipeline.correct(&sku, &learned, input, &settings, false)?;
        assert_eq!(corrected.report.content.as_ref().map(|content| content.codes.len()), Some(1));
        write_whole(folder.path(), &format!("letters-{:04}.dxf", row.number), &corrected.dxf)?;
        times.push(began.elapsed());
    }
    let rate = times.len() as f64 / start.elapsed().as_secs_f64();
    times.sort();
    let at = |share: usize| times[(times.len() - 1) * share / 100].as_secs_f64() * 1e3;
    let line = format!(
        "row to drawing: {rate:.0} products/s, median {:.1} ms, 99 % {:.1} ms, maximum {:.1} ms\n",
        at(50),
        at(99),
        at(100)
    );
    std::io::Write::write_all(&mut std::io::stdout(), line.as_bytes())?;
    Ok(())
}
