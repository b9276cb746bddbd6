//! What can be typed.

use std::ffi::OsString;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use crate::cache::Cache;
use crate::config::{ConfigError, JOINING, LOW_PASS, Losses, PatternSettings, Sku, Smoothing, Station};
use crate::formats::mesh::{self, Buffer, LengthUnit, MeshFormat, MeshReadError, PartFile, UpAxis};
use crate::formats::pattern::DrawingUnit;
use crate::geometry::surface::scan;
use crate::printable::{on_lines, on_one_line};
use crate::reason::Reason;

mod cache;
mod correct;
mod demo;
mod diff;
mod evaluate;
mod inspect;
mod job;
mod log;
mod service;
mod shell;
mod watch;
mod status;
mod check;

/// Bends flat drawings so that a galvo laser marks true lengths on curved parts.
#[derive(Debug, Parser)]
#[command(name = "isomark", version, about, max_term_width = 100)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Corrects one drawing for one part.
    Correct(Box<correct::CorrectArguments>),
    /// Says how true each method would be for one drawing on one part, side by side.
    Evaluate(Box<evaluate::EvaluateArguments>),
    /// Runs a station: drops of parts and patterns become corrected drawings.
    Watch(watch::WatchArguments),
    /// Says what a station is at: what it did, what waits for what, what was rejected last.
    Status(status::StatusArguments),
    /// Lets a station try again: what waits, what was rejected, or what is outdated.
    Retry(status::RetryArguments),
    /// Checks the settings of a station and of its SKUs.
    Check(check::CheckArguments),
    /// Sets up the folders and annotated settings of a station.
    Init(check::InitArguments),
    /// Says what isomark sees in a part or a drawing, and what it assumes.
    Inspect(inspect::InspectArguments),
    /// Says in words what changed between two drawings.
    Diff(diff::DiffArguments),
    /// Looks after the fitted surfaces.
    Cache(cache::CacheArguments),
    /// Sets up a station with sample parts and drawings, runs it, and shows what came of them.
    Demo(demo::DemoArguments),
}

/// What a file's numbers mean where the file itself does not say it, or says it wrongly.
#[derive(Debug, Args)]
struct MeaningArguments {
    /// Unit of the part's numbers: mm, cm, dm, m or inch; default: what format and producer say.
    #[arg(long, value_name = "UNIT", help_heading = "Part and drawing")]
    part_unit: Option<LengthUnit>,
    /// Axis of the part's file that points up: z or y; default: what format and producer say.
    #[arg(long, value_name = "AXIS", help_heading = "Part and drawing")]
    part_up: Option<UpAxis>,
    /// Unit of a drawing that names none: mm, in, px and others; default mm, or inches where the drawing hints at them.
    #[arg(long, value_name = "UNIT", help_heading = "Part and drawing")]
    pattern_unit: Option<DrawingUnit>,
    /// Width of a picture, mm; one side is enough. Without both, the resolution (dpi) that its file names.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing", value_parser = parse_side)]
    width: Option<f64>,
    /// Height of a picture, mm.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing", value_parser = parse_side)]
    height: Option<f64>,
    /// Pixels of a picture darker than this are marked: 0 is black, 100 white; default 50.
    #[arg(long, value_name = "PERCENT", help_heading = "Part and drawing", value_parser = parse_threshold)]
    threshold: Option<f64>,
    /// Ends of loose pieces no farther apart are joined, mm, 0 to 1; default 0.002, 0 joins nothing.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing", value_parser = parse_joining)]
    joining: Option<f64>,
    /// Leaves a drawing as it is: nothing is joined, closed or taken out, only warned of.
    #[arg(long, help_heading = "Part and drawing")]
    strict: bool,
    /// What is done when the drawing shows ink on an ink layer that cannot be taken over: refuse (default) or warn, which
    /// marks the rest.
    #[arg(long, value_name = "WHAT", help_heading = "Part and drawing")]
    losses: Option<Losses>,
    /// Marks the light pixels of a picture instead of the dark ones.
    #[arg(long, help_heading = "Part and drawing")]
    invert: bool,
}

impl MeaningArguments {
    /// The settings for drawings, with what was typed in their place.
    fn apply(&self, to: &mut PatternSettings) {
        to.unit_if_unitless = self.pattern_unit.or(to.unit_if_unitless);
        if self.width.is_some() || self.height.is_some() {
            (to.picture.width, to.picture.height) = (self.width, self.height);
        }
        to.picture.threshold = self.threshold.unwrap_or(to.picture.threshold);
        to.picture.inverted |= self.invert;
        to.joining_tolerance = self.joining.unwrap_or(to.joining_tolerance);
        to.strict |= self.strict;
        to.losses = self.losses.unwrap_or(to.losses);
    }
}

