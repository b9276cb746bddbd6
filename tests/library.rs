//! The library in another program: from outside, without the features `cli` and `station`.

#![allow(clippy::unwrap_used, reason = "a test may fail loudly")]

use std::path::{Path, PathBuf};
use std::process::Command;

use fs_err as fs;

const PROGRAM: &str = r#"
use isomark::{Corrector, Drawing, Part, Settings};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let [part, drawing, out] = [1, 2, 3].map(|index| std::env::args().nth(index).unwrap());
    let settings = Settings::default().facing("+z")?.place(0.0, 8.0);
    let surface = Corrector::new().fit(&Part::open(part)?, &settings)?;
    let result = surface.correct(&Drawing::open(drawing)?, &settings)?;
    std::fs::write(out, result.dxf())?;
    assert!(result.on_part().starts_with(b"glTF"));
    Ok(())
}
"#;

/// The profiles of this repository, so that its built dependencies are used again. The crate itself and its geometry are built
/// unoptimised, which is quicker and must not change a byte.
fn profiles() -> String {
    let manifest = include_str!("../Cargo.toml");
    let optimised = "isomark-geometry.opt-level = 3";
    assert!(manifest.contains(optimised));
    manifest
        .split_once("[profile.dev]")
        .map(|(_, rest)| format!("[profile.dev]{rest}"))
        .unwrap()
        .split_once("[workspace.lints")
        .unwrap()
        .0
        .replace(optimised, "isomark-geometry.opt-level = 0")
}

#[test]
#[cfg_attr(windows, ignore = "builds with the cargo of this machine, which Wine does not run")]
fn ten_lines_without_default_features_give_the_same_bytes_as_the_program() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("ten-lines");
    fs::create_dir_all(folder.join("src")).unwrap();
    let manifest = format!(
        "[package]\nname = \"ten-lines\"\nversion = \"0.1.0\"\nedition = \"2024\"\n[workspace]\n[dependencies.isomark]\n\
         path = '{}'\ndefault-features = false\n{}[profile.dev.package.isomark]\nopt-level = 0\n",
        root.display(),
        profiles()
    );
    fs::write(folder.join("Cargo.toml"), manifest).unwrap();
    fs::write(folder.join("src/main.rs"), PROGRAM).unwrap();
    fs::copy(root.join("Cargo.lock"), folder.join("Cargo.lock")).unwrap();
    let target = Path::new(env!("CARGO_BIN_EXE_isomark")).ancestors().nth(2).unwrap();
    let [part, drawing] =
        ["parts/mouse.glb", "patterns/letters.dxf"].map(|name| root.join("examples").join(name));
    let cargo = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO"));
        command.args(arguments).current_dir(&folder).env("CARGO_TARGET_DIR", target);
        command
    };
    let run = cargo(&["run", "--offline", "--quiet", "--"])
        .args([&part, &drawing])
        .arg("outside.dxf")
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    // Neither the command line nor the folder watcher is a dependency.
    let tree = cargo(&["tree", "--offline", "--edges", "normal", "--prefix", "none"]).output().unwrap();
    let tree = String::from_utf8(tree.stdout).unwrap();
    assert!(tree.contains("isomark ") && tree.contains("nalgebra "), "{tree}");
    for left_out in ["clap ", "notify ", "ctrlc ", "tracing-subscriber ", "sysinfo "] {
        assert!(!tree.lines().any(|line| line.starts_with(left_out)), "{left_out}is also built:\n{tree}");
    }

    let corrected = Command::new(env!("CARGO_BIN_EXE_isomark"))
        .arg("correct")
        .args([&part, &drawing])
        .args(["--place", "0,8", "--out", "program.dxf", "--cache", "cache"])
        .current_dir(&folder)
        .output()
        .unwrap();
    assert!(corrected.status.success(), "{}", String::from_utf8_lossy(&corrected.stderr));
    let [outside, program] = ["outside.dxf", "program.dxf"].map(|name| fs::read(folder.join(name)).unwrap());
    assert!(outside.len() > 5_000);
    assert!(outside == program, "{} and {} bytes", outside.len(), program.len());
}
