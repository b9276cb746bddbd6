//! Many drops at once: jobs run in parallel, in the right order where it matters, and only for complete files.

use std::io::Write;
use std::sync::atomic::Ordering;
use std::time::Duration;

use fs_err as fs;

use super::{Line, SETTINGS, files};
use isomark::hotfolder::Mode;

/// The size of a large job, bytes.
const LARGE: usize = 5 << 20;

#[test]
fn large_jobs_leave_room_for_small_ones() {
    let line = Line::running();
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    // More of them than there are threads.
    let count = std::thread::available_parallelism().map_or(2, usize::from) + 2;
    for number in 0..count {
        line.rename_into(&format!("vast{number}.glb"), &format!("hold {}", "x".repeat(LARGE)));
        line.rename_into(&format!("vast{number}.dxf"), "its own");
    }
    for number in 0..50 {
        line.rename_into(&format!("can@{number}.dxf"), "small");
    }
    line.waits_for("the small ones", |line| line.import().len() == 50);
    assert_eq!(files(&line.path("archive")).iter().filter(|name| name.contains("vast")).count(), 0);
    line.seen.released.store(true, Ordering::SeqCst);
    line.waits_for_empty_hot();
    for number in 0..count {
        assert_eq!(line.text(&format!("import/vast{number}.dxf")).unwrap(), "its own on held at 0");
    }
}

/// A small file may be a large job, which is known only after reading it.
#[test]
fn jobs_that_turn_out_to_be_large_leave_room_for_the_rest() {
    let line = Line::running();
    let count = std::thread::available_parallelism().map_or(2, usize::from) + 20;
    for number in 0..count {
        line.drop(&format!("heavy{number}.glb"), "part");
    }
    line.drop("small.glb", "part");
    line.waits_for_empty_hot();
    for number in 0..count {
        line.rename_into(&format!("heavy{number}.dxf"), "slow");
    }
    // The same holds for parts.
    line.rename_into("vast.glb", "slow");
    line.rename_into("vast.dxf", "pattern");
    for number in 0..50 {
        line.rename_into(&format!("small@{number}.dxf"), "small");
    }
    // A result that is being written has a temporary name.
    let results =
        |line: &Line| line.import().iter().filter(|name| name.ends_with(".dxf")).cloned().collect::<Vec<_>>();
    line.waits_for("the small ones", |line| {
        results(line).iter().filter(|name| name.starts_with("small@")).count() == 50
    });
    assert_eq!(results(&line).len(), 50);
    let threads = std::thread::available_parallelism().map_or(2, usize::from).max(2);
    assert!(line.seen.holding.load(Ordering::SeqCst) < threads);
    line.seen.released.store(true, Ordering::SeqCst);
    line.waits_for_empty_hot();
    assert_eq!(line.import().len(), 50 + count + 1);
}

/// Jobs that unexpectedly take long leave room for others, too.
#[test]
fn jobs_that_unexpectedly_take_long_leave_room_for_others() {
    let line = Line::running();
    let threads = std::thread::available_parallelism().map_or(2, usize::from).max(2);
    for number in 0..threads {
        line.drop(&format!("stuck{number}.glb"), "part");
    }
    line.drop("small.glb", "part");
    line.waits_for_empty_hot();
    for number in 0..threads {
        line.rename_into(&format!("stuck{number}.dxf"), "hold");
    }
    line.waits_for("all threads to be taken", |line| line.seen.holding.load(Ordering::SeqCst) == threads);
    line.rename_into("small.dxf", "small");
    line.waits_for("the small one", |line| line.import() == ["small.dxf"]);
    line.seen.released.store(true, Ordering::SeqCst);
    line.waits_for_empty_hot();
}

#[test]
fn drawings_with_the_same_result_keep_their_order() {
    let line = Line::running();
    for part in ["can.glb", "mug.glb"] {
        line.drop(part, "part");
    }
    line.waits_for_empty_hot();
    line.rename_into("can@0.dxf", "hold");
    line.waits_for("the job that is held", |line| line.seen.holding.load(Ordering::SeqCst) == 1);
    // The clocks of file systems tick every few milliseconds, and a listing sorts only by time.
    let tick = || std::thread::sleep(Duration::from_millis(20));
    let order = [7, 3, 9, 1, 8, 2];
    for number in order {
        tick();
        line.rename_into(&format!("can@{number}.dxf"), "pattern");
        line.rename_into(&format!("mug@{number}.dxf"), "pattern");
    }
    // Another file with the same result as the one that is held.
    line.drop("can/0.dxf", "second");
    let of = |line: &Line, sku: &str| line.import().iter().filter(|name| name.starts_with(sku)).count();
    line.waits_for("the other SKU", |line| of(line, "mug") == order.len());
    line.waits_for("the other drawings of the SKU", |line| of(line, "can") == order.len());
    let made =
        |line: &Line| line.seen.corrected.lock().unwrap().iter().filter(|made| *made == "can@0.dxf").count();
    assert_eq!(made(&line), 0, "neither of the two is made");
    line.seen.released.store(true, Ordering::SeqCst);
    line.waits_for_empty_hot();
    assert_eq!((made(&line), line.text("import/can@0.dxf").unwrap().as_str()), (2, "second on part at 0"));
}

