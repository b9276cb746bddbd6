//! Writers that keep their drops open and write to them again after they were processed: the new content is a new drop,
//! and the filed files stay unchanged. On Windows, a file that is open for writing cannot be read.

use std::io::{Seek, SeekFrom, Write};
use std::path::PathBuf;

use fs_err as fs;

use super::{Line, Mode, SETTINGS, files};

/// A writer that has one file open.
struct Writer(fs::File);

impl Writer {
    /// Renames a file into the hot folder, and keeps it open.
    fn drops(line: &Line, name: &str, text: &str) -> Self {
        let elsewhere = line.path("elsewhere/held");
        fs::write(&elsewhere, text).unwrap();
        let file = fs::OpenOptions::new().read(true).write(true).open(&elsewhere).unwrap();
        fs::rename(&elsewhere, line.path("hot").join(name)).unwrap();
        Self(file)
    }

    fn writes(&mut self, text: &str) {
        self.0.file().set_len(0).unwrap();
        self.0.seek(SeekFrom::Start(0)).unwrap();
        self.0.write_all(text.as_bytes()).unwrap();
    }
}

/// A station with archive, rejected and state folder on another disk; `None` where there is none.
fn with_archive_elsewhere() -> Option<(Line, tempfile::TempDir)> {
    let disk = tempfile::tempdir_in("/dev/shm").ok()?;
    let mut line = Line::new();
    let folders = ["archive", "rejected", "state"]
        .map(|name| format!("{name} = \"{}\"\n", disk.path().join(name).display()))
        .concat();
    let settings = SETTINGS.replace("import = \"import\"\n", &format!("import = \"import\"\n{folders}"));
    fs::write(line.path("station.toml"), settings).unwrap();
    line.start(Mode::UntilStopped);
    Some((line, disk))
}

/// The writer that still has a drawing open writes it again after its original was filed.
fn a_drawing_is_written_again(line: &Line, archive: PathBuf) {
    line.drop("can.glb", "part");
    let mut writer = Writer::drops(line, "can.dxf", "one\nEOF\n");
    let is_filed = |line: &Line| archive.join("can/can.dxf").exists() && !line.path("hot/can.dxf").exists();
    line.waits_for("the first version in the archive", is_filed);
    writer.writes("two\nEOF\n");
    line.waits_for_text("import/can.dxf", "two on part at 0");
    // In the hot folder, the station would wait until its writer closes it.
    let is_filed =
        |line: &Line| archive.join("can/(2)/can.dxf").exists() && !line.path("hot/can.dxf").exists();
    line.waits_for("the second version in the archive", is_filed);
    let text = |relative: &str| fs::read_to_string(archive.join(relative)).unwrap();
    assert_eq!((text("can/can.dxf"), text("can/(2)/can.dxf")), ("one\nEOF\n".into(), "two\nEOF\n".into()));
    // The file is still the same, also for the third version.
    writer.writes("three\nEOF\n");
    line.waits_for_text("import/can.dxf", "three on part at 0");
    drop(writer);
}

#[test]
fn a_filed_drawing_that_is_written_again_is_a_new_drop() {
    let line = Line::running();
    a_drawing_is_written_again(&line, line.path("archive"));
}

#[test]
fn the_same_with_the_archive_on_another_disk() {
    let Some((line, disk)) = with_archive_elsewhere() else { return };
    a_drawing_is_written_again(&line, disk.path().join("archive"));
}

#[test]
fn a_filed_part_that_is_written_again_is_a_new_drop() {
    let line = Line::running();
    let mut writer = Writer::drops(&line, "can.glb", "first\nEOF\n");
    line.waits_for_empty_hot();
    writer.writes("second\nEOF\n");
    line.waits_for_text("archive/can/current-part.txt", "(2)/can.glb\n");
    line.drop("can.dxf", "pattern");
    line.waits_for_text("import/can.dxf", "pattern on second at 0");
    assert_eq!(line.text("archive/can/can.glb").unwrap(), "first\nEOF\n");
}

