//! The add-on in `plugins/blender` runs in Blender without a window, with this program and a running station.
//!
//! `plugins/blender/tests/run.py` installs the add-on from its zip into a temporary folder and runs the tests beside it.

use std::path::Path;
use std::process::{Command, Stdio};

/// The exit code of `run.py` if neither the Python module `bpy` nor Blender is installed.
const NO_BLENDER: i32 = 77;

#[test]
fn the_blender_add_on_draws_measures_sends_and_shows_the_answer() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("plugins/blender/tests/run.py");
    let output = Command::new("python3")
        .arg(script)
        .args(["--isomark", env!("CARGO_BIN_EXE_isomark")])
        .stdin(Stdio::null())
        .output();
    let code = output.as_ref().ok().and_then(|output| output.status.code());
    if output.is_err() || code == Some(NO_BLENDER) {
        assert!(std::env::var("CI").is_err(), "python3 with bpy, or Blender, is required in CI");
        eprintln!(
            "SKIPPED: neither the Python module bpy nor Blender is installed, the add-on was not tested"
        );
        return;
    }
    let texts = output
        .map(|output| [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned()));
    assert_eq!(code, Some(0), "the add-on's tests failed:\n{}", texts.unwrap_or_default().join("\n"));
}
