//! Drops into a running station, with a stand-in for the pipeline: all files are in the right place afterwards, in any
//! order of the drops.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may fail loudly, its helpers too")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use fs_err as fs;
use isomark::config::{JobSettings, LiveSettings, Sku, Station};
use isomark::formats::Pace;
use isomark::formats::list::Products;
use isomark::hotfolder::{
    self, Check, Companion, Completeness, Corrector, Delivery, DroppedFile, JobError, Mode, PartLearned,
    PictureKind, StationError, StopSignal, Tally,
};
use isomark::pipeline::ListJob;
use isomark::reason::{Place, Reason};

#[cfg(unix)]
mod held_open;
#[path = "../schemas/mod.rs"]
mod schemas;
#[path = "../times/mod.rs"]
mod times;
mod pictures;
mod side_by_side;
mod uncertain;

/// A stand-in for the pipeline. Parts and patterns are lines of text that end with `EOF`; the first word is an
/// instruction.
#[derive(Default)]
struct StandIn {
    surfaces: Mutex<BTreeMap<Sku, String>>,
    seen: Arc<Seen>,
}

/// The state that the stand-in and the test share.
#[derive(Default)]
struct Seen {
    /// Jobs that are held may continue.
    released: AtomicBool,
    /// Number of jobs that are held.
    holding: AtomicUsize,
    /// The corrected patterns, in their order.
    corrected: Mutex<Vec<String>>,
    /// For each page that was drawn, in their order, how many patterns had been corrected.
    drawn: Mutex<Vec<usize>>,
    /// The learned parts, in their order.
    learned: Mutex<Vec<String>>,
    /// The files that the learned parts need, in the order of the parts.
    siblings: Mutex<Vec<BTreeMap<String, Vec<u8>>>>,
    /// How often the station woke up.
    pulses: AtomicUsize,
}

impl StandIn {
    fn obey(&self, bytes: &[u8], pace: Pace) -> Result<String, JobError> {
        let text = String::from_utf8(bytes.to_vec()).unwrap();
        let reason = |code| Reason::new(code, "As requested.", "Ask for something else.");
        match text.split_whitespace().next() {
            Some("slow") if pace == Pace::Quick => Err(JobError::TakesLong),
            Some("reject") => Err(JobError::Rejected(reason("asked"))),
            Some("stop") => Err(JobError::Stop(reason("asked"))),
            Some("panic") => panic!("as requested"),
            Some("hold" | "slow") => {
                self.seen.holding.fetch_add(1, Ordering::SeqCst);
                while !self.seen.released.load(Ordering::SeqCst) {
                    std::thread::sleep(Duration::from_millis(1));
                }
                Ok("held".into())
            }
            _ => Ok(text.trim_end().trim_end_matches("EOF").trim().to_owned()),
        }
    }
}

impl Corrector for StandIn {
    fn products(
        &self,
        sku: &Sku,
        pattern: &DroppedFile,
        (name, list): (&str, &[u8]),
        settings: &JobSettings,
        used: u64,
        most: u64,
    ) -> Result<Products, JobError> {
        let job = ListJob::new(name, sku, &pattern.bytes, settings, used);
        job.products(list, most).map_err(JobError::Rejected)
    }

    fn completeness(&self, _: &str, bytes: &[u8]) -> Completeness {
        let text = String::from_utf8_lossy(bytes);
        if !text.ends_with("EOF\n") {
            return Completeness::CutShort(Reason::new("cut-short", "There is no EOF.", "Copy it again."));
        }
        let named = |needed, word: &str| {
            let names = text.lines().filter_map(move |line| line.strip_prefix(word).map(str::to_owned));
            names.map(move |name| Companion { name, needed, bytes: 3 }).collect::<Vec<_>>()
        };
        Completeness::Whole { companions: [named(true, "needs "), named(false, "likes ")].concat() }
    }

    fn knows(&self, sku: &Sku, _: &JobSettings) -> bool {
        self.surfaces.lock().unwrap().contains_key(sku)
    }

    fn part_identity(&self, sku: &Sku, _: &JobSettings) -> Result<Option<String>, JobError> {
        Ok(self.surfaces.lock().unwrap().get(sku).cloned())
    }

    fn follow(&self, _: &Station) {}

    fn is_corrected(&self, file: &[u8]) -> bool {
        !file.starts_with(b"foreign")
    }

    fn restore_part(
        &self,
        sku: &Sku,
        part: &DroppedFile,
        settings: &JobSettings,
        _: Option<u64>,
        pace: Pace,
    ) -> Result<PartLearned, JobError> {
        self.learn_part(sku, part, settings, pace)
    }

    fn learn_part(
        &self,
        sku: &Sku,
        part: &DroppedFile,
        _: &JobSettings,
        pace: Pace,
    ) -> Result<PartLearned, JobError> {
        self.seen.siblings.lock().unwrap().push(part.siblings.clone());
        let surface = self.obey(&part.bytes, pace)?;
        self.seen.learned.lock().unwrap().push(part.name.clone());
        self.surfaces.lock().unwrap().insert(sku.clone(), surface);
        Ok(PartLearned { summary: "fine".into(), report: Some(b"{}".to_vec()) })
    }

