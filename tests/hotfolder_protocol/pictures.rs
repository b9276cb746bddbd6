//! Pictures are drawn after the drawings that wait are delivered.

use super::*;

const DRAWINGS: usize = 60;

fn name(number: usize) -> String {
    format!("can@{number}.dxf")
}

/// Drawings in a hot folder, all of which can start as soon as their part is fitted.
fn with_a_burst() -> Line {
    let line = Line::new();
    line.drop("can.glb", "can.glb");
    (0..DRAWINGS).for_each(|number| line.drop(&name(number), "first"));
    line
}

#[test]
fn a_burst_delivers_its_drawings_before_it_draws_their_pictures() {
    let mut line = with_a_burst();
    line.start(Mode::UntilStopped);
    line.waits_for_empty_hot();
    let drawn = line.seen.drawn.lock().unwrap().clone();
    assert_eq!(drawn.len(), DRAWINGS);
    let early = drawn.iter().filter(|corrected| **corrected < DRAWINGS).count();
    assert!(early < DRAWINGS / 2, "{early} of {DRAWINGS} pages were drawn while drawings waited: {drawn:?}");
    for number in 0..DRAWINGS {
        let report = |ending: &str| line.text(&format!("reports/can/{}.{ending}", name(number)));
        assert_eq!(report("report.json").unwrap(), "before: nothing");
        assert_eq!(report("report.html").unwrap(), "<!DOCTYPE html>first on can.glb at 0");
        assert_eq!(report("preview.svg").unwrap(), "<svg/>");
    }
    assert_eq!(line.stop().delivered, DRAWINGS as u64);
}

#[test]
fn pictures_that_wait_are_drawn_before_the_station_ends() {
    let mut line = with_a_burst();
    line.start(Mode::UntilStopped);
    line.waits_for("a delivered drawing", |line| !line.import().is_empty());
    line.stop();
    for name in line.import() {
        let page = line.text(&format!("reports/can/{name}.report.html"));
        assert_eq!(page.unwrap(), "<!DOCTYPE html>first on can.glb at 0", "{name}");
        assert!(line.path("archive/can").join(name).exists());
    }
}

/// A station that is killed before the pictures would otherwise never count them, and people would look for them in the queue.
#[test]
fn drawings_count_as_delivered_when_they_are_in_import() {
    let mut line = Line::new();
    line.drop("can.glb", "can.glb");
    (0..DRAWINGS).for_each(|number| line.drop(&name(number), "held-page"));
    line.start(Mode::UntilStopped);
    // The last ones are still at work in their threads.
    line.waits_for("a status with the deliveries", |line| {
        let status = line.text("state/status.json").unwrap_or_default();
        let Ok(status) = serde_json::from_str::<serde_json::Value>(&status) else { return false };
        let number = |pointer: &str| status.pointer(pointer).unwrap().as_u64().unwrap() as usize;
        line.import().len() == DRAWINGS
            && number("/done/delivered") >= DRAWINGS / 2
            && number("/waiting/count") + number("/incomplete/count") == 0
    });
    line.seen.released.store(true, Ordering::SeqCst);
    line.waits_for_empty_hot();
    assert_eq!(line.stop().delivered, DRAWINGS as u64);
}
