//! A running station with drops of real exports: in any order, every drop has exactly one outcome.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use fs_err as fs;

use crate::desk::{Desk, Output, drawing, part};
use crate::ezdxf::{assert_clean, judged};
use crate::times;

/// The time limit for anything on a slow machine.
const DEADLINE: Duration = Duration::from_secs(30);
const LOOK_AGAIN: Duration = Duration::from_millis(5);

const SETTINGS: &str = "[station]\nname = \"test\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\n\
                        width_mm = 110\nheight_mm = 110\n[watch]\nsettle_ms = 100\nopen_ended_s = 0\nrescan_s = 0.5\nincomplete_s = 2\n";
const CAN: &str = "[part]\nfacing = \"-y\"\n[placement]\nplace_mm = [0, 60]\n[fixture]\ny_mm = -60\n";

/// A station's folders, and the program while it runs.
pub struct Station {
    pub desk: Desk,
    pub running: Option<Child>,
}

impl Station {
    pub fn new() -> Self {
        let desk = Desk::new();
        for folder in ["hot", "import", "elsewhere"] {
            fs::create_dir(desk.path(folder)).unwrap();
        }
        desk.write("station.toml", SETTINGS);
        desk.write("skus/can.toml", CAN);
        Self { desk, running: None }
    }

    pub fn running() -> Self {
        let mut station = Self::new();
        station.start();
        station
    }

    pub fn start(&mut self) {
        self.start_with(&[]);
    }

    /// Starts the program with further options.
    pub fn start_with(&mut self, options: &[&str]) {
        let log = fs::OpenOptions::new().create(true).append(true).open(self.path("log.txt")).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_isomark"))
            .args(["watch", "station.toml"])
            .args(options)
            .current_dir(self.desk.root())
            .env_remove("RUST_LOG")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log.into_parts().0)
            .spawn();
        self.running = Some(child.unwrap());
    }

    /// Processes all drops once, and returns the output.
    pub fn once(&self) -> Output {
        self.desk.isomark(&["watch", "station.toml", "--once"])
    }

    /// As if the station had ended after the journal recorded that the drawing `<sku>.dxf` was about to be delivered.
    /// Returns `false` where the import folder would not be recognized after that.
    pub fn interrupt_delivery(&self, sku: &str) -> bool {
        if !times::are_those_of_creation(self.desk.root()) {
            return false;
        }
        let journal = self.desk.text("state/journal.log");
        let start = journal.rfind("\"did\":\"delivering\"").unwrap();
        let end = start + journal[start..].find('\n').unwrap() + 1;
        self.desk.write("state/journal.log", &journal[..end]);
        let drawing = format!("{sku}.dxf");
        fs::rename(self.path("archive").join(sku).join(&drawing), self.path("hot").join(&drawing)).unwrap();
        fs::remove_file(self.path("import").join(&drawing)).unwrap();
        true
    }

    /// Ends the program without time to clean up.
    pub fn kill(&mut self) {
        let mut child = self.running.take().unwrap();
        child.kill().unwrap();
        child.wait().unwrap();
    }

    pub fn path(&self, relative: &str) -> PathBuf {
        self.desk.path(relative)
    }

    pub fn log(&self) -> String {
        fs::read_to_string(self.path("log.txt")).unwrap_or_default()
    }

    pub fn copy_into(&self, from: &str, name: &str) {
        self.desk.write(&format!("hot/{name}"), fs::read(from).unwrap());
    }

    pub fn rename_into(&self, from: &str, name: &str) {
        self.desk.write("elsewhere/file", fs::read(from).unwrap());
        fs::rename(self.path("elsewhere/file"), self.path("hot").join(name)).unwrap();
    }

    pub fn waits_for(&self, what: &str, condition: impl Fn(&Self) -> bool) {
        let started = Instant::now();
        while !condition(self) {
            let tree = files(self.desk.root());
            assert!(started.elapsed() < DEADLINE, "{what}; files: {tree:#?}, log:\n{}", self.log());
            std::thread::sleep(LOOK_AGAIN);
        }
    }

    pub fn waits_for_file(&self, name: &str) {
        self.waits_for(name, |station| station.path(name).exists());
    }

    pub fn waits_for_empty_hot(&self) {
        self.waits_for("an empty hot folder", |station| files(&station.path("hot")).is_empty());
    }

    pub fn import(&self) -> Vec<String> {
        files(&self.path("import"))
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        if let Some(mut child) = self.running.take() {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// All files below the folder, with `/`, sorted.
pub fn files(folder: &Path) -> Vec<String> {
    let mut all = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(next) = open.pop() {
        for path in fs::read_dir(&next).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path())) {
            if path.is_dir() {
                open.push(path);
            } else {
                all.push(path.strip_prefix(folder).unwrap().to_str().unwrap().replace('\\', "/"));
            }
        }
    }
    all.sort();
    all
}