    fn correct(
        &self,
        sku: &Sku,
        pattern: &DroppedFile,
        previous: Option<&[u8]>,
        settings: &JobSettings,
        pace: Pace,
    ) -> Result<Delivery, JobError> {
        let turn = settings.placement.rotate.to_degrees();
        let surface = self.surfaces.lock().unwrap()[sku].clone();
        let drawing = format!("{} on {surface} at {turn:.0}", self.obey(&pattern.bytes, pace)?);
        let expected = drawing.replace("garbled", "clear");
        self.seen.corrected.lock().unwrap().push(pattern.name.clone());
        let report = format!("before: {}", previous.map_or("nothing".into(), String::from_utf8_lossy));
        let (seen, page) = (self.seen.clone(), format!("<!DOCTYPE html>{drawing}"));
        let draw_page = move || {
            while page.contains("held-page") && !seen.released.load(Ordering::SeqCst) {
                std::thread::sleep(Duration::from_millis(1));
            }
            let corrected = seen.corrected.lock().unwrap().len();
            seen.drawn.lock().unwrap().push(corrected);
            page.into_bytes()
        };
        Ok(Delivery {
            report: report.into(),
            pictures: vec![
                (PictureKind::Preview, Box::new(|| b"<svg/>".to_vec())),
                (PictureKind::OnPart, Box::new(|| b"glTF".to_vec())),
                (PictureKind::Page, Box::new(draw_page)),
            ],
            size: None,
            summary: "good".into(),
            check: drawing.contains("checked").then(|| Check {
                vertices: drawing.len(),
                read_back: Box::new(move |file| match String::from_utf8_lossy(file) {
                    file if *file == *expected => Ok(format!("read back: {file}").into_bytes()),
                    _ => {
                        let reason =
                            Reason::new("readback-differs", "As requested.", "Ask for something else.");
                        let mut place = Place::default();
                        place.line = Some(7);
                        Err(JobError::Rejected(reason.at(place)))
                    }
                }),
            }),
            drawing: drawing.into(),
        })
    }
}

/// A station with its folders.
struct Line {
    folder: tempfile::TempDir,
    stop: StopSignal,
    seen: Arc<Seen>,
    running: Option<JoinHandle<Result<Tally, StationError>>>,
}

const SETTINGS: &str = "[station]\nname = \"test\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\n\
                        width_mm = 100\nheight_mm = 100\n[watch]\nsettle_ms = 30\nopen_ended_s = 0.1\nrescan_s = 0.2\n";

impl Line {
    /// A station that is set up but does not run yet.
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        for name in ["hot", "import", "elsewhere"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        fs::write(folder.path().join("station.toml"), SETTINGS).unwrap();
        Self { folder, stop: StopSignal::default(), seen: Arc::default(), running: None }
    }

    fn running() -> Self {
        let mut line = Self::new();
        line.start(Mode::UntilStopped);
        line
    }

    fn start(&mut self, mode: Mode) {
        let settings = LiveSettings::open(&self.path("station.toml")).unwrap();
        self.stop = StopSignal::default();
        let stop = self.stop.clone();
        let corrector = StandIn { seen: self.seen.clone(), ..StandIn::default() };
        let seen = self.seen.clone();
        let mut count = move |_| {
            seen.pulses.fetch_add(1, Ordering::SeqCst);
        };
        let work = move || hotfolder::run(settings, &corrector, &stop, mode, &mut count);
        self.running = Some(std::thread::spawn(work));
    }

    fn finish(&mut self) -> Result<Tally, StationError> {
        self.running.take().unwrap().join().unwrap()
    }

    fn stop(&mut self) -> Tally {
        self.stop.raise();
        self.finish().unwrap()
    }

    fn once(&mut self) -> Tally {
        self.start(Mode::Once);
        self.finish().unwrap()
    }

    fn path(&self, relative: &str) -> PathBuf {
        self.folder.path().join(relative)
    }

    fn drop(&self, relative: &str, text: &str) {
        let path = self.path("hot").join(relative);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, format!("{text}\nEOF\n")).unwrap();
    }

    fn rename_into(&self, relative: &str, text: &str) {
        let elsewhere = self.path("elsewhere/file");
        fs::write(&elsewhere, format!("{text}\nEOF\n")).unwrap();
        fs::rename(elsewhere, self.path("hot").join(relative)).unwrap();
    }

    fn text(&self, relative: &str) -> Option<String> {
        fs::read_to_string(self.path(relative)).ok()
    }

    fn waits_for(&self, what: &str, condition: impl Fn(&Self) -> bool) {
        let started = Instant::now();
        loop {
            let checked = Instant::now();
            if condition(self) {
                return;
            }
            let state =
                || ["state/journal.log", "state/status.json"].map(|file| self.text(file).unwrap_or_default());
            let limit = Duration::from_secs(120);
            assert!(started.elapsed() < limit, "{what}; files: {:#?}\n{}", self.tree(), state().join("\n"));
            // Where opening files is slow, checking all the time would slow down the station.
            std::thread::sleep(Duration::from_millis(2).max(4 * checked.elapsed()));
        }
    }

    fn waits_for_text(&self, relative: &str, text: &str) {
        self.waits_for(relative, |line| line.text(relative).as_deref() == Some(text));
    }

    fn waits_for_empty_hot(&self) {
        self.waits_for("an empty hot folder", |line| files(&line.path("hot")).is_empty());
    }

    fn tree(&self) -> Vec<String> {
        files(self.folder.path())
    }

    fn import(&self) -> Vec<String> {
        files(&self.path("import"))
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.seen.released.store(true, Ordering::SeqCst);
        self.stop.raise();
        if let Some(running) = self.running.take() {
            let _ = running.join();
        }
        // The corrector of these tests writes reports of its own kind.
        for folder in ["rejected", "state"] {
            schemas::check_below(&self.path(folder));
        }
    }
}

/// All files below the folder, with `/`, sorted.
fn files(folder: &Path) -> Vec<String> {
    let mut all = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(&next).into_iter().flatten() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                let relative = path.strip_prefix(folder).unwrap().to_str().unwrap();
                all.push(relative.replace('\\', "/"));
            }
        }
    }
    all.sort();
    all
}