/// How a scan becomes a surface.
#[derive(Debug, Args)]
struct ScanArguments {
    /// How noise is taken out of a scan: auto (as much as the points ask for, default), low-pass or none.
    #[arg(long, value_name = "HOW", help_heading = "Part and drawing")]
    smoothing: Option<Smoothing>,
    /// Waves of this length are halved and shorter ones taken out, mm; with `--smoothing low-pass`, default 16.
    #[arg(long, value_name = "MM", help_heading = "Part and drawing")]
    low_pass: Option<f64>,
}

impl ScanArguments {
    /// The smoothing, if it was given.
    fn smoothing(&self) -> Result<Option<scan::Smoothing>, Failure> {
        let named = self.smoothing.or(self.low_pass.map(|_| Smoothing::LowPass));
        match self.low_pass {
            Some(wavelength) if !LOW_PASS.contains(&wavelength) => Err(Failure::usage(
                format!("A low pass of {wavelength} mm makes no sense."),
                format!("Give `--low-pass` between {} and {} mm.", LOW_PASS.start(), LOW_PASS.end()),
            )),
            Some(_) if named != Some(Smoothing::LowPass) => Err(Failure::usage(
                "`--low-pass` means nothing with another smoothing.",
                "Leave out one of `--smoothing` and `--low-pass`.",
            )),
            wavelength => Ok(named.map(|named| named.with_wavelength(wavelength))),
        }
    }
}

/// What the program ends with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// Done.
    Done = 0,
    /// The input was rejected.
    Rejected = 1,
    /// The command line or the settings are wrong.
    Usage = 2,
    /// The surroundings failed: disk, permission.
    Environment = 3,
}

/// Why a command ended without its result.
#[derive(Debug)]
struct Failure {
    exit: Exit,
    reason: Reason,
}

type Outcome = Result<(), Failure>;

/// Runs the program on its command line.
pub fn main() -> ExitCode {
    // A reader that has seen enough (`isomark … | head`) is no failure worth a backtrace: writes to it just end.
    let line = match CommandLine::try_parse() {
        Ok(line) => line,
        Err(error) => {
            let exit = if error.use_stderr() { Exit::Usage } else { Exit::Done };
            if exit == Exit::Usage && wants_json(std::env::args_os()) {
                print_json(&usage(&error.to_string()).to_json(None).unwrap_or_default());
            }
            tell_mistake(&error);
            return ExitCode::from(exit as u8);
        }
    };
    let (outcome, json) = match line.command {
        Command::Correct(arguments) => (correct::run(&arguments), arguments.json),
        Command::Evaluate(arguments) => (evaluate::run(&arguments), arguments.json),
        Command::Watch(arguments) => (watch::run(&arguments), false),
        Command::Status(arguments) => (status::run(&arguments), arguments.json),
        Command::Retry(arguments) => (status::retry(&arguments), false),
        Command::Check(arguments) => (check::run(&arguments), false),
        Command::Init(arguments) => (check::init(&arguments), false),
        Command::Inspect(arguments) => (inspect::run(&arguments), arguments.json),
        Command::Diff(arguments) => (diff::run(&arguments), arguments.json),
        Command::Cache(arguments) => (cache::run(&arguments), false),
        Command::Demo(arguments) => (demo::run(&arguments), false),
    };
    match outcome {
        Ok(()) => ExitCode::from(Exit::Done as u8),
        Err(failure) => {
            if json {
                // Without its JSON form the failure is still told below.
                print_json(&failure.reason.to_json(None).unwrap_or_default());
            }
            tell(&format!("isomark: {}", failure.reason));
            ExitCode::from(failure.exit as u8)
        }
    }
}

/// Whether the result is asked for as JSON on a command line that cannot be read as a whole.
fn wants_json(arguments: impl Iterator<Item = OsString>) -> bool {
    arguments.skip(1).take_while(|argument| argument != "--").any(|argument| argument == "--json")
}

/// What is wrong with a command line, from what people are shown: the mistake, then tips and the usage.
fn usage(told: &str) -> Reason {
    let mut parts = told.split("\n\n").map(|part| part.split_whitespace().collect::<Vec<_>>().join(" "));
    let what = parts.next().unwrap_or_default();
    let what = what.strip_prefix("error: ").unwrap_or(&what).to_owned();
    let tip = parts.find_map(|part| part.strip_prefix("tip: ").map(str::to_owned));
    Reason::new("usage", what, tip.unwrap_or_else(|| "See `isomark help`.".into()))
}

impl Failure {
    fn rejected(reason: Reason) -> Self {
        Self { exit: Exit::Rejected, reason }
    }