/// The result of `isomark correct` for the same job and settings.
fn by_command(part: &str, pattern: &str, name: &str, sku: &str) -> Vec<u8> {
    let station = Station::new();
    // The comments in the result contain the names of the dropped files.
    let kind = part.rsplit('.').next().unwrap();
    station.desk.write(&format!("{sku}.{kind}"), fs::read(part).unwrap());
    station.desk.write(name, fs::read(pattern).unwrap());
    let options = format!("--station station.toml --sku {sku}");
    station.desk.correct_to("out.dxf", &[&format!("{sku}.{kind}"), name], &options);
    station.desk.read("out.dxf")
}

/// More large drawings than there are threads, each of few bytes that unfold to a lot of work, and a small one after
/// them.
#[test]
fn a_small_drawing_is_delivered_before_large_ones_that_arrived_earlier() {
    let mut station = Station::new();
    station.desk.write("station.toml", SETTINGS.replace("[watch]\n", "[watch]\njobs = 2\n"));
    let block = "0\nSECTION\n2\nBLOCKS\n0\nBLOCK\n8\n0\n2\nA\n10\n0\n20\n0\n0\nLINE\n8\n0\n10\n0\n20\n0\n11\n0.05\n21\n0.03\n\
                 0\nENDBLK\n0\nENDSEC\n";
    let drawing = |copies: u32| {
        format!(
            "{block}0\nSECTION\n2\nENTITIES\n0\nINSERT\n8\n0\n2\nA\n10\n0\n20\n0\n70\n{copies}\n71\n{copies}\n44\n0.1\n45\n0.1\n\
             0\nENDSEC\n0\nEOF\n"
        )
    };
    let trough =
        "v -20 -20 1\nv 0 -20 0\nv 20 -20 1\nv -20 20 1\nv 0 20 0\nv 20 20 1\nf 1 2 5 4\nf 2 3 6 5\n";
    for sku in ["large1", "large2", "large3", "large4", "small"] {
        station.desk.write(&format!("hot/{sku}.obj"), trough);
        station.desk.write(&format!("hot/{sku}.dxf"), drawing(if sku == "small" { 1 } else { 150 }));
    }
    station.start();
    station.waits_for("all results", |station| files(&station.path("import")).len() == 5);
    station.waits_for("the log", |station| station.log().matches(" delivered to import").count() == 5);
    let log = station.log();
    let delivered: Vec<&str> = log.lines().filter(|line| line.contains(" delivered to import")).collect();
    let small = delivered.iter().position(|line| line.contains("small.dxf"));
    assert!(small.is_some_and(|place| place < 2), "{delivered:#?}");
}

#[test]
fn drops_in_any_order_give_the_bytes_of_the_command() {
    let can = part("can/fc020-gui.glb");
    let expected = [
        by_command(&can, &drawing("abc"), "can.dxf", "can"),
        by_command(&can, &drawing("ez-logo-mm"), "can@logo.dxf", "can"),
    ];
    let drops =
        [(can.clone(), "can.glb"), (drawing("abc"), "can.dxf"), (drawing("ez-logo-mm"), "can@logo.dxf")];
    for order in [[0, 1, 2], [2, 1, 0], [1, 0, 2]] {
        for renamed in [false, true] {
            let station = Station::running();
            for (from, name) in order.map(|index| &drops[index]) {
                if renamed { station.rename_into(from, name) } else { station.copy_into(from, name) }
            }
            station.waits_for_empty_hot();
            assert_eq!(station.import(), ["can.dxf", "can@logo.dxf"], "{}", station.log());
            assert!(station.desk.read("import/can.dxf") == expected[0]);
            assert!(station.desk.read("import/can@logo.dxf") == expected[1]);
            let archive = ["can/can.dxf", "can/can.glb", "can/can@logo.dxf", "can/current-part.txt"];
            assert_eq!(files(&station.path("archive")), archive);
            assert_eq!(station.desk.read("archive/can/can.dxf"), fs::read(drawing("abc")).unwrap());
            let report: serde_json::Value =
                serde_json::from_slice(&station.desk.read("reports/can/can.dxf.report.json")).unwrap();
            assert_eq!((&report["schema"], &report["sku"]), (&"isomark.report/1".into(), &"can".into()));
            assert!(station.path("reports/can/can@logo.dxf.preview.svg").exists());
            assert!(station.desk.read("reports/can/can@logo.dxf.on-part.glb").starts_with(b"glTF"));
            assert!(files(&station.path("rejected")).is_empty());
            assert!(!station.log().contains('\u{1b}'), "colour codes in a file: {}", station.log());
        }
    }
}