#[test]
fn a_part_waits_for_the_running_jobs_of_its_sku() {
    let line = Line::running();
    for part in ["can.glb", "mug.glb"] {
        line.drop(part, "part");
    }
    line.waits_for_empty_hot();
    line.rename_into("can@0.dxf", "hold");
    line.waits_for("the job that is held", |line| line.seen.holding.load(Ordering::SeqCst) == 1);
    line.rename_into("can.glb", "another part");
    line.rename_into("can@5.dxf", "pattern");
    line.rename_into("mug@last.dxf", "pattern");
    line.waits_for("another SKU", |line| line.import() == ["mug@last.dxf"]);
    assert_eq!(line.seen.learned.lock().unwrap().len(), 2);
    line.seen.released.store(true, Ordering::SeqCst);
    line.waits_for_empty_hot();
    assert_eq!(line.seen.learned.lock().unwrap().len(), 3);
    for (name, made) in [("can@0.dxf", "held"), ("can@5.dxf", "pattern")] {
        assert_eq!(line.text(&format!("import/{name}")).unwrap(), format!("{made} on another part at 0"));
    }
}

/// Drawings that are corrected again do not delay a part of their SKU: most of that work would be wasted.
#[test]
fn a_part_is_processed_before_drawings_are_corrected_again() {
    const DRAWINGS: usize = 40;
    let mut line = Line::new();
    fs::write(
        line.path("station.toml"),
        SETTINGS.to_owned() + "jobs = 2\n[delivery]\noutdated = \"correct\"\n",
    )
    .unwrap();
    line.start(Mode::UntilStopped);
    line.seen.released.store(true, Ordering::SeqCst);
    for part in ["can.glb", "mug.glb"] {
        line.drop(part, "part");
    }
    line.waits_for_empty_hot();
    for number in 0..DRAWINGS {
        line.rename_into(&format!("can@{number}.dxf"), "hold");
    }
    line.waits_for_empty_hot();
    line.seen.released.store(false, Ordering::SeqCst);
    line.seen.holding.store(0, Ordering::SeqCst);
    line.rename_into("can.glb", "second part");
    line.waits_for("drawings that are corrected again", |line| line.seen.holding.load(Ordering::SeqCst) == 2);
    line.rename_into("can.glb", "third part");
    line.rename_into("mug@last.dxf", "pattern");
    line.waits_for("another SKU", |line| line.import().contains(&"mug@last.dxf".to_owned()));
    line.seen.released.store(true, Ordering::SeqCst);
    let is_new = |line: &Line, number: usize| {
        line.text(&format!("import/can@{number}.dxf")).is_some_and(|text| text == "held on third part at 0")
    };
    line.waits_for("all on the newest part", |line| (0..DRAWINGS).all(|number| is_new(line, number)));
    let made = line.seen.corrected.lock().unwrap().iter().filter(|name| name.starts_with("can")).count();
    assert!(made <= 2 * DRAWINGS + 4, "{made} corrections of {DRAWINGS} drawings");
}

/// A drop that is ready but cannot start must not keep the station busy.
#[test]
fn a_station_that_waits_for_a_job_is_idle() {
    let line = Line::running();
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    line.rename_into("can@1.dxf", "hold");
    line.rename_into("can@2.dxf", "pattern");
    std::thread::sleep(Duration::from_millis(200));
    let before = line.seen.pulses.load(Ordering::SeqCst);
    std::thread::sleep(Duration::from_secs(1));
    let woken = line.seen.pulses.load(Ordering::SeqCst) - before;
    // It lists five times a second.
    assert!(woken < 50, "{woken}");
    line.seen.released.store(true, Ordering::SeqCst);
    line.waits_for_empty_hot();
    assert_eq!(line.import(), ["can@1.dxf", "can@2.dxf"]);
}

/// In a format without an end mark, half a file looks complete; but its writer still has it open.
#[cfg(target_os = "linux")]
#[test]
fn a_stalled_copy_that_looks_complete_is_not_processed() {
    let line = Line::running();
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    let mut file = fs::File::create(line.path("hot/can.dxf")).unwrap();
    file.write_all(b"half\nEOF\n").unwrap();
    file.sync_all().unwrap();
    // Far longer than the settle time, and over several listings.
    let stalled = std::time::Instant::now();
    line.waits_for("time to pass", |_| stalled.elapsed() > Duration::from_secs(3));
    assert_eq!(line.import(), [""; 0]);
    file.write_all(b"whole\nEOF\n").unwrap();
    drop(file);
    line.waits_for_text("import/can.dxf", "half\nEOF\nwhole on part at 0");
}

/// Some programs never close the files that they write.
#[test]
fn the_station_does_not_wait_forever_for_a_file_to_be_closed() {
    let mut line = Line::new();
    fs::write(line.path("station.toml"), format!("{SETTINGS}incomplete_s = 0.5\n")).unwrap();
    line.start(Mode::UntilStopped);
    line.drop("can.glb", "part");
    line.waits_for_empty_hot();
    let mut file = fs::File::create(line.path("hot/can.dxf")).unwrap();
    file.write_all(b"pattern\nEOF\n").unwrap();
    if cfg!(windows) {
        // Windows cannot read an open file; the station tries again until it can.
        drop(file);
        return line.waits_for_text("import/can.dxf", "pattern on part at 0");
    }
    line.waits_for_text("import/can.dxf", "pattern on part at 0");
}
