//! The packages of `packaging/build.py` are complete, and what they contain runs where nothing else of isomark is.
//!
//! They contain the program of this test instead of a release build.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may fail loudly, its helpers too")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use fs_err as fs;
use tempfile::TempDir;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const PROGRAM: &str = env!("CARGO_BIN_EXE_isomark");
const PYTHON: &str = if cfg!(windows) { "python" } else { "python3" };

/// Whether a command runs; in CI it must.
fn is_installed(program: &str, arguments: &[&str]) -> bool {
    let runs = Command::new(program).args(arguments).output().is_ok_and(|output| output.status.success());
    if !runs {
        assert!(std::env::var("CI").is_err(), "{program} {arguments:?} is required in CI");
        eprintln!("SKIPPED: {program} {arguments:?} does not run, its packages were not tested");
    }
    runs
}

fn text(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned()).concat()
}

/// Standard output of a command that must succeed.
fn printed(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}: {}", text(&output));
    String::from_utf8(output.stdout).unwrap()
}

fn build(targets: &[&str], program: &Path, out: &Path) -> Command {
    let mut command = Command::new(PYTHON);
    command.arg(Path::new(ROOT).join("packaging/build.py")).args(targets);
    command.arg("--program").arg(program).arg("--out").arg(out);
    // Nothing is written into the sources.
    command.env("PYTHONDONTWRITEBYTECODE", "1");
    command
}

/// The packages in the order of the targets, in a temporary folder; `None` without Python 3.11.
fn packed(targets: &[&str], program: &Path) -> Option<(TempDir, Vec<PathBuf>)> {
    if !is_installed(PYTHON, &["-c", "import tomllib"]) {
        return None;
    }
    let out = tempfile::tempdir().unwrap();
    let lines = printed(&mut build(targets, program, out.path()));
    Some((out, lines.lines().map(PathBuf::from).collect()))
}

