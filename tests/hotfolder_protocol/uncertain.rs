//! A station that ended between the journal's line about a delivery and the delivery, and an import folder that
//! contains neither the drawing nor its temporary file: an importer took the drawing, or somebody removed the temporary
//! file.

use fs_err as fs;
use isomark::hotfolder::Request;
use serde_json::Value;

use super::{Line, times};

/// A station that has delivered a drawing.
fn delivered() -> Line {
    let mut line = Line::new();
    line.drop("can.glb", "part");
    line.drop("can.dxf", "pattern");
    assert_eq!(line.once().delivered, 1);
    line
}

/// Restores the state in which the journal records that the drawing is about to be delivered; the drawing itself is
/// missing. Returns `false` where the import folder would not be recognized after that.
fn ends_before_the_rename(line: &Line) -> bool {
    if !times::are_those_of_creation(&line.path("elsewhere")) {
        return false;
    }
    let journal = line.text("state/journal.log").unwrap();
    let delivering = journal.rfind("\"did\":\"delivering\"").unwrap();
    let end = delivering + journal[delivering..].find('\n').unwrap() + 1;
    fs::write(line.path("state/journal.log"), &journal[..end]).unwrap();
    fs::rename(line.path("archive/can/can.dxf"), line.path("hot/can.dxf")).unwrap();
    let _ = fs::remove_file(line.path("import/can.dxf"));
    true
}

