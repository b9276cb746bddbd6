//! The program as a station that is killed with −9 many times while drops arrive in many ways; afterwards every drop is
//! accounted for. An importer takes results away meanwhile, so that a second delivery is noticed.
//!
//! `cargo test --test station_kills` kills it a few times; `ISOMARK_KILLS=600 ISOMARK_SEED=7 cargo test --release
//! --test station_kills -- --nocapture` as often as given, and prints the counts.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test may fail loudly, its helpers too"
)]

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use fs_err as fs;

mod schemas;

const SKUS: [&str; 3] = ["trough", "Gutter", "rinne"];
const VARIANTS: usize = 8;

fn settings(repeat: &str) -> String {
    format!(
        "[station]\nname = \"kills\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 100\n\
         height_mm = 100\n[output]\ncomments = false\n[watch]\nsettle_ms = 60\nopen_ended_s = 0\nrescan_s = 0.2\nincomplete_s = 1\n\
         [delivery]\nrepeat = \"{repeat}\"\n"
    )
}

/// A shallow trough, with a different depth for each SKU.
fn part(sku: usize) -> String {
    let depth = 1.0 + sku as f64 * 0.5;
    format!(
        "v -20 -20 {depth}\nv 0 -20 0\nv 20 -20 {depth}\nv -20 20 {depth}\nv 0 20 0\nv 20 20 {depth}\nf 1 2 5 4\nf 2 3 6 5\n"
    )
}

fn drawing(variant: usize) -> Vec<u8> {
    let mut text =
        String::from("0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n");
    for line in 0..=variant * 5 {
        let y = line as f64 * 0.3 - 6.0;
        text += &format!("0\nLINE\n8\nMARK\n10\n{}\n20\n{y}\n11\n9\n21\n{y}\n", -9.0 - variant as f64 * 0.5);
    }
    (text + "0\nENDSEC\n0\nEOF\n").into_bytes()
}

/// SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % limit as u64) as usize
    }
}

/// What was dropped under a name, and the permitted outcomes.
#[derive(Debug)]
enum Fate {
    /// Delivered once, with these bytes.
    Delivered { sku: usize, variant: usize, drops: usize },
    /// Dropped again with different content: each version delivered at most once, the last one certainly.
    Replaced { sku: usize, variants: Vec<usize> },
    /// Written again by a writer that keeps it open: the first version delivered at most once, the second one
    /// certainly.
    Rewritten { sku: usize, variants: [usize; 2] },
    /// Removed by the designer: delivered at most once.
    Deleted { sku: usize, variant: usize },
    /// Moved to the rejected folder.
    Rejected,
    /// It waits for a part that never arrives.
    Waits,
}

struct Slow {
    file: File,
    rest: Vec<u8>,
}

/// A writer that keeps its drop open and later writes another version into it.
struct Held {
    file: File,
    second: Vec<u8>,
}

struct Harness {
    folder: tempfile::TempDir,
    program: Option<Child>,
    random: Random,
    fates: BTreeMap<String, Fate>,
    slow: Vec<Slow>,
    held: Vec<Held>,
    /// The drawings that the importer took away: name and content, in order.
    taken: Vec<(String, Vec<u8>)>,
    repeat: &'static str,
    count: usize,
}

impl Harness {
    fn new(seed: u64) -> Self {
        let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        for name in ["hot", "import", "outside", "taken"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        let repeat = if seed.is_multiple_of(2) { "never" } else { "if-gone" };
        fs::write(folder.path().join("station.toml"), settings(repeat)).unwrap();
        let (random, fates) = (Random(seed), BTreeMap::new());
        let (slow, held, taken) = (Vec::new(), Vec::new(), Vec::new());
        Self { folder, program: None, random, fates, slow, held, taken, repeat, count: 0 }
    }

    fn path(&self, relative: &str) -> PathBuf {
        self.folder.path().join(relative)
    }

    fn start(&mut self) {
        let log = fs::OpenOptions::new().create(true).append(true).open(self.path("log.txt")).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_isomark"));
        command.args(["watch", "station.toml"]).current_dir(self.folder.path()).env_remove("RUST_LOG");
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log.into_parts().0);
        self.program = Some(command.spawn().unwrap());
    }

    fn kill(&mut self) {
        let mut program = self.program.take().unwrap();
        assert_eq!(program.try_wait().unwrap(), None, "the program ended by itself: {}", self.log());
        program.kill().unwrap();
        program.wait().unwrap();
    }