#[test]
fn a_drawing_for_an_unknown_sku_names_the_form_and_the_known_skus() {
    let station = Station::running();
    station.copy_into(&part("mouse/fc020-coarse-mesh.obj"), "mouse.obj");
    station.waits_for("the part", |station| station.log().contains("is now the part of SKU `mouse`"));
    station.copy_into(&drawing("abc"), "abcdefghijk.dxf");
    station.waits_for("the form of names", |station| {
        let log = station.log();
        log.contains("in the form SKU@name.dxf, such as can@abcdefghijk.dxf. Known SKUs: can, mouse.")
    });
}

#[test]
fn a_drawing_waits_for_its_part_and_the_log_reports_it() {
    let station = Station::running();
    station.copy_into(&drawing("abc"), "mouse@date.dxf");
    station.waits_for("a log line", |station| station.log().contains("Drop the part as mouse.step"));
    assert!(station.import().is_empty());
    station.copy_into(&part("mouse/fc020-coarse-mesh.obj"), "mouse.obj");
    station.waits_for_empty_hot();
    assert_eq!(station.import(), ["mouse@date.dxf"]);
}

#[test]
fn a_folder_for_each_sku_and_a_part_of_two_files() {
    let station = Station::running();
    station.desk.write("skus/plate.toml", "[placement]\nplace_mm = [0, 0]\n");
    station.copy_into(&drawing("ez-qr-hatch"), "plate/code.dxf");

    station.copy_into(&part("assembly/fc020-gui.gltf"), "plate/export.gltf");
    station.copy_into(&part("assembly/fc020-gui.bin"), "plate/fc020-gui.bin");
    station.waits_for_file("import/plate@code.dxf");
    station.waits_for_empty_hot();
    let archive = files(&station.path("archive/plate"));
    assert_eq!(archive, ["current-part.txt", "export.gltf", "fc020-gui.bin", "plate@code.dxf"]);
}

#[test]
fn a_part_of_two_files_is_fitted_again_from_both() {
    let station = Station::new();
    station.desk.write("skus/plate.toml", "[placement]\nplace_mm = [0, 0]\n");
    let [text, buffer] = ["gltf", "bin"].map(|kind| part(&format!("assembly/fc020-gui.{kind}")));
    station.copy_into(&text, "plate.gltf");
    station.copy_into(&buffer, "fc020-gui.bin");
    station.copy_into(&drawing("ez-qr-hatch"), "plate.dxf");
    let output = station.once();
    assert!(output.out.starts_with("1 delivered, 1 part fitted"), "{output:?}");
    let first = station.desk.read("import/plate.dxf");
    let report = station.desk.text("reports/plate/plate.dxf.report.json");
    let both = [text, buffer].map(|path| fs::read(path).unwrap()).concat();
    assert!(report.contains(blake3::hash(&both).to_hex().as_str()), "{report}");
    fs::remove_dir_all(station.path("cache")).unwrap();
    fs::remove_file(station.path("import/plate.dxf")).unwrap();
    station.copy_into(&drawing("ez-qr-hatch"), "plate.dxf");
    let output = station.once();
    assert!(output.err.contains("restored the surface of plate from the archive"), "{output:?}");
    assert_eq!(station.desk.read("import/plate.dxf"), first);
    // Without its buffer the part cannot be read, and must not be identified by the hash of half of it.
    fs::remove_dir_all(station.path("cache")).unwrap();
    fs::remove_file(station.path("archive/plate/fc020-gui.bin")).unwrap();
    station.copy_into(&drawing("ez-qr-hatch"), "plate.dxf");
    let output = station.once();
    assert!(
        output.err.contains("cannot be restored from the archive") && output.err.contains("fc020-gui.bin")
    );
}

