//! Converts STEP files with FreeCAD: surfaces of every kind become B-splines, in a child process with limits of time, memory and size.

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use fs_err as fs;

/// What FreeCAD runs.
const SCRIPT: &str = include_str!("converter.py");
/// Names of FreeCAD without its window.
const NAMES: [&str; 2] = ["freecadcmd", "FreeCADCmd"];
/// Time between two looks at the child process.
const LOOK: Duration = Duration::from_millis(50);
/// Longest text of FreeCAD in a message, characters.
const LONGEST_TEXT: usize = 300;

/// What a conversion may use.
#[derive(Debug, Clone, Copy)]
struct Limits {
    time: Duration,
    /// Bytes.
    memory: u64,
    /// Size of the converted file, bytes.
    size: u64,
}

const LIMITS: Limits = Limits { time: Duration::from_secs(120), memory: 4 << 30, size: 256 << 20 };

/// Why a file was not converted.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ConverterError {
    /// FreeCAD is not installed.
    #[error("FreeCAD was not found: {} is not in the PATH", NAMES.join(" or "))]
    NotFound,
    /// This build of the library cannot measure the memory of a process.
    #[error("without the feature `station`, isomark converts on Linux only")]
    Unlimited,
    /// The temporary folder or the program cannot be used.
    #[error("{0}")]
    Environment(#[from] io::Error),
    /// The limit of time.
    #[error("FreeCAD took longer than {} s", .0.as_secs())]
    Time(Duration),
    /// The limit of memory.
    #[error("FreeCAD needed more than {} MB of memory", .0 >> 20)]
    Memory(u64),
    /// The limit of size.
    #[error("the converted file is larger than {} MB", .0 >> 20)]
    Size(u64),
    /// FreeCAD failed.
    #[error("FreeCAD failed: {0}")]
    Failed(String),
}

/// The STEP file with all surfaces as B-splines, mm. Names of faces, bodies and placements are lost.
///
/// # Errors
/// When FreeCAD is not installed, fails or exceeds a limit, and when the temporary folder cannot be used.
pub(crate) fn with_splines(step: &[u8]) -> Result<Vec<u8>, ConverterError> {
    if !cfg!(any(target_os = "linux", feature = "station")) {
        return Err(ConverterError::Unlimited);
    }
    let program = found(folders()).ok_or(ConverterError::NotFound)?;
    convert(&program, step, &LIMITS)
}

/// The folders in which programs are installed.
fn folders() -> Vec<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut folders: Vec<PathBuf> =
        std::env::split_paths(&path).filter(|folder| folder.is_absolute()).collect();
    for variable in ["ProgramFiles", "LOCALAPPDATA"].into_iter().filter(|_| cfg!(windows)) {
        let programs = PathBuf::from(std::env::var_os(variable).unwrap_or_default());
        for parent in [programs.join("Programs"), programs] {
            folders.extend(of_freecad(&parent));
        }
    }
    folders
}

/// The `bin` folders of the versions of FreeCAD in a folder, the newest first.
fn of_freecad(parent: &Path) -> Vec<PathBuf> {
    let Some(entries) = parent.is_absolute().then(|| fs::read_dir(parent).ok()).flatten() else {
        return Vec::new();
    };
    let names = entries.filter_map(Result::ok).map(|entry| entry.file_name());
    let mut names: Vec<OsString> =
        names.filter(|name| name.to_string_lossy().to_ascii_lowercase().starts_with("freecad")).collect();
    names.sort();
    names.into_iter().rev().map(|name| parent.join(name).join("bin")).collect()
}

fn found(folders: Vec<PathBuf>) -> Option<PathBuf> {
    let files =
        |folder: PathBuf| NAMES.map(|name| folder.join(format!("{name}{}", std::env::consts::EXE_SUFFIX)));
    folders.into_iter().flat_map(files).find(|file| file.is_file())
}

fn convert(program: &Path, step: &[u8], limits: &Limits) -> Result<Vec<u8>, ConverterError> {
    let folder = tempfile::Builder::new().prefix("isomark-convert-").tempdir()?;
    let [script, from, to, problem] =
        ["convert.py", "from.step", "to.step", "problem.txt"].map(|name| folder.path().join(name));
    fs::write(&script, SCRIPT)?;
    fs::write(&from, step)?;
    let mut command = Command::new(program);
    command
        .arg(&script)
        .current_dir(folder.path())
        .env("ISOMARK_FROM", &from)
        .env("ISOMARK_TO", &to)
        .env("ISOMARK_PROBLEM", &problem)
        .env("ISOMARK_MEMORY", limits.memory.to_string())
        .env("ISOMARK_SIZE", limits.size.to_string())
        .env("ISOMARK_SECONDS", (limits.time.as_secs() + 1).to_string())
        // Without the settings and the additions of a user.
        .env("FREECAD_USER_HOME", folder.path())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut child = command.spawn()?;
    let ended = wait(&mut child, limits);
    if ended.is_err() {
        stop(&mut child);
    }
    let status = ended?;
    let size = fs::metadata(&to).map_or(0, |file| file.len());
    match () {
        () if status.success() && size > limits.size => Err(ConverterError::Size(limits.size)),
        () if status.success() && size > 0 => Ok(fs::read(&to)?),
        () => {
            let text = fs::read_to_string(&problem).unwrap_or_default();
            let text: String = text.trim().chars().take(LONGEST_TEXT).collect();
            Err(ConverterError::Failed(if text.is_empty() { status.to_string() } else { text }))
        }
    }
}