    fn log(&self) -> String {
        let text = fs::read_to_string(self.path("log.txt")).unwrap_or_default();
        text.lines().rev().take(60).collect::<Vec<_>>().join("\n")
    }

    fn rename_into(&self, name: &str, bytes: &[u8]) {
        let outside = self.path("outside/file");
        fs::write(&outside, bytes).unwrap();
        fs::rename(outside, self.path("hot").join(name)).unwrap();
    }

    fn name(&mut self, sku: usize) -> String {
        self.count += 1;
        format!("{}@{}.dxf", SKUS[sku], self.count)
    }

    /// Makes one more drop, in one of the ways in which people and programs do it.
    fn drop_something(&mut self) {
        let (sku, variant) = (self.random.below(SKUS.len()), self.random.below(VARIANTS));
        let (name, bytes) = (self.name(sku), drawing(variant));
        let hot = self.path("hot").join(&name);
        let delivered = Fate::Delivered { sku, variant, drops: 1 };
        match self.random.below(16) {
            0..=3 => {
                self.rename_into(&name, &bytes);
                self.fates.insert(name, delivered);
            }
            4 | 5 => {
                fs::write(hot, &bytes).unwrap();
                self.fates.insert(name, delivered);
            }
            6 => {
                let file = File::create(hot).unwrap();
                self.slow.push(Slow { file, rest: bytes });
                self.fates.insert(name, delivered);
            }
            7 => {
                self.rename_into(&name, &bytes);
                let fate = Fate::Deleted { sku, variant };
                self.fates.insert(name, fate);
                if self.random.below(2) == 0 {
                    // The station may already have processed it.
                    let _ = std::fs::remove_file(hot);
                }
            }
            8 => {
                let garbage: [&[u8]; 3] = [
                    b"0\nSECTION\n2\nENTITIES\n0\nENDSEC\n0\nEOF\n",
                    b"PK\x03\x04",
                    &bytes[..bytes.len() / 2],
                ];
                self.rename_into(&name, garbage[variant % 3]);
                self.fates.insert(name, Fate::Rejected);
            }
            9 => {
                let name = format!("unknown@{}.dxf", self.count);
                self.rename_into(&name, &bytes);
                self.fates.insert(name, Fate::Waits);
            }
            10..=13 => self.drop_again(),
            // On Windows, a file that is open for writing cannot be read.
            14 if cfg!(unix) => {
                let second = (variant + 1) % VARIANTS;
                let outside = self.path("outside/held");
                fs::write(&outside, &bytes).unwrap();
                let file = File::options().read(true).write(true).open(&outside).unwrap();
                fs::rename(outside, hot).unwrap();
                self.held.push(Held { file, second: drawing(second) });
                self.fates.insert(name, Fate::Rewritten { sku, variants: [variant, second] });
            }
            _ => {
                // The same part again changes nothing.
                self.rename_into(&format!("{}.obj", SKUS[sku]), part(sku).as_bytes());
            }
        }
    }

    /// Drops a file with a known name again, with the same or with different content.
    fn drop_again(&mut self) {
        let known: Vec<String> = self.fates.keys().cloned().collect();
        if known.is_empty() {
            return;
        }
        let name = known[self.random.below(known.len())].clone();
        if self.path("hot").join(&name).exists() {
            return;
        }
        let other = self.random.below(VARIANTS);
        let same_again = self.repeat == "never" && self.random.below(2) == 0;
        let bytes = match self.fates.get_mut(&name) {
            Some(Fate::Delivered { variant, drops, .. }) if same_again => {
                *drops += 1;
                drawing(*variant)
            }
            Some(fate) => {
                let (sku, mut variants) = match fate {
                    Fate::Delivered { sku, variant, drops: 1 } => (*sku, vec![*variant]),
                    Fate::Replaced { sku, variants } => (*sku, variants.clone()),
                    _ => return,
                };
                if variants.contains(&other) {
                    return;
                }
                variants.push(other);
                *fate = Fate::Replaced { sku, variants };
                drawing(other)
            }
            None => return,
        };
        self.rename_into(&name, &bytes);
    }