/// `<sku>/<name>` and `<sku>@<name>` are the same name.
#[test]
fn settings_and_lists_belong_to_drawings_of_either_form_of_the_name() {
    let station = Station::new();
    station.desk.write("skus/can.toml", "[part]\nshape = \"cylinder\"\ndiameter_mm = 66\nlength_mm = 120\n");
    for (settings, drawing) in
        [("can@d.toml", "can/d.svg"), ("can/e.toml", "can@e.svg"), ("can/can@f.toml", "can@f.svg")]
    {
        station.desk.write(&format!("hot/{settings}"), "[placement]\nrotate_deg = 90\n");
        let svg = "<svg xmlns='http://www.w3.org/2000/svg' width='20mm' height='10mm' viewBox='0 0 20 10'>\
                   <rect x='1' y='4' width='18' height='2' fill='none' stroke='black'/></svg>";
        station.desk.write(&format!("hot/{drawing}"), svg);
    }
    station.desk.write("hot/can@x.csv", "LOT\nA\nB\n");
    station.desk.write("hot/can/x.dxf", fs::read(drawing("square")).unwrap());
    let output = station.once();
    for name in ["d", "e", "f"] {
        let text = station.desk.text(&format!("reports/can/can@{name}.svg.report.json"));
        let report: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(report["placement"]["rotate_deg"], 90.0, "{name}: {output:?}");
    }
    assert_eq!(files(&station.path("hot")), Vec::<String>::new(), "{output:?}");
    assert_eq!(station.import().iter().filter(|name| name.starts_with("can@x-")).count(), 2, "{output:?}");
    let archive = files(&station.path("archive/can"));
    assert!(archive.iter().any(|name| name.ends_with("e.toml")), "{archive:?}");
    // A rejected drawing takes its list along, and back again.
    station.desk.write("hot/can@y.csv", "LOT\n");
    station.desk.write("hot/can/y.dxf", fs::read(drawing("square")).unwrap());
    let output = station.once();
    assert_eq!(files(&station.path("hot")), Vec::<String>::new(), "{output:?}");
    station.desk.isomark(&["retry", "station.toml", "--rejected"]);
    assert_eq!(files(&station.path("hot")), ["can/can@y.csv", "can/y.dxf"]);
}

/// Drawings that differ in their endings alone have results of one name.
#[test]
fn the_result_of_another_drawing_is_not_replaced() {
    let station = Station::new();
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    station.copy_into(&drawing("abc"), "can@logo.dxf");
    station.once();
    let first = station.desk.read("import/can@logo.dxf");
    let svg = "<svg xmlns='http://www.w3.org/2000/svg' width='20mm' height='10mm' viewBox='0 0 20 10'>\
               <rect x='1' y='4' width='18' height='2' fill='none' stroke='black'/></svg>";
    station.desk.write("hot/can@logo.svg", svg);
    let output = station.once();
    assert_eq!(station.desk.read("import/can@logo.dxf"), first, "{output:?}");
    let reason = station.desk.text("rejected/can@logo.svg.reason.txt");
    assert!(reason.contains("the result of another drawing, can@logo.dxf"), "{reason}");
    // A new version of the first one replaces its result.
    station.copy_into(&drawing("square"), "can@logo.dxf");
    let output = station.once();
    assert_ne!(station.desk.read("import/can@logo.dxf"), first, "{output:?}");
    // Where the first result is gone, nothing is lost.
    fs::remove_file(station.path("import/can@logo.dxf")).unwrap();
    station.desk.isomark(&["retry", "station.toml", "--rejected"]);
    let output = station.once();
    assert_eq!(station.import(), ["can@logo.dxf"], "{output:?}");
    assert!(output.err.contains("can@logo.dxf now comes from can@logo.svg"), "{output:?}");
}

#[test]
fn a_file_that_somebody_put_into_the_import_folder_is_not_replaced() {
    let station = Station::new();
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    station.desk.write("import/can@logo.dxf", "mine");
    station.copy_into(&drawing("abc"), "can@logo.dxf");
    let output = station.once();
    assert_eq!(station.desk.read("import/can@logo.dxf"), b"mine", "{output:?}");
    let reason = station.desk.text("rejected/can@logo.dxf.reason.txt");
    assert!(reason.contains("not from isomark") && reason.contains("out of the import folder"), "{reason}");
    // A result that this station does not remember is one all the same.
    fs::remove_file(station.path("import/can@logo.dxf")).unwrap();
    station.desk.isomark(&["retry", "station.toml", "--rejected"]);
    station.once();
    let first = station.desk.read("import/can@logo.dxf");
    fs::remove_dir_all(station.path("state")).unwrap();
    station.copy_into(&drawing("square"), "can@logo.dxf");
    let output = station.once();
    assert_ne!(station.desk.read("import/can@logo.dxf"), first, "{output:?}");
}

#[test]
fn a_result_of_another_station_in_the_same_import_folder_is_not_replaced() {
    let [one, two] = [(); 2].map(|()| {
        let station = Station::new();
        station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
        station
    });
    let import = one.path("import").display().to_string().replace('\\', "/");
    two.desk.write("station.toml", SETTINGS.replace("\"import\"", &format!("\"{import}\"")));
    one.copy_into(&drawing("abc"), "can@logo.dxf");
    one.once();
    let first = one.desk.read("import/can@logo.dxf");
    two.copy_into(&drawing("square"), "can@logo.dxf");
    let output = two.once();
    assert_eq!(one.desk.read("import/can@logo.dxf"), first, "{output:?}");
    let reason = two.desk.text("rejected/can@logo.dxf.reason.txt");
    assert!(
        reason.contains("this station has not delivered") && reason.contains("its own import folder"),
        "{reason}"
    );
    // Also if the station delivered that name before, and the other one now.
    fs::remove_file(one.path("import/can@logo.dxf")).unwrap();
    two.desk.isomark(&["retry", "station.toml", "--rejected"]);
    two.once();
    let second = one.desk.read("import/can@logo.dxf");
    assert_ne!(second, first);
    one.copy_into(&drawing("circle"), "can@logo.dxf");
    one.once();
    assert_eq!(one.desk.read("import/can@logo.dxf"), second);
    assert!(one.path("rejected/can@logo.dxf").exists());
    // The one that delivered it replaces it, also with a new journal.
    fs::remove_dir_all(two.path("state")).unwrap();
    two.copy_into(&drawing("abc"), "can@logo.dxf");
    let output = two.once();
    assert_eq!(one.desk.read("import/can@logo.dxf"), first, "{output:?}");
}