fn uncertain(line: &Line) -> Vec<String> {
    let status: Value = crate::schemas::document(line.text("state/status.json").unwrap());
    let drawings = status["uncertain"]["first"].as_array().unwrap().iter();
    drawings.map(|drawing| drawing["name"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn an_uncertain_drawing_is_listed_and_delivered_again_on_request() {
    let mut line = delivered();
    assert!(uncertain(&line).is_empty());
    if !ends_before_the_rename(&line) {
        return;
    }
    let tally = line.once();
    assert_eq!((tally.delivered, tally.uncertain), (0, 1));
    assert!(line.import().is_empty(), "it is not delivered twice");
    assert!(line.path("archive/can/can.dxf").exists() && !line.path("hot/can.dxf").exists());
    assert_eq!(uncertain(&line), ["can.dxf"]);
    // It stays uncertain until somebody asks for it; requests for other drops do not matter.
    Request::Waiting.leave(&line.path("state")).unwrap();
    Request::Uncertain(Some("can@other.dxf".into())).leave(&line.path("state")).unwrap();
    line.once();
    assert_eq!((line.import().len(), uncertain(&line)), (0, vec!["can.dxf".to_owned()]));
    Request::Uncertain(Some("can.dxf".into())).leave(&line.path("state")).unwrap();
    assert_eq!(line.once().delivered, 1);
    assert_eq!(line.text("import/can.dxf").unwrap(), "pattern on part at 0");
    assert!(uncertain(&line).is_empty());
}

#[test]
fn all_uncertain_drawings_are_delivered_again_on_request() {
    let mut line = delivered();
    if !ends_before_the_rename(&line) {
        return;
    }
    line.once();
    Request::Uncertain(None).leave(&line.path("state")).unwrap();
    line.once();
    assert_eq!((line.import(), uncertain(&line).len()), (vec!["can.dxf".to_owned()], 0));
}

/// As for a certain delivery, the settings decide whether a drawing that is missing in import is delivered again.
#[test]
fn an_uncertain_drawing_may_be_dropped_again() {
    for (repeat, delivered_again) in [("if-gone", true), ("never", false)] {
        let mut line = delivered();
        let settings = line.text("station.toml").unwrap() + &format!("[delivery]\nrepeat = \"{repeat}\"\n");
        fs::write(line.path("station.toml"), settings).unwrap();
        if !ends_before_the_rename(&line) {
            return;
        }
        line.once();
        line.drop("can.dxf", "pattern");
        let tally = line.once();
        assert_eq!((tally.delivered, tally.repeated), if delivered_again { (1, 0) } else { (0, 1) });
        assert_eq!(
            (line.import().len(), uncertain(&line).is_empty()),
            (tally.delivered as usize, delivered_again)
        );
        Request::Uncertain(None).leave(&line.path("state")).unwrap();
        line.once();
        assert_eq!((line.import(), uncertain(&line).len()), (vec!["can.dxf".to_owned()], 0), "{repeat}");
    }
}

#[test]
fn an_uncertain_drawing_without_its_drop_is_listed() {
    let mut line = delivered();
    if !ends_before_the_rename(&line) {
        return;
    }
    fs::remove_file(line.path("hot/can.dxf")).unwrap();
    line.once();
    assert_eq!(uncertain(&line), ["can.dxf"]);
    // There is no original to make it from.
    Request::Uncertain(None).leave(&line.path("state")).unwrap();
    line.once();
    assert_eq!((line.import().len(), uncertain(&line)), (0, vec!["can.dxf".to_owned()]));
}

/// A renamed drawing would have replaced the older one, so it was not delivered.
#[test]
fn an_older_drawing_that_is_still_in_import_is_replaced() {
    let mut line = delivered();
    let older = line.text("import/can.dxf").unwrap();
    // The newer original gets its place in the archive.
    fs::remove_file(line.path("archive/can/can.dxf")).unwrap();
    line.drop("can.dxf", "newer");
    assert_eq!(line.once().delivered, 1);
    if !ends_before_the_rename(&line) {
        return;
    }
    fs::write(line.path("import/can.dxf"), older).unwrap();
    let tally = line.once();
    assert_eq!((tally.delivered, tally.uncertain), (1, 0));
    assert_eq!(line.text("import/can.dxf").unwrap(), "newer on part at 0");
}

/// While the settings of its SKU are invalid, the drawing stays uncertain, and a station that runs once still ends.
#[test]
fn an_uncertain_drawing_waits_for_valid_settings() {
    let mut line = delivered();
    if !ends_before_the_rename(&line) {
        return;
    }
    line.once();
    fs::create_dir_all(line.path("skus")).unwrap();
    fs::write(line.path("skus/can.toml"), "wrong").unwrap();
    Request::Uncertain(None).leave(&line.path("state")).unwrap();
    assert_eq!(line.once().delivered, 0);
    assert_eq!(uncertain(&line), ["can.dxf"]);
    fs::remove_file(line.path("skus/can.toml")).unwrap();
    Request::Uncertain(None).leave(&line.path("state")).unwrap();
    assert_eq!(line.once().delivered, 1);
}

#[test]
fn a_drawing_in_the_import_folder_is_known_as_delivered() {
    let mut line = delivered();
    let drawing = fs::read(line.path("import/can.dxf")).unwrap();
    if !ends_before_the_rename(&line) {
        return;
    }
    fs::write(line.path("import/can.dxf"), &drawing).unwrap();
    line.once();
    assert!(uncertain(&line).is_empty() && line.path("archive/can/can.dxf").exists());
}

/// The line about the delivery may be lost on a full disk, and the import folder may contain a file of somebody else.
#[test]
fn a_drawing_that_was_about_to_be_filed_was_delivered() {
    let mut line = delivered();
    let journal = line.text("state/journal.log").unwrap();
    let lines = journal.split_inclusive('\n').filter(|line| !line.contains("\"did\":\"delivered\""));
    let kept: String = lines.take_while(|line| !line.contains("\"did\":\"done\"")).collect();
    assert!(kept.contains("\"did\":\"delivering\"") && kept.ends_with('\n'));
    assert!(kept.lines().last().unwrap().contains("\"did\":\"filing\""), "{kept}");
    fs::write(line.path("state/journal.log"), kept).unwrap();
    fs::rename(line.path("archive/can/can.dxf"), line.path("hot/can.dxf")).unwrap();
    fs::write(line.path("import/can.dxf"), "of somebody else").unwrap();
    line.once();
    assert_eq!(line.text("import/can.dxf").unwrap(), "of somebody else", "it is not delivered twice");
    assert!(line.path("archive/can/can.dxf").exists() && !line.path("hot/can.dxf").exists());
    assert!(uncertain(&line).is_empty());
}