fn unzip(archive: &Path, folder: &Path) {
    printed(Command::new(PYTHON).args(["-m", "zipfile", "-e"]).args([archive, folder]));
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// The only entry of a folder.
fn only(folder: &Path) -> PathBuf {
    let entries: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(entries.len(), 1, "{entries:?}");
    entries[0].clone()
}

/// A file for Windows with the header of a program and nothing to run.
fn header_of_windows() -> Vec<u8> {
    let mut bytes = vec![0; 128];
    bytes[..2].copy_from_slice(b"MZ");
    bytes[60] = 64;
    bytes[64..68].copy_from_slice(b"PE\0\0");
    bytes[68..70].copy_from_slice(&0x8664_u16.to_le_bytes());
    bytes
}

/// The same for Linux.
#[cfg(target_os = "linux")]
fn header_of_linux() -> Vec<u8> {
    let mut bytes = vec![0; 64];
    bytes[..6].copy_from_slice(b"\x7fELF\x02\x01");
    bytes[18..20].copy_from_slice(&62_u16.to_le_bytes());
    bytes
}

/// Corrects a sample in an empty folder; `start` starts the program of the package.
fn assert_it_works(start: &dyn Fn() -> Command, samples: &Path) {
    let empty = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| printed(start().args(arguments).current_dir(empty.path()));
    assert_eq!(run(&["--version"]).trim_end(), concat!("isomark ", env!("CARGO_PKG_VERSION")));
    for sample in ["parts/mouse.glb", "patterns/letters.dxf"] {
        fs::copy(
            samples.join("examples").join(sample),
            empty.path().join(Path::new(sample).file_name().unwrap()),
        )
        .unwrap();
    }
    let given = [
        "correct",
        "mouse.glb",
        "letters.dxf",
        "--place",
        "0,8",
        "--out",
        "bent.dxf",
        "--report",
        "bent.json",
    ];
    run(&given);
    assert!(empty.path().join("bent.dxf").metadata().unwrap().len() > 1000);
    let report = fs::read_to_string(empty.path().join("bent.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    // The same limits for a debug build, a release build and Windows.
    let error = |when: &str| report["quality"][when]["length_error_mm"].as_f64().unwrap();
    assert!(error("before") > 5.0 && error("after") < 0.1, "{}", report["quality"]);
}

/// Runs a station with samples in an empty folder.
fn assert_the_demo_works(start: &dyn Fn() -> Command) {
    let empty = tempfile::tempdir().unwrap();
    let shown = printed(start().args(["demo", "station"]).current_dir(empty.path()));
    assert!(shown.contains("7 drawings delivered, 0 rejected"), "{shown}");
    let delivered = files(&empty.path().join("station/import"));
    assert_eq!(delivered.len(), 7, "{delivered:?}");
}

/// Every link of the documents to a file leads to a file.
fn assert_links_lead_to_files(folder: &Path) {
    let mut links = 0;
    for page in files(folder).iter().filter(|path| path.extension().is_some_and(|ending| ending == "md")) {
        let text = fs::read_to_string(page).unwrap();
        for link in text.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next()) {
            if !link.is_empty() && !link.contains("://") && !link.contains(char::is_whitespace) {
                // The documentation of the code stays with the code.
                let found = page.parent().unwrap().join(link).exists() || link == "src/lib.rs";
                assert!(found, "{}: {link} is not in the package", page.display());
                links += 1;
            }
        }
    }
    assert!(links > 20, "only {links} links were found");
}

/// The documents state which commands need the sources, which the package does not contain.
#[cfg(target_os = "linux")]
fn assert_commands_can_be_run(folder: &Path) {
    let read = |page: &str| fs::read_to_string(folder.join(page)).unwrap();
    let first = read("README.md");
    assert!(first.contains("This package contains the program") && first.contains("\nisomark demo --open"));
    for building in ["cargo run --release -- ", "cargo install", "packaging/build.py"] {
        assert!(!first.contains(building), "README.md: `{building}`");
    }
    for page in ["packaging/README.md", "plugins/blender/README.md"] {
        for section in read(page).split("\n## ").filter(|section| !section.contains("the sources")) {
            assert!(!["cargo ", "python3 "].iter().any(|word| section.contains(word)), "{page}: {section}");
        }
    }
}

/// The crates that cargo links for a target, as `name version`.
fn linked_crates(triple: &str) -> Vec<String> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let tree = ["tree", "--locked", "--edges", "normal", "--prefix", "none", "--target", triple];
    let listed = printed(Command::new(cargo).args(tree).current_dir(ROOT));
    let names = listed.lines().skip(1).filter_map(|line| line.split_once(" v"));
    names.map(|(name, rest)| format!("{name} {}", rest.split(' ').next().unwrap())).collect()
}

fn assert_licences_are_complete(notices: &str, triple: &str) {
    let crates = linked_crates(triple);
    assert!(crates.len() > 100, "{crates:?}");
    for each in &crates {
        // Once in the list, once above its texts.
        let times = notices.matches(each.as_str()).count();
        assert!(times >= 2, "{each}: {times} times in the licences");
    }
    for each in ["Bitstream Vera", "Hershey", "The Rust Project Contributors", "Apache License"] {
        assert!(notices.contains(each), "{each} is missing in the licences");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn the_tarball_runs_in_an_empty_folder_with_path_alone() {
    let Some((out, packages)) = packed(&["tarball"], Path::new(PROGRAM)) else { return };
    let place = tempfile::tempdir().unwrap();
    printed(Command::new("tar").arg("xf").arg(&packages[0]).arg("-C").arg(place.path()));
    let folder = only(place.path());
    let start = || {
        let mut command = Command::new("isomark");
        command.env_clear().env("PATH", &folder);
        command
    };
    assert_it_works(&start, &folder);
    assert_the_demo_works(&start);
    assert_links_lead_to_files(&folder);
    assert_commands_can_be_run(&folder);
    let notices = fs::read_to_string(folder.join("THIRD-PARTY-LICENSES.txt")).unwrap();
    let processor = std::env::consts::ARCH;
    assert_licences_are_complete(&notices, &format!("{processor}-unknown-linux-gnu"));
    printed(Command::new("sha256sum").args(["--check", "--strict", "SHA256SUMS"]).current_dir(out.path()));
}

#[test]
#[cfg(target_os = "linux")]
fn dpkg_installs_the_deb_with_its_dependencies_and_removes_it() {
    if !is_installed("dpkg-deb", &["--version"]) {
        return;
    }
    let Some((_out, packages)) = packed(&["deb"], Path::new(PROGRAM)) else { return };
    let fields =
        printed(Command::new("dpkg-deb").arg("--field").arg(&packages[0]).args(["Version", "Description"]));
    let own = (env!("CARGO_PKG_VERSION").replace('-', "~"), env!("CARGO_PKG_DESCRIPTION"));
    assert!(fields.starts_with(&format!("Version: {}\nDescription: {}\n", own.0, own.1)), "{fields}");
    let place = tempfile::tempdir().unwrap();
    let root = place.path();
    // A system that contains only the libraries of this one: dpkg rejects a package that needs others.
    let libraries = Command::new("dpkg-query").args(["--status", "libc6", "libgcc-s1"]).output().unwrap();
    if !libraries.status.success() {
        eprintln!("SKIPPED: this system is not made of packages of Debian, the .deb was only unpacked");
        printed(Command::new("dpkg-deb").arg("--extract").arg(&packages[0]).arg(root));
    } else {
        for folder in ["info", "updates", "triggers"] {
            fs::create_dir_all(root.join("var/lib/dpkg").join(folder)).unwrap();
        }
        fs::write(root.join("var/lib/dpkg/status"), &libraries.stdout).unwrap();
    }
    let dpkg = || {
        let mut command = Command::new("dpkg");
        // Without root, in a folder: no owners to set, no scripts to run.
        command.arg(format!("--root={}", root.display())).args(["--force-not-root", "--force-bad-path"]);
        command.arg(format!("--log={}", root.join("dpkg.log").display()));
        command
    };
    if libraries.status.success() {
        printed(dpkg().arg("--install").arg(&packages[0]));
    }
    let bin = root.join("usr/bin");
    let start = || {
        let mut command = Command::new("isomark");
        command.env_clear().env("PATH", &bin);
        command
    };
    let samples = root.join("usr/share/isomark");
    assert_it_works(&start, &samples);
    assert_links_lead_to_files(&samples);
    assert_commands_can_be_run(&samples);
    let unit = fs::read_to_string(root.join("usr/lib/systemd/system/isomark@.service")).unwrap();
    let line = unit.lines().find_map(|line| line.strip_prefix("ExecStart=/")).unwrap();
    assert!(root.join(line.split(' ').next().unwrap()).is_file(), "{line}");
    let notices = fs::read_to_string(root.join("usr/share/doc/isomark/copyright")).unwrap();
    assert_licences_are_complete(&notices, &format!("{}-unknown-linux-gnu", std::env::consts::ARCH));
    if libraries.status.success() {
        let changed = dpkg().args(["--verify", "isomark"]).output().unwrap();
        assert!(!text(&changed).contains("??5"), "{}", text(&changed));
        printed(dpkg().args(["--purge", "isomark"]));
        assert!(!root.join("usr").exists(), "{:?}", files(&root.join("usr")));
    }
}

/// A copy of the zip for Windows is complete on every system; the program in it runs where it can.
#[test]
fn the_zip_for_windows_is_complete_and_its_program_runs() {
    let place = tempfile::tempdir().unwrap();
    // On other systems, one that was built for Windows may be named.
    let given = std::env::var_os("ISOMARK_WINDOWS_PROGRAM").map(PathBuf::from);
    let program = if cfg!(windows) {
        PathBuf::from(PROGRAM)
    } else {
        given.clone().unwrap_or_else(|| {
            let path = place.path().join("header.exe");
            fs::write(&path, header_of_windows()).unwrap();
            path
        })
    };
    let Some((_out, packages)) = packed(&["windows"], &program) else { return };
    let unpacked = place.path().join("a folder");
    unzip(&packages[0], &unpacked);
    let folder = only(&unpacked);
    let packed = folder.join("isomark.exe");
    assert!(
        fs::read(&packed).unwrap() == fs::read(&program).unwrap(),
        "the program in the zip is another one"
    );
    assert_links_lead_to_files(&folder);
    let notices = fs::read_to_string(folder.join("THIRD-PARTY-LICENSES.txt")).unwrap();
    assert_licences_are_complete(&notices, "x86_64-pc-windows-gnu");
    assert!(notices.contains("windows-sys "), "crates of Windows are missing");
    if cfg!(windows) {
        assert_it_works(&|| Command::new(&packed), &folder);
        assert_the_demo_works(&|| Command::new(&packed));
        return;
    }
    let wine = ["wine", "wine64", "/usr/lib/wine/wine64"].into_iter().find(|name| {
        Command::new(name).arg("--version").output().is_ok_and(|output| output.status.success())
    });
    let (Some(_), Some(wine)) = (given, wine) else {
        eprintln!(
            "SKIPPED: the program for Windows was not run, because ISOMARK_WINDOWS_PROGRAM does not name one, or Wine is not installed"
        );
        return;
    };
    let prefix = std::env::var_os("WINEPREFIX").map_or_else(|| place.path().join("wine"), PathBuf::from);
    let start = || {
        let mut command = Command::new(wine);
        command.arg(&packed).env("WINEPREFIX", &prefix).env("WINEDEBUG", "-all");
        command
    };
    assert_it_works(&start, &folder);
    assert_the_demo_works(&start);
}

#[test]
fn the_zips_of_the_plugins_contain_what_their_hosts_install() {
    let Some((_out, packages)) = packed(&["freecad", "blender"], Path::new(PROGRAM)) else { return };
    let place = tempfile::tempdir().unwrap();
    for (package, folder) in packages.iter().zip(["freecad", "blender"]) {
        unzip(package, &place.path().join(folder));
    }
    let workbench = only(&place.path().join("freecad"));
    assert!(workbench.ends_with("isomark"));
    let source = Path::new(ROOT).join("plugins/freecad");
    let compared = |folder: &Path| -> Vec<(PathBuf, Vec<u8>)> {
        let paths = files(folder).into_iter().filter(|path| !path.iter().any(|name| name == "__pycache__"));
        paths.map(|path| (path.strip_prefix(folder).unwrap().to_owned(), fs::read(&path).unwrap())).collect()
    };
    assert!(compared(&workbench) == compared(&source), "the zip differs from plugins/freecad");
    assert!(workbench.join("package.xml").is_file() && workbench.join("LICENSE-MIT").is_file());
    let add_on = only(&place.path().join("blender"));
    for name in ["blender_manifest.toml", "__init__.py", "LICENSE"] {
        assert!(add_on.join(name).is_file(), "{name}");
    }
    runs_in_freecad(&place.path().join("home"), &workbench);
}

/// FreeCAD, where it is installed, finds the unpacked workbench in its folder for add-ons.
fn runs_in_freecad(home: &Path, workbench: &Path) {
    let starts = |name: &&str| Command::new(name).arg("--help").output().is_ok();
    let Some(freecad) = ["freecadcmd", "FreeCADCmd"].into_iter().find(starts) else {
        eprintln!("SKIPPED: FreeCAD is not installed, the workbench's zip was only compared");
        return;
    };
    let installed = home.join("Mod/isomark");
    fs::create_dir_all(home.join("Mod")).unwrap();
    fs::rename(workbench, &installed).unwrap();
    let script = home.join("found.py");
    fs::write(&script, "import freecad.Isomark.job as job\nprint('found', job.__file__)\n").unwrap();
    let shown =
        printed(Command::new(freecad).arg(&script).env("FREECAD_USER_HOME", home).env("ISOMARK", PROGRAM));
    assert!(shown.contains(&format!("found {}", installed.display())), "{shown}");
}

#[test]
#[cfg(target_os = "linux")]
fn the_same_sources_and_program_give_the_same_bytes_for_every_user() {
    let place = tempfile::tempdir().unwrap();
    let (linux, windows) = (place.path().join("isomark"), place.path().join("isomark.exe"));
    fs::write(&linux, header_of_linux()).unwrap();
    fs::write(&windows, header_of_windows()).unwrap();
    let has_dpkg = is_installed("dpkg-deb", &["--version"]);
    let of_linux: &[&str] = if has_dpkg { &["tarball", "deb", "freecad"] } else { &["tarball", "freecad"] };
    for (program, targets) in [(&linux, of_linux), (&windows, &["windows", "blender"])] {
        let Some((first, packages)) = packed(targets, program) else { return };
        assert_eq!(packages.len(), targets.len());
        let again = tempfile::tempdir().unwrap();
        let command = build(targets, program, again.path());
        // Another user's files are readable by that user alone.
        let mut private = Command::new("sh");
        private
            .args(["-c", "umask 077; exec \"$0\" \"$@\""])
            .arg(command.get_program())
            .args(command.get_args());
        printed(private.env("PYTHONDONTWRITEBYTECODE", "1"));
        for path in files(first.path()) {
            let other = again.path().join(path.file_name().unwrap());
            assert!(fs::read(&path).unwrap() == fs::read(other).unwrap(), "{} differs", path.display());
        }
    }
}

#[test]
fn a_program_of_another_system_is_rejected_and_leaves_no_package() {
    if !is_installed(PYTHON, &["-c", "import tomllib"]) {
        return;
    }
    let place = tempfile::tempdir().unwrap();
    let (windows, other) = (place.path().join("isomark.exe"), place.path().join("isomark.txt"));
    fs::write(&windows, header_of_windows()).unwrap();
    fs::write(&other, "no program").unwrap();
    let missing = place.path().join("missing");
    let cases = [
        ("tarball", &windows, "not a 64-bit program for Linux"),
        ("tarball", &other, "not a 64-bit program for Linux"),
        ("windows", &other, "not a 64-bit program for Windows"),
        ("windows", &missing, "No such file"),
    ];
    for (target, program, expected) in cases {
        let out = place.path().join("out");
        let output = build(&[target], program, &out).output().unwrap();
        let shown = text(&output);
        assert_eq!(output.status.code(), Some(1), "{shown}");
        assert!(
            shown.starts_with("error: ") && shown.contains(expected) && shown.contains("--program"),
            "{shown}"
        );
        assert!(files(&out).is_empty(), "{:?}", files(&out));
    }
}