    /// Does the work outside the station: slow writers continue, the importer takes results away.
    fn tick(&mut self) {
        for slow in &mut self.slow {
            let piece = slow.rest.len().min(40);
            slow.file.write_all(&slow.rest[..piece]).unwrap();
            slow.rest.drain(..piece);
        }
        self.slow.retain(|slow| !slow.rest.is_empty());
        if !self.held.is_empty() && self.random.below(40) == 0 {
            let mut held = self.held.remove(0);
            held.file.set_len(0).unwrap();
            held.file.seek(SeekFrom::Start(0)).unwrap();
            held.file.write_all(&held.second).unwrap();
        }
        if self.random.below(4) == 0 {
            self.take_results();
        }
        std::thread::sleep(Duration::from_millis(1));
    }

    fn take_results(&mut self) {
        for entry in fs::read_dir(self.path("import")).unwrap() {
            let entry = entry.unwrap();
            let name = entry.file_name().to_str().unwrap().to_owned();
            if name.starts_with('.') {
                continue;
            }
            let taken = self.path("taken").join(format!("{}-{name}", self.taken.len()));
            fs::rename(entry.path(), &taken).unwrap();
            let bytes = fs::read(taken).unwrap();
            assert!(
                bytes.ends_with(b"EOF\n") || bytes.ends_with(b"EOF\r\n"),
                "the import folder contained an incomplete drawing: {name}"
            );
            self.taken.push((name, bytes));
        }
    }

    fn expected(&self) -> Vec<Vec<Vec<u8>>> {
        let clean = Harness::new(1);
        for (sku, name) in SKUS.iter().enumerate() {
            clean.rename_into(&format!("{name}.obj"), part(sku).as_bytes());
            (0..VARIANTS)
                .for_each(|variant| clean.rename_into(&format!("{name}@{variant}.dxf"), &drawing(variant)));
        }
        let mut command = Command::new(env!("CARGO_BIN_EXE_isomark"));
        command.args(["watch", "station.toml", "--once"]).current_dir(clean.folder.path());
        assert!(command.stdout(Stdio::null()).stderr(Stdio::null()).status().unwrap().success());
        let read =
            |name: &str, variant| fs::read(clean.path(&format!("import/{name}@{variant}.dxf"))).unwrap();
        SKUS.iter().map(|name| (0..VARIANTS).map(|variant| read(name, variant)).collect()).collect()
    }

    fn waits_until_all_is_done(&mut self) {
        let started = Instant::now();
        loop {
            self.tick();
            let left: Vec<String> = names(&self.path("hot"));
            let waits = |name: &String| matches!(self.fates.get(name), Some(Fate::Waits));
            // A processed file stays parked while its writer may still write to it.
            let is_over = self.held.is_empty() && !self.path("state/parked").exists();
            if self.slow.is_empty() && is_over && left.iter().all(waits) {
                break;
            }
            assert!(started.elapsed() < Duration::from_secs(120), "still in hot: {left:?}: {}", self.log());
        }
        self.take_results();
    }