/// Waits for the end of the child process, as long as it stays within its limits.
fn wait(child: &mut Child, limits: &Limits) -> Result<ExitStatus, ConverterError> {
    let since = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if since.elapsed() >= limits.time {
            return Err(ConverterError::Time(limits.time));
        }
        if memory_of(child.id()).is_some_and(|memory| memory > limits.memory) {
            return Err(ConverterError::Memory(limits.memory));
        }
        std::thread::sleep(LOOK);
    }
}

/// The memory that a process uses, bytes; `None` when it ends just now.
#[cfg(target_os = "linux")]
fn memory_of(process: u32) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|kilobytes| kilobytes << 10)
}

/// The memory that a process uses, bytes; `None` when it ends just now.
#[cfg(all(not(target_os = "linux"), feature = "station"))]
fn memory_of(process: u32) -> Option<u64> {
    use sysinfo::{Pid, ProcessRefreshKind, ProcessesToUpdate, System};
    let (id, mut system) = (Pid::from_u32(process), System::new());
    let only_memory = ProcessRefreshKind::nothing().with_memory();
    system.refresh_processes_specifics(ProcessesToUpdate::Some(&[id]), true, only_memory);
    system.process(id).map(sysinfo::Process::memory)
}

/// Nothing: [`with_splines`] starts no process here.
#[cfg(not(any(target_os = "linux", feature = "station")))]
fn memory_of(_: u32) -> Option<u64> {
    None
}

/// Ends the child process and those that it started.
fn stop(child: &mut Child) {
    let id = child.id();
    let mut command;
    if cfg!(windows) {
        command = Command::new("taskkill");
        command.args(["/T", "/F", "/PID", &id.to_string()]);
    } else {
        command = Command::new("kill");
        command.args(["-KILL", "--", &format!("-{id}")]);
    }
    // If this fails, the child process alone is ended.
    drop(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status());
    drop(child.kill());
    drop(child.wait());
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::formats::mesh::{self, MeshFormat, MeshOptions, Shape};
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::fork::InTurn;
    use crate::geometry::height_field::Grid;
    use crate::geometry::space::View;

    /// The cap, with its surface on the side of its edges: OpenCASCADE writes the offset of a surface of revolution with the wrong sign.
    fn cap() -> Vec<u8> {
        let text = include_str!("../tests/data/parts/step/offset.step");
        assert!(text.contains("('',#38,5.,"));
        text.replace("('',#38,5.,", "('',#38,-5.,").into_bytes()
    }

    fn freecad() -> Option<PathBuf> {
        let program = found(folders());
        assert!(program.is_some() || std::env::var("CI").is_err(), "freecadcmd is required in CI");
        program
    }

    /// Distance of a point from an ellipse with the half axes 30 and 20.
    fn from_ellipse(along: f64, across: f64) -> f64 {
        let distance = |angle: f64| (30.0 * angle.cos() - along).hypot(20.0 * angle.sin() - across);
        let (mut best, mut width) = (0.0, 3.2);
        for _ in 0..12 {
            let around = (-50..=50).map(|step| best + width * f64::from(step) / 50.0);
            best = around.min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap();
            width *= 0.1;
        }
        distance(best)
    }

    #[test]
    fn a_converted_offset_has_its_distance() {
        if freecad().is_none() {
            return;
        }
        let converted = with_splines(&cap()).unwrap();
        let options = MeshOptions::default();
        let reading = mesh::read(&converted, MeshFormat::Step, &options, &BTreeMap::new()).unwrap();
        let Shape::Solid(part) = &reading.shape else { panic!("a STEP file is a solid") };
        let view = View::top();
        let part = FacingPart::of_solid(&part.solid, &part.mesh, &view, &InTurn);
        assert!(part.faces().unwrap().unread().is_none());
        let field = part.sample(&Grid::over(&part.extents(), 0.5)).field;
        let mut nodes = 0;
        for (column, row, height) in field.surface_nodes() {
            let at = field.position(column, row);
            let distance = from_ellipse(at.x, at.y.hypot(height));
            assert!((distance - 5.0).abs() < 2e-3, "{at:?}, {height}: {distance}");
            nodes += 1;
        }
        assert!(nodes > 500, "{nodes}");
    }

    #[test]
    fn a_file_that_freecad_cannot_read_fails_with_its_words() {
        if freecad().is_none() {
            return;
        }
        let error = with_splines(b"ISO-10303-21;\nnothing\n").unwrap_err();
        assert!(matches!(error, ConverterError::Failed(_)), "{error}");
        assert!(error.to_string().len() > "FreeCAD failed: ".len() + 5, "{error}");
    }

    #[test]
    fn a_program_beyond_its_limits_is_ended() {
        let Some(program) = freecad() else { return };
        let limits = |time, memory| Limits { time: Duration::from_secs(time), memory, size: 1 << 20 };
        let slow = convert(&program, &cap(), &limits(0, 4 << 30)).unwrap_err();
        assert!(matches!(slow, ConverterError::Time(_)), "{slow}");
        let large = convert(&program, &cap(), &limits(60, 1 << 20)).unwrap_err();
        assert!(matches!(large, ConverterError::Memory(_) | ConverterError::Failed(_)), "{large}");
        let small = convert(&program, &cap(), &Limits { size: 1000, ..limits(60, 4 << 30) }).unwrap_err();
        assert!(matches!(small, ConverterError::Size(_) | ConverterError::Failed(_)), "{small}");
        assert_eq!(found(vec![PathBuf::from("/nowhere")]), None);
    }
}