#[test]
fn deliveries_are_counted_although_the_status_was_not_written_any_more() {
    let station = Station::new();
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    for name in ["can@one.dxf", "can@two.dxf"] {
        station.copy_into(&drawing("abc"), name);
    }
    station.once();
    let delivered = || {
        let status = station.desk.isomark(&["status", "station.toml", "--json"]);
        let status: serde_json::Value = serde_json::from_str(&status.out).unwrap();
        status["done"]["delivered_last_hour"].as_u64().unwrap()
    };
    assert_eq!(delivered(), 2);
    fs::remove_file(station.path("state/status.json")).unwrap();
    station.once();
    assert_eq!(delivered(), 2);
    // What both know counts once.
    station.once();
    assert_eq!(delivered(), 2);
}

#[cfg(unix)]
#[test]
fn a_pipe_in_the_rejected_folder_does_not_hold_up_a_retry() {
    let station = Station::new();
    let pipe = station.path("hot/can@pipe.dxf");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    station.copy_into(&drawing("abc"), "can@logo.dxf");
    station.once();
    assert!(station.path("rejected/can@pipe.dxf").exists());
    let output = station.desk.isomark(&["retry", "station.toml", "--rejected"]);
    assert_eq!(output.code, 0, "{output:?}");
    assert!(station.path("hot/can@logo.dxf").exists() && pipe.exists(), "{:?}", files(station.desk.root()));
}

#[test]
fn a_note_beside_the_drawings_is_rejected_and_holds_none_back() {
    let station = Station::new();
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    station.once();
    station.desk.write("hot/can@note.txt", "Please finish these today.\nThanks, Anna\n");
    station.desk.write("hot/can/readme.txt", "Mark these on Friday.\n");
    station.once();
    station.copy_into(&drawing("square"), "can@later.dxf");
    let output = station.once();
    assert_eq!(station.import(), ["can@later.dxf"], "{output:?}");
    for note in ["can@note.txt", "can/readme.txt"] {
        let reason = station.desk.text(&format!("rejected/{note}.reason.txt"));
        assert!(reason.contains("If this is a note, keep it outside the hot folder"), "{reason}");
    }
    // What was meant as the part holds them back.
    station.desk.write("hot/can/can.txt", "Mark these on Friday.\n");
    station.once();
    station.copy_into(&drawing("square"), "can@last.dxf");
    let output = station.once();
    assert_eq!(station.import(), ["can@later.dxf"], "{output:?}");
}

#[test]
fn the_station_waits_for_slow_writers() {
    let mut station = Station::new();
    station.desk.write("station.toml", SETTINGS.replace("incomplete_s = 2", "incomplete_s = 60"));
    station.start();
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    station.waits_for_empty_hot();
    let whole = fs::read(drawing("abc")).unwrap();
    let mut file = fs::File::create(station.path("hot/can.dxf")).unwrap();
    let mut written = Vec::new();
    for piece in whole.chunks(whole.len() / 4 + 1) {
        assert!(station.import().is_empty(), "a part of a drawing was delivered");
        file.write_all(piece).unwrap();
        file.flush().unwrap();
        written.extend_from_slice(piece);
        // The writer pauses for longer than the settle time: until another drop was delivered.
        let name = format!("can@{}.dxf", written.len());
        station.rename_into(&drawing("square"), &name);
        station.waits_for_file(&format!("import/{name}"));
        fs::remove_file(station.path("import").join(&name)).unwrap();
    }
    drop(file);
    station.waits_for_file("import/can.dxf");
    station.waits_for_empty_hot();
    assert!(
        station.desk.read("import/can.dxf")
            == by_command(&part("can/fc020-gui.glb"), &drawing("abc"), "can.dxf", "can")
    );
}