#[test]
fn a_part_and_its_patterns_in_any_order() {
    let names = ["can.glb", "can.dxf", "can@date.dxf"];
    for order in [[0, 1, 2], [1, 0, 2], [2, 1, 0], [1, 2, 0]] {
        let line = Line::running();
        for index in order {
            line.drop(names[index], names[index]);
        }
        line.waits_for_empty_hot();
        assert_eq!(line.import(), ["can.dxf", "can@date.dxf"]);
        assert_eq!(line.text("import/can@date.dxf").unwrap(), "can@date.dxf on can.glb at 0");
        assert_eq!(
            files(&line.path("archive")),
            ["can/can.dxf", "can/can.glb", "can/can@date.dxf", "can/current-part.txt"]
        );
        assert_eq!(
            files(&line.path("reports")),
            [
                "can/can.dxf.on-part.glb",
                "can/can.dxf.preview.svg",
                "can/can.dxf.report.html",
                "can/can.dxf.report.json",
                "can/can.glb.report.json",
                "can/can@date.dxf.on-part.glb",
                "can/can@date.dxf.preview.svg",
                "can/can@date.dxf.report.html",
                "can/can@date.dxf.report.json"
            ]
        );
        assert!(files(&line.path("rejected")).is_empty());
    }
}

#[test]
fn drops_present_at_the_start_are_processed_and_counted() {
    let mut line = Line::new();
    line.drop("a.dxf", "pattern");
    line.drop("a.glb", "part");
    line.drop("b.dxf", "pattern");
    line.drop("c.iges", "unknown");
    line.drop("d.bin", "lonely");
    line.drop(".hidden.dxf", "not ours");
    fs::write(line.path("hot/e.glb"), "half a pa").unwrap();
    let tally = line.once();
    assert_eq!((tally.delivered, tally.learned, tally.rejected), (1, 1, 1));
    let names = |list: &[hotfolder::Waiting]| list.iter().map(|w| w.drop.clone()).collect::<Vec<_>>();
    assert_eq!(names(&tally.waiting), ["b.dxf", "d.bin"]);
    assert_eq!(tally.waiting[0].reason.code, "waits-for-part");
    assert_eq!(names(&tally.incomplete), ["e.glb"]);
    assert_eq!(tally.incomplete[0].reason.code, "cut-short");
    assert_eq!(files(&line.path("hot")), [".hidden.dxf", "b.dxf", "d.bin", "e.glb"]);
}

#[test]
fn an_incomplete_part_of_a_known_sku_is_left_in_place() {
    let mut line = Line::new();
    line.drop("can.glb", "part");
    line.drop("can.dxf", "pattern");
    assert_eq!(line.once().delivered, 1);
    fs::write(line.path("hot/can.obj"), "half a pa").unwrap();
    let started = Instant::now();
    assert_eq!(line.once().incomplete[0].drop, "can.obj");
    assert!(started.elapsed() < Duration::from_secs(60), "the station waited for it");
}

#[test]
fn a_sku_may_have_its_own_folder() {
    let line = Line::running();
    line.drop("Can/body.glb", "body");
    line.drop("Can/date.dxf", "date");
    line.drop("mug/cup.obj", "cup");
    line.drop("mug/date.dxf", "mugdate");
    line.waits_for_empty_hot();
    assert_eq!(line.import(), ["Can@date.dxf", "mug@date.dxf"]);
    assert_eq!(line.text("import/Can@date.dxf").unwrap(), "date on body at 0");
    assert!(line.path("archive/can/Can@date.dxf").exists());

    // The case of the name does not matter, and a whole folder may be renamed into place.
    fs::create_dir(line.path("elsewhere/CAN")).unwrap();
    fs::write(line.path("elsewhere/CAN/logo.dxf"), "logo\nEOF\n").unwrap();
    fs::remove_dir(line.path("hot/Can")).unwrap();
    fs::rename(line.path("elsewhere/CAN"), line.path("hot/CAN")).unwrap();
    line.waits_for_text("import/CAN@logo.dxf", "logo on body at 0");
}

#[test]
fn a_file_renamed_into_place_is_processed_at_once() {
    let line = Line::running();
    line.rename_into("can.glb", "part");
    line.waits_for_empty_hot();
    let mut quickest = Duration::MAX;
    for round in 0..10 {
        let started = Instant::now();
        line.rename_into(&format!("can@{round}.dxf"), "pattern");
        line.waits_for("a result", |line| line.path(&format!("import/can@{round}.dxf")).exists());
        quickest = quickest.min(started.elapsed());
    }
    // Only Linux reports that a file is complete; on other systems it must settle first.
    assert!(!cfg!(target_os = "linux") || quickest < Duration::from_millis(30), "{quickest:?}");
}

#[test]
fn the_station_waits_for_a_slow_writer() {
    use std::io::Write;
    let line = Line::running();
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    let mut file = fs::File::create(line.path("hot/can.dxf")).unwrap();
    for word in ["long ", "slow ", "pattern\n"] {
        file.write_all(word.as_bytes()).unwrap();
        file.sync_all().unwrap();
        // Longer than the settle time: the writer stalls.
        let stalled = Instant::now();
        line.waits_for("time to pass", |_| stalled.elapsed() > Duration::from_millis(60));
        assert!(line.import().is_empty());
    }
    file.write_all(b"EOF\n").unwrap();
    drop(file);
    line.waits_for_text("import/can.dxf", "long slow pattern on part at 0");
}

#[test]
fn an_incomplete_file_is_rejected_in_the_end() {
    let mut line = Line::new();
    fs::write(line.path("station.toml"), format!("{SETTINGS}incomplete_s = 0.2\n")).unwrap();
    fs::write(line.path("hot/can.glb"), "half").unwrap();
    line.drop("mug.gltf", "needs mug.bin");
    line.start(Mode::UntilStopped);
    line.waits_for_empty_hot();
    let rejected = files(&line.path("rejected"));
    assert_eq!(
        rejected,
        [
            "can.glb",
            "can.glb.reason.json",
            "can.glb.reason.txt",
            "mug.gltf",
            "mug.gltf.reason.json",
            "mug.gltf.reason.txt"
        ]
    );
    assert!(line.text("rejected/mug.gltf.reason.txt").unwrap().contains("mug.bin"));
}

