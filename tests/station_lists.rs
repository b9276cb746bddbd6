//! Lists of products in the hot folder: each row is one drawing with one serial number, exactly once, also when the station is killed.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test may fail loudly, its helpers too"
)]

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use fs_err as fs;
use serde_json::json;

mod schemas;

/// A shallow trough.
const PART: &str =
    "v -20 -20 1\nv 0 -20 0\nv 20 -20 1\nv -20 20 1\nv 0 20 0\nv 20 20 1\nf 1 2 5 4\nf 2 3 6 5\n";
const LONGEST: Duration = Duration::from_secs(120);

fn drawing() -> String {
    "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n0\nTEXT\n8\nMARK\n10\n-12\n20\n-1\n40\n2\n1\n\
     {serial:05} {csv:LOT} {date:%H:%M}\n0\nENDSEC\n0\nEOF\n"
        .into()
}

fn list(lots: std::ops::Range<usize>) -> String {
    let rows: String = lots.map(|lot| format!("L{lot};x\n")).collect();
    format!("LOT;note\n{rows}")
}

struct Station {
    folder: tempfile::TempDir,
    program: Option<Child>,
    /// The drawings that the importer took away.
    taken: Vec<(String, Vec<u8>)>,
}

impl Station {
    fn new(more: &str) -> Self {
        let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        for name in ["hot", "import", "outside"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        let station = Self { folder, program: None, taken: Vec::new() };
        station.write_settings(more);
        station.put("trough.obj", PART);
        station
    }

    fn write_settings(&self, more: &str) {
        let text = format!(
            "[station]\nname = \"lists\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 100\nheight_mm = 100\n\
             [output]\ncomments = false\n[watch]\nsettle_ms = 60\nopen_ended_s = 0\nrescan_s = 0.2\nincomplete_s = 1\n{more}"
        );
        fs::write(self.path("station.toml"), text).unwrap();
    }

    fn path(&self, relative: &str) -> PathBuf {
        self.folder.path().join(relative)
    }

    /// Puts a whole file into the hot folder.
    fn put(&self, name: &str, text: &str) {
        let outside = self.path("outside").join(name);
        fs::write(&outside, text).unwrap();
        fs::rename(outside, self.path("hot").join(name)).unwrap();
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_isomark"));
        command.args(arguments).current_dir(self.folder.path()).env_remove("RUST_LOG").stdin(Stdio::null());
        command
    }

    /// Processes what is in the hot folder; returns the log.
    fn once(&self) -> String {
        let output = self.command(&["watch", "station.toml", "--once"]).output().unwrap();
        String::from_utf8(output.stderr).unwrap()
    }

    fn start(&mut self) {
        let log = fs::OpenOptions::new().create(true).append(true).open(self.path("log.txt")).unwrap();
        let mut command = self.command(&["watch", "station.toml"]);
        self.program = Some(command.stdout(Stdio::null()).stderr(log.into_parts().0).spawn().unwrap());
    }

    fn kill(&mut self) {
        let mut program = self.program.take().unwrap();
        assert_eq!(program.try_wait().unwrap(), None, "the program ended by itself: {}", self.log());
        program.kill().unwrap();
        program.wait().unwrap();
    }

    fn log(&self) -> String {
        let text = fs::read_to_string(self.path("log.txt")).unwrap_or_default();
        text.lines().rev().take(40).collect::<Vec<_>>().join("\n")
    }

    fn names(&self, folder: &str) -> Vec<String> {
        let entries = fs::read_dir(self.path(folder)).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.retain(|name| !name.starts_with('.'));
        names.sort();
        names
    }

    fn take(&mut self) {
        for name in self.names("import") {
            // Wine keeps a removed file that the station still has open, so it would be taken twice.
            let taken = self.path("outside").join(format!("{}-{name}", self.taken.len()));
            fs::rename(self.path("import").join(&name), &taken).unwrap();
            self.taken.push((name, fs::read(taken).unwrap()));
        }
    }

    /// The report of a list.
    fn report_of_list(&self, name: &str) -> serde_json::Value {
        schemas::document(fs::read(self.path(&format!("reports/trough/{name}.list.json"))).unwrap())
    }

    /// The drawing of a product as the command line makes it, with the date that the station gave it.
    fn expected(&self, name: &str, serial: u64, lot: &str) -> Vec<u8> {
        let report =
            fs::read_to_string(self.path(&format!("reports/trough/{name}.dxf.report.json"))).unwrap();
        let report: serde_json::Value = serde_json::from_str(&report).unwrap();
        let (content, date) = (&report["content"], report["content"]["date"].as_str().unwrap());
        assert_eq!((content["serial"].as_u64(), content["row"]["LOT"].as_str()), (Some(serial), Some(lot)));
        let name = format!("{name}.dxf");
        fs::write(self.path(&name), drawing()).unwrap();
        let content = [format!("serial={serial}"), format!("csv.LOT={lot}")];
        let sku = ["correct", "--station", "station.toml", "--sku", "trough", &name, "--out", "expected.dxf"];
        let status = self
            .command(&sku)
            .args(["--content", &content[0], "--content", &content[1], "--date", date])
            .output()
            .unwrap();
        assert!(status.status.success(), "{}", String::from_utf8_lossy(&status.stderr));
        fs::read(self.path("expected.dxf")).unwrap()
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        if let Some(mut program) = self.program.take() {
            let _ = program.kill();
            let _ = program.wait();
        }
        schemas::check_below(self.folder.path());
    }
}

#[test]
fn each_row_is_a_drawing_with_the_next_serial_number() {
    let mut station = Station::new("[serial]\nstart = 10\n");
    station.put("trough@plate.csv", &list(0..3));
    station.put("trough@plate.dxf", &drawing());
    let log = station.once();
    let name = |serial: u64| format!("trough@plate-{serial:06}.dxf");
    assert_eq!(station.names("import"), [name(10), name(11), name(12)], "{log}");
    station.take();
    for (serial, lot) in [(10, "L0"), (11, "L1"), (12, "L2")] {
        let expected = station.expected(&format!("trough@plate-{serial:06}"), serial, lot);
        let found = station.taken.iter().find(|(found, _)| *found == name(serial)).unwrap();
        assert!(found.1 == expected, "{serial}: another drawing than that of the command line");
    }
    assert!(station.names("hot").is_empty(), "{log}");
    // The drawings of the rows come together with their settings.
    assert!(!log.contains("The settings wait"), "{log}");
    let report = station.report_of_list("trough@plate.csv");
    assert_eq!((&report["drawing"], &report["left_out"]), (&"trough@plate.dxf".into(), &json!([])));
    for (row, index) in report["rows"].as_array().unwrap().iter().zip(0u64..) {
        let expected =
            json!({ "row": index + 1, "line": index + 2, "serial": index + 10, "drawing": name(index + 10) });
        assert_eq!(*row, expected);
    }
    let settings = fs::read_to_string(station.path("archive/trough/trough@plate-000011.toml")).unwrap();
    assert!(settings.starts_with("# Row 2 of trough@plate.csv, line 3.\n"), "{settings}");
    let archived = station.names("archive/trough");
    for original in ["trough@plate.csv", "trough@plate.dxf"] {
        assert!(archived.iter().any(|name| name == original), "{archived:?}");
    }
    // The next list goes on where the last one ended, also after a restart.
    station.put("trough@plate.dxf", &drawing());
    station.put("trough@plate.csv", &list(7..9));
    let log = station.once();
    assert_eq!(station.names("import"), [name(13), name(14)], "{log}");
    // Another distance goes on behind the last number, also for a list with its ending in capitals.
    station.take();
    station.write_settings("[serial]\nstart = 10\nstep = 3\n");
    station.put("trough@plate.CSV", &list(0..2));
    station.put("trough@plate.dxf", &drawing());
    let log = station.once();
    assert_eq!(station.names("import"), [name(16), name(19)], "{log}");
    station.take();
    station.write_settings("[serial]\nstart = 10\n");
    station.put("trough@plate.csv", &list(0..1));
    station.put("trough@plate.dxf", &drawing());
    let log = station.once();
    assert_eq!(station.names("import"), [name(20)], "{log}");
    // Another first number begins another series, with a warning.
    station.take();
    station.write_settings("[serial]\nstart = 500\n");
    station.put("trough@plate.csv", &list(0..1));
    station.put("trough@plate.dxf", &drawing());
    let log = station.once();
    assert_eq!(station.names("import"), [name(500)], "{log}");
    assert!(log.contains("start again at 500: `start` under [serial] was 10 before"), "{log}");
}

/// The next list continues behind the numbers that were used, whatever happened to the station's memory meanwhile.
#[test]
fn serial_numbers_go_on_although_the_journal_is_damaged_or_lost() {
    let flipped = |bytes: &[u8]| -> Vec<u8> {
        let mut lines: Vec<Vec<u8>> =
            bytes.split_inclusive(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
        for line in
            lines.iter_mut().filter(|line| String::from_utf8_lossy(line).contains("\"did\":\"listing\""))
        {
            line[40] ^= 1;
        }
        lines.concat()
    };
    type Damage<'d> = &'d dyn Fn(&[u8]) -> Option<Vec<u8>>;
    let damages: [(&str, Damage); 4] = [
        ("a flipped bit", &|bytes| Some(flipped(bytes))),
        ("zeros", &|bytes| Some(vec![0; bytes.len()])),
        ("an empty file", &|_| Some(Vec::new())),
        ("no state folder", &|_| None),
    ];
    for (what, damage) in damages {
        // Without the note in the archive, as an older version left it, the report of the list shows the numbers.
        for has_note in [true, false] {
            let mut station = Station::new("");
            station.put("trough@plate.csv", &list(0..3));
            station.put("trough@plate.dxf", &drawing());
            let log = station.once();
            assert_eq!(station.names("import").len(), 3, "{log}");
            station.take();
            match damage(&fs::read(station.path("state/journal.log")).unwrap()) {
                Some(bytes) => fs::write(station.path("state/journal.log"), bytes).unwrap(),
                None => fs::remove_dir_all(station.path("state")).unwrap(),
            }
            if !has_note {
                fs::remove_file(station.path("archive/trough/serial-numbers.json")).unwrap();
            }
            station.put("trough@next.csv", &list(3..5));
            station.put("trough@next.dxf", &drawing());
            let log = station.once();
            assert_eq!(
                station.names("import"),
                ["trough@next-000004.dxf", "trough@next-000005.dxf"],
                "{what}, {has_note}: {log}"
            );
            assert!(log.contains("the serial numbers of trough go on after 3"), "{what}, {has_note}: {log}");
            // A damaged journal is a problem until somebody has seen it; a new one is not.
            let status = || {
                let output = station.command(&["status", "station.toml"]).output().unwrap();
                String::from_utf8(output.stdout).unwrap()
            };
            let is_damaged = what != "no state folder";
            assert_eq!(status().contains("the journal was damaged"), is_damaged, "{what}: {}", status());
            if is_damaged {
                let log = station.once();
                assert!(
                    !log.contains("damaged line") && status().contains("the journal was damaged"),
                    "{log}"
                );
                fs::remove_file(station.path("state/journal.damaged.log")).unwrap();
                station.once();
                assert!(!status().contains("the journal was damaged"), "{}", status());
            }
        }
    }
}

#[test]
fn a_list_waits_when_all_that_is_left_of_its_serial_numbers_is_damaged() {
    let mut station = Station::new("");
    station.put("trough@plate.csv", &list(0..3));
    station.put("trough@plate.dxf", &drawing());
    station.once();
    station.take();
    let note = station.path("archive/trough/serial-numbers.json");
    let text = fs::read_to_string(&note).unwrap();
    fs::write(&note, text.replace("\"used\":3", "\"used\":2")).unwrap();
    // The journal is complete, so it continues and writes the note again.
    station.put("trough@plate.csv", &list(3..4));
    station.put("trough@plate.dxf", &drawing());
    let log = station.once();
    assert_eq!(station.names("import"), ["trough@plate-000004.dxf"], "{log}");
    station.take();
    let text = fs::read_to_string(&note).unwrap();
    assert!(text.contains("\"used\":4"), "{text}");
    fs::write(&note, text.replace("\"used\":4", "\"used\":2")).unwrap();
    fs::remove_dir_all(station.path("state")).unwrap();
    station.put("trough@plate.csv", &list(4..5));
    station.put("trough@plate.dxf", &drawing());
    let log = station.once();
    assert!(
        station.names("import").is_empty()
            && log.contains("The last serial number of SKU `trough` is unknown"),
        "{log}"
    );
    assert_eq!(station.names("hot"), ["trough@plate.csv", "trough@plate.dxf"], "{log}");
    station.write_settings("[serial]\nstart = 100\n");
    fs::remove_file(&note).unwrap();
    let log = station.once();
    assert_eq!(station.names("import"), ["trough@plate-000100.dxf"], "{log}");
}

/// A drawing in the folder of its SKU, whose rows would get names that are too long: a rejected list uses no numbers.
#[test]
fn a_list_is_rejected_before_its_rows_get_names_that_are_too_long() {
    let station = Station::new("");
    let folder = station.path("hot/trough");
    fs::create_dir(&folder).unwrap();
    // With its folder, the drawing has 230 bytes, as many as are accepted; each row has seven more.
    let stem = format!("trough@{}", "x".repeat(230 - "trough/trough@.dxf".len()));
    for (ending, text) in [("csv", list(0..2)), ("dxf", drawing())] {
        fs::write(folder.join(format!("{stem}.{ending}")), text).unwrap();
    }
    let log = station.once();
    let rejected: Vec<String> =
        station.names("rejected/trough").into_iter().filter(|name| name.ends_with(".dxf")).collect();
    assert_eq!(rejected, [format!("{stem}.dxf")], "{log}");
    assert!(log.contains("The file's name is too long"), "{log}");
    assert!(!station.path("archive/trough/serial-numbers.json").exists(), "{log}");
}

#[test]
fn bad_rows_reject_the_list_or_are_left_out_with_their_numbers() {
    let lots = "LOT\nA\n\u{1F600}\nB\n";
    let station = Station::new("");
    station.put("trough@plate.csv", "LOT;note\nA\n");
    station.put("trough@plate.dxf", &drawing());
    let log = station.once();
    assert!(station.names("import").is_empty(), "{log}");
    let rejected = station.names("rejected");
    assert!(rejected.iter().any(|name| name == "trough@plate.csv"), "{rejected:?}");
    let reason = fs::read_to_string(station.path("rejected/trough@plate.dxf.reason.json")).unwrap();
    assert!(reason.contains("list-unreadable"), "{reason}");

    // The numbers of the rejected list are still free. A column that the drawing needs may be missing.
    station.put("trough@plate.csv", "Lot\nA\n");
    station.put("trough@plate.dxf", &drawing());
    let log = station.once();
    assert!(log.contains("{csv:LOT}"), "{log}");
    station.write_settings("[content]\nbad_rows = \"skip\"\ncodes = [{ layer = \"MARK\", kind = \"code-128\", content = \"{csv:LOT}\" }]\n");
    let rectangle = "0\nLWPOLYLINE\n8\nMARK\n90\n4\n70\n1\n10\n-15\n20\n-5\n10\n15\n20\n-5\n10\n15\n20\n5\n10\n-15\n20\n5\n";
    let coded = drawing().replace(
        "0\nTEXT\n8\nMARK\n10\n-12\n20\n-1\n40\n2\n1\n{serial:05} {csv:LOT} {date:%H:%M}\n",
        rectangle,
    );
    station.put("trough@plate.csv", lots);
    station.put("trough@plate.dxf", &coded);
    let log = station.once();
    assert_eq!(station.names("import"), ["trough@plate-000001.dxf", "trough@plate-000003.dxf"], "{log}");
    assert!(log.contains("Row 2") && log.contains("the serial number 2 of trough will not be used"), "{log}");
    let report = station.report_of_list("trough@plate.csv");
    let left_out = &report["left_out"][0];
    assert_eq!(
        (&left_out["serial"], &left_out["reason"]["place"]["line"]),
        (&2.into(), &3.into()),
        "{report}"
    );
    assert_eq!(report["rows"].as_array().unwrap().len(), 2);
}

#[test]
fn a_list_waits_for_its_drawing_and_a_scan_is_no_list() {
    let station = Station::new("");
    station.put("trough@plate.csv", &list(0..2));
    let log = station.once();
    assert!(log.contains("The list waits for the drawing of the same name"), "{log}");
    assert_eq!(station.names("hot"), ["trough@plate.csv"]);
    station.put("trough@plate.dxf", &drawing());
    let log = station.once();
    assert_eq!(station.names("import").len(), 2, "{log}");
    let points: String = (0..60)
        .flat_map(|x| (0..60).map(move |y| format!("{}, {}, 0\n", f64::from(x) / 2.0, f64::from(y) / 2.0)))
        .collect();
    station.put("flat.csv", &points);
    let log = station.once();
    assert!(log.contains("flat.csv is now the part of SKU `flat`"), "{log}");
}

/// Without an `@`, a list is read as a scan, and its drawing has no serial number.
#[test]
fn a_list_with_the_name_of_a_scan_is_rejected_with_the_name_that_it_needs() {
    for settings in ["[part]\nshape = \"cylinder\"\ndiameter_mm = 60\nlength_mm = 90\n", ""] {
        let station = Station::new("");
        station.once();
        fs::write(station.path("skus/trough.toml"), settings).unwrap();
        station.put("trough.csv", &list(0..2));
        station.put("trough.dxf", &drawing());
        let log = station.once();
        let names = "trough@label.csv";
        let reason = fs::read_to_string(station.path("rejected/trough.csv.reason.txt")).unwrap();
        assert!(reason.contains(names) && reason.contains("list of products"), "{reason}: {log}");
        // A part that was rejected holds its drawings back until it is removed.
        fs::remove_file(station.path("rejected/trough.csv")).unwrap();
        let log = log + &station.once();
        let reason = fs::read_to_string(station.path("rejected/trough.dxf.reason.txt")).unwrap();
        assert!(reason.contains(names), "{reason}: {log}");
    }
}

/// SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % limit
    }
}