    fn usage(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { exit: Exit::Usage, reason: Reason::new("usage", what, remedy) }
    }

    fn environment(error: &std::io::Error) -> Self {
        let remedy = "Check that the file or folder exists, that it may be read or written, and that the disk is not full.";
        Self { exit: Exit::Environment, reason: Reason::new("environment", format!("{error}."), remedy) }
    }
}

impl From<ConfigError> for Failure {
    /// A file that is not there, or is none, does not come by trying again.
    fn from(error: ConfigError) -> Self {
        use ErrorKind::{InvalidData, IsADirectory, NotADirectory, NotFound};
        let wrong = |kind| matches!(kind, NotFound | InvalidData | IsADirectory | NotADirectory);
        let exit = match &error {
            ConfigError::Unreadable { file, source } if !wrong(source.kind()) && !file.is_dir() => {
                Exit::Environment
            }
            _ => Exit::Usage,
        };
        Self { exit, reason: error.reason() }
    }
}

impl From<crate::pipeline::PipelineError> for Failure {
    fn from(error: crate::pipeline::PipelineError) -> Self {
        match error {
            crate::pipeline::PipelineError::Rejected(reason) => Self::rejected(reason),
            // Nobody is in a hurry here.
            error @ crate::pipeline::PipelineError::TakesLong => {
                Self::rejected(Reason::new("takes-long", format!("{error}."), "Try again."))
            }
            crate::pipeline::PipelineError::Environment(error) => Self::environment(&error),
        }
    }
}

/// Writes to people on standard output; a closed one is no error. Names in the text that come from files have to be on
/// one line ([`on_one_line`], [`shown`]); whatever else does not print is spelled out here.
fn print(text: &str) {
    write_out(&on_lines(text));
}

/// Writes a document to machines on standard output, exactly as it is; a closed one is no error.
fn print_json(text: &str) {
    write_out(text);
}

fn write_out(text: &str) {
    let mut out = std::io::stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}

/// Writes a line to people on standard error, with what does not print spelled out as in [`print()`]; a closed one is no
/// error.
fn tell(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{}", on_lines(text));
}

/// Writes what is wrong with the command line, or its help. What was typed may be a file's name that the shell put in.
fn tell_mistake(error: &clap::Error) {
    let typed: Vec<String> =
        std::env::args_os().map(|argument| on_one_line(&argument.to_string_lossy())).collect();
    match CommandLine::try_parse_from(typed) {
        Err(error) => {
            let _ = error.print();
        }
        Ok(_) => tell(error.to_string().trim_end()),
    }
}

/// A path as people are shown it.
fn shown(path: &Path) -> String {
    on_one_line(&path.display().to_string())
}

/// The content of a file that the user named.
fn read_file(path: &Path) -> Result<Vec<u8>, Failure> {
    std::fs::read(path).map_err(|error| file_trouble("read", path, &error))
}

/// Writes a file that the user named, whole or not at all.
fn write_file(path: &Path, bytes: &[u8]) -> Outcome {
    write_with(path, |folder, name| crate::files::write_whole(folder, name, bytes))
}

/// The same, if `check` accepts what is read from the disk before the file gets its name.
fn write_file_if(path: &Path, bytes: &[u8], check: impl FnOnce(&[u8]) -> Result<(), Reason>) -> Outcome {
    let mut checked = Ok(());
    write_with(path, |folder, name| {
        checked = crate::files::write_whole_if(folder, name, bytes, check)?;
        Ok(())
    })?;
    checked.map_err(|reason| Failure::rejected(reason.in_file(path.display().to_string())))
}

fn write_with(path: &Path, write: impl FnOnce(&Path, &str) -> std::io::Result<()>) -> Outcome {
    let (folder, name) = (folder_of(path), name_of(path)?);
    if path.is_dir() {
        return Err(file_trouble("write", path, &ErrorKind::IsADirectory.into()));
    }
    write(folder, &name).map_err(|error| file_trouble("write", path, &error))
}

/// Refuses to write over what is read, or two results into one file: the designer's file would be gone without a word.
/// Each file comes with the word that named it.
fn apart(read: &[&Path], written: &[(&str, &Path)]) -> Outcome {
    let same = |one: &Path, two: &Path| {
        one == two || matches!((one.canonicalize(), two.canonicalize()), (Ok(one), Ok(two)) if one == two)
    };
    for (index, (option, file)) in written.iter().enumerate() {
        if read.iter().any(|read| same(read, file)) {
            return Err(Failure::usage(
                format!("`{option}` names {}, which is read; it would be lost.", file.display()),
                format!("Give `{option}` a name of its own."),
            ));
        }
        if let Some((other, _)) = written[..index].iter().find(|(_, other)| same(other, file)) {
            return Err(Failure::usage(
                format!("`{other}` and `{option}` name the same file, {}.", file.display()),
                "Give each of them a name of its own.",
            ));
        }
    }
    Ok(())
}