#[test]
fn invalid_files_are_rejected_with_a_reason_and_the_station_continues() {
    let station = Station::running();
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    station.copy_into(&drawing("abc"), "can@good.dxf");
    station.copy_into(&drawing("ink12-text-r14"), "can@text.dxf");
    station.copy_into(&drawing("ez-defects"), "can@stray.dxf");
    station.desk.write("hot/can@wrong.pdf", "%PDF-1.7");
    let glb = fs::read(part("mouse/fc020-gui.glb")).unwrap();
    station.desk.write("hot/mouse.glb", &glb[..4000]);
    station.waits_for_empty_hot();
    station.copy_into(&drawing("ez-logo-mm"), "can@later.dxf");
    station.waits_for_file("import/can@later.dxf");
    station.waits_for_empty_hot();
    assert_eq!(station.import(), ["can@good.dxf", "can@later.dxf"]);
    for (name, code, words) in [
        ("can@text.dxf", "pattern-nothing-to-mark", "Object to Path"),
        ("can@stray.dxf", "off-surface", "Delete stray lines"),
        ("can@wrong.pdf", "", "what to do: "),
        ("mouse.glb", "mesh-truncated", "copy the file again"),
    ] {
        assert!(station.path(&format!("rejected/{name}")).exists(), "{name}");
        let text = station.desk.text(&format!("rejected/{name}.reason.txt"));
        assert!(text.starts_with(&format!("{name} was rejected.")) && text.contains(words), "{text}");
        let json: serde_json::Value =
            serde_json::from_slice(&station.desk.read(&format!("rejected/{name}.reason.json"))).unwrap();
        assert_eq!(json["drop"], name);
        let more = format!("\n  more:       isomark explain {}\n", json["code"].as_str().unwrap());
        assert!(text.contains(&more), "{text}");
        assert!(code.is_empty() || json["code"] == code, "{json:#}");
    }
    assert_eq!(station.desk.read("rejected/mouse.glb"), glb[..4000], "the original must be unchanged");
}

#[test]
fn a_new_version_replaces_the_older_result() {
    let station = Station::running();
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    station.rename_into(&drawing("abc"), "can@logo.dxf");
    station.waits_for_file("import/can@logo.dxf");
    station.waits_for_empty_hot();
    let first = station.desk.read("import/can@logo.dxf");
    station.rename_into(&drawing("square"), "can@logo.dxf");
    station.waits_for("the new version", |station| station.desk.read("import/can@logo.dxf") != first);
    station.waits_for_empty_hot();
    assert_eq!(station.import(), ["can@logo.dxf"]);
    let report: serde_json::Value =
        serde_json::from_slice(&station.desk.read("reports/can/can@logo.dxf.report.json")).unwrap();
    assert_eq!((&report["changes"]["old_paths"], &report["changes"]["new_paths"]), (&6.into(), &1.into()));
    // Both originals are kept.
    let archive = files(&station.path("archive/can"));
    assert_eq!(archive.iter().filter(|name| name.ends_with("can@logo.dxf")).count(), 2, "{archive:?}");
}

#[test]
fn a_running_station_uses_changed_settings() {
    let station = Station::running();
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    station.copy_into(&drawing("abc"), "can@a.dxf");
    station.waits_for_file("import/can@a.dxf");
    station.desk.write("skus/can.toml", format!("{CAN}[correction]\nmetod = \"none\"\n"));
    station.copy_into(&drawing("abc"), "can@b.dxf");
    station.waits_for_file("import/can@b.dxf");
    let log = station.log();
    for words in
        ["`metod`", "Did you mean `method`", "can.toml, line 8, column 1", "Keeping the previous settings"]
    {
        assert!(log.contains(words), "{words}: {log}");
    }
    station.desk.write("skus/can.toml", format!("{CAN}[correction]\nmethod = \"none\"\n"));
    station.copy_into(&drawing("abc"), "can@c.dxf");
    station.waits_for_file("reports/can/can@c.dxf.report.json");
    let method = |name: &str| {
        let report = station.desk.read(&format!("reports/can/can@{name}.dxf.report.json"));
        serde_json::from_slice::<serde_json::Value>(&report).unwrap()["map"]["method"].clone()
    };
    station.waits_for_empty_hot();
    assert_eq!([method("a"), method("b"), method("c")], ["cylinder", "cylinder", "none"]);
    assert!(station.log().contains("can.toml is valid again"), "{}", station.log());
}

#[test]
fn a_station_runs_only_once_and_a_crash_releases_its_lock() {
    let mut station = Station::running();
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    station.waits_for_empty_hot();
    let holder = format!("process {} ", station.running.as_ref().unwrap().id());
    station
        .once()
        .refused(3, &["The station is already running: ", &holder, "as \"test\" since 20", "Stop it first"]);
    station.kill();
    let output = station.once();
    assert_eq!(output.code, 0, "{}", output.err);
}