#[test]
fn a_rejected_drop_that_is_written_again_is_a_new_drop() {
    let line = Line::running();
    line.drop("can.glb", "part");
    let mut writer = Writer::drops(&line, "can.dxf", "reject\nEOF\n");
    line.waits_for_empty_hot();
    writer.writes("better\nEOF\n");
    line.waits_for_text("import/can.dxf", "better on part at 0");
    assert_eq!(line.text("rejected/can.dxf").unwrap(), "reject\nEOF\n");
}

#[test]
fn settings_and_buffers_written_again_wait_in_the_hot_folder() {
    let line = Line::running();
    line.drop("can.glb", "part");
    let turned = |degrees| format!("[placement]\nrotate_deg = {degrees}\n");
    let mut writer = Writer::drops(&line, "can.toml", &turned(90));
    line.drop("can.dxf", "pattern");
    line.waits_for_text("import/can.dxf", "pattern on part at 90");
    line.waits_for_empty_hot();
    writer.writes(&turned(45));
    line.waits_for_text("hot/can.toml", &turned(45));
    assert_eq!(line.text("archive/can/can.toml").unwrap(), turned(90));

    let mut writer = Writer::drops(&line, "mug.bin", "first buffer");
    line.drop("mug.gltf", "needs mug.bin");
    line.waits_for("the part", |line| line.path("archive/mug/current-part.txt").exists());
    line.waits_for("its buffer", |line| !line.path("hot/mug.bin").exists());
    writer.writes("second buffer");
    line.waits_for_text("hot/mug.bin", "second buffer");
    assert_eq!(line.text("archive/mug/mug.bin").unwrap(), "first buffer");
}

/// The station need not be running when the file is written again.
#[test]
fn a_file_written_while_the_station_was_stopped_is_a_new_drop() {
    let mut line = Line::running();
    line.drop("can.glb", "part");
    let mut writer = Writer::drops(&line, "can.dxf", "one\nEOF\n");
    line.waits_for("the report", |line| line.path("archive/can/can.dxf").exists());
    line.waits_for_empty_hot();
    line.stop();
    writer.writes("two\nEOF\n");
    line.start(Mode::UntilStopped);
    line.waits_for_text("import/can.dxf", "two on part at 0");
}

/// A newer drop with its name is not replaced.
#[test]
fn a_file_written_again_is_rejected_if_a_newer_drop_has_its_name() {
    let mut line = Line::running();
    line.drop("can.glb", "part");
    let mut writer = Writer::drops(&line, "can.dxf", "one\nEOF\n");
    line.waits_for("the archive", |line| line.path("archive/can/can.dxf").exists());
    line.waits_for_empty_hot();
    line.stop();
    writer.writes("one, written again\nEOF\n");
    line.start(Mode::UntilStopped);
    // The newer file is incomplete, so it remains in the hot folder.
    fs::write(line.path("elsewhere/file"), "half of a newer o").unwrap();
    fs::rename(line.path("elsewhere/file"), line.path("hot/can.dxf")).unwrap();
    line.waits_for("either outcome", |line| {
        line.path("rejected/can.dxf").exists() || line.path("archive/can/(2)/can.dxf").exists()
    });
    if line.path("rejected/can.dxf").exists() {
        let reason = line.text("rejected/can.dxf.reason.json").unwrap();
        assert!(reason.contains("overtaken"), "{reason}");
        assert_eq!(line.text("rejected/can.dxf").unwrap(), "one, written again\nEOF\n");
    }
}

#[test]
fn parked_files_are_removed_when_their_time_is_over() {
    let mut line = Line::new();
    let settings = SETTINGS.replace("rescan_s = 0.2\n", "rescan_s = 0.2\nincomplete_s = 0\n");
    fs::write(line.path("station.toml"), settings).unwrap();
    line.start(Mode::UntilStopped);
    line.drop("can.glb", "part");
    line.drop("can.dxf", "pattern");
    line.waits_for_text("import/can.dxf", "pattern on part at 0");
    line.waits_for_empty_hot();
    line.waits_for("an empty folder", |line| !line.path("state/parked").exists());
    assert_eq!(files(&line.path("archive/can")), ["can.dxf", "can.glb", "current-part.txt"]);
}
