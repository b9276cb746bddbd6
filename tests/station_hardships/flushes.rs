//! Protection against power cuts: content and name of each filed file are flushed before the journal records it. Only
//! Linux shows a program's system calls, and only where tracing is permitted.

use std::io::Write;
use std::process::Stdio;

use fs_err as fs;

use super::{PART, Station, drawing, line};

/// The system calls of a station that processes its hot folder, in their order; `None`, with a printed note, where
/// tracing is not possible.
fn calls_of(station: &Station) -> Option<Vec<String>> {
    let trace = station.path("trace.txt");
    let calls = "trace=fsync,fdatasync,rename,renameat,renameat2,link,linkat,write";
    let program = env!("CARGO_BIN_EXE_isomark");
    let mut command = std::process::Command::new("strace");
    command.args(["-f", "-y", "-s", "4096", "-e", calls, "-o"]).arg(&trace);
    command.arg(program).args(["watch", "station.toml", "--once"]).current_dir(station.path(""));
    let ran = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status();
    if !ran.is_ok_and(|status| status.code().is_some_and(|code| code < 2)) {
        assert!(std::env::var_os("CI").is_none(), "strace is missing, or may not trace here");
        let note = b"SKIPPED: the calls of a program cannot be traced here, flushes were not tested\n";
        std::io::stderr().write_all(note).unwrap();
        return None;
    }
    let text = String::from_utf8_lossy(&fs::read(trace).unwrap()).into_owned();
    // A call that was interrupted by a call of another thread has two lines: its start and its end.
    Some(text.lines().map(str::to_owned).collect())
}

/// The first call after `from` that contains all of these words.
fn after(calls: &[String], from: usize, words: &[&str]) -> Option<usize> {
    let found = |call: &String| words.iter().all(|word| call.contains(word));
    calls.iter().skip(from).position(found).map(|index| index + from)
}

/// The index of the call that flushed the folder, after the file was flushed and got its name.
fn is_flushed(calls: &[String], path: &str) -> usize {
    let folder = path.rsplit_once('/').unwrap().0;
    let named = |call: &&String| {
        let is_naming = call.contains("rename") || call.contains("link");
        is_naming && call.contains(&format!("{path}\""))
    };
    let naming = calls.iter().find(named).unwrap_or_else(|| panic!("{path} got no name: {calls:#?}"));
    let index = calls.iter().position(|call| call == naming).unwrap();
    let temporary = naming.split('"').find(|word| word.contains(".isomark-") && word.ends_with(".part"));
    let temporary = temporary.unwrap_or_else(|| panic!("{path} was renamed without being written: {naming}"));
    let flushed = after(&calls[..index], 0, &["sync(", temporary.rsplit('/').next().unwrap()]);
    assert!(flushed.is_some(), "{path} got its name before it was flushed");
    let folder = format!("/{folder}>");
    after(calls, index, &["sync(", &folder]).unwrap_or_else(|| panic!("{folder} was not flushed"))
}

#[test]
fn files_are_flushed_before_the_journal_records_them() {
    let station = Station::new();
    fs::write(station.path("hot/trough.obj"), PART).unwrap();
    let square = drawing(&line([-5.0, 0.0], [5.0, 0.0]));
    fs::write(station.path("hot/trough.dxf"), &square).unwrap();
    fs::write(station.path("hot/trough.toml"), "[placement]\nrotate_deg = 5\n").unwrap();
    fs::write(station.path("hot/trough@bad.dxf"), "0\nSECTION\n2\nENTITIES\n0\nENDSEC\n0\nEOF\n").unwrap();
    station.make_old();
    let Some(calls) = calls_of(&station) else { return };
    let recorded = |words: &[&str]| {
        let did = [&["write(", "journal.log"], words].concat();
        after(&calls, 0, &did).unwrap_or_else(|| panic!("the journal has no line with {words:?}"))
    };
    let learned = recorded(&["did\\\":\\\"learned", "trough.obj"]);
    assert!(is_flushed(&calls, "archive/trough/trough.obj") < learned);
    let done = recorded(&["did\\\":\\\"done", "trough.dxf"]);
    assert!(is_flushed(&calls, "archive/trough/trough.dxf") < done);
    assert!(is_flushed(&calls, "archive/trough/trough.toml") < done);
    // A file that was moved out of the hot folder does not return after a power cut.
    let parked = after(&calls, 0, &["rename", "hot/trough.dxf\"", "parked"]).unwrap();
    assert!(after(&calls, parked, &["sync(", "/hot>"]).unwrap() < done);
    is_flushed(&calls, "rejected/trough@bad.dxf");
    is_flushed(&calls, "rejected/trough@bad.dxf.reason.txt");
    // A report is complete, or does not exist.
    let report = after(&calls, 0, &["rename", "trough.dxf.report.json\""]).unwrap();
    let temporary = calls[report].split('"').find(|word| word.ends_with(".part")).unwrap();
    assert!(after(&calls[..report], 0, &["sync(", temporary.rsplit('/').next().unwrap()]).is_some());
}