#[cfg(unix)]
#[test]
fn a_station_stops_cleanly_on_signals() {
    for signal in ["TERM", "INT"] {
        let mut station = Station::running();
        station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
        station.waits_for_empty_hot();
        let mut child = station.running.take().unwrap();
        let id = child.id().to_string();
        assert!(Command::new("kill").args(["-s", signal, &id]).status().unwrap().success());
        let asked = Instant::now();
        let status = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break status;
            }
            assert!(asked.elapsed() < Duration::from_secs(5), "still running 5 s after SIG{signal}");
            std::thread::sleep(LOOK_AGAIN);
        };
        assert_eq!(status.code(), Some(0), "{}", station.log());
    }
}

/// A burst is delivered first; a kill before its pictures are drawn costs neither a picture nor a second delivery.
#[test]
fn pictures_that_waited_when_the_station_was_killed_are_drawn_after_the_next_start() {
    const DRAWINGS: usize = 40;
    let mut station = Station::new();
    let names: Vec<String> = (0..DRAWINGS).map(|number| format!("can@{number}.dxf")).collect();
    for name in &names {
        station.copy_into(&drawing("abc"), name);
    }
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    let filed = |station: &Station| {
        let archived = files(&station.path("archive/can"));
        archived.iter().filter(|name| name.ends_with(".dxf")).count()
    };
    station.start();
    station.waits_for("drawings whose pictures wait", |station| {
        // The archive is looked at first, so the difference is not larger than it looks.
        let filed = filed(station);
        station.import().iter().filter(|name| names.contains(name)).count() >= filed + 5
    });
    station.kill();
    let delivered = |name: &String| {
        let written = fs::metadata(station.path("import").join(name)).and_then(|file| file.modified());
        written.ok().map(|time| (name.clone(), time))
    };
    let before: Vec<_> = names.iter().filter_map(delivered).collect();
    assert!(before.len() >= filed(&station) + 5, "{before:?}");
    station.start();
    station.waits_for_empty_hot();
    assert_eq!(filed(&station), DRAWINGS);
    for (name, time) in before {
        let now = fs::metadata(station.path("import").join(&name)).unwrap().modified().unwrap();
        assert_eq!(now, time, "{name} was delivered again");
    }
    for name in names {
        for ending in ["report.json", "report.html", "preview.svg", "on-part.glb", "frame.dxf"] {
            station.waits_for_file(&format!("reports/can/{name}.{ending}"));
        }
    }
}

#[test]
fn nothing_is_lost_or_incomplete_when_a_station_is_killed() {
    const DRAWINGS: [&str; 6] = ["abc", "square", "circle", "ez-logo-mm", "grid", "ez-qr-hatch"];
    let mut station = Station::new();
    let mut expected = Vec::new();
    for (index, name) in DRAWINGS.iter().enumerate() {
        let target = format!("can@{index}.dxf");
        station.copy_into(&drawing(name), &target);
        expected.push(target);
    }
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    // Killed after each further result, while the next job is running.
    for results in 0..4 {
        station.start();
        station.waits_for("a further result", |station| {
            station.import().iter().filter(|name| expected.contains(name)).count() >= results
        });
        station.kill();
        for name in station.import().iter().filter(|name| expected.contains(name)) {
            let bytes = station.desk.read(&format!("import/{name}"));
            assert!(
                bytes.ends_with(b"EOF\n") || bytes.ends_with(b"EOF\r\n"),
                "half a drawing in import: {name}"
            );
        }
    }
    station.start();
    station.waits_for_empty_hot();
    station.waits_for("all results", |station| {
        expected.iter().all(|name| station.path("import").join(name).exists())
    });
    // Each original is in the archive once, and the import folder contains exactly the complete results.
    let archive = files(&station.path("archive/can"));
    for name in expected.iter().map(String::as_str).chain(["can.glb"]) {
        assert_eq!(archive.iter().filter(|file| file.ends_with(name)).count(), 1, "{name}: {archive:?}");
    }
    let visible: Vec<String> = station.import().into_iter().filter(|name| !name.starts_with('.')).collect();
    assert_eq!(visible, expected);
    assert!(files(&station.path("rejected")).is_empty());
    let by_command = by_command(&part("can/fc020-gui.glb"), &drawing("grid"), "can@4.dxf", "can");
    assert!(station.desk.read("import/can@4.dxf") == by_command);
}

#[test]
fn watch_once_processes_the_drops_in_the_hot_folder() {
    let station = Station::new();
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    station.copy_into(&drawing("abc"), "can.dxf");
    station.copy_into(&drawing("abc"), "cup.dxf");
    station.copy_into(&drawing("ink12-text-r14"), "can@text.dxf");
    let output = station.once();
    assert_eq!(output.code, 1, "{}", output.err);
    assert!(
        output.out.contains("1 delivered, 1 part fitted, 1 rejected, 1 waiting, 0 incomplete"),
        "{}",
        output.out
    );
    assert!(output.out.contains("cup.dxf: The drawing waits for a part"), "{}", output.out);
    assert_eq!(station.import(), ["can.dxf"]);
    assert_eq!(files(&station.path("hot")), ["cup.dxf"]);
    // Later only a drawing is dropped: the surface is in the cache.
    station.copy_into(&drawing("abc"), "can@2.dxf");
    let output = station.once();
    assert!(output.out.contains("1 delivered, 0 parts fitted, 0 rejected, 1 waiting"), "{}", output.out);
}

