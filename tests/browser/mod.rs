//! A real headless Chromium and axe-core, driven by the Python scripts in this folder.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The script of axe-core, if it, Python and Chromium are available; in CI they must be.
pub fn axe() -> Option<PathBuf> {
    if cfg!(windows) {
        eprintln!("SKIPPED: the browser is driven through pipes of Unix, the page was not opened");
        return None;
    }
    let axe = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/ci-node/node_modules/axe-core/axe.min.js");
    let find =
        "import sys; sys.path.insert(0, 'tests/browser'); import chromium; sys.exit(not chromium.find())";
    let has_chromium =
        || Command::new("python3").args(["-B", "-c", find]).status().is_ok_and(|status| status.success());
    if axe.exists() && has_chromium() {
        return Some(axe);
    }
    assert!(
        std::env::var("CI").is_err(),
        "python3, chromium and axe-core (see `.ci/run`) are required in CI"
    );
    eprintln!("SKIPPED: python3, chromium or axe-core is not installed, the page was not opened");
    None
}
