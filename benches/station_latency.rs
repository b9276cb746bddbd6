//! The time of a running station from the rename of a drop into the hot folder to the corrected drawing in the import
//! folder, with a cached surface.
//!
//! `cargo bench --bench station_latency` prints the median and the 95th and 99th percentile for single drops and for a
//! burst of drops of one SKU, which are processed in parallel: of one drawing, as for a series of pieces, and of drawings that
//! all differ. The last figure of a burst is its rate until the last drawing was delivered. For comparison it prints the minimum I/O time: writing,
//! flushing and renaming a file of the result's size on the same disk.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use isomark::files::write_whole;

const DROPS: usize = 200;
const BURST: usize = 1000;
const LETTERS: &[u8] = include_bytes!("../examples/patterns/letters.dxf");
const MOUSE: &[u8] = include_bytes!("../examples/parts/mouse.glb");
const STATION: &str = "[station]\nname = \"bench\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n\
                       [field]\nwidth_mm = 110\nheight_mm = 110\n[placement]\nplace_mm = [0, 8]\n";

/// The station, which is killed when the benchmark ends for any reason.
struct Station(Child);

impl Drop for Station {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn main() -> std::io::Result<()> {
    // `cargo test --benches` only checks that it starts.
    if !std::env::args().any(|argument| argument == "--bench") {
        return Ok(());
    }
    let folder = tempfile::tempdir()?;
    let at = |name: &str| folder.path().join(name);
    for name in ["hot", "import", "outside"] {
        fs_err::create_dir(at(name))?;
    }
    fs_err::write(at("station.toml"), STATION)?;
    let mut command = Command::new(env!("CARGO_BIN_EXE_isomark"));
    let _station = Station(command.arg("watch").arg(at("station.toml")).stderr(Stdio::null()).spawn()?);

    drop_into(folder.path(), "mouse.glb", MOUSE)?;
    wait_for(&at("archive/mouse/mouse.glb"), Duration::from_secs(30));
    let mut times = Vec::with_capacity(DROPS);
    for number in 0..DROPS {
        let name = format!("mouse@{number}.dxf");
        let start = drop_into(folder.path(), &name, LETTERS)?;
        wait_for(&at("import").join(&name), Duration::from_secs(10));
        times.push(start.elapsed());
        // Wait until the station has archived the original: single drops are measured, not a queue.
        wait_for(&at("archive/mouse").join(&name), Duration::from_secs(10));
    }
    let result = fs_err::read(at("import/mouse@0.dxf"))?;
    let mut floor = Vec::with_capacity(DROPS);
    for number in 0..DROPS {
        let start = Instant::now();
        write_whole(&at("outside"), &format!("{number}.dxf"), &result)?;
        floor.push(start.elapsed());
    }
    let mut equal = burst(folder.path(), "equal", |_| LETTERS.to_vec())?;
    let mut different = burst(folder.path(), "different", different)?;
    for (what, times) in [
        ("rename-into to result", &mut times),
        ("in a burst of equal drawings", &mut equal),
        ("in a burst of different ones", &mut different),
        ("minimum: write, flush, rename", &mut floor),
    ] {
        times.sort();
        let at = |share: usize| times[(times.len() - 1) * share / 100].as_secs_f64() * 1e3;
        let mut line =
            format!("{what:<30} median {:8.2} ms   95 % {:8.2} ms   99 % {:8.2} ms", at(50), at(95), at(99));
        if times.len() == BURST {
            line += &format!("   {:6.1} / s", BURST as f64 * 1e3 / at(100));
        }
        std::io::Write::write_all(&mut std::io::stdout(), (line + "\n").as_bytes())?;
    }
    Ok(())
}

/// The letters with one more short line, which is elsewhere for each number.
fn different(number: usize) -> Vec<u8> {
    let [x, y] = [number % 40, number / 40].map(|step| 4.0 + 0.2 * step as f64);
    let line = format!("  0\nLINE\n  8\nOUTLINE\n 10\n{x}\n 20\n{y}\n 11\n{}\n 21\n{y}\n", x + 0.1);
    String::from_utf8_lossy(LETTERS).replacen("ENTITIES\n", &format!("ENTITIES\n{line}"), 1).into_bytes()
}

/// The time of each drop of a burst.
fn burst(folder: &Path, kind: &str, drawing: impl Fn(usize) -> Vec<u8>) -> std::io::Result<Vec<Duration>> {
    let mut dropped = BTreeMap::new();
    for number in 0..BURST {
        fs_err::write(folder.join(format!("outside/mouse@{kind}{number}.dxf")), drawing(number))?;
    }
    for number in 0..BURST {
        let name = format!("mouse@{kind}{number}.dxf");
        let start = Instant::now();
        fs_err::rename(folder.join("outside").join(&name), folder.join("hot").join(&name))?;
        dropped.insert(name, start);
    }
    let (mut times, started) = (Vec::with_capacity(BURST), Instant::now());
    while !dropped.is_empty() {
        assert!(started.elapsed() < Duration::from_secs(600), "{} drawings did not arrive", dropped.len());
        for entry in fs_err::read_dir(folder.join("import"))? {
            let name = entry?.file_name().to_string_lossy().into_owned();
            times.extend(dropped.remove(&name).map(|start| start.elapsed()));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(times)
}

/// Writes the file outside the hot folder and renames it into the folder; returns the time just before the rename.
fn drop_into(folder: &Path, name: &str, bytes: &[u8]) -> std::io::Result<Instant> {
    let outside = folder.join("outside").join(name);
    fs_err::write(&outside, bytes)?;
    let start = Instant::now();
    fs_err::rename(outside, folder.join("hot").join(name))?;
    Ok(start)
}

fn wait_for(path: &Path, limit: Duration) {
    let start = Instant::now();
    while !path.exists() {
        assert!(start.elapsed() < limit, "{} did not arrive", path.display());
        std::thread::sleep(Duration::from_micros(200));
    }
}