/// Kills the station many times while it divides and marks lists; every row is delivered once, under a number of its own, and no
/// number is left out. `ISOMARK_KILLS=300 ISOMARK_SEED=7` set how often, and the moments.
#[test]
fn every_row_is_marked_once_after_kills_at_any_moment() {
    const ROWS: usize = 60;
    let setting = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let (kills, seed) = (setting("ISOMARK_KILLS").unwrap_or(16), setting("ISOMARK_SEED").unwrap_or(1));
    let mut random = Random(seed);
    let mut station = Station::new("");
    let mut lists = 0;
    for _ in 0..kills {
        for name in ["trough@plate", "trough@label"] {
            let is_free =
                [".dxf", ".csv"].iter().all(|ending| !station.path(&format!("hot/{name}{ending}")).exists());
            if is_free && lists * 4 <= kills as usize && random.below(2) == 0 {
                station.put(&format!("{name}.csv"), &list(lists * ROWS..(lists + 1) * ROWS));
                station.put(&format!("{name}.dxf"), &drawing());
                lists += 1;
            }
        }
        station.start();
        let longest = [100, 400, 1200][random.below(3) as usize];
        let until = Duration::from_millis(40 + random.below(longest));
        let started = Instant::now();
        while started.elapsed() < until {
            station.take();
        }
        station.kill();
    }
    station.start();
    let started = Instant::now();
    while station.taken.len() < lists * ROWS || !station.names("hot").is_empty() {
        station.take();
        let rejected = station.path("rejected").exists() && !station.names("rejected").is_empty();
        assert!(
            started.elapsed() < LONGEST && !rejected,
            "still in hot: {:?}: {}",
            station.names("hot"),
            station.log()
        );
    }
    station.kill();
    station.take();
    let mut lots = BTreeSet::new();
    let mut serials = BTreeSet::new();
    for (name, _) in &station.taken {
        let report = station.path(&format!("reports/trough/{name}.report.json"));
        let report: serde_json::Value = serde_json::from_slice(&fs::read(report).unwrap()).unwrap();
        let content = &report["content"];
        let (serial, lot) = (content["serial"].as_u64().unwrap(), content["row"]["LOT"].to_string());
        assert!(lots.insert(lot.clone()), "marked twice: {lot}");
        assert!(serials.insert(serial), "used twice: {serial}");
        assert!(name.ends_with(&format!("-{serial:06}.dxf")), "{name}: {serial}");
    }
    assert_eq!(lots.len(), lists * ROWS);
    assert_eq!(serials, (1..=(lists * ROWS) as u64).collect(), "a number is left out");
    println!("seed {seed}: {kills} kills, {lists} lists, {} rows, each once", lots.len());
}

#[test]
fn lists_of_one_product_at_the_same_time_share_no_number() {
    let station = Station::new("");
    let names: Vec<String> = (0..6).map(|list| format!("trough@list{list}")).collect();
    for (index, name) in names.iter().enumerate() {
        station.put(&format!("{name}.csv"), &list(index * 20..(index + 1) * 20));
        station.put(&format!("{name}.dxf"), &drawing());
    }
    let log = station.once();
    let delivered = station.names("import");
    let serials: BTreeSet<&str> =
        delivered.iter().map(|name| name.rsplit_once('-').unwrap().1.trim_end_matches(".dxf")).collect();
    let expected: Vec<String> = (1..=120).map(|serial| format!("{serial:06}")).collect();
    assert_eq!(delivered.len(), 120, "{log}");
    assert!(serials.iter().eq(expected.iter()), "{serials:?}");
    assert!(station.names("hot").is_empty(), "{log}");
}