#[test]
fn an_invalid_drop_is_rejected_and_the_station_continues() {
    let mut line = Line::running();
    line.drop("can.glb", "part");
    for name in ["can@1.dxf", "can@2.dxf"] {
        line.drop(name, if name == "can@1.dxf" { "reject" } else { "panic" });
    }
    line.drop("can/../Kännchen.pdf", "?");
    line.drop("can@3.dxf", "good");
    line.waits_for_empty_hot();
    assert_eq!(line.import(), ["can@3.dxf"]);
    let json: serde_json::Value = schemas::document(line.text("rejected/can@1.dxf.reason.json").unwrap());
    assert_eq!(json["schema"], "isomark.reason/1");
    assert_eq!(json["drop"], "can@1.dxf");
    assert_eq!(json["code"], "asked");
    assert_eq!(json["place"]["file"], "can@1.dxf");
    let text = line.text("rejected/can@2.dxf.reason.txt").unwrap();
    assert!(text.contains("internal error") && text.contains("as requested"), "{text}");
    assert!(line.text("rejected/Kännchen.pdf.reason.txt").unwrap().contains(".dxf"));
    assert_eq!(line.stop().rejected, 3);
}

/// The file is read back from the disk before it gets its final name, and also when it is unchanged in the import
/// folder.
#[test]
fn a_drawing_that_differs_in_its_file_is_never_delivered() {
    let mut line = Line::running();
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    line.drop("can.dxf", "checked and garbled");
    line.waits_for_empty_hot();
    assert_eq!(line.import(), [""; 0]);
    assert_eq!(files(&line.path("archive")), ["can/can.glb", "can/current-part.txt"]);
    let reason: serde_json::Value = schemas::document(line.text("rejected/can.dxf.reason.json").unwrap());
    assert_eq!(
        (&reason["code"], &reason["place"]["line"], &reason["place"]["file"]),
        (&"readback-differs".into(), &7.into(), &"can.dxf".into())
    );
    let journal = line.text("state/journal.log").unwrap();
    assert!(!journal.contains("delivering"), "{journal}");

    for round in ["new", "unchanged"] {
        line.drop("can@good.dxf", "checked");
        line.waits_for_empty_hot();
        let report = "read back: checked on part at 0";
        assert_eq!(line.text("reports/can/can@good.dxf.report.json").unwrap(), report, "{round}");
    }
    line.drop("can@good.dxf", "checked and garbled");
    line.waits_for_empty_hot();
    assert_eq!(line.text("import/can@good.dxf").unwrap(), "checked on part at 0", "the older one remains");
    assert_eq!(line.import(), ["can@good.dxf"]);
    assert_eq!(line.stop().rejected, 2);
}

/// The drawings here have about thirty vertices.
#[test]
fn drawings_are_read_back_as_set_in_the_settings() {
    for (verify, is_read) in [("false", false), ("10", false), ("1000", true), ("true", true)] {
        let mut line = Line::new();
        let settings = format!("{SETTINGS}[delivery]\nverify = {verify}\n");
        fs::write(line.path("station.toml"), settings).unwrap();
        line.drop("can.glb", "part");
        line.drop("can.dxf", "checked and garbled");
        let tally = line.once();
        let expected = if is_read { (0, 1) } else { (1, 0) };
        assert_eq!((tally.delivered, tally.rejected), expected, "verify = {verify}");
        assert_eq!(line.import().len(), usize::from(!is_read), "verify = {verify}");
    }
}

#[test]
fn nothing_in_archive_or_rejected_is_ever_overwritten() {
    let line = Line::running();
    line.drop("can.glb", "part");
    for round in 0..3 {
        line.rename_into("can.dxf", &format!("pattern {round}"));
        line.waits_for_text("import/can.dxf", &format!("pattern {round} on part at 0"));
        line.rename_into("can@bad.dxf", &format!("reject {round}"));
        line.waits_for_empty_hot();
    }
    assert_eq!(line.text("archive/can/can.dxf").unwrap(), "pattern 0\nEOF\n");
    assert_eq!(line.text("archive/can/(2)/can.dxf").unwrap(), "pattern 1\nEOF\n");
    assert_eq!(line.text("archive/can/(3)/can.dxf").unwrap(), "pattern 2\nEOF\n");
    assert_eq!(line.text("rejected/can@bad.dxf").unwrap(), "reject 0\nEOF\n");
    assert_eq!(line.text("rejected/(3)/can@bad.dxf").unwrap(), "reject 2\nEOF\n");
    assert!(line.path("rejected/(3)/can@bad.dxf.reason.json").exists());
    assert_eq!(
        line.text("reports/can/can.dxf.report.json").unwrap(),
        "before: pattern 1 on part at 0",
        "the report names the drawing that it replaces"
    );
}

#[test]
fn companions_are_filed_with_their_part() {
    let line = Line::running();
    line.drop("can.gltf", "needs can.bin\nlikes can.png");
    line.drop("can.dxf", "pattern");
    line.drop("can.png", "picture");
    line.drop("can.bin", "buffer");
    line.waits_for_empty_hot();
    let archived = files(&line.path("archive/can"));
    assert_eq!(archived, ["can.bin", "can.dxf", "can.gltf", "can.png", "current-part.txt"]);
    assert!(line.path("import/can.dxf").exists());

    // A companion that arrives late follows its part, and a second set stays together.
    line.drop("can.gltf", "needs can.bin\nlikes can.png");
    line.drop("can.bin", "buffer");
    line.waits_for_empty_hot();
    line.drop("can.png", "picture");
    line.waits_for_empty_hot();
    assert_eq!(files(&line.path("archive/can/(2)")), ["can.bin", "can.gltf", "can.png"]);
    assert_eq!(line.text("archive/can/current-part.txt").unwrap(), "(2)/can.gltf\n");
}

