//! Checks of written glTF files with the validator of Khronos, a program for node.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

const JUDGE: &str = r"
const validator = require('gltf-validator'), fs = require('fs');
Promise.all(process.argv.slice(1).map(file => validator.validateBytes(new Uint8Array(fs.readFileSync(file)))))
    .then(found => console.log(JSON.stringify(found)));
";

/// Node, with the modules that `.ci/run` installs, or those of the system.
fn node() -> Command {
    let mut node = Command::new("node");
    let modules = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/ci-node/node_modules");
    if modules.exists() {
        node.env("NODE_PATH", modules);
    }
    node
}

/// Whether node with gltf-validator is available; in CI it must be.
pub(crate) fn is_available() -> bool {
    let has_validator = node()
        .args(["-e", "require('gltf-validator')"])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success());
    if !has_validator {
        assert!(std::env::var("CI").is_err(), "node with gltf-validator is required in CI");
        eprintln!("SKIPPED: node with gltf-validator is not installed, the files were not checked");
    }
    has_validator
}

/// The validator's report on each file.
pub(crate) fn judged(files: &[PathBuf]) -> Vec<Value> {
    let output = node().args(["-e", JUDGE]).args(files).output().unwrap();
    assert!(output.status.success(), "gltf-validator: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}
