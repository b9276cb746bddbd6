//! The FreeCAD workbench of `plugins/freecad` works with this program, in FreeCAD itself: without a window (`freecadcmd`), and
//! in a window on an X server without a screen.
//!
//! The scripts in `freecad/` contain the checks; each prints a line per check and ends with a code.

use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use fs_err as fs;

use crate::ezdxf::{assert_clean, judged};
use crate::khronos;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
/// The longest time that a script may take; on an idle machine, none takes a fifth of it.
const PATIENCE: Duration = Duration::from_secs(300);

/// The first of the programs that is installed; in CI, one must be.
fn installed(names: &[&str]) -> Option<String> {
    let has = |name: &&&str| {
        Command::new("sh")
            .args(["-c", "command -v \"$0\"", name])
            .stdout(Stdio::null())
            .status()
            .is_ok_and(|status| status.success())
    };
    let found = names.iter().find(has).map(|name| (*name).to_owned());
    if found.is_none() {
        assert!(std::env::var("CI").is_err(), "{} is required in CI", names[0]);
        eprintln!("SKIPPED: {} is not installed, the FreeCAD workbench was not tested", names[0]);
    }
    found
}

/// Runs a command with settings of FreeCAD in `home`, and fails with its output unless it succeeds.
fn succeeds(command: &mut Command, home: &Path) {
    let output = home.join("output.txt");
    let file = std::fs::File::create(&output).unwrap();
    let mut child = command
        .env("FREECAD_USER_HOME", home)
        .env("ISOMARK", env!("CARGO_BIN_EXE_isomark"))
        .stdin(Stdio::null())
        .stdout(file.try_clone().unwrap())
        .stderr(file)
        .spawn()
        .unwrap();
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break Some(status);
        }
        if start.elapsed() > PATIENCE {
            child.kill().unwrap();
            child.wait().unwrap();
            break None;
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    let mut said = Vec::new();
    fs::File::open(&output).unwrap().read_to_end(&mut said).unwrap();
    let said = String::from_utf8_lossy(&said);
    assert!(said.lines().any(|line| line.starts_with("ok ")), "no check ran:\n{said}");
    assert!(status.is_some_and(|status| status.success()), "{status:?}:\n{said}");
}

/// Runs a script in FreeCAD without a window; returns a folder with the files that it wrote, or `None` without FreeCAD.
fn without_window(script: &str) -> Option<tempfile::TempDir> {
    let freecad = installed(&["freecadcmd", "FreeCADCmd"])?;
    let home = tempfile::tempdir().unwrap();
    let mut command = Command::new(freecad);
    command.arg(format!("{ROOT}/tests/plugins/freecad/{script}")).env("ISOMARK_FILES", home.path());
    succeeds(&mut command, home.path());
    Some(home)
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        match entry.path().is_dir() {
            true => copy(&entry.path(), &target),
            false => drop(fs::copy(entry.path(), target).unwrap()),
        }
    }
}

#[test]
fn drawings_from_freecad_are_marked_with_the_lengths_that_were_drawn() {
    let Some(files) = without_window("lengths.py") else { return };
    // Part and drawing are valid for other programs, too.
    if khronos::is_available() {
        let found = &khronos::judged(&[files.path().join("part.glb")])[0]["issues"];
        assert_eq!((&found["numErrors"], &found["numWarnings"]), (&0.into(), &0.into()), "{found}");
    }
    let Some(report) = judged(&fs::read(files.path().join("drawing.dxf")).unwrap()) else { return };
    assert_clean(&report);
    assert_eq!((&report["version"], &report["units"]), (&"AC1015".into(), &4.into()));
    assert_eq!(report["entities"].as_array().unwrap().len(), 6);
}

#[test]
fn what_freecad_sends_reaches_a_station_and_its_answer_comes_back() {
    without_window("stations.py");
}

#[test]
fn the_workbench_works_in_a_window() {
    let Some(freecad) = installed(&["freecad", "FreeCAD"]) else { return };
    for tool in ["xvfb-run", "openbox", "xdotool"] {
        if installed(&[tool]).is_none() {
            return;
        }
    }
    let home = tempfile::tempdir().unwrap();
    copy(&Path::new(ROOT).join("plugins/freecad"), &home.path().join("Mod/isomark"));
    // Without a window manager, dialogs get no focus.
    let inside = format!("openbox & exec {freecad} {ROOT}/tests/plugins/freecad/window.py");
    let mut command = Command::new("xvfb-run");
    command.args(["-a", "-s", "-screen 0 1440x1000x24", "sh", "-c", &inside]);
    // FreeCAD's start page does not run as root otherwise.
    command.env("QTWEBENGINE_DISABLE_SANDBOX", "1").env("LIBGL_ALWAYS_SOFTWARE", "1");
    command.env("ISOMARK_FILES", home.path());
    succeeds(&mut command, home.path());
    // The window was closed while a program ran for it.
    let child = fs::read_to_string(home.path().join("child")).unwrap();
    let (number, folder) = child.trim_end().split_once('\n').unwrap();
    assert!(!Path::new("/proc").join(number).exists(), "process {number} still runs");
    assert!(!Path::new(folder).exists(), "{folder} is left");
}