/// A file that the user named cannot be read or written.
fn file_trouble(verb: &str, path: &Path, error: &std::io::Error) -> Failure {
    let (file, folder) = (path.display(), folder_of(path).display());
    let (what, remedy) = match error.kind() {
        ErrorKind::NotFound if verb == "read" => {
            (format!("There is no file {file}."), "Check its name and its folder.".to_owned())
        }
        ErrorKind::NotFound => (
            format!("There is no folder {folder} to write {file} into."),
            "Make the folder, or name another one.".to_owned(),
        ),
        _ if path.is_dir() => (
            format!("The folder {file} is named where a file is meant."),
            format!("Name a file, such as {}.", path.join("name.dxf").display()),
        ),
        ErrorKind::PermissionDenied => (
            format!("The file {file} may not be {}.", if verb == "read" { "read" } else { "written" }),
            format!("Give yourself the right to {verb} in the folder {folder}, or choose another folder."),
        ),
        _ => (
            format!("Cannot {verb} {file}: {error}."),
            "Check the disk, its free space and the way to it, then try again.".to_owned(),
        ),
    };
    Failure {
        exit: Exit::Environment,
        reason: Reason::new("environment", what, remedy).in_file(file.to_string()),
    }
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

fn name_of(path: &Path) -> Result<String, Failure> {
    match path.file_name().and_then(|name| name.to_str()) {
        Some(name) => Ok(name.to_owned()),
        None => Err(Failure::usage(format!("{} is not the name of a file.", path.display()), "Name a file.")),
    }
}

/// A part with the files beside it that it needs.
fn read_part(path: &Path) -> Result<PartFile, Failure> {
    let mut part = PartFile::alone(name_of(path)?, read_file(path)?);
    let Some(format) = MeshFormat::from_name(&part.name) else { return Ok(part) };
    let refused = |error: MeshReadError| Failure::rejected(error.reason().in_file(&part.name));
    let buffers = mesh::named_files(&part.bytes, format).map_err(refused)?.buffers;
    let read = |buffer: Buffer| match crate::files::read_beside(path, &buffer.name) {
        Ok(bytes) => Ok((buffer.name, bytes)),
        Err(error) => Err(refused(MeshReadError::BufferMissing { name: buffer.name, kind: error.kind() })),
    };
    part.siblings = buffers.into_iter().map(read).collect::<Result<_, _>>()?;
    Ok(part)
}

/// The station's settings, if one is named.
fn station(file: Option<&Path>) -> Result<Option<Station>, Failure> {
    Ok(file.map(Station::load).transpose()?)
}

/// The cache to use: the named folder, else the station's, else the user's own.
fn cache_of(named: Option<&Path>, station: Option<&Station>) -> Result<Cache, Failure> {
    if let Some(folder) = named {
        return Ok(Cache::new(folder));
    }
    if let Some(station) = station {
        return Ok(Cache::new(&station.folders.cache));
    }
    let variable = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let user = if cfg!(windows) {
        variable("LOCALAPPDATA")
    } else {
        variable("XDG_CACHE_HOME").or_else(|| variable("HOME").map(|home| home.join(".cache")))
    };
    user.map(|folder| Cache::new(folder.join("isomark"))).ok_or_else(|| {
        Failure::usage(
            "There is no folder to keep fitted surfaces in.",
            "Name one with `--cache`, or a station with `--station`.",
        )
    })
}

fn parse_side(text: &str) -> Result<f64, String> {
    let side = text.trim().parse().ok().filter(|side| (0.01..=10_000.0).contains(side));
    side.ok_or_else(|| "give a length in mm, from 0.01 to 10000".into())
}

fn parse_joining(text: &str) -> Result<f64, String> {
    let gap = text.trim().parse().ok().filter(|gap| JOINING.contains(gap));
    gap.ok_or_else(|| format!("give a length in mm, from {} to {}", JOINING.start(), JOINING.end()))
}

fn parse_threshold(text: &str) -> Result<f64, String> {
    let percent = text.trim().trim_end_matches('%').parse().ok();
    let percent = percent.filter(|percent: &f64| (1.0..=99.0).contains(percent));
    percent.map(|percent| percent / 100.0).ok_or_else(|| "give a number from 1 to 99".into())
}

fn parse_sku(text: &str) -> Result<Sku, Failure> {
    text.parse::<Sku>().map_err(|error| Failure { exit: Exit::Usage, reason: error.reason() })
}
