//! STEP files as parts, by command and in a station.

use crate::desk::{Desk, drawing, number, part};
use crate::station::Station;

#[test]
fn the_can_is_unrolled_with_the_numbers_of_the_file() {
    let desk = Desk::new();
    let (can, lines) = (part("can/part.step"), drawing("abc"));
    let shown = desk.isomark(&["inspect", &can]).out;
    for words in [
        "format     STEP",
        "2 x cone, 1 x cylinder, 2 x plane",
        "mm, because the STEP file states it",
        "bodies     Can",
    ] {
        assert!(shown.contains(words), "`{words}` is missing in:\n{shown}");
    }
    let report = desk.correct(
        &can,
        &lines,
        "--facing=-y --place 0,60 --preview side.svg --on-part can.glb --report-html can.html",
    );
    let page = desk.text("can.html");
    assert!(page.contains("mm, the faces of its file, shown with "), "a STEP file has no triangles");
    assert_eq!(report["map"]["method"], "cylinder");
    // The file gives the radius as 33.
    assert_eq!(number(&report, "/map/radius_mm"), 33.0);
    assert!(number(&report, "/map/residual_mm") < 1e-9);
    // What is left is the shortening of curves that are marked as chords.
    assert!(number(&report, "/quality/after/length_error_mm") < 1e-3);
    assert!(report["quality"]["after"].get("uncertain").is_none(), "{}", report["quality"]);
    // The same part from memory.
    let station = Station::new();
    station.copy_into(&can, "can.step");
    assert!(station.once().out.starts_with("0 delivered, 1 part fitted"));
    station.copy_into(&lines, "can.dxf");
    station.once();
    assert_eq!(station.import(), ["can.dxf"]);
    let kept = station.desk.text("reports/can/can.dxf.report.json");
    let kept: serde_json::Value = serde_json::from_str(&kept).unwrap();
    assert_eq!(number(&kept, "/map/radius_mm"), 33.0);
}

#[test]
fn a_step_file_that_is_cut_off_waits_and_a_damaged_one_is_rejected_with_its_record() {
    let desk = Desk::new();
    let can = std::fs::read_to_string(part("can/part.step")).unwrap();
    desk.write("cut.step", &can[..4000]);
    desk.isomark(&["inspect", "cut.step"]).refused(1, &["cut off", "line", "mesh-truncated"]);
    desk.write(
        "damaged.stp",
        can.replacen("CYLINDRICAL_SURFACE('',#33,33.)", "CYLINDRICAL_SURFACE('',#33,-33.)", 1),
    );
    desk.isomark(&["correct", "damaged.stp", &drawing("abc"), "--out", "out.dxf"])
        .refused(1, &["#32", "line", "-33", "FreeCAD", "step-invalid"]);
    let station = Station::new();
    station.desk.write("hot/can.step", &can[..4000]);
    station.once();
    assert!(station.path("hot/can.step").exists(), "an incomplete file waits");
}