#[test]
fn settings_that_arrive_after_their_pattern_are_reported_late() {
    let line = Line::running();
    line.drop("can.glb", "part");
    line.drop("can.dxf", "pattern");
    line.waits_for_empty_hot();
    fs::write(line.path("hot/can.toml"), "[placement]\nrotate_deg = 90\n").unwrap();
    let is_reported =
        |line: &Line| line.text("state/status.json").is_some_and(|text| text.contains("sidecar-late"));
    line.waits_for("an entry in the status", is_reported);
    line.drop("can.dxf", "pattern");
    line.waits_for_text("import/can.dxf", "pattern on part at 90");
    line.waits_for_empty_hot();
}

#[test]
fn a_lost_surface_is_fitted_again_from_the_archive() {
    let mut line = Line::new();
    line.drop("can.glb", "first");
    assert_eq!(line.once().learned, 1);
    line.drop("can.glb", "second");
    assert_eq!(line.once().learned, 1);
    line.drop("can.dxf", "pattern");
    // The stand-in starts without surfaces each time.
    assert_eq!(line.once().delivered, 1);
    assert_eq!(line.text("import/can.dxf").unwrap(), "pattern on second at 0");
}

/// Somebody tidies up. Windows does not remove a folder with open files.
#[cfg(unix)]
#[test]
fn a_removed_state_folder_is_created_again_with_its_content() {
    let mut line = Line::running();
    line.drop("can.glb", "part");
    line.drop("can.dxf", "pattern");
    line.waits_for_empty_hot();
    fs::remove_dir_all(line.path("state")).unwrap();
    line.waits_for("a journal", |line| line.path("state/journal.log").exists());
    line.waits_for("a lock", |line| hotfolder::StationLock::holder(&line.path("state")).unwrap().is_some());
    line.stop();
    let settings = line.text("station.toml").unwrap() + "[delivery]\nrepeat = \"never\"\n";
    fs::write(line.path("station.toml"), settings).unwrap();
    line.start(Mode::UntilStopped);
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    line.drop("can.dxf", "pattern");
    line.waits_for_empty_hot();
    let tally = line.stop();
    assert_eq!((tally.delivered, tally.repeated), (0, 1), "the delivery is still known");
}

#[test]
fn a_second_station_on_the_hot_folder_ends_with_a_reason() {
    let mut line = Line::running();
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    let mut other = Line::new();
    let hot = format!("hot = '{}'", line.path("hot").display());
    fs::write(other.path("station.toml"), SETTINGS.replace("hot = \"hot\"", &hot)).unwrap();
    other.start(Mode::UntilStopped);
    let error = other.finish().unwrap_err().to_string();
    assert!(error.contains("Another station already uses the hot folder"), "{error}");
    line.drop("can.dxf", "pattern");
    line.waits_for_empty_hot();
    assert_eq!(line.stop().delivered, 1);
}

/// The spelling of the name does not matter; in the archive, the settings get the name by which they are found again.
#[test]
fn settings_beside_a_pattern_are_found_in_any_spelling() {
    let line = Line::running();
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    for (sidecar, pattern, name) in
        [("Can@A.TOML", "can@a.dxf", "can@a"), ("can/b\u{308}.toml", "can/b\u{308}.dxf", "can@b\u{308}")]
    {
        let path = line.path("hot").join(sidecar);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, "[placement]\nrotate_deg = 90\n").unwrap();
        line.waits_for("an entry in the status", |line| {
            line.text("state/status.json").is_some_and(|text| text.contains("wait for the drawing"))
        });
        line.drop(pattern, "pattern");
        line.waits_for_text(&format!("import/{name}.dxf"), "pattern on part at 90");
        line.waits_for_empty_hot();
        assert!(line.path(&format!("archive/can/{name}.toml")).exists(), "{:?}", line.tree());
    }
}

#[test]
fn a_file_changed_in_the_archive_is_not_delivered() {
    let mut line = Line::new();
    let settings = SETTINGS.to_owned() + "[delivery]\noutdated = \"correct\"\n";
    fs::write(line.path("station.toml"), settings).unwrap();
    line.start(Mode::UntilStopped);
    line.drop("can.glb", "part");
    line.drop("can.dxf", "pattern");
    line.drop("can@b.dxf", "pattern");
    line.waits_for_empty_hot();
    fs::write(line.path("archive/can/can.dxf"), "never dropped\nEOF\n").unwrap();
    line.drop("can.glb", "second");
    line.waits_for_text("import/can@b.dxf", "pattern on second at 0");
    let is_marked = |line: &Line| {
        let status = line.text("state/status.json").unwrap_or_default();
        let status: serde_json::Value = serde_json::from_str(&status).unwrap_or_default();
        status["outdated"]["first"][0]["name"] == "can.dxf" && status["outdated"]["count"] == 1
    };
    line.waits_for("a mark", is_marked);
    assert_eq!(line.text("import/can.dxf").unwrap(), "pattern on part at 0");
    assert_eq!(line.stop().rejected, 0);
}