    /// Checks that every drop had a permitted outcome; returns the counts as text.
    fn account(&self) -> String {
        let expected = self.expected();
        let archived = files(&self.path("archive"));
        let mut counts = [0usize; 7];
        for (name, fate) in &self.fates {
            let results: Vec<&Vec<u8>> =
                self.taken.iter().filter(|(taken, _)| taken == name).map(|(_, bytes)| bytes).collect();
            let originals = archived.iter().filter(|path| path.ends_with(name.as_str())).count();
            let context = || {
                let lines = fs::read_to_string(self.path("state/journal.log")).unwrap_or_default();
                let about: Vec<&str> = lines.lines().filter(|line| line.contains(name.as_str())).collect();
                format!(
                    "{name}, {fate:?}: {} results, {originals} originals\n{}",
                    results.len(),
                    about.join("\n")
                )
            };
            match fate {
                Fate::Delivered { sku, variant, drops } => {
                    assert!(results.len() == 1 && *results[0] == expected[*sku][*variant], "{}", context());
                    assert_eq!(originals, *drops, "{}", context());
                    counts[if *drops == 1 { 0 } else { 1 }] += 1;
                }
                Fate::Replaced { sku, variants } => {
                    let found: Vec<_> = results
                        .iter()
                        .map(|result| expected[*sku].iter().position(|e| e == *result))
                        .collect();
                    let dropped: Vec<_> = variants.iter().map(|variant| Some(*variant)).collect();
                    // A version may be replaced before the importer takes it.
                    let mut left = dropped.iter();
                    let in_order = found.iter().all(|result| left.any(|variant| variant == result));
                    assert!(in_order && found.last() == dropped.last(), "{found:?}: {}", context());
                    assert_eq!(originals, dropped.len(), "{}", context());
                    counts[2] += 1;
                }
                Fate::Rewritten { sku, variants: [first, second] } => {
                    let found: Vec<&Vec<u8>> = results.clone();
                    let is_second = found.last().is_some_and(|last| **last == expected[*sku][*second]);
                    let before = &found[..found.len().saturating_sub(1)];
                    let is_first = before.iter().all(|result| **result == expected[*sku][*first]);
                    assert!(is_second && is_first && before.len() <= 1, "{}", context());
                    // The first version may have been overwritten before it was read or filed.
                    assert!((1..=2).contains(&originals), "{}", context());
                    counts[6] += 1;
                }
                Fate::Deleted { sku, variant } => {
                    let is_right = results.iter().all(|result| **result == expected[*sku][*variant]);
                    assert!(results.len() <= 1 && is_right && originals <= results.len(), "{}", context());
                    counts[3] += 1;
                }
                Fate::Rejected => {
                    let rejected = self.path("rejected").join(name);
                    assert!(results.is_empty() && rejected.exists(), "{}", context());
                    assert!(
                        self.path("rejected").join(format!("{name}.reason.txt")).exists(),
                        "{}",
                        context()
                    );
                    counts[4] += 1;
                }
                Fate::Waits => {
                    assert!(results.is_empty() && self.path("hot").join(name).exists(), "{}", context());
                    counts[5] += 1;
                }
            }
        }
        let left: Vec<String> = names(&self.path("import"));
        assert!(left.is_empty(), "left in the import folder: {left:?}");
        let [once, twice, replaced, deleted, rejected, waiting, rewritten] = counts;
        let log = fs::read_to_string(self.path("log.txt")).unwrap();
        // Kills between delivery and archive.
        let resumed = log.matches("before the station was interrupted").count();
        format!(
            "{} drops: {once} delivered once, {twice} dropped again and delivered once, {replaced} in several versions, \
             {rewritten} written again, {deleted} taken away, {rejected} rejected, {waiting} waiting; {resumed} times between delivery and archive",
            self.fates.len()
        )
    }
}

impl Drop for Harness {
    fn drop(&mut self) {
        if let Some(mut program) = self.program.take() {
            let _ = program.kill();
            let _ = program.wait();
        }
        schemas::check_below(self.folder.path());
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    entries.map(|entry| entry.unwrap().file_name().to_str().unwrap().to_owned()).collect()
}

fn files(folder: &Path) -> Vec<String> {
    let mut all = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(next) = open.pop() {
        for path in fs::read_dir(&next).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() { open.push(path) } else { all.push(path.to_str().unwrap().replace('\\', "/")) }
        }
    }
    all
}

fn run(seed: u64, kills: usize) -> String {
    let mut harness = Harness::new(seed);
    for (sku, name) in SKUS.iter().enumerate() {
        harness.rename_into(&format!("{name}.obj"), part(sku).as_bytes());
    }
    for _ in 0..kills {
        let drops = harness.random.below(3);
        // Every third kill is aimed at the moment at which a file appears in the import folder.
        let aimed = harness.random.below(3) == 0;
        if aimed {
            harness.take_results();
            harness.drop_something();
        }
        harness.start();
        let longest = if aimed { 1000 } else { [60, 150, 500][harness.random.below(3)] };
        let until = Duration::from_millis(harness.random.below(longest) as u64);
        let started = Instant::now();
        let mut dropped = 0;
        while started.elapsed() < until {
            if aimed {
                if !names(&harness.path("import")).is_empty() {
                    break;
                }
                continue;
            }
            if dropped < drops && harness.random.below(20) == 0 {
                harness.drop_something();
                dropped += 1;
            }
            harness.tick();
        }
        harness.kill();
        // Some drops arrive while the station is not running.
        if harness.random.below(3) == 0 {
            harness.drop_something();
        }
    }
    harness.start();
    harness.waits_until_all_is_done();
    harness.kill();
    harness.account()
}

#[test]
fn every_drop_is_accounted_for_after_kills_at_any_moment() {
    let setting = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let (kills, seed) =
        (setting("ISOMARK_KILLS").unwrap_or(24) as usize, setting("ISOMARK_SEED").unwrap_or(1));
    for (seed, share) in [(seed, kills / 2), (seed + 1, kills - kills / 2)] {
        println!("seed {seed}, {share} kills: {}", run(seed, share));
    }
}