#[test]
fn reports_state_whether_the_drawing_was_read_back() {
    for (settings, expected) in [("", true), ("verify = true\n", true), ("verify = false\n", false)] {
        let station = Station::new();
        station.desk.write("station.toml", format!("{SETTINGS}[delivery]\n{settings}"));
        station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
        station.copy_into(&drawing("abc"), "can.dxf");
        assert_eq!(station.once().code, 0);
        let report = station.desk.read("reports/can/can.dxf.report.json");
        let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
        assert_eq!(report["output"]["read_back"], expected, "{settings}");
        let delivered = station.desk.read("import/can.dxf");
        assert_eq!(report["output"]["blake3"], *blake3::hash(&delivered).to_hex());
    }
}

#[test]
fn without_an_import_folder_drops_wait() {
    let station = Station::new();
    fs::remove_dir(station.path("import")).unwrap();
    station.copy_into(&part("can/fc020-gui.glb"), "can.glb");
    station.copy_into(&drawing("abc"), "can.dxf");
    let output = station.once();
    assert_eq!(output.code, 3, "{}", output.err);
    assert!(
        output.err.contains("The import folder") && output.err.contains("does not exist"),
        "{}",
        output.err
    );
    assert!(output.out.contains("0 delivered, 1 part fitted, 0 rejected, 1 waiting"), "{}", output.out);
    assert_eq!(files(&station.path("hot")), ["can.dxf"]);
    fs::create_dir(station.path("import")).unwrap();
    assert!(station.once().out.contains("1 delivered"));
}

/// The files for the first check of a real machine give the results that plugins/beamconstruct describes.
#[test]
fn the_files_of_the_first_check_give_the_described_results() {
    let station = Station::new();
    let folder = format!("{}/plugins/beamconstruct/first-check", env!("CARGO_MANIFEST_DIR"));
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        station.copy_into(path.to_str().unwrap(), path.file_name().unwrap().to_str().unwrap());
    }
    let output = station.once();
    assert!(output.out.starts_with("3 delivered, 1 part fitted, 0 rejected"), "{}", output.out);
    for (name, expected) in [
        ("plate@square.dxf", [-5.0, -5.0, 5.0, 5.0]),
        ("plate@moved.dxf", [15.0, 5.0, 25.0, 15.0]),
        ("plate@layers.dxf", [-15.0, -5.0, 15.0, 3.0]),
    ] {
        let Some(judgement) = judged(&fs::read(station.path("import").join(name)).unwrap()) else { return };
        assert_clean(&judgement);
        for (side, expected) in expected.iter().enumerate() {
            assert!(
                (judgement["box"][side].as_f64().unwrap() - expected).abs() < 0.001,
                "{name}: {}",
                judgement["box"]
            );
        }
        if name == "plate@layers.dxf" {
            for (layer, colour) in [("red", 1), ("green", 3), ("blue", 5)] {
                assert_eq!(judgement["layers"][layer][0], colour);
            }
        }
    }
}

#[test]
fn a_drawing_that_new_settings_do_not_change_is_not_delivered_again() {
    let station = Station::new();
    let settings = station.desk.text("station.toml") + "[delivery]\noutdated = \"correct\"\n";
    station.desk.write("station.toml", &settings);
    station.copy_into(&part("mouse/fc020-coarse-mesh.obj"), "mouse.obj");
    station.copy_into(&drawing("abc"), "mouse@date.dxf");
    station.once();
    // The marking software imported and removed it.
    fs::remove_file(station.path("import/mouse@date.dxf")).unwrap();
    // The threshold has no effect on a DXF.
    station.desk.write("station.toml", settings.clone() + "[pattern]\nthreshold_percent = 30\n");
    let output = station.once();
    assert!(output.out.starts_with("0 delivered"), "{output:?}");
    assert!(output.err.contains("mouse@date.dxf did not change, and is not delivered again"), "{output:?}");
    assert!(station.import().is_empty());
    assert!(!station.once().err.contains("outdated"), "it is up to date from now on");
    station.desk.write("station.toml", settings + "[correction]\ntolerance_mm = 0.05\n");
    assert!(station.once().out.starts_with("1 delivered"));
    assert_eq!(station.import(), ["mouse@date.dxf"]);
}