/// A drop that crashes the program, possibly out of memory, must not do so forever, and must not block other drops.
#[test]
fn a_drop_that_crashes_the_station_runs_alone_and_is_then_rejected() {
    let mut line = Line::new();
    line.once();
    line.drop("can.glb", "part");
    line.drop("can@good.dxf", "pattern");
    line.drop("can@bad.dxf", "pattern");
    let stamp = |name: &str| {
        let metadata = fs::metadata(line.path("hot").join(name)).unwrap();
        let since = metadata.modified().unwrap().duration_since(std::time::UNIX_EPOCH).unwrap();
        format!(r#"{{"size":{},"modified":{},"identity":0}}"#, metadata.len(), since.as_nanos())
    };
    let journal = |record: String| {
        let json = format!(r#"{{"at":"2026-01-01T00:00:00Z",{record}}}"#);
        let sum = blake3::hash(json.as_bytes()).to_hex()[..8].to_owned();
        let path = line.path("state/journal.log");
        let text = fs::read_to_string(&path).unwrap();
        fs::write(path, format!("{text}{sum} {json}\n")).unwrap();
    };
    for (name, deaths) in [("can@good.dxf", 3), ("can@bad.dxf", 4)] {
        let stamp = stamp(name);
        journal(format!(r#""did":"died","drop":"{name}","stamp":{stamp},"deaths":{deaths}"#));
        journal(format!(r#""did":"began","drop":"{name}","stamp":{stamp}"#));
    }
    let tally = line.once();
    assert_eq!((tally.delivered, tally.rejected), (1, 1));
    assert!(line.text("rejected/can@bad.dxf.reason.json").unwrap().contains("ends-isomark"));
    assert_eq!(line.text("import/can@good.dxf").unwrap(), "pattern on part at 0");
    assert_eq!(*line.seen.corrected.lock().unwrap(), ["can@good.dxf"]);
    // A corrected file is another drop.
    line.drop("can@bad.dxf", "pattern\nrepaired");
    line.drop("can.glb", "part");
    assert_eq!(line.once().delivered, 1);
}

#[test]
fn the_reason_of_a_rejected_version_names_the_delivered_one() {
    let line = Line::running();
    line.drop("can.glb", "part");
    line.drop("can.dxf", "pattern");
    line.waits_for_empty_hot();
    line.drop("can.dxf", "reject");
    line.waits_for_empty_hot();
    let reason = line.text("rejected/can.dxf.reason.txt").unwrap();
    assert!(reason.contains("The drawing can.dxf that was delivered at 2"), "{reason}");
    assert_eq!(line.text("import/can.dxf").unwrap(), "pattern on part at 0");
}

/// Importers may take `.dxf` only. A drawing that an older version delivered as `.DXF` keeps that name: under the other one it
/// would be marked a second time.
#[test]
fn results_end_with_dxf_in_small_letters() {
    let mut line = Line::new();
    line.drop("can.glb", "part");
    line.drop("can@A.DXF", "one");
    assert_eq!(line.once().delivered, 1);
    assert_eq!(line.import(), ["can@A.dxf"]);
    line.drop("can@a.dxf", "two");
    assert_eq!(line.once().delivered, 1);
    assert_eq!(line.import(), ["can@A.dxf"]);
    let journal = line.text("state/journal.log").unwrap();
    let of_older = |line: &str| {
        let json =
            line.split_once(' ').unwrap().1.replace("\"name\":\"can@A.dxf\"", "\"name\":\"can@A.DXF\"");
        format!("{} {json}\n", &blake3::hash(json.as_bytes()).to_hex()[..8])
    };
    fs::write(line.path("state/journal.log"), journal.lines().map(of_older).collect::<String>()).unwrap();
    // In two steps: Wine renames no file to another spelling of its name.
    fs::rename(line.path("import/can@A.dxf"), line.path("import/away")).unwrap();
    fs::rename(line.path("import/away"), line.path("import/can@A.DXF")).unwrap();
    line.drop("can@A.DXF", "three");
    assert_eq!(line.once().delivered, 1);
    assert_eq!(line.import(), ["can@A.DXF"]);
    assert_eq!(line.text("import/can@A.DXF").unwrap(), "three on part at 0");
}

/// On a Windows share `CAN@a.dxf` and `can@a.dxf` are one file, even if the station runs on Linux.
#[test]
fn two_spellings_of_a_name_are_one_result() {
    let mut line = Line::running();
    line.drop("can.glb", "part");
    line.drop("can@\u{e4}.dxf", "one");
    line.waits_for_text("import/can@\u{e4}.dxf", "one on part at 0");
    line.waits_for_empty_hot();
    line.drop("CAN@a\u{308}.DXF", "two");
    line.waits_for_text("import/can@\u{e4}.dxf", "two on part at 0");
    line.waits_for_empty_hot();
    line.stop();
    line.start(Mode::UntilStopped);
    line.drop("can.glb", "part");
    line.drop("Can@\u{e4}.dxf", "three");
    line.waits_for_text("import/can@\u{e4}.dxf", "three on part at 0");
    assert_eq!(line.import(), ["can@\u{e4}.dxf"]);
}

#[test]
fn drawings_wait_for_a_missing_import_folder() {
    let line = Line::running();
    fs::remove_dir(line.path("import")).unwrap();
    line.drop("can.dxf", "pattern");
    line.drop("can.glb", "part");
    line.drop("can@bad.dxf", "reject");
    // It is processed after the drawing that cannot be delivered.
    line.waits_for("the rejected drawing", |line| line.path("rejected/can@bad.dxf").exists());
    assert!(line.path("hot/can.dxf").exists());
    fs::create_dir(line.path("import")).unwrap();
    line.waits_for_text("import/can.dxf", "pattern on part at 0");
    line.waits_for_empty_hot();
}

#[test]
fn a_folder_that_fails_after_the_delivery_only_delays_the_filing() {
    let mut line = Line::running();
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    fs::remove_dir_all(line.path("reports")).unwrap();
    fs::write(line.path("reports"), "a file in the way").unwrap();
    line.drop("can.dxf", "pattern");
    line.waits_for_text("import/can.dxf", "pattern on part at 0");
    assert!(line.path("hot/can.dxf").exists());
    fs::remove_file(line.path("reports")).unwrap();
    line.waits_for_empty_hot();
    assert_eq!(line.text("reports/can/can.dxf.report.json").unwrap(), "before: nothing");
    assert_eq!(line.stop().delivered, 1);
}

#[test]
fn a_hot_folder_that_is_available_again_is_watched_again() {
    let line = Line::running();
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    fs::remove_dir(line.path("hot")).unwrap();
    let is_reported =
        |line: &Line| line.text("state/status.json").is_some_and(|text| text.contains(" is not available\""));
    line.waits_for("an entry in the status", is_reported);
    // Windows may keep the name until the watch on the folder ends.
    line.waits_for("the name to be free", |line| fs::create_dir(line.path("hot")).is_ok());
    line.drop("can@1.dxf", "one");
    line.waits_for_empty_hot();
    fs::rename(line.path("hot"), line.path("elsewhere/old")).unwrap();
    fs::create_dir(line.path("hot")).unwrap();
    line.drop("can@2.dxf", "two");
    line.waits_for_empty_hot();
    assert_eq!(line.import(), ["can@1.dxf", "can@2.dxf"]);
}

/// While a share is not mounted, its mount point is an empty folder in the place of the hot folder.
#[test]
fn a_delivery_from_a_share_that_is_mounted_late_is_not_repeated() {
    let mut line = Line::running();
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    fs::remove_dir_all(line.path("reports/can")).unwrap();
    fs::write(line.path("reports/can"), "a file in the way").unwrap();
    line.drop("can.dxf", "pattern");
    line.waits_for_text("import/can.dxf", "pattern on part at 0");
    line.stop();
    assert!(line.path("hot/can.dxf").exists(), "delivered and not filed");

    fs::rename(line.path("hot"), line.path("elsewhere/share")).unwrap();
    fs::create_dir(line.path("hot")).unwrap();
    fs::remove_file(line.path("reports/can")).unwrap();
    assert_eq!(line.once().delivered, 0);
    // An importer takes the drawing.
    fs::remove_file(line.path("import/can.dxf")).unwrap();
    fs::remove_dir(line.path("hot")).unwrap();
    fs::rename(line.path("elsewhere/share"), line.path("hot")).unwrap();
    // Some shares give their files new numbers with each mount.
    let modified = fs::metadata(line.path("hot/can.dxf")).unwrap().modified().unwrap();
    fs::copy(line.path("hot/can.dxf"), line.path("elsewhere/can.dxf")).unwrap();
    let file = fs::OpenOptions::new().write(true).open(line.path("elsewhere/can.dxf")).unwrap();
    file.file().set_modified(modified).unwrap();
    drop(file);
    fs::rename(line.path("elsewhere/can.dxf"), line.path("hot/can.dxf")).unwrap();
    line.once();
    assert_eq!(line.import(), [""; 0], "it was already delivered");
    assert_eq!(files(&line.path("hot")), [""; 0]);
    assert!(line.path("archive/can/can.dxf").exists());
}

#[test]
fn a_station_without_events_lists_the_folder() {
    let mut line = Line::new();
    fs::write(line.path("station.toml"), SETTINGS.replace("[watch]", "[watch]\nbackend = \"poll\"")).unwrap();
    line.start(Mode::UntilStopped);
    line.drop("can.dxf", "pattern");
    line.drop("can.glb", "part");
    line.waits_for_text("import/can.dxf", "pattern on part at 0");
}

#[test]
fn changed_settings_files_take_effect() {
    let line = Line::running();
    line.drop("can.glb", "part");
    line.drop("can@1.dxf", "1");
    line.waits_for_text("import/can@1.dxf", "1 on part at 0");
    let sku = line.path("skus/CAN.toml");
    fs::write(&sku, "[placement]\nrotate_deg = 90").unwrap();
    line.drop("can@2.dxf", "2");
    line.waits_for_text("import/can@2.dxf", "2 on part at 90");
    fs::write(&sku, "[placement]\nrotate_dg = 45").unwrap();
    line.drop("can@3.dxf", "3");
    line.waits_for_text("import/can@3.dxf", "3 on part at 90");
    fs::write(&sku, "[placement]\nrotate_deg = 45").unwrap();
    line.drop("can@4.dxf", "4");
    line.waits_for_text("import/can@4.dxf", "4 on part at 45");
}

#[test]
fn a_pattern_does_not_overtake_an_arriving_part() {
    let line = Line::running();
    line.drop("can.glb", "old");
    line.waits_for_empty_hot();
    fs::write(line.path("hot/can.obj"), "ne").unwrap();
    line.drop("can.dxf", "pattern");
    line.drop("can@2.dxf", "pattern");
    fs::write(line.path("hot/can.obj"), "new\nEOF\n").unwrap();
    line.waits_for_empty_hot();
    for name in line.import() {
        assert_eq!(line.text(&format!("import/{name}")).unwrap(), "pattern on new at 0", "{name}");
    }
}

/// If both are dropped together, the drawing may arrive first; it must not be delivered for the older part.
#[test]
fn a_drawing_waits_for_a_part_that_arrives_during_its_correction() {
    let line = Line::running();
    line.drop("can.glb", "old");
    line.drop("can@date.dxf", "date");
    line.waits_for_empty_hot();
    line.rename_into("can.dxf", "hold");
    line.waits_for("the start of the correction", |line| line.seen.holding.load(Ordering::SeqCst) > 0);
    line.rename_into("can.obj", "new");
    // Events arrive in order: when this part is learned, the other one is known, too.
    line.rename_into("mug.glb", "part");
    line.waits_for("the other part", |line| line.path("archive/mug/mug.glb").exists());
    assert_eq!(line.import(), ["can@date.dxf"]);
    line.seen.released.store(true, Ordering::SeqCst);
    line.waits_for_empty_hot();
    assert_eq!(line.text("import/can.dxf").unwrap(), "held on new at 0");
    assert_eq!(line.text("reports/can/can.dxf.report.json").unwrap(), "before: nothing");
}

#[test]
fn a_file_that_arrives_in_the_import_folder_during_a_correction_is_not_replaced() {
    let line = Line::running();
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    line.rename_into("can.dxf", "hold");
    line.waits_for("the start of the correction", |line| line.seen.holding.load(Ordering::SeqCst) > 0);
    fs::write(line.path("import/can.dxf"), "foreign").unwrap();
    line.seen.released.store(true, Ordering::SeqCst);
    line.waits_for("the rejected drawing", |line| line.path("rejected/can.dxf").exists());
    assert_eq!(line.text("import/can.dxf").unwrap(), "foreign");
}

/// The files that a part needs are read once, together with the part, so that the hash and the surface agree.
#[test]
fn a_part_is_learned_with_the_files_that_it_needs() {
    let mut line = Line::running();
    line.drop("can.gltf", "needs can.bin\nneeds b.bin\nlikes can.png\nneeds ../outside.bin");
    line.drop("outside.bin", "of somebody else");
    line.drop("can.bin", "buffer");
    line.drop("b.bin", "another");
    line.drop("can.png", "picture");
    line.waits_for("the part", |line| files(&line.path("hot")) == ["outside.bin"]);
    line.stop();
    let both = || {
        let content = |text: &str| format!("{text}\nEOF\n").into_bytes();
        BTreeMap::from([("can.bin".into(), content("buffer")), ("b.bin".into(), content("another"))])
    };
    assert_eq!(*line.seen.siblings.lock().unwrap(), [both()]);
    // A lost surface is fitted again from the archived files.
    line.drop("can.dxf", "pattern");
    assert_eq!(line.once().delivered, 1);
    assert_eq!(*line.seen.siblings.lock().unwrap(), [both(), both()]);
    // The reader of the part reports a missing file.
    fs::remove_file(line.path("archive/can/b.bin")).unwrap();
    line.drop("can.dxf", "another pattern");
    line.once();
    let last = line.seen.siblings.lock().unwrap().pop().unwrap();
    assert_eq!(last.keys().collect::<Vec<_>>(), ["can.bin"]);
}

#[test]
fn a_part_does_not_take_other_drops_along() {
    let line = Line::running();
    line.drop("mug.dxf", "pattern");
    line.drop("can.gltf", "needs mug.dxf");
    line.waits_for("the part", |line| line.path("archive/can/can.gltf").exists());
    line.waits_for("only the drawing in the hot folder", |line| files(&line.path("hot")) == ["mug.dxf"]);
    line.drop("mug.glb", "part");
    line.waits_for_text("import/mug.dxf", "pattern on part at 0");
}

#[test]
fn the_same_drop_again_does_not_rewrite_the_result() {
    let line = Line::running();
    line.drop("can.glb", "part");
    line.drop("can.dxf", "pattern");
    line.waits_for_empty_hot();
    let written = fs::metadata(line.path("import/can.dxf")).unwrap().modified().unwrap();
    line.drop("can.dxf", "pattern");
    line.waits_for("the archive", |line| line.path("archive/can/(2)/can.dxf").exists());
    assert_eq!(fs::metadata(line.path("import/can.dxf")).unwrap().modified().unwrap(), written);
}

#[test]
fn the_stop_signal_stops_the_station_soon() {
    let mut line = Line::running();
    line.drop("can.dxf", "pattern");
    line.waits_for("a running station", |line| line.path("archive").exists());
    let started = Instant::now();
    line.stop();
    assert!(started.elapsed() < Duration::from_millis(500), "{:?}", started.elapsed());
    assert!(line.path("hot/can.dxf").exists());
}

#[test]
fn a_job_can_stop_the_station_and_its_drop_remains() {
    let mut line = Line::running();
    line.drop("can.glb", "stop");
    assert!(matches!(line.finish(), Err(StationError::Stopped(reason)) if reason.code == "asked"));
    assert!(line.path("hot/can.glb").exists());
}

#[test]
fn a_thousand_drops_at_once() {
    let line = Line::running();
    for number in 0..1000 {
        line.drop(&format!("can@{number}.dxf"), "pattern");
    }
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    assert_eq!(line.import().len(), 1000);
    assert_eq!(files(&line.path("archive")).len(), 1002);
}

#[cfg(unix)]
#[test]
fn a_link_is_not_followed() {
    let line = Line::running();
    line.drop("can.glb", "part");
    fs::write(line.path("elsewhere/secret"), "secret\nEOF\n").unwrap();
    std::os::unix::fs::symlink(line.path("elsewhere/secret"), line.path("hot/can.dxf")).unwrap();
    line.waits_for("the link to be rejected", |line| line.path("rejected/can.dxf.reason.json").exists());
    line.waits_for_empty_hot();
    assert!(line.import().is_empty());
}

/// The older version would be marked, although its designer has replaced it.
#[test]
fn a_drawing_that_is_replaced_while_it_is_corrected_is_not_delivered_in_its_older_version() {
    let mut line = Line::running();
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    line.rename_into("can.dxf", "hold");
    line.waits_for("the correction", |line| line.seen.holding.load(Ordering::SeqCst) == 1);
    line.rename_into("can.dxf", "newer");
    line.seen.released.store(true, Ordering::SeqCst);
    line.waits_for_text("import/can.dxf", "newer on part at 0");
    line.waits_for_empty_hot();
    assert_eq!(files(&line.path("archive/can")), ["can.dxf", "can.glb", "current-part.txt"]);
    assert_eq!(line.stop().delivered, 1);
}

/// Where they are two files, people mean two drawings.
#[test]
fn drawings_whose_names_differ_in_case_do_not_replace_each_other_if_both_are_there() {
    let mut line = Line::new();
    line.drop("can.glb", "part");
    line.drop("can@a.dxf", "one");
    if line.path("hot/can@A.dxf").exists() {
        return;
    }
    line.drop("can@A.dxf", "two");
    line.drop("can@a.DXF", "three");
    let tally = line.once();
    assert_eq!((tally.delivered, tally.rejected), (1, 2));
    let rejected = files(&line.path("rejected"));
    assert_eq!(rejected.iter().filter(|name| name.ends_with(".reason.json")).count(), 2, "{rejected:?}");
    assert_eq!(line.import().len(), 1);
}
